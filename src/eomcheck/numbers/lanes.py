"""Arrays over a batch of states, one per SIMD lane: the same source runs at many states at once.

A `LaneArray` behaves as an array of the shape that its source knows, while every entry holds one
float64 per lane: its data are (..., L), the batch axis last. Whole arrays are computed at once; if
code builds arrays of its own, or differentiates, entries are scalars like any other scalar type, in
arrays of objects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.numbers.generic import BRANCH, Angles, NotRationalError
from eomcheck.numbers.noise import EXACT_UFUNCS, NORMAL, Noise
from eomcheck.numbers.pivots import SMALLEST_SIZE

ARITHMETIC = (np.add, np.subtract, np.multiply, np.true_divide)


class LaneArray:
    """An array with one float64 per lane in each entry.

    Noise perturbs it as it does a `PerturbedArray`: the result of an operation on the whole array
    is perturbed, an entry that is taken out is not perturbed further.

    Args:
        data: float64 (*shape, L).
        noise: source of the perturbations of results; None for none.
    """

    __slots__ = ("data", "noise", "svd_cache", "turned")
    __array_priority__ = 100.0

    def __init__(self, data: np.ndarray, noise: Noise | None = None):
        self.data, self.noise = data, noise
        # Singular value decomposition of a matrix and its transpose (`eomcheck.numbers.linear`).
        self.svd_cache: list[Any] = []
        self.turned = False

    # ---- As an array -----------------------------------------------------------------------------

    dtype = np.dtype(object)
    """dtype object, so that arrays created like it can hold any scalar type."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape without the batch axis."""
        return self.data.shape[:-1]

    @property
    def ndim(self) -> int:
        """Number of axes of `shape`."""
        return self.data.ndim - 1

    @property
    def size(self) -> int:
        """Number of entries."""
        return int(np.prod(self.shape))

    @property
    def lanes(self) -> int:
        """L, the number of lanes."""
        return self.data.shape[-1]

    @property
    def flat(self) -> Iterator[LaneArray]:
        """An iterator over one entry only, for code that asks for the scalar type of all."""
        return iter((LaneArray(self.data.reshape(-1, self.lanes)[0]),) if self.size else ())

    @property
    def T(self) -> LaneArray:
        """The array with its axes in reverse."""
        data = self.data.transpose(*range(self.ndim - 1, -1, -1), self.ndim)
        turned = LaneArray(data, self.noise)
        turned.svd_cache, turned.turned = self.svd_cache, not self.turned
        return turned

    def __len__(self) -> int:
        if not self.ndim:
            raise TypeError("one number has no length")
        return self.shape[0]

    def __getitem__(self, where: Any) -> LaneArray:
        data = self.data[(*where, slice(None)) if _has_dots(where) else where]
        return LaneArray(data, self.noise if data.ndim > 1 else None)

    def __setitem__(self, where: Any, x: Any) -> None:
        self.svd_cache.clear()
        self.data[where] = x.data if isinstance(x, LaneArray) else x

    def __iter__(self) -> Iterator[LaneArray]:
        return (self[i] for i in range(len(self)))

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        if dtype is not None and np.dtype(dtype) != object:
            raise TypeError("lanes are no array of doubles")
        return as_object_array(self)

    def copy(self) -> LaneArray:
        """Return a copy."""
        return LaneArray(self.data.copy(), self.noise)

    def reshape(self, *shape: Any) -> LaneArray:
        """Return the entries in another shape."""
        shape = shape[0] if len(shape) == 1 and isinstance(shape[0], tuple) else shape
        if -1 in shape:
            known = -int(np.prod(shape))
            shape = tuple(self.size // known if x == -1 else x for x in shape)
        return LaneArray(self.data.reshape(*shape, self.lanes), self.noise)

    def sum(self, axis: int | None = None) -> LaneArray:
        """Return the sum along an axis, or of all entries."""
        return LaneArray(self._flattened(axis).sum(axis=0 if axis is None else _data_axis(axis)))

    def max(self, axis: int | None = None) -> LaneArray:
        """Return the largest entries along an axis, or of all."""
        return LaneArray(self._flattened(axis).max(axis=0 if axis is None else _data_axis(axis)))

    def _flattened(self, axis: int | None) -> np.ndarray:
        return self.data.reshape(-1, self.lanes) if axis is None else self.data

    # ---- Operations ------------------------------------------------------------------------------

    def _with(self, ufunc: Any, x: Any, y: Any) -> Any:
        other = y if x is self else x
        kind = type(other)
        if kind is LaneArray or kind in PLAIN:
            noise = self.noise
            if noise is None and kind is LaneArray:
                noise = other.noise
            first, second = (z.data if type(z) is LaneArray else z for z in (x, y))
            return _perturbed(ufunc(first, second), noise)
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

    def __neg__(self):
        return LaneArray(-self.data, self.noise)

    def __matmul__(self, other):
        return np.matmul(self, other)

    def __rmatmul__(self, other):
        return np.matmul(other, self)

    def __le__(self, other):
        return np.less_equal(self, other)

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
            (x.noise for x in inputs if isinstance(x, LaneArray) and x.noise is not None), None
        )
        objects = any(isinstance(x, np.ndarray) and x.dtype == object for x in inputs)
        if ufunc is np.matmul:
            count = self.lanes
            data = [lane_data(x, count) for x in inputs]
            result = _product(*data)
            if noise is None:
                return LaneArray(result)
            size = _product(*map(np.abs, data))
            return LaneArray(result + _changes(noise, result) * perturbation_scale(size), noise)
        if objects:
            return ufunc(*(as_object_array(x) if isinstance(x, LaneArray) else x for x in inputs))
        data = [
            x.data
            if isinstance(x, LaneArray)
            else x[..., None]
            if isinstance(x, np.ndarray) and x.ndim
            else x
            for x in inputs
        ]
        result = ufunc(*data, **options)
        return LaneArray(result, noise) if ufunc in EXACT_UFUNCS else _perturbed(result, noise)

    def __array_function__(self, function, types, arguments, options):
        mine = FUNCTIONS.get(function)
        return NotImplemented if mine is None else mine(*arguments, **options)


