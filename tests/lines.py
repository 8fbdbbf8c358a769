"""Degrees measured: a scene along a random line, its quantities recovered as functions of s.

On the line x = x_0 + s d through the space of all variables, cosines and sines among them, a
rational function keeps its degree, for almost every line. From its values at enough s it is
recovered as a reduced fraction of polynomials in s: interpolation, then Euclid's algorithm.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable

import flint
import numpy as np

from eomcheck.numbers.generic import Angles

PRIME = 2**61 - 1
SPARE = 6
"""Values beyond those that the fraction needs; a wrong one fits them with probability p^-SPARE."""


class Line:
    """The arithmetic of a random line at one s: every variable is x_0 + s d.

    Unlike those of `FiniteField`, cosines and sines are variables of their own, as in `Degrees`.
    """

    def __init__(self, seed: int, s: int):
        self._source, self._s = random.Random(seed), s

    def vector(self, size: int) -> np.ndarray:
        return np.array([self._element() for _ in range(size)], object)

    def _element(self) -> flint.nmod:
        start, slope = self._source.randrange(PRIME), self._source.randrange(PRIME)
        return flint.nmod(start + self._s * slope, PRIME)

    def numbers(self, x: np.ndarray) -> np.ndarray:
        return self.vector(np.size(x)).reshape(np.shape(x))

    def angles(self, x: np.ndarray) -> Angles:
        value = x if x.dtype == object else self.numbers(x)
        return Angles(value, self.numbers(x), self.numbers(x))


def numerator_degrees(values: Callable[[int], Iterable], first: int = 16) -> list[int]:
    """Return the degree of the numerator of each of several rational functions of s; -1 for zero.

    Args:
        values: s -> the functions' values there, elements of the field modulo `PRIME` or integers.
        first: number of s to begin with, raised until every function is recovered.
    """
    count, rows, found = first, [], {}
    while True:
        rows += [list(values(s)) for s in range(len(rows) + 1, count + 1)]
        columns: dict[tuple, list[int]] = {}  # many entries are equal
        for place, column in enumerate(zip(*rows, strict=True)):
            if place not in found:
                columns.setdefault(tuple(map(int, column)), []).append(place)
        for degree, places in zip(_recovered(list(columns)), columns.values(), strict=True):
            if degree is not None:
                found |= dict.fromkeys(places, degree)
        if len(found) == len(rows[0]):
            return [found[place] for place in range(len(rows[0]))]
        count = count * 5 // 4


def _recovered(columns: list[tuple]) -> list[int | None]:
    """Return the degree of each numerator, None where there are too few values."""
    count, width = len(columns[0]), len(columns)
    points = [flint.nmod(s, PRIME) for s in range(1, count + 1)]
    powers = [s**k for s in points for k in range(count)]
    vandermonde = flint.nmod_mat(count, count, powers, PRIME)
    right = flint.nmod_mat(
        count, width, [x for row in zip(*columns, strict=True) for x in row], PRIME
    )
    coefficients = vandermonde.solve(right).entries()
    modulus = flint.nmod_poly([1], PRIME)
    for s in points:
        modulus *= flint.nmod_poly([-s, 1], PRIME)
    return [
        _numerator_degree(flint.nmod_poly(coefficients[i::width], PRIME), modulus)
        for i in range(width)
    ]


def _numerator_degree(values: flint.nmod_poly, modulus: flint.nmod_poly) -> int | None:
    """Return the degree of P where P / Q = values modulo `modulus`, None if it is not settled.

    Euclid's algorithm on both meets every P = Q values (mod modulus) of small degrees; deg P +
    deg Q is smallest just before the largest quotient.
    """
    if values == 0:
        return -1
    above, here = modulus, values
    best, degree, size = 0, None, modulus.degree()
    while True:
        # deg P = deg here, deg Q = deg modulus - deg above.
        quotient, below = divmod(above, here)
        if quotient.degree() > best:
            best, degree = quotient.degree(), here.degree()
        if below == 0:
            break
        above, here = here, below
    assert best <= size
    return degree if best > SPARE else None
