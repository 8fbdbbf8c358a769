"""`accuracy`: the true error of doubles."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from tests.evaluation.test_acceleration import stretched

import eomcheck
from eomcheck import strategies
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.certified import FLOAT64_DIGITS, certified_digits, true_error
from eomcheck.evaluation.tolerance import C
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.numbers.ball import ball, precision
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import Snake

keys = pytest.mark.parametrize("key", FORMULATIONS)
PAPER = Snake.paper()
Q, _ = PAPER.initial_state()
U = [1.0, 0.5]


@keys
def test_doubles_deliver_more_than_ten_digits_on_the_paper_s_robot(key: str):
    found = eomcheck.accuracy(PAPER, key, Q, U)
    assert found.key == key
    assert 10 < found.digits < FLOAT64_DIGITS
    assert found.relative == pytest.approx(
        found.error.max() / np.abs(found.vdot).max(), rel=1e-6, abs=0.0
    )
    assert (found.ulps * np.spacing(np.abs(found.truth.doubles())) >= found.error * 0.99).all()
    assert set(found.condition) == set(
        eomcheck.acceleration(PAPER, key, Q, eomcheck.velocity(PAPER, Q, U)).rcond
    )


@settings(max_examples=15)
@given(strategies.scene_states(strategies.snakes(1, 8)))
def test_the_constant_exceeds_every_certified_ratio(case: tuple[Snake, State]):
    scene, (q, v, t) = case
    u = eomcheck.speeds_of(scene, q, v, t)
    for key in FORMULATIONS:
        try:
            assert not eomcheck.accuracy(scene, key, q, u, t).ratio >= C
        except RefusedError:
            continue


def test_the_true_error_of_a_number_that_was_moved_is_by_how_much():
    truth = eomcheck.enclose(PAPER, "kane", Q, U)
    right = truth.doubles()
    assert (true_error(right, truth) <= np.spacing(np.abs(right))).all()
    assert true_error(right + 1e-3, truth) == pytest.approx(1e-3, rel=1e-9)


def test_a_true_error_is_never_rounded_down():
    truth = eomcheck.enclose(PAPER, "kane", Q, U)
    for shift in 10.0 ** -np.arange(1.0, 16.0):
        vdot = truth.doubles() + shift
        for error, x, y in zip(true_error(vdot, truth), vdot, truth.vdot, strict=True):
            with precision(truth.bits):
                assert ball(float(error)) >= abs(ball(float(x)) - y).upper()


@keys
@pytest.mark.parametrize("speed", [1e-150, 1e-160, 1e-170, 1e-250])
def test_speeds_whose_squares_underflow_are_right_or_their_bound_tells(key: str, speed: float):
    free = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], None, [0.1, -0.2])
    found = eomcheck.accuracy(free, key, [0, 0, 0.3, 1.1], [speed, speed])
    assert not found.silently_wrong
    assert found.relative < 1e-12 if speed > 1e-155 else 1e-6 < found.relative < 1.001
    assert found.relative_bound >= found.relative


@keys
def test_an_inconsistent_velocity_is_compared_with_the_formulation_s_own_answer(key: str):
    v = eomcheck.velocity(PAPER, Q, U) + 1e-3
    found = eomcheck.accuracy(PAPER, key, Q, v=v)
    own = eomcheck.enclose(PAPER, key, Q, v=v)
    assert found.relative < 1e-12
    assert (found.truth.doubles() == own.doubles()).all()
    at_u = eomcheck.enclose(PAPER, key, Q, eomcheck.speeds_of(PAPER, Q, v)).doubles()
    same = key == "kane"  # ML takes its forces at v
    assert (np.abs(own.doubles() - at_u).max() < 1e-9) == same


@pytest.mark.parametrize("given", [{}, {"u": U, "v": np.zeros(9)}])
def test_either_speeds_or_a_velocity_is_to_be_given(given: dict):
    for ask in (eomcheck.accuracy, eomcheck.enclose):
        with pytest.raises(InputError, match="expected either u or v"):
            ask(PAPER, "kane", Q, **given)


def test_a_wrong_result_is_silent_only_if_its_bound_does_not_tell():
    found = eomcheck.accuracy(PAPER, "kane", Q, U)
    assert not found.silently_wrong
    wrong = replace(found, relative=1e-5)
    assert wrong.silently_wrong
    assert not replace(wrong, relative_bound=1e-4).silently_wrong
    assert not replace(wrong, relative=1e-7).silently_wrong


def test_a_velocity_that_doubles_cannot_hold_is_refused():
    scene = Snake.pattern(100)
    with pytest.raises(RefusedError, match="v overflows"):
        eomcheck.accuracy(scene, "kane", scene.initial_state()[0], [1e300, 1e300])


def test_lost_digits_show():
    scene = Snake.pattern(45)
    q, _ = scene.initial_state()
    try:
        found = eomcheck.accuracy(scene, "ml", q, U)
    except RefusedError:
        return
    assert found.digits < 12


def test_digits_count_from_a_relative_error():
    assert certified_digits(1e-5) == pytest.approx(5.0)
    assert certified_digits(0.0) == certified_digits(1e-30) == FLOAT64_DIGITS
    assert certified_digits(3.0) == certified_digits(math.inf) == certified_digits(math.nan) == 0.0
    assert pytest.approx(15.95, abs=0.01) == FLOAT64_DIGITS


def test_an_acceleration_that_vanishes_is_exact():
    one = np.ones(3)
    scene = Snake(one, one, one, None, 0 * one)
    found = eomcheck.accuracy(scene, "kane", np.zeros(5), [0.0, 0.0])
    assert (found.error == 0).all() and (found.ulps == 0).all()
    assert found.relative == 0.0
    assert math.isnan(found.ratio)


def test_an_entry_that_vanishes_has_no_units_in_the_last_place():
    found = eomcheck.accuracy(Snake([1.0], [1.0], [0.1], None, [0.0]), "el", [0, 0, 0.5], [0, 1])
    assert found.error[0] > 0 or found.error.max() == 0
    assert np.isinf(found.ulps[found.error > 0]).any() or found.error.max() == 0


def test_a_refusal_in_doubles_is_passed_on():
    one = np.ones(3)
    scene = Snake(one, one, one, None, 0 * one)
    with pytest.raises(RefusedError, match="a_1"):
        eomcheck.accuracy(scene, "em", np.zeros(5), U)
    assert eomcheck.accuracy(scene, "em", np.zeros(5), U, pivoted=True).relative < 1e3 * EPS


@keys
def test_accuracy_and_enclosure_come_back_from_another_process(key: str):
    found = eomcheck.accuracy(PAPER, key, Q, U)
    again = pickle.loads(pickle.dumps(found))
    assert again.key == key
    assert np.array_equal(again.error, found.error)
    assert again.relative == found.relative
    assert again.truth.digits == found.truth.digits
    assert np.array_equal(again.truth.doubles(), found.truth.doubles())
    assert all(x.contains(y) for x, y in zip(again.truth.vdot, found.truth.vdot, strict=True))


def test_a_pivoted_partition_is_asked_for_at_a_velocity_too():
    scene, q, v = stretched(3)
    with pytest.raises(RefusedError):
        eomcheck.accuracy(scene, "el", q, v=v)
    assert eomcheck.accuracy(scene, "el", q, v=v, pivoted=True).digits > 10
