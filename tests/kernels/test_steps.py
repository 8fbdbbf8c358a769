"""DOP853 side by side takes SciPy's steps, whatever makes it shorten, lengthen or end them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp
from tests.motion.test_many import integrated

from eomcheck.kernels import dop853


def bump(t, y):
    """A peak of width 1e-3 at t = 2, met in long steps."""
    return np.array([1.0 / (1e-6 + (t - 2.0) ** 2) - y[0], 0.1 * y[0] - y[1]])


def still(t, y):
    return 0.0 * y


def late(t, y):
    """At rest until it is pushed by a force that grows from nothing."""
    return np.array([y[1], t**3 - y[0]])


def kick(t, y):
    """A force that is there all at once."""
    return np.array([y[1], np.where(t > 2.0, 1e9, 0.0) + 0.0 * y[0]])


def stiff(t, y):
    return np.array([-100.0 * (y[0] - np.cos(t)), y[0] - y[1]])


STARTS = np.array([[0.1, 2.0, 0.0, 1e-7], [0.0, 3.0, 0.0, -1e-6]])


@pytest.mark.parametrize("rates", [bump, still, late, kick, stiff])
@pytest.mark.parametrize("t_end", [4.0, 1e-7])
def test_steps_calls_and_ends_are_those_of_scipy(rates: Callable, t_end: float):
    tolerance = 1e-6
    y, record, _ = integrated(rates, STARTS, t_end, rtol=tolerance)
    for lane in range(4):
        start: Any = STARTS[:, lane]
        with np.errstate(all="ignore"):
            alone = solve_ivp(rates, (0.0, t_end), start, "DOP853", rtol=tolerance, atol=tolerance)
        told = record[[dop853.STATUS, dop853.STEPS, dop853.CALLS, dop853.T], lane].tolist()
        assert told == [dop853.FINISHED, alone.t.size - 1, alone.nfev, t_end]
        assert y[:, lane] == pytest.approx(alone.y[:, -1], rel=1e-9, abs=1e-14)


def test_most_steps_are_enough_for_a_motion_that_ends_with_the_last_of_them():
    y0 = np.array([[0.1, 0.2, 0.3, 0.4], [0.0, 0.0, 0.0, 0.0]])
    _, free, _ = integrated(late, y0, 4.0)
    steps = int(free[dop853.STEPS].max())
    for most, expected in ((steps, dop853.FINISHED), (steps - 1, dop853.TOO_MANY)):
        _, record, _ = integrated(late, y0, 4.0, most=most)
        few = free[dop853.STEPS] > most
        told = np.where(few, dop853.TOO_MANY, dop853.FINISHED)
        assert record[dop853.STATUS].tolist() == told.tolist()
        assert expected in told
        assert record[dop853.STEPS].max() == most


def test_rejected_steps_are_no_steps_and_cost_calls():
    _, record, _ = integrated(bump, STARTS, 4.0, rtol=1e-6)
    whole = 2 + DOP853.n_stages * record[dop853.STEPS]
    assert (record[dop853.CALLS] > whole).all()
    assert ((record[dop853.CALLS] - whole) % DOP853.n_stages == 0).all()
