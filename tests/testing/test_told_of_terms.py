"""What a failure says of terms, rows and signs, and the numbers beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.testing.own import guide

from eomcheck.claims.finding import Finding
from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.claims_terms import proportional
from eomcheck.testing.equations_of_motion import INPUTS
from eomcheck.testing.fault_localization import (
    SCALES,
    SETTLES,
    VelocityDependence,
    coefficients,
    functions_read,
    settled_by,
    velocity_dependence,
)
from eomcheck.testing.uncertain import UncertainArray, exact

CART = guide("cart")
STATE = ([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])


def failed(claim: str, n: int = 3, states: Any = (STATE,), **own: Any) -> Finding:
    """Return the failure of a claim that is asked alone."""
    found = check_functions(n, **own, states=states, claims=[claim])
    (one,) = [x for x in found if x.verdict == "failed"]
    return one


# ---- Factors and triangles -----------------------------------------------------------------------


def test_a_quarter_of_all_rows_is_said():
    expected = np.array([3.0, -1.0, 2.0])
    assert (
        proportional(0.25 * expected, expected, 1e-12, (0,))
        == "a quarter of the expected value (every row)"
    )
    assert proportional(4.0 * expected, expected, 1e-12, (0,)).startswith("4 times the expec")
    assert proportional(0.0 * expected, 0.0 * expected, 1e-12, (0,)) == ""


def test_what_is_allowed_decides_whether_a_factor_is_known():
    expected = np.array([3.0, -1.0, 2.0])
    found = 0.5 * expected + [1e-3, 0.0, -1e-3]
    assert proportional(found, expected, 0.5e-3, (0,)) == ""
    assert proportional(found, expected, 1.1e-3, (0,)) == "half the expected value (every row)"


FULL = np.array([[4.0, 0.5, -0.7], [0.5, 3.0, 0.2], [-0.7, 0.2, 2.0]])


@pytest.mark.parametrize(
    ("M", "text"),
    [
        (np.tril(FULL), "entry (q[0], q[2]): the upper triangle is empty"),
        (np.triu(FULL), "entry (q[0], q[2]): the lower triangle is empty"),
        (
            FULL + 0.4 * np.outer(np.eye(3)[1], np.eye(3)[2]),
            "entry (q[1], q[2]): 0.6, and entry (q[2], q[1]) is 0.2",
        ),
        (
            FULL + 0.4 * np.outer(np.eye(3)[2], np.eye(3)[0]),
            "entry (q[0], q[2]): -0.7, and entry (q[2], q[0]) is -0.3",
        ),
        (
            FULL + 1.4 * np.outer(np.eye(3)[2], np.eye(3)[0]),
            "entry (q[0], q[2]): -0.7, and entry (q[2], q[0]) is 0.7: opposite sign in one of them",
        ),
    ],
)
def test_both_entries_across_the_diagonal_are_named_with_their_numbers(M: Any, text: str):
    one = failed("mass-matrix-symmetric", M=lambda q: M)
    assert one.detail == f"mass matrix, {text}"
    assert one.observed == pytest.approx(np.abs(M - M.T).max())


@pytest.mark.parametrize(
    ("diagonal", "observed", "text"),
    [
        ([2.0, -3.0, 1.0], 3.0, "entry (q[1], q[1]): negative"),
        ([-2.0, -0.5, -4.0], 4.0, "entry (q[2], q[2]): negative"),
    ],
)
def test_the_most_negative_number_on_the_diagonal_is_named(diagonal, observed, text):
    one = failed("mass-matrix-positive", M=lambda q: np.diag(diagonal))
    assert (one.detail, one.observed) == (f"mass matrix, {text}", observed)


def test_the_least_eigenvalue_is_that_in_units_of_the_diagonal():
    """Of kg and of g mm² alike: [[1, 2], [2, 1]] in other units, whose least one is -1."""
    units = np.diag([1e3, 1e-3])
    M = units @ np.array([[1.0, 2.0], [2.0, 1.0]]) @ units
    one = failed("mass-matrix-positive", 2, [([0.3, 0.1], [0.5, 0.2])], M=lambda q: M)
    assert one.detail == "mass matrix, its least eigenvalue is -1 of its diagonal"
    assert one.observed == pytest.approx(1.0)


@pytest.mark.parametrize(("sign", "name"), [(1.0, "∂U/∂q"), (-1.0, "-∂U/∂q")])
@pytest.mark.parametrize("known", ["gravity", "U"])
def test_gravity_in_the_bias_is_named_with_its_sign(sign: float, name: str, known: str):
    own = {
        "bias": lambda q, v: CART.bias(q, v) + sign * CART.gravity(q),
        known: getattr(CART, known),
    }
    one = failed("bias-at-rest", **own)
    remedy = "; set bias_has_gravity = True" if sign > 0 else ", with the wrong sign"
    assert one.detail.endswith(f": it is {name}: gravity is in the bias{remedy}")


def test_what_is_left_at_rest_without_a_potential_is_not_called_gravity():
    def bias(q, v):
        return CART.bias(q, v) + np.array([q[1], -q[0], 0.0])

    one = failed("bias-at-rest", bias=bias)
    assert "potential" not in one.detail and "gravity" not in one.detail


# ---- Kinetic energy and dissipation --------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (np.diag([0.0, 0.01, 0.02]), "0, 0.01, 0.02 too large, nothing elsewhere: armature?"),
        (np.diag([-0.3, 0.0, -0.02]), "0.3, 0, 0.02 too small, nothing elsewhere"),
        (np.diag([0.3, 0.0, -0.02]), "0.3, 0, -0.02 too large, nothing elsewhere"),
    ],
)
def test_what_is_more_on_the_diagonal_is_listed_with_its_sign(more: Any, text: str):
    one = failed("kinetic-energy", M=lambda q: CART.M(q) + more, T=CART.T)
    assert one.detail.endswith(f": on the diagonal {text}")


def test_a_damper_that_feeds_energy_is_told_with_the_velocity_and_the_power():
    """R is -2 W at the largest velocity of the second speed."""
    ranges = [(-1.0, 1.0)] * 2 + [(-3.0, 3.0), (-2.0, 2.0)]
    one = failed(
        "dissipation-positive",
        2,
        [([0.1, 0.2], [0.5, 0.3])],
        R=lambda q, v: 0.5 * v[0] ** 2 - 0.5 * v[1] ** 2,
        ranges=ranges,
    )
    assert "feeds energy at v = [0, 2], where R is 2 W less than at rest" in one.detail.replace(
        "-0", "0"
    )
    assert one.observed == pytest.approx(4.0)


def test_a_damper_that_feeds_energy_along_the_state_only_is_told_there():
    """A drag that is negative beyond a speed, as second differences of the ranges do not show."""

    def R(q, v):
        return v[0] ** 2 - 1e-3 * (abs(v[0] - 0.5) < 0.1) * 1e3

    one = failed("dissipation-positive", 1, [([0.1], [0.5])], R=R)
    assert "feeds energy at v = [0.5], where R is " in one.detail


# ---- Which term ----------------------------------------------------------------------------------


def rotated(v: Any) -> Any:
    """Return a bias of four terms in two rows."""
    return np.array([0.4 * v[0] ** 2 + 0.1 * v[0] * v[1], 0.3 * v[1] ** 2 - 0.2 * v[0] ** 2])


FOUR = (
    "row q[0], v[0]²: should vanish: got 0.4; row q[1], v[1]²: should vanish: got 0.3; "
    "row q[1], v[0]²: should vanish: got -0.2; 1 more terms"
)


def test_the_largest_three_of_more_terms_are_listed_and_the_others_counted():
    own = {"M": lambda q: np.eye(2), "bias": lambda q, v: rotated(v)}
    one = failed("bias-of-mass-matrix", 2, [([0.3, 0.5], [0.7, -0.4])], **own)
    assert one.detail.endswith(f"; {FOUR}"), one.detail


@pytest.mark.parametrize("known", ["bias", "M", "T"])
def test_terms_of_a_coriolis_matrix_are_told_whatever_tells_the_bias(known: str):
    """A mass on a spoke: B = (-r φ̇², 2 r ṙ φ̇), of which C has the first with another sign."""
    tells: dict[str, Callable] = {
        "bias": lambda q, v: np.array([-q[0] * v[1] ** 2, 2.0 * q[0] * v[0] * v[1]]),
        "M": lambda q: np.diag([1.0, q[0] ** 2]),
        "T": lambda q, v: (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2.0,
    }
    own = {
        known: tells[known],
        "C": lambda q, v: q[0] * np.array([[0.0, v[1]], [v[1], v[0]]]),
    }
    one = failed("coriolis-bias", 2, [([0.8, 0.5], [0.7, -0.4])], **own)
    said = "; row q[0], v[1]²: wrong sign: got 0.8, expected -0.8"
    assert one.detail.endswith(said), one.detail


def test_coefficients_are_those_of_each_product():
    widths = np.array([2.0, 0.5, 3.0])
    table = {(0, 0): 1.5, (0, 1): -2.0, (1, 1): 0.3, (0, 2): 0.7, (1, 2): -0.1, (2, 2): 4.0}

    def of(v: Any) -> UncertainArray:
        return exact([sum(c * v[i] * v[j] for (i, j), c in table.items()), v[0] * v[2]])

    found = coefficients(of, widths)
    assert {key: pytest.approx(x.value.tolist()) for key, x in found.items()} == {
        key: [c, float(key == (0, 2))] for key, c in table.items()
    }
    assert coefficients(lambda v: None, widths) == {}


@pytest.mark.parametrize(
    "parts",
    [(x, y, z) for x in (False, True) for y in (False, True) for z in (False, True)],
)
def test_how_a_quantity_depends_on_v_is_told_apart(parts: tuple[bool, bool, bool]):
    constant, odd, even = parts

    def at(scale: float) -> UncertainArray:
        row = [0.3 * constant + 0.2 * odd * scale + 0.1 * even * scale**2, 0.0]
        return UncertainArray(np.array(row), np.full(2, 1e-12), np.ones(2))

    assert velocity_dependence([at(x) for x in SCALES]) == VelocityDependence(*parts)


def test_errors_hide_how_a_quantity_depends_on_v():
    values = [UncertainArray(np.array([x * 0.1]), np.array([0.01]), np.ones(1)) for x in SCALES]
    assert velocity_dependence(values) == VelocityDependence(False, False, False)


# ---- What passes ---------------------------------------------------------------------------------

EVERY: dict[str, Any] = dict.fromkeys(INPUTS, len)


@pytest.mark.parametrize(
    ("claim", "cleared"),
    [
        ("bias-of-mass-matrix", "bias"),
        ("coriolis-bias", "bias"),
        ("gravity-of-potential", "gravity U"),
        ("kinetic-energy", "M T"),
        ("bias-of-energy", "bias"),
        ("constraint-jacobian", "a c"),
        ("constraint-velocity", "c"),
        ("constraint-drift", "gamma b"),
        ("constraint-acceleration", "gamma"),
        ("bias-power", ""),
        ("gravity-potential", ""),
        ("dissipation-positive", ""),
        ("power-balance", ""),
        ("same-answer", ""),
    ],
)
def test_a_claim_that_passes_clears_what_two_faults_alone_would_hide(claim: str, cleared: str):
    passed = Finding(claim, "M", EquationsOfMotion(2, **EVERY), None, 0.0, 1.0, "passed", "")
    assert settled_by([passed]) == dict.fromkeys(cleared.split(), claim)
    assert {*cleared.split()} == {*SETTLES.get(claim, ())}


def test_the_first_claim_that_passes_is_named_for_what_it_clears():
    functions = EquationsOfMotion(2, **EVERY)
    ids = ["coriolis-bias", "bias-of-mass-matrix"]
    both = [Finding(x, "M", functions, None, 0.0, 1.0, "passed", "") for x in ids]
    assert settled_by(both) == {"bias": "coriolis-bias"}


def test_what_a_constrained_claim_reads_has_the_constraint_in_it():
    functions = EquationsOfMotion(2, **dict.fromkeys(("M", "bias", "qdd", "a", "c", "b"), len))
    assert functions_read(functions, "motion") == {"M", "bias", "qdd", "a", "c", "b"}
    assert functions_read(functions, "power-balance") == {"M", "qdd", "a", "c", "b"}
    assert functions_read(functions, "mass-matrix-positive") == {"M"}
    assert functions_read(functions, "answers", "c") == {"c"}
    assert functions_read(functions, "answers", "arguments") == frozenset()


def test_gravity_in_the_bias_is_read_with_it():
    functions = EquationsOfMotion(2, M=len, bias=len, U=len, qdd=len, bias_has_gravity=True)
    assert functions_read(functions, "gravity-of-potential") == {"bias", "U"}
    assert functions_read(functions, "bias-even") == {"bias"}
    both = EquationsOfMotion(2, M=len, bias=len, gravity=len, bias_has_gravity=True)
    assert functions_read(both, "bias-even") == {"bias", "gravity"}
    assert functions_read(both, "mass-matrix-positive") == {"M"}


@pytest.mark.parametrize(
    ("about", "read"),
    [
        ("M", "M"),
        ("bias", "bias"),
        ("T", "T"),
        ("gamma", "gamma"),
        ("forces", "U R Q"),
        ("qdd", "qdd"),
    ],
)
def test_a_quantity_that_is_compared_reads_what_gives_it(about: str, read: str):
    own = dict.fromkeys(("M", "bias", "C", "T", "U", "R", "Q", "a", "gamma", "qdd"), len)
    assert functions_read(EquationsOfMotion(2, **own), "reference", f"{about} ~ x") == {
        *read.split()
    }
    for name, follows in {"M": "T", "bias": "C", "gamma": "a"}.items():
        if name == about:
            less = EquationsOfMotion(2, **{x: f for x, f in own.items() if x != name})
            assert functions_read(less, "reference", f"{about} ~ x") == {follows}


# ---- Rows by name --------------------------------------------------------------------------------


class Twice:
    """Answers other numbers from the second call on, in one entry."""

    def __init__(self, right: Callable, entry: tuple[int, ...]):
        self.right, self.entry, self.calls = right, entry, 0

    def __call__(self, q: Any, v: Any = None) -> Any:
        self.calls += 1
        found = np.array(self.right(q), float)
        found[self.entry] += self.calls
        return found


@pytest.mark.parametrize(
    ("name", "right", "entry", "said"),
    [
        ("M", lambda q: np.eye(2), (1, 0), "mass matrix, entry (u[1], u[0])"),
        ("gravity", lambda q: np.ones(2), (1,), "gravity, row u[1]"),
        ("a", lambda q: np.ones((1, 2)), (0, 1), "constraint Jacobian, entry (0, u[1])"),
        ("qdot", lambda q: np.ones(3), (2,), "rates of the coordinates, row q[2]"),
        ("U", lambda q: 1.0, (), "potential energy, value"),
    ],
)
def test_an_entry_that_changes_is_named_by_coordinates_speeds_and_constraints(
    name: str, right: Callable, entry: tuple[int, ...], said: str
):
    own: dict[str, Any] = {"qdot": lambda q, u: np.array([u[0], u[1], u[0]]), "speeds": 2}
    changing = Twice(right, entry)
    own[name] = (lambda q, u: changing(q)) if name == "qdot" else (lambda q: changing(q))
    found = check_functions(3, **own, states=1, claims=["same-answer"])
    (one,) = [x for x in found if x.verdict == "failed"]
    assert one.subject == name
    assert one.detail.startswith(f"{said}: another one after other calls"), one.detail


def test_a_factory_whose_function_breaks_is_a_failure():
    def broken(q):
        raise ValueError("no licence")

    made = {"gravity": broken, "M": CART.M}
    own = {"gravity": CART.gravity, "M": CART.M, "factory": lambda: made}
    found = check_functions(3, **own, states=2, claims=["fresh-answer"])
    assert {x.subject: x.verdict for x in found} == {"gravity": "failed", "M": "passed"}
    assert found[-1].detail == "gravity of the factory, ValueError: no licence"


@pytest.mark.parametrize("as_", ["functions", "dict", "object"])
def test_a_factory_may_make_functions_a_dict_or_an_object(as_: str):
    def wrong(q):
        return 2.0 * CART.gravity(q)

    made = {
        "functions": lambda: EquationsOfMotion(3, gravity=wrong),
        "dict": lambda: {"gravity": wrong},
        "object": lambda: type("Model", (), {"gravity": staticmethod(wrong)}),
    }[as_]
    own = {"gravity": CART.gravity, "factory": made}
    (found,) = check_functions(3, **own, states=1, claims=["fresh-answer"])
    assert (found.subject, found.verdict) == ("gravity", "failed")
