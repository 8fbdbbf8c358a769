"""Band solves in machine code: `eomcheck.numbers.banded`, a row to a register.

A row of the matrix, 7 entries from 3 places before the diagonal on, and its right-hand side fill
one vector. Rows are scaled, the largest of four entries becomes the pivot, and x is refined, all by
the law of `eomcheck.numbers.pivots`. Where that refuses, x is NaN.
"""

from __future__ import annotations

from eomcheck.kernels.code import Code
from eomcheck.kernels.dense import scale_of
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
)

ROW = 8
"""Doubles of a row: its entries and its right-hand side."""

FORWARD = 4
"""Doubles that elimination leaves of a column beside its row of U: three factors, and which row."""

V = "<8 x double>"
NEXT = "<i32 1, i32 2, i32 3, i32 4, i32 5, i32 6, i32 8, i32 7>"
"""A row as the next column sees it."""


def room(size: int) -> int:
    """Return how many doubles the work of a solve takes."""
    return (size + 8) * (2 * ROW + FORWARD + 1) + 4 * (size + 16)


def band_text(name: str, size: int, stride: int) -> str:
    """Return the function (rows, x, room) for a matrix of `size` rows of 8.

    Entries of the rows and of x are `stride` doubles apart.
    """
    code = Code()
    wide = code.wider(ROW)
    scaled = "%room"
    upper = code.at("%room", (size + 3) * ROW)
    forward = code.at(upper, (size + 8) * ROW)
    right = code.at(forward, (size + 8) * FORWARD)
    # x with room before and behind, so that a row can be multiplied at either end.
    x = code.at(right, size + 16 + 3)
    residual = code.at(x, size + 16)

    def row_at(place: str) -> str:
        return code.at("%room", code.integer("mul", place, ROW))

    # Rows scaled, and three of zeros behind them.
    with code.loop(size) as turn:
        if stride == 1:
            row = wide.load(code.at("%rows", code.integer("mul", turn.i, ROW)))
        else:
            first = code.integer("mul", turn.i, ROW * stride)
            places = [code.integer("add", first, j * stride) for j in range(ROW)]
            row = wide.packed([code.load("%rows", place) for place in places])
        wide.store(wide.mul(row, _scale(code, wide, row)), row_at(turn.i))
    for i in range(3):
        wide.store("zeroinitializer", code.at(scaled, (size + i) * ROW))
    for i in range(3):
        code.store(code.constant(0.0), x, i - 3)
    for i in range(5):
        code.store(code.constant(0.0), x, size + i)

    regular = _eliminate(code, wide, size, scaled, upper, forward, right)
    _substitute(code, size, upper, right, lambda i, y: code.store(y, x, i))

    # Refinement.
    state = (("double", code.constant(float("inf"))), ("i64", "0"))
    with code.repeat(*state) as turn:
        before, steps = turn.carried
        beta = _residual(code, wide, size, scaled, x, residual)
        # Anything but a finite number ends it: what overflows is told by x itself.
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
            _forward(code, size, forward, residual, right)
            _substitute(
                code,
                size,
                upper,
                right,
                lambda i, y: code.store(code.add(code.load(x, i), y), x, i),
            )
        turn.handed = [beta, code.integer("add", steps, 1)]
        turn.i = more
    good = code.both(regular, code.let(f"xor i1 {failed}, true"))
    clear = code.choose(good, code.constant(0.0), code.constant(float("nan")))
    with code.loop(size) as turn:
        place = turn.i if stride == 1 else code.integer("mul", turn.i, stride)
        code.store(code.add(code.load(x, turn.i), clear), "%x", place)
    given = "ptr noalias %rows, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({given}) nounwind")


def _scale(code: Code, wide: Code, row: str) -> str:
    """Return the scale of a row, in all places."""
    sizes = wide.call("fabs", row)
    entries = wide.let(f"insertelement {V} {sizes}, double {code.constant(0.0)}, i64 7")
    largest = _folded(code, wide, entries, lambda half, x, y: half.call("maxnum", x, y))
    return wide.packed([scale_of(code, largest)])


