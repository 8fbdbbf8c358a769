"""The integrator DOP853 in machine code, for a batch of motions with separate steps and errors.

DOP853 is Dormand and Prince's pair of order 8(5,3) with its continuous extension (Hairer, Norsett,
Wanner 1993); coefficients and step-size control are SciPy's. Each motion is a lane, with its own
time and step size. Powers of -1/8 are three square roots, which no library rounds differently. A
motion that has reached its end goes on by steps of 0.

One function for each number of lanes serves right-hand sides of any size.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from functools import cache
from typing import Any

from scipy.integrate import DOP853

from eomcheck.kernels.llvm import IRBuilder, JitModule

RUNNING, FINISHED, TOO_SMALL, TOO_MANY, NOT_FINITE = range(5)
"""Status of a lane: running; at its end; no step is small enough; too many steps; the right-hand
side is not finite at the start."""

T, H, REJECTED, STATUS, STEPS, CALLS, NEXT, DUE, USED, REACH = range(10)
"""Rows of the record of the lanes: time, s; step to try, s; whether the last step was rejected;
status; accepted steps; evaluations of the right-hand side; number and time, s, of the next output;
step tried last, s; time up to which outputs can be interpolated, s."""
FIELDS = 10

STAGES = DOP853.n_stages
RATES = STAGES + 1 + len(DOP853.C_EXTRA)
STAGE, NEW, CURVE = RATES, RATES + 1, RATES + 2
"""Rows of the workspace: state of a stage, state after the step, interpolant."""
ROWS = CURVE + 3 + len(DOP853.D)
"""Number of rows of the workspace, (size, lanes) each."""

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
SMALLEST = 10
"""Smallest step, in ulps of the time."""


@cache
def dop853(width: int) -> Any:
    """Return the C function of the integrator for `width` lanes.

    Its arguments: address of a kernel (for one lane: of its C function), the kernel's last
    argument, size of the state, y (size, lanes) in and out, the record (FIELDS, lanes), end, s,
    rtol, atol, largest number of steps, output times and infinity (k + 1,), s, outputs
    (k, size, lanes), workspace (ROWS, size, lanes).
    """
    machine = JitModule((_Writer(width).text(),))
    pointer, double = ctypes.c_size_t, ctypes.c_double
    kinds = *[pointer, pointer, ctypes.c_int64, pointer, pointer], *[double] * 4, *[pointer] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address("dop853"))
    function.machine = machine
    return function


class _Writer:
    """Writer of the function: `code` builds scalars common to all lanes, `wide` numbers by lane."""

    def __init__(self, width: int):
        self.code = IRBuilder()
        self.wide = self.code.wider(width)

    def text(self) -> str:
        code, wide = self.code, self.wide
        code.do(f"%time = alloca {wide.real}, align 64")
        size = code.let("sitofp i64 %size to double")
        scalars = "%end", "%rtol", "%atol", "%most", size
        self.end, self.rtol, self.atol, self.most, self.size = (wide.packed([x]) for x in scalars)
        rows = [code.integer("mul", "%size", i) for i in range(ROWS)]
        self.rows = [wide.address("%room", row) for row in rows]
        self._start()
        with code.repeat() as turn:
            self._step()
            running = wide.compare("oeq", self._field(STATUS), wide.constant(RUNNING))
            turn.condition = wide.anywhere(running)
        pointers = "ptr noalias %times, ptr noalias %out, ptr noalias %room"
        doubles = "double %end, double %rtol, double %atol, double %most"
        head = "ptr %function, ptr %block, i64 %size, ptr noalias %y, ptr noalias %lanes"
        return code.function(f"define void @dop853({head}, {doubles}, {pointers}) nounwind")

    # ---- Pieces ----------------------------------------------------------------------------------

    def _field(self, field: int) -> str:
        return self.wide.load("%lanes", field)

    def _keep(self, field: int, x: str) -> None:
        self.wide.store(x, "%lanes", field)

    def _rates(self, t: str, y: str, out: str) -> None:
        time = f"double {t}"
        if self.wide.width > 1:
            self.wide.store(t, "%time")
            time = "ptr %time"
        self.code.do(f"call void %function(ptr {out}, {time}, ptr {y}, ptr %block)")

    def _sum(self, i: str, factors: Iterable[float]) -> str:
        """Return the sum of entries i of the rates of the stages times `factors`."""
        total = ""
        for factor, row in zip(factors, self.rows, strict=False):
            if factor:
                x = self.wide.load(row, i), self.wide.constant(float(factor))
                total = self.wide.multiply_add(total, *x) if total else self.wide.mul(*x)
        return total

    def _stage(self, h: str, factors: Iterable[float], c: float, y: int, rates: int) -> None:
        """Write the state of a stage, at t + c h, and its rates."""
        wide = self.wide
        with self.code.loop("%size") as turn:
            y0 = wide.load("%y", turn.i)
            state = wide.multiply_add(y0, h, self._sum(turn.i, factors))
            wide.store(state, self.rows[y], turn.i)
        t = wide.add(self._field(T), wide.mul(h, wide.constant(float(c))))
        self._rates(t, self.rows[y], self.rows[rates])

    def _scale(self, size: str) -> str:
        """Return 1 over the allowed error of an entry of this size."""
        wide = self.wide
        allowed = wide.add(self.atol, wide.mul(self.rtol, size))
        return wide.div(wide.constant(1.0), allowed)

    def _square(self, x: str, y: str) -> str:
        return self.wide.mul(*[self.wide.mul(x, y)] * 2)

    def _norm(self, squares: str) -> str:
        return self.wide.call("sqrt", self.wide.div(squares, self.size))

    def _eighth(self, x: str) -> str:
        for _ in range(3):
            x = self.wide.call("sqrt", x)
        return x

    def _extreme(self, how: str, x: str, y: str) -> str:
        """Return the smaller (olt) or larger (ogt) of x and y; y where x is NaN."""
        return self.wide.choose(self.wide.compare(how, x, y), x, y)

    # ---- The first step --------------------------------------------------------------------------

    def _start(self) -> None:
        """Write the rates at the start and the first step to try."""
        code, wide = self.code, self.wide
        zero, first = wide.constant(0.0), self.rows[0]
        self._rates(self._field(T), "%y", first)
        with code.loop("%size", *[(wide.real, zero)] * 3) as turn:
            y, rate = wide.load("%y", turn.i), wide.load(first, turn.i)
            scale = self._scale(wide.call("fabs", y))
            new = self._square(y, scale), self._square(rate, scale), wide.mul(rate, zero)
            turn.yielded = [wide.add(x, y) for x, y in zip(turn.carried, new, strict=True)]
        *squares, nothing = turn.carried
        d0, d1 = (self._norm(x) for x in squares)
        tiny = wide.constant(1e-5)
        small = wide.either(wide.compare("olt", d0, tiny), wide.compare("olt", d1, tiny))
        h = wide.div(wide.mul(wide.constant(0.01), d0), d1)
        h = self._extreme("olt", wide.choose(small, wide.constant(1e-6), h), self.end)
        self._stage(h, [1.0], 1.0, STAGE, 1)
        with code.loop("%size", (wide.real, zero)) as turn:
            scale = self._scale(wide.call("fabs", wide.load("%y", turn.i)))
            change = wide.sub(wide.load(self.rows[1], turn.i), wide.load(first, turn.i))
            turn.yielded = [wide.add(turn.carried[0], self._square(change, scale))]
        d = self._extreme("ogt", wide.div(self._norm(turn.carried[0]), h), d1)
        flat = wide.compare("ole", d, wide.constant(1e-15))
        third = wide.mul(h, wide.constant(1e-3))
        third = self._extreme("ogt", third, wide.constant(1e-6))
        third = wide.choose(flat, third, self._eighth(wide.div(wide.constant(0.01), d)))
        h = self._extreme("olt", wide.mul(wide.constant(100.0), h), third)
        self._keep(H, self._extreme("olt", h, self.end))
        finite = wide.compare("oeq", nothing, zero)
        self._keep(STATUS, wide.choose(finite, zero, wide.constant(NOT_FINITE)))
        self._keep(CALLS, wide.constant(2.0))

    # ---- A step ----------------------------------------------------------------------------------

    def _step(self) -> None:
        code, wide = self.code, self.wide
        zero, one = wide.constant(0.0), wide.constant(1.0)
        t, tried, status = self._field(T), self._field(H), self._field(STATUS)
        rejected = wide.compare("one", self._field(REJECTED), zero)
        kind = wide.type_of("i64")
        bits = wide.let(f"bitcast {wide.real} {t} to {kind}")
        bits = wide.let(f"add {kind} {bits}, {wide.splat_of('i64 1')}")
        least = wide.sub(wide.let(f"bitcast {kind} {bits} to {wide.real}"), t)
        least = wide.mul(least, wide.constant(SMALLEST))
        running = wide.compare("oeq", status, zero)
        small = wide.both(wide.both(running, rejected), wide.compare("olt", tried, least))
        status = wide.choose(small, wide.constant(TOO_SMALL), status)
        running = wide.compare("oeq", status, zero)
        end = self._extreme("olt", wide.add(t, self._extreme("ogt", tried, least)), self.end)
        end = wide.choose(running, end, t)
        h = wide.sub(end, t)

        rows = zip(DOP853.A[1:], DOP853.C[1:], strict=True)
        for stage, (row, c) in enumerate(rows, 1):
            self._stage(h, row[:stage], c, STAGE, stage)
        self._stage(h, DOP853.B, 1.0, NEW, STAGES)
        error = self._error(h)
        good = wide.both(running, wide.compare("olt", error, one))

        factor = wide.div(wide.constant(SAFETY), self._eighth(error))
        factor = self._extreme("ogt", factor, wide.constant(LEAST))
        factor = self._extreme("olt", factor, wide.constant(MOST))
        again = wide.choose(rejected, self._extreme("olt", factor, one), factor)
        self._keep(H, wide.mul(h, wide.choose(good, again, factor)))
        self._keep(REJECTED, wide.choose(good, zero, one))
        self._keep(USED, h)
        self._keep(REACH, wide.choose(good, end, wide.constant(-1.0)))
        calls = wide.choose(running, wide.constant(float(STAGES)), zero)
        self._keep(CALLS, wide.add(self._field(CALLS), calls))
        due = wide.compare("ole", self._field(DUE), self._field(REACH))
        with code.when(wide.anywhere(due)):
            self._outputs(h, due)
        with code.loop("%size") as turn:
            for old, new in (("%y", NEW), (self.rows[0], STAGES)):
                x = wide.choose(good, wide.load(self.rows[new], turn.i), wide.load(old, turn.i))
                wide.store(x, old, turn.i)
        self._keep(T, wide.choose(good, end, t))
        steps = wide.add(self._field(STEPS), wide.choose(good, one, zero))
        self._keep(STEPS, steps)
        many = wide.both(running, wide.compare("oge", steps, self.most))
        status = wide.choose(many, wide.constant(TOO_MANY), status)
        reached = wide.both(good, wide.compare("oeq", end, self.end))
        self._keep(STATUS, wide.choose(reached, wide.constant(FINISHED), status))

    def _error(self, h: str) -> str:
        """Return the error of a step over the allowed one; not finite where a rate is not."""
        wide = self.wide
        zero = wide.constant(0.0)
        with self.code.loop("%size", *[(wide.real, zero)] * 2) as turn:
            i = turn.i
            sizes = (wide.call("fabs", wide.load(y, i)) for y in ("%y", self.rows[NEW]))
            scale = self._scale(wide.call("maxnum", *sizes))
            last = wide.mul(wide.load(self.rows[STAGES], i), zero)
            fifth = wide.add(self._sum(i, DOP853.E5), last)
            squares = [self._square(x, scale) for x in (fifth, self._sum(i, DOP853.E3))]
            turn.yielded = [wide.add(x, y) for x, y in zip(turn.carried, squares, strict=True)]
        fifth, third = turn.carried
        both = wide.add(fifth, wide.mul(wide.constant(0.01), third))
        root = wide.call("sqrt", wide.mul(both, self.size))
        error = wide.div(wide.mul(h, fifth), root)
        return wide.choose(wide.compare("oeq", both, zero), zero, error)

    # ---- Outputs ---------------------------------------------------------------------------------

    def _outputs(self, h: str, due: str) -> None:
        """Write the outputs of each lane within its step, by an interpolant of degree 7."""
        code, wide = self.code, self.wide
        rows = zip(DOP853.A_EXTRA, DOP853.C_EXTRA, strict=True)
        for stage, (row, c) in enumerate(rows, STAGES + 1):
            self._stage(h, row[:stage], c, STAGE, stage)
        extra = wide.constant(float(len(DOP853.C_EXTRA)))
        calls = wide.choose(due, extra, wide.constant(0.0))
        self._keep(CALLS, wide.add(self._field(CALLS), calls))
        with code.loop("%size") as turn:
            first, last = (wide.load(self.rows[i], turn.i) for i in (0, STAGES))
            change = wide.sub(wide.load(self.rows[NEW], turn.i), wide.load("%y", turn.i))
            both = wide.mul(h, wide.add(first, last))
            curve = [
                change,
                wide.sub(wide.mul(h, first), change),
                wide.sub(wide.add(change, change), both),
                *(wide.mul(h, self._sum(turn.i, row)) for row in DOP853.D),
            ]
            for row, x in enumerate(curve, CURVE):
                wide.store(x, self.rows[row], turn.i)
        with code.loop(wide.width) as turn:
            self._lane_outputs(turn.i)

    def _lane_outputs(self, lane: str) -> None:
        code, width = self.code, self.wide.width

        def field_address(field: int) -> str:
            return code.address("%lanes", code.integer("add", lane, field * width))

        t, h, reach, due = (code.load(field_address(field)) for field in (T, USED, REACH, DUE))
        with code.when(code.compare("ole", due, reach)):
            number = code.let(f"fptosi double {code.load(field_address(NEXT))} to i64")
            with code.repeat(("i64", number), ("double", due)) as output:
                number, due = output.carried
                x = code.div(code.sub(due, t), h)
                rest = code.sub(code.constant(1.0), x)
                first = code.integer("mul", number, "%size")
                with code.loop("%size") as turn:
                    at = code.integer("add", code.integer("mul", turn.i, width), lane)
                    y = code.constant(0.0)
                    for i in reversed(range(CURVE, ROWS)):
                        factor = rest if (i - CURVE) % 2 else x
                        y = code.mul(code.add(y, code.load(self.rows[i], at)), factor)
                    y = code.add(y, code.load("%y", at))
                    row = code.integer("mul", code.integer("add", first, turn.i), width)
                    code.store(y, "%out", code.integer("add", row, lane))
                after = code.integer("add", number, 1)
                later = code.load("%times", after)
                output.yielded = [after, later]
                output.condition = code.compare("ole", later, reach)
            number, due = output.carried
            code.store(code.let(f"sitofp i64 {number} to double"), field_address(NEXT))
            code.store(due, field_address(DUE))
