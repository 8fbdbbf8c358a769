"""Faults in what libraries have beside M and B: each is caught, its function and sort are named.

`FAULTS` lists them: id, the function that is wrong, the change, and a text that names its sort. The
functions are those of a tree by Pinocchio with turning and sliding joints, one of them with a free
base. Right functions of other trees pass.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.testing.every_function import (
    OURS,
    TOOL,
    Functions,
    every_function,
    random_model,
    with_free_base,
)

from eomcheck.claims.finding import Finding
from eomcheck.testing import check_functions
from eomcheck.testing.claims_derivatives import moments_about_center

FRAMES = "frame_placement J frame_velocity frame_bias frame_acceleration com"
CENTER = "com com_jacobian com_velocity com_acceleration mass momentum_matrix momentum "
CENTER += "momentum_rate parameters"
DYNAMICS = "M bias gravity C qdd inverse_dynamics tau_q tau_v qdd_q qdd_v qdd_tau "
DYNAMICS += "inverse_mass_matrix regressor parameters"

CHAIN, SLIDES = "RX PZ RY PX", [1, 3]
"""Joints of the chain with a fixed base, and which of them slide."""


@cache
def tree(free: bool) -> Functions:
    """Return every function of a tree: of four joints, or of two on a free base."""
    if free:
        return with_free_base(random_model(3, True, joints=2))
    return every_function(random_model(0, chain=CHAIN))


Change = Callable[[Functions], Any]


class Fault(NamedTuple):
    """A mistake in one function.

    Attributes:
        wrong: name of the function.
        change: functions -> the wrong one, or the dict of those of frames.
        sort: text in the findings that names the sort of mistake.
        family: names of the functions that are given.
        free: whether the tree has a free base.
    """

    wrong: str
    change: Change
    sort: str
    family: str
    free: bool = False


def after(name: str, change: Callable[..., Any]) -> Change:
    """Return the change of a result: `change(result, functions, *arguments)`."""

    def make(f: Functions) -> Any:
        if isinstance(f[name], dict):
            return f[name] | {TOOL: lambda *x: change(f[name][TOOL](*x), f, *x)}
        return wraps(f[name])(lambda *x: change(f[name](*x), f, *x))

    return make


def stale(name: str) -> Change:
    """Return the change to the result of the previous call."""

    def make(f: Functions) -> Any:
        function = f[name][TOOL] if isinstance(f[name], dict) else f[name]
        last: list[Any] = []

        def previous(*x: Any) -> Any:
            last.append(function(*x))
            return last.pop(0) if len(last) > 1 else last[0]

        return (
            f[name] | {TOOL: previous} if isinstance(f[name], dict) else wraps(function)(previous)
        )

    return make


def single(name: str) -> Change:
    """Return the change to arithmetic in single precision, in results of doubles."""

    def change(result: Any, f: Functions, *_: Any) -> Any:
        return np.asarray(result).astype(np.float32).astype(np.float64)

    return after(name, change)


def placed(f: Functions, q: Any) -> tuple[Any, Any]:
    return f["frame_placement"][TOOL](q)


def local(x: Any, f: Functions, q: Any, *_: Any) -> Any:
    R, _p = placed(f, q)
    return np.concatenate((R.T @ x[:3], R.T @ x[3:]))


def part_local(part: slice) -> Callable[..., Any]:
    def change(x: Any, f: Functions, q: Any, *_: Any) -> Any:
        y = np.array(x)
        y[part] = placed(f, q)[0].T @ x[part]
        return y

    return change


def at_point(point: Callable[[Functions, Any], Any]) -> Callable[..., Any]:
    """Return the change of the linear part to that at another point."""

    def change(x: Any, f: Functions, q: Any, *_: Any) -> Any:
        arm = point(f, q) - placed(f, q)[1]
        return np.concatenate((x[:3] + np.cross(x[3:].T, arm).T, x[3:]))

    return change


def origin(f: Functions, q: Any) -> Any:
    return np.zeros(3)


def swapped(x: Any, *_: Any) -> Any:
    return np.concatenate((x[3:], x[:3]))


def scaled(factor: float, part: Any = ...) -> Callable[..., Any]:
    def change(x: Any, *_: Any) -> Any:
        y = np.array(x, float)
        y[part] = factor * y[part]
        return y

    return change


def spatial(x: Any, f: Functions, q: Any, v: Any, *_: Any) -> Any:
    V = f["frame_velocity"][TOOL](q, v)
    return np.concatenate((x[:3] - np.cross(V[3:], V[:3]), x[3:]))


def without_drift(name: str, bias: str) -> Change:
    """Return the change that leaves out the value at v̇ = 0."""

    def change(x: Any, f: Functions, q: Any, v: Any, vdot: Any) -> Any:
        function = f[bias][TOOL] if isinstance(f[bias], dict) else f[bias]
        return x - (function(q, v) if bias == "frame_bias" else function(q, v, 0.0 * vdot))

    return after(name, change)


def on_columns(change: Callable[..., Any], columns: Any) -> Callable[..., Any]:
    """Return a change of some columns alone."""

    def changed(x: Any, *more: Any) -> Any:
        y = np.array(x)
        y[..., columns] = change(x, *more)[..., columns]
        return y

    return changed


def about_origin(x: Any, f: Functions, q: Any, *_: Any) -> Any:
    """Return momenta about the origin of the world."""
    return np.concatenate((x[:3], x[3:] + np.cross(f["com"](q), x[:3].T).T))


def missing_speeds(f: Functions, J: Any, q: Any, u: Any) -> Any:
    """Return J S⁻¹ Ṡ u, which is missing where S of q̇ = S u is taken for constant."""
    h, rate = 1e-6, f["qdot"](q, u)
    change = (speeds(f, q + h * rate) - speeds(f, q - h * rate)) / (2.0 * h)
    return J @ np.linalg.solve(speeds(f, q), change @ u)


def speeds(f: Functions, q: Any) -> Any:
    """Return S of q̇ = S u."""
    return np.array([f["qdot"](q, axis) for axis in np.eye(len(q))]).T


def unweighted(f: Functions) -> Any:
    return lambda q: f["com"](q) * np.array([1.0, 1.0, 0.9]) + 0.1 * np.sin(q[0])


def in_order(order: Any) -> Callable[..., Any]:
    def change(x: Any, *_: Any) -> Any:
        return x[order] if np.ndim(x) == 1 else x[np.ix_(order, order)]

    return change


def regressor_columns(order: Any) -> Callable[..., Any]:
    """Return the change of the order of the ten columns of each body."""

    def change(x: Any, *_: Any) -> Any:
        return x.reshape(len(x), -1, 10)[:, :, order].reshape(len(x), -1)

    return change


def mass_matrix(x: Any, f: Functions, q: Any, *_: Any) -> Any:
    return f["M"](q)


def of_diagonal(x: Any, f: Functions, q: Any, *_: Any) -> Any:
    return np.diag(1.0 / np.diag(f["M"](q)))


def transposed(x: Any, *_: Any) -> Any:
    return x.T


def response(f: Functions, q: Any, forces: Any) -> Any:
    return np.linalg.solve(f["M"](q), forces)


def without_weight(x: Any, f: Functions, q: Any, v: Any, tau: Any) -> Any:
    return x + response(f, q, f["tau_q"](q, 0.0 * v, 0.0 * v))


OTHERS = [1, 0, 3, 2]
OWN, WORLD = "own axes, expected along the world's", "at the world's origin"
FIRST, FLOAT32 = "angular part first", "float32 arithmetic"

FAULTS: dict[str, Fault] = {
    # Frames
    "J-local": Fault("J", after("J", local), OWN, FRAMES),
    "J-angular-first": Fault("J", after("J", swapped), FIRST, FRAMES),
    "J-local-angular-first": Fault("J", after("J", lambda *x: swapped(local(*x))), FIRST, FRAMES),
    "J-at-origin": Fault("J", after("J", at_point(origin)), WORLD, FRAMES),
    "J-at-center-of-mass": Fault(
        "J", after("J", at_point(lambda f, q: f["com"](q))), "at the center of mass", FRAMES
    ),
    "J-angular-local": Fault(
        "J", after("J", part_local(slice(3, 6))), f"angular part along the frame's {OWN}", FRAMES
    ),
    "J-linear-local": Fault(
        "J", after("J", part_local(slice(0, 3))), f"linear part along the frame's {OWN}", FRAMES
    ),
    "J-angular-sign": Fault("J", after("J", scaled(-1.0, slice(3, 6))), "wrong sign", FRAMES),
    "J-slides-local": Fault("J", after("J", on_columns(local, SLIDES)), OWN, FRAMES),
    "J-column-missing": Fault("J", after("J", scaled(0.0, (..., 0))), "missing", FRAMES),
    "J-degrees": Fault("J", after("J", scaled(np.pi / 180.0)), "per degree", FRAMES),
    "J-float32": Fault("J", single("J"), FLOAT32, FRAMES),
    "J-stale": Fault("J", stale("J"), "earlier call", FRAMES),
    "J-joints-exchanged": Fault(
        "J", after("J", lambda x, *_: x[:, OTHERS]), "joints in another order", FRAMES
    ),
    "J-of-another-frame": Fault("J", lambda f: f["J"] | {TOOL: f["J"]["side"]}, "expected", FRAMES),
    "placement-transposed": Fault(
        "frame_placement",
        after("frame_placement", lambda x, *_: (x[0].T, x[1])),
        "R of frame_placement is transposed",
        FRAMES,
    ),
    "placement-inverse": Fault(
        "frame_placement",
        after("frame_placement", lambda x, *_: (x[0].T, -x[0].T @ x[1])),
        "of the world in the frame",
        FRAMES,
    ),
    "placement-left-handed": Fault(
        "frame_placement",
        after("frame_placement", lambda x, *_: (x[0] * [1, 1, -1], x[1])),
        "left-handed",
        FRAMES,
    ),
    "velocity-local": Fault("frame_velocity", after("frame_velocity", local), OWN, FRAMES),
    "velocity-angular-first": Fault(
        "frame_velocity", after("frame_velocity", swapped), FIRST, FRAMES
    ),
    "velocity-at-origin": Fault(
        "frame_velocity", after("frame_velocity", at_point(origin)), WORLD, FRAMES
    ),
    "velocity-degrees": Fault(
        "frame_velocity",
        after("frame_velocity", scaled(180.0 / np.pi, slice(3, 6))),
        "in degrees",
        FRAMES,
    ),
    "bias-missing": Fault("frame_bias", after("frame_bias", scaled(0.0)), "missing", FRAMES),
    "bias-spatial": Fault(
        "frame_bias", after("frame_bias", spatial), "spatial acceleration", FRAMES
    ),
    "bias-local": Fault("frame_bias", after("frame_bias", local), OWN, FRAMES),
    "bias-sign": Fault("frame_bias", after("frame_bias", scaled(-1.0)), "wrong sign", FRAMES),
    "frame-acceleration-spatial": Fault(
        "frame_acceleration", after("frame_acceleration", spatial), "spatial acceleration", FRAMES
    ),
    "frame-acceleration-without-drift": Fault(
        "frame_acceleration",
        without_drift("frame_acceleration", "frame_bias"),
        "without J̇ v",
        FRAMES,
    ),
    "frame-acceleration-local": Fault(
        "frame_acceleration", after("frame_acceleration", local), OWN, FRAMES
    ),
    "bias-without-Ṡ": Fault(
        "frame_bias",
        after("frame_bias", lambda x, f, q, u: x - missing_speeds(f, f["J"][TOOL](q), q, u)),
        "expected",
        FRAMES + " qdot",
        free=True,
    ),
    "J-angular-rows-of-a-free-base": Fault(
        "J", after("J", scaled(-3.0, slice(3, 6))), "expected", "frame_placement qdot", free=True
    ),
    # Center of mass and momentum
    "com-off": Fault("com", unweighted, "expected", CENTER),
    "com-jacobian-sign": Fault(
        "com_jacobian", after("com_jacobian", scaled(-1.0, (..., 0))), "wrong sign", CENTER
    ),
    "com-jacobian-twice": Fault(
        "com_jacobian", after("com_jacobian", scaled(2.0)), "twice", CENTER
    ),
    "com-jacobian-float32": Fault("com_jacobian", single("com_jacobian"), FLOAT32, CENTER),
    "com-velocity-stale": Fault("com_velocity", stale("com_velocity"), "earlier call", CENTER),
    "com-velocity-sign": Fault(
        "com_velocity", after("com_velocity", scaled(-1.0)), "wrong sign", CENTER
    ),
    "com-acceleration-without-drift": Fault(
        "com_acceleration",
        without_drift("com_acceleration", "com_acceleration"),
        "without J̇ v",
        CENTER,
    ),
    "com-acceleration-without-Ṡ": Fault(
        "com_acceleration",
        after(
            "com_acceleration",
            lambda x, f, q, u, _: x - missing_speeds(f, f["com_jacobian"](q), q, u),
        ),
        "expected",
        CENTER + " qdot",
        free=True,
    ),
    "momentum-about-origin": Fault(
        "momentum",
        after("momentum", about_origin),
        "expected",
        CENTER,
    ),
    "momentum-matrix-about-origin": Fault(
        "momentum_matrix",
        after("momentum_matrix", about_origin),
        "angular part about the world's origin",
        CENTER,
    ),
    "momentum-matrix-angular-first": Fault(
        "momentum_matrix", after("momentum_matrix", swapped), FIRST, CENTER
    ),
    "momentum-matrix-angular-rows-of-a-free-base": Fault(
        "momentum_matrix",
        after("momentum_matrix", scaled(-3.0, slice(3, 6))),
        "expected",
        "momentum_rate qdot",
        free=True,
    ),
    "momentum-without-mass": Fault(
        "momentum",
        lambda f: lambda q, v: f["momentum"](q, v) / f["mass"],
        "without the mass",
        CENTER,
    ),
    "momentum-rate-without-drift": Fault(
        "momentum_rate", without_drift("momentum_rate", "momentum_rate"), "without Ȧ v", CENTER
    ),
    "mass-without-a-body": Fault(
        "mass", lambda f: f["mass"] - f["parameters"][0], "expected", CENTER
    ),
    # Inverse dynamics and its derivatives
    "inverse-dynamics-without-gravity": Fault(
        "inverse_dynamics",
        after("inverse_dynamics", lambda x, f, q, *_: x - f["gravity"](q)),
        "without gravity",
        DYNAMICS,
    ),
    "inverse-dynamics-gravity-sign": Fault(
        "inverse_dynamics",
        after("inverse_dynamics", lambda x, f, q, *_: x - 2.0 * f["gravity"](q)),
        "expected",
        DYNAMICS,
    ),
    "inverse-dynamics-without-bias": Fault(
        "inverse_dynamics",
        after("inverse_dynamics", lambda x, f, q, v, _: x - f["bias"](q, v)),
        "without the bias",
        DYNAMICS,
    ),
    "inverse-dynamics-without-acceleration": Fault(
        "inverse_dynamics",
        after("inverse_dynamics", lambda x, f, q, v, vdot: x - f["M"](q) @ vdot),
        "without M v̇",
        DYNAMICS,
    ),
    "tau-q-transposed": Fault("tau_q", after("tau_q", transposed), "transposed", DYNAMICS),
    "tau-q-without-gravity": Fault(
        "tau_q",
        after("tau_q", lambda x, f, q, v, vdot: x - f["tau_q"](q, 0.0 * v, 0.0 * vdot)),
        "without the derivative of gravity",
        DYNAMICS,
    ),
    "tau-q-without-acceleration": Fault(
        "tau_q",
        after("tau_q", lambda x, f, q, v, vdot: f["tau_q"](q, v, 0.0 * vdot)),
        "without the derivative of M v̇",
        DYNAMICS,
    ),
    "tau-q-of-coordinates": Fault(
        "tau_q",
        after("tau_q", lambda x, f, q, *_: x @ np.linalg.inv(speeds(f, q))),
        "expected",
        DYNAMICS + " qdot",
        free=True,
    ),
    "tau-v-is-C": Fault(
        "tau_v", after("tau_v", lambda x, f, q, v, _: f["C"](q, v)), "half", DYNAMICS
    ),
    "tau-v-half": Fault("tau_v", after("tau_v", scaled(0.5)), "half", DYNAMICS),
    "tau-v-slides-missing": Fault(
        "tau_v", after("tau_v", scaled(0.0, (..., SLIDES))), "missing", DYNAMICS
    ),
    "tau-v-float32": Fault("tau_v", single("tau_v"), FLOAT32, DYNAMICS),
    # Derivatives of the acceleration
    "qdd-q-without-forces": Fault(
        "qdd_q",
        after("qdd_q", lambda x, f, q, v, tau: f["qdd_q"](q, v, 0.0 * tau)),
        "at τ = 0",
        DYNAMICS,
    ),
    "qdd-q-without-inverse": Fault(
        "qdd_q", after("qdd_q", lambda x, f, q, *_: -f["M"](q) @ x), "M is left out", DYNAMICS
    ),
    "qdd-q-without-gravity": Fault(
        "qdd_q", after("qdd_q", without_weight), "without the derivative of gravity", DYNAMICS
    ),
    "qdd-q-of-weightless-system": Fault(
        "qdd_q",
        lambda f: (
            lambda q, v, tau: without_weight(f["qdd_q"](q, v, tau + f["gravity"](q)), f, q, v, tau)
        ),
        "of q̈ without gravity",
        DYNAMICS,
    ),
    "qdd-q-without-acceleration": Fault(
        "qdd_q",
        after("qdd_q", lambda x, f, q, v, _: response(f, q, -f["tau_q"](q, v, 0.0 * v))),
        "without the derivative of M v̇",
        DYNAMICS,
    ),
    "qdd-q-sign": Fault("qdd_q", after("qdd_q", scaled(-1.0)), "wrong sign", DYNAMICS),
    "qdd-q-transposed": Fault("qdd_q", after("qdd_q", transposed), "transposed", DYNAMICS),
    "qdd-v-half": Fault("qdd_v", after("qdd_v", scaled(0.5)), "half", DYNAMICS),
    "qdd-v-slides-sign": Fault(
        "qdd_v", after("qdd_v", scaled(-1.0, (..., SLIDES))), "wrong sign", DYNAMICS
    ),
    "qdd-v-stale": Fault("qdd_v", stale("qdd_v"), "earlier call", DYNAMICS),
    "qdd-tau-is-M": Fault("qdd_tau", after("qdd_tau", mass_matrix), "not inverted", DYNAMICS),
    "qdd-tau-of-diagonal": Fault(
        "qdd_tau", after("qdd_tau", of_diagonal), "inverse of the diagonal", DYNAMICS
    ),
    "qdd-tau-joints-exchanged": Fault(
        "qdd_tau", after("qdd_tau", in_order(OTHERS)), "joints in another order", DYNAMICS
    ),
    "qdd-tau-sign-of-forces": Fault(
        "qdd",
        after("qdd", lambda x, f, q, v, tau: f["qdd"](q, v, -tau)),
        "wrong sign",
        DYNAMICS,
    ),
    "inverse-mass-matrix-of-diagonal": Fault(
        "inverse_mass_matrix",
        after("inverse_mass_matrix", of_diagonal),
        "inverse of the diagonal",
        DYNAMICS,
    ),
    "inverse-mass-matrix-triangle": Fault(
        "inverse_mass_matrix",
        after("inverse_mass_matrix", lambda x, *_: np.triu(x)),
        "triangle",
        DYNAMICS,
    ),
    # Regressor
    "regressor-order": Fault(
        "regressor",
        after("regressor", regressor_columns(OURS)),
        "order xx xy yy xz yz zz",
        DYNAMICS,
    ),
    "regressor-without-gravity": Fault(
        "regressor",
        after("regressor", lambda x, f, q, v, a: x - f["regressor"](q, 0.0 * v, 0.0 * a)),
        "without gravity",
        DYNAMICS,
    ),
    "regressor-bodies-reversed": Fault(
        "regressor",
        after("regressor", lambda x, *_: x.reshape(len(x), -1, 10)[:, ::-1].reshape(len(x), -1)),
        "bodies in opposite order",
        DYNAMICS,
    ),
    "parameters-about-center": Fault(
        "parameters",
        lambda f: moments_about_center(f["parameters"].reshape(-1, 10)).ravel(),
        "π has moments of inertia about the center of mass",
        DYNAMICS,
    ),
    "regressor-without-bias": Fault(
        "regressor",
        after("regressor", lambda x, f, q, v, a: f["regressor"](q, 0.0 * v, a)),
        "expected",
        DYNAMICS,
    ),
}


def findings_of(fault: Fault) -> list[Finding]:
    """Return the findings of functions of which one is wrong."""
    every = tree(fault.free)
    names = {*fault.family.split(), "n", "speeds", "holonomic"}
    given = {x: y for x, y in every.items() if x in names} | {fault.wrong: fault.change(every)}
    return check_functions(**given, states=2, ranges=(-1.0, 1.0))


@pytest.mark.sampled(11)
@pytest.mark.parametrize("id", FAULTS)
def test_a_fault_is_caught_and_its_function_and_sort_are_named(id: str):
    fault = FAULTS[id]
    failed = [x for x in findings_of(fault) if x.verdict == "failed"]
    assert failed
    assert fault.wrong in {name for x in failed for name in x.cause.split(" or ")}
    assert any(fault.sort in x.detail for x in failed), [str(x) for x in failed]


def test_there_are_more_than_forty_faults_of_every_function():
    assert len(FAULTS) >= 40
    names = {*FRAMES.split(), *CENTER.split(), *DYNAMICS.split()}
    assert {x.wrong for x in FAULTS.values()} >= names - {"M", "bias", "gravity", "C"}


# ---- Right functions -----------------------------------------------------------------------------


def no_failure(seed: int, free: bool, states: int) -> None:
    model = random_model(seed, free)
    functions = with_free_base(model) if free else every_function(model)
    ranges = (-1.2, 1.2) if free else (-3.0, 3.0)
    found = check_functions(**functions, states=states, seed=seed, ranges=ranges)
    assert not [str(x) for x in found if x.verdict == "failed"]
    assert len({x.claim for x in found if x.verdict == "passed"}) >= 54


@pytest.mark.parametrize("free", [False, True])
def test_right_functions_of_a_tree_pass(free: bool):
    no_failure(202, free, 1)


@pytest.mark.night
@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("seed", range(100, 115))
def test_right_functions_pass_in_300_states_of_30_trees(seed: int, free: bool):
    no_failure(seed, free, 10)
