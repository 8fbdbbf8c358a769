"""Study: settings to vary, a worker for one cell, and tables and charts of the Records.

Each combination of settings is a cell, worked off once into a Record that is stored at once, so
that an interrupted study goes on where it stopped. Tables and charts are made from Records and
compute nothing. The command of a study, its section of the report and its line in the documentation
follow from its one line in `eomcheck.lab.studies.STUDIES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

from eomcheck.atomic_write import write_text
from eomcheck.console import progress
from eomcheck.deprecated import old_keywords
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.executors import check_executor
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records, Settings, group, key_of, rows_in

# ---- Cells ---------------------------------------------------------------------------------------


@old_keywords
def run_cells(
    records: Records,
    study: str,
    cells: Iterable[Settings],
    work: Callable[[Settings], Record],
    *,
    fresh: bool = False,
    label: str | None = None,
    executor: str | None = None,
    by: Sequence[str] = (),
) -> list[Record]:
    """Work off the cells of a study that are not in `records` yet; return the Records of all.

    Each is committed as it finishes: after Ctrl-C, an error or `kill -9` the same call goes on with
    the cell that was in flight.

    Args:
        records: where they are kept.
        study: its name.
        cells: settings, one per cell; one named twice is worked once.
        work: settings -> Record of this study and these settings. An exception of eomcheck's own
            becomes a Record: "refused" for a `RefusedError`, otherwise "failed".
        fresh: forget what is known of these cells first.
        label: of `progress`, by default the name of the study; "" for none.
        executor: where untimed cells are worked off, see
            `eomcheck.lab.store.parallel_map.parallel_map`;
            None: one after another, in this process.
        by: names of settings. Cells that share them go to one process together, in their order.
    """
    wanted = {key_of(settings): settings for settings in cells}
    if fresh:
        records.forget(study, wanted.values())
    found = {key: records.find(study, settings) for key, settings in wanted.items()}
    missing = [settings for key, settings in wanted.items() if found[key] is None]
    together = group(missing, lambda one: key_of({name: one[name] for name in by or one}))
    do, batches = partial(_work_off, study, work), together.values()
    finished = (
        map(do, batches)
        if executor is None
        else (x for _, x in parallel_map(executor, do, batches))
    )
    with progress(study if label is None else label, len(together)) as advance:
        for made in finished:
            for record in made:
                records.add(record)
                found[key_of(record.settings)] = record
            advance()
    return [record for record in found.values() if record is not None]


def _work_off(
    study: str, work: Callable[[Settings], Record], together: list[Settings]
) -> list[Record]:
    return [_work_off_one(study, settings, work) for settings in together]


def _work_off_one(study: str, settings: Settings, work: Callable[[Settings], Record]) -> Record:
    try:
        record = work(settings)
    except RefusedError as refusal:
        return Record(study, settings, "refused", str(refusal))
    except EomcheckError as error:
        return Record(study, settings, "failed", str(error))
    if (record.study, key_of(record.settings)) != (study, key_of(settings)):
        # It would be stored under another key, and worked again by every run.
        raise InputError(f"the record of {study} {settings} is one of other settings: {record}")
    return record


# ---- Studies -------------------------------------------------------------------------------------

CellWorker = Callable[[Settings], Record]
StudyRecords = Sequence[Record]

Quick = Annotated[bool, "A small part of it."]
Formulations = Annotated[list[str] | None, "Formulation, or several: a,b. Default all."]
References = Annotated[Path, "Folder of the reference solutions."]
REFERENCES = Path("validation/references")


def nothing(found: StudyRecords) -> tuple:
    """Return nothing."""
    return ()


def unfinished(found: StudyRecords) -> Iterator[str]:
    """Yield of which cells nothing came, and why."""
    for record in found:
        if record.status != "done":
            cell = ", ".join(f"{name} {value}" for name, value in record.settings.items())
            yield f"{cell} {record.status}: {record.reason}"


def failed(found: StudyRecords) -> bool:
    """Return whether some cell went wrong."""
    return any(record.status == "failed" for record in found)


def document_of(name: str, kind: type) -> Callable[[StudyRecords], dict[str, Any]]:
    """Return a `document` of the rows in Records, where what is not finite is null."""

    def document(found: StudyRecords) -> dict[str, Any]:
        rows = map(asdict, rows_in(found, kind))
        return {name: [{x: _finite(y) for x, y in row.items()} for row in rows]}

    return document


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study.

    Attributes:
        key: its name in commands and in Records.
        cells: its settings, one a cell. Its arguments are the options of its command, each
            `Annotated` with what help says of it.
        worker: the Records of the studies `before`, and more options -> what works off a cell.
        tables: Records -> tables.
        charts: Records -> charts.
        remarks: Records -> sentences below the tables; by default why cells are not done.
        label: of `eomcheck.console.progress`, "" where what works off a cell shows its own.
        before: studies whose Records must be known first, with the same options.
        alarm: Records -> whether something was found that must not be (exit code 1).
        files: Records, a folder -> other files written there, beside tables and charts.
        document: Records -> what `--json` writes, by default the Records.
        reading: how its tables and charts are to be read, for the report.
        small: whether it may run without a file to keep the Records in.
        parallel_by: settings by which its cells are spread over processes (`--executor`), those
            that share them together. By default they are timed: one after another, in this process.
    """

    key: str
    cells: Callable[..., Iterable[Settings]]
    worker: Callable[..., CellWorker]
    tables: Callable[[StudyRecords], Iterable[ResultTable]]
    charts: Callable[[StudyRecords], Iterable[Chart]] = nothing
    remarks: Callable[[StudyRecords], Iterable[str]] = unfinished
    label: str = "measuring {case}"
    before: tuple[Study, ...] = ()
    alarm: Callable[[StudyRecords], bool] = lambda found: False
    files: Callable[[StudyRecords, Path], Iterable[Path]] = lambda found, folder: ()
    document: Callable[[StudyRecords], dict[str, Any]] = lambda found: {
        "records": [*map(asdict, found)]
    }
    reading: str = ""
    small: bool = False
    parallel_by: Sequence[str] = ()

    def options(self) -> dict[str, Parameter]:
        """Return the options of the study, by name."""
        found: dict[str, Parameter] = {}
        functions: list[Callable] = [f for b in self.before for f in (b.cells, b.worker)]
        for function in (*functions, self.cells, self.worker, *([_at] if self.parallel_by else [])):
            found |= signature(function, eval_str=True).parameters
        return {name: one for name, one in found.items() if one.kind is Parameter.KEYWORD_ONLY}

    def check(self, **options: Any) -> None:
        """Raise InputError (or EngineError) if an option has a value that makes no sense."""
        for one in (*self.before, self):
            list(_call(one.cells, options))
            if one.parallel_by:
                _call(_at, options)

    def measure(self, records: Records, fresh: bool = False, **options: Any) -> list[Record]:
        """Work off every cell that is not in `records` yet; return the Records of all.

        Args:
            records: where they are kept.
            fresh: measure everything anew.
            options: those of `cells` and `worker`, and the `executor` of a study that is spread.

        Raises:
            InputError: an option has a value that makes no sense.
            WorkerError, EngineError: see `eomcheck.lab.store.parallel_map`.
        """
        # Before the first cell is worked off, all options are looked at.
        cells = list(_call(self.cells, options))
        where = _call(_at, options) if self.parallel_by else None
        known: list[Record] = []
        for one in self.before:
            known += one.measure(records, fresh, **options)
        work = _call(self.worker, options, known)
        how = {"fresh": fresh, "label": self.label, "executor": where, "by": self.parallel_by}
        found = run_cells(records, self.key, cells, work, **how)
        return [*known, *found]

    def run(self, file: Path | None = None, fresh: bool = False, **options: Any) -> list[Record]:
        """Do what `measure` does, with the Records in a file, or without one."""
        self.check(**options)  # options that make no sense leave no file behind
        with Records(file) as records:
            return self.measure(records, fresh, **options)

    def write(self, found: StudyRecords, folder: Path) -> list[Path]:
        """Draw all charts and write all tables (Markdown) into a folder; return the files."""
        from eomcheck.lab.show.chart_matplotlib import draw_charts

        files = (file for one in self.charts(found) for file in one.files())
        drawn = group(files, lambda chart: chart.name)
        written = []
        for file, charts in drawn.items():
            written.append(folder / f"{file}.png")
            draw_charts(charts, written[-1])
        for sheet in self.tables(found):
            if sheet.rows and not sheet.detail:
                written.append(folder / f"{sheet.name}.md")
                write_text(written[-1], sheet.markdown())
        return [*written, *self.files(found, folder)]

    def of(self, records: Iterable[Record]) -> list[Record]:
        """Return the Records of this study and of those before it."""
        keys = {self.key, *(one.key for one in self.before)}
        return [record for record in records if record.study in keys]


def _at(
    *, executor: Annotated[str, "Where: local, local:PROCESSES or dask:ADDRESS."] = "local"
) -> str:
    """Return where cells are worked off, once it is known that they can be."""
    check_executor(executor)
    return executor


def _call(function: Callable[..., Any], options: dict[str, Any], *arguments: Any) -> Any:
    """Call with those options that a function has."""
    own = signature(function).parameters
    return function(*arguments, **{name: x for name, x in options.items() if name in own})
