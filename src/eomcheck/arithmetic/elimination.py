"""Elimination for numbers that have no size: expressions, of which one can only tell what is 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from eomcheck.model import Array

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
                A[row, column + 1 :] = A[row, column + 1 :] - factor * A[column, column + 1 :]
                x[row] = x[row] - factor * x[column]
        for row in range(size - 1, -1, -1):
            for column in range(row + 1, size):
                x[row] = x[row] - A[row, column] * x[column]
            x[row] = x[row] / A[row, row]
        return x.reshape(b.shape)

    return solve
