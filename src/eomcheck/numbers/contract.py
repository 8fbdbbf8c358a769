"""What a kind of number has to offer a scene."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

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
