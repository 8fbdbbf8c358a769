"""Programs: tapes with their loops recovered (loop rerolling).

A recursion over the links of a chain leaves the same operations on the tape link by link, with
indices that increase by the same step from link to link. `program_of` takes four steps:

1.  `instructions_of` writes the tape as rows of integers, in the order in which they are executed.
2.  `fused` merges the loops along one chain into one loop. Functions of whole arrays leave one loop
    each, which reads the results of the loop before: a long chain would be read and written from
    end to end many times. Instructions are put into the order of their links, whichever function
    they come from, each in the earliest iteration in which its operands are known.
3.  `stretches_of` finds stretches of instructions with indices at even steps.
4.  `items_of` writes these as loops, and all other instructions one by one.

Loops make code short; no step changes an operation.

Programs are trees of tuples; the first entry of a tuple names it. An operand is

- ("constant", x)
- ("value", k): the k-th result of an operation outside of loops
- ("entry", array, index, step): an entry of an array
- ("from loop", loop, j, index, step): the result of operation j of an earlier loop, by iteration
- ("current", j): the result of operation j in this iteration
- ("previous", j, first): the result of operation j as many iterations before as there are entries
  in `first`, which are its values in the first iterations

where the index increases by `step` per iteration (0 outside of loops). An item is

- ("op", op, x, y): an operation of `eomcheck.numbers.tape` on one or two operands
- ("put", x, array, index, step): writing an operand to an entry of an array
- ("group", ...): a group of operations of a tape, such as a solve; see `GroupItem`
- ("loop", count, items)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.kernels.linear_solves import WIDTH, padded
from eomcheck.kernels.sincos import padded_count
from eomcheck.numbers import tape as t
from eomcheck.numbers.tape import Tape, live_entries

# ---- Instructions --------------------------------------------------------------------------------

INLINE = 9
"""Largest order of a matrix that is eliminated in registers; larger ones are written to memory."""

FEW_ANGLES = 16
"""Largest number of angles whose sines and cosines stay in registers, not in memory."""

Tree = tuple

Stretch = tuple[int, int, int]
"""Repeated instructions: index of the first, number per iteration, number of iterations."""


class GroupItem(NamedTuple):
    """A group of operations in a program; its results are in the array "xN", N its number.

    Attributes:
        tag: "group".
        number: number of the group.
        kind: its kind, as on the tape.
        name: name of its matrix.
        shape: its sizes, as on the tape.
        inline: whether all is done in registers.
        factors: number of the group that factored its matrix, or -1.
        inputs: its operands if it is inline; otherwise they are in the array "rN", or, if they are
            contiguous entries of another, (array, first index, count).
    """

    tag: str
    number: int
    kind: str
    name: str
    shape: Tree
    inline: bool
    factors: int
    inputs: Tree


class Instructions:
    """Instructions as rows of integers: op, and (class, index) of two operands and of the target.

    Class 0 is the value of an earlier instruction, with its number as the index; any other class is
    one array, or one constant with the index 0.
    """

    def __init__(self):
        self.rows: list[tuple[int, int, int, int, int, int, int]] = []
        self.ops: list[Any] = []
        self.names: list[Any] = [None]
        self._op_codes: dict[Any, int] = {}
        self._classes: dict[Any, int] = {}

    def class_of(self, name: Any) -> int:
        """Return the class of an array or a constant."""
        number = self._classes.get(name)
        if number is None:
            number = self._classes[name] = len(self.names)
            self.names.append(name)
        return number

    def add(self, op: Any, x=(0, -1), y=(0, -1), out=(0, -1)) -> int:
        """Add an instruction, and return its number."""
        code = self._op_codes.setdefault(op, len(self._op_codes))
        if code == len(self.ops):
            self.ops.append(op)
        self.rows.append((code, *x, *y, *out))
        return len(self.rows) - 1

    def reads(self, at: int) -> list[tuple[int, int]]:
        """Return (class, index) of all operands of an instruction."""
        code, *reads = self.rows[at][:5]
        op = self.ops[code]
        inputs = op.inputs if _is_inline(op) else ()
        pairs = ((reads[0], reads[1]), (reads[2], reads[3]), *inputs)
        return [(kind, place) for kind, place in pairs if place >= 0]

    def ordered(self, order: Sequence[int]) -> Instructions:
        """Return the same instructions in another order, by their numbers in `order`."""
        other, to = Instructions(), {old: new for new, old in enumerate(order)}
        other.names = self.names

        def renumbered(kind: int, place: int) -> tuple[int, int]:
            return kind, to.get(place, place) if kind == 0 else place

        for old in order:
            code, *reads, target, place = self.rows[old]
            op = self.ops[code]
            if _is_inline(op):
                op = op._replace(inputs=tuple(renumbered(*x) for x in op.inputs))
            other.add(op, renumbered(*reads[:2]), renumbered(*reads[2:]), (target, place))
        return other


def _is_inline(op: Any) -> bool:
    return isinstance(op, GroupItem) and op.inline


CYCLES = {t.ADD: 2, t.SUB: 2, t.MUL: 3, t.DIV: 14, t.NEG: 1, t.SQRT: 18, t.PART: 40}
"""Approximate latencies of operations, in cycles; those of inputs and constants are 0."""


def by_urgency(tape: Tape, places: Sequence[int]) -> list[int]:
    """Return the entries `places` ordered by the latency of the path to an output, longest first.

    A processor executes out of order within a window of some hundred operations.
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
    """Return the instructions that compute `outputs`, in the order of `places`, and array sizes."""
    lines, arrays = Instructions(), {}
    made: dict[int, int] = {}
    done: dict[int, int] = {}
    factored: dict[Sequence[int], int] = {}

    def read(place: int) -> tuple[int, int]:
        op, x, y = tape.operations[place]
        if op is t.CONSTANT:
            return lines.class_of(("constant", x)), 0
        if op is t.INPUT:
            return lines.class_of(("entry", x)), y
        if op is t.PART:
            kind, _, (size, *_), _, _ = tape.groups[x]
            if kind is t.ANGLES and y >= size > FEW_ANGLES:
                y += padded_count(size) - size
            return lines.class_of(("entry", f"x{done[x]}")), y
        return 0, made[place]

    def put(reads: Sequence[int | None], array: str) -> None:
        target = lines.class_of(array)
        # In the order in which they were computed: an entry on both sides of a diagonal is written
        # twice in one iteration of a loop.
        entries = ((place, i) for i, place in enumerate(reads) if place is not None)
        for place, i in sorted(entries):
            if tape.value(place) != 0:
                lines.add("put", read(place), out=(target, i))

    def group(number: int) -> None:
        if number in done:
            return
        kind, name, shape, reads, by = tape.groups[number]
        if kind is t.FACTORS and reads in factored:
            done[number] = factored[reads]  # the same matrix under another name
            return
        if by >= 0:
            group(by)
        new = done[number] = len(done)
        factors = done.get(by, -1)
        if kind is t.FACTORS:
            factored[reads] = new
        order = shape[0]
        inline = kind is t.ANGLES and order <= FEW_ANGLES
        if kind in (t.FACTORS, t.SOLVE):
            inline = order <= INLINE
        size = 2 * padded_count(order) if kind is t.ANGLES else int(np.prod(shape))
        arrays[f"x{new}"] = order * (order + 2) if kind is t.FACTORS else size
        inputs: Tree = ()
        if inline:
            inputs = tuple(read(place) for place in reads)
        elif kind is t.ANGLES and (row := _in_a_row(tape, reads)):
            inputs = row
        else:
            ordered = _ordered(kind, reads, order)
            arrays[f"r{new}"] = len(ordered)
            put(ordered, f"r{new}")
        lines.add(GroupItem("group", new, kind, name, shape, inline, factors, inputs))

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
    """Return the entries that a group reads in the order in memory; None for unused memory."""
    if kind is t.FACTORS:  # column by column, as in LAPACK
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
    """Return (array, first index, count) of entries that are contiguous in an array, or ()."""
    first = tape.operations[reads[0]]
    for i, place in enumerate(reads):
        if tape.operations[place] != (t.INPUT, first.x, _plus(first.y, i)):
            return ()
    return first.x, first.y, len(reads)


