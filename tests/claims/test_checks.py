from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st
from tests.samples import NOT_OF_SNAKES

import eomcheck
from eomcheck.claims import accelerations
from eomcheck.claims.confusions import diagnose
from eomcheck.claims.finding import entry_name, format_distinct, judge, worst_of
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.engines import ALWAYS
from eomcheck.errors import InconsistentVelocityError, InputError, UnknownNameError
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error
from eomcheck.mechanics.records import State
from eomcheck.scenes import Snake

SNAKE = Snake([1, 2, 1], [1, 0.5, 1], [0.1, 0.1, 0.2], [3, 4], [0.1, -0.2, 0.3])
Q = np.array([0.0, 0.0, 0.3, 0.8, -0.4])
V = eomcheck.velocity(SNAKE, Q, [1.0, 0.5])


@pytest.mark.parametrize(
    ("observed", "spread", "scale", "verdict"),
    [
        (0.0, 1.0, 1.0, "passed"),
        (allowed_error(1.0), 1.0, 1.0, "passed"),
        (1.01 * allowed_error(1.0), 1.0, 1.0, "failed"),
        (float("nan"), 1.0, 1.0, "failed"),
        (float("inf"), 1.0, 1.0, "failed"),
        (0.0, float("inf"), float("inf"), "inconclusive"),
        (1.0, float("inf"), 1.0, "inconclusive"),
        (0.0, float("nan"), 1.0, "inconclusive"),
        (1e-9, 1.1 * INCONCLUSIVE / allowed_error(1.0), 1.0, "inconclusive"),
        (0.0, 1.0, 0.0, "inconclusive"),
        (0.0, 0.0, 0.0, "passed"),
        (0.0, 1e-280, 0.0, "passed"),
        (1e-300, 0.0, 0.0, "inconclusive"),
        (1e-270, 0.0, 0.0, "failed"),
    ],
)
def test_a_verdict_follows_from_observed_allowed_and_size(observed, spread, scale, verdict):
    assert judge(observed, spread, scale)[1] == verdict


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda x: -x, "wrong sign"),
        (lambda x: 0 * x, "missing"),
        (lambda x: 2 * x, "twice the expected value"),
        (lambda x: x / 2, "half the expected value"),
        (lambda x: x.T, "transposed"),
        (lambda x: 1.1 * x, "4.4, expected 4"),
    ],
)
def test_a_diagnosis_says_what_is_wrong(change, says):
    x = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert diagnose(change(x), x, 1e-12) == says


def test_a_diagnosis_names_an_entry_that_should_vanish():
    assert diagnose(np.array([0.0, 1.0]), np.zeros(2), 1e-12) == "should vanish"


@pytest.mark.parametrize(
    ("x", "y", "said"),
    [
        (1.0, 2.0, ("1", "2")),
        (0.57735027, 0.57735031, ("0.57735027", "0.57735031")),
        (1.0, 1.0 + 2.0**-52, ("1", "1.0000000000000002")),
        (0.1, 0.1, ("0.1", "0.1")),
        (float("nan"), 1.0, ("nan", "1")),
    ],
)
def test_two_numbers_that_differ_are_printed_with_the_digits_in_which_they_do(x, y, said):
    assert format_distinct(x, y) == said
    if said == ("0.57735027", "0.57735031"):
        assert diagnose(np.array([x]), np.array([y]), 1e-12) == f"{said[0]}, expected {said[1]}"


def test_the_worst_entry_is_named_along_each_axis():
    error = np.array([[0.0, 0.1], [-0.3, 0.2]])
    assert entry_name(worst_of(error), (("x", "y"), ("a", "b"))) == "entry (y, a)"
    assert entry_name(worst_of(error[:, 1]), (("x", "y"),)) == "row y"


@pytest.mark.sampled(3)
@pytest.mark.parametrize("claim", eomcheck.CLAIMS)
def test_every_claim_about_snakes_finds_something_on_an_ordinary_state(claim):
    findings = eomcheck.check_state(SNAKE, Q, V, claims=[claim])
    if claim in {"refusals", "coverage"} | NOT_OF_SNAKES:
        (skipped,) = findings
        assert (skipped.claim, skipped.verdict) == (claim, "skipped")
        assert skipped.detail == f"needs {eomcheck.CLAIMS[claim].requirements}"
        return
    assert findings
    assert {finding.claim for finding in findings} == {claim}
    assert {finding.verdict for finding in findings} == {"passed"}
    assert all(0 <= finding.ratio <= 1 for finding in findings)


def test_findings_about_engines_name_their_version():
    compared = [f for f in eomcheck.check_state(SNAKE, Q, V) if f.evidence.startswith("compared")]
    versions = {eomcheck.ENGINES[key].version() for key in ALWAYS}
    assert {finding.evidence.removeprefix("compared: ") for finding in compared} == versions


def test_without_engines_nothing_is_compared_and_the_rest_still_holds():
    findings = eomcheck.check_state(SNAKE, Q, V, engines=[])
    assert findings
    assert not [f for f in findings if f.evidence.startswith("compared")]
    assert all(finding.verdict == "passed" for finding in findings)


