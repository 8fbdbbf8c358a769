"""States beyond the ordinary ones, at which engines that are named are asked as well.

An ordinary state has angles of one turn at most and moderate velocities. Every other state that is
drawn for engines that are named has joints turned by whole turns, velocities that are fast or slow,
or both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import closed_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.strategies.state_strategies import angles_of

TURNS = 2
"""Whole turns of an angle to either side, at most."""

FAST = 1.5, 3.0
"""Decades of the largest entry of a fast velocity, m/s or rad/s."""
SLOW = -6.0, -2.0
"""Decades of the largest entry of a slow one."""

WAYS = (True, None), (True, FAST), (True, SLOW), (False, FAST)
"""Whether angles are turned, and decades of the velocity, in turn."""


def with_wide(cases: Iterable[tuple[Scene, State]], seed: int) -> Iterator[tuple[Scene, State]]:
    """Yield cases, every other of them in a state beyond the ordinary ones.

    Args:
        cases: scenes in ordinary states.
        seed: of the draws.
    """
    random = np.random.default_rng([abs(seed), int(seed < 0), 1])
    for i, (scene, state) in enumerate(cases):
        yield scene, wide_state(scene, state, i // 2, random) if i % 2 else state


def wide_state(scene: Scene, state: State, number: int, random: np.random.Generator) -> State:
    """Return a state beyond the ordinary ones, made of an ordinary one.

    The state itself where no position next to the turned one is closed.

    Args:
        scene: the scene.
        state: an ordinary state, (q, v, t).
        number: of the state; states that follow each other are wide in other ways.
        random: source of the draws.
    """
    turned, decades = WAYS[number % len(WAYS)]
    q, v, t = state
    if turned:
        q = q + 2 * math.pi * random.integers(-TURNS, TURNS + 1, scene.n) * turning(scene)
    if decades is not None and v.any():
        v = v * (10 ** random.uniform(*decades) / largest(v))
    try:
        q = closed_position(scene, q, t)
        return State(q, consistent_velocity(Evaluation(scene, q, np.zeros(scene.n), t), v), t)
    except RefusedError:
        return state


def turning(scene: Scene) -> Array:
    """Return which coordinates turn something and move nothing along (n,)."""
    tree = scene.tree()
    if tree is None:
        return np.array(angles_of(scene))
    uses = tree.coordinates != 0
    turns = np.array([kind.startswith("r") for kind in tree.joint], bool)
    return uses[turns].any(axis=0) & ~uses[~turns].any(axis=0)
