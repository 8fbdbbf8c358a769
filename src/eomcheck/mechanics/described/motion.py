"""First derivation, how everything moves with v: columns a × arm along the axes of the ground.

Only joints on the way from the ground to a body move it, and only those columns are formed. Angular
velocities are told along the axes of the bodies, in which inertia keeps its value.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.absent import (
    NOTHING,
    Vector,
    added,
    along,
    centripetal,
    cross,
    dot,
    put,
    put_vector,
    scaled,
    subtracted,
    turned_back,
    unit,
    vector,
)
from eomcheck.mechanics.described.pose import Frame, factor, placed, point_of
from eomcheck.mechanics.described.topology import Plan
from eomcheck.mechanics.records import Jacobians
from eomcheck.numbers.generic import generic

Columns = dict[int, Vector]
"""Coordinate -> ∂(velocity)/∂v."""


class Rates(NamedTuple):
    """How a frame moves, along the axes of the ground."""

    omega: Vector
    alpha: Vector
    """ω̇ at v̇ = 0."""
    rest: Vector
    """Acceleration of its origin at v̇ = 0."""


STILL = Rates(NOTHING, NOTHING, NOTHING)


def columns(plan: Plan, frames: list[Frame], k: int, point: tuple[Vector, Vector]) -> Columns:
    """Return how a point of frame k moves with v, given as arm from its origin and as place."""
    found: Columns = {}
    for i, runs in plan.movers[k] if k >= 0 else ():
        axis, reach = frames[i].axis, NOTHING
        for run in runs:
            arm, at = point if run.end is None else (frames[run.end].arm, frames[run.end].origin)
            reach = added(reach, arm if run.arm else subtracted(at, frames[run.start].origin))
        moved = axis if plan.slots[i].slides else cross(axis, reach)
        j = plan.slots[i].coordinate
        found[j] = added(found.get(j, NOTHING), moved)
    return found


def turning_columns(plan: Plan, frames: list[Frame], k: int) -> Columns:
    """Return how fast frame k turns with v, along the axes of the ground."""
    found: Columns = {}
    for i in plan.turned_by[k] if k >= 0 else ():
        slot = plan.slots[i]
        if not slot.slides:
            before = found.get(slot.coordinate, NOTHING)
            found[slot.coordinate] = added(before, frames[i].axis)
    return found


@generic
def spins(plan, parameters, prepared):
    """Return, slot by slot, how fast each frame turns with v, along its own axes (`Columns`)."""
    found: list[Columns] = []
    for k, slot in enumerate(plan.slots):
        here = dict(found[plan.seat(k)]) if plan.seat(k) >= 0 else {}
        if slot.turn is not None:
            R = parameters.rotation[slot.turn]
            seat = tuple(vector(R[:, i]) for i in range(3))
            here = {i: along(seat, one) for i, one in here.items()}
        if not slot.slides:
            at, axis, j = plan.hinge[k], slot.axis, slot.coordinate
            if not slot.symmetric:
                cos, sin = prepared.angles.cos[at], prepared.angles.sin[at]
                here = {i: turned_back(one, axis, cos, sin) for i, one in here.items()}
            own = unit(axis, factor(slot, parameters))
            here[j] = added(here.get(j, NOTHING), own)
        found.append(here)
    return found


@generic
def moving(plan, parameters, frames, v):
    """Return the `Rates` of each frame."""
    found = []
    for k, slot in enumerate(plan.slots):
        before, frame = found[slot.parent] if slot.parent >= 0 else STILL, frames[k]
        omega, alpha, _ = found[plan.seat(k)] if plan.seat(k) >= 0 else STILL
        rest = added(before.rest, swung(before, frame.arm))
        rate = scaled(v[slot.coordinate], frame.axis)
        carried = cross(omega, rate)
        if slot.slides:
            rest = added(rest, scaled(2, carried))
        else:
            omega, alpha = added(omega, rate), added(alpha, carried)
        found.append(Rates(omega, alpha, rest))
    return found


def swung(rates: Rates, arm: Vector) -> Vector:
    """Return the acceleration of the end of an arm against its other end, at v̇ = 0."""
    return added(cross(rates.alpha, arm), centripetal(rates.omega, arm))


def centers(plan: Plan, parameters: Any, frames: list[Frame]) -> list[tuple[Vector, Vector]]:
    """Return the arm to the centre of mass of each body, and its place."""
    return [point_of(frames, k, vector(parameters.center[b])) for b, k in enumerate(plan.carriers)]


def jacobians_of(plan: Plan) -> Any:
    """Return the function `jacobians` of a scene: V along the ground's axes, ω along the bodies'.

    Bodies come first, then rotors, which only turn, each about its own joint.
    """
    carriers, d, e = plan.carriers, plan.d, plan.e
    kept = slice(3 - e, 3)

    def jacobians(parameters, prepared, q, v):
        frames = placed(plan, parameters, prepared)
        turning, rates = spins(plan, parameters, prepared), moving(plan, parameters, frames, v)
        linear = np.zeros((plan.bodies, d, plan.n), v.dtype)
        angular = np.zeros((plan.bodies, e, plan.n), v.dtype)
        rest, turned = np.zeros((plan.bodies, d), v.dtype), np.zeros((plan.bodies, e), v.dtype)
        gyroscopic = None if plan.topology.planar else np.zeros((plan.bodies, e), v.dtype)
        for b, (arm, at) in enumerate(centers(plan, parameters, frames)):
            k = carriers[b]
            for i, one in columns(plan, frames, k, (arm, at)).items():
                put_vector(linear, (b, None, i), one, d)
            for i, one in turning[k].items():
                put_vector(angular, (b, None, i), one[kept], e)
            put_vector(rest, (b, None), added(rates[k].rest, swung(rates[k], arm)), d)
            put_vector(turned, (b, None), along(frames[k].axes, rates[k].alpha)[kept], e)
            if gyroscopic is not None:
                omega = along(frames[k].axes, rates[k].omega)
                moment = cross(omega, momentum(parameters.inertia[b], omega))
                put_vector(gyroscopic, (b, None), moment)
        for b, k in enumerate(plan.rotors, len(carriers)):
            put(angular, (b, e - 1, plan.slots[k].coordinate), factor(plan.slots[k], parameters))
        return Jacobians(linear, angular, rest, turned, gyroscopic)

    return jacobians


@generic
def momentum(inertia, omega):
    """Return I ω."""
    return tuple(dot(vector(inertia[i]), omega) for i in range(3))
