"""Which function is wrong, by all that failed and passed together, and which of its terms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.testing.own import coriolis, given, guide

from eomcheck.claims.confusions import diagnose
from eomcheck.claims.finding import Finding
from eomcheck.testing import FUNCTION_CLAIMS, EquationsOfMotion, check_functions
from eomcheck.testing.claims_terms import proportional
from eomcheck.testing.equations_of_motion import INPUTS
from eomcheck.testing.fault_localization import READS, SETTLES, functions_read, settled_by
from eomcheck.testing.suite import claim_results

CART, DRIVE = guide("cart"), guide("drive")
PAIR = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, 1.0]])

EXPECTED = np.array([0.0, 1e-7, -2e-7])
EVERY: dict[str, Any] = dict.fromkeys(INPUTS, len)
"""All functions, none of which is called."""


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (0.5, "half the expected value (every row)"),
        (-1.0, "wrong sign (every row)"),
        (0.0, "missing (every row)"),
        (0.7, "0.7 times the expected value (every row)"),
        (0.7001, "0.7001 times the expected value (every row)"),
    ],
)
def test_a_factor_that_is_known_to_six_digits_has_one_text(factor: float, text: str):
    noise = np.array([5e-14, 5e-14, -3e-14])
    assert proportional(factor * EXPECTED + noise, EXPECTED, 1e-13, (1,)) == text


@pytest.mark.parametrize(
    ("factor", "text"),
    [
        (1.0 + 1e-7, "too large by 1.0e-07 of the expected value (every row)"),
        (1.0 - 3.2e-8, "too small by 3.2e-08 of the expected value (every row)"),
        (-1.0 - 1e-7, "wrong sign, and too large by 1.0e-07 of the expected value (every row)"),
        (-1.0 + 3e-8, "wrong sign, and too small by 3.0e-08 of the expected value (every row)"),
        (1.0 + 3e-10, "too large by 3e-10 of the expected value (every row)"),
        (1.0 + 1e-11, ""),  # less than is known of each row
        (1.0 + 1e-6, "1.000001 times the expected value (every row)"),
    ],
)
def test_a_factor_that_reads_as_one_is_a_relative_difference(factor: float, text: str):
    assert proportional(factor * EXPECTED, EXPECTED, 1e-18, (1,)) == text


def test_a_difference_from_one_has_as_many_digits_as_are_known():
    noise = 1e-10 * np.array([1.0, -1.0, 1.0])
    found = (1.0 + 3.4e-7) * EXPECTED / 2e-7 + noise
    assert (
        proportional(found, EXPECTED / 2e-7, 5e-8, (1,))
        == "too large by 3e-07 of the expected value (every row)"
    )


def test_a_factor_beyond_noise_is_another_one():
    assert proportional(0.50001 * EXPECTED, EXPECTED, 1e-13, (1,)).startswith("0.50001 times")
    assert proportional(EXPECTED * [1.0, 1.0, 0.5], EXPECTED, 1e-13, (1,)) == ""


def test_a_factor_of_which_not_one_digit_is_known_is_none():
    expected, found = np.array([-6.8, -4.08, 0.0]), np.array([-6.8, -2.04, 0.0])
    assert proportional(found, expected, 1.83, (1,)) == ""
    assert diagnose(found, expected, 1.83, (1,)) == "half the expected value"
    size = np.abs(EXPECTED).max()
    assert proportional(0.8 * EXPECTED, EXPECTED, 0.11 * size, (1,)) == ""
    found = proportional(0.8 * EXPECTED, EXPECTED, 0.09 * size, (1,))
    assert found == "0.8 times the expected value (every row)"


# ---- Which function ------------------------------------------------------------------------------


def failures(own: str, names: str, states: Any = 2, **changed: Any) -> list[Finding]:
    """Return the failures where functions of a guide are given by name, some of them changed."""
    functions = given(own) | changed
    kept = {x: f for x, f in functions.items() if x not in INPUTS or x in names.split()}
    return [x for x in check_functions(**kept, states=states) if x.verdict == "failed"]


def wrong_M(q):
    return CART.M(q) * PAIR


def solved(*forces: Callable) -> Callable:
    """Return q̈ of the cart with more forces."""
    return lambda q, v: CART.qdd(q, v) + np.linalg.solve(CART.M(q), sum(f(q, v) for f in forces))


def load(q, v):
    """Generalized forces that depend on q and v."""
    return np.array([0.1 * q[1], 0.0, 0.2 * v[0]])


class Wrong(NamedTuple):
    """A function that is wrong, among some that are given, and the conclusion."""

    own: str
    names: str
    changed: dict[str, Any]
    cause: str
    sentence: str


EVERYTHING = "M bias gravity qdd T U R Q a c gamma"

WRONG = {
    "M": Wrong(
        "cart",
        EVERYTHING,
        {"M": wrong_M},
        "M",
        "mass matrix M is wrong: bias-of-mass-matrix, bias-power, kinetic-energy and 1 more fail, "
        "bias-of-energy passes; kinetic-energy: entry (q[0], q[1]): wrong sign; bias, row q[0]: ",
    ),
    "M, and q̈ tells": Wrong(
        "cart",
        "M bias gravity qdd R",
        {"M": lambda q: CART.M(q) * 1.01},
        "M",
        "mass matrix M is wrong: bias-of-mass-matrix, bias-power, motion and 1 more fail; ",
    ),
    "M or bias": Wrong(
        "cart",
        "M bias",
        {"M": wrong_M},
        "M or bias",
        "mass matrix M or bias is wrong: T, qdd or against would tell; ",
    ),
    "bias": Wrong(
        "cart",
        "M T bias",
        {"bias": lambda q, v: CART.bias(q, v) / 2},
        "bias",
        "bias is wrong: bias-of-mass-matrix, bias-power and bias-of-energy fail, kinetic-energy "
        "passes; bias, row q[",
    ),
    "T": Wrong(
        "cart",
        EVERYTHING,
        {"T": lambda q, v: 2 * CART.T(q, v)},
        "T",
        "kinetic energy T is wrong: kinetic-energy, bias-of-energy and power-balance fail; mass "
        "matrix, entry (q[",
    ),
    "C": Wrong(
        "cart",
        "M bias C",
        {"C": lambda q, v: coriolis(q, v).T},
        "C",
        "Coriolis matrix C is wrong: coriolis-bias fails, bias-of-mass-matrix passes; ",
    ),
    "U": Wrong(
        "cart",
        "qdd T U R",
        {"U": lambda q: -CART.U(q)},
        "qdd or U",
        "acceleration qdd or potential energy U is wrong: gravity or against would tell; ",
    ),
    "U at another angle": Wrong(
        "cart",
        "qdd T U R",
        {"U": lambda q: CART.U(q + np.array([0.0, 0.3, 0.1]))},
        "qdd or U",
        "acceleration qdd or potential energy U is wrong: gravity or against would tell; ",
    ),
    "gravity, not the load beside it": Wrong(
        "cart",
        "M bias gravity qdd R Q",
        {
            "gravity": lambda q: 2 * CART.gravity(q),
            "Q": lambda q, v: np.array([0.1, 0.0, 0.2]),
            "qdd": solved(lambda q, v: np.array([0.1, 0.0, 0.2])),
        },
        "gravity or qdd",
        "gravity or acceleration qdd is wrong: U or against would tell; ",
    ),
    "Q": Wrong(
        "cart",
        "M bias gravity qdd R Q",
        {"Q": lambda q, v: -load(q, v), "qdd": solved(load)},
        "qdd or Q",
        "acceleration qdd or generalized forces Q is wrong: against would tell; "
        "equations of motion, row q[2]: off by Q: its sign is another one in q̈",
    ),
    "R": Wrong(
        "cart",
        EVERYTHING,
        {"R": lambda q, v: 2 * CART.R(q, v)},
        "qdd or R",
        "acceleration qdd or dissipation function R is wrong: against would tell; ",
    ),
    "q̈": Wrong(
        "cart",
        "M bias gravity qdd R",
        {"qdd": solved(CART.bias)},
        "qdd",
        "acceleration qdd is wrong: motion and power-balance fail, bias-of-mass-matrix passes; ",
    ),
    "gamma": Wrong(
        "drive",
        "M a c gamma qdd",
        {"gamma": lambda q, v: -DRIVE.gamma(q, v)},
        "gamma",
        "constraint drift gamma is wrong: constraint-drift and constraint-acceleration fail, "
        "constraint-jacobian passes; ",
    ),
    "gravity that raises": Wrong(
        "cart", EVERYTHING, {"gravity": lambda q: q[9]}, "gravity", "gravity, IndexError: "
    ),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.sampled(2)
def test_the_first_failure_says_which_function_is_wrong(name: str):
    wrong = WRONG[name]
    first, *others = failures(wrong.own, wrong.names, **wrong.changed)
    assert first.detail.startswith(wrong.sentence), first.detail
    assert (first.cause, first.follows) == (wrong.cause, "")
    for one in others:
        assert (one.cause, one.follows) == (wrong.cause, first.claim)
        assert str(one).startswith(f"  follows from {wrong.cause}: {one.claim} [")
        assert one.as_dict()["follows"] == first.claim
    assert first.as_dict()["cause"] == wrong.cause and "follows" not in first.as_dict()


def test_a_reference_clears_what_it_agrees_with():
    right = given("cart")
    against = EquationsOfMotion(right["n"], M=CART.M)
    first, *_ = failures("cart", "M bias", M=wrong_M, against=against)
    assert first.cause == "M"
    first, *_ = failures("cart", "M bias", bias=lambda q, v: -CART.bias(q, v), against=against)
    assert first.cause == "bias"


def test_two_wrong_functions_are_two_conclusions():
    changed = {"M": lambda q: np.triu(CART.M(q)), "R": lambda q, v: -CART.R(q, v)}
    found = failures("cart", "M R", **changed)
    assert [(x.claim, x.cause, x.follows) for x in found if not x.follows] == [
        ("mass-matrix-symmetric", "M", ""),
        ("dissipation-positive", "R", ""),
    ]


def test_what_a_certain_cause_explains_has_no_other_cause():
    """Gravity in the bias leaves a constant in the equations of motion, unlike any other bias."""
    wrong = {"bias": lambda q, v: CART.bias(q, v) + CART.gravity(q)}
    found = failures("cart", EVERYTHING, **wrong)
    assert found[0].claim == "bias-at-rest"
    assert {(x.cause, x.follows) for x in found[1:]} == {("bias", "bias-at-rest")}


def test_a_failure_that_follows_is_folded_in_a_test_suite():
    found = failures("cart", "M T bias", M=wrong_M)
    ids = [x.claim for x in found]
    results = claim_results(ids, found, ())
    assert "to see it again" in results[ids[0]].text
    why = f"follows from M, see {ids[0]}\n"
    assert all(results[x].text.startswith(f"{why}{x} [") for x in ids[1:])
    assert not any("to see it again" in results[x].text for x in ids[1:])
    known = claim_results(ids, found, {ids[0]})
    assert "to see it again" in known[ids[1]].text


def test_a_failing_test_counts_the_comparisons_that_failed():
    found = check_functions(1, M=lambda q: [[-1.0]], claims=["mass-matrix-positive"], states=1)
    each = dict.fromkeys(("failed", "inconclusive", "passed", "skipped"), found[0])
    findings = [replace(one, verdict=verdict) for verdict, one in each.items()]
    findings.append(findings[0])
    text = claim_results([found[0].claim], findings, ())[found[0].claim].text
    assert "\nfailed in 2 of 5 comparisons; to see it again:" in text
    alone = claim_results([found[0].claim], findings[:1], ())[found[0].claim].text
    assert " comparisons; " not in alone


def test_what_passes_is_as_it_was():
    found = check_functions(**given("cart"), states=1)
    assert {(x.cause, x.follows) for x in found} == {("", "")}
    assert not any({"cause", "follows"} & {*x.as_dict()} for x in found)


def test_every_claim_reads_the_functions_it_needs():
    functions = EquationsOfMotion(2, **EVERY)
    for id, claim in FUNCTION_CLAIMS.items():
        needs = {x.split("|")[0] for x in claim.needs} & {*INPUTS}
        subject = "M ~ cart" if id == "reference" else "M"
        assert functions_read(functions, id, subject) >= (needs or {"M"}), id
    assert {*READS, *SETTLES} <= {*FUNCTION_CLAIMS}
    assert functions_read(functions, "reference", "forces ~ cart") == {"gravity", "R", "Q"}
    unconstrained = replace(functions, **dict.fromkeys(("a", "b", "c", "gamma")))
    forces = {"gravity", "R", "Q", "qdot"}
    assert functions_read(unconstrained, "motion") == {"qdd", "M", "bias"} | forces
    assert functions_read(unconstrained, "power-balance") >= {"qdd"} | forces
    for id in ("velocity", "drift", "acceleration"):
        assert functions_read(functions, f"constraint-{id}") >= {"a", "b"}
    by_rates = ("bias-of-mass-matrix", "bias-power", "coriolis-bias", "gravity-of-potential")
    for id in (*by_rates, "constraint-jacobian", "constraint-drift", "constraint-acceleration"):
        assert "qdot" in functions_read(functions, id), id


def test_equations_of_motion_that_hold_clear_all_they_read_but_the_acceleration():
    functions = EquationsOfMotion(2, **EVERY)
    passed = Finding("motion", "qdd", functions, None, 0.0, 1.0, "passed", "")
    read = {"M", "bias", "gravity", "R", "Q", "a"}
    assert settled_by([passed]) == dict.fromkeys(read, "motion")
    failed = replace(passed, verdict="failed")
    assert (
        settled_by([failed, passed]) == settled_by([replace(passed, verdict="inconclusive")]) == {}
    )
    without = EquationsOfMotion(2, T=len, bias=len, qdd=len, bias_has_gravity=True)
    assert functions_read(without, "motion") == {"T", "bias", "qdd"}


# ---- A kinetic energy that is none ---------------------------------------------------------------

REST = "T(q, 0) changes with q; is the potential energy in it?"


@pytest.mark.parametrize(
    "more", [lambda q: -CART.U(q), lambda q: q[0] ** 2], ids=["a Lagrangian", "a term of q"]
)
def test_a_right_bias_is_cleared_where_the_kinetic_energy_has_another_one(more: Callable):
    changed = {"T": lambda q, v: CART.T(q, v) + more(q), "claims": None}
    first, *others = failures("cart", "M bias gravity T U", **changed)
    wrong = "kinetic energy T is wrong: bias-of-energy fails, bias-of-mass-matrix passes"
    assert first.detail.startswith(f"{wrong}; {REST}; bias, row "), first.detail
    assert (first.cause, others) == ("T", [])
    assert first.detail.endswith("; the difference does not depend on v")
    assert "in its place" not in first.detail


def test_where_the_bias_is_not_cleared_the_energy_at_rest_is_named_beside_it():
    changed = {"T": lambda q, v: CART.T(q, v) + q[0] ** 2}
    first, *_ = failures("cart", "bias T", **changed)
    either = "bias or kinetic energy T is wrong: M, qdd or against would tell"
    assert first.detail.startswith(f"{either}; {REST}; ")
    assert first.detail.endswith("; the difference does not depend on v")


@pytest.mark.parametrize(
    ("names", "cause"), [("qdd T U R", "qdd or T or U"), ("M gravity qdd T U R", "qdd or T")]
)
def test_a_lagrangian_is_suspect_of_the_equations_of_motion_that_follow_from_it(
    names: str, cause: str
):
    (motion,) = failures("cart", names, T=lambda q, v: CART.T(q, v) - CART.U(q))
    assert motion.cause == cause
    assert f"; {REST}; " in motion.detail


def test_gravity_in_the_bias_and_in_the_kinetic_energy_is_not_a_wrong_acceleration():
    changed = {
        "T": lambda q, v: CART.T(q, v) - CART.U(q),
        "bias": lambda q, v: CART.bias(q, v) + CART.gravity(q),
    }
    first, *_ = failures("cart", "M bias gravity qdd T U R", **changed)
    assert (first.claim, first.cause) == ("motion", "bias or qdd")
    assert f"; {REST}; " in first.detail


def test_a_lagrangian_alone_is_told_as_nothing_that_can_be_judged():
    given_ = {"n": 3, "U": CART.U, "states": 1, "claims": ["energy-quadratic"]}
    for T in (CART.T, lambda q, v: CART.T(q, v) + 1.0):
        assert [x.verdict for x in check_functions(T=T, **given_)] == ["passed"]

    def lagrangian(q, v):
        return CART.T(q, v) - CART.U(q)

    _, told = check_functions(T=lagrangian, **given_)
    assert (told.subject, told.verdict) == ("T at rest", "skipped")
    assert told.detail == f"{REST} bias, qdd or against would tell"
    assert len(check_functions(T=lagrangian, bias=CART.bias, **given_)) == 1  # which tells


def hoop(**changed: Callable) -> dict[str, Any]:
    """Return the functions of two beads on a hoop that is turned at a constant rate."""
    turn = 1.5

    def pull(q: Any) -> Any:
        return turn**2 * np.sin(q) * np.cos(q)

    return {
        "M": lambda q: 2.0 * np.eye(2),
        "T": lambda q, v: v @ v + turn**2 * np.sin(q) @ np.sin(q),
        "bias": lambda q, v: -2.0 * pull(q),
        "qdd": lambda q, v: pull(q),
    } | changed


def test_a_system_that_a_clock_drives_has_no_failure_and_the_bias_of_its_energy():
    found = check_functions(2, **hoop(), states=3)
    assert not [x for x in found if x.verdict == "failed"]
    verdicts = {x.claim: x.verdict for x in found}
    assert verdicts["bias-of-mass-matrix"] == "skipped"
    assert verdicts["bias-of-energy"] == "passed"
    (why,) = {x.detail for x in found if x.claim == "bias-of-mass-matrix"}
    assert why == REST


def test_terms_of_the_bias_are_told_beside_those_that_a_clock_leaves():
    wrong = hoop(bias=lambda q, v: hoop()["bias"](q, v) + v**2 * [0.5, 0.0])
    found = check_functions(2, **wrong, states=[([0.4, 0.9], [0.8, -0.3])])
    first = next(x for x in found if x.verdict == "failed")
    (term,) = (x for x in first.detail.split("; ") if "v[0]²" in x)
    assert term == "row q[0], v[0]²: should vanish: got 0.5"


def test_a_difference_at_rest_is_no_difference_that_does_not_depend_on_the_velocity():
    def wrong(q, v):
        return CART.bias(q, v) + np.array([0.3 + 0.2 * v[0] ** 2, 0.0, 0.0])

    found = failures("cart", "M bias", [([0.3, 0.7, -0.4], [0.0, 0.0, 0.0])], bias=wrong)
    (first,) = (x for x in found if x.claim == "bias-of-mass-matrix")
    assert first.detail.endswith("; row q[0], v[0]²: should vanish: got 0.2")


def test_a_bias_that_lacks_what_a_clock_leaves_is_not_cleared_by_the_mass_matrix():
    """A mass on a turntable: Coriolis' force is in T, not in M."""

    def T(q, v):
        return (v[0] - 1.5 * q[1]) ** 2 + (v[1] + 1.5 * q[0]) ** 2

    model = {"M": lambda q: 2.0 * np.eye(2), "T": T, "bias": lambda q, v: 0.0 * q}
    first, *_ = (x for x in check_functions(2, **model, states=2) if x.verdict == "failed")
    assert first.cause == "bias or T"
    assert first.detail.startswith("bias or kinetic energy T is wrong: qdd or against would tell")
    assert "potential energy" not in first.detail


