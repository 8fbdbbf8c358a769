"""Gragg-Bulirsch-Stoer extrapolation: ẏ = f(y) to any number of digits, in any kind of number.

The explicit midpoint rule from t to t + H, in n_j = 2, 4, 6, ... substeps, has an error that is a
series in (H/n_j)²; k such results are extrapolated to H = 0 and give order 2k. Step and order are
chosen as in ODEX (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Sec. II.9):
the order of least work per unit of time, tried one order early and one late. What has 25 digits to
deliver runs at orders near 30, with some 200 evaluations of f to a step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from math import ceil, inf, isfinite
from typing import Any

import numpy as np

from eomcheck.errors import EomcheckError, InputError
from eomcheck.numbers.contract import Array

MOST = 24
"""Midpoint results that are extrapolated at most: order 48."""

LEAST, FIRST = 3, 8
"""Midpoint results that a step is planned with at least, and those of the first step."""

SAFETY, SHRINK, GROW = 0.9, 0.02, 4.0
"""Share of the step that the error allows, and how much a step may change at once."""

TINY = 1e-99
"""An error of 0 counts as this, one that is infinite as its inverse."""

SMALLEST = 1e-12
"""A step below this share of the whole time gives the integration up."""


class GaveUpError(EomcheckError, ArithmeticError):
    """The step became too small: the solution is not smooth, or f is not finite."""


def as_it_is(y: Array) -> Array:
    """Return y."""
    return y


@dataclass
class Effort:
    """What an integration took."""

    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    orders: set[int] = field(default_factory=set)
    """Orders of the steps that were taken."""
    longest: float = 0.0
    """The longest step, s."""


@dataclass(frozen=True)
class Extrapolation:
    """An integrator of ẏ = f(y), y an array of any numbers that add, multiply and divide.

    Args:
        f: y (n,) -> ẏ (n,).
        tolerance: error allowed in each step and entry, times 1 + |y|; to be above the rounding
            of the numbers, a hundred times at least.
        number: a step, which is a `Fraction`, as a number to multiply with; by default a double.
        clean: applied to y after each step: what must not build up in it is taken off here.
    """

    f: Callable[[Array], Array]
    tolerance: float
    number: Callable[[Fraction], Any] = float
    clean: Callable[[Array], Array] = as_it_is
    effort: Effort = field(default_factory=Effort)

    def midpoints(self, y: Array, slope: Array, step: Fraction, substeps: int) -> Array:
        """Return y after `step` by the explicit midpoint rule; `slope` is f(y)."""
        h = self.number(step / substeps)
        before, now = y, y + slope * h
        for _ in range(substeps - 1):
            before, now = now, before + self.f(now) * (2 * h)
        self.effort.evaluations += substeps - 1
        return now

    def columns(self, y: Array, step: Fraction) -> Iterator[tuple[Array, float]]:
        """Yield (y after `step` of order 2k, its error over the one allowed) for k = 1, 2, ...

        The error is that of order 2k - 2: the better result is kept. There is none at k = 1.
        """
        slope = self.f(y)
        self.effort.evaluations += 1
        row: list[Array] = []
        for k in range(1, MOST + 1):
            entry, new = self.midpoints(y, slope, step, 2 * k), []
            for j, other in enumerate(row):
                # Aitken-Neville in (H/n)²: n_k² / n_{k-j-1}² - 1, in integers.
                low, high = (k - j - 1) ** 2, k * k
                new.append(entry)
                entry = entry + (entry - other) * low / (high - low)
            new.append(entry)
            yield entry, self.error(y, entry, new[-2]) if row else inf
            row = new

    def error(self, y: Array, better: Array, worse: Array) -> float:
        """Return the largest difference over what is allowed there, inf if it is not a number."""
        apart = np.abs(np.array([float(x) for x in better - worse]))
        size = np.array([max(abs(float(a)), abs(float(b))) for a, b in zip(y, better, strict=True)])
        error = float((apart / (1.0 + size)).max()) / self.tolerance
        return error if isfinite(error) else inf

    def run(
        self,
        y: Array,
        times: Sequence[float],
        first: float | None = None,
        watch: Callable[[Fraction, Array], None] = lambda t, y: None,
    ) -> list[Array]:
        """Return y at each of `times`, which begin with the time of the `y` given and rise.

        Steps end at these times, there is no interpolation.

        Args:
            y: where to start (n,).
            times: doubles, taken for the numbers that they are.
            first: the first step to try; by default 1/1000 of the whole time.
            watch: called with t and y after every step.

        Raises:
            InputError: the times do not rise.
            GaveUpError: the step became too small.
        """
        exact = [Fraction(t) for t in times]
        if not exact or any(b <= a for a, b in pairwise(exact)):
            raise InputError(f"times = {list(times)!r}, expected times that rise")
        whole = float(exact[-1] - exact[0])
        step, target = whole / 1000 if first is None else first, FIRST
        t, found = exact[0], [y]
        for end in exact[1:]:
            while t < end:
                # Equal steps up to `end`, so that none is cut to a stump.
                parts = ceil(float(end - t) / step * (1 - 1e-9))
                equal = Fraction(float(end - t) / parts) if parts > 1 else end - t
                after, step, target = self.attempt(y, equal, target)
                if after is not None:
                    t, y = t + equal, after
                    watch(t, y)
                elif step < SMALLEST * whole:
                    raise GaveUpError(f"a step of {step:.2g} s is needed at t = {float(t)!r} s")
            found.append(y)
        return found

    def attempt(self, y: Array, step: Fraction, target: int) -> tuple[Array | None, float, int]:
        """Return (y after `step`, or None if the error is too large; next step; next target).

        Args:
            y: where to start (n,).
            step: the step.
            target: the number of midpoint results by which the error should be small enough.
        """
        steps: list[float] = []
        before = 1.0 / TINY
        for k, (after, error) in enumerate(self.columns(y, step), 1):
            error = min(max(error, TINY), 1.0 / TINY)
            steps.append(float(step) * SAFETY * error ** (-1.0 / (2 * k - 1)))
            if k >= target - 1:
                if error <= 1.0:
                    self.effort.steps += 1
                    self.effort.orders.add(2 * k)
                    self.effort.longest = max(self.effort.longest, float(step))
                    allowed, target = chosen(steps)
                    return self.clean(after), min(allowed, GROW * float(step)), target
                # Each column divides the error by at least as much as the one before did.
                if k > target or not error * (error / before) ** (target + 1 - k) <= 1.0:
                    break
            before = error
        self.effort.rejected += 1
        best = min(range(2, len(steps) + 1), key=lambda k: cost(k) / steps[k - 1])
        if best < len(steps):
            target = max(best, LEAST)
        return None, min(max(steps[best - 1], SHRINK * float(step)), float(step) / 2), target


def cost(k: int) -> int:
    """Return the evaluations of f that k midpoint results take."""
    return 1 + k * k


def chosen(steps: list[float]) -> tuple[float, int]:
    """Return (next step, next target) from the steps that each order, 2 to 2k, would allow."""
    k = len(steps)
    work, before = cost(k) / steps[-1], cost(k - 1) / steps[-2]
    if work < 0.9 * before and k < MOST - 1:
        return steps[-1] * cost(k + 1) / cost(k), k + 1
    if before < 0.8 * work and k > LEAST:
        return steps[-2], k - 1
    return steps[-1], k
