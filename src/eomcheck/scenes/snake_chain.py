"""The snake as a chain of wheels: link k moves with its rolling speed s_k = V_k · t_k and with ω_k.

The wheel keeps V̇_k · e_k = -s_k ω_k, so V̇_k = ṡ_k t_k - s_k ω_k e_k and the mass is diagonal in
x = (s_1, ω_1, s_2, ω_2, ...). The joint between links k-1 and k moves with both of them, which
gives two equations, written along t_k and e_k. Nothing is divided by: α_k = ±π/2 is allowed.

Derived apart from the terms of `eomcheck.scenes.snake`, with the symbols used there;
ψ_k = φ_k - θ_{k-1} and δ_k = φ_k - φ_{k-1}. Everything is O(N).
"""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.records import Chain
from eomcheck.scenes.snake_terms import first_wheel, rolling_directions


def quasi_velocities(parameters, angles, q, v):
    """Return x (2N,) of any v: plain sums from the tip of link 1, in which nothing grows."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    cos_phi, sin_phi = rolling_directions(parameters.cos_alpha, parameters.sin_alpha, cos, sin)
    links = length.size
    x = np.zeros(2 * links, v.dtype)
    Vx, Vy = v[0], v[1]
    for k in range(links):
        across = length[k] / 2 * v[k + 2]
        Vx, Vy = Vx - across * sin[k], Vy + across * cos[k]
        x[2 * k] = Vx * cos_phi[k] + Vy * sin_phi[k]
        x[2 * k + 1] = v[k + 2]
        Vx, Vy = Vx - across * sin[k], Vy + across * cos[k]
    return x


def chain_velocity(parameters, angles, q, x):
    """Return v (N+2,): the tip of link 1 from wheel 1, then every ω_k."""
    cos, sin = angles.cos[0], angles.sin[0]
    cos_phi, sin_phi = first_wheel(parameters, angles)
    across = parameters.length[0] / 2 * x[1]
    v = np.zeros(parameters.length.size + 2, x.dtype)
    v[0] = x[0] * cos_phi + across * sin
    v[1] = x[0] * sin_phi - across * cos
    v[2:] = x[1::2]
    return v


def chain_acceleration(parameters, angles, x, xdot):
    """Return v̇ (N+2,), as `chain_velocity` with V̇_1 and the rate -ω² (cos θ, sin θ) of n_1."""
    cos, sin = angles.cos[0], angles.sin[0]
    cos_phi, sin_phi = first_wheel(parameters, angles)
    half = parameters.length[0] / 2
    turning, spin, across = x[0] * x[1], half * x[1] * x[1], half * xdot[1]
    vdot = np.zeros(parameters.length.size + 2, xdot.dtype)
    vdot[0] = xdot[0] * cos_phi - turning * sin_phi + across * sin + spin * cos
    vdot[1] = xdot[0] * sin_phi + turning * cos_phi - across * cos + spin * sin
    vdot[2:] = xdot[1::2]
    return vdot


def wheel_masses(mass, inertia):
    """Return D (2N,): m_1, I_1, m_2, I_2, ..."""
    D = np.zeros(2 * mass.size, mass.dtype)
    D[::2] = mass
    D[1::2] = inertia
    return D


def torques_on(stiffness, damping, theta, omega):
    """Return what each joint turns its front link with (N-1,), N m; None without all of it."""
    if damping is None:
        if stiffness is None:
            return None
        return stiffness * (theta[1:] - theta[:-1])
    if stiffness is None:
        return damping * (omega[1:] - omega[:-1])
    return stiffness * (theta[1:] - theta[:-1]) + damping * (omega[1:] - omega[:-1])


def wheel_forces(torque, theta):
    """Return f (2N,): the joints turn the links on both sides; None without torques (N-1,)."""
    if torque is None:
        return None
    f = np.zeros(2 * theta.size, torque.dtype)
    f[1] = torque[0]
    for k in range(1, torque.size):
        f[2 * k + 1] = torque[k] - torque[k - 1]
    f[-1] = -torque[-1]
    return f


def joints(length, cos_alpha, sin_alpha, cos, sin, x):
    """Return (A, C, d) of s' t' + L'/2 ω' n' = s t - L/2 ω n (dashed: link k-1) and of its rate."""
    cos_phi, sin_phi = rolling_directions(cos_alpha, sin_alpha, cos, sin)
    links = length.size
    A = np.zeros((links - 1, 2, 2), cos.dtype)
    C = np.zeros((links - 1, 2, 2), cos.dtype)
    d = np.zeros((links - 1, 2), x.dtype)
    for j in range(links - 1):
        k = j + 1
        cos_psi = cos_phi[k] * cos[j] + sin_phi[k] * sin[j]
        sin_psi = sin_phi[k] * cos[j] - cos_phi[k] * sin[j]
        cos_delta = cos_phi[k] * cos_phi[j] + sin_phi[k] * sin_phi[j]
        sin_delta = sin_phi[k] * cos_phi[j] - cos_phi[k] * sin_phi[j]
        before, half = length[j] / 2, length[k] / 2
        A[j, 0, 0], A[j, 0, 1] = cos_delta, before * sin_psi
        A[j, 1, 0], A[j, 1, 1] = sin_delta, -before * cos_psi
        C[j, 0, 0], C[j, 0, 1] = -1, half * sin_alpha[k]
        C[j, 1, 1] = -half * cos_alpha[k]
        s_before, omega_before, s, omega = x[2 * j], x[2 * j + 1], x[2 * k], x[2 * k + 1]
        turning, spin_before = s_before * omega_before, before * omega_before * omega_before
        spin = half * omega * omega
        d[j, 0] = turning * sin_delta - spin_before * cos_psi - spin * cos_alpha[k]
        d[j, 1] = s * omega - turning * cos_delta - spin_before * sin_psi - spin * sin_alpha[k]
    return A, C, d


def chain(parameters, angles, q, x):
    """Return the `Chain` of the snake."""
    cos_alpha, sin_alpha = parameters.cos_alpha, parameters.sin_alpha
    torque = torques_on(parameters.stiffness, parameters.damping, angles.value, x[1::2])
    A, C, d = joints(parameters.length, cos_alpha, sin_alpha, angles.cos, angles.sin, x)
    D = wheel_masses(parameters.mass, parameters.inertia)
    return Chain(D, wheel_forces(torque, angles.value), A, C, d)


def chain_multipliers(parameters, angles, chain, x, forces):
    """Return λ (N,), N: wheel k is held by m_k V̇_k · e_k less what its two joints give along e_k.

    Joint k+1 pulls body k by ρ_{k+1}, whose component along e_k is (-sin δ, cos δ) · ρ_{k+1}, and
    joint k pushes it by -ρ_k.
    """
    mass, before = parameters.mass, chain.before
    links = mass.size
    lambda_ = np.zeros(links, x.dtype)
    for k in range(links):
        lambda_[k] = -mass[k] * x[2 * k] * x[2 * k + 1]
    for j in range(links - 1):
        along, across = forces[j, 0], forces[j, 1]
        lambda_[j] += before[j, 1, 0] * along - before[j, 0, 0] * across
        lambda_[j + 1] += across
    return lambda_
