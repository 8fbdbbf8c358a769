"""What is drawn for fuzzing, and finds piece by piece: rounded, told apart, kept, replayed."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.claims import CLAIMS, Finding
from eomcheck.draws import fuzz_cases as draws
from eomcheck.draws import fuzz_cases as structures
from eomcheck.draws.fuzz_cases import (
    ACROSS,
    FAST,
    MOST_STRUCTURES,
    ORDINARY,
    SPECIAL,
    WIDE,
    StructuralVariant,
    consistent,
    distances,
    draw_cases_with,
    draw_position,
    draw_scene_of,
    special_number,
    structural_variants,
    varied,
)
from eomcheck.errors import EomcheckError, InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import check_consistent
from eomcheck.lab.fuzzing import failures, screening, state_rounds
from eomcheck.lab.fuzzing import failures as replay
from eomcheck.lab.fuzzing import state_rounds as fuzzed
from eomcheck.lab.fuzzing.campaign import Campaign, Round, ScoredCase
from eomcheck.lab.fuzzing.failures import (
    FUNCTIONS,
    FailureRecord,
    failure_record,
    first_of_each_cause,
    read_failures,
    replay_failures,
    shrink,
    simplify,
    simplify_numbers,
    write_failures,
)
from eomcheck.lab.fuzzing.motion_comparison import END_STATES, ENERGY, MotionFinding
from eomcheck.lab.fuzzing.screening import CheckFrequency, Diagnosis, deadline, keys_in_subject
from eomcheck.lab.fuzzing.state_rounds import (
    FunctionsPlan,
    StatePlan,
    drawn_state,
    hill_climbed_states,
)
from eomcheck.lab.store.record_file import Records
from eomcheck.mechanics.records import Range, State
from eomcheck.scene_lookup import lookup_name
from eomcheck.scenes import SCENES, Sleigh, Snake, snake
from eomcheck.testing import EquationsOfMotion
from eomcheck.testing.function_checks import check_functions_at

SLEIGH = Sleigh(mass=1.3, inertia=0.2137, offset=-0.37)
AT = State(np.array([0.1, -2.0, 0.7345]), np.zeros(3), 0.0)
ENGINE = next(one for one in CLAIMS if CLAIMS[one].asks)


def failure(claim: str = "bias-symbols", subject: str = "scene", **more: Any) -> Finding:
    usual = {"scene": SLEIGH, "state": AT, "observed": 1.0, "allowed": 0.5, "verdict": "failed"}
    return Finding(claim, subject, **(usual | {"evidence": "made up"} | more))


# ---- Draws ---------------------------------------------------------------------------------------


def test_special_numbers_are_at_or_next_to_0_right_angles_either_way_and_another():
    random = np.random.default_rng(0)
    x = np.array([special_number(random, np.array([0.4, 9.0])) for _ in range(500)])
    for value in (0.0, ACROSS, -ACROSS, 0.4):
        assert (x == value).sum() > 15, value
        apart = np.abs(x - value)
        assert ((apart > 0.0) & (apart < 1e-3)).sum() > 15
        assert (x < value).any() and (x > value).any()
    assert not (x == 9.0).any() and np.abs(x).max() < np.pi + 0.2
    near = np.abs(x - 0.4)
    assert near[near > 0].min() < 1e-12


def test_distances_are_of_one_scale_some_0_and_some_on_either_side():
    random = np.random.default_rng(0)
    of = np.array([distances(random, (4,)) for _ in range(400)])
    assert 0.28 < (of == 0.0).mean() < 0.39 and 0.28 < (of < 0).mean() < 0.39
    assert np.abs(of).max() < 0.1 and 0.0 < np.abs(of[of != 0]).min() < 1e-18
    rows = [np.abs(row[row != 0]) for row in of if (row != 0).sum() == 4]
    assert max(row.max() / row.min() for row in rows) <= 1e3


def parameters(family: str, count: int = 60) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)
    scenes = []
    while len(scenes) < count:
        try:
            scenes.append(
                draw_scene_of(Snake, StructuralVariant(3, ("stiffness",)), family, random)
            )
        except EomcheckError:
            continue
    assert all(one.stiffness is None and one.damping is not None for one in scenes)
    return {x: np.array([getattr(one, x) for one in scenes]) for x in ("mass", "damping")}


def test_parameters_are_of_all_magnitudes_in_wide_cases_and_some_are_0_where_they_may_be():
    wide, usual = parameters(WIDE), parameters(ORDINARY)
    assert wide["mass"].min() < 1e-6 and wide["mass"].max() > 1e6
    assert wide["mass"].min() >= 1e-8 and wide["mass"].max() <= 1e8
    assert 0.05 < (wide["damping"] == 0.0).mean() < 0.3
    fast = parameters(FAST)
    for one in (usual, fast):
        assert one["mass"].min() >= 0.1 and one["mass"].max() <= 10.0


def test_special_parameters_are_of_all_magnitudes_or_as_usual():
    mass = parameters(SPECIAL)["mass"]
    inside = ((mass >= 0.1) & (mass <= 10.0)).all(axis=1)
    assert 0.3 < inside.mean() < 0.8


def test_fast_states_have_speeds_of_300_decades_and_angles_of_many_turns(monkeypatch):
    monkeypatch.setattr(draws, "assembled_position", lambda scene, q, t: q)
    random, scene = np.random.default_rng(0), Snake.coil(3)
    found = [draw_position(scene, FAST, random) for _ in range(200)]
    c = np.abs([one for _, one, _ in found])
    assert c.max() > 1e130 and c[c > 0].min() < 1e-130 and c.max() <= 1e150
    assert 0.2 < (c == 0).mean() < 0.5
    q = np.array([one for one, _, _ in found])
    far = np.abs(q).max(axis=1) > 100.0
    assert 0.35 < far.mean() < 0.65 and 9e8 < np.abs(q).max() <= 1e9
    usual = [draw_position(scene, ORDINARY, random) for _ in range(200)]
    c = np.array([one for _, one, _ in usual])
    assert 2 < (c == 0).all(axis=1).sum() < 30 and 4.9 < np.abs(c).max() <= 5.0
    assert c.min() < -4.5
    q = np.array([one for one, _, _ in usual])
    assert np.abs(q[:, :2]).max() <= 10.0 and np.abs(np.diff(q[:, 2:], axis=1)).max() < 2.5


def test_special_angles_are_next_to_each_other_or_to_0(monkeypatch):
    monkeypatch.setattr(draws, "assembled_position", lambda scene, q, t: q)
    random, scene = np.random.default_rng(0), Snake.coil(3)
    q = np.array([draw_position(scene, SPECIAL, random)[0] for _ in range(200)])
    apart = np.abs(np.diff(q[:, 2:], axis=1)).max(axis=1)
    assert (apart < 0.21).all() and (apart < 1e-6).sum() > 20 and (apart == 0).any()
    at_0 = np.abs(q[:, 2:]).max(axis=1) < 0.11
    assert 60 < at_0.sum() < 140
    assert np.ptp(q[:, :2]) > 15.0  # positions are as they were


def test_driven_scenes_are_closed_at_the_time_that_was_drawn(monkeypatch):
    asked: list = []
    monkeypatch.setattr(draws, "assembled_position", lambda scene, q, t: asked.append(t) or q)
    scene = SCENES["turntable-ball"].example()
    times = [draw_position(scene, ORDINARY, np.random.default_rng(i))[2] for i in range(20)]
    assert asked == times and min(times) < 3.0 and 7.0 < max(times) <= 10.0


def test_a_kind_of_which_nothing_can_be_closed_is_given_up_and_one_with_gaps_is_not(monkeypatch):
    tried: list[str] = []

    def position(scene, family, random):
        tried.append(family)
        if not opens(len(tried)):
            raise EomcheckError("open")
        return AT.q, np.zeros(2), 0.0

    monkeypatch.setattr(draws, "draw_position", position)
    monkeypatch.setattr(
        draws, "consistent", lambda scenes, states, v: ([*states], [*range(len(states))])
    )
    for opens, count, found in (
        (lambda i: False, 101, 0),
        (lambda i: i == 60, 300, 1),
        (lambda i: i % 3 == 0, 300, 100),
    ):
        tried.clear()
        cases, families = draw_cases_with(
            lambda family: SLEIGH, ("a", "b"), 300, np.random.default_rng(0)
        )
        assert (len(tried), len(cases)) == (count, found)
        assert tried[:4] == ["a", "b", "a", "b"]
        expected = [family for i, family in enumerate(tried, 1) if opens(i)]
        assert families == expected


def test_structures_are_named_by_their_links_and_by_what_is_absent():
    assert (
        StructuralVariant(3, ("damping", "stiffness")).name == "3 links, without damping, stiffness"
    )
    assert StructuralVariant(None, ("damping",)).name == "without damping"
    assert (
        StructuralVariant(1, ()).name == "1 links"
        and StructuralVariant(None, ()).name == "all terms"
    )


def test_structures_are_all_there_first_without_what_has_no_entries_and_no_more_than_16():
    class Kind:
        has_links = True

        @staticmethod
        def ranges(count):
            found = {f"p{i}": Range(0, 1, (2,), optional=True) for i in range(5)}
            found["none"] = Range(0, 1, (0,), optional=True)
            return found | {"mass": Range(0.1, 1, (2,))}

    found = structural_variants(Kind, (2, 4))  # type: ignore[arg-type]
    assert len(found) == 2 * MOST_STRUCTURES == 32
    assert found[0] == StructuralVariant(2, ()) and found[1] == StructuralVariant(2, ("p4",))
    assert found[15] == StructuralVariant(2, ("p1", "p2", "p3", "p4")) and found[
        16
    ] == StructuralVariant(4, ())

    class Fixed(Kind):
        has_links = False

    assert {one.links for one in structural_variants(Fixed, (2, 4))} == {None}  # type: ignore[arg-type]
    assert len(structural_variants(Fixed, (2, 4))) == 16  # type: ignore[arg-type]


def test_moments_and_products_of_a_body_are_wide_by_one_factor_and_masses_by_another():
    given = {
        "mass": np.array([1.0, 2.0, 3.0]),
        "moments": np.arange(1.0, 10.0).reshape(3, 3),
        "products": np.arange(1.0, 10.0).reshape(3, 3) / 10,
        "stiffness": 5.0,
        "damping": None,
        "armature": np.array([0.5, 0.25]),
        "center": np.ones((3, 3)),
    }
    scene = SimpleNamespace(**given, changed=lambda **values: values)
    random = np.random.default_rng(0)
    assert varied(scene, SPECIAL, random) is scene
    found = [varied(scene, WIDE, random) for _ in range(40)]
    assert {tuple(sorted(one)) for one in found} == {
        ("armature", "mass", "moments", "products", "stiffness")
    }
    moments = np.array([one["moments"] / given["moments"] for one in found])
    products = np.array([one["products"] / given["products"] for one in found])
    assert np.allclose(moments, products) and np.allclose(moments, moments[:, :, :1])
    masses = np.array([one["mass"] / given["mass"] for one in found])
    assert not np.isclose(masses, moments[:, :, 0]).any() and np.ptp(masses[0]) > 0.0
    for x in (masses, moments, np.array([one["stiffness"] for one in found]) / 5.0):
        assert 1e-8 <= x.min() < 1e-5 and 1e5 < x.max() <= 1e8
    assert structures.TOGETHER[1] == ("moments", "products")


def test_cases_that_cannot_be_kept_leave_velocities_and_places_to_the_others():
    class Lost(Snake, functions=()):
        """A snake whose Jacobian is no number where it is far out."""

        @staticmethod
        def terms(parameters, prepared, q, v):
            found = snake.terms(parameters, prepared, q, v)
            huge = q[0] * 2.0**1000 * 2.0**1000
            return found._replace(a=found.a + (huge - huge))

    usual = Snake.coil(2)
    scene = Lost(**{name: getattr(usual, name) for name in Snake.declared})
    q = np.array([0.0, 0.0, 0.3, 0.9])
    states = [State(q + x, np.zeros(4), 0.0) for x in (0.0, 3.0, 0.0, 5.0, 0.0)]
    wished = np.arange(20.0).reshape(5, 4) - 7.0
    found, places = consistent([scene] * 5, states, lambda at: wished)
    assert places == [0, 2, 4]
    alone = [consistent([scene], [states[i]], lambda at, i=i: wished[[i]])[0][0] for i in places]
    for (_, state), (_, one) in zip(found, alone, strict=True):
        assert state.v == pytest.approx(one.v, rel=1e-12) and state.v.any()
    assert consistent([], [], lambda at: wished) == ([], [])


# ---- States of functions -------------------------------------------------------------------------

NARROW = EquationsOfMotion(
    2, M=lambda q: np.eye(2), ranges=[(-2.0, 2.0), (-3.0, 3.0), (-1.0, 1.0), (-1.0, 1.0)]
)


def test_special_states_of_functions_are_at_special_numbers_and_sometimes_at_rest():
    random = np.random.default_rng(0)
    usual, special = (
        np.array([np.concatenate(drawn_state(NARROW, one, random)[:2]) for _ in range(200)])
        for one in (ORDINARY, SPECIAL)
    )
    assert not (usual == 0.0).any()
    for column in (0, 1):
        assert 5 < (special[:, column] == 0.0).sum() < 80
        assert (special[:, column] == ACROSS).any() and (special[:, column] == -ACROSS).any()
    assert 0.05 < (special[:, 2:] == 0.0).mean() < 0.25
    assert (special[:, 0] == special[:, 1]).sum() > 2


def test_near_states_of_functions_take_numbers_of_any_claim(monkeypatch):
    monkeypatch.setattr(
        state_rounds, "changed_entries", lambda here, there, random: there + 0 * here
    )
    population: Any = {
        (name, ""): [ScoredCase(1.0, (NARROW, State(np.full(2, x), np.full(2, x))))]
        for name, x in (("a", 0.25), ("b", 0.5), ("c", 5.0))
    }
    found = hill_climbed_states(NARROW, population, 60, np.random.default_rng(0))
    assert {0.25, 0.5} <= {state.q[0] for state in found} <= {0.25, 0.5, 2.0}
    assert {state.v[0] for state in found} <= {0.25, 0.5, 1.0}
    monkeypatch.setattr(state_rounds, "changed_entries", lambda here, *_: 0 * here + 5.0)
    del population["c", ""]
    found = hill_climbed_states(NARROW, population, 60, np.random.default_rng(0))
    # What leaves a range goes to its end, or stays.
    assert {state.q[1] for state in found} == {3.0, 0.25, 0.5}
    assert {state.v[0] for state in found} == {1.0, 0.25, 0.5}


def test_rounds_of_functions_count_keep_the_highest_and_tell_the_first_reason(monkeypatch):
    seen: list = []

    def judged(functions, state, claims):
        seen.append(tuple(claims))
        i = len(seen)
        return [
            failure("a", "M", verdict="passed", observed=0.1 * i),
            failure("a", "M", verdict="passed", observed=0.05),
            failure("a", "qdd", verdict="inconclusive", detail=f"blind {i}"),
            failure("b", "M", verdict="skipped", detail=f"none {i}"),
            failure("b", "M", verdict="failed" if i == 2 else "passed", observed=0.02),
        ]

    monkeypatch.setattr(fuzzed, "functions_named", lambda _: NARROW)
    monkeypatch.setattr(fuzzed, "check_functions_at", judged)
    plan = FunctionsPlan("x", 0, ("a", "b"), batch=3, climbing=False)
    result = plan.run(Round(0, StructuralVariant(None, ()), {}))
    assert seen == [("a", "b")] * 3 and (result.states, plan.max_states) == (3, 6)
    assert result.counts == {
        "ordinary": 2,
        "special": 1,
        "states": 3,
        "passed": 8,
        "failed": 1,
        "inconclusive": 3,
        "skipped": 3,
        "decided: a [M]": 6,
        "inconclusive: a [qdd]": 3,
        "skipped: b [M]": 3,
        "decided: b [M]": 3,
    }
    assert result.undecided == {
        "a [qdd]": "inconclusive in all states: blind 1",
        "b [M]": "skipped in every state: none 1",
    }
    heights = {key: [x.score for x in best] for key, best in result.population.items()}
    assert heights == {
        ("a", "M"): pytest.approx([0.6, 0.4, 0.2]),
        ("b", "M"): pytest.approx([0.04, 0.04]),
    }
    (failed,) = result.failed
    assert (failed.claim, failed.verdict) == ("b", "failed")
    climbing = replace(plan, climbing=True).run(Round(0, StructuralVariant(None, ()), {}))
    assert (climbing.states, climbing.counts["climbed"]) == (6, 3)


# ---- Finds made round ----------------------------------------------------------------------------


def test_numbers_are_made_as_round_as_the_failure_allows_each_for_itself():
    looked: list = []

    def look(candidate):
        looked.append(candidate)
        scene, state = candidate.scene, candidate.state
        fails = scene.mass > 0.7 and scene.inertia > 0.21 and state.q[1] < -1.5
        other = failure("bias-symbols", "another", scene=scene, state=state)
        mine = failure(scene=scene, state=state)
        return [other, mine] if fails and abs(state.q[2]) > 0.734 else [other]

    small = simplify_numbers(failure(), look)
    assert (small.scene.mass, small.scene.inertia, small.scene.offset) == (1.0, 1.0, 0.0)
    assert small.state.q.tolist() == [0.0, -2.0, 1.0] and small.subject == "scene"
    strict = lambda case: [x for x in look(case) if 0.21 < case.scene.inertia < 0.25]  # noqa: E731
    strict_q = lambda case: [x for x in strict(case) if case.state.q[2] < 0.74]  # noqa: E731
    small = simplify_numbers(failure(), strict_q)
    assert (small.scene.mass, small.scene.inertia) == (1.0, 0.2137)
    assert small.state.q.tolist() == [0.0, -2.0, 0.7345]
    looked.clear()
    assert simplify_numbers(failure(), look, 0) == failure() and not looked
    simplify_numbers(failure(), look, 5)
    assert len(looked) == 4  # and one that is refused: there is no mass of 0


def test_digits_are_taken_away_as_far_as_it_fails():
    def look(candidate):
        scene, state = candidate.scene, candidate.state
        apart = abs(scene.mass - 1.23456789) / 1.23456789
        same = failure(scene=scene, state=state)
        return [same] if apart < 5e-4 else []

    start = failure(scene=Sleigh(mass=1.23456789, inertia=0.5, offset=0.5))
    assert simplify_numbers(start, look).scene.mass == 1.235


def test_what_is_made_round_keeps_the_constraints():
    q, v = np.array([0.3, 0.1, 0.7]), np.array([0.4, 0.337, 1.0])
    seen: list = []

    def look(case):
        if case.scene is SLEIGH:
            seen.append(case.state)
        return []

    simplify_numbers(failure(state=State(q, v, 0.0)), look)
    for state in seen:
        check_consistent(Evaluation(SLEIGH, *state))
    assert len(seen) > 10


def test_failures_are_made_small_by_the_seed_and_those_of_engines_are_not(monkeypatch):
    asked: list = []
    monkeypatch.setattr(failures, "simplify_numbers", lambda finding, look: finding)
    pair = failure("equivalence", "au ~ em")
    other = replace(pair, observed=7.0)
    monkeypatch.setattr(failures, "smallest_failure", lambda *given: asked.append(given) or other)
    assert shrink(pair, ("au", "em", "im"), 5) is other
    assert [(given[0], given[3]) for given in asked] == [(pair, 5)]
    over = asked[0][4]
    with deadline(time.time() - 1.0):
        assert over()
    assert not over()
    engine = failure(ENGINE, "casadi")
    assert shrink(engine, ("au",)) is engine and len(asked) == 1


def test_fuzz_ends_at_a_smaller_state_with_the_diagnosis_of_the_first_one(monkeypatch):
    """The bias has the wrong sign where q_0 > 0.3, and is half elsewhere, also at q_0 = 0."""

    def M(q):
        return [[3 + np.cos(q[1]), 1.0], [1.0, 2.0]]

    def bias(q, v):
        true = np.sin(q[1]) * np.array([-v[0] * v[1], v[0] ** 2 / 2])
        return -true if q[0] > 0.3 else true / 2

    functions = EquationsOfMotion(2, M=M, bias=bias)
    state = State(np.array([0.73, 0.41]), np.array([0.9, -0.37]))
    (first,) = check_functions_at(functions, state, ["bias-of-mass-matrix"])
    monkeypatch.setattr(fuzzed, "functions_named", lambda name: functions)
    small = FunctionsPlan("a file", 0, ("bias-of-mass-matrix",)).shrunk(first, [])
    assert small.state is not None and small.state.q[0] == 1.0  # not 0
    assert first.detail.endswith(": wrong sign (every row)")
    assert small.detail.endswith(": wrong sign (every row)")


def test_fuzz_ends_between_two_states_of_a_round_when_its_time_is_up(monkeypatch, tmp_path):
    asked: list = []
    monkeypatch.setattr(screening.time, "time", lambda: 0.1 * len(asked))

    def slow(functions, state, claims):
        asked.append(state)
        return []

    functions = EquationsOfMotion(1, M=lambda q: [[1.0]])
    monkeypatch.setattr(fuzzed, "check_functions_at", slow)
    monkeypatch.setattr(fuzzed, "functions_named", lambda name: functions)
    plan = FunctionsPlan("a file", 0, ("a",), batch=1000)
    with Records(tmp_path / "a.db") as records:
        campaign = Campaign(plan, "a file", [StructuralVariant(None, ())], records)
        campaign.run(seconds=0.35)
        assert len(asked) == campaign.states == 4
        again = Campaign(plan, "a file", [StructuralVariant(None, ())], records)
    assert again.resumed == 0, "a round that was cut is done again"


def test_one_state_of_functions_is_checked_though_the_time_is_up(monkeypatch):
    asked: list = []
    monkeypatch.setattr(fuzzed, "check_functions_at", lambda *case: asked.append(case) or [])
    functions = EquationsOfMotion(1, M=lambda q: [[1.0]])
    monkeypatch.setattr(fuzzed, "functions_named", lambda name: functions)
    plan = FunctionsPlan("a file", 0, ("a",), batch=5)
    cut = plan.run(Round(0, StructuralVariant(None, ()), {}, until=time.time() - 1.0))
    assert (cut.states, cut.cut, len(asked)) == (1, True, 1)


def test_a_round_whose_time_is_up_judges_no_further_state(monkeypatch):
    judged: list = []
    monkeypatch.setattr(fuzzed, "check_case", lambda *case: judged.append(case) or [])
    plan = StatePlan(Sleigh, 0, ("power-balance", "equivalence"), ("au", "kane"), batch=16)
    plan = replace(plan, check_frequency=CheckFrequency(0, 0, 0, 1, 1))
    cut = plan.run(Round(0, StructuralVariant(None, ()), {}, until=time.time() - 1.0))
    assert (cut.states, cut.cut, judged) == (16, True, [])
    whole = plan.run(Round(0, StructuralVariant(None, ()), {}, until=time.time() + 600.0))
    assert whole.states > 16 and not whole.cut and len(judged) >= 16


def test_simplifying_ends_when_the_time_is_up():
    seen: list = []
    with deadline(time.time() - 1.0):
        assert simplify_numbers(failure(), lambda case: seen.append(case) or []) == failure()
    assert not seen


# ---- Finds ---------------------------------------------------------------------------------------


def test_a_find_has_all_numbers_of_its_failure_in_their_places():
    state = State(np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), 7.5)
    one = failure("equivalence", "em ~ au", state=state, observed=8.5, allowed=9.5, detail="x: y")
    find = failure_record(one, "sleigh", Diagnosis("scene", "seen"))
    assert find == FailureRecord(
        scene="sleigh",
        parameters={"mass": 1.3, "inertia": 0.2137, "offset": -0.37},
        q=[1.0, 2.0, 3.0],
        v=[4.0, 5.0, 6.0],
        t=7.5,
        claim="equivalence",
        subject="em ~ au",
        observed=8.5,
        allowed=9.5,
        whose="scene",
        evidence="seen",
        detail="x: y",
    )
    assert find.key == ("sleigh", "equivalence", "au em", "scene", "y")
    assert str(find) == "equivalence, em ~ au: observed 8.5, allowed 9.5; scene (seen)"
    assert "simulate_many" not in find.python
    moved = MotionFinding("end-states", "em", SLEIGH, AT, 1.0, 0.5, "failed", "x", t_end=2.5)
    find = failure_record(moved, "sleigh", Diagnosis("scene", "seen"))
    assert find.t_end == 2.5 and "simulate_many(scene, 'em', 2.5," in find.python


def test_a_scene_is_found_again_by_its_key_only_if_it_is_the_one_of_that_key():
    class Mine(Sleigh, functions=()):
        pass

    assert lookup_name(Sleigh, "x.py:Sleigh") == "sleigh"
    assert lookup_name(Mine, "x.py:Mine") == "x.py:Mine"


def test_finds_of_all_claims_are_kept_each_and_of_one_cause_the_first(tmp_path: Path):
    row: dict[str, Any] = {"scene": "sleigh", "parameters": {}, "q": [0.0], "v": [0.0]}
    whole = [FailureRecord(**row), FailureRecord(**row), FailureRecord(**row | {"q": [1.0]})]
    of = [
        FailureRecord(**row, claim="a", subject="x ~ y"),
        FailureRecord(**row, claim="a", subject="y ~ x", t=1.0),
    ]
    moved = FailureRecord(**row, claim="end-states", subject="em", t_end=1.5, t=0.0)
    assert first_of_each_cause([*whole, *of, moved]) == [*whole, of[0], moved]
    file = tmp_path / "found.json"
    write_failures(file, [*whole, *of, moved])
    assert read_failures(file) == [*whole, of[0], moved]
    assert file.read_text().count("t_end") == 1


@pytest.mark.parametrize(
    "changed", [{"t": True}, {"observed": True}, {"observed": "1"}, {"v": [[0.0]]}, {"why": 3}]
)
def test_rows_of_other_types_are_no_finds(tmp_path: Path, changed):
    file = tmp_path / "found.json"
    row = {"scene": "sleigh", "parameters": {}, "q": [0.0], "v": [0.0]}
    write_failures(file, [FailureRecord(**row)])  # type: ignore[arg-type]
    file.write_text(json.dumps([row | changed]))
    with pytest.raises(InputError, match="holds no failures"):
        read_failures(file)


def test_subjects_name_what_is_between_their_signs():
    keys = "au", "em", "kane"
    assert keys_in_subject("em ~ au", keys) == ("em", "au")
    assert keys_in_subject("kane: em, pivoted", keys) == ("kane", "em")
    assert keys_in_subject("emu, kanes", keys) == ()


# ---- Finds looked at again -----------------------------------------------------------------------


def kept(**more: Any) -> FailureRecord:
    usual = {"parameters": {"mass": 1.3, "inertia": 0.2, "offset": 0.3}, "v": [0.0] * 3}
    return FailureRecord(**({"scene": "sleigh", "q": [0.0, 0.0, 0.5]} | usual | more))


def test_a_kept_motion_fails_by_its_own_claim_and_formulation_alone(monkeypatch):
    asked: list = []
    said: list = []

    def of_motion(case, keys, t_end):
        asked.append((case[0].mass, case[1].q.tolist(), keys, t_end))
        return said

    monkeypatch.setattr(replay, "findings_of_motion", of_motion)
    find = kept(claim=END_STATES, subject="em", t_end=2.5, whose="silent error", evidence="seen")
    of = {"scene": SLEIGH, "state": AT, "allowed": 0.5, "evidence": "now"}

    def motion(claim, key, verdict, observed):
        return MotionFinding(claim, key, observed=observed, verdict=verdict, t_end=1.5, **of)

    said += [motion(END_STATES, "au", "failed", 1.0), motion(ENERGY, "em", "failed", 2.0)]
    said += [motion(END_STATES, "em", "passed", 0.1)]
    (one,) = replay_failures([find], ("au", "em"))
    assert (one.outcome, one.failure) == ("holds", find)
    assert asked == [(1.3, [0.0, 0.0, 0.5], ("au", "em"), 2.5)]
    said[2] = motion(END_STATES, "em", "failed", 3.0)
    (one,) = replay_failures([find], ("au", "em"))
    assert (one.outcome, one.failure.observed, one.failure.t_end) == ("failed", 3.0, 1.5)
    assert (one.failure.whose, one.failure.evidence) == ("silent error", "seen")
    said[2] = motion(END_STATES, "em", "inconclusive", 3.0)
    (one,) = replay_failures([find], ("au", "em"))
    assert (one.outcome, one.reason) == ("inconclusive", "em: observed 3, allowed 0.5")


def test_kept_failures_are_looked_at_in_their_order_and_each_is_told(monkeypatch):
    said = {0.25: "failed", 0.5: "passed", 0.75: "inconclusive", 1.0: "skipped"}

    def checked(case, claims, keys, engines):
        assert (claims, keys) == (["kinetic-energy"], ("au",))
        if case[1].q[2] == 2.0:
            raise ZeroDivisionError("no")
        verdict = said[case[1].q[2]]
        of = {"scene": case[0], "state": case[1], "verdict": verdict, "observed": 0.7}
        return [failure("kinetic-energy", "scene", detail=f"it is {verdict}", **of)]

    told: list = []
    monkeypatch.setattr(replay, "check_case", checked)
    monkeypatch.setattr(
        replay, "failure_record", lambda failed, name, fault: (failed.observed, name, fault)
    )
    finds = [kept(claim="kinetic-energy", q=[0.0, 0.0, x]) for x in (0.75, 0.25, 2.0, 0.5, 1.0)]
    results = replay_failures(finds, ("au",), lambda: told.append(1))
    assert len(told) == 5
    assert [one.outcome for one in results] == [
        "inconclusive",
        "failed",
        "not checked",
        "holds",
        "not checked",
    ]
    assert results[0].reason == "scene: it is inconclusive"
    assert results[1].failure == (0.7, "sleigh", None)
    assert results[2].reason.startswith("raises ZeroDivisionError: no")
    assert results[4].reason == "scene: it is skipped"
    assert [one.failure for i, one in enumerate(results) if i != 1] == [
        finds[i] for i in (0, 2, 3, 4)
    ]


def test_a_kept_failure_of_functions_keeps_its_fault_and_fails_by_its_subject(monkeypatch):
    monkeypatch.setattr(
        FailureRecord, "case", property(lambda self: (NARROW, State(AT.q[:2], AT.q[:2])))
    )
    said = [failure("motion", "qdd"), failure("motion", "M", verdict="passed")]
    asked: list = []

    def at(functions, state, claims):
        asked.append(tuple(claims))
        return said

    monkeypatch.setattr(replay, "check_functions_at", at)
    monkeypatch.setattr(
        replay, "failure_record", lambda failed, name, fault: (failed.subject, fault)
    )
    of = {"whose": FUNCTIONS, "evidence": "seen"}
    one, other = replay_failures(
        [kept(claim="motion", subject=x, **of) for x in ("qdd", "M")], ("au",)
    )
    assert one.failure == ("qdd", Diagnosis(FUNCTIONS, "seen")) and one.outcome == "failed"
    assert other.outcome == "holds" and asked == [("motion",)] * 2
    (every,) = replay_failures([kept(**of)], ("au",))
    assert every.outcome == "failed" and len(asked[2]) > 10


def test_a_candidate_whose_check_raises_is_judged_by_no_other_s_failures():
    def named(name: str) -> Any:
        return SimpleNamespace(name=name, claim="bias", subject="B", detail="", verdict="failed")

    first, bad, better, best = map(named, ("first", "bad", "better", "best"))

    def check(candidate: Any) -> list[Any]:
        if candidate is bad:
            raise InputError("no case")
        return [candidate]

    assert simplify(first, [lambda x: [bad, better]], check) is better
    steps = [lambda x: [better], lambda x: [bad, None, best]]
    assert simplify(first, steps, check) is best
    assert simplify(first, [lambda x: [bad]], check) is first
