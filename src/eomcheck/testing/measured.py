"""Numbers with an error that was measured, and sums and products that carry it along.

A black box cannot be run on perturbed numbers as a scene can. So what its answers are uncertain by
is measured from outside (`eomcheck.testing.noise`, `eomcheck.testing.derivative`), and each sum
and product here adds what it does to that, to first order, and its own rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS


@dataclass(frozen=True, eq=False)
class Measured:
    """An array and how far each entry may be off.

    What is allowed is C times the error, see `eomcheck.evaluation.tolerance.C`.

    Attributes:
        value: the array.
        error: of each entry, not negative, same shape.
        size: of what each entry is summed from, which cancels where the entry is smaller, same
            shape.
    """

    value: Array
    error: Array
    size: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.value.shape

    @property
    def T(self) -> Measured:
        """Transposed."""
        return Measured(self.value.T, self.error.T, self.size.T)

    def __getitem__(self, index: Any) -> Measured:
        return Measured(*(np.asarray(x[index]) for x in (self.value, self.error, self.size)))

    def __neg__(self) -> Measured:
        return Measured(-self.value, self.error, self.size)

    def __add__(self, other: Measured) -> Measured:
        size = self.size + other.size
        return Measured(self.value + other.value, self.error + other.error + EPS * size, size)

    def __sub__(self, other: Measured) -> Measured:
        return self + -other

    def __mul__(self, factor: float) -> Measured:
        return Measured(self.value * factor, self.error * abs(factor), self.size * abs(factor))

    __rmul__ = __mul__

    def __matmul__(self, other: Measured) -> Measured:
        left, right = "ij"[2 - len(self.shape) :], "jk"[: len(other.shape)]
        return contract(f"{left},{right}->{(left + right).replace('j', '')}", self, other)


def exact(array: Any) -> Measured:
    """Return an array without error."""
    value = np.asarray(array, np.float64)
    return Measured(value, np.zeros(value.shape), np.abs(value))


def zero(like: Measured) -> Measured:
    """Return what should vanish, to the rounding of terms of the size of `like`."""
    return Measured(np.zeros(like.shape), EPS * like.size, like.size)


def contract(subscripts: str, *factors: Measured) -> Measured:
    """Return the sum of products that `np.einsum` makes of `subscripts`."""

    def summed(*arrays: Array) -> Array:
        return np.asarray(np.einsum(subscripts, *arrays))

    sizes = [factor.size for factor in factors]
    size = summed(*sizes)
    error = EPS * size
    for k, factor in enumerate(factors):
        error = error + summed(*sizes[:k], factor.error, *sizes[k + 1 :])
    return Measured(summed(*(factor.value for factor in factors)), error, size)
