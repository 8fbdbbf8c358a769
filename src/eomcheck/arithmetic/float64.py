"""Machine doubles: the generic functions, compiled by numba and cached on disk.

`compiled(function)` is the only door. Marked functions stay plain Python functions; numba is told
to compile them wherever compiled code calls them, and `solve` is replaced by LAPACK's.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import shutil
import time
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.ccallback import CFunc
from numba.core.sigutils import normalize_signature
from numba.extending import overload, register_jitable

import eomcheck
from eomcheck.arithmetic.absent import settle_absent
from eomcheck.arithmetic.banded import solve_banded
from eomcheck.arithmetic.generic import GENERIC, generic
from eomcheck.arithmetic.linear import solve
from eomcheck.arithmetic.sincos import cos_sin
from eomcheck.model import Angles


@generic
def angles(x):
    """Return the `Angles` of x (k,), rad."""
    cos, sin = cos_sin(x)
    return Angles(x, cos, sin)


class Float64:
    """The arithmetic of machine doubles (`eomcheck.model.Arithmetic`)."""

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as doubles, a contiguous copy."""
        return np.array(x, dtype=np.float64, order="C")

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        return angles(self.numbers(x))


FLOAT64 = Float64()


SMALL = 8
"""Up to this order LU is written out: calling LAPACK would cost more than the elimination."""


@register_jitable(error_model="numpy")
def solve_two(A, b):
    """Solve A x = b, b (2,), as `lu_solve` does: planar vehicles have two degrees of freedom."""
    p, o = (0, 1) if abs(A[0, 0]) >= abs(A[1, 0]) else (1, 0)
    factor = A[o, 0] / A[p, 0]
    pivot = A[o, 1] - factor * A[p, 1]
    if pivot == 0:
        pivot = np.nan
    x = np.empty(2)
    x[1] = (b[o] - factor * b[p]) / pivot
    x[0] = (b[p] - A[p, 1] * x[1]) / A[p, 0]
    return x


@register_jitable(error_model="numpy")
def lu_solve(A, b):
    """Solve A x = b, b (k,), by elimination with partial pivoting; NaN where A is singular."""
    if b.size == 2:
        return solve_two(A, b)
    U, x = A.copy(), b.copy()
    size = x.size
    for column in range(size):
        pivot = column
        for row in range(column + 1, size):
            if abs(U[row, column]) > abs(U[pivot, column]):
                pivot = row
        if not abs(U[pivot, column]) > 0:
            x[:] = np.nan
            return x
        if pivot != column:
            for k in range(column, size):
                U[column, k], U[pivot, k] = U[pivot, k], U[column, k]
            x[column], x[pivot] = x[pivot], x[column]
        for row in range(column + 1, size):
            factor = U[row, column] / U[column, column]
            for k in range(column + 1, size):
                U[row, k] -= factor * U[column, k]
            x[row] -= factor * x[column]
    for row in range(size - 1, -1, -1):
        for k in range(row + 1, size):
            x[row] -= U[row, k] * x[k]
        x[row] /= U[row, row]
    return x


@register_jitable
def lapack_solve(A, b):
    """Solve A x = b, b (k,) or (k, m); NaN where A is singular.

    An exception that leaves a C callback is only printed, and the caller goes on with garbage, so
    compiled code must not raise.
    """
    x = np.full_like(b, np.nan)
    try:
        x[:] = np.linalg.solve(A, b)
    except Exception:
        x[:] = np.nan
    return x


@overload(solve)
def _compiled_solve(A, b, name):
    if b.ndim == 1:
        return lambda A, b, name: lu_solve(A, b) if b.size <= SMALL else lapack_solve(A, b)
    return lambda A, b, name: lapack_solve(A, b)


RIGHT, FACTORS, PIVOT, FOUND, CORRECTION = 7, 8, 12, 13, 14
"""Places in a row of work of `band_solve`. Before them: a row of U from its diagonal on, 7 entries,
of which the first is kept as its reciprocal. Then its right-hand side, the factors by which it was
taken from 4 rows, its place among these, the solution and its correction."""


