"""Ball arithmetic (interval arithmetic by midpoint and radius), in any precision.

A ball is a midpoint with a radius; the ball that an operation returns contains its true result for
all numbers of its operands. Inputs in float64 are exact (radius 0); sines and cosines are those of
exactly these angles. The working precision is python-flint's own, set by `precision(bits)` around a
computation. All threads of a process share it: `precision` lets one thread compute at a time, and
restores the precision of the caller. (A thread that uses python-flint by itself may do so within
`precision` as well, or it may compute with the bits of another.)
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from threading import RLock
from typing import Any

import flint
import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.numbers.banded_solve import BANDED_SOLVERS, eliminate_banded
from eomcheck.numbers.generic import Angles, Array, map_entries
from eomcheck.numbers.linear import SOLVERS

_computing = RLock()


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Set the precision of ball arithmetic to `bits` inside the block; one thread at a time."""
    with _computing, flint.ctx.workprec(bits):
        yield


class Balls:
    """The arithmetic of balls (`eomcheck.numbers.generic.Arithmetic`)."""

    def numbers(self, x: Array) -> Array:
        """Return the float64 array x as exact balls, same shape."""
        return map_entries(lambda y: flint.arb(float(y)), x)

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), float64 or balls, with their cosines and sines."""
        value = x if x.dtype == object else self.numbers(x)
        pairs = [y.sin_cos() for y in value]
        cos, sin = (np.array([pair[i] for pair in pairs], object) for i in (1, 0))
        return Angles(value, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of the balls x (k,)."""
        return map_entries(lambda y: y.sqrt(), x)

    def literal(self, x: int) -> flint.arb:
        """Return the literal x as an exact ball."""
        return flint.arb(x)


def midpoints(x: Array) -> Array:
    """Return the midpoints of the balls x, rounded to float64, same shape."""
    return np.array([float(ball(y).mid()) for y in np.ravel(x)]).reshape(np.shape(x))


def midpoints_or_zero(x: Array) -> Array:
    """Return the midpoints of the balls x as float64, same shape; 0 for a ball that contains 0.

    The midpoint of a quantity that vanishes exactly is meaningless: it is within the ball's width.
    """
    zero = np.array([ball(y).contains(0) for y in np.ravel(x)], bool).reshape(np.shape(x))
    return np.where(zero, 0.0, midpoints(x))


def ball(x) -> flint.arb:
    """Return x as a ball; literal integers, also returned by generic functions, are converted."""
    return x if isinstance(x, flint.arb) else flint.arb(x)


def _made_again(middle: tuple[int, int], radius: tuple[int, int]) -> flint.arb:
    return flint.arb(flint.arb(middle), flint.arb(radius))


def _reduced(x: flint.arb) -> tuple[Any, tuple]:
    """Return the constructor and arguments by which a ball is copied or unpickled.

    The radius has 30 bits and is rounded up in the last, so that the new ball contains the old one.
    """
    if not x.is_finite():
        return flint.arb, ("nan",)
    middle, radius = ((int(m), int(e)) for m, e in (x.mid().man_exp(), x.rad().man_exp()))
    return _made_again, (middle, radius)


copyreg.pickle(flint.arb, _reduced)


def _solve(A: Array, b: Array, name: str) -> Array:
    size, columns = A.shape[0], b.reshape(A.shape[0], -1)
    matrix = flint.arb_mat(size, size, A.ravel().tolist())
    right = flint.arb_mat(size, columns.shape[1], columns.ravel().tolist())
    try:
        x = matrix.solve(right)
    except ZeroDivisionError:
        raise RefusedError(
            name,
            0.0,
            0.0,
            f"the {size} x {size} matrix {name} cannot be shown to be invertible in balls of "
            f"{flint.ctx.prec} bits",
        ) from None
    return np.array(x.entries(), object).reshape(b.shape)


SOLVERS[flint.arb] = _solve


def _largest(column: list) -> int | None:
    """Return the index of the ball that is farthest from zero, None if all contain zero."""
    distance = [ball(x).abs_lower() for x in column]
    index = max(range(len(distance)), key=distance.__getitem__)
    return index if distance[index] > 0 else None


BANDED_SOLVERS[flint.arb] = partial(eliminate_banded, pivot=_largest)
