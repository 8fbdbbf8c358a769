"""Answers of engines, in the coordinates of their scenes, with their faults and their sizes.

A result that breaks the contract of `Engine` raises `EngineFault`: an exception, a wrong shape, a
value that is not finite. The size of a result is that of the terms that an engine may sum to it and
that cancel: rounding errors are relative to it.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from eomcheck import calls
from eomcheck.calls import call
from eomcheck.descriptions.tree_model import tree_model
from eomcheck.descriptions.tree_quantities import PER_BODY
from eomcheck.engines.engine import Engine, EngineAcceleration, VelocityMap
from eomcheck.engines.isolation import isolation_hint
from eomcheck.errors import CallError, EngineError, InputError, innermost_outside, raised
from eomcheck.evaluation.conformance import QUANTITIES, Quantity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import UNIT_ROUNDOFF, huge_input, largest, rounded
from eomcheck.mechanics.records import Tree
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import printable

OPTIONAL = (
    "forces",
    "constraint_jacobian",
    "constraint_drift",
    "kane_inertia_remainder",
    "acceleration",
    *QUANTITIES,
)
"""Names of the methods that an engine may offer beside M and B."""

ELSEWHERE = 0.25
"""Distance, per size above 1, of the states at which an engine is called before, see
`Answers.provoke_stale_answers`."""

CORIOLIS_RATE = "coriolis_rate"
"""Name by which C + Cᵀ of an engine is asked for: it is not unique otherwise."""

DIFFERENCE = 2.0**-9
"""Step, per size above 1, of the differences of x(q), which may be known to few digits."""

Shape = tuple[int | None, ...]
T = TypeVar("T")


class EngineFault(Exception):
    """Error of an engine that returns no result, or one that breaks its contract.

    Attributes:
        what: description of the fault.
    """

    def __init__(self, what: str):
        self.what = what
        super().__init__(what)


def make_engine(kind: type[Engine], scene: Scene) -> Engine:
    """Return the engine for `scene`.

    Raises:
        EngineFault: it cannot be constructed, though its `represents` is true of the scene.
        EngineError: its library is not installed.
    """
    name = f"{kind.__name__}(scene)"
    return _called(name, name, EngineFault, lambda: kind(scene))


def represents(kind: type[Engine], scene: Scene) -> bool:
    """Return whether an engine reports that it can represent `scene`.

    Raises:
        InputError: it raises an exception instead.
        EngineError: its library is not installed.
    """
    name, what = kind.__name__, f"represents({scene.name})"
    message = f"engine {name}: {what}"
    return _called(f"{name}.represents", message, InputError, lambda: bool(kind.represents(scene)))


def version_of(kind: type[Engine]) -> str:
    """Return name and version of the library of an engine, one line.

    Raises:
        InputError: the engine raises an exception instead, or returns no text.
        EngineError: its library is not installed; the message has the names by which it runs
            in an environment of its own.
    """
    name = kind.__name__
    try:
        version = _called(f"{name}.version", f"engine {name}: version()", InputError, kind.version)
    except EngineError as error:
        raise EngineError(f"{error}{isolation_hint(kind)}") from None
    if not isinstance(version, str) or not version.strip():
        what = repr(version) if isinstance(version, str) else _kind(version)
        raise InputError(f"engine {name}: version() returned {what}, expected a text")
    return printable(version.strip())


def _called(name: str, what: str, fault: type[Exception], function: Callable[[], T]) -> T:
    """Return the result of a function of an engine class; `fault` names `what` and its error."""
    try:
        return call(name, function)
    except EngineError:
        raise
    except Exception as error:
        if isinstance(error, CallError) and not error.by_exception and fault is InputError:
            raise  # no answer: a failure of that code, and no bad input
        raise fault(f"{what} {_describe_error(error)}") from error


class DerivativeMap(NamedTuple):
    """Map of derivatives in velocities w = S v of an engine's own to those in the scene's.

    Attributes:
        S: the matrix S (m, n).
        along: ∂(S v)/∂q (m, n).
        by_v: ∂(Ṡ v)/∂v (m, n).
        moved: ∂ẇ/∂q at constant v̇ (m, n).
        turned: ∂Sᵀ/∂q τ_x (n, n), τ_x the engine's own forces.
        mass_matrix: M_x (m, m); None for derivatives of accelerations.
    """

    S: Array
    along: Array
    by_v: Array
    moved: Array
    turned: Array
    mass_matrix: Array | None

    def to_scene(self, parts: Array) -> Array:
        """Return derivatives in the scene's coordinates (n, k n), side by side, of (m, k m)."""
        S, m, M = self.S, len(self.S), self.mass_matrix
        by_x, by_w = parts[:, :m], parts[:, m : 2 * m]
        by_q = by_x @ S + by_w @ self.along
        if M is not None:
            by_q = self.turned + S.T @ (by_q + M @ self.moved)
            return np.hstack((by_q, S.T @ (by_w @ S + M @ self.by_v)))
        back, by_force = np.linalg.pinv(S), parts[:, 2 * m :]
        by_q = back @ (by_q - by_force @ back.T @ self.turned - self.moved)
        return np.hstack((by_q, back @ (by_w @ S - self.by_v), back @ by_force @ back.T))

    def to_engine(self, parts: Array) -> Array:
        """Return the inverse of `to_scene`: derivatives in the engine's own coordinates, m = n.

        Raises:
            LinAlgError: S is singular.
        """
        S, n, M, back = self.S, len(self.S), self.mass_matrix, np.linalg.inv(self.S)
        by_q, by_v = parts[:, :n], parts[:, n : 2 * n]
        if M is not None:
            by_w = (back.T @ by_v - M @ self.by_v) @ back
            by_x = back.T @ (by_q - self.turned) - M @ self.moved - by_w @ self.along
            return np.hstack((by_x @ back, by_w))
        by_force = S @ parts[:, 2 * n :] @ S.T
        by_w = (S @ by_v + self.by_v) @ back
        by_x = S @ by_q + by_force @ back.T @ self.turned + self.moved - by_w @ self.along
        return np.hstack((by_x @ back, by_w, by_force))


