"""Calling machine code many times from machine code, to time it without the way there."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.kernels.code import Code
from eomcheck.kernels.machine import Machine
from eomcheck.kernels.sincos import library_call


@cache
def _machine() -> Machine:
    repeated, angles, rows = Code(), Code(), {}
    with repeated.loop("%count"):
        repeated.do("call void %function(ptr %a, double %t, ptr %b, ptr %c, ptr %d)")
    with angles.loop("%count"), angles.loop("%size") as turn:
        x = angles.let(f"load double, ptr {angles.at('%x', turn.i)}")
        library_call(angles, x, angles.at("%cos", turn.i), angles.at("%sin", turn.i))
    for name in ("double", "ptr"):
        rows[name] = code = Code()
        with code.loop("%count") as turn:
            out, t, y = (
                code.at(f"%{x}", code.integer("mul", turn.i, f"%{x}_step"))
                for x in ("out", "t", "y")
            )
            t = code.load(t) if name == "double" else t
            code.do(f"call void %function(ptr {out}, {name} {t}, ptr {y}, ptr %last)")
    steps = ", ".join(f"ptr %{x}, i64 %{x}_step" for x in ("out", "t", "y"))
    given = "ptr %function, double %t, ptr %a, ptr %b, ptr %c, ptr %d"
    return Machine(
        (
            *(
                code.function(
                    f"define void @along_{name}(ptr %function, ptr %last, i64 %count, {steps})"
                )
                for name, code in rows.items()
            ),
            repeated.function(f"define void @repeated(i64 %count, {given})"),
            angles.function(
                "define void @angles(i64 %count, i64 %size, ptr %x, ptr %cos, ptr %sin)"
            ),
        )
    )


def repeated(address: int, *pointers: int) -> Callable[[int], None]:
    """Return what calls a C function of up to four pointers so many times.

    A double, 0, stands behind the first pointer; C functions without one do not see it.
    """
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 4
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("repeated"))
    given = *pointers, *[0] * (4 - len(pointers))
    return lambda count: function(count, address, 0.0, *given)


def along(address: int, last: np.ndarray, t: np.ndarray, y: np.ndarray, out: np.ndarray) -> None:
    """Call a kernel for each row of t, y and `out`, which it writes.

    Args:
        address: of the kernel.
        last: what stands at its last argument.
        t: (k, lanes), s.
        y: (k, _, lanes).
        out: (k, _, lanes).
    """
    name = "along_double" if out.shape[-1] == 1 else "along_ptr"
    kinds = *[ctypes.c_void_p] * 2, *[ctypes.c_int64, ctypes.c_void_p] * 3, ctypes.c_int64
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address(name))
    rows = ((x.ctypes.data, x[0].size) for x in (out, t, y))
    if len(out):
        function(address, last.ctypes.data, len(out), *(part for row in rows for part in row))


def sines(x: np.ndarray) -> Callable[[int], None]:
    """Return what makes the sines and cosines of angles x (k >= 1,), rad, so many times."""
    kinds = ctypes.c_int64, ctypes.c_int64, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("angles"))
    x = np.ascontiguousarray(x, float)
    cos, sin = np.empty_like(x), np.empty_like(x)
    return lambda count: function(count, x.size, x.ctypes.data, cos.ctypes.data, sin.ctypes.data)
