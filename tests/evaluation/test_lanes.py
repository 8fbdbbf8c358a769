"""Lanes stay apart: what no lane can say does not take the others along."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.evaluation.evaluation import BatchEvaluation
from eomcheck.evaluation.perturbed import PerturbedEvaluation, perturbed_samples, sensitivity_of
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.linear import SolveRecorder
from eomcheck.numbers.noise import SAMPLES
from eomcheck.scenes import Snake, TurntableBall

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


@pytest.mark.parametrize("term", ["M", "B", "a"])
def test_the_sensitivity_of_a_state_in_a_batch_is_that_of_the_state_alone(term: str):
    """Each of its perturbed samples has noise of its own, in a batch as alone."""
    scene = Snake.example()
    q, v = scene.initial_state()
    at = BatchEvaluation(
        [scene] * 3, [State(q + 0.1 * i * np.arange(q.size), v, 0.0) for i in range(3)]
    )
    together = np.asarray(sensitivity_of(at, lambda x: getattr(x.terms, term)).data)
    alone = [sensitivity_of(at.alone(i), lambda x: getattr(x.terms, term)) for i in range(3)]
    assert together.tolist() == alone


@pytest.mark.parametrize("part", [0, 1], ids=["accelerations", "multipliers"])
def test_a_state_of_which_one_entry_overflows_is_refused_and_all_its_results_are_nan(part: int):
    class Overflowing(BatchEvaluation):
        def solution(self, formulation, partition):
            results = super().solution(formulation, partition)
            results[part].data[1, 0] = np.inf
            return results

    at = Overflowing([TurntableBall.example()] * 3, [STATE] * 3)
    acceleration = at.acceleration(FORMULATIONS["au"])
    assert at.refused["au", False].tolist() == [False, True, False]
    for x in (acceleration.vdot, acceleration.multipliers):
        assert np.isnan(x.data[1]).all() and x.data.shape[1] > 1
        assert np.isfinite(x.data[[0, 2]]).all()


def test_a_state_is_refused_where_one_of_its_samples_is():
    recorder = SolveRecorder()
    assert recorder.refused_states(2).tolist() == [False, False]
    recorder.refused = [np.array([True, False, False, False])]
    assert recorder.refused_states(2).tolist() == [True, False]
    recorder.refused.append(np.array([False, True]))
    assert recorder.refused_states(2).tolist() == [True, True]
