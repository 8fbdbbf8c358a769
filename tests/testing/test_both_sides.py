"""Both sides of claims about motions, constraints and references, held against formulas by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.claims.registry import ClaimOutput, Comparison, Decision, Skipped
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import EPS
from eomcheck.testing import FUNCTION_CLAIMS, EquationsOfMotion
from eomcheck.testing.claims_motions import FORCES, check_reference, is_nonzero, violation_power
from eomcheck.testing.claims_terms import proportional
from eomcheck.testing.equations_of_motion import FunctionCaller
from eomcheck.testing.function_checks import claim_outputs
from eomcheck.testing.function_state import FunctionState
from eomcheck.testing.uncertain import UncertainArray

Q, V = np.array([0.3, 0.7, -0.4]), np.array([0.5, -0.8, 0.9])
ROWS = ("q[0]", "q[1]", "q[2]")


def M(q: Any) -> Any:
    return np.array([[3.0, 0.2 * q[0], 0.1], [0.2 * q[0], 2.0 + q[1] ** 2, 0.4], [0.1, 0.4, 5.0]])


def M_rate(q: Any, v: Any) -> Any:
    across = 0.2 * v[0]
    return np.array([[0.0, across, 0.0], [across, 2.0 * q[1] * v[1], 0.0], [0.0, 0.0, 0.0]])


def bias(q: Any, v: Any) -> Any:
    return np.array([v[0] * v[1], q[0] * v[2] ** 2, -2.0 * v[1] ** 2])


def gravity(q: Any) -> Any:
    return np.array([1.1, q[1], -2.0 * q[2]])


def R(q: Any, v: Any) -> Any:
    return 0.15 * v[0] ** 2 + 0.35 * v[1] * v[2]


def R_v(v: Any) -> Any:
    return np.array([0.3 * v[0], 0.35 * v[2], 0.35 * v[1]])


def load(q: Any, v: Any) -> Any:
    return np.array([0.7 * q[2], -1.3, 0.2 * v[0]])


def qdd(q: Any, v: Any) -> Any:
    return np.array([q[0] - v[0], 2.0 * v[1] ** 3, 0.5 + v[2] ** 2 - 3.0 * v[0]])


def at(
    n: int = 3, q: Any = Q, v: Any = V, against: EquationsOfMotion | None = None, **own: Any
) -> FunctionState:
    """Return the point of functions."""
    return FunctionState(
        FunctionCaller(EquationsOfMotion(n, **own)), np.array(q), np.array(v), 0, against
    )


def says(claim: str, here: FunctionState) -> list[ClaimOutput]:
    """Return what a claim says at a point."""
    return list(FUNCTION_CLAIMS[claim].evaluate(here))


def holds(one: ClaimOutput, subject: str, found: Any, expected: Any, names: Any) -> None:
    """Assert what both sides of a comparison are, to 1e-9."""
    assert isinstance(one, Comparison), one
    assert (one.subject, one.names) == (subject, names)
    for side, value in ((one.actual, found), (one.expected, expected)):
        np.testing.assert_allclose(side.value, value, rtol=1e-9, atol=1e-9)
        assert side.shape == np.shape(value) == side.error.shape == side.size.shape
        assert (side.error <= 1e-8).all()


# ---- Which claims are looked at, and what is said of the others ----------------------------------

APPLY = {
    "M": "mass-matrix-symmetric mass-matrix-positive",
    "bias": "bias-at-rest bias-quadratic bias-even",
    "gravity": "gravity-potential gravity-velocity",
    "C": "",
    "qdd": "acceleration-even acceleration-quadratic",
    "T": "energy-quadratic",
    "R": "dissipation-positive",
    "R b": "",
    "qdd R": "dissipation-positive",
    "qdd Q": "",
    "qdd b": "",
    "qdd U": "acceleration-even acceleration-quadratic",
    "gravity U": "gravity-potential gravity-velocity gravity-of-potential",
    "M bias": "mass-matrix-symmetric mass-matrix-positive bias-at-rest bias-quadratic bias-even "
    "bias-of-mass-matrix bias-power",
    "T bias": "bias-at-rest bias-quadratic bias-even energy-quadratic bias-power bias-of-energy",
    "C bias": "bias-at-rest bias-quadratic bias-even coriolis-bias",
    "C T": "energy-quadratic coriolis-bias coriolis-skew",
    "M qdd R": "mass-matrix-symmetric mass-matrix-positive dissipation-positive motion "
    "power-balance",
    "T qdd b": "energy-quadratic motion",
    "M T": "mass-matrix-symmetric mass-matrix-positive energy-quadratic kinetic-energy",
    "a": "",
    "a c": "constraint-jacobian constraint-velocity",
    "a gamma": "constraint-drift",
    "a qdd": "acceleration-even acceleration-quadratic constraint-acceleration",
    "b gamma": "",
}
"""Functions -> the claims that are looked at, beside those about answers."""

ANSWERS = {"answers", "arguments-unchanged", "same-answer", "answers-repeat", "double-precision"}


@pytest.mark.parametrize("given", APPLY)
def test_claims_are_looked_at_where_they_hold_and_nothing_is_missing(given: str):
    own: dict[str, Any] = dict.fromkeys(given.split(), len)
    here = FunctionState(FunctionCaller(EquationsOfMotion(1, **own)), np.zeros(1), np.zeros(1))
    found = {id for id, one in FUNCTION_CLAIMS.items() if one.applies(here)}
    assert found - ANSWERS == {*APPLY[given].split()}
    assert found >= ANSWERS


def test_whether_a_state_has_to_keep_constraints_or_the_energy_to_be_quadratic_is_as_it_says():
    every = FUNCTION_CLAIMS.items()
    consistent = "dissipation-positive constraint-acceleration motion power-balance"
    accelerations = "acceleration-even acceleration-quadratic"
    assert {id for id, x in every if x.consistent} == {*f"{consistent} {accelerations}".split()}
    natural = "bias-at-rest bias-quadratic bias-even bias-power coriolis-bias "
    natural += "coriolis-skew power-balance inverse-dynamics com-kinetic-energy "
    assert {id for id, x in every if x.natural} == {*(natural + accelerations).split()}


# ---- Whole accelerations -------------------------------------------------------------------------

FORCED = {"gravity": gravity, "R": R, "Q": load}
INERTIAL = M(Q) @ qdd(Q, V) + bias(Q, V)
EXPECTED = load(Q, V) - gravity(Q) - R_v(V)
TERMS = {"M": M, "bias": bias, "qdd": qdd}


def test_motion_is_m_qdd_and_bias_beside_all_forces():
    (one,) = says("motion", at(**TERMS, **FORCED))
    holds(one, "M q̈ + B ~ forces", INERTIAL, EXPECTED, (ROWS,))


def test_motion_is_looked_at_in_the_directions_that_constraints_leave():
    a = np.array([[1.0, -2.0, 0.5]])
    here = at(**TERMS, **FORCED, a=lambda q: a)
    (one,) = says("motion", here)
    free = here.free().T
    names = (("free direction 0", "free direction 1"),)
    holds(one, "M q̈ + B ~ forces", free @ INERTIAL, free @ EXPECTED, names)


@pytest.mark.parametrize("constrained", [False, True])
@pytest.mark.parametrize(
    ("part", "of"), [("Q", load(Q, V)), ("gravity", -gravity(Q)), ("damping", -R_v(V))]
)
@pytest.mark.parametrize(
    ("factor", "how"),
    [
        (-1.0, "it is not in q̈, or it is in two of the other functions"),
        (1.0, "it is twice in q̈"),
        (-2.0, "its sign is another one in q̈"),
        (2.0, ""),
    ],
)
def test_a_force_by_which_motion_is_off_is_named_with_what_that_looks_like(
    part: str, of: Any, factor: float, how: str, constrained: bool
):
    own: dict[str, Any] = {"a": lambda q: np.array([[1.0, -2.0, 0.5]])} if constrained else {}
    here = at(**TERMS, **FORCED, **own)
    (one,) = says("motion", here)
    assert isinstance(one, Comparison) and one.explain is not None
    free = here.free().T
    found = free @ (EXPECTED + factor * of)
    said = one.explain(found, free @ EXPECTED, 1e-9, (0,))
    assert said == (f"off by {part}: {how}" if how else "")
    assert one.explain(found + 1e-6, free @ EXPECTED, 1e-9, (0,)) == ""


def test_motion_without_forces_is_held_where_v_is_turned_round_and_the_rest_is_told():
    other, told = says("motion", at(**TERMS))
    back = M(Q) @ qdd(Q, -V) + bias(Q, -V)
    rest = M(Q) @ qdd(Q, 0.0 * V)
    holds(other, "M q̈ + B ~ forces", INERTIAL + back, 2.0 * rest, (ROWS,))
    assert isinstance(told, Decision)
    assert (told.subject, told.allowed, told.verdict) == ("forces", 0.0, "inconclusive")
    assert told.observed == pytest.approx(np.abs(INERTIAL).max())
    assert told.detail == f"M q̈ + B is not 0, and {FORCES}"


def test_motion_without_forces_or_anything_that_needs_one_has_to_vanish():
    def free(q: Any, v: Any) -> Any:
        return -np.linalg.solve(M(q), bias(q, v))

    (one,) = says("motion", at(M=M, bias=bias, qdd=free))
    holds(one, "M q̈ + B ~ forces", np.zeros(3), np.zeros(3), (ROWS,))


def test_motion_is_skipped_where_a_clock_drives_or_nothing_tells_the_bias():
    here = at(**TERMS, a=lambda q: np.array([[1.0, 0, 0]]), b=lambda t: np.array([0.2]))
    assert says("motion", here) == [Skipped("M q̈ + B ~ forces", FORCES)]
    (one,) = says("motion", at(M=M, qdd=qdd, holonomic=False, **FORCED))
    assert isinstance(one, Skipped)
    assert one.subject == "M q̈ + B ~ forces"
    assert one.reason.startswith("constraints may be built into M, which then does not determine B")


def test_what_is_odd_in_v_and_does_no_work_has_to_vanish_where_the_energy_has_linear_terms():
    """A Coriolis force of a turntable that is missing in q̈; T is told with the turn."""
    turn = 1.5

    def T(q: Any, v: Any) -> Any:
        return (v[0] - turn * q[1]) ** 2 + (v[1] + turn * q[0]) ** 2

    (one,) = says("motion", at(2, (0.3, 0.7), (0.5, -0.8), T=T, qdd=lambda q, v: turn**2 * q))
    coriolis = 4.0 * turn * np.array([0.8, 0.5])  # 2 m Ω × v twice, of m = 2
    holds(one, "M q̈ + B ~ forces", 2.0 * coriolis, np.zeros(2), (("q[0]", "q[1]"),))


def test_power_is_the_rate_of_the_kinetic_energy_beside_v_times_forces():
    (one,) = says("power-balance", at(M=M, qdd=qdd, **FORCED))
    rate = V @ M(Q) @ qdd(Q, V) + 0.5 * V @ M_rate(Q, V) @ V
    holds(one, "Ṫ ~ v·forces", rate, V @ EXPECTED, ())
    assert says("power-balance", at(M=M, qdd=qdd)) == [Skipped("Ṫ ~ v·forces", FORCES)]


def test_what_constraint_forces_do_is_what_is_left_of_the_constraint():
    a = np.array([[1.0, -2.0, 0.5], [0.0, 1.0, 3.0]])
    here = at(**TERMS, a=lambda q: a)
    parts = [np.array([1.0, 2.0, -3.0]), np.array([0.1, 0.2, 0.3]), np.array([2.0, 2.0, 3.0])]
    forces = UncertainArray(*parts)
    found = violation_power(here, here.quantity("qdd"), forces)
    left = np.abs(a @ V) + EPS * np.abs(a) @ np.abs(V)
    violation = np.abs(np.linalg.pinv(a)) @ left
    size = here.quantity("M").size @ here.quantity("qdd").size + forces.size
    np.testing.assert_allclose(found.error, size @ violation, rtol=1e-9)
    assert (float(found.value), float(found.size)) == (0.0, 0.0)
    none = violation_power(at(**TERMS), here.quantity("qdd"), forces)
    assert (float(none.value), float(none.error)) == (0.0, 0.0)


def damped(q: Any, v: Any) -> Any:
    """Linear dampers in rows 0 and 2, of which that in 2 is larger, and a cubic one in row 1."""
    return np.array([q[0] - 0.2 * v[0], 0.1 + 2.0 * v[1] ** 3, 0.5 + v[2] ** 2 - 0.7 * v[1]])


def test_rows_with_a_linear_damper_are_told_and_the_others_judged():
    told, one = says("acceleration-even", at(qdd=damped))
    assert isinstance(told, Decision)
    assert told[:4] == ("q̈ odd in v", pytest.approx(1.4 * 0.8), 0.0, "inconclusive")
    assert told.detail == (
        "acceleration, row q[0], q[2]: odd in v, and linear: a damper? R or Q would tell"
    )
    row = 2.0 * 0.8**3
    holds(one, "q̈", [0.0, 0.1 + row, 0.0], [0.0, 0.1 - row, 0.0], (ROWS,))
    assert isinstance(one, Comparison) and one.explain is not None
    said = one.explain(one.actual.value, one.expected.value, 0.0, (1,))
    assert said == "odd in v, and not linear: drag and friction would be in R or Q"


def test_accelerations_are_quadratic_but_for_a_linear_damper():
    (one,) = says("acceleration-quadratic", at(qdd=damped))
    cubic = 2.0 * -(0.8**3)
    holds(one, "q̈", [0.0, 8.0 * cubic, 4 * 0.81], [0.0, 4.0 * cubic, 4 * 0.81], (ROWS,))


def test_a_number_is_seen_beyond_what_is_allowed_of_it():
    error = np.array([1e-3, 1e-3, 0.0, 1e-3])
    value = error * C * np.array([1.1, -1.1, 0.0, 0.9])
    assert is_nonzero(UncertainArray(value, error, error)).tolist() == [True, True, False, False]


# ---- Constraints ---------------------------------------------------------------------------------

S = np.array([[1.0, 2.0], [0.5, -1.0], [3.0, 0.25]])
SPEEDS = {"qdot": lambda q, u: S @ u, "speeds": 2}
U_ = np.array([0.6, -0.9])


def a(q: Any) -> Any:
    return np.array([[q[0], 1.0], [0.3, q[1] * q[2]]])


def a_rate(q: Any, rates: Any) -> Any:
    return np.array([[rates[0], 0.0], [0.0, rates[1] * q[2] + q[1] * rates[2]]])


TWO = (("constraint 0", "constraint 1"),)
A_NAMES = (*TWO, ("u[0]", "u[1]"))


def held(**own: Any) -> FunctionState:
    """Return the point of functions with two speeds of three coordinates, and two constraints."""
    here = at(3, Q, U_, **SPEEDS, **own)
    for name in {"a", "gamma", "c", "b"} & {*own}:
        here.caller(name, here.q, here.v)
    return here


def test_a_jacobian_is_the_derivative_by_coordinates_along_speeds_or_by_speeds():
    c_q = np.array([[2.0 * Q[0], 0.0, 1.0], [Q[1], Q[0], 0.0]])
    (one,) = says(
        "constraint-jacobian",
        held(a=a, c=lambda q: np.array([q[0] ** 2 + q[2], q[0] * q[1]])),
    )
    holds(one, "a", a(Q), c_q @ S, A_NAMES)
    by_v = held(a=a, c=lambda q, v: np.array([q[0] * v[0] - 2.0 * v[1], v[0] * v[1] + 1.0]))
    (one,) = says("constraint-jacobian", by_v)
    holds(one, "a", a(Q), [[Q[0], -2.0], [U_[1], U_[0]]], A_NAMES)


def test_constraints_of_velocities_are_a_v_and_b():
    own = {"a": a, "c": lambda q, v: np.array([v[0], q[0] * v[1]])}
    (one,) = says("constraint-velocity", held(**own))
    holds(one, "a v + b", a(Q) @ U_, [U_[0], Q[0] * U_[1]], TWO)
    (one,) = says("constraint-velocity", held(**own, b=lambda q, t: np.array([q[2], 0.4 - t])))
    holds(one, "a v + b", a(Q) @ U_ + [Q[2], 0.4], [U_[0], Q[0] * U_[1]], TWO)
    assert says("constraint-velocity", held(a=a, c=lambda q: q[:2])) == []


def test_the_drift_is_the_rate_of_a_v_and_b_with_speeds_held():
    rates = S @ U_
    drift = a_rate(Q, rates) @ U_
    own = {"a": a, "gamma": lambda q, v: np.array([v[0] ** 2, 3.0])}
    (one,) = says("constraint-drift", held(**own))
    holds(one, "γ", [U_[0] ** 2, 3.0], drift, TWO)
    assert isinstance(one, Comparison) and one.explain is proportional
    clock = {"b": lambda q, t: np.array([2.0 * t * q[0], q[1] ** 2 - 5.0 * t])}
    (one,) = says("constraint-drift", held(**own, **clock))
    clocked = drift + np.array([2.0 * Q[0], 2.0 * Q[1] * rates[1] - 5.0])
    holds(one, "γ", [U_[0] ** 2, 3.0], clocked, TWO)


def test_accelerations_keep_the_constraints_by_the_drift_that_is_given_or_follows():
    def udot(q: Any, u: Any) -> Any:
        return np.array([u[0] - 1.0, q[2]])

    drift = a_rate(Q, S @ U_) @ U_
    (one,) = says("constraint-acceleration", held(a=a, qdd=udot))
    holds(one, "a q̈ ~ -γ", a(Q) @ udot(Q, U_), -drift, TWO)
    given = held(a=a, qdd=udot, gamma=lambda q, v: np.array([0.3, -0.7]))
    (one,) = says("constraint-acceleration", given)
    holds(one, "a q̈ ~ -γ", a(Q) @ udot(Q, U_), [-0.3, 0.7], TWO)
    assert isinstance(one, Comparison) and one.explain is proportional


# ---- References ----------------------------------------------------------------------------------

BOOK: dict[str, Any] = {
    "M": lambda q: 2.0 * np.eye(3) + q[0],
    "bias": lambda q, v: v**2,
    "T": lambda q, v: 7.0 + q[0] * v[1],
    "a": lambda q: np.array([[1.0, q[1], 2.0]]),
    "gamma": lambda q, v: np.array([5.0 * v[2]]),
    "qdd": lambda q, v: q + 3.0 * v,
    "U": lambda q: q[0] ** 2 + 4.0 * q[2],
    "Q": lambda q, v: np.array([0.1, v[0], 0.2]),
}


def book(*names: str, **changed: Any) -> EquationsOfMotion:
    given = {name: BOOK[name] for name in names or BOOK} | changed
    return EquationsOfMotion(3, **given, name="a book")


def test_each_quantity_is_held_against_that_of_the_reference_at_the_same_state():
    line = {"a": lambda q: np.array([[0.5, 1.0, q[0]]]), "gamma": lambda q, v: v[:1] ** 2}
    energy = {"T": lambda q, v: 0.5 * v @ M(q) @ v}
    here = at(**TERMS, **FORCED, **line, **energy, against=book())
    here.caller("a", here.q, here.v)
    each = {one.subject.removesuffix(" ~ a book"): one for one in says("reference", here)}
    assert [*each] == ["M", "bias", "forces", "T", "a", "gamma", "qdd"]
    theirs = {name: f(Q, V) if name not in "MaU" else f(Q) for name, f in BOOK.items()}
    axis = ("0",)
    forces = theirs["Q"] - [2.0 * Q[0], 0.0, 4.0]
    for name, found, expected, names in [
        ("M", M(Q), theirs["M"], (ROWS, ROWS)),
        ("bias", bias(Q, V), theirs["bias"], (ROWS,)),
        ("forces", EXPECTED, forces, (ROWS,)),
        ("T", 0.5 * V @ M(Q) @ V, theirs["T"], ()),
        ("a", line["a"](Q), theirs["a"], (axis, ROWS)),
        ("gamma", V[:1] ** 2, theirs["gamma"], (axis,)),
    ]:
        holds(each[name], f"{name} ~ a book", found, expected, names)
        assert each[name].explain is proportional  # type: ignore[union-attr]
    # Accelerations where v keeps the constraints of the functions.
    row = line["a"](Q)[0]
    v = V - row * (row @ V) / (row @ row)
    holds(each["qdd"], "qdd ~ a book", qdd(Q, v), Q + 3.0 * v, (ROWS,))


def test_what_a_reference_cannot_tell_is_skipped_with_the_reason():
    def broken(q: Any, *v: Any) -> Any:
        raise ValueError("no licence")

    here = at(**TERMS, against=book("qdd", M=broken, bias=lambda q, v: v))
    first, *others = says("reference", here)
    assert first == Skipped("M ~ a book", "the reference breaks: M: ValueError: no licence")
    assert [type(one) for one in others] == [Comparison, Comparison]
    closed = {"a": lambda q: np.array([[1.0, 0.0, 0.0]]), "c": lambda q: np.array([q[0] ** 2 + 1])}
    (one,) = says("reference", at(qdd=qdd, **closed, against=book("qdd")))
    assert one == Skipped("qdd ~ a book", "no consistent state is found nearby")


def test_why_a_bias_does_not_follow_is_told_of_the_side_that_lacks_it():
    linear = {"T": lambda q, v: v @ v + v[0], "qdot": lambda q, u: u, "holonomic": True}
    built = {"M": M, "holonomic": False}
    for own, theirs, text in (
        (linear, {"bias": bias}, "T has terms that are not quadratic in v: bias would tell B"),
        ({"bias": bias}, linear, "T has terms that are not quadratic in v: bias would tell B"),
        (built, {"bias": bias}, "constraints may be built into M"),
        ({"bias": bias}, built, "constraints may be built into M"),
    ):
        here = at(**own, against=EquationsOfMotion(3, **theirs, name="a book"))
        (one,) = says("reference", here)
        assert isinstance(one, Skipped)
        assert one.subject == "bias ~ a book" and one.reason.startswith(text)


def test_a_reference_is_refused_where_it_answers_nowhere_with_what_breaks_first():
    def broken(q: Any, *v: Any) -> Any:
        raise ValueError("no licence" if q[0] > 0.0 else "below zero")

    def points(*x: float, **theirs: Any) -> list[FunctionState]:
        against = EquationsOfMotion(3, **theirs, name="a book")
        return [at(q=(y, 0.1, 0.2), **TERMS, against=against) for y in x]

    for x, why in (((0.3, -0.3), "no licence"), ((-0.3, 0.3), "below zero")):
        with pytest.raises(InputError) as told:
            check_reference(points(*x, M=broken, qdd=broken))
        said = f"against = a book: it does not answer in any state: M: ValueError: {why}"
        assert str(told.value) == said
    check_reference(points(0.3, -0.3, M=broken, qdd=qdd))
    there = {"M": lambda q: broken(q) if q[0] > 0.0 else np.eye(3)}
    check_reference(points(0.3, 0.4, -0.3, **there))
    check_reference(points(0.3, R=broken))  # of which nothing is compared


def test_where_a_clause_breaks_the_function_is_named_once():
    def broken(q: Any, *v: Any) -> Any:
        raise ValueError("no licence")

    here = at(M=M, qdd=broken, bias=bias)
    each = [[*claim_outputs(FUNCTION_CLAIMS[id], here)] for id in ("motion", "power-balance")]
    assert each == [
        [Skipped("qdd", "qdd breaks: ValueError: no licence")],
        [Skipped("qdd", "qdd does not answer")],
    ]
