"""A wheel that comes to stand across its link, at each place in the chain."""

from __future__ import annotations

import math

import numpy as np

from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.scenes import Snake

LINKS = 5
ACROSS = 6.123233995736766e-17
"""Distance of π/2 from its nearest double."""
NEXT = ACROSS + 2.0**-52
"""Distance of π/2 from the double before that."""


def _pose(variant: str, distance: float) -> Posed:
    sign, wheel = variant[0], int(variant[-1])
    alpha = 0.1 * np.arange(1, LINKS + 1)
    alpha[wheel - 1] = (1.0 if sign == "+" else -1.0) * (math.pi / 2 - distance)
    one = np.ones(LINKS)
    theta = 0.4 * np.arange(LINKS)
    scene = Snake(one, one, one / 12, 10.0 * one[1:], alpha, theta)
    # What turns the link of this wheel at 1 rad/s, and hardly moves the others.
    return Posed(scene, scene.initial_state()[0], np.array([1.0, 0.5]) * max(distance, ACROSS))


WHEEL_ANGLE = Family(
    key="wheel-angle",
    name="Wheel across its link",
    severity="distance of a wheel angle from ±π/2 / rad",
    values=(*decades(-1, -15), NEXT, ACROSS),
    quick=(1e-1, 1e-5, 1e-10, 1e-15, ACROSS),
    variants=tuple(f"{sign}π/2, wheel {k}" for k in range(1, LINKS + 1) for sign in "+-"),
    pose=_pose,
)
