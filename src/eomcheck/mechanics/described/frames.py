"""Where links are: joints taken apart into slots with one coordinate each."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.described.bodies import Rigid, rigid
from eomcheck.mechanics.described.hanging import by_name, hanging
from eomcheck.mechanics.described.quaternions import (
    ONE,
    Quaternion,
    multiplied,
    rotation,
    to_z,
    turns,
)
from eomcheck.mechanics.described.topology import Slot
from eomcheck.mechanics.described.words import COORDINATES, Joint, Link
from eomcheck.numbers.generic import Array

MOST = 200
"""Coordinates that a description may have: identities of more are not proved in reasonable time."""


def check_coordinates(coordinates: int) -> None:
    """Check that a description has no more coordinates than `MOST`.

    Raises:
        InputError: it has.
    """
    if coordinates > MOST:
        raise InputError(
            f"{coordinates} coordinates, expected at most {MOST}: what is larger is "
            "not checked in reasonable time"
        )


PRIMITIVE = {
    "revolute": ("r",),
    "prismatic": ("p",),
    "planar": ("px", "py", "rz"),
    "spherical": ("rz", "ry", "rx"),
    "floating": ("px", "py", "pz", "rz", "ry", "rx"),
}

STRAIGHT = {(1.0, 0.0, 0.0): "x", (0.0, 1.0, 0.0): "y", (0.0, 0.0, 1.0): "z"}


class Place(NamedTuple):
    """Where a link is: on a slot (-1: the ground), displaced and turned."""

    slot: int
    turn: Quaternion
    offset: Array


class Frames:
    """The slots of a tree of links, and the numbers that they are at.

    Raises:
        InputError: links and joints are no tree, or a joint contradicts itself.
    """

    def __init__(self, links: tuple[Link, ...], joints: tuple[Joint, ...]):
        self.links, self.joints = by_name("link", links), by_name("joint", joints)
        self.coordinates = self._coordinates()
        self.place_of = {name: i for i, name in enumerate(self.coordinates)}
        self.numbers: dict[str, list[Any]] = {}
        """Name of a parameter -> what there is of it, by place."""
        self._places: dict[Any, int | None] = {}
        self.slots: list[Slot] = []
        self.rigid: dict[int, list[Rigid]] = {}
        """Slot -> what is fixed to it."""
        root, order = hanging(self.links, self.joints)
        self.places = {root: Place(-1, ONE, np.zeros(3))}
        """Name of a link -> where it is."""
        for joint in order:
            self._hang(joint)
        if not self.coordinates:
            raise InputError("no joint of it moves: there are no coordinates")

    def number(self, name: str, value: Any) -> int | None:
        """Keep a parameter and return its place; None where there is none."""
        if value is None:
            return None
        kept = self.numbers.setdefault(name, [])
        kept.append(value)
        return len(kept) - 1

    def shared(self, name: str, value: Any) -> int | None:
        """Keep a parameter, once for all that share it, and return its place."""
        if (name, value) not in self._places:
            self._places[name, value] = self.number(name, value)
        return self._places[name, value]

    def _coordinates(self) -> list[str]:
        found: list[str] = []
        for joint in self.joints.values():
            if joint.kind not in COORDINATES:
                kinds = ", ".join(COORDINATES)
                said = f"joint {joint.name!r} has the kind {joint.kind!r}, expected one of: {kinds}"
                raise InputError(said)
            if joint.follows is None:
                found += [joint.name + part for part in COORDINATES[joint.kind]]
        check_coordinates(len(found))
        for name in found:
            if found.count(name) > 1:
                raise InputError(f"two coordinates have the name {name!r}")
        return found

    def _hang(self, joint: Joint) -> None:
        """Place the child of a joint, on slots of its own where it moves."""
        before = self.places[joint.parent]
        turn = multiplied(before.turn, joint.turn)
        offset = before.offset + rotation(before.turn) @ np.array(joint.place)
        if joint.kind == "fixed":
            self.places[joint.child] = Place(before.slot, turn, offset)
        else:
            # The frame of the slots has the axis along x, y or z, if need be a turned one's z.
            axis, sense, tilt = self._axis(joint)
            turn = multiplied(turn, tilt)
            self._add_slots(joint, before.slot, turn, offset, axis, sense)
            back = tilt[0], -tilt[1], -tilt[2], -tilt[3]
            self.places[joint.child] = Place(len(self.slots) - 1, back, np.zeros(3))
        slot, turn, offset = self.places[joint.child]
        if (body := rigid(self.links[joint.child], turn, offset)) is not None and slot >= 0:
            self.rigid.setdefault(slot, []).append(body)

    def _axis(self, joint: Joint) -> tuple[str, int, Quaternion]:
        if joint.kind in ("spherical", "floating"):
            return "z", 1, ONE
        x, y, z = joint.axis
        if joint.kind != "planar":
            for sense in (1, -1):
                if (found := STRAIGHT.get((sense * x, sense * y, sense * z))) is not None:
                    return found, sense, ONE
        return "z", 1, to_z(joint.axis)

    def _add_slots(
        self, joint: Joint, parent: int, turn: Quaternion, offset: Array, axis: str, sense: int
    ) -> None:
        kinds = PRIMITIVE[joint.kind]
        names = [joint.name + part for part in COORDINATES[joint.kind]]
        forces = joint.damping, joint.stiffness, joint.armature, joint.follows
        if len(kinds) > 1 and any(one is not None for one in forces):
            raise InputError(
                f"joint {joint.name!r} is {joint.kind}: damping, stiffness, armature and a joint "
                "that it follows are for joints with one coordinate"
            )
        for place, (kind, name) in enumerate(zip(kinds, names, strict=True)):
            last = len(self.slots)
            self.slots.append(
                Slot(
                    parent if place == 0 else last - 1,
                    kind if len(kind) == 2 else kind + axis,
                    *self._coordinate(joint, name, sense),
                    turn=self.number("orientation", turn) if place == 0 and turns(turn) else None,
                    offset=self.number("offset", tuple(offset.tolist())) if place == 0 else None,
                    damper=self.number("damping", joint.damping),
                    spring=self._spring(joint),
                    rotor=self.number("armature", joint.armature),
                    name=name,
                )
            )

    def _coordinate(self, joint: Joint, name: str, sense: int) -> tuple[int, int, int | None]:
        if joint.follows is None:
            return self.place_of[name], sense, None
        seen, ratio, shift, at = {joint.name}, 1.0, 0.0, joint
        while at.follows is not None:
            other, factor, more = at.follows
            ratio, shift = ratio * factor, shift + ratio * more
            if other not in self.joints:
                raise InputError(f"joint {at.name!r} follows {other!r}, no such joint")
            if other in seen:
                raise InputError(f"joint {joint.name!r} follows itself, by way of {at.name!r}")
            seen.add(other)
            at = self.joints[other]
        if len(COORDINATES[at.kind]) != 1:
            raise InputError(f"joint {joint.name!r} follows {at.name!r}, which is {at.kind}")
        follows = self.number("ratio", ratio)
        self.number("shift", shift)
        return self.place_of[at.name], sense, follows

    def _spring(self, joint: Joint) -> int | None:
        if joint.stiffness is None:
            return None
        self.number("relaxed", joint.relaxed)
        return self.number("stiffness", joint.stiffness)
