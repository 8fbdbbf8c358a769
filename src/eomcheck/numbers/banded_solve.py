"""Banded linear solves: `solve_banded`, for matrices with 3 entries on each side of the diagonal.

Matrices for two unknowns of each body and two of each joint, ordered along a chain, have this form.
Row i of the matrix is `bands[i]`: entry (i, j) is `bands[i, 3 + j - i]`, a zero if there is no
column j. The cost is O(m).

float64 matrices are eliminated by LAPACK with partial pivoting, which may fill 3 more entries of a
row, and the solution is refined in the same precision until its backward error β, the largest of
|b - A x|_i / (|A||x| + |b|)_i, is at most `REFINED`, but at least `LEAST_STEPS` times. A step that
does not bring it below `STALLED` times its value before is the last one, and the matrix is refused:
rounding does not explain x (Arioli, Demmel, Duff 1989; Higham 2002, Sec. 12.2).
(|A||x| + |b|)_i counts as ε times the largest of all rows at least (`SMALLEST_SHARE`): if x is 0 in
all unknowns of row i, the computed residual of that row is rounding error of other rows.

Without refinement a residual that is small for one row can be large for another if rows are of very
different size, as with masses over many decades; with it the residual of every row is small, or the
matrix is refused. One step is nearly always enough (Skeel 1980; Higham 2002, Thm. 12.4). Machine
code (`eomcheck.kernels`) refines by the same rules, and takes any pivot of entries that agree to
2^-50.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from itertools import chain

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.numbers.generic import EPS
from eomcheck.numbers.linear import (
    ROUNDS,
    SOLVERS,
    SolveRecord,
    active_noise,
    column_scale,
    determinant,
    lapack,
    record,
    scalar_type_of,
    singular_below,
)
from eomcheck.numbers.noise import NORMAL

HALF = 3
"""Entries on each side of the diagonal."""

WIDTH = 2 * HALF + 1

DIAGONAL = 2 * HALF
"""Row of the diagonal in LAPACK's storage of factors, below the rows for fill-in."""

TERMS = WIDTH
"""Largest number of terms in a sum of elimination: an entry, and products with 6 pivot rows."""

BANDED_SOLVERS: dict[type, Callable] = {}
"""Scalar type -> function (bands, b, name) -> x. For other types in `SOLVERS` the full matrix is
solved; for types in neither the band is eliminated exactly."""

BAND_TERMS = 8
"""Number of terms in a residual: 7 entries of a row of the band, and the right-hand side."""

REFINED = BAND_TERMS * EPS
"""Largest backward error that the rounding of a residual alone can cause."""

LEAST_STEPS, MOST_STEPS = 1, 20
"""Bounds of the number of refinement steps."""

STALLED = 0.5
"""Largest ratio of the backward errors after and before a step; above it refinement stops."""

SMALLEST_SIZE = 2.0**-960
"""Lower limit of |A||x| + |b|: below it residuals underflow, and their size means nothing."""

SMALLEST_SHARE = EPS
"""Lower limit of |A||x| + |b| as a share of its largest entry; rows are scaled."""


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
    kind = scalar_type_of(bands, b)
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
    size = len(bands)
    with np.errstate(all="ignore"):
        if noise is not None:
            bands, b = noise.perturb(bands), noise.perturb(b)
        A, row_scale, scale = scaled_factors(bands, BandFactors)
        sign, log = determinant(A.diagonal, A.pivots, scale, row_scale)
        rcond = float(A.reciprocal_condition()) if noise is None else np.nan
        x, error, steps = A.solve(b * row_scale)
        solve_record = SolveRecord(name, size, rcond, float(sign), float(log), int(steps))
        record(solve_record, A.bands, terms=TERMS)
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
        x = A.perturbed(x, b * row_scale, noise) * scale
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


@lru_cache(64)
def random_signs(size):
    """Return the random sign vectors (size, PROBES), the same at every call."""
    return np.random.default_rng(0).choice((-1.0, 1.0), (size, PROBES))


def scaled_factors(bands, factors_class):
    """Return the factors of a scaled matrix, and the scales of its rows and columns.

    As in `eomcheck.numbers.linear.solve`: first rows, then columns, by powers of two.
    """
    columns, inside = band_columns(bands.shape[-2])
    row_scale = column_scale(bands.swapaxes(-1, -2))
    bands = np.where(inside, bands * row_scale[..., None], 0.0)
    scale = column_scale(lapack_storage(bands))
    return factors_class(bands * scale[..., columns]), row_scale, scale


def lapack_storage(bands):
    """Return bands (..., m, 7) in LAPACK's storage (..., 10, m), zeros outside of the matrix.

    Entry (i, j) is stored at row 6 + i - j of column j; the first three rows are for fill-in.
    """
    size = bands.shape[-2]
    entries, positions = _storage_positions(size)
    out = np.zeros((*bands.shape[:-2], (WIDTH + HALF) * size))
    out[..., positions] = bands.reshape(*bands.shape[:-2], -1)[..., entries]
    return out.reshape(*bands.shape[:-2], WIDTH + HALF, size)


@lru_cache(64)
def _storage_positions(size):
    """Return the indices of the entries of the matrix in bands and in LAPACK's storage."""
    columns, inside = band_columns(size)
    entries = np.flatnonzero(inside)
    rows = DIAGONAL + HALF - entries % WIDTH
    return entries, rows * size + columns.ravel()[entries]


