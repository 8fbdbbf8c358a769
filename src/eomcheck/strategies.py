"""hypothesis strategies: scenes of every kind, consistent states, and hostile ones.

They describe what is valid, not how it is distributed, and refuse bad bounds when they are called,
not when they are drawn from::

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
from typing import Any, NamedTuple, TypeVar

import numpy as np
from hypothesis import HealthCheck, reject
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from scipy.linalg import null_space

from eomcheck.errors import InputError, RefusedError, distinct, whole_number
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import closed_position, consistent_velocity
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.scenes import Snake
from eomcheck.scenes.random.kinds import RandomMechanism, RandomTree, checked_links
from eomcheck.scenes.random.urdf import EVERYWHERE, URDF_JOINTS, urdf_text, urdf_tree

S = TypeVar("S", bound=Scene)
T = TypeVar("T")

settings = hypothesis_settings(
    deadline=None,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
        HealthCheck.filter_too_much,
    ],
)
"""What a test needs whose cases are drawn here, as a decorator or the first argument of
`hypothesis.settings`: the first case loads engines, which takes longer than hypothesis allows for
one, and a case is closed and made consistent while it is drawn."""

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


def without_tiny(x: float) -> float:
    """Return x, or 0 for what is negligible."""
    return x if abs(x) >= NEGLIGIBLE else 0.0


def _vector(entries: SearchStrategy[float], size: int) -> SearchStrategy[list[float]]:
    return st.lists(entries, min_size=size, max_size=size)


def _links(min_links: int, max_links: int) -> SearchStrategy[int]:
    low, high = whole_number("min_links", min_links), whole_number("max_links", max_links)
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
    _interval("mass", mass, smallest)
    _interval("length", length, smallest)
    _interval("inertia", inertia, 0.0)
    _interval("stiffness", stiffness, 0.0)
    _interval("damping", damping, 0.0)
    _interval("wheel_angle", (0.0, wheel_angle), 0.0)
    bounds = {
        "mass": mass,
        "length": length,
        "inertia": inertia,
        "stiffness": stiffness,
        "damping": damping,
        "wheel_angle": (-wheel_angle, wheel_angle),
    }

    def build(n: int) -> SearchStrategy[Snake]:
        ranges = Snake.ranges(n)
        for name, (low, high) in bounds.items():
            ranges[name] = ranges[name]._replace(low=low, high=high)
        return _from_ranges(Snake, ranges)

    return links.flatmap(build)


def scenes(kind: type[S], min_links: int = 1, max_links: int = 8) -> SearchStrategy[S]:
    """Return a strategy for scenes of a kind, drawn from its `ranges`.

    Args:
        kind: the kind of scene.
        min_links: smallest number of links, for a kind that has one.
        max_links: largest number of links.

    Raises:
        InputError: numbers of links that no such scene can have.
    """
    links = _links(min_links, max_links) if kind.has_links else st.none()
    return links.flatmap(lambda n: _topologies(kind, n).flatmap(lambda one: _of_kind(one, n)))


def _of_kind(kind: type[S], links: int | None) -> SearchStrategy[S]:
    return _from_ranges(kind, kind.ranges(links))


@cache
def _number(low: float, high: float) -> SearchStrategy[float]:
    return _entry(Range(low, high))


class _Choices:
    """Choices by hypothesis, which shrinks them."""

    def __init__(self, draw: Any):
        self._draw = draw

    def one_of(self, among: Sequence[T]) -> T:
        return self._draw(st.sampled_from(among))

    def whole(self, low: int, high: int) -> int:
        return self._draw(st.integers(low, high))

    def number(self, low: float, high: float) -> float:
        return self._draw(_number(low, high))


@st.composite
def _topologies(draw: Any, kind: type[Scene], links: int | None) -> Any:
    """Return a strategy for kinds whose scenes hang together in one way each."""
    choices = _Choices(draw)
    entry = choices.one_of(kind.topologies(links))
    ways = {name: choices.one_of(of) for name, of in entry.items()}
    try:
        return kind.of_topology(links, ways, choices)
    except RefusedError:
        reject()


def random_trees(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomTree]:
    """Return a strategy for trees of rigid bodies, each of which hangs together in another way.

    In the plane or in space, with joints of all kinds, axes, placements and inertias of any
    direction, massless carriers, springs, dampers, rotors, joints that follow others, and gravity,
    or without; closed by nothing. The scene's `made.description` is what it was made of.

    Args:
        min_bodies: smallest number of links, the ground not counted.
        max_bodies: largest number of links.

    Raises:
        InputError: numbers that no such tree has.
    """
    _bodies(min_bodies, max_bodies)
    return scenes(RandomTree, min_bodies, max_bodies)


def random_mechanisms(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomMechanism]:
    """Return a strategy for such trees with constraints whose rows are independent.

    Pins, welds, hinges, rods and points on planes, which make loops; couplings; knife edges; and
    joints that a clock drives. For arguments and errors see `random_trees`.
    """
    _bodies(min_bodies, max_bodies)
    return scenes(RandomMechanism, min_bodies, max_bodies)


def urdfs(
    min_bodies: int = 1,
    max_bodies: int = 8,
    *,
    joints: Iterable[str] = EVERYWHERE,
    mimic: bool = True,
    massless: bool = True,
    dampers: bool = True,
) -> SearchStrategy[str]:
    """Return a strategy for texts of URDFs: random trees in space, joints in any order.

    Each is read by `eomcheck.scenes.from_urdf`, and should be by any other parser.

    Args:
        min_bodies: smallest number of links, the root not counted.
        max_bodies: largest number of links.
        joints: kinds that there may be: "revolute", and any of "prismatic", "fixed", "planar",
            "floating". Where revolute joints have no limits they are written as continuous ones.
        mimic: whether some joints may follow others.
        massless: whether some links may have no inertia: carriers of others, and fixed frames.
        dampers: whether some joints may have dampers.

    Raises:
        InputError: numbers that no such tree has, or kinds of joints that a URDF has not.
    """
    kinds = distinct("joints", joints)
    if "revolute" not in kinds or not URDF_JOINTS.issuperset(kinds):
        known = ", ".join(sorted(URDF_JOINTS))
        raise InputError(f"joints = {kinds!r}, expected 'revolute' and any of: {known}")
    return _bodies(min_bodies, max_bodies).flatmap(
        lambda links: _urdf(links, kinds, mimic, massless, dampers)
    )


@st.composite
def _urdf(draw: Any, links: int, *options: Any) -> str:
    return urdf_text(urdf_tree(links, _Choices(draw), *options))


def _bodies(min_bodies: int, max_bodies: int) -> SearchStrategy[int]:
    low, high = (
        checked_links(value, name)
        for name, value in (("min_bodies", min_bodies), ("max_bodies", max_bodies))
    )
    if low > high:
        said = f"min_bodies, max_bodies = {low}, {high}"
        raise InputError(f"{said}, expected min_bodies <= max_bodies")
    return st.integers(low, high)


def _from_ranges(kind: type[S], ranges: dict[str, Range]) -> SearchStrategy[S]:
    return st.builds(kind, **{name: _parameter(one) for name, one in ranges.items()})


def _parameter(one: Range) -> SearchStrategy:
    """Return a strategy for a number or nested lists of numbers; for None as well if optional."""
    values: SearchStrategy = _entry(one)
    for size in reversed(one.shape):
        values = _vector(values, size)
    return st.none() | values | values if one.optional else values


def _entry(one: Range) -> SearchStrategy[float]:
    numbers = st.floats(one.low, one.high)
    return numbers.map(without_tiny) if one.low < 0.0 < one.high else numbers


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
    speeds need exist. Coordinates are drawn from the scene's `coordinate_ranges`. If it gives none,
    angles are drawn around a curved pose with any heading: equal draws, which hypothesis is fond
    of, then are no stretched pose, where El and Em have to refuse (`hostile_states` has those).

    Args:
        scene: the scene.
        position: largest coordinate that is not an angle, if the scene gives no ranges.
        angle: largest distance of an angle from the curved pose, rad, likewise.
        speed: largest component of v along a basis vector.
        time: latest time, s, where the scene depends on time.

    Raises:
        InputError: negative or infinite bounds.
    """
    for name, bound in (("position", position), ("angle", angle), ("speed", speed), ("time", time)):
        _interval(name, (0.0, bound), 0.0)
    coordinates, *rest = state_ranges(scene, position, angle, speed, time)
    among = st.tuples(*map(_entry, coordinates)), *map(_parameter, rest)
    return st.tuples(*among).map(_case(ordinary_state, scene))