@register_jitable(error_model="numpy")
def band_solve(bands, b):
    """Solve A x = b as `eomcheck.arithmetic.banded` does; NaN where A is singular."""
    size = b.size
    # One large block: several are given back to the system, and asked for again, at every call.
    work = np.empty((size + 6, 16))
    work[size:] = 0.0
    if not _eliminate(bands, b, work):
        return np.full(size, np.nan)
    _substitute(work, FOUND)
    _eliminate_residual(bands, b, work)
    _substitute(work, CORRECTION)
    return work[:size, FOUND] + work[:size, CORRECTION]


@register_jitable(error_model="numpy")
def _eliminate(bands, b, work):
    """Eliminate column by column; return whether there was a pivot for each.

    The rows that have an entry in the column are kept from there on, their right-hand sides behind:
    three that the last column left, and a new one in the place of its pivot.
    """
    size = b.size
    rows = np.zeros((4, 8))
    for i in range(min(3, size)):
        for j in range(3 - i, 7):
            rows[i, j - 3 + i] = bands[i, j]
        rows[i, RIGHT] = b[i]
    pivot = 3
    for column in range(size):
        new = column + 3
        for j in range(7):
            rows[pivot, j] = bands[new, j] if new < size else 0.0
        rows[pivot, RIGHT] = b[new] if new < size else 0.0
        pivot = 0
        for i in range(1, 4):
            if abs(rows[i, 0]) > abs(rows[pivot, 0]):
                pivot = i
        for j in range(8):
            work[column, j] = rows[pivot, j]
        if not abs(work[column, 0]) > 0:
            return False
        reciprocal = 1 / work[column, 0]
        work[column, 0], work[column, PIVOT] = reciprocal, pivot
        for i in range(4):
            factor = rows[i, 0] * reciprocal
            work[column, FACTORS + i] = factor
            for j in range(1, 7):
                rows[i, j - 1] = rows[i, j] - factor * work[column, j]
            rows[i, 6] = 0.0
            rows[i, RIGHT] -= factor * work[column, RIGHT]
    return True


@register_jitable(error_model="numpy")
def _eliminate_residual(bands, b, work):
    """Replace the right-hand side by what elimination makes of b - A x, x in column `FOUND`."""
    size = b.size
    rows = np.zeros(4)
    for new in range(size + 3):
        column = new - 3
        residual = 0.0
        if new < size:
            residual = b[new]
            for j in range(max(0, 3 - new), 7):
                residual -= bands[new, j] * work[column + j, FOUND]
        if column < 0:
            rows[new] = residual
            continue
        rows[int(work[column - 1, PIVOT]) if column > 0 else 3] = residual
        row = rows[int(work[column, PIVOT])]
        work[column, RIGHT] = row
        for i in range(4):
            rows[i] -= work[column, FACTORS + i] * row


@register_jitable(error_model="numpy")
def _substitute(work, place):
    """Solve U x = right-hand side, from the last unknown to the first, into a column of work."""
    for i in range(len(work) - 7, -1, -1):
        total = work[i, RIGHT]
        # The unknown found just before comes last, so that the others need not wait for it.
        for j in range(6, 0, -1):
            total -= work[i, j] * work[i + j, place]
        work[i, place] = total * work[i, 0]


@overload(solve_banded)
def _compiled_solve_banded(bands, b, name):
    return lambda bands, b, name: band_solve(bands, b)


@cache
def compiled(function: Callable) -> Callable:
    """Return `function` compiled for doubles; compiled code is kept on disk between processes.

    `function` may be a closure over marked functions, never over compiled ones: those change their
    identity with every process and would never be found again.
    """
    _register_marked()
    entry = _entry(function) if function in _settled_when_called else function
    _name_apart(entry)
    dispatcher = numba.njit(error_model="numpy")(entry)
    if _has_source(function):
        with _cache_directory(function):
            dispatcher._cache = _Cache(entry)  # type: ignore[attr-defined]
    return dispatcher


