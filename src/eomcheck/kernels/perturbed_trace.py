"""Traces of generic functions, replayed with perturbed operations (Monte Carlo arithmetic).

A function is run once on numbers that record their operations. The trace is cached by the function
and the shapes of its arguments (the trace key), and replayed in machine code, many times: exactly,
with a random relative perturbation of every operation, or on a batch of states, one per SIMD lane,
operation by operation. In Python these replays would take most of the time.

Unlike on a tape (`eomcheck.numbers.tape`) no operations are merged, because each is perturbed by
itself, and none is left out but those that round nothing: x + 0, 0 x and 1 x. Products and solves
of matrices, sines, cosines and square roots are groups between stretches of the trace, computed by
numpy, LAPACK or `perturbed_solves`.

`traceable_prepare` traces the function by which a scene precomputes sines, cosines and square
roots, so that the operations between them are perturbed: if 1 - cos² nearly cancels, the digits of
its square root are lost before the root is taken.
"""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Callable, Hashable
from contextlib import suppress
from functools import cache, lru_cache, partial
from itertools import chain, count
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from eomcheck.kernels import batched_solves, perturbed_solves  # noqa: F401  (register solvers)
from eomcheck.kernels.llvm import LANES, IRBuilder
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, solve_banded
from eomcheck.numbers.batch_arrays import (
    BatchArray,
    NoiseBatch,
    PackedRecord,
    as_float64,
    batch_size,
    packed_entries,
)
from eomcheck.numbers.generic import FLOAT64, Angles, Array, RecordingArithmetic, map_record
from eomcheck.numbers.linear import PRODUCTS, SOLVERS, matrix_product, solve
from eomcheck.numbers.noise import NORMAL
from eomcheck.numbers.tape import ADD, DIV, MUL, NEG, SUB, RecordedNumber

# ---- Trace keys ----------------------------------------------------------------------------------


def holds_float64(x: Any) -> bool:
    """Return whether x is a float64 array, or a batch of them."""
    return isinstance(x, BatchArray) or (isinstance(x, np.ndarray) and x.dtype == np.float64)


def trace_key(x: Any, inputs: list[Any]) -> Hashable:
    """Return the cache key of a trace for x, and append its float64 arrays, in order, to `inputs`.

    Args:
        x: an argument, or a record of them; arrays of objects hold literals, or entries of a batch.
        inputs: list to which arrays are appended.
    """
    kind = type(x)
    if kind is BatchArray:
        inputs.append(x)
        return x.data.shape[1:]
    if isinstance(x, tuple):
        return kind, *[trace_key(part, inputs) for part in x]
    if not isinstance(x, np.ndarray):
        return x
    if x.dtype == object:
        return trace_key(as_float64(x), inputs)
    if x.dtype == np.float64:
        inputs.append(x)
        return x.shape
    return x.shape, x.tobytes()


# ---- Traces --------------------------------------------------------------------------------------

CODES = {ADD: 0, SUB: 1, MUL: 2, DIV: 3, NEG: 4}
"""Codes of operations in a trace."""


LARGEST_TOTAL = 2**21
"""Largest number of values in all cached traces, not counting the newest trace."""

FEWEST_COMPILED = 128
"""Smallest number of operations for which a replay in machine code is faster than Python."""


