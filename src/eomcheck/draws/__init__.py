"""Random cases: states with closed loops that satisfy the constraints, ordinary and hostile.

All draws, also those of pairwise designs and of fuzzing in the files beside, are functions of a
scene and of `Choices` (`eomcheck.mechanics.scene`): a NumPy generator, or hypothesis, which can
shrink them (`eomcheck.strategies`).

Ordinary states have moderate speeds near a curved pose; hostile ones are valid extremes: stretched
poses, many turns, speeds from 1e-150 to 1e150.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import null_space

from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Choices, Scene
from eomcheck.numbers.generic import Array

S = TypeVar("S", bound=Scene)

# ---- Scenes --------------------------------------------------------------------------------------


def draw_topology(
    kind: type[Scene], links: int | None, choices: Choices, levels: dict[str, str] | None = None
) -> type[Scene]:
    """Return a scene class of one topology, drawn among those with the given factor levels.

    Raises:
        RefusedError: the topology drawn cannot be assembled.
    """
    fixed = levels or {}
    entries = [
        entry
        for entry in kind.topologies(links)
        if all(level in entry.get(name, ()) for name, level in fixed.items())
    ]
    drawn = {name: choices.one_of(among) for name, among in choices.one_of(entries).items()}
    return kind.of_topology(links, drawn | fixed, choices)


def scene_within(kind: type[S], ranges: dict[str, Range], choices: Choices) -> S:
    """Return a scene with parameters from `ranges`; one of three optional parameters is absent."""
    absent = (True, False, False)
    return kind(
        **{
            name: None if one.optional and choices.one_of(absent) else draw_array(one, choices)
            for name, one in ranges.items()
        }
    )


def draw_array(one: Range, choices: Choices) -> Any:
    """Return a number, or an array of numbers, from a range."""
    if one.shape == ():
        return choices.number(one.low, one.high)
    entries = [choices.number(one.low, one.high) for _ in range(math.prod(one.shape))]
    return np.reshape(np.array(entries, float), one.shape)


# ---- Ordinary states -----------------------------------------------------------------------------

CURVATURE = 0.4
"""Difference of successive angles in the pose around which ordinary states are drawn, rad.

Where scenes name no ranges of their coordinates: a chain drawn around a straight line would often
be singular."""


class StateRanges(NamedTuple):
    """Ranges of the numbers that make an ordinary state."""

    coordinates: tuple[Range, ...]
    """Ranges of q; of angles, relative to the curved pose if the scene has no ranges."""
    heading: Range
    """Range of a rotation added to all angles, rad; only 0 if the scene has its own ranges."""
    components: Range
    """Range of the components (p,) of v along an orthonormal basis of the null space of a."""
    time: Range
    """Range of t, s."""


def state_ranges(
    scene: Scene,
    position: float = 10.0,
    angle: float = 1.0,
    speed: float = 5.0,
    time: float = 10.0,
) -> StateRanges:
    """Return the ranges of ordinary states; for arguments see `eomcheck.strategies.states`."""
    own = scene.coordinate_ranges()
    usual = Range(-position, position), Range(-angle, angle)
    heading = math.pi if own is None else 0.0
    return StateRanges(
        own or tuple(usual[flag] for flag in angles_of(scene)),
        Range(-heading, heading),
        Range(-speed, speed, (component_count(scene),)),
        Range(0.0, time if scene.depends_on_time else 0.0),
    )


def component_count(scene: Scene) -> int:
    """Return the number of components of v to draw; with p = 0, dependent rows may allow motion."""
    return scene.p or scene.n


def angles_of(scene: Scene) -> list[bool]:
    """Return the flags (n,) of coordinates that are angles."""
    flags = [False] * scene.n
    flags[scene.angle_coordinates] = [True] * len(flags[scene.angle_coordinates])
    return flags


def draw_coordinates(scene: Scene, ranges: StateRanges, choices: Choices) -> tuple[Array, float]:
    """Return coordinates (n,), loops not closed, and the heading of the curved pose, rad."""
    q = np.array([draw_array(one, choices) for one in ranges.coordinates])
    heading = draw_array(ranges.heading, choices)
    if scene.coordinate_ranges() is None:
        flags = np.array(angles_of(scene))
        q = q + (CURVATURE * np.cumsum(flags) + heading) * flags
    return q, heading


def ordinary_state(
    scene: Scene, choices: Choices, ranges: StateRanges | None = None, at_rest: bool = False
) -> State:
    """Return an ordinary state of a scene.

    Args:
        scene: the scene.
        choices: source of the numbers.
        ranges: their ranges, by default `state_ranges`.
        at_rest: whether the components of v are 0; drawn in any case.

    Raises:
        RefusedError: no position near the coordinates satisfies the loop closure.
    """
    ranges = ranges or state_ranges(scene)
    q, _ = draw_coordinates(scene, ranges, choices)
    components, t = draw_array(ranges.components, choices), draw_array(ranges.time, choices)
    return consistent_state(scene, q, np.zeros_like(components) if at_rest else components, t)


def consistent_state(scene: Scene, q: Array, components: Array, t: float) -> State:
    """Return the state at the closed position near q with a consistent velocity.

    Args:
        scene: the scene.
        q: coordinates (n,).
        components: components of v along an orthonormal basis of the null space of a.
        t: time, s.

    Raises:
        RefusedError: no position near q satisfies the loop closure.
    """
    q = assembled_position(scene, q, t)
    at = Evaluation(scene, q, np.zeros(scene.n), t)
    if at.terms.a is None:
        return State(q, components, t)
    basis = null_space(at.terms.a)[:, : components.size]
    return State(q, consistent_velocity(at, basis @ components[: basis.shape[1]]), t)


# ---- Hostile states ------------------------------------------------------------------------------

SPEEDS = 150.0
"""Decades of fast velocities: their components go from 10^-150 to 10^150."""
FAR = 1e9
"""Largest coordinate of a hostile state, m or rad."""


def hostile_state(scene: Scene, choices: Choices) -> State:
    """Return an extreme but consistent state: stretched or many turns away, of any speed, t = 0.

    Raises:
        RefusedError: no position near the coordinates satisfies the loop closure.
    """
    if choices.one_of((True, False)):
        q = np.full(scene.n, choices.number(-math.pi, math.pi))
    else:
        q = draw_array(Range(-FAR, FAR, (scene.n,)), choices)
    speeds = -SPEEDS, SPEEDS, (-1.0, 1.0)
    components = [zero_or_magnitude(choices, *speeds) for _ in range(component_count(scene))]
    return consistent_state(scene, q, np.array(components), 0.0)


def draw_magnitude(choices: Choices, low: float, high: float) -> float:
    """Return a number from 10^low to 10^high, log-uniform."""
    return 10.0 ** choices.number(low, high)


def zero_or_magnitude(
    choices: Choices, low: float, high: float, signs: tuple[float, ...] = (1.0,)
) -> float:
    """Return 0, or a number from 10^low to 10^high with one of the signs."""
    if choices.one_of((True, False)):
        return 0.0
    return (choices.one_of(signs) if len(signs) > 1 else 1.0) * draw_magnitude(choices, low, high)
