"""Summary of the findings on each claim, and its tables.

A `ClaimSummary` is a set of findings on one claim: its worst finding, its verdict, its levels of
evidence, and the findings by scene, formulation or engine. Tables show claims by formulation, by
scene and by level of evidence, the certified digits, and the sampled states.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any

from eomcheck.claims import CLAIMS, Claim
from eomcheck.claims.finding import DECIDED, is_unresolved_detail, worst
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.document_text import number_text, ranges
from eomcheck.lab.show.table import Cell, ResultTable
from eomcheck.lab.store.record_file import group
from eomcheck.lab.store.validation_runs import StoredFinding
from eomcheck.safe_output import counted

LEVELS = ("proved", "enclosed", "property-tested", "compared")
"""Levels of evidence, strongest first."""


def participants(row: StoredFinding) -> set[str]:
    """Return the keys of the formulations and engines that a Finding is about."""
    return set(re.findall(r"\w+", row.subject))


def anchor(row: StoredFinding) -> str:
    """Return the HTML id of a Finding's state, or of its structural variant."""
    return "state-" + re.sub(r"\W+", "-", row.location).strip("-")


@dataclass(frozen=True)
class ClaimSummary:
    """Set of Findings on one claim, with their common verdict.

    Attributes:
        rows: the Findings.
    """

    rows: tuple[StoredFinding, ...]

    @property
    def claim(self) -> Claim:
        """The claim; of an unregistered one only the id is known."""
        key = self.rows[0].claim
        return CLAIMS.get(key) or Claim(key, "", "", "", None)

    @cached_property
    def worst(self) -> StoredFinding | None:
        """The worst Finding, see `eomcheck.claims.finding.worst`."""
        return worst(reversed(self.rows)) if self.rows else None  # the last of equals

    @property
    def kind(self) -> str:
        """Verdict as kind of a cell: "failed", "passed", "open" if nothing could be checked, or
        "none".
        """
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
        """Cell of a table: the worst ratio, with a tooltip."""
        if self.worst is None:
            return Cell(self.text, self.kind)
        tooltip = f"{self.worst}; {counted(len(self.rows), 'finding')}{self.undecided}"
        return Cell(self.text, self.kind, hover_text=tooltip)

    @property
    def evidence(self) -> str:
        """Levels of evidence, number of Findings, and number of undecided ones."""
        return f"{', '.join(self.levels)}, {len(self.rows)}{self.undecided}"

    @property
    def states(self) -> int:
        """Number of checked states."""
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
        """Findings whose entries are resolved in no state."""
        return [
            row
            for row in self.rows
            if row.verdict == "inconclusive" and is_unresolved_detail(row.detail)
        ]

    @property
    def links(self) -> str:
        """Numbers of links covered, "" for scenes without links."""
        return ranges(row.links for row in self.rows if row.links is not None)

    @property
    def failed(self) -> list[StoredFinding]:
        """First failure of each subject on each scene."""
        failures = [row for row in self.rows if row.verdict == "failed"]
        return [rows[0] for rows in group(failures, lambda r: (r.subject, r.scene)).values()]

    @property
    def failure_probability(self) -> float | None:
        """Bound on the probability that any of its proofs is wrong, None without proofs."""
        bounds = [row.proof.failure_probability for row in self.rows if row.proof is not None]
        return sum(bounds) if bounds else None

    def by(self, key: Callable[[StoredFinding], Any]) -> dict[Any, ClaimSummary]:
        """Return the Findings grouped by `key`, in order."""
        return {value: ClaimSummary(tuple(rows)) for value, rows in group(self.rows, key).items()}

    def of(self, name: str) -> ClaimSummary:
        """Return the Findings about one formulation or engine."""
        return ClaimSummary(tuple(row for row in self.rows if name in participants(row)))

    @cached_property
    def scenes(self) -> dict[str, ClaimSummary]:
        """Key of a scene -> its Findings."""
        return self.by(lambda row: row.scene)

    @cached_property
    def levels(self) -> dict[str, ClaimSummary]:
        """Level of evidence -> its Findings, strongest first."""
        groups = self.by(lambda row: row.level)
        return {level: groups[level] for level in (*LEVELS, *groups) if level in groups}


def by_claim(rows: Iterable[StoredFinding]) -> list[ClaimSummary]:
    """Return the Findings by claim, in the order of the registry, unregistered claims last."""
    groups = ClaimSummary(tuple(rows)).by(lambda row: row.claim)
    return [groups[key] for key in dict.fromkeys((*CLAIMS, *groups)) if key in groups]


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
    """Return the id of a claim as a link to its evidence."""
    return Cell(judged.claim.id, "name", f"#claim-{judged.claim.id}")


def participant_table(
    claims: Iterable[ClaimSummary], names: Sequence[str], seconds: Mapping[str, float] | None = None
) -> ResultTable:
    """Return the table claims × formulations and engines; a cell is the worst observed / allowed.

    Args:
        claims: the findings by claim.
        names: keys of the formulations and engines.
        seconds: id of a claim -> time to check it, s; None for no such column.
    """
    rows = []
    for c in claims:
        cells = [claim_link(c), c.cell, *(c.of(name).cell for name in names), c.evidence]
        time = [] if seconds is None else [f"{seconds.get(c.claim.id, 0.0):.1f} s"]
        rows.append(cells + time)
    columns = ["claim", "all", *names, "evidence, findings"]
    return ResultTable(
        "claims", "", columns + ([] if seconds is None else ["time"]), rows, note=CELLS
    )


