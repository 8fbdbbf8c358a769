"""A floating base as libraries describe it, each by another velocity.

In the scene three slides along x, y, z of the ground move it, then turns about z, y and x, and the
velocity is their rates. Libraries have a rotation, and six velocities w = S v of a frame that is
fixed to the base: the velocity of its origin and the angular velocity, in either order and each
along the axes of the ground or of the frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array

FREE = 6
"""Coordinates of a free base, which come first."""

AXES = "ground", "base"


class BaseVelocity(NamedTuple):
    """What a library has for the velocity of a free base."""

    linear: str
    """Along whose axes the velocity of its origin is, one of `AXES`."""
    angular: str
    """Along whose axes it turns."""
    turns_first: bool = False
    """Whether the angular velocity comes before the other."""

    def __str__(self) -> str:
        linear, angular = (
            f"{what} velocity along the axes of the {axes}"
            for what, axes in (("linear", self.linear), ("angular", self.angular))
        )
        first, last = (angular, linear) if self.turns_first else (linear, angular)
        return f"{first}, then {last}"


class FreeBase(NamedTuple):
    """Where a frame that is fixed to a free base is, and how it moves with v = q̇ (6,)."""

    position: Array
    """Of its origin (3,), m."""
    R: Array
    """Its axes, columns (3, 3)."""
    linear: Array
    """Velocity of the origin along the axes of the ground, by v (3, 6)."""
    linear_rest: Array
    """Its acceleration at v̇ = 0 (3,)."""
    angular: Array
    """Angular velocity along the axes of the ground, by v (3, 6)."""
    angular_rest: Array
    """Its rate at v̇ = 0 (3,)."""

    def velocity(self, convention: BaseVelocity, v: Array) -> tuple[Array, Array]:
        """Return S (6, 6) and Ṡ v (6,) of the velocity that a library has."""
        omega, parts = self.angular @ v, {}
        for name, axes in (("linear", convention.linear), ("angular", convention.angular)):
            S, rest = getattr(self, name), getattr(self, f"{name}_rest")
            if axes == "base":  # whose axes turn
                rest = self.R.T @ (rest - np.cross(omega, S @ v))
                S = self.R.T @ S
            parts[name] = S, rest
        order = ("angular", "linear") if convention.turns_first else ("linear", "angular")
        S, rest = zip(*(parts[name] for name in order), strict=True)
        return np.vstack(S), np.concatenate(rest)

    @property
    def quaternion(self) -> Array:
        """Its orientation as w, x, y, z, of length 1."""
        return _quaternion(self.R)


def free_base(q: Array, v: Array, at: Array | None = None, turn: Array | None = None) -> FreeBase:
    """Return where the base of a scene is, and how it moves.

    Args:
        q: its slides along x, y, z, then turns about z, y, x (6,).
        v: their rates (6,).
        at: origin of the frame, in that of the base (3,), m; by default that itself.
        turn: its axes there, columns (3, 3).
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
    """Return w, x, y, z of a rotation, divided by the largest of them."""
    K = np.empty((4, 4))
    K[0, 0] = np.trace(R)
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
    # 4 times the outer product of the quaternion with itself, but for a multiple of 1.
    outer = K + np.eye(4)
    column = outer[:, int(np.argmax(np.diagonal(outer)))]
    return column / np.linalg.norm(column)
