"""Equations of motion under test: user-supplied float64 functions, and checked calls of them.

    M q̈ + bias + gravity + ∂R/∂v = Q + aᵀλ,    a v + b = 0,    a q̈ + γ = 0

`EquationsOfMotion` holds the functions. One that is not given stands for a term that is zero.
Velocities v are q̇, unless `qdot` returns q̇; v then are generalized speeds u, and forces are those
along u. `FunctionCaller` calls the functions with copies of their arguments and checks type, shape
and finiteness of each result; a failure is raised with the name of its function (`BrokenError`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
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
        reads: its arguments, one letter each: "q", "qv" or "t"; see also `MAY_READ_MORE`.
        shape: shape of its result, in terms of n coordinates, p velocities and r constraints.
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
}
"""Name -> signature of the function of that name."""

MOST_COORDINATES = 10_000
"""Largest number of coordinates: a mass matrix then takes 800 MB."""

MOST_STATES = 1_000_000
"""Largest number of states that may be drawn in one call."""

MAY_READ_MORE = {"b": "qt", "c": "qv", "gravity": "qv"}
"""Name -> arguments of a function if it has two positional arguments without default."""


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
    """qdd(q, v) -> acceleration (p,), with everything in it."""
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
    bias_has_gravity: bool = False
    """Whether `bias` is the sum of bias and gravity."""
    speeds: int | None = None
    """Number p of generalized speeds where it is not n; only with `qdot`."""
    holonomic: bool | None = None
    """Whether M v̇ + B are Lagrange's of ½ vᵀ M v, which is not so where nonholonomic constraints
    are built into M; None for True without `qdot`, and False with it."""
    derived: bool = False
    """Whether all result from one derivation, so that none reveals a wrong input of it."""
    ranges: Any = None
    """Ranges of the random states: (low, high) for all, n pairs for the coordinates, or n + p
    pairs; by default [-1, 1] for each coordinate and each velocity."""
    name: str = "functions"
    """Name of them in reports."""
    factory: Callable[[], Any] | None = None
    """Factory of fresh instances: () -> dict or object that holds functions of these names."""
    array: Callable[[Array], Any] | None = None
    """Conversion of a float64 array to their arguments, such as `torch.as_tensor`."""

    def __post_init__(self):
        whole_number("n", self.n, most=MOST_COORDINATES)
        for name in self.given:
            if not callable(self.function(name)):
                raise InputError(f"{name} = {safe_repr(self.function(name))}, expected a function")
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
        if self.holonomic not in (None, True, False):
            raise InputError(f"holonomic = {safe_repr(self.holonomic)}, expected True or False")
        if self.bias_has_gravity and self.bias is None:
            raise InputError("bias_has_gravity = True, but no bias is given")
        self.half_ranges()

    def function(self, name: str) -> Function | None:
        """Return the function of this name, a key of `INPUTS`, or None."""
        return getattr(self, name)

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
        """Names of the coordinates, by their index as Python counts."""
        return tuple(f"q[{i}]" for i in range(self.n))

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the rows of M and of forces."""
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

    def reads(self, name: str) -> str:
        """Return the arguments of a function, one letter each: "q", "qv", "t" or "qt"."""
        if name not in self._reads:
            more = name in MAY_READ_MORE and _argument_count(self.functions.function(name)) == 2
            self._reads[name] = MAY_READ_MORE[name] if more else INPUTS[name].reads
        return self._reads[name]

    def __call__(self, name: str, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the result of the function `name` at (q, v, t), called with those it reads.

        Raises:
            BrokenError: an exception inside, no array of numbers, of wrong shape, or not finite.
        """
        function, make = self.functions.function(name), self.functions.array
        assert function is not None
        handed = {"q": q.copy(), "v": v.copy()}
        arrays: dict[str, Any] = handed if make is None else {x: make(y) for x, y in handed.items()}
        values = {**arrays, "t": t}
        arguments = [values[letter] for letter in self.reads(name)]
        before = [] if make is None else _bytes(arrays)
        try:
            answer = call(f"{self.functions.name}: {name}", function, *arguments)
        except EngineFault as fault:
            raise BrokenError(name, fault.what) from fault
        except CallError as error:
            raise BrokenError(name, error.what.removeprefix("raised ")) from error
        except Exception as error:
            text = described_error(error)
            # PyTorch's error for an array of NumPy names its Tensor.
            hint = "; say array=torch.as_tensor" if make is None and "Tensor" in text else ""
            raise BrokenError(name, text + hint) from error
        finally:
            written = handed["q"].tobytes() != q.tobytes() or handed["v"].tobytes() != v.tobytes()
            if written or (make is not None and _bytes(arrays) != before):
                self.writing.add(name)
        return self._check_result(name, answer)

    def _check_result(self, name: str, answer: Any) -> Array:
        """Return a result as a finite float64 array of its shape, else raise BrokenError."""
        if type(answer) is np.ndarray and answer.dtype == np.float64:
            array = answer.copy()
        else:
            array = self._as_float64(name, answer)
        array = self._reshape(name, array)
        # For a single number NumPy's own `all` takes longer than all other steps.
        finite = np.isfinite(array).all() if array.ndim else isfinite(array.item())
        if not finite:
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            entry = f"{name}{list(where)}" if where else name
            raise BrokenError(name, f"{entry} = {array[where]}, expected a finite number")
        return array

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
        symbols = INPUTS[name].shape
        if "r" in symbols and "r" not in self.sizes and array.ndim >= 1:
            self.sizes["r"] = array.shape[0]
        shape = tuple(self.sizes.get(x, 1) for x in symbols)
        # A column, or a number in an array, as lambdified SymPy returns.
        if len(shape) < 2 and array.shape in ((*shape, 1), (1, 1)) and array.size == np.prod(shape):
            return array.reshape(shape)
        if array.shape != shape:
            raise BrokenError(name, f"answers an array of shape {array.shape}, expected {shape}")
        self._shapes[name] = shape
        return array


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
