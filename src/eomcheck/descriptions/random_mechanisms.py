"""Random mechanisms: scene classes of which every sample has another topology (`RANDOM`).

Their constraints are satisfied in the pose of the tree, and their rows are independent: a
constraint is constructed from the positions of the links in that pose (`poses`), so that it holds
there, and accepted if its rows of a, with the previous ones, are far from dependent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np
from scipy.linalg import qr

from eomcheck.descriptions import elements
from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.elements import COORDINATES, Constraint, Joint, Triple
from eomcheck.descriptions.joint_tree import ROLLING
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.random_trees import (
    GROUND,
    PLANE,
    SMALLEST,
    SPACE,
    TURNING,
    JointBudget,
    RandomDescription,
    joint_budgets,
    levels_of,
    random_direction,
    random_transverse,
    random_tree,
    random_triple,
    tree_factors,
)
from eomcheck.descriptions.vector_algebra import (
    IDENTITY,
    Quaternion,
    axis_rotation,
    conjugate,
    multiply_quaternions,
    rotation_matrix,
    z_to_axis,
)
from eomcheck.errors import InputError, RefusedError, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Choices, Factors, GeneratorChoices, Scene
from eomcheck.numbers.generic import FLOAT64, Array

# ---- Constraints of a tree -----------------------------------------------------------------------

INDEPENDENT = 0.05
"""Smallest singular value of accepted rows, each scaled to length 1: nearby states then seldom have
dependent rows.
"""

ATTEMPTS = 12
"""Number of attempts for a constraint of one kind."""


UPRIGHT = 0.5
"""Least sine of the angle between the axis of a disk and the normal of its plane: if they are
parallel no point of the rim is the lowest.
"""


def row_count_with_contact(kind: str, planar: bool) -> int:
    """Return the number of rows of a constraint; of a rolling one, with the rows of its contact."""
    if kind == "rolling":
        return 2 if planar else 3
    return KINDS[kind].planar if planar else KINDS[kind].spatial


def with_random_pose(tree: RandomDescription, choices: Choices) -> RandomDescription:
    """Return a tree in a random pose, generically not a singular one."""
    slides = {f"{joint.name}{part}" for joint in tree.joints for part in _slides(joint.kind)}
    pose = [
        (name, choices.number(-0.5, 0.5) if name in slides else choices.number(-1.0, 1.0))
        for name in tree.coordinates
    ]
    return tree._replace(pose=tuple(pose))


def _slides(kind: str) -> tuple[str, ...]:
    return {"prismatic": ("",), "planar": ("_x", "_y"), "floating": ("_x", "_y", "_z")}.get(
        kind, ()
    )


def with_random_constraint(
    tree: RandomDescription, kind: str, planar: bool, choices: Choices
) -> RandomDescription:
    """Return a tree in its pose with one more constraint of a kind, dependent coordinates first.

    Raises:
        RefusedError: all attempted constraints have rows that depend on others.
    """
    size = 0.0
    for _ in range(ATTEMPTS):
        more = _constraint(tree, kind, planar, choices)
        if more is None:
            continue
        closed = tree._replace(constraints=(*tree.constraints, *more), dependent=())
        a = _jacobian(closed)
        rows = np.linalg.norm(a, axis=1, keepdims=True)
        if not rows.all():
            continue  # a constraint that holds anyway
        size = np.linalg.svd(a / rows, compute_uv=False)[-1]
        if size >= INDEPENDENT:
            *_, order = qr(a / rows, mode="r", pivoting=True)
            first = (closed.coordinates[i] for i in order[: len(a)])
            return closed._replace(dependent=tuple(first))
    message = f"no independent {kind} is found among {ATTEMPTS}"
    raise RefusedError("a", float(size), INDEPENDENT, message)


def _jacobian(description: RandomDescription) -> Array:
    """Return the constraint Jacobian a (r, n) in the pose, columns in the order of the joints."""
    scene = description.source("Closed").scene_class()()
    parameters, q = scene.float64_parameters, np.array([x for _, x in description.pose])
    return scene.constraints(parameters, scene.prepare(FLOAT64, parameters, q, 0.0), q)[0]


# ---- Constraints that fit a pose -----------------------------------------------------------------


def _constraint(
    tree: RandomDescription, kind: str, planar: bool, choices: Choices
) -> tuple[Constraint, ...] | None:
    """Return the constraints that hold in the pose; None if no two links can have such a one.

    There is one, except that a rolling contact has several.
    """
    name = f"c{len(tree.constraints) + 1}"
    if kind in ("coupling", "drive"):
        constraint = _coordinate_constraint(tree, kind, name, choices)
        return None if constraint is None else (constraint,)
    pairs = _pairs(tree, kind, row_count_with_contact(kind, planar))
    if not pairs:
        return None
    link, other_link = choices.one_of(pairs)
    pose = poses(tree)
    point = random_triple(choices, planar)
    fit = PosedPair(name, link, other_link, point, pose[link], pose[other_link], planar, choices)
    if kind in ROLLING:
        up, *slips = _rolling(fit)
        return (*slips, up) if kind == "rolling" else (up,)
    return (_FITTED[kind](fit),)


def _pairs(tree: RandomDescription, kind: str, rows: int) -> list[tuple[str, str]]:
    """Return the pairs of links with at least `rows` coordinates of relative motion.

    Where directions stay perpendicular, those with at least a joint between them that turns.
    """
    between: dict[str, frozenset[str]] = {GROUND: frozenset()}
    for joint in tree.joints:
        own = {joint.name} if joint.kind in TURNING else set()
        if kind != "square":
            leader = joint.name if joint.mimics is None else joint.mimics[0]
            own = {leader + part for part in COORDINATES[joint.kind]}
        between[joint.child] = between[joint.parent] ^ own
    names = list(between)
    return [
        (link, earlier)
        for i, link in enumerate(names)
        for earlier in (names[:1] if kind == "edge" else names[:i])
        if len(between[link] ^ between[earlier]) >= rows
    ]


def _coordinate_constraint(
    tree: RandomDescription, kind: str, name: str, choices: Choices
) -> Constraint | None:
    """Return a constraint of coordinates; not of hinges that must avoid a singular pose."""
    q = {c: x for c, x in tree.pose if not c.endswith("_pitch")}
    if len(q) < (1 if kind == "drive" else 2):
        return None
    i = choices.one_of(list(q))
    if kind == "drive":
        return elements.drive(name, i, q[i], choices.number(-1.0, 1.0), choices.number(-0.1, 0.1))
    j = choices.one_of([c for c in q if c != i])
    ratio = choices.one_of((1.0, -1.0)) * choices.number(0.2, 2.0)
    return elements.coupling(name, i, j, ratio, q[i] - ratio * q[j])


class PosedPair(NamedTuple):
    """Two links in their poses and a point of the first, to which a constraint is fitted."""

    name: str
    """Name of the constraint."""
    link: str
    other: str
    at: Triple
    """Point of the link, m."""
    here: Pose
    there: Pose
    """Poses of the link and of the other one."""
    planar: bool
    choices: Choices

    @property
    def head(self) -> tuple[str, str, str]:
        """Return the first arguments of most functions that make a constraint."""
        return self.name, self.link, self.other

    @property
    def at_other(self) -> Triple:
        """Return the point in the frame of the other link."""
        return self.there.local_point(self.here.point(self.at))

    def to_other(self, along: Any) -> Triple:
        """Return a direction of the link in the frame of the other one."""
        return self.there.local_direction(self.here.direction(along))

    def direction(self) -> Triple:
        """Return a random direction."""
        return random_direction(self.choices, self.planar)

    def triple(self) -> Triple:
        """Return three random numbers."""
        return random_triple(self.choices, self.planar)


def _weld(fit: PosedPair) -> Constraint:
    turn = multiply_quaternions(conjugate(fit.here.orientation), fit.there.orientation)
    return elements.weld(*fit.head, fit.at, fit.at_other, turn)


def _hinge(fit: PosedPair) -> Constraint:
    axis = random_direction(fit.choices, planar=False)
    return elements.hinge(*fit.head, fit.at, fit.at_other, axis, fit.to_other(axis))


def _distance(fit: PosedPair) -> Constraint:
    at_other = fit.triple()
    rod = fit.here.point(fit.at) - fit.there.point(at_other)
    if np.linalg.norm(rod) < 5 * SMALLEST:
        rod = np.array([1.0, 0.0, 0.0])
        at_other = fit.there.local_point(fit.here.point(fit.at) - rod)
    return elements.distance(*fit.head, float(np.linalg.norm(rod)), fit.at, at_other)


def _on_plane(fit: PosedPair) -> Constraint:
    across = fit.direction()
    normal, away = np.asarray(across), np.asarray(fit.triple())
    along = away - away @ normal / (normal @ normal) * normal
    return elements.on_plane(*fit.head, across, fit.at, _triple(np.asarray(fit.at_other) - along))


def _on_quadric(fit: PosedPair) -> Constraint:
    """Return an on-quadric constraint whose surface passes through the point, with a slope."""
    bends, s = (np.array([fit.choices.number(-1.0, 1.0) for _ in range(3)]) for _ in range(2))
    s[2] = 0.0 if fit.planar else s[2]
    along = np.asarray(fit.direction())
    slopes = along / np.linalg.norm(along) - bends * s
    level = float((bends * s * s / 2 + slopes * s).sum())
    surface = _triple(bends), level, _triple(slopes)
    return elements.on_quadric(*fit.head, *surface, fit.at, _triple(np.asarray(fit.at_other) - s))


def _triple(a: Array) -> Triple:
    x, y, z = a.tolist()
    return x, y, z


def _square(fit: PosedPair) -> Constraint:
    along, away = fit.direction(), np.array([0.0, 0.0, 1.0])
    if not fit.planar:
        away = np.asarray(random_transverse(fit.choices, along))
    across = fit.to_other(np.cross(along, away))
    return elements.perpendicular(fit.name, fit.link, along, fit.other, across)


def _rolling(fit: PosedPair) -> tuple[Constraint, ...]:
    """Return the constraints of a rolling ball, disk or (in the plane) circle, contact first."""
    radius = fit.choices.number(0.2, 1.0)
    across = np.asarray(fit.direction())
    normal = across / np.linalg.norm(across)
    up, axis = fit.there.direction(normal), None
    if not fit.planar and fit.choices.one_of((False, True)):
        axis = _upright(fit.choices, np.asarray(fit.here.local_direction(up)))
        n = fit.here.direction(axis) / np.linalg.norm(axis)
        rim = up - up @ n * n
        arm = -radius * rim / np.linalg.norm(rim)
    else:
        arm = -radius * up
    aside = np.asarray(fit.triple())
    aside -= aside @ normal * normal
    foot = np.asarray(fit.there.local_point(fit.here.point(fit.at) + arm)) + aside
    x, y, z = _triple(foot)
    a, b, c = _triple(normal)
    if fit.planar:
        return elements.rolling_circle(*fit.head, radius, (b, -a, 0.0), fit.at, (x, y, 0.0))
    if axis is None:
        return elements.rolling_ball(*fit.head, radius, fit.at, (x, y, z), (a, b, c))
    return elements.rolling_disk(*fit.head, radius, fit.at, (x, y, z), axis, (a, b, c))


def _upright(choices: Choices, normal: Array) -> Triple:
    """Return an axis that is far from parallel to a normal (3,) of length 1."""
    axis = random_direction(choices, planar=False)
    if np.linalg.norm(np.cross(normal, axis)) >= UPRIGHT * np.linalg.norm(axis):
        return axis
    return _triple(np.eye(3)[np.argmin(np.abs(normal))])


_FITTED: dict[str, Callable[[PosedPair], Constraint]] = {
    "pin": lambda fit: elements.pin(*fit.head, fit.at, fit.at_other),
    "weld": _weld,
    "hinge": _hinge,
    "distance": _distance,
    "on-plane": _on_plane,
    "on-quadric": _on_quadric,
    "square": _square,
    "edge": lambda fit: elements.knife_edge(fit.name, fit.link, fit.direction(), fit.at),
}
"""Kind of constraint -> function that fits one."""


class Pose(NamedTuple):
    """Position and orientation of a link."""

    orientation: Quaternion
    origin: Array
    """Origin (3,), m."""

    def point(self, position: Any) -> Array:
        """Return a point of the link in ground axes."""
        return self.origin + self.direction(position)

    def direction(self, along: Any) -> Array:
        """Return a direction of the link in ground axes."""
        return rotation_matrix(self.orientation) @ np.asarray(along, np.float64)

    def local_point(self, position: Array) -> Triple:
        """Return a point of the ground in the frame of the link."""
        return self.local_direction(position - self.origin)

    def local_direction(self, along: Array) -> Triple:
        """Return a direction of the ground in the frame of the link."""
        x, y, z = (rotation_matrix(self.orientation).T @ along).tolist()
        return x, y, z


def poses(description: RandomDescription) -> dict[str, Pose]:
    """Return the poses of all links, computed from the elements of a description alone."""
    q, placed = dict(description.pose), {GROUND: Pose(IDENTITY, np.zeros(3))}
    by_name = {joint.name: joint for joint in description.joints}
    for joint in description.joints:
        before = placed[joint.parent]
        seat = Pose(
            multiply_quaternions(before.orientation, joint.orientation), before.point(joint.origin)
        )
        turn, displacement = _joint_displacement(joint, _joint_coordinates(joint, by_name, q))
        placed[joint.child] = Pose(
            multiply_quaternions(seat.orientation, turn), seat.point(displacement)
        )
    return placed


def _joint_coordinates(joint: Joint, by_name: dict[str, Joint], q: dict[str, float]) -> list[float]:
    if joint.mimics is None:
        return [q.get(joint.name + part, 0.0) for part in COORDINATES[joint.kind]]
    leader, ratio, shift = joint.mimics
    return [ratio * x + shift for x in _joint_coordinates(by_name[leader], by_name, q)]


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
    return multiply_quaternions(
        multiply_quaternions(tilt, axis_rotation(2, angle)), conjugate(tilt)
    )


# ---- Scene classes -------------------------------------------------------------------------------

CONSTRAINTS, MOTION = "constraints", "motion"
NOTHING = "nothing"

MAX_RANDOM_LINKS = 30
"""Largest number of links of a random scene: at six coordinates per link, 200 are allowed."""

PROVED = 3
"""Number of scenes of each number of links that `structures` yields."""


class RandomScene(Mechanism):
    """A mechanism that was sampled together with its description; each has a class of its own.

    All random numbers are in the description, so that its parameters have no sampling ranges.
    """

    has_links = True
    most_links = MAX_RANDOM_LINKS

    @property
    def links(self) -> int:
        """Number of links N, the ground not counted."""
        return len(self.source.description.joints)

    @property
    def name(self) -> str:
        """The key with N."""
        return f"{self.key}[{self.links}]"

    @property
    def structure(self) -> str:
        """The structural variant: name, joints with their parents, constraints, optional terms."""
        description: RandomDescription = self.source.description
        indices = {link.name: str(i) for i, link in enumerate(description.links)}
        joints = " ".join(f"{joint.kind}-{indices[joint.parent]}" for joint in description.joints)
        levels = self.topology
        more = [name for name, way in levels.items() if way in ("present", "oblique", PLANE)]
        return "; ".join(
            [f"{self.name}: {joints}"]
            + [f"{c.kind} {'-'.join(indices[x] for x, _ in c.points)}".strip()
               for c in description.constraints]
            + [", ".join(more)] * bool(more)
        )  # fmt: skip

    @property
    def topology(self) -> dict[str, str]:
        """Levels of its topology, computed from its description; see `topologies`."""
        return levels_of(self.source.description, self.source.topology.planar)

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return no sampling ranges."""
        return {}

    @classmethod
    def example(cls) -> Scene:
        """Return the one scene that is always checked first, for every such class."""
        return _example(_base(cls))

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Any]:
        """Yield a few scenes with so many links, always the same; no two are alike.

        Raises:
            InputError: there are no scenes with so many links.
        """
        links = checked_links(links)
        random = np.random.default_rng(links)
        variants: set[str] = set()
        choices = GeneratorChoices(random)
        # Entries with more kinds of constraints have more weight.
        entries = [x for x in cls.topologies(links) for _ in x.get(CONSTRAINTS, ("",))]
        while len(variants) < PROVED:
            ways = {name: choices.one_of(o) for name, o in choices.one_of(entries).items()}
            try:
                scene = cls.of_topology(links, ways, choices)()
            except RefusedError:
                continue
            if scene.structure not in variants:
                variants.add(scene.structure)
                yield scene

    @classmethod
    def of_description(cls, description: RandomDescription) -> type[Self]:
        """Return the scene class of a description."""
        source = description.source(_class_name(cls.key))
        return source._replace(base=_base(cls), description=description).scene_class()  # type: ignore


