"""Type-generic functions: written once, they run on every scalar type.

A function under `@generic` only adds, subtracts, multiplies, divides (by a number of the model or
a power of two), indexes, and calls `eomcheck.numbers.linear.solve` or its sibling for banded
matrices. It has no `sin`, no `sqrt`, no branch on a value; its literals are integers. An absent
term is `None` and is tested with `is None` on an argument of that very function. The mark leaves
the function as it is; `GENERIC` lists the marked ones.

An `Arithmetic` is what a scalar type offers to a scene: how it takes over the float64 parameters,
and the sines, cosines and roots that are not rational. `FLOAT64` is the first of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

# ---- Arithmetics ---------------------------------------------------------------------------------

Array = np.ndarray


class Angles(NamedTuple):
    """Angles with their cosines and sines, prepared by the arithmetic; each of shape (k,).

    Over the reals the three belong together. Over a finite field cos² + sin² = 1 holds and `value`
    is unrelated: an algebraic identity cannot tell.
    """

    value: Any
    cos: Any
    sin: Any


class Arithmetic(Protocol):
    """How a kind of number takes over the doubles that a scene was given, and what is not rational.

    `angles` and `root` also take numbers of this kind; `angles` keeps them as its `value`.
    """

    def numbers(self, x: Array) -> Array:
        """Return x in this kind of number, same shape."""
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
    """A function does more than add, subtract, multiply, divide and solve."""


BRANCH = "a branch on a value: what is proved on one side of it says nothing of the other"
"""What numbers without a value say when they are compared."""

GENERIC: list[Callable] = []


def generic(function: F) -> F:
    """Mark `function` as written for every kind of number, and return it unchanged."""
    GENERIC.append(function)
    return function


def product_of(x: Any, power: int) -> Any:
    """Return x x ... x.

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
    """Return function(x, ...) of every entry of arrays of one shape, as an array of objects."""
    out = np.empty(np.shape(arrays[0]), object)
    flat = (np.ravel(array) for array in arrays)
    out.ravel()[:] = [function(*entries) for entries in zip(*flat, strict=True)]
    return out


def map_record(function: Callable[..., Any], record: Any, *others: Any) -> Any:
    """Return a record with `function` applied to every part; what is absent stays absent.

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
    """Return a record whose arrays hold objects, so that what is made like them can hold any."""
    return map_record(lambda part: np.asarray(part, object), record)


# ---- float64 -------------------------------------------------------------------------------------


class Float64:
    """The arithmetic of machine doubles (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: np.ndarray) -> np.ndarray:
        """Return x as doubles, a contiguous copy."""
        return np.array(x, dtype=np.float64, order="C")

    def angles(self, x: np.ndarray) -> Angles:
        """Return the angles x (k,) with their cosines and sines."""
        x = self.numbers(x)
        return Angles(x, np.cos(x), np.sin(x))

    def root(self, x: np.ndarray) -> np.ndarray:
        """Return the positive square roots of x (k,)."""
        return np.sqrt(x)


FLOAT64 = Float64()
