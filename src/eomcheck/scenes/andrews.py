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

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.assembled import Assembled, Jacobians
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Range, Tree
from eomcheck.numbers.contract import Arithmetic, Array
from eomcheck.numbers.generic import generic

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


class Parameters(NamedTuple):
    """The parameters of an `Andrews` in some kind of number."""

    mass: Any
    """(7,), kg."""
    inertia: Any
    """About the centres of mass (7, 1, 1), kg m²."""
    center: Any
    """Centres of mass, from the joint, along axes of the body (7, 2), m."""
    tip: Any
    """Where the next body hangs or bodies meet, likewise (7, 2), m."""
    pins: Any
    """O, B, A (3, 2), m."""
    hook: Any
    """End of the spring on K3, likewise (2,), m."""
    anchor: Any
    """End of the spring on the ground, C (2,), m."""
    stiffness: Any
    """(1,), N/m."""
    rest_length: Any
    """(1,), m."""
    torque: Any
    """On K1 (1,), N m."""


class Prepared(NamedTuple):
    """What is not rational in q."""

    cos: Any
    """Of the directions of the bodies (7,)."""
    sin: Any
    """Likewise (7,)."""
    spring: Any
    """Length of the spring (1,), m."""


@generic
def carriers(k):
    """Return the bodies between body k and the ground, to loop over: one or none."""
    return range(CARRIER[k], CARRIER[k] + CARRIED[k])


@generic
def turned(cos, sin, point):
    """Return a point (2,) of a body as seen from its joint, along axes that do not turn."""
    return cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]


@generic
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


