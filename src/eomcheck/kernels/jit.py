"""Just-in-time compilation: from LLVM IR to the address of a function, and what this CPU can do."""

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
"""Functions of the C library that code may call. LLVM's own need no declaration."""


CACHE_LINE = 8
"""Doubles that a machine reads at once."""


def aligned_zeros(count: int, ahead: int = 0) -> np.ndarray:
    """Return `count` doubles, 0, of which the one behind `ahead` others begins a line of cache."""
    whole = np.zeros(count + CACHE_LINE)
    first = -(whole.ctypes.data // whole.itemsize + ahead) % CACHE_LINE
    return whole[first : first + count]


EFFORT = 1
"""LLVM's in generating code, of 0 to 3: more brings nothing here."""
LEAST_EFFORT = 0
"""For code that runs a few times: there four times as soon, several times as slow, same bits."""


class JitModule:
    """Functions in machine code; their addresses hold as long as this object lives.

    Args:
        functions: the texts of functions, each once.
        effort: LLVM's.
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
    """Return this machine's kind, what it can do, and whether it multiplies and adds at once."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    known = llvm.get_host_cpu_features()
    # Otherwise vectors of 8 doubles are split where registers hold them.
    known["prefer-256-bit"] = False
    return llvm.get_host_cpu_name(), known.flatten(), bool(known.get("fma") or _is_arm())


def _is_arm() -> bool:
    return llvm.get_process_triple().startswith(("aarch64", "arm64"))


def target_machine(effort: int) -> llvm.TargetMachine:
    """Return the machine that code is generated for, with this effort: this one."""
    name, known, _ = cpu_features()
    _name_libm()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=name, features=known, opt=effort, reloc="default", codemodel="jitdefault", jit=True
    )


@cache
def has_sincos() -> bool:
    """Return whether the C library makes sine and cosine at once."""
    return hasattr(_libm(), "sincos")


@cache
def _libm() -> ctypes.CDLL:
    return ctypes.CDLL("msvcrt" if os.name == "nt" else None)


@cache
def _name_libm() -> None:
    for name in LIBM:
        if hasattr(_libm(), name):
            llvm.add_symbol(name, ctypes.cast(getattr(_libm(), name), ctypes.c_void_p).value)
