"""Judging of motions piece by piece, by numbers that are written down."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eomcheck.draws.fuzz_cases import StructuralVariant
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import motion_comparison, motion_rounds, screening
from eomcheck.lab.fuzzing import motion_rounds as motion_finds
from eomcheck.lab.fuzzing.campaign import Round
from eomcheck.lab.fuzzing.motion_comparison import (
    ALONE,
    COARSE,
    END_STATES,
    ENERGY,
    TIGHT,
    TIMES,
    MotionFinding,
    SimulatedBatch,
    _judged,
    _median,
    _motion_summary,
    _MotionSummary,
    _worst_finding,
    branchings,
    crossings,
    findings_of_motion,
    growth_from_perturbed_starts,
    perturbed_starts,
)
from eomcheck.lab.fuzzing.motion_rounds import (
    LONGEST,
    SHORTEST,
    MotionPlan,
    diagnose_motion_failure,
    informative,
    motion_counts,
    shrink_motion,
)
from eomcheck.mechanics.records import State
from eomcheck.scenes import FourBarChain, Sleigh

SLEIGH = Sleigh(mass=1.3, inertia=0.21, offset=0.37)
OTHER = Sleigh(mass=0.7, inertia=0.4, offset=0.2)
CASES = [
    (SLEIGH, State(np.zeros(3), np.zeros(3), 0.0)),
    (OTHER, State(np.ones(3), np.ones(3), 0.0)),
]


def found_of(key: str, claim: str, verdict: Any, observed: float = 0.5, **more) -> MotionFinding:
    return MotionFinding(claim, key, *CASES[0], observed, 1.0, verdict, "made up", **more)


# ---- The median ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([3.0, 1.0, 9.0], 3.0),
        ([3.0, 1.0, 9.0, 4.0], 3.5),
        ([np.nan, 9.0, 1.0, 3.0], 3.0),
        ([9.0, np.inf, 1.0, np.nan], 5.0),
        ([np.nan, np.nan, 7.0], 7.0),
        ([np.nan, np.inf, -np.inf], np.nan),
    ],
)
def test_the_median_is_of_those_that_are_known(values, expected):
    x = np.array(values)[:, None] * [1.0, 2.0]
    assert np.array_equal(_median(x), np.array([1.0, 2.0]) * expected, equal_nan=True)


# ---- A motion by numbers -------------------------------------------------------------------------


def of_key(seed: int) -> tuple[SimulatedBatch, SimulatedBatch]:
    """Return motions of two sleighs that are apart by different numbers in every entry."""
    random = np.random.default_rng(seed)

    def one(apart: float) -> SimulatedBatch:
        y = np.linspace(0.0, 4.0, TIMES)[None, :, None] * np.array([1, -2, 3, 5, -7, 9])
        y = y * np.array([1.0, 0.5])[:, None, None] + apart * random.normal(size=(2, TIMES, 6))
        energy = 3.0 + apart * random.normal(size=(2, TIMES))
        return SimulatedBatch(y, energy, np.array(["finished"] * 2), np.array([""] * 2))

    return one(1e-6), one(1e-8)


@pytest.mark.parametrize("place", [40, TIMES])
def test_what_is_observed_and_allowed_of_motions_is_as_its_docstring_says(monkeypatch, place):
    keys = ("au", "em", "gw")
    both = {key: of_key(seed) for seed, key in enumerate(keys)}
    random = np.random.default_rng(9)
    growing, of_energy = 1e-7 * random.random((2, 2, TIMES)).cumsum(axis=2)
    branches = {key: np.array([TIMES, TIMES]) for key in keys}
    branches["gw"] = np.array([TIMES, 50])
    asked: dict[str, list] = {}
    caught: dict[tuple, tuple] = {}
    alone = {x: y.y[1:] * (1.0 + 1e-9) for x, y in zip((COARSE, TIGHT), both["em"], strict=True)}

    def branching(cases, y, t_end):
        return next(branches[key] for key in keys if both[key][1].y is y)

    def found(claim, shown, observed, allowed, scale):
        caught[claim, shown.key, CASES.index(shown.case)] = observed, allowed, scale
        return claim

    def moved_starts(cases, both, t_end, scale):
        asked["scale"] = [scale.shape, scale[:, 0].tolist()]
        return growing, of_energy

    monkeypatch.setattr(motion_comparison, "branchings", branching)
    monkeypatch.setattr(motion_comparison, "crossings", lambda *_: np.array([TIMES, place]))
    monkeypatch.setattr(motion_comparison, "growth_from_perturbed_starts", moved_starts)
    monkeypatch.setattr(motion_comparison, "simulate_single", lambda case, key, t_end, x: alone[x])
    monkeypatch.setattr(motion_comparison, "_worst_finding", found)
    with np.errstate(all="ignore"):
        listed = _judged(CASES, both, 2.0, [(1, "em")])  # type: ignore[arg-type]
    assert listed == [[END_STATES, ENERGY] * 3, [END_STATES, ENERGY] * 3 + [ALONE]]

    truth = np.median([b.y for _, b in both.values()], axis=0)
    scale = np.ones((2, 1, 6))
    for i in range(2):
        scale[i, 0, :3] += np.abs(truth[i, :, :3]).max()
        scale[i, 0, 3:] += np.abs(truth[i, :, 3:]).max()
    assert asked["scale"] == [scale.shape, scale[:, 0].tolist()]

    def so_far(x):
        return np.array([max(x[: k + 1]) for k in range(TIMES)])

    def change(a, b, i):
        return so_far([np.abs((a[i, k] - b[i, k]) / scale[i, 0]).max() for k in range(TIMES)])

    changes = {k: [change(a.y, b.y, i) for i in range(2)] for k, (a, b) in both.items()}
    gains = {
        k: [so_far(np.abs(a.energy[i] - b.energy[i])) for i in range(2)]
        for k, (a, b) in both.items()
    }
    for key in keys:
        for i in range(2):
            usual = np.median([changes[k][i] for k in keys], axis=0)
            of_gain = np.median([gains[k][i] for k in keys], axis=0)
            own, gain = changes[key][i].copy(), gains[key][i].copy()
            if i == 1 and key == "em":  # it solves one partition
                own[place:] = gain[place:] = 0.0
            allowed = C * (own + usual + growing[i])
            most = C * (gain + of_gain + of_energy[i])
            if i == 1:  # gw is within its bounds up to a pose with branches
                allowed[50:] = most[50:] = np.nan
            b = both[key][1]
            observed, bound, ones = caught[END_STATES, key, i]
            assert np.abs((b.y[i] - truth[i]) / scale[i, 0]).max(axis=1) == pytest.approx(observed)
            assert np.allclose(bound, allowed, rtol=1e-12, equal_nan=True)
            assert (ones == 1.0).all()
            observed, bound, size = caught[ENERGY, key, i]
            assert np.abs(b.energy[i] - b.energy[i, 0]) == pytest.approx(observed)
            assert np.allclose(bound, most, rtol=1e-12, equal_nan=True)
            assert size == pytest.approx(1.0 + np.abs(b.energy[i]))
    observed, bound, _ = caught[ALONE, "em", 1]
    a, b = alone[COARSE][0], alone[TIGHT][0]
    own = so_far([np.abs((a[k] - b[k]) / scale[1, 0]).max() for k in range(TIMES)])
    own[place:] = 0.0
    allowed = C * (own + np.median([changes[k][1] for k in keys], axis=0) + growing[1])
    allowed[50:] = np.nan
    assert observed == pytest.approx(np.abs((b - truth[1]) / scale[1, 0]).max(axis=1))
    assert np.allclose(bound, allowed, rtol=1e-12, equal_nan=True)


SHOWN = _MotionSummary("em", CASES[1], 3.2, None, "finished", False)


def judged(observed, allowed, scale=None, shown=SHOWN) -> MotionFinding:
    """Return what becomes of errors at a few of the times; at the others there are none."""
    x, y = np.zeros(TIMES), np.ones(TIMES) * INCONCLUSIVE
    for k, value in observed.items():
        x[k] = value
    for k, value in allowed.items():
        y[k] = value
    with np.errstate(all="ignore"):
        return _worst_finding(END_STATES, shown, x, y, np.ones(TIMES) if scale is None else scale)


def test_the_worst_of_the_times_that_can_be_told_decides():
    most = INCONCLUSIVE
    cases = [
        ({20: most / 2, 30: most / 4}, {}, "passed", most / 2, most),
        ({20: most / 2, 30: 2e-6}, {30: 1e-6}, "failed", 2e-6, 1e-6),
        ({20: 2 * most, 30: 3 * most}, {}, "failed", 3 * most, most),
        ({20: most}, {}, "passed", most, most),
        ({0: 1.0, 20: 1e-9}, {}, "passed", 1e-9, most),
        ({20: 1.0, 30: 1e-9}, {20: 1.01 * most}, "passed", 1e-9, most),
        ({20: np.nan, 30: 1e-9}, {}, "passed", 1e-9, most),
        ({20: 1.0, 30: 1e-9}, {20: np.nan}, "passed", 1e-9, most),
        ({20: 1.0, 30: 1e-9}, {20: np.inf}, "passed", 1e-9, most),
        ({64: 0.1}, {64: 0.01 * most}, "failed", 0.1, 0.01 * most),
    ]
    for observed, allowed, verdict, x, y in cases:
        found = judged(observed, allowed)
        assert (found.verdict, found.observed, found.allowed) == (verdict, x, y), observed
        assert (found.detail == "") == (verdict != "failed")
    nothing = judged({}, dict.fromkeys(range(TIMES), np.nan))
    assert (nothing.verdict, nothing.detail) == ("inconclusive", "")
    first = judged({0: 1.0}, {0: 1e-9} | dict.fromkeys(range(1, TIMES), np.inf))
    assert first.verdict == "inconclusive"
    large = judged({20: 3 * most}, {20: 4 * most}, scale=np.full(TIMES, 5.0))
    assert (large.verdict, large.allowed) == ("passed", 4 * most)


def test_a_failure_of_a_motion_says_what_when_and_after_what():
    found = judged({16: 1.0}, {}, shown=SHOWN._replace(crossed=0.8, ended="stopped", reached=True))
    assert found.detail == (
        "motion, em: another state than the others at t = 0.8 s, "
        "after a pose where a_1 is singular, before t = 0.8 s"
    )
    assert (found.t_end, found.crossed, found.ended, found.reached) == (3.2, 0.8, "stopped", True)
    assert (found.scene, found.subject, found.state.t) == (OTHER, "em", 0.0)
    later = judged({16: 1.0}, {}, shown=SHOWN._replace(crossed=0.85))
    assert later.detail == "motion, em: another state than the others at t = 0.8 s"


def test_how_a_motion_ended_and_whether_it_came_behind_a_pose():
    y = np.zeros((4, TIMES, 6))
    y[1, 20:] = np.nan
    status = np.array(["finished", "failed", "refused", "failed"])
    reason = np.array(["", "no digits", "singular", "1000 steps do not reach the end"])
    by = SimulatedBatch(y, y[:, :, 0], status, reason)
    of = [(0, 16), (1, 19), (1, 20), (2, TIMES), (3, 48)]
    shown = [_motion_summary(i, "em", CASES[0], by, place, 3.2) for i, place in of]
    assert [(x.crossed, x.ended, x.reached) for x in shown] == [
        (0.8, "finished", True),
        (pytest.approx(0.95), "stopped", True),
        (1.0, "stopped", False),
        (None, "refused", False),
        (pytest.approx(2.4), "too many steps", True),
    ]


# ---- Starts a little apart -----------------------------------------------------------------------


def test_a_start_is_moved_in_all_numbers_by_the_coarse_tolerance_and_no_more():
    far = SLEIGH, State(np.array([30.0, -20.0, 0.5]), np.array([0.0, 0.0, 10.0]), 0.0)
    found, places = perturbed_starts([CASES[1], far])
    assert places == [0, 1]
    for (scene, before), (_, after) in zip((CASES[1], far), found, strict=True):
        moved = np.abs(after.q - before.q) / (1.0 + np.abs(before.q))
        assert (moved * 1.0001 >= 0.5 * COARSE).all() and (moved <= 1.0001 * COARSE).all()
        assert scene.n == 3 and after.t == 0.0
    away = np.abs(found[1][1].v - far[1].v).max()
    assert 1e-9 < away < 12 * COARSE


def test_how_motions_grow_is_told_by_the_formulation_that_comes_furthest(monkeypatch):
    both = {key: of_key(seed) for seed, key in enumerate(("au", "em", "gw"))}
    for key, last in (("au", 30), ("em", 60), ("gw", 10)):
        both[key][1].y[:, last:] = np.nan
    there = of_key(7)[1]
    asked: list = []

    def moved(cases, key, t_end, tolerance):
        asked.append((len(cases), key, t_end, tolerance))
        return SimulatedBatch(there.y[:1], there.energy[:1], there.status[:1], there.reason[:1])

    monkeypatch.setattr(motion_comparison, "simulate_batch", moved)
    monkeypatch.setattr(motion_comparison, "perturbed_starts", lambda cases: ([CASES[1]], [1]))
    scale = np.array([[[1.0] * 6], [[2.0, 2.0, 2.0, 4.0, 4.0, 4.0]]])
    apart, energy = growth_from_perturbed_starts(CASES, both, 1.5, scale)  # type: ignore[arg-type]
    assert asked == [(1, "em", 1.5, TIGHT)]
    assert np.isnan(apart[0]).all() and np.isnan(energy[0]).all()
    here = both["em"][1]
    one = np.abs((there.y[0] - here.y[1]) / scale[1]).max(axis=1)
    assert np.allclose(apart[1, :60], np.maximum.accumulate(one[:60]), rtol=1e-12)
    assert np.isnan(apart[1, 60:]).all()
    gained = np.abs(there.energy[0] - here.energy[1])
    assert np.allclose(energy[1], np.maximum.accumulate(gained), rtol=1e-12)
    monkeypatch.setattr(motion_comparison, "perturbed_starts", lambda cases: ([], []))
    apart, energy = growth_from_perturbed_starts(CASES, both, 1.5, scale)  # type: ignore[arg-type]
    assert np.isnan(apart).all() and np.isnan(energy).all() and len(asked) == 1


# ---- Poses ---------------------------------------------------------------------------------------


def test_each_motion_has_its_own_first_pose_and_what_is_not_known_is_no_turn():
    y = np.zeros((4, TIMES, 6))
    y[0, :, 2] = np.linspace(-0.6, 0.6, TIMES)
    y[1, :, 2] = np.linspace(-0.3, 6.0, TIMES)  # three poses
    y[2, :, 2] = np.linspace(-0.6, -0.1, TIMES)
    y[3, :, 2] = np.linspace(-0.6, 0.6, TIMES)
    y[3, 20:50] = np.nan
    cases = [CASES[0], CASES[1], CASES[0], CASES[1]]
    found = crossings(cases, y, 1.0)
    expected = [int(np.flatnonzero(y[i, :, 2] > 0.0)[0]) for i in (0, 1)]
    assert found.tolist()[2:] == [TIMES, 50]
    assert np.abs(found[:2] - expected).max() <= 1 and found[1] < 10


def test_of_several_motions_each_has_its_own_first_pose_with_branches():
    rods = FourBarChain.rods(1)
    y = np.zeros((3, TIMES, 6))
    for i, end in enumerate((-0.5, 0.5)):
        y[i, :, 0] = y[i, :, 2] = np.linspace(np.pi / 2, end, TIMES)
    y[2, :, 0] = y[2, :, 2] = np.cos(np.linspace(0.0, 5.5, TIMES))  # and back again
    found = branchings([(rods, State(y[0, 0, :3], np.zeros(3), 0.0))] * 3, y, 1.0)
    flat = [int(np.flatnonzero(y[i, :, 0] <= 0.0)[0]) for i in (0, 2)]
    assert found[1] == TIMES and np.abs(found[[0, 2]] - flat).max() <= 1
    assert branchings([CASES[0]], np.zeros((1, TIMES, 6)), 1.0).tolist() == [TIMES]


# ---- Rounds --------------------------------------------------------------------------------------


def test_motions_are_counted_by_how_they_ended_and_what_they_crossed():
    of = {"crossed": 0.3, "ended": "stopped"}
    assert motion_counts(found_of("em", END_STATES, "passed")) == {"motions finished": 1}
    assert motion_counts(found_of("em", END_STATES, "failed", reached=True, **of)) == {
        "motions stopped": 1,
        "crossed: em": 1,
    }
    assert motion_counts(found_of("em", END_STATES, "failed", **of)) == {
        "motions stopped": 1,
        "not crossed: em": 1,
    }
    at_start = found_of("em", END_STATES, "passed", crossed=0.0)
    assert motion_counts(at_start) == {"motions finished": 1, "not crossed: em": 1}


def test_the_time_of_motions_is_what_half_of_those_that_begin_come_to(monkeypatch):
    y = np.zeros((5, TIMES, 6))
    for i, last in enumerate((30, 17, 65, 1, 9)):
        y[i, last:] = np.nan
    status = np.array(["failed", "failed", "finished", "refused", "failed"])
    answers: dict[str, Any] = {
        "au": None,
        "gw": SimulatedBatch(y, y[:, :, 0], np.array(["refused"] * 5), status),
        "em": SimulatedBatch(y, y[:, :, 0], status, status),
        "kane": SimulatedBatch(0 * y, y[:, :, 0], status, status),
    }
    asked: list = []

    def moved(cases, key, *how):
        asked.append((key, *how))
        return answers[key]

    monkeypatch.setattr(motion_rounds, "simulate_batch", moved)
    # Of 9, 17, 30 and 65 times, the median is 23: the time of number 22.
    assert informative(CASES, ("au", "gw", "em", "kane")) == pytest.approx(LONGEST * 22 / 64)
    assert [key for key, *_ in asked] == ["au", "gw", "em"]
    assert set(asked) == {(key, LONGEST, COARSE, 150) for key in ("au", "gw", "em")}
    assert informative(CASES, ("au",)) == informative(CASES, ("gw",)) == LONGEST
    y[:, 1:] = np.nan
    assert informative(CASES, ("em",)) == pytest.approx(LONGEST / TIMES / 4)


def test_a_round_of_motions_keeps_what_passed_counts_verdicts_and_asks_one_alone(monkeypatch):
    asked: list = []

    def judged(cases, keys, t_end, alone):
        asked.append((t_end, alone))
        return [
            [
                found_of("em", END_STATES, "passed", 0.3),
                found_of("gw", END_STATES, "failed", 3.0, ended="stopped"),
                found_of("em", ENERGY, "inconclusive"),
            ],
            [found_of("em", END_STATES, "passed", 0.6), found_of("em", ENERGY, "passed", 0.1)],
        ]

    monkeypatch.setattr(motion_rounds, "judge_motions", judged)
    monkeypatch.setattr(motion_rounds, "draw_starts", lambda *_: (CASES, ["ordinary", "special"]))
    monkeypatch.setattr(motion_rounds, "informative", lambda *_: 100.0)
    plan = MotionPlan(Sleigh, 1, ("em", "gw"), climbing=False)
    results = [plan.run(Round(number, StructuralVariant(None, ()), {})) for number in range(60)]
    one = results[0]
    assert one.counts == {
        "ordinary": 1,
        "special": 1,
        "states": 2,
        "passed": 3,
        "failed": 1,
        "inconclusive": 1,
        "motions finished": 2,
        "motions stopped": 1,
    }
    heights = {key: [(x.score, x.case) for x in best] for key, best in one.population.items()}
    assert heights == {
        (END_STATES, "em"): [(0.6, CASES[1]), (0.3, CASES[0])],
        (ENERGY, "em"): [(0.1, CASES[1])],
    }
    assert [(x.claim, x.subject) for x in one.failed] == [(END_STATES, "gw")]
    times = np.array([t for t, _ in asked])
    assert times.min() >= SHORTEST and times.max() <= LONGEST
    # All magnitudes alike: half of them below the geometric mean, 1 s.
    assert times.min() < 0.35 and times.max() > 3.0 and 20 < (times < 1.0).sum() < 40
    assert {(i, key) for _, [(i, key)] in asked} == {(i, k) for i in (0, 1) for k in ("em", "gw")}
    monkeypatch.setattr(motion_rounds, "informative", lambda *_: 0.25)
    asked.clear()
    for number in range(5):
        plan.run(Round(number, StructuralVariant(None, ()), {}))
    assert max(t for t, _ in asked) == 0.25
    assert (plan.max_states, replace(plan, batch=5).max_states, plan.noun) == (32, 10, "motion")


# ---- Whose fault ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("others", "whose", "said"),
    [
        ("pp", screening.SILENT, "2 of 2 others agree to 0.3"),
        ("ppi", screening.SILENT, "2 of 3 others agree to 0.3"),
        ("ppii", screening.UNKNOWN, "2 of 4 others agree to 0.3"),
        ("ppff", screening.UNKNOWN, "2 of 4 others agree to 0.3"),
        ("p", screening.UNKNOWN, "1 of 1 others agree to 0.2"),
        ("iii", screening.UNKNOWN, "0 of 3 others agree to 0"),
        ("fpppf", screening.SILENT, "3 of 5 others agree to 0.4"),
    ],
)
def test_a_formulation_is_to_blame_which_most_others_contradict(monkeypatch, others, whose, said):
    verdicts = {"p": "passed", "i": "inconclusive", "f": "failed"}
    failed = found_of("em", END_STATES, "failed", 9.0, t_end=2.5)
    seen: list = [failed, found_of("au", ENERGY, "passed"), found_of("gw", ENERGY, "passed")]
    passed = 0
    for i, one in enumerate(others):
        passed += one == "p"
        x = 0.1 + 0.1 * passed if one == "p" else 7.0
        seen.append(found_of(f"key {i}", END_STATES, verdicts[one], x))
    asked: list = []

    def judged(cases, keys, t_end, alone):
        asked.append((cases, keys, t_end, alone))
        return [seen]

    monkeypatch.setattr(motion_finds, "judge_motions", judged)
    assert diagnose_motion_failure(failed, ("au", "em")) == (whose, said)
    assert asked == [([CASES[0]], ("au", "em"), 2.5, [])]
    diagnose_motion_failure(found_of("em", ALONE, "failed"), ("au", "em"))
    assert asked[1][3] == [(0, "au"), (0, "em")]


def test_a_motion_is_made_shorter_while_it_fails_and_judged_among_all_at_the_end(monkeypatch):
    asked: list = []

    def failures(case, keys, t_end):
        asked.append((tuple(keys), t_end))
        fails = t_end > 0.7
        other = found_of("au", END_STATES, "failed", t_end=t_end)
        mine = found_of("em", END_STATES, "failed", 2.0 + len(asked), t_end=t_end)
        energy = found_of("em", ENERGY, "failed", t_end=t_end)
        return [other, energy, mine] if fails else [other, energy]

    keys = ("au", "em", "gw", "kane", "ml", "uk")
    monkeypatch.setattr(motion_finds, "failures_of_motion", failures)
    monkeypatch.setattr(motion_finds, "simplify_numbers", lambda finding, look, most: finding)
    small = shrink_motion(found_of("em", END_STATES, "failed", t_end=3.4567), keys)
    few = "em", "au", "gw", "kane"
    assert asked == [
        (few, 3.4567 / 2),
        (few, 3.4567 / 4),
        (few, 0.86),
        (few, 0.9),
        (keys, 0.9),
    ]
    assert (small.claim, small.subject, small.t_end, small.observed) == (END_STATES, "em", 0.9, 7.0)


def test_a_motion_alone_is_asked_by_those_formulations_that_apply(monkeypatch):
    asked: list = []
    monkeypatch.setattr(
        motion_comparison,
        "judge_motions",
        lambda cases, keys, t_end, alone: asked.append(alone) or [["x"]],
    )
    able = [key for key, f in FORMULATIONS.items() if f.applies_to(SLEIGH)]
    assert findings_of_motion(CASES[0], tuple(FORMULATIONS), 1.0) == ["x"]
    assert asked == [[(0, key) for key in able]] and len(able) < len(FORMULATIONS)
