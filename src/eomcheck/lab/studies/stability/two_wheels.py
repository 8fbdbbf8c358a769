"""Nearly dependent constraints: a snake with a second wheel on link 1, at almost the same angle.

Two wheels at different angles fix their centre, however little the angles differ; then the whole
chain can only turn around that point. Two wheels at the same angle are one constraint, written
twice.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.mechanics.records import Speeds
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS, Arithmetic, Array, generic
from eomcheck.scenes import Snake


class Parameters(NamedTuple):
    """Parameters of the snake, and of the second wheel."""

    snake: Any
    cos_alpha: Any
    """Cosine of the angle of the second wheel against link 1 (1,)."""
    sin_alpha: Any
    """Sine of that angle (1,)."""
    sin_second: Any
    """Sine of the angle between the two wheels (1,)."""


@generic
def _second(parameters):
    """Return the parameters of a snake whose first wheel is the second one."""
    cos, sin = parameters.snake.cos_alpha.copy(), parameters.snake.sin_alpha.copy()
    cos[0], sin[0] = parameters.cos_alpha[0], parameters.sin_alpha[0]
    return parameters.snake._replace(cos_alpha=cos, sin_alpha=sin)


@generic
def _with_row(x, row):
    """Return x with one row appended."""
    out = np.zeros((x.shape[0] + 1, *x.shape[1:]), x.dtype)
    out[:-1] = x
    out[-1] = row
    return out


@generic
def constraints(parameters, angles, q):
    """Return (a (N+1, N+2), None)."""
    a, b = Snake.constraints(parameters.snake, angles, q)
    return _with_row(a, Snake.constraints(_second(parameters), angles, q)[0][0]), b


@generic
def terms(parameters, angles, q, v):
    """Return the `Terms` of the snake with one constraint more."""
    first_wheel = Snake.terms(parameters.snake, angles, q, v)
    other = Snake.terms(_second(parameters), angles, q, v)
    return first_wheel._replace(
        a=_with_row(first_wheel.a, other.a[0]), gamma=_with_row(first_wheel.gamma, other.gamma[0])
    )


@generic
def kinematics(parameters, angles, q, u):
    """Return the `Rolling` of the snake at u = (s_1, ω_1), where s_1 sin(second) = 0."""
    both = np.zeros(2, u.dtype)
    both[0], both[1] = 0 * u[0] / parameters.sin_second[0], u[0]
    return Snake.kinematics(parameters.snake, angles, q, both)


@generic
def speeds(parameters, angles, rolling):
    """Return the `Speeds` of the only motion left."""
    W, rest, offset = Snake.speeds(parameters.snake, angles, rolling)
    return Speeds(W[:, 1:], rest, offset)


@generic
def bodies(parameters, angles, rolling):
    """Return the `Bodies`, with one partial velocity each."""
    snake_bodies = Snake.bodies(parameters.snake, angles, rolling)
    return snake_bodies._replace(
        partial_velocity=snake_bodies.partial_velocity[:, :, 1:],
        partial_angular_velocity=snake_bodies.partial_angular_velocity[:, :, 1:],
        force=None if snake_bodies.force is None else snake_bodies.force[1:],
    )


@generic
def speeds_of(parameters, angles, q, v):
    """Return u = (ω_1,)."""
    return v[2:3]


@generic
def constraint(parameters, angles, q, v):
    """Return the velocities of the N+1 wheels along their axles."""
    c = Snake.constraint(parameters.snake, angles, q, v)
    return _with_row(c, Snake.constraint(_second(parameters), angles, q, v)[0])


@generic
def velocities(parameters, angles, q, v):
    """Return the velocities of the links."""
    return Snake.velocities(parameters.snake, angles, q, v)


@generic
def energies(parameters, angles, q, v):
    """Return (T, U), J."""
    return Snake.energies(parameters.snake, angles, q, v)


class TwoWheels(Scene, functions=globals()):
    """Snake with a second wheel on its first link.

    Args:
        first: the snake.
        second: angle of the second wheel against the first, rad.
    """

    key = "two-wheels"
    conserves_energy = True
    angle_coordinates = Snake.angle_coordinates

    prepare = staticmethod(Snake.prepare)

    def __init__(self, first: Snake, second: float):
        self.first, self.second = first, second

    @property
    def name(self) -> str:
        """two-wheels[N]."""
        return f"two-wheels[{self.first.links}]"

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """x, y, θ_1 .. θ_N."""
        return self.first.coordinate_names

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """wheel 1 .. wheel N, second wheel."""
        return (*self.first.constraint_names, "second wheel")

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters as numbers of `arithmetic`."""
        wheel = arithmetic.angles(self.first.wheel_angle[:1] + self.second)
        between = arithmetic.angles(np.array([self.second]))
        return Parameters(self.first.parameters(arithmetic), wheel.cos, wheel.sin, between.sin)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the snake's initial state, at rest."""
        return self.first.initial_state()

    def refuse_speeds(self, q: Array) -> None:
        """Refuse wheels at one angle to rounding: then the only motion left is not the only one."""
        apart = abs(float(np.sin(self.second)))
        if apart <= 4 * EPS:
            raise RefusedError(
                "sin second",
                apart,
                4 * EPS,
                f"second = {self.second!r}: the two wheels of link 1 are one constraint; the "
                f"generalized speed ω_1 needs |sin second| > {4 * EPS:.2g}",
            )
