"""Claims about a `Chain`: its numbers against the constraints, the energies and the forces.

Each claim comes twice, on doubles and as an identity to prove.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.claims.claim import Case, claim, numbered
from eomcheck.claims.finding import Finding
from eomcheck.claims.point import Point
from eomcheck.claims.rational import Formulations, Sides, Skipped, identity
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations.banded import joint_gaps
from eomcheck.mechanics.records import Chain
from eomcheck.numbers.contract import Array
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.entries import objects


def joined(chain: Chain, x: Array) -> Array:
    """Return A_k x_{k-1} + C_k x_k (n_b-1, 2)."""
    return joint_gaps(chain.before, chain.after, x)


def _is_chain(e: Quantities) -> bool:
    return hasattr(e.scene, "chain")


def _has_joints(e: Quantities) -> bool:
    return _is_chain(e) and len(e.chain.before) > 0


def _has_forces(e: Quantities) -> bool:
    return _is_chain(e) and (e.terms.Q is not None or e.chain.force is not None)


def _size(e: Evaluation) -> float:
    """Return the largest sum of magnitudes in `joined`."""
    sizes = e.chain._replace(before=np.abs(e.chain.before), after=np.abs(e.chain.after))
    return largest(joined(sizes, np.abs(e.x)))


def _joint_names(count: int) -> tuple[tuple[str, ...], ...]:
    return numbered("joint ", count), ("first equation", "second equation")


def _x(e: Quantities, prepared: Any, q: Array, v: Array) -> Array:
    """Return the quasi-velocities elsewhere, by the Python function."""
    return e.scene.quasi_velocities(e.parameters, prepared, q, v)


# ---- Bodies --------------------------------------------------------------------------------------


@claim("chain-velocity", "q̇ of x, x of q̇", "(2), (28)", "velocity of a chain")
def chain_velocity(case: Case) -> Iterator[Finding]:
    """The quasi-velocities of a consistent velocity give it back."""
    at = case.at
    if not _is_chain(at):
        return

    def left(e: Evaluation) -> Array:
        return e.call(e.scene.chain_velocity, e.parameters, e.prepared, e.q, e.x) - e.v

    yield case.vanishes("q̇", left, largest(at.v), (at.scene.coordinate_names,))


@identity("chain-velocity", _is_chain)
def exact_velocity(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The quasi-velocities of a consistent velocity give it back."""
    found = at.scene.chain_velocity(at.parameters, at.prepared, at.q, at.x)
    yield Sides("q̇", found, at.v, (at.scene.coordinate_names,))


def _energy(e: Quantities) -> Any:
    return (e.chain.mass * e.x * e.x).sum()


@claim("chain-energy", "xᵀ D x = 2 T", "(25)", "mass of a chain")
def chain_energy(case: Case) -> Iterator[Finding]:
    """The mass is diagonal in the quasi-velocities of a consistent velocity."""
    at = case.at
    if not _is_chain(at):
        return

    def direct(e: Evaluation) -> Array:
        return 2 * e.call(e.scene.energies, e.parameters, e.prepared, e.q, e.v)[0]

    spread = at.spread(_energy) + at.spread(direct)
    yield case.compare("D", np.asarray(_energy(at)), np.asarray(direct(at)), spread)


