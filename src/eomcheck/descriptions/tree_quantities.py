"""Quantities of a tree of rigid bodies beside M and B: centre of mass, momentum, frames, regressor.

They are functions of a plan's numbers (`TopologyPlan`), generic like those of a scene, along the
axes of the ground. Columns of a Jacobian exist only for joints on the path to a body, so that no
function takes more than O(n depth); inverse dynamics take O(n), and their derivatives O(n²). A link
has a frame that is fixed to a scalar joint (`LinkNumbers`); rotors are inertia along a coordinate
and no bodies: they have no momentum here.

Sources: Featherstone, Rigid Body Dynamics Algorithms (2008), Chapter 5; Orin, Goswami and Lee,
Autonomous Robots 35 (2013), on the momentum matrix; Echeandia and Wensing, IEEE Robotics and
Automation Letters 6 (2021), on a Coriolis matrix by composite bodies; Atkeson, An and Hollerbach,
International Journal of Robotics Research 5 (1986), on the regressor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.first_derivation import (
    Columns,
    CompositeBody,
    Frame,
    arm_and_position,
    centers,
    combined_body,
    factor,
    frame_rates,
    gimbal_rates,
    hand_on,
    inertia_along_ground,
    inertia_times,
    joint_frames,
    newton_euler,
    point_columns,
    put_work,
    shifted_body,
    turned_inertia,
    turning_columns,
)
from eomcheck.descriptions.joint_tree import TopologyPlan
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
    negative,
    plus,
    put,
    put_vector,
    scale_vector,
    subtract_vectors,
    times,
    to_local,
)
from eomcheck.numbers.generic import Array, generic


class LinkNumbers(NamedTuple):
    """Frames of links, fixed to the frames of scalar joints."""

    rotation: Any
    """Orientations, columns along the axes of the link (n_f, 3, 3)."""
    offset: Any
    """Origins (n_f, 3), m."""


class CenterOfMass(NamedTuple):
    """Centre of mass of all bodies, along the axes of the ground."""

    position: Array
    """Position (3,), m."""
    jacobian: Array
    """∂velocity/∂v (3, n)."""
    velocity: Array
    """Velocity (3,), m/s."""
    acceleration: Array
    """Acceleration (3,), m/s²."""


class Momentum(NamedTuple):
    """Momentum of all bodies: linear, then angular about the centre of mass."""

    momentum: Array
    """Momentum (6,), kg m/s and kg m²/s."""
    matrix: Array
    """∂momentum/∂v (6, n)."""
    rate: Array
    """Rate of the momentum (6,), N and N m."""


class LinkMotions(NamedTuple):
    """Poses and motions of the frames of links: linear of the origin, then angular."""

    R: Array
    """Orientations, columns along the axes of the link (n_f, 3, 3)."""
    p: Array
    """Positions of the origins (n_f, 3), m."""
    jacobian: Array
    """∂velocity/∂v (n_f, 6, n)."""
    velocity: Array
    """Velocities (n_f, 6), m/s and rad/s."""
    acceleration: Array
    """Accelerations (n_f, 6), m/s² and rad/s²: those of the origins are rates of velocities."""
    bias: Array
    """Accelerations at v̇ = 0, J̇ v (n_f, 6)."""


class Weight(NamedTuple):
    """Potential energy of weight, and its derivative."""

    U: Any
    """Potential energy, J, 0 for bodies at the origin."""
    gradient: Array
    """∂U/∂q (n,): the forces of inverse dynamics against weight."""


class Regressor(NamedTuple):
    """Inverse dynamics without other forces than weight, as a function of the bodies' parameters.

    The torques are Y π + rotors.
    """

    Y: Array
    """Regressor (n, 10 n_b)."""
    parameters: Array
    """π (10 n_b,), of each body m, m c, and I xx, xy, xz, yy, yz, zz about its link's origin."""
    rotors: Array
    """Torques that accelerate the rotors (n,)."""


class FrameMotion(NamedTuple):
    """Velocity and acceleration of a frame, along the axes of the ground."""

    omega: Vector
    alpha: Vector
    velocity: Vector
    acceleration: Vector


STILL = FrameMotion(ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR)
"""Motion of the ground."""


# ---- Motions of frames and points ----------------------------------------------------------------


