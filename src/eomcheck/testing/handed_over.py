"""Quantities of a scene or an engine as functions: which function is which quantity, in one table.

A function of `EquationsOfMotion` has all forces of the scene in it; a quantity of an engine has the
weight alone (`eomcheck.evaluation.conformance`). The forces beside weight, such as springs and
dampers, are added on our side, by those of the scene. Nothing is computed before a function is
called or announced: finite differences announce all their states, whose quantities a scene computes
as one batch, with the same bits as one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np

from eomcheck.claims.batched_claims import NOT_BATCHABLE
from eomcheck.descriptions.tree_model import tree_model
from eomcheck.engines import Answers, Engine
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.derivatives import derivative_arrays, inverse_arrays
from eomcheck.evaluation.evaluation import BatchEvaluation, Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import Formulation
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import BatchArray, batch_data
from eomcheck.numbers.generic import Array
from eomcheck.testing.equations_of_motion import BatchedFunction

# ---- Table ---------------------------------------------------------------------------------------


class HandedOver(NamedTuple):
    """Quantity that a function returns: all of it, or one of its parts that are side by side."""

    quantity: str
    part: int | None = None


HANDED_OVER: dict[str, HandedOver] = {
    "inverse_dynamics": HandedOver("inverse_dynamics"),
    "tau_q": HandedOver("inverse_dynamics_derivatives", 0),
    "tau_v": HandedOver("inverse_dynamics_derivatives", 1),
    "qdd": HandedOver("forward_dynamics"),
    "qdd_q": HandedOver("forward_dynamics_derivatives", 0),
    "qdd_v": HandedOver("forward_dynamics_derivatives", 1),
    "qdd_tau": HandedOver("forward_dynamics_derivatives", 2),
    "inverse_mass_matrix": HandedOver("inverse_mass_matrix"),
    "regressor": HandedOver("regressor"),
    "com": HandedOver("center_of_mass"),
    "com_jacobian": HandedOver("center_of_mass_jacobian"),
    "com_velocity": HandedOver("center_of_mass_velocity"),
    "com_acceleration": HandedOver("center_of_mass_acceleration"),
    "momentum_matrix": HandedOver("momentum_matrix"),
    "momentum": HandedOver("momentum"),
    "momentum_rate": HandedOver("momentum_rate"),
    "frame_placement": HandedOver("frame_placement"),
    "J": HandedOver("frame_jacobian"),
    "frame_velocity": HandedOver("frame_velocity"),
    "frame_bias": HandedOver("frame_bias"),
    "frame_acceleration": HandedOver("frame_acceleration"),
}
"""Name of a function -> quantity that it returns; `parameters` and `mass` are constants."""

Ask = Callable[[str, Array, Array, Array, str], Array]
"""Function of a quantity's name, q, v, v̇ or τ, and the name of a link or "" that returns it."""

Prefetch = Callable[[str, Array, Array, Array, str], None]
"""Function as `Ask`, of several states and loads (k, n), that computes the quantity at all."""

KEPT = 32
"""Number of states whose quantities are kept: functions are called for one after another."""

LARGEST_TOTAL = 2**23
"""Largest number of float64 entries of the results that are kept."""


# ---- Scenes --------------------------------------------------------------------------------------


class SceneInputs(NamedTuple):
    """A state of a scene, or several as one batch, at which quantities are computed.

    Attributes:
        point: its conformance quantities; v̇ is `third`.
        third: v̇, or the forces τ of q̈ (n,).
        solver: formulation of accelerations.
    """

    point: ConformancePoint
    third: Any
    solver: Formulation

    @property
    def at(self) -> Evaluation:
        """The evaluation of the state."""
        return cast(Evaluation, self.point.at)

    def filled(self, term: Any) -> Any:
        """Return a term of the scene (n,), zeros where it is absent."""
        return 0.0 * self.at.v if term is None else term

    @property
    def energies(self) -> tuple[Any, Any]:
        """T and U of the scene; U is None where it has none."""
        at = self.at
        return at.run(at.scene.energies, at.parameters, at.prepared, at.q, at.v)

    @property
    def constraint(self) -> Any:
        """The residual c (r,) of the constraints."""
        at = self.at
        return at.run(at.scene.constraint, at.parameters, at.prepared, at.q, at.v)


