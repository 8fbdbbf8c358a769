"""iDynTree, as it reads a URDF, its base held or free; it knows no damping."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import BaseVelocity, FreeBase
from eomcheck.engines.idyntree import BASE, IdyntreeEngine
from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Array

POSE = 12
"""Entries of `pose`."""


class IdyntreeFile(FileEngine, IdyntreeEngine):
    """A URDF by `iDynTree::ModelLoader`."""

    key = "idyntree_file"
    base_velocity = BaseVelocity("ground", "ground")

    def _read(self, library: Any, description: Description) -> None:
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
        self._names = [moving[i] for i in sorted(moving)]

    def joints(self) -> list[str]:
        """Return the names of its joints."""
        return self._names

    def pose(self, base: FreeBase) -> Array:
        """Return place and rotation."""
        return np.concatenate([base.place, base.R.ravel()])

    def _move_to(self, x: Array, rate: Array) -> None:
        self._under(x, rate, np.zeros(3))

    def _under(self, x: Array, rate: Array, gravity: Array) -> None:
        """Move it there, under gravity."""
        idt = self._idt
        place, twist = idt.Transform.Identity(), idt.Twist.Zero()
        if self.base:
            pose, x = np.split(x, [POSE])
            place = idt.Transform(idt.Rotation(*pose[3:]), idt.Position(*pose[:3]))
            speeds, rate = np.split(rate, [BASE])
            twist = idt.Twist.FromPython(speeds)
        state = place, x, twist, rate, gravity
        self.dynamics.setRobotState(*state)
        if self.base and gravity.any():
            # It turns gravity to the axes that the base had when places were last computed.
            self.dynamics.getCenterOfMassPosition()
            self.dynamics.setRobotState(*state)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (m, m), that of a free base or the joints' part of it."""
        self._move_to(q, np.zeros(self._n))
        size = self._n + BASE - self.base
        matrix = self._idt.MatrixDynSize(size, size)
        self.dynamics.getFreeFloatingMassMatrix(matrix)
        return matrix.toNumPy()[BASE - self.base :, BASE - self.base :]

    def _told(self, ask: Any) -> Array:
        """Return the forces (m,) that it is asked for."""
        forces = self._idt.FreeFloatingGeneralizedTorques(self.dynamics.model())
        ask(forces)
        of_joints = forces.jointTorques().toNumPy()
        return np.concatenate([forces.baseWrench().toNumPy()[: self.base], of_joints])

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (m,)."""
        self._move_to(q, v)
        return self._told(self.dynamics.generalizedBiasForces)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        self._under(q, np.zeros(self._n), self._gravity)
        return -self._told(self.dynamics.generalizedGravityForces)
