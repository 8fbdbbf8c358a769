"""Lagrange's terms of the snake: M and a in O(N²), the rest in O(N) (Sec. 10, Eqs. (25)-(28)).

Symbols are those of `eomcheck.scenes.snake`.
"""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.records import Terms


def carried(mass, length):
    """Return (tail, mu), each (N,): the mass behind link i, and L_i (m_i/2 + tail_i)."""
    tail = np.zeros_like(mass)
    for i in range(mass.size - 1, 0, -1):
        tail[i - 1] = tail[i] + mass[i]
    return tail, length * (mass / 2 + tail)


def mass_matrix(mass, length, inertia, cos, sin):
    """Return M (N+2, N+2): the Hessian of the kinetic energy of Eq. (25) in v."""
    links = mass.size
    tail, mu = carried(mass, length)
    M = np.zeros((links + 2, links + 2), cos.dtype)
    M[0, 0] = M[1, 1] = tail[0] + mass[0]
    for i in range(links):
        M[0, i + 2] = M[i + 2, 0] = -mu[i] * sin[i]
        M[1, i + 2] = M[i + 2, 1] = mu[i] * cos[i]
        M[i + 2, i + 2] = length[i] * length[i] * (mass[i] / 4 + tail[i]) + inertia[i]
        for j in range(i):
            coupling = length[j] * mu[i] * (cos[i] * cos[j] + sin[i] * sin[j])
            M[i + 2, j + 2] = M[j + 2, i + 2] = coupling
    return M


def bias(mass, length, cos, sin, omega):
    """Return B (N+2,): the centrifugal part of the equations of motion."""
    links = mass.size
    mu = carried(mass, length)[1]
    B = np.zeros(links + 2, omega.dtype)
    for i in range(links):
        B[0] -= mu[i] * cos[i] * omega[i] * omega[i]
        B[1] -= mu[i] * sin[i] * omega[i] * omega[i]
    # Row i sums nu_ij sin(θ_i - θ_j) ω_j² with nu_ij = L_min mu_max: once from the head up to i,
    # where mu_i is common, and once from the tail down to i, where L_i is.
    along = across = 0
    for i in range(links):
        B[i + 2] += mu[i] * (sin[i] * along - cos[i] * across)
        along = along + length[i] * cos[i] * omega[i] * omega[i]
        across = across + length[i] * sin[i] * omega[i] * omega[i]
    along = across = 0
    for i in range(links - 1, -1, -1):
        B[i + 2] += length[i] * (sin[i] * along - cos[i] * across)
        along = along + mu[i] * cos[i] * omega[i] * omega[i]
        across = across + mu[i] * sin[i] * omega[i] * omega[i]
    return B


def spring_torque(stiffness, theta, joint):
    """Return k_i (θ_i - θ_{i+1}) of one joint, N m (Eq. (D2))."""
    return stiffness[joint] * (theta[joint] - theta[joint + 1])


def joint_torque(stiffness, damping, theta, omega, joint):
    """Return T_i = k_i (θ_i - θ_{i+1}) + d_i (ω_i - ω_{i+1}) of one joint, N m."""
    if damping is None:
        return spring_torque(stiffness, theta, joint)
    damper = damping[joint] * (omega[joint] - omega[joint + 1])
    if stiffness is None:
        return damper
    return spring_torque(stiffness, theta, joint) + damper


def joint_forces(stiffness, damping, theta, omega):
    """Return Q (N+2,) of springs and dampers, Eqs. (26)-(27), or None without both."""
    if stiffness is None and damping is None:
        return None
    Q = np.zeros(theta.size + 2, theta.dtype)
    for k in range(theta.size - 1):
        torque = joint_torque(stiffness, damping, theta, omega, k)
        Q[k + 2] -= torque
        Q[k + 3] += torque
    return Q


def rolling_directions(cos_alpha, sin_alpha, cos, sin):
    """Return (cos φ, sin φ), of one wheel or of all (N,)."""
    return cos_alpha * cos - sin_alpha * sin, sin_alpha * cos + cos_alpha * sin


def first_wheel(parameters, angles):
    """Return (cos φ_1, sin φ_1)."""
    cos_alpha, sin_alpha = parameters.cos_alpha[0], parameters.sin_alpha[0]
    return rolling_directions(cos_alpha, sin_alpha, angles.cos[0], angles.sin[0])


def constraints(parameters, angles, q):
    """Return (a (N, N+2), None) of Eq. (28): row i is the velocity of wheel i along its axle."""
    length, cos_alpha, cos, sin = parameters.length, parameters.cos_alpha, angles.cos, angles.sin
    links = length.size
    cos_phi, sin_phi = rolling_directions(cos_alpha, parameters.sin_alpha, cos, sin)
    a = np.zeros((links, links + 2), cos.dtype)
    for i in range(links):
        a[i, 0] = sin_phi[i]
        a[i, 1] = -cos_phi[i]
        for j in range(i):
            a[i, j + 2] = -length[j] * (cos_phi[i] * cos[j] + sin_phi[i] * sin[j])
        a[i, i + 2] = -length[i] / 2 * cos_alpha[i]
    return a, None


def drift(parameters, angles, q, v):
    """Return gamma = ȧ v (N,): the rate of V_i · e_i at v̇ = 0, where ė_i = ω_i t_i."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    cos_phi, sin_phi = rolling_directions(parameters.cos_alpha, parameters.sin_alpha, cos, sin)
    links = length.size
    gamma = np.zeros(links, v.dtype)
    Vx, Vy = v[0], v[1]
    Ax = Ay = 0
    for i in range(links):
        omega = v[i + 2]
        half = length[i] / 2
        # Velocity and acceleration at v̇ = 0: from the front end of the link to its centre ...
        Vx, Vy = Vx - half * omega * sin[i], Vy + half * omega * cos[i]
        Ax, Ay = Ax - half * omega * omega * cos[i], Ay - half * omega * omega * sin[i]
        gamma[i] = Ax * sin_phi[i] - Ay * cos_phi[i] + omega * (Vx * cos_phi[i] + Vy * sin_phi[i])
        # ... and on to its rear end.
        Vx, Vy = Vx - half * omega * sin[i], Vy + half * omega * cos[i]
        Ax, Ay = Ax - half * omega * omega * cos[i], Ay - half * omega * omega * sin[i]
    return gamma


def forces(parameters, angles, q, v):
    """Return Q (N+2,) of springs and dampers, or None."""
    return joint_forces(parameters.stiffness, parameters.damping, angles.value, v[2:])


def terms(parameters, angles, q, v):
    """Return the `Terms` of the snake; b is None, for wheels do not depend on time."""
    mass, length, cos, sin = parameters.mass, parameters.length, angles.cos, angles.sin
    M = mass_matrix(mass, length, parameters.inertia, cos, sin)
    Q = forces(parameters, angles, q, v)
    B = bias(mass, length, cos, sin, v[2:])
    a, b = constraints(parameters, angles, q)
    return Terms(M, Q, B, a, drift(parameters, angles, q, v), b)
