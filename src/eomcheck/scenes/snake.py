"""The paper's N-link snake robot on passive wheels, sliding nowhere sideways (Sec. 10).

N rigid links in the plane, coupled by torsion springs. Wheel i sits at the centre of mass of link
i, turned by the constant angle α_i against it; q = [x, y, θ_1 .. θ_N], (x, y) the free tip of link
1, θ absolute. Below, per link i: n_i = (-sin θ_i, cos θ_i) is normal to the link, φ_i = α_i + θ_i
the direction in which the wheel rolls, t_i = (cos φ_i, sin φ_i), and e_i = (sin φ_i, -cos φ_i) its
axle (Eq. (28)). The generalized speeds are u = (s_1, ω_1): rolling speed of wheel 1 and angular
velocity of link 1 (Eq. (29)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from eomcheck.arithmetic.generic import generic
from eomcheck.arithmetic.linear import EPS
from eomcheck.errors import InputError, RefusedError
from eomcheck.model import (
    Arithmetic,
    Array,
    Bodies,
    Scene,
    Speeds,
    Symmetry,
    Terms,
    Tree,
    finite_array,
)
from eomcheck.scenes.snake_chain import (
    chain,
    chain_acceleration,
    chain_multipliers,
    chain_velocity,
    quasi_velocities,
)


class Parameters(NamedTuple):
    """The parameters of a `Snake` in some kind of number."""

    mass: Any
    """(N,), kg."""
    length: Any
    """(N,), m."""
    inertia: Any
    """About the centres of mass (N,), kg m²."""
    stiffness: Any
    """Of the joints (N-1,), N m/rad, or None without springs."""
    cos_alpha: Any
    """(N,)."""
    sin_alpha: Any
    """(N,)."""


# ---- Lagrange's terms, M and a in O(N²), the rest in O(N) ---------------------------------------


@generic
def carried(mass, length):
    """Return (tail, mu), each (N,): the mass behind link i, and L_i (m_i/2 + tail_i)."""
    tail = np.zeros_like(mass)
    for i in range(mass.size - 1, 0, -1):
        tail[i - 1] = tail[i] + mass[i]
    return tail, length * (mass / 2 + tail)


@generic
def mass_matrix(mass, length, inertia, cos, sin):
    """Return M (N+2, N+2): the Hessian of the kinetic energy of Eq. (25) in v."""
    links = mass.size
    tail, mu = carried(mass, length)
    M = np.zeros((links + 2, links + 2), cos.dtype)
    M[0, 0] = M[1, 1] = tail[0] + mass[0]
    for i in range(links):
        M[0, i + 2] = M[i + 2, 0] = -mu[i] * sin[i]
        M[1, i + 2] = M[i + 2, 1] = mu[i] * cos[i]
        M[i + 2, i + 2] = length[i] * length[i] * (mass[i] / 4 + tail[i]) + inertia[i]
        for j in range(i):
            coupling = length[j] * mu[i] * (cos[i] * cos[j] + sin[i] * sin[j])
            M[i + 2, j + 2] = M[j + 2, i + 2] = coupling
    return M


@generic
def bias(mass, length, cos, sin, omega):
    """Return B (N+2,): the centrifugal part of the equations of motion."""
    links = mass.size
    mu = carried(mass, length)[1]
    B = np.zeros(links + 2, omega.dtype)
    for i in range(links):
        B[0] -= mu[i] * cos[i] * omega[i] * omega[i]
        B[1] -= mu[i] * sin[i] * omega[i] * omega[i]
    # Row i sums nu_ij sin(θ_i - θ_j) ω_j² with nu_ij = L_min mu_max: once from the head up to i,
    # where mu_i is common, and once from the tail down to i, where L_i is.
    along = across = 0
    for i in range(links):
        B[i + 2] += mu[i] * (sin[i] * along - cos[i] * across)
        along = along + length[i] * cos[i] * omega[i] * omega[i]
        across = across + length[i] * sin[i] * omega[i] * omega[i]
    along = across = 0
    for i in range(links - 1, -1, -1):
        B[i + 2] += length[i] * (sin[i] * along - cos[i] * across)
        along = along + mu[i] * cos[i] * omega[i] * omega[i]
        across = across + mu[i] * sin[i] * omega[i] * omega[i]
    return B


@generic
def spring_torque(stiffness, theta, joint):
    """Return T_i = k_i (θ_i - θ_{i+1}) of one joint, N m (Eq. (D2))."""
    return stiffness[joint] * (theta[joint] - theta[joint + 1])


@generic
def forces(stiffness, theta):
    """Return Q (N+2,) of the springs, Eqs. (26)-(27), or None without springs."""
    if stiffness is None:
        return None
    Q = np.zeros(theta.size + 2, theta.dtype)
    for k in range(stiffness.size):
        torque = spring_torque(stiffness, theta, k)
        Q[k + 2] -= torque
        Q[k + 3] += torque
    return Q


@generic
def rolling_directions(cos_alpha, sin_alpha, cos, sin):
    """Return (cos φ, sin φ), each (N,)."""
    return cos_alpha * cos - sin_alpha * sin, sin_alpha * cos + cos_alpha * sin


@generic
def jacobian(length, cos_alpha, sin_alpha, cos, sin):
    """Return a (N, N+2) of Eq. (28): row i is the velocity of wheel i along its axle."""
    links = length.size
    cos_phi, sin_phi = rolling_directions(cos_alpha, sin_alpha, cos, sin)
    a = np.zeros((links, links + 2), cos.dtype)
    for i in range(links):
        a[i, 0] = sin_phi[i]
        a[i, 1] = -cos_phi[i]
        for j in range(i):
            a[i, j + 2] = -length[j] * (cos_phi[i] * cos[j] + sin_phi[i] * sin[j])
        a[i, i + 2] = -length[i] / 2 * cos_alpha[i]
    return a


@generic
def drift(length, cos_alpha, sin_alpha, cos, sin, v):
    """Return gamma = ȧ v (N,): the rate of V_i · e_i at v̇ = 0, where ė_i = ω_i t_i."""
    links = length.size
    cos_phi, sin_phi = rolling_directions(cos_alpha, sin_alpha, cos, sin)
    gamma = np.zeros(links, v.dtype)
    Vx, Vy = v[0], v[1]
    Ax = Ay = 0
    for i in range(links):
        omega = v[i + 2]
        half = length[i] / 2
        # Velocity and acceleration at v̇ = 0: from the front end of the link to its centre ...
        Vx, Vy = Vx - half * omega * sin[i], Vy + half * omega * cos[i]
        Ax, Ay = Ax - half * omega * omega * cos[i], Ay - half * omega * omega * sin[i]
        gamma[i] = Ax * sin_phi[i] - Ay * cos_phi[i] + omega * (Vx * cos_phi[i] + Vy * sin_phi[i])
        # ... and on to its rear end.
        Vx, Vy = Vx - half * omega * sin[i], Vy + half * omega * cos[i]
        Ax, Ay = Ax - half * omega * omega * cos[i], Ay - half * omega * omega * sin[i]
    return gamma


@generic
def terms(parameters, angles, q, v):
    """Return the `Terms` of the snake; b is None, for wheels do not depend on time."""
    mass, length, inertia, stiffness, cos_alpha, sin_alpha = parameters
    theta, cos, sin = angles
    return Terms(
        mass_matrix(mass, length, inertia, cos, sin),
        forces(stiffness, theta),
        bias(mass, length, cos, sin, v[2:]),
        jacobian(length, cos_alpha, sin_alpha, cos, sin),
        drift(length, cos_alpha, sin_alpha, cos, sin, v),
        None,
    )


@generic
def constraints(parameters, angles, q):
    """Return (a, b) of `terms`."""
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    return jacobian(length, cos_alpha, sin_alpha, angles.cos, angles.sin), None


# ---- Generalized speeds and partial velocities, by recursion in O(N) ----------------------------


class Rolling(NamedTuple):
    """Rolling speed s_k and angular velocity ω_k of each link: s_k = s_u u, ṡ_k = s_u u̇ + s_rest.

    The centre of mass of link k moves with s_k t_k. The rate of t_k is normal to t_k, so only ṡ_k
    does work on a partial velocity, and one number per link stands for the linear part: d = 1 in
    `Bodies`, whose shapes these are.
    """

    s_u: Any
    """∂s_k/∂u (N, 1, 2)."""
    omega_u: Any
    """∂ω_k/∂u (N, 1, 2)."""
    s_rest: Any
    """ṡ_k at u̇ = 0 (N, 1)."""
    omega_rest: Any
    """ω̇_k at u̇ = 0 (N, 1)."""
    u: Any
    """(s_1, ω_1)."""
    v: Any
    """q̇ (N+2,): velocity of the tip of link 1, then every ω_k."""


@generic
def kinematics(parameters, angles, q, u):
    """Pass (s, ω) from link to link.

    The joint between links k-1 and k moves with both: s' t' + L'/2 ω' n' = s t - L/2 ω n (dashed:
    link k-1). Its component along e_k gives ω_k and is divided by L_k/2 cos α_k, the one along t_k
    gives s_k; the rates follow in the same way from the accelerations.
    """
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    cos, sin = angles.cos, angles.sin
    links = length.size
    partials, rests = np.zeros((2, links, 1, 2), cos.dtype), np.zeros((2, links, 1), cos.dtype)
    s_u, omega_u, s_rest, omega_rest = partials[0], partials[1], rests[0], rests[1]
    s_u[0, 0, 0] = omega_u[0, 0, 1] = 1
    s, omega = u[0], u[1]
    half = length[0] / 2
    v = np.zeros(links + 2, cos.dtype)
    v[0] = s * (cos_alpha[0] * cos[0] - sin_alpha[0] * sin[0]) + half * sin[0] * omega
    v[1] = s * (sin_alpha[0] * cos[0] + cos_alpha[0] * sin[0]) - half * cos[0] * omega
    v[2] = omega
    for k in range(1, links):
        # psi = φ_k - θ_{k-1} and delta = φ_k - φ_{k-1}
        cos_turn = cos[k] * cos[k - 1] + sin[k] * sin[k - 1]
        sin_turn = sin[k] * cos[k - 1] - cos[k] * sin[k - 1]
        cos_psi = cos_turn * cos_alpha[k] - sin_turn * sin_alpha[k]
        sin_psi = sin_turn * cos_alpha[k] + cos_turn * sin_alpha[k]
        cos_delta = cos_psi * cos_alpha[k - 1] + sin_psi * sin_alpha[k - 1]
        sin_delta = sin_psi * cos_alpha[k - 1] - cos_psi * sin_alpha[k - 1]
        before, half = half, length[k] / 2
        lever = half * cos_alpha[k]
        offset = half * sin_alpha[k]

        ww_s = sin_delta / lever
        ww_w = -before * cos_psi / lever
        ss_s = cos_delta + offset * ww_s
        ss_w = before * sin_psi + offset * ww_w
        for i in range(2):
            omega_u[k, 0, i] = ww_s * s_u[k - 1, 0, i] + ww_w * omega_u[k - 1, 0, i]
            s_u[k, 0, i] = ss_s * s_u[k - 1, 0, i] + ss_w * omega_u[k - 1, 0, i]
        s_before, omega_before = s, omega
        omega = ww_s * s_before + ww_w * omega_before
        s = ss_s * s_before + ss_w * omega_before
        v[k + 2] = omega

        spin = before * omega_before * omega_before
        turning = s_before * omega_before
        along_axle = s * omega - turning * cos_delta - spin * sin_psi - offset * omega * omega
        rate = ww_s * s_rest[k - 1, 0] + ww_w * omega_rest[k - 1, 0] + along_axle / lever
        omega_rest[k, 0] = rate
        s_rest[k, 0] = (
            cos_delta * s_rest[k - 1, 0]
            + before * sin_psi * omega_rest[k - 1, 0]
            + offset * rate
            + turning * sin_delta
            - spin * cos_psi
            - lever * omega * omega
        )
    return Rolling(s_u, omega_u, s_rest, omega_rest, u, v)


@generic
def speeds(parameters, angles, rolling):
    """Return the `Speeds` of the snake: the tip of link 1 from (s_1, ω_1), then every ω_k."""
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    cos, sin = angles.cos, angles.sin
    links = length.size
    half = length[0] / 2
    cos_phi = cos_alpha[0] * cos[0] - sin_alpha[0] * sin[0]
    sin_phi = sin_alpha[0] * cos[0] + cos_alpha[0] * sin[0]
    turning = rolling.u[0] * rolling.u[1]
    spin = half * rolling.u[1] * rolling.u[1]
    W = np.zeros((links + 2, 2), cos.dtype)
    rest = np.zeros(links + 2, cos.dtype)
    W[0, 0], W[0, 1] = cos_phi, half * sin[0]
    W[1, 0], W[1, 1] = sin_phi, -half * cos[0]
    rest[0] = spin * cos[0] - turning * sin_phi
    rest[1] = spin * sin[0] + turning * cos_phi
    W[2:] = rolling.omega_u[:, 0]
    rest[2:] = rolling.omega_rest[:, 0]
    return Speeds(W, rest, None)


@generic
def qdot(parameters, angles, rolling):
    """Return W u of `speeds`, passed from link to link with the recursion."""
    return rolling.v


@generic
def active_forces(stiffness, theta, omega_u):
    """Return F_Kane (2,) of the springs by Eq. (D1), or None without springs."""
    if stiffness is None:
        return None
    force = np.zeros(2, theta.dtype)
    for k in range(stiffness.size):
        torque = spring_torque(stiffness, theta, k)
        for i in range(2):
            force[i] += torque * (omega_u[k + 1, 0, i] - omega_u[k, 0, i])
    return force


@generic
def bodies(parameters, angles, rolling):
    """Return the `Bodies` of the snake, d = e = 1: along the wheel and about the vertical."""
    return Bodies(
        rolling.s_u,
        rolling.omega_u,
        rolling.s_rest,
        rolling.omega_rest,
        parameters.mass,
        parameters.inertia[:, np.newaxis, np.newaxis],
        None,
        active_forces(parameters.stiffness, angles.value, rolling.omega_u),
    )


@generic
def speeds_of(parameters, angles, q, v):
    """Return u = (s_1, ω_1) of a velocity v (Eq. (29)): V_1 · t_1 and θ̇_1."""
    length, cos_alpha, sin_alpha = parameters.length, parameters.cos_alpha, parameters.sin_alpha
    cos, sin = angles.cos, angles.sin
    cos_phi = cos_alpha[0] * cos[0] - sin_alpha[0] * sin[0]
    sin_phi = sin_alpha[0] * cos[0] + cos_alpha[0] * sin[0]
    u = np.zeros(2, v.dtype)
    u[0] = v[0] * cos_phi + v[1] * sin_phi + length[0] / 2 * sin_alpha[0] * v[2]
    u[1] = v[2]
    return u


# ---- The second derivation: positions and velocities only ----------------------------------------


@generic
def velocities(parameters, angles, q, v):
    """Return the velocities of the centres of mass (N, 2) and of rotation (N, 1), Eq. (25)."""
    length = parameters.length
    links = length.size
    V = np.zeros((links, 2), v.dtype)
    joint_x, joint_y = v[0], v[1]
    for i in range(links):
        V[i, 0] = joint_x - length[i] / 2 * v[i + 2] * angles.sin[i]
        V[i, 1] = joint_y + length[i] / 2 * v[i + 2] * angles.cos[i]
        joint_x = joint_x - length[i] * v[i + 2] * angles.sin[i]
        joint_y = joint_y + length[i] * v[i + 2] * angles.cos[i]
    return V, v[2:].reshape(links, 1)


@generic
def spring_energy(stiffness, theta):
    """Return U of Eq. (26), J, or None without springs."""
    if stiffness is None:
        return None
    U = 0
    for k in range(stiffness.size):
        U += stiffness[k] * (theta[k + 1] - theta[k]) * (theta[k + 1] - theta[k]) / 2
    return U


@generic
def energies(parameters, angles, q, v):
    """Return (T, U), J: Eqs. (25)-(26); U is None without springs."""
    V, omega = velocities(parameters, angles, q, v)
    T = 0
    for i in range(V.shape[0]):
        T += parameters.mass[i] * (V[i, 0] * V[i, 0] + V[i, 1] * V[i, 1]) / 2
        T += parameters.inertia[i] * omega[i, 0] * omega[i, 0] / 2
    return T, spring_energy(parameters.stiffness, angles.value)


@generic
def constraint(parameters, angles, q, v):
    """Return c (N,), m/s: the velocity of each wheel along its axle, Eq. (28)."""
    V, _ = velocities(parameters, angles, q, v)
    c = np.zeros(V.shape[0], v.dtype)
    for i in range(V.shape[0]):
        cos_alpha, sin_alpha = parameters.cos_alpha[i], parameters.sin_alpha[i]
        cos_phi = cos_alpha * angles.cos[i] - sin_alpha * angles.sin[i]
        sin_phi = sin_alpha * angles.cos[i] + cos_alpha * angles.sin[i]
        c[i] = V[i, 0] * sin_phi - V[i, 1] * cos_phi
    return c


def whole_links(links: int, name: str = "links") -> int:
    """Return a number of links as an int.

    Raises:
        InputError: it is no whole number of at least 1.
    """
    if isinstance(links, bool) or not isinstance(links, int | np.integer) or links < 1:
        raise InputError(f"{name} = {links!r}, expected a whole number of at least 1")
    return int(links)


# ---- The scene -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class Snake(Scene):
    """An N-link wheeled snake, N >= 1.

    Args:
        mass: of the links (N,), kg, positive.
        length: of the links (N,), m, positive.
        inertia: of the links about their centres of mass (N,), kg m², not negative.
        stiffness: of the joints (N-1,), N m/rad, or None without springs.
        wheel_angle: α of the wheels against their links (N,), rad. For i >= 2 the generalized
            speeds (`ml`, `kane`) do not exist at ±π/2, nor for i <= N-2 the paper's partition
            (`el`, `em`).
        pose: θ at t = 0 (N,), rad; all zero (stretched along x) if not given.

    Raises:
        InputError: wrong shape, not finite, or out of the range given above.
    """

    mass: Any
    length: Any
    inertia: Any
    stiffness: Any
    wheel_angle: Any
    pose: Any = None

    key = "snake"
    conserves_energy = True
    angle_coordinates = slice(2, None)

    terms = staticmethod(terms)
    constraints = staticmethod(constraints)
    kinematics = staticmethod(kinematics)
    speeds = staticmethod(speeds)
    qdot = staticmethod(qdot)
    bodies = staticmethod(bodies)
    speeds_of = staticmethod(speeds_of)
    velocities = staticmethod(velocities)
    energies = staticmethod(energies)
    constraint = staticmethod(constraint)
    quasi_velocities = staticmethod(quasi_velocities)
    chain = staticmethod(chain)
    chain_velocity = staticmethod(chain_velocity)
    chain_acceleration = staticmethod(chain_acceleration)
    chain_multipliers = staticmethod(chain_multipliers)

    def __post_init__(self):
        try:
            (links,) = np.shape(self.mass)
        except ValueError:
            links = 0
        if links < 1:
            raise InputError(f"mass = {self.mass!r}: a snake has at least 1 link, one mass each")
        if self.pose is None:
            object.__setattr__(self, "pose", np.zeros(links))
        if links == 1 and np.size(self.stiffness) == 0:
            object.__setattr__(self, "stiffness", None)
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name != "stiffness":
                value = finite_array(field.name, value, (links,))
            elif value is not None:
                value = finite_array(field.name, value, (links - 1,))
            if value is not None:
                value.setflags(write=False)
            object.__setattr__(self, field.name, value)
        for name, positive in (("mass", True), ("length", True), ("inertia", False)):
            bad = getattr(self, name) <= 0 if positive else getattr(self, name) < 0
            if bad.any():
                i = int(np.argmax(bad))
                raise InputError(
                    f"{name}[{i}] = {getattr(self, name)[i]}, expected a "
                    + ("positive number" if positive else "number that is not negative")
                )

    @classmethod
    def paper(cls) -> Snake:
        """Return the seven-link robot of Sec. 11 with the digits printed there."""
        alpha = [0.0175, 0.0349, 0.0524, 0.0698, 0.0873, 0.1047, 0.1222]
        theta = [0.7679, 1.536, 2.304, 3.072, 3.840, 4.608, 5.376]
        return cls([1.0] * 7, [1.0] * 7, [0.0833] * 7, [5000.0] * 6, alpha, theta)

    @classmethod
    def coil(cls, links: int) -> Snake:
        """Return the paper's robot with any number of links, α_i = 7° i/N, coiled by 308°.

        At N = 7 these are the paper's angles up to its rounding.
        """
        return cls._uniform(links, 7.0 / whole_links(links))

    @classmethod
    def pattern(cls, links: int) -> Snake:
        """Return the literal continuation of the paper's angles, α_i = i° and θ_i = 44° i.

        Wheels turn against their links along the chain: near i = 90 they stand across it.
        """
        return cls._uniform(whole_links(links), 1.0)

    @classmethod
    def _uniform(cls, links: int, degrees: float) -> Snake:
        one = np.ones(links)
        alpha = np.radians(degrees) * np.arange(1, links + 1)
        return cls(one, one, 0.0833 * one, 5000.0 * one[1:], alpha, 44.0 * alpha)

    @classmethod
    def structures(cls, links: int) -> Iterator[Snake]:
        """Yield a coiled snake with springs, and one without if it has joints."""
        coil = cls.coil(links)
        yield coil
        if links > 1:
            yield replace(coil, stiffness=None)

    def initial_state(self) -> tuple[Array, Array]:
        """Return the state of rest in `pose`, the tip of link 1 at the origin."""
        return np.concatenate(([0.0, 0.0], self.pose)), np.zeros(self.n)

    def __repr__(self) -> str:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        if not self.pose.any():
            del values["pose"]
        listed = (f"{k}={None if v is None else v.tolist()}" for k, v in values.items())
        return f"Snake({', '.join(listed)})"

    @property
    def links(self) -> int:
        """N."""
        return self.mass.size

    @property
    def n(self) -> int:
        """N + 2 coordinates."""
        return self.links + 2

    @property
    def r(self) -> int:
        """N constraints, one per wheel."""
        return self.links

    @property
    def s(self) -> int:
        """2 N quasi-velocities, two per link."""
        return 2 * self.links

    @property
    def name(self) -> str:
        """snake[N]."""
        return f"snake[{self.links}]"

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """x, y, θ_1 .. θ_N."""
        return ("x", "y", *(f"θ_{i + 1}" for i in range(self.links)))

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """wheel 1 .. wheel N."""
        return tuple(f"wheel {i + 1}" for i in range(self.links))

    def parameters(self, arithmetic: Arithmetic) -> Parameters:
        """Return the parameters in the numbers of `arithmetic`."""
        number = arithmetic.numbers
        wheel = arithmetic.angles(self.wheel_angle)
        return Parameters(
            number(self.mass),
            number(self.length),
            number(self.inertia),
            None if self.stiffness is None else number(self.stiffness),
            wheel.cos,
            wheel.sin,
        )

    def refuse_speeds(self) -> None:
        """Refuse |cos α_i| <= 4 eps for i >= 2: the recursion divides by it.

        The double nearest to π/2 has the cosine 6e-17, so "exactly" needs this margin.
        """
        cosine = np.abs(np.cos(self.wheel_angle))
        cosine[0] = 1.0
        worst = int(np.argmin(cosine))
        if cosine[worst] <= 4 * EPS:
            raise RefusedError(
                "cos α",
                float(cosine[worst]),
                4 * EPS,
                f"wheel_angle[{worst}] = {float(self.wheel_angle[worst])!r} stands across its "
                f"link: generalized speeds (s_1, ω_1) need |cos α_i| > {4 * EPS:.2g} for i >= 2",
            )

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation, a translation and the mirror image in the x axis."""
        turn = 0.75
        image = np.eye(self.n)
        image[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        rotated = image @ q
        rotated[2:] += turn
        yield Symmetry("rotation", self, rotated, image @ v, image)
        moved = q.copy()
        moved[:2] += (3.0, -2.0)
        yield Symmetry("translation", self, moved, v, np.eye(self.n))
        flip = np.diag(np.r_[1.0, -np.ones(self.n - 1)])
        mirrored = replace(self, wheel_angle=-self.wheel_angle)
        yield Symmetry("mirror", mirrored, flip @ q, flip @ v, flip)

    def tree(self) -> Tree:
        """Return PX, PY and RZ for link 1, then RZ in the joints: relative angles."""
        links = self.links
        offset = np.zeros((links + 2, 3))
        offset[3:, 0] = self.length[:-1]
        center = np.zeros((links + 2, 3))
        center[2:, 0] = self.length / 2
        coordinates = np.eye(links + 2)
        coordinates[np.arange(3, links + 2), np.arange(2, links + 1)] = -1.0
        return Tree(
            parent=tuple(range(-1, links + 1)),
            joint=("px", "py", *["rz"] * links),
            offset=offset,
            mass=np.r_[0.0, 0.0, self.mass],
            center=center,
            inertia=np.r_[0.0, 0.0, self.inertia],
            coordinates=coordinates,
        )
