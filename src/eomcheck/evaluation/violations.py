"""Constraint violations of velocities, and how large rounding alone may make them."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import NOTICEABLE, allowed_error, largest
from eomcheck.numbers.generic import Array
from eomcheck.numbers.noise import SAMPLES, STEP, Noise

SLIP = 4.0
"""Steps by which v violates each constraint: changes may be half a step and cancel between rows,
where the v that is looked at violates all by what is allowed, and with the worst signs."""


def violation(at: Evaluation, v: Array) -> tuple[Array, Array]:
    """Return (a v + b, what rounding allows of it), each (r,), m/s; `at` has constraints."""
    a, b = at.terms.a, at.terms.b
    with np.errstate(all="ignore"):
        residual = a @ v if b is None else a @ v + b
        size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
        return residual, allowed_error(1.0) * size


def velocity_perturbation(at: Evaluation, noise: Noise) -> Array:
    """Return changes of v: of its entries, and within what `check_consistent` lets pass."""
    change = noise.perturb(at.v) - at.v
    if at.terms.a is None:
        return change
    allowed = at.cached(allowed_violation)
    residual = allowed / allowed_error(1.0) * SLIP * noise.changes((at.scene.r,))
    Q, R, rows = at.cached(_constraint_factors)
    with np.errstate(all="ignore"):
        try:
            slip = Q @ solve_triangular(R, residual[rows], trans=1, check_finite=False)
        except (np.linalg.LinAlgError, ValueError):  # dependent constraints
            return change
    return change + slip if np.isfinite(slip).all() else change


def allowed_violation(at: Evaluation) -> Array:
    """Return how large |a v + b| (r,) may be by rounding alone, m/s, at an `at` with constraints.

    C ε (|a| |v| + |b|), and where that does not explain it, with the largest change of a and b
    besides that rounding the coordinates makes: a row of nothing but cos(π/2) has no size itself.
    """
    residual, allowed = violation(at, at.v)
    if (np.abs(residual) <= allowed).all():
        return allowed
    (_, _, _, a, _, b), changes = at.terms, [np.zeros_like(allowed)]
    for seed in range(SAMPLES):
        q = Noise(seed).perturb(at.q)
        near = Evaluation(at.scene, q, at.v, at.t).terms
        change = np.abs(near.a - a) @ np.abs(at.v)
        changes.append(change if b is None else change + np.abs(near.b - b))
    return allowed + allowed_error(1.0) * np.max(changes, axis=0) / STEP


def _constraint_factors(at: Evaluation) -> Any:
    """Return Q (n, k) and R (k, k) with aᵀ = Q R of the constraints (k,) that are independent.

    Of all r where none is clearly redundant; last come the constraints.
    """
    factors: Any = partial(qr, mode="economic", check_finite=False)
    a = at.terms.a
    Q, R = factors(a.T)
    diagonal = np.abs(np.diagonal(R))
    least = diagonal.min(initial=np.inf)
    if least <= NOTICEABLE * largest(R) or len(a) > len(R):
        with suppress(RefusedError):
            kept = at.independent_partition.kept
            kept = np.arange(len(a)) if kept is None else kept
            return *factors(a[kept].T), kept
    return Q, R, np.arange(len(a))
