"""Charts drawn by matplotlib into figure files, with the Agg backend, which opens no window.

`draw_chart` draws the grid of panels of a chart, on a light or a dark ground; `draw_both` writes an
SVG for each, with a transparent ground, for a page that has both. A figure is as wide as a
telephone can show with letters that can be read. Panels in one row or column whose axes are equal
share their limits and labels, and one legend above all panels spells out the formulations. Ticks
are chosen last, when the limits are known, so that the numbers of narrow panels do not overlap.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import LinearSegmentedColormap, Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import (
    EngFormatter,
    FixedFormatter,
    FixedLocator,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)
from PIL import Image

from eomcheck.atomic_write import replacing
from eomcheck.lab.show.chart import (
    PALETTE,
    STYLES,
    WRONG,
    Axis,
    Box,
    Chart,
    Heat,
    Line,
    Panel,
    contrast,
    on_dark,
    spelled_out,
)
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, Colors

matplotlib.use("Agg")

# ---- Figures -------------------------------------------------------------------------------------

WIDTH, FONT = 5.6, 10.5
"""Width of a figure, in, and size of its letters, pt: 9 px on a page that is 390 px wide."""
LETTER, TEXT_LINE = 0.082, 0.2
"""Mean width of a letter and height of a line of text, in."""
DPI = 200


def draw_chart(chart: Chart, path: Path, dark: bool = False) -> None:
    """Draw a chart into a file: .svg (transparent), .png or .pdf, for a light or a dark ground."""
    with plt.rc_context(settings_on(DARK if dark else LIGHT)):
        save_picture(chart_figure(chart, dark), path, DPI)


def draw_both(chart: Chart, folder: Path) -> list[Path]:
    """Draw NAME.svg and, for a dark ground, NAME-dark.svg into a folder; return the files."""
    paths = both_paths(folder, chart.name)
    for dark, path in enumerate(paths):
        draw_chart(chart, path, bool(dark))
    return paths


def both_paths(folder: Path, name: str) -> list[Path]:
    """Return the paths of a picture for a light and for a dark ground."""
    return [folder / f"{name}.svg", folder / f"{name}-dark.svg"]


def settings_on(colors: Colors) -> dict[Any, Any]:
    """Return matplotlib's settings for a ground: sizes and colors of what is not drawn by us."""
    sizes = "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize"
    sizes += "font.size", "legend.fontsize", "legend.title_fontsize"
    inks = "text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"
    grounds = "figure.facecolor", "axes.facecolor"
    return {
        **dict.fromkeys(sizes, FONT),
        **dict.fromkeys(inks, colors.ink),
        **dict.fromkeys(grounds, colors.ground),
        "grid.color": colors.faint,
        "hatch.linewidth": 0.8,
    }


def color_on(color: str, colors: Colors) -> str:
    """Return a color of a light ground, as it is on the ground of `colors`."""
    return on_dark(color) if colors is DARK else color


def chart_figure(chart: Chart, dark: bool = False) -> Figure:
    """Return the figure of a chart: its grid of panels, with title and legend above."""
    colors = DARK if dark else LIGHT
    rows = [[chart.panels[chosen] for chosen in row] for row in chart.rows()]
    heights = [max(_height(panel, chart.height) for panel in row) for row in rows]
    with plt.rc_context(settings_on(colors)):
        figure = plt.figure(figsize=(WIDTH, sum(heights)), layout="constrained")
        drawn = _draw_rows(figure, rows, heights, colors)
        lines = legend_above(figure, drawn, chart, colors)
    figure.set_size_inches(WIDTH, sum(heights) + TEXT_LINE * (lines + 1))
    _raster_many(drawn)
    return figure


def _height(panel: Panel | Heat, height: float) -> float:
    """Return the height of a panel in a figure, in."""
    if isinstance(panel, Panel):
        return height
    if panel.steep:
        return STEEP_ROW * len(panel.rows) + LETTER * max(map(len, panel.columns)) + 0.1
    shown = len(panel.columns) - len(panel.flat)
    longest = max(map(len, panel.rows))
    return TILE * max(shown, 1) + LETTER * longest + TEXT_LINE * (2 if panel.title else 1) + 0.2


