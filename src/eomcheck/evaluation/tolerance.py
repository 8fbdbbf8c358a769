"""The tolerance of a comparison: allowed error = C · κ · ε · scale.

There is no tolerance to choose. scale is the size of a quantity and κ its condition number; their
product, the sensitivity, is measured at every state by perturbation analysis
(`eomcheck.numbers.noise`): it is the change of the quantity, per relative change, when every number
that its computation reads is perturbed relative to itself and every matrix that it solves by the
backward error of elimination. It includes the condition numbers of the matrices, and the
cancellation before and after them, which a matrix alone does not show. ε is the spacing of float64
at 1, twice its unit roundoff: that of both sides. For an engine that computes with fewer digits it
is the sum of both, u + 2⁻⁵³.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from eomcheck.numbers.batch_arrays import BatchArray, batch_data, batch_size
from eomcheck.numbers.generic import EPS, Array

C = 32.0
"""The constant factor of every tolerance.

It has to exceed true error / (κ ε scale) at every state: at most 1.37 over 1500 random states of
1 to 40 links (`eomcheck study accuracy --links 1..40 --examples 1500 --seed 1`).
"""

UNIT_ROUNDOFF = EPS / 2
"""Unit roundoff u of float64, 2⁻⁵³: the largest relative error of rounding a number."""

HUGE = 1e100
"""Size of inputs above which the products in terms can overflow."""

HUGE_IN_FLOAT32 = 1e12
"""The same of float32, whose largest number is about its third power."""

INCONCLUSIVE = 1e-3
"""Largest allowed error / |reference| of a comparison; above it the result is inconclusive."""


NOTICEABLE = 1e-6
"""Largest relative error of a result without a refusal or an error bound that reports it."""


UNDERFLOW = 2.0**-900
"""Largest error that underflow alone may cause: of a quantity that vanishes, it always passes."""

UNDERFLOW_IN_FLOAT32 = 2.0**-100
"""The same of float32, whose smallest normal number is 2⁻¹²⁶."""


def allowed_error(sensitivity: float, unit_roundoff: float = UNIT_ROUNDOFF) -> float:
    """Return C · ε · sensitivity, where sensitivity = κ · scale and ε = u + 2⁻⁵³.

    ε is the sum of the unit roundoffs of what is compared, u, and of our side, which is in float64.
    """
    return C * (unit_roundoff + UNIT_ROUNDOFF) * sensitivity


def well_conditioned(rcond: Mapping[str, Any], unit_roundoff: float = UNIT_ROUNDOFF) -> Any:
    """Return whether C κ ε stays below `INCONCLUSIVE` for matrices solved; of a batch (B,).

    Args:
        rcond: their reciprocal condition numbers by name, one at least.
        unit_roundoff: u of the numbers in which they are solved.
    """
    with np.errstate(all="ignore"):
        least = np.min(list(rcond.values()), axis=0)
        return allowed_error(1.0, unit_roundoff) / least <= INCONCLUSIVE


def underflow_error(unit_roundoff: float) -> float:
    """Return the largest error that underflow alone may cause in numbers of this unit roundoff.

    Numbers with fewer digits than float64 have the range of float32, as bfloat16 has.
    """
    return UNDERFLOW if unit_roundoff <= UNIT_ROUNDOFF else UNDERFLOW_IN_FLOAT32


def huge_input(unit_roundoff: float) -> float:
    """Return the size of inputs above which products can overflow, see `underflow_error`."""
    return HUGE if unit_roundoff <= UNIT_ROUNDOFF else HUGE_IN_FLOAT32


def rounded(x: Any, unit_roundoff: float) -> Any:
    """Return float64 numbers rounded to the nearest ones of a unit roundoff, of the same shape."""
    significand, exponent = np.frexp(x)
    digits = 1.0 / unit_roundoff
    return np.ldexp(np.rint(significand * digits) / digits, exponent)


def can_overflow(*inputs: Array) -> bool:
    """Return whether inputs are so large that intermediate products may overflow."""
    return max(map(largest, inputs)) > HUGE


def largest(x: Any) -> Any:
    """Return the largest magnitude in x (0 if it is empty, inf if anything is not finite).

    For a batch it is the largest magnitude of each element.
    """
    if type(x) is not np.ndarray or x.dtype == object:
        if count := batch_size(x):
            return BatchArray(largest_of_each(batch_data(x, count)))
        x = np.asarray(x, dtype=np.float64)
    # As the method `max`, without its overhead in Python: this function is called very often.
    size = float(np.maximum.reduce(np.abs(x), axis=None, initial=0.0))
    return size if math.isfinite(size) else math.inf


def largest_of_each(x: Array) -> Array:
    """Return the largest magnitudes (k,) in x[0], x[1], ..., each as `largest` does."""
    sizes = np.maximum.reduce(np.abs(x.reshape(len(x), -1)), axis=1, initial=0.0)
    return np.where(np.isfinite(sizes), sizes, np.inf)


def larger(x: Any, y: Any) -> Any:
    """Return the larger of two numbers, element by element of a batch."""
    return np.maximum(x, y) if batch_size((x, y)) else max(x, y)
