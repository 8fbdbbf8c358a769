"""Generalized speeds and partial velocities of the snake, by recursion in O(N) (Eqs. (22), (29)).

Symbols are those of `eomcheck.scenes.snake`. u = (s_1, ω_1): rolling speed of wheel 1 and angular
velocity of link 1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.records import Bodies, Speeds
from eomcheck.scenes.snake_terms import first_wheel, joint_torque


class Rolling(NamedTuple):
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
    """Pass (s, ω) from link to link.

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
        # What comes from the link before is added last: nothing else waits for it.
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
    return Rolling(s_u, omega_u, s_rest, omega_rest, u, v)


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
    """Return W u of `speeds`, passed from link to link with the recursion."""
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
