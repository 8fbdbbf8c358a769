"""Random trees as URDF texts: for `from_urdf`, and for the parsers of engines."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from eomcheck.mechanics.choices import Choices
from eomcheck.mechanics.described.quaternions import roll_pitch_yaw_of, rotation
from eomcheck.mechanics.described.words import Joint, Link
from eomcheck.random_mechanisms.description import GROUND, Description
from eomcheck.random_mechanisms.trees import (
    ABSENT,
    CARRIERS,
    DAMPERS,
    FOLLOWERS,
    GRAVITY,
    PRESENT,
    PROPERTIES,
    SOLID,
    rooms,
    tree,
    tree_ways,
)

EVERYWHERE = ("revolute", "prismatic", "fixed")
"""Kinds of joints that all parsers know."""

URDF_JOINTS = frozenset({*EVERYWHERE, "planar", "floating"})
"""Kinds of joints that a URDF may have."""


def urdf_tree(
    links: int,
    choices: Choices,
    joints: tuple[str, ...] = EVERYWHERE,
    mimic: bool = True,
    massless: bool = True,
    dampers: bool = True,
) -> Description:
    """Return a tree in space of which a URDF can tell everything, its joints in any order.

    Args:
        links: number of links, the ground not counted.
        choices: what chooses.
        joints: kinds that there may be, "revolute" among them.
        mimic: whether some joints may follow others.
        massless: whether some links may have no inertia.
        dampers: whether some joints may have dampers.
    """
    among = frozenset(joints)
    either = (room for room in rooms(links, among) if room.space == SOLID)
    entry = choices.one_of([tree_ways(room, links) for room in either])
    ways = {name: choices.one_of(of) for name, of in entry.items()}
    ways |= dict.fromkeys((*PROPERTIES, GRAVITY), ABSENT)
    if dampers and PRESENT in entry[DAMPERS]:
        ways[DAMPERS] = choices.one_of((ABSENT, PRESENT))
    ways |= {} if mimic else {FOLLOWERS: ABSENT}
    ways |= {} if massless else {CARRIERS: ABSENT}
    found = tree(ways, links, choices, among=among)
    left, order = list(found.joints), []
    while left:
        order.append(left.pop(choices.whole(0, len(left) - 1)))
    frames = found.links if massless else tuple(_with_inertia(one) for one in found.links)
    return found._replace(links=frames, joints=tuple(order))


def _with_inertia(link: Link) -> Link:
    if link.mass > 0 or link.name == GROUND:
        return link
    return link._replace(mass=0.1, moments=(0.01, 0.01, 0.01))


def urdf_text(description: Description, name: str = "robot") -> str:
    """Return the URDF of a tree, every number with all its digits.

    What a URDF cannot tell is not in it: gravity, springs, rotors, constraints. Of a revolute joint
    without limits it says that it is continuous; where joints slide limits have to be given, and
    mean nothing here.
    """
    robot = ElementTree.Element("robot", name=name)
    for link in description.links:
        _add_link(robot, link)
    for joint in description.joints:
        _add_joint(robot, joint)
    ElementTree.indent(robot)  # some parsers cut long lines off
    return ElementTree.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: ElementTree.Element, link: Link) -> None:
    element = _child(robot, "link", name=link.name)
    if not any((link.mass, *link.moments, *link.products)):
        return
    inertial = _child(element, "inertial")
    _child(inertial, "origin", xyz=_text(link.center), rpy="0 0 0")
    _child(inertial, "mass", value=repr(float(link.mass)))
    entries = (*link.moments, *link.products)
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    _child(
        inertial, "inertia", **{of: repr(float(x)) for of, x in zip(names, entries, strict=True)}
    )


def _add_joint(robot: ElementTree.Element, joint: Joint) -> None:
    kind = {"revolute": "continuous"}.get(joint.kind, joint.kind)
    element = _child(robot, "joint", name=joint.name, type=kind)
    _child(element, "parent", link=joint.parent)
    _child(element, "child", link=joint.child)
    _child(
        element,
        "origin",
        xyz=_text(joint.place),
        rpy=_text(roll_pitch_yaw_of(rotation(joint.turn))),
    )
    if joint.kind not in ("fixed", "floating", "spherical"):
        size = math.hypot(*joint.axis)  # parsers do not all make it 1
        _child(element, "axis", xyz=_text(tuple(x / size for x in joint.axis)))
    if joint.kind == "prismatic":
        _child(element, "limit", lower="-10", upper="10", effort="1e3", velocity="1e3")
    if joint.damping is not None:
        _child(element, "dynamics", damping=repr(float(joint.damping)), friction="0")
    if joint.follows is not None:
        leader, ratio, shift = joint.follows
        _child(
            element, "mimic", joint=leader, multiplier=repr(float(ratio)), offset=repr(float(shift))
        )


def _child(element: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(element, tag, attributes)


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(repr(float(x)) for x in numbers)
