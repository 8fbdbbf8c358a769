"""What rolls on a plane: where it touches it, how that slips, and how high it is.

A ball touches the plane straight below its centre, at -R e with the plane's normal e. The rim of a
disk with the axis n is lowest at -R n × (e × n) / s with s = |e × n|, a root, for e and n of length
1. Where some link has the direction of the spoke that touches, as the frame that leans with a disk
but does not spin, it is told instead, and there is no root. The point of contact belongs to the rim
for a moment only: it wanders along it while the disk leans.
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
from eomcheck.mechanics.described.rows import Moving, Read, Row, product
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
            across = cross(normal, axis)  # 1 - (e · n)² has no digit left of a small sine
            square[i] = dot(across, across)
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
    spoke, moved = read.at.rim(axis, normal)
    arm = scaled(share, spoke)
    shorter = times(times(upright.position, upright.rate), 1 / (s * s))
    return arm, added(scaled(share, moved), scaled(shorter, arm))


def slipping(read: Read) -> Moving:
    """Return how fast the point of contact moves against the plane that it touches."""
    (center, foot), (spin, turn) = read.points, read.turning
    arm, wandering = arm_of(read)
    reach = added(subtracted(center.value, foot.value), arm)
    rim = added(center.rate, cross(spin.rate, arm))
    floor = added(foot.rate, cross(turn.rate, reach))
    columns = {}
    for i in {**center.columns, **spin.columns, **foot.columns, **turn.columns}:
        V, omega, W, Omega = (x.columns.get(i, NOTHING) for x in (center, spin, foot, turn))
        apart = added(subtracted(V, W), cross(reach, Omega))
        columns[i] = subtracted(apart, cross(arm, omega))
    going = added(subtracted(center.rate, foot.rate), wandering)
    rolled = added(cross(spin.rest, arm), cross(spin.rate, wandering))
    carried = added(cross(turn.rest, reach), cross(turn.rate, going))
    rest = added(subtracted(center.rest, foot.rest), subtracted(rolled, carried))
    return Moving(NOTHING, subtracted(rim, floor), columns, rest)


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
    """Return that the point of contact is on the plane, whose normal is the first direction.

    Its height is found where it is, and its row from how the point of contact moves.
    """
    R, (normal, *told) = radius(read), read.directions
    if (
        read.closure.directions[1:] == read.closure.directions[:1]
    ):  # a ball: R below its centre, however the plane turns
        row = product(read.apart, normal)
        return [row._replace(position=minus(row.position, R))]
    (row,) = rolling(read)
    centered = dot(read.apart.value, normal.value)
    rise = read.sine if len(told) == 2 else dot(told[0].value, normal.value)
    return [row._replace(position=minus(centered, times(R, rise)))]
