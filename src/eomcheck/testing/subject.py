"""The subject on trial: somebody's own functions, as `Functions`.

    M q̈ + bias + gravity + ∂R/∂v = Q + aᵀλ,    a v + b = 0,    a q̈ + γ = 0

A function that is not given stands for a term that is not there. Velocities v are q̇, unless `qdot`
says what q̇ is; v then are generalized speeds u, and forces are those along u.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from eomcheck.errors import InputError, UnknownNameError, shown, whole_number
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import finite_array
from eomcheck.numbers.generic import Array
from eomcheck.testing.source import python_of_functions

Function = Callable[..., Any]


class Input(NamedTuple):
    """What one of the functions is.

    Attributes:
        reads: what it is called with: "q", "qv" or "t"; see also `MAY_READ_MORE`.
        shape: of what it answers, in terms of n coordinates, p velocities and r constraints.
        what: its name in words, as failures call it.
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
"""Name -> what the function of that name is."""

MOST_COORDINATES = 10_000
"""Coordinates of functions: a mass matrix then takes 800 MB."""

MOST_STATES = 1_000_000
"""States that may be drawn in one call."""

MAY_READ_MORE = {"b": "qt", "c": "qv", "gravity": "qv"}
"""Name -> what a function is called with if it has two arguments that must be given."""


@dataclass(frozen=True, eq=False, repr=False)
class Functions:
    """Somebody's equations of motion as functions of doubles, black boxes.

    Each is called with arrays of doubles of its own, of shape (n,) or (p,), and answers an array,
    of NumPy or of what NumPy can read. A vector may be a column (p, 1), a number an array of one.
    """

    instead: ClassVar[str] = (
        "functions are checked by `eomcheck fuzz --scene {}`, and in Python by check_functions"
    )
    """Advice for a place where a scene is expected; {} stands for FILE:NAME."""
    n: int
    """Number of coordinates."""
    M: Function | None = None
    """M(q) -> mass matrix (p, p)."""
    bias: Function | None = None
    """bias(q, v) -> B (p,), Coriolis and centrifugal, on the left-hand side, without gravity."""
    gravity: Function | None = None
    """gravity(q) -> ∂U/∂q (p,), on the left-hand side; gravity(q, v) is called so too."""
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
    """b(t), or b(q, t) -> constraint velocity (r,), a v + b = 0; looked at around t = 0 s."""
    c: Function | None = None
    """c(q) -> (r,), which vanishes where loops are closed, a = ∂c/∂q; or, with two arguments,
    c(q, v) -> (r,), which vanishes where nothing slips, a = ∂c/∂v and c = a v + b."""
    gamma: Function | None = None
    """gamma(q, v) -> ȧ v + ḃ (r,)."""
    qdot: Function | None = None
    """qdot(q, u) -> q̇ (n,), where velocities are generalized speeds u; linear in u."""
    bias_has_gravity: bool = False
    """Whether `bias` is the sum of bias and gravity."""
    speeds: int | None = None
    """Number p of generalized speeds where it is not n; only with `qdot`."""
    holonomic: bool | None = None
    """Whether M v̇ + B are Lagrange's of ½ vᵀ M v, which is not so where constraints that are not
    holonomic are built into M; None for True without `qdot`, and False with it."""
    derived: bool = False
    """Whether all come out of one derivation, so that none tells what went into it wrong."""
    ranges: Any = None
    """What states are drawn from: (low, high) for all, n pairs for the coordinates, or n + p pairs;
    by default [-1, 1] for each coordinate and each velocity."""
    name: str = "functions"
    """What reports call them."""
    factory: Callable[[], Any] | None = None
    """Makes them anew: () -> dict or object that holds functions of these names."""
    array: Callable[[Array], Any] | None = None
    """Makes what they are called with of an array of doubles, such as `torch.as_tensor`."""

    def __post_init__(self):
        whole_number("n", self.n, most=MOST_COORDINATES)
        for name in self.given:
            if not callable(self.function(name)):
                raise InputError(f"{name} = {shown(self.function(name))}, expected a function")
        for name in ("factory", "array"):
            made = getattr(self, name)
            if made is not None and not callable(made):
                raise InputError(f"{name} = {shown(made)}, expected a function")
        if not self.given:
            raise InputError(f"no function is given, expected at least one of {', '.join(INPUTS)}")
        if self.speeds is not None:
            whole_number("speeds", self.speeds, most=MOST_COORDINATES)
            if self.qdot is None and self.speeds != self.n:
                raise InputError(
                    f"speeds = {self.speeds} without qdot(q, u), which would tell how {self.n} "
                    "coordinates move with them"
                )
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
        """The name and what is given."""
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
        """Return Python code that checks them again, in one state or where they were drawn.

        Functions that have no name that can be imported, such as lambdas, are left to be put in.
        """
        return python_of_functions(self, INPUTS, fields(self), state)

    def half_ranges(self) -> tuple[Array, Array]:
        """Return middle and half width of the range of each coordinate and velocity (n + p,).

        Raises:
            InputError: `ranges` is nothing of what it may be.
        """
        size = self.n + self.p
        full = np.tile([-1.0, 1.0], (size, 1))
        if self.ranges is not None:
            given = _pairs(self.ranges)
            if given is None or (given.ndim == 2 and len(given) not in (self.n, size)):
                raise InputError(
                    f"ranges = {shown(self.ranges)}, expected (low, high) with low < high, or "
                    f"{self.n} such pairs for the coordinates, or {size} with the velocities"
                )
            if given.ndim == 1:
                full[:] = given
            else:
                full[: len(given)] = given
        return full.mean(axis=1), (full[:, 1] - full[:, 0]) / 2.0


