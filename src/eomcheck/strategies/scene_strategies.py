"""Strategies for scenes: parameters within their ranges, random mechanisms, texts of URDFs.

A scene class defines the range of each parameter, and, if its scenes differ in topology, the
topologies to choose from. Hypothesis makes all choices, so that it can shrink them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.descriptions.random_mechanisms import RandomMechanism, RandomTree, checked_links
from eomcheck.descriptions.random_trees import EVERYWHERE, URDF_JOINTS, urdf_text, urdf_tree
from eomcheck.errors import InputError, RefusedError, distinct, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.scenes import Snake

# ---- Scenes of a class ---------------------------------------------------------------------------

S = TypeVar("S", bound=Scene)
T = TypeVar("T")


def snakes(
    min_links: int = 1,
    max_links: int = 8,
    *,
    mass: tuple[float, float] = (0.1, 10.0),
    length: tuple[float, float] = (0.1, 10.0),
    inertia: tuple[float, float] = (0.01, 10.0),
    stiffness: tuple[float, float] = (0.0, 1e4),
    damping: tuple[float, float] = (0.0, 100.0),
    wheel_angle: float = 1.0,
) -> SearchStrategy[Snake]:
    """Return a strategy for snakes of different links, with springs and dampers or without.

    Args:
        min_links: smallest number of links N.
        max_links: largest number of links N.
        mass: bounds, kg.
        length: bounds, m.
        inertia: bounds, kg m².
        stiffness: bounds, N m/rad.
        damping: bounds, N m s/rad.
        wheel_angle: largest |α|, rad.

    Raises:
        InputError: bounds that no snake can have.
    """
    links = links_between(min_links, max_links)
    smallest = np.nextafter(0.0, 1.0)
    bounded_floats("mass", mass, smallest)
    bounded_floats("length", length, smallest)
    bounded_floats("inertia", inertia, 0.0)
    bounded_floats("stiffness", stiffness, 0.0)
    bounded_floats("damping", damping, 0.0)
    bounded_floats("wheel_angle", (0.0, wheel_angle), 0.0)
    bounds = {
        "mass": mass,
        "length": length,
        "inertia": inertia,
        "stiffness": stiffness,
        "damping": damping,
        "wheel_angle": (-wheel_angle, wheel_angle),
    }

    def build(n: int) -> SearchStrategy[Snake]:
        ranges = Snake.ranges(n)
        for name, (low, high) in bounds.items():
            ranges[name] = ranges[name]._replace(low=low, high=high)
        return from_ranges(Snake, ranges)

    return links.flatmap(build)


def scenes(kind: type[S], min_links: int = 1, max_links: int = 8) -> SearchStrategy[S]:
    """Return a strategy for scenes of a class, with parameters from its `ranges`.

    Args:
        kind: the scene class.
        min_links: smallest number of links, for a class that has one.
        max_links: largest number of links, likewise.

    Raises:
        InputError: numbers of links that no such scene can have.
    """
    links = links_between(min_links, max_links) if kind.has_links else st.none()
    return links.flatmap(lambda n: _topologies(kind, n).flatmap(lambda x: _of_kind(x, n)))


def _of_kind(kind: type[S], links: int | None) -> SearchStrategy[S]:
    return from_ranges(kind, kind.ranges(links))


@cache
def _number(low: float, high: float) -> SearchStrategy[float]:
    return entry_of(Range(low, high))


class HypothesisChoices:
    """A source of random choices made by hypothesis, so that it can shrink them."""

    def __init__(self, draw: Any):
        self._draw = draw

    def one_of(self, among: Sequence[T]) -> T:
        """Return one element of a sequence."""
        return self._draw(st.sampled_from(among))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number, both bounds included."""
        return self._draw(st.integers(low, high))

    def number(self, low: float, high: float) -> float:
        """Return a number between bounds."""
        return self._draw(_number(low, high))


@st.composite
def _topologies(draw: Any, kind: type[Scene], links: int | None) -> Any:
    """Return a strategy for scene classes with one fixed topology each."""
    choices = HypothesisChoices(draw)
    entry = choices.one_of(kind.topologies(links))
    ways = {name: choices.one_of(of) for name, of in entry.items()}
    try:
        return kind.of_topology(links, ways, choices)
    except RefusedError:
        reject()


# ---- Random trees, mechanisms and URDFs ----------------------------------------------------------


