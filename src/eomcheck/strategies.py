"""hypothesis strategies: snakes, consistent states, and hostile ones.

They describe what is valid, not how it is distributed, and refuse bad bounds when they are called,
not when they are drawn from::

    from hypothesis import given
    from eomcheck import strategies

    @given(strategies.scene_states(strategies.snakes(max_links=5)))
    def test_my_solver(case):
        scene, state = case
        ...
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from scipy.linalg import null_space

from eomcheck.errors import InputError
from eomcheck.evaluate import Evaluation, consistent_velocity
from eomcheck.model import Scene, State, finite_array
from eomcheck.scenes import Snake
from eomcheck.scenes.snake import whole_links

NEGLIGIBLE = 1e-6
"""Ordinary angles and speeds below this are drawn as 0: products of smaller ones underflow."""

CURVATURE = 0.4
"""Turn from one angle to the next in the pose around which ordinary states are drawn, rad."""


def _interval(name: str, bounds: tuple[float, float], lowest: float) -> SearchStrategy[float]:
    try:
        low, high = finite_array(name, bounds, (2,)).tolist()
    except InputError:
        low = high = math.nan
    if not lowest <= low <= high:
        raise InputError(f"{name} = {bounds!r}, expected {lowest:g} <= low <= high, both finite")
    return st.floats(low, high)


def _symmetric(name: str, bound: float) -> SearchStrategy[float]:
    _interval(name, (0.0, bound), 0.0)
    return st.floats(-bound, bound).map(lambda x: x if abs(x) >= NEGLIGIBLE else 0.0)


def _vector(entries: SearchStrategy[float], size: int) -> SearchStrategy[list[float]]:
    return st.lists(entries, min_size=size, max_size=size)


def _links(min_links: int, max_links: int) -> SearchStrategy[int]:
    low, high = whole_links(min_links, "min_links"), whole_links(max_links, "max_links")
    if low > high:
        raise InputError(f"min_links, max_links = {low}, {high}, expected min_links <= max_links")
    return st.integers(low, high)


def snakes(
    min_links: int = 1,
    max_links: int = 8,
    *,
    mass: tuple[float, float] = (0.1, 10.0),
    length: tuple[float, float] = (0.1, 10.0),
    inertia: tuple[float, float] = (0.01, 10.0),
    stiffness: tuple[float, float] = (0.0, 1e4),
    damping: tuple[float, float] = (0.0, 100.0),
    wheel_angle: float = 1.0,
) -> SearchStrategy[Snake]:
    """Return a strategy for snakes whose links differ, with springs and dampers or without.

    Args:
        min_links: smallest N.
        max_links: largest N.
        mass: bounds, kg.
        length: bounds, m.
        inertia: bounds, kg m².
        stiffness: bounds, N m/rad.
        damping: bounds, N m s/rad.
        wheel_angle: largest |α|, rad.

    Raises:
        InputError: bounds that no snake can have.
    """
    links = _links(min_links, max_links)
    smallest = np.nextafter(0.0, 1.0)
    masses = _interval("mass", mass, smallest)
    lengths = _interval("length", length, smallest)
    inertias = _interval("inertia", inertia, 0.0)
    springs = _interval("stiffness", stiffness, 0.0)
    dampers = _interval("damping", damping, 0.0)
    wheels = _symmetric("wheel_angle", wheel_angle)

    def build(n: int) -> SearchStrategy[Snake]:
        return st.builds(
            Snake,
            mass=_vector(masses, n),
            length=_vector(lengths, n),
            inertia=_vector(inertias, n),
            stiffness=st.none() | _vector(springs, n - 1) | _vector(springs, n - 1),
            wheel_angle=_vector(wheels, n),
            damping=st.none() | st.none() | _vector(dampers, n - 1),
        )

    return links.flatmap(build)


def states(
    scene: Scene, *, position: float = 10.0, angle: float = 1.0, speed: float = 5.0
) -> SearchStrategy[State]:
    """Return a strategy for states of `scene` whose velocity satisfies the constraints.

    The velocity is drawn in an orthonormal basis of the null space of a, so that no generalized
    speeds need exist. Angles are drawn around a curved pose with any heading: equal draws, which
    hypothesis is fond of, then are no stretched pose, where El and Em have to refuse
    (`hostile_states` has those).

    Args:
        scene: the scene.
        position: largest coordinate that is not an angle.
        angle: largest distance of an angle from the curved pose, rad.
        speed: largest component of v along a basis vector.

    Raises:
        InputError: negative or infinite bounds.
    """
    is_angle = np.zeros(scene.n, dtype=bool)
    is_angle[scene.angle_coordinates] = True
    along, turned = _symmetric("position", position), _symmetric("angle", angle)
    coordinates = st.tuples(*(turned if flag else along for flag in is_angle))
    components = _vector(_symmetric("speed", speed), scene.p)
    curved = CURVATURE * np.cumsum(is_angle) * is_angle
    return st.builds(
        lambda q, heading, c: _state(scene, np.array(q) + curved + heading * is_angle, np.array(c)),
        coordinates,
        _symmetric("heading", math.pi),
        components,
    )


def _state(scene: Scene, q: np.ndarray, components: np.ndarray) -> State:
    at = Evaluation(scene, q, np.zeros(scene.n))
    if at.terms.a is None:
        return State(q, components)
    basis = null_space(at.terms.a)[:, : components.size]
    return State(q, consistent_velocity(at, basis @ components[: basis.shape[1]]))


def scene_states(
    scenes: SearchStrategy[Scene], of: Callable[[Scene], SearchStrategy[State]] = states
) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for pairs of a scene and one of its states."""
    return scenes.flatmap(lambda scene: of(scene).map(lambda state: (scene, state)))


