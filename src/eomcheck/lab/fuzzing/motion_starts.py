"""Where motions begin, of every structure at t = 0."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import closed_position
from eomcheck.lab.fuzzing.draws import drawn, drawn_of
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.strata import Stratum
from eomcheck.lab.fuzzing.structures import Topology, structure_drawn
from eomcheck.lab.fuzzing.velocities import consistent
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene


def started(
    kind: type[Scene],
    stratum: Stratum | Topology,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[Case], list[str]]:
    """Return up to `count` cases of a structure at t = 0, and the family of each."""
    if isinstance(stratum, Stratum):
        cases, of = drawn(kind, stratum, families, count, random)
    else:
        scene = structure_drawn(kind, stratum, random)()
        cases, of = drawn_of(lambda _: scene, families, count, random)
    begun, places = at_start(cases)
    return begun, [of[place] for place in places]


def at_start(cases: Sequence[Case]) -> tuple[list[Case], list[int]]:
    """Cases at t = 0, closed and consistent there, and which they are of those given.

    Those that cannot be are left out.
    """
    if not cases or not cases[0][0].depends_on_time:
        begun = [(scene, State(state.q, state.v, 0.0)) for scene, state in cases]
        return begun, [*range(len(cases))]
    scenes, states, wished, closed = [], [], [], []
    for i, (scene, state) in enumerate(cases):
        with suppress(EomcheckError):
            q = closed_position(scene, state.q, 0.0)
            scenes.append(scene)
            states.append(State(q, np.zeros(scene.n), 0.0))
            wished.append(state.v)
            closed.append(i)
    begun, places = consistent(scenes, states, lambda _: np.array(wished))
    return begun, [closed[place] for place in places]
