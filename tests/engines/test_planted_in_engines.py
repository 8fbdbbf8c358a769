"""Mistakes that adapters of engines are made with, planted in ours: each is caught and named."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.engines.test_tree_engines import BUILT, look
from tests.engines.twisted import twisted
from tests.samples import ordinary

from eomcheck.engines import ENGINES, Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.tree_engine import TreeEngine, TreeLink
from eomcheck.mechanics.records import Tree
from eomcheck.scenes import SCENES

CLAIMS = "mass-matrix", "bias", "engine-acceleration", "engine-multipliers"
"""In the order of blame."""

Kind = type[Any]


class Fault(NamedTuple):
    """A mistake, the first claim that must fail for it, and what that must say."""

    what: str
    plant: Callable[[Kind], Kind]
    claim: str
    says: str = "found"
    engines: tuple[str, ...] = tuple(BUILT)
    scene: str = "snake"


# ---- What is handed to the library ---------------------------------------------------------------


def of_links(change: Callable[[list[TreeLink]], list[TreeLink]], frames: int | None = None):
    """Return a fault that changes the links, if wanted after their frames are turned."""

    def plant(kind: Kind) -> Kind:
        class Faulty(kind):
            @classmethod
            def links(cls, tree: Tree) -> list[TreeLink]:
                links = super().links(tree)
                return change(links if frames is None else twisted(links, frames))

        return Faulty

    return plant


def each(change: Callable[[TreeLink], TreeLink]) -> Callable[[list[TreeLink]], list[TreeLink]]:
    return lambda links: [change(one) for one in links]


def last(change: Callable[[TreeLink], TreeLink]) -> Callable[[list[TreeLink]], list[TreeLink]]:
    return lambda links: [*links[:-1], change(links[-1])]


def about_the_joint(one: TreeLink) -> TreeLink:
    c = one.center
    return one._replace(inertia=one.inertia + one.mass * (c @ c * np.eye(3) - np.outer(c, c)))


# ---- What is asked of it -------------------------------------------------------------------------


def mapped(change: Callable[[VelocityMap], VelocityMap]):
    def plant(kind: Kind) -> Kind:
        class Faulty(kind):
            def velocity_map(self, q, v):
                return change(super().velocity_map(q, v))

        return Faulty

    return plant


def answered(method: str, change: Callable[[Any], Any]):
    """Return a fault that changes what a method answers."""

    def plant(kind: Kind) -> Kind:
        def faulty(self, *arguments):
            return change(getattr(kind, method)(self, *arguments))

        return type("Faulty", (kind,), {method: faulty})

    return plant


def built(change: Callable[[Any], None]):
    """Return a fault that changes the library's model once it is built."""

    def plant(kind: Kind) -> Kind:
        class Faulty(kind):
            def _build(self, library, links):
                super()._build(library, links)
                change(self)

        return Faulty

    return plant


def moved(change: Callable[[Any, Any], tuple | None], method: str = "_move_to"):
    """Return a fault that moves the library's model elsewhere, or not at all."""

    def plant(kind: Kind) -> Kind:
        def faulty(self, x, rate, *rest):
            if (wrong := change(x, rate)) is not None:
                getattr(kind, method)(self, *wrong, *rest)

        return type("Faulty", (kind,), {method: faulty})

    return plant


def with_gravity(sign: float) -> Callable[[Any], None]:
    down = sign * np.array([0.0, -9.81, 0.0])

    def change(engine: Any) -> None:
        if engine.key == "mujoco":
            engine.model.opt.gravity = down
        elif engine.key == "pinocchio":
            engine.model.gravity.linear = down
        elif engine.key == "exudyn":
            engine.system.SetObjectParameter(engine._tree, "gravity", down)
        else:
            engine._ask("setGravity", *down)

    return change


def armature(engine: Any) -> None:
    if engine.key == "mujoco":
        engine.model.dof_armature[:] = 1e-3
    else:
        engine.model.armature = np.full(engine.scene.n, 1e-3)


def damping(engine: Any) -> None:
    engine.model.dof_damping[:] = 1e-3


def reversed_order(engine: Any) -> None:
    engine._place = engine._place[::-1].copy()


def without_gamma(kind: Kind) -> Kind:
    class Faulty(kind):
        def acceleration(self, q, v, Q, a, gamma, t=0.0):
            return super().acceleration(q, v, Q, a, 0.0 * gamma, t)

    return Faulty


def other_sign(found: EngineAcceleration) -> EngineAcceleration:
    return EngineAcceleration(found.vdot, -found.multipliers)


def float32(x: Any) -> Any:
    return np.asarray(x, np.float32).astype(np.float64)


def kept(kind: Kind) -> Kind:
    class Faulty(kind):
        def mass_matrix(self, q, t=0.0):
            if not hasattr(self, "first"):
                self.first = super().mass_matrix(q, t)
            return self.first

    return Faulty


PLACED = tuple(key for key in BUILT if key not in ("pinocchio", "exudyn"))
"""Engines whose library may order joints in its own way."""
MOVED = "drake", "exudyn", "idyntree"
"""Engines that keep a state of their own."""
GRAVE = "mujoco", "pinocchio", "exudyn", "pybullet"
"""Engines whose bias has gravity in it unless that is turned off."""

