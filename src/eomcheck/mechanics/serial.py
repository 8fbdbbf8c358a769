"""Links in the plane, one behind the other: their motion in the second derivation, their tree."""

from __future__ import annotations

import numpy as np

from eomcheck.mechanics.tree import Tree, planar_tree
from eomcheck.numbers.contract import Array
from eomcheck.numbers.generic import generic


@generic
def passed_on(length, angles, x, y, omega):
    """Return the velocities of links one behind the other, centres (N, 2) and rotation (N, 1).

    Passed on from joint to joint: the first moves with (x, y), link i turns at omega_i.
    """
    links = length.size
    V = np.zeros((links, 2), omega.dtype)
    for i in range(links):
        V[i, 0] = x - length[i] / 2 * omega[i] * angles.sin[i]
        V[i, 1] = y + length[i] / 2 * omega[i] * angles.cos[i]
        x = x - length[i] * omega[i] * angles.sin[i]
        y = y + length[i] * omega[i] * angles.cos[i]
    return V, omega.reshape(links, 1)


def serial_tree(mass: Array, length: Array, inertia: Array, free: bool) -> Tree:
    """Return links one behind the other, RZ each and by relative angles, on a pin or `free`."""
    links, before = mass.size, 2 if free else 0
    n = links + before
    offset, center = np.zeros((2, n, 3))
    offset[before + 1 :, 0], center[before:, 0] = length[:-1], length / 2
    coordinates = np.eye(n)
    coordinates[before:, before:] -= np.eye(links, k=-1)
    return planar_tree(
        parent=tuple(range(-1, n - 1)),
        joint=(*("px", "py")[:before], *["rz"] * links),
        offset=offset,
        mass=np.r_[np.zeros(before), mass],
        center=center,
        inertia=np.r_[np.zeros(before), inertia],
        coordinates=coordinates,
    )
