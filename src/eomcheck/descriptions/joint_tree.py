"""Tree of links and joints: ordered depth first, split into scalar joints, and its topology.

`depth_first_joints` orders the joints from the ground outwards, or refuses links that form no tree.
`JointTree` splits each joint into scalar joints, with one coordinate and the frame that it moves
each, and assigns every link to one; bodies that are fixed to each other are merged into one
`RigidBody`.

A `Topology` is the mechanism in whole numbers, without its parameters: its scalar joints, and its
constraints with frames and parameters by index. A `TopologyPlan` holds data that depend on it
alone: the scalar joints on the path to each frame, and the coordinates that move each body.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.elements import COORDINATES, Joint, Link, Triple
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    conjugate,
    is_turned,
    multiply_quaternions,
    rotation_matrix,
    z_to_axis,
)
from eomcheck.errors import InputError
from eomcheck.numbers.generic import Array

# ---- Topology ------------------------------------------------------------------------------------

ROLLING = frozenset({"touching", "rolling"})
"""Kinds of constraints of bodies that roll on a plane."""


class ScalarJoint(NamedTuple):
    """A joint with one coordinate, or one that mimics another's: the frame that it moves.

    All numbers but `sense` are indices: of scalar joints, coordinates, parameters.
    """

    parent: int
    """Index of an earlier scalar joint, or -1: the ground."""
    kind: str
    """Motion, a slide along ("p") or turn about ("r") an axis of its frame: "px" ... "rz"."""
    coordinate: int
    sense: int = 1
    """Sign of the axis, 1 or -1: along it the coordinate is so many times the joint's."""
    mimics: int | None = None
    """Index of the `ratio` and `shift` to the coordinate that it mimics; None if it is its own."""
    orientation: int | None = None
    """Index of the orientation at coordinate 0 in the parent frame; None for the identity."""
    offset: int | None = None
    """Index of the position at coordinate 0 in the parent frame; None for the origin."""
    body: int | None = None
    """Index of the body it carries; None if there is none."""
    spring: int | None = None
    gimbal_spring: int | None = None
    """Index of the spring of a gimbal; None without one."""
    damper: int | None = None
    rotor: int | None = None
    """Index of its armature; None without a rotor. The rotor of a gimbal has its angular velocity,
    and the same inertia about all axes.
    """
    absolute: bool = False
    """Whether it turns against the axes of the ground and not those of the previous frame."""
    torque: int | None = None
    """Index of a constant torque or force along its coordinate."""
    symmetric: bool = False
    """Whether its whole subtree is rotationally symmetric about its axis: the first derivation then
    does not turn its frame, the second does.
    """
    gimbal: bool = False
    """Whether it and the two before it are turns about z, y and x of one joint, whose damper and
    rotor act on their angular velocity.
    """
    name: str = ""

    @property
    def slides(self) -> bool:
        """Whether it is prismatic; otherwise it is revolute."""
        return self.kind[0] == "p"

    @property
    def axis(self) -> int:
        """Index of its axis: 0, 1 or 2."""
        return "xyz".index(self.kind[1])


class ConstraintSpec(NamedTuple):
    """A constraint by declaration; the requirements of each `kind` are in `constraint_rows`."""

    kind: str
    name: str
    points: tuple[tuple[int, int], ...] = ()
    """Frames, -1 for the ground, and indices into the `points`."""
    directions: tuple[tuple[int, int], ...] = ()
    """Frames, and indices into the `directions`."""
    coordinates: tuple[int, ...] = ()
    number: int | None = None
    """Index into the `lengths` (radii too), the `couplings`, the `drives` or the `springs`."""
    factor: int | None = None
    """Index into the `factors`, by which its rows are multiplied."""


class Topology(NamedTuple):
    """The topology that all mechanisms of a class share."""

    joints: tuple[ScalarJoint, ...]
    coordinates: tuple[str, ...]
    """Names of the coordinates."""
    planar: bool = False
    """Whether all motion stays in the plane z = 0: third components are then absent."""
    constraints: tuple[ConstraintSpec, ...] = ()
    springs: tuple[ConstraintSpec, ...] = ()
    """Springs between two points, each with an index into the `springs`."""


