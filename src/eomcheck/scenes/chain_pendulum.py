"""A planar chain of rigid links that hangs on a pin: gravity, and no constraint at all.

q = [θ_1 .. θ_N], absolute angles of the links from the horizontal x axis, y up. The centre of mass
of a link is in its middle. One link is a compound pendulum, whose period is known by the complete
elliptic integral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eomcheck.errors import whole_number
from eomcheck.mechanics.gravity import height_energy
from eomcheck.mechanics.linkage import halved, pinned_jacobians, rods
from eomcheck.mechanics.parameters import OfLinks, of_links, parameter, stretched
from eomcheck.mechanics.serial import passed_on, serial_tree
from eomcheck.mechanics.sketch import (
    Arrow,
    Body,
    Center,
    Joint,
    Sketch,
    Trail,
    direction,
    fixed_axes,
    turned_by,
)
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.contract import Array
from eomcheck.scenes.snake_terms import carried

# ---- How the links move --------------------------------------------------------------------------


def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: link j moves all that hangs on it by its length, itself by half."""
    tips = rods(parameters.length, angles)
    halves = halved(tips)
    return pinned_jacobians([[*tips[:k], halves[k]] for k in range(q.size)], v)


def weights(gravity, mass, length, cos):
    """Return Q (N,) of gravity, or None without it."""
    if gravity is None:
        return None
    return -gravity[0] * carried(mass, length)[1] * cos


def forces(parameters, angles, q, v):
    """Return Q (N,), or None."""
    return weights(parameters.gravity, parameters.mass, parameters.length, angles.cos)


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (N, 2) and of rotation (N, 1)."""
    return passed_on(parameters.length, angles, 0, 0, v)


def potential(parameters, angles, q):
    """Return U, J, or None."""
    heights, y = np.zeros(q.size, q.dtype), 0
    for i in range(q.size):
        rise = parameters.length[i] * angles.sin[i]
        heights[i], y = y + rise / 2, y + rise
    return height_energy(parameters.gravity, parameters.mass, heights)


# ---- The scene -----------------------------------------------------------------------------------


class ChainPendulum(OfLinks, functions=globals()):
    """An N-link planar chain that hangs on a pin, N >= 1, without any constraint."""

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), of_links)
    length: Any = parameter("L", "m", "> 0", (0.1, 10.0), of_links)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), of_links)
    gravity: Any = parameter("g, along -y", "m/s²", ">= 0", (0.0, 20.0, None), default=9.81)
    pose: Any = parameter("θ at t = 0", "rad", shape=of_links, default=stretched, read=False)

    key = "chain-pendulum"
    one_mass_each = "a chain has at least 1 link, one mass each"
    conserves_energy = True
    angle_coordinates = slice(0, None)

    @classmethod
    def rods(cls, links: int) -> ChainPendulum:
        """Return a chain of slender rods of 1 m and 1 kg, stretched along x."""
        one = np.ones(whole_number("links", links))
        return cls(one, one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[ChainPendulum]:
        """Yield a chain of rods with gravity, and one without."""
        rods = cls.rods(whole_number("links", links))
        yield rods
        yield replace(rods, gravity=None)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """θ_1 .. θ_N."""
        return tuple(f"θ_{i + 1}" for i in range(self.links))

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`."""
        return self.pose.copy(), np.zeros(self.n)

    def tree(self) -> Tree:
        """Return one RZ after the other: relative angles."""
        return serial_tree(self.mass, self.length, self.inertia, free=False)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[ChainPendulum, Array]:
        """Return a chain that swings."""
        scene = cls.rods(3 if links is None else links)
        return scene, -1.2 + 0.9 * np.linspace(-0.5, 1.0, scene.links)

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return the links from the pin on."""
        size, at = self.length.mean(), np.zeros(2)
        parts = [*fixed_axes(0.5 * size), Joint(at, ground=True)]
        for i, angle in enumerate(q):
            end = at + self.length[i] * direction(angle)
            parts += [Body((at, end), f"link {i + 1}"), Center((at + end) / 2)]
            parts += [turned_by(f"θ_{i + 1}", at, angle, 0.3 * size)]
            parts += [Joint(at)] if i else []
            at = end
        if self.gravity is not None:
            parts += [Arrow("g", (-0.6 * size, -0.3 * size), (0, -0.5 * size), frame=False)]
        return Sketch((*parts, Trail(at)))
