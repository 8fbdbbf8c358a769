"""Every scene of the registry is moved by machine code as the public path says."""

from __future__ import annotations

import numpy as np
import pytest
from tests.samples import ordinary

import eomcheck
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.kernels.llvm import EFFORT, LEAST_EFFORT
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.right_hand_side import ACCELERATION, block_of, kernel_of
from eomcheck.motion.simulate import Motion, simulate
from eomcheck.scenes import SCENES


@pytest.mark.sampled(12)
def test_rates_in_machine_code_are_those_of_the_public_acceleration(moved: tuple[type[Scene], str]):
    kind, key = moved
    scene, (q, v, t) = ordinary(kind)
    expected = eomcheck.acceleration(scene, key, q, v, t)
    motion, at = Motion(scene, FORMULATIONS[key], q, v), Evaluation(scene, q, v, t)
    y = motion.y0.copy()
    if motion.formulation.state == "q, u":
        y[scene.n :] = at.u
    rates = motion.rates(t, y)
    allowed = 4 * expected.error_bound
    assert np.abs(rates[: scene.n] - v).max() <= allowed_error(
        sensitivity_of(at, lambda e: e.velocity)
    )
    found = rates[scene.n : scene.n + motion.speeds]
    if motion.formulation.state == "q, u":
        if at.speeds.W is not None:
            found = at.speeds.W @ found + at.speeds.rest
    elif motion.formulation.state == "q, x":
        found = at.call(scene.chain_acceleration, at.parameters, at.prepared, at.x, found)
    elif motion.formulation.state == "q, v2":
        expected = expected.vdot[motion.partition.independent]
        assert np.abs(found - expected).max() <= allowed
        return
    assert np.abs(found - expected.vdot).max() <= allowed


@pytest.mark.sampled(12)
def test_with_how_much_effort_code_is_generated_changes_no_bit(moved: tuple[type[Scene], str]):
    kind, key = moved
    scene, (q, v, t) = ordinary(kind)
    motion, formulation = Motion(scene, FORMULATIONS[key], q, v), FORMULATIONS[key]
    found = []
    for effort in (EFFORT, LEAST_EFFORT):
        kernel = kernel_of(
            scene, formulation, also=ACCELERATION, choice=motion.choice, effort=effort
        )
        found.append(kernel(block_of(kernel, scene), np.array([t]), motion.y0))
    for name, x in found[0].items():
        assert np.isfinite(x).all() and np.array_equal(x, found[1][name]), name


@pytest.mark.sampled(5)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_formulations_move_a_scene_alike(kind: type[Scene], sized):
    scene, (q, v, _) = ordinary(kind, 1)
    if scene.depends_on_time:  # the drawn state is one of another time
        q = v = None
    ends = []
    for key in list(applicable(kind))[:: sized(1, 3)]:
        motion = simulate(scene, key, 0.1, rtol=1e-11, atol=1e-11, q0=q, v0=v)
        assert motion.status == "finished", motion.reason
        ends.append(np.concatenate((motion.q[-1], motion.v[-1])))
        if scene.conserves_energy:
            assert np.ptp(motion.energy) <= 1e-8 * np.abs(motion.energy).max()
    size = np.abs(ends[0]).max()
    assert max(np.abs(end - ends[0]).max() for end in ends) <= 1e-8 * size
