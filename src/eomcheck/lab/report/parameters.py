"""The parameters of a kind of scene, as a table."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields
from typing import TYPE_CHECKING

import numpy as np

from eomcheck.lab.show.table import Cell, Sheet

if TYPE_CHECKING:
    from eomcheck.mechanics.parameters import Parametric

SHOWN = 5
"""A default with more numbers is named, not shown."""


def parameter_sheet(kind: type[Parametric]) -> Sheet:
    """Return what a scene of this kind is made of, and what random ones are drawn from."""
    rows = []
    for one in fields(kind):
        said = kind.declared[one.name]
        shape: object = said.shape
        if callable(said.shape):
            shape = f"{said.shape.__name__.replace('_', ' ')}, {said.shape_of(3)} if N = 3"
        drawn = "" if said.drawn is None else f"{said.drawn.low:g} to {said.drawn.high:g}"
        kept = [said.sign, "or None" if said.optional else ""]
        about = said.what, str(shape or "number"), said.unit, " ".join(filter(None, kept))
        rows.append((Cell(one.name, "name"), *about, _default(kind, one, said.made), drawn))
    about = ("name", "what it is", "shape", "SI unit", "value", "default", "drawn from")
    return Sheet("parameters", "", about, rows)


def _default(kind: type, one: Field, made: object) -> str:
    if made is not None:
        return "follows"
    if one.default is MISSING:
        return "must be given"
    if np.size(one.default) > SHOWN:
        return f"{kind.__name__}().{one.name}"
    return f"{one.default:.6g}" if isinstance(one.default, float) else str(one.default)
