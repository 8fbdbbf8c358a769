"""Scene classes of descriptions: a `Mechanism` class for each topology, all numbers its parameters.

`scene_class_of` makes the class from a `MechanismSource`, the record of topology and numbers. It is
a class and not an instance, because lookup, sampling, proofs and kernels ask the class of a scene
for its parameters, ranges and functions: so a mechanism goes every way that a scene by hand does.
The rest of the module defines the parts of the class: its parameters, the initial state (the
assembled pose, with the slowest velocity that its constraints allow), its `Tree` for engines that
build models of their own, and its `Sketch`: links from joint to joint, axes, centres of mass.
"""

from __future__ import annotations

import copyreg
from abc import ABCMeta
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self
from weakref import WeakValueDictionary

import numpy as np

from eomcheck.deprecated import getattr_of, old_attributes
from eomcheck.descriptions import second_derivation
from eomcheck.descriptions.constraint_rows import (
    KINDS,
    make_constraint_functions,
    row_count,
    with_sines,
)
from eomcheck.descriptions.first_derivation import (
    arm_and_position,
    joint_frames,
    make_jacobians,
    make_prepare,
    make_terms,
)
from eomcheck.descriptions.forces import (
    gimbal_spring_energy,
    make_forces,
    spring_dissipation,
    spring_energy,
    with_half_cosines,
    with_lengths,
)
from eomcheck.descriptions.joint_tree import Topology, TopologyPlan, plan_of
from eomcheck.descriptions.vector_algebra import (
    Quaternion,
    as_vector,
    plus,
    rotation_matrices,
    rotation_matrix,
)
from eomcheck.mechanics.derived_functions import no_velocity_term, support_of
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import ANY_ANGLE, Range, Symmetry, Tree, TreeFrame
from eomcheck.mechanics.scene import Scene
from eomcheck.mechanics.sketch import (
    UPRIGHT,
    Arrow,
    Body,
    Center,
    Closing,
    ConstraintMark,
    Ground,
    JointMark,
    Part,
    Sketch,
    Trail,
    fixed_axes,
)
from eomcheck.numbers.generic import FLOAT64, Arithmetic, Array, generic, map_entries
from eomcheck.numbers.linear import least_squares

# ---- Parameters ----------------------------------------------------------------------------------

DRAWN: dict[str, tuple[str, str, Any, Any]] = {
    "orientation": ("quaternions of seats that are turned, of any length", "1", "", (0.1, 1.0)),
    "offset": ("positions of seats", "m", "", (-1.0, 1.0)),
    "mass": ("of bodies", "kg", ">= 0", (0.1, 10.0)),
    "center": ("centres of mass", "m", "", (-1.0, 1.0)),
    "moments": ("I, central, about the axes", "kg m²", "", (0.6, 1.0)),
    "products": ("entries xy, xz, yz of I, central", "kg m²", "", (-0.02, 0.02)),
    "gravity": ("acceleration", "m/s²", "", (-20.0, 20.0, None)),
    "ratio": ("of joints that follow others", "1", "", (0.2, 2.0)),
    "shift": ("their position where the other's is 0", "rad or m", "", (-1.0, 1.0)),
    "stiffness": ("of springs at joints", "N m/rad or N/m", ">= 0", (0.0, 100.0)),
    "relaxed": ("where they rest", "rad or m", "", (-1.0, 1.0)),
    "gimbal_stiffness": ("of springs at joints that turn freely", "N m/rad", ">= 0", (0.0, 100.0)),
    "rest_orientation": ("quaternions at which they rest, of any length", "1", "", (0.1, 1.0)),
    "damping": ("of dampers at joints", "N m s/rad or N s/m", ">= 0", (0.0, 10.0, None)),
    "armature": ("inertia of rotors", "kg m² or kg", ">= 0", (0.01, 1.0)),
    "points": ("of closures", "m", "", (-1.0, 1.0)),
    "directions": ("of closures, of any length", "1", "", (0.1, 1.0)),
    "lengths": ("of rods", "m", "> 0", (0.5, 2.0)),
    "surfaces": ("three bends, three slopes and a level", "1/m, 1, m", "", (0.1, 1.0)),
    "couplings": ("ratio and shift", "1, rad or m", "", (0.2, 2.0)),
    "drives": ("position, rate, acceleration", "rad or m, /s, /s²", "", (-1.0, 1.0)),
}
"""Name of a parameter -> description, unit, sign, sampling range."""

