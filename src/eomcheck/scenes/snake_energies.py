"""The second derivation of the snake, from positions and velocities only: rule 8 of the contracts.

Energies, dissipation and the sideways speeds of the wheels. Nothing here reads M or a, and engines
differentiate it. Symbols are those of `eomcheck.scenes.snake`.
"""

from __future__ import annotations

import numpy as np


def passed_on(length, angles, x, y, omega):
    """Return the velocities of links one behind the other, centres (N, 2) and rotation (N, 1).

    Passed on from joint to joint: the first moves with (x, y), link i turns at omega_i.
    """
    links = length.size
    V = np.zeros((links, 2), omega.dtype)
    for i in range(links):
        V[i, 0] = x - length[i] / 2 * omega[i] * angles.sin[i]
        V[i, 1] = y + length[i] / 2 * omega[i] * angles.cos[i]
        x = x - length[i] * omega[i] * angles.sin[i]
        y = y + length[i] * omega[i] * angles.cos[i]
    return V, omega.reshape(links, 1)


def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (N, 2) and of rotation (N, 1), Eq. (25)."""
    return passed_on(parameters.length, angles, v[0], v[1], v[2:])


def positions(parameters, angles, q):
    """Return where the centres of mass are (N, 2)."""
    length = parameters.length
    found, x, y = np.zeros((length.size, 2), q.dtype), q[0], q[1]
    for i in range(length.size):
        found[i, 0] = x + length[i] * angles.cos[i] / 2
        found[i, 1] = y + length[i] * angles.sin[i] / 2
        x = x + length[i] * angles.cos[i]
        y = y + length[i] * angles.sin[i]
    return found


def of_joints(factor, x):
    """Return Σ f_i (x_{i+1} - x_i)² / 2 over the joints, or None where no joint has an f."""
    if factor is None:
        return None
    total = 0
    for k in range(factor.size):
        total += factor[k] * (x[k + 1] - x[k]) * (x[k + 1] - x[k]) / 2
    return total


def potential(parameters, angles, q):
    """Return U, J, of the springs, Eq. (26); None without."""
    return of_joints(parameters.stiffness, angles.value)


def dissipation(parameters, angles, q, v):
    """Return R, W: half the power that the dampers take; None without dampers."""
    _, omega = velocities(parameters, angles, q, v)
    return of_joints(parameters.damping, omega[:, 0])


def constraint(parameters, angles, q, v):
    """Return c (N,), m/s: the velocity of each wheel along its axle, Eq. (28)."""
    V, _ = velocities(parameters, angles, q, v)
    c = np.zeros(V.shape[0], v.dtype)
    for i in range(V.shape[0]):
        cos_alpha, sin_alpha = parameters.cos_alpha[i], parameters.sin_alpha[i]
        cos_phi = cos_alpha * angles.cos[i] - sin_alpha * angles.sin[i]
        sin_phi = sin_alpha * angles.cos[i] + cos_alpha * angles.sin[i]
        c[i] = V[i, 0] * sin_phi - V[i, 1] * cos_phi
    return c