@generic
def stretch(parameters, cos, sin):
    """Return the spring as a vector (x, y) from C to K3, and its end on K3 as seen from B, m."""
    x, y = turned(cos[ROCKER], sin[ROCKER], parameters.hook)
    base, anchor = parameters.pins[PIN[ROCKER]], parameters.anchor
    return base[0] + x - anchor[0], base[1] + y - anchor[1], x, y


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Prepared` at q (7,)."""
    cos, sin = directions(arithmetic.angles(q))
    x, y, _, _ = stretch(parameters, cos, sin)
    square = np.zeros(1, cos.dtype)
    square[0] = x * x + y * y
    return Prepared(cos, sin, arithmetic.root(square))


# ---- How points of the bodies move ---------------------------------------------------------------


@generic
def add_columns(J, sign, parameters, prepared, k, point):
    """Add ∂(a point of body k)/∂q to J (2, 7), or take it off, by sign."""
    x, y = turned(prepared.cos[k], prepared.sin[k], point)
    J[0, JOINT[k]] -= sign * y
    J[1, JOINT[k]] += sign * x
    for on in carriers(k):
        tip_x, tip_y = turned(prepared.cos[on], prepared.sin[on], parameters.tip[on])
        J[0, JOINT[on]] -= sign * (tip_y + y)
        J[1, JOINT[on]] += sign * (tip_x + x)


@generic
def rate_of_turn(k, v):
    """Return how fast body k turns, rad/s."""
    rate = v[JOINT[k]]
    for on in carriers(k):
        rate = rate + v[JOINT[on]]
    return rate


@generic
def point_rest(parameters, prepared, k, point, v):
    """Return the acceleration of a point of body k at v̇ = 0, along x and along y."""
    omega = rate_of_turn(k, v)
    x, y = turned(prepared.cos[k], prepared.sin[k], point)
    ahead, left = -omega * omega * x, -omega * omega * y
    for on in carriers(k):
        tip_x, tip_y = turned(prepared.cos[on], prepared.sin[on], parameters.tip[on])
        carried = v[JOINT[on]]
        ahead -= carried * carried * tip_x
        left -= carried * carried * tip_y
    return ahead, left


@generic
def jacobians(parameters, prepared, q, v):
    """Return the `Jacobians`."""
    linear, angular = np.zeros((7, 2, 7), q.dtype), np.zeros((7, 1, 7), q.dtype)
    rest, still = np.zeros((7, 2), q.dtype), np.zeros((7, 1), q.dtype)
    for k in range(7):
        center = parameters.center[k]
        add_columns(linear[k], 1, parameters, prepared, k, center)
        rest[k, 0], rest[k, 1] = point_rest(parameters, prepared, k, center, v)
        angular[k, 0, JOINT[k]] = 1
        for on in carriers(k):
            angular[k, 0, JOINT[on]] = 1
    return Jacobians(linear, angular, rest, still, None)


@generic
def constraints(parameters, prepared, q):
    """Return (a (6, 7), None): the tip of K2 moves with those of K3, K4 and K6."""
    a = np.zeros((6, 7), q.dtype)
    for i in range(3):
        rows = a[2 * i : 2 * i + 2]
        other = MEETING[i]
        add_columns(rows, 1, parameters, prepared, COUPLER, parameters.tip[COUPLER])
        add_columns(rows, -1, parameters, prepared, other, parameters.tip[other])
    return a, None


@generic
def drift(parameters, prepared, q, v):
    """Return gamma (6,)."""
    gamma = np.zeros(6, q.dtype)
    tip = parameters.tip
    x, y = point_rest(parameters, prepared, COUPLER, tip[COUPLER], v)
    for i in range(3):
        other_x, other_y = point_rest(parameters, prepared, MEETING[i], tip[MEETING[i]], v)
        gamma[2 * i], gamma[2 * i + 1] = x - other_x, y - other_y
    return gamma


@generic
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


@generic
def position(parameters, prepared, k, point):
    """Return where a point of body k is, along x and along y."""
    x, y = turned(prepared.cos[k], prepared.sin[k], point)
    pin = parameters.pins[PIN[k]]
    ahead, left = pin[0] + x, pin[1] + y
    for on in carriers(k):
        tip_x, tip_y = turned(prepared.cos[on], prepared.sin[on], parameters.tip[on])
        ahead, left = ahead + tip_x, left + tip_y
    return ahead, left


@generic
def point_velocity(parameters, prepared, k, point, v):
    """Return how fast a point of body k moves, along x and along y: ω × r from joint to joint."""
    omega = rate_of_turn(k, v)
    x, y = turned(prepared.cos[k], prepared.sin[k], point)
    ahead, left = -omega * y, omega * x
    for on in carriers(k):
        carrying = rate_of_turn(on, v)
        tip_x, tip_y = turned(prepared.cos[on], prepared.sin[on], parameters.tip[on])
        ahead, left = ahead - carrying * tip_y, left + carrying * tip_x
    return ahead, left


@generic
def velocities(parameters, prepared, q, v):
    """Return the velocities of the centres of mass (7, 2) and of rotation (7, 1)."""
    V, omega = np.zeros((7, 2), v.dtype), np.zeros((7, 1), v.dtype)
    for k in range(7):
        V[k, 0], V[k, 1] = point_velocity(parameters, prepared, k, parameters.center[k], v)
        omega[k, 0] = rate_of_turn(k, v)
    return V, omega


@generic
def potential(parameters, prepared, q):
    """Return U, J, of the spring and of the constant torque."""
    longer = prepared.spring[0] - parameters.rest_length[0]
    return parameters.stiffness[0] * longer * longer / 2 - parameters.torque[0] * q[CRANK]


@generic
def constraint(parameters, prepared, q, v):
    """Return c (6,), m/s: how the tip of K2 moves against those of K3, K4 and K6."""
    c = np.zeros(6, v.dtype)
    tip = parameters.tip
    x, y = point_velocity(parameters, prepared, COUPLER, tip[COUPLER], v)
    for i in range(3):
        other_x, other_y = point_velocity(parameters, prepared, MEETING[i], tip[MEETING[i]], v)
        c[2 * i], c[2 * i + 1] = x - other_x, y - other_y
    return c


@generic
def position_residual(parameters, prepared, q):
    """Return how far the tip of K2 is from those of K3, K4 and K6 (6,), m."""
    gap = np.zeros(6, q.dtype)
    x, y = position(parameters, prepared, COUPLER, parameters.tip[COUPLER])
    for i in range(3):
        other = MEETING[i]
        other_x, other_y = position(parameters, prepared, other, parameters.tip[other])
        gap[2 * i], gap[2 * i + 1] = x - other_x, y - other_y
    return gap


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Andrews(Parametric, Assembled, functions=globals()):
    """Andrews' squeezing mechanism, by default that of the test set, starting from rest.

    Bodies are K1 .. K7 in that order. Points of a body are given from its joint, along axes that
    turn with it.

    Args:
        mass: (7,), kg, positive.
        inertia: about the centres of mass (7,), kg m², not negative.
        center: centres of mass (7, 2), m.
        tip: where K1, K5, K7 carry the next body and K2, K3, K4, K6 meet (7, 2), m.
        pins: O, B, A (3, 2), m.
        hook: end of the spring on K3 (2,), m.
        anchor: its end on the ground (2,), m.
        stiffness: of the spring, N/m, not negative.
        rest_length: of the spring, m, not negative.
        torque: on K1, N m.
        pose: q at t = 0 (7,), rad, where it starts from rest.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    mass: Any = parameter(
        (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498),
        "positive",
        (7,),
        drawn=Range(0.001, 0.1),
    )
    inertia: Any = parameter(
        (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5),
        "not negative",
        (7,),
        drawn=Range(1e-7, 1e-4),
    )
    center: Any = parameter(
        (
            (0.00092, 0.0),
            (-0.0115, 0.0),
            (0.01043, -0.01874),
            (0.0, -0.00579),
            (0.02308, 0.00916),
            (0.00579, 0.0),
            (-0.00449, -0.01228),
        ),
        shape=(7, 2),
    )
    tip: Any = parameter(
        (
            (0.007, 0.0),
            (-0.028, 0.0),
            (0.0, -0.035),
            (0.0, -0.02),
            (0.04, 0.0),
            (0.02, 0.0),
            (0.0, -0.04),
        ),
        shape=(7, 2),
    )
    pins: Any = parameter(((0.0, 0.0), (-0.03635, 0.03273), (-0.06934, -0.00227)), shape=(3, 2))
    hook: Any = parameter((0.02, -0.018), shape=(2,))
    anchor: Any = parameter((0.014, 0.072), shape=(2,))
    stiffness: Any = parameter(4530.0, "not negative", drawn=Range(0.0, 5000.0))
    rest_length: Any = parameter(0.07785, "not negative", drawn=Range(0.0, 0.1))
    torque: Any = parameter(0.033, drawn=Range(-0.1, 0.1))
    pose: Any = parameter(
        (
            0.0,
            0.455279819163070380255912382449,
            0.222668390165885884674473185609,
            0.487364979543842550225598953530,
            -0.222668390165885884674473185609,
            1.23054744454982119249735015568,
            -0.0617138900142764496358948458001,
        ),
        shape=(7,),
    )

    key = "andrews"
    named_coordinates = "θ", "γ", "φ", "δ", "Ω", "ε", "β"
    conserves_energy = True
    angle_coordinates = slice(0, None)

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return where closed positions are looked for: crank and coupler turned up to 1 rad."""
        turned = Range(-1.0, 1.0)
        others = ((0.0, 0.5), (-0.5, 0.2), (0.48, 0.53), (-0.2, 0.5), (1.04, 1.24))
        return turned, *(Range(low, high) for low, high in others), turned

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """K2 against K3, K4 and K6, along x and y."""
        return tuple(f"K2 at K{k + 1} along {axis}" for k in MEETING for axis in "xy")

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        inertia = arithmetic.numbers(self.inertia.reshape(7, 1, 1))
        return self.in_numbers(arithmetic, Parameters, inertia=inertia)

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
        return Tree(
            parent=tuple(order.index(CARRIER[k]) if CARRIED[k] else -1 for k in order),
            joint=("rz",) * 7,
            offset=offset,
            mass=self.mass[[*order]],
            center=center,
            inertia=self.inertia[[*order]],
            coordinates=np.eye(7)[[JOINT[k] for k in order]],
        )
