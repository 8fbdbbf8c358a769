"""Functions of a scene derived from its small contract: terms, speeds, bodies, energies.

A scene writes `jacobians`, `forces`, `velocities` and so on (see `Scene`); `derive_missing` adds
the others to its class:

- `prepare`: the angles, their cosines and sines
- `terms`: M = Σ Jᵀ m J + Σ Jᵀ I J and the bias B that belongs to it, `constraints`, `drift` and
  `forces`
- `kinematics`, `speeds`, `speeds_of`: u is the independent part of v, the paper's partition with
  the first r velocities dependent: W = [-a₁⁻¹ a₂; 1], offset = [-a₁⁻¹ b; 0], and
  rest = [-a₁⁻¹ gamma; 0], for which no ẇ is needed. Without constraints there is no W: u is v
- `bodies`: partial velocities J W, accelerations at u̇ = 0, J rest + J̇ v
- `energies`: T from `velocities`, U from `potential`
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.records import Bodies, Speeds, Terms, velocity_from_speeds
from eomcheck.numbers.generic import generic
from eomcheck.numbers.linear import solve


class PartitionedSpeeds(NamedTuple):
    """Generalized speeds by a partition, with the matrices that `speeds` and `bodies` share."""

    q: Any
    v: Any
    """W u + offset (n,)."""
    W: Any
    rest: Any
    offset: Any


# ---- Lagrange's terms ----------------------------------------------------------------------------


@generic
def inertia_terms(mass, inertia, linear, angular, linear_rest, angular_rest, gyroscopic):
    """Return (M (n, n), B (n,)) of the inertia forces J^T (m V̇, I ω̇ + ω × I ω), body by body."""
    bodies, d, n = linear.shape
    e = angular.shape[1]
    inertia = inertia.reshape(bodies, e, e)
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


def _assemble(jacobians, forces, constraints, drift):
    def assemble(parameters, prepared, q, v, bodies):
        M, B = inertia_terms(parameters.mass, parameters.inertia, *bodies)
        a, b = constraints(parameters, prepared, q)
        Q = forces(parameters, prepared, q, v)
        return Terms(M, Q, B, a, drift(parameters, prepared, q, v), b)

    return assemble


def _terms(jacobians, assemble):
    def terms(parameters, prepared, q, v):
        return assemble(parameters, prepared, q, v, jacobians(parameters, prepared, q, v))

    return terms


# ---- Generalized speeds by a partition -----------------------------------------------------------


@generic
def leading_embedding(a, b):
    """Return (W (n, p), offset (n,)) by the first r columns of a; None for an absent one."""
    if a is None:
        return None, None
    r, n = a.shape
    first = np.ascontiguousarray(a[:, :r])
    dependent = solve(first, np.ascontiguousarray(a[:, r:]), "a_1")
    W = np.zeros((n, n - r), a.dtype)
    W[:r] = -dependent
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


def _kinematics(jacobians, constraints, drift):
    def kinematics(parameters, prepared, q, u):
        a, b = constraints(parameters, prepared, q)
        W, offset = leading_embedding(a, b)
        v = velocity_from_speeds(u, W, offset)
        rest = embedded_rest(a, drift(parameters, prepared, q, v))
        return PartitionedSpeeds(q, v, W, rest, offset)

    return kinematics


def _speeds(jacobians):
    def speeds(parameters, prepared, embedded):
        return Speeds(embedded.W, embedded.rest, embedded.offset)

    return speeds


def _speeds_of(jacobians, constraints):
    def speeds_of(parameters, prepared, q, v):
        a, _ = constraints(parameters, prepared, q)
        return independent(a, v)

    return speeds_of


# ---- Bodies --------------------------------------------------------------------------------------


def support_of(scene: Any, movable: Any) -> Any:
    """Return a mask of the generalized speeds that can move each body, bool (n_b, p).

    See `Scene.support`.

    Args:
        scene: the scene.
        movable: mask of the coordinates that can move each body, bool (n_b, n).
    """
    if not {"kinematics", "bodies"} <= scene.derived_functions:
        return None
    # The first r velocities depend on all the others.
    dependent = movable[:, : scene.r].any(axis=1, keepdims=True)
    return movable[:, scene.r :] | dependent


@generic
def partials(J, W):
    """Return J W (n_b, c, p)."""
    if W is None:
        return J
    bodies, c, n = J.shape
    return (J.reshape(bodies * c, n) @ W).reshape(bodies, c, W.shape[1])


@generic
def remainders(J, J_rest, rest):
    """Return the accelerations at u̇ = 0, J rest + J̇ v (n_b, c)."""
    if rest is None:
        return J_rest
    bodies, c, n = J.shape
    return (J.reshape(bodies * c, n) @ rest).reshape(bodies, c) + J_rest


@generic
def projected_forces(W, Q):
    """Return Wᵀ Q (p,), or None without Q."""
    if Q is None:
        return None
    if W is None:
        return Q
    return np.ascontiguousarray(W.T) @ Q


def _bodies(jacobians, forces):
    def bodies(parameters, prepared, embedded):
        q, v, W, rest, _ = embedded
        J, J_w, J_rest, J_w_rest, gyroscopic = jacobians(parameters, prepared, q, v)
        return Bodies(
            partials(J, W),
            partials(J_w, W),
            remainders(J, J_rest, rest),
            remainders(J_w, J_w_rest, rest),
            parameters.mass,
            parameters.inertia.reshape(J.shape[0], J_w.shape[1], J_w.shape[1]),
            gyroscopic,
            projected_forces(W, forces(parameters, prepared, q, v)),
        )

    return bodies


# ---- Energies ------------------------------------------------------------------------------------


@generic
def kinetic_energy(mass, inertia, V, omega):
    """Return Σ m V²/2 + Σ ω I ω/2, J, with V (n_b, d) and ω (n_b, e)."""
    T = 0
    bodies, e = omega.shape
    inertia = inertia.reshape(bodies, e, e)
    for k in range(bodies):
        for c in range(V.shape[1]):
            T += mass[k] * V[k, c] * V[k, c]
        for c in range(e):
            for f in range(e):
                T += omega[k, c] * inertia[k, c, f] * omega[k, f]
    return T / 2


def _energies(velocities, potential):
    def energies(parameters, prepared, q, v):
        V, omega = velocities(parameters, prepared, q, v)
        T = kinetic_energy(parameters.mass, parameters.inertia, V, omega)
        return T, potential(parameters, prepared, q)

    return energies


# ---- Scene class ---------------------------------------------------------------------------------


def _prepare(angle_coordinates):
    def prepare(arithmetic, parameters, q, t):
        return arithmetic.angles(q[angle_coordinates])

    def unprepared(arithmetic, parameters, q, t):
        return

    return unprepared if angle_coordinates == slice(0, 0) else prepare


def _constraints(jacobians):
    def constraints(parameters, prepared, q):
        return None, None

    return constraints


_DERIVATIONS: dict[str, Callable[..., Callable]] = {
    "prepare": _prepare,
    "constraints": _constraints,
    "assemble": _assemble,
    "terms": _terms,
    "kinematics": _kinematics,
    "speeds": _speeds,
    "speeds_of": _speeds_of,
    "bodies": _bodies,
    "energies": _energies,
}
"""Name of a scene's function -> function that derives it from those named by its arguments."""


