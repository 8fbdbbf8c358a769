"""Constraints by declaration: their kinds, their rows, and the functions a, b, gamma, c of a scene.

A row is made of vectors that move: points of frames and directions that turn with them
(`MovingVector`).
Here it is written once how a row follows from their values, rates, columns and rests; each
derivation (`FirstDerivation`, `SecondDerivation`) brings its own vectors.

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
    GROUND_RATES,
    arm_and_position,
    frame_rates,
    joint_frames,
    point_columns,
    relative_acceleration,
    turning_columns,
)
from eomcheck.descriptions.optional_algebra import (
    AXES,
    ZERO_VECTOR,
    Vector,
    add_vectors,
    as_vector,
    centripetal,
    cross,
    dot,
    from_local,
    minus,
    plus,
    put,
    scale_vector,
    subtract_vectors,
    times,
)
from eomcheck.descriptions.second_derivation import direction_in_ground
from eomcheck.descriptions.topology import ConstraintSpec, TopologyPlan

# ---- Vectors and rows ----------------------------------------------------------------------------

Columns = dict[int, Vector]


class MovingVector(NamedTuple):
    """A vector along the axes of the ground, and what a derivation knows of its motion."""

    value: Vector
    rate: Vector
    columns: Columns
    """∂(rate)/∂v by coordinate; none in the second derivation."""
    acceleration: Vector
    """Second rate at v̇ = 0; nothing in the second derivation."""


class ConstraintRow(NamedTuple):
    """One constraint; what is absent is 0."""

    position: Any
    rate: Any
    """c, the rate of the position."""
    columns: dict[int, Any]
    """Its row of a."""
    drift: Any
    """gamma."""
    b: Any = None


class Derivation(Protocol):
    """What a row is made of."""

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k, -1 for the ground."""
        ...

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        ...

    def rotation(self, k: int) -> MovingVector:
        """Return how frame k turns: the angular velocity as a rate, and nothing as its value."""
        ...

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return n × (e × n), of a disk's axis n and a normal e, and its rate, where known."""
        ...

    q: Any
    v: Any
    driven: Any
    sines: Any


class ConstraintInputs(NamedTuple):
    """What the rows of a closure are made of."""

    points: list[MovingVector]
    directions: list[MovingVector]
    frames: tuple[int, ...]
    """Those of the points."""
    spec: ConstraintSpec
    parameters: Any
    """Parameters."""
    derivation: Derivation
    planar: bool
    cache: dict[Any, Any]
    """What closures share, kept by whoever found it first."""
    sine: Any = None
    """Of the angle between the axis of a disk and the normal of its plane."""

    @property
    def second_axes(self) -> list[MovingVector]:
        """Axes of the second frame."""
        return [self.derivation.direction(self.frames[1], x) for x in AXES]

    @property
    def rotations(self) -> list[MovingVector]:
        """How the frames of the points turn."""
        return [self.derivation.rotation(k) for k in self.frames]

    @property
    def separation(self) -> MovingVector:
        """The first point as seen from the second."""
        return relative_vector(*self.points)


def relative_vector(a: MovingVector, b: MovingVector) -> MovingVector:
    """Return the vector to a from b."""
    return MovingVector(
        subtract_vectors(a.value, b.value),
        subtract_vectors(a.rate, b.rate),
        {
            i: subtract_vectors(a.columns.get(i, ZERO_VECTOR), b.columns.get(i, ZERO_VECTOR))
            for i in {**a.columns, **b.columns}
        },
        subtract_vectors(a.acceleration, b.acceleration),
    )


def dot_row(a: MovingVector, b: MovingVector) -> ConstraintRow:
    """Return that a · b = 0."""
    columns = {
        i: plus(
            dot(a.columns.get(i, ZERO_VECTOR), b.value), dot(a.value, b.columns.get(i, ZERO_VECTOR))
        )
        for i in {**a.columns, **b.columns}
    }
    rest = plus(dot(a.acceleration, b.value), dot(a.value, b.acceleration))
    return ConstraintRow(
        dot(a.value, b.value),
        plus(dot(a.rate, b.value), dot(a.value, b.rate)),
        columns,
        plus(rest, times(2, dot(a.rate, b.rate))),
    )


