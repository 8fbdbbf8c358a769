"""Band solves in machine code: `eomcheck.numbers.banded_solve`, eight rows per SIMD vector.

The matrix is stored diagonal by diagonal, so that consecutive rows are the lanes of a SIMD vector:
they are scaled, and their residuals computed, eight at a time. Scales, pivots and refinement follow
`eomcheck.numbers.pivots`; a matrix that these refuse gives NaN.

Columns are eliminated one after the other. Four rows have an entry in a column: they are stored
column by column, four numbers to a vector; a pivot row is not moved, and the next row takes over
its lane. Below the matrix are rows of zeros, so that the last columns need no code of their own.

x is refined once without computing the backward error before: only the residual is written then. If
x is not accurate enough afterwards, all steps are repeated, with the backward error checked after
each.

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
    return 10 * padded(size) + 3 * LANES + 2 + size * (AFTER + OPEN + 2)


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
    solve.substitute(new=True)
    for _ in range(LEAST_STEPS):
        solve.refine()
    beta = solve.backward_error()
    # A β that is not finite ends the refinement: after an overflow x is not finite either.
    with code.when(code.compare("ogt", beta, code.constant(REFINED))):
        solve.refine_step_by_step()
    clear = code.load(solve.zero)
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
        zero: address of the number that is added to x at the end: 0, or NaN unless x is finite and
            accurate enough.
        upper: address of the rows of U (size, 6), each divided by its pivot, without the pivot.
        factors: address of the factors of elimination (size, 4), one for each lane.
        inverses: address of the inverses of the pivots (size,).
        lanes: address of the lanes of the pivots (size,), integers.
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
        self.residual = reserve(self.length)
        self.x = code.address(reserve(self.length + 2 * LANES), LANES)
        self.factors, self.upper = reserve(size * OPEN), reserve(size * AFTER)
        self.inverses, self.lanes = reserve(size), reserve(size)
        self.beta, self.zero = reserve(1), reserve(1)
        for i in (-LANES, size):
            self.rows.store("zeroinitializer", code.address(self.x, i))

    def scale(self) -> None:
        """Scale all rows: in place, or into the workspace if they are not contiguous."""
        code, rows = self.code, self.rows
        with code.loop(self.length // LANES) as turn:
            at = code.integer("mul", turn.i, LANES)
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
            lane = code.let(f"extractelement {wide.like('i64')} {pivot}, i64 0")
            code.do(f"store i64 {lane}, ptr {code.address(self.lanes, turn.i)}")
            turn.yielded = [*below, pivot]

    def forward(self) -> None:
        """Eliminate another right-hand side, the residual."""
        code, wide = self.code, self.open
        state = [(wide.real, self._first_entries(self.residual))]
        state.append((wide.like("i64"), wide.splat_of(f"i64 {HALF}")))
        with code.loop(self.size, *state) as turn:
            x, free = turn.carried
            x = self._with_row(x, free, self.residual, code.integer("add", turn.i, HALF))
            lane = code.let(f"load i64, ptr {code.address(self.lanes, turn.i)}")
            pivot = "poison"
            for i in range(OPEN):
                pivot = wide.let(f"insertelement {wide.like('i64')} {pivot}, i64 {lane}, i64 {i}")
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

    def substitute(self, *, new: bool) -> None:
        """Compute x, if `new`, otherwise its correction, from the eliminated right-hand side."""
        code = self.code
        with code.loop(self.size, *[("double", code.constant(0.0))] * AFTER) as turn:
            i = code.integer("sub", self.size - 1, turn.i)
            y = code.load(self.residual, i)
            row = code.address(self.upper, code.integer("mul", i, AFTER))
            # The latest unknown comes last: the other products do not depend on it.
            for j in reversed(range(AFTER)):
                y = multiply_subtract(code, y, code.load(row, j), turn.carried[j])
            code.store(y if new else code.add(code.load(self.x, i), y), self.x, i)
            turn.yielded = [y, *turn.carried[:-1]]

    # ---- Refinement ------------------------------------------------------------------------------

    def refine(self) -> None:
        """Write one step of refinement."""
        code = self.code
        with code.loop(self.length // LANES) as turn:
            at = code.integer("mul", turn.i, LANES)
            residual, _ = self._residual(at, sizes=False)
            self.rows.store(residual, code.address(self.residual, at))
        self.forward()
        self.substitute(new=False)

    def refine_step_by_step(self) -> None:
        """Solve again, and refine as long as each step halves the backward error."""
        code, rows = self.code, self.rows

        with code.loop(self.length // LANES) as turn:
            at = code.integer("mul", turn.i, LANES)
            rows.store(rows.load(code.address(self.right, at)), code.address(self.residual, at))
        self.forward()
        self.substitute(new=True)
        state = (("double", code.constant(float("inf"))), ("i64", "0"))
        with code.repeat(*state) as turn:
            before, steps = turn.carried
            beta = self.backward_error()
            small = code.compare("ule", beta, code.constant(REFINED))
            enough = code.let(f"icmp sge i64 {steps}, {LEAST_STEPS}")
            limit = code.mul(before, code.constant(STALLED))
            stalled = code.compare("ugt", beta, limit)
            most = code.let(f"icmp sge i64 {steps}, {MOST_STEPS}")
            given_up = code.both(stalled, most, "or")
            first = code.let(f"icmp eq i64 {steps}, 0")
            fine = code.both(small, enough)
            failed = code.let(f"select i1 {first}, i1 false, i1 {given_up}")
            failed = code.let(f"select i1 {small}, i1 false, i1 {failed}")
            over = code.both(fine, failed, "or")
            more = code.let(f"xor i1 {over}, true")
            with code.when(more):
                self.refine()
            turn.yielded = [beta, code.integer("add", steps, 1)]
            turn.i = more
        with code.when(failed):
            code.store(code.constant(float("nan")), self.zero)

    # ---- Residual --------------------------------------------------------------------------------

    def _residual(self, at: str, *, sizes: bool = True) -> tuple[str, str]:
        """Return b - A x and, with `sizes`, |A||x| + |b| of eight rows."""
        code, rows = self.code, self.rows
        left = rows.load(code.address(self.right, at))
        whole = rows.call("fabs", left) if sizes else ""
        for j in range(WIDTH):
            entry = rows.load(code.address(self.diagonals[j], at))
            x = rows.load(code.address(self.x, code.integer("add", at, j - HALF)))
            left = multiply_subtract(rows, left, entry, x)
            if sizes:
                whole = multiply_add(rows, whole, *(rows.call("fabs", y) for y in (entry, x)))
        return left, whole

    def backward_error(self) -> str:
        """Return the backward error β; `REFINED` if it is less.

        `zero` is set to 0 times the residual: NaN unless x, the matrix and b are finite.
        """
        code, rows = self.code, self.rows
        nothing = (rows.real, rows.constant(0.0))
        count = self.length // LANES
        with code.loop(count, nothing, nothing, nothing) as turn:
            left, whole = self._residual(code.integer("mul", turn.i, LANES))
            above = rows.mul(whole, rows.constant(REFINED))
            above = rows.sub(rows.call("fabs", left), above)
            turn.yielded = [
                _larger(rows, whole, turn.carried[0]),
                _larger(rows, above, turn.carried[1]),
                rows.add(turn.carried[2], rows.mul(left, rows.constant(0.0))),
            ]
        sizes, above, zeros = turn.carried
        zero = code.constant(0.0)
        for lane in range(LANES):
            zero = code.add(zero, rows.lane(zeros, lane))
        code.store(zero, self.zero)
        code.store(code.constant(REFINED), self.beta)
        # Usually no row exceeds `REFINED`, and no division is needed.
        with code.when(code.compare("ogt", self._largest(above), code.constant(0.0))):
            least = code.mul(self._largest(sizes), code.constant(SMALLEST_SHARE))
            least = rows.packed([_larger(code, least, code.constant(SMALLEST_SIZE))])
            with code.loop(count, nothing) as turn:
                left, whole = self._residual(code.integer("mul", turn.i, LANES))
                share = rows.div(rows.call("fabs", left), _larger(rows, whole, least))
                turn.yielded[0] = _larger(rows, share, turn.carried[0])
            code.store(self._largest(turn.carried[0]), self.beta)
        return code.load(self.beta)

    def _largest(self, x: str) -> str:
        """Return the largest number of a vector."""
        largest = self.rows.lane(x, 0)
        for lane in range(1, LANES):
            largest = _larger(self.code, self.rows.lane(x, lane), largest)
        return largest


def _larger(code: IRBuilder, x: str, y: str) -> str:
    """Return the larger of two; y where one is NaN."""
    return code.choose(code.compare("ogt", x, y), x, y)
