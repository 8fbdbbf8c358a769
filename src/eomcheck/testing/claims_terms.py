"""Claims about single terms of the equations of motion: M, bias, C, gravity, energies, constraints.

Each compares a function with one that follows from another function, mostly by finite differences:
the bias and C with derivatives of M, gravity with those of U, M and the bias with those of T, and
the Jacobian and the drift of constraints with those of c and a.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from eomcheck.claims.confusions import (
    OPPOSITE,
    ConfusionContext,
    agreement_within,
    recognize,
    scaling,
    term_multiple,
)
from eomcheck.claims.finding import EVERY_ROW
from eomcheck.claims.registry import BlindSpot, Comparison, Decision, Skipped, function_claim
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C, allowed_error
from eomcheck.numbers.generic import EPS, Array
from eomcheck.testing.equations_of_motion import BrokenError
from eomcheck.testing.function_state import (
    BUILT_IN,
    REST_ENERGY,
    FunctionState,
    bias_of_energy,
    bias_of_inertia,
    bias_of_mass_matrix,
    differences,
    drift_of_jacobian,
    inertia_rate,
    second_differences,
    supplied_or_derived_drift,
    uses_mass_matrix,
    why_no_bias,
)
from eomcheck.testing.uncertain import UncertainArray, contract, exact, zero

# ---- M, bias, C and gravity ----------------------------------------------------------------------

UNKNOWN = f"{BUILT_IN}: if none are, pass holonomic=True"


def row_names(at: FunctionState) -> tuple[str, ...]:
    """Return the names of the rows of M and of forces."""
    return at.functions.velocity_names


Explain = Callable[[Array, Array, float, tuple[int, ...]], str]


def compare(
    at: FunctionState,
    subject: str,
    actual: UncertainArray,
    expected: UncertainArray,
    explain: Explain | None = None,
    context: Callable[[], ConfusionContext] | None = None,
) -> Comparison:
    """Return the comparison of two arrays whose axes are rows of M; see `Comparison`."""
    names = (row_names(at),) * len(actual.shape)
    if context is not None:
        explain = explained_by(context)
    return Comparison(subject, actual, expected, names, explain=explain, context=context)


def explained_by(context: Callable[[], ConfusionContext]) -> Explain:
    """Return the explanation by a confusion of all entries or of a column, else by a factor."""

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        known = context()
        if confusion := recognize(actual, expected, allowed, known):
            return confusion
        if factor := proportional(actual, expected, allowed, worst):
            return factor
        if actual.ndim != 2:
            return ""
        column = slice(worst[1], worst[1] + 1)
        cut = {
            name: {text: x[:, column] for text, x in getattr(known, name).items()}
            for name in ("terms", "alternatives")
        }
        sides = actual[:, column], expected[:, column]
        if np.count_nonzero(sides[1]) < 2:
            return ""
        confusion = recognize(*sides, allowed, known._replace(**cut))
        return f"{confusion}, in this column" if confusion else ""

    return explain


def compare_constraints(
    at: FunctionState,
    subject: str,
    actual: UncertainArray,
    expected: UncertainArray,
    explain: Explain | None = None,
) -> Comparison:
    """Return the comparison of two arrays whose first axis are constraints; see `Comparison`."""
    names = (constraint_row_names(at), row_names(at))[: len(actual.shape)]
    return Comparison(subject, actual, expected, names, explain=explain)


@function_claim("mass-matrix-symmetric", "M = Mᵀ", "mass matrix", ("M",))
def mass_matrix_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare M with its transpose."""
    M = at.quantity("M")

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        for part, name in ((np.tril(actual, -1), "lower"), (np.triu(actual, 1), "upper")):
            if not part.any():
                return f"the {name} triangle is empty"
        mirrored = ", ".join(row_names(at)[k] for k in reversed(worst))
        x, y = actual[worst], expected[worst]
        return f"{x:.6g}, and entry ({mirrored}) is {y:.6g}{sign_hint(x, y, allowed)}"

    yield compare(at, "M", M, M.T, explain)


