"""Charts as figures in files, drawn by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure

from eomcheck.lab.show.chart import Chart
from eomcheck.lab.show.drawn_heat import color_bar, draw_heat
from eomcheck.lab.show.drawn_panel import draw_panel
from eomcheck.lab.show.figures import legend_above, save
from eomcheck.lab.show.heat import Heat
from eomcheck.lab.show.panel import Panel
from eomcheck.lab.show.pyplot import plt
from eomcheck.lab.show.ticks import tick

WIDEST = 13.0
"""Width up to which blocks of panels stand side by side, in."""


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
    title = fill(charts[0].title, int(13 * size[0])) if len(charts) == 1 else ""
    legend_above(figure, above, max(3, int(0.875 * size[0])), charts[0].hollow, title)
    save(figure, path)


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
    if heats:
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
        # Below each panel it would run into the next one.
        for axes in drawn:
            axes.set_xlabel("")
        block.supxlabel(abscissae[0].title, fontsize="medium")
    return drawn


def _share(row: Iterable[Axes], which: str) -> None:
    """Give axes the limits that hold what is in each of them."""
    limits = [getattr(axes, f"get_{which}lim")() for axes in row]
    for axes in row:
        getattr(axes, f"set_{which}lim")(min(low for low, _ in limits), max(h for _, h in limits))
