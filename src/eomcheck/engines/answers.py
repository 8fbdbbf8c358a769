"""Answers of an engine, mapped to the scene's coordinates, their faults and their sizes.

An `EngineFault` is an answer that is none of the kind that the contract asks for. The size of an
answer is that of the terms that an engine may sum to it and that cancel: rounding is measured by
these.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from eomcheck import calls
from eomcheck.calls import call
from eomcheck.engines.engine import Engine, EngineAcceleration, VelocityMap
from eomcheck.errors import CallError, EngineError, InputError, raised
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import HUGE, largest
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import printable

ELSEWHERE = 0.25
"""How far off the states are at which an engine is asked before, per size above 1, see
`Answers.provoke_stale_answers`."""
NEAR = 2.0**-26
"""How far off those are that a cache by rounded numbers takes for the same, per size above 1."""

Shape = tuple[int | None, ...]


class EngineFault(Exception):
    """An engine gives no answer, or none of the kind that its contract says.

    Attributes:
        what: what it did.
    """

    def __init__(self, what: str):
        self.what = what
        super().__init__(what)


def make_engine(kind: type[Engine], scene: Scene) -> Engine:
    """Return the engine for `scene`.

    Raises:
        EngineFault: it cannot be made, though it says that it represents the scene.
        EngineError: its library is not installed.
    """
    try:
        return call(f"{kind.__name__}(scene)", kind, scene)
    except EngineError:
        raise
    except Exception as error:
        raise EngineFault(f"{kind.__name__}(scene) {_raised(error)}") from error


def represents(kind: type[Engine], scene: Scene) -> bool:
    """Return whether an engine says that it can represent `scene`.

    Raises:
        InputError: it raises an exception instead.
        EngineError: its library is not installed.
    """
    try:
        return bool(call(f"{kind.__name__}.represents", kind.represents, scene))
    except EngineError:
        raise
    except Exception as error:
        said = f"engine {kind.__name__}: represents({scene.name}) {_raised(error)}"
        raise InputError(said) from error


def version_of(kind: type[Engine]) -> str:
    """Return name and version of the library of an engine, one line.

    Raises:
        InputError: the engine raises an exception instead, or returns no text.
        EngineError: its library is not installed.
    """
    try:
        found = call(f"{kind.__name__}.version", kind.version)
    except EngineError:
        raise
    except Exception as error:
        raise InputError(f"engine {kind.__name__}: version() {_raised(error)}") from error
    if not isinstance(found, str) or not found.strip():
        what = repr(found) if isinstance(found, str) else _kind(found)
        raise InputError(f"engine {kind.__name__}: version() returned {what}, expected a text")
    return printable(found.strip())


class Answers:
    """An engine asked at states (q, v, t) of its scene, whatever coordinates it has itself.

    With w = S v and ẇ = S v̇ + Ṡ v in its own coordinates x: M = Sᵀ M_x S, B = Sᵀ (B_x + M_x Ṡ v),
    Q = Sᵀ Q_x, a = a_x S and gamma = gamma_x + a_x Ṡ v.

    All methods raise `EngineFault` where an answer is not what the contract says.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine):
        self.engine = engine
        self._maps = engine.offers("velocity_map")

    def provoke_stale_answers(self, method: str, *arguments: Any) -> None:
        """Ask at other states, so that an answer that is kept where it should not be shows.

        Of our own engines a test says that nothing is.

        By `method` itself also where q and v differ in the eighth digit, for which no answer may
        be kept, and last of all where only the velocity is another one. What comes of it does not
        matter.

        Args:
            method: the method that is asked next.
            arguments: what it is handed: q, v, ..., t.
        """
        q, v, *_, t = arguments
        other = _away(q, ELSEWHERE), _away(-v / 2, ELSEWHERE)
        for name in ("mass_matrix", "bias"):
            with suppress(Exception):
                self.ask(name, *other, t)
        near = _away(q, NEAR), _away(v, NEAR)
        for there, speed in (other, near, (q, other[1])):
            with suppress(Exception):
                self.ask(method, there, speed, *arguments[2:])

    def ask_elsewhere(self, method: str, arguments: Sequence[Any], number: int) -> None:
        """Ask at another state, of which there is one for each number; see
        `provoke_stale_answers`.
        """
        q, v, *rest = arguments
        by = ELSEWHERE * number
        with suppress(Exception):
            self.ask(method, _away(q, by), _away(-v / 2, by), *rest)

    def ask(self, method: str, *arguments: Any) -> Any:
        """Return what the engine says by the method of this name, handed q, v, ..., t."""
        if method == "mass_matrix":
            return self.mass_matrix(arguments[0], arguments[-1])
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
        """Return M (n, n)."""
        x, S, _ = self.velocity_map(q, np.zeros_like(q))
        M = self._asked("mass_matrix", (len(S),) * 2, x, t)
        return S.T @ M @ S if self._maps else M

    def own_terms(self, q: Array, v: Array, t: float = 0.0) -> tuple[VelocityMap, Array, Array]:
        """Return (x, S, Ṡ v), M_x (m, m) and B_x (m,), in the engine's own coordinates."""
        x, S, rest = self.velocity_map(q, v)
        M = self._asked("mass_matrix", (len(S),) * 2, x, t)
        return VelocityMap(x, S, rest), M, self._asked("bias", (len(S),), x, S @ v, t)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,)."""
        x, S, rest = self.velocity_map(q, v)
        B = self._asked("bias", (len(S),), x, S @ v, t)
        if rest.any():
            B = B + self._asked("mass_matrix", (len(S),) * 2, x, t) @ rest
        return S.T @ B

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (n,)."""
        x, S, _ = self.velocity_map(q, v)
        return S.T @ self._asked("forces", (len(S),), x, S @ v, t)

    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return a (r, n)."""
        x, S, _ = self.velocity_map(q, v)
        return self._jacobian(x, S, S @ v, t) @ S

    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return gamma (r,)."""
        x, S, rest = self.velocity_map(q, v)
        drift = self._asked("constraint_drift", (self.engine.scene.r,), x, S @ v, t)
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
            said = f"acceleration returned {_kind(result)}, expected (v̇, λ or None)"
            raise EngineFault(said) from None
        vdot = _checked("acceleration: v̇", wdot, (len(S),))
        if multipliers is not None:
            multipliers = _checked("acceleration: λ", multipliers, (self.engine.scene.r,))
        return EngineAcceleration(back @ (vdot - rest) if self._maps else vdot, multipliers)

    def _jacobian(self, x: Array, S: Array, w: Array, t: float) -> Array:
        return self._asked("constraint_jacobian", (self.engine.scene.r, len(S)), x, w, t)

    def _asked(self, method: str, shape: Shape, *arguments: Any) -> Array:
        return _checked(method, self._call(method, *arguments), shape)

    def _call(self, method: str, *arguments: Any) -> Any:
        handed = [np.array(x) if isinstance(x, np.ndarray) else x for x in arguments]
        function: Callable[..., Any] = getattr(self.engine, method)
        try:
            result = call(f"{type(self.engine).__name__}.{method}", function, *handed)
        except Exception as error:
            raise EngineFault(f"{method} {_raised(error)}") from error
        for here, before in zip(handed, arguments, strict=True):
            if isinstance(here, np.ndarray) and not np.array_equal(here, before, equal_nan=True):
                raise EngineFault(f"{method} changes an array that it is handed")
        return result


