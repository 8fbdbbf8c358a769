"""A panel of a chart as data: lines and bands over axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple


class Axis(NamedTuple):
    """An axis: its title with the unit, in logarithms or not, over a range, with ticks.

    With a `unit` of its own each number has it, with a prefix, and the title has none.
    Panels beside or above each other whose axes are alike have one scale, unless it is their `own`.
    """

    title: str
    log: bool = False
    range: tuple[float | None, float | None] | None = None
    ticks: Sequence[float] = ()
    categories: Sequence[str] = ()
    own: bool = False
    unit: str = ""


LINKS = Axis("number of links N", log=True, ticks=(1, 2, 3, 5, 7, 10, 20, 30, 50, 70, 100, 1000))


class Line(NamedTuple):
    """A line of a formulation, an integrator or what else has a style.

    Attributes:
        key: of `eomcheck.lab.show.style.STYLES`.
        x: abscissae, or categories of the axis.
        y: ordinates.
        said: lines of text at each point, which a page shows on demand; or nothing.
        label: what the legend calls it, by default its key.
        dashed: whether it is, whatever its style.
        hollow: points that are drawn hollow, by default none.
        joined: whether its points are joined.
        every: (first, step) of the points that are marked, where there are many.
        look: "line", "thin" or "dotted" without marks, or only marks: "crosses", for what could not
            be measured, or red "rings".
    """

    key: str
    x: Sequence[float] | Sequence[str]
    y: Sequence[float]
    said: Sequence[Sequence[str]] = ()
    label: str = ""
    dashed: bool = False
    hollow: Sequence[bool] = ()
    joined: bool = True
    every: tuple[int, int] | None = None
    look: Literal["line", "thin", "dotted", "crosses", "rings"] = "line"


class Band(NamedTuple):
    """An area between two lines of a formulation, and what a legend calls it."""

    key: str
    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    label: str


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        x: abscissa.
        y: ordinate.
        lines: what is drawn.
        title: above it.
        unknown: below this ordinate the truth is not known, which is drawn in grey.
        marks: abscissae at which a dotted line stands.
        level: ordinate at which a line goes across.
        legend: whether the legend of its lines stands in it, not above all panels.
        bad: between these ordinates nothing is good, which is drawn in grey.
        equal: whether a unit is as long on both axes.
        bands: areas below the lines, each darker than the one before.
    """

    x: Axis
    y: Axis
    lines: Sequence[Line]
    title: str = ""
    unknown: float | None = None
    marks: Sequence[float] = ()
    level: float | None = None
    legend: bool = False
    bad: tuple[float, float] | None = None
    equal: bool = False
    bands: Sequence[Band] = ()

    @property
    def keys(self) -> list[str]:
        """Keys of what is drawn."""
        return [line.key for line in self.lines]
