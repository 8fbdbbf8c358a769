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

Source: Meijaard et al. 2007, whose benchmark gives the defaults; Basu-Mandal et al. 2007.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from eomcheck.arithmetic.generic import generic
from eomcheck.arithmetic.linear import EPS
from eomcheck.errors import InputError, RefusedError
from eomcheck.model import Arithmetic, Array, Range, Symmetry
from eomcheck.scenes import plane
from eomcheck.scenes.assembled import Assembled, Jacobians, gyroscopic_moments
from eomcheck.scenes.fields import as_code, set_array
from eomcheck.scenes.space import (
    along,
    combined,
    cross,
    plane_of,
    rotated,
    swing,
    turn,
)

REAR, FRAME, FORK, FRONT = range(4)
"""Bodies: rear wheel, rear frame with the rider, front frame, front wheel."""
HEIGHT, HEADING, PITCH, FRONT_SPIN, LEAN, STEER, REAR_SPIN = range(2, 9)
"""Coordinates z, θ, φ, β_f, ψ, ψ_f, β_r."""
JOINT = HEADING, LEAN, PITCH, STEER, REAR_SPIN, FRONT_SPIN
"""Coordinate that turns about each of the axes k, h, b_3, the steering axis, b_3, g_3."""
STEERING = 3
"""The steering axis among them."""
TURNS = (
    *((REAR, 0), (REAR, 1), (REAR, 2), (REAR, 4)),
    *((FRAME, 0), (FRAME, 1), (FRAME, 2)),
    *((FORK, 0), (FORK, 1), (FORK, 2), (FORK, STEERING)),
    *((FRONT, 0), (FRONT, 1), (FRONT, 2), (FRONT, STEERING), (FRONT, 5)),
)
"""Bodies with the axes about which they turn, each carried by those before it."""
WHEEL = REAR, FRONT
"""Wheel -> body."""
ROW = (0, 1, 2), (5, 3, 4)
"""Wheel -> its constraints along h, across it to its left, and up. Taken in their order,
with the first velocities dependent, elimination divides by nothing small for a bicycle that stands,
also where it cannot choose (expressions)."""


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


class Prepared(NamedTuple):
    """What is not rational in q; each of shape (1,) but cos and sin."""

    cos: Any
    """Of the coordinates (9,), those of x, y, z meaningless."""
    sin: Any
    """Likewise."""
    tilt_cos: Any
    tilt_sin: Any
    upright: Any
    """Length of the vertical seen in the plane of the front wheel, 1 where it is upright."""


@generic
def steered(prepared, sin, vector):
    """Return the components along g of a vector (3,) along b; back with -sin ψ_f for sin ψ_f."""
    cos, c, s = prepared.cos[STEER], prepared.tilt_cos[0], prepared.tilt_sin[0]
    ahead, down = c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
    turned = cos * ahead + sin * vector[2]
    result = np.zeros(3, vector.dtype)
    result[0], result[1] = c * turned + s * down, c * down - s * turned
    result[2] = cos * vector[2] - sin * ahead
    return result


@generic
def vertical(prepared):
    """Return k along b (3,)."""
    cos, sin = prepared.cos, prepared.sin
    k = np.zeros(3, cos.dtype)
    k[0], k[1] = sin[LEAN] * sin[PITCH], sin[LEAN] * cos[PITCH]
    k[2] = cos[LEAN]
    return k


@generic
def prepare(arithmetic, parameters, q, t):
    """Return the `Prepared` at q (9,)."""
    angles, tilt = arithmetic.angles(q), arithmetic.angles(parameters.tilt)
    still = Prepared(angles.cos, angles.sin, tilt.cos, tilt.sin, tilt.cos)
    k = steered(still, angles.sin[STEER], vertical(still))
    square = np.zeros(1, k.dtype)
    square[0] = k[0] * k[0] + k[1] * k[1]
    return Prepared(angles.cos, angles.sin, tilt.cos, tilt.sin, arithmetic.root(square))


# ---- How the bodies move, along axes that do not turn --------------------------------------------


class Pose(NamedTuple):
    """Where everything is, along x, y, z."""

    axes: Any
    """Of the joints (6, 3)."""
    directions: Any
    """b for rear wheel and rear frame, g for the front (4, 3, 3)."""
    rear_arm: Any
    """From the centre of the rear wheel to a centre of mass, as far as the rear frame goes: to
    the steering axis for what is steered (4, 3), m."""
    front_arm: Any
    """From there on (4, 3), m."""
    contact: Any
    """From the wheels' centres to the ground (2, 3), m."""


