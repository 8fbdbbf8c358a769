"""`holds(claim, ...)` asserts that one claim holds on drawn and on special states."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import example, given, settings
from hypothesis.strategies import SearchStrategy

import eomcheck
from eomcheck import strategies
from eomcheck.lab.fuzzing.failures import read_failures
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake


def rolling(scene: Snake, theta, u=(1.0, 0.5)) -> tuple[Snake, State]:
    """Return the snake in a pose, in motion with u."""
    q = np.concatenate(([0.3, -0.2], np.broadcast_to(theta, scene.links)))
    return scene, State(q, eomcheck.velocity(scene, q, u))


def resting(scene: Snake) -> tuple[Snake, State]:
    """Return the snake in its initial state."""
    return scene, State(*scene.initial_state())


def uniform(wheel_angle, stiffness: float | None = 100.0) -> Snake:
    """Return a snake of equal links with the wheel angles given."""
    one = np.ones(len(wheel_angle))
    springs = None if stiffness is None else stiffness * one[1:]
    return Snake(one, one, one / 12, springs, wheel_angle)


ACROSS = uniform([0.1, 0.2, math.pi / 2])

SPECIAL: tuple[tuple[Snake, State], ...] = (
    resting(Snake.paper()),
    resting(Snake.coil(3)),
    resting(Snake.pattern(12)),
    # N = 1: el and em divide by sin φ_1.
    rolling(uniform([0.0]), 0.0),
    rolling(uniform([0.3]), -0.3),
    rolling(uniform([0.3]), 0.5),
    # N = 2 and N = 3: el and em are singular where the last two wheels are parallel.
    rolling(uniform([0.0, 0.0]), 0.7),
    rolling(uniform([0.25, -0.25], None), [0.5, 1.0]),
    rolling(uniform([0.1, 0.2, 0.2]), [0.0, 0.4, 0.4]),
    rolling(uniform([0.1, 0.2, 0.2]), [0.0, 0.4, 0.4 + math.pi]),
    # stretched, wheels along
    rolling(uniform([0.0] * 5), 0.0),
    # a wheel across its link: ml and kane refuse
    (ACROSS, State(np.array([0.0, 0.0, 0.1, 0.5, 0.9]), np.zeros(5))),
)
"""States that a draw would hardly hit."""

FINDS = tuple(read_failures(Path(__file__).with_name("found.json")))
"""States on which fuzzing once found a claim to fail, and why it did."""


def found_of(claim: str) -> tuple[tuple[Scene, State], ...]:
    """Return the snakes on which this claim, or any, was once found to fail."""
    return tuple(
        find.case for find in FINDS if find.scene == Snake.key and find.claim in ("", claim)
    )


def holds(
    claim: str,
    links: tuple[int, int],
    examples: int | None,
    of: Callable[[Scene], SearchStrategy[State]] = strategies.states,
    **ranges,
) -> None:
    """Assert that `claim` holds on drawn snakes and on the special states.

    It also fails if nothing could be checked on any of them.
    """
    drawn = strategies.scene_states(strategies.snakes(*links, **ranges), of)
    holds_on(claim, drawn, examples, SPECIAL + found_of(claim))


def holds_on(
    claim: str,
    drawn: SearchStrategy[tuple[Scene, State]],
    examples: int | None,
    special: tuple[tuple[Scene, State], ...] = (),
) -> None:
    """Assert that `claim` holds on `examples` drawn states, or as many as the profile says."""
    conclusive = 0

    def holds_here(case: tuple[Scene, State]) -> None:
        nonlocal conclusive
        scene, state = case
        for finding in eomcheck.check_state(scene, *state, claims=[claim]):
            assert finding.verdict != "failed", f"{finding}\n\n{finding.as_python()}"
            conclusive += finding.verdict == "passed"

    search = given(drawn)(holds_here)
    for case in special:
        search = example(case)(search)
    settings(max_examples=examples or settings().max_examples)(search)()
    assert conclusive > 0
