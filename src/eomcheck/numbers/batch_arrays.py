"""Arrays over a batch of evaluations: the same source runs on all of them at once.

A `BatchArray` behaves as an array of the shape that its source knows, while every entry holds one
float64 per element of the batch: its data are (B, ...), the batch axis first. The elements are
states, perturbed samples of one state, or perturbed samples of several states (sample by sample).
Whole arrays are computed at once; if code builds arrays of its own, or differentiates, entries are
scalars like any other scalar type, in arrays of objects.

A `NoiseBatch` perturbs such arrays: the elements of a sample all by the same perturbations, those
that its noise would draw alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.numbers.generic import BRANCH, Angles, Array, NotRationalError, map_record
from eomcheck.numbers.noise import EXACT_UFUNCS, Noise, NoisePosition

# ---- Arrays --------------------------------------------------------------------------------------


class BatchArray:
    """An array with one float64 per element of a batch in each entry.

    Noise perturbs it as it does a `PerturbedArray`: the result of an operation on the whole array
    is perturbed; an entry that is taken out, or an array whose sign is changed, is not perturbed
    further.

    Args:
        data: float64 (B, *shape).
        noise: source of the perturbations of results; None for none.
    """

    __slots__ = ("data", "noise")
    __array_priority__ = 100.0

    def __init__(self, data: Array, noise: NoiseBatch | None = None):
        self.data, self.noise = data, noise

    # ---- As an array -----------------------------------------------------------------------------

    dtype = np.dtype(object)
    """dtype object: arrays created like it have to hold entries of it, or of any scalar type."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape without the batch axis."""
        return self.data.shape[1:]

    @property
    def ndim(self) -> int:
        """Number of axes of `shape`."""
        return self.data.ndim - 1

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.data.shape[1:])

    @property
    def count(self) -> int:
        """B, the number of elements of the batch."""
        return len(self.data)

    @property
    def flat(self) -> Iterator[BatchArray]:
        """An iterator over one entry only, for code that asks for the scalar type of all."""
        return iter((BatchArray(self.flattened()[:, 0]),) if self.size else ())

    @property
    def T(self) -> BatchArray:
        """The array with its axes in reverse."""
        return BatchArray(self.data.transpose(0, *range(self.ndim, 0, -1)), self.noise)

    def __len__(self) -> int:
        if not self.ndim:
            raise TypeError("one number has no length")
        return self.data.shape[1]

    def __getitem__(self, where: Any) -> BatchArray:
        data = self.data[_behind_batch(where)]
        return BatchArray(data, self.noise if data.ndim > 1 else None)

    def __setitem__(self, where: Any, x: Any) -> None:
        where = _behind_batch(where)
        if isinstance(x, BatchArray):
            x = _aligned(x.data, self.data[where].ndim)
        self.data[where] = x

    def __iter__(self) -> Iterator[BatchArray]:
        return (self[i] for i in range(len(self)))

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        if dtype is not None and np.dtype(dtype) != object:
            raise TypeError("a batch is no array of float64")
        return as_object_array(self)

    def copy(self) -> BatchArray:
        """Return a copy."""
        return BatchArray(self.data.copy(), self.noise)

    def reshape(self, *shape: Any) -> BatchArray:
        """Return the entries in another shape."""
        shape = shape[0] if len(shape) == 1 and isinstance(shape[0], tuple) else shape
        return BatchArray(self.data.reshape(self.count, *shape), self.noise)

    def sum(self, axis: int | None = None) -> BatchArray:
        """Return the sum along an axis, or of all entries."""
        return self._reduced(np.add, axis)

    def max(self, axis: int | None = None) -> BatchArray:
        """Return the largest entries along an axis, or of all."""
        return self._reduced(np.maximum, axis)

    def flattened(self) -> Array:
        """Return the data (B, size)."""
        return self.data.reshape(self.count, self.size)

    def _reduced(self, ufunc: np.ufunc, axis: int | None) -> BatchArray:
        if axis is None:
            return BatchArray(ufunc.reduce(self.flattened(), axis=1))
        return BatchArray(ufunc.reduce(self.data, axis=_data_axis(axis)))

    # ---- Operations ------------------------------------------------------------------------------

    def _with(self, ufunc: Any, x: Any, y: Any) -> Any:
        other = y if x is self else x
        kind = type(other)
        if kind is BatchArray:
            noise = self.noise or other.noise
            return _perturbed(ufunc(*_alike(x.data, y.data)), noise)
        if kind in PLAIN:
            first, second = (z.data if z is self else z for z in (x, y))
            return _perturbed(ufunc(first, second), self.noise)
        if isinstance(other, np.ndarray):
            return ufunc(x, y)
        return NotImplemented

    def __add__(self, other):
        return self._with(np.add, self, other)

    def __radd__(self, other):
        return self._with(np.add, other, self)

    def __sub__(self, other):
        return self._with(np.subtract, self, other)

    def __rsub__(self, other):
        return self._with(np.subtract, other, self)

    def __mul__(self, other):
        return self._with(np.multiply, self, other)

    def __rmul__(self, other):
        return self._with(np.multiply, other, self)

    def __truediv__(self, other):
        return self._with(np.true_divide, self, other)

    def __rtruediv__(self, other):
        return self._with(np.true_divide, other, self)

    def __pow__(self, other):
        return self._with(np.power, self, other)

    def __neg__(self):
        return BatchArray(-self.data)

    def __matmul__(self, other):
        return np.matmul(self, other)

    def __rmatmul__(self, other):
        return np.matmul(other, self)

    def __le__(self, other):
        return np.less_equal(self, other)

    def __ge__(self, other):
        return np.greater_equal(self, other)

    def __gt__(self, other):
        return np.greater(self, other)

    def _branched(self, other=None):
        raise NotRationalError(BRANCH)

    __eq__ = __bool__ = __float__ = _branched
    __hash__ = object.__hash__

    def __array_ufunc__(self, ufunc, method, *inputs, out=None, **options):
        if method != "__call__" or out is not None:
            return NotImplemented
        noise = next(
            (x.noise for x in inputs if isinstance(x, BatchArray) and x.noise is not None), None
        )
        if ufunc is np.matmul:
            inputs = [_without_objects(x, self.count) for x in inputs]
            result = _product(*inputs)
            if noise is None:
                return BatchArray(result)
            return noise.as_perturbed(
                BatchArray(noise.perturbed(result, _product(*map(np.abs, inputs))))
            )
        if any(isinstance(x, np.ndarray) and x.dtype == object for x in inputs):
            return ufunc(*(as_object_array(x) if isinstance(x, BatchArray) else x for x in inputs))
        axes = 1 + max(np.ndim(x) for x in inputs)
        data = [_aligned(x.data, axes) if isinstance(x, BatchArray) else x for x in inputs]
        if sum(isinstance(x, BatchArray) for x in inputs) == 2:
            data = _alike(*data)
        result = ufunc(*data, **options)
        return _perturbed(result, None if ufunc in EXACT_UFUNCS else noise)

    def __array_function__(self, function, types, arguments, options):
        mine = FUNCTIONS.get(function)
        return NotImplemented if mine is None else mine(*arguments, **options)


