"""The public functions of one state: acceleration, velocities and speeds, consistent states.

`acceleration` returns the result of a formulation with its error bound. Positions are assembled to
satisfy the holonomic constraints (loop closure); velocities are computed from generalized speeds
and back; both are checked. Redundant constraints, which the others imply, are named.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eomcheck.errors import InconsistentVelocityError, RefusedError
from eomcheck.evaluation.constraint_rank import RANK, newton, position_residual, repeated_rows
from eomcheck.evaluation.evaluation import Acceleration, Evaluation
from eomcheck.evaluation.perturbed import (
    CONSISTENT_HINT,
    CONTRADICTION,
    acceleration_sensitivity,
    check_consistent,
    perturbed_samples,
    sensitivity_of,
    solution_of,
    violation,
)
from eomcheck.evaluation.tolerance import NOTICEABLE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import formulation_for
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.numbers.generic import EPS, Array
from eomcheck.numbers.linear import least_squares

# ---- Redundant constraints -----------------------------------------------------------------------


class ConstraintRank(NamedTuple):
    """Names of independent and redundant constraints.

    Attributes:
        kept: the independent constraints.
        redundant: the others, which they imply.
    """

    kept: tuple[str, ...]
    redundant: tuple[str, ...]


def independent_constraints(scene: Scene, q, t: float = 0.0) -> ConstraintRank:
    """Return the independent constraints at (q, t), and the redundant ones that they imply.

    With the independent ones `eomcheck.with_constraints` makes a scene without redundant
    constraints, for formulations that cannot handle these.

    Args:
        scene: the scene.
        q: coordinates (n,), which satisfy the constraints to rounding.
        t: time, s.

    Returns:
        The names of the constraints, in the order of `scene.constraint_names`.

    Raises:
        InputError: wrong shape or values that are not finite.
        RefusedError: the rank of a is not clear, or another one in positions nearby.
    """
    at = Evaluation(scene, q, np.zeros(checked_scene(scene).n), t)
    names = scene.constraint_names
    redundant = at.independent_partition.redundant
    without = () if redundant is None else tuple(names[i] for i in redundant)
    return ConstraintRank(tuple(name for name in names if name not in without), without)


def with_redundancy_hint(at: Evaluation, refusal: RefusedError) -> RefusedError:
    """Return a refusal with the names of redundant constraints, if there are any, appended.

    Args:
        at: the state that a formulation refused.
        refusal: its refusal.
    """
    if at.terms.a is None or refusal.what in (RANK, CONTRADICTION):
        return refusal
    try:
        redundant = at.independent_partition.redundant
    except RefusedError as unclear:
        return _with_message(refusal, f"{refusal}; {unclear}")
    if redundant is None:
        return refusal
    names = at.scene.constraint_names
    repeated = "; ".join(repeated_rows(at.terms.a, names, redundant))
    return _with_message(
        refusal,
        f"{refusal}; redundant, for the other constraints imply it: "
        f"{', '.join(names[i] for i in redundant)} (rows of a: {repeated}; uk solves it as it is, "
        "others what eomcheck.with_constraints leaves)",
    )


def _with_message(refusal: RefusedError, why: str) -> RefusedError:
    return RefusedError(refusal.what, refusal.rcond, refusal.threshold, why, refusal.matrix)


# ---- Accelerations, velocities, positions --------------------------------------------------------


def acceleration(
    scene: Scene,
    key: str,
    q,
    v,
    t: float = 0.0,
    *,
    consistent: bool = True,
    pivoted: bool = False,
    tau=None,
) -> Acceleration:
    """Return the constrained acceleration of `scene` by one formulation, with its error bound.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        q: coordinates (n,).
        v: velocities q̇ (n,).
        t: time, s.
        consistent: refuse a v that violates the constraints. With False the formulations in
            generalized speeds take the u of v and ignore the violation: they compute the
            acceleration at another velocity than the others.
        pivoted: for El and Em, choose the dependent coordinates by pivoted QR instead of the
            paper's first r.
        tau: generalized forces (n,) in addition to the scene's own; None for none.

    Returns:
        v̇, the multipliers λ if the formulation has them, condition numbers and the error bound.

    Raises:
        InputError: wrong shapes, values that are not finite, `pivoted` without a partition, a
            formulation that does not apply to the scene.
        UnknownNameError: no such formulation.
        InconsistentVelocityError: v violates the constraints.
        RefusedError: the formulation cannot handle this state; the message names redundant
            constraints, if there are any. Or constraints contradict each other, or their rank is
            not clear.
    """
    formulation = formulation_for(checked_scene(scene), key)
    at = Evaluation(scene, q, v, t)
    at.tau = None if tau is None else finite_array("tau", tau, (scene.n,))
    with suppress(RefusedError):  # later, for it is more than bad input
        at.partition_for(formulation, pivoted)
    if consistent:
        check_consistent(at, CONSISTENT_HINT)
    try:
        result = solution_of(at, formulation, pivoted)
    except RefusedError as refusal:
        raise with_redundancy_hint(at, refusal) from None
    sensitivity = acceleration_sensitivity(at, formulation, pivoted=pivoted)
    # Underflow on the way is smaller than any effect of perturbed inputs.
    return replace(result, error_bound=max(allowed_error(sensitivity), UNDERFLOW))


CORRECTIONS = 3
"""Largest number of corrections of a velocity, absolute and relative ones each."""


def consistent_velocity(at: Evaluation, v: Array) -> Array:
    """Return v (n,) with the smallest correction that makes it satisfy the constraints at `at`.

    A v that satisfies them to well within the tolerance of `check_consistent` is returned
    unchanged. If the residual of a row stays too large, the smallest correction relative to the
    entries of v follows: one entry can be larger than another by decades. The v with the smallest
    residual is returned.
    """
    a = at.terms.a
    if a is None:
        return v
    best, least, left = v, np.inf, v
    for relative in (*CORRECTIONS * (False,), *CORRECTIONS * (True,), None):
        residual, worst = _excess(at, v)
        if worst < least:
            best, least, left = v, worst, residual
        if relative is None or not least > 1 / 4:
            break
        # Entries that have to vanish shrink step by step, though never below their own rounding.
        start, left = (v, residual) if relative else (best, left)
        units = np.maximum(np.abs(start), EPS * largest(start)) if relative else np.ones(len(v))
        rows = np.abs(a * units).max(axis=1) if relative else np.ones(len(a))
        rows[rows == 0] = 1.0
        matrix = a * units / rows[:, None]
        v = start - units * least_squares(matrix, left / rows)
    for power in (1, 2) if least > 1 / 4 else ():
        # The velocity of a coordinate that cannot move is set to exactly 0: it is rounding error.
        negligible = allowed_error(1.0) ** power * largest(v)
        for near in (best, v):
            cleaned = np.where(np.abs(near) <= negligible, 0.0, near)
            worst = _excess(at, cleaned)[1]
            if worst < least:
                best, least = cleaned, worst
    return best


def _excess(at: Evaluation, v: Array) -> tuple[Array, float]:
    """Return a v + b (r,), and the largest ratio of its rows to their allowed rounding error."""
    residual, allowed = violation(at, v)
    with np.errstate(all="ignore"):
        return residual, np.max(np.abs(residual) / np.maximum(allowed, UNDERFLOW), initial=0.0)


def assembled_position(scene: Scene, q, t: float = 0.0) -> Array:
    """Return the coordinates (n,) near q that satisfy the holonomic constraints; q without any.

    They are computed by Newton's method, with the smallest correction in each step.

    Args:
        scene: the scene.
        q: initial coordinates (n,).
        t: time, s.

    Raises:
        InputError: wrong shape, or values that are not finite.
        RefusedError: no such position is found.
    """
    q, v = scene.check_state(q, np.zeros(scene.n), t)
    if scene.position_residual is None:
        return q
    q, step, shrank = newton(Evaluation(scene, q, v, t), q)
    if shrank:
        # Steps also vanish at a singular configuration, where no direction closes the gap.
        gap, allowed = assembly_error(Evaluation(scene, q, v, t))
        if gap <= allowed:
            return q
    raise RefusedError("position", step, 0.0, f"{scene.name}: no closed position is found near q")


def assembly_error(at: Evaluation) -> tuple[float, float]:
    """Return the largest gap of the holonomic constraints, and its allowed rounding error, m."""
    sensitivity = sensitivity_of(at, position_residual, coordinates=True)
    return largest(position_residual(at)), allowed_error(sensitivity)


def velocity(scene: Scene, q, u, t: float = 0.0) -> Array:
    """Return v = W u + offset (n,) of generalized speeds u (p,).

    If W is large and W u cancels, the rounding error of v would violate the constraints; the
    smallest correction that restores them is added then.

    Args:
        scene: the scene.
        q: coordinates (n,).
        u: generalized speeds (p,).
        t: time, s.

    Raises:
        InputError: wrong shapes or values that are not finite.
        RefusedError: the scene has no generalized speeds at (q, t), v overflows, rounding may
            change it by more than 1e-6 of its largest entry, or no v in float64 satisfies the
            constraints.
    """
    u = finite_array("u", u, (checked_scene(scene).p,))
    at = Evaluation(scene, q, np.zeros(scene.n), t)
    at.u = perturbed_samples(at).u = u
    v = representable("v", at.velocity)
    _check_digits("v", at, lambda e: e.velocity)
    corrected = representable("v", consistent_velocity(at, v))
    try:
        check_consistent(Evaluation(scene, q, corrected, t))
    except InconsistentVelocityError as error:
        raise RefusedError("v", float("nan"), 0.0, f"no doubles are near enough: {error}") from None
    if largest(corrected - v) > NOTICEABLE * largest(v):
        message = "no velocity in doubles near W u satisfies the constraints"
        raise RefusedError("v", float("nan"), 0.0, message)
    return corrected


def speeds_of(scene: Scene, q, v, t: float = 0.0) -> Array:
    """Return the generalized speeds u (p,) of a velocity v (n,).

    Args:
        scene: the scene.
        q: coordinates (n,).
        v: velocities (n,).
        t: time, s.

    Raises:
        InputError: wrong shapes or values that are not finite.
        RefusedError: u overflows, or rounding may change it by more than 1e-6 of its largest
            entry.
    """
    at = Evaluation(scene, q, v, t)
    perturbed_samples(at).v = at.v
    u = representable("u", at.u)
    _check_digits("u", at, lambda e: e.u)
    return u


def _check_digits(name: str, at: Evaluation, quantity: Callable[[Evaluation], Array]) -> None:
    """Check that the rounding error of a quantity is at most `NOTICEABLE` times its size."""
    size, sensitivity = largest(quantity(at)), sensitivity_of(at, quantity, solved=True)
    if allowed_error(sensitivity) > NOTICEABLE * size > 0:
        least = allowed_error(1.0) / NOTICEABLE
        raise RefusedError(
            name,
            size / sensitivity,
            least,
            f"{name} cancels: its reciprocal condition number is {size / sensitivity:.2g}, six "
            f"digits need {least:.2g}",
        )


def representable(name: str, x: Array) -> Array:
    """Return x, a float64 array, if it is finite.

    Raises:
        RefusedError: an entry is not finite.
    """
    if not np.isfinite(x).all():
        raise RefusedError(name, float("nan"), 0.0, f"{name} overflows: doubles cannot hold it")
    return x
