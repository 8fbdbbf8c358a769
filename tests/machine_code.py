"""Any generic function in machine code; and what stands on a tape, run in Python."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from eomcheck.kernels.kernel import HEADER, Kernel
from eomcheck.kernels.program import SHORT, program_of
from eomcheck.numbers import tape as tapes
from eomcheck.numbers.banded_solve import WIDTH, to_dense
from eomcheck.numbers.generic import Array
from eomcheck.numbers.tape import Tape, live_entries


def leaves(x: Any) -> Iterator[Any]:
    """Yield the arrays in records, one after the other."""
    if isinstance(x, tuple):
        for part in x:
            yield from leaves(part)
    elif x is not None:
        yield x


def rebuilt(x: Any, with_leaves: Iterator[Any]) -> Any:
    """Return x with other arrays in it."""
    if isinstance(x, tuple):
        parts = [rebuilt(part, with_leaves) for part in x]
        return type(x)(*parts) if hasattr(x, "_fields") else tuple(parts)
    return None if x is None else next(with_leaves)


class MachineCode:
    """A generic function in machine code, for arguments of the shapes given.

    Args:
        function: the function.
        arguments: records of arrays, arrays, numbers or None.
        width: lanes.
        short: operations up to which the code stays straight.
    """

    def __init__(self, function: Callable, *arguments: Any, width: int = 1, short: int = SHORT):
        self.tape = Tape()
        given = [np.asarray(x) for x in leaves(arguments)]
        names = [f"a{i}" for i in range(len(given))]
        made = (
            self.tape.inputs(name, x.shape) if x.ndim else self.tape.inputs(name, (1,))[0]
            for name, x in zip(names, given, strict=True)
        )
        self._found = function(*rebuilt(arguments, made))
        self._shapes = [np.shape(x) for x in leaves(self._found)]
        roots = {
            f"o{i}": [self.tape.number(y).index for y in np.ravel(np.asarray(x, object))]
            for i, x in enumerate(leaves(self._found))
        }
        sizes = {name: math.prod(x.shape) for name, x in zip(names, given, strict=True)}
        self.program = program_of(self.tape, roots, short)
        outputs = {name: len(places) for name, places in roots.items()}
        self.kernel = Kernel(self.program, sizes, outputs, width)

    def block(self, *arguments: Any) -> Array:
        """Return a block that holds these arguments; arrays may have lanes behind their axes."""
        given = zip(self.kernel.parameters.items(), leaves(arguments), strict=True)
        return self.kernel.block({name: self._laned(x, size) for (name, size), x in given})

    def run(self, block: Array) -> Any:
        """Return the function's value for what stands in a block."""
        nothing, width = np.zeros(self.kernel.width), self.kernel.width
        found = zip(self.kernel(block, nothing, nothing).values(), self._shapes, strict=True)
        behind = (width,) if width > 1 else ()
        parts = (x.reshape((*shape, *behind)) for x, shape in found)
        return rebuilt(self._found, iter([x if x.ndim else x[()] for x in parts]))

    def of_last(self, *arguments: Any) -> Callable[[Array], Any]:
        """Return the function of its last argument alone, an array, at those that are before it."""
        block, (name, size) = self.block(*arguments), list(self.kernel.parameters.items())[-1]
        first = HEADER + self.kernel.layout.offsets[name]
        place = block[first : first + size]

        def run(x: Array) -> Any:
            place[:] = x
            return self.run(block)

        return run

    def __call__(self, *arguments: Any) -> Any:
        """Return the function's value; arrays of arguments may have lanes behind their axes."""
        return self.run(self.block(*arguments))

    def _laned(self, x: Any, size: int) -> Array:
        x = np.asarray(x, float)
        return x.reshape(size, self.kernel.width) if x.size > size else x.ravel()


def evaluated(tape: Tape, places: Sequence[int], inputs: Mapping[str, Array]) -> Array:
    """Return the entries of a tape at `places` (k,), run in Python operation by operation."""
    made: dict[int, float] = {}
    groups: dict[int, Array] = {}

    def group(number: int) -> Array:
        if number not in groups:
            kind, _, shape, reads, by = tape.groups[number]
            groups[number] = _group(kind, shape, np.array([made[p] for p in reads]), by, matrix)
        return groups[number]

    def matrix(by: int) -> Array:
        return np.array([made[p] for p in tape.groups[by].reads])

    with np.errstate(all="ignore"):
        for place in live_entries(tape, places)[0]:
            op, x, y = tape.operations[place]
            made[place] = (
                x
                if op is tapes.CONSTANT
                else inputs[x].flat[y]
                if op is tapes.INPUT
                else group(x)[y]
                if op is tapes.PART
                else RUN[op](*(np.float64(made[z]) for z in (x, y) if z is not None))
            )
    return np.array([made[place] for place in places])


RUN = {
    tapes.ADD: operator.add,
    tapes.SUB: operator.sub,
    tapes.MUL: operator.mul,
    tapes.DIV: operator.truediv,
    tapes.NEG: operator.neg,
    tapes.SQRT: np.sqrt,
}


def _group(
    kind: str, shape: tuple[int, ...], given: Array, by: int, matrix: Callable[[int], Array]
) -> Array:
    if kind is tapes.ANGLES:
        return np.concatenate((np.cos(given), np.sin(given)))
    if kind is tapes.SOLVE:
        A = matrix(by).reshape(shape[0], shape[0])
        return np.linalg.solve(A, given.reshape(shape)).ravel()
    if kind is tapes.BAND:
        bands, b = given[: -shape[0]].reshape(shape[0], WIDTH), given[-shape[0] :]
        return np.linalg.solve(to_dense(bands), b)
    rows, inner, columns = shape
    A, B = given[: rows * inner].reshape(rows, inner), given[rows * inner :]
    return (A @ B.reshape(inner, columns)).ravel()


_kept: dict[Any, MachineCode] = {}


def in_machine_code(function: Callable, *arguments: Any, short: int = SHORT) -> Any:
    """Return the value of a generic function; its code is made once for all of these shapes."""
    shapes = tuple(np.shape(x) for x in leaves(arguments))
    where = repr(rebuilt(arguments, iter([0] * len(shapes))))
    key = function, where, shapes, short
    if key not in _kept:
        _kept[key] = MachineCode(function, *arguments, short=short)
    return _kept[key](*arguments)
