"""Claims about single terms: M, B, Q, a, b and gamma against energies, constraints and engines.

Terms written by hand are compared with derivatives of T, U, R and the constraints by automatic
differentiation (dual numbers), along virtual displacements.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Comparison,
    EvaluationContext,
    GenericPoint,
    along_directions,
    case_claim,
    claim,
    names_of_term,
    product_size,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import HUGE, largest
from eomcheck.numbers.dual import constant, duals, rate
from eomcheck.numbers.generic import Array, as_objects, map_record


@case_claim("finite-terms", "M, Q, B, a, gamma are finite", "(2)-(5)", "term that is not finite")
def finite_terms(case: Case) -> Iterator[Finding]:
    """Every term is finite, unless the state itself is so large that it overflows."""
    at = case.at
    with_inputs = [x for x in at.parameters if x is not None] + [at.q, at.v]
    overflow = max(largest(x) for x in with_inputs) > HUGE
    for name, term in at.terms._asdict().items():
        if term is not None and not (overflow and not np.isfinite(term).all()):
            zero = np.zeros(np.shape(term))
            bad = np.where(np.isfinite(term), 0.0, np.inf)
            yield case.compare(name, bad, zero, 0.0, names=names_of_term(at.scene, name))


@claim("mass-matrix", "M = ∂²T/∂q̇²", "(5), (25)", "mass matrix", asks="mass_matrix")
def mass_matrix(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """M v is the derivative of T by v in any direction, and M is symmetric."""
    M, v = at.terms.M, at.free.v

    def change(direction: Array) -> tuple[Any, Any]:
        T, _ = at.scene.energies(at.parameters, at.prepared, at.q, duals(v, direction))
        return direction @ M @ v, rate(T)

    yield from along_directions(context, "M v", change)
    yield Comparison("M", M, M.T, (at.scene.coordinate_names,) * 2)


@claim("bias", "B = d/dt ∂T/∂q̇ - ∂T/∂q at q̈ = 0", "(5), (25)", "bias", rate_of="B", asks="bias")
def bias(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """B is the left side of Lagrange's equations at q̈ = 0, along any virtual displacement."""
    v, B = at.free.v, at.free.terms.B
    prepared, q = at.prepared_duals(v)
    steady = constant(prepared), constant(q)

    def work(direction: Array) -> tuple[Any, Any]:
        T, _ = at.scene.energies(at.parameters, *steady, duals(v, direction))
        T_aside, _ = at.scene.energies(at.parameters, *at.prepared_duals(direction, clock=False), v)
        return 0 if B is None else direction @ B, rate(rate(T)) - rate(T_aside)

    return along_directions(context, "B", work)


@claim(
    "generalized-forces",
    "Q = -∂U/∂q - ∂R/∂q̇",
    "(26)-(27)",
    "generalized forces",
    rate_of="Q",
    asks="forces",
)
def generalized_forces(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """Q is minus the derivatives of U by q and of R by v, along any virtual displacement."""
    Q = at.terms.Q

    def work(direction: Array) -> tuple[Any, Any] | None:
        _, U = at.scene.energies(at.parameters, *at.prepared_duals(direction, clock=False), at.v)
        R = at.dissipation(duals(at.v, direction))
        if U is None and R is None and Q is None:
            return None
        expected = (0 if U is None else -rate(U)) - (0 if R is None else rate(R))
        return 0 if Q is None else direction @ Q, expected

    return along_directions(context, "Q", work)


def _constraints(subject: str, at: Quantities) -> Iterator[Comparison]:
    """Yield the comparison a v + b = c, unless both sides are absent."""
    v, a, b = at.v, at.terms.a, at.terms.b
    expected = at.call(at.scene.constraint, at.parameters, at.prepared, at.q, v)
    if a is None and expected is None:
        return
    zero = np.zeros(at.scene.r, object)
    actual = zero if a is None else a @ v if b is None else a @ v + b
    expected = zero if expected is None else expected
    terms = product_size(expected) if a is None else product_size(a, v) + product_size(b)
    yield Comparison(subject, actual, expected, (at.scene.constraint_names,), terms)


@claim(
    "constraint-jacobian",
    "a = ∂c/∂q̇",
    "(2), (28)",
    "constraint Jacobian",
    asks="constraint_jacobian",
)
def constraint_jacobian(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The constraints are a v + b for every v, and none is left out."""
    return _constraints("a", context.free)


@claim(
    "constraint-velocity",
    "a q̇ + b = c(q, q̇, t)",
    "(2)",
    "constraints at velocity level",
    provable=False,
)
def constraint_velocity(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The constraints are a v + b, without any engine."""
    return _constraints("c", context.free)


def _rate_of_positions(
    residual: Callable, parameters: Any, prepared: Any, rates: Any, q: Array, qdot: Array
) -> Array:
    """Return the rates of residuals from precomputed values, their rates, q (n,) and q̇ (n,)."""
    changing = map_record(duals, prepared, rates)
    return rate(residual(as_objects(parameters), changing, duals(q, qdot)))


@claim(
    "position-rate",
    "dΦ/dt = a q̇ + b, Φ = 0 where closed",
    "(2)",
    "rate of closed positions",
    rate_of="Φ",
)
def position_rate(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Holonomic constraints are the rates of the loop-closure residuals Φ."""
    scene, rows = at.scene, at.scene.holonomic
    residual, names = scene.position_residual, scene.constraint_names[rows]
    if residual is None or at.terms.a is None:
        return

    def rates(qdot: Array, clock: bool = True) -> Array:
        arguments = at.parameters, *at.prepared_and_rates(qdot, clock), at.q, qdot
        return at.run(_rate_of_positions, residual, *arguments)

    if context.exact:
        v = context.free.v
        expected = scene.constraint(at.parameters, at.prepared, at.q, v)[rows]
        yield Comparison("Φ", rates(v), expected, (names,))
        return
    # At a consistent velocity every rate is 0: use each coordinate direction instead.
    over_coordinates = np.array([rates(axis, False) for axis in context.directions]).T
    yield Comparison("∂Φ/∂q", over_coordinates, at.terms.a[rows], (names, scene.coordinate_names))
    if scene.depends_on_time:
        b = (np.zeros(scene.r) if at.terms.b is None else at.terms.b)[rows]
        yield Comparison("∂Φ/∂t", rates(np.zeros(scene.n)), b, (names,), may_vanish=True)


@claim(
    "constraint-drift",
    "gamma = ȧ q̇ + ḃ",
    "(3)",
    "constraint drift",
    rate_of="gamma",
    asks="constraint_drift",
)
def constraint_drift(at: GenericPoint, context: EvaluationContext) -> Iterator[Comparison]:
    """The drift gamma is the rate of the constraints at v̇ = 0, for every v."""
    free = at.free
    if at.terms.a is None:
        return
    changing = at.scene.constraint(at.parameters, *at.prepared_duals(free.v), free.v)
    yield Comparison("gamma", free.terms.gamma, rate(changing), (at.scene.constraint_names,))


@claim("kinetic-energy", "½ q̇ᵀ M q̇ = T", "(5), (25)", "kinetic energy")
def kinetic_energy(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The quadratic form vᵀ M v is 2 T for every v."""
    v = context.free.v
    momentum = at.terms.M @ v
    T, _ = at.call(at.scene.energies, at.parameters, at.prepared, at.q, v)
    yield Comparison("T", v @ momentum, 2 * T, (), product_size(v, momentum))
