"""Why libraries differ on one file: what is known to be read in more than one way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from eomcheck.engines.files.description import Description
from eomcheck.evaluation.tolerance import largest
from eomcheck.numbers.contract import Array

CLOSE = 1e-9
"""Relative: what agrees to this agrees but for digits."""


class Parting(NamedTuple):
    """What we and a library say at one state.

    Attributes:
        description: of the file.
        joints: names of the coordinates.
        v: velocities (n,).
        ours: quantity -> value.
        theirs: quantity -> value.
    """

    description: Description
    joints: tuple[str, ...]
    v: Array
    ours: dict[str, Array]
    theirs: dict[str, Array]

    def error(self, name: str) -> Array:
        """Return theirs - ours."""
        return self.theirs[name] - self.ours[name]

    def same(self, name: str, tolerance: float = CLOSE) -> bool:
        """Return whether they agree but for digits."""
        return largest(self.error(name)) <= tolerance * max(largest(self.ours[name]), 1e-300)


Reason = Callable[[Parting], Iterator[str]]
_REASONS: list[Reason] = []


def _reason(function: Reason) -> Reason:
    _REASONS.append(function)
    return function


def reasons(parting: Parting) -> list[str]:
    """Return a sentence for each reason that explains a difference."""
    return [said for one in _REASONS for said in one(parting)]


@_reason
def _digits(at: Parting) -> Iterator[str]:
    """Yield that all agree to many digits."""
    if all(at.same(name) for name in at.ours):
        apart = max(largest(at.error(x)) / max(largest(at.ours[x]), 1e-300) for x in at.ours)
        yield f"the same but for digits: {apart:.0e}, more than rounding of doubles explains"


@_reason
def _damping(at: Parting) -> Iterator[str]:
    """Yield that forces differ by a damping: one number per joint times its velocity."""
    damped = [at.joints.index(x) for x in at.description.damped if x in at.joints]
    if not damped or at.same("forces"):
        return
    error = at.error("forces")
    others = np.delete(error, damped)
    if largest(others) <= CLOSE * max(largest(at.ours["forces"]), 1.0):
        signs = np.sign(error[damped] * at.v[damped])
        if (signs >= 0).all():
            yield f"leaves out the damping of {_few(at, damped)}"


@_reason
def _armature(at: Parting) -> Iterator[str]:
    """Yield that M differs on its diagonal alone."""
    if at.same("M"):
        return
    error = at.error("M")
    beside = error - np.diag(np.diagonal(error))
    if largest(beside) <= CLOSE * largest(at.ours["M"]) and at.same("bias"):
        where = [int(i) for i in np.flatnonzero(np.abs(np.diagonal(error)) > 1e-12)]
        yield f"adds to the diagonal of M alone, as an armature does: {_few(at, where)}"


@_reason
def _gravity(at: Parting) -> Iterator[str]:
    """Yield that gravity is another number."""
    ours, theirs = at.ours["forces"], at.theirs["forces"]
    if at.same("forces") or not ours.any():
        return
    factor = float(ours @ theirs / (ours @ ours))
    if largest(theirs - factor * ours) <= CLOSE * largest(ours):
        yield f"has {factor:.6g} times our forces, as another gravity would give"


@_reason
def _axes(at: Parting) -> Iterator[str]:
    """Yield that some joints turn the other way round."""
    ours, theirs = at.ours["M"], at.theirs["M"]
    if at.same("M"):
        return
    for count in (1, 2):
        for flipped in combinations(range(len(ours)), count):
            signs = np.ones(len(ours))
            signs[list(flipped)] = -1
            if largest(theirs - np.outer(signs, signs) * ours) <= CLOSE * largest(ours):
                yield f"has the opposite axis: {_few(at, list(flipped))}"
                return


@_reason
def _odd_bodies(at: Parting) -> Iterator[str]:
    """Yield what bodies the file has that libraries make something else of."""
    if at.same("M"):
        return
    if at.description.massless:
        names = ", ".join(at.description.massless[:3])
        yield f"the file has moments of inertia without mass ({names}), which libraries may drop"
    if at.description.impossible:
        names = ", ".join(at.description.impossible[:3])
        more = len(at.description.impossible) - 3
        names += f" and {more} more" if more > 0 else ""
        yield f"the file has inertias that no body can have ({names}), which libraries may replace"


def _few(at: Parting, places: list[int]) -> str:
    names = [at.joints[i] for i in places]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
