"""Kernels: programs compiled to machine code, with the memory blocks that they read.

A kernel is called for each row of an array of states by a loop in machine code (`call_along_rows`).
Functions that are timed are called by such loops too (`timing_loop`, `sincos_timing_loop`): the
measured time includes no call from Python.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from eomcheck.kernels.emit import FAILURE_TIME, HEADER, Layout, function_texts, layout_of
from eomcheck.kernels.llvm import EFFORT, IRBuilder, JitModule, aligned_zeros
from eomcheck.kernels.program import Program
from eomcheck.kernels.sincos import library_call
from eomcheck.numbers.generic import Array

# ---- Loops that call machine code ----------------------------------------------------------------


@cache
def _machine() -> JitModule:
    repeated, angles, rows = IRBuilder(), IRBuilder(), {}
    with repeated.loop("%count"):
        repeated.do("call void %function(ptr %a, double %t, ptr %b, ptr %c, ptr %d)")
    with angles.loop("%count"), angles.loop("%size") as turn:
        x = angles.let(f"load double, ptr {angles.address('%x', turn.i)}")
        library_call(angles, x, angles.address("%cos", turn.i), angles.address("%sin", turn.i))
    for name in ("double", "ptr"):
        rows[name] = code = IRBuilder()
        with code.loop("%count") as turn:
            out, t, y = (
                code.address(f"%{x}", code.integer("mul", turn.i, f"%{x}_step"))
                for x in ("out", "t", "y")
            )
            t = code.load(t) if name == "double" else t
            code.do(f"call void %function(ptr {out}, {name} {t}, ptr {y}, ptr %last)")
    steps = ", ".join(f"ptr %{x}, i64 %{x}_step" for x in ("out", "t", "y"))
    arguments = "ptr %function, double %t, ptr %a, ptr %b, ptr %c, ptr %d"
    return JitModule(
        (
            *(
                code.function(
                    f"define void @along_{name}(ptr %function, ptr %last, i64 %count, {steps})"
                )
                for name, code in rows.items()
            ),
            repeated.function(f"define void @repeated(i64 %count, {arguments})"),
            angles.function(
                "define void @angles(i64 %count, i64 %size, ptr %x, ptr %cos, ptr %sin)"
            ),
        )
    )


def timing_loop(address: int, *pointers: int) -> Callable[[int], None]:
    """Return a function of a count that calls a C function of up to four pointers so many times.

    The argument after the first pointer is a float64, 0; C functions without it do not see it.

    Args:
        address: of the C function.
        pointers: its arguments.
    """
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 4
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("repeated"))
    arguments = *pointers, *[0] * (4 - len(pointers))
    return lambda count: function(count, address, 0.0, *arguments)


def call_along_rows(
    address: int, last: np.ndarray, t: np.ndarray, y: np.ndarray, out: np.ndarray
) -> None:
    """Call a kernel for each row of t, y and `out`, which it writes.

    Args:
        address: of the kernel.
        last: array whose address is its last argument.
        t: times (k, lanes), s.
        y: states (k, _, lanes).
        out: outputs (k, _, lanes).
    """
    name = "along_double" if out.shape[-1] == 1 else "along_ptr"
    kinds = *[ctypes.c_void_p] * 2, *[ctypes.c_int64, ctypes.c_void_p] * 3, ctypes.c_int64
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address(name))
    rows = ((x.ctypes.data, x[0].size) for x in (out, t, y))
    if len(out):
        function(address, last.ctypes.data, len(out), *(part for row in rows for part in row))


def sincos_timing_loop(x: np.ndarray) -> Callable[[int], None]:
    """Return a function of a count: sines and cosines of angles x (k >= 1,), rad, so many times."""
    kinds = ctypes.c_int64, ctypes.c_int64, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("angles"))
    x = np.ascontiguousarray(x, float)
    cos, sin = np.empty_like(x), np.empty_like(x)
    return lambda count: function(count, x.size, x.ctypes.data, cos.ctypes.data, sin.ctypes.data)


# ---- Kernels -------------------------------------------------------------------------------------


class Kernel:
    """A function of (t, y) and parameters in machine code.

    Args:
        program: its operations.
        parameters: number of entries of each parameter, by name.
        outputs: number of entries of each output, by name.
        width: number of SIMD lanes.
        effort: optimization level of LLVM's code generation.
    """

    def __init__(
        self,
        program: Program,
        parameters: Mapping[str, int],
        outputs: Mapping[str, int],
        width: int = 1,
        effort: int = EFFORT,
    ):
        self.width, self.parameters, self.outputs = width, dict(parameters), dict(outputs)
        self.layout: Layout = layout_of(program, parameters)
        self.size = sum(self.outputs.values())
        texts = function_texts("kernel", program, self.layout, self.outputs, width)
        self.machine = JitModule(texts, effort)
        self.address = self.machine.address("kernel")

    def block(self, parameters: Mapping[str, Array]) -> Array:
        """Return a memory block with these parameters, each (size,) or (size, lanes)."""
        block = aligned_zeros(self.layout.float64_count(self.width), HEADER)
        block[FAILURE_TIME] = np.nan
        for name, size in self.parameters.items():
            first = HEADER + self.layout.offsets[name] * self.width
            target = block[first : first + size * self.width].reshape(size, self.width)
            values = np.asarray(parameters[name], float)
            target[:] = values if values.ndim == 2 else values[:, None]
        return block

    def last_argument(self, block: Array) -> Array:
        """Return the array whose address is the last argument; the caller has to keep it alive."""
        return np.array([block.ctypes.data], np.uintp) if self.width == 1 else block

    def __call__(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs, each (size,) or (size, lanes), of a state y and times t (lanes,)."""
        outputs = self.rows(block, t.reshape(1, -1), y[None])
        return {name: x[0] if self.width > 1 else x[0, :, 0] for name, x in outputs.items()}

    def rows(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs (k, size, lanes) at times t (k, lanes) of states y (k, _, lanes)."""
        y, t = np.ascontiguousarray(y, float), np.ascontiguousarray(t, float)
        out = np.empty((len(y), self.size, self.width))
        call_along_rows(self.address, self.last_argument(block), t, y, out)
        ends = np.cumsum(list(self.outputs.values()))[:-1]
        return dict(zip(self.outputs, np.split(out, ends, axis=1), strict=True))
