"""Claims about numerical accuracy: error bounds against certified values, and refusals.

The certified acceleration is enclosed by ball arithmetic (intervals of arbitrary precision):
enclosures by all formulations overlap, and errors in float64 are within their bounds. A formulation
refuses a state only if the scene itself is close to a singular configuration there, by a
reciprocal condition number computed independently, and few ordinary states are refused at all.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space, solve_triangular

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding, Verdict, abbreviated_list
from eomcheck.claims.registry import CLAIMS, Claim, case_claim, unordered_pairs
from eomcheck.claims.user_scenes import why_not_rational
from eomcheck.draws.pairwise_design import levels_of_case
from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import (
    REFERENCE_DIGITS,
    REFERENCE_WITHOUT_SPEEDS,
    Enclosure,
    accuracy_at,
    enclose,
    enclosure_at,
    true_acceleration,
)
from eomcheck.evaluation.constraint_rank import RANK
from eomcheck.evaluation.dynamics import with_redundancy_hint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import CONTRADICTION, solution_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import UNDERFLOW, allowed_error, can_overflow, largest
from eomcheck.formulations import Formulation
from eomcheck.formulations.gw import MOBILITY
from eomcheck.mechanics.records import Chain, State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import EPS, Array
from eomcheck.numbers.linear import column_scale, power_of_two_scale
from eomcheck.safe_output import counted

# ---- Certified accelerations ---------------------------------------------------------------------

EVIDENCE = f"enclosed: {REFERENCE_DIGITS} digits"


def _enclose(
    case: Case, formulation: Formulation, quantities_by_bits: dict[int, Quantities]
) -> Enclosure | Finding:
    """Return the enclosure, or the Finding that there is none; see `enclosure_at` for the cache."""
    at = case.at
    start, how = {"u": at.u}, (REFERENCE_DIGITS, at.partition_for(formulation, False))
    try:
        return enclosure_at(at.scene, formulation, at.q, start, at.t, *how, quantities_by_bits)
    except (RefusedError, TypeError) as error:
        return _uncertified_finding(case, formulation.key, error)


def _uncertified_finding(case: Case, subject: str, error: Exception) -> Finding:
    """Return the Finding that precision is exhausted, or a function rejects ball arithmetic."""
    if isinstance(error, RefusedError):
        return case.finding(subject, 0.0, 0.0, "inconclusive", EVIDENCE, str(error))
    why = f"not rational: {error}"
    return case.finding(subject, 0.0, 0.0, "skipped", EVIDENCE, why)


@case_claim(
    "enclosures",
    "true q̈ of one formulation = of another",
    "(7)-(23)",
    "acceleration",
    needs="two formulations that solve one state",
)
def enclosures(case: Case) -> Iterator[Finding]:
    """The enclosures by all formulations have a point in common, pair by pair."""
    if not case.has_speeds or not np.isfinite(case.at.u).all():
        return
    if why := why_not_rational(case.at.scene):
        yield case.finding("all", 0.0, 0.0, "skipped", EVIDENCE, why)
        return
    enclosed: list[tuple[Formulation, Enclosure]] = []
    quantities_by_bits: dict[int, Quantities] = {}
    for f in case.solved:
        x = _enclose(case, f, quantities_by_bits)
        if isinstance(x, Finding):
            yield x
        else:
            enclosed.append((f, x))
    keeps_all_rows = {f: case.at.partition_for(f, False).redundant is None for f, _ in enclosed}
    for (f, x), (g, y) in unordered_pairs(enclosed):
        if keeps_all_rows[f] != keeps_all_rows[g]:
            continue  # with rows left out as redundant in float64, the certified value differs
        apart = np.flatnonzero(~x.overlaps(y))
        rows = ", ".join(case.at.scene.coordinate_names[i] for i in apart)
        detail = f"acceleration, row {rows}: the balls are disjoint" if apart.size else ""
        verdict = "failed" if apart.size else "passed"
        outcome = float(apart.size), 0.0, verdict, EVIDENCE, detail
        yield case.finding(f"{f.key} ~ {g.key}", *outcome)


@case_claim("true-error", "|q̈ - true q̈| ≤ its error bound", "(7)-(23)", "rounding error")
def true_errors(case: Case) -> Iterator[Finding]:
    """The error in float64, against the certified value, is within its rounding bound."""
    state = case.at
    if case.has_speeds and not np.isfinite(state.u).all():
        return
    if why := why_not_rational(state.scene):
        yield case.finding("all", 0.0, 0.0, "skipped", EVIDENCE, why)
        return
    try:
        if case.has_speeds:
            truth, at = true_acceleration(state.scene, state.q, state.u, state.t)
        else:
            how = {"t": state.t, "digits": REFERENCE_DIGITS, "v": state.v}
            truth, at = enclose(state.scene, REFERENCE_WITHOUT_SPEEDS, state.q, **how), state
    except (RefusedError, TypeError) as error:
        yield _uncertified_finding(case, "all", error)
        return
    true = Case(at, case.formulations, (), case.claim)
    for formulation in true.solved:
        sensitivity = true.vdot_sensitivity(formulation)
        try:
            certified = accuracy_at(formulation, truth, at, sensitivity=sensitivity)
        except RefusedError as error:
            yield _uncertified_finding(case, formulation.key, error)
            continue
        values, names = (certified.vdot, certified.truth.doubles()), (state.scene.coordinate_names,)
        judged = true.compare(formulation.key, *values, sensitivity, names=names, evidence=EVIDENCE)
        yield replace(judged, digits=certified.digits, state=case.state)


# ---- Refusals ------------------------------------------------------------------------------------


def independent_rcond(formulation: Formulation, refusal: RefusedError, case: Case) -> float:
    """Return a reciprocal condition number for a refusal, from the terms of the scene alone.

    The refused matrix itself is not used, since an error may have built it. Used are the matrices
    that `formulation` depends on: the KKT matrix, M and the dependent columns of a, the KKT matrix
    of a chain, the map that gives v from the constraints and u, or the constraints over the roots
    of M, by their singular values; the smallest number is returned. Singular values and the 1-norm
    of a refusal agree up to the order as a factor, which is divided out. An overflow is justified
    by inputs large enough for it, or by a matrix that is singular to working precision.
    """
    at = case.at
    M, _, _, a, _, _ = at.terms
    if a is not None and formulation.redundant:
        with suppress(RefusedError):  # the rank itself may be refused
            rows_kept = at.independent_partition.kept
            a = a if rows_kept is None else a[rows_kept]
    if refusal.what == CONTRADICTION:
        return _contradiction_rcond(at)
    overflows = np.isnan(refusal.rcond)
    if overflows and can_overflow(at.v, at.F, M):
        return 0.0
    needed = [M]
    if a is not None:
        needed.append(_kkt(M, a))
        if formulation.partitioned:
            needed.append(a[:, at.partition.dependent])
    if formulation.uses == "chain":
        needed.append(_kkt(np.diag(at.chain.mass), _joints(at.chain)))
    rcond = [_rcond(matrix * column_scale(matrix)) for matrix in map(_balanced, needed)]
    if formulation.uses == "chain":
        rcond[-1] *= _row_evenness(at.chain)
    # Velocities are scaled by their kinetic energy, and so have no units of their own.
    scale = power_of_two_scale(np.sqrt(np.abs(np.diagonal(M))))
    if a is not None and refusal.what == RANK:
        rcond.append(_rcond(_balanced(a * scale)))
    if a is not None and (formulation.partitioned or formulation.in_speeds):
        # v = Z c with an orthonormal Z; the independent velocities or speeds are R c.
        rows, R = _balanced(a * scale), np.eye(len(M))[at.partition.independent]
        if formulation.in_speeds:
            R = _speeds_map(at) * scale
            rcond.append(_rcond_of_speeds(at))
        Z, unsure = null_space(rows), _null_space_error(R, rows)
        rcond.append(_rcond(R @ Z, unsure) ** 2 * _rcond(Z.T @ (scale[:, None] * M * scale) @ Z))
    if a is not None and refusal.what == MOBILITY:
        # The square of another matrix: it is singular to working precision long before that one.
        rcond.append(_rcond(_balanced(_scale_by_energy(M, a))) ** 2 * len(a))
    if overflows:
        return 0.0 if min(rcond) < at.scene.n * EPS else 1.0
    return min(rcond)


def _contradiction_rcond(at: Evaluation) -> float:
    """Return the rounding bound over the contradiction of constraints that imply each other.

    The contradiction is the residual of least squares, where v̇ has no component in directions in
    which rows differ by rounding only. If less, the rounding bound over the distance of the rows
    from dependence is returned: they may be dependent only after rounding of the coordinates.
    """
    M, _, _, a, gamma, _ = at.terms
    scale = _row_scale(a)
    rows, drift = _scale_by_energy(M, a) * scale[:, None], gamma * scale
    U, sizes, _ = np.linalg.svd(rows, full_matrices=False)
    rank = at.scene.r if (rows_kept := at.independent_partition.kept) is None else len(rows_kept)
    contradiction = largest(drift - U[:, :rank] @ (U[:, :rank].T @ drift))
    explained = allowed_error(largest(drift) * sizes[0] / sizes[rank - 1])
    apart = min(_rcond(_balanced(rows)), sizes[-1] / sizes[0])
    shares = (
        explained / contradiction if contradiction > 0 else math.inf,
        allowed_error(1.0) / max(apart, EPS**2),
    )
    return min(shares)


def _scale_by_energy(M: Array, a: Array) -> Array:
    """Return a L⁻ᵀ with L Lᵀ = M, or a itself if M is not positive definite in float64."""
    try:
        return solve_triangular(np.linalg.cholesky(M), a.T, lower=True).T
    except np.linalg.LinAlgError:
        return a


def _kkt(M: Array, a: Array) -> Array:
    """Return the KKT matrix of M and a."""
    return np.block([[M, a.T], [a, np.zeros((len(a), len(a)))]])


def _joints(chain: Chain) -> Array:
    """Return the matrix (2 (n_b-1), s) of the joints' equations in ẋ."""
    J = np.zeros((chain.rest.size, chain.mass.size))
    for j in range(len(chain.before)):
        i = 2 * j
        J[i : i + 2, i : i + 2] = chain.before[j]
        J[i : i + 2, i + 2 : i + 4] = chain.after[j]
    return J


