"""Pinocchio: mass matrix by CRBA, bias by RNEA, constrained accelerations by its own solver.

In a model read from a URDF, a floating base has a quaternion and a velocity along its own axes;
Pinocchio's algorithms leave out the dampers that it reads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.descriptions.elements import COORDINATES
from eomcheck.descriptions.tree_quantities import BY_COLUMNS
from eomcheck.engines.engine import EngineAcceleration, VelocityMap
from eomcheck.engines.file_engine import (
    FREE,
    BaseVelocity,
    CompoundJoint,
    FileEngine,
    FreeBase,
    RobotDescription,
    few,
    free_base,
)
from eomcheck.engines.tree_engine import TreeLink, TreeSolverEngine
from eomcheck.numbers.generic import Array


class PinocchioEngine(TreeSolverEngine):
    """Tree of rigid bodies as a Pinocchio model."""

    key = "pinocchio"
    module = "pinocchio"
    any_inertia = True

    @classmethod
    def distribution(cls) -> str:
        """Return "pin", the name of Pinocchio's wheels."""
        return "pin"

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
        for frame in self.frames:
            seat = pin.SE3(frame.R, frame.p)
            kind = pin.FrameType.OP_FRAME
            model.addFrame(pin.Frame(frame.name, frame.joint + 1, 0, seat, kind))
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

    # ---- Conformance quantities ------------------------------------------------------------------

    def _under_gravity(self, algorithm: Any, *arguments: Array) -> Any:
        """Return the result of one of Pinocchio's algorithms for the model under gravity."""
        self.model.gravity.linear = self._gravity
        try:
            return algorithm(self.model, self.data, *arguments)
        finally:
            self.model.gravity.linear = np.zeros(3)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `rnea`."""
        return np.array(self._under_gravity(self._pin.rnea, q, v, vdot))

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by `aba`."""
        return np.array(self._under_gravity(self._pin.aba, q, v, tau))

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M⁻¹ (n, n) by `computeMinverse`, which fills its upper triangle."""
        inverse = self._pin.computeMinverse(self.model, self.data, q)
        upper = np.triu(rows_of(inverse, self.model.nv))
        return upper + upper.T - np.diag(np.diagonal(upper))

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,) by `computeGeneralizedGravity`."""
        return np.array(self._under_gravity(self._pin.computeGeneralizedGravity, q))

    def coriolis_matrix(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return C (n, n) by `computeCoriolisMatrix`."""
        C = self._pin.computeCoriolisMatrix(self.model, self.data, q, v)
        return rows_of(C, len(v))

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `computeKineticEnergy`."""
        return float(self._pin.computeKineticEnergy(self.model, self.data, q, v))

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `computePotentialEnergy`."""
        return float(self._under_gravity(self._pin.computePotentialEnergy, q))

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `centerOfMass`."""
        return np.array(self._pin.centerOfMass(self.model, self.data, q))

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `jacobianCenterOfMass`."""
        return rows_of(self._pin.jacobianCenterOfMass(self.model, self.data, q), 3)

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `centerOfMass`."""
        self._pin.centerOfMass(self.model, self.data, q, v)
        return np.array(self.data.vcom[0])

    def center_of_mass_acceleration(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return c̈ (3,) by `centerOfMass`."""
        self._pin.centerOfMass(self.model, self.data, q, v, vdot)
        return np.array(self.data.acom[0])

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `computeCentroidalMomentum`."""
        return np.array(self._pin.computeCentroidalMomentum(self.model, self.data, q, v).vector)

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return A (6, n) by `computeCentroidalMap`."""
        return rows_of(self._pin.computeCentroidalMap(self.model, self.data, q), 6)

    def momentum_rate(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return ḣ (6,) by `computeCentroidalMomentumTimeVariation`."""
        algorithm = self._pin.computeCentroidalMomentumTimeVariation
        return np.array(algorithm(self.model, self.data, q, v, vdot).vector)

    def has_frame(self, f: str) -> bool:
        """Return whether there is a frame of this name; a free base stands on no link."""
        return self._frame_kind(f) is not None

    def _frame(self, f: str, *state: Array) -> tuple[Any, ...]:
        """Return (model, data, frame) after forward kinematics at a state."""
        self._pin.forwardKinematics(self.model, self.data, *state)
        self._pin.updateFramePlacements(self.model, self.data)
        return self.model, self.data, self._frame_index(f)

    def _frame_index(self, f: str) -> int:
        """Return the index of a frame; the library reads beyond its arrays at that of none.

        Raises:
            KeyError: the model has no such frame.
        """
        kind = self._frame_kind(f)
        if kind is None:  # whatever a subclass says that it has
            raise KeyError(f"the model has no frame {f!r}")
        return self.model.getFrameId(f, kind)

    def _frame_kind(self, f: str) -> Any:
        """Return the type of the frame of a link, None without one: a joint may have its name."""
        kinds = self._pin.FrameType
        return next((k for k in (kinds.BODY, kinds.OP_FRAME) if self.model.existFrame(f, k)), None)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) of `oMf`."""
        _, data, frame = self._frame(f, q)
        return np.array(data.oMf[frame].rotation), np.array(data.oMf[frame].translation)

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `getFrameVelocity`, along the axes of the world."""
        axes = self._pin.LOCAL_WORLD_ALIGNED
        return np.array(self._pin.getFrameVelocity(*self._frame(f, q, v), axes).vector)

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `computeFrameJacobian`, along the axes of the world."""
        axes, frame = self._pin.LOCAL_WORLD_ALIGNED, self._frame_index(f)
        return rows_of(self._pin.computeFrameJacobian(self.model, self.data, q, frame, axes), 6)

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `getFrameClassicalAcceleration`."""
        axes = self._pin.LOCAL_WORLD_ALIGNED
        algorithm = self._pin.getFrameClassicalAcceleration
        return np.array(algorithm(*self._frame(f, q, v, vdot), axes).vector)

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,), the acceleration at v̇ = 0."""
        return self.frame_acceleration(f, q, v, np.zeros(len(v)), t)

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v by `computeRNEADerivatives`."""
        by_q, by_v, _ = self._under_gravity(self._pin.computeRNEADerivatives, q, v, vdot)
        return np.array(by_q), np.array(by_v)

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return ∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ by `computeABADerivatives`."""
        parts = self._under_gravity(self._pin.computeABADerivatives, q, v, tau)
        by_q, by_v, by_tau = (np.array(x) for x in parts)
        return by_q, by_v, by_tau

    def regressor(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return Y (n, 10 n_b) by `computeJointTorqueRegressor`, of the frames of its joints."""
        Y = self._under_gravity(self._pin.computeJointTorqueRegressor, q, v, vdot)
        Y = rows_of(Y, len(v))
        columns = []
        for frame, moved in zip(self.body_frames, self.body_parameters, strict=True):
            joint = self.model.frames[self._frame_index(frame.name)].parentJoint
            own = Y[:, 10 * (joint - 1) : 10 * joint][:, BY_COLUMNS]
            columns.append(own @ moved)
        return np.hstack(columns)


