"""Band solves in machine code: `eomcheck.numbers.banded`, eight rows at once, from both ends.

The matrix stands diagonal by diagonal, so that rows lie side by side in a vector: they are scaled,
and their residuals found, eight at a time. Elimination waits for one column after the other. So it
works from both ends at once, the end as if it were the beginning, and what is left in the middle
is solved in registers. All is by the law of `eomcheck.numbers.pivots`; where that refuses, x is
NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from eomcheck.kernels import machine
from eomcheck.kernels.code import LANES, Code
from eomcheck.kernels.dense import Inline, scale_of
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
    from_both_ends,
)

HALF, WIDTH = 3, 7
"""Entries on each side of the diagonal, and in a row."""

OPEN = HALF + 1
"""Rows that have an entry in a column while it is eliminated."""

ENDS = 2

ROW = (WIDTH - 1) * ENDS
"""Doubles that are kept of two rows of U, one of each end, side by side: entries behind the pivot,
divided by it."""


def padded(size: int) -> int:
    """Return the length of a diagonal, or of a right-hand side, in memory: whole vectors."""
    return -(-size // LANES) * LANES


def steps_of(size: int) -> int:
    """Return how many columns are eliminated from each end: 6 or 7 are left, or all."""
    return max((size - 2 * HALF) // 2, 0)


def room(size: int) -> int:
    """Return how many doubles the work of a solve takes."""
    return 11 * padded(size) + 2 * LANES + 2 + steps_of(size) * (ROW + ENDS * (OPEN + 3))


class _End(NamedTuple):
    """One of the ends: its number, its first row, and the way to the next."""

    number: int
    first: int
    way: int

    def entry(self, j: int) -> int:
        """Return the diagonal of what is entry j of a row, seen from this end."""
        return j if self.way > 0 else WIDTH - 1 - j

    def row(self, code: Code, i: str) -> str:
        """Return the place of the row that is i rows from this end."""
        return code.integer("add" if self.way > 0 else "sub", self.first, i)


def band_text(name: str, size: int, stride: int) -> str:
    """Return the function (diagonals, x, room) for a matrix of `size` rows.

    Entries of the diagonals (8, padded size), of which the last is the right-hand side, and those
    of x are `stride` doubles apart. Numbers of other rows are scaled where they stand.
    """
    code = Code()
    solve = _Solve(code, size, stride)
    solve.eliminate()
    solve.substitute(lambda i, y: code.store(y, solve.x, i))

    # Refinement.
    state = (("double", code.constant(float("inf"))), ("i64", "0"))
    with code.repeat(*state) as turn:
        before, steps = turn.carried
        beta = solve.backward_error()
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
            solve.forward()
            solve.substitute(
                lambda i, y: code.store(code.add(code.load(solve.x, i), y), solve.x, i)
            )
        turn.handed = [beta, code.integer("add", steps, 1)]
        turn.i = more
    clear = code.choose(failed, code.constant(float("nan")), code.load(solve.zero))
    with code.loop(size) as turn:
        place = turn.i if stride == 1 else code.integer("mul", turn.i, stride)
        code.store(code.add(code.load(solve.x, turn.i), clear), "%x", place)
    given = "ptr noalias %rows, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({given}) nounwind")


class _Solve:
    """The parts of a solve, and where its numbers stand.

    Attributes:
        x: address of x, zeros before and behind it, so that any row can be multiplied by it.
    """

    def __init__(self, code: Code, size: int, stride: int):
        self.code, self.size, self.length, self.steps = code, size, padded(size), steps_of(size)
        self.rows, self.open, self.pair = (code.wider(k) for k in (LANES, OPEN, ENDS))
        self.ends = [_End(0, 0, 1), _End(1, size - 1, -1)]
        self.lanes = f"<{', '.join(f'i64 {i}' for i in range(OPEN))}>"
        self.middle = from_both_ends(size)[2 * self.steps :].tolist()
        at = 0

        def taken(count: int) -> str:
            nonlocal at
            at += count
            return code.at("%room", at - count)

        def steps(count: int) -> str:
            return taken(self.steps * ENDS * count)

        self.given = [code.at("%rows", j * self.length * stride) for j in range(WIDTH + 1)]
        scaled = [taken(self.length) for _ in self.given] if stride > 1 else self.given
        *self.diagonals, self.right = scaled
        self.residual, self.sizes = taken(self.length), taken(self.length)
        self.x = code.at(taken(self.length + 2 * LANES), LANES)
        self.upper, self.factors = steps(ROW // ENDS), steps(OPEN)
        self.inverses, self.which, self.reduced = steps(1), steps(1), steps(1)
        self.beta, self.zero = taken(1), taken(1)
        self._scale(stride)

    def _scale(self, stride: int) -> None:
        """Scale rows: where they stand, or in the room what is not side by side."""
        code, rows = self.code, self.rows
        with code.loop(self.length // LANES) as turn:
            at = code.integer("mul", turn.i, LANES)
            entries = []
            for numbers in self.given:
                if stride == 1:
                    entries.append(rows.load(code.at(numbers, at)))
                    continue
                places = [code.integer("add", at, lane) for lane in range(LANES)]
                places = [code.integer("mul", place, stride) for place in places]
                entries.append(rows.packed([code.load(numbers, place) for place in places]))
            largest = rows.call("fabs", entries[0])
            for entry in entries[1:WIDTH]:
                largest = _larger(rows, rows.call("fabs", entry), largest)
            scale = scale_of(rows, largest)
            for entry, to in zip(entries, [*self.diagonals, self.right], strict=True):
                rows.store(rows.mul(entry, scale), code.at(to, at))
        for i in (-LANES, self.size):
            rows.store("zeroinitializer", code.at(self.x, i))

    # ---- Elimination -----------------------------------------------------------------------------

    def eliminate(self) -> None:
        """Write factors, and what becomes of the right-hand side."""
        code, wide, kind = self.code, self.open, self.open.real
        state: list[tuple[str, str]] = []
        for end in self.ends if self.steps else ():
            state += [(kind, self._first_rows(end, j)) for j in range(WIDTH - 1)]
            state.append((kind, self._begun(end, self.right)))
            state.append((wide.like("i64"), wide.splat_of(f"i64 {HALF}")))
        count = WIDTH + 1
        A, b = [], []
        if self.steps:
            with code.loop(self.steps, *state) as turn:
                turn.handed = self._step(turn.i, turn.carried)
            for end in self.ends:
                here = slice(end.number * count, (end.number + 1) * count)
                *columns, which = turn.carried[here]
                *columns, right = (self._closed(x, which) for x in columns)
                places = self._ahead(end)
                for lane in range(HALF):
                    row = dict(zip(places, (wide.lane(x, lane) for x in columns), strict=True))
                    A.append([row.get(j, code.constant(0.0)) for j in self.middle])
                    b.append(wide.lane(right, lane))
        for i in self._between():
            A.append([self._entry(i, j) for j in self.middle])
            b.append(code.load(self.right, i))
        self.dense = Inline(code, A, scaled=True)
        self.found = self.dense.solve(b)

    def _entry(self, i: int, j: int) -> str:
        """Return entry (i, j) of the matrix."""
        if abs(i - j) > HALF:
            return self.code.constant(0.0)
        return self.code.load(self.diagonals[HALF + j - i], i)

    def _ahead(self, end: _End) -> list[int]:
        """Return the columns that an end has reached and not eliminated."""
        return [end.first + end.way * (self.steps + j) for j in range(2 * HALF)]

    def _between(self) -> range:
        """Return the rows in the middle that neither end has begun with."""
        reached = self.steps + HALF if self.steps else 0
        return range(reached, self.size - reached)

    def _first_rows(self, end: _End, j: int) -> str:
        """Return what an end begins with in its column j: three rows."""
        rows = [end.first + end.way * i for i in range(HALF)]
        entries = [self._entry(i, end.first + end.way * j) for i in rows]
        return self.open.packed([*entries, self.code.constant(0.0)])

    def _begun(self, end: _End, numbers: str) -> str:
        """Return the numbers of the first three rows of an end."""
        first = [self.code.load(numbers, end.first + end.way * i) for i in range(HALF)]
        return self.open.packed([*first, self.code.constant(0.0)])

    def _at(self, which: str) -> str:
        """Return where the row `which`, in all lanes, is the lane's own."""
        return self.open.let(f"icmp eq {self.open.like('i64')} {which}, {self.lanes}")

    def _closed(self, x: str, which: str) -> str:
        """Return numbers of rows, that of the last in the place of the row that was the pivot."""
        last = self.open.packed([self.open.lane(x, HALF)])
        return self.open.choose(self._at(which), last, x)

    def _step(self, i: str, carried: Sequence[str]) -> list[str]:
        """Eliminate a column of each end; its pivot row makes room for the next one.

        Operations on both ends alternate, so that neither waits behind the other.
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
            # Of all four, as long as it is not known which one is needed.
            inverses = wide.div(wide.constant(1.0), window[0])
            inverse = self._picked(wide.call("arithmetic.fence", inverses), which)
            chosen.append((which, inverse, wide.mul(window[0], inverse)))
        handed: list[list[str]] = [[] for _ in self.ends]
        row, at = code.integer("mul", i, ROW), code.integer("mul", i, ENDS)
        for j in range(1, WIDTH + 1):
            for end in self.ends:
                x, (which, inverse, factors) = windows[end.number][j], chosen[end.number]
                pivot = self._picked(x, which)
                handed[end.number].append(_minus(wide, x, factors, pivot))
                entry = code.mul(wide.lane(pivot, 0), wide.lane(inverse, 0))
                if j < WIDTH:
                    place = code.integer("add", row, ENDS * (j - 1) + end.number)
                    code.store(entry, self.upper, place)
                else:
                    code.store(entry, self.reduced, code.integer("add", at, end.number))
        for end, (which, inverse, factors) in zip(self.ends, chosen, strict=True):
            place = code.integer("add", at, end.number)
            code.store(wide.lane(inverse, 0), self.inverses, place)
            wide.store(factors, code.at(self.factors, code.integer("mul", place, OPEN)))
            lane = code.let(f"extractelement {wide.like('i64')} {which}, i64 0")
            code.do(f"store i64 {lane}, ptr {code.at(self.which, place)}, align 8")
        pairs = zip(handed, chosen, strict=True)
        return [x for window, (which, *_) in pairs for x in (*window, which)]

    def _pivot(self, column: str) -> str:
        """Return which of four entries is the largest, in all lanes.

        Everything waits for it, so the leading 32 bits of each are compared, which is faster. Of
        these the last two tell which entry it is: of several that are so far equal, the last.
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
        """Return a row's number, in all lanes."""
        wide, kind = self.open, self.open.like("i64")
        places = [wide.let(f"extractelement {kind} {which}, i64 {i}") for i in range(OPEN)]
        picked = wide.packed([wide.lane(x, place) for place in places])
        return wide.call("arithmetic.fence", picked)

    def forward(self) -> None:
        """Write what elimination makes of the residual, and solve the middle."""
        code, wide, kind = self.code, self.open, self.open.like("i64")
        b = []
        if self.steps:
            state = [(wide.real, self._begun(end, self.residual)) for end in self.ends]
            state += [(kind, wide.splat_of(f"i64 {HALF}"))] * ENDS
            with code.loop(self.steps, *state) as turn:
                for end in self.ends:
                    x, which = turn.carried[end.number :: ENDS]
                    new = end.row(code, code.integer("add", turn.i, HALF))
                    new = wide.packed([code.load(self.residual, new)])
                    x = wide.choose(self._at(which), new, x)
                    at = code.integer("add", code.integer("mul", turn.i, ENDS), end.number)
                    place = code.let(f"load i64, ptr {code.at(self.which, at)}, align 8")
                    which = "poison"
                    for i in range(OPEN):
                        which = wide.let(f"insertelement {kind} {which}, i64 {place}, i64 {i}")
                    pivot = self._picked(x, which)
                    factors = code.at(self.factors, code.integer("mul", at, OPEN))
                    entry = code.mul(wide.lane(pivot, 0), code.load(self.inverses, at))
                    code.store(entry, self.reduced, at)
                    turn.handed[end.number :: ENDS] = [
                        _minus(wide, x, wide.load(factors), pivot),
                        which,
                    ]
            for end in self.ends:
                x = self._closed(*turn.carried[end.number :: ENDS])
                b += [wide.lane(x, lane) for lane in range(HALF)]
        b += [code.load(self.residual, i) for i in self._between()]
        self.found = self.dense.solve(b)

    def substitute(self, keep: Callable[[str, str], None]) -> None:
        """Find unknowns from the middle to both ends; `keep` is handed places and unknowns."""
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
            y = pair.load(code.at(self.reduced, code.integer("mul", i, ENDS)))
            # The unknown found just before comes last: the others need not wait for it.
            for j in range(2 * HALF, 0, -1):
                entries = pair.load(code.at(self.upper, code.integer("add", at, ENDS * (j - 1))))
                y = _minus(pair, y, entries, turn.carried[j - 1])
            for end in self.ends:
                keep(end.row(code, i), pair.lane(y, end.number))
            turn.handed = [y, *turn.carried[:-1]]

    # ---- Residual --------------------------------------------------------------------------------

    def backward_error(self) -> str:
        """Write b - A x, and return the backward error β; `REFINED` if it is less.

        Also written is 0 times the residual: NaN unless x, and all that it was made of, is finite.
        """
        code, rows = self.code, self.rows
        nothing = (rows.real, rows.constant(0.0))
        count = self.length // LANES
        with code.loop(count, nothing, nothing, nothing) as turn:
            at = code.integer("mul", turn.i, LANES)
            left = rows.load(code.at(self.right, at))
            whole = rows.call("fabs", left)
            for j in range(WIDTH):
                entry = rows.load(code.at(self.diagonals[j], at))
                x = rows.load(code.at(self.x, code.integer("add", at, j - HALF)))
                left = _minus(rows, left, entry, x)
                whole = _plus(rows, whole, *(rows.call("fabs", y) for y in (entry, x)))
            rows.store(left, code.at(self.residual, at))
            rows.store(whole, code.at(self.sizes, at))
            above = rows.mul(whole, rows.constant(REFINED))
            above = rows.sub(rows.call("fabs", left), above)
            turn.handed = [
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
        # Most often no row is above, and nothing needs to be divided.
        with code.when(code.compare("ogt", self._largest(above), code.constant(0.0))):
            least = code.mul(self._largest(sizes), code.constant(SMALLEST_SHARE))
            least = rows.packed([_larger(code, least, code.constant(SMALLEST_SIZE))])
            with code.loop(count, nothing) as turn:
                at = code.integer("mul", turn.i, LANES)
                whole = _larger(rows, rows.load(code.at(self.sizes, at)), least)
                left = rows.call("fabs", rows.load(code.at(self.residual, at)))
                turn.handed[0] = _larger(rows, rows.div(left, whole), turn.carried[0])
            code.store(self._largest(turn.carried[0]), self.beta)
        return code.load(self.beta)

    def _largest(self, x: str) -> str:
        """Return the largest number of a vector."""
        largest = self.rows.lane(x, 0)
        for lane in range(1, LANES):
            largest = _larger(self.code, self.rows.lane(x, lane), largest)
        return largest


def _larger(code: Code, x: str, y: str) -> str:
    """Return the larger of two; y where one is NaN."""
    return code.choose(code.compare("ogt", x, y), x, y)


def _plus(code: Code, x: str, y: str, z: str) -> str:
    """Return x + y z, rounded once where the machine can."""
    if machine.features()[2]:
        return code.call("fma", y, z, x)
    return code.add(x, code.mul(y, z))


def _minus(code: Code, x: str, y: str, z: str) -> str:
    """Return x - y z, rounded once where the machine can."""
    return _plus(code, x, code.neg(y), z)
