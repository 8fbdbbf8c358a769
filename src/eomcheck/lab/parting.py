"""What we and a library say at one state, and what explains that they differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eomcheck.engines.file_engine import Description
from eomcheck.engines.floating_base import BaseVelocity, FreeBase
from eomcheck.evaluation.tolerance import INCONCLUSIVE, largest
from eomcheck.numbers.generic import Array

CLOSE, ROUNDED = 1e-8, 1e-13
"""Relative: what agrees to this agrees but for digits; but for rounding."""

TERMS = "M", "bias", "gravity"


def scale_of(entry: float, summed: float) -> float:
    """Scale of relative differences: the largest entry, or the terms that cancelled.

    Args:
        entry: the largest entry.
        summed: size of the terms that entries are summed from; it counts where these have cancelled
            to less than a thousandth of it.
    """
    return summed if entry < INCONCLUSIVE * summed else entry


class Parting(NamedTuple):
    """What we and a library say at one state.

    Attributes:
        description: of the file.
        joints: names of the coordinates.
        v: velocities (n,).
        ours: quantity -> value.
        theirs: quantity -> value.
        summed: quantity -> size of the terms that it is summed from, 0 where it is not known.
        free: how the frame moves that the library fixes to a free base, and by what velocity it
            is taken to tell it; None where the base is held.
    """

    description: Description
    joints: tuple[str, ...]
    v: Array
    ours: dict[str, Array]
    theirs: dict[str, Array]
    summed: dict[str, float]
    free: tuple[FreeBase, BaseVelocity] | None = None

    def error(self, name: str) -> Array:
        """Return theirs - ours."""
        return self.theirs[name] - self.ours[name]

    def same(self, name: str, tolerance: float = CLOSE) -> bool:
        """Return whether they agree but for digits."""
        scale = scale_of(largest(self.ours[name]), self.summed.get(name, 0.0))
        return largest(self.error(name)) <= tolerance * max(scale, 1e-300)

    @property
    def terms_agree(self) -> bool:
        """Whether M, bias and gravity agree but for digits."""
        return all(self.same(name) for name in TERMS)

    @property
    def damped(self) -> list[int]:
        """Coordinates of joints with dampers."""
        return [i for i, name in enumerate(self.joints) if name in self.description.damped]

    @property
    def leaves_out_damping(self) -> bool:
        """Whether all that accelerations differ by is what dampers take.

        M times what is missing is then along the velocity, at joints with dampers alone.
        """
        if "q̈" not in self.ours or self.same("q̈") or not (self.damped and self.terms_agree):
            return False
        missing = self.ours["M"] @ self.error("q̈")
        others = np.delete(missing, self.damped)
        along = missing[self.damped] * self.v[self.damped] >= 0
        taken = largest(self.ours["forces"] - self.ours["gravity"])
        close = CLOSE * max(largest(self.ours["M"] @ self.ours["q̈"]), taken)
        return largest(others) <= close and bool(along.all())


class Why(NamedTuple):
    """What explains a difference.

    Attributes:
        sentence: what it is.
        label: the same in a word or two, where it explains all that differs; "" where it may not.
    """

    sentence: str
    label: str = ""
