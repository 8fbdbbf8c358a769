"""Speeds at the ends of what doubles hold, and angles of many turns."""

from __future__ import annotations

import math

import numpy as np

from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.scenes import Snake

LINKS = 5


def _snake(springs: bool) -> Snake:
    one, k = np.ones(LINKS), np.arange(LINKS)
    return Snake(one, one, one / 12, 10.0 * one[1:] if springs else None, 0.1 * k, 0.4 * k)


def _speed(variant: str, factor: float) -> Posed:
    scene = _snake("springs" in variant)
    speed = factor if variant.startswith("fast") else 1.0 / factor
    return Posed(scene, scene.initial_state()[0], speed * np.array([1.0, 0.5]))


def _turns(variant: str, turns: float) -> Posed:
    scene = _snake(True)
    q, _ = scene.initial_state()
    q[2:] += 2 * math.pi * turns * (1.0 if variant == "all alike" else np.arange(1, LINKS + 1))
    return Posed(scene, q, np.array([1.0, 0.5]))


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
