"""A tree of rigid bodies for external engines: a neutral description without any equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.numbers.generic import Array

KINDS = ("px", "py", "pz", "rx", "ry", "rz")
"""Kinds of joints: prismatic along, or revolute about, an axis of their own frame."""

PLANAR = ("px", "py", "rz")
"""Kinds of joints that keep a body in the plane z = 0."""


class Tree(NamedTuple):
    """Rigid bodies on joints with one coordinate each.

    Joint j is mounted on joint `parent[j]` (-1: the ground), turned by `rotation[j]` and displaced
    by `offset[j]`, and carries one body, or none: mass and inertia 0. The order is depth first: the
    subtree of a joint follows it immediately. Joint coordinates are x = `coordinates` q + `shift`.
    """

    parent: tuple[int, ...]
    joint: tuple[str, ...]
    """Kind of each joint, one of `KINDS`."""
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


def planar_tree(
    parent: tuple[int, ...],
    joint: tuple[str, ...],
    offset: Array,
    mass: Array,
    center: Array,
    inertia: Array,
    coordinates: Array,
) -> Tree:
    """Return a tree in the plane z = 0, with one moment of inertia about z per joint (n_j,).

    In the plane no other moment counts. All three axes get it, because many libraries refuse a
    physically impossible body, such as one with (0, 0, I).
    """
    turned, joints = np.asarray(inertia, np.float64)[:, None, None] * np.eye(3), len(joint)
    seats = np.broadcast_to(np.eye(3), (joints, 3, 3))
    none = np.zeros(joints)
    return Tree(parent, joint, seats, offset, mass, center, turned, coordinates, none, none.copy())
