"""The snake as a chain of wheels: body k moves with x_k = (s_k, ω_k), O(N) throughout.

s_k = V_k · t_k is the rolling speed of wheel k. The mass is diagonal there. The wheel keeps
V̇_k · e_k = -s_k ω_k, so V̇_k = ẋ_k1 t_k - s_k ω_k e_k, and the joint between links k-1 and k, which
moves with both, gives two equations along (t_k, e_k). No division: α_k = ±π/2 is allowed.

Derived apart from the terms of `eomcheck.scenes.snake`, with the symbols used there;
ψ_k = φ_k - θ_{k-1} and δ_k = φ_k - φ_{k-1}.
"""

from __future__ import annotations

import numpy as np

from eomcheck.arithmetic.generic import generic
from eomcheck.model import Chain


@generic
def wheel_directions(cos_alpha, sin_alpha, cos, sin):
    """Return (cos φ, sin φ), each (N,)."""
    return cos_alpha * cos - sin_alpha * sin, sin_alpha * cos + cos_alpha * sin


@generic
def quasi_velocities(length, cos_phi, sin_phi, cos, sin, v):
    """Return x (N, 2) of any v: sums from the tip of link 1, none of which grows."""
    links = length.size
    x = np.zeros((links, 2), v.dtype)
    Vx, Vy = v[0], v[1]
    for k in range(links):
        across = length[k] / 2 * v[k + 2]
        Vx, Vy = Vx - across * sin[k], Vy + across * cos[k]
        x[k, 0] = Vx * cos_phi[k] + Vy * sin_phi[k]
        x[k, 1] = v[k + 2]
        Vx, Vy = Vx - across * sin[k], Vy + across * cos[k]
    return x


@generic
def diagonal(mass, inertia):
    """Return D (N, 2): m_k and I_k."""
    links = mass.size
    D = np.zeros((links, 2), mass.dtype)
    for k in range(links):
        D[k, 0] = mass[k]
        D[k, 1] = inertia[k]
    return D


@generic
def wheel_forces(stiffness, theta):
    """Return f (N, 2): the springs turn the links on both sides; None without springs."""
    if stiffness is None:
        return None
    torque = stiffness * (theta[1:] - theta[:-1])
    f = np.zeros((theta.size, 2), torque.dtype)
    f[0, 1] = torque[0]
    for k in range(1, torque.size):
        f[k, 1] = torque[k] - torque[k - 1]
    f[-1, 1] = -torque[-1]
    return f


@generic
def joints(length, cos_alpha, sin_alpha, cos_phi, sin_phi, cos, sin, x):
    """Return (A, C, d) of the joints.

    Velocity: s' t' + L'/2 ω' n' = s t - L/2 ω n (dashed: link k-1), and the acceleration
    likewise with V̇ = ẋ_1 t - s ω e and the rate -ω² (cos θ, sin θ) of n.
    """
    links = length.size
    A = np.zeros((links - 1, 2, 2), cos.dtype)
    C = np.zeros((links - 1, 2, 2), cos.dtype)
    d = np.zeros((links - 1, 2), x.dtype)
    for k in range(1, links):
        cos_psi = cos_phi[k] * cos[k - 1] + sin_phi[k] * sin[k - 1]
        sin_psi = sin_phi[k] * cos[k - 1] - cos_phi[k] * sin[k - 1]
        cos_delta = cos_phi[k] * cos_phi[k - 1] + sin_phi[k] * sin_phi[k - 1]
        sin_delta = sin_phi[k] * cos_phi[k - 1] - cos_phi[k] * sin_phi[k - 1]
        before, half = length[k - 1] / 2, length[k] / 2
        A[k - 1, 0, 0], A[k - 1, 0, 1] = cos_delta, before * sin_psi
        A[k - 1, 1, 0], A[k - 1, 1, 1] = sin_delta, -before * cos_psi
        C[k - 1, 0, 0], C[k - 1, 0, 1] = -1, half * sin_alpha[k]
        C[k - 1, 1, 1] = -half * cos_alpha[k]
        turning, spin = x[k - 1, 0] * x[k - 1, 1], before * x[k - 1, 1] * x[k - 1, 1]
        spin_after = half * x[k, 1] * x[k, 1]
        d[k - 1, 0] = turning * sin_delta - spin * cos_psi - spin_after * cos_alpha[k]
        d[k - 1, 1] = (
            x[k, 0] * x[k, 1] - turning * cos_delta - spin * sin_psi - spin_after * sin_alpha[k]
        )
    return A, C, d


@generic
def chain(parameters, angles, q, v):
    """Return the `Chain` of the snake."""
    mass, length, inertia, stiffness, cos_alpha, sin_alpha = parameters
    theta, cos, sin = angles
    cos_phi, sin_phi = wheel_directions(cos_alpha, sin_alpha, cos, sin)
    x = quasi_velocities(length, cos_phi, sin_phi, cos, sin, v)
    A, C, d = joints(length, cos_alpha, sin_alpha, cos_phi, sin_phi, cos, sin, x)
    return Chain(x, diagonal(mass, inertia), wheel_forces(stiffness, theta), A, C, d)


@generic
def chain_acceleration(parameters, angles, chain, xdot):
    """Return v̇ (N+2,): the tip of link 1 from wheel 1, then every ω̇_k."""
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    cos, sin = angles.cos[0], angles.sin[0]
    s, omega = chain.x[0, 0], chain.x[0, 1]
    cos_phi = cos_alpha[0] * cos - sin_alpha[0] * sin
    sin_phi = sin_alpha[0] * cos + cos_alpha[0] * sin
    half = length[0] / 2
    turning, spin, across = s * omega, half * omega * omega, half * xdot[0, 1]
    vdot = np.zeros(length.size + 2, xdot.dtype)
    vdot[0] = xdot[0, 0] * cos_phi - turning * sin_phi + across * sin + spin * cos
    vdot[1] = xdot[0, 0] * sin_phi + turning * cos_phi - across * cos + spin * sin
    vdot[2:] = xdot[:, 1]
    return vdot


@generic
def chain_multipliers(parameters, angles, chain, forces):
    """Return λ (N,), N: wheel k is held by m_k V̇_k · e_k less what its two joints give along e_k.

    Joint k+1 pulls body k by μ_{k+1}, whose component along e_k is (-sin δ, cos δ) · μ, and joint k
    pushes it by -μ_k.
    """
    mass, x, before = parameters.mass, chain.x, chain.before
    links = mass.size
    lambda_ = np.zeros(links, x.dtype)
    for k in range(links):
        lambda_[k] = -mass[k] * x[k, 0] * x[k, 1]
    for k in range(1, links):
        lambda_[k] += forces[k - 1, 1]
        lambda_[k - 1] += before[k - 1, 1, 0] * forces[k - 1, 0]
        lambda_[k - 1] -= before[k - 1, 0, 0] * forces[k - 1, 1]
    return lambda_
