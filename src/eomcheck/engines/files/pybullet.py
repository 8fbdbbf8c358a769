"""PyBullet, as it reads a URDF, its base held."""

from __future__ import annotations

import tempfile
import weakref
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.pybullet import BASE, PybulletEngine
from eomcheck.files import write_text
from eomcheck.numbers.contract import Array


class PybulletFile(FileEngine, PybulletEngine):
    """A URDF by `pybullet.loadURDF`."""

    key = "pybullet_file"

    def _read(self, library: Any, description: Description) -> None:
        self._bullet = library
        self._client = library.connect(library.DIRECT)
        weakref.finalize(self, library.disconnect, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "robot.urdf")
            write_text(path, description.text)
            flags = library.URDF_USE_INERTIA_FROM_FILE
            self._body = library.loadURDF(
                str(path), useFixedBase=True, flags=flags, physicsClientId=self._client
            )
        count = library.getNumJoints(self._body, physicsClientId=self._client)
        infos = [
            library.getJointInfo(self._body, j, physicsClientId=self._client) for j in range(count)
        ]
        moving = {info[3] - BASE: info[1].decode() for info in infos if info[3] >= BASE}
        self._names = [moving[i] for i in sorted(moving)]

    def joints(self) -> list[str]:
        """Return the names of its joints."""
        return self._names

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        world = {"physicsClientId": self._client}
        self._bullet.setGravity(*self._gravity, **world)
        still = [0.0] * self._n
        found = self._bullet.calculateInverseDynamics(
            self._body, self._ordered(q), still, still, **world
        )
        self._bullet.setGravity(0.0, 0.0, 0.0, **world)
        return -np.array(found)
