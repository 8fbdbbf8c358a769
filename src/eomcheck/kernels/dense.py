"""Dense linear solves in machine code: rows scaled, partial pivoting, no branch, no exception.

Scales and pivots follow `eomcheck.numbers.pivots`. Small matrices are eliminated in registers,
with rows exchanged by select instructions; larger ones in memory by LAPACK (`dgetrf`, `dgetrs`),
lane by lane. If a pivot is 0 or not finite, x is NaN.
"""

from __future__ import annotations

import ctypes
from functools import cache, reduce

from eomcheck.kernels.llvm import FINITE_NOT_ZERO, LANES, IRBuilder
from eomcheck.numbers.pivots import ABOVE_ONE, LARGEST_EXPONENT

ONE, EXPONENT = 1023, 52
"""Biased exponent of 1 in the bits of a float64, and the position of its lowest bit."""


def emit_power_of_two_scale(code: IRBuilder, largest: str) -> str:
    """Return the powers of two of `eomcheck.numbers.pivots.power_of_two_scale`, lane by lane."""
    kind = code.like("i64")

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
    return code.let(f"and {code.like('i64')} {bits}, {mask}")


def _bits(code: IRBuilder, x: str) -> str:
    return code.let(f"bitcast {code.real} {x} to {code.like('i64')}")


def _scaled(code: IRBuilder, x: str, exponent: str) -> str:
    """Return the bits of |x| in a scaled row, which are ordered as the numbers are."""
    return code.let(f"sub {code.like('i64')} {_bits(code, code.call('fabs', x))}, {exponent}")


def _larger(code: IRBuilder, one: str, other: str) -> str:
    return code.let(f"icmp sgt {code.like('i64')} {one}, {other}")


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
            larger = _larger(code, size, largest)
            where.append(larger)
            largest = self._whole(larger, size, largest)
        # The last entry that is larger than all before is the pivot.
        marks: list[str | None] = []
        later = None
        for mark in reversed(where):
            taken = mark
            if mark is not None:
                taken = mark if later is None else code.both(mark, self._not(later))
                later = mark if later is None else code.both(later, mark, "or")
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
        kind = self.code.like("i64")
        return self.code.let(f"select {self.code.like('i1')} {where}, {kind} {x}, {kind} {y}")

    def _not(self, where: str) -> str:
        kind = self.code.like("i1")
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
        bad = code.both(code.compare("ueq", pivot, code.constant(0.0)), large, "or")
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
