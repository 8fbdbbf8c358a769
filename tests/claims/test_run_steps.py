"""A run step by step, with findings made up: what is asked, kept, counted, drawn and handed on."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import eomcheck
from eomcheck.claims import CLAIMS as ALL_CLAIMS
from eomcheck.claims import Finding, run
from eomcheck.claims.case import Case
from eomcheck.claims.finding import entries_of
from eomcheck.claims.run import RunSelection, SceneEngines, StateResult, ValidationRun
from eomcheck.errors import InconsistentVelocityError
from eomcheck.evaluation.perturbed import CONSISTENT_HINT
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES, Sleigh, Snake

SCENE = Sleigh()
CLAIMS = ("finite-terms", "bias", "kinetic-energy")


def state(x: float) -> State:
    return State(np.array([x, 0.0, 0.5]), np.zeros(3), x / 8)


def said(claim: str, verdict: Any = "passed", subject: str = "one", detail: str = "", x=1.0):
    how = 0.0, 1.0, verdict, "made up", detail
    return Finding(claim, subject, SCENE, state(x), *how)


def selected(**more: Any) -> RunSelection:
    return replace(RunSelection.of(engines=[], claims=CLAIMS, scenes=[SCENE]), **more)


# ---- One state -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("broken", "finite", "asked", "refused"),
    [
        (None, True, CLAIMS, ("em",)),
        (None, False, CLAIMS[:1], ()),
        (said("finite-terms", "failed"), True, (), ()),
    ],
)
def test_claims_are_asked_of_numbers_alone(monkeypatch, broken, finite, asked, refused):
    case = SimpleNamespace(terms_failure=broken, finite=finite, refused=("em",))
    given: list[Any] = []
    monkeypatch.setattr(run, "make_case", lambda *them: given.append(them) or case)
    monkeypatch.setattr(run, "evaluate_claim", lambda asked, case, claim: [said(claim.id)] * 2)
    here: Any = (SceneEngines(SCENE, (), {}), state(1.0), selected(), 7)
    found = run.evaluate_state(*here)
    assert given == [(*here, None)]
    claims = [one.claim for one in found.findings]
    assert claims == ([broken.claim] if broken else [x for x in asked for _ in range(2)])
    assert found.refused == refused
    assert found.seconds.keys() == {*CLAIMS}


def test_engines_are_made_once_for_each_scene(monkeypatch):
    made, looked = [], []

    def asked_of(scene: Any, _: RunSelection) -> SceneEngines:
        made.append(scene)
        return SceneEngines(scene, (), {})

    def look(
        asked: SceneEngines, state: State, selection: RunSelection, often: int, at: Any, number: int
    ) -> StateResult:
        looked.append((asked.scene, state, often))
        return StateResult([], {}, ())

    monkeypatch.setattr(run, "make_scene_engines", asked_of)
    monkeypatch.setattr(run, "evaluate_state", look)
    heavy, one = Sleigh(mass=7.0), ValidationRun()
    cases = [(SCENE, state(1)), (SCENE, state(2)), (heavy, state(3)), (SCENE, state(4))]
    for scene, at in cases:
        one.check_state(scene, at, selected())
    assert [x is y for x, y in zip(made, [SCENE, heavy, SCENE], strict=True)] == [True] * 3
    assert [x[:2] for x in looked] == cases
    assert [x[2] for x in looked] == [run.OFTEN, run.OFTEN, run.ONCE, run.ONCE]
    list(one._evaluate_serially(cases, selected()))
    assert [x[2] for x in looked[4:]] == [run.OFTEN, run.ONCE, run.ONCE, run.ONCE]


@pytest.mark.parametrize(
    ("again", "told"),
    [
        (said("bias", "skipped", "mine", "no bias"), False),
        (said("bias", "skipped", "mine", "no bias", x=5.0), False),
        (said("bias", "skipped", "other", "no bias"), True),
        (said("bias", "skipped", "mine", "no forces"), True),
        (said("mass-matrix", "skipped", "mine", "no bias"), True),
        (said("bias", "passed", "mine", "no bias"), True),
        (said("bias", "inconclusive", "mine", "no bias"), True),
        (said("equivalence", "skipped", "mine", "refused"), True),
        (said("equivalence", "skipped", "mine", "not rational: it"), False),
    ],
)
def test_what_cannot_be_told_is_told_once(again: Finding, told: bool):
    one = ValidationRun()
    first = [
        said("bias", "skipped", "mine", "no bias"),
        said("equivalence", "skipped", "mine", "refused"),
        said("equivalence", "skipped", "mine", "not rational: it"),
    ]
    assert one._add_result(StateResult(first, {"bias": 2.0}, ("au",))) == first
    assert one._add_result(StateResult([again, *first[:1]], {"bias": 0.5}, ())) == (
        [again] if told else []
    )
    assert (one.ends, one.cases) == ([3, 3 + told], 2)
    assert one.findings == first + [again] * told
    assert (one.seconds["bias"], one.refused) == (2.5, ())


# ---- Drawn states --------------------------------------------------------------------------------


def test_drawing_ends_at_the_first_failure_and_that_is_made_smaller(monkeypatch):
    first, second = said("bias", "failed", x=2.0), said("kinetic-energy", "failed", x=2.0)
    heavy = Sleigh(mass=9.0)
    failing = [said("finite-terms", x=2.0), replace(first, scene=heavy), second]
    looks = [
        (SCENE, state(1.0), StateResult([said("bias")], {}, ("em",))),
        (SCENE, state(2.0), StateResult(failing, {}, ("el", "em"))),
        (SCENE, state(3.0), StateResult([said("bias")], {}, ())),
    ]
    calls, handed, count = [], [], []
    minimal = said("bias", "failed", x=0.0)
    monkeypatch.setattr(run, "smallest_failure", lambda *them: handed.append(them) or minimal)

    def looking(cases: Any, selection: RunSelection):
        calls.append((cases, selection))
        yield from looks

    one, chosen, cases = ValidationRun(), selected(), [(SCENE, state(1.0))]
    how = {"on_case": lambda: count.append(one.cases), "seed": 11, "runner": looking}
    one.explore(cases, chosen, shrink_among=lambda scene: ("smaller", scene), **how)
    assert calls == [(cases, chosen)]
    assert count == [1, 2]
    assert [x.refused for x in one.sampled] == [("em",), ("el", "em")]
    assert [x.state.q[0] for x in one.sampled] == [1.0, 2.0]
    assert handed == [(failing[1], ("smaller", heavy), chosen, 11)]
    assert one.minimal is minimal and one.ends == [1, 4]

    again = ValidationRun()
    again.explore(cases, chosen, runner=looking)
    assert again.minimal is failing[1], "nobody says what is smaller"
    right = ValidationRun()
    how = {"shrink_among": lambda scene: 1 / 0, "runner": lambda *_: (one for one in looks[::2])}
    right.explore(cases, chosen, **how)
    assert right.minimal is None and right.cases == 2


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("kind", [False, True])
def test_the_states_of_a_run_are_drawn_as_asked(monkeypatch, named: bool, kind: bool):
    calls: list[Any] = []

    def drawing(name: str):
        def drawn(*them: Any, **more: Any) -> list[Any]:
            calls.append((name, *them, *more.items()))
            return [(name, them[1] if name == "wide" else None)]

        return drawn

    def wide(cases: Any, seed: int) -> list[Any]:
        calls.append(("wide", seed))
        return [*cases, "wide"]

    for name in ("state_cases", "scene_cases", "no_larger", "states_of"):
        monkeypatch.setattr(run, name, drawing(name))
    monkeypatch.setattr(run, "with_wide", wide)

    class Recording(ValidationRun):
        def check_state(self, scene, state, selection):
            calls.append(("start", repr(scene), state.q.tolist(), state.v.tolist(), state.t))
            return []

        def explore(self, cases, selection, on_case, shrink_among, seed, runner):
            calls.append(("explore", list(cases), on_case, seed, runner))
            shrink_among("scene")

    chosen, count, scene = selected(engines_named=named), [], Snake.coil(2)
    on_case, looks = lambda: count.append(1), object()
    if kind:
        Recording().validate_kind(Snake, chosen, (2, 5), 9, 4, on_case, looks)
        scene = Snake.example()
    else:
        Recording().validate_scene(scene, chosen, 9, 4, on_case, looks)
    assert count == [1], "the state that it begins with"
    begin = [call for call in calls if call[0] == "start"]
    q, v = scene.initial_state()
    assert begin == [("start", repr(scene), q.tolist(), v.tolist(), 0.0)]
    rest = [call for call in calls if call[0] != "start"]
    if kind:
        assert [repr(x) for x in rest[0]] == [repr(x) for x in ("state_cases", scene, 1, 4)]
        assert rest[1] == ("scene_cases", Snake, (2, 5), 9, 4)
        assert rest[-1] == ("no_larger", "scene", ("links", (2, 5)))
    else:
        assert rest[0] == ("state_cases", scene, 9, 4)
        assert rest[-1] == ("states_of", "scene")
    assert [call[1:] for call in rest if call[0] == "wide"] == [(4,)] * named
    drawn = [("state_cases", None), *([("scene_cases", None)] * kind), *(["wide"] * named)]
    assert rest[-2] == ("explore", drawn, on_case, 4, looks)


# ---- The end -------------------------------------------------------------------------------------


def hidden(claim: str, x: float) -> Finding:
    names = (("a", "b"),)
    flags = entries_of(names, np.array([1, 0], bool), np.array([0, 1], bool))
    return replace(said(claim, x=x), entries=flags)


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("covers", [False, True])
@pytest.mark.parametrize("drawn", [False, True])
def test_a_run_ends_with_what_holds_of_all_its_states(monkeypatch, failed, covers, drawn):
    known = []

    def by_proof(claim: Any, left: Any, proofs: dict) -> Any:
        known.append(proofs)
        kept = left if claim.id == "mass-matrix" else []
        return [said(claim.id, detail="proved")], kept

    monkeypatch.setattr(run, "prove_unresolved", by_proof)
    monkeypatch.setattr(run, "coverage", lambda drawn: said("coverage", detail=f"{len(drawn)}"))
    one = ValidationRun(
        findings=[hidden("mass-matrix", 1.0), hidden("bias", 2.0), said("kinetic-energy")]
    )
    one.minimal = said("bias", "failed") if failed else None
    one.sampled = [run.SampledState(SCENE, state(1.0), ())] * 3 if drawn else []
    chosen = selected(claims=("mass-matrix", *(["coverage"] * covers)))
    found = one.finish(chosen)
    assert found is one.findings
    ends = [(f.claim, f.verdict, f.detail) for f in found[3:]]
    open_ = "not resolved in this state: one, row b"
    whole = [("mass-matrix", "passed", "proved"), ("mass-matrix", "inconclusive", open_)]
    whole.append(("bias", "passed", "proved"))
    expected = [] if failed else whole
    expected += [("coverage", "passed", "3")] if covers and drawn else []
    expected += [("bias", "failed", "")] if failed else []
    assert ends == expected
    assert len({id(x) for x in known}) == (0 if failed else 1)


# ---- What is called ------------------------------------------------------------------------------


def test_a_state_is_checked_at_its_time():
    scene = SCENES["turntable-ball"].example()
    q, _ = scene.initial_state()
    v = eomcheck.velocity(scene, q, [0.5, -0.4, 0.3], t=0.7)
    how: Any = {"engines": [], "claims": ["finite-terms"]}
    selection = RunSelection.of(scenes=[scene], **how)
    in_a_run = ValidationRun().check_state(scene, State(q, v, 0.7), selection)
    for found in (eomcheck.check_state(scene, q, v, 0.7, **how), in_a_run):
        assert {one.state.t for one in found} == {0.7}
        assert all(one.state.v.tolist() == v.tolist() for one in found)


def test_a_velocity_is_refused_beyond_what_is_let_pass(monkeypatch):
    given = []
    right = run.check_consistent

    def recorded(at: Any, *more: Any) -> None:
        given.append(more)
        right(at, *more)

    monkeypatch.setattr(run, "check_consistent", recorded)
    q, _ = SCENE.initial_state()
    eomcheck.check_state(SCENE, q, [0, 0, 1.0], engines=[], claims=["finite-terms"])
    assert given == [(CONSISTENT_HINT,)]
    with pytest.raises(InconsistentVelocityError):
        eomcheck.check_state(SCENE, q, [0.0, 0.5, 1.0], engines=[], claims=["finite-terms"])
    how: Any = {"engines": [], "claims": ["finite-terms"], "consistent": False}
    assert eomcheck.check_state(SCENE, q, [0.0, 0.5, 1.0], **how)


def test_a_validation_asks_for_what_it_was_told(monkeypatch):
    calls: list[Any] = []
    right = RunSelection.of.__func__

    def of(cls: Any, *them: Any, **more: Any) -> RunSelection:
        calls.append((them, more))
        return right(cls, *them, **more)

    monkeypatch.setattr(RunSelection, "of", classmethod(of))
    monkeypatch.setattr(ValidationRun, "validate_scene", lambda self, *them: calls.append(them))
    monkeypatch.setattr(
        ValidationRun, "check_state", lambda self, *them: calls.append(them) or ["found"]
    )
    monkeypatch.setattr(
        ValidationRun, "finish", lambda self, chosen: calls.append(chosen) or ["finished"]
    )
    how: Any = {"formulations": ["kane"], "engines": ["casadi"], "claims": ["bias", "coverage"]}
    asked = (["kane"], ["casadi"], ["bias", "coverage"])
    assert eomcheck.validate(SCENE, examples=6, seed=8, **how) == ["finished"]
    chosen = calls[-1]
    assert calls == [(asked, {"scenes": [SCENE]}), (SCENE, chosen, 6, 8), chosen]
    assert (chosen.claims, chosen.engines_named) == (("bias", "coverage"), True)
    assert [f.key for f in chosen.formulations] == ["kane"]
    calls.clear()
    q, v = SCENE.initial_state()
    assert eomcheck.check_state(SCENE, q, v, **how) == ["found"]
    assert calls[0] == (asked, {"scenes": [SCENE]})
    calls.clear()
    eomcheck.validate(SCENE)
    assert calls[0] == ((None, None, None), {"scenes": [SCENE]})
    assert calls[1][2:] == (25, 0)


@pytest.mark.parametrize(
    ("claim", "formulations", "needs"),
    [("equivalence", ["kane"], "two formulations"), ("position-rate", None, "loop closures")],
)
def test_a_claim_that_is_named_and_does_not_apply_is_skipped_with_its_reason(
    claim, formulations, needs
):
    scene = Sleigh.example()
    options = {"claims": [claim, "bias"], "formulations": formulations, "engines": ["casadi"]}
    findings = eomcheck.validate(scene, examples=1, **options)
    (skipped,) = (one for one in findings if one.claim == claim)
    assert (skipped.verdict, skipped.state) == ("skipped", None)
    assert needs in skipped.detail
    assert {one.verdict for one in findings if one.claim == "bias"} == {"passed"}


def test_all_claims_together_leave_out_those_that_do_not_apply():
    scene = Sleigh.example()
    findings = eomcheck.validate(scene, examples=1)
    assert not any(one.claim == "position-rate" for one in findings)


def test_a_claim_tells_all_that_it_needs():
    needs = {one.id: one.requirements for one in ALL_CLAIMS.values()}
    assert needs["engine-multipliers"] == "constraints, and an engine that offers acceleration"
    assert needs["mass-matrix"] == "an engine that offers mass_matrix"
    assert needs["kinetic-energy"] == "other states of this scene"


def test_claims_are_named_by_the_argument_alone():
    assert not RunSelection.of().claims_named
    assert not RunSelection.of(claims=list(ALL_CLAIMS)).claims_named
    assert RunSelection.of(claims=["bias"]).claims_named
    chosen = RunSelection.of(default=["bias", "mass-matrix"])
    assert chosen.claims == ("bias", "mass-matrix") and not chosen.claims_named
    named = RunSelection.of(claims=["refusals"], default=["bias"])
    assert named.claims == ("refusals",) and named.claims_named


def test_a_named_claim_that_does_not_apply_at_a_state_is_skipped_with_its_reason():
    scene = Sleigh()
    state = np.array([0.1, 0.2, 0.3]), np.zeros(3)
    claims = ["equivalence", "kinetic-energy"]
    how = {"formulations": ["kane"], "engines": []}
    *decided, skipped = eomcheck.check_state(scene, *state, claims=claims, **how)
    assert {(one.claim, one.verdict) for one in decided} == {("kinetic-energy", "passed")}
    assert (skipped.claim, skipped.verdict) == ("equivalence", "skipped")
    assert skipped.detail == "needs two formulations that solve one state"
    every = eomcheck.check_state(scene, *state, **how)
    assert "equivalence" not in {one.claim for one in every}


def test_terms_that_are_not_finite_are_reported_whichever_claims_are_named(monkeypatch):
    monkeypatch.setattr(Case, "finite", False)
    how: Any = {"claims": ["kinetic-energy"], "engines": []}
    findings = eomcheck.check_state(Sleigh(), np.zeros(3), np.zeros(3), **how)
    assert {one.claim for one in findings if one.verdict != "skipped"} == {"finite-terms"}
