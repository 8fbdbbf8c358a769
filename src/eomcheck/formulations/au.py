"""Augmented method: accelerations and multipliers from one symmetric system, Eqs. (8)-(9)."""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


@generic
def system(M, F, a, gamma):
    """Return (M_Au, F_Au) of Eq. (9), of order n + r: unknowns (v̇, λ)."""
    if a is None:
        return M, F
    n, r = F.size, gamma.size
    M_Au = np.zeros((n + r, n + r), M.dtype)
    M_Au[:n, :n] = M
    M_Au[:n, n:] = -a.T
    M_Au[n:, :n] = -a
    return M_Au, np.concatenate((F, gamma))


@generic
def split(x, a):
    """Return the parts (v̇, λ) of the unknowns x; λ is None without constraints."""
    if a is None:
        return x, None
    n = a.shape[1]
    return x[:n], x[n:]


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), λ (r,) or None)."""
    M_Au, F_Au = system(M, F, a, gamma)
    return split(solve(M_Au, F_Au, "M_Au"), a)


AU = Formulation(
    key="au",
    name="Augmented",
    equations="(8)-(9)",
    order=(1, 1),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=True,
    state="q, v, μ",
    uses="terms",
    partitioned=False,
    limits=(
        "Needs independent constraints and a mass matrix that is positive on the motions they "
        "allow; M alone may be singular. A snake's constraints are independent while cos α_i is "
        "not 0 for i >= 2, at N = 1 always."
    ),
    solution=solution,
)
