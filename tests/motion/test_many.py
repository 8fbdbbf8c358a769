"""Many motions at once: those of `simulate`, the same bits however they are spread over lanes."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import eomcheck
from eomcheck import InputError, RefusedError, Trajectories, UnknownNameError, simulate_many
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import allowed_violation
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels import dop853
from eomcheck.lab.store.parallel_map import executor
from eomcheck.motion import batch
from eomcheck.scenes import SCENES, Snake

TOLERANCE = 1e-9
TIMES = (0.0, 0.1, 0.25, 0.3)
FIELDS = ("q", "v", "u", "energy", "constraint_residual", "right_hand_sides", "steps", "status")


def near(scene: eomcheck.scenes.Scene, m: int, seed: int = 0) -> np.ndarray:
    q, _ = scene.initial_state()
    return q + 0.1 * np.random.default_rng(seed).standard_normal((m, scene.n))


def assert_same(one: Trajectories, other: Trajectories, few: slice = slice(None)):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name)[few], getattr(other, name))
    assert list(one.reason[few]) == list(other.reason)


def assert_agrees(found: eomcheck.Trajectory, alone: eomcheck.Trajectory):
    assert found.status == alone.status == "finished", found.reason or alone.reason
    np.testing.assert_array_equal(found.times, alone.times)
    for name in ("q", "v", "energy"):
        x, y = getattr(found, name), getattr(alone, name)
        np.testing.assert_allclose(x, y, atol=100 * TOLERANCE * max(1.0, np.abs(y).max()))
    if alone.constraint_residual is not None:
        assert found.constraint_residual is not None
        difference = np.abs(found.constraint_residual - alone.constraint_residual)
        assert difference.max() <= 100 * TOLERANCE


@pytest.mark.sampled(6)
@pytest.mark.parametrize("links", [2, 3])
@pytest.mark.parametrize("key", FORMULATIONS)
def test_each_motion_is_that_of_simulate(key: str, links: int):
    soft = {"stiffness": [20.0, 20.0][: links - 1], "wheel_angle": [0.0, -0.8, 0.8][-links:]}
    scene = replace(Snake.pattern(links), **soft)
    q0, u0 = near(scene, 3), np.array([[0.3, 0.2], [0.0, 0.0], [-0.5, 0.1]])
    found = simulate_many(scene, key, 0.3, q0=q0, u0=u0, output_times=TIMES)
    for i in range(3):
        alone = eomcheck.simulate(scene, key, 0.3, q0=q0[i], u0=u0[i], output_times=TIMES)
        assert_agrees(found[i], alone)
        assert abs(found.steps[i] - alone.steps) <= 1


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", [name for name in SCENES if name != "snake"])
def test_kane_moves_every_other_scene_as_simulate_does(name: str):
    scene = SCENES[name].example()
    q, v = scene.initial_state()
    options = {"output_times": (0.05,), "rtol": TOLERANCE, "atol": TOLERANCE}
    found = simulate_many(scene, "kane", 0.05, q0=[q, q], v0=[v, v], **options)
    alone = eomcheck.simulate(scene, "kane", 0.05, q0=q, v0=v, **options)
    assert_agrees(found[1], alone)
    u = eomcheck.speeds_of(scene, q, v)
    np.testing.assert_allclose(
        found.u[0, -1], eomcheck.speeds_of(scene, alone.q[-1], alone.v[-1]), rtol=1e-6, atol=1e-6
    )
    again = simulate_many(scene, "kane", 0.05, q0=q[None], u0=u[None], **options)
    np.testing.assert_allclose(again.q[0], found.q[0], atol=100 * TOLERANCE)


@cache
def reference() -> tuple[Snake, np.ndarray, Trajectories]:
    scene = Snake.pattern(3)
    q0 = near(scene, 21)
    return scene, q0, simulate_many(scene, "kane", 0.3, q0=q0, output_times=TIMES)


@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize("key", ["kane", "im"])
@pytest.mark.sampled(2)
def test_bits_are_those_of_any_number_of_lanes(key: str, lanes: int):
    scene, q0, _ = reference()
    eight, other = (
        simulate_many(scene, key, 0.3, q0=q0[:5], output_times=TIMES, lanes=n) for n in (8, lanes)
    )
    assert_same(eight, other)


@pytest.mark.parametrize("few", [slice(0, 1), slice(0, 8), slice(3, 12), slice(20, 21)])
def test_bits_are_those_of_any_company(few: slice):
    scene, q0, whole = reference()
    assert_same(whole, simulate_many(scene, "kane", 0.3, q0=q0[few], output_times=TIMES), few)


@pytest.mark.night
def test_bits_are_those_of_any_executor():
    scene, q0, whole = reference()
    options = {"q0": q0, "output_times": TIMES}
    with ThreadPoolExecutor(2) as pool:
        assert_same(whole, simulate_many(scene, "kane", 0.3, **options, executor=pool))
    with executor("local:2") as pool:
        assert_same(whole, simulate_many(scene, "kane", 0.3, **options, executor=pool))


def test_each_motion_has_its_own_parameters():
    scene = Snake.pattern(3)
    stiffness, mass = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([[1.0, 2, 3], [2, 2, 2]])
    given = {"stiffness": stiffness, "mass": mass}
    found = simulate_many(scene, "gw", 0.3, parameters=given, output_times=TIMES)
    for i in range(2):
        other = replace(scene, stiffness=stiffness[i], mass=mass[i])
        assert_agrees(found[i], eomcheck.simulate(other, "gw", 0.3, output_times=TIMES))
        np.testing.assert_array_equal(found[i].scene.mass, mass[i])
    assert np.abs(found.q[0] - found.q[1]).max() > 1e-3


def test_a_pose_of_its_own_is_where_a_motion_starts():
    pose = np.array([[0.0, 0.1], [0.2, 0.3]])
    found = simulate_many(Snake.pattern(2), "kane", 0.1, parameters={"pose": pose})
    np.testing.assert_array_equal(found.q[:, 0, 2:], pose)


def test_a_refused_and_a_failing_motion_leave_the_good_ones_alone():
    scene = Snake.pattern(3)
    q, v = np.tile(scene.initial_state(), (5, 1, 1)).transpose(1, 0, 2)
    v[1, 0] = 1.0
    v[3] = eomcheck.velocity(scene, q[3], [1e200, 0.0])
    options = {"output_times": TIMES, "max_steps": 1000}
    found = simulate_many(scene, "em", 0.3, q0=q, v0=v, **options)
    assert list(found.status) == ["finished", "refused", "finished", "failed", "finished"]
    assert "v violates the constraint" in found.reason[1]
    assert "the right-hand side is not finite at t = 0 s" in found.reason[3]
    assert np.isnan(found.q[1]).all() and np.isnan(found.energy[1]).all()
    assert np.isfinite(found.q[3, 0]).all() and np.isnan(found.q[3, 1:]).all()
    assert (found[1].times.size, found[3].times.size, found.right_hand_sides[1]) == (0, 1, 0)
    alone = simulate_many(scene, "em", 0.3, q0=q[:1], v0=v[:1], **options)
    assert_same(found, alone, slice(0, 1))
    assert_same(found, alone, slice(4, 5))


@pytest.mark.parametrize("times", [0.2, 3.0])
def test_velocities_that_violate_the_constraints_are_refused_from_where_simulate_does(times: float):
    scene, q = SCENES["sleigh"].example(), np.array([0.0, 0.0, 0.1])
    v = eomcheck.velocity(scene, q, [1.0, 0.5])
    at = Evaluation(scene, q, v)
    v = v + np.linalg.pinv(at.terms.a) @ (times * allowed_violation(at))
    found = simulate_many(scene, "kane", 0.1, q0=[q], v0=[v], output_times=[0.1])
    if times < 1:
        assert found.status[0] == "finished"
        return
    with pytest.raises(InputError) as refused:
        eomcheck.simulate(scene, "kane", 0.1, q0=q, v0=v)
    assert (found.status[0], found.reason[0]) == ("refused", str(refused.value))


HUGE_LINK = Snake([1, 6], [1.3e7, 1], [0, 1], [100], [0.07371643262453738, 0.0737164326245372])
PARALLEL = {
    "exactly": (Snake.pattern(2), np.append(np.zeros(2), -Snake.pattern(2).wheel_angle)),
    "nearly": (HUGE_LINK, np.array([0, 0, -1.6402650350481838, -1.6402650350481836])),
    "all across": (replace(Snake.pattern(2), wheel_angle=[1.3e-17, 6.8e-19]), np.zeros(4)),
}


@pytest.mark.parametrize("key", ["em", "el", "kane"])
@pytest.mark.parametrize("how", PARALLEL)
def test_a_start_with_parallel_wheels_is_refused_as_an_acceleration_is(key: str, how: str):
    # Where wheels are parallel to rounding, a motion by em went on from there, and was wrong.
    scene, q = PARALLEL[how]
    found = simulate_many(scene, key, 0.1, q0=[q], v0=[np.zeros(4)], output_times=[0.1])
    if key == "kane":
        assert found.status[0] == "finished"
        return
    try:
        eomcheck.acceleration(scene, key, q, np.zeros(4))
    except RefusedError as refusal:
        assert (found.status[0], found.reason[0]) == ("refused", str(refusal))
    else:
        assert (key, how, found.status[0]) == ("el", "all across", "finished")


@pytest.mark.parametrize("key", ["kane", "im"])
def test_speeds_that_do_not_exist_are_refused_as_by_simulate(key: str):
    scene, u = Snake.pattern(3), np.ones(2)
    angle = np.array([scene.wheel_angle, [0.0, np.pi / 2, 0.0]])
    given = {"parameters": {"wheel_angle": angle}, "u0": [u, u], "output_times": (0.01,)}
    found = simulate_many(scene, key, 0.01, **given)
    assert list(found.status) == ["finished", "refused"]
    with pytest.raises(RefusedError) as refusal:
        eomcheck.simulate(replace(scene, wheel_angle=angle[1]), key, 0.01, u0=u)
    assert str(refusal.value) == found.reason[1]


@pytest.mark.parametrize("key", ["kane", "im", "em", "banded"])
@pytest.mark.parametrize("given", ["u0", "v0"])
@pytest.mark.sampled(2)
def test_a_start_in_doubt_is_looked_at_alone_and_is_the_same(key: str, given: str, monkeypatch):
    scene, q0, _ = reference()
    start = {"u0": np.full((3, 2), 0.2)}
    if given == "v0":
        start = {"v0": [eomcheck.velocity(scene, q, [0.2, 0.2]) for q in q0[:3]]}
    sure = simulate_many(scene, key, 0.1, q0=q0[:3], **start)
    examined = batch._checked_speeds

    def doubted(*given) -> tuple[np.ndarray, np.ndarray]:
        speeds, sound = examined(*given)
        assert sound.all()
        return np.zeros_like(speeds), ~sound

    monkeypatch.setattr(batch, "_checked_speeds", doubted)
    alone = simulate_many(scene, key, 0.1, q0=q0[:3], **start)
    np.testing.assert_allclose(sure.q, alone.q, atol=1e-12)
    np.testing.assert_array_equal(sure.steps, alone.steps)


def test_too_many_steps_are_said_and_what_was_reached_is_kept():
    scene, q0, whole = reference()
    times = np.linspace(0.0, 0.3, 31)
    found = simulate_many(scene, "kane", 0.3, q0=q0, output_times=times, max_steps=5)
    assert set(found.status) == {"failed"} and set(found.steps) == {5}
    one = found[0]
    assert "5 steps do not reach the end, only t = " in one.reason
    assert 0 < one.times.size < 31
    reached = float(one.reason.split("= ")[-1].split()[0])
    assert one.times[-1] <= reached < times[one.times.size]
    free = simulate_many(scene, "kane", 0.3, q0=q0, output_times=TIMES, max_steps=0)
    assert_same(whole, free)


def test_outputs_are_101_even_times_unless_asked_for():
    scene, q0, _ = reference()
    found = simulate_many(scene, "kane", 0.3, q0=q0[:2])
    np.testing.assert_array_equal(found.t, np.linspace(0.0, 0.3, 101))
    assert (found.q.shape, found.u.shape) == ((2, 101, scene.n), (2, 101, 2))
    assert found.constraint_residual is not None
    assert found.constraint_residual.shape == (2, 101, scene.r)
    assert found.constraint_residual.any() and (found.constraint_residual >= 0).all()
    np.testing.assert_array_equal(found.q[:, 0], q0[:2])


def test_other_output_times_change_no_step():
    scene, q0, whole = reference()
    few = simulate_many(scene, "kane", 0.3, q0=q0, output_times=(0.3,))
    np.testing.assert_array_equal(few.q[:, 0], whole.q[:, -1])
    np.testing.assert_array_equal(few.steps, whole.steps)
    assert (few.right_hand_sides < whole.right_hand_sides).all()


def test_without_constraints_there_is_no_residual():
    scene = SCENES["chain-pendulum"].example()
    found = simulate_many(scene, "kane", 0.1, q0=near(scene, 2))
    assert found.constraint_residual is None and found[0].constraint_residual is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "none of q0, v0, u0 and parameters tells how many motions there are"),
        ({"q0": np.zeros(5)}, r"q0 has shape \(5, 5\)|q0 has shape \(5,\)"),
        ({"q0": 1.0}, "q0 = 1.0, expected an array with an entry for each motion"),
        ({"q0": np.zeros((0, 5))}, "expected an array with an entry for each motion"),
        ({"q0": np.zeros((2, 4))}, r"q0 has shape \(2, 4\), expected \(2, 5\)"),
        ({"q0": np.full((2, 5), np.nan)}, r"q0\[0, 0\] = nan"),
        ({"q0": np.zeros((2, 5)), "u0": np.zeros((3, 2))}, "u0 is given for 3 motions, q0 for 2"),
        ({"u0": np.zeros((2, 2)), "v0": np.zeros((2, 5))}, "v0 and u0 are both given"),
        ({"u0": np.zeros((2, 3))}, r"u0 has shape \(2, 3\), expected \(2, 2\)"),
        ({"u0": [[1.0], [1.0, 2.0]]}, "u0 = "),
        ({"parameters": {"weight": np.ones(2)}}, "unknown parameter 'weight'; known: mass"),
        ({"parameters": {"mass": [[1.0] * 3, [-1.0] * 3]}}, "motion 1: mass"),
        ({"parameters": {"mass": np.ones((2, 2))}}, "motion 0: "),
        ({"parameters": {"damping": np.ones((2, 2))}}, "motion 0: .* has other terms or sizes"),
        ({"u0": np.zeros((1, 2)), "lanes": 3}, "lanes = 3, expected 1, 2, 4 or 8"),
        ({"u0": np.zeros((1, 2)), "executor": "local"}, "executor = 'local', expected one"),
        ({"u0": np.zeros((1, 2)), "rtol": 0.0}, "rtol = 0.0, expected a positive number"),
        ({"u0": np.zeros((1, 2)), "max_steps": -1}, "max_steps = -1"),
        ({"u0": np.zeros((1, 2)), "output_times": (0.0, 2.0)}, "output_times must rise"),
    ],
)
def test_what_is_not_valid_is_said(options: dict, message: str):
    with pytest.raises(InputError, match=message):
        simulate_many(Snake.pattern(3), "kane", 1.0, **options)


def test_names_must_be_known():
    with pytest.raises(UnknownNameError):
        simulate_many(Snake.pattern(3), "newton", 1.0, u0=np.zeros((1, 2)))
    with pytest.raises(IndexError):
        reference()[2][21]
    assert len(reference()[2]) == len(list(reference()[2])) == 21


# ---- The command ---------------------------------------------------------------------------------


def command(*options: str):
    from eomcheck.cli import app

    return CliRunner().invoke(app, ["simulate", "pattern", "0.05", "--links", "3", *options])


@pytest.mark.night
def test_the_command_prints_and_draws_how_far_motions_are_apart(tmp_path: Path):
    plot = tmp_path / "spread.png"
    shown = command("--examples", "12", "--scale", "0.1", "--plot", str(plot))
    assert shown.exit_code == 0, shown.output
    for text in ("kane, t = 0.05 s", "θ_3 / rad", "median", "energy error / J", "12 finished"):
        assert text in shown.output
    assert plot.stat().st_size > 10_000
    assert "x / m" in command("--examples", "12", "--seed", "1", "--formulation", "gw").output


def test_draws_that_fail_are_counted_and_the_exit_code_tells():
    shown = command("--examples", "3", "--max-steps", "2")
    assert shown.exit_code == 1
    assert "3 motions: 3 failed" in shown.output
    assert "motion 2 failed: 2 steps do not reach the end" in shown.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--examples", "0"], "examples = 0, expected a whole number of at least 1"),
        (["--examples", "2", "--scale", "-1"], "scale = -1"),
        (
            ["--examples", "2", "--integrator", "Radau"],
            "integrated by DOP853, without stabilization",
        ),
        (
            ["--examples", "2", "--formulation", "im", "--formulation", "el"],
            "expected one for --examples",
        ),
        (["--examples", "2", "--plot", "no/such/x.png"], "does not exist"),
        (["--examples", "2", "--executor", "moon"], "executor = 'moon'"),
    ],
)
def test_draws_say_what_does_not_go_with_them(options: list[str], message: str):
    shown = command(*options)
    assert isinstance(shown.exception, InputError)
    assert message in str(shown.exception)


# ---- The integrator by itself --------------------------------------------------------------------

RATES = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


def integrated(
    rates: Callable, y0: np.ndarray, t_end: float, times=(), rtol: float = 1e-9, most: float = 1e6
):
    """Return the last states, the record, and the states at `times` of a right-hand side (t, y)."""
    size, width = y0.shape
    view = np.ctypeslib.as_array

    @RATES
    def function(out, t, y, block):
        t, y, out = (
            view(ctypes.cast(x, ctypes.POINTER(ctypes.c_double)), shape)
            for x, shape in ((t, (width,)), (y, y0.shape), (out, y0.shape))
        )
        with np.errstate(all="ignore"):
            out[:] = rates(t, y)

    y, record = np.array(y0, float), np.zeros((dop853.FIELDS, width))
    times = np.append(times, np.inf)
    record[dop853.DUE] = times[0]
    out, room = np.zeros((len(times), *y0.shape)), np.zeros((dop853.ROWS, *y0.shape))
    address = ctypes.cast(function, ctypes.c_void_p).value
    dop853.dop853(width)(
        *(address, 0, size, y.ctypes.data, record.ctypes.data, t_end, rtol, rtol, most),
        *(times.ctypes.data, out.ctypes.data, room.ctypes.data),
    )
    return y, record, out[:-1]


def oscillator(t, y):
    return np.array([y[1], (1.0 - y[0] ** 2) * y[1] - y[0] + np.cos(t)])


def test_every_lane_takes_the_steps_of_scipy():
    y0 = np.array([[0.1, 2.0, -1.0, 0.0], [0.0, 0.0, 3.0, 0.0]])
    times = np.linspace(0.3, 5.0, 14)
    y, record, out = integrated(oscillator, y0, 5.0, times)
    for lane in range(4):
        alone = solve_ivp(oscillator, (0, 5), y0[:, lane], "DOP853", rtol=1e-9, atol=1e-9)
        assert record[dop853.STEPS, lane] == alone.t.size - 1
        np.testing.assert_allclose(y[:, lane], alone.y[:, -1], rtol=1e-10)
        options = {"rtol": 1e-9, "atol": 1e-9, "t_eval": times}
        alone = solve_ivp(oscillator, (0, 5), y0[:, lane], "DOP853", **options)
        np.testing.assert_allclose(out[:, :, lane].T, alone.y, rtol=1e-9, atol=1e-10)
        assert record[dop853.CALLS, lane] == alone.nfev
    np.testing.assert_allclose(out[-1], y, rtol=1e-14)


def test_a_lane_that_blows_up_fails_where_it_does_and_the_others_go_on():
    y0 = np.array([[0.5, 2.0, -1.0, 1.25]])
    y, record, _ = integrated(lambda t, y: y * y, y0, 1.0)
    assert record[dop853.STATUS].tolist() == [1, 2, 1, 2]
    np.testing.assert_allclose(record[dop853.T], [1.0, 0.5, 1.0, 0.8], rtol=1e-8)
    np.testing.assert_allclose(y[0, [0, 2]], [1.0, -0.5], rtol=1e-8)


def test_a_lane_with_a_right_hand_side_that_stops_fails_there():
    def until(t, y):
        return np.where(t[None] > y[:1], np.nan, 0.0 * y)

    y, record, _ = integrated(until, np.array([[0.5, 2.0, 0.0, -1.0]]), 1.0)
    assert record[dop853.STATUS].tolist() == [2, 1, 2, 4]
    assert 0.5 * (1 - 1e-14) < record[dop853.T, 0] <= 0.5
    np.testing.assert_array_equal(y[0], [0.5, 2.0, 0.0, -1.0])


def test_the_integrator_is_short_and_one_serves_right_hand_sides_of_any_size():
    assert len(dop853._Writer(8).text().splitlines()) < 2500
    assert dop853.dop853(8) is dop853.dop853(8)