class StateRanges(NamedTuple):
    """What the numbers are drawn from that make an ordinary state."""

    coordinates: tuple[Range, ...]
    """q, those that are angles from the curved pose if the scene gives no ranges."""
    heading: Range
    """By which all angles turn, rad; none if the scene gives ranges of its own."""
    components: Range
    """Of v (p,) along an orthonormal basis of the null space of a."""
    time: Range
    """s."""


def state_ranges(
    scene: Scene,
    position: float = 10.0,
    angle: float = 1.0,
    speed: float = 5.0,
    time: float = 10.0,
) -> StateRanges:
    """Return what ordinary states of `scene` are drawn from; for arguments see `states`."""
    own = scene.coordinate_ranges()
    usual = Range(-position, position), Range(-angle, angle)
    heading = math.pi if own is None else 0.0
    return StateRanges(
        own or tuple(usual[flag] for flag in angles_of(scene)),
        Range(-heading, heading),
        Range(-speed, speed, (scene.p,)),
        Range(0.0, time if scene.depends_on_time else 0.0),
    )


def angles_of(scene: Scene) -> list[bool]:
    """Return which coordinates are angles (n,)."""
    flags = [False] * scene.n
    flags[scene.angle_coordinates] = [True] * len(flags[scene.angle_coordinates])
    return flags


def ordinary_state(scene: Scene, coordinates, heading: float, components, t: float) -> State:
    """Return the consistent state of `scene` that these numbers make, see `StateRanges`.

    Raises:
        RefusedError: no position near the coordinates is closed.
    """
    q = np.array(coordinates)
    if scene.coordinate_ranges() is None:
        flags = np.array(angles_of(scene))
        q = q + (CURVATURE * np.cumsum(flags) + heading) * flags
    return _consistent_state(scene, q, components, t)


def _consistent_state(scene: Scene, q, components, t: float) -> State:
    q = closed_position(scene, q, t)
    components, at = np.array(components), Evaluation(scene, q, np.zeros(scene.n), t)
    if at.terms.a is None:
        return State(q, components, t)
    basis = null_space(at.terms.a)[:, : components.size]
    return State(q, consistent_velocity(at, basis @ components[: basis.shape[1]]), t)


def _case(make: Callable[..., State], scene: Scene) -> Callable[[Sequence], State]:
    """Return what makes a state of numbers; of those near which none is closed, no case."""

    def made(numbers: Sequence) -> State:
        try:
            return make(scene, *numbers)
        except RefusedError:
            reject()

    return made


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
    numbers = st.tuples(straight | anywhere, components, st.just(0.0))
    return numbers.map(_case(_consistent_state, scene))
