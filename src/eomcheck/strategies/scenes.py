"""Scenes of a kind: their parameters, and how those hang together that hang together otherwise."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.errors import RefusedError
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake
from eomcheck.strategies.entries import entry_of, from_ranges, interval, links_between

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
    """Return a strategy for snakes whose links differ, with springs and dampers or without.

    Args:
        min_links: smallest N.
        max_links: largest N.
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
    interval("mass", mass, smallest)
    interval("length", length, smallest)
    interval("inertia", inertia, 0.0)
    interval("stiffness", stiffness, 0.0)
    interval("damping", damping, 0.0)
    interval("wheel_angle", (0.0, wheel_angle), 0.0)
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
    """Return a strategy for scenes of a kind, drawn from its `ranges`.

    Args:
        kind: the kind of scene.
        min_links: smallest number of links, for a kind that has one.
        max_links: largest number of links.

    Raises:
        InputError: numbers of links that no such scene can have.
    """
    links = links_between(min_links, max_links) if kind.has_links else st.none()
    return links.flatmap(lambda n: _topologies(kind, n).flatmap(lambda one: _of_kind(one, n)))


def _of_kind(kind: type[S], links: int | None) -> SearchStrategy[S]:
    return from_ranges(kind, kind.ranges(links))


@cache
def _number(low: float, high: float) -> SearchStrategy[float]:
    return entry_of(Range(low, high))


class Choices:
    """Choices by hypothesis, which shrinks them."""

    def __init__(self, draw: Any):
        self._draw = draw

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of several."""
        return self._draw(st.sampled_from(among))

    def whole(self, low: int, high: int) -> int:
        """Return a whole number, both bounds included."""
        return self._draw(st.integers(low, high))

    def number(self, low: float, high: float) -> float:
        """Return a number between bounds."""
        return self._draw(_number(low, high))


@st.composite
def _topologies(draw: Any, kind: type[Scene], links: int | None) -> Any:
    """Return a strategy for kinds whose scenes hang together in one way each."""
    choices = Choices(draw)
    entry = choices.one_of(kind.topologies(links))
    ways = {name: choices.one_of(of) for name, of in entry.items()}
    try:
        return kind.of_topology(links, ways, choices)
    except RefusedError:
        reject()
