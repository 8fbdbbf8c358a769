"""Scenes of one structure, drawn by families, and numbers next to special ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from eomcheck.claims.pairwise_design import ABSENT, value_of, ways_of
from eomcheck.lab.fuzzing.families import DECADES, FAST, ORDINARY, SPECIAL, WIDE
from eomcheck.lab.fuzzing.strata import Stratum
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

ACROSS = math.pi / 2


def drawn_scene(
    kind: type[Scene], stratum: Stratum, family: str, random: np.random.Generator
) -> Scene:
    """Return a scene of a structure.

    Raises:
        InputError: there is no such scene: other numbers are to be drawn.
    """
    return kind(
        **{
            name: _parameter(name, one, stratum, family, random)
            for name, one in kind.ranges(stratum.links).items()
        }
    )


def _parameter(
    name: str, one: Range, stratum: Stratum, family: str, random: np.random.Generator
) -> Any:
    if name in stratum.absent:
        return None
    ways = [way for way in ways_of(one) if way != ABSENT] or [ABSENT]
    value = value_of(one, str(random.choice(ways)), random)
    if value is None or np.size(value) == 0 or family in (ORDINARY, FAST):
        return value
    if one.low >= 0 and (family == WIDE or (family == SPECIAL and random.random() < 0.5)):
        wide = 10.0 ** random.uniform(-DECADES, DECADES, one.shape)
        zero = (random.random(one.shape) < 1 / 8) & (one.low == 0)
        value = np.where(zero, 0.0, wide)
    elif family == SPECIAL and one.low < 0 < one.high:
        if random.random() < 0.5:
            value = np.array([special_number(random, value) for _ in range(np.size(value))])
            value = value.reshape(one.shape)
        else:
            signs = random.choice((1.0, 1.0, -1.0), one.shape)
            value = random.choice(_among(random, value)) * signs + distances(random, one.shape)
    elif family == SPECIAL and one.shape and random.random() < 0.5:
        value = np.full(one.shape, value.ravel()[0])
    return value if one.shape else float(value)


def special_number(random: np.random.Generator, others: Any) -> float:
    """Return a number at or next to 0, ±π/2 or one of `others`, or an angle."""
    near = 10.0 ** random.uniform(-16, -1) * random.choice((0.0, 1.0, -1.0))
    return float(random.choice(_among(random, others)) + near)


def _among(random: np.random.Generator, others: Any) -> tuple[float, ...]:
    """Return what special angles are next to."""
    return 0.0, ACROSS, -ACROSS, float(np.ravel(others)[0]), random.uniform(-math.pi, math.pi)


def distances(random: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return distances of one scale, some of them 0.

    What needs several angles to be next to one another is rare if each is so for itself.
    """
    scale, shares = 10.0 ** random.uniform(-17, -1), 10.0 ** random.uniform(-3, 0, shape)
    return scale * shares * random.choice((0.0, 1.0, -1.0), shape)
