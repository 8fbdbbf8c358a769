"""A kernel: a program in machine code, with the block that it reads."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from eomcheck.kernels.emit import FAILURE_TIME, HEADER, Layout, function_texts, layout_of
from eomcheck.kernels.machine import Machine
from eomcheck.kernels.program import Program
from eomcheck.model import Array


class Kernel:
    """A function of (t, y) and parameters in machine code.

    Args:
        program: what it does.
        parameters: number of entries of each parameter, by name.
        outputs: number of entries of each output, by name.
        width: lanes.
    """

    def __init__(
        self,
        program: Program,
        parameters: Mapping[str, int],
        outputs: Mapping[str, int],
        width: int = 1,
    ):
        self.width, self.parameters, self.outputs = width, dict(parameters), dict(outputs)
        self.layout: Layout = layout_of(program, parameters)
        places, self.size = {}, 0
        for name, size in outputs.items():
            places[name] = self.size
            self.size += size
        self.machine = Machine(function_texts("kernel", program, self.layout, places, width))
        self.address = self.machine.address("kernel")
        time = ctypes.c_double if width == 1 else ctypes.c_void_p
        kinds = ctypes.c_void_p, time, ctypes.c_void_p, ctypes.c_void_p
        self._call = ctypes.CFUNCTYPE(None, *kinds)(self.address)

    def block(self, parameters: Mapping[str, Array]) -> Array:
        """Return a block with these parameters, each (size,), or (size, lanes)."""
        block = np.zeros(self.layout.doubles(self.width))
        block[FAILURE_TIME] = np.nan
        for name, size in self.parameters.items():
            first = HEADER + self.layout.places[name] * self.width
            room = block[first : first + size * self.width].reshape(size, self.width)
            given = np.asarray(parameters[name], float)
            room[:] = given if given.ndim == 2 else given[:, None]
        return block

    def __call__(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs, each (size,), or (size, lanes), of a state y and times t (lanes,)."""
        y, t = np.ascontiguousarray(y, float), np.ascontiguousarray(t, float)
        out = np.empty((self.size, self.width) if self.width > 1 else self.size)
        if self.width == 1:
            where = np.array([block.ctypes.data], np.uintp)
            self._call(out.ctypes.data, t.flat[0], y.ctypes.data, where.ctypes.data)
        else:
            self._call(out.ctypes.data, t.ctypes.data, y.ctypes.data, block.ctypes.data)
        found, at = {}, 0
        for name, size in self.outputs.items():
            found[name] = out[at : at + size]
            at += size
        return found
