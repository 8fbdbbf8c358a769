"""Derivatives of a black box by extrapolation, each with the error that it shows itself.

Central differences with ever smaller steps are extrapolated to step 0, and of the whole triangle
that entry is taken which differs least from those that it was made of (C. J. F. Ridders, Accurate
computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4, 1982).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.contract import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.measured import Measured

FIRST = 0.5
"""The first step, per half width of the range."""

STEPS = 10
"""Number of steps, each half as long as the one before."""


def partial(
    f: Callable[[Array], Array],
    x: Array,
    k: int,
    width: float,
    noise: Array | float = 0.0,
    size: Array | float = 0.0,
) -> Measured:
    """Return ∂f/∂x_k with its error.

    The error is twice what the best entry differs by from its two neighbours in the triangle, plus
    the noise of f divided by the step. A neighbour may agree by chance, and then the error is told
    too small: that is what the constant 32 is for that every error here is multiplied with before
    anything is judged (`eomcheck.evaluation.tolerance.C`). With 1 instead right functions fail.

    Where f has no value, or no finite one, at a step, only shorter ones count. And where the plain
    differences of the shortest steps do not settle, as beside a kink or of a vibration that is
    faster than these steps show, the error is as large as they differ.

    Args:
        f: function of an array (m,), which answers an array.
        x: where (m,).
        k: along which entry.
        width: half width of the range of x_k.
        noise: of each entry of f at x, see `eomcheck.testing.noise`.
        size: of what each entry of f is summed from.
    """
    above: list[Array] = []  # the row before, entry by entry of the triangle
    best: Measured | None = None
    plain: list[Array] = []
    blur: Array | float = 0.0
    for row in range(STEPS):
        ahead, behind = x.copy(), x.copy()
        h = FIRST * width / 2**row
        ahead[k] += h
        behind[k] -= h
        step = ahead[k] - behind[k]
        with np.errstate(all="ignore"):
            high, low = f(ahead), f(behind)
            blur = np.maximum(noise, EPS * np.maximum(np.abs(high), np.abs(low))) / step
            here = [(high - low) / step]
            for column, left in enumerate(above, start=1):
                here.append(here[-1] + (here[-1] - left) / (4.0**column - 1.0))
                away = np.abs(here[-1] - here[-2]) + np.abs(here[-1] - left)
                best = _better(best, here[-1], away + 2.0 * blur)
        # A row without a value starts the triangle anew.
        above = here if np.isfinite(here[0]).all() else []
        plain = [*plain, here[0]] if above else []
    if best is None:
        missing = np.full(np.shape(f(x)), np.nan)
        return Measured(missing, np.full(missing.shape, np.inf), missing)
    error = np.maximum(best.error, _unsettled(best.value, plain, blur))
    # What is much smaller than f over its range counts as 0.
    return Measured(best.value, error, np.maximum(np.abs(best.value), size / width))


def _unsettled(best: Array, plain: list[Array], blur: Array | float) -> Array:
    """Return how far differences of short steps are from settling at `best`; 0 where they do.

    Of a smooth function each is four times closer than the one before, until noise is left.
    """
    if len(plain) < 3:
        return np.zeros(best.shape)
    *_, before, late, last = plain
    change, earlier = np.abs(last - late), np.abs(late - before)
    away = np.abs(last - best)
    settled = (change <= 0.6 * earlier + C * blur) & (away <= 2.0 * change + C * blur)
    return np.where(settled, 0.0, np.maximum(change, away))


def _better(best: Measured | None, value: Array, error: Array) -> Measured:
    """Return, entry by entry, what has the smaller error."""
    error = np.where(np.isfinite(error), error, np.inf)
    if best is None:
        return Measured(np.asarray(value), error, error)
    less = error < best.error
    error = np.where(less, error, best.error)
    return Measured(np.where(less, value, best.value), error, error)


def gradient(f: Callable[[Array], Array], x: Array, width: Array, here: Measured) -> Measured:
    """Return ∂f/∂x, the new axis of length m first.

    Args:
        f: function of an array (m,), which answers an array.
        x: where (m,).
        width: half widths of the ranges of x (m,).
        here: f at x.
    """
    each = [partial(f, x, k, float(width[k]), here.error, here.size) for k in range(len(x))]
    parts = zip(*((d.value, d.error, d.size) for d in each), strict=True)
    return Measured(*(np.array(part) for part in parts))
