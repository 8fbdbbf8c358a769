"""Floating base: the map from the scene's coordinates to the velocity conventions of libraries.

In the scene three slides along x, y, z of the ground move the base, then turns about z, y and x,
and the velocity is their rates. Libraries have a rotation, and six velocities w = S v of a frame
that is fixed to the base: the velocity of its origin and the angular velocity, in either order and
each along the axes of the ground or of the frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array

FREE = 6
"""Number of coordinates of a free base, which come first."""

AXES = "ground", "base"


class BaseVelocity(NamedTuple):
    """Convention of a library for the velocity of a free base."""

    linear: str
    """Axes of the velocity of its origin, one of `AXES`."""
    angular: str
    """Axes of the angular velocity, one of `AXES`."""
    turns_first: bool = False
    """Whether the angular velocity comes before the linear one."""

    def __str__(self) -> str:
        linear, angular = (
            f"{what} velocity along the axes of the {axes}"
            for what, axes in (("linear", self.linear), ("angular", self.angular))
        )
        first, last = (angular, linear) if self.turns_first else (linear, angular)
        return f"{first}, then {last}"


class FreeBase(NamedTuple):
    """Pose of a frame that is fixed to a free base, and its velocity as a function of v = q̇."""

    position: Array
    """Position of its origin (3,), m."""
    R: Array
    """Axes of the frame, columns (3, 3)."""
    linear: Array
    """Jacobian (3, 6) of the velocity of the origin along the axes of the ground, per v."""
    linear_rest: Array
    """Acceleration of the origin at v̇ = 0 (3,), m/s²."""
    angular: Array
    """Jacobian (3, 6) of the angular velocity along the axes of the ground, per v."""
    angular_rest: Array
    """Angular acceleration at v̇ = 0 (3,), rad/s²."""

    def velocity(self, convention: BaseVelocity, v: Array) -> tuple[Array, Array]:
        """Return S (6, 6) and Ṡ v (6,) of the velocity in a library's convention."""
        omega, parts = self.angular @ v, {}
        for name, axes in (("linear", convention.linear), ("angular", convention.angular)):
            S, rest = getattr(self, name), getattr(self, f"{name}_rest")
            if axes == "base":  # axes that turn
                rest = self.R.T @ (rest - np.cross(omega, S @ v))
                S = self.R.T @ S
            parts[name] = S, rest
        order = ("angular", "linear") if convention.turns_first else ("linear", "angular")
        S, rest = zip(*(parts[name] for name in order), strict=True)
        return np.vstack(S), np.concatenate(rest)

    @property
    def quaternion(self) -> Array:
        """Orientation as a quaternion w, x, y, z, of length 1."""
        return _quaternion(self.R)


def free_base(q: Array, v: Array, at: Array | None = None, turn: Array | None = None) -> FreeBase:
    """Return the pose and the velocity of a frame that is fixed to the base of a scene.

    Args:
        q: slides of the base along x, y, z, then turns about z, y, x (6,).
        v: their rates (6,).
        at: origin of the frame, in that of the base (3,), m; by default that of the base.
        turn: axes of the frame, in that of the base, columns (3, 3); by default those of the base.
    """
    x, y, z = np.eye(3)
    yaw, pitch, roll = _about(q[3], z), _about(q[4], y), _about(q[5], x)
    R = yaw @ pitch @ roll
    turns = np.column_stack([z, yaw @ y, yaw @ pitch @ x])
    rates = turns * v[3:]
    omega = rates.sum(axis=1)
    alpha = np.cross(rates[:, 0], rates[:, 1]) + np.cross(rates[:, 0] + rates[:, 1], rates[:, 2])
    arm = np.zeros(3) if at is None else R @ at
    swung = np.cross(turns.T, arm).T
    return FreeBase(
        q[:3] + arm,
        R if turn is None else R @ turn,
        np.hstack([np.eye(3), swung]),
        np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm)),
        np.hstack([np.zeros((3, 3)), turns]),
        alpha,
    )


def _about(angle: float, axis: Array) -> Array:
    """Return the rotation about one of the axes x, y, z."""
    across = np.cross(np.eye(3), -axis)
    return (
        np.outer(axis, axis)
        + np.cos(angle) * (np.eye(3) - np.outer(axis, axis))
        + (np.sin(angle) * across.T)
    )


def _quaternion(R: Array) -> Array:
    """Return the quaternion w, x, y, z of a rotation, of length 1."""
    K = np.empty((4, 4))
    K[0, 0] = np.trace(R)
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    # K + 1 is 4 times the outer product of the quaternion with itself.
    outer = K + np.eye(4)
    column = outer[:, int(np.argmax(np.diagonal(outer)))]
    return column / np.linalg.norm(column)
