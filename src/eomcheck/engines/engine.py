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
    arguments and return results in these, and `Answers` maps them to the scene's.
5.  Results are arrays of real numbers, of the given shapes, new or the engine's own. An engine
    changes neither its arguments, nor the floating-point rounding mode, nor the rounding of
    subnormal numbers.
6.  A scene that it cannot represent it rejects in `represents`, once for the whole scene. An
    exception, a wrong shape or a value that is not finite is a failure of the engine.
7.  Only the file of an engine imports its library, and only when the engine is constructed.
8.  An engine that does not compute in float64 declares `unit_roundoff`. Every array that it is
    handed, and t, is then rounded to its numbers first, x and w of rule 4 too, so that the
    reference computes the same state; the parameters that it reads from its scene it rounds
    itself. Both sorts of rounding are part of the error that is allowed, C κ ε with
    ε = u + 2⁻⁵³. Its numbers have the range of float32, or a larger one.

This file and those of engines need NumPy and one library: they are imported in the processes of
`eomcheck.engines.isolation` too.
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
    """External model of a scene (rules 1-8).

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

    unit_roundoff: ClassVar[float] = 2.0**-53
    """Unit roundoff u of the numbers in which it computes, half their spacing at 1: a power of two,
    2**-53 for float64, 2**-24 for float32 (rule 8)."""

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

    # ---- Optional: conformance quantities, `eomcheck.evaluation.conformance` ---------------------

    coriolis_skew: ClassVar[bool] = False
    """Whether Ṁ = C + Cᵀ holds for its Coriolis matrix."""

    def velocity_map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return (∂(S v)/∂q (m, n), ∂(Ṡ v)/∂q (m, n)) of `velocity_map`; q and v are the scene's.

        Without it, its derivatives by q are skipped where it has coordinates of its own.
        """
        raise NotImplementedError

    def quantity_size(self, name: str, q: Array, v: Array, third: Array, t: float = 0.0) -> float:
        """Return the size of terms that it sums to a quantity and that may cancel; 0 if unknown.

        Called for built-in engines only, as `bias_size`, and with the scene's coordinates.

        Args:
            name: name of the quantity.
            q: coordinates (n,).
            v: velocities (n,).
            third: acceleration v̇ (n,), or τ (n,) of forward dynamics.
            t: time, s.
        """
        biased = name in ("inverse_dynamics", "coriolis_matrix", "regressor")
        return self.bias_size(q, v, t) if biased else 0.0

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the generalized forces M v̇ + B + ∂U/∂q (n,), of forces the weight alone."""
        raise NotImplementedError

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return the acceleration M⁻¹ (τ - B - ∂U/∂q) (n,), without constraints, under weight."""
        raise NotImplementedError

    def inverse_mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the inverse of the mass matrix (n, n)."""
        raise NotImplementedError

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return the gradient ∂U/∂q (n,) of the potential energy of weight."""
        raise NotImplementedError

    def coriolis_matrix(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the matrix C (n, n) with C v = B; see `coriolis_skew`."""
        raise NotImplementedError

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return the kinetic energy, J, of bodies and rotors."""
        raise NotImplementedError

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return the potential energy of weight, J, up to a constant."""
        raise NotImplementedError

    def center_of_mass(self, q: Array, t: float = 0.0) -> Array:
        """Return the position (3,) of the centre of mass of all bodies, m."""
        raise NotImplementedError

    def center_of_mass_jacobian(self, q: Array, t: float = 0.0) -> Array:
        """Return the derivatives (3, n) of its velocity by v."""
        raise NotImplementedError

    def center_of_mass_velocity(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (3,) of the centre of mass, m/s."""
        raise NotImplementedError

    def center_of_mass_acceleration(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the acceleration (3,) of the centre of mass, m/s²."""
        raise NotImplementedError

    def momentum(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the momentum (6,): linear, then angular about the centre of mass."""
        raise NotImplementedError

    def momentum_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the matrix A (6, n) with momentum A v."""
        raise NotImplementedError

    def momentum_rate(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the rate of the momentum (6,)."""
        raise NotImplementedError

    def has_frame(self, f: str) -> bool:
        """Return whether its model has this link; by default True.

        Libraries that merge links fixed to others have no frame of these.
        """
        return True

    def frame_placement(self, f: str, q: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return the orientation R (3, 3) and position p (3,) of the link's frame."""
        raise NotImplementedError

    def frame_velocity(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the velocity (6,) of its origin, then angular, along the axes of the world."""
        raise NotImplementedError

    def frame_jacobian(self, f: str, q: Array, t: float = 0.0) -> Array:
        """Return the derivatives (6, n) of `frame_velocity` by v."""
        raise NotImplementedError

    def frame_acceleration(self, f: str, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the rate (6,) of `frame_velocity`: classical acceleration, then angular."""
        raise NotImplementedError

    def frame_bias(self, f: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the `frame_acceleration` (6,) at v̇ = 0, J̇ v."""
        raise NotImplementedError

    derivatives_by_differences: ClassVar[bool] = False
    """Whether its derivatives are difference quotients, which no bound of rounding explains."""

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return the derivatives of `inverse_dynamics` by q and v (n, n) each, v̇ constant."""
        raise NotImplementedError

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return the derivatives of `forward_dynamics` by q, v and τ (n, n) each.

        In coordinates of its own those by q are along its velocities: ∂/∂q stands for the rate
        along each entry of w, as x moves by it.
        """
        raise NotImplementedError

    def constraint_force_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return the derivatives (r, n) of λ by q and v, M v̇ + B + ∂U/∂q = τ + aᵀλ.

        Compared for an engine whose velocities are constant sums of the scene's.
        """
        raise NotImplementedError

    def regressor(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return the matrix Y (n, 10 n_b): `inverse_dynamics` without rotors is Y π."""
        raise NotImplementedError