def _plus(y: Any, i: int) -> Any:
    return y + i if isinstance(y, int) else y


# ---- Loop fusion ---------------------------------------------------------------------------------

RAGGED = 8
"""Difference in iterations from which loops are not along one chain: in one chain some begin or end
a few links later."""


def fused(lines: Instructions, stretches: Sequence[Stretch]) -> Instructions:
    """Return instructions in the order of iterations; unchanged if there are several chains."""
    counts = [count for _, _, count in stretches]
    if len(counts) < 2 or max(counts) - min(counts) >= RAGGED:
        return lines
    times = _Times(lines)
    at = 0
    for start, period, count in (*stretches, (len(lines.rows), 1, 0)):
        for straight in range(at, start):
            times.times.append(times.straight(straight))
            times.note(straight)
        times.stretch(start, period, count)
        at = start + period * count
    return lines.ordered(sorted(range(len(lines.rows)), key=times.times.__getitem__))


class _Times:
    """The time of each instruction: the iteration of the fused loop in which it is executed.

    Attributes:
        times: times of the instructions so far.
        arrays: time from which on each array is complete, by name.
    """

    def __init__(self, lines: Instructions):
        self.lines = lines
        self.times: list[int] = []
        self.arrays: dict[str, int] = {}

    def straight(self, at: int) -> int:
        """Return the earliest time of an instruction outside of loops."""
        op = self.lines.ops[self.lines.rows[at][0]]
        values, arrays = self._reads(at)
        if isinstance(op, GroupItem):
            arrays += [f"r{op.number}", f"x{op.factors}"]
        return max([0, *(self.times[p] for p in values), *(self._when(name) for name in arrays)])

    def stretch(self, start: int, period: int, count: int) -> None:
        """Add the times of all iterations; each instruction of the loop has its own offset."""
        first = [0] * period
        reads = [self._reads(start + i) for i in range(period * count)]
        settled = False
        while not settled:
            before = list(first)
            for i, (values, arrays) in enumerate(reads):
                turn, inner = divmod(i, period)
                for place in values:
                    other, position = divmod(place - start, period)
                    when = self.times[place] if place < start else first[position] + other
                    first[inner] = max(first[inner], when - turn)
                for name in arrays:
                    first[inner] = max(first[inner], self._when(name) - turn)
            settled = first == before
        for i in range(period * count):
            turn, inner = divmod(i, period)
            self.times.append(first[inner] + turn)
            self.note(start + i)

    def note(self, at: int) -> None:
        """Update the time of the array that an instruction, or a group, writes, if any."""
        op, out = self.lines.ops[self.lines.rows[at][0]], self.lines.rows[at][5]
        name = f"x{op.number}" if isinstance(op, GroupItem) else self.lines.names[out]
        if name is not None:
            self.arrays[name] = max(self._when(name), self.times[at])

    def _reads(self, at: int) -> tuple[list[int], list[str]]:
        """Return the numbers of values, and the names of arrays, that an instruction reads."""
        reads, names = self.lines.reads(at), self.lines.names
        return (
            [place for kind, place in reads if kind == 0],
            [names[kind][1] for kind, _ in reads if kind and names[kind][0] == "entry"],
        )

    def _when(self, array: str) -> int:
        return self.arrays.get(array, 0)


