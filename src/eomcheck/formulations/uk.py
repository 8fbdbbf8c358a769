"""Udwadia-Kalaba: the pseudo-inverse's acceleration and multipliers, rows dependent or not.

Udwadia and Kalaba's equation (1992) takes the Moore-Penrose inverse ⁺ of a M⁻¹ aᵀ,

    v̇ = M⁻¹ (F + aᵀ λ),  λ = -(a M⁻¹ aᵀ)⁺ (gamma + a M⁻¹ F),

which needs no independent rows, and makes λ the smallest of all multipliers that give v̇. It is
computed here without roots, without M⁻¹ and without squaring a condition number. Let rows k of a be
independent and imply the other rows d, a_d = G a_k. The augmented system of rows k alone,

    M v̇ - a_kᵀ μ = F,  -a_k v̇ = gamma_k,

gives v̇. Of all λ with aᵀ λ = a_kᵀ μ, that is

    λ_k + Gᵀ λ_d = μ,

the smallest has λ_k = μ - Gᵀ λ_d and (1 + G Gᵀ) λ_d = G μ. With -a_dᵀ and 0 on its right-hand side
the augmented system would give G too, but eliminated by M: for nearly dependent kept rows G would
lose twice the digits that they lose. Therefore G has a system of its own.
"""

from __future__ import annotations

import numpy as np

from eomcheck.formulations import au
from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve

FIT_WEIGHT = 2**128
"""Weight of the constraint rows in the fit, so that M only counts for coordinates not in them."""


@generic
def redundancy_coefficients(M, a, kept, redundant):
    """Return G (r-ρ, ρ), the coefficients of the redundant rows in terms of the kept ones.

    A least-squares fit, K x = a_dᵀ - a_kᵀ Gᵀ and a_k x = 0, whose x is 0. Gᵀ comes first of the
    unknowns, so that elimination takes its pivots from a; K is diagonal, of the size of a².

    Args:
        M: mass matrix (n, n).
        a: constraint Jacobian (r, n).
        kept: independent rows (ρ,).
        redundant: the other rows (r-ρ,).
    """
    n, rank = a.shape[1], kept.size
    heavy = FIT_WEIGHT * a
    fit = np.zeros((rank + n, rank + n), M.dtype)
    right = np.zeros((rank + n, redundant.size), M.dtype)
    fit[:n, :rank] = heavy[kept].T
    fit[n:, rank:] = a[kept]
    for j in range(n):
        fit[j, rank + j] = heavy[kept, j] @ a[kept, j] + M[j, j]
    right[:n] = heavy[redundant].T
    return np.ascontiguousarray(solve(fit, right, "a_k fit")[:rank].T)


@generic
def smallest_multipliers(mu, G, kept, redundant):
    """Return the smallest λ (r,) of those with λ_k + Gᵀ λ_d = μ."""
    square = G @ np.ascontiguousarray(G.T)
    for i in range(redundant.size):
        square[i, i] += 1
    lambda_ = np.zeros(kept.size + redundant.size, mu.dtype)
    lambda_[redundant] = solve(square, G @ mu, "1 + G GT")
    lambda_[kept] = mu - np.ascontiguousarray(G.T) @ lambda_[redundant]
    return lambda_


@generic
def solution_with_redundant_rows(M, F, a, gamma, kept, redundant):
    """Return (v̇ (n,), λ (r,)) if some rows depend on the kept ones."""
    M_UK, F_UK = au.system(M, F, a[kept], gamma[kept])
    vdot, mu = au.split(solve(M_UK, F_UK, "M_UK"), a)
    G = redundancy_coefficients(M, a, kept, redundant)
    return vdot, smallest_multipliers(mu, G, kept, redundant)


@generic
def solution_of_rows(M, F, a, gamma, kept, redundant):
    """Return (v̇ (n,), λ (r,) or None); if no row depends on others, M_UK is M_Au."""
    if redundant is None:
        M_UK, F_UK = au.system(M, F, a, gamma)
        return au.split(solve(M_UK, F_UK, "M_UK"), a)
    return solution_with_redundant_rows(M, F, a, gamma, kept, redundant)


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), λ (r,) or None)."""
    return solution_of_rows(M, F, a, gamma, partition.kept, partition.redundant)


UK = Formulation(
    key="uk",
    name="Udwadia-Kalaba",
    equations="",
    order=(1, 1),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=None,
    state="q, v",
    uses="terms",
    partitioned=False,
    limits=(
        "Needs a mass matrix that is positive on the motions allowed, as the augmented method, "
        "but not independent constraints; their rank must be clear, and the same in positions "
        "nearby. Multipliers are the smallest there are. Snakes of 1 or 2 links have no other "
        "states where it fails."
    ),
    solution=solution,
    redundant=True,
)
