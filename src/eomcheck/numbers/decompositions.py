"""Decompositions of matrices of doubles, or of those of all lanes: by LAPACK, behind one name."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from eomcheck.numbers.factors import column_scale
from eomcheck.numbers.lanes import LaneArray, doubles, lanes_in, lanes_of
from eomcheck.numbers.pivots import EPS


def null_space(a: Any) -> Any:
    """Return an orthonormal basis (n, n-r) of the null space of a (r, n).

    In lanes all are taken to have the rank r; singular values tell where one has not.
    """
    if not lanes_in(a):
        return scipy.linalg.null_space(a)
    _, s, Vh = _svd(a)
    return _lanes(Vh[:, s.shape[-1] :].swapaxes(-1, -2))


def singular_values(a: Any) -> Any:
    """Return the singular values of a, largest first."""
    if not lanes_in(a):
        return np.linalg.svd(a, compute_uv=False)
    return _lanes(np.linalg.svd(_in_front(a), compute_uv=False))


def least_squares(a: Any, b: Any) -> Any:
    """Return the smallest x that minimizes |a x - b|, b (m,) or (m, k); NaN after an overflow."""
    lanes = lanes_in(a)
    if not lanes:
        # Of what is not finite LAPACK complains on the terminal.
        if np.isfinite(a).all() and np.isfinite(b).all():
            return np.linalg.lstsq(a, b, rcond=None)[0]
        return np.full((a.shape[1], *b.shape[1:]), np.nan)
    U, s, Vh = _svd(a)
    k = s.shape[-1]
    with np.errstate(all="ignore"):
        usable = s > EPS * max(a.shape) * s[:, :1]
        over = np.where(usable, 1.0 / s, 0.0)
    right = np.moveaxis(lanes_of(doubles(b), lanes), -1, 0)
    right = right[..., None] if right.ndim == 2 else right
    x = Vh[:, :k].swapaxes(-1, -2) @ (over[..., None] * (U[..., :k].swapaxes(-1, -2) @ right))
    return _lanes(x[..., 0] if len(b.shape) == 1 else x)


def row_scale(a: Any) -> Any:
    """Return powers of two (r,) that bring the largest entry of each row of a (r, n) near 1."""
    if not lanes_in(a):
        return column_scale(a.T)
    return _lanes(column_scale(_in_front(a).swapaxes(-1, -2)))


def _in_front(a: Any) -> np.ndarray:
    return np.moveaxis(lanes_of(a, lanes_in(a)), -1, 0)


def _lanes(x: np.ndarray) -> LaneArray:
    return LaneArray(np.ascontiguousarray(np.moveaxis(x, 0, -1)))


def _svd(a: LaneArray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (U, s, Vᵀ) of each lane, found once for a matrix and its transpose."""
    a = doubles(a)
    if not a.known:
        plain = a.T if a.turned else a
        a.known.append(np.linalg.svd(_in_front(plain)))
    U, s, Vh = a.known[0]
    return (Vh.swapaxes(-1, -2), s, U.swapaxes(-1, -2)) if a.turned else (U, s, Vh)
