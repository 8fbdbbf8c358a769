"""Lists of operations in lanes: each operation is done in all lanes, then comes the next."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.kernels import lane_solves  # noqa: F401  (lanes are solved by it)
from eomcheck.kernels.code import LANES, Code
from eomcheck.kernels.machine import Machine
from eomcheck.numbers.contract import Array
from eomcheck.numbers.entries import map_record
from eomcheck.numbers.lanes import LaneArray, lanes_in, lanes_of
from eomcheck.numbers.noise import NORMAL, Noise
from eomcheck.numbers.pivots import SMALLEST_SIZE

if TYPE_CHECKING:
    from eomcheck.kernels.moved import _List

ADD, SUB, MUL, DIV, NEG = range(5)


def run_in_lanes(listed: _List, noise: Noise | None, given: list[Any]) -> Any:
    """Return what a list comes to for arguments in lanes, its results without noise."""
    count = next(n for n in map(lanes_in, given) if n)
    width = -(-count // LANES) * LANES
    values = np.zeros((listed.places, width))
    values[listed.read :] = listed.start[listed.read :, None]
    first = 0
    for x in given:
        data = lanes_of(x, count).reshape(-1, count)
        values[first : first + len(data), :count] = data
        first += len(data)
    done, last = 0, len(listed.operations)
    for after, function, read, found in listed.groups:
        _through(listed, noise, values, done, after)
        done = after
        result = function(*(LaneArray(values[places, :count], noise) for places in read))
        values[found, :count] = lanes_of(result, count)
    _through(listed, noise, values, done, last)
    return map_record(lambda places: LaneArray(values[places, :count]), listed.found)


def _through(listed: _List, noise: Noise | None, values: Array, first: int, last: int) -> None:
    count = last - first
    if not count:
        return
    operations = np.ascontiguousarray(listed.operations[first:last])
    given = count, operations.ctypes.data, values.ctypes.data, values.shape[1] // LANES
    if noise is None:
        _code(moved=False)(*given, 0)
        return
    changes = np.ascontiguousarray(noise.changes((count,)))
    _code(moved=True)(*given, changes.ctypes.data)


@cache
def _code(moved: bool) -> Callable[[int, int, int, int, int], None]:
    """Return what goes through operations on values (places, lanes), `many` vectors of lanes."""
    code = Code()
    wide = code.wider(LANES)
    with code.loop("%count") as turn:
        first = code.at("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *places = (
            code.let(f"load i64, ptr {code.at(first, i, 'i64')}") for i in range(4)
        )
        row = code.integer("mul", "%many", LANES)
        x, y, to = (code.at("%values", code.integer("mul", place, row)) for place in places)
        change = ""
        if moved:
            one = code.load("%changes", turn.i)
            change = wide.packed([one])
        for number, name in enumerate(("add", "sub", "mul", "div", "neg")):
            is_this = code.let(f"icmp eq i64 {operation}, {number}")
            with code.when(is_this), code.loop("%many") as vector:
                a = wide.load(x, vector.i)
                if number == NEG:
                    result = wide.neg(a)
                else:
                    b = wide.load(y, vector.i)
                    result = getattr(wide, name)(a, b)
                    if number == DIV and moved:
                        zero = wide.compare("oeq", b, wide.constant(0.0))
                        result = wide.choose(zero, wide.constant(float("nan")), result)
                    if moved:
                        # As `LaneNoise.entries` moves them.
                        largest = wide.call("fabs", result)
                        normal = wide.compare("oge", largest, wide.constant(NORMAL))
                        size = wide.choose(normal, largest, wide.constant(SMALLEST_SIZE))
                        result = wide.add(result, wide.mul(change, size))
                wide.store(result, to, vector.i)
    name = "moved_lanes" if moved else "lanes"
    head = "i64 %count, ptr %operations, ptr %values, i64 %many, ptr %changes"
    machine = Machine([code.function(f"define void @{name}({head})")])
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address(name))
    function.machine = machine  # its address holds as long as this lives
    return function
