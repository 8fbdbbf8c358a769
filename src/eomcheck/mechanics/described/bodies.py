"""Bodies that are fixed to each other, as one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from eomcheck.errors import InputError
from eomcheck.mechanics.described.quaternions import Quaternion, rotation
from eomcheck.mechanics.described.words import Link
from eomcheck.numbers.generic import Array

ROUNDED = 1e-12
"""Relative to the largest moment of inertia, what rounding may have made of 0."""
TOUCHING = 1e-9
"""Relative: a plate's largest moment is the sum of the others, and files have few digits."""


class Rigid(NamedTuple):
    """A body in the frame of its slot."""

    mass: float
    center: Array
    inertia: Array
    """About its centre of mass (3, 3), kg m²."""


def together(bodies: list[Rigid]) -> Rigid:
    """Return several bodies that are fixed to each other as one."""
    if len(bodies) == 1:
        return bodies[0]
    mass = sum(one.mass for one in bodies)
    center, inertia = np.zeros(3), np.zeros((3, 3))
    for one in bodies:
        center += one.mass / (mass or 1.0) * one.center
    for one in bodies:
        away = one.center - center
        inertia += one.inertia + one.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return Rigid(mass, center, inertia)


def rigid(link: Link, turn: Quaternion, offset: Array) -> Rigid | None:
    """Return a link in the frame of the slot on which it sits; None where it has no inertia."""
    if not any((link.mass, *link.moments, *link.products)):
        return None
    R, (xy, xz, yz) = rotation(turn), link.products
    inertia = np.diag(link.moments) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return Rigid(link.mass, offset + R @ np.array(link.center), R @ inertia @ R.T)


def impossible(link: Link) -> bool:
    """Return whether no body has the moments of inertia: one exceeds the sum of the others."""
    (x, y, z), (xy, xz, yz) = link.moments, link.products
    moments = np.linalg.eigvalsh([[x, xy, xz], [xy, y, yz], [xz, yz, z]])
    # One below 0 too, but for rounding: the sum of the lower two is then below the larger of them.
    return bool(moments[2] > moments[:2].sum() * (1 + TOUCHING))


def doubtful(links: Iterable[Link]) -> str:
    """Return in one sentence which links have moments of inertia that no body has; "" of none."""
    names = ", ".join(repr(link.name) for link in links if impossible(link))
    if not names:
        return ""
    return f"No body has the moments of inertia of {names}: one exceeds the sum of the others."


def check_positive(bodies: dict[str, Rigid]) -> None:
    """Refuse a moment of inertia below 0, but for rounding of the largest one.

    Args:
        bodies: name of the joint that carries it -> body.
    """
    moments = {name: np.linalg.eigvalsh(one.inertia) for name, one in bodies.items()}
    largest = max((float(np.abs(one).max()) for one in moments.values()), default=0.0)
    for name, one in moments.items():
        if one[0] < -ROUNDED * largest:
            raise InputError(
                f"the body behind joint {name!r} has the principal moment of inertia "
                f"{one[0]:.6g} kg m², expected none below 0"
            )
