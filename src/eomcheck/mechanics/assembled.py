"""Scenes that give their bodies' Jacobians; Lagrange's terms and generalized speeds follow.

A scene under `Assembled` writes down how its bodies move with v, and what constrains them. What it
does not write itself is composed from that:

- `terms`: M = Σ Jᵀ m J + Σ Jᵀ I J and what belongs to it, `constraints`, `drift` and `forces`
- `kinematics`, `speeds`, `speeds_of`: u is the independent part of v, the paper's partition with
  the first r velocities dependent: W = [-a₁⁻¹ a₂; 1], offset = [-a₁⁻¹ b; 0], and
  rest = [-a₁⁻¹ gamma; 0], for which no ẇ is needed
- `bodies`: partial velocities J W, remainders J rest + J̇ v
- `energies`: T from `velocities`, U from `potential`

Without constraints there is no W: u is v.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.mechanics.records import Bodies, Speeds, Terms, velocity
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


class Jacobians(NamedTuple):
    """Velocities of the bodies as J v, and their accelerations as J v̇ + rest.

    V of the centres of mass in any directions, of which `linear_rest` is the whole acceleration
    left even if they turn; in space ω in directions that turn with the body, or otherwise keep its
    inertia constant, of which `angular_rest` is the whole acceleration left too.
    """

    linear: Any
    """∂V_k/∂v (n_b, d, n)."""
    angular: Any
    """∂ω_k/∂v (n_b, e, n)."""
    linear_rest: Any
    """J̇ v of the centres of mass (n_b, d)."""
    angular_rest: Any
    """J̇ v of the rotations (n_b, e)."""
    gyroscopic: Any
    """ω × I ω (n_b, e), or None in the plane."""


class Embedded(NamedTuple):
    """Generalized speeds by a partition, and what they share with the bodies."""

    q: Any
    v: Any
    """W u + offset (n,)."""
    W: Any
    rest: Any
    offset: Any


# ---- Lagrange's terms ----------------------------------------------------------------------------


@generic
def inertia_terms(mass, inertia, linear, angular, linear_rest, angular_rest, gyroscopic):
    """Return (M (n, n), B (n,)): the inertia forces J^T (m V̇, I ω̇ + ω × I ω), body by body."""
    bodies, d, n = linear.shape
    e = angular.shape[1]
    M, B = np.zeros((n, n), linear.dtype), np.zeros(n, linear.dtype)
    for k in range(bodies):
        for i in range(n):
            for c in range(d):
                momentum = mass[k] * linear[k, c, i]
                B[i] += momentum * linear_rest[k, c]
                for j in range(i + 1):
                    M[i, j] += momentum * linear[k, c, j]
            for c in range(e):
                for f in range(e):
                    momentum = inertia[k, c, f] * angular[k, f, i]
                    B[i] += momentum * angular_rest[k, c]
                    for j in range(i + 1):
                        M[i, j] += momentum * angular[k, c, j]
                if gyroscopic is not None:
                    B[i] += angular[k, c, i] * gyroscopic[k, c]
    for i in range(n):
        for j in range(i):
            M[j, i] = M[i, j]
    return M, B


@generic
def gyroscopic_moments(inertia, omega):
    """Return ω × I ω (n_b, 3) of bodies in space."""
    moments = np.zeros(omega.shape, omega.dtype)
    for k in range(omega.shape[0]):
        x, y, z = omega[k, 0], omega[k, 1], omega[k, 2]
        for i in range(3):
            # The share of the component omega_i in the angular momentum.
            moments[k, 0] += (y * inertia[k, 2, i] - z * inertia[k, 1, i]) * omega[k, i]
            moments[k, 1] += (z * inertia[k, 0, i] - x * inertia[k, 2, i]) * omega[k, i]
            moments[k, 2] += (x * inertia[k, 1, i] - y * inertia[k, 0, i]) * omega[k, i]
    return moments


def _assemble(scene: type[Assembled]) -> Callable:
    forces, constraints, drift = scene.forces, scene.constraints, scene.drift

    def assemble(parameters, prepared, q, v, bodies):
        J, J_w, rest, rest_w, gyroscopic = bodies
        mass, inertia = parameters.mass, parameters.inertia
        M, B = inertia_terms(mass, inertia, J, J_w, rest, rest_w, gyroscopic)
        a, b = constraints(parameters, prepared, q)
        Q = forces(parameters, prepared, q, v)
        return Terms(M, Q, B, a, drift(parameters, prepared, q, v), b)

    return assemble


def _terms(scene: type[Assembled]) -> Callable:
    jacobians, assemble = scene.jacobians, scene.assemble
    assert assemble is not None

    def terms(parameters, prepared, q, v):
        return assemble(parameters, prepared, q, v, jacobians(parameters, prepared, q, v))

    return terms


# ---- Generalized speeds by a partition -----------------------------------------------------------


@generic
def embedding(a, b):
    """Return (W (n, p), offset (n,)) by the first r columns of a; None where there is neither."""
    if a is None:
        return None, None
    r, n = a.shape
    first = np.ascontiguousarray(a[:, :r])
    W = np.zeros((n, n - r), a.dtype)
    W[:r] = -solve(first, np.ascontiguousarray(a[:, r:]), "a_1")
    for i in range(n - r):
        W[r + i, i] = 1
    if b is None:
        return W, None
    offset = np.zeros(n, a.dtype)
    offset[:r] = -solve(first, b, "a_1")
    return W, offset


@generic
def embedded_rest(a, gamma):
    """Return v̇ at u̇ = 0 (n,), or None where u is v."""
    if a is None:
        return None
    r, n = a.shape
    rest = np.zeros(n, a.dtype)
    rest[:r] = -solve(np.ascontiguousarray(a[:, :r]), gamma, "a_1")
    return rest


@generic
def independent(a, v):
    """Return the independent part of v (p,)."""
    if a is None:
        return v + 0
    return v[a.shape[0] :] + 0


@generic
def speeds(parameters, prepared, embedded):
    """Return the `Speeds`."""
    return Speeds(embedded.W, embedded.rest, embedded.offset)


def _kinematics(scene: type[Assembled]) -> Callable:
    constraints, drift = scene.constraints, scene.drift

    def kinematics(parameters, prepared, q, u):
        a, b = constraints(parameters, prepared, q)
        W, offset = embedding(a, b)
        v = velocity(u, W, offset)
        rest = embedded_rest(a, drift(parameters, prepared, q, v))
        return Embedded(q, v, W, rest, offset)

    return kinematics


def _speeds_of(scene: type[Assembled]) -> Callable:
    constraints = scene.constraints

    def speeds_of(parameters, prepared, q, v):
        a, _ = constraints(parameters, prepared, q)
        return independent(a, v)

    return speeds_of


# ---- Bodies --------------------------------------------------------------------------------------


@generic
def partials(J, W):
    """Return J W (n_b, c, p)."""
    if W is None:
        return J
    bodies, c, n = J.shape
    return (J.reshape(bodies * c, n) @ W).reshape(bodies, c, W.shape[1])


@generic
def remainders(J, J_rest, rest):
    """Return J rest + J̇ v (n_b, c)."""
    if rest is None:
        return J_rest
    bodies, c, n = J.shape
    return (J.reshape(bodies * c, n) @ rest).reshape(bodies, c) + J_rest


@generic
def projected(W, Q):
    """Return Wᵀ Q (p,), or None."""
    if Q is None:
        return None
    if W is None:
        return Q
    return np.ascontiguousarray(W.T) @ Q


def _bodies(scene: type[Assembled]) -> Callable:
    jacobians, forces = scene.jacobians, scene.forces

    def bodies(parameters, prepared, embedded):
        q, v, W, rest, _ = embedded
        J, J_w, J_rest, J_w_rest, gyroscopic = jacobians(parameters, prepared, q, v)
        return Bodies(
            partials(J, W),
            partials(J_w, W),
            remainders(J, J_rest, rest),
            remainders(J_w, J_w_rest, rest),
            parameters.mass,
            parameters.inertia,
            gyroscopic,
            projected(W, forces(parameters, prepared, q, v)),
        )

    return bodies


# ---- Energies ------------------------------------------------------------------------------------


@generic
def kinetic_energy(mass, inertia, V, omega):
    """Return Σ m V²/2 + Σ ω I ω/2, J, with V (n_b, d) and ω (n_b, e)."""
    T = 0
    for k in range(V.shape[0]):
        for c in range(V.shape[1]):
            T += mass[k] * V[k, c] * V[k, c]
        for c in range(omega.shape[1]):
            for f in range(omega.shape[1]):
                T += omega[k, c] * inertia[k, c, f] * omega[k, f]
    return T / 2


def _energies(scene: type[Assembled]) -> Callable:
    velocities, potential = scene.velocities, scene.potential

    def energies(parameters, prepared, q, v):
        V, omega = velocities(parameters, prepared, q, v)
        T = kinetic_energy(parameters.mass, parameters.inertia, V, omega)
        return T, potential(parameters, prepared, q)

    return energies


# ---- The scene -----------------------------------------------------------------------------------


@generic
def no_constraints(parameters, prepared, q):
    """Return (a, b) of a scene without constraints."""
    return None, None


@generic
def nothing_moving(parameters, prepared, q, v):
    """Return what a scene has not that depends on v: drift, forces or constraints."""
    return


@generic
def no_potential(parameters, prepared, q):
    """Return the potential energy of a scene that has none."""
    return


_COMPOSED: dict[str, Callable[[type[Assembled]], Callable]] = {
    "assemble": _assemble,
    "terms": _terms,
    "kinematics": _kinematics,
    "speeds_of": _speeds_of,
    "bodies": _bodies,
    "energies": _energies,
}
"""Name of a scene's function -> what composes it from the others."""