GEOMETRY = frozenset(
    {"orientation", "offset", "points", "directions", "lengths", "surfaces", "couplings"}
)
"""Parameters that decide whether a mechanism can be assembled."""

NOT_READ = ("orientation", "rest_orientation", "moments", "products", "armature")
"""Parameters that equations read only through `derived` ones."""

OPTIONAL = frozenset({"gravity", "damping"})


def fields_of(source: MechanismSource) -> dict[str, Any]:
    """Return the dataclass fields of a description's scene class, its parameters."""
    fields = {}
    for name, value in source.defaults:
        what, unit, sign, drawn = DRAWN[name]
        among = None if source.fixed_geometry and name in GEOMETRY else drawn
        shape = (2 if source.topology.planar else 3,) if name == "gravity" else np.shape(value)
        fields[name] = parameter(
            *(what, unit, sign, among, shape),
            default=value,
            optional=name in OPTIONAL,
            read=name not in NOT_READ,
        )
    return fields


@generic
def inertias(
    moments: Any, products: Any, armature: Any, e: int, gimbals: tuple[bool, ...] = ()
) -> Any:
    """Return I (n_b, e, e) of bodies, then of rotors; each may be None.

    Rotors have a moment about their last axis alone, those of gimbals about all.
    """
    counts = [0 if v is None else v.shape[0] for v in (moments, armature)]
    bodies, rotors = counts
    inertia = np.zeros((bodies + rotors, e, e), (armature if bodies == 0 else moments).dtype)
    for k in range(bodies):
        for i in range(e):
            inertia[k, i, i] = moments[k] if e == 1 else moments[k, i]
    for place, (i, j) in enumerate(((0, 1), (0, 2), (1, 2)) if e == 3 else ()):
        for k in range(bodies):
            inertia[k, i, j] = inertia[k, j, i] = products[k, place]
    for k in range(rotors):
        for i in range(e) if gimbals[k : k + 1] == (True,) else (e - 1,):
            inertia[bodies + k, i, i] = armature[k]
    return inertia


# ---- Initial state -------------------------------------------------------------------------------

STEPS = 30
"""Steps of Newton's method, which converges within ten or not at all."""


def assembled_start(scene: Mechanism) -> tuple[Array, Array]:
    """Return the pose (n,) assembled by Newton's method, and the least v (n,) with a v + b = 0.

    A pose without an assembled one nearby is returned unchanged.
    """
    pose = np.array(scene.source.pose, np.float64)
    if not scene.r:
        return pose, np.zeros(scene.n)
    parameters, q = scene.float64_parameters, pose
    for _ in range(STEPS):
        a, _, residual = _evaluate_constraints(scene, parameters, q)
        if residual is None:
            break
        step = least_squares(a[scene.holonomic], residual)
        q = q - step
        if not np.isfinite(q).all() or np.abs(q - pose).max() > 10.0:
            q = pose
            break
        if np.abs(step).max() <= 4 * np.finfo(np.float64).eps * max(1.0, np.abs(q).max()):
            break
    a, b, _ = _evaluate_constraints(scene, parameters, q)
    return q, np.zeros(scene.n) if b is None else least_squares(a, -b)


def _evaluate_constraints(
    scene: Mechanism, parameters: Any, q: Array
) -> tuple[Array, Array | None, Array | None]:
    """Return a, b and the position residual; None for absent ones."""
    prepared = scene.prepare(FLOAT64, parameters, q, 0.0)
    a, b = scene.constraints(parameters, prepared, q)
    held = scene.position_residual
    return a, b, None if held is None else held(parameters, prepared, q)


