"""A chart as data: panels of lines or boxes, of which a page shows one and a figure a grid."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import NamedTuple

from eomcheck.lab.show.heat import Heat
from eomcheck.lab.show.panel import Panel


class File(NamedTuple):
    """A figure in a file: its name, its title, and rows of choices that it shows."""

    name: str
    title: str
    grid: Sequence[Sequence[tuple[str, ...]]]


@dataclass(frozen=True)
class Chart:
    """Panels by what is chosen in some lists.

    Attributes:
        name: that of its file and its anchor.
        title: what it shows.
        lists: names of the lists in which something is chosen.
        panels: what was chosen in each list -> panel.
        grid: rows of choices that a figure shows. By default the last list runs along rows.
        size: width and height of a panel in a figure, in.
        hollow: what a point is that is drawn hollow.
        parts: figures in files of their own, if it is more than one, or stands in one file with
            other charts.
    """

    name: str
    title: str
    lists: Sequence[str]
    panels: Mapping[tuple[str, ...], Panel | Heat]
    grid: Sequence[Sequence[tuple[str, ...]]] = ()
    size: tuple[float, float] = field(default=(3.2, 3.1), compare=False)
    hollow: str = ""
    parts: Sequence[File] | None = None

    @property
    def choices(self) -> dict[str, list[str]]:
        """Name of a list -> what can be chosen in it, in the order of the panels."""
        columns = enumerate(self.lists)
        return {name: list(dict.fromkeys(c[i] for c in self.panels)) for i, name in columns}

    def files(self) -> list[Chart]:
        """Return what is drawn into files, one each; charts of one name stand in one file."""
        if self.parts is None:
            return [self]
        return [replace(self, **part._asdict(), parts=None) for part in self.parts]

    def rows(self) -> list[list[tuple[str, ...]]]:
        """Return the rows of a figure: choices of panels that exist."""
        if self.grid:
            return [[c for c in row if c in self.panels] for row in self.grid]
        *others, last = self.choices.values()
        rows = ([(*first, end) for end in last] for first in product(*others))
        return [found for row in rows if (found := [c for c in row if c in self.panels])]


def in_rows(chosen: Sequence[tuple[str, ...]], across: int) -> list[Sequence[tuple[str, ...]]]:
    """Return choices as rows of so many."""
    return [chosen[k : k + across] for k in range(0, len(chosen), across)]


def keys_of(charts: Iterable[Chart]) -> list[str]:
    """Return what is drawn in any of the charts: keys of formulations and integrators."""
    panels = (panel for chart in charts for panel in chart.panels.values())
    return list(dict.fromkeys(key for panel in panels for key in panel.keys))
