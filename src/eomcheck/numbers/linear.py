"""Linear algebra on every scalar type: `solve`, the one solve that formulations call, and products.

float64 matrices are scaled by powers of two, which round nothing, so that the largest entry of each
row is near 1; the scale of rows decides which pivots are taken. They are solved by LAPACK's LU with
partial pivoting: the pivot of a column is its largest remaining entry, the first of several equal
ones. Machine code (`eomcheck.kernels`) does the same. Every matrix solved is recorded by
name with its reciprocal condition number, and one that is singular to working precision is refused:
a `RefusedError` is raised. Object arrays are solved by the solver registered for their scalar type
in `SOLVERS`; fields without one (`fractions.Fraction`) are eliminated exactly.

Determinant, condition number and the rounding error of elimination are computed from the LU
factors. Null spaces, singular values and least squares are for float64, single or in a batch.

Congruence sums Σ Jᵀ D J over bodies are of Jacobians J with many structural zeros. If few columns
of them are nonzero together, every product is a scalar operation, in a fixed order. If many
are, the sums are one product of matrices: a recorded tape would otherwise have n³ operations.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from fractions import Fraction
from functools import cache, partial
from itertools import chain
from typing import Any, NamedTuple, TypeVar

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch, batch_data, batch_size, of_each
from eomcheck.numbers.generic import EPS, Array
from eomcheck.numbers.noise import NORMAL, Noise

# ---- Scales --------------------------------------------------------------------------------------

ABOVE_ONE = 1.0 + 2.0**-20
"""Factor before the exponent is taken: numbers slightly below a power of two are scaled like it.
Many numbers of models are powers of two; perturbed samples of them must not fall on different sides
of a limit, or other pivots are taken."""

LARGEST_EXPONENT = 1000
"""Largest exponent of a scale, 2^-1000 to 2^1000, so that a scale is a normal number."""

_LEAST = 1100
_SCALES = np.ldexp(
    1.0, np.clip(np.arange(_LEAST, -_LEAST, -1), -LARGEST_EXPONENT, LARGEST_EXPONENT)
)
"""Scales by exponent: entry i is the scale of numbers with the exponent `i - _LEAST`."""


def power_of_two_scale(largest: np.ndarray) -> np.ndarray:
    """Return the powers of two (k,) that bring numbers `largest` (k,) to [0.5, 1).

    Numbers that are 0 or not finite are scaled like 1.
    """
    usable = (largest > 0) & (largest < np.inf)
    if not usable.all():
        largest = np.where(usable, largest, 1.0)
    return _SCALES.take(np.frexp(largest * ABOVE_ONE)[1] + _LEAST)


def column_scale(A: np.ndarray) -> np.ndarray:
    """Return powers of two (..., k) that bring the largest entry of each column of A near 1.

    A scaling of columns does not change elimination with partial pivoting: pivots and digits are
    the same. A scaling of rows does; for it the same function is used on Aᵀ.
    """
    return power_of_two_scale(np.abs(A).max(axis=-2))


# ---- LU factors ----------------------------------------------------------------------------------


@cache
def lapack(name: str) -> Callable[..., Any]:
    """Return a function of LAPACK for float64, by SciPy: processes of engines are without it."""
    from scipy.linalg import get_lapack_funcs

    return get_lapack_funcs((name,), dtype=np.float64)[0]


class FactorMagnitudes:
    """The magnitudes |L||U| of the factors of a matrix, rows in the order of the matrix.

    About eps times this is the backward error of elimination, and of substitution for each
    right-hand side.

    Args:
        lu: factors (..., k, k).
        pivots: the row (..., k) that each row was exchanged with, as in LAPACK.
    """

    def __init__(self, lu: np.ndarray, pivots: np.ndarray):
        self.lu = lu
        upper, one = _triangle(lu.shape[-1])
        size = np.abs(lu)
        self.L, self.U = np.where(upper, one, size), np.where(upper, size, 0.0)
        if pivots.ndim == 1:
            self.row_index: Any = (..., elimination_order(pivots))
            self.rows: Any = (*self.row_index, slice(None))
        else:
            self.row_index = self.rows = np.arange(len(pivots))[:, None], elimination_order(pivots)

    def times(self, x: np.ndarray) -> np.ndarray:
        """Return |L||U| x, x (..., k) or (..., k, m); a single matrix may multiply several x."""
        out = np.empty_like(x)
        if x.ndim >= self.U.ndim:
            out[self.rows] = self.L @ (self.U @ x)
        else:
            out[self.row_index] = (self.L @ (self.U @ x[..., None]))[..., 0]
        return out


class Rounding(NamedTuple):
    """Size of the rounding error of an elimination: |L| and |U|, and the scales (..., k)."""

    sizes: FactorMagnitudes
    scale: np.ndarray
    row_scale: np.ndarray


@cache
def _triangle(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask (size, size) of the upper triangle, and the identity."""
    return ~np.tri(size, k=-1, dtype=bool), np.eye(size)