_made: set[Callable] = set()
"""What was composed, and not written by a scene."""


class Assembled(Scene):
    """A scene that gives its bodies' Jacobians, see the module.

    `parameters.mass` is (n_b,) and `parameters.inertia` (n_b, e, e). Beside `prepare` and
    `velocities` a scene writes, all generic:

    - `jacobians(parameters, prepared, q, v) -> Jacobians`
    - `forces(parameters, prepared, q, v) -> Q (n,)` and `potential(parameters, prepared, q) -> U`,
      either of them None where it is absent
    - with constraints: `constraints(parameters, prepared, q) -> (a, b)`,
      `drift(parameters, prepared, q, v) -> gamma` and `constraint(parameters, prepared, q, v) -> c`

    With natural generalized speeds also `kinematics`, `speeds`, `bodies`, `speeds_of`. `assemble`
    makes `terms` of Jacobians that are known; it is None where `terms` is written.
    """

    jacobians: ClassVar[Callable[..., Any]]
    assemble: ClassVar[Callable[..., Any] | None]
    forces: ClassVar[Callable[..., Any]] = staticmethod(nothing_moving)
    potential: ClassVar[Callable[..., Any]] = staticmethod(no_potential)
    constraints = staticmethod(no_constraints)
    drift: ClassVar[Callable[..., Any]] = staticmethod(nothing_moving)
    constraint = staticmethod(nothing_moving)
    speeds = staticmethod(speeds)

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        for name, compose in _COMPOSED.items():
            written = getattr(cls, name, None)
            if written is None or written in _made:
                function = compose(cls)
                function.__module__, function.__qualname__ = (
                    cls.__module__,
                    f"{cls.__name__}.{name}",
                )
                _made.add(function)
                setattr(cls, name, staticmethod(generic(function)))
        cls.natural_speeds = cls.kinematics not in _made
        if cls.terms not in _made:
            cls.assemble = None
