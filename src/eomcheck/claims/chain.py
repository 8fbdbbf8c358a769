"""Claims about a `Chain`: its numbers against the constraints, the energies and the forces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from eomcheck.claims.registry import (
    Look,
    Names,
    Sides,
    along,
    claim,
    magnitude,
    measured_where,
    numbered,
    size,
    vanishing,
)
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations.banded import joint_gaps
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import Array, objects
from eomcheck.numbers.lanes import doubles, everywhere, lanes_in
from eomcheck.numbers.linear import least_squares


def _is_chain(at: Quantities) -> bool:
    return hasattr(at.scene, "chain")


def _has_joints(at: Quantities) -> bool:
    return _is_chain(at) and len(at.chain.before) > 0


# ---- Bodies --------------------------------------------------------------------------------------


@claim("chain-velocity", "q̇ of x, x of q̇", "(2), (28)", "velocity of a chain")
def chain_velocity(at: Quantities, look: Look) -> Iterator[Sides]:
    """The quasi-velocities of a consistent velocity give it back."""
    if _is_chain(at):
        v = at.call(at.scene.chain_velocity, at.parameters, at.prepared, at.q, at.x)
        yield vanishing("q̇", v - at.v, (at.scene.coordinate_names,), size(at.v))


@claim("chain-energy", "xᵀ D x = 2 T", "(25)", "mass of a chain")
def chain_energy(at: Quantities, look: Look) -> Iterator[Sides]:
    """The mass is diagonal in the quasi-velocities of a consistent velocity."""
    if _is_chain(at):
        T, _ = at.call(at.scene.energies, at.parameters, at.prepared, at.q, at.v)
        yield Sides("D", (at.chain.mass * at.x * at.x).sum(), 2 * T, ())


@claim("chain-forces", "fᵀ ∂x/∂q̇ = Q", "(26)-(27), (D2)", "forces of a chain")
def chain_forces(at: Quantities, look: Look) -> Iterator[Sides]:
    """The active forces along the chain do the work that Q does, on any virtual displacement."""
    f, Q = (at.chain.force, at.terms.Q) if _is_chain(at) else (None, None)
    if f is None and Q is None:
        return

    def work(direction: Array) -> tuple[Any, Any]:
        # Quasi-velocities of any velocity, by the Python function.
        x = at.scene.quasi_velocities(at.parameters, at.prepared, at.q, direction)
        return 0 if f is None else f @ x, 0 if Q is None else direction @ Q

    yield from along(look, "f", work)


# ---- Joints --------------------------------------------------------------------------------------


def _joint_names(count: int) -> Names:
    return numbered("joint ", count), ("first equation", "second equation")


def _size_in_joints(at: Quantities) -> float:
    """Return the largest |A_k| |x_{k-1}| + |C_k| |x_k|."""
    x = at.x.reshape(-1, 2, 1)
    terms = magnitude(at.chain.before, x[:-1]) + magnitude(at.chain.after, x[1:])
    return largest(terms)


@claim("chain-coupling", "A_k x_{k-1} + C_k x_k = 0", "(2), (28)", "coupling of a chain")
def chain_coupling(at: Quantities, look: Look) -> Iterator[Sides]:
    """Quasi-velocities of a consistent velocity hold the joints together."""
    if _has_joints(at):
        gaps = joint_gaps(at.chain.before, at.chain.after, at.x)
        yield vanishing("A, C", gaps, _joint_names(len(gaps)), _size_in_joints(at))


@claim(
    "chain-remainder",
    "d_k = Ȧ_k x_{k-1} + Ċ_k x_k",
    "(3), (28)",
    "remainder of a chain",
    rate_of="d",
)
def chain_remainder(at: Quantities, look: Look) -> Iterator[Sides]:
    """What the joints leave at ẋ = 0 is the rate of the coupling at constant x."""
    if not _has_joints(at):
        return
    x, rest = objects(at.x), at.chain.rest
    turning = at.scene.chain(objects(at.parameters), *at.moving(at.v), x)
    gaps = joint_gaps(turning.before, turning.after, x)
    terms = size(rest) + _size_in_joints(at) * size(at.v)
    yield vanishing("d", rest - rate(gaps), _joint_names(len(rest)), terms)


# ---- Accelerations -------------------------------------------------------------------------------


@claim("chain-acceleration", "q̈ of ẋ, ẋ of q̈", "(3), (28)", "acceleration of a chain", rate_of="q̈")
def chain_acceleration(at: Quantities, look: Look) -> Iterator[Sides]:
    """The rates of the quasi-velocities give the acceleration back that they were found from."""
    if not _is_chain(at):
        return
    if look.exact:
        vdot, allowed = at.speeds.W @ look.free.v[: at.scene.p] + at.speeds.rest, True
    else:
        vdot, allowed = _allowed_acceleration(at)
    here = objects(at.parameters), *at.moving(at.v), duals(at.v, vdot)
    xdot = rate(at.scene.quasi_velocities(*here))
    xdot = xdot if look.exact else doubles(xdot)
    found = at.call(at.scene.chain_acceleration, at.parameters, at.prepared, at.x, xdot)
    # Of a long link ẋ are the larger numbers, and round to more than q̈ does.
    terms = size(vdot) + size(xdot) + size(at.v) * (1 + size(at.v))
    names = (at.scene.coordinate_names,)
    yield vanishing("q̈", found - vdot, names, terms, measured_where(allowed))


def _allowed_acceleration(e: Quantities) -> tuple[Array, Any]:
    """Return the smallest v̇ (n,) that satisfies the constraints differentiated, and if it does.

    Dependent constraints may forbid it: with v only nearly consistent, gamma is not what dependent
    rows of a ask for.
    """
    a, gamma = e.terms.a, e.terms.gamma
    if a is None:
        return np.zeros(e.scene.n), True
    vdot = least_squares(a, -gamma)
    residual = a @ vdot + gamma
    if lanes_in(residual) or np.isfinite(residual).all():
        # Its rounding is that of its largest entry, which is much where a long link multiplies it.
        vdot = vdot - least_squares(a, residual)
    terms = np.abs(a) @ np.abs(vdot) + np.abs(gamma)
    return vdot, everywhere(np.abs(a @ vdot + gamma) <= allowed_error(1.0) * terms)