class RigidSegment(NamedTuple):
    """A part of the path from the ground to a point that turns as one rigid segment."""

    start: int
    """Index of the scalar joint at whose origin it starts."""
    end: int | None
    """Index of the scalar joint at whose origin it ends; None at the point."""
    arm: bool
    """Whether it is a single arm, from one origin to the next."""


class TopologyPlan:
    """Precomputed data that follow from a topology."""

    def __init__(self, topology: Topology):
        self.topology = topology
        self.joints = slots = topology.joints
        self.n = len(topology.coordinates)
        self.d, self.e = (2, 1) if topology.planar else (3, 3)
        carriers = (k for k, slot in enumerate(slots) if slot.body is not None)
        self.carriers = tuple(sorted(carriers, key=lambda k: slots[k].body or 0))
        """Scalar joints of the bodies, in their order."""
        self.rotors = tuple(k for k, slot in enumerate(slots) if slot.rotor is not None)
        self.sprung_gimbals = tuple(k for k, x in enumerate(slots) if x.gimbal_spring is not None)
        """Last turns of gimbals with a spring, in the order of `ScalarJoint.gimbal_spring`."""
        self.hinges = tuple(k for k, slot in enumerate(slots) if not slot.slides)
        self.hinge_index = {k: place for place, k in enumerate(self.hinges)}
        """Scalar joint -> index among the hinges."""
        rolling = (c for c in topology.constraints if c.kind in ROLLING)
        self.disks = tuple(dict.fromkeys(x for c in rolling if len(x := c.directions[1:]) == 2))
        """Pairs of an axis and a normal, each a frame and an index into the `directions`."""
        self.disk_index: dict[Any, int] = {pair: place for place, pair in enumerate(self.disks)}
        self.from_ground: list[tuple[int, ...]] = []
        """Scalar joints on the path from the ground to each one, itself the last."""
        for k, slot in enumerate(slots):
            before = self.from_ground[slot.parent] if slot.parent >= 0 else ()
            self.from_ground.append((*before, k))
        self.turned_by: list[tuple[int, ...]] = []
        """Scalar joints that turn the axes of each frame, itself the last."""
        for k in range(len(slots)):
            before = (
                self.turned_by[self.orientation_parent(k)]
                if self.orientation_parent(k) >= 0
                else ()
            )
            self.turned_by.append((*before, k))
        self.movers = tuple(tuple(self._movers(k)) for k in range(len(slots)))
        """Scalar joints that move a point of each frame, hinges with their `RigidSegment`s."""
        self.support = np.zeros((self.bodies, self.n), bool)
        """Mask of the coordinates that can move each body, bool (n_b, n)."""
        for b, k in enumerate(self.carriers):
            self.support[b, [slots[i].coordinate for i, _ in self.movers[k]]] = True
        for b, k in enumerate(self.rotors, len(self.carriers)):
            self.support[b, [slots[i].coordinate for i in self.rotor_joints(k)]] = True

    def rotor_joints(self, k: int) -> tuple[int, ...]:
        """Return the scalar joints that turn the rotor of k: itself, or all three of a gimbal."""
        return (k - 2, k - 1, k) if self.joints[k].gimbal else (k,)

    def orientation_parent(self, k: int) -> int:
        """Return the scalar joint against whose frame scalar joint k turns; -1 for the ground."""
        return -1 if self.joints[k].absolute else self.joints[k].parent

    def _movers(self, k: int) -> Iterator[tuple[int, tuple[RigidSegment, ...]]]:
        way = self.from_ground[k]
        # Arm 0, to the first joint, is fixed; arm j > 0 turns with joint j - 1; the last ends in
        # the point.
        turning = [set(self.turned_by[i]) for i in way]
        for i in sorted({*way, *(i for t in turning for i in t)}):
            if self.joints[i].slides:
                if i in way:
                    yield i, ()
                continue
            runs: list[RigidSegment] = []
            for j, turned in enumerate(turning):
                if i in turned:
                    end = way[j + 1] if j + 1 < len(way) else None
                    if runs and runs[-1].end == way[j]:
                        runs[-1] = RigidSegment(runs[-1].start, end, False)
                    else:
                        runs.append(RigidSegment(way[j], end, True))
            yield i, tuple(runs)

    @cached_property
    def without_constraints(self) -> TopologyPlan:
        """The plan of the bodies alone, in which every frame turns with its joint."""
        joints = tuple(slot._replace(symmetric=False) for slot in self.joints)
        alone = self.topology._replace(joints=joints, constraints=(), springs=())
        return plan_of(alone)

    @property
    def bodies(self) -> int:
        """Number of bodies, rotors among them: they come last."""
        return len(self.carriers) + len(self.rotors)

    def path_to(self, k: int) -> tuple[int, ...]:
        """Return the scalar joints between the ground and k, itself the last; none for -1."""
        return self.from_ground[k] if k >= 0 else ()


