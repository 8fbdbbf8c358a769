"""A tape: what the generic functions do with numbers, written down as a straight-line program.

Run once on a `Tape`, a function leaves its additions, multiplications and solves there, in the
order in which it did them. Equal operations are merged, those on constants are done at once and
those that change nothing left out (x + 0, 1 x, and 0 x = 0: an infinity in a dead factor vanishes).
Nothing is reassociated, so that what runs the tape rounds as the functions themselves do.
`eomcheck.kernels` makes machine code of it.

What is more than one operation is a group, with the references that it reads and results that are
read by place: the cosines and sines of angles, a matrix factored and solved with, a product of
matrices too large to be written out.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from eomcheck.numbers.banded import BANDED_SOLVERS
from eomcheck.numbers.contract import Angles, Array
from eomcheck.numbers.entries import each
from eomcheck.numbers.generic import BRANCH, NotRationalError, product_of
from eomcheck.numbers.linear import CARRIERS, PRODUCTS, SOLVERS

ADD, SUB, MUL, DIV, NEG, SQRT = "+", "-", "*", "/", "neg", "sqrt"
CONSTANT, INPUT, PART = "constant", "input", "part"

ANGLES, FACTORS, SOLVE, BAND, PRODUCT = "angles", "factors", "solve", "band", "product"
"""Kinds of groups."""

DOUBLES = {ADD: operator.add, SUB: operator.sub, MUL: operator.mul}

WRITTEN_OUT = 4096
"""A product of matrices with more multiplications than this is one group."""


class Operation(NamedTuple):
    """One entry of a tape: x and y are places of earlier entries.

    A constant has its value as x, an input the name of its array and its place there, a part its
    group and its place among the results.
    """

    op: str
    x: Any = None
    y: Any = None


class Group(NamedTuple):
    """Several results at once, made of the entries `reads`.

    - "angles": cosines, then sines, of k angles
    - "factors": of a matrix (k, k), row by row; its results are read by solves only
    - "solve": x (k, m) by the factors of the group `by`; reads b (k, m)
    - "band": x (k,) of bands (k, 7) and then b (k,), see `eomcheck.numbers.banded`
    - "product": (k, m) of matrices (k, l) and (l, m)
    """

    kind: str
    name: str
    shape: tuple[int, ...]
    reads: tuple[int, ...]
    by: int = -1


class Tape:
    """The arithmetic that writes down (`eomcheck.numbers.contract.Arithmetic`).

    Attributes:
        operations: entry by entry.
        groups: what parts belong to.
    """

    def __init__(self):
        self.operations: list[Operation] = []
        self.groups: list[Group] = []
        self._places: dict[Operation, int] = {}
        self._known_groups: dict[Group, int] = {}

    def place(self, operation: Operation) -> int:
        """Return the place of an operation, where equal ones are one."""
        found = self._places.get(operation)
        if found is None:
            found = self._places[operation] = len(self.operations)
            self.operations.append(operation)
        return found

    def constant(self, x: float) -> Number:
        """Return a constant."""
        # 0.0 and -0.0 are equal, and both are found again as the first of them.
        return Number(self, self.place(Operation(CONSTANT, float(x))))

    def inputs(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return the inputs called `name`, an array of `shape`."""
        places = (self.place(Operation(INPUT, name, i)) for i in range(math.prod(shape)))
        return self._array(places, shape)

    def number(self, x: Any) -> Number:
        """Return x, a literal or a double, as a number of this tape."""
        return x if isinstance(x, Number) else self.constant(x)

    def numbers(self, x: Array) -> Array:
        """Return x, same shape."""
        return each(self.number, np.asarray(x, object))

    def value(self, place: int) -> float | None:
        """Return the value of the entry at `place` if it is a constant."""
        operation = self.operations[place]
        return operation.x if operation.op is CONSTANT else None

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        known = [self.value(y.place) for y in x]
        values = [y for y in known if y is not None]
        if len(values) < len(known):
            both = self.group(ANGLES, "", (len(x),), self._read(x), 2 * len(x))
            return Angles(x, both[: len(x)], both[len(x) :])
        functions = math.cos, math.sin
        return Angles(x, *(self.numbers(np.array([f(y) for y in values])) for f in functions))

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,)."""
        return each(lambda y: self.number(y).sqrt(), x)

    def group(
        self, kind: str, name: str, shape: tuple[int, ...], reads: tuple[int, ...], parts: int,
        by: int = -1,
    ) -> Array:  # fmt: skip
        """Return the results (parts,) of a group; equal ones are one."""
        number = self.group_number(Group(kind, name, shape, reads, by))
        return self._array((self.place(Operation(PART, number, i)) for i in range(parts)), (parts,))

    def group_number(self, group: Group) -> int:
        """Return the number of a group, where equal ones are one."""
        found = self._known_groups.get(group)
        if found is None:
            found = self._known_groups[group] = len(self.groups)
            self.groups.append(group)
        return found

    def _read(self, *arrays: Array) -> tuple[int, ...]:
        return tuple(self.number(x).place for x in chain.from_iterable(a.flat for a in arrays))

    def _array(self, places: Iterable[int], shape: tuple[int, ...]) -> Array:
        out = np.empty(math.prod(shape), object)
        out[:] = [Number(self, place) for place in places]
        return out.reshape(shape)

    def solve(self, A: Array, b: Array, name: str) -> Array:
        """Return x with A x = b, in the shape of b (k,) or (k, m)."""
        size = len(A)
        factors = self.group_number(Group(FACTORS, name, (size,), self._read(A)))
        shape = (size, b.size // size)
        x = self.group(SOLVE, name, shape, self._read(b), b.size, by=factors)
        return x.reshape(b.shape)

    def solve_banded(self, bands: Array, b: Array, name: str) -> Array:
        """Return x (k,) of bands (k, 7)."""
        return self.group(BAND, name, (len(b),), self._read(bands, b), len(b))

    def product(self, A: Array, B: Array) -> Array:
        """Return A B (k, m), B (l, m): one group unless it is small."""
        if A.size * B.shape[1] <= WRITTEN_OUT:
            return A @ B
        shape = (len(A), *B.shape)
        x = self.group(PRODUCT, "", shape, self._read(A, B), len(A) * B.shape[1])
        return x.reshape(len(A), B.shape[1])


class Number:
    """A number on a tape."""

    __slots__ = ("place", "tape")

    def __init__(self, tape: Tape, place: int):
        self.tape, self.place = tape, place

    def __add__(self, other):
        return _operated(ADD, self, other)

    def __radd__(self, other):
        return _operated(ADD, other, self)

    def __sub__(self, other):
        return _operated(SUB, self, other)

    def __rsub__(self, other):
        return _operated(SUB, other, self)

    def __mul__(self, other):
        return _operated(MUL, self, other)

    def __rmul__(self, other):
        return _operated(MUL, other, self)

    def __truediv__(self, other):
        return _operated(DIV, self, other)

    def __rtruediv__(self, other):
        return _operated(DIV, other, self)

    def __pow__(self, power):
        return product_of(self, power)

    def __neg__(self):
        tape = self.tape
        operation = tape.operations[self.place]
        if operation.op is CONSTANT:
            return tape.constant(-operation.x)
        if operation.op is NEG:
            return Number(tape, operation.x)
        return Number(tape, tape.place(Operation(NEG, self.place)))

    def __pos__(self):
        return self

    def sqrt(self):
        """Return the positive square root."""
        known = self.tape.value(self.place)
        if known is not None:
            return self.tape.constant(float(np.sqrt(known)))
        return Number(self.tape, self.tape.place(Operation(SQRT, self.place)))

    def cos(self):
        """Return the cosine of an angle, rad."""
        return self.tape.angles(np.array([self], object)).cos[0]

    def sin(self):
        """Return the sine of an angle, rad."""
        return self.tape.angles(np.array([self], object)).sin[0]

    def _compared(self, other=None):
        raise NotRationalError(BRANCH)

    def __float__(self):
        raise NotRationalError("a number of the model in an array of doubles: give it their dtype")

    __eq__ = __lt__ = __le__ = __gt__ = __ge__ = __bool__ = __abs__ = _compared
    __hash__ = None  # type: ignore[assignment]


def _operated(op: str, x: Any, y: Any) -> Any:
    if isinstance(x, np.ndarray) or isinstance(y, np.ndarray):
        return NotImplemented
    tape = x.tape if isinstance(x, Number) else y.tape
    if not isinstance(x, Number | int | float | np.number):
        return NotImplemented
    if not isinstance(y, Number | int | float | np.number):
        return NotImplemented
    x, y = tape.number(x), tape.number(y)
    a, b = tape.value(x.place), tape.value(y.place)
    if a is not None and b is not None:
        with np.errstate(all="ignore"):
            return tape.constant(_quotient(a, b) if op is DIV else DOUBLES[op](a, b))
    return _simplified(tape, op, x, y, a, b)


def _simplified(tape: Tape, op: str, x: Number, y: Number, a: float | None, b: float | None) -> Any:
    """Return x op y, whose constant values are a and b, not both of them."""
    if op is ADD:
        if a == 0 or b == 0:
            return y if a == 0 else x
        if tape.operations[y.place].op is NEG:
            return _operated(SUB, x, -y)
        if tape.operations[x.place].op is NEG:
            return _operated(SUB, y, -x)
        if (found := tape._places.get(Operation(ADD, y.place, x.place))) is not None:
            return Number(tape, found)
    elif op is SUB:
        if a == 0 or b == 0:
            return -y if a == 0 else x
        if tape.operations[y.place].op is NEG:
            return _operated(ADD, x, -y)
    elif op is MUL:
        if a == 0 or b == 0:
            return tape.constant(0.0)
        for one, other in ((a, y), (b, x)):
            if one is not None and abs(one) == 1:
                return other if one > 0 else -other
        # Signs move outwards, where sums take them in: `-x` by itself would be one value that
        # is first needed somewhere, and break the pattern of those that need it later.
        if (plain := _unsigned(x, y)) is not None:
            return -_operated(MUL, *plain)
        if (found := tape._places.get(Operation(MUL, y.place, x.place))) is not None:
            return Number(tape, found)
    else:
        if a == 0:
            return tape.constant(0.0)
        if b is not None and abs(math.frexp(b)[0]) == 0.5 and 2.0**-1000 < abs(b) < 2.0**1000:
            return _operated(MUL, x, 1.0 / b)  # exact: a power of two
        if (plain := _unsigned(x, y)) is not None:
            return -_operated(DIV, *plain)
    return Number(tape, tape.place(Operation(op, x.place, y.place)))


def _unsigned(x: Number, y: Number) -> tuple[Number, Number] | None:
    """Return x and y, one of them without its sign; None where neither has one."""
    operations = x.tape.operations
    if operations[x.place].op is NEG:
        return -x, y
    if operations[y.place].op is NEG:
        return x, -y
    return None


def _quotient(a: float, b: float) -> float:
    return float(np.float64(a) / np.float64(b))


def _tape_of(*arrays: Array) -> Tape:
    return next(x.tape for x in chain(*(a.flat for a in arrays)) if isinstance(x, Number))


def _solve(A: Array, b: Array, name: str) -> Array:
    return _tape_of(A, b).solve(A, b, name)


def _solve_banded(bands: Array, b: Array, name: str) -> Array:
    return _tape_of(bands, b).solve_banded(bands, b, name)


def _product(A: Array, B: Array) -> Array:
    return _tape_of(A, B).product(A, B)


SOLVERS[Number], BANDED_SOLVERS[Number], PRODUCTS[Number] = _solve, _solve_banded, _product
CARRIERS.add(Number)


def live(tape: Tape, roots: Sequence[int]) -> tuple[list[int], set[int]]:
    """Return the entries that `roots` are made of, in their order, and the groups among them."""
    needed, groups, stack = set(), set(), list(roots)
    while stack:
        place = stack.pop()
        if place in needed:
            continue
        needed.add(place)
        operation = tape.operations[place]
        if operation.op is PART:
            number = operation.x
            while number >= 0 and number not in groups:
                groups.add(number)
                stack.extend(tape.groups[number].reads)
                number = tape.groups[number].by
        elif operation.op not in (CONSTANT, INPUT):
            stack.append(operation.x)
            if operation.y is not None:
                stack.append(operation.y)
    return sorted(needed), groups
