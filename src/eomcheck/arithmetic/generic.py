"""The mark of functions that are written once and run on every kind of number.

A function under `@generic` only adds, subtracts, multiplies, divides (by a number of the model or
a power of two), indexes, and calls `eomcheck.arithmetic.linear.solve`. It has no `sin`, no `sqrt`,
no branch on a value; its literals are integers. An absent term is `None` and is tested with
`is None` on an argument of that very function, which a compiler resolves before anything runs.

The mark leaves the function as it is. Arithmetics that compile look the marked functions up in
`GENERIC`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

F = TypeVar("F", bound=Callable)

GENERIC: list[Callable] = []


def generic(function: F) -> F:
    """Mark `function` as written for every kind of number, and return it unchanged."""
    GENERIC.append(function)
    return function
