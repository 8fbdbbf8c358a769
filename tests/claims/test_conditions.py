"""How close to singular a refused matrix is, from terms worked out by hand, and who refused."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

from eomcheck.claims import CLAIMS, Case, State, numerical_accuracy
from eomcheck.claims.finding import Finding
from eomcheck.claims.numerical_accuracy import SampledState, coverage, independent_rcond
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import CONTRADICTION
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.generic import EPS


def near_singular(delta: float) -> np.ndarray:
    """Return a mass matrix of singular values 2 - delta, 1 and delta."""
    M = np.eye(3)
    M[0, 1] = M[1, 0] = 1.0 - delta
    return M


def case_of(M: Any, a: Any = None, gamma: Any = None, **more: Any) -> Any:
    """Return a case of these terms."""
    n = len(M)
    terms = M, None, None, a, gamma, None
    partition = SimpleNamespace(dependent=np.array([1]), independent=np.array([0, 2]), kept=None)
    here = {"terms": terms, "v": np.ones(n), "F": np.ones(n), "partition": partition}
    scene = SimpleNamespace(n=n, r=0 if a is None else len(a))
    at = SimpleNamespace(**({"scene": scene, "independent_partition": partition} | here | more))
    return SimpleNamespace(at=at)


def rcond(case: Any, what: str = "M", refused: float = 0.0, key: str = "au") -> float:
    refusal = RefusedError(what, refused, 0.0, "no")
    return independent_rcond(FORMULATIONS[key], refusal, case)


@pytest.mark.parametrize("delta", [0.25, 1e-9])
def test_a_mass_matrix_is_as_singular_as_its_singular_values_say(delta: float):
    M = near_singular(delta)
    assert rcond(case_of(M)) == pytest.approx(delta / (2 - delta) / 3, rel=1e-6)
    units = np.diag([1.0, 1.0, 2.0**40])
    assert rcond(case_of(units @ M @ units)) == pytest.approx(delta / (2 - delta) / 3, rel=1e-6)


def test_constraints_that_nearly_depend_are_singular_beside_any_mass_matrix():
    a = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 1e-4]])
    found = rcond(case_of(np.eye(3), a, np.zeros(2)))
    assert found == pytest.approx(0.5 * 1e-4**2 / 2 / 5, rel=0.01)  # of five unknowns
    assert rcond(case_of(np.eye(3), a[:1], np.zeros(1))) > 0.05


def test_of_rows_that_follow_from_others_only_those_that_are_kept_count():
    a = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    kept = SimpleNamespace(dependent=np.array([1]), kept=np.array([0]))
    case = case_of(np.eye(3), a, np.zeros(2), independent_partition=kept)
    redundant = next(f.key for f in FORMULATIONS.values() if f.redundant and not f.partitioned)
    assert rcond(case, key=redundant) > 0.05
    rigid = [f.key for f in FORMULATIONS.values() if not (f.redundant or f.partitioned)]
    for key in rigid:
        if FORMULATIONS[key].uses == "terms" and not FORMULATIONS[key].in_speeds:
            assert rcond(case, key=key) < EPS


@pytest.mark.parametrize("small", [0.5, 1e-7])
def test_the_first_columns_count_for_who_splits_coordinates(small: float):
    a = np.array([[1.0, small, 0.0]])
    case = case_of(np.eye(3), a, np.zeros(1))
    assert rcond(case, key="el") == rcond(case, key="em")
    # The dependent velocity is 1/small of what is independent, and enters by its square.
    assert rcond(case, key="el") <= 2 * small**2
    assert rcond(case, key="au") > 0.05


@pytest.mark.parametrize(
    ("delta", "more", "expected"),
    [
        (0.5, {}, 1.0),
        (0.5, {"v": np.array([1.0, 1e101, 1.0])}, 0.0),
        (0.5, {"F": np.array([1.0, 1.0, -1e101])}, 0.0),
        (0.5, {"v": np.full(3, 1e99)}, 1.0),
        (1e-16, {}, 0.0),
        (1e-13, {}, 1.0),
    ],
)
def test_an_overflow_is_justified_by_large_numbers_or_by_a_singular_matrix(delta, more, expected):
    assert rcond(case_of(near_singular(delta), **more), refused=math.nan) == expected


def test_contradictions_are_measured_against_what_rounding_explains():
    """Rows that say the same velocity and rates that differ by a tenth of their size."""
    kept = SimpleNamespace(dependent=np.array([1]), kept=np.array([0]))

    def share(gamma: list[float], times: float = 1.0) -> float:
        rows = np.array([[3.0, 0.0, 0.0], [3.0 * times, 0.0, 0.0]])
        given = np.array(gamma) * (1.0, times)
        return rcond(case_of(np.eye(3), rows, given, independent_partition=kept), CONTRADICTION)

    # The part of gamma that no v̇ takes away is half of the difference, in each.
    some, same = allowed_error(1.1) / 0.05, allowed_error(1.0)
    assert share([1.0, 1.1]) == pytest.approx(some, rel=1e-6, abs=0)
    assert share([1.0, 1.1], 1024.0) == pytest.approx(some, rel=1e-6, abs=0), "in other units"
    assert share([1.0, -1.0]) == pytest.approx(same, rel=1e-6, abs=0)
    assert share([2.0, 2.0]) > 1.0


def chain_of(**more: Any) -> Any:
    here = {
        "mass": np.array([2.0, 3.0, 5.0, 7.0, 11.0, 13.0]),
        "force": np.array([1.0, -1.0, 2.0, 0.5, 3.0, -2.0]),
        "before": np.array([[[1.0, 2.0], [3.0, 4.0]], [[9.0, 10.0], [11.0, 12.0]]]),
        "after": np.array([[[5.0, 6.0], [7.0, 8.0]], [[13.0, 14.0], [15.0, 16.0]]]),
        "rest": np.array([[0.5, 0.25], [0.75, 1.5]]),
    }
    return SimpleNamespace(**(here | more))


def test_joints_of_a_chain_stand_in_the_columns_of_their_two_bodies():
    assert numerical_accuracy._joints(chain_of()).tolist() == [
        [1.0, 2.0, 5.0, 6.0, 0.0, 0.0],
        [3.0, 4.0, 7.0, 8.0, 0.0, 0.0],
        [0.0, 0.0, 9.0, 10.0, 13.0, 14.0],
        [0.0, 0.0, 11.0, 12.0, 15.0, 16.0],
    ]


def test_a_chain_is_even_where_all_rows_of_its_equations_are_of_one_size():
    """One body with no joint: D ẋ = f, so that each row is |f| twice, of rows of one size."""
    none = np.zeros((0, 2, 2))
    free = {"before": none, "after": none, "rest": np.zeros((0, 2))}
    even = chain_of(mass=np.array([1.0, 1.0]), force=np.array([3.0, -3.0]), **free)
    assert numerical_accuracy._row_evenness(even) == pytest.approx(1.0)
    uneven = chain_of(mass=np.array([1.0, 1.0]), force=np.array([3.0, -0.75]), **free)
    assert numerical_accuracy._row_evenness(uneven) == pytest.approx(0.25)
    still = chain_of(mass=np.array([1.0, 1.0]), force=None, **free)
    assert numerical_accuracy._row_evenness(still) == 1.0


def test_what_is_known_to_so_much_only_may_be_as_singular_as_that():
    matrix = np.diag([4.0, 2.0, 1.0])
    assert numerical_accuracy._rcond(matrix) == pytest.approx(0.25 / 3)
    assert numerical_accuracy._rcond(matrix, 0.25) == pytest.approx(0.75 / 4 / 3)
    assert numerical_accuracy._rcond(matrix, 2.0) == 0.0
    assert numerical_accuracy._rcond(np.zeros((0, 3))) == 1.0
    assert numerical_accuracy._rcond(np.zeros((2, 3))) == 0.0
    for bad in (np.nan, np.inf):
        assert numerical_accuracy._rcond(np.array([[1.0, bad], [0.0, 1.0]])) == 0.0


# ---- What is said --------------------------------------------------------------------------------


@pytest.mark.parametrize(("threshold", "verdict"), [(0.5, "passed"), (1e-14, "failed")])
def test_a_refusal_is_told_with_its_own_threshold_and_an_independent_number(threshold, verdict):
    class Refusing(Evaluation):
        def acceleration(self, formulation, pivoted=False):
            raise RefusedError("M_Au", 0.25, threshold, "it is so")

    au = FORMULATIONS["au"]
    case = Case(Refusing(SNAKE, Q, V), (au,), ())
    (found,) = case.evaluate(CLAIMS["refusals"])
    own = independent_rcond(au, RefusedError("M_Au", 0.25, threshold, ""), case)
    assert (found.observed, found.allowed, found.verdict) == (own, threshold, verdict)
    said = {"passed": "it is so", "failed": "au, M_Au: refused in vain"}
    assert (found.subject, found.detail) == ("au", said[verdict])


def test_coverage_says_how_many_who_and_where():
    states = [State(Q + i, V) for i in range(40)]
    refused = {3: ("el", "em"), 8: ("em",)}
    drawn = [SampledState(SNAKE, state, refused.get(i, ())) for i, state in enumerate(states)]
    assert coverage(drawn) == Finding(
        "coverage",
        "all",
        SNAKE,
        states[3],
        0.05,
        0.05,
        "passed",
        "property-tested: 40 states",
        "38 of 40 ordinary states solved by all formulations; el refused 1; em refused 2",
    )
    solved = coverage(drawn[10:])
    assert (solved.state, solved.observed, solved.verdict) == (states[10], 0.0, "passed")
    assert solved.detail == "30 of 30 ordinary states solved by all formulations"
