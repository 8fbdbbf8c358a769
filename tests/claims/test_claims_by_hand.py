"""Smaller failures, blame, redundant rows and readers of files, of data that are written down."""

from __future__ import annotations

import inspect
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import find
from hypothesis import strategies as st

from eomcheck.claims import CLAIMS, Finding, State, accelerations, run, user_scenes
from eomcheck.claims.accelerations import redundant_rows
from eomcheck.claims.case import ONCE
from eomcheck.claims.registry import Comparison, Skipped
from eomcheck.claims.run import (
    TRIES,
    cause_of,
    diagnosis_of,
    evaluate_claim,
    no_larger,
    smallest_failure,
    states_of,
)
from eomcheck.claims.user_scenes import scene_function_that_raised
from eomcheck.errors import CallError, RefusedError
from eomcheck.lab.fuzzing.motion_comparison import END_STATES
from eomcheck.scenes import Sleigh, Snake

SLEIGH = Sleigh.example()
ENGINE = next(one for one in CLAIMS if CLAIMS[one].asks)


def at(k: float) -> State:
    """Return a state by one number."""
    return State(np.full(3, float(k)), np.zeros(3), 0.0)


def finding(verdict: Any = "failed", k: float = 99, **more: Any) -> Finding:
    """Return a finding in a state of this number."""
    usual = {"claim": "bias", "subject": "au", "scene": SLEIGH, "state": at(k)}
    numbers = {"observed": 1.0, "allowed": 0.5, "verdict": verdict, "evidence": "made up"}
    return Finding(**(usual | numbers | more))


# ---- Smaller failures ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "links", "most"),
    [
        (Snake.coil(5), (1, 3), 3),
        (Snake.coil(5), (1, 7), 5),
        (Snake.coil(5), (6, 7), 6),
        (SLEIGH, (2, 9), 9),
    ],
)
def test_smaller_scenes_have_no_more_links_than_there_are_and_than_were_asked_for(
    monkeypatch, scene, links, most
):
    monkeypatch.setattr(run.strategies, "scenes", lambda *of: of)
    monkeypatch.setattr(run.strategies, "scene_states", lambda of: of)
    assert no_larger(scene, links) == (type(scene), links[0], most)


def test_states_of_a_scene_are_drawn_with_that_scene(monkeypatch):
    monkeypatch.setattr(run.strategies, "states", lambda scene: st.just(("of", scene)))
    assert find(states_of(SLEIGH), lambda case: True) == (SLEIGH, ("of", SLEIGH))


@pytest.fixture
def judged(monkeypatch) -> list[tuple]:
    """Have claims fail from state number 17 on, beside what is open or passes."""
    seen: list[tuple] = []

    def of(asked: Any, case: Any, claim: Any) -> list[Finding]:
        (scene, selection), (state, again) = asked, case
        seen.append((scene, selection, again, claim))
        k = state.q[0]
        first = finding("inconclusive", k)
        return [first, finding("failed" if k >= 17 else "passed", k), finding("failed", 7 * k)][
            : 3 if k >= 17 else 2
        ]

    monkeypatch.setattr(run, "make_scene_engines", lambda scene, selection: (scene, selection))
    monkeypatch.setattr(run, "make_case", lambda asked, state, selection, again: (state, again))
    monkeypatch.setattr(run, "evaluate_claim", of)
    return seen


def test_the_smallest_case_that_fails_is_found_and_its_first_failure_is_told(judged):
    cases = st.integers(0, 1000).map(lambda k: (SLEIGH, at(k)))
    selection: Any = "selection"
    found = smallest_failure(finding(), cases, selection, 3)
    assert (found.verdict, found.claim) == ("failed", "bias")
    assert found.state is not None and found.state.q.tolist() == [17.0] * 3
    assert set(judged) == {(SLEIGH, "selection", ONCE, CLAIMS["bias"])}


def test_a_failure_stays_where_none_is_found_or_no_case_can_be_drawn(judged):
    failed, selection = finding(), SimpleNamespace()
    assert smallest_failure(failed, st.builds(lambda: (SLEIGH, at(1))), selection, 0) is failed  # type: ignore[arg-type]
    judged.clear()
    few = st.integers(0, 16).map(lambda k: (SLEIGH, at(k)))
    assert smallest_failure(failed, few, selection, 0) is failed  # type: ignore[arg-type]
    assert 0 < len(judged) <= TRIES == 50
    none = few.filter(lambda case: case[1].q[0] > 20)
    assert smallest_failure(failed, none, selection, 0) is failed  # type: ignore[arg-type]


def test_no_case_is_checked_once_the_time_is_up(judged):
    failed, selection = finding(), SimpleNamespace()
    cases = st.integers(17, 1000).map(lambda k: (SLEIGH, at(k)))
    found = smallest_failure(failed, cases, selection, 0, lambda: True)  # type: ignore[arg-type]
    assert found is failed and not judged