@generic
def no_velocity_term(parameters, prepared, q, v):
    """Return None, for a drift, forces or constraints that a scene does not have."""
    return


def _drift_required(kind: Any) -> Callable:
    """Return a drift that raises InputError if the scene has constraints, for a class without."""
    constraints, why = kind.constraints, f"{kind.__name__} has constraints but no `drift`"

    def drift(parameters, prepared, q, v):
        a, _ = constraints(parameters, prepared, q)
        if a is not None:
            raise InputError(why)

    return generic(drift)


def derive_missing(kind: Any) -> None:
    """Add to a scene class the functions that it does not write itself, if their parts exist.

    Sets `derived_functions` to the names of the added functions. Inherited derived functions are
    derived again from the parts of the subclass.
    """
    composed = set()
    own = {}
    if getattr(kind, "drift", None) is no_velocity_term and hasattr(kind, "constraints"):
        own["drift"] = _drift_required(kind)
    for name, composer in _DERIVATIONS.items():
        owner = next((base for base in kind.__mro__ if name in vars(base)), None)
        parts = [own.get(x, getattr(kind, x, None)) for x in signature(composer).parameters]
        if (
            owner is None or name in vars(owner).get("derived_functions", ())
        ) and None not in parts:
            function = composer(*parts)
            function.__module__ = kind.__module__
            function.__qualname__ = f"{kind.__name__}.{name}"
            setattr(kind, name, staticmethod(generic(function)))
            composed.add(name)
    kind.derived_functions = frozenset(composed)