def _row_evenness(chain: Chain) -> float:
    """Return the ratio of the smallest to the largest row of |A||x| + |b|, A x = b a chain's KKT.

    Iterative refinement in the same precision reaches a row-wise backward error of rounding only if
    this ratio is well above eps times the condition number (Skeel 1980).
    """
    A = _kkt(np.diag(chain.mass), _joints(chain))
    force = np.zeros(len(chain.mass)) if chain.force is None else chain.force
    b = np.concatenate((force, -np.ravel(chain.rest)))
    scale = _row_scale(A)
    A, b = A * scale[:, None], b * scale
    x = np.linalg.lstsq(A, b / max(largest(b), UNDERFLOW), rcond=None)[0] * largest(b)
    rows = np.abs(A) @ np.abs(x) + np.abs(b)
    return float(rows.min() / rows.max()) if rows.max() > 0 else 1.0


def _row_scale(matrix: Array) -> Array:
    """Return the powers of two that scale each row of a matrix to about 1."""
    return column_scale(matrix.T)


def _balanced(matrix: Array) -> Array:
    """Return a matrix with each row scaled to about 1."""
    return matrix * _row_scale(matrix)[:, None]


def _speeds_map(at: Evaluation) -> Array:
    """Return the matrix (p, n) of the linear map from v to u."""
    speeds, unit = at.scene.speeds_of, np.eye(at.scene.n)
    return np.array([at.call(speeds, at.parameters, at.prepared, at.q, e) for e in unit]).T