# ---- Tree of bodies ------------------------------------------------------------------------------


def none_as_zero(entries: Any) -> Array:
    """Return entries as float64, absent ones as 0."""
    return _zero_where_absent(entries).astype(np.float64)


def _zero_where_absent(entries: Any) -> Array:
    # By identity: a comparison of variables would be a branch on a value.
    return map_entries(lambda x: 0 if x is None else x, np.asarray(entries, object))


def _moments(moment: Any) -> Array:
    """Return the inertia (3, 3) with one moment about all axes."""
    axes, inertia = np.arange(3), np.zeros((3, 3), object)
    inertia[axes, axes] = moment
    return inertia


def tree_by(plan: TopologyPlan, numbers: Any) -> Tree:
    """Return the tree of a plan's bodies, in its numbers; absolute joints must be in the plane."""
    slots, joints = plan.joints, len(plan.joints)
    kind = np.asarray(numbers.mass).dtype
    rotation = np.tile(np.eye(3, dtype=int).astype(kind), (joints, 1, 1))
    offset, center, inertia = (np.zeros((joints, *shape), kind) for shape in ((3,), (3,), (3, 3)))
    mass, shift, armature, gimbal = np.zeros((4, joints), kind)
    coordinates = np.zeros((joints, plan.n), kind)
    turned = np.zeros((joints + 1, plan.n), kind)  # by it and all joints before; the last by none
    for k, slot in enumerate(slots):
        coordinates[k, slot.coordinate] = slot.sense
        if slot.absolute:  # relative coordinate: the absolute one less all earlier rotations
            coordinates[k] -= turned[slot.parent]
        if slot.mimics is not None:
            coordinates[k] *= numbers.ratio[slot.mimics]
            shift[k] = slot.sense * numbers.shift[slot.mimics]
        turned[k] = turned[slot.parent] + (0 if slot.slides else coordinates[k])
        if slot.orientation is not None:
            rotation[k] = _zero_where_absent(numbers.rotation[slot.orientation])
        if slot.offset is not None:
            offset[k, : plan.d] = _zero_where_absent(numbers.offset[slot.offset])[: plan.d]
    for b, k in enumerate(plan.carriers):
        mass[k] = numbers.mass[b]
        center[k, : plan.d] = _zero_where_absent(numbers.center[b])[: plan.d]
        # In the plane one moment counts; all axes get it, so that the body is physically possible.
        inertia[k] = numbers.inertia[b] if plan.e == 3 else _moments(numbers.inertia[b, 0, 0])
    for b, k in enumerate(plan.rotors, len(plan.carriers)):
        (gimbal if slots[k].gimbal else armature)[k] = numbers.inertia[b, -1, -1]
    parent, kinds = tuple(slot.parent for slot in slots), tuple(slot.kind for slot in slots)
    gravity = np.zeros(3, kind)
    if numbers.gravity is not None:
        gravity[: plan.d] = _zero_where_absent(numbers.gravity)[: plan.d]
    names = tuple(slot.name for slot in slots)
    return Tree(
        *(parent, kinds, rotation, offset, mass, center, inertia, coordinates, shift, armature),
        gravity=gravity,
        names=names,
        gimbal_armature=gimbal if any(slots[k].gimbal for k in plan.rotors) else (),
    )


# ---- Sketch --------------------------------------------------------------------------------------

FORCED_AT = {"pin": 0, "weld": 0, "hinge": 0, "distance": 1}
"""Kind of a constraint whose first rows are a force between two points -> number of these rows, 0:
one per dimension."""
NEAR = 1e-9
"""Distance, relative to the size of the whole, below which points are drawn as one."""


def _place(a: Any, d: int) -> Array:
    return np.array([0.0 if x is None else float(x) for x in a[:d]])


