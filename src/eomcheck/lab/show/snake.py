"""Where the links of a snake are, for figures of it."""

from __future__ import annotations

import numpy as np


def joints(length: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the ends of the links of a snake (N + 1, 2), m, the head first."""
    theta = q[2:]
    steps = length[:, None] * np.column_stack((np.cos(theta), np.sin(theta)))
    return np.vstack((q[:2], q[:2] + np.cumsum(steps, axis=0)))
