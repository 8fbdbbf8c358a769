"""Hypothesis strategies for property-based testing: scenes, consistent states, hostile states.

Strategies define the set of valid inputs, not their distribution; hypothesis makes all choices, so
that it can shrink them. Bad bounds raise InputError when a strategy is constructed, not when it is
drawn from::

    from hypothesis import given
    from eomcheck import strategies

    @strategies.settings
    @given(strategies.scene_states(strategies.snakes(max_links=5)))
    def test_my_solver(case):
        scene, state = case
        ...
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, TypeVar

import hypothesis
import numpy as np
from hypothesis import HealthCheck, Phase, reject
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.deprecated import old_keywords
from eomcheck.descriptions.random_mechanisms import RandomMechanism, RandomTree, checked_links
from eomcheck.descriptions.random_trees import COMMON_JOINTS, URDF_JOINTS, urdf_tree
from eomcheck.descriptions.urdf_reader import urdf_text
from eomcheck.draws import (
    CURVATURE,
    draw_magnitude,
    draw_topology,
    hostile_state,
    ordinary_state,
    scene_within,
    state_ranges,
    zero_or_magnitude,
)
from eomcheck.errors import InputError, RefusedError, distinct, whole_number
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Choices, Scene, checked_scene, finite_array
from eomcheck.scenes import Snake

__all__ = [
    "CURVATURE",
    "NEGLIGIBLE",
    "hostile_snakes",
    "hostile_states",
    "random_mechanisms",
    "random_trees",
    "scene_states",
    "scenes",
    "settings",
    "snakes",
    "states",
    "urdfs",
]

settings = hypothesis.settings(
    deadline=None,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
        HealthCheck.filter_too_much,
    ],
)
"""Hypothesis settings for tests that draw from these strategies, as a decorator or the first
argument of `hypothesis.settings`. Deadline and health checks are off: the first case loads engines,
and drawing a case solves its loop closure and makes its velocity consistent."""

S = TypeVar("S", bound=Scene)
T = TypeVar("T")

# ---- Choices by hypothesis -----------------------------------------------------------------------

NEGLIGIBLE = 1e-6
"""Magnitude below which ordinary angles and speeds are drawn as 0: products would underflow."""


class HypothesisChoices:
    """A source of random choices made by hypothesis, so that it can shrink them.

    Args:
        draw: function that draws from a strategy.
        tiny: whether numbers of either sign may be below `NEGLIGIBLE`.
    """

    def __init__(self, draw: Callable[[SearchStrategy], Any], tiny: bool = False):
        self._draw, self._tiny = draw, tiny

    def one_of(self, among: Sequence[T]) -> T:
        """Return one element of a sequence."""
        return self._draw(st.sampled_from(among))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number, both bounds included."""
        return self._draw(st.integers(low, high))

    def number(self, low: float, high: float) -> float:
        """Return a number between bounds."""
        return self._draw(_numbers(low, high, self._tiny))


@cache
def _numbers(low: float, high: float, tiny: bool) -> SearchStrategy[float]:
    numbers = st.floats(low, high)
    return numbers if tiny or not low < 0.0 < high else numbers.map(without_tiny)


def without_tiny(x: float) -> float:
    """Return x, or 0 if its magnitude is below `NEGLIGIBLE`."""
    return x if abs(x) >= NEGLIGIBLE else 0.0


@st.composite
def strategy_of(draw: Any, make: Callable[[Choices], T], tiny: bool = False) -> T:
    """Return a strategy for results of `make`, which makes choices; refused draws are rejected."""
    try:
        return make(HypothesisChoices(draw, tiny))
    except RefusedError:
        reject()


def draw_samples(cases: SearchStrategy[T], count: int, seed: int) -> list[T]:
    """Return at most `count` draws from `cases`, the same for the same seed.

    Fewer where `cases` has no more different ones.
    """
    samples: list[T] = []
    unshrunk = hypothesis.settings(
        settings, max_examples=count, database=None, phases=[Phase.generate]
    )

    @hypothesis.seed(seed)
    @unshrunk
    @hypothesis.given(cases)
    def take(case: T) -> None:
        samples.append(case)

    take()
    return samples


