"""Random constraints of random trees: satisfied in the pose of the tree, their rows independent.

A constraint is constructed from the positions of the links in the pose of the tree (`poses`), so
that it holds there. It is accepted if its rows of a, with the previous ones, are far from
dependent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import qr

from eomcheck.descriptions import random_elements
from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.elements import (
    COORDINATES,
    Constraint,
    Triple,
    coupling,
    distance,
    drive,
    hinge,
    knife_edge,
    on_plane,
    on_quadric,
    perpendicular,
    pin,
    rolling_ball,
    rolling_circle,
    rolling_disk,
    weld,
)
from eomcheck.descriptions.quaternions import multiply_quaternions
from eomcheck.descriptions.random_elements import GROUND, Pose, RandomDescription, poses
from eomcheck.descriptions.random_trees import TURNING
from eomcheck.descriptions.topology import ROLLING
from eomcheck.errors import RefusedError
from eomcheck.mechanics.random_source import Choices
from eomcheck.numbers.generic import FLOAT64, Array

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
        found = tree._replace(constraints=(*tree.constraints, *more), dependent=())
        a = _jacobian(found)
        rows = np.linalg.norm(a, axis=1, keepdims=True)
        if not rows.all():
            continue  # a constraint that holds anyway
        size = np.linalg.svd(a / rows, compute_uv=False)[-1]
        if size >= INDEPENDENT:
            *_, order = qr(a / rows, mode="r", pivoting=True)
            first = (found.coordinates[i] for i in order[: len(a)])
            return found._replace(dependent=tuple(first))
    said = f"no independent {kind} is found among {ATTEMPTS}"
    raise RefusedError("a", float(size), INDEPENDENT, said)


def _jacobian(description: RandomDescription) -> Array:
    """Return the constraint Jacobian a (r, n) in the pose, columns in the order of the joints."""
    scene = description.source("Closed").scene_class()()
    given, q = scene.parameters(FLOAT64), np.array([x for _, x in description.pose])
    return scene.constraints(given, scene.prepare(FLOAT64, given, q, 0.0), q)[0]


# ---- Constraints that fit a pose -----------------------------------------------------------------


def _constraint(
    tree: RandomDescription, kind: str, planar: bool, choices: Choices
) -> tuple[Constraint, ...] | None:
    """Return the constraints that hold in the pose; None if no two links can have such a one.

    There is one, except that a rolling contact has several.
    """
    name = f"c{len(tree.constraints) + 1}"
    if kind in ("coupling", "drive"):
        found = _of_coordinates(tree, kind, name, choices)
        return None if found is None else (found,)
    pairs = (
        _turning(tree)
        if kind == "square"
        else _pairs(tree, row_count_with_contact(kind, planar), kind == "edge")
    )
    if not pairs:
        return None
    link, other = choices.one_of(pairs)
    there = poses(tree)
    at = random_elements.random_triple(choices, planar)
    here = name, link, other, at, there[link], there[other], planar, choices
    if kind in ROLLING:
        up, *slips = _rolling(*here)
        return (*slips, up) if kind == "rolling" else (up,)
    return (_FITTING[kind](*here),)


def _pairs(tree: RandomDescription, rows: int, alone: bool) -> list[tuple[str, str]]:
    """Return the pairs of links with at least `rows` coordinates of relative motion."""
    before: dict[str, frozenset[str]] = {GROUND: frozenset()}
    for joint in tree.joints:
        own = joint.name if joint.mimics is None else joint.mimics[0]
        here = {own + part for part in COORDINATES[joint.kind]}
        before[joint.child] = before[joint.parent] ^ here
    names = list(before)
    return [
        (link, other)
        for i, link in enumerate(names)
        for other in (names[:1] if alone else names[:i])
        if len(before[link] ^ before[other]) >= rows
    ]


def _turning(tree: RandomDescription) -> list[tuple[str, str]]:
    """Return the pairs of links between which some joint turns."""
    before: dict[str, frozenset[str]] = {GROUND: frozenset()}
    for joint in tree.joints:
        here = {joint.name} if joint.kind in TURNING else set()
        before[joint.child] = before[joint.parent] ^ here
    return [
        (link, other)
        for i, link in enumerate(before)
        for other in list(before)[:i]
        if before[link] != before[other]
    ]


def _of_coordinates(
    tree: RandomDescription, kind: str, name: str, choices: Choices
) -> Constraint | None:
    """Return a constraint of coordinates; not of hinges that must avoid a singular pose."""
    q = {one: x for one, x in tree.pose if not one.endswith("_pitch")}
    if len(q) < (1 if kind == "drive" else 2):
        return None
    i = choices.one_of(list(q))
    if kind == "drive":
        return drive(name, i, q[i], choices.number(-1.0, 1.0), choices.number(-0.1, 0.1))
    j = choices.one_of([one for one in q if one != i])
    ratio = choices.one_of((1.0, -1.0)) * choices.number(0.2, 2.0)
    return coupling(name, i, j, ratio, q[i] - ratio * q[j])


Fitting = Callable[..., Constraint]


def _pin(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, *_: Any
) -> Constraint:
    return pin(name, link, other, at, there.local_point(here.point(at)))


def _weld(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, *_: Any
) -> Constraint:
    w, x, y, z = here.orientation
    turn = multiply_quaternions((w, -x, -y, -z), there.orientation)
    return weld(name, link, other, at, there.local_point(here.point(at)), turn)


def _hinge(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    axis = random_elements.random_direction(choices, planar=False)
    own = there.local_point(here.point(at)), axis, there.local_direction(here.direction(axis))
    return hinge(name, link, other, at, *own)


def _distance(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    at_other = random_elements.random_triple(choices, planar)
    rod = here.point(at) - there.point(at_other)
    if np.linalg.norm(rod) < 5 * random_elements.SMALLEST:
        rod = np.array([1.0, 0.0, 0.0])
        at_other = there.local_point(here.point(at) - rod)
    return distance(name, link, other, float(np.linalg.norm(rod)), at, at_other)


def _on_plane(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    across = random_elements.random_direction(choices, planar)
    normal, away = np.asarray(across), np.asarray(random_elements.random_triple(choices, planar))
    along = away - away @ normal / (normal @ normal) * normal
    x, y, z = (np.asarray(there.local_point(here.point(at))) - along).tolist()
    return on_plane(name, link, other, across, at, (x, y, z))


def _on_quadric(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    """Return an on-quadric constraint whose surface passes through the point, with a slope."""
    bends, s = (np.array([choices.number(-1.0, 1.0) for _ in range(3)]) for _ in range(2))
    s[2] = 0.0 if planar else s[2]
    along = np.asarray(random_elements.random_direction(choices, planar))
    slopes = along / np.linalg.norm(along) - bends * s
    level = float((bends * s * s / 2 + slopes * s).sum())
    surface = _triple(bends), level, _triple(slopes)
    at_other = _triple(np.asarray(there.local_point(here.point(at))) - s)
    return on_quadric(name, link, other, *surface, at, at_other)


def _triple(a: Array) -> Triple:
    x, y, z = a.tolist()
    return x, y, z


def _square(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    along, away = random_elements.random_direction(choices, planar), np.array([0.0, 0.0, 1.0])
    if not planar:
        away = np.asarray(random_elements.random_transverse(choices, along))
    across = there.local_direction(here.direction(np.cross(along, away)))
    return perpendicular(name, link, along, other, across)


def _edge(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> Constraint:  # fmt: skip
    return knife_edge(name, link, random_elements.random_direction(choices, planar), at)


def _rolling(
    name: str, link: str, other: str, at: Triple, here: Pose, there: Pose, planar: bool,
    choices: Choices,
) -> tuple[Constraint, ...]:  # fmt: skip
    """Return the constraints of a rolling ball, disk or (in the plane) circle, contact first."""
    radius = choices.number(0.2, 1.0)
    across = np.asarray(random_elements.random_direction(choices, planar))
    normal = across / np.linalg.norm(across)
    is_disk = not planar and choices.one_of((False, True))
    if is_disk:
        axis = _upright(choices, np.asarray(here.local_direction(there.direction(normal))))
        n = here.direction(axis) / np.linalg.norm(axis)
        up = there.direction(normal)
        rim = up - up @ n * n
        arm = -radius * rim / np.linalg.norm(rim)
    else:
        axis, arm = None, -radius * there.direction(normal)
    aside = np.asarray(random_elements.random_triple(choices, planar))
    aside -= aside @ normal * normal
    x, y, z = (np.asarray(there.local_point(here.point(at) + arm)) + aside).tolist()
    given = name, link, other, radius
    if planar:
        left_x, left_y, _ = normal.tolist()
        return rolling_circle(*given, (left_y, -left_x, 0.0), at, (x, y, 0.0))
    a, b, c = normal.tolist()
    if axis is None:
        return rolling_ball(*given, at, (x, y, z), (a, b, c))
    return rolling_disk(*given, at, (x, y, z), axis, (a, b, c))


def _upright(choices: Choices, normal: Array) -> Triple:
    """Return an axis that is far from parallel to a normal (3,) of length 1."""
    axis = random_elements.random_direction(choices, planar=False)
    if np.linalg.norm(np.cross(normal, axis)) >= UPRIGHT * np.linalg.norm(axis):
        return axis
    x, y, z = np.eye(3)[np.argmin(np.abs(normal))].tolist()
    return x, y, z


_FITTING: dict[str, Fitting] = {
    "pin": _pin,
    "weld": _weld,
    "hinge": _hinge,
    "distance": _distance,
    "on-plane": _on_plane,
    "on-quadric": _on_quadric,
    "square": _square,
    "edge": _edge,
}
