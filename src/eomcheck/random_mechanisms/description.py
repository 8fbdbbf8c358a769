"""A description as data, where its links are in a pose, and the Python that writes it down."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.build import described
from eomcheck.mechanics.described.mechanism import Made
from eomcheck.mechanics.described.quaternions import (
    ONE,
    Quaternion,
    about,
    multiplied,
    rotation,
    to_z,
)
from eomcheck.mechanics.described.words import COORDINATES, Constraint, Joint, Link, Triple
from eomcheck.numbers.generic import Array

GROUND = "ground"

IMPORTED = (
    "from eomcheck.mechanics.described.build import mechanism\n"
    "from eomcheck.mechanics.described.words import Constraint, Joint, Link"
)
"""What the Python of a description imports."""


class Description(NamedTuple):
    """What `mechanism` is handed."""

    links: tuple[Link, ...]
    """The ground first."""
    joints: tuple[Joint, ...]
    """Each after the joints that carry it."""
    constraints: tuple[Constraint, ...] = ()
    gravity: Triple | None = None
    first: tuple[str, ...] = ()
    pose: tuple[tuple[str, float], ...] = ()
    """q at t = 0, by name."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates, in the order of the joints."""
        own = (joint for joint in self.joints if joint.follows is None)
        return tuple(joint.name + part for joint in own for part in COORDINATES[joint.kind])

    def made(self, name: str) -> Made:
        """Return what the kind that it describes is made of.

        Raises:
            InputError: see `mechanism`.
        """
        made = described(
            *(name, self.links, self.joints, self.constraints),
            gravity=self.gravity,
            first=self.first,
            pose=dict(self.pose),
        )
        return made._replace(code=self.code(name), imported=IMPORTED, module=__name__)

    def code(self, name: str) -> str:
        """Return Python that makes the scene."""
        return (
            f"mechanism({name!r}, {list(self.links)!r}, {list(self.joints)!r}, "
            f"{list(self.constraints)!r}, gravity={self.gravity!r}, first={self.first!r}, "
            f"pose={dict(self.pose)!r})()"
        )


# ---- Where links are -----------------------------------------------------------------------------


class Pose(NamedTuple):
    """Where a link is."""

    turn: Quaternion
    origin: Array
    """(3,), m."""

    def point(self, at: Any) -> Array:
        """Return a point of the link, seen from the ground."""
        return self.origin + self.direction(at)

    def direction(self, along: Any) -> Array:
        """Return a direction of the link, seen from the ground."""
        return rotation(self.turn) @ np.asarray(along, np.float64)

    def own_point(self, at: Array) -> Triple:
        """Return a point of the ground as the link sees it."""
        return self.own_direction(at - self.origin)

    def own_direction(self, along: Array) -> Triple:
        """Return a direction of the ground as the link sees it."""
        x, y, z = (rotation(self.turn).T @ along).tolist()
        return x, y, z


def poses(description: Description) -> dict[str, Pose]:
    """Return where all links are in the pose of a description, from its words alone."""
    q, found = dict(description.pose), {GROUND: Pose(ONE, np.zeros(3))}
    by_name = {joint.name: joint for joint in description.joints}
    for joint in description.joints:
        before = found[joint.parent]
        seat = Pose(multiplied(before.turn, joint.turn), before.point(joint.place))
        turn, moved = _moved(joint, _coordinates(joint, by_name, q))
        found[joint.child] = Pose(multiplied(seat.turn, turn), seat.point(moved))
    return found


def _coordinates(joint: Joint, by_name: dict[str, Joint], q: dict[str, float]) -> list[float]:
    if joint.follows is None:
        return [q.get(joint.name + part, 0.0) for part in COORDINATES[joint.kind]]
    leader, ratio, shift = joint.follows
    return [ratio * x + shift for x in _coordinates(by_name[leader], by_name, q)]


def _moved(joint: Joint, x: list[float]) -> tuple[Quaternion, Array]:
    """Return how a joint turns and displaces its child, in the frame of its seat."""
    axis, still = np.asarray(joint.axis), np.zeros(3)
    if joint.kind == "prismatic":
        return ONE, x[0] * axis / np.linalg.norm(axis)
    if joint.kind == "revolute":
        return _about_z(to_z(joint.axis), x[0]), still
    if joint.kind == "planar":
        tilt = to_z(joint.axis)
        return _about_z(tilt, x[2]), rotation(tilt) @ [x[0], x[1], 0.0]
    if joint.kind in ("spherical", "floating"):
        yaw, pitch, roll = (about(axis, x[place - 3]) for axis, place in ((2, 0), (1, 1), (0, 2)))
        slid = np.array(x[:3]) if joint.kind == "floating" else still
        return multiplied(multiplied(yaw, pitch), roll), slid
    return ONE, still


def _about_z(tilt: Quaternion, angle: float) -> Quaternion:
    """Return the turn about z of a frame that is tilted."""
    w, x, y, z = tilt
    return multiplied(multiplied(tilt, about(2, angle)), (w, -x, -y, -z))