@generic
def frame_motions(plan, parameters, frames, v, vdot):
    """Return the `FrameMotion` of each scalar joint; at v̇ = 0 where `vdot` is None."""
    motions: list[FrameMotion] = []
    rates = frame_rates(plan, parameters, frames, v)
    changes: list[tuple[Vector, Vector]] = []
    for k, slot in enumerate(plan.joints):
        frame, turning = frames[k], plan.orientation_parent(k)
        before = motions[slot.parent] if slot.parent >= 0 else STILL
        velocity = add_vectors(before.velocity, cross(before.omega, frame.arm))
        alpha, acceleration = changes[slot.parent] if slot.parent >= 0 else (ZERO_VECTOR,) * 2
        acceleration = add_vectors(acceleration, cross(alpha, frame.arm))
        alpha = changes[turning][0] if turning >= 0 else ZERO_VECTOR
        more = ZERO_VECTOR if vdot is None else scale_vector(vdot[slot.coordinate], frame.axis)
        if slot.slides:
            velocity = add_vectors(velocity, scale_vector(v[slot.coordinate], frame.axis))
            acceleration = add_vectors(acceleration, more)
        else:
            alpha = add_vectors(alpha, more)
        changes.append((alpha, acceleration))
        own = rates[k]
        motions.append(
            FrameMotion(
                own.omega,
                add_vectors(own.alpha, alpha),
                velocity,
                add_vectors(own.acceleration, acceleration),
            )
        )
    return motions


def point_motion(motions: list[FrameMotion], k: int, arm: Vector) -> FrameMotion:
    """Return the motion of a point of frame k, -1 for the ground, at `arm` from its origin."""
    motion = motions[k] if k >= 0 else STILL
    turned = add_vectors(cross(motion.alpha, arm), centripetal(motion.omega, arm))
    return motion._replace(
        velocity=add_vectors(motion.velocity, cross(motion.omega, arm)),
        acceleration=add_vectors(motion.acceleration, turned),
    )


def _added(columns: Columns, i: int, column: Vector) -> None:
    columns[i] = add_vectors(columns.get(i, ZERO_VECTOR), column)


def put_columns(J: Array, *blocks: Columns) -> None:
    """Write blocks of columns, three rows each, one above the other, into a matrix of zeros."""
    for block, columns in enumerate(blocks):
        for j, column in columns.items():
            put_vector(J[3 * block : 3 * block + 3], (None, j), column)


def put_vectors(x: Array, *parts: Vector) -> None:
    """Write vectors one after the other into an array of zeros."""
    for i, part in enumerate(parts):
        put_vector(x[3 * i : 3 * i + 3], (None,), part)


def _matrix(rows: int, plan: TopologyPlan, dtype: Any, *blocks: Columns) -> Array:
    """Return the matrix (rows, n) of `put_columns`."""
    J = np.zeros((rows, plan.n), dtype)
    put_columns(J, *blocks)
    return J


def _vector(dtype: Any, *parts: Vector) -> Array:
    """Return vectors in a row as an array (3 len(parts),)."""
    x = np.zeros(3 * len(parts), dtype)
    put_vectors(x, *parts)
    return x


# ---- Centre of mass, momentum, weight ------------------------------------------------------------


def _total_mass(plan: TopologyPlan, parameters: Any) -> Any:
    """Return the mass of all bodies, kg."""
    total = None
    for b in range(len(plan.carriers)):
        total = plus(total, parameters.mass[b])
    return total


def _center(plan: TopologyPlan, parameters: Any, bodies: list[tuple[Vector, Vector]]) -> Vector:
    """Return the position of the centre of mass of all bodies."""
    moment = ZERO_VECTOR
    for b, (_, position) in enumerate(bodies):
        moment = add_vectors(moment, scale_vector(parameters.mass[b], position))
    return divided(moment, _total_mass(plan, parameters))


def divided(a: Vector, x: Any) -> Vector:
    """Return a / x."""
    first, second, third = (None if part is None else part / x for part in a)
    return first, second, third


