"""Errors of trajectories: Eqs. (30)-(33), and against a reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomcheck.errors import InputError
from eomcheck.motion.errors import constraint_error, energy_error, error_norm, errors_of
from eomcheck.motion.simulate import Trajectory
from eomcheck.motion.stored import Reference, load_reference

REFERENCE = load_reference(Path("validation/references/free-3.json"))


def exact(reference: Reference = REFERENCE) -> Trajectory:
    """Return the reference itself as a trajectory, rounded to doubles."""
    count, r = len(reference.times), reference.scene.r
    return Trajectory(
        scene=reference.scene,
        key="kane",
        integrator="DOP853",
        rtol=1e-6,
        atol=1e-8,
        times=reference.times.copy(),
        q=reference.q.copy(),
        v=reference.v.copy(),
        multipliers=None,
        energy=np.full(count, 3.0),
        constraint_residual=np.zeros((count, r)),
        right_hand_sides=1,
        steps=1,
        status="finished",
        reason="",
        seconds=0.0,
    )


def test_the_reference_itself_has_no_error():
    found = errors_of(exact(), REFERENCE)
    assert (found.final, found.largest, found.energy, found.constraint) == (0.0, 0.0, 0.0, 0.0)
    assert found.mescd == np.inf
    assert 0 < found.floor < 1e-12


def test_an_error_at_one_time_is_found_with_its_size():
    moved = exact()
    moved.q[3, 2] += 1e-5
    moved.v[-1, 0] -= 2e-7
    found = errors_of(moved, REFERENCE)
    assert found.largest == pytest.approx(1e-5, rel=1e-6)
    assert found.final == pytest.approx(2e-7, rel=1e-6)
    top = max(np.abs(REFERENCE.q).max(), np.abs(REFERENCE.v).max())
    assert found.largest_relative == pytest.approx(1e-5 / top, rel=1e-6)
    last = max(np.abs(REFERENCE.q[-1]).max(), np.abs(REFERENCE.v[-1]).max())
    assert found.final_relative == pytest.approx(2e-7 / last, rel=1e-6)
    mixed = 2e-7 / (1e-2 + abs(REFERENCE.v[-1, 0]))
    assert found.mescd == pytest.approx(-np.log10(mixed), rel=1e-6)


def test_energy_and_constraint_errors_are_those_of_the_paper():
    off = exact()
    off.energy[2] -= 0.03
    off.constraint_residual[4] = [3e-3, 0.0, 4e-3]
    assert energy_error(off)[2] == pytest.approx(-0.03)
    assert constraint_error(off)[4] == pytest.approx(5e-3)
    found = errors_of(off, REFERENCE)
    assert found.energy == pytest.approx(0.01)
    assert found.constraint == pytest.approx(5e-3)
    assert error_norm(constraint_error(off)) == pytest.approx(5e-3)
    assert error_norm([3.0, 4.0]) == 5.0
    assert (constraint_error(replace(off, constraint_residual=None)) == 0).all()


def test_a_trajectory_that_failed_or_has_other_times_is_not_judged():
    failed = replace(exact(), status="failed", reason="M is singular")
    with pytest.raises(InputError, match=r"ended at t = .*: M is singular"):
        errors_of(failed, REFERENCE)
    with pytest.raises(InputError, match="expected those of free-3"):
        errors_of(replace(exact(), times=REFERENCE.times * 0.5), REFERENCE)
