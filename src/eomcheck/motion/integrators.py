"""CyRK's integrators, driven by a C callback.

CyRK's own entry in Python wants numba; it only hands its arguments to the C functions that
`eomcheck.motion.cyrk` reaches, and so does this file.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.errors import InputError, named
from eomcheck.motion.cyrk import library
from eomcheck.numbers.contract import Array

MEMORY = 2000
"""Most memory for the steps of one run, MB."""

MOST_STEPS = 1_000_000
"""Most steps of one run unless the caller says otherwise. Near t = 0 no step is too small to be
told from the time, so that a run whose steps shrink would not end."""


class Integrator(NamedTuple):
    """Facts about one integrator.

    Attributes:
        key: its name.
        order: nominal order of convergence, or None where it varies.
        implicit: whether it solves equations in each step.
        what: what it is.
    """

    key: str
    order: int | None
    implicit: bool
    what: str


INTEGRATORS: dict[str, Integrator] = {
    one.key: one
    for one in (
        Integrator("RK45", 5, False, "explicit Runge-Kutta 5(4), Dormand and Prince"),
        Integrator("Tsit5", 5, False, "explicit Runge-Kutta 5(4), Tsitouras"),
        Integrator("DOP853", 8, False, "explicit Runge-Kutta 8(5,3), Dormand and Prince"),
        Integrator("Vern8", 8, False, "explicit Runge-Kutta 8(7), Verner"),
        Integrator("LSODA", None, True, "Adams and BDF, switching by stiffness"),
        Integrator("Radau", 5, True, "implicit Runge-Kutta, Radau IIA"),
        Integrator("BDF", None, True, "backward differentiation, order 1 to 5"),
    )
}
"""Key -> integrator."""


def integrator_of(key: str) -> Integrator:
    """Return the integrator called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("integrator", key, INTEGRATORS)


class Steps(NamedTuple):
    """What an integrator returns.

    Attributes:
        t: times (k,), s.
        y: states (k, size).
        steps: steps taken.
        success: whether the end was reached.
        message: what CyRK says.
    """

    t: Array
    y: Array
    steps: int
    success: bool
    message: str


def integrate(
    address: int,
    arguments: Array,
    y0: Array,
    t_end: float,
    *,
    t_start: float = 0.0,
    integrator: str = "DOP853",
    rtol: float = 1e-9,
    atol: float = 1e-9,
    output_times: Array | None = None,
    max_step: float = np.inf,
    first_step: float = 0.0,
    max_steps: int = MOST_STEPS,
) -> Steps:
    """Integrate from `t_start` to `t_end` by a C callback.

    Args:
        address: of the callback, which gets (derivatives, t, state, arguments).
        arguments: doubles, which CyRK copies.
        y0: initial state (size,).
        t_end: end, s.
        t_start: start, s.
        integrator: a key of `INTEGRATORS`.
        rtol: relative tolerance.
        atol: absolute tolerance.
        output_times: where the state is wanted (k,), by interpolation; by default at each step.
        max_step: largest step, s.
        first_step: first step, s; 0 lets the integrator choose.
        max_steps: give up after so many steps; 0 for no limit but memory.

    Raises:
        UnknownNameError: no such integrator.
    """
    key, cyrk = integrator_of(integrator).key, library()
    method = int(getattr(cyrk.methods, key.upper()))
    y0, arguments = (np.ascontiguousarray(x, np.float64) for x in (y0, arguments))
    times = np.empty(0) if output_times is None else np.ascontiguousarray(output_times, np.float64)
    tolerances = np.array([rtol]), np.array([atol])
    result = cyrk.solve(
        address,
        t_start,
        t_end,
        *(y0.ctypes.data, y0.size),
        method,
        *(0, 0),  # size expected, extra outputs
        *(arguments.ctypes.data, arguments.nbytes),
        max_steps,
        MEMORY,
        False,  # dense output
        *(times.ctypes.data, times.size),
        *(0, 0, 0),  # no function before evaluations, no events
        *(tolerances[0].ctypes.data, 1),
        *(tolerances[1].ctypes.data, 1),
        min(max_step, cyrk.MAX_SIZE),
        first_step,
        False,  # keep the solver
    )
    if not result:
        raise InputError(f"{integrator} could not be started with rtol = {rtol}, atol = {atol}")
    try:
        count = cyrk.size(result)
        shape = (count, cyrk.num_dy(result))
        if count == 0:
            t, y = np.empty(0), np.empty(shape)
        else:
            t = np.ctypeslib.as_array(cyrk.t(result), (count,)).copy()
            y = np.ctypeslib.as_array(cyrk.y(result), shape).copy()
        said = np.zeros(256, np.uint8)
        cyrk.message_buffer(result, said.ctypes.data, said.size)
        message = said.tobytes().partition(b"\0")[0].decode("utf-8", "replace")
        success = bool(cyrk.success(result))
        return Steps(t, y, int(cyrk.steps_taken(result)), success, message)
    finally:
        cyrk.free(result)