def make_center_of_mass(plan: TopologyPlan) -> Callable[..., CenterOfMass]:
    """Return the function (parameters, prepared, v, v̇) -> `CenterOfMass`."""

    def center_of_mass(parameters, prepared, v, vdot):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, vdot)
        bodies = centers(plan, parameters, frames)
        columns: Columns = {}
        velocity, acceleration = ZERO_VECTOR, ZERO_VECTOR
        for b, (arm, position) in enumerate(bodies):
            k, mass = plan.carriers[b], parameters.mass[b]
            for j, column in point_columns(plan, frames, k, (arm, position)).items():
                _added(columns, j, scale_vector(mass, column))
            motion = point_motion(motions, k, arm)
            velocity = add_vectors(velocity, scale_vector(mass, motion.velocity))
            acceleration = add_vectors(acceleration, scale_vector(mass, motion.acceleration))
        total = _total_mass(plan, parameters)
        return CenterOfMass(
            _vector(v.dtype, _center(plan, parameters, bodies)),
            _matrix(3, plan, v.dtype, {j: divided(x, total) for j, x in columns.items()}),
            _vector(v.dtype, divided(velocity, total)),
            _vector(v.dtype, divided(acceleration, total)),
        )

    return center_of_mass


def make_momentum(plan: TopologyPlan) -> Callable[..., Momentum]:
    """Return the function (parameters, prepared, v, v̇) -> `Momentum`."""

    def momentum(parameters, prepared, v, vdot):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, vdot)
        bodies = centers(plan, parameters, frames)
        center = _center(plan, parameters, bodies)
        linear: Columns = {}
        angular: Columns = {}
        P, L, force, moment = (ZERO_VECTOR,) * 4
        for b, (arm, position) in enumerate(bodies):
            k, mass = plan.carriers[b], parameters.mass[b]
            away = scale_vector(mass, subtract_vectors(position, center))
            inertia = inertia_along_ground(parameters.inertia[b], frames[k].axes, plan)
            for j, column in point_columns(plan, frames, k, (arm, position)).items():
                _added(linear, j, scale_vector(mass, column))
                _added(angular, j, cross(away, column))
            for j, column in turning_columns(plan, frames, k).items():
                _added(angular, j, inertia_times(inertia, column))
            motion = point_motion(motions, k, arm)
            spin = inertia_times(inertia, motion.omega)
            P = add_vectors(P, scale_vector(mass, motion.velocity))
            L = add_vectors(L, add_vectors(spin, cross(away, motion.velocity)))
            force = add_vectors(force, scale_vector(mass, motion.acceleration))
            turning = add_vectors(inertia_times(inertia, motion.alpha), cross(motion.omega, spin))
            moment = add_vectors(moment, add_vectors(turning, cross(away, motion.acceleration)))
        return Momentum(
            _vector(v.dtype, P, L),
            _matrix(6, plan, v.dtype, linear, angular),
            _vector(v.dtype, force, moment),
        )

    return momentum


def make_weight(plan: TopologyPlan) -> Callable[..., Weight]:
    """Return the function (parameters, prepared, v) -> `Weight`; v only sets the scalar type."""

    def weight(parameters, prepared, v):
        U, gradient = np.zeros(1, v.dtype), np.zeros(plan.n, v.dtype)
        if parameters.gravity is None:
            return Weight(U[0], gradient)
        gravity = as_vector(parameters.gravity)
        frames = joint_frames(plan, parameters, prepared)
        potential, shares = None, {}
        for b, (arm, position) in enumerate(centers(plan, parameters, frames)):
            mass = parameters.mass[b]
            potential = plus(potential, times(mass, negative(dot(gravity, position))))
            columns = point_columns(plan, frames, plan.carriers[b], (arm, position))
            for j, column in columns.items():
                share = times(mass, negative(dot(gravity, column)))
                shares[j] = plus(shares.get(j), share)
        put(U, 0, potential)
        for j, share in shares.items():
            put(gradient, j, share)
        return Weight(U[0], gradient)

    return weight


# ---- Frames of links -----------------------------------------------------------------------------


