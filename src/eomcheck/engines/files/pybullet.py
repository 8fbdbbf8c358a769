"""PyBullet, as it reads a URDF, its base held or free.

A free base moves with the principal axes of its body. PyBullet answers as if these had just been
those of the ground, and tells the accelerations of the centre of mass along them: less by ω × v
than those of its velocity.
"""

from __future__ import annotations

import tempfile
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.atomic_write import write_text
from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import FREE, BaseVelocity, FreeBase, free_base
from eomcheck.engines.pybullet import BASE, PybulletEngine
from eomcheck.numbers.generic import Array

POSE = 9
"""Entries of `pose`."""

NOWHERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
"""Place and orientation of a base that is where the ground is."""


class PybulletFile(FileEngine, PybulletEngine):
    """A URDF by `pybullet.loadURDF`."""

    key = "pybullet_file"
    base_velocity = BaseVelocity("base", "base", turns_first=True)

    def _read(self, library: Any, description: Description) -> None:
        self._bullet = library
        self._client = library.connect(library.DIRECT)
        weakref.finalize(self, library.disconnect, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "robot.urdf")
            write_text(path, description.text)
            flags = library.URDF_USE_INERTIA_FROM_FILE
            self._body = library.loadURDF(
                str(path), useFixedBase=not self.base, flags=flags, physicsClientId=self._client
            )
        info = library.getDynamicsInfo(self._body, -1, physicsClientId=self._client)
        self._center = np.array(info[3])
        self._axes = np.array(library.getMatrixFromQuaternion(info[4])).reshape(3, 3)
        count = library.getNumJoints(self._body, physicsClientId=self._client)
        infos = [
            library.getJointInfo(self._body, j, physicsClientId=self._client) for j in range(count)
        ]
        moving = {info[3] - BASE: info[1].decode() for info in infos if info[3] >= BASE}
        self._names = [moving[i] for i in sorted(moving)]

    def joints(self) -> list[str]:
        """Return the names of its joints."""
        return self._names

    def base_frame(self, q: Array, v: Array) -> FreeBase:
        """Return where the principal axes of the base are, in its centre of mass."""
        return free_base(q[:FREE], v[:FREE], self._center, self._axes)

    def pose(self, base: FreeBase) -> Array:
        """Return the rotation: nothing depends on where it is."""
        return base.R.ravel()

    def _split(self, x: Array) -> tuple[Array, list[float]]:
        """Return the rotation of the axes of the base, and the coordinates of the joints."""
        pose, joints = np.split(x, [POSE if self.base else 0])
        return pose.reshape(-1, 3) if self.base else self._axes, joints.tolist()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (m, m)."""
        _, joints = self._split(q)
        found = self._bullet.calculateMassMatrix(self._body, joints, physicsClientId=self._client)
        return np.array(found)

    def _inverse(self, joints: list[float], rate: Array, acceleration: Array) -> Array:
        """Return forces (m,) of what moves like this, its axes those of the ground."""
        place = [*NOWHERE, *joints] if self.base else joints
        found = self._bullet.calculateInverseDynamics(
            self._body, place, rate.tolist(), acceleration.tolist(), physicsClientId=self._client
        )
        # With a free base forces come before moments, though it turns first.
        return np.concatenate([found[3:6], found[:3], found[6:]] if self.base else [found])

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (m,) by inverse dynamics."""
        acceleration = np.zeros(self._n)
        if self.base:
            acceleration[3:6] = np.cross(v[:3], v[3:6])
        return self._inverse(self._split(q)[1], v, acceleration)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        world, (R, joints) = {"physicsClientId": self._client}, self._split(q)
        self._bullet.setGravity(*(R.T @ self._gravity), **world)
        still = np.zeros(self._n)
        found = self._inverse(joints, still, still)
        self._bullet.setGravity(0.0, 0.0, 0.0, **world)
        return -found
