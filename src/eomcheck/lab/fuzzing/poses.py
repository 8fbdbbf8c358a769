"""Poses at which something is singular, told by the states of a motion on both sides of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.lab.fuzzing.families import Case
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray
from eomcheck.numbers.pivots import EPS


def crossings(cases: Sequence[Case], y: Array, t_end: float) -> Array:
    """Return the number of the first time (m,) behind a pose where a_1 is singular.

    The number of times for none. Such a pose was crossed where the sign of the determinant changes
    on the true motion, whatever a formulation says of it.

    Args:
        cases: scenes of one structure.
        y: the true motion (m, k, 2n), NaN where it is not known.
        t_end: end, s.
    """
    a, dependent = jacobians(cases, y, t_end)
    with np.errstate(all="ignore"):
        signs = np.linalg.slogdet(a[..., list(dependent)]).sign
    signs = np.where(np.isfinite(a).all(axis=(2, 3)), signs, 0.0)
    first = np.full(len(cases), y.shape[1])
    for i in range(len(cases) if a.shape[2] else 0):
        row = signs[i]
        seen = np.flatnonzero(np.abs(row) == 1.0)
        turns = seen[1:][row[seen[1:]] != row[seen[:-1]]]
        first[i] = turns[0] if turns.size else y.shape[1]
    return first


def branchings(cases: Sequence[Case], y: Array, t_end: float) -> Array:
    """Return the number of the first time (m,) behind a pose where a loses rank.

    The number of times for none. There a motion has branches, as where all rods of a linkage are in
    line, and which one it takes is up to rounding. From such a pose on rows of a point the other
    way: what they are of the rows before has an eigenvalue that is not positive.
    """
    a, _ = jacobians(cases, y, t_end)
    first = np.full(len(cases), y.shape[1])
    if not a.shape[2]:
        return first
    a, after = a[:, :-1], np.moveaxis(a[:, 1:], 2, 3)
    known = np.asarray(np.isfinite(a).all(axis=(2, 3)) & np.isfinite(after).all(axis=(2, 3)))
    left, right = a @ np.moveaxis(a, 2, 3), a @ after
    eye = np.eye(a.shape[2])
    left = np.where(known[..., None, None], left, eye)
    right = np.where(known[..., None, None], right, eye)
    regular = np.linalg.cond(left) < 1.0 / EPS
    left = np.where(regular[..., None, None], left, eye)
    directions = np.linalg.eigvals(np.linalg.solve(left, right)).real
    turned: Array = known & ((directions <= 0.0).any(axis=2) | ~regular)
    for i in range(len(cases)):
        places = np.flatnonzero(turned[i])
        first[i] = places[0] + 1 if places.size else y.shape[1]
    return first


def jacobians(cases: Sequence[Case], y: Array, t_end: float) -> tuple[Array, tuple[int, ...]]:
    """Return a (m, k, r, n) on motions y (m, k, 2n), NaN where these are, and what depends."""
    scene, n = cases[0][0], cases[0][0].n
    out = np.full((*y.shape[:2], scene.r, n), np.nan)
    reached = [(i, k) for i, k in np.argwhere(np.isfinite(y).all(axis=2)).tolist()]
    if not scene.r or not reached:
        return out, ()
    times = np.linspace(0.0, t_end, y.shape[1])
    states = [State(y[i, k, :n], y[i, k, n:], float(times[k])) for i, k in reached]
    at = LaneEvaluation([cases[i][0] for i, _ in reached], states)
    a: Any = at.terms.a
    data = np.broadcast_to(
        a.data if isinstance(a, LaneArray) else a[..., None], (*a.shape, at.lanes)
    )
    out[tuple(np.array(reached).T)] = np.moveaxis(data, -1, 0)
    return out, tuple(at.partition.dependent)
