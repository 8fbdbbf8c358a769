"""Andrews' squeezing mechanism: seven bodies in the plane, three closed loops, a motor, a spring.

Bodies K1 .. K7 turn about joints. K1, K3, K5 and K7 are pinned to the ground (K1 at O, K3 at B, K5
and K7 at A); K2 is pinned to the tip of K1, K4 to that of K5, K6 to that of K7. The tips of K2, K3,
K4 and K6 are one point P. Coordinates are the angles of the joints as published,

    q = [θ, γ, φ, δ, Ω, ε, β],

those of K2 .. K7 and K1: the crank angle β comes last, so that the default generalized speed is β̇.
The published order has ε̇ there, which vanishes wherever crank and coupler are in line. A constant
torque drives K1, a spring from the ground (C) pulls K3, and there is no gravity.

Source: Schiehlen 1990; Hairer and Wanner, Solving Ordinary Differential Equations II, Sec. VII.7;
problem "Andrews' squeezing mechanism" of the Test Set for IVP Solvers (Bari), whose data are the
defaults; A03 of the IFToMM benchmark library.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.descriptions import elements
from eomcheck.descriptions.described_scene import GROUND, Described, Description
from eomcheck.mechanics import sketch as draw
from eomcheck.mechanics.parameters import parameter
from eomcheck.mechanics.records import Range
from eomcheck.numbers.generic import Array

TURNS = {"K1": "β", "K2": "θ", "K5": "δ", "K4": "φ", "K7": "ε", "K6": "Ω", "K3": "γ"}
"""Body -> coordinate of its rotation against its carrier; in depth-first order."""
CARRIERS = {"K2": "K1", "K4": "K5", "K6": "K7"}
"""Body -> body whose tip carries it, if any."""
PINS_OF = {"K1": 0, "K3": 1, "K5": 2, "K7": 2}
"""Body -> index of its pin on the ground: O, B or A."""
NAMES = "θ", "γ", "φ", "δ", "Ω", "ε", "β"
MEETING = "K3", "K4", "K6"
"""Bodies whose tips coincide with that of K2."""


MASS = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
INERTIA = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5
CENTER = (
    *((0.00092, 0.0), (-0.0115, 0.0), (0.01043, -0.01874), (0.0, -0.00579)),
    *((0.02308, 0.00916), (0.00579, 0.0), (-0.00449, -0.01228)),
)
TIP = (
    *((0.007, 0.0), (-0.028, 0.0), (0.0, -0.035), (0.0, -0.02)),
    *((0.04, 0.0), (0.02, 0.0), (0.0, -0.04)),
)
PINS = (0.0, 0.0), (-0.03635, 0.03273), (-0.06934, -0.00227)
POSE = (
    *(0.0, 0.455279819163070380255912382449, 0.222668390165885884674473185609),
    *(0.487364979543842550225598953530, -0.222668390165885884674473185609),
    *(1.23054744454982119249735015568, -0.0617138900142764496358948458001),
)
"""Initial angles of the test set, rad."""


def description(parameters):
    """Return the declarative description of the mechanism."""
    mass, center, tip, pins = parameters.mass, parameters.center, parameters.tip, parameters.pins
    tips = {f"K{k + 1}": (tip[k, 0], tip[k, 1], 0) for k in range(7)}
    links = [elements.Link(f"K{k + 1}", mass[k], (center[k, 0], center[k, 1], 0)) for k in range(7)]
    joints = []
    for body, angle in TURNS.items():
        on = CARRIERS.get(body, GROUND)
        place = tips[on] if on in tips else (*pins[PINS_OF[body]], 0)
        motor = parameters.torque[0] if body == "K1" else None
        joints += [elements.Joint(angle, "revolute", on, body, place, torque=motor)]
    spring = elements.Spring(
        *("spring", "K3", GROUND, (*parameters.hook, 0), (*parameters.anchor, 0)),
        *(parameters.stiffness[0], parameters.rest_length[0]),
    )
    closing = [
        elements.pin(f"K2 at {body}", "K2", body, tips["K2"], tips[body]) for body in MEETING
    ]
    return Description(links, joints, NAMES, closing, [spring], planar=True)


# ---- The scene -----------------------------------------------------------------------------------


class Andrews(Described, description=description, closed=True):
    """Andrews' squeezing mechanism, by default that of the test set, starting from rest.

    Bodies are K1 .. K7 in that order. Points of a body are given from its joint, along axes that
    turn with it: `tip` is the point of K1, K5, K7 that carries the next body and the common point
    of K2, K3, K4, K6.
    """

    mass: Any = parameter("m", "kg", "> 0", (0.001, 0.1), (7,), default=MASS)
    inertia: Any = parameter("I, central", "kg m²", ">= 0", (1e-7, 1e-4), (7,), default=INERTIA)
    center: Any = parameter("centres of mass", "m", shape=(7, 2), default=CENTER)
    tip: Any = parameter("tips", "m", shape=(7, 2), default=TIP)
    pins: Any = parameter("O, B, A", "m", shape=(3, 2), default=PINS)
    hook: Any = parameter("end of the spring on K3", "m", shape=(2,), default=(0.02, -0.018))
    anchor: Any = parameter("its end on the ground", "m", shape=(2,), default=(0.014, 0.072))
    stiffness: Any = parameter("k", "N/m", ">= 0", (0.0, 5000.0), default=4530.0)
    rest_length: Any = parameter("of the spring", "m", ">= 0", (0.0, 0.1), default=0.07785)
    torque: Any = parameter("on K1", "N m", sample_range=(-0.1, 0.1), default=0.033)
    pose: Any = parameter("q at t = 0, at rest", "rad", shape=(7,), default=POSE, read=False)

    key = "andrews"
    named_coordinates = NAMES
    # Crank and coupler turned up to 1 rad.
    coordinate_sample_ranges = (
        *(Range(-1.0, 1.0), Range(0.0, 0.5), Range(-0.5, 0.2), Range(0.48, 0.53)),
        *(Range(-0.2, 0.5), Range(1.04, 1.24), Range(-1.0, 1.0)),
    )
    named_constraints = tuple(f"K2 at {body} along {axis}" for body in MEETING for axis in "xy")
    conserves_energy = True
    angle_coordinates = slice(0, None)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`."""
        return self.pose.copy(), np.zeros(7)

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Andrews, Array]:
        """Return the mechanism with the crank turned away from the coupler."""
        scene = cls()
        return scene, scene.pose + np.array([-0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9])

    def sketch(self, q: Array, t: float = 0.0) -> draw.Sketch:
        """Return the bodies from joint to tip with centres of mass; angles to their x axes."""
        tip: dict[str, Any] = {}
        parts: list[Any] = [
            draw.JointMark(pin, True, name) for pin, name in zip(self.pins, "OBA", strict=True)
        ]
        turn = {GROUND: 0.0}
        for body, name in TURNS.items():
            k, on = int(body[1]) - 1, CARRIERS.get(body, GROUND)
            angle, start = q[NAMES.index(name)], turn[on]
            base = tip[on] if on in tip else self.pins[PINS_OF[body]]
            turn[body] = start + angle
            axes = np.array([draw.direction(turn[body]), draw.direction(turn[body] + np.pi / 2)])
            center, tip[body] = base + self.center[k] @ axes, base + self.tip[k] @ axes
            corners = [base, tip[body]]
            if body == "K3":
                hook = base + self.hook @ axes
                corners = [base, hook, tip[body]]
                parts += [
                    draw.SpringMark(hook, self.anchor, "spring"),
                    draw.JointMark(self.anchor, True, "C"),
                ]
            parts += [draw.Body(corners, body, closed=body == "K3"), draw.Center(center)]
            parts += [] if on == GROUND else [draw.JointMark(base)]
            parts += [draw.plane_angle(name, base, angle, 0.0075, start=start)]
            parts += [draw.Arrow("", base, 0.0085 * axes[0])]
        parts += [draw.JointMark(tip["K2"], name="P"), draw.Trail(tip["K2"])]
        parts += [draw.ConstraintMark("P closes three loops", tip["K2"], tuple(range(6)))]
        for k, body in enumerate(MEETING):
            parts += [draw.Closing(tip["K2"], tip[body], (2 * k, 2 * k + 1))]
        return draw.Sketch(tuple(parts), **draw.UPRIGHT)
