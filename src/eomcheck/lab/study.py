"""Study: settings to vary, a worker for one cell, run times, and tables and charts of the Records.

Each combination of settings is a cell, which is run once and gives a Record; this is stored at
once, so that an interrupted study resumes where it stopped. Tables and charts are made from Records
and compute nothing. The command of a study, its section of the report and its line in the
documentation follow from its one line in `eomcheck.lab.studies.STUDIES`.

A run time is the best of many warm runs, pinned to one core, beside the CPU time. Timed work is
done in this process, one cell at a time: two at a time, each on its own core, share caches and
memory, and their times are noisier.
"""

from __future__ import annotations

import ctypes
import math
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from inspect import Parameter, signature
from pathlib import Path
from statistics import quantiles
from typing import Annotated, Any

import numpy as np

from eomcheck.atomic_write import write_text
from eomcheck.console import progress
from eomcheck.deprecated import old_keywords
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.formulations import formulation_of
from eomcheck.lab.deviations import Observation
from eomcheck.lab.show.chart import Chart, Line
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.parallel_map import check_executor, parallel_map
from eomcheck.lab.store.record_file import (
    Record,
    Records,
    Settings,
    group,
    key_of,
    machine,
    rows_in,
)
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.simulate import Motion, Trajectory, trajectory_of
from eomcheck.numbers.generic import Array

# ---- Run time ------------------------------------------------------------------------------------

RUNS = 20
FEWEST = 3
CONTENTION_RATIO = 1.05
"""Ratio of run time to CPU time above which a run was contended by other programs."""
LONG = 2.0
"""Run time, s, above which work runs `FEWEST` times only."""


@dataclass(frozen=True)
class RunTime:
    """The timings of some work.

    Attributes:
        seconds: time of the best run, s.
        cpu_seconds: CPU time of this thread in that run, s; less than `seconds` where other
            programs had the core.
        quartiles: lower and upper quartile of the runs, s.
        runs: number of runs.
        core: core to which they were pinned, None where the system cannot.
        load: load average of the minute before, this process included; None where the system has
            none.
    """

    seconds: float
    cpu_seconds: float
    quartiles: tuple[float, float]
    runs: int
    core: int | None
    load: float | None

    def recorded(self) -> dict[str, Any]:
        """Return the timings as fields of a Record."""
        fields = asdict(self)
        context = {name: fields.pop(name) for name in ("core", "load")}
        return fields | {"machine": machine() | context}


def run_time(
    work: Callable[[], object], runs: int = RUNS, fewest: int = FEWEST, long: float = LONG
) -> RunTime:
    """Return the run time of `work`.

    Args:
        work: function to time; it must be warm, since its first run counts too.
        runs: number of runs.
        fewest: number of runs if the work takes longer than `long`.
        long: run time above which `fewest` runs are enough, s.
    """
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    taken: list[tuple[float, float]] = []
    with held_on_a_core() as core:
        while len(taken) < (fewest if taken and min(taken)[0] > long else runs):
            start, cpu = time.perf_counter(), time.thread_time()
            work()
            taken.append((time.perf_counter() - start, time.thread_time() - cpu))
    low, _, high = quantiles([seconds for seconds, _ in taken], n=4, method="inclusive")
    return RunTime(*min(taken), (low, high), len(taken), core, load)


@contextmanager
def held_on_a_core() -> Iterator[int | None]:
    """Pin this thread to its current core, and provide the number; None where impossible."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed, core = os.sched_getaffinity(0), ctypes.CDLL(None).sched_getcpu()
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


def was_contended(record: Record) -> bool:
    """Return whether another program had the core for a part of the best run."""
    if record.seconds is None or record.cpu_seconds is None:
        return False
    return record.seconds > CONTENTION_RATIO * record.cpu_seconds


def slope(points: Iterable[tuple[float, float]]) -> float:
    """Return the least-squares slope of log(y) over log(x): the power with which a time grows."""
    x, y = np.log(list(points)).T
    return float(np.polyfit(x, y, 1)[0])


# ---- Run time of motions -------------------------------------------------------------------------

Judged = tuple[dict[str, float], dict[str, Any]]
"""Errors and series of a trajectory, by name."""


def prepare_motion(scene: Scene, key: str, *start: Any) -> tuple[Motion, float]:
    """Return the `Motion` from a start, by default the scene's, and its construction time, s."""
    start, begin = start or scene.initial_state(), time.perf_counter()
    motion = Motion(scene, formulation_of(key), *start)
    return motion, time.perf_counter() - begin


def check_tolerances(tolerances: Iterable[float]) -> None:
    """Raise InputError unless every tolerance is between 0 and 1."""
    for one in tolerances:
        if not 0 < one < 1:
            raise InputError(f"tolerance = {one!r}, expected a number between 0 and 1")


def solver_options(settings: Settings, times: Array) -> dict[str, Any]:
    """Return the options of `Motion.solve` in a cell: integrator, tolerances, output times."""
    tolerance, options = settings["tolerance"], {"integrator": settings["integrator"]}
    return options | {"rtol": tolerance, "atol": tolerance, "output_times": times}


