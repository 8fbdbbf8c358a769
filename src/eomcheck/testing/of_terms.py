"""Claims about single terms, and about M, B, C and gravity belonging together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from eomcheck.claims.finding import EVERY_ROW
from eomcheck.evaluation.tolerance import C, allowed_error
from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS
from eomcheck.testing.answers import BrokenError
from eomcheck.testing.derived import (
    BUILT_IN,
    bias_of_inertia,
    bias_of_mass_matrix,
    inertia_rate,
    of_matrix,
    why_no_bias,
)
from eomcheck.testing.measured import Measured, exact, zero
from eomcheck.testing.point import Point
from eomcheck.testing.registry import Blind, Sides, Skipped, Told, claim

UNKNOWN = f"{BUILT_IN}: if none are, say holonomic=True"


def rows(at: Point) -> tuple[str, ...]:
    """Return the names of the rows of M and of forces."""
    return at.functions.velocity_names


@claim("mass-matrix-symmetric", "M = Mᵀ", "mass matrix", ("M",))
def mass_matrix_symmetric(at: Point) -> Iterator[Sides]:
    """The mass matrix is symmetric."""
    M = at.of("M")

    def say(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        for part, name in ((np.tril(found, -1), "lower"), (np.triu(found, 1), "upper")):
            if not part.any():
                return f"the {name} triangle is empty"
        other = ", ".join(rows(at)[k] for k in reversed(worst))
        x, y = found[worst], expected[worst]
        return f"{x:.6g}, and entry ({other}) is {y:.6g}{opposite(x, y, allowed)}"

    yield Sides("M", M, M.T, (rows(at), rows(at)), say)


def opposite(x: float, y: float, allowed: float) -> str:
    """Say of two numbers that should be the same that one has the other sign, if that is so."""
    return ": opposite sign in one of them" if abs(x + y) <= allowed else ""


@claim("mass-matrix-positive", "vᵀ M v > 0", "mass matrix", ("M",))
def mass_matrix_positive(at: Point) -> Iterator[Told]:
    """M is positive definite, in units in which its diagonal is 1."""
    M = at.of("M")
    diagonal = np.diagonal(M.value)
    if (diagonal < -allowed_error(1.0 / EPS) * np.diagonal(M.error)).any():
        k = int(np.argmin(diagonal))
        yield Told(
            "M",
            float(-diagonal[k]),
            0.0,
            "failed",
            f"mass matrix, entry ({rows(at)[k]}, {rows(at)[k]}): negative",
        )
        return
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    least = float(np.linalg.eigvalsh(0.5 * (M.value + M.value.T) * np.outer(scale, scale))[0])
    allowed = C * float((M.error * np.outer(scale, scale)).sum() + EPS * len(scale))
    if least < -allowed:
        what = f"mass matrix, its least eigenvalue is {least:.3g} of its diagonal"
        yield Told("M", -least, allowed, "failed", what)
    elif least > allowed:
        yield Told("M", 0.0, allowed, "passed")
    else:
        yield Told("M", abs(least), allowed, "inconclusive", "M is singular to rounding")


@claim("bias-at-rest", "B(q, 0) = 0", "bias", ("bias",), natural=True)
def bias_at_rest(at: Point) -> Iterator[Sides]:
    """Nothing is left of the bias at rest; what is left often is gravity."""
    rest = at.moved(np.zeros(len(at.v)))
    if at.functions.bias_has_gravity:
        if at.functions.gravity is not None or at.has("U"):
            g = at.of("gravity") if at.functions.gravity is not None else at.U_q()
            yield Sides("bias at rest ~ ∂U/∂q", rest.of("bias"), g, (rows(at),))
        return

    def say(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        known = at.gravity() if at.has("gravity") or at.has("U") else None
        for sign, name in ((1.0, "∂U/∂q"), (-1.0, "-∂U/∂q")):
            if known is not None and same(found, sign * known.value, allowed + C * known.error):
                return f"it is {name}: gravity is in the bias (say bias_has_gravity=True)"
        potential = at.functions.qdot is None and _symmetric(_by_q(rest))
        return "should vanish, and has a potential: gravity in it?" if potential else ""

    yield Sides("bias", rest.of("bias"), zero(at.of("bias")), (rows(at),), say)


def _by_q(rest: Point) -> Measured:
    return rest.by_q(rest.raw("bias"))


def same(found: Array, expected: Array, allowed: Array) -> bool:
    """Return whether two arrays are the same, each entry to what is allowed of it."""
    return bool((np.abs(found - expected) <= allowed).all())


def _symmetric(jacobian: Measured) -> bool:
    return same(jacobian.value, jacobian.value.T, C * (jacobian.error + jacobian.error.T))


@claim("bias-quadratic", "B(2v) = 4 B(v)", "bias", ("bias",), natural=True)
def bias_quadratic(at: Point) -> Iterator[Sides]:
    """The bias is quadratic in v."""
    yield Sides("bias", at.moved(2.0 * at.v).B(), 4.0 * at.B(), (rows(at),))


@claim("bias-even", "B(-v) = B(v)", "bias", ("bias",), natural=True)
def bias_even(at: Point) -> Iterator[Sides]:
    """The bias does not change when the motion runs backwards; damping would."""
    yield Sides("bias", at.moved(-at.v).B(), at.B(), (rows(at),))


@claim(
    "bias-of-mass-matrix",
    "B = Ṁ v - ½ ∂(vᵀ M v)/∂q",
    "bias",
    ("M", "bias"),
    blind=(
        Blind("bias", "whether the bias belongs to the mass matrix", ("M", "T", "against")),
        Blind("M", "whether M depends on q as it should", ("bias", "C", "T", "qdd", "against")),
    ),
)
def check_bias_of_mass_matrix(at: Point) -> Iterator[Sides | Skipped]:
    """B follows from the derivatives of M.

    Terms of T that are not quadratic in v, as where a clock drives the system, may add to B. So
    then only a B without them is judged, which passes whatever T is.
    """
    expected = bias_of_mass_matrix(at)
    if expected is None:
        yield Skipped("bias", UNKNOWN)
        return
    allowed = C * (at.B().error + expected.error)
    if not at.natural() and not same(at.B().value, expected.value, allowed):
        yield Skipped("bias", at.why_not_natural())
        return
    yield Sides("bias", at.B(), expected, (rows(at),), proportional)


def proportional(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
    """Factor by which all rows are too large, in words; "" if there is none.

    A factor has as many digits as `allowed` leaves, so that one cause has one text; in place of one
    that would read as 1 stands its relative difference from 1.
    """
    size = float(np.abs(expected).max(initial=0.0))
    if size == 0.0 or found.size < 1:
        return ""
    near = np.maximum(allowed, 1e-10 * size)
    known = {-1.0: "sign", 0.25: "a quarter of it", 0.5: "half of it", 0.0: "missing"}
    for value, name in known.items():
        if (np.abs(found - value * expected) <= near).all():
            return name + EVERY_ROW
    factor = float(found.ravel() @ expected.ravel() / (expected.ravel() @ expected.ravel()))
    if near > 0.1 * size or not (np.abs(found - factor * expected) <= near).all():
        return ""  # or not one digit of the factor is known
    digits = min(max(int(-np.log10(near / size)), 1), 7)
    text = f"{factor:.{digits}g}"
    if text not in ("1", "-1"):
        return f"{text} times what is expected{EVERY_ROW}"
    beyond = abs(factor) - 1.0
    if abs(beyond) * size <= near:
        return ""  # any factor so close to 1 would do
    known = min(int(np.log10(abs(beyond) * size / near)), 1)
    sign, large = "sign, and " if factor < 0.0 else "", "large" if beyond > 0.0 else "small"
    return f"{sign}too {large} by {abs(beyond):.{known}e} of it{EVERY_ROW}"


@claim("bias-power", "vᵀ B = ½ vᵀ Ṁ v", "bias", ("M|T", "bias"), natural=True)
def bias_power(at: Point) -> Iterator[Sides]:
    """The bias takes no energy: it does the work that M says."""
    v = exact(at.v)
    power = 0.5 * (v @ (inertia_rate(at) @ v)) if of_matrix(at) else at.rate_of(at.raw("T"))
    yield Sides("bias", v @ at.B(), power, ())


@claim(
    "coriolis-bias",
    "C v = B",
    "Coriolis matrix",
    ("C", "bias|M|T"),
    natural=True,
    blind=(Blind("C", "what C should be", ("bias", "M", "T")),),
)
def coriolis_bias(at: Point) -> Iterator[Sides | Skipped]:
    """C v is the bias: as given, else as M or T says."""
    expected = at.B() if at.has("bias") else bias_of_inertia(at)
    if expected is None:
        yield Skipped("C v", why_no_bias(at))
        return
    yield Sides("C v", at.of("C") @ exact(at.v), expected, (rows(at),), proportional)


@claim(
    "coriolis-skew",
    "Ṁ - 2 C is skew-symmetric",
    "Coriolis matrix",
    ("C", "M|T"),
    without=("qdot",),
    natural=True,
    blind=(Blind("C", "whether Ṁ - 2 C is skew-symmetric", ("M", "T")),),
)
def coriolis_skew(at: Point) -> Iterator[Sides]:
    """C is made of Christoffel's symbols: Ṁ = C + Cᵀ."""
    found = at.of("C") + at.of("C").T
    yield Sides("C + Cᵀ ~ Ṁ", found, inertia_rate(at), (rows(at), rows(at)))


