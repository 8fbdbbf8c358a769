"""The families of the stability atlas, one line each in `FAMILIES`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from eomcheck.lab.studies.stability.families import dependent, every, singular, snake
from eomcheck.lab.studies.stability.families.base import Family, Posed
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES, Snake


def _families_of(kind: type[Scene]) -> Iterator[Family]:
    yield from every.families_of_kind(kind)
    yield from (family for family in singular.OF_SINGLE_SCENES if family.about == kind.key)


FAMILIES: dict[str, Family] = {
    family.key: family
    for family in (
        snake.STIFFNESS,
        snake.WHEEL_ANGLE,
        snake.STRAIGHT,
        snake.MASS_RATIO,
        snake.LENGTH_RATIO,
        snake.LINKS,
        snake.SPEED,
        snake.TURNS,
        dependent.DEPENDENT,
        snake.VIOLATED,
        *(family for kind in SCENES.values() if kind is not Snake for family in _families_of(kind)),
    )
}
"""Key -> family."""


def families_about(kinds: Iterable[type[Scene]]) -> tuple[Family, ...]:
    """Return the families that say something of these kinds of scene."""
    keys = {kind.key for kind in kinds}
    return tuple(family for family in FAMILIES.values() if family.about in keys)


__all__ = ["FAMILIES", "Family", "Posed", "families_about"]
