"""Elements of a description: links, joints and constraints, by name, in SI units."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from eomcheck.deprecated import getattr_of, old_attributes, old_keywords
from eomcheck.descriptions.quaternions import IDENTITY, Quaternion, rotation_matrix, to_z
from eomcheck.errors import InputError

Triple = tuple[float, float, float]

ORIGIN: Triple = (0.0, 0.0, 0.0)

SHORTEST, LONGEST = 1e-100, 1e100
"""Lengths of quaternions and directions whose squares doubles hold."""

COORDINATES = {
    "revolute": ("",),
    "prismatic": ("",),
    "fixed": (),
    "planar": ("_x", "_y", "_turn"),
    "spherical": ("_yaw", "_pitch", "_roll"),
    "floating": ("_x", "_y", "_z", "_yaw", "_pitch", "_roll"),
}
"""Kind of joint -> what its coordinates are called, behind its own name."""


class Link(NamedTuple):
    """A rigid body, or a frame without inertia."""

    name: str
    mass: float = 0.0
    """kg."""
    center: Triple = ORIGIN
    """Centre of mass, m."""
    moments: Triple = ORIGIN
    """I_xx, I_yy, I_zz about the centre of mass, along the axes of the link, kg m²."""
    products: Triple = ORIGIN
    """Entries xy, xz, yz of that matrix, kg m²."""


@old_keywords
class Joint(NamedTuple):
    """How one link moves against another.

    Positive, it turns the child about the axis, or slides it along, as seen from the parent. A
    planar joint slides along x and y and then turns about z of the frame whose z is the axis; a
    spherical one turns about z, y and x in a row; a floating one slides along x, y, z before.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Triple = ORIGIN
    """Of the child in the frame of the parent where all coordinates are 0, m."""
    orientation: Any = IDENTITY
    """Its orientation there, a quaternion of any length. In a `Description` a quarter turn, or a
    matrix (3, 3) whose columns are its axes."""
    axis: Triple = (0.0, 0.0, 1.0)
    """In the frame of the child, of any length."""
    damping: float | None = None
    """N m s/rad or N s/m; None without a damper."""
    stiffness: float | None = None
    """N m/rad or N/m; None without a spring."""
    rest_position: float = 0.0
    """Where the spring rests, rad or m."""
    armature: float | None = None
    """Inertia of a rotor that turns with the coordinate, kg m² or kg; None without."""
    mimics: tuple[str, float, float] | None = None
    """Another joint, ratio and shift; its coordinate is ratio times the other's, plus shift."""
    absolute: bool = False
    """Whether a hinge's coordinate is the angle to the axes of the ground, not of the parent."""
    torque: float | None = None
    """A constant one along its coordinate, N m or N; None without."""
    symmetric: bool = False
    """Whether all that it turns is alike all round its axis, as wheels are; then half of the
    equations need no sine of it. Of a `Description` alone; the other half checks it."""


class Constraint(NamedTuple):
    """What else holds; made by the functions below."""

    kind: str
    name: str
    points: tuple[tuple[str, Triple], ...] = ()
    """Links, and where on them, m."""
    directions: tuple[tuple[str, Triple], ...] = ()
    joints: tuple[str, ...] = ()
    numbers: Any = None
    factor: Any = None
    """So many times its rows are taken; None for once."""


class Spring(NamedTuple):
    """A spring between two points, with a damper or without."""

    name: str
    link: str
    other: str
    at: Triple
    at_other: Triple
    stiffness: float
    """N/m."""
    length: float
    """At rest, m."""
    damping: float | None = None
    """N s/m."""


