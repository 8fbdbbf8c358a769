"""Poses that a motion cannot cross: where the partition by which it is solved is singular."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.samples import ordinary

from eomcheck import simulate, simulate_many
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion import observables
from eomcheck.motion.observables import singular_between, solves_partition, trace_partition
from eomcheck.motion.right_hand_side import block_of, state_of, traced_kernel
from eomcheck.scenes import SCENES, FourBarChain, Sleigh

SLEIGH = Sleigh(mass=1.3, inertia=0.21, offset=0.37, rate=2.1)
START = {"q0": [0.0, 0.0, -0.6], "u0": [-0.8, 2.1]}
"""It turns through θ = 0, where a = (sin θ, -cos θ, 0) does not tell the first velocity. Em went
over it with 1 x 1 matrices, all of rcond 1, and ended "finished", q off by 9e-6."""

kinds = pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)


@pytest.mark.parametrize("key", ["em", "el"])
@pytest.mark.parametrize("tolerance", [1e-12, 1e-9, 1e-6])
@pytest.mark.parametrize("times", [None, np.linspace(0, 10, 31), [0.2, 1.5], [10.0]])
def test_a_motion_that_went_over_a_singular_pose_failed_before(key, tolerance, times):
    found = simulate(SLEIGH, key, 10.0, rtol=tolerance, atol=tolerance, output_times=times, **START)
    assert found.status == "failed"
    assert "the matrix a_1" in found.reason
    assert found.refusal is not None
    assert found.refusal.what == "a_1"
    assert (found.q[:, 2] < 0).all()
    assert len(found.times) == len(found.q) == len(found.v) == len(found.energy)
    if len(found.times):
        exact = simulate(
            SLEIGH, "kane", 10.0, rtol=1e-12, atol=1e-12, output_times=found.times, **START
        )
        assert np.abs(exact.q - found.q).max() < 1e3 * tolerance


@pytest.mark.parametrize("key", ["em", "el"])
def test_poses_that_are_crossed_twice_between_two_outputs_are_noticed(key: str):
    sleigh = Sleigh(mass=1.3, inertia=0.21, offset=0.02, rate=2.1)
    exact = simulate(sleigh, "kane", 10.0, **START)
    turned = np.flatnonzero((exact.q[:, 2] > np.pi + 0.5) & (exact.q[:, 2] < 2 * np.pi - 0.5))
    times = [0.01, exact.times[turned[0]]]
    found = simulate(sleigh, key, times[1], output_times=times, **START)
    assert (found.status, found.times.tolist()) == ("failed", times[:1])
    assert "the matrix a_1" in found.reason


@pytest.mark.parametrize("key", ["im", "au", "gw", "ml", "kane"])
def test_a_motion_that_is_solved_by_no_partition_goes_through(key):
    found = simulate(SLEIGH, key, 10.0, **START)
    assert found.status == "finished"
    assert found.q[-1, 2] > 0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", ["el", "em", "ml", "kane"])
def test_speeds_that_are_a_partition_cross_no_pose_in_which_it_is_singular(key):
    found = simulate(FourBarChain.rods(1), key, 10.0)
    assert found.status == "failed"
    assert "the matrix a_1" in found.reason
    assert simulate(FourBarChain.rods(1), "au", 10.0).status == "finished"


def test_of_many_motions_those_that_went_over_it_failed_and_the_others_did_not():
    poses, speeds = [[0, 0, -0.6], [0, 0, 0.6], [0, 0, 0.1], [0, 0, -0.6]], [-0.8, 2.1]
    given = {"q0": poses, "u0": [speeds, speeds, [0.3, 0.0], [0.3, 0.0]]}
    found = simulate_many(SLEIGH, "em", 10.0, **given)
    assert found.status.tolist() == ["failed", "failed", "finished", "finished"]
    for i in range(2):
        assert "the matrix a_1" in found.reason[i]
        kept = np.isfinite(found.q[i]).all(axis=1)
        turns = np.floor(found.q[i, kept, 2] / np.pi)
        assert kept.any()
        assert (turns == turns[0]).all()
        assert np.isnan(found.v[i, ~kept]).all()
        assert np.isnan(found.energy[i, ~kept]).all()
    assert (simulate_many(SLEIGH, "kane", 10.0, **given).status == "finished").all()


def test_one_that_goes_over_it_behind_its_last_output_failed_as_well():
    found = simulate_many(SLEIGH, "em", 1.0, q0=[START["q0"]], u0=[START["u0"]], output_times=[0.1])
    assert found.status.tolist() == ["failed"]
    assert np.isfinite(found.q).all()


def test_a_pose_that_is_crossed_before_the_first_output_is_noticed():
    start: Any = {"q0": [START["q0"]], "u0": [START["u0"]], "output_times": [0.5, 1.0]}
    free = simulate_many(SLEIGH, "kane", 1.0, **start)
    assert (free.q[0, :, 2] > 0).all()
    found = simulate_many(SLEIGH, "em", 1.0, **start)
    assert found.status.tolist() == ["failed"]
    assert "between t = 0 s and 0.5 s" in found.reason[0]
    assert np.isnan(found.q).all()


def test_windows_that_fold_two_at_a_time_are_noticed_though_no_sign_changes():
    for key in ("em", "el"):
        found = simulate(FourBarChain.rods(2), key, 0.9, rtol=1e-11, atol=1e-11)
        assert found.status == "failed"
        assert 0.6 < found.times[-1] < 0.7144


@pytest.mark.sampled(4)
@kinds
@pytest.mark.parametrize("key", FORMULATIONS)
def test_what_is_looked_at_is_the_matrix_that_is_solved(kind, key):
    scene, (q, v, t) = ordinary(kind)
    formulation = FORMULATIONS[key]
    if not formulation.applies_to(scene):
        return
    at = Evaluation(scene, q, v, t)
    at.acceleration(formulation)
    solved = {"a_1", "a'T"} & (at.solves[key, False].keys() | at.speeds_rcond.keys())
    assert solves_partition(scene, formulation) == bool(solved)
    if solved:
        size, y = scene.r**2, state_of(at, formulation)
        kernel = traced_kernel(trace_partition, scene, formulation, {"a_1": size})
        (a_1,) = kernel(block_of(kernel, scene), np.array([t]), y).values()
        expected = at.terms.a[:, at.partition.dependent].ravel()
        assert a_1 == pytest.approx(expected, rel=1e-13, abs=1e-15)


def turned(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


ONE = np.eye(2)
SHEARED = np.array([[-1.0, 5.0], [0.0, -1.0]])


@pytest.mark.parametrize(
    ("matrices", "where"),
    [
        ([[[1]], [[1]], [[3]]], []),
        ([[[-1]], [[-1e-3]]], []),
        ([[[1]], [[-1]]], [0]),
        ([[[-1]], [[-1]], [[1]], [[-1]]], [1, 2]),
        ([[[1]]], []),
        ([], []),
        ([ONE, -ONE], [0]),
        ([ONE, SHEARED], [0]),
        ([ONE, SHEARED + 1e-16 * turned(1.0)], [0]),
        ([ONE, turned(3.0), turned(6.0)], []),
        ([ONE, np.diag([-1.0, 1.0])], [0]),
        ([ONE, np.diag([-1.0, -3.0]), np.diag([-1.0, 3.0])], [0, 1]),
        ([ONE, np.full((2, 2), np.nan)], []),
    ],
)
def test_a_matrix_is_singular_between_two_where_an_eigenvalue_passes_zero(matrices, where):
    size = len(matrices[0]) if len(matrices) else 1
    A = np.array(matrices, float).reshape(-1, size, size)
    assert np.flatnonzero(singular_between(A)).tolist() == where


def test_a_state_in_which_it_is_singular_exactly_is_told_by_the_right_hand_side():
    found = simulate(SLEIGH, "em", 1.0, q0=[0.0, 0.0, 0.0], u0=[1.0, 0.5])
    assert found.status == "failed"
    assert "not finite at t = 0 s" in found.reason


def test_states_are_looked_at_a_few_at_a_time_and_none_is_left_out(monkeypatch):
    whole = simulate(SLEIGH, "em", 10.0, **START)
    monkeypatch.setattr(observables, "ENTRIES", 1)
    again = simulate(SLEIGH, "em", 10.0, **START)
    assert again.reason == whole.reason
    assert again.times.tolist() == whole.times.tolist()
