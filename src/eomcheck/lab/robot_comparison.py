"""Comparison of two robots: whether two files describe the same one, and where they part.

Joints are matched by name, by request, or by their place in the tree. What is compared does not
depend on the frames of links, in which files are free: axes of joints as lines in space and bodies
(mass, centre of mass, inertia) where all coordinates are 0, each relative to the joint before it:
one difference is not reported again by all that it carries. Links that are fixed to each other are
one body. Constraints are compared by the positions and motions that satisfy them. Differences are
weighed by what they do to M, gravity and accelerations.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.confusions import agreement_within, scaling
from eomcheck.descriptions.doubtful_numbers import FEWEST_DIGITS
from eomcheck.descriptions.joint_tree import RigidBody, point_inertia
from eomcheck.descriptions.mjcf_reader import MJCF, included_files
from eomcheck.descriptions.sdf_reader import SDF
from eomcheck.descriptions.urdf_reader import URDF, Element, root_of
from eomcheck.descriptions.vector_algebra import rotation_matrix
from eomcheck.draws.pairwise_design import state_cases
from eomcheck.errors import InputError, UnknownNameError
from eomcheck.evaluation.conformance import ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import C, largest
from eomcheck.lab.recorded_table import digits_of
from eomcheck.lab.show.table import say, write_json
from eomcheck.mechanics.records import Tree, TreeFrame
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS, Array
from eomcheck.numbers.linear import solve
from eomcheck.safe_output import counted, listed

FAR_OFF = 10.0
"""Misfit, over the closeness of numbers, that decides between placements before smaller ones do:
turned to other axes, directions have the errors of points that are far from them."""

ALIGNED = 0.9
"""Cosine of the angle between two lines above which one does not fix a place along the other."""

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")

FORMATS = {"urdf": URDF, "mjcf": MJCF, "sdf": SDF}

INERTIAL = {"xyz": "center", "pos": "center", "pose": "center", "mass": "mass"}
"""Attribute of an inertial, of SDF element -> sort of its numbers; others are of its inertia."""

PLACEMENT = frozenset(
    {
        "xyz",
        "rpy",
        "pos",
        "pose",
        "quat",
        "euler",
        "axisangle",
        "xyaxes",
        "zaxis",
        "axis",
        "ref",
        "springref",
        "fromto",
    }
)
"""Attributes of other elements, of SDF elements, that place something."""

NAMES = frozenset({"name", "class", "file", "filename", "uri", "version"})
"""Attributes and elements without numbers of the robot."""


class RobotDifference(NamedTuple):
    """A difference between two robots.

    Attributes:
        where: joint or body, such as "joint elbow" or "body of elbow (forearm)".
        what: what differs: "mass", "center of mass", "inertia", "axis", ...
        text: description with the numbers of both.
        size: relative size, by which differences are ordered.
    """

    where: str
    what: str
    text: str
    size: float

    def __str__(self) -> str:
        return f"{self.where}: {self.what}: {self.text}"


class Effect(NamedTuple):
    """Effect of all differences on a quantity.

    Attributes:
        quantity: its name.
        size: largest difference, relative to the largest entry over all states.
        joint: the joint of the entry that differs most.
    """

    quantity: str
    size: float
    joint: str


class RobotComparison(NamedTuple):
    """Two robots with their differences.

    Attributes:
        names: names of both, of files.
        matched: joints of the first -> joints of the second.
        by_structure: those among them that are matched by their place in the tree.
        differences: differences, the largest first.
        effects: their effects; empty if joints are unmatched.
        resolution: relative error that the printed digits of both files explain.
        not_compared: parts of the files that act on the motion and are not read.
    """

    names: tuple[str, str]
    matched: dict[str, str]
    by_structure: tuple[str, ...]
    differences: tuple[RobotDifference, ...]
    effects: tuple[Effect, ...]
    resolution: float
    not_compared: tuple[str, ...] = ()

    @property
    def is_same(self) -> bool:
        """Whether they are the same robot, to the digits of the files."""
        return not self.differences


def compare_robots(
    first: Scene, second: Scene, match: Mapping[str, str] | None = None, examples: int = 20
) -> RobotComparison:
    """Return the differences between two robots.

    Args:
        first: the robot that the other is compared with.
        second: the other one.
        match: joint of the first -> joint of the second, for names that differ.
        examples: number of states at which the effect is measured.

    Raises:
        InputError: one has no tree of bodies, or no position satisfies the constraints.
        UnknownNameError: `match` names a joint that there is not.
    """
    sides = _Side(first), _Side(second)
    matched, by_structure = match_joints(*sides, match or {})
    found = _merged([*_unmatched(*sides, matched), *_differences(*sides, matched)])
    whole = len(matched) == len(sides[0].tree.joint) == len(sides[1].tree.joint)
    if whole and not any(one.where.startswith("joint ") for one in found):
        found += _constraint_differences(*sides, matched, examples)
    if whole and not {one.what for one in found} - BODY_NUMBERS:
        found += _force_differences(*sides, matched, examples)
    found.sort(key=lambda one: -one.size)
    effects = tuple(_effects(*sides, matched, examples)) if whole and found else ()
    names = sides[0].name, sides[1].name
    if names[0] == names[1]:
        names = sides[0].location, sides[1].location
    resolution = max(x for side in sides for x in side.resolutions.values())
    unread = tuple(
        f"tendons of {name}, with their springs and dampers"
        for side, name in zip(sides, names, strict=True)
        if "tendons" in getattr(getattr(side.scene, "source", None), "ignored", "")
    )
    both = names, matched, by_structure
    return RobotComparison(*both, tuple(found), effects, resolution, unread)


def _merged(differences: Iterable[RobotDifference]) -> list[RobotDifference]:
    """Return the differences, those of the same sort at the same joint as one."""
    merged: dict[tuple[str, str], RobotDifference] = {}
    for one in differences:
        key = one.where, one.what
        if key in merged:
            text, size = f"{merged[key].text}; {one.text}", max(merged[key].size, one.size)
            one = one._replace(text=text, size=size)
        merged[key] = one
    return list(merged.values())


# ---- Both sides ----------------------------------------------------------------------------------


class _Side:
    """A robot with its joints in space where all coordinates are 0.

    Args:
        scene: the robot.
    """

    def __init__(self, scene: Scene):
        tree = scene.tree()
        if tree is None:
            raise InputError(f"{scene.name} has no tree of bodies to compare")
        self.scene, self.tree = scene, tree
        source = getattr(scene, "source", None)
        self.file = Path(source.file) if source is not None and source.file else None
        self.name = self.file.name if self.file is not None else scene.name
        self.location = str(self.file) if self.file is not None else scene.name
        self.R, self.p = _placed(tree)
        self.index = {name: j for j, name in enumerate(tree.name)}

    @cached_property
    def resolutions(self) -> dict[str, float]:
        """Sort of numbers -> relative rounding error of those in its file."""
        if self.file is None or not self.file.is_file():
            return dict.fromkeys(SORTS, EPS)
        texts: dict[str, list[str]] = {sort: [] for sort in SORTS}
        expected = FORMATS[self.scene.source.format]  # type: ignore[attr-defined]
        for path in included_files(self.file) if expected is MJCF else [self.file]:
            for sort, text in _sorted_texts(root_of(path, expected)):
                # Names may have digits too.
                texts[sort] += (x for x in text.split() if NUMBER.fullmatch(x))
        digits = {x: digits_of(y).significant if y else 0 for x, y in texts.items()}
        return {x: max(EPS, 0.5 * 10.0 ** (1 - max(FEWEST_DIGITS, y))) for x, y in digits.items()}

    @property
    def reach(self) -> float:
        """Size of the robot, m: the distance of its joints and bodies from each other."""
        points = [*self.p, *(self.center(j) for j in range(len(self.p)) if self.tree.mass[j] > 0)]
        return max(float(largest(np.ptp(points, axis=0))), EPS) if len(points) > 1 else 1.0

    def axis(self, j: int) -> Array:
        """Return the direction along which the coordinate of a joint grows (3,)."""
        row = self.tree.coordinates[j]
        sign = -1.0 if row[int(np.argmax(np.abs(row)))] < 0.0 else 1.0
        return sign * self.R[j][:, "xyz".index(self.tree.joint[j][1])]

    def center(self, j: int) -> Array:
        """Return the centre of mass of the body of a joint (3,), m."""
        return self.p[j] + self.R[j] @ self.tree.center[j]

    def inertia(self, j: int) -> Array:
        """Return the inertia of the body of a joint about its centre of mass (3, 3), kg m²."""
        return self.R[j] @ self.tree.inertia[j] @ self.R[j].T

    def links(self, j: int) -> str:
        """Return the names of the links that a joint carries, the first `MOST_LINKS` of them."""
        names = [frame.name for frame in self.tree.frames if frame.joint == j]
        return listed(names, MOST_LINKS, "other")

    def frame(self, j: int) -> tuple[Array, Array, str]:
        """Return axes, origin and name of the first link that a joint carries, or of the joint."""
        for frame in self.tree.frames:
            if frame.joint == j:
                return self.R[j] @ frame.R, self.p[j] + self.R[j] @ frame.p, frame.name
        return self.R[j], self.p[j], self.tree.name[j]

    def body(self, j: int) -> str:
        """Return the name of the body of a joint."""
        links = self.links(j)
        return f"body of {self.tree.name[j]}" + (f" ({links})" if links else "")


MOST_LINKS = 5
"""Largest number of links that are named."""

SORTS = "mass", "center", "inertia", "placement", "coefficient"
"""Sorts of numbers in a file; a program may print each with digits of its own."""


def _sorted_texts(element: Element, within: str = "") -> Iterator[tuple[str, str]]:
    """Yield the numbers of a file as texts, each with its sort."""
    inertial = "inertial" in (element.tag, within)
    texts = {**element.attrib, element.tag: element.text or ""}
    for name, text in texts.items():
        if inertial:
            sort = "mass" if element.tag == "mass" else INERTIAL.get(name, "inertia")
        else:
            sort = "placement" if name in PLACEMENT else "coefficient"
        if name not in NAMES:
            yield sort, text
    for child in element:
        yield from _sorted_texts(child, "inertial" if inertial else "")


class Closeness(NamedTuple):
    """Largest differences that the printed digits of two files explain, all relative."""

    mass: float
    center: float
    inertia: float
    placement: float
    coefficient: float

    @classmethod
    def of(cls, first: _Side, second: _Side) -> Closeness:
        """Return the closeness of two robots."""
        x, y = first.resolutions, second.resolutions
        error = {sort: max(x[sort], y[sort]) for sort in SORTS}
        # Bodies are compared where the joints before them have placed them.
        placed = error["placement"]
        center, inertia = (C * max(error[sort], placed) for sort in ("center", "inertia"))
        return cls(2.0 * error["mass"], center, inertia, C * placed, 2.0 * error["coefficient"])


def _placed(tree: Tree) -> tuple[list[Array], list[Array]]:
    """Return orientation and origin of the frame of each joint where all coordinates are 0."""
    R: list[Array] = []
    p: list[Array] = []
    for j, parent in enumerate(tree.parent):
        before = (np.eye(3), np.zeros(3)) if parent < 0 else (R[parent], p[parent])
        turned = before[0] @ tree.rotation[j]
        at = before[1] + before[0] @ tree.offset[j]
        axis, x = np.eye(3)["xyz".index(tree.joint[j][1])], float(tree.shift[j])
        if tree.joint[j][0] == "p":
            at = at + turned @ (x * axis)
        else:
            turned = turned @ _rotation(axis, x)
        R.append(turned)
        p.append(at)
    return R, p


def _rotation(axis: Array, angle: float) -> Array:
    """Return the rotation matrix about an axis of length 1 (3, 3)."""
    x, y, z = (np.sin(angle / 2) * axis).tolist()
    return rotation_matrix((np.cos(angle / 2), x, y, z))


# ---- Joints --------------------------------------------------------------------------------------


def match_joints(
    first: _Side, second: _Side, match: Mapping[str, str]
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return joints of the first -> joints of the second, and those matched by structure.

    `match` decides first, then names. Another joint is matched to the one of its kind that is
    mounted on the joint matched to its parent, of several to the one nearest in space.
    """
    for name, other in match.items():
        if name not in first.index:
            raise UnknownNameError("joint", name, first.tree.name)
        if other not in second.index:
            raise UnknownNameError("joint", other, second.tree.name)
    matched = {x: x for x in first.tree.name if x in second.index and x not in match}
    matched |= match
    structural = []
    taken = set(matched.values())
    for j, name in enumerate(first.tree.name):
        if name in matched:
            continue
        parent = first.tree.parent[j]
        mount = _partner(first, second, matched, parent)
        candidates = [
            k
            for k, other in enumerate(second.tree.name)
            if other not in taken
            and second.tree.parent[k] == mount
            and second.tree.joint[k][0] == first.tree.joint[j][0]
        ]
        if candidates:
            near = min(candidates, key=lambda k: float(np.linalg.norm(second.p[k] - first.p[j])))
            matched[name] = second.tree.name[near]
            taken.add(matched[name])
            structural.append(name)
    return {name: matched[name] for name in first.tree.name if name in matched}, tuple(structural)


