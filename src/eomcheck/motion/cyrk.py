"""CyRK's C functions, reached without what the package imports around them.

`import CyRK` brings numba in for its interfaces in Python, which nothing here uses: a fifth of a
second, and a package that must find a place for its files. The functions themselves are in
extension modules of their own.
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
from typing import Any

SOLVE = (
    *(c_void_p, c_double, c_double, c_void_p, c_size_t, c_int, c_size_t, c_size_t),
    *(c_void_p, c_size_t, c_size_t, c_size_t, c_bool, c_void_p, c_size_t, c_void_p),
    *(c_void_p, c_size_t, c_void_p, c_size_t, c_void_p, c_size_t, c_double, c_double, c_bool),
)
"""Arguments of its `numba_cysolve_ivp`, as `eomcheck.motion.integrators` hands them over."""

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
"""Name in CyRK -> result and arguments."""


_lock = Lock()
"""Modules are imported by one thread at a time."""


@cache
def library() -> Any:
    """Return CyRK's functions by name, its `methods` and `MAX_SIZE`."""
    with _lock:
        names = "nb.numba_c_api", "cy.cysolver_api", "cy.common"
        api, solver, common = (_extension(name) for name in names)
    found = {
        name: ctypes.CFUNCTYPE(*kinds)(getattr(api, f"get_{name}_func_ptr")())
        for name, kinds in FUNCTIONS.items()
    }
    return SimpleNamespace(**found, methods=solver.ODEMethod, MAX_SIZE=common.MAX_SIZE)


def _extension(name: str) -> ModuleType:
    """Import an extension module below CyRK, of whose packages no Python is run."""
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
            # Its extensions are built for such a machine, and would otherwise only crash.
            importlib.import_module("CyRK._cpu_check").check_cpu()
        return importlib.import_module(f"CyRK.{name}")
    finally:
        # Somebody who imports CyRK gets all of it.
        for part in parts:
            sys.modules.pop(part, None)
        del package
