"""Loops found again in instructions: stretches that step evenly.

Items of a program (`eomcheck.kernels.program`) are written of what was found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eomcheck.kernels.instructions import Instructions, Stretch, Tree

FEWEST = 4
"""Iterations of a loop, at least."""

FARTHEST = 4
"""What a loop makes is handed on to so many later iterations, at most."""

LONGEST = 256
"""Operations in one iteration of a loop, at most."""


def stretches_of(lines: Instructions) -> list[Stretch]:
    """Return stretches that step evenly, in order, not overlapping: the longest that there are.

    In each, from one period to the next every instruction is the same, and every place it names
    moves by as much as it did before.
    """
    rows = np.array(lines.rows, np.int64).reshape(-1, 7)
    kinds = np.unique(rows[:, (0, 1, 3, 5)], axis=0, return_inverse=True)[1].ravel()
    places = rows[:, (2, 4, 6)]
    found = []
    for period in range(1, min(LONGEST, len(rows) // FEWEST) + 1):
        same = kinds[period:] == kinds[:-period]
        steady = same[:-period] & same[period:]
        near = np.flatnonzero(steady)
        one, two, three = (places[near + i * period] for i in range(3))
        steady[near] = (two - one == three - two).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], steady.view(np.int8), [0]))))
        for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            count = (end - start) // period + 2
            if count >= FEWEST:
                found.append((-count * period, period, start, count))
    taken = np.zeros(len(rows), bool)
    chosen = []
    for _, period, start, count in sorted(found):
        here = taken[start : start + count * period]
        if here.any():
            free = np.flatnonzero(np.diff(np.concatenate(([1], here.view(np.int8), [1]))))
            lengths = free[1::2] - free[::2]
            if not len(lengths):
                continue
            best = int(lengths.argmax())
            start, count = start + int(free[2 * best]), int(lengths[best]) // period
        if count >= FEWEST:
            taken[start : start + count * period] = True
            chosen.append((start, period, count))
    return sorted(chosen)


# ---- From instructions to items ------------------------------------------------------------------


def items_of(lines: Instructions, stretches: Sequence[Stretch]) -> Tree:
    """Return instructions as items, stretches among them as loops."""
    return _Encoder(lines).items(stretches)


class _Encoder:
    def __init__(self, lines: Instructions):
        self.lines, self.table = lines, lines.rows
        # Where a value is: its loop, or -1, its operation there, or its number, its iteration.
        self.loop = np.full(len(self.table), -1)
        self.inner = np.zeros(len(self.table), np.int64)
        self.turn = np.zeros(len(self.table), np.int64)
        self.straight = self.loops = 0
        self.found: list[Tree] = []

    def items(self, stretches: Sequence[Stretch]) -> Tree:
        at = 0
        for start, period, count in stretches:
            skipped, count = self._even_part(start, period, count)
            if count < FEWEST:
                continue
            start += skipped * period
            self._write_straight(at, start)
            self._write_loop(start, period, count)
            at = start + count * period
        self._write_straight(at, len(self.table))
        return tuple(self.found)

    def one(self, kind: int, place: int) -> Tree | None:
        """Return what an instruction outside of loops reads."""
        if kind == 0:
            if place < 0:
                return None
            if self.loop[place] < 0:
                return ("s", int(self.inner[place]))
            return ("l", int(self.loop[place]), int(self.inner[place]), int(self.turn[place]), 0)
        name = self.lines.names[kind]
        return name if name[0] == "c" else ("i", name[1], place, 0)

    def _write_straight(self, start: int, end: int) -> None:
        for at in range(start, end):
            code, *reads, target, place = self.table[at]
            op = self.lines.ops[code]
            if op == "put":
                item = ("put", self.one(*reads[:2]), self.lines.names[target], place, 0)
            elif isinstance(op, tuple):
                given = op[-1]
                if op[5]:
                    given = tuple(self.one(*x) for x in given)
                item = (*op[:-1], given)
            else:
                item = ("op", op, self.one(*reads[:2]), self.one(*reads[2:]))
                self.inner[at] = self.straight
                self.straight += 1
            self.found.append(item)

    def _values(self, start: int, period: int) -> Iterator[tuple[int, int]]:
        """Yield (place, step) of each value that an iteration reads."""
        for at in range(start, start + period):
            for column in (1, 3):
                kind, place = self.table[at][column : column + 2]
                if kind == 0 and place >= 0:
                    yield place, self.table[at + period][column + 1] - place

    def _even_part(self, start: int, period: int, count: int) -> tuple[int, int]:
        """Return (iterations to skip, iterations) of the longest part that steps evenly."""
        good = np.ones(max(count - 1, 0), bool)
        even = np.ones(max(count - 2, 0), bool)
        end, turns = start + count * period, np.arange(count)
        for place, step in self._values(start, period):
            if _own(place, step, start, period, count):
                continue
            if start <= place + step < end:
                return 0, 0
            if step == 0:
                continue
            places = place + step * turns
            loops, inner, turn = self.loop[places], self.inner[places], self.turn[places]
            good &= (loops[1:] == loops[:-1]) & (inner[1:] == inner[:-1]) & (loops[1:] >= 0)
            even &= np.diff(turn, 2) == 0
        best, first, at = 0, 0, 0
        while at < count:
            after = at + 1
            while after < count and good[after - 1] and (after - at < 2 or even[after - 2]):
                after += 1
            if after - at > best:
                best, first = after - at, at
            at = after
        return first, best

    def _write_loop(self, start: int, period: int, count: int) -> None:
        end = start + count * period
        where, body = (start, period, count), []
        for at in range(start, start + period):
            code, *reads, target, place = self.table[at]
            later = self.table[at + period]
            args = [self._inside(reads[c], reads[c + 1], later[c + 2], where) for c in (0, 2)]
            op = self.lines.ops[code]
            if op == "put":
                step = later[6] - place
                body.append(("put", args[0], self.lines.names[target], place, step))
            else:
                body.append(("op", op, *args))
        here = np.arange(start, end)
        self.loop[here] = self.loops
        self.inner[here] = (here - start) % period
        self.turn[here] = (here - start) // period
        self.loops += 1
        self.found.append(("loop", count, tuple(body)))

    def _inside(self, kind: int, place: int, later: int, where: Stretch) -> Tree | None:
        """Return what an instruction of a loop reads: `place` first, then `later`."""
        step = later - place
        if kind == 0 and place >= 0 and step:
            if _own(place, step, *where):
                start, period, _ = where
                first = tuple(self.one(kind, x) for x in range(place, start, period))
                inner = (place - start) % period
                return ("p", inner, first) if first else ("b", inner)
            loop, inner, turn = (int(x[place]) for x in (self.loop, self.inner, self.turn))
            return ("l", loop, inner, turn, int(self.turn[later]) - turn)
        read = self.one(kind, place)
        return ("i", read[1], place, step) if read and read[0] == "i" else read


def _own(place: int, step: int, start: int, period: int, count: int) -> bool:
    """Return whether what is read, `place` first, is made by the loop itself, after a while."""
    return step == period and place >= start - min(FARTHEST, count - 1) * period
