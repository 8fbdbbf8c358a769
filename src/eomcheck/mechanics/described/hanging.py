"""Links and joints by name, in the order of a walk through their tree: depth first."""

from __future__ import annotations

from collections import deque
from typing import Any

from eomcheck.errors import InputError
from eomcheck.mechanics.described.words import Joint, Link


def hanging(links: dict[str, Link], joints: dict[str, Joint]) -> tuple[str, list[Joint]]:
    """Return the link that is the ground, and the joints from it outwards.

    What hangs on a joint follows it before anything else does.

    Raises:
        InputError: they are no tree.
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
        said = ", ".join(map(repr, roots[:3])) + (", ..." if len(roots) > 3 else "")
        raise InputError(f"{len(roots)} links are no joint's child ({said}), expected one root")
    if not links:
        raise InputError("there is no link")
    if not roots:
        around = _circle(next(iter(links)), joints, child_of)
        raise InputError(f"every link is a joint's child: {around}")
    found, waiting = [], deque(children[roots[0]])
    while waiting:
        joint = waiting.popleft()
        found.append(joint)
        waiting.extendleft(reversed(children[joint.child]))
    if len(found) < len(joints):
        reached = {roots[0], *(joint.child for joint in found)}
        left = next(name for name in links if name not in reached)
        raise InputError(f"links go round in a circle: {_circle(left, joints, child_of)}")
    return roots[0], found


def _circle(at: str, joints: dict[str, Joint], child_of: dict[str, str]) -> str:
    """Return the links in a circle that hang on each other, at most five of them."""
    seen: dict[str, None] = {}
    while at not in seen:
        seen[at] = None
        at = joints[child_of[at]].parent
    around = list(seen)
    around = around[around.index(at) :]
    said = " <- ".join(map(repr, around[:4]))
    return said + (" <- ..." if len(around) > 4 else f" <- {at!r}")


def by_name(what: str, things: tuple[Any, ...]) -> dict[str, Any]:
    """Return links or joints by their names.

    Raises:
        InputError: two have the same.
    """
    found: dict[str, Any] = {}
    for one in things:
        if one.name in found:
            raise InputError(f"two {what}s have the name {one.name!r}")
        found[one.name] = one
    return found
