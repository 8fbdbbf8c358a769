"""Random elements: positions, directions, bodies; and a random description of them as data.

Simple numbers come first, so that hypothesis shrinks to them. A `RandomDescription` computes the
pose of its links (`poses`), and writes the Python code of its scene (`code`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.build import mechanism_source
from eomcheck.descriptions.elements import COORDINATES, ORIGIN, Constraint, Joint, Link, Triple
from eomcheck.descriptions.mechanism_class import MechanismSource
from eomcheck.descriptions.quaternions import (
    IDENTITY,
    Quaternion,
    axis_rotation,
    multiply_quaternions,
    rotation_matrix,
    z_to_axis,
)
from eomcheck.mechanics.random_source import Choices
from eomcheck.numbers.generic import Array

# ---- Numbers and bodies --------------------------------------------------------------------------

STRAIGHT: tuple[Triple, ...] = (
    *((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    *((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
)
"""Directions along the axes of a frame."""

IN_PLANE = tuple(one for one in STRAIGHT if not one[2])
ACROSS = tuple(one for one in STRAIGHT if one[2])

SMALLEST = 0.1
"""Shortest direction or arm; shorter ones are replaced, to exclude accidental singularities."""


def random_point(choices: Choices, planar: bool) -> Triple:
    """Return a position within 1 m along each axis, often the origin."""
    if choices.one_of((False, True, True, True)):
        return random_triple(choices, planar)
    return ORIGIN


def random_triple(choices: Choices, planar: bool, most: float = 1.0) -> Triple:
    """Return three numbers, in the plane z = 0 if `planar`."""
    x, y = (choices.number(-most, most) for _ in range(2))
    return x, y, 0.0 if planar else choices.number(-most, most)


def random_direction(choices: Choices, planar: bool, most: float = 1.0) -> Triple:
    """Return a random direction, of any length that is not small."""
    x, y, z = random_triple(choices, planar, most)
    if max(abs(x), abs(y), abs(z)) < SMALLEST * most:
        return most, y, z
    return x, y, z


def random_transverse(choices: Choices, along: Triple) -> Triple:
    """Return a direction that is not nearly parallel to another."""
    other = random_direction(choices, planar=False)
    sine = np.linalg.norm(np.cross(along, other)) / np.linalg.norm(along) / np.linalg.norm(other)
    if sine >= SMALLEST:
        return other
    x, y, z = np.eye(3)[np.argmin(np.abs(along))].tolist()
    return x, y, z


def random_orientation(choices: Choices) -> Quaternion:
    """Return a rotation as a quaternion of any length, often the identity."""
    if not choices.one_of((False, True, True)):
        return IDENTITY
    return choices.number(SMALLEST, 1.0), *random_triple(choices, planar=False)


def random_magnitude(choices: Choices, low: float, high: float) -> float:
    """Return 10 to a uniform power in [low, high]: all magnitudes are equally likely."""
    return 10.0 ** choices.number(low, high)


def random_link(choices: Choices, name: str, planar: bool) -> Link:
    """Return a link with the inertia of a homogeneous block in a random orientation."""
    mass, center = random_magnitude(choices, -1.0, 1.0), random_point(choices, planar)
    x, y, z = (random_magnitude(choices, -2.0, 0.0) for _ in range(3))
    moments = mass * np.array([y + z, x + z, x + y])
    if planar:
        a, b, c = moments.tolist()
        return Link(name, mass, center, (a, b, c))
    R = rotation_matrix(random_orientation(choices))
    return Link.with_inertia(name, mass, center, R * moments @ R.T)


# ---- A description as data -----------------------------------------------------------------------

GROUND = "ground"

IMPORTED = (
    "from eomcheck.descriptions.build import mechanism\n"
    "from eomcheck.descriptions.elements import Constraint, Joint, Link"
)
"""Imports of a description's Python code."""


