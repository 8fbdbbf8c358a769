"""Lanes stay apart: what no lane can say does not take the others along."""

from __future__ import annotations

import numpy as np

from eomcheck.evaluation.batched_evaluation import LaneEvaluation, solve_transposed_triangle
from eomcheck.mechanics.records import State
from eomcheck.scenes import TurntableBall


def test_a_triangle_is_solved_as_it_stands_in_every_lane():
    random = np.random.default_rng(0)
    R = np.triu(random.uniform(1.0, 2.0, (5, 4, 4)))
    y = random.uniform(-1.0, 1.0, (5, 4))
    x = (R.swapaxes(-1, -2) @ y[..., None])[..., 0]
    assert np.abs(solve_transposed_triangle(R, x) - y).max() < 1e-12


def test_entries_far_apart_in_one_lane_leave_the_others_alone():
    R = np.stack([np.eye(2), [[1e-200, 1e200], [0.0, 1e-200]]])
    with np.errstate(all="ignore"):
        found = solve_transposed_triangle(R, np.ones((2, 2)))
    assert found[0].tolist() == [1.0, 1.0]
    assert not np.isfinite(found[1]).all()


def test_a_state_of_a_lane_is_that_of_its_own_time():
    scene = TurntableBall.example()
    states = [State(*scene.initial_state(), t) for t in (0.5, 2.0)]
    at = LaneEvaluation([scene, scene], states)
    assert [at.state_of(lane).t for lane in (0, 1)] == [0.5, 2.0]
    assert [at.alone(lane).t for lane in (0, 1)] == [0.5, 2.0]
