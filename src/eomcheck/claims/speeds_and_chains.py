"""Claims that relate terms: null spaces, generalized speeds and forces, ML = Kane, chains.

Claims of the paper's appendices come first (null spaces, remainders, generalized forces, ML =
Kane). Claims about a `Chain` (quasi-velocities x of bodies connected in series) compare its numbers
with the constraints, the energies and the forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any

import numpy as np

from eomcheck.claims.case import Case, ask_engine, compare_with_engine
from eomcheck.claims.finding import Finding
from eomcheck.claims.registry import (
    Comparison,
    EvaluationContext,
    Names,
    Skipped,
    along_directions,
    case_claim,
    claim,
    magnitude,
    numbered,
    product_size,
    sensitivity_where,
    sized,
    speed_names,
    vanishing,
)
from eomcheck.engines import Engine
from eomcheck.engines.answers import inertia_size
from eomcheck.errors import RefusedError
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, largest
from eomcheck.formulations import Partition, em, kane
from eomcheck.formulations.banded import joint_gaps
from eomcheck.formulations.em import project
from eomcheck.numbers.batch_arrays import as_float64, batch_size, everywhere
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import Array, as_objects, map_record
from eomcheck.numbers.linear import least_squares

# ---- Null spaces and generalized speeds ----------------------------------------------------------


def embedding_null_space(e: Quantities, partition: Partition) -> Array:
    """Return the w (n, n-r) of the embedding method.

    Raises:
        RefusedError: the constraints are not independent, or there are more than coordinates.
    """
    e.refuse_partition()
    return em.partition_embedding(e.terms.a, e.terms.gamma, partition)[0]


@claim(
    "null-space-embedding",
    "a w = 0",
    "(15), (A1)",
    "w of the embedding method",
    needs="constraints",
)
def null_space_embedding(
    at: Quantities, context: EvaluationContext
) -> Iterator[Comparison | Skipped]:
    """The w of the embedding method spans the null space of a, for both partitions."""
    names = (at.scene.constraint_names, numbered("v_2,", at.scene.p))
    for subject, partition in () if at.terms.a is None else context.partitions:
        try:
            w = embedding_null_space(at, partition)
        except RefusedError as refusal:
            yield Skipped(subject, str(refusal))
        else:
            # Where w grows from row to row, so do earlier rounding errors in it.
            sensitivity = sensitivity_where(context.exact or _has_digits(context, w, partition))
            sides = vanishing(subject, at.terms.a @ w, names, magnitude(at.terms.a, w), sensitivity)
            yield sides._replace(drawn_partition=context.exact and partition is not at.partition)


def _has_digits(context: EvaluationContext, w: Array, partition: Partition) -> Any:
    """Return whether rounding leaves digits of w: none if a_1 consists of rounding error."""
    lost = allowed_error(context.sensitivity(lambda e: embedding_null_space(e, partition)))
    return lost <= INCONCLUSIVE * largest(w)


@claim(
    "null-space-speeds",
    "a w′ = 0",
    "(20), (B1)-(B3)",
    "w′ of the generalized speeds",
    needs="constraints",
)
def null_space_speeds(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The w′ of the generalized speeds spans the null space of a."""
    if at.terms.a is not None and context.has_speeds:
        a, W = at.terms.a, at.speeds.W
        names = (at.scene.constraint_names, speed_names(at))
        yield vanishing("ml, kane", a @ W, names, magnitude(a, W))