PLAIN = {float, int, np.float64}
"""Scalar types that are operands of lanes without conversion."""


def _has_dots(where: Any) -> bool:
    return isinstance(where, tuple) and any(x is Ellipsis for x in where)


def _data_axis(axis: int) -> int:
    return axis if axis >= 0 else axis - 1


def perturbation_scale(x: np.ndarray) -> np.ndarray:
    """Return the sizes to which perturbations are relative: |x|, `SMALLEST_SIZE` if not normal.

    A perturbed zero is then no subnormal number, with which CPUs compute a hundred times as slowly.
    """
    size = np.abs(x)
    size[size < NORMAL] = SMALLEST_SIZE
    return size


def _changes(noise: Noise, x: np.ndarray) -> np.ndarray:
    return noise.changes(x.shape[:-1])[..., None]


def _perturbed(result: np.ndarray, noise: Noise | None) -> LaneArray:
    if noise is None or result.dtype != np.float64:
        return LaneArray(result)
    change = _changes(noise, result) * perturbation_scale(result)
    return LaneArray(result + change, noise)


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the product of matrices or vectors, batch axis last; sums are in order."""
    before, behind = ("j" if x.ndim == 2 else "...ij"), ("j" if y.ndim == 2 else "...jk")
    rows = "" if x.ndim == 2 else "...i"
    columns = "" if y.ndim == 2 else ("k" if rows else "...k")
    return np.einsum(f"{before}z,{behind}z->{rows}{columns}z", x, y)


# ---- To and from other arrays --------------------------------------------------------------------


def as_object_array(x: LaneArray) -> np.ndarray:
    """Return the entries of lanes as an array of objects, of x's shape."""
    out = np.empty(x.shape, object)
    flat = x.data.reshape(-1, x.lanes)
    entries = out.reshape(-1)
    for i, x_i in enumerate(flat):
        entries[i] = LaneArray(x_i)
    return out


def lanes_in(x: Any) -> int:
    """Return the number of lanes in an array or a number, 0 if it has none."""
    if isinstance(x, LaneArray):
        return x.lanes
    if isinstance(x, np.ndarray) and x.dtype == object:
        return next((y.lanes for y in x.flat if isinstance(y, LaneArray)), 0)
    if isinstance(x, list | tuple):
        return next((n for n in map(lanes_in, x) if n), 0)
    return 0


