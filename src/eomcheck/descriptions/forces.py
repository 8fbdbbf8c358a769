"""Forces on a mechanism: gravity, springs and dampers at joints and between points, torques.

The generalized forces Q belong to the first derivation. The stored energy and the dissipated power
of springs and dampers between two points are here too, in the second derivation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from eomcheck.descriptions.constraint_rows import (
    FirstDerivation,
    MovingVector,
    SecondDerivation,
    relative_vector,
)
from eomcheck.descriptions.first_derivation import centers, factor, joint_frames, with_roots
from eomcheck.descriptions.joint_tree import TopologyPlan
from eomcheck.descriptions.second_derivation import point_in_ground
from eomcheck.descriptions.vector_algebra import (
    AXES,
    ZERO_VECTOR,
    Vector,
    add_vectors,
    as_vector,
    cross,
    dot,
    plus,
    rotate,
    scale_vector,
    subtract_vectors,
    times,
    total,
)

# ---- Springs and dampers between two points ------------------------------------------------------


def with_lengths(plan: TopologyPlan, prepare: Callable) -> Callable:
    """Return a `prepare` that also computes the lengths of springs."""

    def square(parameters, prepared, spring):
        a, b = (
            point_in_ground(plan, parameters, prepared, k, as_vector(parameters.points[j]))
            for k, j in spring.points
        )
        apart = subtract_vectors(a, b)
        return dot(apart, apart)

    return with_roots(prepare, "lengths", plan.topology.springs, square)


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


# ---- Springs of joints that turn about any axis --------------------------------------------------

HALVINGS = 3
"""Number of times that an angle of rotation is halved, before its cosine enters the series."""

TERMS = 14
"""Terms of the series: behind them are less than 2^-66 of its value."""

UNIT = 2**53
"""Denominator of its coefficients, whose numerators are exact in float64: they are 2^-54 off."""


def _coefficients() -> list[int]:
    """Return numerators of b in θ² = 2 y Σ b y^n, y = 1 - cos θ: 3F2(1, 1, 1; 3/2, 2; y/2)."""
    b = [Fraction(1)]
    for n in range(1, TERMS):
        b.append(b[-1] * n * n / ((2 * n + 1) * (n + 1)))
    return [round(x * UNIT) for x in b]


ANGLE_SQUARED = _coefficients()
ANGLE_BY_SINE = [(n + 1) * b for n, b in enumerate(ANGLE_SQUARED)]
"""That of θ / sin θ = Σ (n + 1) b y^n, half the derivative of θ² by y: 2F1(1, 1; 3/2; y/2)."""


def _series(numerators: list[int], y: Any) -> Any:
    result: Any = numerators[-1]
    for numerator in reversed(numerators[:-1]):
        result = result * y + numerator
    return result / UNIT


def _turned(plan: TopologyPlan, prepared: Any, i: int, a: Vector) -> Vector:
    """Return a vector behind the hinge of scalar joint i along the axes before it."""
    hinge = plan.hinge_index[i]
    cos, sin = prepared.angles.cos[hinge], prepared.angles.sin[hinge]
    return rotate(a, plan.joints[i].axis, cos, sin)


def _axes_behind(plan: TopologyPlan, prepared: Any, k: int) -> tuple[Vector, ...]:
    """Return the axes of the frame behind a gimbal, k its last turn, along those before it."""
    axes: tuple[Vector, ...] = AXES
    for i in reversed(plan.rotor_joints(k)):
        axes = tuple(_turned(plan, prepared, i, a) for a in axes)
    return axes


def _axes_at_rest(parameters: Any, spring: int) -> tuple[Vector, ...]:
    """Return the axes of the frame behind a gimbal where its spring is relaxed."""
    R = parameters.rest_rotation[spring]
    return tuple(as_vector(R[:, i]) for i in range(3))


def with_half_cosines(plan: TopologyPlan, prepare: Callable) -> Callable:
    """Return a `prepare` that also computes the cosines of parts of the angles of gimbals.

    The cosine of half an angle is the root of (1 + cos) / 2, and the trace of a rotation is
    1 + 2 cos.
    """

    def first_square(parameters, prepared, gimbal):
        spring, k = gimbal
        pairs = zip(_axes_at_rest(parameters, spring), _axes_behind(plan, prepared, k), strict=True)
        trace: Any = total(dot(a, b) for a, b in pairs)
        return (1 + trace) / 4

    def half_cosines(arithmetic, square):
        cosines = np.zeros((HALVINGS, len(square)), square.dtype)
        for i in range(HALVINGS):
            cosines[i] = arithmetic.root(square)
            square = (1 + cosines[i]) / 2
        return cosines

    gimbals = [*enumerate(plan.sprung_gimbals)]
    return with_roots(prepare, "half_cosines", gimbals, first_square, half_cosines)


def _angle_by_sine(prepared: Any, spring: int) -> Any:
    """Return θ / sin θ of the angle θ by which a gimbal is turned from rest: 1 at rest, and smooth.

    It is that of half the angle over the cosine of half the angle.
    """
    cosines = [prepared.half_cosines[i, spring] for i in range(HALVINGS)]
    ratio = _series(ANGLE_BY_SINE, 1 - cosines[-1])
    for cosine in cosines:
        ratio = ratio / cosine
    return ratio


def add_gimbal_springs(plan: TopologyPlan, parameters: Any, prepared: Any, Q: Any) -> None:
    """Add the torques of springs at gimbals to Q (n,): -k θ u, u the axis of the rotation by θ."""
    for i, k in enumerate(plan.sprung_gimbals):
        sine: Any = ZERO_VECTOR  # 2 sin θ u
        for a, b in zip(_axes_at_rest(parameters, i), _axes_behind(plan, prepared, k), strict=True):
            sine = add_vectors(sine, cross(a, b))
        share = parameters.gimbal_stiffness[i] * _angle_by_sine(prepared, i) / 2
        turns = plan.rotor_joints(k)
        for place, j in enumerate(turns):
            axis: Any = AXES[plan.joints[j].axis]
            for before in reversed(turns[:place]):
                axis = _turned(plan, prepared, before, axis)
            Q[plan.joints[j].coordinate] -= share * dot(axis, sine)


def gimbal_spring_energy(plan: TopologyPlan, parameters: Any, prepared: Any) -> Any:
    """Return the potential energy k θ² / 2 of springs at gimbals, J; None without any."""
    U = None
    for i in range(len(plan.sprung_gimbals)):
        y = 1 - prepared.half_cosines[HALVINGS - 1, i]
        half_square = y * _series(ANGLE_SQUARED, y)
        U = plus(U, parameters.gimbal_stiffness[i] * half_square * 4**HALVINGS)
    return U


# ---- Generalized forces --------------------------------------------------------------------------


def make_forces(plan: TopologyPlan) -> Any:
    """Return the function `forces` of a scene."""
    sprung = bool(plan.topology.springs or plan.sprung_gimbals) or any(
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
        add_gimbal_springs(plan, parameters, prepared, Q)
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
