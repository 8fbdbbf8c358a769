"""Exudyn: a kinematic tree in minimal coordinates, evaluated by the steps of its solvers."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eomcheck.engines.engine import EngineAcceleration
from eomcheck.engines.tree_engine import TreeLink, TreeSolverEngine
from eomcheck.errors import required
from eomcheck.numbers.generic import Array

SENSORS = (
    "Position",
    "RotationMatrix",
    "Velocity",
    "AngularVelocity",
    "Acceleration",
    "AngularAcceleration",
)
"""Output variables of a link that its `SensorKinematicTree` can measure."""


class ExudynEngine(TreeSolverEngine):
    """Tree of rigid bodies as an Exudyn kinematic tree."""

    key = "exudyn"
    module = extra = "exudyn"

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        items = required("exudyn.itemInterface")
        self._exu = library
        self._container = library.SystemContainer()
        self.system = self._container.AddSystem()
        zero = np.zeros(self._n)
        node = self.system.AddNode(
            items.NodeGenericODE2(
                referenceCoordinates=zero,
                initialCoordinates=zero,
                initialCoordinates_t=zero,
                numberOfODE2Coordinates=self._n,
            )
        )
        kinds = {"p": "Prismatic", "r": "Revolute"}
        self._tree = self.system.AddObject(
            items.ObjectKinematicTree(
                nodeNumber=node,
                gravity=np.zeros(3),
                jointTypes=[
                    getattr(library.JointType, kinds[link.kind[0]] + link.kind[1].upper())
                    for link in links
                ],
                linkParents=[link.parent for link in links],
                jointTransformations=library.Matrix3DList([link.rotation for link in links]),
                jointOffsets=library.Vector3DList([link.offset for link in links]),
                linkInertiasCOM=library.Matrix3DList([link.inertia for link in links]),
                linkCOMs=library.Vector3DList([link.center for link in links]),
                linkMasses=[link.mass for link in links],
            )
        )
        if self.inputs.r:
            self._constraints = self._add_constraints(items, node)
        self._sensors = {
            name: self.system.AddSensor(
                items.SensorKinematicTree(
                    objectNumber=self._tree,
                    linkNumber=0,
                    outputVariableType=getattr(library.OutputVariableType, name),
                    writeToFile=False,
                )
            )
            for name in SENSORS
        }
        self._joint_of = {x.name: x for x in self.frames if x.joint >= 0}
        self.system.Assemble()
        self._settings = library.SimulationSettings()
        self._settings.solution.file.write = False
        self._settings.timeIntegration.verboseMode = self._settings.staticSolver.verboseMode = 0
        # This solver is used only for the matrices that it assembles.
        self._static = library.MainSolverStatic()
        self._static.InitializeSolver(self.system, self._settings)

    def _add_constraints(self, items: Any, node: Any) -> Any:
        """Add the constraints a v = 0, their entries set later."""
        ground = self.system.AddNode(items.NodePointGround())
        markers = [
            self.system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=n)) for n in (ground, node)
        ]
        return self.system.AddObject(
            items.ObjectConnectorCoordinateVector(
                markerNumbers=markers,
                scalingMarker1=np.ones((self.inputs.r, self._n)),
                offset=np.zeros(self.inputs.r),
                velocityLevel=True,
            )
        )

    def _move_to(self, x: Array, rate: Array, configuration: str = "Current") -> None:
        data, where = self.system.systemData, getattr(self._exu.ConfigurationType, configuration)
        data.SetODE2Coordinates(x, where)
        data.SetODE2Coordinates_t(rate, where)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n)."""
        self._move_to(q, np.zeros(self._n))
        self._static.ComputeMassMatrix(self.system)
        return np.array(self._static.GetSystemMassMatrix())[: self._n, : self._n]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), minus the right-hand side of the equations without forces."""
        self._move_to(q, v)
        self._static.ComputeODE2RHS(self.system)
        return -np.array(self._static.GetSystemResidual())[: self._n]

    def solved(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return the initial v̇ and λ of the implicit solver, from the scene's Q, a and gamma.

        Its initial accelerations satisfy a v̇ = 0 whatever gamma is. So v̇ is its result plus some
        z with a z = -gamma, whose inertia forces M z are subtracted from Q.
        """
        z = np.zeros(self._n)
        if a is not None and gamma is not None:
            z = np.linalg.lstsq(a, -gamma, rcond=None)[0]
            self.system.SetObjectParameter(self._constraints, "scalingMarker1", a)
            Q = Q - self.mass_matrix(q) @ z
        self.system.SetObjectParameter(self._tree, "jointForceVector", Q)
        self._move_to(q, v, "Initial")
        solver, where = self._exu.MainSolverImplicitSecondOrder(), self._exu.ConfigurationType
        solver.InitializeSolver(self.system, self._settings)
        data = self.system.systemData
        vdot = np.array(data.GetODE2Coordinates_tt(where.Current)) + z
        multipliers = None if a is None else -np.array(data.GetAECoordinates(where.Current))
        solver.FinalizeSolver(self.system, self._settings)
        self.system.SetObjectParameter(self._tree, "jointForceVector", np.zeros(self._n))
        return EngineAcceleration(vdot, multipliers)

    # ---- Conformance quantities ------------------------------------------------------------------

    @contextmanager
    def _weight_alone(self) -> Iterator[None]:
        """Give the tree its gravity, and switch the constraints off."""
        self.system.SetObjectParameter(self._tree, "gravity", self._gravity)
        if self.inputs.r:
            self.system.SetObjectParameter(self._constraints, "activeConnector", False)
        try:
            yield
        finally:
            self.system.SetObjectParameter(self._tree, "gravity", np.zeros(3))
            if self.inputs.r:
                self.system.SetObjectParameter(self._constraints, "activeConnector", True)

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,), the initial acceleration of the implicit solver, without constraints."""
        with self._weight_alone():
            return self.solved(q, v, tau, None, None).vdot

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), minus the right-hand side of the equations at rest."""
        with self._weight_alone():
            return self.bias(q, np.zeros(self._n))

    def has_frame(self, f: str) -> bool:
        """Return whether a link of this name moves."""
        return f in self._joint_of

    def _measured(self, f: str, *names: str) -> Array:
        """Return output variables of a frame's origin by `SensorKinematicTree`, concatenated."""
        frame, values = self._joint_of[f], []
        for name in names:
            sensor = self._sensors[name]
            self.system.SetSensorParameter(sensor, "linkNumber", frame.joint)
            self.system.SetSensorParameter(sensor, "localPosition", frame.p)
            values.append(np.array(self.system.GetSensorValues(sensor)))
        return np.concatenate(values)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p), the `RotationMatrix` and the `Position` of a sensor."""
        self._move_to(q, np.zeros(self._n))
        R = self._measured(f, "RotationMatrix").reshape(3, 3)
        return R @ self._joint_of[f].R, self._measured(f, "Position")

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,): `Velocity` and `AngularVelocity` of a sensor."""
        self._move_to(q, v)
        return self._measured(f, "Velocity", "AngularVelocity")

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,): `Acceleration`, classical, and `AngularAcceleration`."""
        self._move_to(q, v)
        where = self._exu.ConfigurationType.Current
        self.system.systemData.SetODE2Coordinates_tt(vdot, where)
        return self._measured(f, "Acceleration", "AngularAcceleration")

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,), the acceleration at v̇ = 0."""
        return self.frame_acceleration(f, q, v, np.zeros(self._n), t)
