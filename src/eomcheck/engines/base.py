"""What an engine is: an outside library that derives the same quantities in its own way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar, NamedTuple

import numpy as np

from eomcheck.errors import required as required
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.contract import Array


class EngineAcceleration(NamedTuple):
    """Constrained acceleration and multipliers as an engine sees them, M v̇ = F + aᵀλ."""

    vdot: Array
    """(n,)."""
    multipliers: Array | None
    """(r,), or None without constraints."""


class Engine(ABC):
    """An outside library with its own model of a scene, in the scene's coordinates and signs.

    Every quantity is one at a state (q, v, t), t in s.

    Only the file of an engine imports its library, and only when the engine is made.

    Args:
        scene: the scene to represent.

    Raises:
        EngineError: the library is not installed or cannot represent the scene.
    """

    key: ClassVar[str]
    solves_like: ClassVar[str]
    """The formulation whose matrices its constrained solver factorizes: its rounding is of that
    kind."""

    reads_parameters: ClassVar[bool] = True
    """Whether it builds its model from `Scene.parameters`, as the scene's own equations do: what is
    wrong there is then wrong on both sides. Otherwise from `Scene.tree`."""

    def __init__(self, scene: Scene):
        self.scene = scene
        self.coordinates: Array = np.eye(scene.n)
        """T (n, n): the library's own coordinates are T q."""

    @classmethod
    @abstractmethod
    def version(cls) -> str:
        """Return name and version of the library."""

    @classmethod
    @abstractmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the library can represent `scene`."""

    @abstractmethod
    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n)."""

    @abstractmethod
    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,)."""

    def mass_matrix_size(self, q: Array, t: float = 0.0) -> float:
        """Return the size of the terms that the library sums to M, where that exceeds M itself."""
        return 0.0

    def bias_size(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return the size of the terms that the library sums to B, where that exceeds B itself."""
        return 0.0

    @abstractmethod
    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return the constrained acceleration.

        Q, a and gamma are ours, for an engine that has none of its own; others ignore them.
        """


class DerivingEngine(Engine):
    """An engine that derives forces and constraints itself, from energies and c(q, q̇, t)."""

    @abstractmethod
    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (n,)."""

    @abstractmethod
    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return a (r, n)."""

    @abstractmethod
    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return gamma (r,)."""

    @abstractmethod
    def kane_inertia_remainder(
        self, q: Array, v: Array, t: float = 0.0
    ) -> tuple[Array, float, float]:
        """Return (N_Kane q̇ + G_Kane (p,), size of the terms, condition of what was inverted)."""
