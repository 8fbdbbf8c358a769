"""Charts as data, without a plotting library: axes, panels, heat maps, line styles.

A `Panel` is one pair of axes with lines and bands, a `Heat` is a heat map of rows of boxes under
headings. A `Chart` holds one or the other for every combination of choices: a page shows one
combination at a time (`chart_plotly`), a figure in a file shows a grid of them
(`chart_matplotlib`). A line has no color of its own: its key (a formulation, an integrator, ...)
selects one of `STYLES`, so that the same key has the same color, marker and dashes in every chart.
Colors are those for a light ground; `on_dark` returns the color for a dark one.
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
    """Axis of a panel: title with the unit, scale, range and ticks.

    With a `unit` each tick label has it, with an SI prefix, and the title has none. Adjacent panels
    with equal axes share one scale, unless `own` is set.
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
    """Line of a formulation, an integrator or another key with a style.

    Attributes:
        key: key of `eomcheck.lab.show.chart.STYLES`.
        x: abscissae, or categories of the axis.
        y: ordinates.
        hover_text: lines of text at each point, shown by a page on hover; or nothing.
        label: text in the legend, by default the key, and the name of its formulation.
        dashed: whether it is dashed, regardless of its style.
        hollow: flags of points with hollow markers, by default none.
        joined: whether its points are joined.
        every: (first, step) of the points with markers, if there are many.
        appearance: "line", "thin" or "dotted" without markers, or only markers: "crosses", for
            values that could not be measured, or red "rings". "dotted" and "crosses" with a label
            stand for all keys: their mark in the legend is grey.
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
    """Area between two lines of a formulation, with its label in the legend."""

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
        lines: its lines.
        title: text above it.
        unknown: ordinate below which the true value is not known, drawn in grey.
        marks: abscissae of dotted vertical lines.
        level: ordinate of a horizontal line.
        bad: range of ordinates in which no result is good, drawn in grey.
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
    bad: tuple[float, float] | None = None
    equal: bool = False
    bands: Sequence[Band] = ()

    @property
    def keys(self) -> list[str]:
        """Keys of its lines."""
        return [line.key for line in self.lines]


# ---- Heat maps -----------------------------------------------------------------------------------


class Box(NamedTuple):
    """Box of a heat map.

    Attributes:
        value: value that its color shows, NaN for none.
        hatched: whether it is hatched.
        framed: whether it has a frame, as a wrong result.
        hover_text: lines of text, shown by a page on hover.
    """

    value: float
    hatched: bool
    framed: bool
    hover_text: Sequence[str] = ()
    text: str = ""
    """Short text in it, in a figure."""


@dataclass(frozen=True)
class Heat:
    """Heat map: rows of boxes, under headings that some of them share.

    In a figure boxes are bars as high as their values, in a tile for each heading and row; a steep
    one has colored boxes.

    Attributes:
        columns: heading -> number of boxes below it, in each row.
        rows: label of a row -> key of its formulation, its boxes or None for no box.
        colors: axis of the color scale: a title, and a range.
        limit: the value from which on no result is good.
        hatched: meaning of hatching.
        framed: meaning of a frame.
        title: text above it.
        beyond: meaning of a value from the limit on, without a frame.
        steep: whether its boxes are colored in a figure, with upright headings.
    """

    columns: Mapping[str, int]
    rows: Mapping[str, tuple[str, Sequence[Box | None]]]
    colors: Axis
    limit: float
    hatched: str
    framed: str
    title: str = ""
    beyond: str = ""
    steep: bool = False

    def under(self, head: str) -> list[Sequence[Box | None]]:
        """Return the boxes below a heading, of each row."""
        counts = list(self.columns.values())
        start = sum(counts[: [*self.columns].index(head)])
        return [boxes[start : start + self.columns[head]] for _, boxes in self.rows.values()]

    @property
    def flat(self) -> list[str]:
        """Headings below which every result is good: no box is hatched, framed or at the limit."""

        def good(box: Box | None) -> bool:
            return box is None or not (box.hatched or box.framed or box.value >= self.limit)

        return [head for head in self.columns if all(good(x) for y in self.under(head) for x in y)]

    @property
    def edges(self) -> list[float]:
        """Edges of the boxes: each heading is 1 wide."""
        shares = [(index, count) for index, count in enumerate(self.columns.values())]
        return [p + k / count for p, count in shares for k in range(count)] + [len(shares)]

    @property
    def keys(self) -> list[str]:
        """Keys of its rows."""
        return [key for key, _ in self.rows.values()]


# ---- Charts --------------------------------------------------------------------------------------


class File(NamedTuple):
    """Figure in a file: its name, its title, and the rows of choices that it shows."""

    name: str
    title: str
    grid: Sequence[Sequence[tuple[str, ...]]]


@dataclass(frozen=True)
class Chart:
    """Panels by choices from some lists.

    Attributes:
        name: name of its file and its anchor.
        title: its title.
        lists: names of the lists of choices.
        panels: the choice from each list -> panel.
        grid: rows of choices that a figure shows. By default the last list runs along rows.
        height: height of a row of panels in a figure, in.
        hollow: meaning of a hollow marker.
        parts: figures in files of their own, if there are several.
        on_page: whether a page shows it too.
    """

    name: str
    title: str
    lists: Sequence[str]
    panels: Mapping[tuple[str, ...], Panel | Heat]
    grid: Sequence[Sequence[tuple[str, ...]]] = ()
    height: float = field(default=2.4, compare=False)
    hollow: str = ""
    parts: Sequence[File] | None = None
    on_page: bool = True

    @property
    def choices(self) -> dict[str, list[str]]:
        """Name of a list -> its choices, in the order of the panels."""
        columns = enumerate(self.lists)
        return {name: list(dict.fromkeys(c[i] for c in self.panels)) for i, name in columns}

    def files(self) -> list[Chart]:
        """Return the charts to draw into files, one each."""
        if self.parts is None:
            return [self]
        return [replace(self, **part._asdict(), parts=None) for part in self.parts]

    def rows(self) -> list[list[tuple[str, ...]]]:
        """Return the rows of a figure: choices of panels that exist."""
        if self.grid:
            return [[c for c in row if c in self.panels] for row in self.grid]
        *others, last = self.choices.values()
        rows = ([(*first, end) for end in last] for first in product(*others))
        return [shown for row in rows if (shown := [c for c in row if c in self.panels])]


def in_rows(chosen: Sequence[tuple[str, ...]], across: int) -> list[Sequence[tuple[str, ...]]]:
    """Return choices arranged in rows of `across`."""
    return [chosen[k : k + across] for k in range(0, len(chosen), across)]


def keys_of(charts: Iterable[Chart]) -> list[str]:
    """Return the keys in any of the charts: of formulations and integrators."""
    panels = (panel for chart in charts for panel in chart.panels.values())
    return list(dict.fromkeys(key for panel in panels for key in panel.keys))


# ---- Styles of lines -----------------------------------------------------------------------------

PALETTE = (
    # Okabe and Ito's, safe for colour-blind readers, without its yellow, too pale on white, and
    # with darker orange and sky blue; then Tol's wine, and two to spare
    *("#000000", "#0072B2", "#C08400", "#009E73", "#CC79A7"),
    *("#3A96D2", "#D55E00", "#882255", "#999933", "#888888"),
)
WRONG = "#B00020"
"""Color of a violation: a limit exceeded, an unreported error."""


class Style(NamedTuple):
    """Line style of one formulation or integrator.

    Attributes:
        color: "#rrggbb", for a white background.
        marker: matplotlib's marker.
        symbol: plotly's name of the same marker.
        dashed: whether its lines are dashed.
        width: width of its lines, pt.
    """

    color: str
    marker: str
    symbol: str
    dashed: bool = False
    width: float = 1.2


_SIGNS = tuple(
    zip(
        "osD^vP*>h<",
        (
            *("circle", "square", "diamond", "triangle-up", "triangle-down"),
            *("cross", "star", "triangle-right", "hexagon", "triangle-left"),
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
    "by hill climbing": Style(PALETTE[6], "o", "circle"),
    "error": Style(PALETTE[1], "", ""),
    "allowed": Style(PALETTE[-1], "", ""),
    "energy": Style(PALETTE[0], "", ""),
    "work": Style(PALETTE[6], "", "", dashed=True),
    "links": Style("#404040", "o", "circle", width=3.0),
    "wheels": Style(PALETTE[6], "", "", width=6.0),
}
"""Key of a formulation, an integrator or another line -> its style; implicit integrators are
dashed."""


def spelled_out(key: str) -> str:
    """Return the legend text of a key: that of a formulation has its name in the registry."""
    name = FORMULATIONS[key].name if key in FORMULATIONS else key
    return key if name.lower() == key.lower() else f"{key}: {name}"


# ---- Colors on a dark ground ---------------------------------------------------------------------

DARK_GROUND = "#15181c"
"""Ground of a dark page."""
CONTRAST = 4.0
"""Least contrast ratio of a line on a dark ground (WCAG asks 3 of graphics)."""


def on_dark(color: str) -> str:
    """Return a color for a dark ground: white for black, others lightened up to `CONTRAST`."""
    rgb = _rgb(color)
    if rgb == (0.0, 0.0, 0.0):
        return "#ffffff"
    white = 0.0
    while contrast(_hex(_mixed(rgb, white)), DARK_GROUND) < CONTRAST:
        white += 0.05
    return _hex(_mixed(rgb, white))


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colors "#rrggbb", 1 to 21 (WCAG 2)."""
    high, low = sorted((_luminance(first), _luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _rgb(color: str) -> tuple[float, ...]:
    return tuple(int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))


def _hex(rgb: tuple[float, ...]) -> str:
    return "#" + "".join(f"{round(255 * x):02x}" for x in rgb)


def _mixed(rgb: tuple[float, ...], white: float) -> tuple[float, ...]:
    return tuple((1 - white) * x + white for x in rgb)


def _luminance(color: str) -> float:
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in _rgb(color)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
