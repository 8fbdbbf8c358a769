"""Claims about inverse dynamics, derivatives of the dynamics, the inverse of M and regressors.

Derivatives are compared with measured finite differences of the function that they belong to, and
with the identities that tie them to M: M ∂q̈/∂q = -∂τ/∂q and M ∂q̈/∂v = -∂τ/∂v at one τ and v̇, and
M ∂q̈/∂τ = 1. With `qdot`, derivatives by coordinates are those along the velocities, as libraries
give them for a free base. Constraints leave the finite differences as they are; the identities hold
without constraints, and that of ∂q̈/∂τ in the directions that constraints leave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from eomcheck.claims.confusions import ConfusionContext
from eomcheck.claims.registry import BlindSpot, Comparison, Decision, Skipped, function_claim
from eomcheck.descriptions.tree_quantities import BY_COLUMNS, moved_parameters
from eomcheck.descriptions.vector_algebra import Vector, as_vector, scale_vector
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import Array
from eomcheck.testing.claims_answers import parameter_names
from eomcheck.testing.claims_motions import FORCES, is_nonzero
from eomcheck.testing.claims_terms import (
    compare,
    compare_constraints,
    proportional,
    row_names,
)
from eomcheck.testing.function_state import (
    FunctionState,
    bias_of_inertia,
    inertia,
    inertia_function,
    supplied_or_derived_bias,
    why_no_bias,
)
from eomcheck.testing.uncertain import UncertainArray, contract, exact, stack_uncertain

# ---- Recognized mistakes -------------------------------------------------------------------------


Mistakes = Callable[[Array], Mapping[str, Array | None]]
"""Function of the expected array that returns mistake -> array it gives, None where unknown."""


def recognized(mistakes: Mistakes, expected: UncertainArray) -> Callable[[], ConfusionContext]:
    """Return the function that makes the context by which mistakes are recognized."""

    def context() -> ConfusionContext:
        arrays = mistakes(expected.value)
        return ConfusionContext(alternatives={x: y for x, y in arrays.items() if y is not None})

    return context


def _value(make: Callable[[], UncertainArray | None]) -> Array | None:
    """Return the value of an array, None where it cannot be computed."""
    try:
        array = make()
    except Exception:  # of a function of the user, or a singular matrix: no explanation then
        return None
    return None if array is None else array.value


# ---- Inverse dynamics ----------------------------------------------------------------------------

ID = "inverse_dynamics"


def propagated(f: Callable[[Array], UncertainArray], x: UncertainArray) -> UncertainArray:
    """Return f(x) with the changes of f over the error of each entry of x (p,)."""
    y, changes = f(x.value), np.zeros(())
    for k in np.flatnonzero(x.error):
        step = np.where(np.arange(len(x.value)) == k, x.error, 0.0)
        changes = changes + np.abs(f(x.value + step).value - y.value)
    return UncertainArray(y.value, y.error + changes, y.size)


def applied_forces(at: FunctionState) -> UncertainArray | None:
    """Return τ (p,) at v̇: as given, else M v̇ + B - forces; None where B or forces are unknown."""
    if at.has(ID):
        return at.quantity(ID)
    B = supplied_or_derived_bias(at)
    return None if B is None or not at.parts() else inertia(at) @ exact(at.vdot) + B - at.forces()


def forces_function(at: FunctionState) -> Callable[[Array, Array], Array] | None:
    """Return the function (q, v) -> τ (p,) at v̇: as given, else of M, bias, gravity and Q.

    None where one of them is not given as such: differences of differences show nothing.
    """
    if at.has(ID):
        return at.raw(ID)
    f = at.functions
    no_gravity = f.gravity is None and not f.bias_has_gravity
    if not at.parts() or at.has("R") or (no_gravity and at.has("U")):
        return None
    if not at.has("bias") and not (at.has("C") and at.natural()):
        return None
    M = inertia_function(at)
    names = [name for name in ("bias", "C", "gravity", "Q") if f.function(name) is not None]
    terms = {name: at.raw(name) for name in names}

    def tau(q: Array, v: Array) -> Array:
        total = M(q, v) @ at.vdot
        total = total + (terms["bias"](q, v) if "bias" in terms else terms["C"](q, v) @ v)
        if "gravity" in terms and not f.bias_has_gravity:
            total = total + terms["gravity"](q, v)
        return total - terms["Q"](q, v) if "Q" in terms else total

    return tau


@function_claim(
    "inverse-dynamics",
    "τ = M v̇ + B + g + ∂R/∂v - Q",
    "inverse dynamics",
    (ID, "M|T"),
    natural=True,
    blind_spots=(
        BlindSpot(ID, "whether τ belongs to the equations of motion", ("M|T", "qdd", "against")),
    ),
)
def inverse_dynamics(at: FunctionState) -> Iterator[Comparison | Decision | Skipped]:
    """Compare τ with the terms of the equations of motion.

    Where no force is given, gravity and dampers may be in τ: what is even in v is compared, without
    its value at rest.
    """
    subject, B, tau = "inverse_dynamics ~ M v̇ + B", supplied_or_derived_bias(at), at.quantity(ID)
    if B is None:
        yield Skipped(subject, why_no_bias(at))
        return
    inertial = inertia(at) @ exact(at.vdot) + B
    if at.parts():

        def mistakes(expected: Array) -> dict[str, Array | None]:
            parts = {f"without {name}": expected + x.value for name, x in at.parts().items()}
            accelerating = (inertia(at) @ exact(at.vdot)).value
            bias = {"without the bias": expected - B.value}
            return {**parts, **bias, "without M v̇": expected - accelerating}

        expected = inertial - at.forces()
        yield compare(at, subject, tau, expected, context=recognized(mistakes, expected))
        return
    at_rest = at.with_loads(vdot=np.zeros(len(at.v))).with_velocity(np.zeros(len(at.v)))
    rest = at_rest.quantity(ID)
    even = 0.5 * (tau + at.with_velocity(-at.v).quantity(ID)) - rest
    yield compare(at, subject, even, inertial, proportional)
    if is_nonzero(rest).any():
        worst = float(np.abs(rest.value).max())
        yield Decision("forces", worst, 0.0, "inconclusive", f"τ at rest is not 0, and {FORCES}")


@function_claim(
    "inverse-dynamics-symmetric",
    "τ is affine in v̇, and ∂τ/∂v̇ symmetric",
    "inverse dynamics",
    (ID,),
)
def inverse_dynamics_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂τ/∂v̇ with its transpose, and τ with the sum of its changes along each v̇."""
    columns, sum_of_changes = mass_columns(at, ID)
    yield compare(at, "inverse_dynamics ~ ∂τ/∂v̇", columns, columns.T)
    yield compare(at, "inverse_dynamics ~ affine", at.quantity(ID), sum_of_changes)


