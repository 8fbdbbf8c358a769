"""Summary of the findings on each claim, and the tables made of it.

`ClaimSummary` is a set of findings on one claim: its worst finding, its verdict, its levels of
evidence, and the findings by scene, formulation or engine. Tables show claims by formulation, by
scene and by level of evidence, the certified digits, and the states drawn.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any

from eomcheck.claims import CLAIMS, Claim
from eomcheck.claims.finding import DECIDED, is_unresolved_detail
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.document_text import number_text, ranges
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import group
from eomcheck.lab.store.stored_findings import StoredFinding
from eomcheck.safe_output import counted

LEVELS = ("proved", "enclosed", "property-tested", "compared")
"""Levels of evidence, strongest first."""


def participants(row: StoredFinding) -> set[str]:
    """Return the formulations and engines that a Finding is about."""
    return set(re.findall(r"\w+", row.subject))


def anchor(row: StoredFinding) -> str:
    """Return the id of the state, or the structure, of a Finding in the page."""
    return "state-" + re.sub(r"\W+", "-", row.location).strip("-")


@dataclass(frozen=True)
class ClaimSummary:
    """Findings, all of one claim, and what they come to together.

    Attributes:
        rows: the Findings.
    """

    rows: tuple[StoredFinding, ...]

    @property
    def claim(self) -> Claim:
        """The claim; of one that is not registered only its id is known."""
        key = self.rows[0].claim
        return CLAIMS.get(key) or Claim(key, "", "", "", None)

    @cached_property
    def worst(self) -> StoredFinding | None:
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
        return Cell(self.text, self.kind, hover_text=said)

    @property
    def evidence(self) -> str:
        """Levels of evidence, number of Findings, and how many of them say nothing."""
        return f"{', '.join(self.levels)}, {len(self.rows)}{self.undecided}"

    @property
    def states(self) -> int:
        """Number of states looked at."""
        return len({(row.scene, row.case) for row in self.rows if row.case is not None})

    @property
    def undecided_count(self) -> int:
        """Number of undecided Findings: inconclusive or skipped."""
        return sum(row.verdict not in DECIDED for row in self.rows)

    @property
    def inconclusive(self) -> int:
        """Number of inconclusive Findings."""
        return self.undecided_count - len(self.skipped)

    @property
    def undecided(self) -> str:
        """Counts of undecided Findings: ", 3 inconclusive, 1 skipped", or ""."""
        counts = {"inconclusive": self.inconclusive, "skipped": len(self.skipped)}
        return "".join(f", {count} {verdict}" for verdict, count in counts.items() if count)

    @property
    def skipped(self) -> list[StoredFinding]:
        """Skipped Findings."""
        return [row for row in self.rows if row.verdict == "skipped"]

    @property
    def unresolved(self) -> list[StoredFinding]:
        """Findings that list entries which no state resolves."""
        return [
            row
            for row in self.rows
            if row.verdict == "inconclusive" and is_unresolved_detail(row.detail)
        ]

    @property
    def links(self) -> str:
        """The numbers of links covered, "" for scenes that have none."""
        return ranges(row.links for row in self.rows if row.links is not None)

    @property
    def failed(self) -> list[StoredFinding]:
        """The first failure of each subject on each scene."""
        failures = [row for row in self.rows if row.verdict == "failed"]
        return [rows[0] for rows in group(failures, lambda r: (r.subject, r.scene)).values()]

    @property
    def failure_probability(self) -> float | None:
        """Bound on the probability that any of its proofs is a mistake, None without proofs."""
        found = [row.proof.failure_probability for row in self.rows if row.proof is not None]
        return sum(found) if found else None

    def by(self, key: Callable[[StoredFinding], Any]) -> dict[Any, ClaimSummary]:
        """Return those that are alike in `key`, in order."""
        return {value: ClaimSummary(tuple(rows)) for value, rows in group(self.rows, key).items()}

    def of(self, name: str) -> ClaimSummary:
        """Return those about one formulation or engine."""
        return ClaimSummary(tuple(row for row in self.rows if name in participants(row)))

    @cached_property
    def scenes(self) -> dict[str, ClaimSummary]:
        """Key of a scene -> those on it."""
        return self.by(lambda row: row.scene)

    @cached_property
    def levels(self) -> dict[str, ClaimSummary]:
        """Level of evidence -> those of that level, strongest first."""
        found = self.by(lambda row: row.level)
        return {level: found[level] for level in (*LEVELS, *found) if level in found}


def by_claim(rows: Iterable[StoredFinding]) -> list[ClaimSummary]:
    """Return the Findings by claim, in the order of the registry, those not in it last."""
    found = ClaimSummary(tuple(rows)).by(lambda row: row.claim)
    return [found[key] for key in dict.fromkeys((*CLAIMS, *found)) if key in found]


# ---- Tables of claims ----------------------------------------------------------------------------

CELLS = (
    "Cells: largest error observed, in percent of the error allowed (?: nothing could be "
    "checked, ·: not concerned)."
)
WORST = (
    "worst: largest error observed, in percent of the error allowed (?: nothing could be checked), "
    "by whom and in which state (scene[links] #state); inconclusive: rounding explains any "
    "difference. --wide tells formulations, engines and scenes apart."
)


def claim_link(judged: ClaimSummary) -> Cell:
    """Return the id of a claim, which leads to what it rests on."""
    return Cell(judged.claim.id, "name", f"#claim-{judged.claim.id}")


def participant_table(
    claims: Iterable[ClaimSummary], names: Sequence[str], seconds: Mapping[str, float] | None = None
) -> ResultTable:
    """Return claims × formulations and engines; a cell is the worst observed / allowed.

    Args:
        claims: what was found.
        names: keys of the formulations and engines.
        seconds: id of a claim -> what looking at it took, if that is to be told.
    """
    rows = []
    for one in claims:
        cells = [claim_link(one), one.cell, *(one.of(name).cell for name in names), one.evidence]
        time = [] if seconds is None else [f"{seconds.get(one.claim.id, 0.0):.1f} s"]
        rows.append(cells + time)
    columns = ["claim", "all", *names, "evidence, findings"]
    return ResultTable(
        "claims", "", columns + ([] if seconds is None else ["time"]), rows, note=CELLS
    )


def worst_table(claims: Iterable[ClaimSummary]) -> ResultTable:
    """Return what is worst of each claim: observed / allowed, by whom, and where."""
    rows = []
    for one in claims:
        worst = one.worst if one.kind in DECIDED and one.text != "0" else None
        by, on = ("·", "·") if worst is None else (worst.subject, state_label(worst))
        rows.append([claim_link(one), one.cell, by, on, f"{len(one.rows)}{one.undecided}"])
    columns = ["claim", "worst", "by", "on", "findings"]
    return ResultTable("worst", "", columns, rows, note=WORST)


def state_label(row: StoredFinding) -> str:
    """Return the scene and the number of the state of a Finding, in short."""
    links = "" if row.links is None else f"[{row.links}]"
    return f"{row.scene}{links}" + ("" if row.case is None else f" #{row.case}")


def scene_table(claims: Iterable[ClaimSummary], scenes: Iterable[str]) -> ResultTable:
    """Return claims × scenes, with what a claim says; a cell is the worst observed / allowed."""
    scenes = list(scenes)
    rows = []
    for one in claims:
        cells = (one.scenes.get(scene, ClaimSummary(())).cell for scene in scenes)
        rows.append([claim_link(one), one.claim.statement, ", ".join(one.levels), *cells])
    return ResultTable("claims", "", ["claim", "statement", "evidence", *scenes], rows, note=CELLS)


# ---- Tables of states ----------------------------------------------------------------------------


def digits_table(rows: Iterable[StoredFinding]) -> ResultTable:
    """Return the certified digits of v̇ of each formulation on each scene: fewest and median."""
    certified = group([row for row in rows if row.digits is not None], lambda row: row.subject)
    scenes = list(dict.fromkeys(row.scene for found in certified.values() for row in found))
    made = []
    for key in (key for key in FORMULATIONS if key in certified):
        on = group(certified[key], lambda row: row.scene)
        cells = (_digits([row.digits or 0.0 for row in on.get(scene, [])]) for scene in scenes)
        made.append((key, str(len(certified[key])), *cells))
    title = "Decimal digits of q̈ in doubles that are right, against its true value: fewest (median)"
    return ResultTable("digits", title, ("formulation", "states solved", *scenes), made)


def _digits(digits: list[float]) -> str:
    return f"{min(digits):.1f} ({median(digits):.1f})" if digits else "·"


def factor_table(strata: Mapping[str, Mapping[str, Mapping[str, int]]]) -> ResultTable:
    """Return the strata that were drawn from.

    Args:
        strata: key of a kind of scene -> name of a stratum -> way -> number of states.
    """
    rows = [
        (scene, name, ", ".join(_ways(ways)))
        for scene, of in strata.items()
        for name, ways in of.items()
    ]
    return ResultTable("strata", "Drawn states by stratum", ("scene", "stratum", "states"), rows)


def _ways(ways: Mapping[str, int]) -> Iterator[str]:
    """Yield each way with its states in brackets, the first time with the word for them."""
    for i, (way, states) in enumerate(ways.items()):
        yield f"{way} ({states if i else counted(states, 'state')})"


# ---- Evidence of one claim -----------------------------------------------------------------------


def evidence_table(judged: ClaimSummary) -> ResultTable:
    """Return what a claim rests on: scenes × levels of evidence."""
    found = judged.by(lambda row: (row.scene, row.level))
    levels = dict.fromkeys((*LEVELS, *judged.levels))
    columns = ["scene", "evidence", "N", "states", "findings", "inconclusive", "skipped"]
    rows = [
        [scene, level, *_evidence(found[scene, level])]
        for scene in judged.scenes
        for level in levels
        if (scene, level) in found
    ]
    sheet = ResultTable("", "", [*columns, "ratio", "observed", "allowed", "where"], rows)
    return sheet if judged.skipped else sheet.without("skipped")


def _evidence(one: ClaimSummary) -> list[str]:
    worst, sure = one.worst, one.failure_probability
    assert worst is not None
    cells = [one.links, str(one.states or "all"), str(len(one.rows))]
    cells += [str(count or "") for count in (one.inconclusive, len(one.skipped))]
    if sure is not None:
        bound = number_text(sure)
        told = f"{counted(len(one.rows), 'identity')}, wrong with a probability below {bound}"
        return [*cells, "", "", "", Cell(told, link=f"#{anchor(worst)}")]
    where = (
        f"{worst.subject}, {f'state {worst.case}' if worst.case is not None else worst.location}"
    )
    link = Cell(where if worst.ratio else "", link=f"#{anchor(worst)}")
    return [*cells, one.cell, number_text(worst.observed), number_text(worst.allowed), link]
