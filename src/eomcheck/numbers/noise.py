"""Perturbation analysis by random relative perturbations: a condition number is measured.

Rounding changes every number that a computation reads or forms by a relative eps. Perturbing them
all by a much larger relative step h measures how strongly this very computation, cancellation and
ill-conditioned matrices included, amplifies such changes: by |change| / h. Rounding then changes
the result by about eps times that.

Perturbing the inputs and results of functions is not enough: if large terms cancel identically, as
those of a wheel's acceleration do, perturbing their inputs changes them alike, and the rounding
errors of the single operations are missed. So every operation of a generic function is perturbed by
itself (`eomcheck.kernels.perturbed_trace`; Monte Carlo arithmetic: Parker 1997).

A noise is a source of perturbations. A perturbation is a function of three things: the seed, the
stream (the name of the quantity that is computed), and how many were drawn from the stream before.
So a quantity is perturbed alike whatever was computed before it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from eomcheck.numbers.generic import Angles, Arithmetic, map_record

STEP = 2.0**-46
"""The relative step h: 64 eps, above rounding. A result with no correct digit changes by its own
size whatever the step, and its measured amplification is 1/h; h is so small that its error bound is
then as large as the result."""

NORMAL = float(np.finfo(np.float64).tiny)
"""The smallest normal number."""

SAMPLES = 4
"""Number of independent noises per measurement, of which the largest change counts."""

STRETCH = 8.0
"""Factor of the step at which the first noise is used a second time: a change that does not grow
with it is saturated, and does not predict the change under smaller noise."""

SMALLEST_DRAW, LARGEST_CACHED_DRAW = 2**10, 2**14
"""Smallest number of perturbations drawn at a time; largest number cached for other states."""


def _draw(seed: int, stream: str, size: int) -> np.ndarray:
    """Return random numbers (size,) of magnitude 1/2 to 1; a larger size only appends to them."""
    # Magnitudes vary so that two equal contributions never cancel exactly.
    x = np.random.default_rng([seed, zlib.crc32(stream.encode())]).uniform(-1.0, 1.0, size)
    x = 0.5 * (x + np.copysign(1.0, x))
    x.setflags(write=False)
    return x


_cached_draw = lru_cache(256)(_draw)


@lru_cache(64)
def _stacked_draws(sources: tuple[tuple[int, float], ...], stream: str, size: int) -> np.ndarray:
    """Return the perturbations (k, size) that sources (seed, step) draw."""
    x = np.stack([step * _cached_draw(seed, stream, size) for seed, step in sources])
    x.setflags(write=False)
    return x


def draws_of(sources: tuple[tuple[int, float], ...], stream: str, count: int) -> np.ndarray:
    """Return at least `count` perturbations (k, _) that sources (seed, step) draw from a stream."""
    size = max(SMALLEST_DRAW, 1 << (count - 1).bit_length())
    draws = _stacked_draws if size <= LARGEST_CACHED_DRAW else _stacked_draws.__wrapped__
    return draws(sources, stream, size)


@dataclass
class NoisePosition:
    """A position in a stream: its name, how many perturbations were taken, and those drawn."""

    stream: str = ""
    taken: int = 0
    drawn: np.ndarray | None = None


class Noise:
    """A source of relative perturbations of size between h/2 and h, either sign.

    Below the smallest normal number the spacing of float64 stays that at this number, and so does
    the size of the perturbations: a number that has underflowed, perhaps to 0, is perturbed too.

    Args:
        seed: of the random numbers.
        step: h.
    """

    def __init__(self, seed: int, step: float = STEP):
        self.seed, self.step = seed, step
        self.position = NoisePosition()

    @contextmanager
    def stream(self, name: str) -> Iterator[None]:
        """Draw from the start of the stream `name` inside the block; afterwards go on as before."""
        before, self.position = self.position, NoisePosition(name)
        try:
            yield
        finally:
            self.position = before

    def changes(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return the next perturbations of the stream, of magnitude h/2 to h."""
        return self._next(((self.seed, self.step),), math.prod(shape))[0].reshape(shape)

    def _next(self, sources: tuple[tuple[int, float], ...], count: int) -> np.ndarray:
        """Return the next perturbations (k, count) of sources (seed, step)."""
        at = self.position
        first, at.taken = at.taken, at.taken + count
        if at.drawn is None or at.taken > at.drawn.shape[1]:
            at.drawn = draws_of(sources, at.stream, at.taken)
        return at.drawn[:, first : at.taken]

    def perturbed(self, x: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Return x with each entry perturbed relative to `size`, of the same shape."""
        return x + self.changes(np.shape(x)) * np.maximum(size, NORMAL)

    def perturb(self, x: np.ndarray) -> np.ndarray:
        """Return x, numbers that were read or rounded, each entry perturbed relative to itself."""
        with np.errstate(all="ignore"):
            return self.perturbed(x, np.abs(x))

    def perturb_record(self, x: Any) -> Any:
        """Return a record with each entry of every array perturbed; None stays None.

        In `Angles` only cosines and sines are, which were rounded: the angles themselves were read.
        """
        if isinstance(x, Angles):
            return Angles(x.value, self.perturb(x.cos), self.perturb(x.sin))
        return map_record(lambda part: self.as_perturbed(self.perturb(np.asarray(part))), x)

    def as_perturbed(self, x: np.ndarray) -> PerturbedArray:
        """Return x as an array on which every operation of whole arrays is perturbed."""
        perturbed = x.view(PerturbedArray)
        perturbed.noise = self
        return perturbed


EXACT_UFUNCS = (np.negative, np.absolute, np.positive, np.maximum)
"""Operations of whole arrays that do not round, and are not perturbed."""


class PerturbedArray(np.ndarray):
    """A float64 array; the result of an operation on it is perturbed, as it would be by rounding.

    A product of matrices is perturbed relative to the magnitudes of its terms, not to its own size:
    each term is rounded, also where the terms cancel.
    """

    noise: Noise | None = None

    def __array_finalize__(self, other):
        self.noise = getattr(other, "noise", None)

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
        plain = [x.view(np.ndarray) if isinstance(x, PerturbedArray) else x for x in inputs]
        if out is not None:
            options["out"] = tuple(x.view(np.ndarray) for x in out)
        result = getattr(ufunc, method)(*plain, **options)
        noise = next((x.noise for x in inputs if isinstance(x, PerturbedArray)), None)
        rounded = isinstance(result, np.ndarray | np.floating) and result.dtype == np.float64
        if not rounded or noise is None or method != "__call__" or ufunc in EXACT_UFUNCS:
            return result
        size = np.abs(plain[0]) @ np.abs(plain[1]) if ufunc is np.matmul else np.abs(result)
        result = np.asarray(result)
        perturbed = noise.perturbed(result, size)
        if out is not None:
            result[...] = perturbed
            return out[0]
        return noise.as_perturbed(np.asarray(perturbed))


class NoisyArithmetic:
    """An arithmetic whose cosines, sines and roots are perturbed as well."""

    def __init__(self, arithmetic: Arithmetic, noise: Noise):
        self._arithmetic, self._noise = arithmetic, noise

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as numbers of the wrapped arithmetic."""
        return self._arithmetic.numbers(x)

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,), with perturbed cosines and sines."""
        return self._noise.perturb_record(self._arithmetic.angles(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,), perturbed."""
        return self._noise.perturb(self._arithmetic.root(x))
