"""Rules of float64 linear solves: scales, pivots and steps of refinement.

They are shared by the checked solves (`eomcheck.numbers.linear`, `banded_solve`) and the solves in
machine code (`eomcheck.kernels`).

- Rows are scaled by powers of two, which round nothing, so that the largest entry of each is near
  1. The scale of rows decides which pivots are taken.
- The pivot of a column is its largest remaining entry, the first of several equal ones; in machine
  code of a band, of entries that agree to 2^-50, any.
- A band solve is refined in the same precision until its backward error β, the largest of
  |b - A x|_i / (|A||x| + |b|)_i, is at most `REFINED`, but at least `LEAST_STEPS` times. A step
  that does not bring it below `STALLED` times its value before is the last one, and the matrix is
  refused: rounding does not explain x (Arioli, Demmel, Duff 1989; Higham 2002, Sec. 12.2).
  (|A||x| + |b|)_i counts as ε times the largest of all rows at least (`SMALLEST_SHARE`): if x is 0
  in all unknowns of row i, the computed residual of that row is rounding error of other rows.
"""

from __future__ import annotations

import numpy as np

EPS = float(np.finfo(np.float64).eps)

ABOVE_ONE = 1.0 + 2.0**-20
"""Factor before the exponent is taken: numbers slightly below a power of two are scaled like it.
Many numbers of models are powers of two; perturbed samples of them must not fall on different sides
of a limit, or other pivots are taken."""

LARGEST_EXPONENT = 1000
"""Largest exponent of a scale, 2^-1000 to 2^1000, so that a scale is a normal number."""

BAND_TERMS = 8
"""Number of terms in a residual: 7 entries of a row of the band, and the right-hand side."""

REFINED = BAND_TERMS * EPS
"""Largest backward error that the rounding of a residual alone can cause."""

LEAST_STEPS, MOST_STEPS = 1, 20
"""Bounds of the number of refinement steps."""

STALLED = 0.5
"""Largest ratio of the backward errors after and before a step; above it refinement stops."""

SMALLEST_SIZE = 2.0**-960
"""Lower limit of |A||x| + |b|: below it residuals underflow, and their size means nothing."""

SMALLEST_SHARE = EPS
"""Lower limit of |A||x| + |b| as a share of its largest entry; rows are scaled."""


_LEAST = 1100
_SCALES = np.ldexp(
    1.0, np.clip(np.arange(_LEAST, -_LEAST, -1), -LARGEST_EXPONENT, LARGEST_EXPONENT)
)
"""Scales by exponent: entry i is the scale of numbers with the exponent `i - _LEAST`."""


def power_of_two_scale(largest: np.ndarray) -> np.ndarray:
    """Return the powers of two (k,) that bring numbers `largest` (k,) to [0.5, 1).

    Numbers that are 0 or not finite are scaled like 1.
    """
    usable = (largest > 0) & (largest < np.inf)
    if not usable.all():
        largest = np.where(usable, largest, 1.0)
    return _SCALES.take(np.frexp(largest * ABOVE_ONE)[1] + _LEAST)
