"""Longer and longer chains: the motion from head to tail can outgrow all others."""

from __future__ import annotations

import numpy as np

from eomcheck.evaluation.enclosure import enclose
from eomcheck.lab.studies.stability.families.base import Family, Posed
from eomcheck.numbers.ball import midpoints
from eomcheck.scenes import Snake


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


NUMBERS = [*(2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 70, 89, 100), 150, 200, 250, 300, 500, 700, 1000]

LINKS = Family(
    key="links",
    name="Long chain",
    severity="number of links N",
    values=tuple(map(float, NUMBERS)),
    quick=(2.0, 7.0, 20.0, 50.0),
    variants=tuple(SCENES),
    pose=_pose,
)