def _draw_rows(
    figure: Figure, rows: Sequence[Sequence[Panel | Heat]], heights: list[float], colors: Colors
) -> list[Axes]:
    """Draw rows of panels and return their axes."""
    across = max(map(len, rows))
    grid: Any = figure.subplots(len(rows), across, squeeze=False, height_ratios=heights)
    shown = {(i, j): panel for i, row in enumerate(rows) for j, panel in enumerate(row)}
    drawn = [grid[place] for place in shown]
    for place in np.ndindex(grid.shape):
        if place not in shown:
            grid[place].set_axis_off()
    for place, panel in shown.items():
        if isinstance(panel, Heat):
            draw_heat(grid[place], panel, colors)
    panels = {place: panel for place, panel in shown.items() if isinstance(panel, Panel)}
    for place, panel in panels.items():
        draw_panel(grid[place], panel, colors)
    for (i, j), panel in panels.items():
        left, above = panels.get((i, j - 1)), panels.get((i - 1, j))
        if left is not None and left.y == panel.y:
            grid[i, j].set_ylabel("")
            if not panel.y.own:
                _share(grid[i, : j + 1], "y")
                grid[i, j].tick_params(labelleft=False)
        if above is not None and above.x == panel.x:
            grid[i - 1, j].set_xlabel("")
            if not panel.x.own:
                _share(grid[: i + 1, j], "x")
                grid[i - 1, j].tick_params(labelbottom=False)
        if above is not None and above.title == panel.title:
            grid[i, j].set_title("")
    letters = int((WIDTH / across - 0.45) / LETTER)
    for (i, j), panel in panels.items():
        axes = grid[i, j]
        wide = bool(panel.x.unit) and across > 2  # labels with a unit
        tick(axes.xaxis, panel.x, most=5 if across == 1 else 2 if wide else 4)
        tick(axes.yaxis, panel.y)
        axes.set_title(fill(axes.get_title(), letters))
        axes.set_ylabel(fill(axes.get_ylabel(), int((heights[i] - 0.3) / LETTER)))
    abscissae = [panel.x for panel in panels.values()]
    if abscissae and all(x == abscissae[0] for x in abscissae) and across > 1:
        for axes in drawn:
            axes.set_xlabel("")
        figure.supxlabel(abscissae[0].title, fontsize=FONT)
    else:
        for place in panels:
            grid[place].set_xlabel(fill(grid[place].get_xlabel(), letters))
    return drawn


MOST_MARKERS = 4000
"""Number of markers from which on an SVG holds them as a picture of dots."""


def _raster_many(drawn: Iterable[Axes]) -> None:
    """Mark points without lines to be drawn as dots where an SVG would be large."""
    clouds = [line for axes in drawn for line in axes.lines if line.get_linestyle() == "None"]
    if sum(len(np.asarray(line.get_xdata())) for line in clouds) > MOST_MARKERS:
        for line in clouds:
            line.set_rasterized(True)


def _share(row: Iterable[Axes], which: str) -> None:
    """Set the common limits of several axes."""
    limits = [getattr(axes, f"get_{which}lim")() for axes in row]
    for axes in row:
        getattr(axes, f"set_{which}lim")(min(low for low, _ in limits), max(h for _, h in limits))


# ---- Panels --------------------------------------------------------------------------------------


