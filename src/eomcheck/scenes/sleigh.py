"""Chaplygin's sleigh: a body in the plane on one knife edge, its centre of mass off the edge.

q = [x, y, θ], (x, y) the point of contact of the edge, θ its direction. Below t = (cos θ, sin θ)
and n = (-sin θ, cos θ); the centre of mass is at (x, y) + ℓ t. The edge moves along t only. The
generalized speeds are u = (s, ω): the speed of the edge along t, and θ̇. Source: Chaplygin 1911;
Neimark and Fufaev 1972, Ch. III.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import (
    Bodies,
    Speeds,
    Symmetry,
    Terms,
    Tree,
    planar_tree,
    plane_mirror,
    plane_rotation,
    plane_translation,
)
from eomcheck.numbers.generic import Array

# ---- Lagrange's terms ----------------------------------------------------------------------------


def constraints(parameters, angle, q):
    """Return (a (1, 3), None): the velocity of the edge along -n vanishes."""
    return np.array([[angle.sin[0], -angle.cos[0], 0]], q.dtype), None


def terms(parameters, angle, q, v):
    """Return the `Terms` of the sleigh: neither forces nor b."""
    mass, offset, inertia = parameters.mass[0], parameters.offset[0], parameters.inertia[0]
    cos, sin, omega = angle.cos[0], angle.sin[0], v[2]
    moment = mass * offset
    across, ahead = -moment * sin, moment * cos
    M = [[mass, 0, across], [0, mass, ahead], [across, ahead, inertia + moment * offset]]
    B = [-moment * cos * omega * omega, -moment * sin * omega * omega, 0]
    gamma = [omega * (v[0] * cos + v[1] * sin)]
    a, b = constraints(parameters, angle, q)
    kind = q.dtype
    return Terms(np.array(M, kind), None, np.array(B, kind), a, np.array(gamma, kind), b)


# ---- Natural generalized speeds ------------------------------------------------------------------


def kinematics(parameters, angle, q, u):
    """Return the generalized speeds u (2,)."""
    return u


def speeds(parameters, angle, u):
    """Return the `Speeds`: q̇ = (s t, ω)."""
    cos, sin = angle.cos[0], angle.sin[0]
    W = np.array([[cos, 0], [sin, 0], [0, 1]], u.dtype)
    return Speeds(W, np.array([-u[0] * u[1] * sin, u[0] * u[1] * cos, 0], u.dtype), None)


def qdot(parameters, angle, u):
    """Return the velocity W u (3,)."""
    return np.array([u[0] * angle.cos[0], u[0] * angle.sin[0], u[1]], u.dtype)


def bodies(parameters, angle, u):
    """Return the `Bodies`, d = 2, along t and n, which turn: V = (s, ℓ ω), ω × V at u̇ = 0."""
    offset = parameters.offset[0]
    partial = np.array([[[1, 0], [0, offset]]], u.dtype)
    turning = np.array([[[0, 1]]], u.dtype)
    remainder = np.array([[-offset * u[1] * u[1], u[0] * u[1]]], u.dtype)
    inertia = parameters.inertia.reshape(1, 1, 1)
    still = np.zeros((1, 1), u.dtype)
    return Bodies(partial, turning, remainder, still, parameters.mass, inertia, None, None)


def speeds_of(parameters, angle, q, v):
    """Return the generalized speeds u = (s, ω) of a velocity v."""
    return np.array([v[0] * angle.cos[0] + v[1] * angle.sin[0], v[2]], v.dtype)


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, angle, q, v):
    """Return the velocity of the centre of mass (1, 2) and of rotation (1, 1)."""
    swing = parameters.offset[0] * v[2]
    V = [[v[0] - swing * angle.sin[0], v[1] + swing * angle.cos[0]]]
    return np.array(V, v.dtype), v[2:].reshape(1, 1)


def positions(parameters, angle, q):
    """Return the position of the centre of mass (1, 2)."""
    offset = parameters.offset[0]
    return np.array([[q[0] + offset * angle.cos[0], q[1] + offset * angle.sin[0]]], q.dtype)


def constraint(parameters, angle, q, v):
    """Return c (1,), m/s: the velocity of the edge across itself, to the right."""
    return np.array([v[0] * angle.sin[0] - v[1] * angle.cos[0]], v.dtype)


# ---- The scene -----------------------------------------------------------------------------------


class Sleigh(Parametric, functions=globals()):
    """Chaplygin's sleigh, turning on the spot at t = 0."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), default=1.0)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), default=0.25)
    offset: Any = parameter(
        "ℓ, from edge to centre of mass", "m", sample_range=(-5.0, 5.0), default=0.5
    )
    rate: Any = parameter("θ̇ at t = 0", "rad/s", default=1.0, read=False)

    key = "sleigh"
    display_pose = 0.55, 0.4, 0.5
    named_coordinates = "x", "y", "θ"
    named_constraints = ("edge",)
    conserves_energy = True
    angle_coordinates = slice(2, None)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of the edge at the origin along x, turning."""
        return np.zeros(3), np.array([0.0, 0.0, float(self.rate)])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, a translation and the mirror image in the x axis."""
        yield plane_rotation(self, q, v, slice(2, 3))
        yield plane_translation(self, q, v)
        yield plane_mirror(self, q, v, unflipped=(0,))

    def tree(self, parameters: Any = None) -> Tree:
        """Return the joints PX, PY and RZ with the body."""
        # Not by `parameters`: engines that read the tree check these.
        own = self if parameters is None else parameters
        kind = own.mass.dtype
        center, mass, inertia = np.zeros((3, 3), kind), np.zeros(3, kind), np.zeros(3, kind)
        center[2, :1], mass[2:] = own.offset, own.mass
        inertia[2:] = own.inertia
        joints, none = ("px", "py", "rz"), np.zeros((3, 3))
        return planar_tree((-1, 0, 1), joints, none, mass, center, inertia, np.eye(3), ("sleigh",))

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the body about its centre of mass, and the edge."""
        edge, along, across = q[:2], draw.direction(q[2]), draw.direction(q[2] + np.pi / 2)
        center, size = edge + self.offset * along, abs(float(self.offset))
        hull = ((-1.5, -0.45), (0.9, -0.45), (1.4, 0.0), (0.9, 0.45), (-1.5, 0.45))
        parts = (
            *(*draw.fixed_axes(0.5 * size), *draw.position_dimensions(*edge), draw.Trail(edge)),
            draw.Body([center + size * (x * along + y * across) for x, y in hull], "sleigh", True),
            draw.Wheel(edge, along, 0.45 * size, edge=True),
            draw.Center(center, "centre of mass"),
            *(
                draw.ConstraintMark("edge", edge, (0,)),
                draw.plane_angle("θ", edge, q[2], 0.8 * size),
            ),
            draw.Distance("ℓ", edge - 0.2 * size * across, center - 0.2 * size * across),
            draw.Arrow("t", edge + 1.45 * size * along, 0.6 * size * along),
            draw.Arrow("n", edge, 0.8 * size * across),
        )
        return draw.Sketch(parts, **draw.FLAT)
