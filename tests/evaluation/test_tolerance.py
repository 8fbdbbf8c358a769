"""The constants that every verdict and every error bound rests on, by what they promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eomcheck
from eomcheck.claims.finding import judge
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import true_acceleration
from eomcheck.evaluation.dynamics import _check_digits
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import C, allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.noise import STEP
from eomcheck.scenes import Snake

PAPER = Snake.paper()
Q, _ = PAPER.initial_state()
U = [1.0, 0.5]


@pytest.fixture(scope="module")
def largest_ratio() -> float:
    """Return the largest true error / (κ ε scale) over some ordinary states."""
    ratios = []
    for scene, (q, v, t) in scene_cases(Snake, (1, 12), 30, 0):
        for key in FORMULATIONS:
            try:
                u = eomcheck.speeds_of(scene, q, v, t)
                ratios.append(eomcheck.accuracy(scene, key, q, u, t).ratio)
            except RefusedError:
                continue
    return float(np.nanmax(ratios))


@pytest.mark.night
def test_the_constant_is_above_what_is_measured(largest_ratio: float):
    assert largest_ratio < C


@pytest.mark.night
def test_the_constant_is_less_than_two_decades_above_what_is_measured(largest_ratio: float):
    assert largest_ratio > C / 100


@pytest.mark.parametrize("observed", [0.0, 1e-3])
def test_a_bound_of_one_percent_checks_nothing(observed: float):
    assert judge(observed, 0.01 / allowed_error(1.0), 1.0)[1] == "inconclusive"


def test_six_digits_are_promised():
    found = replace(eomcheck.accuracy(PAPER, "kane", Q, U), relative_bound=1e-12)
    assert replace(found, relative=2e-6).silently_wrong
    assert not replace(found, relative=5e-7).silently_wrong


def test_the_truth_has_twice_the_digits_of_doubles():
    truth, _ = true_acceleration(PAPER, Q, U)
    assert truth.digits >= 30


def test_no_bound_is_below_what_underflows():
    """At rest and without springs every number is 0, whatever would move it."""
    free = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], None, [0.1, -0.2])
    for key in FORMULATIONS:
        result = eomcheck.acceleration(free, key, [0, 0, 0.3, 1.1], np.zeros(4))
        assert not result.vdot.any()
        assert result.error_bound >= 2.0**-900


def test_a_velocity_of_which_six_digits_are_not_certain_is_refused():
    at = Evaluation(PAPER, Q, np.zeros(PAPER.n))

    def moved(share: float):
        return lambda e: 1.0 if e is at else 1.0 + share * STEP / allowed_error(1.0)

    _check_digits("v", at, moved(0.5e-6))
    with pytest.raises(RefusedError, match="v cancels"):
        _check_digits("v", at, moved(2e-6))
