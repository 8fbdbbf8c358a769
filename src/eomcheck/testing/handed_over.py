"""Quantities of a scene or an engine as functions: which function is which quantity, in one table.

A function of `EquationsOfMotion` has all forces of the scene in it; a quantity of an engine has the
weight alone (`eomcheck.evaluation.conformance`). The forces beside weight, such as springs and
dampers, are added on our side, by those of the scene. Nothing is computed before a function is
called.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from eomcheck.descriptions.tree_model import tree_model
from eomcheck.engines import Answers, Engine
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.derivatives import derivative_arrays, inverse_arrays
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import Formulation
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

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

KEPT = 32
"""Number of states whose quantities are kept: functions are called for one after another."""


# ---- Scenes --------------------------------------------------------------------------------------


class SceneQuantities:
    """Quantities of a scene at t = 0, with all its forces.

    Args:
        scene: the scene.
        solver: formulation of accelerations.
    """

    def __init__(self, scene: Scene, solver: Formulation):
        self.scene, self.solver = scene, solver
        self._point = lru_cache(KEPT)(self._new_point)
        self._derivatives = lru_cache(KEPT)(self._new_derivatives)

    def functions(self) -> dict[str, Any]:
        """Return the functions by name, those of bodies and frames where there is a tree."""
        model = tree_model(self.scene)
        names = [x for x in HANDED_OVER if model is not None or not _of_bodies(x)]
        if not weighs_alone(self.scene):  # the torques Y π of a regressor are those of weight
            names = [x for x in names if x != "regressor"]
        links = () if model is None else model.links
        made = {name: functions_of(name, links, self.ask, self.scene.n) for name in names}
        return made | constants(self.scene, names)

    def ask(self, name: str, q: Array, v: Array, third: Array, frame: str) -> Array:
        """Return a quantity at (q, v), with v̇ or τ, of a link or none."""
        if name == "forward_dynamics":
            return self._loaded(q, v, third).acceleration(self.solver).vdot
        if name == "forward_dynamics_derivatives":
            parts = self._derivatives(q.tobytes(), v.tobytes(), third.tobytes())
            return np.hstack([parts[part] for part in ("q", "v", "tau")])
        point = self._point(q.tobytes(), v.tobytes(), third.tobytes())
        if name == "inverse_dynamics":
            return point.at.terms.M @ third - point.at.F
        if name == "inverse_dynamics_derivatives":
            parts = inverse_arrays(Evaluation(self.scene, q, v), third)
            return np.hstack((parts["q"], parts["v"]))
        return np.asarray(QUANTITIES[name].value(point, frame), np.float64)

    def _loaded(self, q: Array, v: Array, tau: Array) -> Evaluation:
        """Return the scene at (q, v) under additional forces τ."""
        at = Evaluation(self.scene, q, v)
        at.tau = tau
        return at

    def _new_point(self, *state: bytes) -> ConformancePoint:
        q, v, vdot = map(np.frombuffer, state)
        return ConformancePoint(Evaluation(self.scene, q, v), vdot)

    def _new_derivatives(self, *state: bytes) -> dict[str, Array]:
        q, v, tau = map(np.frombuffer, state)
        return derivative_arrays(self._loaded(q, v, tau), self.solver)


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


def functions_of(name: str, links: Any, ask: Ask, n: int) -> Any:
    """Return a function of `EquationsOfMotion`, or those of each link by its name."""
    one = QUANTITIES[HANDED_OVER[name].quantity]
    if one.of_frame:
        return {link: _function(name, ask, n, link) for link in links}
    return _function(name, ask, n, "")


def _function(name: str, ask: Ask, n: int, frame: str) -> Callable[..., Array]:
    """Return a function of as many arrays as its quantity has."""
    method, part = HANDED_OVER[name]
    none, count = np.zeros(n), len(set(QUANTITIES[method].arguments) - {"f"})

    def value(q: Array, v: Array = none, third: Array = none) -> Array:
        whole = ask(method, q, v, third, frame)
        return whole if part is None else whole[:, part * n : (part + 1) * n]

    return {1: lambda q: value(q), 2: lambda q, v: value(q, v)}.get(
        count, lambda q, v, third: value(q, v, third)
    )


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
