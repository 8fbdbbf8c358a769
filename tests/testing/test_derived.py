"""Quantities that follow from others count as given: q̈ is held against all that is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.testing.own import coriolis, given, guide

from eomcheck.claims.finding import Finding
from eomcheck.testing import EquationsOfMotion, check_functions

CART, DRIVE = guide("cart"), guide("drive")

ALL = given("cart") | {"C": coriolis}


def without_work(q, v):
    """A force across v, quadratic in v, that does no work: no balance of energy shows it."""
    turn = np.array([[0.0, 0.3, 0.0], [-0.3, 0.0, 0.1], [0.0, -0.1, 0.0]]) * (v[2] * np.cos(q[0]))
    return turn @ v


def wrong_qdd(q, v):
    return CART.qdd(q, v) + np.linalg.solve(CART.M(q), without_work(q, v))


def only(*names: str, **changes: Any) -> dict[str, Any]:
    """Functions of the cart of these names, and `changes`."""
    return {"n": 3} | {name: ALL[name] for name in names} | changes


def verdicts(findings: list[Finding]) -> dict[str, str]:
    return {x.claim: x.verdict for x in findings}


SUFFICE = [
    ("M", "gravity", "R"),
    ("T", "gravity", "R"),
    ("M", "T", "gravity", "U", "R"),
    ("M", "C", "gravity", "R"),
    ("T", "C", "U", "R"),
    ("M", "bias", "U", "R"),
    ("T", "bias", "U", "R"),
]


@pytest.mark.parametrize("names", SUFFICE, ids="-".join)
@pytest.mark.sampled(2)
def test_accelerations_are_checked_wherever_inputs_suffice(names: tuple[str, ...]):
    claims = ["motion", "power-balance"]
    right = verdicts(check_functions(**only(*names, "qdd"), states=2, claims=claims))
    assert right == dict.fromkeys(claims, "passed")
    wrong = check_functions(**only(*names, qdd=wrong_qdd), states=2, claims=claims)
    assert verdicts(wrong) == {"motion": "failed", "power-balance": "passed"}


@pytest.mark.parametrize("names", [("M", "bias"), ("T", "bias")], ids="-".join)
def test_a_bias_is_checked_whichever_tells_it(names: tuple[str, ...]):
    def wrong(q, v):
        return CART.bias(q, v) * 1.001

    claims = ["bias-power", "coriolis-bias"]
    options = {"states": 2, "claims": claims}
    right = check_functions(**only(*names, "C"), **options)
    assert verdicts(right) == dict.fromkeys(claims, "passed")
    failed = check_functions(**only(*names, "C", bias=wrong), **options)
    assert verdicts(failed) == dict.fromkeys(claims, "failed")


@pytest.mark.parametrize("name", ["M", "T"])
def test_a_coriolis_matrix_is_checked_whichever_tells_it(name: str):
    def wrong(q, v):
        return coriolis(q, v) + 1e-6 * v[0] * np.eye(3)

    claims = ["coriolis-bias", "coriolis-skew"]
    right = check_functions(**only(name, "C"), states=2, claims=claims)
    assert verdicts(right) == dict.fromkeys(claims, "passed")
    failed = check_functions(**only(name, C=wrong), states=2, claims=claims)
    assert verdicts(failed) == dict.fromkeys(claims, "failed")


def test_where_constraints_are_built_in_it_says_that_the_bias_would_tell():
    findings = check_functions(
        **only("M", "gravity", "R", qdd=wrong_qdd), holonomic=False, states=1
    )
    (skipped,) = [x for x in findings if x.claim == "motion"]
    assert skipped.verdict == "skipped"
    assert skipped.detail == (
        "constraints may be built into M, which then does not determine B: "
        "pass bias or C, or holonomic=True if none are"
    )


def test_where_the_energy_has_linear_terms_with_speeds_it_says_that_the_bias_would_tell():
    def T(q, u):
        return u @ u / 2 + q[0] * u[1]

    model = {"T": T, "qdot": lambda q, u: u, "qdd": lambda q, u: 0.0 * u}
    findings = check_functions(2, **model, holonomic=True, states=2)
    (skipped,) = [x for x in findings if x.claim == "motion"]
    assert skipped.detail == "T has terms that are not quadratic in v: bias would tell B"


def test_linear_terms_of_the_energy_are_in_the_bias_that_follows():
    """In coordinates that turn there is a Coriolis force, which M does not tell but T does."""
    turn, m = 1.5, 2.0

    def T(q, v):
        return m / 2 * ((v[0] - turn * q[1]) ** 2 + (v[1] + turn * q[0]) ** 2)

    def qdd(q, v, share=1.0):
        return turn**2 * q - share * 2 * turn * np.array([-v[1], v[0]])

    for M in (None, lambda q: m * np.eye(2)):
        right = check_functions(2, M=M, T=T, qdd=qdd, states=2, claims=["motion"])
        assert verdicts(right) == {"motion": "passed"}
        half = check_functions(
            2, M=M, T=T, qdd=lambda q, v: qdd(q, v, 0.5), states=2, claims=["motion"]
        )
        assert verdicts(half) == {"motion": "failed"}


UNTOLD = [
    (("U",), {}, "a potential energy that is too large or too small", "gravity, qdd with M or T"),
    (("U", "qdd"), {}, "a potential energy that is too large or too small", "gravity, M or T"),
    (("R", "M"), {}, "damping of wrong sign or size", "qdd"),
    (("qdd",), {}, "whether q̈ belongs to the terms", "M or T"),
]


@pytest.mark.parametrize(("names", "more", "what", "missing"), UNTOLD)
def test_what_is_missing_is_named(names, more, what: str, missing: str):
    findings = check_functions(**only(*names), **more, states=2)
    details = [x.detail for x in findings if x.verdict == "skipped"]
    assert f"{what}: {missing} or against would tell" in details


def test_nothing_is_called_missing_where_it_follows():
    findings = check_functions(**only("T", "U", "R", "qdd"), states=2)
    assert {x.claim for x in findings if x.verdict == "skipped"} == {"reference"}


# ---- Constraints ---------------------------------------------------------------------------------


def slipping(q, v):
    """Accelerations of the drive that leave the drift out, so that wheels start to slip."""
    A = DRIVE.a(q)
    full = np.block([[DRIVE.M(q), -A.T], [A, np.zeros((5, 5))]])
    bearings = np.array([0.0, 0.0, 0.0, DRIVE.k * v[3], DRIVE.k * v[4], 0.0, 0.0])
    force = DRIVE.Q(q, v) - DRIVE.bias(q, v) - bearings
    return np.linalg.solve(full, np.concatenate((force, np.zeros(5))))[:7]


def test_accelerations_keep_the_constraints_whether_their_drift_is_given_or_not():
    claims = ["constraint-acceleration"]
    for gamma in (DRIVE.gamma, None):
        own = given("drive") | {"gamma": gamma}
        right = check_functions(**own, states=2, claims=claims)
        assert verdicts(right) == {"constraint-acceleration": "passed"}
        wrong = check_functions(**(own | {"qdd": slipping}), states=2, claims=claims)
        assert verdicts(wrong) == {"constraint-acceleration": "failed"}


@pytest.mark.parametrize("reads_q", [False, True])
def test_what_a_clock_drives_is_in_the_drift_that_follows(reads_q: bool):
    """Two carts whose distance a clock drives: q̈ keeps it only with ḃ."""

    def b(t):
        return np.array([np.sin(3 * t + 0.2)])

    def b_of_q(q, t):
        return np.array([q[0] * np.cos(t + 0.5)])

    def qdd(q, v, share=1.0):
        drift = v[0] * np.cos(0.5) - q[0] * np.sin(0.5) if reads_q else 3 * np.cos(0.2)
        return -share * drift / 2 * np.array([1.0, -1.0])

    model = {"a": lambda q: np.array([[1.0, -1.0]]), "b": b_of_q if reads_q else b}
    claims = ["constraint-acceleration"]
    right = check_functions(2, **model, qdd=qdd, states=2, claims=claims)
    assert verdicts(right) == {"constraint-acceleration": "passed"}
    wrong = check_functions(2, **model, qdd=lambda q, v: qdd(q, v, 0.9), states=2, claims=claims)
    assert verdicts(wrong) == {"constraint-acceleration": "failed"}


def test_a_jacobian_that_shakes_too_fast_is_inconclusive_and_passes_nothing():
    def a(q):
        return np.array([[1.0, np.sin(1e7 * q[0])]])

    model = {"a": a, "qdd": lambda q, v: np.array([1.0, -1.0])}
    findings = check_functions(2, **model, states=2, claims=["constraint-acceleration"])
    assert verdicts(findings) == {"constraint-acceleration": "inconclusive"}


def test_constraints_without_their_jacobian_are_said_to_need_it():
    findings = check_functions(**(given("drive") | {"a": None, "gamma": None}), states=2)
    said = {x.claim: (x.verdict, x.detail) for x in findings}
    for claim in ("motion", "power-balance"):
        detail = "c is given without a: a would tell which states and motions it allows"
        assert said[claim] == ("skipped", detail)


# ---- References ----------------------------------------------------------------------------------


def test_what_follows_is_compared_with_what_the_reference_has():
    """M of T, B of M, and γ of a, each against what a reference has itself."""
    cart = EquationsOfMotion(3, M=CART.M, bias=CART.bias, name="a book")
    drive = EquationsOfMotion(7, gamma=DRIVE.gamma, name="a book")
    own = [
        ({"n": 3, "T": CART.T}, cart, ["M", "bias"]),
        ({"n": 3, "M": CART.M}, cart, ["M"]),
        ({"n": 3, "M": CART.M}, EquationsOfMotion(3, bias=CART.bias, name="a book"), ["bias"]),
        ({"n": 7, "a": DRIVE.a}, drive, ["gamma"]),
    ]
    for functions, against, names in own:
        (name,) = set(functions) - {"n"}
        wrong = functions | {name: lambda *x, f=functions[name]: 1.001 * f(*x)}
        options = {"against": against, "states": 2, "claims": ["reference"]}
        for given_, verdict in ((functions, "passed"), (wrong, "failed")):
            findings = check_functions(**given_, **options)
            assert {x.subject: x.verdict for x in findings} == {
                f"{one} ~ a book": verdict for one in names
            }


def test_what_neither_gives_is_not_derived_from_both():
    against = EquationsOfMotion(3, T=CART.T, name="a book")
    findings = check_functions(3, T=CART.T, against=against, states=1, claims=["reference"])
    assert [x.subject for x in findings] == ["T ~ a book"]


def test_a_bias_that_does_not_follow_is_skipped_with_the_reason():
    against = EquationsOfMotion(3, bias=CART.bias, name="a book")
    options = {"against": against, "states": 1, "claims": ["reference"], "holonomic": False}
    (skipped,) = check_functions(3, M=CART.M, **options)
    assert (skipped.subject, skipped.verdict) == ("bias ~ a book", "skipped")
    assert "pass bias or C" in skipped.detail
