"""Pinocchio, as it reads a URDF: a free base is a quaternion and a velocity along its own axes.

    eomcheck validate --scene arm.urdf --engine eomcheck.engines.files:PinocchioFile

Its algorithms leave out the dampers that it reads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.base import VelocityMap
from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import BaseVelocity, FreeBase
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.numbers.generic import Array


class PinocchioFile(FileEngine, PinocchioEngine):
    """A URDF by `pinocchio.buildModelFromXML`."""

    key = "pinocchio_file"
    base_velocity = BaseVelocity("base", "base")
    undamped = True

    def _read(self, library: Any, description: Description) -> None:
        self._pin = library
        base = (library.JointModelFreeFlyer(),) if self.base else ()
        self.model = library.buildModelFromXML(description.text, *base)
        self.model.gravity.linear = np.zeros(3)
        self.data = self.model.createData()

    def joints(self) -> list[str]:
        """Return the names of its joints; its universe comes first, and then a free base."""
        return list(self.model.names)[2 if self.base else 1 :]

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v), x with cosine and sine of joints without limits."""
        x, S, rest = super().velocity_map(q, v)
        joints = list(self.model.joints)[2 if self.base else 1 :]
        pose, moved = np.split(x, [len(x) - len(joints)])
        parts = pose.tolist()
        for joint, angle in zip(joints, moved, strict=True):
            parts += [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        return VelocityMap(np.array(parts), S, rest)

    def pose(self, base: FreeBase) -> Array:
        """Return place and orientation, as x, y, z, w."""
        return np.concatenate([base.place, np.roll(base.quaternion, -1)])

    def _under_gravity(self, algorithm: Any, *arguments: Array) -> Array:
        """Return what one of its algorithms gives for the model under gravity."""
        self.model.gravity.linear = self._gravity
        try:
            return np.array(algorithm(self.model, self.data, *arguments))
        finally:
            self.model.gravity.linear = np.zeros(3)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity and of the dampers that it reads."""
        gravity = self._under_gravity(self._pin.computeGeneralizedGravity, q)
        return -gravity - self.model.damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẇ (m,) by articulated bodies."""
        return self._under_gravity(self._pin.aba, q, v, np.zeros(len(v)))