def mechanism_sketch(scene: Mechanism, q: Array, t: float = 0.0) -> Sketch:
    """Return the sketch of the mechanism in the pose q (n,)."""
    plan = scene.plan
    parameters: Any = scene.float64_parameters
    prepared = scene.prepare(FLOAT64, parameters, np.asarray(q, np.float64), t)
    frames, d = joint_frames(plan, parameters, prepared), plan.d
    origins = [_place(frame.origin, d) for frame in frames]
    centers = {
        k: _place(arm_and_position(frames, k, as_vector(parameters.center[b]))[1], d)
        for b, k in enumerate(plan.carriers)
    }
    everything = np.array([np.zeros(d), *origins, *centers.values()])
    size = float(np.ptp(everything, axis=0).max()) or 1.0
    parts: list[Part] = [*fixed_axes(0.15 * size, d)]

    def line(start: Array, end: Array, **look: Any) -> None:
        if np.abs(end - start).max() > NEAR * size:
            parts.append(Body((start, end), **look))

    # In space the ground is a body with lines from the origin to its joints.
    fixed = [k for k, slot in enumerate(plan.joints) if slot.parent < 0]
    based = d == 3 and any(np.abs(origins[k]).max() > NEAR * size for k in fixed)
    if based:
        parts.append(Ground(np.zeros(d)))
    for k, slot in enumerate(plan.joints):
        # From joint to joint, a line of the previous body, or of the ground.
        if slot.parent >= 0 or based:
            line(origins[slot.parent] if slot.parent >= 0 else np.zeros(d), origins[k])
        axis, name = _place(frames[k].axis, d), slot.name.replace("_", " ")
        if slot.slides:
            along = 0.12 * size * axis / (np.linalg.norm(axis) or 1.0)
            parts.append(Arrow(name, origins[k], along, frame=False))
        else:
            pinned = slot.parent < 0 and not based
            parts.append(JointMark(origins[k], pinned, name, None if d == 2 else axis))
        if k in centers:
            parts.append(Center(centers[k]))
            last = all(child.parent != k for child in plan.joints)
            line(origins[k], centers[k], thin=not last)
            if last:
                parts.append(Trail(centers[k]))
    row = 0
    for closure in plan.topology.constraints:
        rows = tuple(range(row, row := row + row_count(closure, plan.topology.planar)))
        if closure.points:
            held = [
                _place(arm_and_position(frames, k, as_vector(parameters.points[i]))[1], d)
                for k, i in closure.points
            ]
            parts.append(ConstraintMark(closure.name, held[0], rows))
            if closure.kind in FORCED_AT:
                parts.append(Closing(held[0], held[1], rows[: FORCED_AT[closure.kind] or d]))
                if closure.kind == "distance":
                    line(held[0], held[1], thin=True)
            for (k, _), point in zip(closure.points, held, strict=True):
                if k >= 0 and (closure.kind in FORCED_AT or point is held[0]):
                    line(origins[k], point)
    if parameters.gravity is not None and np.any(parameters.gravity):
        along = 0.2 * size * parameters.gravity / np.linalg.norm(parameters.gravity)
        parts.append(Arrow("g", np.zeros(d) - 0.2 * size * np.eye(d)[0], along, frame=False))
    return Sketch(tuple(parts)) if d == 3 else Sketch(tuple(parts), **UPRIGHT)


# ---- The class -----------------------------------------------------------------------------------

SLIDING, AWAY = Range(-1.0, 1.0), Range(-1.2, 1.2)
"""Ranges of slides, m, and of hinges that could align two others, rad."""


class NumberedFrame(NamedTuple):
    """Frame of a link, fixed to a scalar joint, in plain numbers."""

    name: str
    """Name of the link."""
    joint: int
    """Index of the scalar joint that moves it, -1: the ground."""
    orientation: Quaternion
    """Orientation in the frame of the scalar joint, of any length."""
    offset: tuple[float, float, float]
    """Origin in the frame of the scalar joint, m."""


