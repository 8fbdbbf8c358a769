"""Bricard's mechanism: six hinges in a ring, rigid by the count of constraints, yet movable.

Five rods and the ground, all of one length, form a ring; the hinges at the ends of each are
perpendicular to it and to each other. With all coordinates

    q = [θ_2, θ_3, θ_4, θ_5, θ_1]

at zero the ring runs along six edges of a cube, from P_1 = 0 along x, -y, z, -x, y to P_6, whose
hinge closes it, and along the ground back. θ_k turns the rods from the k-th on about the hinge at
P_k. There is gravity along -y.

The ring is closed where the tip of rod 5 is at P_6 and its hinge there is along x: five equations
for five angles. Yet it moves: wherever all five hold they depend on each other. The number of rows
exceeds their rank, and no formulation that divides by a matrix of rank r can be given all of them.
One row is left out therefore: near the ring the other four imply it.

Source: A04 of the IFToMM benchmark library (Gonzalez et al. 2006); Bricard 1897.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.deprecated import old_attributes
from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.errors import InputError
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import diagonal, parameter
from eomcheck.mechanics.records import Range, Symmetry, full_turns
from eomcheck.numbers.generic import Arithmetic, Array

RODS = 5
NAMES = "θ_2", "θ_3", "θ_4", "θ_5", "θ_1"
AXIS, FIRST, SECOND = (1, 2, 0, 1, 2), (2, 0, 1, 2, 0), (0, 1, 2, 0, 1)
"""Hinge -> index of its axis on the previous rod, and of the two axes that it turns."""
ALONG, SENSE = SECOND, (1, -1, 1, -1, 1)
"""Rod -> index of its own axis that it is along, and the sense."""
X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def axis_vector(axis: int, x: Any) -> elements.Triple:
    """Return the vector of length x along an axis."""
    a, b, c = (x if i == axis else 0 for i in range(3))
    return a, b, c


def description(parameters):
    """Return the declarative description of the ring.

    In this order, with the first velocities dependent, elimination of the constraints divides by no
    small pivot during the motion, even where it cannot choose pivots (expressions).
    """
    mass, length = parameters.mass, parameters.length[0]
    ends = [axis_vector(ALONG[k], SENSE[k] * length) for k in range(RODS)]
    centers = [axis_vector(ALONG[k], SENSE[k] * length / 2) for k in range(RODS)]
    names = [GROUND, *(f"rod {k + 1}" for k in range(RODS))]
    links = [elements.Link(names[k + 1], mass[k], centers[k]) for k in range(RODS)]
    joints = [
        elements.Joint(
            f"θ_{k + 1}",
            "revolute",
            names[k],
            names[k + 1],
            origin=ends[k - 1] if k else elements.ORIGIN,
            axis=axis_vector(AXIS[k], 1),
        )
        for k in range(RODS)
    ]
    last, closing_point = names[-1], (0, 0, length)

    def tip(name, axis):
        points = (last, ends[-1]), (GROUND, closing_point)
        return elements.Constraint("on-plane", name, points, ((GROUND, axis),))

    closing = [
        tip("tip along y", Y),
        elements.perpendicular("hinge along y", last, X, GROUND, Y),
        tip("tip along z", Z),
        tip("tip along x", X),
    ]
    if parameters.redundant is not None:
        more = elements.perpendicular("hinge along z", last, X, GROUND, Z)
        closing += [more._replace(factor=parameters.redundant[0])]
    down = (0, -parameters.gravity[0], 0)
    return Description(links, joints, NAMES, closing, gravity=down)


# ---- The scene -----------------------------------------------------------------------------------


@old_attributes
class Bricard(Described, description=description, closed=True):
    """Bricard's mechanism, by default slender rods of 1 m and 1 kg, released along a cube's edges.

    About its own axis a rod has no moment of inertia. `angle` must have a sine above -1/2: below it
    the ring is open, and at -1/2, where it closes, the other angles turn infinitely fast. With
    `redundant`, the row that the others imply is added, multiplied by this factor: no formulation
    can then solve where the ring is closed.
    """

    mass: Any = parameter("of rods", "kg", "> 0", (0.1, 10.0), (5,), default=(1.0,) * RODS)
    across: Any = parameter(
        "I, central, across",
        "kg m²",
        "> 0",
        (0.01, 10.0),
        (5,),
        default=(1.0 / 12.0,) * RODS,
        read=False,
    )
    length: Any = parameter("of rods and ground", "m", "> 0", (0.1, 10.0), default=1.0)
    gravity: Any = parameter("g, along -y", "m/s²", ">= 0", (0.0, 20.0), default=9.81)
    angle: Any = parameter("θ_1 = θ_3 = θ_5 at t = 0", "rad", default=0.0, read=False)
    rate: Any = parameter("at which they turn at t = 0", "rad/s", default=0.0, read=False)
    redundant: Any = parameter("factor of the last row", "1", default=None, optional=True)

    key = "bricard"
    named_coordinates = NAMES
    coordinate_sample_ranges = (Range(-0.2, 0.4),) * RODS
    conserves_energy = True
    angle_coordinates = slice(0, None)
    usually_absent = frozenset({"redundant"})

    def __post_init__(self):
        self.check_fields()
        if np.sin(self.angle) <= -0.5:
            raise InputError(f"angle = {self.angle}, expected a sine above -1/2: the ring is open")

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the rows: tip y, hinge y, tip z and x; if added, the redundant hinge row."""
        names = "tip along y", "hinge along y", "tip along z", "tip along x"
        return names if self.redundant is None else (*names, "hinge along z")

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return the inertia about the centres of mass, along axes of the rods (5, 3, 3), kg m²."""
        moments = np.repeat(arithmetic.numbers(self.across)[:, None], 3, axis=1)
        moments[range(RODS), ALONG] = 0
        return {"inertia": diagonal(moments)}

    def closed_state(self, angle: float, rate: float) -> tuple[Array, Array]:
        """Return the state (q, v) with θ_1 = θ_3 = θ_5 = `angle`, turning at `rate`.

        The ring keeps its threefold symmetry: with a = θ_1 and b = θ_2 = θ_4 it is closed where
        sin a + sin b + sin a sin b = 0.
        """
        one_plus_sine = 1.0 + np.sin(angle)
        b = -np.arcsin(np.sin(angle) / one_plus_sine)
        b_rate = -np.cos(angle) / (one_plus_sine**2 * np.cos(b)) * rate
        q, v = np.full(RODS, float(angle)), np.full(RODS, float(rate))
        q[[0, 2]], v[[0, 2]] = b, b_rate
        return q, v

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of the ring closed at `angle`, turning at `rate`."""
        return self.closed_state(float(self.angle), float(self.rate))

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation by 2π about every hinge, which changes nothing."""
        yield full_turns(self, q, v)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Bricard, Array]:
        """Return the ring turned away from the cube."""
        scene = cls(angle=0.5)
        return scene, scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return rods and hinges from P_1 to P_6, and the ground from P_6 back to P_1."""
        length, point, previous_axes = float(self.length), np.zeros(3), np.eye(3)
        frames = self.frames(q)
        parts: list[draw.Part] = [*draw.fixed_axes(0.3 * length, 3)]
        for k in range(RODS):
            axes = frames[f"rod {k + 1}"][1]
            end = point + SENSE[k] * length * axes[ALONG[k]]
            parts += [draw.Body((point, end), f"rod {k + 1}"), draw.Center((point + end) / 2)]
            parts += [draw.JointMark(point, k == 0, f"P_{k + 1}", axis=axes[AXIS[k]])]
            zero = SENSE[k] * previous_axes[SECOND[k]]
            quarter_turn = -SENSE[k] * previous_axes[FIRST[k]]
            turn = q[NAMES.index(f"θ_{k + 1}")]
            parts += [draw.Angle(f"θ_{k + 1}", point, zero, quarter_turn, turn, 0.4 * length)]
            point, previous_axes = end, axes
        parts += [
            draw.JointMark(point, True, "P_6", axis=np.array([1.0, 0.0, 0.0])),
            draw.Trail(point / 2),
        ]
        parts += [draw.ConstraintMark("the ring closes", point, tuple(range(self.r)))]
        # The rows of the tip, see `constraint_names`; those of the hinge transmit a moment.
        parts += [draw.Closing(point, np.array([0.0, 0.0, length]), (0, 2, 3))]
        corner = length * np.array([0.0, -0.75, 0.0])
        parts += [draw.Arrow("g", corner, np.array([0.0, -0.3 * length, 0.0]), frame=False)]
        return draw.Sketch(tuple(parts), azimuth=0.6, elevation=0.35, up=1)
