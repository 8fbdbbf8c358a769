"""Motions as a table: what each formulation found at the end, and how well it kept its laws."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.markup import escape

from eomcheck.console import console
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.motion.errors import constraint_error, energy_error
from eomcheck.motion.trajectory import Trajectory


def print_trajectories(trajectories: Iterable[Trajectory]) -> None:
    """Print one line per motion of one scene, then why motions failed."""
    found = list(trajectories)
    scene = found[0].scene
    energy = "energy error" if scene.conserves_energy else "energy left"
    kept = "s", energy, "constraint error / (m/s)"
    rows = [
        (
            one.key,
            f"{one.times[-1]:g}" if one.times.size else "0",
            str(one.steps),
            str(one.right_hand_sides),
            f"{one.seconds:.2g}",
            _energy(one),
            f"{constraint_error(one).max():.1e}" if scene.r and one.times.size else "",
        )
        for one in found
    ]
    columns = *words("formulation"), *numbers("end / s", "steps", "right-hand sides", *kept)
    console.print(table(columns, rows))
    if not scene.conserves_energy:
        console.print(f"The energy is no error here: {scene.why_not_conserved}.")
    for one in found:
        if one.status != "finished":
            console.print(escape(f"{one.key} {one.status}: {one.reason}"), soft_wrap=True)


def _energy(one: Trajectory) -> str:
    if not one.times.size:
        return ""
    if one.scene.conserves_energy:
        return f"{np.abs(energy_error(one)).max():.1e} J"
    return f"{one.energy[-1]:.6g} J of {one.energy[0]:.6g} J"
