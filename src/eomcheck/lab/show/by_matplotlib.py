"""Charts as figures in files, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, LogLocator, NullFormatter, NullLocator

from eomcheck.lab.show.chart import Axis, Chart, Line, Panel
from eomcheck.lab.show.style import STYLES


def save(figure: Figure, path: Path | BytesIO, dpi: int = 150) -> None:
    """Write a figure that is finished."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)


def legend_above(figure: Figure, axes: Axes | list[Axes], columns: int | None = None) -> None:
    """Put what is drawn in `axes` into a legend above all panels, by default into one row."""
    handles: dict[str, Any] = {}
    for one in axes if isinstance(axes, list) else [axes]:
        lines, labels = one.get_legend_handles_labels()
        handles = dict(zip(labels, lines, strict=True)) | handles
    columns = len(handles) if columns is None else columns
    place = {"loc": "outside upper center", "ncols": columns, "frameon": False}
    figure.legend(list(handles.values()), list(handles), **place)


def draw(chart: Chart, path: Path | BytesIO) -> None:
    """Draw the panels of a chart into one figure; axes that are alike are shared."""
    rows = chart.rows()
    across = max(map(len, rows))
    width, height = chart.size
    grid: Any
    figure, grid = plt.subplots(
        len(rows),
        across,
        figsize=(width * across + 0.6, height * len(rows) + 0.4),
        squeeze=False,
        layout="constrained",
    )
    panels = {
        (i, j): chart.panels[chosen] for i, row in enumerate(rows) for j, chosen in enumerate(row)
    }
    for place in np.ndindex(grid.shape):
        if place not in panels:
            grid[place].set_axis_off()
    for place, panel in panels.items():
        draw_panel(grid[place], panel)
    for (i, j), panel in panels.items():
        left, above = panels.get((i, j - 1)), panels.get((i - 1, j))
        if left is not None and left.y == panel.y:
            _share(grid[i, : j + 1], "y")
            grid[i, j].set_ylabel("")
            grid[i, j].tick_params(labelleft=False)
        if above is not None and above.x == panel.x:
            _share(grid[: i + 1, j], "x")
            grid[i - 1, j].set_xlabel("")
        if above is not None and above.title == panel.title:
            grid[i, j].set_title("")
    drawn = [grid[place] for place in panels]
    names = {label for axes in drawn for label in axes.get_legend_handles_labels()[1]}
    legend_above(figure, drawn, min(len(names), max(3, int(1.4 * (width * across + 0.6) / 1.6))))
    save(figure, path)


def _share(row: Iterable[Axes], which: str) -> None:
    """Give axes the limits that hold what is in each of them."""
    limits = [getattr(axes, f"get_{which}lim")() for axes in row]
    for axes in row:
        getattr(axes, f"set_{which}lim")(min(low for low, _ in limits), max(h for _, h in limits))


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw one panel into axes."""
    if panel.unknown is not None:
        axes.axhspan(1e-300 if panel.y.log else -1e300, panel.unknown, color="0.88", lw=0)
    for line in panel.lines:
        draw_line(axes, line)
    for x in panel.marks:
        axes.axvline(x, color="0.5", lw=1, ls=":")
    if panel.level is not None:
        axes.axhline(panel.level, color="0.5", lw=0.8)
    _set_up(axes, "x", panel.x)
    _set_up(axes, "y", panel.y)
    axes.set_title(panel.title, fontsize=10)
    axes.grid(alpha=0.25)


def draw_line(axes: Axes, line: Line) -> None:
    """Draw one line into axes."""
    style = STYLES[line.key]
    dashes = "--" if line.dashed or style.dashed else "-"
    axes.plot(
        line.x,
        line.y,
        color=style.color,
        marker=style.marker,
        ls=dashes if line.joined else "",
        markevery=line.every,
        ms=4,
        lw=1.2,
        label=line.label or line.key,
    )
    for x, y in ((x, y) for x, y, flag in zip(line.x, line.y, line.hollow, strict=False) if flag):
        axes.plot(x, y, style.marker, ms=4, mfc="white", mec=style.color)


def _set_up(axes: Axes, which: str, axis: Axis) -> None:
    mine = getattr(axes, f"{which}axis")
    getattr(axes, f"set_{which}label")(axis.title)
    if axis.log:
        getattr(axes, f"set_{which}scale")("log")
        mine.set_major_locator(LogLocator(numticks=5))
        mine.set_minor_formatter(NullFormatter())
    low, high = getattr(axes, f"get_{which}lim")()
    if axis.range is not None:
        getattr(axes, f"set_{which}lim")(*axis.range)
    if axis.ticks:
        ticks = [tick for tick in axis.ticks if low <= tick <= high]
        mine.set_major_locator(FixedLocator(ticks))
        mine.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
        mine.set_minor_locator(NullLocator())
