"""Many motions: how far they are apart, as a table and as a figure."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from rich.markup import escape
from rich.table import Table

from eomcheck.console import console
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.many import Trajectories
from eomcheck.numbers.contract import Array

QUANTILES = {"least": 0.0, "quartile": 0.25, "median": 0.5, "3rd quartile": 0.75, "largest": 1.0}
PANELS = 12
"""Coordinates in a figure at most, even ones where there are more."""
COLOR = "#0072B2"


def units(scene: Scene) -> list[str]:
    """Return the unit of each coordinate (n,)."""
    angles = set(range(scene.n)[scene.angle_coordinates])
    return ["rad" if i in angles else "m" for i in range(scene.n)]


def print_many(found: Trajectories) -> None:
    """Print the ends of the motions that came to theirs, their errors, and why others did not."""
    scene, good = found.scenes[0], found.status == "finished"
    table = Table(header_style="bold", title=f"{found.key}, t = {found.t[-1]:g} s")
    table.add_column("", no_wrap=True)
    for column in QUANTILES:
        table.add_column(column, justify="right")
    if good.any():
        rows = zip(scene.coordinate_names, units(scene), found.q[good, -1].T, strict=True)
        for name, unit, x in rows:
            table.add_row(f"{name} / {unit}", *(f"{value:.5g}" for value in _quantiles(x)))
        energy = found.energy[good]
        what, change = "energy / J", energy[:, -1]
        if scene.conserves_energy:
            what, change = "energy error / J", np.abs(energy - energy[:, :1]).max(axis=1)
        table.add_row(what, *(f"{value:.2e}" for value in _quantiles(change)), style="dim")
        if found.constraint_residual is not None:
            worst = found.constraint_residual[good].max(axis=(1, 2))
            errors = (f"{value:.2e}" for value in _quantiles(worst))
            table.add_row("constraint error / (m/s)", *errors, style="dim")
        console.print(table)
    counts = ", ".join(f"{count} {status}" for status, count in Counter(found.status).items())
    console.print(f"{len(found)} motions: {counts}; {found.seconds:.2g} s of integration")
    for i in np.flatnonzero(~good)[:3]:
        console.print(escape(f"motion {i} {found.status[i]}: {found.reason[i]}"), soft_wrap=True)


def _quantiles(x: Array) -> Array:
    """Return the `QUANTILES` along the first axis."""
    return np.quantile(x, list(QUANTILES.values()), axis=0)


def draw_many(found: Trajectories, path: Path) -> None:
    """Draw how far half and all of the motions are from the median, coordinate by coordinate."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    scene, q = found.scenes[0], found.q[found.status == "finished"]
    shown = np.unique(np.linspace(0, scene.n - 1, min(scene.n, PANELS)).astype(int))
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    size = (3.6 * columns, 0.8 + 2.3 * rows)
    figure, axes = plt.subplots(
        rows, columns, figsize=size, sharex=True, squeeze=False, layout="constrained"
    )
    for panel in axes.flat[len(shown) :]:
        panel.set_visible(False)
    for panel, i in zip(axes.flat, shown, strict=False):
        least, low, median, high, largest = _quantiles(q[:, :, i])
        least, low, high, largest = (x - median for x in (least, low, high, largest))
        panel.fill_between(found.t, least, largest, color=COLOR, alpha=0.25, lw=0, label="all")
        panel.fill_between(found.t, low, high, color=COLOR, alpha=0.55, lw=0, label="middle half")
        panel.axhline(0.0, color="black", lw=1.2, label="median")
        panel.set_ylabel(f"({scene.coordinate_names[i]} - median) / {units(scene)[i]}")
        panel.grid(color="0.85")
        panel.set_axisbelow(True)
    for column in range(columns):
        last = [panel for panel in axes[:, column] if panel.get_visible()][-1]
        last.set_xlabel("t / s")
        last.tick_params(labelbottom=True)
    figure.legend(*axes.flat[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(f"{len(q)} motions of {scene.name} by {found.key}")
    figure.savefig(path, dpi=150)
    plt.close(figure)
