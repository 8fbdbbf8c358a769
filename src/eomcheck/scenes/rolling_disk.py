"""A disk that leans and rolls on the plane without slipping, in space.

q = [x, y, ψ, θ, φ]: the horizontal position of the centre, the heading ψ about the vertical, the
lean θ about the heading (0 upright), the spin φ about the disk's axis. The height of the centre is
R cos θ. Below, e_1 is the heading, horizontal, e_2 the axis and e_3 points from the contact to the
centre; these axes turn with ψ and θ, not with φ. The generalized speeds are the components of the
angular velocity along them:

    u = (θ̇, φ̇ + ψ̇ sin θ, ψ̇ cos θ).

They do not exist where the disk lies flat, cos θ = 0, where Euler's angles are singular.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import Parametric, diagonal, parameter
from eomcheck.mechanics.records import (
    ANY_ANGLE,
    ANYWHERE,
    Bodies,
    Range,
    Speeds,
    Symmetry,
    Terms,
    plane_mirror,
    plane_rotation,
    plane_translation,
    refuse_flat,
)
from eomcheck.numbers.generic import Arithmetic, Array

# ---- Lagrange's terms ----------------------------------------------------------------------------


def constraints(parameters, angles, q):
    """Return (a (2, 5), None): the point of contact moves neither along the heading nor across."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    a = [[cos[0], sin[0], -R * sin[1], 0, -R], [-sin[0], cos[0], 0, R * cos[1], 0]]
    return np.array(a, q.dtype), None


def terms(parameters, angles, q, v):
    """Return the `Terms` of the disk."""
    mass, R = parameters.mass[0], parameters.radius[0]
    across, axial = parameters.inertia[0, 0, 0], parameters.inertia[0, 1, 1]
    cos, sin = angles.cos[1], angles.sin[1]
    turn, lean = v[2], v[3]
    roll = v[4] + turn * sin
    M, Q, B = np.zeros((5, 5), q.dtype), np.zeros(5, q.dtype), np.zeros(5, q.dtype)
    M[0, 0] = M[1, 1] = mass
    M[2, 2] = across * cos * cos + axial * sin * sin
    M[2, 4] = M[4, 2] = axial * sin
    M[3, 3] = across + mass * R * R * sin * sin
    M[4, 4] = axial
    Q[3] = mass * parameters.gravity[0] * R * sin
    B[2] = (axial * (roll + turn * sin) - 2 * across * turn * sin) * cos * lean
    B[3] = (
        mass * R * R * sin * cos * lean * lean + (across * turn * sin - axial * roll) * turn * cos
    )
    B[4] = axial * turn * cos * lean
    a, b = constraints(parameters, angles, q)
    ahead = v[0] * angles.cos[0] + v[1] * angles.sin[0]
    left = v[1] * angles.cos[0] - v[0] * angles.sin[0]
    gamma = [turn * left - R * turn * cos * lean, -turn * ahead - R * sin * lean * lean]
    return Terms(M, Q, B, a, np.array(gamma, q.dtype), b)


# ---- Natural generalized speeds ------------------------------------------------------------------


class DiskKinematics(NamedTuple):
    """Kinematics of the disk: generalized speeds u (3,), and q̇ (5,)."""

    u: Any
    v: Any


