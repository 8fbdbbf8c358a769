"""The ball on a turntable against its circles at 2Ω/7, and what stays where Ω swings."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck import acceleration, simulate, velocity
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import applicable
from eomcheck.scenes import TurntableBall

SCENE_KIND = TurntableBall
STEADY = TurntableBall()
SAME = TurntableBall(swing=0.0, frequency=1.0)
"""The same table, its constant Ω written as one that may swing."""
SWINGING = TurntableBall(swing=1.5, frequency=3.0)
PERIOD = 2.0 * np.pi / (2.0 / 7.0 * 2.0)
"""s, of the circle on a table that spins at 2 rad/s."""

every_formulation = pytest.mark.parametrize("key", applicable(TurntableBall))


def circle(times: np.ndarray) -> np.ndarray:
    """Return (x, y) (k, 2) of the ball that `STEADY` starts: round its circle at 2Ω/7."""
    start, speed, rate = STEADY.start, STEADY.speed, 2.0 / 7.0 * STEADY.rate
    arm = np.array([speed[1], -speed[0]]) / rate
    cos, sin = np.cos(rate * times), np.sin(rate * times)
    turned = np.column_stack((cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]))
    return start - arm + turned


@pytest.mark.parametrize("scene", [STEADY, SAME])
@pytest.mark.sampled(4)
def test_on_a_steady_table_the_ball_goes_round_a_circle_at_two_sevenths(scene, mover: str):
    times = np.linspace(0.0, PERIOD, 9)
    motion = simulate(scene, mover, PERIOD, rtol=1e-12, atol=1e-12, output_times=times)
    assert motion.status == "finished", motion.reason
    assert np.abs(motion.q[:, :2] - circle(times)).max() < 1e-8
    assert np.abs(motion.q[-1, :2] - motion.q[0, :2]).max() < 1e-8


@pytest.mark.sampled(3)
def test_on_a_swinging_table_what_is_known_to_stay_stays(mover: str):
    """V - 2/7 Ω(t) e_z × r, two numbers, and the spin about the vertical."""
    motion = simulate(SWINGING, mover, 3.0, rtol=1e-12, atol=1e-12)
    assert motion.status == "finished", motion.reason
    rate = SWINGING.rate + SWINGING.swing * np.sin(SWINGING.frequency * motion.times)
    x, y = motion.q[:, 0], motion.q[:, 1]
    spin = motion.v[:, 2] + motion.v[:, 4] * np.sin(motion.q[:, 3])
    kept = np.column_stack(
        (motion.v[:, 0] + 2 / 7 * rate * y, motion.v[:, 1] - 2 / 7 * rate * x, spin)
    )
    assert np.abs(kept - kept[0]).max() < 1e-8
    assert np.ptp(rate) > 2.0


@every_formulation
def test_the_acceleration_has_the_rate_of_the_table_in_it(key: str):
    """V̇ = J (Ω̇ e_z × r + Ω e_z × V) with J = I / (I + m R²), for any ball."""
    ball = TurntableBall(
        mass=2.0, radius=0.3, inertia=0.1, rate=1.2, swing=0.7, frequency=2.0, spin=0.0
    )
    q, u, t = np.array([0.5, -0.8, 0.3, 0.6, -0.2]), np.array([1.0, -2.0, 0.5]), 0.4
    v = velocity(ball, q, u, t)
    rate, rise = 1.2 + 0.7 * np.sin(0.8), 1.4 * np.cos(0.8)
    share = 0.1 / (0.1 + 2.0 * 0.09)
    expected = share * np.array([-rise * q[1] - rate * v[1], rise * q[0] + rate * v[0]])
    found = acceleration(ball, key, q, v, t)
    assert np.abs(found.vdot[:2] - expected).max() < 1e-13
    if found.multipliers is not None:
        # What the table does to the ball is what it takes to accelerate it, at the rate -λᵀ b.
        assert np.abs(found.multipliers - 2.0 * expected).max() < 1e-13
        at = Evaluation(ball, q, v, t)
        power = v @ (at.terms.M @ found.vdot + at.terms.B)
        assert abs(power + found.multipliers @ at.terms.b) < 1e-13


def test_a_ball_that_rests_on_a_steady_table_stays_where_it_is_and_on_a_swinging_one_does_not():
    start = {"start": (0.4, 0.1), "speed": (0.0, 0.0)}
    for extra, moves in (({}, False), ({"swing": 1.0, "frequency": 2.0}, True)):
        ball = TurntableBall(**start, **extra)
        motion = simulate(ball, "kane", 2.0, rtol=1e-11, atol=1e-11)
        assert (np.ptp(motion.q[:, :2], axis=0).max() > 1e-2) == moves
        assert (np.ptp(motion.q[:, :2], axis=0).max() < 1e-9) == (not moves)


def test_what_a_ball_does_not_need_is_absent():
    at = Evaluation(STEADY, *STEADY.initial_state())
    assert at.terms.Q is None
    assert at.bodies.gyroscopic is None
    assert at.bodies.force is None
    assert at.prepared.acceleration is None
    assert at.terms.b is not None
    assert at.speeds.offset is not None


def test_a_ball_whose_axis_of_spin_is_upright_has_no_generalized_speeds():
    q = np.array([0.0, 0.0, 0.0, np.pi / 2, 0.0])
    with pytest.raises(RefusedError, match="Euler's angles are singular"):
        velocity(STEADY, q, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": 0.0}, "mass = 0.0, expected a positive number"),
        ({"inertia": -1.0}, "inertia = -1.0, expected a positive number"),
        ({"swing": 1.0}, "swing = 1.0, frequency = None, expected both or none"),
        ({"start": 1.0}, r"start has shape \(\)"),
        ({"rate": np.nan}, "rate = nan, expected a finite number"),
    ],
)
def test_parameters_that_no_ball_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        TurntableBall(**change)
