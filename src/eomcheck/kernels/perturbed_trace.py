"""Traces of generic functions, replayed with perturbed operations (Monte Carlo arithmetic).

A function is run once on numbers that record their operations; the trace is kept under the shapes
of its arguments (the trace key) and replayed in machine code, many times: as it is, with a random
relative perturbation of every operation, or on a batch of states, one per SIMD lane, operation by
operation. In Python these replays would take most of the time.

Unlike on a tape (`eomcheck.numbers.tape`) no operations are merged, because each is perturbed by
itself, and none is left out but those that round nothing: x + 0, 0 x and 1 x. Products and solves
of matrices, sines, cosines and square roots are groups between stretches of the trace, computed as
in float64.

`traceable_prepare` traces the function by which a scene precomputes sines, cosines and square
roots, so
that the operations between them are perturbed: where 1 - cos² nearly cancels, the digits of its
square root are lost before the root is taken.
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
from eomcheck.kernels.llvm_builder import LANES, IRBuilder
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, solve_banded
from eomcheck.numbers.dual import RecordingArithmetic
from eomcheck.numbers.generic import BRANCH, FLOAT64, Angles, Array, NotRationalError, map_record
from eomcheck.numbers.lanes import LaneArray, lane_data, lanes_in
from eomcheck.numbers.linear import PRODUCTS, SOLVERS, matrix_product, solve
from eomcheck.numbers.noise import NORMAL, Noise
from eomcheck.numbers.pivots import SMALLEST_SIZE

# ---- Trace keys ----------------------------------------------------------------------------------


def holds_float64(x: Any) -> bool:
    """Return whether x is an array of doubles, or of lanes."""
    return isinstance(x, LaneArray) or (isinstance(x, np.ndarray) and x.dtype == np.float64)


def trace_key(x: Any, front: int, doubles: list[Array]) -> Hashable:
    """Return what a list of operations depends on; add arrays of doubles, in order, to `doubles`.

    Args:
        x: an argument, or a record of them.
        front: axes in front that do not belong to it, see `Noise.shape`.
        doubles: where to.
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
"""Records that are remembered: of one state several functions read the same ones many times."""


class TraceKeyCache:
    """Records of arrays that were gathered, with what `trace_key` found in each."""

    def __init__(self):
        self._found: dict[tuple[int, int], tuple[tuple, Hashable, list[Array]]] = {}

    def key(self, x: Any, front: int, doubles: list[Array]) -> Hashable:
        """Return what a list of operations depends on, see `trace_key`; a record is read once."""
        if not isinstance(x, tuple):
            return trace_key(x, front, doubles)
        place = id(x), front
        known = self._found.get(place)
        if known is None or known[0] is not x:
            mine: list[Array] = []
            known = x, trace_key(x, front, mine), mine
            if len(self._found) >= RECORDS:
                self._found.clear()
            self._found[place] = known
        doubles += known[2]
        return known[1]


# ---- Traces --------------------------------------------------------------------------------------

ADD, SUB, MUL, DIV, NEG = range(5)


LARGEST_TOTAL = 2**21
"""Places in all lists that are kept, but for the newest list."""

FEWEST_COMPILED = 128
"""Operations that Python does in less time than it takes to have them done in machine code."""


class _NoNoise(Noise):
    """The noise that moves nothing."""

    def changes(self, shape: tuple[int, ...]) -> Array:
        return np.zeros(shape)


NO_NOISE = _NoNoise(0)


