"""Claims in lanes: they come to what they come to alone."""

from __future__ import annotations

from collections.abc import Sequence
from unittest.mock import patch

import numpy as np
import pytest
from tests.claims.test_every_claim_fails import ABOUT, EMBEDDING, MACHINE_CODE, sample, shape_of
from tests.claims.wrong import Part, share, with_entry, wrong_formulation, wrong_scene

from eomcheck import strategies
from eomcheck.claims import CLAIMS, Case
from eomcheck.claims.batched_claims import ABSENT, batchable_claims, batched_cases
from eomcheck.claims.finding import (
    FAILED_CODE,
    INCONCLUSIVE_CODE,
    PASSED_CODE,
    judge,
    verdict_codes,
)
from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link, distance
from eomcheck.draws.pairwise_design import scene_cases
from eomcheck.engines import ENGINES
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import UNDERFLOW, allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.screening import screen
from eomcheck.lab.fuzzing.state_rounds import StatePlan, sampled
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Snake
from eomcheck.strategies import draw_samples

NAMES = {
    ABSENT: "absent",
    PASSED_CODE: "passed",
    FAILED_CODE: "failed",
    INCONCLUSIVE_CODE: "inconclusive",
}
RESIDUAL = "constraint-acceleration"
ALL = tuple(FORMULATIONS.values())
UNLIFTED = {"redundant-rows"}
"""Claims by sides that lanes cannot tell: which rows depend on others differs from lane to lane."""
LIFTED = tuple(one for one in batchable_claims(tuple(CLAIMS)) if one not in UNLIFTED)

Verdicts = dict[tuple[int, str, str], tuple[str, float, float]]


def alone(cases: Sequence[tuple[Scene, State]]) -> Verdicts:
    """Return (verdict, observed, allowed) by case, claim and subject, as `check` judges."""
    found: Verdicts = {}
    for i, (scene, state) in enumerate(cases):
        able = tuple(f for f in ALL if f.applies_to(scene))
        case = Case(Evaluation(scene, *state), able, ())
        for claim in LIFTED:
            for one in case.evaluate(CLAIMS[claim]):
                found[i, claim, one.subject] = one.verdict, one.observed, one.allowed
        for f in able:
            found[i, "refused", f.key] = str(f.key in case.refused), 0.0, 0.0
    return found


def in_lanes(cases: Sequence[tuple[Scene, State]]) -> Verdicts:
    """Return the same, found in lanes."""
    found: Verdicts = {}
    for places, case in batched_cases(cases, ALL):
        for one in case.evaluate(LIFTED):
            for lane, i in enumerate(places):
                verdict = NAMES[one.verdict[lane]], one.observed[lane], one.allowed[lane]
                if one.verdict[lane] != ABSENT:
                    found[int(i), one.claim, one.subject] = verdict
        for f in case.formulations:
            for lane, i in enumerate(places):
                found[int(i), "refused", f.key] = str(bool(case.refused(f.key)[lane])), 0.0, 0.0
        assert case.not_batched.keys() <= UNLIFTED
        assert not any("Error" in why for why in case.not_batched.values()), "a sentence"
    return found


def differences(cases: Sequence[tuple[Scene, State]]) -> list[tuple]:
    """Return the subjects of which lanes say something else; no lane has pivoted partitions."""
    one, other = alone(cases), in_lanes(cases)
    both = {key for key in one.keys() | other.keys() if not key[2].endswith("pivoted")}
    nothing = "absent", 0.0, 0.0
    found = [(key, one.get(key, nothing), other.get(key, nothing)) for key in sorted(both)]
    return [(key, x, y) for key, x, y in found if x[0] != y[0]]


@pytest.mark.night
def test_on_ordinary_snakes_lanes_judge_as_the_single_path_but_for_invariance_looked_at_again(
    sized,
):
    cases = list(scene_cases(Snake, (1, 7), sized(40, 10), seed=2))
    found = differences(cases)
    assert all(key[1] == "invariance" and y[0] == "failed" for key, _, y in found), found
    assert len(found) <= 3


@pytest.mark.sampled(12)
@pytest.mark.parametrize("kind", SCENES.values(), ids=lambda kind: kind.key)
def test_every_claim_of_every_scene_can_be_looked_at_in_lanes(kind: type[Scene]):
    found = differences(list(scene_cases(kind, (1, 3), 3, seed=1)))
    assert all(key[1] == "invariance" and y[0] == "failed" for key, _, y in found), found


