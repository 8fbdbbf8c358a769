"""A kernel: a program in machine code, with the block that it reads."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eomcheck.kernels.emit import function_texts
from eomcheck.kernels.layout import FAILURE_TIME, HEADER, Layout, layout_of
from eomcheck.kernels.machine import EFFORT, Machine, memory
from eomcheck.kernels.program import Program
from eomcheck.kernels.repeat import along
from eomcheck.numbers.contract import Array


class Kernel:
    """A function of (t, y) and parameters in machine code.

    Args:
        program: what it does.
        parameters: number of entries of each parameter, by name.
        outputs: number of entries of each output, by name.
        width: lanes.
        effort: LLVM's in generating code.
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
        self.machine = Machine(texts, effort)
        self.address = self.machine.address("kernel")

    def block(self, parameters: Mapping[str, Array]) -> Array:
        """Return a block with these parameters, each (size,), or (size, lanes)."""
        block = memory(self.layout.doubles(self.width), HEADER)
        block[FAILURE_TIME] = np.nan
        for name, size in self.parameters.items():
            first = HEADER + self.layout.places[name] * self.width
            room = block[first : first + size * self.width].reshape(size, self.width)
            given = np.asarray(parameters[name], float)
            room[:] = given if given.ndim == 2 else given[:, None]
        return block

    def handed(self, block: Array) -> Array:
        """Return that whose address the function gets with this block, which is to be kept."""
        return np.array([block.ctypes.data], np.uintp) if self.width == 1 else block

    def __call__(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs, each (size,), or (size, lanes), of a state y and times t (lanes,)."""
        found = self.rows(block, t.reshape(1, -1), y[None])
        return {name: x[0] if self.width > 1 else x[0, :, 0] for name, x in found.items()}

    def rows(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return outputs (k, size, lanes) at times t (k, lanes) of states y (k, _, lanes)."""
        y, t = np.ascontiguousarray(y, float), np.ascontiguousarray(t, float)
        out = np.empty((len(y), self.size, self.width))
        along(self.address, self.handed(block), t, y, out)
        ends = np.cumsum(list(self.outputs.values()))[:-1]
        return dict(zip(self.outputs, np.split(out, ends, axis=1), strict=True))
