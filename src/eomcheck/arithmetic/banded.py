"""`solve_banded`: the sibling of `solve` for matrices with entries near their diagonal only, O(m).

A matrix (m, m) of half-bandwidth h is kept row by row: `bands[i, h + j - i]` is its entry (i, j),
`bands` has the shape (m, 2h + 1), and what lies beside the matrix is never read. Rows are exchanged
as in a full matrix, which fills up to h further entries of each row.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import chain

import numpy as np
from scipy.linalg import get_lapack_funcs

from eomcheck.arithmetic.linear import SOLVERS, column_scale, noise_present, record
from eomcheck.errors import RefusedError

_gbtrf, _gbcon, _gbtrs = get_lapack_funcs(("gbtrf", "gbcon", "gbtrs"), dtype=np.float64)

BANDED_SOLVERS: dict[type, Callable] = {}
"""Scalar type -> function (bands, b, name) -> x. Other types that are in `SOLVERS` get the full
matrix, those in neither are eliminated exactly."""


def solve_banded(bands, b, name):
    """Solve A x = b.

    Args:
        bands: the rows of A between the outer diagonals (m, 2h + 1), see the module.
        b: right-hand side (m,).
        name: what the formulation calls A; refusals and records carry it.

    Returns:
        x (m,).

    Raises:
        RefusedError: A is singular (for doubles: to working precision).
    """
    if bands.dtype != object:
        return _lapack_solve(bands, b, name)
    kind = type(next((x for x in chain(bands.flat, b.flat) if not isinstance(x, int)), 0))
    if kind not in BANDED_SOLVERS and kind in SOLVERS:
        return SOLVERS[kind](full(bands), b, name)
    return BANDED_SOLVERS.get(kind, eliminate_banded)(bands, b, name)


def full(bands: np.ndarray) -> np.ndarray:
    """Return the matrix (m, m) with all its zeros."""
    size, half = bands.shape[0], bands.shape[1] // 2
    A = np.zeros((size, size), bands.dtype)
    for i in range(size):
        first, last = max(i - half, 0), min(i + half + 1, size)
        A[i, first:last] = bands[i, half + first - i : half + last - i]
    return A


# ---- Doubles -------------------------------------------------------------------------------------


def _lapack_solve(bands, b, name):
    size, half = bands.shape[0], bands.shape[1] // 2
    noise = noise_present()
    columns = np.arange(size)[:, None] + np.arange(-half, half + 1)
    inside = (columns >= 0) & (columns < size)
    columns = np.where(inside, columns, 0)

    def by_column(bands):
        """Return LAPACK's storage (2h + 1, m): row h + i - j, column j has the entry (i, j)."""
        out = np.zeros((2 * half + 1, size))
        rows = 2 * half - np.arange(2 * half + 1) + np.zeros_like(columns)
        out[rows[inside], columns[inside]] = bands[inside]
        return out

    # As in `solve`: first columns, then rows, by powers of two.
    scale = column_scale(by_column(bands))
    bands = np.where(inside, bands * scale[columns], 0.0)
    row_scale = column_scale(bands.T)
    bands, b = bands * row_scale[:, None], b * row_scale
    A = by_column(bands)
    if noise is not None:
        A = noise.by_column(A)
    lu, pivots, _ = _gbtrf(np.vstack((np.zeros((half, size)), A)), half, half)
    finite = np.isfinite(lu).all()
    norm = np.abs(A).sum(axis=0).max()
    rcond = float(_gbcon(half, half, lu, pivots, norm)[0]) if finite else 0.0
    record(name, size, rcond, bands)
    x = np.full(size, np.nan)
    if finite and lu[2 * half].all():
        x = _gbtrs(lu, half, half, b, pivots)[0] * scale
    return x if noise is None else noise.entries(x)


# ---- Exact numbers and balls ---------------------------------------------------------------------


def first_nonzero(column: list) -> int | None:
    """Return the place of the first entry that is not zero, or None."""
    return next((place for place, x in enumerate(column) if x != 0), None)


def eliminate_banded(
    bands, b, name, pivot: Callable[[list], int | None] = first_nonzero
) -> np.ndarray:
    """Solve A x = b by elimination inside the band.

    At most h + 1 rows have an entry in the column that is being eliminated. Each begins at that
    column and has 2h + 1 entries.

    Args:
        bands: as for `solve_banded`.
        b: right-hand side (m,).
        name: of A.
        pivot: chooses among the entries of a column; None where none of them will do.

    Raises:
        RefusedError: there is no pivot.
    """
    size, half = bands.shape[0], bands.shape[1] // 2
    number = next((x for x in chain(bands.flat, b.flat) if not isinstance(x, int)), None)
    # A quotient of two literals would be a double.
    zero = Fraction(0) if number is None else 0 * number
    rows = [[*bands[i, half - i :], *[0] * (half - i), b[i]] for i in range(min(half, size))]
    upper = []
    for column in range(size):
        if column + half < size:
            rows.append([*bands[column + half], b[column + half]])
        place = pivot([row[0] for row in rows])
        if place is None:
            raise RefusedError(name, 0.0, 0.0, f"the {size} x {size} matrix {name} is singular")
        chosen = rows.pop(place)
        chosen[0] = chosen[0] + zero
        upper.append(chosen)
        for row in rows:
            if not (isinstance(row[0], int) and row[0] == 0):
                factor = row[0] / chosen[0]
                row[:] = [x - factor * y for x, y in zip(row, chosen, strict=True)]
            row[:-1] = [*row[1:-1], 0]
    x = np.zeros(size, object)
    for i in range(size - 1, -1, -1):
        row = upper[i]
        x[i] = row[-1] + zero
        for y, coefficient in zip(x[i + 1 :], row[1:-1], strict=False):
            x[i] = x[i] - coefficient * y
        x[i] = x[i] / row[0]
    return x
