"""Drake: its `MultibodyPlant` in continuous time, which has no constraints.

In a model read from a URDF, the base is welded to the world or free.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.engine import EngineAcceleration
from eomcheck.engines.file_engine import BaseVelocity, FileEngine, FreeBase, RobotDescription
from eomcheck.engines.tree_engine import TreeLink, TreeSolverEngine
from eomcheck.errors import EngineError, required
from eomcheck.numbers.generic import Array


class DrakeEngine(TreeSolverEngine):
    """Tree of rigid bodies as a Drake plant."""

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
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self._place = np.array([joint.velocity_start() for joint in joints])

    def _move_to(self, x: Array, rate: Array) -> None:
        state = np.zeros(2 * self._n)
        state[self._place], state[self._n + self._place] = x, rate
        self.plant.SetPositionsAndVelocities(self.context, state)

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) by composite body inertias."""
        self._move_to(q, np.zeros(self._n))
        return self.plant.CalcMassMatrix(self.context)[np.ix_(self._place, self._place)]

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) by inverse dynamics; it does not include gravity."""
        self._move_to(q, v)
        return self.plant.CalcBiasTerm(self.context)[self._place]

    def _under(self, force: Array) -> Array:
        """Return the acceleration (n,) by the articulated body algorithm, without constraints."""
        applied = np.zeros(self._n)
        applied[self._place] = force
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
        (robot,) = parser.AddModelsFromString(description.text, "urdf")
        if self.base and description.root == "world":
            raise EngineError(f"{self.key} welds a link called world to the ground")
        if not self.base and description.root != "world":  # a link "world" Drake welds itself
            base = plant.GetFrameByName(description.root, robot)
            plant.WeldFrames(plant.world_frame(), base)
        plant.Finalize()
        self._no_gravity = np.zeros(3)
        plant.mutable_gravity_field().set_gravity_vector(self._gravity)
        self.context = plant.CreateDefaultContext()
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(robot)]
        moving = sorted((x for x in joints if x.num_velocities()), key=lambda x: x.velocity_start())
        # Drake adds a joint of its own for a free base.
        self._joints = [x.name() for x in moving if x.num_velocities() == 1]
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
