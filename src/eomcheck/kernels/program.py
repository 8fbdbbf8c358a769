"""A program: a tape whose loops are found again.

A recursion over the links of a chain leaves the same operations on the tape link by link, with
places that step evenly. Such stretches are loops again in the program. What does not repeat stays
straight. Loops make code short; they change no operation.

Programs are trees of tuples. What an operation reads is

- ("c", x): a constant
- ("s", k): the k-th value made outside of loops
- ("i", array, place, step): an entry of an array: an input, or the results of a group
- ("l", loop, j, place, step): what operation j of an earlier loop made, by iteration
- ("b", j): what operation j of this iteration made
- ("p", j, first): what operation j made as many iterations before as there are entries in `first`;
  these are what it is in the first ones

where `step` is 0 outside of loops. Items are ("op", op, x, y), ("put", x, array, place, step),
("group", number, kind, name, shape, inline, by, given), and ("loop", count, items).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from eomcheck.errors import EomcheckError
from eomcheck.kernels.fusion import fused
from eomcheck.kernels.instructions import Tree, instructions_of, urgent
from eomcheck.kernels.loops import items_of, stretches_of
from eomcheck.numbers.tape import Tape, live

SHORT = 2500
"""A program of fewer entries of a tape stays straight: it is faster, and soon there."""


class Program(NamedTuple):
    """What a kernel does.

    Attributes:
        items: in order.
        arrays: number of entries of each array that is not an input.
    """

    items: Tree
    arrays: Tree


class NotRegularError(EomcheckError):
    """Programs of different sizes do not follow one pattern."""


def program_of(tape: Tape, outputs: Mapping[str, Sequence[int]], short: int = SHORT) -> Program:
    """Return the program that writes the entries of `tape` at `outputs`, by name of array.

    With `short` entries or fewer it stays straight, in the order in which they are urgent.
    """
    places, _ = live(tape, [p for roots in outputs.values() for p in roots])
    straight = len(places) <= short
    lines, arrays = instructions_of(tape, urgent(tape, places) if straight else places, outputs)
    stretches = []
    if not straight:
        lines = fused(lines, stretches_of(lines))
        stretches = stretches_of(lines)
    return Program(items_of(lines, stretches), tuple(sorted(arrays.items())))


# ---- Programs of any size ------------------------------------------------------------------------


def continued(programs: Callable[[int], Program], size: int, first: int, step: int) -> Program:
    """Return the program of `size` that those of first, first + step, first + 2 step continue.

    Raises:
        NotRegularError: they do not follow one pattern, in which every whole number is affine.
    """
    one, two, three = (programs(first + i * step) for i in range(3))
    if _along(one, two, 2) != three:
        raise NotRegularError(f"programs of {first}, {first + step}, ... differ irregularly")
    turns, left = divmod(size - first, step)
    if left:
        raise NotRegularError(f"{size} is not {first} plus a multiple of {step}")
    return _along(one, two, turns)


def _along(one: Any, two: Any, turns: int) -> Any:
    """Return one + turns (two - one), leaf by leaf."""
    if one is two:
        return one
    if isinstance(one, tuple):
        if not isinstance(two, tuple) or len(one) != len(two):
            raise NotRegularError("programs of different sizes have different shapes")
        parts = [_along(x, y, turns) for x, y in zip(one, two, strict=True)]
        return type(one)(*parts) if hasattr(one, "_fields") else tuple(parts)
    whole = isinstance(one, int) and not isinstance(one, bool) and isinstance(two, int)
    if whole:
        return one + turns * (two - one)
    if one != two:
        raise NotRegularError(f"{one!r} in one program is {two!r} in the other")
    return one