def motion_record(
    study: str,
    settings: Settings,
    prepared: tuple[Motion, float],
    times: Array,
    judge: Callable[[Trajectory], Judged],
    counts: dict[str, int] | None = None,
    **timing: Any,
) -> Record:
    """Return the Record of a motion: integrated and judged, then timed if it reaches its end.

    Args:
        study: key of the study.
        settings: those of the cell, with an integrator and a tolerance.
        prepared: the motion and its construction time, see `prepare_motion`.
        times: output times (k,), s; the last one is the end.
        judge: trajectory -> its errors and series.
        counts: counts beside those of right-hand sides and steps.
        timing: options of `run_time`.
    """
    motion, compile_seconds = prepared
    end, options = float(times[-1]), solver_options(settings, times)
    every, steps = motion.every_step(end, **options), motion.solve(end, **options)
    integrator, tolerance = settings["integrator"], settings["tolerance"]
    found = trajectory_of(motion, steps, integrator, tolerance, tolerance, 0.0, every)
    counts = {"right-hand sides": found.right_hand_sides, "steps": found.steps} | (counts or {})
    if found.status != "finished":
        return Record(study, settings, "failed", found.reason, counts=counts)
    taken = run_time(lambda: motion.solve(end, **options), **timing)
    errors, series = judge(found)
    return Record(
        study,
        settings,
        **taken.recorded(),
        compile_seconds=compile_seconds,
        counts=counts,
        errors=errors,
        series=series,
    )


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
            becomes a Record: "refused" for a `RefusedError`, otherwise "failed". So does the death
            of its process, where an executor runs it.
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
        else (x for _, x in parallel_map(executor, run_batch, batches, partial(_killed, study)))
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


def _killed(study: str, together: list[Settings]) -> list[Record]:
    """Return the Records of cells whose processes died, such as by a crash of a library."""
    why = "it killed every process that ran it"
    return [Record(study, cell, "failed", why) for cell in together]


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


def unfinished(found: StudyRecords, *also_done: str) -> Iterator[str]:
    """Yield the cells that are not done, each with its reason; `also_done` are other statuses."""
    for record in found:
        if record.status not in ("done", *also_done):
            cell = ", ".join(f"{name} {value}" for name, value in record.settings.items())
            yield f"{cell} {record.status}: {record.reason}"


def failed(found: StudyRecords) -> bool:
    """Return whether some cell went wrong; one that was refused did not."""
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
        observations: Records -> verdicts on engines, which a file of known deviations is compared
            with (`--deviations`); None if it compares no engines.
        extends: Records, a folder -> tables and charts of the Records and of what the tables of an
            earlier run there have beside them (`--extend`); None if it cannot.
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
    observations: Callable[[StudyRecords], Iterable[Observation]] | None = None
    extends: (
        Callable[[StudyRecords, Path], tuple[Sequence[ResultTable], Iterable[Chart]]] | None
    ) = None
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

    def stored(self, records: Records, **options: Any) -> list[Record]:
        """Return the Records of the cells that are in a file; for options see `measure`."""
        known = [record for one in self.before for record in one.stored(records, **options)]
        found = (records.find(self.key, settings) for settings in _call(self.cells, options))
        return [*known, *(record for record in found if record is not None)]

    def run(
        self,
        file: Path | None = None,
        fresh: bool = False,
        *,
        stored: bool = False,
        **options: Any,
    ) -> list[Record]:
        """Run the study as `measure` does, with the Records in a file, or without one.

        Args:
            file: the file.
            fresh: run every cell again.
            stored: run none, and return the Records that are in the file.
            options: see `measure`.

        Raises:
            InputError, WorkerError, EngineError: see `measure`; or `stored` without a file.
        """
        self.check(**options)  # invalid options leave no file behind
        if stored and (fresh or file is None or not file.exists()):
            where = "no file" if file is None else repr(str(file))
            why = "with --fresh" if fresh else f"of {where}, expected --records with a file"
            raise InputError(f"stored results are asked for {why}")
        with Records(file) as records:
            return (
                self.stored(records, **options)
                if stored
                else self.measure(records, fresh, **options)
            )

    def write(self, found: StudyRecords, folder: Path, extend: bool = False) -> list[Path]:
        """Draw all charts, NAME.svg and NAME-dark.svg, and write all tables, NAME.md.

        Returns the files.

        Args:
            found: the Records.
            folder: the folder.
            extend: whether to keep the rest of the tables that are there, see `extends`.
        """
        from eomcheck.lab.show.chart_matplotlib import draw_both

        if extend and self.extends is not None:
            tables, charts = self.extends(found, folder)
        else:
            tables, charts = self.tables(found), self.charts(found)
        written = []
        for chart in charts:
            for file in chart.files():
                written += draw_both(file, folder)
        for sheet in tables:
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
