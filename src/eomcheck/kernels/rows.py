"""Factors and right-hand sides as rows of doubles in memory, and what substitution does with them.

Any size that is told when they run: rows are gone through by whole vectors, for which there is
room behind each.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from eomcheck.kernels.code import LANES, Code


class Rows:
    """Rows of doubles in memory, `stride` apart, each with room for a vector behind it."""

    def __init__(self, code: Code, pointer: str, stride: str, columns: str):
        self.code, self.pointer, self.stride, self.columns = code, pointer, stride, columns

    def place(self, i: str, j: int | str = 0) -> str:
        """Return the address of entry (i, j)."""
        row = self.code.integer("mul", i, self.stride)
        return self.code.at(self.pointer, row if j == 0 else self.code.integer("add", row, j))

    def subtract(self, i: str, factor: str, j: str) -> None:
        """Take `factor` times row j off row i."""
        subtract(self.code, self.columns, self.place(i), factor, self.place(j))


def subtract(code: Code, count: str, to: str, factor: str, row: str) -> None:
    """Take `factor` times `count` doubles at `row` off those at `to`."""
    code.do(f"call void @subtract(i64 {count}, ptr {to}, double {factor}, ptr {row})")


def _subtract_text() -> str:
    """Return what takes `factor` times a row off another, by whole vectors."""
    code = Code()
    wide = code.wider(LANES)
    factor = wide.packed(["%factor"])
    vectors = code.integer("udiv", code.integer("add", "%count", LANES - 1), LANES)
    with each_from(code, 0, vectors) as i:
        first = code.integer("mul", i, LANES)
        to, row = code.at("%to", first), code.at("%row", first)
        wide.store(wide.sub(wide.load(to), wide.mul(factor, wide.load(row))), to)
    return code.function("define void @subtract(i64 %count, ptr %to, double %factor, ptr %row)")


@contextmanager
def each_from(code: Code, first: int | str, last: str) -> Iterator[str]:
    """Do what is written inside for i = first, ..., last - 1, if there is any."""
    count = code.integer("sub", last, first)
    with code.when(code.let(f"icmp sgt i64 {count}, 0")), code.loop(count) as turn:
        yield code.integer("add", turn.i, first)


@contextmanager
def downwards(code: Code, count: str) -> Iterator[str]:
    """Do what is written inside for i = count - 1, ..., 0; there is one at least."""
    with code.loop(count) as turn:
        yield code.integer("sub", code.integer("sub", count, 1), turn.i)


FACTORED = "i64 %size, i64 %many, ptr %factors, i64 %stride, ptr %x"
"""Factors of a matrix, row by row, and right-hand sides or solutions, rows as after elimination."""


def _of_factors() -> tuple[Code, Rows, Rows]:
    code = Code()
    behind = code.integer("add", "%many", LANES)
    return (
        code,
        Rows(code, "%factors", "%stride", "%size"),
        Rows(code, "%x", behind, "%many"),
    )


def _forward_text() -> str:
    """Return what makes L⁻¹ x of x."""
    code, factors, x = _of_factors()
    with each_from(code, 0, "%size") as i, each_from(code, 0, i) as j:
        x.subtract(i, code.load(factors.place(i, j)), j)
    return code.function(f"define void @forward({FACTORED})")


def _backward_text() -> str:
    """Return what makes U⁻¹ x of x."""
    code, factors, x = _of_factors()
    with downwards(code, "%size") as i:
        with each_from(code, code.integer("add", i, 1), "%size") as j:
            x.subtract(i, code.load(factors.place(i, j)), j)
        diagonal = code.load(factors.place(i, i))
        with each_from(code, 0, "%many") as k:
            here = x.place(i, k)
            code.store(code.div(code.load(here), diagonal), here)
    return code.function(f"define void @backward({FACTORED})")


def _sizes_text() -> str:
    """Return what makes |L||U| x of x >= 0."""
    code, factors, x = _of_factors()

    def minus_size(i: str, j: str) -> str:
        return code.neg(code.call("fabs", code.load(factors.place(i, j))))

    with each_from(code, 0, "%size") as i:
        diagonal = code.call("fabs", code.load(factors.place(i, i)))
        with each_from(code, 0, "%many") as k:
            here = x.place(i, k)
            code.store(code.mul(code.load(here), diagonal), here)
        with each_from(code, code.integer("add", i, 1), "%size") as j:
            x.subtract(i, minus_size(i, j), j)
    with downwards(code, "%size") as i, each_from(code, 0, i) as j:
        x.subtract(i, minus_size(i, j), j)
    return code.function(f"define void @sizes({FACTORED})")


def texts() -> tuple[str, ...]:
    """Return the functions that code calls which uses rows."""
    return _subtract_text(), _forward_text(), _backward_text(), _sizes_text()
