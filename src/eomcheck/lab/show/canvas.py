"""Axes for a picture, strokes painted on them, and the file that it goes to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.files import replacing
from eomcheck.lab.show.colors import Colors
from eomcheck.lab.show.drawing import Drawing
from eomcheck.lab.show.pyplot import plt

WIDTH = 7.0
"""Width of a picture, in: 700 px."""
MARGIN = 0.09
"""Around what is drawn, of the larger side."""


def canvas(bounds: np.ndarray, colors: Colors, width: float, below: float = 0.0) -> Any:
    """Return axes that show what is between bounds, as wide as a page, and `below` free, in."""
    margin = MARGIN * np.ptp(bounds, axis=0).max()
    low, high = bounds[0] - margin, bounds[1] + margin
    height = width * (high[1] - low[1]) / (high[0] - low[0])
    if height > 0.8 * width:
        wider = (high[1] - low[1]) / 0.8
        middle = (low[0] + high[0]) / 2
        low[0], high[0], height = middle - wider / 2, middle + wider / 2, 0.8 * width
    if height < 0.4 * width:
        taller, middle = 0.4 * (high[0] - low[0]), (low[1] + high[1]) / 2
        low[1], high[1], height = middle - taller / 2, middle + taller / 2, 0.4 * width
    figure = plt.figure(figsize=(width, height + below), dpi=100, facecolor=colors.ground)
    axes = figure.add_axes((0.0, below / (height + below), 1.0, height / (height + below)))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    return axes


def paint(axes: Any, drawing: Drawing) -> None:
    """Put the strokes and dots of a drawing on axes."""
    for stroke in drawing.strokes:
        x, y = stroke.points.T
        if stroke.fill:
            axes.fill(x, y, color=stroke.fill, alpha=0.12, lw=0)
        axes.plot(
            x, y, color=stroke.color, lw=stroke.width, ls=stroke.style, solid_capstyle="round"
        )
        if stroke.head:
            # The last bit of the line gives the direction of the head.
            arrow = {"arrowstyle": "-|>", "color": stroke.color, "lw": stroke.width}
            arrow |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
            axes.annotate("", stroke.points[-1], stroke.points[-2], arrowprops=arrow)
    for at, color, size, fill in drawing.dots:
        axes.plot(*at, "o", color=color, ms=size, mfc=fill, mew=1.5)


def save(figure: Any, path: Path) -> None:
    """Write a figure, an SVG without a ground and with the same bytes every time."""
    with replacing(path) as beside, plt.rc_context({"svg.hashsalt": "eomcheck"}):
        svg = {"transparent": True, "metadata": {"Date": None}} if path.suffix == ".svg" else {}
        figure.savefig(beside, **svg)
        plt.close(figure)
