"""From a tape to instructions: one after the other, in the order in which they are to be done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eomcheck.kernels.band_ends import WIDTH, padded
from eomcheck.kernels.sincos import room
from eomcheck.numbers import tape as t
from eomcheck.numbers.tape import Tape

INLINE = 9
"""Up to this order a matrix is eliminated in registers; larger ones are written to memory."""

FEW_ANGLES = 16
"""Up to so many, sines and cosines stay in registers; more are written to memory."""

Tree = tuple

Stretch = tuple[int, int, int]
"""Instructions that repeat themselves: the first, how many are an iteration, iterations."""


class Instructions:
    """Instructions as rows of integers: op, and (class, place) of what is read twice and written.

    A class is 0 for the value of an earlier instruction, whose place is its number; otherwise it
    stands for one array, or for one constant, whose place is 0.
    """

    def __init__(self):
        self.rows: list[tuple[int, int, int, int, int, int, int]] = []
        self.ops: list[Any] = []
        self.names: list[Any] = [None]
        self._op_codes: dict[Any, int] = {}
        self._classes: dict[Any, int] = {}

    def class_of(self, name: Any) -> int:
        """Return the class of an array or a constant."""
        found = self._classes.get(name)
        if found is None:
            found = self._classes[name] = len(self.names)
            self.names.append(name)
        return found

    def add(self, op: Any, x=(0, -1), y=(0, -1), out=(0, -1)) -> int:
        """Add an instruction, and return its number."""
        code = self._op_codes.setdefault(op, len(self._op_codes))
        if code == len(self.ops):
            self.ops.append(op)
        self.rows.append((code, *x, *y, *out))
        return len(self.rows) - 1

    def reads(self, at: int) -> list[tuple[int, int]]:
        """Return (class, place) of all that an instruction reads."""
        code, *reads = self.rows[at][:5]
        op = self.ops[code]
        inline = op[-1] if isinstance(op, tuple) and op[5] else ()
        pairs = ((reads[0], reads[1]), (reads[2], reads[3]), *inline)
        return [(kind, place) for kind, place in pairs if place >= 0]

    def ordered(self, order: Sequence[int]) -> Instructions:
        """Return the same instructions in another order: those at `order`."""
        other, to = Instructions(), {old: new for new, old in enumerate(order)}
        other.names = self.names

        def moved(kind: int, place: int) -> tuple[int, int]:
            return kind, to.get(place, place) if kind == 0 else place

        for old in order:
            code, *reads, target, place = self.rows[old]
            op = self.ops[code]
            if isinstance(op, tuple) and op[5]:
                op = (*op[:-1], tuple(moved(*x) for x in op[-1]))
            other.add(op, moved(*reads[:2]), moved(*reads[2:]), (target, place))
        return other


CYCLES = {t.ADD: 2, t.SUB: 2, t.MUL: 3, t.DIV: 14, t.NEG: 1, t.SQRT: 18, t.PART: 40}
"""About what operations take until others can go on; inputs and constants wait for nothing."""


def urgent(tape: Tape, places: Sequence[int]) -> list[int]:
    """Return `places` in another order: first what most time passes after, up to an output.

    A processor looks ahead of what waits by some hundred operations, and finds others to do.
    """
    left = dict.fromkeys(places, 0)
    for place in reversed(places):
        op, *reads = tape.operations[place]
        left[place] += CYCLES.get(op, 0)
        if op in (t.CONSTANT, t.INPUT):
            continue
        if op is t.PART:
            group = tape.groups[reads[0]]
            reads = group.reads if group.by < 0 else group.reads + tape.groups[group.by].reads
        for x in reads:
            if x is not None:
                left[x] = max(left[x], left[place])
    return sorted(places, key=left.__getitem__, reverse=True)


def instructions_of(
    tape: Tape, places: Sequence[int], outputs: Mapping[str, Sequence[int]]
) -> tuple[Instructions, dict[str, int]]:
    """Return what is done for `outputs`, in the order of `places`, and the sizes of arrays."""
    lines, arrays = Instructions(), {}
    made: dict[int, int] = {}
    done: dict[int, int] = {}
    factored: dict[Sequence[int], int] = {}

    def read(place: int) -> tuple[int, int]:
        op, x, y = tape.operations[place]
        if op is t.CONSTANT:
            return lines.class_of(("c", x)), 0
        if op is t.INPUT:
            return lines.class_of(("i", x)), y
        if op is t.PART:
            kind, _, (size, *_), _, _ = tape.groups[x]
            if kind is t.ANGLES and y >= size > FEW_ANGLES:
                y += room(size) - size
            return lines.class_of(("i", f"x{done[x]}")), y
        return 0, made[place]

    def put(reads: Sequence[int | None], array: str) -> None:
        target = lines.class_of(array)
        # In the order in which they were made: what stands on both sides of a diagonal is put twice
        # in one step of a loop.
        given = ((place, i) for i, place in enumerate(reads) if place is not None)
        for place, i in sorted(given):
            if tape.value(place) != 0:
                lines.add("put", read(place), out=(target, i))

    def group(number: int) -> None:
        if number in done:
            return
        kind, name, shape, reads, by = tape.groups[number]
        if kind is t.FACTORS and reads in factored:
            done[number] = factored[reads]  # of one matrix, whatever it is called
            return
        if by >= 0:
            group(by)
        mine = done[number] = len(done)
        factors = done.get(by, -1)
        if kind is t.FACTORS:
            factored[reads] = mine
        order = shape[0]
        inline = kind is t.ANGLES and order <= FEW_ANGLES
        if kind in (t.FACTORS, t.SOLVE):
            inline = order <= INLINE
        size = 2 * room(order) if kind is t.ANGLES else int(np.prod(shape))
        arrays[f"x{mine}"] = order * (order + 2) if kind is t.FACTORS else size
        given: Tree = ()
        if inline:
            given = tuple(read(place) for place in reads)
        elif kind is t.ANGLES and (row := _in_a_row(tape, reads)):
            given = row
        else:
            ordered = _ordered(kind, reads, order)
            arrays[f"r{mine}"] = len(ordered)
            put(ordered, f"r{mine}")
        lines.add(("group", mine, kind, name, shape, inline, factors, given))

    for place in places:
        op, x, y = tape.operations[place]
        if op is t.PART:
            group(x)
        elif op not in (t.CONSTANT, t.INPUT):
            made[place] = lines.add(op, read(x), (0, -1) if y is None else read(y))
    for name, roots in outputs.items():
        target = lines.class_of(name)
        for i, place in enumerate(roots):
            lines.add("put", read(place), out=(target, i))
    return lines, arrays


def _ordered(kind: str, reads: Sequence[int], order: int) -> Sequence[int | None]:
    """Return what a group reads as it is to stand in memory; None is nothing."""
    if kind is t.FACTORS:  # column by column, as LAPACK wants it
        return [reads[i * order + j] for j in range(order) for i in range(order)]
    if kind is t.BAND:  # diagonal by diagonal, the right-hand side as the last one
        rest = [None] * (padded(order) - order)
        columns = [
            *(reads[j : WIDTH * order : WIDTH] for j in range(WIDTH)),
            reads[WIDTH * order :],
        ]
        return [x for column in columns for x in (*column, *rest)]
    return reads


def _in_a_row(tape: Tape, reads: Sequence[int]) -> Tree:
    """Return (array, first place, count) of entries that follow one another in it, or ()."""
    first = tape.operations[reads[0]]
    for i, place in enumerate(reads):
        if tape.operations[place] != (t.INPUT, first.x, _plus(first.y, i)):
            return ()
    return first.x, first.y, len(reads)


def _plus(y: Any, i: int) -> Any:
    return y + i if isinstance(y, int) else y
