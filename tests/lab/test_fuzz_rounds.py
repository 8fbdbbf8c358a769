"""Rounds and campaigns piece by piece: what is asked where, what is climbed to, what is counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.lab.test_fuzzing import KEYS, STRATUM, plan
from tests.lab.test_fuzzing_own import Rough, RoughAndWrong, planar

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.batched_claims import BatchedCase
from eomcheck.draws.fuzz_cases import FAMILIES, ORDINARY, StructuralVariant, draw_cases
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import campaign as campaigns
from eomcheck.lab.fuzzing import failures as smaller
from eomcheck.lab.fuzzing import screening, state_rounds
from eomcheck.lab.fuzzing import screening as triage
from eomcheck.lab.fuzzing.campaign import (
    CASES_PER_KEY,
    Campaign,
    Round,
    RoundResult,
    ScoredCase,
    update_population,
)
from eomcheck.lab.fuzzing.failures import failure_record
from eomcheck.lab.fuzzing.motion_rounds import MotionPlan
from eomcheck.lab.fuzzing.screening import (
    DECIDED,
    TRUTH,
    CheckFrequency,
    Diagnosis,
    ScreeningResult,
    runs_in_lanes,
    screen,
)
from eomcheck.lab.fuzzing.state_rounds import (
    FunctionsPlan,
    RandomStatePlan,
    StatePlan,
    clamped_to_ranges,
    engine_scores,
    engines_under_test,
    is_ordinary,
)
from eomcheck.mechanics.records import State
from eomcheck.scenes import SCENES, Sleigh, Snake

FEW = tuple(FORMULATIONS[key] for key in ("au", "kane"))
LINKED = StructuralVariant(2, ("damping",))


@cache
def ordinary(kind: Any, count: int) -> tuple:
    return tuple(draw_cases(kind, LINKED, (ORDINARY,), count, np.random.default_rng(2))[0])


def finding(claim: str, subject: str, verdict: Any = "failed", observed: float = 1.0, **more):
    case = Sleigh.example(), State(np.zeros(3), np.zeros(3), 0.0)
    return Finding(claim, subject, *case, observed, 0.5, verdict, "made up", **more)


# ---- What is climbed from ------------------------------------------------------------------------


def test_of_each_claim_the_highest_are_kept_highest_first_and_nothing_of_height_0():
    population: Any = {("a", "x"): [ScoredCase(5.0, "old"), ScoredCase(0.5, "low")]}
    cases = list("abcdefghi")
    heights = {
        ("a", "x"): np.array([1.0, 7.0, 0.0, 3.0, 2.0, 9.0, 0.1, 4.0, 0.2]),
        ("b", ""): np.array([0.0, 0.0, 0.0, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("c", ""): np.zeros(9),
    }
    update_population(population, heights, cases)
    assert {key: [tuple(one) for one in best] for key, best in population.items()} == {
        ("a", "x"): [(9.0, "f"), (7.0, "b"), (5.0, "old"), (4.0, "h"), (3.0, "d"), (2.0, "e")],
        ("b", ""): [(1e-9, "d")],
    }
    assert CASES_PER_KEY == 6


def test_seeds_of_either_sign_and_all_rounds_draw_other_numbers(monkeypatch):
    def first(seed: int, number: int) -> float:
        drawn: list[float] = []
        monkeypatch.setattr(
            StatePlan, "search", lambda self, _, random: drawn.append(random.random())
        )
        plan(seed=seed).run(Round(number, STRATUM, {}))
        return drawn[0]

    drawn = [first(seed, number) for seed in (-2, -1, 0, 1, 2) for number in range(3)]
    assert len(set(drawn)) == len(drawn)
    assert first(-2, 1) == first(-2, 1)


def test_the_highest_claim_is_climbed_from_more_often_and_the_highest_of_its_cases(monkeypatch):
    state = State(np.zeros(3), np.zeros(3), 0.0)
    population: Any = {
        ("low", ""): [ScoredCase(0.1 - i / 100, (f"low {i}", state)) for i in range(6)],
        ("high", ""): [ScoredCase(0.9 - i / 100, (f"high {i}", state)) for i in range(6)],
    }
    monkeypatch.setattr(state_rounds, "mutated", lambda pairs, *_: (pairs, [*range(len(pairs))]))
    found: Any = state_rounds.hill_climbed(population, 400, np.random.default_rng(0))
    parents = Counter(case[0] for case, _ in found)
    others = Counter(other[0] for _, other in found)
    # The higher of three that are drawn is the low one once in eight times.
    assert 0.8 < sum(x for name, x in parents.items() if "high" in name) / 400 < 0.95
    assert 0.35 < parents["high 0"] / 350 < 0.5 and parents["high 0"] > parents["high 1"]
    assert parents["high 5"] > parents["high 4"] > 0
    # What else numbers are taken from is any case of any claim.
    assert len(others) == 12 and max(others.values()) < 70


def test_a_climb_goes_in_steps_from_what_lanes_found_and_then_from_what_engines_did(monkeypatch):
    asked: list = []
    population: Any = {
        ("bias", "kane"): [ScoredCase(0.5, 1)],
        ("bias", "on_trial"): [ScoredCase(0.7, 2)],
    }
    monkeypatch.setattr(
        state_rounds, "engines_under_test", lambda engines: [SimpleNamespace(key="on_trial")]
    )

    def climbed(of, count, random):
        asked.append((sorted(of), count))
        return ["case"] * (count - 1)

    def look_at(plan, result, cases, ordinary, most):
        asked.append((len(cases), ordinary, most))

    monkeypatch.setattr(state_rounds, "hill_climbed", climbed)
    monkeypatch.setattr(state_rounds, "screen_and_judge", look_at)
    monkeypatch.setattr(
        state_rounds, "climb_for_engines", lambda plan, result, of, random: asked.append(sorted(of))
    )
    result = RoundResult(0, STRATUM, population)
    plan(batch=16).climb(result, np.random.default_rng(0))
    assert asked == [([("bias", "kane")], 4), (3, set(), 6)] * 4 + [[("bias", "on_trial")]]
    assert result.counts["climbed"] == 12


def test_engines_on_trial_are_asked_as_often_near_their_highest_as_in_the_round(monkeypatch):
    case = Sleigh.example(), State(np.zeros(3), np.zeros(3), 0.0)
    other = case[0], State(np.ones(3), np.zeros(3), 0.0)
    near = [other, case, other, case, case, case]
    asked: list = []

    class Mine(CasadiEngine):
        key = "mine"

    def checked(one, claims, formulations, engines):
        assert one is case
        asked.append((tuple(claims), tuple(engines)))
        height = 0.1 * len(asked)
        return [
            finding("bias", "mine", "passed", height, engine=Mine),
            finding("mass-matrix", "mine", "failed", 3.0, engine=Mine),
        ]

    def climbed(population, count, random, tame):
        asked.append(("climbed", count, tame))
        return near

    monkeypatch.setattr(state_rounds, "hill_climbed", climbed)
    monkeypatch.setattr(state_rounds, "check_case", checked)
    monkeypatch.setattr(state_rounds, "is_ordinary", lambda one: one is case)
    monkeypatch.setattr(state_rounds, "engines_under_test", lambda engines: (Mine,))
    result = RoundResult(0, STRATUM, {}, counts=Counter({"engines": 3}))
    here = plan(claims=("bias", "mass-matrix", "kinetic-energy"))
    state_rounds.climb_for_engines(here, result, {("bias", "mine"): []}, np.random.default_rng(0))
    assert asked == [("climbed", 6, clamped_to_ranges)] + [(("bias", "mass-matrix"), (Mine,))] * 3
    assert result.counts["engines, climbed"] == 3 and len(result.failed) == 3
    assert [x.score for x in result.population["bias", "mine"]] == pytest.approx([0.8, 0.6, 0.4])


# ---- Which states are asked what -----------------------------------------------------------------


def test_every_other_ordinary_case_is_wide_where_engines_were_named(monkeypatch):
    cases, families = draw_cases(Snake, LINKED, FAMILIES, 12, np.random.default_rng(0))
    places = {i for i, family in enumerate(families) if family == ORDINARY}
    before = list(cases)
    found, again = plan().widened((list(cases), families), np.random.default_rng(1))
    assert again is families and all(x is y for x, y in zip(found, before, strict=True))
    found, _ = plan(wide=True).widened((list(cases), families), np.random.default_rng(1))
    changed = {i for i, (x, y) in enumerate(zip(found, before, strict=True)) if x[1] is not y[1]}
    assert changed == set(sorted(places)[1::2])
    again, _ = plan(wide=True).widened((list(cases), families), np.random.default_rng(2))
    assert any(x[1].q.tolist() != again[i][1].q.tolist() for i, x in enumerate(found))
    asked: list = []
    monkeypatch.setattr(state_rounds, "screen_and_judge", lambda *how: asked.append(how[2:]))
    plan().check(RoundResult(0, LINKED, {}), (cases, families), np.random.default_rng(1))
    assert asked == [(cases, places)]


ENGINES = tuple(one for one in CLAIMS if CLAIMS[one].asks)[:2]


@pytest.mark.parametrize(
    ("ration", "named", "expected"),
    [
        (CheckFrequency(0, 0, 2, 0, 0), True, {1: set(ENGINES)}),
        (CheckFrequency(0, 0, 2, 0, 0), False, {}),
        (CheckFrequency(0, 0, 0, 5, 0), True, {2: {"power-balance", "enclosures", "true-error"}}),
        (CheckFrequency(0, 7, 0, 0, 0), False, {2: {"enclosures"}}),
        (CheckFrequency(1, 0, 0, 0, 0), True, {}),
    ],
)
def test_rations_go_on_counting_where_the_states_before_ended(monkeypatch, ration, named, expected):
    """Round 3 of batches of 16 begins with state 96, of which 7 were looked at already."""
    judged: dict[Any, set[str]] = {}
    engines: list = []

    def checked(case, claims, formulations, asked):
        judged[case] = set(claims)
        engines.append(tuple(asked))
        return []

    monkeypatch.setattr(state_rounds, "check_case", checked)
    monkeypatch.setattr(state_rounds, "screen", lambda *how: ScreeningResult(4))
    monkeypatch.setattr(state_rounds, "update_population", lambda *how: None)
    result = RoundResult(3, STRATUM, {}, counts=Counter({"states": 7}))
    claims = (*ENGINES, "power-balance", "enclosures", "true-error")
    here = plan(claims=claims, check_frequency=ration, engines=("pinocchio",) if named else ())
    # States 103 to 106: the second and the fourth are even, the third is a multiple of 5 and 7.
    state_rounds.screen_and_judge(here, result, range(4), {1, 2})  # type: ignore[arg-type]
    assert judged == expected
    assert result.counts["states"] == 11
    asked = any(CLAIMS[one].asks for of in expected.values() for one in of)
    assert set(engines) <= {("pinocchio",) if asked else ()}


def test_a_suspect_of_the_truth_is_as_high_as_its_true_error_is_judged_to_be(monkeypatch):
    said = [
        finding("true-error", "au", "passed", 0.4),
        finding("true-error", "kane", "passed", 0.25),
        finding("true-error", "em", "inconclusive", 9.0),
    ]
    monkeypatch.setattr(state_rounds, "check_case", lambda *_: said)
    monkeypatch.setattr(state_rounds, "update_population", lambda *how: None)
    found = ScreeningResult(
        2,
        {(TRUTH, "kane"): np.array([9.0, 9.0]), ("bias", ""): np.array([8.0, 0.1])},
        {0: {"true-error"}},
    )
    monkeypatch.setattr(state_rounds, "screen", lambda *how: found)
    result = RoundResult(0, STRATUM, {})
    state_rounds.screen_and_judge(plan(), result, range(2), set())  # type: ignore[arg-type]
    assert found.scores[TRUTH, "kane"].tolist() == [0.8, 9.0]
    assert found.scores["bias", ""].tolist() == [8.0, 0.1]  # it is not suspect by that


def test_what_engines_on_trial_come_to_is_the_largest_that_passed():
    class Mine(planar.Planar):
        key = "mine"

    of = {"engine": Mine}
    found = engine_scores(
        [
            finding("bias", "a", "passed", 0.2, **of),
            finding("bias", "b", "passed", 0.4, **of),
            finding("bias", "c", "passed", 0.1, **of),
            finding("bias", "d", "failed", 3.0, **of),
            finding("bias", "e", "inconclusive", 3.0, **of),
            finding("bias", "f", "passed", 0.5),
            finding("mass-matrix", "a", "passed", 0.05, **of),
        ]
    )
    assert found == {("bias", "mine"): 0.8, ("mass-matrix", "mine"): 0.1}
    assert engines_under_test((Mine, "pinocchio", "nobody")) == (Mine,)


def test_what_left_the_ordinary_ranges_comes_back_to_their_ends():
    scene, state = ordinary(Snake, 1)[0]
    assert is_ordinary((scene, state))
    of = {name: getattr(scene, name) for name in Snake.declared}
    heavy = type(scene)(**(of | {"mass": [1e3, 1e-3]}))
    far = np.array([30.0, -20.0, 9.0, -11.0])
    back, q, v = clamped_to_ranges((heavy, far, np.array([60.0, 0.0, 0.0, 80.0])))
    assert back.mass.tolist() == [10.0, 0.1] and back.damping is None
    assert np.array_equal(back.length, scene.length)
    assert q.tolist() == [10.0, -10.0, 9.0, -10.0]
    # |v| at most 5 in each of four directions; half of it where it was more than half.
    assert v == pytest.approx([3.0, 0.0, 0.0, 4.0])
    _, _, slow = clamped_to_ranges((scene, state.q, np.array([3.0, 0.0, 0.0, 3.9])))
    assert slow.tolist() == [3.0, 0.0, 0.0, 3.9]
    at = State(np.zeros(4), np.zeros(4), 0.0)
    edges = {
        "q": [np.full(4, 9.99), np.array([0.0, 0.0, 0.0, -10.01])],
        "v": [np.array([9.9, 0.0, 0.0, 0.0]), np.array([10.1, 0.0, 0.0, 0.0])],
    }
    for name, (inside, outside) in edges.items():
        assert is_ordinary((scene, at._replace(**{name: inside})))
        assert not is_ordinary((scene, at._replace(**{name: outside})))
    assert not is_ordinary((heavy, at))
    assert not is_ordinary((type(scene)(**(of | {"mass": [1.0, 1e-3]})), at))


def test_ordinary_states_of_what_the_clock_drives_are_within_its_time():
    scene = SCENES["turntable-ball"].example()
    q, _ = scene.initial_state()
    told = {t: is_ordinary((scene, State(q, 0 * q, t))) for t in (-0.1, 0.0, 9.9, 10.1)}
    assert told == {-0.1: False, 0.0: True, 9.9: True, 10.1: False}


# ---- Screening -----------------------------------------------------------------------------------


def test_what_no_lanes_can_run_is_judged_state_by_state_with_its_place():
    assert runs_in_lanes(Snake) and not runs_in_lanes(Rough) and runs_in_lanes(Sleigh)
    found = screen(ordinary(RoughAndWrong, 1), FEW[:1], ("power-balance",), enclosed_every=1)
    assert (found.non_finite, found.suspects) == ([], {0: {"power-balance"}})
    assert found.enclosed == 0  # no balls can run them either
    assert found.max_scores[0] > 1.0 and found.verdicts["failed"] == 1


def test_of_what_no_lanes_can_run_every_verdict_counts_once_and_the_highest_is_told(monkeypatch):
    told = [
        finding("equivalence", "au ~ kane", "passed", 0.4),
        finding("equivalence", "kane ~ au", "passed", 0.1),
        finding("equivalence", "kane", "failed", 2.0),
        finding("equivalence", "kane, again", "inconclusive", 40.0),
        finding("equivalence", "au", "skipped", 90.0),
        finding("power-balance", "scene", "inconclusive", 7.0),
    ]
    lost = finding("finite-terms", "B", "failed")

    def checked(case, claims, keys):
        assert keys in ([], ["au", "kane"])
        return told if keys else [lost] if case == "lost" else []

    monkeypatch.setattr(screening, "check_case", checked)
    found, cases = ScreeningResult(3), ["case", "lost", "case"]
    screening._screen_one_by_one(found, np.array([2, 1, 0]), cases, FEW, ("equivalence",))  # type: ignore[arg-type]
    assert found.non_finite == [1]
    assert found.scores["equivalence", "au"].tolist() == [0.8, 0.0, 0.8]
    assert found.scores["equivalence", "kane"].tolist() == [4.0, 0.0, 4.0]
    assert set(found.scores) == {("equivalence", "au"), ("equivalence", "kane")}
    assert found.suspects == {2: {"equivalence"}, 0: {"equivalence"}}
    assert found.verdicts == {"passed": 4, "failed": 2, "inconclusive": 4, "skipped": 2}
    assert found.by_claim == {
        (DECIDED, "equivalence"): 6,
        (screening.OPEN, "equivalence"): 2,
        (screening.OPEN, "power-balance"): 2,
    }
    assert found.max_scores.tolist() == [4.0, 0.0, 4.0]


def test_differences_that_underflow_show_no_way_up(monkeypatch):
    right = BatchedCase.evaluate

    def look(self, claims):
        for one in right(self, claims):
            tiny = np.array([1e-310, 1e-3])
            yield one._replace(observed=np.array([0.0, 5e-4]) + tiny / 2, allowed=tiny)

    monkeypatch.setattr(BatchedCase, "evaluate", look)
    found = screen(ordinary(Snake, 2), FEW[:1], ("kinetic-energy",), enclosed_every=0)
    assert found.max_scores.tolist() == pytest.approx([0.0, 1.0])


def test_a_formulation_that_refuses_is_not_held_against_the_truth(monkeypatch):
    right = BatchedCase.refused
    monkeypatch.setattr(
        BatchedCase, "refused", lambda self, key: right(self, key) | (key == "kane")
    )
    monkeypatch.setattr(screening, "true_error", lambda vdot, truth: np.full(len(vdot), 1.0))
    found = screen(ordinary(Snake, 1), FEW, ("true-error",), enclosed_every=1)
    heights = {key: x.tolist() for (claim, key), x in found.scores.items() if claim == TRUTH}
    assert heights.pop("au")[0] > 1.0 and heights in ({}, {"kane": [0.0]})


def test_each_structure_is_proved_for_itself(monkeypatch):
    """A fault of a term that some structures lack is told of those that have it."""
    asked: list[str] = []

    def prove(scene, points, seed):
        asked.append(scene.structure)
        said = "failed" if scene.damping is not None else "passed"
        return [SimpleNamespace(claim="bias", verdict=said, proof=1)]

    monkeypatch.setattr(triage, "prove", prove)
    triage._unproved.cache_clear()
    try:
        coils = [Snake.coil(2), Snake.coil(3), Snake.coil(2)]
        of = {name: getattr(coils[0], name) for name in Snake.declared}
        damped = Snake(**(of | {"damping": [0.5]}))
        found = [triage.unproved(one) for one in (*coils, damped)]
    finally:
        triage._unproved.cache_clear()
    assert found == [frozenset(), frozenset(), frozenset(), frozenset({"bias"})]
    assert len(asked) == 3


# ---- Finds ---------------------------------------------------------------------------------------


def test_a_failure_is_looked_for_at_the_first_finds_and_else_made_small_by_its_seed(monkeypatch):
    asked: list = []
    failed, small, here = (
        finding("power-balance", name, engine=None) for name in ("failed", "small", "here")
    )
    at: dict[str, list] = {"a": [], "b": [], "c": [], "d": [here]}

    def alike(one, case, formulations):
        asked.append(case)
        return at[case]

    monkeypatch.setattr(state_rounds, "alike", alike)
    monkeypatch.setattr(
        state_rounds, "shrink", lambda one, keys, seed: asked.append((keys, seed)) or small
    )
    monkeypatch.setattr(campaigns, "diagnose_failure", lambda one: None)
    monkeypatch.setattr(campaigns, "failure_record", lambda one, name, _: (one.subject, name))
    known: Any = [SimpleNamespace(case=case) for case in "abcd"]
    plans = plan(seed=7, formulations=("au", "kane"))
    assert plans.record_failure(failed, "x", known) == ("small", "x")
    assert asked == ["a", "b", "c", (("au", "kane"), 7)]
    asked.clear()
    assert plans.record_failure(failed, "x", known[1:]) == ("here", "x") and asked == [
        "b",
        "c",
        "d",
    ]
    asked.clear()
    assert plans.record_failure(failed, "x") == ("failed", "x") and asked == []


def test_failures_alike_are_of_one_claim_and_cause(monkeypatch):
    told = [finding("equivalence", x) for x in ("im ~ kane", "kane ~ au", "au ~ kane")]
    asked: list = []

    def failures(case, claims, formulations):
        asked.append(claims)
        return told

    monkeypatch.setattr(smaller, "failed_findings", failures)
    failed, case = finding("equivalence", "au ~ kane"), ordinary(Snake, 1)[0]
    assert smaller.alike(failed, case, KEYS) == told[1:]
    assert asked == [["equivalence"]]
    engine = finding(ENGINES[0], "casadi")
    assert smaller.alike(engine, case, KEYS) == [] and len(asked) == 1


# ---- Campaigns -----------------------------------------------------------------------------------


@dataclass
class Worked:
    """Rounds of five states each, that are written down."""

    seed: int = 0
    max_states: int = 10
    each: int = 5
    settings: dict = field(default_factory=dict)
    rounds: list = field(default_factory=list)
    failing: Sequence[Finding] = ()

    def run(self, round_: Round) -> RoundResult:
        self.rounds.append(round_)
        assert len(self.rounds) < 50
        population: Any = dict(round_.population)
        key = "bias", round_.variant.name
        height = {0: 0.5, 1: 0.75}.get(round_.number, 0.25)
        population[key] = [ScoredCase(height, f"case {round_.number}"), *population.get(key, ())]
        return RoundResult(
            round_.number,
            round_.variant,
            population,
            list(self.failing),
            counts=Counter({"states": self.each, "ordinary": 3}),
            undecided={"bias": f"why {round_.number}"},
            seconds=2.0,
            cpu_seconds=0.5,
        )

    def record_failure(self, failed, name, known=None):
        suffix = "" if known is None else f", of {len(known)}"
        return failure_record(failed, name, Diagnosis("scene", f"by hand{suffix}"))


STRATA = [StructuralVariant(n, ()) for n in (1, 2, 3)]


def campaign(work: Worked) -> Campaign:
    return Campaign(work, "worked", STRATA)  # type: ignore[arg-type]


def test_every_generation_has_every_structure_and_climbs_from_its_own():
    work = Worked()
    one, told = campaign(work), []
    one.run(states=45, on_round=lambda here: told.append((here.rounds, here.states)))
    assert told == [(i, 5 * i) for i in range(1, 10)]
    assert [given.number for given in work.rounds] == [*range(9)]
    for i in range(0, 9, 3):
        assert {given.variant for given in work.rounds[i : i + 3]} == set(STRATA)
    for given in work.rounds:
        (best,) = given.population.values() or ([],)
        earlier = [
            f"case {x.number}"
            for x in work.rounds
            if x.variant == given.variant and x.number < given.number
        ]
        assert [x.case for x in best] == earlier[::-1]
    assert one.counts == {"states": 45, "ordinary": 27}
    assert one.by_variant == {x.name: 15 for x in STRATA}
    assert (one.seconds, one.cpu_seconds, one.resumed) == (18.0, 4.5, 0)
    names = {given.number: given.variant.name for given in work.rounds}
    assert one.worst["bias", names[1]].score == 0.75
    assert {x.score for key, x in one.worst.items() if key[1] != names[1]} == {0.5, 0.25}
    # Why nothing was decided is told by the first round.
    assert one.undecided == {"bias": "why 0"}
    orders = [[names[i + k] for k in range(3)] for i in (0, 3, 6)]
    assert len({tuple(x) for x in orders}) > 1


def test_the_order_of_variants_is_drawn_by_the_seed_and_by_the_generation():
    variants = [StructuralVariant(n, ()) for n in range(1, 9)]

    def orders(seed: int) -> list[list[int]]:
        work = Worked(seed=seed)
        Campaign(work, "worked", variants).run(states=2 * 5 * len(variants))  # type: ignore[arg-type]
        numbers = [one.variant.links for one in work.rounds]
        return [numbers[: len(variants)], numbers[len(variants) :]]

    first, second = orders(1), orders(2)
    assert first == orders(1)
    different = {tuple(order) for order in first + second}
    assert len(different) == 4
    assert {tuple(sorted(order)) for order in different} == {tuple(range(1, 9))}


@pytest.mark.parametrize(("states", "expected"), [(1, 1), (5, 1), (6, 2), (16, 4), (31, 7)])
def test_a_campaign_ends_with_the_first_round_that_has_enough_states(states, expected):
    work = Worked()
    campaign(work).run(states=states)
    assert len(work.rounds) == expected


def test_a_campaign_ends_when_its_time_is_up_or_its_states_are_many_whichever_is_first(monkeypatch):
    now = [0.0]

    class Slow(Worked):
        def run(self, round_):
            now[0] += 2.0
            return super().run(round_)

    monkeypatch.setattr(campaigns.time, "time", lambda: now[0])
    for limits, expected in (
        ({"seconds": 5.0}, 3),
        ({"seconds": 4.0}, 2),
        ({"seconds": 5.0, "states": 100}, 3),
        ({"seconds": 50.0, "states": 10}, 2),
    ):
        work = Slow()
        campaign(work).run(**limits)
        assert len(work.rounds) == expected, limits


def test_a_new_cause_is_made_small_while_there_is_time_and_a_known_one_only_counts():
    failed = [finding("equivalence", x) for x in ("kane", "kane", "au", "kane", "kane")]
    for late, evidence in ((False, ["by hand, of 0", "by hand, of 1"]), (True, ["by hand"] * 2)):
        one = campaign(Worked(failing=failed))
        one._take(one.plan.run(Round(0, STRATA[0], {})), lambda late=late: late)
        assert [find.evidence for find in one.failure_records.values()] == evidence
        assert one.failure_counts == {("equivalence", "kane"): 4, ("equivalence", "au"): 1}


def test_a_plan_looks_at_no_more_states_than_it_says():
    here = plan(batch=6, climbing=True)
    assert here.max_states == 12 and replace(here, batch=7).max_states == 14
    random = RandomStatePlan(**vars(plan(batch=6)))
    assert random.max_states == 6 * (2 * state_rounds.STRUCTURES + 1)


# ---- Random kinds --------------------------------------------------------------------------------


def test_of_earlier_rounds_the_structure_of_the_highest_of_some_claim_is_climbed_on_from():
    A, B = Sleigh.example(), Snake.coil(2)
    population: Any = {
        ("a", ""): [ScoredCase(3.0, (A, 1)), ScoredCase(2.0, (B, 2)), ScoredCase(1.0, (A, 3))],
        ("b", ""): [ScoredCase(9.0, (A, 4)), ScoredCase(8.0, (B, 5))],
        ("c", ""): [ScoredCase(7.0, (B, 6))],
    }
    found = [
        state_rounds._population_of_best_structure(population, np.random.default_rng(seed))
        for seed in range(9)
    ]
    numbers = {
        tuple((key[0], *[x.case[1] for x in best]) for key, best in one.items()) for one in found
    }
    assert numbers == {(("a", 1, 3), ("b", 4)), (("a", 2), ("b", 5), ("c", 6))}


def test_what_is_merged_is_each_case_once_the_highest_first():
    one: Any = [ScoredCase(float(x), str(x)) for x in (9, 7, 5, 3, 1)]
    more: Any = [ScoredCase(0.5, "low"), one[1], ScoredCase(8.0, "new")]
    best = {("a", ""): list(one)}
    state_rounds._merge(best, {("a", ""): more, ("b", ""): more[:1]})
    assert [x.case for x in best["a", ""]] == ["9", "new", "7", "5", "3", "1"]
    assert best["b", ""] == more[:1]


CHANGED: dict[str, Any] = {
    "seed": 8, "claims": ("motion",), "formulations": ("au",), "engines": ("casadi",),
    "families": ("special",), "climbing": False, "batch": 3,
    "check_frequency": CheckFrequency(0, 0, 1, 0, 0), "wide": True,
}  # fmt: skip
"""Another value of each field of a plan, but of what the campaign's name tells."""


@pytest.mark.parametrize(
    "plan",
    [
        StatePlan(Snake, 7, ("equivalence",), ("em", "gw")),
        RandomStatePlan(Snake, 7, ("equivalence",), ("em", "gw")),
        MotionPlan(Snake, 7, ("em", "gw")),
        FunctionsPlan("mine.py:own", 7, ("bias-even",)),
    ],
)
def test_a_campaign_goes_on_only_with_rounds_of_the_same_settings(plan: Any):
    names = {one.name for one in fields(plan)} - {"kind", "name"}
    assert names <= CHANGED.keys()
    others = [replace(plan, **{name: CHANGED[name]}).settings for name in names]
    assert plan.settings not in others
    assert len({str(one) for one in others}) == len(names)
