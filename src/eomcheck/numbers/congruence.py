"""Congruence sums Σ Jᵀ D J over bodies, of Jacobians J with many structural zeros.

If few columns of the Jacobians are nonzero together, every product is a scalar operation, in a
fixed order. If many are, the sums are one product of matrices: a recorded tape would otherwise have
n³ operations.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import PRODUCTS, matrix_product, scalar_type_of

MANY = 8192
"""Number of multiplications above which the sums are one product of matrices ..."""

WIDE = 16
"""... if more columns than this are nonzero together, on the average of the multiplications."""


def add_congruence(
    both: Array,
    J: Array,
    weights: Array,
    rest: Array,
    more: Array | None = None,
    support: Array | None = None,
) -> None:
    """Add Σ Jᵀ D J and Σ Jᵀ (D rest + more) to sums, in place.

    Args:
        both: sums so far (p, p+1): of the matrices, of which only the lower triangle is used, and,
            in the last column, of the vectors.
        J: matrices (k, c, p).
        weights: D, symmetric (k, c, c), or multiples of 1 (k,).
        rest: vectors (k, c).
        more: vectors (k, c); None for zeros.
        support: whether a column of each J may differ from 0, bool (k, p); None if all may.
    """
    count, size, p = J.shape
    columns = [list(range(p))] * count
    if support is not None:
        columns = [np.flatnonzero(row).tolist() for row in support]
    whole = _is_large(columns, size) and (J.dtype != object or scalar_type_of(J) in PRODUCTS)
    if whole:
        momenta = _weighted(J, weights, columns).reshape(-1, p)
        right = np.concatenate((J.reshape(-1, p), rest.reshape(-1, 1)), axis=1)
        both += matrix_product(np.ascontiguousarray(momenta.T), right)
    for c in range(size):
        for f in () if whole else _nonzero_columns(weights, c):
            for k in range(count):
                weight = weights[k] if weights.ndim == 1 else weights[k, c, f]
                for position, i in enumerate(columns[k]):
                    momentum = weight * J[k, c, i]
                    both[i, p] += momentum * rest[k, f]
                    for j in columns[k][: position + 1]:
                        both[i, j] += momentum * J[k, f, j]
        if more is not None:
            for k in range(count):
                for i in columns[k]:
                    both[i, p] += J[k, c, i] * more[k, c]


def _nonzero_columns(weights: Array, c: int) -> Sequence[int]:
    """Return the columns of D that may be nonzero in its row c."""
    return (c,) if weights.ndim == 1 else range(weights.shape[1])


def _is_large(columns: list[list[int]], size: int) -> bool:
    widths = np.array([len(x) for x in columns])
    products = size * (widths * (widths + 1) // 2).sum()
    return bool(products > MANY and (widths**2).sum() > WIDE * widths.sum())


def _weighted(J: Array, weights: Array, columns: list[list[int]]) -> Array:
    """Return D J (k, c, p)."""
    weighted = np.zeros(J.shape, J.dtype)
    for k, nonzero in enumerate(columns):
        for c in range(J.shape[1]):
            for f in _nonzero_columns(weights, c):
                weight = weights[k] if weights.ndim == 1 else weights[k, c, f]
                for i in nonzero:
                    weighted[k, c, i] += weight * J[k, f, i]
    return weighted
