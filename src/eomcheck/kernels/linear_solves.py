"""Linear solves in machine code: no branch, no exception; of a singular matrix x is NaN.

Scales and pivots follow `eomcheck.numbers.linear`, refinement `eomcheck.numbers.banded_solve`; what
these refuse gives NaN.

Small matrices are eliminated in registers, with rows exchanged by select instructions; larger ones
in memory by LAPACK (`dgetrf`, `dgetrs`), lane by lane.

A band matrix (`eomcheck.numbers.banded_solve`) is stored diagonal by diagonal, so that consecutive
rows are the lanes of a SIMD vector: they are scaled, and their residuals computed, eight at a time.
Its columns are eliminated one after the other. Four rows have an entry in a column: they are stored
column by column, four numbers to a vector; a pivot row is not moved, and the next row takes over
its lane. Below the matrix are rows of zeros, so that the last columns need no code of their own.
LAPACK (`dgbtrf`, `dgbtrs`) takes eight times as long for the chain of 100 links: its blocks are far
wider than this band.
"""

from __future__ import annotations

import ctypes
from functools import cache, reduce

from eomcheck.kernels.llvm import FINITE_NOT_ZERO, LANES, IRBuilder
from eomcheck.numbers.banded_solve import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
)
from eomcheck.numbers.linear import ABOVE_ONE, LARGEST_EXPONENT

# ---- In registers --------------------------------------------------------------------------------

ONE, EXPONENT = 1023, 52
"""Biased exponent of 1 in the bits of a float64, and the position of its lowest bit."""


def emit_power_of_two_scale(code: IRBuilder, largest: str) -> str:
    """Return the powers of two of `eomcheck.numbers.linear.power_of_two_scale`, lane by lane."""
    kind = code.type_of("i64")

    def whole(x: int) -> str:
        return code.splat_of(f"i64 {x}")

    raised = code.mul(largest, code.constant(ABOVE_ONE))
    bits = code.let(f"lshr {kind} {_bits(code, raised)}, {whole(EXPONENT)}")
    power = code.let(f"sub {kind} {whole(2 * ONE - 1)}, {bits}")
    for how, limit in (("smax", ONE - LARGEST_EXPONENT), ("smin", ONE + LARGEST_EXPONENT)):
        suffix = kind if code.width == 1 else f"v{code.width}i64"
        power = code.let(f"call {kind} @llvm.{how}.{suffix}({kind} {power}, {kind} {whole(limit)})")
    shifted = code.let(f"shl {kind} {power}, {whole(EXPONENT)}")
    scale = code.let(f"bitcast {kind} {shifted} to {code.real}")
    above = code.compare("ogt", largest, code.constant(0.0))
    below = code.compare("one", largest, code.constant(float("inf")))
    return code.choose(code.both(above, below), scale, code.constant(0.5))


def _exponent(code: IRBuilder, row: list[str]) -> str:
    """Return the bits of the power of two next below the largest entry of a row."""
    largest, *others = (code.call("fabs", x) for x in row)
    for x in others:  # a NaN is ignored here: it makes x NaN in any row
        largest = code.choose(code.compare("ogt", largest, x), largest, x)
    bits = _bits(code, code.mul(largest, code.constant(ABOVE_ONE)))
    mask = code.splat_of(f"i64 {-(1 << EXPONENT)}")
    return code.let(f"and {code.type_of('i64')} {bits}, {mask}")


def _bits(code: IRBuilder, x: str) -> str:
    return code.let(f"bitcast {code.real} {x} to {code.type_of('i64')}")


def _scaled(code: IRBuilder, x: str, exponent: str) -> str:
    """Return the bits of |x| in a scaled row, which are ordered as the numbers are."""
    return code.let(f"sub {code.type_of('i64')} {_bits(code, code.call('fabs', x))}, {exponent}")


def _larger_bits(code: IRBuilder, one: str, other: str) -> str:
    return code.let(f"icmp sgt {code.type_of('i64')} {one}, {other}")


