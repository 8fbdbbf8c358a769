"""A robot description for libraries that read it themselves, and what is odd about it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Set
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from eomcheck.descriptions.elements import Joint, Link
from eomcheck.descriptions.joint_tree import impossible
from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.urdf_reader import Element, read_urdf, root_of
from eomcheck.engines.files.free import FREE
from eomcheck.mechanics.scene import Scene

SHAPES = "visual", "collision"


class Description(NamedTuple):
    """A URDF without shapes: meshes are often not there, and no equation of motion needs them."""

    text: str
    root: str
    """Name of the link that no joint moves."""
    follows: dict[str, tuple[str, float, float]]
    """Joint -> the one that it follows, ratio and shift."""
    damped: frozenset[str]
    """Joints with viscous damping."""
    massless: tuple[str, ...]
    """Links without mass that have moments of inertia all the same."""
    empty: tuple[str, ...]
    """Links that are moved and have no inertia at all."""
    impossible: tuple[str, ...]
    """Links with moments of inertia that no body has: one exceeds the sum of the others."""


def file_of(scene: Scene) -> Path | None:
    """Return the URDF of a robot that has the parameters of its file; None of any other scene."""
    if not (isinstance(scene, Mechanism) and scene.made.format == "urdf" and scene.as_described):
        return None
    first = FREE if is_free(scene) else 0
    # What has more coordinates has names of its own for them.
    named = {slot.name for slot in scene.plan.slots[:first]}
    return Path(scene.made.source) if set(scene.made.several) <= named else None


def is_free(scene: Scene) -> bool:
    """Return whether a robot's base is free because that was asked for."""
    return isinstance(scene, Mechanism) and bool(scene.made.floating)


def described(path: Path) -> Description:
    """Return what is in a URDF.

    Raises:
        InputError: see `eomcheck.scenes.from_urdf`.
    """
    robot, xml = read_urdf(path), root_of(path)
    for link in xml.findall("link"):
        for shape in [x for kind in SHAPES for x in link.findall(kind)]:
            link.remove(shape)
    children = {joint.child for joint in robot.joints}
    return Description(
        ElementTree.tostring(xml, encoding="unicode"),
        next(link.name for link in robot.links if link.name not in children),
        dict(_mimics(xml)),
        frozenset(joint.name for joint in robot.joints if _damped(joint)),
        tuple(link.name for link in robot.links if link.mass == 0 and any(link.moments)),
        tuple(one.name for one in robot.links if one.name in children and not _heavy(one)),
        tuple(link.name for link in robot.links if impossible(link)),
    )


def _mimics(xml: Element) -> Iterator[tuple[str, tuple[str, float, float]]]:
    """Yield which joints follow which, read once more: our reader is what is compared."""
    for joint in xml.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None and joint.get("type") != "fixed":
            ratio, shift = float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0))
            yield joint.get("name", ""), (mimic.get("joint", ""), ratio, shift)


def _damped(joint: Joint) -> bool:
    return bool(joint.damping)


def _heavy(link: Link) -> bool:
    return link.mass > 0 or any(link.moments)


def few(names: Iterable[str]) -> str:
    """Return at most three names, and how many more there are."""
    names = sorted(names) if isinstance(names, Set) else list(names)
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
