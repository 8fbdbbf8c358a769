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
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.assembled import Assembled, Jacobians
from eomcheck.mechanics.parameters import Parametric, parameter, whole_links
from eomcheck.mechanics.records import Range, Symmetry, Tree
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic


class Parameters(NamedTuple):
    """The parameters of a `FourBarChain` in some kind of number; bodies in the order of q."""

    mass: Any
    """(2N+1,), kg."""
    inertia: Any
    """About the centres of mass (2N+1, 1, 1), kg m²."""
    length: Any
    """(2N+1,), m."""
    gravity: Any
    """g (1,), m/s², or None."""
    repeated: Any
    """How many times the last row of the constraints there is a further row (1,), or None."""


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Angles` of the links."""
    return arithmetic.angles(q)


# ---- How the links move --------------------------------------------------------------------------


@generic
def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: a rod moves the coupler that starts at its tip by its length."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    bodies = cos.size
    windows = bodies // 2
    linear = np.zeros((bodies, 2, bodies), cos.dtype)
    angular = np.zeros((bodies, 1, bodies), cos.dtype)
    rest, angular_rest = np.zeros((bodies, 2), cos.dtype), np.zeros((bodies, 1), cos.dtype)
    for i in range(bodies):
        x, y = length[i] * cos[i] / 2, length[i] * sin[i] / 2
        angular[i, 0, i] = 1
        linear[i, 0, i], linear[i, 1, i] = -y, x
        rest[i, 0], rest[i, 1] = -x * v[i] * v[i], -y * v[i] * v[i]
    for k in range(windows):
        before, coupler = k - 1, windows + k
        x, y = length[before] * cos[before], length[before] * sin[before]
        linear[coupler, 0, before], linear[coupler, 1, before] = -y, x
        rest[coupler, 0] -= x * v[before] * v[before]
        rest[coupler, 1] -= y * v[before] * v[before]
    return Jacobians(linear, angular, rest, angular_rest, None)


@generic
def weights(gravity, mass, length, cos):
    """Return Q (2N+1,) of gravity, or None without it."""
    if gravity is None:
        return None
    bodies = cos.size
    windows = bodies // 2
    Q = np.zeros(bodies, cos.dtype)
    for i in range(bodies):
        Q[i] = -gravity[0] * mass[i] * length[i] * cos[i] / 2
    for k in range(windows):
        before = k - 1
        Q[before] -= gravity[0] * mass[windows + k] * length[before] * cos[before]
    return Q


@generic
def forces(parameters, angles, q, v):
    """Return Q (2N+1,), or None."""
    return weights(parameters.gravity, parameters.mass, parameters.length, angles.cos)


# ---- What closes the windows ---------------------------------------------------------------------


@generic
def with_repeated(rows, repeated):
    """Return rows (k, m) and, unless `repeated` is None, the last one once more, multiplied."""
    if repeated is None:
        return rows
    count, columns = rows.shape
    more = np.zeros((count + 1, columns), rows.dtype)
    more[:count] = rows
    for j in range(columns):
        more[count, j] = repeated[0] * rows[count - 1, j]
    return more


@generic
def constraints(parameters, angles, q):
    """Return (a (r, 2N+1), None): rows 2k and 2k+1 are the rate of window k along x and y."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    bodies = cos.size
    windows = bodies // 2
    a = np.zeros((2 * windows, bodies), cos.dtype)
    for k in range(windows):
        before, coupler = k - 1, windows + k
        a[2 * k, before] = -length[before] * sin[before]
        a[2 * k + 1, before] = length[before] * cos[before]
        a[2 * k, coupler] = -length[coupler] * sin[coupler]
        a[2 * k + 1, coupler] = length[coupler] * cos[coupler]
        a[2 * k, k] = length[k] * sin[k]
        a[2 * k + 1, k] = -length[k] * cos[k]
    return with_repeated(a, parameters.repeated), None


@generic
def drift(parameters, angles, q, v):
    """Return gamma (r,): the links' centripetal accelerations around each window."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    bodies = cos.size
    windows = bodies // 2
    gamma = np.zeros((2 * windows, 1), v.dtype)
    for k in range(windows):
        before, coupler = k - 1, windows + k
        first = length[before] * v[before] * v[before]
        across = length[coupler] * v[coupler] * v[coupler]
        last = length[k] * v[k] * v[k]
        gamma[2 * k, 0] = last * cos[k] - first * cos[before] - across * cos[coupler]
        gamma[2 * k + 1, 0] = last * sin[k] - first * sin[before] - across * sin[coupler]
    gamma = with_repeated(gamma, parameters.repeated)
    return gamma.reshape(gamma.size)


@generic
def position_residual(parameters, angles, q):
    """Return by how much each window does not close (r,), m; the ground is as long as couplers."""
    length, cos, sin = parameters.length, angles.cos, angles.sin
    bodies = cos.size
    windows = bodies // 2
    gap = np.zeros((2 * windows, 1), q.dtype)
    for k in range(windows):
        before, coupler = k - 1, windows + k
        gap[2 * k, 0] = (
            length[before] * cos[before] + length[coupler] * (cos[coupler] - 1) - length[k] * cos[k]
        )
        gap[2 * k + 1, 0] = (
            length[before] * sin[before] + length[coupler] * sin[coupler] - length[k] * sin[k]
        )
    gap = with_repeated(gap, parameters.repeated)
    return gap.reshape(gap.size)


# ---- The second derivation: positions and velocities only ----------------------------------------


@generic
def tip_velocity(parameters, angles, v, i):
    """Return the velocity (x, y) of the far end of link i against its near end, m/s."""
    speed = parameters.length[i] * v[i]
    return -speed * angles.sin[i], speed * angles.cos[i]


@generic
def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (2N+1, 2) and of rotation (2N+1, 1)."""
    bodies = v.size
    windows = bodies // 2
    V = np.zeros((bodies, 2), v.dtype)
    for i in range(bodies):
        x, y = tip_velocity(parameters, angles, v, i)
        V[i, 0], V[i, 1] = x / 2, y / 2
    for k in range(windows):
        x, y = tip_velocity(parameters, angles, v, k - 1)
        V[windows + k, 0] += x
        V[windows + k, 1] += y
    return V, v.reshape(bodies, 1)


@generic
def constraint(parameters, angles, q, v):
    """Return c (r,), m/s: how the end of each coupler moves against the tip of its second rod."""
    bodies = v.size
    windows = bodies // 2
    c = np.zeros((2 * windows, 1), v.dtype)
    for k in range(windows):
        x_1, y_1 = tip_velocity(parameters, angles, v, k - 1)
        x_2, y_2 = tip_velocity(parameters, angles, v, windows + k)
        x_3, y_3 = tip_velocity(parameters, angles, v, k)
        c[2 * k, 0], c[2 * k + 1, 0] = x_1 + x_2 - x_3, y_1 + y_2 - y_3
    c = with_repeated(c, parameters.repeated)
    return c.reshape(c.size)


@generic
def height_energy(gravity, mass, length, sin):
    """Return U = g Σ m y, J, or None without gravity."""
    if gravity is None:
        return None
    bodies = sin.size
    windows = bodies // 2
    U = 0
    for i in range(bodies):
        U += gravity[0] * mass[i] * length[i] * sin[i] / 2
    for k in range(windows):
        before = k - 1
        U += gravity[0] * mass[windows + k] * length[before] * sin[before]
    return U


@generic
def potential(parameters, angles, q):
    """Return U, J, or None."""
    return height_energy(parameters.gravity, parameters.mass, parameters.length, angles.sin)


# ---- The scene -----------------------------------------------------------------------------------


def of_bodies(windows: int) -> tuple[int, ...]:
    """Return the shape of what every rod and every coupler has one of."""
    return (2 * windows + 1,)


@dataclass(frozen=True, eq=False, repr=False)
class FourBarChain(Parametric, Assembled, functions=globals()):
    """N four-bar linkages side by side, N >= 1: closed loops through singular poses.

    Args:
        mass: of rods 1 .. N, couplers 1 .. N and rod 0 (2N+1,), kg, positive.
        inertia: of the same about their centres of mass (2N+1,), kg m², not negative.
        length: of the rods, m, positive.
        span: of the couplers and of the ground between two rods, m, positive.
        gravity: g, m/s², not negative, along -y, or None without.
        angle: of all rods at t = 0, rad.
        rate: at which they turn at t = 0, rad/s.
        repeated: repeat the last row of the constraints so many times over, or None. The rows then
            depend on each other at every state.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    mass: Any = parameter(sign="positive", shape=of_bodies, drawn=Range(0.1, 10.0))
    inertia: Any = parameter(sign="not negative", shape=of_bodies, drawn=Range(0.01, 10.0))
    length: Any = parameter(1.0, "positive", drawn=Range(0.1, 10.0))
    span: Any = parameter(1.0, "positive", drawn=Range(0.1, 10.0))
    gravity: Any = parameter(9.81, "not negative", drawn=Range(0.0, 20.0, optional=True))
    angle: Any = parameter(np.pi / 2)
    rate: Any = parameter(-1.0)
    repeated: Any = parameter(None, optional=True)

    key = "four-bar-chain"
    conserves_energy = True
    has_links = True
    angle_coordinates = slice(0, None)

    def __post_init__(self):
        bodies = np.size(self.mass)
        if np.ndim(self.mass) != 1 or bodies < 3 or bodies % 2 == 0:
            raise InputError(f"mass = {self.mass!r}: N >= 1 windows have 2N+1 links, one mass each")
        self.check_fields(bodies // 2)

    @classmethod
    def rods(cls, windows: int) -> FourBarChain:
        """Return the benchmark: slender rods of 1 m and 1 kg, upright, tips moving at 1 m/s."""
        one = np.ones(2 * whole_links(windows, "windows") + 1)
        return cls(one, one / 12)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[FourBarChain]:
        """Yield the benchmark with `links` windows, and the same without gravity."""
        rods = cls.rods(whole_links(links))
        yield rods
        yield replace(rods, gravity=None)

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return rods within 0.5 rad of upright and couplers within 0.1 rad of horizontal."""
        rod, coupler = Range(1.1, 2.1), Range(-0.1, 0.1)
        return (*[rod] * self.windows, *[coupler] * self.windows, rod)

    @property
    def links(self) -> int:
        """N: what kinds of scenes that have a number of links to choose call it."""
        return self.windows

    @property
    def windows(self) -> int:
        """N."""
        return self.mass.size // 2

    @property
    def name(self) -> str:
        """four-bar-chain[N]."""
        return f"{self.key}[{self.windows}]"

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

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        number = arithmetic.numbers
        length, span = number(self.length.reshape(1)), number(self.span.reshape(1))
        rods, couplers = [length] * self.windows, [span] * self.windows
        return self.in_numbers(
            arithmetic,
            Parameters,
            inertia=number(self.inertia.reshape(-1, 1, 1)),
            length=np.concatenate((*rods, *couplers, length)),
        )

    def initial_state(self) -> tuple[Array, Array]:
        """Return all rods at `angle`, turning at `rate`, couplers horizontal."""
        q, v = np.zeros(self.n), np.zeros(self.n)
        is_rod = np.ones(self.n, dtype=bool)
        is_rod[self.windows : 2 * self.windows] = False
        q[is_rod], v[is_rod] = self.angle, self.rate
        return q, v

    def compound(self) -> tuple[float, float]:
        """Return (moment of inertia, kg m²; first moment of mass, kg m) of it as one pendulum.

        Rods turn about their feet and couplers only travel, with the tips of the rods.
        """
        is_rod = np.ones(self.n, dtype=bool)
        is_rod[self.windows : 2 * self.windows] = False
        rods, couplers = self.mass[is_rod].sum(), self.mass[~is_rod].sum()
        about_feet = self.inertia[is_rod].sum() + (rods / 4 + couplers) * self.length**2
        return float(about_feet), float((rods / 2 + couplers) * self.length)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield one turn of every link by 2π, which changes nothing."""
        yield Symmetry("full turns", self, q + 2.0 * np.pi, v, np.eye(self.n))

    def tree(self) -> Tree:
        """Return the windows cut open where couplers end: rod 0, coupler 1, rod 1, coupler 2 ..."""
        N = self.windows
        order = np.array([2 * N, *np.column_stack((range(N, 2 * N), range(N))).ravel()])
        axes, is_coupler = np.eye(self.n), np.arange(self.n) % 2 == 1
        offset, center = np.zeros((2, self.n, 3))
        offset[:, 0] = np.where(is_coupler, self.length, self.span * (np.arange(self.n) // 2))
        center[:, 0] = np.where(is_coupler, self.span, self.length) / 2
        return Tree(
            parent=tuple(j - 1 if coupler else -1 for j, coupler in enumerate(is_coupler)),
            joint=("rz",) * self.n,
            offset=offset,
            mass=self.mass[order],
            center=center,
            inertia=self.inertia[order],
            coordinates=axes[order] - is_coupler[:, None] * axes[np.roll(order, 1)],
        )