def test_a_claim_settles_nothing_that_is_unsettled():
    functions = EquationsOfMotion(2, **EVERY)
    passed = Finding("kinetic-energy", "M", functions, None, 0.0, 1.0, "passed", "")
    assert settled_by([passed]) == dict.fromkeys(("M", "T"), "kinetic-energy")
    assert settled_by([passed], {("kinetic-energy", "T")}) == {"M": "kinetic-energy"}
    assert settled_by([passed], {("motion", "T")}) == settled_by([passed])


# ---- Which term ----------------------------------------------------------------------------------


def bias(q, v):
    """Bias of two links, relative angles."""
    s = np.sin(q[1])
    return np.array([-s * (2 * v[0] * v[1] + v[1] ** 2), s * v[0] ** 2])


def M(q):
    c = np.cos(q[1])
    return np.array([[3.0 + 2 * c, 1.0 + c], [1.0 + c, 1.0]])


def with_term(row: int, change: Callable) -> Callable:
    """Return the bias with something more in a row, in multiples of sin q[1]."""

    def wrong(q, v):
        found = bias(q, v)
        found[row] += np.sin(q[1]) * change(v)
        return found

    return wrong


TERMS = {
    "v[0]²: wrong sign: got -0.479426, expected 0.479426": (1, lambda v: -2 * v[0] ** 2),
    "v[0] v[1]: half the expected value: got -0.479426, expected -0.958851": (
        0,
        lambda v: v[0] * v[1],
    ),
    "v[1]²: twice the expected value: got -0.958851, expected -0.479426": (
        0,
        lambda v: -(v[1] ** 2),
    ),
    "v[0] v[1]: missing: expected -0.958851": (0, lambda v: 2 * v[0] * v[1]),
    "v[0] v[1]: missing, v[0]² in its place: -0.958851": (
        0,
        lambda v: 2 * v[0] * v[1] - 2 * v[0] ** 2,
    ),
    "v[1]²: should vanish: got 0.479426": (1, lambda v: v[1] ** 2),
    "v[1]²: got -0.335598, expected -0.479426": (0, lambda v: 0.3 * v[1] ** 2),
}


