"""Lagrange's terms of the Jacobians: over what moves each body, and nothing else."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.absent import NOTHING, total
from eomcheck.mechanics.described.motion import centers, columns, spins
from eomcheck.mechanics.described.pose import Prepared, placed
from eomcheck.mechanics.described.topology import Plan
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.contract import Angles
from eomcheck.numbers.counting import Counting
from eomcheck.numbers.generic import generic


class Touched(NamedTuple):
    """Which entries of the Jacobians of a body are there."""

    coordinates: tuple[int, ...]
    linear: tuple[tuple[int, ...], ...]
    """Components of V, coordinate by coordinate."""
    angular: tuple[tuple[int, ...], ...]
    """Components of ω."""


def touched(plan: Plan) -> tuple[Touched, ...]:
    """Return which entries of the Jacobians are there, body by body, rotors not among them."""
    # Which they are does not depend on numbers: any will do.
    slots, number = len(plan.slots), Counting().vector(1)[0]

    def numbers(*shape: int) -> Any:
        return np.full((slots, *shape), number, object)

    parameters = _Numbers(numbers(), numbers(plan.d), numbers(3, 3), numbers(plan.d))
    prepared = Prepared(numbers(), Angles(numbers(), numbers(), numbers()), None)
    frames = placed(plan, parameters, prepared)
    turning, found = spins(plan, parameters, prepared), []
    for k, (_, at) in zip(plan.carriers, centers(plan, parameters, frames), strict=True):
        V = columns(plan, frames, k, at)
        here = tuple(sorted(V))
        linear = tuple(_there(V[i]) for i in here)
        first = 3 - plan.e
        angular = (_there(turning[k].get(i, NOTHING)[first:]) for i in here)
        found.append(Touched(here, linear, tuple(angular)))
    return tuple(found)


class _Numbers(NamedTuple):
    ratio: Any
    offset: Any
    rotation: Any
    center: Any


def _there(a: tuple[Any, ...]) -> tuple[int, ...]:
    return tuple(i for i, x in enumerate(a) if x is not None)


def assemble_of(plan: Plan, forces: Any, constraints: Any, drift: Any) -> Any:
    """Return the function `assemble` of a scene."""

    entries = touched(plan)

    def assemble(parameters, prepared, q, v, bodies):
        M, B = inertia_terms(plan, entries, parameters.mass, parameters.inertia, *bodies)
        a, b = constraints(parameters, prepared, q)
        Q = forces(parameters, prepared, q, v)
        return Terms(M, Q, B, a, drift(parameters, prepared, q, v), b)

    return assemble


@generic
def inertia_terms(
    plan, touched, mass, inertia, linear, angular, linear_rest, angular_rest, gyroscopic
):
    """Return (M (n, n), B (n,)) of the inertia forces, over what moves each body and no more."""
    n, d, e = plan.n, range(plan.d), range(plan.e)
    M, B = np.zeros((n, n), linear.dtype), np.zeros(n, linear.dtype)
    for k, (here, V, omega) in enumerate(touched):
        force = [mass[k] * linear_rest[k, c] for c in d]
        moment = [total(inertia[k, c, f] * angular_rest[k, f] for f in e) for c in e]
        if gyroscopic is not None:
            moment = [moment[c] + gyroscopic[k, c] for c in e]
        for place, i in enumerate(here):
            # The momenta that v_i gives the body, and what they do along each v_j.
            P = {c: mass[k] * linear[k, c, i] for c in V[place]}
            L = [total(inertia[k, c, f] * angular[k, f, i] for f in omega[place]) for c in e]
            B[i] = total(
                [
                    B[i],
                    *(linear[k, c, i] * force[c] for c in V[place]),
                    *(angular[k, c, i] * moment[c] for c in omega[place]),
                ]
            )
            for other, j in enumerate(here[: place + 1]):
                shares = [P[c] * linear[k, c, j] for c in V[other] if c in P]
                if omega[place]:
                    shares += [L[c] * angular[k, c, j] for c in omega[other]]
                if shares:
                    M[i, j] = total([M[i, j], *shares])
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        i, last = plan.slots[k].coordinate, plan.e - 1
        M[i, i] += inertia[b, last, last] * angular[b, last, i] * angular[b, last, i]
    for i in range(n):
        for j in range(i):
            M[j, i] = M[i, j]
    return M, B
