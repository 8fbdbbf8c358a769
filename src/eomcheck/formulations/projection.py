"""The step that Em and ML share: the equations of motion projected on the motions allowed."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.generic import generic


@generic
def project(M, F, W, rest):
    """Return (Wᵀ M W, Wᵀ (F - M rest)): Eq. (18) with the paper's w, Eq. (21) with w′.

    a W = 0 takes the multipliers out; v̇ = W u̇ + rest. Without W there is nothing to project.
    """
    if W is None:
        return M, F
    Wt = np.ascontiguousarray(W.T)
    return Wt @ (M @ W), Wt @ (F - M @ rest)