# ---- Loop rerolling ------------------------------------------------------------------------------

FEWEST = 4
"""Smallest number of iterations of a loop."""

FARTHEST = 4
"""Largest number of iterations over which a loop passes values in registers."""

LONGEST = 256
"""Largest number of operations in one iteration of a loop."""


def stretches_of(lines: Instructions) -> list[Stretch]:
    """Return the longest stretches with even steps, in order, not overlapping.

    In each, from one period to the next every instruction is the same, and every index in it
    increases by the same step as from the period before.
    """
    rows = np.array(lines.rows, np.int64).reshape(-1, 7)
    kinds = np.unique(rows[:, (0, 1, 3, 5)], axis=0, return_inverse=True)[1].ravel()
    places = rows[:, (2, 4, 6)]
    candidates = []
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
                candidates.append((-count * period, period, start, count))
    taken = np.zeros(len(rows), bool)
    chosen = []
    for _, period, start, count in sorted(candidates):
        used = taken[start : start + count * period]
        if used.any():
            free = np.flatnonzero(np.diff(np.concatenate(([1], used.view(np.int8), [1]))))
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
        # The location of each value: its loop or -1, its operation there or number, its iteration.
        self.loop = np.full(len(self.table), -1)
        self.inner = np.zeros(len(self.table), np.int64)
        self.turn = np.zeros(len(self.table), np.int64)
        self.straight = self.loops = 0
        self.encoded: list[Tree] = []

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
        return tuple(self.encoded)

    def one(self, kind: int, place: int) -> Tree | None:
        """Return the operand of an instruction outside of loops."""
        if kind == 0:
            if place < 0:
                return None
            if self.loop[place] < 0:
                return ("value", int(self.inner[place]))
            loop, inner, turn = (int(x[place]) for x in (self.loop, self.inner, self.turn))
            return ("from loop", loop, inner, turn, 0)
        name = self.lines.names[kind]
        return name if name[0] == "constant" else (*name, place, 0)

    def _write_straight(self, start: int, end: int) -> None:
        for at in range(start, end):
            code, *reads, target, place = self.table[at]
            op = self.lines.ops[code]
            if op == "put":
                item = ("put", self.one(*reads[:2]), self.lines.names[target], place, 0)
            elif isinstance(op, GroupItem):
                inputs = tuple(self.one(*x) for x in op.inputs) if op.inline else op.inputs
                item = op._replace(inputs=inputs)
            else:
                item = ("op", op, self.one(*reads[:2]), self.one(*reads[2:]))
                self.inner[at] = self.straight
                self.straight += 1
            self.encoded.append(item)

    def _values(self, start: int, period: int) -> Iterator[tuple[int, int]]:
        """Yield (number, step) of each value that an iteration reads."""
        for at in range(start, start + period):
            for column in (1, 3):
                kind, place = self.table[at][column : column + 2]
                if kind == 0 and place >= 0:
                    yield place, self.table[at + period][column + 1] - place

    def _even_part(self, start: int, period: int, count: int) -> tuple[int, int]:
        """Return (iterations to skip, iterations) of the longest part with even steps."""
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
        numbers = np.arange(start, end)
        self.loop[numbers] = self.loops
        self.inner[numbers] = (numbers - start) % period
        self.turn[numbers] = (numbers - start) // period
        self.loops += 1
        self.encoded.append(("loop", count, tuple(body)))

    def _inside(self, kind: int, place: int, later: int, where: Stretch) -> Tree | None:
        """Return the operand of an instruction of a loop: index `place` first, then `later`."""
        step = later - place
        if kind == 0 and place >= 0 and step:
            if _own(place, step, *where):
                start, period, _ = where
                first = tuple(self.one(kind, x) for x in range(place, start, period))
                inner = (place - start) % period
                return ("previous", inner, first) if first else ("current", inner)
            loop, inner, turn = (int(x[place]) for x in (self.loop, self.inner, self.turn))
            return ("from loop", loop, inner, turn, int(self.turn[later]) - turn)
        read = self.one(kind, place)
        return (*read[:2], place, step) if read and read[0] == "entry" else read


