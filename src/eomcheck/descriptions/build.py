"""Builder of mechanisms: validates the elements of a description and makes its scene class.

Elements (links, joints, constraints) are validated before anything is constructed from them; each
error is a sentence that names the element.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from eomcheck.deprecated import old_keywords
from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.elements import (
    COORDINATES,
    LONGEST,
    SHORTEST,
    Constraint,
    Joint,
    Link,
    Triple,
)
from eomcheck.descriptions.joint_tree import (
    ROLLING,
    ConstraintSpec,
    JointTree,
    LinkFrame,
    RigidBody,
    ScalarJoint,
    Topology,
    check_positive,
    is_tilted,
    merged_body,
)
from eomcheck.descriptions.mechanism_class import Mechanism, MechanismSource, NumberedFrame
from eomcheck.descriptions.vector_algebra import rotation_matrix
from eomcheck.errors import InputError, distinct
from eomcheck.mechanics.records import PLANAR_JOINTS
from eomcheck.numbers.generic import FLOAT64

# ---- Validation ----------------------------------------------------------------------------------

COUNTS = {
    1: "a number",
    2: "two numbers",
    3: "three numbers",
    4: "four numbers",
    7: "three bends, three slopes and a level",
}

NOT_NEGATIVE = "expected a number that is not negative"

NUMBERS = {"distance": 1, "coupling": 2, "drive": 3, "on-quadric": 7, **dict.fromkeys(ROLLING, 1)}
"""Kind of constraint -> count of its numbers; others have none."""


LENGTHS = {"distance": "length", **dict.fromkeys(ROLLING, "radius")}
"""Kind of constraint -> name of its one number, m."""


def checked_elements(what: str, kind: type, things: Any) -> tuple[Any, ...]:
    """Return links, joints or constraints as a tuple.

    Raises:
        InputError: they are none, or one of them has no name.
    """
    try:
        elements = tuple(things)
    except TypeError:
        elements = (things,)
    for element in elements:
        if not isinstance(element, kind):
            raise InputError(f"{element!r} is no {what}: expected a {kind.__name__}")
        if not isinstance(element.name, str) or not element.name:
            raise InputError(f"a {what} has the name {element.name!r}, expected some text")
    return elements


def validate_elements(
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: tuple[Constraint, ...],
    gravity: Any,
    pose: Any,
) -> None:
    """Validate every number of a description: type, count, finiteness, length of directions.

    Raises:
        InputError: names the element, its value, and the expected one.
    """
    for link in links:
        _check_link(link)
    for joint in joints:
        _check_joint(joint)
    names: set[str] = set()
    for constraint in constraints:
        _check_constraint(constraint)
        if constraint.name in names:
            raise InputError(f"two constraints have the name {constraint.name!r}")
        names.add(constraint.name)
    if gravity is not None:
        _check_numbers("gravity", gravity, 3)
    if not isinstance(pose, Mapping):
        raise InputError(f"pose = {pose!r}, expected coordinates by name")
    for name, x in pose.items():
        _check_numbers(f"pose: {name}", x)


def _check_link(link: Link) -> None:
    what = f"link {link.name!r}"
    _check_numbers(f"{what}: mass", link.mass)
    if link.mass < 0:
        raise InputError(f"{what}: mass = {link.mass:g} kg, {NOT_NEGATIVE}")
    for name in ("center", "moments", "products"):
        _check_numbers(f"{what}: {name}", getattr(link, name), 3)


def _check_joint(joint: Joint) -> None:
    what = f"joint {joint.name!r}"
    _check_numbers(f"{what}: origin", joint.origin, 3)
    _check_length(f"{what} has the orientation", joint.orientation, 4)
    if joint.kind in ("revolute", "prismatic", "planar"):
        _check_length(f"{what} has the axis", joint.axis, 3)
    for name in ("damping", "stiffness", "armature"):
        value = getattr(joint, name)
        if value is not None:
            _check_numbers(f"{what}: {name}", value)
            if value < 0:
                raise InputError(f"{what}: {name} = {value:g}, {NOT_NEGATIVE}")
    count = 3 if joint.kind == "floating" and isinstance(joint.rest_position, tuple) else 1
    _check_numbers(f"{what}: rest_position", joint.rest_position, count)
    _check_length(f"{what} has the rest_orientation", joint.rest_orientation, 4)
    if joint.mimics is not None:
        if not isinstance(joint.mimics, tuple | list) or len(joint.mimics) != 3:
            wanted = "expected a joint, a ratio and a shift"
            raise InputError(f"{what}: mimics = {joint.mimics!r}, {wanted}")
        _check_numbers(f"{what}: mimics", joint.mimics[1:], 2)


def _check_constraint(constraint: Constraint) -> None:
    element = f"constraint {constraint.name!r}"
    if constraint.kind not in KINDS:
        kinds = ", ".join(KINDS)
        raise InputError(f"{element} has the kind {constraint.kind!r}, expected one of: {kinds}")
    for link, point in constraint.points:
        _check_numbers(f"{element}: a point of {link!r}", point, 3)
    for link, along in constraint.directions:
        _check_length(f"{element}, on {link!r}, has the direction", along, 3)
    points = [link for link, _ in constraint.points]
    directions = [link for link, _ in constraint.directions]
    for names in (points, () if constraint.kind in ROLLING else directions, constraint.joints):
        if len(names) == 2 and names[0] == names[1]:
            raise InputError(f"{element} is between {names[0]!r} and itself")
    if len(constraint.joints) > len({*constraint.joints}):
        raise InputError(f"{element} names a joint twice: {', '.join(constraint.joints)}")
    if constraint.kind in NUMBERS:
        count = NUMBERS[constraint.kind] + max(len(constraint.joints) - 2, 0)
        _check_numbers(f"{element}: its numbers", constraint.numbers, count)
        if constraint.kind in LENGTHS and constraint.numbers <= 0:
            what = LENGTHS[constraint.kind]
            size = constraint.numbers
            raise InputError(f"{element}: {what} = {size} m, expected a positive number")
        if constraint.kind == "on-quadric" and not any(constraint.numbers[:6]):
            raise InputError(f"{element}: bends and slopes are 0, expected some that are not")


def _check_numbers(what: str, value: Any, count: int = 1, sign: str = " = ") -> None:
    parts = (value,) if count == 1 else value
    whole = isinstance(parts, tuple | list | np.ndarray) and len(parts) == count
    if not whole or not all(isinstance(x, Real) and not isinstance(x, bool) for x in parts):
        raise InputError(f"{what}{sign}{value!r}, expected {COUNTS.get(count, f'{count} numbers')}")
    if not all(math.isfinite(x) for x in parts):
        finite = "a finite number" if count == 1 else "finite ones"
        raise InputError(f"{what}{sign}{value!r}, expected {finite}")


def _check_length(what: str, value: Any, count: int) -> None:
    _check_numbers(what, value, count, " ")
    length = math.hypot(*value)
    if length == 0:
        raise InputError(f"{what} ({', '.join(['0'] * count)}), expected one of length > 0")
    if not SHORTEST <= length <= LONGEST:
        between = f"expected a length between {SHORTEST:g} and {LONGEST:g}"
        raise InputError(f"{what} {value!r}, {between}")


# ---- From elements to a class --------------------------------------------------------------------

REGULAR = 1e-12
"""Threshold of the reciprocal condition number of M, its diagonal scaled to 1, for zero inertia:
far below that of bodies of very different size, far above the rounding error of 0.
"""


@old_keywords
def mechanism(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    dependent: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> type[Mechanism]:
    """Return the scene class of a declarative description, its numbers the default parameters.

    Args:
        name: name of the class; assign the class to this name.
        links: rigid bodies. The one that is no joint's child is the ground.
        joints: joints, in the order of their coordinates.
        constraints: constraints besides the joints; holonomic ones come first in the scene.
        gravity: acceleration, m/s², or None.
        dependent: names of the coordinates to put first, those that constraints always
            determine.
        pose: coordinates at t = 0 that are not 0, by name.

    Returns:
        A subclass of `Mechanism`; the same one for the same description.

    Raises:
        InputError: the description contradicts itself, has numbers that are none, or more than
            `MAX_DESCRIBED_COORDINATES` coordinates.
    """
    source = mechanism_source(
        name, links, joints, constraints, gravity=gravity, dependent=dependent, pose=pose
    )
    # The class belongs to the caller, one call further up than what accepts old keywords.
    module = sys._getframe(2).f_globals.get("__name__", __name__)
    return source._replace(module=module).scene_class()


def mechanism_source(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    dependent: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> MechanismSource:
    """Return the source of a description's scene class; see `mechanism`."""
    bodies = checked_elements("link", Link, links)
    between = checked_elements("joint", Joint, joints)
    more = checked_elements("constraint", Constraint, constraints)
    pose = {} if pose is None else pose
    validate_elements(bodies, between, more, gravity, pose)
    frames = JointTree(bodies, between)
    source = _source_of(name, frames, more, gravity, distinct("dependent", dependent), pose)
    _check_regular(source)
    return source