@lru_cache(256)
def plan_of(topology: Topology) -> TopologyPlan:
    """Return the plan of a topology, the same one for equal topologies."""
    return TopologyPlan(topology)


# ---- Rigid bodies --------------------------------------------------------------------------------

ROUNDED = 1e-12
"""Rounding error of an exact 0, relative to the largest moment of inertia."""


class RigidBody(NamedTuple):
    """A body in the frame of its scalar joint."""

    mass: float
    center: Array
    inertia: Array
    """Inertia about its centre of mass (3, 3), kg m²."""


def point_inertia(mass: float, r: Array) -> Array:
    """Return the moment of inertia (3, 3) of a mass at r (3,) about the origin, kg m²."""
    return mass * (r @ r * np.eye(3) - np.outer(r, r))


def merged_body(bodies: list[RigidBody]) -> RigidBody:
    """Return one body merged from several that are fixed to each other."""
    if len(bodies) == 1:
        return bodies[0]
    mass = sum(body.mass for body in bodies)
    center, inertia = np.zeros(3), np.zeros((3, 3))
    for body in bodies:
        center += body.mass / (mass or 1.0) * body.center
    for body in bodies:
        inertia += body.inertia + point_inertia(body.mass, body.center - center)
    return RigidBody(mass, center, inertia)


def is_tilted(body: RigidBody) -> bool:
    """Return whether a body that turns about z has momentum about x or y."""
    return bool(body.inertia[2, :2].any())


def rigid_body_of(link: Link, turn: Quaternion, offset: Array) -> RigidBody | None:
    """Return a link's body in the frame of its scalar joint; None without inertia."""
    if not link.has_inertia:
        return None
    R = rotation_matrix(turn)
    return RigidBody(link.mass, offset + R @ np.array(link.center), R @ link.inertia @ R.T)


def check_positive(bodies: dict[str, RigidBody]) -> None:
    """Check that no moment of inertia is negative, but for rounding of the largest one.

    Args:
        bodies: name of the joint that carries it -> body.

    Raises:
        InputError: one is.
    """
    moments = {name: np.linalg.eigvalsh(body.inertia) for name, body in bodies.items()}
    largest = max((float(np.abs(p).max()) for p in moments.values()), default=0.0)
    for name, principal in moments.items():
        if principal[0] < -ROUNDED * largest:
            raise InputError(
                f"the body behind joint {name!r} has the principal moment of inertia "
                f"{principal[0]:.6g} kg m², expected none below 0"
            )


# ---- Order of joints -----------------------------------------------------------------------------