def make_link_motions(plan: TopologyPlan, joints: tuple[int, ...]) -> Callable[..., LinkMotions]:
    """Return the function (parameters, prepared, v, v̇, R, p) -> `LinkMotions` of links.

    R (n_f, 3, 3) and p (n_f, 3) place them on their scalar joints, -1 for the ground.
    """

    def link_motions(parameters, prepared, v, vdot, rotation, offset):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, vdot)
        steady = frame_motions(plan, parameters, frames, v, None)
        count, dtype = len(joints), v.dtype
        R, p = np.zeros((count, 3, 3), dtype), np.zeros((count, 3), dtype)
        J = np.zeros((count, 6, plan.n), dtype)
        velocity, acceleration, bias = (np.zeros((count, 6), dtype) for _ in range(3))
        for f, k in enumerate(joints):
            axes = frames[k].axes if k >= 0 else AXES
            for i in range(3):
                put_vector(R, (f, None, i), from_local(axes, as_vector(rotation[f, :, i])))
            arm, position = arm_and_position(frames, k, as_vector(offset[f]))
            put_vector(p, (f, None), position)
            columns = point_columns(plan, frames, k, (arm, position))
            put_columns(J[f], columns, turning_columns(plan, frames, k))
            motion, rest = point_motion(motions, k, arm), point_motion(steady, k, arm)
            put_vectors(velocity[f], motion.velocity, motion.omega)
            put_vectors(acceleration[f], motion.acceleration, motion.alpha)
            put_vectors(bias[f], rest.acceleration, rest.alpha)
        return LinkMotions(R, p, J, velocity, acceleration, bias)

    return link_motions


# ---- Coriolis matrix -----------------------------------------------------------------------------

Matrix = tuple[Vector, Vector, Vector]
"""Rows of a matrix (3, 3)."""

NO_MATRIX: Matrix = (ZERO_VECTOR, ZERO_VECTOR, ZERO_VECTOR)


class Screw(NamedTuple):
    """Velocity of a moving body, or its rate, per coordinate: at the reference point, and ω."""

    linear: Vector
    angular: Vector


class MovingBody(NamedTuple):
    """A composite body with the velocity-dependent sums of its Coriolis matrix."""

    body: CompositeBody
    """Mass, first moment and inertia about the reference point."""
    momentum: Vector
    """Momentum P = Σ m v."""
    turning: Matrix
    """Σ [(ω× I - I ω× - (I ω)×) / 2 + m (r · v) 1 - m v rᵀ], r from the reference point."""


def _combined(first: MovingBody | None, second: MovingBody) -> MovingBody:
    """Return the union of two bodies."""
    if first is None:
        return second
    rows = (add_vectors(x, y) for x, y in zip(first.turning, second.turning, strict=True))
    one, two, three = rows
    return MovingBody(
        combined_body(first.body, second.body),
        add_vectors(first.momentum, second.momentum),
        (one, two, three),
    )


def _matrix_times(A: Matrix, a: Vector) -> Vector:
    """Return A a."""
    return dot(A[0], a), dot(A[1], a), dot(A[2], a)


def _transposed(A: Matrix) -> Matrix:
    """Return Aᵀ."""
    x, y, z = ((A[0][i], A[1][i], A[2][i]) for i in range(3))
    return x, y, z


def _columns_matrix(x: Vector, y: Vector, z: Vector) -> Matrix:
    """Return the matrix with these columns."""
    return _transposed((x, y, z))


def _turning_of(inertia: Any, mass: Any, r: Vector, motion: FrameMotion) -> Matrix:
    """Return `MovingBody.turning` of one body with this central inertia along the ground's axes."""
    omega, spin = motion.omega, inertia_times(inertia, motion.omega)
    columns = []
    reach = times(mass, dot(r, motion.velocity))
    for i, axis in enumerate(AXES):
        turned = cross(omega, inertia_times(inertia, axis))
        turned = subtract_vectors(turned, inertia_times(inertia, cross(omega, axis)))
        turned = subtract_vectors(turned, cross(spin, axis))
        half = divided(turned, 2)
        carried = scale_vector(times(mass, r[i]), motion.velocity)
        columns.append(add_vectors(half, subtract_vectors(scale_vector(reach, axis), carried)))
    return _columns_matrix(*columns)


def _impulse(body: CompositeBody, screw: Screw) -> Screw:
    """Return force and moment about the reference point, I^C times a screw."""
    mass, moment, inertia = body
    force = add_vectors(scale_vector(mass, screw.linear), cross(screw.angular, moment))
    turned = add_vectors(cross(moment, screw.linear), inertia_times(inertia, screw.angular))
    return Screw(force, turned)


def _power(x: Screw, y: Screw) -> Any:
    """Return the product of a screw with a force and a moment."""
    return plus(dot(x.linear, y.linear), dot(x.angular, y.angular))


