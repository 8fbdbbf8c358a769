"""Sources of random choices: a NumPy generator, or hypothesis, that draws a scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np

T = TypeVar("T")

Factors = dict[str, tuple[str, ...]]
"""Name of a property -> the ways there are."""


class Choices(Protocol):
    """A source of choices. The first of several, and 0, are the simplest: to these draws shrink."""

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of several, one at least."""
        ...

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        ...

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        ...


class GeneratorChoices:
    """Choices by a generator of NumPy's: all that there are equally often.

    Args:
        random: the generator.
    """

    def __init__(self, random: np.random.Generator):
        self._random = random

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of several, one at least."""
        return among[int(self._random.integers(len(among)))]

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        return int(self._random.integers(low, high + 1))

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        return float(self._random.uniform(low, high))
