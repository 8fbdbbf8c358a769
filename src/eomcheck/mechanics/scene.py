"""The contracts between scenes and formulations: the functions of a scene and their rules.

The rules are numbered, so that an error or a note can point at one.

1.  Units are SI. Everything public takes the time t (s), by default 0; of a scene's functions only
    `prepare` sees it. The velocity v is always q̇.
2.  n coordinates, r constraints, p = n - r generalized speeds.
3.  `Terms`: M v̇ = Q - B + aᵀλ, the constraints a v + b = 0 and their rate a v̇ = -gamma, where
    gamma = ȧ v + ḃ. F = Q - B. Q and B stay apart so that a failure names the term.
4.  `Speeds`: v = W u + offset and v̇ = W u̇ + rest, rest = Ẇ u + d(offset)/dt, hence
    a W = 0 and a rest + gamma = 0.
5.  `Bodies`: the summands of Eq. (23). Components in which all partial velocities vanish may be
    left out: the snake has d = e = 1, a scene in space has 3.
6.  An absent term is `None`, never an array of zeros: no constraint, no b, no spring, no
    gyroscopic part. Functions test `None` on their own arguments only.
7.  The functions of a scene are written once, for every scalar type (`@generic`). Expressions that
    are not rational (sines, cosines, distances, clock-driven quantities) are precomputed by
    `prepare`, the only function that gets an arithmetic, and passed to the others as `prepared`.
8.  `velocities`, `energies` and `constraint` are a second derivation, written from positions and
    velocities directly and never from M or a. Engines differentiate them.
9.  A scene knows nothing of formulations, engines or checks.
10. A scene whose bodies form a chain may provide a `Chain`: body k moves with two quasi-
    velocities, computed from any v, in which its mass is diagonal, and two equations tie it to
    body k-1. x lists them body by body.

A scene is drawn by `Choices`: a NumPy generator or hypothesis.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, wraps
from inspect import get_annotations, isfunction
from numbers import Integral
from types import ModuleType
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from eomcheck.calls import calling, is_ours
from eomcheck.deprecated import old_attributes, take_old_attributes
from eomcheck.errors import InputError, safe_repr
from eomcheck.mechanics.derived_functions import derive_missing, no_velocity_term
from eomcheck.mechanics.records import JOINT_KINDS, Range, Symmetry, Tree, TreeFrame
from eomcheck.mechanics.sketch import Sketch
from eomcheck.numbers.generic import FLOAT64, Arithmetic, Array, generic

# ---- Choices -------------------------------------------------------------------------------------

T = TypeVar("T")

Factors = dict[str, tuple[str, ...]]
"""Property -> its possible levels: the factors of a pairwise design."""


class Choices(Protocol):
    """A source of choices; hypothesis shrinks towards the simplest, first options and 0."""

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of at least one option."""
        ...

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        ...

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        ...


class GeneratorChoices:
    """Choices by a NumPy generator, all options with the same probability.

    Args:
        random: the generator.
    """

    def __init__(self, random: np.random.Generator):
        self._random = random

    def one_of(self, among: Sequence[T]) -> T:
        """Return one of at least one option."""
        return among[int(self._random.integers(len(among)))]

    def whole(self, low: int, high: int) -> int:
        """Return a whole number in [low, high]."""
        return int(self._random.integers(low, high + 1))

    def number(self, low: float, high: float) -> float:
        """Return a number in [low, high]."""
        return float(self._random.uniform(low, high))


# ---- Scene ---------------------------------------------------------------------------------------

Functions = Mapping[str, Any] | tuple[ModuleType, ...]


@generic
def no_potential(parameters, prepared, q):
    """Return None, the potential energy of a scene without one."""
    return


