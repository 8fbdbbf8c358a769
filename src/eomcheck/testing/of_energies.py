"""Claims about the kinetic energy: a second derivation of M and of the bias."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from eomcheck.evaluation.tolerance import INCONCLUSIVE, C
from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.derived import bias_of_energy, differences, inertia_rate, second_differences
from eomcheck.testing.measured import Measured, exact
from eomcheck.testing.of_terms import proportional, rows
from eomcheck.testing.point import REST_ENERGY, Point
from eomcheck.testing.registry import Blind, Sides, Skipped, Told, claim


@claim("energy-quadratic", "T is at most quadratic in v", "kinetic energy", ("T",))
def energy_quadratic(at: Point) -> Iterator[Sides | Skipped]:
    """T(3v) - 3 T(2v) + 3 T(v) - T(0) = 0; T(q, 0) may change with q where a clock drives."""
    T = [at.moved(k * at.v).of("T") for k in range(4)]
    yield Sides("T", T[3] + 3.0 * T[1], 3.0 * T[2] + T[0], ())
    tells = [name for name in ("bias", "qdd", "against") if at.has(name)]
    if not tells and at.rest_energy_changes():
        yield Skipped("T at rest", f"{REST_ENERGY} bias, qdd or against would tell")


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


@claim(
    "dissipation-positive",
    "R(q, v) + R(q, -v) ≥ 2 R(q, 0)",
    "dissipation function",
    ("R",),
    without=("b",),
    consistent=True,
)
def dissipation_positive(at: Point) -> Iterator[Told | Skipped]:
    """Dampers take energy, in both directions together: v·∂R/∂v of v and of -v is not negative.

    Asked along v, and along that velocity of which second differences of R are least. Terms odd in
    v, as of a damper against a belt that moves, drop out.
    """
    R, here, still = at.raw("R"), at.of("R"), np.zeros(len(at.v))
    least, size = _least_damped(at, R)
    noise = EPS + (float(here.error / here.size) if here.size > 0.0 else 0.0)
    rest = float(R(at.q, still))
    changes = np.array(
        [[float(R(at.q, sign * v)) - rest for sign in (1, -1)] for v in (at.v, least)]
    )
    if not np.isfinite(changes).all():
        yield Skipped("R", "R has no value at a velocity within the ranges")
        return
    allowed = C * noise * max(size, float(here.size), abs(rest))
    gains, change = changes.sum(axis=1), float(np.abs(changes).max())
    gain, v = float(gains.min()), (at.v, least)[int(gains.argmin())]
    if gain < -allowed:
        where = ", ".join(f"{x:.3g}" for x in v)
        feeds = f"feeds energy at v = [{where}], where R is {-gain / 2.0:.3g} W less than at rest"
        what = f"dissipation function, value: {feeds}: wrong sign? Active drives belong into Q"
        yield Told("R", -gain, allowed, "failed", what)
    elif change == 0.0 or allowed <= INCONCLUSIVE * change:
        yield Told("R", max(0.0, -gain), allowed, "passed")
    else:
        what = "R changes with v by no more than its own rounding"
        yield Told("R", max(0.0, -gain), allowed, "inconclusive", what)


def _least_damped(at: Point, R: Callable[[Array, Array], Array]) -> tuple[Array, float]:
    """Velocity (p,) in the ranges of which second differences of R are least, and their size.

    In the directions that constraints leave, where constraints are given.
    """
    free = at.free()
    with np.errstate(divide="ignore"):
        steps = free / np.abs(free / at.width_v[:, None]).max(axis=0)
    values, size = differences(lambda q, y: R(q, steps @ y), at.q, np.ones(steps.shape[1]))
    least = steps @ np.linalg.eigh(values)[1][:, 0]
    return least / np.abs(least / at.width_v).max(), len(values) * float(size.max())


def kinetic_rate(at: Point, qdd: Measured) -> Measured:
    """Return Ṫ along q̈, of T or else of ½ vᵀ M v."""
    v = exact(at.v)
    if at.has("T"):
        T = at.raw("T")
        return at.rate_of(T) + at.by_v(T) @ qdd
    return 0.5 * (v @ (inertia_rate(at) @ v)) + v @ (at.of("M") @ qdd)