@old_attributes
class MechanismSource(NamedTuple):
    """Source of a mechanism class, in numbers and names."""

    key: str
    """Key of the scenes and name of the class."""
    topology: Topology
    defaults: tuple[tuple[str, Any], ...]
    """Default values of the parameters, by name."""
    pose: tuple[float, ...]
    """Coordinates q at t = 0."""
    compound_coordinates: tuple[str, ...] = ()
    """Coordinates of joints with more than one coordinate."""
    pitch_coordinates: tuple[int, ...] = ()
    """Coordinates of hinges that ordinary states keep away from their singularity."""
    tilted: bool = False
    """Whether it is in the plane and has bodies with momentum about axes in the plane."""
    fixed_geometry: bool = False
    """Whether sampling keeps the geometry, because another might not assemble."""
    code: str = ""
    """Python code that constructs the scene; by default the name of the class, called."""
    imports: str = ""
    """Imports of that code."""
    module: str = __name__
    ignored: str = ""
    """Sentence on the parts of its source that are left out."""
    warnings: str = ""
    """Sentence on numbers that no physical body has."""
    file: str = ""
    """Path of its source file."""
    format: str = ""
    """Format of that file: "urdf", "mjcf" or "sdf"."""
    model: str = ""
    """Name of the model that was chosen among those of that file."""
    floating: str = ""
    """Name of the link of the file that is free to move by request."""
    frames: tuple[NumberedFrame, ...] = ()
    """Frames of its links, in their order."""
    base: Any = None
    """Base class of its class, which has the same `key`; by default `Mechanism`."""
    description: Any = None
    """Description from which it was constructed, if stored."""

    def with_frames_of(self, links: Iterable[str]) -> MechanismSource:
        """Return the source with the frames of some links alone."""
        names = frozenset(links)
        return self._replace(frames=tuple(x for x in self.frames if x.name in names))

    def of_file(
        self, kind: str, path: Any, options: str, ignored: str, warnings: str = ""
    ) -> MechanismSource:
        """Return the source of a scene that `from_urdf`, `from_mjcf` or `from_sdf` reads."""
        return self._replace(
            code=f"from_{kind}({str(path)!r}{options})",
            imports=f"from eomcheck.scenes import from_{kind}",
            ignored=ignored,
            warnings=warnings,
            file=str(Path(path)),
            format=kind,
        )

    def scene_class(self) -> type[Mechanism]:
        """Return the class of these scenes; the same one for the same description."""
        return scene_class_of(self)


class _Kind(ABCMeta):
    """The metaclass of mechanism classes, which pickle by their source."""


def _reduce_scene_class(kind: Any) -> Any:
    """Return the pickled form of a scene class: its source, or the name of a class without one."""
    source = vars(kind).get("source")
    return kind.__qualname__ if source is None else (scene_class_of, (source,))


copyreg.pickle(_Kind, _reduce_scene_class)


