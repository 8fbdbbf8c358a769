"""MuJoCo with its own model of an MJCF file, without what `from_mjcf` leaves out.

eomcheck validate --scene ant.xml --engine eomcheck.engines.files:MjcfFile
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eomcheck.descriptions.mechanism_class import Mechanism
from eomcheck.descriptions.mjcf_reader import BALL_JOINT, FREE_JOINT, GROUND, read_mjcf
from eomcheck.engines.base import EngineAcceleration, VelocityMap
from eomcheck.engines.files.description import Description
from eomcheck.engines.files.free import FREE, BaseVelocity, free_base
from eomcheck.engines.files.mujoco import MujocoFile
from eomcheck.errors import EngineError
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

TURNS = 3
"""Coordinates of a ball joint; MuJoCo has a quaternion for them."""


class MjcfFile(MujocoFile):
    """An MJCF by `mujoco.MjSpec`, in its own coordinates: quaternions of free and ball joints."""

    key = "mjcf_file"

    def __init__(self, scene: Scene):
        self.scene, self.said = scene, []
        if not (isinstance(scene, Mechanism) and self.represents(scene)):
            raise EngineError(f"{self.key} cannot represent {scene.name} by its file")
        self._mj, self.base = self._library(), 0
        read = read_mjcf(Path(scene.made.source))
        self.model = read.compiled
        self.model.opt.disableflags |= int(self._mj.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model.opt.disableflags &= ~int(self._mj.mjtDisableBit.mjDSBL_GRAVITY)
        self.model.opt.gravity[:] = 0.0
        self._gravity = np.zeros(3)
        if (gravity := getattr(scene, "gravity", None)) is not None:
            self._gravity[: len(gravity)] = gravity
        self.data = self._mj.MjData(self.model)
        self._n, self._place = self.model.nv, np.arange(self.model.nv)
        place = {name: i for i, name in enumerate(scene.coordinate_names)}
        self._in_file = [place[name] for name in read.coordinates]
        self.coordinates, self.shift = np.eye(self._n)[self._in_file], np.zeros(self._n)
        damped = zip(read.coordinates, self.model.dof_damping, strict=True)
        names = frozenset(name for name, damping in damped if damping)
        self.description = Description("", GROUND, {}, names, (), (), ())

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return f"mujoco {cls._library().__version__}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is an MJCF file, with the parameters that stand there."""
        if not isinstance(scene, Mechanism):
            return False
        return scene.made.format == "mjcf" and scene.as_described

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v): what is free slides along axes of the ground, turns about its own."""
        x: list[float] = []
        q, v = q[self._in_file], v[self._in_file]
        S, rest, i = np.eye(self._n), np.zeros(self._n), 0
        for kind in self.model.jnt_type:
            if kind not in (FREE_JOINT, BALL_JOINT):
                x, i = [*x, float(q[i])], i + 1
                continue
            count = FREE if kind == FREE_JOINT else TURNS
            moved = np.zeros((2, FREE))
            moved[:, FREE - count :] = q[i : i + count], v[i : i + count]
            base = free_base(*moved)
            whole, more = base.velocity(BaseVelocity("ground", "base"), moved[1])
            here, part = slice(i, i + count), slice(FREE - count, FREE)
            S[here, here], rest[here] = whole[part, part], more[part]
            x += [*(base.place if count == FREE else ()), *base.quaternion]
            i += count
        return VelocityMap(np.array(x), S @ self.coordinates, rest)

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return ẇ under MuJoCo's own forces; λ by our a and gamma: its constraints are soft."""
        if a is None:
            return EngineAcceleration(self.free_acceleration(q, v))
        return self.eliminated(q, v, self.forces(q, v, t), a, gamma, t)
