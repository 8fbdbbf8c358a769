"""iDynTree: its `KinDynComputations`, with the ground as a base that does not move.

In a model read from a URDF, the base is fixed or free; iDynTree has no damping. Velocities and
accelerations are in its `MIXED_REPRESENTATION`: linear ones of the origin of a frame, then angular,
both along the axes of the world. It has no energies, no inverse of M, no rate of momentum, and
forward dynamics of free bases alone, without gravity.
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

    key = "idyntree"
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
        self._seats, self._carriers = {}, {}
        for frame in self.frames:
            carrier = model.getLinkName(indices[frame.joint + 1])
            seat = idt.Transform(idt.Rotation(*frame.R.ravel()), idt.Position(*frame.p))
            model.addAdditionalFrameToLink(carrier, f"frame of {frame.name}", seat)
            self._seats[frame.name] = f"frame of {frame.name}"
            self._carriers[frame.name] = carrier
        model.setDefaultBaseLink(indices[0])
        self.dynamics = idt.KinDynComputations()
        self.dynamics.loadRobotModel(model)
        model = self.dynamics.model()
        joints = (model.getJoint(model.getJointIndex(f"joint of {link.name}")) for link in links)
        self._place = np.array([joint.getDOFsOffset() for joint in joints])

    def _move_to(self, x: Array, rate: Array) -> None:
        """Set the state to coordinates x and velocities `rate`, without gravity."""
        self._under(x, rate, np.zeros(3))

    def _under(self, x: Array, rate: Array, gravity: Array) -> None:
        """Set the state to coordinates x and velocities `rate`, under gravity (3,), m/s²."""
        self.dynamics.setRobotState(self._in_own_order(x), self._in_own_order(rate), gravity)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n), without the part of a base that is held."""
        self._move_to(q, np.zeros(self._n))
        matrix = self._all_by(self.dynamics.getFreeFloatingMassMatrix, self._held + self._n)
        return matrix[self._held :][self._place]

    @property
    def _held(self) -> int:
        """Number of velocities of the library that are no coordinates: those of a held base."""
        return BASE - self.base

    def _all_by(self, method: Any, rows: int) -> Array:
        """Return a matrix (rows, n) of a method of the library, without columns of a held base."""
        matrix = self._idt.MatrixDynSize(rows, self._held + self._n)
        method(matrix)
        return matrix.toNumPy()[:, self._held :][:, self._place]

    def _forces_by(self, method: Any, *arguments: Any) -> Array:
        """Return the generalized forces (n,) of a method of the library, of a free base first."""
        forces = self._idt.FreeFloatingGeneralizedTorques(self.dynamics.model())
        method(*arguments, forces)
        wrench, torques = forces.baseWrench().toNumPy(), forces.jointTorques().toNumPy()
        return np.concatenate([wrench[: self.base], torques])[self._place]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,), without the part of a base that is held."""
        self._move_to(q, v)
        return self._forces_by(self.dynamics.generalizedBiasForces)

    def bias_size(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return |w| |M| |w|, N m, the size of moments v × m (v + ω × c) of a link's momentum."""
        x, S, _ = self.velocity_map(q, v)
        w = np.abs(S @ v)
        return float(w @ np.abs(self.mass_matrix(x, t)) @ w)

    # ---- Conformance quantities ------------------------------------------------------------------

    def _acceleration(self, vdot: Array) -> tuple[Any, Any]:
        """Return the accelerations of the base (6,), 0 where it is held, and of the joints."""
        base, joints = np.split(self._in_own_order(vdot), [self.base])
        base = np.concatenate([base, np.zeros(self._held)])
        return self._idt.Vector6.FromPython(base), self._idt.VectorDynSize.FromPython(joints)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `inverseDynamics`, without the part of a base that is held."""
        self._under(q, v, self._gravity)
        external = self._idt.LinkWrenches(self.dynamics.model())
        external.zero()
        arguments = *self._acceleration(vdot), external
        return self._forces_by(self.dynamics.inverseDynamics, *arguments)

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `generalizedGravityForces`."""
        self._under(q, np.zeros(self._n), self._gravity)
        return self._forces_by(self.dynamics.generalizedGravityForces)

    coriolis_skew = True

    def coriolis_matrix(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return C (n, n) by `getCoriolisAndMassMatrices`."""
        self._move_to(q, v)
        size = self._held + self._n
        others = [self._idt.MatrixDynSize(size, size) for _ in range(2)]
        algorithm = self.dynamics.getCoriolisAndMassMatrices
        C = self._all_by(lambda matrix: algorithm(matrix, *others), size)
        return C[self._held :][self._place]

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `getCenterOfMassPosition`.

        iDynTree counts links that are fixed to a base which is held; they have no mass here.
        """
        self._move_to(q, np.zeros(self._n))
        return self.dynamics.getCenterOfMassPosition().toNumPy()

    def quantity_size(self, name: str, q: Array, v: Array, third: Array, t: float = 0.0) -> float:
        """Return the size of terms that it sums to a quantity and that may cancel; 0 if unknown.

        Those of ∂ċ/∂v are products of the inverse of the locked inertia about the base, and of the
        momentum about the base, moved by the distance of the centre of mass.
        """
        if name not in ("center_of_mass_jacobian", "center_of_mass_acceleration"):
            return super().quantity_size(name, q, v, third, t)
        x, S, rest = self.velocity_map(q, v)
        center = np.linalg.norm(self.center_of_mass(x))
        momentum = np.abs(self._all_by(self.dynamics.getLinearAngularMomentumJacobian, BASE))
        size = np.linalg.norm(np.linalg.inv(self._locked_inertia())) * (1.0 + center)
        asked = np.abs(S)
        if name == "center_of_mass_acceleration":
            asked = asked @ np.abs(third) + np.abs(rest)
        return float(size * np.max(momentum @ asked))

    def _locked_inertia(self) -> Array:
        """Return the inertia (6, 6) of all links about the base, at the state that is set."""
        return self.dynamics.getRobotLockedInertia().asMatrix().toNumPy()

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `getCenterOfMassJacobian`.

        iDynTree divides by the locked inertia about the base: far from it, digits are lost.

        Raises:
            np.linalg.LinAlgError: that inertia is singular to working precision.
        """
        self._move_to(q, np.zeros(self._n))
        return self._center_jacobian()

    def _center_jacobian(self) -> Array:
        """Return ∂ċ/∂v (3, n) at the state that is set."""
        condition = np.linalg.cond(self._locked_inertia())
        if not condition * np.finfo(float).eps < 1.0:
            raise np.linalg.LinAlgError(f"locked inertia of condition number {condition:.2g}")
        return self._all_by(self.dynamics.getCenterOfMassJacobian, 3)

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `getCenterOfMassVelocity`."""
        self._move_to(q, v)
        return self.dynamics.getCenterOfMassVelocity().toNumPy()

    def center_of_mass_acceleration(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return c̈ (3,): J v̇, and `getCenterOfMassBiasAcc`."""
        self._move_to(q, v)
        bias = self.dynamics.getCenterOfMassBiasAcc().toNumPy()
        return self._center_jacobian() @ vdot + bias

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `getCentroidalTotalMomentum`."""
        self._move_to(q, v)
        return self.dynamics.getCentroidalTotalMomentum().asVector().toNumPy()

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return A (6, n) by `getCentroidalTotalMomentumJacobian`."""
        self._move_to(q, np.zeros(self._n))
        return self._all_by(self.dynamics.getCentroidalTotalMomentumJacobian, 6)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `getWorldTransform`."""
        self._move_to(q, np.zeros(self._n))
        pose = self.dynamics.getWorldTransform(self._seats[f])
        return pose.getRotation().toNumPy(), pose.getPosition().toNumPy()

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `getFrameVel`."""
        self._move_to(q, v)
        return self.dynamics.getFrameVel(self._seats[f]).asVector().toNumPy()

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `getFrameFreeFloatingJacobian`."""
        self._move_to(q, np.zeros(self._n))
        algorithm, name = self.dynamics.getFrameFreeFloatingJacobian, self._seats[f]
        return self._all_by(lambda matrix: algorithm(name, matrix), BASE)

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `getFrameAcc`, the rate of `getFrameVel`."""
        self._move_to(q, v)
        arguments = self._seats[f], *self._acceleration(vdot)
        return self.dynamics.getFrameAcc(*arguments).toNumPy()

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) by `getFrameBiasAcc`."""
        self._move_to(q, v)
        return self.dynamics.getFrameBiasAcc(self._seats[f]).toNumPy()

    def regressor(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return Y (n, 10 n_b) by `inverseDynamicsInertialParametersRegressor`.

        Parameters of iDynTree are in our order: m, m c, I about the origin xx, xy, xz, yy, yz, zz.
        """
        self._under(q, v, self._gravity)
        model = self.dynamics.model()
        Y = self._idt.MatrixDynSize(BASE + model.getNrOfDOFs(), 10 * model.getNrOfLinks())
        algorithm = self.dynamics.inverseDynamicsInertialParametersRegressor
        algorithm(*self._acceleration(vdot), Y)
        rows, columns = Y.toNumPy()[self._held :][self._place], []
        for frame, moved in zip(self.body_frames, self.body_parameters, strict=True):
            link = model.getLinkIndex(self._carriers[frame.name])
            columns.append(rows[:, 10 * link : 10 * (link + 1)] @ moved)
        return np.hstack(columns)


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
    coriolis_skew = False  # not for a free base, whose C satisfies C v = B alone

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._idt = library
        loader = library.ModelLoader()
        if not loader.loadModelFromString(description.text, "urdf"):
            raise EngineError(f"{self.key} cannot read the file")
        model = loader.model()
        if description.root in [model.getLinkName(i) for i in range(model.getNrOfLinks())]:
            model.setDefaultBaseLink(model.getLinkIndex(description.root))
        for frame in self.frames:
            if frame.joint < 0 and model.isLinkNameUsed(frame.name):
                held = model.getLink(model.getLinkIndex(frame.name))
                held.setInertia(library.SpatialInertia.Zero())
        self.dynamics = library.KinDynComputations()
        self.dynamics.loadRobotModel(model)
        self.dynamics.setFrameVelocityRepresentation(library.MIXED_REPRESENTATION)
        model = self.dynamics.model()
        # A root without mass becomes a frame of the link that is fixed to it, the model's base.
        base = model.getLinkName(model.getDefaultBaseLink())
        self._base_pose = self.dynamics.getRelativeTransform(description.root, base)
        moving = {}
        for i in range(model.getNrOfJoints()):
            joint = model.getJoint(i)
            if joint.getNrOfDOFs():
                moving[joint.getDOFsOffset()] = model.getJointName(i)
        self._joints = [moving[i] for i in sorted(moving)]
        frames = {model.getFrameName(i) for i in range(model.getNrOfFrames())}
        self._seats = {frame.name: frame.name for frame in self.frames if frame.name in frames}
        self._carriers = self._seats

    def pose(self, base: FreeBase) -> Array:
        """Return the position and the rotation matrix."""
        return np.concatenate([base.position, base.R.ravel()])

    def _under(self, x: Array, rate: Array, gravity: Array) -> None:
        """Set the state to coordinates x and velocities `rate`, under gravity (3,), m/s²."""
        idt = self._idt
        frame, twist = self._base_pose, idt.Twist.Zero()
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
        return -self.gravity(q, t)