@old_attributes
class Mechanism(Parametric, metaclass=_Kind):
    """A tree of rigid bodies with constraints; `scene_class_of` makes its subclasses, which have
    equations.
    """

    source: ClassVar[MechanismSource]
    plan: ClassVar[TopologyPlan]
    conserves_energy = True

    def __post_init__(self):
        super().__post_init__()
        damping: Any = getattr(self, "damping", None)
        if self.conserves_energy and damping is not None and np.any(damping):
            object.__setattr__(self, "conserves_energy", False)
            object.__setattr__(self, "why_not_conserved", "dampers in the joints take it")

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the joints' coordinates."""
        return self.source.topology.coordinates

    def coordinate_ranges(self) -> tuple[Range, ...]:
        """Return the sampling ranges: any angle, except near a singularity; 1 m to either side."""
        return self._coordinate_ranges

    _coordinate_ranges: ClassVar[tuple[Range, ...]] = ()

    def derived(self, arithmetic: Arithmetic) -> dict[str, Any]:
        """Return rotations of seats, masses and inertias, rotors among them."""
        result, values = {}, {}
        for name in NOT_READ:
            value = getattr(self, name, None)
            values[name] = None if value is None else arithmetic.numbers(value)
        if values["orientation"] is not None:
            result["rotation"] = _rotations_in(arithmetic, values["orientation"])
        if values["rest_orientation"] is not None:
            result["rest_rotation"] = _rotations_in(arithmetic, values["rest_orientation"])
        parts = values["moments"], values["products"], values["armature"]
        gimbals = tuple(self.plan.joints[k].gimbal for k in self.plan.rotors)
        result["inertia"] = inertias(*parts, self.plan.e, gimbals)
        if self.plan.rotors:
            mass: Any = getattr(self, "mass", None)
            of_bodies = arithmetic.numbers(np.zeros(0) if mass is None else mass)
            none = np.zeros(len(self.plan.rotors), of_bodies.dtype)
            result["mass"] = np.concatenate((of_bodies, none))
        return result

    def initial_state(self) -> tuple[Array, Array]:
        """Return the assembled pose of the description, and the least velocity there."""
        return assembled_start(self)

    @property
    def as_described(self) -> bool:
        """Whether all parameters are those of the description."""
        return Parametric.__repr__(self) == f"{type(self).__name__}()"

    def changed(self, **parameters: Any) -> Self:
        """Return the same mechanism with other parameters."""
        return replace(self, **parameters)

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield a rotation by 2π of every hinge that has no spring and that no joint mimics."""
        excluded = {slot.coordinate for slot in self.plan.joints if slot.slides}
        excluded |= {slot.coordinate for slot in self.plan.joints if slot.spring is not None}
        excluded |= {slot.coordinate for slot in self.plan.joints if slot.mimics is not None}
        for closure in self.source.topology.constraints:
            excluded |= set(closure.coordinates)
        turns = np.array([i not in excluded for i in range(self.n)])
        if turns.any():
            yield Symmetry("full turns", self, q + 2.0 * np.pi * turns, v, np.eye(self.n))

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield the structural variants: the described mechanism, and one without gravity."""
        yield from super().structures(links)
        plain = cls()
        if getattr(plain, "gravity", None) is not None:
            yield plain.changed(gravity=None)

    @property
    def support(self) -> Array | None:
        """Mask of the generalized speeds that can move each body, bool (n_b, p)."""
        return support_of(self, self.plan.support)

    def tree(self, parameters: Any = None) -> Tree:
        """Return the tree of its bodies, joint by joint; frames of links are float64."""
        numbers = self.float64_parameters if parameters is None else parameters
        links = (
            TreeFrame(x.name, x.joint, rotation_matrix(x.orientation), np.array(x.offset))
            for x in self.source.frames
        )
        return tree_by(self.plan, numbers)._replace(links=tuple(links))

    def sketch(self, q: Array, t: float = 0.0) -> Sketch:
        """Return links from joint to joint, joints with their axes, centres of mass."""
        return mechanism_sketch(self, q, t)

    def __repr__(self) -> str:
        """Return Python code that reconstructs the scene: its class and changed parameters."""
        source, plain = self.source, Parametric.__repr__(self)
        if not source.code:
            return plain
        arguments = plain.partition("(")[2]
        return source.code if arguments == ")" else f"{source.code}.changed({arguments}"


def _ranges_of(source: MechanismSource, plan: TopologyPlan) -> tuple[Range, ...]:
    slides = {slot.coordinate for slot in plan.joints if slot.slides and slot.mimics is None}
    ranges = [SLIDING if i in slides else ANY_ANGLE for i in range(plan.n)]
    for i in source.pitch_coordinates:
        ranges[i] = AWAY
    if source.fixed_geometry:
        ranges = [Range(x - 0.3, x + 0.3) for x in source.pose]
    return tuple(ranges)


def make_functions(plan: TopologyPlan) -> dict[str, Callable]:
    """Return the functions of a scene by name."""
    prepare = with_half_cosines(plan, with_lengths(plan, make_prepare(plan)))
    functions = {
        "prepare": with_sines(plan, prepare),
        "jacobians": make_jacobians(plan),
        "forces": make_forces(plan),
        "velocities": second_derivation.make_velocities(plan),
        "potential": make_potential(plan),
        "dissipation": make_dissipation(plan),
        **make_constraint_functions(plan),
    }
    constraints = functions.get("constraints", _no_constraints)
    drift = functions.get("drift", no_velocity_term)
    functions["terms"] = make_terms(plan, functions["forces"], constraints, drift)
    return {name: generic(f) for name, f in functions.items() if f is not None}


