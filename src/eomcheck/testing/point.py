"""The quantities of somebody's functions at one state, each with the error that was measured."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import Array
from eomcheck.testing.answers import Answers, BrokenError
from eomcheck.testing.derivative import gradient
from eomcheck.testing.measured import Measured, contract, exact
from eomcheck.testing.noise import jumps, noise, opposite, size_of
from eomcheck.testing.subject import Functions

FLIPS = 4
"""Least number of choices of signs of v among which the largest entries are looked for."""

STEPS, CLOSE = 50, 1e-10
"""Steps of Newton's method at most, and how small the last one has to be, relative to q."""

NOT_QUADRATIC = "T has terms that are not quadratic in v"
REST_ENERGY = "T(q, 0) changes with q; is the potential energy in it?"


class Point:
    """Quantities at (q, v), each computed on first use.

    Args:
        answers: the functions.
        q: coordinates (n,).
        v: velocities (p,).
        seed: of the directions in which noise is measured.
        reference: what they are compared with, or None.
    """

    def __init__(
        self,
        answers: Answers,
        q: Array,
        v: Array,
        seed: int = 0,
        reference: Functions | None = None,
    ):
        self.answers, self.functions, self.reference = answers, answers.functions, reference
        self.q, self.v, self.seed = q, v, seed
        _, widths = self.functions.half_ranges()
        self.width_q, self.width_v = widths[: len(q)], widths[len(q) :]
        self._kept: dict[Any, Any] = {}

    def kept(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, once."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def answering(self, name: str) -> bool:
        """Return whether the function `name` is given, and answers here."""

        def look() -> bool:
            with suppress(BrokenError):
                self.answers(name, self.q, self.v)
                return True
            return False

        given = self.functions.function(name) is not None
        return given and self.kept(("answers", name), look)

    def has(self, name: str) -> bool:
        """Return whether a quantity can be had: one that is given, or follows at once."""
        if name == "gravity":
            return self.functions.gravity is not None or self.functions.bias_has_gravity
        if name == "against":
            return self.reference is not None
        return self.functions.function(name) is not None

    def moved(self, v: Array) -> Point:
        """Return the same coordinates with another velocity."""
        return self.kept(
            ("v", v.tobytes()), lambda: Point(self.answers, self.q, v, self.seed, self.reference)
        )

    # ---- Black boxes ---------------------------------------------------------------------------

    def raw(self, name: str) -> Callable[[Array, Array], Array]:
        """Return the function `name` of (q, v), NaN where it has no value."""
        here = self.answers(name, self.q, self.v)

        def quiet(q: Array, v: Array) -> Array:
            try:
                return self.answers(name, q, v)
            except BrokenError:
                return np.full(here.shape, np.nan)

        return quiet

    def measure(self, f: Callable[[Array, Array], Array]) -> Measured:
        """Return f(q, v) with the noise it shows, and the size of what cancels in it."""
        n = len(self.q)
        x, width = np.concatenate((self.q, self.v)), np.concatenate((self.width_q, self.width_v))
        value = f(self.q, self.v)
        spread = noise(lambda y: f(y[:n], y[n:]), x, width, self.seed)
        flipped = [size_of(f(self.q, sign * self.v)) for sign in self._signs()]
        size = np.fmax.reduce([size_of(value), *flipped])
        return Measured(value, spread + np.finfo(np.float64).eps * size, size)

    def _signs(self) -> Array:
        """Signs of v (flips, p): any two velocities have opposite ones in one of them.

        So that terms in v_i v_j that cancel at v do not cancel in all.
        """
        signs = opposite(len(self.v))
        more = max(FLIPS - len(signs), 0), len(self.v)
        drawn = np.random.default_rng(self.seed).choice((-1.0, 1.0), more)
        return np.concatenate((signs, drawn))

    def of(self, name: str) -> Measured:
        """Return what the function `name` answers."""

        return self.kept(name, lambda: self.measure(self.raw(name)))

    def jumps(self, name: str) -> bool:
        """Whether the function `name` jumps beside this state, see `eomcheck.testing.noise`."""
        n = len(self.q)
        x, width = np.concatenate((self.q, self.v)), np.concatenate((self.width_q, self.width_v))
        try:
            f = self.raw(name)
        except BrokenError:
            return False
        return jumps(lambda y: f(y[:n], y[n:]), x, width, self.seed)

    def by_q(self, f: Callable[[Array, Array], Array]) -> Measured:
        """Return ∂f/∂q (n, ...)."""
        return gradient(lambda q: f(q, self.v), self.q, self.width_q, self.measure(f))

    def by_v(self, f: Callable[[Array, Array], Array]) -> Measured:
        """Return ∂f/∂v (p, ...)."""
        return gradient(lambda v: f(self.q, v), self.v, self.width_v, self.measure(f))

    # ---- What follows --------------------------------------------------------------------------

    def S(self) -> Measured:
        """∂q̇/∂v (n, p)."""

        def columns(q: Array, v: Array) -> Array:
            qdot = self.raw("qdot")
            return np.array([qdot(q, axis) for axis in np.eye(len(self.v))]).T

        if self.functions.qdot is None:
            return exact(np.eye(len(self.q)))
        return self.kept("S", lambda: self.measure(columns))

    def rates(self) -> Measured:
        """q̇ (n,)."""
        return self.S() @ exact(self.v)

    def along(self, gradient_: Measured) -> Measured:
        """Return the rate of what has the derivatives ∂/∂q (n, ...) while q moves."""
        axes = "abc"[: len(gradient_.shape) - 1]
        return contract(f"n{axes},n->{axes}", gradient_, self.rates())

    def rate_of(self, f: Callable[[Array, Array], Array]) -> Measured:
        """Return the rate of f while q moves as v says and v stays."""
        rates = self.rates().value
        longest = float(np.abs(rates / self.width_q).max(initial=0.0))
        if longest == 0.0:
            return 0.0 * self.measure(f)
        here = self.measure(f)
        width = np.array([1.0 / longest])  # no further than the ranges are wide
        found = gradient(lambda s: f(self.q + s[0] * rates, self.v), np.zeros(1), width, here)
        return found[0]

    def dM(self) -> Measured:
        """∂M/∂q (n, p, p)."""
        return self.kept("dM", lambda: self.by_q(self.raw("M")))

    def B(self) -> Measured:
        """Bias without gravity (p,)."""
        if not self.functions.bias_has_gravity:
            return self.of("bias")
        return self.of("bias") - self.gravity()

    def gravity(self) -> Measured:
        """∂U/∂q (p,), along v: as given, else as `bias` holds it, else differentiated from U."""
        if self.functions.gravity is not None:
            return self.of("gravity")
        if self.functions.bias_has_gravity:
            return self.moved(np.zeros(len(self.v))).of("bias")
        return self.U_q()

    def U_q(self) -> Measured:
        """∂U/∂q along v (p,)."""
        return self.kept("U_q", lambda: self.S().T @ self.by_q(self.raw("U")))

    def R_v(self) -> Measured:
        """∂R/∂v (p,)."""
        return self.kept("R_v", lambda: self.by_v(self.raw("R")))

    def forces(self) -> Measured:
        """Return Q - gravity - ∂R/∂v (p,), of what there is."""
        return sum(self.parts().values(), exact(np.zeros(len(self.v))))

    def parts(self) -> dict[str, Measured]:
        """Return what forces are summed from, by name."""
        found: dict[str, Measured] = {}
        if self.has("Q"):
            found["Q"] = self.of("Q")
        if self.has("gravity") or self.has("U"):
            found["gravity"] = -self.gravity()
        if self.has("R"):
            found["damping"] = -self.R_v()
        return found

    def natural(self) -> bool:
        """Return whether T, where it is given, is quadratic in v and nothing else."""

        def look() -> bool:
            rest = self.moved(np.zeros(len(self.v))).of("T")
            here, back = self.of("T"), self.moved(-self.v).of("T")
            odd = here - back
            return all(abs(x.value) <= C * (x.error + here.error) for x in (rest, odd))

        return not self.has("T") or self.kept("natural", look)

    def even(self) -> bool:
        """Return whether T, where it is given, has no terms linear in v: those of a potential."""
        if self.natural():
            return True
        odd = self.of("T") - self.moved(-self.v).of("T")
        return bool(np.abs(odd.value) <= C * (odd.error + self.of("T").error))

    def rest_energy_changes(self) -> bool:
        """Whether T(q, 0) changes with q, and T is even in v: U is in it, or a clock drives it."""

        def look() -> bool:
            rest = self.moved(np.zeros(len(self.v)))
            slope = rest.by_q(rest.raw("T"))
            return bool((np.abs(slope.value) > C * slope.error).any())

        if self.natural() or not self.even():
            return False
        return self.kept("T(q, 0) changes", look)

    def why_not_natural(self) -> str:
        """Reason why `natural` is False."""
        return REST_ENERGY if self.rest_energy_changes() else NOT_QUADRATIC

    def consistent(self) -> Point | None:
        """Return the point that the constraints let pass: c(q) = 0 and a v + b = 0.

        None where none is found nearby, or c is given without its Jacobian a.
        """
        if not self.has("a"):
            return None if self.has("c") else self
        return self.kept("consistent", lambda: _consistent(self))

    def why_not_consistent(self) -> str:
        """Reason why `consistent` is None."""
        if self.has("c") and not self.has("a"):
            return "c is given without a: a would tell which states and motions it allows"
        return "no state is found nearby that keeps the constraints"

    def free(self) -> Array:
        """Directions of v that the constraints leave (p, p - r), or all of them (p, p)."""
        if not self.has("a"):
            return np.eye(len(self.v))
        a = self.of("a").value
        _, singular, rows = np.linalg.svd(a)
        largest = singular.max(initial=0.0)
        rank = int((singular > max(a.shape) * np.finfo(np.float64).eps * largest * C).sum())
        return rows[rank:].T


def _consistent(at: Point) -> Point | None:
    """Return a consistent point nearby: Newton's method for q, least squares for v."""
    answers, q = at.answers, at.q
    try:
        if at.has("c") and answers.reads("c") == "q":
            q = _closed(at)
            if q is None:
                return None
        a = answers("a", q, at.v)
        b = answers("b", q, at.v) if at.has("b") else 0.0
        inverse, v = np.linalg.pinv(a), at.v
        # The second time what the first one has rounded, which is large where v becomes small.
        for _ in range(2):
            v = v - inverse @ (a @ v + b)
    except (BrokenError, np.linalg.LinAlgError):
        return None
    return Point(answers, q, v, at.seed)


def _closed(at: Point) -> Array | None:
    """Return q (n,) with c(q) = 0, to the last bit that steps of Newton's method still gain."""
    answers, q, left = at.answers, at.q, np.inf
    for _ in range(STEPS):
        c = answers("c", q, at.v)
        residual = float(np.abs(c).max(initial=0.0))
        step = at.S().value @ (np.linalg.pinv(answers("a", q, at.v)) @ c)
        small = float(np.abs(step).max(initial=0.0)) <= CLOSE * max(1.0, float(np.abs(q).max()))
        if small and residual >= left:
            return q
        q, left = q - step, residual
    return None
