"""CyRK's integrators, called with a right-hand side in machine code.

CyRK's own Python entry requires numba; it only passes its arguments to C functions, and so does
this module. `import CyRK` imports numba for Python interfaces that are not needed here: a fifth of
a second, and a package that needs a writable cache directory. So the C functions are loaded from
their extension modules, without running CyRK's packages.
"""

from __future__ import annotations

import ctypes
import importlib
import sys
from ctypes import c_bool, c_double, c_int, c_size_t, c_void_p
from functools import cache
from importlib.util import find_spec, module_from_spec
from threading import Lock
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError, registered
from eomcheck.numbers.generic import Array

# ---- CyRK's C functions --------------------------------------------------------------------------

SOLVE = (
    *(c_void_p, c_double, c_double, c_void_p, c_size_t, c_int, c_size_t, c_size_t),
    *(c_void_p, c_size_t, c_size_t, c_size_t, c_bool, c_void_p, c_size_t, c_void_p),
    *(c_void_p, c_size_t, c_void_p, c_size_t, c_void_p, c_size_t, c_double, c_double, c_bool),
)
"""Argument types of CyRK's `numba_cysolve_ivp`."""

FUNCTIONS: dict[str, tuple[Any, ...]] = {
    "solve": (c_void_p, *SOLVE),
    "success": (c_bool, c_void_p),
    "size": (c_size_t, c_void_p),
    "num_dy": (c_size_t, c_void_p),
    "steps_taken": (c_size_t, c_void_p),
    "t": (ctypes.POINTER(c_double), c_void_p),
    "y": (ctypes.POINTER(c_double), c_void_p),
    "message_buffer": (None, c_size_t, c_size_t, c_size_t),
    "free": (None, c_void_p),
}
"""Name of CyRK's function -> types of its result and arguments."""


_lock = Lock()
"""Lock for imports by one thread at a time."""


@cache
def load_cyrk() -> Any:
    """Return CyRK's functions by name, its `methods` and `MAX_SIZE`."""
    with _lock:
        names = "nb.numba_c_api", "cy.cysolver_api", "cy.common"
        api, solver, common = (_extension(name) for name in names)
    functions = {
        name: ctypes.CFUNCTYPE(*kinds)(getattr(api, f"get_{name}_func_ptr")())
        for name, kinds in FUNCTIONS.items()
    }
    return SimpleNamespace(**functions, methods=solver.ODEMethod, MAX_SIZE=common.MAX_SIZE)


def _extension(name: str) -> ModuleType:
    """Import an extension module of CyRK without running the Python code of its packages."""
    if "CyRK" in sys.modules:
        return importlib.import_module(f"CyRK.{name}")
    spec = find_spec("CyRK")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    parts = ["CyRK", *(f"CyRK.{part}" for part in ("nb", "cy"))]
    sys.modules["CyRK"] = package = module_from_spec(spec)
    try:
        for part in parts[1:]:
            folder = find_spec(part)
            if folder is not None:
                sys.modules[part] = module_from_spec(folder)
        if name.startswith("nb"):
            # Its extensions are built for such a processor, and would otherwise crash.
            importlib.import_module("CyRK._cpu_check").check_cpu()
        return importlib.import_module(f"CyRK.{name}")
    finally:
        # A user's own `import CyRK` then gets the whole package.
        for part in parts:
            sys.modules.pop(part, None)
        del package


# ---- Integrators ---------------------------------------------------------------------------------

MEMORY = 2000
"""Memory limit of the steps of one run, MB."""

MOST_STEPS = 1_000_000
"""Default limit of the steps of one run. Near t = 0 every step size is resolved in float64, so that
a run with shrinking steps would not end.
"""


class Integrator(NamedTuple):
    """Facts about one integrator.

    Attributes:
        key: its name.
        order: nominal order of convergence, or None where it varies.
        implicit: whether it solves equations in each step.
        what: description of the method.
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
    return registered("integrator", key, INTEGRATORS)


class Steps(NamedTuple):
    """The result of an integration.

    Attributes:
        t: times (k,), s.
        y: states (k, size).
        steps: steps taken.
        success: whether the end was reached.
        message: CyRK's message.
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
        address: address of the callback, which gets (derivatives, t, state, arguments).
        arguments: float64 array, which CyRK copies.
        y0: initial state (size,).
        t_end: end, s.
        t_start: start, s.
        integrator: a key of `INTEGRATORS`.
        rtol: relative tolerance.
        atol: absolute tolerance.
        output_times: times (k,) of the output, by interpolation; by default each step.
        max_step: largest step, s.
        first_step: first step, s; 0 lets the integrator choose.
        max_steps: give up after so many steps; 0 for no limit but memory.

    Returns:
        Times, states and counts of the steps.

    Raises:
        UnknownNameError: no such integrator.
    """
    key, cyrk = integrator_of(integrator).key, load_cyrk()
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
        buffer = np.zeros(256, np.uint8)
        cyrk.message_buffer(result, buffer.ctypes.data, buffer.size)
        message = buffer.tobytes().partition(b"\0")[0].decode("utf-8", "replace")
        success = bool(cyrk.success(result))
        return Steps(t, y, int(cyrk.steps_taken(result)), success, message)
    finally:
        cyrk.free(result)
