"""N four-bar linkages side by side: closed loops, differentiated to velocity level.

N + 1 rods stand on the ground, one length apart from the next, and N couplers join their tips: N
windows, all of them parallelograms. q = [θ_1 .. θ_N, φ_1 .. φ_N, θ_0]: absolute angles of the rods
and of the couplers from the horizontal x axis, y up. The crank θ_0 comes last, where the paper's
partition takes the independent coordinate. Coupler k goes from the tip of rod k-1 to that of rod k.

Each window must close, which is two equations between positions; their rates are the constraints.
Where all links lie on one line the rates depend on each other: n + r directions are left for a
moment, and the mechanism might go on as an antiparallelogram.

Source: the N four-bar mechanism of the IFToMM benchmark library, A02 (Gonzalez et al. 2006).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eomcheck.errors import whole_number
from eomcheck.mechanics import linkage
from eomcheck.mechanics.gravity import height_energy, weights
from eomcheck.mechanics.linkage import backwards, halved, rods, with_row
from eomcheck.mechanics.parameters import OfLinks, parameter
from eomcheck.mechanics.plane import full_turns
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.mechanics.sketch import (
    Arrow,
    Body,
    Center,
    Constraint,
    Joint,
    Sketch,
    Trail,
    direction,
    fixed_axes,
    turned_by,
)
from eomcheck.mechanics.tree import Tree, planar_tree
from eomcheck.numbers.contract import Arithmetic, Array

# ---- How the links move --------------------------------------------------------------------------


def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: a rod moves the coupler that starts at its tip by its length."""
    tips, windows = rods(parameters.length, angles), q.size // 2
    halves = halved(tips)
    upright = [[half] for half in halves[:windows]]
    couplers = [[tips[k - 1], halves[windows + k]] for k in range(windows)]
    return linkage.pinned_jacobians([*upright, *couplers, halves[-1:]], v)


def forces(parameters, angles, q, v):
    """Return Q (2N+1,), or None."""
    x, windows = parameters.length * angles.cos, q.size // 2
    upward = np.zeros((q.size, q.size), q.dtype)
    for i in range(q.size):
        upward[i, i] = x[i] / 2
    for k in range(windows):
        upward[windows + k, k - 1] = x[k - 1]
    return weights(parameters.gravity, parameters.mass, upward)


# ---- What closes the windows ---------------------------------------------------------------------


def around(parameters, angles, windows):
    """Return the arms around each window: up a rod, along the coupler, down the next rod."""
    tips = rods(parameters.length, angles)
    return [[tips[k - 1], tips[windows + k], *backwards([tips[k]])] for k in range(windows)]


def constraints(parameters, angles, q):
    """Return (a (r, 2N+1), None): rows 2k and 2k+1 are the rate of window k along x and y."""
    windows = q.size // 2
    a = linkage.closing(around(parameters, angles, windows), windows, q)
    return with_row(a, a[-1:], parameters.repeated), None


