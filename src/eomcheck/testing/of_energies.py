"""Claims about the kinetic energy: a second derivation of M and of the bias."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.numbers.contract import Array
from eomcheck.testing.measured import Measured, contract, exact
from eomcheck.testing.of_terms import proportional, rows
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, claim


@claim("energy-quadratic", "T is at most quadratic in v", "kinetic energy", ("T",))
def energy_quadratic(at: Point) -> Iterator[Sides]:
    """T(3v) - 3 T(2v) + 3 T(v) - T(0) = 0."""
    T = [at.moved(k * at.v).of("T") for k in range(4)]
    yield Sides("T", T[3] + 3.0 * T[1], 3.0 * T[2] + T[0], ())


@claim(
    "kinetic-energy",
    "M = ∂²T/∂v²",
    "mass matrix",
    ("M", "T"),
    blind=(Blind("M", "a constant added to M", ("T", "qdd", "against")),),
)
def kinetic_energy(at: Point) -> Iterator[Sides]:
    """T = ½ vᵀ M v and what is not quadratic in v: M entry by entry.

    T is quadratic, so its second differences have no error but rounding, however long the steps.
    """

    def say(found: Array, expected: Array, allowed: float) -> str:
        more = found - expected
        if np.abs(more - np.diag(np.diagonal(more))).max(initial=0.0) <= allowed:
            extra = np.diagonal(np.where(np.abs(more) <= allowed, 0.0, more))
            said = ", ".join(f"{x:.6g}" for x in extra)
            return f"on the diagonal {said} too large, nothing elsewhere: armature?"
        return proportional(found, expected, allowed)

    yield Sides("M ~ ∂²T/∂v²", at.of("M"), second_differences(at), (rows(at), rows(at)), say)


def second_differences(at: Point) -> Measured:
    """Return ∂²T/∂v² (p, p)."""
    p, widths, T = len(at.v), at.width_v, at.raw("T")

    def second(q: Array, v: Array) -> Array:
        steps = np.diag(widths)
        rest = float(T(q, 0.0 * v))
        alone = [(float(T(q, s)) - rest, float(T(q, -s)) - rest) for s in steps]
        found = np.empty((p, p))
        for i in range(p):
            found[i, i] = sum(alone[i])
            for k in range(i):
                both = float(T(q, steps[i] + steps[k])) - rest
                found[i, k] = found[k, i] = both - alone[i][0] - alone[k][0]
        return found / np.outer(widths, widths)

    return at.kept("∂²T/∂v²", lambda: at.measure(second))


def inertia_of(at: Point) -> Measured:
    """Return M (p, p), as given or as T says."""
    return at.of("M") if at.has("M") else second_differences(at)


@claim(
    "bias-of-energy",
    "B = ∂²T/∂v∂q v - ∂T/∂q",
    "bias",
    ("T", "bias"),
    without=("qdot",),
)
def bias_of_energy(at: Point) -> Iterator[Sides]:
    """B follows from T alone by Lagrange's equations, also where T has linear terms."""
    T, widths = at.raw("T"), at.width_v
    steps = np.diag(widths)

    def momentum(q: Array, v: Array) -> Array:
        # Exact but for rounding: T is quadratic in v.
        ahead = np.array([float(T(q, v + step)) for step in steps])
        behind = np.array([float(T(q, v - step)) for step in steps])
        return (ahead - behind) / (2.0 * widths)

    rate = contract("kp,k->p", at.by_q(momentum), exact(at.v))
    yield Sides("bias ~ T", at.B(), rate - at.by_q(T), (rows(at),), proportional)


def kinetic_rate(at: Point, qdd: Measured) -> Measured:
    """Return Ṫ along q̈, of T or else of ½ vᵀ M v."""
    v = exact(at.v)
    if at.has("T"):
        T = at.raw("T")
        return at.along(at.by_q(T)) + at.by_v(T) @ qdd
    rate = at.along(at.dM())
    return 0.5 * (v @ (rate @ v)) + v @ (at.of("M") @ qdd)