class InlineLU:
    """A matrix (k, k) of values, factored in registers.

    Pivots are chosen in scaled rows, and elimination uses the unscaled ones: powers of two round
    nothing. Entries that are literal zeros are no pivots, and operations on them are left out.
    """

    def __init__(self, code: IRBuilder, A: list[list[str]]):
        self.code, self.zero = code, code.constant(0.0)
        self.exponents = [_exponent(code, row) for row in A]
        self.upper: list[list[str]] = []
        self.factors: list[list[str]] = []
        self.chosen: list[list[str | None]] = []
        rows = A
        while rows:
            rows = self._eliminated(rows)
        # Checked in parallel to the elimination, which does not wait for it: x is NaN at the end.
        usable = [code.is_class(row[0], FINITE_NOT_ZERO) for row in self.upper]
        self.usable = reduce(code.both, usable)

    def _eliminated(self, rows: list[list[str]]) -> list[list[str]]:
        """Choose a pivot among `rows`, store its row, and return the others without its column."""
        code = self.code
        largest = _scaled(code, rows[0][0], self.exponents[0])
        where: list[str | None] = []
        for row, exponent in zip(rows[1:], self.exponents[1:], strict=True):
            if row[0] == self.zero:
                where.append(None)
                continue
            size = _scaled(code, row[0], exponent)
            larger = _larger_bits(code, size, largest)
            where.append(larger)
            largest = self._whole(larger, size, largest)
        # The last entry that is larger than all before is the pivot.
        marks: list[str | None] = []
        later = None
        for mark in reversed(where):
            taken = mark
            if mark is not None:
                taken = mark if later is None else code.both(mark, self._not(later))
                later = mark if later is None else code.either(later, mark)
            marks.insert(0, taken)
        self.chosen.append(marks)
        pivot, *others = self._exchanged(rows, marks)
        first, *rest = self.exponents
        self.exponents = [
            x if mark is None else self._whole(mark, first, x)
            for mark, x in zip(marks, rest, strict=True)
        ]
        self.upper.append(pivot)
        factors = [self._quotient(row[0], pivot[0]) for row in others]
        self.factors.append(factors)
        return [
            [self._less(x, f, y) for x, y in zip(row[1:], pivot[1:], strict=True)]
            for row, f in zip(others, factors, strict=True)
        ]

    def _quotient(self, x: str, y: str) -> str:
        return x if x == self.zero else self.code.div(x, y)

    def _less(self, x: str, y: str, z: str) -> str:
        """Return x - y z."""
        return x if self.zero in (y, z) else self.code.sub(x, self.code.mul(y, z))

    def _whole(self, where: str, x: str, y: str) -> str:
        kind = self.code.type_of("i64")
        return self.code.let(f"select {self.code.type_of('i1')} {where}, {kind} {x}, {kind} {y}")

    def _not(self, where: str) -> str:
        kind = self.code.type_of("i1")
        return self.code.let(f"xor {kind} {where}, {self.code.splat_of('i1 true')}")

    def _exchanged(self, rows: list[list[str]], marks: list[str | None]) -> list[list[str]]:
        """Return the marked row, and the others with the first row exchanged for it."""
        first, others = rows[0], []
        pivot = first
        for row, mark in zip(rows[1:], marks, strict=True):
            if mark is None:
                others.append(row)
                continue
            pivot = [self.code.choose(mark, x, y) for x, y in zip(row, pivot, strict=True)]
            pairs = zip(first, row, strict=True)
            others.append([self.code.choose(mark, x, y) for x, y in pairs])
        return [pivot, *others]

    def solve(self, b: list[str]) -> list[str]:
        """Return the solution x (k,) for values b (k,)."""
        code = self.code
        left, done = [[y] for y in b], []
        for marks, factors in zip(self.chosen, self.factors, strict=True):
            (pivot,), *others = self._exchanged(left, marks)
            done.append(pivot)
            left = [[self._less(y, f, pivot)] for (y,), f in zip(others, factors, strict=True)]
        x: list[str] = []
        for row, right in zip(reversed(self.upper), reversed(done), strict=True):
            for coefficient, y in zip(reversed(row[1:]), reversed(x), strict=True):
                right = self._less(right, coefficient, y)
            x.insert(0, self._quotient(right, row[0]))
        nan = code.constant(float("nan"))
        return [code.choose(self.usable, y, nan) for y in x]


# ---- In memory -----------------------------------------------------------------------------------


@cache
def address_of(library: str, name: str) -> int:
    """Return the address of a "blas" or "lapack" routine that SciPy exports to compiled code."""
    import importlib

    capsule = importlib.import_module(f"scipy.linalg.cython_{library}").__pyx_capi__[name]
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype, api.PyCapsule_GetName.argtypes = (
        ctypes.c_char_p,
        [ctypes.py_object],
    )
    get = api.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    return get(capsule, api.PyCapsule_GetName(capsule))


def _call(code: IRBuilder, library: str, name: str, *pointers: str) -> None:
    address = address_of(library, name)
    arguments = ", ".join(f"ptr {p}" for p in pointers)
    code.do(f"call void inttoptr (i64 {address} to ptr)({arguments})")


def _whole(code: IRBuilder, value: int) -> str:
    """Return the address of a 32-bit integer, an argument of LAPACK."""
    return _stored(code, "i32", value)


def _stored(code: IRBuilder, kind: str, value: object) -> str:
    address = code.let(f"alloca {kind}")
    code.do(f"store {kind} {value}, ptr {address}")
    return address


