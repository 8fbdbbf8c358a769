"""A case step by step: what is compared with what, by which size, and what a finding says of it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.claims.test_checks import SNAKE, Q, V

from eomcheck.claims import CLAIMS, Case, Finding, case
from eomcheck.claims import case as trial
from eomcheck.claims.registry import Claim, Comparison, Skipped
from eomcheck.engines.answers import turning_size
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES


class Tried(CasadiEngine):
    """An engine on trial."""

    key = "tried"


NAMES = (("x", "y"), ("a", "b", "c"))
EXPECTED = np.array([[4.0, -3.0, 2.0], [1.0, 0.0, -0.5]])


def of(claim: str = "mass-matrix", **more: Any) -> Case:
    return Case(Evaluation(SNAKE, Q, V, 0.0), (), (), CLAIMS[claim], **more)


def flags(one: Finding) -> tuple[str, str] | None:
    if one.entries is None:
        return None
    size = int(np.prod([len(axis) for axis in one.entries.names]))
    each = (np.unpackbits(np.frombuffer(x, np.uint8))[:size] for x in one.entries[1:])
    resolved, hidden = ("".join(map(str, x)) for x in each)
    return resolved, hidden


# ---- Compared ------------------------------------------------------------------------------------

WRONG = {(0, 1): 6.0, (1, 2): -1e-3}
SIGN = "mass matrix, entry (x, b): "


@pytest.mark.parametrize(
    ("by", "how", "verdict", "observed", "detail", "entries"),
    [
        (WRONG, {}, "failed", 6.0, f"{SIGN}wrong sign", ("010001", "000000")),
        (WRONG, {"engine": Tried}, "failed", 6.0, f"{SIGN}found 3, expected -3: wrong sign", ...),
        (WRONG, {"engine": CasadiEngine}, "failed", 6.0, f"{SIGN}wrong sign", ...),
        (WRONG, {"scale": 1e-12}, "inconclusive", 6.0, "", ("111101", "000000")),
        (WRONG, {"entrywise": False}, "failed", 6.0, f"{SIGN}wrong sign", ("010001", "000000")),
        ({}, {}, "passed", 0.0, "", ("111101", "000000")),
        ({}, {"entrywise": False}, "passed", 0.0, "", None),
        ({}, {"sizes": np.ones((2, 3))}, "passed", 0.0, "", ("111111", "000000")),
        ({(1, 1): 1e-15}, {}, "passed", 1e-15, "1 of 6 entries not resolved", ("111101", "000010")),
        ({(1, 1): 1e-15}, {"scale": 1e-12}, "inconclusive", 1e-15, "", ("111101", "000010")),
        ({(0, 0): np.nan}, {}, "failed", np.inf, "mass matrix, entry (x, a): nan, expected 4", ...),
    ],
)
def test_what_a_comparison_says(by, how, verdict, observed, detail, entries):
    found = EXPECTED.copy()
    for entry, error in by.items():
        found[entry] += error
    one = of().compare("it", found, EXPECTED, 1.0, names=NAMES, **how)
    assert (one.claim, one.subject, one.verdict, one.detail) == (
        "mass-matrix",
        "it",
        verdict,
        detail,
    )
    assert (one.observed, one.allowed) == (observed, allowed_error(1.0))
    assert one.engine is (Tried if how.get("engine") is Tried else None)
    assert one.state is not None and np.array_equal(one.state.v, V)
    assert entries is ... or flags(one) == entries


def test_a_comparison_says_what_it_rests_on():
    one = of().compare("it", 1.0, 1.5, 1.0, names=(), evidence="by hand")
    assert (one.evidence, one.verdict, one.detail) == ("by hand", "failed", "mass matrix, value")
    assert one.entries is None
    one = of().compare("it", EXPECTED, EXPECTED, 1.0, names=NAMES)
    assert one.evidence == "property-tested"
    for bad in (np.nan, -np.inf):
        expected = EXPECTED.copy()
        expected[1, 2] = bad
        one = of().compare("it", EXPECTED, expected, 1.0, names=NAMES, scale=1.0)
        assert (one.verdict, one.detail) == ("inconclusive", "")


def test_nothing_that_should_vanish_has_a_size_of_its_own():
    zeros = np.zeros(3), np.zeros(3)
    how: Any = {"names": NAMES[1:], "scale": 1.0}
    assert flags(of().compare("it", *zeros, 1.0, **how)) is None
    sized = of().compare("it", *zeros, 1.0, **how, sizes=np.array([1.0, 1e-13, 0.0]))
    assert flags(sized) == ("100", "010")


# ---- Both sides ----------------------------------------------------------------------------------


def judged(*them: Any) -> dict[str, Finding]:
    claim = Claim("own", "one = the other", "", "it", sides=lambda at, look: iter(them))
    return {one.subject: one for one in of().evaluate(claim)}


ROWS = (("1", "2", "3"),)
MASS, FIXED = SNAKE.mass, np.array([10.0, 0.0, -4.0])


def test_both_sides_and_what_cancels_in_them_are_allowed_their_rounding():
    def sides(at: Any, look: Any) -> Any:
        mass = at.parameters.mass
        yield Comparison("found", mass, FIXED, ROWS)
        yield Comparison("expected", FIXED, mass, ROWS)
        yield Comparison("cancels", FIXED, mass, ROWS, size=100.0)
        yield Comparison("given", FIXED, mass, ROWS, size=100.0, sensitivity=7.0)

    found = of().evaluate(Claim("own", "one = the other", "", "it", sides=sides))
    allowed = {one.subject: one.allowed / allowed_error(1.0) for one in found}
    assert 10 + 2 + 1 < allowed["found"] <= 10 + 2 + 2.01
    assert allowed["expected"] == allowed["found"]
    assert allowed["cancels"] == pytest.approx(allowed["found"] + 100)
    assert allowed["given"] == 7.0


@pytest.mark.parametrize(
    ("how", "verdict", "entries"),
    [
        ({}, "inconclusive", None),
        ({"may_vanish": True}, "passed", None),
        ({"size": 1.0}, "passed", None),
        ({"size": 1e-12}, "inconclusive", None),
        ({"size": 1e-12, "may_vanish": True}, "passed", None),
        ({"size": 1.0, "sizes": np.array([1.0, 1e-12, 0.0])}, "passed", ("100", "010")),
    ],
)
def test_sides_that_vanish_are_judged_by_what_cancels_in_them(how, verdict, entries):
    (one,) = judged(
        Comparison("it", np.zeros(3), np.zeros(3), ROWS, sensitivity=1.0, **how)
    ).values()
    assert (one.verdict, flags(one)) == (verdict, entries)


def test_entries_beside_which_other_terms_cancel_have_no_sizes_of_their_own():
    both = np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0])
    found = judged(
        Comparison("plain", *both, ROWS, sensitivity=1.0),
        Comparison("cancels", *both, ROWS, size=9.0, sensitivity=1.0),
        Skipped("skipped", "why"),
        Comparison("sized", *both, ROWS, size=9.0, sensitivity=1.0, sizes=both[0]),
    )
    assert {key: flags(one) for key, one in found.items()} == {
        "plain": ("111", "000"),
        "cancels": None,
        "sized": ("111", "000"),
    }


@pytest.mark.parametrize("refused", [False, True])
def test_sides_that_do_not_exist_nearby_are_not_judged(refused: bool):
    def sides(at: Any, look: Any) -> Any:
        yield Comparison("always", MASS, MASS, ROWS)
        if at.is_perturbed and refused:
            raise RefusedError("it", 0.0, 1.0, "no")
        if not at.is_perturbed:
            yield Comparison("here", MASS, MASS, ROWS)

    found = of().evaluate(Claim("own", "one = the other", "", "it", sides=sides))
    assert [(x.subject, x.verdict) for x in found] == [
        ("always", "passed"),
        ("here", "inconclusive"),
    ]


# ---- Against engines -----------------------------------------------------------------------------


def against(monkeypatch: Any, claim: str, answers: dict[Any, Any], scene: Any = SNAKE) -> list[Any]:
    """Return what is found of engines that answer so, and what is handed over to be compared."""
    at = Evaluation(scene, *(Q, V) if scene is SNAKE else scene.initial_state(), 0.25)
    here = Case(at, (), (), CLAIMS[claim])
    expected: list[Any] = []

    def answer(_: Case, engine: Any, *state: Any, expected: Any) -> Any:
        assert [np.array_equal(x, y) for x, y in zip(state, at_state, strict=True)] == [True] * 3
        handed.append(expected())
        found = answers[engine]
        return here.finding(*found) if isinstance(found, tuple) else found

    at_state, handed = (at.q, at.v, 0.25), expected
    monkeypatch.setattr(trial, "ask_engine", answer)
    monkeypatch.setattr(
        trial, "cancelling_size", lambda case, engine, method: {"bias": 64.0}.get(method, 0)
    )
    monkeypatch.setattr(trial, "compare_with_engine", lambda *them, **more: (*them[2:6], more))
    monkeypatch.setattr(Case, "claim_engines", property(lambda self: tuple(answers)))
    found = here.evaluate(CLAIMS[claim])
    assert all(np.array_equal(x, expected[0]) for x in expected)
    return [expected[0], *found]


class Named(SimpleNamespace):
    """An engine of which nothing but the name is asked."""

    __hash__ = object.__hash__
    unit_roundoff = 2.0**-53


ONE, OTHER = Named(key="one"), Named(key="other")
UNSEEN = "it", 0.0, 0.0, "skipped", "compared"
FAILED = "it", 1.0, 0.0, "failed", "compared"


def test_terms_are_compared_with_those_of_every_engine(monkeypatch):
    at = Evaluation(SNAKE, Q, V, 0.25)
    theirs = [at.terms.B + 1.0, at.terms.B - 1.0]
    own = sensitivity_of(at, lambda e: e.terms.B, coordinates=True)
    answers = {ONE: theirs[0], Tried: UNSEEN, OTHER: theirs[1]}
    expected, first, unseen, second = against(monkeypatch, "bias", answers)
    assert np.array_equal(expected, at.terms.B)
    assert unseen.verdict == "skipped"
    for (subject, ours, their, scale, more), key, answer in zip(
        (first, second), ("one", "other"), theirs, strict=True
    ):
        assert subject == key and np.array_equal(ours, at.terms.B) and their is answer
        assert scale == more["scale"] == own + 64.0 + turning_size(at)
        assert (more["names"], more["sizes"]) == ((SNAKE.coordinate_names,), None)
        assert more["own"]().shape == (5,)
    assert first[3] == second[3]


def test_entries_of_a_mass_matrix_have_the_sizes_of_its_diagonal(monkeypatch):
    M = Evaluation(SNAKE, Q, V).terms.M
    _, (*_, scale, more) = against(monkeypatch, "mass-matrix", {ONE: M})
    assert more["sizes"] == pytest.approx(np.sqrt(np.outer(np.diag(M), np.diag(M))))
    assert more["names"] == (SNAKE.coordinate_names,) * 2
    own = sensitivity_of(Evaluation(SNAKE, Q, V), lambda e: e.terms.M, coordinates=True)
    assert scale == own != sensitivity_of(Evaluation(SNAKE, Q, V), lambda e: e.terms.M)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (np.zeros(3), []),
        (np.array([0.0, 1e-9, 0.0]), ["compared"]),
        (UNSEEN, []),
        (FAILED, ["failed"]),
    ],
)
def test_a_term_that_a_scene_has_not_is_none_of_an_engine_s(monkeypatch, answer, said):
    scene = SCENES["sleigh"].example()
    expected, *found = against(monkeypatch, "generalized-forces", {ONE: answer}, scene)
    assert expected == 0.0
    assert ["compared" if isinstance(x, tuple) else x.verdict for x in found] == said
    for x in found:
        if isinstance(x, tuple):
            assert not np.any(x[1]) and x[1].shape == (3,)


def test_a_bias_that_is_left_out_is_zero(monkeypatch):
    kind = SCENES["sleigh"]

    def terms(*them: Any) -> Any:
        return kind.terms(*them)._replace(B=None)

    scene = type("Unbiased", (kind,), {"terms": staticmethod(terms)})()
    expected, *found = against(monkeypatch, "bias", {ONE: np.zeros(3), Tried: UNSEEN}, scene)
    assert not expected.any()
    assert found[0][0] == "one" and found[1].verdict == "skipped"


class Forceless(CasadiEngine):
    """An engine that offers no forces."""

    key, forces = "forceless", CasadiEngine.__mro__[1].forces


def test_engines_are_asked_what_they_offer_and_those_on_trial_everything():
    kinds: Any = CasadiEngine, PinocchioEngine, Forceless
    casadi, pinocchio, tried = (object.__new__(kind) for kind in kinds)
    broken = {Tried: "it broke", PinocchioEngine: "it is not there", CasadiEngine: "no"}
    here = of("generalized-forces", unavailable=broken)
    here = replace(here, engines=(pinocchio, casadi, tried))
    assert not Forceless.offers("forces") and not PinocchioEngine.offers("forces")
    assert here.claim_engines == (casadi, tried, Tried, CasadiEngine)
    here.claim = CLAIMS["bias"]
    assert here.claim_engines == (pinocchio, casadi, tried, Tried, PinocchioEngine, CasadiEngine)


# ---- What a scene cannot answer ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("broken", "outcome"),
    [
        ("", (0.0, 0.0, "skipped", "property-tested", "not rational: it said so")),
        ("terms broke", (np.inf, 0.0, "failed", "property-tested", "terms broke")),
    ],
)
def test_what_a_function_raises_is_a_finding_beside_those_before_it(monkeypatch, broken, outcome):
    asked = []
    monkeypatch.setattr(
        case, "scene_function_that_raised", lambda scene, error: str(error) and "it said so"
    )
    monkeypatch.setattr(case, "failing_function", lambda *them: asked.append(them) or broken)

    def check(here: Case) -> Any:
        yield here.finding("first", 0.0, 0.0, "passed", "by hand")
        raise ValueError("it")

    here = of()
    first, found = here.evaluate(Claim("own", "", "", "it", check))
    assert (first.subject, found.claim, found.subject) == ("first", "own", "functions")
    assert (found.observed, found.allowed, found.verdict, found.evidence, found.detail) == outcome
    ((scene, state),) = asked
    assert scene is SNAKE and np.array_equal(state.q, Q)
    if broken:
        assert here.error_finding(ValueError("")).detail == broken
        return
    with pytest.raises(ValueError, match=r"^$"):
        here.error_finding(ValueError(""))


def test_terms_that_cannot_be_computed_are_no_finite_terms(monkeypatch):
    class Raising(Evaluation):
        @property
        def terms(self):
            raise ValueError("it")

    monkeypatch.setattr(case, "scene_function_that_raised", lambda scene, error: "it said so")
    monkeypatch.setattr(case, "failing_function", lambda *_: "terms broke")
    here = replace(of("bias"), at=Raising(SNAKE, Q, V))
    found = here.terms_failure
    assert found is not None
    assert (found.claim, found.verdict, found.detail) == ("finite-terms", "failed", "terms broke")
    assert here.claim is CLAIMS["bias"]
    assert of().terms_failure is None


# ---- Formulations and partitions -----------------------------------------------------------------


def test_of_formulations_those_that_refuse_are_told_from_those_that_solve(monkeypatch):
    asked: list[str] = []

    def solved(at: Evaluation, formulation: Any) -> Any:
        asked.append(formulation.key)
        if formulation.key in ("el", "kane"):
            raise RefusedError("it", 0.0, 1.0, "no")
        return SimpleNamespace(vdot=formulation.key)

    monkeypatch.setattr(case, "solution_of", solved)
    them = tuple(FORMULATIONS[key] for key in ("el", "au", "kane", "ml"))
    here = replace(of(), formulations=them)
    assert here.refused == ("el", "kane")
    assert [f.key for f in here.solved] == ["au", "ml"]
    assert [(f.key, x.vdot) for f, x in here.solutions] == [("au", "au"), ("ml", "ml")]
    assert here.result(them[0]) is None and here.result(them[3]).vdot == "ml"
    assert asked == ["el", "au", "kane", "ml"], "each is solved once"


@pytest.mark.parametrize("exist", [True, False])
def test_speeds_exist_where_they_are_not_refused(exist: bool):
    class Without(Evaluation):
        @property
        def speeds(self):
            if exist:
                return super().speeds
            raise RefusedError("it", 0.0, 1.0, "no")

    assert replace(of(), at=Without(SNAKE, Q, V)).has_speeds == exist


@pytest.mark.parametrize(
    ("kept", "redundant", "weights", "rows"),
    [
        (None, None, [0.125, -0.25, 0.5], ([0, 1, 3], [2])),
        ([0, 2], [1], [0.125, 0.0, -0.5], ([0, 3], [1, 2])),
        ([1], [0, 2], [0.0, 0.25, 0.0], ([3], [0, 2, 1])),
    ],
)
def test_a_row_is_added_that_is_all_of_them_in_turn_and_the_last_one_follows(
    kept, redundant, weights, rows
):
    a = np.array([[0.0, 4.0, 1.0, 0.0], [2.0, 0.0, -1.0, 0.0], [0.0, 0.5, 0.0, 1.0]])
    named = {"kept": kept and np.array(kept), "redundant": redundant and np.array(redundant)}
    partition = case.Partition(np.arange(2), np.arange(2, 4), **named)
    at: Any = SimpleNamespace(terms=SimpleNamespace(a=a), independent_partition=partition)
    found, taken = Case(at, (), ()).added_row
    assert found.tolist() == weights
    assert (taken.kept.tolist(), taken.redundant.tolist()) == rows
    assert taken.dependent is partition.dependent


def test_a_copy_has_no_sensitivity_of_its_own(monkeypatch):
    asked: list[Any] = []
    monkeypatch.setattr(
        case, "sensitivity_of", lambda *them, **how: asked.append((them, how)) or 3.5
    )
    here, quantity = of(), partial(max, 1)
    assert here.sensitivity(quantity) == 3.5
    here.at.is_perturbed = True
    assert here.sensitivity(quantity) == 0.0
    assert asked == [((here.at, quantity), {})]


def test_parts_of_results_are_measured_once_each(monkeypatch):
    asked: list[Any] = []

    def measured(at: Any, formulation: Any, part: str, *, coordinates: bool) -> float:
        asked.append((formulation.key, part, coordinates))
        return float(len(asked))

    monkeypatch.setattr(case, "acceleration_sensitivity", measured)
    here, au, ml = of(), FORMULATIONS["au"], FORMULATIONS["ml"]
    for _ in range(2):
        assert here.vdot_sensitivity(au) == 1.0
        assert here.multiplier_sensitivity(au) == 2.0
        assert here.vdot_sensitivity(ml) == 3.0
        assert here.part_sensitivity(au, "vdot", coordinates=True) == 4.0
    vdot, multipliers = ("au", "vdot", False), ("au", "multipliers", False)
    assert asked == [vdot, multipliers, ("ml", "vdot", False), ("au", "vdot", True)]


def test_a_state_is_told_with_its_time():
    here = Case(Evaluation(SNAKE, Q, V, 0.75), (), (), CLAIMS["bias"])
    found = here.finding("it", 1.0, 2.0, "passed", "by hand", "so", engine=CasadiEngine)
    assert found == Finding(
        "bias", "it", SNAKE, here.state, 1.0, 2.0, "passed", "by hand", "so", engine=None
    )
    assert isinstance(found.state, State) and found.state.t == 0.75
    assert here.finding("it", 1.0, 2.0, "passed", "by hand", engine=Tried).engine is Tried
    assert here.directions.tolist() == np.eye(5).tolist()
    assert here.direction_names == SNAKE.coordinate_names
    assert here.free is here.at and not here.exact and here.others == ()
