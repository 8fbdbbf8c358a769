"""`solve`: the one linear solve that formulations call, on every kind of number.

Doubles go to LAPACK's LU with partial pivoting, which is watched: every matrix solved is recorded
by name with its reciprocal condition number, and a matrix that is singular to working precision is
refused. Object arrays go to the solver registered for their scalar type; fields without one
(`fractions.Fraction`) are eliminated exactly. `eomcheck.arithmetic.float64` replaces the function
in compiled code.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

from eomcheck.arithmetic.noise import Noise
from eomcheck.errors import RefusedError

_getrf, _gecon, _getrs = get_lapack_funcs(("getrf", "gecon", "getrs"), dtype=np.float64)

EPS = float(np.finfo(np.float64).eps)

SOLVERS: dict[type, Callable] = {}
"""Scalar type -> function (A, b, name) -> x, for arithmetics that bring a solver of their own."""

CARRIERS: set[type] = set()
"""Kinds of number that carry another kind, and stand beside it where they have nothing to add."""


class Solve(NamedTuple):
    """One matrix that was solved: its name, its order and its reciprocal condition number."""

    name: str
    size: int
    rcond: float


class Watch:
    """What `solve` reports to while doubles are evaluated."""

    def __init__(self, noise: Noise | None = None):
        self.noise = noise
        self.solves: list[Solve] = []

    @property
    def rcond(self) -> dict[str, float]:
        """Reciprocal condition number of each matrix solved, by name."""
        return {solve.name: solve.rcond for solve in self.solves}


_watch: ContextVar[Watch | None] = ContextVar("watch", default=None)


@contextmanager
def watching(noise: Noise | None = None) -> Iterator[Watch]:
    """Collect every `Solve` made inside the block; with `noise`, move the matrices as well."""
    token = _watch.set(watch := Watch(noise))
    try:
        yield watch
    finally:
        _watch.reset(token)


def noise_present() -> Noise | None:
    """Return the noise by which matrices are to be moved, if any."""
    watch = _watch.get()
    return None if watch is None else watch.noise


def record(
    name: str, size: int, rcond: float, matrix: np.ndarray, terms: int | None = None
) -> None:
    """Record a matrix that was factored, except while noise moves it.

    Args:
        name: of the matrix.
        size: its order.
        rcond: its reciprocal condition number.
        matrix: itself, or its bands.
        terms: most terms in a sum that elimination forms, by default the order.

    Raises:
        RefusedError: it is singular to working precision.
    """
    watch = _watch.get()
    if watch is not None:
        if watch.noise is not None:
            return
        watch.solves.append(Solve(name, size, rcond))
    allowed = singular_below(size if terms is None else terms)
    if not rcond > allowed:
        raise RefusedError(
            name,
            rcond,
            allowed,
            f"the {size} x {size} matrix {name} is singular to working precision: its "
            f"reciprocal condition number is {rcond:.2g}, allowed is above {allowed:.2g}",
            matrix,
        )


def singular_below(terms: int) -> float:
    """Return the reciprocal condition number at and below which a scaled matrix is singular.

    LU with partial pivoting solves (A + E) x = b exactly, where each column of E is at most about
    terms * eps times the largest entry of that column of A (Higham 2002, Thm. 9.3, with the growth
    factor near 1 that is met in practice); `terms` is the number of terms in the sums that
    elimination forms, the order of a full matrix. At rcond <= terms * eps some such A + E is
    singular, so no digit of x is determined.
    """
    return terms * EPS


def solve(A, b, name):
    """Solve A x = b.

    Args:
        A: (k, k) matrix.
        b: (k,) or (k, m) right-hand sides.
        name: what the formulation calls A; refusals and records carry it.

    Returns:
        x in the shape of b.

    Raises:
        RefusedError: A is singular (for doubles: to working precision).
    """
    if A.dtype != object:
        return _lapack_solve(A, b, name)
    if A.shape[0] == 0:
        return b.copy()
    # Generic functions write literal zeros and ones among the numbers of the model.
    kinds = {type(x) for x in chain(A.flat, b.flat) if not isinstance(x, int)}
    kind = next(iter(kinds & CARRIERS or kinds), int)
    return SOLVERS.get(kind, eliminate)(A, b, name)


def _lapack_solve(A, b, name):
    size = A.shape[0]
    if size == 0:
        return b.copy()
    noise = noise_present()
    # First columns, then rows: neither the units of the unknowns nor those of the equations matter.
    scale = column_scale(A)
    A = A * scale
    row_scale = column_scale(A.T)
    A, b = A * row_scale[:, None], b * (row_scale if b.ndim == 1 else row_scale[:, None])
    if noise is not None:
        A = noise.by_column(A)
    lu, pivots, _ = _getrf(A)
    rcond = _gecon(lu, np.abs(A).sum(axis=0).max())[0] if np.isfinite(lu).all() else 0.0
    record(name, size, float(rcond), A)
    x = _getrs(lu, pivots, b)[0] if np.diagonal(lu).all() else np.full(b.shape, np.nan)
    x = x * (scale if b.ndim == 1 else scale[:, None])
    # Each right-hand side is rounded by itself: where results are summed and cancel, it shows.
    return x if noise is None else noise.entries(x)


def column_scale(A: np.ndarray) -> np.ndarray:
    """Return powers of two, shape (k,), that bring the largest entry of each column near 1.

    Elimination with partial pivoting does not notice a scaling of columns: pivots and digits are
    the same. It does notice one of rows, for which the same function is used on Aᵀ.
    """
    largest = np.abs(A).max(axis=0)
    usable = (largest > 0) & np.isfinite(largest)
    exponent = np.frexp(np.where(usable, largest, 1.0))[1]
    return np.ldexp(1.0, np.clip(-exponent, -1000, 1000))


def eliminate(A, b, name):
    """Solve A x = b over any exact field by Gauss-Jordan elimination, first nonzero pivot."""
    size = A.shape[0]
    work = np.concatenate((A, b.reshape(size, -1)), axis=1)
    number = next((x for x in work.flat if not isinstance(x, int)), None)
    # A quotient of two literals would be a double.
    work = work + 0 * (Fraction(0) if number is None else number)
    for column in range(size):
        pivot = next((row for row in range(column, size) if work[row, column] != 0), None)
        if pivot is None:
            raise RefusedError(name, 0.0, 0.0, f"the {size} x {size} matrix {name} is singular")
        work[[column, pivot]] = work[[pivot, column]]
        work[column] = work[column] / work[column, column]
        for row in range(size):
            if row != column and work[row, column] != 0:
                work[row] = work[row] - work[row, column] * work[column]
    x = work[:, size:].reshape(b.shape)
    if number is None:
        # Literals go with every kind of number, fractions do not.
        x.flat = [y.numerator if y.denominator == 1 else y for y in x.flat]
    return x
