"""Entries that no state resolves are reported by name, and faults beside a jump are found."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from tests.testing.own import given, guide

from eomcheck.claims.finding import VERDICTS, Finding
from eomcheck.claims.registry import Comparison
from eomcheck.testing import FUNCTION_CLAIMS, EquationsOfMotion, check_functions
from eomcheck.testing.function_checks import judge_output
from eomcheck.testing.suite import EquationsTarget
from eomcheck.testing.uncertain import UncertainArray, noise

CART = guide("cart")
WHEEL = [(-100.0, 100.0), (-1.0, 1.0), (-50.0, 50.0), (-1.0, 1.0)]


def of(found: list[Finding], verdict: str) -> dict[str, str]:
    """Return claim -> detail of the Findings with a verdict."""
    return {one.claim: one.detail for one in found if one.verdict == verdict}


def wheel_and_arm(sign: float) -> dict[str, Any]:
    """Return a wheel that turns far beside an arm, whose gravity has a sign."""
    return {
        "M": lambda q: np.diag([3.0, 0.5]),
        "gravity": lambda q: np.array([2.0 * np.sin(q[0]), sign * 4.0 * np.cos(q[1])]),
        "U": lambda q: -2.0 * np.cos(q[0]) + 4.0 * np.sin(q[1]),
        "ranges": WHEEL,
    }


@pytest.mark.parametrize("sign", [-1.0, 0.0, 2.0])
def test_a_wrong_row_beside_a_wheel_that_turns_far_fails(sign: float):
    assert "gravity-of-potential" not in of(check_functions(2, **wheel_and_arm(1.0)), "failed")
    found = check_functions(2, **wheel_and_arm(sign), claims=["gravity-of-potential"])
    assert "row q[1]" in of(found, "failed")["gravity-of-potential"]


def spring(factor: float, frequency: float) -> dict[str, Any]:
    """Return a field of short wavelength in row 0, whose force has a factor, and a spring."""
    return {
        "M": lambda q: np.eye(2),
        "gravity": lambda q: np.array([factor * np.sin(frequency * q[0]), 3.0 * q[1]]),
        "U": lambda q: -np.cos(frequency * q[0]) / frequency + 1.5 * q[1] ** 2,
    }


@pytest.mark.parametrize("factor", [2.0, 0.0, -1.0])
@pytest.mark.parametrize("frequency", [1e4, 1e6, 1e8])
@pytest.mark.sampled(3)
def test_a_row_that_no_state_resolves_is_failed_or_named(factor: float, frequency: float):
    claim = "gravity-of-potential"
    found = check_functions(2, **spring(factor, frequency), claims=[claim])
    wrong = of(found, "failed") | of(found, "inconclusive")
    assert "row q[0]" in wrong[claim]
    right = check_functions(2, **spring(1.0, frequency), claims=[claim])
    assert not of(right, "failed")


def test_one_finding_of_a_claim_lists_what_no_state_resolves():
    claim = "gravity-of-potential"
    found = check_functions(2, **spring(2.0, 1e12), claims=[claim], states=7)
    (listed,) = [one for one in found if one.verdict == "inconclusive"]
    assert listed.detail.startswith("not resolved in any of 7 states: gravity, row q[0]")
    assert "q[1]" not in listed.detail
    (passed,) = [one for one in found if one.verdict == "passed"]
    assert passed.detail == "7 of 14 entries in 7 states not resolved"
    assert listed.subject == "gravity"


def test_a_test_of_a_claim_with_an_entry_that_no_state_resolves_does_not_pass():
    functions = EquationsOfMotion(2, **spring(2.0, 1e12))
    result = EquationsTarget(functions).results(5, 0)["gravity-of-potential"]
    assert result.verdict == "inconclusive"
    assert "row q[0]" in result.text


def test_entries_that_vanish_on_both_sides_in_all_states_pass():
    still = {"M": lambda q: np.diag([2.0, 3.0]), "bias": lambda q, v: np.zeros(2)}
    found = check_functions(2, **still, claims=["bias-of-mass-matrix"])
    assert [one.verdict for one in found] == ["passed"]
    assert not found[0].detail


def test_an_entry_that_vanishes_where_it_is_not_hidden_is_not_resolved():
    """Row 0 is 0 = 0 in one state and hidden by noise in the other."""
    claim = "gravity-of-potential"

    def U(q: Any) -> Any:
        return 1e12 * (q[0] > 0.0) * np.sin(1e12 * q[0]) + 1.5 * q[1] ** 2

    model = {"U": U, "gravity": lambda q: np.array([0.0, 3.0 * q[1]])}
    states = [([-0.6, 0.3], [0.0, 0.0]), ([0.6, 0.3], [0.0, 0.0])]
    found = check_functions(2, **model, claims=[claim], states=states)
    assert "row q[0]" in of(found, "inconclusive")[claim]


def sides(found: float, expected: float, error: float, size: float) -> Comparison:
    def one(value: float) -> UncertainArray:
        return UncertainArray(np.array([value]), np.array([error]), np.array([size]))

    return Comparison(
        "x", one(found), UncertainArray(np.array([expected]), np.zeros(1), np.ones(1)), (("0",),)
    )


@pytest.mark.parametrize(
    ("found", "error", "verdict"),
    [
        (1.0, 1e-12, "passed"),
        (1.0 + 1e-6, 1e-12, "failed"),
        (1.0, 2e-5, "passed"),
        (1.0, 4e-5, "inconclusive"),  # 32 of it are more than a thousandth
        (-1.0, 1.0, "inconclusive"),
        (np.nan, 1e-12, "inconclusive"),
        (1.0, np.inf, "inconclusive"),
    ],
)
def test_an_entry_that_would_pass_with_any_sign_is_not_resolved(
    found: float, error: float, verdict: str
):
    (claim,) = [FUNCTION_CLAIMS["bias-even"]]
    judged = judge_output(claim, sides(found, 1.0, error, 1e6))
    assert VERDICTS[int(judged.verdicts[0])] == verdict


# ---- Beside a jump -------------------------------------------------------------------------------


@pytest.mark.parametrize("near", [3e-3, 1e-3, 1e-4, 1e-5, 1e-6])
@pytest.mark.parametrize("factor", [1.5, -1.0, 0.0])
@pytest.mark.sampled(3)
def test_a_fault_in_a_branch_for_small_angles_fails_in_the_state_where_it_is(
    near: float, factor: float
):
    def bias(q: Any, v: Any) -> Any:
        return CART.bias(q, v) * (factor if abs(q[0] - q[1]) <= near else 1.0)

    state = ([0.3, 0.3, -0.4], [0.5, -0.8, 0.9])
    model = given("cart") | {"bias": bias}
    for others in ([], [([0.5, -0.2, 0.4], [0.3, -0.6, 0.2])]):
        found = check_functions(**model, states=[state, *others])
        details = {one.claim: one.detail for one in found if one.verdict == "failed"}
        assert "bias-of-mass-matrix" in details
        jump = "bias jumps within 0.001 of this state"
        assert (jump in details["bias-of-mass-matrix"]) == (near <= 1e-3)


@pytest.mark.parametrize("away", [2.0**-22, 2.0**-20, 2.0**-14])
def test_a_jump_beyond_the_short_line_is_no_noise(away: float):
    def f(x: Any) -> Any:
        return np.sin(x) + (x > 0.4 + away)

    assert 0 < noise(f, np.array([0.4]), np.ones(1))[0] < 1e-15


@pytest.mark.sampled(3)
@pytest.mark.parametrize("near", [0.0, 1e-9, 1e-8, 3e-8, 1e-7])
def test_a_value_that_stands_alone_is_no_noise_beside_other_states_and_references(near: float):
    def M(q: Any) -> Any:
        return np.array([[3.0, np.sin(q[1])], [np.sin(q[1]), 1.0]])

    def B(q: Any, v: Any) -> Any:
        return np.array([np.cos(q[1]) * v[1] ** 2, 0.0])

    def wrong(q: Any, v: Any) -> Any:
        return B(q, v) * (1.5 if abs(q[1]) <= near else 1.0)

    right = EquationsOfMotion(2, M=M, bias=B, name="right")
    states = [([0.3, 0.0], [0.2, 0.7]), ([0.5, 0.4], [0.3, -0.6])]
    found = of(check_functions(2, M=M, bias=wrong, against=right, states=states), "failed")
    assert {"bias-of-mass-matrix", "bias-power", "reference"} <= found.keys()
    assert "row q[0]: 1.5 times the expected value" in found["bias-of-mass-matrix"]
    assert not of(check_functions(2, M=M, bias=B, against=right, states=states), "failed")
    T = {"T": lambda q, v: v @ M(q) @ v / 2, "states": states, "claims": ["kinetic-energy"]}
    scaled = check_functions(2, M=lambda q: M(q) * (1.5 if abs(q[1]) <= near else 1.0), **T)
    assert "kinetic-energy" in of(scaled, "failed")
    assert "kinetic-energy" in of(check_functions(2, M=M, **T), "passed")


def noises(f: Any) -> float:
    return float(noise(lambda x: np.array(f(x[0])), np.zeros(1), np.ones(1)))


@pytest.mark.parametrize("away", [1e-3, 1.0, 1e3])
def test_the_noise_of_a_function_is_that_without_a_value_that_stands_alone(away: float):
    def alone(x: Any) -> Any:
        return np.cos(x) + away * (x == 0.0)

    plain = noises(np.cos)
    assert plain < 1e-15
    assert noises(alone) == pytest.approx(plain, abs=1e-15)
    branch = noises(lambda x: np.cos(x) + away * (abs(x) < 3e-8))
    assert branch < 1e-14


def test_a_value_within_the_noise_of_others_does_not_stand_alone():
    random = np.random.default_rng(0)
    rough = {x: 1e-9 * random.normal() for x in range(-3000, 3000)}

    def f(x: Any) -> Any:
        return np.cos(x) + rough[int(np.round(x * 2.0**26)) % 3000] + 1e-8 * (x == 0.0)

    assert noises(f) > 5e-10
    assert noises(np.sign) == noises(lambda x: np.sign(x) + 0.0)
    assert noises(np.abs) < 1e-3


@pytest.mark.parametrize("away", [1e-5, pytest.param(4e-4, marks=pytest.mark.night)])
def test_a_value_of_one_side_and_a_slope_of_the_other_are_reported_as_a_jump(away: float):
    def M(q: Any) -> Any:
        return CART.M(q) * (1.3 if q[0] > 0.3 + away else 1.0)

    state = ([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])
    found = check_functions(**(given("cart") | {"M": M, "qdd": None}), states=[state])
    texts = [one.detail for one in found if re.search(r"M jumps within 0\.001", one.detail)]
    assert texts
    right = check_functions(**given("cart"), states=[state])
    assert not any("jumps" in one.detail for one in right)


# ---- Tables and wide ranges ----------------------------------------------------------------------


def table(knots: int, seed: int, factor: float = 1.0) -> dict[str, Any]:
    """Return a force interpolated linearly between knots, and U, its exact integral."""
    x = np.linspace(-1.2, 1.2, knots)
    y = 3.0 * np.sin(2.0 * x + seed) + x + 1e-3 * np.random.default_rng(seed).normal(size=knots)
    below = np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])
    slope = np.diff(y) / np.diff(x)

    def energy(q: Any) -> Any:
        k = int(np.clip(np.searchsorted(x, q[0]) - 1, 0, knots - 2))
        h = q[0] - x[k]
        return factor * (below[k] + h * (y[k] + slope[k] * h / 2))

    return {"U": energy, "gravity": lambda q: [float(np.interp(q[0], x, y))]}


@pytest.mark.parametrize("knots", [11, 101, 501, 1001, 2001, 20001])
@pytest.mark.night
def test_tables_with_many_knots_pass_and_a_wrong_one_fails(knots: int):
    claim = "gravity-of-potential"
    for seed in range(3):
        assert not of(check_functions(1, **table(knots, seed), claims=[claim]), "failed")
        wrong = check_functions(1, **table(knots, seed, 1.0 + 1e-4), claims=[claim])
        assert of(wrong, "failed")


@pytest.mark.parametrize("far", [1e3, 1e5, 1e6])
@pytest.mark.night
def test_right_functions_of_wide_ranges_do_not_fail(far: float):
    found = check_functions(**given("cart"), ranges=(-far, far), states=10)
    assert not of(found, "failed")