# ---- Scenes --------------------------------------------------------------------------------------


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
    """Return a strategy for snakes of different links, each with or without springs and dampers.

    Args:
        min_links: smallest number of links N.
        max_links: largest number of links N.
        mass: bounds, kg.
        length: bounds, m.
        inertia: bounds, kg m².
        stiffness: bounds, N m/rad.
        damping: bounds, N m s/rad.
        wheel_angle: largest |α|, rad.

    Raises:
        InputError: bounds that no snake can have.
    """
    links = _checked_interval("links", whole_number, min_links, max_links)
    positive = np.nextafter(0.0, 1.0)
    check_bounds("mass", mass, positive)
    check_bounds("length", length, positive)
    check_bounds("inertia", inertia, 0.0)
    check_bounds("stiffness", stiffness, 0.0)
    check_bounds("damping", damping, 0.0)
    check_bounds("wheel_angle", (0.0, wheel_angle), 0.0)
    bounds = {
        "mass": mass,
        "length": length,
        "inertia": inertia,
        "stiffness": stiffness,
        "damping": damping,
        "wheel_angle": (-wheel_angle, wheel_angle),
    }

    def snake(choices: Choices) -> Snake:
        ranges = Snake.ranges(choices.whole(*links))
        for name, (low, high) in bounds.items():
            ranges[name] = ranges[name]._replace(low=low, high=high)
        return scene_within(Snake, ranges, choices)

    return strategy_of(snake)


def scenes(kind: type[S], min_links: int = 1, max_links: int = 8) -> SearchStrategy[S]:
    """Return a strategy for scenes of a class, with parameters from its `ranges`.

    Args:
        kind: the scene class.
        min_links: smallest number of links, for a class that has one.
        max_links: largest number of links, likewise.

    Raises:
        InputError: numbers of links that no such scene can have.
    """
    links = (
        _checked_interval("links", whole_number, min_links, max_links) if kind.has_links else None
    )

    def scene(choices: Choices) -> Any:
        count = None if links is None else choices.whole(*links)
        topology = draw_topology(kind, count, choices)
        return scene_within(topology, topology.ranges(count), choices)

    return strategy_of(scene)


def random_trees(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomTree]:
    """Return a strategy for open-loop trees of rigid bodies of random topology.

    In the plane or in space, with joints of all types, axes, placements and inertias of any
    direction, and with or without massless carriers, springs, dampers, rotors, mimic joints and
    gravity. The declarative description of a scene is its `source.description`.

    Args:
        min_bodies: smallest number of links, the ground not counted.
        max_bodies: largest number of links.

    Raises:
        InputError: numbers that no such tree has.
    """
    return scenes(RandomTree, *_bodies(min_bodies, max_bodies))


def random_mechanisms(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomMechanism]:
    """Return a strategy for random trees with independent constraints.

    Pins, welds, hinges, rods and points on planes, which close loops; couplings; knife edges; and
    joints driven by the clock. For arguments and errors see `random_trees`.
    """
    return scenes(RandomMechanism, *_bodies(min_bodies, max_bodies))


def urdfs(
    min_bodies: int = 1,
    max_bodies: int = 8,
    *,
    joints: Iterable[str] = COMMON_JOINTS,
    mimic: bool = True,
    massless: bool = True,
    dampers: bool = True,
) -> SearchStrategy[str]:
    """Return a strategy for texts of URDFs: random trees in space, joints in any order.

    `eomcheck.scenes.from_urdf` reads each of them, and any other parser should.

    Args:
        min_bodies: smallest number of links, the root not counted.
        max_bodies: largest number of links, likewise.
        joints: allowed joint types: "revolute", and any of "prismatic", "fixed", "planar",
            "floating". Revolute joints without limits are written as continuous ones.
        mimic: whether some joints may follow others.
        massless: whether some links may have no inertia: carriers of others, and fixed frames.
        dampers: whether some joints may have dampers.

    Raises:
        InputError: numbers that no such tree has, or joint types that do not exist in URDF.
    """
    kinds = distinct("joints", joints)
    if "revolute" not in kinds or not URDF_JOINTS.issuperset(kinds):
        available = ", ".join(sorted(URDF_JOINTS))
        raise InputError(f"joints = {kinds!r}, expected 'revolute' and any of: {available}")
    bodies = _bodies(min_bodies, max_bodies)

    def urdf(choices: Choices) -> str:
        count = choices.whole(*bodies)
        return urdf_text(urdf_tree(count, choices, kinds, mimic, massless, dampers))

    return strategy_of(urdf)


