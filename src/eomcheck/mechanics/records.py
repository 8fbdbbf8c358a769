"""Records of a scene: its terms, speeds and bodies in the symbols of the paper, symmetries, tree.

The rules that they follow are numbered in `eomcheck.mechanics.scene`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.errors import RefusedError
from eomcheck.numbers.generic import EPS, Array, generic


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
    """Jacobians of the body velocities: V = J v, V̇ = J v̇ + rest, rest the bias acceleration.

    V of the centres of mass along any directions, of which `linear_rest` is the whole bias
    acceleration even if they turn; in space ω along directions that turn with the body, or
    otherwise keep its inertia constant, of which `angular_rest` is the whole bias too.
    """

    linear: Any
    """∂V_k/∂v (n_b, d, n)."""
    angular: Any
    """∂ω_k/∂v (n_b, e, n)."""
    linear_rest: Any
    """Bias acceleration J̇ v of the centres of mass (n_b, d)."""
    angular_rest: Any
    """Bias angular acceleration J̇ v (n_b, e)."""
    gyroscopic: Any = None
    """ω × I ω (n_b, e), or None in the plane."""


class Speeds(NamedTuple):
    """Map from generalized speeds to velocities, v = W u + offset (rule 4; paper, Eq. (20)).

    All three are None where nothing is constrained and u is v itself.
    """

    W: Any
    """The paper's w′ (n, p)."""
    rest: Any
    """Acceleration v̇ at u̇ = 0 (n,)."""
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
    """Partial velocities of the bodies and the forces on them (rule 5; paper, Eqs. (22)-(23))."""

    partial_velocity: Any
    """∂V_k/∂u of the centres of mass (n_b, d, p)."""
    partial_angular_velocity: Any
    """∂ω_k/∂u (n_b, e, p)."""
    remainder: Any
    """Accelerations of the centres of mass at u̇ = 0 (n_b, d)."""
    angular_remainder: Any
    """Angular accelerations at u̇ = 0 (n_b, e)."""
    mass: Any
    """Masses (n_b,), kg."""
    inertia: Any
    """Moments of inertia about the centres of mass (n_b, e, e), kg m²."""
    gyroscopic: Any
    """ω × I ω (n_b, e), or None in the plane."""
    force: Any
    """Generalized active forces F_Kane (p,), from the bodies, not from Q; or None."""


