"""A homogeneous ball that rolls on a turntable: constraints that depend on time.

q = [x, y, ψ, θ, φ]: the centre relative to the axis of the table, along directions that do not
turn, and Euler's angles: ψ about the vertical, θ about the line ψ points to, φ about the resulting
direction of the ball's second axis. The table spins at Ω(t) = Ω_0 + Ω_1 sin(κ t), and at the point
of contact both have the same velocity: b ≠ 0, and ḃ has Ω̇ in it. The generalized speeds are the
components of the angular velocity along x, y and the vertical. They do not exist where cos θ = 0.

Source: Neimark and Fufaev 1972, Ch. III; Weltner 1979 for the circles at 2Ω/7.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
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
    refuse_flat,
)
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Arithmetic, Array


class PreparedTable(NamedTuple):
    """Precomputed expressions that are not rational in q and t."""

    angles: Any
    """Euler's angles ψ, θ, φ, as `Angles` (3,)."""
    rate: Any
    """Spin rate Ω (1,), rad/s."""
    acceleration: Any
    """Spin acceleration Ω̇ (1,), rad/s², or None."""


def table_spin(arithmetic, rate, swing, frequency, t, dtype):
    """Return (Ω, Ω̇ or None), each (1,)."""
    if swing is None:
        return rate, None
    phase = np.zeros(1, dtype)
    phase[0] = frequency[0] * t
    clock = arithmetic.angles(phase)
    return rate + swing * clock.sin, swing * frequency * clock.cos


def prepare(arithmetic, parameters, q, t):
    """Return the `PreparedTable` at q (5,) and the time t."""
    rate, swing, frequency = parameters.rate, parameters.swing, parameters.frequency
    rate, acceleration = table_spin(arithmetic, rate, swing, frequency, t, q.dtype)
    return PreparedTable(arithmetic.angles(q[2:]), rate, acceleration)


# ---- Lagrange's terms ----------------------------------------------------------------------------


def table_velocity(rate, q):
    """Return Ω e_z × r (2,), the velocity of the table under the ball."""
    return np.array([-rate[0] * q[1], rate[0] * q[0]], q.dtype)


def table_acceleration(rate, acceleration, q, v):
    """Return the rate of `table_velocity` (2,) along the ball's motion; Ω̇ may be None."""
    change = table_velocity(rate, v)
    if acceleration is not None:
        change[0] -= acceleration[0] * q[1]
        change[1] += acceleration[0] * q[0]
    return change


def constraints(parameters, prepared, q):
    """Return (a (2, 5), b (2,)) of V - R ω × e_z - Ω e_z × r = 0."""
    R, cos, sin = parameters.radius[0], prepared.angles.cos, prepared.angles.sin
    a = [[1, 0, 0, -R * sin[0], -R * cos[1] * cos[0]], [0, 1, 0, R * cos[0], -R * cos[1] * sin[0]]]
    return np.array(a, q.dtype), -table_velocity(prepared.rate, q)


def terms(parameters, prepared, q, v):
    """Return the `Terms` of the ball: no forces."""
    mass, inertia, R = parameters.mass[0], parameters.inertia[0, 0, 0], parameters.radius[0]
    cos, sin = prepared.angles.cos, prepared.angles.sin
    turn, lean, spin = v[2], v[3], v[4]
    M, B = np.zeros((5, 5), q.dtype), np.zeros(5, q.dtype)
    M[0, 0] = M[1, 1] = mass
    M[2, 2] = M[3, 3] = M[4, 4] = inertia
    M[2, 4] = M[4, 2] = inertia * sin[1]
    B[2] = inertia * cos[1] * spin * lean
    B[3] = -inertia * cos[1] * turn * spin
    B[4] = inertia * cos[1] * turn * lean
    a, b = constraints(parameters, prepared, q)
    # The rate of ω at constant rates of the angles, along the heading and to the left of it.
    ahead, left = -cos[1] * turn * spin, lean * (turn - sin[1] * spin)
    gamma = -table_acceleration(prepared.rate, prepared.acceleration, q, v)
    gamma[0] -= R * (ahead * sin[0] + left * cos[0])
    gamma[1] += R * (ahead * cos[0] - left * sin[0])
    return Terms(M, None, B, a, gamma, b)


# ---- Natural generalized speeds ------------------------------------------------------------------


class BallKinematics(NamedTuple):
    """Kinematics of the ball: coordinates q (5,), generalized speeds u (3,), and q̇ (5,)."""

    q: Any
    u: Any
    v: Any


