"""The rank of the constraints at a state, decided once, outside of the formulations.

Rows of a are taken one by one by pivoted QR, the largest first that is left. Each entry of a is
known up to its rounding error, which is measured by perturbing coordinates and parameters; so is
then the distance of a row from the span of those taken before. A row farther from it than
`1 / INCONCLUSIVE` times that is independent, one within it depends on them, and anything between is
refused: the rank is not clear. Nor is it where a row is within it only because other entries are
larger: an entry may be small and known to all of its digits, and then separates the rows.

Redundant constraints depend on each other in all positions nearby that they allow. Where rows do so
in one position alone, it is a singular configuration, and they do not determine the acceleration.
Nearby positions that satisfy the holonomic constraints are found by Newton's method (`newton`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space, qr, solve_triangular

from eomcheck.errors import RefusedError
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import Partition
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.numbers.generic import Array, map_record
from eomcheck.numbers.linear import least_squares
from eomcheck.numbers.noise import SAMPLES, STEP, Noise
from eomcheck.numbers.pivots import power_of_two_scale

# ---- Positions that satisfy the constraints ------------------------------------------------------

ASSEMBLY_STEPS = 50
"""Newton steps after which the search for a closed position gives up."""


def position_residual(at: Quantities) -> Array:
    """Return how far the holonomic constraints, if any, are from being closed (h,), m."""
    function = at.scene.position_residual
    if function is None:
        return np.zeros(0)
    return at.run(function, at.parameters, at.prepared, at.q)


def newton(at: Quantities, q: Array, kept: Any = None) -> tuple[Array, float, bool]:
    """Return (q (n,), last step, whether steps shrank until nothing but rounding is left).

    The smallest correction is taken in each step.

    Args:
        at: the scene and the time.
        q: where the search starts (n,).
        kept: the constraints (k,) that are to be satisfied, by default all.
    """
    if at.scene.position_residual is None:
        return q, 0.0, True
    rows = np.arange(at.scene.r)[at.scene.holonomic]
    places = np.flatnonzero(np.isin(rows, rows if kept is None else kept))
    step = np.inf
    for _ in range(ASSEMBLY_STEPS):
        here = at.elsewhere(q)
        residual, rates = position_residual(here)[places], here.terms.a[rows[places]]
        last, correction = step, least_squares(rates, residual)
        step, q = largest(correction), q - correction
        if not np.isfinite(step):
            return q, np.inf, False
        if step <= allowed_error(max(1.0, largest(q))) and step >= last / 2:
            return q, step, True
    return q, step, False


# ---- Rank ----------------------------------------------------------------------------------------

RANK = "rank of a"
"""What refusals call it."""

TIE_BREAK = 2.0**-20
"""By what share each row counts as smaller than the one before: the last of equals is redundant."""


class RowRank(NamedTuple):
    """Which constraints are independent.

    Attributes:
        kept: of them (ρ,), rising.
        redundant: the others, which they imply (r-ρ,), rising.
        distance: by pivoted QR, how far each row (r,) was from those taken before, over its size.
        uncertainty: how far rounding explains (r,), likewise.
    """

    kept: Array
    redundant: Array
    distance: Array
    uncertainty: Array


def rank_of(at: Quantities) -> RowRank:
    """Return which constraints are independent at `at`, which has some.

    Raises:
        RefusedError: the rank is not clear.
    """
    found = at.cached(_rank)
    if isinstance(found, RefusedError):
        raise found
    return found


def _rank(at: Quantities) -> RowRank | RefusedError:
    a, names = at.terms.a, at.scene.constraint_names
    r = len(a)
    a, unsure = _in_common_units(at, 1.0)
    rows = a
    if not (np.isfinite(a).all() and np.isfinite(unsure).all()):
        return RefusedError(RANK, float("nan"), 0.0, "the rank of a: doubles cannot hold it")
    factors: Any = qr(a.T, mode="r", pivoting=True, check_finite=False)
    R, order = factors
    R, unsure = R[: min(R.shape)], unsure[order]
    rank, distance, allowed, own = 0, np.zeros(r), np.zeros(r), None
    for k in range(r):
        if k == rank < len(R):
            distance[k], allowed[k] = abs(R[k, k]), _rounding(R, unsure, k, k)
            if 0 < allowed[k] <= INCONCLUSIVE * distance[k]:
                rank += 1
    for k in range(rank, r):
        distance[k], allowed[k] = np.linalg.norm(R[rank:, k]), _rounding(R, unsure, rank, k)
        if distance[k] > max(allowed[k], UNDERFLOW):
            least = allowed[k] / INCONCLUSIVE
            return RefusedError(
                RANK,
                float(distance[k]),
                float(least),
                f"the rank of a is not clear: the constraint of {names[order[k]]} is "
                f"{distance[k]:.2g} of its size away from what the others say, rounding explains "
                f"{allowed[k]:.2g}, and it is independent above {least:.2g}",
            )
        # With angles that have the digits that they have.
        own = _in_common_units(at, 0.0)[1] if own is None else own
        if _resolved_by_entry(R, rows[order], own[order], rank, k):
            return RefusedError(
                RANK,
                float(distance[k]),
                float(allowed[k] / INCONCLUSIVE),
                f"the rank of a is not clear: the constraint of {names[order[k]]} is within what "
                "rounding explains of what the others say, but for a small entry that is certain",
            )
    back = np.argsort(order)
    return RowRank(np.sort(order[:rank]), np.sort(order[rank:]), distance[back], allowed[back])


def _in_common_units(at: Quantities, least: float) -> tuple[Array, Array]:
    """Return a (r, n), and how far rounding moves it (r, n), rows and columns scaled.

    With angles that are known as if they were `least` at least, rad.

    Velocities are measured by the energy in them, and so have no units of their own; each row by
    its size. Of rows that would do as well as each other, the first is the larger by a little.
    """
    a = at.terms.a
    with np.errstate(all="ignore"):
        moved = np.max(
            [np.abs(_perturbed_jacobian(at, Noise(k), least) - a) for k in range(SAMPLES)], axis=0
        )
        unsure = allowed_error(1.0) * (np.abs(a) + moved / STEP)
        columns = power_of_two_scale(np.sqrt(np.abs(np.diagonal(at.terms.M))))
        a, unsure = a * columns, unsure * columns
        rows = power_of_two_scale(np.abs(a).max(axis=1))
        size = np.linalg.norm(a * rows[:, None], axis=1) * (1.0 + TIE_BREAK * np.arange(len(a)))
        rows /= np.where(size > 0, size, 1.0)
    return a * rows[:, None], unsure * rows[:, None]


def _perturbed_jacobian(at: Quantities, noise: Noise, least: float) -> Array:
    """Return a of moved coordinates and parameters, an angle as if it were `least` at least."""
    with noise.stream("rank"):
        floor = np.zeros(at.scene.n)
        floor[at.scene.angle_coordinates] = least
        size = np.maximum(np.abs(at.q), floor)
        q = at.q + size * noise.changes(size.shape)
        parameters = noise.perturb_record(at.parameters)
    given = map_record(np.asarray, parameters), q, at.v, np.full(1, at.t)
    return at.run(_jacobian, at.scene.prepare, at.scene.terms, *given)


def _jacobian(
    prepare: Callable, terms: Callable, parameters: Any, q: Array, v: Array, t: Array
) -> Any:
    prepared, _ = traceable_prepare(prepare)(parameters, q, t)
    return terms(parameters, prepared, q, v).a


def _coefficients(R: Array, rank: int, k: int) -> Array:
    """Return what row k has of the first `rank` rows (rank,)."""
    if not rank:
        return R[:0, k]
    return solve_triangular(R[:rank, :rank], R[:rank, k], check_finite=False)


def _rounding(R: Array, unsure: Array, rank: int, k: int) -> float:
    """Return how far rounding alone moves row k from the span of the first `rank` rows."""
    return float(np.linalg.norm(unsure[k] + np.abs(_coefficients(R, rank, k)) @ unsure[:rank]))


def _resolved_by_entry(R: Array, a: Array, own: Array, rank: int, k: int) -> bool:
    """Return whether an entry tells row k from the span of the first `rank` rows.

    All in the order of R. It does where it is further away than what rounding makes of it alone,
    and of what the row has of the others: it may be small beside entries that say nothing.
    """
    shares = _coefficients(R, rank, k)
    inverse = solve_triangular(R[:rank, :rank], np.eye(rank), check_finite=False)
    lost = allowed_error(1.0) * np.abs(inverse).sum(axis=1)
    apart = np.abs(a[k] - shares @ a[:rank])
    explained = own[k] + np.abs(shares) @ own[:rank] + lost @ np.abs(a[:rank])
    return bool((INCONCLUSIVE * apart > np.maximum(explained, UNDERFLOW)).any())


NEARBY = 2.0**-10
"""How far positions nearby are: the largest change of an angle, rad, or of another coordinate as a
share of the largest."""


def _sizes(at: Quantities) -> Array:
    """Return what changes of coordinates (n,) are small or large beside."""
    q = np.abs(at.q)
    q[at.scene.angle_coordinates] = 0.0
    sizes = np.full(at.scene.n, largest(q) or 1.0)
    sizes[at.scene.angle_coordinates] = 1.0
    return sizes


def check_redundant(at: Quantities, found: RowRank) -> None:
    """Check that redundant constraints are so in a position nearby too.

    One that the kept constraints allow, either way along a motion that all constraints allow.

    Raises:
        RefusedError: their rank is larger there, or no such position is found.
    """
    motions = null_space(at.terms.a[found.kept])
    if not motions.size:
        return  # it cannot move
    direction = motions @ Noise(0).changes((motions.shape[1],))
    direction /= np.max(np.abs(direction) / _sizes(at))
    for step in (NEARBY, -NEARBY):
        q, _, closed = newton(at, at.q + step * direction, found.kept)
        if closed:
            there = at.elsewhere(q)
            more = np.setdiff1d(found.redundant, rank_of(there).redundant)
            if not more.size or len(rank_of(there).kept) == len(found.kept):
                return
            break
    worst = found.redundant[np.argmin(found.distance[found.redundant])]
    names = ", ".join(at.scene.constraint_names[i] for i in found.redundant)
    raise RefusedError(
        RANK,
        float(found.distance[worst]),
        float(found.uncertainty[worst]),
        f"the constraints of {names} depend on the others here and not in positions nearby: the "
        "pose is singular, and they do not determine its acceleration",
    )


def check_rank_kept(at: Quantities, partition: Partition) -> None:
    """Check that the rank of a is still what it was when `partition` was chosen.

    In the position next to `at` that the kept constraints allow, for a motion drifts off them.

    Raises:
        RefusedError: it is not, or not clear.
    """
    q, step, closed = newton(at, at.q, partition.kept)
    if not closed:
        why = "no position next to it satisfies the constraints that were kept where it began"
        raise RefusedError(RANK, step, 0.0, why)
    rank, before = len(rank_of(at.elsewhere(q)).kept), len(partition.kept)
    if rank != before:
        raise RefusedError(
            RANK,
            0.0,
            0.0,
            f"the rank of a is {rank} here and was {before} where the motion began: other "
            "constraints are redundant",
        )


def independent_partition(at: Quantities) -> Partition:
    """Return the paper's partition with the rows that are kept, all rows if all are independent.

    Raises:
        RefusedError: the rank is not clear, or another one in positions nearby.
    """
    if at.terms.a is None:
        return at.partition
    found = rank_of(at)
    if not found.redundant.size:
        return at.partition
    check_redundant(at, found)
    return at.partition._replace(kept=found.kept, redundant=found.redundant)
