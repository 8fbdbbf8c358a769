"""Longer and longer chains: the motion from head to tail can outgrow all others."""

from __future__ import annotations

import numpy as np

from eomcheck.arithmetic.ball import midpoints
from eomcheck.enclosure import enclose
from eomcheck.scenes import Snake
from eomcheck.studies.families.base import Family, Posed


def _random(links: int, turn: float) -> Snake:
    random = np.random.default_rng(links)
    one = np.ones(links)
    return Snake(
        one,
        one,
        one / 12,
        5000.0 * one[1:],
        random.uniform(-0.3, 0.3, links),
        np.cumsum(random.uniform(-turn, turn, links)),
    )


SCENES = {
    "coil": Snake.coil,
    "pattern": Snake.pattern,
    "random, bent a little": lambda links: _random(links, 0.2),
    "random, bent": lambda links: _random(links, 1.0),
}


def _pose(variant: str, links: float) -> Posed:
    scene = SCENES[variant](int(links))
    q, _ = scene.initial_state()
    rest = np.zeros(2)
    if variant == "pattern":
        return Posed(scene, q, rest)  # no doubles hold the velocities of 500 links and more
    u = np.array([1.0, 0.5])
    fastest = np.abs(midpoints(enclose(scene, "kane", q, u, digits=1).v)).max()
    return Posed(scene, q, u / fastest)


LINKS = Family(
    key="links",
    name="Long chain",
    severity="number of links N",
    values=(2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 70.0)
    + (89.0, 100.0, 150.0, 200.0, 250.0, 300.0, 500.0, 700.0, 1000.0),
    quick=(2.0, 7.0, 20.0, 50.0),
    variants=tuple(SCENES),
    pose=_pose,
)
