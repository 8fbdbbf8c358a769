"""A bicycle that nobody holds: two wheels, a frame with its rider, a front fork that can steer.

Whipple's model: knife-edged wheels roll without slipping. Its nine coordinates are those of
Basu-Mandal et al. 2007, in an order of our own:

    q = [x, y, z, θ, φ, β_f, ψ, ψ_f, β_r].

(x, y, z) is the centre of the rear wheel, z up. θ, ψ and φ turn the rear frame about the vertical
k, the heading h and the axle of the rear wheel: h = (cos θ, sin θ, 0), upright is ψ = π/2. ψ_f
turns the fork about the steering axis, β_r and β_f the wheels about their axles. At θ = 0,
ψ = π/2, φ = π the bicycle stands upright and rolls with positive spins, against h: along -x.

Axes b_1, b_2, b_3 of the rear frame are then ahead, down and left; g_1, g_2, g_3 are those of the
front frame, the same where nothing is steered. Axles are along b_3 and g_3. Wheels are alike in
all directions of their plane, so that vectors of a wheel are written along the axes of its frame.

Constraints are along the heading, across it and up. Those up are holonomic, four are not. The last
three velocities, of leaning, of steering and of the rear wheel's spin, are the generalized speeds.

The functions are in `bicycle_jacobians` and `bicycle_energies`.

Source: Meijaard et al. 2007, whose benchmark gives the defaults; Basu-Mandal et al. 2007.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.errors import InputError, RefusedError
from eomcheck.mechanics import plane
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import ANY_ANGLE, ANYWHERE, Range, Symmetry
from eomcheck.mechanics.sketch import (
    Angle,
    Arrow,
    Body,
    Center,
    Constraint,
    Disk,
    Distance,
    Joint,
    Plane,
    Sketch,
    Trail,
    fixed_axes,
)
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.float64 import FLOAT64
from eomcheck.numbers.pivots import EPS
from eomcheck.scenes import bicycle_axes as at
from eomcheck.scenes import bicycle_energies, bicycle_jacobians

PARTS = at, bicycle_jacobians, bicycle_energies


class Bicycle(Parametric, functions=PARTS):
    """A bicycle without hands, by default the benchmark, rolling upright and pushed to lean.

    As published, points and moments of inertia refer to axes ahead, right and down from where the
    rear wheel touches the ground, the bicycle being upright and not steered; the product of inertia
    is that of the matrix, which is positive definite. Bodies are rear wheel, rear frame with the
    rider, front frame, front wheel. The steering axis meets the ground `trail` ahead of the front
    wheel's contact.
    """

    wheelbase: Any = parameter("w", "m", "> 0", (0.8, 1.5), default=1.02, read=False)
    trail: Any = parameter("c", "m", drawn=(-0.1, 0.2), default=0.08, read=False)
    tilt: Any = parameter("λ, within π/2", "rad", drawn=(-0.2, 0.5), default=np.pi / 10)
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
    named_coordinates = "x", "y", "z", "θ", "φ", "β_f", "ψ", "ψ_f", "β_r"
    drawn_coordinates = (
        *(ANYWHERE, ANYWHERE, Range(0.1, 0.5), ANY_ANGLE, Range(np.pi - 0.2, np.pi + 0.2)),
        *(ANY_ANGLE, Range(np.pi / 2 - 0.8, np.pi / 2 + 0.8), Range(-0.8, 0.8), ANY_ANGLE),
    )
    named_constraints = (
        *("rear wheel along", "rear wheel across", "rear wheel up"),
        *("front wheel across", "front wheel up", "front wheel along"),
    )
    conserves_energy = True
    angle_coordinates = slice(at.HEADING, None)
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
        """Return inertia along b or g of each body, and where its points are in its plane, m.

        The rider from the centre of the rear wheel, as `pivot`, where the steering axis meets the
        ground if the bicycle is upright; from there the centre of mass of the front frame, `fork`,
        and of the front wheel, `hub`.
        """
        number = arithmetic.numbers
        wheelbase, trail = number(np.array([self.wheelbase, self.trail]))
        radius, center = number(self.radius), number(self.center)
        wheels, frames = number(self.wheels), number(self.frames)
        inertia = np.zeros((4, 3, 3), center.dtype)
        for wheel, body in enumerate(at.WHEEL):
            inertia[body, 0, 0] = inertia[body, 1, 1] = wheels[wheel, 0]
            inertia[body, 2, 2] = wheels[wheel, 1]
        # b_1, b_2, b_3 are ahead, down and left.
        for frame, body in enumerate((at.FRAME, at.FORK)):
            inertia[body, 0, 0], inertia[body, 2, 2], inertia[body, 1, 1] = frames[frame, :3]
            inertia[body, 0, 1] = inertia[body, 1, 0] = frames[frame, 3]
        points = {
            "rider": [center[0, 0], center[0, 1] + radius[0]],
            "pivot": [wheelbase + trail, radius[0]],
            "fork": [center[1, 0] - (wheelbase + trail), center[1, 1]],
            "hub": [-trail, -radius[1]],
        }
        made = {name: np.array(point, center.dtype) for name, point in points.items()}
        return {"inertia": inertia, "radius": radius, **made}

    def initial_state(self) -> tuple[Array, Array]:
        """Return the bicycle upright, heading along -x: it rolls, and tilts about its track."""
        q, v = np.zeros(9), np.zeros(9)
        rear, front = self.radius
        q[at.HEIGHT], q[at.LEAN], q[at.PITCH] = rear, np.pi / 2, np.pi
        v[0], v[1] = -self.speed, -rear * np.sin(q[at.LEAN]) * self.lean_rate
        v[at.HEIGHT] = rear * np.cos(q[at.LEAN]) * self.lean_rate
        v[at.REAR_SPIN], v[at.FRONT_SPIN], v[at.LEAN] = (
            self.speed / rear,
            self.speed / front,
            self.lean_rate,
        )
        return q, v

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |sin ψ| <= 4 eps: Euler's angles are singular where the rear frame lies flat."""
        sine = abs(float(np.sin(q[at.LEAN])))
        if sine <= 4 * EPS:
            detail = f"ψ = {float(q[at.LEAN])!r}: Euler's angles are singular, the axle is upright"
            raise RefusedError("sin ψ", sine, 4 * EPS, detail)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the vertical, a translation and the mirror image in the x axis."""
        yield plane.rotation(self, q, v, slice(at.HEADING, at.HEADING + 1))
        yield plane.translation(self, q, v)
        mirrored = plane.mirror(
            self, q, v, kept=(0, at.HEIGHT, at.PITCH, at.FRONT_SPIN, at.REAR_SPIN)
        )
        mirrored.q[at.LEAN] += np.pi
        yield mirrored

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Bicycle, Array]:
        """Return the bicycle leaning and steered."""
        q = cls().initial_state()[0]
        q[:2], q[at.HEADING], q[at.LEAN], q[at.STEER] = (1.7, 0.9), -0.5, np.pi / 2 - 0.25, 0.35
        return cls(), q

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return wheels and frames, and each angle about its own axis."""
        here: Any = self.parameters(FLOAT64)
        prepared = at.prepare(FLOAT64, here, q, t)
        cos, sin, (east, north, up) = prepared.cos, prepared.sin, np.eye(3)
        heading = np.array([cos[at.HEADING], sin[at.HEADING], 0.0])
        across = np.cross(up, heading)

        def level(point: Any, front: bool = False) -> Array:
            vector = np.resize([*point, 0.0], 3)
            if front:
                vector = at.steered(prepared, -sin[at.STEER], vector)
            along, left, rise = bicycle_energies.level(prepared, vector)
            return along * heading + left * across + rise * up

        b = [level(axis) for axis in np.eye(3)]
        g = [level(axis, True) for axis in np.eye(3)]
        k = np.array([up @ axis for axis in g[:2]])
        rear = q[:3]
        pivot, foot = rear + level(here.pivot), np.array([q[0], q[1], 0.0])
        hub, rider = pivot + level(here.hub, True), rear + level(here.rider)
        tilt = np.array([prepared.tilt_sin[0], prepared.tilt_cos[0]])
        steering, ahead = level(-tilt), level([tilt[1], -tilt[0]])
        low, high = pivot + 0.65 * steering, pivot + 0.95 * steering
        touch = rear - self.radius[0] * (sin[at.PITCH] * b[0] + cos[at.PITCH] * b[1])
        front = hub - self.radius[1] / np.linalg.norm(k) * (k[0] * g[0] + k[1] * g[1])
        corners = [(-0.2, -0.3), (2.4, -0.3), (2.4, 2.0), (-0.2, 2.0)]
        parts = (
            *(Plane([np.array([x, y, 0.0]) for x, y in corners]), *fixed_axes(0.4, 3)),
            Disk(rear, b[2], float(self.radius[0])),
            Disk(hub, g[2], float(self.radius[1])),
            Body((rear, low, high, rider, rear), "rear frame"),
            *(Body((hub, low + 0.05 * g[0], high + 0.12 * steering), "fork"), Joint(rear)),
            *(Joint(hub), Center(rider, "rider"), Distance("", pivot, high + 0.3 * steering)),
            *(Distance("x", q[1] * north, foot), Distance("y", q[0] * east, foot)),
            *(Distance("z", foot, rear), Arrow("h", touch, 0.75 * heading), Trail(touch)),
            *(Angle("θ", touch, east, north, q[at.HEADING], 0.6), Trail(front)),
            Arrow("", touch, 0.7 * east),
            *(Angle("ψ", rear, up, -across, q[at.LEAN], 0.5), Arrow("", rear, 0.6 * up)),
            Arrow("axle", rear, 0.6 * b[2]),
            Angle("φ", rear, heading, np.cross(b[2], heading), q[at.PITCH], 0.18),
            Angle("ψ_f", high + 0.2 * steering, ahead, b[2], q[at.STEER], 0.3),
            Angle("β_r", rear, b[0], b[1], 0.0, 0.8 * self.radius[0]),
            Angle("β_f", hub, g[0], g[1], 0.0, 0.8 * self.radius[1]),
            Constraint("rear wheel rolls", touch, at.ROW[0]),
            Constraint("front wheel rolls", front, at.ROW[1]),
        )
        return Sketch(parts, azimuth=-1.05, elevation=0.3)
