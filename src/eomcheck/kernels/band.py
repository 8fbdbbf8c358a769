"""Band solves in machine code: `eomcheck.numbers.banded`, eight rows at once.

The matrix stands diagonal by diagonal, so that rows lie side by side in a vector: they are scaled,
and their residuals found, eight at a time. What waits for one row after the other is done from both
ends (`eomcheck.kernels.band_ends`). All is by the law of `eomcheck.numbers.pivots`; where that
refuses, x is NaN.

Of a long chain the time goes into reading and writing memory. So x is refined once without looking
how good it was before: what is written then is the residual alone. Only where it is not good enough
afterwards, all steps are made again, each one judged by the one before.
"""

from __future__ import annotations

from eomcheck.kernels import band_ends
from eomcheck.kernels.band_ends import HALF, WIDTH, BothEnds, minus, padded, plus
from eomcheck.kernels.code import LANES, Code
from eomcheck.kernels.dense import scale_of
from eomcheck.numbers.pivots import (
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    SMALLEST_SIZE,
    STALLED,
)


def room(size: int) -> int:
    """Return how many doubles the work of a solve takes."""
    return 10 * padded(size) + 2 * LANES + 2 + band_ends.room(size)


def band_text(name: str, size: int, stride: int) -> str:
    """Return the function (diagonals, x, room) for a matrix of `size` rows.

    Entries of the diagonals (8, padded size), of which the last is the right-hand side, and those
    of x are `stride` doubles apart. Numbers of other rows are scaled where they stand.
    """
    code = Code()
    solve = _Solve(code, size, stride)
    solve.ends.eliminate(solve.scale)
    solve.found(new=True)
    for _ in range(LEAST_STEPS):
        solve.refine()
    beta = solve.backward_error()
    # Anything but a finite number ends it: what overflows is told by x itself.
    with code.when(code.compare("ogt", beta, code.constant(REFINED))):
        solve.refine_step_by_step()
    clear = code.load(solve.zero)
    with code.loop(size) as turn:
        place = turn.i if stride == 1 else code.integer("mul", turn.i, stride)
        code.store(code.add(code.load(solve.x, turn.i), clear), "%x", place)
    given = "ptr noalias %rows, ptr noalias %x, ptr noalias %room"
    return code.function(f"define internal void @{name}({given}) nounwind")


class _Solve:
    """The parts of a solve, and where its numbers stand.

    Attributes:
        x: address of x, zeros before and behind it, so that any row can be multiplied by it.
        zero: address of what is added to x at last: NaN unless x is finite and good enough.
    """

    def __init__(self, code: Code, size: int, stride: int):
        self.code, self.length = code, padded(size)
        self.rows = code.wider(LANES)
        at = 0

        def taken(count: int) -> str:
            nonlocal at
            at += count
            return code.at("%room", at - count)

        self.given = [code.at("%rows", j * self.length * stride) for j in range(WIDTH + 1)]
        scaled = [taken(self.length) for _ in self.given] if stride > 1 else self.given
        *self.diagonals, self.right = scaled
        self.residual = taken(self.length)
        self.x = code.at(taken(self.length + 2 * LANES), LANES)
        self.beta, self.zero = taken(1), taken(1)
        place = taken(0)
        self.ends = BothEnds(code, size, self.diagonals, self.right, self.residual, place)
        self.stride = stride
        for i in (-LANES, size):
            self.rows.store("zeroinitializer", code.at(self.x, i))

    def scale(self, at: str) -> None:
        """Scale eight rows: where they stand, or in the room what is not side by side."""
        code, rows = self.code, self.rows
        entries = []
        for numbers in self.given:
            if self.stride == 1:
                entries.append(rows.load(code.at(numbers, at)))
                continue
            places = [code.integer("add", at, lane) for lane in range(LANES)]
            places = [code.integer("mul", place, self.stride) for place in places]
            entries.append(rows.packed([code.load(numbers, place) for place in places]))
        largest = rows.call("fabs", entries[0])
        for entry in entries[1:WIDTH]:
            largest = _larger(rows, rows.call("fabs", entry), largest)
        scale = scale_of(rows, largest)
        for entry, to in zip(entries, [*self.diagonals, self.right], strict=True):
            rows.store(rows.mul(entry, scale), code.at(to, at))

    # ---- Refinement ------------------------------------------------------------------------------

    def found(self, *, new: bool) -> None:
        """Find unknowns of what elimination has made: x itself, or what is to be added to it."""
        code = self.code

        def keep(i: str, y: str) -> None:
            code.store(y if new else code.add(code.load(self.x, i), y), self.x, i)

        self.ends.substitute(keep)

    def refine(self) -> None:
        """Make one step of refinement."""

        def write(at: str) -> None:
            self.rows.store(self._residual(at, sizes=False)[0], self.code.at(self.residual, at))

        self.ends.forward(write)
        self.found(new=False)

    def refine_step_by_step(self) -> None:
        """Begin again, and refine as long as each step halves the backward error."""
        code, rows = self.code, self.rows

        def write(at: str) -> None:
            rows.store(rows.load(code.at(self.right, at)), code.at(self.residual, at))

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
            turn.handed = [beta, code.integer("add", steps, 1)]
            turn.i = more
        with code.when(failed):
            code.store(code.constant(float("nan")), self.zero)

    # ---- Residual --------------------------------------------------------------------------------

    def _residual(self, at: str, *, sizes: bool = True) -> tuple[str, str]:
        """Return b - A x and, with `sizes`, |A||x| + |b| of eight rows."""
        code, rows = self.code, self.rows
        left = rows.load(code.at(self.right, at))
        whole = rows.call("fabs", left) if sizes else ""
        for j in range(WIDTH):
            entry = rows.load(code.at(self.diagonals[j], at))
            x = rows.load(code.at(self.x, code.integer("add", at, j - HALF)))
            left = minus(rows, left, entry, x)
            if sizes:
                whole = plus(rows, whole, *(rows.call("fabs", y) for y in (entry, x)))
        return left, whole

    def backward_error(self) -> str:
        """Return the backward error β; `REFINED` if it is less.

        Also written is 0 times the residual: NaN unless x, and all that it was made of, is finite.
        """
        code, rows = self.code, self.rows
        nothing = (rows.real, rows.constant(0.0))
        count = self.length // LANES
        with code.loop(count, nothing, nothing, nothing) as turn:
            left, whole = self._residual(code.integer("mul", turn.i, LANES))
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
                left, whole = self._residual(code.integer("mul", turn.i, LANES))
                share = rows.div(rows.call("fabs", left), _larger(rows, whole, least))
                turn.handed[0] = _larger(rows, share, turn.carried[0])
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
