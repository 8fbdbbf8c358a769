"""What a scene gives: its terms, speeds and bodies, in the symbols of the paper.

The rules that they follow are numbered in `eomcheck.mechanics.scene`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from eomcheck.deprecated import getattr_of
from eomcheck.numbers.generic import Array, generic


class Terms(NamedTuple):
    """The terms of M v̇ = Q - B + aᵀλ and a v + b = 0 (rule 3; paper, Eqs. (2)-(5))."""

    M: Any
    """Mass matrix (n, n), symmetric."""
    Q: Any
    """Generalized forces (n,), or None."""
    B: Any
    """Bias (n,), Coriolis and centrifugal, on the left-hand side; or None."""
    a: Any
    """Constraint Jacobian (r, n), or None."""
    gamma: Any
    """Constraint drift ȧ v + ḃ (r,), or None."""
    b: Any
    """Constraint velocity (r,), or None where constraints do not depend on time."""


class Jacobians(NamedTuple):
    """Velocities of the bodies as J v, and their accelerations as J v̇ + rest.

    V of the centres of mass in any directions, of which `linear_rest` is the whole acceleration
    left even if they turn; in space ω in directions that turn with the body, or otherwise keep its
    inertia constant, of which `angular_rest` is the whole acceleration left too.
    """

    linear: Any
    """∂V_k/∂v (n_b, d, n)."""
    angular: Any
    """∂ω_k/∂v (n_b, e, n)."""
    linear_rest: Any
    """J̇ v of the centres of mass (n_b, d)."""
    angular_rest: Any
    """J̇ v of the rotations (n_b, e)."""
    gyroscopic: Any = None
    """ω × I ω (n_b, e), or None in the plane."""


class Speeds(NamedTuple):
    """How velocities follow from generalized speeds (rule 4; paper, Eq. (20)).

    All three are None where nothing is constrained and u is v itself.
    """

    W: Any
    """The paper's w′ (n, p)."""
    rest: Any
    """The part of v̇ that is left at u̇ = 0 (n,)."""
    offset: Any
    """The paper's x′ (n,), or None."""


@generic
def velocity_from_speeds(u, W, offset):
    """Return v = W u + offset (n,); u itself without W."""
    if W is None:
        return u
    if offset is None:
        return W @ u
    return W @ u + offset


class Bodies(NamedTuple):
    """Partial velocities of the bodies and what moves them (rule 5; paper, Eqs. (22)-(23))."""

    partial_velocity: Any
    """∂V_k/∂u of the centres of mass (n_b, d, p)."""
    partial_angular_velocity: Any
    """∂ω_k/∂u (n_b, e, p)."""
    remainder: Any
    """Accelerations of the centres of mass at u̇ = 0 (n_b, d)."""
    angular_remainder: Any
    """Angular accelerations at u̇ = 0 (n_b, e)."""
    mass: Any
    """(n_b,), kg."""
    inertia: Any
    """About the centres of mass (n_b, e, e), kg m²."""
    gyroscopic: Any
    """ω × I ω (n_b, e), or None in the plane."""
    force: Any
    """Generalized active forces F_Kane (p,), from the bodies, not from Q; or None."""


class Chain(NamedTuple):
    """Bodies that hang on each other in a row (rule 10).

    Of all accelerations that satisfy the constraint of each body by itself, ẋ_k are those of body k
    in the directions of x_k. Joint k = 2 .. n_b adds A_k ẋ_{k-1} + C_k ẋ_k + d_k = 0 and its forces
    ρ_k: D_k ẋ_k = f_k + C_kᵀ ρ_k + A_{k+1}ᵀ ρ_{k+1}. Where v satisfies the constraints, ẋ is the
    rate of x and A_k x_{k-1} + C_k x_k = 0.
    """

    mass: Any
    """The diagonals of all D_k (s,)."""
    force: Any
    """Active forces f along x (s,), or None."""
    before: Any
    """A_k (n_b-1, 2, 2)."""
    after: Any
    """C_k (n_b-1, 2, 2)."""
    rest: Any
    """d_k (n_b-1, 2)."""


class State(NamedTuple):
    """Where a scene is looked at."""

    q: Array
    """Coordinates (n,)."""
    v: Array
    """Velocities (n,)."""
    t: float = 0.0
    """Time, s."""


class Symmetry(NamedTuple):
    """A motion of the whole scene under which accelerations are known to follow."""

    name: str
    scene: Any
    """A `Scene`."""
    q: Array
    v: Array
    image: Array
    """(n, n), with which the moved scene has v̇ = image @ (v̇ of the scene as it was)."""


class Range(NamedTuple):
    """What a number, or each entry of an array, is drawn from."""

    low: float
    high: float
    shape: tuple[int, ...] = ()
    """() for a number."""
    optional: bool = False
    """Whether it may also be None: absent."""


ANYWHERE, ANY_ANGLE = Range(-10.0, 10.0), Range(-math.pi, math.pi)
"""m from the origin; rad."""


__getattr__ = getattr_of(__name__)
