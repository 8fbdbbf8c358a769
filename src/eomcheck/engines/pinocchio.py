"""Pinocchio: mass matrix by CRBA, bias by RNEA, constrained accelerations by its own solver.

The model is built from the scene's neutral `Tree`, whose joint coordinates are x = T q.
"""

from __future__ import annotations

import numpy as np

from eomcheck.engines.base import Engine, EngineAcceleration, VelocityMap
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array


class PinocchioEngine(Engine):
    """A scene that is a tree of rigid bodies, as Pinocchio's own model."""

    solves_like = "gw"
    reads_parameters = False

    def __init__(self, scene: Scene):
        super().__init__(scene)
        tree = scene.tree()
        if tree is None:
            raise EngineError(f"pinocchio cannot represent {scene.name}: it has no tree of bodies")
        self._pin = required("pinocchio")
        self.model = self._build(tree)
        self.data = self.model.createData()
        self.coordinates = tree.coordinates

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return f"pinocchio {required('pinocchio').__version__}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is described as a tree."""
        return scene.tree() is not None

    def _build(self, tree: Tree):
        pin = self._pin
        joints = {
            "px": pin.JointModelPX,
            "py": pin.JointModelPY,
            "rz": pin.JointModelRZ,
        }
        model = pin.Model()
        model.gravity.setZero()
        for j, (parent, kind) in enumerate(zip(tree.parent, tree.joint, strict=True)):
            placement = pin.SE3(np.eye(3), tree.offset[j])
            # Joint 0 is Pinocchio's universe, where -1 is the ground here.
            joint = model.addJoint(parent + 1, joints[kind](), placement, f"joint_{j}")
            if tree.mass[j] > 0:
                about_z = np.diag([0.0, 0.0, tree.inertia[j]])
                body = pin.Inertia(float(tree.mass[j]), tree.center[j], about_z)
                model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        return model

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (T q, T, 0)."""
        return VelocityMap(self.coordinates @ q, self.coordinates, np.zeros(len(self.coordinates)))

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
        state = (self.model, self.data, q, v, Q)
        if a is None or gamma is None:
            return EngineAcceleration(np.array(self._pin.aba(*state)), None)
        xdd = self._pin.forwardDynamics(*state, a, gamma)
        return EngineAcceleration(np.array(xdd), np.array(self.data.lambda_c))
