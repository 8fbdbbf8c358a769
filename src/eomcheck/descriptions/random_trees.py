"""Random trees of rigid bodies: their elements, their properties, a tree with required properties.

Simple numbers come first, so that hypothesis shrinks to them. A `RandomDescription` holds a tree as
data and writes the Python code of its scene (`code`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eomcheck.descriptions.build import mechanism_source
from eomcheck.descriptions.elements import COORDINATES, ORIGIN, Constraint, Joint, Link, Triple
from eomcheck.descriptions.mechanism_class import MechanismSource
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    rotation_matrix,
)
from eomcheck.mechanics.scene import Choices, Factors

# ---- Numbers and bodies --------------------------------------------------------------------------

ALONG_AXES: tuple[Triple, ...] = (
    *((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    *((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
)
"""Directions along the axes of a frame."""

IN_PLANE = tuple(axis for axis in ALONG_AXES if not axis[2])
ACROSS = tuple(axis for axis in ALONG_AXES if axis[2])

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
    across = random_direction(choices, planar=False)
    sine = np.linalg.norm(np.cross(along, across)) / np.linalg.norm(along) / np.linalg.norm(across)
    if sine >= SMALLEST:
        return across
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
        source = mechanism_source(
            *(name, self.links, self.joints, self.constraints),
            gravity=self.gravity,
            dependent=self.dependent,
            pose=dict(self.pose),
        )
        return source._replace(code=self.code(name), imports=IMPORTED, module=__name__)

    def code(self, name: str) -> str:
        """Return Python code that constructs the scene."""
        return (
            f"mechanism({name!r}, {list(self.links)!r}, {list(self.joints)!r}, "
            f"{list(self.constraints)!r}, gravity={self.gravity!r}, dependent={self.dependent!r}, "
            f"pose={dict(self.pose)!r})()"
        )


# ---- Poses of links ------------------------------------------------------------------------------


# ---- Properties of trees -------------------------------------------------------------------------

SPACE, ROOT, SHAPE, AXES, FIXED = "space", "root joint", "shape", "axes", "fixed links"
CARRIERS, FOLLOWERS = "massless carriers", "mimic joints"
SPRINGS, DAMPERS, ROTORS, GRAVITY = "springs", "dampers", "rotors", "gravity"
ABSENT, PRESENT = "absent", "present"
PLANE, SOLID = "plane", "in space"
CHAIN, BRANCHED, OBLIQUE, STRAIGHT = "chain", "branched", "oblique", "straight"

SINGLE = ("revolute", "prismatic")
"""Kinds of joints with one coordinate."""

KINDS = {
    PLANE: ("revolute", "prismatic", "planar"),
    SOLID: ("revolute", "prismatic", "planar", "spherical", "floating"),
}
"""Kinds of joints that move."""

ALL = frozenset({*KINDS[SOLID], "fixed"})
"""Kinds of joints that a tree may have."""

TURNING = ALL - {"fixed", "prismatic"}
"""Kinds of joints that turn links against each other."""

PROPERTIES = (SPRINGS, DAMPERS, ROTORS)
"""Properties that only joints with one coordinate have."""


class JointBudget(NamedTuple):
    """A budget of joints: how many there are, and of which kinds they must be."""

    space: str
    root: str
    fixed: int
    """Number of joints that must be fixed."""
    singles: int
    """Number of joints that must have one coordinate, the root among them; 2 suffice."""
    free: int
    """Number of joints of any kind."""

    @property
    def coordinates(self) -> int:
        """Number of coordinates that can always be reached, even if one joint mimics another."""
        followed = int(self.singles > 1)
        most = 3 if self.space == PLANE else 6
        return len(COORDINATES[self.root]) + self._others - followed + most * self.free

    @property
    def _others(self) -> int:
        return self.singles - int(self.root in SINGLE)


def joint_budgets(links: int, among: frozenset[str] = ALL) -> Iterator[JointBudget]:
    """Yield the joint budgets of trees with so many links, on joints of these kinds."""
    for space, kinds in KINDS.items():
        for root in (kind for kind in kinds if kind in among):
            for fixed in (0, 1) if links > 1 and "fixed" in among else (0,):
                others, own = links - 1 - fixed, int(root in SINGLE)
                needed = min(2 - own, others)
                yield JointBudget(space, root, fixed, own + needed, others - needed)


def tree_factors(room: JointBudget, links: int) -> Factors:
    """Return the factors, properties with levels, of trees of so many links with this budget."""
    either = ABSENT, PRESENT
    single, pair = ((either if room.singles >= count else (ABSENT,)) for count in (1, 2))
    some_axis = room.singles > 0 or room.root == "planar"
    return {
        SPACE: (room.space,),
        ROOT: (room.root,),
        FIXED: (PRESENT if room.fixed else ABSENT,),
        SHAPE: (CHAIN, BRANCHED) if links > 2 else (CHAIN,),
        AXES: (STRAIGHT, OBLIQUE) if room.space == SOLID and some_axis else (STRAIGHT,),
        CARRIERS: pair,
        FOLLOWERS: pair,
        **dict.fromkeys(PROPERTIES, single),
        GRAVITY: either,
    }


def levels_of(description: RandomDescription, planar: bool) -> dict[str, str]:
    """Return the actual levels of a description, independent of the requested ones."""
    joints, links = description.joints, {link.name: link for link in description.links}
    parents = [joint.parent for joint in joints]
    axes = [joint.axis for joint in joints if joint.kind in (*SINGLE, "planar")]
    moving = {joint.child for joint in joints if joint.kind != "fixed"}

    def presence(*flags: bool) -> str:
        return PRESENT if any(flags) else ABSENT

    return {
        SPACE: PLANE if planar else SOLID,
        ROOT: joints[0].kind,
        FIXED: presence(*(joint.kind == "fixed" for joint in joints)),
        SHAPE: BRANCHED if len(set(parents)) < len(parents) else CHAIN,
        AXES: STRAIGHT if all(axis in ALONG_AXES for axis in axes) else OBLIQUE,
        CARRIERS: presence(*(links[name].mass == 0 for name in moving)),
        FOLLOWERS: presence(*(joint.mimics is not None for joint in joints)),
        SPRINGS: presence(*(joint.stiffness is not None for joint in joints)),
        DAMPERS: presence(*(joint.damping is not None for joint in joints)),
        ROTORS: presence(*(joint.armature is not None for joint in joints)),
        GRAVITY: presence(description.gravity is not None),
    }


# ---- A tree --------------------------------------------------------------------------------------


def random_tree(
    levels: Mapping[str, str],
    links: int,
    choices: Choices,
    least: int = 1,
    among: frozenset[str] = ALL,
    turning: bool = False,
) -> RandomDescription:
    """Return a random tree that has all `levels`.

    Args:
        levels: one level of each property of an entry of `tree_factors`.
        links: number of links, the ground not counted.
        choices: the source of all other choices.
        least: least number of coordinates, if the budget allows.
        among: allowed kinds of joints, one with one coordinate among them.
        turning: whether some joint has to turn; there is a second one that moves, or the root does.
    """
    return _Tree(levels, links, choices, least, among, turning).description()


@dataclass
class _Tree:
    """A tree under construction. Links are numbered as their joints, from 1; the ground is 0."""

    levels: Mapping[str, str]
    links: int
    choices: Choices
    least: int
    among: frozenset[str]
    turning: bool
    kinds: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    carrier: int | None = None
    """Index of the joint whose link has no mass; the next joint is on it."""
    follower: int | None = None
    last_axis: Triple = (0.0, 0.0, 1.0)
    """Axis of the previous joint."""

    def __post_init__(self):
        self.planar = self.levels[SPACE] == PLANE
        self._choose_kinds()
        self._choose_parents()
        if self._has(FOLLOWERS):
            self.follower = self.choices.one_of(self._singles()[1:])

    def _has(self, name: str) -> bool:
        return self.levels[name] == PRESENT

    def _singles(self) -> list[int]:
        return [i for i, kind in enumerate(self.kinds) if kind in SINGLE]

    # ---- Kinds and parents of joints -------------------------------------------------------------

    def _choose_kinds(self) -> None:
        root, fixed = self.levels[ROOT], int(self._has(FIXED))
        singles = [kind for kind in SINGLE if kind in self.among]
        (room,) = (
            b
            for b in joint_budgets(self.links, self.among)
            if (b.space, b.root, b.fixed) == (self.levels[SPACE], root, fixed)
        )
        no_axis = self.levels[AXES] == OBLIQUE and root not in (*SINGLE, "planar")
        wanted = no_axis or any(map(self._has, PROPERTIES))
        pair = self._has(CARRIERS) or self._has(FOLLOWERS)
        # Required joints with one coordinate besides the root.
        single = max(0, min(2 if pair else int(wanted), room.singles) - int(root in SINGLE))
        free = self.links - 1 - fixed - single
        blocks = [["fixed"]] * fixed + self._free_kinds(free, room, root, single)
        on_root = self._has(CARRIERS) and root in SINGLE
        if self._has(CARRIERS) and not on_root:
            blocks.append([self.choices.one_of(singles) for _ in range(2)])
        elif not on_root:
            blocks += [[self.choices.one_of(singles)] for _ in range(single)]
        shuffled = []
        while blocks:
            shuffled.append(blocks.pop(self.choices.whole(0, len(blocks) - 1)))
        self.kinds = [root]
        if on_root:
            self.carrier = 0
            self.kinds.append(self.choices.one_of(singles))
        for block in shuffled:
            if len(block) == 2:
                self.carrier = len(self.kinds)
            self.kinds += block
        if self.carrier is not None and self.kinds[self.carrier] == "prismatic":
            # Two slides may be parallel.
            self.kinds[self.carrier + 1] = "revolute"
        if self.turning and TURNING.isdisjoint(self.kinds):
            self.kinds[self._singles()[-1]] = "revolute"

    def _free_kinds(self, free: int, room: JointBudget, root: str, single: int) -> list[list[str]]:
        """Return the kinds of the unconstrained joints, with as many coordinates as required."""
        kinds = [kind for kind in KINDS[room.space] if kind in self.among]
        among = (*kinds[:1] * 2, *kinds, *(("fixed",) if room.fixed else ()))
        chosen = [self.choices.one_of(among) for _ in range(free)]
        sizes = {kind: len(parts_) for kind, parts_ in COORDINATES.items()}
        coordinates = sizes[root] + single - int(self._has(FOLLOWERS))
        for i in range(free):
            if coordinates + sum(sizes[kind] for kind in chosen) >= self.least:
                break
            chosen[i] = kinds[-1]
        return [[kind] for kind in chosen]

    def _choose_parents(self) -> None:
        branched = self.levels[SHAPE] == BRANCHED
        self.parents = list(range(self.links))
        if not branched:
            return
        for i in range(1, self.links):
            if not self._is_carried(i):
                self.parents[i] = self.choices.whole(0, i)
        if len(set(self.parents)) == self.links:
            i = max(i for i in range(1, self.links) if not self._is_carried(i))
            self.parents[i] = 0 if i == 1 else i - 1

    def _is_carried(self, i: int) -> bool:
        return self.carrier is not None and i == self.carrier + 1

    # ---- Numbers of links and joints -------------------------------------------------------------

    def description(self) -> RandomDescription:
        """Return the description of the tree."""
        joints = tuple(map(self._joint, range(self.links)))
        links = tuple(map(self._link, range(self.links)))
        gravity = random_direction(self.choices, self.planar, 10.0) if self._has(GRAVITY) else None
        return RandomDescription((Link(GROUND), *links), joints, gravity=gravity)

    def _link(self, i: int) -> Link:
        frame = self.kinds[i] == "fixed" and self.choices.one_of((False, True))
        if i == self.carrier or frame:
            return Link(_link_name(i + 1))
        return random_link(self.choices, _link_name(i + 1), self.planar)

    def _joint(self, i: int) -> Joint:
        kind = self.kinds[i]
        position = random_point(self.choices, self.planar)
        choices = self.choices
        axis = self._axis(i)
        if self._is_carried(i):
            position = self._off_axis(position, i - 1)
        self.last_axis = axis
        turn = IDENTITY if self.planar else random_orientation(choices)
        between = _link_name(self.parents[i]), _link_name(i + 1)
        joint = Joint(f"j{i + 1}", kind, *between, position, turn, axis)
        if kind not in SINGLE:
            return joint
        if self._is_there(SPRINGS, i):
            joint = joint._replace(
                stiffness=random_magnitude(choices, 0.0, 2.0),
                rest_position=choices.number(-1.0, 1.0),
            )
        if self._is_there(DAMPERS, i):
            joint = joint._replace(damping=random_magnitude(choices, -1.0, 1.0))
        if self._is_there(ROTORS, i):
            joint = joint._replace(armature=random_magnitude(choices, -2.0, 0.0))
        if i == self.follower:
            leader = choices.one_of([k for k in self._singles() if k != i])
            ratio = choices.one_of((1.0, -1.0)) * choices.number(0.2, 2.0)
            return joint._replace(mimics=(f"j{leader + 1}", ratio, choices.number(-1.0, 1.0)))
        return joint

    def _is_there(self, name: str, i: int) -> bool:
        if not self._has(name):
            return False
        return i == self._singles()[0] or self.choices.one_of((False, True))

    def _axis(self, i: int) -> Triple:
        kind, choices = self.kinds[i], self.choices
        if kind in ("fixed", "spherical", "floating"):
            return 0.0, 0.0, 1.0
        if self.planar:
            return choices.one_of({"prismatic": IN_PLANE, "revolute": ACROSS}.get(kind, ACROSS[:1]))
        first = min(k for k, entry in enumerate(self.kinds) if entry in (*SINGLE, "planar"))
        oblique = self.levels[AXES] == OBLIQUE
        if oblique and (i == first or choices.one_of((False, True))):
            x, y, z = random_direction(choices, planar=False)
            # Never along an axis of the frame, even for the simplest numbers.
            return (x, y, z) if np.count_nonzero((x, y, z)) > 1 else (x, y + 0.5, z + 0.5)
        return choices.one_of(ALONG_AXES)

    def _off_axis(self, position: Triple, before: int) -> Triple:
        """Return a position off the axis of the previous joint, so that two hinges differ."""
        axis, place = np.asarray(self.last_axis), np.asarray(position)
        away = np.linalg.norm(np.cross(axis, place)) / np.linalg.norm(axis)
        if self.kinds[before] != "revolute" or away >= SMALLEST:
            return position
        return (0.5, 0.0, 0.0) if abs(axis[0]) < max(abs(axis[1:])) else (0.0, 0.5, 0.0)


def _link_name(i: int) -> str:
    return GROUND if i == 0 else f"link{i}"


# ---- Trees that a URDF can represent -------------------------------------------------------------

COMMON_JOINTS = ("revolute", "prismatic", "fixed")
"""Kinds of joints that all parsers support."""

URDF_JOINTS = frozenset({*COMMON_JOINTS, "planar", "floating"})
"""Kinds of joints that a URDF may have."""


def urdf_tree(
    links: int,
    choices: Choices,
    joints: tuple[str, ...] = COMMON_JOINTS,
    mimic: bool = True,
    massless: bool = True,
    dampers: bool = True,
) -> RandomDescription:
    """Return a random tree in space that a URDF can represent, its joints in any order.

    Args:
        links: number of links, the ground not counted.
        choices: the source of random choices.
        joints: allowed kinds, "revolute" among them.
        mimic: whether some joints may mimic others.
        massless: whether some links may have no inertia.
        dampers: whether some joints may have dampers.
    """
    among = frozenset(joints)
    either = (room for room in joint_budgets(links, among) if room.space == SOLID)
    entry = choices.one_of([tree_factors(room, links) for room in either])
    ways = {name: choices.one_of(o) for name, o in entry.items()}
    ways |= dict.fromkeys((*PROPERTIES, GRAVITY), ABSENT)
    if dampers and PRESENT in entry[DAMPERS]:
        ways[DAMPERS] = choices.one_of((ABSENT, PRESENT))
    ways |= {} if mimic else {FOLLOWERS: ABSENT}
    ways |= {} if massless else {CARRIERS: ABSENT}
    tree = random_tree(ways, links, choices, among=among)
    remaining, order = list(tree.joints), []
    while remaining:
        order.append(remaining.pop(choices.whole(0, len(remaining) - 1)))
    frames = tree.links if massless else tuple(_with_inertia(link) for link in tree.links)
    return tree._replace(links=frames, joints=tuple(order))


def _with_inertia(link: Link) -> Link:
    if link.mass > 0 or link.name == GROUND:
        return link
    return link._replace(mass=0.1, moments=(0.01, 0.01, 0.01))
