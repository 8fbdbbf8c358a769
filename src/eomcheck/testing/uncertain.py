"""Uncertain arrays (`UncertainArray`): numerical noise and finite differences of a black box.

A black box cannot be replayed with perturbed operations (Monte Carlo arithmetic) as a scene can. So
the error of its results is measured from outside, and each sum and product of `UncertainArray`
arrays propagates it, to first order, and adds its own rounding error.

Numerical noise: over a few points on a line, so close that any smooth function is a polynomial of
low degree to more digits than float64 has, high differences hold nothing but the rounding of the
function (J. J. Moré and S. M. Wild, Estimating computational noise, SIAM J. Sci. Comput. 33, 2011,
Algorithm ECnoise, whose choice of order is replaced by the largest of three).

Derivatives: central finite differences with ever smaller steps are extrapolated to step 0, and of
the whole extrapolation triangle that entry is taken which differs least from those that it was
computed from (C. J. F. Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in
Engineering Software 4, 1982). A few steps that are much shorter must not contradict it:
extrapolation converges just as well to the slope of an average, of a table over many knots or of a
vibration over many periods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb
from typing import Any, NamedTuple

import numpy as np

from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import EPS, Array

# ---- Arrays with errors --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class UncertainArray:
    """Array with an error estimate of each entry.

    The allowed error is C times the estimate, see `eomcheck.evaluation.tolerance.C`.

    Attributes:
        value: the array.
        error: error estimate of each entry, not negative, same shape.
        size: size of the terms that each entry is summed from, which cancel where the entry is
            smaller, same shape.
    """

    value: Array
    error: Array
    size: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.value.shape

    @property
    def T(self) -> UncertainArray:
        """Transposed array."""
        return UncertainArray(self.value.T, self.error.T, self.size.T)

    def __getitem__(self, index: Any) -> UncertainArray:
        return UncertainArray(*(np.asarray(x[index]) for x in (self.value, self.error, self.size)))

    def __neg__(self) -> UncertainArray:
        return UncertainArray(-self.value, self.error, self.size)

    def __add__(self, other: UncertainArray) -> UncertainArray:
        size = self.size + other.size
        return UncertainArray(self.value + other.value, self.error + other.error + EPS * size, size)

    def __sub__(self, other: UncertainArray) -> UncertainArray:
        return self + -other

    def __mul__(self, factor: float) -> UncertainArray:
        return UncertainArray(
            self.value * factor, self.error * abs(factor), self.size * abs(factor)
        )

    __rmul__ = __mul__

    def __matmul__(self, other: UncertainArray) -> UncertainArray:
        rows, columns = "ij"[2 - len(self.shape) :], "jk"[: len(other.shape)]
        return contract(f"{rows},{columns}->{(rows + columns).replace('j', '')}", self, other)


def exact(array: Any) -> UncertainArray:
    """Return an array without error."""
    value = np.asarray(array, np.float64)
    return UncertainArray(value, np.zeros(value.shape), np.abs(value))


def zero(like: UncertainArray) -> UncertainArray:
    """Return zeros with the rounding error of terms of the size of `like`."""
    return UncertainArray(np.zeros(like.shape), EPS * like.size, like.size)


def stack_uncertain(parts: Sequence[UncertainArray], axis: int = 0) -> UncertainArray:
    """Return arrays beside each other along a new axis."""
    fields = "value", "error", "size"
    return UncertainArray(*(np.stack([getattr(x, y) for x in parts], axis) for y in fields))


def contract(subscripts: str, *factors: UncertainArray) -> UncertainArray:
    """Return the sum of products `np.einsum(subscripts, ...)` with its error."""

    def summed(*arrays: Array) -> Array:
        return np.asarray(np.einsum(subscripts, *arrays))

    sizes = [factor.size for factor in factors]
    size = summed(*sizes)
    error = EPS * size
    for k, factor in enumerate(factors):
        error = error + summed(*sizes[:k], factor.error, *sizes[k + 1 :])
    return UncertainArray(summed(*(factor.value for factor in factors)), error, size)


# ---- Samples of functions ------------------------------------------------------------------------


class Sampled:
    """Function of an array x that is told at which points it is called next.

    Args:
        function: the function.
        prefetch: called with the points, before the function is called at each.
    """

    def __init__(
        self, function: Callable[[Array], Array], prefetch: Callable[[Sequence[Array]], None]
    ):
        self.function, self.prefetch = function, prefetch

    def __call__(self, x: Array) -> Array:
        """Return the value of the function at x."""
        return self.function(x)


def values_at(f: Callable[[Array], Array], points: Sequence[Array]) -> list[Array]:
    """Return the values of f at several points, of which a `Sampled` function is told first."""
    if isinstance(f, Sampled):
        f.prefetch(points)
    return [f(x) for x in points]


# ---- Numerical noise -----------------------------------------------------------------------------


class SampleLine(NamedTuple):
    """Equally spaced points on a line, and the orders of the differences taken over them.

    Attributes:
        points: number of points.
        spacing: distance of neighbours, per half width of the range. A term sin(ω x) leaves
            (ω spacing)ᵏ in the difference of order k.
        orders: orders k.
        among: function that combines the estimates of all orders.
    """

    points: int
    spacing: float
    orders: tuple[int, ...]
    among: Callable[..., Array]


SHORT = SampleLine(9, 2.0**-26, (4, 5, 6), np.fmax.reduce)
"""Short line: smooth terms up to ω = 5000 leave nothing in the differences."""

LONG = SampleLine(12, 2.0**-12, (6, 7, 8), np.fmin.reduce)
"""Long line: a difference of much larger numbers has steps, and may be constant on the short line.
Noise is the same in all orders; the smallest estimate counts, as smooth functions leave less in
higher orders, nothing up to ω = 100."""

MIDDLE = SampleLine(12, 2.0**-21, (6, 7, 8), np.fmin.reduce)
"""Middle line: steps show as on the long line; a vibration that the long line undersamples is
smooth."""

DISAGREE = 100.0
"""Ratio of the noise on the long line to that on the short one above which steps are suspected."""

JUMP = 30.0
"""Ratio of the largest first difference on a line to the median one, above which f jumps there.

