"""How noisy the answers of a black box are: its rounding, measured from outside.

Over a few points on a line, so close that any smooth function is a polynomial of low degree to more
digits than doubles have, high differences hold nothing but the rounding of the function (J. J. Moré
and S. M. Wild, Estimating computational noise, SIAM J. Sci. Comput. 33, 2011, Algorithm ECnoise,
whose choice of order is replaced by the largest of three).
"""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import numpy as np

from eomcheck.numbers.contract import Array

POINTS = 9
"""Points on a line."""

ORDERS = (4, 5, 6)
"""Orders of the differences that are looked at."""

SPACING = 2.0**-26
"""Distance of two points, per half width of the range.

A term sin(ω x) leaves (ω SPACING)⁴ in the lowest difference: below rounding up to ω = 5000.
"""

LINES = 2
"""Lines along which the noise is measured; the largest counts."""


def noise(f: Callable[[Array], Array], x: Array, width: Array, seed: int = 0) -> Array:
    """Return the noise of each entry of f near x, a standard deviation, 0 where nothing is rounded.

    Args:
        f: function of an array (m,), which answers an array.
        x: where (m,).
        width: half widths of the ranges of x (m,).
        seed: of the directions of the lines.
    """
    directions = np.random.default_rng(seed).uniform(0.5, 1.0, (LINES, len(x)))
    signs = np.random.default_rng(seed + 1).choice((-1.0, 1.0), (LINES, len(x)))
    found = []
    for direction in directions * signs * width:
        steps = np.arange(POINTS) - POINTS // 2
        values = np.array([f(x + step * SPACING * direction) for step in steps])
        for order in ORDERS:
            differences = np.diff(values, order, axis=0)
            mean_square = np.mean(np.square(differences), axis=0) / comb(2 * order, order)
            found.append(np.sqrt(mean_square))
    return np.max(found, axis=0)


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
