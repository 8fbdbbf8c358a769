"""Free bases in recorded tables: a pose with a quaternion, and a twist in a declared convention.

Programs give the pose of a floating base as a position and a quaternion, and its velocity as a
twist w of six numbers: the velocity of its origin and its angular velocity, in either order and
each along the axes of the world or of the base (`BaseVelocity`). The scene has slides along x, y, z
and turns about z, y, x instead, whose rates are v, and w = S v as for engines that read files
(`eomcheck.engines.file_engine`). States are mapped to the scene; expected quantities are mapped to
the program's coordinates, so that each recorded entry is compared by itself, with its own digits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from eomcheck.engines.file_engine import (
    FREE,
    BaseVelocity,
    free_base,
    is_free,
    rotation_of_quaternion,
)
from eomcheck.errors import InputError
from eomcheck.evaluation.conformance import ConformancePoint, Quantity
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import of_each
from eomcheck.numbers.generic import Array

POSE = tuple(f"base.{x}" for x in ("x", "y", "z", "quat_w", "quat_x", "quat_y", "quat_z"))
"""Columns of the pose: position of the base's origin, m, and its orientation."""

LINEAR = tuple(f"base.v_{x}" for x in "xyz")
ANGULAR = tuple(f"base.w_{x}" for x in "xyz")
TWIST = LINEAR + ANGULAR
"""Columns of the twist, m/s and rad/s."""

RATES = tuple(name.replace("_", "dot_") for name in TWIST)
"""Columns of the rates of the twist's numbers: `base.vdot_x`, ..., `base.wdot_z`."""

BASE_COLUMNS = {"q": POSE, "v": TWIST, "vdot": RATES}
"""Input of a state -> columns of the base that replace its first coordinates."""

AXES_BY_WORD = {
    "world": ("ground", "ground"),
    "body": ("base", "base"),
    "mixed": ("ground", "base"),
}
"""Word of a convention -> axes of the linear and of the angular velocity."""

CONVENTIONS = {
    f"{word} axes, {'angular' if turns_first else 'linear'} first": BaseVelocity(*axes, turns_first)
    for word, axes in AXES_BY_WORD.items()
    for turns_first in (False, True)
}
"""Text of a convention -> the convention; "mixed" is linear along the world, angular the body."""


def parse_convention(text: str) -> BaseVelocity:
    """Return the convention of a twist from a text such as "body axes, angular first".

    Raises:
        InputError: it is none of `CONVENTIONS`.
    """
    words = text.lower().replace(",", " ").split()
    shown = [word for word in words if word not in ("axes", "first")]
    for name, convention in CONVENTIONS.items():
        axes, order = name.split()[0], name.split()[2]
        if shown == [axes, order] or (shown == [axes] and order == "linear"):
            return convention
    expected = "world, body or mixed axes, linear or angular first"
    raise InputError(f"base = {text!r}: expected {expected}, such as {next(iter(CONVENTIONS))!r}")


def text_of(convention: BaseVelocity) -> str:
    """Return the text of a convention."""
    return next(text for text, one in CONVENTIONS.items() if one == convention)


def twist_names(scene: Scene, convention: BaseVelocity) -> tuple[str, ...]:
    """Return the names of a program's velocities: those of the twist in its order, then joints."""
    first = ANGULAR + LINEAR if convention.turns_first else TWIST
    return first + scene.coordinate_names[FREE:]


def check_free(scene: Scene) -> None:
    """Raise InputError unless a scene has a free base."""
    if not is_free(scene):
        raise InputError(f"{scene.name} has no free base: expected robot.urdf:floating")


# ---- States --------------------------------------------------------------------------------------


def turns_of(R: Array) -> Array:
    """Return the turns about z, y and x (3,) of a rotation, the second within ±π/2."""
    yaw, roll = np.arctan2(R[1, 0], R[0, 0]), np.arctan2(R[2, 1], R[2, 2])
    return np.array([yaw, np.arctan2(-R[2, 0], np.hypot(R[2, 1], R[2, 2])), roll])


