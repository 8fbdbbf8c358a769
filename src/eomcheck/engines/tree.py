"""What engines have in common that build their model from a scene's tree of bodies."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from eomcheck.engines.base import Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.walk import Link, links_of
from eomcheck.errors import EngineError, required
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.generic import Array

TOUCHING = 1e-12
"""Relative: of a thin rod or plate one moment is the sum of the others."""


class TreeEngine(Engine):
    """A tree of rigid bodies as a model of the library's own, in coordinates of its joints x = T q.

    A subclass says what the library answers in these, in the order of the links (rule 4). Joints
    that follow others move by themselves in the model: M, B and Q are taken along T, and v̇
    is that of the library's M and B.
    """

    module: ClassVar[str]
    """What to import."""

    any_inertia: ClassVar[bool] = False
    """Whether it takes moments of inertia that no body has."""

    solves_like = "gw"
    reads_parameters = False

    def __init__(self, scene: Scene):
        super().__init__(scene)
        tree = scene.tree()
        if tree is None or not self.represents(scene):
            raise EngineError(f"{self.key} cannot represent {scene.name} as a tree of bodies")
        self.coordinates: Array = tree.coordinates
        """T (m, n), x = T q + shift for the m joints of the tree."""
        self.shift: Array = tree.shift
        """x where q = 0 (m,)."""
        self._n = len(tree.joint)
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
        if tree is None or not all_move(tree):
            return False
        links = cls.links(tree)
        return cls.holds(links) and (cls.any_inertia or all(map(cls.takes, links)))

    @classmethod
    def links(cls, tree: Tree) -> list[Link]:
        """Return the links that the model is built from."""
        return links_of(tree)

    @classmethod
    def takes(cls, link: Link) -> bool:
        """Return whether the moments of inertia of a link are those of some body.

        None is negative and none exceeds the sum of the others; many libraries refuse or replace
        what is not so. In the plane moments about other axes do not count, and all are the same.
        """
        low, middle, high = link.principal[0]
        return bool(low >= -TOUCHING * high and low + middle >= high * (1 - TOUCHING))

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

    @property
    def follow(self) -> bool:
        """Whether some joints follow others."""
        return self._n > self.scene.n

    def eliminated(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None, t: float
    ) -> EngineAcceleration:
        """Return ẍ (m,) and λ by the library's M and B, joints that follow eliminated.

        All is handed in the coordinates of the joints, as to `acceleration`.
        """
        T = self.coordinates
        M, F = T.T @ self.mass_matrix(q, t) @ T, T.T @ (Q - self.bias(q, v, t))
        free = np.linalg.solve(M, F)
        if a is None or gamma is None:
            return EngineAcceleration(T @ free, None)
        rows = a @ T
        responses = np.linalg.solve(M, rows.T)
        multipliers = np.linalg.solve(rows @ responses, -gamma - rows @ free)
        return EngineAcceleration(T @ (free + responses @ multipliers), multipliers)


def all_move(tree: Tree) -> bool:
    """Return whether no coordinate is without a joint of its own: others may follow it."""
    return bool(np.linalg.matrix_rank(tree.coordinates) == tree.coordinates.shape[1])