def mass_columns(at: FunctionState, name: str) -> tuple[UncertainArray, UncertainArray]:
    """Return changes (..., p) of a function that is affine in v̇ per v̇, and it (...) of these."""
    none = at.with_loads(vdot=np.zeros(len(at.v))).quantity(name)
    changes = []
    for axis, width in zip(np.eye(len(at.v)), at.width_v, strict=True):
        changes.append((1.0 / width) * (at.with_loads(vdot=width * axis).quantity(name) - none))
    columns = stack_uncertain(changes, -1)
    axes = "abc"[: len(none.shape)]
    return columns, none + contract(f"{axes}p,p->{axes}", columns, exact(at.vdot))


@function_claim(
    "inverse-dynamics-acceleration",
    "τ(q, v, q̈(q, v, τ)) = τ",
    "inverse dynamics",
    (ID, "qdd"),
    without=("a",),
)
def inverse_dynamics_acceleration(at: FunctionState) -> Iterator[Comparison]:
    """Compare τ with the forces under which v̇ is q̈; 0 where q̈ does not take any."""
    qdd = at.measure(at.driven())
    back = propagated(lambda vdot: at.with_loads(vdot=vdot).quantity(ID), qdd)

    def mistakes(expected: Array) -> dict[str, Array | None]:
        parts = {name: part.value for name, part in at.parts().items()}
        return {
            "inverse dynamics without gravity, or q̈ without it": (
                expected + parts["gravity"] if "gravity" in parts else None
            ),
            "q̈ without the forces τ": 0.0 * expected if expected.any() else None,
        }

    tau = exact(at.tau)
    yield compare(at, "inverse_dynamics ~ q̈", back, tau, context=recognized(mistakes, tau))


# ---- Derivatives of inverse dynamics -------------------------------------------------------------

