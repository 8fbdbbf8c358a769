"""What the factors of a matrix say: its determinant, its condition, and what elimination rounds."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

from eomcheck.numbers.noise import NORMAL
from eomcheck.numbers.pivots import scale_of

(_getri,) = get_lapack_funcs(("getri",), dtype=np.float64)


class Factors:
    """The magnitudes of the factors of a matrix: |L||U|, rows as in the matrix.

    eps times about this is what elimination, and substitution for each right-hand side, change it.

    Args:
        lu: factors (..., k, k).
        pivots: the row (..., k) that each row was exchanged with, as LAPACK has them.
    """

    def __init__(self, lu: np.ndarray, pivots: np.ndarray):
        self.lu = lu
        upper, one = _triangle(lu.shape[-1])
        size = np.abs(lu)
        self.L, self.U = np.where(upper, one, size), np.where(upper, size, 0.0)
        if pivots.ndim == 1:
            self.place: Any = (..., order_of(pivots))
            self.rows: Any = (*self.place, slice(None))
        else:
            self.place = self.rows = np.arange(len(pivots))[:, None], order_of(pivots)

    def times(self, x: np.ndarray) -> np.ndarray:
        """Return |L||U| x, x (..., k) or (..., k, m); of one matrix, x may be several."""
        out = np.empty_like(x)
        if x.ndim >= self.U.ndim:
            out[self.rows] = self.L @ (self.U @ x)
        else:
            out[self.place] = (self.L @ (self.U @ x[..., None]))[..., 0]
        return out


class Rounding(NamedTuple):
    """What elimination rounds of a matrix: |L| and |U|, and how it was scaled (..., k)."""

    sizes: Factors
    scale: np.ndarray
    row_scale: np.ndarray

    def of(self, x: np.ndarray, scale: np.ndarray, row_scale: np.ndarray) -> np.ndarray:
        """Return |L||U| x for x >= 0 (..., k) or (..., k, m), both scaled as told (..., k)."""
        size = times_rows(x, scale / self.scale)
        rounded = self.sizes.times(size if x.ndim > scale.ndim else size[..., None])
        return times_rows(rounded.reshape(x.shape), row_scale / self.row_scale)


@cache
def _triangle(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where the upper triangle is (size, size), and the identity."""
    return ~np.tri(size, k=-1, dtype=bool), np.eye(size)


ROUNDS = 20
"""Most rounds of the iteration for a spectral radius; three to five are common."""


def reciprocal_condition(lu: np.ndarray, pivots: np.ndarray, sizes: Factors) -> float:
    """Return 1 / ρ(|A⁻¹| |L||U|) of a factored matrix, or a little less; 0 where it is singular.

    |L||U| is the backward error of elimination. The spectral radius ρ is the norm of |A⁻¹| |L||U|
    in the best of all units of the unknowns, and does not depend on those of the equations either
    (Bauer 1963; Higham 2002, Sec. 7.3): kilograms or grams make no difference.
    """
    if not (np.isfinite(lu).all() and np.diagonal(lu).all()):
        return 0.0
    size = len(lu)
    inverse = np.abs(_getri(lu, pivots, lwork=64 * size)[0])
    if not np.isfinite(inverse).all():
        return 0.0
    inverse = inverse[:, sizes.place[-1]]  # of rows in the order of their elimination
    weights, radius = np.ones(size), np.inf
    for _ in range(ROUNDS):
        product = inverse @ (sizes.L @ (sizes.U @ weights))
        # With any positive weights the largest ratio bounds ρ from above (Collatz, Wielandt).
        before, radius = radius, min(radius, float((product / weights).max()))
        if radius > 0.9 * before:
            break
        weights = np.maximum(product / product.max(), NORMAL)
    return min(1.0 / radius, 1.0)


def determinant(diagonal: np.ndarray, pivots: np.ndarray, *scales: np.ndarray) -> tuple[Any, Any]:
    """Return (sign, log2 |det|) of the matrix as it was before it was scaled, or (...,) of several.

    Args:
        diagonal: of its factor U (..., k).
        pivots: the row (..., k) that each row was exchanged with, as LAPACK has them.
        scales: powers of two (..., k) by which rows and columns were multiplied.
    """
    exchanges = np.count_nonzero(pivots != np.arange(pivots.shape[-1]), axis=-1)
    with np.errstate(divide="ignore"):
        log = np.log2(np.abs(diagonal)).sum(-1) - sum(np.log2(s).sum(-1) for s in scales)
    return np.prod(np.sign(diagonal), axis=-1) * (-1) ** exchanges, log


def column_scale(A: np.ndarray) -> np.ndarray:
    """Return powers of two (..., k) that bring the largest entry of each column of A near 1.

    Elimination with partial pivoting does not notice a scaling of columns: pivots and digits are
    the same. It does notice one of rows, for which the same function is used on Aᵀ.
    """
    return scale_of(np.abs(A).max(axis=-2))


def order_of(pivots):
    """Return the rows (..., k) in the order of their elimination, of pivots of this shape."""
    if pivots.ndim > 1:
        first, order = np.arange(len(pivots)), np.tile(np.arange(pivots.shape[1]), (len(pivots), 1))
        for i, pivot in enumerate(pivots.T):
            order[:, i], order[first, pivot] = order[first, pivot], order[:, i].copy()
        return order
    order = list(range(len(pivots)))
    for i, pivot in enumerate(pivots.tolist()):
        order[i], order[pivot] = order[pivot], order[i]
    return np.array(order)


def times_rows(x, scale):
    """Return x (..., k) or (..., k, m), each row times its scale (..., k)."""
    return x * (scale if x.ndim == scale.ndim else scale[..., None])
