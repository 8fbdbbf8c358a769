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

from eomcheck.kernels import perturbed_solves  # noqa: F401  (perturbed matrices are solved by it)
from eomcheck.kernels.llvm import LANES, IRBuilder
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, solve_banded
from eomcheck.numbers.dual import RecordingArithmetic
from eomcheck.numbers.generic import BRANCH, FLOAT64, Angles, Array, NotRationalError, map_record
from eomcheck.numbers.lanes import LaneArray, lane_data, lanes_in
from eomcheck.numbers.linear import PRODUCTS, SOLVERS, matrix_product, solve
from eomcheck.numbers.noise import NORMAL, Noise
from eomcheck.numbers.pivots import SMALLEST_SIZE

# ---- Trace keys ----------------------------------------------------------------------------------


def holds_float64(x: Any) -> bool:
    """Return whether x is a float64 array, or one of lanes."""
    return isinstance(x, LaneArray) or (isinstance(x, np.ndarray) and x.dtype == np.float64)


def trace_key(x: Any, front: int, doubles: list[Array]) -> Hashable:
    """Return the cache key of a trace for x, and append its float64 arrays, in order, to `doubles`.

    Args:
        x: an argument, or a record of them.
        front: number of leading batch axes, which are not in the key, see `Noise.shape`.
        doubles: list to which arrays are appended.
    """
    if holds_float64(x):
        doubles.append(x)
        return x.shape[front:]
    if isinstance(x, np.ndarray):
        return x.shape, x.tobytes()
    if isinstance(x, tuple):
        return type(x), *[trace_key(part, front, doubles) for part in x]
    return x


RECORDS = 64
"""Largest number of cached records: functions of one state read the same records many times."""


class TraceKeyCache:
    """Cache of `trace_key` and float64 arrays by record."""

    def __init__(self):
        self._found: dict[tuple[int, int], tuple[tuple, Hashable, list[Array]]] = {}

    def key(self, x: Any, front: int, doubles: list[Array]) -> Hashable:
        """Return the cache key of a trace for x, see `trace_key`; a record is traversed once."""
        if not isinstance(x, tuple):
            return trace_key(x, front, doubles)
        identity = id(x), front
        known = self._found.get(identity)
        if known is None or known[0] is not x:
            arrays: list[Array] = []
            known = x, trace_key(x, front, arrays), arrays
            if len(self._found) >= RECORDS:
                self._found.clear()
            self._found[identity] = known
        doubles += known[2]
        return known[1]


# ---- Traces --------------------------------------------------------------------------------------

ADD, SUB, MUL, DIV, NEG = range(5)


LARGEST_TOTAL = 2**21
"""Largest number of values in all cached traces, not counting the newest trace."""

FEWEST_COMPILED = 128
"""Smallest number of operations for which a replay in machine code is faster than Python."""


class _NoNoise(Noise):
    """A noise whose perturbations are 0."""

    def changes(self, shape: tuple[int, ...]) -> Array:
        return np.zeros(shape)


NO_NOISE = _NoNoise(0)


