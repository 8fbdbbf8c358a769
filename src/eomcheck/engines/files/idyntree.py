"""iDynTree, as it reads a URDF, its base held; it knows no damping."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.idyntree import IdyntreeEngine
from eomcheck.errors import EngineError
from eomcheck.numbers.contract import Array


class IdyntreeFile(FileEngine, IdyntreeEngine):
    """A URDF by `iDynTree::ModelLoader`."""

    key = "idyntree_file"

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

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity."""
        self.dynamics.setRobotState(q, np.zeros(self._n), self._gravity)
        forces = self._idt.FreeFloatingGeneralizedTorques(self.dynamics.model())
        self.dynamics.generalizedGravityForces(forces)
        return -forces.jointTorques().toNumPy()
