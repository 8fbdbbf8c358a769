"""Integers modulo a prime: polynomial identity testing of rational functions at random points.

Two rational functions that agree at random points of a large finite field are equal, but for a
probability that is derived in docs/proof.md. Each point has a new random prime, and every
parameter, speed, force and angle is a random element of the field. An angle is a random point of
the circle, cos = (1 - t²)/(1 + t²) and sin = 2t/(1 + t²); its `value` is a separate random
element, for no algebraic identity relates it to its cosine and sine.
"""

from __future__ import annotations

import random

import flint
import numpy as np
from flint.utils.flint_exceptions import DomainError

from eomcheck.errors import RefusedError
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, eliminate_banded
from eomcheck.numbers.generic import Angles, Array
from eomcheck.numbers.linear import SOLVERS

__all__ = ["PRIMES", "PRIME_COUNT", "DomainError", "FiniteField", "random_prime"]

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