class BandFactors:
    """Factors of a banded matrix, by LAPACK.

    All but the three calls of LAPACK is written for a matrix or, in a subclass, a batch of them on
    the leading axis: "..." in shapes.

    Args:
        bands: its rows (..., m, 7), zero outside of the matrix.

    Attributes:
        lu: LAPACK's factors.
        diagonal: the diagonal of U (..., m).
        pivots: the row (..., m) that each row was exchanged with.
    """

    lu: np.ndarray
    diagonal: np.ndarray
    pivots: np.ndarray

    def __init__(self, bands):
        self.bands, (self.columns, _) = bands, band_columns(bands.shape[-2])
        self.factor(lapack_storage(bands))
        finite = np.isfinite(self.lu).all(axis=(-2, -1))
        self.invertible = np.asarray(finite & self.diagonal.all(axis=-1))

    def factor(self, stored):
        """Set the factors of a matrix in LAPACK's storage (..., 10, m)."""
        self.lu, self.pivots, _ = lapack("gbtrf")(stored, HALF, HALF)
        self.diagonal = self.lu[DIAGONAL]

    def substitute(self, b):
        """Return the unrefined solutions for b (..., m) or (..., m, k)."""
        return lapack("gbtrs")(self.lu, HALF, HALF, b, self.pivots)[0]

    def condition(self):
        """Return LAPACK's estimate (...,) of the reciprocal condition number if the norm is 1."""
        return lapack("gbcon")(HALF, HALF, self.lu, self.pivots, 1.0, norm="I")[0]

    def solve(self, b):
        """Return x (..., m), its backward errors (...,), and numbers of refinement steps (...,).

        Refinement has converged if the error is at most `REFINED`; NaN stands for an overflow, or
        for a singular matrix.
        """
        x, steps = self.substitute(b), np.zeros(self.invertible.shape, int)
        error, before = self._backward_error(x, b), np.full(self.invertible.shape, np.inf)
        while True:
            unrefined = (error > REFINED) & (error < STALLED * before)
            more = (steps < LEAST_STEPS) | ((steps < MOST_STEPS) & unrefined)
            more = more & self.invertible
            if not more.any():
                break
            refined = x + self.substitute(b - self.times(x))
            x, steps = np.where(more[..., None], refined, x), steps + more
            before = np.where(more, error, before)
            error = np.where(more, self._backward_error(x, b), error)
        solved = self.invertible
        return np.where(solved[..., None], x, np.nan), np.where(solved, error, np.nan), steps

    def _backward_error(self, x, b):
        """Return the largest |b - A x|_i / (|A||x| + |b|)_i."""
        return (np.abs(b - self.times(x)) / self._sizes(x, b)).max(axis=-1)

    def _sizes(self, x, b):
        """Return |A||x| + |b| (..., m), no entry below the rounding error of the other rows."""
        sizes = self.size(np.abs(x)) + np.abs(b)
        least = np.maximum(SMALLEST_SIZE, SMALLEST_SHARE * sizes.max(axis=-1, keepdims=True))
        return np.maximum(sizes, least)

    def perturbed(self, x, b, noise):
        """Return solutions x (..., m) with the effect of a random backward error added.

        A refined x has no larger backward error than that of its residual, whatever the factors.
        """
        residual = b - self.times(x) + noise.changes(b.shape) * self._sizes(x, b)
        return x + self.substitute(residual)

    def times(self, x):
        """Return A x."""
        return (self.bands * x[..., self.columns]).sum(axis=-1)

    def size(self, x):
        """Return |A| x."""
        return (np.abs(self.bands) * x[..., self.columns]).sum(axis=-1)

    def reciprocal_condition(self):
        """Return 1 / ρ(|A⁻¹||A|) (...,) by LAPACK's condition estimator; 0 where A is singular.

        As `eomcheck.numbers.linear.reciprocal_condition`, with |A| for |L||U|: refinement leaves
        no larger backward error (Skeel 1980). With units w of the unknowns, and rows in units of
        |A| w, the matrix has the norm 1, and its inverse the largest row sum of |A⁻¹||A| w / w. The
        best w are iterated as there, with |A⁻¹| estimated by random signs: the cost is O(m).
        """
        weights, rcond = np.ones(self.bands.shape[:-1]), np.zeros(self.invertible.shape)
        signs, unsettled = random_signs(weights.shape[-1]), self.invertible
        for _ in range(ROUNDS):
            unsettled = unsettled & np.isfinite(weights).all(axis=-1)
            if not unsettled.any():
                break
            rows, before = self.size(weights), rcond
            scaled = self.bands * weights[..., self.columns] / rows[..., None]
            condition = type(self)(scaled).condition()
            rcond = np.where(unsettled, np.fmax(rcond, condition), rcond)
            unsettled = unsettled & ~(rcond < before / 0.9)
            if not unsettled.any():
                break
            weights = np.abs(self.substitute(rows[..., None] * signs)).max(axis=-1)
            weights = np.maximum(weights / weights.max(axis=-1, keepdims=True), NORMAL)
        return np.minimum(rcond, 1.0)


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
