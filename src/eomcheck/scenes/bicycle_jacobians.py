"""How the bodies of the bicycle move with v, along axes that do not turn, and what constrains them.

Symbols are those of `eomcheck.scenes.bicycle`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.gravity import weights
from eomcheck.mechanics.space import (
    combined,
    cross,
    plane_of,
    rotated,
    spatial_jacobians,
    swing,
    turning,
    turning_columns,
)
from eomcheck.scenes.bicycle_axes import (
    FORK,
    FRAME,
    FRONT,
    FRONT_SPIN,
    HEADING,
    LEAN,
    PITCH,
    REAR_SPIN,
    ROW,
    STEER,
    WHEEL,
)

JOINT = HEADING, LEAN, PITCH, STEER, REAR_SPIN, FRONT_SPIN
"""Coordinate that turns about each of the axes k, h, b_3, the steering axis, b_3, g_3."""
STEERING = 3
"""The steering axis among them."""
ON_FRAME, ON_FORK = (0, 1, 2), (0, 1, 2, STEERING)
TURNS = tuple(
    (k, j, JOINT[j])
    for k, axes in enumerate(((*ON_FRAME, 4), ON_FRAME, ON_FORK, (*ON_FORK, 5)))
    for j in axes
)
"""Bodies with the axes about which they turn, each carried by those before it."""


class Pose(NamedTuple):
    """Where everything is, along x, y, z."""

    axes: Any
    """Of the joints (6, 3)."""
    directions: Any
    """b for rear wheel and rear frame, g for the front (4, 3, 3)."""
    rear_arm: Any
    """From the centre of the rear wheel to a centre of mass, as far as the rear frame goes: to
    the steering axis for what is steered (4, 3), m."""
    front_arm: Any
    """From there on (4, 3), m."""
    contact: Any
    """From the wheels' centres to the ground (2, 3), m."""


def posed(parameters, prepared):
    """Return the `Pose`."""
    cos, sin = prepared.cos, prepared.sin
    tilt_cos, tilt_sin = prepared.tilt_cos[0], prepared.tilt_sin[0]
    axes, left = np.zeros((6, 3), cos.dtype), np.zeros(3, cos.dtype)
    axes[0, 2] = 1
    axes[1, 0], axes[1, 1] = cos[HEADING], sin[HEADING]
    left[0], left[1] = -sin[HEADING], cos[HEADING]
    up, across = plane_of(left, axes[0], cos[LEAN], sin[LEAN])
    ahead, down = plane_of(axes[1], up, cos[PITCH], sin[PITCH])
    # The steering axis is tilted back against down; the fork turns about it, upwards.
    below, forwards = plane_of(down, ahead, tilt_cos, tilt_sin)
    forwards, axle = plane_of(forwards, across, cos[STEER], sin[STEER])
    axes[2] = axes[4] = across
    axes[3], axes[5] = -below, axle
    forward, downward = plane_of(forwards, below, tilt_cos, tilt_sin)
    directions = np.array(
        [*[[ahead, down, across]] * 2, *[[forward, downward, axle]] * 2], cos.dtype
    )
    rear_arm, front_arm = np.zeros((4, 3), cos.dtype), np.zeros((4, 3), cos.dtype)
    rear_arm[FRAME] = combined(parameters.rider[0], ahead, parameters.rider[1], down)
    pivot = combined(parameters.pivot[0], ahead, parameters.pivot[1], down)
    rear_arm[FORK] = rear_arm[FRONT] = pivot
    g = directions[FORK]
    front_arm[FORK] = combined(parameters.fork[0], g[0], parameters.fork[1], g[1])
    front_arm[FRONT] = combined(parameters.hub[0], g[0], parameters.hub[1], g[1])
    contact = np.zeros((2, 3), cos.dtype)
    shorter = parameters.radius[1] / prepared.upright[0]
    for i in range(3):
        contact[0, i] = -parameters.radius[0] * up[i]
    contact[1] = combined(shorter * axle[2], axle, -shorter, axes[0])
    return Pose(axes, directions, rear_arm, front_arm, contact)


