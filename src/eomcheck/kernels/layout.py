"""Where the numbers of a program stand in the block of memory that its function is given."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from eomcheck.kernels import band
from eomcheck.kernels.instructions import Tree
from eomcheck.kernels.loops import FARTHEST
from eomcheck.kernels.machine import CACHE_LINE
from eomcheck.kernels.program import Program
from eomcheck.numbers import tape as t

CALLS, FAILED, FAILURE_TIME, TIME = range(4)
HEADER = 4
"""Doubles of the block before all else: calls and failures (integers), time of the first failure,
and the time given."""


class Layout(NamedTuple):
    """Where things stand in a block, in numbers of `width` lanes, behind its header.

    Attributes:
        places: first place of each array, by name.
        size: numbers in all.
        room: doubles behind them.
    """

    places: Mapping[str, int]
    size: int
    room: int

    def doubles(self, width: int) -> int:
        """Return the doubles of a block."""
        return HEADER + self.size * width + self.room


def layout_of(program: Program, parameters: Mapping[str, int]) -> Layout:
    """Return the layout for `parameters`, whose sizes are given by name."""
    sizes = {**parameters, **dict(program.arrays)}
    counts = [item[1] for item in program.items if item[0] == "loop"]
    for loop, inner in sorted(results_of(program)[0]):
        sizes[f"l{loop}.{inner}"] = counts[loop]
    places, at = {}, 0
    for name, size in sizes.items():
        if name not in parameters:
            at = aligned(at)
        places[name] = at
        at += size
    return Layout(places, aligned(at), max((_room(item) for item in program.items), default=0))


def aligned(count: int) -> int:
    """Return the first place at or behind this one that begins a line of cache."""
    return -(-count // CACHE_LINE) * CACHE_LINE


def results_of(program: Program) -> tuple[set[tuple[int, int]], dict[tuple[int, int], int]]:
    """Return what is read behind loops, as (loop, operation).

    Returns:
        What is to be written to memory; of all else, of which the last few are read: how far from
        the last one that is.
    """
    counts = [item[1] for item in program.items if item[0] == "loop"]
    reads = {x[1:] for x in reads_of(program.items) if x[0] == "l"}
    written = {x[:2] for x in reads if x[3] or counts[x[0]] - x[2] > FARTHEST}
    last: dict[tuple[int, int], int] = {}
    for loop, inner, place, _ in reads:
        if (loop, inner) not in written:
            ago = counts[loop] - 1 - place
            last[loop, inner] = max(ago, last.get((loop, inner), 0))
    return written, last


def reads_of(items: Tree) -> Iterator[Tree]:
    """Yield everything that items read."""
    for item in items:
        if item[0] == "loop":
            yield from reads_of(item[2])
            continue
        given = (
            item[7] if item[0] == "group" and item[5] else item[1:4] if item[0] != "group" else ()
        )
        for x in given:
            if isinstance(x, tuple):
                yield x
                if x[0] == "p":
                    yield from x[2]


def _room(item: Tree) -> int:
    """Return the doubles of room that an item needs."""
    if item[0] != "group" or item[5]:
        return 0
    kind, shape = item[2], item[4]
    if kind == t.BAND:
        return band.room(shape[0])
    if kind == t.SOLVE:
        return shape[0] * shape[1]
    if kind == t.PRODUCT:
        n, k, m = shape
        return n * k + k * m + n * m
    return 0
