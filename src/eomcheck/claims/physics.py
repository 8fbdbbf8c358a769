"""Claims that need no second opinion: energy, and motions of the whole scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, cached_property, reduce
from typing import Any

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import Look, Sides, check, claim, size, vanishing
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity, perturbed_copies
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import allowed_error, larger, largest
from eomcheck.formulations import Formulation
from eomcheck.numbers.dual import duals, rate, value
from eomcheck.numbers.generic import Array, each, map_record, objects
from eomcheck.numbers.lanes import doubles, lanes_in, where
from eomcheck.numbers.noise import SAMPLES, STEP


def _energy_rate(energies: Callable, *state: Any) -> Any:
    """Return the rate of T + U, W, for a state in dual numbers."""
    T, U = energies(*state)
    return rate(T if U is None else T + U)


def _power_of_q(energies: Callable, parameters: Any, still: Any, rates: Any, *state: Array) -> Any:
    """Return the share of q in Ṫ + U̇ of what is prepared, its rates, q and v."""
    return _energy_rate(energies, *_while_q_changes(parameters, still, rates, *state))


def _power_along(energies: Callable, *here: Any) -> Any:
    """Return the share of v in Ṫ + U̇ of (parameters, prepared, q, v, v̇)."""
    *still, v, vdot = here
    return _energy_rate(energies, *objects(tuple(still)), duals(v, vdot))


def _velocities_of_q(velocities: Callable, *here: Any) -> tuple[Array, Array]:
    """Return [V, ω] and the share of q in [V̇, ω̇]; see `_power_of_q`."""
    along_q = np.concatenate(velocities(*_while_q_changes(*here)), axis=1)
    return each(value, along_q), rate(along_q)


def _velocities_along(velocities: Callable, *here: Any) -> Any:
    """Return the share of v in [V̇, ω̇] of (parameters, prepared, q, v, v̇)."""
    *still, v, vdot = here
    return rate(np.concatenate(velocities(*objects(tuple(still)), duals(v, vdot)), axis=1))


def _while_q_changes(parameters: Any, still: Any, rates: Any, q: Array, v: Array) -> tuple:
    return objects(parameters), map_record(duals, still, rates), duals(q, v), objects(v)


class _Rates:
    """Rates of the energy and of the bodies' velocities, differentiated exactly.

    Their shares while q changes at v do not depend on v̇, and are the same for all formulations.
    """

    def __init__(self, e: Quantities):
        self._e = e

    def _along_v(self, function: Callable, of: Callable, vdot: Array) -> Any:
        e = self._e
        return e.run(function, of, e.parameters, e.prepared, e.q, e.v, vdot)

    def _along_q(self, function: Callable, of: Callable) -> Any:
        e = self._e
        return e.run(function, of, e.parameters, *e.prepared_and_rates(e.v), e.q, e.v)

    @cached_property
    def _power_of_q(self) -> Any:
        return self._along_q(_power_of_q, self._e.scene.energies)

    def power(self, vdot: Array) -> tuple[Any, Any]:
        """Return the shares of q and of v in d(T+U)/dt, W."""
        return self._power_of_q, self._along_v(_power_along, self._e.scene.energies, vdot)

    @cached_property
    def _velocities_of_q(self) -> tuple[Array, Array]:
        return self._along_q(_velocities_of_q, self._e.scene.velocities)

    def bodies(self, vdot: Array) -> Array:
        """Return [V, ω] and its shares of q and of v in [V̇, ω̇] of the bodies (3, n_b, d + e)."""
        along_v = self._along_v(_velocities_along, self._e.scene.velocities, vdot)
        parts = *self._velocities_of_q, along_v
        if lanes_in(parts):
            return doubles(parts)
        return np.stack([np.asarray(x, np.float64) for x in parts], axis=-3)


def _power_of_inertia(at: Evaluation, rates: Callable[[Evaluation], Array]) -> tuple[Any, Any]:
    """Return Σ |m V| |V̇| + Σ |ω| |I| |ω̇|, W, and the same of what V, ω and their rates come from.

    Of the first the power is a sum, and may cancel. The second takes for each entry its size and
    its largest change under perturbation, divided by the step: V may be a difference itself.

    Args:
        at: the state.
        rates: see `_Rates.bodies`.
    """

    def power(sizes: Array) -> Any:
        speed, change = sizes[0], sizes[1] + sizes[2]
        inertia = np.abs(at.parameters.inertia)
        e = round((inertia.size / len(speed)) ** 0.5)
        d = speed.shape[1] - e
        pushing = at.parameters.mass @ (speed[:, :d] * change[:, :d]).sum(axis=1)
        turning = inertia.reshape(len(speed), e, e) * change[:, None, d:]
        return pushing + (speed[:, d:, None] * turning).sum()

    with np.errstate(all="ignore"):
        here, copies = rates(at), perturbed_copies(at)
        try:
            if at.lanes:
                changes = [np.abs(rates(copy) - here) for copy in copies[:SAMPLES]]
            else:
                changes = np.abs(rates(copies[0].together)[:SAMPLES] - here)
        except RefusedError:
            return power(np.abs(here)), np.inf
        return power(np.abs(here)), power(np.abs(here) + reduce(np.maximum, changes) / STEP)


@claim("power-balance", "d(T + U)/dt = -q̇ ∂R/∂q̇", "(25)-(26), (31)", "power balance", rate_of="all")
def power_balance(at: Quantities, look: Look) -> Iterator[Sides]:
    """Ideal constraints do no work: along each q̈ the energy loses what the dampers take."""
    rates_of, R = cache(_Rates), at.dissipation(duals(at.v, at.v))
    if not at.scene.conserves_energy and (R is None or at.terms.b is not None):
        return  # what a clock drives takes and gives power that no R tells
    for f, x in look.solutions:
        shares = (*rates_of(at).power(x.vdot), 0 if R is None else rate(R))
        rounding = (0.0, 0.0) if look.exact else _of_power(look, f, rates_of, shares)
        yield vanishing(f.key, sum(shares), (), *rounding)


def _of_power(
    case: Any, f: Formulation, rates_of: Callable[[Evaluation], _Rates], shares: tuple
) -> tuple[Any, Any]:
    """Return the size of what is summed to the power, and κ · scale of the sum."""

    def power(e: Evaluation) -> float:
        return sum(rates_of(e).power(e.acceleration(f).vdot))

    def of_bodies(e: Evaluation) -> Array:
        return rates_of(e).bodies(e.acceleration(f).vdot)

    summed, summed_sensitivity = _power_of_inertia(case.at, of_bodies)
    terms, told = larger(largest(shares), summed), np.isfinite(case.vdot_sensitivity(f))
    if not lanes_in(told) and not told:
        return terms, np.inf
    # Energies are summed over the bodies, which rounds as often.
    rounding = case.at.scene.n * (largest(shares) + summed_sensitivity) + _of_constraints(case, f)
    return terms, where(told, case.sensitivity(power, together=True) + rounding, np.inf)


def _of_constraints(case: Any, f: Formulation) -> Any:
    """Return |λ|ᵀ |a| |v|, W: v is rounded, and λ does work on what it violates constraints by."""
    lambda_ = case.at.acceleration(f).multipliers
    return 0.0 if lambda_ is None else size(lambda_, case.at.terms.a, case.at.v)


@check("invariance", "q̈ moves with the scene", "(25)-(28)", "invariance")
def invariance(case: Case) -> Iterator[Finding]:
    """Turning, shifting or mirroring the whole scene turns, shifts or mirrors q̈."""
    at = case.at
    for symmetry in at.scene.symmetries(at.q, at.v):
        there = Evaluation(symmetry.scene, symmetry.q, symmetry.v, at.t)
        longest = largest(np.abs(symmetry.image).sum(axis=1))
        for formulation in case.solved:
            try:
                found = there.acceleration(formulation).vdot
            except RefusedError as refused:
                why = "not looked at", "property-tested", f"refused after that: {refused}"
                yield case.finding(f"{symmetry.name}: {formulation.key}", 0.0, 0.0, *why)
                continue
            expected = symmetry.image @ at.acceleration(formulation).vdot
            # A turn adds to every angle, whose rounding then is that of larger numbers.
            turn = 1.0 + largest(symmetry.q - at.q) / max(largest(at.q), 1.0)
            sensitivity = (
                2 * longest * turn * case.part_sensitivity(formulation, "vdot", coordinates=True)
            )
            if not largest(found - expected) <= allowed_error(sensitivity):
                # An angle of 0 has no rounding to measure. Where it was turned to, it has.
                try:
                    sensitivity += acceleration_sensitivity(there, formulation, coordinates=True)
                except RefusedError:
                    sensitivity = np.inf
            names = (at.scene.coordinate_names,)
            subject = f"{symmetry.name}: {formulation.key}"
            yield case.compare(subject, found, expected, sensitivity, names=names)
