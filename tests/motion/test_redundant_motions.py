"""Motions with redundant constraints: those kept are chosen once, and watched."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eomcheck import independent_constraints, simulate, simulate_many, with_constraints
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.right_hand_side import exact_jacobian
from eomcheck.motion.simulate import Motion, Trajectory
from eomcheck.scenes import Bricard, FourBarChain

RING = Bricard(redundant=2.0)
CHAIN = replace(FourBarChain.rods(2), repeated=-1.0)
TIGHT = {"rtol": 1e-11, "atol": 1e-11}
LOOSE = {"rtol": 1e-6, "atol": 1e-6}


def test_the_ring_moves_by_all_five_rows_as_by_four():
    times = np.linspace(0.0, 3.0, 13)
    found = simulate(RING, "uk", 3.0, output_times=times, **TIGHT)
    expected = simulate(Bricard(), "kane", 3.0, output_times=times, **TIGHT)
    assert found.status == "finished", found.reason
    assert np.abs(found.q - expected.q).max() < 1e-9
    assert found.constraint_residual is not None and found.multipliers is not None
    assert found.constraint_residual.shape == found.multipliers.shape == (13, 5)
    assert found.constraint_residual.max() < 1e-9
    assert np.ptp(found.energy) < 1e-8
    assert found.rate_error < 1e-10


def test_multipliers_along_a_motion_are_the_smallest():
    motion = simulate(CHAIN, "uk", 0.6, **TIGHT)
    alone = simulate(replace(CHAIN, repeated=None), "au", 0.6, output_times=motion.times, **TIGHT)
    assert motion.status == "finished", motion.reason
    assert motion.multipliers is not None and alone.multipliers is not None
    assert np.abs(motion.q - alone.q).max() < 1e-9
    expected = alone.multipliers[:, -1:] / 2 * [1.0, -1.0]
    assert np.abs(motion.multipliers[:, 3:] - expected).max() < 1e-7


def test_the_choice_of_the_start_is_kept():
    q, v = RING.closed_state(0.5, 0.7)
    motion = Motion(RING, FORMULATIONS["uk"], q, v)
    assert motion.partition.redundant.tolist() == [4]
    assert motion.choice is not None
    later = motion.evaluation(motion.y0, 0.0)
    assert later is not None
    assert later.independent_partition is motion.partition
    by_hand = motion.rates(0.0, motion.y0)[5:10]
    at = Evaluation(RING, q, v)
    assert np.abs(by_hand - at.acceleration(FORMULATIONS["uk"]).vdot).max() < 1e-13


def test_a_jacobian_is_exact_with_redundant_rows():
    q, v = CHAIN.initial_state()
    motion = Motion(CHAIN, FORMULATIONS["uk"], q, v)
    found = exact_jacobian(CHAIN, FORMULATIONS["uk"], motion.choice)(0.0, motion.y0)
    step = 1e-6 * np.eye(10)
    rates = [motion.rates(0.0, motion.y0 + d) - motion.rates(0.0, motion.y0 - d) for d in step]
    assert np.abs(found - np.array(rates).T / 2e-6).max() < 1e-6


def test_a_motion_into_a_singular_pose_is_stopped_by_name():
    # Slow enough to come to rest there: couplers and rods in line.
    flat = replace(CHAIN, gravity=0.0, angle=0.5, rate=-1.0)
    times = np.array([0.25, 0.5, 0.75])
    motion = simulate(flat, "uk", 0.75, output_times=times, **TIGHT)
    assert motion.status == "failed"
    assert motion.times.tolist() == [0.25]
    assert "the state at t = 0.5 s is refused" in motion.reason
    assert "rank of a" in motion.reason or "position next to it" in motion.reason


def test_a_start_whose_rank_is_not_clear_is_refused():
    q, _ = RING.closed_state(0.5, 0.0)
    found = simulate_many(RING, "uk", 0.1, q0=[q, q + 1e-12 * np.eye(5)[0], q])
    assert found.status.tolist() == ["finished", "refused", "finished"]
    assert "the rank of a is not clear" in found.reason[1]


@cache
def drifted() -> Trajectory:
    """Return a motion whose constraints nothing holds."""
    return simulate(RING, "uk", 2.0, **LOOSE)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("stabilized", [{"baumgarte": 20.0}, {"projection": 0.05}])
def test_stabilization_holds_redundant_rows_too(stabilized: dict):
    loose, held = drifted(), simulate(RING, "uk", 2.0, **LOOSE, **stabilized)
    assert held.status == loose.status == "finished"
    assert loose.constraint_residual is not None and held.constraint_residual is not None
    assert held.constraint_residual[-1].max() < loose.constraint_residual[-1].max() / 5


@pytest.mark.night
def test_motions_side_by_side_keep_rows_of_their_own():
    angles = np.array([-0.3, 0.0, 0.2, 0.5, 1.0, 1.4, 1.8, 2.2, 2.6])
    q0, v0 = (np.array(x) for x in zip(*(RING.closed_state(a, 0.5) for a in angles), strict=True))
    here = {"output_times": [0.3, 0.6], **TIGHT}
    found = simulate_many(RING, "uk", 0.6, q0=q0, v0=v0, **here)
    backwards = simulate_many(RING, "uk", 0.6, q0=q0[::-1], v0=v0[::-1], lanes=2, **here)
    assert (found.status == "finished").all(), found.reason
    assert np.array_equal(found.q, backwards.q[::-1])
    assert found.constraint_residual is not None
    assert found.constraint_residual.max() < 1e-9
    left = with_constraints(RING, independent_constraints(RING, q0[0]).kept)
    others = simulate_many(left, "kane", 0.6, q0=q0, v0=v0, **here)
    assert np.abs(found.q - others.q).max() < 1e-8


def test_motions_side_by_side_with_different_choices_are_those_alone():
    angles = (0.2, 1.0, 2.9, 1.5)
    q0 = np.array([RING.closed_state(a, 0.0)[0] for a in angles])
    chosen = {independent_constraints(RING, q).redundant for q in q0}
    assert len(chosen) == 2
    many = simulate_many(RING, "uk", 0.4, q0=q0, **TIGHT)
    for i, q in enumerate(q0):
        alone = simulate_many(RING, "uk", 0.4, q0=[q], **TIGHT)
        assert np.array_equal(many.q[i], alone.q[0])
