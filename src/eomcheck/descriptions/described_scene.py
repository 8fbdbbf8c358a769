"""Scenes written as a `Description`: elements whose numbers are the parameters of the scene.

A scene provides one function, description(parameters) -> `Description`, from which all its
functions are constructed. It is evaluated anew for every scalar type. A literal 0 is absent and
costs nothing, a literal 1 or -1 costs no operation; all other numbers are parameters or computed
from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.descriptions.constraint_rows import KINDS
from eomcheck.descriptions.elements import COORDINATES, Constraint, Joint, Link, Spring, Triple
from eomcheck.descriptions.first_derivation import joint_frames
from eomcheck.descriptions.joint_tree import ConstraintSpec, ElementReader, Topology, TopologyPlan
from eomcheck.descriptions.mechanism_class import none_as_zero, plan_and_functions, tree_by
from eomcheck.descriptions.vector_algebra import IDENTITY, Quaternion, rotation_matrix
from eomcheck.errors import InputError
from eomcheck.mechanics.derived_functions import support_of
from eomcheck.mechanics.parameters import Parametric
from eomcheck.mechanics.records import Tree, TreeFrame
from eomcheck.numbers.generic import FLOAT64, Array, generic

GROUND = "ground"
"""Name of the ground, the link on which all others are mounted."""


class Description(NamedTuple):
    """A declarative description of a mechanism: its elements.

    Bodies are the links with a mass, in their order: their moments of inertia are in the parameter
    `inertia` of the scene, (n_b, e, e) or (n_b,).
    """

    links: Iterable[Link]
    joints: Iterable[Joint]
    """Joints in depth-first order: the subtree of a joint follows it immediately."""
    coordinates: tuple[str, ...] = ()
    """Names of the joints' coordinates in the order of q; by default in the order of the joints."""
    constraints: Iterable[Constraint] = ()
    """Constraints, in the order of their rows."""
    springs: Iterable[Spring] = ()
    gravity: Triple | None = None
    planar: bool = False


class DescriptionParameters(NamedTuple):
    """Parameters of the functions of a plan."""

    mass: Any
    inertia: Any
    center: Any
    offset: Any
    rotation: Any
    points: Any
    directions: Any
    lengths: Any
    surfaces: Any
    factors: Any
    springs: Any
    torque: Any
    stiffness: Any
    relaxed: Any
    gimbal_stiffness: Any
    rest_rotation: Any
    damping: Any
    gravity: Any


def zeros_as_none(entries: Iterable[Any]) -> tuple[Any, ...]:
    """Return the entries, literal zeros replaced by None."""
    return tuple(None if type(x) in (int, float) and x == 0 else x for x in entries)


class _DescriptionReader(ElementReader):
    """A reader of a `Description`: absent numbers are None, vectors are shared by identity."""

    def __init__(self, description: Description):
        super().__init__()
        self.description = description
        self.links = {link.name: link for link in description.links}
        self.bodies = [
            name for name, link in self.links.items() if any_present(zeros_as_none((link.mass,)))
        ]
        joints = tuple(description.joints)
        names = [joint.name + part for joint in joints for part in COORDINATES[joint.kind]]
        self.coordinates = description.coordinates or tuple(names)
        self.index = {name: i for i, name in enumerate(self.coordinates)}
        self.link_joints = {GROUND: -1}
        for joint in joints:
            self.link_joints[joint.child] = self._attach(joint)

    def _attach(self, joint: Joint) -> int:
        offset, (axis, sense) = zeros_as_none(joint.origin), _axis(joint.axis)
        seat = {
            "orientation": self.add_parameter("rotation", _seat(joint.orientation)),
            "offset": self.add_parameter("offset", offset if any_present(offset) else None),
        }

        def fields(name: str) -> dict[str, Any]:
            return {
                "coordinate": self.index[name],
                "sense": sense if name == joint.name else 1,
                "absolute": joint.absolute,
                "torque": self.add_parameter("torque", joint.torque),
                "symmetric": joint.symmetric,
            }

        last = self.add_joint(joint, self.link_joints[joint.parent], axis, seat, fields)
        if joint.child in self.bodies:
            body = self.bodies.index(joint.child)
            self.scalar_joints[last] = self.scalar_joints[last]._replace(body=body)
        return last

    def add_vectors(self, name: str, vectors: Iterable[tuple[str, Triple]]) -> tuple[Any, ...]:
        """Return the frame of each link, and the index of its point or direction."""
        return tuple(
            (self.link_joints[link], self.add_parameter(name, zeros_as_none(x), id(x)))
            for link, x in vectors
        )

    def constraint_spec(self, constraint: Constraint) -> ConstraintSpec:
        """Return a constraint with indices for its frames and numbers."""
        return ConstraintSpec(
            constraint.kind,
            constraint.name,
            self.add_vectors("points", constraint.points),
            self.add_vectors("directions", constraint.directions),
            number=self.add_parameter(
                KINDS[constraint.kind].numbers, constraint.numbers, id(constraint.numbers)
            ),
            factor=self.add_parameter("factors", constraint.factor),
        )

    def spring_spec(self, spring: Spring) -> ConstraintSpec:
        """Return a spring with indices for its frames and numbers."""
        ends = (spring.link, spring.at), (spring.other, spring.at_other)
        points, number = self.add_vectors("points", ends), self.add_parameter("springs", spring)
        return ConstraintSpec("spring", spring.name, points, number=number)

    def topology(self) -> Topology:
        """Return the topology, which all such mechanisms share."""
        description = self.description
        closures = tuple(self.constraint_spec(c) for c in description.constraints)
        springs = tuple(self.spring_spec(s) for s in description.springs)
        for name in self.bodies:
            self.add_parameter("mass", self.links[name].mass)
            self.add_parameter("center", zeros_as_none(self.links[name].center))
        slots = tuple(self.scalar_joints)
        return Topology(slots, self.coordinates, description.planar, closures, springs)


