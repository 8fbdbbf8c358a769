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
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import InputError, RefusedError
from eomcheck.mechanics import plane
from eomcheck.mechanics.assembled import Assembled
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.pivots import EPS
from eomcheck.scenes import bicycle_axes, bicycle_energies, bicycle_jacobians
from eomcheck.scenes.bicycle_axes import (
    FORK,
    FRAME,
    FRONT_SPIN,
    HEADING,
    HEIGHT,
    LEAN,
    PITCH,
    REAR_SPIN,
    WHEEL,
)


class Parameters(NamedTuple):
    """The parameters of a `Bicycle` in some kind of number; points along b or g of its body."""

    mass: Any
    """(4,), kg."""
    inertia: Any
    """About the centres of mass, along b_1, b_2, b_3 or g_1, g_2, g_3 (4, 3, 3), kg m²."""
    radius: Any
    """Rear and front (2,), m."""
    tilt: Any
    """λ of the steering axis (1,), rad."""
    rider: Any
    """Centre of mass of the rear frame, from the centre of the rear wheel (2,), m."""
    pivot: Any
    """Where the steering axis meets the ground if the bicycle is upright, likewise (2,), m."""
    fork: Any
    """Centre of mass of the front frame, from there (2,), m."""
    hub: Any
    """Centre of the front wheel, from there (2,), m."""
    gravity: Any
    """g (1,), m/s²."""


FUNCTIONS = vars(bicycle_axes) | vars(bicycle_jacobians) | vars(bicycle_energies)


@dataclass(frozen=True, eq=False, repr=False)
class Bicycle(Parametric, Assembled, functions=FUNCTIONS):
    """A bicycle without hands, by default the benchmark, rolling upright and pushed to lean.

    As published, points and moments of inertia refer to axes ahead, right and down from where the
    rear wheel touches the ground, the bicycle being upright and not steered. Bodies are rear wheel,
    rear frame with the rider, front frame, front wheel.

    Args:
        wheelbase: w, m, positive.
        trail: c, m: how far the steering axis meets the ground ahead of the front wheel's contact.
        tilt: λ, rad, of the steering axis from the vertical, less than π/2 to either side.
        radius: of rear and front wheel (2,), m, positive.
        mass: (4,), kg, positive.
        center: centres of mass of rear and front frame, ahead and down (2, 2), m.
        wheels: moments of inertia of rear and front wheel, about a diameter and about the axle
            (2, 2), kg m², positive.
        frames: of rear and front frame, ahead, right, down, and the product of inertia ahead and
            down as it stands in the matrix (2, 4), kg m²; positive definite.
        gravity: g, m/s², not negative.
        speed: at t = 0, m/s.
        lean_rate: at which it begins to lean, rad/s.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    wheelbase: Any = parameter(1.02, "positive", drawn=Range(0.8, 1.5))
    trail: Any = parameter(0.08, drawn=Range(-0.1, 0.2))
    tilt: Any = parameter(np.pi / 10, drawn=Range(-0.2, 0.5))
    radius: Any = parameter((0.3, 0.35), "positive", (2,), drawn=Range(0.2, 0.5))
    mass: Any = parameter((2.0, 85.0, 4.0, 3.0), "positive", (4,), drawn=Range(1.0, 100.0))
    center: Any = parameter(((0.3, -0.9), (0.9, -0.7)), shape=(2, 2), drawn=Range(-1.0, 1.0))
    wheels: Any = parameter(
        ((0.0603, 0.12), (0.1405, 0.28)), "positive", (2, 2), drawn=Range(0.01, 1.0)
    )
    frames: Any = parameter(
        ((9.2, 11.0, 2.8, 2.4), (0.05892, 0.06, 0.00708, -0.00756)), shape=(2, 4)
    )
    gravity: Any = parameter(9.81, "not negative", drawn=Range(0.0, 20.0))
    speed: Any = parameter(4.6)
    lean_rate: Any = parameter(0.5)

    key = "bicycle"
    named_coordinates = "x", "y", "z", "θ", "φ", "β_f", "ψ", "ψ_f", "β_r"
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

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return up to 10 m, any heading and spins, 0.8 rad of lean and of steering."""
        anywhere, any_angle = Range(-10.0, 10.0), Range(-np.pi, np.pi)
        pitch, lean = Range(np.pi - 0.2, np.pi + 0.2), Range(np.pi / 2 - 0.8, np.pi / 2 + 0.8)
        height = Range(0.1, 0.5)
        return (
            *(anywhere, anywhere, height, any_angle, pitch),
            *(any_angle, lean, Range(-0.8, 0.8), any_angle),
        )

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Rear wheel along h, across it, up, front wheel across, up, along."""
        rear = (f"rear wheel {way}" for way in ("along", "across", "up"))
        front = (f"front wheel {way}" for way in ("across", "up", "along"))
        return *rear, *front

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        number = arithmetic.numbers
        wheelbase, trail = number(np.array([self.wheelbase, self.trail]))
        radius, center = number(self.radius), number(self.center)
        wheels, frames = number(self.wheels), number(self.frames)
        inertia = np.zeros((4, 3, 3), center.dtype)
        for wheel, body in enumerate(WHEEL):
            inertia[body, 0, 0] = inertia[body, 1, 1] = wheels[wheel, 0]
            inertia[body, 2, 2] = wheels[wheel, 1]
        # b_1, b_2, b_3 are ahead, down and left.
        for frame, body in enumerate((FRAME, FORK)):
            inertia[body, 0, 0], inertia[body, 2, 2], inertia[body, 1, 1] = frames[frame, :3]
            inertia[body, 0, 1] = inertia[body, 1, 0] = frames[frame, 3]
        rider, pivot, fork, hub = np.zeros((4, 2), center.dtype)
        rider[0], rider[1] = center[0, 0], center[0, 1] + radius[0]
        pivot[0], pivot[1] = wheelbase + trail, radius[0]
        fork[0], fork[1] = center[1, 0] - pivot[0], center[1, 1]
        hub[0], hub[1] = -trail, -radius[1]
        made = {"inertia": inertia, "rider": rider, "pivot": pivot, "fork": fork, "hub": hub}
        return self.in_numbers(arithmetic, Parameters, **made)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the bicycle upright, heading along -x: it rolls, and tilts about its track."""
        q, v = np.zeros(9), np.zeros(9)
        rear, front = self.radius
        q[HEIGHT], q[LEAN], q[PITCH] = rear, np.pi / 2, np.pi
        v[0], v[1] = -self.speed, -rear * np.sin(q[LEAN]) * self.lean_rate
        v[HEIGHT] = rear * np.cos(q[LEAN]) * self.lean_rate
        v[REAR_SPIN], v[FRONT_SPIN], v[LEAN] = self.speed / rear, self.speed / front, self.lean_rate
        return q, v

    def refuse_speeds(self, q: Array) -> None:
        """Refuse |sin ψ| <= 4 eps: Euler's angles are singular where the rear frame lies flat."""
        sine = abs(float(np.sin(q[LEAN])))
        if sine <= 4 * EPS:
            detail = f"ψ = {float(q[LEAN])!r}: Euler's angles are singular, the axle is upright"
            raise RefusedError("sin ψ", sine, 4 * EPS, detail)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the vertical, a translation and the mirror image in the x axis."""
        yield plane.rotation(self, q, v, slice(HEADING, HEADING + 1))
        yield plane.translation(self, q, v)
        mirrored = plane.mirror(self, q, v, kept=(0, HEIGHT, PITCH, FRONT_SPIN, REAR_SPIN))
        mirrored.q[LEAN] += np.pi
        yield mirrored
