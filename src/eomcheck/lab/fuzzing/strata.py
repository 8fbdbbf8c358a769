"""Strata of a kind of scene: its structures, by numbers of links and optional terms."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import NamedTuple

from eomcheck.mechanics.scene import Scene

MOST_STRUCTURES = 16
"""Structures of one number of links at most: with all optional parameters there, or not."""


class Stratum(NamedTuple):
    """A structure: what decides which terms there are, and of which size."""

    links: int | None
    absent: tuple[str, ...]

    @property
    def name(self) -> str:
        """What reports call it."""
        size = "" if self.links is None else f"{self.links} links"
        without = f"without {', '.join(self.absent)}" if self.absent else ""
        return ", ".join(part for part in (size, without) if part) or "all terms"


def strata_of(kind: type[Scene], links: Iterable[int]) -> list[Stratum]:
    """Return the structures of a kind of scene with numbers of links, if it has such."""
    found: list[Stratum] = []
    for count in links if kind.has_links else (None,):
        ranges = kind.ranges(count)
        optional = [name for name, one in ranges.items() if one.optional and 0 not in one.shape]
        for there in list(product((True, False), repeat=len(optional)))[:MOST_STRUCTURES]:
            absent = (name for name, is_there in zip(optional, there, strict=True) if not is_there)
            found.append(Stratum(count, tuple(absent)))
    return found