class BaseState(NamedTuple):
    """State of a free base in the scene's coordinates, with the sizes of its rounding errors.

    Attributes:
        q, v, vdot: slides and turns (6,), their rates, and the rates of these.
        q_size, v_size: sizes (6,) to which the rounding of q and v is relative.
    """

    q: Array
    v: Array
    vdot: Array
    q_size: Array
    v_size: Array


def base_state(convention: BaseVelocity, pose: Array, twist: Array, rates: Array) -> BaseState:
    """Return the state of a base from its pose (7,), its twist (6,) and the twist's rates (6,).

    Args:
        convention: that of the twist.
        pose: position and quaternion w, x, y, z; it is normalized.
        twist: linear, then angular velocity, whatever comes first in the convention.
        rates: rates of the twist's numbers.
    """
    R = rotation_of_quaternion(pose[3:] / np.linalg.norm(pose[3:]))
    q = np.concatenate((pose[:3], turns_of(R)))
    plain = convention._replace(turns_first=False)
    S, _ = free_base(q, np.zeros(FREE)).velocity(plain, np.zeros(FREE))
    back = np.linalg.inv(S)
    v = back @ twist
    _, rest = free_base(q, v).velocity(plain, v)
    q_size = np.concatenate((np.abs(pose[:3]), np.abs(back[3:, 3:]).sum(axis=1)))
    return BaseState(q, v, back @ (rates - rest), q_size, np.abs(back) @ np.abs(twist))


def base_errors(
    convention: BaseVelocity, q: Array, v: Array, errors: Mapping[str, Array], forces: Array
) -> tuple[Array, Array, Array, Array]:
    """Return the errors (6,) of q, v, v̇ and forces of a base by those of its columns.

    Args:
        convention: that of the twist.
        q, v: state of the scene.
        errors: input -> errors of the columns of `BASE_COLUMNS`.
        forces: errors of the forces (6,) in the order of the twist.
    """
    S, _ = free_base(q[:FREE], v[:FREE]).velocity(convention._replace(turns_first=False), v[:FREE])
    size, back = np.abs(S), np.abs(np.linalg.inv(S))
    turned = 2.0 * errors["q"][3:].sum()
    q_error = np.concatenate((errors["q"][:3], back[3:, 3:].sum(axis=1) * turned))
    spread = largest(q_error[3:]) * largest(back) * largest(S)
    v_error = back @ errors["v"] + spread * np.abs(v[:FREE])
    vdot_error = back @ errors["vdot"] if "vdot" in errors else np.zeros(FREE)
    by_turns = np.roll(forces, 3) if convention.turns_first else forces
    return q_error, v_error, vdot_error, size.T @ by_turns


def recorded_base(
    convention: BaseVelocity, q: Array, v: Array, vdot: Array
) -> tuple[Array, Array, Array]:
    """Return pose (7,), twist (6,) and its rates (6,) of a base in the scene's coordinates."""
    plain = convention._replace(turns_first=False)
    base = free_base(q[:FREE], v[:FREE])
    S, rest = base.velocity(plain, v[:FREE])
    pose = np.concatenate((base.position, base.quaternion))
    return pose, S @ v[:FREE], S @ vdot[:FREE] + rest


def check_quaternion(quaternion: Array, error: Array, where: str) -> None:
    """Check that a quaternion has length 1 to its digits.

    Args:
        quaternion: its entries (4,).
        error: errors of the entries (4,) as they are printed.
        where: file and row.

    Raises:
        InputError: it has another length.
    """
    length = float(quaternion @ quaternion)
    allowed = 2.0 * float(np.abs(quaternion) @ error + error @ error) + allowed_error(1.0)
    if not abs(length - 1.0) <= allowed:
        raise InputError(f"{where}: base.quat has length {np.sqrt(length):.6g}, expected 1")


