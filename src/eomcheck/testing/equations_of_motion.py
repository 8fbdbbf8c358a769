"""Equations of motion under test: user-supplied float64 functions, and checked calls of them.

    M q̈ + bias + gravity + ∂R/∂v = Q + aᵀλ,    a v + b = 0,    a q̈ + γ = 0

`EquationsOfMotion` holds the functions. One that is not given stands for a term that is zero.
Velocities v are q̇, unless `qdot` returns q̇; v then are generalized speeds u, and forces are those
along u. `FunctionCaller` calls the functions with copies of their arguments and checks type, shape
and finiteness of each result; a failure is raised with the name of its function (`BrokenError`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from functools import cached_property
from inspect import Parameter, signature
from math import isfinite
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.calls import call
from eomcheck.claims.reproducer import functions_reproducer
from eomcheck.engines import EngineFault
from eomcheck.errors import (
    CallError,
    InputError,
    UnknownNameError,
    described_error,
    safe_repr,
    whole_number,
)
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import finite_array
from eomcheck.numbers.generic import Array

Function = Callable[..., Any]


class Input(NamedTuple):
    """Signature of one of the functions.

    Attributes:
        reads: its arguments, one letter each: q, v, t, a for v̇ and f for forces τ; see also
            `MAY_READ_MORE`. "" stands for a constant: a function, or the numbers themselves.
        shape: shape of its result, in terms of n coordinates, p velocities, r constraints, k
            parameters of a regressor, f frames, and numbers. A function of frames is called for
            each frame, and may be a dict, name of the frame -> function.
        what: description of it in messages, such as "mass matrix".
    """

    reads: str
    shape: tuple[str, ...]
    what: str


INPUTS: dict[str, Input] = {
    "M": Input("q", ("p", "p"), "mass matrix"),
    "bias": Input("qv", ("p",), "bias"),
    "gravity": Input("q", ("p",), "gravity"),
    "C": Input("qv", ("p", "p"), "Coriolis matrix"),
    "qdd": Input("qv", ("p",), "acceleration"),
    "T": Input("qv", (), "kinetic energy"),
    "U": Input("q", (), "potential energy"),
    "R": Input("qv", (), "dissipation function"),
    "Q": Input("qv", ("p",), "generalized forces"),
    "a": Input("q", ("r", "p"), "constraint Jacobian"),
    "b": Input("t", ("r",), "constraint velocity"),
    "c": Input("q", ("r",), "constraint"),
    "gamma": Input("qv", ("r",), "constraint drift"),
    "qdot": Input("qv", ("n",), "rates of the coordinates"),
    "inverse_dynamics": Input("qva", ("p",), "inverse dynamics"),
    "tau_q": Input("qva", ("p", "p"), "derivative ∂τ/∂q"),
    "tau_v": Input("qva", ("p", "p"), "derivative ∂τ/∂v"),
    "qdd_q": Input("qv", ("p", "p"), "derivative ∂q̈/∂q"),
    "qdd_v": Input("qv", ("p", "p"), "derivative ∂q̈/∂v"),
    "qdd_tau": Input("qv", ("p", "p"), "derivative ∂q̈/∂τ"),
    "inverse_mass_matrix": Input("q", ("p", "p"), "inverse mass matrix"),
    "regressor": Input("qva", ("p", "k"), "regressor"),
    "parameters": Input("", ("k",), "inertial parameters"),
    "mass": Input("", (), "total mass"),
    "com": Input("q", ("3",), "center of mass"),
    "com_jacobian": Input("q", ("3", "p"), "Jacobian of the center of mass"),
    "com_velocity": Input("qv", ("3",), "velocity of the center of mass"),
    "com_acceleration": Input("qva", ("3",), "acceleration of the center of mass"),
    "momentum_matrix": Input("q", ("6", "p"), "momentum matrix"),
    "momentum": Input("qv", ("6",), "momentum"),
    "momentum_rate": Input("qva", ("6",), "rate of the momentum"),
    "frame_placement": Input("q", ("f", "3", "4"), "frame placement"),
    "J": Input("q", ("f", "6", "p"), "frame Jacobian"),
    "frame_velocity": Input("qv", ("f", "6"), "frame velocity"),
    "frame_bias": Input("qv", ("f", "6"), "frame bias"),
    "frame_acceleration": Input("qva", ("f", "6"), "frame acceleration"),
}
"""Name -> signature of the function of that name."""

MOST_COORDINATES = 10_000
"""Largest number of coordinates: a mass matrix then takes 800 MB."""

MOST_STATES = 1_000_000
"""Largest number of states that may be drawn in one call."""

MAY_READ_MORE = {"b": "qt", "c": "qv", "gravity": "qv", "qdd": "qvf"} | dict.fromkeys(
    ("qdd_q", "qdd_v", "qdd_tau"), "qvf"
)
"""Name -> arguments of a function if it has as many positional arguments without default."""


@dataclass(frozen=True, eq=False, repr=False)
class EquationsOfMotion:
    """User-supplied equations of motion as float64 functions, black boxes.

    Each is called with float64 arrays of its own, of shape (n,) or (p,), and returns an array of
    NumPy, or one that NumPy can convert. A vector may be a column (p, 1), a number an array of one.
    """

    instead: ClassVar[str] = (
        "functions are checked by `eomcheck fuzz --scene {0}`, and in Python by "
        "eomcheck.check({0!r})"
    )
    """Advice in errors where a scene is expected; {0} stands for FILE:NAME."""
    n: int
    """Number of coordinates."""
    M: Function | None = None
    """M(q) -> mass matrix (p, p)."""
    bias: Function | None = None
    """bias(q, v) -> B (p,), Coriolis and centrifugal, on the left-hand side, without gravity."""
    gravity: Function | None = None
    """gravity(q) -> ∂U/∂q (p,), on the left-hand side; or gravity(q, v), with both arguments."""
    C: Function | None = None
    """C(q, v) -> Coriolis matrix (p, p), C v = B and Ṁ - 2 C skew-symmetric."""
    qdd: Function | None = None
    """qdd(q, v) -> acceleration (p,), with everything in it; or qdd(q, v, tau), with forces τ (p,)
    beside all others."""
    T: Function | None = None
    """T(q, v) -> kinetic energy, J."""
    U: Function | None = None
    """U(q) -> potential energy, J."""
    R: Function | None = None
    """R(q, v) -> half the power that dampers take, W."""
    Q: Function | None = None
    """Q(q, v) -> generalized forces (p,) beside gravity and damping, on the right-hand side."""
    a: Function | None = None
    """a(q) -> constraint Jacobian (r, p)."""
    b: Function | None = None
    """b(t), or b(q, t) -> constraint velocity (r,), a v + b = 0; checked around t = 0 s."""
    c: Function | None = None
    """c(q) -> loop-closure residual (r,), 0 where loops are closed, a = ∂c/∂q; or, with two
    arguments, c(q, v) -> slip velocity (r,), 0 where nothing slips, a = ∂c/∂v and c = a v + b."""
    gamma: Function | None = None
    """gamma(q, v) -> ȧ v + ḃ (r,)."""
    qdot: Function | None = None
    """qdot(q, u) -> q̇ (n,), where velocities are generalized speeds u; linear in u."""
    inverse_dynamics: Function | None = None
    """inverse_dynamics(q, v, vdot) -> τ (p,) = M v̇ + B + gravity + ∂R/∂v - Q."""
    tau_q: Function | None = None
    """tau_q(q, v, vdot) -> ∂τ/∂q (p, p), with `qdot` along the velocities, ∂τ/∂q · ∂q̇/∂u."""
    tau_v: Function | None = None
    """tau_v(q, v, vdot) -> ∂τ/∂v (p, p)."""
    qdd_q: Function | None = None
    """qdd_q(q, v, tau) -> ∂q̈/∂q (p, p), with `qdot` along the velocities; or qdd_q(q, v)."""
    qdd_v: Function | None = None
    """qdd_v(q, v, tau) -> ∂q̈/∂v (p, p); or qdd_v(q, v)."""
    qdd_tau: Function | None = None
    """qdd_tau(q, v, tau) -> ∂q̈/∂τ (p, p), M⁻¹ where there are no constraints; or qdd_tau(q, v)."""
    inverse_mass_matrix: Function | None = None
    """inverse_mass_matrix(q) -> M⁻¹ (p, p)."""
    regressor: Function | None = None
    """regressor(q, v, vdot) -> Y (p, k) with Y π = M v̇ + B + gravity; k = 10 numbers a body."""
    parameters: Any = None
    """Inertial parameters π (k,), or a function without arguments: of each body its mass m, m c and
    the moments of inertia xx xy xz yy yz zz about the origin of its frame."""
    mass: Any = None
    """Mass of all bodies, kg, or a function without arguments."""
    com: Function | None = None
    """com(q) -> center of mass (3,), m."""
    com_jacobian: Function | None = None
    """com_jacobian(q) -> Jacobian of the center of mass (3, p)."""
    com_velocity: Function | None = None
    """com_velocity(q, v) -> velocity of the center of mass (3,)."""
    com_acceleration: Function | None = None
    """com_acceleration(q, v, vdot) -> acceleration of the center of mass (3,)."""
    momentum_matrix: Function | None = None
    """momentum_matrix(q) -> A (6, p): linear momentum, then angular about the center of mass."""
    momentum: Function | None = None
    """momentum(q, v) -> A v (6,)."""
    momentum_rate: Function | None = None
    """momentum_rate(q, v, vdot) -> A v̇ + Ȧ v (6,)."""
    frame_placement: Any = None
    """frame_placement(q) -> R (3, 3) and origin p (3,) of a frame, as a pair, or as a matrix (3, 4)
    or (4, 4). This and all further functions may be dicts, name of a frame -> function."""
    J: Any = None
    """J(q) -> frame Jacobian (6, p): linear velocity of the frame's origin, then angular velocity,
    along the axes of the world."""
    frame_velocity: Any = None
    """frame_velocity(q, v) -> J v (6,)."""
    frame_bias: Any = None
    """frame_bias(q, v) -> J̇ v (6,)."""
    frame_acceleration: Any = None
    """frame_acceleration(q, v, vdot) -> J v̇ + J̇ v (6,): that of the origin, not a spatial one."""
    bias_has_gravity: bool = False
    """Whether `bias` is the sum of bias and gravity."""
    speeds: int | None = None
    """Number p of generalized speeds where it is not n; only with `qdot`."""
    holonomic: bool | None = None
    """Whether M v̇ + B are Lagrange's of ½ vᵀ M v, which is not so where nonholonomic constraints
    are built into M; None for True without `qdot`, and False with it."""
    coriolis_skew: bool = True
    """Whether Ṁ - 2 C is skew-symmetric."""
    derived: bool = False
    """Whether all result from one derivation, so that none reveals a wrong input of it."""
    ranges: Any = None
    """Ranges of the random states: (low, high) for all, n pairs for the coordinates, or n + p
    pairs; by default [-1, 1] for each coordinate and each velocity."""
    coordinates: Sequence[str] | None = None
    """Names of the coordinates (n,) in reports, by default q[0], q[1], ..."""
    velocities: Sequence[str] | None = None
    """Names of the velocities (p,), by default those of the coordinates; with `qdot` u[0], ..."""
    name: str = "functions"
    """Name of them in reports."""
    factory: Callable[[], Any] | None = None
    """Factory of fresh instances: () -> dict or object that holds functions of these names."""
    array: Callable[[Array], Any] | None = None
    """Conversion of a float64 array to their arguments, such as `torch.as_tensor`."""

    def __post_init__(self):
        whole_number("n", self.n, most=MOST_COORDINATES)
        for name in self.given:
            _check_input(name, self.function(name))
        for name in ("factory", "array"):
            function = getattr(self, name)
            if function is not None and not callable(function):
                raise InputError(f"{name} = {safe_repr(function)}, expected a function")
        if not self.given:
            raise InputError(f"no function is given, expected at least one of {', '.join(INPUTS)}")
        if self.speeds is not None:
            whole_number("speeds", self.speeds, most=MOST_COORDINATES)
            if self.qdot is None and self.speeds != self.n:
                raise InputError(
                    f"speeds = {self.speeds} without qdot(q, u), which would tell how {self.n} "
                    "coordinates move with them"
                )
        for name, option in ("holonomic", self.holonomic), ("coriolis_skew", self.coriolis_skew):
            if option not in (None, True, False):
                raise InputError(f"{name} = {safe_repr(option)}, expected True or False")
        _check_names("coordinates", self.coordinates, self.n)
        _check_names("velocities", self.velocities, self.p)
        if self.bias_has_gravity and self.bias is None:
            raise InputError("bias_has_gravity = True, but no bias is given")
        self.half_ranges()

    def function(self, name: str) -> Function | None:
        """Return the function of this name, a key of `INPUTS`, or None."""
        return getattr(self, name, None)

    def frames(self, name: str) -> tuple[str, ...]:
        """Return the names of the frames of a function; ("",) where it is no dict."""
        function = self.function(name)
        return tuple(map(str, function)) if isinstance(function, Mapping) else ("",)

    @property
    def given(self) -> tuple[str, ...]:
        """Names of the functions that are given."""
        return tuple(name for name in INPUTS if self.function(name) is not None)

    @property
    def p(self) -> int:
        """Number of velocities."""
        return self.n if self.speeds is None else int(self.speeds)

    @property
    def of_lagrange(self) -> bool:
        """Whether M determines the bias."""
        return self.qdot is None if self.holonomic is None else self.holonomic

    @property
    def structure(self) -> str:
        """Name, and the names of the functions that are given."""
        return f"{self.name}: {', '.join(self.given)}"

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, by default by their index as Python counts."""
        if self.coordinates is not None:
            return tuple(self.coordinates)
        return tuple(f"q[{i}]" for i in range(self.n))

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the rows of M and of forces."""
        if self.velocities is not None:
            return tuple(self.velocities)
        return (
            self.coordinate_names if self.qdot is None else tuple(f"u[{i}]" for i in range(self.p))
        )

    def __repr__(self) -> str:
        return f"<{self.structure}>"

    def as_python(self, state: State | None = None) -> str:
        """Return Python code that checks them again, at one state or at random ones.

        Functions without an importable name, such as lambdas, are left to be filled in.
        """
        return functions_reproducer(self, INPUTS, fields(self), state)

    def half_ranges(self) -> tuple[Array, Array]:
        """Return middle and half width of the range of each coordinate and velocity (n + p,).

        Raises:
            InputError: `ranges` has none of its valid forms.
        """
        size = self.n + self.p
        full = np.tile([-1.0, 1.0], (size, 1))
        if self.ranges is not None:
            pairs = _range_pairs(self.ranges)
            if pairs is None or (pairs.ndim == 2 and len(pairs) not in (self.n, size)):
                raise InputError(
                    f"ranges = {safe_repr(self.ranges)}, expected (low, high) with low < high, or "
                    f"{self.n} such pairs for the coordinates, or {size} with the velocities"
                )
            if pairs.ndim == 1:
                full[:] = pairs
            else:
                full[: len(pairs)] = pairs
        return full.mean(axis=1), (full[:, 1] - full[:, 0]) / 2.0


@dataclass(frozen=True, eq=False, repr=False)
class ComparedEquations(EquationsOfMotion):
    """Functions with the reference they are compared with, so that code of `as_python` has both.

    Attributes:
        against: a scene, an engine made for one, (engine or its name, scene), or
            `EquationsOfMotion`.
    """

    against: Any = None

    @classmethod
    def of(cls, functions: EquationsOfMotion, against: Any) -> ComparedEquations:
        """Return `functions` with their reference."""
        return cls(
            **{x.name: getattr(functions, x.name) for x in fields(EquationsOfMotion)},
            against=against,
        )


def _check_input(name: str, function: Any) -> None:
    """Raise InputError unless an input is a function, numbers if constant, or a dict of frames."""
    symbols, more = INPUTS[name], ""
    if not symbols.reads and not callable(function):
        with suppress(TypeError, ValueError, OverflowError):
            numbers = np.asarray(function, np.float64)
            if numbers.ndim == len(symbols.shape) and np.isfinite(numbers).all() and numbers.size:
                return
        more = " or finite numbers" if symbols.shape else " or a finite number"
    elif "f" in symbols.shape:
        more = " or a dict, name of a frame -> function"
        if isinstance(function, Mapping) and function and all(map(callable, function.values())):
            return
    if not callable(function):
        raise InputError(f"{name} = {safe_repr(function)}, expected a function{more}")


def _check_names(what: str, names: Any, count: int) -> None:
    """Raise InputError unless names are None or so many different strings."""
    if names is None:
        return
    texts = [] if isinstance(names, str) else list(names)
    strings = all(isinstance(x, str) and x for x in texts)
    if len(texts) != count or not strings or len(set(texts)) != count:
        raise InputError(f"{what} = {safe_repr(names)}, expected {count} different names")


def _range_pairs(ranges: Any) -> Array | None:
    """Return pairs low < high as an array (2,) or (m, 2), None if `ranges` holds no such pairs."""
    try:
        pairs = np.asarray(ranges, np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    fits = pairs.shape == (2,) or (pairs.ndim == 2 and pairs.shape[1] == 2)
    numbers = np.isfinite(pairs).all() and not np.ma.is_masked(ranges)
    if not fits or not numbers or (pairs[..., 0] >= pairs[..., 1]).any():
        return None
    return pairs


OPTIONS = tuple(one.name for one in fields(EquationsOfMotion) if one.name != "n")
"""Names of the arguments beside n."""


def equations_from(n: Any, given: Mapping[str, Any]) -> EquationsOfMotion:
    """Return the `EquationsOfMotion` of n coordinates.

    Raises:
        UnknownNameError: a name in `given` is none of `OPTIONS`.
        InputError: see `EquationsOfMotion`.
    """
    for name in given:
        if name not in OPTIONS:
            raise UnknownNameError("argument", name, OPTIONS)
    return EquationsOfMotion(n, **given)


def checked_states(functions: EquationsOfMotion, states: Any) -> Sequence[State] | int:
    """Return the requested states, or their number.

    Raises:
        InputError: neither a number of at least 1 nor a list of (q, v) of the right shapes.
    """
    if isinstance(states, int | np.integer):
        return whole_number("states", states, most=MOST_STATES)
    try:
        pairs = [(q, v) for q, v in states]
        sizes = {"q": functions.n, "v": functions.p}
        checked = [
            State(finite_array("q", q, (sizes["q"],)), finite_array("v", v, (sizes["v"],)))
            for q, v in pairs
        ]
    except (TypeError, ValueError):
        checked = []
    if not checked:
        raise InputError(
            f"states = {safe_repr(states)}, expected a number of at least 1 or a list of "
            f"(q, v) of {functions.n} and {functions.p} finite numbers"
        )
    return checked


# ---- Calls ---------------------------------------------------------------------------------------


class BrokenError(Exception):
    """Error of a function that did not return finite numbers of the right shape.

    Attributes:
        name: name of the function, a key of `INPUTS`.
        why: reason, for messages.
    """

    def __init__(self, name: str, why: str):
        self.name, self.why = name, why
        super().__init__(f"{name}: {why}")

    @property
    def clause(self) -> str:
        """The reason behind the name: " gave no answer in 60 s", ", ValueError: no pose"."""
        ended = isinstance(self.__cause__, CallError) and not self.__cause__.by_exception
        return f"{' ' if ended else ', '}{self.why}"


class BatchedFunction:
    """Function that is told at which arguments it is called next, to compute these at once.

    Args:
        function: the function.
        prefetch: called with the arguments of several calls, each stacked along a new first axis.
    """

    def __init__(self, function: Callable[..., Any], prefetch: Callable[..., None]):
        self.__wrapped__, self.prefetch = function, prefetch

    def __call__(self, *arguments: Array) -> Any:
        """Return the result of the function."""
        return self.__wrapped__(*arguments)


class FunctionCaller:
    """Caller of the functions, with copies of their arguments and checks of their results.

    Args:
        functions: the functions.
    """

    def __init__(self, functions: EquationsOfMotion):
        self.functions = functions
        self.sizes: dict[str, int] = {"n": functions.n, "p": functions.p}
        self.single_precision: dict[str, str] = {}
        """Names of functions that returned single precision or less, and their dtype."""
        self._reads: dict[str, str] = {}
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.writing: set[str] = set()
        """Names of functions that wrote into their arguments."""
        self.repeated: set[str] = set()
        """Names of functions that were called again and again at one state."""
        self.reported: set[str] = set()
        """Names of functions that fail at some state, with the reason in a Finding."""
        self._calls: list[tuple[str, dict[str, Array]]] | None = None

    @cached_property
    def prefetches(self) -> bool:
        """Whether any function is told at which arguments it is called next."""
        return any(self._batched(name) for name in self.functions.given)

    def _batched(self, name: str) -> list[BatchedFunction]:
        """Return the function `name`, or those of its frames, as far as they are batched."""
        function = self.functions.function(name)
        each = function.values() if isinstance(function, Mapping) else (function,)
        return [x for x in each if isinstance(x, BatchedFunction)]

    def prefetch(
        self,
        name: str,
        states: Sequence[tuple[Array, Array]],
        vdot: Array | None = None,
        tau: Array | None = None,
    ) -> None:
        """Tell the function `name`, if it is batched, at which states (q, v) it is called next."""
        if "t" in self.reads(name) or not (batched := self._batched(name)):
            return
        q, v = (np.array(x) for x in zip(*states, strict=True))
        loads = ((x, y) for x, y in (("a", vdot), ("f", tau)) if y is not None)
        stacked = {"q": q, "v": v} | {x: np.tile(y, (len(q), 1)) for x, y in loads}
        for one in batched:
            one.prefetch(*(stacked[letter] for letter in self.reads(name)))

    @contextmanager
    def recording(self) -> Iterator[list[tuple[str, dict[str, Array]]]]:
        """Yield a list to which calls inside the block are appended: name and arrays by letter."""
        self._calls = []
        try:
            yield self._calls
        finally:
            self._calls = None

    def reads(self, name: str) -> str:
        """Return the arguments of a function, one letter each, see `Input`."""
        if name not in self._reads:
            more = MAY_READ_MORE.get(name, "")
            takes = more and _argument_count(self.functions.function(name)) == len(more)
            self._reads[name] = more if takes else INPUTS[name].reads
        return self._reads[name]

    def __call__(
        self,
        name: str,
        q: Array,
        v: Array,
        t: float = 0.0,
        *,
        vdot: Array | None = None,
        tau: Array | None = None,
    ) -> Array:
        """Return the result of the function `name` at (q, v, t), called with those it reads.

        Args:
            name: name of the function; of one of frames the results are stacked, the frame first.
            q, v, t: state.
            vdot: acceleration (p,), by default 0.
            tau: applied forces (p,), by default 0.

        Raises:
            BrokenError: an exception inside, no array of numbers, of wrong shape, or not finite.
        """
        function = self.functions.function(name)
        reads, none = self.reads(name), np.zeros(len(v))
        handed = {"q": q, "v": v, "a": none if vdot is None else vdot}
        arrays = {
            x: y for x, y in {**handed, "f": none if tau is None else tau}.items() if x in reads
        }
        if self._calls is not None:
            self._calls.append((name, arrays))
        if "f" not in INPUTS[name].shape:
            return self._answer(name, function, arrays, t)
        results = []
        for frame in self.functions.frames(name):
            of_frame = function[frame] if isinstance(function, Mapping) else function
            try:
                results.append(self._answer(name, of_frame, arrays, t))
            except BrokenError as broken:
                if not frame:
                    raise
                raise BrokenError(name, f"of frame {frame}: {broken.why}") from broken
        return np.array(results)

    def _answer(self, name: str, function: Any, given: dict[str, Array], t: float) -> Array:
        """Return the checked result of a function, called with copies of the arrays it reads."""
        if not callable(function):
            return self._check_result(name, function)
        make = self.functions.array
        handed = {letter: array.copy() for letter, array in given.items()}
        arrays: dict[str, Any] = handed if make is None else {x: make(y) for x, y in handed.items()}
        values = {**arrays, "t": t}
        arguments = [values[letter] for letter in self.reads(name)]
        before = [] if make is None else _bytes(arrays)
        try:
            answer = call(f"{self.functions.name}: {name}", function, *arguments)
        except EngineFault as fault:
            raise BrokenError(name, fault.what) from fault
        except CallError as error:
            raise BrokenError(name, error.text) from error
        except Exception as error:
            text = described_error(error)
            # PyTorch's error for an array of NumPy names its Tensor.
            hint = "; say array=torch.as_tensor" if make is None and "Tensor" in text else ""
            hint = hint or _call_hint(name, function, self.reads(name), error, text)
            raise BrokenError(name, text + hint) from error
        finally:
            written = any(handed[x].tobytes() != y.tobytes() for x, y in given.items())
            if written or (make is not None and _bytes(arrays) != before):
                self.writing.add(name)
        return self._check_result(name, answer)

    def _check_result(self, name: str, answer: Any) -> Array:
        """Return a result as a finite float64 array of its shape, else raise BrokenError."""
        if name == "frame_placement":
            array = self._placement(answer)
        elif type(answer) is np.ndarray and answer.dtype == np.float64:
            array = answer.copy()
        else:
            array = self._as_float64(name, answer)
        array = self._reshape(name, array)
        # For a single number NumPy's own `all` takes longer than all other steps.
        finite = np.isfinite(array).all() if array.ndim else isfinite(array.item())
        if not finite:
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            entry = f"{name}[{self._entry_names(name, where)}]" if where else name
            raise BrokenError(name, f"{entry} = {array[where]}, expected a finite number")
        return array

    def _entry_names(self, name: str, where: tuple[int, ...]) -> str:
        """Return the indices of an entry, by the user's names of its rows where there are any."""
        f = self.functions
        velocities = f.velocities or (f.coordinates if f.qdot is None else None)
        names = {"n": f.coordinates, "p": velocities}
        symbols = [x for x in INPUTS[name].shape if x != "f"]
        axes = [names.get(symbol) for symbol in symbols]
        pairs = zip(where, axes, strict=True)
        return ", ".join(str(i) if axis is None else axis[i] for i, axis in pairs)

    def _placement(self, answer: Any) -> Array:
        """Return a placement as one matrix, [R p]; of one of shape (4, 4) the first three rows."""
        pair = isinstance(answer, tuple) and len(answer) == 2
        parts = [self._as_float64("frame_placement", x) for x in (answer if pair else [answer])]
        if not pair:
            return parts[0][:3] if parts[0].shape == (4, 4) else parts[0]
        if parts[0].shape != (3, 3) or parts[1].size != 3:
            shapes = f"{parts[0].shape} and {parts[1].shape}"
            why = f"answers arrays of shapes {shapes}, expected (3, 3) and (3,)"
            raise BrokenError("frame_placement", why)
        return np.column_stack((parts[0], parts[1].ravel()))

    def _as_float64(self, name: str, answer: Any) -> Array:
        """Return a result of any type as a float64 array."""
        if answer is None:
            raise BrokenError(name, "answers None, expected an array of numbers")
        try:
            raw = np.asarray(_detached_result(answer))
            if np.ma.is_masked(answer):
                raise BrokenError(name, "answers a masked array, of which entries are masked")
            if raw.dtype.kind == "c":
                raise BrokenError(
                    name, "answers complex numbers, expected an array of real numbers"
                )
            if raw.dtype.kind not in "fiuO":
                raise TypeError
            array = np.array(raw, np.float64)
        except OverflowError:
            raise BrokenError(name, "answers a number that is too large for a double") from None
        except (TypeError, ValueError, RuntimeError):
            text = f"answers {_type_text(answer)}, expected an array of numbers"
            raise BrokenError(name, text) from None
        if raw.dtype.kind == "f" and raw.dtype.itemsize < 8:
            self.single_precision[name] = str(raw.dtype)
        return array

    def _reshape(self, name: str, array: Array) -> Array:
        """Return a result in the shape of its input, else raise BrokenError."""
        if array.shape == self._shapes.get(name):
            return array
        symbols = [x for x in INPUTS[name].shape if x != "f"]
        wide = self._is_transposed(symbols, array)
        for x in {"r", "k"} & {*symbols} - {*self.sizes}:
            if array.ndim > symbols.index(x):
                self.sizes[x] = array.shape[:: -1 if wide else 1][symbols.index(x)]
        shape = tuple(int(x) if x.isdigit() else self.sizes.get(x, 1) for x in symbols)
        # A column, or a number in an array, as lambdified SymPy returns.
        if len(shape) < 2 and array.shape in ((*shape, 1), (1, 1)) and array.size == np.prod(shape):
            return array.reshape(shape)
        if array.shape != shape:
            hint = ": transposed?" if wide and array.shape[::-1] == shape else ""
            if array.shape == (1, *shape):
                hint = ": functions are called with one state at a time"
            text = f"answers an array of shape {array.shape}, expected {shape}{hint}"
            raise BrokenError(name, text)
        self._shapes[name] = shape
        return array

    def _is_transposed(self, symbols: Sequence[str], array: Array) -> bool:
        """Return whether only the transposed matrix has the number of columns it should have."""
        if len(symbols) != 2 or array.ndim != 2 or symbols[1] not in self.sizes:
            return False
        return array.shape[1] != self.sizes[symbols[1]] == array.shape[0]


