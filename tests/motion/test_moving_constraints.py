"""Motions whose constraints depend on time: whatever looks at a state looks at it at its time."""

from __future__ import annotations

import numpy as np
import pytest
from tests.samples import ordinary

from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels import dop853
from eomcheck.motion.batch import _reason
from eomcheck.motion.observables import as_integrated
from eomcheck.motion.right_hand_side import state_of
from eomcheck.motion.simulate import Motion
from eomcheck.motion.stabilization import project_speeds
from eomcheck.scenes import TurntableBall

SCENE = TurntableBall(swing=1.0, frequency=3.0)
_, (Q, _, _) = ordinary(TurntableBall)
START = SCENE.initial_state()
LATER = 0.7


def consistent(t: float) -> Evaluation:
    """Return the scene at Q at time t, at a velocity that keeps the constraints there."""
    at = Evaluation(SCENE, Q, np.zeros(5), t)
    a, b = at.terms.a, at.terms.b
    along = np.array([0.3, -0.2, 0.5, 0.1, -0.4])
    return Evaluation(SCENE, Q, along - np.linalg.lstsq(a, a @ along + b, rcond=None)[0], t)


@pytest.mark.parametrize("key", ["au", "el", "em", "kane"])
def test_a_state_is_that_of_its_time(key: str):
    formulation, at = FORMULATIONS[key], consistent(LATER)
    motion = Motion(SCENE, formulation, *START)
    y = state_of(at, formulation)
    q, v = motion.split(y, LATER)
    assert q == pytest.approx(at.q) and v == pytest.approx(at.v, abs=1e-13)
    assert motion.split(y)[1] == pytest.approx(at.v, abs=1e-13) or key in ("em", "kane")
    there = motion.evaluation(y, LATER)
    assert there is not None and there.t == LATER
    expected = at.acceleration(formulation).vdot
    assert there.acceleration(formulation).vdot == pytest.approx(expected, abs=1e-11)
    assert np.abs(consistent(0.0).acceleration(formulation).vdot - expected).max() > 1e-3


@pytest.mark.parametrize("key", ["em", "kane"])
def test_the_velocity_that_is_integrated_is_that_of_its_time(key: str):
    at = consistent(LATER)
    same, y = as_integrated(at, FORMULATIONS[key])
    assert same.t == LATER and same.v == pytest.approx(at.v, abs=1e-13)
    assert (y == state_of(at, FORMULATIONS[key])).all()


def test_projected_velocities_keep_the_constraints_as_they_move():
    formulation, at = FORMULATIONS["au"], consistent(LATER)
    motion = Motion(SCENE, formulation, *START)
    off = np.array([0.1, -0.2, 0.3, 0.1, -0.4])
    here = SCENE, formulation, motion.partition
    new = project_speeds(*here, LATER, at.q, at.v + off)
    assert np.abs(at.terms.a @ new + at.terms.b).max() < 1e-13
    y = np.concatenate((at.q, at.v + off, [5.0, 7.0]))
    assert motion.project(LATER, y).tolist() == [*at.q, *new, 5.0, 7.0]


@pytest.mark.parametrize(
    ("status", "says"),
    [
        (dop853.TOO_MANY, "7 steps do not reach the end, only t = 0.7 s"),
        (
            dop853.TOO_SMALL,
            "no step is small enough, or the right-hand side is not finite, at t = 0.7 s: it "
            "overflows, or a matrix is singular there",
        ),
        (
            dop853.NOT_FINITE,
            "the right-hand side is not finite at t = 0.7 s: it overflows, or a matrix is "
            "singular there",
        ),
    ],
)
def test_one_of_many_motions_says_why_it_ended(status: float, says: str):
    record = np.zeros(dop853.FIELDS)
    record[[dop853.STATUS, dop853.T]] = status, LATER
    at = consistent(LATER)
    assert _reason(SCENE, FORMULATIONS["au"], at.q, at.v, record, 7) == says
