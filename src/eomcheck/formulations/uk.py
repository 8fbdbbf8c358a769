"""Udwadia-Kalaba: the pseudo-inverse's acceleration and multipliers, rows dependent or not.

Udwadia and Kalaba's equation (1992) takes the Moore-Penrose inverse ⁺ of a M⁻¹ aᵀ,

    v̇ = M⁻¹ (F + aᵀ λ),  λ = -(a M⁻¹ aᵀ)⁺ (gamma + a M⁻¹ F),

which has no need for independent rows, and makes λ the smallest of all multipliers that give v̇. It
is found here without roots, without M⁻¹ and without squaring a condition number. Let rows k of a be
independent and imply the other rows d, a_d = G a_k. The augmented system of rows k alone,

    M v̇ - a_kᵀ μ = F,  -a_k v̇ = gamma_k,

gives v̇, and with -a_dᵀ and 0 on its right-hand side Gᵀ. Of all λ with aᵀ λ = a_kᵀ μ, that is

    λ_k + Gᵀ λ_d = μ,

the smallest has λ_k = μ - Gᵀ λ_d and (1 + G Gᵀ) λ_d = G μ.
"""

from __future__ import annotations

import numpy as np

from eomcheck.formulations import au
from eomcheck.formulations.base import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


@generic
def system(M, F, a, gamma, kept, redundant):
    """Return (M_UK, right-hand sides (n+ρ, 1+r-ρ)): unknowns (v̇, μ), and then Gᵀ below what is 0.

    Args:
        M: mass matrix (n, n).
        F: Q - B (n,).
        a: constraint Jacobian (r, n).
        gamma: constraint drift (r,).
        kept: independent rows (ρ,).
        redundant: the other rows (r-ρ,).
    """
    n = F.size
    M_UK, F_UK = au.system(M, F, a[kept], gamma[kept])
    right = np.zeros((F_UK.size, 1 + redundant.size), M.dtype)
    right[:, 0] = F_UK
    right[:n, 1:] = -a[redundant].T
    return M_UK, right


@generic
def smallest(mu, G, kept, redundant):
    """Return the smallest λ (r,) of those with λ_k + Gᵀ λ_d = μ."""
    square = G @ np.ascontiguousarray(G.T)
    for i in range(redundant.size):
        square[i, i] += 1
    lambda_ = np.zeros(kept.size + redundant.size, mu.dtype)
    lambda_[redundant] = solve(square, G @ mu, "1 + G GT")
    lambda_[kept] = mu - np.ascontiguousarray(G.T) @ lambda_[redundant]
    return lambda_


@generic
def of_dependent(M, F, a, gamma, kept, redundant):
    """Return (v̇ (n,), λ (r,)) where some rows depend on those kept."""
    n = F.size
    M_UK, right = system(M, F, a, gamma, kept, redundant)
    x = solve(M_UK, right, "M_UK")
    mu, G = np.ascontiguousarray(x[n:, 0]), np.ascontiguousarray(x[n:, 1:].T)
    return np.ascontiguousarray(x[:n, 0]), smallest(mu, G, kept, redundant)


@generic
def of_rows(M, F, a, gamma, kept, redundant):
    """Return (v̇ (n,), λ (r,) or None); where no row depends on others, M_UK is M_Au."""
    if redundant is None:
        M_UK, F_UK = au.system(M, F, a, gamma)
        return au.split(solve(M_UK, F_UK, "M_UK"), a)
    return of_dependent(M, F, a, gamma, kept, redundant)


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), λ (r,) or None)."""
    return of_rows(M, F, a, gamma, partition.kept, partition.redundant)


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
        "Needs a mass matrix that is positive on the motions allowed, as Au, but not independent "
        "constraints; their rank must be clear, and the same in positions nearby. Multipliers are "
        "the smallest there are. A snake of 1 or 2 links has no other exception."
    ),
    solution=solution,
    redundant=True,
)