def depth_first_joints(links: dict[str, Link], joints: dict[str, Joint]) -> tuple[str, list[Joint]]:
    """Return the ground link, and the joints from it outwards in depth-first order.

    The subtree of a joint follows it immediately.

    Raises:
        InputError: they form no tree.
    """
    children: dict[str, list[Joint]] = {name: [] for name in links}
    child_of: dict[str, str] = {}
    for joint in joints.values():
        for what, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                raise InputError(f"joint {joint.name!r} has the {what} {name!r}, no such link")
        if joint.child in child_of:
            both = f"{child_of[joint.child]!r} and {joint.name!r}"
            raise InputError(f"link {joint.child!r} is the child of two joints, {both}")
        child_of[joint.child] = joint.name
        children[joint.parent].append(joint)
    roots = [name for name in links if name not in child_of]
    if len(roots) > 1:
        named = ", ".join(map(repr, roots[:3])) + (", ..." if len(roots) > 3 else "")
        raise InputError(f"{len(roots)} links are no joint's child ({named}), expected one root")
    if not links:
        raise InputError("there is no link")
    if not roots:
        around = _cycle(next(iter(links)), joints, child_of)
        raise InputError(f"every link is a joint's child: {around}")
    ordered, waiting = [], deque(children[roots[0]])
    while waiting:
        joint = waiting.popleft()
        ordered.append(joint)
        waiting.extendleft(reversed(children[joint.child]))
    if len(ordered) < len(joints):
        reached = {roots[0], *(joint.child for joint in ordered)}
        unreached = next(name for name in links if name not in reached)
        raise InputError(f"links go round in a circle: {_cycle(unreached, joints, child_of)}")
    return roots[0], ordered


def _cycle(link: str, joints: dict[str, Joint], child_of: dict[str, str]) -> str:
    """Return the names of links that form a cycle, at most five of them."""
    visited: dict[str, None] = {}
    while link not in visited:
        visited[link] = None
        link = joints[child_of[link]].parent
    around = list(visited)
    around = around[around.index(link) :]
    named = " <- ".join(map(repr, around[:4]))
    return named + (" <- ..." if len(around) > 4 else f" <- {link!r}")


def triple_at_rest(joint: Joint) -> Triple:
    """Return the origin at which the spring of a floating joint is relaxed, m."""
    rest = joint.rest_position
    return rest if isinstance(rest, tuple) else (rest, rest, rest)


def by_name(what: str, things: tuple[Any, ...]) -> dict[str, Any]:
    """Return links or joints by their names.

    Raises:
        InputError: two have the same.
    """
    named: dict[str, Any] = {}
    for element in things:
        if element.name in named:
            raise InputError(f"two {what}s have the name {element.name!r}")
        named[element.name] = element
    return named


# ---- Scalar joints -------------------------------------------------------------------------------

MAX_DESCRIBED_COORDINATES = 200
"""Largest number of coordinates of a description: identities of more are not proved in reasonable
time.
"""


def check_coordinates(coordinates: int) -> None:
    """Check the number of coordinates of a description.

    Raises:
        InputError: more than `MAX_DESCRIBED_COORDINATES`.
    """
    if coordinates > MAX_DESCRIBED_COORDINATES:
        raise InputError(
            f"{coordinates} coordinates, expected at most {MAX_DESCRIBED_COORDINATES}: "
            "what is larger is "
            "not checked in reasonable time"
        )


SCALAR_KINDS = {
    "revolute": ("r",),
    "prismatic": ("p",),
    "planar": ("px", "py", "rz"),
    "spherical": ("rz", "ry", "rx"),
    "floating": ("px", "py", "pz", "rz", "ry", "rx"),
}

GIMBAL = "rz", "ry", "rx"
"""Last scalar joints of a joint that turns about any axis."""

STRAIGHT = {(1.0, 0.0, 0.0): "x", (0.0, 1.0, 0.0): "y", (0.0, 0.0, 1.0): "z"}


class LinkFrame(NamedTuple):
    """Frame of a link: offset and orientation on its scalar joint (-1: the ground)."""

    joint: int
    orientation: Quaternion
    offset: Array


