"""Constraints by declaration: their kinds, their rows, and the functions a, b, gamma, c of a scene.

A row is composed of moving vectors (`MovingVector`): points of frames and directions fixed in them.
This module derives each row once, from the values, rates, columns and bias accelerations of its
vectors; the two derivations of the vectors (`FirstDerivation`, `SecondDerivation`) are independent.

- "pin": a point of one frame is a point of another: 2 rows in the plane, 3 in space
- "weld": a pin without relative rotation: 1 row more in the plane, 3 in space
- "hinge": a pin in space about a direction of the second frame: 2 rows more
- "distance": two points keep their distance
- "on-plane": a point of the first frame stays on a plane of the second
- "on-quadric": it stays on a surface of the second order
- "square": a direction of the first frame is perpendicular to one of the second
- "coupling": q_i = Σ (ratio_j q_j + shift_j)
- "drive": q_i = p + r t + a t²/2
- "edge": a point has no velocity along a direction of its frame; its position is free
- "touching": a ball or the rim of a disk touches a plane of the second frame
- "rolling": the point of contact with the plane does not slip along a direction

Rolling: a ball touches the plane straight below its centre, at -R e with the plane's normal e. The
rim of a disk with the axis n is lowest at -R n × (e × n) / s with s = |e × n|, a root, for e and n
of length 1. If some link has the direction of the spoke that touches, as the frame that leans
with a disk but does not spin, this direction is used instead, and there is no root. The point of
contact belongs to the rim for an instant only: it moves along the rim while the disk leans.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from eomcheck.descriptions.first_derivation import (
    GROUND,
    GROUND_RATES,
    arm_and_position,
    frame_rates,
    joint_frames,
    point_columns,
    relative_acceleration,
    turning_columns,
    with_roots,
)
from eomcheck.descriptions.joint_tree import ConstraintSpec, TopologyPlan
from eomcheck.descriptions.second_derivation import (
    direction_in_ground,
    frame_velocities,
    point_in_ground,
    point_velocity,
)
from eomcheck.descriptions.vector_algebra import (
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

# ---- Vectors and rows ----------------------------------------------------------------------------

Columns = dict[int, Vector]


class MovingVector(NamedTuple):
    """A vector along the axes of the ground, with the derivatives that a derivation knows."""

    value: Vector
    rate: Vector
    columns: Columns
    """Derivatives ∂(rate)/∂v by coordinate; none in the second derivation."""
    acceleration: Vector
    """Second rate at v̇ = 0; None in the second derivation."""


class ConstraintRow(NamedTuple):
    """A row of the constraints; an absent term is 0."""

    position: Any
    rate: Any
    """Velocity constraint c, the rate of the position."""
    columns: dict[int, Any]
    """Entries of the row of a, by coordinate."""
    drift: Any
    """Entry of gamma."""
    b: Any = None


class Derivation(Protocol):
    """A source of the moving vectors of a row."""

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k, -1 for the ground."""
        ...

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        ...

    def rotation(self, k: int) -> MovingVector:
        """Return the rotation of frame k: its angular velocity as the rate, and no value."""
        ...

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return n × (e × n), of a disk's axis n and a normal e, and its rate, where known."""
        ...

    q: Any
    v: Any
    driven: Any
    sines: Any