def factor_text(name: str, size: int, stride: int) -> str:
    """Return the function (from, to) that factors a matrix (k, k), stored column by column.

    Its entries are `stride` float64 apart; factors, scales of rows and pivots are written to `to`.
    """
    code = IRBuilder()
    order, info = _whole(code, size), _whole(code, 0)
    scales = code.address("%to", size * size)
    pivots = code.address("%to", size * size + size)
    if stride > 1:
        with code.loop(size * size) as turn:
            code.store(code.load("%from", code.integer("mul", turn.i, stride)), "%to", turn.i)
    source = "%to" if stride > 1 else "%from"
    for width, times, first in _placed(size):
        wide = code.wider(width)
        with code.loop(times) as row:
            at = code.integer("add", code.integer("mul", row.i, width), first)
            with code.loop(size, (wide.real, wide.constant(0.0))) as column:
                index = code.integer("add", at, code.integer("mul", column.i, size))
                entry = wide.load(code.address(source, index))
                column.yielded[0] = wide.call("maxnum", column.carried[0], wide.call("fabs", entry))
            scale = emit_power_of_two_scale(wide, column.carried[0])
            wide.store(scale, code.address(scales, at))
            with code.loop(size) as column:
                index = code.integer("add", at, code.integer("mul", column.i, size))
                entry = wide.load(code.address(source, index))
                wide.store(wide.mul(entry, scale), code.address("%to", index))
    _call(code, "lapack", "dgetrf", order, order, "%to", order, pivots, info)
    # A pivot that is 0 or not finite must not yield a finite solution.
    with code.loop(size, ("double", code.constant(0.0))) as turn:
        pivot = code.load("%to", code.integer("mul", turn.i, size + 1))
        large = code.compare("ueq", code.call("fabs", pivot), code.constant(float("inf")))
        bad = code.either(code.compare("ueq", pivot, code.constant(0.0)), large)
        turn.yielded[0] = code.choose(bad, code.constant(float("nan")), turn.carried[0])
    with code.loop(size) as row:
        code.store(code.add(code.load(scales, row.i), turn.carried[0]), scales, row.i)
    return code.function(
        f"define internal void @{name}(ptr noalias %from, ptr noalias %to) nounwind"
    )


def _placed(size: int) -> list[tuple[int, int, int]]:
    """Return the vectors (width, times, first) of which a row of `size` consists."""
    full, left = divmod(size, LANES)
    parts = (LANES, full, 0), (1, left, full * LANES)
    return [part for part in parts if part[1]]


def solve_text(name: str, size: int, columns: int, stride: int) -> str:
    """Return the function (factors, b, x, room) that solves for b (k, m), stored row by row.

    Entries of b and x are `stride` float64 apart; `room` is a workspace of k m float64.
    """
    code = IRBuilder()
    order, many, info = _whole(code, size), _whole(code, columns), _whole(code, 0)
    plain = _stored(code, "i8", ord("N"))
    scales = code.address("%factors", size * size)
    pivots = code.address("%factors", size * size + size)

    def indices(row: str, column: str) -> tuple[str, str]:
        """Return the index of an entry in b and x, and that in the workspace."""
        index = code.integer("add", code.integer("mul", row, columns), column)
        if stride > 1:
            index = code.integer("mul", index, stride)
        return index, code.integer("add", row, code.integer("mul", column, size))

    with code.loop(size) as row:
        scale = code.load(scales, row.i)
        with code.loop(columns) as column:
            outside, inside = indices(row.i, column.i)
            code.store(code.mul(code.load("%b", outside), scale), "%room", inside)
    arguments = (plain, order, many, "%factors", order, pivots, "%room", order, info)
    _call(code, "lapack", "dgetrs", *arguments)
    with code.loop(size) as row, code.loop(columns) as column:
        outside, inside = indices(row.i, column.i)
        code.store(code.load("%room", inside), "%x", outside)
    head = "ptr noalias %factors, ptr noalias %b, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({head}) nounwind")


def product_text(name: str, rows: int, inner: int, columns: int, stride: int) -> str:
    """Return the function (A followed by B, x, room) of a product of matrices, by BLAS.

    All are stored row by row, entries `stride` float64 apart; `room` is a workspace.
    """
    code = IRBuilder()
    n, k, m = (_whole(code, size) for size in (rows, inner, columns))
    plain = _stored(code, "i8", ord("N"))
    zero, one = (_stored(code, "double", code.constant(x)) for x in (0.0, 1.0))
    read, result = inner * (rows + columns), rows * columns
    A, x = ("%room", code.address("%room", read)) if stride > 1 else ("%from", "%x")
    if stride > 1:
        with code.loop(read) as turn:
            code.store(code.load("%from", code.integer("mul", turn.i, stride)), A, turn.i)
    # A product stored row by row is its transpose stored column by column.
    arguments = (plain, plain, m, n, k, one, code.address(A, rows * inner), m, A, k, zero, x, m)
    _call(code, "blas", "dgemm", *arguments)
    if stride > 1:
        with code.loop(result) as turn:
            code.store(code.load(x, turn.i), "%x", code.integer("mul", turn.i, stride))
    head = "ptr noalias %from, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({head}) nounwind")


