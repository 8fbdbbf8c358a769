"""Bodies, coordinates, constraints and axes of the bicycle, which both derivations share.

Symbols are those of `eomcheck.scenes.bicycle`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

REAR, FRAME, FORK, FRONT = range(4)
"""Bodies: rear wheel, rear frame with the rider, front frame, front wheel."""
HEIGHT, HEADING, PITCH, FRONT_SPIN, LEAN, STEER, REAR_SPIN = range(2, 9)
"""Coordinates z, θ, φ, β_f, ψ, ψ_f, β_r."""
WHEEL = REAR, FRONT
"""Wheel -> body."""
ROW = (0, 1, 2), (5, 3, 4)
"""Wheel -> its constraints along h, across it to its left, and up. Taken in their order,
with the first velocities dependent, elimination divides by nothing small for a bicycle that stands,
also where it cannot choose (expressions)."""


class Prepared(NamedTuple):
    """What is not rational in q; each of shape (1,) but cos and sin."""

    cos: Any
    """Of the coordinates (9,), those of x, y, z meaningless."""
    sin: Any
    """Likewise."""
    tilt_cos: Any
    tilt_sin: Any
    upright: Any
    """Length of the vertical seen in the plane of the front wheel, 1 where it is upright."""


def steered(prepared, sin, vector):
    """Return the components along g of a vector (3,) along b; back with -sin ψ_f for sin ψ_f."""
    cos, c, s = prepared.cos[STEER], prepared.tilt_cos[0], prepared.tilt_sin[0]
    ahead, down = c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
    turned = cos * ahead + sin * vector[2]
    left = cos * vector[2] - sin * ahead
    return np.array([c * turned + s * down, c * down - s * turned, left], vector.dtype)


def vertical(prepared):
    """Return k along b (3,)."""
    cos, sin = prepared.cos, prepared.sin
    return np.array([sin[LEAN] * sin[PITCH], sin[LEAN] * cos[PITCH], cos[LEAN]], cos.dtype)


def prepare(arithmetic, parameters, q, t):
    """Return the `Prepared` at q (9,)."""
    angles, tilt = arithmetic.angles(q), arithmetic.angles(parameters.tilt)
    still = Prepared(angles.cos, angles.sin, tilt.cos, tilt.sin, tilt.cos)
    k = steered(still, angles.sin[STEER], vertical(still))
    upright = arithmetic.root(np.array([k[0] * k[0] + k[1] * k[1]], k.dtype))
    return Prepared(angles.cos, angles.sin, tilt.cos, tilt.sin, upright)
