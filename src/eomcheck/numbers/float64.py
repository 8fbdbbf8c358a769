"""Machine doubles: the generic functions run on numpy's arrays as they stand."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.contract import Angles


class Float64:
    """The arithmetic of machine doubles (`eomcheck.numbers.contract.Arithmetic`)."""

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as doubles, a contiguous copy."""
        return np.array(x, dtype=np.float64, order="C")

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        return Angles(x, np.cos(x), np.sin(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,)."""
        return np.sqrt(x)


FLOAT64 = Float64()