def _source_of(
    key: str,
    frames: JointTree,
    constraints: tuple[Constraint, ...],
    gravity: Triple | None,
    first: tuple[str, ...],
    pose: dict[str, float],
) -> MechanismSource:
    slots = _reorder_joints(frames, first)
    for name in pose:
        _coordinate("pose", frames, name)
    bodies = {k: merged_body(frames.bodies[k]) for k in sorted(frames.bodies)}
    if not bodies and "armature" not in frames.numbers:
        raise InputError("nothing that moves has inertia")
    check_positive({slots[k].name: body for k, body in bodies.items()})
    planar = _is_planar(frames, bodies, constraints)
    d, body_indices = 2 if planar else 3, {k: i for i, k in enumerate(bodies)}
    slots = [slot._replace(body=body_indices.get(k)) for k, slot in enumerate(slots)]
    for body in bodies.values():
        _add_body(frames, body, planar)
    held = sorted(constraints, key=lambda c: not KINDS[c.kind].holonomic)  # a stable sort
    closures = tuple(_constraint_spec(frames, constraint, planar) for constraint in held)
    numbers = {name: tuple(v) for name, v in frames.numbers.items()}
    if planar and "offset" in numbers:
        numbers["offset"] = tuple(o[:2] for o in numbers["offset"])
    several = [
        joint.name + part
        for joint in frames.joints.values()
        if len(COORDINATES[joint.kind]) > 1
        for part in COORDINATES[joint.kind]
    ]
    return MechanismSource(
        key,
        Topology(tuple(slots), tuple(frames.coordinates), planar, closures),
        (*numbers.items(), ("gravity", None if gravity is None else tuple(gravity)[:d])),
        tuple(float(pose.get(name, 0.0)) for name in frames.coordinates),
        compound_coordinates=tuple(several),
        pitch_coordinates=tuple(
            frames.coordinate_index[name] for name in several if name.endswith("_pitch")
        ),
        frames=tuple(
            NumberedFrame(name, frame.joint, frame.orientation, (x, y, z))
            for name, frame in frames.link_frames.items()
            for x, y, z in [frame.offset.tolist()]
        ),
        tilted=planar and any(map(is_tilted, bodies.values())),
        fixed_geometry=any(KINDS[c.kind].holonomic and c.points for c in closures),
    )