class Chain(NamedTuple):
    """Bodies connected in a row, each with two quasi-velocities (rule 10).

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
    """A state of a scene: coordinates, velocities and time."""

    q: Array
    """Coordinates (n,)."""
    v: Array
    """Velocities (n,)."""
    t: float = 0.0
    """Time, s."""


class Symmetry(NamedTuple):
    """A motion of the whole scene that maps its accelerations in a known way."""

    name: str
    scene: Any
    """A `Scene`."""
    q: Array
    v: Array
    image: Array
    """(n, n): the transformed scene has v̇ = image @ (v̇ of the original scene)."""


class Range(NamedTuple):
    """A sampling range of a number, or of each entry of an array."""

    low: float
    high: float
    shape: tuple[int, ...] = ()
    """Shape of the array, () for a number."""
    optional: bool = False
    """Whether None, an absent parameter, is sampled too."""


ANYWHERE, ANY_ANGLE = Range(-10.0, 10.0), Range(-math.pi, math.pi)
"""Ranges of a position, m from the origin, and of an angle, rad."""


__getattr__ = getattr_of(__name__)


# ---- Symmetries of a plane without directions, (x, y) the first coordinates ----------------------

TURN = 0.75
"""Angle of the rotation, rad."""
SHIFT = 3.0, -2.0
"""Components of the translation, m."""


def plane_rotation(scene: Any, q: Array, v: Array, headings: slice) -> Symmetry:
    """Return the rotation of the scene about the origin; the angles `headings` turn with it."""
    image = np.eye(scene.n)
    image[:2, :2] = [[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]]
    turned = image @ q
    turned[headings] += TURN
    return Symmetry("rotation", scene, turned, image @ v, image)


def plane_translation(scene: Any, q: Array, v: Array) -> Symmetry:
    """Return the translation of the scene by `SHIFT`."""
    shifted = q.copy()
    shifted[:2] += SHIFT
    return Symmetry("translation", scene, shifted, v, np.eye(scene.n))


def plane_mirror(scene: Any, q: Array, v: Array, unflipped: tuple[int, ...]) -> Symmetry:
    """Return the mirror image in the x axis: `scene` is mirrored, all coordinates but `unflipped`
    change their sign.
    """
    signs = -np.ones(scene.n)
    signs[list(unflipped)] = 1.0
    return Symmetry("mirror", scene, signs * q, signs * v, np.diag(signs))


def full_turns(scene: Any, q: Array, v: Array) -> Symmetry:
    """Return a rotation by 2π of every coordinate, which changes nothing."""
    return Symmetry("full turns", scene, q + 2.0 * np.pi, v, np.eye(scene.n))


def refuse_flat(lean: float) -> None:
    """Refuse |cos θ| <= 4 eps, where Euler's angles (heading, lean θ, spin) are singular.

    Raises:
        RefusedError: names the lean, rad.
    """
    cosine = abs(float(np.cos(lean)))
    if cosine <= 4 * EPS:
        detail = f"θ = {float(lean)!r}: Euler's angles are singular, the axis of spin is upright"
        raise RefusedError("cos θ", cosine, 4 * EPS, detail)


# ---- Tree of rigid bodies for engines, a neutral description without equations -------------------

JOINT_KINDS = ("px", "py", "pz", "rx", "ry", "rz")
"""Kinds of joints: prismatic along, or revolute about, an axis of their own frame."""

PLANAR_JOINTS = ("px", "py", "rz")
"""Kinds of joints that keep a body in the plane z = 0."""


class TreeFrame(NamedTuple):
    """Frame of a link, fixed to the frame of a joint."""

    name: str
    """Name of the link."""
    joint: int
    """Index of the joint that moves it, -1: the ground."""
    R: Array
    """Orientation in the frame of the joint, columns along its axes (3, 3)."""
    p: Array
    """Origin in the frame of the joint (3,), m."""


NO_GRAVITY = np.zeros(3)
NO_GRAVITY.setflags(write=False)


class Tree(NamedTuple):
    """Rigid bodies on joints with one coordinate each.

    Joint j is mounted on joint `parent[j]` (-1: the ground), turned by `rotation[j]` and displaced
    by `offset[j]`, and carries one body, or none: mass and inertia 0. The order is depth first: the
    subtree of a joint follows it immediately. Joint coordinates are x = `coordinates` q + `shift`.
    """

    parent: tuple[int, ...]
    joint: tuple[str, ...]
    """Kind of each joint, one of `JOINT_KINDS`."""
    rotation: Array
    """Orientation of each joint at coordinate 0 in the frame of its parent (n_j, 3, 3)."""
    offset: Array
    """Position of each joint at coordinate 0 in the frame of its parent (n_j, 3), m."""
    mass: Array
    """Masses (n_j,), kg."""
    center: Array
    """Centre of mass in the frame of the joint (n_j, 3), m."""
    inertia: Array
    """Inertia about the centre of mass, along the axes of the joint (n_j, 3, 3), kg m²."""
    coordinates: Array
    """Matrix from q to the joint coordinates (n_j, n)."""
    shift: Array
    """Constant part of the joint coordinates (n_j,), m or rad."""
    armature: Array
    """Rotor inertia added along each joint's own coordinate (n_j,), kg m² or kg."""
    gravity: Array = NO_GRAVITY
    """Acceleration of gravity (3,), m/s²."""
    names: tuple[str, ...] = ()
    """Names of the joints; empty for joint[0], joint[1], ..."""
    links: tuple[TreeFrame, ...] = ()
    """Frames of the links; empty for body[0], body[1], ..., each that of a joint with a body."""
    gimbal_armature: Any = ()
    """Rotor inertia added along the angular velocity of the three turns about z, y and x that end
    with each joint, against the joint before them (n_j,), kg m²; empty without such rotors.
    """

    @property
    def name(self) -> tuple[str, ...]:
        """Names of the joints (n_j,)."""
        return self.names or tuple(f"joint[{j}]" for j in range(len(self.joint)))

    @property
    def frames(self) -> tuple[TreeFrame, ...]:
        """Frames of the links, in their order."""
        if self.links:
            return self.links
        heavy = (j for j in range(len(self.joint)) if self.mass[j] > 0 or np.any(self.inertia[j]))
        return tuple(
            TreeFrame(f"body[{i}]", j, np.eye(3), np.zeros(3)) for i, j in enumerate(heavy)
        )


def _is_zero(x: Any) -> bool:
    """Return whether a number is 0 in float64 or a literal: exact ones are any other number."""
    return isinstance(x, float | int) and x == 0


def planar_tree(
    parent: tuple[int, ...],
    joint: tuple[str, ...],
    offset: Array,
    mass: Array,
    center: Array,
    inertia: Array,
    coordinates: Array,
    links: tuple[str, ...] = (),
) -> Tree:
    """Return a tree in the plane z = 0, with one moment of inertia about z per joint (n_j,).

    `links` are the names of the bodies, in the order of their joints.

    In the plane no other moment counts. All three axes get it, because many libraries refuse a
    physically impossible body, such as one with (0, 0, I).
    """
    joints, axes = len(joint), np.arange(3)
    turned = np.zeros((joints, 3, 3), np.asarray(inertia).dtype)
    turned[:, axes, axes] = np.asarray(inertia)[:, None]
    seats = np.broadcast_to(np.eye(3), (joints, 3, 3))
    none = np.zeros(joints)
    heavy = [j for j in range(joints) if not (_is_zero(mass[j]) and _is_zero(inertia[j]))]
    frames = tuple(
        TreeFrame(name, j, np.eye(3), np.zeros(3)) for name, j in zip(links, heavy, strict=False)
    )
    return Tree(
        *(parent, joint, seats, offset, mass, center, turned, coordinates, none, none.copy()),
        links=frames,
    )
