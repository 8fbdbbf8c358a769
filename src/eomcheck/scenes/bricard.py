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
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.gravity import height_energy, weights
from eomcheck.mechanics.linkage import with_row
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.plane import full_turns
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.mechanics.sketch import (
    Angle,
    Arrow,
    Body,
    Center,
    Constraint,
    Joint,
    Part,
    Sketch,
    Trail,
    fixed_axes,
)
from eomcheck.mechanics.space import (
    cross,
    diagonal,
    plane_of,
    rotated,
    spatial_jacobians,
    swing,
    turning,
)
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.float64 import FLOAT64

RODS = 5
COORDINATE = 4, 0, 1, 2, 3
"""Hinge -> its coordinate."""
TURNS = tuple((k, j, COORDINATE[j]) for k in range(RODS) for j in range(k + 1))
"""Rods with the hinges that turn them."""
AXIS, FIRST, SECOND = (1, 2, 0, 1, 2), (2, 0, 1, 2, 0), (0, 1, 2, 0, 1)
"""Hinge -> axis of the rod before that it is along, and the two that it turns into each other."""
ALONG, SENSE = SECOND, (1, -1, 1, -1, 1)
"""Rod -> axis of its own that it is along, and in which sense."""
LAST = RODS - 1
TIP, HINGE = (3, 0, 2), (1, 4)
"""Constraints on the tip along x, y, z, and on its hinge along y, z. Taken in this order, with the
first velocities dependent, elimination divides by nothing small all along the motion, also where it
cannot choose (expressions)."""


# ---- How the rods move, along axes that do not turn ----------------------------------------------


class Pose(NamedTuple):
    """Where everything is, along x, y, z."""

    hinges: Any
    """Axes (5, 3)."""
    directions: Any
    """Axes of the rods (5, 3, 3)."""
    halves: Any
    """From the hinges to the centres of the rods (5, 3), m."""


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


def columns(pose, k, share):
    """Return how the point `share` halves down rod k moves with q̇ (3, 5)."""
    J, arm = np.zeros((3, RODS), pose.halves.dtype), share * pose.halves[k]
    for back in range(k + 1):
        j = k - back
        J[:, COORDINATE[j]] = cross(pose.hinges[j], arm)
        arm = arm + 2 * pose.halves[j - 1]
    return J


def jacobians(parameters, angles, q, v):
    """Return the `Jacobians`: V along x, y, z, ω along axes of the rods."""
    pose = posed(parameters, angles)
    omega, alpha = turning(RODS, TURNS, pose.hinges, v)
    rest, before = np.zeros((RODS, 3), v.dtype), np.zeros(3, v.dtype)
    for k in range(RODS):
        swung = swing(omega[k], alpha[k], pose.halves[k])
        rest[k] = before + swung
        before = rest[k] + swung
    linear = np.array([columns(pose, k, 1) for k in range(RODS)], v.dtype)
    inertia = parameters.inertia
    return spatial_jacobians(inertia, pose.directions, linear, rest, TURNS, pose.hinges, v)


def with_redundant(rows, redundant):
    """Return four of rows (5, ...) and, unless `redundant` is None, the last, so many times."""
    return with_row(np.ascontiguousarray(rows[:4]), rows[4:], redundant)


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


def rows(tip, tilted):
    """Return what is said of the tip and of its hinge, each (3,), in the order of rows (5,)."""
    return np.array([tip[1], tilted[1], tip[2], tip[0], tilted[2]], tip.dtype)


def drift(parameters, angles, q, v):
    """Return gamma (r,): centripetal accelerations of the tip and of its hinge."""
    pose = posed(parameters, angles)
    omega, alpha = turning(RODS, TURNS, pose.hinges, v)
    tip = np.zeros(3, v.dtype)
    for k in range(RODS):
        tip = tip + 2 * swing(omega[k], alpha[k], pose.halves[k])
    tilted = swing(omega[LAST], alpha[LAST], pose.directions[LAST, 0])
    return with_redundant(rows(tip, tilted), parameters.redundant)


def forces(parameters, angles, q, v):
    """Return Q (5,) of gravity."""
    pose = posed(parameters, angles)
    upward = np.array([columns(pose, k, 1)[1] for k in range(RODS)], q.dtype)
    return weights(parameters.gravity, parameters.mass, upward)


# ---- The second derivation: from rod to rod, along axes that turn --------------------------------


def level(angles, k, vector):
    """Return the components along x, y, z of a vector (3,) along axes of rod k."""
    result = vector + 0
    for back in range(k + 1):
        i = k - back
        j = COORDINATE[i]
        rotated(result, FIRST[i], SECOND[i], angles.cos[j], -angles.sin[j])
    return result


def half(parameters, k):
    """Return half of rod k (3,), along its own axes, m."""
    rod = np.zeros(3, parameters.length.dtype)
    rod[ALONG[k]] += SENSE[k] * parameters.length[0] / 2
    return rod


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


def velocities(parameters, angles, q, v):
    """Return V of the centres (5, 3) along x, y, z and ω (5, 3) along axes of the rods."""
    centers, _, omega = moving(parameters, angles, v)
    V = np.zeros((RODS, 3), v.dtype)
    for k in range(RODS):
        V[k] = level(angles, k, centers[k])
    return V, omega


