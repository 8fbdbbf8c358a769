"""Embedding method: the constraints solved for r of the velocities, Eqs. (14)-(18).

The last step, `project`, projects the equations of motion on the motions that the constraints
allow. ML shares it.
"""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import contiguous, matrix_product, solve


@generic
def project(M, F, W, rest):
    """Return (Wᵀ M W, Wᵀ (F - M rest)): Eq. (18) with the paper's w, Eq. (21) with w′.

    a W = 0 eliminates the multipliers; v̇ = W u̇ + rest. Without W there is nothing to project.
    """
    if W is None:
        return M, F
    n, p = W.shape
    # M applied to W and rest in one product.
    columns = np.zeros((n, p + 1), M.dtype)
    columns[:, :p] = W
    columns[:, p] = rest
    moved = matrix_product(M, columns)
    Wt = contiguous(W.T)
    return Wt @ contiguous(moved[:, :p]), Wt @ (F - moved[:, p])


@generic
def partition_embedding(a, gamma, partition):
    """Return (w (n, n-r), rest (n,)) with v̇ = w v̇₂ + rest, v₂ the independent velocities.

    a₁ v̇₁ + a₂ v̇₂ = -gamma gives both at once: rest = ẇ v₂ + ẋ of Eq. (16) is v̇ at v̇₂ = 0, and
    needs no ẇ.
    """
    r, n = a.shape
    first, second = partition.dependent, partition.independent
    columns = np.zeros((r, n - r + 1), a.dtype)
    columns[:, : n - r] = a[:, second]
    columns[:, n - r] = gamma
    dependent = solve(np.ascontiguousarray(a[:, first]), columns, "a_1")
    w = np.zeros((n, n - r), a.dtype)
    rest = np.zeros(n, a.dtype)
    w[first] = -dependent[:, : n - r]
    rest[first] = -dependent[:, n - r]
    for i in range(n - r):
        w[second[i], i] = 1
    return w, rest


@generic
def velocity_of_independent(a, b, v2, partition):
    """Return v (n,) with the independent part v2 that satisfies a v + b = 0 (Eq. (14))."""
    if a is None:
        return v2
    n = a.shape[1]
    first, second = partition.dependent, partition.independent
    right = np.ascontiguousarray(a[:, second]) @ v2
    if b is not None:
        right = right + b
    v = np.zeros(n, a.dtype)
    v[first] = -solve(np.ascontiguousarray(a[:, first]), right, "a_1")
    v[second] = v2
    return v


@generic
def solution(M, F, a, gamma, v, partition):
    """Return (v̇ (n,), None)."""
    if a is None:
        return solve(M, F, "M_Em"), None
    w, rest = partition_embedding(a, gamma, partition)
    M_Em, F_Em = project(M, F, w, rest)
    return w @ solve(M_Em, F_Em, "M_Em") + rest, None


EM = Formulation(
    key="em",
    name="Embedding",
    equations="(14)-(18)",
    order=(1, -1),
    level="velocity",
    multipliers=False,
    multipliers_in_paper=False,
    state="q, v2",
    uses="terms",
    partitioned=True,
    limits=(
        "Needs an invertible a_1, the first r columns of a, as El does: for the snake the last two "
        "wheels must not be parallel (N = 2: both wheels), cos α_i not 0 for i <= N-2, and at "
        "N = 1 sin φ_1 not 0. A pivoted partition avoids this."
    ),
    solution=solution,
)
