"""Constraints by declaration, and their rows.

What a row is made of are vectors, points of frames and directions that turn with them. Here it is
said once what rows follow from their values, rates, columns and rests; each derivation brings its
own vectors.

- "pin": a point of one frame is a point of another: 2 rows in the plane, 3 in space
- "weld": and they do not turn against each other: 1 row more in the plane, 3 in space
- "hinge": a pin in space about a direction of the second frame: 2 rows more
- "distance": two points keep their distance
- "on-plane": a point of the first frame stays on a plane of the second
- "on-quadric": it stays on a surface of the second order
- "square": a direction of the first frame is perpendicular to one of the second
- "coupling": q_i = ratio q_j + shift
- "drive": q_i = p + r t + a t²/2
- "edge": a point does not move along a direction of its frame, and the position is free
- "touching": a ball or the rim of a disk touches a plane of the second frame
- "rolling": where it touches the plane it does not slip along a direction (`rolling`)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from eomcheck.mechanics.described.absent import (
    dot,
    minus,
    plus,
    times,
    vector,
)
from eomcheck.mechanics.described.rolling import rolling, touching
from eomcheck.mechanics.described.rows import Derivation, Moving, Read, Row, product, repeated
from eomcheck.mechanics.described.topology import Closure, Plan


def pin(read: Read) -> list[Row]:
    """Return that two points are one."""
    a = read.apart
    return [
        Row(a.value[i], a.rate[i], {j: x[i] for j, x in a.columns.items()}, a.rest[i])
        for i in range(2 if read.planar else 3)
    ]


def weld(read: Read) -> list[Row]:
    """Return that two frames are one."""
    x, *others = read.directions
    along_x, along_y, along_z = read.second
    rows = [*pin(read), product(x, along_y)]
    if not read.planar:
        y, z = others
        rows += [product(y, along_z), product(z, along_x)]
    return rows


def hinge(read: Read) -> list[Row]:
    """Return that two points are one, and a direction across two others."""
    first, second, axis = read.directions
    return [*pin(read), product(first, axis), product(second, axis)]


def distance(read: Read) -> list[Row]:
    """Return that (d² - L²)/2 = 0."""
    apart, length = read.apart, read.given.lengths[read.closure.number]
    square = minus(dot(apart.value, apart.value), length * length)
    return [
        Row(
            None if square is None else square / 2,
            dot(apart.value, apart.rate),
            {i: dot(apart.value, x) for i, x in apart.columns.items()},
            plus(dot(apart.value, apart.rest), dot(apart.rate, apart.rate)),
        )
    ]


def on_plane(read: Read) -> list[Row]:
    """Return that a point is on the plane across a direction through another."""
    return [product(read.apart, read.directions[0])]


def on_quadric(read: Read) -> list[Row]:
    """Return that Σ (k_i s_i²/2 + g_i s_i) - h = 0 of a point's places s along three directions."""
    numbers, apart = read.given.surfaces[read.closure.number], read.apart
    position = rate = rest = None
    columns: dict[int, Any] = {}
    for i, direction in enumerate(read.directions):
        s, bend, slope = product(apart, direction), numbers[i], numbers[3 + i]
        bent = times(bend, s.position)
        steep, mean = plus(bent, slope), plus(None if bent is None else bent / 2, slope)
        position = plus(position, times(s.position, mean))
        rate = plus(rate, times(steep, s.rate))
        columns |= {j: plus(columns.get(j), times(steep, x)) for j, x in s.columns.items()}
        rest = plus(rest, plus(times(steep, s.rest), times(bend, times(s.rate, s.rate))))
    return [Row(minus(position, numbers[6]), rate, columns, rest)]


def square(read: Read) -> list[Row]:
    """Return that two directions are perpendicular."""
    a, b = read.directions
    return [product(a, b)]


def edge(read: Read) -> list[Row]:
    """Return that a point has no velocity along a direction."""
    (point,), (along,) = read.points, read.directions
    return [
        Row(
            None,
            dot(point.rate, along.value),
            {i: dot(x, along.value) for i, x in point.columns.items()},
            plus(dot(point.rest, along.value), dot(point.rate, along.rate)),
        )
    ]


def coupling(read: Read) -> list[Row]:
    """Return that one coordinate follows another."""
    (i, j), (ratio, shift) = read.closure.coordinates, read.given.couplings[read.closure.number]
    q, v = read.at.q, read.at.v
    rate = None if v is None else v[i] - ratio * v[j]
    return [Row(q[i] - ratio * q[j] - shift, rate, {i: 1, j: -ratio}, None)]


def drive(read: Read) -> list[Row]:
    """Return that a coordinate follows a clock."""
    (i,) = read.closure.coordinates
    position, rate, acceleration = read.at.driven[:, read.closure.number]
    moved = None if read.at.v is None else read.at.v[i] - rate
    return [Row(read.at.q[i] - position, moved, {i: 1}, -acceleration, -rate)]


class Closing(NamedTuple):
    """A kind of closure."""

    rows: Callable[[Read], list[Row]]
    planar: int
    """Number of rows in the plane."""
    spatial: int
    points: int = 0
    numbers: str = ""
    """The parameter that its numbers are part of."""
    holonomic: bool = True


KINDS = {
    "pin": Closing(pin, 2, 3, 2),
    "weld": Closing(weld, 3, 6, 2),
    "hinge": Closing(hinge, 0, 5, 2),
    "distance": Closing(distance, 1, 1, 2, "lengths"),
    "on-plane": Closing(on_plane, 1, 1, 2),
    "on-quadric": Closing(on_quadric, 1, 1, 2, "surfaces"),
    "square": Closing(square, 1, 1),
    "coupling": Closing(coupling, 1, 1, numbers="couplings"),
    "drive": Closing(drive, 1, 1, numbers="drives"),
    "edge": Closing(edge, 1, 1, 1, holonomic=False),
    "touching": Closing(touching, 1, 1, 2, "lengths"),
    "rolling": Closing(rolling, 1, 1, 2, "lengths", holonomic=False),
}


def rows_of(closure: Closure, planar: bool) -> int:
    """Return how many rows a closure has."""
    kind = KINDS[closure.kind]
    return kind.planar if planar else kind.spatial


def rows(plan: Plan, given: Any, at: Derivation) -> list[Row]:
    """Return all rows, closure by closure."""
    found: list[Row] = []
    seen: dict[Any, Any] = {}  # many closures share a point, or a place where something rolls

    def of(what: Callable, k: int, i: int, numbers: Any) -> Moving:
        if (what, k, i) not in seen:
            seen[what, k, i] = what(k, vector(numbers[i]))
        return seen[what, k, i]

    for closure in plan.topology.closures:
        points = [of(at.point, k, i, given.points) for k, i in closure.points]
        directions = [of(at.direction, k, i, given.directions) for k, i in closure.directions]
        frames = tuple(k for k, _ in closure.points)
        disk = plan.disk.get(closure.directions[1:])
        sine = None if disk is None else at.sines[disk]
        planar = plan.topology.planar
        read = Read(points, directions, frames, closure, given, at, planar, seen, sine)
        some = KINDS[closure.kind].rows(read)
        if closure.factor is not None:
            some = [repeated(row, given.factors[closure.factor]) for row in some]
        found += some
    return found