def test_claims_that_are_evaluated_at_one_state_are_left_to_the_single_path():
    alone = {id for id, claim in CLAIMS.items() if not claim.batchable}
    assert {"center-of-mass-rates", "frame-rates", "regressor-identity"} <= alone
    assert not alone & set(batchable_claims(tuple(CLAIMS)))
    cases = list(scene_cases(Snake, (2, 2), 2, seed=1))
    screening = screen(cases, ALL, tuple(CLAIMS), 0)
    assert not alone & {claim for _, claim in screening.by_claim}
    plan = StatePlan(Snake, 0, tuple(CLAIMS), tuple(FORMULATIONS))
    checked = {one for how, _, claims in sampled(plan, screening, 0, set()) for one in claims}
    assert alone <= checked


Bob = mechanism(
    "Bob",
    [Link("ground"), Link("rail", 1.0), Link("bob", 1.0)],
    [
        Joint("x", "prismatic", "ground", "rail", axis=(1.0, 0.0, 0.0)),
        Joint("y", "prismatic", "rail", "bob", axis=(0.0, 1.0, 0.0)),
    ],
    [distance("rod", "bob", "ground", 1.0)],
)
"""A bob on a rod, whose generalized speed is ẏ: of none where the rod is upright."""


def test_where_a_lane_has_no_speeds_what_needs_none_is_judged():
    scene, residual = Bob(), {}
    cases = [
        (scene, State(np.array(q), np.array([-q[1], q[0]]), 0.0)) for q in ([0.6, 0.8], [0.0, -1.0])
    ]
    ((_, case),) = batched_cases(cases, ALL)
    for one in case.evaluate(["constraint-acceleration"]):
        residual[one.subject] = [NAMES[verdict] for verdict in one.verdict]
    refusing = {"el", "em", "ml", "kane"}
    assert residual == {
        f.key: ["passed", "absent" if f.key in refusing else "passed"] for f in case.formulations
    }


@pytest.mark.night
def test_what_is_allowed_in_lanes_is_what_is_allowed_alone(sized):
    cases = list(scene_cases(Snake, (2, 6), sized(25, 8), seed=5))
    one, other = alone(cases), in_lanes(cases)
    of_results, of_terms = [], []
    for key in one.keys() & other.keys():
        if one[key][2] > UNDERFLOW and np.isfinite(one[key][2]) and key[1] != "invariance":
            results = key[1] in OF_RESULTS
            (of_results if results else of_terms).append(other[key][2] / one[key][2])
    assert len(of_results) > 45 * len(cases) and len(of_terms) > 15 * len(cases)
    # The same noise: but for the order of sums in products, not another draw of it.
    assert np.percentile(of_terms, 1) > 0.7 and np.mean(np.greater(of_terms, 0.95)) > 0.95
    assert np.mean(np.greater(of_results, 0.95)) > 0.75 and min(of_results) > 0.1
    for ratios in (of_terms, of_results):
        assert np.percentile(ratios, 99) < 1.3 and max(ratios) < 4.0
    assert np.percentile(of_results, 99) < 1.05


OF_RESULTS = {"equivalence", "multipliers", "constraint-acceleration", "equations-residual"}
"""Claims of results: what rounds in the terms alone is not looked at in lanes."""


@pytest.mark.night
def test_on_hostile_snakes_lanes_differ_only_where_nothing_can_be_told(sized):
    strategy = strategies.scene_states(strategies.hostile_snakes(1, 4), strategies.hostile_states)
    cases = [
        (scene, state)
        for scene, state in draw_samples(strategy, sized(90, 20), 4)
        if all(np.isfinite(x).all() for x in Evaluation(scene, *state).terms if x is not None)
    ]
    assert len(cases) > sized(45, 15)
    found = differences(cases)
    # Rows of nothing but rounding are refused as in machine code; Python scales them first.
    no_digit = {
        (i, f) for (i, claim, f), (_, _, x), _ in found if claim == RESIDUAL and x == np.inf
    }
    for key, (verdict, _, allowed), (there, _, _) in found:
        # Where the scene as it was moved is refused, or noise is lost, lanes do not ask.
        looked_at_again = key[1] == "invariance" and verdict != "failed"
        tiny = verdict == "passed" and there == "inconclusive" and allowed <= UNDERFLOW
        # Whether a rank is clear is told by the single path.
        of_rank = "uk" in key[2].replace(":", " ").split() and verdict == "absent"
        of_rank |= key[1:] == ("refused", "uk")
        named = key[2].replace(":", " ").split()
        hopeless = any((key[0], f) in no_digit for f in named) and verdict != "failed"
        assert looked_at_again or tiny or of_rank or hopeless, (key, verdict, there, allowed)


