"""The second derivation of the bicycle: from body to body, along axes that turn.

Velocities, potential energy, what of the wheels touches the ground and how high it is. Nothing here
reads a Jacobian, and engines differentiate it. Symbols are those of `eomcheck.scenes.bicycle`.
"""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.gravity import height_energy
from eomcheck.mechanics.space import rotated
from eomcheck.scenes.bicycle_axes import (
    FORK,
    FRAME,
    FRONT,
    FRONT_SPIN,
    HEADING,
    HEIGHT,
    LEAN,
    PITCH,
    REAR,
    REAR_SPIN,
    ROW,
    STEER,
    steered,
    vertical,
)


def moved_on(V, omega, point):
    """Return the velocity (3,) of a point (2,) of the plane of a frame, V being that of another."""
    result = V + 0
    result[0] -= omega[2] * point[1]
    result[1] += omega[2] * point[0]
    result[2] += omega[0] * point[1] - omega[1] * point[0]
    return result


def moving(parameters, prepared, v):
    """Return the velocities of the centres of mass (4, 3) and of rotation (4, 3), along b or g."""
    cos, sin = prepared.cos, prepared.sin
    V, omega = np.zeros((4, 3), v.dtype), np.zeros((4, 3), v.dtype)
    V[REAR] = v[:3]
    rotated(V[REAR], 0, 1, cos[HEADING], sin[HEADING])
    rotated(V[REAR], 1, 2, cos[LEAN], sin[LEAN])
    rotated(V[REAR], 0, 1, cos[PITCH], sin[PITCH])
    k = vertical(prepared)
    for i in range(3):
        omega[FRAME, i] = v[HEADING] * k[i]
    omega[FRAME, 0] += v[LEAN] * cos[PITCH]
    omega[FRAME, 1] -= v[LEAN] * sin[PITCH]
    omega[FRAME, 2] += v[PITCH]
    V[FRAME] = moved_on(V[REAR], omega[FRAME], parameters.rider)
    pivot = steered(prepared, sin[STEER], moved_on(V[REAR], omega[FRAME], parameters.pivot))
    omega[FORK] = steered(prepared, sin[STEER], omega[FRAME])
    omega[FORK, 0] -= v[STEER] * prepared.tilt_sin[0]
    omega[FORK, 1] -= v[STEER] * prepared.tilt_cos[0]
    V[FORK] = moved_on(pivot, omega[FORK], parameters.fork)
    V[FRONT] = moved_on(pivot, omega[FORK], parameters.hub)
    omega[REAR], omega[FRONT] = omega[FRAME], omega[FORK]
    omega[REAR, 2] += v[REAR_SPIN]
    omega[FRONT, 2] += v[FRONT_SPIN]
    return V, omega


def level(prepared, vector):
    """Return the components along h, across it and up (3,) of a vector along b."""
    cos, sin, result = prepared.cos, prepared.sin, vector + 0
    rotated(result, 0, 1, cos[PITCH], -sin[PITCH])
    rotated(result, 1, 2, cos[LEAN], -sin[LEAN])
    return result


def velocities(parameters, prepared, q, v):
    """Return V along x, y, z and ω along axes of the body, which turn with a wheel, (4, 3) each."""
    V, omega = moving(parameters, prepared, v)
    for k in range(FORK, 4):
        V[k] = steered(prepared, -prepared.sin[STEER], V[k])
    for k in range(4):
        V[k] = level(prepared, V[k])
        rotated(V[k], 0, 1, prepared.cos[HEADING], -prepared.sin[HEADING])
    rotated(omega[REAR], 0, 1, prepared.cos[REAR_SPIN], prepared.sin[REAR_SPIN])
    rotated(omega[FRONT], 0, 1, prepared.cos[FRONT_SPIN], prepared.sin[FRONT_SPIN])
    return V, omega


def constraint(parameters, prepared, q, v):
    """Return c (6,), m/s: velocities of what touches the ground, along h, across it and up."""
    cos, sin, radius = prepared.cos, prepared.sin, parameters.radius
    V, omega = moving(parameters, prepared, v)
    k = steered(prepared, sin[STEER], vertical(prepared))
    rear = [-radius[0] * sin[PITCH], -radius[0] * cos[PITCH]]
    front = [-radius[1] * k[i] / prepared.upright[0] for i in range(2)]
    slip = moved_on(V[FRONT], omega[FRONT], front)
    touching = [
        level(prepared, moved_on(V[REAR], omega[REAR], rear)),
        level(prepared, steered(prepared, -sin[STEER], slip)),
    ]
    c = np.zeros(6, v.dtype)
    for wheel in range(2):
        for i in range(3):
            c[ROW[wheel][i]] = touching[wheel][i]
    return c


def above(parameters, prepared):
    """Return how much higher than the centre of the rear wheel the centres of mass are (4,), m."""
    k = vertical(prepared)
    g = steered(prepared, prepared.sin[STEER], k)
    rider, pivot, fork, hub = parameters.rider, parameters.pivot, parameters.fork, parameters.hub
    height = np.zeros(4, k.dtype)
    height[FRAME] = k[0] * rider[0] + k[1] * rider[1]
    height[FORK] = height[FRONT] = k[0] * pivot[0] + k[1] * pivot[1]
    height[FORK] += g[0] * fork[0] + g[1] * fork[1]
    height[FRONT] += g[0] * hub[0] + g[1] * hub[1]
    return height


def potential(parameters, prepared, q):
    """Return U, J."""
    heights = [q[HEIGHT] + rise for rise in above(parameters, prepared)]
    return height_energy(parameters.gravity, parameters.mass, np.array(heights, q.dtype))


def position_residual(parameters, prepared, q):
    """Return how high the lowest points of the wheels are (2,), m, for sin ψ > 0."""
    hub = q[HEIGHT] + above(parameters, prepared)[FRONT]
    rear = q[HEIGHT] - parameters.radius[0] * prepared.sin[LEAN]
    return np.array([rear, hub - parameters.radius[1] * prepared.upright[0]], q.dtype)