# ---- Bands ---------------------------------------------------------------------------------------

HALF, WIDTH = 3, 7
"""Number of entries on each side of the diagonal, and in a row."""

OPEN = HALF + 1
"""Number of rows that have an entry in a column while it is eliminated."""

AFTER = WIDTH - 1
"""Number of entries of a row of U after its pivot."""


def padded(size: int) -> int:
    """Return the length in memory of a diagonal, with rows of zeros below: whole vectors."""
    return -(-(size + HALF) // LANES) * LANES


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
        state.append((wide.type_of("i64"), wide.splat_of(f"i64 {HALF}")))
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
                below.append(wide.multiply_subtract(x, factors, row))
                entry = code.mul(wide.lane(row, 0), wide.lane(inverse, 0))
                if j < AFTER:
                    index = code.integer("add", code.integer("mul", turn.i, AFTER), j)
                    code.store(entry, self.upper, index)
                else:
                    code.store(entry, self.residual, turn.i)
            code.store(wide.lane(inverse, 0), self.inverses, turn.i)
            wide.store(factors, code.address(self.factors, code.integer("mul", turn.i, OPEN)))
            lanes = code.address(self.lanes, code.integer("mul", turn.i, OPEN))
            code.do(f"store {wide.type_of('i64')} {pivot}, ptr {lanes}, align 8")
            turn.yielded = [*below, pivot]

    def _forward(self) -> None:
        """Eliminate another right-hand side, the residual."""
        code, wide = self.code, self.open
        state = [(wide.real, self._first_entries(self.residual))]
        state.append((wide.type_of("i64"), wide.splat_of(f"i64 {HALF}")))
        with code.loop(self.size, *state) as turn:
            x, free = turn.carried
            x = self._with_row(x, free, self.residual, code.integer("add", turn.i, HALF))
            lanes = code.address(self.lanes, code.integer("mul", turn.i, OPEN))
            pivot = wide.let(f"load {wide.type_of('i64')}, ptr {lanes}, align 8")
            row = self._picked(x, pivot)
            factors = wide.load(code.address(self.factors, code.integer("mul", turn.i, OPEN)))
            entry = code.mul(wide.lane(row, 0), code.load(self.inverses, turn.i))
            code.store(entry, self.residual, turn.i)
            turn.yielded = [wide.multiply_subtract(x, factors, row), pivot]

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
        here = wide.let(f"icmp eq {wide.type_of('i64')} {lane}, {lanes}")
        return wide.choose(here, wide.packed([self.code.load(numbers, new)]), x)

    def _pivot_lane(self, column: str) -> str:
        """Return the lane of the largest of four entries, in all lanes.

        The last two bits of each are replaced by its lane: of entries that are equal otherwise the
        last is returned.
        """
        wide, kind = self.open, self.open.type_of("i64")
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
        wide, kind = self.open, self.open.type_of("i64")
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
            turn.condition = code.either(fewest, code.both(few, code.both(large, smaller)))
            with code.when(turn.condition):
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
                y = code.multiply_subtract(y, code.load(row, j), turn.carried[j])
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
            residual = rows.multiply_subtract(residual, entry, x)
            size = rows.multiply_add(size, *(rows.call("fabs", y) for y in (entry, x)))
        return residual, size

    def _backward_error(self) -> str:
        """Return the backward error, NaN unless x, the matrix and b are finite.

        The residual is written.
        """
        code, rows = self.code, self.rows
        nothing, count = (rows.type_of("i64"), "zeroinitializer"), self.length // LANES
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
        rows, kind = self.rows, self.rows.type_of("i64")
        new = rows.let(f"bitcast {rows.real} {x} to {kind}")
        return rows.let(f"call {kind} @llvm.umax.v{LANES}i64({kind} {new}, {kind} {bits})")

    def _largest(self, bits: str) -> str:
        """Return the largest number of a vector of bits."""
        kind = self.rows.type_of("i64")
        bits = self.code.let(f"call i64 @llvm.vector.reduce.umax.v{LANES}i64({kind} {bits})")
        return self.code.let(f"bitcast i64 {bits} to double")


def _larger(code: IRBuilder, x: str, y: str) -> str:
    """Return the larger of two; y where one is NaN."""
    return code.choose(code.compare("ogt", x, y), x, y)
