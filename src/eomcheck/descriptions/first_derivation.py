"""First derivation of the equations: frames along the axes of the ground, joint by scalar joint.

A scalar joint is a joint with one coordinate (`ScalarJoint`). Positions: the `Frame` of each scalar
joint, in ground axes. Velocities: columns a × arm, formed only for joints on the path from the
ground to a body, and `FrameRates` at v̇ = 0. Angular velocities in `jacobians` are along the axes
of the bodies, in which inertia is constant.

Lagrange's terms need no Jacobians: M by composite bodies, B by Newton and Euler, tip to ground.
The subtree of a scalar joint moves as one composite body if only earlier joints move. So the
momentum of this body by the rate of its joint, taken about one earlier joint after the other, is a
row of M: O(n depth) and not O(n depth²), and no formula shared with the Jacobians of the bodies,
which Kane's method reads. These terms are along the axes of the ground, about the origins of the
scalar joints.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), Sections 5.3 and 6.2.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.joint_tree import ScalarJoint, TopologyPlan
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
    put_vector,
    rotate_back,
    scale_vector,
    subtract_vectors,
    times,
    to_local,
    unit,
)
from eomcheck.mechanics.records import Jacobians, Terms
from eomcheck.numbers.generic import generic

# ---- Positions: frames ---------------------------------------------------------------------------


class PreparedMechanism(NamedTuple):
    """Precomputed expressions that are not rational in q and t, and the joint coordinates."""

    x: Any
    """Coordinate of each scalar joint (n_j,), m or rad."""
    angles: Any
    """Angles of the hinges, as cosines and sines, or None without any."""
    driven: Any
    """Position, rate and acceleration of clock-driven coordinates (3, drives), or None."""
    lengths: Any = None
    """Lengths of the springs between points, or None without any, m."""
    sines: Any = None
    """Sines of the angles between axes of disks and normals of planes, or None without any."""
    half_cosines: Any = None
    """Cosines of 1/2, 1/4 and 1/8 of the angles by which gimbals with springs are turned from rest
    (3, springs), or None without any.
    """


class Frame(NamedTuple):
    """A frame moved by a scalar joint, in ground axes."""

    axes: tuple[Vector, Vector, Vector]
    origin: Vector
    arm: Vector
    """Vector from the origin of the previous frame."""
    axis: Vector
    """Direction of the joint axis."""


GROUND = Frame(AXES, ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR)


def factor(slot: ScalarJoint, parameters: Any) -> Any:
    """Return ∂x/∂q of a scalar joint: a number, or 1 or -1."""
    if slot.mimics is None:
        return slot.sense
    return times(slot.sense, parameters.ratio[slot.mimics])


def make_prepare(plan: TopologyPlan) -> Any:
    """Return the function `prepare` of a scene: (arithmetic, parameters, q (n,), t) ->
    `PreparedMechanism`.
    """

    def prepare(arithmetic, parameters, q, t):
        x = np.zeros(len(plan.joints), q.dtype)
        for k, slot in enumerate(plan.joints):
            own = q[slot.coordinate]
            if slot.mimics is not None:
                own = parameters.ratio[slot.mimics] * own + parameters.shift[slot.mimics]
            x[k] = times(slot.sense, own)
        angles = arithmetic.angles(x[list(plan.hinges)]) if plan.hinges else None
        return PreparedMechanism(x, angles, driven(parameters, q, t))

    return prepare


def with_roots(
    prepare: Callable,
    name: str,
    things: Sequence[Any],
    square_of: Callable[[Any, Any, Any], Any],
    root: Callable[[Any, Any], Any] = lambda arithmetic, square: arithmetic.root(square),
) -> Callable:
    """Return a `prepare` that also computes square roots, or itself without any.

    Args:
        prepare: function that computes what the squares need.
        name: field of `PreparedMechanism` for the roots.
        things: what each square is of.
        square_of: square of one of them, of (parameters, prepared, thing).
        root: roots of all squares, of (arithmetic, squares (k,)).
    """
    if not things:
        return prepare

    def prepare_all(arithmetic, parameters, q, t):
        prepared = prepare(arithmetic, parameters, q, t)
        square = np.zeros(len(things), q.dtype)
        for i, thing in enumerate(things):
            square[i] = square_of(parameters, prepared, thing)
        return prepared._replace(**{name: root(arithmetic, square)})

    return prepare_all


def driven(parameters: Any, q: Any, t: Any) -> Any:
    """Return position, rate and acceleration (3, drives) of p + r t + a t²/2, or None."""
    drives = getattr(parameters, "drives", None)
    if drives is None:
        return None
    motions = np.zeros((3, len(drives)), q.dtype)
    for i, (p, r, a) in enumerate(drives):
        motions[0, i], motions[1, i], motions[2, i] = p + t * (r + t * a / 2), r + t * a, a
    return motions


@generic
def joint_frames(plan, parameters, prepared):
    """Return the `Frame` of each scalar joint."""
    frames = []
    for k, slot in enumerate(plan.joints):
        before = frames[slot.parent] if slot.parent >= 0 else GROUND
        frames.append(joint_frame(before, plan, k, parameters, prepared))
    return frames


def joint_frame(
    before: Frame, plan: TopologyPlan, k: int, parameters: Any, prepared: PreparedMechanism
) -> Frame:
    """Return the frame of scalar joint k, whose parent frame is `before`."""
    slot, axes, arm = plan.joints[k], before.axes, ZERO_VECTOR
    if slot.offset is not None:
        arm = from_local(axes, as_vector(parameters.offset[slot.offset]))
    if slot.absolute:
        axes = AXES
    if slot.orientation is not None:
        R = parameters.rotation[slot.orientation]
        first, second, third = (from_local(axes, as_vector(R[:, i])) for i in range(3))
        axes = first, second, third
    axis = scale_vector(factor(slot, parameters), axes[slot.axis])
    if slot.slides:
        arm = add_vectors(arm, scale_vector(prepared.x[k], axes[slot.axis]))
    elif not slot.symmetric:
        hinge = plan.hinge_index[k]
        axes = hinged(axes, slot.axis, prepared.angles.cos[hinge], prepared.angles.sin[hinge])
    return Frame(axes, add_vectors(before.origin, arm), arm, axis)


@generic
def hinged(axes, axis, cos, sin):
    """Return axes turned about their `axis`-th."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned_axes = [axes[axis]] * 3
    turned_axes[i] = add_vectors(scale_vector(cos, axes[i]), scale_vector(sin, axes[j]))
    turned_axes[j] = subtract_vectors(scale_vector(cos, axes[j]), scale_vector(sin, axes[i]))
    return tuple(turned_axes)


