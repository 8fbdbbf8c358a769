"""A kernel: a program in machine code, with the block that it reads."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np

from eomcheck.kernels.code import Code
from eomcheck.kernels.emit import HEADER, Layout, function_texts, layout_of
from eomcheck.kernels.machine import Machine
from eomcheck.kernels.program import Program
from eomcheck.model import Array

CALLS, FAILED = 0, 1
"""Places in the header of a block, integers: calls, and those that were not finite."""

FAILURE_TIME, TIME = 2, 3
"""Places in the header of a block, doubles: the time of the first failure, and the time given."""

SIGNATURE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4)


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
        texts = function_texts("kernel", program, self.layout, places, width)
        if width == 1:
            texts.append(_callback(self.size))
        self.machine = Machine(texts)
        self.address = self.machine.address("kernel")
        self.callback = self.machine.address("callback") if width == 1 else 0
        self._call = SIGNATURE(self.address)

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
        self._call(out.ctypes.data, t.ctypes.data, y.ctypes.data, block.ctypes.data)
        found, at = {}, 0
        for name, size in self.outputs.items():
            found[name] = out[at : at + size]
            at += size
        return found


def _callback(size: int) -> str:
    """Return what CyRK calls: (out, t, y, arguments), where arguments hold the block's address.

    It counts calls, and those in which an output is not finite.
    """
    code = Code()
    block = code.let("load ptr, ptr %arguments")
    time = code.at(block, TIME, "double")
    code.do(f"store double %t, ptr {time}")
    code.do(f"call void @kernel(ptr %out, ptr {time}, ptr %y, ptr {block})")
    calls = code.let(f"load i64, ptr {block}")
    code.do(f"store i64 {code.integer('add', calls, 1)}, ptr {block}")
    wide = Code(8)
    wide.lines, wide.fresh = code.lines, code.fresh  # type: ignore[method-assign]
    total = code.constant(0.0)
    full, left = divmod(size, 8)
    if full:
        # 0 x is 0 unless x is not finite.
        with code.loop(full, (wide.real, "zeroinitializer")) as turn:
            x = wide.load(code.at("%out", code.integer("mul", turn.i, 8)))
            turn.handed[0] = wide.add(turn.carried[0], wide.mul(x, wide.constant(0.0)))
        for i in range(8):
            total = code.add(total, wide.lane(turn.carried[0], i))
    for i in range(left):
        x = code.load("%out", full * 8 + i)
        total = code.add(total, code.mul(x, code.constant(0.0)))
    with code.when(code.compare("une", total, code.constant(0.0))):
        place = code.at(block, FAILED, "i64")
        failed = code.let(f"load i64, ptr {place}")
        when = code.at(block, FAILURE_TIME, "double")
        before = code.let(f"load double, ptr {when}")
        none = code.let(f"icmp eq i64 {failed}, 0")
        code.do(f"store double {code.choose(none, '%t', before)}, ptr {when}")
        code.do(f"store i64 {code.integer('add', failed, 1)}, ptr {place}")
    given = "ptr noalias %out, double %t, ptr noalias %y, ptr noalias %arguments"
    return code.function(f"define void @callback({given}) nounwind")
