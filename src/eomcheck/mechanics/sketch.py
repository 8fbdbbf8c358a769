"""Parts of a picture of a scene: bodies, joints, coordinates and constraints in one pose.

Points and directions have 2 components in the plane and 3 in space, in m and along axes that do not
turn. Nothing here draws; `eomcheck.lab.show.sketch_drawing` does.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple, get_args

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.numbers.generic import Array


class Body(NamedTuple):
    """A rigid body as lines through points of it."""

    points: Any
    """Points (k, d), m."""
    name: str = ""
    closed: bool = False
    thin: bool = False
    """Whether its line is thin, as from a joint to a centre of mass aside."""


class Disk(NamedTuple):
    """A round body, a wheel or a ball: a circle about an axis in space."""

    center: Any
    axis: Any
    """Normal of its plane (3,)."""
    radius: float
    name: str = ""
    ball: bool = False
    """Whether it is a ball, round in every view."""


class JointMark(NamedTuple):
    """A revolute joint, on the `ground` or between bodies; in space along an axis."""

    at: Any
    ground: bool = False
    name: str = ""
    axis: Any = None
    """Direction (3,), or None if it is drawn as a point."""


class Ground(NamedTuple):
    """A point of the ground: hatching below it."""

    at: Any


class Wheel(NamedTuple):
    """A wheel or an edge seen from above, which moves along a direction only."""

    at: Any
    along: Any
    length: float
    edge: bool = False
    """Whether it is a knife edge."""


class Center(NamedTuple):
    """A centre of mass."""

    at: Any
    name: str = ""


class SpringMark(NamedTuple):
    """A spring between two points."""

    start: Any
    end: Any
    name: str = ""


class Angle(NamedTuple):
    """An angle: an arc about a point, from the direction `first`, towards `second` where positive.

    If it is too small to be visible, an arc shows its positive sense.
    """

    name: str
    at: Any
    first: Any
    second: Any
    angle: float
    radius: float


class Distance(NamedTuple):
    """A length between two points, such as a coordinate from an axis."""

    name: str
    start: Any
    end: Any


class Arrow(NamedTuple):
    """A direction: an axis of a frame, gravity, an angular velocity."""

    name: str
    at: Any
    along: Any
    """Direction times its length, m."""
    frame: bool = True
    """Whether it is an axis of a frame; otherwise a direction of force or motion."""


class ConstraintMark(NamedTuple):
    """A label of some constraint rows, at a point."""

    name: str
    at: Any
    rows: tuple[int, ...]


class Closing(NamedTuple):
    """A point where a loop closes: rows hold a point of one body at a point of another one, or of
    the ground. The force of the rows acts there.
    """

    at: Any
    """Point of the body on which the force acts (d,), m."""
    other: Any
    """Point of the other body, which feels the opposite force (d,), m."""
    rows: tuple[int, ...]


class Velocity(NamedTuple):
    """The velocity of a point, to a scale that all velocities of a sketch share."""

    at: Any
    along: Any
    """Velocity times the scale, m."""


class Force(NamedTuple):
    """The force of a constraint, to a scale that all forces of a sketch share."""

    at: Any
    along: Any
    """Force times the scale, m."""


class Trail(NamedTuple):
    """A point whose path an animation draws."""

    at: Any


class Plane(NamedTuple):
    """A patch of the ground in space by its corners (k, 3), m."""

    points: Any


Part = (
    Body
    | Disk
    | JointMark
    | Ground
    | Wheel
    | Center
    | SpringMark
    | Angle
    | Distance
    | Arrow
    | ConstraintMark
    | Closing
    | Velocity
    | Force
    | Trail
    | Plane
)


class Sketch(NamedTuple):
    """A scene in one pose, as the parts of a picture.

    The viewpoint in space has the `azimuth` about the direction `up` and the `elevation` above the
    horizontal plane, rad; there is no perspective. Pictures of planar scenes do not depend on it.
    """

    parts: tuple[Part, ...]
    azimuth: float = -1.0
    elevation: float = 0.4
    up: int = 2
    """Axis that points up: 1 for y, 2 for z."""


UPRIGHT: dict[str, Any] = {"azimuth": 0.35, "elevation": 0.15, "up": 1}
"""Viewpoint in space of a planar mechanism in a vertical plane."""

FLAT: dict[str, Any] = {"azimuth": -1.4, "elevation": 0.9}
"""Viewpoint in space of a planar mechanism on the ground."""


def sketch_text(sketch: Sketch) -> str:
    """Return a sketch as JSON, which `sketch_of_text` reads."""
    parts = [[type(part).__name__, part._asdict()] for part in sketch.parts]
    return json.dumps(sketch._asdict() | {"parts": parts}, default=_plain)


def _plain(value: Any) -> Any:
    return np.asarray(value).tolist()


def sketch_of_text(text: str) -> Sketch:
    """Return the sketch of which `sketch_text` made a text.

    Raises:
        LookupError, TypeError, ValueError: it is no such text.
    """
    kinds = {kind.__name__: kind for kind in get_args(Part)}
    fields = json.loads(text)
    parts = tuple(kinds[kind](**part) for kind, part in fields.pop("parts"))
    return Sketch(parts, **fields)


def direction(angle: float) -> Array:
    """Return (cos, sin) of an angle."""
    return np.array([np.cos(angle), np.sin(angle)])


def plane_angle(name: str, at: Any, angle: float, radius: float, start: float = 0.0) -> Angle:
    """Return an angle in the plane, from the direction `start`, by default the x axis."""
    return Angle(name, at, direction(start), direction(start + np.pi / 2), angle, radius)


def position_dimensions(
    x: float, y: float, origin: tuple[float, float] = (0.0, 0.0)
) -> tuple[Part, Part]:
    """Return two lengths, the coordinates x and y of a point in the plane."""
    return Distance("x", (origin[0], y), (x, y)), Distance("y", (x, origin[1]), (x, y))


def fixed_axes(size: float, dimensions: int = 2) -> tuple[Part, ...]:
    """Return the axes of the ground, from the origin."""
    axes = size * np.eye(dimensions)
    return tuple(
        Arrow(f"{axis} axis", np.zeros(dimensions), along)
        for axis, along in zip("xyz"[:dimensions], axes, strict=True)
    )


__getattr__ = getattr_of(__name__)