def placed(parameters, angles):
    """Return the centres and the far ends of the rods (5, 3), along x, y, z, m."""
    centers, ends = np.zeros((RODS, 3), angles.cos.dtype), np.zeros((RODS, 3), angles.cos.dtype)
    point = np.zeros(3, angles.cos.dtype)
    for k in range(RODS):
        ahead = level(angles, k, half(parameters, k))
        centers[k], ends[k] = point + ahead, point + 2 * ahead
        point = ends[k]
    return centers, ends


def potential(parameters, angles, q):
    """Return U, J."""
    heights = placed(parameters, angles)[0][:, 1]
    return height_energy(parameters.gravity, parameters.mass, heights)


def constraint(parameters, angles, q, v):
    """Return c (r,): velocity of the tip, m/s, and rate of the direction of its hinge, rad/s."""
    _, ends, omega = moving(parameters, angles, v)
    # ω × x
    tilting = np.array([0, omega[LAST, 2], -omega[LAST, 1]], v.dtype)
    tip, tilted = level(angles, LAST, ends[LAST]), level(angles, LAST, tilting)
    return with_redundant(rows(tip, tilted), parameters.redundant)


def position_residual(parameters, angles, q):
    """Return how far the tip is from P_6, m, and its hinge from x (r,)."""
    tip = placed(parameters, angles)[1][LAST]
    tip[2] -= parameters.length[0]
    hinge = np.array([1, 0, 0], q.dtype)
    return with_redundant(rows(tip, level(angles, LAST, hinge)), parameters.redundant)


# ---- The scene -----------------------------------------------------------------------------------


class Bricard(Parametric, functions=globals()):
    """Bricard's mechanism, by default slender rods of 1 m and 1 kg, released along a cube's edges.

    About its own axis a rod has no moment of inertia. Where sin `angle` is -1/2 or below, the ring
    is open. With `redundant`, the row that the others imply is taken as well, so many times: no
    formulation solves then where the ring is closed.
    """

    mass: Any = parameter("of rods", "kg", "> 0", (0.1, 10.0), (5,), default=(1.0,) * RODS)
    across: Any = parameter(
        *("I, central, across", "kg m²", "> 0", (0.01, 10.0), (5,)),
        default=(1.0 / 12.0,) * RODS,
        read=False,
    )
    length: Any = parameter("of rods and ground", "m", "> 0", (0.1, 10.0), default=1.0)
    gravity: Any = parameter("g, along -y", "m/s²", ">= 0", (0.0, 20.0), default=9.81)
    angle: Any = parameter("θ_1 = θ_3 = θ_5 at t = 0", "rad", default=0.0, read=False)
    rate: Any = parameter("at which they turn at t = 0", "rad/s", default=0.0, read=False)
    redundant: Any = parameter("factor of the last row", "1", default=None, optional=True)

    key = "bricard"
    named_coordinates = "θ_2", "θ_3", "θ_4", "θ_5", "θ_1"
    drawn_coordinates = (Range(-0.2, 0.4),) * RODS
    conserves_energy = True
    angle_coordinates = slice(0, None)
    usually_absent = frozenset({"redundant"})

    def __post_init__(self):
        self.check_fields()
        if np.sin(self.angle) <= -0.5:
            raise InputError(f"angle = {self.angle}, expected a sine above -1/2: the ring is open")

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """The tip along y, its hinge along y, the tip along z and x; where taken, the hinge."""
        names = "tip along y", "hinge along y", "tip along z", "tip along x"
        return names if self.redundant is None else (*names, "hinge along z")

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the inertia about the centres of mass, along axes of the rods (5, 3, 3), kg m²."""
        moments = np.repeat(arithmetic.numbers(self.across)[:, None], 3, axis=1)
        moments[range(RODS), ALONG] = 0
        return {"inertia": diagonal(moments)}

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
        yield full_turns(self, q, v)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Bricard, Array]:
        """Return the ring turned away from the cube."""
        scene = cls(angle=0.5)
        return scene, scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return rods and hinges from P_1 to P_6, and the ground from P_6 back to P_1."""
        length, at, before = float(self.length), np.zeros(3), np.eye(3)
        pose = posed(self.parameters(FLOAT64), FLOAT64.angles(q))
        parts: list[Part] = [*fixed_axes(0.3 * length, 3)]
        for k in range(RODS):
            end = at + 2 * pose.halves[k]
            parts += [Body((at, end), f"rod {k + 1}"), Center((at + end) / 2)]
            parts += [Joint(at, k == 0, f"P_{k + 1}", axis=pose.hinges[k])]
            level, across = SENSE[k] * before[SECOND[k]], -SENSE[k] * before[FIRST[k]]
            turn = q[COORDINATE[k]]
            parts += [Angle(f"θ_{k + 1}", at, level, across, turn, 0.4 * length)]
            at, before = end, pose.directions[k]
        parts += [Joint(at, True, "P_6", axis=np.array([1.0, 0.0, 0.0])), Trail(at / 2)]
        parts += [Constraint("the ring closes", at, tuple(range(self.r)))]
        corner = length * np.array([0.0, -0.75, 0.0])
        parts += [Arrow("g", corner, np.array([0.0, -0.3 * length, 0.0]), frame=False)]
        return Sketch(tuple(parts), azimuth=0.6, elevation=0.35, up=1)