@pytest.mark.parametrize("text", TERMS)
def test_a_wrong_term_of_the_bias_is_named(text: str):
    row, change = TERMS[text]
    state = ([0.3, 0.5], [0.7, -0.4])
    for last in (1.0, 10.0):  # of the ranges: they are not of one size
        ranges = [(-1.0, 1.0)] * 3 + [(-last, last)]
        wrong = with_term(row, change)
        found = check_functions(2, M=M, bias=wrong, states=[state], ranges=ranges)
        first = next(x for x in found if x.verdict == "failed")
        assert first.detail.count("row q[") == 2
        assert first.detail.endswith(f"; row q[{row}], {text}"), first.detail


def test_no_term_is_listed_where_every_row_is_wrong_in_proportion_beside_a_jump_too():
    def wrong(q, v):
        return bias(q, v) * (0.7 if q[1] < 0.5 + 1e-5 else 1.0)

    for of, jump in ((lambda q, v: 0.7 * bias(q, v), ""), (wrong, "; bias jumps within 0.001")):
        found = check_functions(2, M=M, bias=of, states=[([0.3, 0.5], [0.7, -0.4])])
        (failed,) = (x for x in found if x.verdict == "failed" and x.claim == "bias-of-mass-matrix")
        assert f"0.7 times the expected value (every row){jump}" in failed.detail
        assert "row q[" not in failed.detail.partition("(every row)")[2]