@identity("chain-energy", _is_chain)
def exact_energy(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The mass is diagonal in the quasi-velocities of a consistent velocity."""
    T, _ = at.scene.energies(at.parameters, at.prepared, at.q, at.v)
    yield Sides("D", _energy(at), 2 * T, ())


def _work(e: Quantities, direction: Array) -> Any:
    """Return fᵀ x of the quasi-velocities x of any velocity."""
    if e.chain.force is None:
        return 0
    return e.chain.force @ _x(e, e.prepared, e.q, direction)


@claim("chain-forces", "fᵀ ∂x/∂q̇ = Q", "(26)-(27), (D2)", "forces of a chain")
def chain_forces(case: Case) -> Iterator[Finding]:
    """The active forces along the chain do the work that Q does, on every coordinate."""
    at = case.at
    if not _has_forces(at):
        return

    def along_axes(e: Evaluation) -> Array:
        return np.array([_work(e, axis) for axis in np.eye(e.scene.n)])

    Q = np.zeros(at.scene.n) if at.terms.Q is None else at.terms.Q
    spread = at.spread(along_axes) + at.spread(lambda e: e.terms.Q)
    yield case.compare("f", along_axes(at), Q, spread)


@identity("chain-forces", _has_forces)
def exact_forces(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The active forces along the chain do the work that Q does, on any virtual displacement."""
    found = [_work(at, direction) for direction in at.directions]
    expected = [0 if at.terms.Q is None else direction @ at.terms.Q for direction in at.directions]
    yield Sides("f", np.array(found, object), np.array(expected, object), (at.direction_names,))


# ---- Joints --------------------------------------------------------------------------------------


@claim("chain-coupling", "A_k x_{k-1} + C_k x_k = 0", "(2), (28)", "coupling of a chain")
def chain_coupling(case: Case) -> Iterator[Finding]:
    """Quasi-velocities of a consistent velocity keep the joints together."""
    if _has_joints(case.at):
        names = _joint_names(len(case.at.chain.before))
        yield case.vanishes("A, C", lambda e: joined(e.chain, e.x), _size(case.at), names)


@identity("chain-coupling", _has_joints)
def exact_coupling(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """Quasi-velocities of a consistent velocity keep the joints together."""
    found = joined(at.chain, at.x)
    yield Sides("A, C", found, np.zeros(found.shape, object), _joint_names(len(found)))


@claim("chain-remainder", "d_k = Ȧ_k x_{k-1} + Ċ_k x_k", "(3), (28)", "remainder of a chain")
def chain_remainder(case: Case) -> Iterator[Finding]:
    """What the joints leave at ẋ = 0 is the rate of the coupling at constant x."""
    at = case.at
    if not _has_joints(at):
        return

    def left(e: Evaluation) -> Array:
        x = objects(e.x)
        turning = e.scene.chain(objects(e.parameters), *e.moving(e.v), x)
        return np.asarray(e.chain.rest - rate(joined(turning, x)), np.float64)

    size = largest(at.chain.rest) + _size(at) * largest(at.v)
    yield case.vanishes("d", left, size, _joint_names(len(at.chain.rest)))


@identity("chain-remainder", _has_joints, rate_of="d")
def exact_remainder(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """What the joints leave at ẋ = 0 is the rate of the coupling at constant x."""
    turning = at.scene.chain(at.parameters, *at.moving(at.v), at.x)
    expected = rate(joined(turning, at.x))
    yield Sides("d", at.chain.rest, expected, _joint_names(len(at.chain.rest)))


# ---- Accelerations -------------------------------------------------------------------------------


@claim("chain-acceleration", "q̈ of ẋ, ẋ of q̈", "(3), (28)", "acceleration of a chain")
def chain_acceleration(case: Case) -> Iterator[Finding]:
    """The rates of the quasi-velocities give the acceleration back that they were found from."""
    at = case.at
    if not _is_chain(at):
        return

    def left(e: Evaluation) -> Array:
        vdot = _allowed_acceleration(e)
        here = objects(e.parameters), *e.moving(e.v), duals(e.v, vdot)
        xdot = np.asarray(rate(e.scene.quasi_velocities(*here)), np.float64)
        return e.call(e.scene.chain_acceleration, e.parameters, e.prepared, e.x, xdot) - vdot

    vdot = _allowed_acceleration(at)
    size = largest(vdot) + largest(at.v) * (1 + largest(at.v))
    names = (at.scene.coordinate_names,)
    zero = np.zeros(at.scene.n)
    spread = at.spread(left) + size if _can_accelerate(at, vdot) else np.inf
    yield case.compare("q̈", left(at), zero, spread, scale=size, names=names)


def _can_accelerate(e: Evaluation, vdot: Array) -> bool:
    """Return whether v̇ satisfies the constraints differentiated, which dependent ones may forbid.

    With v only nearly consistent, gamma is not what dependent rows of a ask for.
    """
    if e.terms.a is None:
        return True
    size = np.abs(e.terms.a) @ np.abs(vdot) + np.abs(e.terms.gamma)
    return bool((np.abs(e.terms.a @ vdot + e.terms.gamma) <= allowed_error(1.0) * size).all())


def _allowed_acceleration(e: Evaluation) -> Array:
    """Return the smallest v̇ (n,) that satisfies the constraints differentiated."""
    if e.terms.a is None:
        return np.zeros(e.scene.n)
    vdot = np.linalg.lstsq(e.terms.a, -e.terms.gamma, rcond=None)[0]
    residual = e.terms.a @ vdot + e.terms.gamma
    if not np.isfinite(residual).all():
        return vdot
    # Its rounding is that of its largest entry, which is much where a long link multiplies it.
    return vdot - np.linalg.lstsq(e.terms.a, residual, rcond=None)[0]


@identity("chain-acceleration", _is_chain, rate_of="q̈")
def exact_acceleration(at: Point, _: Formulations) -> Iterator[Sides | Skipped]:
    """The rates of the quasi-velocities give the acceleration back that they were found from."""
    vdot = at.speeds.W @ at.free.v[: at.scene.p] + at.speeds.rest
    xdot = rate(_x(at, *at.moving(at.v), duals(at.v, vdot)))
    found = at.scene.chain_acceleration(at.parameters, at.prepared, at.x, xdot)
    yield Sides("q̈", found, vdot, (at.scene.coordinate_names,))
