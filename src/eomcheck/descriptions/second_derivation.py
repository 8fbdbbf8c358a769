"""Second derivation of a mechanism: velocities, energies and dissipation, along axes that turn.

Velocities are computed by recursion from frame to frame, in local axes. Only the numbers and the
vector algebra are shared with the first derivation: no axis is expressed in the ground frame, no
column is formed, and positions are computed from the tips inwards.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.descriptions.first_derivation import PreparedMechanism, factor
from eomcheck.descriptions.joint_tree import TopologyPlan
from eomcheck.descriptions.vector_algebra import (
    ZERO_VECTOR,
    Vector,
    add_vectors,
    as_vector,
    cross,
    dot,
    from_local,
    put,
    put_vector,
    rotate,
    rotate_back,
    times,
    to_local,
    unit,
)
from eomcheck.numbers.generic import generic


def _seat(parameters: Any, turn: int) -> tuple[Vector, Vector, Vector]:
    """Return the columns of the rotation of a joint at coordinate 0."""
    R = parameters.rotation[turn]
    return as_vector(R[:, 0]), as_vector(R[:, 1]), as_vector(R[:, 2])


@generic
def frame_velocities(plan, parameters, prepared, v):
    """Return (V of the origin, ω) of each frame, along its own axes."""
    velocities = []
    for k, slot in enumerate(plan.joints):
        V, omega = velocities[slot.parent] if slot.parent >= 0 else (ZERO_VECTOR, ZERO_VECTOR)
        if slot.offset is not None:
            V = add_vectors(V, cross(omega, as_vector(parameters.offset[slot.offset])))
        if slot.absolute:
            V, omega = direction_in_ground(plan, parameters, prepared, slot.parent, V), ZERO_VECTOR
        if slot.orientation is not None:
            seat = _seat(parameters, slot.orientation)
            V, omega = to_local(seat, V), to_local(seat, omega)
        own = unit(slot.axis, times(v[slot.coordinate], factor(slot, parameters)))
        if slot.slides:
            V = add_vectors(add_vectors(V, own), cross(omega, unit(slot.axis, prepared.x[k])))
        else:
            hinge, axis = plan.hinge_index[k], slot.axis
            cos, sin = prepared.angles.cos[hinge], prepared.angles.sin[hinge]
            V, omega = rotate_back(V, axis, cos, sin), rotate_back(omega, axis, cos, sin)
            omega = add_vectors(omega, own)
        velocities.append((V, omega))
    return velocities


def direction_in_ground(
    plan: TopologyPlan, parameters: Any, prepared: PreparedMechanism, k: int, a: Vector
) -> Vector:
    """Return a direction of frame k, a along its axes, along the axes of the ground."""
    return _vector_in_ground(plan, parameters, prepared, k, a, False)


def point_in_ground(
    plan: TopologyPlan, parameters: Any, prepared: PreparedMechanism, k: int, a: Vector
) -> Vector:
    """Return the position of a point a of frame k, in ground axes."""
    return _vector_in_ground(plan, parameters, prepared, k, a, True)


def _vector_in_ground(
    plan: TopologyPlan, parameters: Any, prepared: PreparedMechanism, k: int, a: Vector, point: bool
) -> Vector:
    """Return a point or a direction of frame k along the axes of the ground."""
    while k >= 0:
        slot = plan.joints[k]
        if not slot.slides:
            hinge = plan.hinge_index[k]
            a = rotate(a, slot.axis, prepared.angles.cos[hinge], prepared.angles.sin[hinge])
        elif point:
            a = add_vectors(a, unit(slot.axis, prepared.x[k]))
        if slot.orientation is not None:
            a = from_local(_seat(parameters, slot.orientation), a)
        if slot.absolute:
            if not point:
                return a
            seat = ZERO_VECTOR if slot.offset is None else as_vector(parameters.offset[slot.offset])
            return add_vectors(point_in_ground(plan, parameters, prepared, slot.parent, seat), a)
        if point and slot.offset is not None:
            a = add_vectors(a, as_vector(parameters.offset[slot.offset]))
        k = slot.parent
    return a


def point_velocity(rates: list[tuple[Vector, Vector]], k: int, a: Vector) -> Vector:
    """Return the velocity of a point a of frame k, along its axes; -1 is the ground."""
    V, omega = rates[k] if k >= 0 else (ZERO_VECTOR, ZERO_VECTOR)
    return add_vectors(V, cross(omega, a))


def make_velocities(plan: TopologyPlan) -> Any:
    """Return the function `velocities` of a scene."""

    def velocities(parameters, prepared, q, v):
        rates = frame_velocities(plan, parameters, prepared, v)
        V = np.zeros((plan.bodies, plan.d), v.dtype)
        omega = np.zeros((plan.bodies, plan.e), v.dtype)
        for b, k in enumerate(plan.carriers):
            velocity = point_velocity(rates, k, as_vector(parameters.center[b]))
            put_vector(
                V, (b, None), direction_in_ground(plan, parameters, prepared, k, velocity), plan.d
            )
            put_vector(omega, (b, None), rates[k][1][3 - plan.e :], plan.e)
        for b, k in enumerate(plan.rotors, len(plan.carriers)):
            slot = plan.joints[k]
            if slot.gimbal:
                put_vector(omega, (b, None), _gimbal_velocity(plan, prepared, v, k))
                continue
            rate = times(v[slot.coordinate], factor(slot, parameters))
            put(omega, (b, plan.e - 1), rate)
        return V, omega

    return velocities


# ---- Power and energy of forces ------------------------------------------------------------------


def make_joint_potential(plan: TopologyPlan) -> Any:
    """Return the function `potential` of a scene without springs between points."""
    sprung = [k for k, slot in enumerate(plan.joints) if slot.spring is not None]
    driven = [k for k, slot in enumerate(plan.joints) if slot.torque is not None]

    def own(k, prepared):
        # Coordinate of the joint, of opposite sign to its scalar joint's on a negative axis.
        return times(plan.joints[k].sense, prepared.x[k])

    def potential(parameters, prepared, q):
        U = None
        if parameters.gravity is not None:
            g = as_vector(parameters.gravity)
            for b, k in enumerate(plan.carriers):
                c = point_in_ground(plan, parameters, prepared, k, as_vector(parameters.center[b]))
                U = _subtract(U, times(parameters.mass[b], dot(g, c)))
        for k in sprung:
            i = plan.joints[k].spring
            stretch = own(k, prepared) - parameters.relaxed[i]
            U = _subtract(U, -(parameters.stiffness[i] * stretch * stretch) / 2)
        for k in driven:
            U = _subtract(U, parameters.torque[plan.joints[k].torque] * own(k, prepared))
        return U

    return potential


def _subtract(U: Any, x: Any) -> Any:
    """Return U - x; None stands for 0."""
    if x is None:
        return U
    return -x if U is None else U - x


def make_joint_dissipation(plan: TopologyPlan) -> Any:
    """Return the function `dissipation` of a scene without springs, or None without dampers."""
    damped = [k for k, slot in enumerate(plan.joints) if slot.damper is not None]
    if not damped:
        return None
    gimbals = [k for k in damped if plan.joints[k].gimbal]
    turns = {i for k in gimbals for i in (k - 2, k - 1, k)}
    damped = [k for k in damped if k not in turns]

    def dissipation(parameters, prepared, q, v):
        if parameters.damping is None:
            return None
        R = 0
        for k in damped:
            slot = plan.joints[k]
            rate = times(v[slot.coordinate], factor(slot, parameters))
            R += parameters.damping[slot.damper] * rate * rate
        for k in gimbals:
            omega = _gimbal_velocity(plan, prepared, v, k)
            R += parameters.damping[plan.joints[k].damper] * dot(omega, omega)
        return R / 2

    return dissipation


def _gimbal_velocity(plan: TopologyPlan, prepared: PreparedMechanism, v: Any, k: int) -> Vector:
    """Return the angular velocity of three turns, k the last, against the frame before them."""
    omega = ZERO_VECTOR
    for i in (k - 2, k - 1, k):
        hinge, slot = plan.hinge_index[i], plan.joints[i]
        cos, sin = prepared.angles.cos[hinge], prepared.angles.sin[hinge]
        own = unit(slot.axis, v[slot.coordinate])
        omega = add_vectors(rotate_back(omega, slot.axis, cos, sin), own)
    return omega