def scaled_row(row: ConstraintRow, factor: Any) -> ConstraintRow:
    """Return so many times a row."""
    columns = {i: times(factor, x) for i, x in row.columns.items()}
    numbers = (times(factor, x) for x in (row.position, row.rate, row.drift, row.b))
    position, rate, rest, b = numbers
    return ConstraintRow(position, rate, columns, rest, b)


# ---- Rolling on a plane --------------------------------------------------------------------------


def with_sines(plan: TopologyPlan, prepare: Callable) -> Callable:
    """Return a function that prepares too how far the axes of disks are from upright."""
    if not plan.disks:
        return prepare

    def prepare_all(arithmetic, parameters, q, t):
        prepared = prepare(arithmetic, parameters, q, t)
        square = np.zeros(len(plan.disks), q.dtype)
        for i, pair in enumerate(plan.disks):
            axis, normal = (
                direction_in_ground(
                    plan, parameters, prepared, k, as_vector(parameters.directions[j])
                )
                for k, j in pair
            )
            across = cross(normal, axis)  # 1 - (e · n)² has no digit left of a small sine
            square[i] = dot(across, across)
        return prepared._replace(sines=arithmetic.root(square))

    return prepare_all


def radius(read: ConstraintInputs) -> Any:
    """Return R, m."""
    return read.parameters.lengths[read.spec.number]


def contact_arm(read: ConstraintInputs) -> tuple[Vector, Vector]:
    """Return from the centre to the point of contact, and the rate of that."""
    R, (_, *told) = radius(read), read.directions
    if len(told) == 1:
        (spoke,) = told
        return scale_vector(-R, spoke.value), scale_vector(-R, spoke.rate)
    axis, normal = told
    upright, s = dot_row(axis, normal), read.sine
    share = -(R / s)
    spoke, moved = read.derivation.rim(axis, normal)
    arm = scale_vector(share, spoke)
    shorter = times(times(upright.position, upright.rate), 1 / (s * s))
    return arm, add_vectors(scale_vector(share, moved), scale_vector(shorter, arm))


def slip_velocity(read: ConstraintInputs) -> MovingVector:
    """Return how fast the point of contact moves against the plane that it touches."""
    (center, foot), (spin, turn) = read.points, read.rotations
    arm, wandering = contact_arm(read)
    reach = add_vectors(subtract_vectors(center.value, foot.value), arm)
    rim = add_vectors(center.rate, cross(spin.rate, arm))
    floor = add_vectors(foot.rate, cross(turn.rate, reach))
    columns = {}
    for i in {**center.columns, **spin.columns, **foot.columns, **turn.columns}:
        V, omega, W, Omega = (x.columns.get(i, ZERO_VECTOR) for x in (center, spin, foot, turn))
        apart = add_vectors(subtract_vectors(V, W), cross(reach, Omega))
        columns[i] = subtract_vectors(apart, cross(arm, omega))
    going = add_vectors(subtract_vectors(center.rate, foot.rate), wandering)
    rolled = add_vectors(cross(spin.acceleration, arm), cross(spin.rate, wandering))
    carried = add_vectors(cross(turn.acceleration, reach), cross(turn.rate, going))
    rest = add_vectors(
        subtract_vectors(center.acceleration, foot.acceleration), subtract_vectors(rolled, carried)
    )
    return MovingVector(ZERO_VECTOR, subtract_vectors(rim, floor), columns, rest)


def rolling_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that the point of contact does not slip along a direction."""
    _, *told = read.spec.directions
    place = slip_velocity, read.spec.points, tuple(told), read.spec.number
    if place not in read.cache:
        read.cache[place] = slip_velocity(read)
    slip, along = read.cache[place], read.directions[0]
    return [
        ConstraintRow(
            None,
            dot(slip.rate, along.value),
            {i: dot(x, along.value) for i, x in slip.columns.items()},
            plus(dot(slip.acceleration, along.value), dot(slip.rate, along.rate)),
        )
    ]


def touching_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that the point of contact is on the plane, whose normal is the first direction.

    Its height is found where it is, and its row from how the point of contact moves.
    """
    R, (normal, *told) = radius(read), read.directions
    if (
        read.spec.directions[1:] == read.spec.directions[:1]
    ):  # a ball: R below its centre, however the plane turns
        row = dot_row(read.separation, normal)
        return [row._replace(position=minus(row.position, R))]
    (row,) = rolling_rows(read)
    centered = dot(read.separation.value, normal.value)
    rise = read.sine if len(told) == 2 else dot(told[0].value, normal.value)
    return [row._replace(position=minus(centered, times(R, rise)))]


