"""Symbolic expressions of CasADi and heyoka: a scene becomes an expression graph of the library.

CasADi differentiates and evaluates the graph (`CasadiArithmetic`); heyoka integrates it by Taylor
series (`HeyokaArithmetic`). Either library is loaded when its arithmetic is first constructed, not
when this module is imported. Expressions have no magnitude: elimination takes the first pivot that
does not vanish identically.

For heyoka every constant is converted to quad precision. heyoka folds constants in their own
precision: the product 0.1 * 0.3 of two float64 numbers would be float64 again, wrong in the 17th
digit. Inputs in float64 are exact, and the cosine of a constant is that of exactly this number.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Angles, Array, map_entries
from eomcheck.numbers.linear import SOLVERS

# ---- Elimination of expressions ------------------------------------------------------------------

Solver = Callable[[Array, Array, str], Array]


def symbolic_elimination(vanishes: Callable[[Any], bool]) -> Solver:
    """Return a solver whose pivots are the first that do not vanish identically.

    Args:
        vanishes: whether an entry is 0 for all values of its variables.
    """

    def solve(A: Array, b: Array, name: str) -> Array:
        size = A.shape[0]
        A, x = A.copy(), b.reshape(size, -1).copy()
        for column in range(size):
            candidates = (row for row in range(column, size) if not vanishes(A[row, column]))
            pivot = next(candidates, column)
            for part in (A, x):
                part[[column, pivot]] = part[[pivot, column]]
            for row in range(column + 1, size):
                factor = A[row, column] / A[column, column]
                # No row below needs the entries under the diagonal.
                for part, first in ((A, column + 1), (x, 0)):
                    for k in range(first, part.shape[1]):
                        part[row, k] = part[row, k] - factor * part[column, k]
        for row in range(size - 1, -1, -1):
            for k in range(x.shape[1]):
                for column in range(row + 1, size):
                    x[row, k] = x[row, k] - A[row, column] * x[column, k]
                x[row, k] = x[row, k] / A[row, row]
        return x.reshape(b.shape)

    return solve


# ---- CasADi --------------------------------------------------------------------------------------


class CasadiArithmetic:
    """The arithmetic of CasADi's SX expressions (`eomcheck.numbers.generic.Arithmetic`).

    Attributes:
        casadi: the library.
    """

    def __init__(self):
        self.casadi: Any = importlib.import_module("casadi")
        SOLVERS[self.casadi.SX] = symbolic_elimination(self._vanishes)

    def numbers(self, x: Array) -> Array:
        """Return the float64 array x as constants, same shape."""
        return map_entries(lambda y: self.casadi.SX(float(y)), np.asarray(x, object))

    def variables(self, name: str, size: int) -> tuple[Any, Array]:
        """Return new variables as a CasADi column, and its entries as an array (size,)."""
        column = self.casadi.SX.sym(name, size)
        entries = np.empty(size, object)
        for i in range(size):
            entries[i] = column[i]
        return column, entries

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), float64 or expressions, with their cosines and sines."""
        value = x if x.dtype == object else self.numbers(x)
        return Angles(
            value, map_entries(self.casadi.cos, value), map_entries(self.casadi.sin, value)
        )

    def root(self, x: Array) -> Array:
        """Return the positive square roots of expressions x (k,)."""
        return map_entries(self.casadi.sqrt, x)

    def _vanishes(self, x: Any) -> bool:
        return self.casadi.SX(x).is_zero()


# ---- heyoka --------------------------------------------------------------------------------------

BITS = 113
"""Bits of the significand of quad precision (IEEE 754 binary128)."""


def load_heyoka() -> Any:
    """Return the imported module heyoka.

    Raises:
        EngineError: it is not installed.
    """
    try:
        return importlib.import_module("heyoka")
    except ImportError as error:
        raise EngineError(
            f"heyoka is not installed ({error}); install it by: pip install 'eomcheck[reference]'"
        ) from None


class HeyokaArithmetic:
    """The arithmetic of heyoka expressions (`eomcheck.numbers.generic.Arithmetic`).

    Attributes:
        heyoka: the library.
        quad: its type of quad precision: `real128`, or `real` on platforms without it.

    Raises:
        EngineError: heyoka is not installed.
    """

    def __init__(self):
        self.heyoka = load_heyoka()
        self.quad = getattr(self.heyoka, "real128", self.heyoka.real)
        SOLVERS[self.heyoka.expression] = symbolic_elimination(_vanishes)

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments with which heyoka compiles for quad precision."""
        real = {"prec": BITS} if self.quad is self.heyoka.real else {}
        return {"fp_type": self.quad, **real}

    def constant(self, x: Any) -> Any:
        """Return x, a float64, an integer or a string of digits, in quad precision."""
        if self.quad is self.heyoka.real:
            return self.quad(x, BITS)
        return self.quad(x)

    def constants(self, x: Array) -> Array:
        """Return the float64 array x in quad precision, same shape, as an array of that type."""
        quad = [self.constant(float(y)) for y in np.ravel(x)]
        return np.array(quad, dtype=self.quad).reshape(np.shape(x))

    def expression(self, x: Any) -> Any:
        """Return x as an expression; literal integers in results are converted to constants."""
        expression = self.heyoka.expression
        return x if isinstance(x, expression) else expression(self.constant(x))

    def numbers(self, x: Array) -> Array:
        """Return the float64 array x as constants, same shape."""
        return map_entries(lambda y: self.expression(float(y)), x)

    def variables(self, name: str, size: int) -> Array:
        """Return the variables name_0, name_1, ... (size,)."""
        return np.array([self.heyoka.expression(f"{name}_{i}") for i in range(size)], object)

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), float64 or expressions, with their cosines and sines."""
        value = x if x.dtype == object else self.numbers(x)
        cos, sin = (
            np.array([function(y) for y in value], object)
            for function in (self.heyoka.cos, self.heyoka.sin)
        )
        return Angles(value, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of the expressions x (k,)."""
        return map_entries(lambda y: self.heyoka.sqrt(self.expression(y)), x)


def _vanishes(x: Any) -> bool:
    # The value of a constant can only be read from its printed form.
    try:
        return float(str(x)) == 0.0
    except ValueError:
        return False
