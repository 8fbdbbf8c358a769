"""Exact numbers for tests: random fractions as an arithmetic, and a scene evaluated on them."""

from __future__ import annotations

import random
from fractions import Fraction

import numpy as np

from eomcheck.evaluate import Acceleration
from eomcheck.formulations import Formulation, Partition
from eomcheck.model import Angles, Scene
from eomcheck.scenes import SCENES, Snake


def small_scenes(key: str) -> list[Scene]:
    """Return scenes of the kind `key` that differ in size and in what is absent."""
    assert SCENES[key] is Snake, f"tests/exact.py: add small scenes of the kind {key!r}"
    springs = [Snake.coil(links) for links in (1, 2, 3, 5)]
    return [*springs, *(without_springs(scene) for scene in springs[1:])]


def without_springs(snake: Snake) -> Snake:
    return Snake(snake.mass, snake.length, snake.inertia, None, snake.wheel_angle, snake.pose)


SMALL_SCENES = [scene for key in SCENES for scene in small_scenes(key)]


def scene_id(scene: Scene) -> str:
    absent = [name for name, value in vars(scene).items() if value is None]
    return "-".join((scene.name, *(f"no-{name}" for name in absent)))


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
        t = self.vector(x.size)
        return Angles(self.vector(x.size), (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t))


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


class Exact:
    """Everything of a scene at one random point, in fractions; v = W u (+ offset) for random u."""

    def __init__(self, scene: Scene, seed: int):
        self.scene, self.random = scene, RandomFractions(seed)
        self.parameters = scene.parameters(self.random)
        self.prepared = scene.prepare(self.random, np.zeros(scene.n))
        self.q = self.random.vector(scene.n)
        self.q[scene.angle_coordinates] = self.prepared.value
        self.u = self.random.vector(scene.p)
        at = (self.parameters, self.prepared)
        self.kinematics = scene.kinematics(*at, self.q, self.u)
        self.speeds = scene.speeds(*at, self.kinematics)
        self.bodies = scene.bodies(*at, self.kinematics)
        self.v = self.speeds.W @ self.u
        if self.speeds.offset is not None:
            self.v = self.v + self.speeds.offset
        self.terms = scene.terms(*at, self.q, self.v)

    @property
    def F(self) -> np.ndarray:
        """Q - B (n,)."""
        parts = [(+1, self.terms.Q), (-1, self.terms.B)]
        return sum(sign * part for sign, part in parts if part is not None) + np.array(
            [Fraction(0)] * self.scene.n, object
        )

    def partition(self, dependent: tuple[int, ...] | None = None) -> Partition:
        columns = range(self.scene.n)
        first = tuple(columns[: self.scene.r]) if dependent is None else dependent
        rest = [i for i in columns if i not in first]
        return Partition(np.array(first, int), np.array(rest, int))

    def solve(self, formulation: Formulation, partition: Partition | None = None) -> Acceleration:
        multipliers = None
        if formulation.uses == "terms":
            M, _, _, a, gamma, _ = self.terms
            vdot, multipliers = formulation.solution(
                M, self.F, a, gamma, self.v, partition or self.partition()
            )
        else:
            W, rest, _ = self.speeds
            if formulation.uses == "speeds":
                udot = formulation.solution(self.terms.M, self.F, W, rest)
            else:
                udot = formulation.solution(*self.bodies)
            vdot = W @ udot + rest
        return Acceleration(vdot, multipliers, {}, float("inf"))


class Dual:
    """x + ε dx with ε² = 0: exact derivatives of rational functions."""

    def __init__(self, x, dx=0):
        self.x, self.dx = x, dx

    def __add__(self, other):
        other = _dual(other)
        return Dual(self.x + other.x, self.dx + other.dx)

    def __neg__(self):
        return Dual(-self.x, -self.dx)

    def __sub__(self, other):
        return self + (-_dual(other))

    def __rsub__(self, other):
        return _dual(other) - self

    def __mul__(self, other):
        other = _dual(other)
        return Dual(self.x * other.x, self.x * other.dx + self.dx * other.x)

    def __truediv__(self, other):
        other = _dual(other)
        quotient = self.x / Fraction(other.x)
        return Dual(quotient, (self.dx - quotient * other.dx) / Fraction(other.x))

    __radd__, __rmul__ = __add__, __mul__


def _dual(x) -> Dual:
    return x if isinstance(x, Dual) else Dual(x)


def duals(x: np.ndarray, dx: np.ndarray) -> np.ndarray:
    """Return x + ε dx as an array of `Dual`."""
    return np.array([Dual(a, b) for a, b in zip(x, dx, strict=True)], object)


def dual_angles(angles: Angles, rate: np.ndarray) -> Angles:
    """Return the angles while they turn at `rate`."""
    return Angles(
        duals(angles.value, rate),
        duals(angles.cos, -angles.sin * rate),
        duals(angles.sin, angles.cos * rate),
    )


def rate(x) -> np.ndarray:
    """Return the ε parts of x, same shape; 0 where x does not depend on ε."""
    x = np.asarray(x, object)
    return np.array([_dual(y).dx for y in x.ravel()], object).reshape(x.shape)
