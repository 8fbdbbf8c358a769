"""CasADi expressions: what a scene says becomes a graph that CasADi differentiates and evaluates.

The library is loaded when `Symbols` is first made, not when this module is imported.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from eomcheck.numbers.contract import Angles, Array
from eomcheck.numbers.elimination import eliminating
from eomcheck.numbers.entries import each
from eomcheck.numbers.linear import SOLVERS


class Symbols:
    """The arithmetic of CasADi's SX expressions (`eomcheck.numbers.contract.Arithmetic`).

    Attributes:
        casadi: the library.
    """

    def __init__(self):
        self.casadi: Any = importlib.import_module("casadi")
        SOLVERS[self.casadi.SX] = eliminating(self._vanishes)

    def numbers(self, x: Array) -> Array:
        """Return the doubles x as constants, same shape."""
        return each(lambda y: self.casadi.SX(float(y)), np.asarray(x, object))

    def variables(self, name: str, size: int) -> tuple[Any, Array]:
        """Return new variables as a CasADi column and, entry by entry, as an array (size,)."""
        column = self.casadi.SX.sym(name, size)
        entries = np.empty(size, object)
        for i in range(size):
            entries[i] = column[i]
        return column, entries

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), doubles or expressions, with their cosines and sines."""
        value = x if x.dtype == object else self.numbers(x)
        return Angles(value, each(self.casadi.cos, value), each(self.casadi.sin, value))

    def root(self, x: Array) -> Array:
        """Return the positive square roots of expressions x (k,)."""
        return each(self.casadi.sqrt, x)

    def _vanishes(self, x: Any) -> bool:
        return self.casadi.SX(x).is_zero()
