"""Positions that satisfy the holonomic constraints, found by Newton's method from nearby."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.numbers.contract import Array
from eomcheck.numbers.decompositions import least_squares

CLOSING_STEPS = 50
"""Newton steps after which the search for a closed position gives up."""


def position_residual(at: Quantities) -> Array:
    """Return how far the holonomic constraints, if any, are from being closed (h,), m."""
    function = at.scene.position_residual
    if function is None:
        return np.zeros(0)
    return at.run(function, at.parameters, at.prepared, at.q)


def newton(at: Quantities, q: Array, kept: Any = None) -> tuple[Array, float, bool]:
    """Return (q (n,), last step, whether steps shrank until nothing but rounding is left).

    The smallest correction is taken in each step.

    Args:
        at: the scene and the time.
        q: where the search starts (n,).
        kept: the constraints (k,) that are to be satisfied, by default all.
    """
    if at.scene.position_residual is None:
        return q, 0.0, True
    rows = np.arange(at.scene.r)[at.scene.holonomic]
    places = np.flatnonzero(np.isin(rows, rows if kept is None else kept))
    step = np.inf
    for _ in range(CLOSING_STEPS):
        here = at.elsewhere(q)
        residual, rates = position_residual(here)[places], here.terms.a[rows[places]]
        last, correction = step, least_squares(rates, residual)
        step, q = largest(correction), q - correction
        if not np.isfinite(step):
            return q, np.inf, False
        if step <= allowed_error(max(1.0, largest(q))) and step >= last / 2:
            return q, step, True
    return q, step, False
