"""Derivatives of what stands on a tape, written on the same tape.

Forward, entry by entry, and only by the inputs that an entry depends on: most of a Jacobian of a
chain's functions is not there. A solve is differentiated as A x′ = b′ - A′ x, with the factors of A
that are there already.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from eomcheck.numbers import tape as t
from eomcheck.numbers.entries import each
from eomcheck.numbers.tape import Number, Tape, live

Rates = dict[int, Any]
"""Input, by its number among those asked for -> derivative, a number of the tape."""


def jacobian(tape: Tape, outputs: Sequence[int], inputs: Sequence[int]) -> list[int]:
    """Return the places of ∂output/∂input, row by row, and write what they need on the tape."""
    wanted = {place: i for i, place in enumerate(inputs)}
    rates: dict[int, Rates] = {}
    groups: dict[int, list[Rates]] = {}
    for place in live(tape, outputs)[0]:
        rates[place] = {wanted[place]: 1} if place in wanted else _rates(tape, place, rates, groups)
    zero = tape.constant(0.0).place
    return [
        tape.number(rates[place][i]).place if i in rates[place] else zero
        for place in outputs
        for i in range(len(inputs))
    ]


def _rates(
    tape: Tape, place: int, rates: dict[int, Rates], groups: dict[int, list[Rates]]
) -> Rates:
    op, x, y = tape.operations[place]
    if op in (t.CONSTANT, t.INPUT):
        return {}
    if op is t.PART:
        if x not in groups:
            groups[x] = _group_rates(tape, x, rates)
        return groups[x][y]
    here, one = Number(tape, place), Number(tape, x)
    if op is t.NEG:
        return {i: -d for i, d in rates[x].items()}
    if op is t.SQRT:
        return {i: d / (2 * here) for i, d in rates[x].items()}
    other = Number(tape, y)
    shares = {
        t.ADD: lambda d, e: d + e,
        t.SUB: lambda d, e: d - e,
        t.MUL: lambda d, e: d * other + one * e,
        t.DIV: lambda d, e: (d - here * e) / other,
    }[op]
    inputs = sorted(rates[x].keys() | rates[y].keys())
    return {i: shares(rates[x].get(i, 0), rates[y].get(i, 0)) for i in inputs}


def _group_rates(tape: Tape, number: int, rates: dict[int, Rates]) -> list[Rates]:
    """Return the rates of each part of a group."""
    kind, name, shape, reads, by = tape.groups[number]
    if kind is t.ANGLES:
        cos, sin = np.split(_parts(tape, number, 2 * len(reads)), 2)
        turning = [rates[place] for place in reads]
        return [{i: -s * d for i, d in r.items()} for s, r in zip(sin, turning, strict=True)] + [
            {i: c * d for i, d in r.items()} for c, r in zip(cos, turning, strict=True)
        ]
    if kind is t.PRODUCT:
        rows, inner, columns = shape
        A, B = _numbers(tape, reads[: rows * inner]), _numbers(tape, reads[rows * inner :])
        A, B = A.reshape(rows, inner), B.reshape(inner, columns)
        left, right = _moving(rates, reads[: A.size]), _moving(rates, reads[A.size :])
        return _collected(
            rows * columns,
            {
                i: _matrix(left, i, A.shape) @ B + A @ _matrix(right, i, B.shape)
                for i in sorted(left.keys() | right.keys())
            },
        )
    if kind is t.BAND:
        size = shape[0]
        x = _parts(tape, number, size)
        bands = _numbers(tape, reads[: 7 * size]).reshape(size, 7)
        left, right = _moving(rates, reads[: 7 * size]), _moving(rates, reads[7 * size :])
        behind = np.concatenate((np.zeros(3, object), x, np.zeros(3, object)))
        found = {}
        for i in sorted(left.keys() | right.keys()):
            change = _matrix(left, i, (size, 7))
            moved = [change[k] @ behind[k : k + 7] for k in range(size)]
            b = _matrix(right, i, (size,)) - np.array(moved, object)
            found[i] = tape.solve_banded(bands, each(tape.number, b), name)
        return _collected(size, found)
    size, columns = shape
    x = _parts(tape, number, size * columns).reshape(size, columns)
    entries = tape.groups[by].reads
    A = _numbers(tape, entries).reshape(size, size)
    left, right = _moving(rates, entries), _moving(rates, reads)
    inputs = sorted(left.keys() | right.keys())
    if not inputs:
        return [{} for _ in range(size * columns)]
    # All right-hand sides at once, by the factors that there are.
    b = [_matrix(right, i, x.shape) - _matrix(left, i, A.shape) @ x for i in inputs]
    solved = tape.solve(A, each(tape.number, np.hstack(b)), name).view(np.ndarray)
    parts = np.hsplit(solved, len(inputs))
    return _collected(size * columns, dict(zip(inputs, parts, strict=True)))


def _parts(tape: Tape, number: int, count: int) -> np.ndarray:
    return _numbers(tape, [tape.place(t.Operation(t.PART, number, i)) for i in range(count)])


def _numbers(tape: Tape, places: Sequence[int]) -> np.ndarray:
    out = np.empty(len(places), object)
    out[:] = [Number(tape, place) for place in places]
    return out


def _moving(rates: dict[int, Rates], places: Sequence[int]) -> dict[int, dict[int, Any]]:
    """Return input -> (entry -> derivative) of the entries that move with it."""
    found: dict[int, dict[int, Any]] = defaultdict(dict)
    for entry, place in enumerate(places):
        for i, rate in rates[place].items():
            found[i][entry] = rate
    return found


def _matrix(moving: dict[int, dict[int, Any]], i: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return the derivatives by input i as an array; 0 where an entry does not move."""
    out = np.zeros(shape, object)
    for entry, rate in moving.get(i, {}).items():
        out.flat[entry] = rate
    return out


def _collected(parts: int, found: dict[int, np.ndarray]) -> list[Rates]:
    """Return the rates of each part, from those of all parts by input."""
    out: list[Rates] = [{} for _ in range(parts)]
    for i, values in found.items():
        for part, value in enumerate(np.ravel(values)):
            if not (isinstance(value, int) and value == 0):
                out[part][i] = value
    return out
