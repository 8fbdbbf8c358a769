"""Quantities of user-supplied functions at one state (`FunctionState`), each with its error.

A quantity is the result of a function, or is derived from several by finite differences and
products of `UncertainArray`: the inertia, the bias, the constraint drift. Each is computed on first
use and cached.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, TypedDict

import numpy as np

from eomcheck.evaluation.constraint_rank import repeated_rows
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import EPS, Array
from eomcheck.testing.equations_of_motion import BrokenError, EquationsOfMotion, FunctionCaller
from eomcheck.testing.uncertain import (
    Sampled,
    UncertainArray,
    contract,
    entry_sizes,
    exact,
    gradient,
    jumps,
    noise,
    partial,
    sign_patterns,
    values_at,
)

FLIPS = 4
"""Least number of sign patterns of v over which the largest size of each entry is taken."""

STEPS, CLOSE = 50, 1e-10
"""Largest number of steps of Newton's method, and largest size of the last one, relative to q."""

NOT_QUADRATIC = "T has terms that are not quadratic in v"
REST_ENERGY = "T(q, 0) changes with q; is the potential energy in it?"


class Loads(TypedDict, total=False):
    """Arguments of functions beside the state: acceleration (p,) and applied forces (p,)."""

    vdot: Array
    tau: Array


def _key_of(loads: Loads) -> tuple[bytes, bytes]:
    """Return the loads as a key of a cache, empty where there are none."""
    none = np.zeros(0)
    return loads.get("vdot", none).tobytes(), loads.get("tau", none).tobytes()