class TraceRunner:
    """Runs generic functions on doubles with every operation moved.

    What was listed is kept for further runs, with arguments of the same shapes: functions without a
    branch on a value do the same with all numbers.
    """

    def __init__(self):
        self._known: dict[Hashable, _Trace | None] = {}
        self._places = 0
        self._seen = TraceKeyCache()
        self._lock = Lock()

    def run(self, noise: Noise, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of arrays of doubles, each of its operations moved.

        Matrices that it solves are moved by the noise of
        `eomcheck.numbers.linear.recording_solves`. Of several noises the first axis of every array
        of doubles is theirs.

        Raises:
            TypeError: the function does more than rational operations and solves.
        """
        listed, doubles = self._trace_of(function, arguments, len(noise.shape))
        return _require_traceable(function, listed).run(noise, doubles)

    def run_exact(self, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of arrays of doubles as it is, with the bits that Python gives.

        What it makes of objects on the way, such as dual numbers, costs nothing the second time.
        Python does what has few operations, what cannot be listed, and what is not finite: a
        quotient by zero is no number in a list.
        """
        listed, doubles = None, []
        with suppress(Exception):  # what raises there need not raise on doubles
            listed, doubles = self._trace_of(function, arguments, 0)
        if listed is not None and len(listed.operations) >= FEWEST_COMPILED:
            found = listed.run(NO_NOISE, doubles)
            if _is_finite(found):
                return found
        return function(*arguments)

    def _trace_of(
        self, function: Callable, arguments: tuple, front: int
    ) -> tuple[_Trace | None, list[Any]]:
        """Return the list of a function, None if there is none, and the doubles that it reads."""
        doubles: list[Any] = []
        key = function, *(self._seen.key(x, front, doubles) for x in arguments)
        try:
            return self._known[key], doubles
        except KeyError:
            listed = None
            with suppress(TypeError):
                listed = _Trace(function, arguments, front)
            self._keep(key, listed)
        return listed, doubles

    def _keep(self, key: Hashable, listed: _Trace | None) -> None:
        with self._lock:
            before = self._known.pop(key, None)
            self._known[key] = listed
            self._places += (listed.size if listed else 0) - (before.size if before else 0)
            while self._places > LARGEST_TOTAL and len(self._known) > 1:
                forgotten = self._known.pop(next(iter(self._known)))
                self._places -= forgotten.size if forgotten else 0

    def run_in_lanes(self, noise: Noise | None, function: Callable, *arguments: Any) -> Any:
        """Call a generic function of lanes, each of its operations moved if there is noise.

        Raises:
            TypeError: as `run`.
        """
        # What it solves is registered there; LLVM takes longer to import than the package.
        from eomcheck.kernels import batched_solves  # noqa: F401

        listed, doubles = self._trace_of(function, arguments, 0)
        return replay_in_lanes(_require_traceable(function, listed), noise, doubles)


def _require_traceable(function: Callable, listed: _Trace | None) -> _Trace:
    if listed is None:
        raise TypeError(f"{function.__qualname__} does more than rational operations")
    return listed


def _is_finite(record: Any) -> bool:
    if isinstance(record, tuple):
        return all(map(_is_finite, record))
    return record is None or bool(np.isfinite(record).all())


class _TraceGroup(NamedTuple):
    """What is done with whole matrices: after how many operations, and where they stand."""

    after: int
    function: Callable
    read: list[Array]
    found: Array


class _Trace:
    """What a function does, operation by operation.

    Places are those of the doubles that it reads, then of literals and results as they come. An
    operation has its number, the places of what it reads, and that of its result.
    """

    def __init__(self, function: Callable, arguments: tuple, front: int):
        self._operations, self._next = array("q"), count().__next__
        self.groups: list[_TraceGroup] = []
        self._literals: dict[float, int] = {}
        self.read = 0
        found = function(*map_record(lambda x: self._inputs(x, front), arguments))
        self.found = map_record(self._indices, found)
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
        places = [x.index if type(x) is _TracedNumber else self.literal(x) for x in part.ravel()]
        return np.array(places, np.intp).reshape(part.shape)

    def literal(self, x: float) -> int:
        """Return the place of a literal."""
        x = float(x)
        if x not in self._literals:
            self._literals[x] = self._next()
        return self._literals[x]

    def add(self, operation: int, x: int, y: int) -> _TracedNumber:
        """Return the result of an operation on what is at these places."""
        place = self._next()
        self._operations.extend((operation, x, y, place))
        return _TracedNumber(place, self)

    def group(self, function: Callable, shape: tuple[int, ...], *arrays: Array) -> Array:
        """Return the result, of this shape, of a function of arrays of doubles."""
        read, numbers = [self._indices(x) for x in arrays], self._numbers(shape)
        after = len(self._operations) // 4
        self.groups.append(_TraceGroup(after, function, read, self._indices(numbers)))
        return numbers

    @property
    def operations(self) -> Array:
        """Operations (k, 4): see the class."""
        return np.frombuffer(self._operations, np.int64).reshape(-1, 4)

    def run(self, noise: Noise, doubles: list[Array]) -> Any:
        """Return the function's result, arrays of doubles, of arguments of the same shapes."""
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
                *(noise.as_perturbed(values.take(places, axis=-1)) for places in read)
            )
            values[..., found] = result
        self._replay(noise, values, done, len(self._operations) // 4)
        return map_record(lambda places: values.take(places, axis=-1), self.found)

    def _replay(self, noise: Noise, values: Array, first: int, last: int) -> int:
        """Do the operations from `first` up to `last` on the doubles at their places."""
        count = last - first
        if count:
            operations, _ = self._operations.buffer_info()
            operations += 4 * self._operations.itemsize * first
            changes = np.ascontiguousarray(noise.changes((*noise.shape, count)))
            at, to, run = changes.ctypes.data, values.ctypes.data, _replay_function()
            for i in range(values.size // self.size):
                own, there = at + 8 * count * i, to + 8 * self.size * i
                run(count, operations, own, there)
        return last


class _TracedNumber:
    """A double at a place of a list, to which its operations are added."""

    __slots__ = ("index", "trace")

    def __init__(self, place: int, list: _Trace):
        self.index, self.trace = place, list

    # An array must not be taken for a number: `NotImplemented` lets numpy go through its entries.

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
    """Return the list to which entries of arrays belong, None if none does to any."""
    return next(
        (x.trace for x in chain(*(a.flat for a in arrays)) if type(x) is _TracedNumber), None
    )


def _require_trace(*arrays: Array) -> _Trace:
    found = trace_of(*arrays)
    assert found is not None, "no entry is of a list"
    return found


def _traced_solver(solver: Callable) -> Callable:
    def listed(A: Array, b: Array, name: str) -> Array:
        return _require_trace(A, b).group(partial(solver, name=name), b.shape, A, b)

    return listed


def _traced_product(A: Array, B: Array) -> Array:
    return _require_trace(A, B).group(matrix_product, (A.shape[0], B.shape[1]), A, B)


SOLVERS[_TracedNumber], BANDED_SOLVERS[_TracedNumber] = (
    _traced_solver(solve),
    _traced_solver(solve_banded),
)
PRODUCTS[_TracedNumber] = _traced_product


@cache
def _replay_function() -> Callable[[int, int, int, int], None]:
    """Return what goes through `count` operations with changes and values at these addresses."""
    # Not before it is needed: LLVM takes longer to import than the package.
    from eomcheck.kernels.jit import JitModule

    code = IRBuilder()
    with code.loop("%count") as turn:
        first = code.address("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *places, place = (
            code.let(f"load i64, ptr {code.address(first, i, 'i64')}") for i in range(4)
        )
        x, y = (code.load("%values", place) for place in places)
        quotient = code.choose(
            code.compare("oeq", y, code.constant(0.0)),
            code.constant(float("nan")),
            code.div(x, y),
        )
        rounded = code.add(x, y)
        is_one = partial("icmp eq i64 {}, {}".format, operation)
        for number, result in (
            (SUB, code.sub(x, y)),
            (MUL, code.mul(x, y)),
            (DIV, quotient),
        ):
            rounded = code.choose(code.let(is_one(number)), result, rounded)
        # As `Noise.perturb` moves them.
        size = code.call("maxnum", code.call("fabs", rounded), code.constant(NORMAL))
        change = code.mul(code.load("%changes", turn.i), size)
        moved = code.add(rounded, change)
        code.store(
            code.choose(code.let(is_one(NEG)), code.neg(x), moved),
            "%values",
            place,
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
    function.machine = machine  # its address holds as long as this lives
    return function


# ---- Replay on a batch of states -----------------------------------------------------------------


def replay_in_lanes(listed: _Trace, noise: Noise | None, given: list[Any]) -> Any:
    """Return what a list comes to for arguments in lanes, its results without noise."""
    count = next(n for n in map(lanes_in, given) if n)
    width = -(-count // LANES) * LANES
    values = np.zeros((listed.size, width))
    values[listed.read :] = listed.start[listed.read :, None]
    first = 0
    for x in given:
        data = lane_data(x, count).reshape(-1, count)
        values[first : first + len(data), :count] = data
        first += len(data)
    done, last = 0, len(listed.operations)
    for after, function, read, found in listed.groups:
        _replay(listed, noise, values, done, after)
        done = after
        result = function(*(LaneArray(values[places, :count], noise) for places in read))
        values[found, :count] = lane_data(result, count)
    _replay(listed, noise, values, done, last)
    return map_record(lambda places: LaneArray(values[places, :count]), listed.found)


def _replay(listed: _Trace, noise: Noise | None, values: Array, first: int, last: int) -> None:
    count = last - first
    if not count:
        return
    operations = np.ascontiguousarray(listed.operations[first:last])
    given = count, operations.ctypes.data, values.ctypes.data, values.shape[1] // LANES
    if noise is None:
        _lane_replay_function(moved=False)(*given, 0)
        return
    changes = np.ascontiguousarray(noise.changes((count,)))
    _lane_replay_function(moved=True)(*given, changes.ctypes.data)


@cache
def _lane_replay_function(moved: bool) -> Callable[[int, int, int, int, int], None]:
    """Return what goes through operations on values (places, lanes), `many` vectors of lanes."""
    from eomcheck.kernels.jit import JitModule

    code = IRBuilder()
    wide = code.wider(LANES)
    with code.loop("%count") as turn:
        first = code.address("%operations", code.integer("mul", turn.i, 4), "i64")
        operation, *places = (
            code.let(f"load i64, ptr {code.address(first, i, 'i64')}") for i in range(4)
        )
        row = code.integer("mul", "%many", LANES)
        x, y, to = (code.address("%values", code.integer("mul", place, row)) for place in places)
        change = ""
        if moved:
            one = code.load("%changes", turn.i)
            change = wide.packed([one])
        for number, name in enumerate(("add", "sub", "mul", "div", "neg")):
            is_this = code.let(f"icmp eq i64 {operation}, {number}")
            with code.when(is_this), code.loop("%many") as vector:
                a = wide.load(x, vector.i)
                if number == NEG:
                    result = wide.neg(a)
                else:
                    b = wide.load(y, vector.i)
                    result = getattr(wide, name)(a, b)
                    if number == DIV and moved:
                        zero = wide.compare("oeq", b, wide.constant(0.0))
                        result = wide.choose(zero, wide.constant(float("nan")), result)
                    if moved:
                        # As `LaneNoise.perturb` moves them.
                        largest = wide.call("fabs", result)
                        normal = wide.compare("oge", largest, wide.constant(NORMAL))
                        size = wide.choose(normal, largest, wide.constant(SMALLEST_SIZE))
                        result = wide.add(result, wide.mul(change, size))
                wide.store(result, to, vector.i)
    name = "moved_lanes" if moved else "lanes"
    head = "i64 %count, ptr %operations, ptr %values, i64 %many, ptr %changes"
    machine = JitModule([code.function(f"define void @{name}({head})")])
    kinds = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds)(machine.address(name))
    function.machine = machine  # its address holds as long as this lives
    return function


# ---- Sines, cosines and roots of a scene ---------------------------------------------------------


@lru_cache(256)
def traceable_prepare(prepare: Callable) -> Callable[[Any, Array, Array], tuple[Any, tuple]]:
    """Return a function of (parameters, q, t), with t (1,), that can be listed.

    It returns what `prepare` does, and the angles and roots that were made on the way, in order.
    """

    def prepared(parameters: Any, q: Array, t: Array) -> tuple[Any, tuple]:
        recorder = RecordingArithmetic(_TracingArithmetic())
        return prepare(recorder, parameters, q, t[0]), tuple(recorder.recorded)

    return prepared


class _TracingArithmetic:
    """The arithmetic of a list of operations (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Array) -> Array:
        """Return x as it is."""
        return x

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), with cosines and sines that the list finds."""
        listed = trace_of(x)
        if listed is None:
            return FLOAT64.angles(x)
        cos, sin = listed.group(_cos_and_sin, (2, *x.shape), x)
        return Angles(x, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,), which the list finds."""
        listed = trace_of(x)
        return (
            FLOAT64.root(FLOAT64.numbers(x)) if listed is None else listed.group(_root, x.shape, x)
        )


def _cos_and_sin(x: Any) -> Any:
    cos, sin = _rounded(np.cos, x), _rounded(np.sin, x)
    if isinstance(x, LaneArray):
        return LaneArray(np.stack((cos.data, sin.data)))
    return np.stack((cos, sin), axis=-2)


def _root(x: Any) -> Any:
    return _rounded(np.sqrt, x)


def _rounded(function: Callable, x: Any) -> Any:
    """Return the function of each entry, moved by the noise of the array if it has any."""
    with np.errstate(invalid="ignore"):
        lanes = isinstance(x, LaneArray)
        found: Any = LaneArray(function(x.data)) if lanes else function(np.asarray(x))
    return found if x.noise is None else x.noise.perturb(found)
