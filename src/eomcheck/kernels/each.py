"""LAPACK in many lanes: one routine for one matrix after another, in a loop of machine code.

It is the LAPACK that `eomcheck.numbers.linear` calls for one matrix, with the same bits.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from eomcheck.kernels.code import Code
from eomcheck.kernels.dense import address_of
from eomcheck.kernels.machine import Machine


@cache
def _loop(arity: int) -> Callable[[int, int, int], None]:
    """Return what calls a function of `arity` addresses `count` times, each moved by its stride."""
    code = Code()
    table = [
        (
            code.let(f"load i64, ptr {code.at('%table', 2 * i, 'i64')}"),
            code.let(f"load i64, ptr {code.at('%table', 2 * i + 1, 'i64')}"),
        )
        for i in range(arity)
    ]
    with code.loop("%count") as turn:
        places = []
        for start, stride in table:
            place = code.integer("add", start, code.integer("mul", turn.i, stride))
            places.append(code.let(f"inttoptr i64 {place} to ptr"))
        code.do(f"call void %function({', '.join(f'ptr {place}' for place in places)})")
    name = f"each{arity}"
    machine = Machine(
        [code.function(f"define void @{name}(i64 %count, ptr %function, ptr %table)")]
    )
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address(name))
    function.machine = machine  # its address holds as long as this lives
    return function


def each(routine: str, *arguments: Any) -> None:
    """Call a routine of LAPACK for each lane.

    Args:
        routine: its name, such as "dgetrf".
        arguments: arrays whose first axis is that of the lanes, which the routine writes into; or
            for all lanes alike a whole number, a letter, or a list of one array as room for work.
    """
    count, table, kept = 0, [], []
    for x in arguments:
        if isinstance(x, np.ndarray):
            count = len(x)
            table += [x.ctypes.data, x.strides[0]]
            continue
        if isinstance(x, list):
            same = x[0]
        elif isinstance(x, str):
            same = np.array([ord(x)], np.int8)
        else:
            same = np.array([x], np.int32 if isinstance(x, int) else np.float64)
        kept.append(same)
        table += [same.ctypes.data, 0]
    addresses = np.array(table, np.int64)
    if count:
        _loop(len(arguments))(count, address_of("lapack", routine), addresses.ctypes.data)