def make_potential(plan: TopologyPlan) -> Callable:
    """Return the function `potential` of a scene."""
    joint_U = second_derivation.make_joint_potential(plan)
    if not plan.topology.springs and not plan.sprung_gimbals:
        return joint_U

    def potential(parameters, prepared, q):
        U = joint_U(parameters, prepared, q)
        U = plus(U, gimbal_spring_energy(plan, parameters, prepared))
        return plus(U, spring_energy(plan, parameters, prepared))

    return potential


def make_dissipation(plan: TopologyPlan) -> Callable | None:
    """Return the function `dissipation` of a scene, or None without dampers."""
    joint_R = second_derivation.make_joint_dissipation(plan)
    if not plan.topology.springs:
        return joint_R

    def dissipation(parameters, prepared, q, v):
        R = None if joint_R is None else joint_R(parameters, prepared, q, v)
        return plus(R, spring_dissipation(plan, parameters, prepared, q, v))

    return dissipation


def _rotations_in(arithmetic: Arithmetic, orientation: Array) -> Array:
    """Return rotations (k, 3, 3) of quaternions (k, 4), float64 results rounded once, at the end.

    In perturbation analysis each entry of a sample has a relative perturbation. Where squares
    cancel, as for a quarter turn, rounding them would leave an error larger than the entry.
    """
    if arithmetic is not FLOAT64:
        return rotation_matrices(orientation)
    exact = np.array([Fraction(x) for x in orientation.ravel()], object).reshape(orientation.shape)
    return np.asarray(rotation_matrices(exact), np.float64)


def _no_constraints(parameters, prepared, q):
    return None, None


@lru_cache(256)
def plan_and_functions(topology: Topology) -> tuple[TopologyPlan, dict[str, Callable]]:
    """Return the plan of a topology and the functions of its scenes, cached."""
    plan = plan_of(topology)
    return plan, make_functions(plan)


_IN_USE: WeakValueDictionary[MechanismSource, type[Mechanism]] = WeakValueDictionary()
"""Classes that something still holds, so that the cache below may forget them."""


@lru_cache(256)
def scene_class_of(source: MechanismSource) -> type[Mechanism]:
    """Return the scene class of a description; the same one for the same description."""
    if (cached := _IN_USE.get(source)) is not None:
        return cached
    plan, functions = plan_and_functions(source.topology)
    planar, closures = source.topology.planar, source.topology.constraints
    names = [
        name if count == 1 else f"{name} {i + 1}"
        for name, count in ((c.name, row_count(c, planar)) for c in closures)
        for i in range(count)
    ]
    held = sum(row_count(c, planar) for c in closures if KINDS[c.kind].holonomic)
    turned = sorted({slot.coordinate for slot in plan.joints if not slot.slides})
    body = {
        "__doc__": f"{source.key}, made of a description. {source.ignored}".strip(),
        "__module__": source.module,
        "source": source,
        "plan": plan,
        **({"key": source.key} if source.base is None else {}),
        "named_constraints": tuple(names),
        "holonomic": slice(0, held),
        "depends_on_time": any(c.kind == "drive" for c in closures),
        "_coordinate_ranges": _ranges_of(source, plan),
        **{name: staticmethod(f) for name, f in functions.items()},
        **fields_of(source),
    }
    if turned == list(range(plan.n)):
        body["angle_coordinates"] = slice(0, None)
    body["__annotations__"] = dict.fromkeys((name for name, _ in source.defaults), Any)
    if body["depends_on_time"]:
        body |= {"conserves_energy": False, "why_not_conserved": "what a clock drives does work"}
    scene_class: Any = _Kind(source.key, (source.base or Mechanism,), body)
    _IN_USE[source] = scene_class
    return scene_class


__getattr__ = getattr_of(__name__)