def arm_and_position(frames: list[Frame], k: int, a: Vector) -> tuple[Vector, Vector]:
    """Return a point a of frame k, -1 for the ground, as arm from its origin and as position."""
    frame = frames[k] if k >= 0 else GROUND
    arm = from_local(frame.axes, a)
    return arm, add_vectors(frame.origin, arm)


def height(parameters: Any, position: Vector) -> Any:
    """Return the potential -g · position, m²/s²; None without gravity."""
    potential = None
    for g, x in zip(parameters.gravity, position, strict=False):
        potential = plus(potential, None if x is None else -(g * x))
    return potential


# ---- Velocities: columns and rates ---------------------------------------------------------------

Columns = dict[int, Vector]
"""Coordinate -> ∂(velocity)/∂v."""


class FrameRates(NamedTuple):
    """Velocity and acceleration of a frame, along the axes of the ground."""

    omega: Vector
    alpha: Vector
    """Angular acceleration ω̇ at v̇ = 0."""
    acceleration: Vector
    """Acceleration of its origin at v̇ = 0."""


GROUND_RATES = FrameRates(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR)


def point_columns(
    plan: TopologyPlan, frames: list[Frame], k: int, point: tuple[Vector, Vector]
) -> Columns:
    """Return the velocity columns of a point of frame k: arm from its origin, and position."""
    columns: Columns = {}
    for i, runs in plan.movers[k] if k >= 0 else ():
        axis, reach = frames[i].axis, ZERO_VECTOR
        for run in runs:
            arm, tip = point if run.end is None else (frames[run.end].arm, frames[run.end].origin)
            reach = add_vectors(
                reach, arm if run.arm else subtract_vectors(tip, frames[run.start].origin)
            )
        column = axis if plan.joints[i].slides else cross(axis, reach)
        j = plan.joints[i].coordinate
        columns[j] = add_vectors(columns.get(j, ZERO_VECTOR), column)
    return columns