def any_present(entries: tuple[Any, ...]) -> bool:
    """Return whether any entry is present."""
    return any(x is not None for x in entries)


def _axis(axis: Triple) -> tuple[str, int]:
    """Return the axis of a frame that a joint is along, and its sense."""
    ((place, sense),) = ((i, x) for i, x in enumerate(axis) if x)
    return "xyz"[place], int(sense)


def _seat(turn: Any) -> Any:
    """Return the rotation of a joint's seat; None for the identity."""
    if np.shape(turn) == (3, 3):
        return np.array([zeros_as_none(row) for row in turn], object)
    return _quarters(turn)


@lru_cache(64)
def _quarters(turn: Quaternion) -> Any:
    """Return the rotation of a joint's seat in whole numbers; None for the identity."""
    if turn == IDENTITY:
        return None
    whole = np.rint(rotation_matrix(turn)).astype(int)
    if np.abs(whole - rotation_matrix(turn)).max() > 1e-12:
        raise TypeError(f"turn = {turn}: seats of scenes are turned by quarters")
    return np.array([[int(x) or None for x in row] for row in whole], object)


class ParsedDescription(NamedTuple):
    """A parsed description: plan, functions and numbers."""

    plan: TopologyPlan
    functions: dict[str, Callable]
    parameters: DescriptionParameters
    link_joints: dict[str, int]
    """Name of a link -> index of the scalar joint that moves it; -1 for the ground."""


CACHE_SIZE = 4
"""Number of cached float64 descriptions: the check of one state reads its own hundreds of times."""

_cache: tuple[tuple[Callable, Any, ParsedDescription], ...] = ()


def parse_description(description: Callable, parameters: Any) -> ParsedDescription:
    """Return plan, functions and numbers of a description.

    Descriptions of the same float64 parameters are cached. Parameters of any other scalar type are
    read anew: operations on them are counted, or round in their own way.
    """
    global _cache
    for cached_description, cached_parameters, understood in _cache:
        if cached_description is description and cached_parameters is parameters:
            return understood
    understood = _parse(description, parameters)
    if all(map(_is_float64, parameters)):
        _cache = ((description, parameters, understood), *_cache[: CACHE_SIZE - 1])
    return understood


def _is_float64(x: Any) -> bool:
    """Return whether x is None or an array of float64, or of objects that are floats."""
    return x is None or (
        type(x) is np.ndarray
        and (x.dtype == np.float64 or all(type(entry) is float for entry in x.flat))
    )


def _parse(description: Callable, parameters: Any) -> ParsedDescription:
    elements: Description = description(parameters)
    reader = _DescriptionReader(elements)
    plan, functions = plan_and_functions(reader.topology())
    gravity = None if elements.gravity is None else zeros_as_none(elements.gravity)
    numbers: dict[str, Any] = {name: [] for name in DescriptionParameters._fields}
    numbers |= reader.numbers
    numbers |= {"inertia": _inertia(parameters, plan), "damping": None, "gravity": gravity}
    return ParsedDescription(plan, functions, DescriptionParameters(**numbers), reader.link_joints)