def _partner(first: _Side, second: _Side, matched: Mapping[str, str], j: int) -> int:
    """Return the joint of the second that a joint is matched to, -1 for the ground, -2 for none."""
    return -1 if j < 0 else second.index.get(matched.get(first.tree.name[j], ""), -2)


def _unmatched(
    first: _Side, second: _Side, matched: Mapping[str, str]
) -> Iterator[RobotDifference]:
    """Yield the joints that one robot has alone."""
    for side, known in (first, {*matched}), (second, {*matched.values()}):
        for name in side.tree.name:
            if name not in known:
                yield RobotDifference(f"joint {name}", "missing", f"only in {side.name}", np.inf)


# ---- Differences ---------------------------------------------------------------------------------


class _Placement(NamedTuple):
    """Rigid motion that brings a part of the first robot onto the second."""

    R: Array
    p: Array

    def point(self, x: Array) -> Array:
        return self.R @ x + self.p

    def about(self, point: Array, R: Array) -> _Placement:
        """Return it followed by a rotation about a point."""
        return _Placement(R @ self.R, R @ (self.p - point) + point)


class _PlacedPair(NamedTuple):
    """Two matched joints, and the placements of what they carry."""

    joints: tuple[int, int]
    before: _Placement
    """Placement of the parent of the first."""
    placement: _Placement
    """Placement of what the first carries."""
    explained: list[tuple[str, str, float]]
    """Differences of the joint that the step from one to the other explains."""