def _magnitudes(low: float, high: float) -> SearchStrategy[float]:
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def hostile_snakes(min_links: int = 1, max_links: int = 8) -> SearchStrategy[Snake]:
    """Return a strategy for snakes at the edge: huge and tiny parameters, wheels across the link.

    All are valid. Formulations may refuse them; none may answer with NaN.

    Raises:
        InputError: bounds that no snake can have.
    """
    sizes = _magnitudes(-8.0, 8.0)
    across = st.builds(
        lambda sign, distance: sign * (math.pi / 2 - distance),
        st.sampled_from((-1.0, 1.0)),
        st.just(0.0) | _magnitudes(-16.0, -1.0),
    )
    wheels = st.sampled_from((0.0, -0.0)) | st.floats(-math.pi, math.pi) | across

    def build(n: int) -> SearchStrategy[Snake]:
        return st.builds(
            Snake,
            mass=_vector(sizes, n),
            length=_vector(sizes, n),
            inertia=_vector(st.just(0.0) | sizes, n),
            stiffness=st.none() | _vector(st.just(0.0) | _magnitudes(-8.0, 12.0), n - 1),
            wheel_angle=_vector(wheels, n),
            damping=st.none() | _vector(st.just(0.0) | _magnitudes(-8.0, 12.0), n - 1),
        )

    return _links(min_links, max_links).flatmap(build)


def hostile_states(scene: Scene) -> SearchStrategy[State]:
    """Return a strategy for consistent states at the edge of `scene`.

    Stretched poses, many turns, and speeds from 1e-150 to 1e150.
    """
    components = _vector(
        st.just(0.0)
        | st.builds(lambda sign, x: sign * x, st.sampled_from((-1.0, 1.0)), _magnitudes(-150, 150)),
        scene.p,
    )
    straight = st.floats(-math.pi, math.pi).map(lambda x: [x] * scene.n)
    anywhere = _vector(st.floats(-1e9, 1e9), scene.n)
    return st.builds(
        lambda q, c: _state(scene, np.array(q), np.array(c)), straight | anywhere, components
    )
