"""Forces on a mechanism: gravity, springs and dampers at joints and between points, torques.

The generalized forces Q belong to the first derivation. The stored energy and the dissipated power
of springs and dampers between two points are here too, in the second derivation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.descriptions.constraint_rows import (
    FirstDerivation,
    MovingVector,
    SecondDerivation,
    relative_vector,
)
from eomcheck.descriptions.first_derivation import centers, factor, joint_frames
from eomcheck.descriptions.joint_tree import TopologyPlan
from eomcheck.descriptions.second_derivation import point_in_ground
from eomcheck.descriptions.vector_algebra import (
    ZERO_VECTOR,
    add_vectors,
    as_vector,
    cross,
    dot,
    scale_vector,
    subtract_vectors,
    times,
)

# ---- Springs and dampers between two points ------------------------------------------------------


def with_lengths(plan: TopologyPlan, prepare: Callable) -> Callable:
    """Return a `prepare` that also computes the lengths of springs."""
    if not plan.topology.springs:
        return prepare

    def prepare_all(arithmetic, parameters, q, t):
        prepared = prepare(arithmetic, parameters, q, t)
        square = np.zeros(len(plan.topology.springs), q.dtype)
        for i, spring in enumerate(plan.topology.springs):
            a, b = (
                point_in_ground(plan, parameters, prepared, k, as_vector(parameters.points[j]))
                for k, j in spring.points
            )
            apart = subtract_vectors(a, b)
            square[i] = dot(apart, apart)
        return prepared._replace(lengths=arithmetic.root(square))

    return prepare_all


def _spring_ends(
    plan: TopologyPlan, parameters: Any, derivation: Any
) -> Iterator[tuple[int, Any, MovingVector]]:
    """Yield the index of each spring, its parameters, and the vector between its ends."""
    for i, spring in enumerate(plan.topology.springs):
        a, b = (derivation.point(k, as_vector(parameters.points[j])) for k, j in spring.points)
        yield i, parameters.springs[spring.number], relative_vector(a, b)


def add_spring_forces(
    plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any, Q: Any
) -> None:
    """Add the forces of springs and dampers between points to Q (n,)."""
    if not plan.topology.springs:
        return
    derivation = FirstDerivation(plan, parameters, prepared, q)
    for i, spring, apart in _spring_ends(plan, parameters, derivation):
        # Products of columns with the distance: columns of the length, times the length.
        length = prepared.lengths[i]
        along = {j: dot(apart.value, x) for j, x in apart.columns.items()}
        along = {j: x for j, x in along.items() if x is not None}
        force = spring.stiffness * (length - spring.length)
        if spring.damping is not None:
            force = force + spring.damping * (sum(x * v[j] for j, x in along.items()) / length)
        share = force / length
        for j, x in along.items():
            Q[j] -= share * x


def spring_energy(plan: TopologyPlan, parameters: Any, prepared: Any) -> Any:
    """Return the potential energy of springs between points, J; None without any."""
    U = None
    for i, spring in enumerate(plan.topology.springs):
        stated = parameters.springs[spring.number]
        longer = prepared.lengths[i] - stated.length
        energy = stated.stiffness * longer * longer / 2
        U = energy if U is None else U + energy
    return U


def spring_dissipation(plan: TopologyPlan, parameters: Any, prepared: Any, q: Any, v: Any) -> Any:
    """Return half the power that the dampers of springs dissipate, W; None without any."""
    R = None
    for i, spring, apart in _spring_ends(
        plan, parameters, SecondDerivation(plan, parameters, prepared, q, v)
    ):
        if spring.damping is not None:
            rate = dot(apart.value, apart.rate) / prepared.lengths[i]
            half_power = spring.damping * rate * rate / 2
            R = half_power if R is None else R + half_power
    return R


# ---- Generalized forces --------------------------------------------------------------------------


def make_forces(plan: TopologyPlan) -> Any:
    """Return the function `forces` of a scene."""
    sprung = bool(plan.topology.springs) or any(
        slot.spring is not None or slot.torque is not None for slot in plan.joints
    )

    def forces(parameters, prepared, q, v):
        damping = getattr(parameters, "damping", None)
        if parameters.gravity is None and damping is None and not sprung:
            return None
        Q = np.zeros(plan.n, v.dtype)
        if parameters.gravity is not None:
            add_gravity_forces(plan, parameters, prepared, Q)
        for k, slot in enumerate(plan.joints):
            i, grows = slot.coordinate, factor(slot, parameters)
            if slot.spring is not None:
                # Along its axis; on a negative axis it is -1 times the joint's coordinate.
                relaxed = times(slot.sense, parameters.relaxed[slot.spring])
                stretch = prepared.x[k] - relaxed
                Q[i] -= times(grows, parameters.stiffness[slot.spring] * stretch)
            if slot.damper is not None and damping is not None:
                rate = times(grows, v[i])
                Q[i] -= times(grows, damping[slot.damper] * rate)
                if slot.gimbal:  # the axes of the first and third turn are not perpendicular
                    first, sine = plan.joints[k - 2].coordinate, prepared.angles.sin
                    share = damping[slot.damper] * sine[plan.hinge_index[k - 1]]
                    Q[first] += share * v[i]
                    Q[i] += share * v[first]
            if slot.torque is not None:
                Q[i] += times(grows, times(slot.sense, parameters.torque[slot.torque]))
        add_spring_forces(plan, parameters, prepared, q, v, Q)
        return Q

    return forces


def add_gravity_forces(plan: TopologyPlan, parameters: Any, prepared: Any, Q: Any) -> None:
    """Add gravity to Q (n,), its forces and moments accumulated from tips to ground."""
    frames, g = joint_frames(plan, parameters, prepared), as_vector(parameters.gravity)
    force, moment = [ZERO_VECTOR] * len(frames), [ZERO_VECTOR] * len(frames)
    for b, (arm, _) in enumerate(centers(plan, parameters, frames)):
        k = plan.carriers[b]
        force[k] = scale_vector(parameters.mass[b], g)
        moment[k] = cross(arm, force[k])
    for k in reversed(range(len(frames))):
        slot, frame = plan.joints[k], frames[k]
        work = dot(frame.axis, force[k] if slot.slides else moment[k])
        if work is not None:
            Q[slot.coordinate] += work
        if slot.parent >= 0:
            passed = ZERO_VECTOR if slot.absolute else moment[k]
            passed = add_vectors(passed, cross(frame.arm, force[k]))
            moment[slot.parent] = add_vectors(moment[slot.parent], passed)
            force[slot.parent] = add_vectors(force[slot.parent], force[k])
