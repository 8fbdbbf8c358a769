"""What engines have in common that read the file of a scene by a parser of their own.

They are the engines that build their model from the scene's tree, but for how the model is made.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from eomcheck.engines.base import EngineAcceleration, VelocityMap
from eomcheck.engines.files.description import Description, described, few, file_of, is_free
from eomcheck.engines.files.free import FREE, BaseVelocity, FreeBase, free_base
from eomcheck.engines.files.said import listening
from eomcheck.engines.tree import TreeEngine
from eomcheck.errors import EngineError
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

FILE = "_file"
"""How the key of an engine ends that reads files."""


class FileEngine(TreeEngine):
    """A scene that is a robot description, as the library itself reads the file.

    Its coordinates are those of the library's joints, in the library's order: x = S q + shift, S
    constant. A joint that follows another one is a coordinate of its own to most libraries. Those
    of a free base come before, and `pose` says what they are.

    Attributes:
        said: lines that the library wrote while it read the file.
    """

    reads_file = True

    base_velocity: ClassVar[BaseVelocity]
    """What it has for the velocity of a free base."""

    undamped: ClassVar[bool] = False
    """Whether its accelerations leave out the dampers of the file."""

    def __init__(self, scene: Scene):
        self.scene = scene
        file = file_of(scene)
        if file is None or not self.represents(scene):
            raise EngineError(f"{self.key} cannot represent {scene.name} by its file")
        self.description, self.base = described(file), FREE if is_free(scene) else 0
        self._gravity = np.zeros(3)
        if (gravity := getattr(scene, "gravity", None)) is not None:
            self._gravity[: len(gravity)] = gravity  # of what moves in a plane, its part there
        library = self._library()
        with listening() as self.said:
            self._read(library, self.description)
        self.coordinates, self.shift = self._followed(self.joints())
        self._n, self._place = len(self.shift), np.arange(len(self.shift))

    def _followed(self, joints: list[str]) -> tuple[Array, Array]:
        """Return S (m, n) and shift (m,), x = S q + shift, for joints of these names.

        Raises:
            EngineError: it has another joint than the file, or lacks one.
        """
        names, base = self.scene.coordinate_names, self.base
        places = {name: i for i, name in enumerate(names)}
        S, shift = np.zeros((base + len(joints), len(names))), np.zeros(base + len(joints))
        S[:base, :base] = np.eye(base)
        for i, name in enumerate(joints, base):
            factor, of = 1.0, name
            while of in self.description.follows:
                of, ratio, offset = self.description.follows[of]
                shift[i] += factor * offset
                factor *= ratio
            if of not in places:
                raise EngineError(f"{self.key} has a joint {name!r} that the file does not move")
            S[i, places[of]] = factor
        for name, column in zip(self.scene.coordinate_names, S.T, strict=True):
            if not column.any():
                raise EngineError(f"{self.key} has no joint {name!r}, which the file moves")
        return S, shift

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return super().version().replace(FILE, "")

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a file, with the parameters that stand there."""
        return file_of(scene) is not None

    def leaves_out(self, method: str) -> str:
        """Return the part of the file that an answer leaves out; "" where none is known.

        Args:
            method: the name of the method that is asked.
        """
        if method == "acceleration" and self.undamped and self.description.damped:
            return f"its accelerations leave out the damping of {few(self.description.damped)}"
        dropped = [line for line in self.said if "inertia" in line.lower()]
        return f"while it read the file it wrote {dropped[0]!r}" if dropped else ""

    @abstractmethod
    def _read(self, library: Any, description: Description) -> None:
        """Make the library's model by its own parser, the base held unless `base` is not 0."""

    @abstractmethod
    def joints(self) -> list[str]:
        """Return the names of its joints, one for each entry of its velocity behind the base's."""

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (S q + shift, S, 0); of a free base its `pose`, and what S is there, in front."""
        x, S = self.coordinates @ q + self.shift, self.coordinates.copy()
        rest = np.zeros(len(x))
        if self.base:
            base = self.base_frame(q, v)
            S[:FREE, :FREE], rest[:FREE] = base.velocity(self.base_velocity, v[:FREE])
            x = np.concatenate([self.pose(base), x[FREE:]])
        return VelocityMap(x, S, rest)

    def base_frame(self, q: Array, v: Array) -> FreeBase:
        """Return where the frame is that the library moves with a free base; q, v the scene's."""
        return free_base(q[:FREE], v[:FREE])

    def free_base(self, q: Array, v: Array) -> tuple[FreeBase, BaseVelocity] | None:
        """Return that frame, and what its velocity is taken to be; None of a base that is held."""
        return (self.base_frame(q, v), self.base_velocity) if self.base else None

    def pose(self, base: FreeBase) -> Array:
        """Return what it has for coordinates of a free base."""
        return np.concatenate([base.place, base.quaternion])

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return ẍ under the library's own forces."""
        if self.follow:  # which most libraries leave to a constraint solver
            return self.eliminated(q, v, self.forces(q, v, t), None, None, t)
        return EngineAcceleration(self.free_acceleration(q, v))

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,); by M, B and Q unless the library has a way of its own."""
        return np.linalg.solve(self.mass_matrix(q), self.forces(q, v) - self.bias(q, v))
