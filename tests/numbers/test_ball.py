"""Balls: they contain what is true, and what cannot be shown is refused."""

from __future__ import annotations

import copy
import math
import pickle
from fractions import Fraction
from threading import Thread

import flint
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eomcheck.errors import RefusedError
from eomcheck.numbers.ball import Balls, ball, midpoints, precision
from eomcheck.numbers.banded_solve import HALF, WIDTH, solve_banded
from eomcheck.numbers.linear import solve

finite = st.floats(-1e6, 1e6)


def contains(x: flint.arb, exact: Fraction) -> bool:
    return (x * exact.denominator).contains(flint.fmpz(exact.numerator))


@given(st.lists(finite, min_size=1, max_size=5))
def test_doubles_are_taken_for_exactly_the_numbers_that_they_are(x: list[float]):
    balls = Balls().numbers(np.array(x))
    assert all(y.rad() == 0 for y in balls)
    assert midpoints(balls).tolist() == x


@given(finite, st.integers(60, 400))
def test_a_sine_at_low_precision_contains_the_one_at_high_precision(x: float, bits: int):
    def sine() -> flint.arb:
        return Balls().angles(np.array([x])).sin[0]

    with precision(bits):
        rough = sine()
    with precision(4 * bits):
        assert rough.contains(sine())
    assert float(rough.mid()) == pytest.approx(math.sin(x), abs=1e-15)


def test_angles_that_are_balls_already_are_kept():
    value = Balls().numbers(np.array([0.5, -1.0]))
    assert Balls().angles(value).value is value


@given(st.lists(st.integers(-50, 50), min_size=9, max_size=9))
def test_solutions_contain_the_exact_ones_or_are_refused(entries: list[int]):
    exact = np.array([Fraction(x) for x in entries], object).reshape(3, 3)
    b = np.array([Fraction(1), Fraction(2), Fraction(-3)], object)
    with precision(100):
        balls = Balls()
        A = balls.numbers(exact.astype(float))
        try:
            x = solve(A, balls.numbers(b.astype(float)), "A")
        except RefusedError:
            assert abs(np.linalg.det(exact.astype(float))) < 0.5  # an integer: it is 0
            return
        for found, true in zip(x, solve(exact, b, "A"), strict=True):
            assert contains(found, true)


def test_a_singular_matrix_is_refused_with_its_name_and_the_precision():
    A = Balls().numbers(np.array([[0.1, 0.2], [0.2, 0.4]]))
    with precision(200), pytest.raises(RefusedError, match=r"matrix K .* balls of 200 bits"):
        solve(A, A[0], "K")


def test_the_precision_is_restored_after_the_block():
    before = flint.ctx.prec
    with pytest.raises(ZeroDivisionError), precision(999):
        raise ZeroDivisionError
    assert flint.ctx.prec == before


def test_one_thread_at_a_time_has_its_precision():
    before, seen = flint.ctx.prec, []

    def other():
        with precision(400):
            seen.append(flint.ctx.prec)

    thread = Thread(target=other)
    with precision(100):
        thread.start()
        thread.join(0.3)
        with precision(150):  # the same thread may
            assert flint.ctx.prec == 150
        assert flint.ctx.prec == 100
        assert seen == []
    thread.join(10)
    assert seen == [400]
    assert flint.ctx.prec == before


@pytest.mark.parametrize("again", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
@pytest.mark.parametrize("bits", [10, 53, 500])
def test_a_ball_that_is_copied_contains_the_same_numbers_and_hardly_more(again, bits: int):
    with precision(300):
        root = flint.arb(2).sqrt()
        balls = [root, -root * flint.arb(10) ** -400, root + flint.arb(0, 1e-20), flint.arb(0)]
    with precision(bits):
        found = again(balls)
    with precision(300):
        for x, y in zip(balls, found, strict=True):
            assert x.mid() == y.mid()
            assert x.rad() <= y.rad() <= x.rad() * (1 + 2.0**-28)
            assert y.contains(x)
    assert not again(flint.arb("nan")).is_finite()


def test_literal_integers_among_results_are_balls_too():
    assert ball(3) == flint.arb(3)
    assert midpoints(np.array([1, flint.arb(2)], object)).tolist() == [1.0, 2.0]


def test_a_root_contains_the_positive_root():
    with precision(60):
        two, nine = Balls().root(Balls().numbers(np.array([2.0, 9.0])))
    with precision(300):
        assert two.contains(flint.arb(2).sqrt())
    assert nine.contains(3)


def test_a_midpoint_is_in_the_middle():
    assert midpoints(np.array([flint.arb(1, 0.5)], object)).tolist() == [1.0]


def band(*rows: list) -> np.ndarray:
    """Return the bands of a full matrix of order 2 or less."""
    bands = np.zeros((len(rows), WIDTH), object)
    for i, row in enumerate(rows):
        for j, x in enumerate(row):
            bands[i, HALF + j - i] = ball(x)
    return bands


PERHAPS_ZERO = flint.arb(0.25, 0.5)


def test_a_band_whose_pivots_may_all_be_zero_is_refused():
    for bands in (band([PERHAPS_ZERO]), band([PERHAPS_ZERO, 1], [PERHAPS_ZERO, 1])):
        with pytest.raises(RefusedError, match="matrix K is singular"):
            solve_banded(bands, np.array([ball(1)] * len(bands), object), "K")


def test_a_band_takes_the_pivot_that_is_farthest_from_zero():
    x = solve_banded(band([PERHAPS_ZERO, 1], [4, 1]), np.array([ball(1), ball(2)], object), "K")
    assert all(y.is_finite() for y in x)


@given(st.lists(st.integers(1, 10**6), min_size=1, max_size=4), st.integers(60, 400))
def test_a_root_contains_the_true_one(entries: list[int], bits: int):
    """Of a square it is a whole number; of another number it lies between two fractions."""
    with precision(bits):
        squares = Balls().root(Balls().numbers(np.array([float(x * x) for x in entries])))
        others = Balls().root(Balls().numbers(np.array([float(x) for x in entries])))
    for found, root in zip(squares, entries, strict=True):
        assert contains(found, Fraction(root))
    for found, x in zip(others, entries, strict=True):
        with precision(4 * bits):
            assert found.contains(flint.arb(x).sqrt())
            below, above = found.lower(), found.upper()
            assert below > 0 and below * below <= x <= above * above
            assert found.rad() <= 2 * x * flint.arb(2) ** -bits


def test_a_root_of_a_ball_contains_those_of_all_numbers_in_it():
    with precision(200):
        x = flint.arb(2, 0.25)
        (root,) = Balls().root(np.array([x]))
        for part in (1.75, 2.0, 2.25):
            assert root.contains(flint.arb(part).sqrt())


@pytest.mark.parametrize("x", [flint.arb(-1), flint.arb(0, 1)])
def test_a_root_that_may_not_exist_is_no_finite_ball(x: flint.arb):
    assert not Balls().root(np.array([x]))[0].is_finite()
