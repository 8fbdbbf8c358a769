"""The variant of Kane's method: partial velocities summed over the bodies, Eqs. (22)-(23)."""

from __future__ import annotations

import numpy as np

from eomcheck.formulations.formulation import Formulation
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import add_congruence, solve


@generic
def inertia_sums(
    partial_velocity,
    partial_angular_velocity,
    remainder,
    angular_remainder,
    mass,
    inertia,
    gyroscopic,
    support=None,
):
    """Return M_Kane (p, p) and N_Kane q̇ + G_Kane (p,), the inertia forces at u̇ = 0 (Eq. (23)).

    Neither N_Kane nor G_Kane is formed: their sum over q_j and t is the total rate of each body's
    velocities at constant u, which the scene provides.
    """
    p = partial_velocity.shape[2]
    both = np.zeros((p, p + 1), partial_velocity.dtype)
    M_Kane, left = both[:, :p], both[:, p]
    add_congruence(both, partial_velocity, mass, remainder, None, support)
    turning = partial_angular_velocity, inertia, angular_remainder
    add_congruence(both, *turning, gyroscopic, support)
    for i in range(p):
        for j in range(i):
            M_Kane[j, i] = M_Kane[i, j]
    return M_Kane, left


@generic
def right_hand_side(force, left):
    """Return F_Kane - (N_Kane q̇ + G_Kane) (p,), written into `left`."""
    for i in range(left.size):
        left[i] = -left[i] if force is None else force[i] - left[i]
    return left


@generic
def solution(
    partial_velocity,
    partial_angular_velocity,
    remainder,
    angular_remainder,
    mass,
    inertia,
    gyroscopic,
    force,
    support=None,
):
    """Return u̇ (p,): Eq. (22)."""
    M_Kane, left = inertia_sums(
        partial_velocity,
        partial_angular_velocity,
        remainder,
        angular_remainder,
        mass,
        inertia,
        gyroscopic,
        support,
    )
    return solve(M_Kane, right_hand_side(force, left), "M_Kane")


KANE = Formulation(
    key="kane",
    name="Kane (variant)",
    equations="(22)-(23)",
    order=(1, -1),
    level="velocity",
    multipliers=False,
    multipliers_in_paper=False,
    state="q, u",
    uses="bodies",
    partitioned=False,
    limits=(
        "Needs the scene's generalized speeds: for the snake cos α_i must not be 0 for i >= 2. "
        "N = 1 has no such wheel; no pose of 1 or 2 links is an exception."
    ),
    solution=solution,
    sparse=True,
)
