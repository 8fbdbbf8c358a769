"""A disk that leans and rolls on the plane without slipping: three dimensions.

q = [x, y, ψ, θ, φ]: where the centre is above the plane, the heading ψ about the vertical, the lean
θ about the heading (0 upright), the spin φ about the disk's axis. The height of the centre is
R cos θ. Below, e_1 is the heading, horizontal, e_2 the axis and e_3 points from the contact to the
centre; these axes turn with ψ and θ, not with φ. The generalized speeds are the components of the
angular velocity along them:

    u = (θ̇, φ̇ + ψ̇ sin θ, ψ̇ cos θ).

They do not exist where the disk lies flat, cos θ = 0, where Euler's angles are singular.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics import plane
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Bodies, Range, Speeds, Symmetry, Terms
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic


class Parameters(NamedTuple):
    """The parameters of a `RollingDisk` in some kind of number."""

    mass: Any
    """m (1,), kg."""
    inertia: Any
    """About the centre, along e_1, e_2, e_3 as along axes of the body (1, 3, 3), kg m²."""
    radius: Any
    """R (1,), m."""
    gravity: Any
    """g (1,), m/s²."""


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Angles` of heading, lean and spin (3,)."""
    return arithmetic.angles(q[2:])


# ---- Lagrange's terms ----------------------------------------------------------------------------


@generic
def constraints(parameters, angles, q):
    """Return (a (2, 5), None): what touches the ground moves neither along nor across."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    a = np.zeros((2, 5), q.dtype)
    a[0, 0], a[0, 1], a[0, 2], a[0, 4] = cos[0], sin[0], -R * sin[1], -R
    a[1, 0], a[1, 1], a[1, 3] = -sin[0], cos[0], R * cos[1]
    return a, None


@generic
def terms(parameters, angles, q, v):
    """Return the `Terms` of the disk."""
    mass, R = parameters.mass[0], parameters.radius[0]
    across, axial = parameters.inertia[0, 0, 0], parameters.inertia[0, 1, 1]
    cos, sin = angles.cos[1], angles.sin[1]
    turn, lean = v[2], v[3]
    roll = v[4] + turn * sin
    M = np.zeros((5, 5), q.dtype)
    M[0, 0] = M[1, 1] = mass
    M[2, 2] = across * cos * cos + axial * sin * sin
    M[2, 4] = M[4, 2] = axial * sin
    M[3, 3] = across + mass * R * R * sin * sin
    M[4, 4] = axial
    Q = np.zeros(5, q.dtype)
    Q[3] = mass * parameters.gravity[0] * R * sin
    B = np.zeros(5, q.dtype)
    B[2] = (axial * (roll + turn * sin) - 2 * across * turn * sin) * cos * lean
    B[3] = (
        mass * R * R * sin * cos * lean * lean + (across * turn * sin - axial * roll) * turn * cos
    )
    B[4] = axial * turn * cos * lean
    a, _ = constraints(parameters, angles, q)
    gamma = np.zeros(2, q.dtype)
    gamma[0] = turn * (v[1] * angles.cos[0] - v[0] * angles.sin[0]) - R * turn * cos * lean
    gamma[1] = -turn * (v[0] * angles.cos[0] + v[1] * angles.sin[0]) - R * sin * lean * lean
    return Terms(M, Q, B, a, gamma, None)


# ---- Natural generalized speeds ------------------------------------------------------------------


class Rolling(NamedTuple):
    """Generalized speeds u (3,), and q̇ (5,)."""

    u: Any
    v: Any


@generic
def kinematics(parameters, angles, q, u):
    """Return the `Rolling`: V = R (u_2 e_1 - u_1 e_2), and the rates of Euler's angles."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    along, left = R * u[1], -R * u[0] * cos[1]
    v = np.zeros(5, u.dtype)
    v[0] = along * cos[0] - left * sin[0]
    v[1] = along * sin[0] + left * cos[0]
    v[2] = u[2] / cos[1]
    v[3] = u[0]
    v[4] = u[1] - v[2] * sin[1]
    return Rolling(u, v)


