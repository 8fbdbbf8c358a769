"""The claim that constraints that others imply change no motion, and share its forces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.claims.registry import Look, Sides, Skipped, claim, measured_where, size
from eomcheck.errors import RefusedError
from eomcheck.evaluation.scene_quantities import Quantities


@claim(
    "redundant-rows",
    "a row that others imply: same q̈, same aᵀλ, least |λ|",
    "",
    "redundant constraints",
)
def redundant_rows(at: Quantities, look: Look) -> Iterator[Sides | Skipped]:
    """With one more row, a sum of the others, and any row left to follow from the rest.

    λ is smallest where it is perpendicular to all that aᵀ takes to 0: the new multiplier is that
    sum of the others.
    """
    M, _, _, a, gamma, _ = at.terms
    if a is None:
        return
    for f, x in look.solutions:
        if not f.redundant or x.multipliers is None:
            continue
        weights, partition = look.added_row
        rows = np.concatenate((a, np.array([weights @ a], a.dtype)))
        drift = np.concatenate((gamma, np.array([weights @ gamma], gamma.dtype)))
        try:
            given = M, at.F, rows, drift, at.v, partition
            (vdot, lambda_), digits = at.solved("redundant rows", f.solution, *given)
        except RefusedError as refusal:
            yield Skipped(f.key, str(refusal))
            continue
        names, force = (at.scene.coordinate_names,), a.T @ x.multipliers
        told = measured_where(digits)
        yield Sides(f"{f.key}, q̈", vdot, x.vdot, names, None, told, may_vanish=True)
        scale = size(rows.T, lambda_)
        forces = rows.T @ lambda_, force
        yield Sides(f"{f.key}, aᵀλ", *forces, names, scale, told, may_vanish=True)
        sides = lambda_[-1:], np.array([weights @ lambda_[:-1]], lambda_.dtype)
        yield Sides(f"{f.key}, |λ|", *sides, (("the new row",),), size(lambda_), told)