class RandomTree(RandomScene):
    """A random tree of rigid bodies."""

    key = "random-trees"

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return the possible topologies of trees of so many links."""
        links = checked_links(links)
        return [tree_factors(room, links) for room in joint_budgets(links)]

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Self]:
        """Return the class of one random tree."""
        return cls.of_description(random_tree(levels, checked_links(links), choices))


class RandomMechanism(RandomScene):
    """A random tree with loops, wheels, couplings or drives, their rows independent."""

    key = "random-mechanisms"

    @property
    def topology(self) -> dict[str, str]:
        """Levels of its topology, the kind of its first constraint among them."""
        first = self.source.description.constraints[:1]
        return super().topology | {CONSTRAINTS: first[0].kind if first else NOTHING}

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return the possible topologies of mechanisms of so many links.

        With a clock-driven constraint the initial state is never one of rest.
        """
        links = checked_links(links)
        factors = []
        for room in joint_budgets(links):
            ways, fitting = tree_factors(room, links), _fitting(room)
            still = tuple(kind for kind in fitting if kind != "drive")
            if still:
                factors.append(ways | {CONSTRAINTS: still})
            if "drive" in fitting:
                factors.append(ways | {CONSTRAINTS: fitting, MOTION: ("moving",)})
        return factors

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Self]:
        """Return the class of one random mechanism.

        Raises:
            RefusedError: no independent constraints are found.
        """
        kind, planar = levels[CONSTRAINTS], levels[SPACE] == PLANE
        least = row_count_with_contact(kind, planar) + 1
        turning = kind == "square"
        grown = random_tree(levels, checked_links(links), choices, least, turning=turning)
        grown = with_random_pose(grown, choices)
        closed = with_random_constraint(grown, kind, planar, choices)
        if kind == "drive" or not choices.one_of((False, False, True)):
            return cls.of_description(closed)
        remaining = len(closed.coordinates) - row_count_with_contact(kind, planar)
        among = [
            c
            for c in _kinds(planar)
            if row_count_with_contact(c, planar) < remaining and c != "drive"
        ]
        if among:
            with suppress(RefusedError):  # one constraint is enough
                closed = with_random_constraint(closed, choices.one_of(among), planar, choices)
        return cls.of_description(closed)