@generic
def posed(parameters, prepared):
    """Return the `Pose`."""
    cos, sin = prepared.cos, prepared.sin
    tilt_cos, tilt_sin = prepared.tilt_cos[0], prepared.tilt_sin[0]
    axes, directions = np.zeros((6, 3), cos.dtype), np.zeros((4, 3, 3), cos.dtype)
    left = np.zeros(3, cos.dtype)
    axes[0, 2] = 1
    axes[1, 0], axes[1, 1] = cos[HEADING], sin[HEADING]
    left[0], left[1] = -sin[HEADING], cos[HEADING]
    up, across = plane_of(left, axes[0], cos[LEAN], sin[LEAN])
    ahead, down = plane_of(axes[1], up, cos[PITCH], sin[PITCH])
    # The steering axis is tilted back against down; the fork turns about it, upwards.
    below, forwards = plane_of(down, ahead, tilt_cos, tilt_sin)
    forwards, axle = plane_of(forwards, across, cos[STEER], sin[STEER])
    axes[2] = axes[4] = across
    axes[3], axes[5] = -below, axle
    forward, downward = plane_of(forwards, below, tilt_cos, tilt_sin)
    for k in range(2):
        directions[k, 0], directions[k, 1], directions[k, 2] = ahead, down, across
        directions[2 + k, 0], directions[2 + k, 1], directions[2 + k, 2] = forward, downward, axle
    rear_arm, front_arm = np.zeros((4, 3), cos.dtype), np.zeros((4, 3), cos.dtype)
    rear_arm[FRAME] = combined(parameters.rider[0], ahead, parameters.rider[1], down)
    pivot = combined(parameters.pivot[0], ahead, parameters.pivot[1], down)
    rear_arm[FORK] = rear_arm[FRONT] = pivot
    g = directions[FORK]
    front_arm[FORK] = combined(parameters.fork[0], g[0], parameters.fork[1], g[1])
    front_arm[FRONT] = combined(parameters.hub[0], g[0], parameters.hub[1], g[1])
    contact = np.zeros((2, 3), cos.dtype)
    shorter = parameters.radius[1] / prepared.upright[0]
    for i in range(3):
        contact[0, i] = -parameters.radius[0] * up[i]
    contact[1] = combined(shorter * axle[2], axle, -shorter, axes[0])
    return Pose(axes, directions, rear_arm, front_arm, contact)


@generic
def columns(pose):
    """Return ∂V_k/∂v and ∂ω_k/∂v (4, 3, 9) along x, y, z, V_k of the centres of mass."""
    axes, to_front = pose.axes, pose.front_arm
    linear, angular = np.zeros((4, 3, 9), axes.dtype), np.zeros((4, 3, 9), axes.dtype)
    for k in range(4):
        for i in range(3):
            linear[k, i, i] = 1
        for j in range(STEERING):
            linear[k, :, JOINT[j]] = cross(axes[j], pose.rear_arm[k] + to_front[k])
    for k in range(FORK, 4):
        linear[k, :, STEER] = cross(axes[STEERING], to_front[k])
    for k, j in TURNS:
        angular[k, :, JOINT[j]] = axes[j]
    return linear, angular


@generic
def turning(pose, v):
    """Return ω of the bodies (4, 3) and ω̇ at v̇ = 0 (4, 3), along x, y, z."""
    omega, alpha = np.zeros((4, 3), v.dtype), np.zeros((4, 3), v.dtype)
    for k, j in TURNS:
        turn(omega[k], alpha[k], pose.axes[j], v[JOINT[j]])
    return omega, alpha


@generic
def accelerations(pose, omega, alpha):
    """Return the accelerations of the centres of mass at v̇ = 0 (4, 3), along x, y, z."""
    rest = np.zeros((4, 3), omega.dtype)
    for k in range(FRAME, 4):
        rest[k] = swing(omega[FRAME], alpha[FRAME], pose.rear_arm[k]) + swing(
            omega[FORK], alpha[FORK], pose.front_arm[k]
        )
    return rest


@generic
def jacobians(parameters, prepared, q, v):
    """Return the `Jacobians`: V along x, y, z, ω along b or g."""
    pose = posed(parameters, prepared)
    linear, turned = columns(pose)
    omega, alpha = turning(pose, v)
    angular = np.zeros((4, 3, 9), v.dtype)
    for j in range(9):
        angular[:, :, j] = along(pose.directions, turned[:, :, j])
    gyroscopic = gyroscopic_moments(parameters.inertia, along(pose.directions, omega))
    rest = accelerations(pose, omega, alpha)
    return Jacobians(linear, angular, rest, along(pose.directions, alpha), gyroscopic)


