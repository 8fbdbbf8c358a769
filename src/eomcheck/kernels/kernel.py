"""Kernels: programs compiled to machine code, with the memory blocks that they read.

The function (out, t, y, block) of a kernel reads the state y and the time t and writes its outputs
one after the other to `out`. The block holds everything else (`Layout`): parameters, results of
groups, results "lL.J" of operation J of loop L that are read later, workspace. A number in memory
is one float64 for each lane. Operands and items are those of `eomcheck.kernels.program`, whose
first lines list them.

With one lane the function has the signature that CyRK calls: t is a float64, and the last argument
is the address of the address of the block. Such a function counts its calls, and those in which an
output is not finite.

A kernel is called for each row of an array of states by a loop in machine code (`call_along_rows`).
Functions that are timed are called by such loops too (`timing_loop`, `sincos_timing_loop`): the
measured time includes no call from Python.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.kernels import linear_solves, sincos
from eomcheck.kernels.llvm import (
    CACHE_LINE,
    EFFORT,
    NOT_FINITE,
    IRBuilder,
    JitModule,
    aligned_zeros,
)
from eomcheck.kernels.program import FARTHEST, Program, Tree
from eomcheck.kernels.sincos import library_call
from eomcheck.numbers import tape as t
from eomcheck.numbers.generic import Array

# ---- Layout of the memory block ------------------------------------------------------------------

CALLS, FAILED, FAILURE_TIME, TIME = range(4)
HEADER = 4
"""Number of float64 in the header of the block: calls and failures (integers), time of the first
failure, and the argument t."""


class Layout(NamedTuple):
    """Offsets of arrays in a memory block, in numbers of `width` lanes, after its header.

    Attributes:
        offsets: index of the first entry of each array, by name.
        size: number of entries of all arrays.
        workspace: number of float64 after them.
    """

    offsets: Mapping[str, int]
    size: int
    workspace: int

    def float64_count(self, width: int) -> int:
        """Return the number of float64 in a block."""
        return HEADER + self.size * width + self.workspace


def layout_of(program: Program, parameters: Mapping[str, int]) -> Layout:
    """Return the layout of a block for `parameters`, which are sizes by name."""
    sizes = {**parameters, **dict(program.arrays)}
    counts = [item[1] for item in program.items if item[0] == "loop"]
    for loop, inner in sorted(loop_results(program)[0]):
        sizes[f"l{loop}.{inner}"] = counts[loop]
    offsets, at = {}, 0
    for name, size in sizes.items():
        if name not in parameters:
            at = aligned(at)
        offsets[name] = at
        at += size
    return Layout(
        offsets, aligned(at), max((_workspace(item) for item in program.items), default=0)
    )


def aligned(count: int) -> int:
    """Return the first index, at least `count`, that is at the start of a cache line."""
    return -(-count // CACHE_LINE) * CACHE_LINE


def loop_results(program: Program) -> tuple[set[tuple[int, int]], dict[tuple[int, int], int]]:
    """Return the results of loops that are read after them, as (loop, operation).

    Returns:
        The results that are written to memory; and for the others, of which only the last few
        iterations are read, the largest distance from the last iteration.
    """
    counts = [item[1] for item in program.items if item[0] == "loop"]
    reads = {x[1:] for x in reads_of(program.items) if x[0] == "from loop"}
    written = {
        (loop, inner)
        for loop, inner, place, step in reads
        if step or counts[loop] - place > FARTHEST
    }
    last: dict[tuple[int, int], int] = {}
    for loop, inner, place, _ in reads:
        if (loop, inner) not in written:
            ago = counts[loop] - 1 - place
            last[loop, inner] = max(ago, last.get((loop, inner), 0))
    return written, last


def reads_of(items: Tree) -> Iterator[Tree]:
    """Yield all operands that items read."""
    for item in items:
        operands: Sequence[Tree | None] = ()
        match item:
            case "loop", _, body:
                yield from reads_of(body)
            case "group", *_, inline, _, inputs:
                operands = inputs if inline else ()
            case "op", _, *operands:
                pass
            case "put", x, *_:
                operands = (x,)
        for x in operands:
            if x is not None:
                yield x
                if x[0] == "previous":
                    yield from x[2]


def _workspace(item: Tree) -> int:
    """Return the number of float64 of workspace that an item needs."""
    match item:
        case "group", _, t.BAND, _, (size,), False, *_:
            return linear_solves.solve_workspace(size)
        case "group", _, t.SOLVE, _, (size, columns), False, *_:
            return size * columns
        case "group", _, t.PRODUCT, _, (n, k, m), False, *_:
            return n * k + k * m + n * m
    return 0


# ---- Code ----------------------------------------------------------------------------------------


def function_texts(
    name: str, program: Program, layout: Layout, outputs: Mapping[str, int], width: int
) -> list[str]:
    """Return the texts of a function and of those that it calls.

    Args:
        name: of the function.
        program: its operations.
        layout: of the memory block.
        outputs: number of entries of each output, by name, in their order.
        width: number of SIMD lanes.
    """
    return _Emitter(name, program, layout, outputs, width).texts()


class _Emitter:
    def __init__(
        self, name: str, program: Program, layout: Layout, outputs: Mapping[str, int], width: int
    ):
        self.name, self.program, self.layout, self.outputs = name, program, layout, outputs
        self.code = IRBuilder(width)
        self.values: list[str] = []
        self.parts: dict[str, list[str]] = {}
        self.factored: dict[int, linear_solves.InlineLU] = {}
        self.known: dict[Tree, str] = {}
        self.loops = 0
        self.last = loop_results(program)[1]
        self.single = width == 1
        # Outputs, or sums of them: the sum of all is not finite if one output is not.
        self.sums: list[str] = []
        self.stepping = {
            x[1]
            for item in program.items
            if item[0] == "loop"
            for x in reads_of((item,))
            if x[0] == "entry" and x[3]
        }

    def texts(self) -> list[str]:
        """Return the texts of the function and of those that it calls."""
        code = self.code
        if self.single:
            code.do("%block = load ptr, ptr %arguments")
            code.store("%t", code.address("%block", TIME, "double"))
        self.numbers = code.address("%block", HEADER, "double")
        self.room = code.address(self.numbers, self.layout.size)
        time = code.address("%block", TIME, "double") if self.single else "%t"
        self.bases = {"y": "%y", "t": time}
        for name, offset in self.layout.offsets.items():
            self.bases[name] = code.address(self.numbers, offset)
        offset = 0
        for name, size in self.outputs.items():
            self.bases[f"out {name}"] = code.address("%out", offset)
            offset += size
        for item in self.program.items:
            getattr(self, f"_{item[0]}")(*item[1:])
        time = "double" if self.single else "ptr noalias"
        last = "ptr noalias %arguments" if self.single else "ptr noalias %block"
        arguments = f"ptr noalias %out, {time} %t, ptr noalias %y, {last}"
        if self.single:
            self._count()
        return [*code.callees, code.function(f"define void @{self.name}({arguments}) nounwind")]

    def _count(self) -> None:
        """Count the call, and a failure if any output is not finite."""
        code, sums = self.code, self.sums
        while len(sums) > 1:
            pairs = zip(sums[::2], sums[1::2], strict=False)
            sums = [code.add(x, y) for x, y in pairs] + (sums[-1:] if len(sums) % 2 else [])
        calls = code.let("load i64, ptr %block")
        code.do(f"store i64 {code.integer('add', calls, 1)}, ptr %block")
        for x in sums:
            with code.when(code.is_class(x, NOT_FINITE)):
                self._check_outputs()

    def _check_outputs(self) -> None:
        """Count a failure if an output is not finite; a sum of finite outputs may overflow."""
        code, zero = self.code, self.code.constant(0.0)
        with code.loop(sum(self.outputs.values()), (code.real, zero)) as turn:
            nothing = code.mul(code.load("%out", turn.i), zero)
            turn.yielded[0] = code.add(turn.carried[0], nothing)
        with code.when(code.compare("une", turn.carried[0], zero)):
            failures = code.address("%block", FAILED, "i64")
            failed = code.let(f"load i64, ptr {failures}")
            when = code.address("%block", FAILURE_TIME, "double")
            none = code.let(f"icmp eq i64 {failed}, 0")
            code.store(code.choose(none, "%t", code.load(when)), when)
            code.do(f"store i64 {code.integer('add', failed, 1)}, ptr {failures}")

    # ---- Outside of loops ------------------------------------------------------------------------

    def value(self, x: Tree) -> str:
        """Return the value of an operand outside of loops, or the same in all iterations of one."""
        match x:
            case "value", number:
                return self.values[number]
            case "constant", number:
                return self.code.constant(number)
        if x not in self.known:
            _, array, *_, place, _ = x
            parts = self.parts.get(array) if x[0] == "entry" else None
            self.known[x] = parts[place] if parts else self.code.load(self.base(x), place)
        return self.known[x]

    def base(self, x: Tree) -> str:
        """Return the address of the array of an operand."""
        return self.bases[x[1] if x[0] == "entry" else f"l{x[1]}.{x[2]}"]

    def _op(self, op: str, x: Tree, y: Tree | None) -> None:
        self.values.append(_operated(self.code, op, self.value(x), y and self.value(y)))

    def target(self, array: str) -> str:
        """Return the address of an array that is written."""
        return self.bases.get(f"out {array}") or self.bases[array]

    def _put(self, x: Tree, array: str, place: int, step: int) -> None:
        self.code.store(self.value(x), self.target(array), place)
        if self.single and array in self.outputs:
            self.sums.append(self.value(x))

    # ---- Loops -----------------------------------------------------------------------------------

    def _loop(self, count: int, body: Tree) -> None:
        code, number = self.code, self.loops
        self.loops += 1
        # Results of operation `inner` some iterations before, by (inner, first values).
        carried: dict[tuple[int, Tree], int] = {}
        first: list[tuple[str, str]] = []
        for x in reads_of(body):
            if x[0] == "previous":
                _, inner, begun = x
                for begin in range(len(begun)):
                    if (inner, begun[begin:]) not in carried:
                        carried[inner, begun[begin:]] = len(first)
                        first.append((code.real, self.value(begun[begin])))
            elif _is_fixed(x):
                self.value(x)
        last = {inner: ago for (loop, inner), ago in self.last.items() if loop == number}
        nothing = ("constant", 0.0)
        for inner, ago in last.items():
            for before in range(1, ago + 1):
                carried[inner, (nothing,) * before] = len(first)
                first.append((code.real, self.value(nothing)))
        put = [item[2] for item in body if item[0] == "put" and item[2] in self.outputs]
        checked = self.single and bool(put)
        if checked:
            first.append((code.real, code.constant(0.0)))
        with code.loop(count, *first) as turn:
            results: list[str] = []
            loaded: dict[Tree, str] = {}

            def read(x: Tree) -> str:
                if x[0] == "current":
                    return results[x[1]]
                if x[0] == "previous":
                    return turn.carried[carried[x[1:]]]
                if _is_fixed(x):
                    return self.value(x)
                if x not in loaded:
                    loaded[x] = code.load(self.base(x), code.affine(turn.i, x[-2], x[-1]))
                return loaded[x]

            for inner, item in enumerate(body):
                if item[0] == "put":
                    _, x, array, place, step = item
                    code.store(read(x), self.target(array), code.affine(turn.i, place, step))
                    results.append("")
                    if checked and array in self.outputs:
                        turn.yielded[-1] = code.add(turn.yielded[-1], read(x))
                    continue
                _, op, x, y = item
                results.append(_operated(self.code, op, read(x), y and read(y)))
                if (array := f"l{number}.{inner}") in self.bases:
                    code.store(results[-1], self.bases[array], turn.i)
            for (inner, begun), k in carried.items():
                later = begun[1:]
                turn.yielded[k] = turn.carried[carried[inner, later]] if later else results[inner]
            ends = list(turn.carried)
        for inner, ago in last.items():
            for before in range(ago + 1):
                k = carried.get((inner, (nothing,) * before))
                value = results[inner] if k is None else ends[k]
                self.known["from loop", number, inner, count - 1 - before, 0] = value
        if checked:
            self.sums.append(turn.carried[-1])

    # ---- Groups ----------------------------------------------------------------------------------

    def _group(
        self,
        number: int,
        kind: str,
        name: str,
        shape: Tree,
        inline: bool,
        factors: int,
        inputs: Tree,
    ) -> None:
        if inline:
            self._inline_group(number, kind, shape, factors, [self.value(x) for x in inputs])
            return
        results = self.bases[f"x{number}"]
        if kind == t.ANGLES:
            (count,) = shape
            array, first, _ = inputs or (f"r{number}", 0, count)
            sines = self.code.address(results, sincos.padded_count(count))
            angles = self.code.address(self.bases[array], first)
            sincos.write(self.code, angles, results, sines, count)
            return
        lanes, room = ((self.bases[f"r{number}"], 1), (results, 1)), (self.room, 0)
        size = shape[0]
        # A matrix is factored apart in each lane.
        apart = size * (size + 2)
        text_of, arrays = {
            t.FACTORS: (linear_solves.factor_text, (lanes[0], (results, apart))),
            t.SOLVE: (
                linear_solves.solve_text,
                ((self.bases.get(f"x{factors}", ""), apart), *lanes, room),
            ),
            t.BAND: (linear_solves.band_text, (*lanes, room)),
            t.PRODUCT: (linear_solves.product_text, (*lanes, room)),
        }[kind]
        function = "_".join(map(str, (kind, *shape, self.code.width)))
        self._call_by_lane(function, text_of(function, *shape, self.code.width), *arrays)

    def _inline_group(
        self, number: int, kind: str, shape: Tree, factors: int, inputs: list[str]
    ) -> None:
        if kind == t.FACTORS:
            (size,) = shape
            rows = [inputs[i : i + size] for i in range(0, size * size, size)]
            self.factored[number] = linear_solves.InlineLU(self.code, rows)
            return
        if kind == t.SOLVE:
            _, columns = shape
            solved = [self.factored[factors].solve(inputs[j::columns]) for j in range(columns)]
            parts = [x for row in zip(*solved, strict=True) for x in row]
        else:
            parts = sincos.cos_and_sin(self.code, inputs)
        self.parts[f"x{number}"] = parts
        if f"x{number}" in self.stepping:
            for index, x in enumerate(parts):
                self.code.store(x, self.bases[f"x{number}"], index)

    def _call_by_lane(self, name: str, text: str, *arrays: tuple[str, int]) -> None:
        """Call a function for each lane; arrays are (address, float64 from lane to lane)."""
        code = self.code
        code.add_callees(text)
        with code.loop(code.width) as turn:
            addresses = (
                code.address(base, code.affine(turn.i, 0, step), "double") for base, step in arrays
            )
            code.do(f"call void @{name}({', '.join(f'ptr {x}' for x in addresses)})")


def _is_fixed(x: Tree) -> bool:
    """Return whether an operand in a loop is the same in all iterations."""
    return x[0] in ("value", "constant") or (x[0] in ("entry", "from loop") and x[-1] == 0)


def _operated(code: IRBuilder, op: str, x: str, y: Any) -> str:
    """Return the result of x op y."""
    if op == t.NEG:
        return code.neg(x)
    if op == t.SQRT:
        return code.call("sqrt", x)
    return {t.ADD: code.add, t.SUB: code.sub, t.MUL: code.mul, t.DIV: code.div}[op](x, y)


# ---- Loops that call machine code ----------------------------------------------------------------


@cache
def _machine() -> JitModule:
    repeated, angles, rows = IRBuilder(), IRBuilder(), {}
    with repeated.loop("%count"):
        repeated.do("call void %function(ptr %a, double %t, ptr %b, ptr %c, ptr %d)")
    with angles.loop("%count"), angles.loop("%size") as turn:
        x = angles.let(f"load double, ptr {angles.address('%x', turn.i)}")
        library_call(angles, x, angles.address("%cos", turn.i), angles.address("%sin", turn.i))
    for name in ("double", "ptr"):
        rows[name] = code = IRBuilder()
        with code.loop("%count") as turn:
            out, t, y = (
                code.address(f"%{x}", code.integer("mul", turn.i, f"%{x}_step"))
                for x in ("out", "t", "y")
            )
            t = code.load(t) if name == "double" else t
            code.do(f"call void %function(ptr {out}, {name} {t}, ptr {y}, ptr %last)")
    steps = ", ".join(f"ptr %{x}, i64 %{x}_step" for x in ("out", "t", "y"))
    arguments = "ptr %function, double %t, ptr %a, ptr %b, ptr %c, ptr %d"
    return JitModule(
        (
            *(
                code.function(
                    f"define void @along_{name}(ptr %function, ptr %last, i64 %count, {steps})"
                )
                for name, code in rows.items()
            ),
            repeated.function(f"define void @repeated(i64 %count, {arguments})"),
            angles.function(
                "define void @angles(i64 %count, i64 %size, ptr %x, ptr %cos, ptr %sin)"
            ),
        )
    )


def timing_loop(address: int, *pointers: int) -> Callable[[int], None]:
    """Return a function of a count that calls a C function of up to four pointers so many times.

    The argument after the first pointer is a float64, 0; C functions without it do not see it.

    Args:
        address: of the C function.
        pointers: its arguments.
    """
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_double, *[ctypes.c_void_p] * 4
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("repeated"))
    arguments = *pointers, *[0] * (4 - len(pointers))
    return lambda count: function(count, address, 0.0, *arguments)


def call_along_rows(
    address: int, last: np.ndarray, t: np.ndarray, y: np.ndarray, out: np.ndarray
) -> None:
    """Call a kernel for each row of t, y and `out`, which it writes.

    Args:
        address: of the kernel.
        last: array whose address is its last argument.
        t: times (k, lanes), s.
        y: states (k, _, lanes).
        out: outputs (k, _, lanes).
    """
    if len(out):
        function, *arguments = _along_rows(address, last, t, y, out)
        function(*arguments)


def _along_rows(
    address: int, last: np.ndarray, t: np.ndarray, y: np.ndarray, out: np.ndarray
) -> tuple[Any, ...]:
    """Return a C function and its arguments, those of `call_along_rows`."""
    name = "along_double" if out.shape[-1] == 1 else "along_ptr"
    kinds = *[ctypes.c_void_p] * 2, *[ctypes.c_int64, ctypes.c_void_p] * 3, ctypes.c_int64
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address(name))
    rows = ((x.ctypes.data, x[0].size) for x in (out, t, y))
    return function, address, last.ctypes.data, len(out), *(part for row in rows for part in row)


def sincos_timing_loop(x: np.ndarray) -> Callable[[int], None]:
    """Return a function of a count: sines and cosines of angles x (k >= 1,), rad, so many times."""
    kinds = ctypes.c_int64, ctypes.c_int64, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(_machine().address("angles"))
    x = np.ascontiguousarray(x, float)
    cos, sin = np.empty_like(x), np.empty_like(x)
    return lambda count: function(count, x.size, x.ctypes.data, cos.ctypes.data, sin.ctypes.data)


# ---- Kernels -------------------------------------------------------------------------------------


class Kernel:
    """A function of (t, y) and parameters in machine code.

    Args:
        program: its operations.
        parameters: number of entries of each parameter, by name.
        outputs: number of entries of each output, by name.
        width: number of SIMD lanes.
        effort: optimization level of LLVM's code generation.
    """

    def __init__(
        self,
        program: Program,
        parameters: Mapping[str, int],
        outputs: Mapping[str, int],
        width: int = 1,
        effort: int = EFFORT,
    ):
        self.width, self.parameters, self.outputs = width, dict(parameters), dict(outputs)
        self.layout: Layout = layout_of(program, parameters)
        self.size = sum(self.outputs.values())
        texts = function_texts("kernel", program, self.layout, self.outputs, width)
        self.machine = JitModule(texts, effort)
        self.address = self.machine.address("kernel")

    def block(self, parameters: Mapping[str, Array]) -> Array:
        """Return a memory block with these parameters, each (size,) or (size, lanes)."""
        block = aligned_zeros(self.layout.float64_count(self.width), HEADER)
        block[FAILURE_TIME] = np.nan
        for name, size in self.parameters.items():
            first = HEADER + self.layout.offsets[name] * self.width
            target = block[first : first + size * self.width].reshape(size, self.width)
            values = np.asarray(parameters[name], float)
            target[:] = values if values.ndim == 2 else values[:, None]
        return block

    def last_argument(self, block: Array) -> Array:
        """Return the array whose address is the last argument; the caller has to keep it alive."""
        return np.array([block.ctypes.data], np.uintp) if self.width == 1 else block

    def __call__(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs, each (size,) or (size, lanes), of a state y and times t (lanes,)."""
        outputs = self.rows(block, t.reshape(1, -1), y[None])
        return {name: x[0] if self.width > 1 else x[0, :, 0] for name, x in outputs.items()}

    def bound(self, block: Array, t: Array, y: Array, out: Array) -> Callable[[], None]:
        """Return a function that computes the outputs of the numbers that then are in the arrays.

        That takes 1 µs beside the kernel; of a kernel of one lane.

        Args:
            block: the block of memory.
            t: time (1,), s.
            y: state (_,).
            out: outputs (size,), which it writes.
        """
        last = self.last_argument(block)
        function, *arguments = _along_rows(
            self.address, last, t[None, :, None], y[None, :, None], out[None, :, None]
        )
        values = [kind(x) for kind, x in zip(function.argtypes, arguments, strict=True)]
        kept = last, block, t, y, out  # their addresses are in the arguments

        def run() -> None:
            function(*values)

        run.__dict__["kept"] = kept
        return run

    def rows(self, block: Array, t: Array, y: Array) -> dict[str, Array]:
        """Return the outputs (k, size, lanes) at times t (k, lanes) of states y (k, _, lanes)."""
        y, t = np.ascontiguousarray(y, float), np.ascontiguousarray(t, float)
        out = np.empty((len(y), self.size, self.width))
        call_along_rows(self.address, self.last_argument(block), t, y, out)
        ends = np.cumsum(list(self.outputs.values()))[:-1]
        return dict(zip(self.outputs, np.split(out, ends, axis=1), strict=True))