def rows_of(matrix: Any, rows: int) -> Array:
    """Return a matrix of so many rows: with one column or row Pinocchio returns a vector."""
    return np.array(matrix).reshape(rows, -1)


# ---- Model read from a URDF ----------------------------------------------------------------------


KINDS_BY_VELOCITIES = {1: "revolute", 3: "planar", FREE: "floating"}
"""Number of velocities of a joint that Pinocchio reads in a URDF -> its kind, of 1 any such one."""


class PinocchioFile(FileEngine, PinocchioEngine):
    """URDF read by `pinocchio.buildModelFromXML`."""

    key = "pinocchio_file"
    base_velocity = BaseVelocity("base", "base")
    undamped = True
    compounds = frozenset({"planar", "floating"})

    _several: tuple[str, ...] = ()
    """Names of the joints with several coordinates, whose dampers Pinocchio does not read."""

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._pin = library
        base = (library.JointModelFreeFlyer(),) if self.base else ()
        self.model = library.buildModelFromXML(description.text, *base)
        self.model.gravity.linear = np.zeros(3)
        self.data = self.model.createData()
        # The first joint is the universe, the next one that of a free base.
        first = 2 if self.base else 1
        named = zip(self.model.names, self.model.joints, strict=True)
        self._joints = []
        for name, joint in [*named][first:]:
            kind = KINDS_BY_VELOCITIES[joint.nv]
            self._joints += [name + part for part in COORDINATES[kind]]
            if joint.nv > 1:
                self._several += (name,)
                own = slice(joint.idx_v, joint.idx_v + joint.nv)
                self._compounds += (CompoundJoint(own, kind),)

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v); x holds cosine and sine of planar joints and those without limits."""
        x, S, rest = super().velocity_map(q, v)
        pose, rates = x[: len(x) - self._n + self.base], np.zeros(self._n)
        x, parts = x[len(x) - self._n :], pose.tolist()
        compounds = {joint.own.start: joint for joint in self._compounds}
        for joint in [*self.model.joints][2 if self.base else 1 :]:
            i = joint.idx_v
            if joint.nv == FREE:
                parts += self.pose(free_base(*compounds[i].state(x, rates))).tolist()
                continue
            *sliding, angle = x[i : i + joint.nv]
            turn = [angle] if joint.nq == joint.nv else [np.cos(angle), np.sin(angle)]
            parts += [*sliding, *turn]
        return VelocityMap(np.array(parts), S, rest)

    def pose(self, base: FreeBase) -> Array:
        """Return the position and the quaternion x, y, z, w."""
        return np.concatenate([base.position, np.roll(base.quaternion, -1)])

    def leaves_out(self, method: str) -> str:
        """Return the dampers that a result leaves out, as text; "" where none are known."""
        unread = [name for name in self._several if name in self.description.damped]
        if method == "forces" and unread:
            return f"it reads no damping of {few(unread)}"
        return super().leaves_out(method)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,) of gravity and of the dampers that it reads."""
        return -self.gravity(q, t) - self.model.damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẇ (m,) by the articulated body algorithm, which leaves out all dampers.

        So it differs from ẇ = M⁻¹ (Q - B) of `forces` where a joint is damped (`undamped`).
        """
        return self.forward_dynamics(q, v, np.zeros(len(v)))