def worst_table(claims: Iterable[ClaimSummary]) -> ResultTable:
    """Return the worst case of each claim: observed / allowed, its subject, and its state."""
    rows = []
    for c in claims:
        worst = c.worst if c.kind in DECIDED and c.text != "0" else None
        subject, on = ("·", "·") if worst is None else (worst.subject, state_label(worst))
        rows.append([claim_link(c), c.cell, subject, on, f"{len(c.rows)}{c.undecided}"])
    columns = ["claim", "worst", "by", "on", "findings"]
    return ResultTable("worst", "", columns, rows, note=WORST)


def state_label(row: StoredFinding) -> str:
    """Return the short label of a Finding's state: scene[links] #state."""
    links = "" if row.links is None else f"[{row.links}]"
    return f"{row.scene}{links}" + ("" if row.case is None else f" #{row.case}")


def scene_table(claims: Iterable[ClaimSummary], scenes: Iterable[str]) -> ResultTable:
    """Return the table claims × scenes with statements; a cell is the worst observed / allowed."""
    scenes = list(scenes)
    rows = []
    for c in claims:
        cells = (c.scenes.get(scene, ClaimSummary(())).cell for scene in scenes)
        rows.append([claim_link(c), c.claim.statement, ", ".join(c.levels), *cells])
    return ResultTable("claims", "", ["claim", "statement", "evidence", *scenes], rows, note=CELLS)


# ---- Tables of states ----------------------------------------------------------------------------


def digits_table(rows: Iterable[StoredFinding]) -> ResultTable:
    """Return the certified digits of v̇ of each formulation on each scene: fewest and median."""
    certified = group([row for row in rows if row.digits is not None], lambda row: row.subject)
    scenes = list(dict.fromkeys(row.scene for r in certified.values() for row in r))
    table = []
    for key in (key for key in FORMULATIONS if key in certified):
        on = group(certified[key], lambda row: row.scene)
        cells = (_digits([row.digits or 0.0 for row in on.get(scene, [])]) for scene in scenes)
        table.append((key, str(len(certified[key])), *cells))
    title = "Decimal digits of q̈ in doubles that are right, against its true value: fewest (median)"
    return ResultTable("digits", title, ("formulation", "states solved", *scenes), table)


def _digits(digits: list[float]) -> str:
    return f"{min(digits):.1f} ({median(digits):.1f})" if digits else "·"


def factor_table(counts: Mapping[str, Mapping[str, Mapping[str, int]]]) -> ResultTable:
    """Return the table of sampled states by factor of the pairwise design.

    Args:
        counts: key of a scene class -> name of a factor -> level -> number of states.
    """
    rows = [
        (scene, name, ", ".join(_ways(ways)))
        for scene, f in counts.items()
        for name, ways in f.items()
    ]
    return ResultTable("strata", "Drawn states by factor", ("scene", "factor", "states"), rows)


def _ways(ways: Mapping[str, int]) -> Iterator[str]:
    """Yield each level of a factor with its number of states in brackets, the first with the
    noun.
    """
    for i, (way, states) in enumerate(ways.items()):
        yield f"{way} ({states if i else counted(states, 'state')})"


# ---- Evidence of one claim -----------------------------------------------------------------------


def evidence_table(judged: ClaimSummary) -> ResultTable:
    """Return the evidence of a claim: scenes × levels of evidence."""
    groups = judged.by(lambda row: (row.scene, row.level))
    levels = dict.fromkeys((*LEVELS, *judged.levels))
    columns = ["scene", "evidence", "N", "states", "findings", "inconclusive", "skipped"]
    rows = [
        [scene, level, *_evidence(groups[scene, level])]
        for scene in judged.scenes
        for level in levels
        if (scene, level) in groups
    ]
    sheet = ResultTable("", "", [*columns, "ratio", "observed", "allowed", "where"], rows)
    return sheet if judged.skipped else sheet.without("skipped")


def _evidence(summary: ClaimSummary) -> list[str]:
    worst, sure = summary.worst, summary.failure_probability
    assert worst is not None
    cells = [summary.links, str(summary.states or "all"), str(len(summary.rows))]
    cells += [str(count or "") for count in (summary.inconclusive, len(summary.skipped))]
    if sure is not None:
        bound = number_text(sure)
        proofs = f"{counted(len(summary.rows), 'identity')}, wrong with a probability below {bound}"
        return [*cells, "", "", "", Cell(proofs, link=f"#{anchor(worst)}")]
    where = (
        f"{worst.subject}, {f'state {worst.case}' if worst.case is not None else worst.location}"
    )
    link = Cell(where if worst.ratio else "", link=f"#{anchor(worst)}")
    return [*cells, summary.cell, number_text(worst.observed), number_text(worst.allowed), link]