@claim("speeds-velocity", "w′ u + x′ = q̇", "(20), (29)", "generalized speeds")
def speeds_velocity(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Generalized speeds and consistent velocities determine each other: the maps are inverse."""
    if not context.has_speeds:
        return
    names = (at.scene.coordinate_names,)
    u = at.call(at.scene.speeds_of, at.parameters, at.prepared, at.q, at.velocity)
    yield Comparison("u", u, at.u, (speed_names(at),))
    if not context.exact:
        # v may violate nearly dependent constraints, which amplify its rounding; u cannot.
        yield Comparison("ml, kane", at.velocity, at.v, names)
    if at.scene.qdot is not None:
        yield Comparison("q̇", at.qdot, at.v, names)
    a, b = at.terms.a, at.terms.b
    # Without b and x′ this is a w′ = 0.
    if context.exact and a is not None and not (b is None and at.speeds.offset is None):
        residual = a @ at.v if b is None else a @ at.v + b
        yield vanishing("a q̇ + b", residual, (at.scene.constraint_names,), 0.0)


def _differentiated(
    kinematics: Callable,
    speeds: Callable,
    parameters: Any,
    prepared: Any,
    rates: Any,
    *state: Array,
) -> Array:
    """Return ẇ′u + ẋ′ (n,), w′ and x′ differentiated along the motion.

    Args:
        kinematics: function of a scene.
        speeds: function of a scene.
        parameters: of the scene.
        prepared: precomputed values of the scene.
        rates: their rates.
        state: coordinates (n,), velocities (n,) and speeds (p,).
    """
    q, v, u = state
    parameters, prepared = as_objects(parameters), map_record(duals, prepared, rates)
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
    needs="constraints",
)
def speeds_remainder(at: Quantities, context: EvaluationContext) -> Iterator[Comparison | Skipped]:
    """The velocity-dependent part of q̈, at u̇ = 0, is ẇ′u + ẋ′ and keeps the constraints."""
    if not context.has_speeds:
        return
    a, gamma, drift = at.terms.a, at.terms.gamma, at.speeds.rest
    sensitivity = sensitivity_where(context.speeds_resolved)
    if at.speeds.W is not None:
        arguments = at.parameters, *at.prepared_and_rates(at.v), at.q, at.v, at.u
        expected = at.call(_differentiated, at.scene.kinematics, at.scene.speeds, *arguments)
        # At rest both are 0, which is right. Each side is a linear solve of its own.
        names = (at.scene.coordinate_names,)
        yield Comparison("rest", drift, expected, names, sensitivity=sensitivity, may_vanish=True)
    if a is not None:
        names, terms = (at.scene.constraint_names,), magnitude(a, drift) + magnitude(gamma)
        sides = vanishing("ml, kane", a @ drift + gamma, names, terms, sensitivity)
        # For rods that stay parallel gamma and rest are 0.
        yield sides._replace(may_vanish=True)


@claim(
    "active-forces",
    "F_Kane = w′ᵀ Q",
    "(23), (C1)-(C4), (D1)-(D2)",
    "generalized active forces",
    needs="forces",
)
def active_forces(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Kane's active forces, summed over the bodies, are Lagrange's, projected by w′."""
    if not context.has_speeds:
        return
    W, Q, force = at.speeds.W, at.terms.Q, at.bodies.force
    if Q is None and force is None:
        return
    if Q is None:
        projected, terms = np.zeros(at.scene.p, object), magnitude(force)
    else:
        projected = Q if W is None else W.T @ Q
        terms = magnitude(Q) if W is None else magnitude(W.T, Q)
    actual = np.zeros(at.scene.p, object) if force is None else force
    yield sized(Comparison("kane", actual, projected, (speed_names(at),)), terms)


def ml_system(e: Quantities) -> tuple[Array, Array]:
    """Return the system of the modified Lagrange method, (M_ML (p, p), F_ML (p,))."""
    return project(e.terms.M, e.F, e.speeds.W, e.speeds.rest)


def kane_system(e: Quantities) -> tuple[Array, Array]:
    """Return the inertia sums of Kane's method, (M_Kane (p, p), N_Kane q̇ + G_Kane (p,))."""
    return e.call(kane.inertia_sums, *e.bodies[:-1], e.scene.support)


@claim("kane-ml-mass", "M_Kane = M_ML", "(21), (23)", "M_Kane against M_ML")
def kane_ml_mass(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Kane's and the modified Lagrange method have equal mass matrices, element by element."""
    if context.has_speeds:
        yield Comparison("kane ~ ml", kane_system(at)[0], ml_system(at)[0], (speed_names(at),) * 2)


@claim("kane-ml-force", "F_Kane - N q̇ - G = F_ML", "(21)-(23)", "F_Kane - N q̇ - G against F_ML")
def kane_ml_force(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Kane's and the modified Lagrange method have equal right-hand sides."""
    if not context.has_speeds:
        return
    force, remainder = at.bodies.force, kane_system(at)[1]
    terms = magnitude(remainder) + magnitude(force)
    # In place: `remainder` is overwritten.
    actual, expected = kane.right_hand_side(force, remainder), ml_system(at)[1]
    yield sized(Comparison("kane ~ ml", actual, expected, (speed_names(at),)), terms)


@case_claim(
    "kane-n-matrix",
    "N q̇ + G by recursion = N_Kane q̇ in full",
    "(22)-(23)",
    "inertia remainder N q̇ + G",
    asks="kane_inertia_remainder",
)
def kane_n_matrix(case: Case) -> Iterator[Finding]:
    """The inertia remainder is N_Kane q̇ + G_Kane of Eq. (23), as differentiated by an engine."""
    for engine in case.claim_engines:
        yield from _compare_inertia_remainder(case.rounded_for(engine), engine)


def _compare_inertia_remainder(case: Case, engine: Engine | type[Engine]) -> Iterator[Finding]:
    """Yield the Finding of the inertia remainder of an engine."""
    if not case.has_speeds:
        return

    def remainder(e: Quantities) -> Array:
        return kane_system(e)[1]

    # The engine may differentiate vectors in rotating frames, as in B.
    W = case.at.speeds.W
    in_speeds = inertia_size(case.at) * (1.0 if W is None else largest(np.abs(W).sum(axis=0)))
    expected = cache(partial(remainder, case.at))
    answer = ask_engine(case, engine, *case.state, expected=expected, part=lambda x: x[0])
    if isinstance(answer, Finding) or isinstance(engine, type):
        yield answer
        return
    engine_value, terms, condition = answer
    scale = sensitivity_of(case.at, remainder, coordinates=True) + terms + in_speeds
    yield compare_with_engine(
        case,
        engine,
        f"kane ~ {engine.key}",
        expected(),
        engine_value,
        condition * scale,
        lambda answers: answers.kane_inertia_remainder(*case.state)[0],
        scale=scale,
        names=(speed_names(case.at),),
    )


# ---- Chains --------------------------------------------------------------------------------------


def _is_chain(at: Quantities) -> bool:
    """Return whether the scene declares a chain."""
    return hasattr(at.scene, "chain")


def _has_joints(at: Quantities) -> bool:
    """Return whether the scene is a chain with at least one joint between bodies."""
    return _is_chain(at) and len(at.chain.before) > 0


# ---- Bodies --------------------------------------------------------------------------------------


@claim(
    "chain-velocity",
    "q̇ of x, x of q̇",
    "(2), (28)",
    "velocity of a chain",
    needs="a chain of links (`Scene.chain`)",
)
def chain_velocity(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The quasi-velocities of a consistent velocity determine it: the maps are inverse."""
    if _is_chain(at):
        v = at.call(at.scene.chain_velocity, at.parameters, at.prepared, at.q, at.x)
        yield vanishing("q̇", v - at.v, (at.scene.coordinate_names,), product_size(at.v))


@claim(
    "chain-energy",
    "xᵀ D x = 2 T",
    "(25)",
    "mass of a chain",
    needs="a chain of links (`Scene.chain`)",
)
def chain_energy(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The mass matrix is diagonal in the quasi-velocities of a consistent velocity."""
    if _is_chain(at):
        T, _ = at.call(at.scene.energies, at.parameters, at.prepared, at.q, at.v)
        yield Comparison("D", (at.chain.mass * at.x * at.x).sum(), 2 * T, ())


@claim(
    "chain-forces",
    "fᵀ ∂x/∂q̇ = Q",
    "(26)-(27), (D2)",
    "forces of a chain",
    needs="a chain of links (`Scene.chain`)",
)
def chain_forces(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Active forces of the chain do the same work as Q on any virtual displacement."""
    f, Q = (at.chain.force, at.terms.Q) if _is_chain(at) else (None, None)
    if f is None and Q is None:
        return

    def work(direction: Array) -> tuple[Any, Any]:
        # Quasi-velocities of an arbitrary velocity, by the Python function.
        x = at.scene.quasi_velocities(at.parameters, at.prepared, at.q, direction)
        return 0 if f is None else f @ x, 0 if Q is None else direction @ Q

    yield from along_directions(context, "f", work)


# ---- Joints --------------------------------------------------------------------------------------


def _joint_names(count: int) -> Names:
    """Return the names of joints and of the two equations of each."""
    return numbered("joint ", count), ("first equation", "second equation")


def _size_in_joints(at: Quantities) -> float:
    """Return the largest |A_k| |x_{k-1}| + |C_k| |x_k|."""
    x = at.x.reshape(-1, 2, 1)
    terms = magnitude(at.chain.before, x[:-1]) + magnitude(at.chain.after, x[1:])
    return largest(terms)


@claim(
    "chain-coupling",
    "A_k x_{k-1} + C_k x_k = 0",
    "(2), (28)",
    "coupling of a chain",
    needs="a chain of links (`Scene.chain`)",
)
def chain_coupling(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """Quasi-velocities of a consistent velocity satisfy the joint equations."""
    if _has_joints(at):
        gaps = joint_gaps(at.chain.before, at.chain.after, at.x)
        yield vanishing("A, C", gaps, _joint_names(len(gaps)), _size_in_joints(at))


@claim(
    "chain-remainder",
    "d_k = Ȧ_k x_{k-1} + Ċ_k x_k",
    "(3), (28)",
    "remainder of a chain",
    rate_of="d",
    needs="a chain of links (`Scene.chain`)",
)
def chain_remainder(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The drift d of the joint equations is the rate of the coupling at constant x."""
    if not _has_joints(at):
        return
    x, drift = as_objects(at.x), at.chain.rest
    turning = at.scene.chain(as_objects(at.parameters), *at.prepared_duals(at.v), x)
    gaps = joint_gaps(turning.before, turning.after, x)
    terms = product_size(drift) + _size_in_joints(at) * product_size(at.v)
    yield vanishing("d", drift - rate(gaps), _joint_names(len(drift)), terms)


# ---- Accelerations -------------------------------------------------------------------------------


@claim(
    "chain-acceleration",
    "q̈ of ẋ, ẋ of q̈",
    "(3), (28)",
    "acceleration of a chain",
    rate_of="q̈",
    needs="a chain of links (`Scene.chain`)",
)
def chain_acceleration(at: Quantities, context: EvaluationContext) -> Iterator[Comparison]:
    """The rates of the quasi-velocities determine the acceleration: the maps are inverse."""
    if not _is_chain(at):
        return
    if context.exact:
        vdot, allowed = at.speeds.W @ context.free.v[: at.scene.p] + at.speeds.rest, True
    else:
        vdot, allowed = _allowed_acceleration(at)
    arguments = as_objects(at.parameters), *at.prepared_duals(at.v), duals(at.v, vdot)
    xdot = rate(at.scene.quasi_velocities(*arguments))
    xdot = xdot if context.exact else as_float64(xdot)
    back = at.call(at.scene.chain_acceleration, at.parameters, at.prepared, at.x, xdot)
    # For a long link ẋ is larger than q̈, and has the larger rounding error.
    terms = product_size(vdot) + product_size(xdot) + product_size(at.v) * (1 + product_size(at.v))
    names = (at.scene.coordinate_names,)
    yield vanishing("q̈", back - vdot, names, terms, sensitivity_where(allowed))


def _allowed_acceleration(e: Quantities) -> tuple[Array, Any]:
    """Return the smallest v̇ (n,) by the differentiated constraints, and whether it satisfies them.

    Dependent constraints may have no solution: with v only nearly consistent, gamma need not be
    compatible with dependent rows of a.
    """
    a, gamma = e.terms.a, e.terms.gamma
    if a is None:
        return np.zeros(e.scene.n), True
    vdot = least_squares(a, -gamma)
    residual = a @ vdot + gamma
    if batch_size(residual) or np.isfinite(residual).all():
        # One refinement: its rounding error is that of its largest entry, which a long link
        # multiplies.
        vdot = vdot - least_squares(a, residual)
    terms = np.abs(a) @ np.abs(vdot) + np.abs(gamma)
    return vdot, everywhere(np.abs(a @ vdot + gamma) <= allowed_error(1.0) * terms)
