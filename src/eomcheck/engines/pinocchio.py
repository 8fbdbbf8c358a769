"""Pinocchio: mass matrix by CRBA, bias by RNEA, constrained accelerations by its own solver."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.base import EngineAcceleration
from eomcheck.engines.tree import TreeEngine
from eomcheck.engines.walk import Link
from eomcheck.numbers.generic import Array


class PinocchioEngine(TreeEngine):
    """A scene that is a tree of rigid bodies, as Pinocchio's own model."""

    module = "pinocchio"
    any_inertia = True

    @classmethod
    def holds(cls, links: list[Link]) -> bool:
        """Return True: of every tree."""
        return True

    def _build(self, library: Any, links: list[Link]) -> None:
        self._pin = pin = library
        self.model = model = pin.Model()
        model.gravity.setZero()
        for link in links:
            kind = getattr(pin, f"JointModel{link.kind.upper()}")
            seat = pin.SE3(link.rotation, link.offset)
            # Joint 0 is Pinocchio's universe, where -1 is the ground here.
            joint = model.addJoint(link.parent + 1, kind(), seat, link.name)
            model.armature[model.joints[joint].idx_v] = link.armature
            if link.mass > 0 or link.turns_without_mass:
                body = pin.Inertia(link.mass, link.center, link.inertia)
                model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        self.data = model.createData()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by the composite rigid body algorithm, which fills its upper half."""
        upper = np.triu(np.array(self._pin.crba(self.model, self.data, q)))
        return upper + upper.T - np.diag(np.diagonal(upper))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by the recursive Newton-Euler algorithm; gravity is zero in the model."""
        return np.array(self._pin.nonLinearEffects(self.model, self.data, q, v))

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ and λ by `pinocchio.forwardDynamics` with our a, gamma and Q."""
        if self.follow:
            return self.eliminated(q, v, Q, a, gamma, t)
        state = (self.model, self.data, q, v, Q)
        if a is None or gamma is None:
            return EngineAcceleration(np.array(self._pin.aba(*state)), None)
        xdd = self._pin.forwardDynamics(*state, a, gamma)
        return EngineAcceleration(np.array(xdd), np.array(self.data.lambda_c))
