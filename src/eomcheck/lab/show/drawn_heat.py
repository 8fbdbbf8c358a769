"""Heat maps drawn by matplotlib."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import SubFigure
from matplotlib.patches import Rectangle

from eomcheck.lab.show.heat import Heat
from eomcheck.lab.show.pyplot import plt

COLORS = plt.get_cmap("YlOrRd")
"""Of heat maps."""


def draw_heat(axes: Axes, heat: Heat) -> None:
    """Draw a heat map into axes: darker is worse."""
    scale = Normalize(*(heat.colors.range or (None, None)))
    for row, (_, boxes) in enumerate(heat.rows.values()):
        for box, (left, right) in zip(boxes, pairwise(heat.edges), strict=True):
            if box is None:
                continue
            # A heading's boxes touch each other, and not those of the next.
            begin = left // 1 + 0.04 + 0.92 * (left % 1)
            where = (begin, row + 0.1), 0.92 * (right - left), 0.8
            empty = np.isnan(box.value)
            look: dict[str, Any] = {"fc": "0.97" if empty else COLORS(scale(box.value)), "lw": 0}
            if box.hatched:
                label = heat.hatched if empty else f"{heat.hatched} in part"
                look |= {"ec": "0.45", "hatch": "//////", "label": label}
            axes.add_patch(Rectangle(*where, **look))
            if box.framed:
                axes.add_patch(Rectangle(*where, fc="none", ec="#0033CC", lw=2, label=heat.framed))
    axes.set_xlim(0, len(heat.columns))
    axes.set_ylim(len(heat.rows), 0)
    heads = [head.replace(" ", "\n", 1) for head in heat.columns]
    axes.set_xticks(np.arange(len(heads)) + 0.5, heads, fontsize=9)
    axes.set_yticks(np.arange(len(heat.rows)) + 0.5, list(heat.rows))
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(heat.title, loc="left", fontsize=12, fontweight="bold")


def color_bar(block: SubFigure, drawn: list[Axes], heat: Heat) -> None:
    """Say what colours tell, and where the limit is."""
    scale = Normalize(*(heat.colors.range or (None, None)))
    shown = plt.cm.ScalarMappable(scale, COLORS)
    bar = block.colorbar(shown, ax=drawn, pad=0.015, fraction=0.025, aspect=24)
    bar.set_label(heat.colors.title)
    bar.ax.axhline(heat.limit, color="black", lw=1.2)
