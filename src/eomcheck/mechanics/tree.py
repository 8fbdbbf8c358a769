"""A tree of rigid bodies as engines build it: a neutral description without any equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array

KINDS = ("px", "py", "pz", "rx", "ry", "rz")
"""Kinds of joints: prismatic along, or revolute about, an axis of their own frame."""

PLANAR = ("px", "py", "rz")
"""Those that leave nothing out of the plane z = 0."""


class Tree(NamedTuple):
    """Rigid bodies on joints with one coordinate each.

    Joint j sits on joint `parent[j]` (-1: the ground), turned by `rotation[j]` and displaced by
    `offset[j]`, and carries one body, or none: mass and inertia 0. Depth first: what sits on a
    joint follows it before anything else does. Joint coordinates are x = `coordinates` q + `shift`.
    """

    parent: tuple[int, ...]
    joint: tuple[str, ...]
    """Kind of each joint, one of `KINDS`."""
    rotation: Array
    """Orientation of each joint's seat in the frame of its parent (n_j, 3, 3)."""
    offset: Array
    """Its position there (n_j, 3), m."""
    mass: Array
    """(n_j,), kg."""
    center: Array
    """Centre of mass in the frame of the joint (n_j, 3), m."""
    inertia: Array
    """About the centre of mass, along the axes of the joint (n_j, 3, 3), kg m²."""
    coordinates: Array
    """(n_j, n)."""
    shift: Array
    """(n_j,), m or rad."""
    armature: Array
    """What each joint's own coordinate has to move besides (n_j,), kg m² or kg."""


def planar_tree(
    parent: tuple[int, ...],
    joint: tuple[str, ...],
    offset: Array,
    mass: Array,
    center: Array,
    inertia: Array,
    coordinates: Array,
) -> Tree:
    """Return bodies that stay in the plane z = 0, with one moment of inertia each (n_j,), about z.

    In the plane no other counts. It is given to all three axes, because many libraries refuse a
    body that cannot exist, such as one with (0, 0, I).
    """
    turned, joints = np.asarray(inertia, np.float64)[:, None, None] * np.eye(3), len(joint)
    seats = np.broadcast_to(np.eye(3), (joints, 3, 3))
    none = np.zeros(joints)
    return Tree(parent, joint, seats, offset, mass, center, turned, coordinates, none, none.copy())