def kinematics(parameters, prepared, q, u):
    """Return the `BallKinematics`: V = R ω × e_z + Ω e_z × r, and the rates of Euler's angles."""
    R, cos, sin = parameters.radius[0], prepared.angles.cos, prepared.angles.sin
    v = np.zeros(5, u.dtype)
    v[:2] = table_velocity(prepared.rate, q)
    v[0] += R * u[1]
    v[1] -= R * u[0]
    v[3] = u[0] * cos[0] + u[1] * sin[0]
    v[4] = (u[1] * cos[0] - u[0] * sin[0]) / cos[1]
    v[2] = u[2] - v[4] * sin[1]
    return BallKinematics(q, u, v)


def speeds(parameters, prepared, rolling):
    """Return the `Speeds` of the ball."""
    R, cos, sin, v = parameters.radius[0], prepared.angles.cos, prepared.angles.sin, rolling.v
    turn, lean, spin = v[2], v[3], v[4]
    W, rest, offset = np.zeros((5, 3), v.dtype), np.zeros(5, v.dtype), np.zeros(5, v.dtype)
    W[0, 1], W[1, 0] = R, -R
    W[3, 0], W[3, 1] = cos[0], sin[0]
    W[4, 0], W[4, 1] = -sin[0] / cos[1], cos[0] / cos[1]
    W[2, 0], W[2, 1], W[2, 2] = -W[4, 0] * sin[1], -W[4, 1] * sin[1], 1
    offset[:2] = table_velocity(prepared.rate, rolling.q)
    rest[:2] = table_acceleration(prepared.rate, prepared.acceleration, rolling.q, v)
    rest[3] = turn * spin * cos[1]
    rest[4] = lean * (spin * sin[1] - turn) / cos[1]
    rest[2] = -rest[4] * sin[1] - lean * spin * cos[1]
    return Speeds(W, rest, offset)


def qdot(parameters, prepared, rolling):
    """Return the velocity W u + offset (5,)."""
    return rolling.v


def bodies(parameters, prepared, rolling):
    """Return the `Bodies`, d = 2 and e = 3, in directions that do not turn.

    The ball is homogeneous: I ω is along ω, and there is no gyroscopic part.
    """
    R, u = parameters.radius[0], rolling.u
    partial = np.array([[[0, R, 0], [-R, 0, 0]]], u.dtype)
    turning = np.array([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], u.dtype)
    table = table_acceleration(prepared.rate, prepared.acceleration, rolling.q, rolling.v)
    remainder, still = table.reshape(1, 2), np.zeros((1, 3), u.dtype)
    mass, inertia = parameters.mass, parameters.inertia
    return Bodies(partial, turning, remainder, still, mass, inertia, None, None)


def angular_velocity(angles, v):
    """Return the angular velocity ω (3,) along x, y and the vertical."""
    cos, sin = angles.cos, angles.sin
    ahead, left = v[3], v[4] * cos[1]
    east, north = ahead * cos[0] - left * sin[0], ahead * sin[0] + left * cos[0]
    return np.array([east, north, v[2] + v[4] * sin[1]], v.dtype)


def speeds_of(parameters, prepared, q, v):
    """Return the generalized speeds u = ω (3,) of a velocity v."""
    return angular_velocity(prepared.angles, v)


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, prepared, q, v):
    """Return the velocity of the centre (1, 2) and of rotation (1, 3)."""
    return v[:2].reshape(1, 2), angular_velocity(prepared.angles, v).reshape(1, 3)


def positions(parameters, prepared, q):
    """Return the position of the centre (1, 2)."""
    return q[:2].reshape(1, 2)


def constraint(parameters, prepared, q, v):
    """Return c (2,), m/s: the velocity of ball relative to table at the point of contact."""
    R, rate, omega = parameters.radius[0], prepared.rate[0], angular_velocity(prepared.angles, v)
    c = [v[0] - R * omega[1] + rate * q[1], v[1] + R * omega[0] - rate * q[0]]
    return np.array(c, v.dtype)


# ---- The scene -----------------------------------------------------------------------------------


