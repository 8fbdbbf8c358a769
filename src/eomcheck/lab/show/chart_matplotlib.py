"""Charts drawn by matplotlib into figure files, with the Agg backend, which opens no window.

`draw_charts` puts charts into one figure. Each chart is a block of panels; panels in one row or
column whose axes are equal share their limits and labels, narrow blocks stand side by side, and one
legend stands above all panels. Ticks are chosen last, when the limits are known, so that the
numbers of narrow panels do not overlap.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
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
from eomcheck.lab.show.chart import STYLES, WRONG, Axis, Chart, Heat, Line, Panel

matplotlib.use("Agg")

WIDEST = 13.0
"""Largest total width of blocks side by side, in."""


def draw_charts(charts: Sequence[Chart], path: Path) -> None:
    """Draw charts into one figure file, each as a block of panels with shared equal axes."""
    rows = [chart.rows() for chart in charts]
    sizes = [
        (chart.size[0] * max(map(len, grid)) + 0.6, chart.size[1] * len(grid))
        for chart, grid in zip(charts, rows, strict=True)
    ]
    width = max(width for width, _ in sizes)
    # Narrow blocks stand side by side.
    across = min(len(charts), max(1, int(WIDEST // width)))
    heights = [max(h for _, h in sizes[k : k + across]) for k in range(0, len(sizes), across)]
    size = (width * across, sum(heights) + (0.5 * len(heights) if len(charts) > 1 else 0) + 0.4)
    figure = plt.figure(figsize=size, layout="constrained")
    blocks = figure.subfigures(len(heights), across, squeeze=False, height_ratios=heights).flat
    drawn: list[Axes] = []
    for block, chart, grid in zip(blocks, charts, rows, strict=False):
        if len(charts) > 1:
            block.suptitle(chart.title, fontsize=11)
        drawn += _draw_block(block, [[chart.panels[chosen] for chosen in row] for row in grid])
    above = [axes for axes in drawn if axes.get_legend() is None]
    title = fill(charts[0].title, int(13 * size[0])) if len(charts) == 1 else ""
    legend_above(figure, above, max(3, int(0.875 * size[0])), charts[0].hollow, title)
    save_chart(figure, path)


def _draw_block(block: SubFigure, rows: Sequence[Sequence[Panel | Heat]]) -> list[Axes]:
    """Draw rows of panels and return their axes."""
    grid: Any = block.subplots(len(rows), max(map(len, rows)), squeeze=False)
    shown = {(i, j): panel for i, row in enumerate(rows) for j, panel in enumerate(row)}
    drawn = [grid[place] for place in shown]
    for place in np.ndindex(grid.shape):
        if place not in shown:
            grid[place].set_axis_off()
    heats = [(grid[place], panel) for place, panel in shown.items() if isinstance(panel, Heat)]
    for axes, heat in heats:
        draw_heat(axes, heat)
    if heats and not heats[0][1].steep:
        color_bar(block, drawn, heats[0][1])
    panels = {place: panel for place, panel in shown.items() if isinstance(panel, Panel)}
    for place, panel in panels.items():
        draw_panel(grid[place], panel)
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
    for place, panel in panels.items():
        tick(grid[place].xaxis, panel.x)
        tick(grid[place].yaxis, panel.y)
    abscissae = [panel.x for panel in panels.values()]
    room = 10 * block.bbox.width / block.dpi / len(rows[0])
    if abscissae and all(x == abscissae[0] for x in abscissae) and len(abscissae[0].title) > room:
        # Below each panel the title would run into that of the next one.
        for axes in drawn:
            axes.set_xlabel("")
        block.supxlabel(abscissae[0].title, fontsize="medium")
    return drawn


def _share(row: Iterable[Axes], which: str) -> None:
    """Set the common limits of several axes."""
    limits = [getattr(axes, f"get_{which}lim")() for axes in row]
    for axes in row:
        getattr(axes, f"set_{which}lim")(min(low for low, _ in limits), max(h for _, h in limits))


# ---- Panels --------------------------------------------------------------------------------------


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw one panel into axes."""
    for index, band in enumerate(panel.bands):
        style = {"color": STYLES[band.key].color, "alpha": 0.25 + 0.3 * index, "lw": 0}
        axes.fill_between(band.x, band.low, band.high, label=band.label, **style)
    indices: dict[Any, int] = {name: index for index, name in enumerate(panel.x.categories)}
    for line in panel.lines:
        draw_line(axes, line._replace(x=[indices[x] for x in line.x]) if indices else line)
    for x in panel.marks:
        axes.axvline(x, color="0.5", lw=1, ls=":")
    if panel.level is not None:
        axes.axhline(panel.level, color="0.5", lw=0.8)
    if panel.bad is not None:
        axes.axhspan(*panel.bad, color="0.93", lw=0)
    _set_up(axes, "x", panel.x)
    _set_up(axes, "y", panel.y)
    if panel.equal:
        axes.set_aspect("equal")
    if panel.unknown is not None:
        limits = axes.get_ylim()
        axes.axhspan(1e-300 if panel.y.log else -1e300, panel.unknown, color="0.88", lw=0)
        axes.set_ylim(limits)
    axes.set_title(panel.title, fontsize=10)
    axes.grid(alpha=0.25)
    if panel.legend:
        handles = handles_of([axes])
        axes.legend(
            handles.values(), handles, fontsize=8, frameon=False, ncols=2, columnspacing=1.0
        )


LINE_APPEARANCES: dict[str, dict[str, Any]] = {
    "line": {},
    "thin": {"marker": "", "lw": 0.6, "alpha": 0.5},
    "dotted": {"marker": "", "ls": ":", "color": "0.35", "lw": 1.6},
    "crosses": {"marker": "X", "ls": "", "ms": 6},
    "rings": {"marker": "o", "ls": "", "ms": 13, "mfc": "none", "mec": WRONG, "mew": 1.8},
}