# ---- Scene class ---------------------------------------------------------------------------------

OPEN = "jacobians", "terms", "forces", "velocities", "potential"
CLOSED = "constraints", "drift", "constraint"
HELD = ("position_residual",)
DAMPED = ("dissipation",)


def _inertia(parameters: Any, plan: TopologyPlan) -> Any:
    """Return moments of inertia (n_b, e, e) from a scene's parameters."""
    shape = plan.bodies, plan.e, plan.e
    inertia = getattr(parameters, "inertia", None)
    if inertia is None or inertia.size != math.prod(shape):
        what = "is missing" if inertia is None else f"has {inertia.size} numbers"
        raise InputError(
            f"the parameter inertia of a description {what}; it must have {math.prod(shape)}, "
            f"of shape {shape}: moments of inertia of each link with a mass, in their order"
        )
    return inertia.reshape(shape)


def _prepare(description: Callable) -> Callable:
    def prepare(arithmetic, parameters, q, t):
        parsed = parse_description(description, parameters)
        return _call_function(parsed, "prepare", arithmetic, parsed.parameters, q, t)

    return generic(prepare)


def _function(description: Callable, name: str) -> Callable:
    def function(parameters, *arguments):
        parsed = parse_description(description, parameters)
        return _call_function(parsed, name, parsed.parameters, *arguments)

    function.__name__ = function.__qualname__ = name
    return generic(function)


def _call_function(parsed: ParsedDescription, name: str, *arguments: Any) -> Any:
    """Return the result of a function of a description; explain floats in exact arithmetic."""
    try:
        return parsed.functions[name](*arguments)
    except TypeError as error:
        # Exact scalar types combine with whole numbers, not with float64.
        written = [x for x in _flat(parsed.parameters) if type(x) is float and not x.is_integer()]
        if not written:
            raise
        what = f"{written[0]!r} in a description is no whole number: make it a parameter"
        raise TypeError(what) from error


def _flat(x: Any) -> Iterator[Any]:
    """Yield the leaves of nested lists and tuples."""
    if isinstance(x, list | tuple):
        for part in x:
            yield from _flat(part)
    else:
        yield x


class Described(Parametric):
    """A scene constructed from a description, whose numbers are its parameters."""

    description: ClassVar[Callable[[Any], Description]]

    def __init_subclass__(
        cls,
        description: Callable[[Any], Description] | None = None,
        closed: bool = False,
        held: bool = True,
        damped: bool = False,
        **options,
    ):
        """Construct the functions of the scene from a description.

        Args:
            description: function of the parameters, in any scalar type, that returns it.
            closed: whether there are constraints.
            held: whether any of them is holonomic.
            damped: whether there may be dampers.
            options: for other base classes.
        """
        if description is not None:
            cls.description = staticmethod(description)
            names = [*OPEN, *(CLOSED if closed else ()), *(DAMPED if damped else ())]
            names += HELD if closed and held else ()
            own = {name: _function(description, name) for name in names}
            options |= {"functions": own | {"prepare": _prepare(description)}}
        super().__init_subclass__(**options)

    @property
    def support(self) -> Array | None:
        """Mask of the generalized speeds that can move each body, bool (n_b, p)."""
        plan = parse_description(type(self).description, self.float64_parameters).plan
        return support_of(self, plan.support)

    def tree(self, parameters: Any = None) -> Tree | None:
        """Return the tree of its bodies, joint by joint."""
        numbers = self.float64_parameters if parameters is None else parameters
        parsed = parse_description(type(self).description, numbers)
        links = (
            TreeFrame(name, joint, np.eye(3), np.zeros(3))
            for name, joint in parsed.link_joints.items()
        )
        return tree_by(parsed.plan, parsed.parameters)._replace(links=tuple(links))

    def frames(self, q: Array, t: float = 0.0) -> dict[str, tuple[Array, Array]]:
        """Return origin (3,) and axes (3, 3), in rows, of each link in the pose q (n,), by name."""
        plan, functions, numbers, slots = parse_description(
            type(self).description, self.float64_parameters
        )
        prepared = functions["prepare"](FLOAT64, numbers, np.asarray(q, np.float64), t)
        frames = joint_frames(plan, numbers, prepared)
        return {
            link: (none_as_zero(frames[k].origin), none_as_zero(frames[k].axes))
            for link, k in slots.items()
            if k >= 0
        }