@claim("gravity-potential", "∂g_i/∂q_k = ∂g_k/∂q_i", "gravity", ("gravity",), without=("qdot",))
def gravity_potential(at: Point) -> Iterator[Sides]:
    """Gravity has a potential."""
    given = at.functions.gravity is not None
    rest = at.moved(np.zeros(len(at.v)))
    jacobian = at.by_q(at.raw("gravity")) if given else _by_q(rest)

    def say(found: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        k, i = (rows(at)[entry] for entry in worst)
        x, y = found[worst], expected[worst]
        each = f"row {i} changes by {x:.6g} per {k}, and row {k} by {y:.6g} per {i}"
        return each + opposite(x, y, allowed)

    yield Sides("gravity", jacobian, jacobian.T, (rows(at), rows(at)), say)


@claim(
    "gravity-of-potential",
    "g = ∂U/∂q",
    "gravity",
    ("gravity", "U"),
    blind=(
        Blind(
            "gravity",
            "a gravity that is too strong, too weak or upside down",
            ("U", "qdd & M|T", "against"),
        ),
        Blind(
            "U",
            "a potential energy that is too large or too small",
            ("gravity", "qdd & M|T", "against"),
        ),
    ),
)
def gravity_of_potential(at: Point) -> Iterator[Sides]:
    """Gravity is the derivative of the potential energy."""
    yield Sides("gravity", at.gravity(), at.U_q(), (rows(at),), proportional)


@claim("gravity-velocity", "g does not depend on v", "gravity", ("gravity",))
def gravity_velocity(at: Point) -> Iterator[Sides]:
    """Gravity is the same at rest, also after something moved was looked at."""
    if at.functions.gravity is None:
        return  # it is the bias at rest
    here = at.of("gravity")
    moved = at.moved(-3.0 * at.v + at.width_v)
    for name in at.functions.given:
        with suppress(BrokenError):
            moved.raw(name)(moved.q, moved.v)
    found = moved.answers("gravity", moved.q, moved.v)
    yield Sides("gravity", Measured(found, here.error, here.size), here, (rows(at),))