A polynomial of degree 3 about an extremum reaches 16.
"""


NEAR = 1e-3
"""Distance from a state, per half width of the ranges, within which a jump is reported."""


def noise(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> Array:
    """Return the noise of each entry of f near x, a standard deviation, 0 where nothing is rounded.

    The short line decides. Where f is constant between two of its points, or where the long line
    is much noisier, f may have steps, and the long line counts; not where f jumps there once, at
    this very point or near it, nor where it is smooth on the line between, undersampled on the long
    one: neither a jump nor a fast vibration is noise. Nor is a value at x that stands alone among
    those of the long line, as in a branch for angles that are 0: it is left out.

    Args:
        f: function of an array (m,), which returns an array.
        x: center of the lines (m,).
        width: half widths of the ranges of x (m,).
        seed: seed of the directions of the lines.
    """
    rng = np.random.default_rng(seed)
    near = _values_on_line(f, x, width, SHORT, rng)
    far = _values_on_line(f, x, width, LONG, rng)
    short, long = _noise_on_line(SHORT, near), _noise_on_line(LONG, far)
    steps = (np.diff(near, axis=0) == 0.0).any(axis=0) & ~_vanishes_within_jump(near, far)
    floor = np.fmax(short, EPS * np.abs(near[SHORT.points // 2]))
    doubtful = ~steps & np.isfinite(short) & (long > DISAGREE * floor)
    if doubtful.any():
        doubtful &= ~jumps_on(far)
    smooth = np.zeros(short.shape, bool)
    if doubtful.any():
        middle = _noise_on_line(MIDDLE, _values_on_line(f, x, width, MIDDLE, rng))
        smooth = doubtful & (middle < long / DISAGREE)
    rough = steps | (doubtful & ~smooth) | ~(long > DISAGREE * floor)
    # Where f has no value on one of the lines, the other line decides.
    estimate = np.where(rough | ~np.isfinite(short), np.fmax(short, long), short)
    alone, filled = _find_outliers(LONG, far)
    if not alone.any():
        return estimate
    return np.where(alone, np.fmin(estimate, _noise_on_line(LONG, filled)), estimate)


def _find_outliers(line: SampleLine, values: Array) -> tuple[Array, Array]:
    """Return whether each entry at the center of a line is far from all others, and other values.

    The other values (points, ...) have at their center the interpolation of three values on each
    side.
    """
    center, filled = line.points // 2, values.copy()
    sides = [values[center - k] + values[center + k] for k in (1, 2, 3)]
    filled[center] = (15.0 * sides[0] - 6.0 * sides[1] + sides[2]) / 20.0
    apart, rounding = np.abs(values[center] - filled[center]), EPS * np.abs(values).max(axis=0)
    alone = apart > DISAGREE * rounding
    return alone & (
        apart > DISAGREE * _noise_on_line(line, filled)
    ) if alone.any() else alone, filled


def _vanishes_within_jump(near: Array, far: Array) -> Array:
    """Return whether each entry is 0 on a line (points, ...) and jumps on a longer one.

    All changes between steps of a difference of larger numbers are of one size, unlike these.
    """
    change = np.abs(np.diff(far, axis=0))
    least = np.where(change > 0.0, change, np.inf).min(axis=0)
    return (near == 0.0).all(axis=0) & (change.max(axis=0) > JUMP * least)


def _values_on_line(
    f: Callable, x: Array, width: Array, line: SampleLine, rng: np.random.Generator
) -> Array:
    """Return f (points, ...) on a line through x with a random direction."""
    direction = rng.uniform(0.5, 1.0, len(x)) * rng.choice((-1.0, 1.0), len(x)) * width
    steps = np.arange(line.points) - line.points // 2
    return np.array(values_at(f, [x + step * line.spacing * direction for step in steps]))


def _noise_on_line(line: SampleLine, values: Array) -> Array:
    """Return the noise of values (points, ...) on a line, from differences of several orders."""
    estimates = []
    for order in line.orders:
        differences = np.diff(values, order, axis=0)
        mean_square = np.mean(np.square(differences), axis=0) / comb(2 * order, order)
        estimates.append(np.sqrt(mean_square))
    return line.among(estimates)


def jumps_on(values: Array) -> Array:
    """Return whether each entry jumps between two of the values (points, ...) on a line."""
    change = np.abs(np.diff(values, axis=0))
    least = 2.0**10 * EPS * np.abs(values).max(axis=0)
    return change.max(axis=0) > np.maximum(JUMP * np.median(change, axis=0), least)


def jumps(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> bool:
    """Return whether an entry of f jumps within `NEAR` of x, per half width of the ranges.

    On one of the lines any two coordinates go opposite ways: their difference changes on it too.
    Arguments are those of `noise`.
    """
    line = SampleLine(17, NEAR / 8.0, (), np.fmin.reduce)
    lines = [width, *sign_patterns(len(x)) * width]
    with np.errstate(all="ignore"):
        # The same directions each time, but for their signs.
        along = (_values_on_line(f, x, y, line, np.random.default_rng(seed)) for y in lines)
        return any(bool(jumps_on(values).any()) for values in along)


def sign_patterns(count: int) -> Array:
    """Return signs (rows, count): any two entries have opposite ones in one of the rows."""
    digits = np.arange(count) >> np.arange(max(count - 1, 1).bit_length())[:, None] & 1
    return 1.0 - 2.0 * digits


def entry_sizes(value: Array) -> Array:
    """Return the size of each entry, in a square matrix at least that of its diagonal.

    √|M_ii M_kk| has the units of M_ik, and the terms that are summed to an entry are not larger: a
    sum that cancels is as uncertain as its terms.
    """
    size = np.abs(value)
    if value.ndim == 2 and value.shape[0] == value.shape[1]:
        root = np.sqrt(np.abs(np.diagonal(value)))
        size = np.maximum(size, np.outer(root, root))
    return size


# ---- Derivatives ---------------------------------------------------------------------------------

FIRST = 0.5
"""First step, per half width of the range."""

STEPS = 10
"""Number of long steps, each half as long as the one before."""

SHORTER, SHORT_STEPS = 8.0, 8
"""Ratio and number of the short steps that follow: down to 2^-34 of the half width."""

COLUMNS = 10
"""Number of columns of the triangle, that of the differences included."""

CONFIRMED = 2
"""Number of shorter steps that must not contradict an estimate."""

FLAT = 2.0**-14
"""Longest step, per half width, of which a nonzero difference shows that f has steps where shorter
ones have a difference of 0."""

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
) -> UncertainArray:
    """Return ∂f/∂x_k with its error.

    The error is the sum of the differences of an entry from its two neighbours in the triangle,
    plus twice the noise of f, at least its rounding, divided by the step. A neighbour may agree by
    chance, and then the error is too small: the constant 32 covers that, by which every error of
    this module is multiplied before anything is judged (`eomcheck.evaluation.tolerance.C`). With 1
    instead right functions fail.

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
        noise: noise of each entry of f at x, see `eomcheck.testing.uncertain`.
        size: size of the terms that each entry of f is summed from.
        value: f at x; None calls f.
    """
    value = np.asarray(f(x) if value is None else value)
    h, high, low, step = _central(f, x, k, width)
    if len(h) < CONFIRMED + 2:
        missing = np.full(value.shape, np.nan)
        return UncertainArray(missing, np.full(missing.shape, np.inf), missing)
    with np.errstate(all="ignore"):
        rounding = EPS * np.maximum(np.abs(high), np.abs(low)) / step
        blur = np.maximum(noise / step, rounding)
        plain = (high - low) / step
        values, errors = _extrapolate(h, plain, blur)
        contradicted = _contradiction(values, plain, blur, rounding)
        kink = _kink(h, (high + low - 2.0 * value) / _with_axes_of(h, high), blur)
    errors = np.where(_vanishes_within_step(h / width, plain), np.inf, errors)
    total = np.maximum(errors, contradicted)[1:-CONFIRMED]
    best = np.argmin(total, axis=0)[None]

    def of(rows: Array) -> Array:
        return np.take_along_axis(rows, best, axis=0)[0]

    error = np.maximum(of(total), kink)
    # A derivative much smaller than f over its range counts as 0, if nothing but noise hides it.
    noisy = error <= of(errors[1:-CONFIRMED])
    slope = of(values[1:-CONFIRMED])
    return UncertainArray(
        slope, error, np.maximum(np.abs(slope), np.where(noisy, np.asarray(size) / width, 0.0))
    )


def _with_axes_of(h: Array, rows: Array) -> Array:
    """Return numbers (rows,) with as many axes as `rows` (rows, ...)."""
    return h.reshape(-1, *(1,) * (rows.ndim - 1))


def _central(
    f: Callable[[Array], Array], x: Array, k: int, width: float
) -> tuple[Array, Array, Array, Array]:
    """Return steps h (rows,), f ahead and behind (rows, ...), and their distance (rows, 1, ...).

    Only the steps that are shorter than the last one where f has no value.
    """
    h, pairs = FIRST * width, []
    for number in range(STEPS + SHORT_STEPS):
        if number > 0:
            h /= 2.0 if number < STEPS else SHORTER
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        step = float(ahead[k] - behind[k])
        if step < ROUNDED * EPS * abs(x[k]):
            break
        pairs.append((h, step, ahead, behind))
    with np.errstate(all="ignore"):
        values = values_at(f, [y for *_, ahead, behind in pairs for y in (ahead, behind)])
    rows = []
    for (h, step, *_), high, low in zip(pairs, values[::2], values[1::2], strict=True):
        finite = np.isfinite(high).all() and np.isfinite(low).all()
        rows = [*rows, (h, high, low, step)] if finite else []
    if not rows:
        return np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0)
    steps, high, low, distance = (np.array(part) for part in zip(*rows, strict=True))
    return steps, high, low, _with_axes_of(distance, high)


def _extrapolate(h: Array, plain: Array, blur: Array) -> tuple[Array, Array]:
    """Return the best entry of each row of the triangle and its error (rows, ...), entry by entry.

    The error of the first row, which has no neighbours, is infinite.
    """
    best, error, last = plain, np.full(plain.shape, np.inf), plain
    for column in range(1, min(len(h), COLUMNS)):
        ratio = _with_axes_of((h[:-column] / h[column:]) ** 2, plain)
        entries = last[1:] + (last[1:] - last[:-1]) / (ratio - 1.0)
        away = np.abs(entries - last[1:]) + np.abs(entries - last[:-1]) + 2.0 * blur[column:]
        less = away < error[column:]
        best = np.concatenate((best[:column], np.where(less, entries, best[column:])))
        error = np.concatenate((error[:column], np.where(less, away, error[column:])))
        last = entries
    return best, error


def _contradiction(values: Array, plain: Array, blur: Array, rounding: Array) -> Array:
    """Return the distance of each estimate (rows, ...) from shorter steps that contradict it.

    They do where they are further apart than noise explains; or where three differences in
    sequence agree, and rounding does not explain it: noise that looks like a fast vibration.
    """
    apart = np.full(plain.shape, np.inf)
    change = np.abs(np.diff(plain, axis=0))
    apart[1:-1] = np.maximum(change[:-1], change[1:])
    # On a step of a difference of much larger numbers f does not change at all.
    least = np.minimum(C * blur, np.maximum(8.0 * apart, C * rounding))
    least = np.where(plain == 0.0, C * blur, least)
    distance = np.zeros(values.shape)
    for j in range(1, len(values)):
        away = np.abs(values[:j] - values[j])
        distance[:j] = np.fmax(distance[:j], np.where(away > least[j], away, 0.0))
    return distance


def _vanishes_within_step(h: Array, plain: Array) -> Array:
    """Return whether a difference (rows, ...) is 0 though that of a hardly longer step is not.

    f then is rounded to multiples of a number, as in float32, and its measured noise may be 0 by
    chance.
    """
    felt = (plain != 0.0) & (_with_axes_of(h, plain) <= FLAT)
    return (plain == 0.0) & np.logical_or.accumulate(felt, axis=0)


def _kink(h: Array, bend: Array, blur: Array) -> Array:
    """Return the difference of the slopes on both sides of x (...), 0 where noise hides it.

    For a smooth function the second difference per step, `bend` (rows, ...), vanishes with the
    step. Three short steps in sequence must show that it does not.
    """
    ratio = _with_axes_of(h[:-1] / h[1:], bend)
    shown = np.abs(bend[1:] - (bend[:-1] - bend[1:]) / (ratio - 1.0))
    shown = np.where(shown > 4.0 * C * blur[1:], shown, 0.0)[STEPS:]
    if len(shown) < 3:
        return np.zeros(bend.shape[1:])
    return np.minimum(np.minimum(shown[:-2], shown[1:-1]), shown[2:]).max(axis=0)


def gradient(
    f: Callable[[Array], Array], x: Array, width: Array, f_at_x: UncertainArray
) -> UncertainArray:
    """Return ∂f/∂x, the new axis of length m first.

    Args:
        f: function of an array (m,), which returns an array.
        x: point (m,).
        width: half widths of the ranges of x (m,).
        f_at_x: f at x.
    """
    derivatives = [
        partial(f, x, k, float(width[k]), f_at_x.error, f_at_x.size, f_at_x.value)
        for k in range(len(x))
    ]
    parts = zip(*((d.value, d.error, d.size) for d in derivatives), strict=True)
    return UncertainArray(*(np.array(part) for part in parts))
