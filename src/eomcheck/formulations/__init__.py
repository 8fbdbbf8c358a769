"""The formulations: one file each, one line each in `FORMULATIONS`."""

from __future__ import annotations

from eomcheck.errors import named
from eomcheck.formulations import au, el, em, gw, im, kane, ml
from eomcheck.formulations.base import Formulation, Partition

FORMULATIONS: dict[str, Formulation] = {
    formulation.key: formulation
    for formulation in (
        im.IM,
        au.AU,
        el.EL,
        gw.GW,
        em.EM,
        ml.ML,
        kane.KANE,
    )
}
"""Key -> formulation, in the order of the paper's Table I."""


def formulation_of(key: str) -> Formulation:
    """Return the formulation called `key`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("formulation", key, FORMULATIONS)


__all__ = ["FORMULATIONS", "Formulation", "Partition", "formulation_of"]