SINGLE = "as large as the rounding of single precision"

FAULTS = [
    Fault(
        "seats turned the other way",
        of_links(each(lambda one: one._replace(rotation=one.rotation.T)), frames=1),
        "mass-matrix",
    ),
    Fault(
        "the last link on another one",
        of_links(last(lambda one: one._replace(parent=one.parent - 1))),
        "mass-matrix",
    ),
    Fault(
        "lengths in millimetres",
        of_links(each(lambda one: one._replace(offset=1000 * one.offset))),
        "mass-matrix",
    ),
    Fault(
        "centres of mass on the other side",
        of_links(each(lambda one: one._replace(center=-one.center))),
        "mass-matrix",
    ),
    Fault("moments of inertia about the joints", of_links(each(about_the_joint)), "mass-matrix"),
    Fault(
        "a mass of 1e-9 kg where there is none, for a library to be content",
        of_links(each(lambda one: one._replace(mass=one.mass or 1e-9))),
        "mass-matrix",
    ),
    Fault(
        "joint 1 slides along another axis",
        of_links(lambda links: [links[0]._replace(kind="pz"), *links[1:]]),
        "mass-matrix",
    ),
    Fault(
        "angles in degrees",
        mapped(lambda one: one._replace(x=np.degrees(one.x))),
        "mass-matrix",
    ),
    Fault(
        "absolute angles for relative ones, as positions",
        mapped(lambda one: one._replace(x=np.linalg.solve(one.S, one.x))),
        "mass-matrix",
    ),
    Fault(
        "absolute angles for relative ones, throughout",
        mapped(
            lambda one: VelocityMap(np.linalg.solve(one.S, one.x), np.eye(len(one.S)), one.rest)
        ),
        "mass-matrix",
    ),
    Fault("armature", built(armature), "mass-matrix", engines=("mujoco", "pinocchio")),
    Fault("gravity on", built(with_gravity(1)), "bias", engines=GRAVE),
    Fault("gravity upwards", built(with_gravity(-1)), "bias", engines=GRAVE),
    Fault(
        "gravity on where the bias has none by definition",
        built(
            lambda engine: engine.plant.mutable_gravity_field().set_gravity_vector([0, -9.81, 0])
        ),
        "engine-acceleration",
        engines=("drake",),
    ),
    Fault(
        "damping",
        built(damping),
        "engine-acceleration",
        engines=("mujoco",),
        scene="chain-pendulum",
    ),
    Fault("joints in another order", built(reversed_order), "mass-matrix", engines=PLACED),
    Fault("never moved", moved(lambda x, rate: None), "mass-matrix", engines=MOVED),
    Fault(
        "moved, but nothing computed from it",
        lambda kind: type("Faulty", (kind,), {"_forward": kind._move_to}),
        "mass-matrix",
        engines=("mujoco",),
    ),
    Fault("at rest", moved(lambda x, rate: (x, 0 * rate)), "bias", engines=("mujoco", *MOVED)),
    Fault("the upper triangle only", answered("mass_matrix", np.triu), "mass-matrix"),
    Fault("M in float32", answered("mass_matrix", float32), "mass-matrix", SINGLE),
    Fault("B in float32", answered("bias", float32), "bias", SINGLE),
    Fault(
        "M not a number",
        answered("mass_matrix", lambda M: M * np.nan),
        "mass-matrix",
        "returned nan",
    ),
    Fault("B without its first row", answered("bias", lambda B: B[1:]), "bias", "shape (5,)"),
    Fault("the first answer kept for ever", kept, "mass-matrix", "keeps what it was asked"),
    Fault("half of B", answered("bias", lambda B: B / 2), "bias", "half the expected value"),
    Fault("B of the other sign", answered("bias", lambda B: -B), "bias", "sign"),
    Fault(
        "no gamma", without_gamma, "engine-acceleration", engines=("pinocchio", "drake", "exudyn")
    ),
    Fault(
        "λ of the other sign",
        answered("acceleration", other_sign),
        "engine-multipliers",
        "sign",
        engines=("pinocchio", "drake", "exudyn"),
    ),
]


@pytest.mark.parametrize(
    ("fault", "key"),
    [pytest.param(one, key, id=f"{key}: {one.what}") for one in FAULTS for key in one.engines],
)
@pytest.mark.sampled(12)
def test_a_mistake_in_an_adapter_is_caught_and_named(fault: Fault, key: str):
    scene, state = ordinary(SCENES[fault.scene], 4)
    kind = fault.plant(ENGINES[key])
    kind.key = key
    engine: Engine = kind(scene)
    assert isinstance(engine, TreeEngine)
    failed = [
        one
        for claim in CLAIMS
        for one in look(scene, state, engine, claim)
        if one.verdict == "failed"
    ]
    assert failed, f"{fault.what}: nothing failed"
    assert failed[0].claim == fault.claim, [str(one) for one in failed]
    assert key in failed[0].subject
    assert engine.version() in failed[0].evidence
    assert fault.says in failed[0].detail


def test_there_are_faults_for_every_engine():
    assert len(FAULTS) >= 15
    for key in BUILT:
        assert sum(key in one.engines for one in FAULTS) >= 15
