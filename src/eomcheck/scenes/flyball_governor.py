"""A flyball governor whose coupler rods are stiff springs with dampers, in space.

A shaft turns freely about the vertical. A slider moves along it and turns with it; two equal arms
on hinges near its top carry the balls. A spring with a damper connects the slider to each arm.
q = [s, ψ, θ_1, θ_2]: the height of the slider, the rotation of the shaft, and the angle of each arm
below the horizontal. Arm and spring lie in one vertical plane through the shaft; the directions
radial, tangential and up belong to an arm and turn with the shaft. There is no constraint, so every
formulation reduces to M q̈ = F. Springs and dampers make it stiff.

Source: A05 of the IFToMM benchmark library; González, Dopico, Lugrís and Cuadrado 2006. The
defaults are its data: rods and shaft of 1 m with a section of 0.01 m by 0.01 m and a slider of
0.1 m, all of 3000 kg/m³, balls of 5 kg at the ends of the arms.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import diagonal, parameter
from eomcheck.mechanics.records import ANY_ANGLE, TURN, Range, Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Arithmetic, Array

ROD, BALL = 0.3, 5.0
"""Masses of the benchmark's arms, kg; the rod is 1 m long."""
ARM = ROD + BALL
CENTER = (ROD / 2 + BALL) / ARM
ACROSS = ROD * (1 + 0.01**2) / 12 + ROD * (CENTER - 0.5) ** 2 + BALL * (1 - CENTER) ** 2
ALONG = ROD * 0.01**2 / 6
SLIDER = 3.0
SPINNING = SLIDER * 0.1**2 / 6 + ALONG
"""Moment of inertia of slider and shaft about the vertical, kg m²."""

SQUARE = (-1, -1), (1, -1), (1, 1), (-1, 1)
NAMES = "s", "ψ", "θ_1", "θ_2"
HALF_TURN = 0.0, 0.0, 0.0, 1.0
"""Quaternion of half a turn about the shaft."""


def description(parameters):
    """Return the declarative description: slider and arms on a shaft, springs between them."""
    mass, (out, top) = parameters.mass, parameters.hinge
    hook = (parameters.attachment[0], 0, 0)
    damping = None if parameters.damping is None else parameters.damping[0]
    strength = parameters.stiffness[0], parameters.rest_length[0], damping
    links = [elements.Link("slider", mass[0])]
    joints = [
        elements.Joint("ψ", "revolute", GROUND, "shaft"),
        elements.Joint("s", "prismatic", "shaft", "slider"),
    ]
    springs = []
    for k, (side, turn) in enumerate(((out, elements.IDENTITY), (-out, HALF_TURN)), 1):
        arm, place = f"arm {k}", (side, 0, top)
        links += [elements.Link(arm, mass[k], (parameters.center[0], 0, 0))]
        joints += [elements.Joint(f"θ_{k}", "revolute", "shaft", arm, place, turn, (0, 1, 0))]
        springs += [elements.Spring(f"spring {k}", arm, "slider", hook, (side, 0, 0), *strength)]
    down = (0, 0, -parameters.gravity[0])
    return Description(links, joints, NAMES, springs=springs, gravity=down)


# ---- The scene -----------------------------------------------------------------------------------


class FlyballGovernor(Described, description=description, damped=True):
    """A flyball governor with springs as couplers, by default that of the benchmark.

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
    named_coordinates = NAMES
    display_pose = 0.35, 0.6, 0.55, 0.75
    coordinate_sample_ranges = Range(0.0, 0.6), ANY_ANGLE, Range(-1.2, 1.2), Range(-1.2, 1.2)
    conserves_energy = True
    angle_coordinates = slice(1, None)

    def __post_init__(self):
        self.check_fields()
        if self.damping is not None:
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers take it")

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield the structural variants: the governor of the benchmark, and one without dampers."""
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
        """Return the state: arms at `angle`, slider at `height`, all turning at `rate`."""
        q = np.array([self.height, 0.0, self.angle, self.angle])
        return q, np.array([0.0, self.rate, 0.0, 0.0])

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation about the shaft, the mirror image, and the exchange of the arms."""
        turned = q + np.array([0.0, TURN, 0.0, 0.0])
        yield Symmetry("rotation", self, turned, v, np.eye(4))
        mirror = np.diag([1.0, -1.0, 1.0, 1.0])
        yield Symmetry("mirror", self, mirror @ q, mirror @ v, mirror)
        exchange = np.eye(4)[[0, 1, 3, 2]]
        yield Symmetry("exchange", self, exchange @ q, exchange @ v, exchange)

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return shaft, slider, arms with balls, and springs."""
        s, turn, *angles = q
        top, up = float(self.top), np.array([0.0, 0.0, 1.0])
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        out, slider = np.array([np.cos(turn), np.sin(turn), 0.0]), s * up
        beam = [side * self.hinge * out + top * up for side in (1, -1)]
        parts: list[Any] = [
            *draw.fixed_axes(0.22, 3),
            draw.Body((0.0 * up, 1.1 * top * up), "shaft"),
            draw.Body(beam),
            draw.Body(
                [slider + 0.08 * (a * out + b * np.cross(up, out)) for a, b in SQUARE],
                *("slider", True),
            ),
            draw.Distance("s", -0.3 * y, s * up - 0.3 * y),
            draw.Angle("ψ", 0.0 * up, x, y, turn, 0.45),
            draw.Arrow("g", -0.36 * x - 0.26 * y + 0.2 * up, -0.25 * up, frame=False),
        ]
        for i, (side, angle) in enumerate(zip((1, -1), angles, strict=True)):
            hinge, level = beam[i], side * out
            along = np.cos(angle) * level - np.sin(angle) * up
            ball, hook = hinge + self.center * along, hinge + self.attachment * along
            parts += [
                draw.Body((hinge, ball), f"arm {i + 1}"),
                draw.JointMark(hinge, axis=np.cross(level, up)),
            ]
            parts += [
                draw.Disk(ball, np.cross(up, out), 0.09, f"ball {i + 1}", ball=True),
                draw.Trail(ball),
            ]
            parts += [draw.SpringMark(slider + self.hinge * level, hook, "spring" if i else "")]
            parts += [draw.Angle(f"θ_{i + 1}", hinge, level, -up, angle, 0.3)]
        return draw.Sketch(tuple(parts), azimuth=-0.95, elevation=0.3)
