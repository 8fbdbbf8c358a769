"""Scenes made of a description: a class for each topology, everything else its parameters."""

from __future__ import annotations

import copyreg
from abc import ABCMeta
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from eomcheck.mechanics.composed import support_of
from eomcheck.mechanics.described import energies
from eomcheck.mechanics.described.absent import plus
from eomcheck.mechanics.described.closures import KINDS, rows_of
from eomcheck.mechanics.described.constraints import constraints_of
from eomcheck.mechanics.described.drawing import sketched
from eomcheck.mechanics.described.forces import forces_of
from eomcheck.mechanics.described.given import NOT_READ, fields_of, inertias
from eomcheck.mechanics.described.motion import jacobians_of
from eomcheck.mechanics.described.neutral import tree_of
from eomcheck.mechanics.described.pose import prepare_of
from eomcheck.mechanics.described.quaternions import rotations
from eomcheck.mechanics.described.rolling import with_sines
from eomcheck.mechanics.described.springs import stored, taken, with_lengths
from eomcheck.mechanics.described.start import started
from eomcheck.mechanics.described.terms import terms_of
from eomcheck.mechanics.described.topology import Plan, Topology
from eomcheck.mechanics.parameters import Parametric
from eomcheck.mechanics.records import ANY_ANGLE, Range, Symmetry
from eomcheck.mechanics.scene import Scene, nothing_moving
from eomcheck.mechanics.sketch import Sketch
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.generic import FLOAT64, Arithmetic, Array, generic

SLIDING, AWAY = Range(-1.0, 1.0), Range(-1.2, 1.2)
"""m; rad, for a hinge between two others that it could bring in line."""


class Made(NamedTuple):
    """All that a kind of mechanism is made of, in numbers and names."""

    key: str
    """Also the name of the class."""
    topology: Topology
    defaults: tuple[tuple[str, Any], ...]
    """Parameters, by name."""
    pose: tuple[float, ...]
    """q at t = 0."""
    several: tuple[str, ...] = ()
    """Coordinates of joints that have more than one."""
    away: tuple[int, ...] = ()
    """Coordinates of hinges that ordinary states keep away from their singularity."""
    closed: bool = False
    """Whether geometry keeps its numbers, because others might not close."""
    code: str = ""
    """Python that makes the scene; by default the name of the class, called."""
    imported: str = ""
    """What that Python imports."""
    module: str = __name__
    left_out: str = ""
    """What of its source is not in it, in one sentence."""
    doubtful: str = ""
    """What of its numbers no body has, in one sentence."""
    source: str = ""
    """The file that it was read from."""
    format: str = ""
    """Of that file: "urdf" or "mjcf"."""
    floating: str = ""
    """Name of the link of the file that is free to move because that was asked for."""
    base: Any = None
    """The class that it derives from and has its `key` of; by default `Mechanism`."""
    description: Any = None
    """What it was made of, where that is kept."""

    def kind(self) -> type[Mechanism]:
        """Return the class of these scenes; the same one for the same description."""
        return kind_of(self)


class _Kind(ABCMeta):
    """The class of kinds of mechanisms, which pickle finds by what they are made of."""


def _reduced(kind: Any) -> Any:
    made = vars(kind).get("made")
    return kind.__qualname__ if made is None else (kind_of, (made,))


copyreg.pickle(_Kind, _reduced)


class Mechanism(Parametric, metaclass=_Kind):
    """A tree of rigid bodies with what closes it; `kind_of` makes the classes that have any."""

    made: ClassVar[Made]
    plan: ClassVar[Plan]
    conserves_energy = True

    def __post_init__(self):
        super().__post_init__()
        damping: Any = getattr(self, "damping", None)
        if self.conserves_energy and damping is not None and np.any(damping):
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers in the joints take it")

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Those of the joints."""
        return self.made.topology.coordinates

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return any angle, but for hinges that have to stay away; 1 m to either side."""
        return self._coordinate_ranges

    _coordinate_ranges: ClassVar[tuple[Range, ...]] = ()

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return rotations of seats, masses and inertias, rotors among them."""
        found, given = {}, {}
        for name in NOT_READ:
            value = getattr(self, name, None)
            given[name] = None if value is None else arithmetic.numbers(value)
        if given["orientation"] is not None:
            found["rotation"] = _rotations_in(arithmetic, given["orientation"])
        parts = given["moments"], given["products"], given["armature"]
        found["inertia"] = inertias(*parts, self.plan.e)
        if self.plan.rotors:
            mass: Any = getattr(self, "mass", None)
            of_bodies = arithmetic.numbers(np.zeros(0) if mass is None else mass)
            none = np.zeros(len(self.plan.rotors), of_bodies.dtype)
            found["mass"] = np.concatenate((of_bodies, none))
        return found

    def initial_state(self) -> tuple[Array, Array]:
        """Return the pose of the description, closed, and the slowest velocity there is."""
        return started(self)

    @property
    def as_described(self) -> bool:
        """Whether all parameters are those of the description."""
        return Parametric.__repr__(self) == f"{type(self).__name__}()"

    def changed(self, **parameters: Any) -> Self:
        """Return the same mechanism with other parameters."""
        return replace(self, **parameters)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield one turn by 2π about every hinge that has no spring and is followed by none."""
        told = {slot.coordinate for slot in self.plan.slots if slot.slides}
        told |= {slot.coordinate for slot in self.plan.slots if slot.spring is not None}
        told |= {slot.coordinate for slot in self.plan.slots if slot.follows is not None}
        for closure in self.made.topology.closures:
            told |= set(closure.coordinates)
        turns = np.array([i not in told for i in range(self.n)])
        if turns.any():
            yield Symmetry("full turns", self, q + 2.0 * np.pi * turns, v, np.eye(self.n))

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield the mechanism of the description, and one without gravity."""
        yield from super().structures(links)
        plain = cls()
        if getattr(plain, "gravity", None) is not None:
            yield plain.changed(gravity=None)

    @property
    def support(self) -> Array | None:
        """Which generalized speeds can move each body, bool (n_b, p)."""
        return support_of(self, self.plan.support)

    def tree(self) -> Tree:
        """Return its bodies, joint by joint."""
        return tree_of(self)

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return links from joint to joint, joints with their axes, centres of mass."""
        return sketched(self, q, t)

    def __repr__(self) -> str:
        """Return the Python that makes it again: that of its kind, and what is changed."""
        made, plain = self.made, Parametric.__repr__(self)
        if not made.code:
            return plain
        arguments = plain.partition("(")[2]
        return made.code if arguments == ")" else f"{made.code}.changed({arguments}"