@generic
def joint_rows(plan, parameters):
    """Return ∂(joint coordinate)/∂q of each scalar joint, as a sparse row.

    An absolute joint, which is in the plane, has the angle between the bodies for its coordinate.
    """
    rows: list[dict[int, Any]] = []
    for slot in plan.joints:
        row = {slot.coordinate: factor(slot, parameters)}
        for before in plan.path_to(slot.parent) if slot.absolute else ():
            if not plan.joints[before].slides:
                for j, x in rows[before].items():
                    row[j] = plus(row.get(j), negative(x))
        rows.append({j: x for j, x in row.items() if x is not None})
    return rows


def _screws(
    plan: TopologyPlan, frames: list[Frame], motions: list[FrameMotion], point: Vector
) -> tuple[list[Screw], list[Screw]]:
    """Return the screw of each scalar joint at a point that is fixed to the ground, and its rate.

    They are per joint coordinate, not per coordinate of the scene.
    """
    screws, rates = [], []
    for k, slot in enumerate(plan.joints):
        axis = frames[k].axes[slot.axis]
        omega = motions[slot.parent].omega if slot.parent >= 0 else ZERO_VECTOR
        turned = cross(omega, axis)
        if slot.slides:
            screws.append(Screw(axis, ZERO_VECTOR))
            rates.append(Screw(turned, ZERO_VECTOR))
            continue
        reach = subtract_vectors(point, frames[k].origin)
        moving = cross(axis, motions[k].velocity)
        screws.append(Screw(cross(axis, reach), axis))
        rates.append(Screw(subtract_vectors(cross(turned, reach), moving), turned))
    return screws, rates


def make_coriolis_matrix(plan: TopologyPlan) -> Callable[..., Array]:
    """Return the function (parameters, prepared, v) -> C (n, n), C v = B and Ṁ = C + Cᵀ."""

    def coriolis_matrix(parameters, prepared, v):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, None)
        point = frames[plan.carriers[0]].origin if plan.carriers else ZERO_VECTOR
        moving: list[MovingBody | None] = [None] * len(frames)
        for b, (arm, position) in enumerate(centers(plan, parameters, frames)):
            k, mass = plan.carriers[b], parameters.mass[b]
            r, motion = subtract_vectors(position, point), point_motion(motions, k, arm)
            inertia = inertia_along_ground(parameters.inertia[b], frames[k].axes, plan)
            moving[k] = MovingBody(
                shifted_body(CompositeBody(mass, ZERO_VECTOR, inertia), r),
                scale_vector(mass, motion.velocity),
                _turning_of(inertia, mass, r, motion),
            )
        screws, rates = _screws(plan, frames, motions, point)
        rows = joint_rows(plan, parameters)
        C = np.zeros((plan.n, plan.n), v.dtype)

        def add(k: int, j: int, x: Any) -> None:
            for i, p in rows[k].items():
                for h, s in rows[j].items():
                    share = times(times(p, s), x)
                    if share is not None:
                        C[i, h] += share

        for k in reversed(range(len(frames))):
            composite, slot = moving[k], plan.joints[k]
            if composite is None:
                continue
            body, P, turning = composite
            own, rate = screws[k], rates[k]
            along = _impulse(body, rate)
            along = Screw(
                add_vectors(along.linear, cross(own.angular, P)),
                add_vectors(along.angular, _matrix_times(turning, own.angular)),
            )
            impulse = _impulse(body, own)
            more = _matrix_times(_transposed(turning), own.angular)
            more = add_vectors(cross(P, own.linear), more)
            for j in plan.path_to(k):
                add(j, k, _power(screws[j], along))
                if j != k:
                    turned = dot(screws[j].angular, more)
                    add(k, j, plus(_power(rates[j], impulse), turned))
            if slot.parent >= 0:
                moving[slot.parent] = _combined(moving[slot.parent], composite)
        for b, k in enumerate(plan.rotors, len(plan.carriers)):
            if plan.joints[k].gimbal:
                _add_gimbal_coriolis(plan, frames, k, parameters.inertia[b, -1, -1], v, C)
        return C

    return coriolis_matrix


