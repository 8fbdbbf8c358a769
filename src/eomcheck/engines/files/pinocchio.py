"""Pinocchio, as it reads a URDF; its algorithms know no damping."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.base import VelocityMap
from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.numbers.contract import Array


class PinocchioFile(FileEngine, PinocchioEngine):
    """A URDF by `pinocchio.buildModelFromXML`."""

    key = "pinocchio_file"

    def _read(self, library: Any, description: Description) -> None:
        self._pin = library
        self.model = library.buildModelFromXML(description.text)
        self.model.gravity.linear = np.zeros(3)
        self.data = self.model.createData()

    def joints(self) -> list[str]:
        """Return the names of its joints; joint 0 is its universe."""
        return list(self.model.names)[1:]

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, 0), x with cosine and sine of joints without limits."""
        turned, S, rest = super().velocity_map(q, v)
        parts = []
        for joint, angle in zip(list(self.model.joints)[1:], turned, strict=True):
            parts += [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        return VelocityMap(np.array(parts), S, rest)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        self.model.gravity.linear = self._gravity
        found = self._pin.computeGeneralizedGravity(self.model, self.data, q)
        self.model.gravity.linear = np.zeros(3)
        return -np.array(found)

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by articulated bodies."""
        self.model.gravity.linear = self._gravity
        found = self._pin.aba(self.model, self.data, q, v, np.zeros(len(v)))
        self.model.gravity.linear = np.zeros(3)
        return np.array(found)