def turning_columns(plan: TopologyPlan, frames: list[Frame], k: int) -> Columns:
    """Return the angular velocity columns of frame k, along the axes of the ground."""
    columns: Columns = {}
    for i in plan.turned_by[k] if k >= 0 else ():
        slot = plan.joints[i]
        if not slot.slides:
            before = columns.get(slot.coordinate, ZERO_VECTOR)
            columns[slot.coordinate] = add_vectors(before, frames[i].axis)
    return columns


@generic
def local_turning_columns(plan, parameters, prepared):
    """Return the angular velocity `Columns` of each frame along its own axes, in order."""
    columns_of_frames: list[Columns] = []
    for k, slot in enumerate(plan.joints):
        columns = (
            dict(columns_of_frames[plan.orientation_parent(k)])
            if plan.orientation_parent(k) >= 0
            else {}
        )
        if slot.orientation is not None:
            R = parameters.rotation[slot.orientation]
            seat = tuple(as_vector(R[:, i]) for i in range(3))
            columns = {i: to_local(seat, c) for i, c in columns.items()}
        if not slot.slides:
            hinge, axis, j = plan.hinge_index[k], slot.axis, slot.coordinate
            if not slot.symmetric:
                cos, sin = prepared.angles.cos[hinge], prepared.angles.sin[hinge]
                columns = {i: rotate_back(c, axis, cos, sin) for i, c in columns.items()}
            own = unit(axis, factor(slot, parameters))
            columns[j] = add_vectors(columns.get(j, ZERO_VECTOR), own)
        columns_of_frames.append(columns)
    return columns_of_frames


@generic
def frame_rates(plan, parameters, frames, v):
    """Return the `FrameRates` of each frame."""
    rates = []
    for k, slot in enumerate(plan.joints):
        before, frame = rates[slot.parent] if slot.parent >= 0 else GROUND_RATES, frames[k]
        omega, alpha, _ = (
            rates[plan.orientation_parent(k)] if plan.orientation_parent(k) >= 0 else GROUND_RATES
        )
        acceleration = add_vectors(before.acceleration, relative_acceleration(before, frame.arm))
        rate = scale_vector(v[slot.coordinate], frame.axis)
        carried = cross(omega, rate)
        if slot.slides:
            acceleration = add_vectors(acceleration, scale_vector(2, carried))
        else:
            omega, alpha = add_vectors(omega, rate), add_vectors(alpha, carried)
        rates.append(FrameRates(omega, alpha, acceleration))
    return rates


def relative_acceleration(rates: FrameRates, arm: Vector) -> Vector:
    """Return the acceleration of the end of an arm relative to its other end, at v̇ = 0."""
    return add_vectors(cross(rates.alpha, arm), centripetal(rates.omega, arm))


def centers(
    plan: TopologyPlan, parameters: Any, frames: list[Frame]
) -> list[tuple[Vector, Vector]]:
    """Return the arm to the centre of mass of each body, and its position."""
    return [
        arm_and_position(frames, k, as_vector(parameters.center[b]))
        for b, k in enumerate(plan.carriers)
    ]


