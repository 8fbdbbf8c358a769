"""Derivatives of a black box by extrapolation, each with the error that it shows itself.

Central differences with ever smaller steps are extrapolated to step 0, and of the whole triangle
that entry is taken which differs least from those that it was made of (C. J. F. Ridders, Accurate
computation of F'(x) and F'(x) F''(x), Advances in Engineering Software 4, 1982). A few steps that
are much shorter must not contradict it: extrapolation converges just as well to the slope of an
average, of a table over many knots or of a vibration over many periods.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.measured import Measured

FIRST = 0.5
"""The first step, per half width of the range."""

STEPS = 10
"""Number of long steps, each half as long as the one before."""

SHORTER, SHORT_STEPS = 8.0, 8
"""Ratio and number of the short steps that follow: down to 2^-34 of the half width."""

COLUMNS = 10
"""Number of columns of the triangle, that of the differences included."""

CONFIRMED = 2
"""Number of shorter steps that must not contradict an estimate."""

FLAT = 2.0**-14
"""Longest step, per half width, that a function without steps feels if shorter ones do."""

ROUNDED = 2.0**10
"""Least step, in roundings of x_k."""


def partial(
    f: Callable[[Array], Array],
    x: Array,
    k: int,
    width: float,
    noise: Array | float = 0.0,
    size: Array | float = 0.0,
    value: Array | None = None,
) -> Measured:
    """Return ∂f/∂x_k with its error.

    The error is twice what an entry differs by from its two neighbours in the triangle, plus the
    noise of f divided by the step. A neighbour may agree by chance, and then the error is too
    small: the constant 32 covers that, with which every error here is multiplied before anything is
    judged (`eomcheck.evaluation.tolerance.C`). With 1 instead right functions fail.

    Each row of the triangle has its estimate, and all shorter steps have to confirm it: where one
    of them differs by more than noise explains, as beside a kink, between the knots of a table or
    of a vibration that longer steps undersample, the error is at least that difference. The
    estimate with the least error is returned. Where the slopes on both sides of x do not meet as
    steps get shorter, the error is at least as large as they differ.

    Where f has no value, or no finite one, at a step, only shorter ones count.

    Args:
        f: function of an array (m,), which returns an array.
        x: point (m,).
        k: index of the entry of x.
        width: half width of the range of x_k.
        noise: of each entry of f at x, see `eomcheck.testing.noise`.
        size: of the terms that each entry of f is summed from.
        value: f at x; None calls f.
    """
    value = np.asarray(f(x) if value is None else value)
    h, high, low, step = _central(f, x, k, width)
    if len(h) < CONFIRMED + 2:
        missing = np.full(value.shape, np.nan)
        return Measured(missing, np.full(missing.shape, np.inf), missing)
    with np.errstate(all="ignore"):
        rounding = EPS * np.maximum(np.abs(high), np.abs(low)) / step
        blur = np.maximum(noise / step, rounding)
        plain = (high - low) / step
        values, errors = _extrapolated(h, plain, blur)
        contradicted = _contradicted(values, plain, blur, rounding)
        kink = _kink(h, (high + low - 2.0 * value) / _like(h, high), blur)
    errors = np.where(_within_step(h / width, plain), np.inf, errors)
    total = np.maximum(errors, contradicted)[1:-CONFIRMED]
    best = np.argmin(total, axis=0)[None]

    def of(rows: Array) -> Array:
        return np.take_along_axis(rows, best, axis=0)[0]

    error = np.maximum(of(total), kink)
    # A derivative much smaller than f over its range counts as 0, if nothing but noise hides it.
    noisy = error <= of(errors[1:-CONFIRMED])
    found = of(values[1:-CONFIRMED])
    return Measured(
        found, error, np.maximum(np.abs(found), np.where(noisy, np.asarray(size) / width, 0.0))
    )


def _like(h: Array, rows: Array) -> Array:
    """Return numbers (rows,) with as many axes as `rows` (rows, ...)."""
    return h.reshape(-1, *(1,) * (rows.ndim - 1))


def _central(
    f: Callable[[Array], Array], x: Array, k: int, width: float
) -> tuple[Array, Array, Array, Array]:
    """Return steps h (rows,), f ahead and behind (rows, ...), and their distance (rows, 1, ...).

    Those that are shorter than the last one where f has no value.
    """
    h, rows = FIRST * width, []
    for number in range(STEPS + SHORT_STEPS):
        if number > 0:
            h /= 2.0 if number < STEPS else SHORTER
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        step = float(ahead[k] - behind[k])
        if step < ROUNDED * EPS * abs(x[k]):
            break
        with np.errstate(all="ignore"):
            high, low = f(ahead), f(behind)
        finite = np.isfinite(high).all() and np.isfinite(low).all()
        rows = [*rows, (h, high, low, step)] if finite else []
    if not rows:
        return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)
    steps, high, low, distance = (np.array(part) for part in zip(*rows, strict=True))
    return steps, high, low, _like(distance, high)


def _extrapolated(h: Array, plain: Array, blur: Array) -> tuple[Array, Array]:
    """Return the best entry of each row of the triangle and its error (rows, ...), entry by entry.

    The error of the first row, which has no neighbours, is infinite.
    """
    best, error, last = plain, np.full(plain.shape, np.inf), plain
    for column in range(1, min(len(h), COLUMNS)):
        ratio = _like((h[:-column] / h[column:]) ** 2, plain)
        here = last[1:] + (last[1:] - last[:-1]) / (ratio - 1.0)
        away = np.abs(here - last[1:]) + np.abs(here - last[:-1]) + 2.0 * blur[column:]
        less = away < error[column:]
        best = np.concatenate((best[:column], np.where(less, here, best[column:])))
        error = np.concatenate((error[:column], np.where(less, away, error[column:])))
        last = here
    return best, error


def _contradicted(values: Array, plain: Array, blur: Array, rounding: Array) -> Array:
    """Return how far each estimate (rows, ...) is from those of shorter steps that contradict it.

    They do where they are further apart than noise explains; or where three differences in
    sequence agree, and rounding does not explain it: noise that looks like a fast vibration.
    """
    apart = np.full(plain.shape, np.inf)
    change = np.abs(np.diff(plain, axis=0))
    apart[1:-1] = np.maximum(change[:-1], change[1:])
    # On a step of what is left of larger numbers f does not change at all.
    least = np.minimum(C * blur, np.maximum(8.0 * apart, C * rounding))
    least = np.where(plain == 0.0, C * blur, least)
    found = np.zeros(values.shape)
    for j in range(1, len(values)):
        away = np.abs(values[:j] - values[j])
        found[:j] = np.fmax(found[:j], np.where(away > least[j], away, 0.0))
    return found


def _within_step(h: Array, plain: Array) -> Array:
    """Whether a difference (rows, ...) is 0 though one of a step that is hardly longer is not.

    f is rounded to multiples of something, as in float32, and measured noise may be 0 by chance.
    """
    felt = (plain != 0.0) & (_like(h, plain) <= FLAT)
    return (plain == 0.0) & np.logical_or.accumulate(felt, axis=0)


def _kink(h: Array, bend: Array, blur: Array) -> Array:
    """Return by how much slopes on both sides of x differ (...), 0 where noise hides it.

    Of a smooth function the second difference per step, `bend` (rows, ...), vanishes with the step.
    Three short steps in sequence must show that it does not.
    """
    ratio = _like(h[:-1] / h[1:], bend)
    left = np.abs(bend[1:] - (bend[:-1] - bend[1:]) / (ratio - 1.0))
    left = np.where(left > 4.0 * C * blur[1:], left, 0.0)[STEPS:]
    if len(left) < 3:
        return np.zeros(bend.shape[1:])
    return np.minimum(np.minimum(left[:-2], left[1:-1]), left[2:]).max(axis=0)


def gradient(f: Callable[[Array], Array], x: Array, width: Array, here: Measured) -> Measured:
    """Return ∂f/∂x, the new axis of length m first.

    Args:
        f: function of an array (m,), which answers an array.
        x: where (m,).
        width: half widths of the ranges of x (m,).
        here: f at x.
    """
    each = [
        partial(f, x, k, float(width[k]), here.error, here.size, here.value) for k in range(len(x))
    ]
    parts = zip(*((d.value, d.error, d.size) for d in each), strict=True)
    return Measured(*(np.array(part) for part in parts))
