"""Perturbed linear solves in machine code: matrix, right-hand sides and solution are perturbed.

A sensitivity takes a solve for each of several perturbed samples of one matrix. All are computed in
one call: scaled, eliminated and substituted as `eomcheck.numbers.linear` does for the unperturbed
matrix, and with the pivots that were chosen there. The code serves matrices of any size, known at
run time: rows are processed by whole SIMD vectors, for which each row is padded.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from eomcheck.kernels.linear_solves import EXPONENT, ONE, emit_power_of_two_scale
from eomcheck.kernels.llvm import LANES, IRBuilder
from eomcheck.numbers.batch_arrays import NoiseBatch
from eomcheck.numbers.linear import SOLVERS, SolveRecord, active_noise, record, reference_solve
from eomcheck.numbers.noise import NORMAL, Noise

# ---- Rows of factors and right-hand sides --------------------------------------------------------


class Rows:
    """Rows of float64 in memory, `stride` apart, each padded by a SIMD vector."""

    def __init__(self, code: IRBuilder, pointer: str, stride: str, columns: str):
        self.code, self.pointer, self.stride, self.columns = code, pointer, stride, columns

    def address(self, i: str, j: int | str = 0) -> str:
        """Return the address of entry (i, j)."""
        row = self.code.integer("mul", i, self.stride)
        return self.code.address(self.pointer, row if j == 0 else self.code.integer("add", row, j))

    def subtract(self, i: str, factor: str, j: str) -> None:
        """Subtract `factor` times row j from row i."""
        subtract(self.code, self.columns, self.address(i), factor, self.address(j))


def subtract(code: IRBuilder, count: str, to: str, factor: str, row: str) -> None:
    """Subtract `factor` times `count` float64 at `row` from those at `to`."""
    code.do(f"call void @subtract(i64 {count}, ptr {to}, double {factor}, ptr {row})")


def _subtract_text() -> str:
    """Return the function that subtracts `factor` times a row from another, by whole vectors."""
    code = IRBuilder()
    wide = code.wider(LANES)
    factor = wide.packed(["%factor"])
    vectors = code.integer("udiv", code.integer("add", "%count", LANES - 1), LANES)
    with each_from(code, 0, vectors) as i:
        first = code.integer("mul", i, LANES)
        to, row = code.address("%to", first), code.address("%row", first)
        wide.store(wide.sub(wide.load(to), wide.mul(factor, wide.load(row))), to)
    return code.function("define void @subtract(i64 %count, ptr %to, double %factor, ptr %row)")


@contextmanager
def each_from(code: IRBuilder, first: int | str, last: str) -> Iterator[str]:
    """Run the code written inside for i = first, ..., last - 1, if there is any."""
    count = code.integer("sub", last, first)
    with code.when(code.let(f"icmp sgt i64 {count}, 0")), code.loop(count) as turn:
        yield code.integer("add", turn.i, first)


@contextmanager
def downwards(code: IRBuilder, count: str) -> Iterator[str]:
    """Run the code written inside for i = count - 1, ..., 0; `count` is at least 1."""
    with code.loop(count) as turn:
        yield code.integer("sub", code.integer("sub", count, 1), turn.i)


FACTORED = "i64 %size, i64 %many, ptr %factors, i64 %stride, ptr %x"
"""Arguments: factors of a matrix, and right-hand sides or solutions; rows in elimination order."""


def _of_factors() -> tuple[IRBuilder, Rows, Rows]:
    code = IRBuilder()
    behind = code.integer("add", "%many", LANES)
    return (
        code,
        Rows(code, "%factors", "%stride", "%size"),
        Rows(code, "%x", behind, "%many"),
    )


def _forward_text() -> str:
    """Return the function that replaces x by L⁻¹ x."""
    code, factors, x = _of_factors()
    with each_from(code, 0, "%size") as i, each_from(code, 0, i) as j:
        x.subtract(i, code.load(factors.address(i, j)), j)
    return code.function(f"define void @forward({FACTORED})")


def _backward_text() -> str:
    """Return the function that replaces x by U⁻¹ x."""
    code, factors, x = _of_factors()
    with downwards(code, "%size") as i:
        with each_from(code, code.integer("add", i, 1), "%size") as j:
            x.subtract(i, code.load(factors.address(i, j)), j)
        diagonal = code.load(factors.address(i, i))
        with each_from(code, 0, "%many") as k:
            entry = x.address(i, k)
            code.store(code.div(code.load(entry), diagonal), entry)
    return code.function(f"define void @backward({FACTORED})")


def _sizes_text() -> str:
    """Return the function that replaces x >= 0 by |L||U| x."""
    code, factors, x = _of_factors()

    def minus_size(i: str, j: str) -> str:
        return code.neg(code.call("fabs", code.load(factors.address(i, j))))

    with each_from(code, 0, "%size") as i:
        diagonal = code.call("fabs", code.load(factors.address(i, i)))
        with each_from(code, 0, "%many") as k:
            entry = x.address(i, k)
            code.store(code.mul(code.load(entry), diagonal), entry)
        with each_from(code, code.integer("add", i, 1), "%size") as j:
            x.subtract(i, minus_size(i, j), j)
    with downwards(code, "%size") as i, each_from(code, 0, i) as j:
        x.subtract(i, minus_size(i, j), j)
    return code.function(f"define void @sizes({FACTORED})")


def texts() -> tuple[str, ...]:
    """Return the texts of the functions on rows."""
    return _subtract_text(), _forward_text(), _backward_text(), _sizes_text()


# ---- LU factorization with perturbations ---------------------------------------------------------

NEGLIGIBLE = 2.0**-600
"""Size of an entry of a scaled, perturbed matrix below which it is set to 0: perturbed zeros are
subnormal, with which CPUs calculate a hundred times more slowly."""


class _PerturbedSolveCode:
    """Writer of the function that solves one perturbed system.

    `%x` holds the right-hand sides and then the solutions, `%matrix` is read, and `%changes` are
    the perturbations of both and of all results that are rounded; `%like` holds pivots and factors
    of the unperturbed solve, and `%room` is a workspace for factors and solutions.
    """

    HEAD = (
        "i64 %size, i64 %many, i1 %moves, i1 %rounds, ptr %x, ptr %matrix, ptr %changes, "
        "ptr %like, ptr %found, ptr %room"
    )

    def __init__(self):
        code = self.code = IRBuilder()
        size, many = "%size", "%many"
        stride, behind = code.integer("add", size, LANES), code.integer("add", many, LANES)
        ends = iter(self._cut("%room", (size, stride), *(3 * [(size, behind)]), *(3 * [(size,)])))
        self.A = Rows(code, next(ends), stride, size)
        self.solution, self.change, self.other = (
            Rows(code, next(ends), behind, many) for _ in range(3)
        )
        self.scale, self.row_scale, self.order = ends
        squared = (size, size)
        ends = iter(self._cut("%changes", squared, *(3 * [(size, many)])))
        self.of_matrix, self.of_sides, self.of_rounding, self.of_solution = ends
        ends = iter(self._cut("%like", (size,), squared, (size,), (size,)))
        self.pivots, self.factors, self.its_scale, self.its_row_scale = ends

    def _cut(self, pointer: str, *shapes: tuple[str, ...]) -> Iterator[str]:
        """Yield the addresses of consecutive arrays of these shapes."""
        for first, *others in shapes:
            yield pointer
            count = first
            for other in others:
                count = self.code.integer("mul", count, other)
            pointer = self.code.address(pointer, count)

    def text(self) -> str:
        """Return the text of the function."""
        code = self.code
        self._scale()
        self._eliminate()
        self._call("backward", self.solution)
        with code.when("%moves"):
            self._round()
        self._write()
        return code.function(f"define void @solve({self.HEAD})")

    def _call(self, name: str, rows: Rows, factors: str = "", stride: str = "%size") -> None:
        factors, stride = (factors, stride) if factors else (self.A.pointer, self.A.stride)
        arguments = f"i64 %size, i64 %many, ptr {factors}, i64 {stride}, ptr {rows.pointer}"
        self.code.do(f"call void @{name}({arguments})")

    @contextmanager
    def _entries(self) -> Iterator[tuple[str, str]]:
        """Loop over the right-hand sides entry by entry."""
        with each_from(self.code, 0, "%size") as i, each_from(self.code, 0, "%many") as k:
            yield i, k

    def _entry(self, i: str, j: str, columns: str) -> str:
        """Return the index of entry (i, j) of an array without padding of its rows."""
        return self.code.integer("add", self.code.integer("mul", i, columns), j)

    def _perturbed(self, x: str, changes: str, place: str) -> str:
        """Return x, perturbed as by `Noise.perturb` if the noise is enabled."""
        code = self.code
        before, (move, after) = code.block, code.labels("move", "after")
        code.branch("%moves", move, after)
        code.enter(move)
        size = code.call("maxnum", code.call("fabs", x), code.constant(NORMAL))
        perturbed = code.add(x, code.mul(code.load(changes, place), size))
        code.jump(after)
        code.enter(after)
        return code.let(f"phi double [{x}, %{before}], [{perturbed}, %{move}]")

    def _scale(self) -> None:
        """Perturb the matrix and the right-hand sides; scale rows and columns."""
        code, zero = self.code, self.code.constant(0.0)
        with each_from(code, 0, "%size") as i:
            code.store(zero, self.scale, i)
        with each_from(code, 0, "%size") as i:
            with code.loop("%size", ("double", zero)) as turn:
                index = self._entry(i, turn.i, "%size")
                a = self._perturbed(code.load("%matrix", index), self.of_matrix, index)
                code.store(a, self.A.address(i, turn.i))
                turn.yielded[0] = code.call("maxnum", turn.carried[0], code.call("fabs", a))
            scale = emit_power_of_two_scale(code, turn.carried[0])
            code.store(scale, self.row_scale, i)
            with each_from(code, 0, "%size") as j:
                entry = self.A.address(i, j)
                a = code.mul(code.load(entry), scale)
                code.store(a, entry)
                largest = code.call("maxnum", code.load(self.scale, j), code.call("fabs", a))
                code.store(largest, self.scale, j)
            with each_from(code, 0, "%many") as k:
                index = self._entry(i, k, "%many")
                b = self._perturbed(code.load("%x", index), self.of_sides, index)
                code.store(code.mul(b, scale), self.solution.address(i, k))
        with code.loop("%size", ("i64", "0")) as turn:
            scale = emit_power_of_two_scale(code, code.load(self.scale, turn.i))
            code.store(scale, self.scale, turn.i)
            whole = turn.carried[0]
            for factor in (scale, code.load(self.row_scale, turn.i)):
                bits = code.let(f"bitcast double {factor} to i64")
                power = code.integer("sub", code.integer("lshr", bits, EXPONENT), ONE)
                whole = code.integer("add", whole, power)
            turn.yielded[0] = whole
        exponents = code.let(f"sitofp i64 {turn.carried[0]} to double")
        code.store(exponents, "%found", 1)
        with each_from(code, 0, "%size") as i, each_from(code, 0, "%size") as j:
            entry = self.A.address(i, j)
            a = code.mul(code.load(entry), code.load(self.scale, j))
            negligible = code.compare("olt", code.call("fabs", a), code.constant(NEGLIGIBLE))
            code.store(code.choose(negligible, zero, a), entry)

    def _eliminate(self) -> None:
        """Replace A by L and U, and b by L⁻¹ b; write sign and diagonal for the determinant."""
        code = self.code
        with each_from(code, 0, "%size") as i:
            code.do(f"store i64 {i}, ptr {code.address(self.order, i)}")
        with code.loop("%size", ("double", code.constant(1.0))) as turn:
            i = turn.i
            pivot = self._pivot(i)
            exchanged = code.let(f"icmp ne i64 {pivot}, {i}")
            with code.when(exchanged):
                self._exchange(i, pivot)
            diagonal = code.load(self.A.address(i, i))
            code.store(diagonal, code.address("%found", 2), i)
            sign = code.call("copysign", code.constant(1.0), diagonal)
            sign = code.choose(code.compare("one", diagonal, code.constant(0.0)), sign, diagonal)
            sign = code.mul(sign, turn.carried[0])
            turn.yielded[0] = code.choose(exchanged, code.neg(sign), sign)
            behind = code.integer("add", i, 1)
            with each_from(code, behind, "%size") as k:
                entry = self.A.address(k, i)
                factor = code.div(code.load(entry), diagonal)
                code.store(factor, entry)
                left = code.integer("sub", "%size", behind)
                rows = self.A.address(k, behind), self.A.address(i, behind)
                subtract(code, left, rows[0], factor, rows[1])
                self.solution.subtract(k, factor, i)
        code.store(turn.carried[0], "%found", 0)

    def _pivot(self, i: str) -> str:
        """Return the row exchanged with row i: the prescribed one, or that of the largest entry."""
        code = self.code
        prescribed = code.let(f"fptosi double {code.load(self.pivots, i)} to i64")
        count = code.integer("sub", "%size", i)
        with code.loop(count, ("i64", i), ("double", code.constant(-1.0))) as turn:
            row = code.integer("add", turn.i, i)
            size = code.call("fabs", code.load(self.A.address(row, i)))
            larger = code.compare("ogt", size, turn.carried[1])
            turn.yielded[0] = code.let(f"select i1 {larger}, i64 {row}, i64 {turn.carried[0]}")
            turn.yielded[1] = code.choose(larger, size, turn.carried[1])
        is_prescribed = code.let(f"icmp sge i64 {prescribed}, 0")
        return code.let(f"select i1 {is_prescribed}, i64 {prescribed}, i64 {turn.carried[0]}")

    def _exchange(self, i: str, j: str) -> None:
        code = self.code
        for rows in (self.A, self.solution):
            with each_from(code, 0, rows.columns) as k:
                self._swap("double", rows.address(i, k), rows.address(j, k))
        self._swap("i64", code.address(self.order, i), code.address(self.order, j))

    def _swap(self, kind: str, one: str, other: str) -> None:
        first, second = (self.code.let(f"load {kind}, ptr {x}") for x in (one, other))
        self.code.do(f"store {kind} {second}, ptr {one}")
        self.code.do(f"store {kind} {first}, ptr {other}")

    def _round(self) -> None:
        """Add the effect of the rounding errors of elimination to the solutions."""
        code = self.code
        with self._entries() as (i, k):
            size = code.call("fabs", code.load(self.solution.address(i, k)))
            code.store(size, self.change.address(i, k))
        self._call("sizes", self.change)
        with code.when("%rounds"):
            # An entry that is only rounding error has another value here; factors differ likewise.
            with self._entries() as (i, k):
                unit = code.div(code.load(self.scale, i), code.load(self.its_scale, i))
                size = code.call("fabs", code.load(self.solution.address(i, k)))
                code.store(code.mul(size, unit), self.other.address(i, k))
            self._call("sizes", self.other, self.factors)
            with self._entries() as (i, k):
                row = code.let(f"load i64, ptr {code.address(self.order, i)}")
                unit = code.div(code.load(self.row_scale, row), code.load(self.its_row_scale, row))
                entry = self.change.address(i, k)
                size = code.mul(code.load(self.other.address(i, k)), unit)
                code.store(code.call("maxnum", code.load(entry), size), entry)
        with self._entries() as (i, k):
            row = code.let(f"load i64, ptr {code.address(self.order, i)}")
            change = code.load(self.of_rounding, self._entry(row, k, "%many"))
            entry = self.change.address(i, k)
            code.store(code.mul(code.load(entry), change), entry)
        self._call("forward", self.change)
        self._call("backward", self.change)
        with self._entries() as (i, k):
            entry = self.solution.address(i, k)
            code.store(code.add(code.load(entry), code.load(self.change.address(i, k))), entry)

    def _write(self) -> None:
        """Write the perturbed solutions, NaN if the matrix is singular."""
        code = self.code
        sign = code.load("%found", 0)
        regular = code.compare("one", sign, code.constant(0.0))
        with self._entries() as (i, k):
            index = self._entry(i, k, "%many")
            x = code.mul(code.load(self.solution.address(i, k)), code.load(self.scale, i))
            x = self._perturbed(x, self.of_solution, index)
            code.store(code.choose(regular, x, code.constant(float("nan"))), "%x", index)


def _all_text() -> str:
    """Return the function that solves all samples of all states, sample by sample.

    `%work` holds b, A, the perturbations of each sample, and pivots and factors of the unperturbed
    solve at each state.
    """
    code = IRBuilder()
    size, many = "%size", "%many"
    squared, sides = code.integer("mul", size, size), code.integer("mul", size, many)
    changes = code.integer("add", squared, code.integer("mul", sides, 3))
    changes = code.let(f"select i1 %moves, i64 {changes}, i64 0")
    factors = code.integer("add", squared, code.integer("mul", size, 2))
    factors = code.let(f"select i1 %rounds, i64 {factors}, i64 0")
    found = code.integer("add", size, 2)
    count = code.integer("mul", "%samples", "%states")
    A = code.address("%work", code.integer("mul", count, sides))
    moving = code.address(A, code.integer("mul", count, squared))
    like = code.address(moving, code.integer("mul", "%samples", changes))
    with code.loop(count) as turn:
        sample = code.integer("udiv", turn.i, "%states")
        state = code.integer("urem", turn.i, "%states")
        own = [
            code.address(pointer, code.integer("mul", index, length))
            for pointer, index, length in (
                ("%work", turn.i, sides),
                (A, turn.i, squared),
                (moving, sample, changes),
                (like, state, code.integer("add", size, factors)),
                ("%found", turn.i, found),
            )
        ]
        pointers = ", ".join(f"ptr {pointer}" for pointer in (*own, "%room"))
        code.do(f"call void @solve(i64 {size}, i64 {many}, i1 %moves, i1 %rounds, {pointers})")
    head = (
        "i64 %size, i64 %many, i64 %samples, i64 %states, i1 %moves, i1 %rounds, ptr %work, "
        "ptr %found, ptr %room"
    )
    return code.function(f"define void @solve_all({head})")


@cache
def compiled_perturbed_solve() -> Callable[..., None]:
    """Return the C function that solves all samples of all states, see `_all_text`.

    It takes the order, the numbers of right-hand sides, samples and states, whether the noise is
    enabled, whether factors of the unperturbed solve are passed, and the addresses of `work`, of
    sign, exponent and diagonal of each matrix (for the determinant), and of the workspace.
    """
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.llvm import JitModule

    machine = JitModule([*texts(), _PerturbedSolveCode().text(), _all_text()])
    kinds = *[ctypes.c_int64] * 4, *[ctypes.c_bool] * 2, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address("solve_all"))
    function.machine = machine  # keeps the machine code alive
    return function


# ---- The solver ----------------------------------------------------------------------------------


def perturbed_solve(A: np.ndarray, b: np.ndarray, name: str) -> np.ndarray:
    """Solve A x = b with A, b and x perturbed, and a separate backward error per right-hand side.

    The backward error matters if solutions for several right-hand sides are summed and cancel.
    Nothing is refused; a singular matrix gives NaN. With a `NoiseBatch` the first axis of A
    (..., k, k) and of b (..., k) or (..., k, m) is the batch axis.

    Args:
        A: matrix.
        b: right-hand sides.
        name: name of A, as in `eomcheck.numbers.linear.solve` and `SolveRecorder.references`.

    Returns:
        x in the shape of b.
    """
    noise = active_noise()
    assert noise is not None
    batched = isinstance(noise, NoiseBatch)
    states = noise.states if batched else 1
    if A.shape[-1] == 0:
        return b
    size, count = A.shape[-1], A[..., 0, 0].size
    many = b[..., 0, :].size // count if b.ndim == A.ndim else 1
    enabled = not batched or noise.enabled
    changes, like, pivots, factors = np.empty(0), None, np.full((states, size), -1.0), ()
    if enabled:
        needed = size * (size + 3 * many)
        changes = noise.draws(needed) if batched else noise.changes((needed,))
        like = reference_solve(name)
    if like is not None and like.pivots is not None and like.size == size:
        pivots, rounding = like.pivots, like.rounding
        if rounding is not None:
            factors = rounding.sizes.lu, rounding.scale, rounding.row_scale
    of_states = np.concatenate([x.reshape(states, -1) for x in (pivots, *factors)], axis=1)
    inputs = b, A, changes, of_states
    work = np.concatenate([np.asarray(x, np.float64).ravel() for x in inputs])
    determinants = np.empty((count, size + 2))
    workspace = np.zeros(size * (size + LANES) + 3 * size * (many + LANES) + 3 * size)
    addresses = (x.ctypes.data for x in (work, determinants, workspace))
    compiled_perturbed_solve()(
        size, many, count // states, states, enabled, factors != (), *addresses
    )
    x = work[: b.size].reshape(b.shape).copy()
    if enabled:
        sign, exponent = determinants[:, 0], determinants[:, 1]
        diagonal = determinants[:, 2:]
        with np.errstate(all="ignore"):
            log = np.log2(np.abs(diagonal)).sum(axis=-1) - exponent
        if not batched:
            sign, log = float(sign[0]), float(log[0])
        record(SolveRecord(name, size, np.nan, sign, log), A)
    return x


SOLVERS[Noise] = perturbed_solve
