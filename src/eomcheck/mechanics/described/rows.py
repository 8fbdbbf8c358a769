"""One constraint as a row, and the moving vectors that rows are made of."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from eomcheck.mechanics.described.absent import (
    AXES,
    NOTHING,
    Vector,
    dot,
    plus,
    subtracted,
    times,
)
from eomcheck.mechanics.described.topology import Closure

Columns = dict[int, Vector]


class Moving(NamedTuple):
    """A vector along the axes of the ground, and what a derivation knows of its motion."""

    value: Vector
    rate: Vector
    columns: Columns
    """∂(rate)/∂v by coordinate; none in the second derivation."""
    rest: Vector
    """Second rate at v̇ = 0; nothing in the second derivation."""


class Row(NamedTuple):
    """One constraint; what is absent is 0."""

    position: Any
    rate: Any
    """c, the rate of the position."""
    columns: dict[int, Any]
    """Its row of a."""
    rest: Any
    """gamma."""
    b: Any = None


class Derivation(Protocol):
    """What a row is made of."""

    def point(self, k: int, a: Vector) -> Moving:
        """Return the point a of frame k, -1 for the ground."""
        ...

    def direction(self, k: int, a: Vector) -> Moving:
        """Return the direction a of frame k."""
        ...

    def turning(self, k: int) -> Moving:
        """Return how frame k turns: the angular velocity as a rate, and nothing as its value."""
        ...

    def rim(self, axis: Moving, normal: Moving) -> tuple[Vector, Vector]:
        """Return n × (e × n), of a disk's axis n and a normal e, and its rate, where known."""
        ...

    q: Any
    v: Any
    driven: Any
    sines: Any


class Read(NamedTuple):
    """What the rows of a closure are made of."""

    points: list[Moving]
    directions: list[Moving]
    frames: tuple[int, ...]
    """Those of the points."""
    closure: Closure
    given: Any
    """Parameters."""
    at: Derivation
    planar: bool
    seen: dict[Any, Any]
    """What closures share, kept by whoever found it first."""
    sine: Any = None
    """Of the angle between the axis of a disk and the normal of its plane."""

    @property
    def second(self) -> list[Moving]:
        """Axes of the second frame."""
        return [self.at.direction(self.frames[1], x) for x in AXES]

    @property
    def turning(self) -> list[Moving]:
        """How the frames of the points turn."""
        return [self.at.turning(k) for k in self.frames]

    @property
    def apart(self) -> Moving:
        """The first point as seen from the second."""
        return between(*self.points)


def between(a: Moving, b: Moving) -> Moving:
    """Return the vector to a from b."""
    return Moving(
        subtracted(a.value, b.value),
        subtracted(a.rate, b.rate),
        {
            i: subtracted(a.columns.get(i, NOTHING), b.columns.get(i, NOTHING))
            for i in {**a.columns, **b.columns}
        },
        subtracted(a.rest, b.rest),
    )


def product(a: Moving, b: Moving) -> Row:
    """Return that a · b = 0."""
    columns = {
        i: plus(dot(a.columns.get(i, NOTHING), b.value), dot(a.value, b.columns.get(i, NOTHING)))
        for i in {**a.columns, **b.columns}
    }
    rest = plus(dot(a.rest, b.value), dot(a.value, b.rest))
    return Row(
        dot(a.value, b.value),
        plus(dot(a.rate, b.value), dot(a.value, b.rate)),
        columns,
        plus(rest, times(2, dot(a.rate, b.rate))),
    )


def repeated(row: Row, factor: Any) -> Row:
    """Return so many times a row."""
    columns = {i: times(factor, x) for i, x in row.columns.items()}
    numbers = (times(factor, x) for x in (row.position, row.rate, row.rest, row.b))
    position, rate, rest, b = numbers
    return Row(position, rate, columns, rest, b)