def _folded(code: Code, wide: Code, x: str, how) -> str:
    """Return what the 8 entries of x make together, halves first."""
    width = ROW
    while width > 1:
        half = code.wider(width // 2)
        real = f"<{width} x double>"
        parts = []
        for first in (0, width // 2):
            if width == 2:
                parts.append(code.let(f"extractelement {real} {x}, i64 {first}"))
                continue
            order = ", ".join(f"i32 {first + i}" for i in range(width // 2))
            mask = f"<{width // 2} x i32> <{order}>"
            parts.append(code.let(f"shufflevector {real} {x}, {real} poison, {mask}"))
        x = how(half, *parts)
        width //= 2
    return x


def _shifted(wide: Code, row: str, mask: str) -> str:
    return wide.let(f"shufflevector {V} {row}, {V} zeroinitializer, <8 x i32> {mask}")


def _eliminate(
    code: Code, wide: Code, size: int, scaled: str, upper: str, forward: str, right: str
) -> str:
    """Write U with its right-hand side, the factors and the choices; return whether all is regular.

    Four rows have an entry in a column: three that are left from before, and a new one.
    """
    kept = []
    for i in range(3):
        order = [*range(3 - i, 7), *[8] * (3 - i), 7]
        row = wide.load(code.at(scaled, i * ROW))
        kept.append(_shifted(wide, row, f"<{', '.join(f'i32 {j}' for j in order)}>"))
    kind, all_true = wide.like("i1"), f"<{', '.join(['i1 true'] * ROW)}>"

    def opposite(where: str) -> str:
        return wide.let(f"xor {kind} {where}, {all_true}")

    def everywhere(row: str) -> str:
        """Return a row's entry in the column, in all places: choices are made without a branch."""
        return wide.let(f"shufflevector {V} {row}, {V} poison, <8 x i32> zeroinitializer")

    with code.loop(size, *((V, row) for row in kept), (V, "zeroinitializer")) as turn:
        new = wide.load(code.at(scaled, code.integer("mul", code.integer("add", turn.i, 3), ROW)))
        rows = [*turn.carried[:3], new]
        heads = [everywhere(row) for row in rows]
        sizes = [wide.call("fabs", head) for head in heads]
        second = wide.compare("ogt", sizes[1], sizes[0])
        fourth = wide.compare("ogt", sizes[3], sizes[2])
        front = wide.choose(second, sizes[1], sizes[0])
        back = wide.choose(fourth, sizes[3], sizes[2])
        behind = wide.compare("ogt", back, front)

        def among(x: list[str]) -> str:
            ahead, after = wide.choose(second, x[1], x[0]), wide.choose(fourth, x[3], x[2])
            return wide.choose(behind, after, ahead)

        pivot, head = among(rows), among(heads)
        # 0 while every pivot is a finite number other than 0.
        large = wide.compare("ueq", wide.call("fabs", head), wide.constant(float("inf")))
        wrong = wide.both(wide.compare("ueq", head, wide.constant(0.0)), large, "or")
        turn.handed[3] = wide.choose(wrong, wide.constant(1.0), turn.carried[3])
        single = wide.lane(head, 0)
        ahead = opposite(behind)
        taken = [wide.both(ahead, opposite(second)), wide.both(ahead, second)]
        taken.append(wide.both(behind, opposite(fourth)))
        at = code.integer("mul", turn.i, FORWARD)
        which = wide.constant(3.0)
        for place in range(3):
            row = wide.choose(taken[place], new, rows[place])
            first = wide.lane(wide.choose(taken[place], heads[3], heads[place]), 0)
            factor = code.div(first, single)
            step = wide.mul(wide.packed([factor]), pivot)
            turn.handed[place] = _shifted(wide, wide.sub(row, step), NEXT)
            code.store(factor, forward, code.integer("add", at, place) if place else at)
            which = wide.choose(taken[place], wide.constant(float(place)), which)
        reciprocal = code.div(code.constant(1.0), single)
        kept_row = wide.let(f"insertelement {V} {pivot}, double {reciprocal}, i64 0")
        wide.store(kept_row, code.at(upper, code.integer("mul", turn.i, ROW)))
        code.store(wide.lane(pivot, 7), right, turn.i)
        code.store(wide.lane(which, 0), forward, code.integer("add", at, 3))
    wrong = wide.lane(turn.carried[3], 0)
    return code.compare("oeq", wrong, code.constant(0.0))


def _forward(code: Code, size: int, forward: str, residual: str, right: str) -> None:
    """Write to `right` what elimination makes of the residual."""
    kept = [
        ("double", code.load(residual, i) if i < size else code.constant(0.0)) for i in range(3)
    ]
    with code.loop(size, *kept) as turn:
        new = code.load(residual, code.integer("add", turn.i, 3))
        at = code.integer("mul", turn.i, FORWARD)
        which = code.load(forward, code.integer("add", at, 3))
        pivot, taken = new, []
        for place in range(3):
            taken.append(code.compare("oeq", which, code.constant(float(place))))
            pivot = code.choose(taken[place], turn.carried[place], pivot)
        code.store(pivot, right, turn.i)
        for place in range(3):
            row = code.choose(taken[place], new, turn.carried[place])
            factor = code.load(forward, code.integer("add", at, place) if place else at)
            turn.handed[place] = code.sub(row, code.mul(factor, pivot))


def _substitute(code: Code, size: int, upper: str, right: str, keep) -> None:
    """Solve U y = right, from the last unknown to the first; `keep` is handed each."""
    zero = ("double", code.constant(0.0))
    with code.loop(size, *[zero] * 6) as turn:
        i = code.integer("sub", size - 1, turn.i)
        at = code.integer("mul", i, ROW)
        total = code.load(right, i)
        # The unknown found just before comes last, so that the others need not wait for it.
        for j in range(6, 0, -1):
            entry = code.load(upper, code.integer("add", at, j))
            total = code.sub(total, code.mul(entry, turn.carried[j - 1]))
        y = code.mul(total, code.load(upper, at))
        keep(i, y)
        turn.handed = [y, *turn.carried[:5]]


def _residual(code: Code, wide: Code, size: int, scaled: str, x: str, residual: str) -> str:
    """Write b - A x to `residual`, zeros behind it, and return the backward error β."""
    for i in range(ROW):
        code.store(code.constant(0.0), residual, size + i)
    minus, zero = code.constant(-1.0), ("double", code.constant(0.0))
    sizes = code.at(residual, size + 16)
    with code.loop(size, zero) as turn:
        row = wide.load(code.at(scaled, code.integer("mul", turn.i, ROW)))
        near = wide.load(code.at(x, code.integer("sub", turn.i, 3)))
        near = wide.let(f"insertelement {V} {near}, double {minus}, i64 7")
        terms = wide.mul(row, near)
        left = code.neg(_folded(code, wide, terms, lambda half, a, b: half.add(a, b)))
        whole = _folded(code, wide, wide.call("fabs", terms), lambda half, a, b: half.add(a, b))
        code.store(left, residual, turn.i)
        code.store(whole, sizes, turn.i)
        turn.handed[0] = code.call("maxnum", turn.carried[0], whole)
    least = code.mul(turn.carried[0], code.constant(SMALLEST_SHARE))
    least = code.call("maxnum", least, code.constant(SMALLEST_SIZE))
    # Behind the last row stand residuals of 0, which add nothing.
    spread = wide.packed([least])
    with code.loop(-(-size // ROW), (V, "zeroinitializer")) as turn:
        at = code.integer("mul", turn.i, ROW)
        whole = wide.call("maxnum", wide.load(code.at(sizes, at)), spread)
        share = wide.div(wide.call("fabs", wide.load(code.at(residual, at))), whole)
        turn.handed[0] = wide.call("maxnum", share, turn.carried[0])
    return _folded(code, wide, turn.carried[0], lambda half, a, b: half.call("maxnum", a, b))
