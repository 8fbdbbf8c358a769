"""A heat map as data: rows of boxes under headings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from eomcheck.lab.show.panel import Axis


class Box(NamedTuple):
    """A box of a heat map.

    Attributes:
        value: what its colour tells, NaN where there is nothing to tell.
        hatched: whether it is.
        framed: whether it has a frame, for it is wrong.
        said: lines of text, which a page shows on demand.
    """

    value: float
    hatched: bool
    framed: bool
    said: Sequence[str] = ()


@dataclass(frozen=True)
class Heat:
    """A heat map: rows of boxes, under headings that some of them share.

    Attributes:
        columns: heading -> number of boxes below it, in each row.
        rows: what stands beside a row -> key of its formulation, its boxes or None where is none.
        colors: what they tell: a title, and a range.
        limit: the value from which on nothing is good.
        hatched: what hatching tells.
        framed: what a frame tells.
        title: above it.
    """

    columns: Mapping[str, int]
    rows: Mapping[str, tuple[str, Sequence[Box | None]]]
    colors: Axis
    limit: float
    hatched: str
    framed: str
    title: str = ""

    @property
    def edges(self) -> list[float]:
        """Where boxes begin and end: each heading is 1 wide."""
        shares = [(place, count) for place, count in enumerate(self.columns.values())]
        return [p + k / count for p, count in shares for k in range(count)] + [len(shares)]

    @property
    def keys(self) -> list[str]:
        """Keys of what is drawn."""
        return [key for key, _ in self.rows.values()]