@generic
def speeds(parameters, angles, rolling):
    """Return the `Speeds`."""
    R, cos, sin, v = parameters.radius[0], angles.cos, angles.sin, rolling.v
    turn, lean = v[2], v[3]
    W, rest = np.zeros((5, 3), v.dtype), np.zeros(5, v.dtype)
    W[0, 0], W[0, 1] = R * cos[1] * sin[0], R * cos[0]
    W[1, 0], W[1, 1] = -R * cos[1] * cos[0], R * sin[0]
    W[2, 2] = 1 / cos[1]
    W[3, 0] = W[4, 1] = 1
    W[4, 2] = -sin[1] / cos[1]
    rest[0] = -turn * v[1] - R * lean * lean * sin[1] * sin[0]
    rest[1] = turn * v[0] + R * lean * lean * sin[1] * cos[0]
    rest[2] = turn * lean * sin[1] / cos[1]
    rest[4] = -turn * lean / cos[1]
    return Speeds(W, rest, None)


@generic
def qdot(parameters, angles, rolling):
    """Return W u (5,)."""
    return rolling.v


@generic
def bodies(parameters, angles, rolling):
    """Return the `Bodies`, d = 2 along e_1, e_2 and e = 3 along e_1, e_2, e_3, which turn.

    V has no part along e_3. These axes turn with ω - φ̇ e_2, so at u̇ = 0 the acceleration is
    (ω - φ̇ e_2) × V and the angular acceleration -φ̇ e_2 × ω.
    """
    R, u, spin = parameters.radius[0], rolling.u, rolling.v[4]
    across, axial = parameters.inertia[0, 0, 0], parameters.inertia[0, 1, 1]
    partial, turning = np.zeros((1, 2, 3), u.dtype), np.zeros((1, 3, 3), u.dtype)
    partial[0, 0, 1], partial[0, 1, 0] = R, -R
    turning[0, 0, 0] = turning[0, 1, 1] = turning[0, 2, 2] = 1
    remainder, angular_remainder = np.zeros((1, 2), u.dtype), np.zeros((1, 3), u.dtype)
    remainder[0, 0], remainder[0, 1] = R * u[0] * u[2], R * u[1] * u[2]
    angular_remainder[0, 0], angular_remainder[0, 2] = -spin * u[2], spin * u[0]
    gyroscopic = np.zeros((1, 3), u.dtype)
    gyroscopic[0, 0] = (across - axial) * u[1] * u[2]
    gyroscopic[0, 2] = (axial - across) * u[0] * u[1]
    force = np.zeros(3, u.dtype)
    force[0] = parameters.mass[0] * parameters.gravity[0] * R * angles.sin[1]
    return Bodies(
        partial,
        turning,
        remainder,
        angular_remainder,
        parameters.mass,
        parameters.inertia,
        gyroscopic,
        force,
    )


@generic
def speeds_of(parameters, angles, q, v):
    """Return u (3,) of a velocity v."""
    u = np.zeros(3, v.dtype)
    u[0], u[1], u[2] = v[3], v[4] + v[2] * angles.sin[1], v[2] * angles.cos[1]
    return u


# ---- The second derivation: positions and velocities only ----------------------------------------


@generic
def velocities(parameters, angles, q, v):
    """Return the velocity of the centre (1, 3) and of rotation (1, 3), along axes of the body."""
    V, omega = np.zeros((1, 3), v.dtype), np.zeros((1, 3), v.dtype)
    V[0, 0], V[0, 1], V[0, 2] = v[0], v[1], -parameters.radius[0] * angles.sin[1] * v[3]
    ahead, up = v[3], v[2] * angles.cos[1]
    omega[0, 0] = angles.cos[2] * ahead - angles.sin[2] * up
    omega[0, 1] = v[4] + v[2] * angles.sin[1]
    omega[0, 2] = angles.cos[2] * up + angles.sin[2] * ahead
    return V, omega


