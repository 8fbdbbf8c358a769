"""Banded method: Gauss's principle in the quasi-velocities of each body of a chain.

Of all accelerations that the joints allow, the true one deviates least from the free motion:

    minimize Σ_k (ẋ_k - D_k⁻¹ f_k)ᵀ D_k (ẋ_k - D_k⁻¹ f_k) / 2,  A_k ẋ_{k-1} + C_k ẋ_k + d_k = 0.

With the unknowns in the order ẋ_1, ρ_2, ẋ_2, ρ_3, ẋ_3, ... the conditions of the minimum are a
symmetric banded system. No mass is inverted, there is no recursion along the chain, and elimination
with partial pivoting is O(N).
"""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.banded_solve import solve_banded
from eomcheck.numbers.generic import generic


@generic
def system(mass, force, before, after, rest):
    """Return (bands (4N-2, 7), right-hand side (4N-2,)); body k begins at row 4k.

    Rows of ẋ_k: D_k ẋ_k - C_kᵀ ρ_k - A_{k+1}ᵀ ρ_{k+1} = f_k, rows of ρ_k: -A_k ẋ_{k-1} - C_k ẋ_k =
    d_k. Entry (i, j) is in bands[i, 3 + j - i].
    """
    joints = before.shape[0]
    bands = np.zeros((4 * joints + 2, 7), before.dtype)
    right = np.zeros(4 * joints + 2, rest.dtype)
    for k in range(joints + 1):
        i = 4 * k
        bands[i, 3] = mass[2 * k]
        bands[i + 1, 3] = mass[2 * k + 1]
        if force is not None:
            right[i] = force[2 * k]
            right[i + 1] = force[2 * k + 1]
    for k in range(joints):
        i = 4 * k
        bands[i, 5] = bands[i + 2, 1] = -before[k, 0, 0]
        bands[i + 1, 4] = bands[i + 2, 2] = -before[k, 0, 1]
        bands[i, 6] = bands[i + 3, 0] = -before[k, 1, 0]
        bands[i + 1, 5] = bands[i + 3, 1] = -before[k, 1, 1]
        bands[i + 2, 5] = bands[i + 4, 1] = -after[k, 0, 0]
        bands[i + 2, 6] = bands[i + 5, 0] = -after[k, 0, 1]
        bands[i + 3, 4] = bands[i + 4, 2] = -after[k, 1, 0]
        bands[i + 3, 5] = bands[i + 5, 1] = -after[k, 1, 1]
        right[i + 2] = rest[k, 0]
        right[i + 3] = rest[k, 1]
    return bands, right


@generic
def joint_gaps(before, after, x):
    """Return the gaps A_k x_{k-1} + C_k x_k (n_b-1, 2), m/s; 0 where the joints hold."""
    gaps = np.zeros(before.shape[:2], x.dtype)
    for k in range(before.shape[0]):
        for i in range(2):
            gaps[k, i] = (
                before[k, i, 0] * x[2 * k]
                + before[k, i, 1] * x[2 * k + 1]
                + after[k, i, 0] * x[2 * k + 2]
                + after[k, i, 1] * x[2 * k + 3]
            )
    return gaps


@generic
def solution(mass, force, before, after, rest):
    """Return (ẋ (s,), joint forces ρ (n_b-1, 2))."""
    bands, right = system(mass, force, before, after, rest)
    unknowns = solve_banded(bands, right, "KKT")
    xdot = np.zeros(mass.size, unknowns.dtype)
    xdot[::2] = unknowns[::4]
    xdot[1::2] = unknowns[1::4]
    forces = np.zeros(rest.shape, unknowns.dtype)
    forces[:, 0] = unknowns[2::4]
    forces[:, 1] = unknowns[3::4]
    return xdot, forces


BANDED = Formulation(
    key="banded",
    name="Banded",
    equations="",
    order=(-1, 1, 2),
    level="acceleration",
    multipliers=True,
    multipliers_in_paper=None,
    state="q, x",
    uses="chain",
    partitioned=False,
    limits=(
        "Needs a scene whose bodies form a chain. As the augmented method: needs independent "
        "constraints and a mass that is positive on the motions they allow. A snake may have any "
        "cos α_i, 0 included, as long as its constraints are independent; with 1 or 2 links it "
        "fails in no other state."
    ),
    solution=solution,
)