OTHER_QUATERNIONS: dict[str, Callable[[Array], Array]] = {
    "the quaternion turned the world into the base, its inverse": lambda x: x * [1, -1, -1, -1],
    "the quaternion was x, y, z, w": lambda x: np.roll(x, 1),
}
"""Text -> change of the quaternion w, x, y, z that a program may have understood."""


# ---- Quantities ----------------------------------------------------------------------------------

UNMAPPED = "derivatives"
"""Mapping of quantities that are not mapped to twists."""


def velocity_map(convention: BaseVelocity, q: Array, v: Array) -> tuple[Array, Array]:
    """Return S (n, n) and Ṡ v (n,) of a program's velocities w = S v."""
    S, rest = np.eye(len(q)), np.zeros(len(q))
    S[:FREE, :FREE], rest[:FREE] = free_base(q[:FREE], v[:FREE]).velocity(convention, v[:FREE])
    return S, rest


def _mapped(
    kind: str, convention: BaseVelocity, x: Array, more: Array, q: Array, v: Array
) -> Array:
    """Return a quantity in a program's coordinates, the inverse of `MAPPINGS`.

    `more` is M for a bias, the Jacobian for the bias acceleration of a frame, unused else.
    """
    S, rest = velocity_map(convention, q, v)
    back = np.linalg.inv(S)
    match kind:
        case "force" | "rows":
            return back.T @ x
        case "bias of M":
            return back.T @ (x - more @ (back @ rest))
        case "matrix":
            return back.T @ x @ back
        case "inverse":
            return S @ x @ S.T
        case "jacobian":
            return x @ back
        case "bias":
            return x - more @ (back @ rest)
        case "acceleration":
            return S @ x + rest
        case "velocity":
            return S @ x
        case _:
            return x


def in_coordinates_of(convention: BaseVelocity, one: Quantity) -> Quantity:
    """Return a quantity whose value is in a program's coordinates."""
    return one._replace(value=partial(mapped_value, convention, one))


def mapped_value(
    convention: BaseVelocity, one: Quantity, point: ConformancePoint, frame: str
) -> Any:
    """Return the value of a quantity in a program's coordinates; of a batch, of each element.

    That of a Coriolis matrix is C w, its bias.
    """
    kind = one.mapping
    x = point.bias if kind == "coriolis" else one.value(point, frame)
    if kind == "invariant":
        return x
    more = point.at.terms.M
    if kind == "bias":
        more = point.link(frame).jacobian
    if kind == "coriolis" or one.name == "bias":
        kind = "bias of M"
    return of_each(partial(_mapped, kind, convention), x, more, point.at.q, point.at.v)


def mapped_terms(
    convention: BaseVelocity, one: Quantity, point: ConformancePoint
) -> Callable[[str, Array], Array]:
    """Return the function that maps a summand of a quantity, by its name, to a program."""
    q, v, M = point.at.q, point.at.v, point.at.terms.M

    def mapped(name: str, x: Array) -> Array:
        if one.mapping == "acceleration":
            if name == "the bias":
                S, _ = velocity_map(convention, q, v)
                x = np.linalg.solve(M, _bias_in(convention, point) @ S)
                return -_mapped("velocity", convention, x, M, q, v)
            return _mapped("velocity", convention, x, M, q, v)
        if one.mapping == "force":
            if name == "the bias":
                return _bias_in(convention, point)
            if name == "M v̇":
                inertia = _mapped("force", convention, point.inertia_force, M, q, v)
                return inertia - _bias_in(convention, point)
        return _mapped(one.mapping, convention, x, M, q, v)

    return mapped


def _bias_in(convention: BaseVelocity, point: ConformancePoint) -> Array:
    at = point.at
    return _mapped("bias of M", convention, point.bias, at.terms.M, at.q, at.v)


def other_conventions(convention: BaseVelocity) -> Sequence[tuple[str, BaseVelocity]]:
    """Return the conventions other than one, with their texts."""
    return [(text, one) for text, one in CONVENTIONS.items() if one != convention]
