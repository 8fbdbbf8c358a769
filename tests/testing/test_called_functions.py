"""Which functions call each other, by the names in their code."""

from __future__ import annotations

from functools import lru_cache, partial, wraps
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.testing.own import guide

from eomcheck.testing import EquationsOfMotion, check_functions
from eomcheck.testing.called_functions import called_functions
from eomcheck.testing.fault_localization import (
    Conflict,
    unsettled_by_calls,
    with_called_suspects,
)

CART = guide("cart")
NAMES = "M", "bias", "gravity", "qdd", "T", "U", "R"


def calling(**functions) -> dict[str, set[str]]:
    """Return the functions that call others: name -> names."""
    return {name: {*others} for name, others in called_functions(functions).items() if others}


def test_functions_of_a_module_call_those_that_they_name():
    every = {name: getattr(CART, name) for name in NAMES}
    assert calling(**every) == {"qdd": {"M", "bias", "gravity"}}


def test_wrappers_of_one_call_stand_for_the_function_that_they_call():
    assert calling(
        M=lambda q: CART.M(q),
        gravity=lambda q: CART.gravity(q),
        qdd=lambda q, v: CART.qdd(q, v),
        T=lambda q, v: 0.5 * v @ CART.M(q) @ v,
        U=lambda q: CART.U(q),
    ) == {"qdd": {"M", "gravity"}, "T": {"M"}}


def test_methods_call_methods_of_their_object():
    class Model:
        size = 2.0

        def M(self, q):
            return self.scaled(np.eye(2))

        def scaled(self, matrix):
            return self.size * matrix

        @staticmethod
        def gravity(q):
            return np.sin(q)

        @property
        def broken(self):
            raise RuntimeError

        def qdd(self, q, v):
            self.broken  # noqa: B018
            return np.linalg.solve(self.M(q), -self.gravity(q))

        def energy(self, q, v):
            return self.work(q, v)

        def work(self, q, v):
            return v @ self.M(q) @ v / 2

    model = Model()
    found = calling(M=model.M, gravity=model.gravity, qdd=model.qdd, T=model.energy, U=Model.work)
    assert found == {"qdd": {"M", "gravity"}, "T": {"M"}}


def test_decorators_arguments_and_closures_are_seen_through():
    def decorated(function):
        @wraps(function)
        def inner(*arguments):
            return np.asarray(function(*arguments))

        return inner

    def M_of(scale, q):
        return scale * np.eye(len(q))

    M, half = partial(M_of, 2.0), lru_cache(lambda q: 0.5 * q)
    gravity = decorated(half)
    found = calling(M=M, gravity=gravity, qdd=decorated(lambda q, v: -(M(q) @ gravity(q))))
    assert found == {"qdd": {"M", "gravity"}}


def test_functions_within_functions_and_helpers_are_followed():
    def M(q):
        return np.eye(2)

    def inertia_force(q, v):
        def inside():
            return M(q) @ v

        return inside()

    loop = SimpleNamespace()
    loop.again = lambda q, v: loop.again(q, v) + inertia_force(q, v)
    assert calling(M=M, bias=lambda q, v: 2 * inertia_force(q, v), qdd=loop.again) == {
        "bias": {"M"},
        "qdd": {"M"},
    }


def test_calls_below_each_other_are_followed():
    def momentum(q, v):
        return CART.M(q) @ v

    def force(q, v):
        return 2 * momentum(q, v)

    assert calling(M=CART.M, bias=lambda q, v: -force(q, v)) == {"bias": {"M"}}


def test_a_function_with_another_in_it_calls_those_that_the_inner_one_names():
    """It is no mere wrapper of the one that the inner function calls."""

    def bias(q, v):
        def force(x):
            return CART.M(q) @ x

        return force(v)

    def qdd(q, v):
        return -np.linalg.solve(CART.M(q), v)

    found = calling(M=CART.M, bias=bias, qdd=qdd, T=lambda q, v: [CART.M(q) @ x for x in v])
    assert found == {"bias": {"M"}, "qdd": {"M"}, "T": {"M"}}


def test_functions_of_a_class_and_behind_arguments_are_found_by_their_own_names():
    class Model:
        @staticmethod
        def gravity(q):
            return np.sin(q)

    def scaled(scale, q):
        return scale * np.eye(len(q))

    def qdd(q, v):
        return -(scaled(2.0, q) @ Model.gravity(q))

    found = calling(M=partial(scaled, 2.0), gravity=Model.gravity, qdd=qdd)
    assert found == {"qdd": {"M", "gravity"}}


