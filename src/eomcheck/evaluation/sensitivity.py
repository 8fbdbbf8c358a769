"""How far rounding can go: how much perturbed copies of an evaluation differ from it.

What a change comes to, per step of what all numbers are perturbed by, is κ · scale: how strongly
rounding can change a quantity (`eomcheck.evaluation.tolerance`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.perturbed import Moved, perturbed_copies
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    UNDERFLOW,
    allowed_error,
    conditioned,
    largest,
    largest_of_each,
)
from eomcheck.formulations import Formulation
from eomcheck.numbers.contract import Array
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH

NOISY = 2.0**-12
"""A change by this share of a solution, at so small a step, asks whether anything is left of it."""


def sensitivity_of(
    at: Evaluation,
    quantity: Callable[[Evaluation], Any],
    coordinates: bool = False,
    solved: bool = False,
    together: bool = False,
) -> float:
    """Return how strongly rounding can change a quantity, κ · scale.

    Its size plus its largest change under perturbation, divided by the step. Infinite where a
    perturbed copy cannot be finished. For a quantity that is `solved`, the result of a solve, also
    where the change does not grow with the step: nothing is left of it then.

    Args:
        at: the evaluation.
        quantity: what is looked at, of `at` and of its copies.
        coordinates: whether the coordinates are perturbed too.
        solved: whether it is the result of a solve.
        together: whether the copies have it side by side, with an axis for them in front.
    """
    here = np.asarray(quantity(at))
    size = largest(here)
    with np.errstate(all="ignore"):
        try:
            copies = perturbed_copies(at, coordinates)
            if together:
                changes = largest_of_each(np.asarray(_of(copies[0].together, quantity)) - here)
            else:
                changes = [largest(np.asarray(_of(copy, quantity)) - here) for copy in copies]
        except (RefusedError, np.linalg.LinAlgError):
            return float("inf")
    return float(amplified(size, np.array(changes), solved))


def entry_sensitivity_of(at: Evaluation, quantity: Callable[[Evaluation], Any]) -> Array:
    """Return how strongly rounding can change each entry of a quantity, of its shape.

    The coordinates are perturbed too. Where a perturbed copy cannot be finished it is the size.
    """
    here = np.asarray(quantity(at))
    with np.errstate(all="ignore"):
        try:
            copies = perturbed_copies(at, True)[:SAMPLES]
            changes = [np.abs(np.asarray(_of(copy, quantity)) - here) for copy in copies]
        except (RefusedError, np.linalg.LinAlgError):
            return np.abs(here)
        return np.abs(here) + np.max(changes, axis=0) / STEP


def amplified(size: Any, changes: Any, solved: bool) -> Any:
    """Return how strongly rounding can change what is of this size, of one state or of several.

    Args:
        size: the size (...,).
        changes: largest changes (k, ...) by noise, the last by noise that is stretched.
        solved: see `sensitivity_of`.
    """
    changes, stretched = changes[:-1], changes[-1]
    with np.errstate(all="ignore"):
        found = size + changes.max(axis=0) / STEP
        lost = np.isinf(stretched)
        if solved:
            # What underflows changes in steps of its own, whatever the noise.
            seen = changes[0] > np.maximum(NOISY * size, UNDERFLOW)
            lost = lost | (seen & (stretched < STRETCH / 2 * changes[0]))
    return np.where(lost, np.inf, found)


def _of(copy: Moved, quantity: Callable[[Evaluation], Any]) -> Any:
    with copy.computing("quantity"):
        return quantity(copy)


def acceleration_sensitivity(
    at: Evaluation,
    formulation: Formulation,
    part: str = "vdot",
    *,
    coordinates: bool = False,
    pivoted: bool = False,
) -> float:
    """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`.

    Infinite where C κ ε exceeds `INCONCLUSIVE` for a matrix that was solved, be it by its
    condition number or because its determinant depends so strongly on what it was made of:
    perturbation may then lose the same digits as rounding, and measures nothing.

    Raises:
        RefusedError: as `Evaluation.acceleration`.
    """
    rcond = at.acceleration(formulation, pivoted).rcond
    if rcond and not conditioned(rcond):
        return float("inf")
    found = sensitivity_of(
        at,
        lambda e: getattr(e.acceleration(formulation, pivoted), part),
        coordinates,
        solved=True,
        together=True,
    )
    if np.isinf(found) or not _determined(at, formulation, coordinates, pivoted):
        return float("inf")
    return max(found, _of_what_is_read(at, formulation, part, coordinates, pivoted))


def _of_what_is_read(
    at: Evaluation, formulation: Formulation, part: str, coordinates: bool, pivoted: bool
) -> float:
    """Return κ · scale of what rounding does to the numbers that `formulation` reads, by itself.

    Next to what it does in the formulation it may have the other sign, in all copies by chance;
    who climbs to a small error bound comes to where it has.
    """
    here = getattr(at.acceleration(formulation, pivoted), part)
    together = perturbed_copies(at, coordinates)[0].together
    moved = getattr(together.of_what_is_read(formulation, pivoted), part)
    with np.errstate(all="ignore"):
        return largest(here) + largest(np.asarray(moved)[:SAMPLES] - here) / STEP


def speeds_told(at: Evaluation) -> bool:
    """Return whether W of generalized speeds by a partition is more than rounding.

    Where a_1 is singular but for rounding, ẇ′ found in two ways is two different numbers, and
    copies, perturbed by more than rounding, are nearer to each other than these.
    """
    rcond = at.speeds_rcond
    return not rcond or bool(
        conditioned(rcond) and np.isfinite(sensitivity_of(at, lambda e: e.speeds.W, solved=True))
    )


def _determined(at: Evaluation, formulation: Formulation, coordinates: bool, pivoted: bool) -> bool:
    """Return whether the matrices solved are more than the rounding of what made them.

    They are not where a determinant changes its sign, or jumps because other pivots were taken.
    A right-hand side of zeros has the same solution in every copy, and would not tell.
    """
    key = (formulation.key, pivoted)
    here = at.solves[key]
    for name, solve in perturbed_copies(at, coordinates)[0].together.solves[key].items():
        signs, logs = solve.sign[:SAMPLES], solve.log_determinant[:SAMPLES]
        changes = np.abs(logs - here[name].log_determinant) * np.log(2.0)
        told = (signs == here[name].sign) & (allowed_error(changes / STEP) <= INCONCLUSIVE)
        if not told.all():
            return False
    return True