def _add_gimbal_coriolis(
    plan: TopologyPlan, frames: list[Frame], k: int, inertia: Any, v: Array, C: Array
) -> None:
    """Add the rotor of a gimbal, whose last turn is k, to C (n, n)."""
    turns = plan.rotor_joints(k)
    omega, _ = gimbal_rates(plan, frames, k, v, None)
    before = ZERO_VECTOR
    for j in turns:
        # The rate of an axis, which turns with the joints before it, less half of that with all.
        column, axis = plan.joints[j].coordinate, frames[j].axis
        turned = subtract_vectors(cross(before, axis), divided(cross(omega, axis), 2))
        before = add_vectors(before, scale_vector(v[column], axis))
        for i in turns:
            row = plan.joints[i].coordinate
            C[row, column] = plus(C[row, column], times(inertia, dot(frames[i].axis, turned)))


# ---- Inverse dynamics ----------------------------------------------------------------------------


def make_inverse_dynamics(plan: TopologyPlan) -> Callable[..., Array]:
    """Return the function (parameters, prepared, v, v̇) -> M v̇ + B + ∂U/∂q (n,), of O(n).

    It is the recursion of Newton and Euler, from tip to ground; U is the weight.
    """

    def inverse_dynamics(parameters, prepared, v, vdot):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, vdot)
        weight = ZERO_VECTOR if parameters.gravity is None else as_vector(parameters.gravity)
        force, moment = [ZERO_VECTOR] * len(frames), [ZERO_VECTOR] * len(frames)
        for b, (arm, _) in enumerate(centers(plan, parameters, frames)):
            k = plan.carriers[b]
            inertia = inertia_along_ground(parameters.inertia[b], frames[k].axes, plan)
            force[k], moment[k] = newton_euler(parameters.mass[b], inertia, arm, motions[k], weight)
        torques = rotor_torques(plan, parameters, frames, v, vdot)
        for k in reversed(range(len(frames))):
            put_work(plan, frames, k, force, moment, torques)
            if plan.joints[k].parent >= 0:
                hand_on(plan, frames, k, force, moment)
        return torques

    return inverse_dynamics


def rotor_torques(
    plan: TopologyPlan, parameters: Any, frames: list[Frame], v: Array, vdot: Array
) -> Array:
    """Return the torques that accelerate the rotors (n,)."""
    torques = np.zeros(plan.n, vdot.dtype)
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        if plan.joints[k].gimbal:
            _, alpha = gimbal_rates(plan, frames, k, v, vdot)
            for i in plan.rotor_joints(k):
                share = times(parameters.inertia[b, -1, -1], dot(frames[i].axis, alpha))
                put(torques, plan.joints[i].coordinate, share)
            continue
        j, grows = plan.joints[k].coordinate, factor(plan.joints[k], parameters)
        inertia = times(grows, times(grows, parameters.inertia[b, -1, -1]))
        torques[j] = plus(times(inertia, vdot[j]), torques[j])
    return torques


# ---- Regressor -----------------------------------------------------------------------------------

