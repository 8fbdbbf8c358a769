"""The paper's N-link snake robot on passive wheels, sliding nowhere sideways (Sec. 10).

N rigid links in the plane, coupled by torsion springs. Wheel i sits at the centre of mass of link
i, turned by the constant angle α_i against it; q = [x, y, θ_1 .. θ_N], (x, y) the free tip of link
1, θ absolute. Below, per link i: n_i = (-sin θ_i, cos θ_i) is normal to the link, φ_i = α_i + θ_i
the direction in which the wheel rolls, t_i = (cos φ_i, sin φ_i), and e_i = (sin φ_i, -cos φ_i) its
axle (Eq. (28)). The generalized speeds are u = (s_1, ω_1): rolling speed of wheel 1 and angular
velocity of link 1 (Eq. (29)).

The functions are in `snake_terms`, `snake_speeds`, `snake_chain` and `snake_energies`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.mechanics import plane
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import (
    OfLinks,
    number_of_links,
    of_joints,
    of_links,
    parameter,
    stretched,
)
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.mechanics.tree import Tree, planar_tree
from eomcheck.numbers.generic import Arithmetic, Array
from eomcheck.numbers.pivots import EPS
from eomcheck.scenes import snake_chain, snake_energies, snake_speeds, snake_terms

OF_JOINTS = ("stiffness", "damping")
"""The parameters of which every joint has one."""


PARTS = snake_terms, snake_speeds, snake_chain, snake_energies


class Snake(OfLinks, functions=PARTS):
    """An N-link wheeled snake, N >= 1; the paper's robot has N = 7.

    For i >= 2 the generalized speeds (`ml`, `kane`) do not exist where a wheel stands at ±π/2
    against its link, nor for i <= N-2 the paper's partition (`el`, `em`).
    """

    mass: Any = parameter("m", "kg", "> 0", (0.1, 10.0), of_links)
    length: Any = parameter("L", "m", "> 0", (0.1, 10.0), of_links)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (0.01, 10.0), of_links)
    stiffness: Any = parameter("K", "N m/rad", "", (0.0, 1e4, None), of_joints)
    wheel_angle: Any = parameter("α to links", "rad", "", (-1.0, 1.0), of_links, read=False)
    pose: Any = parameter("θ at t = 0", "rad", shape=of_links, default=stretched, read=False)
    damping: Any = parameter("", "N m s/rad", ">= 0", (0.0, 100.0, None), of_joints, default=None)

    key = "snake"
    one_mass_each = "a snake has at least 1 link, one mass each"
    conserves_energy = True
    usually_absent = frozenset({"damping"})
    angle_coordinates = slice(2, None)

    def __post_init__(self):
        links = self.counted_links()
        for name in OF_JOINTS:
            if links == 1 and np.size(getattr(self, name)) == 0:
                object.__setattr__(self, name, None)
        self.check_fields(links)
        if self.damping is not None:
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers in the joints take it")

    @classmethod
    def paper(cls) -> Snake:
        """Return the seven-link robot of Sec. 11 with the digits printed there."""
        alpha = [0.0175, 0.0349, 0.0524, 0.0698, 0.0873, 0.1047, 0.1222]
        theta = [0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]
        return cls([1.0] * 7, [1.0] * 7, [0.0833] * 7, [5000.0] * 6, alpha, theta)

    @classmethod
    def example(cls) -> Snake:
        """Return the paper's robot."""
        return cls.paper()

    @classmethod
    def coil(cls, links: int) -> Snake:
        """Return the paper's robot with any number of links, α_i = 7° i/N, coiled by 308°.

        At N = 7 these are the paper's angles up to its rounding.
        """
        return cls._uniform(links, 7.0 / number_of_links(links))

    @classmethod
    def pattern(cls, links: int) -> Snake:
        """Return the literal continuation of the paper's angles, α_i = i° and θ_i = 44° i.

        Wheels turn against their links along the chain: near i = 90 they stand across it.
        """
        return cls._uniform(number_of_links(links), 1.0)

    @classmethod
    def _uniform(cls, links: int, degrees: float) -> Snake:
        one = np.ones(links)
        alpha = np.radians(degrees) * np.arange(1, links + 1)
        return cls(one, one, 0.0833 * one, 5000.0 * one[1:], alpha, 44.0 * alpha)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Snake]:
        """Yield a coiled snake; if it has joints, with and without springs, dampers, both."""
        coil = cls.coil(number_of_links(links))
        yield coil
        if coil.links > 1:
            yield replace(coil, stiffness=None)
            yield replace(coil, damping=np.ones(coil.links - 1))
            yield replace(coil, stiffness=None, damping=np.ones(coil.links - 1))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return what ordinary snakes are drawn from; what a seed draws depends on the order."""
        found = super().ranges(links)
        found["wheel_angle"] = found.pop("wheel_angle")
        return found

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`, the tip of link 1 at the origin."""
        return np.concatenate(([0.0, 0.0], self.pose)), np.zeros(self.n)

    def __repr__(self) -> str:
        values = {name: getattr(self, name) for name in self.declared}
        if not self.pose.any():
            del values["pose"]
        if self.damping is None:
            del values["damping"]
        listed = (f"{k}={None if v is None else v.tolist()}" for k, v in values.items())
        return f"{type(self).__name__}({', '.join(listed)})"

    @property
    def n(self) -> int:
        """N + 2 coordinates."""
        return self.links + 2

    @property
    def r(self) -> int:
        """N constraints, one per wheel."""
        return self.links

    @property
    def s(self) -> int:
        """2 N quasi-velocities, two per link."""
        return 2 * self.links

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """x, y, θ_1 .. θ_N."""
        return ("x", "y", *(f"θ_{i + 1}" for i in range(self.links)))

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """wheel 1 .. wheel N."""
        return tuple(f"wheel {i + 1}" for i in range(self.links))

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return cosines and sines of the wheels' angles (N,)."""
        wheel = arithmetic.angles(self.wheel_angle)
        return {"cos_alpha": wheel.cos, "sin_alpha": wheel.sin}

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |cos α_i| <= 4 eps for i >= 2: the recursion divides by it.

        The double nearest to π/2 has the cosine 6e-17, so "exactly" needs this margin.
        """
        cosine = np.abs(np.cos(self.wheel_angle))
        cosine[0] = 1.0
        worst = int(np.argmin(cosine))
        if cosine[worst] <= 4 * EPS:
            raise RefusedError(
                "cos α",
                float(cosine[worst]),
                4 * EPS,
                f"wheel_angle[{worst}] = {float(self.wheel_angle[worst])!r} stands across its "
                f"link: generalized speeds (s_1, ω_1) need |cos α_i| > {4 * EPS:.2g} for i >= 2",
            )

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, a translation and the mirror image in the x axis."""
        yield plane.rotation(self, q, v, slice(2, None))
        yield plane.translation(self, q, v)
        yield plane.mirror(replace(self, wheel_angle=-self.wheel_angle), q, v, kept=(0,))

    def tree(self) -> Tree:
        """Return PX, PY and RZ for link 1, then RZ in the joints: relative angles."""
        n, none = self.n, np.zeros(2)
        offset, center = np.zeros((2, n, 3))
        offset[3:, 0], center[2:, 0] = self.length[:-1], self.length / 2
        coordinates = np.eye(n)
        coordinates[2:, 2:] -= np.eye(self.links, k=-1)
        return planar_tree(
            parent=tuple(range(-1, n - 1)),
            joint=("px", "py", *["rz"] * self.links),
            offset=offset,
            mass=np.r_[none, self.mass],
            center=center,
            inertia=np.r_[none, self.inertia],
            coordinates=coordinates,
        )

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Snake, Array]:
        """Return a snake whose wheels are seen to be turned."""
        scene = cls.paper() if links is None else cls.coil(number_of_links(links))
        angle = np.full(scene.links, 0.35)
        pose = 0.45 + 2.4 / scene.links * np.arange(scene.links)
        return replace(scene, wheel_angle=angle), np.r_[0.9, 0.7, pose] * scene.length.mean()

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return links from the free tip on, and a wheel across each axle."""
        x, y, *theta = q
        size = self.length.mean()
        parts, at = [*draw.fixed_axes(0.5 * size), *draw.place(x, y), draw.Trail(q[:2])], q[:2]
        for i, angle in enumerate(theta):
            end = at + self.length[i] * draw.direction(angle)
            wheel, middle = angle + self.wheel_angle[i], (at + end) / 2
            parts += [
                draw.Body((at, end), f"link {i + 1}"),
                draw.Joint(at) if i else draw.Joint(at, name="head"),
            ]
            parts += [draw.Wheel(middle, draw.direction(wheel), 0.3 * size), draw.Center(middle)]
            parts += [draw.Constraint(f"wheel {i + 1}", middle, (i,))]
            parts += [draw.turned_by(f"θ_{i + 1}", at, angle, 0.32 * size)]
            if i == 0:
                turn = self.wheel_angle[i]
                parts += [draw.turned_by("α_1", middle, turn, 0.3 * size, start=angle)]
            at = end
        return draw.Sketch(tuple(parts))
