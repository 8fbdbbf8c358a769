"""From a description to the kind of scene that it describes."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from eomcheck.errors import InputError, distinct
from eomcheck.mechanics.described.bodies import Rigid, check_positive, together
from eomcheck.mechanics.described.checked import all_of, check_words
from eomcheck.mechanics.described.closures import KINDS
from eomcheck.mechanics.described.frames import Frames, Place
from eomcheck.mechanics.described.mechanism import Made, Mechanism
from eomcheck.mechanics.described.quaternions import rotation
from eomcheck.mechanics.described.topology import ROLLING, Closure, Slot, Topology
from eomcheck.mechanics.described.words import COORDINATES, Constraint, Joint, Link, Triple
from eomcheck.mechanics.tree import PLANAR
from eomcheck.numbers.generic import FLOAT64

REGULAR = 1e-12
"""Below this reciprocal condition number of M, its diagonal scaled to 1, something has no inertia:
far below what bodies of very different size come to, far above what rounding leaves of 0."""


def mechanism(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    first: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> type[Mechanism]:
    """Return the kind of scene that a description describes; its parameters are those given.

    Args:
        name: of the class; give the class this name.
        links: rigid bodies. The one that is no joint's child is the ground.
        joints: in the order of their coordinates.
        constraints: what else holds; holonomic ones come first in the scene.
        gravity: acceleration, m/s², or None.
        first: names of the coordinates that come first, those that constraints always determine.
        pose: coordinates at t = 0 that are not 0, by name.

    Raises:
        InputError: the description contradicts itself, has numbers that are none, or more than
            `MOST` coordinates.
    """
    made = described(name, links, joints, constraints, gravity=gravity, first=first, pose=pose)
    module = sys._getframe(1).f_globals.get("__name__", __name__)
    return made._replace(module=module).kind()


def described(
    name: str,
    links: Iterable[Link],
    joints: Iterable[Joint],
    constraints: Iterable[Constraint] = (),
    *,
    gravity: Triple | None = (0.0, 0.0, -9.81),
    first: Iterable[str] = (),
    pose: dict[str, float] | None = None,
) -> Made:
    """Return what the kind of a description is made of; see `mechanism`."""
    bodies, between = all_of("link", Link, links), all_of("joint", Joint, joints)
    more = all_of("constraint", Constraint, constraints)
    pose = {} if pose is None else pose
    check_words(bodies, between, more, gravity, pose)
    frames = Frames(bodies, between)
    made = _made(name, frames, more, gravity, distinct("first", first), pose)
    _check_regular(made)
    return made


def _made(
    key: str,
    frames: Frames,
    constraints: tuple[Constraint, ...],
    gravity: Triple | None,
    first: tuple[str, ...],
    pose: dict[str, float],
) -> Made:
    slots = _sorted(frames, first)
    for name in pose:
        _coordinate("pose", frames, name)
    bodies = {k: together(frames.rigid[k]) for k in sorted(frames.rigid)}
    if not bodies and "armature" not in frames.numbers:
        raise InputError("nothing that moves has inertia")
    check_positive({slots[k].name: one for k, one in bodies.items()})
    planar = _is_planar(frames, bodies, constraints)
    d, places = 2 if planar else 3, {k: i for i, k in enumerate(bodies)}
    slots = [slot._replace(body=places.get(k)) for k, slot in enumerate(slots)]
    for one in bodies.values():
        _add_body(frames, one, planar)
    held = sorted(constraints, key=lambda one: not KINDS[one.kind].holonomic)  # stable
    closures = tuple(_closure(frames, one, planar) for one in held)
    numbers = {name: tuple(given) for name, given in frames.numbers.items()}
    if planar and "offset" in numbers:
        numbers["offset"] = tuple(one[:2] for one in numbers["offset"])
    several = [
        joint.name + part
        for joint in frames.joints.values()
        if len(COORDINATES[joint.kind]) > 1
        for part in COORDINATES[joint.kind]
    ]
    return Made(
        key,
        Topology(tuple(slots), tuple(frames.coordinates), planar, closures),
        (*numbers.items(), ("gravity", None if gravity is None else tuple(gravity)[:d])),
        tuple(float(pose.get(name, 0.0)) for name in frames.coordinates),
        several=tuple(several),
        away=tuple(frames.place_of[name] for name in several if name.endswith("_pitch")),
        closed=any(KINDS[one.kind].holonomic and one.points for one in closures),
    )


def _coordinate(what: str, frames: Frames, name: str) -> int:
    if name not in frames.place_of:
        known = ", ".join(frames.coordinates)
        raise InputError(f"{what} names {name!r}, expected one of: {known}")
    return frames.place_of[name]


def _sorted(frames: Frames, first: tuple[str, ...]) -> list[Slot]:
    """Return the slots once those named have the first coordinates."""
    for name in first:
        _coordinate("first", frames, name)
    before = frames.coordinates
    frames.coordinates = [*first, *(name for name in before if name not in first)]
    frames.place_of = {name: i for i, name in enumerate(frames.coordinates)}
    return [
        slot._replace(coordinate=frames.place_of[before[slot.coordinate]]) for slot in frames.slots
    ]


def _is_planar(
    frames: Frames, bodies: dict[int, Rigid], constraints: tuple[Constraint, ...]
) -> bool:
    """Return whether nothing leaves the plane z = 0."""
    flat = [one[2] for one in frames.numbers.get("offset", [])]
    flat += [one.center[2] for one in bodies.values()]
    flat += [at[2] for one in constraints for _, at in one.points]
    return (
        all(slot.kind in PLANAR and slot.turn is None for slot in frames.slots)
        and all(place.turn[1:3] == (0, 0) for place in frames.places.values())
        and not any(flat)
    )


def _add_body(frames: Frames, body: Rigid, planar: bool) -> None:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia.tolist()
    frames.number("mass", float(body.mass))
    frames.number("center", tuple(body.center[: 2 if planar else 3].tolist()))
    frames.number("moments", zz if planar else (xx, yy, zz))
    frames.number("products", None if planar else (xy, xz, yz))


def _closure(frames: Frames, one: Constraint, planar: bool) -> Closure:
    d, what = 2 if planar else 3, f"constraint {one.name!r}"
    if one.kind == "hinge" and planar:
        raise InputError(f"{what}: in the plane a hinge is a pin")
    directions = one.directions
    if one.kind == "weld":
        directions = _welded(frames, one)[: 1 if planar else 3]

    def kept(name: str, link: str, at: Triple, shifted: bool) -> tuple[int, int]:
        if link not in frames.places:
            raise InputError(f"{what} is on the link {link!r}, no such link")
        place: Place = frames.places[link]
        there = rotation(place.turn) @ np.array(at) + shifted * place.offset
        if one.kind in ROLLING and name == "directions" and not there[:d].any():
            raise InputError(f"{what} has the direction {at!r}, and all stays in the plane z = 0")
        number: Any = keep(name, tuple(there[:d].tolist()))
        return place.slot, number

    # All rows of what rolls are about one contact.
    keep = frames.shared if one.kind in ROLLING else frames.number

    points = tuple(kept("points", *point, True) for point in one.points)
    turned = tuple(kept("directions", *direction, False) for direction in directions)
    name = KINDS[one.kind].numbers
    number = keep(name, one.numbers) if name else None
    coordinates = tuple(_coordinate(what, frames, name) for name in one.joints)
    return Closure(one.kind, one.name, points, turned, coordinates, number)


def _welded(frames: Frames, one: Constraint) -> tuple[tuple[str, Triple], ...]:
    """Return the directions of a link that are the axes of the slot on which the other link is."""
    (link, _), (other, _) = one.points
    axes = np.array([along for _, along in one.directions])
    if other in frames.places:
        axes = rotation(frames.places[other].turn) @ axes
    return tuple((link, (x, y, z)) for x, y, z in axes.tolist())


def _check_regular(made: Made) -> None:
    """Refuse a description in which something moves without any inertia."""
    scene, names = made.kind()(), made.topology.coordinates
    n = len(names)
    # Anywhere: where M is singular for want of inertia, it is so everywhere near.
    q = 0.3 + 0.7 * np.sin(1.0 + np.arange(n))
    given = scene.parameters(FLOAT64)
    prepared = scene.prepare(FLOAT64, given, q, 0.0)
    M = scene.terms(given, prepared, q, np.zeros(n)).M
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
