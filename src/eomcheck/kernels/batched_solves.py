"""Linear solves of a batch: the matrix of each element is solved with the bits of a single solve.

Scales, pivots, refusals and refinement are those of `eomcheck.numbers.linear` and
`eomcheck.numbers.banded_solve`, whose functions are used; LAPACK, which they call matrix by matrix
from Python, is called here in a loop in machine code (`lapack_of_each`). An element whose matrix is
refused has the result NaN, and is recorded as refused. Perturbed matrices that are full are solved
by `perturbed_solves`.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.kernels.linear_solves import address_of
from eomcheck.kernels.llvm import IRBuilder
from eomcheck.numbers import linear
from eomcheck.numbers.banded_solve import (
    BANDED_SOLVERS,
    DIAGONAL,
    HALF,
    REFINED,
    TERMS,
    BandFactors,
    scaled_factors,
)
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch, batch_data, batch_size
from eomcheck.numbers.linear import (
    ROUNDS,
    SOLVERS,
    FactorMagnitudes,
    Rounding,
    SolveRecord,
    determinant,
    scale_rows,
    singular_below,
)
from eomcheck.numbers.noise import NORMAL

# ---- LAPACK in a loop ----------------------------------------------------------------------------


@cache
def _loop(arity: int) -> Callable[[int, int, int], None]:
    """Return the C function (count, function, table) that calls a function of `arity` addresses.

    It is called `count` times; the table has first value and stride, bytes, of each address.
    """
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.llvm import JitModule

    code = IRBuilder()
    table = [
        (
            code.let(f"load i64, ptr {code.address('%table', 2 * i, 'i64')}"),
            code.let(f"load i64, ptr {code.address('%table', 2 * i + 1, 'i64')}"),
        )
        for i in range(arity)
    ]
    with code.loop("%count") as turn:
        pointers = []
        for start, stride in table:
            address = code.integer("add", start, code.integer("mul", turn.i, stride))
            pointers.append(code.let(f"inttoptr i64 {address} to ptr"))
        code.do(f"call void %function({', '.join(f'ptr {pointer}' for pointer in pointers)})")
    name = f"each{arity}"
    machine = JitModule(
        [code.function(f"define void @{name}(i64 %count, ptr %function, ptr %table)")]
    )
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address(name))
    function.machine = machine  # keeps the machine code alive
    return function


def lapack_of_each(routine: str, *arguments: Any) -> None:
    """Call a routine of LAPACK for each element of a batch.

    Args:
        routine: its name, such as "dgetrf".
        arguments: arrays with the batch on the first axis, which the routine may write to; or, the
            same for all elements, a number, a letter, or a list of one array as a workspace.
    """
    count, table, alive = 0, [], []
    for x in arguments:
        if isinstance(x, np.ndarray):
            count = len(x)
            table += [x.ctypes.data, x.strides[0]]
            continue
        if isinstance(x, list):
            same = x[0]
        elif isinstance(x, str):
            same = np.array([ord(x)], np.int8)
        else:
            same = np.array([x], np.int32 if isinstance(x, int) else np.float64)
        alive.append(same)
        table += [same.ctypes.data, 0]
    addresses = np.array(table, np.int64)
    if count:
        _loop(len(arguments))(count, address_of("lapack", routine), addresses.ctypes.data)


# ---- Solvers -------------------------------------------------------------------------------------


def _conditions_wanted() -> bool:
    recorder = linear.active_recorder()
    return recorder is None or recorder.conditions


def _record(solve_record: SolveRecord, refused: np.ndarray | None = None) -> None:
    recorder = linear.active_recorder()
    if recorder is not None:
        recorder.solves.append(solve_record)
        if refused is not None:
            recorder.refused.append(refused)


# ---- Full matrices -------------------------------------------------------------------------------


class BatchFactors(NamedTuple):
    """LU factors of a batch of matrices.

    Attributes:
        columns: factors (B, k, k), column by column.
        pivots: exchanged rows (B, k), counted from 1 as in LAPACK.
    """

    columns: np.ndarray
    pivots: np.ndarray

    @property
    def lu(self) -> np.ndarray:
        """LU factors (B, k, k), row by row."""
        return self.columns.swapaxes(-1, -2)

    @classmethod
    def of(cls, A: np.ndarray) -> BatchFactors:
        """Factor matrices (B, k, k)."""
        count, size, _ = A.shape
        columns = np.ascontiguousarray(A.swapaxes(-1, -2))
        pivots, info = np.zeros((count, size), np.int32), [np.zeros(1, np.int32)]
        lapack_of_each("dgetrf", size, size, columns, size, pivots, info)
        return cls(columns, pivots)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return the solutions for right-hand sides b (B, k) or (B, k, m)."""
        size, many = self.pivots.shape[1], 1 if b.ndim == 2 else b.shape[2]
        x = b.copy() if b.ndim == 2 else np.ascontiguousarray(b.swapaxes(-1, -2))
        info = [np.zeros(1, np.int32)]
        lapack_of_each("dgetrs", "N", size, many, self.columns, size, self.pivots, x, size, info)
        return x if b.ndim == 2 else x.swapaxes(-1, -2)

    def inverse(self) -> np.ndarray:
        """Return the inverses (B, k, k) of the matrices."""
        size, out = self.pivots.shape[1], self.columns.copy()
        work = [np.zeros(64 * size)]
        info = [np.zeros(1, np.int32)]
        lapack_of_each("dgetri", size, out, size, self.pivots, work, 64 * size, info)
        return out.swapaxes(-1, -2)


