"""Entries that rounding of larger ones hides: counted, and named where no state resolves them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_every_claim_fails import MOVING, SNAKE
from tests.claims.wrong import with_entry

import eomcheck
from eomcheck.claims import CLAIMS, Case, Finding
from eomcheck.claims.finding import (
    Entries,
    Unresolved,
    entries_of,
    is_unresolved_detail,
    merged,
    never_resolved,
    unresolved_by_claim,
    unresolved_detail,
    unresolved_finding,
)
from eomcheck.claims.proof import prove_unresolved
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.engines import ENGINES
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.report.finding_output import print_runs
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Jacobians
from eomcheck.numbers.generic import generic
from eomcheck.scenes import SCENES
from eomcheck.testing.suite import SceneTarget

NAMES = (("a", "b", "c", "d"),)


def test_flags_of_several_states_are_joined_entry_by_entry_and_set_of_names_by_set_of_names():
    other = (("x", "y"),)
    states = [
        entries_of(NAMES, [1, 0, 0, 0], [0, 0, 1, 0]),
        entries_of(other, [0, 1], [1, 0]),
        entries_of(NAMES, [1, 1, 0, 0], [0, 0, 0, 1]),
    ]
    joined = entries_of(NAMES, [1, 1, 0, 0], [0, 0, 1, 1])
    assert merged(states) == [joined, states[1]]
    assert states[0].joined(states[2]) == states[2].joined(states[0]) == joined
    assert merged([]) == [] and merged(states[:1]) == states[:1]
    assert never_resolved(states) == ["row c", "row d", "row x"]
    assert isinstance(joined, Entries) and joined.count_hidden == 2


def springs(sign: int) -> Any:
    """Return two bodies on a line, one on a spring of 1e15 N/m, the other on one of 1 N/m.

    Args:
        sign: of the force of the weak one, 1 where it is right.
    """

    @generic
    def jacobians(parameters, prepared, q, v):
        J = np.zeros((2, 1, 2), v.dtype)
        J[0, 0, 0] = J[1, 0, 1] = 1 + 0 * v[0]
        zero = np.zeros((2, 1), v.dtype)
        return Jacobians(J, np.zeros((2, 1, 2), v.dtype), zero, zero)

    @generic
    def velocities(parameters, prepared, q, v):
        return v.reshape(2, 1), np.zeros((2, 1), v.dtype)

    @generic
    def forces(parameters, prepared, q, v):
        return np.array([-(10**15) * q[0], -sign * q[1]], q.dtype)

    @generic
    def potential(parameters, prepared, q):
        return (10**15 * q[0] * q[0] + q[1] * q[1]) / 2

    written = {"jacobians": jacobians, "velocities": velocities}
    written |= {"forces": forces, "potential": potential}

    class Springs(Parametric, functions=written):
        """Two bodies on springs."""

        mass: Any = parameter("m", "kg", "> 0", (1.0, 2.0), (2,), default=(1.0, 1.0))
        inertia: Any = parameter("central", "kg m²", ">= 0", (1.0, 2.0), (2,), default=(1.0, 1.0))
        key, conserves_energy = "springs", True
        named_coordinates = ("stiff", "weak")

        def initial_state(self):
            return np.array([0.3, 0.7]), np.array([0.5, -0.4])

    return Springs()


CLAIM = {"claims": ["generalized-forces"]}


def of_verdict(verdict: str, found: list[Finding]) -> list[Finding]:
    return [one for one in found if one.verdict == verdict]


def test_a_wrong_row_that_a_larger_one_hides_in_every_state_fails_in_exact_arithmetic():
    found = eomcheck.validate(springs(-1), examples=3, **CLAIM)
    (failed,) = of_verdict("failed", found)
    said = "not resolved in any of 4 states: casadi, row weak"
    assert failed.detail == f"generalized forces, row weak: wrong sign; in exact arithmetic; {said}"
    assert not of_verdict("inconclusive", found)


def test_a_wrong_row_that_a_larger_one_hides_is_named_where_there_is_no_proof(monkeypatch):
    monkeypatch.setattr(
        "eomcheck.claims.proof.MOST_COORDINATES", 1
    )  # coordinates: the scene has two
    found = eomcheck.validate(springs(-1), examples=3, **CLAIM)
    (left,) = of_verdict("inconclusive", found)
    assert not of_verdict("failed", found)
    assert (left.claim, left.subject) == ("generalized-forces", "casadi")
    assert left.detail == "not resolved in any of 4 states: casadi, row weak"


def test_a_test_of_a_scene_with_an_entry_that_no_state_resolves_does_not_pass(monkeypatch):
    trial = SceneTarget("springs", springs(-1), None)
    assert trial.results(2, 0)["generalized-forces"].verdict == "failed"
    monkeypatch.setattr("eomcheck.claims.proof.MOST_COORDINATES", 1)
    result = trial.results(2, 0)["generalized-forces"]
    assert result.verdict == "inconclusive"
    assert "not resolved in any of 3 states: casadi, row weak" in result.text


def test_entries_that_no_state_resolves_are_printed(capsys):
    run = ValidationRun(findings=[of_flags(ALL, NONE)], ends=[1])
    run.findings += [unresolved_finding([Unresolved("casadi", "row x", run.findings[0], 3)])]
    print_runs({"snake": run}, RunSelection.of(engines=[], claims=["bias"], scenes=[SNAKE]))
    printed = " ".join(capsys.readouterr().out.split())
    assert "inconclusive: bias on snake: not resolved in any of 3 states: casadi" in printed
    assert "1 of 1 claim passed; " in printed


def test_a_small_row_that_agrees_in_digits_of_its_own_is_resolved():
    found = eomcheck.validate(springs(1), examples=3, **CLAIM)
    assert {(one.verdict, one.detail) for one in found} == {("passed", "")}


def test_a_finding_says_how_many_of_its_entries_are_hidden():
    scene = springs(-1)
    found = eomcheck.check_state(scene, *scene.initial_state(), **CLAIM)
    (one,) = [f for f in found if f.subject == "casadi"]
    assert one.verdict == "passed"
    assert one.detail == "1 of 2 entries not resolved"


def test_hidden_entries_of_a_matrix_are_counted_among_all_of_it():
    scene = type(springs(1))(mass=(1e30, 1.0))
    (one,) = eomcheck.check_state(scene, *scene.initial_state(), claims=["mass-matrix"])
    assert (one.verdict, one.detail) == ("passed", "2 of 4 entries not resolved")


@pytest.mark.parametrize(
    ("found", "expected", "sizes", "resolved", "hidden"),
    [
        ([1.0, 1e-8, 1e-15, 0.0], [1.0, 1e-8, -1e-15, 0.0], None, "1100", "0010"),
        ([1.0, 1e-12, 1e-12, 1e-15], [1.0, 1.0009e-12, 1.0012e-12, 0.0], None, "1100", "0011"),
        # A thousand times what is allowed, 7.1e-15.
        ([1.0, 7.0e-12, 7.2e-12, 1.0], [1.0, 7.00705e-12, 7.20705e-12, 1.0], None, "1011", "0100"),
        ([0.0, 0.0, 0.0, 1e-16], [0.0] * 4, [1.0, 1e-12, 0.0, 1.0], "1001", "0100"),
        ([1.0, 1e-16, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0], "1111", "0000"),
    ],
    ids=["sign", "digits", "size", "cancel", "sum"],
)
def test_entries_are_hidden_where_any_error_of_theirs_would_pass(
    found: list[float], expected: list[float], sizes: Any, resolved: str, hidden: str
):
    """Rows are resolved by what is allowed, by digits of their own, or by their terms."""
    case = Case(Evaluation(SNAKE, *MOVING), (), ())
    case.claim = CLAIMS["equations-residual"]
    how = {"names": NAMES, "scale": 1.0, "sizes": sizes}
    one = case.compare("x", np.array(found), np.array(expected), 1.0, **how)
    assert one.verdict == "passed" and one.entries is not None
    flags = [np.unpackbits(np.frombuffer(x, np.uint8))[:4] for x in one.entries[1:]]
    assert ["".join(map(str, x)) for x in flags] == [resolved, hidden]


def test_an_entry_that_is_0_by_the_scene_is_so_but_for_rounding():
    """Where the scene says anything else it is hidden."""

    class Tried(ENGINES["casadi"]):
        key = "tried"

    case = Case(Evaluation(SNAKE, *MOVING), (), ())
    case.claim = CLAIMS["bias"]
    found, expected = np.array([1.0, 1e-16, 2e-16, 0.0]), np.array([1.0, 0.0, 1e-16, 1e-17])
    for engine, hidden in ((Tried, "0011"), (ENGINES["casadi"], "0111")):
        one = case.compare("x", found, expected, 1.0, names=NAMES, scale=1.0, engine=engine)
        assert one.verdict == "passed" and one.entries is not None
        flags = np.unpackbits(np.frombuffer(one.entries.hidden, np.uint8))[:4]
        assert "".join(map(str, flags)) == hidden
    terms = np.array([1.0, 1.0, 0.01, 1.0])  # 1e-16 is more than rounding of a hundredth
    how = {"names": NAMES, "scale": 1.0, "engine": Tried, "own": lambda: terms}
    one = case.compare("x", found, expected, 1.0, **how)
    assert one.entries is not None and one.entries.hides("row c")
    assert one.entries.count_hidden == 1
    built_in = how | {"engine": ENGINES["casadi"]}
    one = case.compare("x", expected, found, 1.0, **built_in)
    assert one.entries is not None and one.entries.count_hidden == 3  # proofs show them
    case.claim = CLAIMS["engine-momentum"]
    one = case.compare("x", expected, found, 1.0, **built_in)
    assert one.entries is not None and one.entries.hides("row c")
    assert one.entries.count_hidden == 1
    one = case.compare("x", np.array([1.0, 0.0, 0.0, 0.0]), found, 1.0, **built_in)
    assert one.entries is not None and one.entries.count_hidden == 0
    wrong = expected + np.array([0.0, 1e-12, 0.0, 0.0])
    assert case.compare("x", wrong, found, 1.0, **built_in).verdict == "failed"
    assert case.compare("x", expected, found + wrong, 1.0, **built_in).verdict == "failed"


def test_a_row_that_a_failure_shows_to_be_wrong_is_not_listed_as_unresolved():
    case = Case(Evaluation(SNAKE, *MOVING), (), ())
    case.claim = CLAIMS["equations-residual"]
    how = {"names": NAMES, "scale": 1.0}
    right, small = np.array([1.0, 1.0, 1e-16, 1e-16]), np.array([1.0, 1.0, 0.0, 0.0])
    hidden = case.compare("x", right, small, 1.0, **how)
    wrong = case.compare("x", right + np.array([0.0, 0.0, 1.0, np.nan]), small, 1.0, **how)
    slight = case.compare("x", right + np.array([0.0, 0.5, 0.0, 0.0]), small, 1.0, **how)
    assert [one.verdict for one in (hidden, wrong, slight)] == ["passed", "failed", "failed"]

    def left(*findings: Finding) -> list[str]:
        return [one.name for each in unresolved_by_claim(findings).values() for one in each]

    assert left(hidden) == ["x, row c", "x, row d"]
    assert left(hidden, slight) == ["x, row c", "x, row d"]
    assert left(hidden, wrong) == []
    assert left(wrong) == left(slight) == []


def test_what_vanishes_without_known_terms_has_no_entries():
    case = Case(Evaluation(SNAKE, *MOVING), (), ())
    case.claim = CLAIMS["equations-residual"]
    zeros, ones = (np.zeros(4),) * 2, (np.ones(4),) * 2
    assert case.compare("au", *zeros, 1.0, names=NAMES, scale=1.0).entries is None
    assert case.compare("au", *ones, 1.0, names=NAMES, entrywise=False).entries is None


@pytest.mark.parametrize(
    "claim",
    [
        *("equations-residual", "constraint-acceleration", "null-space-embedding"),
        *("null-space-speeds", "active-forces", "kane-ml-force", "equivalence", "mass-matrix"),
    ],
)
def test_terms_that_cancel_have_the_sizes_of_their_rows(claim: str):
    found = eomcheck.check_state(SNAKE, *MOVING[:2], claims=[claim])
    assert {f.entries is not None for f in found if f.verdict == "passed"} == {True}
    assert not any(f.entries.count_hidden for f in found if f.entries)


# ---- Over all states -----------------------------------------------------------------------------


def of_flags(resolved: list[int], hidden: list[int], names: Any = NAMES, **changed: Any) -> Finding:
    entries = entries_of(names, np.array(resolved, bool), np.array(hidden, bool))
    made = Finding("bias", "B", SNAKE, MOVING, 0.0, 1e-14, "passed", "made up", entries=entries)
    return replace(made, **changed)


NONE, ALL = [0] * 4, [1] * 4


@pytest.mark.parametrize(
    ("findings", "said"),
    [
        ([of_flags([1, 0, 1, 0], [0, 1, 0, 0])], "B, row b"),
        ([of_flags([1, 0, 0, 0], [0, 1, 0, 0]), of_flags([0, 1, 0, 0], [1, 0, 0, 0])], ""),
        ([of_flags([1, 0, 0, 0], [0, 1, 0, 1]), of_flags([1, 0, 0, 1], [0, 1, 0, 0])], "B, row b"),
        ([of_flags([1, 1, 1, 0], NONE)], ""),  # 0 = 0 has passed
        ([of_flags([1, 0, 0, 0], NONE, verdict="inconclusive")], "B"),
        ([of_flags([1, 0, 0, 0], NONE, verdict="inconclusive"), of_flags(ALL, NONE)], ""),
        ([of_flags(NONE, NONE, verdict="skipped")], ""),
        ([of_flags([1, 0], [0, 1], (("a", "b"),)), of_flags([0, 1], [0, 0], (("a", "b"),))], ""),
        ([of_flags([1, 0], [0, 1], (("a", "b"),)), of_flags([0, 1, 1, 1], NONE)], ""),
        (
            [of_flags(ALL, NONE), of_flags(NONE, ALL, subject="b")],
            "b, row a; b, row b; b, row c; b, row d",
        ),
    ],
    ids=[
        "hidden",
        "in turn",
        "in one",
        "zero",
        "open",
        "decided",
        "unseen",
        "same",
        "other size",
        "other subject",
    ],
)
def test_what_no_state_resolves_is_left(findings: list[Finding], said: str):
    left = unresolved_by_claim(findings)
    details = [unresolved_finding(each).detail for each in left.values()]
    states = sum(one.subject == findings[-1].subject for one in findings)
    where = f"any of {states} states" if states > 1 else "this state"
    assert details == ([f"not resolved in {where}: {said}"] if said else [])
    assert all(is_unresolved_detail(one) for one in details)


def test_of_many_entries_some_are_named_and_all_are_counted():
    names = (tuple("abcdefgh"), tuple("xy"))
    flags = np.zeros(16, bool)
    flags[3:13] = True
    one = of_flags(np.zeros(16, bool).tolist(), flags.tolist(), names)
    assert one.entries is not None and never_resolved([one.entries])[0] == "entry (b, y)"
    assert one.entries.hides("entry (g, x)") and not one.entries.hides("entry (g, y)")
    (found,) = [unresolved_finding(each) for each in unresolved_by_claim([one]).values()]
    assert found.verdict == "inconclusive" and found.subject == "B"
    assert found.detail.endswith("B, entry (e, y); B, entry (f, x) and 2 more")


@pytest.mark.parametrize(
    ("count", "end"),
    [(7, "row g"), (8, "row h"), (9, "row h and 1 more"), (10, "row h and 2 more")],
)
def test_eight_entries_are_named_and_those_beyond_are_counted(count: int, end: str):
    names = [f"row {letter}" for letter in "abcdefghij"[:count]]
    detail = unresolved_detail(names, 3)
    assert detail.startswith("not resolved in any of 3 states: row a; row b")
    assert detail.endswith(f"; {end}")


def test_the_entries_of_an_engine_on_trial_stay_hidden():
    """Its numbers are doubles: no proof of the scene is one of them."""
    left = Unresolved("casadi", "row x", of_flags(ALL, NONE), 3)
    tried = left._replace(finding=replace(left.finding, engine=ENGINES["casadi"]))
    found, rest = prove_unresolved(CLAIMS["bias"], [left, tried], {})
    assert rest == [tried]
    said = "in exact arithmetic; not resolved in any of 3 states: casadi, row x"
    assert [(one.verdict, one.detail) for one in found] == [("passed", said)]
    whole = left._replace(entry="")
    assert prove_unresolved(CLAIMS["bias"], [whole], {}) == ([], [whole])
    other = left._replace(subject="au ~ nothing")
    assert prove_unresolved(CLAIMS["equivalence"], [other], {}) == ([], [other])
    assert prove_unresolved(CLAIMS["machine-code"], [left], {}) == ([], [left])
    skipped = of_flags(ALL, NONE, subject="B", verdict="skipped")
    proved = replace(found[0], claim="bias", subject="B", verdict="passed")
    for verdict in ("skipped", "inconclusive"):
        open_ = replace(skipped, verdict=verdict)
        for about in ([open_], [proved, open_], [open_, proved]):
            known = {(type(SNAKE), SNAKE.structure): about}
            assert prove_unresolved(CLAIMS["bias"], [left], known) == ([], [left])


def test_a_run_that_ends_at_a_failure_lists_no_entries():
    """Few states were looked at: that none of them resolves an entry says nothing."""
    run = ValidationRun()
    run.findings = [of_flags([1, 0, 1, 0], [0, 1, 0, 0])]
    selection = RunSelection.of(claims=["bias"], scenes=[SNAKE])
    run.minimal = replace(run.findings[0], verdict="failed")
    assert len(run.finish(selection)) == 2
    run.minimal, run.findings = None, run.findings[:1]
    assert len(run.finish(selection)) == 2 and run.findings[1].proof is not None


CHAIN = {"length": [1.0, 1.0], "inertia": [0.1, 0.1]}
WHEELS = {"mass": [1.0, 1.0], "stiffness": None, "wheel_angle": [0.1, -0.2]}
LARGE: dict[tuple[str, tuple[int, ...]], Any] = {
    ("M", (1, 1)): lambda x: ("chain-pendulum", CHAIN | {"mass": [x, 1.0]}),
    ("Q", (1,)): lambda x: ("chain-pendulum", CHAIN | {"mass": [x, 1.0]}),
    ("B", (1,)): lambda x: ("chain-pendulum", CHAIN | {"mass": [x, 1.0]}),
    ("M", (3, 3)): lambda x: ("snake", WHEELS | {"length": [1.0, 1.0], "inertia": [x, 1.0]}),
    ("a", (1, 3)): lambda x: ("snake", WHEELS | {"length": [x, 1.0], "inertia": [1.0, 1.0]}),
    ("gamma", (1,)): lambda x: ("snake", WHEELS | {"length": [x, 1.0], "inertia": [1.0, 1.0]}),
}
"""Entry of a term -> a scene in which entries beside it are so many times larger."""


@pytest.mark.night
@pytest.mark.parametrize("ratio", [1e8, 1e15])
@pytest.mark.parametrize(("term", "entry"), LARGE)
def test_a_wrong_sign_beside_entries_that_are_far_larger_fails(term, entry, ratio: float):
    key, parameters = LARGE[term, entry](ratio)
    kind = SCENES[key]

    def terms(*arguments):
        right = kind.terms(*arguments)
        wrong = with_entry(getattr(right, term), entry, lambda x: -x)
        return right._replace(**{term: wrong})

    scene = type("Wrong", (kind,), {"terms": staticmethod(terms)})(**parameters)
    assert of_verdict("failed", eomcheck.validate(scene, examples=5))
