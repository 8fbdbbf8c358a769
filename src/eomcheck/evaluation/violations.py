"""Constraint violations of velocities, and the violations that rounding alone explains.

The violation of velocities v is |a v + b|, row by row. Rounding explains C ε (|a| |v| + |b|), more
if the coordinates' own rounding changes a and b by more. Perturbed samples of an evaluation have
perturbed velocities that violate the constraints by as much as is allowed.
"""

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
"""Violation of each constraint by perturbed velocities, in steps: perturbations may be as small as
half a step and cancel between rows, while the v of a state may violate all rows by the allowed
amount and with the worst signs."""


def violation(at: Evaluation, v: Array) -> tuple[Array, Array]:
    """Return the signed residual a v + b and its allowed rounding error, each (r,), m/s.

    `at` has constraints.
    """
    a, b = at.terms.a, at.terms.b
    with np.errstate(all="ignore"):
        residual = a @ v if b is None else a @ v + b
        size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
        return residual, allowed_error(1.0) * size


def velocity_perturbation(at: Evaluation, noise: Noise) -> Array:
    """Return perturbations of v (n,): of its entries, and within the allowed violation."""
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
    """Return the |a v + b| (r,) that rounding alone explains, m/s; `at` has constraints.

    It is C ε (|a| |v| + |b|), and if that does not explain the residual, the largest change of a
    and b by rounding of the coordinates is added: the only entry of a row may be cos(π/2), whose
    size is rounding error.
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
    """Return Q (n, k), R (k, k) with aᵀ = Q R for independent constraints, and their indices (k,).

    They are all r constraints if none is clearly redundant.
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
