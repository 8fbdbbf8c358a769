"""Bodies in the plane that turn about pins, by the arms that lead from pin to pin.

A point is given by its arms: where it is, and how it moves, are sums over them. There are as many
bodies as coordinates.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.records import Jacobians
from eomcheck.numbers.generic import generic


class Arm(NamedTuple):
    """A vector that turns with a body."""

    x: Any
    y: Any
    turning: tuple[int, ...]
    """The coordinates whose sum the direction of the body is."""


@generic
def backwards(arms):
    """Return arms that lead back."""
    return [Arm(-arm.x, -arm.y, arm.turning) for arm in arms]


@generic
def halved(arms):
    """Return the arms to the middle of each."""
    return [Arm(arm.x / 2, arm.y / 2, arm.turning) for arm in arms]


@generic
def rods(length, angles):
    """Return the arms along rods of this length (n,), each turned by a coordinate of its own."""
    x, y = length * angles.cos, length * angles.sin
    return [Arm(x[i], y[i], (i,)) for i in range(x.size)]


@generic
def rate_of_turn(arm, v):
    """Return how fast an arm turns, rad/s."""
    rate = v[arm.turning[0]]
    for i in arm.turning[1:]:
        rate = rate + v[i]
    return rate


@generic
def columns(J, arms):
    """Add ∂(end of the arms)/∂q to J (2, n)."""
    for arm in arms:
        for i in arm.turning:
            J[0, i] -= arm.y
            J[1, i] += arm.x


@generic
def rest(left, arms, v):
    """Add the acceleration of the end of the arms at v̇ = 0 to `left` (2,)."""
    for arm in arms:
        omega = rate_of_turn(arm, v)
        left[0] -= omega * omega * arm.x
        left[1] -= omega * omega * arm.y


@generic
def pinned_jacobians(centers, v):
    """Return the `Jacobians` of bodies by the arms to their centres, the last one its own."""
    n = v.size
    linear, angular = np.zeros((n, 2, n), v.dtype), np.zeros((n, 1, n), v.dtype)
    left = np.zeros((n, 2), v.dtype)
    for k in range(n):
        columns(linear[k], centers[k])
        rest(left[k], centers[k], v)
        for i in centers[k][-1].turning:
            angular[k, 0, i] = 1
    return Jacobians(linear, angular, left, np.zeros((n, 1), v.dtype))


@generic
def closing(loops, count, q):
    """Return a (2 count, n): the velocities of the ends of so many loops of arms."""
    a = np.zeros((2 * count, q.size), q.dtype)
    for k in range(count):
        columns(a[2 * k : 2 * k + 2], loops[k])
    return a


@generic
def closing_drift(loops, count, v):
    """Return gamma = ȧ v (2 count,) of `closing`."""
    gamma = np.zeros((count, 2), v.dtype)
    for k in range(count):
        rest(gamma[k], loops[k], v)
    return gamma.reshape(2 * count)


@generic
def place(arms):
    """Return where the arms lead, along x and along y."""
    x = y = 0
    for arm in arms:
        x, y = x + arm.x, y + arm.y
    return x, y


@generic
def moving(arms, v):
    """Return how fast their end moves, along x and along y: ω × r from pin to pin."""
    x = y = 0
    for arm in arms:
        omega = rate_of_turn(arm, v)
        x, y = x - omega * arm.y, y + omega * arm.x
    return x, y


@generic
def with_row(rows, row, times):
    """Return rows (k, ...) and, unless `times` (1,) is None, so many times `row` (1, ...) below."""
    if times is None:
        return rows
    return np.concatenate((rows, times * row))
