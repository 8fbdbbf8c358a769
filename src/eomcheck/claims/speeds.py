"""Claims of the paper's appendices: null spaces, remainders, generalized forces, ML = Kane."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from eomcheck.claims.case import Case
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Look,
    Sides,
    Skipped,
    check,
    claim,
    magnitude,
    measured_where,
    numbered,
    sized,
    speed_names,
    vanishing,
)
from eomcheck.claims.trial import answer, compared
from eomcheck.engines.answers import inertia_size
from eomcheck.errors import RefusedError
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, largest
from eomcheck.formulations import Partition, em, kane
from eomcheck.formulations.em import project
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import Array, map_record, objects


def embedding(e: Quantities, partition: Partition) -> Array:
    """Return the w (n, n-r) of the embedding method.

    Raises:
        RefusedError: the constraints are not independent, or more than coordinates.
    """
    e.refuse_partition()
    return em.embedding(e.terms.a, e.terms.gamma, partition)[0]


@claim("null-space-embedding", "a w = 0", "(15), (A1)", "w of the embedding method")
def null_space_embedding(at: Quantities, look: Look) -> Iterator[Sides | Skipped]:
    """The w of the embedding method spans the null space of a, for both partitions."""
    names = (at.scene.constraint_names, numbered("v_2,", at.scene.p))
    for subject, partition in () if at.terms.a is None else look.partitions:
        try:
            w = embedding(at, partition)
        except RefusedError as refusal:
            yield Skipped(subject, str(refusal))
        else:
            # Where w grows from row to row, so does what was rounded in it before.
            told = measured_where(look.exact or _has_digits(look, w, partition))
            yield vanishing(subject, at.terms.a @ w, names, magnitude(at.terms.a, w), told)


def _has_digits(look: Look, w: Array, partition: Partition) -> Any:
    """Return whether rounding leaves digits of w: none where a_1 is nothing but rounding."""
    lost = allowed_error(look.sensitivity(lambda e: embedding(e, partition)))
    return lost <= INCONCLUSIVE * largest(w)


@claim("null-space-speeds", "a w′ = 0", "(20), (B1)-(B3)", "w′ of the generalized speeds")
def null_space_speeds(at: Quantities, look: Look) -> Iterator[Sides]:
    """The w′ of the generalized speeds spans the null space of a."""
    if at.terms.a is not None and look.has_speeds:
        a, W = at.terms.a, at.speeds.W
        names = (at.scene.constraint_names, speed_names(at))
        yield vanishing("ml, kane", a @ W, names, magnitude(a, W))


@claim("speeds-velocity", "w′ u + x′ = q̇", "(20), (29)", "generalized speeds")
def speeds_velocity(at: Quantities, look: Look) -> Iterator[Sides]:
    """The generalized speeds of a consistent velocity give it back, and it them."""
    if not look.has_speeds:
        return
    names = (at.scene.coordinate_names,)
    u = at.call(at.scene.speeds_of, at.parameters, at.prepared, at.q, at.velocity)
    yield Sides("u", u, at.u, (speed_names(at),))
    if not look.exact:
        # v may violate what nearly dependent constraints amplify, and u leaves out.
        yield Sides("ml, kane", at.velocity, at.v, names)
    if at.scene.qdot is not None:
        yield Sides("q̇", at.qdot, at.v, names)
    a, b = at.terms.a, at.terms.b
    # Without b and x′ this is a w′ = 0.
    if look.exact and a is not None and not (b is None and at.speeds.offset is None):
        found = a @ at.v if b is None else a @ at.v + b
        yield vanishing("a q̇ + b", found, (at.scene.constraint_names,), 0.0)


def _differentiated(
    kinematics: Callable, speeds: Callable, parameters: Any, still: Any, rates: Any, *state: Array
) -> Array:
    """Return ẇ′u + ẋ′ (n,), w′ and x′ differentiated along the motion.

    Args:
        kinematics: function of a scene.
        speeds: function of a scene.
        parameters: of the scene.
        still: what it prepares.
        rates: how fast that changes.
        state: coordinates (n,), velocities (n,) and speeds (p,).
    """
    q, v, u = state
    parameters, prepared = objects(parameters), map_record(duals, still, rates)
    steady = duals(u, np.zeros(u.shape, object))
    W, _, offset = speeds(
        parameters, prepared, kinematics(parameters, prepared, duals(q, v), steady)
    )
    return rate(W) @ u if offset is None else rate(W) @ u + rate(offset)


@claim(
    "speeds-remainder",
    "a (ẇ′u + ẋ′) + gamma = 0",
    "(3), (20)",
    "remainder ẇ′u + ẋ′",
    rate_of="rest",
)
def speeds_remainder(at: Quantities, look: Look) -> Iterator[Sides | Skipped]:
    """The part of q̈ left at u̇ = 0 is ẇ′u + ẋ′ and satisfies the constraints differentiated."""
    if not look.has_speeds:
        return
    a, gamma, rest = at.terms.a, at.terms.gamma, at.speeds.rest
    told = measured_where(look.speeds_told)
    if at.speeds.W is not None:
        here = at.parameters, *at.prepared_and_rates(at.v), at.q, at.v, at.u
        expected = at.call(_differentiated, at.scene.kinematics, at.scene.speeds, *here)
        # Where nothing moves both are 0, and rightly so. Either is a solve of its own.
        names = (at.scene.coordinate_names,)
        yield Sides("rest", rest, expected, names, sensitivity=told, may_vanish=True)
    if a is not None:
        names, terms = (at.scene.constraint_names,), magnitude(a, rest) + magnitude(gamma)
        sides = vanishing("ml, kane", a @ rest + gamma, names, terms, told)
        # Rods that stay parallel leave nothing of gamma, and of rest.
        yield sides._replace(may_vanish=True)


@claim("active-forces", "F_Kane = w′ᵀ Q", "(23), (C1)-(C4), (D1)-(D2)", "generalized active forces")
def active_forces(at: Quantities, look: Look) -> Iterator[Sides]:
    """Kane's active forces, from the bodies, are Lagrange's, projected."""
    if not look.has_speeds:
        return
    W, Q, force = at.speeds.W, at.terms.Q, at.bodies.force
    if Q is None and force is None:
        return
    if Q is None:
        projected, terms = np.zeros(at.scene.p, object), magnitude(force)
    else:
        projected = Q if W is None else W.T @ Q
        terms = magnitude(Q) if W is None else magnitude(W.T, Q)
    found = np.zeros(at.scene.p, object) if force is None else force
    yield sized(Sides("kane", found, projected, (speed_names(at),)), terms)


def ml_system(e: Quantities) -> tuple[Array, Array]:
    """Return (M_ML (p, p), F_ML (p,))."""
    return project(e.terms.M, e.F, e.speeds.W, e.speeds.rest)


def kane_system(e: Quantities) -> tuple[Array, Array]:
    """Return (M_Kane (p, p), N_Kane q̇ + G_Kane (p,))."""
    return e.call(kane.inertia_sums, *e.bodies[:-1], e.scene.support)


@claim("kane-ml-mass", "M_Kane = M_ML", "(21), (23)", "M_Kane against M_ML")
def kane_ml_mass(at: Quantities, look: Look) -> Iterator[Sides]:
    """Kane's and the modified Lagrange method have the same mass matrix, element by element."""
    if look.has_speeds:
        yield Sides("kane ~ ml", kane_system(at)[0], ml_system(at)[0], (speed_names(at),) * 2)


