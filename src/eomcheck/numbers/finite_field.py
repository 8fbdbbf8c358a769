"""Polynomial identity testing: integers modulo a prime, and bounds of polynomial degrees.

Two rational functions that agree at random points of a large finite field are equal, but for a
probability that is derived in docs/explanation/proof.md and that a bound of their degree gives.

- Each point has a new random prime, and every parameter, speed, force and angle is a random element
  of the field. An angle is a random point of the circle, cos = (1 - t²)/(1 + t²) and
  sin = 2t/(1 + t²); its `value` is a separate random element, for no algebraic identity relates it
  to its cosine and sine.
- Every quantity is a quotient P / (2^k g_1^e_1 g_2^e_2 ...) of polynomials with integer
  coefficients in the parameters, speeds, values, cosines and sines. A `Bound` holds an upper bound
  of the total degree of P and of the sum of the magnitudes of its coefficients, and the divisors g
  that occurred. Sums are brought to a common denominator; systems are solved by Cramer's rule. A
  scene or a formulation that is evaluated on bounds thus yields a bound of its own degree, and
  nobody derives it by hand.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from typing import Any
from weakref import WeakValueDictionary

import flint
import numpy as np
from flint.utils.flint_exceptions import DomainError as DomainError

from eomcheck.errors import RefusedError
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, eliminate_banded
from eomcheck.numbers.generic import BRANCH, Angles, Array, NotRationalError, product_of
from eomcheck.numbers.linear import SOLVERS

# ---- Integers modulo a prime ---------------------------------------------------------------------

PRIMES = (2**61, 2**62)
"""The range, all of 62 bits, from which primes are drawn uniformly."""

PRIME_COUNT = 3.8e16
"""Lower bound of the number of primes in it, π(2^62) - π(2^61), by x/ln x < π(x) < 1.25506 x/ln x
(Rosser and Schoenfeld 1962, Corollary 1 of Theorem 2)."""


def random_prime(source: random.Random) -> int:
    """Return a prime drawn uniformly from `PRIMES`."""
    while True:
        candidate = source.randrange(PRIMES[0] + 1, PRIMES[1], 2)
        if flint.fmpz(candidate).is_prime():
            return candidate


class FiniteField:
    """The arithmetic of integers modulo `prime` (`eomcheck.numbers.generic.Arithmetic`).

    Args:
        prime: the modulus.
        source: random numbers by which elements are drawn.
    """

    def __init__(self, prime: int, source: random.Random):
        self.prime, self._source = prime, source

    def element(self) -> flint.nmod:
        """Return a random element of the field."""
        return flint.nmod(self._source.randrange(self.prime), self.prime)

    def vector(self, size: int) -> Array:
        """Return random elements (size,)."""
        return np.array([self.element() for _ in range(size)], object)

    def numbers(self, x: Array) -> Array:
        """Return random elements in the shape of x: an identity has to hold for any parameters."""
        return self.vector(np.size(x)).reshape(np.shape(x))

    def angles(self, x: Array) -> Angles:
        """Return random points of the circle for the angles x (k,).

        Their `value` is x if x is in the field already, random elements if not.
        """
        value = x if x.dtype == object else self.numbers(x)
        t = np.array([self._parameter() for _ in range(x.size)], object)
        return Angles(value, (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))

    def root(self, x: Array) -> Array:
        """Return random elements for the square roots of x (k,): half of all elements have no root.

        An identity is thus proved for any value in place of the root.
        """
        return self.numbers(x)

    def literal(self, x: int) -> flint.nmod:
        """Return the literal x as an element of the field."""
        return flint.nmod(x, self.prime)

    def _parameter(self) -> flint.nmod:
        while True:
            t = self.element()
            if 1 + t * t != 0:
                return t


def _solve(A: Array, b: Array, name: str) -> Array:
    size, columns = A.shape[0], b.reshape(A.shape[0], -1)
    prime = next(x for x in (*A.flat, *b.flat) if isinstance(x, flint.nmod)).modulus()
    matrix = flint.nmod_mat(size, size, A.ravel().tolist(), prime)
    right = flint.nmod_mat(size, columns.shape[1], columns.ravel().tolist(), prime)
    try:
        x = matrix.solve(right)
    except ZeroDivisionError:
        raise RefusedError(
            name, 0.0, 0.0, f"the {size} x {size} matrix {name} is singular modulo {prime}"
        ) from None
    return np.array(x.entries(), object).reshape(b.shape)


SOLVERS[flint.nmod] = _solve
BANDED_SOLVERS[flint.nmod] = eliminate_banded


# ---- Bounds of the degree ------------------------------------------------------------------------


class Denominator:
    """A product of powers of divisors; divisors are compared by identity of their objects.

    Args:
        factors: divisor -> power.
    """

    __slots__ = ("__weakref__", "_common", "_times", "degree", "factors", "height")

    def __init__(self, factors: Mapping[Bound, int]):
        self.factors = factors
        self.degree = sum(power * g.degree for g, power in factors.items())
        self.height = sum(power * g.height for g, power in factors.items())
        self._times: dict[Denominator, Denominator] = {}
        self._common: dict[Denominator, Denominator] = {}

    @classmethod
    def of(cls, factors: Mapping[Bound, int]) -> Denominator:
        """Return the one denominator with these factors, whose cached products are shared."""
        key = frozenset(factors.items())
        known = _DENOMINATORS.get(key)
        if known is None:
            known = _DENOMINATORS[key] = cls(factors)
        return known

    def times(self, other: Denominator) -> Denominator:
        """Return the product of two denominators."""
        if not other.factors:
            return self
        if not self.factors:
            return other
        if other not in self._times:
            powers = dict(self.factors)
            for g, power in other.factors.items():
                powers[g] = powers.get(g, 0) + power
            self._times[other] = Denominator.of(powers)
        return self._times[other]

    def common(self, other: Denominator) -> Denominator:
        """Return the least common multiple of two denominators."""
        if self is other or not other.factors:
            return self
        if not self.factors:
            return other
        if other not in self._common:
            powers = dict(self.factors)
            for g, power in other.factors.items():
                powers[g] = max(powers.get(g, 0), power)
            self._common[other] = Denominator.of(powers)
        return self._common[other]


_DENOMINATORS: WeakValueDictionary[frozenset, Denominator] = WeakValueDictionary()
ONE = Denominator({})


def log_sum(heights) -> float:
    """Return log2 of the sum of 2^h."""
    top = max(heights)
    return top + math.log2(math.fsum(2.0 ** (h - top) for h in heights))


class Bound:
    """Upper bounds for a quotient of polynomials.

    Attributes:
        degree: upper bound of the total degree of the numerator P.
        height: upper bound of log2 of the sum of the magnitudes of P's coefficients.
        twos: power of two in the denominator.
        denominator: the other divisors.
    """

    __slots__ = ("degree", "denominator", "height", "twos")

    def __init__(self, degree: int, height: float, twos: int = 0, denominator: Denominator = ONE):
        self.degree, self.height = degree, height
        self.twos, self.denominator = twos, denominator

    def __eq__(self, other):
        # Identity, for a bound as a key among divisors; any other comparison is an error.
        if other is self:
            return True
        raise NotRationalError(BRANCH)

    __hash__ = object.__hash__

    def __bool__(self):
        raise NotRationalError(BRANCH)

    def over(self, denominator: Denominator, twos: int) -> Bound:
        """Return the bound of the same quantity over a multiple of its denominator."""
        degree = self.degree + denominator.degree - self.denominator.degree
        height = self.height + denominator.height - self.denominator.height + twos - self.twos
        return Bound(degree, height, twos, denominator)

    def __add__(self, other):
        if isinstance(other, int):
            if other == 0:
                return self
            other = _constant(other)
        elif not isinstance(other, Bound):
            return NotImplemented
        x, y, common = self, other, self.denominator
        if x.denominator is not y.denominator or x.twos != y.twos:
            common, twos = common.common(y.denominator), max(x.twos, y.twos)
            x, y = x.over(common, twos), y.over(common, twos)
        high, low = (x.height, y.height) if x.height > y.height else (y.height, x.height)
        height = high + math.log2(1.0 + 2.0 ** (low - high))
        return Bound(max(x.degree, y.degree), height, x.twos, common)

    def __neg__(self):
        # A new object, that is another divisor: the bound stays valid.
        return Bound(self.degree, self.height, self.twos, self.denominator)

    def __mul__(self, other):
        if isinstance(other, int):
            return 0 if other == 0 else self if other == 1 else self * _constant(other)
        if not isinstance(other, Bound):
            return NotImplemented
        return Bound(
            self.degree + other.degree,
            self.height + other.height,
            self.twos + other.twos,
            self.denominator.times(other.denominator),
        )

    def __truediv__(self, other):
        if isinstance(other, int):
            if other <= 0 or other & (other - 1):
                raise TypeError(f"division by the literal {other}, which is no power of two")
            twos = self.twos + other.bit_length() - 1
            return Bound(self.degree, self.height, twos, self.denominator)
        if not isinstance(other, Bound):
            return NotImplemented
        above = other.denominator
        return Bound(
            self.degree + above.degree,
            self.height + above.height + other.twos,
            self.twos,
            self.denominator.times(Denominator.of({other: 1})),
        )

    def __pow__(self, power):
        return product_of(self, power)

    def __rtruediv__(self, other):
        return 0 if other == 0 else _constant(other) / self

    def __sub__(self, other):
        return self + other

    def __rsub__(self, other):
        return self + other

    __radd__, __rmul__ = __add__, __mul__


def _constant(value: int) -> Bound:
    return Bound(0, math.log2(abs(value)))


class DegreeArithmetic:
    """The arithmetic of `Bound`, by which every number of the scene is a separate variable."""

    def vector(self, size: int) -> Array:
        """Return variables (size,)."""
        return np.array([Bound(1, 0.0) for _ in range(size)], object)

    def numbers(self, x: Array) -> Array:
        """Return variables in the shape of x."""
        return self.vector(np.size(x)).reshape(np.shape(x))

    def angles(self, x: Array) -> Angles:
        """Return value, cosine and sine of the angles x (k,) as variables."""
        value = x if x.dtype == object else self.numbers(x)
        return Angles(value, self.numbers(x), self.numbers(x))

    def root(self, x: Array) -> Array:
        """Return the square roots of x (k,) as variables."""
        return self.numbers(x)

    def literal(self, x: int) -> Any:
        """Return the literal x as a bound; 0 stays the integer 0, which sums leave out."""
        return _constant(x) if x else 0


def _solve_by_cramer(A: Array, b: Array, name: str) -> Array:
    """Bound the solution by Cramer's rule.

    Each row of A is multiplied by its common denominator, which does not change x. With row sums
    ||P_i|| of the polynomial matrix P that results, det P has at most the degree sum_i deg P_i and
    coefficients whose magnitudes sum to prod_i ||P_i||; for a numerator of x, one column is
    replaced by one of b.
    """
    columns = b.reshape(A.shape[0], -1)
    rows = [_Row(row) for row in A]
    if any(row.empty for row in rows):
        raise RefusedError(name, 0.0, 0.0, f"a row of the matrix {name} is zero")
    determinant = Bound(sum(row.degree for row in rows), sum(row.height for row in rows))
    divisor = Denominator.of({determinant: 1})
    x = np.zeros(columns.shape, object)
    for j in range(columns.shape[1]):
        entries = [row.scaled(y) for row, y in zip(rows, columns[:, j], strict=True)]
        present = [(row, y) for row, y in zip(rows, entries, strict=True) if y is not None]
        if not present:
            continue
        right = _Row(np.array([y for _, y in present], object))
        terms = [
            (determinant.degree - row.degree + y.degree, determinant.height - row.height + y.height)
            for (row, _), y in zip(present, right.entries, strict=True)
        ]
        degree, height = max(d for d, _ in terms), log_sum([h for _, h in terms])
        for i in range(x.shape[0]):
            x[i, j] = Bound(degree, height, right.twos, right.denominator.times(divisor))
    return x.reshape(b.shape)


class _Row:
    """The entries of one row (or column) over their common denominator."""

    def __init__(self, row: Array):
        present = [_constant(x) if isinstance(x, int) else x for x in row if _nonzero(x)]
        self.empty = not present
        self.denominator, self.twos = ONE, max((x.twos for x in present), default=0)
        for x in present:
            self.denominator = self.denominator.common(x.denominator)
        self.entries = [x.over(self.denominator, self.twos) for x in present]
        if present:
            self.degree = max(x.degree for x in self.entries)
            self.height = log_sum([x.height for x in self.entries])

    def scaled(self, x: Any) -> Bound | None:
        """Return x times the common denominator of this row, None if x is zero."""
        if not _nonzero(x):
            return None
        x = _constant(x) if isinstance(x, int) else x
        powers, lacking = dict(x.denominator.factors), dict(self.denominator.factors)
        for g in powers.keys() & lacking.keys():
            shared = min(powers[g], lacking[g])
            powers[g] -= shared
            lacking[g] -= shared
        left = Denominator.of({g: power for g, power in powers.items() if power})
        grown = Denominator({g: power for g, power in lacking.items() if power})
        twos = x.twos - self.twos
        return Bound(
            x.degree + grown.degree, x.height + grown.height + max(-twos, 0), max(twos, 0), left
        )


def _nonzero(x: Any) -> bool:
    return not (isinstance(x, int) and x == 0)


SOLVERS[Bound] = _solve_by_cramer
