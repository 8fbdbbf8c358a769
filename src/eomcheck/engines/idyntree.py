"""iDynTree: its `KinDynComputations`, with the ground as a base that does not move.

In a model read from a URDF, the base is fixed or free; iDynTree has no damping.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from eomcheck.engines.file_engine import BaseVelocity, FileEngine, FreeBase, RobotDescription
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Array

BASE = 6
"""Number of velocities of the base, which come before those of the joints."""


class IdyntreeEngine(TreeEngine):
    """Tree of rigid bodies as an iDynTree model."""

    module, extra = "idyntree.bindings", "idyntree"

    @classmethod
    def _library(cls) -> Any:
        # Its import warns of a future Python; where warnings are errors that would end the process.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return super()._library()

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._idt = idt = library
        model = idt.Model()
        ground = idt.Link()
        ground.setInertia(idt.SpatialInertia.Zero())
        indices = [model.addLink("ground", ground)]
        for link in links:
            body = idt.Link()
            body.setInertia(_inertia(idt, link))
            indices.append(model.addLink(link.name, body))
            before, after = indices[link.parent + 1], indices[-1]
            joint = idt.PrismaticJoint() if link.slides else idt.RevoluteJoint()
            joint.setAttachedLinks(before, after)
            rotation = idt.Rotation(*link.rotation.ravel())
            joint.setRestTransform(idt.Transform(rotation, idt.Position(*link.offset)))
            joint.setAxis(idt.Axis(idt.Direction(*link.axis), idt.Position.Zero()), after, before)
            model.addJoint(f"joint of {link.name}", joint)
        model.setDefaultBaseLink(indices[0])
        self.dynamics = idt.KinDynComputations()
        self.dynamics.loadRobotModel(model)
        model = self.dynamics.model()
        joints = (model.getJoint(model.getJointIndex(f"joint of {link.name}")) for link in links)
        self._place = np.array([joint.getDOFsOffset() for joint in joints])

    def _move_to(self, x: Array, rate: Array) -> None:
        state = np.zeros((2, self._n))
        state[:, self._place] = x, rate
        self.dynamics.setRobotState(*state, np.zeros(3))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n), without the part of a base that is held."""
        self._move_to(q, np.zeros(self._n))
        held = BASE - self.base
        matrix = self._idt.MatrixDynSize(held + self._n, held + self._n)
        self.dynamics.getFreeFloatingMassMatrix(matrix)
        return matrix.toNumPy()[held:, held:][np.ix_(self._place, self._place)]

    def _forces_by(self, method: Any) -> Array:
        """Return the generalized forces (n,) of a method of the library, of a free base first."""
        forces = self._idt.FreeFloatingGeneralizedTorques(self.dynamics.model())
        method(forces)
        wrench, torques = forces.baseWrench().toNumPy(), forces.jointTorques().toNumPy()
        return np.concatenate([wrench[: self.base], torques])[self._place]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), without the part of a base that is held."""
        self._move_to(q, v)
        return self._forces_by(self.dynamics.generalizedBiasForces)


def _inertia(idt: Any, link: TreeLink) -> Any:
    if link.mass == 0:
        return idt.SpatialInertia.Zero()
    inertia = idt.SpatialInertia()
    moments = idt.RotationalInertia()
    for i in range(3):
        for j in range(3):
            moments.setVal(i, j, link.inertia[i, j])
    inertia.fromRotationalInertiaWrtCenterOfMass(link.mass, idt.Position(*link.center), moments)
    return inertia


# ---- Model read from a URDF ----------------------------------------------------------------------

POSE = 12
"""Number of entries of `pose`."""


class IdyntreeFile(FileEngine, IdyntreeEngine):
    """URDF read by `iDynTree::ModelLoader`."""

    key = "idyntree_file"
    base_velocity = BaseVelocity("ground", "ground")

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._idt = library
        loader = library.ModelLoader()
        if not loader.loadModelFromString(description.text, "urdf"):
            raise EngineError(f"{self.key} cannot read the file")
        model = loader.model()
        if description.root in [model.getLinkName(i) for i in range(model.getNrOfLinks())]:
            model.setDefaultBaseLink(model.getLinkIndex(description.root))
        self.dynamics = library.KinDynComputations()
        self.dynamics.loadRobotModel(model)
        self.dynamics.setFrameVelocityRepresentation(library.MIXED_REPRESENTATION)
        model = self.dynamics.model()
        moving = {}
        for i in range(model.getNrOfJoints()):
            joint = model.getJoint(i)
            if joint.getNrOfDOFs():
                moving[joint.getDOFsOffset()] = model.getJointName(i)
        self._joints = [moving[i] for i in sorted(moving)]

    def pose(self, base: FreeBase) -> Array:
        """Return the position and the rotation matrix."""
        return np.concatenate([base.position, base.R.ravel()])

    def _move_to(self, x: Array, rate: Array) -> None:
        self._under(x, rate, np.zeros(3))

    def _under(self, x: Array, rate: Array, gravity: Array) -> None:
        """Set the state to coordinates x and velocities `rate`, under gravity (3,), m/s²."""
        idt = self._idt
        frame, twist = idt.Transform.Identity(), idt.Twist.Zero()
        if self.base:
            pose, x = np.split(x, [POSE])
            frame = idt.Transform(idt.Rotation(*pose[3:]), idt.Position(*pose[:3]))
            speeds, rate = np.split(rate, [BASE])
            twist = idt.Twist.FromPython(speeds)
        state = frame, x, twist, rate, gravity
        self.dynamics.setRobotState(*state)
        if self.base and gravity.any():
            # It rotates gravity to the axes that the base had when positions were last computed.
            self.dynamics.getCenterOfMassPosition()
            self.dynamics.setRobotState(*state)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        self._under(q, np.zeros(self._n), self._gravity)
        return -self._forces_by(self.dynamics.generalizedGravityForces)
