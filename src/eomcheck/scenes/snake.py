"""The paper's N-link snake robot on passive wheels that do not slip sideways (Sec. 10).

N rigid links in the plane, coupled by torsion springs. Wheel i sits at the centre of mass of link
i, turned by the constant angle α_i against it; q = [x, y, θ_1 .. θ_N], (x, y) the free tip of link
1, θ absolute. Below, per link i: n_i = (-sin θ_i, cos θ_i) is normal to the link, φ_i = α_i + θ_i
the direction in which the wheel rolls, t_i = (cos φ_i, sin φ_i), and e_i = (sin φ_i, -cos φ_i) its
axle (Eq. (28)). The generalized speeds are u = (s_1, ω_1): rolling speed of wheel 1 and angular
velocity of link 1 (Eq. (29)).

- Lagrange's terms: M and a in O(N²), the rest in O(N) (Eqs. (25)-(28))
- Generalized speeds and partial velocities, by recursion in O(N) (Eqs. (22), (29))
- A chain of wheels, in O(N): link k moves with its rolling speed s_k = V_k · t_k and with ω_k. The
  wheel keeps V̇_k · e_k = -s_k ω_k, so V̇_k = ṡ_k t_k - s_k ω_k e_k and the mass is diagonal in
  x = (s_1, ω_1, s_2, ω_2, ...). The joint between links k-1 and k moves with both of them, which
  gives two equations, written along t_k and e_k. There is no division: α_k = ±π/2 is allowed. It
  is derived apart from the terms; ψ_k = φ_k - θ_{k-1} and δ_k = φ_k - φ_{k-1}
- The second derivation (rule 8 of `eomcheck.mechanics.scene`): energies, dissipation and the
  sideways speeds of the wheels, from positions and velocities only. Nothing in it reads M or a, and
  engines differentiate it
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import (
    OfLinks,
    number_of_links,
    of_joints,
    of_links,
    parameter,
    stretched,
)
from eomcheck.mechanics.records import (
    Bodies,
    Chain,
    Range,
    Speeds,
    Symmetry,
    Terms,
    Tree,
    planar_tree,
    plane_mirror,
    plane_rotation,
    plane_translation,
)
from eomcheck.numbers.generic import EPS, Arithmetic, Array

# ---- Lagrange's terms ----------------------------------------------------------------------------


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


# ---- Generalized speeds --------------------------------------------------------------------------


class SnakeKinematics(NamedTuple):
    """Rolling speed s_k and angular velocity ω_k of each link: s_k = s_u u, ṡ_k = s_u u̇ + s_rest.

    The centre of mass of link k moves with s_k t_k. The rate of t_k is normal to t_k, so only ṡ_k
    does work on a partial velocity, and one number per link stands for the linear part: d = 1 in
    `Bodies`, whose shapes these are.
    """

    s_u: Any
    """∂s_k/∂u (N, 1, 2)."""
    omega_u: Any
    """∂ω_k/∂u (N, 1, 2)."""
    s_rest: Any
    """ṡ_k at u̇ = 0 (N, 1)."""
    omega_rest: Any
    """ω̇_k at u̇ = 0 (N, 1)."""
    u: Any
    """(s_1, ω_1)."""
    v: Any
    """q̇ (N+2,): velocity of the tip of link 1, then every ω_k."""


def kinematics(parameters, angles, q, u):
    """Return the kinematics by recursion of (s, ω) from link to link.

    The joint between links k-1 and k moves with both: s' t' + L'/2 ω' n' = s t - L/2 ω n (dashed:
    link k-1). Its component along e_k gives ω_k and is divided by L_k/2 cos α_k, the one along t_k
    gives s_k; the rates follow in the same way from the accelerations.
    """
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    cos, sin = angles.cos, angles.sin
    links = length.size
    partials, rests = np.empty((2, links, 1, 2), cos.dtype), np.empty((2, links, 1), cos.dtype)
    s_u, omega_u, s_rest, omega_rest = partials[0], partials[1], rests[0], rests[1]
    s_u[0, 0, 0] = omega_u[0, 0, 1] = 1
    s_u[0, 0, 1] = omega_u[0, 0, 0] = s_rest[0, 0] = omega_rest[0, 0] = 0
    s, omega = u[0], u[1]
    half = length[0] / 2
    v = np.empty(links + 2, cos.dtype)
    cos_phi, sin_phi = first_wheel(parameters, angles)
    v[0] = s * cos_phi + half * sin[0] * omega
    v[1] = s * sin_phi - half * cos[0] * omega
    v[2] = omega
    for k in range(1, links):
        # psi = φ_k - θ_{k-1} and delta = φ_k - φ_{k-1}
        cos_turn = cos[k] * cos[k - 1] + sin[k] * sin[k - 1]
        sin_turn = sin[k] * cos[k - 1] - cos[k] * sin[k - 1]
        cos_psi = cos_turn * cos_alpha[k] - sin_turn * sin_alpha[k]
        sin_psi = sin_turn * cos_alpha[k] + cos_turn * sin_alpha[k]
        cos_delta = cos_psi * cos_alpha[k - 1] + sin_psi * sin_alpha[k - 1]
        sin_delta = sin_psi * cos_alpha[k - 1] - cos_psi * sin_alpha[k - 1]
        before, half = half, length[k] / 2
        lever = half * cos_alpha[k]
        offset = half * sin_alpha[k]

        ww_s = sin_delta / lever
        ww_w = -before * cos_psi / lever
        ss_s = cos_delta + offset * ww_s
        ss_w = before * sin_psi + offset * ww_w
        for i in range(2):
            omega_u[k, 0, i] = ww_s * s_u[k - 1, 0, i] + ww_w * omega_u[k - 1, 0, i]
            s_u[k, 0, i] = ss_s * s_u[k - 1, 0, i] + ss_w * omega_u[k - 1, 0, i]
        s_before, omega_before = s, omega
        omega = ww_s * s_before + ww_w * omega_before
        s = ss_s * s_before + ss_w * omega_before
        v[k + 2] = omega

        spin = before * omega_before * omega_before
        turning = s_before * omega_before
        along_axle = s * omega - turning * cos_delta - spin * sin_psi - offset * omega * omega
        # The term of the previous link is added last: nothing else waits for it.
        rate = along_axle / lever + ww_s * s_rest[k - 1, 0] + ww_w * omega_rest[k - 1, 0]
        omega_rest[k, 0] = rate
        s_rest[k, 0] = (
            turning * sin_delta
            - spin * cos_psi
            - lever * omega * omega
            + cos_delta * s_rest[k - 1, 0]
            + before * sin_psi * omega_rest[k - 1, 0]
            + offset * rate
        )
    return SnakeKinematics(s_u, omega_u, s_rest, omega_rest, u, v)


def speeds(parameters, angles, rolling):
    """Return the `Speeds` of the snake: the tip of link 1 from (s_1, ω_1), then every ω_k."""
    length = parameters.length
    cos, sin = angles.cos, angles.sin
    links = length.size
    half = length[0] / 2
    cos_phi, sin_phi = first_wheel(parameters, angles)
    turning = rolling.u[0] * rolling.u[1]
    spin = half * rolling.u[1] * rolling.u[1]
    W = np.zeros((links + 2, 2), cos.dtype)
    rest = np.zeros(links + 2, cos.dtype)
    W[0, 0], W[0, 1] = cos_phi, half * sin[0]
    W[1, 0], W[1, 1] = sin_phi, -half * cos[0]
    rest[0] = spin * cos[0] - turning * sin_phi
    rest[1] = spin * sin[0] + turning * cos_phi
    W[2:] = rolling.omega_u[:, 0]
    rest[2:] = rolling.omega_rest[:, 0]
    return Speeds(W, rest, None)


def qdot(parameters, angles, rolling):
    """Return W u of `speeds` from the recursion, without forming W."""
    return rolling.v


def active_forces(stiffness, damping, theta, omega, omega_u):
    """Return F_Kane (2,) of springs and dampers by Eq. (D1), or None without both."""
    if stiffness is None and damping is None:
        return None
    force = np.zeros(2, theta.dtype)
    for k in range(theta.size - 1):
        torque = joint_torque(stiffness, damping, theta, omega, k)
        for i in range(2):
            force[i] += torque * (omega_u[k + 1, 0, i] - omega_u[k, 0, i])
    return force


def bodies(parameters, angles, rolling):
    """Return the `Bodies` of the snake, d = e = 1: along the wheel and about the vertical."""
    stiffness, damping = parameters.stiffness, parameters.damping
    theta, omega = angles.value, rolling.v[2:]
    return Bodies(
        rolling.s_u,
        rolling.omega_u,
        rolling.s_rest,
        rolling.omega_rest,
        parameters.mass,
        parameters.inertia[:, np.newaxis, np.newaxis],
        None,
        active_forces(stiffness, damping, theta, omega, rolling.omega_u),
    )


def speeds_of(parameters, angles, q, v):
    """Return u = (s_1, ω_1) of a velocity v (Eq. (29)): V_1 · t_1 and θ̇_1."""
    length, sin_alpha = parameters.length, parameters.sin_alpha
    cos_phi, sin_phi = first_wheel(parameters, angles)
    rolling = v[0] * cos_phi + v[1] * sin_phi + length[0] / 2 * sin_alpha[0] * v[2]
    return np.array([rolling, v[2]], v.dtype)


# ---- A chain of wheels ---------------------------------------------------------------------------


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
    """Return the torque of each joint on its front link (N-1,), N m; None without both."""
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


def joint_equations(length, cos_alpha, sin_alpha, cos, sin, x):
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
    A, C, d = joint_equations(parameters.length, cos_alpha, sin_alpha, angles.cos, angles.sin, x)
    D = wheel_masses(parameters.mass, parameters.inertia)
    return Chain(D, wheel_forces(torque, angles.value), A, C, d)


def chain_multipliers(parameters, angles, chain, x, forces):
    """Return λ (N,), N: m_k V̇_k · e_k less the components of the two joint forces along e_k.

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