# ---- Kinds of constraints ------------------------------------------------------------------------


def pin_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that two points are one."""
    a = read.separation
    return [
        ConstraintRow(
            a.value[i], a.rate[i], {j: x[i] for j, x in a.columns.items()}, a.acceleration[i]
        )
        for i in range(2 if read.planar else 3)
    ]


def weld_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that two frames are one."""
    x, *others = read.directions
    along_x, along_y, along_z = read.second_axes
    rows = [*pin_rows(read), dot_row(x, along_y)]
    if not read.planar:
        y, z = others
        rows += [dot_row(y, along_z), dot_row(z, along_x)]
    return rows


def hinge_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that two points are one, and a direction across two others."""
    first, second, axis = read.directions
    return [*pin_rows(read), dot_row(first, axis), dot_row(second, axis)]


def distance_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that (d² - L²)/2 = 0."""
    apart, length = read.separation, read.parameters.lengths[read.spec.number]
    square = minus(dot(apart.value, apart.value), length * length)
    return [
        ConstraintRow(
            None if square is None else square / 2,
            dot(apart.value, apart.rate),
            {i: dot(apart.value, x) for i, x in apart.columns.items()},
            plus(dot(apart.value, apart.acceleration), dot(apart.rate, apart.rate)),
        )
    ]


def on_plane_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that a point is on the plane across a direction through another."""
    return [dot_row(read.separation, read.directions[0])]


def on_quadric_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that Σ (k_i s_i²/2 + g_i s_i) - h = 0 of a point's places s along three directions."""
    numbers, apart = read.parameters.surfaces[read.spec.number], read.separation
    position = rate = rest = None
    columns: dict[int, Any] = {}
    for i, direction in enumerate(read.directions):
        s, bend, slope = dot_row(apart, direction), numbers[i], numbers[3 + i]
        bent = times(bend, s.position)
        steep, mean = plus(bent, slope), plus(None if bent is None else bent / 2, slope)
        position = plus(position, times(s.position, mean))
        rate = plus(rate, times(steep, s.rate))
        columns |= {j: plus(columns.get(j), times(steep, x)) for j, x in s.columns.items()}
        rest = plus(rest, plus(times(steep, s.drift), times(bend, times(s.rate, s.rate))))
    return [ConstraintRow(minus(position, numbers[6]), rate, columns, rest)]


def perpendicular_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that two directions are perpendicular."""
    a, b = read.directions
    return [dot_row(a, b)]


def knife_edge_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that a point has no velocity along a direction."""
    (point,), (along,) = read.points, read.directions
    return [
        ConstraintRow(
            None,
            dot(point.rate, along.value),
            {i: dot(x, along.value) for i, x in point.columns.items()},
            plus(dot(point.acceleration, along.value), dot(point.rate, along.rate)),
        )
    ]


