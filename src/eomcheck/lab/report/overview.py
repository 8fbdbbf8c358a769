"""Overview of the Records in some files: the verdict, findings by claim, and their tables.

A `ClaimSummary` is a set of findings on one claim: its worst finding, its verdict, its levels of
evidence, and the findings by scene, formulation or engine. Tables show claims by formulation, by
scene and by level of evidence, the certified digits, and the sampled states. `record_table` is the
plain table of Records.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import Any, Literal

from eomcheck.claims import CLAIMS, Claim
from eomcheck.claims.finding import DECIDED, is_unresolved_detail, worst
from eomcheck.engines import ENGINES
from eomcheck.errors import InputError, distinct, registered
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.show.table import Cell, ResultTable, number_text, ranges
from eomcheck.lab.store.record_file import Record, Records, group, key_of
from eomcheck.lab.store.validation_runs import (
    PROOFS,
    RUNS,
    StoredFinding,
    stored_findings_in,
    why_unreadable,
)
from eomcheck.safe_output import counted
from eomcheck.scenes import SCENES

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
    claims, rows = list(claims), []
    for c in claims:
        worst = c.worst if c.kind in DECIDED and c.text != "0" else None
        subject, on = ("·", "·") if worst is None else (worst.subject, state_label(worst))
        rows.append([claim_link(c), c.cell, subject, on, f"{len(c.rows)}{c.undecided}"])
    columns = ["claim", "worst", "by", "on", "findings"]
    return ResultTable("worst", "", columns, rows, note=WORST + _sampled_note(claims))


def _sampled_note(claims: Sequence[ClaimSummary]) -> str:
    """Return the sentence about claims that are checked in some states of a run only, or ""."""
    ids: dict[int, list[str]] = {}
    for one in (x.claim for x in claims):
        ids.setdefault(one.every, []).append(one.id)
    ids.pop(1, None)
    return "".join(
        f" In one state of {every}, unless --claim or --engine names them: {', '.join(among)}."
        for every, among in sorted(ids.items())
    )


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


# ---- Overview ------------------------------------------------------------------------------------

Verdict = Literal["failed", "not finished", "passed", "nothing checked"]


def read_records(paths: Iterable[Path], unread: list[str] | None = None) -> list[Record]:
    """Return the Records of all files; of a cell that is in several, the last one.

    Args:
        paths: the files.
        unread: list to append unreadable content of a damaged file to, as for `Records`.

    Raises:
        InputError: a file is missing, is not one of Records, or all of them are empty.
    """
    paths = list(paths)
    by_cell: dict[tuple[str, str], Record] = {}
    for path in paths:
        with Records(path, readonly=True, unread=unread) as records:
            by_cell |= {(r.study, key_of(r.settings)): r for r in records.all()}
    if not by_cell:
        why = f": {unread[0]}" if unread else ""
        raise InputError(f"no records in {', '.join(repr(str(path)) for path in paths)}{why}")
    return list(by_cell.values())


def _rows_about(rows: Sequence[StoredFinding], claims: Sequence[str]) -> list[StoredFinding]:
    """Return the Findings about some claims, of which at least one has any."""
    known = dict.fromkeys((*CLAIMS, *(row.claim for row in rows)))
    ids = [registered("claim", claim, {x: x for x in known}) for claim in claims]
    chosen = [row for row in rows if row.claim in ids]
    if not chosen:
        raise InputError(f"no finding about any of {', '.join(ids)} in the records")
    return chosen


def _registry_order(scenes: Iterable[str]) -> list[str]:
    """Return keys of scenes in the order of the registry, then unregistered ones."""
    order = {key: index for index, key in enumerate(SCENES)}
    return sorted(scenes, key=lambda key: order.get(key, len(order)))


class Overview:
    """Records of a report with their verdict.

    Attributes:
        records: all readable Records.
        rows: the Findings in them.
        unread: descriptions of unreadable content, a sentence each; sections add to it.
    """

    def __init__(
        self,
        records: Sequence[Record],
        unread: Sequence[str] = (),
        claims: Iterable[str] | None = None,
    ):
        """Collect the Findings of Records.

        Args:
            records: the Records.
            unread: descriptions of unreadable content.
            claims: ids of the claims to report, by default all.

        Raises:
            InputError: there is no Finding about any of the claims.
            UnknownNameError: no such claim, neither now nor in the Records.
        """
        faults = [(r, why_unreadable(r)) for r in records]
        self.records = [r for r, fault in faults if fault is None]
        self.rows = stored_findings_in(self.records)
        if claims is not None:
            self.rows = _rows_about(self.rows, distinct("claims", claims))
        self.unread = [
            *unread,
            *(f"a record of {r.study!r} cannot be read: {why}" for r, why in faults if why),
        ]

    def of(self, study: str) -> list[Record]:
        """Return the Records of one study."""
        return [record for record in self.records if record.study == study]

    @cached_property
    def runs(self) -> list[Record]:
        """Validation runs, one per scene class, in the order of the registry."""
        runs = {r.settings["scene"]: r for r in self.of(RUNS)}
        return [runs[scene] for scene in _registry_order(runs)]

    @cached_property
    def claims(self) -> list[ClaimSummary]:
        """Every claim with Findings, in the order of the registry."""
        return by_claim(self.rows)

    @cached_property
    def columns(self) -> list[str]:
        """Keys of the formulations and engines that took part."""
        present = {name for row in self.rows for name in participants(row)}
        own = (key for run in self.runs for key in run.series["engines"])
        return [key for key in dict.fromkeys((*FORMULATIONS, *ENGINES, *own)) if key in present]

    @cached_property
    def scenes(self) -> list[str]:
        """Keys of the checked scene classes, in the order of the registry."""
        return _registry_order(dict.fromkeys(row.scene for row in self.rows))

    @property
    def states(self) -> int:
        """Number of checked states."""
        return sum(run.counts.get("states", 0) for run in self.runs)

    @property
    def structures(self) -> int:
        """Number of structural variants on which identities were proved."""
        return len(self.of(PROOFS))

    @property
    def undecided(self) -> str:
        """Counts of undecided Findings: "3 inconclusive, 1 skipped", or ""."""
        return ClaimSummary(tuple(self.rows)).undecided.removeprefix(", ")

    @cached_property
    def failed(self) -> list[ClaimSummary]:
        """Claims that fail on some scene."""
        return [judged for judged in self.claims if judged.kind == "failed"]

    @property
    def verdict(self) -> Verdict:
        """Verdict over all claims and runs."""
        if self.failed:
            return "failed"
        if any(run.status != "done" for run in self.runs):
            return "not finished"
        return "passed" if any(row.verdict == "passed" for row in self.rows) else "nothing checked"

    @property
    def mark(self) -> str:
        """The verdict as class of the headline of a page: "partly" if it is passed but a claim, or
        an entry of one in every state, is undecided.
        """
        undecided = any(one.kind != "passed" or one.unresolved for one in self.claims)
        partly = self.verdict == "passed" and undecided
        return "partly" if partly else self.verdict.replace(" ", "-")

    @property
    def headline(self) -> str:
        """The verdict as a sentence."""
        if self.verdict == "nothing checked":
            return "No claim was checked."
        out_of = f"of {counted(len(self.claims), 'claim')}"
        if self.verdict == "failed":
            first = ", ".join(judged.claim.id for judged in self.failed)
            fails = "fails" if len(self.failed) == 1 else "fail"
            undecided = sum(judged.kind == "open" for judged in self.claims)
            others = f"; {undecided} undecided" if undecided else ""
            return f"{len(self.failed)} {out_of} {fails}: {first}{others}."
        if self.verdict == "not finished" and not self.claims:
            return "The run did not come to its end; no claim was checked."
        if self.verdict == "not finished":
            return f"The run did not come to its end; until then none {out_of} failed."
        checked = [judged for judged in self.claims if judged.kind == "passed"]
        if len(checked) < len(self.claims):
            return f"{len(checked)} {out_of} hold; on the others nothing could be checked."
        hidden = [judged.claim.id for judged in self.claims if judged.unresolved]
        if hidden:
            entries = f"entries of {', '.join(hidden)} are resolved in no state"
            return f"All {counted(len(checked), 'claim')} hold where resolved; {entries}."
        return f"All {counted(len(checked), 'claim')} hold."

    @property
    def basis(self) -> str:
        """Numbers on which the verdict rests, as a sentence."""
        parts = [counted(len(self.rows), "finding")]
        if self.states:
            parts.append(counted(self.states, "state"))
        if self.structures:
            parts.append(f"{counted(self.structures, 'structure')} proved")
        text = f"{', '.join(parts)}, on {', '.join(self.scenes)}"
        return f"{text}; {self.undecided}." if self.undecided else f"{text}."

    @property
    def engines(self) -> list[str]:
        """Names and versions of the engines compared with."""
        versions = (x for run in self.runs for x in run.series.get("engine versions", ()))
        return list(dict.fromkeys(versions))

    @property
    def provenance(self) -> list[str]:
        """Origins of the Records (date, sources, machine), each once."""
        return list(dict.fromkeys(map(origin_of, sorted(self.records, key=lambda r: r.when))))


def origin_of(record: Record) -> str:
    """Return the origin of a Record: day, version, commit or digest, machine."""
    versions, machine = record.versions, record.machine
    source = versions.get("commit") or f"sources {versions.get('sources', 'unknown')}"
    return (
        f"{record.when[:10]}, eomcheck {versions.get('eomcheck', '?')} ({source}), "
        f"{machine.get('cpu', '?')} ({machine.get('cores', '?')} cores), "
        f"Python {machine.get('python', '?')}"
    )


# ---- Records, one line each ----------------------------------------------------------------------

GROUPS = ("settings", "counts", "errors", "series", "machine", "versions")
"""Fields of Record that are dictionaries: one column per entry, such as `errors.energy`."""


def _flat(record: Record) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for name in (field.name for field in fields(Record)):
        value = getattr(record, name)
        if name in GROUPS:
            row |= {f"{name}.{entry}": value[entry] for entry in sorted(value)}
        elif name == "quartiles":
            row["quartiles.low"], row["quartiles.high"] = value or (None, None)
        else:
            row[name] = value
    return row


def record_columns(records: Sequence[Record]) -> list[str]:
    """Return the column names of a table, in the order of Record's fields, entries sorted in
    each.
    """
    order = [field.name for field in fields(Record)]
    names = dict.fromkeys(name for record in records for name in _flat(record))

    def rank(name: str) -> tuple[int, str]:
        group, _, entry = name.partition(".")
        return order.index(group), "" if group == "quartiles" else entry

    return sorted(names, key=rank)


def _plain(value: Any) -> str:
    match value:
        case None:
            return ""
        case str():
            return value
        case float():
            return repr(value)  # the shortest text that parses to the same float64
        case _:
            return json.dumps(value, ensure_ascii=False)


def record_table(records: Sequence[Record]) -> ResultTable:
    """Return a table with one line per Record; missing entries are empty."""
    names = record_columns(records)
    rows = [[_plain(row.get(name)) for name in names] for row in map(_flat, records)]
    return ResultTable("records", "", names, rows)