def solve_batch(A: Any, b: Any, name: str) -> BatchArray:
    """Solve A x = b of each element; see `eomcheck.numbers.linear.solve`."""
    count = batch_size((A, b))
    A, b = (batch_data(x, count) for x in (A, b))
    if A.shape[-1] == 0:
        return BatchArray(b)
    with np.errstate(all="ignore"):
        A, b, scale, row_scale = linear.equilibrate(A, b)
        factors = BatchFactors.of(A)
        diagonal, pivots = np.diagonal(factors.columns, axis1=-2, axis2=-1), factors.pivots - 1
        sizes = FactorMagnitudes(factors.lu, pivots)
        det = determinant(diagonal, pivots, scale, row_scale)
        rounding = Rounding(sizes, scale, row_scale)
        x = factors.solve(b)
        rcond = np.ones(count)
        if _conditions_wanted():
            rcond = _reciprocal_conditions(factors, sizes)
        refused = ~(rcond > singular_below(A.shape[-1]))
        x[refused] = np.nan
        _record(SolveRecord(name, A.shape[-1], rcond, *det, 0, pivots, rounding), refused)
        return BatchArray(scale_rows(x, scale))


def _reciprocal_conditions(factors: BatchFactors, sizes: FactorMagnitudes) -> np.ndarray:
    """Return `eomcheck.numbers.linear.reciprocal_condition` of each lane (B,)."""
    count, size = factors.pivots.shape
    diagonal = np.diagonal(factors.columns, axis1=-2, axis2=-1)
    usable = np.isfinite(factors.columns).all(axis=(1, 2)) & diagonal.all(axis=1)
    inverse = np.abs(factors.inverse())
    usable &= np.isfinite(inverse).all(axis=(1, 2))
    weights, radius, open_ = np.ones((count, size)), np.full(count, np.inf), usable.copy()
    for _ in range(ROUNDS):
        product = (inverse @ sizes.times(weights)[..., None])[..., 0]
        before = radius
        radius = np.where(open_, np.fmin(radius, (product / weights).max(axis=1)), radius)
        open_ &= ~(radius > 0.9 * before)
        if not open_.any():
            break
        product = np.maximum(product / product.max(axis=1, keepdims=True), NORMAL)
        weights = np.where(open_[:, None], product, weights)
    return np.where(usable, np.minimum(1.0 / radius, 1.0), 0.0)


# ---- Bands ---------------------------------------------------------------------------------------


class BatchedBandFactors(BandFactors):
    """Factors of a batch of banded matrices, with all arrays column by column."""

    def factor(self, stored: np.ndarray) -> None:
        """Set the factors of matrices in LAPACK's storage (B, 10, m)."""
        self.lu, info = np.ascontiguousarray(stored.swapaxes(-1, -2)), [np.zeros(1, np.int32)]
        count, size, width = self.lu.shape
        pivots = np.zeros((count, size), np.int32)
        lapack_of_each("dgbtrf", size, size, HALF, HALF, self.lu, width, pivots, info)
        self.diagonal, self.pivots = self.lu[:, :, DIAGONAL], pivots - 1

    def substitute(self, b: np.ndarray) -> np.ndarray:
        """Return the unrefined solutions for b (B, m) or (B, m, k)."""
        columns = np.array(b if b.ndim == 2 else b.swapaxes(-1, -2), order="C")
        many, size, info = b[0].size // b.shape[1], b.shape[1], [np.zeros(1, np.int32)]
        inputs = "N", size, HALF, HALF, many, self.lu, self.lu.shape[2], self.pivots + 1
        lapack_of_each("dgbtrs", *inputs, columns, size, info)
        return columns if b.ndim == 2 else columns.swapaxes(-1, -2)

    def condition(self) -> np.ndarray:
        """Return LAPACK's estimates (B,) of reciprocal condition numbers of matrices of norm 1."""
        count, size = self.pivots.shape
        rcond, info = np.zeros((count, 1)), [np.zeros(1, np.int32)]
        work, whole = [np.zeros(3 * size)], [np.zeros(size, np.int32)]
        inputs = "I", size, HALF, HALF, self.lu, self.lu.shape[2], self.pivots + 1, 1.0, rcond
        lapack_of_each("dgbcon", *inputs, work, whole, info)
        return rcond[:, 0]


def solve_banded_batch(bands: Any, b: Any, name: str) -> BatchArray:
    """Solve A x = b of each element; see `eomcheck.numbers.banded_solve.solve_banded`."""
    count = batch_size((bands, b))
    bands, b = (batch_data(x, count) for x in (bands, b))
    size, noise = b.shape[1], linear.active_noise()
    assert noise is None or isinstance(noise, NoiseBatch)
    with np.errstate(all="ignore"):
        if noise is not None:
            bands, b = (noise.perturbed(x, np.abs(x)) for x in (bands, b))
        A, row_scale, scale = scaled_factors(bands, BatchedBandFactors)
        det = determinant(A.diagonal, A.pivots, scale, row_scale)
        x, error, steps = A.solve(b * row_scale)
        if noise is None:
            rcond = A.reciprocal_condition() if _conditions_wanted() else np.ones(count)
            refused = ~(rcond > singular_below(TERMS)) | ((error > REFINED) & (error < np.inf))
            _record(SolveRecord(name, size, rcond, *det, steps), refused)
            x[refused] = np.nan
            return BatchArray(x * scale)
        perturbed = A.perturbed(x, b * row_scale, noise) * scale
        perturbed[~(error <= REFINED)] = np.nan
        _record(SolveRecord(name, size, np.nan, *det, steps))
        return BatchArray(noise.perturbed(perturbed, np.abs(perturbed)), noise)


SOLVERS[BatchArray] = solve_batch
BANDED_SOLVERS[BatchArray] = solve_banded_batch