def make_jacobians(plan: TopologyPlan) -> Any:
    """Return the function `jacobians` of a scene: V along the ground's axes, ω along the bodies'.

    Bodies come first, then rotors, which only turn, each about its own joint.
    """
    carriers, d, e = plan.carriers, plan.d, plan.e
    components = slice(3 - e, 3)

    def jacobians(parameters, prepared, q, v):
        frames = joint_frames(plan, parameters, prepared)
        turning = local_turning_columns(plan, parameters, prepared)
        rates = frame_rates(plan, parameters, frames, v)
        linear = np.zeros((plan.bodies, d, plan.n), v.dtype)
        angular = np.zeros((plan.bodies, e, plan.n), v.dtype)
        drift, turned = np.zeros((plan.bodies, d), v.dtype), np.zeros((plan.bodies, e), v.dtype)
        gyroscopic = None if plan.topology.planar else np.zeros((plan.bodies, e), v.dtype)
        for b, (arm, position) in enumerate(centers(plan, parameters, frames)):
            k = carriers[b]
            for i, column in point_columns(plan, frames, k, (arm, position)).items():
                put_vector(linear, (b, None, i), column, d)
            for i, column in turning[k].items():
                put_vector(angular, (b, None, i), column[components], e)
            put_vector(
                drift,
                (b, None),
                add_vectors(rates[k].acceleration, relative_acceleration(rates[k], arm)),
                d,
            )
            put_vector(turned, (b, None), to_local(frames[k].axes, rates[k].alpha)[components], e)
            if gyroscopic is not None:
                omega = to_local(frames[k].axes, rates[k].omega)
                moment = cross(omega, momentum(parameters.inertia[b], omega))
                put_vector(gyroscopic, (b, None), moment)
        for b, k in enumerate(plan.rotors, len(carriers)):
            if plan.joints[k].gimbal:
                columns, alpha = gimbal_columns(plan, prepared, k, v)
                for i, column in columns.items():
                    put_vector(angular, (b, None, i), column)
                put_vector(turned, (b, None), alpha)
                continue
            put(angular, (b, e - 1, plan.joints[k].coordinate), factor(plan.joints[k], parameters))
        return Jacobians(linear, angular, drift, turned, gyroscopic)

    return jacobians


@generic
def gimbal_columns(plan, prepared, k, v):
    """Return the angular velocity `Columns` of a gimbal, and its ω̇ at v̇ = 0.

    Both are against the frame before it, along the axes behind its last turn, scalar joint k.
    """
    columns: dict[int, Any] = {}
    omega: Any = ZERO_VECTOR
    alpha: Any = ZERO_VECTOR
    for i in plan.rotor_joints(k):
        hinge, axis, j = plan.hinge_index[i], plan.joints[i].axis, plan.joints[i].coordinate
        cos, sin = prepared.angles.cos[hinge], prepared.angles.sin[hinge]
        columns = {h: rotate_back(x, axis, cos, sin) for h, x in columns.items()} | {j: AXES[axis]}
        omega, alpha = rotate_back(omega, axis, cos, sin), rotate_back(alpha, axis, cos, sin)
        own = unit(axis, v[j])
        omega, alpha = add_vectors(omega, own), add_vectors(alpha, cross(omega, own))
    return columns, alpha


@generic
def momentum(inertia, omega):
    """Return the angular momentum I ω."""
    return tuple(dot(as_vector(inertia[i]), omega) for i in range(3))


# ---- Lagrange's terms: composite bodies ----------------------------------------------------------

Symmetric = dict[tuple[int, int], Any]
"""Entries (i, j), i <= j, of a symmetric matrix (3, 3); in the plane (2, 2) alone."""


class CompositeBody(NamedTuple):
    """A composite body: the subtree of a scalar joint as one rigid body."""

    mass: Any
    first_moment: Vector
    """First moment Σ m r from the origin of the scalar joint, kg m."""
    inertia: Symmetric
    """Moment of inertia about the origin of the scalar joint, kg m²."""


def inertia_along_ground(
    inertia: Any, axes: tuple[Vector, Vector, Vector], plan: TopologyPlan
) -> Symmetric:
    """Return a body's I along the axes of the ground, from I along its own (e, e)."""
    return {(2, 2): inertia[0, 0]} if plan.topology.planar else turned_inertia(inertia, axes)


def turned_inertia(inertia: Any, axes: tuple[Vector, Vector, Vector]) -> Symmetric:
    """Return R I Rᵀ, the columns of R being `axes`, from I (3, 3)."""
    halves = [from_local(axes, as_vector(inertia[:, k])) for k in range(3)]
    entries: Symmetric = {}
    for i in range(3):
        for j in range(i, 3):
            x, y, z = (times(halves[k][i], axes[k][j]) for k in range(3))
            entries[i, j] = plus(plus(x, y), z)
    return entries


def inertia_times(inertia: Symmetric, a: Vector) -> Vector:
    """Return the product I a."""

    def row(i: int) -> Any:
        x, y, z = (times(inertia.get((min(i, j), max(i, j))), a[j]) for j in range(3))
        return plus(plus(x, y), z)

    return row(0), row(1), row(2)


