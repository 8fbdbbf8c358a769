"""N four-bar linkages side by side: closed loops, differentiated to velocity level.

N + 1 rods stand on the ground, one length apart from the next, and N couplers join their tips: N
windows, all of them parallelograms. q = [θ_1 .. θ_N, φ_1 .. φ_N, θ_0]: absolute angles of the rods
and of the couplers from the horizontal x axis, y up. The crank θ_0 comes last, where the paper's
partition takes the independent coordinate. Coupler k goes from the tip of rod k-1 to that of rod k.

The loop closure of each window is two equations between positions; their rates are the constraints.
Where all links lie on one line, a singular configuration, the rates depend on each other: n + r
directions are free for an instant, and the mechanism might continue as an antiparallelogram.

Source: the N four-bar mechanism of the IFToMM benchmark library, A02 (Gonzalez et al. 2006).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.errors import whole_number
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import MOST_LINKS, OfLinks, number_of_links, parameter
from eomcheck.mechanics.records import Range, Symmetry, full_turns
from eomcheck.numbers.generic import Arithmetic, Array


def names_of(windows):
    """Return the names of the bodies."""
    numbers = range(1, windows + 1)
    return (*(f"rod {k}" for k in numbers), *(f"coupler {k}" for k in numbers), "rod 0")


def description(parameters):
    """Return the declarative description: rods on the ground, couplers on tips, loop closures."""
    mass, length, gravity = parameters.mass, parameters.length, parameters.gravity
    windows = mass.size // 2
    names, rod, span = names_of(windows), length[-1], length[windows]
    bodies = zip(names, mass, length, strict=True)
    links = [elements.Link(name, m, (along / 2, 0, 0)) for name, m, along in bodies]
    tip, end, foot = (rod, 0, 0), (span, 0, 0), 0
    joints, closing = [elements.Joint("θ_0", "revolute", GROUND, "rod 0")], []
    for k in range(1, windows + 1):
        before, coupler, after, foot = f"rod {k - 1}", f"coupler {k}", f"rod {k}", foot + span
        joints += [
            elements.Joint(f"φ_{k}", "revolute", before, coupler, tip, absolute=True),
            elements.Joint(f"θ_{k}", "revolute", GROUND, after, (foot, 0, 0)),
        ]
        closing += [elements.pin(f"window {k}", coupler, after, end, tip)]
    if parameters.repeated is not None:
        points, up = closing[-1].points, ((GROUND, (0, 1, 0)),)
        closing += [
            elements.Constraint("on-plane", "repeated", points, up, factor=parameters.repeated[0])
        ]
    down = None if gravity is None else (0, -gravity[0], 0)
    return Description(links, joints, coordinates(windows), closing, gravity=down, planar=True)


def coordinates(windows):
    """Return the names θ_1 .. θ_N, φ_1 .. φ_N, θ_0."""
    numbers = range(1, windows + 1)
    return (*(f"θ_{k}" for k in numbers), *(f"φ_{k}" for k in numbers), "θ_0")


# ---- The scene -----------------------------------------------------------------------------------


def of_bodies(windows: int) -> tuple[int, ...]:
    """Return the shape of a parameter with one entry for every rod and coupler."""
    return (2 * windows + 1,)


class FourBarChain(Described, OfLinks, description=description, closed=True):
    """N four-bar linkages side by side, N >= 1: closed loops through singular configurations.

    Bodies are rods 1 .. N, couplers 1 .. N and rod 0. Without gravity, it is None. If the last row
    of the constraints is repeated, the rows depend on each other at every state.
    """

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), of_bodies)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), of_bodies)
    length: Any = parameter("of rods", "m", "> 0", (0.1, 10.0), default=1.0, read=False)
    span: Any = parameter("of couplers, ground", "m", "> 0", (0.1, 10.0), default=1.0, read=False)
    gravity: Any = parameter("g, along -y", "m/s²", ">= 0", (0.0, 20.0, None), default=9.81)
    angle: Any = parameter("of all rods at t = 0", "rad", default=np.pi / 2, read=False)
    rate: Any = parameter("at which they turn at t = 0", "rad/s", default=-1.0, read=False)
    repeated: Any = parameter("times the last row is repeated", "1", default=None, optional=True)

    key = "four-bar-chain"
    usually_absent = frozenset({"repeated"})
    one_mass_each = "N >= 1 windows have 2N+1 links, one mass each"
    conserves_energy = True
    angle_coordinates = slice(0, None)

    @staticmethod
    def links_of(masses: int) -> int:
        """Return the number of windows for a number of masses."""
        return masses // 2

    @classmethod
    def rods(cls, windows: int) -> FourBarChain:
        """Return the benchmark: slender rods of 1 m and 1 kg, upright, tips moving at 1 m/s."""
        one = np.ones(2 * whole_number("windows", windows, most=MOST_LINKS) + 1)
        return cls(one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[FourBarChain]:
        """Yield the benchmark with `links` windows, and the same without gravity."""
        rods = cls.rods(number_of_links(links))
        yield rods
        yield replace(rods, gravity=None)

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return sampling ranges, rods 0.5 rad about upright, couplers 0.1 rad about horizontal."""
        rod, coupler = Range(1.1, 2.1), Range(-0.1, 0.1)
        return (*[rod] * self.windows, *[coupler] * self.windows, rod)

    @property
    def windows(self) -> int:
        """Number of windows N."""
        return self.links

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names θ_1 .. θ_N, φ_1 .. φ_N, θ_0."""
        return coordinates(self.windows)

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the rows: each window along x and y, the last one again if it is repeated."""
        numbers = range(1, self.windows + 1)
        names = [f"window {k}, {axis}" for k in numbers for axis in "xy"]
        return (*names, *(() if self.repeated is None else ("repeated",)))

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the lengths of rods and couplers (2N+1,)."""
        length, span = (arithmetic.numbers(x.reshape(1)) for x in (self.length, self.span))
        return {"length": np.concatenate((*[length] * self.links, *[span] * self.links, length))}

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state with all rods at `angle`, turning at `rate`, couplers horizontal."""
        q, v = np.zeros(self.n), np.zeros(self.n)
        is_rod = np.ones(self.n, dtype=bool)
        is_rod[self.windows : 2 * self.windows] = False
        q[is_rod], v[is_rod] = self.angle, self.rate
        return q, v

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation of every link by 2π, which changes nothing."""
        yield full_turns(self, q, v)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[FourBarChain, Array]:
        """Return the mechanism with leaning rods, and its pose."""
        scene = replace(cls.rods(3 if links is None else links), angle=1.1)
        return scene, scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the rods from left to right, each coupler from the previous tip."""
        N, length, span = self.windows, float(self.length), float(self.span)
        feet = [np.array([k * span, 0.0]) for k in range(N + 1)]
        tips = [feet[k] + length * draw.direction(q[k - 1]) for k in range(N + 1)]
        parts = [*draw.fixed_axes(0.4 * span)]
        for k in range(N + 1):
            parts += [
                draw.Body((feet[k], tips[k]), f"rod {k}"),
                draw.JointMark(feet[k], ground=True),
            ]
            parts += [draw.Center((feet[k] + tips[k]) / 2), draw.JointMark(tips[k])]
            parts += [draw.plane_angle(f"θ_{k}", feet[k], q[k - 1], 0.28 * length)]
        for k in range(1, N + 1):
            start, end = tips[k - 1], tips[k - 1] + span * draw.direction(q[N + k - 1])
            parts += [draw.Body((start, end), f"coupler {k}"), draw.Center((start + end) / 2)]
            parts += [draw.plane_angle(f"φ_{k}", start, q[N + k - 1], 0.35 * span)]
            middle, rows = (feet[k - 1] + end) / 2, (2 * k - 2, 2 * k - 1)
            more = () if self.repeated is None or k < N else (2 * N,)
            parts += [draw.ConstraintMark(f"window {k}", middle, (*rows, *more))]
            parts += [draw.Closing(end, tips[k], (*rows, *more))]
        if self.gravity is not None:
            parts += [draw.Arrow("g", (-0.4 * span, 0.9 * length), (0, -0.4 * length), frame=False)]
        return draw.Sketch((*parts, draw.Trail(tips[0])), **draw.UPRIGHT)
