"""Bricard's mechanism: six hinges in a ring that ought to be rigid, and is not.

Five rods and the ground, all of one length, form a ring; the hinges at the ends of each are
perpendicular to it and to each other. With all coordinates

    q = [θ_2, θ_3, θ_4, θ_5, θ_1]

at zero the ring runs along six edges of a cube, from P_1 = 0 along x, -y, z, -x, y to P_6, whose
hinge closes it, and along the ground back. θ_k turns the rods from the k-th on about the hinge at
P_k. There is gravity along -y.

The ring is closed where the tip of rod 5 is at P_6 and its hinge there is along x: five equations
for five angles. Yet it moves, for wherever all five hold they depend on each other. Count of rows
and rank tell different stories, and no formulation that divides by a matrix of rank r can be given
all of them. One row is left out therefore: near the ring the other four imply it.

Source: A04 of the IFToMM benchmark library (Gonzalez et al. 2006); Bricard 1897.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.assembled import Assembled, Jacobians, gyroscopic_moments
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.mechanics.space import along, cross, plane_of, rotated, swing, turn
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic

RODS = 5
COORDINATE = 4, 0, 1, 2, 3
"""Hinge -> its coordinate."""
AXIS, FIRST, SECOND = (1, 2, 0, 1, 2), (2, 0, 1, 2, 0), (0, 1, 2, 0, 1)
"""Hinge -> axis of the rod before that it is along, and the two that it turns into each other."""
ALONG, SENSE = SECOND, (1, -1, 1, -1, 1)
"""Rod -> axis of its own that it is along, and in which sense."""
LAST = RODS - 1
TIP, HINGE = (3, 0, 2), (1, 4)
"""Constraints on the tip along x, y, z, and on its hinge along y, z. Taken in this order, with the
first velocities dependent, elimination divides by nothing small all along the motion, also where it
cannot choose (expressions)."""


class Parameters(NamedTuple):
    """The parameters of a `Bricard` in some kind of number."""

    mass: Any
    """(5,), kg."""
    inertia: Any
    """About the centres of mass, along axes of the rods (5, 3, 3), kg m²."""
    length: Any
    """(1,), m."""
    gravity: Any
    """g (1,), m/s²."""
    redundant: Any
    """How many times the row that the others imply is taken (1,), or None without it."""


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Angles` of the hinges, in the order of q."""
    return arithmetic.angles(q)


# ---- How the rods move, along axes that do not turn ----------------------------------------------


class Pose(NamedTuple):
    """Where everything is, along x, y, z."""

    hinges: Any
    """Axes (5, 3)."""
    directions: Any
    """Axes of the rods (5, 3, 3)."""
    halves: Any
    """From the hinges to the centres of the rods (5, 3), m."""


@generic
def posed(parameters, angles):
    """Return the `Pose`."""
    cos, sin = angles.cos, angles.sin
    hinges, halves = np.zeros((RODS, 3), cos.dtype), np.zeros((RODS, 3), cos.dtype)
    directions = np.zeros((RODS, 3, 3), cos.dtype)
    frame = np.zeros((3, 3), cos.dtype)
    for i in range(3):
        frame[i, i] = 1
    for k in range(RODS):
        j = COORDINATE[k]
        hinges[k] = frame[AXIS[k]]
        first, second = plane_of(frame[FIRST[k]], frame[SECOND[k]], cos[j], sin[j])
        frame[FIRST[k]], frame[SECOND[k]] = first, second
        directions[k] = frame
        for i in range(3):
            halves[k, i] = SENSE[k] * parameters.length[0] / 2 * frame[ALONG[k], i]
    return Pose(hinges, directions, halves)


@generic
def columns(pose, k, share):
    """Return how the point `share` halves down rod k moves with q̇ (3, 5)."""
    J, arm = np.zeros((3, RODS), pose.halves.dtype), share * pose.halves[k]
    for back in range(k + 1):
        j = k - back
        J[:, COORDINATE[j]] = cross(pose.hinges[j], arm)
        arm = arm + 2 * pose.halves[j - 1]
    return J


@generic
def turning(pose, v):
    """Return ω of the rods (5, 3) and ω̇ at v̇ = 0 (5, 3), along x, y, z."""
    omega, alpha = np.zeros((RODS, 3), v.dtype), np.zeros((RODS, 3), v.dtype)
    for k in range(RODS):
        for j in range(k + 1):
            turn(omega[k], alpha[k], pose.hinges[j], v[COORDINATE[j]])
    return omega, alpha