def sign_hint(x: float, y: float, allowed: float) -> str:
    """Return a hint that two numbers that should be equal have opposite signs, "" otherwise."""
    opposite = scaling(x, y, agreement_within(allowed)) == OPPOSITE
    return ": opposite sign in one of them" if opposite else ""


@function_claim("mass-matrix-positive", "vᵀ M v > 0", "mass matrix", ("M",))
def mass_matrix_positive(at: FunctionState) -> Iterator[Decision]:
    """Decide whether M is positive definite, in units in which its diagonal is 1."""
    M = at.quantity("M")
    diagonal = np.diagonal(M.value)
    if (diagonal < -allowed_error(1.0 / EPS) * np.diagonal(M.error)).any():
        k = int(np.argmin(diagonal))
        yield Decision(
            "M",
            float(-diagonal[k]),
            0.0,
            "failed",
            f"mass matrix, entry ({row_names(at)[k]}, {row_names(at)[k]}): negative",
        )
        return
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    least = float(np.linalg.eigvalsh(0.5 * (M.value + M.value.T) * np.outer(scale, scale))[0])
    allowed = C * float((M.error * np.outer(scale, scale)).sum() + EPS * len(scale))
    if least < -allowed:
        text = f"mass matrix, its least eigenvalue is {least:.3g} of its diagonal"
        yield Decision("M", -least, allowed, "failed", text)
    elif least > allowed:
        yield Decision("M", 0.0, allowed, "passed")
    else:
        yield Decision("M", abs(least), allowed, "inconclusive", "M is singular to rounding")


REMEDY = "set bias_has_gravity = True"
"""Remedy for gravity in the bias: a line of a file, or an argument of `check_functions`."""


@function_claim("bias-at-rest", "B(q, 0) = 0", "bias", ("bias",), natural=True)
def bias_at_rest(at: FunctionState) -> Iterator[Comparison]:
    """Compare the bias at rest with 0; a difference is often gravity.

    With `bias_has_gravity` the bias at rest is compared with gravity.
    """
    at_rest = at.with_velocity(np.zeros(len(at.v)))
    if at.functions.bias_has_gravity:
        if at.functions.gravity is not None or at.has("U"):
            g = at.quantity("gravity") if at.functions.gravity is not None else at.U_q()
            yield compare(at, "bias at rest ~ ∂U/∂q", at_rest.quantity("bias"), g)
        return

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        gravity = at.gravity() if at.has("gravity") or at.has("U") else None
        if gravity is not None:
            multiple = term_multiple(actual, gravity.value, allowed, C * gravity.error)
            if multiple in (1, -1):
                if multiple == -1:
                    return "it is -∂U/∂q: gravity is in the bias, with the wrong sign"
                return f"it is ∂U/∂q: gravity is in the bias; {REMEDY}"
        potential = at.functions.qdot is None and _is_symmetric(_bias_jacobian(at_rest))
        what = f"should vanish, and has a potential: gravity in it? If so, {REMEDY}"
        return what if potential else ""

    yield compare(at, "bias", at_rest.quantity("bias"), zero(at.quantity("bias")), explain)


def _bias_jacobian(at_rest: FunctionState) -> UncertainArray:
    """Return ∂B/∂q (n, p), of which `at_rest` is the state at rest."""
    return at_rest.by_q(at_rest.raw("bias"))


def within_allowed(actual: Array, expected: Array, allowed: Array | float) -> bool:
    """Return whether two arrays are equal, each entry to its allowed error."""
    return bool((np.abs(actual - expected) <= allowed).all())


def _is_symmetric(jacobian: UncertainArray) -> bool:
    """Return whether a Jacobian is symmetric within its allowed error."""
    return within_allowed(jacobian.value, jacobian.value.T, C * (jacobian.error + jacobian.error.T))


@function_claim("bias-quadratic", "B(2v) = 4 B(v)", "bias", ("bias",), natural=True)
def bias_quadratic(at: FunctionState) -> Iterator[Comparison]:
    """Compare the bias at 2 v with 4 times the bias at v: it is quadratic in v."""
    yield compare(at, "bias", at.with_velocity(2.0 * at.v).B(), 4.0 * at.B())


