"""Algebra of scalars and vectors with absent components, and of rotations by quaternions.

An absent number is None, stands for 0 and costs no operation; the literals 1 and -1 stand for
themselves. A vector has three components, each a number or absent: in the plane the third one is
always absent. Functions never branch on the value of a number of the model, which is never an
`int`. Quaternions (w, x, y, z) are of any length, so that products of them stay rational.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from eomcheck.numbers.generic import Array, generic

Vector = tuple[Any, Any, Any]

ZERO_VECTOR: Vector = (None, None, None)
AXES: tuple[Vector, Vector, Vector] = ((1, None, None), (None, 1, None), (None, None, 1))
"""Axes of the ground."""


# ---- Numbers -------------------------------------------------------------------------------------


@generic
def negative(x):
    """Return -x."""
    return None if x is None else -x


@generic
def plus(x, y):
    """Return x + y."""
    if x is None:
        return y
    if y is None:
        return x
    return _literal(x + y)


@generic
def minus(x, y):
    """Return x - y."""
    if y is None:
        return x
    if x is None:
        return -y
    return _literal(x - y)


@generic
def times(x, y):
    """Return x y."""
    if x is None or y is None:
        return None
    if type(x) is int:
        return y if x == 1 else -y if x == -1 else x * y
    if type(y) is int:
        return x if y == 1 else -x if y == -1 else x * y
    return x * y


def _literal(x: Any) -> Any:
    return None if type(x) is int and x == 0 else x


@generic
def total(terms):
    """Return the sum of numbers; None if all are absent."""
    result = None
    for term in terms:
        result = plus(result, term)
    return result


# ---- Vectors -------------------------------------------------------------------------------------


@generic
def add_vectors(a, b):
    """Return a + b."""
    return plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2])


@generic
def subtract_vectors(a, b):
    """Return a - b."""
    return minus(a[0], b[0]), minus(a[1], b[1]), minus(a[2], b[2])


@generic
def scale_vector(x, a):
    """Return x a."""
    return times(x, a[0]), times(x, a[1]), times(x, a[2])


@generic
def dot(a, b):
    """Return a · b."""
    return plus(plus(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]))


@generic
def cross(a, b):
    """Return a × b."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


@generic
def centripetal(omega, arm):
    """Return ω × (ω × arm)."""
    return cross(omega, cross(omega, arm))


@generic
def from_local(axes, a):
    """Return a vector from its components along `axes`, in the frame that `axes` refer to."""
    x, y, z = axes
    return add_vectors(
        add_vectors(scale_vector(a[0], x), scale_vector(a[1], y)), scale_vector(a[2], z)
    )


@generic
def to_local(axes, a):
    """Return the components of a vector along `axes`."""
    return dot(axes[0], a), dot(axes[1], a), dot(axes[2], a)


@generic
def rotate_back(a, axis, cos, sin):
    """Return the components of a vector along axes turned about their `axis`-th."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return _with(
        a,
        {
            i: plus(times(cos, a[i]), times(sin, a[j])),
            j: minus(times(cos, a[j]), times(sin, a[i])),
        },
    )


@generic
def rotate(a, axis, cos, sin):
    """Return a vector rotated about the `axis`-th axis."""
    return rotate_back(a, axis, cos, negative(sin))


@generic
def unit(axis, x):
    """Return x times the `axis`-th unit vector."""
    return _with(ZERO_VECTOR, {axis: x})


def _with(a: Vector, parts: dict[int, Any]) -> Vector:
    x, y, z = (parts.get(i, a[i]) for i in range(3))
    return x, y, z


def as_vector(entries: Iterable[Any]) -> Vector:
    """Return a vector of two or three numbers."""
    x, y, *third = entries
    return x, y, (third[0] if third else None)


def put(array: Any, place: Any, x: Any) -> None:
    """Write a number, if present, into an array of zeros."""
    if x is not None:
        array[place] = x


def put_vector(array: Any, place: tuple[Any, ...], a: Vector, size: int = 3) -> None:
    """Write the first `size` components of a vector, if present; None in `place` is their axis."""
    for i in range(size):
        put(array, tuple(i if index is None else index for index in place), a[i])


# ---- Rotations by quaternions --------------------------------------------------------------------

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


def conjugate(a: Quaternion) -> Quaternion:
    """Return the quaternion of the rotation back."""
    w, x, y, z = a
    return w, -x, -y, -z


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
