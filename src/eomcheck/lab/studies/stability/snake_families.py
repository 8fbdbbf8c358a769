"""Families of the snake: joints, wheels and shape, masses and lengths, speeds, long chains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eomcheck.evaluation.certified import enclose
from eomcheck.lab.studies.stability.scene_families import Family, Posed, decades, violating
from eomcheck.numbers.ball import midpoints
from eomcheck.scenes import Snake

MOVING = np.array([1.0, 0.5])
"""u = (s_1, ω_1), m/s and rad/s."""


def _rods(alpha, theta, **others: Any) -> Snake:
    """Return a snake of rods of 1 m and 1 kg with joints of 10 N m/rad, except for `others`."""
    one = np.ones(len(theta))
    usual = {"mass": one, "length": one, "inertia": one / 12, "stiffness": 10.0 * one[1:]}
    return Snake(**usual | others, wheel_angle=alpha, pose=theta)


def bent(links: int, **others: Any) -> Snake:
    """Return a snake of rods, each turned by 0.4 rad against the one before, wheels by 0.1 rad."""
    k = np.arange(links)
    return _rods(0.1 * k, 0.4 * k, **others)


def _posed(scene: Snake, u=MOVING) -> Posed:
    return Posed(scene, scene.initial_state()[0], u)


# ---- Springs from none to rigid: they enter the forces only --------------------------------------


def _stiff(variant: str, stiffness: float) -> Posed:
    links = 7
    scene = replace(Snake.coil(links), stiffness=np.full(links - 1, stiffness))
    q, _ = scene.initial_state()
    if variant == "nearly relaxed":
        # Neighbours differ by 1e-6 rad, these differences by 1e-9: torques nearly cancel.
        k = np.arange(links)
        q[2:] = 0.3 + 1e-6 * k + 0.5e-9 * k**2
    return Posed(scene, q, np.zeros(2) if variant == "at rest" else MOVING)


STIFFNESS = Family(
    key="stiffness",
    name="Stiff joints",
    severity="joint stiffness k / (N m/rad)",
    values=(0.0, *decades(0, 12)),
    quick=(0.0, 1.0, 1e4, 1e8, 1e12),
    variants=("at rest", "moving", "nearly relaxed"),
    pose=_stiff,
)


# ---- A wheel that comes to stand across its link, at each position in the chain ------------------

WHEELS = 5
ACROSS = 6.123233995736766e-17
"""Distance of π/2 from its nearest float64."""
NEXT = ACROSS + 2.0**-52
"""Distance of π/2 from the float64 before that."""


def _across(variant: str, distance: float) -> Posed:
    sign, wheel = variant[0], int(variant[-1])
    alpha = 0.1 * np.arange(1, WHEELS + 1)
    alpha[wheel - 1] = (1.0 if sign == "+" else -1.0) * (math.pi / 2 - distance)
    # These speeds turn the link of this wheel at 1 rad/s, and hardly move the others.
    return _posed(_rods(alpha, 0.4 * np.arange(WHEELS)), MOVING * max(distance, ACROSS))


WHEEL_ANGLE = Family(
    key="wheel-angle",
    name="Wheel across its link",
    severity="distance of a wheel angle from ±π/2 / rad",
    values=(*decades(-1, -15), NEXT, ACROSS),
    quick=(1e-1, 1e-5, 1e-10, 1e-15, ACROSS),
    variants=tuple(f"{sign}π/2, wheel {k}" for k in range(1, WHEELS + 1) for sign in "+-"),
    pose=_across,
)


# ---- All θ equal and α = 0: approached by bending it less and less, and exact --------------------


def _straight(variant: str, bend: float) -> Posed:
    links = int(variant.split()[0])
    heading = 0.3 if "turned" in variant else 0.0
    return _posed(_rods(np.zeros(links), heading + bend * np.arange(links)))


STRAIGHT = Family(
    key="straight",
    name="Straight snake",
    severity="bend between neighbours / rad",
    values=(*decades(-1, -16), 0.0),
    quick=(1e-1, 1e-4, 1e-8, 1e-12, 0.0),
    variants=("2 links, turned", "3 links", "7 links", "7 links, turned", "20 links"),
    pose=_straight,
)


# ---- Links of very different masses and of very different lengths --------------------------------

UNEQUAL = 6
PATTERNS: dict[str, Callable] = {
    "head": lambda k: k == 0,
    "tail": lambda k: k == UNEQUAL - 1,
    "alternating": lambda k: k % 2 == 0,
}


def _unequal(quantity: str, variant: str, ratio: float) -> Posed:
    chosen = PATTERNS[variant.split()[-1]](np.arange(UNEQUAL))
    sizes = {"mass": np.ones(UNEQUAL), "length": np.ones(UNEQUAL)}
    sizes[quantity] = np.where(chosen, ratio, 1.0)
    return _posed(bent(UNEQUAL, **sizes, inertia=sizes["mass"] * sizes["length"] ** 2 / 12))


MASS_RATIO, LENGTH_RATIO = (
    Family(
        key=f"{what}-ratio",
        name=f"{what.capitalize()} ratio",
        severity=f"largest {what} over smallest",
        values=decades(0, 16),
        quick=decades(0, 16, 4),
        variants=(f"{word} head", f"{word} tail", "alternating"),
        pose=partial(_unequal, what),
    )
    for what, word in (("mass", "heavy"), ("length", "long"))
)


# ---- Speeds at the ends of the range of float64, and angles of many turns ------------------------


def _speed(variant: str, factor: float) -> Posed:
    scene = bent(5) if "springs" in variant else bent(5, stiffness=None)
    return _posed(scene, (factor if variant.startswith("fast") else 1.0 / factor) * MOVING)


def _turns(variant: str, turns: float) -> Posed:
    scene = bent(5)
    q, _ = scene.initial_state()
    q[2:] += 2 * math.pi * turns * (1.0 if variant == "all alike" else np.arange(1, 6))
    return Posed(scene, q, MOVING)


SPEED = Family(
    key="speed",
    name="Fast and slow",
    severity="speed over 1 m/s and 1 rad/s, or its inverse",
    values=decades(0, 170, 10),
    quick=(1.0, 1e50, 1e100, 1e150, 1e170),
    variants=("fast", "fast, springs", "slow", "slow, springs"),
    pose=_speed,
)
TURNS = Family(
    key="turns",
    name="Many turns",
    severity="turns of each angle",
    values=decades(0, 15),
    quick=(1.0, 1e4, 1e8, 1e12),
    variants=("all alike", "each more than the last"),
    pose=_turns,
)


# ---- Longer and longer chains: the motion from head to tail can outgrow all others ---------------


def _random(links: int, turn: float) -> Snake:
    random = np.random.default_rng(links)
    alpha = random.uniform(-0.3, 0.3, links)
    theta = np.cumsum(random.uniform(-turn, turn, links))
    return _rods(alpha, theta, stiffness=np.full(links - 1, 5000.0))


CHAINS: dict[str, Callable[[int], Snake]] = {
    "coil": Snake.coil,
    "pattern": Snake.pattern,
    "random, bent a little": lambda links: _random(links, 0.2),
    "random, bent": lambda links: _random(links, 1.0),
}


def _long(variant: str, links: float) -> Posed:
    scene = CHAINS[variant](int(links))
    if variant == "pattern":
        return _posed(scene, np.zeros(2))  # velocities of 500 links and more overflow float64
    q, _ = scene.initial_state()
    fastest = np.abs(midpoints(enclose(scene, "kane", q, MOVING, digits=1).v)).max()
    return Posed(scene, q, MOVING / fastest)


NUMBERS = [*(2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 70, 89, 100), 150, 200, 250, 300, 500, 700, 1000]
LINKS = Family(
    key="links",
    name="Long chain",
    severity="number of links N",
    values=tuple(map(float, NUMBERS)),
    quick=(2.0, 7.0, 20.0, 50.0),
    variants=tuple(CHAINS),
    pose=_long,
)


# ---- Velocities that slide the wheels sideways a little ------------------------------------------

SLIDING = {
    "coil": Snake.coil(7),
    "pattern": Snake.pattern(20),
    "free": _rods([0.1, 0.2, 0.3], [0.0, 0.4, 1.0], stiffness=None),
}


def _sliding(variant: str, violation: float) -> Posed:
    scene = SLIDING[variant]
    return violating(scene, scene.initial_state()[0], MOVING, violation)


VIOLATED = Family(
    key="violated",
    name="Violated constraints",
    severity="sliding of every wheel over the largest speed",
    values=decades(-16, 0),
    quick=decades(-16, 0, 4),
    variants=tuple(SLIDING),
    pose=_sliding,
)
