"""A flyball governor whose coupler rods are stiff springs with dampers: three dimensions.

A shaft turns freely about the vertical. A slider moves along it and turns with it; two equal arms
hang on hinges near its top and carry the balls. From the slider to each arm runs a spring with a
damper. q = [s, ψ, θ_1, θ_2]: the height of the slider, the turn of the shaft, and how far each arm
points below the horizontal. Arm and spring lie in one vertical plane through the shaft; the
directions radial, tangential and up belong to an arm and turn with the shaft. There is no
constraint, so every formulation reduces to M q̈ = F. Springs and dampers make it stiff.

Source: A05 of the IFToMM benchmark library; González, Dopico, Lugrís and Cuadrado 2006. The
defaults are its data: rods and shaft of 1 m with a section of 0.01 m by 0.01 m and a slider of
0.1 m, all of 3000 kg/m³, balls of 5 kg at the ends of the arms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics import plane
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import ANY_ANGLE, Jacobians, Range, Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import (
    Angle,
    Arrow,
    Body,
    Disk,
    Distance,
    Joint,
    Sketch,
    Spring,
    Trail,
    fixed_axes,
)
from eomcheck.mechanics.space import diagonal, gyroscopic_moments
from eomcheck.numbers.contract import Arithmetic, Array

ROD, BALL = 0.3, 5.0
"""Of the benchmark's arms, kg; the rod is 1 m long."""
ARM = ROD + BALL
CENTER = (ROD / 2 + BALL) / ARM
ACROSS = ROD * (1 + 0.01**2) / 12 + ROD * (CENTER - 0.5) ** 2 + BALL * (1 - CENTER) ** 2
ALONG = ROD * 0.01**2 / 6
SLIDER = 3.0
SPINNING = SLIDER * 0.1**2 / 6 + ALONG
"""Slider and shaft."""

SQUARE = (-1, -1), (1, -1), (1, 1), (-1, 1)
SLIDER_HEIGHT, TURN, ARMS = 0, 1, (2, 3)
"""Coordinates s and ψ, and those of the arms."""


class Prepared(NamedTuple):
    """What is not rational in q."""

    turn: Any
    """ψ, as `Angles` (1,)."""
    cos: Any
    """Of the arms (2,)."""
    sin: Any
    """Likewise (2,)."""
    spring: Any
    """Lengths of the springs (2,), m."""


def above_slider(parameters, q):
    """Return how far the hinges are above the slider, m."""
    return parameters.hinge[1] - q[SLIDER_HEIGHT]


def prepare(arithmetic, parameters, q, t):
    """Return the `Prepared` at q (4,).

    A spring ends at the slider as far from the shaft as the hinge is.
    """
    turn, arms = arithmetic.angles(q[1:2]), arithmetic.angles(q[2:])
    reach, high = parameters.attachment[0], above_slider(parameters, q)
    square = np.zeros(2, arms.cos.dtype)
    for i in range(2):
        out, rise = reach * arms.cos[i], high - reach * arms.sin[i]
        square[i] = out * out + rise * rise
    return Prepared(turn, arms.cos, arms.sin, arithmetic.root(square))


# ---- How the bodies move -------------------------------------------------------------------------


def rotations(cos, sin, v):
    """Return ω (3, 3) of slider and arms, along axes of the bodies."""
    arms = [[-sin[i] * v[TURN], v[ARMS[i]], cos[i] * v[TURN]] for i in range(2)]
    return np.array([[0, 0, v[TURN]], *arms], v.dtype)


def jacobians(parameters, prepared, q, v):
    """Return the `Jacobians`, V of an arm along its radial, tangential and upward directions."""
    cos, sin, center = prepared.cos, prepared.sin, parameters.center[0]
    linear, angular = np.zeros((3, 3, 4), q.dtype), np.zeros((3, 3, 4), q.dtype)
    rest, angular_rest = np.zeros((3, 3), q.dtype), np.zeros((3, 3), q.dtype)
    linear[0, 2, SLIDER_HEIGHT] = 1
    angular[0, 2, TURN] = 1
    turn = v[TURN]
    for i in range(2):
        arm, swing = ARMS[i], v[ARMS[i]]
        out, down = center * cos[i], center * sin[i]
        radius = parameters.hinge[0] + out
        linear[i + 1, 0, arm], linear[i + 1, 1, TURN], linear[i + 1, 2, arm] = -down, radius, -out
        rest[i + 1, 0] = -out * swing * swing - radius * turn * turn
        rest[i + 1, 1] = -2 * down * swing * turn
        rest[i + 1, 2] = down * swing * swing
        angular[i + 1, 0, TURN], angular[i + 1, 2, TURN] = -sin[i], cos[i]
        angular[i + 1, 1, arm] = 1
        angular_rest[i + 1, 0] = -cos[i] * swing * turn
        angular_rest[i + 1, 2] = -sin[i] * swing * turn
    moments = gyroscopic_moments(parameters.inertia, rotations(cos, sin, v))
    return Jacobians(linear, angular, rest, angular_rest, moments)