def draw_panel(axes: Axes, panel: Panel, colors: Colors = LIGHT) -> None:
    """Draw one panel into axes."""
    for index, band in enumerate(panel.bands):
        color = color_on(STYLES[band.key].color, colors)
        style = {"color": color, "alpha": 0.25 + 0.3 * index, "lw": 0}
        axes.fill_between(band.x, band.low, band.high, label=band.label, **style)
    indices: dict[Any, int] = {name: index for index, name in enumerate(panel.x.categories)}
    for line in panel.lines:
        x = [indices[x] for x in line.x] if indices else line.x
        draw_line(axes, line._replace(x=x), colors)
    for x in panel.marks:
        axes.axvline(x, color=colors.faint, lw=1.2, ls=":")
    if panel.level is not None:
        axes.axhline(panel.level, color=colors.faint, lw=1.0)
    shade: dict[str, Any] = {"color": colors.faint, "alpha": 0.2, "lw": 0}
    if panel.bad is not None:
        axes.axhspan(*panel.bad, **shade)
    _set_up(axes, "x", panel.x)
    _set_up(axes, "y", panel.y)
    if panel.equal:
        axes.set_aspect("equal")
    if panel.unknown is not None:
        limits = axes.get_ylim()
        axes.axhspan(1e-300 if panel.y.log else -1e300, panel.unknown, **shade)
        axes.set_ylim(limits)
    axes.set_title(panel.title)
    axes.grid(alpha=0.3)


GREY = LIGHT.faint
"""Grey of marks in the legend that stand for all lines, and of dotted lines."""
LINE_APPEARANCES: dict[str, dict[str, Any]] = {
    "line": {},
    "thin": {"marker": "", "lw": 0.6, "alpha": 0.5},
    "dotted": {"marker": "", "ls": ":", "color": GREY, "lw": 1.6},
    "crosses": {"marker": "X", "ls": "", "ms": 6},
    "rings": {"marker": "o", "ls": "", "ms": 13, "mfc": "none", "mew": 1.8},
}


def draw_line(axes: Axes, line: Line, colors: Colors = LIGHT) -> None:
    """Draw one line into axes."""
    style = STYLES[line.key]
    color = color_on(style.color, colors)
    dashes = "--" if line.dashed or style.dashed else "-"
    look: dict[str, Any] = {
        "color": color,
        "marker": style.marker,
        "ls": dashes if line.joined else "",
        "ms": 4,
        "lw": style.width,
    } | LINE_APPEARANCES[line.appearance]
    if line.appearance == "rings":
        look["mec"] = color_on(WRONG, colors)
    label = line.label or spelled_out(line.key)
    if line.label and line.appearance == "crosses":
        grey: dict[str, Any] = look | {"color": GREY, "label": label}
        axes.plot([], [], **grey)
        label = "_"
    axes.plot(line.x, line.y, markevery=line.every, label=label, **look)
    empty: dict[str, Any] = {
        "marker": look["marker"],
        "ms": look["ms"],
        "mfc": colors.ground,
        "mec": color,
    }
    for x, y in ((x, y) for x, y, flag in zip(line.x, line.y, line.hollow, strict=False) if flag):
        axes.plot(x, y, mew=0.7, gid=HOLLOW, **empty)


def _set_up(axes: Axes, which: str, axis: Axis) -> None:
    getattr(axes, f"set_{which}label")(axis.title)
    if axis.log:
        getattr(axes, f"set_{which}scale")("log")
    if axis.range is not None:
        getattr(axes, f"set_{which}lim")(*axis.range)
    if axis.categories:
        getattr(axes, f"set_{which}lim")(-0.5, len(axis.categories) - 0.5)


# ---- Heat maps -----------------------------------------------------------------------------------

TILE, STEEP_ROW = 0.31, 0.19
"""Height of a row of a heat map, and of one with upright headings, in."""
COLORS = {
    LIGHT: plt.get_cmap("YlOrRd"),
    DARK: LinearSegmentedColormap.from_list("dark", ("#2b2c2e", "#8a4b12", "#e2761b", "#ffc9a3")),
}
"""Color maps of boxes: the ground's side is good."""
HATCH = "//////"


def draw_heat(axes: Axes, heat: Heat, colors: Colors = LIGHT) -> None:
    """Draw a heat map into axes: colored boxes where it is steep, otherwise bars."""
    (_draw_boxes if heat.steep else _draw_bars)(axes, heat, colors)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(heat.title, loc="left", fontweight="bold")


