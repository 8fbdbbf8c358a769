"""The `Tree` of a mechanism, for engines that build models of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.mechanics.described.start import numbers_of
from eomcheck.mechanics.described.topology import Plan
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.generic import Array

if TYPE_CHECKING:
    from eomcheck.mechanics.described.mechanism import Mechanism


def tree_of(scene: Mechanism) -> Tree:
    """Return the bodies of a mechanism, joint by joint."""
    return tree_by(scene.plan, numbers_of(scene))


def doubles(entries: Any) -> Array:
    """Return entries as doubles, what is absent as 0."""
    given = np.asarray(entries, object)
    return np.where(given == None, 0.0, given).astype(np.float64)  # noqa: E711


def tree_by(plan: Plan, given: Any) -> Tree:
    """Return the bodies of a plan by its numbers; absolute joints must be in the plane."""
    slots, joints = plan.slots, len(plan.slots)
    rotation = np.tile(np.eye(3), (joints, 1, 1))
    offset, center, inertia = (np.zeros((joints, *shape)) for shape in ((3,), (3,), (3, 3)))
    mass, shift, armature = np.zeros((3, joints))
    coordinates = np.zeros((joints, plan.n))
    for k, slot in enumerate(slots):
        coordinates[k, slot.coordinate] = slot.sense
        if slot.absolute:  # a joint's own coordinate is that less all turns before
            for before in plan.on_the_way(slot.parent):
                coordinates[k] -= coordinates[before] if not slots[before].slides else 0.0
        if slot.follows is not None:
            coordinates[k] *= given.ratio[slot.follows]
            shift[k] = slot.sense * given.shift[slot.follows]
        if slot.turn is not None:
            rotation[k] = doubles(given.rotation[slot.turn])
        if slot.offset is not None:
            offset[k, : plan.d] = doubles(given.offset[slot.offset])[: plan.d]
    for b, k in enumerate(plan.carriers):
        mass[k], center[k, : plan.d] = given.mass[b], doubles(given.center[b])[: plan.d]
        # In the plane one moment counts, and is given to all axes, so that such a body can be.
        inertia[k] = given.inertia[b] if plan.e == 3 else given.inertia[b, 0, 0] * np.eye(3)
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        armature[k] = given.inertia[b, -1, -1]
    parent, kinds = tuple(slot.parent for slot in slots), tuple(slot.kind for slot in slots)
    return Tree(
        parent, kinds, rotation, offset, mass, center, inertia, coordinates, shift, armature
    )
