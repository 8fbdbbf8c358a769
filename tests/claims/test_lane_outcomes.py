"""Outcomes in lanes: ratios, verdicts where something is refused, and what goes side by side."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.claims import State
from eomcheck.claims.batched_claims import (
    ABSENT,
    BatchedCase,
    BatchResult,
    batchable_claims,
    batched_cases,
)
from eomcheck.claims.finding import FAILED_CODE, INCONCLUSIVE_CODE, PASSED_CODE
from eomcheck.claims.registry import CLAIMS, Comparison
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.scenes import ChainPendulum, Sleigh, Snake

ALL = tuple(FORMULATIONS.values())


def test_ratios_are_those_of_what_is_decided():
    observed = np.array([3.0, 1.0, 1e-3, 0.0, np.nan, 7.0, 7.0, np.inf])
    allowed = np.array([2.0, 4.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    verdict = np.array(
        [
            FAILED_CODE,
            PASSED_CODE,
            FAILED_CODE,
            PASSED_CODE,
            FAILED_CODE,
            INCONCLUSIVE_CODE,
            ABSENT,
            FAILED_CODE,
        ]
    )
    inf = np.inf
    found = BatchResult("bias", "au", observed, allowed, verdict).ratio
    assert found.tolist() == [1.5, 0.25, inf, 0.0, inf, 0.0, 0.0, inf]


def lanes() -> BatchedCase:
    """Return three states of one sleigh side by side."""
    scene, random = Sleigh(), np.random.default_rng(0)
    states = [State(random.uniform(0.1, 1.0, 3), np.zeros(3)) for _ in range(3)]
    ((_, case),) = batched_cases([(scene, state) for state in states], ALL)
    return case


def compared(
    found: Any, expected: Any, absent: Any, scale: Any = None, each: Any = 1.0
) -> BatchResult:
    sides = Comparison("au ~ kane", found, expected, (("a", "b"),))
    sensitivity = np.array([1.0, 10.0, 0.1]) * each / allowed_error(1.0)
    return lanes().compare(CLAIMS["bias"], sides, sensitivity, scale, np.array(absent))


NO = [False] * 3


def test_each_lane_is_judged_by_its_own_numbers():
    expected = BatchArray(np.array([[2e3, 1.0], [2e5, 5.0], [9.0, 4e2]]))
    found = BatchArray(expected.data + np.array([[0.0, 1.5], [3.0, 0.0], [0.0, 0.05]]))
    one = compared(found, expected, NO)
    assert one.observed == pytest.approx([1.5, 3.0, 0.05])
    assert one.allowed == pytest.approx([1.0, 10.0, 0.1])
    assert one.verdict.tolist() == [FAILED_CODE, PASSED_CODE, PASSED_CODE]
    small = np.array([1.0, 1.0, 1.0]) / INCONCLUSIVE
    by_scale = compared(found, expected, NO, small)
    assert by_scale.verdict.tolist() == [FAILED_CODE, INCONCLUSIVE_CODE, PASSED_CODE]


def test_what_is_refused_is_absent_unless_it_is_told_all_the_same():
    expected = BatchArray(np.array([[2e3, 1.0], [2e5, np.nan], [9e2, 1.0]]))
    found = BatchArray(np.array([[np.nan, 1.0], [2e5, 5.0], [9e2, 1.0]]))
    assert compared(found, expected, NO).verdict.tolist() == [
        FAILED_CODE,
        INCONCLUSIVE_CODE,
        PASSED_CODE,
    ]
    refused = compared(found, expected, [True, True, True])
    assert refused.verdict.tolist() == [ABSENT, ABSENT, PASSED_CODE]
    some = compared(found, expected, [False, True, False])
    assert some.verdict.tolist() == [FAILED_CODE, ABSENT, PASSED_CODE]
    # What is no number of lanes says nothing of a lane that refuses.
    has = compared(np.array([1e4, 1e4]), np.array([1e4, 1e4]), [True, False, False])
    assert has.verdict.tolist() == [ABSENT, PASSED_CODE, PASSED_CODE]


@pytest.mark.parametrize(
    ("subject", "refused"),
    [
        ("au ~ em", [True, False, False]),
        ("em ~ au", [True, False, False]),
        ("ml ~ au", [False, True, False]),
        ("em ~ ml", [True, True, False]),
        ("au, q̈", [False, False, False]),
        ("em, drawn", [True, False, False]),
        ("au, theorem", [False, False, False]),
        ("au ~ kane", [False, False, True]),
    ],
)
def test_a_subject_is_refused_where_any_formulation_that_it_names_refuses(subject, refused):
    case = lanes()
    by = {"em": [True, False, False], "ml": [False, True, False], "kane": [False, False, True]}
    case.refused = lambda key: np.array(by.get(key, NO))  # type: ignore[method-assign]
    assert case._refused_in(subject).tolist() == refused


def test_a_state_refused_inside_the_sides_of_a_claim_is_absent_and_the_others_are_decided():
    """The dependent velocity is ẋ, and the wheel rolls along x: the 1 x 1 matrix a_1 is 0."""
    states = [State(np.array([0.1, 0.2, angle]), np.zeros(3)) for angle in (0.3, 0.0, 1.2)]
    ((_, case),) = batched_cases([(Sleigh(), state) for state in states], ALL)
    (result,) = case.evaluate(["null-space-embedding"])
    assert result.verdict.tolist() == [PASSED_CODE, ABSENT, PASSED_CODE]


def test_cases_of_one_structure_go_side_by_side_and_keep_their_places():
    two, three = ChainPendulum.rods(2), ChainPendulum.rods(3)
    snake, sprung = (Snake([1, 2], [1, 1], [1, 1], x, [0.1, 0.2]) for x in (None, [3.0]))
    order = [three, two, snake, two, three, two, sprung]
    cases = [
        (one, State(np.full(one.n, 0.2), np.full(one.n, float(i)))) for i, one in enumerate(order)
    ]
    found = {tuple(places.tolist()): case for places, case in batched_cases(cases, ALL)}
    assert set(found) == {(0, 4), (1, 3, 5), (2,), (6,)}
    for places, case in found.items():
        assert case.at.v.data[:, 0].tolist() == [float(i) for i in places]
        assert case.formulations == tuple(f for f in ALL if f.applies_to(order[places[0]]))


def test_what_is_looked_at_in_lanes_has_sides_and_no_engine():
    asked = ["coverage", "invariance", "equivalence", "bias", "engine-acceleration", "refusals"]
    assert batchable_claims(asked) == ("invariance", "equivalence")
    assert batchable_claims(["kinetic-energy"]) == ("kinetic-energy",)