@generic
def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: V along x, y, z, ω along axes of the rods."""
    pose = posed(parameters, angles)
    omega, alpha = turning(pose, v)
    linear = np.zeros((RODS, 3, RODS), v.dtype)
    turned, angular = np.zeros((RODS, 3, RODS), v.dtype), np.zeros((RODS, 3, RODS), v.dtype)
    rest, before = np.zeros((RODS, 3), v.dtype), np.zeros(3, v.dtype)
    for k in range(RODS):
        linear[k] = columns(pose, k, 1)
        for j in range(k + 1):
            turned[k, :, COORDINATE[j]] = pose.hinges[j]
        swung = swing(omega[k], alpha[k], pose.halves[k])
        rest[k] = before + swung
        before = rest[k] + swung
    for j in range(RODS):
        angular[:, :, j] = along(pose.directions, turned[:, :, j])
    gyroscopic = gyroscopic_moments(parameters.inertia, along(pose.directions, omega))
    return Jacobians(linear, angular, rest, along(pose.directions, alpha), gyroscopic)


@generic
def with_redundant(rows, redundant):
    """Return four of rows (5, m) and, unless `redundant` is None, the last, so many times."""
    if redundant is None:
        return np.ascontiguousarray(rows[:4])
    more = rows + 0
    for j in range(rows.shape[1]):
        more[4, j] = redundant[0] * rows[4, j]
    return more


@generic
def constraints(parameters, angles, q):
    """Return (a (r, 5), None): rows are velocities of the tip, and how its hinge tilts."""
    pose = posed(parameters, angles)
    a = np.zeros((5, RODS), q.dtype)
    moved, hinge = columns(pose, LAST, 2), pose.directions[LAST, 0]
    for i in range(3):
        a[TIP[i]] = moved[i]
    for k in range(RODS):
        tilted = cross(pose.hinges[k], hinge)
        for i in range(2):
            a[HINGE[i], COORDINATE[k]] = tilted[1 + i]
    return with_redundant(a, parameters.redundant), None


@generic
def drift(parameters, angles, q, v):
    """Return gamma (r,): centripetal accelerations of the tip and of its hinge."""
    pose = posed(parameters, angles)
    omega, alpha = turning(pose, v)
    gamma = np.zeros((5, 1), v.dtype)
    for k in range(RODS):
        swung = swing(omega[k], alpha[k], pose.halves[k])
        for i in range(3):
            gamma[TIP[i], 0] += 2 * swung[i]
    tilted = swing(omega[LAST], alpha[LAST], pose.directions[LAST, 0])
    for i in range(2):
        gamma[HINGE[i], 0] = tilted[1 + i]
    gamma = with_redundant(gamma, parameters.redundant)
    return gamma.reshape(gamma.size)


@generic
def forces(parameters, angles, q, v):
    """Return Q (5,) of gravity."""
    pose = posed(parameters, angles)
    Q = np.zeros(RODS, q.dtype)
    for k in range(RODS):
        J = columns(pose, k, 1)
        for j in range(RODS):
            Q[j] -= parameters.gravity[0] * parameters.mass[k] * J[1, j]
    return Q


# ---- The second derivation: from rod to rod, along axes that turn --------------------------------


@generic
def level(angles, k, vector):
    """Return the components along x, y, z of a vector (3,) along axes of rod k."""
    result = vector + 0
    for back in range(k + 1):
        i = k - back
        j = COORDINATE[i]
        rotated(result, FIRST[i], SECOND[i], angles.cos[j], -angles.sin[j])
    return result


@generic
def half(parameters, k):
    """Return half of rod k (3,), along its own axes, m."""
    rod = np.zeros(3, parameters.length.dtype)
    rod[ALONG[k]] += SENSE[k] * parameters.length[0] / 2
    return rod


@generic
def moving(parameters, angles, v):
    """Return V of the centres and of the far ends (5, 3) and ω (5, 3), along axes of the rods."""
    centers, ends = np.zeros((RODS, 3), v.dtype), np.zeros((RODS, 3), v.dtype)
    omega, V, rate = np.zeros((RODS, 3), v.dtype), np.zeros(3, v.dtype), np.zeros(3, v.dtype)
    for k in range(RODS):
        j = COORDINATE[k]
        rotated(V, FIRST[k], SECOND[k], angles.cos[j], angles.sin[j])
        rotated(rate, FIRST[k], SECOND[k], angles.cos[j], angles.sin[j])
        rate[AXIS[k]] += v[j]
        swept = cross(rate, half(parameters, k))
        omega[k], centers[k], ends[k] = rate, V + swept, V + 2 * swept
        V = ends[k] + 0
    return centers, ends, omega


@generic
def velocities(parameters, angles, q, v):
    """Return V of the centres (5, 3) along x, y, z and ω (5, 3) along axes of the rods."""
    centers, _, omega = moving(parameters, angles, v)
    V = np.zeros((RODS, 3), v.dtype)
    for k in range(RODS):
        V[k] = level(angles, k, centers[k])
    return V, omega


@generic
def placed(parameters, angles):
    """Return the centres and the far ends of the rods (5, 3), along x, y, z, m."""
    centers, ends = np.zeros((RODS, 3), angles.cos.dtype), np.zeros((RODS, 3), angles.cos.dtype)
    point = np.zeros(3, angles.cos.dtype)
    for k in range(RODS):
        ahead = level(angles, k, half(parameters, k))
        centers[k], ends[k] = point + ahead, point + 2 * ahead
        point = ends[k]
    return centers, ends


@generic
def potential(parameters, angles, q):
    """Return U, J."""
    centers, _ = placed(parameters, angles)
    U = 0
    for k in range(RODS):
        U += parameters.gravity[0] * parameters.mass[k] * centers[k, 1]
    return U


@generic
def constraint(parameters, angles, q, v):
    """Return c (r,): velocity of the tip, m/s, and rate of the direction of its hinge, rad/s."""
    _, ends, omega = moving(parameters, angles, v)
    c = np.zeros((5, 1), v.dtype)
    tip = level(angles, LAST, ends[LAST])
    # ω × x
    tilting = np.zeros(3, v.dtype)
    tilting[1], tilting[2] = omega[LAST, 2], -omega[LAST, 1]
    tilted = level(angles, LAST, tilting)
    for i in range(3):
        c[TIP[i], 0] = tip[i]
    for i in range(2):
        c[HINGE[i], 0] = tilted[1 + i]
    c = with_redundant(c, parameters.redundant)
    return c.reshape(c.size)


@generic
def position_residual(parameters, angles, q):
    """Return how far the tip is from P_6, m, and its hinge from x (r,)."""
    gap = np.zeros((5, 1), q.dtype)
    _, ends = placed(parameters, angles)
    tip = ends[LAST]
    hinge = np.zeros(3, q.dtype)
    hinge[0] += 1
    tilted = level(angles, LAST, hinge)
    for i in range(3):
        gap[TIP[i], 0] = tip[i]
    gap[TIP[2], 0] -= parameters.length[0]
    for i in range(2):
        gap[HINGE[i], 0] = tilted[1 + i]
    gap = with_redundant(gap, parameters.redundant)
    return gap.reshape(gap.size)


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Bricard(Parametric, Assembled, functions=globals()):
    """Bricard's mechanism, by default slender rods of 1 m and 1 kg, released along a cube's edges.

    Args:
        mass: of the rods (5,), kg, positive.
        across: moments of inertia of the rods about axes across them, about their centres of mass
            (5,), kg m², positive. About its own axis a rod has none.
        length: of rods and ground, m, positive.
        gravity: g, m/s², not negative, along -y.
        angle: θ_1 = θ_3 = θ_5 at t = 0, rad, with a sine above -1/2: below, the ring is open.
        rate: at which they turn at t = 0, rad/s.
        redundant: take the row that the others imply as well, so many times, or None. No
            formulation solves then where the ring is closed.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    mass: Any = parameter((1.0,) * RODS, "positive", (RODS,), drawn=Range(0.1, 10.0))
    across: Any = parameter((1.0 / 12.0,) * RODS, "positive", (RODS,), drawn=Range(0.01, 10.0))
    length: Any = parameter(1.0, "positive", drawn=Range(0.1, 10.0))
    gravity: Any = parameter(9.81, "not negative", drawn=Range(0.0, 20.0))
    angle: Any = parameter(0.0)
    rate: Any = parameter(0.0)
    redundant: Any = parameter(None, optional=True)

    key = "bricard"
    named_coordinates = "θ_2", "θ_3", "θ_4", "θ_5", "θ_1"
    conserves_energy = True
    angle_coordinates = slice(0, None)
    usually_absent = frozenset({"redundant"})

    def __post_init__(self):
        self.check_fields()
        if np.sin(self.angle) <= -0.5:
            raise InputError(f"angle = {self.angle}, expected a sine above -1/2: the ring is open")

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return poses around the cube, where closed ones are looked for."""
        return (Range(-0.2, 0.4),) * RODS

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The tip along y, its hinge along y, the tip along z and x; where taken, the hinge."""
        names = "tip along y", "hinge along y", "tip along z", "tip along x"
        return names if self.redundant is None else (*names, "hinge along z")

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        across = arithmetic.numbers(self.across)
        inertia = np.zeros((RODS, 3, 3), across.dtype)
        for k in range(RODS):
            for i in (FIRST[k], AXIS[k]):
                inertia[k, i, i] = across[k]
        return self.in_numbers(arithmetic, Parameters, inertia=inertia)

    def closed(self, angle: float, rate: float) -> tuple[Array, Array]:
        """Return (q, v) where θ_1 = θ_3 = θ_5 are `angle` and turn at `rate`.

        The ring keeps its threefold symmetry: with a = θ_1 and b = θ_2 = θ_4 it is closed where
        sin a + sin b + sin a sin b = 0.
        """
        stretched = 1.0 + np.sin(angle)
        other = -np.arcsin(np.sin(angle) / stretched)
        follows = -np.cos(angle) / (stretched**2 * np.cos(other)) * rate
        q, v = np.full(RODS, float(angle)), np.full(RODS, float(rate))
        q[[0, 2]], v[[0, 2]] = other, follows
        return q, v

    def initial_state(self) -> tuple[Array, Array]:
        """Return the ring closed at `angle`, turning at `rate`."""
        return self.closed(float(self.angle), float(self.rate))

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield one turn about every hinge by 2π, which changes nothing."""
        yield Symmetry("full turns", self, q + 2.0 * np.pi, v, np.eye(self.n))
