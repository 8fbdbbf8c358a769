"""Trajectories against reference solutions, and integrators against their nominal order."""

import itertools
from pathlib import Path

import numpy as np
import pytest

import eomcheck
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.reference_solution import load_reference
from eomcheck.motion.simulate import Motion
from eomcheck.scenes import Snake

STORED = Path(__file__).with_name("references")
ONE = np.ones(3)
SOFT = Snake(ONE, ONE, ONE / 12, 200.0 * ONE[1:], [0.1, 0.2, 0.3])
START = {"q0": [0.0, 0.0, 0.1, 0.5, 1.0], "u0": [1.0, 0.5]}


@pytest.mark.sampled(6)
@pytest.mark.parametrize(
    ("key", "name"),
    [
        *((key, name) for key in eomcheck.FORMULATIONS for name in ("paper-rest", "paper-rolling")),
        ("kane", "free-3"),
    ],
)
def test_the_end_state_is_that_of_the_reference_to_1e_8(key: str, name: str):
    reference = load_reference(STORED / f"{name}.json")
    assert reference.uncertainty < 1e-20
    found = eomcheck.simulate(
        reference.scene,
        key,
        reference.times[-1],
        rtol=1e-12,
        atol=1e-12,
        q0=reference.q0,
        u0=reference.u0,
        output_times=reference.times,
    )
    assert found.status == "finished", found.reason
    assert np.abs(found.q - reference.q).max() < 1e-8
    assert np.abs(found.q[-1] - reference.q[-1]).max() < 1e-8
    assert np.abs(found.v[-1] - reference.v[-1]).max() < 1e-8 * np.abs(reference.v).max()


@pytest.mark.parametrize("key", ["kane", "au"])
@pytest.mark.parametrize("integrator", [k for k, i in INTEGRATORS.items() if i.order])
@pytest.mark.sampled(2)
def test_errors_fall_with_at_least_the_nominal_order(integrator: str, key: str):
    order = INTEGRATORS[integrator].order
    assert order is not None
    end, floor, asymptotic = 1.0, 1e-11, 1e-6
    exact = eomcheck.simulate(SOFT, "kane", end, rtol=1e-14, atol=1e-14, **START).q[-1]
    q, u = np.array(START["q0"]), np.array(START["u0"])
    motion = Motion(SOFT, eomcheck.FORMULATIONS[key], q, eomcheck.velocity(SOFT, q, u), u)
    steps, errors = [], []
    for count in (24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768):
        h = end / count
        # A tolerance that nothing exceeds keeps every step at h.
        how = {"integrator": integrator, "max_step": h, "first_step": h}
        found = motion.solve(end, rtol=1e3, atol=1e3, **how)
        error = np.abs(found.y[-1, : SOFT.n] - exact).max()
        if found.steps in (count, count + 1) and floor < error < asymptotic:
            steps.append(h)
            errors.append(error)
    assert len(steps) >= 3, (steps, errors)
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert slope >= order - 0.3, (slope, steps, errors)


@pytest.mark.parametrize("integrator", [k for k, i in INTEGRATORS.items() if not i.order])
def test_errors_fall_with_the_tolerance(integrator: str):
    exact = eomcheck.simulate(SOFT, "kane", 0.5, rtol=1e-14, atol=1e-14, **START).q[-1]
    errors = []
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        found = eomcheck.simulate(
            SOFT, "kane", 0.5, integrator=integrator, rtol=tolerance, atol=tolerance, **START
        )
        errors.append(np.abs(found.q[-1] - exact).max())
    assert all(fine < rough / 3 for rough, fine in itertools.pairwise(errors)), errors
    assert errors[-1] < 1e-7