def drift(parameters, angles, q, v):
    """Return gamma (r,): the links' centripetal accelerations around each window."""
    windows = q.size // 2
    gamma = linkage.closing_drift(around(parameters, angles, windows), windows, v)
    return with_row(gamma, gamma[-1:], parameters.repeated)


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (2N+1, 2) and of rotation (2N+1, 1)."""
    speed, windows = parameters.length * v, v.size // 2
    tips = -speed * angles.sin, speed * angles.cos
    V = np.zeros((v.size, 2), v.dtype)
    for i in range(2):
        V[:, i] = tips[i] / 2
        for k in range(windows):
            V[windows + k, i] += tips[i][k - 1]
    return V, v.reshape(v.size, 1)


def round_windows(x, y):
    """Return where the links with these components lead around each window (2N,)."""
    windows = x.size // 2
    gap = [[z[k - 1] + z[windows + k] - z[k] for z in (x, y)] for k in range(windows)]
    return np.array(gap, x.dtype).reshape(2 * windows)


def position_residual(parameters, angles, q):
    """Return by how much each window does not close (r,), m; the ground is as long as couplers."""
    windows, x = q.size // 2, parameters.length * angles.cos
    x[windows:-1] -= parameters.length[windows:-1]
    gap = round_windows(x, parameters.length * angles.sin)
    return with_row(gap, gap[-1:], parameters.repeated)


def constraint(parameters, angles, q, v):
    """Return c (r,), m/s: how the end of each coupler moves against the tip of its second rod."""
    speed = parameters.length * v
    c = round_windows(-speed * angles.sin, speed * angles.cos)
    return with_row(c, c[-1:], parameters.repeated)


def potential(parameters, angles, q):
    """Return U, J, or None."""
    windows, tips = q.size // 2, parameters.length * angles.sin
    heights = tips / 2
    for k in range(windows):
        heights[windows + k] += tips[k - 1]
    return height_energy(parameters.gravity, parameters.mass, heights)


# ---- The scene -----------------------------------------------------------------------------------


def of_bodies(windows: int) -> tuple[int, ...]:
    """Return the shape of what every rod and every coupler has one of."""
    return (2 * windows + 1,)


class FourBarChain(OfLinks, functions=globals()):
    """N four-bar linkages side by side, N >= 1: closed loops through singular poses.

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
    one_mass_each = "N >= 1 windows have 2N+1 links, one mass each"
    conserves_energy = True
    angle_coordinates = slice(0, None)

    @staticmethod
    def links_of(masses: int) -> int:
        """Return the number of windows for so many masses."""
        return masses // 2

    @classmethod
    def rods(cls, windows: int) -> FourBarChain:
        """Return the benchmark: slender rods of 1 m and 1 kg, upright, tips moving at 1 m/s."""
        one = np.ones(2 * whole_number("windows", windows) + 1)
        return cls(one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[FourBarChain]:
        """Yield the benchmark with `links` windows, and the same without gravity."""
        rods = cls.rods(whole_number("links", links))
        yield rods
        yield replace(rods, gravity=None)

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return rods within 0.5 rad of upright and couplers within 0.1 rad of horizontal."""
        rod, coupler = Range(1.1, 2.1), Range(-0.1, 0.1)
        return (*[rod] * self.windows, *[coupler] * self.windows, rod)

    @property
    def windows(self) -> int:
        """N."""
        return self.links

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """θ_1 .. θ_N, φ_1 .. φ_N, θ_0."""
        numbers = range(1, self.windows + 1)
        return (*(f"θ_{k}" for k in numbers), *(f"φ_{k}" for k in numbers), "θ_0")

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Each window along x and along y, the last one once more if it is repeated."""
        numbers = range(1, self.windows + 1)
        names = [f"window {k}, {axis}" for k in numbers for axis in "xy"]
        return (*names, *(() if self.repeated is None else ("repeated",)))

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the lengths of rods and couplers (2N+1,)."""
        length, span = (arithmetic.numbers(x.reshape(1)) for x in (self.length, self.span))
        return {"length": np.concatenate((*[length] * self.links, *[span] * self.links, length))}

    def initial_state(self) -> tuple[Array, Array]:
        """Return all rods at `angle`, turning at `rate`, couplers horizontal."""
        q, v = np.zeros(self.n), np.zeros(self.n)
        is_rod = np.ones(self.n, dtype=bool)
        is_rod[self.windows : 2 * self.windows] = False
        q[is_rod], v[is_rod] = self.angle, self.rate
        return q, v

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield one turn of every link by 2π, which changes nothing."""
        yield full_turns(self, q, v)

    def tree(self) -> Tree:
        """Return the windows cut open where couplers end: rod 0, coupler 1, rod 1, coupler 2 ..."""
        N = self.windows
        order = np.array([2 * N, *np.column_stack((range(N, 2 * N), range(N))).ravel()])
        axes, is_coupler = np.eye(self.n), np.arange(self.n) % 2 == 1
        offset, center = np.zeros((2, self.n, 3))
        offset[:, 0] = np.where(is_coupler, self.length, self.span * (np.arange(self.n) // 2))
        center[:, 0] = np.where(is_coupler, self.span, self.length) / 2
        return planar_tree(
            parent=tuple(j - 1 if coupler else -1 for j, coupler in enumerate(is_coupler)),
            joint=("rz",) * self.n,
            offset=offset,
            mass=self.mass[order],
            center=center,
            inertia=self.inertia[order],
            coordinates=axes[order] - is_coupler[:, None] * axes[np.roll(order, 1)],
        )

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[FourBarChain, Array]:
        """Return the rods leaning."""
        scene = replace(cls.rods(3 if links is None else links), angle=1.1)
        return scene, scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return rods from left to right, each coupler from the tip before it."""
        N, length, span = self.windows, float(self.length), float(self.span)
        feet = [np.array([k * span, 0.0]) for k in range(N + 1)]
        tips = [feet[k] + length * direction(q[k - 1]) for k in range(N + 1)]
        parts = [*fixed_axes(0.4 * span)]
        for k in range(N + 1):
            parts += [Body((feet[k], tips[k]), f"rod {k}"), Joint(feet[k], ground=True)]
            parts += [Center((feet[k] + tips[k]) / 2), Joint(tips[k])]
            parts += [turned_by(f"θ_{k}", feet[k], q[k - 1], 0.28 * length)]
        for k in range(1, N + 1):
            start, end = tips[k - 1], tips[k - 1] + span * direction(q[N + k - 1])
            parts += [Body((start, end), f"coupler {k}"), Center((start + end) / 2)]
            parts += [turned_by(f"φ_{k}", start, q[N + k - 1], 0.35 * span)]
            middle, rows = (feet[k - 1] + end) / 2, (2 * k - 2, 2 * k - 1)
            more = () if self.repeated is None or k < N else (2 * N,)
            parts += [Constraint(f"window {k}", middle, (*rows, *more))]
        if self.gravity is not None:
            parts += [Arrow("g", (-0.4 * span, 0.9 * length), (0, -0.4 * length), frame=False)]
        return Sketch((*parts, Trail(tips[0])))
