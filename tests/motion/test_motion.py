"""Motions: every formulation on its own state, in machine code end to end."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from eomcheck.errors import InconsistentVelocityError, InputError, RefusedError, UnknownNameError
from eomcheck.evaluation.dynamics import acceleration, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.integrators import INTEGRATORS
from eomcheck.motion.simulate import MOST_CHECKED_STATES, Motion, simulate
from eomcheck.scenes import Snake

keys = pytest.mark.parametrize("key", FORMULATIONS)
integrators = pytest.mark.parametrize("integrator", INTEGRATORS)

PAPER = Snake.paper()
ONE = np.ones(3)
SOFT = Snake(ONE, ONE, ONE / 12, 20.0 * ONE[1:], [0.1, 0.2, 0.3])
Q = np.array([0.0, 0.0, 0.1, 0.5, 1.0])
U = np.array([1.0, 0.5])
STRAIGHT = Snake(ONE, ONE, ONE / 12, None, 0 * ONE)


def motion(key: str, scene: Snake = SOFT, q=Q, u=U) -> Motion:
    return Motion(scene, FORMULATIONS[key], q, velocity(scene, q, u), np.asarray(u))


@pytest.mark.sampled(3)
@keys
@pytest.mark.parametrize("springs", [True, False])
def test_the_right_hand_side_gives_the_rates_of_the_public_acceleration(key: str, springs: bool):
    scene = SOFT if springs else Snake(ONE, 2 * ONE, ONE, None, [0.1, -0.2, 0.3])
    m = motion(key, scene)
    rates = m.rates(0.0, m.y0)
    v = velocity(scene, Q, U)
    expected = acceleration(scene, key, Q, v)
    tolerance = 4 * expected.error_bound
    assert np.abs(rates[:5] - v).max() < 1e-13
    found = rates[5 : 5 + m.speeds]
    if m.formulation.state == "q, u":
        at = Evaluation(scene, Q, v)
        assert np.abs(at.speeds.W @ found + at.speeds.rest - expected.vdot).max() <= tolerance
    elif m.formulation.state == "q, v2":
        assert np.abs(found - expected.vdot[m.partition.independent]).max() <= tolerance
    elif m.formulation.state == "q, x":
        at, x = Evaluation(scene, Q, v), m.y0[5:]
        vdot = at.call(scene.chain_acceleration, at.parameters, at.prepared, x, found)
        assert np.abs(vdot - expected.vdot).max() <= tolerance
    else:
        assert np.abs(found - expected.vdot).max() <= tolerance
    if m.formulation.state == "q, v, μ":
        assert np.allclose(rates[-3:], expected.multipliers, rtol=1e-10)


@keys
def test_each_formulation_integrates_its_own_state(key: str):
    sizes = {"q, v, μ": 5 + 5 + 3, "q, v": 5 + 5, "q, v2": 5 + 2, "q, u": 5 + 2}
    sizes["q, x"] = 5 + 2 * 3
    m = motion(key)
    assert m.y0.size == m.rates(0.0, m.y0).size == sizes[m.formulation.state]
    q, v = m.split(m.y0)
    assert np.array_equal(q, Q)
    assert np.allclose(v, velocity(SOFT, Q, U), rtol=1e-14, atol=1e-14)


@pytest.mark.sampled(3)
@keys
def test_scipy_with_the_same_right_hand_side_comes_to_the_same_end(key: str):
    m = motion(key)
    ours = simulate(SOFT, key, 1.0, rtol=1e-10, atol=1e-10, q0=Q, u0=U, output_times=[1.0])
    theirs = solve_ivp(m.rates, (0.0, 1.0), m.y0, "DOP853", rtol=1e-10, atol=1e-10)
    q, v = m.split(theirs.y[:, -1])
    assert ours.status == "finished"
    assert np.abs(ours.q[-1] - q).max() < 1e-8
    assert np.abs(ours.v[-1] - v).max() < 1e-8


@integrators
@pytest.mark.sampled(2)
def test_every_integrator_keeps_energy_and_agrees_with_the_others(integrator: str):
    found = simulate(SOFT, "kane", 1.0, rtol=1e-9, atol=1e-9, integrator=integrator, q0=Q, u0=U)
    reference = simulate(SOFT, "kane", 1.0, rtol=1e-13, atol=1e-13, q0=Q, u0=U)
    assert (found.status, found.reason, found.integrator) == ("finished", "", integrator)
    assert found.times[0] == 0.0 and found.times[-1] == 1.0
    assert found.steps > 5 and found.right_hand_sides >= found.steps
    assert np.abs(found.q[-1] - reference.q[-1]).max() < 1e-5
    assert np.abs(found.energy / found.energy[0] - 1).max() < 1e-5
    assert np.abs(found.constraint_residual).max() < 1e-12


@keys
def test_trajectories_carry_what_the_formulation_has(key: str):
    times = [0.0, 0.25, 0.5]
    found = simulate(SOFT, key, 0.5, q0=Q, u0=U, output_times=times)
    assert found.times.tolist() == times
    assert found.q.shape == found.v.shape == (3, 5)
    assert found.energy.shape == (3,)
    assert found.constraint_residual.shape == (3, 3)
    assert (found.constraint_residual >= 0).all()
    assert (found.multipliers is not None) == FORMULATIONS[key].multipliers
    if found.multipliers is not None:
        at = acceleration(SOFT, key, found.q[1], found.v[1], consistent=False)
        assert np.allclose(found.multipliers[1], at.multipliers, rtol=1e-12)
    assert np.allclose(found.v[0], velocity(SOFT, Q, U), atol=1e-14)


@pytest.mark.parametrize("key", [k for k, f in FORMULATIONS.items() if f.partitioned])
@pytest.mark.parametrize("integrator", ["DOP853", "BDF", "LSODA", "Radau"])
def test_a_matrix_that_becomes_singular_stops_the_run_and_is_named(key: str, integrator: str):
    found = simulate(
        STRAIGHT, key, 1.0, integrator=integrator, q0=np.zeros(5), u0=[1.0, 0.0], max_steps=10_000
    )
    assert found.status == "failed"
    assert "at t = 0 s" in found.reason
    matrix = {"el": "a'T", "em": "a_1"}[key]
    assert f"matrix {matrix} is singular to working precision" in found.reason
    assert np.isfinite(found.q).all() and np.isfinite(found.v).all()
    assert found.refusal is not None and found.refusal.what == matrix


@pytest.mark.parametrize("key", ["ml", "kane"])
@pytest.mark.night
def test_a_matrix_that_is_singular_to_rounding_only_stops_the_run_as_well(key: str):
    """Machine code sees no more than zeros: M_Kane of 60 links has none."""
    scene = Snake.pattern(60)
    q, _ = scene.initial_state()
    found = simulate(scene, key, 1e-3, q0=q, max_steps=100)
    assert found.status == "failed"
    assert isinstance(found.refusal, RefusedError)
    assert found.refusal.what == {"ml": "M_ML", "kane": "M_Kane"}[key]
    assert found.reason.startswith("the state at t = 0 s is refused: the 2 x 2 matrix")
    assert f"{found.refusal.rcond:.2g}" in found.reason
    assert found.times.size == 0


@keys
def test_a_motion_tells_how_far_to_trust_its_rates(key: str):
    found = simulate(SOFT, key, 0.1, q0=Q, u0=U)
    assert found.refusal is None
    assert set(found.rcond) == set(acceleration(SOFT, key, Q, velocity(SOFT, Q, U)).rcond)
    assert all(1e-6 < rcond <= 1 for rcond in found.rcond.values())
    assert 0 < found.rate_error < 1e-9


@keys
def test_integrals_of_multipliers_start_at_0(key: str):
    one = motion(key)
    assert not one.y0[SOFT.n + one.speeds :].any()


@pytest.mark.parametrize("u", [[1.0, -2.0], [-1.0, -0.5]], ids=["in between", "the last"])
def test_a_motion_tells_the_worst_of_the_states_looked_at(u: list[float]):
    found = simulate(SOFT, "el", 1.0, q0=Q, u0=u, rtol=1e-6, atol=1e-6)
    assert len(found.times) < MOST_CHECKED_STATES
    each = [
        acceleration(SOFT, "el", q, v, consistent=False)
        for q, v in zip(found.q, found.v, strict=True)
    ]
    for name, rcond in found.rcond.items():
        assert rcond == min(one.rcond[name] for one in each)
    relative = [one.error_bound / np.abs(one.vdot).max() for one in each]
    worst = min(range(len(each)), key=lambda i: min(each[i].rcond.values()))
    assert found.rate_error == max(relative[0], relative[worst], relative[-1])
    assert found.rate_error > 1.1 * relative[0]


@pytest.mark.night
def test_rates_that_rounding_spoils_show():
    scene = Snake.pattern(45)
    q, _ = scene.initial_state()
    found = simulate(scene, "kane", 1e-4, q0=q, max_steps=100)
    assert found.rate_error > 1e-6
    assert simulate(scene, "au", 1e-4, q0=q, max_steps=100).rate_error < 1e-8


@pytest.mark.parametrize("speed", [1e150, 1e160, 1e250])
def test_a_motion_too_fast_for_doubles_is_refused_or_failed_and_never_not_finite(speed: float):
    for key in ("au", "em", "kane"):
        try:
            found = simulate(SOFT, key, 1e-3, q0=Q, u0=speed * U, max_steps=50)
        except RefusedError:
            continue
        assert found.status == "failed"
        assert found.reason
        for part in (found.q, found.v, found.energy, found.constraint_residual):
            assert np.isfinite(part).all()


def test_a_run_that_is_given_too_few_steps_says_so():
    found = simulate(PAPER, "kane", 1.0, rtol=1e-10, atol=1e-10, max_steps=10)
    assert found.status == "failed"
    assert "step" in found.reason.lower()
    assert 0 < found.times.size <= 12


def test_a_trajectory_starts_in_the_scene_s_own_state_at_rest():
    found = simulate(PAPER, "kane", 0.01)
    q, v = PAPER.initial_state()
    assert np.array_equal(found.q[0], q)
    assert np.array_equal(found.v[0], v)
    assert found.energy[0] == pytest.approx(8847.744025, abs=1e-5)


def test_parameters_of_a_motion_stay_where_machine_code_reads_them():
    motions = [
        motion("kane", Snake.coil(links), Snake.coil(links).initial_state()[0])
        for links in (2, 3, 4, 3, 2)
    ]
    rates = [m.rates(0.0, m.y0) for m in motions]
    assert np.array_equal(rates[0], rates[-1])
    assert np.array_equal(rates[1], rates[-2])


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        ({"key": "newton"}, UnknownNameError, "unknown formulation 'newton'"),
        ({"integrator": "Euler"}, UnknownNameError, "unknown integrator 'Euler'; known: RK45"),
        ({"t_end": 0.0}, InputError, "t_end = 0.0"),
        ({"t_end": math.nan}, InputError, "t_end = nan"),
        ({"rtol": -1e-3}, InputError, "rtol = -0.001"),
        ({"atol": "tight"}, InputError, "atol = 'tight'"),
        ({"max_step": 0.0}, InputError, "max_step = 0.0"),
        ({"first_step": 2.0}, InputError, "first_step = 2.0"),
        ({"max_steps": 1.5}, InputError, "max_steps = 1.5"),
        ({"output_times": [0.5, 0.2]}, InputError, r"output_times must rise within \[0, 1.0\]"),
        ({"output_times": [0.5, 2.0]}, InputError, r"output_times must rise within \[0, 1.0\]"),
        ({"output_times": []}, InputError, "output_times must rise"),
        ({"q0": [0.0]}, InputError, r"q has shape \(1,\)"),
        ({"u0": [0.0]}, InputError, r"u0 has shape \(1,\)"),
        ({"u0": U, "v0": np.zeros(5)}, InputError, "v0 and u0 are both given"),
        ({"v0": np.ones(5)}, InconsistentVelocityError, "violates the constraint"),
    ],
)
def test_bad_input_is_named(change: dict, error: type, says: str):
    arguments = {"key": "kane", "t_end": 1.0, "q0": Q} | change
    with pytest.raises(error, match=says):
        simulate(SOFT, **arguments)


def test_a_wheel_across_its_link_is_refused_by_those_with_generalized_speeds():
    scene = Snake(ONE, ONE, ONE, None, [0.0, math.pi / 2, 0.0])
    with pytest.raises(RefusedError, match=r"wheel_angle\[1\]"):
        simulate(scene, "kane", 1.0, q0=Q)
    assert simulate(scene, "au", 0.1, q0=Q).status == "finished"