class ElementReader:
    """A reader of elements: their scalar joints, and their numbers by index."""

    def __init__(self) -> None:
        self.scalar_joints: list[ScalarJoint] = []
        self.numbers: dict[str, list[Any]] = {}
        """Name of a parameter -> its entries, by index."""
        self._index: dict[tuple[str, Any], int] = {}

    def add_parameter(self, name: str, entry: Any, key: Any = None) -> int | None:
        """Return the index of an entry, appended unless one has the key; None for an absent one."""
        if entry is None:
            return None
        if key is not None and (name, key) in self._index:
            return self._index[name, key]
        entries = self.numbers.setdefault(name, [])
        entries.append(entry)
        if key is not None:
            self._index[name, key] = len(entries) - 1
        return len(entries) - 1

    def add_joint(
        self,
        joint: Joint,
        parent: int,
        axis: str,
        seat: dict[str, Any],
        fields: Callable[[str], dict[str, Any]],
    ) -> int:
        """Add the scalar joints of a joint and return the index of the last one.

        Args:
            joint: the joint.
            parent: index of the scalar joint that carries it.
            axis: "x", "y" or "z", of a joint with one coordinate.
            seat: fields of its first scalar joint.
            fields: other fields of a scalar joint, by the name of its coordinate.
        """
        kinds, parts = SCALAR_KINDS[joint.kind], COORDINATES[joint.kind]
        for kind, part in zip(kinds, parts, strict=True):
            name, kind = joint.name + part, kind if len(kind) == 2 else kind + axis
            slot = ScalarJoint(parent, kind, name=name, **fields(name), **seat)
            self.scalar_joints.append(slot)
            parent, seat = len(self.scalar_joints) - 1, {}
        return parent


