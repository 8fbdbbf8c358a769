"""What a study is, and how any of them is run.

A study varies some settings. Each combination is a cell, worked off once into a Record; tables and
charts are made from Records and compute nothing. Its command, its section of the report and its
line in the documentation follow from its one line in `eomcheck.lab.studies.STUDIES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any

from eomcheck.atomic_write import write_text
from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.table import Sheet
from eomcheck.lab.store.cells import run_cells
from eomcheck.lab.store.executors import check_place
from eomcheck.lab.store.groups import group, rows_of
from eomcheck.lab.store.record import Record
from eomcheck.lab.store.records import Records
from eomcheck.lab.store.settings import Settings

Work = Callable[[Settings], Record]
Found = Sequence[Record]

Quick = Annotated[bool, "A small part of it."]
Formulations = Annotated[list[str] | None, "Formulation, or several: a,b. Default all."]
References = Annotated[Path, "Folder of the reference solutions."]
REFERENCES = Path("validation/references")


def nothing(found: Found) -> tuple:
    """Return nothing."""
    return ()


def unfinished(found: Found) -> Iterator[str]:
    """Yield of which cells nothing came, and why."""
    for record in found:
        if record.status != "done":
            cell = ", ".join(f"{name} {value}" for name, value in record.settings.items())
            yield f"{cell} {record.status}: {record.reason}"


def failed(found: Found) -> bool:
    """Return whether some cell went wrong."""
    return any(record.status == "failed" for record in found)


def document_of(name: str, kind: type) -> Callable[[Found], dict[str, Any]]:
    """Return a `document` of the rows in Records, where what is not finite is null."""

    def document(found: Found) -> dict[str, Any]:
        rows = map(asdict, rows_of(found, kind))
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
        sheets: Records -> tables.
        charts: Records -> charts.
        said: Records -> sentences below the tables; by default why cells are not done.
        label: of `eomcheck.console.progress`, "" where what works off a cell shows its own.
        before: studies whose Records must be known first, with the same options.
        alarm: Records -> whether something was found that must not be (exit code 1).
        files: Records, a folder -> other files written there, beside tables and charts.
        document: Records -> what `--json` writes, by default the Records.
        reading: how its tables and charts are to be read, for the report.
        small: whether it may run without a file to keep the Records in.
        spread_by: settings by which its cells are spread over processes (`--executor`), those that
            share them together. By default they are timed: one after another, in this process.
    """

    key: str
    cells: Callable[..., Iterable[Settings]]
    worker: Callable[..., Work]
    sheets: Callable[[Found], Iterable[Sheet]]
    charts: Callable[[Found], Iterable[Chart]] = nothing
    said: Callable[[Found], Iterable[str]] = unfinished
    label: str = "measuring {case}"
    before: tuple[Study, ...] = ()
    alarm: Callable[[Found], bool] = lambda found: False
    files: Callable[[Found, Path], Iterable[Path]] = lambda found, folder: ()
    document: Callable[[Found], dict[str, Any]] = lambda found: {"records": [*map(asdict, found)]}
    reading: str = ""
    small: bool = False
    spread_by: Sequence[str] = ()

    def options(self) -> dict[str, Parameter]:
        """Return the options of the study, by name."""
        found: dict[str, Parameter] = {}
        functions: list[Callable] = [f for b in self.before for f in (b.cells, b.worker)]
        for function in (*functions, self.cells, self.worker, *([_at] if self.spread_by else [])):
            found |= signature(function, eval_str=True).parameters
        return {name: one for name, one in found.items() if one.kind is Parameter.KEYWORD_ONLY}

    def check(self, **options: Any) -> None:
        """Raise InputError (or EngineError) if an option has a value that makes no sense."""
        for one in (*self.before, self):
            list(_call(one.cells, options))
            if one.spread_by:
                _call(_at, options)

    def measure(self, records: Records, fresh: bool = False, **options: Any) -> list[Record]:
        """Work off every cell that is not in `records` yet; return the Records of all.

        Args:
            records: where they are kept.
            fresh: measure everything anew.
            options: those of `cells` and `worker`, and the `executor` of a study that is spread.

        Raises:
            InputError: an option has a value that makes no sense.
            WorkerError, EngineError: see `eomcheck.lab.store.workers`.
        """
        # Before the first cell is worked off, all options are looked at.
        cells = list(_call(self.cells, options))
        where = _call(_at, options) if self.spread_by else None
        known: list[Record] = []
        for one in self.before:
            known += one.measure(records, fresh, **options)
        work = _call(self.worker, options, known)
        how = {"fresh": fresh, "label": self.label, "where": where, "by": self.spread_by}
        found = run_cells(records, self.key, cells, work, **how)
        return [*known, *found]

    def run(self, file: Path | None = None, fresh: bool = False, **options: Any) -> list[Record]:
        """Do what `measure` does, with the Records in a file, or without one."""
        self.check(**options)  # options that make no sense leave no file behind
        with Records(file) as records:
            return self.measure(records, fresh, **options)

    def write(self, found: Found, folder: Path) -> list[Path]:
        """Draw all charts and write all tables (Markdown) into a folder; return the files."""
        from eomcheck.lab.show.chart_matplotlib import draw

        files = (file for one in self.charts(found) for file in one.files())
        drawn = group(files, lambda chart: chart.name)
        written = []
        for file, charts in drawn.items():
            written.append(folder / f"{file}.png")
            draw(charts, written[-1])
        for sheet in self.sheets(found):
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
    check_place(executor)
    return executor


def _call(function: Callable[..., Any], options: dict[str, Any], *arguments: Any) -> Any:
    """Call with those options that a function has."""
    own = signature(function).parameters
    return function(*arguments, **{name: x for name, x in options.items() if name in own})