PRODUCTS_OF_INERTIA = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Entries of I among the parameters of a body, in their order."""

PER_BODY = 4 + len(PRODUCTS_OF_INERTIA)
"""Number of parameters of a body."""


BY_COLUMNS = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]
"""Place of each parameter of a body among those of libraries that have I column by column: xx, xy,
yy, xz, yz, zz."""


def _inertia_columns(a: Vector) -> list[Vector]:
    """Return ∂(I a)/∂(xx, xy, xz, yy, yz, zz)."""
    columns = []
    for i, j in PRODUCTS_OF_INERTIA:
        parts = [None] * 3
        parts[i] = plus(parts[i], a[j])
        if i != j:
            parts[j] = plus(parts[j], a[i])
        columns.append((parts[0], parts[1], parts[2]))
    return columns


def _wrench_columns(acceleration: Vector, omega: Vector, alpha: Vector) -> list[Screw]:
    """Return force and moment about the origin per parameter of a body, along its own axes."""
    wrenches = [Screw(acceleration, ZERO_VECTOR)]
    for axis in AXES:
        force = add_vectors(cross(alpha, axis), centripetal(omega, axis))
        wrenches.append(Screw(force, cross(axis, acceleration)))
    turned, spun = _inertia_columns(alpha), _inertia_columns(omega)
    for x, y in zip(turned, spun, strict=True):
        wrenches.append(Screw(ZERO_VECTOR, add_vectors(x, cross(omega, y))))
    return wrenches


def make_regressor(plan: TopologyPlan, bodies: tuple[int, ...]) -> Callable[..., Regressor]:
    """Return the function (parameters, prepared, v, v̇, R, p) -> `Regressor`.

    R (n_b, 3, 3) and p (n_b, 3) place the link of each body on its scalar joint.

    Args:
        plan: the plan.
        bodies: indices among the plan's carriers, in the order of the parameters π.
    """

    def regressor(parameters, prepared, v, vdot, rotation, offset):
        frames = joint_frames(plan, parameters, prepared)
        motions = frame_motions(plan, parameters, frames, v, vdot)
        weight = ZERO_VECTOR if parameters.gravity is None else as_vector(parameters.gravity)
        Y = np.zeros((plan.n, PER_BODY * len(bodies)), v.dtype)
        own = np.zeros(PER_BODY * len(bodies), v.dtype)
        for place, b in enumerate(bodies):
            k = plan.carriers[b]
            seat = [as_vector(rotation[place][:, i]) for i in range(3)]
            at = as_vector(offset[place])
            put_parameters(own[PER_BODY * place :], plan, parameters, b, seat, at)
            axes = tuple(from_local(frames[k].axes, x) for x in seat)
            arm, position = arm_and_position(frames, k, at)
            motion = point_motion(motions, k, arm)
            upward = subtract_vectors(motion.acceleration, weight)
            local = (to_local(axes, x) for x in (upward, motion.omega, motion.alpha))
            wrenches = [
                Screw(from_local(axes, x), from_local(axes, y)) for x, y in _wrench_columns(*local)
            ]
            linear = point_columns(plan, frames, k, (arm, position))
            angular = turning_columns(plan, frames, k)
            for j in linear.keys() | angular.keys():
                screw = Screw(linear.get(j, ZERO_VECTOR), angular.get(j, ZERO_VECTOR))
                for i, wrench in enumerate(wrenches):
                    put(Y, (j, PER_BODY * place + i), _power(screw, wrench))
        return Regressor(Y, own, rotor_torques(plan, parameters, frames, v, vdot))

    return regressor


def put_parameters(
    own: Array, plan: TopologyPlan, parameters: Any, b: int, seat: list[Vector], at: Vector
) -> None:
    """Write m, m c and I of a body about the origin of its link, along the axes of that.

    Args:
        own: the first `PER_BODY` entries are written.
        plan: the plan.
        parameters: numbers of the plan.
        b: index of the body.
        seat: axes of the link in the frame of its scalar joint.
        at: origin of the link there.
    """
    mass = parameters.mass[b]
    axes = (seat[0], seat[1], seat[2])
    center = to_local(axes, subtract_vectors(as_vector(parameters.center[b]), at))
    inertia = parameters.inertia[b]
    if plan.topology.planar:  # about the other axes nothing turns: all three get the same
        inertia = [[inertia[0, 0] if i == j else None for j in range(3)] for i in range(3)]
        turned = AXES
    else:
        turned = _transposed(axes)
    central = [mass, *ZERO_VECTOR, *(inertia[i][j] for i, j in PRODUCTS_OF_INERTIA)]
    for i, x in enumerate(moved_parameters(central, center, turned)):
        put(own, i, x)


def moved_parameters(
    parameters: Iterable[Any], away: Vector, axes: tuple[Vector, Vector, Vector] = AXES
) -> tuple[Any, ...]:
    """Return π of a body about another point along other axes, None where absent, any numbers.

    Args:
        parameters: m, m c, and I xx, xy, xz, yy, yz, zz about the origin, None where absent.
        away: the origin, seen from the other point along the other axes.
        axes: the present axes along the other ones.
    """
    mass, x, y, z, *moments = parameters
    entries = dict(zip(PRODUCTS_OF_INERTIA, moments, strict=True))
    full = [[entries[min(i, j), max(i, j)] for j in range(3)] for i in range(3)]
    inertia = turned_inertia(np.array(full, object), axes)
    body = CompositeBody(mass, from_local(axes, (x, y, z)), inertia)
    mass, first, inertia = shifted_body(body, away)
    return mass, *first, *(inertia[entry] for entry in PRODUCTS_OF_INERTIA)
