"""LLVM: a builder of its intermediate representation (IR), and just-in-time (JIT) compilation.

An `IRBuilder` holds the body of one function, line by line: numbers, memory, loops and branches. A
number is a float64, or a SIMD vector of float64 with one entry per lane; a value is represented by
its name in LLVM IR. No flag allows reassociation or contraction. A `JitModule` compiles the texts
of functions to addresses.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

import llvmlite.binding as llvm
import numpy as np

LANES = 8
"""Number of float64 in a SIMD vector: as many as the widest registers hold. LLVM splits vectors
that are too wide for a machine."""


def real_type(width: int) -> str:
    """Return LLVM's type of a vector of `width` float64."""
    return "double" if width == 1 else f"<{width} x double>"


FINITE_NOT_ZERO, NOT_FINITE = 0x198, 0x207
"""LLVM's classes of numbers: normal and subnormal numbers; infinities and NaN."""


class Iteration:
    """An iteration of a loop.

    Attributes:
        i: its number, from 0; "" in `repeat`, which does not count.
        condition: in `repeat`, the i1 to continue, set by the code written inside.
        carried: values from the iteration before.
        yielded: values for the next iteration, set by the code written inside; otherwise `carried`.
    """

    def __init__(self, i: str, carried: list[str]):
        self.i, self.condition = i, ""
        self.carried, self.yielded = carried, list(carried)