ROUNDS = 20
"""Largest number of iterations for a spectral radius; three to five are common."""


def reciprocal_condition(lu: np.ndarray, pivots: np.ndarray, sizes: FactorMagnitudes) -> float:
    """Return 1 / ρ(|A⁻¹| |L||U|) of a factored matrix, or a little less; 0 if it is singular.

    |L||U| is the backward error of elimination. The spectral radius ρ is the norm of |A⁻¹| |L||U|
    in the best of all units of the unknowns, and does not depend on those of the equations either
    (Bauer 1963; Higham 2002, Sec. 7.3): kilograms or grams make no difference.
    """
    if not (np.isfinite(lu).all() and np.diagonal(lu).all()):
        return 0.0
    size = len(lu)
    inverse = np.abs(lapack("getri")(lu, pivots, lwork=64 * size)[0])
    if not np.isfinite(inverse).all():
        return 0.0
    inverse = inverse[:, sizes.row_index[-1]]  # rows in the order of their elimination
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
    """Return (sign, log2 |det|) of the matrix before it was scaled; each (...,) for several.

    Args:
        diagonal: of its factor U (..., k).
        pivots: the row (..., k) that each row was exchanged with, as in LAPACK.
        scales: powers of two (..., k) by which rows and columns were multiplied.
    """
    exchanges = np.count_nonzero(pivots != np.arange(pivots.shape[-1]), axis=-1)
    with np.errstate(divide="ignore"):
        log = np.log2(np.abs(diagonal)).sum(-1) - sum(np.log2(s).sum(-1) for s in scales)
    return np.prod(np.sign(diagonal), axis=-1) * (-1) ** exchanges, log


def elimination_order(pivots):
    """Return the rows (..., k) in the order of their elimination, from pivots of this shape."""
    if pivots.ndim > 1:
        first, order = np.arange(len(pivots)), np.tile(np.arange(pivots.shape[1]), (len(pivots), 1))
        for i, pivot in enumerate(pivots.T):
            order[:, i], order[first, pivot] = order[first, pivot], order[:, i].copy()
        return order
    order = list(range(len(pivots)))
    for i, pivot in enumerate(pivots.tolist()):
        order[i], order[pivot] = order[pivot], order[i]
    return np.array(order)


def scale_rows(x, scale):
    """Return x (..., k) or (..., k, m), each row times its scale (..., k)."""
    return x * (scale if x.ndim == scale.ndim else scale[..., None])


# ---- Solves and products -------------------------------------------------------------------------

T = TypeVar("T")

SOLVERS: dict[type, Callable] = {}
"""Scalar type -> function (A, b, name) -> x, for scalar types with their own solver."""

PRODUCTS: dict[type, Callable] = {}
"""Scalar type -> function (A, B) -> A B, for scalar types with their own product."""

CARRIERS: set[type] = set()
"""Scalar types that wrap another one; arrays may mix their entries with unwrapped ones."""


class SolveRecord(NamedTuple):
    """Condition, determinant and factors of a matrix that was solved.

    Attributes:
        name: its name in the formulation.
        size: its order.
        rcond: its reciprocal condition number; of a batch (B,).
        sign: the sign of its determinant; of a batch (B,).
        log_determinant: log2 |det|; of a batch (B,).
        refinements: steps of refinement that the solution took.
        pivots: the row (size,) that each row was exchanged with, as in LAPACK; None for bands.
        rounding: size of the rounding error of elimination, None for bands.
    """

    name: str
    size: int
    rcond: Any
    sign: Any
    log_determinant: Any
    refinements: Any = 0
    pivots: np.ndarray | None = None
    rounding: Any = None


class SolveRecorder:
    """A recorder of the matrices that `solve` solves in float64, and the source of their noise.

    Attributes:
        noise: source of the perturbations of matrices; None for none.
        references: see `recording_solves`.
        solves: every matrix solved.
        conditions: for a batch, whether condition numbers are computed.
        refused: for a batch, whether each element of a matrix solved is refused, bool (B,).
    """

    def __init__(
        self,
        noise: Noise | None = None,
        references: Mapping[str, SolveRecord] | None = None,
        conditions: bool = True,
    ):
        self.noise, self.references, self.conditions = noise, references or {}, conditions
        self.solves: list[SolveRecord] = []
        self.refused: list[np.ndarray] = []

    def refused_states(self, count: int) -> np.ndarray:
        """Return the flags (L,) of states for which a matrix is refused, in any of the samples."""
        flags = [x.reshape(-1, count).any(axis=0) for x in self.refused]
        return np.any([np.zeros(count, bool), *flags], axis=0)

    @property
    def rcond(self) -> dict[str, float]:
        """Reciprocal condition number of each matrix solved, by name."""
        return {solve.name: solve.rcond for solve in self.solves}


