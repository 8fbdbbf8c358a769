"""Quaternions (w, x, y, z) of any length, for rotations: products of them stay rational."""

from __future__ import annotations

import math

import numpy as np

from eomcheck.numbers.generic import Array, generic

Quaternion = tuple[float, float, float, float]

IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def multiply_quaternions(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the product: rotation b in the frame that a turns."""
    w, x, y, z = a
    p, i, j, k = b
    return (
        w * p - x * i - y * j - z * k,
        w * i + x * p + y * k - z * j,
        w * j - x * k + y * p + z * i,
        w * k + x * j - y * i + z * p,
    )


def of_length_one(a: Quaternion) -> Quaternion:
    """Return the same rotation by a quaternion of length 1."""
    length = math.hypot(*a)
    w, x, y, z = (part / length for part in a)
    return w, x, y, z


def is_turned(a: Quaternion) -> bool:
    """Return whether the rotation is not the identity."""
    return any(a[1:])


@generic
def rotation_matrices(orientation):
    """Return rotation matrices (k, 3, 3) of quaternions (k, 4) of any length."""
    R = np.zeros((orientation.shape[0], 3, 3), orientation.dtype)
    for k in range(orientation.shape[0]):
        w, x, y, z = orientation[k, 0], orientation[k, 1], orientation[k, 2], orientation[k, 3]
        size = w * w + x * x + y * y + z * z
        R[k, 0, 0] = (w * w + x * x - y * y - z * z) / size
        R[k, 1, 1] = (w * w - x * x + y * y - z * z) / size
        R[k, 2, 2] = (w * w - x * x - y * y + z * z) / size
        R[k, 0, 1], R[k, 1, 0] = 2 * (x * y - w * z) / size, 2 * (x * y + w * z) / size
        R[k, 0, 2], R[k, 2, 0] = 2 * (x * z + w * y) / size, 2 * (x * z - w * y) / size
        R[k, 1, 2], R[k, 2, 1] = 2 * (y * z - w * x) / size, 2 * (y * z + w * x) / size
    return R


def rotation_matrix(a: Quaternion) -> Array:
    """Return the rotation matrix (3, 3)."""
    return rotation_matrices(np.array([a], np.float64))[0]


def axis_rotation(axis: int, angle: float) -> Quaternion:
    """Return the rotation by an angle, rad, about an axis of the frame."""
    if angle == 0:
        return IDENTITY
    parts = [math.cos(angle / 2), 0.0, 0.0, 0.0]
    parts[axis + 1] = math.sin(angle / 2)
    return parts[0], parts[1], parts[2], parts[3]


def roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Return the rotation about x, then y, then z of fixed axes, angles in rad."""
    return multiply_quaternions(
        multiply_quaternions(axis_rotation(2, yaw), axis_rotation(1, pitch)), axis_rotation(0, roll)
    )


def roll_pitch_yaw_of(R: Array) -> tuple[float, float, float]:
    """Return the angles, rad, whose `roll_pitch_yaw` is the rotation R (3, 3)."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    # After removing yaw: also right where pitch is π/2 and yaw is arbitrary.
    cos, sin = math.cos(yaw), math.sin(yaw)
    roll = math.atan2(sin * R[0, 2] - cos * R[1, 2], cos * R[1, 1] - sin * R[0, 1])
    return roll, pitch, yaw


def z_to_axis(axis: tuple[float, float, float]) -> Quaternion:
    """Return a rotation that maps z to a direction of any length."""
    x, y, z = axis
    if z < 0:  # half a turn first: z and the axis are nearly opposite
        return multiply_quaternions(z_to_axis((-x, -y, -z)), (0.0, 1.0, 0.0, 0.0))
    return of_length_one((math.hypot(x, y, z) + z, -y, x, 0.0))
