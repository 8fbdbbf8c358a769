"""Screening: whatever fails is suspect, the worst suspects are judged, nothing is left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.claims.wrong import with_entry
from tests.lab.test_fuzzing import ALL, KEYS, STRATUM, Wrong, plan

import eomcheck
from eomcheck.claims.batched_claims import BatchedCase, batchable_claims
from eomcheck.claims.finding import INCONCLUSIVE_CODE, Finding
from eomcheck.draws.fuzz_cases import ORDINARY, consistent, draw_cases
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import screening, state_rounds
from eomcheck.lab.fuzzing import screening as triage
from eomcheck.lab.fuzzing.campaign import Round, RoundResult
from eomcheck.lab.fuzzing.failures import (
    FailureRecord,
    failure_record,
    replay_failures,
    shrink,
)
from eomcheck.lab.fuzzing.screening import (
    DECIDED,
    OPEN,
    SCENE,
    TRUTH,
    CheckFrequency,
    ScreeningResult,
    diagnose_failure,
    failed_findings,
    screen,
)
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES, Sleigh, Snake, snake

FORMULAE = tuple(FORMULATIONS.values())


def ordinary(kind: Any, count: int) -> list:
    return draw_cases(kind, STRATUM, (ORDINARY,), count, np.random.default_rng(2))[0]


# ---- Nothing is left out -------------------------------------------------------------------------


def test_every_claim_of_a_campaign_is_looked_at_in_lanes_or_by_check(monkeypatch):
    """With a ration of one in one, also what differs from lane to lane: pivoted partitions."""
    asked, subjects, in_lanes = set(), set(), set()
    right, look = triage.check_case, BatchedCase.evaluate

    def recorded(case, claims, *how):
        found = right(case, claims, *how)
        asked.update(claims)
        subjects.update(one.subject for one in found)
        return found

    def looked(self, claims):
        found = look(self, claims)
        in_lanes.update(one.claim for one in found)
        return found

    monkeypatch.setattr(state_rounds, "check_case", recorded)
    monkeypatch.setattr(BatchedCase, "evaluate", looked)
    here = plan(batch=2, families=(ORDINARY,), climbing=False, engines=("pinocchio",))
    replace(here, check_frequency=CheckFrequency(1, 1, 1, 0, 1)).run(Round(0, STRATUM, {}))
    assert in_lanes >= set(batchable_claims(ALL)) - NOT_ON_A_SNAKE
    assert asked | in_lanes >= set(ALL) - NOT_ON_A_SNAKE - {"true-error"}
    assert "em, pivoted" in subjects and "invariance" in in_lanes


NOT_ON_A_SNAKE = {"position-rate", "redundant-rows", "height-velocity"}
"""Claims that a snake gives nothing for in lanes."""


def test_what_is_wrong_only_when_the_scene_is_moved_is_suspect_for_that():
    class Pulled(Snake, functions=()):
        """A snake that is pulled along x: no claim about a force but `invariance` needs U."""

        @staticmethod
        def terms(parameters, prepared, q, v):
            found = snake.terms(parameters, prepared, q, v)
            pull = np.zeros(len(q), dtype=np.asarray(q).dtype) + 0 * q[0]
            pull[0] = pull[0] + parameters.mass[0]
            return found._replace(Q=pull if found.Q is None else found.Q + pull)

    found = screen(ordinary(Pulled, 4), FORMULAE, ("invariance",), enclosed_every=0)
    assert all("invariance" in claims for claims in found.suspects.values())
    assert len(found.suspects) == 4


# ---- The worst suspects are judged ---------------------------------------------------------------


def test_of_many_suspects_the_highest_are_judged(monkeypatch):
    cases = ordinary(Snake, 4)
    found = ScreeningResult(4, {("bias", ""): np.array([2.0, 9.0, 5.0, 0.5])})
    found.suspects = {0: {"bias"}, 1: {"bias"}, 2: {"bias"}}
    judged = []

    def nothing(case, claims, *_):
        judged.append(next(i for i, one in enumerate(cases) if one is case))
        return []

    monkeypatch.setattr(state_rounds, "screen", lambda *_: found)
    monkeypatch.setattr(state_rounds, "check_case", nothing)
    result = RoundResult(0, STRATUM, {})
    state_rounds.screen_and_judge(plan(), result, cases, set(), 2)
    assert judged == [1, 2]
    assert result.counts["suspect"] == 3 and result.counts["suspects judged"] == 2


@pytest.mark.parametrize(("error", "suspect"), [(3e-12, True), (3e-13, False)])
def test_a_true_error_a_little_above_its_bound_is_suspect(monkeypatch, error, suspect):
    """An error that is a number, rad/s², where the bound is 9e-13."""
    cases = ordinary(Snake, 1)
    monkeypatch.setattr(screening, "true_error", lambda vdot, truth: np.full(len(vdot), error))
    found = screen(cases, FORMULAE[:1], ("true-error",), enclosed_every=1)
    assert bool(found.suspects) == suspect


def test_a_true_error_is_told_of_the_state_at_which_it_was_found(monkeypatch):
    """Of states of two structures, every other is enclosed: neither is numbered as in its batch."""
    slow = [(scene, State(*scene.initial_state(), 0.0)) for scene in map(Snake.coil, (2, 3))]
    cases = [slow[0], slow[0], slow[1], slow[1], slow[0], slow[1]]

    def wrong_of_three(vdot, truth):
        return np.full(len(vdot), 1.0 if len(vdot) == 5 else 0.0)

    monkeypatch.setattr(screening, "true_error", wrong_of_three)
    found = screen(cases, FORMULAE[:1], ("true-error",), enclosed_every=2, first=1)
    ((key, heights),) = found.scores.items()
    assert key == (TRUTH, FORMULAE[0].key) and found.enclosed == 3
    assert found.suspects == {3: {"true-error"}, 5: {"true-error"}}
    assert np.flatnonzero(heights > 1.0).tolist() == [3, 5]


@pytest.mark.parametrize("shares", [(0.5, 0.75, 0.25), (0.75, 0.25, 0.5), (0.25, 0.5, 0.75)])
def test_of_the_subjects_of_a_claim_and_formulation_the_highest_counts(monkeypatch, shares):
    right = BatchedCase.evaluate

    def look(self, claims):
        for one in right(self, claims):
            for share in shares:
                yield one._replace(observed=np.array([share, 0.125]) * one.allowed)

    monkeypatch.setattr(BatchedCase, "evaluate", look)
    found = screen(ordinary(Snake, 2), FORMULAE[:1], ("kinetic-energy",), enclosed_every=0)
    assert found.max_scores.tolist() == pytest.approx([0.75, 0.125])


@pytest.mark.parametrize(("ratio", "enclosed"), [(0.35, 1), (0.25, 0)])
def test_a_state_near_its_bound_is_enclosed_whatever_the_ration_says(monkeypatch, ratio, enclosed):
    right = BatchedCase.evaluate

    def look(self, claims):
        for one in right(self, claims):
            yield one._replace(observed=ratio * one.allowed)

    monkeypatch.setattr(BatchedCase, "evaluate", look)
    found = screen(
        ordinary(Snake, 1), FORMULAE[:1], ("kinetic-energy",), enclosed_every=100, first=1
    )
    assert found.enclosed == enclosed


def test_a_claim_that_no_lane_decides_is_counted_beside_those_that_are(monkeypatch):
    """Where rounding explains everything, of what one claim says."""
    right = BatchedCase.evaluate

    def look(self, claims):
        for one in right(self, claims):
            if one.claim == "kinetic-energy":
                one = one._replace(verdict=np.full_like(one.verdict, INCONCLUSIVE_CODE))
            yield one

    monkeypatch.setattr(BatchedCase, "evaluate", look)
    found = screen(
        ordinary(Snake, 3), FORMULAE[:1], ("kinetic-energy", "equations-residual"), enclosed_every=0
    )
    assert found.by_claim[OPEN, "kinetic-energy"] == found.verdicts["inconclusive"] == 3
    assert found.by_claim[DECIDED, "kinetic-energy"] == 0
    assert found.by_claim[DECIDED, "equations-residual"] == found.verdicts["passed"] > 0
    result = RoundResult(0, STRATUM, {})
    cases = ordinary(Snake, 2)
    state_rounds.screen_and_judge(
        plan(claims=("kinetic-energy", "equivalence")), result, cases, set(), 0
    )
    assert result.counts[f"{OPEN}kinetic-energy"] == 2


# ---- Terms that are not finite -------------------------------------------------------------------


@pytest.mark.parametrize("name", ["M", "Q", "B", "a", "gamma", "b"])
def test_a_state_with_a_term_that_is_not_finite_is_told_of_as_such(name: str):
    kind: Any = type(SCENES["turntable-ball"].example() if name == "b" else Snake.coil(2))

    def terms(parameters, prepared, q, v):
        found = kind.terms(parameters, prepared, q, v)
        term = getattr(found, name)
        huge = with_entry(term, (-1,) * term.ndim, lambda x: (x + 2) * 2**1000 * 2**1000)
        return found._replace(**{name: huge})

    Bad: Any = type("Bad", (kind,), {"terms": staticmethod(terms)})
    if name == "b":
        scene = Bad.example()
        start = scene.initial_state()
        cases = [(scene, State(*start, 0.3))]
    else:
        cases = [
            (Bad(**{x: getattr(scene, x) for x in Snake.declared}), state)
            for scene, state in ordinary(Snake, 2)
        ]
    found = screen(cases, FORMULAE, ALL, enclosed_every=0)
    assert found.non_finite == list(range(len(cases)))


def test_of_several_structures_the_states_that_are_not_finite_are_those_told_of():
    slow = [(scene, State(*scene.initial_state(), 0.0)) for scene in map(Snake.coil, (2, 3))]
    fast = [(scene, state._replace(v=state.v + 1e200)) for scene, state in slow]
    cases = [slow[0], slow[1], fast[1], slow[0], slow[1], fast[0], fast[1]]
    found = screen(cases, FORMULAE, ("kinetic-energy",), enclosed_every=0)
    assert sorted(found.non_finite) == [2, 5, 6]
    assert found.verdicts["passed"] == 4


# ---- The truth at its time -----------------------------------------------------------------------


def driven_case() -> tuple[Any, State]:
    scene = SCENES["turntable-ball"].example()
    q, _ = scene.initial_state()
    return scene, State(q, eomcheck.velocity(scene, q, [0.5, -0.4, 0.3], t=0.7), 0.7)


@pytest.mark.parametrize("speeds", [True, False])
def test_a_driven_scene_is_enclosed_at_its_time_in_lanes(speeds: bool, monkeypatch):
    case = driven_case()
    able = tuple(f for f in FORMULAE if f.applies_to(case[0]))
    if not speeds:
        able = tuple(f for f in able if not f.in_speeds)
        monkeypatch.setattr(
            type(case[0]), "refuse_speeds", lambda self, q: (_ for _ in ()).throw(_refused())
        )
    found = screen([case], able, ("true-error",), enclosed_every=1)
    assert found.enclosed == 1 and not found.suspects
    assert {key for claim, key in found.scores if claim == TRUTH} == {f.key for f in able}


def _refused() -> Exception:
    return eomcheck.RefusedError("speeds", 0.0, 1.0, "a test")


def test_whose_fault_a_failure_is_is_told_by_the_truth_at_its_time():
    """At t = 0 the truth is another one, and a right formulation would be a silent error."""
    scene, state = driven_case()
    failed = Finding("power-balance", "au", scene, state, 1.0, 0.1, "failed", "made up")
    fault = diagnose_failure(failed)
    assert fault.at_fault == triage.ALARM
    kept = failure_record(failed, "turntable-ball", fault)
    assert kept.t == kept.case[1].t == 0.7 and "t=0.7" in kept.python


# ---- Of a pair both are held against the truth ---------------------------------------------------


@pytest.mark.parametrize("wrong", ["au", "im"])
def test_of_a_pair_either_formulation_is_held_against_the_truth(wrong: str, monkeypatch):
    (case,) = ordinary(Snake, 1)
    finding = Finding("equivalence", "au ~ im", *case, 1.0, 0.1, "failed", "made up")
    right = triage.acceleration

    def answer(scene, key, *arguments, **options):
        found = right(scene, key, *arguments, **options)
        if key == wrong:
            found = replace(found, vdot=found.vdot + 1e-3)
        return found

    monkeypatch.setattr(triage, "acceleration", answer)
    fault = diagnose_failure(finding)
    assert fault.at_fault == triage.SILENT and f"{wrong}: true error" in fault.evidence


@pytest.mark.parametrize(("share", "whose"), [(1.5, triage.SILENT), (0.5, triage.ALARM)])
def test_an_error_a_little_above_its_bound_is_a_silent_one(share, whose, monkeypatch):
    ((scene, state),) = ordinary(Snake, 1)
    finding = Finding("equivalence", "au ~ im", scene, state, 1.0, 0.1, "failed", "made up")
    right = triage.acceleration

    def answer(*arguments, **options):
        found = right(*arguments, **options)
        return replace(found, vdot=found.vdot + share * found.error_bound)

    monkeypatch.setattr(triage, "acceleration", answer)
    assert diagnose_failure(finding).at_fault == whose


class OnTrial(CasadiEngine):
    key = "on_trial"


@pytest.mark.parametrize(
    ("wrong", "engine", "whose"),
    [
        ({"kinetic-energy"}, None, triage.SCENE),
        (set(), None, triage.ENGINE),
        (None, None, triage.UNKNOWN),
        (None, OnTrial, triage.ENGINE),
        ({"kinetic-energy"}, OnTrial, triage.ENGINE),
    ],
)
def test_an_engine_of_ours_is_blamed_only_where_the_scene_is_proved(
    monkeypatch, wrong, engine, whose
):
    ((scene, state),) = ordinary(Snake, 1)
    monkeypatch.setattr(triage, "unproved", lambda scene: wrong)
    own = Finding("kinetic-energy", "scene", scene, state, 1.0, 0.1, "failed", "made up")
    finding = replace(own, claim="mass-matrix", subject="casadi", engine=engine)
    assert diagnose_failure(finding).at_fault == whose
    others = {None: triage.UNKNOWN, False: triage.ALARM, True: triage.SCENE}
    assert diagnose_failure(own).at_fault == others[wrong if wrong is None else bool(wrong)]


class Overdamped(Snake, functions=()):
    """A snake of which the dampers act twice: with dampers it is wrong."""

    @staticmethod
    def terms(parameters, prepared, q, v):
        found = snake.terms(parameters, prepared, q, v)
        return found if parameters.damping is None else found._replace(Q=2 * found.Q)


def test_what_is_proved_of_one_structure_says_nothing_of_another_or_of_another_kind():
    damped = {"damping": [0.5]}
    scenes = [
        (Overdamped.coil(2), False),
        (replace(Overdamped.coil(2), **damped), True),
        (Snake.coil(2), False),
        (replace(Snake.coil(2), **damped), False),
    ]
    triage._unproved.cache_clear()
    for scene, wrong in scenes:
        assert ("active-forces" in (triage.unproved(scene) or ())) == wrong
    assert triage._unproved.cache_info().misses == 4
    # Other numbers are the same structure, which is proved once.
    assert triage.unproved(replace(scenes[1][0], damping=[0.7]))
    assert triage._unproved.cache_info().misses == 4


# ---- Kept failures of all claims -----------------------------------------------------------------


@pytest.mark.night
def test_a_kept_failure_of_all_claims_is_checked_by_all():
    (case,) = ordinary(Wrong, 1)
    scene, (q, v, t) = case
    parameters = {name: _plain(getattr(scene, name)) for name in Snake.declared}
    of_all = {"parameters": parameters, "q": q.tolist(), "v": v.tolist(), "t": float(t)}
    right = FailureRecord("snake", **of_all)
    (holds,) = replay_failures([right], KEYS)
    assert holds.outcome == "holds"
    name = f"{__file__}:Wrong"
    (fails,) = replay_failures([FailureRecord(name, **of_all)], KEYS)
    assert fails.outcome == "failed"


def _plain(x: Any) -> Any:
    return x.tolist() if isinstance(x, np.ndarray) else x


class Broken(Sleigh):
    """A user's scene of which a function raises in every state."""

    @staticmethod
    def terms(parameters, prepared, q, v):
        raise ValueError("no axle")


def test_a_scene_of_which_a_function_raises_everywhere_is_the_failure_and_is_not_shrunk():
    scene = Broken.example()
    q, v = scene.initial_state()
    states = [State(q, v, 0.0), State(2.0 * q, v, 0.5)]
    cases, kept = consistent([scene, scene], states, pytest.fail)
    assert kept == [0, 1]
    assert [x.v.tolist() for _, x in cases] == [[0.0] * 3] * 2
    assert [x.q.tolist() for _, x in cases] == [x.q.tolist() for x in states]
    (failed,) = failed_findings(cases[0], ["finite-terms"], [])
    at_fault, evidence = diagnose_failure(failed)
    assert at_fault == SCENE
    assert evidence.startswith("Broken.terms raised ValueError: no axle (test_screening.py, line ")
    assert shrink(failed, []) is failed
