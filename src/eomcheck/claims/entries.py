"""Entries of compared arrays that are resolved, and those that rounding of larger ones hides.

A comparison allows every entry the rounding of the largest, so that a small row may be wrong beside
a large one and the finding passes. Which entries are so small is kept with each finding; entries
that are resolved in no state of a run are listed by name in one inconclusive finding a claim.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array

if TYPE_CHECKING:
    from eomcheck.claims.finding import Finding

LISTED = 8
"""Number of entries that are listed by name; the others are counted."""

UNRESOLVED = "not resolved in "
"""Beginning of the detail of a finding that lists entries."""

Names = tuple[tuple[str, ...], ...]


class Entries(NamedTuple):
    """Entries of one compared array, as flags packed into bytes.

    Attributes:
        names: names along each axis.
        resolved: which are shown to be right or wrong, other than by 0 = 0.
        hidden: which are not, and are not 0 = 0 either.
    """

    names: Names
    resolved: bytes
    hidden: bytes

    @property
    def count_hidden(self) -> int:
        """Number of hidden entries."""
        return int.from_bytes(self.hidden).bit_count()

    def hides(self, name: str) -> bool:
        """Whether the entry of a name is hidden."""
        return name in _named(int.from_bytes(self.hidden), self.names)

    def joined(self, other: Entries) -> Entries:
        """Flags of two comparisons of the same names: resolved, or hidden, in either."""
        pairs = zip(self[1:], other[1:], strict=True)
        return Entries(self.names, *(bytes(x | y for x, y in zip(*p, strict=True)) for p in pairs))


def entries_of(names: Names, resolved: Any, hidden: Any) -> Entries:
    """Flags of entries as `Entries`; both are arrays of bools that have the names' shape."""
    return Entries(names, *(np.packbits(np.ravel(x)).tobytes() for x in (resolved, hidden)))


def entry_name(index: tuple[int, ...], names: Names) -> str:
    """Name of one entry: "row θ_3", "entry (x, θ_3)", or "value" without axes."""
    named = [axis[i] for axis, i in zip(names, index, strict=True)]
    if len(named) < 2:
        return f"row {named[0]}" if named else "value"
    return f"entry ({', '.join(named)})"


def merged(entries: Iterable[Entries]) -> list[Entries]:
    """Flags of any number of comparisons, joined to one `Entries` for each set of names."""
    by_names: dict[Names, Entries] = {}
    for one in entries:
        before = by_names.get(one.names)
        by_names[one.names] = one if before is None else before.joined(one)
    return [*by_names.values()]


def left_of(entries: Iterable[Entries]) -> list[str]:
    """Names of the entries of one subject that are hidden in some state and resolved in none.

    Entries of one name are the same one, whatever else a scene has: row θ_1 of a chain of two
    links is that of a chain of five.
    """
    flags = [
        (one.names, *map(int.from_bytes, (one.resolved, one.hidden))) for one in merged(entries)
    ]
    if not any(h & ~r for _, r, h in flags):
        return []
    resolved = {name for names, r, _ in flags for name in _named(r, names)}
    left = (name for names, r, h in flags if h & ~r for name in _named(h, names))
    return [name for name in dict.fromkeys(left) if name not in resolved]


def _named(flags: int, names: Names) -> Iterator[str]:
    shape = tuple(map(len, names))
    size = int(np.prod(shape))
    packed = np.frombuffer(flags.to_bytes(-(-size // 8)), np.uint8)
    at: Array = np.flatnonzero(np.unpackbits(packed)[:size])
    for k in at:
        yield entry_name(tuple(int(i) for i in np.unravel_index(k, shape)), names)


def listing(names: Sequence[str], states: int) -> str:
    """Detail of the finding that lists what is resolved in none of so many states."""
    where = f"any of {states} states" if states > 1 else "this state"
    return f"{UNRESOLVED}{where}: {shortened(names)}"


def shortened(items: Sequence[str]) -> str:
    """List of the first `LISTED` items in words, and the number of others."""
    more = f" and {len(items) - LISTED} more" if len(items) > LISTED else ""
    return f"{'; '.join(items[:LISTED])}{more}"


def lists(detail: str) -> bool:
    """Whether a detail is one of `listing`."""
    return detail.startswith(UNRESOLVED)


class Left(NamedTuple):
    """Something that is compared in some states and resolved in none.

    Attributes:
        subject: what is compared.
        entry: name of the entry, "" where all of the subject is undecided.
        finding: the one of these states whose scene has most coordinates.
        states: number of states in which the claim was looked at.
    """

    subject: str
    entry: str
    finding: Finding
    states: int

    @property
    def name(self) -> str:
        """The subject and the entry."""
        return f"{self.subject}, {self.entry}" if self.entry else self.subject


def unresolved(findings: Iterable[Finding]) -> dict[str, list[Left]]:
    """Claim -> what no state resolves of it; claims with nothing of the kind are left out.

    These are subjects that are decided in no state, and entries that are hidden in some state and
    resolved in none; an entry that is 0 = 0 in all states has passed.

    Args:
        findings: those of all states of a run.
    """
    by: dict[str, dict[str, list[Finding]]] = {}
    for one in findings:
        if one.verdict != "not looked at" and one.state is not None:
            by.setdefault(one.claim, {}).setdefault(one.subject, []).append(one)
    left: dict[str, list[Left]] = {}
    for claim, subjects in by.items():
        states = max(map(len, subjects.values()))
        for subject, each in subjects.items():
            if all(one.verdict == "inconclusive" for one in each):
                left.setdefault(claim, []).append(Left(subject, "", each[0], states))
                continue
            for name in left_of(one.entries for one in each if one.entries is not None):
                where = (one for one in each if one.entries and one.entries.hides(name))
                largest = max(where, key=lambda one: one.scene.n)
                left.setdefault(claim, []).append(Left(subject, name, largest, states))
    return left


def listed(left: Sequence[Left]) -> Finding:
    """The inconclusive finding of one claim that lists what no state resolves of it."""
    about = list(dict.fromkeys(one.subject for one in left))
    return replace(
        left[0].finding,
        subject=", ".join(about) if len(about) <= LISTED else "all",
        verdict="inconclusive",
        detail=listing([one.name for one in left], left[0].states),
        entries=None,
    )
