"""Strategies for states: positions with closed loops and velocities that satisfy the constraints.

Ordinary states have moderate speeds near a curved pose; hostile ones are valid extremes: stretched
poses, many turns, speeds from 1e-150 to 1e150.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from scipy.linalg import null_space

from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import assembled_position, consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.scenes import Snake
from eomcheck.strategies.scene_strategies import (
    bounded_floats,
    entry_of,
    links_between,
    lists_of,
    magnitudes,
    parameter_of,
)

CURVATURE = 0.4
"""Difference of successive angles in the pose around which ordinary states are drawn, rad."""


def states(
    scene: Scene,
    *,
    position: float = 10.0,
    angle: float = 1.0,
    speed: float = 5.0,
    time: float = 10.0,
) -> SearchStrategy[State]:
    """Return a strategy for states of `scene` that satisfy the constraints.

    The velocity is drawn in an orthonormal basis of the null space of a, so that no generalized
    speeds need exist. Coordinates are drawn from the scene's `coordinate_ranges`. If it has none,
    angles are drawn around a curved pose with any heading: equal draws, which hypothesis prefers,
    then are no stretched pose, a singular configuration that El and Em have to refuse
    (`hostile_states` has those).

    Args:
        scene: the scene.
        position: largest coordinate that is not an angle, if the scene has no ranges.
        angle: largest distance of an angle from the curved pose, rad, likewise.
        speed: largest component of v along a basis vector.
        time: latest time, s, where the scene depends on time.

    Raises:
        InputError: `scene` is no scene, or bounds are negative or infinite.
    """
    checked_scene(scene)
    for name, bound in (("position", position), ("angle", angle), ("speed", speed), ("time", time)):
        bounded_floats(name, (0.0, bound), 0.0)
    coordinates, *rest = state_ranges(scene, position, angle, speed, time)
    among = st.tuples(*map(entry_of, coordinates)), *map(parameter_of, rest)
    return st.tuples(*among).map(state_or_reject(ordinary_state, scene))


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
    """Return the ranges of ordinary states of `scene`; for arguments see `states`."""
    own = scene.coordinate_ranges()
    usual = Range(-position, position), Range(-angle, angle)
    heading = math.pi if own is None else 0.0
    return StateRanges(
        own or tuple(usual[flag] for flag in angles_of(scene)),
        Range(-heading, heading),
        Range(-speed, speed, (scene.p or scene.n,)),  # with p = 0, dependent rows may allow motion
        Range(0.0, time if scene.depends_on_time else 0.0),
    )


def angles_of(scene: Scene) -> list[bool]:
    """Return the flags (n,) of coordinates that are angles."""
    flags = [False] * scene.n
    flags[scene.angle_coordinates] = [True] * len(flags[scene.angle_coordinates])
    return flags


def ordinary_state(scene: Scene, coordinates, heading: float, components, t: float) -> State:
    """Return the consistent state of `scene` made of these numbers, see `StateRanges`.

    Raises:
        RefusedError: no position near the coordinates satisfies the loop closure.
    """
    q = np.array(coordinates)
    if scene.coordinate_ranges() is None:
        flags = np.array(angles_of(scene))
        q = q + (CURVATURE * np.cumsum(flags) + heading) * flags
    return consistent_state(scene, q, components, t)


def consistent_state(scene: Scene, q, components, t: float) -> State:
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
    components, at = np.array(components), Evaluation(scene, q, np.zeros(scene.n), t)
    if at.terms.a is None:
        return State(q, components, t)
    basis = null_space(at.terms.a)[:, : components.size]
    return State(q, consistent_velocity(at, basis @ components[: basis.shape[1]]), t)


def state_or_reject(make: Callable[..., State], scene: Scene) -> Callable[[Sequence], State]:
    """Return a function from numbers to a state; it rejects the draw if there is no closed one."""

    def state_of(numbers: Sequence) -> State:
        try:
            return make(scene, *numbers)
        except RefusedError:
            reject()

    return state_of


def scene_states(
    scenes: SearchStrategy[Scene], of: Callable[[Scene], SearchStrategy[State]] = states
) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for pairs of a scene and one of its states."""
    return scenes.flatmap(lambda scene: of(scene).map(lambda state: (scene, state)))


# ---- Hostile scenes and states -------------------------------------------------------------------


def hostile_snakes(min_links: int = 1, max_links: int = 8) -> SearchStrategy[Snake]:
    """Return a strategy for extreme snakes: huge and tiny parameters, wheels across the link.

    All are valid. Formulations may refuse them; none may return NaN.

    Raises:
        InputError: bounds that no snake can have.
    """
    sizes = magnitudes(-8.0, 8.0)
    across = st.builds(
        lambda sign, distance: sign * (math.pi / 2 - distance),
        st.sampled_from((-1.0, 1.0)),
        st.just(0.0) | magnitudes(-16.0, -1.0),
    )
    wheels = st.sampled_from((0.0, -0.0)) | st.floats(-math.pi, math.pi) | across

    def build(n: int) -> SearchStrategy[Snake]:
        return st.builds(
            Snake,
            mass=lists_of(sizes, n),
            length=lists_of(sizes, n),
            inertia=lists_of(st.just(0.0) | sizes, n),
            stiffness=st.none() | lists_of(st.just(0.0) | magnitudes(-8.0, 12.0), n - 1),
            wheel_angle=lists_of(wheels, n),
            damping=st.none() | lists_of(st.just(0.0) | magnitudes(-8.0, 12.0), n - 1),
        )

    return links_between(min_links, max_links).flatmap(build)


def hostile_states(scene: Scene) -> SearchStrategy[State]:
    """Return a strategy for extreme but consistent states of `scene`.

    Stretched poses, many turns, and speeds from 1e-150 to 1e150.
    """
    components = lists_of(
        st.just(0.0)
        | st.builds(lambda sign, x: sign * x, st.sampled_from((-1.0, 1.0)), magnitudes(-150, 150)),
        scene.p,
    )
    straight = st.floats(-math.pi, math.pi).map(lambda x: [x] * scene.n)
    anywhere = lists_of(st.floats(-1e9, 1e9), scene.n)
    numbers = st.tuples(straight | anywhere, components, st.just(0.0))
    return numbers.map(state_or_reject(consistent_state, scene))
