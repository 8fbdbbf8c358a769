"""Findings about rows of recorded tables, with code that reads the row again.

A `RecordedFinding` knows its file and row. Its code constructs the scene, reads that row and prints
each number that differs beside the expected one, see `eomcheck.lab.recorded_log.compared_row`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.finding import Finding, format_distinct
from eomcheck.claims.reproducer import reproducer_header
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array


class ComparedEntry(NamedTuple):
    """A recorded number beside its expected value.

    Attributes:
        column: name of its column, or of the quantity that columns give.
        recorded, expected: both numbers.
        allowed: allowed error of their difference.
    """

    column: str
    recorded: float
    expected: float
    allowed: float

    @property
    def differs(self) -> bool:
        """Whether both differ by more than is allowed."""
        return not abs(self.recorded - self.expected) <= self.allowed

    def __str__(self) -> str:
        x, y = format_distinct(self.recorded, self.expected)
        off = f"off by {self.recorded - self.expected:.3g}, allowed {self.allowed:.2g}"
        return f"{self.column}: {x} recorded, {y} expected; {off}"


class ComparedRow(NamedTuple):
    """A row of a table beside its expected values.

    Attributes:
        place: the row, and the line of a CSV.
        state: the state in this row, in the coordinates of the scene.
        entries: the numbers that differ; all of them where none does.
    """

    place: str
    state: State
    entries: tuple[ComparedEntry, ...]


def compared_entries(
    names: Sequence[str], recorded: Array, expected: Array, allowed: Array
) -> tuple[ComparedEntry, ...]:
    """Return the entries of arrays (k,) that differ, or all if none does.

    Args:
        names: names of the entries.
        recorded, expected, allowed: numbers (k,).
    """
    sides = zip(names, *(np.ravel(x).tolist() for x in (recorded, expected, allowed)), strict=True)
    entries = tuple(ComparedEntry(*one) for one in sides)
    return tuple(one for one in entries if one.differs) or entries


@dataclass(frozen=True)
class RecordedFinding(Finding):
    """A `Finding` about a row of a table.

    Attributes:
        path: the file.
        row: index of the row, -1 where the finding is about none.
        options: options by which the file is read, see `recorded_log.check_recorded`.
        compared: numbers of a log that differ in this row.
    """

    path: Path = Path()
    row: int = -1
    options: Mapping[str, str | None] = field(default_factory=dict)
    compared: tuple[ComparedEntry, ...] = ()

    def as_python(self) -> str:
        """Return Python code that reads the row and prints both sides of what differs there."""
        chosen = {name: text for name, text in self.options.items() if text is not None}
        file = f"Path({str(self.path.resolve())!r})"
        arguments = [file, "scene", repr(self.subject), str(self.row), *_named(chosen.items())]
        return (
            "from pathlib import Path\n\n"
            "from eomcheck.lab.recorded_log import compared_row\n"
            f"{reproducer_header(self.scene)}"
            f"row = compared_row({', '.join(arguments)})\n"
            'print(f"{row.place}: q = {row.state.q}, v = {row.state.v}, t = {row.state.t}")\n'
            "for entry in row.entries:\n"
            "    print(entry)\n"
        )


def _named(options: Iterable[tuple[str, Any]]) -> list[str]:
    return [f"{name}={value!r}" for name, value in options]
