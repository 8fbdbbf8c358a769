"""Pinocchio: mass matrix by CRBA, bias by RNEA, constrained accelerations by its own solver.

In a model read from a URDF, a floating base has a quaternion and a velocity along its own axes;
Pinocchio's algorithms leave out the dampers that it reads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.engine import EngineAcceleration, VelocityMap
from eomcheck.engines.file_engine import BaseVelocity, FileEngine, FreeBase, RobotDescription
from eomcheck.engines.tree_engine import TreeLink, TreeSolverEngine
from eomcheck.numbers.generic import Array


class PinocchioEngine(TreeSolverEngine):
    """Tree of rigid bodies as a Pinocchio model."""

    module = "pinocchio"
    any_inertia = True

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return True: Pinocchio holds every tree."""
        return True

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._pin = pin = library
        self.model = model = pin.Model()
        model.gravity.setZero()
        for link in links:
            kind = getattr(pin, f"JointModel{link.kind.upper()}")
            seat = pin.SE3(link.rotation, link.offset)
            # Joint 0 is Pinocchio's universe, the ground, which is -1 in `links`.
            joint = model.addJoint(link.parent + 1, kind(), seat, link.name)
            model.armature[model.joints[joint].idx_v] = link.armature
            if link.mass > 0 or link.turns_without_mass:
                body = pin.Inertia(link.mass, link.center, link.inertia)
                model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        self.data = model.createData()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by the composite rigid body algorithm, which fills its upper triangle."""
        upper = np.triu(np.array(self._pin.crba(self.model, self.data, q)))
        return upper + upper.T - np.diag(np.diagonal(upper))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by the recursive Newton-Euler algorithm; gravity is zero in the model."""
        return np.array(self._pin.nonLinearEffects(self.model, self.data, q, v))

    def solved(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return v̇ and λ by `pinocchio.forwardDynamics` with the scene's a, gamma and Q."""
        state = (self.model, self.data, q, v, Q)
        if a is None or gamma is None:
            return EngineAcceleration(np.array(self._pin.aba(*state)), None)
        xdd = self._pin.forwardDynamics(*state, a, gamma)
        return EngineAcceleration(np.array(xdd), np.array(self.data.lambda_c))


# ---- Model read from a URDF ----------------------------------------------------------------------


class PinocchioFile(FileEngine, PinocchioEngine):
    """URDF read by `pinocchio.buildModelFromXML`."""

    key = "pinocchio_file"
    base_velocity = BaseVelocity("base", "base")
    undamped = True

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._pin = library
        base = (library.JointModelFreeFlyer(),) if self.base else ()
        self.model = library.buildModelFromXML(description.text, *base)
        self.model.gravity.linear = np.zeros(3)
        self.data = self.model.createData()
        # The first joint is the universe, the next one that of a free base.
        self._joints = list(self.model.names)[2 if self.base else 1 :]

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v); x holds cosine and sine of joints without limits."""
        x, S, rest = super().velocity_map(q, v)
        joints = list(self.model.joints)[-len(self._joints) :]
        pose, angles = np.split(x, [len(x) - len(joints)])
        parts = pose.tolist()
        for joint, angle in zip(joints, angles, strict=True):
            parts += [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
        return VelocityMap(np.array(parts), S, rest)

    def pose(self, base: FreeBase) -> Array:
        """Return the position and the quaternion x, y, z, w."""
        return np.concatenate([base.position, np.roll(base.quaternion, -1)])

    def _under_gravity(self, algorithm: Any, *arguments: Array) -> Array:
        """Return the result of one of Pinocchio's algorithms for the model under gravity."""
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
        """Return ẇ (m,) by the articulated body algorithm, which leaves out all dampers.

        So it differs from ẇ = M⁻¹ (Q - B) of `forces` where a joint is damped (`undamped`).
        """
        return self._under_gravity(self._pin.aba, q, v, np.zeros(len(v)))