class IRBuilder:
    """The body of one function, for `width` lanes.

    Attributes:
        width: number of lanes.
        real: LLVM's type of a number.
        lines: instructions and labels so far.
        callees: texts of the functions that are called, as keys in order.
        block: label of the current basic block, the predecessor that a loop needs.
    """

    def __init__(self, width: int = 1):
        self.width, self.real = width, real_type(width)
        self.lines: list[str] = []
        self.callees: dict[str, None] = {}
        self.block, self._names, self._constants = "entry", 0, {}

    def wider(self, width: int) -> IRBuilder:
        """Return a builder of another width that writes into the same function.

        They share lines, callees and names, but not the block: loops and blocks are the first's.
        """
        other = IRBuilder(width)
        other.lines, other.callees = self.lines, self.callees
        other.fresh, other.labels = self.fresh, self.labels
        return other

    # ---- Values ----------------------------------------------------------------------------------

    def fresh(self) -> str:
        """Return a new name for a value."""
        self._names += 1
        return f"%v{self._names}"

    def let(self, text: str) -> str:
        """Write an instruction, `text`, and return the name of its value."""
        name = self.fresh()
        self.lines.append(f"{name} = {text}")
        return name

    def add_callees(self, *texts: str) -> None:
        """Add the texts of functions that are called."""
        self.callees.update(dict.fromkeys(texts))

    def do(self, text: str) -> None:
        """Write an instruction without a value."""
        self.lines.append(text)

    def constant(self, x: float) -> str:
        """Return a constant, the same in every lane."""
        # As keys 0.0 and -0.0 are the same.
        text = self._constants.get(x)
        if text is None or x == 0:
            bits = f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"
            text = self._constants[x] = self.splat_of(f"double {bits}")
        return text

    def splat_of(self, typed: str) -> str:
        """Return a constant such as "double 1.0" or "i64 3" in every lane, without its type."""
        return (
            typed.partition(" ")[2] if self.width == 1 else f"<{', '.join([typed] * self.width)}>"
        )

    def type_of(self, scalar: str) -> str:
        """Return the type of values with a `scalar`, such as i1 or i64, in each lane."""
        return scalar if self.width == 1 else f"<{self.width} x {scalar}>"

    def add(self, x: str, y: str) -> str:
        """Return x + y."""
        return self.let(f"fadd {self.real} {x}, {y}")

    def sub(self, x: str, y: str) -> str:
        """Return x - y."""
        return self.let(f"fsub {self.real} {x}, {y}")

    def mul(self, x: str, y: str) -> str:
        """Return x y."""
        return self.let(f"fmul {self.real} {x}, {y}")

    def div(self, x: str, y: str) -> str:
        """Return x / y."""
        return self.let(f"fdiv {self.real} {x}, {y}")

    def neg(self, x: str) -> str:
        """Return -x."""
        return self.let(f"fneg {self.real} {x}")

    def call(self, name: str, *x: str) -> str:
        """Return the result of LLVM's function `name`: fabs, sqrt, fma, maxnum, copysign."""
        suffix = "f64" if self.width == 1 else f"v{self.width}f64"
        arguments = ", ".join(f"{self.real} {y}" for y in x)
        return self.let(f"call {self.real} @llvm.{name}.{suffix}({arguments})")

    def multiply_add(self, x: str, y: str, z: str) -> str:
        """Return x + y z, by fused multiply-add on machines that have it."""
        return self.call("fma", y, z, x) if has_fma() else self.add(x, self.mul(y, z))

    def multiply_subtract(self, x: str, y: str, z: str) -> str:
        """Return x - y z, by fused multiply-add on machines that have it."""
        return self.multiply_add(x, self.neg(y), z)

    def compare(self, how: str, x: str, y: str) -> str:
        """Return the condition x `how` y, lane by lane: ogt, oeq, une, ..."""
        return self.let(f"fcmp {how} {self.real} {x}, {y}")

    def is_class(self, x: str, classes: int) -> str:
        """Return the condition that x is in one of LLVM's `classes` of floating-point numbers."""
        suffix = "f64" if self.width == 1 else f"v{self.width}f64"
        arguments = f"{self.real} {x}, i32 {classes}"
        return self.let(f"call {self.type_of('i1')} @llvm.is.fpclass.{suffix}({arguments})")

    def choose(self, where: str, x: str, y: str) -> str:
        """Return x where `where` holds, otherwise y."""
        if x == y:
            return x
        return self.let(f"select {self.type_of('i1')} {where}, {self.real} {x}, {self.real} {y}")

    def both(self, x: str, y: str) -> str:
        """Return the conjunction of two conditions, lane by lane."""
        return self.let(f"and {self.type_of('i1')} {x}, {y}")

    def either(self, x: str, y: str) -> str:
        """Return the disjunction of two conditions, lane by lane."""
        return self.let(f"or {self.type_of('i1')} {x}, {y}")

    def anywhere(self, where: str) -> str:
        """Return whether a condition holds in any lane."""
        if self.width == 1:
            return where
        return self.let(
            f"call i1 @llvm.vector.reduce.or.v{self.width}i1({self.type_of('i1')} {where})"
        )

    def lane(self, x: str, lane: int | str) -> str:
        """Return the float64 of one lane."""
        return x if self.width == 1 else self.let(f"extractelement {self.real} {x}, i64 {lane}")

    def lane_of_condition(self, where: str, lane: int) -> str:
        """Return whether a condition holds in one lane."""
        if self.width == 1:
            return where
        return self.let(f"extractelement {self.type_of('i1')} {where}, i64 {lane}")

    def packed(self, doubles: Sequence[str]) -> str:
        """Return the number with one of `doubles` in each lane; a single one goes to every lane."""
        if self.width == 1:
            return doubles[0]
        out = "poison"
        for i in range(self.width):
            x = doubles[i if len(doubles) > 1 else 0]
            out = self.let(f"insertelement {self.real} {out}, double {x}, i64 {i}")
        return out

    # ---- Memory ----------------------------------------------------------------------------------

    def address(self, pointer: str, index: int | str, element_type: str | None = None) -> str:
        """Return the address of an entry at `pointer`, of `element_type` or else a number."""
        if index == 0:
            return pointer
        return self.let(f"getelementptr {element_type or self.real}, ptr {pointer}, i64 {index}")

    def load(self, pointer: str, index: int | str = 0) -> str:
        """Return an entry of the numbers at `pointer`."""
        return self.let(f"load {self.real}, ptr {self.address(pointer, index)}, align 8")

    def store(self, x: str, pointer: str, index: int | str = 0) -> None:
        """Write x to an entry of the numbers at `pointer`."""
        self.do(f"store {self.real} {x}, ptr {self.address(pointer, index)}, align 8")

    # ---- Integers --------------------------------------------------------------------------------

    def integer(self, how: str, x: int | str, y: int | str) -> str:
        """Return x `how` y for 64-bit integers: add, sub, mul."""
        return self.let(f"{how} i64 {x}, {y}")

    def affine(self, i: str, first: int, step: int) -> str | int:
        """Return first + step i."""
        if step == 0:
            return first
        scaled = i if step == 1 else self.integer("mul", i, step)
        return scaled if first == 0 else self.integer("add", scaled, first)

    # ---- Control flow ----------------------------------------------------------------------------

    def enter(self, block: str) -> None:
        """Begin a block; it is entered by jumps and branches only."""
        self.lines.append(f"{block}:")
        self.block = block

    def jump(self, block: str) -> None:
        """Jump to a block."""
        self.do(f"br label %{block}")

    def branch(self, where: str, yes: str, no: str) -> None:
        """Branch to one of two blocks."""
        self.do(f"br i1 {where}, label %{yes}, label %{no}")

    def labels(self, *stems: str) -> list[str]:
        """Return new names of blocks that begin with `stems`."""
        self._names += 1
        return [f"{stem}{self._names}" for stem in stems]

    @contextmanager
    def loop(self, count: int | str, *carried: tuple[str, str]) -> Iterator[Iteration]:
        """Repeat the code written inside `count` times, at least once.

        Args:
            count: number of iterations.
            carried: (type, first value) of each value passed from one iteration to the next; after
                the loop, `carried` of the iteration are the values of the last one.
        """
        (head,) = self.labels("loop")
        before = self.block
        self.jump(head)
        self.enter(head)
        turn = Iteration(self.fresh(), [self.fresh() for _ in carried])
        first_line = len(self.lines)
        self.lines += [""] * (1 + len(carried))
        yield turn
        after = self.integer("add", turn.i, 1)
        more = self.let(f"icmp ne i64 {after}, {count}")
        (done,) = self.labels("done")
        end = self.block
        self.branch(more, head, done)
        self.enter(done)
        self.lines[first_line] = f"{turn.i} = phi i64 [0, %{before}], [{after}, %{end}]"
        self._write_phis(first_line + 1, turn, carried, before, end)

    @contextmanager
    def repeat(self, *carried: tuple[str, str]) -> Iterator[Iteration]:
        """Repeat the code written inside as long as `condition` of its iteration holds."""
        (head,) = self.labels("while")
        before = self.block
        self.jump(head)
        self.enter(head)
        turn = Iteration("", [self.fresh() for _ in carried])
        first_line = len(self.lines)
        self.lines += [""] * len(carried)
        yield turn
        (done,) = self.labels("done")
        end = self.block
        self.branch(turn.condition, head, done)
        self.enter(done)
        self._write_phis(first_line, turn, carried, before, end)

    def _write_phis(
        self,
        first_line: int,
        turn: Iteration,
        carried: Sequence[tuple[str, str]],
        before: str,
        end: str,
    ) -> None:
        """Write the carried values of a loop into its head, in the lines reserved for them.

        Each comes from block `before` the loop or from the `end` of an iteration.
        """
        rows = zip(turn.carried, carried, turn.yielded, strict=True)
        for i, (name, (value_type, first), following) in enumerate(rows):
            self.lines[first_line + i] = (
                f"{name} = phi {value_type} [{first}, %{before}], [{following}, %{end}]"
            )
        turn.carried = list(turn.yielded)

    @contextmanager
    def when(self, where: str) -> Iterator[None]:
        """Run the code written inside if an i1 holds; its results pass through memory only."""
        yes, after = self.labels("yes", "after")
        self.branch(where, yes, after)
        self.enter(yes)
        yield
        self.jump(after)
        self.enter(after)

    def function(self, head: str, result: str = "void") -> str:
        """Return the text of the function, from its `head` (the definition without body)."""
        inside = "\n".join(["entry:", *self.lines, f"ret {result}"])
        return f"{head} {{\n{inside}\n}}\n"