@generic
def seen_from_heading(prepared, vector):
    """Return the components along h, across it and up (3,) of a vector along x, y, z."""
    result = vector + 0
    rotated(result, 0, 1, prepared.cos[HEADING], prepared.sin[HEADING])
    return result


@generic
def constraints(parameters, prepared, q):
    """Return (a (6, 9), None): what of a wheel touches the ground does not move."""
    pose = posed(parameters, prepared)
    linear, angular = columns(pose)
    a = np.zeros((6, 9), q.dtype)
    for wheel in range(2):
        k = WHEEL[wheel]
        for j in range(9):
            touching = linear[k, :, j] + cross(angular[k, :, j], pose.contact[wheel])
            slip = seen_from_heading(prepared, touching)
            for i in range(3):
                a[ROW[wheel][i], j] = slip[i]
    return a, None


@generic
def drift(parameters, prepared, q, v):
    """Return gamma (6,): the point of contact wanders along the rim, the directions turn."""
    pose = posed(parameters, prepared)
    omega, alpha = turning(pose, v)
    rest = accelerations(pose, omega, alpha)
    wandering = np.zeros((2, 3), v.dtype)
    leaning = combined(1, omega[FRAME], -v[PITCH], pose.axes[2])
    wandering[0] = cross(leaning, pose.contact[0])
    axle, upright = pose.axes[5], prepared.upright[0]
    rate, shorter = cross(omega[FORK], axle), parameters.radius[1] / upright
    wandering[1] = combined(shorter * rate[2], axle, shorter * axle[2], rate)
    lengthening = axle[2] * rate[2] / (upright * upright)
    wandering[1] = combined(1, wandering[1], lengthening, pose.contact[1])
    gamma = np.zeros(6, v.dtype)
    for wheel in range(2):
        k = WHEEL[wheel]
        V = v[:3] + cross(omega[FRAME], pose.rear_arm[k]) + cross(omega[FORK], pose.front_arm[k])
        slip = seen_from_heading(prepared, V + cross(omega[k], pose.contact[wheel]))
        changing = cross(alpha[k], pose.contact[wheel]) + cross(omega[k], wandering[wheel])
        change = seen_from_heading(prepared, rest[k] + changing)
        gamma[ROW[wheel][0]] = change[0] + v[HEADING] * slip[1]
        gamma[ROW[wheel][1]] = change[1] - v[HEADING] * slip[0]
        gamma[ROW[wheel][2]] = change[2]
    return gamma


@generic
def forces(parameters, prepared, q, v):
    """Return Q (9,) of gravity."""
    linear, _ = columns(posed(parameters, prepared))
    Q = np.zeros(9, q.dtype)
    for k in range(4):
        weight = parameters.mass[k] * parameters.gravity[0]
        for j in range(9):
            Q[j] -= weight * linear[k, 2, j]
    return Q


# ---- The second derivation: from body to body, along axes that turn ------------------------------


@generic
def moved_on(V, omega, point):
    """Return the velocity (3,) of a point (2,) of the plane of a frame, V being that of another."""
    result = V + 0
    result[0] -= omega[2] * point[1]
    result[1] += omega[2] * point[0]
    result[2] += omega[0] * point[1] - omega[1] * point[0]
    return result


@generic
def moving(parameters, prepared, v):
    """Return the velocities of the centres of mass (4, 3) and of rotation (4, 3), along b or g."""
    cos, sin = prepared.cos, prepared.sin
    V, omega = np.zeros((4, 3), v.dtype), np.zeros((4, 3), v.dtype)
    V[REAR] = v[:3]
    rotated(V[REAR], 0, 1, cos[HEADING], sin[HEADING])
    rotated(V[REAR], 1, 2, cos[LEAN], sin[LEAN])
    rotated(V[REAR], 0, 1, cos[PITCH], sin[PITCH])
    k = vertical(prepared)
    for i in range(3):
        omega[FRAME, i] = v[HEADING] * k[i]
    omega[FRAME, 0] += v[LEAN] * cos[PITCH]
    omega[FRAME, 1] -= v[LEAN] * sin[PITCH]
    omega[FRAME, 2] += v[PITCH]
    V[FRAME] = moved_on(V[REAR], omega[FRAME], parameters.rider)
    pivot = steered(prepared, sin[STEER], moved_on(V[REAR], omega[FRAME], parameters.pivot))
    omega[FORK] = steered(prepared, sin[STEER], omega[FRAME])
    omega[FORK, 0] -= v[STEER] * prepared.tilt_sin[0]
    omega[FORK, 1] -= v[STEER] * prepared.tilt_cos[0]
    V[FORK] = moved_on(pivot, omega[FORK], parameters.fork)
    V[FRONT] = moved_on(pivot, omega[FORK], parameters.hub)
    omega[REAR], omega[FRONT] = omega[FRAME], omega[FORK]
    omega[REAR, 2] += v[REAR_SPIN]
    omega[FRONT, 2] += v[FRONT_SPIN]
    return V, omega


