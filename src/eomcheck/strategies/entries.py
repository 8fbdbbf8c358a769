"""Numbers, and arrays of them, that parameters and coordinates are drawn from."""

from __future__ import annotations

import math
from typing import TypeVar

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy

from eomcheck.errors import InputError, whole_number
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene, finite_array

S = TypeVar("S", bound=Scene)

NEGLIGIBLE = 1e-6
"""Ordinary angles and speeds below this are drawn as 0: products of smaller ones underflow."""


def interval(name: str, bounds: tuple[float, float], lowest: float) -> SearchStrategy[float]:
    """Return a strategy for numbers between bounds.

    Raises:
        InputError: bounds that are not finite, in no order, or below `lowest`.
    """
    try:
        low, high = finite_array(name, bounds, (2,)).tolist()
    except InputError:
        low = high = math.nan
    if not lowest <= low <= high:
        raise InputError(f"{name} = {bounds!r}, expected {lowest:g} <= low <= high, both finite")
    return st.floats(low, high)


def without_tiny(x: float) -> float:
    """Return x, or 0 for what is negligible."""
    return x if abs(x) >= NEGLIGIBLE else 0.0


def vector(entries: SearchStrategy[float], size: int) -> SearchStrategy[list[float]]:
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
    """Return a strategy for sizes from 10^low to 10^high, each decade as often as another."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def from_ranges(kind: type[S], ranges: dict[str, Range]) -> SearchStrategy[S]:
    """Return a strategy for scenes whose parameters are drawn from `ranges`."""
    return st.builds(kind, **{name: parameter_of(one) for name, one in ranges.items()})


def parameter_of(one: Range) -> SearchStrategy:
    """Return a strategy for a number or nested lists of numbers; for None as well if optional."""
    values: SearchStrategy = entry_of(one)
    for size in reversed(one.shape):
        values = vector(values, size)
    return st.none() | values | values if one.optional else values


def entry_of(one: Range) -> SearchStrategy[float]:
    """Return a strategy for one number of a range, nothing negligible among them."""
    numbers = st.floats(one.low, one.high)
    return numbers.map(without_tiny) if one.low < 0.0 < one.high else numbers
