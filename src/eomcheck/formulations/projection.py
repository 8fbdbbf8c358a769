"""The step that Em and ML share: the equations of motion projected on the motions allowed."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import product


@generic
def project(M, F, W, rest):
    """Return (Wᵀ M W, Wᵀ (F - M rest)): Eq. (18) with the paper's w, Eq. (21) with w′.

    a W = 0 takes the multipliers out; v̇ = W u̇ + rest. Without W there is nothing to project.
    """
    if W is None:
        return M, F
    n, p = W.shape
    # M on W and the rest together: one matrix is read once.
    columns = np.zeros((n, p + 1), M.dtype)
    columns[:, :p] = W
    columns[:, p] = rest
    moved = product(M, columns)
    Wt = np.ascontiguousarray(W.T)
    return Wt @ np.ascontiguousarray(moved[:, :p]), Wt @ (F - moved[:, p])