def _ranges_of(made: Made, plan: Plan) -> tuple[Range, ...]:
    slides = {slot.coordinate for slot in plan.slots if slot.slides and slot.follows is None}
    found = [SLIDING if i in slides else ANY_ANGLE for i in range(plan.n)]
    for i in made.away:
        found[i] = AWAY
    if made.closed:
        found = [Range(x - 0.3, x + 0.3) for x in made.pose]
    return tuple(found)


def functions_of(plan: Plan) -> dict[str, Callable]:
    """Return the functions of a scene."""
    functions = {
        "prepare": with_sines(plan, with_lengths(plan, prepare_of(plan))),
        "jacobians": jacobians_of(plan),
        "forces": forces_of(plan),
        "velocities": energies.velocities_of(plan),
        "potential": potential_of(plan),
        "dissipation": dissipation_of(plan),
        **constraints_of(plan),
    }
    constraints = functions.get("constraints", _no_constraints)
    drift = functions.get("drift", nothing_moving)
    functions["terms"] = terms_of(plan, functions["forces"], constraints, drift)
    return {name: generic(one) for name, one in functions.items() if one is not None}


def potential_of(plan: Plan) -> Callable:
    """Return the function `potential` of a scene."""
    rest = energies.potential_of(plan)
    if not plan.topology.springs:
        return rest

    def potential(parameters, prepared, q):
        return plus(rest(parameters, prepared, q), stored(plan, parameters, prepared))

    return potential


def dissipation_of(plan: Plan) -> Callable | None:
    """Return the function `dissipation` of a scene, or None without dampers."""
    rest = energies.dissipation_of(plan)
    if not plan.topology.springs:
        return rest

    def dissipation(parameters, prepared, q, v):
        R = None if rest is None else rest(parameters, prepared, q, v)
        return plus(R, taken(plan, parameters, prepared, q, v))

    return dissipation


def _rotations_in(arithmetic: Arithmetic, orientation: Array) -> Array:
    """Rotations (k, 3, 3) of quaternions (k, 4), of which doubles are rounded once, at the end.

    A perturbed sample changes each entry by a share of itself. Where squares cancel, as for a
    quarter turn, rounding them would leave an error larger than the entry.
    """
    if arithmetic is not FLOAT64:
        return rotations(orientation)
    exact = np.array([Fraction(x) for x in orientation.ravel()], object).reshape(orientation.shape)
    return np.asarray(rotations(exact), np.float64)


def _no_constraints(parameters, prepared, q):
    return None, None


@lru_cache(256)
def planned(topology: Topology) -> tuple[Plan, dict[str, Callable]]:
    """Return the plan of a topology and the functions of its scenes, made once."""
    plan = Plan(topology)
    return plan, functions_of(plan)


@lru_cache(256)
def kind_of(made: Made) -> type[Mechanism]:
    """Return the class of scenes of a description; the same one for the same description."""
    plan, functions = planned(made.topology)
    planar, closures = made.topology.planar, made.topology.closures
    names = [
        name if count == 1 else f"{name} {i + 1}"
        for name, count in ((one.name, rows_of(one, planar)) for one in closures)
        for i in range(count)
    ]
    held = sum(rows_of(one, planar) for one in closures if KINDS[one.kind].holonomic)
    turned = sorted({slot.coordinate for slot in plan.slots if not slot.slides})
    body = {
        "__doc__": f"{made.key}, made of a description. {made.left_out}".strip(),
        "__module__": made.module,
        "made": made,
        "plan": plan,
        **({"key": made.key} if made.base is None else {}),
        "named_constraints": tuple(names),
        "holonomic": slice(0, held),
        "depends_on_time": any(one.kind == "drive" for one in closures),
        "_coordinate_ranges": _ranges_of(made, plan),
        **{name: staticmethod(one) for name, one in functions.items()},
        **fields_of(made),
    }
    if turned == list(range(plan.n)):
        body["angle_coordinates"] = slice(0, None)
    body["__annotations__"] = dict.fromkeys((name for name, _ in made.defaults), Any)
    if body["depends_on_time"]:
        body |= {"conserves_energy": False, "why_not_conserved": "what a clock drives does work"}
    found: Any = _Kind(made.key, (made.base or Mechanism,), body)
    return found
