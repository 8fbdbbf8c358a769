"""From a description to the kind of scene that it describes."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.described.closures import KINDS
from eomcheck.mechanics.described.mechanism import Made, Mechanism
from eomcheck.mechanics.described.quaternions import (
    ONE,
    Quaternion,
    multiplied,
    rotation,
    to_z,
    turns,
)
from eomcheck.mechanics.described.topology import Closure, Slot, Topology
from eomcheck.mechanics.described.words import COORDINATES, Constraint, Joint, Link, Triple
from eomcheck.mechanics.tree import PLANAR
from eomcheck.numbers.contract import Array
from eomcheck.numbers.float64 import FLOAT64

MOST = 200
"""Coordinates that a description may have: identities of more are not proved in reasonable time."""

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


class Rigid(NamedTuple):
    """A body in the frame of its slot."""

    mass: float
    center: Array
    inertia: Array
    """About its centre of mass (3, 3), kg m²."""


def together(bodies: list[Rigid]) -> Rigid:
    """Return several bodies that are fixed to each other as one."""
    if len(bodies) == 1:
        return bodies[0]
    mass = sum(one.mass for one in bodies)
    center = sum(one.mass * one.center for one in bodies) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for one in bodies:
        away = one.center - center
        inertia += one.inertia + one.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return Rigid(mass, center, inertia)


def mechanism(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    first: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> type[Mechanism]:
    """Return the kind of scene that a description describes; its parameters are those given.

    Args:
        name: of the class; give the class this name.
        links: rigid bodies. The one that is no joint's child is the ground.
        joints: in the order of their coordinates.
        constraints: what else holds; holonomic ones come first in the scene.
        gravity: acceleration, m/s², or None.
        first: names of the coordinates that come first, those that constraints always determine.
        pose: coordinates at t = 0 that are not 0, by name.

    Raises:
        InputError: the description contradicts itself, has numbers that are none, or more than
            `MOST` coordinates.
    """
    made = described(name, links, joints, constraints, gravity=gravity, first=first, pose=pose)
    module = sys._getframe(1).f_globals.get("__name__", __name__)
    return made._replace(module=module).kind()


def described(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    first: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> Made:
    """Return what the kind of a description is made of; see `mechanism`."""
    built = _Built(tuple(links), tuple(joints), tuple(constraints))
    made = built.made(name, gravity, tuple(first), pose or {})
    _check_regular(made)
    return made


ROUNDED = 1e-12
"""Relative to the largest moment of inertia, what rounding may have made of 0."""

REGULAR = 1e-12
"""Below this reciprocal condition number of M, its diagonal scaled to 1, something has no inertia:
far below what bodies of very different size come to, far above what rounding leaves of 0."""


def _check_regular(made: Made) -> None:
    """Refuse a description in which something moves without any inertia."""
    scene, names = made.kind()(), made.topology.coordinates
    n = len(names)
    # Anywhere: where M is singular for want of inertia, it is so everywhere near.
    q = 0.3 + 0.7 * np.sin(1.0 + np.arange(n))
    given = scene.parameters(FLOAT64)
    prepared = scene.prepare(FLOAT64, given, q, 0.0)
    M = scene.terms(given, prepared, q, np.zeros(n)).M
    for name, own in zip(names, np.diagonal(M), strict=True):
        if own <= 0:
            raise InputError(f"joint {name!r} moves nothing that has inertia")
    scale = 1 / np.sqrt(np.diagonal(M))
    sizes, motions = np.linalg.eigh(M * np.outer(scale, scale))
    if sizes[0] <= REGULAR * sizes[-1]:
        worst = names[int(np.abs(motions[:, 0]).argmax())]
        raise InputError(
            f"the mass matrix is singular: joint {worst!r} can move, with others or alone, "
            "without anything that has inertia"
        )


class _Built:
    """A description while it is taken apart."""

    def __init__(
        self, links: tuple[Link, ...], joints: tuple[Joint, ...], more: tuple[Constraint, ...]
    ):
        self.links = _by_name("link", links)
        self.joints = _by_name("joint", joints)
        self.constraints = tuple(
            sorted(more, key=lambda one: not KINDS[one.kind].holonomic)  # stable
        )
        for one in (*links, *joints, *more):
            _check_finite(one)
        self.numbers: dict[str, list[Any]] = {}
        self.slots: list[Slot] = []
        self.rigid: dict[int, list[Rigid]] = {}
        self.places: dict[str, Place] = {}
        self.away: list[str] = []
        self._name_coordinates()
        self._place_links()
        if not self.coordinates:
            raise InputError("no joint of it moves: there are no coordinates")

    # ---- Joints ----------------------------------------------------------------------------------

    def _name_coordinates(self) -> None:
        self.coordinates: list[str] = []
        for joint in self.joints.values():
            if joint.kind not in COORDINATES:
                kinds = ", ".join(COORDINATES)
                said = f"joint {joint.name!r} has the kind {joint.kind!r}, expected one of: {kinds}"
                raise InputError(said)
            if joint.follows is None:
                self.coordinates += [joint.name + part for part in COORDINATES[joint.kind]]
        if len(self.coordinates) > MOST:
            raise InputError(
                f"{len(self.coordinates)} coordinates, expected at most {MOST}: what is larger is "
                "not checked in reasonable time"
            )
        self.place_of = {name: i for i, name in enumerate(self.coordinates)}

    def _place_links(self) -> None:
        hanging: dict[str, list[Joint]] = {name: [] for name in self.links}
        child_of: dict[str, str] = {}
        for joint in self.joints.values():
            for what, name in (("parent", joint.parent), ("child", joint.child)):
                if name not in self.links:
                    raise InputError(f"joint {joint.name!r} has the {what} {name!r}, no such link")
            if joint.child in child_of:
                both = f"{child_of[joint.child]!r} and {joint.name!r}"
                raise InputError(f"link {joint.child!r} is the child of two joints, {both}")
            child_of[joint.child] = joint.name
            hanging[joint.parent].append(joint)
        roots = [name for name in self.links if name not in child_of]
        if len(roots) > 1:
            said = ", ".join(map(repr, roots[:3])) + (", ..." if len(roots) > 3 else "")
            raise InputError(f"{len(roots)} links are no joint's child ({said}), expected one root")
        if not roots:
            raise InputError(f"every link is a joint's child: {self._cycle(child_of)}")
        self.root = roots[0]
        self.places[self.root] = Place(-1, ONE, np.zeros(3))
        # Depth first: what hangs on a joint follows it before anything else does.
        waiting = deque(hanging[self.root])
        while waiting:
            joint = waiting.popleft()
            self._hang(joint)
            waiting.extendleft(reversed(hanging[joint.child]))
        if len(self.places) < len(self.links):
            raise InputError(f"links go round in a circle: {self._cycle(child_of)}")

    def _cycle(self, child_of: dict[str, str]) -> str:
        at, seen = next(name for name in self.links if name not in self.places), []
        while at not in seen:
            seen.append(at)
            at = self.joints[child_of[at]].parent
        return " <- ".join(repr(name) for name in (*seen[seen.index(at) :][:4], at))

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
        self._load(self.links[joint.child])

    def _axis(self, joint: Joint) -> tuple[str, int, Quaternion]:
        if joint.kind in ("spherical", "floating"):
            return "z", 1, ONE
        if not any(joint.axis):
            raise InputError(f"joint {joint.name!r} has the axis (0, 0, 0)")
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
        if joint.kind in ("spherical", "floating"):
            self.away.append(joint.name + "_pitch")
        for place, (kind, name) in enumerate(zip(kinds, names, strict=True)):
            last = len(self.slots)
            self.slots.append(
                Slot(
                    parent if place == 0 else last - 1,
                    kind if len(kind) == 2 else kind + axis,
                    *self._coordinate(joint, name, sense),
                    turn=self._number("orientation", turn) if place == 0 and turns(turn) else None,
                    offset=self._number("offset", tuple(offset.tolist())) if place == 0 else None,
                    damper=self._number("damping", joint.damping),
                    spring=self._spring(joint),
                    rotor=self._number("armature", joint.armature),
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
        follows = self._number("ratio", ratio)
        self._number("shift", shift)
        return self.place_of[at.name], sense, follows

    def _spring(self, joint: Joint) -> int | None:
        if joint.stiffness is None:
            return None
        self._number("relaxed", joint.relaxed)
        return self._number("stiffness", joint.stiffness)

    def _number(self, name: str, value: Any) -> int | None:
        """Keep a parameter and return its place; None where there is none."""
        if value is None:
            return None
        kept = self.numbers.setdefault(name, [])
        kept.append(value)
        return len(kept) - 1

    # ---- Bodies ----------------------------------------------------------------------------------

    def _load(self, link: Link) -> None:
        """Add a link to what is fixed to its slot."""
        slot, turn, offset = self.places[link.name]
        if link.mass < 0:
            said = f"mass = {link.mass} kg, expected a number that is not negative"
            raise InputError(f"link {link.name!r}: {said}")
        if slot < 0 or not any((link.mass, *link.moments, *link.products)):
            return
        R, (xy, xz, yz) = rotation(turn), link.products
        inertia = np.diag(link.moments) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
        body = Rigid(link.mass, offset + R @ np.array(link.center), R @ inertia @ R.T)
        self.rigid.setdefault(slot, []).append(body)

    # ---- Constraints -----------------------------------------------------------------------------

    def _closures(self, planar: bool) -> tuple[Closure, ...]:
        return tuple(self._closure(one, planar) for one in self.constraints)

    def _closure(self, one: Constraint, planar: bool) -> Closure:
        d = 2 if planar else 3
        if one.kind == "hinge" and planar:
            raise InputError(f"constraint {one.name!r}: in the plane a hinge is a pin")
        directions = one.directions[:1] if one.kind == "weld" and planar else one.directions
        points = []
        for link, at in one.points:
            place = self._link(one, link)
            there = place.offset + rotation(place.turn) @ np.array(at)
            points.append((place.slot, self._number("points", tuple(there[:d].tolist()))))
        turned = []
        for link, along in directions:
            place = self._link(one, link)
            there = rotation(place.turn) @ np.array(along)
            turned.append((place.slot, self._number("directions", tuple(there[:d].tolist()))))
        kept = {"distance": "lengths", "coupling": "couplings", "drive": "drives"}.get(one.kind)
        number = None if kept is None else self._number(kept, one.numbers)
        coordinates = tuple(self._coordinate_of(one, name) for name in one.joints)
        return Closure(one.kind, one.name, tuple(points), tuple(turned), coordinates, number)

    def _link(self, one: Constraint, link: str) -> Place:
        if link not in self.places:
            raise InputError(f"constraint {one.name!r} is on the link {link!r}, no such link")
        return self.places[link]

    def _coordinate_of(self, one: Constraint, name: str) -> int:
        if name not in self.place_of:
            known = ", ".join(self.coordinates)
            raise InputError(f"constraint {one.name!r} is on {name!r}, expected one of: {known}")
        return self.place_of[name]

    # ---- All of it -------------------------------------------------------------------------------

    def made(
        self, key: str, gravity: Triple | None, first: tuple[str, ...], pose: dict[str, float]
    ) -> Made:
        """Return what the kind is made of."""
        for what, name in (*(("first", x) for x in first), *(("pose", x) for x in pose)):
            if name not in self.place_of:
                known = ", ".join(self.coordinates)
                raise InputError(f"{what} names {name!r}, expected one of: {known}")
        self._sort_coordinates(first)
        bodies = {k: together(self.rigid[k]) for k in sorted(self.rigid)}
        self._check_positive(bodies)
        planar = self._is_planar(bodies)
        d = 2 if planar else 3
        slots = tuple(
            slot._replace(body=list(bodies).index(k) if k in bodies else None)
            for k, slot in enumerate(self.slots)
        )
        for one in bodies.values():
            self._number("mass", float(one.mass))
            self._number("center", tuple(one.center[:d].tolist()))
            I = one.inertia.tolist()  # noqa: E741
            self._number("moments", I[2][2] if planar else (I[0][0], I[1][1], I[2][2]))
            self._number("products", None if planar else (I[0][1], I[0][2], I[1][2]))
        closures = self._closures(planar)
        if planar and "offset" in self.numbers:
            self.numbers["offset"] = [one[:2] for one in self.numbers["offset"]]
        defaults = {name: tuple(given) for name, given in self.numbers.items()}
        defaults["gravity"] = None if gravity is None else gravity[:d]
        closed = any(KINDS[one.kind].holonomic and one.points for one in closures)
        return Made(
            key,
            Topology(slots, tuple(self.coordinates), planar, closures),
            tuple(defaults.items()),
            tuple(float(pose.get(name, 0.0)) for name in self.coordinates),
            away=tuple(self.place_of[name] for name in self.away),
            closed=closed,
            several=tuple(
                joint.name + part
                for joint in self.joints.values()
                if len(COORDINATES[joint.kind]) > 1
                for part in COORDINATES[joint.kind]
            ),
        )

    def _sort_coordinates(self, first: tuple[str, ...]) -> None:
        rest = [name for name in self.coordinates if name not in first]
        before, self.coordinates = self.coordinates, [*first, *rest]
        self.place_of = {name: i for i, name in enumerate(self.coordinates)}
        self.slots = [
            slot._replace(coordinate=self.place_of[before[slot.coordinate]]) for slot in self.slots
        ]

    def _is_planar(self, bodies: dict[int, Rigid]) -> bool:
        """Return whether nothing leaves the plane z = 0."""
        flat = [one[2] for one in self.numbers.get("offset", [])]
        flat += [one.center[2] for one in bodies.values()]
        for constraint in self.constraints:
            flat += [at[2] for _, at in constraint.points]
        return (
            all(slot.kind in PLANAR and slot.turn is None for slot in self.slots)
            and all(place.turn[1:3] == (0, 0) for place in self.places.values())
            and not any(flat)
        )

    def _check_positive(self, bodies: dict[int, Rigid]) -> None:
        """Refuse a body whose inertia no body has, but for rounding of the largest one."""
        if not bodies and "armature" not in self.numbers:
            raise InputError("nothing that moves has inertia")
        moments = {k: np.linalg.eigvalsh(one.inertia) for k, one in bodies.items()}
        largest = max((float(np.abs(one).max()) for one in moments.values()), default=0.0)
        for k, one in moments.items():
            if one[0] < -ROUNDED * largest:
                raise InputError(
                    f"the body behind joint {self.slots[k].name!r} has the principal moment of "
                    f"inertia {one[0]:.6g} kg m², expected none below 0"
                )


def _by_name(what: str, things: tuple[Any, ...]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for one in things:
        if one.name in found:
            raise InputError(f"two {what}s have the name {one.name!r}")
        found[one.name] = one
    return found


def _check_finite(one: Any) -> None:
    """Refuse numbers in a record, or in tuples of it, that are not finite."""
    waiting = list(one)
    while waiting:
        part = waiting.pop()
        if isinstance(part, tuple | list):
            waiting += part
        elif isinstance(part, float) and not np.isfinite(part):
            raise InputError(f"{type(one).__name__.lower()} {one.name!r} has the number {part}")