def test_a_term_that_is_lost_beside_another_wrong_one_is_not_in_its_place():
    wrong = with_term(0, lambda v: 2 * v[0] * v[1] + 0.3 * v[1] ** 2)
    found = check_functions(2, M=M, bias=wrong, states=[([0.3, 0.5], [0.7, -0.4])])
    first = next(x for x in found if x.verdict == "failed")
    assert "row q[0], v[0] v[1]: missing: expected -0.958851; " in first.detail
    assert first.detail.endswith("; row q[0], v[1]²: got -0.335598, expected -0.479426")


@pytest.mark.parametrize(
    ("forces", "text"),
    [
        (lambda q, v: [0.0, 0.1, 0.3], "constant in v: a force"),
        (lambda q, v: [0.0, 0.2 * v[0], 0.1 * v[2]], "odd in v: damping"),
        (lambda q, v: [0.0, 0.2 * v[0] ** 2, v[1] * v[2]], "even in v, 0 at rest: bias"),
        (lambda q, v: [0.0, 0.2 * v[0], 0.1], ""),
    ],
)
def test_what_a_motion_is_off_by_is_told_by_how_it_depends_on_v(forces: Callable, text: str):
    found = failures(
        "cart", "M bias gravity R qdd", qdd=solved(lambda q, v: np.array(forces(q, v)))
    )
    (motion,) = (x for x in found if x.claim == "motion")
    assert motion.detail.endswith(f"; the difference is {text}") == bool(text)
    assert "qdd" in motion.cause


def test_what_a_motion_is_off_by_is_told_at_the_velocity_where_it_fails():
    """Also where the same coordinates are a state at rest, where no damping is felt."""
    damped = solved(lambda q, v: np.array([0.0, 0.2 * v[0], 0.1 * v[2]]))
    q, v = np.array([0.3, 0.7, -0.4]), np.array([0.5, -0.8, 0.9])
    changed = {"qdd": damped, "claims": ["motion"]}
    (motion,) = failures("cart", "M bias gravity R qdd", [(q, v), (q, 0.0 * v)], **changed)
    assert motion.detail.endswith("; the difference is odd in v: damping")
