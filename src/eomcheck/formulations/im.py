"""Integrated multiplier method: velocities, accelerations and multipliers at once, Eqs. (6)-(7).

The first block row of Eq. (7) is the trivial q̇ = q̇. It is solved all the same: this is the
published method, and Table I counts its size.
"""

from __future__ import annotations

import numpy as np

from eomcheck.formulations import au
from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


@generic
def system(M, F, a, gamma, v):
    """Return (M_IM, F_IM) of Eq. (7), of order 2n + r: unknowns (q̇, v̇, λ)."""
    M_Au, F_Au = au.system(M, F, a, gamma)
    n, size = v.size, v.size + F_Au.size
    M_IM = np.zeros((size, size), M.dtype)
    for i in range(n):
        M_IM[i, i] = 1
    M_IM[n:, n:] = M_Au
    return M_IM, np.concatenate((v, F_Au))


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), λ (r,) or None)."""
    M_IM, F_IM = system(M, F, a, gamma, v)
    return au.split(solve(M_IM, F_IM, "M_IM")[v.size :], a)


IM = Formulation(
    key="im",
    name="Integrated multiplier",
    equations="(6)-(7)",
    order=(2, 1),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=True,
    state="q, v, μ",
    uses="terms",
    partitioned=False,
    limits=(
        "As the augmented method: needs independent constraints and a mass matrix that is positive "
        "on the motions they allow. Snakes of 1 or 2 links have no other states where it fails."
    ),
    solution=solution,
)
