"""What a URDF file says of a robot, in the words of a description."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from eomcheck.mechanics.described.quaternions import (
    ONE,
    Quaternion,
    multiplied,
    roll_pitch_yaw,
    rotation,
)
from eomcheck.mechanics.described.words import ORIGIN, Joint, Link, Triple
from eomcheck.robots.urdf_xml import (
    Element,
    Unreadable,
    number,
    only,
    others,
    root_of,
    text,
    triple,
)

KINDS = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "floating",
    "planar": "planar",
    "spherical": "spherical",
}

MOST = 5000
"""Links or joints that a file may have, those that are fixed included."""

READ = frozenset({"link", "joint"})
OF_ROBOT = frozenset(
    {"material", "transmission", "gazebo", "sensor", "ros2_control", "mujoco", "deformable"}
)
OF_LINK = frozenset(
    {"visual", "collision", "contact", "self_collision_checking", "collision_checking",
     "self_filter", "surface", "kinematic", "gravity", "origin", "gazebo"}
)  # fmt: skip
OF_JOINT = frozenset({"limit", "safety_controller", "calibration", "joint_properties", "gazebo"})


class Robot(NamedTuple):
    """What a file says."""

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    left_out: str
    """What of the file is not in it, in one sentence; "" if all is."""


def read_urdf(path: Path) -> Robot:
    """Return what a URDF file says.

    Raises:
        InputError: see `from_urdf`.
    """
    root, where = root_of(path), str(path)
    links, joints = root.findall("link"), root.findall("joint")
    for what, found in (("links", links), ("joints", joints)):
        if len(found) > MOST:
            raise Unreadable(f"{where!r} has {len(found)} {what}, expected at most {MOST}")
    if not links:
        raise Unreadable(f"{where!r} has no link")
    out = Counter(others(root, READ | OF_ROBOT, repr(where)))
    out = Counter({tag: count for tag, count in out.items() if tag in OF_ROBOT})
    name = identifier(root.get("name", "") or path.stem)
    read_links = tuple(_link(one, where, out) for one in links)
    read_joints = tuple(_joint(one, where, out) for one in joints)
    return Robot(name, read_links, read_joints, left_out(out))


def identifier(name: str) -> str:
    """Return what a robot of this name is called in Python."""
    name = re.sub(r"\W+", "_", name).strip("_") or "robot"
    return name if name.isidentifier() else f"robot_{name}"


def left_out(counts: Counter[str]) -> str:
    """Return in one sentence what of a file is left out, and how much of it; "" of nothing."""
    some = sorted((tag, count) for tag, count in counts.items() if count)
    said = ", ".join(f"{_PLURAL.get(tag, tag)} ({count})" for tag, count in some)
    return f"Left out: {said}." if said else ""


_PLURAL = {
    "limit": "limits of joints",
    "damping": "dampers of joints with several coordinates",
    "friction": "friction of joints",
    "transmission": "transmissions",
    "material": "materials",
    "visual": "shapes to be seen",
    "collision": "shapes to collide",
    "contact": "contacts",
    "gazebo": "settings of Gazebo",
    "sensor": "sensors",
    "safety_controller": "safety controllers",
    "calibration": "calibrations",
}


def _link(element: Element, file: str, out: Counter[str]) -> Link:
    name = text(element, "name", repr(file))
    where = f"{file!r}: link {name!r}"
    out.update(tag for tag in others(element, OF_LINK | {"inertial"}, where) if tag != "inertial")
    inertial = only(element, "inertial", where)
    if inertial is None:
        return Link(name)
    mass, inertia = (only(inertial, tag, where) for tag in ("mass", "inertia"))
    if mass is None or inertia is None:
        missing = "mass" if mass is None else "inertia"
        raise Unreadable(f"{where}: <inertial> has no <{missing}>")
    center, turn = _origin(inertial, where)
    heavy = number(mass, "value", where)
    if heavy < 0:
        said = "expected a number that is not negative"
        raise Unreadable(f"{where}: mass = {heavy:g} kg, {said}")
    xx, yy, zz, xy, xz, yz = (
        number(inertia, f"i{axes}", where) for axes in ("xx", "yy", "zz", "xy", "xz", "yz")
    )
    if turn != ONE:
        R = rotation(turn)
        I = (R @ [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] @ R.T).tolist()  # noqa: E741
        xx, yy, zz, xy, xz, yz = I[0][0], I[1][1], I[2][2], I[0][1], I[0][2], I[1][2]
    return Link(name, heavy, center, (xx, yy, zz), (xy, xz, yz))


def _joint(element: Element, file: str, out: Counter[str]) -> Joint:
    name = text(element, "name", repr(file))
    where = f"{file!r}: joint {name!r}"
    known = frozenset({"parent", "child", "origin", "axis", "dynamics", "mimic"})
    out.update(tag for tag in others(element, OF_JOINT | known, where) if tag not in known)
    kind = text(element, "type", where)
    if kind not in KINDS:
        raise Unreadable(f"{where} has the type {kind!r}, expected one of: {', '.join(KINDS)}")
    ends = [only(element, tag, where) for tag in ("parent", "child")]
    for tag, end in zip(("parent", "child"), ends, strict=True):
        if end is None:
            raise Unreadable(f"{where} has no <{tag}>")
    parent, child = (text(end, "link", where) for end in ends if end is not None)
    place, turn = _origin(element, where)
    axis = only(element, "axis", where)
    more: dict[str, Any] = {}
    if axis is not None:
        more["axis"] = triple(axis, "xyz", where, (1.0, 0.0, 0.0))
    else:
        more["axis"] = (1.0, 0.0, 0.0)
    dynamics, mimic = only(element, "dynamics", where), only(element, "mimic", where)
    if dynamics is not None and kind != "fixed":
        damping = number(dynamics, "damping", where, 0.0)
        if damping < 0:
            raise Unreadable(f"{where}: damping = {damping:g}, expected a number not below 0")
        if kind in ("revolute", "continuous", "prismatic"):
            more["damping"] = damping or None
        elif damping:
            out["damping"] += 1
        if number(dynamics, "friction", where, 0.0):
            out["friction"] += 1
    if mimic is not None and kind != "fixed":
        ratio, shift = (
            number(mimic, what, where, default)
            for what, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        more["follows"] = text(mimic, "joint", where), ratio, shift
    return Joint(name, KINDS[kind], parent, child, place, turn, **more)


def _origin(element: Element, where: str) -> tuple[Triple, Quaternion]:
    origin = only(element, "origin", where)
    if origin is None:
        return ORIGIN, ONE
    turn = roll_pitch_yaw(*triple(origin, "rpy", where, ORIGIN))
    return triple(origin, "xyz", where, ORIGIN), multiplied(ONE, turn)
