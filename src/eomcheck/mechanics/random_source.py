"""Sources of random choices for the sampling of scenes: a NumPy generator or hypothesis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np

T = TypeVar("T")

Factors = dict[str, tuple[str, ...]]
"""Property -> its possible levels: the factors of a pairwise design."""


class Choices(Protocol):
    """A source of choices; hypothesis shrinks towards the simplest, first options and 0."""

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of at least one option."""
        ...

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        ...

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        ...


class GeneratorChoices:
    """Choices by a NumPy generator, all options with the same probability.

    Args:
        random: the generator.
    """

    def __init__(self, random: np.random.Generator):
        self._random = random

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of at least one option."""
        return among[int(self._random.integers(len(among)))]

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        return int(self._random.integers(low, high + 1))

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        return float(self._random.uniform(low, high))
