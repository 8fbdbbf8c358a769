"""State vectors: what each formulation integrates, beside the coordinates.

`Formulation.state` says which (paper, Eqs. (6), (8), (14), (19)):

- "q, v, μ": velocities, and the integrals μ of the multipliers, μ̇ = λ
- "q, v": velocities
- "q, v2": the independent velocities of the partition
- "q, u": generalized speeds
- "q, x": quasi-velocities of a chain
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.evaluation.point import Quantities
from eomcheck.formulations import Formulation
from eomcheck.formulations.em import velocity_of_independent
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array


def number_of_speeds(scene: Scene, formulation: Formulation) -> int:
    """Return how many speeds a state vector holds beside q: v, v2, u or x."""
    return {"q, v2": scene.p, "q, u": scene.p, "q, x": scene.s}.get(formulation.state, scene.n)


def state_size(scene: Scene, formulation: Formulation) -> int:
    """Return the number of entries of a state vector."""
    integrals = scene.r if formulation.state == "q, v, μ" else 0
    return scene.n + number_of_speeds(scene, formulation) + integrals


def state_of(at: Quantities, formulation: Formulation) -> Array:
    """Return the state vector that `formulation` integrates, with integrals of 0."""
    speeds = at.speeds_read(formulation)
    if formulation.state == "q, v2":
        speeds = speeds[at.partition.independent]
    integrals = np.zeros(at.scene.r if formulation.state == "q, v, μ" else 0)
    return np.concatenate((at.q, speeds, integrals))


def state_vector(y: Array, size: int) -> Array:
    """Return y (size,), contiguous doubles: machine code reads what it is given.

    Raises:
        InputError: y has another shape.
    """
    if np.shape(y) != (size,):
        raise InputError(f"y has shape {np.shape(y)}, expected ({size},)")
    return np.ascontiguousarray(y, float)


def take_speeds(at: Quantities, formulation: Formulation, speeds: Any) -> None:
    """Give `at` the velocities that the speeds of a state vector stand for, in any numbers.

    Args:
        at: the scene at the coordinates of the state vector.
        formulation: the formulation.
        speeds: those of the state vector (`number_of_speeds`,).
    """
    here = at.parameters, at.prepared, at.q
    if formulation.state == "q, u":
        at.u = speeds
    elif formulation.state == "q, x":
        at.x, at.v = speeds, at.call(at.scene.chain_velocity, *here, speeds)
    elif formulation.state == "q, v2":
        a, b = at.call(at.scene.constraints, *here)
        at.v = at.call(velocity_of_independent, a, b, speeds, at.partition)
    else:
        at.v = speeds
