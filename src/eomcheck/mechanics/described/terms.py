"""Lagrange's terms without Jacobians: M by composite bodies, B by Newton and Euler, tip to ground.

What hangs on a slot moves as one body where only joints before it move. So the momentum that the
rate of one joint gives it, about one joint before it after the other, is a row of M: O(n depth) and
not O(n depth²), and no formula shared with the Jacobians of the bodies, which Kane's method reads.
Everything is along the axes of the ground, about the origins of the slots.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), Sections 5.3 and 6.2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.absent import (
    NOTHING,
    Vector,
    added,
    cross,
    dot,
    levelled,
    minus,
    plus,
    scaled,
    times,
    vector,
)
from eomcheck.mechanics.described.motion import Rates, moving, swung
from eomcheck.mechanics.described.pose import Frame, factor, placed
from eomcheck.mechanics.described.topology import Plan
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.generic import generic

Symmetric = dict[tuple[int, int], Any]
"""Entries (i, j), i <= j, of a matrix (3, 3); in the plane (2, 2) alone."""


class Heavy(NamedTuple):
    """What hangs on a slot, as one body."""

    mass: Any
    first: Vector
    """Σ m r from the origin of the slot, kg m."""
    inertia: Symmetric
    """About the origin of the slot, kg m²."""


def entries(plan: Plan) -> tuple[tuple[int, int], ...]:
    """Return which entries of a moment of inertia count."""
    if plan.topology.planar:
        return ((2, 2),)
    return tuple((i, j) for i in range(3) for j in range(i, 3))


def turned(inertia: Any, axes: tuple[Vector, Vector, Vector], plan: Plan) -> Symmetric:
    """Return a body's I, given along its axes (e, e), along those of the ground."""
    if plan.topology.planar:
        return {(2, 2): inertia[0, 0]}
    halves = [levelled(axes, vector(inertia[:, k])) for k in range(3)]
    found: Symmetric = {}
    for i, j in entries(plan):
        shares = (times(halves[k][i], axes[k][j]) for k in range(3))
        x, y, z = shares
        found[i, j] = plus(plus(x, y), z)
    return found


def applied(inertia: Symmetric, a: Vector) -> Vector:
    """Return I a."""

    def row(i: int) -> Any:
        x, y, z = (times(inertia.get((min(i, j), max(i, j))), a[j]) for j in range(3))
        return plus(plus(x, y), z)

    return row(0), row(1), row(2)


def shifted(one: Heavy, away: Vector) -> Heavy:
    """Return the same body about a point from which the origin is `away`."""
    step = scaled(one.mass, away)
    middle = added(one.first, tuple(None if x is None else x / 2 for x in step))
    products = {(i, j): times(middle[i], away[j]) for i in range(3) for j in range(3)}
    found: Symmetric = {}
    for i, j in one.inertia:
        if i == j:
            others = [k for k in range(3) if k != i]
            square = plus(*(products[k, k] for k in others))
            found[i, j] = plus(one.inertia[i, j], times(2, square))
        else:
            both = plus(products[i, j], products[j, i])
            found[i, j] = minus(one.inertia[i, j], both)
    return Heavy(one.mass, added(one.first, step), found)


def weightless_turn(one: Heavy) -> Heavy:
    """Return what a slot carries for those before it that do not turn it: a point at its origin."""
    return Heavy(one.mass, NOTHING, dict.fromkeys(one.inertia))


def joined(one: Heavy | None, other: Heavy) -> Heavy:
    """Return two bodies as one."""
    if one is None:
        return other
    inertia = {at: plus(x, other.inertia[at]) for at, x in one.inertia.items()}
    return Heavy(plus(one.mass, other.mass), added(one.first, other.first), inertia)


@generic
def terms_of_bodies(plan, parameters, frames, rates, dtype):
    """Return (M (n, n), B (n,)) of the inertia forces."""
    heavy: list[Heavy | None] = [None] * len(frames)
    force, moment = [NOTHING] * len(frames), [NOTHING] * len(frames)
    for b, k in enumerate(plan.carriers):
        arm = levelled(frames[k].axes, vector(parameters.center[b]))
        mass, inertia = parameters.mass[b], turned(parameters.inertia[b], frames[k].axes, plan)
        heavy[k] = shifted(Heavy(mass, NOTHING, inertia), arm)
        force[k] = scaled(mass, added(rates[k].rest, swung(rates[k], arm)))
        moment[k] = added(whirl(inertia, rates[k]), cross(arm, force[k]))
    M, B = np.zeros((plan.n, plan.n), dtype), np.zeros(plan.n, dtype)
    for k in reversed(range(len(frames))):
        slot, frame = plan.slots[k], frames[k]
        if (own := heavy[k]) is not None:
            add_rows(plan, frames, k, own, M)
            work = dot(frame.axis, force[k] if slot.slides else moment[k])
            B[slot.coordinate] = plus(work, B[slot.coordinate])
        if own is not None and slot.parent >= 0:
            carried = weightless_turn(own) if slot.absolute else own
            heavy[slot.parent] = joined(heavy[slot.parent], shifted(carried, frame.arm))
            handed = NOTHING if slot.absolute else moment[k]
            handed = added(handed, cross(frame.arm, force[k]))
            force[slot.parent] = added(force[slot.parent], force[k])
            moment[slot.parent] = added(moment[slot.parent], handed)
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        i, last = plan.slots[k].coordinate, plan.e - 1
        grows = factor(plan.slots[k], parameters)
        M[i, i] = plus(M[i, i], times(grows, times(grows, parameters.inertia[b, last, last])))
    return M, B


def whirl(inertia: Symmetric, rates: Rates) -> Vector:
    """Return I ω̇ + ω × I ω at v̇ = 0."""
    return added(applied(inertia, rates.alpha), cross(rates.omega, applied(inertia, rates.omega)))


def add_rows(plan: Plan, frames: list[Frame], k: int, one: Heavy, M: Any) -> None:
    """Add to M what the rate of slot k gives what hangs on it, along all slots before."""
    axis, i = frames[k].axis, plan.slots[k].coordinate
    if plan.slots[k].slides:
        P, L = scaled(one.mass, axis), cross(one.first, axis)
    else:
        P, L = cross(axis, one.first), applied(one.inertia, axis)
    for at in reversed(plan.on_the_way(k)):
        slot, frame = plan.slots[at], frames[at]
        share = dot(frame.axis, P if slot.slides else L)
        if share is not None:
            M[i, slot.coordinate] += share
            if at != k:
                M[slot.coordinate, i] += share
        L = added(NOTHING if slot.absolute else L, cross(frame.arm, P))


def terms_of(plan: Plan, forces: Any, constraints: Any, drift: Any) -> Any:
    """Return the function `terms` of a scene."""

    def terms(parameters, prepared, q, v):
        frames = placed(plan, parameters, prepared)
        rates = moving(plan, parameters, frames, v)
        M, B = terms_of_bodies(plan, parameters, frames, rates, v.dtype)
        a, b = constraints(parameters, prepared, q)
        Q = forces(parameters, prepared, q, v)
        return Terms(M, Q, B, a, drift(parameters, prepared, q, v), b)

    return terms