def _placed_pairs(
    first: _Side, second: _Side, matched: Mapping[str, str], reach: float, near: Closeness
) -> Iterator[_PlacedPair]:
    """Yield the matched joints from the ground outwards."""
    placements: dict[int, _Placement] = {-1: _Placement(np.eye(3), np.zeros(3))}
    for name, other in matched.items():
        j, k = first.index[name], second.index[other]
        before = placements.get(first.tree.parent[j], placements[-1])
        placements[j], explained = _carried_placement(
            first, second, j, k, matched, before, reach, near
        )
        yield _PlacedPair((j, k), before, placements[j], explained)


def _differences(
    first: _Side, second: _Side, matched: Mapping[str, str]
) -> Iterator[RobotDifference]:
    """Yield the differences between matched joints and their bodies."""
    reach = max(first.reach, second.reach)
    near = Closeness.of(first, second)
    for pair in _placed_pairs(first, second, matched, reach, near):
        name, (j, k) = first.tree.name[pair.joints[0]], pair.joints
        other = second.tree.name[k]
        parent, mount = first.tree.parent[j], second.tree.parent[k]
        where = f"joint {name}" + ("" if name == other else f" ({other})")
        if _partner(first, second, matched, parent) != mount:
            names = [
                side.tree.name[i] if i >= 0 else "the ground"
                for side, i in ((first, parent), (second, mount))
            ]
            yield RobotDifference(where, "parent", f"on {names[0]}, on {names[1]}", 1.0)
        if first.tree.joint[j][0] != second.tree.joint[k][0]:
            kinds = {"p": "a slide", "r": "a hinge"}
            texts = [kinds[side.tree.joint[i][0]] for side, i in ((first, j), (second, k))]
            yield RobotDifference(where, "kind", f"{texts[0]}, {texts[1]}", 1.0)
        axes = [*_axis_differences(first, second, j, k, where, pair.before, reach, near.placement)]
        yield from axes
        for difference in pair.explained:
            yield RobotDifference(where, *difference)
        yield from _coefficients(first, second, j, k, where, near.coefficient)
        yield from _spring_difference(first, second, j, k, where, near.placement)
        # About the opposite axis by the opposite ratio it is the same motion of the leader.
        signed = any(one.what == "axis" for one in axes)
        yield from _mimic_difference(first, second, j, k, where, matched, near.coefficient, signed)
        yield from _body_differences(first, second, j, k, pair.placement, reach, near)
    yield from _gravity_difference(first, second, near.coefficient)