@function_claim("bias-even", "B(-v) = B(v)", "bias", ("bias",), natural=True)
def bias_even(at: FunctionState) -> Iterator[Comparison]:
    """Compare the bias at -v and v: unlike damping it does not change when motion is reversed."""
    yield compare(at, "bias", at.with_velocity(-at.v).B(), at.B())


@function_claim(
    "bias-of-mass-matrix",
    "B = Ṁ v - ½ ∂(vᵀ M v)/∂q",
    "bias",
    ("M", "bias"),
    blind_spots=(
        BlindSpot("bias", "whether the bias belongs to the mass matrix", ("M", "T", "against")),
        BlindSpot("M", "whether M depends on q as it should", ("bias", "C", "T", "qdd", "against")),
    ),
)
def check_bias_of_mass_matrix(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare the bias with that of the derivatives of M.

    Terms of T that are not quadratic in v, as where the system is driven by time, may add to B. So
    then only a B without them is judged, which passes whatever T is.
    """
    expected = bias_of_mass_matrix(at)
    if expected is None:
        yield Skipped("bias", UNKNOWN)
        return
    allowed = C * (at.B().error + expected.error)
    if not at.natural() and not within_allowed(at.B().value, expected.value, allowed):
        yield Skipped("bias", at.why_not_natural())
        return
    yield compare(at, "bias", at.B(), expected, proportional)


def proportional(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
    """Return a common factor of all rows as a diagnosis; "" if there is none.

    A factor has as many digits as `allowed` leaves, so that one cause has one text; a factor that
    would read as 1 is replaced by its relative difference from 1.

    Args:
        actual: array of the functions under test.
        expected: expected array, same shape.
        allowed: error that is allowed in the worst entry.
        worst: index of the worst entry.
    """
    size = float(np.abs(expected).max(initial=0.0))
    if size == 0.0 or actual.size < 1:
        return ""
    near = np.maximum(allowed, 1e-10 * size)
    if what := scaling(actual, expected, agreement_within(near)):
        return what + EVERY_ROW
    factor = float(actual.ravel() @ expected.ravel() / (expected.ravel() @ expected.ravel()))
    if near > 0.1 * size or not (np.abs(actual - factor * expected) <= near).all():
        return ""  # or not one digit of the factor is known
    digits = min(max(int(-np.log10(near / size)), 1), 7)
    text = f"{factor:.{digits}g}"
    if text not in ("1", "-1"):
        return f"{text} times the expected value{EVERY_ROW}"
    beyond = abs(factor) - 1.0
    if abs(beyond) * size <= near:
        return ""  # any factor so close to 1 would do
    shown_digits = min(int(np.log10(abs(beyond) * size / near)), 1)
    sign, large = "wrong sign, and " if factor < 0.0 else "", "large" if beyond > 0.0 else "small"
    return f"{sign}too {large} by {abs(beyond):.{shown_digits}e} of the expected value{EVERY_ROW}"


@function_claim("bias-power", "vᵀ B = ½ vᵀ Ṁ v", "bias", ("M|T", "bias"), natural=True)
def bias_power(at: FunctionState) -> Iterator[Comparison]:
    """Compare the power of the bias with ½ vᵀ Ṁ v, which follows from M or T."""
    v = exact(at.v)
    power = 0.5 * (v @ (inertia_rate(at) @ v)) if uses_mass_matrix(at) else at.rate_of(at.raw("T"))
    yield compare(at, "bias", v @ at.B(), power)


@function_claim(
    "coriolis-bias",
    "C v = B",
    "Coriolis matrix",
    ("C", "bias|M|T"),
    natural=True,
    blind_spots=(BlindSpot("C", "what C should be", ("bias", "M", "T")),),
)
def coriolis_bias(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare C v with the bias: as given, else as it follows from M or T."""
    expected = at.B() if at.has("bias") else bias_of_inertia(at)
    if expected is None:
        yield Skipped("C v", why_no_bias(at))
        return
    yield compare(at, "C v", at.quantity("C") @ exact(at.v), expected, proportional)


@function_claim(
    "coriolis-skew",
    "Ṁ - 2 C is skew-symmetric",
    "Coriolis matrix",
    ("C", "M|T"),
    without=("qdot",),
    natural=True,
    blind_spots=(BlindSpot("C", "whether Ṁ - 2 C is skew-symmetric", ("M", "T")),),
)
def coriolis_skew(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare C + Cᵀ with Ṁ: they are equal if C is made of Christoffel symbols."""
    if not at.functions.coriolis_skew:
        yield Skipped("C + Cᵀ ~ Ṁ", "coriolis_skew = False")
        return
    twice = at.quantity("C") + at.quantity("C").T
    yield compare(at, "C + Cᵀ ~ Ṁ", twice, inertia_rate(at))


@function_claim(
    "gravity-potential", "∂g_i/∂q_k = ∂g_k/∂q_i", "gravity", ("gravity",), without=("qdot",)
)
def gravity_potential(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂g/∂q with its transpose: gravity has a potential."""
    is_supplied = at.functions.gravity is not None
    at_rest = at.with_velocity(np.zeros(len(at.v)))
    jacobian = at.by_q(at.raw("gravity")) if is_supplied else _bias_jacobian(at_rest)

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        k, i = (row_names(at)[entry] for entry in worst)
        x, y = actual[worst], expected[worst]
        changes = f"row {i} changes by {x:.6g} per {k}, and row {k} by {y:.6g} per {i}"
        return wrong_row + changes + sign_hint(x, y, allowed)

    wrong_row = _rows_without_potential(at) if is_supplied and at.has("U") else ""
    yield compare(at, "gravity", jacobian, jacobian.T, explain)


def _rows_without_potential(at: FunctionState) -> str:
    """Return which rows of gravity are not ∂U/∂q, as the beginning of a detail; "" if all or none
    are.
    """
    gravity, expected = at.gravity(), at.U_q()
    allowed = C * (gravity.error + expected.error)
    wrong = np.abs(gravity.value - expected.value) > allowed
    if wrong.all() or not wrong.any():
        return ""
    names = [name for name, flag in zip(row_names(at), wrong, strict=True) if flag]
    differs = "rows {} differ" if len(names) > 1 else "row {} differs"
    return f"{differs.format(', '.join(names))} from ∂U/∂q; "


@function_claim(
    "gravity-of-potential",
    "g = ∂U/∂q",
    "gravity",
    ("gravity", "U"),
    blind_spots=(
        BlindSpot(
            "gravity",
            "a gravity that is too strong, too weak or upside down",
            ("U", "qdd & M|T", "against"),
        ),
        BlindSpot(
            "U",
            "a potential energy that is too large or too small",
            ("gravity", "qdd & M|T", "against"),
        ),
    ),
)
def gravity_of_potential(at: FunctionState) -> Iterator[Comparison]:
    """Compare gravity with the derivative of the potential energy."""
    yield compare(at, "gravity", at.gravity(), at.U_q(), proportional)


@function_claim("gravity-velocity", "g does not depend on v", "gravity", ("gravity",))
def gravity_velocity(at: FunctionState) -> Iterator[Comparison]:
    """Compare gravity at two velocities, after calls of all functions at the other one."""
    if at.functions.gravity is None:
        return  # gravity is the bias at rest
    first = at.quantity("gravity")
    faster = at.with_velocity(-3.0 * at.v + at.width_v)
    for name in at.functions.given:
        with suppress(BrokenError):
            faster.raw(name)(faster.q, faster.v)
    again = faster.caller("gravity", faster.q, faster.v)
    yield compare(at, "gravity", UncertainArray(again, first.error, first.size), first)


# ---- Energies ------------------------------------------------------------------------------------


@function_claim("energy-quadratic", "T is at most quadratic in v", "kinetic energy", ("T",))
def energy_quadratic(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare both sides of T(3v) + 3 T(v) = 3 T(2v) + T(0).

    T(q, 0) may change with q where the system is driven by time.
    """
    T = [at.with_velocity(k * at.v).quantity("T") for k in range(4)]
    yield compare(at, "T", T[3] + 3.0 * T[1], 3.0 * T[2] + T[0])
    tells = [name for name in ("bias", "qdd", "against") if at.has(name)]
    if not tells and at.rest_energy_changes():
        yield Skipped("T at rest", f"{REST_ENERGY} bias, qdd or against would tell")


@function_claim(
    "kinetic-energy",
    "M = ∂²T/∂v²",
    "mass matrix",
    ("M", "T"),
    blind_spots=(BlindSpot("M", "a constant added to M", ("T", "qdd", "against")),),
)
def kinetic_energy(at: FunctionState) -> Iterator[Comparison]:
    """Compare M with ∂²T/∂v², entry by entry; terms of T that are not quadratic in v drop out."""

    def explain(actual: Array, expected: Array, allowed: float, worst: tuple[int, ...]) -> str:
        more = actual - expected
        if np.abs(more - np.diag(np.diagonal(more))).max(initial=0.0) <= allowed:
            extra = np.diagonal(np.where(np.abs(more) <= allowed, 0.0, more))
            size = "too small" if (extra <= 0.0).all() else "too large"
            least = size == "too small"
            numbers = ", ".join(f"{abs(x) if least else x + 0.0:.6g}" for x in extra)
            armature = ": armature?" if (extra >= 0.0).all() else ""
            return f"on the diagonal {numbers} {size}, nothing elsewhere{armature}"
        return proportional(actual, expected, allowed, worst)

    yield compare(at, "M ~ ∂²T/∂v²", at.quantity("M"), second_differences(at), explain)


@function_claim(
    "bias-of-energy", "B = ∂²T/∂v∂q v - ∂T/∂q", "bias", ("T", "bias"), without=("qdot",)
)
def check_bias_of_energy(at: FunctionState) -> Iterator[Comparison]:
    """Compare the bias with that of T by Lagrange's equations, also where T has linear terms."""
    expected = bias_of_energy(at)
    assert expected is not None
    yield compare(at, "bias ~ T", at.B(), expected, proportional)


@function_claim(
    "dissipation-positive",
    "R(q, v) + R(q, -v) ≥ 2 R(q, 0)",
    "dissipation function",
    ("R",),
    without=("b",),
    consistent=True,
)
def dissipation_positive(at: FunctionState) -> Iterator[Decision | Skipped]:
    """Decide whether dampers take energy: R(q, v) + R(q, -v) is not less than 2 R(q, 0).

    Checked along v, and along the velocity for which second differences of R are least. Terms odd
    in v, as of a damper against a belt that moves, drop out.
    """
    R, R_of_v, at_rest = at.raw("R"), at.quantity("R"), np.zeros(len(at.v))
    least, size = _least_damped(at, R)
    noise = EPS + (float(R_of_v.error / R_of_v.size) if R_of_v.size > 0.0 else 0.0)
    R_at_rest = float(R(at.q, at_rest))
    changes = np.array(
        [[float(R(at.q, sign * v)) - R_at_rest for sign in (1, -1)] for v in (at.v, least)]
    )
    if not np.isfinite(changes).all():
        yield Skipped("R", "R has no value at a velocity within the ranges")
        return
    allowed = C * noise * max(size, float(R_of_v.size), abs(R_at_rest))
    gains, change = changes.sum(axis=1), float(np.abs(changes).max())
    gain, v = float(gains.min()), (at.v, least)[int(gains.argmin())]
    if gain < -allowed:
        where = ", ".join(f"{x:.3g}" for x in v)
        feeds = f"feeds energy at v = [{where}], where R is {-gain / 2.0:.3g} W less than at rest"
        text = f"dissipation function, value: {feeds}: wrong sign? Active drives belong into Q"
        yield Decision("R", -gain, allowed, "failed", text)
    elif change == 0.0 or allowed <= INCONCLUSIVE * change:
        yield Decision("R", max(0.0, -gain), allowed, "passed")
    else:
        text = "R changes with v by no more than its own rounding"
        yield Decision("R", max(0.0, -gain), allowed, "inconclusive", text)


def _least_damped(at: FunctionState, R: Callable[[Array, Array], Array]) -> tuple[Array, float]:
    """Return the velocity (p,) in the ranges for which second differences of R are least.

    It lies in the directions that constraints leave, where constraints are given. The second value
    is the size of the terms of the second differences.
    """
    free = at.free()
    with np.errstate(divide="ignore"):
        steps = free / np.abs(free / at.width_v[:, None]).max(axis=0)
    values, size = differences(lambda q, y: R(q, steps @ y), at.q, np.ones(steps.shape[1]))
    least = steps @ np.linalg.eigh(values)[1][:, 0]
    return least / np.abs(least / at.width_v).max(), len(values) * float(size.max())


def kinetic_rate(at: FunctionState, qdd: UncertainArray) -> UncertainArray:
    """Return the rate Ṫ along q̈, of T or else of ½ vᵀ M v."""
    v = exact(at.v)
    if at.has("T"):
        T = at.raw("T")
        return at.rate_of(T) + at.by_v(T) @ qdd
    return 0.5 * (v @ (inertia_rate(at) @ v)) + v @ (at.quantity("M") @ qdd)


# ---- Constraints ---------------------------------------------------------------------------------


def constraint_row_names(at: FunctionState) -> tuple[str, ...]:
    """Return the names of the constraints."""
    return tuple(f"constraint {i}" for i in range(at.caller.sizes.get("r", 0)))


@function_claim(
    "constraint-jacobian",
    "a = ∂c/∂v, or ∂c/∂q of c(q)",
    "constraint Jacobian",
    ("a", "c"),
    blind_spots=(BlindSpot("a", "whether a belongs to the constraints", ("c", "against")),),
)
def constraint_jacobian(at: FunctionState) -> Iterator[Comparison]:
    """Compare a with the derivative of the constraints c."""
    c, a = at.raw("c"), at.quantity("a")
    if at.caller.reads("c") == "qv":
        expected = at.by_v(c).T
    else:
        expected = contract("nr,np->rp", at.by_q(c), at.S())
    yield compare_constraints(at, "a", a, expected)


@function_claim("constraint-velocity", "c(q, v) = a v + b", "constraint velocity", ("a", "c"))
def constraint_velocity(at: FunctionState) -> Iterator[Comparison]:
    """Compare a v + b with constraints at velocity level."""
    if at.caller.reads("c") != "qv":
        return
    velocity = at.quantity("a") @ exact(at.v)
    if at.has("b"):
        velocity = velocity + at.quantity("b")
    yield compare_constraints(at, "a v + b", velocity, at.quantity("c"))


@function_claim(
    "constraint-drift",
    "γ = ȧ v + ḃ",
    "constraint drift",
    ("a", "gamma"),
    blind_spots=(
        BlindSpot("gamma", "whether γ belongs to a", ("a", "against")),
        BlindSpot("a", "whether a depends on q as it should", ("c", "gamma", "qdd", "against")),
    ),
)
def constraint_drift(at: FunctionState) -> Iterator[Comparison]:
    """Compare γ with the rate of a v + b at v̇ = 0, for every v."""
    yield compare_constraints(at, "γ", at.quantity("gamma"), drift_of_jacobian(at), proportional)


@function_claim(
    "constraint-acceleration", "a q̈ + γ = 0", "acceleration", ("a", "qdd"), consistent=True
)
def constraint_acceleration(at: FunctionState) -> Iterator[Comparison]:
    """Compare a q̈ with -γ: accelerations keep the constraints; γ as given, else of a and b."""
    a_qdd = at.quantity("a") @ at.quantity("qdd")
    yield compare_constraints(at, "a q̈ ~ -γ", a_qdd, -supplied_or_derived_drift(at), proportional)
