"""Vectors and rotations in space, by components (3,), for scenes in three dimensions."""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.records import Jacobians
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


@generic
def diagonal(moments):
    """Return moments of inertia (n_b, 3) about principal axes as matrices (n_b, 3, 3)."""
    principal = [[[x, 0, 0], [0, y, 0], [0, 0, z]] for x, y, z in moments]
    return np.array(principal, moments.dtype)


@generic
def gyroscopic_moments(inertia, omega):
    """Return ω × I ω (n_b, 3) of bodies in space."""
    moments = np.zeros(omega.shape, omega.dtype)
    for k in range(omega.shape[0]):
        x, y, z = omega[k, 0], omega[k, 1], omega[k, 2]
        for i in range(3):
            # The share of the component omega_i in the angular momentum.
            moments[k, 0] += (y * inertia[k, 2, i] - z * inertia[k, 1, i]) * omega[k, i]
            moments[k, 1] += (z * inertia[k, 0, i] - x * inertia[k, 2, i]) * omega[k, i]
            moments[k, 2] += (x * inertia[k, 1, i] - y * inertia[k, 0, i]) * omega[k, i]
    return moments


@generic
def turning(count, turns, axes, v):
    """Return ω of bodies (count, 3) and ω̇ at v̇ = 0 (count, 3).

    `turns` are body, axis and the coordinate that turns about it, an axis after what carries it.
    """
    omega, alpha = np.zeros((count, 3), v.dtype), np.zeros((count, 3), v.dtype)
    for k, j, coordinate in turns:
        turn(omega[k], alpha[k], axes[j], v[coordinate])
    return omega, alpha


@generic
def turning_columns(count, turns, axes, n):
    """Return ∂ω_k/∂v (count, 3, n) of `turning`."""
    columns = np.zeros((count, 3, n), axes.dtype)
    for k, j, coordinate in turns:
        columns[k, :, coordinate] = axes[j]
    return columns


@generic
def spatial_jacobians(inertia, directions, linear, rest, turns, axes, v):
    """Return the `Jacobians` of bodies with axes `directions` (n_b, 3, 3), V along x, y, z."""
    count, _, n = linear.shape
    omega, alpha = turning(count, turns, axes, v)
    angular, turned = np.zeros((count, 3, n), v.dtype), turning_columns(count, turns, axes, n)
    for j in range(n):
        angular[:, :, j] = along(directions, turned[:, :, j])
    gyroscopic = gyroscopic_moments(inertia, along(directions, omega))
    return Jacobians(linear, angular, rest, along(directions, alpha), gyroscopic)
