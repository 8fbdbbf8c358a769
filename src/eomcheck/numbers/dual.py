"""Dual numbers, x + ε x′ with ε² = 0, over any scalar type: forward automatic differentiation.

A function that is evaluated on dual numbers returns its value as the part without ε and its
derivative as the part with ε. Rational functions are differentiated exactly. A `Dual` of a `Dual`
carries a mixed second derivative.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from eomcheck.numbers.banded_solve import BANDED_SOLVERS, HALF, solve_banded
from eomcheck.numbers.generic import (
    BRANCH,
    Angles,
    Array,
    NotRationalError,
    map_entries,
    map_record,
    product_of,
)
from eomcheck.numbers.linear import CARRIERS, PRODUCTS, SOLVERS, matrix_product, solve


class Dual:
    """A dual number x + ε x′.

    Attributes:
        x: the value.
        rate: its derivative x′.
    """

    __slots__ = ("rate", "x")

    def __init__(self, x: Any, rate: Any = 0):
        self.x, self.rate = x, rate

    def __add__(self, other):
        if isinstance(other, Dual):
            return Dual(self.x + other.x, self.rate + other.rate)
        if isinstance(other, np.ndarray):
            return NotImplemented  # the array adds entry by entry
        return Dual(self.x + other, self.rate)

    def __neg__(self):
        return Dual(-self.x, -self.rate)

    def __sub__(self, other):
        return self + (-other)

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        if isinstance(other, Dual):
            return Dual(self.x * other.x, self.x * other.rate + self.rate * other.x)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Dual(self.x * other, self.rate * other)

    def __truediv__(self, other):
        if isinstance(other, Dual):
            x = _quotient(self.x, other.x)
            return Dual(x, _quotient(self.rate - x * other.rate, other.x))
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Dual(_quotient(self.x, other), _quotient(self.rate, other))

    def __rtruediv__(self, other):
        return Dual(other) / self

    def __pow__(self, power):
        return product_of(self, power)

    def __eq__(self, other):
        raise NotRationalError(BRANCH)

    __hash__ = None  # type: ignore[assignment]

    __radd__, __rmul__ = __add__, __mul__

    # Methods that numpy's functions call on arrays of objects; user-supplied scenes may use them.

    def sin(self):
        """Return the sine."""
        return Dual(np.sin(self.x), self.rate * np.cos(self.x))

    def cos(self):
        """Return the cosine."""
        return Dual(np.cos(self.x), -self.rate * np.sin(self.x))

    def tan(self):
        """Return the tangent."""
        return self.sin() / self.cos()

    def sqrt(self):
        """Return the square root."""
        root = np.sqrt(self.x)
        return Dual(root, self.rate / (2 * root))

    def exp(self):
        """Return the exponential."""
        power = np.exp(self.x)
        return Dual(power, self.rate * power)


def _quotient(x, y):
    """Return x / y, exact for two integer literals, whose quotient in Python is a float64."""
    if isinstance(x, int) and isinstance(y, int):
        return x // y if x % y == 0 else Fraction(x, y)
    return x / y


def duals(x: Array, rates: Array) -> Array:
    """Return x + ε rates, both of one shape, as an array of `Dual`."""
    return map_entries(Dual, x, rates)


def constant(record: Any) -> Any:
    """Return the arrays of a record as duals with the derivative 0; None stays None."""
    return map_record(lambda part: map_entries(Dual, part) if np.ndim(part) else Dual(part), record)


def dual_angles(angles: Angles, rates: Array) -> Angles:
    """Return the angles (k,) as duals, with the derivatives `rates` (k,)."""
    return Angles(
        duals(angles.value, rates),
        duals(angles.cos, -angles.sin * rates),
        duals(angles.sin, angles.cos * rates),
    )


def dual_root(root: Array, rates: Array) -> Array:
    """Return square roots (k,) as duals; their radicands have the derivatives `rates` (k,)."""
    return duals(root, rates / (2 * root))


def rate(x) -> Any:
    """Return the derivatives in x, same shape; 0 where x does not depend on ε."""
    if isinstance(x, Dual):
        return x.rate
    if np.ndim(x) == 0:
        return 0
    return map_entries(rate, x)


def value(x: Any) -> Any:
    """Return x without its derivative."""
    return x.x if isinstance(x, Dual) else x


def _solve(A: Array, b: Array, name: str) -> Array:
    """Solve A x = b for x and, from A x′ = b′ - A′ x, for its derivative."""
    values = _as_float64(map_entries(value, A))
    x = solve(values, _as_float64(map_entries(value, b)), name)
    return duals(x, solve(values, _as_float64(rate(b) - rate(A) @ x), name))


def _solve_banded(bands: Array, b: Array, name: str) -> Array:
    """Solve A x = b, A by its bands (m, 7), for x and its derivative as `_solve` does."""
    values, changes = _as_float64(map_entries(value, bands)), rate(bands)
    x = solve_banded(values, _as_float64(map_entries(value, b)), name)
    size, outside = len(b), np.zeros(HALF, object)
    extended = np.concatenate((outside, x, outside))
    products = np.zeros(size, object)
    products[:] = [changes[i] @ extended[i : i + 2 * HALF + 1] for i in range(size)]
    return duals(x, solve_banded(values, _as_float64(rate(b) - products), name))


def _product(A: Array, B: Array) -> Array:
    """Return A B (k, m), with its derivative A′ B + A B′."""
    first, second = map_entries(value, A), map_entries(value, B)
    change = matrix_product(rate(A), second) + matrix_product(first, rate(B))
    return duals(matrix_product(first, second), change)


def _as_float64(x: Array) -> Array:
    """Return an object array of float64 as float64, to be solved with pivots; others unchanged."""
    kinds = {type(entry) for entry in x.flat}
    return x.astype(np.float64) if kinds & {float, np.float64} and kinds <= PLAIN else x


PLAIN = {float, np.float64, int}


SOLVERS[Dual], BANDED_SOLVERS[Dual], PRODUCTS[Dual] = _solve, _solve_banded, _product
CARRIERS.add(Dual)


class ReplayArithmetic:
    """An arithmetic that returns recorded angles and roots again, in order, with derivatives."""

    def __init__(self, made: Sequence[Any]):
        self._recorded = iter(made)

    def numbers(self, x: Array) -> Array:
        """Reject numbers, whose derivatives are not known.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError("nobody told the rate of what is prepared")

    def angles(self, x: Array) -> Angles:
        """Return the next recorded angles (k,), with the derivatives of x."""
        return dual_angles(next(self._recorded), rate(x))

    def root(self, x: Array) -> Array:
        """Return the next recorded roots (k,), with the derivatives of x for the radicands."""
        return dual_root(next(self._recorded), rate(x))