class JointTree(ElementReader):
    """The scalar joints of a tree of links, and their numbers by index.

    Raises:
        InputError: links and joints form no tree, or a joint contradicts itself.
    """

    def __init__(self, links: tuple[Link, ...], joints: tuple[Joint, ...]):
        super().__init__()
        self.links, self.joints = by_name("link", links), by_name("joint", joints)
        self.coordinates = self._coordinates()
        self.coordinate_index = {name: i for i, name in enumerate(self.coordinates)}
        self.bodies: dict[int, list[RigidBody]] = {}
        """Scalar joint -> bodies fixed to it."""
        root, order = depth_first_joints(self.links, self.joints)
        self.link_frames = {root: LinkFrame(-1, IDENTITY, np.zeros(3))}
        """Name of a link -> its frame."""
        for joint in order:
            self._attach(joint)
        if not self.coordinates:
            raise InputError("no joint of it moves: there are no coordinates")

    def _coordinates(self) -> list[str]:
        names: list[str] = []
        for joint in self.joints.values():
            if joint.kind not in COORDINATES:
                kinds = ", ".join(COORDINATES)
                message = (
                    f"joint {joint.name!r} has the kind {joint.kind!r}, expected one of: {kinds}"
                )
                raise InputError(message)
            if joint.mimics is None:
                names += [joint.name + part for part in COORDINATES[joint.kind]]
        check_coordinates(len(names))
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"two coordinates have the name {name!r}")
        return names

    def _attach(self, joint: Joint) -> None:
        """Attach the child of a joint, on new scalar joints if it moves."""
        before = self.link_frames[joint.parent]
        turn = multiply_quaternions(before.orientation, joint.orientation)
        offset = before.offset + rotation_matrix(before.orientation) @ np.array(joint.origin)
        if joint.kind == "fixed":
            self.link_frames[joint.child] = LinkFrame(before.joint, turn, offset)
        else:
            # The axis is x, y or z of the scalar joint's frame, if necessary the z of a tilted one.
            axis, sense, tilt = self._axis(joint)
            turn = multiply_quaternions(turn, tilt)
            last = self._add_moving(joint, before.joint, turn, offset, axis, sense)
            self.link_frames[joint.child] = LinkFrame(last, conjugate(tilt), np.zeros(3))
        slot, turn, offset = self.link_frames[joint.child]
        if (body := rigid_body_of(self.links[joint.child], turn, offset)) is not None and slot >= 0:
            self.bodies.setdefault(slot, []).append(body)

    def _axis(self, joint: Joint) -> tuple[str, int, Quaternion]:
        if joint.kind in ("spherical", "floating"):
            return "z", 1, IDENTITY
        x, y, z = joint.axis
        if joint.kind != "planar":
            for sense in (1, -1):
                if (axis_name := STRAIGHT.get((sense * x, sense * y, sense * z))) is not None:
                    return axis_name, sense, IDENTITY
        return "z", 1, z_to_axis(joint.axis)

    def _add_moving(
        self, joint: Joint, parent: int, turn: Quaternion, offset: Array, axis: str, sense: int
    ) -> int:
        kinds = SCALAR_KINDS[joint.kind]
        if len(kinds) > 1 and joint.mimics is not None:
            raise InputError(
                f"joint {joint.name!r} is {joint.kind}: a joint that it follows is for joints with "
                "one coordinate"
            )
        if joint.kind == "planar" and joint.stiffness is not None:
            raise InputError(
                f"joint {joint.name!r} is planar: stiffness is for joints of other kinds"
            )
        turns = COORDINATES[joint.kind][-3:] if kinds[-3:] == GIMBAL else ()
        gimbal = [joint.name + part for part in turns]
        seat = {
            "orientation": self.add_parameter("orientation", turn if is_turned(turn) else None),
            "offset": self.add_parameter("offset", tuple(offset.tolist())),
        }

        def fields(name: str) -> dict[str, Any]:
            coordinate, mimics = self._coordinate(joint, name)
            return {
                "coordinate": coordinate,
                "sense": sense,
                "mimics": mimics,
                "damper": self.add_parameter("damping", joint.damping, joint.name),
                "gimbal": name in gimbal[-1:],
                "spring": None if name in gimbal else self._spring(joint, name),
                "gimbal_spring": self._gimbal_spring(joint) if name in gimbal[-1:] else None,
                "rotor": self.add_parameter(
                    "armature", None if name in gimbal[:-1] else joint.armature
                ),
            }

        return self.add_joint(joint, parent, axis, seat, fields)

    def _coordinate(self, joint: Joint, name: str) -> tuple[int, int | None]:
        """Return the index of a coordinate, and that of the ratio to it of a joint that mimics."""
        if joint.mimics is None:
            return self.coordinate_index[name], None
        visited, ratio, shift, node = {joint.name}, 1.0, 0.0, joint
        while node.mimics is not None:
            leader, factor, more = node.mimics
            ratio, shift = ratio * factor, shift + ratio * more
            if leader not in self.joints:
                raise InputError(f"joint {node.name!r} follows {leader!r}, no such joint")
            if leader in visited:
                raise InputError(f"joint {joint.name!r} follows itself, by way of {node.name!r}")
            visited.add(leader)
            node = self.joints[leader]
        if len(COORDINATES[node.kind]) != 1:
            raise InputError(f"joint {joint.name!r} follows {node.name!r}, which is {node.kind}")
        follows = self.add_parameter("ratio", ratio)
        self.add_parameter("shift", shift)
        return self.coordinate_index[node.name], follows

    def _spring(self, joint: Joint, name: str) -> int | None:
        if joint.stiffness is None:
            return None
        rest = joint.rest_position
        if joint.kind == "floating":
            rest = triple_at_rest(joint)[COORDINATES["floating"].index(name[len(joint.name) :])]
        self.add_parameter("relaxed", rest)
        return self.add_parameter("stiffness", joint.stiffness)

    def _gimbal_spring(self, joint: Joint) -> int | None:
        if joint.stiffness is None:
            return None
        self.add_parameter("rest_orientation", tuple(map(float, joint.rest_orientation)))
        return self.add_parameter("gimbal_stiffness", joint.stiffness)