def _call_hint(name: str, function: Any, reads: str, error: Exception, text: str) -> str:
    """Return how a function is to be called, after an error of its call; "" for other errors.

    Args:
        name: name of the input.
        function: the function.
        reads: its arguments, see `Input`.
        error: the error.
        text: its text; an error of a user may have none that can be read.
    """
    if isinstance(error, IndexError) and "too many indices" in text:
        return "; functions are called with one state at a time, each argument of one dimension"
    call_failed = "positional" in text and isinstance(error, TypeError)
    count, arguments = _argument_count(function), ", ".join(argument_names(reads))
    if not call_failed or count == len(reads):
        return ""
    call_text = f"; it is called as {name}({arguments})"
    if count < len(reads):
        return call_text
    takes = ", ".join(list(signature(function).parameters)[:count])
    return f"{call_text}: write {name} = lambda {arguments}: {name}({takes})"


def argument_names(reads: str) -> list[str]:
    """Return the names of arguments that are given by one letter each, see `Input`."""
    words = {"q": "q", "v": "v", "t": "t", "a": "vdot", "f": "tau"}
    return [words[letter] for letter in reads]


def _bytes(arrays: dict[str, Any]) -> list[bytes]:
    """Return the numbers in arrays of any library as bytes; [] if NumPy cannot read them."""
    with suppress(TypeError, ValueError, RuntimeError):
        return [np.asarray(_detached_result(array)).tobytes() for array in arrays.values()]
    return []