@generic
def level(prepared, vector):
    """Return the components along h, across it and up (3,) of a vector along b."""
    cos, sin, result = prepared.cos, prepared.sin, vector + 0
    rotated(result, 0, 1, cos[PITCH], -sin[PITCH])
    rotated(result, 1, 2, cos[LEAN], -sin[LEAN])
    return result


@generic
def velocities(parameters, prepared, q, v):
    """Return V along x, y, z and ω along axes of the body, which turn with a wheel, (4, 3) each."""
    V, omega = moving(parameters, prepared, v)
    for k in range(FORK, 4):
        V[k] = steered(prepared, -prepared.sin[STEER], V[k])
    for k in range(4):
        V[k] = level(prepared, V[k])
        rotated(V[k], 0, 1, prepared.cos[HEADING], -prepared.sin[HEADING])
    rotated(omega[REAR], 0, 1, prepared.cos[REAR_SPIN], prepared.sin[REAR_SPIN])
    rotated(omega[FRONT], 0, 1, prepared.cos[FRONT_SPIN], prepared.sin[FRONT_SPIN])
    return V, omega


@generic
def constraint(parameters, prepared, q, v):
    """Return c (6,), m/s: velocities of what touches the ground, along h, across it and up."""
    cos, sin, radius = prepared.cos, prepared.sin, parameters.radius
    V, omega = moving(parameters, prepared, v)
    k = steered(prepared, sin[STEER], vertical(prepared))
    c, rim = np.zeros(6, v.dtype), np.zeros((2, 2), v.dtype)
    rim[0, 0], rim[0, 1] = -radius[0] * sin[PITCH], -radius[0] * cos[PITCH]
    for i in range(2):
        rim[1, i] = -radius[1] * k[i] / prepared.upright[0]
    slip = np.zeros((2, 3), v.dtype)
    for wheel in range(2):
        body = WHEEL[wheel]
        slip[wheel] = moved_on(V[body], omega[body], rim[wheel])
    slip[1] = steered(prepared, -sin[STEER], slip[1])
    for wheel in range(2):
        touching = level(prepared, slip[wheel])
        for i in range(3):
            c[ROW[wheel][i]] = touching[i]
    return c


@generic
def above(parameters, prepared):
    """Return how much higher than the centre of the rear wheel the centres of mass are (4,), m."""
    k = vertical(prepared)
    g = steered(prepared, prepared.sin[STEER], k)
    rider, pivot, fork, hub = parameters.rider, parameters.pivot, parameters.fork, parameters.hub
    height = np.zeros(4, k.dtype)
    height[FRAME] = k[0] * rider[0] + k[1] * rider[1]
    height[FORK] = height[FRONT] = k[0] * pivot[0] + k[1] * pivot[1]
    height[FORK] += g[0] * fork[0] + g[1] * fork[1]
    height[FRONT] += g[0] * hub[0] + g[1] * hub[1]
    return height


@generic
def potential(parameters, prepared, q):
    """Return U, J."""
    height = above(parameters, prepared)
    U = 0
    for k in range(4):
        U += parameters.gravity[0] * parameters.mass[k] * (q[HEIGHT] + height[k])
    return U


