"""OpenSim: a `Model` of bodies and joints, and the matter subsystem of its Simbody engine.

Spatial vectors have the angular part first; accelerations are classical. OpenSim's hinges turn
about z and its slides go along x of their frames, which are turned to the axis of each joint. Its
own files are not read here. It has no rotors, no Coriolis matrix, no Jacobian of the centre of
mass, no derivatives and no regressor; accelerations of frames and of the centre of mass are those
of v̇ of forward dynamics alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.mechanics.records import TreeFrame
from eomcheck.numbers.generic import Array


class OpensimEngine(TreeEngine):
    """Tree of rigid bodies as an OpenSim model."""

    key = "opensim"
    module = extra = "opensim"
    oldest = "4.6"

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether every link without mass carries one with mass, as OpenSim requires."""
        carriers = {link.parent for link in links if link.mass > 0}
        massless = {j for j, link in enumerate(links) if link.mass == 0}
        return super().holds(links) and massless <= carriers

    @classmethod
    def _library(cls) -> Any:
        library = super()._library()
        library.Logger.removeFileSink()  # a file in the working directory
        return library

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._osim = library
        self.model = model = library.Model()
        model.setGravity(library.Vec3(*self._gravity))
        bodies, coordinates = [], []
        for link in links:
            entries = link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            inertia = library.Inertia(*map(float, entries))
            body = library.Body(link.name, link.mass, library.Vec3(*link.center), inertia)
            model.addBody(body)
            parent = bodies[link.parent] if link.parent >= 0 else model.getGround()
            turn = _turn(link)
            seats = self._pose(link.rotation @ turn, link.offset), self._pose(turn, np.zeros(3))
            kind = library.SliderJoint if link.slides else library.PinJoint
            joint = kind(f"joint_of_{link.name}", parent, *seats[0], body, *seats[1])
            model.addJoint(joint)
            bodies.append(body)
            coordinates.append(joint.get_coordinates(0))
        self._seats = {
            x.name: (bodies[x.joint] if x.joint >= 0 else model.getGround(), x) for x in self.frames
        }
        self.state = model.initSystem()
        self.matter = model.getMatterSubsystem()
        self._place = np.array([self._index(coordinate) for coordinate in coordinates])

    def _pose(self, R: Array, p: Array) -> tuple[Any, Any]:
        """Return position and orientation of a frame, by body-fixed angles about x, y and z."""
        rotation = self._osim.Rotation(self._osim.Mat33(*map(float, R.ravel())))
        return self._osim.Vec3(*p), rotation.convertRotationToBodyFixedXYZ()

    def _index(self, coordinate: Any) -> int:
        """Return the index of a coordinate in the library's own order."""
        self.state.setQ(self._vector(np.zeros(self._n)))
        coordinate.setValue(self.state, 1.0, False)
        return int(np.argmax(self.state.getQ().to_numpy()))

    def _vector(self, values: Array) -> Any:
        return self._osim.Vector.createFromMat(values)

    def _own(self, values: Array) -> Any:
        """Return values (n,) of its velocities as a vector in the library's own order."""
        return self._vector(self._in_own_order(values))

    def _move_to(self, q: Array, v: Array) -> None:
        self.state.setQ(self._own(q))
        self.state.setU(self._own(v))
        self.model.realizeDynamics(self.state)

    def _matrix(self, method: Any, *arguments: Any) -> Array:
        """Return a matrix that a method of the matter subsystem fills."""
        matrix = self._osim.Matrix()
        method(self.state, *arguments, matrix)
        return matrix.to_numpy()

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by `calcM`."""
        self._move_to(q, np.zeros(self._n))
        return self._in_tree_order(self._matrix(self.matter.calcM))

    def _residual(self, vdot: Array, forces: Any) -> Array:
        """Return the forces (n,) of inverse dynamics under forces on bodies."""
        residual = self._osim.Vector()
        state = self.state, self._osim.Vector(), forces, self._own(vdot)
        self.matter.calcResidualForceIgnoringConstraints(*state, residual)
        return residual.to_numpy()[self._place]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by `calcResidualForceIgnoringConstraints`, without forces."""
        self._move_to(q, v)
        return self._residual(np.zeros(self._n), self._osim.VectorOfSpatialVec())

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `calcResidualForceIgnoringConstraints`, under `getGravityBodyForces`."""
        self._move_to(q, v)
        return self._residual(vdot, self.model.getGravityBodyForces(self.state))

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `calcAccelerationIgnoringConstraints`, under `getGravityBodyForces`."""
        self._move_to(q, v)
        weight, rates = self.model.getGravityBodyForces(self.state), self._osim.Vector()
        state = self.state, self._own(tau), weight
        moving = self._osim.VectorOfSpatialVec()
        self.matter.calcAccelerationIgnoringConstraints(*state, rates, moving)
        return rates.to_numpy()[self._place]

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `calcMInv`."""
        self._move_to(q, np.zeros(self._n))
        return self._in_tree_order(self._matrix(self.matter.calcMInv))

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `multiplyBySystemJacobianTranspose` of `getGravityBodyForces`."""
        self._move_to(q, np.zeros(self._n))
        weight, forces = self.model.getGravityBodyForces(self.state), self._osim.Vector()
        self.matter.multiplyBySystemJacobianTranspose(self.state, weight, forces)
        return -forces.to_numpy()[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `calcKineticEnergy`."""
        self._move_to(q, v)
        return self.matter.calcKineticEnergy(self.state)

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `calcPotentialEnergy` of the model."""
        self._move_to(q, np.zeros(self._n))
        return self.model.calcPotentialEnergy(self.state)

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `calcSystemMassCenterLocationInGround`."""
        self._move_to(q, np.zeros(self._n))
        return self.matter.calcSystemMassCenterLocationInGround(self.state).to_numpy()

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `calcSystemMassCenterVelocityInGround`."""
        self._move_to(q, v)
        return self.matter.calcSystemMassCenterVelocityInGround(self.state).to_numpy()

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `calcSystemCentralMomentum`, about the centre of mass."""
        self._move_to(q, v)
        return _linear_first(self.matter.calcSystemCentralMomentum(self.state))

    def _frame(self, f: str, q: Array, v: Array) -> tuple[Any, TreeFrame, tuple[Any, ...]]:
        """Return the body of a link at a state, the link's frame in it, and (state, body, p)."""
        body, frame = self._seat(f)
        self._move_to(q, v)
        station = self._osim.Vec3(*frame.p)
        return body, frame, (self.state, body.getMobilizedBodyIndex(), station)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `getTransformInGround` and `findStationLocationInGround`."""
        body, frame, (state, _, station) = self._frame(f, q, np.zeros(self._n))
        rotation = body.getTransformInGround(state).R()
        R = np.array([[rotation.get(i, k) for k in range(3)] for i in range(3)])
        return R @ frame.R, body.findStationLocationInGround(state, station).to_numpy()

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,): `findStationVelocityInGround`, `getAngularVelocityInGround`."""
        body, _, (state, _, station) = self._frame(f, q, v)
        linear = body.findStationVelocityInGround(state, station)
        return np.concatenate(
            [linear.to_numpy(), body.getAngularVelocityInGround(state).to_numpy()]
        )

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `calcFrameJacobian`, whose angular rows are first."""
        _, _, (_, *place) = self._frame(f, q, np.zeros(self._n))
        jacobian = self._matrix(self.matter.calcFrameJacobian, *place)
        return np.roll(jacobian, 3, axis=0)[:, self._place]

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) by `calcBiasForFrameJacobian`."""
        _, _, place = self._frame(f, q, v)
        return _linear_first(self.matter.calcBiasForFrameJacobian(*place))


def _turn(link: TreeLink) -> Array:
    """Return axes (3, 3) in the frame of a joint, which slides along x or turns about z of them."""
    return np.roll(np.eye(3), "xyz".index(link.kind[1]) - (0 if link.slides else 2), axis=0)


def _linear_first(spatial: Any) -> Array:
    """Return a spatial vector of Simbody (6,) with its linear part first."""
    return np.concatenate([spatial.get(1).to_numpy(), spatial.get(0).to_numpy()])
