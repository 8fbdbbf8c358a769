"""Exact numbers for tests: random fractions, and doubles taken for the fractions they are."""

from __future__ import annotations

import random
from fractions import Fraction

import numpy as np

from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Angles
from eomcheck.scenes import Snake

SMALL_SCENES: list[Scene] = [scene for links in (1, 2, 3, 5) for scene in Snake.structures(links)]
"""Snakes that differ in size and in what is absent; tests/test_scenes.py proves every scene."""


class RandomFractions:
    """An arithmetic that replaces every number by a random fraction of its own.

    Identities between formulations are algebraic: they hold for any masses, for any point of the
    circle, and for a `value` of an angle that has nothing to do with its cosine.
    """

    def __init__(self, seed: int):
        self._random = random.Random(seed)

    def positive(self) -> Fraction:
        return Fraction(self._random.randint(1, 40), self._random.randint(1, 9))

    def any(self) -> Fraction:
        return Fraction(self._random.randint(-40, 40), self._random.randint(1, 9))

    def vector(self, size: int) -> np.ndarray:
        return np.array([self.any() for _ in range(size)], object)

    def numbers(self, x: np.ndarray) -> np.ndarray:
        return np.array([self.positive() for _ in range(x.size)], object).reshape(x.shape)

    def angles(self, x: np.ndarray) -> Angles:
        value = x if x.dtype == object else self.vector(x.size)
        # Wheels never stand across their links: t² = 1 is left out.
        t = self.vector(x.size) + Fraction(1, 11)
        return Angles(value, (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))


class ExactFloats:
    """An arithmetic that takes doubles for the fractions that they are.

    Cosines and sines are those of the angle given, to far more digits than doubles have.
    """

    def numbers(self, x: np.ndarray) -> np.ndarray:
        return np.array([Fraction(float(y)) for y in x.ravel()], object).reshape(x.shape)

    def angles(self, x: np.ndarray) -> Angles:
        value = self.numbers(x)
        pairs = [_cos_sin(y) for y in value]
        return Angles(value, *(np.array([pair[i] for pair in pairs], object) for i in (0, 1)))


DIGITS = 2**160


def _cos_sin(x: Fraction) -> tuple[Fraction, Fraction]:
    """Return (cos x, sin x) to within 1e-40 for |x| < 20, by their series."""
    parts = [Fraction(0)] * 4
    term, k = Fraction(1), 0
    while k < 20 or abs(term) * DIGITS > 1:
        parts[k % 4] += term
        k += 1
        term = Fraction(round(term * x / k * DIGITS**2), DIGITS**2)
    cos, sin = parts[0] - parts[2], parts[1] - parts[3]
    return Fraction(round(cos * DIGITS), DIGITS), Fraction(round(sin * DIGITS), DIGITS)
