"""`MujocoCopy`: base class of engines whose library copies a model that MuJoCo has compiled.

MuJoCo builds the model of a tree, or reads the file; the library then copies it, with joints,
coordinates and velocities as MuJoCo has them. There is a class for each of the three: trees, URDF
and MJCF.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

from eomcheck.engines.engine import VelocityMap
from eomcheck.engines.file_engine import BaseVelocity, FileEngine, RobotDescription
from eomcheck.engines.mujoco import MjcfFile, MujocoEngine, MujocoFile
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.numbers.generic import Array


class MujocoCopy(TreeEngine):
    """Tree of rigid bodies as a copy of MuJoCo's model."""

    built_by: ClassVar[type[MujocoEngine]] = MujocoEngine
    """Class that has MuJoCo compile the model."""

    _builder: MujocoEngine

    @classmethod
    def holds(cls, links: list[TreeLink]) -> bool:
        """Return whether MuJoCo holds it."""
        return MujocoEngine.holds(links)

    def _build(self, library: Any, links: list[TreeLink]) -> None:
        self._copy(library)

    def _copy(self, library: Any) -> None:
        """Have MuJoCo compile the model, and copy it."""
        self._builder = builder = object.__new__(self.built_by)
        self._prepare(builder)
        builder.set_up(self.inputs._replace(r=0))
        self._load(library, builder.model)
        self._place = builder._place

    def _prepare(self, builder: MujocoEngine) -> None:
        """Set options of the compilation; by default none."""

    @abstractmethod
    def _load(self, library: Any, model: Any) -> None:
        """Copy a model of MuJoCo, which has no gravity."""

    def _without(self, *parts: str) -> None:
        """Switch parts of MuJoCo's model off, by the names of its `mjtDisableBit`."""
        for part in parts:
            bit = getattr(self._builder._mj.mjtDisableBit, f"mjDSBL_{part}")
            self._builder.model.opt.disableflags |= int(bit)

    def _ordered(self, values: Array) -> Array:
        """Return coordinates, in the order of the tree, in MuJoCo's order."""
        return self._in_own_order(values)

    def _rates(self, x: Array) -> Array:
        """Return the derivative (n_x, n) of the library's coordinates by its velocities."""
        return self._builder.position_rates(x)

    def has_frame(self, f: str) -> bool:
        """Return whether there is a site or body of this name."""
        return self._builder.has_frame(f)


class MujocoCopyOfFile(FileEngine, MujocoCopy):
    """URDF that MuJoCo reads, as a copy of its model."""

    built_by = MujocoFile
    base_velocity = BaseVelocity("ground", "base")

    def _read(self, library: Any, description: RobotDescription) -> None:
        self._copy(library)
        assert isinstance(self._builder, MujocoFile)
        self._joints = self._builder.joints()

    def _ordered(self, values: Array) -> Array:
        return values


class MujocoCopyOfMjcf(MujocoCopyOfFile):
    """MJCF that MuJoCo reads, as a copy of its model, in MuJoCo's coordinates."""

    format = "mjcf"
    built_by = MjcfFile

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return that of MuJoCo."""
        return self._builder.velocity_map(q, v)

    def velocity_map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return those of MuJoCo."""
        return self._builder.velocity_map_derivatives(q, v)