class ConstraintInputs(NamedTuple):
    """Inputs of the functions that return the rows of a constraint."""

    points: list[MovingVector]
    directions: list[MovingVector]
    frames: tuple[int, ...]
    """Frames of the points."""
    spec: ConstraintSpec
    parameters: Any
    """Parameters of the scene, see `DescriptionParameters`."""
    derivation: Derivation
    planar: bool
    cache: dict[Any, Any]
    """Intermediate results that constraints share."""
    sine: Any = None
    """Sine of the angle between the axis of a disk and the normal of its plane."""

    @property
    def second_axes(self) -> list[MovingVector]:
        """Axes of the second frame."""
        return [self.derivation.direction(self.frames[1], x) for x in AXES]

    @property
    def rotations(self) -> list[MovingVector]:
        """Rotations of the frames of the points."""
        return [self.derivation.rotation(k) for k in self.frames]

    @property
    def separation(self) -> MovingVector:
        """Vector to the first point from the second."""
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
    """Return the row of a · b = 0."""
    columns = {
        i: plus(
            dot(a.columns.get(i, ZERO_VECTOR), b.value), dot(a.value, b.columns.get(i, ZERO_VECTOR))
        )
        for i in {**a.columns, **b.columns}
    }
    drift = plus(dot(a.acceleration, b.value), dot(a.value, b.acceleration))
    return ConstraintRow(
        dot(a.value, b.value),
        plus(dot(a.rate, b.value), dot(a.value, b.rate)),
        columns,
        plus(drift, times(2, dot(a.rate, b.rate))),
    )


def velocity_row(velocity: MovingVector, along: MovingVector) -> ConstraintRow:
    """Return the row that a velocity, the rate of a vector, has no component along a direction."""
    return ConstraintRow(
        None,
        dot(velocity.rate, along.value),
        {i: dot(x, along.value) for i, x in velocity.columns.items()},
        plus(dot(velocity.acceleration, along.value), dot(velocity.rate, along.rate)),
    )


def scaled_row(row: ConstraintRow, factor: Any) -> ConstraintRow:
    """Return a row multiplied by a factor."""
    columns = {i: times(factor, x) for i, x in row.columns.items()}
    position, rate, drift, b = (
        times(factor, x) for x in (row.position, row.rate, row.drift, row.b)
    )
    return ConstraintRow(position, rate, columns, drift, b)


# ---- Rolling on a plane --------------------------------------------------------------------------


def with_sines(plan: TopologyPlan, prepare: Callable) -> Callable:
    """Return a `prepare` that also computes the sines of angles between disk axes and normals."""

    def square(parameters, prepared, pair):
        axis, normal = (
            direction_in_ground(plan, parameters, prepared, k, as_vector(parameters.directions[j]))
            for k, j in pair
        )
        across = cross(normal, axis)  # 1 - (e · n)² loses all digits of a small sine
        return dot(across, across)

    return with_roots(prepare, "sines", plan.disks, square)


def radius(inputs: ConstraintInputs) -> Any:
    """Return the radius R, m."""
    return inputs.parameters.lengths[inputs.spec.number]


def contact_arm(inputs: ConstraintInputs) -> tuple[Vector, Vector]:
    """Return the vector from the centre to the point of contact, and its rate."""
    R, (_, *directions) = radius(inputs), inputs.directions
    if len(directions) == 1:
        (spoke,) = directions
        return scale_vector(-R, spoke.value), scale_vector(-R, spoke.rate)
    axis, normal = directions
    upright, s = dot_row(axis, normal), inputs.sine
    share = -(R / s)
    spoke, spoke_rate = inputs.derivation.rim(axis, normal)
    arm = scale_vector(share, spoke)
    shorter = times(times(upright.position, upright.rate), 1 / (s * s))
    return arm, add_vectors(scale_vector(share, spoke_rate), scale_vector(shorter, arm))


def slip_velocity(inputs: ConstraintInputs) -> MovingVector:
    """Return the slip velocity of the point of contact, relative to the plane that it touches."""
    (center, foot), (spin, turn) = inputs.points, inputs.rotations
    arm, wandering = contact_arm(inputs)
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
    acceleration = add_vectors(
        subtract_vectors(center.acceleration, foot.acceleration), subtract_vectors(rolled, carried)
    )
    return MovingVector(ZERO_VECTOR, subtract_vectors(rim, floor), columns, acceleration)


