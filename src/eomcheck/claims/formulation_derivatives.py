"""The claim about derivatives of accelerations: those of all formulations are equal.

∂v̇/∂q, ∂v̇/∂v, ∂v̇/∂τ and those of λ, by dual numbers. Formulations that read terms define v̇ at
every (q, v): their derivatives are equal entry by entry. Those that read generalized speeds or
quasi-velocities drop the part of v that violates the constraints: with constraints theirs are equal
along variations that keep these to first order, one for each coordinate
(`eomcheck.evaluation.derivatives.tangent_directions`).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.registry import Comparison, EvaluationContext, Skipped, claim
from eomcheck.errors import RefusedError
from eomcheck.evaluation.derivatives import (
    Direction,
    arrays_by_name,
    derivative_arrays,
    derivative_sensitivities,
    solutions_along,
    tangent_directions,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.formulations import Formulation

EVERY = 20
"""Number of states of a run of which one is checked: derivatives by all formulations take longer
than all other claims about formulations."""

SYMBOLS = {"q": "∂v̇/∂q", "v": "∂v̇/∂v", "tau": "∂v̇/∂τ"} | {
    "multipliers_q": "∂λ/∂q",
    "multipliers_v": "∂λ/∂v",
    "multipliers_tau": "∂λ/∂τ",
}
"""Names of arrays of derivatives -> their symbols."""


class _Differentiated(NamedTuple):
    """Arrays of derivatives by name, each column along a direction, and κ · scale of each."""

    arrays: dict[str, Any]
    sensitivities: dict[str, float]


class _Differentiator:
    """Derivatives by formulations, along all directions or along those that keep constraints."""

    def __init__(self, at: Any, context: EvaluationContext):
        self._at, self._exact = at, context.exact
        # A failure replaces the directions of a point (`IdentitySampler`) while the claim runs.
        self._units, self.names = np.stack([*context.directions]), context.direction_names

    def _directions(self, e: Quantities) -> Direction:
        """Return each direction as a rate of q, then of v, then of τ."""
        units, parts = self._units, range(len(Direction._fields))
        return Direction(*(np.concatenate([units * int(i == j) for j in parts]) for i in parts))

    def _tangent_directions(self, e: Any) -> Direction:
        partition = e.partition if self._exact else e.independent_partition
        return tangent_directions(e, self._directions(e), partition)

    def along(self, formulation: Formulation, tangent: bool) -> _Differentiated:
        """Return the derivatives by a formulation.

        Raises:
            RefusedError: as `solutions_along`, or the constraints are dependent.
        """
        at = self._at
        directions = self._tangent_directions if tangent else self._directions
        if self._exact:
            rows = solutions_along(at, formulation, directions(at))
            arrays = arrays_by_name(rows, len(self._units))
            arrays = {name: x.T for name, x in arrays.items()}
            return _Differentiated(arrays, dict.fromkeys(arrays, 0.0))
        arrays = derivative_arrays(at, formulation, directions)
        sizes = derivative_sensitivities(at, formulation, arrays, directions=directions)
        return _Differentiated(arrays, sizes)


@claim(
    "derivatives",
    "∂v̇, ∂λ of one formulation = those of another",
    "",
    "derivatives",
    needs="two formulations that solve one state",
    batchable=False,
    every=EVERY,
)
def derivatives(at: Quantities, context: EvaluationContext) -> Iterator[Comparison | Skipped]:
    """All formulations have the derivatives of v̇ and λ by q, v and τ of the first one."""
    scene, differentiator = at.scene, _Differentiator(at, context)
    # A chain without `chain_load` takes no forces τ.
    solved = [f for f, _ in context.solutions if f.uses != "chain" or scene.chain_load is not None]
    reference = next((f for f in solved if f.uses == "terms"), None)
    if reference is None:
        return
    of_reference = cache(lambda tangent: differentiator.along(reference, tangent))
    for f in solved:
        if f is reference:
            continue
        tangent = at.terms.a is not None and f.uses != "terms"
        subject = f"{f.key} ~ {reference.key}"
        try:
            one, other = differentiator.along(f, tangent), of_reference(tangent)
        except RefusedError as refusal:
            yield Skipped(subject, str(refusal))
            continue
        for name, symbol in SYMBOLS.items():
            if name not in one.arrays or name not in other.arrays:
                continue
            rows = scene.constraint_names if "multipliers" in name else scene.coordinate_names
            sensitivity = one.sensitivities[name] + other.sensitivities[name]
            yield Comparison(
                f"{symbol}, {subject}",
                one.arrays[name],
                other.arrays[name],
                (rows, differentiator.names),
                sensitivity=sensitivity,
                may_vanish=True,
            )
