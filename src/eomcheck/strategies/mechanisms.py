"""Random trees and mechanisms, and URDFs of such trees."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.errors import InputError, distinct
from eomcheck.random_mechanisms.kinds import RandomMechanism, RandomTree, checked_links
from eomcheck.random_mechanisms.urdf import EVERYWHERE, URDF_JOINTS, urdf_text, urdf_tree
from eomcheck.strategies.scenes import Choices, scenes


def random_trees(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomTree]:
    """Return a strategy for trees of rigid bodies, each of which hangs together in another way.

    In the plane or in space, with joints of all kinds, axes, placements and inertias of any
    direction, massless carriers, springs, dampers, rotors, joints that follow others, and gravity,
    or without; closed by nothing. The scene's `made.description` is what it was made of.

    Args:
        min_bodies: smallest number of links, the ground not counted.
        max_bodies: largest number of links.

    Raises:
        InputError: numbers that no such tree has.
    """
    _bodies(min_bodies, max_bodies)
    return scenes(RandomTree, min_bodies, max_bodies)


def random_mechanisms(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomMechanism]:
    """Return a strategy for such trees with constraints whose rows are independent.

    Pins, welds, hinges, rods and points on planes, which make loops; couplings; knife edges; and
    joints that a clock drives. For arguments and errors see `random_trees`.
    """
    _bodies(min_bodies, max_bodies)
    return scenes(RandomMechanism, min_bodies, max_bodies)


def urdfs(
    min_bodies: int = 1,
    max_bodies: int = 8,
    *,
    joints: Iterable[str] = EVERYWHERE,
    mimic: bool = True,
    massless: bool = True,
    dampers: bool = True,
) -> SearchStrategy[str]:
    """Return a strategy for texts of URDFs: random trees in space, joints in any order.

    Each is read by `eomcheck.scenes.from_urdf`, and should be by any other parser.

    Args:
        min_bodies: smallest number of links, the root not counted.
        max_bodies: largest number of links.
        joints: kinds that there may be: "revolute", and any of "prismatic", "fixed", "planar",
            "floating". Where revolute joints have no limits they are written as continuous ones.
        mimic: whether some joints may follow others.
        massless: whether some links may have no inertia: carriers of others, and fixed frames.
        dampers: whether some joints may have dampers.

    Raises:
        InputError: numbers that no such tree has, or kinds of joints that a URDF has not.
    """
    kinds = distinct("joints", joints)
    if "revolute" not in kinds or not URDF_JOINTS.issuperset(kinds):
        known = ", ".join(sorted(URDF_JOINTS))
        raise InputError(f"joints = {kinds!r}, expected 'revolute' and any of: {known}")
    return _bodies(min_bodies, max_bodies).flatmap(
        lambda links: _urdf(links, kinds, mimic, massless, dampers)
    )


@st.composite
def _urdf(draw: Any, links: int, *options: Any) -> str:
    return urdf_text(urdf_tree(links, Choices(draw), *options))


def _bodies(min_bodies: int, max_bodies: int) -> SearchStrategy[int]:
    low, high = (
        checked_links(value, name)
        for name, value in (("min_bodies", min_bodies), ("max_bodies", max_bodies))
    )
    if low > high:
        said = f"min_bodies, max_bodies = {low}, {high}"
        raise InputError(f"{said}, expected min_bodies <= max_bodies")
    return st.integers(low, high)
