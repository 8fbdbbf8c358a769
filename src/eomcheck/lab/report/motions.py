"""Motions of one scene by several formulations, on a terminal."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from eomcheck.lab.show.table import Sheet, print_sheets, say
from eomcheck.motion.simulate import Trajectory
from eomcheck.motion.trajectory_errors import constraint_error, energy_error


def print_trajectories(trajectories: Iterable[Trajectory]) -> None:
    """Print one line per motion of one scene, then why motions failed."""
    found = list(trajectories)
    scene = found[0].scene
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
    energy = "energy error" if scene.conserves_energy else "energy left"
    kept = "run time (s)", energy, "constraint error (m/s)"
    columns = ("formulation", "end (s)", "steps", "right-hand sides", *kept)
    said = f"The energy is no error here: {scene.why_not_conserved}."
    note = "" if scene.conserves_energy else said
    title = f"{scene.name}: motions from its start"
    print_sheets([Sheet("motions", title, columns, rows, note=note)])
    for one in found:
        if one.status != "finished":
            say(f"{one.key} {one.status}: {one.reason}")


def _energy(one: Trajectory) -> str:
    if not one.times.size:
        return ""
    if one.scene.conserves_energy:
        return f"{np.abs(energy_error(one)).max():.1e} J"
    return f"{one.energy[-1]:.6g} J of {one.energy[0]:.6g} J"
