"""MuJoCo, as it reads a URDF: limits, contacts and constraints are switched off."""

from __future__ import annotations

from typing import Any

from eomcheck.engines.files.base import FileEngine
from eomcheck.engines.files.description import Description
from eomcheck.engines.mujoco import MujocoEngine
from eomcheck.numbers.contract import Array


class MujocoFile(FileEngine, MujocoEngine):
    """A URDF by `mujoco.MjModel.from_xml_string`."""

    key = "mujoco_file"
    compliant = False

    def _read(self, library: Any, description: Description) -> None:
        self._mj = library
        self.model = model = library.MjModel.from_xml_string(description.text)
        model.opt.gravity[:] = 0.0
        off = library.mjtDisableBit
        model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT)
        self.data = library.MjData(model)

    def joints(self) -> list[str]:
        """Return the names of its joints."""
        return [self.model.joint(i).name for i in range(self.model.njnt)]

    def _under_gravity(self, q: Array, v: Array) -> None:
        self.model.opt.gravity[:] = self._gravity
        self._move_to(q, v)
        self._mj.mj_forward(self.model, self.data)
        self.model.opt.gravity[:] = 0.0

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (m,): gravity, and what its joints damp and spring."""
        bias = self.bias(q, v)
        self._under_gravity(q, v)
        return self.data.qfrc_passive - self.data.qfrc_bias + bias

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,) of `mj_forward`."""
        self._under_gravity(q, v)
        return self.data.qacc.copy()
