"""The public way to accelerations: what it refuses, what it says of itself, that it is right."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.exact import ExactFloats, RandomFractions

from eomcheck import acceleration, check_state, enclose, simulate, speeds_of, strategies, velocity
from eomcheck.claims.registry import GenericPoint
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, coupling
from eomcheck.errors import (
    InconsistentVelocityError,
    InputError,
    RefusedError,
    UnknownNameError,
)
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import BatchEvaluation, Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity, check_consistent, sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.numbers import banded_solve, linear
from eomcheck.scenes import Bicycle, FourBarChain, Snake
from eomcheck.strategies import NEGLIGIBLE

IN_SPEEDS = [f.key for f in FORMULATIONS.values() if f.in_speeds]
IN_VELOCITIES = [key for key in FORMULATIONS if key not in IN_SPEEDS]
PARTITIONED = [f.key for f in FORMULATIONS.values() if f.partitioned]
UNPARTITIONED = [f.key for f in FORMULATIONS.values() if not f.partitioned]
SOLVED_ANYWHERE = [key for key in IN_VELOCITIES if key not in PARTITIONED]

SNAKE = Snake([1.0, 2.0, 0.5], [1.0, 0.5, 2.0], [0.1, 0.2, 0.3], [4.0, 2.0], [0.125, -0.5, 1.0])
Q = np.array([0.5, -0.25, 0.375, 1.25, -0.625])
V = velocity(SNAKE, Q, [1.5, -0.75])

every_formulation = pytest.mark.parametrize("key", FORMULATIONS)
pairs = pytest.mark.parametrize(("f", "g"), list(combinations(FORMULATIONS, 2)))


Trains = mechanism(
    "Trains",
    [Link("ground"), *(Link(name, 1.0) for name in "abcd")],
    [Joint(f"x_{name}", "prismatic", "ground", name, axis=(1.0, 0.0, 0.0)) for name in "abcd"],
    [coupling("fast", "x_a", "x_b", 1.0), coupling("slow", "x_c", "x_d", 1.0)],
)
"""Two pairs of bodies, each as fast as the other."""


def test_the_row_that_is_violated_is_named_and_not_a_larger_residual_that_rounding_explains():
    fast = 1e12
    v = [fast, np.nextafter(fast, np.inf), 1.0, 1.0 + 1e-5]
    with pytest.raises(InconsistentVelocityError) as raised:
        check_consistent(Evaluation(Trains(), np.zeros(4), v))
    assert "the constraint of slow: |a v + b| = 1e-05 m/s, allowed " in str(raised.value)
    with pytest.raises(InconsistentVelocityError, match="the constraint of fast"):
        check_consistent(Evaluation(Trains(), np.zeros(4), [fast, 1.1 * fast, *v[2:]]))


def test_in_other_coordinates_the_matrices_of_those_are_solved():
    au = FORMULATIONS["au"]
    maps = np.eye(5), np.eye(5) - np.diag([0.0, 0.0, 0.9, 0.9], -1)
    at = Evaluation(SNAKE, Q, V)
    one, other = (at.acceleration_in(au, T) for T in maps)
    assert other.rcond == Evaluation(SNAKE, Q, V).acceleration_in(au, maps[1]).rcond != one.rcond
    assert_agree(at.acceleration(au), other)


def assert_agree(first, second):
    allowed = first.error_bound + second.error_bound
    assert np.abs(first.vdot - second.vdot).max() <= allowed


# ---- Input ---------------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@every_formulation
@pytest.mark.parametrize("name", ["q", "v"])
@pytest.mark.parametrize("value", [np.zeros(4), np.zeros(6), np.zeros((5, 1)), 0.0, []])
def test_a_state_of_wrong_shape_is_refused_with_its_name_and_both_shapes(key, name, value):
    with pytest.raises(InputError) as caught:
        acceleration(SNAKE, key, **({"q": Q, "v": V} | {name: value}))
    for part in (f"{name} has shape", str(np.shape(value)), "(5,)"):
        assert part in str(caught.value)


@pytest.mark.sampled(4)
@every_formulation
@pytest.mark.parametrize("name", ["q", "v"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_state_that_is_not_finite_is_refused_with_its_place_and_value(key, name, value):
    state = {"q": Q.copy(), "v": V.copy()}
    state[name][3] = value
    with pytest.raises(InputError) as caught:
        acceleration(SNAKE, key, **state)
    assert f"{name}[3] = {value}" in str(caught.value)


@pytest.mark.sampled(4)
@every_formulation
@pytest.mark.parametrize("name", ["q", "v"])
@pytest.mark.parametrize("value", [["a"] * 5, None, [[1.0], 2.0, 3.0, 4.0, 5.0], [1j] * 5])
def test_a_state_that_is_no_array_of_numbers_is_refused_with_its_name(key, name, value):
    with pytest.raises(InputError, match=name):
        acceleration(SNAKE, key, **({"q": Q, "v": V} | {name: value}))


@pytest.mark.parametrize("q", [Q + 1j, [10**400] * 5], ids=["complex", "too large"])
def test_an_array_that_doubles_cannot_hold_is_no_state(q):
    with pytest.raises(InputError, match="q"):
        acceleration(SNAKE, "au", q, V)


@pytest.mark.parametrize("t", [np.nan, np.inf, "now", [0.0], None])
def test_a_time_that_is_no_finite_number_is_refused(t):
    with pytest.raises(InputError, match="t"):
        acceleration(SNAKE, "au", Q, V, t)


@pytest.mark.parametrize("key", ["newton", "AU", "", None, 3])
def test_an_unknown_formulation_is_refused_with_all_that_are_known(key):
    with pytest.raises(UnknownNameError) as caught:
        acceleration(SNAKE, key, Q, V)
    assert repr(key) in str(caught.value)
    assert all(known in str(caught.value) for known in FORMULATIONS)


@every_formulation
def test_a_velocity_that_slides_a_wheel_sideways_is_refused_with_the_wheel(key):
    at = Evaluation(SNAKE, Q, V)
    sideways = np.linalg.lstsq(at.terms.a, [0.0, 1.0, 0.0])[0]
    with pytest.raises(InconsistentVelocityError, match="wheel 2"):
        acceleration(SNAKE, key, Q, V + 1e-9 * sideways)


@every_formulation
def test_a_velocity_that_slides_a_wheel_sideways_is_let_pass_on_request(key):
    v = V + 1e-3
    result = acceleration(SNAKE, key, Q, v, consistent=False)
    assert np.isfinite(result.vdot).all()


@pytest.mark.parametrize("key", IN_VELOCITIES)
def test_an_inconsistent_velocity_still_has_one_acceleration_without_generalized_speeds(key):
    v = V + 1e-3
    assert_agree(
        acceleration(SNAKE, key, Q, v, consistent=False),
        acceleration(SNAKE, "au", Q, v, consistent=False),
    )


@pytest.mark.parametrize("key", UNPARTITIONED)
def test_a_pivoted_partition_is_refused_where_there_is_no_partition(key):
    with pytest.raises(InputError, match=f"pivoted.*{key}"):
        acceleration(SNAKE, key, Q, V, pivoted=True)


@every_formulation
def test_the_state_handed_in_is_not_changed(key):
    q, v = Q.copy(), V.copy()
    acceleration(SNAKE, key, q, v)
    assert np.array_equal(q, Q)
    assert np.array_equal(v, V)


@every_formulation
def test_a_state_may_be_lists_integers_or_a_strided_view(key):
    expected = acceleration(SNAKE, key, Q, V)
    strided = np.repeat(Q, 2)[::2]
    for q, v in ((Q.tolist(), V.tolist()), (strided, V)):
        assert np.array_equal(acceleration(SNAKE, key, q, v).vdot, expected.vdot)
    assert acceleration(SNAKE, key, [0, 0, 0, 1, 2], [0] * 5).vdot.shape == (5,)


# ---- Refusals ------------------------------------------------------------------------------------


def test_a_wheel_across_its_link_is_refused_by_the_formulations_in_speeds():
    snake = Snake([1.0] * 4, [1.0] * 4, [0.1] * 4, [1.0] * 3, [0.1, 0.2, np.pi / 2, 0.3])
    q = np.array([0.0, 0.0, 0.3, -0.4, 1.0, 2.0])
    at = Evaluation(snake, q, np.zeros(6))
    v = consistent_velocity(at, np.array([1.0, -2.0, 0.5, 0.7, -0.3, 0.9]))
    for key in IN_SPEEDS:
        with pytest.raises(RefusedError, match=r"wheel_angle\[2\]") as caught:
            acceleration(snake, key, q, v)
        assert caught.value.what == "cos α"
        assert caught.value.rcond <= caught.value.threshold
    with pytest.raises(RefusedError, match=r"wheel_angle\[2\]"):
        velocity(snake, q, [1.0, 1.0])
    results = [acceleration(snake, key, q, v) for key in IN_VELOCITIES]
    for first, second in combinations(results, 2):
        assert_agree(first, second)
    assert max(result.error_bound for result in results) < 1e-6


def stretched(links: int) -> tuple[Snake, np.ndarray, np.ndarray]:
    one = np.ones(links)
    snake = Snake(one, one, 0.1 * one, one[1:], 0 * one)
    q = np.array([0.5, -0.5, *[0.3] * links])
    return snake, q, velocity(snake, q, [1.0, 0.5] if links == 1 else [1.0, 0.0])


def parallel_wheels() -> tuple[Snake, np.ndarray, np.ndarray]:
    snake = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], [3.0], [0.25, 0.0])
    q = np.array([0.0, 0.0, 0.5, 0.75])
    return snake, q, velocity(snake, q, [1.0, 0.5])


def rolling_along_x() -> tuple[Snake, np.ndarray, np.ndarray]:
    snake = Snake([1.0], [1.0], [0.1], None, [0.0])
    q = np.zeros(3)
    return snake, q, velocity(snake, q, [1.0, 0.5])


SINGULAR = {
    "stretched, N = 2": stretched(2),
    "stretched, N = 3": stretched(3),
    "stretched, N = 7": stretched(7),
    "N = 2, parallel wheels": parallel_wheels(),
    "N = 1, rolling along x": rolling_along_x(),
}
singular_for_the_papers_partition = pytest.mark.parametrize(
    "case", SINGULAR.values(), ids=SINGULAR.keys()
)


@singular_for_the_papers_partition
@pytest.mark.parametrize("key", PARTITIONED)
def test_singular_first_columns_are_refused_with_name_rcond_and_threshold(case, key):
    with pytest.raises(RefusedError) as caught:
        acceleration(case[0], key, *case[1:])
    refusal = caught.value
    # The first matrix that El and Em solve is made of the first r columns of a.
    assert refusal.what == next(iter(acceleration(SNAKE, key, Q, V).rcond))
    assert 0 <= refusal.rcond <= refusal.threshold < 1e-14
    assert refusal.matrix is not None
    assert refusal.matrix.shape == (case[0].r, case[0].r)
    for part in (refusal.what, f"{refusal.rcond:.2g}", f"{refusal.threshold:.2g}"):
        assert part in str(refusal)


@singular_for_the_papers_partition
@pytest.mark.parametrize("key", PARTITIONED)
def test_where_the_first_columns_are_singular_a_pivoted_partition_solves(case, key):
    pivoted = acceleration(case[0], key, *case[1:], pivoted=True)
    assert_agree(pivoted, acceleration(case[0], "au", *case[1:]))
    assert pivoted.error_bound < 1e-9 * max(1.0, np.abs(pivoted.vdot).max())


@singular_for_the_papers_partition
@pytest.mark.parametrize("key", UNPARTITIONED)
def test_where_the_first_columns_are_singular_the_others_solve(case, key):
    result = acceleration(case[0], key, *case[1:])
    assert_agree(result, acceleration(case[0], "au", *case[1:]))
    assert result.error_bound < 1e-9 * max(1.0, np.abs(result.vdot).max())


@pytest.mark.parametrize("key", PARTITIONED)
@pytest.mark.parametrize("exponent", range(1, 18))
def test_near_parallel_wheels_are_refused_or_their_error_bound_tells(key, exponent):
    snake = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], [3.0], [0.25, 0.0])
    q = np.array([0.0, 0.0, 0.5, 0.75 + 10.0**-exponent])
    v = velocity(snake, q, [1.0, 0.5])
    try:
        result = acceleration(snake, key, q, v)
    except RefusedError as refusal:
        singular = np.linalg.svd(refusal.matrix, compute_uv=False)
        assert singular[-1] / singular[0] / singular.size <= refusal.threshold
    else:
        assert_agree(result, acceleration(snake, "au", q, v))


@pytest.mark.sampled(4)
@every_formulation
@pytest.mark.parametrize("speed", [1e160, 1e200, 1e300])
@pytest.mark.parametrize("consistent", [True, False])
def test_an_acceleration_that_overflows_is_refused(key, speed, consistent):
    v = velocity(SNAKE, Q, [speed, speed])
    with pytest.raises(RefusedError, match="overflow"):
        acceleration(SNAKE, key, Q, v, consistent=consistent)


@every_formulation
def test_a_velocity_near_the_largest_double_is_refused(key):
    v = np.full(5, 1e308)
    with pytest.raises((RefusedError, InconsistentVelocityError)):
        acceleration(SNAKE, key, Q, v)


def test_a_velocity_that_overflows_is_refused():
    with pytest.raises(RefusedError, match="overflow"):
        velocity(SNAKE, Q, [1e308, 1e308])


# ---- Results -------------------------------------------------------------------------------------


@every_formulation
def test_a_result_has_the_shapes_and_the_multipliers_that_the_formulation_says(key):
    result = acceleration(SNAKE, key, Q, V)
    assert result.vdot.shape == (SNAKE.n,)
    assert result.vdot.dtype == np.float64
    if FORMULATIONS[key].multipliers:
        assert result.multipliers.shape == (SNAKE.r,)
    else:
        assert result.multipliers is None
    assert 0 < result.error_bound < 1e-9


@every_formulation
def test_the_condition_of_every_matrix_solved_is_recorded_under_its_name(key, monkeypatch):
    solved_exactly = []

    def recorded(eliminate):
        def recording(A, b, name):
            solved_exactly.append(name)
            return eliminate(A, b, name)

        return recording

    monkeypatch.setattr(linear, "eliminate", recorded(linear.eliminate))
    monkeypatch.setattr(banded_solve, "eliminate_banded", recorded(banded_solve.eliminate_banded))
    GenericPoint(SNAKE, RandomFractions(0)).solution(FORMULATIONS[key])
    rcond = acceleration(SNAKE, key, Q, V).rcond
    assert list(rcond) == solved_exactly
    assert all(0 < value <= 1 for value in rcond.values())


@pytest.mark.parametrize(("key", "own"), [("kane", "M_Kane"), ("ml", "M_ML"), ("au", "M_Au")])
def test_the_condition_of_speeds_by_a_partition_is_recorded_where_they_are_solved_for(key, own):
    scene = FourBarChain.example()
    state = State(*scene.initial_state())
    alone = Evaluation(scene, *state)
    expected = {own} if key == "au" else {"a_1", own}
    rcond = alone.acceleration(FORMULATIONS[key]).rcond
    assert set(rcond) == expected
    lanes = BatchEvaluation([scene, scene], [state, state])
    beside = lanes.acceleration(FORMULATIONS[key]).rcond
    assert set(beside) == expected
    if key != "au":
        solved = alone.acceleration(FORMULATIONS["em"]).rcond["a_1"]
        assert rcond["a_1"] == pytest.approx(solved)
        assert beside["a_1"] == pytest.approx(solved)


@every_formulation
def test_the_same_state_gives_the_same_bits_every_time(key):
    first, second = (acceleration(SNAKE, key, Q, V) for _ in range(2))
    assert np.array_equal(first.vdot, second.vdot)
    assert first.error_bound == second.error_bound
    assert first.rcond == second.rcond


@pytest.mark.sampled(5)
@every_formulation
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.5, np.pi, -1.2])
@pytest.mark.parametrize("alpha", [0.0, 0.4, np.pi / 2])
def test_a_single_link_turns_at_a_constant_rate_and_its_wheel_takes_the_centrifugal_force(
    key, angle, alpha
):
    m, L, s, omega = 2.0, 3.0, 1.5, 0.5
    snake = Snake([m], [L], [0.7], None, [alpha])
    q = np.array([0.3, -0.8, angle])
    v = velocity(snake, q, [s, omega])
    try:
        result = acceleration(snake, key, q, v)
    except RefusedError:
        assert key in PARTITIONED
        assert abs(np.sin(alpha + angle)) < 1e-15
        return
    axle = np.array([np.sin(alpha + angle), -np.cos(alpha + angle)])
    link = np.array([np.cos(angle), np.sin(angle)])
    expected = [*(-s * omega * axle + L / 2 * omega**2 * link), 0.0]
    rounding = allowed_error(m * (s * omega + L * omega**2))
    assert np.abs(result.vdot - expected).max() <= result.error_bound + rounding
    if result.multipliers is not None:
        at = Evaluation(snake, q, v)
        spread = acceleration_sensitivity(at, FORMULATIONS[key], "multipliers")
        allowed = allowed_error(spread) + rounding
        assert abs(result.multipliers[0] + m * s * omega) <= allowed


# ---- The error bound -----------------------------------------------------------------------------


def solved(scene, state, key):
    try:
        return acceleration(scene, key, state.q, state.v)
    except RefusedError:
        return None


@pytest.mark.night
@settings(max_examples=25)
@given(strategies.scene_states(strategies.snakes()))
def test_two_formulations_differ_by_no_more_than_their_error_bounds(case):
    results = [solved(*case, key) for key in FORMULATIONS]
    for first, second in combinations([r for r in results if r is not None], 2):
        assert_agree(first, second)


@pytest.mark.night
@given(strategies.scene_states(strategies.snakes(max_links=3)))
def test_no_formulation_is_further_from_the_exact_acceleration_than_its_error_bound(case):
    """The doubles of the state, taken for the fractions that they are, solved without rounding."""
    scene, (q, v, _) = case
    exact = ExactFloats()
    parameters, q, v = scene.parameters(exact), exact.numbers(q), exact.numbers(v)
    terms = scene.terms(parameters, scene.prepare(exact, parameters, q, 0), q, v)
    F = -terms.B if terms.Q is None else terms.Q - terms.B
    truth, _ = FORMULATIONS["au"].solution(terms.M, F, terms.a, terms.gamma, None, None)
    for key in FORMULATIONS:
        result = solved(*case, key)
        if result is not None:
            error = np.abs(exact.numbers(result.vdot) - truth).max()
            assert error <= result.error_bound, key


@given(strategies.scene_states(strategies.snakes(max_links=5)))
def test_a_pivoted_partition_agrees_with_the_papers_within_the_error_bounds(case):
    scene, (q, v, _) = case
    for key in PARTITIONED:
        first = solved(*case, key)
        if first is not None:
            assert_agree(first, acceleration(scene, key, q, v, pivoted=True))


@given(strategies.scene_states(strategies.snakes(max_links=5, wheel_angle=1.2)))
def test_the_error_bound_of_an_ordinary_state_is_small_for_some_formulation(case):
    results = [solved(*case, key) for key in SOLVED_ANYWHERE]
    bounds = [r.error_bound / max(np.abs(r.vdot).max(), 1.0) for r in results if r is not None]
    assert min(bounds) < 1e-6


# ---- Velocities and speeds -----------------------------------------------------------------------


speeds = st.tuples(*[st.floats(-5, 5).map(lambda x: x if abs(x) >= NEGLIGIBLE else 0.0)] * 2)


def velocity_error(scene, q, v) -> float:
    """Return what rounding may do to v = W u, and to the projection that restores constraints.

    The projection is orthogonal: it moves v by no more than v was off, in the 2-norm.
    """
    at = Evaluation(scene, q, v)
    return (1 + scene.n**0.5) * allowed_error(sensitivity_of(at, lambda e: e.velocity))


@given(strategies.scene_states(strategies.snakes(max_links=5)))
def test_the_speeds_of_a_consistent_velocity_give_it_back(case):
    scene, (q, v, _) = case
    back = velocity(scene, q, speeds_of(scene, q, v))
    assert np.abs(back - v).max() <= velocity_error(scene, q, v)


@given(
    strategies.scene_states(strategies.snakes(max_links=5)),
    speeds,
)
def test_the_velocity_of_given_speeds_has_those_speeds(case, u):
    scene, (q, _, _) = case
    v = velocity(scene, q, u)
    sensitivity = 2 + scene.length[0] / 2
    assert np.abs(speeds_of(scene, q, v) - u).max() <= sensitivity * velocity_error(scene, q, v)


@given(strategies.scene_states(strategies.snakes()), speeds)
def test_the_velocity_of_any_speeds_is_consistent(case, u):
    scene, (q, _, _) = case
    v = velocity(scene, q, u)
    assert acceleration(scene, "au", q, v).vdot.shape == (scene.n,)


ACROSS = np.pi / 2
AMPLIFYING = {
    "three wheels across, to 1e-11": (
        [1.8, 0.8, 0.8, 1.2],
        [ACROSS + 1e-11, 0.6, ACROSS + 1e-11, ACROSS + 5e-4],
        ([0.5, 0.0, 2.9, -0.8, -0.4, 0.1], [-0.9, -1.0]),
    ),
    "three wheels across, to 2e-12": (
        [1.0, 0.6, 0.9, 1.7],
        [ACROSS + 2e-4, ACROSS + 1e-6, 1.5707963267968965, -1.4],
        ([1.6, -0.1, -1.4, -1.1, -2.9, -0.6], [0.5, 1.0]),
    ),
    "two wheels across, to 5e-15": (
        [0.6, 1.3, 0.7, 1.5],
        [1.4, ACROSS + 1e-6, 1.5707963267949017, 1.0],
        ([-1.4, -2.4, 2.2, 2.4, -1.2, 2.5], [-0.4, -0.7]),
    ),
}
"""Lengths, wheel angles, q and u. Velocities grow from link to link by up to 1e14: the smallest
correction that made all rows consistent left some violated."""


@pytest.mark.parametrize("case", AMPLIFYING.values(), ids=AMPLIFYING)
def test_a_velocity_that_velocity_returns_is_taken_by_acceleration(case):
    length, wheel_angle, (q, u) = case
    one = np.ones(len(length))
    scene = Snake(one, length, one, None, wheel_angle)
    v = velocity(scene, q, u)
    check_consistent(Evaluation(scene, q, v))
    found = enclose(scene, "au", q, v=v, digits=20).doubles()
    for key in FORMULATIONS:
        try:
            result = acceleration(scene, key, q, v)
        except InconsistentVelocityError:
            raise
        except RefusedError:
            continue
        assert np.abs(result.vdot - found).max() <= result.error_bound


@settings(max_examples=50)
@given(strategies.scene_states(strategies.hostile_snakes(), strategies.hostile_states), speeds)
def test_velocity_returns_nothing_that_acceleration_refuses(case, u):
    scene, (q, _, _) = case
    try:
        v = velocity(scene, q, u)
    except RefusedError:
        return
    check_consistent(Evaluation(scene, q, v))


@pytest.mark.parametrize("key", FORMULATIONS)
def test_the_upright_bicycle_whose_wheel_does_not_rise_is_no_violation(key):
    """Its row is 1 and cos(π/2) = 6e-17, the velocities that they stand beside 0 and 0.5."""
    scene = Bicycle()
    if not FORMULATIONS[key].applies_to(scene):
        return
    q, v = scene.initial_state()
    v[2] = 0.0
    expected = acceleration(scene, key, *scene.initial_state())
    found = acceleration(scene, key, q, v)
    allowed = expected.error_bound + found.error_bound
    assert np.abs(found.vdot - expected.vdot).max() <= allowed < 1e-9


@pytest.mark.parametrize("row", range(6))
def test_what_the_coordinates_round_excuses_no_violation_beyond_it(row):
    scene = Bicycle()
    q, v = scene.initial_state()
    a = Evaluation(scene, q, v).terms.a
    slip = np.linalg.lstsq(a, np.eye(6)[row], rcond=None)[0]
    with pytest.raises(InconsistentVelocityError, match=scene.constraint_names[row]):
        acceleration(scene, "au", q, v + 1e-12 * slip)


def test_an_inconsistent_velocity_is_told_what_lets_it_pass_only_where_that_is_an_argument():
    q, v = Q, V + 1.0
    for ask in (
        lambda: acceleration(SNAKE, "au", q, v),
        lambda: check_state(SNAKE, q, v),
    ):
        with pytest.raises(InconsistentVelocityError, match="consistent=False lets it pass"):
            ask()
    with pytest.raises(InconsistentVelocityError) as caught:
        simulate(SNAKE, "au", 1.0, q0=q, v0=v)
    assert "consistent=False" not in str(caught.value)


@pytest.mark.parametrize("u", [[1.0], [1.0, 2.0, 3.0], [np.nan, 0.0], "fast", None])
def test_speeds_of_wrong_shape_or_value_are_refused_with_their_name(u):
    with pytest.raises(InputError, match="u"):
        velocity(SNAKE, Q, u)
