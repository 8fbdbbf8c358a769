"""Overview of the Records in some files: verdict, findings by claim, and sections of studies.

The content of a report is decided once, in this module; HTML, Markdown and JUnit only lay it out. A
section is present only if there is data for it. `record_table` is the plain table of Records.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeVar

from eomcheck.claims.finding import DECIDED
from eomcheck.engines import ENGINES
from eomcheck.errors import EomcheckError, InputError, described_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.report.claim_summary import (
    ClaimSummary,
    by_claim,
    digits_table,
    factor_table,
    participants,
)
from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Records, key_of
from eomcheck.lab.store.validation_runs import PROOFS, RUNS, stored_findings_in, why_unreadable
from eomcheck.lab.studies import STUDIES, study_of
from eomcheck.safe_output import counted
from eomcheck.scenes import SCENES

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

    def __init__(self, records: Sequence[Record], unread: Sequence[str] = ()):
        faults = [(r, why_unreadable(r)) for r in records]
        self.records = [r for r, fault in faults if fault is None]
        self.rows = stored_findings_in(self.records)
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
    def headline(self) -> str:
        """The verdict as a sentence."""
        if self.verdict == "nothing checked":
            return "No claim was checked."
        out_of = f"of {counted(len(self.claims), 'claim')}"
        if self.verdict == "failed":
            first = ", ".join(judged.claim.id for judged in self.failed)
            fails = "fails" if len(self.failed) == 1 else "fail"
            return f"{len(self.failed)} {out_of} {fails}: {first}."
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


# ---- Sections ------------------------------------------------------------------------------------

T = TypeVar("T")
WRONG = AttributeError, TypeError, ValueError


class Section(NamedTuple):
    """Section of a report.

    Attributes:
        id: its anchor.
        title: its heading.
        text: its content, and how to read it.
        tables: its tables.
        charts: function that makes its charts, which only HTML shows.
    """

    id: str
    title: str
    text: str
    tables: Sequence[ResultTable]
    charts: Callable[[], Sequence[Chart]] = tuple


def sections_of(overview: Overview) -> list[Section]:
    """Return the sections with data."""
    drawn = [s for s in (_digits(overview), _strata(overview)) if s.tables[0].rows]
    studies = (_study_section(key, overview) for key in STUDIES if overview.of(key))
    return [*drawn, *(s for s in studies if s is not None)]


def _study_section(key: str, overview: Overview) -> Section | None:
    """Return the section of a study, None if its Records cannot be shown."""
    study = study_of(key)
    records = study.of(overview.records)

    def read(derive: Callable[[Sequence[Record]], Iterable[T]]) -> list[T] | None:
        # Records of another version may have formulations, scenes or fields that this one lacks.
        try:
            return list(derive(records))
        except (EomcheckError, ArithmeticError, LookupError, *WRONG) as error:
            why = described_error(error)
            overview.unread.append(f"the records of {key!r} cannot be shown: {why}")
            return None

    remarks, sheets = read(study.remarks), read(study.tables)
    if remarks is None or sheets is None:
        return None
    text = " ".join((STUDIES[key], study.reading, *remarks))
    tables = [sheet for sheet in sheets if sheet.rows and not sheet.detail]
    return Section(key, key.capitalize(), text, tables, lambda: read(study.charts) or [])


def _digits(overview: Overview) -> Section:
    """Return the section of certified digits by formulation and scene."""
    # An acceleration that is nothing but rounding error has no correct digits.
    sheet = digits_table(row for row in overview.rows if row.verdict in DECIDED)
    return Section(
        "digits",
        "Certified digits",
        "Decimal digits of q̈ in doubles that are certainly right, against the true value in ball "
        "arithmetic: the worst state, and in brackets the median. States whose acceleration is no "
        "larger than its rounding error are left out.",
        [sheet],
    )


def _strata(overview: Overview) -> Section:
    """Return the section of states by factor of the pairwise design and by scene."""
    strata: dict[str, dict[str, dict[str, int]]] = {}
    for run in overview.runs:
        names = ("strata", "ways", "states in them")
        for name, way, states in zip(*(run.series.get(x, ()) for x in names), strict=True):
            factors = strata.setdefault(run.settings["scene"], {})
            factors.setdefault(name, {})[way] = states
    return Section(
        "strata",
        "States drawn",
        "How many of the states drawn at random are of which kind. Every pair of kinds is drawn at "
        "least once where there are draws enough; a scene class with no state was not checked.",
        [factor_table(strata)],
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