def rolling_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: the point of contact does not slip along a direction."""
    key = slip_velocity, inputs.spec.points, inputs.spec.directions[1:], inputs.spec.number
    if key not in inputs.cache:
        inputs.cache[key] = slip_velocity(inputs)
    return [velocity_row(inputs.cache[key], inputs.directions[0])]


def touching_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: the point of contact is on the plane, whose normal is the first direction.

    Its position is the height of the point of contact, its rate the velocity of that point.
    """
    R, (normal, *directions) = radius(inputs), inputs.directions
    along, *others = inputs.spec.directions
    if others == [along]:  # a ball: contact R below its centre, for any rotation of the plane
        row = dot_row(inputs.separation, normal)
        return [row._replace(position=minus(row.position, R))]
    (row,) = rolling_rows(inputs)
    centered = dot(inputs.separation.value, normal.value)
    rise = inputs.sine if len(directions) == 2 else dot(directions[0].value, normal.value)
    return [row._replace(position=minus(centered, times(R, rise)))]


# ---- Kinds of constraints ------------------------------------------------------------------------


def pin_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the rows: two points coincide."""
    a = inputs.separation
    return [
        ConstraintRow(
            a.value[i], a.rate[i], {j: x[i] for j, x in a.columns.items()}, a.acceleration[i]
        )
        for i in range(2 if inputs.planar else 3)
    ]


def weld_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the rows: two frames coincide."""
    x, *others = inputs.directions
    along_x, along_y, along_z = inputs.second_axes
    rows = [*pin_rows(inputs), dot_row(x, along_y)]
    if not inputs.planar:
        y, z = others
        rows += [dot_row(y, along_z), dot_row(z, along_x)]
    return rows


def hinge_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the rows: two points coincide, and a direction is perpendicular to two others."""
    first, second, axis = inputs.directions
    return [*pin_rows(inputs), dot_row(first, axis), dot_row(second, axis)]


def distance_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row of (d² - L²)/2 = 0."""
    apart, length = inputs.separation, inputs.parameters.lengths[inputs.spec.number]
    square = minus(dot(apart.value, apart.value), length * length)
    return [
        ConstraintRow(
            None if square is None else square / 2,
            dot(apart.value, apart.rate),
            {i: dot(apart.value, x) for i, x in apart.columns.items()},
            plus(dot(apart.value, apart.acceleration), dot(apart.rate, apart.rate)),
        )
    ]


def on_plane_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: a point is on a plane, given by its normal and another point."""
    return [dot_row(inputs.separation, inputs.directions[0])]


def on_quadric_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row of Σ (k_i s_i²/2 + g_i s_i) - h = 0, s a point's coordinates on three axes."""
    numbers, apart = inputs.parameters.surfaces[inputs.spec.number], inputs.separation
    position = rate = drift = None
    columns: dict[int, Any] = {}
    for i, direction in enumerate(inputs.directions):
        s, bend, slope = dot_row(apart, direction), numbers[i], numbers[3 + i]
        bent = times(bend, s.position)
        steep, mean = plus(bent, slope), plus(None if bent is None else bent / 2, slope)
        position = plus(position, times(s.position, mean))
        rate = plus(rate, times(steep, s.rate))
        columns |= {j: plus(columns.get(j), times(steep, x)) for j, x in s.columns.items()}
        drift = plus(drift, plus(times(steep, s.drift), times(bend, times(s.rate, s.rate))))
    return [ConstraintRow(minus(position, numbers[6]), rate, columns, drift)]


def perpendicular_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: two directions are perpendicular."""
    a, b = inputs.directions
    return [dot_row(a, b)]


def knife_edge_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: a point has no velocity along a direction."""
    (point,), (along,) = inputs.points, inputs.directions
    return [velocity_row(point, along)]


