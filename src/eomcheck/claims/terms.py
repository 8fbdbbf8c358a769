"""Claims about single terms: M, B, Q, a and gamma against engines that derive them otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from eomcheck.claims.claim import Case, claim
from eomcheck.claims.finding import Finding
from eomcheck.engines import DerivingEngine, Engine
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.tolerance import HUGE, largest
from eomcheck.numbers.contract import Array
from eomcheck.numbers.dual import rate
from eomcheck.numbers.entries import objects


def _against_engines(
    case: Case,
    ours: Callable[[Evaluation], Array],
    theirs: Callable[..., Array],
    *,
    derived: bool = True,
    size: Callable[[Engine], float] = lambda engine: 0.0,
) -> Iterator[Finding]:
    at = case.at
    spread = None
    for engine in case.engines:
        if derived and not isinstance(engine, DerivingEngine):
            continue
        spread = at.spread(ours, coordinates=True) if spread is None else spread
        found = ours(at)
        # A term of size 0 (B at rest) is compared all the same: it should vanish.
        yield case.compare(
            engine.key,
            found,
            theirs(engine),
            spread + size(engine),
            scale=spread + size(engine),
            evidence=f"compared: {engine.version()}",
        )


@claim("finite-terms", "M, Q, B, a, gamma are finite", "(2)-(5)", "term that is not finite")
def finite_terms(case: Case) -> Iterator[Finding]:
    """Every term is a finite number, unless the state itself is so large that it overflows."""
    at = case.at
    with_inputs = [x for x in at.parameters if x is not None] + [at.q, at.v]
    overflow = max(largest(x) for x in with_inputs) > HUGE
    for name, term in at.terms._asdict().items():
        if term is not None and not (overflow and not np.isfinite(term).all()):
            zero = np.zeros(np.shape(term))
            bad = np.where(np.isfinite(term), 0.0, np.inf)
            yield case.compare(name, bad, zero, 0.0)


@claim("mass-matrix", "M = ∂²T/∂q̇²", "(5), (25)", "mass matrix")
def mass_matrix(case: Case) -> Iterator[Finding]:
    """Compare the mass matrix."""
    return _against_engines(
        case,
        lambda e: e.terms.M,
        lambda engine: engine.mass_matrix(case.at.q, case.at.t),
        derived=False,
        size=lambda engine: engine.mass_matrix_size(case.at.q, case.at.t),
    )


@claim("bias", "B = d/dt ∂T/∂q̇ - ∂T/∂q at q̈ = 0", "(5), (25)", "bias")
def bias(case: Case) -> Iterator[Finding]:
    """Compare the bias, zeros where the scene has none."""
    zero = np.zeros(case.at.scene.n)
    return _against_engines(
        case,
        lambda e: zero if e.terms.B is None else e.terms.B,
        lambda engine: engine.bias(*case.state),
        derived=False,
        size=lambda engine: engine.bias_size(*case.state),
    )


@claim("generalized-forces", "Q = -∂U/∂q - ∂R/∂q̇", "(26)-(27)", "generalized forces")
def generalized_forces(case: Case) -> Iterator[Finding]:
    """Compare Q with the derivatives of the potential energy and of the dissipation."""
    if case.at.terms.Q is None:
        return iter(())
    return _against_engines(case, lambda e: e.terms.Q, lambda engine: engine.forces(*case.state))


@claim("constraint-jacobian", "a = ∂c/∂q̇", "(2), (28)", "constraint Jacobian")
def constraint_jacobian(case: Case) -> Iterator[Finding]:
    """Compare a with the derivative of the constraints."""
    if case.at.terms.a is None:
        return iter(())
    return _against_engines(
        case,
        lambda e: e.terms.a,
        lambda engine: engine.constraint_jacobian(*case.state),
    )


@claim("constraint-velocity", "a q̇ + b = c(q, q̇, t)", "(2)", "constraints at velocity level")
def constraint_velocity(case: Case) -> Iterator[Finding]:
    """Compare a and b with the constraints, without any engine."""

    def from_terms(e: Evaluation) -> Array:
        moving = e.terms.a @ e.v
        return moving if e.terms.b is None else moving + e.terms.b

    def direct(e: Evaluation) -> Array:
        return e.call(e.scene.constraint, e.parameters, e.prepared, e.q, e.v)

    at = case.at
    if at.terms.a is None:
        return
    size = largest(np.abs(at.terms.a) @ np.abs(at.v))
    size += 0.0 if at.terms.b is None else largest(at.terms.b)
    spread = at.spread(from_terms) + at.spread(direct) + size
    names = (at.scene.constraint_names,)
    yield case.compare("c", from_terms(at), direct(at), spread, scale=size, names=names)


@claim("position-rate", "dΦ/dt = a q̇ + b, Φ = 0 where closed", "(2)", "rate of closed positions")
def position_rate(case: Case) -> Iterator[Finding]:
    """Compare holonomic constraints with the rates of what vanishes at closed positions."""
    at = case.at
    residual, rows = at.scene.position_residual, at.scene.holonomic
    if residual is None or at.terms.a is None:
        return

    def along(e: Evaluation, qdot: Array, clock: bool) -> Array:
        return np.asarray(rate(residual(objects(e.parameters), *e.moving(qdot, clock))), np.float64)

    def over_coordinates(e: Evaluation) -> Array:
        # At a consistent velocity every rate is 0, and would tell nothing.
        return np.array([along(e, axis, False) for axis in np.eye(e.scene.n)]).T

    def over_time(e: Evaluation) -> Array:
        return along(e, np.zeros(e.scene.n), True)

    def b(e: Evaluation) -> Array:
        return (np.zeros(e.scene.r) if e.terms.b is None else e.terms.b)[rows]

    spread = at.spread(over_coordinates) + at.spread(lambda e: e.terms.a[rows])
    names = (at.scene.constraint_names[rows], at.scene.coordinate_names)
    yield case.compare("∂Φ/∂q", over_coordinates(at), at.terms.a[rows], spread, names=names)
    if at.scene.depends_on_time:
        spread = at.spread(over_time) + at.spread(b)
        yield case.compare("∂Φ/∂t", over_time(at), b(at), spread, scale=spread, names=names[:1])


@claim("constraint-drift", "gamma = ȧ q̇ + ḃ", "(3)", "constraint drift")
def constraint_drift(case: Case) -> Iterator[Finding]:
    """Compare gamma with the time derivative of the constraints."""
    if case.at.terms.gamma is None:
        return iter(())
    return _against_engines(
        case,
        lambda e: e.terms.gamma,
        lambda engine: engine.constraint_drift(*case.state),
    )


@claim("kinetic-energy", "½ q̇ᵀ M q̇ = T", "(5), (25)", "kinetic energy")
def kinetic_energy(case: Case) -> Iterator[Finding]:
    """Compare M with the kinetic energy, without any engine."""

    def from_mass_matrix(e: Evaluation) -> float:
        return e.v @ e.terms.M @ e.v / 2

    def direct(e: Evaluation) -> float:
        return e.call(e.scene.energies, e.parameters, e.prepared, e.q, e.v)[0]

    at = case.at
    yield case.compare(
        "T",
        np.asarray(from_mass_matrix(at)),
        np.asarray(direct(at)),
        at.spread(from_mass_matrix) + at.spread(direct) + np.abs(at.v) @ np.abs(at.terms.M @ at.v),
    )
