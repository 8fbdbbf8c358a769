"""Claims about whole accelerations: the formulations against each other, engines, and Eq. (5)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import null_space

from eomcheck.claims.claim import Case, claim, numbered, pairs
from eomcheck.claims.finding import Finding
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, largest
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.numbers.contract import Array
from eomcheck.numbers.linear import column_scale


@claim("equations-residual", "M q̈ - F - aᵀλ = 0", "(5)", "equations of motion")
def equations_residual(case: Case) -> Iterator[Finding]:
    """Each q̈ satisfies Eq. (5): with its own λ, or on every motion that the constraints allow."""
    at = case.at
    M, _, _, a, _, _ = at.terms
    F_spread = at.spread(lambda e: e.F)
    motions, told = (None, True) if a is None else _allowed_motions(a)
    for formulation in case.solved:
        result = at.acceleration(formulation)
        residual, names = M @ result.vdot - at.F, at.scene.coordinate_names
        size = np.abs(M) @ np.abs(result.vdot) + np.abs(at.F)
        spread = largest(np.abs(M).sum(axis=1)) * case.vdot_spread(formulation) + F_spread
        if a is not None and result.multipliers is not None:
            residual = residual - a.T @ result.multipliers
            size = size + np.abs(a.T) @ np.abs(result.multipliers)
            force = largest(np.abs(a.T).sum(axis=1))
            spread += force * case.multiplier_spread(formulation)
        elif motions is not None:
            size = np.abs(motions.T) @ (size + _constraint_forces(a, residual))
            residual = motions.T @ residual
            spread = spread if told else np.inf
            names = numbered("allowed motion ", size.size)
        scale = largest(size)
        zero = np.zeros(residual.size)
        key = formulation.key
        yield case.compare(key, residual, zero, spread + scale, scale=scale, names=(names,))


def _allowed_motions(a: Array) -> tuple[Any, bool]:
    """Return a basis (n, p) of all v with a v = 0, and whether rounding lets a tell them."""
    basis = null_space(a)
    values = np.linalg.svd(a * column_scale(a.T)[:, None], compute_uv=False)
    told = len(values) == 0 or allowed_error(values[0]) <= INCONCLUSIVE * values[-1]
    # Singular vectors are as accurate as the largest row of a allows, not each row for itself.
    return basis - np.linalg.lstsq(a, a @ basis, rcond=None)[0], bool(told)


def _constraint_forces(a: Any, net: Array) -> Array:
    """Return |aᵀ| |λ| (n,) of the constraint forces aᵀλ = net, which may have cancelled there."""
    if not np.isfinite(net).all():
        return np.full(net.size, np.inf)
    return np.abs(a.T) @ np.abs(np.linalg.lstsq(a.T, net, rcond=None)[0])


@claim("constraint-acceleration", "a q̈ + ȧ q̇ + ḃ = 0", "(3)", "constraints at acceleration level")
def constraint_acceleration(case: Case) -> Iterator[Finding]:
    """Each q̈ satisfies the constraints differentiated."""
    at = case.at
    _, _, _, a, gamma, _ = at.terms
    if a is None:
        return
    gamma_spread = at.spread(lambda e: e.terms.gamma)
    for formulation in case.solved:
        vdot = at.acceleration(formulation).vdot
        scale = largest(np.abs(a) @ np.abs(vdot)) + largest(gamma)
        row = largest(np.abs(a).sum(axis=1))
        spread = row * case.vdot_spread(formulation) + gamma_spread + scale
        yield case.compare(
            formulation.key,
            a @ vdot + gamma,
            np.zeros(gamma.size),
            spread,
            scale=scale,
        )


@claim("equivalence", "q̈ of one formulation = q̈ of another", "(7)-(23)", "acceleration")
def equivalence(case: Case) -> Iterator[Finding]:
    """All formulations give the same acceleration, pair by pair."""
    for f, g in pairs(case.solved):
        yield case.compare(
            f"{f.key} ~ {g.key}",
            case.at.acceleration(f).vdot,
            case.at.acceleration(g).vdot,
            case.vdot_spread(f) + case.vdot_spread(g),
        )


@claim("multipliers", "λ of one formulation = λ of another", "(7), (9), (12)", "multipliers")
def multipliers(case: Case) -> Iterator[Finding]:
    """All formulations that have multipliers have the same, pair by pair."""
    results = {f: case.at.acceleration(f).multipliers for f in case.solved}
    if case.at.terms.a is not None:
        for f, found in results.items():
            declared = np.asarray(float(f.multipliers))
            yield case.compare(
                f.key, np.asarray(float(found is not None)), declared, 1.0, scale=1.0
            )
    having = tuple(f for f, found in results.items() if found is not None)
    for f, g in pairs(having):
        expected = np.asarray(case.at.acceleration(g).multipliers)
        yield case.compare(
            f"{f.key} ~ {g.key}",
            np.asarray(case.at.acceleration(f).multipliers),
            expected,
            case.multiplier_spread(f) + case.multiplier_spread(g),
            names=(case.at.scene.constraint_names,),
        )


def _part_in(formulation: Formulation, T: Array, part: str, e: Evaluation) -> Array:
    return getattr(e.acceleration_in(formulation, T), part)


def _responses(at: Evaluation) -> tuple[float, float]:
    """Return the largest change of v̇ and of λ per change of all entries of F by one unit."""
    M, a = at.terms.M, at.terms.a
    if a is None:
        return float(np.linalg.norm(np.linalg.inv(M), np.inf)), 0.0
    Z = null_space(a)
    response = Z @ np.linalg.solve(Z.T @ M @ Z, Z.T)
    multipliers = np.linalg.pinv(a.T) @ (M @ response - np.eye(len(M)))
    return float(np.linalg.norm(response, np.inf)), float(np.linalg.norm(multipliers, np.inf))


def _engine_results(case: Case) -> Iterator[tuple]:
    """Yield (engine, its result, spread of its v̇, spread of its λ) where that can be judged."""
    at = case.at
    Q = np.zeros(at.scene.n) if at.terms.Q is None else at.terms.Q
    for engine in case.engines:
        like, T = FORMULATIONS[engine.solves_like], engine.coordinates
        if case.result(like) is None:
            continue
        try:
            result = engine.acceleration(at.q, at.v, Q, at.terms.a, at.terms.gamma, at.t)
            by_force, multipliers_by_force = _responses(at)
            size = engine.bias_size(*case.state)
            vdot_spread = at.spread(partial(_part_in, like, T, "vdot"), coordinates=True)
            vdot_spread += by_force * size
            multiplier_spread = 0.0
            if result.multipliers is not None:
                part = partial(_part_in, like, T, "multipliers")
                multiplier_spread = at.spread(part, coordinates=True) + multipliers_by_force * size
        except (np.linalg.LinAlgError, RefusedError):
            continue
        yield engine, result, vdot_spread, multiplier_spread


@claim("engine-acceleration", "q̈ = q̈ of the engine", "(5), (7)-(23)", "acceleration")
def engine_acceleration(case: Case) -> Iterator[Finding]:
    """Each formulation gives the constrained acceleration of each engine."""
    for engine, result, theirs, _ in _engine_results(case):
        for formulation in case.solved:
            yield case.compare(
                f"{formulation.key} ~ {engine.key}",
                case.at.acceleration(formulation).vdot,
                result.vdot,
                case.vdot_spread(formulation, True) + theirs,
                evidence=f"compared: {engine.version()}",
            )


@claim("engine-multipliers", "λ = λ of the engine", "(5), (7), (9), (12)", "multipliers")
def engine_multipliers(case: Case) -> Iterator[Finding]:
    """Each formulation that has multipliers gives those of each engine."""
    for engine, result, _, theirs in _engine_results(case):
        for formulation in case.solved:
            ours = case.at.acceleration(formulation).multipliers
            if ours is None or result.multipliers is None:
                continue
            yield case.compare(
                f"{formulation.key} ~ {engine.key}",
                ours,
                result.multipliers,
                case.multiplier_spread(formulation, True) + theirs,
                evidence=f"compared: {engine.version()}",
                names=(case.at.scene.constraint_names,),
            )