def _own(place: int, step: int, start: int, period: int, count: int) -> bool:
    """Return whether an operand, `place` first, is a result of the loop itself later on."""
    return step == period and place >= start - min(FARTHEST, count - 1) * period


# ---- Programs ------------------------------------------------------------------------------------

SHORT = 2500
"""Largest number of entries of a tape without loops in its program: faster, and soon compiled."""


class Program(NamedTuple):
    """The operations of a kernel.

    Attributes:
        items: operations, groups and loops, in order.
        arrays: number of entries of each array that is not an input.
    """

    items: Tree
    arrays: Tree


class NotRegularError(EomcheckError):
    """Error for programs of different sizes that do not follow one pattern."""


def program_of(tape: Tape, outputs: Mapping[str, Sequence[int]], short: int = SHORT) -> Program:
    """Return the program that computes the entries `outputs` of `tape`, by name of array.

    With `short` entries or fewer it has no loops, and is in the order of `by_urgency`.
    """
    places, _ = live_entries(tape, [p for roots in outputs.values() for p in roots])
    straight = len(places) <= short
    lines, arrays = instructions_of(tape, by_urgency(tape, places) if straight else places, outputs)
    stretches = []
    if not straight:
        lines = fused(lines, stretches_of(lines))
        stretches = stretches_of(lines)
    return Program(items_of(lines, stretches), tuple(sorted(arrays.items())))


# ---- Programs of any size ------------------------------------------------------------------------


def extrapolate_program(
    programs: Callable[[int], Program], size: int, first: int, step: int
) -> Program:
    """Return the program of `size`, extrapolated from those of first, first + step, first + 2 step.

    Raises:
        NotRegularError: they do not follow one pattern, in which every integer is affine in size.
    """
    one, two, three = (programs(first + i * step) for i in range(3))
    if _extrapolate(one, two, 2) != three:
        raise NotRegularError(f"programs of {first}, {first + step}, ... differ irregularly")
    turns, left = divmod(size - first, step)
    if left:
        raise NotRegularError(f"{size} is not {first} plus a multiple of {step}")
    return _extrapolate(one, two, turns)


def _extrapolate(one: Any, two: Any, turns: int) -> Any:
    """Return one + turns (two - one), leaf by leaf."""
    if one is two:
        return one
    if isinstance(one, tuple):
        if not isinstance(two, tuple) or len(one) != len(two):
            raise NotRegularError("programs of different sizes have different shapes")
        parts = [_extrapolate(x, y, turns) for x, y in zip(one, two, strict=True)]
        return type(one)(*parts) if hasattr(one, "_fields") else tuple(parts)
    whole = isinstance(one, int) and not isinstance(one, bool) and isinstance(two, int)
    if whole:
        return one + turns * (two - one)
    if one != two:
        raise NotRegularError(f"{one!r} in one program is {two!r} in the other")
    return one
