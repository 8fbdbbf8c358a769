"""PyBullet: Bullet's multibody code, from a URDF that is written for it and thrown away."""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from eomcheck.atomic_write import write_text
from eomcheck.descriptions.quaternions import roll_pitch_yaw_of
from eomcheck.engines.tree import TreeEngine
from eomcheck.engines.walk import Link
from eomcheck.numbers.generic import Array

BASE = 7
"""Entries of a free base's pose, from which it counts even where the base is fixed."""


class PybulletEngine(TreeEngine):
    """A scene that is a tree of rigid bodies, as a multibody of PyBullet's."""

    module = extra = "pybullet"

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        cls._library()
        return f"pybullet {metadata.version('pybullet')}"

    @classmethod
    def takes(cls, link: Link) -> bool:
        """Return whether a link is a point or extended: of a thin rod it takes none for all."""
        moments = link.principal[0]
        return super().takes(link) and bool(moments[0] > 0 or not moments.any())

    def _build(self, library: Any, links: list[Link]) -> None:
        self._bullet = library
        # There are only so many connections: one is given back with the engine.
        self._client = library.connect(library.DIRECT)
        weakref.finalize(self, library.disconnect, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "tree.urdf")
            self._unit = _unit_of_mass(links)
            write_text(path, _urdf(links, self._unit))
            # Otherwise moments of inertia are guessed from the shape, and there is none.
            flags = library.URDF_USE_INERTIA_FROM_FILE
            self._body = library.loadURDF(
                str(path), useFixedBase=True, flags=flags, physicsClientId=self._client
            )
        infos = [
            library.getJointInfo(self._body, j, physicsClientId=self._client)
            for j in range(self._n)
        ]
        place = {info[1].decode(): info[3] - BASE for info in infos}
        self._place = np.array([place[f"joint_of_{link.name}"] for link in links])

    def _ordered(self, x: Array) -> list[float]:
        result = np.zeros(self._n)
        result[self._place] = x
        return result.tolist()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n)."""
        found = self._bullet.calculateMassMatrix(
            self._body, self._ordered(q), physicsClientId=self._client
        )
        return self._unit * np.array(found)[np.ix_(self._place, self._place)]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by inverse dynamics; a new world has no gravity."""
        state = self._ordered(q), self._ordered(v), [0.0] * self._n
        found = self._bullet.calculateInverseDynamics(
            self._body, *state, physicsClientId=self._client
        )
        return self._unit * np.array(found)[self._place]


def _unit_of_mass(links: list[Link]) -> float:
    """Return a power of two, kg, in which the largest moment of inertia is below 1.

    Bullet turns inertias, and refuses what is not symmetric to 1e-15, however large it is.
    """
    largest = max(max(link.principal[0]) for link in links)
    return 2.0 ** np.ceil(np.log2(largest)) if largest > 0 else 1.0


def _urdf(links: list[Link], unit: float) -> str:
    """Return the links as a URDF, every number with all its digits; masses in a unit, kg."""
    robot = ElementTree.Element("robot", name="tree")
    _add_body(robot, "ground", 0.0, np.zeros(3), np.zeros(3), np.eye(3))
    for link in links:
        moments, axes = link.principal
        _add_body(robot, link.name, link.mass / unit, link.center, moments / unit, axes)
        parent = "ground" if link.parent < 0 else links[link.parent].name
        kind = "prismatic" if link.slides else "continuous"
        joint = ElementTree.SubElement(robot, "joint", name=f"joint_of_{link.name}", type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=link.name)
        rpy = _text(roll_pitch_yaw_of(link.rotation))
        ElementTree.SubElement(joint, "origin", xyz=_text(link.offset), rpy=rpy)
        ElementTree.SubElement(joint, "axis", xyz=_text(link.axis))
        if link.slides:
            limits: dict[str, str] = dict.fromkeys(("lower", "upper", "effort", "velocity"), "1")
            ElementTree.SubElement(joint, "limit", limits)  # not held to, but asked for
    ElementTree.indent(robot)  # Bullet cuts long lines off
    return ElementTree.tostring(robot, encoding="unicode")


def _add_body(
    robot: Any, name: str, mass: float, center: Array, moments: Array, axes: Array
) -> None:
    inertial = ElementTree.SubElement(ElementTree.SubElement(robot, "link", name=name), "inertial")
    # Along principal axes: Bullet turns to them itself, to 1e-11 only.
    rpy = _text(roll_pitch_yaw_of(axes))
    ElementTree.SubElement(inertial, "origin", xyz=_text(center), rpy=rpy)
    ElementTree.SubElement(inertial, "mass", value=repr(float(mass)))
    about = {f"i{axis}{axis}": repr(float(x)) for axis, x in zip("xyz", moments, strict=True)}
    ElementTree.SubElement(inertial, "inertia", about | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)
