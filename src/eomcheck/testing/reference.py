"""What functions are compared with: a scene or an engine, as functions of the same kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eomcheck.engines import Answers, Engine, EngineFault, engine_of, made, represents
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, formulations_among
from eomcheck.mechanics.scene import Scene, checked_scene
from eomcheck.numbers.generic import Array
from eomcheck.testing.subject import Functions


def from_scene(scene: Scene) -> Functions:
    """Return the equations of a scene as functions of doubles, at t = 0 s.

    Forces all are in `Q` where the scene has no potential energy; where it has one, forces at rest
    are `gravity` and damping follows from `R`.

    Raises:
        InputError: `scene` is no scene, such as the name of one.
    """
    zero = np.zeros(checked_scene(scene).n)

    def terms(q: Array, v: Array) -> Any:
        return Evaluation(scene, q, v, 0.0).terms

    def forces(q: Array, v: Array) -> Array:
        found = terms(q, v).Q
        return np.zeros(scene.n) if found is None else found

    def bias(q: Array, v: Array) -> Array:
        found = terms(q, v).B
        return np.zeros(scene.n) if found is None else found

    def energies(q: Array, v: Array) -> tuple[Any, Any]:
        at = Evaluation(scene, q, v, 0.0)
        return scene.energies(at.parameters, at.prepared, at.q, at.v)

    def dissipation(q: Array, v: Array) -> Any:
        at = Evaluation(scene, q, v, 0.0)
        return at.dissipation(at.v)

    def constraint(q: Array, v: Array) -> Array:
        at = Evaluation(scene, q, v, 0.0)
        return np.asarray(scene.constraint(at.parameters, at.prepared, at.q, at.v))

    solver = formulations_among([scene], None)[0] if scene.r == 0 else FORMULATIONS["au"]
    example = Evaluation(scene, *scene.initial_state(), 0.0)
    U = energies(example.q, example.v)[1]
    damped = dissipation(example.q, example.v) is not None
    potential = U is not None or damped or example.terms.Q is None
    given: dict[str, Any] = {
        "M": lambda q: terms(q, zero).M,
        "bias": bias,
        "T": lambda q, v: energies(q, v)[0],
        "qdd": lambda q, v: Evaluation(scene, q, v, 0.0).acceleration(solver).vdot,
    }
    if U is not None:
        given["U"] = lambda q: energies(q, zero)[1]
        given["gravity"] = lambda q: -forces(q, zero)
    if damped:
        given["R"] = dissipation
    if not potential:
        given["Q"] = forces
    if scene.r:
        given["a"] = lambda q: terms(q, zero).a
        given["gamma"] = lambda q, v: terms(q, v).gamma
        given["c"] = constraint
        if example.terms.b is not None:
            given["b"] = lambda q, t: Evaluation(scene, q, zero, t).terms.b
    return Functions(scene.n, name=scene.name, **given)


def from_engine(engine: Any) -> Functions:
    """Return what an engine says of its scene as functions of doubles, at t = 0 s.

    Args:
        engine: an engine, made for its scene; of the optional methods those it overrides.
    """
    scene, zero = engine.scene, np.zeros(engine.scene.n)
    # In the scene's coordinates, whatever the engine has itself.
    says: Any = Answers(engine) if isinstance(engine, Engine) else engine
    given: dict[str, Any] = {"M": says.mass_matrix, "bias": says.bias}
    optional = {"Q": "forces", "gamma": "constraint_drift"} if scene.r else {"Q": "forces"}
    for name, method in optional.items():
        if _offers(engine, method):
            given[name] = getattr(says, method)
    if scene.r and _offers(engine, "constraint_jacobian"):
        given["a"] = lambda q: says.constraint_jacobian(q, zero)
    return Functions(scene.n, name=f"{type(engine).key} of {scene.name}", **given)


def _offers(engine: Any, method: str) -> bool:
    """Return whether an engine has an optional method of its own."""
    own = getattr(type(engine), method, None)
    return own is not None and own is not getattr(Engine, method, None)


def reference_of(against: Any) -> Functions:
    """Return what functions are compared with.

    Args:
        against: a scene, an engine made for one, (engine or its name, scene), or `Functions`.

    Raises:
        InputError: none of these, or the engine does not represent the scene.
        UnknownNameError: no engine has this key.
        EngineError: the library of the engine is not installed.
    """
    match against:
        case Functions():
            return against
        case Scene():
            return from_scene(against)
        case (engine, Scene() as scene):
            kind = engine_of(engine)
            if not represents(kind, scene):
                raise InputError(f"against = {kind.key}, which does not represent {scene.name}")
            try:
                return from_engine(made(kind, scene))
            except EngineFault as fault:
                raise InputError(f"against = {kind.key}: {fault.what}") from fault
    if hasattr(against, "mass_matrix") and hasattr(against, "scene"):
        return from_engine(against)
    hint = "; of functions make Functions(n, M=M, ...)" if isinstance(against, Mapping) else ""
    raise InputError(
        f"against = {against!r}, expected a scene, an engine made for one, (engine, scene), or "
        f"Functions{hint}"
    )
