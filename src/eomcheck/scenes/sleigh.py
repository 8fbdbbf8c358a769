"""Chaplygin's sleigh: a body in the plane on one knife edge, its centre of mass off the edge.

q = [x, y, θ], (x, y) where the edge touches, θ its direction. Below t = (cos θ, sin θ) and
n = (-sin θ, cos θ); the centre of mass is at (x, y) + ℓ t. The edge moves along t only. The
generalized speeds are u = (s, ω): the speed of the edge along t, and θ̇. Source: Chaplygin 1911;
Neimark and Fufaev 1972, Ch. III.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics import plane
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Bodies, Range, Speeds, Symmetry, Terms, Tree
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic


class Parameters(NamedTuple):
    """The parameters of a `Sleigh` in some kind of number."""

    mass: Any
    """m (1,), kg."""
    inertia: Any
    """About the centre of mass (1,), kg m²."""
    offset: Any
    """ℓ (1,), m."""


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Angles` of the edge (1,)."""
    return arithmetic.angles(q[2:])


# ---- Lagrange's terms ----------------------------------------------------------------------------


@generic
def constraints(parameters, angle, q):
    """Return (a (1, 3), None): the velocity of the edge along -n vanishes."""
    a = np.zeros((1, 3), q.dtype)
    a[0, 0], a[0, 1] = angle.sin[0], -angle.cos[0]
    return a, None


@generic
def terms(parameters, angle, q, v):
    """Return the `Terms` of the sleigh: neither forces nor b."""
    mass, offset = parameters.mass[0], parameters.offset[0]
    cos, sin, omega = angle.cos[0], angle.sin[0], v[2]
    moment = mass * offset
    M = np.zeros((3, 3), q.dtype)
    M[0, 0] = M[1, 1] = mass
    M[0, 2] = M[2, 0] = -moment * sin
    M[1, 2] = M[2, 1] = moment * cos
    M[2, 2] = parameters.inertia[0] + moment * offset
    B = np.zeros(3, q.dtype)
    B[0] = -moment * cos * omega * omega
    B[1] = -moment * sin * omega * omega
    a, _ = constraints(parameters, angle, q)
    gamma = np.zeros(1, q.dtype)
    gamma[0] = omega * (v[0] * cos + v[1] * sin)
    return Terms(M, None, B, a, gamma, None)


# ---- Natural generalized speeds ------------------------------------------------------------------


@generic
def kinematics(parameters, angle, q, u):
    """Return u (2,)."""
    return u


@generic
def speeds(parameters, angle, u):
    """Return the `Speeds`: q̇ = (s t, ω)."""
    cos, sin = angle.cos[0], angle.sin[0]
    W, rest = np.zeros((3, 2), u.dtype), np.zeros(3, u.dtype)
    W[0, 0], W[1, 0] = cos, sin
    W[2, 1] = 1
    rest[0] = -u[0] * u[1] * sin
    rest[1] = u[0] * u[1] * cos
    return Speeds(W, rest, None)


@generic
def qdot(parameters, angle, u):
    """Return W u (3,)."""
    v = np.zeros(3, u.dtype)
    v[0], v[1], v[2] = u[0] * angle.cos[0], u[0] * angle.sin[0], u[1]
    return v


@generic
def bodies(parameters, angle, u):
    """Return the `Bodies`, d = 2, along t and n, which turn: V = (s, ℓ ω), ω × V at u̇ = 0."""
    offset = parameters.offset[0]
    partial, turning = np.zeros((1, 2, 2), u.dtype), np.zeros((1, 1, 2), u.dtype)
    remainder = np.zeros((1, 2), u.dtype)
    partial[0, 0, 0], partial[0, 1, 1] = 1, offset
    turning[0, 0, 1] = 1
    remainder[0, 0] = -offset * u[1] * u[1]
    remainder[0, 1] = u[0] * u[1]
    inertia = parameters.inertia.reshape(1, 1, 1)
    still = np.zeros((1, 1), u.dtype)
    return Bodies(partial, turning, remainder, still, parameters.mass, inertia, None, None)


@generic
def speeds_of(parameters, angle, q, v):
    """Return u = (s, ω) of a velocity v."""
    u = np.zeros(2, v.dtype)
    u[0], u[1] = v[0] * angle.cos[0] + v[1] * angle.sin[0], v[2]
    return u


# ---- The second derivation: positions and velocities only ----------------------------------------


@generic
def velocities(parameters, angle, q, v):
    """Return the velocity of the centre of mass (1, 2) and of rotation (1, 1)."""
    V, omega = np.zeros((1, 2), v.dtype), np.zeros((1, 1), v.dtype)
    V[0, 0] = v[0] - parameters.offset[0] * v[2] * angle.sin[0]
    V[0, 1] = v[1] + parameters.offset[0] * v[2] * angle.cos[0]
    omega[0, 0] = v[2]
    return V, omega


@generic
def energies(parameters, angle, q, v):
    """Return (T, None), J."""
    V, omega = velocities(parameters, angle, q, v)
    T = parameters.mass[0] * (V[0, 0] * V[0, 0] + V[0, 1] * V[0, 1]) / 2
    T += parameters.inertia[0] * omega[0, 0] * omega[0, 0] / 2
    return T, None


@generic
def constraint(parameters, angle, q, v):
    """Return c (1,), m/s: the velocity of the edge across itself, to the right."""
    c = np.zeros(1, v.dtype)
    c[0] = v[0] * angle.sin[0] - v[1] * angle.cos[0]
    return c


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Sleigh(Parametric, functions=globals()):
    """Chaplygin's sleigh, turning on the spot at t = 0.

    Args:
        mass: m, kg, positive.
        inertia: about the centre of mass, kg m², not negative.
        offset: ℓ, how far the centre of mass is ahead of the edge, m.
        rate: θ̇ at t = 0, rad/s.

    Raises:
        InputError: not finite, or out of the range given above.
    """

    mass: Any = parameter(1.0, "positive", drawn=Range(0.1, 10.0))
    inertia: Any = parameter(0.25, "not negative", drawn=Range(0.01, 10.0))
    offset: Any = parameter(0.5, drawn=Range(-5.0, 5.0))
    rate: Any = parameter(1.0)

    key = "sleigh"
    named_coordinates = "x", "y", "θ"
    named_constraints = ("edge",)
    conserves_energy = True
    angle_coordinates = slice(2, None)

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        return self.in_numbers(arithmetic, Parameters)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the edge at the origin along x, turning."""
        return np.zeros(3), np.array([0.0, 0.0, float(self.rate)])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, a translation and the mirror image in the x axis."""
        yield plane.rotation(self, q, v, slice(2, 3))
        yield plane.translation(self, q, v)
        yield plane.mirror(self, q, v, kept=(0,))

    def tree(self) -> Tree:
        """Return PX, PY and RZ."""
        center = np.zeros((3, 3))
        center[2, 0] = self.offset
        return Tree(
            parent=(-1, 0, 1),
            joint=("px", "py", "rz"),
            offset=np.zeros((3, 3)),
            mass=np.array([0.0, 0.0, float(self.mass)]),
            center=center,
            inertia=np.array([0.0, 0.0, float(self.inertia)]),
            coordinates=np.eye(3),
        )
