"""Elimination method: multipliers eliminated by r of the rows, Eqs. (10)-(11)."""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import matrix_product, solve


@generic
def system(M, F, a, gamma, partition):
    """Return (M_El, F_El) of Eq. (11), of order n: unknowns v̇.

    Rows `partition.dependent` of M v̇ = F + aᵀλ give λ (the paper's ′), the others (″) keep v̇.
    """
    if a is None:
        return M, F
    n, r = F.size, gamma.size
    first, second = partition.dependent, partition.independent
    # a′⁻ᵀ applied to M′ and F′ in one solve.
    primed = np.zeros((r, n + 1), M.dtype)
    primed[:, :n] = M[first]
    primed[:, n] = F[first]
    eliminated = solve(np.ascontiguousarray(a[:, first].T), primed, "a'T")
    reduced = matrix_product(np.ascontiguousarray(a[:, second].T), eliminated)
    M_El = np.zeros((n, n), M.dtype)
    M_El[: n - r] = M[second] - reduced[:, :n]
    M_El[n - r :] = a
    return M_El, np.concatenate((F[second] - reduced[:, n], -gamma))


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), None)."""
    M_El, F_El = system(M, F, a, gamma, partition)
    return solve(M_El, F_El, "M_El"), None


EL = Formulation(
    key="el",
    name="Elimination",
    equations="(10)-(11)",
    order=(1, 0),
    level="acceleration",
    multipliers=False,
    multipliers_in_paper=False,
    state="q, v",
    uses="terms",
    partitioned=True,
    limits=(
        "Needs an invertible a′, the first r columns of a. For the snake det a′ = "
        "sin(φ_N - φ_{N-1}) times the product of (L_i/2) cos α_i, i <= N-2: the last two wheels "
        "must not be parallel (N = 2: both wheels), and at N = 1 sin φ_1 must not be 0. A "
        "pivoted partition avoids this."
    ),
    solution=solution,
)
