"""Linear solves of a batch: the matrix of each lane is solved with the bits of a single solve.

Scales, pivots, refusals and refinement are those of `eomcheck.numbers.linear` and
`eomcheck.numbers.banded_solve`, whose functions are used; LAPACK, which they call matrix by matrix
from Python, is called here in a loop in machine code (`lapack_per_lane`). A lane whose matrix is
refused has the result NaN, and is recorded as refused.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.kernels.linear_solves import address_of
from eomcheck.kernels.llvm import IRBuilder, JitModule
from eomcheck.kernels.perturbed_solves import NEGLIGIBLE
from eomcheck.numbers import linear
from eomcheck.numbers.banded_solve import (
    BANDED_SOLVERS,
    DIAGONAL,
    HALF,
    TERMS,
    BandFactors,
    scaled_factors,
)
from eomcheck.numbers.lanes import LaneArray, lane_data, lanes_in, perturbation_scale
from eomcheck.numbers.linear import (
    ROUNDS,
    SOLVERS,
    FactorMagnitudes,
    Rounding,
    SolveRecord,
    determinant,
    elimination_order,
    scale_rows,
    singular_below,
)
from eomcheck.numbers.noise import NORMAL, Noise
from eomcheck.numbers.pivots import REFINED

# ---- LAPACK in a loop ----------------------------------------------------------------------------


@cache
def _loop(arity: int) -> Callable[[int, int, int], None]:
    """Return the C function (count, function, table) that calls a function of `arity` addresses.

    It is called `count` times; the table has first value and stride, bytes, of each address.
    """
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


def lapack_per_lane(routine: str, *arguments: Any) -> None:
    """Call a routine of LAPACK for each lane.

    Args:
        routine: its name, such as "dgetrf".
        arguments: arrays with the lanes on the first axis, which the routine may write to; or, the
            same for all lanes, a number, a letter, or a list of one array as a workspace.
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


def _lanes_first(x: np.ndarray) -> np.ndarray:
    """Return data (*shape, L) as a contiguous array (L, *shape)."""
    return np.ascontiguousarray(np.moveaxis(x, -1, 0))


