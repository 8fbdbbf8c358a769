"""Extrapolation: order, accuracy and choice of steps, on problems whose solutions are known."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import islice, pairwise

import flint
import numpy as np
import pytest

from eomcheck.errors import InputError
from eomcheck.motion.reference import (
    MOST,
    Extrapolation,
    GaveUpError,
    evaluations_for,
    next_step_and_target,
)
from eomcheck.numbers.ball import precision

BITS = 200


def number(x: Fraction) -> flint.arb:
    return flint.arb(x.numerator) / x.denominator


def stripped(y: np.ndarray) -> np.ndarray:
    return np.array([x.mid() for x in y], object)


def oscillator(y: np.ndarray) -> np.ndarray:
    return np.array([y[1], -y[0]], y.dtype)


def kepler(y: np.ndarray) -> np.ndarray:
    square = y[0] * y[0] + y[1] * y[1]
    cube = square * square.sqrt()
    return np.array([y[2], y[3], -y[0] / cube, -y[1] / cube], object)


def swing(tolerance: float, end: float = 10.0) -> tuple[float, Extrapolation]:
    """Return the error of sin and cos at `end`, and the integrator."""
    method = Extrapolation(oscillator, tolerance, number, stripped)
    with precision(BITS):
        *_, y = method.run(np.array([flint.arb(0), flint.arb(1)]), [0.0, end])
        true = flint.arb(end).sin_cos()
        return max(abs(float(a - b)) for a, b in zip(y, true, strict=True)), method


def orbit(tolerance: float, end: float = 6.25) -> tuple[float, Extrapolation]:
    """Return the error of the position on an orbit of eccentricity 1/2, and the integrator."""
    method = Extrapolation(kepler, tolerance, number, stripped)
    with precision(BITS):
        e = flint.arb(1) / 2
        start = stripped(np.array([1 - e, flint.arb(0), flint.arb(0), flint.arb(3).sqrt()]))
        *_, y = method.run(start, [0.0, 3.0, end])
        anomaly = flint.arb(end)
        for _ in range(20):  # Newton's method for Kepler's equation
            rest = anomaly - e * anomaly.sin() - end
            anomaly = (anomaly - rest / (1 - e * anomaly.cos())).mid()
        true = anomaly.cos() - e, (1 - e * e).sqrt() * anomaly.sin()
        return max(abs(float(a - b)) for a, b in zip(y[:2], true, strict=True)), method


@pytest.mark.parametrize("problem", [swing, orbit])
def test_25_digits_of_a_known_solution_come_out(problem):
    error, method = problem(1e-27)
    assert error < 1e-25
    assert method.effort.evaluations < 5000


@pytest.mark.parametrize("problem", [swing, orbit])
@pytest.mark.parametrize("digits", [8, 12, 16, 20, 24, 28, 32])
def test_the_tolerance_controls_the_error(problem, digits: int):
    error, _ = problem(10.0**-digits)
    assert error < 100.0 * 10.0**-digits


def test_more_digits_take_higher_orders_rather_than_many_more_steps():
    efforts = [orbit(tolerance)[1].effort for tolerance in (1e-10, 1e-30)]
    few, many = efforts
    assert max(many.orders) > max(few.orders)
    assert many.steps < 4 * few.steps
    assert many.evaluations < 12 * few.evaluations


@pytest.mark.parametrize("k", range(1, 11))
def test_k_midpoint_results_have_order_2k(k: int):
    with precision(600):
        method = Extrapolation(oscillator, 1.0, number, stripped)
        start = np.array([flint.arb(0), flint.arb(1)])
        errors = []
        for step in (Fraction(1, 8), Fraction(1, 16)):
            after = next(y for i, (y, _) in enumerate(method.columns(start, step), 1) if i == k)
            errors.append(abs(float(after[0] - number(step).sin())))
    # One step has an error of order 2k + 1.
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2 * k + 1, abs=0.1)


def test_the_error_that_is_estimated_is_above_the_true_one():
    with precision(600):
        method = Extrapolation(oscillator, 1e-10, number, stripped)
        start, step = np.array([flint.arb(0), flint.arb(1)]), Fraction(1, 4)
        true = number(step).sin_cos()
        columns = list(islice(method.columns(start, step), 1, 10))
        for after, said in columns:
            errors = [abs(float(a - b)) / 1e-10 for a, b in zip(after, true, strict=True)]
            assert max(errors) < said
        assert all(said < before / 50 for (_, before), (_, said) in pairwise(columns))


def test_fractions_stay_exact():
    """ẏ = 2 t, written with t as a second entry, is a parabola: already order 2 is exact."""
    method = Extrapolation(
        lambda y: np.array([2 * y[1], Fraction(1)]), 1e-30, lambda x: x, lambda y: y
    )
    _, y = method.run(np.array([Fraction(0), Fraction(0)]), [0.0, 0.3])
    assert y.tolist() == [Fraction(0.3) ** 2, Fraction(0.3)]


def test_doubles_need_nothing_but_the_right_hand_side():
    method = Extrapolation(oscillator, 1e-13)
    _, y = method.run(np.array([0.0, 1.0]), [0.0, 2.0])
    assert y == pytest.approx([math.sin(2.0), math.cos(2.0)], abs=1e-12)


def test_results_come_at_exactly_the_times_asked_for():
    times = [0.0, 0.1, 0.30000000000000004, 2.0]
    seen = []
    method = Extrapolation(lambda y: np.ones_like(y), 1e-12)
    found = method.run(np.array([0.0]), times, watch=lambda t, y: seen.append(t))
    assert [float(y[0]) for y in found] == pytest.approx(times, abs=1e-15)
    assert {Fraction(t) for t in times[1:]} <= set(seen)
    assert seen == sorted(seen)
    assert len(seen) == method.effort.steps


def test_steps_grow_where_the_solution_is_smooth_and_shrink_where_it_is_not():
    """ẏ = y² from 1 is 1/(1 - t): it runs away at t = 1."""
    seen = [Fraction(0)]
    method = Extrapolation(lambda y: y * y, 1e-12)
    *_, y = method.run(np.array([1.0]), [0.0, 0.99], watch=lambda t, y: seen.append(t))
    assert y[0] == pytest.approx(100.0, rel=1e-8)
    steps = np.diff([float(t) for t in seen])
    assert steps[-1] < steps.max() / 10
    assert steps.max() > 10 * steps[0]


def test_a_first_step_that_is_far_too_long_is_rejected_and_does_no_harm():
    method = Extrapolation(oscillator, 1e-12)
    *_, y = method.run(np.array([0.0, 1.0]), [0.0, 50.0], first=50.0)
    assert method.effort.rejected > 0
    assert y == pytest.approx([math.sin(50.0), math.cos(50.0)], abs=1e-10)


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_solution_that_ends_is_given_up_with_the_time_reached():
    with pytest.raises(GaveUpError, match=r"at t = (0\.9999|1\.0)"):
        Extrapolation(lambda y: y * y, 1e-10).run(np.array([1.0]), [0.0, 2.0])


def test_a_right_hand_side_that_is_no_number_is_given_up():
    with pytest.raises(GaveUpError, match=r"t = 0\.0 s"):
        Extrapolation(lambda y: y * np.nan, 1e-10).run(np.array([1.0]), [0.0, 1.0])


@pytest.mark.parametrize("times", [[], [0.0, 0.0], [1.0, 0.5]])
def test_times_must_rise(times: list[float]):
    with pytest.raises(InputError, match="times that rise"):
        Extrapolation(oscillator, 1e-10).run(np.array([0.0, 1.0]), times)


def test_one_time_is_the_start():
    y = np.array([0.0, 1.0])
    assert Extrapolation(oscillator, 1e-10).run(y, [3.0]) == [y]


def test_evaluations_are_counted():
    calls = []

    def counted(y: np.ndarray) -> np.ndarray:
        calls.append(1)
        return oscillator(y)

    method = Extrapolation(counted, 1e-10)
    method.run(np.array([0.0, 1.0]), [0.0, 5.0])
    assert method.effort.evaluations == len(calls)


def test_a_target_never_leaves_what_can_be_computed():
    assert next_step_and_target([1.0] * 3) == (1.0, 3)
    better_and_better = [2.0**k for k in range(MOST)]
    assert next_step_and_target(better_and_better)[1] == MOST
    assert next_step_and_target(better_and_better[:5]) == (
        16.0 * evaluations_for(6) / evaluations_for(5),
        6,
    )
