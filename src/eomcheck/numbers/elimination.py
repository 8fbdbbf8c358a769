"""Elimination for numbers that have no size: expressions, of which one can only tell what is 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from eomcheck.numbers.contract import Array

Solver = Callable[[Array, Array, str], Array]


def eliminating(vanishes: Callable[[Any], bool]) -> Solver:
    """Return a `solve` that takes the first pivot that does not vanish identically.

    Args:
        vanishes: whether an entry is 0 whatever its variables are.
    """

    def solve(A: Array, b: Array, name: str) -> Array:
        size = A.shape[0]
        A, x = A.copy(), b.reshape(size, -1).copy()
        for column in range(size):
            there = (row for row in range(column, size) if not vanishes(A[row, column]))
            pivot = next(there, column)
            for part in (A, x):
                part[[column, pivot]] = part[[pivot, column]]
            for row in range(column + 1, size):
                factor = A[row, column] / A[column, column]
                # No row below needs the entries under the diagonal.
                for part, first in ((A, column + 1), (x, 0)):
                    for k in range(first, part.shape[1]):
                        part[row, k] = part[row, k] - factor * part[column, k]
        for row in range(size - 1, -1, -1):
            for k in range(x.shape[1]):
                for column in range(row + 1, size):
                    x[row, k] = x[row, k] - A[row, column] * x[column, k]
                x[row, k] = x[row, k] / A[row, row]
        return x.reshape(b.shape)

    return solve
