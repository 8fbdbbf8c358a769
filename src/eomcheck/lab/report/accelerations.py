"""What each formulation says at one state, as a table."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.markup import escape

from eomcheck.console import console
from eomcheck.errors import RefusedError, distinct
from eomcheck.evaluation.dynamics import acceleration, velocity
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS, formulation_of
from eomcheck.lab.show.layout import numbers, table, words
from eomcheck.mechanics.scene import Scene


def print_accelerations(scene: Scene, u, keys: Iterable[str] | None = None) -> int:
    """Print the accelerations in the pose of the scene, and return how many refused.

    Args:
        scene: the scene.
        u: generalized speeds (p,); at rest they need not exist.
        keys: formulations, all by default.

    Raises:
        InputError, UnknownNameError: bad speeds, no such formulation.
        RefusedError: the scene has no such speeds here.
    """
    chosen = [formulation_of(key).key for key in distinct("formulation", keys or FORMULATIONS)]
    q, v = scene.initial_state()
    if np.any(u):
        v = velocity(scene, q, u)
    said = numbers("largest |q̈|", "error bound", "smallest rcond", no_wrap=True)
    found_by = table([*words("formulation"), *said, *words("of")])
    refusals = []
    for key in chosen:
        try:
            found = acceleration(scene, key, q, v)
        except RefusedError as refusal:
            refusals.append(f"{key} refuses: {refusal}")
            continue
        matrix = min(found.rcond, key=found.rcond.__getitem__)
        found_by.add_row(
            key,
            f"{largest(found.vdot):.10g}",
            f"{found.error_bound:.2g}",
            f"{found.rcond[matrix]:.2g}",
            escape(matrix),
        )
    console.print(found_by)
    for refusal in refusals:
        console.print(escape(refusal), soft_wrap=True)
    return len(refusals)
