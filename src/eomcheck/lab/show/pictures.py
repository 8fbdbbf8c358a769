"""Pictures by matplotlib: mechanisms, motions (GIF) and matrix structures.

`draw_scene` paints a `Drawing` with all names and a legend, `draw_motion` paints every k-th sketch
of a motion as a frame, `draw_structure` shows the nonzero entries of a formulation's matrices and
the names of their blocks. SVG files have a transparent background and reproducible bytes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image

from eomcheck.atomic_write import replacing
from eomcheck.lab.figure_data import Matrix, Structure
from eomcheck.lab.show.chart_matplotlib import plt
from eomcheck.lab.show.sketch_drawing import DARK, LIGHT, Colors, Drawing, place_labels
from eomcheck.mechanics import sketch as s

# ---- Axes, strokes and files ---------------------------------------------------------------------

WIDTH = 7.0
"""Width of a picture, in: 700 px."""
MARGIN = 0.09
"""Margin around the drawing, as a share of its larger side."""


def canvas(bounds: np.ndarray, colors: Colors, width: float, below: float = 0.0) -> Any:
    """Return axes that show the points within bounds, m, `width` in wide, with `below` in left free
    under them.
    """
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
    """Add the strokes and dots of a drawing to axes."""
    for stroke in drawing.strokes:
        x, y = stroke.points.T
        if stroke.fill:
            axes.fill(x, y, color=stroke.fill, alpha=0.12, lw=0)
        axes.plot(
            x, y, color=stroke.color, lw=stroke.width, ls=stroke.style, solid_capstyle="round"
        )
        if stroke.head:
            # The last segment of the line gives the direction of the arrow's head.
            arrow = {"arrowstyle": "-|>", "color": stroke.color, "lw": stroke.width}
            arrow |= {"shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
            axes.annotate("", stroke.points[-1], stroke.points[-2], arrowprops=arrow)
    for at, color, size, fill in drawing.dots:
        axes.plot(*at, "o", color=color, ms=size, mfc=fill, mew=1.5)


def save_picture(figure: Any, path: Path) -> None:
    """Write a figure; an SVG with a transparent background and reproducible bytes."""
    with replacing(path) as beside, plt.rc_context({"svg.hashsalt": "eomcheck"}):
        svg = {"transparent": True, "metadata": {"Date": None}} if path.suffix == ".svg" else {}
        figure.savefig(beside, **svg)
        plt.close(figure)


# ---- Mechanisms ----------------------------------------------------------------------------------

LEGEND = {"coordinate": "coordinate", "constraint": "constraint", "axis": "axis of a frame"}


def draw_scene(sketch: s.Sketch, coordinates: Collection[str], path: Path, dark: bool) -> None:
    """Draw a sketch with all names into a file, .svg (transparent), .png or .pdf."""
    figure = scene_figure(sketch, coordinates, dark)[0]
    save_picture(figure, path)


def scene_figure(
    sketch: s.Sketch, coordinates: Collection[str], dark: bool = False
) -> tuple[Any, list[Any]]:
    """Return the figure of a sketch, and the text artists of its labels.

    Angles and distances with the name of a coordinate have the coordinates' color.
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
        style = {"ls": "", "marker": "o", "ms": 6, "color": colors.ink}
        lines.append(Line2D([], [], label="centre of mass", **style))
    layout = {"loc": "lower center", "ncols": len(lines), "frameon": False, "fontsize": 11}
    axes.figure.legend(handles=lines, labelcolor=colors.ink, **layout)
    return axes.figure, texts


# ---- Motions -------------------------------------------------------------------------------------


def draw_motion(
    sketches: Sequence[s.Sketch], times: Sequence[float], path: Path, every: int
) -> None:
    """Draw a motion into a GIF: one frame per `every` sketches, with the paths of traced points."""
    drawings = [Drawing(sketch, LIGHT) for sketch in sketches]
    bounds = np.array([d.bounds for d in drawings])
    extent = np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])
    frames: list[Any] = []
    digits = max(0, 2 - int(np.floor(np.log10(times[-1]))))
    for k in range(0, len(drawings), every):
        drawing = drawings[k]
        axes = canvas(extent, LIGHT, 5.6)
        for trail in np.array([e.trails for e in drawings[: k + 1]]).transpose(1, 2, 0):
            axes.plot(*trail, color=LIGHT.coordinate, lw=1.2)
        paint(axes, drawing)
        axes.text(0.02, 0.03, f"t = {times[k]:.{digits}f} s", transform=axes.transAxes, fontsize=12)
        axes.figure.canvas.draw()
        frame = Image.fromarray(np.asarray(axes.figure.canvas.buffer_rgba())[..., :3])
        frames.append(frame.quantize(24, dither=Image.Dither.NONE))
        plt.close(axes.figure)
    look = {"save_all": True, "append_images": frames[1:], "loop": 0, "optimize": True}
    with replacing(path) as beside:
        frames[0].save(beside, format="GIF", duration=[80] * (len(frames) - 1) + [1200], **look)


