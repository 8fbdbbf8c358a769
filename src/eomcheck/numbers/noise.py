"""Random relative perturbations: a condition number is measured instead of guessed.

Rounding changes every number that a computation reads or forms by a relative eps. Perturbing them
all by a much larger relative step h measures how strongly this very computation, cancellation and
ill-conditioned matrices included, amplifies such changes: by |change| / h. Rounding then changes
the result by about eps times that.

Perturbed inputs and results are not enough: where large terms cancel identically, as those of a
wheel's acceleration do, perturbing their inputs changes them alike, and only the rounding error of
each by itself is left. So every operation of a generic function is perturbed by itself
(`eomcheck.kernels.perturbed_trace`; Monte Carlo arithmetic: Parker 1997).

A perturbation is a function of three things: the seed, the name of the quantity that is computed,
and how many were drawn for it before. So a quantity is perturbed alike whatever was computed before
it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np

from eomcheck.numbers.generic import Angles, Arithmetic, map_record

STEP = 2.0**-46
"""h: 64 eps, above rounding, and so small that a result that is lost altogether, which changes by
its own size whatever the step, measures as 1/h: its error bound is then as large as itself."""

NORMAL = float(np.finfo(np.float64).tiny)
"""The smallest normal number."""

SAMPLES = 4
"""Independent noises per measurement; the largest change counts."""

STRETCH = 8.0
"""The first noise is also tried this many times larger: a change that does not grow is saturated,
and says nothing about smaller noise."""

SMALLEST_DRAW, LARGEST_CACHED_DRAW = 2**10, 2**14
"""Changes are drawn so many at a time, or more; up to so many are kept for other states."""


def _draw(seed: int, stream: str, size: int) -> np.ndarray:
    """Return numbers (size,) of magnitude 1/2 to 1, the first of those that a larger size gives."""
    # Magnitudes vary so that two equal contributions never cancel exactly.
    x = np.random.default_rng([seed, zlib.crc32(stream.encode())]).uniform(-1.0, 1.0, size)
    x = 0.5 * (x + np.copysign(1.0, x))
    x.setflags(write=False)
    return x


_cached_draw = lru_cache(256)(_draw)


@lru_cache(64)
def _stacked_draws(sources: tuple[tuple[int, float], ...], stream: str, size: int) -> np.ndarray:
    """Return the changes (k, size) that sources (seed, step) draw."""
    x = np.stack([step * _cached_draw(seed, stream, size) for seed, step in sources])
    x.setflags(write=False)
    return x


class Noise:
    """A source of relative changes of size between h/2 and h, either sign.

    Below the smallest normal number the spacing of doubles stays that at this number, and so does
    the size of the changes: what has underflowed, to 0 perhaps, shows.
    """

    shape: tuple[int, ...] = ()
    """Axes in front of every array that is changed, see `NoiseBatch`."""
    enabled = True
    """Whether it changes anything, see `NoiseBatch.disabled`."""

    def __init__(self, seed: int, step: float = STEP):
        self.seed, self.step = seed, step
        self._stream, self._drawn, self._taken = "", np.empty(0), 0

    @contextmanager
    def stream(self, name: str) -> Iterator[None]:
        """Take changes from the first of those called `name`; afterwards go on as before."""
        before = self._stream, self._drawn, self._taken
        self._stream, self._drawn, self._taken = name, np.empty(0), 0
        try:
            yield
        finally:
            self._stream, self._drawn, self._taken = before

    def changes(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return numbers of magnitude h/2 to h, those that come next."""
        first = self._taken
        self._taken += math.prod(shape)
        if self._taken > len(self._drawn):
            size = max(SMALLEST_DRAW, 1 << (self._taken - 1).bit_length())
            self._drawn = (_cached_draw if size <= LARGEST_CACHED_DRAW else _draw)(
                self.seed, self._stream, size
            )
        return self.step * self._drawn[first : self._taken].reshape(shape)

    def perturb(self, x: np.ndarray) -> np.ndarray:
        """Change each entry of x relative to itself: numbers that were read or rounded."""
        with np.errstate(all="ignore"):
            return x + self.changes(x.shape) * np.maximum(np.abs(x), NORMAL)

    def perturb_record(self, x: Any) -> Any:
        """Change each entry of every array in a record; what is absent stays absent.

        Of `Angles` only cosines and sines, which were rounded: the angles are what was read.
        """
        if isinstance(x, Angles):
            return Angles(x.value, self.perturb(x.cos), self.perturb(x.sin))
        return map_record(lambda part: self.as_perturbed(self.perturb(np.asarray(part))), x)

    def as_perturbed(self, x: np.ndarray) -> PerturbedArray:
        """Return x with every operation of whole arrays on it moved."""
        moved = x.view(PerturbedArray)
        moved.noise = self
        return moved


class NoiseBatch(Noise):
    """Several noises side by side, each of which changes its own part of arrays as it would alone.

    The first axis of every array that is changed is that of the noises.
    """

    def __init__(self, noises: Sequence[Noise]):
        super().__init__(noises[0].seed)
        self._sources = tuple((noise.seed, noise.step) for noise in noises)
        self.shape = (len(noises),)

    def changes(self, shape: tuple[int, ...]) -> np.ndarray:
        """Return numbers, those that come next of each noise; `shape` begins with `self.shape`."""
        first = self._taken
        self._taken += math.prod(shape[1:])
        if not self._drawn.size or self._taken > self._drawn.shape[-1]:
            size = max(SMALLEST_DRAW, 1 << (self._taken - 1).bit_length())
            draw = _stacked_draws if size <= LARGEST_CACHED_DRAW else _stacked_draws.__wrapped__
            self._drawn = draw(self._sources, self._stream, size)
        return self._drawn[:, first : self._taken].reshape(shape)

    @contextmanager
    def disabled(self) -> Iterator[None]:
        """Change nothing meanwhile: neither what asks for changes nor arrays that were made."""
        moving, self._sources = self._sources, tuple((seed, 0.0) for seed, _ in self._sources)
        self.enabled = False
        try:
            with self.stream(self._stream):
                yield
        finally:
            self._sources, self.enabled = moving, True

    @contextmanager
    def split(self) -> Iterator[list[Noise]]:
        """Yield the noises one by one, each where all are; afterwards go on behind them."""
        noises = [Noise(*source) for source in self._sources]
        for one in noises:
            one._stream, one._taken = self._stream, self._taken
        yield noises
        self._taken = max(one._taken for one in noises)


EXACT_UFUNCS = (np.negative, np.absolute, np.positive, np.maximum)
"""Operations of whole arrays that do not round."""


class PerturbedArray(np.ndarray):
    """An array of doubles; the result of an operation on it is moved, as rounding would.

    A product of matrices moves by what rounding its terms does, and not by its own size: formed
    twice of the same matrix, it is wrong in two ways.
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
        change = noise.changes(np.shape(result)) * np.maximum(size, NORMAL)
        if out is not None:
            result += change
            return out[0]
        return noise.as_perturbed(np.asarray(result + change))


class NoisyArithmetic:
    """An arithmetic whose cosines, sines and roots are moved as well."""

    def __init__(self, arithmetic: Arithmetic, noise: Noise):
        self._arithmetic, self._noise = arithmetic, noise

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as the arithmetic does."""
        return self._arithmetic.numbers(x)

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,), their cosines and sines, all moved."""
        return self._noise.perturb_record(self._arithmetic.angles(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,), moved."""
        return self._noise.perturb(self._arithmetic.root(x))
