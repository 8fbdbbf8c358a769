"""Quantities that follow from other functions: M from T, bias from C, M or T, drift from a.

A claim that needs one of them is checked whether it was given or follows. What cannot be derived
is None, with the reason in `why_no_bias`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.derivative import partial
from eomcheck.testing.measured import Measured, contract, exact
from eomcheck.testing.point import NOT_QUADRATIC, Point

BUILT_IN = "constraints may be built into M, which then does not tell B"
CLOCK = 0.25
"""Half width of the times, s, in which ḃ is differentiated."""


# ---- Mass matrix ---------------------------------------------------------------------------------


def of_matrix(at: Point) -> bool:
    """Whether M tells the inertia: it is given, and T is not or M answers here."""
    return at.has("M") and (not at.has("T") or at.answering("M"))


def inertia(at: Point) -> Measured:
    """Mass matrix (p, p): M if it is given and answers, else ∂²T/∂v²."""
    return at.of("M") if of_matrix(at) else second_differences(at)


def inertia_rate(at: Point) -> Measured:
    """Rate Ṁ (p, p) while q moves along v, of M or else of ∂²T/∂v²."""
    if of_matrix(at):
        return at.along(at.dM())
    return at.kept("Ṁ of T", lambda: at.rate_of(_second_of(at)))


def second_differences(at: Point) -> Measured:
    """∂²T/∂v² (p, p): T is quadratic, so that steps may be as long as the ranges."""

    def second() -> Measured:
        value, size = differences(at.raw("T"), at.q, at.width_v)
        scale, here = np.outer(at.width_v, at.width_v), at.of("T")
        # Each entry is a sum of four, as noisy for their sizes as T is here.
        noisy = float(here.error / here.size) if here.size > 0.0 else EPS
        return Measured(value / scale, noisy * size / scale, size / scale)

    return at.kept("∂²T/∂v²", second)


def _second_of(at: Point) -> Callable[[Array, Array], Array]:
    """Function (q, v) -> ∂²T/∂v² (p, p)."""
    T, scale = at.raw("T"), np.outer(at.width_v, at.width_v)
    return lambda q, v: differences(T, q, at.width_v)[0] / scale


def differences(f: Callable[[Array, Array], Array], q: Array, widths: Array) -> tuple[Array, Array]:
    """Second differences (p, p) of f(q, v) in steps of `widths`, and sizes of their terms."""
    steps, p = np.diag(widths), len(widths)
    rest = float(f(q, np.zeros(p)))
    ahead = np.array([float(f(q, step)) for step in steps])
    behind = np.array([float(f(q, -step)) for step in steps])
    found, size = np.diag(ahead + behind - 2.0 * rest), np.zeros((p, p))
    sizes = np.maximum(np.abs(ahead), np.abs(behind))
    for i, k in zip(*np.tril_indices(p, -1), strict=True):
        both = float(f(q, steps[i] + steps[k]))
        found[i, k] = found[k, i] = both - ahead[i] - ahead[k] + rest
        size[i, k] = size[k, i] = max(np.max(sizes[[i, k]]), abs(both))
    np.fill_diagonal(size, sizes)
    return found, 4.0 * np.maximum(size, abs(rest))


# ---- Bias ----------------------------------------------------------------------------------------


def bias(at: Point) -> Measured | None:
    """Bias without gravity (p,): as given, else C v, else of M, else of T; None if none tells."""
    if at.has("bias"):
        return at.B()
    if at.has("C") and at.natural():
        return at.of("C") @ exact(at.v)
    return bias_of_inertia(at)


def bias_of_inertia(at: Point) -> Measured | None:
    """Bias (p,) of M or else of T; None where neither tells it."""
    if of_matrix(at) and at.natural():
        return bias_of_mass_matrix(at)
    return bias_of_energy(at) if at.has("T") and at.functions.of_lagrange else None


def why_no_bias(at: Point) -> str:
    """Reason why `bias` is None."""
    if not at.natural():
        return f"{NOT_QUADRATIC}: bias would tell B"
    if not at.functions.of_lagrange:
        return f"{BUILT_IN}: bias or C would, or holonomic=True if none are"
    return "M or T tells B only where there are as many speeds as coordinates: bias or C would"


def bias_of_mass_matrix(at: Point) -> Measured | None:
    """Bias (p,) of M by Lagrange's equations; None where M does not tell it.

    With generalized speeds u, q̇ = S u, the mass matrix of q̇ is S⁻ᵀ M S⁻¹, whose bias b gives
    B = Sᵀ (b + S⁻ᵀ M S⁻¹ Ṡ u).
    """
    if not at.functions.of_lagrange or len(at.q) != len(at.v):
        return None
    if at.functions.qdot is None:
        return _christoffel(at.dM(), exact(at.v))
    return at.kept("B of M", lambda: _bias_along_speeds(at))


def _christoffel(dM: Measured, v: Measured) -> Measured:
    """Bias (p,) of the derivatives ∂M_ij/∂q_k, [k, i, j] (p, p, p), and of v (p,)."""
    return contract("kij,j,k->i", dM, v, v) - 0.5 * contract("ijk,j,k->i", dM, v, v)


def bias_along(at: Point, v: Array) -> Measured:
    """Bias (p,) of M at another velocity v (p,), where velocities are q̇."""
    return _christoffel(at.dM(), exact(v))


def _bias_along_speeds(at: Point) -> Measured:
    """Bias (p,) of M where velocities are generalized speeds; see `bias_of_mass_matrix`."""
    mass, S = at.raw("M"), at.S()
    qdot = at.raw("qdot")

    def speeds(q: Array) -> Array:
        return np.array([qdot(q, axis) for axis in np.eye(len(at.v))]).T

    def of_rates(q: Array, v: Array) -> Array:
        back = np.linalg.inv(speeds(q))
        return back.T @ mass(q, v) @ back

    rates = at.rates()
    dM, M = at.by_q(of_rates), at.measure(of_rates)
    Su = at.along(at.by_q(lambda q, v: speeds(q) @ at.v))
    return S.T @ (_christoffel(dM, rates) + M @ Su)


def bias_of_energy(at: Point) -> Measured | None:
    """Bias (p,) of T by Lagrange's equations, also of terms linear in v; None with `qdot`."""
    if at.functions.qdot is not None:
        return None
    T, widths = at.raw("T"), at.width_v
    steps = np.diag(widths)

    def momentum(q: Array, v: Array) -> Array:
        # Exact but for rounding: T is quadratic in v.
        ahead = np.array([float(T(q, v + step)) for step in steps])
        behind = np.array([float(T(q, v - step)) for step in steps])
        return (ahead - behind) / (2.0 * widths)

    return at.kept("B of T", lambda: at.rate_of(momentum) - at.by_q(T))


# ---- Constraints ---------------------------------------------------------------------------------


def drift(at: Point) -> Measured:
    """Constraint drift γ (r,): as given, else ȧ v + ḃ."""
    return at.of("gamma") if at.has("gamma") else drift_of_jacobian(at)


def drift_of_jacobian(at: Point) -> Measured:
    """ȧ v + ḃ (r,), by finite differences of a and b."""

    def rate() -> Measured:
        expected = at.rate_of(at.raw("a")) @ exact(at.v)
        return expected + clock_rate(at) if at.has("b") else expected

    return at.kept("ȧ v + ḃ", rate)


def clock_rate(at: Point) -> Measured:
    """ḃ (r,) at t = 0 s."""
    here = at.of("b")

    def of_time(t: Array) -> Array:
        return at.answers("b", at.q, at.v, float(t[0]))

    rate = partial(of_time, np.zeros(1), 0, CLOCK, here.error, here.size, here.value)
    return rate + at.rate_of(at.raw("b")) if at.answers.reads("b") == "qt" else rate