class TurntableBall(Parametric, functions=globals()):
    """A homogeneous ball that rolls on a turntable with an optionally oscillating spin.

    The table spins at Ω_0 + Ω_1 sin(κ t). A fast spin of the ball keeps Euler's angles away from
    their singular configuration.
    """

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), default=1.0)
    radius: Any = parameter("R", "m", "> 0", (0.1, 10.0), default=0.25)
    inertia: Any = parameter(
        *("about any axis, 2 m R²/5 if not given", "kg m²", "> 0", (0.01, 10.0)),
        default=lambda ball: 0.4 * ball.mass * ball.radius**2,
    )
    rate: Any = parameter("Ω_0, of the table", "rad/s", sample_range=(-5.0, 5.0), default=2.0)
    swing: Any = parameter("Ω_1", "rad/s", sample_range=(-5.0, 5.0), default=None, optional=True)
    frequency: Any = parameter("κ", "rad/s", sample_range=(0.1, 5.0), default=None, optional=True)
    start: Any = parameter("(x, y) at t = 0", "m", shape=(2,), default=(0.4, 0.0), read=False)
    speed: Any = parameter("(ẋ, ẏ) at t = 0", "m/s", shape=(2,), default=(0.0, 0.3), read=False)
    spin: Any = parameter("about the vertical at t = 0", "rad/s", default=20.0, read=False)

    key = "turntable-ball"
    named_coordinates = "x", "y", "ψ", "θ", "φ"
    display_pose = 0.55, 0.475, 0.6, 0.5, 0.7
    coordinate_sample_ranges = ANYWHERE, ANYWHERE, ANY_ANGLE, Range(-1.2, 1.2), ANY_ANGLE
    named_constraints = "along x", "along y"
    conserves_energy = False
    why_not_conserved = "the table is driven"
    depends_on_time = True
    angle_coordinates = slice(2, None)

    def __post_init__(self):
        if (self.swing is None) != (self.frequency is None):
            raise InputError(
                f"swing = {self.swing!r}, frequency = {self.frequency!r}, expected both or none"
            )
        self.check_fields()

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield the structural variants: tables with an oscillating and with a constant spin."""
        (steady,) = super().structures(links)
        yield cls(swing=1.0, frequency=3.0)
        yield steady

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the inertia about the centre, in any directions (1, 3, 3), kg m²."""
        return {"inertia": diagonal(arithmetic.numbers(self.inertia.reshape(1))[[[0, 0, 0]]])}

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of the ball at `start`, its angles 0, spinning so that it rolls."""
        (x, y), (along, across) = self.start, self.speed
        lean, roll = (self.rate * x - across) / self.radius, (along + self.rate * y) / self.radius
        return np.array([x, y, 0.0, 0.0, 0.0]), np.array([along, across, self.spin, lean, roll])

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |cos θ| <= 4 eps, where Euler's angles are singular."""
        refuse_flat(q[3])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, and the mirror image in the x axis on a table that spins backwards."""
        yield plane_rotation(self, q, v, slice(2, 3))
        swing = None if self.swing is None else -self.swing
        yield plane_mirror(replace(self, rate=-self.rate, swing=swing), q, v, unflipped=(0, 4))

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the table and the ball, with the angles at the centre of the ball."""
        x, y, heading, lean, spin = q
        east, north, up = np.eye(3)
        R = float(self.radius)
        e1 = np.cos(heading) * east + np.sin(heading) * north
        e3 = np.cos(lean) * up + np.sin(lean) * np.cross(e1, up)
        e2 = np.cross(e3, e1)
        foot = np.array([x, y, 0.0])
        center = foot + R * up
        rim = np.cos(spin) * e3 + np.sin(spin) * e1
        axes, turn = (np.cross(e2, rim), e2, rim), np.linspace(0.0, 2.0 * np.pi, 49)
        marks = [
            center + R * (np.outer(np.cos(turn), axes[i - 1]) + np.outer(np.sin(turn), axes[i - 2]))
            for i in range(3)
        ]  # great circles, by which one sees it turn
        parts = (
            draw.Disk(0.0 * up, up, 4.0 * R, "turntable"),
            *(*draw.fixed_axes(0.9 * R, 3), draw.Disk(center, up, R, "ball", ball=True)),
            *(draw.Body([*mark], thin=True) for mark in marks),
            *(draw.Distance("x", y * north, foot), draw.Distance("y", x * east, foot)),
            draw.Angle("ψ", center, east, north, heading, 1.5 * R),
            draw.Arrow("", center, 1.7 * R * east),
            draw.Angle("θ", center, up, np.cross(e1, up), lean, 1.5 * R),
            draw.Arrow("", center, 1.7 * R * up),
            draw.Angle("φ", center, e3, e1, spin, 1.25 * R),
            draw.Arrow("e_1", center, 1.8 * R * e1),
            *(draw.Arrow("e_2", center, 1.8 * R * e2), draw.Arrow("e_3", center, 1.8 * R * e3)),
            draw.Angle("Ω", 0.0 * up, east, north, 0.9, 3.5 * R),
            *(draw.Trail(center), draw.ConstraintMark("no slip", foot, (0, 1))),
        )
        return draw.Sketch(parts, azimuth=-1.75, elevation=0.45)