def columns(pose):
    """Return ∂V_k/∂v of the centres of mass (4, 3, 9) along x, y, z."""
    axes, to_front = pose.axes, pose.front_arm
    linear = np.zeros((4, 3, 9), axes.dtype)
    for k in range(4):
        for i in range(3):
            linear[k, i, i] = 1
        for j in range(STEERING):
            linear[k, :, JOINT[j]] = cross(axes[j], pose.rear_arm[k] + to_front[k])
    for k in range(FORK, 4):
        linear[k, :, STEER] = cross(axes[STEERING], to_front[k])
    return linear


def accelerations(pose, omega, alpha):
    """Return the accelerations of the centres of mass at v̇ = 0 (4, 3), along x, y, z."""
    rest = np.zeros((4, 3), omega.dtype)
    for k in range(FRAME, 4):
        rest[k] = swing(omega[FRAME], alpha[FRAME], pose.rear_arm[k]) + swing(
            omega[FORK], alpha[FORK], pose.front_arm[k]
        )
    return rest


def jacobians(parameters, prepared, q, v):
    """Return the `Jacobians`: V along x, y, z, ω along b or g."""
    pose = posed(parameters, prepared)
    rest = accelerations(pose, *turning(4, TURNS, pose.axes, v))
    directions, inertia = pose.directions, parameters.inertia
    return spatial_jacobians(inertia, directions, columns(pose), rest, TURNS, pose.axes, v)


def seen_from_heading(prepared, vector):
    """Return the components along h, across it and up (3,) of a vector along x, y, z."""
    result = vector + 0
    rotated(result, 0, 1, prepared.cos[HEADING], prepared.sin[HEADING])
    return result


def constraints(parameters, prepared, q):
    """Return (a (6, 9), None): what of a wheel touches the ground does not move."""
    pose = posed(parameters, prepared)
    linear, angular = columns(pose), turning_columns(4, TURNS, pose.axes, 9)
    a = np.zeros((6, 9), q.dtype)
    for wheel in range(2):
        k = WHEEL[wheel]
        for j in range(9):
            touching = linear[k, :, j] + cross(angular[k, :, j], pose.contact[wheel])
            slip = seen_from_heading(prepared, touching)
            for i in range(3):
                a[ROW[wheel][i], j] = slip[i]
    return a, None


def drift(parameters, prepared, q, v):
    """Return gamma (6,): the point of contact wanders along the rim, the directions turn."""
    pose = posed(parameters, prepared)
    omega, alpha = turning(4, TURNS, pose.axes, v)
    rest = accelerations(pose, omega, alpha)
    wandering = np.zeros((2, 3), v.dtype)
    leaning = combined(1, omega[FRAME], -v[PITCH], pose.axes[2])
    wandering[0] = cross(leaning, pose.contact[0])
    axle, upright = pose.axes[5], prepared.upright[0]
    rate, shorter = cross(omega[FORK], axle), parameters.radius[1] / upright
    wandering[1] = combined(shorter * rate[2], axle, shorter * axle[2], rate)
    lengthening = axle[2] * rate[2] / (upright * upright)
    wandering[1] = combined(1, wandering[1], lengthening, pose.contact[1])
    gamma = np.zeros(6, v.dtype)
    for wheel in range(2):
        k = WHEEL[wheel]
        V = v[:3] + cross(omega[FRAME], pose.rear_arm[k]) + cross(omega[FORK], pose.front_arm[k])
        slip = seen_from_heading(prepared, V + cross(omega[k], pose.contact[wheel]))
        changing = cross(alpha[k], pose.contact[wheel]) + cross(omega[k], wandering[wheel])
        change = seen_from_heading(prepared, rest[k] + changing)
        gamma[ROW[wheel][0]] = change[0] + v[HEADING] * slip[1]
        gamma[ROW[wheel][1]] = change[1] - v[HEADING] * slip[0]
        gamma[ROW[wheel][2]] = change[2]
    return gamma


def forces(parameters, prepared, q, v):
    """Return Q (9,) of gravity."""
    upward = columns(posed(parameters, prepared))[:, 2]
    return weights(parameters.gravity, parameters.mass, upward)