def _derivatives_of_acceleration(x: SceneInputs) -> Any:
    parts = derivative_arrays(x.at, x.solver)
    return np.concatenate([parts[part] for part in ("q", "v", "tau")], axis=1)


def _derivatives_of_torques(x: SceneInputs) -> Any:
    parts = inverse_arrays(x.at, x.third)
    return np.concatenate((parts["q"], parts["v"]), axis=1)


OF_SCENE: dict[str, Callable[[SceneInputs], Any]] = {
    "M": lambda x: x.at.terms.M,
    "bias": lambda x: x.filled(x.at.terms.B),
    "T": lambda x: x.energies[0],
    "U": lambda x: x.energies[1],
    "R": lambda x: x.at.dissipation(x.at.v),
    "rest force": lambda x: -x.filled(x.at.terms.Q),
    "Q": lambda x: x.filled(x.at.terms.Q),
    "a": lambda x: x.at.terms.a,
    "gamma": lambda x: x.at.terms.gamma,
    "c": lambda x: x.constraint,
    "inverse_dynamics": lambda x: x.at.terms.M @ x.third - x.at.F,
    "inverse_dynamics_derivatives": _derivatives_of_torques,
    "forward_dynamics": lambda x: x.at.acceleration(x.solver).vdot,
    "forward_dynamics_derivatives": _derivatives_of_acceleration,
}
"""Quantity -> its value with all forces of the scene; others are those of `QUANTITIES`."""

DRIVEN = "forward_dynamics", "forward_dynamics_derivatives"
"""Quantities of which the third argument is τ."""


