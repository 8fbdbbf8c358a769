"""Banded linear solves: `solve_banded`, for matrices with 3 entries on each side of the diagonal.

Matrices for two unknowns of each body and two of each joint, ordered along a chain, have this form.
Row i of the matrix is `bands[i]`: entry (i, j) is `bands[i, 3 + j - i]`, a zero if there is no
column j. The cost is O(m).

float64 matrices are eliminated from both ends at once with partial pivoting, which may fill 3 more
entries of a row, and the solution is refined in the same precision, see `eomcheck.numbers.pivots`.
In the order in which columns are eliminated the matrix is a band of twice the width. Without
refinement a residual that is small for one row can be large for another if rows are of very
different size, as with masses over many decades; with it the residual of every row is small, or the
matrix is refused. One step is nearly always enough (Skeel 1980; Higham 2002, Thm. 12.4).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from itertools import chain

import numpy as np
from scipy.linalg import get_lapack_funcs

from eomcheck.errors import RefusedError
from eomcheck.numbers.linear import (
    ROUNDS,
    SOLVERS,
    SolveRecord,
    active_noise,
    column_scale,
    determinant,
    for_each_noise,
    record,
    singular_below,
)
from eomcheck.numbers.noise import NORMAL, NoiseBatch
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
    from_both_ends,
)

_gbtrf, _gbcon, _gbtrs = get_lapack_funcs(("gbtrf", "gbcon", "gbtrs"), dtype=np.float64)

HALF = 3
"""Entries on each side of the diagonal."""

WIDTH = 2 * HALF + 1

REACH = 2 * HALF
"""Entries on each side of the diagonal in the order of elimination."""

TERMS = 3 * HALF
"""Largest number of terms in a sum of elimination. On the way to the middle these are products with
6 earlier pivot rows. The last of 7 columns in the middle meets 3 pivot rows of an end and 6 of the
middle."""

BANDED_SOLVERS: dict[type, Callable] = {}
"""Scalar type -> function (bands, b, name) -> x. For other types in `SOLVERS` the full matrix is
solved; for types in neither the band is eliminated exactly."""


def solve_banded(bands, b, name):
    """Solve A x = b.

    Args:
        bands: the rows of A between the outer diagonals (m, 7), see the module.
        b: right-hand side (m,).
        name: name of A in the formulation, for error messages and records.

    Returns:
        x (m,).

    Raises:
        RefusedError: A is singular (in float64: to working precision, or refinement does not
            converge).
    """
    if bands.dtype != object:
        return _lapack_solve(bands, b, name)
    kind = type(next((x for x in chain(bands.flat, b.flat) if not isinstance(x, int)), 0))
    if kind not in BANDED_SOLVERS and kind in SOLVERS:
        return SOLVERS[kind](to_dense(bands), b, name)
    return BANDED_SOLVERS.get(kind, eliminate_banded)(bands, b, name)


def to_dense(bands: np.ndarray) -> np.ndarray:
    """Return the matrix (m, m) with all its zeros."""
    size = len(bands)
    A = np.zeros((size, size), bands.dtype)
    for i in range(size):
        first, last = max(i - HALF, 0), min(i + HALF + 1, size)
        A[i, first:last] = bands[i, HALF + first - i : HALF + last - i]
    return A


# ---- float64 -------------------------------------------------------------------------------------


def _lapack_solve(bands, b, name):
    bands, b, noise = np.asarray(bands), np.asarray(b), active_noise()
    if isinstance(noise, NoiseBatch):
        each = for_each_noise(noise, lambda i, _: _lapack_solve(bands[i], b[i], name))
        return noise.as_perturbed(np.stack(each))
    size = len(bands)
    columns, inside = band_columns(size)
    with np.errstate(all="ignore"):
        if noise is not None:
            bands, b = noise.perturb(bands), noise.perturb(b)
        # As in `solve`: first rows, then columns, by powers of two.
        row_scale = column_scale(bands.T)
        bands = np.where(inside, bands * row_scale[:, None], 0.0)
        scale = column_scale(_by_column(bands, columns, inside))
        A = _BandFactors(bands * scale[columns], columns, inside)
        sign, log = determinant(A.lu[2 * REACH], A.pivots, scale, row_scale)
        rcond = A.reciprocal_condition() if noise is None else np.nan
        x, error, steps = A.solve(b * row_scale)
        record(SolveRecord(name, size, rcond, float(sign), float(log), steps), A.bands, terms=TERMS)
        if noise is None:
            # An error that is not finite is an overflow, and is reported as an overflow.
            if REFINED < error < np.inf:
                raise RefusedError(
                    name,
                    # rcond is that of |A⁻¹||A|, and |L||U| stalled the refinement: at most this.
                    min(rcond, singular_below(TERMS)),
                    singular_below(TERMS),
                    f"the {size} x {size} matrix {name} is eliminated with too much rounding: the "
                    f"backward error of its solution, refined {steps} times, is {error:.2g}, "
                    f"allowed is up to {REFINED:.2g}",
                    A.bands,
                )
            return x * scale
        if not error <= REFINED:
            return np.full(size, np.nan)
        x = A.moved(x, b * row_scale, noise) * scale
    return noise.as_perturbed(noise.perturb(x))


@lru_cache(64)
def band_columns(size):
    """Return the columns (size, 7) of entries of bands, 0 outside, and the mask `inside`."""
    columns = np.arange(size)[:, None] + np.arange(-HALF, HALF + 1)
    inside = (columns >= 0) & (columns < size)
    columns[~inside] = 0
    return columns, inside


PROBES = 8
"""Number of random sign vectors by which the row sums of |A⁻¹| are estimated."""


def random_signs(size):
    """Return the random sign vectors (size, PROBES), the same at every call."""
    return np.random.default_rng(0).choice((-1.0, 1.0), (size, PROBES))


@lru_cache(64)
def lapack_positions(size):
    """Return the order of elimination, and LAPACK's row and column of each entry of the matrix.

    Entry (i, j) is stored at row 6 + i - j of column j, below the rows for fill-in.
    """
    columns, inside = band_columns(size)
    order = from_both_ends(size)
    rank = np.argsort(order)
    i, j = (np.broadcast_to(x, columns.shape)[inside] for x in (rank[:, None], rank[columns]))
    return order, 2 * REACH + i - j, j


class _BandFactors:
    """A banded matrix and its factors.

    Args:
        bands: its rows (m, 7), zero outside of the matrix.
        columns: the column (m, 7) of each entry of `bands`.
        inside: whether an entry of `bands` belongs to the matrix (m, 7).
    """

    def __init__(self, bands, columns, inside):
        self.bands, self.columns, self.inside = bands, columns, inside
        size = len(bands)
        self.order, rows, stored_columns = lapack_positions(size)
        A = np.zeros((3 * REACH + 1, size))
        A[rows, stored_columns] = bands[inside]
        self.lu, self.pivots, _ = _gbtrf(A, REACH, REACH)
        self.invertible = bool(np.isfinite(self.lu).all() and self.lu[2 * REACH].all())

    def solve(self, b):
        """Return x (m,), its backward error, and the number of refinement steps.

        Refinement has converged if the error is at most `REFINED`; NaN stands for an overflow, or
        for a singular matrix.
        """
        if not self.invertible:
            return np.full(b.shape, np.nan), np.nan, 0
        x, steps = self._eliminated(b), 0
        error, before = self._backward_error(x, b), np.inf
        while steps < LEAST_STEPS or (steps < MOST_STEPS and REFINED < error < STALLED * before):
            x, steps = x + self._eliminated(b - self.times(x)), steps + 1
            error, before = self._backward_error(x, b), error
        return x, error, steps

    def _backward_error(self, x, b):
        """Return the largest |b - A x|_i / (|A||x| + |b|)_i."""
        return float((np.abs(b - self.times(x)) / self._sizes(x, b)).max())

    def _sizes(self, x, b):
        """Return |A||x| + |b| (m,), no entry below the rounding error of the other rows."""
        sizes = self.size(np.abs(x)) + np.abs(b)
        return np.maximum(sizes, max(SMALLEST_SIZE, SMALLEST_SHARE * sizes.max()))

    def moved(self, x, b, noise):
        """Return the solution x (m,) with the effect of a random backward error added.

        A refined x has no larger backward error than that of its residual, whatever the factors.
        """
        residual = b - self.times(x) + noise.changes(b.shape) * self._sizes(x, b)
        return x + self._eliminated(residual)

    def _eliminated(self, b):
        x = np.empty_like(b)
        x[self.order] = _gbtrs(self.lu, REACH, REACH, b[self.order], self.pivots)[0]
        return x

    def times(self, x):
        """Return A x."""
        return (self.bands * x[self.columns]).sum(axis=1)

    def size(self, x):
        """Return |A| x."""
        return (np.abs(self.bands) * x[self.columns]).sum(axis=1)

    def reciprocal_condition(self):
        """Return 1 / ρ(|A⁻¹||A|) by LAPACK's condition estimator; 0 where A is singular.

        As `eomcheck.numbers.linear.reciprocal_condition`, with |A| for |L||U|: refinement leaves
        no larger backward error (Skeel 1980). With units w of the unknowns, and rows in units of
        |A| w, the matrix has the norm 1, and its inverse the largest row sum of |A⁻¹||A| w / w. The
        best w are iterated as there, with |A⁻¹| estimated by random signs: the cost is O(m).
        """
        weights, rcond = np.ones(len(self.bands)), 0.0
        signs = random_signs(len(weights))
        for _ in range(ROUNDS):
            if not (self.invertible and np.isfinite(weights).all()):
                break
            rows = self.size(weights)
            scaled = self.bands * weights[self.columns] / rows[:, None]
            other = _BandFactors(scaled, self.columns, self.inside)
            before = rcond
            rcond = max(
                rcond, float(_gbcon(REACH, REACH, other.lu, other.pivots, 1.0, norm="I")[0])
            )
            if rcond < before / 0.9:
                break
            weights = np.abs(self._eliminated(rows[:, None] * signs)).max(axis=1)
            weights = np.maximum(weights / weights.max(), NORMAL)
        return min(rcond, 1.0)


def _by_column(bands, columns, inside):
    """Return bands in LAPACK's storage (7, m): entry (i, j) at row 3 + i - j of column j."""
    out = np.zeros((WIDTH, len(bands)))
    rows = np.broadcast_to(np.arange(WIDTH)[::-1], bands.shape)
    out[rows[inside], columns[inside]] = bands[inside]
    return out


