"""heyoka expressions: what a scene says becomes a system that heyoka integrates by Taylor series.

Every constant enters in quad precision. heyoka folds constants in the precision that they have: of
two doubles, 0.1 * 0.3 would be a double again, wrong in the 17th digit. Doubles are taken for the
numbers that they are, and the cosine of a constant is that of exactly this double.

The library is loaded when `Expressions` is first made, not when this module is imported.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from eomcheck.errors import EngineError
from eomcheck.numbers.contract import Angles, Array
from eomcheck.numbers.elimination import eliminating
from eomcheck.numbers.entries import each
from eomcheck.numbers.linear import SOLVERS

BITS = 113
"""Bits of the significand of quad precision (IEEE 754 binary128)."""


def library() -> Any:
    """Return the module heyoka.

    Raises:
        EngineError: it is not installed.
    """
    try:
        return importlib.import_module("heyoka")
    except ImportError as error:
        raise EngineError(
            f"heyoka is not installed ({error}); install it by: pip install 'eomcheck[reference]'"
        ) from None


class Expressions:
    """The arithmetic of heyoka expressions (`eomcheck.numbers.contract.Arithmetic`).

    Attributes:
        heyoka: the library.
        quad: its type of quad precision: `real128`, where the platform has none `real`.

    Raises:
        EngineError: heyoka is not installed.
    """

    def __init__(self):
        self.heyoka = library()
        self.quad = getattr(self.heyoka, "real128", self.heyoka.real)
        SOLVERS[self.heyoka.expression] = eliminating(_vanishes)

    @property
    def options(self) -> dict[str, Any]:
        """What tells heyoka to compile for quad precision."""
        real = {"prec": BITS} if self.quad is self.heyoka.real else {}
        return {"fp_type": self.quad, **real}

    def constant(self, x: Any) -> Any:
        """Return x, a double, an integer or a string of digits, in quad precision."""
        if self.quad is self.heyoka.real:
            return self.quad(x, BITS)
        return self.quad(x)

    def constants(self, x: Array) -> Array:
        """Return the doubles x in quad precision, same shape, as an array of that type."""
        quad = [self.constant(float(y)) for y in np.ravel(x)]
        return np.array(quad, dtype=self.quad).reshape(np.shape(x))

    def expression(self, x: Any) -> Any:
        """Return x as an expression: generic functions leave literal integers in their results."""
        made = self.heyoka.expression
        return x if isinstance(x, made) else made(self.constant(x))

    def numbers(self, x: Array) -> Array:
        """Return the doubles x as constants, same shape."""
        return each(lambda y: self.expression(float(y)), x)

    def variables(self, name: str, size: int) -> Array:
        """Return the variables name_0, name_1, ... (size,)."""
        return np.array([self.heyoka.expression(f"{name}_{i}") for i in range(size)], object)

    def angles(self, x: Array) -> Angles:
        """Return the angles x (k,), doubles or expressions, with their cosines and sines."""
        value = x if x.dtype == object else self.numbers(x)
        cos, sin = (
            np.array([function(y) for y in value], object)
            for function in (self.heyoka.cos, self.heyoka.sin)
        )
        return Angles(value, cos, sin)

    def root(self, x: Array) -> Array:
        """Return the positive square roots of the expressions x (k,)."""
        return each(lambda y: self.heyoka.sqrt(self.expression(y)), x)


def _vanishes(x: Any) -> bool:
    # A constant tells neither its value nor its type but in print.
    try:
        return float(str(x)) == 0.0
    except ValueError:
        return False