class SceneQuantities:
    """Quantities of a scene at t = 0, with all its forces.

    Each is computed once per state, and those of states that are announced in one batch.

    Args:
        scene: the scene.
        solver: formulation of accelerations.
    """

    def __init__(self, scene: Scene, solver: Formulation):
        self.scene, self.solver = scene, solver
        self._inputs = lru_cache(KEPT)(self._new_inputs)
        self._batch = lru_cache(2)(self._new_batch)
        self._results: dict[tuple[Any, ...], Array] = {}
        self._total, self._batchable = 0, True

    def functions(self) -> dict[str, Any]:
        """Return the functions by name, those of bodies and frames where there is a tree."""
        model = tree_model(self.scene)
        names = [x for x in HANDED_OVER if model is not None or not _of_bodies(x)]
        if not weighs_alone(self.scene):  # the torques Y π of a regressor are those of weight
            names = [x for x in names if x != "regressor"]
        links, n = () if model is None else model.links, self.scene.n
        made = {name: functions_of(name, links, self.ask, n, self.prefetch) for name in names}
        return made | constants(self.scene, names)

    def function(self, name: str, count: int) -> Callable[..., Array]:
        """Return a quantity of `OF_SCENE` as a function of q, or of q and v."""
        return function_of(name, None, count, self.scene.n, "", self.ask, self.prefetch)

    def ask(self, name: str, q: Array, v: Array, third: Array, frame: str) -> Array:
        """Return a quantity at (q, v), with v̇ or τ, of a link or none."""
        state = q.tobytes(), v.tobytes(), third.tobytes()
        if (name, frame, *state) not in self._results:
            inputs = self._inputs(*state, name in DRIVEN)
            value = np.asarray(self._value(name, inputs, frame), np.float64)
            self._keep((name, frame, *state), value)
            return value.copy()
        return self._results[name, frame, *state].copy()

    def prefetch(self, name: str, q: Array, v: Array, third: Array, frame: str) -> None:
        """Compute a quantity at several (q, v), with v̇ or τ, (k, n) each.

        It is left to `ask` at states where a system is singular, or where the scene does more than
        a batch supports.
        """
        states = [
            (x.tobytes(), y.tobytes(), z.tobytes()) for x, y, z in zip(q, v, third, strict=True)
        ]
        missing = [x for x in dict.fromkeys(states) if (name, frame, *x) not in self._results]
        if not self._batchable or len(missing) < FEWEST:
            return
        at_once = max(LANES // self.scene.n**2, FEWEST)
        for first in range(0, len(missing), at_once):
            part = tuple(missing[first : first + at_once])
            try:
                value = self._value(name, self._batch(part, name in DRIVEN), frame)
                values = batch_data(value, len(part))
            except NOT_BATCHABLE:
                self._batchable = False
                return
            for state, value in zip(part, values, strict=True):
                if np.isfinite(value).all():
                    self._keep((name, frame, *state), value)

    def _value(self, name: str, inputs: SceneInputs, frame: str) -> Any:
        """Return a quantity at a state, or at those of a batch."""
        if name in OF_SCENE:
            return OF_SCENE[name](inputs)
        return QUANTITIES[name].value(inputs.point, frame)

    def _keep(self, key: tuple[Any, ...], value: Array) -> None:
        """Keep a result, and drop the oldest ones where there are too many."""
        self._results[key] = value
        self._total += value.size
        while self._total > LARGEST_TOTAL and len(self._results) > 1:
            self._total -= self._results.pop(next(iter(self._results))).size

    def _new_inputs(self, q: bytes, v: bytes, third: bytes, driven: bool) -> SceneInputs:
        at = Evaluation(self.scene, np.frombuffer(q), np.frombuffer(v))
        return self._loaded(at, np.frombuffer(third), driven)

    def _new_batch(self, states: tuple[tuple[bytes, ...], ...], driven: bool) -> SceneInputs:
        q, v, third = (
            np.array([np.frombuffer(x) for x in part]) for part in zip(*states, strict=True)
        )
        scenes = [self.scene] * len(states)
        at = BatchEvaluation(scenes, [State(x, y) for x, y in zip(q, v, strict=True)])
        return self._loaded(at, BatchArray(third), driven)

    def _loaded(self, at: Evaluation, third: Any, driven: bool) -> SceneInputs:
        """Return the inputs at a state, under forces τ where `driven`."""
        if driven:
            at.tau = third
        return SceneInputs(ConformancePoint(at, third), third, self.solver)


FEWEST = 4
"""Least number of states that are faster as a batch than one after the other."""

LANES = 4096
"""Number of states times n² at most in one batch: that of numbers grows with derivatives by q."""


def _of_bodies(name: str) -> bool:
    """Return whether a function is about bodies and links, and not about equations."""
    return [*HANDED_OVER].index(name) >= [*HANDED_OVER].index("regressor")


# ---- Engines -------------------------------------------------------------------------------------


class EngineQuantities:
    """Quantities of an engine at t = 0, with the forces of its scene beside weight.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine):
        self.engine, self.scene = engine, engine.scene
        self._answers, self._beside = Answers(engine), ForcesBesideWeight(engine.scene)

    def functions(self) -> dict[str, Any]:
        """Return the functions by name, of the methods that the engine offers."""
        model, kind = tree_model(self.scene), type(self.engine)
        if model is None:  # our side has no weight of it
            return {}
        names = [name for name, one in HANDED_OVER.items() if kind.offers(one.quantity)]
        if self.scene.r:  # q̈ is that with constraints
            names = [x for x in names if HANDED_OVER[x].quantity not in UNCONSTRAINED]
        if not weighs_alone(self.scene):
            names = [x for x in names if x != "regressor"]
        links = [x for x in model.links if self._answers.has_frame(x)]
        made = {name: functions_of(name, links, self.ask, self.scene.n) for name in names}
        return made | constants(self.scene, names)

    def ask(self, name: str, q: Array, v: Array, third: Array, frame: str) -> Array:
        """Return a quantity at (q, v), with v̇ or τ, of a link or none."""
        one, beside, n = QUANTITIES[name], self._beside, self.scene.n
        value = partial(self._answers.quantity, one, q, v)
        if not beside.exist or name not in WITH_FORCES:
            return value(third, frame)
        if name == "inverse_dynamics":
            return value(third, frame) - beside.at(q, v)
        if name == "inverse_dynamics_derivatives":
            return value(third, frame) - beside.by(q, v)
        driven = value(third + beside.at(q, v), frame)
        if name == "forward_dynamics":
            return driven
        by_state, by_tau = np.split(driven, [2 * n], axis=1)
        return np.hstack((by_state + by_tau @ beside.by(q, v), by_tau))


UNCONSTRAINED = "forward_dynamics", "forward_dynamics_derivatives"
"""Quantities without constraints, which are others than those of a constrained scene."""

WITH_FORCES = "inverse_dynamics", "inverse_dynamics_derivatives", *UNCONSTRAINED
"""Quantities that forces beside weight are in."""


class ForcesBesideWeight:
    """Forces of a scene beside weight, Q + ∂U/∂q, and their derivatives, on our side.

    Args:
        scene: the scene, with a tree of bodies.
    """

    def __init__(self, scene: Scene):
        self.scene = scene

    @cached_property
    def exist(self) -> bool:
        """Whether there are any."""
        return not weighs_alone(self.scene)

    def at(self, q: Array, v: Array) -> Array:
        """Return the forces (n,)."""
        at = Evaluation(self.scene, q, v)
        weight = ConformancePoint(at).weight.gradient
        return weight if at.terms.Q is None else at.terms.Q + weight

    def by(self, q: Array, v: Array) -> Array:
        """Return their derivatives by q, then by v (n, 2n)."""
        at = Evaluation(self.scene, q, v)
        whole = inverse_arrays(at, np.zeros(self.scene.n))
        return ConformancePoint(at).torque_derivatives - np.hstack((whole["q"], whole["v"]))


def weighs_alone(scene: Scene) -> bool:
    """Return whether weight is the only force of a scene; False where it has no tree of bodies."""
    if tree_model(scene) is None:
        return False
    q, v = scene.initial_state()
    moved = np.cos(1.0 + np.arange(scene.n))
    at = Evaluation(scene, q + moved, v + moved[::-1])
    weight = ConformancePoint(at).weight.gradient
    forces = np.zeros(scene.n) if at.terms.Q is None else at.terms.Q
    return bool(largest(forces + weight) <= allowed_error(max(largest(forces), largest(weight))))


# ---- Functions -----------------------------------------------------------------------------------


def functions_of(name: str, links: Any, ask: Ask, n: int, prefetch: Prefetch | None = None) -> Any:
    """Return a function of `EquationsOfMotion`, or those of each link by its name."""
    method, part = HANDED_OVER[name]
    one = QUANTITIES[method]
    made = partial(function_of, method, part, len({*one.arguments} - {"f"}), n)
    if one.of_frame:
        return {link: made(link, ask, prefetch) for link in links}
    return made("", ask, prefetch)


def function_of(
    method: str,
    part: int | None,
    count: int,
    n: int,
    frame: str,
    ask: Ask,
    prefetch: Prefetch | None = None,
) -> Callable[..., Array]:
    """Return a function of as many arrays, q, v and v̇ or τ, as its quantity has.

    Args:
        method: name of the quantity.
        part: the part that it returns of several side by side; None for all of it.
        count: number of its arguments.
        n: number of coordinates.
        frame: name of the link, "" for a quantity of none.
        ask: function that returns the quantity.
        prefetch: function that computes it at several states; None where there is none.
    """
    none = np.zeros(n)

    def value(q: Array, v: Array = none, third: Array = none) -> Array:
        whole = ask(method, q, v, third, frame)
        return whole if part is None else whole[:, part * n : (part + 1) * n]

    functions = lambda q: value(q), lambda q, v: value(q, v), lambda q, v, third: value(q, v, third)
    function = functions[count - 1]
    if prefetch is None:
        return function

    def values(*stacked: Array) -> None:
        q, v, third = (*stacked, *[np.zeros(stacked[0].shape)] * (3 - len(stacked)))
        prefetch(method, q, v, third, frame)

    return BatchedFunction(function, values)


def constants(scene: Scene, names: Any) -> dict[str, Any]:
    """Return the parameters of a regressor and the mass of all bodies, of functions that count."""
    made: dict[str, Any] = {}
    if "regressor" in names:
        made["parameters"] = partial(_parameters, scene)
    if {"com_jacobian", "momentum_matrix", "momentum"}.intersection(names):
        made["mass"] = partial(_mass, scene)
    return made


def _at_rest(scene: Scene) -> ConformancePoint:
    return ConformancePoint(Evaluation(scene, *scene.initial_state()))


def _parameters(scene: Scene) -> Array:
    return np.asarray(_at_rest(scene).regressor.parameters, np.float64)


def _mass(scene: Scene) -> float:
    return float(_at_rest(scene).mass)
