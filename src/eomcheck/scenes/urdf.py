"""A robot in a URDF file as a scene.

The reader is our own, on the XML parser of the standard library: what other libraries make of the
same file is something to compare with. What a file holds beside rigid bodies and ideal joints is
left out, and said in one sentence; what is not understood is refused.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from eomcheck.errors import InputError
from eomcheck.mechanics.described.build import described
from eomcheck.mechanics.described.mechanism import Mechanism
from eomcheck.mechanics.described.quaternions import (
    ONE,
    Quaternion,
    multiplied,
    roll_pitch_yaw,
    rotation,
)
from eomcheck.mechanics.described.words import ORIGIN, Joint, Link, Triple
from eomcheck.mechanics.scene import finite_array
from eomcheck.scenes.urdf_xml import (
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


def from_urdf(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> Mechanism:
    """Return the robot in a URDF file, with the parameters of the file.

    Its coordinates are those of the file's joints, in their order; fixed joints have none, nor have
    joints that mimic others. Its `made.left_out` says what of the file is left out.

    Args:
        path: the file.
        floating: whether its root is free to move: three slides, then turns about z, y and x, come
            first. Otherwise the root is fixed to the ground.
        gravity: acceleration, m/s², or None without.

    Raises:
        InputError: the file cannot be read, is no URDF, contradicts itself, has more than
            200 coordinates, or a joint that moves nothing.
    """
    return urdf_kind(path, floating=floating, gravity=gravity)()


def urdf_kind(
    path: str | os.PathLike[str],
    *,
    floating: bool = False,
    gravity: Triple | None = (0.0, 0.0, -9.81),
) -> type[Mechanism]:
    """Return the kind of scene of which `from_urdf` returns the one with the file's parameters."""
    try:
        file = Path(path)
    except TypeError:
        raise InputError(f"path = {path!r}, expected the path of a URDF file") from None
    if gravity is not None:
        x, y, z = finite_array("gravity", gravity, (3,)).tolist()
        gravity = x, y, z
    robot = read_urdf(file)
    options = (", floating=True" if floating else "") + (
        "" if gravity == (0.0, 0.0, -9.81) else f", gravity={gravity!r}"
    )
    links, joints = _floating(robot) if floating else (robot.links, robot.joints)
    try:
        made = described(robot.name, links, joints, gravity=gravity)
        return made._replace(
            code=f"from_urdf({str(path)!r}{options})",
            imported="from eomcheck.scenes import from_urdf",
            left_out=robot.left_out,
            source=str(file),
            floating=joints[0].name if floating else "",
        ).kind()
    except Unreadable:
        raise
    except InputError as error:
        raise Unreadable(f"{str(path)!r}: {error}") from None


def _floating(robot: Robot) -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    """Return links and joints with the root on a floating joint of its name, which comes first."""
    children = {joint.child for joint in robot.joints}
    roots = [link.name for link in robot.links if link.name not in children]
    if len(roots) != 1:
        return robot.links, robot.joints  # which is refused there
    ground = "the ground"
    joint = Joint(roots[0], "floating", ground, roots[0])
    return (Link(ground), *robot.links), (joint, *robot.joints)


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
    if not joints:
        raise Unreadable(f"{where!r} has no joint")
    out = Counter(others(root, READ | OF_ROBOT, repr(where)))
    out = Counter({tag: count for tag, count in out.items() if tag in OF_ROBOT})
    name = re.sub(r"\W+", "_", root.get("name", "") or path.stem).strip("_") or "robot"
    name = name if name.isidentifier() else f"robot_{name}"
    read_links = tuple(_link(one, where, out) for one in links)
    read_joints = tuple(_joint(one, where, out) for one in joints)
    said = ", ".join(f"{_PLURAL.get(tag, tag)} ({count})" for tag, count in sorted(out.items()))
    return Robot(name, read_links, read_joints, f"Left out: {said}." if said else "")


_PLURAL = {
    "limit": "limits of joints",
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
    moves = kind in ("revolute", "continuous", "prismatic")
    if dynamics is not None and moves:
        damping = number(dynamics, "damping", where, 0.0)
        if damping < 0:
            raise Unreadable(f"{where}: damping = {damping:g}, expected a number not below 0")
        more["damping"] = damping or None
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
