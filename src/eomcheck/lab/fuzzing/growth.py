"""How errors of motions grow: the largest so far, and what becomes of starts a little apart."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import closed_position
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.moved import COARSE, TIGHT, TIMES, Moved, moved
from eomcheck.lab.fuzzing.velocities import consistent
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array


def starts_nearby(cases: Sequence[Case]) -> tuple[list[Case], list[int]]:
    """Return the cases with states moved by `COARSE`, and which they are of those given.

    All are moved alike, so that what a start is moved by does not depend on those beside it.
    """
    scenes, states, wished, places = [], [], [], []
    n = cases[0][0].n
    random = np.random.default_rng(n)
    away = COARSE * random.choice((-1.0, 1.0), (2, n)) * random.uniform(0.5, 1.0, (2, n))
    for i, (scene, state) in enumerate(cases):
        try:
            q = closed_position(scene, state.q + away[0] * (1.0 + np.abs(state.q)), 0.0)
        except EomcheckError:
            continue  # it cannot be closed there
        scenes.append(scene)
        states.append(State(q, np.zeros(n), 0.0))
        wished.append(state.v + away[1] * (1.0 + np.abs(state.v)))
        places.append(i)
    found, kept = consistent(scenes, states, lambda _: np.array(wished))
    return found, [places[i] for i in kept]


def largest_so_far(x: Array) -> Array:
    """Return the largest so far (m, k); NaN once one is NaN: what comes then is not known."""
    return np.maximum.accumulate(x, axis=1)


def grown(difference: Array, scale: Array) -> Array:
    """Return the largest entry so far (m, k) of differences of states (m, k, 2n), over `scale`."""
    return largest_so_far(np.abs(difference / scale).max(axis=2))


def of_moved_starts(
    cases: Sequence[Case], both: dict[str, tuple[Moved, Moved]], t_end: float, scale: Array
) -> tuple[Array, Array]:
    """Return how far motions are apart (m, k) that begin a little apart, and their energies."""
    apart, energy = (np.full((len(cases), TIMES), np.nan) for _ in range(2))
    nearby, places = starts_nearby(cases)
    # By the formulation that comes furthest: how a motion grows is not a matter of formulation.
    best = max(both, key=lambda key: np.isfinite(both[key][1].y).sum())
    there = moved(nearby, best, t_end, TIGHT) if nearby else None
    if there is not None:
        here = both[best][1]
        apart[places] = grown(there.y - here.y[places], scale[places])
        energy[places] = largest_so_far(np.abs(there.energy - here.energy[places]))
    return apart, energy