def kinematics(parameters, angles, q, u):
    """Return the `DiskKinematics`: V = R (u_2 e_1 - u_1 e_2), and the rates of Euler's angles."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    along, left = R * u[1], -R * u[0] * cos[1]
    turn = u[2] / cos[1]
    east, north = along * cos[0] - left * sin[0], along * sin[0] + left * cos[0]
    return DiskKinematics(u, np.array([east, north, turn, u[0], u[1] - turn * sin[1]], u.dtype))


def speeds(parameters, angles, rolling):
    """Return the `Speeds` of the disk."""
    R, cos, sin, v = parameters.radius[0], angles.cos, angles.sin, rolling.v
    turn, lean = v[2], v[3]
    W = [
        [R * cos[1] * sin[0], R * cos[0], 0],
        [-R * cos[1] * cos[0], R * sin[0], 0],
        [0, 0, 1 / cos[1]],
        [1, 0, 0],
        [0, 1, -sin[1] / cos[1]],
    ]
    rest = np.zeros(5, v.dtype)
    rest[0] = -turn * v[1] - R * lean * lean * sin[1] * sin[0]
    rest[1] = turn * v[0] + R * lean * lean * sin[1] * cos[0]
    rest[2] = turn * lean * sin[1] / cos[1]
    rest[4] = -turn * lean / cos[1]
    return Speeds(np.array(W, v.dtype), rest, None)


def qdot(parameters, angles, rolling):
    """Return the velocity W u (5,)."""
    return rolling.v


def bodies(parameters, angles, rolling):
    """Return the `Bodies`, d = 2 along e_1, e_2 and e = 3 along e_1, e_2, e_3, which turn.

    V has no part along e_3. These axes turn with ω - φ̇ e_2, so at u̇ = 0 the acceleration is
    (ω - φ̇ e_2) × V and the angular acceleration -φ̇ e_2 × ω.
    """
    R, mass, u, spin = parameters.radius[0], parameters.mass, rolling.u, rolling.v[4]
    across, axial = parameters.inertia[0, 0, 0], parameters.inertia[0, 1, 1]
    partial = np.array([[[0, R, 0], [-R, 0, 0]]], u.dtype)
    turning = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], u.dtype)
    remainder = np.array([[R * u[0] * u[2], R * u[1] * u[2]]], u.dtype)
    turned = np.array([[-spin * u[2], 0, spin * u[0]]], u.dtype)
    gyroscopic = [[(across - axial) * u[1] * u[2], 0, (axial - across) * u[0] * u[1]]]
    force = np.array([mass[0] * parameters.gravity[0] * R * angles.sin[1], 0, 0], u.dtype)
    moments = np.array(gyroscopic, u.dtype)
    return Bodies(partial, turning, remainder, turned, mass, parameters.inertia, moments, force)


def speeds_of(parameters, angles, q, v):
    """Return the generalized speeds u (3,) of a velocity v."""
    return np.array([v[3], v[4] + v[2] * angles.sin[1], v[2] * angles.cos[1]], v.dtype)


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, angles, q, v):
    """Return the velocity of the centre (1, 3) and of rotation (1, 3), along axes of the body."""
    cos, sin = angles.cos, angles.sin
    ahead, up = v[3], v[2] * cos[1]
    V = [[v[0], v[1], -parameters.radius[0] * sin[1] * v[3]]]
    omega = [[cos[2] * ahead - sin[2] * up, v[4] + v[2] * sin[1], cos[2] * up + sin[2] * ahead]]
    return np.array(V, v.dtype), np.array(omega, v.dtype)


def positions(parameters, angles, q):
    """Return the position of the centre (1, 3)."""
    return np.array([[q[0], q[1], parameters.radius[0] * angles.cos[1]]], q.dtype)


def potential(parameters, angles, q):
    """Return the potential energy U, J."""
    return parameters.mass[0] * parameters.gravity[0] * parameters.radius[0] * angles.cos[1]


def constraint(parameters, angles, q, v):
    """Return c (2,), m/s: V + ω × (-R e_3) along the heading and across it, to the left."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    ahead = v[0] * cos[0] + v[1] * sin[0] - R * (v[4] + v[2] * sin[1])
    left = v[1] * cos[0] - v[0] * sin[0] + R * v[3] * cos[1]
    return np.array([ahead, left], v.dtype)


# ---- The scene -----------------------------------------------------------------------------------