def _draw_bars(axes: Axes, heat: Heat, colors: Colors) -> None:
    """Draw a tile for each heading and row of a heat map, headings downwards; those below which all
    is good are only listed.
    """
    shown = [head for head in heat.columns if head not in heat.flat]
    for row, head in enumerate(shown):
        for column, boxes in enumerate(heat.under(head)):
            if any(boxes):
                _draw_tile(axes, heat, boxes, column + 0.06, row + 0.94, colors)
    axes.set_xlim(0, len(heat.rows))
    axes.set_ylim(max(len(shown), 1), 0)
    axes.set_xticks(np.arange(len(heat.rows)) + 0.5, [*heat.rows], rotation=90)
    axes.set_yticks(np.arange(len(shown)) + 0.5, shown)
    if heat.flat:
        axes.set_xlabel(fill(f"good throughout: {', '.join(heat.flat)}", int(0.6 * WIDTH / LETTER)))


def _draw_tile(
    axes: Axes, heat: Heat, boxes: Sequence[Box | None], left: float, base: float, colors: Colors
) -> None:
    """Draw the boxes of a row below a heading: bars as high as the values, hatches over hatched
    boxes, neighbours together, and a cross on framed ones.

    Args:
        left, base: lower left corner of the tile, which is 0.88 wide and 0.82 high.
    """
    frame: dict[str, Any] = {"fc": "none", "ec": colors.faint, "lw": 0.4}
    axes.add_patch(Rectangle((left, base), 0.88, -0.82, **frame))
    most, width = (heat.colors.range or (0.0, None))[1] or heat.limit, 0.88 / len(boxes)
    for k, box in enumerate(boxes):
        if box is None or np.isnan(box.value):
            continue
        color, label = PALETTE[1], heat.colors.title
        if box.framed:
            color, label = WRONG, heat.framed
            cross = {"ms": 7, "mew": 2, "color": color_on(WRONG, colors)}
            axes.plot(left + (k + 0.5) * width, base - 0.7, "x", **cross)
        elif box.value >= heat.limit:
            color, label = PALETTE[6], heat.beyond
        look: dict[str, Any] = {"fc": color_on(color, colors), "lw": 0, "label": label}
        height = 0.82 * min(box.value / most, 1.0)
        axes.add_patch(Rectangle((left + k * width, base), width, -height, **look))
    for hatched, run in groupby(enumerate(boxes), lambda x: x[1] is not None and x[1].hatched):
        if hatched:
            indices = [k for k, _ in run]
            where = (left + indices[0] * width, base), len(indices) * width, -0.82
            axes.add_patch(Rectangle(*where, **frame, hatch=HATCH, label=heat.hatched))


def _draw_boxes(axes: Axes, heat: Heat, colors: Colors) -> None:
    """Draw a box for each value of a heat map: further from the ground's color is worse."""
    scale = Normalize(*(heat.colors.range or (None, None)))
    for row, (_, boxes) in enumerate(heat.rows.values()):
        for box, (left, right) in zip(boxes, pairwise(heat.edges), strict=True):
            if box is None:
                continue
            # Boxes below one heading touch each other, but not those of the next.
            begin = left // 1 + 0.04 + 0.92 * (left % 1)
            where = (begin, row + 0.1), 0.92 * (right - left), 0.8
            empty = np.isnan(box.value)
            color = colors.ground if empty else to_hex(COLORS[colors](scale(box.value)))
            look: dict[str, Any] = {"fc": color, "ec": colors.faint, "lw": 0.5}
            if box.hatched:
                label = heat.hatched if empty else f"{heat.hatched} in part"
                look |= {"hatch": HATCH, "label": label}
            axes.add_patch(Rectangle(*where, **look))
            if box.text:
                ink = max((LIGHT.ink, DARK.ink), key=lambda ink: contrast(ink, color))
                axes.text(
                    *((left + right) / 2, row + 0.54, box.text),
                    **{"ha": "center", "va": "center", "fontsize": 8.5, "color": ink},
                )
    axes.set_xlim(0, len(heat.columns))
    axes.set_ylim(len(heat.rows), 0)
    axes.set_xticks(np.arange(len(heat.columns)) + 0.5, [*heat.columns], rotation=90)
    axes.set_yticks(np.arange(len(heat.rows)) + 0.5, [*heat.rows])