class FunctionState:
    """Quantities at (q, v), each computed on first use.

    Args:
        answers: caller of the functions.
        q: coordinates (n,).
        v: velocities (p,).
        seed: seed of the directions in which noise is measured.
        reference: equations that they are compared with, or None.
    """

    def __init__(
        self,
        answers: FunctionCaller,
        q: Array,
        v: Array,
        seed: int = 0,
        reference: EquationsOfMotion | None = None,
    ):
        self.caller, self.functions, self.reference = answers, answers.functions, reference
        self.q, self.v, self.seed = q, v, seed
        _, widths = self.functions.half_ranges()
        self.width_q, self.width_v = widths[: len(q)], widths[len(q) :]
        self.loads_of: FunctionState | None = None
        """State of other functions with the same loads, or None."""
        self._cache: dict[Any, Any] = {}

    @cached_property
    def vdot(self) -> Array:
        """Acceleration (p,) of functions that read one, as large as the range of velocities.

        It and `tau` are drawn by q alone, so that a state that is checked again has the same.
        """
        return self.width_v * self._draw(0) if self.loads_of is None else self.loads_of.vdot

    @cached_property
    def tau(self) -> Array:
        """Applied forces (p,) of functions that read them; 0 where q̈ is given without them.

        They are as large as those that give accelerations in the range of velocities.
        """
        if self.loads_of is not None:
            return self.loads_of.tau
        if self.has("qdd") and not self.has("tau"):
            return np.zeros(len(self.v))
        return self.width_tau * self._draw(1)

    @cached_property
    def width_tau(self) -> Array:
        """Half widths of the range of applied forces (p,)."""
        sizes = np.ones(len(self.v))
        with suppress(BrokenError):
            if self.has("M") or self.has("T"):
                of_inertia = np.abs(inertia(self).value) @ self.width_v
                sizes = np.where(of_inertia > 0.0, of_inertia, 1.0)
        return sizes

    def _draw(self, which: int) -> Array:
        """Return random numbers (p,), each of magnitude at least ½ and at most 1."""
        rng = np.random.default_rng([which, *np.frombuffer(self.q.tobytes(), np.uint32)])
        return rng.uniform(0.5, 1.0, len(self.v)) * rng.choice((-1.0, 1.0), len(self.v))

    def cached(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of `make()`, computed once per key."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def answering(self, name: str) -> bool:
        """Return whether the function `name` is given, and has a value at this state."""

        def has_value() -> bool:
            with suppress(BrokenError):
                self.call(name)
                return True
            return False

        is_supplied = self.functions.function(name) is not None
        return is_supplied and self.cached(("answers", name), has_value)

    def has(self, name: str) -> bool:
        """Return whether a quantity is available: it is given, or follows at once."""
        if name == "gravity":
            return self.functions.gravity is not None or self.functions.bias_has_gravity
        if name == "against":
            return self.reference is not None
        if name == "tau":
            return self.has("qdd") and "f" in self.caller.reads("qdd")
        return self.functions.function(name) is not None

    def with_velocity(self, v: Array) -> FunctionState:
        """Return the state with the same coordinates and another velocity."""
        return self.cached(
            ("v", v.tobytes()),
            lambda: self._with(v, {}),
        )

    def with_loads(self, vdot: Array | None = None, tau: Array | None = None) -> FunctionState:
        """Return the state with another acceleration, or with other applied forces."""
        loads = {name: x for name, x in (("vdot", vdot), ("tau", tau)) if x is not None}
        key = tuple((name, x.tobytes()) for name, x in loads.items())
        return self.cached(("loads", key), lambda: self._with(self.v, loads))

    def _with(self, v: Array, loads: dict[str, Array]) -> FunctionState:
        """Return the state with velocity v and `loads`, others as far as they are known."""
        state = FunctionState(self.caller, self.q, v, self.seed, self.reference)
        known = {x: self.__dict__[x] for x in ("vdot", "tau", "width_tau") if x in self.__dict__}
        state.__dict__.update(known | loads)
        return state

    # ---- Black boxes ---------------------------------------------------------------------------

    def loads(self, name: str) -> Loads:
        """Return acceleration and forces of this state that the function `name` reads.

        The acceleration q̈ is that without forces, except for `driven`.
        """
        reads = self.caller.reads(name)
        loads: Loads = {}
        if "a" in reads:
            loads["vdot"] = self.vdot
        if "f" in reads and name != "qdd":
            loads["tau"] = self.tau
        return loads

    def call(self, name: str) -> Array:
        """Return the result of the function `name` at this state.

        Raises:
            BrokenError: see `FunctionCaller`.
        """
        return self.caller(name, self.q, self.v, **self.loads(name))

    def raw(self, name: str, loads: Loads | None = None) -> Callable[[Array, Array], Array]:
        """Return the function `name` of (q, v), NaN where it has no value.

        Args:
            name: name of the function.
            loads: `vdot` and `tau`, those of the state by default.
        """
        under: Loads = self.loads(name) if loads is None else loads
        key = "raw", name, _key_of(under)
        return self.cached(key, lambda: self._quiet(name, under))

    def _quiet(self, name: str, under: Loads) -> Callable[[Array, Array], Array]:
        """Return the function `name` of (q, v) under loads, see `raw`."""
        value = self.caller(name, self.q, self.v, **under)

        def quiet(q: Array, v: Array) -> Array:
            try:
                return self.caller(name, q, v, **under)
            except BrokenError:
                return np.full(value.shape, np.nan)

        return quiet

    def driven(self, tau: Array | None = None) -> Callable[[Array, Array], Array]:
        """Return q̈ of (q, v) with applied forces τ (p,), those of the state by default."""
        if not self.has("tau"):
            return self.raw("qdd")
        return self.raw("qdd", {"tau": self.tau if tau is None else tau})

    def measure(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return f(q, v) with its measured noise, and the size of the terms that cancel in it."""
        return self.cached(("measured", f), lambda: self._measure(f))

    def _measure(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return f(q, v) with its error, see `measure`."""
        x, width = np.concatenate((self.q, self.v)), np.concatenate((self.width_q, self.width_v))
        value = f(self.q, self.v)
        spread = noise(self._sampled(f, self._split), x, width, self.seed)
        flipped = values_at(self._sampled(f, lambda v: (self.q, v)), [*(self._signs() * self.v)])
        size = np.fmax.reduce([entry_sizes(value), *map(entry_sizes, flipped)])
        return UncertainArray(value, spread + np.finfo(np.float64).eps * size, size)

    def _split(self, x: Array) -> tuple[Array, Array]:
        """Return q and v of an array (n + p,) of both."""
        return x[: len(self.q)], x[len(self.q) :]

    def _sampled(
        self,
        f: Callable[[Array, Array], Array],
        state_of: Callable[[Array], tuple[Array, Array]],
    ) -> Sampled:
        """Return a function of (q, v) as one of an array x, with the state (q, v) of x."""

        def prefetch(points: Sequence[Array]) -> None:
            if not self.caller.prefetches:
                return
            states = [state_of(x) for x in points]
            at_v = all(np.array_equal(v, self.v) for _, v in states)
            for name, v, loads in self.cached(("calls", f), lambda: self._calls_of(f)):
                if v is None:
                    self.caller.prefetch(name, states, **loads)
                elif at_v:  # f calls it at the same other velocity each time
                    self.caller.prefetch(name, [(q, v) for q, _ in states], **loads)

        return Sampled(lambda x: f(*state_of(x)), prefetch)

    def _calls_of(
        self, f: Callable[[Array, Array], Array]
    ) -> list[tuple[str, Array | None, Loads]]:
        """Return the functions that f calls at this q, their velocity if not v, and their loads."""
        with self.caller.recording() as calls, suppress(BrokenError, np.linalg.LinAlgError):
            f(self.q, self.v)
        found: dict[Any, tuple[str, Array | None, Loads]] = {}
        for name, read in calls:
            loads: Loads = {}
            if "a" in read:
                loads["vdot"] = read["a"]
            if "f" in read:
                loads["tau"] = read["f"]
            if np.array_equal(read.get("q", self.q), self.q):
                v = read.get("v", self.v)
                other = None if np.array_equal(v, self.v) else v
                found[name, v.tobytes(), _key_of(loads)] = name, other, loads
        return [*found.values()]

    def _signs(self) -> Array:
        """Return signs of v (flips, p): any two velocities have opposite ones in one of them.

        Terms in v_i v_j that cancel at v then do not cancel in all.
        """
        signs = sign_patterns(len(self.v))
        more = max(FLIPS - len(signs), 0), len(self.v)
        drawn = np.random.default_rng(self.seed).choice((-1.0, 1.0), more)
        return np.concatenate((signs, drawn))

    def quantity(self, name: str) -> UncertainArray:
        """Return the result of the function `name`, with its error."""

        return self.cached(name, lambda: self.measure(self.raw(name)))

    def jumps(self, name: str) -> bool:
        """Return whether the function `name` jumps near this state, see `testing.uncertain.jumps`.

        False where it has no value.
        """
        x, width = np.concatenate((self.q, self.v)), np.concatenate((self.width_q, self.width_v))
        try:
            f = self.raw(name)
        except BrokenError:
            return False
        return jumps(self._sampled(f, self._split), x, width, self.seed)

    def by_q(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return ∂f/∂q (n, ...)."""
        at_q = self._sampled(f, lambda q: (q, self.v))
        return self.cached(
            ("by q", f), lambda: gradient(at_q, self.q, self.width_q, self.measure(f))
        )

    def by_v(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return ∂f/∂v (p, ...)."""
        at_v = self._sampled(f, lambda v: (self.q, v))
        return self.cached(
            ("by v", f), lambda: gradient(at_v, self.v, self.width_v, self.measure(f))
        )

    def by_tau(self, f: Callable[[Array], Callable[[Array, Array], Array]]) -> UncertainArray:
        """Return ∂f/∂τ (p, ...) of a function τ -> function of (q, v)."""
        at_tau = self.measure(f(self.tau))
        return gradient(lambda tau: f(tau)(self.q, self.v), self.tau, self.width_tau, at_tau)

    # ---- Derived from single functions ---------------------------------------------------------

    def S(self) -> UncertainArray:
        """∂q̇/∂v (n, p)."""

        def columns(q: Array, v: Array) -> Array:
            qdot = self.raw("qdot")
            return np.array([qdot(q, axis) for axis in np.eye(len(self.v))]).T

        if self.functions.qdot is None:
            return exact(np.eye(len(self.q)))
        return self.cached("S", lambda: self.measure(columns))

    def along_velocities(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return ∂f/∂q ∂q̇/∂v (..., p): derivatives along each velocity, last."""
        by_q = self.by_q(f)
        axes = "abc"[: len(by_q.shape) - 1]
        return contract(f"n{axes},np->{axes}p", by_q, self.S())

    def rates(self) -> UncertainArray:
        """q̇ (n,)."""
        return self.S() @ exact(self.v)

    def along(self, gradient_: UncertainArray) -> UncertainArray:
        """Return the rate of a quantity while q moves, from its derivatives ∂/∂q (n, ...)."""
        axes = "abc"[: len(gradient_.shape) - 1]
        return contract(f"n{axes},n->{axes}", gradient_, self.rates())

    def rate_of(self, f: Callable[[Array, Array], Array]) -> UncertainArray:
        """Return the rate of f while q moves with q̇ and v is constant."""
        rates = self.rates().value
        longest = float(np.abs(rates / self.width_q).max(initial=0.0))
        if longest == 0.0:
            return 0.0 * self.measure(f)
        value = self.measure(f)
        width = np.array([1.0 / longest])  # no further than the ranges are wide
        along = self._sampled(f, lambda s: (self.q + s[0] * rates, self.v))
        return gradient(along, np.zeros(1), width, value)[0]

    def dM(self) -> UncertainArray:
        """∂M/∂q (n, p, p)."""
        return self.cached("dM", lambda: self.by_q(self.raw("M")))

    def B(self) -> UncertainArray:
        """Bias without gravity (p,)."""
        if not self.functions.bias_has_gravity:
            return self.quantity("bias")
        return self.quantity("bias") - self.gravity()

    def gravity(self) -> UncertainArray:
        """∂U/∂q (p,), along v: as given, else the bias at rest if the bias has gravity, else
        differentiated from U.
        """
        if self.functions.gravity is not None:
            return self.quantity("gravity")
        if self.functions.bias_has_gravity:
            return self.with_velocity(np.zeros(len(self.v))).quantity("bias")
        return self.U_q()

    def U_q(self) -> UncertainArray:
        """∂U/∂q along v (p,)."""
        return self.cached("U_q", lambda: self.S().T @ self.by_q(self.raw("U")))

    def R_v(self) -> UncertainArray:
        """∂R/∂v (p,)."""
        return self.cached("R_v", lambda: self.by_v(self.raw("R")))

    def forces(self) -> UncertainArray:
        """Return Q - gravity - ∂R/∂v (p,), the sum of the terms that are given."""
        return sum(self.parts().values(), exact(np.zeros(len(self.v))))

    def parts(self) -> dict[str, UncertainArray]:
        """Return the terms of `forces`: name -> term (p,)."""
        terms: dict[str, UncertainArray] = {}
        if self.has("Q"):
            terms["Q"] = self.quantity("Q")
        if self.has("gravity") or self.has("U"):
            terms["gravity"] = -self.gravity()
        if self.has("R"):
            terms["damping"] = -self.R_v()
        return terms

    def natural(self) -> bool:
        """Return whether T, where it is given, has quadratic terms in v only."""

        def is_quadratic() -> bool:
            at_rest = self.with_velocity(np.zeros(len(self.v))).quantity("T")
            ahead, back = self.quantity("T"), self.with_velocity(-self.v).quantity("T")
            odd = ahead - back
            return all(abs(x.value) <= C * (x.error + ahead.error) for x in (at_rest, odd))

        return not self.has("T") or self.cached("natural", is_quadratic)

    def even(self) -> bool:
        """Return whether T, where it is given, has no terms linear in v: those of a potential."""
        if self.natural():
            return True
        odd = self.quantity("T") - self.with_velocity(-self.v).quantity("T")
        return bool(np.abs(odd.value) <= C * (odd.error + self.quantity("T").error))

    def rest_energy_changes(self) -> bool:
        """Return whether T(q, 0) changes with q, and T is even in v.

        Then U is in it, or it depends on time.
        """

        def changes() -> bool:
            at_rest = self.with_velocity(np.zeros(len(self.v)))
            slope = at_rest.by_q(at_rest.raw("T"))
            return bool((np.abs(slope.value) > C * slope.error).any())

        if self.natural() or not self.even():
            return False
        return self.cached("T(q, 0) changes", changes)

    def why_not_natural(self) -> str:
        """Return the reason why `natural` is False."""
        return REST_ENERGY if self.rest_energy_changes() else NOT_QUADRATIC

    def consistent(self) -> FunctionState | None:
        """Return a state nearby that keeps the constraints: c(q) = 0 and a v + b = 0.

        None where none is found, or c is given without its Jacobian a.
        """
        if not self.has("a"):
            return None if self.has("c") else self
        return self.cached("consistent", lambda: _consistent_state(self))

    def why_not_consistent(self) -> str:
        """Return the reason why `consistent` is None."""
        if self.has("c") and not self.has("a"):
            return "c is given without a: a would tell which states and motions it allows"
        return "no state is found nearby that keeps the constraints"

    def repeated_constraints(self) -> str:
        """Return which rows of a repeat others, as the end of a sentence; "" if none does."""
        try:
            a = self.caller("a", self.q, self.v) if self.has("a") else np.zeros((0, 1))
            repeated = repeated_rows(a, [f"row {k}" for k in range(len(a))])
        except (BrokenError, np.linalg.LinAlgError):
            return ""
        return f"; rows of a depend on each other: {'; '.join(repeated)}" if repeated else ""

    def free(self) -> Array:
        """Return the directions of v that the constraints leave (p, p - r), or all (p, p)."""
        if not self.has("a"):
            return np.eye(len(self.v))
        a = self.quantity("a").value
        _, singular, rows = np.linalg.svd(a)
        largest = singular.max(initial=0.0)
        rank = int((singular > max(a.shape) * np.finfo(np.float64).eps * largest * C).sum())
        return rows[rank:].T


def _consistent_state(at: FunctionState) -> FunctionState | None:
    """Return a consistent state nearby: Newton's method for q, least squares for v."""
    answers, q = at.caller, at.q
    try:
        if at.has("c") and answers.reads("c") == "q":
            q = _solve_position(at)
            if q is None:
                return None
        a = answers("a", q, at.v)
        b = answers("b", q, at.v) if at.has("b") else 0.0
        inverse, v = np.linalg.pinv(a), at.v
        # The second pass removes the rounding error of the first, large where v becomes small.
        for _ in range(2):
            v = v - inverse @ (a @ v + b)
    except (BrokenError, np.linalg.LinAlgError):
        return None
    return FunctionState(answers, q, v, at.seed)


def _solve_position(at: FunctionState) -> Array | None:
    """Return q (n,) with c(q) = 0, iterated until Newton's method gains nothing; None if it fails.

    The last step is at most `CLOSE`, and the residual no longer decreases.
    """
    answers, q, previous = at.caller, at.q, np.inf
    for _ in range(STEPS):
        c = answers("c", q, at.v)
        residual = float(np.abs(c).max(initial=0.0))
        step = at.S().value @ (np.linalg.pinv(answers("a", q, at.v)) @ c)
        small = float(np.abs(step).max(initial=0.0)) <= CLOSE * max(1.0, float(np.abs(q).max()))
        if small and residual >= previous:
            return q
        q, previous = q - step, residual
    return None


# ---- Derived quantities --------------------------------------------------------------------------

BUILT_IN = "constraints may be built into M, which then does not determine B"
CLOCK = 0.25
"""Half width of the times, s, in which ḃ is differentiated."""


# ---- Mass matrix ---------------------------------------------------------------------------------


def uses_mass_matrix(at: FunctionState) -> bool:
    """Return whether the inertia is M: it is given, and T is not or M has a value at this state."""
    return at.has("M") and (not at.has("T") or at.answering("M"))


def inertia(at: FunctionState) -> UncertainArray:
    """Return the mass matrix (p, p): M if it is given and has a value, else ∂²T/∂v²."""
    return at.quantity("M") if uses_mass_matrix(at) else second_differences(at)


def inertia_rate(at: FunctionState) -> UncertainArray:
    """Return the rate Ṁ (p, p) while q moves along v, of M or else of ∂²T/∂v²."""
    if uses_mass_matrix(at):
        return at.along(at.dM())
    return at.cached("Ṁ of T", lambda: at.rate_of(_second_derivative(at)))


def second_differences(at: FunctionState) -> UncertainArray:
    """Return ∂²T/∂v² (p, p): T is quadratic, so that steps may be as long as the ranges."""

    def second() -> UncertainArray:
        value, size = differences(at.raw("T"), at.q, at.width_v)
        scale, T = np.outer(at.width_v, at.width_v), at.quantity("T")
        # Each entry is a sum of four values of T, with the relative noise of T at this state.
        noisy = float(T.error / T.size) if T.size > 0.0 else EPS
        return UncertainArray(value / scale, noisy * size / scale, size / scale)

    return at.cached("∂²T/∂v²", second)


def inertia_function(at: FunctionState) -> Callable[[Array, Array], Array]:
    """Return the function (q, v) -> mass matrix (p, p): M if it is given, else ∂²T/∂v²."""
    return at.raw("M") if uses_mass_matrix(at) else _second_derivative(at)


def _second_derivative(at: FunctionState) -> Callable[[Array, Array], Array]:
    """Return the function (q, v) -> ∂²T/∂v² (p, p)."""
    T, scale = at.raw("T"), np.outer(at.width_v, at.width_v)
    return lambda q, v: differences(T, q, at.width_v)[0] / scale


def differences(f: Callable[[Array, Array], Array], q: Array, widths: Array) -> tuple[Array, Array]:
    """Return second differences (p, p) of f(q, v) in v, and the sizes of their terms (p, p).

    Args:
        f: function of (q, v), a number.
        q: coordinates (n,).
        widths: steps of the velocities (p,).
    """
    steps, p = np.diag(widths), len(widths)
    at_rest = float(f(q, np.zeros(p)))
    ahead = np.array([float(f(q, step)) for step in steps])
    behind = np.array([float(f(q, -step)) for step in steps])
    second, size = np.diag(ahead + behind - 2.0 * at_rest), np.zeros((p, p))
    sizes = np.maximum(np.abs(ahead), np.abs(behind))
    for i, k in zip(*np.tril_indices(p, -1), strict=True):
        of_both = float(f(q, steps[i] + steps[k]))
        second[i, k] = second[k, i] = of_both - ahead[i] - ahead[k] + at_rest
        size[i, k] = size[k, i] = max(np.max(sizes[[i, k]]), abs(of_both))
    np.fill_diagonal(size, sizes)
    return second, 4.0 * np.maximum(size, abs(at_rest))


# ---- Bias ----------------------------------------------------------------------------------------


def supplied_or_derived_bias(at: FunctionState) -> UncertainArray | None:
    """Return the bias without gravity (p,): as given, else C v, else of M, else of T.

    None if it follows from none of them.
    """
    if at.has("bias"):
        return at.B()
    if at.has("C") and at.natural():
        return at.quantity("C") @ exact(at.v)
    return bias_of_inertia(at)


def bias_of_inertia(at: FunctionState) -> UncertainArray | None:
    """Return the bias (p,) of M or else of T; None where it follows from neither."""
    if uses_mass_matrix(at) and at.natural():
        return bias_of_mass_matrix(at)
    return bias_of_energy(at) if at.has("T") and at.functions.of_lagrange else None


def why_no_bias(at: FunctionState) -> str:
    """Return the reason why `supplied_or_derived_bias` is None."""
    if not at.natural():
        return f"{NOT_QUADRATIC}: bias would tell B"
    if not at.functions.of_lagrange:
        return f"{BUILT_IN}: pass bias or C, or holonomic=True if none are"
    return "M or T determines B only for as many speeds as coordinates: pass bias or C"


def bias_of_mass_matrix(at: FunctionState) -> UncertainArray | None:
    """Return the bias (p,) of M by Lagrange's equations; None where M does not determine it.

    With generalized speeds u, q̇ = S u, the mass matrix of q̇ is S⁻ᵀ M S⁻¹, whose bias b gives
    B = Sᵀ (b + S⁻ᵀ M S⁻¹ Ṡ u).
    """
    if not at.functions.of_lagrange or len(at.q) != len(at.v):
        return None
    if at.functions.qdot is None:
        return _christoffel(at.dM(), exact(at.v))
    return at.cached("B of M", lambda: _bias_along_speeds(at))


def _christoffel(dM: UncertainArray, v: UncertainArray) -> UncertainArray:
    """Return the bias (p,) of the derivatives ∂M_ij/∂q_k, [k, i, j] (p, p, p), and of v (p,)."""
    return contract("kij,j,k->i", dM, v, v) - 0.5 * contract("ijk,j,k->i", dM, v, v)


def bias_along(at: FunctionState, v: Array) -> UncertainArray:
    """Return the bias (p,) of M at another velocity v (p,), where velocities are q̇."""
    return _christoffel(at.dM(), exact(v))


def _bias_along_speeds(at: FunctionState) -> UncertainArray:
    """Return the bias (p,) of M for generalized speeds; see `bias_of_mass_matrix`."""
    mass, S = at.raw("M"), at.S()
    qdot = at.raw("qdot")

    def speeds(q: Array) -> Array:
        return np.array([qdot(q, axis) for axis in np.eye(len(at.v))]).T

    def of_rates(q: Array, v: Array) -> Array:
        back = np.linalg.inv(speeds(q))
        return back.T @ mass(q, v) @ back

    rates = at.rates()
    dM, M = at.by_q(of_rates), at.measure(of_rates)
    Su = at.along(at.by_q(lambda q, v: speeds(q) @ at.v))
    return S.T @ (_christoffel(dM, rates) + M @ Su)


def bias_of_energy(at: FunctionState) -> UncertainArray | None:
    """Return the bias (p,) of T by Lagrange's equations, also of terms linear in v.

    None with `qdot`.
    """
    if at.functions.qdot is not None:
        return None
    T, widths = at.raw("T"), at.width_v
    steps = np.diag(widths)

    def momentum(q: Array, v: Array) -> Array:
        # Exact but for rounding: T is quadratic in v.
        ahead = np.array([float(T(q, v + step)) for step in steps])
        behind = np.array([float(T(q, v - step)) for step in steps])
        return (ahead - behind) / (2.0 * widths)

    return at.cached("B of T", lambda: at.rate_of(momentum) - at.by_q(T))


# ---- Constraints ---------------------------------------------------------------------------------


def supplied_or_derived_drift(at: FunctionState) -> UncertainArray:
    """Return the constraint drift γ (r,): as given, else ȧ v + ḃ."""
    return at.quantity("gamma") if at.has("gamma") else drift_of_jacobian(at)


def drift_of_jacobian(at: FunctionState) -> UncertainArray:
    """Return ȧ v + ḃ (r,), by finite differences of a and b."""

    def rate() -> UncertainArray:
        expected = at.rate_of(at.raw("a")) @ exact(at.v)
        return expected + clock_rate(at) if at.has("b") else expected

    return at.cached("ȧ v + ḃ", rate)


def clock_rate(at: FunctionState) -> UncertainArray:
    """Return ḃ (r,) at t = 0 s."""
    b = at.quantity("b")

    def of_time(t: Array) -> Array:
        return at.caller("b", at.q, at.v, float(t[0]))

    rate = partial(of_time, np.zeros(1), 0, CLOCK, b.error, b.size, b.value)
    return rate + at.rate_of(at.raw("b")) if at.caller.reads("b") == "qt" else rate
