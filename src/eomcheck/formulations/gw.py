"""Greenwood's method: multipliers from a M⁻¹ aᵀ, then accelerations from M, Eqs. (12)-(13)."""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import matrix_product, solve

MOBILITY = "a M^-1 aT"
"""Name of the matrix of Eq. (12) in refusals."""


@generic
def greenwood_multipliers(M, F, a, gamma):
    """Return λ (r,) of Eq. (12), or None without constraints."""
    if a is None:
        return None
    n, r = F.size, gamma.size
    # M⁻¹ applied to aᵀ and F in one solve.
    columns = np.zeros((n, r + 1), M.dtype)
    columns[:, :r] = a.T
    columns[:, r] = F
    mobility = matrix_product(a, solve(M, columns, "M"))
    return -solve(np.ascontiguousarray(mobility[:, :r]), mobility[:, r] + gamma, MOBILITY)


@generic
def system(M, F, a, lambda_):
    """Return (M_GW, F_GW) of Eq. (13), of order n: unknowns v̇."""
    if a is None:
        return M, F
    return M, F + a.T @ lambda_


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), λ (r,) or None)."""
    lambda_ = greenwood_multipliers(M, F, a, gamma)
    M_GW, F_GW = system(M, F, a, lambda_)
    return solve(M_GW, F_GW, "M_GW"), lambda_


GW = Formulation(
    key="gw",
    name="Greenwood",
    equations="(12)-(13)",
    order=(1, 0),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=False,
    state="q, v",
    uses="terms",
    partitioned=False,
    limits=(
        "Needs M itself to be invertible, so bodies without inertia can rule it out, and "
        "independent constraints. A snake's M is positive while no inertia is 0, for 1 or 2 links "
        "as for any."
    ),
    solution=solution,
)
