"""Drake: its `MultibodyPlant` in continuous time, which has no constraints.

In a model read from a URDF or SDF, the base is welded to the world or free. Spatial vectors of
Drake have the rotational part first; its spatial accelerations are classical. It has no regressor
of bodies, no momentum matrix and no inverse of M by itself. Its derivatives are of the plant in
`AutoDiffXd`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.engines.engine import EngineAcceleration
from eomcheck.engines.file_engine import BaseVelocity, FileEngine, FreeBase, RobotDescription
from eomcheck.engines.tree_engine import TreeLink, TreeSolverEngine
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array


class DrakeEngine(TreeSolverEngine):
    """Tree of rigid bodies as a Drake plant."""

    key = "drake"
    module, extra = "pydrake.multibody.plant", "drake"

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        parts, math = required("pydrake.multibody.tree"), required("pydrake.math")
        self.plant = plant = library.MultibodyPlant(time_step=0.0)
        plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
        bodies, joints = [plant.world_body()], []
        for link in links:
            body = plant.AddRigidBody(link.name, _inertia(parts, link))
            pose = math.RigidTransform(math.RotationMatrix(link.rotation), link.offset)
            parent = bodies[link.parent + 1].body_frame()
            seat = plant.AddFrame(parts.FixedOffsetFrame(f"seat of {link.name}", parent, pose))
            kind = parts.PrismaticJoint if link.slides else parts.RevoluteJoint
            joint = kind(f"joint of {link.name}", seat, body.body_frame(), link.axis)
            joints.append(plant.AddJoint(joint))
            bodies.append(body)
        self._seats = {}
        for frame in self.frames:
            pose = math.RigidTransform(math.RotationMatrix(frame.R), frame.p)
            carrier = bodies[frame.joint + 1].body_frame()
            seat = parts.FixedOffsetFrame(f"frame of {frame.name}", carrier, pose)
            self._seats[frame.name] = plant.AddFrame(seat)
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self._moving = joints
        self._place = np.array([joint.velocity_start() for joint in joints])

    def _move_to(self, x: Array, rate: Array) -> None:
        state = np.zeros(2 * self._n)
        state[self._place], state[self._n + self._place] = x, rate
        self.plant.SetPositionsAndVelocities(self.context, state)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by composite body inertias."""
        self._move_to(q, np.zeros(self._n))
        return self._in_tree_order(self.plant.CalcMassMatrix(self.context))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by inverse dynamics; it does not include gravity."""
        self._move_to(q, v)
        return self.plant.CalcBiasTerm(self.context)[self._place]

    def _under(self, force: Array) -> Array:
        """Return the acceleration (n,) by the articulated body algorithm, without constraints."""
        applied = self._in_own_order(force)
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, applied)
        port = self.plant.get_generalized_acceleration_output_port()
        return np.array(port.Eval(self.context))[self._place]

    def solved(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return v̇ and λ by forward dynamics: under Q, and at rest under each row of a.

        Accelerations are linear in forces; λ solves a v̇ + gamma = 0 of the scene's a and gamma.
        """
        self._move_to(q, v)
        free = self._under(Q)
        if a is None or gamma is None:
            return EngineAcceleration(free, None)
        self._move_to(q, np.zeros(self._n))
        responses = np.array([self._under(row) for row in a]).T
        multipliers = np.linalg.solve(a @ responses, -gamma - a @ free)
        return EngineAcceleration(free + responses @ multipliers, multipliers)

    # ---- Conformance quantities ------------------------------------------------------------------

    @contextmanager
    def _weight_alone(self, q: Array, v: Array) -> Iterator[None]:
        """Set the state under gravity, and dampers to 0.

        A state that is set makes Drake forget what it computed under another gravity.
        """
        field = self.plant.mutable_gravity_field()
        before = np.array(field.gravity_vector())
        dampers = [np.array(joint.GetDampingVector(self.context)) for joint in self._moving]
        field.set_gravity_vector(self._gravity)
        for joint, damping in zip(self._moving, dampers, strict=True):
            joint.SetDampingVector(self.context, np.zeros_like(damping))
        self._move_to(q, v)
        try:
            yield
        finally:
            field.set_gravity_vector(before)
            for joint, damping in zip(self._moving, dampers, strict=True):
                joint.SetDampingVector(self.context, damping)

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) by `CalcInverseDynamics`, with the forces of the gravity field."""
        with self._weight_alone(q, v):
            forces = required("pydrake.multibody.tree").MultibodyForces(self.plant)
            self.plant.CalcForceElementsContribution(self.context, forces)
            state = self.context, self._in_own_order(vdot), forces
            return self.plant.CalcInverseDynamics(*state)[self._place]

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) by the articulated body algorithm, τ as applied generalized force."""
        with self._weight_alone(q, v):
            return self._under(tau)

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), minus `CalcGravityGeneralizedForces`."""
        with self._weight_alone(q, np.zeros(self._n)):
            return -self.plant.CalcGravityGeneralizedForces(self.context)[self._place]

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T by `CalcKineticEnergy`."""
        self._move_to(q, v)
        return float(self.plant.CalcKineticEnergy(self.context))

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U by `CalcPotentialEnergy`, 0 for bodies at the origin."""
        with self._weight_alone(q, np.zeros(self._n)):
            return float(self.plant.CalcPotentialEnergy(self.context))

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return c (3,) by `CalcCenterOfMassPositionInWorld`.

        Drake counts links that are welded to the ground; they have no mass here.
        """
        self._move_to(q, np.zeros(self._n))
        return self.plant.CalcCenterOfMassPositionInWorld(self.context)

    @property
    def _by_speeds(self) -> Any:
        """Variables of Jacobians: velocities v, and not rates of coordinates."""
        return required("pydrake.multibody.tree").JacobianWrtVariable.kV

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂ċ/∂v (3, n) by `CalcJacobianCenterOfMassTranslationalVelocity`."""
        self._move_to(q, np.zeros(self._n))
        world = self.plant.world_frame()
        algorithm = self.plant.CalcJacobianCenterOfMassTranslationalVelocity
        return algorithm(self.context, self._by_speeds, world, world)[:, self._place]

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return ċ (3,) by `CalcCenterOfMassTranslationalVelocityInWorld`."""
        self._move_to(q, v)
        return self.plant.CalcCenterOfMassTranslationalVelocityInWorld(self.context)

    def center_of_mass_acceleration(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return c̈ (3,): J v̇, and `CalcBiasCenterOfMassTranslationalAcceleration`.

        `CalcCenterOfMassTranslationalAccelerationInWorld` takes v̇ of forward dynamics alone.
        """
        jacobian = self.center_of_mass_jacobian(q)
        self._move_to(q, v)
        world = self.plant.world_frame()
        algorithm = self.plant.CalcBiasCenterOfMassTranslationalAcceleration
        bias = algorithm(self.context, self._by_speeds, world, world)
        return jacobian @ vdot + np.ravel(bias)

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return h (6,) by `CalcSpatialMomentumInWorldAboutPoint`, of the centre of mass."""
        center = self.center_of_mass(q)
        self._move_to(q, v)
        momentum = self.plant.CalcSpatialMomentumInWorldAboutPoint(self.context, center)
        return _linear_first(momentum)

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (R, p) by `Frame.CalcPoseInWorld`."""
        self._move_to(q, np.zeros(self._n))
        pose = self._seats[f].CalcPoseInWorld(self.context)
        return pose.rotation().matrix(), pose.translation()

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) by `Frame.CalcSpatialVelocityInWorld`."""
        self._move_to(q, v)
        return _linear_first(self._seats[f].CalcSpatialVelocityInWorld(self.context))

    def _of_origin(self, f: str) -> tuple[Any, ...]:
        """Return arguments of a method about the origin of a frame, in the world."""
        world = self.plant.world_frame()
        return self.context, self._by_speeds, self._seats[f], np.zeros(3), world, world

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return J (6, n) by `CalcJacobianSpatialVelocity`, whose rotational rows are first."""
        self._move_to(q, np.zeros(self._n))
        jacobian = self.plant.CalcJacobianSpatialVelocity(*self._of_origin(f))
        return np.roll(jacobian, 3, axis=0)[:, self._place]

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (6,) by `CalcSpatialAccelerationsFromVdot`.

        That of the body is moved to the frame by `SpatialAcceleration.Shift`.
        """
        self._move_to(q, v)
        frame = self._seats[f]
        state = self.context, self._in_own_order(vdot)
        every = self.plant.CalcSpatialAccelerationsFromVdot(*state)
        pose = frame.body().body_frame().CalcPoseInWorld(self.context)
        arm = pose.rotation().matrix() @ frame.GetFixedPoseInBodyFrame().translation()
        omega = frame.CalcSpatialVelocityInWorld(self.context).rotational()
        return _linear_first(every[int(frame.body().index())].Shift(arm, omega))

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return J̇ v (6,) by `CalcBiasSpatialAcceleration`."""
        self._move_to(q, v)
        return _linear_first(self.plant.CalcBiasSpatialAcceleration(*self._of_origin(f)))

    @cached_property
    def _differentiated(self) -> tuple[Any, Any]:
        """The plant in `AutoDiffXd`, under gravity, and its context."""
        plant = self.plant.ToAutoDiffXd()
        plant.mutable_gravity_field().set_gravity_vector(self._gravity)
        return plant, plant.CreateDefaultContext()

    def _variables(self, q: Array, v: Array, third: Array) -> tuple[Any, Any, Any]:
        """Set a state of variables q, v and `third`, under gravity and without dampers.

        A derivative by q is the rate along a velocity, also of quaternions.

        Returns:
            The differentiated plant, its context, and `third` in Drake's order.
        """
        plant, context = self._differentiated
        with self._weight_alone(q, v):
            context.SetTimeStateAndParametersFrom(self.context)
            state = self.plant.GetPositionsAndVelocities(self.context)
            units = np.eye(self._n)[self._place]
            moves = [self.plant.MapVelocityToQDot(self.context, unit) for unit in units]
        none = np.zeros((self._n, self._n))
        by_q = np.hstack((np.column_stack(moves), np.zeros((len(moves[0]), 2 * self._n))))
        by_v, by_third = np.hstack((none, units.T, none)), np.hstack((none, none, units.T))
        variables = required("pydrake.autodiffutils").InitializeAutoDiff
        plant.SetPositionsAndVelocities(context, variables(state, np.vstack((by_q, by_v))))
        return plant, context, variables(self._in_own_order(third), by_third)

    def _gradients(self, values: Any) -> list[Array]:
        """Return the derivatives (n, n) by q, v and a third variable."""
        gradient = required("pydrake.autodiffutils").ExtractGradient(values)
        return np.hsplit(gradient[self._place], 3)

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v of `CalcInverseDynamics`, by automatic differentiation."""
        plant, context, rates = self._variables(q, v, vdot)
        number = required("pydrake.autodiffutils").AutoDiffXd
        forces = required("pydrake.multibody.tree").MultibodyForces_[number](plant)
        plant.CalcForceElementsContribution(context, forces)
        by_q, by_v, _ = self._gradients(plant.CalcInverseDynamics(context, rates, forces))
        return by_q, by_v

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return those of the articulated body algorithm, by automatic differentiation."""
        plant, context, applied = self._variables(q, v, tau)
        plant.get_applied_generalized_force_input_port().FixValue(context, applied)
        port = plant.get_generalized_acceleration_output_port()
        by_q, by_v, by_tau = self._gradients(port.Eval(context))
        return by_q, by_v, by_tau


def _coordinates(joint: Any) -> list[str]:
    """Return the names of the coordinates of a joint; the universal one of an SDF has two."""
    name = joint.name()
    return [name] if joint.num_velocities() == 1 else [f"{name}_axis", f"{name}_axis2"]


def _linear_first(spatial: Any) -> Array:
    """Return a spatial vector of Drake (6,) with its translational part first."""
    return np.concatenate([spatial.translational(), spatial.rotational()])


def _inertia(parts: Any, link: TreeLink) -> Any:
    if link.mass == 0:
        return parts.SpatialInertia.Zero()
    moments = parts.RotationalInertia(*link.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    return parts.SpatialInertia.MakeFromCentralInertia(link.mass, link.center, moments)


# ---- Model read from a URDF ----------------------------------------------------------------------


class DrakeFile(FileEngine, DrakeEngine):
    """URDF read by `pydrake.multibody.parsing.Parser`."""

    key = "drake_file"
    base_velocity = BaseVelocity("ground", "ground", turns_first=True)

    def _read(self, library: Any, description: RobotDescription) -> None:
        self.plant = plant = library.MultibodyPlant(time_step=0.0)
        parser = required("pydrake.multibody.parsing").Parser(plant)
        (robot,) = parser.AddModelsFromString(description.text, self.format)
        if self.base and description.root == "world":
            raise EngineError(f"{self.key} welds a link called world to the ground")
        if not self.base and description.root != "world":  # a link "world" Drake welds itself
            base = plant.GetBodyByName(description.root, robot)
            # Of an SDF where the file places it; a URDF does not.
            pose = plant.GetDefaultFloatingBaseBodyPose(base)
            plant.WeldFrames(plant.world_frame(), base.body_frame(), pose)
        plant.Finalize()
        self._no_gravity = np.zeros(3)
        plant.mutable_gravity_field().set_gravity_vector(self._gravity)
        self.context = plant.CreateDefaultContext()
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(robot)]
        moving = sorted((x for x in joints if x.num_velocities()), key=lambda x: x.velocity_start())
        # Drake adds a joint of its own for a free base.
        self._moving = [x for x in moving if x.num_velocities() < 3]
        self._joints = [name for x in self._moving for name in _coordinates(x)]
        names = [x.name for x in self.frames if plant.HasFrameNamed(x.name, robot)]
        self._seats = {name: plant.GetFrameByName(name, robot) for name in names}
        for body in plant.GetBodiesWeldedTo(plant.world_body()):
            if body.index() != plant.world_body().index():
                body.SetMass(self.context, 0.0)
        self._damping = np.concatenate([x.default_damping_vector() for x in moving])

    def _move_to(self, x: Array, rate: Array) -> None:
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([x, rate]))

    def pose(self, base: FreeBase) -> Array:
        """Return the quaternion w, x, y, z and the position."""
        return np.concatenate([base.quaternion, base.position])

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and the damping of its joints."""
        self._move_to(q, v)
        gravity = self.plant.CalcGravityGeneralizedForces(self.context)
        return np.array(gravity) - self._damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by the articulated body algorithm."""
        self._move_to(q, v)
        return self._under(np.zeros(self._n))


class DrakeSdf(DrakeFile):
    """SDF read by `pydrake.multibody.parsing.Parser`, with one model, no springs and no loops."""

    key = "drake_sdf"
    format = "sdf"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is the only model of an SDF, without springs and loops.

        Nested models are instances of their own in a plant.
        """
        return (
            super().represents(scene)
            and isinstance(scene, Mechanism)
            and not (scene.source.model or scene.r or hasattr(scene, "stiffness"))
            and not any("::" in frame.name for frame in scene.source.frames)
        )
