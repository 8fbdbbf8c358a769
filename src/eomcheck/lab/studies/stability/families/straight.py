"""The straight snake, all θ equal and α = 0: approached by bending it less and less, and exact."""

from __future__ import annotations

import numpy as np

from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.scenes import Snake


def _pose(variant: str, bend: float) -> Posed:
    links = int(variant.split()[0])
    heading = 0.3 if "turned" in variant else 0.0
    one = np.ones(links)
    theta = heading + bend * np.arange(links)
    scene = Snake(one, one, one / 12, 10.0 * one[1:], 0.0 * one, theta)
    return Posed(scene, scene.initial_state()[0], np.array([1.0, 0.5]))


STRAIGHT = Family(
    key="straight",
    name="Straight snake",
    severity="bend between neighbours / rad",
    values=(*decades(-1, -16), 0.0),
    quick=(1e-1, 1e-4, 1e-8, 1e-12, 0.0),
    variants=("2 links, turned", "3 links", "7 links", "7 links, turned", "20 links"),
    pose=_pose,
)
