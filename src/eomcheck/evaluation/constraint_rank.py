"""The rank of the constraints at a state, decided once, outside of the formulations.

Rows of a are taken one by one by pivoted QR, the largest remaining one first. Each entry of a is
known up to its rounding error, which is measured by perturbing coordinates and parameters; from it
follows the uncertainty of the distance of a row from the span of the rows taken before. A row
farther away than `1 / INCONCLUSIVE` times the uncertainty is independent, one within the
uncertainty depends on them, and any row between is refused: the rank is not clear. Nor is it if a
row is within the uncertainty only because other entries are larger: a small entry that is known to
all of its digits separates the rows.

Redundant constraints depend on each other in all nearby positions that they allow. If rows do so in
one position only, it is a singular configuration, and they do not determine the acceleration.
Nearby positions that satisfy the holonomic constraints are computed by Newton's method (`newton`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space, qr, solve_triangular

from eomcheck.errors import RefusedError
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import Partition
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.numbers.generic import Array, map_record
from eomcheck.numbers.linear import least_squares, power_of_two_scale
from eomcheck.numbers.noise import SAMPLES, STEP, Noise

# ---- Positions that satisfy the constraints ------------------------------------------------------

ASSEMBLY_STEPS = 50
"""Largest number of Newton steps towards a position that satisfies the constraints."""


def position_residual(at: Quantities) -> Array:
    """Return the residual (h,) of the holonomic constraints (loop closure), m; (0,) without any."""
    function = at.scene.position_residual
    if function is None:
        return np.zeros(0)
    return at.run(function, at.parameters, at.prepared, at.q)


def newton(at: Quantities, q: Array, kept: Any = None) -> tuple[Array, float, bool]:
    """Return (q (n,), last step, whether steps shrank to the rounding error).

    The smallest correction is taken in each step.

    Args:
        at: the scene and the time.
        q: initial coordinates (n,).
        kept: indices (k,) of the constraints that are to be satisfied, by default all.
    """
    if at.scene.position_residual is None:
        return q, 0.0, True
    rows = np.arange(at.scene.r)[at.scene.holonomic]
    used = np.flatnonzero(np.isin(rows, rows if kept is None else kept))
    step = np.inf
    for _ in range(ASSEMBLY_STEPS):
        current = at.elsewhere(q)
        residual, rates = position_residual(current)[used], current.terms.a[rows[used]]
        last, correction = step, least_squares(rates, residual)
        step, q = largest(correction), q - correction
        if not np.isfinite(step):
            return q, np.inf, False
        if step <= allowed_error(max(1.0, largest(q))) and step >= last / 2:
            return q, step, True
    return q, step, False


# ---- Rank ----------------------------------------------------------------------------------------

RANK = "rank of a"
"""Name of the rank in refusals."""

TIE_BREAK = 2.0**-20
"""Relative decrease of the weight from row to row: the last of equal rows is redundant."""


class RowRank(NamedTuple):
    """Indices of independent and redundant constraints, with the distances that decide.

    Attributes:
        kept: independent constraints (ρ,), rising.
        redundant: the others, which they imply (r-ρ,), rising.
        distance: distance of each row (r,) from the span of the rows taken before by pivoted QR,
            relative to its size.
        uncertainty: rounding error (r,) of the distances.
    """

    kept: Array
    redundant: Array
    distance: Array
    uncertainty: Array


def rank_of(at: Quantities) -> RowRank:
    """Return the independent and redundant constraints at `at`, which has constraints.

    Raises:
        RefusedError: the rank is not clear.
    """
    rank = at.cached(_rank)
    if isinstance(rank, RefusedError):
        raise rank
    return rank


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
                f"{distance[k]:.2g} of its size away from the span of the others, rounding "
                f"explains {allowed[k]:.2g}, and it is independent above {least:.2g}",
            )
        # Here with the relative rounding error of the angles.
        own = _in_common_units(at, 0.0)[1] if own is None else own
        if _resolved_by_entry(R, rows[order], own[order], rank, k):
            return RefusedError(
                RANK,
                float(distance[k]),
                float(allowed[k] / INCONCLUSIVE),
                f"the rank of a is not clear: the constraint of {names[order[k]]} depends "
                "on the others within rounding, but for a small entry that is certain",
            )
    back = np.argsort(order)
    return RowRank(np.sort(order[:rank]), np.sort(order[rank:]), distance[back], allowed[back])


def _in_common_units(at: Quantities, least: float) -> tuple[Array, Array]:
    """Return a (r, n), and the rounding error of its entries (r, n), rows and columns scaled.

    The perturbation of an angle is relative to `least`, rad, if the angle is smaller.

    Columns are scaled by the kinetic energy of their velocities, so that units do not matter; rows
    by their size. Of rows that are equally large, the first is made a little larger.
    """
    a = at.terms.a
    with np.errstate(all="ignore"):
        change = np.max(
            [np.abs(_perturbed_jacobian(at, Noise(k), least) - a) for k in range(SAMPLES)], axis=0
        )
        unsure = allowed_error(1.0) * (np.abs(a) + change / STEP)
        columns = power_of_two_scale(np.sqrt(np.abs(np.diagonal(at.terms.M))))
        a, unsure = a * columns, unsure * columns
        rows = power_of_two_scale(np.abs(a).max(axis=1))
        size = np.linalg.norm(a * rows[:, None], axis=1) * (1.0 + TIE_BREAK * np.arange(len(a)))
        rows /= np.where(size > 0, size, 1.0)
    return a * rows[:, None], unsure * rows[:, None]


def _perturbed_jacobian(at: Quantities, noise: Noise, least: float) -> Array:
    """Return a at perturbed coordinates and parameters; for `least` see `_in_common_units`."""
    with noise.stream("rank"):
        floor = np.zeros(at.scene.n)
        floor[at.scene.angle_coordinates] = least
        size = np.maximum(np.abs(at.q), floor)
        q = at.q + size * noise.changes(size.shape)
        parameters = noise.perturb_record(at.parameters)
    arguments = map_record(np.asarray, parameters), q, at.v, np.full(1, at.t)
    return at.run(_jacobian, at.scene.prepare, at.scene.terms, *arguments)


def _jacobian(
    prepare: Callable, terms: Callable, parameters: Any, q: Array, v: Array, t: Array
) -> Any:
    prepared, _ = traceable_prepare(prepare)(parameters, q, t)
    return terms(parameters, prepared, q, v).a


def _coefficients(R: Array, rank: int, k: int) -> Array:
    """Return the coefficients (rank,) of row k in the span of the first `rank` rows."""
    if not rank:
        return R[:0, k]
    return solve_triangular(R[:rank, :rank], R[:rank, k], check_finite=False)


def _rounding(R: Array, unsure: Array, rank: int, k: int) -> float:
    """Return the rounding error of the distance of row k from the span of the first `rank` rows."""
    return float(np.linalg.norm(unsure[k] + np.abs(_coefficients(R, rank, k)) @ unsure[:rank]))


def _resolved_by_entry(R: Array, a: Array, own: Array, rank: int, k: int) -> bool:
    """Return whether a single entry separates row k from the span of the first `rank` rows.

    All rows are in the order of R. An entry does so if its distance exceeds the rounding error of
    this entry alone, in row k and in the rows of the span; other, larger entries do not matter.
    """
    shares = _coefficients(R, rank, k)
    inverse = solve_triangular(R[:rank, :rank], np.eye(rank), check_finite=False)
    lost = allowed_error(1.0) * np.abs(inverse).sum(axis=1)
    apart = np.abs(a[k] - shares @ a[:rank])
    explained = own[k] + np.abs(shares) @ own[:rank] + lost @ np.abs(a[:rank])
    return bool((INCONCLUSIVE * apart > np.maximum(explained, UNDERFLOW)).any())


FEW_ROWS = 3
"""Largest number of rows that are named as the sum that another row is."""


def repeated_rows(a: Array, names: Sequence[str], redundant: Iterable[int] = ()) -> list[str]:
    """Return each dependent row of a matrix (r, n) as a sum of the rows before it: "b = 2 a".

    A row whose distance from the span of the others is within rounding depends on them. For sums of
    more than `FEW_ROWS` rows none are named: "c follows from the rows before it".

    Args:
        a: constraint Jacobian at one state, finite float64 numbers.
        names: names of its rows.
        redundant: rows that are known to depend on all others, by default those are found.
    """
    kept: list[int] = []
    dependences, known = list[str](), {*redundant}
    order = sorted(range(len(a)), key=lambda k: (k in known, k))
    for k in order:
        size, rows, shares = float(np.linalg.norm(a[k])), a[kept], np.zeros(0)
        if kept:
            scale = power_of_two_scale(np.abs(rows).max(axis=1))
            shares = np.linalg.lstsq((rows * scale[:, None]).T, a[k], rcond=None)[0] * scale
        left = np.linalg.norm(a[k] - shares @ rows)
        explained = size + float(np.abs(shares) @ np.linalg.norm(rows, axis=1))
        rounding = max(a.shape) * allowed_error(explained)
        if left > rounding:
            kept.append(k)
            continue
        terms = [
            (share, names[i])
            for share, i in zip(shares, kept, strict=True)
            if abs(share) * np.linalg.norm(a[i]) > rounding
        ]
        dependences.append(_sum_text(names[k], terms))
    return dependences


def _sum_text(name: str, terms: Sequence[tuple[float, str]]) -> str:
    """Return a row as a sum of multiples of others: "c = 2 a - b"."""
    if not terms:
        return f"{name} = 0"
    if len(terms) > FEW_ROWS:
        return f"{name} follows from the rows before it"
    text = ""
    for share, other in terms:
        sign = ("-" if share < 0 else "") if not text else (" - " if share < 0 else " + ")
        size = f"{abs(share):.3g}"
        text += f"{sign}{'' if size == '1' else f'{size} '}{other}"
    return f"{name} = {text}"


NEARBY = 2.0**-10
"""Distance of nearby positions: the largest change of an angle, rad, or of another coordinate as a
share of the largest."""


def _sizes(at: Quantities) -> Array:
    """Return the sizes (n,) to which changes of coordinates are relative."""
    q = np.abs(at.q)
    q[at.scene.angle_coordinates] = 0.0
    sizes = np.full(at.scene.n, largest(q) or 1.0)
    sizes[at.scene.angle_coordinates] = 1.0
    return sizes


def check_redundant(at: Quantities, found: RowRank) -> None:
    """Check that redundant constraints are redundant in a nearby position too.

    The position satisfies the kept constraints, and is reached along a motion that all constraints
    allow, in either direction.

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
            near = at.elsewhere(q)
            more = np.setdiff1d(found.redundant, rank_of(near).redundant)
            if not more.size or len(rank_of(near).kept) == len(found.kept):
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
    """Check that the rank of a is unchanged since `partition` was chosen.

    It is computed in the position next to `at` that satisfies the kept constraints, because a
    simulated motion drifts off them.

    Raises:
        RefusedError: the rank has changed, or is not clear.
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
    """Return the paper's partition with the independent rows, with all rows if none is redundant.

    Raises:
        RefusedError: the rank is not clear, or another one in positions nearby.
    """
    if at.terms.a is None:
        return at.partition
    rank = rank_of(at)
    if not rank.redundant.size:
        return at.partition
    check_redundant(at, rank)
    return at.partition._replace(kept=rank.kept, redundant=rank.redundant)
