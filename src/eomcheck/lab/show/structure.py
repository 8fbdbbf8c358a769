"""Pictures of matrices: which entries are not zero, and what the blocks are."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from eomcheck.lab.show.canvas import WIDTH, save
from eomcheck.lab.show.colors import DARK, LIGHT, Colors
from eomcheck.lab.show.pyplot import plt
from eomcheck.lab.structures import Matrix, Structure

LARGEST = 0.21
"""Side of an entry, in; less where there are many."""
GAP = 3.0
"""Between matrices, entries."""
BESIDE = 38
"""Up to this width, entries, all matrices stand side by side."""


def draw_structure(structure: Structure, path: Path, dark: bool) -> None:
    """Draw the matrices of a formulation into a file: what it reads left, what it solves right."""
    save(structure_figure(structure, dark), path)


def structure_figure(structure: Structure, dark: bool = False) -> Any:
    """Return the figure of the matrices of a formulation."""
    colors = DARK if dark else LIGHT
    apart = [[one] for one in (*structure.read, *structure.solved)]
    columns = [one for one in ([*structure.read], *([m] for m in structure.solved)) if one]
    if sum(one.entries.shape[1] + GAP for (one,) in apart) + GAP <= BESIDE:
        columns = apart
    across = [max(one.entries.shape[1] for one in column) for column in columns]
    down = [sum(len(one.entries) + GAP for one in column) for column in columns]
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
        for one in column:
            _draw(axes, one, x, y, colors, 72 * side)
            y += len(one.entries) + GAP
    return figure


def _draw(axes: Any, one: Matrix, x: float, y: float, colors: Colors, points: float) -> None:
    """Draw a matrix with its first entry at (x, y); an entry is so many `points` wide."""
    rows, columns = one.entries.shape
    of = {"M": colors.coordinate, "D": colors.coordinate, "a": colors.constraint, "I": colors.faint}
    of |= {"A": colors.constraint, "C": colors.constraint}
    for block in one.blocks:
        known = block.name.lstrip("-") or one.name
        plain = known.rstrip("0123456789ᵀ₁′") if len(known) < 5 else known
        color = of.get(plain, colors.axis)
        part = one.entries[block.rows, block.columns]
        for i, j in np.argwhere(part != 0):
            at = x + block.columns.start + j + 0.06, y + block.rows.start + i + 0.06
            axes.add_patch(Rectangle(at, 0.88, 0.88, color=color, lw=0))
        corner = x + block.columns.start, y + block.rows.start
        if len(one.blocks) > 1:
            axes.add_patch(
                Rectangle(corner, *part.shape[::-1], fill=False, ec=colors.faint, lw=0.8)
            )
        name = block.name if part.any() else "0"
        if len(one.blocks) > 1 and block.name and part.shape[0] <= 2 < part.shape[1]:
            look = {"color": colors.ink, "fontsize": 12, "ha": "left", "va": "center"}
            axes.text(x + columns + 0.3, corner[1] + part.shape[0] / 2, name, **look)
        elif len(one.blocks) > 1 and min(part.shape) > 2:
            middle = corner[0] + part.shape[1] / 2, corner[1] + part.shape[0] / 2
            box = {"boxstyle": "round,pad=0.2", "fc": colors.ground, "ec": "none", "alpha": 0.85}
            size = 15 if name != "0" else 12
            look = {"color": colors.ink, "fontsize": size, "ha": "center", "va": "center"}
            axes.text(*middle, name, bbox=box if name != "0" else None, **look)
    axes.add_patch(Rectangle((x, y), columns, rows, fill=False, ec=colors.ink, lw=1.2))
    named = [name for name, _ in one.columns if name]
    look = {"color": colors.ink, "ha": "center", "va": "bottom"}
    if named:
        start = x
        for name, size in one.columns:
            letters = min(13.0, 0.55 * points * size)
            axes.text(start + size / 2, y - 0.15, name, fontsize=letters, **look)
            start += size
    above = y - 0.25 - (16.0 / points if named else 0.0)
    title = f"{_title(one)}   {rows} × {columns}"
    axes.text(x + columns / 2, above, title, fontsize=12, **look)


def _title(one: Matrix) -> str:
    """Return the name of a matrix, or what it equals, if that says more."""
    base, _, index = one.name.partition("_")
    name = rf"$\mathrm{{{base}}}_\mathrm{{{index}}}$" if index.isalnum() else one.name
    whole = one.blocks[0].name if len(one.blocks) == 1 else ""
    return f"{name} = {whole}" if whole and index.isalpha() else whole or name
