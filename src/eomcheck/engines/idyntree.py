"""iDynTree: its `KinDynComputations`, with the ground as the base that does not move."""

from __future__ import annotations

import warnings
from importlib import metadata
from typing import Any

import numpy as np

from eomcheck.engines.tree import TreeEngine
from eomcheck.engines.walk import Link
from eomcheck.numbers.generic import Array

BASE = 6
"""Velocities of the base, before those of the joints."""


class IdyntreeEngine(TreeEngine):
    """A scene that is a tree of rigid bodies, as a model of iDynTree's."""

    module, extra = "idyntree.bindings", "idyntree"

    @classmethod
    def _library(cls) -> Any:
        # Its import warns of a future Python; where warnings are errors the process would die.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return super()._library()

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        cls._library()
        return f"idyntree {metadata.version('idyntree')}"

    def _build(self, library: Any, links: list[Link]) -> None:
        self._idt = idt = library
        model = idt.Model()
        ground = idt.Link()
        ground.setInertia(idt.SpatialInertia.Zero())
        places = [model.addLink("ground", ground)]
        for link in links:
            body = idt.Link()
            body.setInertia(_inertia(idt, link))
            places.append(model.addLink(link.name, body))
            before, after = places[link.parent + 1], places[-1]
            joint = idt.PrismaticJoint() if link.slides else idt.RevoluteJoint()
            joint.setAttachedLinks(before, after)
            rotation = idt.Rotation(*link.rotation.ravel())
            joint.setRestTransform(idt.Transform(rotation, idt.Position(*link.offset)))
            joint.setAxis(idt.Axis(idt.Direction(*link.axis), idt.Position.Zero()), after, before)
            model.addJoint(f"joint of {link.name}", joint)
        model.setDefaultBaseLink(places[0])
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
        """Return M (n, n), the joints' part of that of a floating base."""
        self._move_to(q, np.zeros(self._n))
        matrix = self._idt.MatrixDynSize(BASE + self._n, BASE + self._n)
        self.dynamics.getFreeFloatingMassMatrix(matrix)
        return matrix.toNumPy()[BASE:, BASE:][np.ix_(self._place, self._place)]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), the joints' part of that of a floating base at rest."""
        self._move_to(q, v)
        forces = self._idt.FreeFloatingGeneralizedTorques(self.dynamics.model())
        self.dynamics.generalizedBiasForces(forces)
        return forces.jointTorques().toNumPy()[self._place]


def _inertia(idt: Any, link: Link) -> Any:
    if link.mass == 0:
        return idt.SpatialInertia.Zero()
    inertia = idt.SpatialInertia()
    moments = idt.RotationalInertia()
    for i in range(3):
        for j in range(3):
            moments.setVal(i, j, link.inertia[i, j])
    inertia.fromRotationalInertiaWrtCenterOfMass(link.mass, idt.Position(*link.center), moments)
    return inertia