def _lanes_last(x: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(np.moveaxis(x, 0, -1))


def _perturbed(x: np.ndarray, noise: Noise) -> np.ndarray:
    """Return numbers (L, *shape), perturbed by the same relative change in all lanes."""
    return x + noise.changes(x.shape[1:]) * perturbation_scale(x)


def _conditions_wanted() -> bool:
    recorder = linear.active_recorder()
    return recorder is None or recorder.conditions


def _record(found: SolveRecord, refused: np.ndarray) -> None:
    recorder = linear.active_recorder()
    if recorder is not None:
        recorder.solves.append(found)
        recorder.refused.append(refused)


# ---- Full matrices -------------------------------------------------------------------------------


class LaneFactors(NamedTuple):
    """LU factors of a batch of matrices, one per lane.

    Attributes:
        columns: factors (L, k, k), column by column.
        pivots: exchanged rows (L, k), counted from 1 as in LAPACK.
    """

    columns: np.ndarray
    pivots: np.ndarray

    @property
    def lu(self) -> np.ndarray:
        """LU factors (L, k, k), row by row."""
        return self.columns.swapaxes(-1, -2)

    @classmethod
    def of(cls, A: np.ndarray, like: np.ndarray | None = None) -> LaneFactors:
        """Factor matrices (L, k, k), with the pivots `like` (L, k) if passed."""
        count, size, _ = A.shape
        columns = np.ascontiguousarray(A.swapaxes(-1, -2))
        pivots, info = np.zeros((count, size), np.int32), [np.zeros(1, np.int32)]
        lapack_per_lane("dgetrf", size, size, columns, size, pivots, info)
        if like is not None:
            other = np.flatnonzero((pivots != like).any(axis=1))
            if other.size:
                columns[other] = _eliminated(A[other], like[other] - 1).swapaxes(-1, -2)
                pivots[other] = like[other]
        return cls(columns, pivots)

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Return the solutions for right-hand sides b (L, k) or (L, k, m)."""
        size, many = self.pivots.shape[1], 1 if b.ndim == 2 else b.shape[2]
        x = b.copy() if b.ndim == 2 else np.ascontiguousarray(b.swapaxes(-1, -2))
        info = [np.zeros(1, np.int32)]
        lapack_per_lane("dgetrs", "N", size, many, self.columns, size, self.pivots, x, size, info)
        return x if b.ndim == 2 else x.swapaxes(-1, -2)

    def inverse(self) -> np.ndarray:
        """Return the inverses (L, k, k) of the matrices."""
        size, out = self.pivots.shape[1], self.columns.copy()
        work = [np.zeros(64 * size)]
        info = [np.zeros(1, np.int32)]
        lapack_per_lane("dgetri", size, out, size, self.pivots, work, 64 * size, info)
        return out.swapaxes(-1, -2)


def _eliminated(A: np.ndarray, pivots: np.ndarray) -> np.ndarray:
    """Return the LU factors of A (L, k, k), in the form of `getrf`, with these pivots."""
    lu = np.take_along_axis(A, elimination_order(pivots)[..., None], axis=1)
    for i in range(A.shape[-1] - 1):
        lu[:, i + 1 :, i] /= lu[:, i, i, None]
        lu[:, i + 1 :, i + 1 :] -= lu[:, i + 1 :, i, None] * lu[:, i, None, i + 1 :]
    return lu


def solve_in_lanes(A: Any, b: Any, name: str) -> LaneArray:
    """Solve A x = b in each lane; see `eomcheck.numbers.linear.solve`."""
    count = lanes_in(A) or lanes_in(b)
    A, b = (_lanes_first(lane_data(x, count)) for x in (A, b))
    if A.shape[-1] == 0:
        return LaneArray(_lanes_last(b))
    noise, like = linear.active_noise(), linear.reference_solve(name)
    with np.errstate(all="ignore"):
        if noise is not None:
            A, b = _perturbed(A, noise), _perturbed(b, noise)
        A, b, scale, row_scale = linear.equilibrate(A, b)
        if noise is not None:
            A[np.abs(A) < NEGLIGIBLE] = 0.0
        factors = LaneFactors.of(A, None if noise is None or like is None else like.pivots)
        diagonal = np.diagonal(factors.columns, axis1=-2, axis2=-1)
        sizes = FactorMagnitudes(factors.lu, factors.pivots - 1)
        det = determinant(diagonal, factors.pivots - 1, scale, row_scale)
        rounding = Rounding(sizes, scale, row_scale)
        x = factors.solve(b)
        if noise is None:
            rcond = np.ones(count)
            if _conditions_wanted():
                rcond = _reciprocal_conditions(factors, sizes)
            refused = ~(rcond > singular_below(A.shape[-1]))
            x[refused] = np.nan
            _record(
                SolveRecord(name, A.shape[-1], rcond, *det, 0, factors.pivots, rounding), refused
            )
            return LaneArray(_lanes_last(scale_rows(x, scale)))
        rounded = sizes.times(np.abs(x))
        if like is not None and like.rounding is not None:
            rounded = np.maximum(rounded, like.rounding.of(np.abs(x), scale, row_scale))
        x = x + factors.solve(noise.changes(b.shape[1:]) * rounded)
        x[~diagonal.all(axis=-1)] = np.nan
        _record(SolveRecord(name, A.shape[-1], np.nan, *det), np.zeros(count, bool))
        return LaneArray(_lanes_last(_perturbed(scale_rows(x, scale), noise)), noise)


def _reciprocal_conditions(factors: LaneFactors, sizes: FactorMagnitudes) -> np.ndarray:
    """Return `eomcheck.numbers.linear.reciprocal_condition` of each lane (L,)."""
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
    """Factors of a batch of banded matrices, one per lane, with all arrays column by column."""

    def factor(self, stored: np.ndarray) -> None:
        """Set the factors of matrices in LAPACK's storage (L, 10, m)."""
        self.lu, info = np.ascontiguousarray(stored.swapaxes(-1, -2)), [np.zeros(1, np.int32)]
        count, size, width = self.lu.shape
        pivots = np.zeros((count, size), np.int32)
        lapack_per_lane("dgbtrf", size, size, HALF, HALF, self.lu, width, pivots, info)
        self.diagonal, self.pivots = self.lu[:, :, DIAGONAL], pivots - 1

    def substitute(self, b: np.ndarray) -> np.ndarray:
        """Return the unrefined solutions for b (L, m) or (L, m, k)."""
        columns = np.array(b if b.ndim == 2 else b.swapaxes(-1, -2), order="C")
        many, size, info = b[0].size // b.shape[1], b.shape[1], [np.zeros(1, np.int32)]
        inputs = "N", size, HALF, HALF, many, self.lu, self.lu.shape[2], self.pivots + 1
        lapack_per_lane("dgbtrs", *inputs, columns, size, info)
        return columns if b.ndim == 2 else columns.swapaxes(-1, -2)

    def condition(self) -> np.ndarray:
        """Return LAPACK's estimates (L,) of reciprocal condition numbers of matrices of norm 1."""
        count, size = self.pivots.shape
        rcond, info = np.zeros((count, 1)), [np.zeros(1, np.int32)]
        work, whole = [np.zeros(3 * size)], [np.zeros(size, np.int32)]
        inputs = "I", size, HALF, HALF, self.lu, self.lu.shape[2], self.pivots + 1, 1.0, rcond
        lapack_per_lane("dgbcon", *inputs, work, whole, info)
        return rcond[:, 0]


def solve_banded_in_lanes(bands: Any, b: Any, name: str) -> LaneArray:
    """Solve A x = b in each lane; see `eomcheck.numbers.banded_solve.solve_banded`."""
    count = lanes_in(bands) or lanes_in(b)
    bands, b = (_lanes_first(lane_data(x, count)) for x in (bands, b))
    size, noise = b.shape[1], linear.active_noise()
    with np.errstate(all="ignore"):
        if noise is not None:
            bands, b = _perturbed(bands, noise), _perturbed(b, noise)
        A, row_scale, scale = scaled_factors(bands, BatchedBandFactors)
        det = determinant(A.diagonal, A.pivots, scale, row_scale)
        x, error, steps = A.solve(b * row_scale)
        if noise is None:
            rcond = A.reciprocal_condition() if _conditions_wanted() else np.ones(count)
            refused = ~(rcond > singular_below(TERMS)) | ((error > REFINED) & (error < np.inf))
            _record(SolveRecord(name, size, rcond, *det, steps), refused)
            x[refused] = np.nan
            return LaneArray(_lanes_last(x * scale))
        perturbed = A.perturbed(x, b * row_scale, noise) * scale
        perturbed[~(error <= REFINED)] = np.nan
        _record(SolveRecord(name, size, np.nan, *det, steps), np.zeros(count, bool))
        return LaneArray(_lanes_last(_perturbed(perturbed, noise)), noise)


SOLVERS[LaneArray], BANDED_SOLVERS[LaneArray] = solve_in_lanes, solve_banded_in_lanes
