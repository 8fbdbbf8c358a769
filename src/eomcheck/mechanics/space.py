"""Vectors and rotations in space, by components (3,), for scenes in three dimensions."""

from __future__ import annotations

import numpy as np

from eomcheck.numbers.generic import generic


@generic
def cross(a, b):
    """Return a × b (3,)."""
    c = np.zeros(3, a.dtype)
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]
    return c


@generic
def combined(x, a, y, b):
    """Return x a + y b (3,)."""
    c = np.zeros(3, a.dtype)
    for i in range(3):
        c[i] = x * a[i] + y * b[i]
    return c


@generic
def plane_of(first, second, cos, sin):
    """Return two directions (3,) turned in their plane, from `first` towards `second`."""
    return combined(cos, first, sin, second), combined(cos, second, -sin, first)


@generic
def turn(omega, alpha, axis, rate):
    """Add a rotation about an axis (3,) that is carried by omega (3,) to omega and alpha."""
    carried = cross(omega, axis)
    for i in range(3):
        alpha[i] += rate * carried[i]
        omega[i] += rate * axis[i]


@generic
def swing(omega, alpha, arm):
    """Return the acceleration (3,) of the end of an arm against its other end."""
    return cross(alpha, arm) + cross(omega, cross(omega, arm))


@generic
def along(directions, vectors):
    """Return the components of vectors (m, 3) along directions of their own (m, 3, 3)."""
    result = np.zeros(vectors.shape, vectors.dtype)
    for k in range(vectors.shape[0]):
        for i in range(3):
            for c in range(3):
                result[k, i] += directions[k, i, c] * vectors[k, c]
    return result


@generic
def rotated(vector, i, j, cos, sin):
    """Turn the components i and j of a vector (3,) to axes turned from the i-th to the j-th."""
    first, second = vector[i], vector[j]
    vector[i], vector[j] = cos * first + sin * second, cos * second - sin * first