@old_attributes
class Scene(ABC):
    """A mechanical system: parameters that check themselves, and its equations (rules 1-10).

    The equations are generic functions held as static attributes; `functions=globals()` behind the
    base class takes those of these names from the module. All take first `parameters`, a NamedTuple
    constructed by `parameters(arithmetic)` whose fields `mass` (n_b,) and `inertia` (n_b, e, e), or
    (n_b,) in the plane, belong to the bodies that `velocities` lists, and `prepared`, the result of
    the first of them. A scene has to write these, as far as it has them:

    - `prepare(arithmetic, parameters, q, t)`: expressions that are not rational in q and t, by the
      methods `angles` and `root` of the arithmetic; by default the `Angles` of `angle_coordinates`,
      or None where there are none
    - `jacobians(parameters, prepared, q, v) -> Jacobians`: body velocities as J v
    - `constraints(parameters, prepared, q) -> (a, b)` and
      `drift(parameters, prepared, q, v) -> gamma`
    - `forces(parameters, prepared, q, v) -> Q (n,)` or None
    - `velocities(parameters, prepared, q, v) -> (V (n_b, d), omega (n_b, e))`
    - `potential(parameters, prepared, q) -> U`, J, or None
    - `constraint(parameters, prepared, q, v) -> c (r,)` or None

    The others are derived, see `eomcheck.mechanics.derived_functions`; `derived_functions` names
    them. A scene with a shorter expression writes it itself. For Lagrange's terms (`jacobians`,
    `drift` and `forces` may then be left out if the speeds are written too):

    - `terms(parameters, prepared, q, v) -> Terms`

    Natural generalized speeds, all of them:

    - `kinematics(parameters, prepared, q, u)`: intermediate results of `speeds` and `bodies`
    - `speeds(parameters, prepared, kinematics) -> Speeds`
    - `bodies(parameters, prepared, kinematics) -> Bodies`
    - `speeds_of(parameters, prepared, q, v) -> u`
    - `qdot(parameters, prepared, kinematics) -> W u + offset` without forming W; None, and no
      function, where there is no such shorter way

    In the second derivation:

    - `energies(parameters, prepared, q, v) -> (T, U or None)`, J
    - `dissipation(parameters, prepared, q, v) -> R` or None, W: half the power that dampers take,
      -∂R/∂v being their part of Q; None, and no function, where there are none. A scene that has
      it loses energy in no other way, unless a clock drives its constraints
    - `positions(parameters, prepared, q) -> (n_b, d)`: the centres of mass, along fixed directions;
      V of `velocities` is compared with their rates. None, and no function, where not provided
    - `position_residual(parameters, prepared, q) -> (h,)`, whose rate is `constraint`, or the rows
      `holonomic` of it; None, and no function, where no constraint is holonomic

    A chain has these as well, any other scene leaves them out:

    - `quasi_velocities(parameters, prepared, q, v) -> x (s,)`
    - `chain(parameters, prepared, q, x) -> Chain`
    - `chain_velocity(parameters, prepared, q, x) -> v (n,)`: the consistent v that has this x
    - `chain_acceleration(parameters, prepared, x, xdot) -> v̇ (n,)`
    - `chain_multipliers(parameters, prepared, chain, x, forces) -> λ (r,)`: the multipliers of
      `terms` from the joint forces ρ (n_b-1, 2)
    - `chain_load(parameters, prepared, tau) -> (f (s,), λ (r,))`: the forces along x of generalized
      forces tau (n,), and the multipliers that balance the rest of them. None, and no function,
      where the chain takes no forces but its own
    """

    key: ClassVar[str]
    conserves_energy: bool
    """Whether T + U is constant; one scene may dissipate though others of its class conserve it."""
    why_not_conserved: str = ""
    """Reason why the energy is not conserved, "" if it is."""
    immutable: ClassVar[bool] = False
    """Whether the numbers of a scene cannot change, so that results of it may be cached."""
    usually_absent: ClassVar[frozenset[str]] = frozenset()
    """Names of terms that are absent by default."""
    depends_on_time: ClassVar[bool] = False
    """Whether any function depends on the time t."""
    derived_functions: ClassVar[frozenset[str]] = frozenset()
    """Names of the functions that are derived from those the scene writes."""
    has_links: ClassVar[bool] = False
    """Whether the number of links of this scene class can be chosen."""
    most_links: ClassVar[int | None] = None
    """The largest number of links; None if there is no limit."""
    holonomic: ClassVar[slice] = slice(None)
    """Constraints that are rates of `position_residual`, if it exists."""
    angle_coordinates: ClassVar[slice] = slice(0, 0)
    """Coordinates that are angles."""
    named_coordinates: ClassVar[tuple[str, ...]] = ()
    """Names of the coordinates, if all scenes of the class have the same."""
    coordinate_sample_ranges: ClassVar[tuple[Range, ...] | None] = None
    """Sampling ranges of the coordinates, see `coordinate_ranges`."""
    display_pose: ClassVar[tuple[float, ...]] = ()
    """Pose q (n,) in pictures of the class; empty for the initial one."""
    named_constraints: ClassVar[tuple[str, ...]] = ()
    """Names of the constraints, if all scenes of the class have the same."""

    prepare: ClassVar[Callable[..., Any]]
    jacobians: ClassVar[Callable[..., Any]]
    constraints: ClassVar[Callable[..., Any]]
    drift: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)
    forces: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)
    velocities: ClassVar[Callable[..., Any]]
    potential: ClassVar[Callable[..., Any]] = staticmethod(no_potential)
    constraint: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)

    assemble: ClassVar[Callable[..., Any]]
    """`terms` from known Jacobians."""
    terms: ClassVar[Callable[..., Any]]
    kinematics: ClassVar[Callable[..., Any]]
    speeds: ClassVar[Callable[..., Any]]
    bodies: ClassVar[Callable[..., Any]]
    speeds_of: ClassVar[Callable[..., Any]]
    qdot: ClassVar[Callable[..., Any] | None] = None
    energies: ClassVar[Callable[..., Any]]
    dissipation: ClassVar[Callable[..., Any] | None] = None
    positions: ClassVar[Callable[..., Any] | None] = None
    position_residual: ClassVar[Callable[..., Any] | None] = None
    quasi_velocities: ClassVar[Callable[..., Any]]
    chain: ClassVar[Callable[..., Any]]
    chain_velocity: ClassVar[Callable[..., Any]]
    chain_acceleration: ClassVar[Callable[..., Any]]
    chain_multipliers: ClassVar[Callable[..., Any]]
    chain_load: ClassVar[Callable[..., Any] | None] = None

    def __init_subclass__(cls, functions: Functions = (), **options):
        """Take the functions of the scene by their names from the namespaces that define them.

        All functions written there are generic from then on, those that they call included.

        Args:
            functions: a namespace, such as `globals()`, or modules; other names in it do not count,
                and functions in the class body have priority.
            options: for other base classes.
        """
        super().__init_subclass__(**options)
        take_old_attributes(cls, Scene)
        # A namespace, because functions of a scene call each other by plain names and are tested
        # singly. As static methods each would be a line longer, and called as `Snake.terms`.
        spaces = [functions] if isinstance(functions, Mapping) else [vars(x) for x in functions]
        for space in spaces:
            written = {name: x for name, x in space.items() if isfunction(x)}
            for name, function in written.items():
                if function.__module__ == space.get("__name__"):
                    generic(function)
                if name in FUNCTIONS and name not in vars(cls):
                    setattr(cls, name, staticmethod(function))
        if not is_ours(cls):
            _wrap_user_functions(cls)
        derive_missing(cls)

    @classmethod
    def offers(cls, function: str) -> bool:
        """Return whether its scenes have a function, which some scenes leave out, by its name."""
        return hasattr(cls, function)

    @property
    def natural_speeds(self) -> bool:
        """Whether the scene has its own choice of generalized speeds.

        If they are a partition of the velocities, the modified Lagrange method is the embedding
        method by another name, and its agreement is no separate evidence.
        """
        return "kinematics" not in self.derived_functions

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(self.coordinate_names)

    @property
    def r(self) -> int:
        """Number of constraints."""
        return len(self.constraint_names)

    @property
    def p(self) -> int:
        """Number of generalized speeds; 0 if there are more constraints than coordinates."""
        return max(self.n - self.r, 0)

    @property
    def s(self) -> int:
        """Number of quasi-velocities of its `Chain`; 0 if it is no chain."""
        return 0

    @property
    def support(self) -> Array | None:
        """Mask of the generalized speeds that can move each of its `Bodies`, bool (n_b, p).

        Partial velocities of the others vanish in every state. None if all may move all.
        """
        return None

    @property
    def name(self) -> str:
        """Name of this scene in reports, by default its key."""
        return self.key

    @property
    def structure(self) -> str:
        """Structural variant: the name, the absent terms, and the usually absent terms it has.

        It determines which functions run, apart from numbers.
        """
        parts = [self.name]
        for name, value in vars(self).items():
            if (value is None) != (name in self.usually_absent):
                parts.append(f"no {name}" if value is None else f"with {name}")
        return ", ".join(parts)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield one scene for each structural variant, a choice of terms that can be absent.

        Args:
            links: number of links, for a scene class that has one.

        Raises:
            InputError: a scene of this class has no such number of links.
        """
        if links is not None:
            raise InputError(f"links = {links!r}: {cls.key} has no number of links to choose")
        try:
            yield cls()
        except TypeError as error:
            raise InputError(
                f"{cls.__name__} has no defaults for all its arguments: {error}"
            ) from None

    @classmethod
    def example(cls) -> Scene:
        """Return the scene of this class that is checked first."""
        return next(cls.structures(3 if cls.has_links else None))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return the sampling ranges of ordinary scenes of this class, by name of argument.

        Arguments that are not named keep their defaults.

        Args:
            links: number of links, for a scene class that has one.
        """
        return {}

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return the possible topologies of this class, if the topology is sampled too.

        Each entry maps properties to their levels, all of which can be combined within the entry.

        Args:
            links: number of links, for a scene class that has one.
        """
        return ({},)

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Scene]:
        """Return the scene class with this topology; the class itself if there is only one.

        Args:
            links: number of links, for a scene class that has one.
            levels: one level of each property in an entry of `topologies`; other names are
                ignored.
            choices: the source of all other choices.

        Raises:
            RefusedError: the choices do not fit together.
        """
        return cls

    @property
    def topology(self) -> dict[str, str]:
        """Levels of this scene's topology; see `topologies`."""
        return {}

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the n coordinates, for naming rows."""
        return self.named_coordinates

    @property
    def constraint_names(self) -> tuple[str, ...]:
        """Names of the r constraints, for naming rows."""
        return self.named_constraints

    def coordinate_ranges(self) -> tuple[Range, ...] | None:
        """Return the sampling range of each coordinate of ordinary states.

        None for up to 10 m from the origin and all angles. Where there is a `position_residual`,
        the sampled pose is the initial guess of the search for an assembled one.
        """
        take_old_attributes(type(self), Scene)
        return self.coordinate_sample_ranges

    @abstractmethod
    def parameters(self, arithmetic: Arithmetic) -> NamedTuple:
        """Return the parameters in the numbers of `arithmetic`."""

    def cached(self, function: Callable[[Any], T]) -> T:
        """Return function(self), computed once if the scene is `immutable`."""
        if not self.immutable:
            return function(self)
        if function not in self._results:
            self._results[function] = function(self)
        return self._results[function]

    @cached_property
    def _results(self) -> dict[Callable[[Any], Any], Any]:
        return {}

    @property
    def float64_parameters(self) -> NamedTuple:
        """The parameters in float64, see `cached`: descriptions are cached by their identity."""
        return self.cached(_float64_parameters)

    @abstractmethod
    def initial_state(self) -> tuple[Array, Array]:
        """Return a consistent initial state (q (n,), v (n,))."""

    def refuse_speeds(self, q: Array) -> None:
        """Raise `RefusedError` if the natural generalized speeds do not exist at q (n,)."""
        return

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield motions of the whole scene that must not change its dynamics."""
        yield from ()

    def tree(self, parameters: Any = None) -> Tree | None:
        """Return the tree of bodies, or None where `Tree` cannot describe them.

        Args:
            parameters: the parameters of the scene in any scalar type, in whose numbers masses,
                lengths and moments of inertia are; by default float64. A scene may do without this
                argument: proofs about its tree then have variables in place of its numbers.
        """
        return None

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Scene, Array]:
        """Return the scene and the pose q (n,) for a picture of its class.

        The pose need not be assembled: the nearest assembled one is drawn.

        Args:
            links: number of links, for a scene class that has one.
        """
        take_old_attributes(cls, Scene)
        scene = cls.example() if links is None else next(cls.structures(links))
        return scene, np.array(cls.display_pose) if cls.display_pose else scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> Sketch | None:
        """Return the sketch of the scene in the pose q (n,); None if it defines none."""
        return None

    def check_state(self, q, v, t: float = 0.0) -> tuple[Array, Array]:
        """Return q and v as float64 of shape (n,).

        Raises:
            InputError: wrong shape, not numbers, or not finite.
        """
        finite_array("t", t, ())
        return finite_array("q", q, (self.n,)), finite_array("v", v, (self.n,))