def test_check_refuses_a_velocity_that_violates_the_constraints():
    with pytest.raises(InconsistentVelocityError, match="wheel"):
        eomcheck.check_state(SNAKE, Q, V + 0.1)
    assert eomcheck.check_state(SNAKE, Q, V + 0.1, consistent=False)


@pytest.mark.parametrize("name", ["formulations", "engines", "claims"])
def test_unknown_names_are_refused(name):
    with pytest.raises(UnknownNameError, match="'nonsense'"):
        eomcheck.check_state(SNAKE, Q, V, **{name: ["nonsense"]})


def test_validate_refuses_no_examples():
    with pytest.raises(InputError, match="examples = 0"):
        eomcheck.validate(SNAKE, examples=0)


def test_validate_covers_the_initial_state_and_the_drawn_ones():
    findings = eomcheck.validate(SNAKE, examples=4, engines=[])
    assert len({id(finding.state.q) for finding in findings}) == 5
    assert np.array_equal(findings[0].state.q, SNAKE.initial_state()[0])
    assert {finding.verdict for finding in findings if finding.claim != "coverage"} == {"passed"}
    (coverage,) = [finding for finding in findings if finding.claim == "coverage"]
    assert coverage.verdict == "inconclusive", "4 states say nothing about 5 %"


@pytest.mark.night
def test_a_justified_refusal_of_the_initial_state_is_no_failure():
    stretched = Snake([1, 1], [1, 1], [0.1, 0.1], [1], [0, 0])
    findings = eomcheck.validate(stretched, examples=25, engines=[])
    assert [f.subject for f in findings if f.claim == "refusals"][:2] == ["el", "em"]
    assert not [finding for finding in findings if finding.verdict == "failed"]


@pytest.mark.night
def test_hopeless_states_are_inconclusive_not_passed():
    snake = Snake.pattern(60)
    q, _ = snake.initial_state()
    at_60 = eomcheck.check_state(snake, q, eomcheck.velocity(snake, q, [1.0, 0.5]), engines=[])
    assert not [finding for finding in at_60 if finding.verdict == "failed"]
    open_ = {finding.claim for finding in at_60 if finding.verdict == "inconclusive"}
    assert "equivalence" in open_
    for finding in at_60:
        assert np.isfinite(finding.allowed) or finding.verdict == "inconclusive"


def test_a_run_stops_at_a_failure_and_shrinks_it():
    class Wrong(Snake):
        @staticmethod
        def terms(*arguments):
            terms = Snake.terms(*arguments)
            return terms._replace(B=-terms.B)

    def build(links, omega):
        scene = Wrong([1.0] * links, [1.0] * links, [0.1] * links, None, [0.0] * links)
        q = np.concatenate(([0.0, 0.0], 0.5 * np.arange(links) + 0.5))
        return scene, State(q, eomcheck.velocity(scene, q, [0.0, omega]))

    cases = st.builds(build, st.integers(1, 4), st.floats(0.5, 2.0))
    run, selection = ValidationRun(), RunSelection.of(engines=["casadi"])
    run.explore([build(3, 1.0)], selection, shrink_among=lambda failed: cases)
    assert run.minimal is not None
    assert run.minimal.claim == "bias"
    assert "bias, row" in run.minimal.detail and "sign" in run.minimal.detail
    assert run.minimal.scene.n == 3, "one link is enough"
    assert run.finish(selection)[-1] is run.minimal
    assert run.cases == 1, "states met while shrinking are not counted"


def test_a_finding_is_plain_data_and_python_code():
    finding = eomcheck.check_state(SNAKE, Q, V, claims=["mass-matrix"])[0]
    data = finding.as_dict()
    assert data["q"] == Q.tolist() and data["v"] == V.tolist()
    scope: dict = {}
    exec(finding.as_python(), scope)
    assert repr(scope["scene"]) == repr(SNAKE)
    assert scope["q"] == Q.tolist()


@pytest.mark.parametrize("told", [True, False])
def test_machine_code_without_a_number_fails_where_digits_are_left(told, monkeypatch):
    monkeypatch.setattr(
        accelerations,
        "acceleration_in_machine_code",
        lambda at, formulation, y: np.full(at.scene.n, np.nan),
    )
    inertia = 0.1 if told else 0.0
    scene = Snake([1.134958547696148], [0.9995432422242448], [inertia], None, [0.0])
    q = np.full(3, -2.7465461956438726)
    found = eomcheck.check_state(scene, q, np.zeros(3), engines=[], claims=["machine-code"])
    verdicts = {f.subject: f.verdict for f in found}
    assert verdicts["ml"] == ("failed" if told else "inconclusive")


def test_machine_code_without_a_quotient_of_a_subnormal_entry_is_said_to_overflow():
    mass, length = (0.0004329230760201283, 0.0055295506018819135), (0.0004329230760201283, 1.0)
    scene = Snake(mass, length, [46841.133322153655] * 2, None, [0.0, -2.225073858507203e-309])
    found = eomcheck.check_state(
        scene, np.zeros(4), np.zeros(4), engines=[], claims=["machine-code"]
    )
    (el,) = (f for f in found if f.subject == "el")
    assert (el.verdict, el.detail) == ("inconclusive", "overflows in machine code: NaN")