def _axis_differences(
    first: _Side,
    second: _Side,
    j: int,
    k: int,
    where: str,
    placement: _Placement,
    reach: float,
    near: float,
) -> Iterator[RobotDifference]:
    """Yield the differences between the axes of two joints."""
    axis, other = placement.R @ first.axis(j), second.axis(k)
    angle = float(np.arctan2(np.linalg.norm(np.cross(axis, other)), axis @ other))
    if np.pi - angle <= near:
        yield RobotDifference(
            where, "axis", "opposite direction: its coordinate has the other sign", 1.0
        )
    elif angle > near:
        yield RobotDifference(where, "axis", f"turned by {np.rad2deg(angle):.4g}°", angle)
    if first.tree.joint[j][0] == "r" and second.tree.joint[k][0] == "r":
        apart = _across(second.p[k] - placement.point(first.p[j]), other)
        distance = float(np.linalg.norm(apart))
        if distance > near * reach:
            text = f"its axis is displaced by {distance:.4g} m ({_numbers(apart)})"
            yield RobotDifference(where, "placement", text, distance / reach)


def _moved_to(
    first: _Side, second: _Side, j: int, k: int, placement: _Placement, near: float
) -> list[_Placement]:
    """Return placements of what a joint carries, where its axis differs.

    It may turn and move with the axis, or move alone, or stay as it is.
    """
    axis, other = placement.R @ first.axis(j), second.axis(k)
    if axis @ other < 0.0:
        other = -other
    across = np.cross(axis, other)
    sine = float(np.linalg.norm(across))
    point = placement.point(first.p[j])
    apart = np.zeros(3)
    if first.tree.joint[j][0] == "r":
        apart = _across(second.p[k] - point, other)
    moved = placement._replace(p=placement.p + apart)
    if sine <= near:
        return [moved, placement]
    turn = _rotation(across / sine, float(np.arctan2(sine, axis @ other)))
    return [moved.about(point + apart, turn), moved, placement]


class _Carried:
    """Body of a joint and the joints mounted on it, on both sides.

    Args:
        first, second: both robots.
        j, k: the joint on both sides.
        matched: matched joints.
        reach: size of the robots, m.
        near: closeness of their numbers.
    """

    def __init__(
        self,
        first: _Side,
        second: _Side,
        j: int,
        k: int,
        matched: Mapping[str, str],
        reach: float,
        near: Closeness,
    ):
        names = first.tree.name
        mounted = (i for i, parent in enumerate(first.tree.parent) if parent == j)
        children = [i for i in mounted if names[i] in matched]
        partners = [second.index[matched[names[i]]] for i in children]
        self.reach, self.near = reach, near
        self.points: list[tuple[Array, Array, Array | None]] = []
        if first.tree.mass[j] > 0 and second.tree.mass[k] > 0:
            self.points.append((first.center(j), second.center(k), None))
        self.directions: list[tuple[Array, Array]] = []
        for child, partner in zip(children, partners, strict=True):
            self.directions.append((first.axis(child), second.axis(partner)))
            if first.tree.joint[child][0] == "r":
                self.points.append((first.p[child], second.p[partner], second.axis(partner)))
        self.inertias = first.inertia(j), second.inertia(k)

    def fixed_along(self, axis: Array) -> int:
        """Return the number of points that are known along an axis; those of lines are not."""
        lines = (line for _, _, line in self.points)
        return int(sum(line is None or abs(line @ axis) < ALIGNED for line in lines))

    def misfits(self, placement: _Placement) -> list[float]:
        """Return how far each point, direction and inertia is off, over its closeness."""
        near = self.near
        points = [
            largest(_across(placement.point(x) - y, line))
            / (self.reach * (near.center if line is None else near.placement))
            for x, y, line in self.points
        ]
        ours, theirs = self.inertias
        size = largest(theirs)
        turned = largest(placement.R @ ours @ placement.R.T - theirs) / size if size else 0.0
        directions = [
            min(largest(placement.R @ x - y), largest(placement.R @ x + y)) / near.placement
            for x, y in self.directions
        ]
        return [*points, *directions, turned / near.inertia]

    def off(self, placement: _Placement, by: float = 1.0) -> int:
        """Return the number of points, directions and inertias that are off.

        Args:
            placement: placement of what the joint carries.
            by: largest misfit, over the closeness of numbers.
        """
        return sum(bool(x > by) for x in self.misfits(placement))


