"""Rules of float64 linear solves: scales, pivots and steps of refinement.

The one place that both read: the checked solves (`eomcheck.numbers.linear`, `banded_solve`) and
those in machine code (`eomcheck.kernels`).

- Rows are scaled by powers of two, which round nothing, so that the largest entry of each is near
  1. The scale of rows decides which pivots are taken.
- The pivot of a column is its largest entry that is left, the first of several. In machine code of
  a band it may be another that is smaller by less than 2^-18 of it, and other rows are multiplied
  by as little more than 1.
- A band is eliminated from both ends at once, which need not wait for each other, to the middle.
- A band solve is refined in the same precision until its backward error β, the largest of
  |b - A x|_i / (|A||x| + |b|)_i, is at most `REFINED`; that many times at least `LEAST_STEPS`. A
  step that does not bring it below `STALLED` times its value before is the last one, and the matrix
  is refused: rounding does not explain x (Arioli, Demmel, Duff 1989; Higham 2002, Sec. 12.2).
  (|A||x| + |b|)_i counts as ε times the largest of all rows at least (`SMALLEST_SHARE`): where x is
  0 in all entries that row i has, float64 finds differences of what other rows round.
"""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(np.float64).eps)

ABOVE_ONE = 1.0 + 2.0**-20
"""What is so little below a power of two is scaled like it. Many numbers of models are powers of
two: moved a little, they must not fall on either side of a limit, or other pivots are taken."""

LARGEST_EXPONENT = 1000
"""Scales are 2^-1000 to 2^1000, so that a scale is a normal number."""

BAND_TERMS = 8
"""Terms in a sum that makes a residual: 7 entries of a row of the band, and the right-hand side."""

REFINED = BAND_TERMS * EPS
"""The backward error that rounding a residual alone can show."""

LEAST_STEPS, MOST_STEPS = 1, 20
"""Steps of refinement."""

STALLED = 0.5
"""A step is to divide the backward error by two at least."""

SMALLEST_SIZE = 2.0**-960
"""|A||x| + |b| counts as this at least: below, residuals underflow and tell nothing."""

SMALLEST_SHARE = EPS
"""|A||x| + |b| counts as this share of its largest entry at least; rows are scaled."""


def from_both_ends(size: int) -> np.ndarray:
    """Return the columns (size,) of a band in the order of their elimination: 0, -1, 1, -2, ..."""
    columns = np.arange(size)
    return np.where(columns % 2 == 0, columns // 2, size - 1 - columns // 2)


_LEAST = 1100
_SCALES = np.ldexp(
    1.0, np.clip(np.arange(_LEAST, -_LEAST, -1), -LARGEST_EXPONENT, LARGEST_EXPONENT)
)
"""The scale of what has the exponent `i - _LEAST`, at place i."""


def power_of_two_scale(largest: np.ndarray) -> np.ndarray:
    """Return the powers of two (k,) that bring numbers `largest` (k,) to [0.5, 1).

    What is 0 or not finite is scaled like 1.
    """
    usable = (largest > 0) & (largest < np.inf)
    if not usable.all():
        largest = np.where(usable, largest, 1.0)
    return _SCALES.take(np.frexp(largest * ABOVE_ONE)[1] + _LEAST)
