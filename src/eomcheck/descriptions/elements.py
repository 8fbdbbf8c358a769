"""Elements of a description: links, joints and constraints, by name, in SI units."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from eomcheck.deprecated import getattr_of, old_attributes, old_keywords
from eomcheck.descriptions.vector_algebra import IDENTITY, Quaternion, rotation_matrix, z_to_axis
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.numbers.generic import Array

Triple = tuple[float, float, float]

ORIGIN: Triple = (0.0, 0.0, 0.0)

SHORTEST, LONGEST = 1e-100, 1e100
"""Range of lengths of quaternions and directions whose squares are finite in float64."""

COORDINATES = {
    "revolute": ("",),
    "prismatic": ("",),
    "fixed": (),
    "planar": ("_x", "_y", "_turn"),
    "spherical": ("_yaw", "_pitch", "_roll"),
    "floating": ("_x", "_y", "_z", "_yaw", "_pitch", "_roll"),
}
"""Kind of joint -> suffixes of its coordinates' names, behind its own name."""

F = TypeVar("F", bound=Callable[..., Any])


def keywords_checked(function: F) -> F:
    """Decorate a function, or a NamedTuple, so that an unknown keyword is an UnknownNameError."""
    if isinstance(function, type):
        kind: Any = function
        kind.__new__ = _checking_keywords(kind.__new__, kind.__name__, kind._fields)
        return cast(F, kind)
    return _checking_keywords(function, function.__name__, tuple(signature(function).parameters))


def _checking_keywords(function: F, owner: str, names: tuple[str, ...]) -> F:
    """Return a function that takes keywords of these names only."""

    @wraps(function)
    def called(*arguments: Any, **options: Any) -> Any:
        for name in options:
            if name not in names:
                raise UnknownNameError(f"keyword of {owner}", name, names)
        return function(*arguments, **options)

    return cast(F, called)


@keywords_checked
class Link(NamedTuple):
    """A rigid body, or a frame without inertia."""

    name: str
    mass: float = 0.0
    """Mass, kg."""
    center: Triple = ORIGIN
    """Centre of mass, m."""
    moments: Triple = ORIGIN
    """Moments I_xx, I_yy, I_zz about the centre of mass, along the axes of the link, kg m²."""
    products: Triple = ORIGIN
    """Entries xy, xz, yz of the inertia matrix, kg m²."""

    @classmethod
    def with_inertia(cls, name: str, mass: float, center: Triple, inertia: Array) -> Link:
        """Return a link with an inertia matrix (3, 3) about its centre of mass, kg m²."""
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = np.asarray(inertia).tolist()
        return cls(name, mass, center, (xx, yy, zz), (xy, xz, yz))

    @property
    def inertia(self) -> Array:
        """The inertia matrix (3, 3) about the centre of mass, kg m²."""
        (xx, yy, zz), (xy, xz, yz) = self.moments, self.products
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], np.float64)

    @property
    def has_inertia(self) -> bool:
        """Whether its mass or an entry of its inertia matrix is not 0."""
        return any((self.mass, *self.moments, *self.products))


@old_keywords
@keywords_checked
class Joint(NamedTuple):
    """A joint: the relative motion of one link, the child, against another, the parent.

    A positive coordinate turns the child about the axis, or slides it along, as seen from the
    parent. A planar joint slides along x and y and then turns about z of the frame whose z is the
    axis; a spherical one turns about z, y and x in this order; a floating one first slides along
    x, y, z.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Triple = ORIGIN
    """Origin of the child in the frame of the parent where all coordinates are 0, m."""
    orientation: Any = IDENTITY
    """Orientation of the child there, a quaternion of any length. In a `Description` a quarter
    turn, or a matrix (3, 3) whose columns are its axes.
    """
    axis: Triple = (0.0, 0.0, 1.0)
    """Direction in the frame of the child, of any length."""
    damping: float | None = None
    """Damping coefficient, N m s/rad or N s/m; None without a damper. Of a joint with several
    coordinates: of the velocity of the child's origin and of its angular velocity, both as seen
    from the parent.
    """
    stiffness: float | None = None
    """Spring stiffness, N m/rad or N/m; None without a spring. Of a spherical or floating joint:
    along the shortest rotation from the child at rest, of which the torque is -k times the rotation
    vector, and of a floating one from the origin at rest too.
    """
    rest_position: float | Triple = 0.0
    """Coordinate at which the spring is relaxed, rad or m; of a floating joint the three of its
    origin.
    """
    rest_orientation: Quaternion = IDENTITY
    """Orientation at which the spring of a spherical or floating joint is relaxed, in the frame of
    the child where all coordinates are 0; a quaternion of any length.
    """
    armature: float | None = None
    """Inertia of a rotor that turns with the coordinate, kg m² or kg; None without. Of a joint with
    several coordinates: of the same velocities as the damping.
    """
    mimics: tuple[str, float, float] | None = None
    """Another joint, ratio and shift; this coordinate is ratio times the other's, plus shift."""
    absolute: bool = False
    """Whether a hinge's coordinate is the angle to the axes of the ground, not of the parent."""
    torque: float | None = None
    """Constant torque or force along its coordinate, N m or N; None without."""
    symmetric: bool = False
    """Whether its whole subtree is rotationally symmetric about its axis, as wheels are; then half
    of the equations need no sine of its angle. Only for a `Description`; the other half checks it.
    """