def _carried_placement(
    first: _Side,
    second: _Side,
    j: int,
    k: int,
    matched: Mapping[str, str],
    placement: _Placement,
    reach: float,
    closeness: Closeness,
) -> tuple[_Placement, list[tuple[str, str, float]]]:
    """Return the placement of what a joint carries, and the differences that it explains.

    Of all placements that one difference of the joint explains it is the one that most of what the
    joint carries agrees with: one body that is wrong does not turn the arm.
    """
    carried = _Carried(first, second, j, k, matched, reach, closeness)
    near = closeness.placement
    axis, anchor = second.axis(k), second.p[k]
    slides = first.tree.joint[j][0] == "p"

    def turned(moved: _Placement) -> Iterator[tuple[_Placement, list[tuple[str, str, float]]]]:
        vectors = [(moved.point(x) - anchor, y - anchor) for x, y, _ in carried.points]
        vectors += [(moved.R @ x, sign * y) for x, y in carried.directions for sign in (1.0, -1.0)]
        for x, y in ((_across(a, axis), _across(b, axis)) for a, b in vectors):
            if min(np.linalg.norm(x), np.linalg.norm(y)) > 1e3 * near * reach:
                angle = float(np.arctan2(axis @ np.cross(x, y), x @ y))
                text = f"differs by {np.rad2deg(angle):.6g}°"
                if abs(angle) > FAR_OFF * near:
                    found = [("zero position", text, abs(angle))]
                    yield moved.about(anchor, _rotation(axis, angle)), found

    def shifted(moved: _Placement) -> Iterator[tuple[_Placement, list[tuple[str, str, float]]]]:
        for x, y, line in carried.points:
            shift = float((y - moved.point(x)) @ axis) if line is None else 0.0
            if line is not None and abs(line @ axis) < ALIGNED:
                shift = float(_across(y - moved.point(x), line) @ axis) / (1 - (line @ axis) ** 2)
            if abs(shift) > near * reach:
                text = f"differs by {shift:.6g} m" if slides else f"along its axis by {shift:.6g} m"
                what = "zero position" if slides else "placement"
                yield (
                    moved._replace(p=moved.p + shift * axis),
                    [(what, text, float(abs(shift) / reach))],
                )

    def displaced_across(
        moved: _Placement,
    ) -> Iterator[tuple[_Placement, list[tuple[str, str, float]]]]:
        for x, y, _ in carried.points:
            apart = _across(y - moved.point(x), axis)
            distance = float(np.linalg.norm(apart))
            if distance > near * reach:
                text = f"displaced by {distance:.4g} m ({_numbers(apart)})"
                yield (
                    moved._replace(p=moved.p + apart),
                    [("placement", text, distance / reach)],
                )

    explained: list[tuple[int, int, _Placement, list[tuple[str, str, float]]]] = []

    def explain(moved: _Placement, found: list[tuple[str, str, float]], alone: bool) -> None:
        # One body alone may as well have another center of mass.
        off = carried.off(moved, FAR_OFF) + alone
        explained.append((off, carried.off(moved) + len(found), moved, found))

    for moved in _moved_to(first, second, j, k, placement, near):
        explain(moved, [], False)
        displaced = largest(moved.p - placement.p) > near * reach
        for candidate, found in () if slides else turned(moved):
            explain(candidate, found, False)
        for candidate, found in displaced_across(moved) if slides else ():
            alone = len(carried.points) == 1
            explain(candidate, found, alone)
            for further, more in shifted(candidate):
                explain(further, found + more, alone)
        for candidate, found in shifted(moved):
            alone = carried.fixed_along(axis) == 1 and not (displaced or slides)
            explain(candidate, found, alone)
    _, _, best, found = min(explained, key=lambda one: one[:2])
    return best, found


def _across(x: Array, axis: Array | None) -> Array:
    """Return the part of a vector across an axis."""
    return x if axis is None else x - (x @ axis) * axis


COEFFICIENTS = {"damping": "damper", "stiffness": "spring"}
"""Coefficient of a joint -> attribute of `ScalarJoint` with its index in the parameter."""


def _coefficients(
    first: _Side, second: _Side, j: int, k: int, where: str, near: float
) -> Iterator[RobotDifference]:
    """Yield the differences between dampers, springs and rotors of two joints."""
    for name in (*COEFFICIENTS, "armature"):
        x, y = (_coefficient(side, i, name) for side, i in ((first, j), (second, k)))
        if abs(x - y) > near * max(abs(x), abs(y)):
            yield RobotDifference(where, name, _both(x, y), _relative(x, y))


def _spring_difference(
    first: _Side, second: _Side, j: int, k: int, where: str, near: float
) -> Iterator[RobotDifference]:
    """Yield the difference between the coordinates at which the springs of two joints are relaxed.

    A joint without a spring has none.
    """
    if _coefficient(first, j, "stiffness") and _coefficient(second, k, "stiffness"):
        if (turned := _turned_at_rest(first, second, j, k)) is not None:
            if turned > near:
                text = f"orientations {turned:.3g} rad apart"
                yield RobotDifference(where, "rest of its spring", text, turned)
            return
        x, y = (_coefficient(side, i, "relaxed") for side, i in ((first, j), (second, k)))
        if abs(x - y) > near * max(1.0, abs(x), abs(y)):
            yield RobotDifference(where, "rest of its spring", _both(x, y), _relative(x, y))


def _turned_at_rest(first: _Side, second: _Side, j: int, k: int) -> float | None:
    """Return the angle between the rest orientations of two joints that turn about any axis, rad.

    None of joints of another kind.
    """
    rotations = []
    for side, i in (first, j), (second, k):
        scene: Any = side.scene
        spring = scene.source.topology.joints[i].gimbal_spring
        if spring is None:
            return None
        rotations.append(scene.float64_parameters.rest_rotation[spring])
    apart = float(np.linalg.norm(rotations[0] - rotations[1]))  # 2 sqrt(2) sin(angle / 2)
    return 2.0 * float(np.arcsin(min(apart / np.sqrt(8.0), 1.0)))


