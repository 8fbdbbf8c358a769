"""The functions of a scene that hold its closures: a, b, gamma; and once more c and positions."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.mechanics.described import energies
from eomcheck.mechanics.described.absent import (
    NOTHING,
    Vector,
    added,
    centripetal,
    cross,
    dot,
    levelled,
    put,
    scaled,
    subtracted,
)
from eomcheck.mechanics.described.closures import KINDS, rows, rows_of
from eomcheck.mechanics.described.motion import (
    STILL,
    columns,
    moving,
    swung,
    turning_columns,
)
from eomcheck.mechanics.described.pose import GROUND, placed, point_of
from eomcheck.mechanics.described.rows import Moving, product
from eomcheck.mechanics.described.topology import Plan


class First:
    """Vectors by columns and rests; without v only where they are and their columns."""

    def __init__(self, plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.plan, self.q, self.v = plan, q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.frames = placed(plan, parameters, prepared)
        self.rates = None if v is None else moving(plan, parameters, self.frames, v)

    def point(self, k: int, a: Vector) -> Moving:
        """Return the point a of frame k."""
        arm, at = point_of(self.frames, k, a)
        found = columns(self.plan, self.frames, k, (arm, at))
        if self.rates is None or k < 0:
            return Moving(at, NOTHING, found, NOTHING)
        rest = added(self.rates[k].rest, swung(self.rates[k], arm))
        return Moving(at, self._rate(found), found, rest)

    def direction(self, k: int, a: Vector) -> Moving:
        """Return the direction a of frame k."""
        along = levelled((self.frames[k] if k >= 0 else GROUND).axes, a)
        turning = turning_columns(self.plan, self.frames, k)
        found = {i: cross(x, along) for i, x in turning.items()}
        rates = STILL if self.rates is None or k < 0 else self.rates[k]
        rest = added(cross(rates.alpha, along), centripetal(rates.omega, along))
        return Moving(along, cross(rates.omega, along), found, rest)

    def turning(self, k: int) -> Moving:
        """Return how frame k turns."""
        rates = STILL if self.rates is None or k < 0 else self.rates[k]
        found = turning_columns(self.plan, self.frames, k)
        return Moving(NOTHING, rates.omega, found, rates.alpha)

    def rim(self, axis: Moving, normal: Moving) -> tuple[Vector, Vector]:
        """Return (n·n) e - (e·n) n and its rate."""
        upright, square = product(axis, normal), dot(axis.value, axis.value)
        along = scaled(upright.position, axis.value)
        moved = added(scaled(upright.rate, axis.value), scaled(upright.position, axis.rate))
        spoke, rate = (scaled(square, x) for x in (normal.value, normal.rate))
        return subtracted(spoke, along), subtracted(rate, moved)

    def _rate(self, found: dict[int, Vector]) -> Vector:
        rate = NOTHING
        for i, one in found.items():
            rate = added(rate, tuple(None if x is None else x * self.v[i] for x in one))
        return rate


class Second:
    """Vectors by positions and velocities that are passed on; without v only where they are."""

    def __init__(self, plan: Plan, parameters: Any, prepared: Any, q: Any, v: Any = None):
        self.here, self.q, self.v = (plan, parameters, prepared), q, v
        self.driven, self.sines = prepared.driven, prepared.sines
        self.rates = None if v is None else energies.passed_on(plan, parameters, prepared, v)

    def point(self, k: int, a: Vector) -> Moving:
        """Return the point a of frame k."""
        rate = NOTHING if self.rates is None else energies.moved_point(self.rates, k, a)
        at, moved = energies.place(*self.here, k, a), energies.level(*self.here, k, rate)
        return Moving(at, moved, {}, NOTHING)

    def direction(self, k: int, a: Vector) -> Moving:
        """Return the direction a of frame k."""
        omega = NOTHING if self.rates is None or k < 0 else self.rates[k][1]
        along, rate = (energies.level(*self.here, k, x) for x in (a, cross(omega, a)))
        return Moving(along, rate, {}, NOTHING)

    def turning(self, k: int) -> Moving:
        """Return how frame k turns."""
        omega = NOTHING if self.rates is None or k < 0 else self.rates[k][1]
        return Moving(NOTHING, energies.level(*self.here, k, omega), {}, NOTHING)

    def rim(self, axis: Moving, normal: Moving) -> tuple[Vector, Vector]:
        """Return n × (e × n)."""
        return cross(axis.value, cross(normal.value, axis.value)), NOTHING


def holonomic_rows(plan: Plan) -> list[int]:
    """Return which rows are rates of positions."""
    planar, closures = plan.topology.planar, plan.topology.closures
    each = [KINDS[one.kind].holonomic for one in closures for _ in range(rows_of(one, planar))]
    return [i for i, one in enumerate(each) if one]


def constraints_of(plan: Plan) -> dict[str, Any]:
    """Return the functions of a scene that are about its closures."""
    closures = plan.topology.closures
    if not closures:
        return {}
    planar = plan.topology.planar
    r = sum(rows_of(one, planar) for one in closures)
    held = holonomic_rows(plan)
    driven = any(one.kind == "drive" for one in closures)

    def constraints(parameters, prepared, q):
        a, b = np.zeros((r, plan.n), q.dtype), np.zeros(r, q.dtype)
        for i, row in enumerate(rows(plan, parameters, First(plan, parameters, prepared, q))):
            for j, x in row.columns.items():
                put(a, (i, j), x)
            put(b, i, row.b)
        return a, b if driven else None

    def drift(parameters, prepared, q, v):
        gamma = np.zeros(r, v.dtype)
        found = rows(plan, parameters, First(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(gamma, i, row.rest)
        return gamma

    def constraint(parameters, prepared, q, v):
        c = np.zeros(r, v.dtype)
        found = rows(plan, parameters, Second(plan, parameters, prepared, q, v))
        for i, row in enumerate(found):
            put(c, i, row.rate)
        return c

    def position_residual(parameters, prepared, q):
        residual = np.zeros(len(held), q.dtype)
        found = rows(plan, parameters, Second(plan, parameters, prepared, q))
        for i, k in enumerate(held):
            put(residual, i, found[k].position)
        return residual

    found = {"constraints": constraints, "drift": drift, "constraint": constraint}
    return found | ({"position_residual": position_residual} if held else {})