def pin(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return that a point of one link is a point of another."""
    return Constraint("pin", name, ((link, at), (other, at_other)))


def weld(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN,
    turn: Quaternion = IDENTITY,
) -> Constraint:  # fmt: skip
    """Return that two frames are one: the other's, and what `at` and `random_orientation` make of
    the link's.
    """
    _check_turns(name, turn)
    axes = tuple((link, _triple(one)) for one in rotation_matrix(turn).T)
    return Constraint("weld", name, ((link, at), (other, at_other)), axes)


def hinge(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN,
    axis: Triple = (0.0, 0.0, 1.0), axis_of_other: Triple = (0.0, 0.0, 1.0),
) -> Constraint:  # fmt: skip
    """Return a pin about an axis of both."""
    _check_turns(name, axis)
    across = rotation_matrix(to_z(axis)).T[:2]
    directions = tuple((link, _triple(one)) for one in across)
    points = (link, at), (other, at_other)
    return Constraint("hinge", name, points, (*directions, (other, axis_of_other)))


def distance(
    name: str, link: str, other: str, length: float, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return a massless rod between two points."""
    return Constraint("distance", name, ((link, at), (other, at_other)), numbers=length)


def on_plane(
    name: str, link: str, other: str, across: Triple, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return that a point of one link stays on a plane of another, given by what is across it."""
    return Constraint("on-plane", name, ((link, at), (other, at_other)), ((other, across),))


def on_quadric(
    name: str, link: str, other: str, bends: Triple, level: float, slopes: Triple = ORIGIN,
    at: Triple = ORIGIN, at_other: Triple = ORIGIN, turn: Quaternion = IDENTITY,
) -> Constraint:  # fmt: skip
    """Return that a point of one link stays on a surface of the second order of another.

    Of its place s along axes of the other link Σ (bends_i s_i²/2 + slopes_i s_i) = level. A sphere
    has bends (1, 1, 1)/R and the level R/2, a cylinder of this radius (1, 1, 0)/R, a cone
    (1, 1, -c) and 0; a paraboloid has slopes (0, 0, -1) and the level 0. In the plane it is a
    conic. Where it has no slope, as in the tip of a cone, it holds nothing.

    Args:
        name: of the constraint.
        link: what the point belongs to.
        other: what the surface belongs to.
        bends: 1/m.
        level: a length, m.
        slopes: of the surface where s is 0.
        at: the point, m.
        at_other: where s is 0, m.
        turn: of the axes against those of the other link.
    """
    _check_turns(name, turn)
    axes = tuple((other, _triple(one)) for one in rotation_matrix(turn).T)
    points = (link, at), (other, at_other)
    return Constraint("on-quadric", name, points, axes, numbers=(*bends, *slopes, level))


def perpendicular(
    name: str, link: str, along: Triple, other: str, along_other: Triple
) -> Constraint:
    """Return that two directions are perpendicular."""
    return Constraint("square", name, directions=((link, along), (other, along_other)))


def coupling(name: str, joint: str, other: str, ratio: float, shift: float = 0.0) -> Constraint:
    """Return that one joint's coordinate is ratio times another's, plus shift: gears."""
    return Constraint("coupling", name, joints=(joint, other), numbers=(ratio, shift))


def drive(
    name: str, joint: str, position: float = 0.0, rate: float = 0.0, acceleration: float = 0.0
) -> Constraint:
    """Return that a joint's coordinate follows position + rate t + acceleration t²/2."""
    return Constraint("drive", name, joints=(joint,), numbers=(position, rate, acceleration))


def knife_edge(name: str, link: str, across: Triple, at: Triple = ORIGIN) -> Constraint:
    """Return that a point of a link does not move along a direction of the link."""
    return Constraint("edge", name, ((link, at),), ((link, across),))


def on_line(
    name: str, link: str, other: str, along: Triple, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> tuple[Constraint, Constraint]:
    """Return that a point of one link stays on a line of another, in space: on two planes.

    In the plane a line is what `on_plane` says.
    """
    _check_turns(name, along)
    x, y, _ = _axes_about(along)
    return (
        on_plane(f"{name}, x", link, other, x, at, at_other),
        on_plane(f"{name}, y", link, other, y, at, at_other),
    )


@old_attributes
class Contact(NamedTuple):
    """Where a ball, or the rim of a disk, touches a plane; what holds there are its methods.

    Directions are of length 1.
    """

    center: tuple[str, Triple]
    """A link, and where on it the centre is, m."""
    floor: tuple[str, Triple]
    """Another, which may move, and a point of its plane, m."""
    radius: float
    """m."""
    directions: tuple[tuple[str, Triple], ...]
    """Links and directions. Of a ball one, the plane's normal. Of a disk its axis and then the
    normal; or, where some link has it, only the direction from the point of contact to the centre:
    then no root is needed."""

    def touching(self, name: str, across: tuple[str, Triple]) -> Constraint:
        """Return that the height above the plane is 0, by the plane's normal."""
        points, numbers = (self.center, self.floor), self.radius
        return Constraint("touching", name, points, (across, *self.directions), numbers=numbers)

    def rolling(self, name: str, along: tuple[str, Triple]) -> Constraint:
        """Return that nothing slips along a direction of some link."""
        points, numbers = (self.center, self.floor), self.radius
        return Constraint("rolling", name, points, (along, *self.directions), numbers=numbers)

    def rows(self, name: str, across: Triple, *along: Triple) -> tuple[Constraint, ...]:
        """Return that it touches the plane and does not slip along directions of the plane."""
        link, _ = self.floor
        slips = zip("xy", along, strict=False)
        return (
            self.touching(f"{name}, touching", (link, across)),
            *(self.rolling(f"{name}, along {way}", (link, one)) for way, one in slips),
        )


def rolling_ball(
    name: str, link: str, other: str, radius: float, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN, across: Triple = (0.0, 0.0, 1.0),
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return that a ball rolls on a plane of another link without slipping, in three rows.

    Args:
        name: of the constraint; rows add what they are about.
        link: what the ball belongs to.
        other: what the plane belongs to; it may move.
        radius: of the ball, m.
        at: centre of the ball.
        at_other: a point of the plane.
        across: its normal, to the side of the ball.
    """
    _check_turns(name, across)
    x, y, normal = _axes_about(across)
    contact = Contact((link, at), (other, at_other), radius, ((other, normal),))
    return contact.rows(name, normal, x, y)


def rolling_disk(
    name: str, link: str, other: str, radius: float, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN, axis: Triple = (0.0, 0.0, 1.0), across: Triple = (0.0, 0.0, 1.0),
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return that a disk rolls on its rim on a plane without slipping, in three rows.

    It must not lie flat. Args: see `rolling_ball`; `axis` is the axis of the disk.
    """
    _check_turns(name, across)
    _check_turns(name, axis)
    x, y, normal = _axes_about(across)
    told = (link, _axes_about(axis)[2]), (other, normal)
    return Contact((link, at), (other, at_other), radius, told).rows(name, normal, x, y)


def rolling_circle(
    name: str, link: str, other: str, radius: float, along: Triple, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN,
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return that a circle rolls on a line of another link without slipping, all in the plane.

    Args: see `rolling_ball`; `along` is the direction of the line, the circle to its left.
    """
    _check_turns(name, along)
    x, y, z = along
    if z:
        raise InputError(f"constraint {name!r} is along {along!r}, expected nothing along z")
    size = math.hypot(x, y)
    ahead, left = (x / size, y / size, 0.0), (-y / size, x / size, 0.0)
    contact = Contact((link, at), (other, at_other), radius, ((other, left),))
    return contact.rows(name, left, ahead)


def _axes_about(z: Triple) -> tuple[Triple, Triple, Triple]:
    """Return axes of length 1, the last along a direction of any length."""
    x, y, along = rotation_matrix(to_z(z)).T
    return _triple(x), _triple(y), _triple(along)


def _check_turns(name: str, parts: Any) -> None:
    """Refuse what no rotation can be made of.

    Raises:
        InputError: zeros, or numbers that are none.
    """
    try:
        length = math.hypot(*parts)
    except TypeError:
        length = math.nan
    if not SHORTEST <= length <= LONGEST:
        between = f"expected a length between {SHORTEST:g} and {LONGEST:g}"
        raise InputError(f"constraint {name!r} is made of the direction {parts!r}, {between}")


def _triple(a: Any) -> Triple:
    x, y, z = (float(part) for part in a)
    return x, y, z


__getattr__ = getattr_of(__name__)
