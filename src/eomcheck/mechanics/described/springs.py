"""Springs and dampers between two points: what they pull, and what they store and take."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from eomcheck.mechanics.described.absent import dot, subtracted, vector
from eomcheck.mechanics.described.constraints import First, Second
from eomcheck.mechanics.described.energies import place
from eomcheck.mechanics.described.rows import Moving, between
from eomcheck.mechanics.described.topology import Plan


def with_lengths(plan: Plan, prepare: Callable) -> Callable:
    """Return a function that prepares the lengths of springs too."""
    if not plan.topology.springs:
        return prepare

    def prepare_all(arithmetic, parameters, q, t):
        prepared = prepare(arithmetic, parameters, q, t)
        square = np.zeros(len(plan.topology.springs), q.dtype)
        for i, spring in enumerate(plan.topology.springs):
            a, b = (
                place(plan, parameters, prepared, k, vector(parameters.points[j]))
                for k, j in spring.points
            )
            apart = subtracted(a, b)
            square[i] = dot(apart, apart)
        return prepared._replace(lengths=arithmetic.root(square))

    return prepare_all


def _each(plan: Plan, parameters: Any, at: Any) -> Iterator[tuple[int, Any, Moving]]:
    """Yield the place of each spring, what it is, and how its ends are apart."""
    for i, spring in enumerate(plan.topology.springs):
        a, b = (at.point(k, vector(parameters.points[j])) for k, j in spring.points)
        yield i, parameters.springs[spring.number], between(a, b)


def pull(plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any, Q: Any) -> None:
    """Add what springs and dampers pull to Q (n,)."""
    if not plan.topology.springs:
        return
    at = First(plan, parameters, prepared, q)
    for i, spring, apart in _each(plan, parameters, at):
        # Their products with the distance are columns of its length, times the length.
        length = prepared.lengths[i]
        along = {j: dot(apart.value, x) for j, x in apart.columns.items()}
        along = {j: x for j, x in along.items() if x is not None}
        force = spring.stiffness * (length - spring.length)
        if spring.damping is not None:
            force = force + spring.damping * (sum(x * v[j] for j, x in along.items()) / length)
        share = force / length
        for j, x in along.items():
            Q[j] -= share * x


def stored(plan: Plan, parameters: Any, prepared: Any) -> Any:
    """Return the energy of springs, J; None without any."""
    U = None
    for i, spring in enumerate(plan.topology.springs):
        given = parameters.springs[spring.number]
        longer = prepared.lengths[i] - given.length
        one = given.stiffness * longer * longer / 2
        U = one if U is None else U + one
    return U


def taken(plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any) -> Any:
    """Return half the power that the dampers of springs take, W; None without any."""
    R = None
    for i, spring, apart in _each(plan, parameters, Second(plan, parameters, prepared, q, v)):
        if spring.damping is not None:
            rate = dot(apart.value, apart.rate) / prepared.lengths[i]
            one = spring.damping * rate * rate / 2
            R = one if R is None else R + one
    return R