_active_recorder: ContextVar[SolveRecorder | None] = ContextVar("watch", default=None)


@contextmanager
def recording_solves(
    noise: Noise | None = None,
    references: Mapping[str, SolveRecord] | None = None,
    conditions: bool = True,
) -> Iterator[SolveRecorder]:
    """Collect every `SolveRecord` made inside the block.

    Args:
        noise: source of the perturbations of matrices; None for none.
        references: name of a matrix -> record of its unperturbed solve, whose pivots the perturbed
            solve takes too. If several rows are about equally good pivots, another choice is
            another elimination, with another rounding error.
        conditions: for a batch, whether condition numbers are computed.
    """
    token = _active_recorder.set(recorder := SolveRecorder(noise, references, conditions))
    try:
        yield recorder
    finally:
        _active_recorder.reset(token)


def active_recorder() -> SolveRecorder | None:
    """Return the active recorder of `solve`, or None."""
    return _active_recorder.get()


def active_noise() -> Noise | None:
    """Return the noise by which matrices are to be perturbed, or None."""
    recorder = _active_recorder.get()
    return None if recorder is None else recorder.noise


def for_each_noise(noises: NoiseBatch, function: Callable[[int, Noise], T]) -> list[T]:
    """Return function(i, noise) for each noise of a batch, which alone perturbs the solves in it.

    Their solves are recorded as those of one batch.
    """
    outer, results, solves = _active_recorder.get(), [], []
    with noises.split() as each:
        for i, noise in enumerate(each):
            with (
                nullcontext()
                if outer is None
                else recording_solves(noise, outer.references) as recorder
            ):
                results.append(function(i, noise))
            solves.append([] if recorder is None else recorder.solves)
    for same in zip(*solves, strict=True):
        signs, logs = (np.array([getattr(x, of) for x in same]) for of in SolveRecord._fields[3:5])
        assert outer is not None
        outer.solves.append(same[0]._replace(sign=signs, log_determinant=logs))
    return results


MEANINGS = {
    "a'T": "; a'T is the transpose of the columns of the constraint Jacobian of the dependent "
    "velocities",
    "a_1": "; a_1 is made of the columns of the constraint Jacobian of the dependent velocities",
}
"""Name of a matrix -> its meaning, for the error, where the name alone is not one of a system."""


def record(found: SolveRecord, matrix: np.ndarray, terms: int | None = None) -> None:
    """Record a matrix that was factored, and refuse it if it is singular, unless it is perturbed.

    Args:
        found: its record.
        matrix: the matrix, or its bands.
        terms: largest number of terms in a sum that elimination forms, by default the order.

    Raises:
        RefusedError: it is singular to working precision.
    """
    recorder = _active_recorder.get()
    if recorder is not None:
        recorder.solves.append(found)
        if recorder.noise is not None:
            return
    allowed = singular_below(found.size if terms is None else terms)
    if not found.rcond > allowed:
        raise RefusedError(
            found.name,
            found.rcond,
            allowed,
            f"the {found.size} x {found.size} matrix {found.name} is singular to working "
            f"precision: its reciprocal condition number is {found.rcond:.2g}, allowed is above "
            f"{allowed:.2g}{MEANINGS.get(found.name, '')}",
            matrix,
        )


def singular_below(terms: int) -> float:
    """Return the reciprocal condition number at and below which a matrix is singular.

    LU with partial pivoting solves (A + E) x = b exactly with |E| <= terms * eps * |L||U|, entry by
    entry (Higham 2002, Thm. 9.3); `terms` is the number of terms in the sums that elimination
    forms, the order of a full matrix. By `reciprocal_condition` some such A + E may be singular at
    rcond <= terms * eps, and none is above it. No digit of x is determined then.
    """
    return terms * EPS


def solve(A, b, name) -> Any:
    """Solve A x = b.

    Args:
        A: (k, k) matrix.
        b: (k,) or (k, m) right-hand sides.
        name: name of A in the formulation, for error messages and records.

    Returns:
        x in the shape of b.

    Raises:
        RefusedError: A is singular (in float64: to working precision), or is not square.
    """
    if A.shape[-1] != A.shape[-2]:
        message = f"the {A.shape[-2]} x {A.shape[-1]} matrix {name} is not square"
        raise RefusedError(name, 0.0, 0.0, message)
    if isinstance(A, BatchArray) or isinstance(b, BatchArray):
        kind: type = BatchArray
    elif A.dtype != object:
        return _lapack_solve(np.asarray(A), np.asarray(b), name)
    elif A.shape[0] == 0:
        return b.copy()
    else:
        kind = scalar_type_of(A, b)
    if kind is BatchArray and (noise := active_noise()) is not None:
        return _perturbed_solve(A, b, name, noise)
    return SOLVERS.get(kind, eliminate)(A, b, name)


