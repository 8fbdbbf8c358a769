"""Generic functions of doubles, every operation of which is moved by noise of its own.

A function is run once on numbers that list their operations, none merged and none left out but
those that round nothing: x + 0, 0 x and 1 x. The list is then gone through in machine code, for one
noise after another: what noise measures takes many runs, and Python would spend them on objects.
Matrices are multiplied and solved between stretches of the list, as they are in doubles.
"""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import cache, partial
from itertools import chain, count
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from eomcheck.kernels import moved_solves  # noqa: F401  (moved matrices are solved by it)
from eomcheck.kernels.code import Code
from eomcheck.kernels.gathered import Seen, holds_doubles
from eomcheck.numbers.banded import BANDED_SOLVERS, solve_banded
from eomcheck.numbers.contract import Array
from eomcheck.numbers.entries import map_record
from eomcheck.numbers.generic import BRANCH, NotRationalError
from eomcheck.numbers.linear import PRODUCTS, SOLVERS, product, solve
from eomcheck.numbers.noise import NORMAL, Noise

ADD, SUB, MUL, DIV, NEG = range(5)


MOST = 2**21
"""Places in all lists that are kept, but for the newest list."""

FEW = 128
"""Operations that Python does in less time than it takes to have them done in machine code."""


class _Still(Noise):
    """The noise that moves nothing."""

    def changes(self, shape: tuple[int, ...]) -> Array:
        return np.zeros(shape)


STILL = _Still(0)


