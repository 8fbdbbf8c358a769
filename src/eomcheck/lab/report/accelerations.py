"""What formulations say of a scene at one state."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import acceleration, velocity
from eomcheck.formulations import formulations_for
from eomcheck.lab.report.units import units
from eomcheck.lab.show.table import Sheet, print_sheets, say
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

MOST = 12
"""Coordinates of a state that are told."""
NOTE = (
    "error bound: of every entry of q̈, m/s² of lengths and rad/s² of angles; rcond: reciprocal "
    "condition number of the matrix that is solved, 0 where it is singular."
)
KKT = "KKT: the matrix of the equations of motion and the constraints together."


def print_accelerations(scene: Scene, u=None, keys: Iterable[str] | None = None) -> int:
    """Print the accelerations in the pose of the scene, and return how many refused.

    Args:
        scene: the scene.
        u: generalized speeds (p,), by default those that it starts with; at rest they need not
            exist.
        keys: formulations, by default all that apply.

    Raises:
        InputError, UnknownNameError: bad speeds, no such formulation, or one that does not apply.
        RefusedError: the scene has no such speeds here.
    """
    chosen = [one.key for one in formulations_for(scene, keys)]
    q, v = scene.initial_state()
    if u is not None:
        v = velocity(scene, q, u) if np.any(u) else np.zeros_like(v)
    rows, refusals = [], []
    for key in chosen:
        try:
            found = acceleration(scene, key, q, v)
        except RefusedError as refusal:
            refusals.append(f"{key} refuses: {refusal}")
            continue
        matrix = min(found.rcond, key=found.rcond.__getitem__)
        i = int(np.argmax(np.abs(found.vdot)))
        most = f"{abs(found.vdot[i]):.10g} {units(scene)[i]}/s²", scene.coordinate_names[i]
        rows.append((key, *most, f"{found.error_bound:.2g}", f"{found.rcond[matrix]:.2g}", matrix))
    columns = ("formulation", "largest |q̈|", "of", "error bound", "smallest rcond", "matrix")
    title = f"{scene.name}: accelerations at its start"
    print_sheets([Sheet("accelerations", title, columns, rows, note=NOTE if rows else "")])
    if any(row[-1] == "KKT" for row in rows):
        say(KKT)
    for said in (*refusals, _state(scene, q, v)):
        say(said)
    return len(refusals)


def _state(scene: Scene, q: Array, v: Array) -> str:
    """Return coordinates and velocities with their units, the first ones of many."""
    names = [*zip(scene.coordinate_names, units(scene), strict=True)][:MOST]
    more = f" and {scene.n - MOST} more" if scene.n > MOST else ""
    at = ", ".join(f"{name} = {x:.4g} {unit}" for (name, unit), x in zip(names, q, strict=False))
    if not v.any():
        return f"At t = 0 s, at rest: {at}{more}."
    rates = (f"{name}: {x:.4g} {unit}/s" for (name, unit), x in zip(names, v, strict=False))
    return f"At t = 0 s: {at}{more}. Their rates: {', '.join(rates)}{more}."
