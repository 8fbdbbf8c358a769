"""Claims that need no second opinion: energy, and motions of the whole scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, cached_property
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


class _Rates:
    """Rates of the energy and of the bodies' velocities, differentiated exactly.

    Their shares while q changes at v do not depend on v̇, and are the same for all formulations.
    """

    def __init__(self, e: Evaluation):
        self._e, self._still = e, tuple(map(objects, (e.parameters, e.prepared, e.q, e.v)))

    def _while_v_changes(self, vdot: Array) -> tuple[Any, ...]:
        *still, _ = self._still
        return (*still, duals(self._e.v, vdot))

    @cached_property
    def _while_q_changes(self) -> tuple[Any, ...]:
        parameters, *_, v = self._still
        return (parameters, *self._e.moving(self._e.v), v)

    def _power(self, motion: tuple[Any, ...]) -> Any:
        T, U = self._e.scene.energies(*motion)
        return rate(T if U is None else T + U)

    @cached_property
    def _power_of_q(self) -> Any:
        return self._power(self._while_q_changes)

    def power(self, vdot: Array) -> Array:
        """Return the shares of (q, v) in d(T+U)/dt (2,), W."""
        shares = self._power_of_q, self._power(self._while_v_changes(vdot))
        return np.array(shares, dtype=np.float64)

    def _velocities(self, motion: tuple[Any, ...]) -> Array:
        return np.concatenate(self._e.scene.velocities(*motion), axis=1)

    @cached_property
    def _velocities_of_q(self) -> tuple[Array, Array]:
        along_q = self._velocities(self._while_q_changes)
        return each(value, along_q), rate(along_q)

    def bodies(self, vdot: Array) -> Array:
        """Return [V, ω] and its shares of q and of v in [V̇, ω̇] of the bodies (3, n_b, d + e)."""
        along_v = rate(self._velocities(self._while_v_changes(vdot)))
        return np.array([*self._velocities_of_q, along_v], dtype=np.float64)


def _power_of_inertia(
    at: Evaluation, formulation: Formulation, rates_of: Callable[[Evaluation], _Rates]
) -> tuple[float, float]:
    """Return Σ |m V| |V̇| + Σ |ω| |I| |ω̇|, W, and the same of what V, ω and their rates come from.

    Of the first the power is a sum, and may cancel. The second takes for each entry its size and
    how far it moves, per step: V may be a difference itself.
    """

    def rates(e: Evaluation) -> Array:
        return rates_of(e).bodies(e.acceleration(formulation).vdot)

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

    rates_of = cache(_Rates)

    def shares_of(e: Evaluation, formulation: Formulation) -> Array:
        return rates_of(e).power(e.acceleration(formulation).vdot)

    lost = 0.0 if lost is None else lost
    for formulation in case.solved:
        shares = np.append(shares_of(at, formulation), lost)
        summed, summed_spread = _power_of_inertia(at, formulation, rates_of)
        scale = max(largest(shares), summed)
        # Energies are summed over the bodies, which rounds as often.
        rounding = at.scene.n * (largest(shares) + summed_spread)
        spread = at.spread(lambda e, f=formulation: shares_of(e, f).sum()) + rounding
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
