"""What gravity does, by heights of the centres of mass; nothing where g is None."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.generic import generic


@generic
def weights(gravity, mass, upward):
    """Return Q (n,) by ∂(heights of the centres of mass)/∂q (n_b, n)."""
    if gravity is None:
        return None
    bodies, n = upward.shape
    Q = np.zeros(n, upward.dtype)
    for k in range(bodies):
        for j in range(n):
            Q[j] -= gravity[0] * mass[k] * upward[k, j]
    return Q


@generic
def height_energy(gravity, mass, heights):
    """Return U, J, by the heights (n_b,)."""
    if gravity is None:
        return None
    U = 0
    for k in range(heights.size):
        U += gravity[0] * mass[k] * heights[k]
    return U