def _away(x: Array, by: float) -> Array:
    """Return numbers (n,) that are `by` away from x, per size above 1, and so are differences."""
    shares = (-1.0) ** np.arange(x.size) * np.linspace(1.0, 0.5, x.size)
    return x + by * shares * np.maximum(1.0, np.abs(x))


def _raised(error: Exception) -> str:
    """Return what an engine raised, and in which line."""
    through = traceback.extract_tb(error.__traceback__)
    theirs = [x for x in through if not _is_library(Path(x.filename))]
    if isinstance(error, CallError) and not theirs:
        return raised(error, None)
    return raised(error, (theirs or through)[-1])


def _is_library(path: Path) -> bool:
    """Return whether a file is ours, or of an installed package."""
    ours = path.parent == Path(__file__).parent or path == Path(calls.__file__)
    return ours or "site-packages" in path.parts


def _kind(value: Any) -> str:
    """Return what a value is, with its article: "a list", "an int", "None"."""
    if value is None:
        return "None"
    name = type(value).__name__
    return f"a{'n' if name[0] in 'aeiouAEIO' else ''} {name}"


def _checked(method: str, value: Any, shape: Shape) -> Array:
    """Return an answer as a new array of doubles.

    Raises:
        EngineFault: it is no array, of another shape, not of real numbers, or not finite.
    """
    wanted = ", ".join("any" if x is None else str(x) for x in shape)
    expected = f"expected an array of shape ({wanted})"
    try:
        array = np.asarray(value) if hasattr(value, "__array__") else None
        masked = bool(np.ma.is_masked(value))
    except Exception as error:
        raise EngineFault(f"{method} returned {_kind(value)}, which {_raised(error)}") from error
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
    return max(largest(x) for x in numbers) > HUGE