def coupling_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that one coordinate follows another."""
    (i, j), (ratio, shift) = read.spec.coordinates, read.parameters.couplings[read.spec.number]
    q, v = read.derivation.q, read.derivation.v
    rate = None if v is None else v[i] - ratio * v[j]
    return [ConstraintRow(q[i] - ratio * q[j] - shift, rate, {i: 1, j: -ratio}, None)]


def drive_rows(read: ConstraintInputs) -> list[ConstraintRow]:
    """Return that a coordinate follows a clock."""
    (i,) = read.spec.coordinates
    position, rate, acceleration = read.derivation.driven[:, read.spec.number]
    moved = None if read.derivation.v is None else read.derivation.v[i] - rate
    return [ConstraintRow(read.derivation.q[i] - position, moved, {i: 1}, -acceleration, -rate)]


class ConstraintKind(NamedTuple):
    """A kind of closure."""

    rows: Callable[[ConstraintInputs], list[ConstraintRow]]
    planar: int
    """Number of rows in the plane."""
    spatial: int
    points: int = 0
    numbers: str = ""
    """The parameter that its numbers are part of."""
    holonomic: bool = True


KINDS = {
    "pin": ConstraintKind(pin_rows, 2, 3, 2),
    "weld": ConstraintKind(weld_rows, 3, 6, 2),
    "hinge": ConstraintKind(hinge_rows, 0, 5, 2),
    "distance": ConstraintKind(distance_rows, 1, 1, 2, "lengths"),
    "on-plane": ConstraintKind(on_plane_rows, 1, 1, 2),
    "on-quadric": ConstraintKind(on_quadric_rows, 1, 1, 2, "surfaces"),
    "square": ConstraintKind(perpendicular_rows, 1, 1),
    "coupling": ConstraintKind(coupling_rows, 1, 1, numbers="couplings"),
    "drive": ConstraintKind(drive_rows, 1, 1, numbers="drives"),
    "edge": ConstraintKind(knife_edge_rows, 1, 1, 1, holonomic=False),
    "touching": ConstraintKind(touching_rows, 1, 1, 2, "lengths"),
    "rolling": ConstraintKind(rolling_rows, 1, 1, 2, "lengths", holonomic=False),
}


def row_count(closure: ConstraintSpec, planar: bool) -> int:
    """Return how many rows a closure has."""
    kind = KINDS[closure.kind]
    return kind.planar if planar else kind.spatial


def all_rows(plan: TopologyPlan, given: Any, at: Derivation) -> list[ConstraintRow]:
    """Return all rows, closure by closure."""
    found: list[ConstraintRow] = []
    seen: dict[Any, Any] = {}  # many closures share a point, or a place where something rolls

    def of(what: Callable, k: int, i: int, numbers: Any) -> MovingVector:
        if (what, k, i) not in seen:
            seen[what, k, i] = what(k, as_vector(numbers[i]))
        return seen[what, k, i]

    for closure in plan.topology.constraints:
        points = [of(at.point, k, i, given.points) for k, i in closure.points]
        directions = [of(at.direction, k, i, given.directions) for k, i in closure.directions]
        frames = tuple(k for k, _ in closure.points)
        disk = plan.disk_index.get(closure.directions[1:])
        sine = None if disk is None else at.sines[disk]
        planar = plan.topology.planar
        read = ConstraintInputs(points, directions, frames, closure, given, at, planar, seen, sine)
        some = KINDS[closure.kind].rows(read)
        if closure.factor is not None:
            some = [scaled_row(row, given.factors[closure.factor]) for row in some]
        found += some
    return found


# ---- Two derivations, and the functions of a scene -----------------------------------------------


class FirstDerivation:
    """Vectors by columns and rests; without v only where they are and their columns."""

    def __init__(self, plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.plan, self.q, self.v = plan, q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.frames = joint_frames(plan, parameters, prepared)
        self.rates = None if v is None else frame_rates(plan, parameters, self.frames, v)

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k."""
        arm, at = arm_and_position(self.frames, k, a)
        found = point_columns(self.plan, self.frames, k, (arm, at))
        if self.rates is None or k < 0:
            return MovingVector(at, ZERO_VECTOR, found, ZERO_VECTOR)
        rest = add_vectors(self.rates[k].acceleration, relative_acceleration(self.rates[k], arm))
        return MovingVector(at, self._rate(found), found, rest)

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        along = from_local((self.frames[k] if k >= 0 else GROUND).axes, a)
        turning = turning_columns(self.plan, self.frames, k)
        found = {i: cross(x, along) for i, x in turning.items()}
        rates = GROUND_RATES if self.rates is None or k < 0 else self.rates[k]
        rest = add_vectors(cross(rates.alpha, along), centripetal(rates.omega, along))
        return MovingVector(along, cross(rates.omega, along), found, rest)

    def rotation(self, k: int) -> MovingVector:
        """Return how frame k turns."""
        rates = GROUND_RATES if self.rates is None or k < 0 else self.rates[k]
        found = turning_columns(self.plan, self.frames, k)
        return MovingVector(ZERO_VECTOR, rates.omega, found, rates.alpha)

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return (n·n) e - (e·n) n and its rate."""
        upright, square = dot_row(axis, normal), dot(axis.value, axis.value)
        along = scale_vector(upright.position, axis.value)
        moved = add_vectors(
            scale_vector(upright.rate, axis.value), scale_vector(upright.position, axis.rate)
        )
        spoke, rate = (scale_vector(square, x) for x in (normal.value, normal.rate))
        return subtract_vectors(spoke, along), subtract_vectors(rate, moved)

    def _rate(self, found: dict[int, Vector]) -> Vector:
        rate = ZERO_VECTOR
        for i, one in found.items():
            rate = add_vectors(rate, tuple(None if x is None else x * self.v[i] for x in one))
        return rate


class SecondDerivation:
    """Vectors by positions and velocities that are passed on; without v only where they are."""

    def __init__(self, plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.here, self.q, self.v = (plan, parameters, prepared), q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.rates = (
            None if v is None else second_derivation.frame_velocities(plan, parameters, prepared, v)
        )

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k."""
        rate = (
            ZERO_VECTOR
            if self.rates is None
            else second_derivation.point_velocity(self.rates, k, a)
        )
        at, moved = (
            second_derivation.point_in_ground(*self.here, k, a),
            second_derivation.direction_in_ground(*self.here, k, rate),
        )
        return MovingVector(at, moved, {}, ZERO_VECTOR)

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        omega = ZERO_VECTOR if self.rates is None or k < 0 else self.rates[k][1]
        along, rate = (
            second_derivation.direction_in_ground(*self.here, k, x) for x in (a, cross(omega, a))
        )
        return MovingVector(along, rate, {}, ZERO_VECTOR)

    def rotation(self, k: int) -> MovingVector:
        """Return how frame k turns."""
        omega = ZERO_VECTOR if self.rates is None or k < 0 else self.rates[k][1]
        return MovingVector(
            ZERO_VECTOR,
            second_derivation.direction_in_ground(*self.here, k, omega),
            {},
            ZERO_VECTOR,
        )

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return n × (e × n)."""
        return cross(axis.value, cross(normal.value, axis.value)), ZERO_VECTOR


def holonomic_rows(plan: TopologyPlan) -> list[int]:
    """Return which rows are rates of positions."""
    planar, closures = plan.topology.planar, plan.topology.constraints
    each = [KINDS[one.kind].holonomic for one in closures for _ in range(row_count(one, planar))]
    return [i for i, one in enumerate(each) if one]


def make_constraint_functions(plan: TopologyPlan) -> dict[str, Any]:
    """Return the functions of a scene that are about its closures."""
    closures = plan.topology.constraints
    if not closures:
        return {}
    planar = plan.topology.planar
    r = sum(row_count(one, planar) for one in closures)
    held = holonomic_rows(plan)
    driven = any(one.kind == "drive" for one in closures)

    def constraints(parameters, prepared, q):
        a, b = np.zeros((r, plan.n), q.dtype), np.zeros(r, q.dtype)
        for i, row in enumerate(
            all_rows(plan, parameters, FirstDerivation(plan, parameters, prepared, q))
        ):
            for j, x in row.columns.items():
                put(a, (i, j), x)
            put(b, i, row.b)
        return a, b if driven else None

    def drift(parameters, prepared, q, v):
        gamma = np.zeros(r, v.dtype)
        found = all_rows(plan, parameters, FirstDerivation(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(gamma, i, row.drift)
        return gamma

    def constraint(parameters, prepared, q, v):
        c = np.zeros(r, v.dtype)
        found = all_rows(plan, parameters, SecondDerivation(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(c, i, row.rate)
        return c

    def position_residual(parameters, prepared, q):
        residual = np.zeros(len(held), q.dtype)
        found = all_rows(plan, parameters, SecondDerivation(plan, parameters, prepared, q))
        for i, k in enumerate(held):
            put(residual, i, found[k].position)
        return residual

    found = {"constraints": constraints, "drift": drift, "constraint": constraint}
    return found | ({"position_residual": position_residual} if held else {})
