"""Drake, as it reads a URDF, with the base welded to the world or free."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.drake import DrakeEngine
from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import BaseVelocity, FreeBase
from eomcheck.errors import EngineError, required
from eomcheck.numbers.generic import Array


class DrakeFile(FileEngine, DrakeEngine):
    """A URDF by `pydrake.multibody.parsing.Parser`."""

    key = "drake_file"
    base_velocity = BaseVelocity("ground", "ground", turns_first=True)

    def _read(self, library: Any, description: Description) -> None:
        self.plant = plant = library.MultibodyPlant(time_step=0.0)
        parser = required("pydrake.multibody.parsing").Parser(plant)
        (robot,) = parser.AddModelsFromString(description.text, "urdf")
        if self.base and description.root == "world":
            raise EngineError(f"{self.key} welds a link called world to the ground")
        if not self.base and description.root != "world":  # which it welds itself
            base = plant.GetFrameByName(description.root, robot)
            plant.WeldFrames(plant.world_frame(), base)
        plant.Finalize()
        self._no_gravity = np.zeros(3)
        plant.mutable_gravity_field().set_gravity_vector(self._gravity)
        self.context = plant.CreateDefaultContext()
        joints = [plant.get_joint(i) for i in plant.GetJointIndices(robot)]
        moving = sorted((x for x in joints if x.num_velocities()), key=lambda x: x.velocity_start())
        # It gives a free base a joint of its own.
        self._names = [x.name() for x in moving if x.num_velocities() == 1]
        self._damping = np.concatenate([x.default_damping_vector() for x in moving])

    def joints(self) -> list[str]:
        """Return the names of its joints."""
        return self._names

    def _move_to(self, x: Array, rate: Array) -> None:
        self.plant.SetPositionsAndVelocities(self.context, np.concatenate([x, rate]))

    def pose(self, base: FreeBase) -> Array:
        """Return orientation and place."""
        return np.concatenate([base.quaternion, base.place])

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and the damping of its joints."""
        self._move_to(q, v)
        gravity = self.plant.CalcGravityGeneralizedForces(self.context)
        return np.array(gravity) - self._damping * v

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) by articulated bodies."""
        self._move_to(q, v)
        return self._under(np.zeros(self._n))