@claim("kane-ml-force", "F_Kane - N q̇ - G = F_ML", "(21)-(23)", "F_Kane - N q̇ - G against F_ML")
def kane_ml_force(at: Quantities, look: Look) -> Iterator[Sides]:
    """Kane's and the modified Lagrange method have the same right-hand side."""
    if not look.has_speeds:
        return
    force, remainder = at.bodies.force, kane_system(at)[1]
    terms = magnitude(remainder) + magnitude(force)
    # It is written over where it stands.
    found, expected = kane.right_hand_side(force, remainder), ml_system(at)[1]
    yield sized(Sides("kane ~ ml", found, expected, (speed_names(at),)), terms)


@check(
    "kane-n-matrix",
    "N q̇ + G by recursion = N_Kane q̇ in full",
    "(22)-(23)",
    "inertia remainder N q̇ + G",
    asks="kane_inertia_remainder",
)
def kane_n_matrix(case: Case) -> Iterator[Finding]:
    """Our remainder is N_Kane q̇ + G_Kane of Eq. (23), differentiated by an engine."""
    if not case.has_speeds:
        return

    def remainder(e: Quantities) -> Array:
        return kane_system(e)[1]

    # What it differentiates may be told in frames that turn, as in B.
    W = case.at.speeds.W
    in_speeds = inertia_size(case.at) * (1.0 if W is None else largest(np.abs(W).sum(axis=0)))
    ours = cache(partial(remainder, case.at))
    for engine in case.taking_part:
        said = answer(case, engine, *case.state, expected=ours, part=lambda said: said[0])
        if isinstance(said, Finding) or isinstance(engine, type):
            yield said
            continue
        theirs, terms, condition = said
        scale = sensitivity_of(case.at, remainder, coordinates=True) + terms + in_speeds
        yield compared(
            case,
            engine,
            f"kane ~ {engine.key}",
            ours(),
            theirs,
            condition * scale,
            lambda answers: answers.kane_inertia_remainder(*case.state)[0],
            scale=scale,
            names=(speed_names(case.at),),
        )