@dataclass(frozen=True, eq=False, repr=False)
class ComparedFunctions(Functions):
    """Functions with what they are compared with, which Python code that checks them again names.

    Attributes:
        against: a scene, an engine made for one, (engine or its name, scene), or `Functions`.
    """

    against: Any = None

    @classmethod
    def of(cls, functions: Functions, against: Any) -> ComparedFunctions:
        """Return `functions` with what they are compared with."""
        return cls(
            **{x.name: getattr(functions, x.name) for x in fields(Functions)}, against=against
        )


def _pairs(ranges: Any) -> Array | None:
    """Return pairs low < high as an array (2,) or (m, 2), None if they are none."""
    try:
        pairs = np.asarray(ranges, np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    fits = pairs.shape == (2,) or (pairs.ndim == 2 and pairs.shape[1] == 2)
    numbers = np.isfinite(pairs).all() and not np.ma.is_masked(ranges)
    if not fits or not numbers or (pairs[..., 0] >= pairs[..., 1]).any():
        return None
    return pairs


OPTIONS = tuple(one.name for one in fields(Functions) if one.name != "n")
"""Names of what may be given beside n."""


def functions_of(n: Any, given: Mapping[str, Any]) -> Functions:
    """Return the `Functions` of n coordinates.

    Raises:
        UnknownNameError: a name in `given` is none of `OPTIONS`.
        InputError: see `Functions`.
    """
    for name in given:
        if name not in OPTIONS:
            raise UnknownNameError("argument", name, OPTIONS)
    return Functions(n, **given)


def checked_states(functions: Functions, states: Any) -> Sequence[State] | int:
    """Return the states asked for, or their number.

    Raises:
        InputError: neither a number of at least 1 nor a list of (q, v) of the right shapes.
    """
    if isinstance(states, int | np.integer):
        return whole_number("states", states, most=MOST_STATES)
    try:
        pairs = [(q, v) for q, v in states]
        sizes = {"q": functions.n, "v": functions.p}
        found = [
            State(finite_array("q", q, (sizes["q"],)), finite_array("v", v, (sizes["v"],)))
            for q, v in pairs
        ]
    except (TypeError, ValueError):
        found = []
    if not found:
        raise InputError(
            f"states = {shown(states)}, expected a number of at least 1 or a list of "
            f"(q, v) of {functions.n} and {functions.p} finite numbers"
        )
    return found