class TraceRunner:
    """A runner of generic functions on float64 arrays, by replaying their cached traces.

    A trace is valid for all arguments of the same shapes: functions without a branch on a value
    perform the same operations on all numbers.
    """

    def __init__(self):
        self._known: dict[Hashable, _Trace | None] = {}
        self._size = 0
        self._lock = Lock()

    def run(self, noise: NoiseBatch | None, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of batches, each of its operations perturbed if there is noise.

        Matrices that it solves are perturbed by the noise of
        `eomcheck.numbers.linear.recording_solves`.

        Raises:
            TypeError: the function does more than rational operations and solves.
        """
        trace, inputs = self._trace_of(function, arguments)
        if trace is None:
            raise TypeError(f"{function.__qualname__} does more than rational operations")
        return trace.run(noise, inputs)

    def run_exact(self, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of float64 arrays, with the same bits as in Python.

        The sign of a zero alone may differ: a trace leaves x + 0 and 0 x out. Objects inside the
        function, such as dual numbers, cost nothing from the second call on. Python runs functions
        of few operations, functions that cannot be traced, and those whose result is not finite: a
        quotient by zero is NaN in a replay.
        """
        trace, inputs = self._trace_of(function, arguments)
        if trace is not None and len(trace.operations) >= FEWEST_COMPILED:
            result = trace.run(None, inputs)
            if _is_finite(result):
                return result
        return function(*arguments)

    def _trace_of(self, function: Callable, arguments: tuple) -> tuple[_Trace | None, list[Any]]:
        """Return the trace of a function, None if it cannot be traced, and its float64 inputs."""
        inputs: list[Any] = []
        key = function, *(trace_key(x, inputs) for x in arguments)
        try:
            return self._known[key], inputs
        except KeyError:
            trace = None
            # A user-supplied function may raise anything on numbers that are no float64. In Python
            # it raises again, or runs.
            with suppress(Exception):
                trace = _Trace(function, arguments)
            self._store(key, trace)
        return trace, inputs

    def _store(self, key: Hashable, trace: _Trace | None) -> None:
        with self._lock:
            before = self._known.pop(key, None)
            self._known[key] = trace
            self._size += (trace.size if trace else 0) - (before.size if before else 0)
            while self._size > LARGEST_TOTAL and len(self._known) > 1:
                evicted = self._known.pop(next(iter(self._known)))
                self._size -= evicted.size if evicted else 0


def _is_finite(record: Any) -> bool:
    if isinstance(record, tuple):
        return all(map(_is_finite, record))
    return record is None or bool(np.isfinite(record).all())


class _TraceGroup(NamedTuple):
    """A function of whole arrays, called after `after` operations.

    `arguments` and `results` are the indices of the values that it takes and returns.
    """

    after: int
    function: Callable
    arguments: PackedRecord
    results: Array


class _Trace:
    """A recorded trace: the operations of a function, one by one, on an array of values.

    The values are the float64 inputs, then literals and results in the order in which they occur.
    An operation is its code, the indices of its two operands, and the index of its result.
    """

    def __init__(self, function: Callable, arguments: tuple):
        self._operations, self._next = array("q"), count().__next__
        self.groups: list[_TraceGroup] = []
        self._literals: dict[float, int] = {}
        self.inputs = 0
        result = function(*map_record(self._inputs, arguments))
        self.results = PackedRecord(map_record(self._indices, result))
        self.size = self._next()
        self.start = np.empty(self.size)
        self.start[list(self._literals.values())] = list(self._literals)

    def _inputs(self, x: Any) -> Any:
        if isinstance(x, np.ndarray) and x.dtype == object:
            x = as_float64(x)
        if not holds_float64(x):
            return x
        numbers = self._numbers(x.shape)
        self.inputs += numbers.size
        return numbers

    def _numbers(self, shape: tuple[int, ...]) -> Array:
        numbers = np.empty(shape, object)
        numbers.ravel()[:] = [_TracedNumber(self, self._next()) for _ in range(numbers.size)]
        return numbers

    def _indices(self, part: Any) -> Array:
        part = np.asarray(part, object)
        indices = [x.index if type(x) is _TracedNumber else self.literal(x) for x in part.ravel()]
        return np.array(indices, np.intp).reshape(part.shape)

    def literal(self, x: float) -> int:
        """Return the index of a literal."""
        x = float(x)
        if x not in self._literals:
            self._literals[x] = self._next()
        return self._literals[x]

    def operated(self, operation: str, x: Any, y: Any) -> Any:
        """Return x `operation` y, one of them a literal or both numbers of this trace.

        Literals are integers. Nothing is recorded for x + 0, 0 x and 1 x, which round nothing.
        """
        literal, number = (x, y) if type(x) is int else (y, x)
        if type(number) is not _TracedNumber or type(literal) not in (int, _TracedNumber):
            return NotImplemented
        if type(literal) is int:
            if literal == 0 and (operation == ADD or (operation == SUB and literal is y)):
                return number
            if operation == MUL and literal in (0, 1):
                return number if literal else 0
            if operation == SUB and literal is x:
                return -y + x
        first, second = (
            z.index if isinstance(z, _TracedNumber) else self.literal(z) for z in (x, y)
        )
        return self._add(operation, first, second)

    def negated(self, x: _TracedNumber) -> _TracedNumber:
        """Return -x."""
        return self._add(NEG, x.index, x.index)

    def _add(self, operation: str, x: int, y: int) -> _TracedNumber:
        """Return the result of an operation on the values at the indices x and y."""
        index = self._next()
        self._operations.extend((CODES[operation], x, y, index))
        return _TracedNumber(self, index)

    def group(self, function: Callable, shape: tuple[int, ...], *arrays: Array) -> Array:
        """Return the result, of this shape, of a function of float64 arrays."""
        arguments, numbers = PackedRecord(tuple(map(self._indices, arrays))), self._numbers(shape)
        after = len(self._operations) // 4
        self.groups.append(_TraceGroup(after, function, arguments, self._indices(numbers)))
        return numbers

    @property
    def operations(self) -> Array:
        """Operations (k, 4): code, indices of operands and result, see the class."""
        return np.frombuffer(self._operations, np.int64).reshape(-1, 4)

    def run(self, noise: NoiseBatch | None, inputs: list[Any]) -> Any:
        """Return the function's result for inputs of the same shapes, float64 arrays or batches."""
        values, done = _Values(self, noise, inputs), 0
        for after, function, arguments, results in self.groups:
            values.replay(done, after)
            done = after
            values.put(results, function(*values.take(arguments, noise)))
        values.replay(done, len(self._operations) // 4)
        return values.take(self.results)


class _Values:
    """The values of a trace while it is replayed, of each element of a batch.

    The samples of one state are the SIMD lanes of one part, and so are states without noise. The
    samples of several states are a part each, its states the lanes: each part has one perturbation
    of an operation, or one per lane.
    """

    def __init__(self, trace: _Trace, noise: NoiseBatch | None, inputs: list[Any]):
        self.count = batch_size(inputs) if noise is None else noise.count
        data = packed_entries(inputs, self.count or 1)
        self.trace, self.noise = trace, noise
        self.parts, self.inside = 1, len(data)
        if noise is not None and noise.states > 1:
            self.parts, self.inside = len(data) // noise.states, noise.states
        self.lanes = LANES if self.count else 1
        width = -(-self.inside // self.lanes) * self.lanes
        self.values = np.empty((trace.size, self.parts, width))
        self.values[trace.inputs :] = trace.start[trace.inputs :, None, None]
        self._write(slice(trace.inputs), data)

    def _write(self, where: Any, data: Array) -> None:
        """Write data (B, n) to n indices; lanes that are left over hold copies of the last one."""
        values = data.T.reshape(data.shape[1], self.parts, self.inside)
        self.values[where, :, : self.inside] = values
        if self.inside < self.values.shape[-1]:
            self.values[where, :, self.inside :] = values[..., -1:]

    def put(self, indices: Array, x: Any) -> None:
        """Write an array, or a batch of them."""
        data = x.data if isinstance(x, BatchArray) else x
        self._write(indices.reshape(-1), data.reshape(self.parts * self.inside, indices.size))

    def take(self, record: PackedRecord, noise: NoiseBatch | None = None) -> Any:
        """Return a record of values as arrays; of a batch as batches, which `noise` perturbs."""
        values = self.values[record.indices, :, : self.inside]
        rows = np.ascontiguousarray(values.reshape(len(record.indices), self.parts * self.inside).T)
        return record.split(rows, bool(self.count), noise)

    def replay(self, first: int, last: int) -> None:
        """Perform the operations from `first` up to `last`."""
        count = last - first
        if not count:
            return
        address, _ = self.trace._operations.buffer_info()
        operations = address + 4 * self.trace._operations.itemsize * first
        run, width = _replay_function(self.lanes, self.noise is not None), self.values.shape[-1]
        row = self.parts * width
        draws = None if self.noise is None else self.noise.draws(count)
        for part in range(self.parts):
            changes = 0
            if draws is not None:
                own = draws.T if self.parts == 1 else draws[part, :, None]
                lanes = np.minimum(np.arange(LANES), own.shape[1] - 1)
                spread = own.take(lanes, axis=1)
                changes = spread.ctypes.data
            values = self.values.ctypes.data + 8 * width * part
            run(count, operations, values, width // self.lanes, row, changes)


class _TracedNumber(RecordedNumber):
    """A number of a trace; its tape is the trace, its index that of its value."""

    __slots__ = ()
    tape: _Trace


def trace_of(*arrays: Array) -> _Trace | None:
    """Return the trace to which entries of arrays belong, None if there is none."""
    return next(
        (x.tape for x in chain(*(a.flat for a in arrays)) if type(x) is _TracedNumber), None
    )


def _require_trace(*arrays: Array) -> _Trace:
    trace = trace_of(*arrays)
    assert trace is not None, "no entry is of a trace"
    return trace


def _traced_solver(solver: Callable) -> Callable:
    def solve_traced(A: Array, b: Array, name: str) -> Array:
        return _require_trace(A, b).group(partial(solver, name=name), b.shape, A, b)

    return solve_traced


def _traced_product(A: Array, B: Array) -> Array:
    return _require_trace(A, B).group(matrix_product, (A.shape[0], B.shape[1]), A, B)


SOLVERS[_TracedNumber], BANDED_SOLVERS[_TracedNumber] = (
    _traced_solver(solve),
    _traced_solver(solve_banded),
)
PRODUCTS[_TracedNumber] = _traced_product


@cache
def _replay_function(lanes: int, perturbed: bool) -> Callable[..., None]:
    """Return the C function that replays operations on `lanes` values at a time.

    Its arguments are the number of operations, the addresses of operations and values, the number
    of vectors of lanes, the number of values by index, and the address of the changes (_, lanes).
    """
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.llvm import JitModule

    code = IRBuilder()
    wide = code.wider(lanes)
    with code.loop("%count") as turn:
        first = code.address("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *indices = (
            code.let(f"load i64, ptr {code.address(first, i, 'i64')}") for i in range(4)
        )
        x, y, to = (code.address("%values", code.integer("mul", i, "%row")) for i in indices)
        change = ""
        if perturbed:
            change = wide.load("%changes", turn.i)
        for name, number in zip(("add", "sub", "mul", "div", "neg"), CODES.values(), strict=True):
            is_this = code.let(f"icmp eq i64 {operation}, {number}")
            with code.when(is_this), code.loop("%many") as vector:
                a = wide.load(x, vector.i)
                if number == CODES[NEG]:
                    result = wide.neg(a)
                else:
                    b = wide.load(y, vector.i)
                    result = getattr(wide, name)(a, b)
                    if number == CODES[DIV]:
                        zero = wide.compare("oeq", b, wide.constant(0.0))
                        result = wide.choose(zero, wide.constant(float("nan")), result)
                    if perturbed:
                        # Perturbed as by `Noise.perturb`.
                        size = wide.call("maxnum", wide.call("fabs", result), wide.constant(NORMAL))
                        result = wide.add(result, wide.mul(change, size))
                wide.store(result, to, vector.i)
    head = "i64 %count, ptr %operations, ptr %values, i64 %many, i64 %row, ptr %changes"
    machine = JitModule([code.function(f"define void @replay({head})")])
    integer, pointer = ctypes.c_int64, ctypes.c_void_p
    kinds = integer, pointer, pointer, integer, integer, pointer
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address("replay"))
    function.machine = machine  # keeps the machine code alive
    return function


# ---- Sines, cosines and roots of a scene ---------------------------------------------------------


@lru_cache(256)
def traceable_prepare(prepare: Callable) -> Callable[[Any, Array, Array], tuple[Any, tuple]]:
    """Return a traceable function of (parameters, q, t), with t (1,), for a scene's `prepare`.

    It returns the precomputed values, and the angles and roots they are made of, in order.
    """

    def prepared(parameters: Any, q: Array, t: Array) -> tuple[Any, tuple]:
        recorder = RecordingArithmetic(_TracingArithmetic())
        return prepare(recorder, parameters, q, t[0]), tuple(recorder.recorded)

    return prepared


class _TracingArithmetic:
    """The arithmetic of traced numbers (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Array) -> Array:
        """Return x unchanged."""
        return x

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), with cosines and sines as results of a group."""
        trace = trace_of(x)
        if trace is None:
            return FLOAT64.angles(x)
        cos, sin = trace.group(_cos_and_sin, (2, *x.shape), x)
        return Angles(x, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,), as results of a group."""
        trace = trace_of(x)
        return FLOAT64.root(FLOAT64.numbers(x)) if trace is None else trace.group(_root, x.shape, x)


def _cos_and_sin(x: Any) -> Any:
    with np.errstate(invalid="ignore"):
        return np.stack((np.cos(x), np.sin(x)))


def _root(x: Any) -> Any:
    with np.errstate(invalid="ignore"):
        return np.sqrt(x)
