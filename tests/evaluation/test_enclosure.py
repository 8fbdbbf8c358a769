"""`enclose`: true accelerations with proved radii."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import flint
import numpy as np
import pytest
from hypothesis import given, settings
from tests.exact import ExactFloats

import eomcheck
from eomcheck import strategies
from eomcheck.errors import InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.certified import _certain_digits
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.numbers.ball import precision
from eomcheck.scenes import Snake

keys = pytest.mark.parametrize("key", FORMULATIONS)
PAPER = Snake.paper()
Q, _ = PAPER.initial_state()
U = [1.0, 0.5]


@keys
@pytest.mark.sampled(3)
def test_the_enclosure_contains_the_exact_result_up_to_the_sines(key: str):
    """Fractions are exact but for sines of 48 digits, which move the result by far less."""
    arithmetic = ExactFloats()
    at = Quantities(PAPER, arithmetic, arithmetic.numbers(Q))
    at.u = arithmetic.numbers(np.array(U))
    exact = at.solution(FORMULATIONS[key]).vdot
    found = eomcheck.enclose(PAPER, key, Q, U).vdot
    with precision(200):
        for x, y in zip(found, map(Fraction, exact), strict=True):
            gap = abs(x - flint.arb(flint.fmpq(y.numerator, y.denominator)))
            assert gap < abs(x) * flint.arb("1e-28")


@keys
@pytest.mark.parametrize("digits", [1, 15, 30, 200])
def test_every_entry_has_the_digits_asked_for(key: str, digits: int):
    found = eomcheck.enclose(PAPER, key, Q, U, digits=digits)
    assert found.digits >= digits
    for x in found.vdot:
        assert x.rad() <= x.abs_upper() * flint.arb(10) ** -digits


@keys
def test_the_digits_stated_are_those_of_the_worst_radius(key: str):
    found = eomcheck.enclose(PAPER, key, Q, U)
    left = [float((x.abs_lower() / x.rad()).log_base(10)) for x in found.vdot]
    assert found.digits == pytest.approx(min(left))


def test_an_entry_much_smaller_than_the_others_has_its_digits_too():
    large, small = flint.arb(1, 1e-30), flint.arb(1e-20, 1e-30)
    still = np.array([flint.arb(0)] * 2, object)
    assert _certain_digits(np.array([large, small], object), still) == pytest.approx(10.0, abs=0.01)


@keys
def test_more_digits_lie_within_fewer(key: str):
    rough, fine = (eomcheck.enclose(PAPER, key, Q, U, digits=d) for d in (10, 100))
    assert fine.bits > rough.bits
    assert all(x.contains(y) for x, y in zip(rough.vdot, fine.vdot, strict=True))


@settings(max_examples=15)
@given(strategies.scene_states(strategies.snakes(1, 6)))
def test_enclosures_of_all_formulations_overlap(case: tuple[Snake, State]):
    scene, (q, v, t) = case
    u = eomcheck.speeds_of(scene, q, v, t)
    found = [eomcheck.enclose(scene, key, q, u, t) for key in ("kane", "im", "gw", "ml", "au")]
    assert all(x.overlaps(found[0]).all() for x in found)


def test_a_wrong_acceleration_does_not_overlap():
    found = eomcheck.enclose(PAPER, "kane", Q, U)
    other = eomcheck.enclose(PAPER, "kane", Q, np.array(U) * (1 + 1e-15))
    assert not found.overlaps(other).any()


def test_the_velocity_satisfies_the_constraints_to_the_last_digit():
    found = eomcheck.enclose(PAPER, "au", Q, U)
    doubles = eomcheck.velocity(PAPER, Q, U)
    assert np.allclose([float(x) for x in found.v], doubles, rtol=1e-13)
    assert all(x.rad() < 1e-40 for x in found.v)


def test_where_doubles_lose_every_digit_the_precision_is_raised():
    scene = Snake.pattern(60)
    q, _ = scene.initial_state()
    em, kane = (eomcheck.enclose(scene, key, q, U) for key in ("em", "kane"))
    assert em.bits > 164
    assert em.overlaps(kane).all()


def test_parallel_wheels_are_refused_by_the_paper_s_partition_and_not_by_a_pivoted_one():
    one = np.ones(4)
    straight = Snake(one, one, one, one[1:], 0 * one)
    with pytest.raises(RefusedError, match=r"a_1 cannot be shown to be invertible"):
        eomcheck.enclose(straight, "em", np.zeros(6), U)
    pivoted = eomcheck.enclose(straight, "em", np.zeros(6), U, pivoted=True)
    assert pivoted.overlaps(eomcheck.enclose(straight, "au", np.zeros(6), U)).all()


def test_an_acceleration_that_vanishes_is_enclosed():
    one = np.ones(5)
    straight = Snake(one, one, one / 12, one[1:], 0 * one)
    q = np.r_[0.0, 0.0, 0.3 * one]
    found = eomcheck.enclose(straight, "kane", q, [1.0, 0.0])
    assert np.abs(found.doubles()).max() < 1e-100


def test_a_wheel_that_doubles_hold_for_perpendicular_is_not():
    scene = Snake([1.0, 1.0], [1.0, 1.0], [0.1, 0.1], None, [0.0, math.pi / 2])
    found = eomcheck.enclose(scene, "kane", [0, 0, 0.1, 0.4], U)
    assert found.digits >= 30
    assert max(abs(float(x)) for x in found.vdot) > 1e15


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"key": "newton"}, UnknownNameError, "newton"),
        ({"q": [0.0]}, InputError, r"q has shape \(1,\)"),
        ({"u": [1.0, math.nan]}, InputError, r"u\[1\] = nan"),
        ({"t": math.inf}, InputError, "t = inf"),
        ({"digits": 0}, InputError, "digits = 0"),
        ({"digits": 2.5}, InputError, "digits = 2.5"),
        ({"pivoted": True}, InputError, "kane has no partition"),
    ],
)
def test_bad_input_is_named(change: dict, error: type, says: str):
    arguments = {"key": "kane", "q": Q, "u": U} | change
    with pytest.raises(error, match=says):
        eomcheck.enclose(PAPER, **arguments)


def test_threads_enclose_as_one_alone_does_and_leave_the_caller_s_precision():
    digits = [5, 15, 30, 60, 120, 240]
    alone = [eomcheck.enclose(PAPER, "kane", Q, U, digits=d) for d in digits]
    before, interval = flint.ctx.prec, sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(len(digits)) as pool:
            for _ in range(20):
                found = pool.map(lambda d: eomcheck.enclose(PAPER, "kane", Q, U, digits=d), digits)
                for one, other in zip(alone, found, strict=True):
                    assert (one.bits, one.digits) == (other.bits, other.digits)
                    for x, y in zip(one.vdot, other.vdot, strict=True):
                        assert x.mid() == y.mid()
                        assert x.rad() == y.rad()
                assert flint.ctx.prec == before
    finally:
        sys.setswitchinterval(interval)
        flint.ctx.prec = before


@pytest.mark.parametrize("bits", [2, 2000])
def test_no_result_depends_on_the_caller_s_precision(bits: int):
    found, true = eomcheck.accuracy(PAPER, "kane", Q, U), eomcheck.enclose(PAPER, "kane", Q, U)
    before = flint.ctx.prec
    flint.ctx.prec = bits
    try:
        here, truth = eomcheck.accuracy(PAPER, "kane", Q, U), eomcheck.enclose(PAPER, "kane", Q, U)
        same = truth.overlaps(true), truth.doubles() == true.doubles()
        after = flint.ctx.prec
    finally:
        flint.ctx.prec = before
    assert after == bits
    assert np.all(same)
    assert truth.digits == true.digits
    assert here.relative == found.relative
    assert here.relative_bound == found.relative_bound
    assert np.array_equal(here.error, found.error)
    assert np.array_equal(here.ulps, found.ulps)
