"""Derivatives and noise of black boxes, held against what is known."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.evaluation.tolerance import C
from eomcheck.testing.uncertain import (
    Sampled,
    UncertainArray,
    contract,
    exact,
    gradient,
    jumps,
    noise,
    partial,
    zero,
)

EPS = np.finfo(np.float64).eps


def smooth(x):
    return np.array([np.sin(3 * x[0]), np.exp(x[0]) * x[1], 1 / (2 + x[0] * x[1]), x[1] ** 5])


def slope(x):
    below = 2 + x[0] * x[1]
    return np.array([3 * np.cos(3 * x[0]), np.exp(x[0]) * x[1], -x[1] / below**2, 0])


def measured(f, x):
    value = f(x)
    size = np.abs(value)
    return UncertainArray(value, noise(f, x, np.ones(len(x))) + EPS * size, size)


@pytest.mark.parametrize("seed", range(30))
def test_a_derivative_is_within_its_error_and_the_error_is_small(seed: int):
    x = np.random.default_rng(seed).uniform(-1, 1, 2)
    here = measured(smooth, x)
    found = partial(smooth, x, 0, 1.0, here.error, here.size)
    assert (np.abs(found.value - slope(x)) <= C * found.error).all()
    assert found.error.max() < 1e-11


def test_with_1_in_the_place_of_32_right_derivatives_would_be_refused():
    """Errors that are told by neighbours are too small now and then, by chance: hence 32."""
    worst = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        x = rng.uniform(-1, 1, 2)
        A, rates = rng.uniform(-1, 1, (4, 6)), rng.uniform(0, 6, 6)

        def f(y, A=A, rates=rates):
            return A @ np.sin(rates * y[0] + y[1])

        here = measured(f, x)
        found = partial(f, x, 0, 1.0, here.error, here.size)
        error = np.abs(found.value - A @ (rates * np.cos(rates * x[0] + x[1])))
        worst.append((error / found.error).max())
    assert 1.0 < max(worst) < C / 8


def test_a_gradient_has_the_new_axis_first():
    x = np.array([0.3, -0.7])
    found = gradient(smooth, x, np.ones(2), measured(smooth, x))
    assert found.shape == (2, 4)
    np.testing.assert_allclose(found.value[0], slope(x), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found.value[1, 3], 5 * 0.7**4, rtol=1e-10)


def test_each_coordinate_has_steps_of_its_own_range():
    x, width = np.array([30.0, 0.007]), np.array([100.0, 0.01])
    value = np.sin(x / width)
    here = UncertainArray(value, EPS * np.ones(2), np.ones(2))
    found = gradient(lambda y: np.sin(y / width), x, width, here)
    away = np.abs(found.value - np.diag(np.cos(x / width) / width))
    assert (away <= C * found.error).all()
    assert (found.error * width[:, None] < 1e-11).all()


@pytest.mark.parametrize("seed", range(20))
def test_a_function_in_single_precision_is_not_taken_for_a_constant(seed: int):
    at = np.random.default_rng(seed).uniform(-1, 1, 1)
    found = partial(lambda x: np.float64(np.float32(0.5 + 0.02 * np.sin(x))), at, 0, 1.0)
    assert abs(found.value[0] - 0.02 * np.cos(at[0])) <= C * found.error[0]


def test_steps_that_leave_the_domain_do_not_count():
    found = partial(lambda x: np.sqrt(1e-2 + x), np.zeros(1), 0, 1.0)
    expected = 0.5 / np.sqrt(1e-2)
    assert abs(found.value[0] - expected) <= C * found.error[0]
    assert found.error[0] < 0.1 * expected


def test_a_function_without_a_value_anywhere_has_an_infinite_error():
    found = partial(lambda x: np.array([np.nan]), np.zeros(1), 0, 1.0)
    assert np.isinf(found.error).all()


@pytest.mark.parametrize("away", [0.0, 1e-16, 1e-13, 1e-10])
def test_a_kink_has_an_error_as_large_as_its_derivative(away: float):
    found = partial(lambda x: np.abs(x - away), np.zeros(1), 0, 1.0)
    assert C * found.error[0] > 0.1


@pytest.mark.parametrize("away", [1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3])
def test_beside_a_kink_the_derivative_is_that_of_its_side(away: float):
    found = partial(lambda x: np.abs(x - away), np.zeros(1), 0, 1.0)
    assert abs(found.value[0] + 1.0) <= C * found.error[0]
    assert C * found.error[0] < 1e-4 or away < 1e-5


@pytest.mark.parametrize("seed", range(20))
def test_a_vibration_that_is_too_fast_to_see_is_not_taken_for_its_average(seed: int):
    at = np.random.default_rng(seed).uniform(-1, 1, 1)
    found = partial(lambda x: np.sin(1e4 * x), at, 0, 1.0)
    assert C * found.error[0] > abs(found.value[0] - 1e4 * np.cos(1e4 * at[0]))


@pytest.mark.parametrize("share", [1e-14, 1e-10, 1e-7])
def test_noise_is_measured_within_a_factor_of_three(share: float):
    rng = np.random.default_rng(1)

    def noisy(x):
        return np.array([np.sin(x[0]) + share * rng.standard_normal()])

    found = [noise(noisy, np.array([0.4]), np.ones(1), seed)[0] for seed in range(20)]
    assert share / 3 < np.median(found) < 3 * share


@pytest.mark.parametrize("frequency", [1.0, 20.0, 100.0])
def test_a_smooth_function_has_no_noise_but_its_rounding(frequency: float):
    found = noise(lambda x: np.sin(frequency * x), np.array([0.4]), np.ones(1))
    assert found[0] < 20 * frequency * EPS


@pytest.mark.parametrize("far", [1.0, 1e4, 1e8, 1e10])
def test_cancellation_shows_as_noise_also_where_it_leaves_steps(far: float):
    def cancels(x):
        return (far + np.sin(x)) - far

    found = noise(cancels, np.array([0.4]), np.ones(1))
    assert 0.02 < found[0] / (far * EPS) < 2


def test_errors_of_sums_and_products_hold_what_they_are_made_of():
    rng = np.random.default_rng(2)
    for _ in range(50):
        A, x = rng.uniform(-1, 1, (3, 3)), rng.uniform(-1, 1, 3)
        dA, dx = rng.uniform(-1, 1, (3, 3)) * 1e-6, rng.uniform(-1, 1, 3) * 1e-6
        M = UncertainArray(A, np.abs(dA), np.abs(A))
        v = UncertainArray(x, np.abs(dx), np.abs(x))
        product = M @ v
        moved = (A + dA) @ (x + dx)
        assert (np.abs(product.value - moved) <= 1.01 * product.error).all()
        difference = v - M[0]
        assert (np.abs(difference.value + (dx - dA[0]) - (x + dx - A[0] - dA[0])) <= 1e-15).all()
        assert (difference.error >= np.abs(dx) + np.abs(dA[0])).all()


def test_the_size_of_a_sum_is_that_of_its_terms():
    one = exact(np.array([1.0, -2.0]))
    assert (one - one).size.tolist() == [2.0, 4.0]
    assert zero(one).value.tolist() == [0.0, 0.0]
    assert zero(one).size.tolist() == [1.0, 2.0]
    assert float(contract("i,i->", one, one).size) == 5.0
    assert float((3.0 * one).size[1]) == 6.0


def test_all_points_of_lines_and_differences_are_announced_first():
    """Of noise, of derivatives and of jumps, so that a function can compute them at once."""
    announced, asked = set(), set()

    def value(x):
        asked.add(x.tobytes())
        return smooth(x)

    f = Sampled(value, lambda points: announced.update(x.tobytes() for x in points))
    x, width = np.array([0.3, -0.4]), np.ones(2)
    spread = noise(f, x, width)
    at_x = UncertainArray(smooth(x), spread, np.abs(smooth(x)))
    slopes = gradient(f, x, width, at_x)
    jumps(f, x, width)
    assert asked == announced and len(asked) > 100
    assert np.array_equal(spread, noise(smooth, x, width))
    assert np.array_equal(slopes.value, gradient(smooth, x, width, at_x).value)