def tension(length, rest_length, stiffness, damping, rate):
    """Return the pull of a spring and its damper, N, while the spring grows at `rate`."""
    pull = stiffness[0] * (length - rest_length[0])
    if damping is None:
        return pull
    return pull + damping[0] * rate


def spring_gradient(parameters, prepared, q, i):
    """Return ∂(length of spring i)/∂s and ∂(length of spring i)/∂θ_i."""
    reach, high, length = parameters.attachment[0], above_slider(parameters, q), prepared.spring[i]
    return (reach * prepared.sin[i] - high) / length, -reach * high * prepared.cos[i] / length


def forces(parameters, prepared, q, v):
    """Return Q (4,): weights, springs and dampers."""
    stiffness, rest_length = parameters.stiffness, parameters.rest_length
    mass, gravity = parameters.mass, parameters.gravity[0]
    Q = np.zeros(4, v.dtype)
    Q[SLIDER_HEIGHT] = -mass[0] * gravity
    for i in range(2):
        arm = ARMS[i]
        by_slider, by_arm = spring_gradient(parameters, prepared, q, i)
        rate = by_slider * v[SLIDER_HEIGHT] + by_arm * v[arm]
        pull = tension(prepared.spring[i], rest_length, stiffness, parameters.damping, rate)
        Q[SLIDER_HEIGHT] -= pull * by_slider
        Q[arm] = mass[i + 1] * gravity * parameters.center[0] * prepared.cos[i] - pull * by_arm
    return Q


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, prepared, q, v):
    """Return the velocities of the centres of mass along x, y, z (3, 3), and of rotation (3, 3)."""
    cos, sin, center = prepared.cos, prepared.sin, parameters.center[0]
    ahead, left = prepared.turn.cos[0], prepared.turn.sin[0]
    V = np.zeros((3, 3), v.dtype)
    V[0, 2] = v[SLIDER_HEIGHT]
    for i in range(2):
        side = 1 - 2 * i
        out = -center * sin[i] * v[ARMS[i]]
        around = (parameters.hinge[0] + center * cos[i]) * v[TURN]
        V[i + 1, 0] = side * (out * ahead - around * left)
        V[i + 1, 1] = side * (out * left + around * ahead)
        V[i + 1, 2] = -center * cos[i] * v[ARMS[i]]
    return V, rotations(cos, sin, v)


def potential(parameters, prepared, q):
    """Return U, J, of weights and springs."""
    mass, gravity = parameters.mass, parameters.gravity[0]
    U = mass[0] * gravity * q[SLIDER_HEIGHT]
    for i in range(2):
        height = parameters.hinge[1] - parameters.center[0] * prepared.sin[i]
        longer = prepared.spring[i] - parameters.rest_length[0]
        U += mass[i + 1] * gravity * height
        U += parameters.stiffness[0] * longer * longer / 2
    return U


def damper_dissipation(damping, first, second):
    """Return R of two dampers from how fast they grow, W; None without them."""
    if damping is None:
        return None
    return damping[0] * (first * first + second * second) / 2


def growth(parameters, prepared, q, v, i):
    """Return how fast spring i grows, m/s: the rate of its square, halved, by its length."""
    reach, cos, sin = parameters.attachment[0], prepared.cos[i], prepared.sin[i]
    swing = reach * v[ARMS[i]]
    rise, rate = above_slider(parameters, q) - reach * sin, -v[SLIDER_HEIGHT] - cos * swing
    return (rise * rate - reach * cos * sin * swing) / prepared.spring[i]


def dissipation(parameters, prepared, q, v):
    """Return R, W, or None: half the power that the dampers take."""
    return damper_dissipation(
        parameters.damping,
        growth(parameters, prepared, q, v, 0),
        growth(parameters, prepared, q, v, 1),
    )


# ---- The scene -----------------------------------------------------------------------------------


