"""Claims that need no second opinion: energy, and motions of the whole scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.claims.claim import Case, claim
from eomcheck.claims.finding import Finding
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import Formulation
from eomcheck.numbers.contract import Array
from eomcheck.numbers.dual import duals, rate, value
from eomcheck.numbers.entries import each, objects
from eomcheck.numbers.noise import SAMPLES, STEP


def _motions(e: Evaluation, vdot: Array) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """Return (parameters, prepared, q, v) while q changes at v, and while v changes at v̇."""
    parameters, prepared, q, v = map(objects, (e.parameters, e.prepared, e.q, e.v))
    return (parameters, *e.moving(e.v), v), (parameters, prepared, q, duals(e.v, vdot))


def _power_terms(e: Evaluation, vdot: Array) -> Array:
    """Return the shares of (q, v) in d(T+U)/dt (2,), W, differentiated exactly."""
    shares = []
    for moved in _motions(e, vdot):
        T, U = e.scene.energies(*moved)
        shares.append(rate(T if U is None else T + U))
    return np.array(shares, dtype=np.float64)


def _body_rates(e: Evaluation, vdot: Array) -> Array:
    """Return [V, ω] and its shares of q and of v in [V̇, ω̇] of the bodies (3, n_b, d + e)."""
    along_q, along_v = (
        np.concatenate(e.scene.velocities(*moved), axis=1) for moved in _motions(e, vdot)
    )
    return np.array([each(value, along_q), rate(along_q), rate(along_v)], dtype=np.float64)


def _power_of_inertia(at: Evaluation, formulation: Formulation) -> tuple[float, float]:
    """Return Σ |m V| |V̇| + Σ |ω| |I| |ω̇|, W, and the same of what V, ω and their rates come from.

    Of the first the power is a sum, and may cancel. The second takes for each entry its size and
    how far it moves, per step: V may be a difference itself.
    """

    def rates(e: Evaluation) -> Array:
        return _body_rates(e, e.acceleration(formulation).vdot)

    def power(sizes: Array) -> float:
        speed, change = sizes[0], sizes[1] + sizes[2]
        inertia = np.abs(at.parameters.inertia)
        e = round((inertia.size / len(speed)) ** 0.5)
        d = speed.shape[1] - e
        pushing = at.parameters.mass @ (speed[:, :d] * change[:, :d]).sum(axis=1)
        turning = inertia.reshape(len(speed), e, e) * change[:, None, d:]
        return float(pushing + (speed[:, d:, None] * turning).sum())

    with np.errstate(all="ignore"):
        here = rates(at)
        try:
            moved = [np.abs(rates(sibling) - here) for sibling in at.moved()[:SAMPLES]]
        except RefusedError:
            return power(np.abs(here)), np.inf
        return power(np.abs(here)), power(np.abs(here) + np.max(moved, axis=0) / STEP)


@claim("power-balance", "d(T + U)/dt = -q̇ ∂R/∂q̇", "(25)-(26), (31)", "power balance")
def power_balance(case: Case) -> Iterator[Finding]:
    """Ideal constraints do no work: along each q̈ the energy loses what the dampers take."""
    at = case.at
    lost = _power_lost(at)
    if lost is None and not at.scene.conserves_energy:
        return

    def power(e: Evaluation, formulation: Formulation) -> Array:
        return np.asarray(_power_terms(e, e.acceleration(formulation).vdot).sum())

    lost = 0.0 if lost is None else lost
    for formulation in case.solved:
        shares = np.append(_power_terms(at, at.acceleration(formulation).vdot), lost)
        summed, summed_spread = _power_of_inertia(at, formulation)
        scale = max(largest(shares), summed)
        # Energies are summed over the bodies, which rounds as often.
        rounding = at.scene.n * (largest(shares) + summed_spread)
        spread = at.spread(lambda e, f=formulation: power(e, f)) + rounding
        if not np.isfinite(case.vdot_spread(formulation)):
            spread = float("inf")
        yield case.compare(formulation.key, shares.sum(), np.zeros(()), spread, scale=scale)


def _power_lost(e: Evaluation) -> float | None:
    """Return v ∂R/∂v, W; None where nothing is dissipated."""
    R = e.dissipation(duals(e.v, e.v))
    return None if R is None else float(rate(R))


@claim("invariance", "q̈ moves with the scene", "(25)-(28)", "invariance")
def invariance(case: Case) -> Iterator[Finding]:
    """Turning, shifting or mirroring the whole scene turns, shifts or mirrors q̈."""
    at = case.at
    for symmetry in at.scene.symmetries(at.q, at.v):
        moved = Evaluation(symmetry.scene, symmetry.q, symmetry.v, at.t)
        size = largest(np.abs(symmetry.image).sum(axis=1))
        for formulation in case.solved:
            try:
                found = moved.acceleration(formulation).vdot
            except RefusedError:
                continue
            expected = symmetry.image @ at.acceleration(formulation).vdot
            # A turn adds to every angle, whose rounding then is that of larger numbers.
            turn = 1.0 + largest(symmetry.q - at.q) / max(largest(at.q), 1.0)
            spread = 2 * size * turn * case.vdot_spread(formulation, True)
            if not largest(found - expected) <= allowed_error(spread):
                # An angle of 0 has no rounding to measure. Where it was turned to, it has.
                try:
                    spread += moved.acceleration_spread(formulation, coordinates=True)
                except RefusedError:
                    spread = np.inf
            yield case.compare(f"{symmetry.name}: {formulation.key}", found, expected, spread)