@generic
def energies(parameters, angles, q, v):
    """Return (T, U), J."""
    V, omega = velocities(parameters, angles, q, v)
    T = 0
    for i in range(3):
        T += parameters.mass[0] * V[0, i] * V[0, i] / 2
        T += parameters.inertia[0, i, i] * omega[0, i] * omega[0, i] / 2
    height = parameters.radius[0] * angles.cos[1]
    return T, parameters.mass[0] * parameters.gravity[0] * height


@generic
def constraint(parameters, angles, q, v):
    """Return c (2,), m/s: V + ω × (-R e_3) along the heading and across it, to the left."""
    R, cos, sin = parameters.radius[0], angles.cos, angles.sin
    c = np.zeros(2, v.dtype)
    c[0] = v[0] * cos[0] + v[1] * sin[0] - R * (v[4] + v[2] * sin[1])
    c[1] = v[1] * cos[0] - v[0] * sin[0] + R * v[3] * cos[1]
    return c


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class RollingDisk(Parametric, functions=globals()):
    """A disk that leans and rolls on the plane without slipping, in three dimensions.

    Args:
        mass: m, kg, positive.
        radius: R, m, positive.
        axial: moment of inertia about the axis, kg m², positive; by default m R²/2, a thin disk.
        across: about a diameter, kg m², positive; by default m R²/4.
        gravity: g, m/s², not negative.
        lean: θ at t = 0, rad, where the disk rolls in a circle or, upright, straight ahead.
        roll: u_2 at t = 0, rad/s: angular velocity along the axis.

    Raises:
        InputError: not finite, or out of the range given above.
    """

    mass: Any = parameter(1.0, "positive", drawn=Range(0.1, 10.0))
    radius: Any = parameter(0.5, "positive", drawn=Range(0.1, 10.0))
    axial: Any = parameter(
        None,
        "positive",
        drawn=Range(0.01, 10.0),
        otherwise=lambda disk: disk.mass * disk.radius**2 / 2.0,
    )
    across: Any = parameter(
        None,
        "positive",
        drawn=Range(0.01, 10.0),
        otherwise=lambda disk: disk.mass * disk.radius**2 / 4.0,
    )
    gravity: Any = parameter(9.81, "not negative", drawn=Range(0.0, 20.0))
    lean: Any = parameter(0.3)
    roll: Any = parameter(-8.0)

    key = "rolling-disk"
    named_coordinates = "x", "y", "ψ", "θ", "φ"
    named_constraints = "along", "across"
    conserves_energy = True
    angle_coordinates = slice(2, None)

    def __post_init__(self):
        self.check_fields()
        if abs(self.lean) >= np.pi / 2:
            raise InputError(f"lean = {self.lean}, expected less than π/2 to either side")

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return up to 10 m, any heading and spin, and a lean of up to 1.2 rad."""
        anywhere, any_angle = Range(-10.0, 10.0), Range(-np.pi, np.pi)
        return anywhere, anywhere, any_angle, Range(-1.2, 1.2), any_angle

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        moments = arithmetic.numbers(np.array([self.across, self.axial]))
        inertia = np.zeros((1, 3, 3), moments.dtype)
        inertia[0, 0, 0] = inertia[0, 2, 2] = moments[0]
        inertia[0, 1, 1] = moments[1]
        return self.in_numbers(arithmetic, Parameters, inertia=inertia)

    def steady_turn(self) -> float:
        """Return ψ̇, rad/s, with which the disk keeps its lean and its roll, the slower of two.

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
        """Return the disk above the origin, heading along x, on its circle."""
        q = np.array([0.0, 0.0, 0.0, float(self.lean), 0.0])
        turn = self.steady_turn()
        v = np.zeros(5)
        v[0] = self.radius * self.roll
        v[2] = turn
        v[4] = self.roll - turn * np.sin(self.lean)
        return q, v

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |cos θ| <= 4 eps: Euler's angles are singular where the disk lies flat."""
        plane.refuse_flat(q[3])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the vertical, a translation and the mirror image in the x axis."""
        yield plane.rotation(self, q, v, slice(2, 3))
        yield plane.translation(self, q, v)
        yield plane.mirror(self, q, v, kept=(0, 4))
