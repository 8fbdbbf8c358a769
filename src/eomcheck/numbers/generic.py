"""Scalar-generic functions: written once, they run on every scalar type.

A function under `@generic` only adds, subtracts, multiplies, divides (by a number of the model or
a power of two), indexes, and calls `eomcheck.numbers.linear.solve` or its sibling for banded
matrices. It has no `sin`, no `sqrt`, no branch on a value; its literals are integers. An absent
term is `None` and is tested with `is None` on an argument of that very function. The decorator
returns the function unchanged; `GENERIC` holds the decorated functions.

An `Arithmetic` is the interface of a scalar type to a scene: it converts the float64 parameters,
and computes the sines, cosines and roots, which are not rational. `FLOAT64` is that of float64;
a `RecordingArithmetic` records the angles and roots that another one computes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

# ---- Arithmetics ---------------------------------------------------------------------------------

Array = np.ndarray

EPS = float(np.finfo(np.float64).eps)
"""Spacing of float64 at 1."""


class Angles(NamedTuple):
    """Angles with their cosines and sines, computed by the arithmetic; each of shape (k,).

    Over the reals `cos` and `sin` are those of `value`. Over a finite field cos² + sin² = 1 holds
    and `value` is unrelated: no algebraic identity depends on their relation.
    """

    value: Any
    cos: Any
    sin: Any


class Arithmetic(Protocol):
    """Conversion of a scene's float64 parameters to a scalar type, and its sines and roots.

    `angles` and `root` also take numbers of the scalar type; `angles` returns them as `value`.
    """

    def numbers(self, x: Array) -> Array:
        """Return x as numbers of this scalar type, same shape."""
        ...

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        ...

    def root(self, x: Array) -> Array:
        """Return the positive square roots of x (k,)."""
        ...


# ---- Generic functions ---------------------------------------------------------------------------

F = TypeVar("F", bound=Callable)


class NotRationalError(TypeError):
    """Error for a function that does more than add, subtract, multiply, divide and solve."""


BRANCH = "a branch on a value: what is proved on one side of it says nothing of the other"
"""Error message for a comparison of numbers that have no value."""

GENERIC: list[Callable] = []


def generic(function: F) -> F:
    """Mark `function` as scalar-generic, and return it unchanged."""
    GENERIC.append(function)
    return function


def product_of(x: Any, power: int) -> Any:
    """Return x to the `power`, as a product x x ... x.

    Raises:
        NotRationalError: `power` is no whole number of at least 1.
    """
    if isinstance(power, bool) or not isinstance(power, int) or power < 1:
        raise NotRationalError(f"the power {power!r}, expected a whole number of at least 1")
    result = x
    for _ in range(power - 1):
        result = result * x
    return result


# ---- Arrays of objects and records of arrays -----------------------------------------------------


def map_entries(function: Callable[..., Any], *arrays: Any) -> np.ndarray:
    """Return the array of objects with entries function(x, ...), x, ... of arrays of one shape."""
    out = np.empty(np.shape(arrays[0]), object)
    flat = (np.ravel(array) for array in arrays)
    out.ravel()[:] = [function(*entries) for entries in zip(*flat, strict=True)]
    return out


def map_record(function: Callable[..., Any], record: Any, *others: Any) -> Any:
    """Return a record with `function` applied to every part; None stays None.

    Args:
        function: of a part, and of the same part of `others`.
        record: arrays, and tuples of them.
        others: records with the same parts.
    """
    if record is None:
        return None
    if isinstance(record, tuple):
        parts = [map_record(function, *same) for same in zip(record, *others, strict=True)]
        return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
    return function(record, *others)


def as_objects(record: Any) -> Any:
    """Return a record with arrays of objects: arrays created like them can hold any scalar type."""
    return map_record(lambda part: np.asarray(part, object), record)


# ---- float64 -------------------------------------------------------------------------------------


class Float64:
    """The arithmetic of float64 (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as float64, a contiguous copy."""
        return np.array(x, dtype=np.float64, order="C")

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        return Angles(x, np.cos(x), np.sin(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,)."""
        return np.sqrt(x)


FLOAT64 = Float64()


class RecordingArithmetic:
    """An arithmetic that records the angles and roots that it returns.

    Attributes:
        recorded: `Angles` and roots, in the order of the calls.
    """

    def __init__(self, arithmetic: Arithmetic):
        self._arithmetic = arithmetic
        self.recorded: list[Any] = []

    def numbers(self, x: Array) -> Array:
        """Return x as numbers of the wrapped arithmetic."""
        return self._arithmetic.numbers(x)

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,) of the wrapped arithmetic, and record them."""
        self.recorded.append(self._arithmetic.angles(x))
        return self.recorded[-1]

    def root(self, x: Array) -> Array:
        """Return the roots of x (k,) of the wrapped arithmetic, and record them."""
        self.recorded.append(self._arithmetic.root(x))
        return self.recorded[-1]