@generic
def position_residual(parameters, prepared, q):
    """Return how high the lowest points of the wheels are (2,), m, for sin ψ > 0."""
    gap = np.zeros(2, q.dtype)
    gap[0] = q[HEIGHT] - parameters.radius[0] * prepared.sin[LEAN]
    gap[1] = q[HEIGHT] - parameters.radius[1] * prepared.upright[0]
    gap[1] += above(parameters, prepared)[FRONT]
    return gap


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Bicycle(Assembled):
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

    wheelbase: Any = 1.02
    trail: Any = 0.08
    tilt: Any = np.pi / 10
    radius: Any = (0.3, 0.35)
    mass: Any = (2.0, 85.0, 4.0, 3.0)
    center: Any = ((0.3, -0.9), (0.9, -0.7))
    wheels: Any = ((0.0603, 0.12), (0.1405, 0.28))
    frames: Any = ((9.2, 11.0, 2.8, 2.4), (0.05892, 0.06, 0.00708, -0.00756))
    gravity: Any = 9.81
    speed: Any = 4.6
    lean_rate: Any = 0.5

    key = "bicycle"
    conserves_energy = True
    angle_coordinates = slice(HEADING, None)
    holonomic = slice(2, 5, 2)

    prepare = staticmethod(prepare)
    jacobians = staticmethod(jacobians)
    forces = staticmethod(forces)
    constraints = staticmethod(constraints)
    drift = staticmethod(drift)
    velocities = staticmethod(velocities)
    potential = staticmethod(potential)
    constraint = staticmethod(constraint)
    position_residual = staticmethod(position_residual)

    def __post_init__(self):
        set_array(self, "wheelbase", (), "positive")
        set_array(self, "trail", ())
        set_array(self, "tilt", ())
        if abs(self.tilt) >= np.pi / 2:
            raise InputError(f"tilt = {self.tilt}, expected less than π/2 to either side")
        set_array(self, "radius", (2,), "positive")
        set_array(self, "mass", (4,), "positive")
        set_array(self, "center", (2, 2))
        set_array(self, "wheels", (2, 2), "positive")
        set_array(self, "frames", (2, 4))
        for i, (ahead, right, down, product) in enumerate(self.frames):
            if min(ahead, right, down) <= 0 or ahead * down <= product**2:
                raise InputError(
                    f"frames[{i}] = {self.frames[i].tolist()}, expected positive moments of "
                    "inertia and a product of inertia below the root of theirs"
                )
        set_array(self, "gravity", (), "not negative")
        set_array(self, "speed", ())
        set_array(self, "lean_rate", ())

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return what ordinary bicycles are drawn from."""
        return {
            "wheelbase": Range(0.8, 1.5),
            "trail": Range(-0.1, 0.2),
            "tilt": Range(-0.2, 0.5),
            "radius": Range(0.2, 0.5, (2,)),
            "mass": Range(1.0, 100.0, (4,)),
            "center": Range(-1.0, 1.0, (2, 2)),
            "wheels": Range(0.01, 1.0, (2, 2)),
            "gravity": Range(0.0, 20.0),
        }

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return up to 10 m, any heading and spins, 0.8 rad of lean and of steering."""
        anywhere, any_angle = Range(-10.0, 10.0), Range(-np.pi, np.pi)
        pitch, lean = Range(np.pi - 0.2, np.pi + 0.2), Range(np.pi / 2 - 0.8, np.pi / 2 + 0.8)
        height = Range(0.1, 0.5)
        return (
            *(anywhere, anywhere, height, any_angle, pitch),
            *(any_angle, lean, Range(-0.8, 0.8), any_angle),
        )

    def __repr__(self) -> str:
        return as_code(self)

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """x, y, z, θ, φ, β_f, ψ, ψ_f, β_r."""
        return "x", "y", "z", "θ", "φ", "β_f", "ψ", "ψ_f", "β_r"

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Rear wheel along h, across it, up, front wheel across, up, along."""
        rear = (f"rear wheel {way}" for way in ("along", "across", "up"))
        front = (f"front wheel {way}" for way in ("across", "up", "along"))
        return *rear, *front

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        number = arithmetic.numbers
        wheelbase, trail, radius = (
            number(self.wheelbase.reshape(1)),
            number(self.trail.reshape(1)),
            number(self.radius),
        )
        center, wheels, frames = (
            number(self.center),
            number(self.wheels),
            number(self.frames),
        )
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
        pivot[0], pivot[1] = wheelbase[0] + trail[0], radius[0]
        fork[0], fork[1] = center[1, 0] - pivot[0], center[1, 1]
        hub[0], hub[1] = -trail[0], -radius[1]
        tilt, gravity = number(self.tilt.reshape(1)), number(self.gravity.reshape(1))
        mass = number(self.mass)
        return Parameters(mass, inertia, radius, tilt, rider, pivot, fork, hub, gravity)

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
