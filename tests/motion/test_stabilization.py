"""Feedback and projection: what they keep, what they cost, and where they do not apply."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from eomcheck.cli import app
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.formulations.banded import joint_gaps
from eomcheck.motion import stabilization
from eomcheck.motion.reference_solution import constraint_error
from eomcheck.motion.simulate import Motion, simulate
from eomcheck.motion.stabilization import drift_with_feedback, project_speeds
from eomcheck.numbers.counting import Counting
from eomcheck.scenes import Snake

ONE = np.ones(3)
SOFT = Snake(ONE, ONE, ONE / 12, 20.0 * ONE[1:], [0.1, 0.2, 0.3])
Q = np.array([0.0, 0.0, 0.1, 0.5, 1.0])
U = np.array([1.0, 0.5])
DRIFTING = [key for key, f in FORMULATIONS.items() if f.level == "acceleration"]
drifting = pytest.mark.parametrize("key", DRIFTING)
OFF = np.array([0.1, -0.2, 0.3, 0.1, -0.4])


def run(key: str, **remedy):
    return simulate(SOFT, key, 4.0, rtol=1e-6, atol=1e-6, q0=Q, u0=U, **remedy)


def test_feedback_is_of_the_whole_residual():
    a, v = np.array([[1.0, 2.0]]), np.array([3.0, 4.0])
    gamma, b = np.array([0.5]), np.array([-1.0])
    assert drift_with_feedback(a, gamma, b, v, 2.0).tolist() == [0.5 + 2.0 * (11.0 - 1.0)]
    assert drift_with_feedback(a, gamma, None, v, 2.0).tolist() == [0.5 + 2.0 * 11.0]
    assert drift_with_feedback(a, gamma, b, v, None) is gamma


@drifting
def test_feedback_lets_a_violation_die_away_at_its_rate(key: str):
    scene, rate = SOFT, 3.0
    motion = Motion(scene, FORMULATIONS[key], Q, velocity(scene, Q, U), baumgarte=rate)
    n = scene.n
    at_rest = slice(n, n + motion.speeds)
    motion.y0[at_rest] += np.resize(OFF, motion.speeds)

    def c(y: np.ndarray) -> np.ndarray:
        if FORMULATIONS[key].uses == "chain":
            at = Evaluation(scene, y[:n], np.zeros(n))
            at.x = y[at_rest]
            # Vectors in the plane, given along axes that turn.
            gaps = joint_gaps(at.chain.before, at.chain.after, y[at_rest])
            return np.linalg.norm(gaps, axis=1)
        a = Evaluation(scene, y[:n], y[at_rest]).terms.a
        return a @ y[at_rest]

    found = motion.solve(1.0, rtol=1e-11, atol=1e-11)
    assert np.allclose(c(found.y[-1]), np.exp(-rate) * c(motion.y0), atol=1e-8)
    assert np.abs(c(motion.y0)).max() > 0.1


@pytest.mark.sampled(6)
@drifting
def test_both_remedies_end_nearer_to_the_constraints_and_come_to_the_same_end(key: str):
    plain, fed, cast = run(key), run(key, baumgarte=20.0), run(key, projection=0.1)
    assert {x.status for x in (plain, fed, cast)} == {"finished"}
    drift = constraint_error(plain)[-1]
    assert constraint_error(fed)[-1] < drift
    assert constraint_error(cast)[-1] < 1e-13
    for one in (fed, cast):
        assert np.abs(one.q[-1] - plain.q[-1]).max() < 1e-3
    assert (fed.baumgarte, fed.projection) == (20.0, None)
    assert (cast.baumgarte, cast.projection) == (None, 0.1)


@drifting
def test_a_projection_satisfies_the_constraints_by_the_change_of_least_kinetic_energy(key: str):
    formulation = FORMULATIONS[key]
    at = Evaluation(SOFT, Q, velocity(SOFT, Q, U))
    if formulation.uses == "chain":
        x = np.arange(1.0, 7.0)
        mass = np.diag(at.chain.mass)
        new = project_speeds(SOFT, formulation, at.partition, 0.0, Q, x)
        c = joint_gaps(at.chain.before, at.chain.after, new)
    else:
        x, mass = OFF, at.terms.M
        new = project_speeds(SOFT, formulation, at.partition, 0.0, Q, x)
        c = at.terms.a @ new
    change = new - x
    assert np.abs(c).max() < 1e-13
    assert abs(new @ mass @ change) < 1e-13
    before, after, lost = (y @ mass @ y / 2 for y in (x, new, change))
    assert before - after == pytest.approx(lost, rel=1e-12)
    assert np.allclose(
        project_speeds(SOFT, formulation, at.partition, 0.0, Q, new), new, atol=1e-14
    )


def test_a_projection_that_does_not_project_is_noticed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        stabilization, "drift_with_feedback", lambda a, gamma, b, v, rate: -rate * (a @ v)
    )
    at = Evaluation(SOFT, Q, OFF)
    new = project_speeds(SOFT, FORMULATIONS["au"], at.partition, 0.0, Q, OFF)
    assert np.abs(at.terms.a @ new).max() > 0.1


def test_output_times_and_steps_are_those_of_one_motion_in_however_many_pieces():
    times = [0.0, 0.05, 0.1, 0.25, 0.4]
    whole = simulate(SOFT, "au", 0.4, rtol=1e-10, atol=1e-10, q0=Q, u0=U, output_times=times)
    parts = simulate(
        *(SOFT, "au", 0.4), rtol=1e-10, atol=1e-10, q0=Q, u0=U, output_times=times, projection=0.1
    )
    assert parts.times.tolist() == times
    assert np.abs(parts.q - whole.q).max() < 1e-8
    every = simulate(SOFT, "au", 0.4, q0=Q, u0=U, projection=0.15)
    assert (np.diff(every.times) > 0).all() and every.times[[0, -1]].tolist() == [0.0, 0.4]
    assert every.steps == every.times.size - 1


def test_a_projected_motion_gives_up_after_its_steps_as_a_whole():
    found = simulate(SOFT, "au", 4.0, q0=Q, u0=U, projection=0.1, max_steps=20)
    assert found.status == "failed" and found.steps <= 21
    assert found.times[-1] < 4.0


def test_feedback_costs_nothing_where_there_is_none():
    counting = Counting()
    gamma = counting.vector(3)
    a, v = counting.vector(15).reshape(3, 5), counting.vector(5)
    assert drift_with_feedback(a, gamma, None, v, None) is gamma
    assert counting.tally.additions == counting.tally.multiplications == 0
    drift_with_feedback(a, gamma, None, v, counting.vector(1)[0])
    assert counting.tally.multiplications == 15 + 3


@pytest.mark.parametrize("key", [key for key in FORMULATIONS if key not in DRIFTING])
@pytest.mark.parametrize("remedy", ["baumgarte", "projection"])
def test_a_formulation_that_cannot_drift_refuses_both(key: str, remedy: str):
    with pytest.raises(InputError, match=f"{remedy} = 1.0 does not apply to {key}"):
        run(key, **{remedy: 1.0})


@pytest.mark.parametrize("remedy", ["baumgarte", "projection"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), True, "1"])
def test_a_rate_or_interval_that_is_not_positive_is_refused(remedy: str, value):
    with pytest.raises(InputError, match=f"{remedy} = "):
        run("au", **{remedy: value})


def test_the_command_line_simulates_with_either_and_says_where_it_does_not_apply():
    def said(*options: str):
        return CliRunner().invoke(app, ["simulate", "coil", "0.02", "--links", "3", *options])

    good = said("--formulation", "au", "--baumgarte", "10", "--projection", "0.01")
    assert good.exit_code == 0 and "energy error" in good.stdout
    damped = said("--formulation", "au", "--set", "damping=5", "--set", "stiffness=100")
    assert damped.exit_code == 0 and "dampers in the joints take it" in damped.stdout
    wrong = said("--formulation", "kane", "--baumgarte", "10")
    assert isinstance(wrong.exception, InputError)
    given_up = said("--formulation", "kane", "--max-steps", "1")
    assert given_up.exit_code == 1 and "failed" in given_up.stdout
