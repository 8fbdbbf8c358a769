"""Study: settings to vary, a worker for one cell, and tables and charts of the Records.

Each combination of settings is a cell, which is run once and gives a Record; this is stored at
once, so that an interrupted study resumes where it stopped. Tables and charts are made from Records
and compute nothing. The command of a study, its section of the report and its line in the
documentation follow from its one line in `eomcheck.lab.studies.STUDIES`.
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
from eomcheck.lab.show.chart import Chart, Line
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.parallel_map import check_executor, parallel_map
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
    """Run the cells of a study that are not in `records` yet; return the Records of all.

    Each is committed as it finishes: after Ctrl-C, an error or `kill -9` the same call resumes with
    the cell that was in flight.

    Args:
        records: file of the Records.
        study: name of the study.
        cells: settings, one per cell; a cell that is given twice is run once.
        work: settings -> Record of this study and these settings. An exception of eomcheck's own
            becomes a Record: "refused" for a `RefusedError`, otherwise "failed".
        fresh: delete the Records of these cells first.
        label: label of `progress`, by default the name of the study; "" for none.
        executor: executor for untimed cells, see
            `eomcheck.lab.store.parallel_map.parallel_map`;
            None: one after another, in this process.
        by: names of settings. Cells that share them go to one process together, in their order.
    """
    wanted = {key_of(settings): settings for settings in cells}
    if fresh:
        records.forget(study, wanted.values())
    by_key = {key: records.find(study, settings) for key, settings in wanted.items()}
    missing = [settings for key, settings in wanted.items() if by_key[key] is None]
    grouped = group(missing, lambda one: key_of({name: one[name] for name in by or one}))
    run_batch, batches = partial(_work_off, study, work), grouped.values()
    finished = (
        map(run_batch, batches)
        if executor is None
        else (x for _, x in parallel_map(executor, run_batch, batches))
    )
    with progress(study if label is None else label, len(grouped)) as advance:
        for batch_records in finished:
            for record in batch_records:
                records.add(record)
                by_key[key_of(record.settings)] = record
            advance()
    return [record for record in by_key.values() if record is not None]


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
        # It would be stored under another key, and run again each time.
        raise InputError(f"the record of {study} {settings} is one of other settings: {record}")
    return record


# ---- Tables and lines ----------------------------------------------------------------------------


def cell_text(value: float | None, how: str) -> str:
    """Return a number in a format, "" for None."""
    return "" if value is None else format(value, how)


def line_of(
    key: str,
    things: Iterable[Any],
    x: Callable[[Any], Any],
    y: Callable[[Any], float],
    hover: Callable[[Any], Sequence[str]] | None = None,
    **more: Any,
) -> Line:
    """Return the line through things, one point each: its abscissa, ordinate and hover text."""
    points = list(things)
    texts = [] if hover is None else [*map(hover, points)]
    return Line(key, [*map(x, points)], [*map(y, points)], texts, **more)


# ---- Studies -------------------------------------------------------------------------------------

CellWorker = Callable[[Settings], Record]
StudyRecords = Sequence[Record]

Quick = Annotated[bool, "A small part of it."]
Formulations = Annotated[list[str] | None, "Formulation, or several: a,b. Default all."]
References = Annotated[Path, "Folder of the reference solutions."]
REFERENCES = Path("validation/references")


def nothing(found: StudyRecords) -> tuple:
    """Return an empty tuple: no charts or remarks."""
    return ()


def unfinished(found: StudyRecords) -> Iterator[str]:
    """Yield the cells that are not done, each with its reason."""
    for record in found:
        if record.status != "done":
            cell = ", ".join(f"{name} {value}" for name, value in record.settings.items())
            yield f"{cell} {record.status}: {record.reason}"


def failed(found: StudyRecords) -> bool:
    """Return whether some cell went wrong."""
    return any(record.status == "failed" for record in found)


def document_of(name: str, kind: type) -> Callable[[StudyRecords], dict[str, Any]]:
    """Return a `document` function of the rows in Records; non-finite numbers become null."""

    def document(found: StudyRecords) -> dict[str, Any]:
        rows = map(asdict, rows_in(found, kind))
        return {name: [{x: _finite(y) for x, y in row.items()} for row in rows]}

    return document


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study: its cells, its worker, and the tables and charts of its Records.

    Attributes:
        key: its name in commands and in Records.
        cells: options -> settings, one per cell. Its keyword arguments are the options of the
            study's command, each `Annotated` with its help.
        worker: the Records of the studies `before`, and some of these options -> function that runs
            a cell.
        tables: Records -> tables.
        charts: Records -> charts.
        remarks: Records -> sentences below the tables; by default the reasons of cells not done.
        label: label of `eomcheck.console.progress`, "" where the worker shows its own progress.
        before: studies whose Records must be known first, with the same options.
        alarm: Records -> whether there is a result that must not be (exit code 1).
        files: Records, a folder -> other files written there, beside tables and charts.
        document: Records -> document that `--json` writes, by default the Records.
        reading: instructions for reading its tables and charts, for the report.
        small: whether it may run without a file for its Records.
        parallel_by: settings by which its cells are run in parallel (`--executor`); cells that
            share them go together. By default cells are timed: one after another, in this process.
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
        """Return the options of the study, by name: those of `cells`, and where they are run."""
        own = signature(self.cells, eval_str=True).parameters
        where = signature(_at, eval_str=True).parameters if self.parallel_by else {}
        return {**own, **where}

    def check(self, **options: Any) -> None:
        """Raise InputError (or EngineError) if an option has an invalid value."""
        for one in (*self.before, self):
            list(_call(one.cells, options))
            if one.parallel_by:
                _call(_at, options)

    def measure(self, records: Records, fresh: bool = False, **options: Any) -> list[Record]:
        """Run every cell that is not in `records` yet; return the Records of all.

        Args:
            records: file of the Records.
            fresh: run every cell again.
            options: those of `cells` and `worker`, and the `executor` of a parallel study.

        Raises:
            InputError: an option has an invalid value.
            WorkerError, EngineError: see `eomcheck.lab.store.parallel_map`.
        """
        # All options are checked before the first cell is run.
        cells = list(_call(self.cells, options))
        executor = _call(_at, options) if self.parallel_by else None
        known: list[Record] = []
        for one in self.before:
            known += one.measure(records, fresh, **options)
        work = _call(self.worker, options, known)
        how = {"fresh": fresh, "label": self.label, "executor": executor, "by": self.parallel_by}
        new = run_cells(records, self.key, cells, work, **how)
        return [*known, *new]

    def run(self, file: Path | None = None, fresh: bool = False, **options: Any) -> list[Record]:
        """Run the study as `measure` does, with the Records in a file, or without one."""
        self.check(**options)  # invalid options leave no file behind
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
    """Return the executor of cells, after a check that it can be used."""
    check_executor(executor)
    return executor


def _call(function: Callable[..., Any], options: dict[str, Any], *arguments: Any) -> Any:
    """Call a function with the options among its parameters."""
    own = signature(function).parameters
    return function(*arguments, **{name: x for name, x in options.items() if name in own})