def test_a_smaller_failure_has_the_formulations_and_the_diagnosis_of_the_first(monkeypatch):
    """Numbers in a diagnosis and its row may differ."""
    details = {
        0: "bias, row x: half the expected value",
        10: "bias, row x: 1.5, expected 2",
        20: "bias, row y: wrong sign (every row)",
    }

    def of(asked: Any, case: Any, claim: Any) -> list[Finding]:
        k = case.q[0]
        detail = next(text for least, text in reversed(details.items()) if k >= least)
        return [finding(k=k, subject="em" if k < 5 else "au", detail=detail)]

    monkeypatch.setattr(run, "make_scene_engines", lambda scene, selection: None)
    monkeypatch.setattr(run, "make_case", lambda asked, state, selection, again: state)
    monkeypatch.setattr(run, "evaluate_claim", of)
    cases = st.integers(0, 100).map(lambda k: (SLEIGH, at(k)))
    selection: Any = "selection"
    for detail, least in (
        ("bias, row z: wrong sign", 20),
        ("bias, row z: -3.25e-07, expected 4", 10),
        ("bias, row x: half the expected value", 5),
        ("bias: transposed", 99),
    ):
        failed = finding(detail=detail)
        small = smallest_failure(failed, cases, selection, 0)
        assert small.state is not None and small.state.q[0] == least, detail


@pytest.mark.parametrize(
    ("claim", "subject", "cause"),
    [
        ("equivalence", "em ~ au", ["au", "em"]),
        ("kane-ml-mass", "kane: ml", ["kane", "ml"]),
        (ENGINE, "casadi ~ au", ["casadi"]),
        (ENGINE, "gw ~ mujoco", ["mujoco"]),
        (END_STATES, "em", ["em"]),
        ("bias-of-mass-matrix", "bias", ["bias"]),
    ],
)
def test_causes_are_formulations_or_the_engine_alone(claim, subject, cause):
    assert cause_of(finding(claim=claim, subject=subject)) == cause


@pytest.mark.parametrize(
    ("detail", "diagnosis"),
    [
        ("bias, row θ_1: wrong sign", "wrong sign"),
        ("bias, row θ_1: wrong sign (every row)", "wrong sign"),
        ("bias: row x: half the expected value", "half the expected value"),
        ("bias, row θ_1: got 1.25, expected 1.5", ""),
        ("no numbers at all", ""),
        ("", ""),
    ],
)
def test_a_diagnosis_is_what_is_wrong_without_numbers_and_rows(detail, diagnosis):
    assert diagnosis_of(finding(detail=detail)) == diagnosis


# ---- Which function raised -----------------------------------------------------------------------


class Own(Sleigh):
    """A scene of which functions raise."""

    @staticmethod
    def first() -> Any:
        return Own.second()

    @staticmethod
    def second() -> Any:
        return np.linalg.solve(np.zeros((1, 1)), np.ones(1))


class Further(Own):
    """A scene that inherits them."""


def test_the_last_function_of_a_file_of_its_own_that_an_error_came_through_is_named():
    with pytest.raises(np.linalg.LinAlgError) as error:
        Further.first()
    said = scene_function_that_raised(Further.example(), error.value)
    line = inspect.unwrap(Own.second).__code__.co_firstlineno + 2
    where = f"(test_claims_by_hand.py, line {line})"
    assert said == f"Further.second raised LinAlgError: Singular matrix {where}"
    made = {"<string>"}  # by dataclasses
    assert user_scenes._source_files(Further) - made == {__file__}
    assert user_scenes._source_files(Sleigh) <= made
    assert scene_function_that_raised(SLEIGH, error.value) == ""


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Further.terms", "Further.terms gave no answer in 60 s"),
        ("Own.terms", "Own.terms gave no answer in 60 s"),
        ("Engine.bias", ""),
        ("Furthermore.terms", ""),
    ],
)
def test_a_call_that_did_not_answer_is_of_the_scene_whose_name_it_has(name, said):
    scene = Further.example()
    assert scene_function_that_raised(scene, CallError(name, "gave no answer in 60 s")) == said
    assert scene_function_that_raised(scene, ValueError(name)) == ""


# ---- The library that reads the file -------------------------------------------------------------


class Reader:
    """A library that reads a file, and leaves out what `explain` has."""

    key = "reader"
    reasons: dict[str, str] = {"forces": "it leaves out dampers"}  # noqa: RUF012

    def leaves_out(self, method: str) -> str:
        """Return why."""
        return self.reasons.get(method, "")


def told(asked: Any, claim: Any, findings: list[Finding], monkeypatch) -> list[Finding]:
    """Return what is told of these findings."""
    case: Any = SimpleNamespace(evaluate=lambda one: findings if one is claim else [])
    skipped = finding("skipped", detail="", subject="?")
    monkeypatch.setattr(
        run,
        "skipped_finding",
        lambda of, kind, why: replace(skipped, engine=kind, detail=why) if of is case else None,
    )
    return evaluate_claim(asked, case, claim)


