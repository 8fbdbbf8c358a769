"""Counts, steps, reasons and drifts of motions, each held against numbers known before."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np
import pytest

from eomcheck.evaluation.doubles import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab import reference_cases, reference_runs
from eomcheck.lab.fuzzing.motion_rounds import CROSSED, STOPPED, told
from eomcheck.motion import reference
from eomcheck.motion.many import OUTPUTS, simulate_many
from eomcheck.motion.right_hand_side import RightHandSide
from eomcheck.motion.run import Run
from eomcheck.motion.simulate import simulate
from eomcheck.motion.state import state_of
from eomcheck.scenes import Sleigh, Snake

SLEIGH, LONG = Sleigh.example(), Snake.coil(12)


@pytest.mark.parametrize("key", ["kane", "el", "im"])
def test_right_hand_sides_that_are_not_finite_are_counted_where_code_has_loops(key: str):
    rates = RightHandSide(LONG, FORMULATIONS[key])
    at = Evaluation(LONG, *LONG.initial_state())
    y = state_of(at, FORMULATIONS[key])
    for t, bad in ((0.25, 0.0), (0.5, np.nan), (0.75, np.inf)):
        rates(t, y + bad)
    assert (rates.calls, rates.failed, rates.failure_time) == (3, 2, 0.5)


# ---- Steps ---------------------------------------------------------------------------------------


def test_no_step_is_longer_than_the_longest_and_the_first_is_the_one_asked_for():
    start: dict[str, Any] = {"u0": np.array([1.0, 0.5])}
    free = simulate(SLEIGH, "kane", 1.0, **start)
    found = simulate(SLEIGH, "kane", 1.0, max_step=0.01, **start)
    assert np.diff(free.times).max() > 0.02
    assert np.diff(found.times).max() <= 0.01 * (1 + 1e-9)
    assert found.steps >= 100 > free.steps
    found = simulate(SLEIGH, "kane", 1.0, first_step=1e-3, **start)
    assert found.times[1] == pytest.approx(1e-3)
    assert np.diff(free.times)[0] != pytest.approx(1e-3)


def test_effort_is_counted_in_steps_and_in_right_hand_sides():
    found = simulate(SLEIGH, "kane", 1.0, integrator="RK45", u0=np.array([1.0, 0.5]))
    assert found.steps == len(found.times) - 1
    assert found.right_hand_sides >= 6 * found.steps  # stages of a step


@pytest.mark.parametrize("many", [False, True])
def test_absolute_and_relative_tolerances_are_each_their_own(many: bool):
    def steps(**tolerances: float) -> int:
        how: dict[str, Any] = {"rtol": 1e-6, "atol": 1e-6} | tolerances
        u0 = np.array([1.0, 0.5])
        if many:
            return int(simulate_many(SLEIGH, "kane", 20.0, u0=u0[None], **how).steps[0])
        return simulate(SLEIGH, "kane", 20.0, u0=u0, **how).steps

    assert steps() < steps(rtol=1e-12, atol=1e-12)
    assert steps() < steps(rtol=1e-12, atol=1e-7) < steps(rtol=1e-12, atol=1e-12)
    assert steps() < steps(rtol=1e-7, atol=1e-12) < steps(rtol=1e-12, atol=1e-12)


# ---- Energies that overflow ----------------------------------------------------------------------


def test_a_motion_whose_energy_overflows_failed_and_says_so():
    fast = np.array([1e160, 0.0])  # straight on: all rates are 0
    found = simulate(SLEIGH, "kane", 1e-3, u0=fast)
    assert (found.status, found.reason) == ("failed", "the energy overflows")
    assert found.times.size == 0
    many = simulate_many(SLEIGH, "kane", 1e-3, u0=np.array([fast, [1.0, 0.5]]))
    assert many.status.tolist() == ["failed", "finished"]
    assert many.reason.tolist() == ["the energy overflows", ""]


def test_of_many_motions_each_has_its_own_counts_and_its_share_of_the_time():
    u0 = np.array([[1e-3, 0.0], [1.0, 5.0], [0.0, 0.0]])
    found = simulate_many(SLEIGH, "kane", 5.0, u0=u0, lanes=1)
    assert found.t.size == OUTPUTS and len(set(found.steps.tolist())) > 1
    for i in range(3):
        one = found[i]
        assert (one.steps, one.right_hand_sides) == (found.steps[i], found.right_hand_sides[i])
        assert one.seconds == found.seconds / 3
        assert (one.energy == found.energy[i]).all()


# ---- References ----------------------------------------------------------------------------------


def test_energy_drifts_by_the_largest_change_at_any_step():
    assert reference._drift([2.0, 5.0, 1.0, 2.0]) == 1.5
    assert reference._drift([0.0, -0.25, 0.125]) == 0.25


@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_velocity_violates_by_its_worst_constraint(row: int):
    c = np.where(np.arange(3) == row, -3.0, 0.5)
    scene: Any = SimpleNamespace(constraint=lambda *here: [flint.arb(x) for x in c])
    at: Any = SimpleNamespace(
        parameters=None, prepared=None, q=None, v=[flint.arb(-5), flint.arb(2)]
    )
    assert reference._violation(scene, at) == 0.5


class Taylor:
    """An integrator of Taylor series that takes steps of half a second where it may."""

    def __init__(self) -> None:
        self.time, self.limits, self.state = 0.0, list[float](), np.zeros(1)

    def step(self, max_delta_t: float, write_tc: bool) -> tuple[str, float]:
        self.limits.append(max_delta_t)
        self.time += min(0.5, max_delta_t)
        return "success", min(0.5, max_delta_t)

    def update_d_output(self, t: float) -> np.ndarray:
        return np.array([t])


@pytest.mark.parametrize("longest", [None, 0.25, 0.01])
def test_no_taylor_step_is_longer_than_the_longest_or_than_two_of_those_before(longest):
    outcomes = SimpleNamespace(success="success", time_limit="limit")
    library = SimpleNamespace(taylor_outcome=outcomes)
    numbers: Any = SimpleNamespace(heyoka=library, constant=lambda x: x)
    made = Taylor()
    states, every, steps = reference._taylor_steps(numbers, made, [0.0, 1.0, 4.0], longest)
    assert [float(x[0]) for x in states] == [0.0, 1.0, 4.0]
    assert len(every) == len(steps) + 1
    assert steps[0] == 4.0 * reference.FIRST_SHARE
    assert all(b <= 2.0 * a for a, b in pairwise(steps))
    assert max(steps) == min(0.5, longest or 0.5)
    assert all(x <= (longest or np.inf) for x in made.limits[1:])


def test_a_reference_is_checked_by_shorter_steps_at_all_times(monkeypatch):
    asked: list[Any] = []

    def run(q: list[float], steps: int) -> Run:
        exact = np.array([[Decimal(x)] for x in q], object)
        facts = {"longest_step": 0.75, "steps": steps, "seconds": 0.0}
        return Run([0.0, 1.0, 2.0], exact, exact, None, 1e-30 * steps, facts)

    def taylor(scene, q0, u0, times, longest_step=None) -> Run:
        asked.append(longest_step)
        return run([0, 1, 2], 10) if longest_step is None else run([0, "1.5", "2.25"], 30)

    def extended(scene, q0, v0, times, watch) -> Run:
        return run([0, 1, "2.125"], 5)

    monkeypatch.setattr(reference_runs, "taylor_reference", taylor)
    monkeypatch.setattr(reference_runs, "extended_reference", extended)
    found = reference_runs.produce("free-3", reference_cases.CASES["free-3"], shown=False)
    assert asked == [None, 0.75 / reference_runs.SHORTER]
    assert found.check == {
        **{"longest_step": 0.25, "steps": 30, "energy_drift": 3e-29, "largest_difference": 0.5}
    }
    assert found.differences.tolist() == [0.0, 0.0, 0.125] and found.uncertainty == 0.125
    assert replace(found, differences=np.array([0.5, 0.0, 0.25])).uncertainty == 0.5


# ---- Counts of a campaign ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("crossed", "reached", "counts"),
    [
        (None, False, {"motions finished": 1}),
        (0.5, True, {"motions finished": 1, CROSSED + "im": 1}),
        (0.5, False, {"motions finished": 1, STOPPED + "im": 1}),
    ],
)
def test_a_motion_crossed_a_pose_where_it_came_out_behind_it(crossed, reached, counts):
    finding: Any = SimpleNamespace(ended="finished", crossed=crossed, reached=reached, subject="im")
    assert told(finding) == counts
