"""Claims of the paper's appendices: null spaces, remainders, generalized forces, ML = Kane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from eomcheck.claims.claim import Case, claim
from eomcheck.claims.finding import Finding
from eomcheck.engines import DerivingEngine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import Partition, em, kane
from eomcheck.formulations.projection import project
from eomcheck.numbers.contract import Array


def _vanishes(case: Case, subject: str, w: Callable[[Evaluation], Array]) -> Finding:
    """Return the Finding of a w = 0."""
    # Where w grows from row to row, so does what was rounded in it before.
    terms = largest(np.abs(case.at.terms.a) @ np.abs(w(case.at)))
    names = (case.at.scene.constraint_names, case.speed_names)
    return case.vanishes(subject, lambda e: e.terms.a @ w(e), terms, names)


def embedding(e: Quantities, partition: Partition) -> Array:
    """Return the w (n, n-r) of the embedding method."""
    return em.embedding(e.terms.a, e.terms.gamma, partition)[0]


@claim("null-space-embedding", "a w = 0", "(15), (A1)", "w of the embedding method")
def null_space_embedding(case: Case) -> Iterator[Finding]:
    """The w of the embedding method spans the null space of a, for both partitions."""
    if case.at.terms.a is None:
        return
    for pivoted in (False, True):
        partition = case.at.pivoted_partition if pivoted else case.at.partition
        with suppress(RefusedError):
            subject = "em, pivoted" if pivoted else "em"
            yield _vanishes(case, subject, lambda e, p=partition: embedding(e, p))


@claim("null-space-speeds", "a w′ = 0", "(20), (B1)-(B3)", "w′ of the generalized speeds")
def null_space_speeds(case: Case) -> Iterator[Finding]:
    """The w′ of the generalized speeds spans the null space of a."""
    if case.at.terms.a is not None and case.has_speeds:
        yield _vanishes(case, "ml, kane", lambda e: e.speeds.W)


@claim("speeds-velocity", "w′ u + x′ = q̇", "(20), (29)", "generalized speeds")
def speeds_velocity(case: Case) -> Iterator[Finding]:
    """The generalized speeds of a consistent velocity give it back."""
    if case.has_speeds:
        at = case.at
        # v too: what it may violate by, nearly dependent constraints amplify, and u leaves out.
        spread = at.spread(lambda e: e.v)
        yield case.compare("ml, kane", at.velocity, at.v, spread + at.spread(lambda e: e.velocity))
        if at.scene.qdot is not None:
            yield case.compare("q̇", at.qdot, at.v, spread + at.spread(lambda e: e.qdot))


@claim("speeds-remainder", "a (ẇ′u + ẋ′) + gamma = 0", "(3), (20)", "remainder ẇ′u + ẋ′")
def speeds_remainder(case: Case) -> Iterator[Finding]:
    """The part of q̈ that is left at u̇ = 0 satisfies the constraints differentiated."""
    at = case.at
    if at.terms.a is None or not case.has_speeds:
        return

    def left(e: Evaluation) -> Array:
        return e.terms.a @ e.speeds.rest + e.terms.gamma

    size = np.abs(at.terms.a) @ np.abs(at.speeds.rest)
    yield case.vanishes("ml, kane", left, largest(size) + largest(at.terms.gamma))


def projected_forces(e: Quantities) -> Array:
    """Return w′ᵀ Q (p,)."""
    W, Q = e.speeds.W, e.terms.Q
    return Q if W is None else W.T @ Q


@claim("active-forces", "F_Kane = w′ᵀ Q", "(23), (C1)-(C4), (D1)-(D2)", "generalized active forces")
def active_forces(case: Case) -> Iterator[Finding]:
    """Kane's active forces, from the bodies, are Lagrange's, projected."""
    at = case.at
    if not case.has_speeds or at.terms.Q is None or at.bodies.force is None:
        return

    spread = at.spread(projected_forces) + at.spread(lambda e: e.bodies.force)
    W, size = at.speeds.W, np.abs(at.terms.Q)
    size = largest(size if W is None else np.abs(W.T) @ size)
    names = (case.speed_names,)
    found, expected = at.bodies.force, projected_forces(at)
    yield case.compare("kane", found, expected, spread + size, scale=size, names=names)


def ml_system(e: Quantities) -> tuple[Array, Array]:
    """Return (M_ML (p, p), F_ML (p,))."""
    return project(e.terms.M, e.F, e.speeds.W, e.speeds.rest)


def kane_mass(e: Quantities) -> Array:
    """Return M_Kane (p, p)."""
    return e.call(kane.inertia_sums, *e.bodies[:-1])[0]


def kane_remainder(e: Quantities) -> Array:
    """Return N_Kane q̇ + G_Kane (p,)."""
    return e.call(kane.inertia_sums, *e.bodies[:-1])[1]


def kane_force(e: Quantities) -> Array:
    """Return F_Kane - (N_Kane q̇ + G_Kane) (p,)."""
    return kane.right_hand_side(e.bodies.force, kane_remainder(e))


@claim("kane-ml-mass", "M_Kane = M_ML", "(21), (23)", "M_Kane against M_ML")
def kane_ml_mass(case: Case) -> Iterator[Finding]:
    """Both methods have the same mass matrix, element by element."""
    if case.has_speeds:
        at = case.at
        spread = at.spread(kane_mass) + at.spread(lambda e: ml_system(e)[0])
        names = (case.speed_names, case.speed_names)
        yield case.compare("kane ~ ml", kane_mass(at), ml_system(at)[0], spread, names=names)


@claim("kane-ml-force", "F_Kane - N q̇ - G = F_ML", "(21)-(23)", "F_Kane - N q̇ - G against F_ML")
def kane_ml_force(case: Case) -> Iterator[Finding]:
    """Both methods have the same right-hand side, element by element."""
    if case.has_speeds:
        at = case.at
        spread = at.spread(kane_force) + at.spread(lambda e: ml_system(e)[1])
        found, expected = kane_force(at), ml_system(at)[1]
        force = at.bodies.force
        scale = largest(kane_remainder(at)) + (0.0 if force is None else largest(force))
        names = (case.speed_names,)
        yield case.compare("kane ~ ml", found, expected, spread, scale=scale, names=names)


@claim(
    "kane-n-matrix",
    "N q̇ + G by recursion = N_Kane q̇ in full",
    "(22)-(23)",
    "inertia remainder N q̇ + G",
)
def kane_n_matrix(case: Case) -> Iterator[Finding]:
    """Our remainder is N_Kane q̇ + G_Kane of Eq. (23), differentiated by an engine."""
    at = case.at
    if not case.has_speeds:
        return
    for engine in case.engines:
        if not isinstance(engine, DerivingEngine):
            continue
        expected, size, condition = engine.kane_inertia_remainder(*case.state)
        found = kane_remainder(at)
        scale = at.spread(kane_remainder, coordinates=True) + size
        yield case.compare(
            f"kane ~ {engine.key}",
            found,
            expected,
            condition * scale,
            scale=scale,
            evidence=f"compared: {engine.version()}",
            names=(case.speed_names,),
        )