class Constraint(NamedTuple):
    """A constraint besides the joints, constructed by the functions below."""

    kind: str
    name: str
    points: tuple[tuple[str, Triple], ...] = ()
    """Links and points on them, m."""
    directions: tuple[tuple[str, Triple], ...] = ()
    joints: tuple[str, ...] = ()
    numbers: Any = None
    factor: Any = None
    """Factor by which its rows are multiplied; None for 1."""


@keywords_checked
class Spring(NamedTuple):
    """A spring between two points, with or without a damper."""

    name: str
    link: str
    other: str
    at: Triple
    at_other: Triple
    stiffness: float
    """Stiffness, N/m."""
    length: float
    """Length at rest, m."""
    damping: float | None = None
    """Damping coefficient, N s/m."""


@keywords_checked
def pin(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return a pin constraint: a point of one link coincides with a point of another.

    Args:
        name: name of the constraint.
        link: name of one link.
        other: name of the other link.
        at: the point on the link, m.
        at_other: the point on the other link, m.
    """
    return Constraint("pin", name, ((link, at), (other, at_other)))


@keywords_checked
def weld(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN,
    turn: Quaternion = IDENTITY,
) -> Constraint:  # fmt: skip
    """Return a weld constraint: a frame of one link coincides with a frame of another.

    Args:
        name: name of the constraint.
        link: name of one link.
        other: name of the other link.
        at: origin of the frame on the link, m.
        at_other: origin of the frame on the other link, m; its axes are those of this link.
        turn: orientation of the frame on the link, a quaternion of any length.
    """
    _check_turns(name, turn)
    axes = tuple((link, _triple(axis)) for axis in rotation_matrix(turn).T)
    return Constraint("weld", name, ((link, at), (other, at_other)), axes)


@keywords_checked
def hinge(
    name: str, link: str, other: str, at: Triple = ORIGIN, at_other: Triple = ORIGIN,
    axis: Triple = (0.0, 0.0, 1.0), axis_of_other: Triple = (0.0, 0.0, 1.0),
) -> Constraint:  # fmt: skip
    """Return a hinge constraint: a pin about an axis that two links share, in space.

    Args:
        name: name of the constraint.
        link: name of one link.
        other: name of the other link.
        at: the point on the link, m.
        at_other: the point on the other link, m.
        axis: direction of the axis on the link, of any length.
        axis_of_other: direction of the axis on the other link, of any length.
    """
    _check_turns(name, axis)
    across = rotation_matrix(z_to_axis(axis)).T[:2]
    directions = tuple((link, _triple(d)) for d in across)
    points = (link, at), (other, at_other)
    return Constraint("hinge", name, points, (*directions, (other, axis_of_other)))


@keywords_checked
def distance(
    name: str, link: str, other: str, length: float, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return a distance constraint, a massless rod between two points.

    Args:
        name: name of the constraint.
        link: name of one link.
        other: name of the other link.
        length: length of the rod, m.
        at: the point on the link, m.
        at_other: the point on the other link, m.
    """
    return Constraint("distance", name, ((link, at), (other, at_other)), numbers=length)


@keywords_checked
def on_plane(
    name: str, link: str, other: str, across: Triple, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> Constraint:
    """Return an on-plane constraint: a point of one link stays on a plane of another.

    Args:
        name: name of the constraint.
        link: name of the link with the point.
        other: name of the link with the plane.
        across: normal of the plane, of any length.
        at: the point on the link, m.
        at_other: a point of the plane, m.
    """
    return Constraint("on-plane", name, ((link, at), (other, at_other)), ((other, across),))


@keywords_checked
def on_quadric(
    name: str, link: str, other: str, bends: Triple, level: float, slopes: Triple = ORIGIN,
    at: Triple = ORIGIN, at_other: Triple = ORIGIN, turn: Quaternion = IDENTITY,
) -> Constraint:  # fmt: skip
    """Return an on-quadric constraint: a point stays on a second-order surface of another link.

    With the point's coordinates s along axes of the other link, Σ (bends_i s_i²/2 + slopes_i s_i) =
    level. A sphere has bends (1, 1, 1)/R and the level R/2, a cylinder of this radius (1, 1, 0)/R,
    a cone (1, 1, -c) and 0; a paraboloid has slopes (0, 0, -1) and the level 0. In the plane it is
    a conic. Where its gradient vanishes, as at the tip of a cone, it constrains nothing.

    Args:
        name: name of the constraint.
        link: name of the link with the point.
        other: name of the link with the surface.
        bends: coefficients of s_i²/2, 1/m.
        level: right-hand side, a length, m.
        slopes: coefficients of s_i, the gradient of the surface where s is 0.
        at: the point on the link, m.
        at_other: the origin of s on the other link, m.
        turn: orientation of the axes of s against those of the other link, a quaternion.
    """
    _check_turns(name, turn)
    axes = tuple((other, _triple(axis)) for axis in rotation_matrix(turn).T)
    points = (link, at), (other, at_other)
    return Constraint("on-quadric", name, points, axes, numbers=(*bends, *slopes, level))


@keywords_checked
def perpendicular(
    name: str, link: str, along: Triple, other: str, along_other: Triple
) -> Constraint:
    """Return a constraint that keeps two directions perpendicular.

    Args:
        name: name of the constraint.
        link: name of one link.
        along: direction on the link.
        other: name of the other link.
        along_other: direction on the other link.
    """
    return Constraint("square", name, directions=((link, along), (other, along_other)))


@keywords_checked
def coupling(
    name: str, joint: str, other: str, ratio: float, shift: float = 0.0,
    more: tuple[tuple[str, float], ...] = (),
) -> Constraint:  # fmt: skip
    """Return a gear constraint: one joint's coordinate is ratio times another's, plus shift.

    Args:
        name: name of the constraint.
        joint: name of the driven joint.
        other: name of the other joint.
        ratio: transmission ratio, in units of the coordinates.
        shift: constant part, rad or m.
        more: further joints, each with its ratio, whose coordinates are added.
    """
    joints = joint, other, *(further for further, _ in more)
    numbers = ratio, shift, *(factor for _, factor in more)
    return Constraint("coupling", name, joints=joints, numbers=numbers)


@keywords_checked
def drive(
    name: str, joint: str, position: float = 0.0, rate: float = 0.0, acceleration: float = 0.0
) -> Constraint:
    """Return a drive: a joint's coordinate is position + rate t + acceleration t²/2.

    Args:
        name: name of the constraint.
        joint: name of the joint.
        position: coordinate at t = 0, rad or m.
        rate: its rate at t = 0, rad/s or m/s.
        acceleration: its constant second rate, rad/s² or m/s².
    """
    return Constraint("drive", name, joints=(joint,), numbers=(position, rate, acceleration))


@keywords_checked
def knife_edge(name: str, link: str, across: Triple, at: Triple = ORIGIN) -> Constraint:
    """Return a nonholonomic constraint: a point of a link has no velocity along a direction of it.

    Args:
        name: name of the constraint.
        link: name of the link.
        across: direction on the link, perpendicular to the knife edge.
        at: the point on the link, m.
    """
    return Constraint("edge", name, ((link, at),), ((link, across),))


@keywords_checked
def on_line(
    name: str, link: str, other: str, along: Triple, at: Triple = ORIGIN, at_other: Triple = ORIGIN
) -> tuple[Constraint, Constraint]:
    """Return two on-plane constraints: a point of one link stays on a line of another, in space.

    In the plane a line is an `on_plane` constraint.

    Args:
        name: name of the constraint; ", x" and ", y" are appended.
        link: name of the link with the point.
        other: name of the link with the line.
        along: direction of the line, of any length.
        at: the point on the link, m.
        at_other: a point of the line, m.

    Returns:
        The constraints of two perpendicular planes through the line.
    """
    _check_turns(name, along)
    x, y, _ = _axes_about(along)
    return (
        on_plane(f"{name}, x", link, other, x, at, at_other),
        on_plane(f"{name}, y", link, other, y, at, at_other),
    )


@old_attributes
class Contact(NamedTuple):
    """A contact of a ball, or of the rim of a disk, with a plane; its methods return constraints.

    Directions are of length 1.
    """

    center: tuple[str, Triple]
    """Link of the ball or disk, and the centre on it, m."""
    floor: tuple[str, Triple]
    """Link of the plane, which may move, and a point of the plane, m."""
    radius: float
    """Radius, m."""
    directions: tuple[tuple[str, Triple], ...]
    """Links and directions. For a ball one, the plane's normal. For a disk its axis and then the
    normal; or, if some link has it, only the direction from the point of contact to the centre:
    then no root is needed.
    """

    def touching(self, name: str, across: tuple[str, Triple]) -> Constraint:
        """Return the constraint that the height above the plane is 0, by the plane's normal."""
        points, numbers = (self.center, self.floor), self.radius
        return Constraint("touching", name, points, (across, *self.directions), numbers=numbers)

    def rolling(self, name: str, along: tuple[str, Triple]) -> Constraint:
        """Return the constraint that nothing slips along a direction of some link."""
        points, numbers = (self.center, self.floor), self.radius
        return Constraint("rolling", name, points, (along, *self.directions), numbers=numbers)

    def rows(self, name: str, across: Triple, *along: Triple) -> tuple[Constraint, ...]:
        """Return the constraints of contact with the plane and of no slip along its directions."""
        link, _ = self.floor
        slips = zip("xy", along, strict=False)
        return (
            self.touching(f"{name}, touching", (link, across)),
            *(self.rolling(f"{name}, along {way}", (link, d)) for way, d in slips),
        )


@keywords_checked
def rolling_ball(
    name: str, link: str, other: str, radius: float, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN, across: Triple = (0.0, 0.0, 1.0),
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return three constraints: a ball rolls on a plane of another link without slipping.

    Args:
        name: name of the constraint; each row appends its own.
        link: name of the link of the ball.
        other: name of the link of the plane; it may move.
        radius: radius of the ball, m.
        at: centre of the ball, m.
        at_other: a point of the plane, m.
        across: normal of the plane, to the side of the ball.

    Returns:
        The constraints of contact and of no slip along two directions.
    """
    _check_turns(name, across)
    x, y, normal = _axes_about(across)
    contact = Contact((link, at), (other, at_other), radius, ((other, normal),))
    return contact.rows(name, normal, x, y)


@keywords_checked
def rolling_disk(
    name: str, link: str, other: str, radius: float, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN, axis: Triple = (0.0, 0.0, 1.0), across: Triple = (0.0, 0.0, 1.0),
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return three constraints: a disk rolls on its rim on a plane without slipping.

    It must not lie flat. Args: see `rolling_ball`; `axis` is the axis of the disk.
    """
    _check_turns(name, across)
    _check_turns(name, axis)
    x, y, normal = _axes_about(across)
    directions = (link, _axes_about(axis)[2]), (other, normal)
    return Contact((link, at), (other, at_other), radius, directions).rows(name, normal, x, y)


@keywords_checked
def rolling_circle(
    name: str, link: str, other: str, radius: float, along: Triple, at: Triple = ORIGIN,
    at_other: Triple = ORIGIN,
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return two constraints: a circle rolls on a line of another link without slipping.

    All in the plane z = 0.

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
    x, y, along = rotation_matrix(z_to_axis(z)).T
    return _triple(x), _triple(y), _triple(along)


def _check_turns(name: str, parts: Any) -> None:
    """Check that a direction or quaternion has a valid length.

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
