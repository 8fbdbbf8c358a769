"""Charts as figures in files, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
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

from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.style import STYLES

WIDEST = 13.0
"""Width up to which blocks of panels stand side by side, in."""
HOLLOW = "hollow"
"""Mark of points that are drawn hollow."""


def save(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure that is finished; a PNG with a palette, which is half the size."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)
    if path.suffix == ".png":
        picture = Image.open(path).convert("RGB")
        picture.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def _handles(drawn: Iterable[Axes]) -> dict[str, Any]:
    """Return label -> what is drawn in any of the axes, each label once."""
    handles: dict[str, Any] = {}
    for axes in drawn:
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, line)
    return handles


def legend_above(figure: Figure, drawn: Iterable[Axes], columns: int, hollow: str = "") -> None:
    """Put what is drawn into a legend above all panels, and what `hollow` points are."""
    handles = _handles(drawn)
    if hollow and any(line.get_gid() == HOLLOW for axes in drawn for line in axes.lines):
        look = {"color": "0.4", "mfc": "white", "ms": 4}
        handles[hollow] = Line2D([], [], ls="", marker="o", **look)
    place = {"loc": "outside upper center", "ncols": min(len(handles), columns), "frameon": False}
    if handles:
        figure.legend(list(handles.values()), list(handles), **place)


def draw(charts: Sequence[Chart], path: Path) -> None:
    """Draw charts into one figure, each a block of panels; axes that are alike are shared."""
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
    legend_above(figure, above, max(3, int(0.875 * size[0])), charts[0].hollow)
    save(figure, path)


def _draw_block(block: SubFigure, rows: Sequence[Sequence[Panel]]) -> list[Axes]:
    """Draw rows of panels and return their axes."""
    grid: Any = block.subplots(len(rows), max(map(len, rows)), squeeze=False)
    panels = {(i, j): panel for i, row in enumerate(rows) for j, panel in enumerate(row)}
    for place in np.ndindex(grid.shape):
        if place not in panels:
            grid[place].set_axis_off()
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
        _tick(grid[place].xaxis, panel.x)
        _tick(grid[place].yaxis, panel.y)
    return [grid[place] for place in panels]


def _share(row: Iterable[Axes], which: str) -> None:
    """Give axes the limits that hold what is in each of them."""
    limits = [getattr(axes, f"get_{which}lim")() for axes in row]
    for axes in row:
        getattr(axes, f"set_{which}lim")(min(low for low, _ in limits), max(h for _, h in limits))


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw one panel into axes."""
    for line in panel.lines:
        draw_line(axes, line)
    for x in panel.marks:
        axes.axvline(x, color="0.5", lw=1, ls=":")
    if panel.level is not None:
        axes.axhline(panel.level, color="0.5", lw=0.8)
    _set_up(axes, "x", panel.x)
    _set_up(axes, "y", panel.y)
    if panel.unknown is not None:
        limits = axes.get_ylim()
        axes.axhspan(1e-300 if panel.y.log else -1e300, panel.unknown, color="0.88", lw=0)
        axes.set_ylim(limits)
    axes.set_title(panel.title, fontsize=10)
    axes.grid(alpha=0.25)
    if panel.legend:
        handles = _handles([axes])
        axes.legend(handles.values(), handles, fontsize=8, frameon=False)


def draw_line(axes: Axes, line: Line) -> None:
    """Draw one line into axes."""
    style = STYLES[line.key]
    dashes = "--" if line.dashed or style.dashed else "-"
    axes.plot(
        line.x,
        line.y,
        color=style.color,
        marker=style.marker if line.look == "line" else "X",
        ls=dashes if line.joined and line.look == "line" else "",
        markevery=line.every,
        ms=4,
        lw=1.2,
        label=line.label or line.key,
    )
    for x, y in ((x, y) for x, y, flag in zip(line.x, line.y, line.hollow, strict=False) if flag):
        axes.plot(x, y, style.marker, ms=4, mfc="white", mec=style.color, mew=0.7, gid=HOLLOW)


def _set_up(axes: Axes, which: str, axis: Axis) -> None:
    getattr(axes, f"set_{which}label")(axis.title)
    if axis.log:
        getattr(axes, f"set_{which}scale")("log")
    if axis.range is not None:
        getattr(axes, f"set_{which}lim")(*axis.range)


def _tick(drawn: XAxis | YAxis, axis: Axis) -> None:
    """Choose ticks once the limits are known, so that the numbers of a narrow panel stand apart."""
    low, high = drawn.get_view_interval()
    if axis.ticks:
        ticks = [tick for tick in axis.ticks if low <= tick <= high]
        drawn.set_major_locator(FixedLocator(ticks))
        drawn.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        drawn.set_minor_locator(NullLocator())
    elif axis.log:
        decades = np.log10(high / low)
        subs = (1.0, 2.0, 5.0) if decades < 1 else (1.0, 3.0) if decades < 2 else (1.0,)
        # Within a factor of four LogLocator would take as many ticks as it likes.
        narrow = decades < np.log10(4)
        drawn.set_major_locator(MaxNLocator(3) if narrow else LogLocator(subs=subs, numticks=5))
        drawn.set_minor_formatter(NullFormatter())
        if decades < 2:
            drawn.set_major_formatter(StrMethodFormatter("{x:g}"))
    if axis.unit:
        drawn.set_major_formatter(EngFormatter(axis.unit))
