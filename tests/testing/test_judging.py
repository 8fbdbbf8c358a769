"""Verdicts, numbers, entries and states of Findings, held against arrays that are made by hand."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from tests.testing.own import given, guide

from eomcheck.claims.finding import VERDICTS
from eomcheck.claims.registry import Comparison
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.testing import (
    FUNCTION_CLAIMS,
    EquationsOfMotion,
    check,
    check_functions,
    function_checks,
)
from eomcheck.testing.equations_of_motion import FunctionCaller
from eomcheck.testing.function_checks import (
    check_functions_at,
    judge_output,
    sample_states,
)
from eomcheck.testing.function_state import FunctionState
from eomcheck.testing.uncertain import UncertainArray

CART = guide("cart")
NAMES = ("x", "y"), ("a", "b", "c")
EVEN = FUNCTION_CLAIMS["bias-even"]


def measured(value: Any, error: Any, size: Any = 1.0) -> UncertainArray:
    value = np.asarray(value, float)
    return UncertainArray(
        value, *(np.broadcast_to(np.asarray(x, float), value.shape) for x in (error, size))
    )


def test_each_entry_is_judged_by_the_errors_of_both_sides():
    found = measured([[1.0, 2.0, 0.0], [4.0, -5.0, 0.0]], [[1e-6, 0, 0], [0, 2e-5, 1e-7]])
    off = [[C * 1.4e-6, C * 0.9e-6, 0.0], [C * 0.9e-6, C * 1.9e-5, 0.0]]
    expected = UncertainArray(
        found.value + off,
        np.array([[0.5e-6, 1e-6, 0.0], [0.8e-6, 0.0, 0.0]]),
        np.ones((2, 3)),
    )
    judged = judge_output(EVEN, Comparison("M", found, expected, NAMES))
    verdicts = [[VERDICTS[int(x)] for x in row] for row in judged.verdicts]
    assert verdicts == [["passed", "passed", "passed"], ["failed", "passed", "passed"]]
    np.testing.assert_allclose(judged.allowed / C, [[1.5e-6, 1e-6, 0], [0.8e-6, 2e-5, 1e-7]])
    np.testing.assert_allclose(judged.observed, np.abs(off), rtol=1e-6)
    assert judged.finding.verdict == "failed"
    assert judged.finding.detail.startswith("bias, entry (y, a): ")
    assert judged.finding.observed == pytest.approx(C * 0.9e-6)
    assert judged.finding.allowed == pytest.approx(C * 0.8e-6)
    assert judged.finding.entries is not None
    resolved, hidden = (
        np.unpackbits(np.frombuffer(x, np.uint8))[:6].tolist() for x in judged.finding.entries[1:]
    )
    assert (resolved, hidden) == ([1, 1, 0, 1, 1, 0], [0] * 6)


@pytest.mark.parametrize(
    ("found", "expected", "verdict"),
    [
        # What is allowed, 32e-4, is more than a thousandth of the smaller size, not the larger.
        (measured(0.0, 1e-4, 0.1), measured(0.0, 0.0, 9.0), "passed"),
        (measured(0.0, 1e-4, 9.0), measured(0.0, 0.0, 0.1), "passed"),
        (measured(0.0, 1e-4, 0.1), measured(0.0, 0.0, 0.1), "inconclusive"),
        # ... and more than a thousandth of the smaller number, of which one is known.
        (measured(5.0, 1e-4, 99.0), measured(4.998, 0.0, 99.0), "passed"),
        (measured(5.0, 1e-4, 99.0), measured(1.0, 0.0, 99.0), "failed"),
        (measured(1.0, 1e-4, 99.0), measured(0.999, 0.0, 99.0), "inconclusive"),
        (measured(0.001, 0.0, 99.0), measured(0.0, 1e-4, 99.0), "passed"),  # of nothing
        (measured(0.001, 1e-4, 99.0), measured(0.0012, 1e-4, 99.0), "passed"),  # or both are
        (measured(1.0, np.nan, 9.0), measured(1.0, 0.0, 9.0), "inconclusive"),
        (measured(2.0, 0.0, 9.0), measured(1.0, np.inf, 9.0), "inconclusive"),
        (measured(2.0, 0.0, 9.0), measured(1.0, 0.0, 9.0), "failed"),
    ],
)
def test_a_number_is_resolved_beside_the_larger_side(found, expected, verdict: str):
    judged = judge_output(EVEN, Comparison("M", found, expected, ()))
    assert judged.finding.verdict == verdict
    assert VERDICTS[int(judged.verdicts)] == verdict


def test_what_is_not_known_does_not_hide_what_fails():
    found = measured([1.0, 2.0, np.inf], [np.inf, 1e-9, 0.0])
    judged = judge_output(
        EVEN, Comparison("bias", found, measured([1.0, 2.5, 1.0], 0.0), (("a", "b", "c"),))
    )
    assert [VERDICTS[int(x)] for x in judged.verdicts] == ["inconclusive", "failed", "inconclusive"]
    assert judged.finding.detail == "bias, row b: 2, expected 2.5"
    assert judged.allowed.tolist() == [np.inf, pytest.approx(C * 1e-9), np.inf]


def test_exact_numbers_that_differ_fail_before_all_others():
    found = measured([1.0, 2.0], [1e-9, 0.0])
    judged = judge_output(EVEN, Comparison("bias", found, measured([2.0, 2.5], 0.0), (("a", "b"),)))
    assert "row b: 2, expected 2.5" in judged.finding.detail
    assert (judged.finding.observed, judged.finding.allowed) == (0.5, 0.0)


def test_a_row_that_is_missing_or_too_much_is_resolved_as_wrong():
    found = measured([0.0, 1.0, 3.0, 0.0], 1e-9)
    expected = measured([2.0, 1.0, 0.0, 0.0], 0.0)
    judged = judge_output(EVEN, Comparison("bias", found, expected, (("a", "b", "c", "d"),)))
    assert [VERDICTS[int(x)] for x in judged.verdicts] == ["failed", "passed", "failed", "passed"]
    assert judged.finding.entries is not None
    resolved, hidden = (
        np.unpackbits(np.frombuffer(x, np.uint8)) for x in judged.finding.entries[1:]
    )
    assert (resolved[:4].tolist(), hidden[:4].tolist()) == ([1, 1, 1, 0], [0, 0, 0, 0])


def test_nothing_to_compare_passes():
    empty = measured(np.zeros((0, 3)), 0.0)
    told = judge_output(EVEN, Comparison("a", empty, empty, ((), ("x", "y", "z")))).finding
    assert (told.subject, told.verdict, told.detail) == ("a", "passed", "")
    assert told.observed == told.allowed == 0.0


def test_a_failure_names_the_function_where_its_claim_blames_none():
    one, two = measured(1.0, 1e-9), measured(3.0, 0.0)
    claim = FUNCTION_CLAIMS["same-answer"]
    for subject, words in (("qdd", "acceleration"), ("C v ~ B", "C v"), ("R ~ x", "dissipation f")):
        assert judge_output(claim, Comparison(subject, one, two, ())).finding.detail.startswith(
            words
        )


# ---- Of several states ---------------------------------------------------------------------------

NOISE = 1e12
"""Frequency of what no state resolves, per rad."""

STATES = [(np.array([x, 0.2 - x, 0.3]), np.zeros(3)) for x in (0.11, -0.52, 0.73)]


def test_what_no_state_resolves_is_told_where_least_is_allowed():
    """Rows 0 and 1 are hidden everywhere, row 2 nowhere."""
    sizes = np.array([1e-12, 1e-10])
    functions = EquationsOfMotion(
        3,
        U=lambda q: sizes @ np.sin(NOISE * q[:2]) + 1.5 * q[2] ** 2,
        gravity=lambda q: [*(-NOISE * sizes * np.cos(NOISE * q[:2])), 3.0 * q[2]],
    )
    claim = FUNCTION_CLAIMS["gravity-of-potential"]
    passed, listed = check(functions, claims=[claim.id], states=STATES)
    rows = "gravity, row q[0]; gravity, row q[1]"
    assert listed.detail == f"not resolved in any of 3 states: {rows}"
    assert (listed.subject, listed.verdict) == ("gravity", "inconclusive")
    assert (passed.verdict, passed.detail) == ("passed", "6 of 9 entries in 3 states not resolved")
    points = [FunctionState(FunctionCaller(functions), q, v, k) for k, (q, v) in enumerate(STATES)]
    each = [judge_output(claim, next(claim.evaluate(at))) for at in points]
    allowed = np.array([one.allowed[:2] for one in each])
    k, i = np.unravel_index(np.argmin(allowed), allowed.shape)
    assert listed.allowed == allowed[k, i]
    assert listed.observed == each[int(k)].observed[i]
    assert listed.state is not None and listed.state.q.tolist() == STATES[int(k)][0].tolist()
    # ... which is neither the first state nor that of the other row.
    assert len({*np.argmin(allowed, axis=0).tolist(), 0}) == 3


def test_what_no_state_resolves_at_all_does_not_pass():
    """Its one entry is 0 = 0 in one state and hidden in the other."""

    def U(q: Any) -> Any:
        return NOISE * (q[0] > 0.0) * np.sin(NOISE * q[0])

    states = [([-0.6], [0.0]), ([0.6], [0.0])]
    model = {"U": U, "gravity": lambda q: np.zeros(1), "claims": ["gravity-of-potential"]}
    (found,) = check_functions(1, **model, states=states)
    assert (found.verdict, found.detail) == (
        "inconclusive",
        "not resolved in any of 2 states: gravity, row q[0]",
    )


def test_only_functions_that_a_claim_reads_are_said_to_jump():
    def jumping(f: Any) -> Any:
        return lambda q, *v: f(q, *v) * (1.5 if q[0] > 0.3 + 1e-5 else 1.0)

    wrong = {"M": lambda q: 1.1 * CART.M(q), "bias": jumping(CART.bias), "T": jumping(CART.T)}
    state = ([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])
    (found,) = [
        x
        for x in check_functions(3, **wrong, states=[state], claims=["bias-of-mass-matrix"])
        if x.verdict == "failed"
    ]
    assert found.detail.endswith("; bias jumps within 0.001 of this state")


def test_a_matrix_that_cannot_be_inverted_is_told_as_not_computed():
    model = {
        "M": lambda q: np.eye(2),
        "bias": lambda q, v: 0.0 * v,
        "qdot": lambda q, u: np.zeros(2),
        "holonomic": True,
    }
    found = check_functions(2, **model, claims=["bias-of-mass-matrix"], states=2)
    assert [(x.verdict, x.detail) for x in found] == [
        ("skipped", "not computed here: Singular matrix")
    ]


# ---- States --------------------------------------------------------------------------------------


def test_states_are_those_of_the_seed_and_of_the_ranges_of_each():
    functions = EquationsOfMotion(2, bias=lambda q, v: v, ranges=[(2, 3), (5, 9), (-4, -3), (0, 2)])
    one, same, other = (sample_states(functions, 400, seed) for seed in (3, 3, 4))
    table = np.array([[*x.q, *x.v] for x in one])
    assert table.tolist() == [[*x.q, *x.v] for x in same]
    assert not {x.q[0] for x in one} & {x.q[0] for x in other}
    means = table.mean(axis=0)
    assert (np.abs(means - [2.5, 7.0, -3.5, 1.0]) < [0.1, 0.4, 0.1, 0.2]).all()
    assert (np.abs(np.ptp(table, axis=0) - [1.0, 4.0, 1.0, 2.0]) < 0.1).all()
    assert {x.t for x in one} == {0.0}


def test_a_check_asks_the_states_of_its_seed():
    def states(seed: int) -> list[float]:
        asked: list[float] = []
        own = {"bias": lambda q, v: asked.append(q[0]) or v, "ranges": (-1, 1)}
        check_functions(1, **own, states=3, seed=seed, claims=["answers"])
        return asked

    assert states(5) == states(5)
    assert not {*states(5)} & {*states(6)}


def test_a_difference_from_a_reference_beyond_the_default_ranges_is_told():
    def wrapped(q: Any) -> Any:
        return CART.M(np.where(np.abs(q) > 1.2, 2.4 - q, q))

    against = EquationsOfMotion(3, M=CART.M, name="a book")
    found = check_functions(3, M=wrapped, against=against, states=2, claims=["reference"])
    assert [x.verdict for x in found] == ["passed", "inconclusive"]
    assert "outside the ranges only" in found[1].detail
    assert found[1].subject == "M ~ a book"
    assert found[1].state is not None and np.abs(found[1].state.q).max() > 1.2


@pytest.mark.parametrize(("n", "p"), [(2, 1), (1, 2)])
def test_a_reference_of_other_speeds_is_refused(n: int, p: int):
    """As many coordinates and fewer velocities, or the other way."""

    def made(n: int, p: int) -> EquationsOfMotion:
        return EquationsOfMotion(n, M=lambda q: np.eye(p), qdot=lambda q, u: np.zeros(n), speeds=p)

    with pytest.raises(InputError, match=f"against has {n} coordinates, expected 2 as"):
        check(made(2, 2), against=made(n, p), states=1)


def test_a_seed_below_zero_is_refused():
    with pytest.raises(InputError, match="seed = -1, expected a whole number of at least 0"):
        check_functions(2, M=lambda q: np.eye(2), seed=-1)


def test_claims_at_one_state_are_those_that_are_asked_there():
    own = given("cart") | {"gravity": lambda q: CART.gravity(q) * (1.0 + (q[0] > 0.5))}
    functions = EquationsOfMotion(**own)
    ids = ["gravity-of-potential", "mass-matrix-symmetric"]
    for x, verdict in ((0.4, "passed"), (0.6, "failed")):
        (state,) = (y for y in sample_states(functions, 1, 0))
        state = state._replace(q=np.array([x, 0.7, -0.4]))
        found = check_functions_at(functions, state, ids)
        assert [(y.claim, y.verdict) for y in found] == [(ids[0], verdict), (ids[1], "passed")]
        assert all(y.state is not None and y.state.q[0] == x for y in found)


# ---- Progress ------------------------------------------------------------------------------------


def test_a_check_that_takes_long_shows_how_many_claims_it_has_checked(monkeypatch):
    bars, counts = [], []

    def bar(label: str, total: float, reached: Any) -> Any:
        bars.append((label, total, reached))
        return nullcontext()

    def M(q):
        counts.append(bars[0][2]() if bars else 0)
        return np.eye(2)

    monkeypatch.setattr(function_checks, "polled_progress", bar)
    claims = ["mass-matrix-symmetric", "mass-matrix-positive", "answers-repeat"]
    check_functions(2, M=M, states=1, claims=claims)
    ((label, total, reached),) = bars
    assert (label, total, reached()) == ("checking {claim}", 3, 3)
    assert {0, 2} <= {*counts} <= {0, 1, 2}, "one by one, that about all calls last"