def shifted_body(body: CompositeBody, away: Vector) -> CompositeBody:
    """Return the same body about a point from which the origin is `away`."""
    step = scale_vector(body.mass, away)
    middle = add_vectors(body.first_moment, tuple(None if x is None else x / 2 for x in step))
    products = {(i, j): times(middle[i], away[j]) for i in range(3) for j in range(3)}
    inertia: Symmetric = {}
    for i, j in body.inertia:
        if i == j:
            others = [k for k in range(3) if k != i]
            square = plus(*(products[k, k] for k in others))
            inertia[i, j] = plus(body.inertia[i, j], times(2, square))
        else:
            both = plus(products[i, j], products[j, i])
            inertia[i, j] = minus(body.inertia[i, j], both)
    return CompositeBody(body.mass, add_vectors(body.first_moment, step), inertia)


def as_point_mass(body: CompositeBody) -> CompositeBody:
    """Return the body reduced to its point mass, for earlier joints that do not turn it."""
    return CompositeBody(body.mass, ZERO_VECTOR, dict.fromkeys(body.inertia))


def combined_body(first: CompositeBody | None, second: CompositeBody) -> CompositeBody:
    """Return the union of two bodies as one body."""
    if first is None:
        return second
    inertia = {entry: plus(x, second.inertia[entry]) for entry, x in first.inertia.items()}
    return CompositeBody(
        plus(first.mass, second.mass), add_vectors(first.first_moment, second.first_moment), inertia
    )


@generic
def gimbal_rates(plan, frames, k, v, vdot):
    """Return (ω, ω̇) of a gimbal against the frame before it, along the axes of the ground.

    ω̇ is at v̇ = 0 where `vdot` is None.
    """
    omega, alpha = ZERO_VECTOR, ZERO_VECTOR
    for i in plan.rotor_joints(k):
        j, axis = plan.joints[i].coordinate, frames[i].axis
        rate = scale_vector(v[j], axis)
        omega, alpha = add_vectors(omega, rate), add_vectors(alpha, cross(omega, rate))
        if vdot is not None:
            alpha = add_vectors(alpha, scale_vector(vdot[j], axis))
    return omega, alpha


@generic
def terms_of_bodies(plan, parameters, frames, rates, v):
    """Return (M (n, n), B (n,)) of the inertia forces."""
    heavy: list[CompositeBody | None] = [None] * len(frames)
    force, moment = [ZERO_VECTOR] * len(frames), [ZERO_VECTOR] * len(frames)
    for b, k in enumerate(plan.carriers):
        arm = from_local(frames[k].axes, as_vector(parameters.center[b]))
        mass = parameters.mass[b]
        inertia = inertia_along_ground(parameters.inertia[b], frames[k].axes, plan)
        heavy[k] = shifted_body(CompositeBody(mass, ZERO_VECTOR, inertia), arm)
        force[k], moment[k] = newton_euler(mass, inertia, arm, rates[k])
    M, B = np.zeros((plan.n, plan.n), v.dtype), np.zeros(plan.n, v.dtype)
    for k in reversed(range(len(frames))):
        slot, frame = plan.joints[k], frames[k]
        if (own := heavy[k]) is not None:
            add_rows(plan, frames, k, own, M)
            put_work(plan, frames, k, force, moment, B)
        if own is not None and slot.parent >= 0:
            carried = as_point_mass(own) if slot.absolute else own
            heavy[slot.parent] = combined_body(heavy[slot.parent], shifted_body(carried, frame.arm))
            hand_on(plan, frames, k, force, moment)
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        i, last = plan.joints[k].coordinate, plan.e - 1
        if plan.joints[k].gimbal:
            add_gimbal_terms(plan, frames, k, parameters.inertia[b, last, last], v, M, B)
            continue
        grows = factor(plan.joints[k], parameters)
        M[i, i] = plus(M[i, i], times(grows, times(grows, parameters.inertia[b, last, last])))
    return M, B