def chain_load(parameters, angles, tau):
    """Return (f (2N,), λ (N,)) of tau (N+2,): a force on the tip of link 1, and torques.

    What the force does not do along t_1 and on ω_1, the first wheel holds along e_1.
    """
    cos, sin = angles.cos[0], angles.sin[0]
    cos_phi, sin_phi = first_wheel(parameters, angles)
    half, links = parameters.length[0] / 2, parameters.length.size
    f = np.zeros(2 * links, tau.dtype)
    f[0] = tau[0] * cos_phi + tau[1] * sin_phi
    f[1::2] = tau[2:]
    f[1] += half * (tau[0] * sin - tau[1] * cos)
    lambda_ = np.zeros(links, tau.dtype)
    lambda_[0] = tau[1] * cos_phi - tau[0] * sin_phi
    return f, lambda_


# ---- The second derivation: positions and velocities only ----------------------------------------


def link_velocities(length, angles, x, y, omega):
    """Return the velocities of links one behind the other, centres (N, 2) and rotation (N, 1).

    Recursion from joint to joint: the first moves with (x, y), link i turns at omega_i.
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
    return link_velocities(parameters.length, angles, v[0], v[1], v[2:])


def positions(parameters, angles, q):
    """Return the positions of the centres of mass (N, 2)."""
    length = parameters.length
    found, x, y = np.zeros((length.size, 2), q.dtype), q[0], q[1]
    for i in range(length.size):
        found[i, 0] = x + length[i] * angles.cos[i] / 2
        found[i, 1] = y + length[i] * angles.sin[i] / 2
        x = x + length[i] * angles.cos[i]
        y = y + length[i] * angles.sin[i]
    return found


def half_squares(factor, x):
    """Return Σ f_i (x_{i+1} - x_i)² / 2 over the joints, or None where no joint has an f."""
    if factor is None:
        return None
    total = 0
    for k in range(factor.size):
        total += factor[k] * (x[k + 1] - x[k]) * (x[k + 1] - x[k]) / 2
    return total


def potential(parameters, angles, q):
    """Return the potential energy U, J, of the springs, Eq. (26); None without."""
    return half_squares(parameters.stiffness, angles.value)


def dissipation(parameters, angles, q, v):
    """Return the dissipation R, W, half the power of the dampers; None without dampers."""
    _, omega = velocities(parameters, angles, q, v)
    return half_squares(parameters.damping, omega[:, 0])


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


# ---- The scene -----------------------------------------------------------------------------------

OF_JOINTS = ("stiffness", "damping")
"""Parameters with one entry per joint."""


class Snake(OfLinks, functions=globals()):
    """An N-link wheeled snake, N >= 1; the paper's robot has N = 7.

    For i >= 2 the generalized speeds (`ml`, `kane`) do not exist where a wheel stands at ±π/2
    against its link, nor for i <= N-2 the paper's partition (`el`, `em`).
    """

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), of_links)
    length: Any = parameter("L", "m", "> 0", (0.1, 10.0), of_links)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), of_links)
    stiffness: Any = parameter("K", "N m/rad", "", (0.0, 1e4, None), of_joints)
    wheel_angle: Any = parameter("α to links", "rad", "", (-1.0, 1.0), of_links, read=False)
    pose: Any = parameter("θ at t = 0", "rad", shape=of_links, default=stretched, read=False)
    damping: Any = parameter("", "N m s/rad", ">= 0", (0.0, 100.0, None), of_joints, default=None)

    key = "snake"
    one_mass_each = "a snake has at least 1 link, one mass each"
    conserves_energy = True
    usually_absent = frozenset({"damping"})
    angle_coordinates = slice(2, None)

    def __post_init__(self):
        links = self.counted_links()
        for name in OF_JOINTS:
            if links == 1 and np.size(getattr(self, name)) == 0:
                object.__setattr__(self, name, None)
        self.check_fields(links)
        if self.damping is not None:
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers in the joints take it")

    @classmethod
    def paper(cls) -> Snake:
        """Return the seven-link robot of Sec. 11 with the digits printed there."""
        alpha = [0.0175, 0.0349, 0.0524, 0.0698, 0.0873, 0.1047, 0.1222]
        theta = [0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]
        return cls([1.0] * 7, [1.0] * 7, [0.0833] * 7, [5000.0] * 6, alpha, theta)

    @classmethod
    def example(cls) -> Snake:
        """Return the paper's robot."""
        return cls.paper()

    @classmethod
    def coil(cls, links: int) -> Snake:
        """Return the paper's robot with any number of links, α_i = 7° i/N, coiled by 308°.

        At N = 7 these are the paper's angles up to its rounding.
        """
        return cls._uniform(links, 7.0 / number_of_links(links))

    @classmethod
    def pattern(cls, links: int) -> Snake:
        """Return the literal continuation of the paper's angles, α_i = i° and θ_i = 44° i.

        Wheels turn against their links along the chain: near i = 90 they stand across it.
        """
        return cls._uniform(number_of_links(links), 1.0)

    @classmethod
    def _uniform(cls, links: int, degrees: float) -> Snake:
        one = np.ones(links)
        alpha = np.radians(degrees) * np.arange(1, links + 1)
        return cls(one, one, 0.0833 * one, 5000.0 * one[1:], alpha, 44.0 * alpha)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Snake]:
        """Yield a coiled snake; if it has joints, with and without springs, dampers, both."""
        coil = cls.coil(number_of_links(links))
        yield coil
        if coil.links > 1:
            yield replace(coil, stiffness=None)
            yield replace(coil, damping=np.ones(coil.links - 1))
            yield replace(coil, stiffness=None, damping=np.ones(coil.links - 1))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return the sampling ranges of ordinary snakes; a seed samples in this order."""
        ranges = super().ranges(links)
        ranges["wheel_angle"] = ranges.pop("wheel_angle")
        return ranges

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`, the tip of link 1 at the origin."""
        return np.concatenate(([0.0, 0.0], self.pose)), np.zeros(self.n)

    def __repr__(self) -> str:
        values = {name: getattr(self, name) for name in self.declared}
        if not self.pose.any():
            del values["pose"]
        if self.damping is None:
            del values["damping"]
        listed = (f"{k}={None if v is None else v.tolist()}" for k, v in values.items())
        return f"{type(self).__name__}({', '.join(listed)})"

    @property
    def n(self) -> int:
        """N + 2 coordinates."""
        return self.links + 2

    @property
    def r(self) -> int:
        """N constraints, one per wheel."""
        return self.links

    @property
    def s(self) -> int:
        """2 N quasi-velocities, two per link."""
        return 2 * self.links

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names x, y, θ_1 .. θ_N."""
        return ("x", "y", *(f"θ_{i + 1}" for i in range(self.links)))

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names wheel 1 .. wheel N."""
        return tuple(f"wheel {i + 1}" for i in range(self.links))

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return cosines and sines of the wheels' angles (N,)."""
        wheel = arithmetic.angles(self.wheel_angle)
        return {"cos_alpha": wheel.cos, "sin_alpha": wheel.sin}

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |cos α_i| <= 4 eps for i >= 2: the recursion divides by it.

        The float64 nearest to π/2 has the cosine 6e-17, so "exactly" needs this margin.
        """
        cosine = np.abs(np.cos(self.wheel_angle))
        cosine[0] = 1.0
        worst = int(np.argmin(cosine))
        if cosine[worst] <= 4 * EPS:
            raise RefusedError(
                "cos α",
                float(cosine[worst]),
                4 * EPS,
                f"wheel_angle[{worst}] = {float(self.wheel_angle[worst])!r} stands across its "
                f"link: generalized speeds (s_1, ω_1) need |cos α_i| > {4 * EPS:.2g} for i >= 2",
            )

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, a translation and the mirror image in the x axis."""
        yield plane_rotation(self, q, v, slice(2, None))
        yield plane_translation(self, q, v)
        yield plane_mirror(replace(self, wheel_angle=-self.wheel_angle), q, v, unflipped=(0,))

    def tree(self, parameters: Any = None) -> Tree:
        """Return the joints PX, PY and RZ for link 1, then RZ for the others: relative angles."""
        # Not by `parameters`: engines that read the tree check these.
        own = self if parameters is None else parameters
        mass, length, inertia = own.mass, own.length, own.inertia
        n, none = self.n, np.zeros(2, mass.dtype)
        offset, center = np.zeros((2, n, 3), mass.dtype)
        offset[3:, 0], center[2:, 0] = length[:-1], length / 2
        coordinates = np.eye(n)
        coordinates[2:, 2:] -= np.eye(self.links, k=-1)
        return planar_tree(
            parent=tuple(range(-1, n - 1)),
            joint=("px", "py", *["rz"] * self.links),
            offset=offset,
            mass=np.concatenate((none, mass)),
            center=center,
            inertia=np.concatenate((none, inertia)),
            coordinates=coordinates,
            links=tuple(f"link {i + 1}" for i in range(self.links)),
        )

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Snake, Array]:
        """Return a snake whose wheels are visibly turned, and its pose."""
        scene = cls.paper() if links is None else cls.coil(number_of_links(links))
        angle = np.full(scene.links, 0.35)
        pose = 0.45 + 2.4 / scene.links * np.arange(scene.links)
        return replace(scene, wheel_angle=angle), np.r_[0.9, 0.7, pose] * scene.length.mean()

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the links from the free tip on, and a wheel across each axle."""
        x, y, *theta = q
        size = self.length.mean()
        parts = [*draw.fixed_axes(0.5 * size), *draw.position_dimensions(x, y), draw.Trail(q[:2])]
        at = q[:2]
        for i, angle in enumerate(theta):
            end = at + self.length[i] * draw.direction(angle)
            wheel, middle = angle + self.wheel_angle[i], (at + end) / 2
            parts += [
                draw.Body((at, end), f"link {i + 1}"),
                draw.JointMark(at) if i else draw.JointMark(at, name="head"),
            ]
            parts += [draw.Wheel(middle, draw.direction(wheel), 0.3 * size), draw.Center(middle)]
            parts += [draw.ConstraintMark(f"wheel {i + 1}", middle, (i,))]
            parts += [draw.plane_angle(f"θ_{i + 1}", at, angle, 0.32 * size)]
            if i == 0:
                turn = self.wheel_angle[i]
                parts += [draw.plane_angle("α_1", middle, turn, 0.3 * size, start=angle)]
            at = end
        return draw.Sketch(tuple(parts), **draw.FLAT)
