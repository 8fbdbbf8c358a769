"""What engines have in common that build their model from a scene's tree of bodies."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from eomcheck.engines.base import Engine, VelocityMap
from eomcheck.engines.walk import Link, links_of
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.contract import Array


class TreeEngine(Engine):
    """A tree of rigid bodies as a model of the library's own, in coordinates of its joints x = T q.

    A subclass says what the library answers in these, in the order of the links (rule 4).
    """

    module: ClassVar[str]
    """What to import."""

    solves_like = "gw"
    reads_parameters = False

    def __init__(self, scene: Scene):
        super().__init__(scene)
        tree = scene.tree()
        if tree is None or not self.represents(scene):
            raise EngineError(f"{self.key} cannot represent {scene.name} as a tree of bodies")
        self.coordinates: Array = tree.coordinates
        """T (n, n)."""
        self.shift: Array = tree.shift
        """x where q = 0 (n,)."""
        self._n = scene.n
        self._build(self._library(), self.links(tree))

    @classmethod
    def _library(cls) -> Any:
        return required(cls.module, cls.extra)

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return f"{cls.key} {cls._library().__version__}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the scene is described as a tree that the library can hold."""
        tree = scene.tree()
        return tree is not None and own_coordinates(tree) and cls.holds(cls.links(tree))

    @classmethod
    def links(cls, tree: Tree) -> list[Link]:
        """Return the links that the model is built from."""
        return links_of(tree)

    @classmethod
    def holds(cls, links: list[Link]) -> bool:
        """Return whether the library can hold such a tree.

        By default none with rotors, nor with a link that has inertia but no mass.
        """
        return not any(link.armature or link.turns_without_mass for link in links)

    @abstractmethod
    def _build(self, library: Any, links: list[Link]) -> None:
        """Build the library's model, without gravity and forces."""

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (T q + shift, T, 0)."""
        return VelocityMap(self.coordinates @ q + self.shift, self.coordinates, np.zeros(self._n))


def own_coordinates(tree: Tree) -> bool:
    """Return whether every joint has a coordinate of its own, and none follows another's."""
    joints, coordinates = tree.coordinates.shape
    return joints == coordinates