def _coordinate(what: str, frames: JointTree, name: str) -> int:
    if name not in frames.coordinate_index:
        names = ", ".join(frames.coordinates)
        raise InputError(f"{what} names {name!r}, expected one of: {names}")
    return frames.coordinate_index[name]


def _reorder_joints(frames: JointTree, first: tuple[str, ...]) -> list[ScalarJoint]:
    """Return the scalar joints reordered so that those named `first` have the first coordinates."""
    for name in first:
        _coordinate("dependent", frames, name)
    before = frames.coordinates
    frames.coordinates = [*first, *(name for name in before if name not in first)]
    frames.coordinate_index = {name: i for i, name in enumerate(frames.coordinates)}
    return [
        slot._replace(coordinate=frames.coordinate_index[before[slot.coordinate]])
        for slot in frames.scalar_joints
    ]


def _is_planar(
    frames: JointTree, bodies: dict[int, RigidBody], constraints: tuple[Constraint, ...]
) -> bool:
    """Return whether all motion stays in the plane z = 0."""
    flat = [o[2] for o in frames.numbers.get("offset", [])]
    flat += [body.center[2] for body in bodies.values()]
    flat += [point[2] for c in constraints for _, point in c.points]
    return (
        all(
            slot.kind in PLANAR_JOINTS and slot.orientation is None for slot in frames.scalar_joints
        )
        and all(place.orientation[1:3] == (0, 0) for place in frames.link_frames.values())
        and not any(flat)
    )


