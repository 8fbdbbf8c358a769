"""Numbers of random descriptions: places, directions, bodies. The simplest comes first."""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.choices import Choices
from eomcheck.mechanics.described.quaternions import ONE, Quaternion, rotation
from eomcheck.mechanics.described.words import ORIGIN, Link, Triple

STRAIGHT: tuple[Triple, ...] = (
    *((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    *((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
)
"""Directions along the axes of a frame."""

IN_PLANE = tuple(one for one in STRAIGHT if not one[2])
ACROSS = tuple(one for one in STRAIGHT if one[2])

SMALLEST = 0.1
"""Shorter directions and arms than this are replaced, so that nothing is singular by accident."""


def place(choices: Choices, planar: bool) -> Triple:
    """Return a position within 1 m along each axis, often the origin."""
    if choices.one_of((False, True, True, True)):
        return anywhere(choices, planar)
    return ORIGIN


def anywhere(choices: Choices, planar: bool, most: float = 1.0) -> Triple:
    """Return three numbers, in the plane z = 0 where asked for."""
    x, y = (choices.number(-most, most) for _ in range(2))
    return x, y, 0.0 if planar else choices.number(-most, most)


def direction(choices: Choices, planar: bool, most: float = 1.0) -> Triple:
    """Return a direction, of any length that is not small."""
    x, y, z = anywhere(choices, planar, most)
    if max(abs(x), abs(y), abs(z)) < SMALLEST * most:
        return most, y, z
    return x, y, z


def across(choices: Choices, along: Triple) -> Triple:
    """Return a direction that is not nearly along another."""
    other = direction(choices, planar=False)
    sine = np.linalg.norm(np.cross(along, other)) / np.linalg.norm(along) / np.linalg.norm(other)
    if sine >= SMALLEST:
        return other
    x, y, z = np.eye(3)[np.argmin(np.abs(along))].tolist()
    return x, y, z


def turn(choices: Choices) -> Quaternion:
    """Return a rotation as a quaternion of any length, often none at all."""
    if not choices.one_of((False, True, True)):
        return ONE
    return choices.number(SMALLEST, 1.0), *anywhere(choices, planar=False)


def size(choices: Choices, low: float, high: float) -> float:
    """Return 10 to the power of a number in [low, high]: all magnitudes alike."""
    return 10.0 ** choices.number(low, high)


def body(choices: Choices, name: str, planar: bool) -> Link:
    """Return a link with the inertia of some homogeneous block, turned anyhow."""
    mass, center = size(choices, -1.0, 1.0), place(choices, planar)
    x, y, z = (size(choices, -2.0, 0.0) for _ in range(3))
    moments = mass * np.array([y + z, x + z, x + y])
    if planar:
        a, b, c = moments.tolist()
        return Link(name, mass, center, (a, b, c))
    R = rotation(turn(choices))
    I = (R * moments @ R.T).tolist()  # noqa: E741
    return Link(name, mass, center, (I[0][0], I[1][1], I[2][2]), (I[0][1], I[0][2], I[1][2]))