def add_gimbal_terms(
    plan: TopologyPlan, frames: list[Frame], k: int, inertia: Any, v: Any, M: Any, B: Any
) -> None:
    """Add the rotor of a gimbal, whose last turn is k, to M (n, n) and B (n,)."""
    turns = plan.rotor_joints(k)
    for j in turns:
        i = plan.joints[j].coordinate
        M[i, i] = plus(M[i, i], inertia)
    # Of the three axes only the first and the last are not perpendicular.
    first, last = (plan.joints[j].coordinate for j in (turns[0], turns[-1]))
    share = times(inertia, dot(frames[turns[0]].axis, frames[k].axis))
    M[first, last], M[last, first] = plus(M[first, last], share), plus(M[last, first], share)
    _, alpha = gimbal_rates(plan, frames, k, v, None)
    for j in turns:
        i = plan.joints[j].coordinate
        B[i] = plus(B[i], times(inertia, dot(frames[j].axis, alpha)))


def newton_euler(
    mass: Any, inertia: Symmetric, arm: Vector, rates: Any, weight: Vector = ZERO_VECTOR
) -> tuple[Vector, Vector]:
    """Return force, and moment about its joint's origin, that give a body its motion under weight.

    Args:
        mass: its mass.
        inertia: its central inertia along the axes of the ground.
        arm: its centre of mass, from the origin of its scalar joint.
        rates: motion of its frame: ω, ω̇ and acceleration of the origin, as `FrameRates`.
        weight: acceleration of gravity.
    """
    acceleration = add_vectors(rates.acceleration, relative_acceleration(rates, arm))
    force = scale_vector(mass, subtract_vectors(acceleration, weight))
    return force, add_vectors(euler_moment(inertia, rates), cross(arm, force))


def put_work(
    plan: TopologyPlan,
    frames: list[Frame],
    k: int,
    force: list[Vector],
    moment: list[Vector],
    forces: Any,
) -> None:
    """Add the work of force and moment on scalar joint k, per rate of its coordinate, to (n,)."""
    slot = plan.joints[k]
    work = dot(frames[k].axis, force[k] if slot.slides else moment[k])
    forces[slot.coordinate] = plus(work, forces[slot.coordinate])


def hand_on(
    plan: TopologyPlan, frames: list[Frame], k: int, force: list[Vector], moment: list[Vector]
) -> None:
    """Add force and moment on scalar joint k to those on its parent."""
    slot = plan.joints[k]
    handed = ZERO_VECTOR if slot.absolute else moment[k]
    handed = add_vectors(handed, cross(frames[k].arm, force[k]))
    force[slot.parent] = add_vectors(force[slot.parent], force[k])
    moment[slot.parent] = add_vectors(moment[slot.parent], handed)


def euler_moment(inertia: Symmetric, rates: FrameRates) -> Vector:
    """Return the moment I ω̇ + ω × I ω."""
    return add_vectors(
        inertia_times(inertia, rates.alpha), cross(rates.omega, inertia_times(inertia, rates.omega))
    )


def add_rows(plan: TopologyPlan, frames: list[Frame], k: int, body: CompositeBody, M: Any) -> None:
    """Add a row to M: momentum of k's composite body by k's rate, along all earlier joints."""
    axis, i = frames[k].axis, plan.joints[k].coordinate
    if plan.joints[k].slides:
        P, L = scale_vector(body.mass, axis), cross(body.first_moment, axis)
    else:
        P, L = cross(axis, body.first_moment), inertia_times(body.inertia, axis)
    for j in reversed(plan.path_to(k)):
        slot, frame = plan.joints[j], frames[j]
        share = dot(frame.axis, P if slot.slides else L)
        if share is not None:
            M[i, slot.coordinate] += share
            if j != k:
                M[slot.coordinate, i] += share
        L = add_vectors(ZERO_VECTOR if slot.absolute else L, cross(frame.arm, P))


def make_terms(plan: TopologyPlan, forces: Any, constraints: Any, drift: Any) -> Any:
    """Return the function `terms` of a scene."""

    def terms(parameters, prepared, q, v):
        frames = joint_frames(plan, parameters, prepared)
        rates = frame_rates(plan, parameters, frames, v)
        M, B = terms_of_bodies(plan, parameters, frames, rates, v)
        a, b = constraints(parameters, prepared, q)
        Q = forces(parameters, prepared, q, v)
        return Terms(M, Q, B, a, drift(parameters, prepared, q, v), b)

    return terms
