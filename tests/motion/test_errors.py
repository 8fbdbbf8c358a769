"""Errors of trajectories: Eqs. (30)-(33), and against a reference."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion.reference_solution import (
    FEWEST,
    Reference,
    constraint_error,
    constraint_error_drift,
    drift_of,
    energy_error,
    energy_error_drift,
    error_norm,
    errors_of,
    load_reference,
)
from eomcheck.motion.simulate import Trajectory

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


def test_errors_are_relative_to_the_end_and_to_the_largest_of_motions_that_end_slowly():
    fast = REFERENCE.v.copy()
    fast[2, 1] = 1e3
    slow = replace(REFERENCE, v=fast)
    moved = exact(slow)
    moved.q[3, 2] += 1e-5
    moved.v[-1, 0] -= 2e-7
    found = errors_of(moved, slow)
    last = max(np.abs(slow.q[-1]).max(), np.abs(slow.v[-1]).max())
    assert last < 100.0
    assert found.final_relative == pytest.approx(2e-7 / last, rel=1e-6)
    assert found.largest_relative == pytest.approx(1e-8, rel=1e-6)


def test_beside_a_reference_at_rest_in_the_origin_errors_are_none_or_infinite():
    q, v = np.zeros_like(REFERENCE.q), np.zeros_like(REFERENCE.v)
    still = replace(REFERENCE, q=q, v=v)
    found = errors_of(exact(still), still)
    assert (found.final_relative, found.largest_relative, found.mescd) == (0.0, 0.0, np.inf)
    assert errors_of(replace(exact(still), atol=0.0), still).mescd == np.inf
    moved = exact(still)
    moved.q[-1, 0] = 1e-9
    found = errors_of(moved, still)
    assert (found.final_relative, found.largest_relative) == (np.inf, np.inf)
    assert found.mescd == pytest.approx(7.0)


def test_nothing_is_judged_below_what_the_reference_itself_is_known_to():
    differences = np.zeros(len(REFERENCE.times))
    differences[3] = 1e-9
    rough = replace(REFERENCE, differences=differences)
    assert rough.uncertainty == 1e-9
    top = max(np.abs(REFERENCE.q).max(), np.abs(REFERENCE.v).max())
    assert rough.rounding == np.spacing(top) / 2
    assert errors_of(exact(), rough).floor == 1e-9 + rough.rounding


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


# ---- Drift ---------------------------------------------------------------------------------------

TIMES = np.linspace(0.0, 4.0, 21)


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 2.0])
def test_the_law_of_growth_is_found_through_bad_times_and_zeros(exponent: float):
    errors = 3e-9 * TIMES**exponent
    errors[[2, 5, 11]] *= 1e4
    errors[[7, 8]] = 0.0
    found = drift_of(TIMES, -errors)
    assert found is not None
    assert found.exponent == pytest.approx(exponent, abs=1e-12)
    assert found.rate * 4.0 == pytest.approx(3e-9 * 4.0**exponent)


def test_too_few_errors_have_no_law():
    errors = np.zeros(21)
    errors[: FEWEST + 1] = 1e-9  # that at t = 0 has no logarithm
    assert drift_of(TIMES, errors) is not None
    assert drift_of(TIMES[: FEWEST + 1], np.arange(FEWEST + 1) - 1.0) is None


@pytest.mark.parametrize("key", FORMULATIONS)
def test_constraints_drift_in_formulations_that_have_them_at_acceleration_level(key: str):
    off = exact()
    off.constraint_residual[:, 1] = 2e-8 * off.times
    off.energy[:] += 6e-6 * off.times**2
    found = constraint_error_drift(replace(off, key=key))
    if FORMULATIONS[key].level == "velocity":
        assert found is None
    else:
        assert found is not None
        assert (found.rate, found.exponent) == pytest.approx((2e-8, 1.0))
    energy = energy_error_drift(replace(off, key=key))
    assert energy is not None
    assert energy.exponent == pytest.approx(2.0)
    assert energy.rate == pytest.approx(6e-6 * off.times[-1] / 3.0, rel=1e-3)


def test_energy_that_is_not_kept_does_not_drift(monkeypatch: pytest.MonkeyPatch):
    off = exact()
    off.energy[:] += off.times
    assert energy_error_drift(off) is not None
    monkeypatch.setattr(type(off.scene), "conserves_energy", False)
    assert energy_error_drift(off) is None


def test_a_damped_motion_has_no_energy_error_and_says_why():
    damped = replace(REFERENCE.scene, damping=np.ones(REFERENCE.scene.links - 1))
    off = replace(exact(), scene=damped)
    off.energy[:] -= off.times
    assert energy_error_drift(off) is None
    assert np.isnan(errors_of(off, REFERENCE).energy)
    with pytest.raises(InputError, match="dampers in the joints take it"):
        energy_error(off)