def test_a_wrong_bias_fails_in_lanes(monkeypatch):
    from eomcheck.scenes import snake

    class Wrong(Snake, functions=()):
        terms = staticmethod(_with_wrong_bias(snake.terms))

    cases = list(scene_cases(Snake, (3, 3), 8, seed=1))
    wrong = [
        (Wrong(**{name: getattr(scene, name) for name in Snake.declared}), state)
        for scene, state in cases
        if state.v.any()
    ]
    failed = {key[1] for key, (verdict, _, _) in in_lanes(wrong).items() if verdict == "failed"}
    assert {"equivalence", "kane-ml-force", "power-balance"} <= failed


def _with_wrong_bias(terms):
    def wrong(parameters, prepared, q, v):
        found = terms(parameters, prepared, q, v)
        return found._replace(B=-found.B)

    return wrong


@pytest.mark.parametrize("less", [0, 1])
def test_velocities_that_are_not_finite_fail_in_lanes_and_are_not_taken_for_refused(less: int):
    """Infinite, or infinite less infinite."""

    def qdot(*arguments):
        assert Snake.qdot is not None
        right = Snake.qdot(*arguments)
        huge = (right[0] + 2) * 2**1000 * 2**1000
        return with_entry(right, (0,), lambda x: huge - less * huge)

    Wrong = type("Wrong", (Snake,), {"qdot": staticmethod(qdot)})
    cases = [
        (Wrong(**{name: getattr(scene, name) for name in Snake.declared}), state)
        for scene, state in scene_cases(Snake, (2, 2), 2, seed=1)
    ]
    for places, case in batched_cases(cases, ALL):
        found = {one.subject: one for one in case.evaluate(["speeds-velocity"])}["q̇"]
        assert [NAMES[verdict] for verdict in found.verdict] == ["failed"] * len(places)


def test_verdicts_by_number_are_those_of_judge():
    random = np.random.default_rng(0)
    among = np.array([0.0, 1e-300, 1e-271, 1e-20, 1e-13, 1e-3, 1.0, 1e5, np.inf, np.nan])
    observed, sensitivity, scale = random.choice(among, (3, 3000))
    sensitivity = np.where(np.isnan(sensitivity), 1.0, sensitivity)
    scale = np.where(np.isnan(scale), 1.0, scale)
    found = verdict_codes(observed, allowed_error(1.0) * sensitivity, scale)
    each = zip(observed, sensitivity, scale, found, strict=True)
    assert all(judge(float(x), float(s), float(z))[1] == NAMES[y] for x, s, z, y in each)


# ---- Where claims fail ---------------------------------------------------------------------------

WRONG = [
    (claim, key, part)
    for claim, about in ABOUT.items()
    for key, parts in about.items()
    for part in parts
    if claim in LIFTED and part.of not in ENGINES and part not in (MACHINE_CODE, EMBEDDING)
]


def test_every_screened_claim_is_compared_where_it_fails():
    assert {claim for claim, _, _ in WRONG} | {"null-space-embedding"} == set(LIFTED)


FIRST = {claim: (claim, key, part) for claim, key, part in reversed(WRONG)}
"""By day each claim is compared where the first of what it is about is wrong."""


@pytest.mark.parametrize(
    ("claim", "key", "part"),
    [
        pytest.param(
            *one,
            id=", ".join(map(str, one)),
            marks=() if one == FIRST[one[0]] else pytest.mark.night,
        )
        for one in WRONG
    ],
)
def test_a_claim_fails_in_lanes_where_it_fails_alone(claim: str, key: str, part: Part):
    """The wrong scene is side by side with itself."""
    (scene, state), entry = sample(key), next(part.each_entry(shape_of(key, part)))
    formulations = dict(FORMULATIONS)
    if part.of in FORMULATIONS:
        formulations[part.of] = wrong_formulation(part, entry, share(2.0**-10))
    else:
        scene = wrong_scene(scene, part, entry, share(2.0**-10))
    with patch.dict(FORMULATIONS, formulations):
        keys = dict.fromkeys(("au", "im", "kane", *({part.of} & FORMULATIONS.keys())))
        able = tuple(FORMULATIONS[key] for key in keys if FORMULATIONS[key].applies_to(scene))
        there = Case(Evaluation(scene, *state), able, ()).evaluate(CLAIMS[claim])
        ((_, case),) = batched_cases([(scene, state), (scene, state)], able)
        found = {one.subject: one for one in case.evaluate([claim])}
    assert not case.not_batched
    judged_alone = {one.subject: one for one in there if not one.subject.endswith("pivoted")}
    assert "failed" in {one.verdict for one in judged_alone.values()}
    for subject, one in judged_alone.items():
        both = found[subject]
        assert [NAMES[verdict] for verdict in both.verdict] == [one.verdict] * 2, subject
        if one.verdict == "failed":
            assert both.observed == pytest.approx(one.observed, rel=1e-3)
            assert both.allowed == pytest.approx(one.allowed, rel=0.9)
