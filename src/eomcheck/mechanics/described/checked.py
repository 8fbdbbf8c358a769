"""The words of a description, looked at before anything is made of them: each a clear sentence."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.described.closures import KINDS
from eomcheck.mechanics.described.topology import ROLLING
from eomcheck.mechanics.described.words import LONGEST, SHORTEST, Constraint, Joint, Link

COUNTS = {
    1: "a number",
    2: "two numbers",
    3: "three numbers",
    4: "four numbers",
    7: "three bends, three slopes and a level",
}

NOT_NEGATIVE = "expected a number that is not negative"

NUMBERS = {"distance": 1, "coupling": 2, "drive": 3, "on-quadric": 7, **dict.fromkeys(ROLLING, 1)}
"""Kind of constraint -> numbers that it has; others have none."""


LENGTHS = {"distance": "length", **dict.fromkeys(ROLLING, "radius")}
"""Kind of constraint -> what its number is, m."""


def all_of(what: str, kind: type, things: Any) -> tuple[Any, ...]:
    """Return links, joints or constraints as a tuple.

    Raises:
        InputError: they are none, or one of them has no name.
    """
    try:
        found = tuple(things)
    except TypeError:
        found = (things,)
    for one in found:
        if not isinstance(one, kind):
            raise InputError(f"{one!r} is no {what}: expected a {kind.__name__}")
        if not isinstance(one.name, str) or not one.name:
            raise InputError(f"a {what} has the name {one.name!r}, expected some text")
    return found


def check_words(
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: tuple[Constraint, ...],
    gravity: Any,
    pose: Any,
) -> None:
    """Refuse what is no number, has too few or too many, is not finite, or has no direction.

    Raises:
        InputError: names the word, what it has, and what is expected.
    """
    for link in links:
        _check_link(link)
    for joint in joints:
        _check_joint(joint)
    known: set[str] = set()
    for one in constraints:
        _check_constraint(one)
        if one.name in known:
            raise InputError(f"two constraints have the name {one.name!r}")
        known.add(one.name)
    if gravity is not None:
        _check_numbers("gravity", gravity, 3)
    if not isinstance(pose, Mapping):
        raise InputError(f"pose = {pose!r}, expected coordinates by name")
    for name, x in pose.items():
        _check_numbers(f"pose: {name}", x)


def _check_link(link: Link) -> None:
    said = f"link {link.name!r}"
    _check_numbers(f"{said}: mass", link.mass)
    if link.mass < 0:
        raise InputError(f"{said}: mass = {link.mass:g} kg, {NOT_NEGATIVE}")
    for name in ("center", "moments", "products"):
        _check_numbers(f"{said}: {name}", getattr(link, name), 3)


def _check_joint(joint: Joint) -> None:
    said = f"joint {joint.name!r}"
    _check_numbers(f"{said}: place", joint.place, 3)
    _check_length(f"{said} has the turn", joint.turn, 4)
    if joint.kind in ("revolute", "prismatic", "planar"):
        _check_length(f"{said} has the axis", joint.axis, 3)
    for name in ("damping", "stiffness", "armature"):
        value = getattr(joint, name)
        if value is not None:
            _check_numbers(f"{said}: {name}", value)
            if value < 0:
                raise InputError(f"{said}: {name} = {value:g}, {NOT_NEGATIVE}")
    _check_numbers(f"{said}: relaxed", joint.relaxed)
    if joint.follows is not None:
        if not isinstance(joint.follows, tuple | list) or len(joint.follows) != 3:
            wanted = "expected a joint, a ratio and a shift"
            raise InputError(f"{said}: follows = {joint.follows!r}, {wanted}")
        _check_numbers(f"{said}: follows", joint.follows[1:], 2)


def _check_constraint(one: Constraint) -> None:
    said = f"constraint {one.name!r}"
    if one.kind not in KINDS:
        kinds = ", ".join(KINDS)
        raise InputError(f"{said} has the kind {one.kind!r}, expected one of: {kinds}")
    for link, at in one.points:
        _check_numbers(f"{said}: a point of {link!r}", at, 3)
    for link, along in one.directions:
        _check_length(f"{said}, on {link!r}, has the direction", along, 3)
    points, directions = ([link for link, _ in of] for of in (one.points, one.directions))
    for names in (points, () if one.kind in ROLLING else directions, one.joints):
        if len(names) == 2 and names[0] == names[1]:
            raise InputError(f"{said} is between {names[0]!r} and itself")
    if one.kind in NUMBERS:
        _check_numbers(f"{said}: its numbers", one.numbers, NUMBERS[one.kind])
        if one.kind in LENGTHS and one.numbers <= 0:
            what = LENGTHS[one.kind]
            raise InputError(f"{said}: {what} = {one.numbers} m, expected a positive number")
        if one.kind == "on-quadric" and not any(one.numbers[:6]):
            raise InputError(f"{said}: bends and slopes are 0, expected some that are not")


def _check_numbers(said: str, value: Any, count: int = 1, sign: str = " = ") -> None:
    parts = (value,) if count == 1 else value
    whole = isinstance(parts, tuple | list | np.ndarray) and len(parts) == count
    if not whole or not all(isinstance(x, Real) and not isinstance(x, bool) for x in parts):
        raise InputError(f"{said}{sign}{value!r}, expected {COUNTS[count]}")
    if not all(math.isfinite(x) for x in parts):
        finite = "a finite number" if count == 1 else "finite ones"
        raise InputError(f"{said}{sign}{value!r}, expected {finite}")


def _check_length(said: str, value: Any, count: int) -> None:
    _check_numbers(said, value, count, " ")
    length = math.hypot(*value)
    if length == 0:
        raise InputError(f"{said} ({', '.join(['0'] * count)})")
    if not SHORTEST <= length <= LONGEST:
        between = f"expected a length between {SHORTEST:g} and {LONGEST:g}"
        raise InputError(f"{said} {value!r}, {between}")
