"""The families of the stability atlas: one file each or two, one line each in `FAMILIES`."""

from __future__ import annotations

from eomcheck.errors import named
from eomcheck.studies.families import (
    chain,
    dependent,
    ratios,
    speed,
    stiffness,
    straight,
    violated,
    wheel_angle,
)
from eomcheck.studies.families.base import Family, Posed

FAMILIES: dict[str, Family] = {
    family.key: family
    for family in (
        stiffness.STIFFNESS,
        wheel_angle.WHEEL_ANGLE,
        straight.STRAIGHT,
        ratios.MASS_RATIO,
        ratios.LENGTH_RATIO,
        chain.LINKS,
        speed.SPEED,
        speed.TURNS,
        dependent.DEPENDENT,
        violated.VIOLATED,
    )
}
"""Key -> family."""


def family_of(key: str) -> Family:
    """Return the family called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("family", key, FAMILIES)


__all__ = ["FAMILIES", "Family", "Posed", "family_of"]