# ---- Matrices ------------------------------------------------------------------------------------

LARGEST = 0.21
"""Largest side of a matrix entry, in; smaller in large matrices."""
GAP = 3.0
"""Distance between matrices, in entries."""
BESIDE = 38
"""Largest total width, in entries, up to which all matrices stand side by side."""


def draw_structure(structure: Structure, path: Path, dark: bool) -> None:
    """Draw the matrices of a formulation into a file: inputs on the left, systems solved on the
    right.
    """
    save_picture(structure_figure(structure, dark), path)


def structure_figure(structure: Structure, dark: bool = False) -> Any:
    """Return the figure of the matrices of a formulation."""
    colors = DARK if dark else LIGHT
    apart = [[matrix] for matrix in (*structure.read, *structure.solved)]
    columns = [c for c in ([*structure.read], *([m] for m in structure.solved)) if c]
    if sum(matrix.entries.shape[1] + GAP for (matrix,) in apart) + GAP <= BESIDE:
        columns = apart
    across = [max(matrix.entries.shape[1] for matrix in column) for column in columns]
    down = [sum(len(matrix.entries) + GAP for matrix in column) for column in columns]
    wide, high = sum(across) + GAP * (len(across) + 1), max(down) + 1.0
    side = min(LARGEST, WIDTH / wide)
    wide = WIDTH / side
    figure = plt.figure(figsize=(WIDTH, high * side), dpi=100, facecolor=colors.ground)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, wide), ylim=(high, 0.0))
    axes.set_axis_off()
    free = (wide - sum(across)) / (len(columns) + 1)
    starts = accumulate(across, lambda x, size: x + size + free, initial=free)
    for x, column in zip(starts, columns, strict=False):
        y = GAP
        for matrix in column:
            _draw(axes, matrix, x, y, colors, 72 * side)
            y += len(matrix.entries) + GAP
    return figure


def _draw(axes: Any, matrix: Matrix, x: float, y: float, colors: Colors, points: float) -> None:
    """Draw a matrix with its first entry at (x, y); an entry is `points` pt wide."""
    rows, columns = matrix.entries.shape
    palette = dict.fromkeys("MD", colors.coordinate) | dict.fromkeys("aAC", colors.constraint)
    palette["I"] = colors.faint
    for block in matrix.blocks:
        base = block.name.lstrip("-") or matrix.name
        plain = base.rstrip("0123456789ᵀ₁′") if len(base) < 5 else base
        color = palette.get(plain, colors.axis)
        part = matrix.entries[block.rows, block.columns]
        for i, j in np.argwhere(part != 0):
            at = x + block.columns.start + j + 0.06, y + block.rows.start + i + 0.06
            axes.add_patch(Rectangle(at, 0.88, 0.88, color=color, lw=0))
        corner = x + block.columns.start, y + block.rows.start
        if len(matrix.blocks) > 1:
            axes.add_patch(
                Rectangle(corner, *part.shape[::-1], fill=False, ec=colors.faint, lw=0.8)
            )
        name = block.name if part.any() else "0"
        if len(matrix.blocks) > 1 and block.name and part.shape[0] <= 2 < part.shape[1]:
            look = {"color": colors.ink, "fontsize": 12, "ha": "left", "va": "center"}
            axes.text(x + columns + 0.3, corner[1] + part.shape[0] / 2, name, **look)
        elif len(matrix.blocks) > 1 and min(part.shape) > 2:
            middle = corner[0] + part.shape[1] / 2, corner[1] + part.shape[0] / 2
            box = {"boxstyle": "round,pad=0.2", "fc": colors.ground, "ec": "none", "alpha": 0.85}
            size = 15 if name != "0" else 12
            look = {"color": colors.ink, "fontsize": size, "ha": "center", "va": "center"}
            axes.text(*middle, name, bbox=box if name != "0" else None, **look)
    axes.add_patch(Rectangle((x, y), columns, rows, fill=False, ec=colors.ink, lw=1.2))
    named = [name for name, _ in matrix.columns if name]
    look = {"color": colors.ink, "ha": "center", "va": "bottom"}
    if named:
        start = x
        for name, size in matrix.columns:
            letters = min(13.0, 0.55 * points * size)
            axes.text(start + size / 2, y - 0.15, name, fontsize=letters, **look)
            start += size
    above = y - 0.25 - (16.0 / points if named else 0.0)
    title = f"{_title(matrix)}   {rows} × {columns}"
    axes.text(x + columns / 2, above, title, fontsize=12, **look)


def _title(matrix: Matrix) -> str:
    """Return the title of a matrix: its name, its only block, or an equation of both."""
    base, _, index = matrix.name.partition("_")
    name = rf"$\mathrm{{{base}}}_\mathrm{{{index}}}$" if index.isalnum() else matrix.name
    whole = matrix.blocks[0].name if len(matrix.blocks) == 1 else ""
    return f"{name} = {whole}" if whole and index.isalpha() else whole or name
