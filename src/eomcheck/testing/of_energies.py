"""Claims about the kinetic energy: a second derivation of M and of the bias."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eomcheck.numbers.contract import Array
from eomcheck.numbers.pivots import EPS
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


def second_differences(at: Point) -> Measured:
    """Return ∂²T/∂v² (p, p): T is quadratic, so that steps may be as long as the ranges."""
    p, widths, T = len(at.v), at.width_v, at.raw("T")

    def second() -> Measured:
        steps = np.diag(widths)
        rest = float(T(at.q, 0.0 * at.v))
        ahead = np.array([float(T(at.q, step)) for step in steps])
        behind = np.array([float(T(at.q, -step)) for step in steps])
        found, size = np.diag(ahead + behind - 2.0 * rest), np.maximum.outer(ahead, ahead)
        for i, k in zip(*np.tril_indices(p, -1), strict=True):
            both = float(T(at.q, steps[i] + steps[k]))
            found[i, k] = found[k, i] = both - ahead[i] - ahead[k] + rest
            size[i, k] = size[k, i] = max(size[i, k], abs(both))
        scale, here = np.outer(widths, widths), at.of("T")
        # Each entry is a sum of four, as noisy for their sizes as T is here.
        noisy = float(here.error / here.size) if here.size > 0.0 else EPS
        size = 4.0 * np.maximum(np.abs(size), abs(rest))
        return Measured(found / scale, noisy * size / scale, size / scale)

    return at.kept("∂²T/∂v²", second)


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

    expected = at.rate_of(momentum) - at.by_q(T)
    yield Sides("bias ~ T", at.B(), expected, (rows(at),), proportional)


def kinetic_rate(at: Point, qdd: Measured) -> Measured:
    """Return Ṫ along q̈, of T or else of ½ vᵀ M v."""
    v = exact(at.v)
    if at.has("T"):
        T = at.raw("T")
        return at.rate_of(T) + at.by_v(T) @ qdd
    rate = at.along(at.dM())
    return 0.5 * (v @ (rate @ v)) + v @ (at.of("M") @ qdd)
