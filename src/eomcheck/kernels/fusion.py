"""Loops along one chain as one loop.

Functions of whole arrays leave one loop each, and each of them writes for the next one what it
makes: a chain of many links is read and written from end to end many times. Here instructions are
put into the order of their links, whichever function they come from. Each is done in the same
iteration as what it reads, or in a later one; nothing else about it changes.
"""

from __future__ import annotations

from collections.abc import Sequence

from eomcheck.kernels.instructions import Instructions, Stretch

RAGGED = 8
"""Loops along one chain differ by fewer iterations: some begin or end a few links later."""


def fused(lines: Instructions, stretches: Sequence[Stretch]) -> Instructions:
    """Return instructions in the order of iterations; as they are unless all go along one chain."""
    counts = [count for _, _, count in stretches]
    if len(counts) < 2 or max(counts) - min(counts) >= RAGGED:
        return lines
    times = _Times(lines)
    at = 0
    for start, period, count in (*stretches, (len(lines.rows), 1, 0)):
        for straight in range(at, start):
            times.found.append(times.straight(straight))
            times.note(straight)
        times.stretch(start, period, count)
        at = start + period * count
    return lines.ordered(sorted(range(len(lines.rows)), key=times.found.__getitem__))


class _Times:
    """When each instruction is done: in which iteration of the one loop.

    Attributes:
        found: of each instruction so far.
        arrays: of each array: when all is there that was written to it.
    """

    def __init__(self, lines: Instructions):
        self.lines = lines
        self.found: list[int] = []
        self.arrays: dict[str, int] = {}

    def straight(self, at: int) -> int:
        """Return when an instruction outside of loops can be done."""
        op = self.lines.ops[self.lines.rows[at][0]]
        values, arrays = self._reads(at)
        if isinstance(op, tuple):
            arrays += [f"r{op[1]}", f"x{op[6]}"]
        return max([0, *(self.found[p] for p in values), *(self._when(name) for name in arrays)])

    def stretch(self, start: int, period: int, count: int) -> None:
        """Note the times of all iterations: each instruction goes along the chain on its own."""
        first = [0] * period
        reads = [self._reads(start + i) for i in range(period * count)]
        settled = False
        while not settled:
            before = list(first)
            for i, (values, arrays) in enumerate(reads):
                turn, inner = divmod(i, period)
                for place in values:
                    other, there = divmod(place - start, period)
                    when = self.found[place] if place < start else first[there] + other
                    first[inner] = max(first[inner], when - turn)
                for name in arrays:
                    first[inner] = max(first[inner], self._when(name) - turn)
            settled = first == before
        for i in range(period * count):
            turn, inner = divmod(i, period)
            self.found.append(first[inner] + turn)
            self.note(start + i)

    def note(self, at: int) -> None:
        """Note what an instruction writes, if it does, or that a group is there."""
        op, out = self.lines.ops[self.lines.rows[at][0]], self.lines.rows[at][5]
        name = f"x{op[1]}" if isinstance(op, tuple) else self.lines.names[out]
        if name is not None:
            self.arrays[name] = max(self._when(name), self.found[at])

    def _reads(self, at: int) -> tuple[list[int], list[str]]:
        """Return the places of values, and the arrays, that an instruction reads."""
        reads, names = self.lines.reads(at), self.lines.names
        return (
            [place for kind, place in reads if kind == 0],
            [names[kind][1] for kind, _ in reads if kind and names[kind][0] == "i"],
        )

    def _when(self, array: str) -> int:
        return self.arrays.get(array, 0)
