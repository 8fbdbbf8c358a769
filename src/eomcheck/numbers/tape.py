"""Tapes: the operations of generic functions as a straight-line program, and its derivatives.

A tape is the sequence of operations that a function performs on the numbers of a `Tape`: it is run
once, and its additions, multiplications and solves are recorded in their order. Equal operations
are merged (common subexpressions), those on constants are evaluated at once, and those that change
nothing are left out (x + 0, 1 x, and 0 x = 0: an infinity in a dead factor vanishes). Nothing is
reassociated, so that the compiled tape rounds as the functions themselves do. `eomcheck.kernels`
compiles it to machine code.

A group is an entry with several results, which are read by index: the cosines and sines of angles,
a matrix factored and solved with, a product of matrices too large to be written out.

`jacobian` appends derivatives to the same tape (forward automatic differentiation), entry by entry,
and only by the inputs that an entry depends on: most of a Jacobian of a chain's functions is
structurally zero. A solve is differentiated as A x′ = b′ - A′ x, with the factors of A that are
already on the tape.
"""

from __future__ import annotations

import math
import operator
from collections import defaultdict
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.numbers.banded_solve import BANDED_SOLVERS
from eomcheck.numbers.generic import (
    BRANCH,
    Angles,
    Array,
    NotRationalError,
    map_entries,
    product_of,
)
from eomcheck.numbers.linear import CARRIERS, PRODUCTS, SOLVERS

# ---- Tapes ---------------------------------------------------------------------------------------

ADD, SUB, MUL, DIV, NEG, SQRT = "+", "-", "*", "/", "neg", "sqrt"
CONSTANT, INPUT, PART = "constant", "input", "part"

ANGLES, FACTORS, SOLVE, BAND, PRODUCT = "angles", "factors", "solve", "band", "product"
"""Kinds of groups."""

FLOAT64_OPERATIONS = {ADD: operator.add, SUB: operator.sub, MUL: operator.mul}

LARGEST_EXPANDED_PRODUCT = 4096
"""Largest number of multiplications of a matrix product that is written out; above, a group."""


class Operation(NamedTuple):
    """An entry of a tape: x and y are indices of earlier entries.

    For a constant x is its value; for an input x is the name of its array and y its index there;
    for a part x is the number of its group and y its index among the results.
    """

    op: str
    x: Any = None
    y: Any = None


class OperationGroup(NamedTuple):
    """An operation with several results, computed from the entries `reads`.

    - "angles": cosines, then sines, of k angles
    - "factors": LU factors of a matrix (k, k), row by row; its results are read by solves only
    - "solve": x (k, m) by the factors of the group `by`; reads b (k, m)
    - "band": x (k,) of bands (k, 7) and then b (k,), see `eomcheck.numbers.banded_solve`
    - "product": (k, m) of matrices (k, l) and (l, m)
    """

    kind: str
    name: str
    shape: tuple[int, ...]
    reads: tuple[int, ...]
    by: int = -1


