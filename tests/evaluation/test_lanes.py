"""Lanes stay apart: what no lane can say does not take the others along."""

from __future__ import annotations

import numpy as np

from eomcheck.evaluation.evaluation import BatchEvaluation
from eomcheck.evaluation.perturbed import PerturbedEvaluation, perturbed_samples
from eomcheck.mechanics.records import State
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.noise import SAMPLES
from eomcheck.scenes import TurntableBall

STATE = State(*TurntableBall.example().initial_state(), 0.5)


def test_entries_far_apart_in_one_lane_leave_the_others_alone():
    """The constraints of the first are nearly parallel: no velocity slips across them."""
    at = BatchEvaluation([TurntableBall.example()] * 3, [STATE] * 3)
    a = at.terms.a.data.copy()
    a[0, 1] = a[0, 0]
    at.terms = at.terms._replace(a=BatchArray(a))
    moved = PerturbedEvaluation(at, coordinates=False).v.data.reshape(SAMPLES + 1, 3, -1)
    alone = perturbed_samples(at.alone(1)).v.data
    assert np.array_equal(moved[:, 1], alone) and np.array_equal(moved[:, 2], alone)
    assert np.isfinite(moved).all()


def test_a_state_of_a_lane_is_that_of_its_own_time():
    scene = TurntableBall.example()
    states = [State(*scene.initial_state(), t) for t in (0.5, 2.0)]
    at = BatchEvaluation([scene, scene], states)
    assert [at.state_of(lane).t for lane in (0, 1)] == [0.5, 2.0]
    assert [at.alone(lane).t for lane in (0, 1)] == [0.5, 2.0]