def hostile_snakes(min_links: int = 1, max_links: int = 8) -> SearchStrategy[Snake]:
    """Return a strategy for extreme snakes: huge and tiny parameters, wheels across the link.

    All are valid. Formulations may refuse them; none may return NaN.

    Raises:
        InputError: bounds that no snake can have.
    """
    links = _checked_interval("links", whole_number, min_links, max_links)

    def snake(choices: Choices) -> Snake:
        n = choices.whole(*links)

        def optional() -> list[float] | None:
            absent = choices.one_of((True, False))
            return None if absent else [zero_or_magnitude(choices, -8, 12) for _ in range(n - 1)]

        return Snake(
            mass=[draw_magnitude(choices, -8, 8) for _ in range(n)],
            length=[draw_magnitude(choices, -8, 8) for _ in range(n)],
            inertia=[zero_or_magnitude(choices, -8, 8) for _ in range(n)],
            stiffness=optional(),
            wheel_angle=[_wheel_angle(choices) for _ in range(n)],
            damping=optional(),
        )

    return strategy_of(snake, tiny=True)


def _wheel_angle(choices: Choices) -> float:
    """Return an extreme wheel angle, rad: a zero of either sign, any, or at or next to ±π/2."""
    match choices.one_of(("zero", "any", "across")):
        case "zero":
            return choices.one_of((0.0, -0.0))
        case "any":
            return choices.number(-math.pi, math.pi)
    sign = choices.one_of((-1.0, 1.0))
    return sign * (math.pi / 2 - zero_or_magnitude(choices, -16, -1))


# ---- States --------------------------------------------------------------------------------------


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
        check_bounds(name, (0.0, bound), 0.0)
    ranges = state_ranges(scene, position, angle, speed, time)
    return strategy_of(lambda choices: ordinary_state(scene, choices, ranges))


def hostile_states(scene: Scene) -> SearchStrategy[State]:
    """Return a strategy for extreme but consistent states of `scene`.

    Stretched poses, many turns, and speeds from 1e-150 to 1e150.
    """
    return strategy_of(lambda choices: hostile_state(scene, choices), tiny=True)


@old_keywords
def scene_states(
    scenes: SearchStrategy[Scene], states_of: Callable[[Scene], SearchStrategy[State]] = states
) -> SearchStrategy[tuple[Scene, State]]:
    """Return a strategy for pairs of a scene and one of its states.

    Args:
        scenes: strategy for scenes.
        states_of: function that returns the strategy for states of a scene.
    """
    return scenes.flatmap(lambda scene: states_of(scene).map(lambda state: (scene, state)))


# ---- Bounds --------------------------------------------------------------------------------------


def _bodies(min_bodies: int, max_bodies: int) -> tuple[int, int]:
    """Return the checked smallest and largest number of bodies."""
    return _checked_interval(
        "bodies", lambda name, x: checked_links(x, name), min_bodies, max_bodies
    )


def _checked_interval(
    noun: str, check: Callable[[str, Any], int], low: int, high: int
) -> tuple[int, int]:
    """Return the smallest and the largest number of links or bodies, each passed through `check`.

    Raises:
        InputError: `check` rejects one, or there is none between them.
    """
    names = f"min_{noun}", f"max_{noun}"
    low, high = check(names[0], low), check(names[1], high)
    if low > high:
        raise InputError(f"{', '.join(names)} = {low}, {high}, expected {names[0]} <= {names[1]}")
    return low, high


def check_bounds(name: str, bounds: tuple[float, float], lowest: float) -> None:
    """Raise InputError for bounds that are not finite, not in order, or below `lowest`."""
    try:
        low, high = finite_array(name, bounds, (2,)).tolist()
    except InputError:
        low = high = math.nan  # fails the comparison, whose message names the bounds
    if not lowest <= low <= high:
        raise InputError(f"{name} = {bounds!r}, expected {lowest:g} <= low <= high, both finite")
