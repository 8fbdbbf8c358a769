"""The files of the guide pass, and what is planted in them is named or told as not tellable."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.testing.own import GUIDES, coriolis, given, guide

from eomcheck.testing import check_functions

CART, DRIVE = guide("cart"), guide("drive")


def in_single(f: Callable) -> Callable:
    """Return the same function of numbers rounded to single precision, which answers in doubles."""
    return lambda *x: np.float64(f(*(np.asarray(y, np.float32) for y in x))).astype(np.float64)


def solved(q, v, forces):
    return np.linalg.solve(CART.M(q), forces)


def friction(v):
    return np.array([0.0, 0.0, 0.0, DRIVE.k * v[3], DRIVE.k * v[4], 0.0, 0.0])


def driven(q, v, Q=None, gamma=None):
    A, damping = DRIVE.a(q), friction(v)
    full = np.block([[DRIVE.M(q), -A.T], [A, np.zeros((5, 5))]])
    force = (DRIVE.Q(q, v) if Q is None else Q) - DRIVE.bias(q, v) - damping
    drift = DRIVE.gamma(q, v) if gamma is None else gamma
    return np.linalg.solve(full, np.concatenate((force, -drift)))[:7]


def added(f: Callable, index: tuple[int, ...], change: Callable) -> Callable:
    """Return f with `change(q, v)` added to an entry."""

    def wrong(q, *v):
        found = np.array(f(q, *v))
        found[index] += change(q, *v)
        return found

    return wrong


class Stale:
    """Gravity that is kept from the last call of `bias`, wherever that was."""

    def __init__(self):
        self.q = np.zeros(3)

    def bias(self, q, v):
        self.q = q
        return CART.bias(q, v)

    def gravity(self, q):
        return CART.gravity(self.q)


def stale() -> dict[str, Any]:
    one = Stale()
    return {"bias": one.bias, "gravity": one.gravity}


class Fault(NamedTuple):
    """A fault, and what is said of it.

    Attributes:
        own: the file of the guide.
        change: what replaces functions; None leaves one out.
        claim: the claim that fails first.
        detail: what its detail contains.
    """

    own: str
    change: dict[str, Any]
    claim: str
    detail: str


def cart_bias(q, v):
    return -CART.bias(q, v) - CART.gravity(q)


FAULTS: dict[str, Fault] = {
    "upper triangle only": Fault(
        "cart",
        {"M": lambda q: np.triu(CART.M(q))},
        "mass-matrix-symmetric",
        "the lower triangle is empty",
    ),
    "armature": Fault(
        "cart",
        {"M": lambda q: CART.M(q) + np.diag([0.0, 0.01, 0.02])},
        "kinetic-energy",
        "on the diagonal 0, 0.01, 0.02 too large, nothing elsewhere: armature?",
    ),
    "half bias": Fault(
        "cart",
        {"bias": lambda q, v: CART.bias(q, v) / 2},
        "bias-of-mass-matrix",
        "half the expected value (every row)",
    ),
    "sign of bias": Fault(
        "cart",
        {"bias": lambda q, v: -CART.bias(q, v)},
        "bias-of-mass-matrix",
        "wrong sign (every row)",
    ),
    "sign of one term of the bias": Fault(
        "cart",
        {
            "bias": added(
                CART.bias,
                (1,),
                lambda q, v: -2 * CART.m2 * CART.l1 * CART.l2 * np.sin(q[1] - q[2]) * v[2] ** 2,
            )
        },
        "bias-of-mass-matrix",
        "row q[1]: wrong sign",
    ),
    "gravity in bias": Fault(
        "cart",
        {"bias": lambda q, v: CART.bias(q, v) + CART.gravity(q)},
        "bias-at-rest",
        "it is ∂U/∂q: gravity is in the bias",
    ),
    "gravity in bias, nothing else known": Fault(
        "cart",
        {
            "bias": lambda q, v: CART.bias(q, v) + CART.gravity(q),
            **dict.fromkeys(("gravity", "U", "qdd", "T", "R")),
        },
        "bias-at-rest",
        "has a potential: gravity in it?",
    ),
    "damping in bias": Fault(
        "cart",
        {"bias": lambda q, v: CART.bias(q, v) + np.array([CART.d * v[0], 0, 0])},
        "bias-quadratic",
        "row q[0]",
    ),
    "9.80665": Fault(
        "cart",
        {"gravity": lambda q: CART.gravity(q) * 9.80665 / CART.g},
        "gravity-of-potential",
        "0.9996585 times the expected value (every row)",
    ),
    "sign of gravity": Fault(
        "cart", {"gravity": lambda q: -CART.gravity(q)}, "gravity-of-potential", "sign"
    ),
    "sine for cosine in gravity": Fault(
        "cart",
        {"gravity": added(CART.gravity, (1,), lambda q: 0.3 * np.cos(q[2]))},
        "gravity-potential",
        "row q[2] changes by 0 per q[1], and row q[1] by",
    ),
    "sign of one entry of M": Fault(
        "cart",
        {"M": lambda q: CART.M(q) * np.array([[1, -1, 1], [1, 1, 1], [1, 1, 1]])},
        "mass-matrix-symmetric",
        ": opposite sign in one of them",
    ),
    "another entry across the diagonal": Fault(
        "cart",
        {"M": lambda q: CART.M(q) + 0.5 * np.outer(np.eye(3)[0], np.eye(3)[2])},
        "mass-matrix-symmetric",
        ", and entry (q[",
    ),
    "sign of one row of gravity that has two": Fault(
        "cart",
        {
            "gravity": lambda q: (
                CART.gravity(q) + np.array([0.0, np.sin(q[2]), -q[1] * np.cos(q[2])])
            ),
            "U": None,
        },
        "gravity-potential",
        ": opposite sign in one of them",
    ),
    "gravity among the loads and as U": Fault(
        "cart",
        {"Q": lambda q, v: -CART.gravity(q), "gravity": None},
        "motion",
        "off by Q: it is not in q̈, or it is in two of the other functions",
    ),
    "damping twice in q̈": Fault(
        "cart",
        {"qdd": lambda q, v: CART.qdd(q, v) - solved(q, v, np.array([CART.d * v[0], 0, 0]))},
        "motion",
        "off by damping: it is twice in q̈",
    ),
    "damping missing": Fault(
        "cart",
        {"qdd": lambda q, v: solved(q, v, -CART.bias(q, v) - CART.gravity(q))},
        "motion",
        "off by damping: it is not in q̈, or it is in two",
    ),
    "sign of damping": Fault(
        "cart",
        {"R": lambda q, v: -CART.R(q, v)},
        "dissipation-positive",
        "feeds energy at v = [1, 0, 0]",
    ),
    "damping of another sign in q̈": Fault(
        "cart",
        {
            "qdd": lambda q, v: (
                CART.qdd(q, v) + np.linalg.solve(CART.M(q), [2 * CART.d * v[0], 0, 0])
            )
        },
        "motion",
        "off by damping: its sign is another one in q̈",
    ),
    "float32 mass matrix": Fault("cart", {"M": in_single(CART.M)}, "double-precision", "M, "),
    "float32 sines": Fault(
        "cart",
        {"gravity": lambda q: CART.gravity(np.arcsin(np.float64(np.float32(np.sin(q)))))},
        "double-precision",
        "gravity, ",
    ),
    "float32 sines in an energy": Fault(
        "cart",
        {"T": lambda q, v: CART.T(np.arcsin(np.float64(np.float32(np.sin(q)))), v)},
        "double-precision",
        "T, does not feel small changes of q[1]: float32 arithmetic",
    ),
    "permuted C": Fault(
        "cart",
        {"C": lambda q, v: coriolis(q, v)[[1, 2, 0]]},
        "coriolis-bias",
        "Coriolis matrix, row",
    ),
    "C without Christoffel's symmetry": Fault(
        "cart",
        {"C": lambda q, v: np.outer(CART.bias(q, v), v) / (v @ v)},
        "coriolis-skew",
        "Coriolis matrix, entry",
    ),
    "transposed C": Fault(
        "cart", {"C": lambda q, v: coriolis(q, v).T}, "coriolis-bias", "Coriolis matrix, row"
    ),
    "wrong length in M": Fault(
        "cart",
        {"M": lambda q: CART.M(q) * np.array([[1, 1, 1], [1, 1, 1.2], [1, 1.2, 1]])},
        "bias-of-mass-matrix",
        "",
    ),
    "a constant added to M": Fault(
        "cart",
        {"M": lambda q: CART.M(q) + 0.1 * np.ones((3, 3))},
        "kinetic-energy",
        "mass matrix, entry",
    ),
    "mass matrix that is not positive": Fault(
        "cart",
        {"M": lambda q: CART.M(q) - np.diag([3.0, 0, 0])},
        "mass-matrix-positive",
        "eigenvalue",
    ),
    "term of T missing": Fault(
        "cart",
        {"T": lambda q, v: CART.T(q, v) - 0.5 * CART.m0 * v[0] ** 2},
        "kinetic-energy",
        "on the diagonal 2, 0, 0 too large",
    ),
    "inertia of the tip forgotten": Fault(
        "cart",
        {"M": lambda q: CART.M(q) - np.diag([0.0, 0.0, 0.02])},
        "kinetic-energy",
        "on the diagonal 0, 0, 0.02 too small, nothing elsewhere",
    ),
    "sign of U": Fault("cart", {"U": lambda q: -CART.U(q)}, "gravity-of-potential", "sign"),
    "acceleration without gravity": Fault(
        "cart",
        {"qdd": lambda q, v: CART.qdd(q, v) + solved(q, v, CART.gravity(q))},
        "motion",
        "off by gravity: it is not in q̈",
    ),
    "stale gravity": Fault("cart", stale(), "same-answer", "gravity, row q["),
    "a wheel that is too small": Fault(
        "drive",
        {"a": added(DRIVE.a, (1, 3), lambda q: 0.001)},
        "constraint-jacobian",
        "entry (constraint 1, q[3])",
    ),
    "sign in the caster's row": Fault(
        "drive",
        {"a": added(DRIVE.a, (3, 5), lambda q: 2 * DRIVE.trail)},
        "constraint-jacobian",
        "entry (constraint 3, q[5]): wrong sign",
    ),
    "swivel forgotten in gamma": Fault(
        "drive",
        {"gamma": added(DRIVE.gamma, (4,), lambda q, v: DRIVE.behind * v[2] * v[5] * np.cos(q[5]))},
        "constraint-drift",
        "row constraint 4",
    ),
    "sign of gamma": Fault(
        "drive",
        {"gamma": lambda q, v: -DRIVE.gamma(q, v)},
        "constraint-drift",
        "wrong sign (every row)",
    ),
    "acceleration without gamma": Fault(
        "drive",
        {"qdd": lambda q, v: driven(q, v, gamma=np.zeros(5))},
        "constraint-acceleration",
        "acceleration, row constraint",
    ),
    "sign of a torque": Fault(
        "drive",
        {"qdd": lambda q, v: driven(q, v, Q=DRIVE.Q(q, v) * np.array([1, 1, 1, -1, 1, 1, 1]))},
        "motion",
        "equations of motion, row free direction",
    ),
    "half the caster's inertia": Fault(
        "drive",
        {"M": added(DRIVE.M, (5, 5), lambda q: -DRIVE.J_caster / 2)},
        "kinetic-energy",
        "entry (q[5], q[5]): half the expected value",
    ),
    "half of a wheel's inertia in T": Fault(
        "drive",
        {"T": lambda q, v: DRIVE.T(q, v) - 0.25 * DRIVE.J_wheel * v[3] ** 2},
        "kinetic-energy",
        "entry (q[3], q[3]): twice the expected value",
    ),
    "the caster does not turn with the body in M": Fault(
        "drive",
        {"M": added(DRIVE.M, (2, 5), lambda q: -DRIVE.J_caster)},
        "mass-matrix-symmetric",
        "0, and entry (q[5], q[2]) is 0.001",
    ),
    "the mass ahead in M, sign of the sine": Fault(
        "drive",
        {"M": lambda q: DRIVE.M(np.array([q[0], q[1], -q[2], *q[3:]]))},
        "bias-of-mass-matrix",
        "bias, row q[",
    ),
    "sign of the bias": Fault(
        "drive",
        {"bias": lambda q, v: -DRIVE.bias(q, v)},
        "bias-of-mass-matrix",
        "wrong sign (every row)",
    ),
    "bias without the square": Fault(
        "drive",
        {"bias": lambda q, v: DRIVE.bias(q, v) / v[2]},
        "bias-quadratic",
        "bias, row q[",
    ),
    "cosine for sine in the bias": Fault(
        "drive",
        {"bias": lambda q, v: DRIVE.bias(q, v)[[1, 0, 2, 3, 4, 5, 6]]},
        "bias-of-mass-matrix",
        "bias, row q[",
    ),
    "a wheel on the wrong side": Fault(
        "drive",
        {"a": added(DRIVE.a, (1, 2), lambda q: -2 * DRIVE.half)},
        "constraint-jacobian",
        "entry (constraint 1, q[2]): wrong sign",
    ),
    "the trail forgotten in a": Fault(
        "drive",
        {"a": added(DRIVE.a, (3, 5), lambda q: DRIVE.trail)},
        "constraint-jacobian",
        "entry (constraint 3, q[5]): missing",
    ),
    "diameter for radius in c": Fault(
        "drive",
        {"c": lambda q, v: DRIVE.c(q, v) - np.array([0, DRIVE.radius * v[3], 0, 0, 0])},
        "constraint-jacobian",
        "entry (constraint 1, q[3]): half the expected value",
    ),
    "rows of gamma exchanged": Fault(
        "drive",
        {"gamma": lambda q, v: DRIVE.gamma(q, v)[[1, 0, 2, 3, 4]]},
        "constraint-drift",
        "row constraint",
    ),
    "friction twice in q̈": Fault(
        "drive",
        {"qdd": lambda q, v: driven(q, v, Q=DRIVE.Q(q, v) - friction(v))},
        "motion",
        "off by damping: it is twice in q̈",
    ),
    "friction that drives": Fault(
        "drive",
        {"R": lambda q, v: -DRIVE.R(q, v)},
        "dissipation-positive",
        "feeds energy at v = [",
    ),
    "no torques in q̈": Fault(
        "drive",
        {"qdd": lambda q, v: driven(q, v, Q=np.zeros(7))},
        "motion",
        "off by Q: it is not in q̈",
    ),
    "float32 gamma": Fault(
        "drive", {"gamma": in_single(DRIVE.gamma)}, "double-precision", "gamma, "
    ),
    "a degree for a radian": Fault(
        "drive",
        {"a": lambda q: DRIVE.a(np.deg2rad(q))},
        "constraint-jacobian",
        "constraint Jacobian, entry (constraint",
    ),
    "centre of mass on the axle in T": Fault(
        "drive",
        {
            "T": lambda q, v: (
                DRIVE.T(q, v)
                - DRIVE.m * DRIVE.ahead * v[2] * (v[1] * np.cos(q[2]) - v[0] * np.sin(q[2]))
            )
        },
        "kinetic-energy",
        "entry",
    ),
}


def findings_of(own: str, change: dict[str, Any] | None = None, **options: Any):
    return check_functions(**(given(own) | (change or {})), **options)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("own", ["cart", "drive"])
@pytest.mark.parametrize("seed", range(3))
def test_right_functions_pass(own: str, seed: int):
    more = {"C": coriolis} if own == "cart" else {}
    found = findings_of(own, more, states=8, seed=seed * 100)
    other = [x for x in found if x.verdict != "passed"]
    assert {x.claim for x in other} == {"reference"}, "\n".join(map(str, other))


@pytest.mark.parametrize("own", ["cart", "drive"])
def test_there_are_twenty_faults_in_each_file_of_the_guide(own: str):
    assert sum(fault.own == own for fault in FAULTS.values()) >= 20


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_named_by_the_claim_that_is_closest(name: str):
    fault = FAULTS[name]
    found = findings_of(fault.own, fault.change, states=4)
    failed = [x for x in found if x.verdict == "failed"]
    assert failed
    assert failed[0].claim == fault.claim, "\n".join(map(str, failed))
    assert fault.detail in failed[0].detail
    assert ("opposite sign" in failed[0].detail) == ("opposite sign" in fault.detail)


UNTOLD: dict[str, tuple[dict[str, Any], str]] = {
    "a constant added to M": (
        {
            "M": lambda q: CART.M(q) + 0.1 * np.ones((3, 3)),
            **dict.fromkeys(("T", "qdd", "gravity", "U", "R")),
        },
        "a constant added to M: T, qdd or against would tell",
    ),
    "9.80665": (
        {
            "gravity": lambda q: CART.gravity(q) * 9.80665 / CART.g,
            **dict.fromkeys(("U", "qdd", "R")),
        },
        "a gravity that is too strong, too weak or upside down: U, qdd or against would tell",
    ),
    "half bias": (
        {"bias": lambda q, v: CART.bias(q, v) / 2, **dict.fromkeys(("M", "T", "qdd", "R"))},
        "whether the bias belongs to the mass matrix: M, T or against would tell",
    ),
    "masses that are all too large": (
        {
            "M": lambda q: 2 * CART.M(q),
            "T": lambda q, v: 2 * CART.T(q, v),
            "U": lambda q: 2 * CART.U(q),
            "R": lambda q, v: 2 * CART.R(q, v),
            "bias": lambda q, v: 2 * CART.bias(q, v),
            "gravity": lambda q: 2 * CART.gravity(q),
        },
        "a number that all functions share, such as a mass, a length or g: against would tell",
    ),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", UNTOLD)
def test_what_cannot_be_told_is_said_and_does_not_fail(name: str):
    change, detail = UNTOLD[name]
    found = findings_of("cart", change, states=3)
    assert not [x for x in found if x.verdict == "failed"]
    assert detail in [x.detail for x in found if x.verdict == "skipped"]


@pytest.mark.parametrize("own", ["cart", "drive"])
@pytest.mark.night
def test_the_file_of_the_guide_runs_and_says_what_it_could_not_tell(own: str):
    path = GUIDES / f"{own}.py"
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "against would tell" in done.stdout


@pytest.mark.parametrize("own", ["cart", "drive"])
def test_the_file_of_the_guide_has_at_most_15_lines_beyond_the_equations(own: str):
    source = (GUIDES / f"{own}.py").read_text(encoding="utf-8")
    (main,) = [x for x in ast.parse(source).body if isinstance(x, ast.If)]
    assert main.end_lineno is not None
    assert main.end_lineno - main.lineno + 1 <= 15


@pytest.mark.parametrize("own", ["cart", "drive"])
@pytest.mark.night
def test_a_failure_ends_the_file_of_the_guide_with_1(own: str, tmp_path):
    source = (GUIDES / f"{own}.py").read_text(encoding="utf-8")
    old, new = "return 0.5 * (m", "return 0.4 * (m"
    assert source.count(old) == 1
    path = tmp_path / f"wrong_{own}.py"
    path.write_text(source.replace(old, new), encoding="utf-8")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stdout.startswith("kinetic-energy [M ~ ∂²T/∂v²] failed")
