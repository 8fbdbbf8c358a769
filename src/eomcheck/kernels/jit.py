"""Just-in-time (JIT) compilation of LLVM IR to addresses of functions, and features of this CPU."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from functools import cache

import llvmlite.binding as llvm
import numpy as np

LIBM = ("sin", "cos", "sincos")
DECLARED = (
    "declare void @sincos(double, ptr, ptr)",
    "declare double @sin(double)",
    "declare double @cos(double)",
)
"""Declarations of C library functions that code may call. LLVM's own need no declaration."""


CACHE_LINE = 8
"""Number of float64 in a cache line."""


def aligned_zeros(count: int, ahead: int = 0) -> np.ndarray:
    """Return `count` float64 zeros, of which entry `ahead` is at the start of a cache line."""
    whole = np.zeros(count + CACHE_LINE)
    first = -(whole.ctypes.data // whole.itemsize + ahead) % CACHE_LINE
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
        module = llvm.parse_assembly("\n".join((*DECLARED, *dict.fromkeys(functions))))
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
    known = llvm.get_host_cpu_features()
    # Otherwise vectors of 8 float64 are split even if registers hold them.
    known["prefer-256-bit"] = False
    return llvm.get_host_cpu_name(), known.flatten(), bool(known.get("fma") or _is_arm())


def _is_arm() -> bool:
    return llvm.get_process_triple().startswith(("aarch64", "arm64"))


def target_machine(effort: int) -> llvm.TargetMachine:
    """Return LLVM's description of this machine, with this optimization level."""
    name, known, _ = cpu_features()
    _name_libm()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=known, opt=effort, reloc="default", codemodel="jitdefault", jit=True
    )


@cache
def has_sincos() -> bool:
    """Return whether the C library computes sine and cosine in one call."""
    return hasattr(_libm(), "sincos")


@cache
def _libm() -> ctypes.CDLL:
    return ctypes.CDLL("msvcrt" if os.name == "nt" else None)


@cache
def _name_libm() -> None:
    for name in LIBM:
        if hasattr(_libm(), name):
            llvm.add_symbol(name, ctypes.cast(getattr(_libm(), name), ctypes.c_void_p).value)
