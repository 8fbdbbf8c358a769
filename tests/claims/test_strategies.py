"""The public hypothesis strategies: valid cases only, within the bounds asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from eomcheck import acceleration, strategies
from eomcheck.claims.numerical_accuracy import MAY_REFUSE
from eomcheck.errors import InconsistentVelocityError, InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import SCENES, Snake, TurntableBall

every_formulation = pytest.mark.parametrize("key", FORMULATIONS)

# ---- Bad bounds ----------------------------------------------------------------------------------

PARAMETERS = ["mass", "length", "inertia", "stiffness", "damping"]
makers_of_snakes = pytest.mark.parametrize(
    "maker", [strategies.snakes, strategies.hostile_snakes], ids=lambda m: m.__name__
)


@makers_of_snakes
@pytest.mark.parametrize(
    ("bounds", "says"),
    [
        ((0, 3), "min_links = 0"),
        ((-1, 3), "min_links = -1"),
        ((4, 3), "min_links, max_links = 4, 3"),
        ((2.0, 3), "min_links = 2.0"),
        ((1, 3.5), "max_links = 3.5"),
        (("1", 2), "min_links = '1'"),
    ],
)
def test_numbers_of_links_that_no_snake_has_are_refused_before_anything_is_drawn(
    maker, bounds, says
):
    with pytest.raises(InputError) as caught:
        maker(*bounds)
    assert says in str(caught.value)


@pytest.mark.parametrize("bounds", [("light", "heavy"), 3.0, (1.0,), None])
def test_bounds_that_are_no_pair_of_numbers_are_refused(bounds):
    with pytest.raises(InputError, match="mass"):
        strategies.snakes(mass=bounds)


@makers_of_snakes
def test_numbers_of_links_may_be_numpy_integers(maker):
    assert drawn(maker(np.int64(2), np.int32(2)), 1)[0].links == 2


@makers_of_snakes
def test_a_truth_value_is_no_number_of_links(maker):
    with pytest.raises(InputError, match="min_links"):
        maker(True, 3)


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize(
    "bounds", [(2.0, 1.0), (-1.0, 1.0), (1.0, math.inf), (math.nan, 1.0), (1.0, math.nan)]
)
def test_bounds_of_parameters_that_no_snake_has_are_refused_with_their_name(name, bounds):
    with pytest.raises(InputError) as caught:
        strategies.snakes(**{name: bounds})
    assert f"{name} = {bounds}" in str(caught.value)


@pytest.mark.parametrize("name", ["mass", "length"])
def test_a_mass_or_length_of_zero_is_refused(name):
    with pytest.raises(InputError, match=name):
        strategies.snakes(**{name: (0.0, 1.0)})


@pytest.mark.parametrize("bound", [-1.0, math.inf, math.nan])
def test_a_bound_of_the_wheel_angle_that_is_negative_or_not_finite_is_refused(bound):
    with pytest.raises(InputError, match="wheel_angle"):
        strategies.snakes(wheel_angle=bound)


@pytest.mark.parametrize("name", ["position", "angle", "speed"])
@pytest.mark.parametrize("bound", [-1.0, math.inf, math.nan])
def test_a_bound_of_a_state_that_is_negative_or_not_finite_is_refused(name, bound):
    with pytest.raises(InputError, match=name):
        strategies.states(Snake.coil(2), **{name: bound})


# ---- Ordinary cases ------------------------------------------------------------------------------

BOUNDS = {
    "mass": (1.0, 2.0),
    "length": (0.5, 0.5),
    "inertia": (0.0, 1.0),
    "stiffness": (3.0, 4.0),
    "damping": (0.5, 2.0),
}


@given(strategies.snakes(2, 4, **BOUNDS, wheel_angle=0.5))
def test_snakes_are_drawn_within_the_bounds(snake):
    assert type(snake) is Snake
    assert 2 <= snake.links <= 4
    for name, (low, high) in BOUNDS.items():
        value = getattr(snake, name)
        assert value is None or ((low <= value) & (value <= high)).all()
    assert (np.abs(snake.wheel_angle) <= 0.5).all()


@given(strategies.snakes())
def test_snakes_have_one_to_eight_links_unless_told_otherwise(snake):
    assert 1 <= snake.links <= 8


def drawn(strategy, count: int) -> list:
    """Return what hypothesis draws from `strategy`, the same every time."""
    found = []

    @settings(
        strategies.settings,
        max_examples=count,
        derandomize=True,
        database=None,
        phases=[Phase.generate],
    )
    @given(strategy)
    def collect(case):
        found.append(case)

    collect()
    return found


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_snakes_are_drawn_with_springs_and_dampers_and_without(name):
    snakes = drawn(strategies.snakes(2), 30)
    assert {getattr(snake, name) is None for snake in snakes} == {True, False}


def from_curved(state) -> np.ndarray:
    """Return how far each link of a snake is turned from the curved pose of `states`."""
    return state.q[2:] - strategies.CURVATURE * np.arange(1, state.q.size - 1)


@given(strategies.states(Snake.coil(3), position=2.0, angle=0.5, speed=1.5))
def test_states_are_drawn_within_the_bounds(state):
    assert (np.abs(state.q[:2]) <= 2.0).all()
    # One heading is common to all links.
    rounding = allowed_error(np.abs(state.q).max())
    assert np.ptp(from_curved(state)) <= 2 * 0.5 + rounding
    # Two components of 1.5 along orthonormal directions.
    assert np.linalg.norm(state.v) <= (1.5 + allowed_error(1.5)) * math.sqrt(2)
    assert state.t == 0.0


@given(strategies.states(TurntableBall.example(), time=0.5))
def test_times_of_a_driven_scene_are_drawn_within_the_bound(state):
    assert 0.0 <= state.t <= 0.5


@given(strategies.states(Snake.coil(2), position=0.0, angle=0.0, speed=0.0))
def test_bounds_of_zero_leave_nothing_but_the_heading(state):
    assert not state.q[:2].any()
    assert np.ptp(from_curved(state)) <= allowed_error(np.abs(state.q).max())
    assert not state.v.any()


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_scenes_of_every_kind_are_drawn_from_their_ranges(kind):
    scenes = drawn(strategies.scenes(kind, 2, 4), 20)
    assert {scene.links for scene in scenes} <= {2, 3, 4} if kind.has_links else True
    for scene in scenes:
        ranges = kind.ranges(scene.links if kind.has_links else None)
        assert ranges
        for name, one in ranges.items():
            value = getattr(scene, name)
            assert value is not None or one.optional
            if value is not None:
                assert np.shape(value) == one.shape
                assert ((one.low <= value) & (value <= one.high)).all()


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_numbers_of_links_that_a_kind_has_not_are_refused(kind):
    if kind.has_links:
        with pytest.raises(InputError, match="min_links = 0"):
            strategies.scenes(kind, 0, 3)
    else:
        assert drawn(strategies.scenes(kind), 1)
        with pytest.raises(InputError, match="no number of links"):
            next(kind.structures(3))


@given(strategies.snakes(2, 2), strategies.scenes(Snake, 2, 2))
def test_snakes_are_the_scenes_of_their_kind(snake, scene):
    assert type(snake) is type(scene) is Snake


@given(strategies.scene_states(strategies.snakes()))
def test_states_that_are_drawn_are_consistent(case):
    scene, state = case
    at = Evaluation(scene, *state)
    check_consistent(at)
    assert state.q.shape == state.v.shape == (scene.n,)


def refused_by(scene, state) -> list[str]:
    at, refusing = Evaluation(scene, *state), []
    for key, formulation in FORMULATIONS.items():
        try:
            at.acceleration(formulation)
        except RefusedError:
            refusing.append(key)
    return refusing


@pytest.mark.night
def test_ordinary_states_are_solved_by_every_formulation_but_for_a_few():
    cases = drawn(strategies.scene_states(strategies.snakes()), 100)
    assert sum(bool(refused_by(*case)) for case in cases) <= MAY_REFUSE * len(cases)


def test_scene_states_draws_the_states_of_the_scene_drawn():
    cases = drawn(strategies.scene_states(strategies.snakes()), 20)
    assert all(state.q.size == scene.n for scene, state in cases)
    assert len({scene.links for scene, _ in cases}) > 1


# ---- Variety -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def many(sized) -> int:
    return sized(1000, 500)


def assert_varied(values: np.ndarray, low: float, high: float, name: str) -> None:
    """Assert that every entry of arrays changes and comes from all thirds of [low, high]."""
    for i, entry in enumerate(values.reshape(len(values), -1).T):
        assert len(np.unique(entry)) > 20, f"{name}, entry {i}, hardly changes"
        thirds = np.histogram(entry, 3, (low, high))[0]
        assert (thirds > 0).all(), f"{name}, entry {i}: {thirds}"
        assert {np.sign(x) for x in (low, high) if x} <= set(np.sign(entry)), name


@pytest.mark.night
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_many_scenes_of_every_kind_are_varied(kind, many):
    scenes = drawn(strategies.scenes(kind, 3, 3), many)
    for name, one in kind.ranges(3 if kind.has_links else None).items():
        there = [x for scene in scenes if (x := getattr(scene, name)) is not None]
        assert (len(there) < len(scenes)) == one.optional, name
        assert_varied(np.array(there), one.low, one.high, name)


@pytest.mark.night
def test_in_many_snakes_all_links_differ(many):
    snakes = drawn(strategies.snakes(4, 4), many)
    for name in ("mass", "length", "inertia", "stiffness", "damping", "wheel_angle"):
        there = np.array([x for snake in snakes if (x := getattr(snake, name)) is not None])
        for i in range(there.shape[1]):
            for j in range(i):
                share = np.mean(there[:, i] != there[:, j])
                assert share > 0.5, f"{name} of links {i} and {j} differ in {share:.0%}"


@pytest.mark.night
def test_many_snakes_have_every_number_of_links(many):
    assert {snake.links for snake in drawn(strategies.snakes(1, 8), many)} == set(range(1, 9))


@pytest.mark.night
def test_a_thousand_states_are_varied_and_seldom_at_rest():
    states = drawn(strategies.states(Snake.coil(3)), 1000)
    q, v = (np.array([getattr(state, name) for state in states]) for name in ("q", "v"))
    assert_varied(q[:, :2], -10.0, 10.0, "position")
    assert_varied(q[:, 2:], -math.pi, math.pi, "angle")
    # Each link is turned by up to 1 rad to either side.
    bends = np.diff([from_curved(state) for state in states])
    assert bends.min() < -1.5 and bends.max() > 1.5
    assert_varied(v, -3.0, 3.0, "velocity")
    assert np.mean(v.any(axis=1)) > 0.75
    assert {state.t for state in states} == {0.0}


@pytest.mark.night
def test_symmetries_move_most_of_what_is_drawn():
    cases = drawn(strategies.scene_states(strategies.snakes(2, 4)), 200)
    moved: dict[str, list[bool]] = {}
    for scene, (q, v, _) in cases:
        for one in scene.symmetries(q, v):
            away = np.abs(one.q - q).max() > 1e-3 or repr(one.scene) != repr(scene)
            moved.setdefault(one.name, []).append(away)
    assert moved
    for name, each in moved.items():
        assert np.mean(each) > 0.75, name


@pytest.mark.night
def test_many_hostile_snakes_are_of_all_magnitudes_and_wheels_of_all_kinds(many):
    snakes = drawn(strategies.hostile_snakes(2, 2), many)
    for name in ("mass", "length"):
        decades = np.log10([getattr(snake, name) for snake in snakes])
        assert_varied(decades, -8.0, 8.0, name)
    for name, high in (("inertia", 8.0), ("stiffness", 12.0), ("damping", 12.0)):
        there = [x for snake in snakes if (x := getattr(snake, name)) is not None]
        assert (len(there) < many) == (name != "inertia")
        entries = np.array(there).ravel()
        assert (entries == 0).any()
        assert_varied(np.log10(entries[entries > 0]), -8.0, high, name)
    wheels = np.array([snake.wheel_angle for snake in snakes]).ravel()
    from_across = np.abs(np.abs(wheels) - math.pi / 2)
    assert {bool(x) for x in np.signbit(wheels[wheels == 0])} == {True, False}
    for side in (wheels > 0, wheels < 0):
        assert (from_across[side] == 0).any()
        assert ((from_across > 0) & (from_across < 1e-8))[side].any()
        assert ((from_across > 1e-8) & (from_across < 0.1))[side].any()
        assert (from_across[side] > 0.5).any()


@pytest.mark.night
def test_many_hostile_states_are_straight_and_bent_slow_and_fast(many):
    states = drawn(strategies.hostile_states(Snake.coil(3)), many)
    straight = np.array([np.ptp(state.q[2:]) == 0 for state in states])
    assert 0.1 < straight.mean() < 0.9
    assert_varied(np.array([s.q[2] for s in states])[straight], -math.pi, math.pi, "angle")
    assert max(np.abs(state.q).max() for state in states) > 1e8
    speed = np.array([np.abs(state.v).max() for state in states])
    assert (speed == 0).any() and (speed[speed > 0] < 1e-100).any() and (speed > 1e100).any()


# ---- Hostile cases -------------------------------------------------------------------------------


@given(strategies.hostile_snakes(2, 3))
def test_hostile_snakes_are_valid_and_within_the_bounds(snake):
    assert 2 <= snake.links <= 3
    assert (snake.mass > 0).all()
    assert (snake.length > 0).all()
    assert (snake.inertia >= 0).all()


hostile = strategies.scene_states(strategies.hostile_snakes(), strategies.hostile_states)


@pytest.mark.sampled(3)
@every_formulation
@given(hostile)
def test_hostile_states_are_solved_or_refused_and_never_answered_with_nan(key, case):
    scene, (q, v, t) = case
    try:
        result = acceleration(scene, key, q, v, t)
    except (RefusedError, InconsistentVelocityError):
        return
    assert np.isfinite(result.vdot).all()
    assert not np.isnan(result.error_bound)
    assert result.multipliers is None or not np.isnan(result.multipliers).any()
    assert all(np.isfinite(rcond) for rcond in result.rcond.values())


@pytest.mark.sampled(3)
@every_formulation
@given(strategies.scene_states(strategies.snakes(max_links=3), strategies.hostile_states))
def test_hostile_states_of_ordinary_snakes_are_solved_or_refused(key, case):
    scene, (q, v, t) = case
    try:
        result = acceleration(scene, key, q, v, t, consistent=False)
    except RefusedError:
        return
    assert np.isfinite(result.vdot).all()
    assert not np.isnan(result.error_bound)
    assert result.multipliers is None or not np.isnan(result.multipliers).any()