class FlyballGovernor(Parametric, functions=globals()):
    """A flyball governor with springs for couplers, by default that of the benchmark.

    At t = 0 it turns at `rate`, both arms at `angle` below the horizontal, the slider at `height`.
    """

    slider: Any = parameter("its mass", "kg", "> 0", (0.1, 10.0), default=SLIDER, read=False)
    spinning: Any = parameter(
        "I of slider and shaft", "kg m²", ">= 0", (0.01, 1.0), default=SPINNING, read=False
    )
    arm: Any = parameter("mass of an arm", "kg", "> 0", (0.1, 10.0), default=ARM, read=False)
    center: Any = parameter("of an arm, from the hinge", "m", "> 0", (0.1, 1.0), default=CENTER)
    along: Any = parameter(
        "I of an arm about itself", "kg m²", ">= 0", (0.01, 1.0), default=ALONG, read=False
    )
    across: Any = parameter(
        "I of an arm, central, across", "kg m²", ">= 0", (0.01, 1.0), default=ACROSS, read=False
    )
    hinge: Any = parameter("from the axis to hinges", "m", "> 0", (0.01, 0.2), default=0.05)
    top: Any = parameter("height of the hinges", "m", default=1.0, read=False)
    attachment: Any = parameter("from hinge to spring", "m", "> 0", (0.3, 0.6), default=0.5)
    stiffness: Any = parameter("K of a spring", "N/m", ">= 0", (0.0, 1e4), default=8e5)
    rest_length: Any = parameter("of a spring", "m", ">= 0", (0.0, 1.0), default=0.5)
    damping: Any = parameter("C", "N s/m", ">= 0", (0.0, 100.0, None), default=4e4)
    gravity: Any = parameter("g, downwards", "m/s²", ">= 0", (0.0, 20.0), default=9.81)
    height: Any = parameter("s at t = 0", "m", default=0.5, read=False)
    angle: Any = parameter("θ at t = 0", "rad", default=float(np.pi / 6), read=False)
    rate: Any = parameter("ψ̇ at t = 0", "rad/s", default=float(2 * np.pi), read=False)

    key = "flyball-governor"
    named_coordinates = "s", "ψ", "θ_1", "θ_2"
    drawn_coordinates = Range(0.0, 0.6), ANY_ANGLE, Range(-1.2, 1.2), Range(-1.2, 1.2)
    conserves_energy = True
    angle_coordinates = slice(1, None)

    def __post_init__(self):
        self.check_fields()
        if self.damping is not None:
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers take it")

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield the governor of the benchmark, and one without dampers."""
        (governor,) = super().structures(links)
        yield governor
        yield cls(damping=None)

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return masses (3,), inertia (3, 3, 3), and radius and height of the hinges (2,).

        Inertia is along the arms, tangential and across, of slider and shaft about the vertical.
        """
        mass = arithmetic.numbers(np.array([self.slider, self.arm]))[[0, 1, 1]]
        of = arithmetic.numbers(np.array([self.spinning, self.along, self.across]))
        moments = np.array([[0, 0, of[0]], of[[1, 2, 2]], of[[1, 2, 2]]], of.dtype)
        hinge = arithmetic.numbers(np.array([self.hinge, self.top]))
        return {"mass": mass, "inertia": diagonal(moments), "hinge": hinge}

    def initial_state(self) -> tuple[Array, Array]:
        """Return both arms at `angle`, the slider at `height`, all turning at `rate`."""
        q = np.array([self.height, 0.0, self.angle, self.angle])
        return q, np.array([0.0, self.rate, 0.0, 0.0])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a turn about the shaft, the mirror image, and the arms exchanged."""
        turned = q + np.array([0.0, plane.TURN, 0.0, 0.0])
        yield Symmetry("rotation", self, turned, v, np.eye(4))
        mirror = np.diag([1.0, -1.0, 1.0, 1.0])
        yield Symmetry("mirror", self, mirror @ q, mirror @ v, mirror)
        exchange = np.eye(4)[[0, 1, 3, 2]]
        yield Symmetry("exchange", self, exchange @ q, exchange @ v, exchange)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Scene, Array]:
        """Return the governor of the benchmark, turned a little, its arms at different angles."""
        return cls.example(), np.array([0.35, 0.6, 0.55, 0.75])

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return shaft, slider, arms with balls, and springs."""
        s, turn, *angles = q
        top, up = float(self.top), np.array([0.0, 0.0, 1.0])
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        out, slider = np.array([np.cos(turn), np.sin(turn), 0.0]), s * up
        beam = [side * self.hinge * out + top * up for side in (1, -1)]
        parts: list[Any] = [
            *(*fixed_axes(0.22, 3), Body((0.0 * up, 1.1 * top * up), "shaft"), Body(beam)),
            Body(
                [slider + 0.08 * (a * out + b * np.cross(up, out)) for a, b in SQUARE],
                *("slider", True),
            ),
            Distance("s", -0.3 * y, s * up - 0.3 * y),
            Angle("ψ", 0.0 * up, x, y, turn, 0.45),
            Arrow("g", -0.36 * x - 0.26 * y + 0.2 * up, -0.25 * up, frame=False),
        ]
        for i, (side, angle) in enumerate(zip((1, -1), angles, strict=True)):
            hinge, level = beam[i], side * out
            along = np.cos(angle) * level - np.sin(angle) * up
            ball, hook = hinge + self.center * along, hinge + self.attachment * along
            parts += [Body((hinge, ball), f"arm {i + 1}"), Joint(hinge, axis=np.cross(level, up))]
            parts += [Disk(ball, np.cross(up, out), 0.09, f"ball {i + 1}", ball=True), Trail(ball)]
            parts += [Spring(slider + self.hinge * level, hook, "spring" if i else "")]
            parts += [Angle(f"θ_{i + 1}", hinge, level, -up, angle, 0.3)]
        return Sketch(tuple(parts), azimuth=-0.95, elevation=0.3)