class RandomDescription(NamedTuple):
    """Arguments of `mechanism`, chosen at random."""

    links: tuple[Link, ...]
    """Links, the ground first."""
    joints: tuple[Joint, ...]
    """Joints, each after the joints that carry it."""
    constraints: tuple[Constraint, ...] = ()
    gravity: Triple | None = None
    dependent: tuple[str, ...] = ()
    pose: tuple[tuple[str, float], ...] = ()
    """Coordinates q at t = 0, by name."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, in the order of the joints."""
        own = (joint for joint in self.joints if joint.mimics is None)
        return tuple(joint.name + part for joint in own for part in COORDINATES[joint.kind])

    def source(self, name: str) -> MechanismSource:
        """Return the source of the described scene class.

        Raises:
            InputError: see `mechanism`.
        """
        made = mechanism_source(
            *(name, self.links, self.joints, self.constraints),
            gravity=self.gravity,
            dependent=self.dependent,
            pose=dict(self.pose),
        )
        return made._replace(code=self.code(name), imports=IMPORTED, module=__name__)

    def code(self, name: str) -> str:
        """Return Python code that constructs the scene."""
        return (
            f"mechanism({name!r}, {list(self.links)!r}, {list(self.joints)!r}, "
            f"{list(self.constraints)!r}, gravity={self.gravity!r}, dependent={self.dependent!r}, "
            f"pose={dict(self.pose)!r})()"
        )


# ---- Poses of links ------------------------------------------------------------------------------


class Pose(NamedTuple):
    """Position and orientation of a link."""

    orientation: Quaternion
    origin: Array
    """Origin (3,), m."""

    def point(self, at: Any) -> Array:
        """Return a point of the link in ground axes."""
        return self.origin + self.direction(at)

    def direction(self, along: Any) -> Array:
        """Return a direction of the link in ground axes."""
        return rotation_matrix(self.orientation) @ np.asarray(along, np.float64)

    def local_point(self, at: Array) -> Triple:
        """Return a point of the ground in the frame of the link."""
        return self.local_direction(at - self.origin)

    def local_direction(self, along: Array) -> Triple:
        """Return a direction of the ground in the frame of the link."""
        x, y, z = (rotation_matrix(self.orientation).T @ along).tolist()
        return x, y, z


def poses(description: RandomDescription) -> dict[str, Pose]:
    """Return the poses of all links, computed from the elements of a description alone."""
    q, found = dict(description.pose), {GROUND: Pose(IDENTITY, np.zeros(3))}
    by_name = {joint.name: joint for joint in description.joints}
    for joint in description.joints:
        before = found[joint.parent]
        seat = Pose(
            multiply_quaternions(before.orientation, joint.orientation), before.point(joint.origin)
        )
        turn, moved = _joint_displacement(joint, _coordinates(joint, by_name, q))
        found[joint.child] = Pose(multiply_quaternions(seat.orientation, turn), seat.point(moved))
    return found


def _coordinates(joint: Joint, by_name: dict[str, Joint], q: dict[str, float]) -> list[float]:
    if joint.mimics is None:
        return [q.get(joint.name + part, 0.0) for part in COORDINATES[joint.kind]]
    leader, ratio, shift = joint.mimics
    return [ratio * x + shift for x in _coordinates(by_name[leader], by_name, q)]


def _joint_displacement(joint: Joint, x: list[float]) -> tuple[Quaternion, Array]:
    """Return rotation and displacement of a joint's child, against coordinate 0."""
    axis, still = np.asarray(joint.axis), np.zeros(3)
    if joint.kind == "prismatic":
        return IDENTITY, x[0] * axis / np.linalg.norm(axis)
    if joint.kind == "revolute":
        return _about_z(z_to_axis(joint.axis), x[0]), still
    if joint.kind == "planar":
        tilt = z_to_axis(joint.axis)
        return _about_z(tilt, x[2]), rotation_matrix(tilt) @ [x[0], x[1], 0.0]
    if joint.kind in ("spherical", "floating"):
        yaw, pitch, roll = (
            axis_rotation(axis, x[place - 3]) for axis, place in ((2, 0), (1, 1), (0, 2))
        )
        slid = np.array(x[:3]) if joint.kind == "floating" else still
        return multiply_quaternions(multiply_quaternions(yaw, pitch), roll), slid
    return IDENTITY, still


def _about_z(tilt: Quaternion, angle: float) -> Quaternion:
    """Return the rotation about z of a tilted frame."""
    w, x, y, z = tilt
    return multiply_quaternions(
        multiply_quaternions(tilt, axis_rotation(2, angle)), (w, -x, -y, -z)
    )
