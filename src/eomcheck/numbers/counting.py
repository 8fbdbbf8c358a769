"""Operation counts: a scalar type that counts the arithmetic operations of a generic function.

Generic functions never branch on a value, so a `Counted` has no value: every operation adds one to
a `Tally` and returns the same `Counted`. The rules:

1.  Additions include subtractions. A change of sign is free: it is a bit, not an operation.
2.  A division by a literal power of two, such as `mass / 2`, is an exact scaling and counts as a
    multiplication. Every other division counts as one.
3.  An operation on a number of the model and a literal counts, also if the literal is 0 or 1:
    float64 performs it. One on two literals is not counted (a snake has three, of Em at N = 1).
4.  A product of matrices with K terms in each sum costs K multiplications and K - 1 additions per
    entry, as numpy's `@` on objects takes: its sums start from the first product.
5.  A cosine and a sine of the same angle are one trigonometric pair. Square roots are counted
    separately.
6.  A linear system is recorded, with its order and its number of right-hand sides; the operations
    of its elimination are not counted.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from eomcheck.numbers.banded_solve import BANDED_SOLVERS, HALF
from eomcheck.numbers.generic import Angles, Array
from eomcheck.numbers.linear import SOLVERS


class System(NamedTuple):
    """Order and number of right-hand sides of a linear system that was solved."""

    name: str
    """Name of its matrix in the formulation."""
    order: int
    columns: int
    """Number of right-hand sides."""
    half: int | None = None
    """Entries on each side of the diagonal, or None for a full matrix."""


@dataclass(slots=True)
class Tally:
    """Exact operation counts, and the linear systems in the order in which they were solved."""

    additions: int = 0
    multiplications: int = 0
    divisions: int = 0
    trigonometric_pairs: int = 0
    roots: int = 0
    systems: list[System] = field(default_factory=list)

    def clear(self) -> None:
        """Reset all counts to zero, and remove the systems."""
        self.additions = self.multiplications = self.divisions = 0
        self.trigonometric_pairs = self.roots = 0
        self.systems.clear()


class Counted:
    """The number that counts in a `Tally`: every operation on it returns this same object."""

    __slots__ = ("tally",)

    def __init__(self, tally: Tally):
        self.tally = tally

    # `NotImplemented` for an array lets numpy apply the operation to its entries.

    def __add__(self, other):
        if other is not self and type(other) is not int:
            return NotImplemented
        self.tally.additions += 1
        return self

    def __mul__(self, other):
        if other is not self and type(other) is not int:
            return NotImplemented
        self.tally.multiplications += 1
        return self

    def __truediv__(self, other):
        if type(other) is int and other > 0 and other & (other - 1) == 0:
            return self * other
        return self.__rtruediv__(other)

    def __rtruediv__(self, other):
        if other is not self and type(other) is not int:
            return NotImplemented
        self.tally.divisions += 1
        return self

    def __neg__(self):
        return self

    __radd__ = __sub__ = __rsub__ = __add__
    __rmul__ = __mul__


class Counting:
    """The arithmetic of `Counted` (`eomcheck.numbers.generic.Arithmetic`).

    Attributes:
        tally: the counts of all its numbers.
    """

    def __init__(self):
        self.tally = Tally()
        self._number = Counted(self.tally)

    def vector(self, size: int) -> Array:
        """Return counted numbers (size,)."""
        return np.full(size, self._number, object)

    def numbers(self, x: Array) -> Array:
        """Return counted numbers in the shape of x."""
        return np.full(np.shape(x), self._number, object)

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,) with cosines and sines, and count k trigonometric pairs."""
        self.tally.trigonometric_pairs += x.size
        return Angles(self.numbers(x), self.numbers(x), self.numbers(x))

    def root(self, x: Array) -> Array:
        """Return the square roots of x (k,), and count k roots."""
        self.tally.roots += x.size
        return self.numbers(x)


def _solve(A: Array, b: Array, name: str, half: int | None = None) -> Array:
    number = next(x for x in chain(A.flat, b.flat) if isinstance(x, Counted))
    size = len(b)
    number.tally.systems.append(System(name, size, b.size // size, half))
    return np.full(b.shape, number, object)


SOLVERS[Counted] = _solve
BANDED_SOLVERS[Counted] = partial(_solve, half=HALF)
