"""Claims about the kinetic energy: a second derivation of M and of the bias."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.numbers.contract import Array
from eomcheck.testing.derived import bias_of_energy, inertia_rate, second_differences
from eomcheck.testing.measured import Measured, exact
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
    """T = ½ vᵀ M v and what is not quadratic in v: M entry by entry."""

    def say(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        more = found - expected
        if np.abs(more - np.diag(np.diagonal(more))).max(initial=0.0) <= allowed:
            extra = np.diagonal(np.where(np.abs(more) <= allowed, 0.0, more))
            size = "too small" if (extra <= 0.0).all() else "too large"
            least = size == "too small"
            said = ", ".join(f"{abs(x) if least else x + 0.0:.6g}" for x in extra)
            armature = ": armature?" if (extra >= 0.0).all() else ""
            return f"on the diagonal {said} {size}, nothing elsewhere{armature}"
        return proportional(found, expected, allowed, worst)

    yield Sides("M ~ ∂²T/∂v²", at.of("M"), second_differences(at), (rows(at), rows(at)), say)


@claim(
    "bias-of-energy",
    "B = ∂²T/∂v∂q v - ∂T/∂q",
    "bias",
    ("T", "bias"),
    without=("qdot",),
)
def check_bias_of_energy(at: Point) -> Iterator[Sides]:
    """B follows from T alone by Lagrange's equations, also where T has linear terms."""
    expected = bias_of_energy(at)
    assert expected is not None
    yield Sides("bias ~ T", at.B(), expected, (rows(at),), proportional)


def kinetic_rate(at: Point, qdd: Measured) -> Measured:
    """Return Ṫ along q̈, of T or else of ½ vᵀ M v."""
    v = exact(at.v)
    if at.has("T"):
        T = at.raw("T")
        return at.rate_of(T) + at.by_v(T) @ qdd
    return 0.5 * (v @ (inertia_rate(at) @ v)) + v @ (at.of("M") @ qdd)
