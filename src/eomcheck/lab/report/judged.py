"""What Findings come to: those on a claim, on a scene, of a level of evidence, about a party."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from eomcheck.claims import CLAIMS, Claim
from eomcheck.claims.finding import DECIDED, lists
from eomcheck.lab.show.document_text import ranges
from eomcheck.lab.show.table import Cell
from eomcheck.lab.store.groups import group
from eomcheck.lab.store.kept import Kept
from eomcheck.safe_output import counted

LEVELS = ("proved", "enclosed", "property-tested", "compared")
"""Levels of evidence, strongest first."""


def parties(row: Kept) -> set[str]:
    """Return the formulations and engines that a Finding is about."""
    return set(re.findall(r"\w+", row.subject))


def anchor(row: Kept) -> str:
    """Return the id of the state, or the structure, of a Finding in the page."""
    return "state-" + re.sub(r"\W+", "-", row.place).strip("-")


@dataclass(frozen=True)
class Judged:
    """Findings, all of one claim, and what they come to together.

    Attributes:
        rows: the Findings.
    """

    rows: tuple[Kept, ...]

    @property
    def claim(self) -> Claim:
        """The claim; of one that is not registered only its id is known."""
        key = self.rows[0].claim
        return CLAIMS.get(key) or Claim(key, "", "", "", None)

    @cached_property
    def worst(self) -> Kept | None:
        """A failed Finding, else the one with the largest observed / allowed that counts."""
        rank = {"failed": 2, "passed": 1}
        # The last of equals.
        ranked = reversed(self.rows)
        return max(ranked, key=lambda row: (rank.get(row.verdict, 0), row.ratio), default=None)

    @property
    def kind(self) -> str:
        """ "failed", "passed", "open" where nothing could be checked, or "none"."""
        verdict = self.worst.verdict if self.worst else "none"
        return verdict if verdict in DECIDED or verdict == "none" else "open"

    @property
    def text(self) -> str:
        """The largest observed / allowed, in whole percent."""
        if self.worst is None or self.kind != "passed":
            return {"none": "·", "failed": "FAIL"}.get(self.kind, "?")
        ratio = self.worst.ratio
        return "0" if ratio == 0 else "<1%" if ratio < 0.01 else f"{100 * ratio:.0f}%"

    @property
    def cell(self) -> Cell:
        """What a table shows of them."""
        if self.worst is None:
            return Cell(self.text, self.kind)
        said = f"{self.worst}; {counted(len(self.rows), 'finding')}{self.undecided}"
        return Cell(self.text, self.kind, said=said)

    @property
    def evidence(self) -> str:
        """Levels of evidence, number of Findings, and how many of them say nothing."""
        return f"{', '.join(self.levels)}, {len(self.rows)}{self.undecided}"

    @property
    def states(self) -> int:
        """Number of states looked at."""
        return len({(row.scene, row.case) for row in self.rows if row.case is not None})

    @property
    def open(self) -> int:
        """Number of Findings that say nothing: inconclusive, or not looked at."""
        return sum(row.verdict not in DECIDED for row in self.rows)

    @property
    def inconclusive(self) -> int:
        """Number of inconclusive Findings."""
        return self.open - len(self.unseen)

    @property
    def undecided(self) -> str:
        """Counts of Findings that decide nothing: ", 3 inconclusive, 1 not looked at", or ""."""
        counts = {"inconclusive": self.inconclusive, "not looked at": len(self.unseen)}
        return "".join(f", {count} {verdict}" for verdict, count in counts.items() if count)

    @property
    def unseen(self) -> list[Kept]:
        """Those not looked at."""
        return [row for row in self.rows if row.verdict == "not looked at"]

    @property
    def unresolved(self) -> list[Kept]:
        """Findings that list entries which no state resolves."""
        return [row for row in self.rows if row.verdict == "inconclusive" and lists(row.detail)]

    @property
    def links(self) -> str:
        """The numbers of links covered, "" for scenes that have none."""
        return ranges(row.links for row in self.rows if row.links is not None)

    @property
    def failed(self) -> list[Kept]:
        """The first failure of each subject on each scene."""
        failures = [row for row in self.rows if row.verdict == "failed"]
        return [rows[0] for rows in group(failures, lambda r: (r.subject, r.scene)).values()]

    @property
    def failure_probability(self) -> float | None:
        """Bound on the probability that any of its proofs is a mistake, None without proofs."""
        found = [row.proof.failure_probability for row in self.rows if row.proof is not None]
        return sum(found) if found else None

    def by(self, key: Callable[[Kept], Any]) -> dict[Any, Judged]:
        """Return those that are alike in `key`, in order."""
        return {value: Judged(tuple(rows)) for value, rows in group(self.rows, key).items()}

    def of(self, name: str) -> Judged:
        """Return those about one formulation or engine."""
        return Judged(tuple(row for row in self.rows if name in parties(row)))

    @cached_property
    def scenes(self) -> dict[str, Judged]:
        """Key of a scene -> those on it."""
        return self.by(lambda row: row.scene)

    @cached_property
    def levels(self) -> dict[str, Judged]:
        """Level of evidence -> those of that level, strongest first."""
        found = self.by(lambda row: row.level)
        return {level: found[level] for level in (*LEVELS, *found) if level in found}


def by_claim(rows: Iterable[Kept]) -> list[Judged]:
    """Return the Findings by claim, in the order of the registry, those not in it last."""
    found = Judged(tuple(rows)).by(lambda row: row.claim)
    return [found[key] for key in dict.fromkeys((*CLAIMS, *found)) if key in found]
