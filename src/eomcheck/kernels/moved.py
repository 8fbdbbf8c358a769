"""Generic functions of doubles, every operation of which is moved by noise of its own.

A function is run once on numbers that list their operations, none merged and none left out but
x + 0. The list is then gone through in machine code, for one noise after another: what noise
measures takes many runs, and Python would spend them on objects.
"""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Callable, Hashable
from functools import cache, partial
from itertools import count
from typing import Any

import numpy as np

from eomcheck.kernels.code import Code
from eomcheck.numbers.contract import Array
from eomcheck.numbers.entries import map_record
from eomcheck.numbers.noise import NORMAL, Noise

ADD, SUB, MUL, DIV, NEG = range(5)


class Moves:
    """Runs generic functions on doubles with every operation moved.

    What was listed is kept for further runs, with arguments of the same shapes.
    """

    def __init__(self):
        self._known: dict[Hashable, _List | None] = {}

    def run(self, noise: Noise, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of arrays of doubles, each of its operations moved.

        Raises:
            TypeError: the function does more than rational operations.
        """
        key = function, map_record(_shape, arguments)
        if key not in self._known:
            self._known[key] = None  # unless it is rational
            self._known[key] = _List(function, arguments)
        listed = self._known[key]
        if listed is None:
            raise TypeError(f"{function.__qualname__} does more than rational operations")
        return listed.run(noise, arguments)


def _is_moved(x: Any) -> bool:
    return isinstance(x, np.ndarray) and x.dtype == np.float64


def _shape(x: Any) -> Hashable:
    return x.shape if _is_moved(x) else x


def _doubles(arguments: tuple) -> list[Array]:
    found: list[Array] = []
    map_record(lambda x: found.append(x.ravel()) if _is_moved(x) else None, arguments)
    return found


class _List:
    """What a function does, operation by operation.

    Places are those of the doubles that it reads, then of literals and results as they come. An
    operation has its number, the places of what it reads, and that of its result.
    """

    def __init__(self, function: Callable, arguments: tuple):
        self._operations, self._next = array("q"), count().__next__
        self._literals: dict[float, int] = {}
        self._read = sum(x.size for x in _doubles(arguments))
        found = function(*map_record(self._inputs, arguments))
        self._found = map_record(self._places, found)
        self._start = np.empty(self._next())
        self._start[list(self._literals.values())] = list(self._literals)

    def _inputs(self, x: Any) -> Any:
        if not _is_moved(x):
            return x
        numbers = np.empty(x.size, object)
        numbers[:] = [_Number(self._next(), self) for _ in range(x.size)]
        return numbers.reshape(x.shape)

    def _places(self, part: Any) -> Array:
        part = np.asarray(part, object)
        places = [x.place if type(x) is _Number else self.literal(x) for x in part.ravel()]
        return np.array(places, np.intp).reshape(part.shape)

    def literal(self, x: float) -> int:
        """Return the place of a literal."""
        x = float(x)
        if x not in self._literals:
            self._literals[x] = self._next()
        return self._literals[x]

    def add(self, operation: int, x: int, y: int) -> _Number:
        """Return the result of an operation on what is at these places."""
        place = self._next()
        self._operations.extend((operation, x, y, place))
        return _Number(place, self)

    def run(self, noise: Noise, arguments: tuple) -> Any:
        """Return the function's result, arrays of doubles, of arguments of the same shapes."""
        values = self._start.copy()
        np.concatenate([np.empty(0), *_doubles(arguments)], out=values[: self._read])
        operations = len(self._operations) // 4
        if operations:
            address, _ = self._operations.buffer_info()
            changes = noise.changes((operations,))
            _code()(operations, address, changes.ctypes.data, values.ctypes.data)
        return map_record(lambda places: np.asarray(values[places]), self._found)


class _Number:
    """A double at a place of a list, to which its operations are added."""

    __slots__ = ("list", "place")

    def __init__(self, place: int, list: _List):
        self.place, self.list = place, list

    # An array must not be taken for a number: `NotImplemented` lets numpy go through its entries.

    def _with(self, operation: int, other: Any) -> Any:
        if type(other) is _Number:
            return self.list.add(operation, self.place, other.place)
        if type(other) is int:
            return self.list.add(operation, self.place, self.list.literal(other))
        return NotImplemented

    def __add__(self, other):
        return self if type(other) is int and other == 0 else self._with(ADD, other)

    def __sub__(self, other):
        return self if type(other) is int and other == 0 else self._with(SUB, other)

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        return self._with(MUL, other)

    def __truediv__(self, other):
        return self._with(DIV, other)

    def __rtruediv__(self, other):
        if type(other) is int:
            return self.list.add(DIV, self.list.literal(other), self.place)
        return NotImplemented

    def __neg__(self):
        return self.list.add(NEG, self.place, self.place)

    __radd__ = __add__
    __rmul__ = __mul__


@cache
def _code() -> Callable[[int, int, int, int], None]:
    """Return what goes through `count` operations with changes and values at these addresses."""
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.machine import Machine

    code = Code()
    with code.loop("%count") as turn:
        first = code.at("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *places, place = (
            code.let(f"load i64, ptr {code.at(first, i, 'i64')}") for i in range(4)
        )
        x, y = (code.load("%values", place) for place in places)
        quotient = code.choose(
            code.compare("oeq", y, code.constant(0.0)),
            code.constant(float("nan")),
            code.div(x, y),
        )
        rounded = code.add(x, y)
        is_one = partial("icmp eq i64 {}, {}".format, operation)
        for number, result in (
            (SUB, code.sub(x, y)),
            (MUL, code.mul(x, y)),
            (DIV, quotient),
        ):
            rounded = code.choose(code.let(is_one(number)), result, rounded)
        # As `Noise.entries` moves them.
        size = code.call("maxnum", code.call("fabs", rounded), code.constant(NORMAL))
        change = code.mul(code.load("%changes", turn.i), size)
        moved = code.add(rounded, change)
        code.store(
            code.choose(code.let(is_one(NEG)), code.neg(x), moved),
            "%values",
            place,
        )
    machine = Machine(
        [
            code.function(
                "define void @moved(i64 %count, ptr %operations, ptr %changes, ptr %values)"
            )
        ]
    )
    kinds = ctypes.c_int64, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address("moved"))
    function.machine = machine  # its address holds as long as this lives
    return function
