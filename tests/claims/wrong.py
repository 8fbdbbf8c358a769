"""Scenes and formulations with one wrong number, by as little or as much as is asked for.

The number is wrong in the same way in doubles, in a finite field and in balls: an entry x becomes
x + y k / 2^60 with a whole number k, where y is a mass, or x itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import generic

BITS = 60
MANY = 12
"""Entries of one array."""
Entry = tuple[int, ...]


def share(size: float) -> int:
    """Return the whole number k with k / 2^60 next to `size`, at least 1."""
    return max(1, round(size * 2.0**BITS))


def with_entry(array: Any, entry: Entry, change) -> Any:
    """Return a copy of an array or number in which x is change(x) at `entry`."""
    if entry == ():
        return change(array)
    changed = array.copy()
    changed[entry] = change(array[entry])
    return changed


@dataclass(frozen=True)
class Part:
    """A quantity that a function of a scene, a formulation or an engine returns.

    Attributes:
        of: name of the function of a scene, or key of a formulation or engine.
        name: field or number of what it returns, "" for all of it.
        entries: which may be wrong; all of the array if not given.
        relative: whether the error is a share of the entry itself; results of formulations always
            have such errors.
    """

    of: str
    name: str | int = ""
    entries: tuple[Entry, ...] | None = None
    relative: bool = False

    def __str__(self) -> str:
        return f"{self.of}.{self.name}" if self.name != "" else self.of

    def take(self, returned: Any) -> Any:
        """Return the quantity out of what was returned."""
        if self.name == "":
            return returned
        return returned[self.name] if isinstance(self.name, int) else getattr(returned, self.name)

    def put(self, returned: Any, value: Any) -> Any:
        """Return what was returned with another quantity."""
        if self.name == "":
            return value
        if isinstance(self.name, int):
            parts = list(returned)
            parts[self.name] = value
            return tuple(parts)
        return returned._replace(**{self.name: value})

    def each_entry(self, shape: tuple[int, ...]) -> Iterator[Entry]:
        """Yield the entries that are to be wrong, in turn; of a large array some of all parts."""
        every = list(np.ndindex(shape)) if self.entries is None else self.entries
        yield from every[:: 1 + len(every) // MANY]


def wrong_scene(scene: Scene, part: Part, entry: Entry, k: int) -> Scene:
    """Return a scene that is like `scene`, but for one number that one of its functions returns."""
    kind = type(scene)
    function = getattr(kind, part.of)

    @generic
    def changed(parameters, *arguments):
        returned = function(parameters, *arguments)
        mass = parameters.mass[0]
        value = with_entry(
            part.take(returned), entry, lambda x: x + (x if part.relative else mass) * k / 2**BITS
        )
        return part.put(returned, value)

    made = copy(scene)
    wrong = type(kind.__name__, (kind,), {part.of: staticmethod(changed)})
    object.__setattr__(made, "__class__", wrong)
    return made


def wrong_formulation(
    part: Part, entry: Entry, k: int, where: Callable[[Any], bool] = lambda _: True
) -> Formulation:
    """Return a formulation with one wrong number in its result.

    Args:
        part: 0 of its key for the rates, 1 for the multipliers.
        entry: which number.
        k: how wrong, see the module.
        where: says of a number whether it is wrong, by the kind of number that it is.
    """
    right, place = FORMULATIONS[part.of], int(part.name)

    @generic
    def changed(*arguments):
        returned = right.solution(*arguments)
        pair = returned if isinstance(returned, tuple) else (returned,)
        x = pair[place][entry]
        if not where(x):
            return returned
        value = with_entry(pair[place], entry, lambda x: x * (2**BITS + k) / 2**BITS)
        return part.put(returned, value) if isinstance(returned, tuple) else value

    return replace(right, solution=changed)


def shape_in(at: Quantities, part: Part) -> tuple[int, ...]:
    """Return the shape of a part of a scene, or of what a formulation says."""
    if part.of in FORMULATIONS:
        return np.shape(at.rates(FORMULATIONS[part.of])[int(part.name)])
    here = at.parameters, at.prepared
    arguments = {
        "speeds": (*here, at.kinematics),
        "bodies": (*here, at.kinematics),
        "qdot": (*here, at.kinematics),
        "position_residual": (*here, at.q),
        "potential": (*here, at.q),
        "positions": (*here, at.q),
    }
    if hasattr(at.scene, "chain"):
        arguments |= {
            "chain": (*here, at.q, at.x),
            "chain_velocity": (*here, at.q, at.x),
            "chain_acceleration": (*here, at.x, at.x),
        }
    function = getattr(type(at.scene), part.of)
    return np.shape(part.take(function(*arguments.get(part.of, (*here, at.q, at.v)))))