FUNCTIONS = {name for name, hint in get_annotations(Scene).items() if "Callable[" in str(hint)}
"""Names of the functions that scenes may have."""


def _wrap_user_functions(kind: type[Scene]) -> None:
    """Wrap functions and properties of a user's scene class in `eomcheck.calls.call`."""
    for name, value in list(vars(kind).items()):
        word = f"{kind.__name__}.{name}"
        if isinstance(value, property) and value.fget is not None:
            guarded = property(calling(word, value.fget), value.fset, value.fdel)
        elif isinstance(value, staticmethod | classmethod) and isfunction(value.__func__):
            guarded = type(value)(calling(word, value.__func__))
        elif isfunction(value):
            guarded = calling(word, value)
            if name == "initial_state":
                guarded = _pair(word, guarded)
            elif name == "tree":
                guarded = checking_tree(word, guarded)
        else:
            continue
        if not is_ours(_inner(value)):
            setattr(kind, name, guarded)


def _pair(word: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap an `initial_state`: InputError where it returns no pair (q, v)."""

    @wraps(function)
    def checked(*arguments: Any, **options: Any) -> Any:
        state = function(*arguments, **options)
        if not isinstance(state, tuple | list) or len(state) != 2:
            raise InputError(f"{word} returned {safe_repr(state)}, expected (q, v)")
        return state

    return checked


def _inner(value: Any) -> Any:
    """Return the underlying function of a property, static method or class method."""
    return getattr(value, "fget", None) or getattr(value, "__func__", value)


def _float64_parameters(scene: Scene) -> NamedTuple:
    return scene.parameters(FLOAT64)


def once_per_structure(function: Callable[[Scene], T]) -> Callable[[Scene], T]:
    """Return a function of a scene whose results are cached, for each scene class and structure.

    A result of None is not cached. The results of a class are dropped with it.
    """
    cache: WeakKeyDictionary[type[Scene], dict[str, T]] = WeakKeyDictionary()

    @wraps(function)
    def computed(scene: Scene) -> T:
        results, structure = cache.setdefault(type(scene), {}), scene.structure
        if results.get(structure) is None:
            results[structure] = function(scene)
        return results[structure]

    return computed


def checked_scene(scene: Any) -> Scene:
    """Return `scene` if it is a scene with a valid n.

    Raises:
        InputError: it is no scene, or n is no whole number from 0 to `MAX_COORDINATES`.
    """
    if not isinstance(scene, Scene):
        raise InputError(f"scene = {safe_repr(scene)}, expected a scene such as Snake.paper()")
    n = scene.n
    if not isinstance(n, Integral) or not 0 <= n <= MAX_COORDINATES:
        what = f"{type(scene).__name__}.n = {safe_repr(n)}"
        raise InputError(f"{what}, expected a whole number from 0 to {MAX_COORDINATES}")
    return scene


MAX_COORDINATES = 20_000
"""Largest number of coordinates of a scene: a matrix (n, n) of float64 takes 3.2 GB."""


def finite_array(name: str, value, shape: tuple[int, ...]) -> Array:
    """Return `value` as a new float64 array of `shape`.

    Raises:
        InputError: it is no such array of real numbers, or an entry is not finite.
    """
    try:
        array_like = np.asarray(value)
        if array_like.dtype.kind not in "fiuO" or np.ma.is_masked(value):
            raise TypeError
        array = np.array(array_like, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} = {safe_repr(value)} is not an array of real numbers") from None
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        entry = f"{name}{list(where)}" if where else name
        raise InputError(f"{entry} = {array[where]}, expected a finite number")
    return array


# ---- Checks of trees of bodies -------------------------------------------------------------------

NEAR_ROTATION = float(np.sqrt(np.finfo(np.float32).eps))
"""Largest entry of RᵀR - 1 of a rotation, which may have been rounded to half a float32."""


def check_tree(name: str, tree: Any, n: int) -> None:
    """Check a tree of bodies of a scene with n coordinates.

    Args:
        name: its name in messages, such as "Crane.tree()".
        tree: the tree.
        n: number of coordinates of the scene.

    Raises:
        InputError: it is no `Tree`, or a field of it is malformed.
    """
    if not isinstance(tree, Tree):
        raise InputError(f"{name} = {safe_repr(tree)}, expected a Tree or None")
    joints = len(tree.joint)
    shapes = {
        "rotation": (joints, 3, 3),
        "offset": (joints, 3),
        "mass": (joints,),
        "center": (joints, 3),
        "inertia": (joints, 3, 3),
        "coordinates": (joints, n),
        "shift": (joints,),
        "armature": (joints,),
        "gravity": (3,),
        **({"gimbal_armature": (joints,)} if len(tree.gimbal_armature) else {}),
    }
    arrays = {x: finite_array(f"{name}.{x}", getattr(tree, x), shapes[x]) for x in shapes}
    for j, kind in enumerate(tree.joint):
        if kind not in JOINT_KINDS:
            known = ", ".join(JOINT_KINDS)
            raise InputError(f"{name}.joint[{j}] = {safe_repr(kind)}, expected one of {known}")
    _check_parents(name, tree.parent, joints)
    for j, R in enumerate(arrays["rotation"]):
        _check_rotation(f"{name}.rotation[{j}]", R)
    for j in np.flatnonzero(arrays.get("gimbal_armature", ())):
        turns = tuple(tree.joint[max(j - 2, 0) : j + 1])
        if turns != ("rz", "ry", "rx"):
            kinds = f"ends the turns {safe_repr(turns)}, expected ('rz', 'ry', 'rx')"
            raise InputError(f"{name}.gimbal_armature[{j}] {kinds}")
    if tree.names and len(tree.names) != joints:
        raise InputError(f"{name}.names has {len(tree.names)} names, expected {joints}")
    _check_names(f"{name}.names", tree.names)
    for i, link in enumerate(tree.links):
        where = f"{name}.links[{i}]"
        if not isinstance(link, TreeFrame):
            raise InputError(f"{where} = {safe_repr(link)}, expected a TreeFrame")
        if not isinstance(link.joint, Integral) or not -1 <= link.joint < joints:
            allowed = f"expected a joint from 0 to {joints - 1}, or -1 for the ground"
            raise InputError(f"{where}.joint = {safe_repr(link.joint)}, {allowed}")
        finite_array(f"{where}.p", link.p, (3,))
        _check_rotation(f"{where}.R", finite_array(f"{where}.R", link.R, (3, 3)))
    _check_names(f"{name}.links", [link.name for link in tree.links])


def _check_parents(name: str, parents: Sequence[Any], joints: int) -> None:
    """Check that the parents (n_j,) are those of joints in depth-first order."""
    if len(parents) != joints:
        raise InputError(f"{name}.parent has {len(parents)} entries, expected {joints}")
    path = [-1]
    for j, parent in enumerate(parents):
        if parent not in path:
            allowed = ", ".join(map(str, path))
            message = f"{name}.parent[{j}] = {safe_repr(parent)}, expected one of {allowed}"
            raise InputError(f"{message}: joints are in depth-first order")
        path = [*path[: path.index(parent) + 1], j]


def _check_rotation(name: str, R: Array) -> None:
    """Check that R (3, 3) is a rotation: RᵀR = 1, and not a reflection."""
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > NEAR_ROTATION:
        raise InputError(f"{name} is no rotation: |RᵀR - 1| = {error:.3g}, expected 0")
    if np.linalg.det(R) < 0:
        raise InputError(f"{name} is no rotation but a reflection: det R = -1, expected 1")


def _check_names(name: str, names: Sequence[Any]) -> None:
    """Check that names are strings, each there once."""
    for i, x in enumerate(names):
        if not isinstance(x, str) or not x:
            raise InputError(f"{name}[{i}]: name = {safe_repr(x)}, expected a string")
    for x, count in Counter(names).items():
        if count > 1:
            raise InputError(f"{name}: the name {x!r} is there {count} times, expected once")


def checking_tree(word: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a `Scene.tree`: InputError where it returns no valid tree in float64.

    Trees by parameters of another scalar type are not checked.
    """

    @wraps(function)
    def checked(scene: Any, *arguments: Any, **options: Any) -> Any:
        tree = function(scene, *arguments, **options)
        if tree is not None and not arguments and not options:
            check_tree(f"{word}()", tree, scene.n)
        return tree

    return checked
