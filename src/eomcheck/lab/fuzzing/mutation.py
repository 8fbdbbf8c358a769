"""Cases near other cases: a few of their numbers changed, or taken from others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import closed_position
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.scenes import ACROSS
from eomcheck.lab.fuzzing.velocities import consistent
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

MOST_CHANGES = 3
"""Parts of a case that are changed at once, at most."""


Changed = tuple[Scene, Array, Array]
"""A scene, coordinates (n,) and velocities (n,) wished for."""


def mutated(
    parents: Sequence[tuple[Case, Case]],
    random: np.random.Generator,
    tamed: Callable[[Changed], Changed] = lambda one: one,
) -> tuple[list[Case], list[int]]:
    """Return cases near the first of each pair, all of one structure, and which they are.

    Args:
        parents: pairs of cases: what is changed, and what numbers are taken from.
        random: of the draws.
        tamed: returns what is to be looked at in place of what came of a change.
    """
    scenes, states, wished, places = [], [], [], []
    for i, (case, other) in enumerate(parents):
        try:
            scene, q, v = tamed(_changed(case, other, random))
            q = closed_position(scene, q, case[1].t)
        except EomcheckError:
            continue  # no such scene, or no such position
        scenes.append(scene)
        states.append(State(q, np.zeros(scene.n), case[1].t))
        wished.append(v)
        places.append(i)
    cases, kept = consistent(scenes, states, lambda _: np.array(wished))
    return cases, [places[i] for i in kept]


def _changed(case: Case, other: Case, random: np.random.Generator) -> Changed:
    scene, (q, v, _) = case
    ranges = type(scene).ranges(getattr(scene, "links", None) if scene.has_links else None)
    values = {name: getattr(scene, name) for name in ranges}
    there = [name for name, x in values.items() if x is not None and np.size(x)]
    # State and velocity as often as all parameters: which of them matter depends on the claim.
    parts = [*there, *["q", "v"] * max(1, len(there) // 3)]
    for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
        name = parts[random.integers(len(parts))]
        if name == "q":
            q = changed_entries(q, other[1].q, random)
        elif name == "v":
            v = changed_entries(v, other[1].v, random)
        else:
            new = changed_entries(np.asarray(values[name]), getattr(other[0], name), random)
            values[name] = np.abs(new) if ranges[name].low >= 0 else new
    return type(scene)(**values), q, v


def changed_entries(x: Array, other: Array, random: np.random.Generator) -> Array:
    """Return x with entries changed, in one of several ways."""
    shape = np.shape(x)
    x = np.array(x, dtype=np.float64).ravel()
    other = np.ravel(other)
    i, j = random.integers(x.size, size=2)
    size = 10.0 ** random.uniform(-16, 0)
    match random.integers(10):
        case 0:
            x[i] *= 10.0 ** random.normal(0, 2)
        case 1:
            x[i] *= 1 + random.normal() * size
        case 2:
            x[i] = x[j] + random.choice([0.0, 1.0]) * random.normal() * size
        case 3:
            x[i] = random.choice([0.0, 1.0, ACROSS, 0.5, math.pi])
        case 4:
            x[i] += random.normal() * size
        case 5:
            x = np.where(random.random(x.size) < 0.5, x, other)
        case 6:
            x[i] = -x[i]
        case 7:  # all of them next to one, on either side
            one = random.choice([x[i], 0.0, ACROSS]) * random.choice((1.0, 1.0, -1.0), x.size)
            x = one + random.integers(0, 2, x.size) * random.normal(size=x.size) * size
        case 8:  # what is between them, or what they are, to a smaller scale
            x = x[i] * random.integers(0, 2) + (x - x[i]) * size
        case _:
            x *= 10.0 ** random.normal(0, 2)
    return x.reshape(shape)
