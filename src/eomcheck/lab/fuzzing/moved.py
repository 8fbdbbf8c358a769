"""Motions by one formulation: in lanes, or one alone by another integrator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.lab.fuzzing.families import Case
from eomcheck.mechanics.parameters import settable
from eomcheck.motion.batch import Trajectories, simulate_many
from eomcheck.motion.simulate import simulate
from eomcheck.numbers.generic import Array

COARSE, TIGHT = 1e-8, 1e-10
"""Tolerances of the two motions of each formulation; the second one is judged."""

OTHER = "Vern8"
"""The integrator of motions that are looked at alone, which is not the one of lanes."""

TIMES = 65
"""Times at which motions are compared, the start among them."""

MOST_STEPS = 1000
"""A motion that takes more is not gone on with, and counted."""


class Moved(NamedTuple):
    """Motions of m scenes of one structure, at k times, as one formulation says.

    Attributes:
        y: coordinates and velocities (m, k, 2n), NaN where not reached.
        energy: T + U (m, k), J.
        status: of each (m,), see `Trajectories`.
        reason: why it did not reach the end (m,).
    """

    y: Array
    energy: Array
    status: Array
    reason: Array


def moved(
    cases: Sequence[Case], key: str, t_end: float, tolerance: float, most: int = MOST_STEPS
) -> Moved | None:
    """Return motions by one formulation; None where it refuses the scenes as such.

    Args:
        cases: scenes of one structure, with the states in which motions start at t = 0.
        key: the formulation.
        t_end: end, s.
        tolerance: rtol and atol.
        most: steps, at most.
    """
    scene = cases[0][0]
    parameters = {}
    if any(one is not scene for one, _ in cases):
        names = [name for name in settable(scene) if getattr(scene, name) is not None]
        parameters = {name: np.array([getattr(one, name) for one, _ in cases]) for name in names}
        parameters = {name: x for name, x in parameters.items() if x.size}
    q0, v0 = (np.array([state[i] for _, state in cases]) for i in (0, 1))
    times = np.linspace(0.0, t_end, TIMES)
    options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "max_steps": most}
    try:
        with np.errstate(all="ignore"):
            found: Trajectories = simulate_many(
                *(scene, key, t_end),
                **{"q0": q0, "v0": v0, "parameters": parameters, "output_times": times},
                **options,
            )
    except EomcheckError:
        return None
    y = np.concatenate((found.q, found.v), axis=2)
    return Moved(y, found.energy, found.status, found.reason)


def moved_alone(case: Case, key: str, t_end: float, tolerance: float) -> Array | None:
    """Return a motion y (1, k, 2n) by `simulate` and `OTHER`; None where it cannot start."""
    scene, state = case
    times = np.linspace(0.0, t_end, TIMES)
    start: dict[str, Any] = {"q0": state.q, "v0": state.v, "output_times": times}
    try:
        found = simulate(
            *(scene, key, t_end),
            **start,
            rtol=tolerance,
            atol=tolerance,
            integrator=OTHER,
            max_steps=10 * MOST_STEPS,
        )
    except EomcheckError:
        return None
    y = np.full((1, TIMES, 2 * scene.n), np.nan)
    y[0, : len(found.times)] = np.hstack((found.q, found.v))
    return y