def coupling_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: one coordinate is a linear function of others."""
    i, *others = inputs.spec.coordinates
    q, v = inputs.derivation.q, inputs.derivation.v
    position, rate, columns = q[i], None if v is None else v[i], dict[int, Any]({i: 1})
    for number, j in enumerate(others, inputs.spec.number or 0):
        ratio, shift = inputs.parameters.couplings[number]
        position = position - ratio * q[j] - shift
        rate = None if v is None else rate - ratio * v[j]
        columns[j] = -ratio
    return [ConstraintRow(position, rate, columns, None)]


def drive_rows(inputs: ConstraintInputs) -> list[ConstraintRow]:
    """Return the row: a coordinate is a function of time."""
    (i,) = inputs.spec.coordinates
    position, rate, acceleration = inputs.derivation.driven[:, inputs.spec.number]
    excess = None if inputs.derivation.v is None else inputs.derivation.v[i] - rate
    return [ConstraintRow(inputs.derivation.q[i] - position, excess, {i: 1}, -acceleration, -rate)]


class ConstraintKind(NamedTuple):
    """A kind of constraint: the function that returns its rows, and their number."""

    rows: Callable[[ConstraintInputs], list[ConstraintRow]]
    planar: int
    """Number of rows in the plane."""
    spatial: int
    points: int = 0
    numbers: str = ""
    """Name of the parameter that holds its numbers."""
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
    """Return the number of rows of a constraint."""
    kind = KINDS[closure.kind]
    return kind.planar if planar else kind.spatial


def all_rows(plan: TopologyPlan, parameters: Any, derivation: Derivation) -> list[ConstraintRow]:
    """Return all rows, constraint by constraint."""
    rows: list[ConstraintRow] = []
    cache: dict[Any, Any] = {}  # many constraints share a point or a contact

    def moving(what: Callable, k: int, i: int, numbers: Any) -> MovingVector:
        if (what, k, i) not in cache:
            cache[what, k, i] = what(k, as_vector(numbers[i]))
        return cache[what, k, i]

    for closure in plan.topology.constraints:
        points = [moving(derivation.point, k, i, parameters.points) for k, i in closure.points]
        directions = [
            moving(derivation.direction, k, i, parameters.directions) for k, i in closure.directions
        ]
        frames = tuple(k for k, _ in closure.points)
        disk = plan.disk_index.get(closure.directions[1:])
        sine = None if disk is None else derivation.sines[disk]
        planar = plan.topology.planar
        inputs = ConstraintInputs(
            points, directions, frames, closure, parameters, derivation, planar, cache, sine
        )
        added = KINDS[closure.kind].rows(inputs)
        if closure.factor is not None:
            added = [scaled_row(row, parameters.factors[closure.factor]) for row in added]
        rows += added
    return rows


# ---- Two derivations, and the functions of a scene -----------------------------------------------


class FirstDerivation:
    """Vectors with columns and bias accelerations; without v only with values and columns."""

    def __init__(self, plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.plan, self.q, self.v = plan, q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.frames = joint_frames(plan, parameters, prepared)
        self.rates = None if v is None else frame_rates(plan, parameters, self.frames, v)

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k."""
        arm, position = arm_and_position(self.frames, k, a)
        columns = point_columns(self.plan, self.frames, k, (arm, position))
        if self.rates is None or k < 0:
            return MovingVector(position, ZERO_VECTOR, columns, ZERO_VECTOR)
        drift = add_vectors(self.rates[k].acceleration, relative_acceleration(self.rates[k], arm))
        return MovingVector(position, self._rate(columns), columns, drift)

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        along = from_local((self.frames[k] if k >= 0 else GROUND).axes, a)
        turning = turning_columns(self.plan, self.frames, k)
        columns = {i: cross(x, along) for i, x in turning.items()}
        rates = GROUND_RATES if self.rates is None or k < 0 else self.rates[k]
        drift = add_vectors(cross(rates.alpha, along), centripetal(rates.omega, along))
        return MovingVector(along, cross(rates.omega, along), columns, drift)

    def rotation(self, k: int) -> MovingVector:
        """Return the rotation of frame k."""
        rates = GROUND_RATES if self.rates is None or k < 0 else self.rates[k]
        columns = turning_columns(self.plan, self.frames, k)
        return MovingVector(ZERO_VECTOR, rates.omega, columns, rates.alpha)

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return (n·n) e - (e·n) n and its rate."""
        upright, square = dot_row(axis, normal), dot(axis.value, axis.value)
        along = scale_vector(upright.position, axis.value)
        along_rate = add_vectors(
            scale_vector(upright.rate, axis.value), scale_vector(upright.position, axis.rate)
        )
        spoke, rate = (scale_vector(square, x) for x in (normal.value, normal.rate))
        return subtract_vectors(spoke, along), subtract_vectors(rate, along_rate)

    def _rate(self, columns: dict[int, Vector]) -> Vector:
        rate = ZERO_VECTOR
        for i, column in columns.items():
            rate = add_vectors(rate, tuple(None if x is None else x * self.v[i] for x in column))
        return rate


class SecondDerivation:
    """Vectors by recursion of positions and velocities; without v only with values."""

    def __init__(self, plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.inputs, self.q, self.v = (plan, parameters, prepared), q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.rates = None if v is None else frame_velocities(plan, parameters, prepared, v)

    def point(self, k: int, a: Vector) -> MovingVector:
        """Return the point a of frame k."""
        rate = ZERO_VECTOR if self.rates is None else point_velocity(self.rates, k, a)
        position = point_in_ground(*self.inputs, k, a)
        return MovingVector(position, self._in_ground(k, rate), {}, ZERO_VECTOR)

    def direction(self, k: int, a: Vector) -> MovingVector:
        """Return the direction a of frame k."""
        turning = cross(self._omega(k), a)
        along, rate = self._in_ground(k, a), self._in_ground(k, turning)
        return MovingVector(along, rate, {}, ZERO_VECTOR)

    def rotation(self, k: int) -> MovingVector:
        """Return the rotation of frame k."""
        return MovingVector(ZERO_VECTOR, self._in_ground(k, self._omega(k)), {}, ZERO_VECTOR)

    def _omega(self, k: int) -> Vector:
        return ZERO_VECTOR if self.rates is None or k < 0 else self.rates[k][1]

    def _in_ground(self, k: int, a: Vector) -> Vector:
        return direction_in_ground(*self.inputs, k, a)

    def rim(self, axis: MovingVector, normal: MovingVector) -> tuple[Vector, Vector]:
        """Return n × (e × n)."""
        return cross(axis.value, cross(normal.value, axis.value)), ZERO_VECTOR


def holonomic_rows(plan: TopologyPlan) -> list[int]:
    """Return the indices of the rows that are rates of positions."""
    planar, closures = plan.topology.planar, plan.topology.constraints
    each = [KINDS[c.kind].holonomic for c in closures for _ in range(row_count(c, planar))]
    return [i for i, h in enumerate(each) if h]


def make_constraint_functions(plan: TopologyPlan) -> dict[str, Any]:
    """Return the constraint functions of a scene by name."""
    closures = plan.topology.constraints
    if not closures:
        return {}
    planar = plan.topology.planar
    r = sum(row_count(c, planar) for c in closures)
    held = holonomic_rows(plan)
    driven = any(c.kind == "drive" for c in closures)

    def entries(numbers, dtype):
        out = np.zeros(len(numbers), dtype)
        for i, x in enumerate(numbers):
            put(out, i, x)
        return out

    def constraints(parameters, prepared, q):
        rows = all_rows(plan, parameters, FirstDerivation(plan, parameters, prepared, q))
        a = np.zeros((r, plan.n), q.dtype)
        for i, row in enumerate(rows):
            for j, x in row.columns.items():
                put(a, (i, j), x)
        return a, entries([row.b for row in rows], q.dtype) if driven else None

    def drift(parameters, prepared, q, v):
        rows = all_rows(plan, parameters, FirstDerivation(plan, parameters, prepared, q, v))
        return entries([row.drift for row in rows], v.dtype)

    def constraint(parameters, prepared, q, v):
        rows = all_rows(plan, parameters, SecondDerivation(plan, parameters, prepared, q, v))
        return entries([row.rate for row in rows], v.dtype)

    def position_residual(parameters, prepared, q):
        rows = all_rows(plan, parameters, SecondDerivation(plan, parameters, prepared, q))
        return entries([rows[k].position for k in held], q.dtype)

    functions = {"constraints": constraints, "drift": drift, "constraint": constraint}
    return functions | ({"position_residual": position_residual} if held else {})
