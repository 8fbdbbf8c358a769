"""Scalars and vectors with absent components, so that an absent term costs no operation.

An absent number is None and stands for 0; the literals 1 and -1 stand for themselves. A vector has
three components, each a number or absent: in the plane the third one is always absent. Functions
never branch on the value of a number of the model, which is never an `int`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from eomcheck.numbers.generic import generic

Vector = tuple[Any, Any, Any]

ZERO_VECTOR: Vector = (None, None, None)
AXES: tuple[Vector, Vector, Vector] = ((1, None, None), (None, 1, None), (None, None, 1))
"""Axes of the ground."""


# ---- Numbers -------------------------------------------------------------------------------------


@generic
def negative(x):
    """Return -x."""
    return None if x is None else -x


@generic
def plus(x, y):
    """Return x + y."""
    if x is None:
        return y
    if y is None:
        return x
    return _literal(x + y)


@generic
def minus(x, y):
    """Return x - y."""
    if y is None:
        return x
    if x is None:
        return -y
    return _literal(x - y)


@generic
def times(x, y):
    """Return x y."""
    if x is None or y is None:
        return None
    if type(x) is int:
        return y if x == 1 else -y if x == -1 else x * y
    if type(y) is int:
        return x if y == 1 else -x if y == -1 else x * y
    return x * y


def _literal(x: Any) -> Any:
    return None if type(x) is int and x == 0 else x


@generic
def total(terms):
    """Return the sum of numbers; None if all are absent."""
    found = None
    for one in terms:
        found = plus(found, one)
    return found


# ---- Vectors -------------------------------------------------------------------------------------


@generic
def add_vectors(a, b):
    """Return a + b."""
    return plus(a[0], b[0]), plus(a[1], b[1]), plus(a[2], b[2])


@generic
def subtract_vectors(a, b):
    """Return a - b."""
    return minus(a[0], b[0]), minus(a[1], b[1]), minus(a[2], b[2])


@generic
def scale_vector(x, a):
    """Return x a."""
    return times(x, a[0]), times(x, a[1]), times(x, a[2])


@generic
def dot(a, b):
    """Return a · b."""
    return plus(plus(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]))


@generic
def cross(a, b):
    """Return a × b."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


@generic
def centripetal(omega, arm):
    """Return ω × (ω × arm)."""
    return cross(omega, cross(omega, arm))


@generic
def from_local(axes, a):
    """Return a vector from its components along `axes`, in the frame that `axes` refer to."""
    x, y, z = axes
    return add_vectors(
        add_vectors(scale_vector(a[0], x), scale_vector(a[1], y)), scale_vector(a[2], z)
    )


@generic
def to_local(axes, a):
    """Return the components of a vector along `axes`."""
    return dot(axes[0], a), dot(axes[1], a), dot(axes[2], a)


@generic
def rotate_back(a, axis, cos, sin):
    """Return the components of a vector along axes turned about their `axis`-th."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return _with(
        a,
        {
            i: plus(times(cos, a[i]), times(sin, a[j])),
            j: minus(times(cos, a[j]), times(sin, a[i])),
        },
    )


@generic
def rotate(a, axis, cos, sin):
    """Return a vector rotated about the `axis`-th axis."""
    return rotate_back(a, axis, cos, negative(sin))


@generic
def unit(axis, x):
    """Return x times the `axis`-th unit vector."""
    return _with(ZERO_VECTOR, {axis: x})


def _with(a: Vector, parts: dict[int, Any]) -> Vector:
    x, y, z = (parts.get(i, a[i]) for i in range(3))
    return x, y, z


def as_vector(entries: Iterable[Any]) -> Vector:
    """Return a vector of two or three numbers."""
    x, y, *rest = entries
    return x, y, (rest[0] if rest else None)


def put(array: Any, place: Any, x: Any) -> None:
    """Write a number, if present, into an array of zeros."""
    if x is not None:
        array[place] = x


def put_vector(array: Any, place: tuple[Any, ...], a: Vector, size: int = 3) -> None:
    """Write the first `size` components of a vector, if present; None in `place` is their axis."""
    for i in range(size):
        put(array, tuple(i if one is None else one for one in place), a[i])
