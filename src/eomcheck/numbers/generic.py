"""The mark of functions that are written once and run on every kind of number.

A function under `@generic` only adds, subtracts, multiplies, divides (by a number of the model or
a power of two), indexes, and calls `eomcheck.numbers.linear.solve` or its sibling for banded
matrices. It has no `sin`, no `sqrt`, no branch on a value; its literals are integers. An absent
term is `None` and is tested with `is None` on an argument of that very function.

The mark leaves the function as it is; `GENERIC` lists the marked ones.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

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
