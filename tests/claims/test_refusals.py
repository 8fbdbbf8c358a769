"""Refusals are judged by a condition number of our own, and few states may be refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

from eomcheck.claims import CLAIMS, Case, Finding, State, numerical_accuracy
from eomcheck.claims.numerical_accuracy import SampledState, coverage, independent_rcond
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import Snake

AU = FORMULATIONS["au"]
ORDINARY = State(Q, V)


def judged(
    rcond: float, threshold: float, key: str = "au", scene: Snake = SNAKE, state: State = ORDINARY
) -> Finding:
    """Return the Finding on a refusal of a state that says this of itself."""

    class Refusing(Evaluation):
        def acceleration(self, formulation, pivoted=False):
            raise RefusedError("M_Au", rcond, threshold, "no")

    case = Case(Refusing(scene, *state), (FORMULATIONS[key],), (), CLAIMS["refusals"])
    (finding,) = case.evaluate(CLAIMS["refusals"])
    return finding


def independent() -> float:
    refusal = RefusedError("M_Au", 0.0, 0.0, "no")
    return independent_rcond(AU, refusal, Case(Evaluation(SNAKE, Q, V), (AU,), ()))


def test_a_refusal_of_what_is_well_conditioned_is_in_vain():
    finding = judged(0.0, 1e-14)
    assert (finding.verdict, finding.detail) == ("failed", "au, M_Au: refused in vain")
    assert 1e-6 < finding.observed < 1.0


@pytest.mark.parametrize(("times", "verdict"), [(0.1, "failed"), (10.0, "passed")])
def test_a_refusal_above_its_threshold_is_in_vain(times: float, verdict: str):
    assert judged(0.0, times * independent()).verdict == verdict


@pytest.mark.parametrize(
    ("rcond", "verdict"), [(1.0, "passed"), (31.0, "inconclusive"), (34.0, "failed")]
)
def test_what_rounding_decides_is_inconclusive(rcond: float, verdict: str):
    refusal = RefusedError("M_Au", 0.0, EPS, "no")
    assert numerical_accuracy.judge_refusal(refusal, rcond * EPS)[0] == verdict


@pytest.mark.parametrize(
    ("key", "verdict"),
    [("el", "passed"), ("em", "passed"), *((key, "failed") for key in ("au", "gw", "im", "uk"))],
)
def test_singular_first_columns_justify_refusals_of_who_splits_coordinates_alone(key, verdict):
    straight = Snake([1, 1], [1, 1], [0.1, 0.1], [1], [0, 0])
    state = State(*straight.initial_state())
    assert judged(0.0, 1e-14, key, straight, state).verdict == verdict


def test_an_overflow_of_ordinary_numbers_is_in_vain():
    assert judged(math.nan, 0.0).verdict == "failed"


def share(refused: int, states: int) -> str:
    """Return the verdict on so many refused states, each by one formulation."""
    state = State(Q, V)
    drawn = [SampledState(SNAKE, state, ("el",) if i < refused else ()) for i in range(states)]
    finding = coverage(drawn)
    assert finding.observed == pytest.approx(refused / states)
    return finding.verdict


def test_coverage_fails_where_more_than_5_percent_are_refused():
    assert share(5, 100) == share(0, 20) == "passed"
    assert share(6, 100) == share(100, 100) == "failed"
    assert share(0, 19) == share(19, 19) == "inconclusive"


def test_coverage_is_open_where_a_stratum_has_no_solved_state():
    """4 states of 100 are few of all, and all that there are at rest."""
    q, _ = SNAKE.initial_state()
    moving, resting = State(q, np.ones(5)), State(q, np.zeros(5))
    drawn = [SampledState(SNAKE, moving, ())] * 96 + [SampledState(SNAKE, resting, ("em",))] * 4
    finding = coverage(drawn)
    assert finding.verdict == "inconclusive"
    assert finding.detail.endswith("em refused every state of motion at rest (4)")
    one_solved = [*drawn[:-1], SampledState(SNAKE, resting, ("el",))]
    assert coverage(one_solved).verdict == "passed"
    assert coverage([*drawn[50:]]).verdict == "failed"


def test_coverage_names_who_refused():
    finding = coverage([SampledState(SNAKE, State(Q, np.zeros(5)), ("el", "em"))] * 30)
    assert "0 of 30 ordinary states" in finding.detail
    assert "el refused 30; em refused 30" in finding.detail
    assert finding.detail.endswith(" and 8 more")