# ---- Exact numbers and ball arithmetic -----------------------------------------------------------


def first_nonzero(column: list) -> int | None:
    """Return the index of the first entry that is not zero, or None."""
    return next((index for index, x in enumerate(column) if x != 0), None)


def eliminate_banded(
    bands, b, name, pivot: Callable[[list], int | None] = first_nonzero
) -> np.ndarray:
    """Solve A x = b by elimination inside the band.

    At most 4 rows have an entry in the column that is being eliminated. Each is stored from that
    column on: 7 entries, followed by its right-hand side.

    Args:
        bands: as for `solve_banded`.
        b: right-hand side (m,).
        name: of A.
        pivot: function of the entries of a column that returns the index of the pivot, or None if
            no entry is suitable.

    Raises:
        RefusedError: there is no pivot.
    """
    size = len(bands)
    number = next((x for x in chain(bands.flat, b.flat) if not isinstance(x, int)), None)
    # A quotient of two integer literals would be a float64.
    zero = Fraction(0) if number is None else 0 * number
    rows = [[*bands[i, HALF - i :], *[0] * (HALF - i), b[i]] for i in range(min(HALF, size))]
    upper = []
    for column in range(size):
        if column + HALF < size:
            rows.append([*bands[column + HALF], b[column + HALF]])
        index = pivot([row[0] for row in rows])
        if index is None:
            raise RefusedError(name, 0.0, 0.0, f"the {size} x {size} matrix {name} is singular")
        chosen = rows.pop(index)
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