def _rcond_of_speeds(at: Evaluation) -> float:
    """Return the reciprocal condition number of the linear map from v to (a v, u)."""
    energy = np.sqrt(np.diagonal(at.terms.M))
    u_of_v = _speeds_map(at) / energy
    u_of_v = u_of_v / np.abs(u_of_v).max(axis=1, keepdims=True)
    a = at.terms.a / energy
    return _rcond(np.vstack((a, np.abs(a).max() * u_of_v)))


def _null_space_error(R: Array, rows: Array) -> float:
    """Return a bound on the rounding error of R Z, Z the null space of `rows`."""
    if not (len(R) and len(rows)):
        return 0.0
    return len(R.T) * EPS * float(np.linalg.norm(R, 2)) / max(_rcond(rows), EPS)


def _rcond(matrix: Array, unsure: float = 0.0) -> float:
    """Return a reciprocal condition number, its least value for entries uncertain by `unsure`."""
    if matrix.size == 0:  # as many constraints as coordinates: there are no speeds
        return 1.0
    if not np.isfinite(matrix).all():
        return 0.0
    singular = np.linalg.svd(matrix, compute_uv=False)
    least = max(singular[-1] - unsure, 0.0)
    return float(least / singular[0] / singular.size) if singular[0] > 0 else 0.0