def test_what_the_library_of_a_file_fails_is_of_either_reading_and_what_it_leaves_out_is_skipped(
    monkeypatch,
):
    found = [
        finding("failed", subject="reader", engine=Reader, detail="half"),
        finding("passed", subject="reader, again", engine=Reader, detail="fine"),
        finding("failed", subject="other", engine=Own, detail="half"),
        finding("failed", subject="au", detail="half"),
    ]
    asked: Any = SimpleNamespace(reader=Reader(), failed_reader=None)
    claim: Any = SimpleNamespace(asks="bias")
    one, *others = told(asked, claim, found, monkeypatch)
    either = "the file is read in two ways: either reading may be wrong"
    assert one == replace(found[0], detail=f"half; {either}") and others == found[1:]
    claim.asks = "forces"
    one, *others = told(asked, claim, found, monkeypatch)
    assert (one.subject, one.verdict, one.engine) == ("reader", "skipped", Reader)
    assert one.detail == "it leaves out dampers" and others == found[1:]
    asked.reader = None
    assert told(asked, claim, found, monkeypatch) == found


def test_a_file_that_cannot_be_read_is_told_with_the_mass_matrix_alone(monkeypatch):
    asked: Any = SimpleNamespace(reader=None, failed_reader=(Reader, "no such mesh"))
    found = [finding("passed")]
    claim: Any = SimpleNamespace(asks="mass_matrix")
    first, last = told(asked, claim, found, monkeypatch)
    assert first is found[0]
    assert (last.engine, last.detail) == (Reader, "takes no part: no such mesh")
    for asks in ("", "bias"):
        claim.asks = asks
        assert told(asked, claim, found, monkeypatch) == found


# ---- Redundant rows ------------------------------------------------------------------------------


def test_a_row_that_follows_from_others_changes_neither_motion_nor_forces(monkeypatch):
    a = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -3.0]])
    gamma, M, F, v = np.array([5.0, 7.0]), np.eye(3), np.array([1.0, 2.0, 3.0]), np.zeros(3)
    weights, partition = np.array([2.0, -1.0]), "kept rows"
    solved: list[tuple] = []
    vdot, multipliers = np.array([4.0, 5.0, 6.0]), np.array([10.0, 20.0, 30.0])

    def at_solved(name: str, solution: Any, *given: Any) -> Any:
        solved.append((name, solution, *given))
        if solution == "refusing":
            raise RefusedError("a", 0.0, 1.0, "a has rows that follow from others")
        return (vdot, multipliers), "digits"

    def formulation(key: str, solution: str = "solution", takes: bool = True) -> Any:
        return SimpleNamespace(key=key, solution=solution, redundant=takes)

    x = SimpleNamespace(vdot=np.array([1.0, 2.0, 3.0]), multipliers=np.array([0.5, 0.25]))
    monkeypatch.setattr(accelerations, "sensitivity_where", lambda digits: ("where", digits))
    terms = M, None, None, a, gamma, None
    scene = SimpleNamespace(coordinate_names=("x", "y", "θ"))
    point: Any = SimpleNamespace(terms=terms, F=F, v=v, scene=scene, call_solving=at_solved)
    look: Any = SimpleNamespace(added_row=(weights, partition))
    look.solutions = [
        (formulation("no", takes=False), x),
        (formulation("none"), SimpleNamespace(multipliers=None)),
        (formulation("refuses", "refusing"), x),
        (formulation("uk"), x),
    ]
    refused, *sides = redundant_rows(point, look)
    assert refused == Skipped("refuses", "a has rows that follow from others")
    # 2 (1, 2, 0) - (0, 1, -3) and 2 · 5 - 7.
    rows, drift = np.vstack((a, [2.0, 3.0, 3.0])), np.array([5.0, 7.0, 3.0])
    for (name, solution, *given), expected in zip(solved, ("refusing", "solution"), strict=True):
        assert (name, solution, given[5]) == ("redundant rows", expected, partition)
        for value, right in zip(given[:5], (M, F, rows, drift, v), strict=True):
            assert np.array_equal(value, right)
    told_where = "where", "digits"
    forces = rows.T @ multipliers
    largest = np.max(np.abs(rows.T) @ np.abs(multipliers))
    expected = [
        Comparison("uk, q̈", vdot, x.vdot, (("x", "y", "θ"),), None, told_where, may_vanish=True),
        Comparison(
            *("uk, aᵀλ", forces, a.T @ x.multipliers, (("x", "y", "θ"),), largest, told_where),
            may_vanish=True,
        ),
        # The new multiplier is 2 · 10 - 20 of the others.
        Comparison(
            "uk, |λ|", np.array([30.0]), np.array([0.0]), (("the new row",),), 30.0, told_where
        ),
    ]
    for one, right in zip(sides, expected, strict=True):
        for value, other in zip(one, right, strict=True):
            assert np.array_equal(value, other), one[0]
    point.terms = M, None, None, None, None, None
    assert not [*redundant_rows(point, look)]
