"""Figures by matplotlib: their legends, and the files that they go to."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from eomcheck.files import replacing
from eomcheck.lab.show.pyplot import plt

HOLLOW = "hollow"
"""Mark of points that are drawn hollow."""


def save(figure: Figure, path: Path, dpi: int = 150) -> None:
    """Write a figure that is finished; a PNG with a palette, which is half the size."""
    with replacing(path) as beside:
        figure.savefig(beside, dpi=dpi)
        plt.close(figure)
        if path.suffix == ".png":
            picture = Image.open(beside).convert("RGB")
            picture.quantize(256, dither=Image.Dither.NONE).save(beside, optimize=True)


def handles_of(drawn: Iterable[Axes]) -> dict[str, Any]:
    """Return label -> what is drawn in any of the axes, each label once."""
    handles: dict[str, Any] = {}
    for axes in drawn:
        for line, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, line)
    return handles


def legend_above(
    figure: Figure, drawn: Iterable[Axes], columns: int, hollow: str = "", title: str = ""
) -> None:
    """Put what is drawn into a legend above all panels, and what `hollow` points are."""
    handles = handles_of(drawn)
    if hollow and any(line.get_gid() == HOLLOW for axes in drawn for line in axes.lines):
        look = {"color": "0.4", "mfc": "white", "ms": 4}
        handles[hollow] = Line2D([], [], ls="", marker="o", **look)
    place = {"loc": "outside upper center", "ncols": min(len(handles), columns), "frameon": False}
    if handles:
        figure.legend(list(handles.values()), list(handles), title=title, **place)
