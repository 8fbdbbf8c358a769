"""The chain pendulum: what is known of it, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from eomcheck import acceleration, simulate
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import applicable
from eomcheck.scenes import ChainPendulum

SCENE_KIND = ChainPendulum
keys = pytest.mark.parametrize("key", applicable(ChainPendulum))
HANGING = -np.pi / 2


def period(scene: ChainPendulum, amplitude: float) -> float:
    """Return the exact period of one link, s: 4 sqrt(I_P/(m g L/2)) K(sin²(amplitude/2))."""
    (mass,), (length,), (inertia,) = scene.mass, scene.length, scene.inertia
    about_pin = inertia + mass * length**2 / 4
    return (
        4.0
        * np.sqrt(about_pin / (mass * scene.gravity * length / 2))
        * ellipk(np.sin(amplitude / 2) ** 2)
    )


@pytest.mark.parametrize("amplitude", [0.1, 1.0, 2.0, 3.0])
def test_one_link_swings_with_the_period_of_the_elliptic_integral(amplitude: float):
    scene = ChainPendulum([0.7], [1.3], [0.2], pose=[HANGING + amplitude])
    quarter = period(scene, amplitude) / 4
    times = quarter * np.array([1.0, 2.0, 4.0])
    motion = simulate(scene, "kane", times[-1], rtol=1e-13, atol=1e-13, output_times=times)
    turned = motion.q[:, 0] - HANGING
    assert np.abs(turned - amplitude * np.array([0.0, -1.0, 1.0])).max() < 1e-11


@pytest.mark.sampled(3)
def test_every_formulation_keeps_the_energy_of_a_long_chain(mover: str):
    scene = ChainPendulum.rods(5)
    motion = simulate(scene, mover, 2.0, rtol=1e-11, atol=1e-11)
    assert motion.status == "finished"
    lost = motion.energy - motion.energy[0]
    assert np.abs(lost).max() < 1e-8
    assert motion.constraint_residual is None
    assert motion.multipliers is None


def test_a_free_link_turns_at_a_constant_rate():
    scene = ChainPendulum([2.0], [1.0], [0.1], gravity=None)
    assert acceleration(scene, "au", [0.3], [7.0]).vdot.tolist() == [0.0]
    assert Evaluation(scene, [0.3], [7.0]).terms.Q is None


def test_heavy_first_link_is_not_moved_by_what_hangs_on_it():
    scene = ChainPendulum([1e12, 1.0], [1.0, 1.0], [1e12, 0.1])
    alone = ChainPendulum([1e12], [1.0], [1e12])
    both = acceleration(scene, "gw", [0.4, -1.0], [0.2, 3.0]).vdot
    assert abs(both[0] - acceleration(alone, "gw", [0.4], [0.2]).vdot[0]) < 1e-9


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": [1.0, 0.0]}, r"mass\[1\] = 0.0, expected a positive number"),
        ({"mass": []}, "a chain has at least 1 link"),
        ({"mass": 1.0}, "a chain has at least 1 link"),
        ({"length": [1.0]}, r"length has shape \(1,\), expected \(2,\)"),
        ({"inertia": [1.0, -1.0]}, r"inertia\[1\] = -1.0, expected a number that is not negative"),
        ({"gravity": -9.81}, "gravity = -9.81, expected a number that is not negative"),
        ({"gravity": np.inf}, "gravity = inf, expected a finite number"),
        ({"pose": [0.0]}, "pose has shape"),
    ],
)
def test_parameters_that_no_chain_has_are_refused_by_name(change, says):
    valid = {"mass": [1.0, 1.0], "length": [1.0, 1.0], "inertia": [0.1, 0.1]}
    with pytest.raises(InputError, match=says):
        ChainPendulum(**valid | change)
