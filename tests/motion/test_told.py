"""Counts, steps, reasons and drifts of motions, each held against numbers known before."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from itertools import count, pairwise
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np
import pytest

from eomcheck.descriptions.build import mechanism
from eomcheck.descriptions.elements import Joint, Link
from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels.kernel import FAILURE_TIME, Kernel
from eomcheck.kernels.program import program_of
from eomcheck.lab import references
from eomcheck.lab.fuzzing.motion_rounds import CROSSED, STOPPED, motion_counts
from eomcheck.motion import observables, reference, reference_solution
from eomcheck.motion import simulate as trajectory
from eomcheck.motion.batch import OUTPUTS, simulate_many
from eomcheck.motion.integrators import Steps
from eomcheck.motion.reference_solution import ReferenceRun
from eomcheck.motion.right_hand_side import RightHandSide, state_of
from eomcheck.motion.simulate import simulate
from eomcheck.motion.stabilization import integrate_in_pieces
from eomcheck.numbers.tape import Tape
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


@pytest.mark.parametrize("sign", [1, -1])
def test_a_loop_that_writes_outputs_counts_those_that_are_not_finite(sign: int):
    tape, size = Tape(), 200
    y = tape.inputs("y", (size,))
    rates = [tape.number(sign * x * x + x).index for x in y]
    program = program_of(tape, {"rates": rates}, short=0)
    assert len(program.items) == 1  # a loop
    kernel = Kernel(program, {}, {"rates": size})
    block = kernel.block({})
    for t, large in ((0.25, 1e100), (0.5, 1e200), (0.75, 1e200)):
        kernel(block, np.array([t]), np.where(np.arange(size) == 150, large, 1.0))
    assert block[:2].view(np.int64).tolist() == [3, 2] and block[FAILURE_TIME] == 0.5


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


def test_a_motion_whose_energy_overflows_at_its_first_times_only_failed_as_well():
    links, damped = [Link("ground"), Link("block", 1.0)], {"axis": (1.0, 0.0, 0.0), "damping": 1.0}
    joints = [Joint("x", "prismatic", "ground", "block", **damped)]
    scene = mechanism("Damped", links, joints, gravity=None)()
    fast, overflows = np.array([2.5e154]), ("failed", "the energy overflows")
    for times, expected in (([0.0, 0.5, 1.0], overflows), ([1.0], ("finished", ""))):
        here: Any = {"output_times": np.array(times)}
        one = simulate(scene, "kane", 1.0, u0=fast, **here)
        many = simulate_many(scene, "kane", 1.0, u0=np.array([fast, [1.0]]), **here)
        assert (one.status, one.reason) == expected
        assert (many.status[0], many.reason[0]) == expected
        assert np.isfinite(many.energy[0]).tolist() == [t > 0.5 for t in times]
        assert many.status[1] == "finished" and np.isfinite(many.energy[1]).all()


def test_of_many_motions_each_has_its_own_counts_and_its_share_of_the_time():
    u0 = np.array([[1e-3, 0.0], [1.0, 5.0], [0.0, 0.0]])
    found = simulate_many(SLEIGH, "kane", 5.0, u0=u0, lanes=1)
    assert found.t.size == OUTPUTS and len(set(found.steps.tolist())) > 1
    for i in range(3):
        one = found[i]
        assert (one.steps, one.right_hand_sides) == (found.steps[i], found.right_hand_sides[i])
        assert one.seconds == found.seconds / 3
        assert (one.energy == found.energy[i]).all()


def test_the_time_of_many_motions_is_that_of_all_groups_of_lanes(monkeypatch):
    clock = count()
    monkeypatch.setattr("eomcheck.motion.batch.time.perf_counter", lambda: float(next(clock)))
    found = simulate_many(SLEIGH, "kane", 0.1, u0=np.ones((3, 2)), lanes=1)
    assert found.seconds == 3.0


@pytest.mark.parametrize("row", [0, 2])
def test_a_start_that_violates_any_constraint_is_refused(row: int):
    scene = Snake.coil(3)
    q, _ = scene.initial_state()
    v = velocity(scene, q, np.array([1.0, 0.5]))
    at = Evaluation(scene, q, v)
    a = at.terms.a
    assert a is not None
    aside = np.linalg.lstsq(a, np.eye(3)[row], rcond=None)[0]
    starts = np.array([v, v + 1e-9 * aside, v + 0.1 * aside])
    found = simulate_many(scene, "el", 1e-3, q0=np.tile(q, (3, 1)), v0=starts)
    assert found.status.tolist() == ["finished", "refused", "refused"]


def test_the_worst_state_looked_at_is_kept_wherever_it_is():
    course: Any = object.__new__(trajectory._ObservedMotion)
    course.formulation, course.rcond, course._checked, course._worst = None, {}, {}, np.inf
    for rcond in (0.5, 0.125, 0.25):
        at = SimpleNamespace(acceleration=lambda f, x=rcond: SimpleNamespace(rcond={"M": x}))
        at.told = rcond
        motion: Any = SimpleNamespace(evaluation=lambda y, t, at=at: at, choice=None)
        course._check_state(motion, 0.0, np.zeros(1))
    assert course.rcond == {"M": 0.125}
    assert {name: at.told for name, at in course._checked.items()} == {
        **{"first": 0.5, "last": 0.25, "worst": 0.125}
    }


class CheckedState(SimpleNamespace):
    """A state as `_ObservedMotion` keeps it: one and the same is counted once."""

    __hash__ = object.__hash__


@pytest.mark.parametrize(
    ("states", "ulps"),
    [
        ([(2.0, 1.0), (1.0, 3.0)], 3.0),
        ([(2.0, 1.0), (0.0, 0.0)], 0.5),
        ([(2.0, 1.0), (np.inf, np.inf)], np.inf),
        ([(np.inf, 1.0), (2.0, 1.0)], np.inf),
        ([(2.0, 1.0), (2.0, np.nan)], np.inf),
        ([(2.0, np.inf), (2.0, 1.0)], np.inf),
        ([(0.0, np.inf)], np.inf),
        ([], np.inf),
    ],
)
def test_a_rate_error_that_cannot_be_measured_at_one_state_is_infinite(monkeypatch, states, ulps):
    monkeypatch.setattr(trajectory, "acceleration_sensitivity", lambda at, f: at.sensitivity)
    course: Any = object.__new__(trajectory._ObservedMotion)
    course.formulation = None
    course._checked = {
        name: CheckedState(
            sensitivity=sensitivity,
            acceleration=lambda f, x=vdot: SimpleNamespace(vdot=np.array([x])),
        )
        for name, (vdot, sensitivity) in zip(("first", "last"), states, strict=False)
    }
    assert course.rate_error() == allowed_error(ulps)


# ---- Pieces and poses ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fails", "refuses", "ends", "says"),
    [
        (None, None, [1.0, 2.0, 3.0], ""),
        (2.0, None, [1.0, 2.0], "no step is small enough"),
        (None, 2.0, [1.0, 2.0], "the velocity cannot be projected: M is singular"),
    ],
)
def test_pieces_end_with_the_first_that_fails_or_cannot_be_projected(fails, refuses, ends, says):
    done: list[float] = []

    def piece(start, end, y, first_step, output_times, max_steps) -> Steps:
        done.append(end)
        bad = end == fails
        message = "no step is small enough" if bad else ""
        return Steps(np.array([start, end]), np.array([y, y + 1.0]), 7, not bad, message)

    def project(t: float, y: np.ndarray) -> np.ndarray:
        if t == refuses:
            raise RefusedError("M", 0.0, 0.0, "M is singular")
        return y

    found = integrate_in_pieces(piece, project, np.zeros(1), 3.0, 1.0, 0.0, None, 0)
    assert (done, found.success, found.message) == (ends, not says, says)
    assert found.steps == 7 * len(ends) and found.t.tolist() == [0.0, *ends]


def test_of_poses_that_are_crossed_the_first_is_told(monkeypatch):
    a_1 = np.array([1.0, 2.0, -1.0, -2.0, 1.0]).reshape(5, 1, 1)
    kernel = SimpleNamespace(block=lambda given: None, rows=lambda block, t, y: {"a_1": a_1})
    monkeypatch.setattr(observables, "traced_kernel", lambda *how: kernel)
    t, y = np.arange(5.0)[:, None], np.zeros((5, 1, 1))
    assert observables.singular_crossings(SLEIGH, FORMULATIONS["em"], {}, t, y) == [(1, 2)]


# ---- Energies ------------------------------------------------------------------------------------


def test_changes_of_energy_are_relative_to_the_largest_at_any_time():
    motion = simulate(SLEIGH, "kane", 1.0, u0=np.array([1.0, 0.5]), output_times=np.arange(5) / 4)
    grown = replace(motion, energy=1.0 + 3.0 * motion.times)
    assert reference_solution._largest_energy_error(grown) == 0.75
    law = reference_solution.energy_error_drift(grown)
    assert law is not None and (law.rate, law.exponent) == pytest.approx((0.75, 1.0))


def test_a_law_of_growth_needs_four_errors():
    times = np.arange(1.0, 5.0)
    assert reference_solution.drift_of(times[:3], times[:3]) is None
    assert reference_solution.drift_of(times, times) is not None


# ---- References ----------------------------------------------------------------------------------


def test_energy_drifts_by_the_largest_change_at_any_step():
    assert reference._drift([2.0, 5.0, 1.0, 2.0]) == 1.5
    assert reference._drift([0.0, -0.25, 0.125]) == 0.25


@pytest.mark.parametrize("place", [0, 1, 2])
def test_energy_that_is_no_number_is_no_small_drift(place: int):
    energies = [2.0, 5.0, 1.0]
    energies[place] = np.nan
    assert reference._drift(energies) == np.inf


@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_velocity_violates_by_its_worst_constraint(row: int):
    c = np.where(np.arange(3) == row, -3.0, 0.5)
    scene: Any = SimpleNamespace(constraint=lambda *here: [flint.arb(x) for x in c])
    at: Any = SimpleNamespace(
        parameters=None, prepared=None, q=None, v=[flint.arb(-5), flint.arb(2)]
    )
    assert reference._violation(scene, at) == 0.5


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_constraint_that_is_no_number_is_no_small_violation(place: int):
    c = [flint.arb("nan" if k == place else 1) for k in range(3)]
    scene: Any = SimpleNamespace(constraint=lambda *here: c)
    at: Any = SimpleNamespace(parameters=None, prepared=None, q=None, v=[flint.arb(2)])
    assert reference._violation(scene, at) == np.inf


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

    def run(q: list[float], steps: int) -> ReferenceRun:
        exact = np.array([[Decimal(x)] for x in q], object)
        facts = {"longest_step": 0.75, "steps": steps, "seconds": 0.0}
        return ReferenceRun([0.0, 1.0, 2.0], exact, exact, None, 1e-30 * steps, facts)

    def taylor(scene, q0, u0, times, longest_step=None) -> ReferenceRun:
        asked.append(longest_step)
        return run([0, 1, 2], 10) if longest_step is None else run([0, "1.5", "2.25"], 30)

    def extended(scene, q0, v0, times, watch) -> ReferenceRun:
        return run([0, 1, "2.125"], 5)

    monkeypatch.setattr(references, "taylor_reference", taylor)
    monkeypatch.setattr(references, "extended_reference", extended)
    found = references.produce("free-3", references.REFERENCE_CASES["free-3"], shown=False)
    assert asked == [None, 0.75 / references.SHORTER]
    assert found.check == {
        **{"longest_step": 0.25, "steps": 30, "energy_drift": 3e-29, "largest_difference": 0.5}
    }
    assert found.differences.tolist() == [0.0, 0.0, 0.125] and found.uncertainty == 0.125
    assert replace(found, differences=np.array([0.5, 0.0, 0.25])).uncertainty == 0.5
    faster = replace(found, q=np.ones((3, 1)), v=np.full((3, 1), -1024.0))
    slower = replace(found, q=np.full((3, 1), -1024.0), v=np.ones((3, 1)))
    assert faster.rounding == slower.rounding == 512 * np.finfo(float).eps


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
    assert motion_counts(finding) == counts