def random_trees(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomTree]:
    """Return a strategy for open-loop trees of rigid bodies of random topology.

    In the plane or in space, with joints of all types, axes, placements and inertias of any
    direction, and with or without massless carriers, springs, dampers, rotors, mimic joints and
    gravity. The declarative description of a scene is its `source.description`.

    Args:
        min_bodies: smallest number of links, the ground not counted.
        max_bodies: largest number of links.

    Raises:
        InputError: numbers that no such tree has.
    """
    _bodies(min_bodies, max_bodies)
    return scenes(RandomTree, min_bodies, max_bodies)


def random_mechanisms(min_bodies: int = 1, max_bodies: int = 12) -> SearchStrategy[RandomMechanism]:
    """Return a strategy for random trees with independent constraints.

    Pins, welds, hinges, rods and points on planes, which close loops; couplings; knife edges; and
    joints driven by the clock. For arguments and errors see `random_trees`.
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

    `eomcheck.scenes.from_urdf` reads each of them, and any other parser should.

    Args:
        min_bodies: smallest number of links, the root not counted.
        max_bodies: largest number of links, likewise.
        joints: allowed joint types: "revolute", and any of "prismatic", "fixed", "planar",
            "floating". Revolute joints without limits are written as continuous ones.
        mimic: whether some joints may follow others.
        massless: whether some links may have no inertia: carriers of others, and fixed frames.
        dampers: whether some joints may have dampers.

    Raises:
        InputError: numbers that no such tree has, or joint types that do not exist in URDF.
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
    return urdf_text(urdf_tree(links, HypothesisChoices(draw), *options))


def _bodies(min_bodies: int, max_bodies: int) -> SearchStrategy[int]:
    low, high = (
        checked_links(value, name)
        for name, value in (("min_bodies", min_bodies), ("max_bodies", max_bodies))
    )
    if low > high:
        bounds = f"min_bodies, max_bodies = {low}, {high}"
        raise InputError(f"{bounds}, expected min_bodies <= max_bodies")
    return st.integers(low, high)


# ---- Numbers and arrays --------------------------------------------------------------------------


NEGLIGIBLE = 1e-6
"""Magnitude below which ordinary angles and speeds are drawn as 0: products would underflow."""


def bounded_floats(name: str, bounds: tuple[float, float], lowest: float) -> SearchStrategy[float]:
    """Return a strategy for numbers between bounds.

    Raises:
        InputError: bounds that are not finite, not in order, or below `lowest`.
    """
    try:
        low, high = finite_array(name, bounds, (2,)).tolist()
    except InputError:
        low = high = math.nan
    if not lowest <= low <= high:
        raise InputError(f"{name} = {bounds!r}, expected {lowest:g} <= low <= high, both finite")
    return st.floats(low, high)


def without_tiny(x: float) -> float:
    """Return x, or 0 if its magnitude is below `NEGLIGIBLE`."""
    return x if abs(x) >= NEGLIGIBLE else 0.0


def lists_of(entries: SearchStrategy[float], size: int) -> SearchStrategy[list[float]]:
    """Return a strategy for lists of `size` entries."""
    return st.lists(entries, min_size=size, max_size=size)


def links_between(min_links: int, max_links: int) -> SearchStrategy[int]:
    """Return a strategy for numbers of links.

    Raises:
        InputError: no such number, or none between them.
    """
    low, high = whole_number("min_links", min_links), whole_number("max_links", max_links)
    if low > high:
        raise InputError(f"min_links, max_links = {low}, {high}, expected min_links <= max_links")
    return st.integers(low, high)


def magnitudes(low: float, high: float) -> SearchStrategy[float]:
    """Return a strategy for numbers from 10^low to 10^high, log-uniform."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def from_ranges(kind: type[S], ranges: dict[str, Range]) -> SearchStrategy[S]:
    """Return a strategy for scenes with parameters from `ranges`."""
    return st.builds(kind, **{name: parameter_of(one) for name, one in ranges.items()})


def parameter_of(one: Range) -> SearchStrategy:
    """Return a strategy for a number or nested lists of numbers; for None as well if optional."""
    values: SearchStrategy = entry_of(one)
    for size in reversed(one.shape):
        values = lists_of(values, size)
    return st.none() | values | values if one.optional else values


def entry_of(one: Range) -> SearchStrategy[float]:
    """Return a strategy for one number of a range, zero instead of negligible numbers."""
    numbers = st.floats(one.low, one.high)
    return numbers.map(without_tiny) if one.low < 0.0 < one.high else numbers