class Answers:
    """Results of an engine at states (q, v, t) of its scene, whatever coordinates it has itself.

    With w = S v and ẇ = S v̇ + Ṡ v in its own coordinates x: M = Sᵀ M_x S, B = Sᵀ (B_x + M_x Ṡ v),
    Q = Sᵀ Q_x, a = a_x S and gamma = gamma_x + a_x Ṡ v.

    All methods raise `EngineFault` where a result breaks the contract.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine):
        self.engine = engine
        self._maps = engine.offers("velocity_map")

    def provoke_stale_answers(self, method: str, *arguments: Any) -> None:
        """Call methods at other states, so that a result that is wrongly cached differs later.

        Before every question, not in a claim of its own: a method that keeps results then fails the
        claim about its quantity, whatever was called before, and in the code that reproduces it.
        For built-in engines a test shows that none is kept.

        `method` itself is called also where half of the digits of q and v agree, eight of
        float64, for which no result may be cached, where only the velocity differs, and last of
        all at the same (q, v) with another link and with another v̇, τ or Q. Results and exceptions
        are ignored.

        Args:
            method: name of the method that is called next.
            arguments: its arguments: q, v, ..., t.
        """
        q, v, *_, t = arguments
        far = _shift(q, ELSEWHERE), _shift(-v / 2, ELSEWHERE)
        for name in ("mass_matrix", "bias"):
            with suppress(Exception):
                self.ask(name, *far, t)
        distance = _near(type(self.engine).unit_roundoff)
        near = _shift(q, distance), _shift(v, distance)
        for position, speed in (far, near, (q, far[1])):
            with suppress(Exception):
                self.ask(method, position, speed, *arguments[2:])
        self._ask_of_another_link(method, arguments)
        self._ask_with_another_third(method, arguments, ELSEWHERE)

    def ask_elsewhere(self, method: str, arguments: Sequence[Any], number: int) -> None:
        """Call a method at another state, one for each number; see `provoke_stale_answers`.

        The link is changed last here, and v̇, τ or Q there: a result that is kept from one call to
        the next, whichever of them it ignores, is wrong after one of both.
        """
        q, v, *others = arguments
        distance = ELSEWHERE * number
        with suppress(Exception):
            self.ask(method, _shift(q, distance), _shift(-v / 2, distance), *others)
        self._ask_with_another_third(method, arguments, distance)
        self._ask_of_another_link(method, arguments)

    def _ask_with_another_third(
        self, method: str, arguments: Sequence[Any], distance: float
    ) -> None:
        """Call a method at the same (q, v) with another v̇, τ or Q, if it takes one."""
        q, v, *others = arguments
        one = QUANTITIES.get(method)
        if len(others) > 1 and (one is None or {"vdot", "tau"} & set(one.arguments)):
            with suppress(Exception):
                self.ask(method, q, v, _shift(others[0], distance), *others[1:])

    def _ask_of_another_link(self, method: str, arguments: Sequence[Any]) -> None:
        """Call the method of a frame with the same arguments for the next link that is known."""
        if method not in QUANTITIES or not QUANTITIES[method].of_frame:
            return
        q, v, third, frame, t = arguments
        model = tree_model(self.engine.scene)
        links = () if model is None else model.links
        after = links.index(frame) + 1 if frame in links else 0
        for link in (*links[after:], *links[:after]):
            if link != frame and self.has_frame(link):
                # Another v̇ first: a result kept whatever v̇ is has to be wrong for this link too.
                for other in (_shift(third, ELSEWHERE), third):
                    with suppress(Exception):
                        self.ask(method, q, v, other, link, t)
                return

    def ask(self, method: str, *arguments: Any) -> Any:
        """Return the result of the method of this name, with arguments q, v, ..., t.

        Those of a conformance quantity are q, v, v̇ or τ, the name of a link or "", and t.
        """
        if method == "mass_matrix":
            return self.mass_matrix(arguments[0], arguments[-1])
        if method == CORIOLIS_RATE:
            return self.coriolis_rate(arguments[0], arguments[1], arguments[-1])
        if method in QUANTITIES:
            return self.quantity(QUANTITIES[method], *arguments)
        return getattr(self, method)(*arguments)

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v); q itself, the identity and zeros where the engine has none."""
        n = self.engine.scene.n
        parts = self._call("velocity_map", q, v)
        try:
            x, S, rest = parts
        except (TypeError, ValueError):
            raise EngineFault(
                f"velocity_map returned {_kind(parts)}, expected (x, S, Ṡ v)"
            ) from None
        S = _checked("velocity_map: S", S, (None, n))
        x = _checked("velocity_map: x", x, (None,))
        return VelocityMap(x, S, _checked("velocity_map: Ṡ v", rest, (len(S),)))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return the mass matrix M (n, n)."""
        S = self.velocity_map(q, np.zeros_like(q)).S
        M = self._own_mass_matrix(q, t)
        return S.T @ M @ S if self._maps else M

    def own_terms(self, q: Array, v: Array, t: float = 0.0) -> tuple[VelocityMap, Array, Array]:
        """Return (x, S, Ṡ v), M_x (m, m) and B_x (m,), in the engine's own coordinates."""
        x, S, rest = self.velocity_map(q, v)
        M = self._ask_checked("mass_matrix", (len(S),) * 2, x, t)
        return VelocityMap(x, S, rest), M, self._ask_checked("bias", (len(S),), x, S @ v, t)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the bias B (n,)."""
        x, S, rest = self.velocity_map(q, v)
        B = self._ask_checked("bias", (len(S),), x, S @ v, t)
        if rest.any():
            B = B + self._ask_checked("mass_matrix", (len(S),) * 2, x, t) @ rest
        return S.T @ B

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the forces Q (n,)."""
        x, S, _ = self.velocity_map(q, v)
        return S.T @ self._ask_checked("forces", (len(S),), x, S @ v, t)

    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the constraint Jacobian a (r, n)."""
        x, S, _ = self.velocity_map(q, v)
        return self._jacobian(x, S, S @ v, t) @ S

    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return the constraint drift gamma (r,)."""
        x, S, rest = self.velocity_map(q, v)
        drift = self._ask_checked("constraint_drift", (self.engine.scene.r,), x, S @ v, t)
        return drift + self._jacobian(x, S, S @ v, t) @ rest if rest.any() else drift

    def kane_inertia_remainder(
        self, q: Array, v: Array, t: float = 0.0
    ) -> tuple[Array, float, float]:
        """Return (N_Kane q̇ + G_Kane (p,), size, condition); generalized speeds are the scene's."""
        x, S, _ = self.velocity_map(q, v)
        remainder, size, condition = self._call("kane_inertia_remainder", x, S @ v, t)
        shape = (self.engine.scene.p,)
        return _checked("kane_inertia_remainder", remainder, shape), float(size), float(condition)

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ (n,) and λ (r,) or None; Q, a and gamma are the scene's."""
        x, S, rest = self.velocity_map(q, v)
        w, back = S @ v, np.linalg.pinv(S) if self._maps else S
        if self._maps:
            Q = back.T @ Q
            if a is not None and gamma is not None:
                a = a @ back
                gamma = gamma - a @ rest
        result = self._call("acceleration", x, w, Q, a, gamma, t)
        try:
            wdot, multipliers = result
        except (TypeError, ValueError):
            message = f"acceleration returned {_kind(result)}, expected (v̇, λ or None)"
            raise EngineFault(message) from None
        vdot = _checked("acceleration: v̇", wdot, (len(S),))
        if multipliers is not None:
            multipliers = _checked("acceleration: λ", multipliers, (self.engine.scene.r,))
        return EngineAcceleration(back @ (vdot - rest) if self._maps else vdot, multipliers)

    def quantity(
        self, one: Quantity, q: Array, v: Array, third: Array, frame: str, t: float = 0.0
    ) -> Array:
        """Return a conformance quantity in the scene's coordinates.

        That of a Coriolis matrix is C v (n,), because C is not unique.

        Args:
            one: the quantity.
            q: coordinates (n,).
            v: velocities (n,).
            third: v̇ (n,), or τ (n,) of forward dynamics.
            frame: name of the link, "" for quantities of none.
            t: time, s.
        """
        if one.mapping == "invariant":
            return one.up_to_constant(
                lambda x: self._own_quantity(one, x, v, third, frame, t)[0], q
            )
        if one.mapping == "derivatives":
            return self._derivatives(one, q, v, third, t)
        value, S, rest = self._own_quantity(one, q, v, third, frame, t)
        if one.name == "coriolis_matrix":
            force = S.T @ (value @ (S @ v))
            return force + S.T @ (self._own_mass_matrix(q, t) @ rest) if rest.any() else force
        if not self._maps:
            return value
        if one.mapping in ("force", "rows"):
            return S.T @ value
        if one.mapping == "jacobian":
            return value @ S
        if one.mapping == "bias":
            if not rest.any():
                return value
            jacobian, _, _ = self._own_quantity(QUANTITIES[one.companion], q, v, third, frame, t)
            return value + jacobian @ rest
        back = np.linalg.pinv(S)
        if one.mapping == "inverse":
            return back @ value @ back.T
        return back @ (value - rest)  # an acceleration

    def coriolis_rate(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return C + Cᵀ (n, n) of the Coriolis matrix Sᵀ C_x S + Sᵀ M_x Ṡ."""
        one = QUANTITIES["coriolis_matrix"]
        C, S, _ = self._own_quantity(one, q, v, np.zeros_like(v), "", t)
        if self._maps:
            units = np.eye(self.engine.scene.n)
            rate = np.column_stack([self.map_derivatives(q, unit)[0] @ v for unit in units])
            C = S.T @ (C @ S + self._own_mass_matrix(q, t) @ rate)
        return C + C.T

    def has_frame(self, frame: str) -> bool:
        """Return whether the engine has the frame of a link; True where it raises instead.

        Its answers about the frame then fail by themselves.
        """
        try:
            return bool(self._call("has_frame", frame))
        except EngineFault:
            return True

    @cached_property
    def _parameter_count(self) -> int:
        """Number of parameters of a regressor."""
        model = tree_model(self.engine.scene)
        return 0 if model is None else PER_BODY * len(model.bodies)

    def _own_mass_matrix(self, q: Array, t: float) -> Array:
        """Return the mass matrix in the engine's own coordinates."""
        x, S, _ = self.velocity_map(q, np.zeros_like(q))
        return self._ask_checked("mass_matrix", (len(S),) * 2, x, t)

    def _own_quantity(
        self, one: Quantity, q: Array, v: Array, third: Array, frame: str, t: float
    ) -> tuple[Array, Array, Array]:
        """Return a quantity in the engine's own coordinates, with S and Ṡ v."""
        x, S, rest = self.velocity_map(q, v)
        w = S @ v
        if "tau" in one.arguments:
            third = np.linalg.pinv(S).T @ third if self._maps else third
        elif self._maps:
            third = S @ third + rest
        values = {"f": frame, "q": x, "v": w, "vdot": third, "tau": third}
        m = len(S)
        sizes = {"n": m, "2n": 2 * m, "3n": 3 * m, "p": self._parameter_count}
        sizes["r"] = self.engine.scene.r
        shape = tuple(sizes.get(size, size) for size in one.shape)  # type: ignore[arg-type]
        result = self._call(one.name, *(values[name] for name in one.arguments), t)
        if one.name == "frame_placement":
            result = self._placement(result)
        elif one.mapping == "derivatives":
            size = shape[0], m
            result = self._beside(one.name, result, shape[1] // m, size)  # type: ignore[operator]
        elif not shape:
            result = np.asarray(result) if isinstance(result, float | int) else result
        return _checked(one.name, result, shape), S, rest  # type: ignore[arg-type]

    def _derivatives(self, one: Quantity, q: Array, v: Array, third: Array, t: float) -> Array:
        """Return derivatives of inverse or forward dynamics, one beside the other (n, k n)."""
        parts, S, _ = self._own_quantity(one, q, v, third, "", t)
        if not self._maps:
            return parts
        if one.name == "constraint_force_derivatives":
            m = len(S)
            return np.hstack((parts[:, :m] @ S, parts[:, m:] @ S))
        return self.derivative_map(one, q, v, third, t).to_scene(parts)

    def derivative_map(
        self, one: Quantity, q: Array, v: Array, third: Array, t: float = 0.0
    ) -> DerivativeMap:
        """Return the map of derivatives of inverse or forward dynamics to the scene's coordinates.

        Args:
            one: the quantity, `inverse_dynamics_derivatives` or `forward_dynamics_derivatives`.
            q: coordinates (n,).
            v: velocities (n,).
            third: v̇ (n,), or τ (n,) of forward dynamics.
            t: time, s.
        """
        S = self.velocity_map(q, v).S
        changes = [self.map_derivatives(q, unit)[0] for unit in np.eye(self.engine.scene.n)]
        along, more = self.map_derivatives(q, v)
        # ∂(Ṡ v)/∂v = Ṡ + ∂(S v)/∂q
        by_v = np.column_stack([change @ v for change in changes]) + along
        if one.name == "inverse_dynamics_derivatives":
            torques = self._own_quantity(QUANTITIES["inverse_dynamics"], q, v, third, "", t)[0]
            moved = self.map_derivatives(q, third)[0] + more
            turned = np.stack([torques @ x for x in changes])
            return DerivativeMap(S, along, by_v, moved, turned, self._own_mass_matrix(q, t))
        vdot = self.quantity(QUANTITIES["forward_dynamics"], q, v, third, "", t)
        moved = self.map_derivatives(q, vdot)[0] + more
        turned = np.stack([(np.linalg.pinv(S).T @ third) @ x for x in changes])
        return DerivativeMap(S, along, by_v, moved, turned, None)

    def map_derivatives(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return ∂(S v)/∂q and ∂(Ṡ v)/∂q (m, n) each."""
        parts = self._call("velocity_map_derivatives", q, v)
        try:
            along, more = parts
        except (TypeError, ValueError):
            message = f"velocity_map_derivatives returned {_kind(parts)}, expected two arrays"
            raise EngineFault(message) from None
        shape = (None, self.engine.scene.n)
        along = _checked("velocity_map_derivatives: ∂(S v)/∂q", along, shape)
        return along, _checked("velocity_map_derivatives: ∂(Ṡ v)/∂q", more, along.shape)

    def _beside(self, method: str, result: Any, count: int, size: Shape) -> Array:
        """Return a number of matrices of this size one beside the other, as it may be itself."""
        if isinstance(result, np.ndarray) and result.ndim == 2:
            return _checked(method, result, (size[0], count * (size[1] or 0)))
        if not isinstance(result, tuple | list | np.ndarray) or len(result) != count:
            message = f"{method} returned {_kind(result)}, expected {count} arrays"
            raise EngineFault(message)
        return np.hstack([_checked(method, x, size) for x in result])

    def _placement(self, result: Any) -> Array:
        """Return (R, p) as [R p] (3, 4), as it may be itself."""
        if isinstance(result, np.ndarray) and result.ndim == 2:
            return _checked("frame_placement", result, (3, 4))
        try:
            R, p = result
        except (TypeError, ValueError):
            message = f"frame_placement returned {_kind(result)}, expected (R, p)"
            raise EngineFault(message) from None
        R = _checked("frame_placement: R", R, (3, 3))
        return np.column_stack([R, _checked("frame_placement: p", p, (3,))])

    def _jacobian(self, x: Array, S: Array, w: Array, t: float) -> Array:
        return self._ask_checked("constraint_jacobian", (self.engine.scene.r, len(S)), x, w, t)

    def _ask_checked(self, method: str, shape: Shape, *arguments: Any) -> Array:
        return _checked(method, self._call(method, *arguments), shape)

    def _call(self, method: str, *arguments: Any) -> Any:
        arguments = tuple(map(self._rounded, arguments))
        handed = [np.array(x) if isinstance(x, np.ndarray) else x for x in arguments]
        function: Callable[..., Any] = getattr(self.engine, method)
        try:
            result = call(f"{type(self.engine).__name__}.{method}", function, *handed)
        except Exception as error:
            raise EngineFault(f"{method} {_describe_error(error, function)}") from error
        for after, before in zip(handed, arguments, strict=True):
            if isinstance(after, np.ndarray) and not np.array_equal(after, before, equal_nan=True):
                raise EngineFault(f"{method} changes an array that it is handed")
        return result

    def _rounded(self, x: Any) -> Any:
        """Return an argument rounded to the numbers of the engine; a name stays as it is."""
        u = type(self.engine).unit_roundoff
        if u <= UNIT_ROUNDOFF or not isinstance(x, np.ndarray | float):
            return x
        return rounded(x, u) if isinstance(x, np.ndarray) else float(rounded(x, u))


def own_input_sizes(engine: Engine, q: Array, v: Array) -> tuple[Array, Array] | None:
    """Return the sizes of q (n,) and v (n,) to which an engine's own rounding is relative.

    An engine rounds its own x(q) and w = S v: this changes q by X⁺ |x| u and v by S⁺ |w| u, where
    X = ∂x/∂q, by differences. None without coordinates of its own.

    Raises:
        EngineFault: its `velocity_map` breaks the contract.
    """
    if not engine.offers("velocity_map"):
        return None
    answers = Answers(engine)
    x, S, _ = answers.velocity_map(q, v)
    X = np.zeros((len(x), len(q)))
    for k, step in enumerate(DIFFERENCE * np.maximum(1.0, np.abs(q))):
        sides = []
        for signed in (step, -step):
            shifted = np.array(q)
            shifted[k] += signed
            sides.append((answers.velocity_map(shifted, v).x - x) / (shifted[k] - q[k]))
        # Quaternions may change their sign between two states, angles jump by a turn.
        X[:, k] = min(sides, key=largest)
    back = np.abs(np.linalg.pinv(X)), np.abs(np.linalg.pinv(S))
    return back[0] @ np.abs(x), back[1] @ np.abs(S @ v)


def _near(unit_roundoff: float) -> float:
    """Return the distance, per size above 1, of states that agree in half of their digits.

    A cache by rounded numbers takes them for the same: 2⁻²⁶ in float64.
    """
    return float(np.sqrt(2.0 * unit_roundoff))


def _shift(x: Array, distance: float) -> Array:
    """Return numbers (n,) at `distance` from x, per size above 1, differences changed too."""
    shares = (-1.0) ** np.arange(x.size) * np.linspace(1.0, 0.5, x.size)
    return x + distance * shares * np.maximum(1.0, np.abs(x))


def _describe_error(error: Exception, function: Callable[..., Any] | None = None) -> str:
    """Return the description of an error in an engine, with its line.

    A function that does not take the arguments raises none of its lines: then it is its first.
    """
    through = traceback.extract_tb(error.__traceback__)
    code = getattr(function, "__code__", None)
    if code is not None and through[-1].filename == calls.__file__:
        through.append(traceback.FrameSummary(code.co_filename, code.co_firstlineno, code.co_name))
    outside = innermost_outside(through)
    if isinstance(error, CallError) and outside is None:
        return raised(error, None)
    return raised(error, outside or through[-1])


def _kind(value: Any) -> str:
    """Return the type of a value with its article: "a list", "an int", "None"."""
    if value is None:
        return "None"
    name = type(value).__name__
    return f"a{'n' if name[0] in 'aeiouAEIO' else ''} {name}"


def _checked(method: str, value: Any, shape: Shape) -> Array:
    """Return a result as a new float64 array.

    Raises:
        EngineFault: it is no array, of another shape, not of real numbers, or not finite.
    """
    wanted = ", ".join("any" if x is None else str(x) for x in shape)
    expected = f"expected an array of shape ({wanted})"
    try:
        array = np.asarray(value) if hasattr(value, "__array__") else None
        masked = bool(np.ma.is_masked(value))
    except Exception as error:
        raise EngineFault(
            f"{method} returned {_kind(value)}, which {_describe_error(error)}"
        ) from error
    if array is None:
        raise EngineFault(f"{method} returned {_kind(value)}, {expected}")
    if masked:
        raise EngineFault(f"{method} returned a masked array, of which entries are masked")
    if len(array.shape) != len(shape) or any(
        want not in (None, have) for have, want in zip(array.shape, shape, strict=True)
    ):
        raise EngineFault(f"{method} returned an array of shape {array.shape}, {expected}")
    if array.dtype.kind not in "fiu":
        raise EngineFault(f"{method} returned an array of {array.dtype}, expected real numbers")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise EngineFault(f"{method} returned {array[where]} in entry {list(where)}")
    return np.array(array, np.float64)


def overflows(at: Evaluation) -> bool:
    """Return whether the state or the scene is so large that products of it overflow."""
    numbers = [x for x in at.parameters if x is not None] + [at.q, at.v]
    return max(largest(x) for x in numbers) > huge_input(at.unit_roundoff)


def inertia_size(at: Evaluation) -> float:
    """Return the size of the inertia forces ω × p that an engine may sum to B, N or N m.

    It is the product of the momenta |M| |v| and the sum of all rates of angles. In frames that turn
    with the bodies these forces appear and cancel, also where B itself is small or vanishes: B is
    independent of the velocity at which the whole scene translates. For a scene that names no
    angles all velocities count.
    """
    return turning_rate(at) * largest(np.abs(at.terms.M) @ np.abs(at.v))


def drift_size(at: Evaluation) -> float:
    """Return the size of the terms that an engine may sum to gamma, m/s².

    These are rates of the constraints in frames that turn: translations appear in them and cancel,
    and so do rotations about an axis of which a constraint is independent.
    """
    if at.terms.a is None:
        return 0.0
    turning, speeds = turning_rate(at), np.abs(at.v)
    speeds[_angles(at)] = turning
    return turning * largest(np.abs(at.terms.a) @ speeds)


def turning_rate(at: Evaluation) -> float:
    """Return the largest angular velocity of any body, rad/s: the sum of all rates of angles."""
    return float(np.abs(at.v)[_angles(at)].sum())


def _angles(at: Evaluation) -> slice:
    """Return the slice of velocities that may be rates of angles: all if the scene names none."""
    named = at.scene.angle_coordinates
    return named if at.v[named].size else slice(None)


def mass_size(at: Evaluation, S: Array) -> float:
    """Return the size of the terms that Sᵀ M_x S sums to M, kg m² or the like; 0 if S = 1.

    Relative angles move all bodies behind, whose terms cancel in M.
    """
    if np.array_equal(S, np.eye(at.scene.n)):
        return 0.0
    back, across = np.linalg.pinv(S), np.abs(S)
    return largest(across.T @ np.abs(back.T @ at.terms.M @ back) @ across)


def weight_size(at: Evaluation) -> float:
    """Return the size of the moments of weights that an engine may sum to Q, N or N m.

    It is the weight of all bodies times their largest distance from a joint along the tree. About
    axes without a moment of gravity such moments appear in frames that turn, and cancel. 0 for a
    scene that is no tree, or has no gravity.
    """
    tree = at.scene.tree()
    return 0.0 if tree is None else float(np.linalg.norm(tree.gravity)) * at.cached(mass_moment)


def turning_size(at: Evaluation) -> float:
    """Return the size of the centrifugal forces of arms in the world, N or N m.

    Arms of a body are differences of positions in the world, whose rounding is relative to the
    distances along the tree: forces m ω² r of a centre of mass on its axis vanish but for it. A
    body turns by all joints on its path, whatever turns elsewhere. 0 for a scene that is no tree.
    """
    tree = at.scene.tree()
    if tree is None:
        return 0.0
    rates = np.abs(tree.coordinates @ at.v) * ~_slides(tree)
    for j, parent in enumerate(tree.parent):
        rates[j] += rates[parent] if parent >= 0 else 0.0
    return float(tree.mass @ rates**2) * _longest_arm(at, tree)


def mass_moment(at: Evaluation) -> float:
    """Return the mass of all bodies times their largest distance along the tree, kg m.

    For a sliding joint the force is the weight itself, an arm of 1. 0 for a scene that is no tree.
    """
    tree = at.scene.tree()
    if tree is None:
        return 0.0
    return float(np.sum(tree.mass)) * max(_longest_arm(at, tree), float(_slides(tree).any()))


def _slides(tree: Tree) -> Array:
    """Return whether each joint slides (n_j,)."""
    return np.array([kind[0] == "p" for kind in tree.joint])


def composite_inertia(at: Evaluation) -> float:
    """Return the sum of all moments of inertia about the world's origin at most, kg m².

    Mass matrices of relative coordinates have entries of this size. Those of absolute ones may be
    much smaller where the bodies far away are moved by coordinates of their own. 0 without a tree.
    """
    tree = at.scene.tree()
    if tree is None:
        return 0.0
    moments = float(np.abs(tree.inertia).max(axis=(1, 2), initial=0.0).sum())
    return float(tree.mass @ _arms(at, tree) ** 2) + moments


def _longest_arm(at: Evaluation, tree: Tree) -> float:
    """Return the largest distance along the tree from the world's origin to a centre of mass, m."""
    return largest(_arms(at, tree)[tree.mass > 0])


def _arms(at: Evaluation, tree: Tree) -> Array:
    """Return the distances along the tree from the world's origin to the centres of mass, m."""
    reach = np.abs(tree.coordinates @ at.q + tree.shift) * _slides(tree)
    reach += np.linalg.norm(tree.offset, axis=1)
    for j, parent in enumerate(tree.parent):
        reach[j] += reach[parent] if parent >= 0 else 0.0
    return reach + np.linalg.norm(tree.center, axis=1)


def represented(
    engines: Sequence[type[Engine]], scenes: Sequence[type[Scene]]
) -> tuple[type[Scene], ...]:
    """Return the scene classes of which one of `engines` represents at least a small scene.

    Raises:
        InputError: there is none, or `represents` of an engine raises.
    """
    kinds = tuple(
        kind for kind in scenes if any(represents_some(engine, kind) for engine in engines)
    )
    if not kinds:
        who, what = (", ".join(kind.key for kind in x) for x in (engines, scenes))
        raise InputError(f"engine {who} represents none of the scenes {what}")
    return kinds


def represents_some(engine: type[Engine], kind: type[Scene]) -> bool:
    """Return whether an engine represents at least a small scene of a scene class.

    Raises:
        InputError: `represents` of the engine raises.
    """
    return any(represents(engine, scene) for scene in _small_scenes(kind))


def _small_scenes(kind: type[Scene]) -> Iterator[Scene]:
    """Yield small scenes of a class."""
    for links in (1, 2, 3) if kind.has_links else (None,):
        with suppress(InputError):  # no scene of the class has so many links
            yield from kind.structures(links)