class Moves:
    """Runs generic functions on doubles with every operation moved.

    What was listed is kept for further runs, with arguments of the same shapes: functions without a
    branch on a value do the same with all numbers.
    """

    def __init__(self):
        self._known: dict[Hashable, _List | None] = {}
        self._places = 0
        self._seen = Seen()
        self._lock = Lock()

    def run(self, noise: Noise, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of arrays of doubles, each of its operations moved.

        Matrices that it solves are moved by the noise of `eomcheck.numbers.linear.watching`. Of
        several noises the first axis of every array of doubles is theirs.

        Raises:
            TypeError: the function does more than rational operations and solves.
        """
        listed, doubles = self._listed(function, arguments, len(noise.shape))
        return _known(function, listed).run(noise, doubles)

    def unmoved(self, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of arrays of doubles as it is, with the bits that Python gives.

        What it makes of objects on the way, such as dual numbers, costs nothing the second time.
        Python does what has few operations, what cannot be listed, and what is not finite: a
        quotient by zero is no number in a list.
        """
        listed, doubles = None, []
        with suppress(Exception):  # what raises there need not raise on doubles
            listed, doubles = self._listed(function, arguments, 0)
        if listed is not None and len(listed.operations) >= FEW:
            found = listed.run(STILL, doubles)
            if _is_finite(found):
                return found
        return function(*arguments)

    def _listed(
        self, function: Callable, arguments: tuple, front: int
    ) -> tuple[_List | None, list[Any]]:
        """Return the list of a function, None if there is none, and the doubles that it reads."""
        doubles: list[Any] = []
        key = function, *(self._seen.key(x, front, doubles) for x in arguments)
        try:
            return self._known[key], doubles
        except KeyError:
            listed = None
            with suppress(TypeError):
                listed = _List(function, arguments, front)
            self._keep(key, listed)
        return listed, doubles

    def _keep(self, key: Hashable, listed: _List | None) -> None:
        with self._lock:
            before = self._known.pop(key, None)
            self._known[key] = listed
            self._places += (listed.places if listed else 0) - (before.places if before else 0)
            while self._places > MOST and len(self._known) > 1:
                forgotten = self._known.pop(next(iter(self._known)))
                self._places -= forgotten.places if forgotten else 0

    def in_lanes(self, noise: Noise | None, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of lanes, each of its operations moved if there is noise.

        Raises:
            TypeError: as `run`.
        """
        from eomcheck.kernels.lane_runs import run_in_lanes

        listed, doubles = self._listed(function, arguments, 0)
        return run_in_lanes(_known(function, listed), noise, doubles)


def _known(function: Callable, listed: _List | None) -> _List:
    if listed is None:
        raise TypeError(f"{function.__qualname__} does more than rational operations")
    return listed


def _is_finite(record: Any) -> bool:
    if isinstance(record, tuple):
        return all(map(_is_finite, record))
    return record is None or bool(np.isfinite(record).all())


class _Group(NamedTuple):
    """What is done with whole matrices: after how many operations, and where they stand."""

    after: int
    function: Callable
    read: list[Array]
    found: Array


class _List:
    """What a function does, operation by operation.

    Places are those of the doubles that it reads, then of literals and results as they come. An
    operation has its number, the places of what it reads, and that of its result.
    """

    def __init__(self, function: Callable, arguments: tuple, front: int):
        self._operations, self._next = array("q"), count().__next__
        self.groups: list[_Group] = []
        self._literals: dict[float, int] = {}
        self.read = 0
        found = function(*map_record(lambda x: self._inputs(x, front), arguments))
        self.found = map_record(self._places, found)
        self.places = self._next()
        self.start = np.empty(self.places)
        self.start[list(self._literals.values())] = list(self._literals)

    def _inputs(self, x: Any, front: int) -> Any:
        if not holds_doubles(x):
            return x
        numbers = self._numbers(x.shape[front:])
        self.read += numbers.size
        return numbers

    def _numbers(self, shape: tuple[int, ...]) -> Array:
        numbers = np.empty(shape, object)
        numbers.ravel()[:] = [_Number(self._next(), self) for _ in range(numbers.size)]
        return numbers

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

    def group(self, function: Callable, shape: tuple[int, ...], *arrays: Array) -> Array:
        """Return the result, of this shape, of a function of arrays of doubles."""
        read, numbers = [self._places(x) for x in arrays], self._numbers(shape)
        after = len(self._operations) // 4
        self.groups.append(_Group(after, function, read, self._places(numbers)))
        return numbers

    @property
    def operations(self) -> Array:
        """Operations (k, 4): see the class."""
        return np.frombuffer(self._operations, np.int64).reshape(-1, 4)

    def run(self, noise: Noise, doubles: list[Array]) -> Any:
        """Return the function's result, arrays of doubles, of arguments of the same shapes."""
        front = noise.shape
        values = np.empty((*front, self.places))
        values[...] = self.start
        if doubles:
            flat = [x.reshape(*front, -1) for x in doubles]
            np.concatenate(flat, axis=-1, out=values[..., : self.read])
        done = 0
        for after, function, read, found in self.groups:
            done = self._through(noise, values, done, after)
            result = function(*(noise.array(values.take(places, axis=-1)) for places in read))
            values[..., found] = result
        self._through(noise, values, done, len(self._operations) // 4)
        return map_record(lambda places: values.take(places, axis=-1), self.found)

    def _through(self, noise: Noise, values: Array, first: int, last: int) -> int:
        """Do the operations from `first` up to `last` on the doubles at their places."""
        count = last - first
        if count:
            operations, _ = self._operations.buffer_info()
            operations += 4 * self._operations.itemsize * first
            changes = np.ascontiguousarray(noise.changes((*noise.shape, count)))
            at, to, run = changes.ctypes.data, values.ctypes.data, _code()
            for i in range(values.size // self.places):
                own, there = at + 8 * count * i, to + 8 * self.places * i
                run(count, operations, own, there)
        return last


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
        if type(other) is int and other in (0, 1):
            return self if other else 0
        return self._with(MUL, other)

    def __truediv__(self, other):
        return self._with(DIV, other)

    def __rtruediv__(self, other):
        if type(other) is int:
            return self.list.add(DIV, self.list.literal(other), self.place)
        return NotImplemented

    def __neg__(self):
        return self.list.add(NEG, self.place, self.place)

    def _compared(self, other=None):
        raise NotRationalError(BRANCH)

    __eq__ = __lt__ = __le__ = __gt__ = __ge__ = __bool__ = _compared
    __hash__ = None  # type: ignore[assignment]

    __radd__ = __add__
    __rmul__ = __mul__


def list_of(*arrays: Array) -> _List | None:
    """Return the list to which entries of arrays belong, None if none does to any."""
    return next((x.list for x in chain(*(a.flat for a in arrays)) if type(x) is _Number), None)


def _list_of(*arrays: Array) -> _List:
    found = list_of(*arrays)
    assert found is not None, "no entry is of a list"
    return found


def _listed(solver: Callable) -> Callable:
    def listed(A: Array, b: Array, name: str) -> Array:
        return _list_of(A, b).group(partial(solver, name=name), b.shape, A, b)

    return listed


def _listed_product(A: Array, B: Array) -> Array:
    return _list_of(A, B).group(product, (A.shape[0], B.shape[1]), A, B)


SOLVERS[_Number], BANDED_SOLVERS[_Number] = _listed(solve), _listed(solve_banded)
PRODUCTS[_Number] = _listed_product


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
