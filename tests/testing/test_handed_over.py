"""Quantities of scenes and engines as functions: the same numbers, and faults of an engine."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.samples import ordinary

import eomcheck
from eomcheck.claims.registry import FUNCTION_CLAIMS
from eomcheck.engines import ENGINES, Engine
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import SCENES
from eomcheck.testing import EquationsOfMotion, check, from_engine, from_scene
from eomcheck.testing.equations_of_motion import FunctionCaller
from eomcheck.testing.handed_over import HANDED_OVER, SceneQuantities, weighs_alone


def scene_of(key: str) -> Scene:
    return ordinary(SCENES[key], 3)[0]


def functions_of(engine: Engine, *names: str) -> EquationsOfMotion:
    """Return some of the functions of an engine."""
    made = from_engine(engine)
    return EquationsOfMotion(made.n, **{name: made.function(name) for name in names})


def referred(engine: Engine, *names: str) -> dict[str, str]:
    """Return the verdict of each function of an engine beside that of its scene."""
    subject = functions_of(engine, *names)
    found = check(subject, against=engine.scene, states=1, seed=1, claims=["reference"])
    verdicts: dict[str, str] = {}
    for verdict in ("inconclusive", "passed", "failed"):
        same = (one.subject for one in found if one.verdict == verdict)
        verdicts |= {subject.partition(" ~ ")[0]: verdict for subject in same}
    return {name: verdicts[name] for name in names if name in verdicts}


# ---- Equal numbers -------------------------------------------------------------------------------


@pytest.mark.sampled(6)
@pytest.mark.parametrize("key", ["chain-pendulum", "sleigh", "flyball-governor"])
@pytest.mark.parametrize("library", ["pinocchio", "casadi"])
def test_functions_of_an_engine_are_those_of_its_scene(library: str, key: str):
    """Springs and dampers of the governor are in both."""
    engine = ENGINES[library](scene_of(key))
    names = [name for name in from_engine(engine).given if name in HANDED_OVER]
    assert {"inverse_dynamics", "tau_q", "tau_v"} <= {*names}
    assert ("qdd_q" in names) == (engine.scene.r == 0)
    assert referred(engine, *names) == dict.fromkeys(names, "passed")


def test_what_is_asked_of_a_scene_is_its_quantity_with_all_its_forces():
    scene = scene_of("flyball-governor")
    assert not weighs_alone(scene) and weighs_alone(scene_of("chain-pendulum"))
    made: Any = from_scene(scene)
    q, v, third = (np.cos(k + np.arange(scene.n)) for k in range(3))
    for name, method in (("inverse_dynamics", "inverse_dynamics"), ("com", "center_of_mass")):
        arguments = (q, v, third) if name == "inverse_dynamics" else (q,)
        ours = eomcheck.quantity(scene, method, *arguments)
        assert np.allclose(made.function(name)(*arguments), ours, rtol=1e-13)
    exact = eomcheck.derivatives(scene, "au", q, v, third)
    for name in ("q", "v", "tau"):
        theirs = made.function(f"qdd_{name}")(q, v, third)
        assert np.abs(theirs - getattr(exact, name)).max() <= 2 * exact.error_bounds[name]


def test_nothing_is_computed_before_a_function_is_called():
    class Silent(PinocchioEngine):
        """An engine that breaks where it is asked."""

        key = "silent"

        def center_of_mass(self, q, t=0.0):
            """Raise an error."""
            raise RuntimeError("asked")

    made: Any = from_engine(Silent(scene_of("chain-pendulum")))
    with pytest.raises(Exception, match="asked"):
        made.com(np.zeros(made.n))


def test_a_reference_has_the_frames_of_the_functions():
    scene = scene_of("chain-pendulum")
    made: Any = from_scene(scene)
    last = [*made.J][-1]
    for factor, verdict in ((1.0, "passed"), (-1.0, "failed")):
        J = {last: lambda q, factor=factor: factor * made.J[last](q)}
        found = check(EquationsOfMotion(made.n, J=J), against=scene, states=1, claims=["reference"])
        assert verdict in {one.verdict for one in found if one.subject.startswith("J ~")}


# ---- States in batches ---------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["chain-pendulum", "sleigh", "flyball-governor", "four-bar-chain"])
def test_announced_states_have_the_bits_of_states_one_by_one(key: str, monkeypatch):
    """Of every function, so that findings do not depend on what was announced."""
    made, other = from_scene(scene_of(key)), from_scene(scene_of(key))
    rng = np.random.default_rng(3)
    states = [(x, y) for x, y in rng.uniform(-1.0, 1.0, (6, 2, made.n))]
    third = rng.uniform(-1.0, 1.0, made.n)
    ahead, alone = FunctionCaller(made), FunctionCaller(other)
    for name in made.given:
        ahead.prefetch(name, states, vdot=third, tau=third)
    monkeypatch.setattr(SceneQuantities, "_new_inputs", None)  # nothing more is computed alone
    found = {}
    for name in made.given:
        if ahead.reads(name) in ("", "t", "qt"):
            continue
        found[name] = [ahead(name, q, v, vdot=third, tau=third) for q, v in states]
    monkeypatch.undo()
    assert {"M", "bias", "T", "qdd_q", "tau_v"} <= {*found}
    for name, values in found.items():
        for (q, v), value in zip(states, values, strict=True):
            assert np.array_equal(value, alone(name, q, v, vdot=third, tau=third)), name


def test_a_state_that_a_batch_refuses_is_left_to_be_asked(monkeypatch):
    scene = scene_of("chain-pendulum")
    made = from_scene(scene)
    caller, states = (
        FunctionCaller(made),
        [(np.full(made.n, 0.1 * k), np.ones(made.n)) for k in range(5)],
    )
    value = SceneQuantities._value

    def refused(self, name: str, inputs: Any, frame: str) -> Any:
        found = value(self, name, inputs, frame)
        if inputs.at.states:
            found.data[2] = np.nan
        return found

    monkeypatch.setattr(SceneQuantities, "_value", refused)
    caller.prefetch("qdd", states)
    monkeypatch.undo()
    for q, v in states:
        assert np.array_equal(caller("qdd", q, v), from_scene(scene).qdd(q, v))


def test_most_states_of_a_check_are_announced(monkeypatch):
    """One by one, the functions of one state take minutes."""
    alone, asked = [], []
    new, ask = SceneQuantities._new_inputs, SceneQuantities.ask
    monkeypatch.setattr(SceneQuantities, "_new_inputs", lambda *x: (alone.append(1), new(*x))[1])
    monkeypatch.setattr(SceneQuantities, "ask", lambda *x: (asked.append(1), ask(*x))[1])
    made = from_scene(scene_of("chain-pendulum"))
    names = ["derivative", "inverse-dynamics-by-position", "frame-jacobian", "acceleration-mixed"]
    claims = [x for x in FUNCTION_CLAIMS if x in names]
    found = check(made, states=1, claims=claims)
    assert {one.verdict for one in found} == {"passed"}
    assert len(asked) > 1000 and 20 * len(alone) < len(asked)


# ---- Faults --------------------------------------------------------------------------------------

Change = Callable[[Any], Any]


def beside(k: int, change: Change) -> Change:
    """Return the change of one of several arrays."""
    return lambda parts: tuple(change(x) if i == k else x for i, x in enumerate(parts))


def transposed(x: Any) -> Any:
    return x.T


def opposite(x: Any) -> Any:
    return -x


def angular_first(x: Any) -> Any:
    return np.roll(x, 3, axis=0)


FAULTS: list[tuple[str, str, Change]] = [
    ("inverse_dynamics", "inverse_dynamics", opposite),
    ("tau_q", "inverse_dynamics_derivatives", beside(0, transposed)),
    ("tau_v", "inverse_dynamics_derivatives", beside(1, opposite)),
    ("qdd", "forward_dynamics", opposite),
    ("qdd_q", "forward_dynamics_derivatives", beside(0, opposite)),
    ("qdd_v", "forward_dynamics_derivatives", beside(1, transposed)),
    ("qdd_tau", "forward_dynamics_derivatives", beside(2, np.linalg.inv)),
    ("inverse_mass_matrix", "inverse_mass_matrix", np.linalg.inv),
    ("regressor", "regressor", lambda Y: np.roll(Y, 1, axis=1)),
    ("com", "center_of_mass", lambda c: c + 0.1),
    ("com_jacobian", "center_of_mass_jacobian", lambda J: J[:, ::-1]),
    ("com_velocity", "center_of_mass_velocity", opposite),
    ("com_acceleration", "center_of_mass_acceleration", lambda c: c - np.r_[0, 0, 9.81]),
    ("momentum_matrix", "momentum_matrix", angular_first),
    ("momentum", "momentum", angular_first),
    ("momentum_rate", "momentum_rate", lambda h: h / 2),
    ("frame_placement", "frame_placement", beside(0, transposed)),
    ("J", "frame_jacobian", angular_first),
    ("frame_velocity", "frame_velocity", angular_first),
    ("frame_bias", "frame_bias", lambda x: 0 * x),
    ("frame_acceleration", "frame_acceleration", lambda x: x - np.r_[0, 0, 9.81, 0, 0, 0]),
]
"""Function, method of an engine, and the fault of its result."""


def planted(method: str, change: Change) -> type[Engine]:
    """Return an engine whose method has a fault."""

    def wrong(self: Any, *arguments: Any) -> Any:
        return change(getattr(PinocchioEngine, method)(self, *arguments))

    return type("Wrong", (PinocchioEngine,), {"key": "wrong", method: wrong})


def test_every_function_has_a_fault():
    assert {(name, method) for name, method, _ in FAULTS} == {
        (name, one.quantity) for name, one in HANDED_OVER.items()
    }


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name, method, change", FAULTS, ids=[x[0] for x in FAULTS])
def test_a_fault_of_an_engine_is_found_beside_its_scene(name: str, method: str, change: Change):
    scene = scene_of("chain-pendulum")
    assert referred(PinocchioEngine(scene), name) == {name: "passed"}
    assert referred(planted(method, change)(scene), name) == {name: "failed"}


OF_QDD = "qdd_q", "qdd_v", "qdd_tau"

COMPANIONS = {
    "tau_q": "inverse_dynamics",
    "tau_v": "inverse_dynamics",
    "qdd_q": "qdd",
    "qdd_v": "qdd",
    "qdd_tau": "qdd",
    "inverse_mass_matrix": "M",
    "regressor": "parameters inverse_dynamics",
    "com_jacobian": "com",
    "com_velocity": "com",
    "com_acceleration": "com_velocity",
    "momentum": "momentum_matrix",
    "momentum_rate": "momentum",
    "J": "frame_placement",
    "frame_velocity": "J",
    "frame_bias": "J",
    "frame_acceleration": "J frame_bias",
}
"""Function -> functions of the same engine by which its fault is found without a reference."""


@pytest.mark.sampled(9)
@pytest.mark.parametrize("name", COMPANIONS)
def test_a_fault_of_an_engine_is_found_without_a_reference(name: str):
    (fault,) = (x for x in FAULTS if x[0] == name)
    names = name, *COMPANIONS[name].split()
    # The frame of a sleigh moves along the ground: its J is constant.
    scene = scene_of("chain-pendulum" if name in ("frame_bias", *OF_QDD) else "sleigh")
    right = check(functions_of(PinocchioEngine(scene), *names), states=2, seed=1)
    assert not [str(x) for x in right if x.verdict == "failed"]
    wrong = check(functions_of(planted(*fault[1:])(scene), *names), states=2, seed=1)
    assert {x.verdict for x in wrong} >= {"failed"}