def test_functions_that_are_not_python_and_constants_call_nothing():
    def later():
        return unassigned  # noqa: F821

    def waiting():
        return assigned

    assert calling(M=np.eye, bias=np.zeros(3), U=None, T=later, R=waiting, J={"tip": len}) == {}
    assigned = 0.0
    assert waiting() == assigned


def test_functions_of_frames_are_those_of_one_input():
    def M(q):
        return np.eye(2)

    assert calling(M=M, J={"a": lambda q: q + M(q), "b": np.eye}) == {"J": {"M"}}


def test_a_claim_settles_neither_of_two_functions_that_call_each_other():
    functions: dict[str, Any] = dict.fromkeys(("M", "bias", "gravity", "qdd"), len)
    calls = dict.fromkeys(functions, frozenset[str]()) | {"qdd": frozenset({"bias", "gravity"})}
    pairs = unsettled_by_calls(EquationsOfMotion(2, **functions), calls)
    assert {name for claim, name in pairs if claim == "motion"} == {"qdd", "bias", "gravity"}
    assert "bias-of-mass-matrix" not in {claim for claim, _ in pairs}  # it does not read q̈


@pytest.mark.parametrize("caller", ["qdd", "inverse_dynamics"])
def test_a_function_that_a_wrong_one_calls_is_suspect_where_another_failure_suspects_it(caller):
    finding: Any = None
    first, second = (
        Conflict(finding, frozenset({caller}), frozenset({caller, "gravity"})),
        Conflict(finding, frozenset({"bias", "gravity", "T"}), frozenset({"bias", "gravity", "T"})),
    )
    calls = {caller: frozenset({"M", "bias", "gravity"}), "T": frozenset({"M"})}
    wider = [first._replace(suspects=frozenset({caller, "bias"})), second]
    assert with_called_suspects([first, second], calls, []) == wider
    assert with_called_suspects([first, second], calls, [caller]) == [first, second]


def test_a_function_that_calls_another_does_not_clear_it():
    def gravity(q):
        return CART.gravity(q) * [1.0, 1.0, -1.0]

    def qdd(q, v):
        forces = -CART.bias(q, v) - gravity(q) - np.array([CART.d * v[0], 0.0, 0.0])
        return np.linalg.solve(CART.M(q), forces)

    every: dict[str, Any] = {name: getattr(CART, name) for name in NAMES}
    changed: dict[str, Any] = every | {"qdd": qdd, "gravity": gravity}
    right = check_functions(3, **changed)
    (failed,) = (x for x in right if x.verdict == "failed")
    assert failed.cause == "gravity or U"
    assert "qdd calls gravity, and repeats any mistake" in failed.detail
    # A q̈ of its own agrees with U, and so decides.
    changed["qdd"] = CART.qdd
    independent = check_functions(3, **changed)
    first, *_ = (x for x in independent if x.verdict == "failed")
    assert first.cause == "gravity"


def test_an_acceleration_that_calls_a_wrong_mass_matrix_does_not_convict_inverse_dynamics():
    def M(q):
        return CART.M(q) + np.diag([0.0, 0.3, 0.0])

    def qdd(q, v):
        forces = -CART.bias(q, v) - CART.gravity(q) - np.array([CART.d * v[0], 0.0, 0.0])
        return np.linalg.solve(M(q), forces)

    def inverse_dynamics(q, v, vdot):
        damping = np.array([CART.d * v[0], 0.0, 0.0])
        return CART.M(q) @ vdot + CART.bias(q, v) + CART.gravity(q) + damping

    known = {name: getattr(CART, name) for name in ("bias", "gravity", "R")}
    given: dict[str, Any] = known | {"M": M, "qdd": qdd, "inverse_dynamics": inverse_dynamics}
    first, *_ = (x for x in check_functions(3, **given) if x.verdict == "failed")
    assert {"M", "inverse_dynamics"} <= {*first.cause.split(" or ")}


def test_a_cause_is_not_said_to_repeat_the_mistakes_of_another():
    def qdd(q, v):
        return np.linalg.solve(CART.M(q), CART.gravity(q) - CART.bias(q, v))

    known: dict[str, Any] = {name: getattr(CART, name) for name in ("M", "bias", "gravity")}
    first, *_ = (x for x in check_functions(3, **known, qdd=qdd) if x.verdict == "failed")
    assert first.cause == "gravity or qdd"
    assert "repeats any mistake" not in first.detail