def _kinds(planar: bool) -> list[str]:
    return [kind for kind in KINDS if row_count_with_contact(kind, planar) > 0]


def _fitting(room: JointBudget) -> tuple[str, ...]:
    """Return the kinds of constraints that fit in the budget and leave one degree of freedom."""
    planar = room.space == PLANE
    return tuple(
        kind for kind in _kinds(planar) if row_count_with_contact(kind, planar) < room.coordinates
    )


def checked_links(links: object, name: str = "links") -> int:
    """Return a number of links as an int.

    Raises:
        InputError: no random scene has so many.
    """
    number = whole_number(name, links)
    if number > MAX_RANDOM_LINKS:
        raise InputError(
            f"{name} = {number}, expected at most {MAX_RANDOM_LINKS} of a random scene"
        )
    return number


def _class_name(key: str) -> str:
    return "".join(part.capitalize() for part in key.split("-"))


@cache
def _example(kind: type[RandomScene]) -> Scene:
    return next(kind.structures(3))


def _base(kind: type[RandomScene]) -> type[RandomScene]:
    """Return the base class of all scenes of a random class."""
    return next(base for base in kind.__mro__ if "source" not in vars(base))


RANDOM: dict[str, type[Scene]] = {
    kind.key: type(kind.example()) for kind in (RandomTree, RandomMechanism)
}
"""Key -> class of its example, for only such a class has equations."""
