"""What rolls on a plane: where it touches it, how that slips, and how high it is.

A ball touches the plane straight below its centre, at -R e with the plane's normal e. The rim of a
disk with the axis n is lowest at -R (e - (e·n) n) / s with s = |e × n|, a root, for e and n of
length 1. Where some link has the direction of the spoke that touches, as the frame that leans with
a disk but does not spin, it is told instead, and there is no root. The point of contact belongs to
the rim for a moment only: it wanders along it while the disk leans.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eomcheck.mechanics.described.absent import (
    NOTHING,
    Vector,
    added,
    cross,
    dot,
    minus,
    plus,
    scaled,
    subtracted,
    times,
    vector,
)
from eomcheck.mechanics.described.energies import level
from eomcheck.mechanics.described.rows import Moving, Read, Row, less, product, repeated
from eomcheck.mechanics.described.topology import Plan


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
            upright = dot(axis, normal)
            square[i] = minus(dot(normal, normal), times(upright, upright))
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
    arm = scaled(share, subtracted(normal.value, scaled(upright.position, axis.value)))
    moved = added(scaled(upright.rate, axis.value), scaled(upright.position, axis.rate))
    shorter = times(times(upright.position, upright.rate), 1 / (s * s))
    rate = added(scaled(share, subtracted(normal.rate, moved)), scaled(shorter, arm))
    return arm, rate


def slipping(read: Read) -> Moving:
    """Return how fast the point of contact moves against the plane that it touches."""
    (center, foot), (spin, turning) = read.points, read.turning
    arm, wandering = arm_of(read)
    apart = subtracted(center.value, foot.value)
    reach = added(apart, arm)
    going = added(subtracted(center.rate, foot.rate), wandering)

    def slip(V: Vector, omega: Vector, W: Vector, turn: Vector) -> Vector:
        return subtracted(added(subtracted(V, W), cross(omega, arm)), cross(turn, reach))

    columns = {
        i: slip(*(one.columns.get(i, NOTHING) for one in (center, spin, foot, turning)))
        for i in {**center.columns, **spin.columns, **foot.columns, **turning.columns}
    }
    rest = slip(center.rest, spin.rest, foot.rest, turning.rest)
    rest = added(rest, subtracted(cross(spin.rate, wandering), cross(turning.rate, going)))
    rate = slip(center.rate, spin.rate, foot.rate, turning.rate)
    return Moving(NOTHING, rate, columns, rest)


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
    """Return that the point of contact is on the plane, whose normal is the first direction."""
    R, (normal, *told), apart = radius(read), read.directions, read.apart
    if len(told) == 2:
        return [less(product(apart, normal), lowered(product(*told), R, read.sine))]
    (spoke,) = told
    if spoke is normal:  # a ball: R below its centre, however the plane turns
        row = product(apart, normal)
        return [row._replace(position=minus(row.position, R))]
    return [less(product(apart, normal), repeated(product(spoke, normal), R))]


def lowered(upright: Row, R: Any, s: Any) -> Row:
    """Return R s as a row, s² being a constant less the square of `upright`."""
    w, rate = upright.position, upright.rate
    share = -(R / s)
    own = times(w, rate)
    second = plus(plus(times(rate, rate), times(w, upright.rest)), _square(own, s))
    columns = {i: times(share, times(w, x)) for i, x in upright.columns.items()}
    return Row(R * s, times(share, own), columns, times(share, second))


def _square(x: Any, s: Any) -> Any:
    return None if x is None else x * x / (s * s)
