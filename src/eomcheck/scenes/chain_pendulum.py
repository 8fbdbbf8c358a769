"""A planar chain of rigid links on a pin, under gravity and without any constraint.

q = [θ_1 .. θ_N], absolute angles of the links from the horizontal x axis, y up. The centre of mass
of a link is in its middle. One link is a compound pendulum, whose period is known by the complete
elliptic integral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import OfLinks, number_of_links, of_links, parameter, stretched
from eomcheck.numbers.generic import Array


def description(parameters):
    """Return the declarative description: each link on the tip of the previous one."""
    mass, length, gravity = parameters.mass, parameters.length, parameters.gravity
    names = [GROUND, *(f"link {k + 1}" for k in range(mass.size))]
    links, joints = [], []
    for k, (before, name) in enumerate(pairwise(names)):
        links.append(elements.Link(name, mass[k], (length[k] / 2, 0, 0)))
        tip = (length[k - 1], 0, 0) if k else elements.ORIGIN
        joints.append(elements.Joint(f"θ_{k + 1}", "revolute", before, name, tip, absolute=True))
    down = None if gravity is None else (0, -gravity[0], 0)
    return Description(links, joints, gravity=down, planar=True)


# ---- The scene -----------------------------------------------------------------------------------


class ChainPendulum(Described, OfLinks, description=description):
    """An N-link planar chain on a pin, N >= 1, without any constraint."""

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
        one = np.ones(number_of_links(links))
        return cls(one, one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[ChainPendulum]:
        """Yield the structural variants: a chain of rods with gravity, and one without."""
        rods = cls.rods(number_of_links(links))
        yield rods
        yield replace(rods, gravity=None)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names θ_1 .. θ_N."""
        return tuple(f"θ_{i + 1}" for i in range(self.links))

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`."""
        return self.pose.copy(), np.zeros(self.n)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[ChainPendulum, Array]:
        """Return a swinging chain and its pose."""
        scene = cls.rods(3 if links is None else links)
        return scene, -1.2 + 0.9 * np.linspace(-0.5, 1.0, scene.links)

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the links, from the pin to the tip."""
        size, at = self.length.mean(), np.zeros(2)
        parts = [*draw.fixed_axes(0.5 * size), draw.JointMark(at, ground=True)]
        for i, angle in enumerate(q):
            end = at + self.length[i] * draw.direction(angle)
            parts += [draw.Body((at, end), f"link {i + 1}"), draw.Center((at + end) / 2)]
            parts += [draw.plane_angle(f"θ_{i + 1}", at, angle, 0.3 * size)]
            parts += [draw.JointMark(at)] if i else []
            at = end
        if self.gravity is not None:
            parts += [draw.Arrow("g", (-0.6 * size, -0.3 * size), (0, -0.5 * size), frame=False)]
        return draw.Sketch((*parts, draw.Trail(at)), **draw.UPRIGHT)
