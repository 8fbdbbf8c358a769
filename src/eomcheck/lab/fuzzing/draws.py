"""Cases of one structure, drawn by families: ordinary, and hostile in one of several ways.

Numbers come from NumPy's generator, so that a seed draws the same on any machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from eomcheck.claims.pairwise_design import ATTEMPTS
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.evaluation.dynamics import closed_position
from eomcheck.lab.fuzzing.families import FAR, FAST, SPECIAL, SPEEDS, Case
from eomcheck.lab.fuzzing.scenes import distances, drawn_scene
from eomcheck.lab.fuzzing.strata import Stratum
from eomcheck.lab.fuzzing.velocities import consistent
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import null_space
from eomcheck.strategies.state_strategies import CURVATURE, angles_of, state_ranges


def drawn_position(
    scene: Scene, family: str, random: np.random.Generator
) -> tuple[Array, Array, float]:
    """Return (q (n,), components of v (p,), t).

    Raises:
        RefusedError: no position near what was drawn is closed.
    """
    coordinates, heading, components, time = state_ranges(scene)
    q = np.array([random.uniform(one.low, one.high) for one in coordinates])
    flags = np.array(angles_of(scene))
    turn = random.uniform(heading.low, heading.high)
    if scene.coordinate_ranges() is None:
        q = q + (CURVATURE * np.cumsum(flags) + turn) * flags
        if family == SPECIAL and flags.any():
            near = 10.0 ** random.uniform(-16, -1, q.shape) * random.integers(0, 2, q.shape)
            near = near if random.random() < 0.5 else distances(random, q.shape)
            # About 0 there is room for differences that are far below rounding of other angles.
            q = np.where(flags, random.choice((0.0, turn)) + near, q)
        if family == FAST and random.random() < 0.5:
            q = random.uniform(-FAR, FAR, q.shape)
    c = random.uniform(components.low, components.high, components.shape)
    if family == FAST:
        c = 10.0 ** random.uniform(-SPEEDS, SPEEDS, c.shape) * random.choice((-1, 0, 1), c.shape)
    elif random.random() < 1 / 16:
        c = np.zeros(c.shape)
    t = float(random.uniform(time.low, time.high))
    return closed_position(scene, q, t), c, t


def drawn(
    kind: type[Scene],
    stratum: Stratum,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[Case], list[str]]:
    """Return up to `count` cases of a structure and the family of each, evenly of all families."""
    return drawn_of(
        lambda family: drawn_scene(kind, stratum, family, random), families, count, random
    )


def drawn_of(
    make: Callable[[str], Scene],
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[Case], list[str]]:
    """Return cases as `drawn` does, of scenes that `make` makes of the name of a family.

    None where none of the first `ATTEMPTS` could be closed.
    """
    scenes, states, of = [], [], []
    components = []
    for i in range(count):
        family = families[i % len(families)]
        try:
            scene = make(family)
            q, c, t = drawn_position(scene, family, random)
        except EomcheckError:
            if not scenes and i >= ATTEMPTS:
                break
            continue  # no such scene, or no such position
        scenes.append(scene)
        states.append(State(q, np.zeros(scene.n), t))
        components.append(c)
        of.append(family)

    def velocities(at: LaneEvaluation) -> Array:
        c = np.array(components)
        if at.terms.a is None:
            return c
        basis = np.moveaxis(null_space(at.terms.a).data, -1, 0)
        return (basis @ c[:, : basis.shape[2], None])[..., 0]

    cases, kept = consistent(scenes, states, velocities)
    return cases, [of[i] for i in kept]