class TraceRunner:
    """A runner of generic functions on float64 arrays, by replaying their cached traces.

    A trace is valid for all arguments of the same shapes: functions without a branch on a value
    perform the same operations on all numbers.
    """

    def __init__(self):
        self._known: dict[Hashable, _Trace | None] = {}
        self._places = 0
        self._seen = TraceKeyCache()
        self._lock = Lock()

    def run(self, noise: Noise, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of float64 arrays with each of its operations perturbed.

        Matrices that it solves are perturbed by the noise of
        `eomcheck.numbers.linear.recording_solves`. With a `NoiseBatch` the first axis of every
        float64 array is the batch axis.

        Raises:
            TypeError: the function does more than rational operations and solves.
        """
        trace, inputs = self._trace_of(function, arguments, len(noise.shape))
        return _require_traceable(function, trace).run(noise, inputs)

    def run_exact(self, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of float64 arrays unperturbed, with the same bits as in Python.

        Objects inside the function, such as dual numbers, cost nothing from the second call on.
        Python runs functions of few operations, functions that cannot be traced, and those whose
        result is not finite: a quotient by zero is NaN in a replay.
        """
        trace, inputs = None, []
        with suppress(Exception):  # a function that raises on traced numbers may run on float64
            trace, inputs = self._trace_of(function, arguments, 0)
        if trace is not None and len(trace.operations) >= FEWEST_COMPILED:
            result = trace.run(NO_NOISE, inputs)
            if _is_finite(result):
                return result
        return function(*arguments)

    def _trace_of(
        self, function: Callable, arguments: tuple, front: int
    ) -> tuple[_Trace | None, list[Any]]:
        """Return the trace of a function, None if it cannot be traced, and its float64 inputs."""
        inputs: list[Any] = []
        key = function, *(self._seen.key(x, front, inputs) for x in arguments)
        try:
            return self._known[key], inputs
        except KeyError:
            trace = None
            with suppress(TypeError):
                trace = _Trace(function, arguments, front)
            self._store(key, trace)
        return trace, inputs

    def _store(self, key: Hashable, trace: _Trace | None) -> None:
        with self._lock:
            before = self._known.pop(key, None)
            self._known[key] = trace
            self._places += (trace.size if trace else 0) - (before.size if before else 0)
            while self._places > LARGEST_TOTAL and len(self._known) > 1:
                evicted = self._known.pop(next(iter(self._known)))
                self._places -= evicted.size if evicted else 0

    def run_in_lanes(self, noise: Noise | None, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of lanes, each of its operations perturbed if there is noise.

        Raises:
            TypeError: as `run`.
        """
        # Registers solvers for lanes; not before, for LLVM takes longer to import than the package.
        from eomcheck.kernels import batched_solves  # noqa: F401

        trace, inputs = self._trace_of(function, arguments, 0)
        return replay_in_lanes(_require_traceable(function, trace), noise, inputs)


def _require_traceable(function: Callable, trace: _Trace | None) -> _Trace:
    if trace is None:
        raise TypeError(f"{function.__qualname__} does more than rational operations")
    return trace


def _is_finite(record: Any) -> bool:
    if isinstance(record, tuple):
        return all(map(_is_finite, record))
    return record is None or bool(np.isfinite(record).all())


class _TraceGroup(NamedTuple):
    """A function of whole arrays, called after `after` operations, and indices of its values."""

    after: int
    function: Callable
    read: list[Array]
    found: Array


class _Trace:
    """A recorded trace: the operations of a function, one by one, on an array of values.

    The values are the float64 inputs, then literals and results in the order in which they occur.
    An operation is its code, the indices of its two operands, and the index of its result.
    """

    def __init__(self, function: Callable, arguments: tuple, front: int):
        self._operations, self._next = array("q"), count().__next__
        self.groups: list[_TraceGroup] = []
        self._literals: dict[float, int] = {}
        self.read = 0
        result = function(*map_record(lambda x: self._inputs(x, front), arguments))
        self.found = map_record(self._indices, result)
        self.size = self._next()
        self.start = np.empty(self.size)
        self.start[list(self._literals.values())] = list(self._literals)

    def _inputs(self, x: Any, front: int) -> Any:
        if not holds_float64(x):
            return x
        numbers = self._numbers(x.shape[front:])
        self.read += numbers.size
        return numbers

    def _numbers(self, shape: tuple[int, ...]) -> Array:
        numbers = np.empty(shape, object)
        numbers.ravel()[:] = [_TracedNumber(self._next(), self) for _ in range(numbers.size)]
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

    def add(self, operation: int, x: int, y: int) -> _TracedNumber:
        """Return the result of an operation on the values at the indices x and y."""
        index = self._next()
        self._operations.extend((operation, x, y, index))
        return _TracedNumber(index, self)

    def group(self, function: Callable, shape: tuple[int, ...], *arrays: Array) -> Array:
        """Return the result, of this shape, of a function of float64 arrays."""
        read, numbers = [self._indices(x) for x in arrays], self._numbers(shape)
        after = len(self._operations) // 4
        self.groups.append(_TraceGroup(after, function, read, self._indices(numbers)))
        return numbers

    @property
    def operations(self) -> Array:
        """Operations (k, 4): code, indices of operands and result, see the class."""
        return np.frombuffer(self._operations, np.int64).reshape(-1, 4)

    def run(self, noise: Noise, doubles: list[Array]) -> Any:
        """Return the function's result, in float64 arrays, for arguments of the same shapes."""
        front = noise.shape
        values = np.empty((*front, self.size))
        values[...] = self.start
        if doubles:
            flat = [x.reshape(*front, -1) for x in doubles]
            np.concatenate(flat, axis=-1, out=values[..., : self.read])
        done = 0
        for after, function, read, found in self.groups:
            done = self._replay(noise, values, done, after)
            result = function(
                *(noise.as_perturbed(values.take(indices, axis=-1)) for indices in read)
            )
            values[..., found] = result
        self._replay(noise, values, done, len(self._operations) // 4)
        return map_record(lambda indices: values.take(indices, axis=-1), self.found)

    def _replay(self, noise: Noise, values: Array, first: int, last: int) -> int:
        """Perform the operations from `first` up to `last` on the values, and return `last`."""
        count = last - first
        if count:
            operations, _ = self._operations.buffer_info()
            operations += 4 * self._operations.itemsize * first
            changes = np.ascontiguousarray(noise.changes((*noise.shape, count)))
            changes_at, values_at = changes.ctypes.data, values.ctypes.data
            run = _replay_function()
            for i in range(values.size // self.size):
                run(count, operations, changes_at + 8 * count * i, values_at + 8 * self.size * i)
        return last


class _TracedNumber:
    """A number of a trace, which records the operations on it.

    Attributes:
        index: index of its value.
        trace: the trace.
    """

    __slots__ = ("index", "trace")

    def __init__(self, index: int, trace: _Trace):
        self.index, self.trace = index, trace

    # `NotImplemented` for an array lets numpy apply the operation to its entries.

    def _with(self, operation: int, other: Any) -> Any:
        if type(other) is _TracedNumber:
            return self.trace.add(operation, self.index, other.index)
        if type(other) is int:
            return self.trace.add(operation, self.index, self.trace.literal(other))
        return NotImplemented

    def __add__(self, other):
        return self if type(other) is int and other == 0 else self._with(ADD, other)

    def __sub__(self, other):
        return self if type(other) is int and other == 0 else self._with(SUB, other)

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        if type(other) is int and other in (0, 1):
            return self if other else 0
        return self._with(MUL, other)

    def __truediv__(self, other):
        return self._with(DIV, other)

    def __rtruediv__(self, other):
        if type(other) is int:
            return self.trace.add(DIV, self.trace.literal(other), self.index)
        return NotImplemented

    def __neg__(self):
        return self.trace.add(NEG, self.index, self.index)

    def _compared(self, other=None):
        raise NotRationalError(BRANCH)

    __eq__ = __lt__ = __le__ = __gt__ = __ge__ = __bool__ = _compared
    __hash__ = None  # type: ignore[assignment]

    __radd__ = __add__
    __rmul__ = __mul__


def trace_of(*arrays: Array) -> _Trace | None:
    """Return the trace to which entries of arrays belong, None if there is none."""
    return next(
        (x.trace for x in chain(*(a.flat for a in arrays)) if type(x) is _TracedNumber), None
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
def _replay_function() -> Callable[[int, int, int, int], None]:
    """Return the C function (count, operations, changes, values) that replays operations."""
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.llvm import JitModule

    code = IRBuilder()
    with code.loop("%count") as turn:
        first = code.address("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *operands, target = (
            code.let(f"load i64, ptr {code.address(first, i, 'i64')}") for i in range(4)
        )
        x, y = (code.load("%values", index) for index in operands)
        quotient = code.choose(
            code.compare("oeq", y, code.constant(0.0)),
            code.constant(float("nan")),
            code.div(x, y),
        )
        rounded = code.add(x, y)
        is_operation = partial("icmp eq i64 {}, {}".format, operation)
        for number, result in (
            (SUB, code.sub(x, y)),
            (MUL, code.mul(x, y)),
            (DIV, quotient),
        ):
            rounded = code.choose(code.let(is_operation(number)), result, rounded)
        # Perturbed as by `Noise.perturb`.
        size = code.call("maxnum", code.call("fabs", rounded), code.constant(NORMAL))
        change = code.mul(code.load("%changes", turn.i), size)
        perturbed = code.add(rounded, change)
        code.store(
            code.choose(code.let(is_operation(NEG)), code.neg(x), perturbed),
            "%values",
            target,
        )
    machine = JitModule(
        [
            code.function(
                "define void @moved(i64 %count, ptr %operations, ptr %changes, ptr %values)"
            )
        ]
    )
    kinds = ctypes.c_int64, *[ctypes.c_void_p] * 3
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address("moved"))
    function.machine = machine  # keeps the machine code alive
    return function


# ---- Replay on a batch of states -----------------------------------------------------------------


def replay_in_lanes(trace: _Trace, noise: Noise | None, inputs: list[Any]) -> Any:
    """Return the results of a trace for arguments in lanes, as lanes without noise."""
    count = next(n for n in map(lanes_in, inputs) if n)
    width = -(-count // LANES) * LANES
    values = np.zeros((trace.size, width))
    values[trace.read :] = trace.start[trace.read :, None]
    first = 0
    for x in inputs:
        data = lane_data(x, count).reshape(-1, count)
        values[first : first + len(data), :count] = data
        first += len(data)
    done, last = 0, len(trace.operations)
    for after, function, read, found in trace.groups:
        _replay(trace, noise, values, done, after)
        done = after
        result = function(*(LaneArray(values[indices, :count], noise) for indices in read))
        values[found, :count] = lane_data(result, count)
    _replay(trace, noise, values, done, last)
    return map_record(lambda indices: LaneArray(values[indices, :count]), trace.found)


def _replay(trace: _Trace, noise: Noise | None, values: Array, first: int, last: int) -> None:
    count = last - first
    if not count:
        return
    operations = np.ascontiguousarray(trace.operations[first:last])
    arguments = count, operations.ctypes.data, values.ctypes.data, values.shape[1] // LANES
    if noise is None:
        _lane_replay_function(perturbed=False)(*arguments, 0)
        return
    changes = np.ascontiguousarray(noise.changes((count,)))
    _lane_replay_function(perturbed=True)(*arguments, changes.ctypes.data)


@cache
def _lane_replay_function(perturbed: bool) -> Callable[[int, int, int, int, int], None]:
    """Return the C function (count, operations, values, many, changes) that replays operations.

    Values are (indices, lanes), `many` vectors of lanes.
    """
    from eomcheck.kernels.llvm import JitModule

    code = IRBuilder()
    wide = code.wider(LANES)
    with code.loop("%count") as turn:
        first = code.address("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *indices = (
            code.let(f"load i64, ptr {code.address(first, i, 'i64')}") for i in range(4)
        )
        row = code.integer("mul", "%many", LANES)
        x, y, to = (code.address("%values", code.integer("mul", index, row)) for index in indices)
        change = ""
        if perturbed:
            change = wide.packed([code.load("%changes", turn.i)])
        for number, name in enumerate(("add", "sub", "mul", "div", "neg")):
            is_this = code.let(f"icmp eq i64 {operation}, {number}")
            with code.when(is_this), code.loop("%many") as vector:
                a = wide.load(x, vector.i)
                if number == NEG:
                    result = wide.neg(a)
                else:
                    b = wide.load(y, vector.i)
                    result = getattr(wide, name)(a, b)
                    if number == DIV and perturbed:
                        zero = wide.compare("oeq", b, wide.constant(0.0))
                        result = wide.choose(zero, wide.constant(float("nan")), result)
                    if perturbed:
                        # Perturbed as by `LaneNoise.perturb`.
                        largest = wide.call("fabs", result)
                        normal = wide.compare("oge", largest, wide.constant(NORMAL))
                        size = wide.choose(normal, largest, wide.constant(SMALLEST_SIZE))
                        result = wide.add(result, wide.mul(change, size))
                wide.store(result, to, vector.i)
    name = "perturbed_lanes" if perturbed else "lanes"
    head = "i64 %count, ptr %operations, ptr %values, i64 %many, ptr %changes"
    machine = JitModule([code.function(f"define void @{name}({head})")])
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address(name))
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
    cos, sin = _rounded(np.cos, x), _rounded(np.sin, x)
    if isinstance(x, LaneArray):
        return LaneArray(np.stack((cos.data, sin.data)))
    return np.stack((cos, sin), axis=-2)


def _root(x: Any) -> Any:
    return _rounded(np.sqrt, x)


def _rounded(function: Callable, x: Any) -> Any:
    """Return the function of each entry, perturbed by the noise of the array if it has any."""
    with np.errstate(invalid="ignore"):
        lanes = isinstance(x, LaneArray)
        result: Any = LaneArray(function(x.data)) if lanes else function(np.asarray(x))
    return result if x.noise is None else x.noise.perturb(result)