def compiled_callback(function: Callable, signature: Any) -> CFunc:
    """Return `function` compiled as a C callback of `signature`, kept on disk like `compiled`."""
    _register_marked()
    _name_apart(function)
    arguments, result = normalize_signature(signature)
    callback = CFunc(function, (arguments, result), locals={}, options={"error_model": "numpy"})
    if _has_source(function):
        with _cache_directory(function):
            callback._cache = _Cache(function)  # type: ignore[attr-defined]
    callback.compile()
    return callback


class _Cache(FunctionCache):
    """numba's cache on disk, forgetting what it cannot read.

    Compiled code is kept by the types of its arguments. Those of somebody's own scene live in a
    module that another process may not have, and reading their index would fail there.
    """

    def load_overload(self, sig, target_context):
        """Return the compiled code for `sig`, or None."""
        try:
            return super().load_overload(sig, target_context)
        except (ImportError, AttributeError):
            self.flush()
            return None


def _name_apart(function: Callable) -> None:
    """Name a closure after what it closes over.

    numba tells compiled functions apart by name, types and a number that starts anew in every
    process. Two closures of one name, cached by two processes, would share their symbols in a
    third.
    """
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    parts = [
        f"{cell.__module__}.{cell.__qualname__}" if callable(cell) else str(cell) for cell in cells
    ]
    if parts:
        # A digest, since numba makes file names of it.
        digest = hashlib.sha256(" ".join(parts).encode()).hexdigest()
        function.__qualname__ = f"{function.__name__}_{digest[:16]}"


def _entry(function: Callable) -> Callable:
    """Return a function that calls `function`: absent arguments are settled in calls only."""

    def enter(*arguments):
        return function(*arguments)

    return enter


_registered = 0
_settled_when_called: set[Callable] = set()


def _register_marked() -> None:
    global _registered
    for function in GENERIC[_registered:]:
        _register(function)
    _registered = len(GENERIC)


def _register(function: Callable) -> None:
    _settled_when_called.add(function)

    @overload(function, jit_options={"error_model": "numpy"}, strict=False)
    def _(*types):
        return settle_absent(function, tuple(isinstance(t, numba.types.NoneType) for t in types))


def _has_source(function: Callable) -> bool:
    return Path(inspect.getfile(function)).is_file()


@contextmanager
def _cache_directory(function: Callable):
    """Let numba cache below a directory named after the present state of the sources.

    numba itself only notices a change in the file of the outermost function, and would go on
    serving code compiled from an older version of the functions that it calls.
    """
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_stamped_directory(before, function))  # type: ignore[attr-defined]
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


PACKAGE = Path(eomcheck.__file__).parent
KEEP_DAYS = 7
"""Compiled code of older sources is kept this long."""


def _stamped_directory(chosen: str, function: Callable) -> Path:
    base = Path(chosen) if chosen else PACKAGE / "__pycache__"
    if not os.access(base if base.exists() else base.parent, os.W_OK):
        base = Path.home() / ".cache" / "eomcheck"
    stamp = hashlib.sha256(f"{_package_stamp()} {_foreign_stamp(function)}".encode()).hexdigest()
    directory = base / f"numba-{stamp[:16]}"
    if not directory.exists():
        for old in base.glob("numba-*"):
            if time.time() - old.stat().st_mtime > 86400 * KEEP_DAYS:
                shutil.rmtree(old, ignore_errors=True)
    return directory


@cache
def _package_stamp() -> str:
    return _stamp(sorted(PACKAGE.rglob("*.py")))


def _foreign_stamp(function: Callable) -> str:
    """Return the state of the sources outside the package, if `function` reaches any of them."""
    cells = (cell.cell_contents for cell in function.__closure__ or ())
    if not _foreign_files((function, *filter(callable, cells))):
        return ""
    return _stamp(_foreign_files(tuple(GENERIC)) | _foreign_files((function,)))


def _foreign_files(functions: tuple[Callable, ...]) -> set[Path]:
    files = {Path(inspect.getfile(function)) for function in functions}
    return {file for file in files if PACKAGE not in file.parents and file.is_file()}


def _stamp(files: Iterable[Path]) -> str:
    lines = (f"{file} {file.stat().st_mtime_ns} {file.stat().st_size}" for file in sorted(files))
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
