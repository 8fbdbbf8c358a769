"""Band solves in machine code: `eomcheck.numbers.banded_solve`, eight rows per SIMD vector.

The matrix is stored diagonal by diagonal, so that consecutive rows are the lanes of a SIMD vector:
they are scaled, and their residuals computed, eight at a time. Scales, pivots and refinement follow
`eomcheck.numbers.pivots`; a matrix that these refuse gives NaN.

Columns are eliminated one after the other. Four rows have an entry in a column: they are stored
column by column, four numbers to a vector; a pivot row is not moved, and the next row takes over
its lane. Below the matrix are rows of zeros, so that the last columns need no code of their own.

LAPACK (`dgbtrf`, `dgbtrs`) takes eight times as long for the chain of 100 links: its blocks are far
wider than this band.
"""

from __future__ import annotations

from eomcheck.kernels import llvm
from eomcheck.kernels.dense import emit_power_of_two_scale
from eomcheck.kernels.llvm import LANES, IRBuilder
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
)

HALF, WIDTH = 3, 7
"""Number of entries on each side of the diagonal, and in a row."""

OPEN = HALF + 1
"""Number of rows that have an entry in a column while it is eliminated."""

AFTER = WIDTH - 1
"""Number of entries of a row of U after its pivot."""


def padded(size: int) -> int:
    """Return the length in memory of a diagonal, with rows of zeros below: whole vectors."""
    return -(-(size + HALF) // LANES) * LANES


def multiply_add(code: IRBuilder, x: str, y: str, z: str) -> str:
    """Return x + y z, by fused multiply-add on machines that have it."""
    if llvm.cpu_features()[2]:
        return code.call("fma", y, z, x)
    return code.add(x, code.mul(y, z))


def multiply_subtract(code: IRBuilder, x: str, y: str, z: str) -> str:
    """Return x - y z, by fused multiply-add on machines that have it."""
    return multiply_add(code, x, code.neg(y), z)


def solve_workspace(size: int) -> int:
    """Return the number of float64 of the workspace of a solve."""
    return 11 * padded(size) + 2 * LANES + size * (AFTER + 2 * OPEN + 1)


def band_text(name: str, size: int, stride: int) -> str:
    """Return the function (diagonals, x, room) for a matrix of `size` rows.

    Entries of the diagonals (8, padded size), of which the last is the right-hand side, and those
    of x are `stride` float64 apart. With `stride` 1 the diagonals are scaled in place, otherwise in
    the workspace `room`.
    """
    code = IRBuilder()
    solve = _BandSolveCode(code, size, stride)
    solve.scale()
    solve.eliminate()
    clear = solve.refine()
    with code.loop(size) as turn:
        index = turn.i if stride == 1 else code.integer("mul", turn.i, stride)
        code.store(code.add(code.load(solve.x, turn.i), clear), "%x", index)
    head = "ptr noalias %rows, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({head}) nounwind")


