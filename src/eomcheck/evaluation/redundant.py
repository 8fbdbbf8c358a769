"""Redundant constraints by name: which they are, and whether they contradict the others."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Acceleration, Evaluation
from eomcheck.evaluation.rank import RANK
from eomcheck.evaluation.sensitivity import sensitivity_of
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import Formulation
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.contract import Array

CONTRADICTION = "gamma"
"""What refusals call it."""


class Dependence(NamedTuple):
    """Names of constraints.

    Attributes:
        kept: those that are independent.
        redundant: the others, which they imply.
    """

    kept: tuple[str, ...]
    redundant: tuple[str, ...]


def independent_constraints(scene: Scene, q, t: float = 0.0) -> Dependence:
    """Return which constraints are independent at (q, t), and which they imply.

    Those kept go to `eomcheck.with_constraints`, which gives formulations that cannot do with
    redundant constraints a scene without them.

    Args:
        scene: the scene.
        q: coordinates (n,), which satisfy the constraints to rounding.
        t: time, s.

    Raises:
        InputError: wrong shape or values that are not finite.
        RefusedError: the rank of a is not clear, or another one in positions nearby.
    """
    at = Evaluation(scene, q, np.zeros(checked_scene(scene).n), t)
    names = scene.constraint_names
    redundant = at.independent_partition.redundant
    without = () if redundant is None else tuple(names[i] for i in redundant)
    return Dependence(tuple(name for name in names if name not in without), without)


def explained(at: Evaluation, refusal: RefusedError) -> RefusedError:
    """Return a refusal that says which constraints are redundant, where some are.

    Args:
        at: where a formulation refused.
        refusal: what it said.
    """
    if at.terms.a is None or refusal.what in (RANK, CONTRADICTION):
        return refusal
    try:
        redundant = at.independent_partition.redundant
    except RefusedError as unclear:
        return _saying(refusal, f"{refusal}; {unclear}")
    if redundant is None:
        return refusal
    names = ", ".join(at.scene.constraint_names[i] for i in redundant)
    return _saying(
        refusal,
        f"{refusal}; redundant, for the other constraints imply it: {names} (uk solves it as it "
        "is, others what eomcheck.with_constraints leaves)",
    )


def _saying(refusal: RefusedError, why: str) -> RefusedError:
    return RefusedError(refusal.what, refusal.rcond, refusal.threshold, why, refusal.matrix)


def solution_of(at: Evaluation, formulation: Formulation, pivoted: bool = False) -> Acceleration:
    """Return the result of a formulation, for which no redundant constraint is violated.

    Raises:
        RefusedError: as `Evaluation.acceleration`, or constraints contradict each other.
    """
    found = at.acceleration(formulation, pivoted)
    if formulation.redundant and at.independent_partition.redundant is not None:
        check_no_contradiction(at, formulation, found)
    return found


def check_no_contradiction(at: Evaluation, formulation: Formulation, found: Acceleration) -> None:
    """Check that there is an acceleration that satisfies redundant constraints as well.

    Args:
        at: where.
        formulation: one that redundant constraints are fine for.
        found: what it said.

    Raises:
        RefusedError: there is none; names the row that is violated most.
    """

    def residual(e: Any) -> Array:
        a, gamma = e.terms.a, e.terms.gamma
        return np.asarray(a @ e.acceleration(formulation).vdot + gamma)

    left, (_, _, _, a, gamma, _) = np.abs(residual(at)), at.terms
    size = float((np.abs(a) @ np.abs(found.vdot) + np.abs(gamma)).max())
    allowed = allowed_error(sensitivity_of(at, residual, solved=True) + size)
    worst = int(np.argmax(left))
    if left[worst] > allowed:
        raise RefusedError(
            CONTRADICTION,
            allowed / float(left[worst]),
            1.0,
            f"the constraint of {at.scene.constraint_names[worst]} contradicts the others: "
            f"|a v̇ + gamma| = {left[worst]:.3g} m/s² for every v̇, allowed {allowed:.3g}",
        )