def _type_text(answer: Any) -> str:
    """Return the type of a result for messages, such as "a list of str" or "an array of bool".

    The type of its entries is named where all are of one type that is no number.
    """
    kind = "an array" if isinstance(answer, np.ndarray) else f"a {type(answer).__name__}"
    entries = np.ravel(answer).tolist() if isinstance(answer, np.ndarray) else answer
    types = {type(x) for x in entries} if isinstance(entries, list | tuple) else set()
    if len(types) != 1 or types & {int, float, list, tuple}:
        return kind
    (entry_type,) = types
    return f"{kind} of {entry_type.__name__}"


PLAIN = np.ndarray, np.float64, float
"""Types of results that NumPy reads as they are."""


def _detached_result(answer: Any) -> Any:
    """Return a result that NumPy can read: detached from gradients, on the CPU."""
    if type(answer) in PLAIN:
        return answer
    if isinstance(answer, list | tuple):
        return [_detached_result(entry) for entry in answer]
    for method in ("detach", "cpu"):
        answer = getattr(answer, method, lambda answer=answer: answer)()
    return answer


def _argument_count(function: Any) -> int:
    """Return the number of positional arguments without default, 1 without a signature."""
    try:
        parameters = signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(x.kind in positional and x.default is Parameter.empty for x in parameters)
