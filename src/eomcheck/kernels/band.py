"""Band solves in machine code: `eomcheck.numbers.banded_solve`, eight rows per SIMD vector.

The matrix is stored diagonal by diagonal, so that consecutive rows are the lanes of a SIMD vector:
they are scaled, and their residuals computed, eight at a time. Scales, pivots and refinement follow
`eomcheck.numbers.pivots`; a matrix that these refuse gives NaN.

Columns are eliminated one after the other, each depending on the one before. So elimination works
from both ends at once (`TwoEndedFactors`), with the rows and columns of the far end in reverse, and
the remaining matrix in the middle is solved in registers. At each end four rows have an entry in a
column: they are stored column by column, four numbers to a vector; a pivot row is not moved, and
the next row takes over its lane.

For a long chain reading and writing memory takes most of the time. So x is refined once without
computing the backward error before: only the residual is written then. If x is not accurate enough
afterwards, all steps are repeated, with the backward error checked after each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from eomcheck.kernels import jit
from eomcheck.kernels.dense import InlineLU, emit_power_of_two_scale
from eomcheck.kernels.llvm_builder import LANES, IRBuilder
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
    from_both_ends,
)

# ---- Elimination from both ends ------------------------------------------------------------------

HALF, WIDTH = 3, 7
"""Number of entries on each side of the diagonal, and in a row."""

OPEN = HALF + 1
"""Number of rows that have an entry in a column while it is eliminated."""

ENDS = 2

ROW = (WIDTH - 1) * ENDS
"""Number of float64 stored of two rows of U, one of each end, interleaved: the entries after the
pivot, divided by it."""


PART = 16
"""Number of vectors of rows that are prepared (scaled, or their residual computed) at once."""

AHEAD = 2 * ENDS
"""Number of vectors of rows that have to be prepared in advance: for `HALF` rows at each end, and
for the incomplete vector at the far end."""


def padded(size: int) -> int:
    """Return the length in memory of a diagonal, or of a right-hand side: whole vectors."""
    return -(-size // LANES) * LANES


def steps_of(size: int) -> int:
    """Return the number of columns eliminated from each end; 6 or 7, or all, are left."""
    return max((size - 2 * HALF) // 2, 0)


def factors_workspace(size: int) -> int:
    """Return the number of float64 of the factors."""
    steps = steps_of(size)
    return steps * (ROW + ENDS * (OPEN + 1)) + -(-steps * ENDS // 8)


class BandEnd(NamedTuple):
    """An end of the band: its number, its first row, and the step (1 or -1) to the next row."""

    number: int
    first: int
    way: int

    def entry(self, j: int) -> int:
        """Return the diagonal with entry j of a row, counted from this end."""
        return j if self.way > 0 else WIDTH - 1 - j

    def row(self, code: IRBuilder, i: str) -> str:
        """Return the index of the row that is i rows from this end."""
        return code.integer("add" if self.way > 0 else "sub", self.first, i)


class TwoEndedFactors:
    """Factors of a band matrix of `size` rows.

    Args:
        code: builder of the function.
        size: number of rows.
        diagonals: addresses of the diagonals (7, size).
        right: address of the right-hand side.
        residual: address of another right-hand side, a residual; elimination writes its results
            there, for both right-hand sides.
        place: address of the workspace for factors.
    """

    def __init__(
        self,
        code: IRBuilder,
        size: int,
        diagonals: Sequence[str],
        right: str,
        residual: str,
        place: str,
    ):
        self.code, self.size, self.steps = code, size, steps_of(size)
        self.diagonals, self.right, self.residual = diagonals, right, residual
        self.open, self.pair = (code.wider(k) for k in (OPEN, ENDS))
        self.ends = [BandEnd(0, 0, 1), BandEnd(1, size - 1, -1)]
        self.lanes = f"<{', '.join(f'i64 {i}' for i in range(OPEN))}>"
        self.middle = from_both_ends(size)[2 * self.steps :].tolist()
        counts = (0, ROW, ENDS * OPEN, ENDS)
        self.upper, self.factors, self.inverses, self.which = (
            code.address(place, self.steps * sum(counts[: i + 1])) for i in range(4)
        )

    def _inward(
        self,
        prepare: Callable[[str], None],
        begin: Callable[[], list[tuple[str, str]]],
        step: Callable[[str, list[str]], list[str]],
    ) -> list[str]:
        """Write the steps of both ends, and return the values that they pass to the middle.

        Args:
            prepare: writes the code that prepares eight rows, from the index of the first. All rows
                are prepared once, shortly before they are read: they are still in the cache then.
            begin: returns the (type, value) that are passed to the first step.
            step: writes step i, and returns the values that it passes to the next.
        """
        code, vectors = self.code, padded(self.size) // LANES
        parts = (vectors - AHEAD) // PART
        first = vectors - parts * PART if parts > 1 else vectors

        def prepare_rows(count: int, before: str | int) -> None:
            with code.loop(count) as turn:
                v = code.integer("add", turn.i, before)
                near = code.integer("mul", code.integer("lshr", v, 1), LANES)
                far = code.integer("sub", (vectors - 1) * LANES, near)
                even = code.let(f"trunc i64 {v} to i1")
                prepare(code.let(f"select i1 {even}, i64 {far}, i64 {near}"))

        prepare_rows(first, 0)
        if not self.steps:
            return []
        state = begin()
        if parts <= 1:
            with code.loop(self.steps, *state) as turn:
                turn.yielded = step(turn.i, turn.carried)
            return turn.carried
        some = PART * LANES // ENDS
        with code.loop(parts, *state) as part:
            prepare_rows(PART, code.integer("add", code.integer("mul", part.i, PART), first))
            last = code.let(f"icmp eq i64 {part.i}, {parts - 1}")
            rest = self.steps - (parts - 1) * some
            count = code.let(f"select i1 {last}, i64 {rest}, i64 {some}")
            done = code.integer("mul", part.i, some)
            handed = [(kind, x) for (kind, _), x in zip(state, part.carried, strict=True)]
            with code.loop(count, *handed) as turn:
                turn.yielded = step(code.integer("add", done, turn.i), turn.carried)
            part.yielded = turn.carried
        return part.carried

    def eliminate(self, prepare: Callable[[str], None]) -> None:
        """Write the factors and the eliminated right-hand side; `prepare` as for `_inward`."""
        code, wide, kind = self.code, self.open, self.open.real

        def begin() -> list[tuple[str, str]]:
            state: list[tuple[str, str]] = []
            for end in self.ends:
                state += [(kind, self._first_rows(end, j)) for j in range(WIDTH - 1)]
                state.append((kind, self._begun(end, self.right)))
                state.append((wide.like("i64"), wide.splat_of(f"i64 {HALF}")))
            return state

        count = WIDTH + 1
        A, b = [], []
        carried = self._inward(prepare, begin, self._step)
        if self.steps:
            for end in self.ends:
                *columns, which = carried[end.number * count : (end.number + 1) * count]
                *columns, right = (self._closed(x, which) for x in columns)
                ahead = self._ahead(end)
                for lane in range(HALF):
                    row = dict(zip(ahead, (wide.lane(x, lane) for x in columns), strict=True))
                    A.append([row.get(j, code.constant(0.0)) for j in self.middle])
                    b.append(wide.lane(right, lane))
        for i in self._between():
            A.append([self._entry(i, j) for j in self.middle])
            b.append(code.load(self.right, i))
        self.dense = InlineLU(code, A, scaled=True)
        self.found = self.dense.solve(b)

    def _entry(self, i: int, j: int) -> str:
        """Return entry (i, j) of the matrix."""
        if abs(i - j) > HALF:
            return self.code.constant(0.0)
        return self.code.load(self.diagonals[HALF + j - i], i)

    def _ahead(self, end: BandEnd) -> list[int]:
        """Return the columns that an end has reached but not eliminated."""
        return [end.first + end.way * (self.steps + j) for j in range(2 * HALF)]

    def _between(self) -> range:
        """Return the rows in the middle that neither end has reached."""
        reached = self.steps + HALF if self.steps else 0
        return range(reached, self.size - reached)

    def _first_rows(self, end: BandEnd, j: int) -> str:
        """Return the entries of the first three rows of an end in its column j."""
        rows = [end.first + end.way * i for i in range(HALF)]
        entries = [self._entry(i, end.first + end.way * j) for i in rows]
        return self.open.packed([*entries, self.code.constant(0.0)])

    def _begun(self, end: BandEnd, numbers: str) -> str:
        """Return the entries of a vector, `numbers`, in the first three rows of an end."""
        first = [self.code.load(numbers, end.first + end.way * i) for i in range(HALF)]
        return self.open.packed([*first, self.code.constant(0.0)])

    def _at(self, which: str) -> str:
        """Return the condition that a lane is the lane `which`, which is the same in all lanes."""
        return self.open.let(f"icmp eq {self.open.like('i64')} {which}, {self.lanes}")

    def _closed(self, x: str, which: str) -> str:
        """Return numbers of rows, with that of the last row moved to the lane of the last pivot."""
        last = self.open.packed([self.open.lane(x, HALF)])
        return self.open.choose(self._at(which), last, x)

    def _step(self, i: str, carried: Sequence[str]) -> list[str]:
        """Eliminate a column of each end; the next row takes over the lane of the pivot row.

        Operations on both ends alternate, so that the CPU executes them in parallel.
        """
        code, wide = self.code, self.open
        count = len(carried) // ENDS
        windows, chosen = [], []
        for end in self.ends:
            *columns, right, which = carried[end.number * count : (end.number + 1) * count]
            free = self._at(which)
            new = end.row(code, code.integer("add", i, HALF))
            numbers = [self.diagonals[end.entry(j)] for j in range(WIDTH)]
            window = [*columns, wide.constant(0.0), right]
            windows.append(
                [
                    wide.choose(free, wide.packed([code.load(to, new)]), x)
                    for x, to in zip(window, [*numbers, self.right], strict=True)
                ]
            )
        for window in windows:
            which = self._pivot(window[0])
            # The inverses of all four, as long as the pivot is not known.
            inverses = wide.div(wide.constant(1.0), window[0])
            inverse = self._picked(wide.call("arithmetic.fence", inverses), which)
            chosen.append((which, inverse, wide.mul(window[0], inverse)))
        handed: list[list[str]] = [[] for _ in self.ends]
        row, at = code.integer("mul", i, ROW), code.integer("mul", i, ENDS)
        for j in range(1, WIDTH + 1):
            for end in self.ends:
                x, (which, inverse, factors) = windows[end.number][j], chosen[end.number]
                pivot = self._picked(x, which)
                handed[end.number].append(multiply_subtract(wide, x, factors, pivot))
                entry = code.mul(wide.lane(pivot, 0), wide.lane(inverse, 0))
                if j < WIDTH:
                    index = code.integer("add", row, ENDS * (j - 1) + end.number)
                    code.store(entry, self.upper, index)
                else:
                    code.store(entry, self.residual, end.row(code, i))
        for end, (which, inverse, factors) in zip(self.ends, chosen, strict=True):
            index = code.integer("add", at, end.number)
            code.store(wide.lane(inverse, 0), self.inverses, index)
            wide.store(factors, code.address(self.factors, code.integer("mul", index, OPEN)))
            lane = code.let(f"extractelement {wide.like('i64')} {which}, i64 0")
            lane = code.let(f"trunc i64 {lane} to i8")
            code.do(f"store i8 {lane}, ptr {code.address(self.which, index, 'i8')}")
        pairs = zip(handed, chosen, strict=True)
        return [x for window, (which, *_) in pairs for x in (*window, which)]

    def _pivot(self, column: str) -> str:
        """Return the index of the largest of four entries, in all lanes.

        All later operations depend on it, so only the leading 32 bits of each are compared, which
        is faster. Their last two bits are replaced by the index of the entry: of several entries
        that are equal otherwise, the last is returned.
        """
        wide, kind, halves = self.open, self.open.like("i64"), f"<{2 * OPEN} x i32>"
        marks = ", ".join(f"i32 0, i32 {i}" for i in range(OPEN))
        mask = ", ".join(f"i32 0, i32 {2**31 - 1 - HALF}" for _ in range(OPEN))
        bits = wide.let(f"bitcast {wide.real} {column} to {halves}")
        bits = wide.let(f"and {halves} {bits}, <{mask}>")
        bits = wide.let(f"or {halves} {bits}, <{marks}>")
        for order in ((2, 3, 0, 1, 6, 7, 4, 5), (4, 5, 6, 7, 0, 1, 2, 3)):
            places = ", ".join(f"i32 {i}" for i in order)
            both = f"{halves} {bits}, {halves} poison"
            other = wide.let(f"shufflevector {both}, <{2 * OPEN} x i32> <{places}>")
            bits = wide.let(f"call {halves} @llvm.umax.v8i32({halves} {bits}, {halves} {other})")
        bits = wide.let(f"bitcast {halves} {bits} to {kind}")
        bits = wide.let(f"lshr {kind} {bits}, {wide.splat_of('i64 32')}")
        return wide.let(f"and {kind} {bits}, {wide.splat_of(f'i64 {HALF}')}")

    def _picked(self, x: str, which: str) -> str:
        """Return the number of the row `which`, in all lanes."""
        wide, kind = self.open, self.open.like("i64")
        places = [wide.let(f"extractelement {kind} {which}, i64 {i}") for i in range(OPEN)]
        picked = wide.packed([wide.lane(x, place) for place in places])
        return wide.call("arithmetic.fence", picked)

    def forward(self, prepare: Callable[[str], None]) -> None:
        """Write the eliminated residual, and solve the middle.

        `prepare` writes the residual, as for `_inward`.
        """
        code, wide, kind = self.code, self.open, self.open.like("i64")

        def begin() -> list[tuple[str, str]]:
            state = [(wide.real, self._begun(end, self.residual)) for end in self.ends]
            return state + [(kind, wide.splat_of(f"i64 {HALF}"))] * ENDS

        def step(i: str, carried: Sequence[str]) -> list[str]:
            handed = list(carried)
            for end in self.ends:
                x, which = carried[end.number :: ENDS]
                new = end.row(code, code.integer("add", i, HALF))
                new = wide.packed([code.load(self.residual, new)])
                x = wide.choose(self._at(which), new, x)
                at = code.integer("add", code.integer("mul", i, ENDS), end.number)
                row = code.let(f"load i8, ptr {code.address(self.which, at, 'i8')}")
                row = code.let(f"zext i8 {row} to i64")
                which = "poison"
                for lane in range(OPEN):
                    which = wide.let(f"insertelement {kind} {which}, i64 {row}, i64 {lane}")
                pivot = self._picked(x, which)
                factors = code.address(self.factors, code.integer("mul", at, OPEN))
                entry = code.mul(wide.lane(pivot, 0), code.load(self.inverses, at))
                code.store(entry, self.residual, end.row(code, i))
                handed[end.number :: ENDS] = [
                    multiply_subtract(wide, x, wide.load(factors), pivot),
                    which,
                ]
            return handed

        b = []
        carried = self._inward(prepare, begin, step)
        if self.steps:
            for end in self.ends:
                x = self._closed(*carried[end.number :: ENDS])
                b += [wide.lane(x, lane) for lane in range(HALF)]
        b += [code.load(self.residual, i) for i in self._between()]
        self.found = self.dense.solve(b)

    def substitute(self, keep: Callable[[str, str], None]) -> None:
        """Compute unknowns from the middle to both ends; `keep` takes index and unknown."""
        code, pair = self.code, self.pair
        known = dict(zip(self.middle, self.found, strict=True))
        for i, y in known.items():
            keep(str(i), y)
        if not self.steps:
            return
        begun = zip(*(self._ahead(end) for end in self.ends), strict=True)
        state = [(pair.real, pair.packed([known[i] for i in places])) for places in begun]
        with code.loop(self.steps, *state) as turn:
            i = code.integer("sub", self.steps - 1, turn.i)
            at = code.integer("mul", i, ROW)
            places = [end.row(code, i) for end in self.ends]
            y = pair.packed([code.load(self.residual, place) for place in places])
            # The latest unknown comes last: the other products do not depend on it.
            for j in range(2 * HALF, 0, -1):
                entries = pair.load(
                    code.address(self.upper, code.integer("add", at, ENDS * (j - 1)))
                )
                y = multiply_subtract(pair, y, entries, turn.carried[j - 1])
            for end, place in zip(self.ends, places, strict=True):
                keep(place, pair.lane(y, end.number))
            turn.yielded = [y, *turn.carried[:-1]]


def multiply_add(code: IRBuilder, x: str, y: str, z: str) -> str:
    """Return x + y z, by fused multiply-add on machines that have it."""
    if jit.cpu_features()[2]:
        return code.call("fma", y, z, x)
    return code.add(x, code.mul(y, z))


def multiply_subtract(code: IRBuilder, x: str, y: str, z: str) -> str:
    """Return x - y z, by fused multiply-add on machines that have it."""
    return multiply_add(code, x, code.neg(y), z)


# ---- Scaling, solution and refinement ------------------------------------------------------------


def solve_workspace(size: int) -> int:
    """Return the number of float64 of the workspace of a solve."""
    return 10 * padded(size) + 2 * LANES + 2 + factors_workspace(size)


def band_text(name: str, size: int, stride: int) -> str:
    """Return the function (diagonals, x, room) for a matrix of `size` rows.

    Entries of the diagonals (8, padded size), of which the last is the right-hand side, and those
    of x are `stride` float64 apart. With `stride` 1 the diagonals are scaled in place, otherwise in
    the workspace `room`.
    """
    code = IRBuilder()
    solve = _BandSolveCode(code, size, stride)
    solve.ends.eliminate(solve.scale)
    solve.found(new=True)
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
        zero: address of the number that is added to x at the end: 0, or NaN unless x is finite and
            accurate enough.
    """

    def __init__(self, code: IRBuilder, size: int, stride: int):
        self.code, self.length = code, padded(size)
        self.rows = code.wider(LANES)
        at = 0

        def taken(count: int) -> str:
            nonlocal at
            at += count
            return code.address("%room", at - count)

        self.given = [code.address("%rows", j * self.length * stride) for j in range(WIDTH + 1)]
        scaled = [taken(self.length) for _ in self.given] if stride > 1 else self.given
        *self.diagonals, self.right = scaled
        self.residual = taken(self.length)
        self.x = code.address(taken(self.length + 2 * LANES), LANES)
        self.beta, self.zero = taken(1), taken(1)
        place = taken(0)
        self.ends = TwoEndedFactors(code, size, self.diagonals, self.right, self.residual, place)
        self.stride = stride
        for i in (-LANES, size):
            self.rows.store("zeroinitializer", code.address(self.x, i))

    def scale(self, at: str) -> None:
        """Scale eight rows: in place, or into the workspace if they are not contiguous."""
        code, rows = self.code, self.rows
        entries = []
        for numbers in self.given:
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

    # ---- Refinement ------------------------------------------------------------------------------

    def found(self, *, new: bool) -> None:
        """Compute x, if `new`, otherwise its correction, from the eliminated right-hand side."""
        code = self.code

        def keep(i: str, y: str) -> None:
            code.store(y if new else code.add(code.load(self.x, i), y), self.x, i)

        self.ends.substitute(keep)

    def refine(self) -> None:
        """Write one step of refinement."""

        def write(at: str) -> None:
            self.rows.store(
                self._residual(at, sizes=False)[0], self.code.address(self.residual, at)
            )

        self.ends.forward(write)
        self.found(new=False)

    def refine_step_by_step(self) -> None:
        """Solve again, and refine as long as each step halves the backward error."""
        code, rows = self.code, self.rows

        def write(at: str) -> None:
            rows.store(rows.load(code.address(self.right, at)), code.address(self.residual, at))

        self.ends.forward(write)
        self.found(new=True)
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