def _mimic_difference(
    first: _Side,
    second: _Side,
    j: int,
    k: int,
    where: str,
    matched: Mapping[str, str],
    near: float,
    signed: bool,
) -> Iterator[RobotDifference]:
    """Yield the difference between the joints that two joints follow, and in the ratios."""
    rows = []
    for side, i in (first, j), (second, k):
        row = side.tree.coordinates[i]
        column = int(np.argmax(np.abs(row)))
        leader = side.scene.coordinate_names[column]
        rows.append((leader, float(row[column])) if leader != side.tree.name[i] else ("", 1.0))
    (leader, ratio), (other, other_ratio) = rows
    if bool(leader) != bool(other):
        texts = [f"follows {x}, {r:.6g} times" if x else "free" for x, r in rows]
        yield RobotDifference(where, "mimic", f"{texts[0]}; {texts[1]}", 1.0)
    elif leader and matched.get(leader, other) != other:
        yield RobotDifference(where, "mimic", f"follows {leader}; follows {other}", 1.0)
    elif leader and not signed and abs(ratio + other_ratio) <= near * abs(ratio):
        return
    elif abs(ratio - other_ratio) > near * max(abs(ratio), abs(other_ratio)) and leader:
        yield RobotDifference(where, "mimic", f"ratio {_both(ratio, other_ratio)}", 1.0)


def _coefficient(side: _Side, j: int, name: str) -> float:
    """Return a coefficient of a joint, 0 where it has none."""
    if name == "armature":
        gimbal = side.tree.gimbal_armature
        return float(side.tree.armature[j]) + (float(gimbal[j]) if len(gimbal) else 0.0)
    topology = getattr(getattr(side.scene, "source", None), "topology", None)
    if topology is None:
        return 0.0
    index = getattr(topology.joints[j], COEFFICIENTS.get(name, "spring"))
    if name == "stiffness" and (turns := topology.joints[j].gimbal_spring) is not None:
        name, index = "gimbal_stiffness", turns
    values = getattr(side.scene, name, None)
    if values is None:
        return 0.0
    return 0.0 if index is None else float(np.ravel(values)[index])


def _body_differences(
    first: _Side,
    second: _Side,
    j: int,
    k: int,
    placement: _Placement,
    reach: float,
    near: Closeness,
) -> Iterator[RobotDifference]:
    """Yield the differences between the bodies of two joints."""
    m, m_other = float(first.tree.mass[j]), float(second.tree.mass[k])
    where = first.body(j)
    if abs(m - m_other) > near.mass * max(m, m_other):
        yield RobotDifference(where, "mass", _both(m, m_other, " kg"), _relative(m, m_other))
    if m > 0.0 and m_other > 0.0:
        center = placement.point(first.center(j))
        apart = second.center(k) - center
        if largest(apart) > near.center * reach:
            R, at, name = second.frame(k)
            places = [R.T @ (x - at) for x in (center, second.center(k))]
            mirrored = _mirror(places[0], places[1], near.center * reach)
            texts = [_numbers(x) for x in places]
            text = f"({texts[0]}) m, ({texts[1]}) m in the frame of {name}"
            size = float(np.linalg.norm(apart)) / reach
            yield RobotDifference(where, "center of mass", text + mirrored, size)
    ours, theirs = placement.R @ first.inertia(j) @ placement.R.T, second.inertia(k)
    size = max(largest(ours), largest(theirs))
    if largest(ours - theirs) > near.inertia * size:
        what = _inertia_confusion(first, second, j, k, placement, ours, theirs, near.inertia * size)
        change = largest(ours - theirs) / size
        text = what or f"off by {100 * change:.3g} % of its largest entry"
        yield RobotDifference(where, "inertia", text, change)


def _mirror(x: Array, y: Array, near: float) -> str:
    """Return which coordinates of a centre of mass have the other sign, as text; "" for none."""
    flipped = [axis for axis, a, b in zip("xyz", x, y, strict=True) if abs(a - b) > near]
    if flipped and largest(np.abs(x) - np.abs(y)) <= near:
        return f": {', '.join(flipped)} with the other sign"
    return ""


def _inertia_confusion(
    first: _Side,
    second: _Side,
    j: int,
    k: int,
    placement: _Placement,
    ours: Array,
    theirs: Array,
    near: float,
) -> str:
    """Return how the inertia of a body differs, if it is one of the usual ways; "" if not."""
    agree = agreement_within(near)
    if what := scaling(theirs, ours, agree):
        return what
    mass = float(second.tree.mass[k])
    center = second.center(k)
    points = {"the joint": second.p[k]} | {
        f"the origin of {frame.name}": second.p[k] + second.R[k] @ frame.p
        for frame in second.tree.frames
        if frame.joint == k
    }
    for name, point in points.items():
        moved = point_inertia(mass, center - point)
        if largest(ours + moved - theirs) <= near and largest(moved) > near:
            return f"about {name}, not about the center of mass"
        if largest(ours - moved - theirs) <= near and largest(moved) > near:
            return f"about the center of mass, in the first about {name}"
    frames = [np.eye(3)] + [x.R for x in second.tree.frames if x.joint == k]
    for frame in frames:
        axes = second.R[k] @ frame
        own, other = axes.T @ ours @ axes, axes.T @ theirs @ axes
        if largest(np.diag(np.diag(own)) - other) <= near:
            return "diagonal only: products of inertia are missing"
        for text, sign in (("xy", (0, 1)), ("xz", (0, 2)), ("yz", (1, 2))):
            flipped = own.copy()
            flipped[sign] *= -1.0
            flipped[sign[::-1]] *= -1.0
            if largest(flipped - other) <= near:
                return f"product {text} with the other sign"
        products = 2.0 * np.diag(np.diag(own)) - own
        if largest(products - other) <= near:
            return "products of inertia with the other sign"
    if largest(np.linalg.eigvalsh(ours) - np.linalg.eigvalsh(theirs)) <= near:
        return "rotated: the same principal moments along other axes"
    return ""