def judge_refusal(refusal: RefusedError, rcond: float) -> tuple[Verdict, str]:
    """Judge a refusal by an independent reciprocal condition number.

    The number of a matrix with rounded entries is uncertain by C eps: nearer than that to the
    threshold, it may fall on either side.

    Returns:
        (verdict, why): the verdict, and the reason unless it passed.
    """
    if rcond <= refusal.threshold:
        return "passed", ""
    if rcond <= refusal.threshold + allowed_error(1.0):
        return "inconclusive", "refused where rounding decides whether it is singular"
    return "failed", "refused in vain"


@case_claim(
    "refusals",
    "refused: rcond is below the threshold",
    "(7)-(23)",
    "refusal",
    needs="a state that a formulation refuses",
)
def refusals(case: Case) -> Iterator[Finding]:
    """Every refusal is justified by a reciprocal condition number computed independently."""
    for formulation in case.formulations:
        try:
            solution_of(case.at, formulation)
        except RefusedError as refusal:
            rcond = independent_rcond(formulation, refusal, case)
            verdict, why = judge_refusal(refusal, rcond)
            detail = (
                f"{formulation.key}, {refusal.what}: {why}"
                if why
                else str(with_redundancy_hint(case.at, refusal))
            )
            outcome = rcond, refusal.threshold, verdict, "property-tested", detail
            yield case.finding(formulation.key, *outcome)


MAY_REFUSE = 0.05
"""Largest share of ordinary states that some formulation may refuse."""

CLAIMS["coverage"] = Claim(
    "coverage",
    f"at least {1 - MAY_REFUSE:.0%} of ordinary states are solved by all formulations",
    "",
    "coverage",
)


ENOUGH = 20
"""Smallest number of states that decides about a share of 5 %."""


class SampledState(NamedTuple):
    """A drawn state, with the keys of the formulations that refused it."""

    scene: Scene
    state: State
    refused: tuple[str, ...]


def coverage(drawn: list[SampledState]) -> Finding:
    """Return the Finding on the share of drawn states that some formulation refused."""
    refused = [sampled for sampled in drawn if sampled.refused]
    example = (refused or drawn)[0]
    share = len(refused) / len(drawn)
    verdict: Verdict = "passed" if share <= MAY_REFUSE else "failed"
    never = _always_refused(drawn) if refused else []
    if never and verdict == "passed":
        verdict = "inconclusive"  # the share hides a factor level that is always refused
    by_key = Counter(key for sampled in refused for key in sampled.refused)
    named = "".join(f"; {key} refused {count}" for key, count in by_key.items())
    return Finding(
        "coverage",
        "all",
        example.scene,
        example.state,
        share,
        MAY_REFUSE,
        verdict if len(drawn) >= ENOUGH else "inconclusive",
        f"property-tested: {counted(len(drawn), 'state')}",
        f"{len(drawn) - len(refused)} of {len(drawn)} ordinary states solved by all formulations"
        + named
        + (f"; {abbreviated_list(never)}" if never else ""),
    )


def _always_refused(drawn: list[SampledState]) -> list[str]:
    """Return a text for each formulation that refused every drawn state of a factor level."""
    refused: dict[tuple[str, str], list[set[str]]] = {}
    for sampled in drawn:
        for level in levels_of_case(sampled.scene, sampled.state).items():
            refused.setdefault(level, []).append(set(sampled.refused))
    return [
        f"{key} refused every state of {name} {way} ({len(refusals)})"
        for (name, way), refusals in refused.items()
        for key in sorted(set.intersection(*refusals))
    ]
