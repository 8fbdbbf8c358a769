"""Fuzzing of motions: right ones are no find, wrong ones are; what cannot be told is counted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eomcheck import velocity
from eomcheck.claims.reproducer import motion_reproducer
from eomcheck.draws.fuzz_cases import ORDINARY, StructuralVariant, structural_variants
from eomcheck.errors import EomcheckError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing import motion_comparison, motion_rounds, screening
from eomcheck.lab.fuzzing.campaign import Campaign, Round
from eomcheck.lab.fuzzing.failures import read_failures, replay_failures, write_failures
from eomcheck.lab.fuzzing.motion_comparison import (
    ALONE,
    END_STATES,
    ENERGY,
    MOST_STEPS,
    TIGHT,
    TIMES,
    MotionFinding,
    branchings,
    crossings,
    failures_of_motion,
    judge_motions,
)
from eomcheck.lab.fuzzing.motion_rounds import (
    MotionPlan,
    diagnose_motion_failure,
    draw_starts,
    informative,
)
from eomcheck.lab.store.record_file import Records
from eomcheck.mechanics.records import State
from eomcheck.motion import batch
from eomcheck.scenes import SCENES, FourBarChain, Sleigh, Snake

KEYS = tuple(FORMULATIONS)
FEW = ("au", "gw", "em", "kane")
TURNING = Sleigh(mass=1.3, inertia=0.21, offset=0.37, rate=2.1)
"""Its partition is singular where it heads along the y axis, which it comes to."""


def plan(kind, **options) -> MotionPlan:
    """Return a plan of few motions."""
    usual = {"families": (ORDINARY,), "batch": 8, "climbing": False}
    return MotionPlan(kind, 3, KEYS, **(usual | options))


def turning() -> tuple:
    """Return the case of a sleigh that turns over the singular pose."""
    q = np.array([0.0, 0.0, -0.6])
    return TURNING, State(q, np.asarray(velocity(TURNING, q, [-0.8, 2.1])), 0.0)


def one_round(kind, **options):
    """Return what the first round of the first structure with two links comes to."""
    return plan(kind, **options).run(Round(0, structural_variants(kind, (2,))[0], {}))


def test_the_largest_error_so_far_is_unknown_once_one_is():
    errors = np.array([[1.0, 3.0, 2.0, 4.0], [1.0, 3.0, np.nan, 4.0], [np.nan, 3.0, 2.0, 4.0]])
    expected = [[1.0, 3.0, 3.0, 4.0], [1.0, 3.0, np.nan, np.nan], [np.nan] * 4]
    assert np.array_equal(motion_comparison.largest_so_far(errors), expected, equal_nan=True)
    difference = np.stack((-2 * errors, 0 * errors), axis=2)
    found = motion_comparison.grown(difference, np.full((3, 4, 2), 2.0))
    assert np.array_equal(found, expected, equal_nan=True)


# ---- What is right -------------------------------------------------------------------------------


@pytest.mark.night
@pytest.mark.parametrize("key", ["snake", "sleigh", "turntable-ball", "four-bar-chain"])
def test_right_motions_are_no_find_and_most_are_told(key: str):
    result = one_round(SCENES[key])
    assert not result.failed
    assert result.counts["states"] >= 6
    assert result.counts["passed"] > 5 * result.counts["inconclusive"]
    assert {claim for claim, _ in result.population} >= {END_STATES, ALONE}


def test_motions_begin_at_0_and_keep_the_constraints_there():
    here = plan(SCENES["turntable-ball"], batch=4)
    cases, families = draw_starts(
        here.kind, StructuralVariant(None, ()), here.families, here.batch, np.random.default_rng(0)
    )
    assert len(cases) == len(families) > 0
    for scene, state in cases:
        assert state.t == 0.0
        a, b = scene_constraints(scene, state)
        assert np.abs(a @ state.v + b).max() < 1e-10


@pytest.mark.parametrize("shared", [False, True])
def test_families_of_motions_that_cannot_begin_are_not_counted(monkeypatch, shared: bool):
    kind = SCENES["turntable-ball"]
    scene = kind.example()
    scenes = [scene if shared else kind.example() for _ in range(4)]
    q = np.arange(4.0)[:, None] + np.zeros(scene.n)
    cases = [(one, State(x, x, 0.5)) for one, x in zip(scenes, q, strict=True)]
    families = ["a", "b", "c", "d"]

    def closed(scene, x, t):
        if x[0] == 1.0:
            raise EomcheckError("open")
        return x

    def some(scenes, states, velocities):
        return [(scenes[i], states[i]) for i in (0, 2)], [0, 2]

    monkeypatch.setattr(motion_rounds, "draw_cases", lambda *_: (cases, families))
    monkeypatch.setattr(motion_rounds, "assembled_position", closed)
    monkeypatch.setattr(motion_rounds, "consistent", some)
    begun, of = draw_starts(
        kind, StructuralVariant(None, ()), families, 4, np.random.default_rng(0)
    )
    assert [state.q[0] for _, state in begun] == [0.0, 3.0]
    assert of == ["a", "d"]


def test_motions_of_scenes_without_time_all_begin(monkeypatch):
    cases = [(TURNING, State(np.zeros(3), np.zeros(3), 0.5))] * 2
    monkeypatch.setattr(motion_rounds, "draw_cases", lambda *_: (cases, ["a", "b"]))
    begun, of = draw_starts(Sleigh, StructuralVariant(None, ()), (), 2, np.random.default_rng(0))
    assert ([state.t for _, state in begun], of) == ([0.0, 0.0], ["a", "b"])


def scene_constraints(scene, state):
    """Return a and b."""
    from eomcheck.evaluation.evaluation import Evaluation

    terms = Evaluation(scene, *state).terms
    return terms.a, 0.0 if terms.b is None else terms.b


def test_fast_scenes_are_moved_for_a_shorter_time():
    times = []
    for stiffness in (1.0, 1e6):
        scene = Snake([1, 1], [1, 1], [0.1, 0.1], [stiffness], [0, 0.3])
        q = np.array([0.0, 0.0, 0.3, 1.0])
        times.append(informative([(scene, State(q, np.zeros(4), 0.0))], FEW))
    assert times[1] < times[0] / 10


# ---- What is wrong -------------------------------------------------------------------------------


@pytest.mark.night
def test_a_formulation_that_steps_over_a_singular_pose_is_a_find(monkeypatch, tmp_path: Path):
    case = turning()
    assert failures_of_motion(case, FEW, 5.0) == []
    monkeypatch.setattr(batch, "solves_partition", lambda *_: False)
    failed = failures_of_motion(case, FEW, 5.0)
    assert {(x.claim, x.subject) for x in failed} >= {(END_STATES, "em")}
    assert {x.subject for x in failed} == {"em"}
    first = failed[0]
    assert "singular" in first.detail and 0.2 < first.crossed < 0.35
    find = plan(Sleigh).record_failure(first, "sleigh", [])
    assert find.whose == screening.SILENT and find.t_end < 5.0
    assert len(repr(find.parameters)) < len("{'mass': 1.3, 'inertia': 0.21, 'offset': 0.37}") + 40
    file = tmp_path / "found.json"
    write_failures(file, [find])
    (kept,) = read_failures(file)
    assert kept == find
    assert [(x.outcome, x.failure.subject) for x in replay_failures([kept], KEYS)] == [
        ("failed", "em")
    ]
    monkeypatch.undo()
    assert [x.outcome for x in replay_failures([kept], KEYS)] == ["holds"]


def test_the_code_of_a_find_shows_what_is_apart(monkeypatch, capsys):
    monkeypatch.setattr(batch, "solves_partition", lambda *_: False)
    (failed, *_) = failures_of_motion(turning(), FEW, 5.0)
    exec(failed.as_python(), {})
    said = {line.split()[0]: line.split()[3] for line in capsys.readouterr().out.splitlines()}
    assert float(said["em"]) == 0.0 and float(said["kane"]) > 1e-6


def test_random_motions_find_it(monkeypatch):
    monkeypatch.setattr(batch, "solves_partition", lambda *_: False)
    result = one_round(Sleigh, batch=16)
    assert {x.subject for x in result.failed if x.claim == END_STATES} == {"em"}


def test_a_pose_that_is_not_crossed_is_counted_by_formulation():
    counts = one_round(Sleigh, batch=16).counts
    assert counts["not crossed: em"] == counts["not crossed: el"] > 2
    assert counts["crossed: au"] == counts["not crossed: em"] and counts["crossed: em"] == 0


@pytest.mark.night
def test_lanes_that_read_the_numbers_of_another_are_a_find(monkeypatch):
    right = batch.lane_parameters
    monkeypatch.setattr(batch, "lane_parameters", lambda scenes: right([scenes[0]] * len(scenes)))
    claims = {x.claim for number in range(2) for x in round_of(number).failed}
    assert ALONE in claims


def test_a_motion_alone_is_allowed_what_it_is_allowed_beside_others(monkeypatch):
    right, together, judged, runs = (
        motion_comparison._worst_finding,
        motion_comparison.simulate_batch,
        {},
        {},
    )

    def found(claim, shown, observed, allowed, scale):
        judged[claim, shown.key] = observed, allowed
        return right(claim, shown, observed, allowed, scale)

    def moved(cases, key, t_end, tolerance, *most):
        found = together(cases, key, t_end, tolerance, *most)
        runs.setdefault((key, tolerance), found.y)  # the next are of starts nearby
        return found

    monkeypatch.setattr(motion_comparison, "_worst_finding", found)
    monkeypatch.setattr(motion_comparison, "simulate_batch", moved)
    # Alone it comes to the same numbers.
    monkeypatch.setattr(
        motion_comparison, "simulate_single", lambda case, key, t_end, x: runs[key, x]
    )
    judge_motions([turning()], FEW, 1.0, [(0, key) for key in FEW])
    for key in FEW:
        assert np.array_equal(judged[ALONE, key], judged[END_STATES, key], equal_nan=True)


def round_of(number: int):
    """Return what a round of snakes with two links comes to."""
    return plan(Snake).run(Round(number, StructuralVariant(2, ("damping",)), {}))


def spoilt(monkeypatch, spoil, alone: tuple[str, ...] = ()) -> list:
    """Return what fails of a motion if `spoil(key, tolerance, y, energy)` has changed it.

    By the formulations `alone` it is also looked at alone, and changed as "alone".
    """
    right, runs = motion_comparison.simulate_batch, {}

    def moved(cases, key, t_end, tolerance, most=MOST_STEPS):
        found = right(cases, key, t_end, tolerance, most)
        y, energy = spoil(key, tolerance, found.y.copy(), found.energy.copy())
        runs[tolerance] = found
        return found._replace(y=y, energy=energy)

    def by_itself(case, key, t_end, tolerance):
        found = runs[tolerance]
        return spoil("alone", tolerance, found.y.copy(), found.energy.copy())[0]

    monkeypatch.setattr(motion_comparison, "simulate_batch", moved)
    monkeypatch.setattr(motion_comparison, "simulate_single", by_itself)
    q = np.array([0.1, 0.2, 0.3])
    here = Sleigh(mass=1.0, inertia=1.0, offset=0.3, rate=0.1)
    case = here, State(q, np.asarray(velocity(here, q, [0.5, 0.1])), 0.0)
    (found,) = judge_motions([case], FEW, 1.0, [(0, key) for key in alone])
    assert len(found) == 2 * len(FEW) + len(alone)
    return [x for x in found if x.verdict == "failed"]


GROWING = np.linspace(0.0, 1.0, TIMES)


def test_a_formulation_that_is_off_by_a_millionth_is_a_find(monkeypatch):
    def off(key, tolerance, y, energy):
        return y + 1e-4 * (key == "gw") * GROWING[:, None], energy

    (failed,) = spoilt(monkeypatch, off)
    assert (failed.claim, failed.subject) == (END_STATES, "gw")
    assert 5e-5 < failed.observed < 2e-4


@pytest.mark.parametrize("pose", [31, 32, 33, TIMES])
def test_a_motion_that_is_off_is_told_with_the_time_and_the_pose_before_it(monkeypatch, pose):
    """A pose at the very time is one before it."""
    middle = (TIMES - 1) // 2
    assert middle == 32

    def off(key, tolerance, y, energy):
        y[:, middle] += 1e-4 * (key == "gw")
        return y, energy

    monkeypatch.setattr(motion_comparison, "crossings", lambda cases, *_: np.array([pose]))
    (failed,) = spoilt(monkeypatch, off)
    assert "than the others at t = 0.5 s" in failed.detail
    assert failed.detail.endswith(f"before t = {pose / 64:.4g} s") == (pose <= middle)
    assert failed.crossed == (None if pose == TIMES else pose / 64)


def test_what_tolerance_explains_is_no_find(monkeypatch):
    def off(key, tolerance, y, energy):
        return y + 1e3 * tolerance * (key == "gw") * GROWING[:, None], energy

    assert spoilt(monkeypatch, off) == []


def test_energy_that_all_formulations_lose_alike_is_a_find(monkeypatch):
    def off(key, tolerance, y, energy):
        return y, energy * (1.0 - 1e-3 * GROWING)

    failed = spoilt(monkeypatch, off)
    assert {x.claim for x in failed} == {ENERGY} and len(failed) == len(FEW)


def test_two_formulations_of_four_that_are_wrong_alike_are_not_taken_for_right(monkeypatch):
    def off(key, tolerance, y, energy):
        return y + 1e-2 * (key in ("gw", "em")) * GROWING[:, None], energy

    assert {x.subject for x in spoilt(monkeypatch, off)} >= {"gw", "em"}


# ---- What cannot be told -------------------------------------------------------------------------


def test_behind_a_pose_with_branches_nothing_is_said():
    rods = FourBarChain.rods(1)
    at = np.pi / 2 + np.zeros(3)
    at[1] = 0.0
    y = np.zeros((1, TIMES, 6))
    y[0, :, 0] = y[0, :, 2] = np.linspace(np.pi / 2, -0.5, TIMES)
    case = rods, State(y[0, 0, :3], np.zeros(3), 0.0)
    (place,) = branchings([case], y, 1.0)
    flat = int(np.flatnonzero(y[0, :, 0] <= 0.0)[0])
    assert abs(place - flat) <= 1
    y[0, :, 0] = y[0, :, 2] = np.linspace(np.pi / 2, 0.5, TIMES)
    assert branchings([case], y, 1.0).tolist() == [TIMES]


@pytest.mark.parametrize(("pose", "fails"), [(39, False), (40, False), (41, True)])
@pytest.mark.parametrize("claim", [END_STATES, ENERGY, ALONE])
def test_what_differs_only_behind_a_pose_with_branches_is_no_failure(
    monkeypatch, claim: str, pose: int, fails: bool
):
    """A motion may take either branch; the difference is at the 40th time and later."""
    wrong = 1e-2 * (np.arange(TIMES) >= 40)
    spoils = {END_STATES: "gw", ENERGY: "gw", ALONE: "alone"}

    def off(key, tolerance, y, energy):
        here = wrong * (key == spoils[claim])
        return (y, energy + here) if claim == ENERGY else (y + here[:, None], energy)

    monkeypatch.setattr(motion_comparison, "branchings", lambda cases, *_: np.array([pose]))
    failed = spoilt(monkeypatch, off, ("kane",))
    assert [x.claim for x in failed] == [claim] * fails


def test_a_pose_with_branches_that_a_wrong_motion_comes_to_hides_no_failure(monkeypatch):
    """One goes astray and meets such a pose, another is wrong only later."""
    late, strayed = np.arange(TIMES) > 50, []

    def off(key, tolerance, y, energy):
        if key == "gw":
            y += 1e-2 * GROWING[:, None]
            strayed.append(y)
        y -= 1e-2 * (key == "em") * late[:, None]
        return y, energy

    def some(cases, y, t_end):
        return np.array([30 if any(y is one for one in strayed) else TIMES])

    monkeypatch.setattr(motion_comparison, "branchings", some)
    failed = spoilt(monkeypatch, off)
    assert strayed
    assert {(x.claim, x.subject) for x in failed} == {(END_STATES, "gw"), (END_STATES, "em")}


def test_poses_are_crossed_where_the_determinant_changes_its_sign():
    case = turning()
    y = np.zeros((1, TIMES, 6))
    y[0, :, 2] = np.linspace(-0.6, 0.6, TIMES)
    y[0, 40:] = np.nan
    (place,) = crossings([case], y, 1.0)
    assert abs(y[0, place, 2]) <= 0.02 and place <= 40
    y[0, :40, 2] = np.linspace(-0.6, -0.1, 40)
    assert crossings([case], y, 1.0).tolist() == [TIMES]


@pytest.mark.parametrize(
    ("verdicts", "whose"),
    [
        (("passed", "passed", "passed"), screening.SILENT),
        (("passed", "passed", "inconclusive"), screening.SILENT),
        (("passed", "passed", "failed"), screening.SILENT),
        (("passed", "passed", "inconclusive", "failed"), screening.UNKNOWN),
        (("passed", "inconclusive", "inconclusive"), screening.UNKNOWN),
        (("inconclusive",) * 3, screening.UNKNOWN),
        (("passed",), screening.UNKNOWN),
        ((), screening.UNKNOWN),
    ],
)
def test_a_formulation_is_to_blame_only_where_most_others_and_two_at_least_pass(
    monkeypatch, verdicts: tuple[str, ...], whose: str
):
    scene, state = turning()

    def finding(claim: str, i: int, verdict: Any) -> MotionFinding:
        observed = {"passed": 0.25 / 2**i, "inconclusive": np.nan}.get(verdict, 3.0)
        named = claim, KEYS[i], scene, state, observed, 1.0, verdict
        return MotionFinding(*named, "compared: all", t_end=1.0)

    failed = finding(END_STATES, 0, "failed")
    others = [finding(END_STATES, i, verdict) for i, verdict in enumerate(verdicts, 1)]
    of_energy = [finding(ENERGY, i, "passed") for i in range(len(KEYS))]
    monkeypatch.setattr(motion_rounds, "judge_motions", lambda *_: [[failed, *others, *of_energy]])
    fault = diagnose_motion_failure(failed, KEYS)
    assert fault.at_fault == whose
    best = 0.12 if "passed" in verdicts else 0
    agree = verdicts.count("passed")
    assert fault.evidence == f"{agree} of {len(verdicts)} others agree to {best}"


# ---- Campaigns -----------------------------------------------------------------------------------


@pytest.mark.night
def test_a_campaign_of_motions_goes_on_where_it_stopped(tmp_path: Path):
    strata = structural_variants(Sleigh, ())
    here = plan(Sleigh, batch=4, climbing=True)
    whole = Campaign(here, "sleigh", strata)
    whole.run(states=20)
    with Records(tmp_path / "r.db") as records:
        Campaign(here, "sleigh", strata, records).run(states=5)
    with Records(tmp_path / "r.db") as records:
        again = Campaign(here, "sleigh", strata, records)
        assert again.resumed > 0
        again.run(states=20)
    assert again.counts == whole.counts and whole.counts["climbed"] > 0
    heights = [{key: x.score for key, x in one.worst.items()} for one in (whole, again)]
    assert heights[0] == heights[1]


def test_the_tight_tolerance_is_the_one_that_is_judged():
    assert f"rtol={TIGHT}" in motion_reproducer(*turning(), 1.0, "em", TIGHT)
