"""Small random relative changes of numbers: a condition number measured instead of guessed.

Rounding moves every number that a computation reads or forms by a relative eps. Moving them all by
a much larger relative step h and looking how far the result moves, |change| / h, measures how
strongly this very computation, cancellation and ill-conditioned matrices included, amplifies such
changes. Rounding then moves the result by about eps times that.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.arithmetic.entries import map_record
from eomcheck.model import Angles, Arithmetic

STEP = 2.0**-46
"""h: 64 eps, above rounding, and so small that a result that is lost altogether, which changes by
its own size whatever the step, measures as 1/h: its error bound is then as large as itself."""

SAMPLES = 4
"""Independent noises per measurement; the largest change counts."""

STRETCH = 8.0
"""The first noise is also tried this many times larger: a change that does not grow is saturated,
and says nothing about smaller noise."""


class Noise:
    """A seeded source of relative changes of size between h/2 and h, either sign."""

    def __init__(self, seed: int, step: float = STEP):
        self._random = np.random.default_rng(seed)
        self.step = step

    def changes(self, shape) -> np.ndarray:
        """Return random numbers of magnitude h/2 to h."""
        # Magnitudes vary so that two equal contributions never cancel exactly.
        size = self._random.uniform(0.5, 1.0, shape)
        return self.step * np.where(self._random.random(shape) < 0.5, -size, size)

    def entries(self, x: np.ndarray) -> np.ndarray:
        """Change each entry of x relative to itself: numbers that were read or rounded."""
        return x * (1.0 + self.changes(x.shape))

    def record(self, x: Any) -> Any:
        """Change each entry of every array in a record; what is absent stays absent."""
        return map_record(lambda part: self.entries(np.asarray(part)), x)

    def by_column(self, A: np.ndarray) -> np.ndarray:
        """Change each entry of A relative to the largest of its column.

        This is the backward error of elimination with partial pivoting (Higham 2002, Thm. 9.3).
        """
        return A + np.abs(A).max(axis=0, initial=0.0) * self.changes(A.shape)


class Noisy:
    """An arithmetic whose cosines, sines and roots are moved as well."""

    def __init__(self, arithmetic: Arithmetic, noise: Noise):
        self._arithmetic, self._noise = arithmetic, noise

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as the arithmetic does."""
        return self._arithmetic.numbers(x)

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,), their cosines and sines, all moved."""
        return self._noise.record(self._arithmetic.angles(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,), moved."""
        return self._noise.entries(self._arithmetic.root(x))
