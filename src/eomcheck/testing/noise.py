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

from eomcheck.numbers.contract import Array


class Line(NamedTuple):
    """Points on a line, and the orders of the differences that are looked at over them.

    Attributes:
        points: their number.
        spacing: distance of two, per half width of the range. A term sin(ω x) leaves (ω spacing)ᵏ
            in the difference of order k.
        orders: orders k.
        among: which of the orders counts.
    """

    points: int
    spacing: float
    orders: tuple[int, ...]
    among: Callable[..., Array]


LINES = (
    Line(9, 2.0**-26, (4, 5, 6), np.fmax.reduce),
    Line(12, 2.0**-12, (6, 7, 8), np.fmin.reduce),
)
"""A short line, on which nothing smooth is left over up to ω = 5000, and a longer one: numbers that
are left of much larger ones have steps, and may be the same all over the short line. Noise is the
same in all orders; on the longer line the least counts, as smooth functions leave less in higher
ones, nothing up to ω = 100."""


def noise(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> Array:
    """Return the noise of each entry of f near x, a standard deviation, 0 where nothing is rounded.

    Args:
        f: function of an array (m,), which answers an array.
        x: where (m,).
        width: half widths of the ranges of x (m,).
        seed: of the directions of the lines.
    """
    rng = np.random.default_rng(seed)
    found = []
    for line in LINES:
        direction = rng.uniform(0.5, 1.0, len(x)) * rng.choice((-1.0, 1.0), len(x)) * width
        steps = np.arange(line.points) - line.points // 2
        values = np.array([f(x + step * line.spacing * direction) for step in steps])
        spread = []
        for order in line.orders:
            differences = np.diff(values, order, axis=0)
            mean_square = np.mean(np.square(differences), axis=0) / comb(2 * order, order)
            spread.append(np.sqrt(mean_square))
        found.append(line.among(spread))
    # Where f has no value on one of them, the other tells.
    return np.fmax.reduce(found)


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
