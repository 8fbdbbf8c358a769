"""Any generic function in machine code: of arrays of doubles, to what it gives of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.arithmetic.tape import Tape
from eomcheck.kernels.kernel import Kernel
from eomcheck.kernels.program import SHORT, program_of
from eomcheck.model import Array

STATE_AND_TIME = np.zeros(1), np.zeros(1)
"""What a kernel is called with where all that it reads are parameters."""


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
            f"o{i}": [self.tape.number(y).place for y in np.ravel(np.asarray(x, object))]
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
        lanes = self.kernel.width
        t, y = (np.repeat(x, lanes) for x in STATE_AND_TIME)
        found = zip(self.kernel(block, t, y).values(), self._shapes, strict=True)
        behind = (lanes,) if lanes > 1 else ()
        parts = (x.reshape((*shape, *behind)) for x, shape in found)
        return rebuilt(self._found, iter([x if x.ndim else x[()] for x in parts]))

    def __call__(self, *arguments: Any) -> Any:
        """Return the function's value; arrays of arguments may have lanes behind their axes."""
        return self.run(self.block(*arguments))

    def _laned(self, x: Any, size: int) -> Array:
        x = np.asarray(x, float)
        return x.reshape(size, self.kernel.width) if x.size > size else x.ravel()


_kept: dict[Any, MachineCode] = {}


def in_machine_code(function: Callable, *arguments: Any) -> Any:
    """Return the value of a generic function; its code is made once for all of these shapes."""
    shapes = tuple(np.shape(x) for x in leaves(arguments))
    where = repr(rebuilt(arguments, iter([0] * len(shapes))))
    key = function, where, shapes
    if key not in _kept:
        _kept[key] = MachineCode(function, *arguments)
    return _kept[key](*arguments)
