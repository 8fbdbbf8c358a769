"""What a robot description names: its joints in the order of the file, and its shapes taken out."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

SHAPES = "visual", "collision"
ENTRIES = "ixx", "iyy", "izz", "ixy", "ixz", "iyz"
TOUCHING = 1e-9
"""Relative: a plate's largest moment is the sum of the others, and files have few digits."""


class Mimic(NamedTuple):
    """A joint that follows another one: x = multiplier * x of that one + offset."""

    joint: str
    multiplier: float
    offset: float


class Description(NamedTuple):
    """A URDF for libraries that read it themselves.

    Shapes are taken out: meshes are often not there, and no equation of motion needs them.
    """

    text: str
    root: str
    """Name of the link that no joint moves."""
    joints: tuple[str, ...]
    """Names of the joints that move, fixed ones left out."""
    continuous: frozenset[str]
    """Those that turn without limits."""
    mimics: dict[str, Mimic]
    """Joint -> what it follows."""
    massless: tuple[str, ...]
    """Links without mass that have moments of inertia all the same."""
    impossible: tuple[str, ...]
    """Links whose moments of inertia are not those of any body: one exceeds the other two."""
    damped: tuple[str, ...]
    """Joints with viscous damping."""
    rubbed: tuple[str, ...]
    """Joints with dry friction."""


def described(path: Path) -> Description:
    """Return what is in a file that `eomcheck.scenes.from_urdf` has read already."""
    robot = ElementTree.parse(path).getroot()
    joints = robot.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}  # type: ignore[union-attr]
    root = next(x.get("name", "") for x in robot.findall("link") if x.get("name") not in children)
    moving = [joint for joint in joints if joint.get("type") != "fixed"]
    mimics = {}
    for joint in moving:
        follows = joint.find("mimic")
        if follows is not None:
            numbers = float(follows.get("multiplier", 1)), float(follows.get("offset", 0))
            mimics[joint.get("name", "")] = Mimic(follows.get("joint", ""), *numbers)
    massless = [link.get("name", "") for link in robot.findall("link") if _only_inertia(link)]
    for link in robot.findall("link"):
        for shape in [x for kind in SHAPES for x in link.findall(kind)]:
            link.remove(shape)
    return Description(
        ElementTree.tostring(robot, encoding="unicode"),
        root,
        tuple(joint.get("name", "") for joint in moving),
        frozenset(x.get("name", "") for x in moving if x.get("type") == "continuous"),
        mimics,
        tuple(massless),
        tuple(link.get("name", "") for link in robot.findall("link") if _impossible(link)),
        _with(moving, "damping"),
        _with(moving, "friction"),
    )


def _only_inertia(link: ElementTree.Element) -> bool:
    mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
    if mass is None or inertia is None or float(mass.get("value", 0)) != 0:
        return False
    return any(float(x) != 0 for x in inertia.attrib.values())


def _impossible(link: ElementTree.Element) -> bool:
    inertia = link.find("inertial/inertia")
    if inertia is None:
        return False
    x, y, z, xy, xz, yz = (float(inertia.get(name, 0)) for name in ENTRIES)
    moments = np.linalg.eigvalsh([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
    return bool(moments[2] > moments[:2].sum() * (1 + TOUCHING) or moments[0] < 0)


def _with(joints: list[ElementTree.Element], what: str) -> tuple[str, ...]:
    dynamics = ((x.get("name", ""), x.find("dynamics")) for x in joints)
    return tuple(name for name, x in dynamics if x is not None and float(x.get(what, 0)) != 0)
