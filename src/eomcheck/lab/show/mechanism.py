"""Pictures of mechanisms: a `Sketch` in one pose with everything named."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from matplotlib.lines import Line2D

from eomcheck.lab.show.canvas import WIDTH, canvas, paint, save
from eomcheck.lab.show.colors import DARK, LIGHT
from eomcheck.lab.show.drawing import Drawing
from eomcheck.lab.show.labels import place_labels
from eomcheck.mechanics import sketch as s

LEGEND = {"coordinate": "coordinate", "constraint": "constraint", "axis": "axis of a frame"}


def draw_scene(sketch: s.Sketch, coordinates: Collection[str], path: Path, dark: bool) -> None:
    """Draw a sketch with all names into a file, .svg (transparent), .png or .pdf."""
    figure = scene_figure(sketch, coordinates, dark)[0]
    save(figure, path)


def scene_figure(
    sketch: s.Sketch, coordinates: Collection[str], dark: bool = False
) -> tuple[Any, list[Any]]:
    """Return the figure of a sketch, and the texts of its labels.

    Angles and distances that have the name of a coordinate look like one.
    """
    colors = DARK if dark else LIGHT
    drawing = Drawing(sketch, colors, coordinates)
    axes = canvas(drawing.bounds, colors, WIDTH, below=0.35)
    paint(axes, drawing)
    strokes = [stroke.points for stroke in drawing.strokes]
    texts = place_labels(axes, drawing.labels, strokes, colors.faint)
    lines = [
        Line2D([], [], color=getattr(colors, kind), lw=2.5, label=text)
        for kind, text in LEGEND.items()
        if kind in drawing.kinds
    ]
    if "center" in drawing.kinds:
        look = {"ls": "", "marker": "o", "ms": 6, "color": colors.ink}
        lines.append(Line2D([], [], label="centre of mass", **look))
    place = {"loc": "lower center", "ncols": len(lines), "frameon": False, "fontsize": 11}
    axes.figure.legend(handles=lines, labelcolor=colors.ink, **place)
    return axes.figure, texts