class Tape:
    """The arithmetic that records operations (`eomcheck.numbers.generic.Arithmetic`).

    Attributes:
        operations: the entries.
        groups: the groups to which parts belong.
    """

    def __init__(self):
        self.operations: list[Operation] = []
        self.groups: list[OperationGroup] = []
        self._places: dict[Operation, int] = {}
        self._known_groups: dict[OperationGroup, int] = {}

    def index_of(self, operation: Operation) -> int:
        """Return the index of an operation, which is appended unless an equal one is recorded."""
        index = self._places.get(operation)
        if index is None:
            index = self._places[operation] = len(self.operations)
            self.operations.append(operation)
        return index

    def constant(self, x: float) -> Number:
        """Return a constant of this tape."""
        # 0.0 and -0.0 are equal as keys: both are the one that was recorded first.
        return Number(self, self.index_of(Operation(CONSTANT, float(x))))

    def inputs(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return the inputs called `name`, an array of `shape`."""
        indices = (self.index_of(Operation(INPUT, name, i)) for i in range(math.prod(shape)))
        return self._array(indices, shape)

    def number(self, x: Any) -> Number:
        """Return x, a literal or a float64, as a number of this tape."""
        return x if isinstance(x, Number) else self.constant(x)

    def numbers(self, x: Array) -> Array:
        """Return x as numbers of this tape, same shape."""
        return map_entries(self.number, np.asarray(x, object))

    def value(self, index: int) -> float | None:
        """Return the value of the entry at `index` if it is a constant, otherwise None."""
        operation = self.operations[index]
        return operation.x if operation.op is CONSTANT else None

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        known = [self.value(y.index) for y in x]
        values = [y for y in known if y is not None]
        if len(values) < len(known):
            both = self.group(ANGLES, "", (len(x),), self._read(x), 2 * len(x))
            return Angles(x, both[: len(x)], both[len(x) :])
        functions = math.cos, math.sin
        return Angles(x, *(self.numbers(np.array([f(y) for y in values])) for f in functions))

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,)."""
        return map_entries(lambda y: self.number(y).sqrt(), x)

    def operated(self, op: str, x: Any, y: Any) -> Any:
        """Return x op y of numbers of this tape, one of which may be a literal or a float64."""
        known = Number | int | float | np.number
        if not (isinstance(x, known) and isinstance(y, known)):
            return NotImplemented
        x, y = self.number(x), self.number(y)
        a, b = self.value(x.index), self.value(y.index)
        if a is not None and b is not None:
            with np.errstate(all="ignore"):
                return self.constant(_quotient(a, b) if op is DIV else FLOAT64_OPERATIONS[op](a, b))
        return _simplified(self, op, x, y, a, b)

    def negated(self, x: Number) -> Number:
        """Return -x."""
        operation = self.operations[x.index]
        if operation.op is CONSTANT:
            return self.constant(-operation.x)
        if operation.op is NEG:
            return Number(self, operation.x)
        return Number(self, self.index_of(Operation(NEG, x.index)))

    def group(
        self, kind: str, name: str, shape: tuple[int, ...], reads: tuple[int, ...], parts: int,
        by: int = -1,
    ) -> Array:  # fmt: skip
        """Return the results (parts,) of a group; equal groups are merged."""
        number = self.group_number(OperationGroup(kind, name, shape, reads, by))
        return self._array(
            (self.index_of(Operation(PART, number, i)) for i in range(parts)), (parts,)
        )

    def group_number(self, group: OperationGroup) -> int:
        """Return the number of a group, which is appended unless an equal one is recorded."""
        number = self._known_groups.get(group)
        if number is None:
            number = self._known_groups[group] = len(self.groups)
            self.groups.append(group)
        return number

    def _read(self, *arrays: Array) -> tuple[int, ...]:
        return tuple(self.number(x).index for x in chain.from_iterable(a.flat for a in arrays))

    def _array(self, indices: Iterable[int], shape: tuple[int, ...]) -> Array:
        out = np.empty(math.prod(shape), object)
        out[:] = [Number(self, index) for index in indices]
        return out.reshape(shape)

    def solve(self, A: Array, b: Array, name: str) -> Array:
        """Return x with A x = b, in the shape of b (k,) or (k, m)."""
        size = len(A)
        factors = self.group_number(OperationGroup(FACTORS, name, (size,), self._read(A)))
        shape = (size, b.size // size)
        x = self.group(SOLVE, name, shape, self._read(b), b.size, by=factors)
        return x.reshape(b.shape)

    def solve_banded(self, bands: Array, b: Array, name: str) -> Array:
        """Return x (k,) with A x = b, for A by its bands (k, 7) and b (k,)."""
        return self.group(BAND, name, (len(b),), self._read(bands, b), len(b))

    def product(self, A: Array, B: Array) -> Array:
        """Return A B (k, m), B (l, m): one group unless it is small."""
        if A.size * B.shape[1] <= LARGEST_EXPANDED_PRODUCT:
            return A @ B
        shape = (len(A), *B.shape)
        x = self.group(PRODUCT, "", shape, self._read(A, B), len(A) * B.shape[1])
        return x.reshape(len(A), B.shape[1])


class RecordedNumber:
    """A number whose operations its tape records: `operated` and `negated` of the tape.

    Attributes:
        index: that of its entry.
        tape: the tape.
    """

    __slots__ = ("index", "tape")

    def __init__(self, tape: Any, index: int):
        self.tape, self.index = tape, index

    def __add__(self, other):
        return self.tape.operated(ADD, self, other)

    def __radd__(self, other):
        return self.tape.operated(ADD, other, self)

    def __sub__(self, other):
        return self.tape.operated(SUB, self, other)

    def __rsub__(self, other):
        return self.tape.operated(SUB, other, self)

    def __mul__(self, other):
        return self.tape.operated(MUL, self, other)

    def __rmul__(self, other):
        return self.tape.operated(MUL, other, self)

    def __truediv__(self, other):
        return self.tape.operated(DIV, self, other)

    def __rtruediv__(self, other):
        return self.tape.operated(DIV, other, self)

    def __neg__(self):
        return self.tape.negated(self)

    def _compared(self, other=None):
        raise NotRationalError(BRANCH)

    __eq__ = __lt__ = __le__ = __gt__ = __ge__ = __bool__ = _compared
    __hash__ = None  # type: ignore[assignment]


class Number(RecordedNumber):
    """A number that is recorded on a `Tape`."""

    __slots__ = ()
    tape: Tape

    def __pow__(self, power):
        return product_of(self, power)

    def __pos__(self):
        return self

    def sqrt(self):
        """Return the positive square root."""
        known = self.tape.value(self.index)
        if known is not None:
            return self.tape.constant(float(np.sqrt(known)))
        return Number(self.tape, self.tape.index_of(Operation(SQRT, self.index)))

    def cos(self):
        """Return the cosine of an angle, rad."""
        return self.tape.angles(np.array([self], object)).cos[0]

    def sin(self):
        """Return the sine of an angle, rad."""
        return self.tape.angles(np.array([self], object)).sin[0]

    def __float__(self):
        raise NotRationalError("a number of the model in an array of doubles: give it their dtype")

    __abs__ = RecordedNumber._compared


def _simplified(tape: Tape, op: str, x: Number, y: Number, a: float | None, b: float | None) -> Any:
    """Return x op y; a and b are the values of x and y if constant, at most one of which is."""
    if op is ADD:
        if a == 0 or b == 0:
            return y if a == 0 else x
        if tape.operations[y.index].op is NEG:
            return tape.operated(SUB, x, -y)
        if tape.operations[x.index].op is NEG:
            return tape.operated(SUB, y, -x)
        if (known := tape._places.get(Operation(ADD, y.index, x.index))) is not None:
            return Number(tape, known)
    elif op is SUB:
        if a == 0 or b == 0:
            return -y if a == 0 else x
        if tape.operations[y.index].op is NEG:
            return tape.operated(ADD, x, -y)
    elif op is MUL:
        if a == 0 or b == 0:
            return tape.constant(0.0)
        for factor, other in ((a, y), (b, x)):
            if factor is not None and abs(factor) == 1:
                return other if factor > 0 else -other
        # Signs are moved outwards, into sums: a merged `-x` would be computed where it is first
        # used, and break the pattern of the iterations that use it later.
        if (plain := _unsigned(x, y)) is not None:
            return -tape.operated(MUL, *plain)
        if (known := tape._places.get(Operation(MUL, y.index, x.index))) is not None:
            return Number(tape, known)
    else:
        if a == 0:
            return tape.constant(0.0)
        if b is not None and abs(math.frexp(b)[0]) == 0.5 and 2.0**-1000 < abs(b) < 2.0**1000:
            return tape.operated(MUL, x, 1.0 / b)  # exact: a power of two
        if (plain := _unsigned(x, y)) is not None:
            return -tape.operated(DIV, *plain)
    return Number(tape, tape.index_of(Operation(op, x.index, y.index)))


def _unsigned(x: Number, y: Number) -> tuple[Number, Number] | None:
    """Return x and y with the sign of one of them removed; None if neither is negated."""
    operations = x.tape.operations
    if operations[x.index].op is NEG:
        return -x, y
    if operations[y.index].op is NEG:
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


def live_entries(tape: Tape, roots: Sequence[int]) -> tuple[list[int], set[int]]:
    """Return the entries on which `roots` depend, in order, and the groups among them."""
    needed, groups, stack = set(), set(), list(roots)
    while stack:
        index = stack.pop()
        if index in needed:
            continue
        needed.add(index)
        operation = tape.operations[index]
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


# ---- Derivatives ---------------------------------------------------------------------------------

Rates = dict[int, Any]
"""Derivatives of an entry: position of the input among `inputs` -> number of the tape."""


def jacobian(tape: Tape, outputs: Sequence[int], inputs: Sequence[int]) -> list[int]:
    """Append the derivatives ∂output/∂input to the tape, and return their indices, row by row."""
    wanted = {index: i for i, index in enumerate(inputs)}
    rates: dict[int, Rates] = {}
    groups: dict[int, list[Rates]] = {}
    for index in live_entries(tape, outputs)[0]:
        rates[index] = {wanted[index]: 1} if index in wanted else _rates(tape, index, rates, groups)
    zero = tape.constant(0.0).index
    return [
        tape.number(rates[index][i]).index if i in rates[index] else zero
        for index in outputs
        for i in range(len(inputs))
    ]


def _rates(
    tape: Tape, index: int, rates: dict[int, Rates], groups: dict[int, list[Rates]]
) -> Rates:
    op, x, y = tape.operations[index]
    if op in (CONSTANT, INPUT):
        return {}
    if op is PART:
        if x not in groups:
            groups[x] = _group_rates(tape, x, rates)
        return groups[x][y]
    result, first = Number(tape, index), Number(tape, x)
    if op is NEG:
        return {i: -d for i, d in rates[x].items()}
    if op is SQRT:
        return {i: d / (2 * result) for i, d in rates[x].items()}
    second = Number(tape, y)
    rate = {
        ADD: lambda d, e: d + e,
        SUB: lambda d, e: d - e,
        MUL: lambda d, e: d * second + first * e,
        DIV: lambda d, e: (d - result * e) / second,
    }[op]
    inputs = sorted(rates[x].keys() | rates[y].keys())
    return {i: rate(rates[x].get(i, 0), rates[y].get(i, 0)) for i in inputs}


def _group_rates(tape: Tape, number: int, rates: dict[int, Rates]) -> list[Rates]:
    """Return the derivatives of each part of a group."""
    kind, name, shape, reads, by = tape.groups[number]
    if kind is ANGLES:
        cos, sin = np.split(_parts(tape, number, 2 * len(reads)), 2)
        turning = [rates[index] for index in reads]
        return [{i: -s * d for i, d in r.items()} for s, r in zip(sin, turning, strict=True)] + [
            {i: c * d for i, d in r.items()} for c, r in zip(cos, turning, strict=True)
        ]
    if kind is PRODUCT:
        rows, inner, columns = shape
        A, B = _numbers(tape, reads[: rows * inner]), _numbers(tape, reads[rows * inner :])
        A, B = A.reshape(rows, inner), B.reshape(inner, columns)
        left, right = _entry_rates(rates, reads[: A.size]), _entry_rates(rates, reads[A.size :])
        return _collected(
            rows * columns,
            {
                i: _matrix(left, i, A.shape) @ B + A @ _matrix(right, i, B.shape)
                for i in sorted(left.keys() | right.keys())
            },
        )
    if kind is BAND:
        size = shape[0]
        x = _parts(tape, number, size)
        bands = _numbers(tape, reads[: 7 * size]).reshape(size, 7)
        left, right = _entry_rates(rates, reads[: 7 * size]), _entry_rates(rates, reads[7 * size :])
        extended = np.concatenate((np.zeros(3, object), x, np.zeros(3, object)))
        solutions = {}
        for i in sorted(left.keys() | right.keys()):
            change = _matrix(left, i, (size, 7))
            products = [change[k] @ extended[k : k + 7] for k in range(size)]
            b = _matrix(right, i, (size,)) - np.array(products, object)
            solutions[i] = tape.solve_banded(bands, map_entries(tape.number, b), name)
        return _collected(size, solutions)
    size, columns = shape
    x = _parts(tape, number, size * columns).reshape(size, columns)
    entries = tape.groups[by].reads
    A = _numbers(tape, entries).reshape(size, size)
    left, right = _entry_rates(rates, entries), _entry_rates(rates, reads)
    inputs = sorted(left.keys() | right.keys())
    if not inputs:
        return [{} for _ in range(size * columns)]
    # All right-hand sides at once, by the recorded factors.
    b = [_matrix(right, i, x.shape) - _matrix(left, i, A.shape) @ x for i in inputs]
    solved = tape.solve(A, map_entries(tape.number, np.hstack(b)), name).view(np.ndarray)
    parts = np.hsplit(solved, len(inputs))
    return _collected(size * columns, dict(zip(inputs, parts, strict=True)))


def _parts(tape: Tape, number: int, count: int) -> np.ndarray:
    return _numbers(tape, [tape.index_of(Operation(PART, number, i)) for i in range(count)])


def _numbers(tape: Tape, indices: Sequence[int]) -> np.ndarray:
    out = np.empty(len(indices), object)
    out[:] = [Number(tape, index) for index in indices]
    return out


def _entry_rates(rates: dict[int, Rates], indices: Sequence[int]) -> dict[int, dict[int, Any]]:
    """Return input -> (entry -> derivative) for the entries that depend on the input."""
    by_input: dict[int, dict[int, Any]] = defaultdict(dict)
    for entry, index in enumerate(indices):
        for i, rate in rates[index].items():
            by_input[i][entry] = rate
    return by_input


def _matrix(moving: dict[int, dict[int, Any]], i: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return the derivatives by input i as an array; 0 for entries that do not depend on it."""
    out = np.zeros(shape, object)
    for entry, rate in moving.get(i, {}).items():
        out.flat[entry] = rate
    return out


def _collected(parts: int, by_input: dict[int, np.ndarray]) -> list[Rates]:
    """Return the derivatives of each part, from those of all parts by input."""
    out: list[Rates] = [{} for _ in range(parts)]
    for i, values in by_input.items():
        for part, value in enumerate(np.ravel(values)):
            if not (isinstance(value, int) and value == 0):
                out[part][i] = value
    return out


__getattr__ = getattr_of(__name__)