PLAIN = {float, int, np.float64}
"""Scalar types that are operands of a batch without conversion."""


def _behind_batch(where: Any) -> tuple:
    return (slice(None), *where) if isinstance(where, tuple) else (slice(None), where)


def _data_axis(axis: int) -> int:
    return axis + 1 if axis >= 0 else axis


def _aligned(data: Array, axes: int) -> Array:
    """Return data (B, *shape) with so many axes: new ones follow the batch axis."""
    missing = axes - data.ndim
    return data.reshape(len(data), *missing * (1,), *data.shape[1:]) if missing else data


def _alike(first: Array, second: Array) -> tuple[Array, Array]:
    """Return data of two batches with as many elements and axes.

    Data of several states are repeated for each sample of them.
    """
    if first.ndim != second.ndim:
        axes = max(first.ndim, second.ndim)
        first, second = _aligned(first, axes), _aligned(second, axes)
    count, other = len(first), len(second)
    if count < other:
        first = repeated(first, other // count)
    elif other < count:
        second = repeated(second, count // other)
    return first, second


def repeated(data: Array, samples: int) -> Array:
    """Return data (L, ...) of states for each of so many samples, sample by sample."""
    return np.tile(data, (samples, *(data.ndim - 1) * (1,)))


def _perturbed(result: Array, noise: NoiseBatch | None) -> BatchArray:
    if noise is None or result.dtype != np.float64:
        return BatchArray(result)
    return BatchArray(noise.perturbed(result, np.abs(result)), noise)


def _without_objects(x: Any, count: int) -> Any:
    """Return an operand of a product: a batch in place of an array of objects."""
    return BatchArray(batch_data(x, count)) if not _is_plain(x) else x


def _is_plain(x: Any) -> bool:
    return isinstance(x, BatchArray) or x.dtype != object


def _product(x: Any, y: Any) -> Array:
    """Return the data of the product of matrices or vectors, as `np.matmul` of each element."""
    a = x.data if isinstance(x, BatchArray) else x
    b = y.data if isinstance(y, BatchArray) else y
    a = a[..., None, :] if x.ndim == 1 else a
    b = b[..., None] if y.ndim == 1 else b
    stack = max(x.ndim, y.ndim, 2) + 1
    if isinstance(x, BatchArray):
        a = _aligned(a, stack)
    if isinstance(y, BatchArray):
        b = _aligned(b, stack)
        a, b = _alike(a, b) if isinstance(x, BatchArray) else (a, b)
    result = a @ b
    result = result[..., 0] if y.ndim == 1 else result
    return result[..., 0, :] if x.ndim == 1 < y.ndim else result[..., 0] if x.ndim == 1 else result


# ---- To and from other arrays --------------------------------------------------------------------


def as_object_array(x: BatchArray) -> Array:
    """Return the entries of a batch as an array of objects, of x's shape."""
    out = np.empty(x.shape, object)
    entries = out.reshape(-1)
    for i, entry in enumerate(x.flattened().T):
        entries[i] = BatchArray(entry)  # one by one: numpy would convert each to an array
    return out


def batch_size(x: Any) -> int:
    """Return the number of elements of the batch that x, or an entry, holds; 0 for none."""
    if isinstance(x, BatchArray):
        return x.count
    if isinstance(x, np.ndarray) and x.dtype == object:
        return next((y.count for y in x.flat if isinstance(y, BatchArray)), 0)
    if isinstance(x, list | tuple):
        return next((n for n in map(batch_size, x) if n), 0)
    return 0


def batch_data(x: Any, count: int) -> Array:
    """Return the float64 data (B, *shape) of an array of any scalar type, B = `count`."""
    if isinstance(x, BatchArray):
        return x.data
    if isinstance(x, list | tuple):
        return np.stack([batch_data(part, count) for part in x], axis=1)
    x = np.asarray(x)
    if x.dtype != object:
        return np.broadcast_to(np.asarray(x, np.float64), (count, *x.shape))
    out = np.empty((count, *x.shape))
    flat = out.reshape(count, -1)
    for i, entry in enumerate(x.reshape(-1)):
        flat[:, i] = entry.data if isinstance(entry, BatchArray) else entry
    return out


def as_float64(x: Any) -> Any:
    """Return x as a float64 array, or as a `BatchArray` if it holds a batch."""
    if isinstance(x, BatchArray):
        return x
    count = batch_size(x)
    return BatchArray(batch_data(x, count)) if count else np.asarray(x, np.float64)


def packed_entries(arrays: Sequence[Any], count: int) -> Array:
    """Return the entries (B, n) of arrays, B = `count`, each array in the order of its entries."""
    flat = [
        x.flattened() if isinstance(x, BatchArray) else np.broadcast_to(x.ravel(), (count, x.size))
        for x in arrays
    ]
    return np.concatenate(flat, axis=1) if flat else np.empty((count, 0))


class PackedRecord:
    """A record of arrays of indices, filled by entries that are gathered all at once.

    Attributes:
        indices: all indices (n,), part by part.
    """

    def __init__(self, record: Any):
        parts: list[Array] = []
        map_record(parts.append, record)
        self.indices = np.concatenate([x.reshape(-1) for x in parts]) if parts else np.empty(0, int)
        self._record = record

    def split(self, entries: Array, batch: bool, noise: NoiseBatch | None = None) -> Any:
        """Return the record with entries (B, n) in place of their indices.

        Args:
            entries: the entries, in the order of `indices`.
            batch: whether they are of a batch, otherwise of single arrays, B = 1.
            noise: source of the perturbations of results, see `BatchArray`.
        """
        taken = 0

        def part(indices: Array) -> Any:
            nonlocal taken
            first, taken = taken, taken + indices.size
            data = entries[:, first:taken].reshape(len(entries), *indices.shape)
            return BatchArray(data, noise) if batch else data[0]

        return map_record(part, self._record)


def choose(condition: Any, x: Any, y: Any) -> Any:
    """Return x where the condition holds, otherwise y, element by element of a batch."""
    if not batch_size((condition, x, y)):
        return x if condition else y
    arguments = (z.data if isinstance(z, BatchArray) else z for z in (condition, x, y))
    return BatchArray(np.where(*arguments))


def everywhere(condition: Any) -> Any:
    """Return whether a condition holds in all entries, element by element of a batch."""
    if not isinstance(condition, BatchArray):
        return bool(np.all(condition))
    return BatchArray(np.asarray(condition.flattened().all(axis=1)))


def of_each(function: Callable[..., Array], *arrays: Any) -> Any:
    """Return function(array, ...) of matrices or vectors; of a batch, of each element."""
    count = batch_size(arrays)
    if not count:
        return function(*arrays)
    elements = zip(*(batch_data(x, count) for x in arrays), strict=True)
    return BatchArray(np.stack([function(*x) for x in elements]))


def _stacked(arrays: Any, axis: int = 0) -> BatchArray:
    count = batch_size(list(arrays))
    return BatchArray(np.stack([batch_data(x, count) for x in arrays], _data_axis(axis)))


def _concatenated(arrays: Any, axis: int = 0) -> BatchArray:
    count = batch_size(list(arrays))
    return BatchArray(np.concatenate([batch_data(x, count) for x in arrays], _data_axis(axis)))


FUNCTIONS: dict[Any, Callable] = {
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.size: lambda x: x.size,
    np.ravel: lambda x: as_object_array(x).reshape(-1),
    np.sum: lambda x, axis=None: x.sum(axis),
    np.concatenate: _concatenated,
    np.stack: _stacked,
    np.zeros_like: lambda x: BatchArray(np.zeros_like(x.data)),
    np.eye: np.eye,
}
"""numpy function -> its implementation for a batch."""


# ---- Arithmetic and noise ------------------------------------------------------------------------


class BatchArithmetic:
    """The arithmetic of a batch (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Any) -> Any:
        """Return x unchanged: the caller, with all scenes of the batch, stacks the parameters."""
        return x

    def angles(self, x: Any) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = as_float64(x)
        return Angles(x, BatchArray(np.cos(x.data)), BatchArray(np.sin(x.data)))

    def root(self, x: Any) -> BatchArray:
        """Return the positive square roots of x (k,)."""
        return BatchArray(np.sqrt(as_float64(x).data))


BATCH_ARITHMETIC = BatchArithmetic()


class NoiseBatch(Noise):
    """A batch of noises, each of which perturbs its own elements of a batch as it would alone.

    Args:
        noises: the noises.
        states: number of states; element i is of noise i // states.
    """

    def __init__(self, noises: Sequence[Noise], states: int = 1):
        super().__init__(noises[0].seed)
        self._sources = tuple((noise.seed, noise.step) for noise in noises)
        self.states, self.enabled = states, True
        self.count = len(noises) * states

    def of_states(self, states: int) -> NoiseBatch:
        """Return a batch of the same noises of so many states, at the same position."""
        noises = NoiseBatch([Noise(*source) for source in self._sources], states)
        noises.position, noises.enabled = self.position, self.enabled
        return noises

    def draws(self, count: int) -> Array:
        """Return the next perturbations of each noise (k, count)."""
        return self._next(self._sources, count)

    def changes(self, shape: tuple[int, ...]) -> Array:
        """Return the next perturbations; `shape` begins with the batch axis."""
        changes = self.draws(math.prod(shape[1:]))
        if self.states > 1:
            changes = changes.repeat(self.states, axis=0)
        return changes.reshape(shape)

    def perturb(self, x: Any) -> Any:
        """Return x, numbers that were read or rounded, each entry perturbed relative to itself."""
        with np.errstate(all="ignore"):
            return BatchArray(self.perturbed(x.data, np.abs(x.data)))

    def perturb_record(self, x: Any) -> Any:
        """Return a record with each entry of every array perturbed; see `Noise.perturb_record`."""
        if isinstance(x, Angles):
            return Angles(x.value, self.perturb(x.cos), self.perturb(x.sin))
        return map_record(lambda part: self.as_perturbed(self.perturb(as_float64(part))), x)

    def as_perturbed(self, x: Any) -> Any:
        """Return x as an array on which every operation of whole arrays is perturbed."""
        return BatchArray(x.data, self)

    def repeated(self, record: Any) -> Any:
        """Return a record with each array of one or several states repeated for all samples."""
        return map_record(
            lambda x: BatchArray(repeated(batch_data(x, self.states), self.count // self.states)),
            record,
        )

    @contextmanager
    def disabled(self) -> Iterator[None]:
        """Perturb nothing inside the block: neither in new operations nor on existing arrays."""
        enabled, self._sources = self._sources, tuple((seed, 0.0) for seed, _ in self._sources)
        self.enabled = False
        try:
            with self.stream(self.position.stream):
                yield
        finally:
            self._sources, self.enabled = enabled, True

    @contextmanager
    def split(self) -> Iterator[list[Noise]]:
        """Yield the single noises, at the position of the batch; it goes on after the farthest."""
        noises = [Noise(*source) for source in self._sources]
        for noise in noises:
            noise.position = NoisePosition(self.position.stream, self.position.taken)
        yield noises
        self.position.taken = max(noise.position.taken for noise in noises)
