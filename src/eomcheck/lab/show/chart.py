"""Charts as data, without a plotting library: axes, panels, heat maps, line styles.

A `Panel` is one pair of axes with lines and bands, a `Heat` is a heat map of rows of boxes under
headings. A `Chart` holds one or the other for every combination of choices: a page shows one
combination at a time (`chart_plotly`), a figure in a file shows a grid of them
(`chart_matplotlib`). A line has no color of its own: its key (a formulation, an integrator, ...)
selects one of `STYLES`, so that the same key has the same color, marker and dashes in every chart.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Literal, NamedTuple

from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.integrators import INTEGRATORS

# ---- Panels of lines and bands -------------------------------------------------------------------


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
        key: of `eomcheck.lab.show.chart.STYLES`.
        x: abscissae, or categories of the axis.
        y: ordinates.
        hover_text: lines of text at each point, which a page shows on demand; or nothing.
        label: what the legend calls it, by default its key.
        dashed: whether it is, whatever its style.
        hollow: points that are drawn hollow, by default none.
        joined: whether its points are joined.
        every: (first, step) of the points that are marked, where there are many.
        appearance: "line", "thin" or "dotted" without marks, or only marks: "crosses", for what
            could not be measured, or red "rings".
    """

    key: str
    x: Sequence[float] | Sequence[str]
    y: Sequence[float]
    hover_text: Sequence[Sequence[str]] = ()
    label: str = ""
    dashed: bool = False
    hollow: Sequence[bool] = ()
    joined: bool = True
    every: tuple[int, int] | None = None
    appearance: Literal["line", "thin", "dotted", "crosses", "rings"] = "line"


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


# ---- Heat maps -----------------------------------------------------------------------------------


class Box(NamedTuple):
    """A box of a heat map.

    Attributes:
        value: what its colour tells, NaN where there is nothing to tell.
        hatched: whether it is.
        framed: whether it has a frame, for it is wrong.
        hover_text: lines of text, which a page shows on demand.
    """

    value: float
    hatched: bool
    framed: bool
    hover_text: Sequence[str] = ()


@dataclass(frozen=True)
class Heat:
    """A heat map: rows of boxes, under headings that some of them share.

    Attributes:
        columns: heading -> number of boxes below it, in each row.
        rows: what stands beside a row -> key of its formulation, its boxes or None where is none.
        colors: what they tell: a title, and a range.
        limit: the value from which on nothing is good.
        hatched: what hatching tells.
        framed: what a frame tells.
        title: above it.
    """

    columns: Mapping[str, int]
    rows: Mapping[str, tuple[str, Sequence[Box | None]]]
    colors: Axis
    limit: float
    hatched: str
    framed: str
    title: str = ""

    @property
    def edges(self) -> list[float]:
        """Where boxes begin and end: each heading is 1 wide."""
        shares = [(place, count) for place, count in enumerate(self.columns.values())]
        return [p + k / count for p, count in shares for k in range(count)] + [len(shares)]

    @property
    def keys(self) -> list[str]:
        """Keys of what is drawn."""
        return [key for key, _ in self.rows.values()]


# ---- Charts --------------------------------------------------------------------------------------


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


# ---- Styles of lines -----------------------------------------------------------------------------

PALETTE = (
    # Okabe and Ito's, told apart by colour-blind readers, without its yellow, too pale on white;
    # then Tol's wine, and two to spare
    *("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7"),
    *("#56B4E9", "#D55E00", "#882255", "#999933", "#888888"),
)
WRONG = "#B00020"
"""What must not be: a limit that is passed, an error that nobody told."""


class Style(NamedTuple):
    """How the lines of one formulation or integrator look.

    Attributes:
        color: "#rrggbb", for a white background.
        marker: matplotlib's sign.
        symbol: the same as plotly calls it.
        dashed: whether its lines are.
        width: of its lines, pt.
    """

    color: str
    marker: str
    symbol: str
    dashed: bool = False
    width: float = 1.2


_SIGNS = tuple(
    zip(
        "osD^vP*Xh<",
        (
            *("circle", "square", "diamond", "triangle-up", "triangle-down"),
            *("cross", "star", "x", "hexagon", "triangle-left"),
        ),
        strict=True,
    )
)
STYLES = {
    key: Style(color, *signs)
    for key, color, signs in zip(FORMULATIONS, PALETTE, _SIGNS, strict=False)
} | {
    # Integrators leave black out: some figures show them beside a formulation.
    key: Style(PALETTE[1 + i % (len(PALETTE) - 1)], *_SIGNS[i % len(_SIGNS)], dashed=kind.implicit)
    for i, (key, kind) in enumerate(INTEGRATORS.items())
}
STYLES |= {
    "one sign flipped": Style(WRONG, "x", "x-thin-open"),
    "allowed by rounding": Style(PALETTE[-1], "_", "line-ew-open"),
    "drawn at random": Style(PALETTE[1], "s", "square"),
    "climbed to": Style(PALETTE[6], "o", "circle"),
    "links": Style("#404040", "o", "circle", width=3.0),
    "wheels": Style(PALETTE[6], "", "", width=6.0),
}
"""Key of a formulation, an integrator or what else is drawn -> its style. Implicit integrators are
dashed."""
