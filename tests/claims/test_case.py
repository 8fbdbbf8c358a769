"""One state in doubles: what a claim compares there, and how much it allows."""

from __future__ import annotations

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V
from tests.evaluation.test_acceleration import stretched

import eomcheck
from eomcheck.claims import Case
from eomcheck.claims.registry import CLAIMS, Claim, Comparison
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.scenes import Snake

NAMES = (SNAKE.coordinate_names,)
EXPECTED = np.array([1.0, -2.0, 3.0, 0.5, 4.0])


@pytest.fixture
def case() -> Case:
    return Case(Evaluation(SNAKE, Q, V), (), (), CLAIMS["bias"])


@pytest.mark.parametrize("row", range(5))
def test_a_difference_beyond_what_is_allowed_fails_and_one_within_it_passes(case: Case, row: int):
    for times, verdict in ((10.0, "failed"), (0.1, "passed")):
        found = EXPECTED.copy()
        found[row] += times * allowed_error(4.0)
        finding = case.compare("x", found, EXPECTED, 4.0, names=NAMES)
        assert finding.verdict == verdict
        assert finding.ratio == pytest.approx(times, rel=0.1)


def test_one_wrong_entry_is_enough(case: Case):
    found = EXPECTED.copy()
    found[3] = 7.0
    finding = case.compare("x", found, EXPECTED, 4.0, names=NAMES)
    assert (finding.verdict, finding.observed) == ("failed", 6.5)
    assert finding.detail.startswith("bias, row θ_2")


def test_what_is_compared_is_sized_by_what_it_should_be(case: Case):
    """One percent of it is allowed, and nothing is checked, however large ours is."""
    one_percent = 0.01 * 4.0 / allowed_error(1.0)
    assert (
        case.compare("x", 1e4 * EXPECTED, EXPECTED, one_percent, names=NAMES).verdict
        == "inconclusive"
    )


def test_what_should_be_no_number_is_inconclusive(case: Case):
    expected = EXPECTED.copy()
    expected[0] = np.nan
    for found in (EXPECTED, expected):
        assert case.compare("x", found, expected, 4.0, names=NAMES).verdict == "inconclusive"


def test_measured_sides_are_allowed_no_more_than_their_rounding():
    """Numbers that are read: each side moves by its size once, and once more by the step."""

    def sides(at, look):
        yield Comparison("mass", at.parameters.mass, at.parameters.mass, (("1", "2", "3"),))

    claim = Claim("own", "m = m", "", "mass", sides=sides)
    (finding,) = Case(Evaluation(SNAKE, Q, V), (), ()).evaluate(claim)
    size = largest(SNAKE.mass)
    assert 2 * allowed_error(size) < finding.allowed <= 4.01 * allowed_error(size)


def test_a_term_of_an_engine_is_allowed_no_more_than_its_rounding():
    found = eomcheck.check_state(SNAKE, Q, V, claims=["mass-matrix", "bias", "constraint-jacobian"])
    compared = [finding for finding in found if finding.evidence.startswith("compared")]
    assert {finding.claim for finding in compared} == {"mass-matrix", "bias", "constraint-jacobian"}
    assert all(finding.allowed < 1e-11 for finding in compared)


def test_what_is_allowed_does_not_depend_on_the_claims_looked_at_before():
    """Of invariance coordinates are perturbed too, of equivalence not."""
    alone, after = (
        eomcheck.check_state(SNAKE, Q, V, formulations=["au", "kane"], engines=[], claims=claims)
        for claims in (["invariance"], ["equivalence", "invariance"])
    )
    assert alone and alone[0].allowed > 0
    assert [x.allowed for x in after if x.claim == "invariance"] == [x.allowed for x in alone]


def test_a_pivoted_partition_is_looked_at_where_the_first_columns_are_singular():
    scene, q, v = stretched(3)
    found = eomcheck.check_state(scene, q, v, engines=[], claims=["null-space-embedding"])
    assert [(one.subject, one.verdict) for one in found] == [("em, pivoted", "passed")]


@pytest.mark.parametrize("power", [-60, 60])
def test_which_entries_of_a_mass_matrix_are_resolved_does_not_depend_on_units(power: int):
    """That M_xy is 0 is seen of any two bodies, however light."""
    scale = 2.0**power
    scene = Snake(scale * SNAKE.mass, SNAKE.length, scale * SNAKE.inertia, None, SNAKE.wheel_angle)
    q = Q[: scene.n]
    (found,) = eomcheck.check_state(scene, q, 0 * q, engines=["casadi"], claims=["mass-matrix"])
    assert (found.verdict, found.detail) == ("passed", "")
    assert found.entries is not None and found.entries.count_hidden == 0
