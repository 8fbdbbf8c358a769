"""What a list of operations depends on, and the doubles that it reads: arguments gone through."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np

from eomcheck.numbers.contract import Array
from eomcheck.numbers.lanes import LaneArray


def holds_doubles(x: Any) -> bool:
    """Return whether x is an array of doubles, or of lanes."""
    return isinstance(x, LaneArray) or (isinstance(x, np.ndarray) and x.dtype == np.float64)


def gathered(x: Any, front: int, doubles: list[Array]) -> Hashable:
    """Return what a list of operations depends on; add arrays of doubles, in order, to `doubles`.

    Args:
        x: an argument, or a record of them.
        front: axes in front that do not belong to it, see `Noise.shape`.
        doubles: where to.
    """
    if holds_doubles(x):
        doubles.append(x)
        return x.shape[front:]
    if isinstance(x, np.ndarray):
        return x.shape, x.tobytes()
    if isinstance(x, tuple):
        return type(x), *[gathered(part, front, doubles) for part in x]
    return x


RECORDS = 64
"""Records that are remembered: of one state several functions read the same ones many times."""


class Seen:
    """Records of arrays that were gathered, with what `gathered` found in each."""

    def __init__(self):
        self._found: dict[tuple[int, int], tuple[tuple, Hashable, list[Array]]] = {}

    def key(self, x: Any, front: int, doubles: list[Array]) -> Hashable:
        """Return what a list of operations depends on, see `gathered`; a record is read once."""
        if not isinstance(x, tuple):
            return gathered(x, front, doubles)
        place = id(x), front
        known = self._found.get(place)
        if known is None or known[0] is not x:
            mine: list[Array] = []
            known = x, gathered(x, front, mine), mine
            if len(self._found) >= RECORDS:
                self._found.clear()
            self._found[place] = known
        doubles += known[2]
        return known[1]