def matrix_product(A, B):
    """Return A B (k, m) of matrices (k, l) and (l, m), by the product of their scalar type."""
    if A.dtype != object:
        return A @ B
    return PRODUCTS.get(scalar_type_of(A, B), operator.matmul)(A, B)


def contiguous(x):
    """Return a matrix row by row in memory, so that its products round alike for any x."""
    if isinstance(x, BatchArray):
        return BatchArray(np.ascontiguousarray(x.data))
    return np.ascontiguousarray(x)


def scalar_type_of(*arrays):
    """Return the scalar type of object arrays; int if they hold only literals."""
    # Generic functions write literal zeros and ones among the numbers of the model.
    kinds = {type(x) for x in chain(*(a.flat for a in arrays)) if not isinstance(x, int)}
    return next(iter(kinds & CARRIERS or kinds), int)


def _lapack_solve(A, b, name):
    size = A.shape[-1]
    if size == 0:
        return b.copy()
    if (noise := active_noise()) is not None:
        return _perturbed_solve(A, b, name, noise)
    A, b, scale, row_scale = equilibrate(A, b)
    lu, pivots, _ = lapack("getrf")(A)
    sign, log = determinant(np.diagonal(lu), pivots, scale, row_scale)
    sizes = FactorMagnitudes(lu, pivots)
    rcond, rounding = reciprocal_condition(lu, pivots, sizes), Rounding(sizes, scale, row_scale)
    record(SolveRecord(name, size, rcond, float(sign), float(log), 0, pivots, rounding), A)
    return scale_rows(lapack("getrs")(lu, pivots, b)[0], scale)


def _perturbed_solve(A, b, name, noise) -> Any:
    """Solve by the solver of perturbed matrices, of a batch with the batch axis first."""
    if not isinstance(noise, NoiseBatch):
        return noise.as_perturbed(SOLVERS[Noise](A, b, name))
    A, b = (batch_data(x, noise.count) for x in (A, b))
    return BatchArray(SOLVERS[Noise](A, b, name), noise)


def reference_solve(name):
    """Return the record of the unperturbed solve of the matrix, or None if there is none."""
    recorder = _active_recorder.get()
    return None if recorder is None else recorder.references.get(name)


def equilibrate(A, b):
    """Return A (..., n, n), b and the scales (..., n) of columns and rows.

    The scale of rows decides which pivots are taken. Rows are scaled first: with columns scaled
    first, M_Au of links of very different masses loses all digits, but only one digit with the rows
    unscaled. The scale of columns only keeps all numbers near 1.
    """
    row_scale = column_scale(A.swapaxes(-1, -2))
    A = A * row_scale[..., None]
    scale = column_scale(A)
    return A * scale[..., None, :], scale_rows(b, row_scale), scale, row_scale


def eliminate(A, b, name):
    """Solve A x = b over any exact field by Gauss-Jordan elimination, first nonzero pivot."""
    size = A.shape[0]
    work = np.concatenate((A, b.reshape(size, -1)), axis=1)
    number = next((x for x in work.flat if not isinstance(x, int)), None)
    # A quotient of two integer literals would be a float64.
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
        # Integers can be mixed with every scalar type, fractions cannot.
        x.flat = [y.numerator if y.denominator == 1 else y for y in x.flat]
    return x


# ---- Null space, singular values, least squares --------------------------------------------------


def null_space(a: Any) -> Any:
    """Return an orthonormal basis (n, n-r) of the null space of a (r, n).

    In a batch every matrix is assumed to have the same rank; singular values show which has not.
    """
    from scipy import linalg

    if not batch_size(a):
        return linalg.null_space(a)
    return of_each(lambda x: linalg.svd(x)[2][len(x) :].T, a)


def singular_values(a: Any) -> Any:
    """Return the singular values of a, largest first."""
    return of_each(partial(np.linalg.svd, compute_uv=False), a)


def least_squares(a: Any, b: Any) -> Any:
    """Return the smallest x that minimizes |a x - b|, b (m,) or (m, k); NaN after an overflow."""
    x = of_each(_least_squares, a, b)
    if isinstance(b, BatchArray):
        x.noise = b.noise
    return x


def _least_squares(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    # With entries that are not finite LAPACK prints errors on the terminal.
    if np.isfinite(a).all() and np.isfinite(b).all():
        return np.linalg.lstsq(a, b, rcond=None)[0]
    return np.full((a.shape[1], *b.shape[1:]), np.nan)


def row_scale(a: Any) -> Any:
    """Return powers of two (r,) that bring the largest entry of each row of a (r, n) near 1."""
    return of_each(column_scale, a.T)


# ---- Congruence sums -----------------------------------------------------------------------------

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
