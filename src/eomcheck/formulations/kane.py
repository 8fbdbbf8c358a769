"""The variant of Kane's method: partial velocities summed over the bodies, Eqs. (22)-(23)."""

from __future__ import annotations

import numpy as np

from eomcheck.arithmetic.generic import generic
from eomcheck.arithmetic.linear import solve
from eomcheck.formulations.base import Formulation


@generic
def mass_matrix(partial_velocity, partial_angular_velocity, mass, inertia):
    """Return M_Kane (p, p) of Eq. (23)."""
    bodies, d, p = partial_velocity.shape
    e = partial_angular_velocity.shape[1]
    M_Kane = np.zeros((p, p), partial_velocity.dtype)
    for i in range(p):
        for j in range(i + 1):
            total = 0
            for k in range(bodies):
                for c in range(d):
                    total += mass[k] * partial_velocity[k, c, i] * partial_velocity[k, c, j]
                for c in range(e):
                    for f in range(e):
                        total += (
                            partial_angular_velocity[k, c, i]
                            * inertia[k, c, f]
                            * partial_angular_velocity[k, f, j]
                        )
            M_Kane[i, j] = M_Kane[j, i] = total
    return M_Kane


@generic
def inertia_remainder(
    partial_velocity,
    partial_angular_velocity,
    remainder,
    angular_remainder,
    mass,
    inertia,
    gyroscopic,
):
    """Return N_Kane q̇ + G_Kane (p,) of Eq. (23): the inertia forces at u̇ = 0.

    Neither N_Kane nor G_Kane is formed: their sum over q_j and t is the total rate of each body's
    velocities at constant u, which the scene gives.
    """
    bodies, d, p = partial_velocity.shape
    e = partial_angular_velocity.shape[1]
    left = np.zeros(p, partial_velocity.dtype)
    for k in range(bodies):
        for c in range(d):
            for i in range(p):
                left[i] += mass[k] * remainder[k, c] * partial_velocity[k, c, i]
        for c in range(e):
            moment = inertia[k, c, 0] * angular_remainder[k, 0]
            for f in range(1, e):
                moment += inertia[k, c, f] * angular_remainder[k, f]
            if gyroscopic is not None:
                moment += gyroscopic[k, c]
            for i in range(p):
                left[i] += moment * partial_angular_velocity[k, c, i]
    return left


@generic
def right_hand_side(force, left):
    """Return F_Kane - (N_Kane q̇ + G_Kane) (p,)."""
    if force is None:
        return -left
    return force - left


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
):
    """Return u̇ (p,): Eq. (22)."""
    M_Kane = mass_matrix(partial_velocity, partial_angular_velocity, mass, inertia)
    left = inertia_remainder(
        partial_velocity,
        partial_angular_velocity,
        remainder,
        angular_remainder,
        mass,
        inertia,
        gyroscopic,
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
)
