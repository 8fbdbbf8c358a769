"""What engines have in common that read the file of a scene by a parser of their own.

They are the engines that build their model from the scene's tree, but for how the model is made.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from eomcheck.engines.base import EngineAcceleration, VelocityMap
from eomcheck.engines.files.description import Description, described
from eomcheck.engines.tree import TreeEngine
from eomcheck.errors import EngineError
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array


class FileEngine(TreeEngine):
    """A scene that is a robot description, as the library itself reads the file.

    Its coordinates are those of the library's joints, in the library's order: x = S q + shift, S
    constant. A joint that follows another one is a coordinate of its own to most libraries.
    """

    def __init__(self, scene: Scene):
        self.scene = scene
        if not self.represents(scene):
            raise EngineError(f"{self.key} reads files; {scene.name} is not as its file says")
        self.description = described(scene.file)  # type: ignore[attr-defined]
        self._gravity = np.asarray(scene.gravity_vector)  # type: ignore[attr-defined]
        self._read(self._library(), self.description)
        names = list(self.joints())
        places = {name: i for i, name in enumerate(scene.coordinate_names)}
        self.coordinates, self.shift = np.zeros((len(names), scene.n)), np.zeros(len(names))
        for i, name in enumerate(names):
            factor, of = 1.0, name
            while of in self.description.mimics:
                follows = self.description.mimics[of]
                self.shift[i] += factor * follows.offset
                factor, of = factor * follows.multiplier, follows.joint
            if of not in places:
                raise EngineError(f"{self.key} has a joint {name!r} that the file does not move")
            self.coordinates[i, places[of]] = factor
        still = np.flatnonzero(~self.coordinates.any(axis=0))
        if still.size:
            lost = scene.coordinate_names[still[0]]
            raise EngineError(f"{self.key} has no joint {lost!r}, which the file moves")
        self._n, self._place = len(names), np.arange(len(names))

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is a file, with the parameters that stand there."""
        return getattr(scene, "file", None) is not None

    @abstractmethod
    def _read(self, library: Any, description: Description) -> None:
        """Make the library's model by its own parser, the base held."""

    @abstractmethod
    def joints(self) -> list[str]:
        """Return the names of its joints, one for each entry of its velocity."""

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (S q + shift, S, 0)."""
        x = self.coordinates @ q + self.shift
        return VelocityMap(x, self.coordinates, np.zeros(len(x)))

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return ẍ under the library's own forces.

        Where joints follow others, which most libraries leave to a constraint solver, of the
        library's own M, B and Q.
        """
        S = self.coordinates
        if len(S) == self.scene.n:
            return EngineAcceleration(self.free_acceleration(q, v))
        F = self.forces(q, v, t) - self.bias(q, v, t)
        return EngineAcceleration(S @ np.linalg.solve(S.T @ self.mass_matrix(q, t) @ S, S.T @ F))

    def free_acceleration(self, q: Array, v: Array) -> Array:
        """Return ẍ (m,); by M, B and Q unless the library has a way of its own."""
        return np.linalg.solve(self.mass_matrix(q), self.forces(q, v) - self.bias(q, v))
