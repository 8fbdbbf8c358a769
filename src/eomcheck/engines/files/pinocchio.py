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
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.numbers.contract import Array


class PinocchioFile(FileEngine, PinocchioEngine):
    """A URDF by `pinocchio.buildModelFromXML`."""

    key = "pinocchio_file"
    floats = True

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
        turned, S, rest = super().velocity_map(q, v)
        parts: list[float] = []
        if self.base:
            parts += self._free(q, v, S, rest)
        joints = list(self.model.joints)[2 if self.base else 1 :]
        for joint, angle in zip(joints, turned[self.base :], strict=True):
            parts += [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        return VelocityMap(np.array(parts), S, rest)

    def _free(self, q: Array, v: Array, S: Array, rest: Array) -> list[float]:
        """Fill in the free base, moved along x, y, z and turned about z, y, x; return its place."""
        axes, pin = np.eye(3), self._pin
        yaw, pitch, roll = (
            np.array(pin.AngleAxis(float(angle), axis).matrix())
            for angle, axis in zip(q[3:6], (axes[2], axes[1], axes[0]), strict=True)
        )
        R = yaw @ pitch @ roll
        S[:3, :3] = R.T
        S[3:6, 3:6] = np.column_stack([roll.T @ pitch.T @ axes[2], roll.T @ axes[1], axes[0]])
        turned = S[3:6, 3:6] * v[3:6]
        omega = turned.sum(axis=1)
        rest[:3] = -np.cross(omega, R.T @ v[:3])
        rest[3:6] = -np.cross(turned[:, 2], turned[:, 0] + turned[:, 1])
        rest[3:6] -= np.cross(turned[:, 1], turned[:, 0])
        return [*q[:3], *pin.Quaternion(R).coeffs()]

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity and of the dampers that it reads."""
        self.model.gravity.linear = self._gravity
        found = self._pin.computeGeneralizedGravity(self.model, self.data, q)
        self.model.gravity.linear = np.zeros(3)
        return -np.array(found) - self.model.damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẇ (m,) by articulated bodies."""
        self.model.gravity.linear = self._gravity
        found = self._pin.aba(self.model, self.data, q, v, np.zeros(len(v)))
        self.model.gravity.linear = np.zeros(3)
        return np.array(found)
