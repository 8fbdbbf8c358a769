"""How noisy the answers of a black box are: its rounding, measured from outside.

Over a few points on a line, so close that any smooth function is a polynomial of low degree to more
digits than doubles have, high differences hold nothing but the rounding of the function (J. J. Moré
and S. M. Wild, Estimating computational noise, SIAM J. Sci. Comput. 33, 2011, Algorithm ECnoise,
whose choice of order is replaced by the largest of three).
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb
from typing import NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS


class Line(NamedTuple):
    """Equally spaced points on a line, and the orders of the differences taken over them.

    Attributes:
        points: their number.
        spacing: distance of two, per half width of the range. A term sin(ω x) leaves (ω spacing)ᵏ
            in the difference of order k.
        orders: orders k.
        among: combines the estimates of all orders.
    """

    points: int
    spacing: float
    orders: tuple[int, ...]
    among: Callable[..., Array]


SHORT = Line(9, 2.0**-26, (4, 5, 6), np.fmax.reduce)
"""Nothing smooth is left over on it up to ω = 5000."""

LONG = Line(12, 2.0**-12, (6, 7, 8), np.fmin.reduce)
"""A difference of much larger numbers has steps, and may be constant on the short line. Noise is
the same in all orders; here the smallest estimate counts, as smooth functions leave less in higher
orders, nothing up to ω = 100."""

MIDDLE = Line(12, 2.0**-21, (6, 7, 8), np.fmin.reduce)
"""Steps show on it as on the long line; a vibration that the long line undersamples is smooth."""

DISAGREE = 100.0
"""Ratio of the noise on the long line to that on the short one, above which the cause is asked."""

JUMP = 30.0
"""Ratio of the largest first difference on a line to the median one, above which f jumps there.

A polynomial of degree 3 about an extremum reaches 16.
"""


NEAR = 1e-3
"""Distance from a state, per half width of the ranges, within which a jump is reported."""


def noise(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> Array:
    """Noise of each entry of f near x, a standard deviation, 0 where nothing is rounded.

    The short line decides. Where f is constant between two of its points, or where the long line
    is much noisier, f may have steps, and the long line counts; not where f jumps there once, at
    this very point or near it, nor where it is smooth on the line between, undersampled on the long
    one: neither a jump nor a fast vibration is noise. Nor is a value at x that stands alone among
    those of the long line, as in a branch for angles that are 0: it is left out.

    Args:
        f: function of an array (m,), which returns an array.
        x: center of the lines (m,).
        width: half widths of the ranges of x (m,).
        seed: of the directions of the lines.
    """
    rng = np.random.default_rng(seed)
    near = _values(f, x, width, SHORT, rng)
    far = _values(f, x, width, LONG, rng)
    short, long = _noise_on(SHORT, near), _noise_on(LONG, far)
    steps = (np.diff(near, axis=0) == 0.0).any(axis=0) & ~_vanishes_within_jump(near, far)
    floor = np.fmax(short, EPS * np.abs(near[SHORT.points // 2]))
    asked = ~steps & np.isfinite(short) & (long > DISAGREE * floor)
    if asked.any():
        asked &= ~jumps_on(far)
    smooth = np.zeros(short.shape, bool)
    if asked.any():
        middle = _noise_on(MIDDLE, _values(f, x, width, MIDDLE, rng))
        smooth = asked & (middle < long / DISAGREE)
    rough = steps | (asked & ~smooth) | ~(long > DISAGREE * floor)
    # Where f has no value on one of them, the other tells.
    found = np.where(rough | ~np.isfinite(short), np.fmax(short, long), short)
    alone, rest = _alone(LONG, far)
    return np.where(alone, np.fmin(found, _noise_on(LONG, rest)), found) if alone.any() else found


def _alone(line: Line, values: Array) -> tuple[Array, Array]:
    """Whether each entry at the center of a line is far from all others, and values without it.

    There (points, ...) have at their center what three values on each side interpolate.
    """
    center, rest = line.points // 2, values.copy()
    sides = [values[center - k] + values[center + k] for k in (1, 2, 3)]
    rest[center] = (15.0 * sides[0] - 6.0 * sides[1] + sides[2]) / 20.0
    apart, rounding = np.abs(values[center] - rest[center]), EPS * np.abs(values).max(axis=0)
    alone = apart > DISAGREE * rounding
    return alone & (apart > DISAGREE * _noise_on(line, rest)) if alone.any() else alone, rest


def _vanishes_within_jump(near: Array, far: Array) -> Array:
    """Whether each entry is 0 on a line (points, ...) and jumps on a longer one.

    All changes between steps of a difference of larger numbers are of one size, unlike these.
    """
    change = np.abs(np.diff(far, axis=0))
    least = np.where(change > 0.0, change, np.inf).min(axis=0)
    return (near == 0.0).all(axis=0) & (change.max(axis=0) > JUMP * least)


def _values(f: Callable, x: Array, width: Array, line: Line, rng: np.random.Generator) -> Array:
    direction = rng.uniform(0.5, 1.0, len(x)) * rng.choice((-1.0, 1.0), len(x)) * width
    steps = np.arange(line.points) - line.points // 2
    return np.array([f(x + step * line.spacing * direction) for step in steps])


def _noise_on(line: Line, values: Array) -> Array:
    estimates = []
    for order in line.orders:
        differences = np.diff(values, order, axis=0)
        mean_square = np.mean(np.square(differences), axis=0) / comb(2 * order, order)
        estimates.append(np.sqrt(mean_square))
    return line.among(estimates)


def jumps_on(values: Array) -> Array:
    """Whether each entry jumps between two of the values (points, ...) on a line."""
    change = np.abs(np.diff(values, axis=0))
    least = 2.0**10 * EPS * np.abs(values).max(axis=0)
    return change.max(axis=0) > np.maximum(JUMP * np.median(change, axis=0), least)


def jumps(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> bool:
    """Whether an entry of f jumps within `NEAR` of x, per half width of the ranges; see `noise`.

    On one of the lines any two coordinates go opposite ways: their difference changes on it too.
    """
    line, lines = Line(17, NEAR / 8.0, (), np.fmin.reduce), [width, *opposite(len(x)) * width]
    with np.errstate(all="ignore"):
        # The same directions each time, but for their signs.
        along = (_values(f, x, y, line, np.random.default_rng(seed)) for y in lines)
        return any(bool(jumps_on(values).any()) for values in along)


def opposite(count: int) -> Array:
    """Signs (rows, count): any two entries have opposite ones in one of the rows."""
    digits = np.arange(count) >> np.arange(max(count - 1, 1).bit_length())[:, None] & 1
    return 1.0 - 2.0 * digits


def size_of(value: Array) -> Array:
    """Return the size of each entry, in a square matrix at least that of its diagonal.

    √|M_ii M_kk| has the units of M_ik, and what is summed to an entry is not larger: a sum that
    cancels is as uncertain as its parts.
    """
    size = np.abs(value)
    if value.ndim == 2 and value.shape[0] == value.shape[1]:
        root = np.sqrt(np.abs(np.diagonal(value)))
        size = np.maximum(size, np.outer(root, root))
    return size
