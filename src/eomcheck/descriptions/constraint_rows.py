"""Constraints by declaration: their kinds, their rows, and the functions a, b, gamma, c of a scene.

A row is made of vectors that move: points of frames and directions that turn with them (`Moving`).
Here it is written once how a row follows from their values, rates, columns and rests; each
derivation (`First`, `Second`) brings its own vectors.

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
- "rolling": where it touches the plane it does not slip along a direction

Rolling: a ball touches the plane straight below its centre, at -R e with the plane's normal e. The
rim of a disk with the axis n is lowest at -R n × (e × n) / s with s = |e × n|, a root, for e and n
of length 1. Where some link has the direction of the spoke that touches, as the frame that leans
with a disk but does not spin, it is given instead, and there is no root. The point of contact
belongs to the rim for a moment only: it wanders along it while the disk leans.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from eomcheck.descriptions import second_derivation
from eomcheck.descriptions.first_derivation import (
    GROUND,
    STILL,
    columns,
    moving,
    placed,
    point_of,
    swung,
    turning_columns,
)
from eomcheck.descriptions.optional_algebra import (
    AXES,
    NOTHING,
    Vector,
    added,
    centripetal,
    cross,
    dot,
    levelled,
    minus,
    plus,
    put,
    scaled,
    subtracted,
    times,
    vector,
)
from eomcheck.descriptions.second_derivation import level
from eomcheck.descriptions.topology import Closure, Plan

# ---- Vectors and rows ----------------------------------------------------------------------------

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


# ---- Rolling on a plane --------------------------------------------------------------------------


def with_sines(plan: Plan, prepare: Callable) -> Callable:
    """Return a function that prepares too how far the axes of disks are from upright."""
    if not plan.disks:
        return prepare

    def prepare_all(arithmetic, parameters, q, t):
        prepared = prepare(arithmetic, parameters, q, t)
        square = np.zeros(len(plan.disks), q.dtype)
        for i, pair in enumerate(plan.disks):
            axis, normal = (
                level(plan, parameters, prepared, k, vector(parameters.directions[j]))
                for k, j in pair
            )
            across = cross(normal, axis)  # 1 - (e · n)² has no digit left of a small sine
            square[i] = dot(across, across)
        return prepared._replace(sines=arithmetic.root(square))

    return prepare_all


def radius(read: Read) -> Any:
    """Return R, m."""
    return read.given.lengths[read.closure.number]


def arm_of(read: Read) -> tuple[Vector, Vector]:
    """Return from the centre to the point of contact, and the rate of that."""
    R, (_, *told) = radius(read), read.directions
    if len(told) == 1:
        (spoke,) = told
        return scaled(-R, spoke.value), scaled(-R, spoke.rate)
    axis, normal = told
    upright, s = product(axis, normal), read.sine
    share = -(R / s)
    spoke, moved = read.at.rim(axis, normal)
    arm = scaled(share, spoke)
    shorter = times(times(upright.position, upright.rate), 1 / (s * s))
    return arm, added(scaled(share, moved), scaled(shorter, arm))


def slipping(read: Read) -> Moving:
    """Return how fast the point of contact moves against the plane that it touches."""
    (center, foot), (spin, turn) = read.points, read.turning
    arm, wandering = arm_of(read)
    reach = added(subtracted(center.value, foot.value), arm)
    rim = added(center.rate, cross(spin.rate, arm))
    floor = added(foot.rate, cross(turn.rate, reach))
    columns = {}
    for i in {**center.columns, **spin.columns, **foot.columns, **turn.columns}:
        V, omega, W, Omega = (x.columns.get(i, NOTHING) for x in (center, spin, foot, turn))
        apart = added(subtracted(V, W), cross(reach, Omega))
        columns[i] = subtracted(apart, cross(arm, omega))
    going = added(subtracted(center.rate, foot.rate), wandering)
    rolled = added(cross(spin.rest, arm), cross(spin.rate, wandering))
    carried = added(cross(turn.rest, reach), cross(turn.rate, going))
    rest = added(subtracted(center.rest, foot.rest), subtracted(rolled, carried))
    return Moving(NOTHING, subtracted(rim, floor), columns, rest)


def rolling(read: Read) -> list[Row]:
    """Return that the point of contact does not slip along a direction."""
    _, *told = read.closure.directions
    place = slipping, read.closure.points, tuple(told), read.closure.number
    if place not in read.seen:
        read.seen[place] = slipping(read)
    slip, along = read.seen[place], read.directions[0]
    return [
        Row(
            None,
            dot(slip.rate, along.value),
            {i: dot(x, along.value) for i, x in slip.columns.items()},
            plus(dot(slip.rest, along.value), dot(slip.rate, along.rate)),
        )
    ]


def touching(read: Read) -> list[Row]:
    """Return that the point of contact is on the plane, whose normal is the first direction.

    Its height is found where it is, and its row from how the point of contact moves.
    """
    R, (normal, *told) = radius(read), read.directions
    if (
        read.closure.directions[1:] == read.closure.directions[:1]
    ):  # a ball: R below its centre, however the plane turns
        row = product(read.apart, normal)
        return [row._replace(position=minus(row.position, R))]
    (row,) = rolling(read)
    centered = dot(read.apart.value, normal.value)
    rise = read.sine if len(told) == 2 else dot(told[0].value, normal.value)
    return [row._replace(position=minus(centered, times(R, rise)))]


# ---- Kinds of constraints ------------------------------------------------------------------------


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


# ---- Two derivations, and the functions of a scene -----------------------------------------------


class First:
    """Vectors by columns and rests; without v only where they are and their columns."""

    def __init__(self, plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.plan, self.q, self.v = plan, q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.frames = placed(plan, parameters, prepared)
        self.rates = None if v is None else moving(plan, parameters, self.frames, v)

    def point(self, k: int, a: Vector) -> Moving:
        """Return the point a of frame k."""
        arm, at = point_of(self.frames, k, a)
        found = columns(self.plan, self.frames, k, (arm, at))
        if self.rates is None or k < 0:
            return Moving(at, NOTHING, found, NOTHING)
        rest = added(self.rates[k].rest, swung(self.rates[k], arm))
        return Moving(at, self._rate(found), found, rest)

    def direction(self, k: int, a: Vector) -> Moving:
        """Return the direction a of frame k."""
        along = levelled((self.frames[k] if k >= 0 else GROUND).axes, a)
        turning = turning_columns(self.plan, self.frames, k)
        found = {i: cross(x, along) for i, x in turning.items()}
        rates = STILL if self.rates is None or k < 0 else self.rates[k]
        rest = added(cross(rates.alpha, along), centripetal(rates.omega, along))
        return Moving(along, cross(rates.omega, along), found, rest)

    def turning(self, k: int) -> Moving:
        """Return how frame k turns."""
        rates = STILL if self.rates is None or k < 0 else self.rates[k]
        found = turning_columns(self.plan, self.frames, k)
        return Moving(NOTHING, rates.omega, found, rates.alpha)

    def rim(self, axis: Moving, normal: Moving) -> tuple[Vector, Vector]:
        """Return (n·n) e - (e·n) n and its rate."""
        upright, square = product(axis, normal), dot(axis.value, axis.value)
        along = scaled(upright.position, axis.value)
        moved = added(scaled(upright.rate, axis.value), scaled(upright.position, axis.rate))
        spoke, rate = (scaled(square, x) for x in (normal.value, normal.rate))
        return subtracted(spoke, along), subtracted(rate, moved)

    def _rate(self, found: dict[int, Vector]) -> Vector:
        rate = NOTHING
        for i, one in found.items():
            rate = added(rate, tuple(None if x is None else x * self.v[i] for x in one))
        return rate


class Second:
    """Vectors by positions and velocities that are passed on; without v only where they are."""

    def __init__(self, plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.here, self.q, self.v = (plan, parameters, prepared), q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.rates = (
            None if v is None else second_derivation.passed_on(plan, parameters, prepared, v)
        )

    def point(self, k: int, a: Vector) -> Moving:
        """Return the point a of frame k."""
        rate = NOTHING if self.rates is None else second_derivation.moved_point(self.rates, k, a)
        at, moved = (
            second_derivation.place(*self.here, k, a),
            second_derivation.level(*self.here, k, rate),
        )
        return Moving(at, moved, {}, NOTHING)

    def direction(self, k: int, a: Vector) -> Moving:
        """Return the direction a of frame k."""
        omega = NOTHING if self.rates is None or k < 0 else self.rates[k][1]
        along, rate = (second_derivation.level(*self.here, k, x) for x in (a, cross(omega, a)))
        return Moving(along, rate, {}, NOTHING)

    def turning(self, k: int) -> Moving:
        """Return how frame k turns."""
        omega = NOTHING if self.rates is None or k < 0 else self.rates[k][1]
        return Moving(NOTHING, second_derivation.level(*self.here, k, omega), {}, NOTHING)

    def rim(self, axis: Moving, normal: Moving) -> tuple[Vector, Vector]:
        """Return n × (e × n)."""
        return cross(axis.value, cross(normal.value, axis.value)), NOTHING


def holonomic_rows(plan: Plan) -> list[int]:
    """Return which rows are rates of positions."""
    planar, closures = plan.topology.planar, plan.topology.closures
    each = [KINDS[one.kind].holonomic for one in closures for _ in range(rows_of(one, planar))]
    return [i for i, one in enumerate(each) if one]


def constraints_of(plan: Plan) -> dict[str, Any]:
    """Return the functions of a scene that are about its closures."""
    closures = plan.topology.closures
    if not closures:
        return {}
    planar = plan.topology.planar
    r = sum(rows_of(one, planar) for one in closures)
    held = holonomic_rows(plan)
    driven = any(one.kind == "drive" for one in closures)

    def constraints(parameters, prepared, q):
        a, b = np.zeros((r, plan.n), q.dtype), np.zeros(r, q.dtype)
        for i, row in enumerate(rows(plan, parameters, First(plan, parameters, prepared, q))):
            for j, x in row.columns.items():
                put(a, (i, j), x)
            put(b, i, row.b)
        return a, b if driven else None

    def drift(parameters, prepared, q, v):
        gamma = np.zeros(r, v.dtype)
        found = rows(plan, parameters, First(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(gamma, i, row.rest)
        return gamma

    def constraint(parameters, prepared, q, v):
        c = np.zeros(r, v.dtype)
        found = rows(plan, parameters, Second(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(c, i, row.rate)
        return c

    def position_residual(parameters, prepared, q):
        residual = np.zeros(len(held), q.dtype)
        found = rows(plan, parameters, Second(plan, parameters, prepared, q))
        for i, k in enumerate(held):
            put(residual, i, found[k].position)
        return residual

    found = {"constraints": constraints, "drift": drift, "constraint": constraint}
    return found | ({"position_residual": position_residual} if held else {})