class _BandSolveCode:
    """Writer of the steps of a solve, with the addresses of its numbers.

    Attributes:
        x: address of x, with zeros before and after it, so that any row can be multiplied by it.
        residual: address of the right-hand side that is eliminated next; elimination writes its
            results there.
        sizes: address of |A||x| + |b|.
        upper: address of the rows of U (size, 6), each divided by its pivot, without the pivot.
        factors: address of the factors of elimination (size, 4), one for each lane.
        inverses: address of the inverses of the pivots (size,).
        lanes: address of the lanes of the pivots (size, 4), integers, each four times.
    """

    def __init__(self, code: IRBuilder, size: int, stride: int):
        self.code, self.size, self.stride, self.length = code, size, stride, padded(size)
        self.rows, self.open = code.wider(LANES), code.wider(OPEN)
        used = 0

        def reserve(count: int) -> str:
            nonlocal used
            used += count
            return code.address("%room", used - count)

        self.unscaled = [code.address("%rows", j * self.length * stride) for j in range(WIDTH + 1)]
        scaled = self.unscaled if stride == 1 else [reserve(self.length) for _ in self.unscaled]
        *self.diagonals, self.right = scaled
        self.residual, self.sizes = reserve(self.length), reserve(self.length)
        self.x = code.address(reserve(self.length + 2 * LANES), LANES)
        self.factors, self.upper = reserve(size * OPEN), reserve(size * AFTER)
        self.inverses, self.lanes = reserve(size), reserve(size * OPEN)
        for i in (-LANES, self.length):
            self.rows.store("zeroinitializer", code.address(self.x, i))

    def scale(self) -> None:
        """Scale all rows, in the workspace if they are not contiguous, and set x to 0."""
        code, rows = self.code, self.rows
        with code.loop(self.length // LANES) as turn:
            at = code.integer("mul", turn.i, LANES)
            rows.store("zeroinitializer", code.address(self.x, at))
            entries = []
            for numbers in self.unscaled:
                if self.stride == 1:
                    entries.append(rows.load(code.address(numbers, at)))
                    continue
                indices = [code.integer("add", at, lane) for lane in range(LANES)]
                indices = [code.integer("mul", index, self.stride) for index in indices]
                entries.append(rows.packed([code.load(numbers, index) for index in indices]))
            largest = rows.call("fabs", entries[0])
            for entry in entries[1:WIDTH]:
                largest = _larger(rows, rows.call("fabs", entry), largest)
            scale = emit_power_of_two_scale(rows, largest)
            for entry, to in zip(entries, [*self.diagonals, self.right], strict=True):
                rows.store(rows.mul(entry, scale), code.address(to, at))

    # ---- Elimination -----------------------------------------------------------------------------

    def eliminate(self) -> None:
        """Write the factors and the eliminated right-hand side."""
        code, wide = self.code, self.open
        state = [(wide.real, self._first_rows(column)) for column in range(AFTER)]
        state.append((wide.real, self._first_entries(self.right)))
        state.append((wide.like("i64"), wide.splat_of(f"i64 {HALF}")))
        with code.loop(self.size, *state) as turn:
            *columns, right, free = turn.carried
            new = code.integer("add", turn.i, HALF)
            window = zip(
                (*columns, wide.constant(0.0), right), (*self.diagonals, self.right), strict=True
            )
            first, *others = (self._with_row(x, free, numbers, new) for x, numbers in window)
            pivot = self._pivot_lane(first)
            # The inverses of all four, as long as the pivot is not known.
            inverses = wide.div(wide.constant(1.0), first)
            inverse = self._picked(wide.call("arithmetic.fence", inverses), pivot)
            factors = wide.mul(first, inverse)
            below = []
            for j, x in enumerate(others):
                row = self._picked(x, pivot)
                below.append(multiply_subtract(wide, x, factors, row))
                entry = code.mul(wide.lane(row, 0), wide.lane(inverse, 0))
                if j < AFTER:
                    index = code.integer("add", code.integer("mul", turn.i, AFTER), j)
                    code.store(entry, self.upper, index)
                else:
                    code.store(entry, self.residual, turn.i)
            code.store(wide.lane(inverse, 0), self.inverses, turn.i)
            wide.store(factors, code.address(self.factors, code.integer("mul", turn.i, OPEN)))
            lanes = code.address(self.lanes, code.integer("mul", turn.i, OPEN))
            code.do(f"store {wide.like('i64')} {pivot}, ptr {lanes}, align 8")
            turn.yielded = [*below, pivot]

    def _forward(self) -> None:
        """Eliminate another right-hand side, the residual."""
        code, wide = self.code, self.open
        state = [(wide.real, self._first_entries(self.residual))]
        state.append((wide.like("i64"), wide.splat_of(f"i64 {HALF}")))
        with code.loop(self.size, *state) as turn:
            x, free = turn.carried
            x = self._with_row(x, free, self.residual, code.integer("add", turn.i, HALF))
            lanes = code.address(self.lanes, code.integer("mul", turn.i, OPEN))
            pivot = wide.let(f"load {wide.like('i64')}, ptr {lanes}, align 8")
            row = self._picked(x, pivot)
            factors = wide.load(code.address(self.factors, code.integer("mul", turn.i, OPEN)))
            entry = code.mul(wide.lane(row, 0), code.load(self.inverses, turn.i))
            code.store(entry, self.residual, turn.i)
            turn.yielded = [multiply_subtract(wide, x, factors, row), pivot]

    def _first_rows(self, column: int) -> str:
        """Return the entries of the first three rows in a column."""
        entries = [
            self.code.load(self.diagonals[HALF + column - i], i)
            if 0 <= HALF + column - i < WIDTH
            else self.code.constant(0.0)
            for i in range(HALF)
        ]
        return self.open.packed([*entries, self.code.constant(0.0)])

    def _first_entries(self, numbers: str) -> str:
        """Return the first three entries of a vector."""
        entries = [self.code.load(numbers, i) for i in range(HALF)]
        return self.open.packed([*entries, self.code.constant(0.0)])

    def _with_row(self, x: str, lane: str, numbers: str, new: str) -> str:
        """Return x with entry `new` of `numbers` in a lane, whose number is in all lanes."""
        wide = self.open
        lanes = f"<{', '.join(f'i64 {i}' for i in range(OPEN))}>"
        here = wide.let(f"icmp eq {wide.like('i64')} {lane}, {lanes}")
        return wide.choose(here, wide.packed([self.code.load(numbers, new)]), x)

    def _pivot_lane(self, column: str) -> str:
        """Return the lane of the largest of four entries, in all lanes.

        The last two bits of each are replaced by its lane: of entries that are equal otherwise the
        last is returned.
        """
        wide, kind = self.open, self.open.like("i64")
        lanes = f"<{', '.join(f'i64 {i}' for i in range(OPEN))}>"
        bits = wide.let(f"bitcast {wide.real} {wide.call('fabs', column)} to {kind}")
        bits = wide.let(f"and {kind} {bits}, {wide.splat_of(f'i64 {-OPEN}')}")
        bits = wide.let(f"or {kind} {bits}, {lanes}")
        for order in ((1, 0, 3, 2), (2, 3, 0, 1)):
            places = ", ".join(f"i32 {i}" for i in order)
            both = f"{kind} {bits}, {kind} poison"
            other = wide.let(f"shufflevector {both}, <{OPEN} x i32> <{places}>")
            bits = wide.let(f"call {kind} @llvm.umax.v{OPEN}i64({kind} {bits}, {kind} {other})")
        return wide.let(f"and {kind} {bits}, {wide.splat_of(f'i64 {HALF}')}")

    def _picked(self, x: str, lane: str) -> str:
        """Return the number in a lane of x, in all lanes."""
        wide, kind = self.open, self.open.like("i64")
        # LLVM makes one permutation of this only if every lane reads its own number of `lane`.
        lanes = [wide.let(f"extractelement {kind} {lane}, i64 {i}") for i in range(OPEN)]
        return wide.call("arithmetic.fence", wide.packed([wide.lane(x, i) for i in lanes]))

    # ---- Refinement ------------------------------------------------------------------------------

    def refine(self) -> str:
        """Compute x from the eliminated right-hand side, and refine it.

        Returns the number that is added to x at the end: 0, or NaN unless x is accurate enough.
        """
        code = self.code
        with code.repeat(("double", code.constant(float("inf"))), ("i64", "0")) as turn:
            before, steps = turn.carried
            self._add_correction()
            error = self._backward_error()
            large = code.compare("ogt", error, code.constant(REFINED))
            smaller = code.compare("olt", error, code.mul(before, code.constant(STALLED)))
            few = code.let(f"icmp slt i64 {steps}, {MOST_STEPS}")
            fewest = code.let(f"icmp slt i64 {steps}, {LEAST_STEPS}")
            turn.i = code.both(fewest, code.both(few, code.both(large, smaller)), "or")
            with code.when(turn.i):
                self._forward()
            turn.yielded = [error, code.integer("add", steps, 1)]
        accurate = code.compare("ole", turn.carried[0], code.constant(REFINED))
        return code.choose(accurate, code.constant(0.0), code.constant(float("nan")))

    def _add_correction(self) -> None:
        """Add to x, 0 at first, what follows from the eliminated right-hand side."""
        code = self.code
        with code.loop(self.size, *[("double", code.constant(0.0))] * AFTER) as turn:
            i = code.integer("sub", self.size - 1, turn.i)
            y = code.load(self.residual, i)
            row = code.address(self.upper, code.integer("mul", i, AFTER))
            # The latest unknown comes last: the other products do not depend on it.
            for j in reversed(range(AFTER)):
                y = multiply_subtract(code, y, code.load(row, j), turn.carried[j])
            code.store(code.add(code.load(self.x, i), y), self.x, i)
            turn.yielded = [y, *turn.carried[:-1]]

    def _residual(self, at: str) -> tuple[str, str]:
        """Return b - A x and |A||x| + |b| of eight rows."""
        code, rows = self.code, self.rows
        residual = rows.load(code.address(self.right, at))
        size = rows.call("fabs", residual)
        for j in range(WIDTH):
            entry = rows.load(code.address(self.diagonals[j], at))
            x = rows.load(code.address(self.x, code.integer("add", at, j - HALF)))
            residual = multiply_subtract(rows, residual, entry, x)
            size = multiply_add(rows, size, *(rows.call("fabs", y) for y in (entry, x)))
        return residual, size

    def _backward_error(self) -> str:
        """Return the backward error, NaN unless x, the matrix and b are finite.

        The residual is written.
        """
        code, rows = self.code, self.rows
        nothing, count = (rows.like("i64"), "zeroinitializer"), self.length // LANES
        with code.loop(count, nothing) as turn:
            at = code.integer("mul", turn.i, LANES)
            residual, size = self._residual(at)
            rows.store(residual, code.address(self.residual, at))
            rows.store(size, code.address(self.sizes, at))
            turn.yielded[0] = self._larger_bits(size, turn.carried[0])
        least = code.mul(self._largest(turn.carried[0]), code.constant(SMALLEST_SHARE))
        least = rows.packed([_larger(code, least, code.constant(SMALLEST_SIZE))])
        with code.loop(count, nothing) as turn:
            at = code.integer("mul", turn.i, LANES)
            residual, size = (rows.load(code.address(x, at)) for x in (self.residual, self.sizes))
            error = rows.div(rows.call("fabs", residual), _larger(rows, size, least))
            turn.yielded[0] = self._larger_bits(error, turn.carried[0])
        return self._largest(turn.carried[0])

    def _larger_bits(self, x: str, bits: str) -> str:
        """Return the larger of the bits of x >= 0 and other bits, lane by lane; NaN is largest."""
        rows, kind = self.rows, self.rows.like("i64")
        new = rows.let(f"bitcast {rows.real} {x} to {kind}")
        return rows.let(f"call {kind} @llvm.umax.v{LANES}i64({kind} {new}, {kind} {bits})")

    def _largest(self, bits: str) -> str:
        """Return the largest number of a vector of bits."""
        kind = self.rows.like("i64")
        bits = self.code.let(f"call i64 @llvm.vector.reduce.umax.v{LANES}i64({kind} {bits})")
        return self.code.let(f"bitcast i64 {bits} to double")


def _larger(code: IRBuilder, x: str, y: str) -> str:
    """Return the larger of two; y where one is NaN."""
    return code.choose(code.compare("ogt", x, y), x, y)