def inertia_size(at: Evaluation) -> float:
    """Return the size of the inertia forces ω × p that an engine may sum to B, N or N m.

    Momenta |M| |v| times all rates of angles. In frames that turn with the bodies these forces
    appear and cancel, also where B itself is small or vanishes: B does not depend on how fast the
    whole scene translates. Of a scene that names no angles all velocities count.
    """
    return _turning(at) * largest(np.abs(at.terms.M) @ np.abs(at.v))


def drift_size(at: Evaluation) -> float:
    """Return the size of what an engine may sum to gamma, m/s².

    Rates of the constraints in frames that turn: what translates appears in them and cancels, and
    so does what turns about an axis that a constraint does not feel.
    """
    if at.terms.a is None:
        return 0.0
    turning, speeds = _turning(at), np.abs(at.v)
    speeds[_angles(at)] = turning
    return turning * largest(np.abs(at.terms.a) @ speeds)


def _turning(at: Evaluation) -> float:
    """Return how fast anything may turn, rad/s."""
    return float(np.abs(at.v)[_angles(at)].sum())


def _angles(at: Evaluation) -> slice:
    """Return which velocities may be rates of angles: all of a scene that names none."""
    named = at.scene.angle_coordinates
    return named if at.v[named].size else slice(None)


def mass_size(at: Evaluation, S: Array) -> float:
    """Return the size of the terms that Sᵀ M_x S sums to M, kg m² or the like.

    Relative angles carry all bodies behind, which cancels in M.
    """
    if np.array_equal(S, np.eye(at.scene.n)):
        return 0.0
    back, across = np.linalg.pinv(S), np.abs(S)
    return largest(across.T @ np.abs(back.T @ at.terms.M @ back) @ across)


def weight_size(at: Evaluation) -> float:
    """Return the size of the moments of weights that an engine may sum to Q, N or N m.

    The weight of all bodies, times how far from a joint they may be along the tree. About axes that
    do not feel gravity such moments appear in frames that turn, and cancel. 0 of a scene that is no
    tree, or has no gravity.
    """
    tree, gravity = at.scene.tree(), getattr(at.scene, "gravity", None)
    if tree is None or not isinstance(gravity, float | int | np.ndarray):
        return 0.0
    slides = np.array([kind[0] == "p" for kind in tree.joint])
    reach = np.abs(tree.coordinates @ at.q + tree.shift) * slides
    reach += np.linalg.norm(tree.offset, axis=1)
    for j, parent in enumerate(tree.parent):
        reach[j] += reach[parent] if parent >= 0 else 0.0
    arms = (reach + np.linalg.norm(tree.center, axis=1))[tree.mass > 0]
    # What slides feels the weight itself.
    longest = np.max(arms, initial=float(slides.any()))
    return float(np.sum(tree.mass) * np.linalg.norm(gravity) * longest)


def represented(
    engines: Sequence[type[Engine]], scenes: Sequence[type[Scene]]
) -> tuple[type[Scene], ...]:
    """Return the kinds of scenes of which one of `engines` represents a small one at least.

    Raises:
        InputError: there is none, or an engine cannot say so.
    """
    found = tuple(
        kind for kind in scenes if any(represents_some(engine, kind) for engine in engines)
    )
    if not found:
        who, what = (", ".join(one.key for one in x) for x in (engines, scenes))
        raise InputError(f"engine {who} represents none of the scenes {what}")
    return found


def represents_some(engine: type[Engine], kind: type[Scene]) -> bool:
    """Return whether an engine represents a small scene of a kind at least.

    Raises:
        InputError: the engine cannot say so.
    """
    return any(represents(engine, scene) for scene in _small(kind))


def _small(kind: type[Scene]) -> Iterator[Scene]:
    for links in (1, 2, 3) if kind.has_links else (None,):
        with suppress(InputError):  # no scene of the kind has so many
            yield from kind.structures(links)