class RollingDisk(Parametric, functions=globals()):
    """A disk that leans and rolls on the plane without slipping, in three dimensions.

    At t = 0 it rolls in a circle or, upright, straight ahead. By default it is thin.
    """

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), default=1.0)
    radius: Any = parameter("R", "m", "> 0", (0.1, 10.0), default=0.5)
    axial: Any = parameter(
        "I about the axis, m R²/2 if not given",
        *("kg m²", "> 0", (0.01, 10.0)),
        default=lambda disk: disk.mass * disk.radius**2 / 2.0,
        read=False,
    )
    across: Any = parameter(
        "I about a diameter, m R²/4 if not given",
        *("kg m²", "> 0", (0.01, 10.0)),
        default=lambda disk: disk.mass * disk.radius**2 / 4.0,
        read=False,
    )
    gravity: Any = parameter("g", "m/s²", ">= 0", (0.0, 20.0), default=9.81)
    lean: Any = parameter("θ at t = 0", "rad", default=0.3, read=False)
    roll: Any = parameter("u_2 at t = 0, along the axis", "rad/s", default=-8.0, read=False)

    key = "rolling-disk"
    named_coordinates = "x", "y", "ψ", "θ", "φ"
    display_pose = 1.05, 1.05, 0.7, 0.45, 0.8
    coordinate_sample_ranges = ANYWHERE, ANYWHERE, ANY_ANGLE, Range(-1.2, 1.2), ANY_ANGLE
    named_constraints = "along", "across"
    conserves_energy = True
    angle_coordinates = slice(2, None)

    def __post_init__(self):
        self.check_fields()
        if abs(self.lean) >= np.pi / 2:
            raise InputError(f"lean = {self.lean}, expected less than π/2 to either side")

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the inertia along e_1, e_2, e_3 as along axes of the body (1, 3, 3), kg m²."""
        moments = arithmetic.numbers(np.array([self.across, self.axial]))
        return {"inertia": diagonal(moments[[[0, 1, 0]]])}

    def steady_turn(self) -> float:
        """Return ψ̇, rad/s, of a steady turn with the disk's lean and roll, the slower of two.

        Balance about the heading: across ψ̇² sin θ cos θ - (axial + m R²) u_2 ψ̇ cos θ =
        m g R sin θ.
        """
        cos, sin = np.cos(self.lean), np.sin(self.lean)
        square = self.across * sin * cos
        linear = -(self.axial + self.mass * self.radius**2) * self.roll * cos
        weight = self.mass * self.gravity * self.radius * sin
        if weight == 0.0:
            return 0.0
        root = np.sqrt(linear**2 + 4.0 * square * weight)
        return float(2.0 * weight / (linear + np.copysign(root, linear)))

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of the disk above the origin, heading along x, on its circle."""
        turn = self.steady_turn()
        spin = self.roll - turn * np.sin(self.lean)
        q = np.array([0.0, 0.0, 0.0, float(self.lean), 0.0])
        return q, np.array([self.radius * self.roll, 0.0, turn, 0.0, spin])

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |cos θ| <= 4 eps: Euler's angles are singular where the disk lies flat."""
        refuse_flat(q[3])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the vertical, a translation and the mirror image in the x axis."""
        yield plane_rotation(self, q, v, slice(2, 3))
        yield plane_translation(self, q, v)
        yield plane_mirror(self, q, v, unflipped=(0, 4))

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the disk on the plane, its angles, and the axes e_1, e_2, e_3."""
        x, y, heading, lean, spin = q
        east, north, up = np.eye(3)
        R = float(self.radius)
        e1 = np.cos(heading) * east + np.sin(heading) * north
        e3 = np.cos(lean) * up + np.sin(lean) * np.cross(e1, up)
        e2 = np.cross(e3, e1)
        foot = np.array([x, y, 0.0])
        center = foot + R * np.cos(lean) * up
        contact = center - R * e3
        rim = np.cos(spin) * e3 + np.sin(spin) * e1
        corners = [(-0.6, -0.6), (3.6, -0.6), (3.6, 3.6), (-0.6, 3.6)]
        parts = (
            draw.Plane([R * np.array([a, b, 0.0]) for a, b in corners]),
            *(
                *draw.fixed_axes(0.8 * R, 3),
                draw.Disk(center, e2, R, "disk"),
                draw.JointMark(center),
            ),
            *(draw.Distance("x", y * north, foot), draw.Distance("y", x * east, foot)),
            draw.Angle("ψ", contact, east, north, heading, 1.1 * R),
            draw.Arrow("", contact, 1.3 * R * e1),
            draw.Angle("θ", contact, up, np.cross(e1, up), lean, 1.75 * R),
            draw.Arrow("", contact, 1.85 * R * up),
            draw.Angle("φ", center, e3, e1, spin, 0.55 * R),
            draw.Body((center, center + R * rim)),
            *(draw.Arrow("e_1", center, 1.3 * R * e1), draw.Arrow("e_2", center, 0.9 * R * e2)),
            *(draw.Arrow("e_3", center, 1.35 * R * e3), draw.Trail(contact)),
            draw.ConstraintMark("no slip", contact, (0, 1)),
        )
        return draw.Sketch(parts, azimuth=-1.85, elevation=0.4)
