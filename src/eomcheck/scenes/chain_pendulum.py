"""A planar chain of rigid links that hangs on a pin: gravity, and no constraint at all.

q = [θ_1 .. θ_N], absolute angles of the links from the horizontal x axis, y up. The centre of mass
of a link is in its middle. One link is a compound pendulum, whose period is known by the complete
elliptic integral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.assembled import Assembled, Jacobians
from eomcheck.mechanics.parameters import Parametric, of_links, parameter, whole_links
from eomcheck.mechanics.records import Range, Tree
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic
from eomcheck.scenes.snake_terms import carried


class Parameters(NamedTuple):
    """The parameters of a `ChainPendulum` in some kind of number."""

    mass: Any
    """(N,), kg."""
    length: Any
    """(N,), m."""
    inertia: Any
    """About the centres of mass (N, 1, 1), kg m²."""
    gravity: Any
    """g (1,), m/s², or None."""


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Angles` of the links."""
    return arithmetic.angles(q)


# ---- How the links move --------------------------------------------------------------------------


@generic
def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: link j moves all that hangs on it by its length, itself by half."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    links = cos.size
    linear, angular = np.zeros((links, 2, links), cos.dtype), np.zeros((links, 1, links), cos.dtype)
    rest, angular_rest = np.zeros((links, 2), cos.dtype), np.zeros((links, 1), cos.dtype)
    for j in range(links):
        x, y = length[j] * cos[j], length[j] * sin[j]
        angular[j, 0, j] = 1
        linear[j, 0, j], linear[j, 1, j] = -y / 2, x / 2
        rest[j, 0] -= x / 2 * v[j] * v[j]
        rest[j, 1] -= y / 2 * v[j] * v[j]
        for k in range(j + 1, links):
            linear[k, 0, j], linear[k, 1, j] = -y, x
            rest[k, 0] -= x * v[j] * v[j]
            rest[k, 1] -= y * v[j] * v[j]
    return Jacobians(linear, angular, rest, angular_rest, None)


@generic
def weights(gravity, mass, length, cos):
    """Return Q (N,) of gravity, or None without it."""
    if gravity is None:
        return None
    return -gravity[0] * carried(mass, length)[1] * cos


@generic
def forces(parameters, angles, q, v):
    """Return Q (N,), or None."""
    return weights(parameters.gravity, parameters.mass, parameters.length, angles.cos)


# ---- The second derivation: positions and velocities only ----------------------------------------


@generic
def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (N, 2) and of rotation (N, 1)."""
    links = parameters.length.size
    V = np.zeros((links, 2), v.dtype)
    x = y = 0
    for i in range(links):
        half = parameters.length[i] / 2
        V[i, 0] = x - half * v[i] * angles.sin[i]
        V[i, 1] = y + half * v[i] * angles.cos[i]
        x = x - parameters.length[i] * v[i] * angles.sin[i]
        y = y + parameters.length[i] * v[i] * angles.cos[i]
    return V, v.reshape(links, 1)


@generic
def height_energy(gravity, mass, length, sin):
    """Return U = g Σ m y, J, or None without gravity."""
    if gravity is None:
        return None
    U = y = 0
    for i in range(length.size):
        U += gravity[0] * mass[i] * (y + length[i] / 2 * sin[i])
        y = y + length[i] * sin[i]
    return U


@generic
def potential(parameters, angles, q):
    """Return U, J, or None."""
    return height_energy(parameters.gravity, parameters.mass, parameters.length, angles.sin)


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class ChainPendulum(Parametric, Assembled, functions=globals()):
    """An N-link planar chain that hangs on a pin, N >= 1, without any constraint.

    Args:
        mass: of the links (N,), kg, positive.
        length: of the links (N,), m, positive.
        inertia: of the links about their centres of mass (N,), kg m², not negative.
        gravity: g, m/s², not negative, along -y, or None without.
        pose: θ at t = 0 (N,), rad, where it starts from rest; all zero (stretched along x) if not
            given.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    mass: Any = parameter(sign="positive", shape=of_links, drawn=Range(0.1, 10.0))
    length: Any = parameter(sign="positive", shape=of_links, drawn=Range(0.1, 10.0))
    inertia: Any = parameter(sign="not negative", shape=of_links, drawn=Range(0.01, 10.0))
    gravity: Any = parameter(9.81, "not negative", drawn=Range(0.0, 20.0, optional=True))
    pose: Any = parameter(None, shape=of_links, otherwise=lambda chain: np.zeros(chain.links))

    key = "chain-pendulum"
    conserves_energy = True
    has_links = True
    angle_coordinates = slice(0, None)

    def __post_init__(self):
        links = np.size(self.mass)
        if np.ndim(self.mass) != 1 or links < 1:
            raise InputError(f"mass = {self.mass!r}: a chain has at least 1 link, one mass each")
        self.check_fields(links)

    @classmethod
    def rods(cls, links: int) -> ChainPendulum:
        """Return a chain of slender rods of 1 m and 1 kg, stretched along x."""
        one = np.ones(whole_links(links))
        return cls(one, one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[ChainPendulum]:
        """Yield a chain of rods with gravity, and one without."""
        rods = cls.rods(whole_links(links))
        yield rods
        yield replace(rods, gravity=None)

    @property
    def links(self) -> int:
        """N."""
        return self.mass.size

    @property
    def n(self) -> int:
        """N coordinates."""
        return self.links

    @property
    def name(self) -> str:
        """chain-pendulum[N]."""
        return f"{self.key}[{self.links}]"

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """θ_1 .. θ_N."""
        return tuple(f"θ_{i + 1}" for i in range(self.links))

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        inertia = arithmetic.numbers(self.inertia.reshape(-1, 1, 1))
        return self.in_numbers(arithmetic, Parameters, inertia=inertia)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`."""
        return self.pose.copy(), np.zeros(self.n)

    def tree(self) -> Tree:
        """Return one RZ after the other: relative angles."""
        links = self.links
        offset, center = np.zeros((2, links, 3))
        offset[1:, 0] = self.length[:-1]
        center[:, 0] = self.length / 2
        return Tree(
            parent=tuple(range(-1, links - 1)),
            joint=("rz",) * links,
            offset=offset,
            mass=self.mass,
            center=center,
            inertia=self.inertia,
            coordinates=np.eye(links) - np.eye(links, k=-1),
        )
