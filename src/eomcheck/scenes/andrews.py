"""Andrews' squeezing mechanism: seven bodies in the plane, three closed loops, a motor, a spring.

Bodies K1 .. K7 turn about joints. K1, K3, K5 and K7 are pinned to the ground (K1 at O, K3 at B, K5
and K7 at A); K2 hangs on the tip of K1, K4 on that of K5, K6 on that of K7. The tips of K2, K3, K4
and K6 are one point P. Coordinates are the angles of the joints as published,

    q = [θ, γ, φ, δ, Ω, ε, β],

those of K2 .. K7 and K1: the crank angle β comes last, so that the default generalized speed is β̇.
The published order has ε̇ there, which vanishes wherever crank and coupler are in line. A constant
torque drives K1, a spring from the ground (C) pulls K3, and there is no gravity.

Source: Schiehlen 1990; Hairer and Wanner, Solving Ordinary Differential Equations II, Sec. VII.7;
problem "Andrews' squeezing mechanism" of the Test Set for IVP Solvers (Bari), whose data are the
defaults; A03 of the IFToMM benchmark library.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.linkage import (
    Arm,
    backwards,
    closing,
    closing_drift,
    moving,
    pinned_jacobians,
    place,
    rate_of_turn,
)
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.sketch import (
    Arrow,
    Body,
    Center,
    Constraint,
    Joint,
    Sketch,
    Spring,
    Trail,
    direction,
    turned_by,
)
from eomcheck.mechanics.tree import Tree, planar_tree
from eomcheck.numbers.contract import Array

JOINT = 6, 0, 1, 2, 3, 4, 5
"""Body -> coordinate that turns it against what it is pinned to."""
CARRIER = 0, 0, 0, 4, 0, 6, 0
"""Body -> body whose tip carries it, if one does."""
CARRIED = 0, 1, 0, 1, 0, 1, 0
"""Body -> number of bodies between it and the ground."""
PIN = 0, 0, 1, 2, 2, 2, 2
"""Body -> pin on the ground from which it is reached: O, B or A."""
MEETING = 2, 3, 5
"""Bodies K3, K4, K6, whose tips meet that of K2."""
COUPLER, ROCKER, CRANK = 1, 2, 6
"""Bodies K2 and K3; the coordinate β."""


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
"""Data of the test set."""


class Prepared(NamedTuple):
    """What is not rational in q."""

    cos: Any
    """Of the directions of the bodies (7,)."""
    sin: Any
    """Likewise (7,)."""
    spring: Any
    """Length of the spring (1,), m."""


def carriers(k):
    """Return the bodies between body k and the ground, to loop over: one or none."""
    return range(CARRIER[k], CARRIER[k] + CARRIED[k])


def turned(cos, sin, point):
    """Return a point (2,) of a body as seen from its joint, along axes that do not turn."""
    return cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]


def directions(angles):
    """Return (cos (7,), sin (7,)) of the directions of the bodies from the `Angles` of joints."""
    cos, sin = np.zeros(7, angles.cos.dtype), np.zeros(7, angles.cos.dtype)
    for k in range(7):
        cos[k], sin[k] = angles.cos[JOINT[k]], angles.sin[JOINT[k]]
    for k in range(7):
        for on in carriers(k):
            across = cos[k], sin[k]
            cos[k], sin[k] = turned(cos[on], sin[on], across)
    return cos, sin


def stretch(parameters, cos, sin):
    """Return the spring as a vector (x, y) from C to K3, and its end on K3 as seen from B, m."""
    x, y = turned(cos[ROCKER], sin[ROCKER], parameters.hook)
    base, anchor = parameters.pins[PIN[ROCKER]], parameters.anchor
    return base[0] + x - anchor[0], base[1] + y - anchor[1], x, y


def prepare(arithmetic, parameters, q, t):
    """Return the `Prepared` at q (7,)."""
    cos, sin = directions(arithmetic.angles(q))
    x, y, _, _ = stretch(parameters, cos, sin)
    square = np.zeros(1, cos.dtype)
    square[0] = x * x + y * y
    return Prepared(cos, sin, arithmetic.root(square))


# ---- How points of the bodies move ---------------------------------------------------------------


def arm(prepared, k, point):
    """Return the `Arm` from the joint of body k to a point of it."""
    x, y = turned(prepared.cos[k], prepared.sin[k], point)
    return Arm(x, y, (JOINT[k], *[JOINT[on] for on in carriers(k)]))


def reach(parameters, prepared, k, point):
    """Return the arms from the ground to a point of body k."""
    tips = [arm(prepared, on, parameters.tip[on]) for on in carriers(k)]
    return [*tips, arm(prepared, k, point)]


def jacobians(parameters, prepared, q, v):
    """Return the `Jacobians`."""
    centers = [reach(parameters, prepared, k, parameters.center[k]) for k in range(7)]
    return pinned_jacobians(centers, v)


def loops(parameters, prepared):
    """Return the arms to the tip of K2 and back from those of K3, K4 and K6."""
    out = reach(parameters, prepared, COUPLER, parameters.tip[COUPLER])
    back = [reach(parameters, prepared, k, parameters.tip[k]) for k in MEETING]
    return [[*out, *backwards(arms)] for arms in back]


def constraints(parameters, prepared, q):
    """Return (a (6, 7), None): the tip of K2 moves with those of K3, K4 and K6."""
    return closing(loops(parameters, prepared), 3, q), None


def drift(parameters, prepared, q, v):
    """Return gamma (6,)."""
    return closing_drift(loops(parameters, prepared), 3, v)


def forces(parameters, prepared, q, v):
    """Return Q (7,): the torque on K1 and the moment of the spring on K3."""
    x, y, arm_x, arm_y = stretch(parameters, prepared.cos, prepared.sin)
    length = prepared.spring[0]
    pull = parameters.stiffness[0] * (length - parameters.rest_length[0]) / length
    Q = np.zeros(7, q.dtype)
    Q[JOINT[ROCKER]] = pull * (x * arm_y - y * arm_x)
    Q[CRANK] = parameters.torque[0]
    return Q


# ---- The second derivation: positions and velocities only ----------------------------------------


def velocities(parameters, prepared, q, v):
    """Return the velocities of the centres of mass (7, 2) and of rotation (7, 1)."""
    arms = [reach(parameters, prepared, k, parameters.center[k]) for k in range(7)]
    omega = [[rate_of_turn(to[-1], v)] for to in arms]
    return np.array([moving(to, v) for to in arms], v.dtype), np.array(omega, v.dtype)


def potential(parameters, prepared, q):
    """Return U, J, of the spring and of the constant torque."""
    longer = prepared.spring[0] - parameters.rest_length[0]
    return parameters.stiffness[0] * longer * longer / 2 - parameters.torque[0] * q[CRANK]


def constraint(parameters, prepared, q, v):
    """Return c (6,), m/s: how the tip of K2 moves against those of K3, K4 and K6."""
    tip = parameters.tip
    V = [moving(reach(parameters, prepared, k, tip[k]), v) for k in (COUPLER, *MEETING)]
    slip = [[V[0][0] - V[i][0], V[0][1] - V[i][1]] for i in range(1, 4)]
    return np.array(slip, v.dtype).reshape(6)


def position_residual(parameters, prepared, q):
    """Return how far the tip of K2 is from those of K3, K4 and K6 (6,), m."""
    tip, dtype = parameters.tip, q.dtype
    at = [place(reach(parameters, prepared, k, tip[k])) for k in (COUPLER, *MEETING)]
    points = np.array(at, dtype) + parameters.pins[[PIN[k] for k in (COUPLER, *MEETING)]]
    return np.concatenate([points[0] - points[i] for i in range(1, 4)])


# ---- The scene -----------------------------------------------------------------------------------


class Andrews(Parametric, functions=globals()):
    """Andrews' squeezing mechanism, by default that of the test set, starting from rest.

    Bodies are K1 .. K7 in that order. Points of a body are given from its joint, along axes that
    turn with it: `tip` is where K1, K5, K7 carry the next body and K2, K3, K4, K6 meet.
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
    torque: Any = parameter("on K1", "N m", drawn=(-0.1, 0.1), default=0.033)
    pose: Any = parameter("q at t = 0, at rest", "rad", shape=(7,), default=POSE, read=False)

    key = "andrews"
    named_coordinates = "θ", "γ", "φ", "δ", "Ω", "ε", "β"
    # Crank and coupler turned up to 1 rad.
    drawn_coordinates = (
        *(Range(-1.0, 1.0), Range(0.0, 0.5), Range(-0.5, 0.2), Range(0.48, 0.53)),
        *(Range(-0.2, 0.5), Range(1.04, 1.24), Range(-1.0, 1.0)),
    )
    named_constraints = tuple(f"K2 at K{k + 1} along {axis}" for k in (2, 3, 5) for axis in "xy")
    conserves_energy = True
    angle_coordinates = slice(0, None)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`."""
        return self.pose.copy(), np.zeros(7)

    def tree(self) -> Tree:
        """Return one RZ a body, what hangs on a body right after it."""
        order = 0, 1, 2, 4, 3, 6, 5
        offset, center = np.zeros((2, 7, 3))
        for j, k in enumerate(order):
            offset[j, :2] = self.tip[CARRIER[k]] if CARRIED[k] else self.pins[PIN[k]]
            center[j, :2] = self.center[k]
        return planar_tree(
            parent=tuple(order.index(CARRIER[k]) if CARRIED[k] else -1 for k in order),
            joint=("rz",) * 7,
            offset=offset,
            mass=self.mass[[*order]],
            center=center,
            inertia=self.inertia[[*order]],
            coordinates=np.eye(7)[[JOINT[k] for k in order]],
        )

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Andrews, Array]:
        """Return the mechanism with the crank turned away from the coupler."""
        scene = cls()
        return scene, scene.pose + np.array([-0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9])

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return the bodies from joint to tip, by their centres of mass; angles to their x axes."""
        turn, base, tip = np.zeros(7), np.zeros((7, 2)), np.zeros((7, 2))
        parts: list[Any] = [
            Joint(pin, True, name) for pin, name in zip(self.pins, "OBA", strict=True)
        ]
        for k in (0, 2, 4, 6, 1, 3, 5):
            on = CARRIER[k] if CARRIED[k] else None
            before = 0.0 if on is None else turn[on]
            base[k] = self.pins[PIN[k]] if on is None else tip[on]
            turn[k] = before + q[JOINT[k]]
            axes = np.array([direction(turn[k]), direction(turn[k] + np.pi / 2)])
            center, tip[k] = base[k] + self.center[k] @ axes, base[k] + self.tip[k] @ axes
            corners = [base[k], tip[k]]
            if k == ROCKER:
                hook = base[k] + self.hook @ axes
                corners = [base[k], hook, tip[k]]
                parts += [Spring(hook, self.anchor, "spring"), Joint(self.anchor, True, "C")]
            parts += [Body(corners, f"K{k + 1}", closed=k == ROCKER), Center(center)]
            parts += [] if on is None else [Joint(base[k])]
            name = self.named_coordinates[JOINT[k]]
            parts += [turned_by(name, base[k], q[JOINT[k]], 0.0075, start=before)]
            parts += [Arrow("", base[k], 0.0085 * axes[0])]
        parts += [Joint(tip[COUPLER], name="P"), Trail(tip[COUPLER])]
        parts += [Constraint("P closes three loops", tip[COUPLER], tuple(range(6)))]
        return Sketch(tuple(parts))