def _gravity_difference(first: _Side, second: _Side, near: float) -> Iterator[RobotDifference]:
    """Yield the difference between the accelerations of gravity."""
    x, y = first.tree.gravity, second.tree.gravity
    if largest(x - y) > near * max(largest(x), largest(y)):
        size = largest(x - y) / max(largest(x), largest(y))
        yield RobotDifference("world", "gravity", f"({_numbers(x)}), ({_numbers(y)}) m/s²", size)


BODY_NUMBERS = {"mass", "center of mass", "inertia", "gravity"}
"""Differences that change no other force than weight."""


def _force_differences(
    first: _Side, second: _Side, matched: Mapping[str, str], examples: int
) -> Iterator[RobotDifference]:
    """Yield the difference between forces other than weight of robots with the same joints.

    Their dampers and springs are the same, so that springs between points, constant torques and
    other forces remain.
    """
    columns, names = _columns(first, second, matched), first.scene.coordinate_names
    if columns is None:
        return
    near, random = Closeness.of(first, second).placement, np.random.default_rng(0)
    worst, scale = np.zeros(len(names)), 0.0
    for _ in range(examples):
        q, v = random.uniform(-1.0, 1.0, (2, len(names)))
        back = _moved_back(columns, q), _moved_back(columns, v)
        ours, size = _other_forces(first.scene, q, v)
        theirs, other_size = _other_forces(second.scene, *back)
        worst = np.maximum(worst, np.abs(ours - theirs[columns]))
        scale = max(scale, size, other_size)
    j = int(np.argmax(worst))
    if worst[j] > near * scale:
        text = f"springs between points, constant torques or others: up to {worst[j]:.3g} N m or N"
        yield RobotDifference(f"coordinate {names[j]}", "forces", text, float(worst[j] / scale))


def _other_forces(scene: Scene, q: Array, v: Array) -> tuple[Array, float]:
    """Return the generalized forces (n,) of a scene without weight, and the size of all of them."""
    at = Evaluation(scene, q, v)
    Q = np.zeros(scene.n) if at.terms.Q is None else np.asarray(at.terms.Q, np.float64)
    weight = ConformancePoint(at).weight.gradient
    return Q + weight, max(largest(Q), largest(weight))


def _constraint_differences(
    first: _Side, second: _Side, matched: Mapping[str, str], examples: int
) -> Iterator[RobotDifference]:
    """Yield the difference between the constraints of two robots whose joints are the same.

    They are compared at positions that satisfy those of the first: the distance to one that
    satisfies those of the second, and the directions in which both let the robot move.
    """
    columns = _columns(first, second, matched)
    if not (first.scene.r or second.scene.r) or columns is None:
        return
    near = Closeness.of(first, second).placement
    reach, worst = max(first.reach, second.reach), 0.0
    for _, (q, v, t) in state_cases(first.scene, examples, 0):
        ours = _Constraints.at(first.scene, q, v, t, near)
        theirs = _Constraints.at(second.scene, _moved_back(columns, q), 0.0 * v, t, near)
        back = theirs.projector[np.ix_(columns, columns)]
        if ours.rank != theirs.rank:
            text = (
                f"{counted(ours.rank, 'equation')} of {first.name}, {theirs.rank} of {second.name}"
            )
            yield RobotDifference("constraints", "number", text, 1.0)
            return
        turned = largest(ours.projector - back) / max(1.0, ours.condition, theirs.condition)
        own, apart = (x.distance * x.least / max(reach, 1.0) for x in (ours, theirs))
        worst = max(worst, turned, apart - 2.0 * own)
    if worst > near:
        text = "a position or motion that satisfies one does not satisfy the other"
        yield RobotDifference("constraints", "equations", text, min(1.0, worst))


class _Constraints(NamedTuple):
    """Constraints of a robot at a position, whatever rows they are written in."""

    projector: Array
    """Projector (n, n) onto the velocities that they exclude."""
    rank: int
    condition: float
    least: float
    """Least singular value of a that is none of rounding."""
    distance: float
    """Distance to a position that satisfies them, to first order."""

    @classmethod
    def at(cls, scene: Scene, q: Array, v: Array, t: float, near: float) -> _Constraints:
        """Return the constraints of a scene at a state; singular values of `near` are 0."""
        at = Evaluation(scene, q, v, t)
        a = np.zeros((0, scene.n)) if at.terms.a is None else np.asarray(at.terms.a, np.float64)
        left, sizes, right = np.linalg.svd(a, full_matrices=False)
        kept = sizes > near * max(1.0, largest(sizes))
        residual = np.zeros(len(a))
        if scene.position_residual is not None:
            at_q = at.parameters, at.prepared, at.q
            residual[scene.holonomic] = at.call(scene.position_residual, *at_q)
        steps = (left.T @ residual)[kept] / sizes[kept]
        least = float(sizes[kept].min(initial=np.inf))
        rows = right[kept]
        rank, condition = int(kept.sum()), float(largest(sizes) / least) if kept.any() else 1.0
        least = least if kept.any() else 0.0
        return cls(rows.T @ rows, rank, condition, least, float(np.linalg.norm(steps)))


def _columns(first: _Side, second: _Side, matched: Mapping[str, str]) -> list[int] | None:
    """Return the coordinate of the second for each of the first; None if they do not match."""
    names, others = first.scene.coordinate_names, second.scene.coordinate_names
    if any(matched.get(name) not in others for name in names) or len(names) != len(others):
        return None
    return [others.index(matched[name]) for name in names]


def _moved_back(columns: list[int], x: Array) -> Array:
    """Return coordinates of the first robot in the order of the second."""
    back = np.empty(len(columns))
    back[columns] = x
    return back


def _numbers(x: Iterable[float]) -> str:
    return ", ".join(f"{0.0 if abs(y) < 1e-12 else y:.6g}" for y in x)


