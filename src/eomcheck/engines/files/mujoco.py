"""MuJoCo, as it reads a URDF: limits, contacts and constraints are switched off."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import BaseVelocity
from eomcheck.engines.mujoco import MujocoEngine
from eomcheck.errors import EngineError
from eomcheck.numbers.generic import Array


class MujocoFile(FileEngine, MujocoEngine):
    """A URDF by `mujoco.MjSpec.from_string`, which makes of it what `MjModel` does."""

    key = "mujoco_file"
    compliant = False
    base_velocity = BaseVelocity("ground", "base")

    def _read(self, library: Any, description: Description) -> None:
        self._mj = library
        spec = library.MjSpec.from_string(description.text)
        if self.base:
            if description.root == "world":
                raise EngineError(f"{self.key} makes a link called world the ground")
            spec.compiler.fusestatic = False  # else nothing is left of the root but the ground
            spec.body(description.root).add_freejoint()
        self.model = model = spec.compile()
        model.opt.gravity[:] = 0.0
        off = library.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT)
        self.data = library.MjData(model)

    def joints(self) -> list[str]:
        """Return the names of its joints; a free base has the first."""
        return [self.model.joint(i).name for i in range(bool(self.base), self.model.njnt)]

    def _move_to(self, x: Array, rate: Array) -> None:
        self.data.qpos[:], self.data.qvel[:] = x, rate

    def _under_gravity(self, q: Array, v: Array) -> None:
        self.model.opt.gravity[:] = self._gravity
        self._move_to(q, v)
        self._mj.mj_forward(self.model, self.data)
        self.model.opt.gravity[:] = 0.0

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and what its joints damp and spring."""
        self._under_gravity(q, np.zeros(len(v)))  # moving, the bias would cancel against itself
        gravity = -self.data.qfrc_bias
        self._under_gravity(q, v)
        return gravity + self.data.qfrc_passive

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) of `mj_forward`."""
        self._under_gravity(q, v)
        return self.data.qacc.copy()