def lane_data(x: Any, count: int) -> np.ndarray:
    """Return the float64 data (*shape, L) of an array of any scalar type, L = `count`."""
    if isinstance(x, LaneArray):
        return x.data
    if isinstance(x, list | tuple):
        return np.stack([lane_data(part, count) for part in x])
    x = np.asarray(x)
    if x.dtype != object:
        return np.broadcast_to(np.asarray(x, np.float64)[..., None], (*x.shape, count))
    out = np.empty((*x.shape, count))
    flat = out.reshape(-1, count)
    for i, entry in enumerate(x.reshape(-1)):
        flat[i] = entry.data if isinstance(entry, LaneArray) else entry
    return out


def as_float64(x: Any) -> Any:
    """Return x as a float64 array, or as a `LaneArray` if it holds lanes."""
    if isinstance(x, LaneArray):
        return x
    count = lanes_in(x)
    return LaneArray(lane_data(x, count)) if count else np.asarray(x, np.float64)


def lane_select(condition: Any, x: Any, y: Any) -> Any:
    """Return x where the condition holds, otherwise y, lane by lane; each may be lanes or plain."""
    count = next((n for n in map(lanes_in, (condition, x, y)) if n), 0)
    if not count:
        return x if condition else y
    of = condition.data if isinstance(condition, LaneArray) else condition
    return LaneArray(np.where(of, *(z.data if isinstance(z, LaneArray) else z for z in (x, y))))


def everywhere(condition: Any) -> Any:
    """Return whether a condition holds in all entries, lane by lane if it holds lanes."""
    if not isinstance(condition, LaneArray):
        return bool(np.all(condition))
    return LaneArray(np.asarray(condition.data.reshape(-1, condition.lanes).all(axis=0)))


def _concatenate(arrays: Any, axis: int = 0) -> Any:
    count = lanes_in(list(arrays))
    return LaneArray(np.concatenate([lane_data(x, count) for x in arrays], _data_axis(axis)))


FUNCTIONS: dict[Any, Callable] = {
    np.shape: lambda x: x.shape,
    np.ndim: lambda x: x.ndim,
    np.size: lambda x: x.size,
    np.ravel: lambda x: as_object_array(x).reshape(-1),
    np.sum: lambda x, axis=None: x.sum(axis),
    np.concatenate: _concatenate,
    np.zeros_like: lambda x: LaneArray(np.zeros_like(x.data)),
    np.eye: np.eye,
}
"""numpy function -> its implementation for lanes."""


# ---- Arithmetic and noise ------------------------------------------------------------------------


class LaneArithmetic:
    """The arithmetic of lanes (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Any) -> Any:
        """Return x unchanged: the caller, with all scenes of the batch, stacks the parameters."""
        return x

    def angles(self, x: Any) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = as_float64(x)
        return Angles(x, LaneArray(np.cos(x.data)), LaneArray(np.sin(x.data)))

    def root(self, x: Any) -> LaneArray:
        """Return the positive square roots of x (k,)."""
        return LaneArray(np.sqrt(as_float64(x).data))


LANE_ARITHMETIC = LaneArithmetic()


class LaneNoise(Noise):
    """A source of relative perturbations that are the same in all lanes, as at all states.

    Zeros and subnormal numbers are perturbed like the smallest number for which residuals do not
    underflow, see `perturbation_scale`.
    """

    def perturb(self, x: Any) -> Any:
        """Return x with each entry perturbed relative to itself."""
        data = x.data
        with np.errstate(all="ignore"):
            return LaneArray(data + _changes(self, data) * perturbation_scale(data))

    def perturb_record(self, x: Any) -> Any:
        """Return a record with each entry of every array perturbed; None stays None."""
        if isinstance(x, Angles):
            return Angles(x.value, self.perturb(x.cos), self.perturb(x.sin))
        if isinstance(x, tuple):
            parts = [self.perturb_record(part) for part in x]
            return type(x)(*parts) if hasattr(x, "_fields") else tuple(parts)
        return x if x is None else self.as_perturbed(self.perturb(as_float64(x)))

    def as_perturbed(self, x: Any) -> Any:
        """Return x as an array on which every operation of whole arrays is perturbed."""
        return LaneArray(x.data, self)