def draw_line(axes: Axes, line: Line) -> None:
    """Draw one line into axes."""
    style = STYLES[line.key]
    dashes = "--" if line.dashed or style.dashed else "-"
    look = {
        "color": style.color,
        "marker": style.marker,
        "ls": dashes if line.joined else "",
        "ms": 4,
        "lw": style.width,
    } | LINE_APPEARANCES[line.appearance]
    axes.plot(line.x, line.y, markevery=line.every, label=line.label or line.key, **look)
    empty = {"marker": look["marker"], "ms": look["ms"], "mfc": "white", "mec": style.color}
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

COLORS = plt.get_cmap("YlOrRd")
"""Color map of heat maps."""


def draw_heat(axes: Axes, heat: Heat) -> None:
    """Draw a heat map into axes: darker is worse."""
    scale = Normalize(*(heat.colors.range or (None, None)))
    for row, (_, boxes) in enumerate(heat.rows.values()):
        for box, (left, right) in zip(boxes, pairwise(heat.edges), strict=True):
            if box is None:
                continue
            # Boxes below one heading touch each other, but not those of the next.
            begin = left // 1 + 0.04 + 0.92 * (left % 1)
            where = (begin, row + 0.1), 0.92 * (right - left), 0.8
            empty = np.isnan(box.value)
            look: dict[str, Any] = {"fc": "0.97" if empty else COLORS(scale(box.value)), "lw": 0}
            if box.hatched:
                label = heat.hatched if empty else f"{heat.hatched} in part"
                look |= {"ec": "0.45", "hatch": "//////", "label": label}
            axes.add_patch(Rectangle(*where, **look))
            if box.text:
                axes.text(
                    *((left + right) / 2, row + 0.54, box.text),
                    **{"ha": "center", "va": "center", "fontsize": 6.5},
                    color="white" if not empty and scale(box.value) > 0.6 else "black",
                )
            if heat.steep:
                axes.add_patch(Rectangle(*where, fc="none", ec="0.6", lw=0.5))
            if box.framed and not heat.steep:
                axes.add_patch(Rectangle(*where, fc="none", ec="#0033CC", lw=2, label=heat.framed))
    axes.set_xlim(0, len(heat.columns))
    axes.set_ylim(len(heat.rows), 0)
    heads = [head.replace(" ", "\n", 1) for head in heat.columns]
    size: dict[str, Any] = {"fontsize": 7, "rotation": 90} if heat.steep else {"fontsize": 9}
    axes.set_xticks(np.arange(len(heads)) + 0.5, heads, **size)
    labels: dict[str, Any] = {"fontsize": 7} if heat.steep else {}
    axes.set_yticks(np.arange(len(heat.rows)) + 0.5, list(heat.rows), **labels)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(heat.title, loc="left", fontsize=12, fontweight="bold")


def color_bar(block: SubFigure, drawn: list[Axes], heat: Heat) -> None:
    """Add the color scale, with its limit."""
    scale = Normalize(*(heat.colors.range or (None, None)))
    shown = plt.cm.ScalarMappable(scale, COLORS)
    bar = block.colorbar(shown, ax=drawn, pad=0.015, fraction=0.025, aspect=24)
    bar.set_label(heat.colors.title)
    bar.ax.axhline(heat.limit, color="black", lw=1.2)


# ---- Ticks ---------------------------------------------------------------------------------------


def tick(drawn: XAxis | YAxis, axis: Axis) -> None:
    """Set ticks once the limits are known, so that the numbers of a narrow panel stand apart."""
    low, high = drawn.get_view_interval()
    if axis.categories:
        # As many as fit, the last one among them.
        step = -(-len(axis.categories) // 4)
        indices = range(len(axis.categories) - 1, -1, -step)
        drawn.set_ticks(indices, [axis.categories[i] for i in indices], fontsize=8)
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
        drawn.set_major_locator(MaxNLocator(3) if narrow else LogLocator(subs=subs, numticks=5))
        drawn.set_minor_formatter(NullFormatter())
        if decades < 2:
            drawn.set_major_formatter(StrMethodFormatter("{x:g}"))
    if axis.unit:
        drawn.set_major_formatter(EngFormatter(axis.unit))


# ---- Legends and files ---------------------------------------------------------------------------

HOLLOW = "hollow"
"""Group id of hollow markers."""


def save_chart(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a finished figure; a PNG with a palette, which is half the size."""
    with replacing(path) as beside:
        figure.savefig(beside, dpi=dpi)
        plt.close(figure)
        if path.suffix == ".png":
            picture = Image.open(beside).convert("RGB")
            picture.quantize(256, dither=Image.Dither.NONE).save(beside, optimize=True)


def handles_of(drawn: Iterable[Axes]) -> dict[str, Any]:
    """Return label -> legend handle of several axes, each label once."""
    handles: dict[str, Any] = {}
    for axes in drawn:
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, line)
    return handles


def legend_above(
    figure: Figure, drawn: Iterable[Axes], columns: int, hollow: str = "", title: str = ""
) -> None:
    """Add a legend of all lines above all panels, with the meaning of `hollow` markers."""
    handles = handles_of(drawn)
    if hollow and any(line.get_gid() == HOLLOW for axes in drawn for line in axes.lines):
        look = {"color": "0.4", "mfc": "white", "ms": 4}
        handles[hollow] = Line2D([], [], ls="", marker="o", **look)
    place = {"loc": "outside upper center", "ncols": min(len(handles), columns), "frameon": False}
    if handles:
        figure.legend(list(handles.values()), list(handles), title=title, **place)