# ---- Ticks ---------------------------------------------------------------------------------------


def tick(drawn: XAxis | YAxis, axis: Axis, most: int = 5) -> None:
    """Set at most `most` ticks once the limits are known, so that numbers stand apart."""
    low, high = drawn.get_view_interval()
    if axis.categories:
        # As many as fit, the last one among them.
        step = -(-len(axis.categories) // (most - 1))
        indices = range(len(axis.categories) - 1, -1, -step)
        drawn.set_ticks(indices, [axis.categories[i] for i in indices])
    elif axis.ticks:
        ticks = [tick for tick in axis.ticks if low <= tick <= high]
        drawn.set_major_locator(FixedLocator(ticks))
        drawn.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        drawn.set_minor_locator(NullLocator())
    elif axis.log:
        decades = np.log10(high / low)
        subs = (1.0, 2.0, 5.0) if decades < 1 else (1.0, 3.0) if decades < 2 else (1.0,)
        # Within a factor of four LogLocator ignores its number of ticks.
        narrow = decades < np.log10(4)
        drawn.set_major_locator(MaxNLocator(3) if narrow else LogLocator(subs=subs, numticks=most))
        drawn.set_minor_formatter(NullFormatter())
        if decades < 2:
            drawn.set_major_formatter(StrMethodFormatter("{x:g}"))
    if axis.unit:
        drawn.set_major_formatter(EngFormatter(axis.unit))


# ---- Legends and files ---------------------------------------------------------------------------

HOLLOW = "hollow"
"""Group id of hollow markers."""


def save_picture(figure: Figure, path: Path, dpi: float | None = None) -> None:
    """Write a figure and close it: a transparent SVG, a PNG with a palette, or a PDF."""
    with replacing(path) as beside:
        save_figure(figure, beside, path.suffix.removeprefix("."), dpi)
        if path.suffix == ".png":
            picture = Image.open(beside).convert("RGB")
            picture.quantize(256, dither=Image.Dither.NONE).save(beside, optimize=True)


def save_figure(figure: Figure, file: Any, format: str, dpi: float | None = None) -> None:
    """Write a figure into a path or a binary file and close it; an SVG has reproducible bytes."""
    with plt.rc_context({"svg.hashsalt": "eomcheck"}):
        svg = {"transparent": True, "metadata": {"Date": None}} if format == "svg" else {}
        figure.savefig(file, format=format, dpi=dpi or "figure", **svg)
        plt.close(figure)


def handles_of(drawn: Iterable[Axes]) -> dict[str, Any]:
    """Return label -> legend handle of several axes, each label once."""
    handles: dict[str, Any] = {}
    for axes in drawn:
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, line)
    # Marks that stand for all lines come last.
    return dict(sorted(handles.items(), key=lambda one: _is_grey(one[1])))


def _is_grey(handle: Any) -> bool:
    return isinstance(handle, Line2D) and handle.get_color() == GREY


def legend_above(figure: Figure, drawn: Iterable[Axes], chart: Chart, colors: Colors) -> int:
    """Add the title of a chart and a legend of all lines above all panels; return the number of
    lines of text.
    """
    drawn = list(drawn)
    handles = handles_of(drawn)
    if chart.hollow and any(x.get_gid() == HOLLOW for axes in drawn for x in axes.lines):
        look = {"color": GREY, "mfc": colors.ground, "ms": 4}
        handles[chart.hollow] = Line2D([], [], ls="", marker="o", **look)
    title = "\n".join(fill(line, int(WIDTH / LETTER)) for line in chart.title.splitlines())
    lines = title.count("\n") + 1
    if not handles:
        figure.suptitle(title, fontsize=FONT)
        return lines
    across = max(1, min(len(handles), int(WIDTH / (LETTER * max(map(len, handles)) + 0.55))))
    place = {"loc": "outside upper center", "ncols": across, "frameon": False}
    figure.legend(list(handles.values()), list(handles), title=title, **place)
    return lines + -(-len(handles) // across)
