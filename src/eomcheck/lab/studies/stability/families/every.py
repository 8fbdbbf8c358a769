"""The families that every scene but the snake goes through: mass, speed, turns, violation.

The snake has families of its own, of which these are the outlines.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eomcheck.evaluation.dynamics import closed_position
from eomcheck.lab.studies.stability.families.base import Family, Posed, decades, violating
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

SEED = 1
ANYWHERE = (-1.0, 1.0)
"""m or rad: where coordinates are drawn from if a scene says nothing."""


def ordinary(scene: Scene) -> tuple[Array, Array]:
    """Return (q (n,), u (p,)) of an ordinary state: closed, and moving in every way."""
    random = np.random.default_rng(SEED)
    ranges = scene.coordinate_ranges()
    bounds = [ANYWHERE] * scene.n if ranges is None else [(one.low, one.high) for one in ranges]
    drawn = np.array([random.uniform(low, high) for low, high in bounds])
    return closed_position(scene, drawn), 1.0 / np.arange(1, scene.p + 1)


def _mass(kind: type[Scene], variant: str, ratio: float) -> Posed:
    scene: Any = kind.example()
    name = next(name for name in ("mass", "arm") if hasattr(scene, name))
    factor = ratio if variant == "heavier" else 1.0 / ratio
    mass = np.array(getattr(scene, name))
    mass.flat[0] *= factor
    scene = replace(scene, **{name: mass})
    return Posed(scene, *ordinary(scene))


def _speed(kind: type[Scene], variant: str, factor: float) -> Posed:
    scene = kind.example()
    q, u = ordinary(scene)
    return Posed(scene, q, u * (factor if variant == "fast" else 1.0 / factor))


def _turns(kind: type[Scene], variant: str, turns: float) -> Posed:
    scene = kind.example()
    q, u = ordinary(scene)
    q[kind.angle_coordinates] += 2 * np.pi * turns
    return Posed(scene, q, u)


def _violated(kind: type[Scene], variant: str, violation: float) -> Posed:
    scene = kind.example()
    return violating(scene, *ordinary(scene), violation)


def families_of_kind(kind: type[Scene]) -> Iterator[Family]:
    """Yield the families of a kind of scene."""
    yield Family(
        key=f"{kind.key}-mass",
        name="Mass",
        severity="first mass over its default, or its inverse",
        values=decades(0, 16),
        quick=decades(0, 16, 8),
        variants=("heavier", "lighter"),
        pose=partial(_mass, kind),
        scene=kind,
    )
    yield Family(
        key=f"{kind.key}-speed",
        name="Fast and slow",
        severity="speed over 1 m/s and 1 rad/s, or its inverse",
        values=decades(0, 170, 10),
        quick=(1.0, 1e100, 1e170),
        variants=("fast", "slow"),
        pose=partial(_speed, kind),
        scene=kind,
    )
    yield Family(
        key=f"{kind.key}-turns",
        name="Many turns",
        severity="turns of each angle",
        values=decades(0, 15),
        quick=(1.0, 1e8),
        variants=("all alike",),
        pose=partial(_turns, kind),
        scene=kind,
    )
    if kind.example().r:
        yield Family(
            key=f"{kind.key}-violated",
            name="Violated constraints",
            severity="rate of every constraint over the largest speed",
            values=decades(-16, 0),
            quick=decades(-16, 0, 8),
            variants=("all alike",),
            pose=partial(_violated, kind),
            scene=kind,
        )