def _add_body(frames: JointTree, body: RigidBody, planar: bool) -> None:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia.tolist()
    frames.add_parameter("mass", float(body.mass))
    frames.add_parameter("center", tuple(body.center[: 2 if planar else 3].tolist()))
    frames.add_parameter("moments", zz if planar else (xx, yy, zz))
    frames.add_parameter("products", None if planar else (xy, xz, yz))


def _constraint_spec(frames: JointTree, constraint: Constraint, planar: bool) -> ConstraintSpec:
    d, what = 2 if planar else 3, f"constraint {constraint.name!r}"
    if constraint.kind == "hinge" and planar:
        raise InputError(f"{what}: in the plane a hinge is a pin")
    directions = constraint.directions
    if constraint.kind == "weld":
        directions = _weld_directions(frames, constraint)[: 1 if planar else 3]

    def vector_index(name: str, link: str, a: Triple, shifted: bool) -> tuple[int, int]:
        if link not in frames.link_frames:
            raise InputError(f"{what} is on the link {link!r}, no such link")
        frame: LinkFrame = frames.link_frames[link]
        vector = rotation_matrix(frame.orientation) @ np.array(a) + shifted * frame.offset
        if constraint.kind in ROLLING and name == "directions" and not vector[:d].any():
            raise InputError(f"{what} has the direction {a!r}, and all stays in the plane z = 0")
        number: Any = number_index(name, tuple(vector[:d].tolist()))
        return frame.joint, number

    def number_index(name: str, entry: Any) -> int | None:
        # All rows of a rolling contact share one radius.
        return frames.add_parameter(name, entry, entry if constraint.kind in ROLLING else None)

    points = tuple(vector_index("points", *point, True) for point in constraint.points)
    turned = tuple(vector_index("directions", *direction, False) for direction in directions)
    name = KINDS[constraint.kind].numbers
    if constraint.kind == "coupling":  # an entry for each joint that the first one follows
        ratio, shift, *ratios = constraint.numbers
        number = number_index(name, (ratio, shift))
        for further in ratios:
            number_index(name, (further, 0.0))
    else:
        number = number_index(name, constraint.numbers) if name else None
    coordinates = tuple(_coordinate(what, frames, name) for name in constraint.joints)
    return ConstraintSpec(constraint.kind, constraint.name, points, turned, coordinates, number)


def _weld_directions(frames: JointTree, constraint: Constraint) -> tuple[tuple[str, Triple], ...]:
    """Return directions of one link: the axes of the scalar joint that carries the other link."""
    (link, _), (second_link, _) = constraint.points
    axes = np.array([along for _, along in constraint.directions])
    if second_link in frames.link_frames:
        axes = rotation_matrix(frames.link_frames[second_link].orientation) @ axes
    return tuple((link, (x, y, z)) for x, y, z in axes.tolist())


def _check_regular(source: MechanismSource) -> None:
    """Refuse a description in which something moves without any inertia."""
    scene, names = source.scene_class()(), source.topology.coordinates
    n = len(names)
    # Any pose will do: if M is singular for want of inertia, it is so in a whole neighbourhood.
    q = 0.3 + 0.7 * np.sin(1.0 + np.arange(n))
    parameters = scene.float64_parameters
    prepared = scene.prepare(FLOAT64, parameters, q, 0.0)
    M = scene.terms(parameters, prepared, q, np.zeros(n)).M
    for name, own in zip(names, np.diagonal(M), strict=True):
        if own <= 0:
            raise InputError(f"joint {name!r} moves nothing that has inertia")
    scale = 1 / np.sqrt(np.diagonal(M))
    sizes, motions = np.linalg.eigh(M * np.outer(scale, scale))
    if sizes[0] <= REGULAR * sizes[-1]:
        worst = names[int(np.abs(motions[:, 0]).argmax())]
        raise InputError(
            f"the mass matrix is singular: joint {worst!r} can move, with others or alone, "
            "without anything that has inertia"
        )