# ---- Compilation ---------------------------------------------------------------------------------

DECLARATIONS = {
    "sincos": "declare void @sincos(double, ptr, ptr)",
    "sin": "declare double @sin(double)",
    "cos": "declare double @cos(double)",
}
"""C library function that code may call -> its declaration. LLVM's own need none."""

CACHE_LINE = 8
"""Number of float64 in a cache line."""


def aligned_zeros(count: int, aligned_entry: int = 0) -> np.ndarray:
    """Return `count` float64 zeros for code to work on; one entry begins a cache line."""
    whole = np.zeros(count + CACHE_LINE)
    first = -(whole.ctypes.data // whole.itemsize + aligned_entry) % CACHE_LINE
    return whole[first : first + count]


EFFORT = 1
"""Optimization level of LLVM's code generation, of 0 to 3: a higher level gains nothing here."""
LEAST_EFFORT = 0
"""Optimization level for code that runs a few times: compiled in a quarter of the time, several
times slower, same bits."""


class JitModule:
    """Functions in machine code; their addresses are valid as long as this object lives.

    Args:
        functions: LLVM IR of functions; repeated ones are compiled once.
        effort: optimization level of LLVM's code generation.
    """

    def __init__(self, functions: Iterable[str], effort: int = EFFORT):
        machine = target_machine(effort)
        module = llvm.parse_assembly("\n".join((*DECLARATIONS.values(), *dict.fromkeys(functions))))
        self._engine = llvm.create_mcjit_compiler(module, machine)
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Return the address of a function."""
        return self._engine.get_function_address(name)


@cache
def cpu_features() -> tuple[str, str, bool]:
    """Return the name of this CPU, its features, and whether it has fused multiply-add."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features()
    # Otherwise vectors of 8 float64 are split even if registers hold them.
    features["prefer-256-bit"] = False
    return llvm.get_host_cpu_name(), features.flatten(), bool(features.get("fma") or _is_arm())


def has_fma() -> bool:
    """Return whether this CPU has fused multiply-add."""
    return cpu_features()[2]


def _is_arm() -> bool:
    """Return whether this machine is a 64-bit ARM, on which fused multiply-add is no feature."""
    return llvm.get_process_triple().startswith(("aarch64", "arm64"))


def target_machine(effort: int) -> llvm.TargetMachine:
    """Return LLVM's description of this machine, with this optimization level."""
    name, features, _ = cpu_features()
    _name_libm()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=features, opt=effort, reloc="default", codemodel="jitdefault", jit=True
    )


@cache
def has_sincos() -> bool:
    """Return whether the C library computes sine and cosine in one call."""
    return hasattr(_libm(), "sincos")


@cache
def _libm() -> ctypes.CDLL:
    """Return the C library of this process."""
    return ctypes.CDLL("msvcrt" if os.name == "nt" else None)


@cache
def _name_libm() -> None:
    """Tell LLVM the addresses of the C library functions that this machine has."""
    for name in DECLARATIONS:
        if hasattr(_libm(), name):
            llvm.add_symbol(name, ctypes.cast(getattr(_libm(), name), ctypes.c_void_p).value)
