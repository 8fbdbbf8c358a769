"""Every claim about functions: right ones pass, wrong ones fail by it, at the size allowed."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.testing.every_function import every_function, random_model
from tests.testing.own import coriolis, guide
from tests.testing.own import given as given_of_guide
from tests.testing.trees import random_tree

from eomcheck.claims.finding import Finding
from eomcheck.numbers.generic import EPS
from eomcheck.testing import FUNCTION_CLAIMS, EquationsOfMotion, check_functions
from eomcheck.testing.equations_of_motion import INPUTS
from eomcheck.testing.function_checks import caveats

CART, DRIVE = guide("cart"), guide("drive")
EVERY = every_function(random_model(44, joints=3))
TREE = SimpleNamespace(**EVERY)
REPEAT = ["answers-repeat"]

STATES = {
    "cart": [([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])],
    "drive": [([0.3, 0.7, -0.4, 0.2, 0.6, 0.5, -0.3], [0.5, -0.8, 0.9, 0.4, -0.3, 0.6, 0.7])],
    "tree": [([0.3, 0.7, -0.4], [0.5, -0.8, 0.9])],
}


def given(name: str) -> dict[str, Any]:
    """Return the functions of a file of the guide, or every function of a tree, by name."""
    return dict(EVERY) if name == "tree" else given_of_guide(name)


class Wrong(NamedTuple):
    """What makes a claim fail.

    Attributes:
        own: the file of the guide whose functions are changed, or "tree" for `EVERY`.
        change: eps -> functions that are wrong by an amount that is linear in eps, right at 0.
        counted: whether the error that is observed is linear in eps; not where a claim is about
            what functions do and not about numbers.
    """

    own: str
    change: Callable[[float], dict[str, Any]]
    counted: bool = True


def plus(name: str, own: Any, entry: Callable) -> Callable[[float], dict[str, Any]]:
    """Return the change that adds eps times `entry(*arguments)` to a function."""
    function = getattr(own, name)

    def change(eps: float) -> dict[str, Any]:
        @wraps(function)
        def wrong(*x):
            return function(*x) + eps * np.asarray(entry(*x))

        return {name: wrong}

    return change


class Kept:
    """Gravity that grows by eps with the first call that was not at the state looked at."""

    def __init__(self, eps: float):
        self.eps, self.moved = eps, False

    def gravity(self, q):
        found = CART.gravity(q) + np.array([0.0, self.eps * self.moved, 0.0])
        self.moved |= bool(abs(q[0] - 0.3) > 0.2)
        return found


class Stale:
    """Gravity that is the previous one in every nth call."""

    def __init__(self, nth: int):
        self.nth, self.calls, self.last = nth, 0, CART.gravity(np.zeros(3))

    def gravity(self, q):
        self.calls += 1
        if self.calls % self.nth:
            self.last = CART.gravity(q)
        return self.last


def writes(q):
    q[0] += 0.1
    return CART.gravity(q)


def nan_at_moving(q, v):
    return CART.bias(q, v) * np.nan


def singles(q):
    return CART.gravity(q).astype(np.float32)


def singular(eps: float) -> dict[str, Any]:
    flat = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    # sin and cos so that it is rounded: the least eigenvalue is -2 eps.
    return {
        "M": lambda q: (
            flat * (np.sin(q[0]) ** 2 + np.cos(q[0]) ** 2) - eps * np.diag([1.0, 1.0, 0.0])
        )
    }


def factory_of(eps: float) -> dict[str, Any]:
    wrong = {"gravity": lambda q: CART.gravity(q) + eps * np.array([0, 1, 0])}
    right = {name: one for name, one in given("cart").items() if name in INPUTS}
    return {"factory": lambda: right | wrong}


def one_entry(*_):
    return np.outer([1, 0, 0], [0, 1, 0])


def first_column(*_):
    return np.outer([1, 0, 0], np.eye(30)[0])


def last_mass():
    return np.outer([1, 0, 0], np.eye(30)[20])


def last_moment(*_):
    return np.outer([1, 0, 0], np.eye(30)[24])


def one_row():
    return np.outer(np.eye(6)[4], np.eye(3)[0])


def one_more(x, eps, *_):
    return x + eps * np.eye(6)[1]


def stretched(x, eps, *_):
    return x[0] * [1.0 + eps, 1.0, 1.0], x[1]


def of_tool(name: str, entry: Callable) -> Callable[[float], dict[str, Any]]:
    """Return the change of a function of the frame "tool" to `entry(result, eps, *arguments)`."""
    function = EVERY[name]["tool"]

    def change(eps: float) -> dict[str, Any]:
        return {name: EVERY[name] | {"tool": lambda *x: entry(function(*x), eps, *x)}}

    return change


def cubic(q, v):
    return v[0] ** 3


WRONG: dict[str, Wrong] = {
    "answers": Wrong("cart", lambda eps: {"bias": nan_at_moving} if eps else {}, counted=False),
    "arguments-unchanged": Wrong(
        "cart", lambda eps: {"gravity": writes} if eps else {}, counted=False
    ),
    "same-answer": Wrong("cart", lambda eps: {"gravity": Kept(eps).gravity}),
    "answers-repeat": Wrong(
        "cart", lambda eps: {"gravity": Stale(7).gravity} if eps else {}, counted=False
    ),
    "fresh-answer": Wrong("cart", factory_of),
    "double-precision": Wrong(
        "cart", lambda eps: {"gravity": singles} if eps else {}, counted=False
    ),
    "mass-matrix-symmetric": Wrong(
        "cart", plus("M", CART, lambda q: [[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    ),
    "mass-matrix-positive": Wrong("cart", singular),
    "bias-at-rest": Wrong("cart", plus("bias", CART, lambda q, v: [0, 1, 0])),
    "bias-quadratic": Wrong("cart", plus("bias", CART, lambda q, v: [0, v[0], 0])),
    "bias-even": Wrong("cart", plus("bias", CART, lambda q, v: [v[0], 0, 0])),
    "bias-of-mass-matrix": Wrong("cart", plus("bias", CART, lambda q, v: [0, v[0] ** 2, 0])),
    "bias-power": Wrong("cart", plus("bias", CART, lambda q, v: [v[2] ** 2, 0, 0])),
    "coriolis-bias": Wrong(
        "cart", lambda eps: {"C": lambda q, v: coriolis(q, v) + eps * np.diag([v[0], 0, 0])}
    ),
    "coriolis-skew": Wrong(
        "cart", lambda eps: {"C": lambda q, v: coriolis(q, v) + eps * np.diag([v[0], 0, 0])}
    ),
    "gravity-potential": Wrong("cart", plus("gravity", CART, lambda q: [q[1], 0, 0])),
    "gravity-of-potential": Wrong("cart", plus("gravity", CART, lambda q: [0, 1, 0])),
    "gravity-velocity": Wrong(
        "cart", lambda eps: {"gravity": lambda q, v: CART.gravity(q) + eps * np.array([0, v[1], 0])}
    ),
    "energy-quadratic": Wrong("cart", plus("T", CART, cubic)),
    "kinetic-energy": Wrong("cart", plus("M", CART, lambda q: np.diag([0, 1, 0]))),
    "bias-of-energy": Wrong("cart", plus("bias", CART, lambda q, v: [0, v[0] ** 2, 0])),
    "dissipation-positive": Wrong("cart", plus("R", CART, lambda q, v: -(v[1] ** 2))),
    "constraint-jacobian": Wrong(
        "drive", plus("a", DRIVE, lambda q: np.outer(np.eye(5)[0], np.eye(7)[3]))
    ),
    "constraint-velocity": Wrong("drive", plus("c", DRIVE, lambda q, v: np.eye(5)[2])),
    "constraint-drift": Wrong("drive", plus("gamma", DRIVE, lambda q, v: np.eye(5)[2])),
    "constraint-acceleration": Wrong("drive", plus("qdd", DRIVE, lambda q, v: np.eye(7)[0])),
    "motion": Wrong("cart", plus("qdd", CART, lambda q, v: [0, 1, 0])),
    "power-balance": Wrong("cart", plus("qdd", CART, lambda q, v: [0, 1, 0])),
    "acceleration-even": Wrong(
        "cart",
        lambda eps: {
            "R": None,
            "qdd": lambda q, v: np.linalg.solve(
                CART.M(q), -CART.bias(q, v) - CART.gravity(q) - eps * np.array([v[0] ** 3, 0, 0])
            ),
        },
    ),
    "acceleration-quadratic": Wrong(
        "cart",
        lambda eps: {
            "R": None,
            "qdd": lambda q, v: np.linalg.solve(
                CART.M(q), -CART.bias(q, v) - CART.gravity(q) - eps * np.array([v[0] ** 3, 0, 0])
            ),
        },
    ),
    "inverse-dynamics": Wrong("tree", plus("inverse_dynamics", TREE, lambda q, v, vdot: vdot)),
    "inverse-dynamics-symmetric": Wrong(
        "tree", plus("inverse_dynamics", TREE, lambda q, v, vdot: [vdot[1], 0, 0])
    ),
    "inverse-dynamics-acceleration": Wrong(
        "tree", plus("inverse_dynamics", TREE, lambda q, v, vdot: [0, 1, 0])
    ),
    "inverse-dynamics-by-position": Wrong("tree", plus("tau_q", TREE, one_entry)),
    "inverse-dynamics-by-velocity": Wrong("tree", plus("tau_v", TREE, one_entry)),
    "inverse-dynamics-mixed": Wrong(
        "tree", plus("tau_v", TREE, lambda q, v, vdot: q[2] * np.outer([0, 1, 0], [0, 0, 1]))
    ),
    "acceleration-by-position": Wrong("tree", plus("qdd_q", TREE, one_entry)),
    "acceleration-by-velocity": Wrong("tree", plus("qdd_v", TREE, one_entry)),
    "acceleration-by-force": Wrong("tree", plus("qdd_tau", TREE, one_entry)),
    "acceleration-force-symmetric": Wrong("tree", plus("qdd_tau", TREE, one_entry)),
    "acceleration-force-mass": Wrong("tree", plus("qdd_tau", TREE, one_entry)),
    "acceleration-force": Wrong("tree", plus("qdd", TREE, lambda q, v, tau: tau)),
    "acceleration-mixed": Wrong(
        "tree", plus("qdd_q", TREE, lambda q, v, tau: np.diag([0, v[0], 0]))
    ),
    "acceleration-inverse-position": Wrong("tree", plus("qdd_q", TREE, one_entry)),
    "acceleration-inverse-velocity": Wrong("tree", plus("tau_v", TREE, one_entry)),
    "inverse-mass-matrix": Wrong(
        "tree", plus("inverse_mass_matrix", TREE, lambda q: np.diag([0, 1, 0]))
    ),
    "regressor-parameters": Wrong("tree", plus("regressor", TREE, first_column)),
    "regressor-symmetric": Wrong(
        "tree", plus("regressor", TREE, lambda q, v, vdot: vdot[1] * last_mass())
    ),
    "regressor-power": Wrong(
        "tree", plus("regressor", TREE, lambda q, v, vdot: v[0] ** 2 * last_moment(q))
    ),
    "com-jacobian": Wrong("tree", plus("com_jacobian", TREE, one_entry)),
    "com-jacobian-symmetric": Wrong(
        "tree", plus("com_jacobian", TREE, lambda q: q[2] * one_entry())
    ),
    "com-velocity": Wrong("tree", plus("com_velocity", TREE, lambda q, v: [0, 1, 0])),
    "com-rate": Wrong("tree", plus("com", TREE, lambda q: [q[0], 0, 0])),
    "com-acceleration": Wrong("tree", plus("com_acceleration", TREE, lambda *_: [0, 1, 0])),
    "com-gravity": Wrong("tree", plus("com_jacobian", TREE, one_entry)),
    "com-kinetic-energy": Wrong(
        "tree", lambda eps: {"mass": 1e3 * EVERY["mass"]} if eps else {}, counted=False
    ),
    "com-momentum": Wrong("tree", lambda eps: {"mass": EVERY["mass"] + eps}),
    "mass-parameters": Wrong("tree", lambda eps: {"mass": EVERY["mass"] + eps}),
    "momentum-linear": Wrong("tree", plus("momentum", TREE, lambda *_: np.eye(6)[4])),
    "momentum-matrix": Wrong("tree", plus("momentum_matrix", TREE, lambda q: one_row())),
    "momentum-rate": Wrong("tree", plus("momentum_rate", TREE, lambda *_: np.eye(6)[5])),
    "com-momentum-rate": Wrong("tree", plus("momentum_rate", TREE, lambda *_: np.eye(6)[2])),
    "frame-rotation": Wrong("tree", of_tool("frame_placement", stretched)),
    "frame-jacobian": Wrong("tree", of_tool("J", lambda x, eps, *_: x + eps * one_row())),
    "frame-jacobian-symmetric": Wrong(
        "tree", of_tool("J", lambda x, eps, q: x + eps * q[1] * one_row())
    ),
    "frame-velocity": Wrong("tree", of_tool("frame_velocity", one_more)),
    "frame-rate": Wrong("tree", of_tool("frame_velocity", one_more)),
    "frame-bias": Wrong("tree", of_tool("frame_bias", one_more)),
    "frame-acceleration": Wrong("tree", of_tool("frame_acceleration", one_more)),
    "frame-acceleration-bias": Wrong("tree", of_tool("frame_acceleration", one_more)),
    "reference": Wrong(
        "cart",
        lambda eps: {
            "gravity": lambda q: CART.gravity(q) + eps * np.array([0, 1, 0]),
            "against": EquationsOfMotion(**given("cart")),
        },
    ),
}


@pytest.mark.parametrize("nth", [2, 4, 7, 50, 97])
@pytest.mark.sampled(3)
def test_an_answer_that_is_stale_in_every_nth_call_fails(nth: int):
    options = {"gravity": Stale(nth).gravity, "states": 8, "claims": REPEAT}
    found = check_functions(**(given("cart") | options))
    assert [one.subject for one in found if one.verdict == "failed"] == ["gravity"]


def stale_is_seen(nth: int, before: int, states: int) -> bool:
    """Whether gravity fails that is stale in every nth call, of which some came before."""
    stale = Stale(nth)
    stale.calls = before
    found = check_functions(3, gravity=stale.gravity, states=states, claims=REPEAT)
    return [one.subject for one in found if one.verdict == "failed"] == ["gravity"]


@pytest.mark.parametrize("nth", [24, 50, 54])
def test_a_stale_answer_of_any_period_to_54_shows_in_one_state(nth: int):
    missed = [before for before in range(nth) if not stale_is_seen(nth, before, 1)]
    assert not missed


def test_a_stale_answer_that_depends_on_differences_of_coordinates_shows():
    """As the mass matrix of a chain with absolute angles: it is the same turned as a whole."""
    calls, last = [0], [np.zeros(3)]

    def gravity(q):
        calls[0] += 1
        if calls[0] % 50:
            last[0] = np.sin(q - np.roll(q, 1))
        return last[0]

    found = check_functions(3, gravity=gravity, states=1, claims=REPEAT)
    assert [one.subject for one in found if one.verdict == "failed"] == ["gravity"]


@pytest.mark.night
def test_a_period_of_as_many_calls_as_each_state_takes_shows():
    """Stale answers would fall on the same call of each state if all took as many."""
    calls = []

    def counted(q):
        calls.append(q)
        return CART.gravity(q)

    check_functions(3, gravity=counted, states=20, claims=REPEAT, ranges=(-1, 1))
    each = len(calls) // 20
    missed = [before for before in range(4, each, 8) if not stale_is_seen(each, before, 20)]
    assert not missed


@pytest.mark.sampled(2)
@pytest.mark.parametrize("digits", [3, 4, 5, 6, 8])
def test_a_cache_by_rounded_coordinates_fails(digits: int):
    kept: dict[Any, Any] = {}

    def gravity(q):
        return kept.setdefault(tuple(np.round(q, digits)), CART.gravity(q))

    found = check_functions(**(given("cart") | {"gravity": gravity}), claims=REPEAT, states=5)
    details = [one.detail for one in found if one.verdict == "failed"]
    assert any("gravity, does not feel small changes of q" in one for one in details)


def test_a_cache_by_seven_digits_has_the_precision_of_singles():
    kept: dict[Any, Any] = {}

    def gravity(q):
        return kept.setdefault(tuple(np.round(q, 7)), CART.gravity(q))

    claims = ["double-precision"]
    found = check_functions(**(given("cart") | {"gravity": gravity}), claims=claims, states=5)
    (failed,) = [one for one in found if one.verdict == "failed"]
    assert "gravity, does not feel small changes of q" in failed.detail


def test_single_precision_is_not_taken_for_a_cache():
    def gravity(q):
        x = q.astype(np.float32)
        return (9.81 * np.sin(x) + np.float32(0.1) * x).astype(np.float64)

    found = check_functions(3, gravity=gravity, claims=REPEAT)
    assert {one.verdict for one in found} == {"passed"}


def test_one_coordinate_that_is_rounded_is_named():
    def gravity(q):
        return CART.gravity(np.array([q[0], np.round(q[1], 6), q[2]]))

    found = check_functions(**(given("cart") | {"gravity": gravity}), claims=REPEAT, states=3)
    (failed,) = [one for one in found if one.verdict == "failed"]
    assert failed.detail == "gravity, does not feel small changes of q[1]: cached?"


@pytest.mark.parametrize(
    "gravity",
    [
        lambda q: [(np.sin(q[0]) ** 2 + np.cos(q[0]) ** 2 - 1.0) * 1e3],
        lambda q: [1e-17 * np.round(q[0] * 2.0**16), np.sin(q[1])],
    ],
)
def test_what_vanishes_but_for_rounding_is_not_taken_for_a_cache(gravity: Callable):
    n = len(gravity(np.zeros(2)))
    found = check_functions(n, gravity=gravity, claims=REPEAT, states=50)
    assert [one.verdict for one in found] == ["passed"]


def test_an_entry_in_which_large_terms_cancel_is_not_taken_for_a_cache():
    """The last entry of C of this tree is 0 but for rounding, in steps that double by chance."""
    q = [-0.28329282336421846, 7.789756686980005, 8.680870319124994]
    state = (q, [-2.8440960658185954, 1.4305966145952187, -3.562612178481157])
    options = {"ranges": (-10.0, 10.0), "states": [state], "claims": REPEAT}
    found = check_functions(**random_tree(44), **options)
    assert {one.verdict for one in found} == {"passed"}


@pytest.mark.parametrize(
    "own",
    [
        {"gravity": lambda q: [5.0 * q[1], 2.0 * q[0]]},
        {"bias": lambda q, v: [5.0 * q[1], 2.0 * q[0]], "bias_has_gravity": True},
    ],
)
def test_rows_of_gravity_are_named_with_their_own_derivatives(own: dict[str, Any]):
    (found,) = check_functions(2, **own, claims=["gravity-potential"], states=1)
    assert found.verdict == "failed"
    assert found.detail == (
        "gravity, entry (q[0], q[1]): row q[1] changes by 2 per q[0], and row q[0] by 5 per q[1]"
    )


@pytest.mark.parametrize(
    ("added", "named"),
    [
        ((0.0, 3.0), "row q[1] differs from ∂U/∂q; row "),
        ((3.0, 0.0), "row q[0] differs from ∂U/∂q; row "),
        ((5.0, 2.0), "row "),  # all of them: the entries alone
    ],
)
def test_rows_of_gravity_that_are_no_derivatives_of_the_potential_are_named(added, named: str):
    def gravity(q):
        (sin, other), (cos, beside) = np.sin(q), np.cos(q)
        return [cos * beside + added[0] * q[1], -sin * other + added[1] * q[0]]

    own = {"gravity": gravity, "U": lambda q: np.sin(q[0]) * np.cos(q[1])}
    (found,) = check_functions(2, **own, claims=["gravity-potential"], states=3)[:1]
    assert found.verdict == "failed"
    detail = found.detail.partition(": ")[2]
    assert detail.startswith(f"{named}q[" if named == "row " else named)
    assert detail.count("differ") == (named != "row ")


DAMPERS = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])
DISSIPATION = ["dissipation-positive"]


def dissipation(damping: Callable[..., Any], **options: Any) -> list[Finding]:
    return check_functions(3, R=damping, claims=DISSIPATION, **options)


@pytest.mark.parametrize(
    "damping",
    [
        lambda q, v: -v @ DAMPERS @ v / 2,
        lambda q, v: v @ (DAMPERS - 0.9 * np.eye(3)) @ v / 2,  # one combination of all three
        lambda q, v: v @ np.diag([1.0, 1.0, -1e-6]) @ v / 2,
        lambda q, v: abs(v[0]) - 0.1 * abs(v[2]) ** 3,
        lambda q, v: v @ DAMPERS @ v / 2 * q[0],
    ],
)
def test_a_damper_that_feeds_energy_fails(damping: Callable):
    (found,) = dissipation(damping)
    assert found.verdict == "failed" and found.state is not None
    v, less = re.findall(r"feeds energy at v = \[(.*)\], where R is (.*) W less", found.detail)[0]
    q, there = found.state.q, np.array([float(x) for x in v.split(",")])
    change = damping(q, there) + damping(q, -there) - 2.0 * damping(q, 0.0 * there)
    assert change == pytest.approx(-2.0 * float(less), rel=0.02)


@pytest.mark.parametrize(
    "damping",
    [
        lambda q, v: v @ DAMPERS @ v / 2,
        lambda q, v: (v[0] - v[1]) ** 2,
        lambda q, v: np.outer(v, v) @ [1.0, 0.1, 0.3] @ [1.0, 0.1, 0.3],  # semidefinite, rounded
        lambda q, v: (v[0] - 3.0) ** 2,  # against a belt that moves
        lambda q, v: abs(v[0]) + 0.2 * abs(v[1]) ** 3,
        lambda q, v: 0.0,
    ],
)
def test_dampers_that_take_energy_pass(damping: Callable):
    for ranges in ((-1.0, 1.0), [(-1.0, 1.0)] * 3 + [(-1.0, 1.0), (-1e3, 1e3), (-1e-3, 2e-3)]):
        (found,) = dissipation(damping, ranges=ranges)
        assert (found.verdict, found.detail) == ("passed", "")


def test_dampers_are_asked_in_the_directions_that_constraints_leave():
    def damping(q, v):  # of v[1] = v[0], which constraints say: the first damper is counted twice
        return v @ np.diag([2.0, -1.0, 1.0]) @ v

    together = {"a": lambda q: [[1.0, -1.0, 0.0]]}
    assert [x.verdict for x in dissipation(damping, **together)] == ["passed"]
    assert [x.verdict for x in dissipation(damping)] == ["failed"]


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_motion_is_asked_in_every_direction_that_dependent_rows_of_constraints_leave(rows: int):
    """One coordinate is held, by so many rows that say the same, and one of two is free."""

    def verdicts(factor: float) -> list[tuple[str, str]]:
        found = check_functions(
            2,
            M=lambda q: np.eye(2),
            bias=lambda q, v: np.zeros(2),
            gravity=lambda q: np.array([0.0, 1.0 + q[1] ** 2]),
            qdd=lambda q, v: np.array([0.0, -factor * (1.0 + q[1] ** 2)]),
            a=lambda q: np.outer(np.arange(1.0, rows + 1.0), [1.0, 0.0]),
            claims=["motion"],
            states=2,
        )
        return [(one.verdict, one.detail) for one in found if one.verdict != "skipped"]

    assert [verdict for verdict, _ in verdicts(1.0)] == ["passed"]
    ((verdict, detail),) = verdicts(2.0)
    assert verdict == "failed"
    assert "row free direction 0" in detail


def test_damping_that_rounding_hides_is_not_resolved():
    (found,) = dissipation(lambda q, v: 1e14 + v[0] ** 2, states=STATES["cart"])
    assert found.verdict == "inconclusive"
    (found,) = dissipation(lambda q, v: v[0] ** 2 if v[0] > -0.01 else np.nan, states=3)
    assert found.verdict == "skipped"


def test_a_write_into_velocities_alone_fails():
    def bias(q, v):
        found = CART.bias(q, v)
        v *= 0.5
        return found

    found = check_functions(3, bias=bias, states=1, claims=["arguments-unchanged"])
    assert [(one.subject, one.verdict) for one in found] == [("bias", "failed")]


@pytest.mark.parametrize("nth", [1, 97, 500])
@pytest.mark.night
def test_a_write_into_arguments_anywhere_in_a_run_fails(nth: int):
    calls = 0

    def gravity(q):
        nonlocal calls
        calls += 1
        found = CART.gravity(q)
        if calls % nth == 0:
            q[0] *= 1.0 + EPS
        return found

    found = check_functions(**(given("cart") | {"gravity": gravity}))
    assert "arguments-unchanged" in {one.claim for one in found if one.verdict == "failed"}
    order = list(dict.fromkeys(one.claim for one in found))
    assert order == [one for one in FUNCTION_CLAIMS if one in order]


def looked_at(id: str, eps: float, **options: Any) -> list[Finding]:
    wrong = WRONG[id]
    more = given(wrong.own) | wrong.change(eps) | {"states": STATES[wrong.own]} | options
    return check_functions(**more)


def worst(id: str, eps: float) -> Finding:
    """Return the Finding of the claim alone that is closest to failing."""
    found = looked_at(id, eps, claims=[id])
    return max((x for x in found if x.verdict != "skipped"), key=lambda x: x.ratio)


def test_every_claim_is_tried():
    assert set(WRONG) == set(FUNCTION_CLAIMS)


@pytest.mark.sampled(11)
@pytest.mark.parametrize("id", WRONG)
def test_right_functions_pass_the_claim_and_wrong_ones_fail_by_it(id: str):
    right = looked_at(id, 0.0, claims=[id])
    assert right
    if id != "mass-matrix-positive":  # singular at 0
        assert {x.verdict for x in right} == {"passed"}
    failed = [x for x in looked_at(id, 1e-3) if x.verdict == "failed"]
    assert id in {x.claim for x in failed}
    (named,) = [x for x in failed if x.claim == id][:1]
    assert named.detail


@pytest.mark.parametrize("id", [id for id, wrong in WRONG.items() if wrong.counted])
@pytest.mark.sampled(4)
def test_ten_times_what_is_allowed_fails_and_a_tenth_does_not(id: str):
    if id == "mass-matrix-positive":
        (allowed, per_eps), passes = (worst(id, 0.0).allowed, 2.0), "inconclusive"
    else:
        large = worst(id, 1e-3)
        per_eps, passes = large.observed / 1e-3, "passed"
        allowed = worst(id, 100.0 * large.allowed / per_eps).allowed
    assert worst(id, 10.0 * allowed / per_eps).verdict == "failed"
    assert worst(id, 0.1 * allowed / per_eps).verdict == passes


def test_a_write_into_arguments_before_an_exception_fails_too():
    def gravity(q):
        q[0] += 1.0
        raise ValueError("no gravity here")

    functions: dict[str, Any] = given("cart") | {"gravity": gravity}
    found = check_functions(**functions, states=1)
    written = [one for one in found if one.claim == "arguments-unchanged"]
    assert [one.subject for one in written if one.verdict == "failed"] == ["gravity"]


@pytest.mark.parametrize("writes", [False, True])
def test_a_write_into_arrays_of_another_library_fails(writes):
    class Copied(list):
        """Stands for an array of another library, whose memory is its own."""

    def gravity(q):
        found = CART.gravity(np.array(q))
        q[1] += 0.5 * writes
        return found

    found = check_functions(3, gravity=gravity, array=lambda x: Copied(x.tolist()), states=1)
    written = [one.verdict for one in found if one.claim == "arguments-unchanged"]
    assert written == ["failed" if writes else "passed"]


def test_a_function_that_the_factory_does_not_make_is_named():
    made = {"gravity": CART.gravity}
    functions: dict[str, Any] = given("cart") | {"factory": lambda: made}
    found = check_functions(**functions, states=1)
    fresh = {x.subject: (x.verdict, x.detail) for x in found if x.claim == "fresh-answer"}
    assert fresh["gravity"][0] == "passed"
    assert fresh["M"] == ("skipped", "the factory makes no M")


def test_an_answer_of_the_last_call_is_seen_where_only_differences_of_coordinates_count():
    last = [np.zeros(3)]

    def gravity(q):  # of a chain that is not held anywhere, one call late after 1 radian
        here = np.array([q[0], -q[0], 0.0]) - np.array([q[1], -q[1], 0.0])
        kept, last[0] = last[0], here
        return kept if np.abs(kept - here).max() < 0.3 else here

    found = check_functions(3, gravity=gravity, states=1, claims=["same-answer"])
    assert [one.verdict for one in found] == ["failed"]


# ---- Asked for, and nothing to look at -----------------------------------------------------------


@pytest.mark.parametrize("claim", FUNCTION_CLAIMS)
def test_a_claim_that_is_asked_for_alone_says_something_whatever_is_given(claim: str):
    one: list[dict[str, Any]] = [
        {"M": lambda q: np.eye(1)},
        {"U": lambda q: 0.0},
        {"M": lambda q: np.eye(1), "bias": lambda q, v: 0.0 * v, "qdot": lambda q, u: u},
    ]
    for functions in one:
        found = check_functions(1, **functions, claims=[claim], states=2)
        assert found and {x.claim for x in found} == {claim}
        assert all(x.detail for x in found if x.verdict != "passed")


def test_a_claim_that_is_asked_for_names_what_it_needs_where_that_is_missing():
    asked = ["motion", "fresh-answer", "coriolis-skew", "bias-power", "mass-matrix-symmetric"]
    found = check_functions(1, M=lambda q: np.eye(1), claims=asked, states=2)
    assert [(x.claim, x.verdict, x.detail) for x in found] == [
        ("motion", "skipped", "needs (M or T) and qdd"),
        ("fresh-answer", "skipped", "needs factory"),
        ("coriolis-skew", "skipped", "needs C and (M or T), without qdot"),
        ("bias-power", "skipped", "needs (M or T) and bias"),
        ("mass-matrix-symmetric", "passed", ""),
    ]
    # Where all are asked for, those that do not concern what is given are left out.
    every = check_functions(1, M=lambda q: np.eye(1), states=2)
    assert not any(x.detail.startswith("needs ") for x in every)
    functions = EquationsOfMotion(1, M=lambda q: np.eye(1))
    details = [x.detail for x in caveats(functions, ["motion", "mass-matrix-symmetric"])]
    assert details == ["needs (M or T) and qdd"]
    assert not any(x.detail.startswith("needs ") for x in caveats(functions, FUNCTION_CLAIMS))
