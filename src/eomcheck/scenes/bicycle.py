"""A bicycle without a rider's control: two wheels, a frame with its rider, a steerable front fork.

Whipple's model: knife-edged wheels roll without slipping. Its nine coordinates are those of
Basu-Mandal et al. 2007, in another order:

    q = [x, y, z, θ, φ, β_f, ψ, ψ_f, β_r].

(x, y, z) is the centre of the rear wheel, z up. θ, ψ and φ turn the rear frame about the vertical
k, the heading h and the axle of the rear wheel: h = (cos θ, sin θ, 0), upright is ψ = π/2. ψ_f
turns the fork about the steering axis, β_r and β_f the wheels about their axles. At θ = 0,
ψ = π/2, φ = π the bicycle stands upright and rolls with positive spins, against h: along -x.

Axes b_1, b_2, b_3 of the rear frame are then ahead, down and left; g_1, g_2, g_3 are those of the
front frame, the same at zero steering angle. Axles are along b_3 and g_3.

Constraints are along the heading, across it and up. Those up are holonomic, four are not. The last
three velocities, of leaning, of steering and of the rear wheel's spin, are the generalized speeds.

Source: Meijaard et al. 2007, whose benchmark gives the defaults; Basu-Mandal et al. 2007.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.errors import InputError, RefusedError
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import (
    ANY_ANGLE,
    ANYWHERE,
    Range,
    Symmetry,
    plane_mirror,
    plane_rotation,
    plane_translation,
)
from eomcheck.numbers.generic import EPS, Arithmetic, Array

REAR, FRAME, FORK, FRONT = range(4)
"""Indices of the bodies: rear wheel, rear frame with the rider, front frame, front wheel."""
HEIGHT, HEADING, PITCH, FRONT_SPIN, LEAN, STEER, REAR_SPIN = range(2, 9)
"""Indices of the coordinates z, θ, φ, β_f, ψ, ψ_f, β_r."""
NAMES = "x", "y", "z", "θ", "φ", "β_f", "ψ", "ψ_f", "β_r"
X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
AHEAD, LEFT, UP = ("heading", X), ("heading", Y), (GROUND, Z)
"""Links and their directions along which the constraints are."""


def description(parameters):
    """Return the declarative description of the bicycle.

    Frames that only lean or head somewhere have no mass. Points and inertia of the front frame are
    along the steering axis, see `derived`, so that nothing is turned back from it.
    """
    mass, (cos, sin) = parameters.mass, parameters.tilted
    pivot, hub = (*parameters.pivot, 0), (*parameters.hub, 0)
    seat = (cos, sin, 0), (-sin, cos, 0), (0, 0, 1)
    links = [
        elements.Link("rear wheel", mass[0]),
        elements.Link("rear frame", mass[1], (*parameters.rider, 0)),
        elements.Link("front frame", mass[2], (*parameters.fork, 0)),
        elements.Link("front wheel", mass[3]),
    ]
    joints = [
        elements.Joint("x", "prismatic", GROUND, "ahead", axis=X),
        elements.Joint("y", "prismatic", "ahead", "aside", axis=Y),
        elements.Joint("z", "prismatic", "aside", "above", axis=Z),
        elements.Joint("θ", "revolute", "above", "heading", axis=Z),
        elements.Joint("ψ", "revolute", "heading", "leaning", axis=X),
        elements.Joint("φ", "revolute", "leaning", "rear frame", axis=Z),
        elements.Joint("β_r", "revolute", "rear frame", "rear wheel", axis=Z, symmetric=True),
        elements.Joint("ψ_f", "revolute", "rear frame", "front frame", pivot, seat, (0, -1, 0)),
        elements.Joint(
            "β_f", "revolute", "front frame", "front wheel", hub, axis=Z, symmetric=True
        ),
    ]
    floor, (rear_radius, front_radius) = (GROUND, elements.ORIGIN), parameters.radius
    # The leaning frame has the direction of the rear wheel's contact, no frame that of the front's.
    rear = elements.Contact(("rear wheel", elements.ORIGIN), floor, rear_radius, (("leaning", Y),))
    directions = ("front wheel", Z), UP
    front = elements.Contact(("front wheel", elements.ORIGIN), floor, front_radius, directions)
    # In this order, with the first velocities dependent, elimination divides by no small pivot for
    # an upright bicycle, even where it cannot choose pivots (expressions).
    closing = [
        rear.rolling("rear wheel along", AHEAD),
        rear.rolling("rear wheel across", LEFT),
        rear.touching("rear wheel up", UP),
        front.rolling("front wheel across", LEFT),
        front.touching("front wheel up", UP),
        front.rolling("front wheel along", AHEAD),
    ]
    down = (0, 0, -parameters.gravity[0])
    return Description(links, joints, NAMES, closing, gravity=down)


class Bicycle(Described, description=description, closed=True):
    """A bicycle without hands, by default the benchmark, rolling upright and pushed to lean.

    As published, points and moments of inertia refer to axes ahead, right and down from the point
    of contact of the rear wheel, for the upright bicycle at zero steering angle; the product of
    inertia is the matrix entry, and the matrix is positive definite. Bodies are rear wheel, rear
    frame with the rider, front frame, front wheel. The steering axis meets the ground `trail` ahead
    of the front wheel's contact.
    """

    wheelbase: Any = parameter("w", "m", "> 0", (0.8, 1.5), default=1.02, read=False)
    trail: Any = parameter("c", "m", sample_range=(-0.1, 0.2), default=0.08, read=False)
    tilt: Any = parameter(
        "λ, within π/2", "rad", sample_range=(-0.2, 0.5), default=np.pi / 10, read=False
    )
    radius: Any = parameter("rear and front", "m", "> 0", (0.2, 0.5), (2,), default=(0.3, 0.35))
    mass: Any = parameter("m", "kg", "> 0", (1.0, 100.0), (4,), default=(2.0, 85.0, 4.0, 3.0))
    center: Any = parameter(
        *("of frames, ahead and down", "m", "", (-1.0, 1.0), (2, 2)),
        default=((0.3, -0.9), (0.9, -0.7)),
        read=False,
    )
    wheels: Any = parameter(
        *("I of wheels, about a diameter and the axle", "kg m²", "> 0", (0.01, 1.0), (2, 2)),
        default=((0.0603, 0.12), (0.1405, 0.28)),
        read=False,
    )
    frames: Any = parameter(
        *("I of frames, ahead, right, down, and ahead with down", "kg m²", "", None, (2, 4)),
        default=((9.2, 11.0, 2.8, 2.4), (0.05892, 0.06, 0.00708, -0.00756)),
        read=False,
    )
    gravity: Any = parameter("g", "m/s²", ">= 0", (0.0, 20.0), default=9.81)
    speed: Any = parameter("at t = 0", "m/s", default=4.6, read=False)
    lean_rate: Any = parameter("at which it begins to lean", "rad/s", default=0.5, read=False)

    key = "bicycle"
    named_coordinates = NAMES
    coordinate_sample_ranges = (
        *(ANYWHERE, ANYWHERE, Range(0.1, 0.5), ANY_ANGLE, Range(np.pi - 0.2, np.pi + 0.2)),
        *(ANY_ANGLE, Range(np.pi / 2 - 0.8, np.pi / 2 + 0.8), Range(-0.8, 0.8), ANY_ANGLE),
    )
    named_constraints = (
        *("rear wheel along", "rear wheel across", "rear wheel up"),
        *("front wheel across", "front wheel up", "front wheel along"),
    )
    conserves_energy = True
    angle_coordinates = slice(HEADING, None)
    holonomic = slice(2, 5, 2)

    def __post_init__(self):
        self.check_fields()
        if abs(self.tilt) >= np.pi / 2:
            raise InputError(f"tilt = {self.tilt}, expected less than π/2 to either side")
        for i, (ahead, right, down, product) in enumerate(self.frames):
            if min(ahead, right, down) <= 0 or ahead * down <= product**2:
                raise InputError(
                    f"frames[{i}] = {self.frames[i].tolist()}, expected positive moments of "
                    "inertia and a product of inertia below the root of theirs"
                )

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return inertia along b, for the front along the steering axis, and positions, m.

        `rider` is its centre of mass from the centre of the rear wheel; `pivot` is the point where
        the steering axis meets the ground if the bicycle is upright; from there `fork` is the
        centre of mass of the front frame and `hub` that of the front wheel, both along axes that
        are tilted by λ, whose cosine and sine are `tilted`.
        """
        number = arithmetic.numbers
        wheelbase, trail = number(np.array([self.wheelbase, self.trail]))
        radius, center = number(self.radius), number(self.center)
        wheels, frames = number(self.wheels), number(self.frames)
        tilt = arithmetic.angles(number(np.array([self.tilt])))
        cos, sin = tilt.cos[0], tilt.sin[0]
        inertia = np.zeros((4, 3, 3), center.dtype)
        for wheel, body in enumerate((REAR, FRONT)):
            inertia[body, 0, 0] = inertia[body, 1, 1] = wheels[wheel, 0]
            inertia[body, 2, 2] = wheels[wheel, 1]
        # b_1, b_2, b_3 are ahead, down and left.
        for frame, body in enumerate((FRAME, FORK)):
            inertia[body, 0, 0], inertia[body, 2, 2], inertia[body, 1, 1] = frames[frame, :3]
            inertia[body, 0, 1] = inertia[body, 1, 0] = frames[frame, 3]
        ahead, down, both = inertia[FORK, 0, 0], inertia[FORK, 1, 1], inertia[FORK, 0, 1]
        inertia[FORK, 0, 0] = cos * cos * ahead + sin * sin * down - 2 * sin * cos * both
        inertia[FORK, 1, 1] = sin * sin * ahead + cos * cos * down + 2 * sin * cos * both
        inertia[FORK, 0, 1] = (cos * cos - sin * sin) * both + sin * cos * (ahead - down)
        inertia[FORK, 1, 0] = inertia[FORK, 0, 1]

        def along_steering(x, y):
            return [cos * x - sin * y, sin * x + cos * y]

        points = {
            "rider": [center[0, 0], center[0, 1] + radius[0]],
            "pivot": [wheelbase + trail, radius[0]],
            "fork": along_steering(center[1, 0] - (wheelbase + trail), center[1, 1]),
            "hub": along_steering(-trail, -radius[1]),
            "tilted": [cos, sin],
        }
        made = {name: np.array(point, center.dtype) for name, point in points.items()}
        return {"inertia": inertia, "radius": radius, **made}

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rolling upright along -x, with a rate of lean about the track."""
        q, v = np.zeros(9), np.zeros(9)
        rear, front = self.radius
        q[HEIGHT], q[LEAN], q[PITCH] = rear, np.pi / 2, np.pi
        v[0], v[1] = -self.speed, -rear * np.sin(q[LEAN]) * self.lean_rate
        v[HEIGHT] = rear * np.cos(q[LEAN]) * self.lean_rate
        v[REAR_SPIN], v[FRONT_SPIN], v[LEAN] = (
            self.speed / rear,
            self.speed / front,
            self.lean_rate,
        )
        return q, v

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |sin ψ| <= 4 eps: Euler's angles are singular where the rear frame lies flat."""
        sine = abs(float(np.sin(q[LEAN])))
        if sine <= 4 * EPS:
            detail = f"ψ = {float(q[LEAN])!r}: Euler's angles are singular, the axle is upright"
            raise RefusedError("sin ψ", sine, 4 * EPS, detail)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the vertical, a translation and the mirror image in the x axis."""
        yield plane_rotation(self, q, v, slice(HEADING, HEADING + 1))
        yield plane_translation(self, q, v)
        mirrored = plane_mirror(self, q, v, unflipped=(0, HEIGHT, PITCH, FRONT_SPIN, REAR_SPIN))
        mirrored.q[LEAN] += np.pi
        yield mirrored

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Bicycle, Array]:
        """Return the bicycle leaning and steered."""
        q = cls().initial_state()[0]
        q[:2], q[HEADING], q[LEAN], q[STEER] = (1.7, 0.9), -0.5, np.pi / 2 - 0.25, 0.35
        return cls(), q

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return wheels and frames, and each angle about its own axis."""
        # `frames` of the bicycle itself is a parameter, moments of inertia.
        frames, (east, north, up) = Described.frames(self, q), np.eye(3)
        here: Any = self.float64_parameters
        (heading, across, _), (_, spoke, _) = frames["heading"][1], frames["leaning"][1]
        (rear, b), (pivot, front) = frames["rear frame"], frames["front frame"]
        hub, foot = frames["front wheel"][0], np.array([q[0], q[1], 0.0])
        c, s = here.tilted
        g = np.array([c * front[0] + s * front[1], c * front[1] - s * front[0], front[2]])
        steering, ahead = -front[1], c * b[0] - s * b[1]
        rider = rear + np.array(here.rider) @ b[:2]
        low, high = pivot + 0.65 * steering, pivot + 0.95 * steering
        lowest = g[2, 2] * g[2] - up
        touch = rear - self.radius[0] * spoke
        front = hub + self.radius[1] * lowest / np.linalg.norm(lowest)
        corners = [(-0.2, -0.3), (2.4, -0.3), (2.4, 2.0), (-0.2, 2.0)]
        parts = (
            *(draw.Plane([np.array([x, y, 0.0]) for x, y in corners]), *draw.fixed_axes(0.4, 3)),
            draw.Disk(rear, b[2], float(self.radius[0])),
            draw.Disk(hub, g[2], float(self.radius[1])),
            draw.Body((rear, low, high, rider, rear), "rear frame"),
            draw.Body((hub, low + 0.05 * g[0], high + 0.12 * steering), "fork"),
            draw.JointMark(rear),
            draw.JointMark(hub),
            draw.Center(rider, "rider"),
            draw.Distance("", pivot, high + 0.3 * steering),
            *(draw.Distance("x", q[1] * north, foot), draw.Distance("y", q[0] * east, foot)),
            draw.Distance("z", foot, rear),
            draw.Arrow("h", touch, 0.75 * heading),
            draw.Trail(touch),
            *(draw.Angle("θ", touch, east, north, q[HEADING], 0.6), draw.Trail(front)),
            draw.Arrow("", touch, 0.7 * east),
            *(draw.Angle("ψ", rear, up, -across, q[LEAN], 0.5), draw.Arrow("", rear, 0.6 * up)),
            draw.Arrow("axle", rear, 0.6 * b[2]),
            draw.Angle("φ", rear, heading, np.cross(b[2], heading), q[PITCH], 0.18),
            draw.Angle("ψ_f", high + 0.2 * steering, ahead, b[2], q[STEER], 0.3),
            draw.Angle("β_r", rear, b[0], b[1], 0.0, 0.8 * self.radius[0]),
            draw.Angle("β_f", hub, g[0], g[1], 0.0, 0.8 * self.radius[1]),
            draw.ConstraintMark("rear wheel rolls", touch, (0, 1, 2)),
            draw.ConstraintMark("front wheel rolls", front, (5, 3, 4)),
        )
        return draw.Sketch(parts, azimuth=-1.05, elevation=0.3)
