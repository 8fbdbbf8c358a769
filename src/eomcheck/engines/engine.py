"""Engine interface (`Engine`): an external library that derives the same quantities in its own way.

The rules of the contract are numbered, so that a message or a note can refer to one.

1.  An engine is constructed as `Class(scene)`, once for each scene, and called at many states
    (q, v, t), in any order: a result is independent of all earlier calls.
2.  Units are SI, v is q̇ and M q̈ + B = Q + aᵀλ as in `eomcheck.mechanics.scene`. The bias B has
    no gravity in it and no other force: these are Q.
3.  `version`, `represents`, `mass_matrix` and `bias` are required. Any other quantity that an
    engine can compute it offers by overriding the method; a method that it does not override is
    reported as skipped.
4.  An engine with coordinates of its own overrides `velocity_map`. All its other methods then take
    arguments and return results in these, and `eomcheck.engines.answers` maps them to the scene's.
5.  Results are arrays of real numbers, of the given shapes, new or the engine's own. An engine
    changes neither its arguments, nor the floating-point rounding mode, nor the rounding of
    subnormal numbers.
6.  A scene that it cannot represent it rejects in `represents`, once for the whole scene. An
    exception, a wrong shape or a value that is not finite is a failure of the engine.
7.  Only the file of an engine imports its library, and only when the engine is constructed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from eomcheck.errors import required as required
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array


class EngineAcceleration(NamedTuple):
    """Constrained acceleration and multipliers of an engine, M v̇ = F + aᵀλ."""

    vdot: Array
    """Acceleration v̇ (n,)."""
    multipliers: Array | None = None
    """Multipliers λ (r,), or None without constraints, or where the engine does not return them."""


class VelocityMap(NamedTuple):
    """Map from the scene's coordinates to the engine's own: x, and its velocity w = S v, v = q̇.

    With m entries in w, and any number in x: a quaternion has four where its velocity has three.
    """

    x: Array
    """Configuration of the engine (any,)."""
    S: Array
    """Matrix (m, n) of rank n: w = S v."""
    rest: Array
    """Velocity-dependent term Ṡ v (m,), so that ẇ = S v̇ + Ṡ v."""


class Engine(ABC):
    """External model of a scene (rules 1-7).

    Args:
        scene: the scene to represent.

    Raises:
        EngineError: the library is not installed or cannot represent the scene.
    """

    key: ClassVar[str]
    """Name of the engine; by default that of the class in lower case, without "engine"."""

    solves_like: ClassVar[str]
    """Key of the formulation whose matrices its constrained solver factorizes, which determine its
    rounding error. Required only where it overrides `acceleration`."""

    compliant: ClassVar[bool] = False
    """Whether its constraints are soft, as of contacts: constrained accelerations then differ by
    the model and not by a mistake, and no comparison of them can pass or fail."""

    reads_parameters: ClassVar[bool] = True
    """Whether it builds its model from `Scene.parameters`, as the scene's own equations do: an
    error there is then common to both sides. Otherwise from `Scene.tree`."""

    reads_file: ClassVar[bool] = False
    """Whether it reads the file of a robot by itself: either reading may explain a difference."""

    extra: ClassVar[str | None] = None
    """Extra of eomcheck that installs its library; None if eomcheck itself installs it."""

    scene: Scene

    def __new__(cls, scene: Scene, *arguments: Any, **options: Any) -> Self:
        """Set `scene`, so that the `__init__` of a subclass need not call that of this class."""
        engine = super().__new__(cls)
        engine.scene = scene
        return engine

    def __init__(self, scene: Scene):
        super().__init__()  # `scene` is already set

    def __init_subclass__(cls, **options: Any):
        """Give the engine its `key`."""
        super().__init_subclass__(**options)
        if "key" not in vars(cls):
            name = cls.__name__.lower()
            cls.key = name.removesuffix("engine").rstrip("_") or name

    @classmethod
    def offers(cls, method: str) -> bool:
        """Return whether an optional method is overridden."""
        return getattr(cls, method) is not getattr(Engine, method)

    # ---- Required --------------------------------------------------------------------------------

    @classmethod
    @abstractmethod
    def version(cls) -> str:
        """Return name and version of the library, such as "pinocchio 3.4.0"."""

    @classmethod
    @abstractmethod
    def represents(cls, scene: Scene) -> bool:
        """Return whether the engine can represent `scene`."""

    @abstractmethod
    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the mass matrix M (n, n), both triangles."""

    @abstractmethod
    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the bias B (n,): Coriolis and centrifugal terms, without gravity and forces."""

    def bias_size(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return the size of terms that it sums to B and that may cancel, N or N m; 0 if unknown.

        Called for built-in engines only: an engine under test does not set its own allowed error.
        """
        return 0.0

    # ---- Optional: overriding one offers it ------------------------------------------------------

    def velocity_map(self, q: Array, v: Array) -> VelocityMap | tuple[Array, Array, Array]:
        """Return (x, S (m, n), Ṡ v (m,)) of an engine with coordinates of its own.

        All other methods then take x for q, and w = S v for v, and return M (m, m), B (m,),
        Q (m,), a (r, m) and gamma (r,) of M ẇ + B = Q + aᵀλ and a ẇ + gamma = 0.
        """
        return VelocityMap(q, np.eye(self.scene.n), np.zeros(self.scene.n))

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the forces Q (n,): gravity, springs, dampers and all other active forces."""
        raise NotImplementedError

    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the constraint Jacobian a (r, n), rows and signs as in the scene's constraints."""
        raise NotImplementedError

    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the constraint drift gamma (r,), with a v̇ + gamma = 0."""
        raise NotImplementedError

    def kane_inertia_remainder(
        self, q: Array, v: Array, t: float = 0.0
    ) -> tuple[Array, float, float]:
        """Return the velocity-dependent part N_Kane q̇ + G_Kane of Kane's inertia forces.

        Returns:
            The part (p,), the size of its terms, and the condition number of the inverted matrix.
        """
        raise NotImplementedError

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration | tuple[Array, Array | None]:
        """Return the constrained acceleration v̇ (n,) and the multipliers λ (r,) or None.

        Q (n,), a (r, n) and gamma (r,) are the scene's, for an engine that has none of its own;
        others ignore them. a and gamma are None where the scene has no constraints.
        """
        raise NotImplementedError


OPTIONAL = (
    "forces",
    "constraint_jacobian",
    "constraint_drift",
    "kane_inertia_remainder",
    "acceleration",
)
"""Names of the methods that an engine may offer beside M and B."""