def _both(x: float, y: float, unit: str = "") -> str:
    digits = next(d for d in (*range(6, 18), 17) if f"{x:.{d}g}" != f"{y:.{d}g}" or d == 17)
    return f"{x:.{digits}g}{unit}, {y:.{digits}g}{unit}"


def _relative(x: float, y: float) -> float:
    return abs(x - y) / max(abs(x), abs(y))


class BodyPair(NamedTuple):
    """Body of the first robot at its place in the second, both where all coordinates are 0."""

    name: str
    """Name of the body, as in `RobotDifference.where`."""
    body: RigidBody
    frames: tuple[TreeFrame, ...]
    """Frames of the links of the second that carry it."""


def body_pairs(first: Scene, second: Scene, comparison: RobotComparison) -> Iterator[BodyPair]:
    """Yield the bodies of the first robot at the places that they have in the second one."""
    sides = _Side(first), _Side(second)
    reach, near = max(side.reach for side in sides), Closeness.of(*sides)
    for pair in _placed_pairs(*sides, comparison.matched, reach, near):
        (j, k), R, (one, other) = pair.joints, pair.placement.R, sides
        center = pair.placement.point(one.center(j))
        body = RigidBody(float(one.tree.mass[j]), center, R @ one.inertia(j) @ R.T)
        frames = (
            TreeFrame(x.name, k, other.R[k] @ x.R, other.p[k] + other.R[k] @ x.p)
            for x in other.tree.frames
            if x.joint == k
        )
        yield BodyPair(one.body(j), body, tuple(frames))


# ---- Effects -------------------------------------------------------------------------------------


def _effects(
    first: _Side, second: _Side, matched: Mapping[str, str], examples: int
) -> Iterator[Effect]:
    """Yield the effects of all differences on M, gravity and accelerations, at the same q and v."""
    columns, names = _columns(first, second, matched), first.scene.coordinate_names
    if columns is None:
        return
    random, n = np.random.default_rng(0), first.scene.n
    values: dict[str, list[tuple[Array, Array]]] = {"M": [], "gravity": [], "acceleration": []}
    for _ in range(examples):
        q, v = random.uniform(-1.0, 1.0, (2, n))
        back = _moved_back(columns, q), _moved_back(columns, v)
        points = (
            ConformancePoint(Evaluation(first.scene, q, v), tau=np.zeros(n)),
            ConformancePoint(Evaluation(second.scene, *back), tau=np.zeros(n)),
        )
        for name, value in QUANTITIES.items():
            x, y = (np.asarray(value(point)) for point in points)
            values[name].append((x, y[np.ix_(*[columns] * y.ndim)]))
    for name, pairs in values.items():
        scale = max(largest(x) for pair in pairs for x in pair)
        errors = np.max([np.abs(x - y) for x, y in pairs], axis=0)
        worst = int(np.unravel_index(int(np.argmax(errors)), errors.shape)[0])
        yield Effect(name, float(errors.max() / scale) if scale else 0.0, names[worst])


QUANTITIES: dict[str, Callable[[ConformancePoint], Any]] = {
    "M": lambda point: point.at.terms.M,
    "gravity": lambda point: point.weight.gradient,
    "acceleration": lambda point: point.at.call(solve, point.at.terms.M, point.at.F, "M"),
}
"""Quantity whose change is measured -> its value at a point; M⁻¹ (Q - B) with all forces."""


# ---- Output --------------------------------------------------------------------------------------


def _resolution_in_words(resolution: float) -> str:
    """Return the reason why smaller differences between two robots do not count."""
    if resolution <= EPS:
        return "the rounding of float64"
    digits = round(1 - math.log10(2 * resolution))
    return (
        f"numbers are compared to {counted(digits, 'digit')}, as the files print no more or fewer "
        "than these; smaller differences may be their rounding"
    )


def print_robots(comparison: RobotComparison) -> None:
    """Print whether two robots are the same, and their differences, the largest first."""
    first, second = comparison.names
    if comparison.by_structure:
        pairs = ", ".join(f"{x} = {comparison.matched[x]}" for x in comparison.by_structure)
        say(f"matched by their place in the tree: {pairs}")
    unread = comparison.not_compared
    if comparison.is_same:
        same = "the same robot in all that is compared" if unread else "the same robot"
        say(
            f"{first} and {second} are {same}, to {comparison.resolution:.0e} of its size: "
            f"{counted(len(comparison.matched), 'joint')}",
            "bold yellow" if unread else "bold green",
        )
        say(f"{comparison.resolution:.0e}: {_resolution_in_words(comparison.resolution)}")
    for text in unread:
        say(f"not compared: {text}")
    if comparison.is_same:
        return
    number = counted(len(comparison.differences), "difference")
    say(f"{first} and {second} are two robots: {number}", "bold red")
    for difference in comparison.differences:
        say(f"  {difference}")
    for effect in comparison.effects:
        say(f"{effect.quantity} differs by up to {100 * effect.size:.3g} %, most at {effect.joint}")


def write_robots(comparison: RobotComparison, path: Path) -> None:
    """Write a comparison as JSON."""
    differences = [
        one._asdict() | {"size": one.size if np.isfinite(one.size) else None}
        for one in comparison.differences
    ]
    document = {
        "robots": list(comparison.names),
        "same": comparison.is_same,
        "resolution": comparison.resolution,
        "matched": comparison.matched,
        "by_structure": list(comparison.by_structure),
        "differences": differences,
        "effects": [effect._asdict() for effect in comparison.effects],
        "not_compared": list(comparison.not_compared),
    }
    write_json(path, document)
