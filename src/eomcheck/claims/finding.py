"""A `Finding`: the verdict on one claim at one state, and the entries it resolves.

Verdicts come from checks alone; reports only count them. A comparison allows every entry of an
array the rounding error of the largest one, so that a finding may pass although a small row beside
a large one is wrong. Each finding therefore stores `Entries`: flags of the entries that are
resolved (shown to be right or wrong) and of those hidden by the rounding error of larger ones.
Entries that no state of a run resolves are listed by name in one inconclusive finding per claim.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from eomcheck.claims.reproducer import reproducer_of
from eomcheck.engines import Engine
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    UNDERFLOW,
    UNIT_ROUNDOFF,
    allowed_error,
    underflow_error,
)
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import listed

Verdict = Literal["passed", "failed", "inconclusive", "skipped"]

VERDICTS: tuple[Verdict, ...] = ("failed", "passed", "inconclusive", "skipped")
"""All verdicts by precedence, see `worst`; their indices are their codes in arrays."""

FAILED_CODE, PASSED_CODE, INCONCLUSIVE_CODE, SKIPPED_CODE = range(len(VERDICTS))

DECIDED: tuple[Verdict, ...] = VERDICTS[:INCONCLUSIVE_CODE]
"""The verdicts that decide a claim."""

EVERY_ROW = " (every row)"
"""Suffix of a text about all rows of a quantity."""


@dataclass(frozen=True)
class Proof:
    """The basis of a proof by polynomial identity testing.

    docs/explanation/proof.md derives the bounds.

    Attributes:
        degree: bound on the total degree of the numerator of left - right.
        height: bound on the sum of its coefficients' magnitudes, as a power of two (bits).
        primes: the primes, one per point evaluated.
        draws: number of points drawn, those included at which a divisor vanished.
        failure_probability: bound on the probability that all points agree by chance.
    """

    degree: int
    height: float
    primes: tuple[int, ...]
    draws: int
    failure_probability: float


@dataclass(frozen=True)
class Finding:
    """The verdict on one claim at one state, or for all states at once.

    Attributes:
        claim: id of the claim, a key of `eomcheck.claims.CLAIMS`.
        subject: the compared formulations, engine or term, such as "au ~ kane" or "pinocchio".
        scene: the `Scene`, or the `SubjectUnderTest` in its place.
        state: (q, v, t), or None if it holds for all states of all scenes of this structure.
        observed: largest error, in the units of the quantity; for a proof, the number of points at
            which the sides differ.
        allowed: bound on the rounding error, in the same units.
        verdict: "passed", "failed", "inconclusive" if `allowed` is so large that nothing was
            checked, or "skipped" if it could not be evaluated; the detail gives the reason.
        evidence: level of the evidence and its basis.
        detail: for a failure, the term, the row and the sort of error; for a skipped claim, the
            reason.
        proof: bounds and primes of a proof, or None.
        digits: certified decimal digits of a float64 result, or None.
        engine: the user-supplied engine under test, or None.
        cause: for a failure of functions, the function that is wrong according to all failures and
            passes, or "M or bias" if these do not decide; "" otherwise.
        follows: id of the claim whose failure has the same cause and is reported first, or "".
        entries: flags of the resolved and hidden entries, None for a number.
    """

    claim: str
    subject: str
    scene: Any
    state: State | None
    observed: float
    allowed: float
    verdict: Verdict
    evidence: str
    detail: str = ""
    proof: Proof | None = None
    digits: float | None = None
    engine: type[Engine] | None = None
    cause: str = ""
    follows: str = ""
    entries: Entries | None = field(default=None, repr=False, compare=False, kw_only=True)

    @property
    def ratio(self) -> float:
        """The ratio observed / allowed."""
        return ratio(self.observed, self.allowed)

    @property
    def location(self) -> str:
        """Name of the scene; its structure, if the finding is about all states."""
        return self.scene.structure if self.state is None else self.scene.name

    def __str__(self) -> str:
        if self.state is None:
            text = f"{self.claim} [{self.subject}] {self.evidence} on {self.scene.structure}"
            return f"{text} ({self.detail})" if self.detail else text
        text = f"{self.claim} [{self.subject}] {self.verdict} on {self.scene.name}"
        if self.verdict == "skipped":
            return f"{text}: {self.detail}"  # there are no numbers
        text = f"{text}: {comparison_text(self.observed, self.allowed, self.detail, ' ({})')}"
        return f"  follows from {self.cause}: {text}" if self.follows else text

    def because(self, why: str) -> Finding:
        """Return the Finding with a reason appended to its detail."""
        return replace(self, detail=f"{self.detail}; {why}")

    @property
    def place(self) -> dict[str, Any]:
        """Scene and state as plain data, numbers in full precision."""
        if self.state is None:
            return {"structure": self.scene.structure}
        q, v, t = self.state
        return {"scene": repr(self.scene), "q": q.tolist(), "v": v.tolist(), "t": t}

    def as_dict(self, whole: bool = True) -> dict[str, Any]:
        """Return the finding as plain data, numbers in full precision.

        Args:
            whole: whether scene and state (`place`) are included.

        Returns:
            The fields by name, as far as they are set; a number that is not finite is None.
        """
        return plain_row(self, self.place if whole else {})

    def as_python(self) -> str:
        """Return Python code that reproduces the finding."""
        engines = () if self.engine is None else (self.engine,)
        return reproducer_of(self.detail, self.scene, self.state, engines)


def comparison_text(observed: float, allowed: float, detail: str, form: str = "; {}") -> str:
    """Return the numbers of a comparison and its detail; the detail alone where there are none.

    A result of a wrong shape, or none at all, has no error: its detail gives what was returned and
    what was expected.

    Args:
        observed: largest error, infinite where nothing could be compared.
        allowed: bound on the rounding error.
        detail: the detail, "" for none.
        form: format of the detail behind the numbers.
    """
    if detail and not np.isfinite(observed) and allowed == 0.0:
        return detail
    numbers = f"observed {observed:.3g}, allowed {allowed:.3g}"
    return numbers + (form.format(detail) if detail else "")


def skipped_everywhere(claim: str, subject: str, scene: Any, reason: str) -> Finding:
    """Return the Finding that a claim cannot be evaluated about `subject`, in any state."""
    return Finding(claim, subject, scene, None, 0.0, 0.0, "skipped", "skipped", reason)


def plain_row(finding: Any, place: dict[str, Any]) -> dict[str, Any]:
    """Return a `Finding`, or a stored one, at a place as plain data, see `Finding.as_dict`."""
    row = {"claim": finding.claim, "subject": finding.subject, **place}
    for name in ("observed", "allowed"):
        x = getattr(finding, name)
        row[name] = x if np.isfinite(x) else None
    row |= {name: getattr(finding, name) for name in ("verdict", "evidence", "detail")}
    if finding.proof is not None:
        row["proof"] = asdict(finding.proof) | {"primes": list(finding.proof.primes)}
    optional = {name: getattr(finding, name, None) for name in ("digits", "cause", "follows")}
    return row | {name: x for name, x in optional.items() if x not in (None, "")}


def ratio(observed: float, allowed: float) -> float:
    """Return the ratio observed / allowed; 0 for 0 / 0."""
    if allowed > 0:
        return float(observed) / float(allowed)  # infinite, without a warning, if it overflows
    return 0.0 if observed == 0 else float("inf")


J = TypeVar("J")


def worst(findings: Iterable[J], first: bool = False) -> J:
    """Return the finding that decides for all: a failed one, else one that passed, and so on.

    Entries and states that are not resolved are listed beside it (`never_resolved`).

    Args:
        findings: at least one, each a `Finding` or what has its verdict and ratio.
        first: return the first of that verdict, not the first with the largest ratio.
    """

    def rank(finding: Any) -> tuple[int, float]:
        return VERDICTS.index(finding.verdict), 0.0 if first else -finding.ratio

    return min(findings, key=rank)


def judge(
    observed: float, sensitivity: float, scale: float, unit_roundoff: float = UNIT_ROUNDOFF
) -> tuple[float, Verdict]:
    """Judge an observed error by perturbation analysis.

    Args:
        observed: the error.
        sensitivity: κ · scale of the computation, see `eomcheck.evaluation.tolerance`.
        scale: size of the compared quantity; for a sum that should vanish, of its terms.
        unit_roundoff: u of the numbers of the computation.

    Returns:
        (allowed, verdict): the bound on the rounding error, and the verdict.
    """
    allowed, underflow = allowed_error(sensitivity, unit_roundoff), underflow_error(unit_roundoff)
    if not np.isfinite(scale):
        return allowed, "inconclusive"  # it overflows: nothing to compare with
    if not np.isfinite(observed):
        return allowed, "failed"
    if not np.isfinite(allowed):
        return allowed, "inconclusive"
    if allowed > INCONCLUSIVE * scale and not (observed == 0.0 and allowed <= underflow):
        return allowed, "inconclusive"
    if allowed < observed <= underflow:
        return allowed, "inconclusive"
    return allowed, "passed" if observed <= allowed else "failed"


def verdict_codes(observed: Array, allowed: Array, scale: Array) -> Array:
    """Return the codes (...,) of the verdicts by `judge` on an array of errors (...,)."""
    unresolved = (allowed > INCONCLUSIVE * scale) & ~((observed == 0.0) & (allowed <= UNDERFLOW))
    return np.select(
        [
            ~np.isfinite(scale),
            ~np.isfinite(observed),
            ~np.isfinite(allowed) | unresolved | ((allowed < observed) & (observed <= UNDERFLOW)),
            observed <= allowed,
        ],
        [INCONCLUSIVE_CODE, FAILED_CODE, INCONCLUSIVE_CODE, PASSED_CODE],
        FAILED_CODE,
    )


def format_distinct(x: float, y: float, digits: int = 6) -> tuple[str, str]:
    """Format two numbers with `digits` digits, or as many more as they need to differ."""
    texts = [(f"{x:.{count}g}", f"{y:.{count}g}") for count in range(digits, 18)]
    return next((pair for pair in texts if pair[0] != pair[1]), texts[0])


def worst_of(error: Array) -> tuple[int, ...]:
    """Return the index of the entry with the largest magnitude."""
    at = np.unravel_index(int(np.argmax(np.abs(error))), error.shape)
    return tuple(int(i) for i in at)


# ---- Resolved and hidden entries -----------------------------------------------------------------

LISTED = 8
"""Largest number of entries listed by name; further ones are counted."""

UNRESOLVED = "not resolved in "
"""Prefix of the detail of a finding that lists entries."""

Names = tuple[tuple[str, ...], ...]


class Entries(NamedTuple):
    """Resolved and hidden entries of one compared array, as flags packed into bytes.

    Attributes:
        names: names along each axis.
        resolved: flags of entries shown to be right or wrong, other than by 0 = 0.
        hidden: flags of entries that are neither resolved nor 0 = 0.
    """

    names: Names
    resolved: bytes
    hidden: bytes

    @property
    def count_hidden(self) -> int:
        """Number of hidden entries."""
        return int.from_bytes(self.hidden).bit_count()

    def hides(self, name: str) -> bool:
        """Return whether the entry of this name is hidden."""
        return name in _flagged_names(int.from_bytes(self.hidden), self.names)

    def joined(self, other: Entries) -> Entries:
        """Return the union of the flags of two comparisons with the same names."""
        pairs = zip(self[1:], other[1:], strict=True)
        return Entries(self.names, *(bytes(x | y for x, y in zip(*p, strict=True)) for p in pairs))


def entries_of(names: Names, resolved: Any, hidden: Any) -> Entries:
    """Return the `Entries` of two arrays of bools with the shape of the names."""
    return Entries(names, *(np.packbits(np.ravel(x)).tobytes() for x in (resolved, hidden)))


def entry_name(index: tuple[int, ...], names: Names) -> str:
    """Return the name of one entry: "row θ_3", "entry (x, θ_3)", or "value" without axes."""
    named = [axis[i] for axis, i in zip(names, index, strict=True)]
    if len(named) < 2:
        return f"row {named[0]}" if named else "value"
    return f"entry ({', '.join(named)})"


def merged(entries: Iterable[Entries]) -> list[Entries]:
    """Merge the flags of any number of comparisons into one `Entries` for each set of names."""
    by_names: dict[Names, Entries] = {}
    for flags in entries:
        before = by_names.get(flags.names)
        by_names[flags.names] = flags if before is None else before.joined(flags)
    return [*by_names.values()]


def never_resolved(entries: Iterable[Entries]) -> list[str]:
    """Return the names of entries that are hidden in some state and resolved in none.

    Entries of equal names count as the same entry, also in scenes of different size: row θ_1 of a
    chain of two links is that of a chain of five.
    """
    flags = [(x.names, *map(int.from_bytes, (x.resolved, x.hidden))) for x in merged(entries)]
    if not any(h & ~r for _, r, h in flags):
        return []
    resolved = {name for names, r, _ in flags for name in _flagged_names(r, names)}
    hidden = (name for names, r, h in flags if h & ~r for name in _flagged_names(h, names))
    return [name for name in dict.fromkeys(hidden) if name not in resolved]


def _flagged_names(flags: int, names: Names) -> Iterator[str]:
    """Yield the names of the entries whose bits are set in `flags`."""
    shape = tuple(map(len, names))
    size = int(np.prod(shape))
    packed = np.frombuffer(flags.to_bytes(-(-size // 8)), np.uint8)
    set_bits: Array = np.flatnonzero(np.unpackbits(packed)[:size])
    for k in set_bits:
        yield entry_name(tuple(int(i) for i in np.unravel_index(k, shape)), names)


def unresolved_detail(names: Sequence[str], states: int) -> str:
    """Return the detail of the finding that lists entries resolved in none of so many states."""
    where = f"any of {states} states" if states > 1 else "this state"
    return f"{UNRESOLVED}{where}: {abbreviated_list(names)}"


def abbreviated_list(items: Sequence[str]) -> str:
    """Return a text with the first `LISTED` items, and the number of others."""
    return listed(items, LISTED, separator="; ")


def is_unresolved_detail(detail: str) -> bool:
    """Return whether a detail was made by `unresolved_detail`."""
    return detail.startswith(UNRESOLVED)


class Unresolved(NamedTuple):
    """An entry, or a whole subject, that is compared in some states and resolved in none.

    Attributes:
        subject: the compared formulations, engine or term.
        entry: name of the entry, "" if all of the subject is undecided.
        finding: the finding among these states whose scene has most coordinates.
        states: number of states in which the claim was checked.
    """

    subject: str
    entry: str
    finding: Finding
    states: int

    @property
    def name(self) -> str:
        """The names of the subject and the entry."""
        return f"{self.subject}, {self.entry}" if self.entry else self.subject


def unresolved_by_claim(findings: Iterable[Finding]) -> dict[str, list[Unresolved]]:
    """Return the subjects and entries of each claim that no state resolves.

    These are subjects that are decided in no state, and entries that are hidden in some state and
    resolved in none; an entry that is 0 = 0 in all states has passed.

    Args:
        findings: findings of all states of a run.

    Returns:
        Claim -> its unresolved subjects and entries; claims without any are left out.
    """
    by_claim: dict[str, dict[str, list[Finding]]] = {}
    for finding in findings:
        if finding.verdict != "skipped" and finding.state is not None:
            by_claim.setdefault(finding.claim, {}).setdefault(finding.subject, []).append(finding)
    unresolved: dict[str, list[Unresolved]] = {}
    for claim, subjects in by_claim.items():
        states = max(map(len, subjects.values()))
        for subject, of_subject in subjects.items():
            if all(finding.verdict == "inconclusive" for finding in of_subject):
                about_all = Unresolved(subject, "", of_subject[0], states)
                unresolved.setdefault(claim, []).append(about_all)
                continue
            for name in never_resolved(x.entries for x in of_subject if x.entries is not None):
                where = (x for x in of_subject if x.entries and x.entries.hides(name))
                largest = max(where, key=lambda x: x.scene.n)
                unresolved.setdefault(claim, []).append(Unresolved(subject, name, largest, states))
    return unresolved


def unresolved_finding(
    unresolved: Sequence[Unresolved], shown: Unresolved | None = None, names: Sequence[str] = ()
) -> Finding:
    """Return the inconclusive finding of one claim that lists its unresolved entries.

    Args:
        unresolved: the unresolved subjects and entries.
        shown: the one whose numbers and state are shown, by default the first.
        names: their names, by default those of subject and entry.
    """
    about, shown = list(dict.fromkeys(item.subject for item in unresolved)), shown or unresolved[0]
    return replace(
        shown.finding,
        subject=", ".join(about) if len(about) <= LISTED else "all",
        verdict="inconclusive",
        detail=unresolved_detail(names or [item.name for item in unresolved], shown.states),
        entries=None,
    )
