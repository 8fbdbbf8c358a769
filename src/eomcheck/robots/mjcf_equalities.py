"""Equalities of MuJoCo's model as constraints by declaration: they hold exactly here."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.quaternions import ONE, Quaternion, multiplied
from eomcheck.mechanics.described.words import Constraint, Triple, coupling, drive, pin, weld
from eomcheck.numbers.generic import Array
from eomcheck.robots.urdf_xml import Unreadable

CONNECT, WELD, JOINT = range(3)

SITE = 6
"""MuJoCo's number for that kind of object."""


class Read(NamedTuple):
    """What of a model has been read."""

    model: Any
    where: str
    """The file, in what is refused."""
    bodies: list[str]
    """Names of their links; the ground first."""
    joints: list[str]
    anchors: list[Array]
    """Origin of each body's link in the frame of the body (3,), m."""
    reference: dict[str, float]
    """Coordinate of joints that have one, where the file draws them."""


def equality(read: Read, i: int) -> Constraint:
    """Return equality number i of a model.

    Raises:
        InputError: it is between other things, or no linear one.
    """
    m = read.model
    name, kind = m.equality(i).name or f"equality{i}", int(m.eq_type[i])
    first, second, data = int(m.eq_obj1id[i]), int(m.eq_obj2id[i]), m.eq_data[i]
    if kind == JOINT:
        other = None if second < 0 else read.joints[second]
        return _coupled(read, name, read.joints[first], other, data)
    if m.eq_objtype[i] == SITE:
        at, at_other = m.site_pos[first], m.site_pos[second]
        w, x, y, z = m.site_quat[second]
        turn = multiplied(tuple(m.site_quat[first].tolist()), (w, -x, -y, -z))
        first, second = int(m.site_bodyid[first]), int(m.site_bodyid[second])
    elif kind == CONNECT:
        at, at_other, turn = data[:3], data[3:6], ONE
    else:
        at, at_other, turn = data[3:6], data[:3], data[6:10]
    ends = read.bodies[first], read.bodies[second]
    points = triple_of(at - read.anchors[first]), triple_of(at_other - read.anchors[second])
    if kind == CONNECT:
        return pin(name, *ends, *points)
    return weld(name, *ends, *points, quaternion_of(turn))


def _coupled(read: Read, name: str, joint: str, other: str | None, data: Array) -> Constraint:
    for one in (joint, other):
        if one is not None and one not in read.reference:
            several = f"joint {one!r}, which has several coordinates"
            raise Unreadable(f"{read.where}: equality {name!r} is of {several}")
    here = read.reference[joint] + data[0]
    if other is None:
        return drive(name, joint, float(here))
    if np.any(data[2:5]):
        raise Unreadable(f"{read.where}: equality {name!r} is not linear")
    shift = here - data[1] * read.reference[other]
    return coupling(name, joint, other, float(data[1]), float(shift))


def triple_of(a: Any) -> Triple:
    """Return three numbers of an array."""
    x, y, z = (float(part) for part in a)
    return x, y, z


def quaternion_of(a: Any) -> Quaternion:
    """Return four numbers of an array."""
    w, x, y, z = (float(part) for part in a)
    return w, x, y, z