WITHOUT_WEIGHT = "without the derivative of gravity"
WITHOUT_INERTIA = "without the derivative of M v̇"


@function_claim(
    "inverse-dynamics-by-position",
    "tau_q = ∂τ/∂q",
    "derivative ∂τ/∂q",
    ("tau_q", "inverse_dynamics|M|T"),
    blind_spots=(BlindSpot("tau_q", "whether ∂τ/∂q belongs to τ", ("inverse_dynamics", "M|T")),),
)
def inverse_dynamics_by_position(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare ∂τ/∂q with differences of τ, or else, of M alone, its change with v̇."""
    tau, tau_q = forces_function(at), at.quantity("tau_q")
    if tau is not None:
        expected = at.along_velocities(tau)
        context = recognized(lambda _: _tau_q_mistakes(at, expected), expected)
        yield compare(at, "tau_q ~ τ", tau_q, expected, context=context)
        return
    M = inertia_function(at)
    at_rest = at.with_loads(vdot=np.zeros(len(at.v))).quantity("tau_q")
    expected = at.along_velocities(lambda q, v: M(q, v) @ at.vdot)
    yield compare(at, "tau_q ~ ∂M/∂q v̇", tau_q - at_rest, expected, proportional)
    yield Skipped(
        "tau_q ~ τ", "B and forces in ∂τ/∂q: inverse_dynamics, or bias and gravity, would tell"
    )


def _tau_q_mistakes(at: FunctionState, expected: UncertainArray) -> dict[str, Array | None]:
    """Return mistakes of a derivative ∂τ/∂q, and the arrays that they give."""

    def at_no_acceleration() -> UncertainArray | None:
        tau = forces_function(at.with_loads(vdot=np.zeros(len(at.v))))
        return None if tau is None else at.along_velocities(tau)

    weight = _value(lambda: _gravity_by_position(at))
    return {
        **_exchanged(at, "tau_q", "tau_v", expected, lambda: _tau_by_velocity(at)),
        "derivative of gravity alone": weight,
        WITHOUT_WEIGHT: None if weight is None else expected.value - weight,
        WITHOUT_INERTIA: _value(at_no_acceleration),
    }


def _gravity_by_position(at: FunctionState) -> UncertainArray:
    """Return ∂g/∂q (p, p) of gravity as given, else of what is in the bias or in τ at rest."""
    none = np.zeros(len(at.v))
    if at.functions.gravity is not None:
        return at.along_velocities(at.raw("gravity"))
    rest = at.with_loads(vdot=none).with_velocity(none)
    return rest.along_velocities(rest.raw("bias" if at.functions.bias_has_gravity else ID))


@function_claim(
    "inverse-dynamics-by-velocity",
    "tau_v = ∂τ/∂v",
    "derivative ∂τ/∂v",
    ("tau_v", "inverse_dynamics|bias|C|M|T"),
    blind_spots=(
        BlindSpot("tau_v", "whether ∂τ/∂v belongs to τ", ("inverse_dynamics", "bias", "M|T")),
    ),
)
def inverse_dynamics_by_velocity(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare ∂τ/∂v with differences of τ, or else of B - Q.

    Where no force is given, dampers may be in τ: what is odd in v is compared.
    """
    tau_v = at.quantity("tau_v")
    if at.has("R") and not at.has(ID):
        yield Skipped("tau_v ~ τ", "R is given without inverse_dynamics, which would tell ∂²R/∂v²")
        return
    expected = _tau_by_velocity(at)
    if expected is None:
        yield Skipped("tau_v ~ τ", why_no_bias(at))
        return
    if not at.has(ID) and not at.parts() and at.natural():
        back = at.with_velocity(-at.v).quantity("tau_v")
        tau_v = 0.5 * (tau_v - back)

    def tau_by_position() -> UncertainArray | None:
        tau = forces_function(at)
        return None if tau is None else at.along_velocities(tau)

    def mistakes(_: Array) -> dict[str, Array | None]:
        coriolis = at.quantity("C").value if at.has("C") else None
        exchanged = _exchanged(at, "tau_v", "tau_q", expected, tau_by_position)
        return {"C, which is not ∂(C v)/∂v": coriolis, **exchanged}

    yield compare(at, "tau_v ~ τ", tau_v, expected, context=recognized(mistakes, expected))


def _tau_by_velocity(at: FunctionState) -> UncertainArray | None:
    """Return ∂τ/∂v (p, p) without dampers, unless τ is given; None where B is unknown."""
    if at.has(ID):
        return at.by_v(at.raw(ID)).T
    gradient = bias_by_velocity(at)
    return gradient if gradient is None or not at.has("Q") else gradient - at.by_v(at.raw("Q")).T


def _exchanged(
    at: FunctionState,
    name: str,
    other: str,
    expected: UncertainArray,
    of_other: Callable[[], UncertainArray | None],
) -> dict[str, Array | None]:
    """Return the array of a function if another one holds what it should: both are exchanged.

    Args:
        at: the state.
        name, other: names of both functions.
        expected: expected value of `name`.
        of_other: function that returns the expected value of `other`.
    """

    def value() -> UncertainArray | None:
        held = at.quantity(other)
        same = np.abs(held.value - expected.value) <= C * (held.error + expected.error)
        return of_other() if same.all() else None

    return {f"{name} and {other}{EXCHANGED}": _value(value)} if at.has(other) else {}


EXCHANGED = " exchanged"
"""End of the text about two functions, each of which holds what the other should."""


def bias_by_velocity(at: FunctionState) -> UncertainArray | None:
    """Return ∂B/∂v (p, p), with gravity in B or not; None where B does not follow from anything."""
    if at.has("bias"):
        return at.by_v(at.raw("bias")).T
    if at.has("C") and at.natural():
        C = at.raw("C")
        return at.by_v(lambda q, v: C(q, v) @ v).T
    if bias_of_inertia(at) is None:
        return None
    columns = []
    for axis, width in zip(np.eye(len(at.v)), at.width_v, strict=True):
        # Exact but for rounding: B is quadratic in v.
        sides = [bias_of_inertia(at.with_velocity(at.v + s * width * axis)) for s in (1.0, -1.0)]
        assert sides[0] is not None and sides[1] is not None
        columns.append((0.5 / width) * (sides[0] - sides[1]))
    return stack_uncertain(columns, -1)


@function_claim(
    "inverse-dynamics-mixed",
    "∂(∂τ/∂q)/∂v = ∂(∂τ/∂v)/∂q",
    "derivatives ∂τ/∂q and ∂τ/∂v",
    ("tau_q", "tau_v"),
    without=("qdot",),
)
def inverse_dynamics_mixed(at: FunctionState) -> Iterator[Comparison]:
    """Compare the mixed second derivatives of τ."""
    yield _mixed(at, "tau_q", "tau_v")


def _mixed(at: FunctionState, by_position: str, by_velocity: str) -> Comparison:
    """Return the comparison of both mixed second derivatives (p, p, p) of a function."""
    ahead = contract("kij->ijk", at.by_v(at.raw(by_position)))
    back = contract("jik->ijk", at.by_q(at.raw(by_velocity)))
    return compare(at, f"{by_position} ~ {by_velocity}", ahead, back)


# ---- Derivatives of accelerations ----------------------------------------------------------------


def _gradient_blind(name: str, of_tau: str) -> tuple[BlindSpot, ...]:
    """Return the blind spot of a derivative of q̈ without q̈."""
    alternatives = ("qdd", f"{of_tau} & M|T", "against")
    return (BlindSpot(name, f"whether {name} is the derivative of q̈", alternatives),)


@function_claim(
    "acceleration-by-position",
    "qdd_q = ∂q̈/∂q",
    "derivative ∂q̈/∂q",
    ("qdd_q", "qdd"),
    blind_spots=_gradient_blind("qdd_q", "tau_q"),
)
def acceleration_by_position(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂q̈/∂q with differences of q̈ at the same τ."""
    yield _compare_gradient(at, "qdd_q", "qdd_v")


@function_claim(
    "acceleration-by-velocity",
    "qdd_v = ∂q̈/∂v",
    "derivative ∂q̈/∂v",
    ("qdd_v", "qdd"),
    blind_spots=_gradient_blind("qdd_v", "tau_v"),
)
def acceleration_by_velocity(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂q̈/∂v with differences of q̈."""
    yield _compare_gradient(at, "qdd_v", "qdd_q")


def _compare_gradient(at: FunctionState, name: str, other: str) -> Comparison:
    """Return the comparison of a derivative of q̈ with finite differences.

    Args:
        at: the state.
        name: `qdd_q` or `qdd_v`.
        other: the other one.
    """
    by_position, by_velocity = at.along_velocities, lambda f: at.by_v(f).T
    derivative, other_derivative = by_position, by_velocity
    if name == "qdd_v":
        derivative, other_derivative = by_velocity, by_position
    expected = derivative(at.driven())

    def mistakes(value: Array) -> dict[str, Array | None]:
        of_position = _qdd_q_mistakes(at, value) if name == "qdd_q" else {}
        of_other = lambda: other_derivative(at.driven())  # noqa: E731
        exchanged = _exchanged(at, name, other, expected, of_other)
        return {**_gradient_mistakes(at, value, derivative), **of_position, **exchanged}

    context = recognized(mistakes, expected)
    return compare(at, f"{name} ~ q̈", at.quantity(name), expected, context=context)


def _qdd_q_mistakes(at: FunctionState, expected: Array) -> dict[str, Array | None]:
    """Return mistakes of ∂q̈/∂q = -M⁻¹ ∂τ/∂q at v̇ = q̈, and the arrays that they give."""
    if not (at.has("M") or at.has("T")) or at.has("a"):
        return {}

    def responding(part: Callable[[], UncertainArray]) -> Array | None:
        forces = _value(part)
        if forces is None:
            return None
        return _value(lambda: exact(expected + np.linalg.solve(inertia(at).value, forces)))

    def weightless() -> UncertainArray:
        qdd, M, gravity = at.driven(), inertia_function(at), at.raw("gravity")
        return at.along_velocities(lambda q, v: qdd(q, v) + np.linalg.solve(M(q, v), gravity(q, v)))

    def of_inertia() -> UncertainArray:
        M, qdd = inertia_function(at), at.driven()(at.q, at.v)
        return at.along_velocities(lambda q, v: M(q, v) @ qdd)

    return {
        WITHOUT_WEIGHT: responding(lambda: _gravity_by_position(at)),
        "of q̈ without gravity": _value(weightless) if at.functions.gravity is not None else None,
        WITHOUT_INERTIA: responding(of_inertia),
    }


def _gradient_mistakes(
    at: FunctionState, expected: Array, derivative: Callable[..., UncertainArray]
) -> dict[str, Array | None]:
    """Return mistakes of a derivative of q̈, and the arrays that they give."""
    none = np.zeros(len(at.v))

    def of_no_force() -> UncertainArray | None:
        return derivative(at.driven(none)) if at.tau.any() else None

    def of_forces() -> UncertainArray | None:
        return inertia(at) @ exact(expected) if at.has("M") or at.has("T") else None

    forces = _value(of_forces)
    return {
        "at τ = 0, whatever τ is": _value(of_no_force),
        "M is left out: M ∂q̈": forces,
        "M is left out: -M ∂q̈, or ∂τ": None if forces is None else -forces,
    }


@function_claim(
    "acceleration-by-force",
    "qdd_tau = ∂q̈/∂τ",
    "derivative ∂q̈/∂τ",
    ("qdd_tau", "qdd", "tau"),
    blind_spots=(
        BlindSpot(
            "qdd_tau", "whether ∂q̈/∂τ is that of M", ("qdd & tau", "M|T|inverse_mass_matrix")
        ),
    ),
)
def acceleration_by_force(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂q̈/∂τ with differences of q̈ in τ."""
    expected = at.by_tau(at.driven).T
    context = recognized(lambda expected: _inverse_mistakes(at, expected), expected)
    yield compare(at, "qdd_tau ~ q̈", at.quantity("qdd_tau"), expected, context=context)


def _inverse_mistakes(at: FunctionState, expected: Array) -> dict[str, Array | None]:
    """Return mistakes of an inverse of M, and the arrays that they give."""
    M = _value(lambda: inertia(at)) if at.has("M") or at.has("T") else None
    return {
        "M, which is not inverted": M,
        "M⁻¹ without the constraints": np.linalg.inv(M) if M is not None and at.has("a") else None,
        "the diagonal of M⁻¹ alone": np.diag(np.diagonal(expected)),
        "the inverse of the diagonal of M": None if M is None else np.diag(1.0 / np.diagonal(M)),
    }


@function_claim(
    "acceleration-force-symmetric", "∂q̈/∂τ is symmetric", "derivative ∂q̈/∂τ", ("qdd_tau",)
)
def acceleration_force_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare ∂q̈/∂τ with its transpose."""
    response = at.quantity("qdd_tau")
    yield compare(at, "qdd_tau", response, response.T)


@function_claim(
    "acceleration-force-mass",
    "M ∂q̈/∂τ = 1",
    "derivative ∂q̈/∂τ",
    ("qdd_tau", "M|T|inverse_mass_matrix"),
)
def acceleration_force_mass(at: FunctionState) -> Iterator[Comparison]:
    """Compare M ∂q̈/∂τ with 1; with constraints in the directions they leave, and a ∂q̈/∂τ with 0."""
    response = at.quantity("qdd_tau")
    if not (at.has("M") or at.has("T")):
        if not at.has("a"):
            yield compare(at, "qdd_tau ~ M⁻¹", response, at.quantity("inverse_mass_matrix"))
        return
    product, one = inertia(at) @ response, exact(np.eye(len(at.v)))

    def mistakes(expected: Array) -> dict[str, Array | None]:
        M = inertia(at).value
        wrong = {x: y for x, y in _inverse_mistakes(at, expected).items() if "alone" not in x}
        return {x: None if y is None else free.value @ M @ y for x, y in wrong.items()}

    free = exact(at.free().T if at.has("a") else one.value)
    if not at.has("a"):
        yield compare(at, "qdd_tau ~ M", product, one, context=recognized(mistakes, one))
        return
    names = tuple(f"free direction {i}" for i in range(free.shape[0])), row_names(at)
    context = recognized(mistakes, one)
    yield Comparison("qdd_tau ~ M", free @ product, free @ one, names, context=context)
    kept = at.quantity("a") @ response
    yield compare_constraints(at, "qdd_tau ~ a", kept, exact(np.zeros(kept.shape)))


@function_claim(
    "acceleration-force",
    "M (q̈(τ) - q̈(0)) = τ + aᵀλ",
    "acceleration",
    ("qdd", "tau", "M|T|qdd_tau"),
)
def acceleration_force(at: FunctionState) -> Iterator[Comparison]:
    """Compare what applied forces change in q̈ with τ, in the directions that constraints leave."""
    change = at.measure(at.driven()) - at.measure(at.driven(np.zeros(len(at.v))))
    if not (at.has("M") or at.has("T")):
        yield compare(at, "qdd ~ τ", change, at.quantity("qdd_tau") @ exact(at.tau), proportional)
        return
    actual, tau, names = inertia(at) @ change, exact(at.tau), row_names(at)
    if at.has("a"):
        free = exact(at.free().T)
        names = tuple(f"free direction {i}" for i in range(free.shape[0]))
        actual, tau = free @ actual, free @ tau
    yield Comparison("qdd ~ τ", actual, tau, (names,), explain=proportional)


@function_claim(
    "acceleration-mixed",
    "∂(∂q̈/∂q)/∂v = ∂(∂q̈/∂v)/∂q",
    "derivatives ∂q̈/∂q and ∂q̈/∂v",
    ("qdd_q", "qdd_v"),
    without=("qdot",),
)
def acceleration_mixed(at: FunctionState) -> Iterator[Comparison]:
    """Compare the mixed second derivatives of q̈."""
    yield _mixed(at, "qdd_q", "qdd_v")


@function_claim(
    "acceleration-inverse-position",
    "M ∂q̈/∂q = -∂τ/∂q",
    "derivative ∂q̈/∂q",
    ("qdd_q", "tau_q", "M|T|qdd_tau|inverse_mass_matrix"),
    without=("a",),
)
def acceleration_inverse_position(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare M ∂q̈/∂q with -∂τ/∂q at one v̇, and at the τ that belongs to it."""
    yield from _inverse_identity(at, "qdd_q", "tau_q")


@function_claim(
    "acceleration-inverse-velocity",
    "M ∂q̈/∂v = -∂τ/∂v",
    "derivative ∂q̈/∂v",
    ("qdd_v", "tau_v", "M|T|qdd_tau|inverse_mass_matrix"),
    without=("a",),
)
def acceleration_inverse_velocity(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare M ∂q̈/∂v with -∂τ/∂v at one v̇, and at the τ that belongs to it."""
    yield from _inverse_identity(at, "qdd_v", "tau_v")


def _inverse_identity(
    at: FunctionState, of_qdd: str, of_tau: str
) -> Iterator[Comparison | Skipped]:
    """Yield the comparison of a derivative of q̈ with that of τ."""
    tau, subject = applied_forces(at), f"{of_qdd} ~ {of_tau}"
    if "f" not in at.caller.reads(of_qdd):
        yield Skipped(subject, f"{of_qdd}(q, v) takes no forces: {of_qdd}(q, v, tau) would tell")
        return
    if tau is None:
        yield Skipped(subject, "the τ that belongs to v̇ is not known: inverse_dynamics would tell")
        return
    derivative = propagated(lambda tau: at.with_loads(tau=tau).quantity(of_qdd), tau)
    minus = -at.quantity(of_tau)
    if at.has("M") or at.has("T"):
        yield compare(at, subject, inertia(at) @ derivative, minus, proportional)
        return
    response = "qdd_tau" if at.has("qdd_tau") else "inverse_mass_matrix"
    expected = at.with_loads(tau=tau.value).quantity(response) @ minus
    yield compare(at, subject, derivative, expected, proportional)


# ---- Inverse of M --------------------------------------------------------------------------------


@function_claim(
    "inverse-mass-matrix",
    "M⁻¹ M = 1",
    "inverse mass matrix",
    ("inverse_mass_matrix", "M|T"),
    blind_spots=(
        BlindSpot("inverse_mass_matrix", "whether M⁻¹ is that of M", ("M|T", "qdd_tau", "against")),
    ),
)
def inverse_mass_matrix(at: FunctionState) -> Iterator[Comparison]:
    """Compare the product of M⁻¹ and M with 1."""
    inverse, M = at.quantity("inverse_mass_matrix"), inertia(at)

    def mistakes(expected: Array) -> dict[str, Array | None]:
        diagonal = np.diag(1.0 / np.diagonal(M.value))
        return {
            "M, which is not inverted": M.value @ M.value,
            "the inverse of the diagonal of M": diagonal @ M.value,
            "the upper triangle alone": np.triu(np.linalg.inv(M.value)) @ M.value,
            "the lower triangle alone": np.tril(np.linalg.inv(M.value)) @ M.value,
        }

    product, one = inverse @ M, exact(np.eye(len(at.v)))
    yield compare(at, "inverse_mass_matrix ~ M", product, one, context=recognized(mistakes, one))


# ---- Regressor -----------------------------------------------------------------------------------

DIAGONAL_FIRST = 0, 1, 2, 3, 4, 7, 9, 5, 6, 8
"""Parameters of a body whose moments of inertia are in the order xx yy zz xy xz yz."""


@function_claim(
    "regressor-parameters",
    "Y π = M v̇ + B + g",
    "regressor",
    ("regressor", "parameters", "inverse_dynamics|M|T"),
    blind_spots=(
        BlindSpot(
            "regressor",
            "which parameter a column of the regressor belongs to, and its size",
            ("parameters", "against"),
        ),
        BlindSpot("parameters", "whether the parameters are those of the bodies", ("regressor",)),
    ),
)
def regressor_parameters(at: FunctionState) -> Iterator[Comparison | Skipped]:
    """Compare Y π with inverse dynamics, without dampers and applied forces."""
    Y, parameters = at.quantity("regressor"), at.quantity("parameters")
    actual, subject = Y @ parameters, "regressor ~ τ"
    if at.has(ID):
        expected = at.quantity(ID)
        for name in {"damping", "Q"} & {*at.parts()}:
            expected = expected + at.parts()[name]
    else:
        B = supplied_or_derived_bias(at)
        if B is None or not at.natural():
            yield Skipped(subject, why_no_bias(at))
            return
        expected = inertia(at) @ exact(at.vdot) + B
        if "gravity" in at.parts() or at.functions.bias_has_gravity:
            expected = expected + at.gravity()
        else:
            none = np.zeros(len(at.v))
            rest = at.with_loads(vdot=none).with_velocity(none)
            actual = actual - rest.quantity("regressor") @ parameters
            subject = "regressor ~ τ without gravity"

    def mistakes(expected: Array) -> dict[str, Array | None]:
        return _regressor_mistakes(at, expected, Y.value, parameters.value, actual.value)

    yield compare(at, subject, actual, expected, context=recognized(mistakes, expected))


def _regressor_mistakes(
    at: FunctionState, expected: Array, Y: Array, parameters: Array, actual: Array
) -> dict[str, Array | None]:
    """Return mistakes of a regressor: each gives the actual array if its reversal is right."""
    if len(parameters) % 10:
        return {}
    bodies, near = parameters.reshape(-1, 10), 1e-9 * max(float(np.abs(expected).max()), 1e-300)
    undone = {
        "columns of the moments of inertia in the order xx xy yy xz yz zz": bodies[:, BY_COLUMNS],
        "columns of the moments of inertia in the order xx yy zz xy xz yz": (
            bodies[:, DIAGONAL_FIRST]
        ),
        "bodies in opposite order": bodies[::-1],
        "columns of moments of inertia about the center of mass": moments_about_center(bodies),
        "π has moments of inertia about the center of mass": moments_about_origin(bodies),
        "m c for c, or c for m c": np.column_stack(
            (bodies[:, 0], bodies[:, 1:4] * bodies[:, :1], bodies[:, 4:])
        ),
    }
    offset = actual - Y @ parameters  # of what the regressor is at rest
    found = {
        name: actual
        for name, x in undone.items()
        if (np.abs(Y @ x.ravel() + offset - expected) <= near).all()
    }
    return {**found, "without gravity": expected - at.gravity().value if _has_weight(at) else None}


def _has_weight(at: FunctionState) -> bool:
    """Return whether gravity follows from a function."""
    return at.has("gravity") or at.has("U")


def moments_about_center(bodies: Array) -> Array:
    """Return parameters (b, 10) with moments of inertia about the center of mass."""
    return _with_moments_of(
        bodies, (moved_parameters(x, scale_vector(-1.0, _center(x))) for x in bodies)
    )


def moments_about_origin(bodies: Array) -> Array:
    """Return parameters (b, 10) whose moments about the center of mass are about the origin."""
    central = (np.r_[x[0], np.zeros(3), x[4:]] for x in bodies)
    moved = (moved_parameters(x, _center(own)) for x, own in zip(central, bodies, strict=True))
    return _with_moments_of(bodies, moved)


def _center(body: Array) -> Vector:
    """Return the center of mass c of parameters (10,); 0 without mass."""
    return as_vector(body[1:4] / body[0] if body[0] > 0.0 else np.zeros(3))


def _with_moments_of(bodies: Array, others: Iterable[tuple[float, ...]]) -> Array:
    """Return the parameters of bodies, the moments of inertia those of others."""
    moments = np.array(list(others), np.float64)[:, 4:]
    return np.column_stack((bodies[:, :4], moments))


@function_claim(
    "regressor-symmetric",
    "∂Y_j/∂v̇ is symmetric for each parameter j, and Y affine in v̇",
    "regressor",
    ("regressor",),
)
def regressor_symmetric(at: FunctionState) -> Iterator[Comparison]:
    """Compare the mass matrix of each parameter with its transpose, and Y with the sum of these."""
    columns, of_changes = mass_columns(at, "regressor")
    names = (row_names(at), parameter_names(columns.shape[1]), row_names(at))
    mirrored = contract("ijk->kji", columns)
    yield Comparison("regressor ~ ∂Y/∂v̇", columns, mirrored, names)
    yield Comparison("regressor ~ affine", at.quantity("regressor"), of_changes, names[:2])


@function_claim(
    "regressor-power",
    "vᵀ (Y_j(q, v, 0) - Y_j(q, 0, 0)) = ½ vᵀ Ṁ_j v for each parameter j",
    "regressor",
    ("regressor",),
)
def regressor_power(at: FunctionState) -> Iterator[Comparison]:
    """Compare the power of the bias of each parameter with that of its mass matrix ∂Y_j/∂v̇."""
    none = np.zeros(len(at.v))
    still = at.with_loads(vdot=none)
    rest = still.with_velocity(none)
    bias = still.quantity("regressor") - rest.quantity("regressor")
    moving, resting = at.raw("regressor", {"vdot": at.v}), at.raw("regressor", {"vdot": none})

    def energy(q: Array, v: Array) -> Array:
        return 0.5 * (at.v @ (moving(q, none) - resting(q, none)))

    names = (parameter_names(bias.shape[1]),)
    yield Comparison("regressor ~ power", exact(at.v) @ bias, at.rate_of(energy), names)
