"""The contracts: what a scene gives and what a formulation may rely on.

Numbered, so that an error or a note can point at a rule.

1.  Units are SI. Everything public takes the time t (s), by default 0; of a scene's functions only
    `prepare` sees it. The velocity v is always q̇.
2.  n coordinates, r constraints, p = n - r generalized speeds.
3.  `Terms`: M v̇ = Q - B + aᵀλ, the constraints a v + b = 0 and their rate a v̇ = -gamma, where
    gamma = ȧ v + ḃ. F = Q - B. Q and B stay apart so that a failure names the term.
4.  `Speeds`: v = W u + offset and v̇ = W u̇ + rest, rest = Ẇ u + d(offset)/dt, hence
    a W = 0 and a rest + gamma = 0.
5.  `Bodies`: what Eq. (23) sums over. Components in which all partial velocities vanish may be
    left out: the snake has d = e = 1, a scene in space has 3.
6.  An absent term is `None`, never an array of zeros: no constraint, no b, no spring, no
    gyroscopic part. Functions test `None` on their own arguments only.
7.  The functions of a scene are written once, for every kind of number (`@generic`). What is not
    rational (sines, cosines, distances, what a clock drives) is prepared before by `prepare`,
    which alone is handed an arithmetic, and handed in.
8.  `velocities`, `energies` and `constraint` are a second derivation, written from positions and
    velocities directly and never from M or a. Engines differentiate them.
9.  A scene knows nothing of formulations, engines or checks.
10. A scene whose bodies form a chain may say so by a `Chain`: body k moves with two quasi-
    velocities, read off from any v, in which its mass is diagonal, and two equations tie it to
    body k-1. x lists them body by body.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import wraps
from inspect import get_annotations, isfunction
from numbers import Integral
from types import ModuleType
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.calls import calling, is_ours
from eomcheck.deprecated import old_attributes, take_old_attributes
from eomcheck.errors import InputError, safe_repr
from eomcheck.mechanics.derived_functions import derive_missing
from eomcheck.mechanics.random_source import Choices, Factors
from eomcheck.mechanics.records import Range, Symmetry
from eomcheck.mechanics.sketch import Sketch
from eomcheck.mechanics.tree import Tree
from eomcheck.numbers.generic import Arithmetic, Array, generic

Functions = Mapping[str, Any] | tuple[ModuleType, ...]


@generic
def no_velocity_term(parameters, prepared, q, v):
    """Return what a scene has not that depends on v: drift, forces or constraints."""
    return


@generic
def no_potential(parameters, prepared, q):
    """Return the potential energy of a scene that has none."""
    return


@old_attributes
class Scene(ABC):
    """A mechanical system: parameters that check themselves, and its equations (rules 1-10).

    The equations are generic functions held as static attributes; `functions=globals()` behind the
    base class takes those of these names from the module. All take first `parameters`, a NamedTuple
    made by `parameters(arithmetic)` whose fields `mass` (n_b,) and `inertia` (n_b, e, e), or
    (n_b,) in the plane, belong to the bodies that `velocities` lists, and `prepared`, which the
    first of them makes. These are what a scene has to write, those it has:

    - `prepare(arithmetic, parameters, q, t)`: what is not rational in q and t, by the methods
      `angles` and `root` of the arithmetic; by default the `Angles` of `angle_coordinates`, or
      None where there are none
    - `jacobians(parameters, prepared, q, v) -> Jacobians`: how the bodies move with v
    - `constraints(parameters, prepared, q) -> (a, b)` and
      `drift(parameters, prepared, q, v) -> gamma`
    - `forces(parameters, prepared, q, v) -> Q (n,)` or None
    - `velocities(parameters, prepared, q, v) -> (V (n_b, d), omega (n_b, e))`
    - `potential(parameters, prepared, q) -> U`, J, or None
    - `constraint(parameters, prepared, q, v) -> c (r,)` or None

    The others follow, see `eomcheck.mechanics.derived_functions`; `derived_functions` tells which.
    A scene that knows a shorter way writes it itself. In Lagrange's terms, and then `jacobians`,
    `drift` and `forces` may be left out where the speeds are written too:

    - `terms(parameters, prepared, q, v) -> Terms`

    Natural generalized speeds, all of them:

    - `kinematics(parameters, prepared, q, u)`: whatever `speeds` and `bodies` share
    - `speeds(parameters, prepared, kinematics) -> Speeds`
    - `bodies(parameters, prepared, kinematics) -> Bodies`
    - `speeds_of(parameters, prepared, q, v) -> u`
    - `qdot(parameters, prepared, kinematics) -> W u + offset` without forming W; None, and no
      function, where there is no such shorter way

    In the second derivation:

    - `energies(parameters, prepared, q, v) -> (T, U or None)`, J
    - `dissipation(parameters, prepared, q, v) -> R` or None, W: half the power that dampers take,
      -∂R/∂v being their part of Q; None, and no function, where there are none. A scene that gives
      it loses energy in no other way, unless a clock drives its constraints
    - `positions(parameters, prepared, q) -> (n_b, d)`: where the centres of mass are, in fixed
      directions; V of `velocities` is held against it. None, and no function, where nobody said
    - `position_residual(parameters, prepared, q) -> (h,)`, of which `constraint`, or those of its
      rows that `holonomic` tells, are the rate; None, and no function, where none is holonomic

    A chain has these as well, any other scene leaves them out:

    - `quasi_velocities(parameters, prepared, q, v) -> x (s,)`
    - `chain(parameters, prepared, q, x) -> Chain`
    - `chain_velocity(parameters, prepared, q, x) -> v (n,)`: the consistent v that has this x
    - `chain_acceleration(parameters, prepared, x, xdot) -> v̇ (n,)`
    - `chain_multipliers(parameters, prepared, chain, x, forces) -> λ (r,)`: the multipliers of
      `terms` from the joint forces ρ (n_b-1, 2)
    """

    key: ClassVar[str]
    conserves_energy: bool
    """Whether T + U keeps its value; one scene may lose what others of its kind conserve."""
    why_not_conserved: str = ""
    """What changes the energy where it is not conserved."""
    usually_absent: ClassVar[frozenset[str]] = frozenset()
    """Terms that are absent unless asked for."""
    depends_on_time: ClassVar[bool] = False
    """Whether anything in it depends on t."""
    derived_functions: ClassVar[frozenset[str]] = frozenset()
    """Names of the functions that the scene does not write but are made of those it does."""
    has_links: ClassVar[bool] = False
    """Whether scenes of this kind have a number of links to choose."""
    most_links: ClassVar[int | None] = None
    """The largest number of links; None where any will do."""
    holonomic: ClassVar[slice] = slice(None)
    """Which constraints are rates of `position_residual`, where there is one."""
    angle_coordinates: ClassVar[slice] = slice(0, 0)
    """Which coordinates are angles."""
    named_coordinates: ClassVar[tuple[str, ...]] = ()
    """Names of the coordinates where all scenes of the kind have the same."""
    coordinate_sample_ranges: ClassVar[tuple[Range, ...] | None] = None
    """What they are drawn from, see `coordinate_ranges`."""
    display_pose: ClassVar[tuple[float, ...]] = ()
    """Pose q (n,) that a picture of the kind shows; empty for the initial one."""
    named_constraints: ClassVar[tuple[str, ...]] = ()
    """Names of the constraints where all scenes of the kind have the same."""

    prepare: ClassVar[Callable[..., Any]]
    jacobians: ClassVar[Callable[..., Any]]
    constraints: ClassVar[Callable[..., Any]]
    drift: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)
    forces: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)
    velocities: ClassVar[Callable[..., Any]]
    potential: ClassVar[Callable[..., Any]] = staticmethod(no_potential)
    constraint: ClassVar[Callable[..., Any]] = staticmethod(no_velocity_term)

    assemble: ClassVar[Callable[..., Any]]
    """`terms` of Jacobians that are known."""
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

    def __init_subclass__(cls, functions: Functions = (), **options):
        """Take the functions of the scene from where they are written, by their names.

        All functions written there are generic from then on, those that they call included.

        Args:
            functions: a namespace, such as `globals()`, or modules; other names in it do not count,
                and what the body of the class gives itself stays.
            options: for other classes that it derives from.
        """
        super().__init_subclass__(**options)
        take_old_attributes(cls, Scene)
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

    @property
    def natural_speeds(self) -> bool:
        """Whether the generalized speeds are a choice of the scene's own.

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
        """Number of generalized speeds; none where there are more constraints than coordinates."""
        return max(self.n - self.r, 0)

    @property
    def s(self) -> int:
        """Number of quasi-velocities of its `Chain`, 0 where it is no chain."""
        return 0

    @property
    def support(self) -> Array | None:
        """Which generalized speeds can move each of its `Bodies`, bool (n_b, p).

        Partial velocities of the others vanish in every state. None where all may move all.
        """
        return None

    @property
    def name(self) -> str:
        """What reports call this scene, by default its key."""
        return self.key

    @property
    def structure(self) -> str:
        """The name, what is absent, and what is there that usually is absent.

        That decides which functions run, apart from numbers.
        """
        said = [self.name]
        for name, value in vars(self).items():
            if (value is None) != (name in self.usually_absent):
                said.append(f"no {name}" if value is None else f"with {name}")
        return ", ".join(said)

    @classmethod
    def structures(cls, links: int | None = None) -> Iterator[Scene]:
        """Yield one scene for each choice of terms that can be absent.

        Args:
            links: number of links, for a kind of scene that has one.

        Raises:
            InputError: a scene of this kind has no such number of links.
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
        """Return the scene of this kind that is looked at first."""
        return next(cls.structures(3 if cls.has_links else None))

    @classmethod
    def ranges(cls, links: int | None = None) -> dict[str, Range]:
        """Return what ordinary scenes of this kind are drawn from, by name of argument.

        Arguments that are not named keep their defaults.

        Args:
            links: number of links, for a kind of scene that has one.
        """
        return {}

    @classmethod
    def topologies(cls, links: int | None = None) -> Sequence[Factors]:
        """Return in which ways scenes of this kind hang together, where that is drawn too.

        Each entry names properties and, of each, the ways that go with all others of the entry.

        Args:
            links: number of links, for a kind of scene that has one.
        """
        return ({},)

    @classmethod
    def of_topology(
        cls, links: int | None, levels: Mapping[str, str], choices: Choices
    ) -> type[Scene]:
        """Return a kind of scenes that hang together in these ways; itself where there is one.

        Args:
            links: number of links, for a kind of scene that has one.
            levels: one of each property in an entry of `topologies`; other names do not count.
            choices: what chooses all else.

        Raises:
            RefusedError: what was chosen does not fit together.
        """
        return cls

    @property
    def topology(self) -> dict[str, str]:
        """The ways in which it hangs together, as it is; see `topologies`."""
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
        """Return what each coordinate of ordinary states is drawn from.

        None for up to 10 m from the origin and all angles. Where there is a `position_residual`,
        what is drawn is where the search for a closed position starts.
        """
        return self.coordinate_sample_ranges

    @abstractmethod
    def parameters(self, arithmetic: Arithmetic) -> NamedTuple:
        """Return the parameters in the numbers of `arithmetic`."""

    @abstractmethod
    def initial_state(self) -> tuple[Array, Array]:
        """Return a consistent (q, v) to start from."""

    def refuse_speeds(self, q: Array) -> None:
        """Raise `RefusedError` if the natural generalized speeds do not exist at q (n,)."""
        return

    def symmetries(self, q: Array, v: Array) -> Iterator[Symmetry]:
        """Yield the motions of the whole scene that must not change its dynamics."""
        yield from ()

    def tree(self) -> Tree | None:
        """Return the tree of bodies, or None where `Tree` cannot describe them."""
        return None

    @classmethod
    def sketched(cls, links: int | None = None) -> tuple[Scene, Array]:
        """Return the scene and the pose q (n,) that a picture of its kind shows.

        The pose need not be closed: the closed one next to it is drawn.

        Args:
            links: number of links, for a kind of scene that has one.
        """
        scene = cls.example() if links is None else next(cls.structures(links))
        return scene, np.array(cls.display_pose) if cls.display_pose else scene.initial_state()[0]

    def sketch(self, q: Array, t: float = 0.0) -> Sketch | None:
        """Return what a picture of it in the pose q (n,) is made of; None where nobody said."""
        return None

    def check_state(self, q, v, t: float = 0.0) -> tuple[Array, Array]:
        """Return q and v as doubles of shape (n,).

        Raises:
            InputError: wrong shape, not numbers, or not finite.
        """
        finite_array("t", t, ())
        return finite_array("q", q, (self.n,)), finite_array("v", v, (self.n,))


FUNCTIONS = {name for name, of in get_annotations(Scene).items() if "Callable[" in str(of)}
"""Names under which scenes hold functions."""


def _wrap_user_functions(kind: type[Scene]) -> None:
    """Have what the body of a user's scene gives called by `eomcheck.calls.call`."""
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
    """Return the function of a property or of a method that needs no object."""
    return getattr(value, "fget", None) or getattr(value, "__func__", value)


def checked_scene(scene: Any) -> Scene:
    """Return `scene`; raise `InputError` where it is none, or has no sensible number n."""
    if not isinstance(scene, Scene):
        raise InputError(f"scene = {safe_repr(scene)}, expected a scene such as Snake.paper()")
    n = scene.n
    if not isinstance(n, Integral) or not 0 <= n <= MAX_COORDINATES:
        what = f"{type(scene).__name__}.n = {safe_repr(n)}"
        raise InputError(f"{what}, expected a whole number from 0 to {MAX_COORDINATES}")
    return scene


MAX_COORDINATES = 20_000
"""Coordinates of a scene: a matrix of n x n doubles takes 3.2 GB."""


def finite_array(name: str, value, shape: tuple[int, ...]) -> Array:
    """Return `value` as a new array of doubles of `shape`.

    Raises:
        InputError: it cannot be read as such, or an entry is not finite.
    """
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "fiuO" or np.ma.is_masked(value):
            raise TypeError
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} = {safe_repr(value)} is not an array of real numbers") from None
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}, expected {shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        entry = f"{name}{list(where)}" if where else name
        raise InputError(f"{entry} = {array[where]}, expected a finite number")
    return array
