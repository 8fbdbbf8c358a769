"""Plant faults in right functions, and count what `check_functions` catches, by kind and by set.

    python -m tests.trials.wrong_functions [--jobs 2] [--seed 0] [--kind ID] [--markdown FILE]

A fault is a kind of mistake, a model, and a set of functions that is given. `Kind.told_by`, written
down before any run, says which sets suffice to detect it. A fault counts where it changes a row of
what the function returns by more than `VISIBLE` in one of the states drawn, of an acceleration in
one that keeps the constraints. Asked for, else exit code 1: of those that can be detected `CAUGHT`
fail, of rare calls `CAUGHT_RARE`; in `NAMED` of them the first failure names the function; where it
cannot be detected, a finding says what would do it.
"""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tests.testing.own import coriolis, given, guide
from tests.testing.trees import random_tree
from tests.trials.formula_models import _damped_chain, _furuta, _two_link_arm, by_casadi
from tests.trials.progress import Progress, ignore_interrupts

from eomcheck.claims.finding import Finding
from eomcheck.lab.show.table import ResultTable, print_tables
from eomcheck.testing import check
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    EquationsOfMotion,
    FunctionCaller,
    equations_from,
)
from eomcheck.testing.function_checks import sample_states
from eomcheck.testing.function_state import FunctionState

VISIBLE = 1e-6
CAUGHT, CAUGHT_RARE, NAMED = 0.99, 0.90, 0.90

Parts = dict[str, Any]
"""Name of a function -> it; `damping` is ∂R/∂v."""

SETS: dict[str, str] = {
    "all": "M bias gravity C qdd T U R Q a c gamma",
    "no energies": "M bias gravity qdd R Q a gamma",
    "no bias": "M gravity qdd T U R Q a c",
    "Coriolis matrix": "M C gravity qdd R Q a c gamma",
    "M, bias": "M bias",
    "M, bias, gravity": "M bias gravity",
    "energies and acceleration": "qdd T U R Q a c gamma",
    "acceleration": "qdd",
}
"""What is given; a model gives those of them that it has."""


# ---- Models --------------------------------------------------------------------------------------


def _cart() -> Parts:
    own = guide("cart")
    parts = given("cart") | {"C": coriolis}
    parts["damping"] = lambda q, v: np.array([own.d * v[0], 0.0, 0.0])
    return parts


def _drive() -> Parts:
    own = guide("drive")
    parts = given("drive")
    parts["damping"] = lambda q, v: own.k * np.array([0, 0, 0, v[3], v[4], 0, 0])
    return parts


def _tree() -> Parts:
    # One that turns: of slides alone M and gravity are constant, and their faults no faults.
    at = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 4))
    trees = (random_tree(k) for k in range(100))
    own = next(x for x in trees if x["n"] == 4 and np.count_nonzero(x["bias"](*at)) >= 3)
    rates = np.array([0.1, 0.2, 0.3, 0.4]) * np.abs(np.diag(own["M"](np.zeros(4))))
    own["R"] = lambda q, v: float(rates @ v**2) / 2
    own["damping"] = lambda q, v: rates * v
    return own


def _of_casadi(n: int, energies: Any) -> Parts:
    made = by_casadi(n, energies, seed=4)
    parts: Parts = {name: made.function(name) for name in made.given} | {"n": n}
    if "R" in parts:
        R = parts["R"]  # quadratic in v: central differences are exact but for rounding
        basis = np.eye(n)

        def damping(q: Any, v: Any) -> Any:
            return np.array([(R(q, v + e) - R(q, v - e)) / 2 for e in basis])

        parts["damping"] = damping
    return parts


@cache
def models() -> dict[str, Parts]:
    """Return the models in which faults are planted, by name."""
    return {
        "cart": _cart(),
        "drive": _drive(),
        "tree": _tree(),
        "chain": _of_casadi(3, _damped_chain),
        "furuta": _of_casadi(2, _furuta),
        "arm": _of_casadi(2, _two_link_arm),
    }


def acceleration(parts: Parts, **wrong: Any) -> Callable[[Any, Any], Any]:
    """Return qdd(q, v) of the equations, with some of their terms replaced."""
    own = parts | wrong

    def qdd(q: Any, v: Any) -> Any:
        force = -np.array(own["bias"](q, v), float)
        for name, sign in (("gravity", -1.0), ("damping", -1.0), ("Q", 1.0)):
            if own.get(name) is not None:
                arguments = (q,) if name == "gravity" else (q, v)
                force = force + sign * np.asarray(own[name](*arguments))
        M = np.asarray(own["M"](q))
        if own.get("a") is None:
            return np.linalg.solve(M, force)
        a, n = np.asarray(own["a"](q)), len(M)
        full = np.block([[M, -a.T], [a, np.zeros((len(a), len(a)))]])
        return np.linalg.solve(full, np.concatenate((force, -np.asarray(own["gamma"](q, v)))))[:n]

    return qdd


def of_set(parts: Parts, names: set[str]) -> Parts:
    """Return the functions of a set, of a model in which terms that are not given do not exist."""
    absent = {
        "gravity": not names & {"gravity", "U"},
        "damping": "R" not in names,
        "Q": "Q" not in names,
        "a": "a" not in names,
    }
    # An acceleration alone is that of the whole mechanism: nothing says what is absent.
    whole = names == {"qdd"}
    reduced = parts | {name: None for name, gone in absent.items() if gone and not whole}
    given_ = {name: parts[name] for name in names & set(parts)}
    if "qdd" in names:
        given_["qdd"] = acceleration(reduced)
    return {"n": parts["n"], "all": reduced} | given_


# ---- Kinds of faults -----------------------------------------------------------------------------


class Kind(NamedTuple):
    """A kind of mistake.

    Attributes:
        id: its name.
        wrong: the function that is wrong.
        plant: (functions of a set, generator) -> the wrong function; None where it fits not.
        told_by: sets of further functions, each of which suffices to detect it; () for none needed.
        rare: whether only some calls are wrong.
    """

    id: str
    wrong: str
    plant: Callable[[Parts, np.random.Generator], Any]
    told_by: tuple[str, ...]
    rare: bool = False


def _read(f: Any, *x: Any) -> Any:
    return np.array(f(*x), float)


def _entry(change: Callable[[Any, tuple[int, ...]], None], name: str, chosen: Any) -> Any:
    """Return a planter that changes entries of an array in place, at an index that is chosen."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        index = chosen(parts, f, rng)
        if index is None:
            return None

        def wrong(q: Any, *v: Any) -> Any:
            found = _read(f, q, *v)
            change(found, index)
            return found

        return _like(f, wrong)

    return plant


def _like(f: Any, wrong: Any) -> Any:
    """Return `wrong` with as many arguments as f has, which is what inputs are told by."""
    required = [
        p for p in inspect.signature(f).parameters.values() if p.default is inspect.Parameter.empty
    ]
    return (lambda q: wrong(q)) if len(required) == 1 else (lambda q, v: wrong(q, v))


def _arity(f: Any) -> int:
    return sum(
        p.default is inspect.Parameter.empty for p in inspect.signature(f).parameters.values()
    )


def _values(parts: Parts, f: Any) -> Any:
    rng, n = np.random.default_rng(1), parts["n"]
    return np.array([_read(f, *rng.uniform(-1, 1, (2, n))[: _arity(f)]) for _ in range(6)])


def _varying(parts: Parts, f: Any, rng: np.random.Generator) -> tuple[int, ...] | None:
    """Return an entry beside the diagonal (of a matrix) or any (of a vector) that depends on q."""
    values = _values(parts, f)
    spread, size = np.ptp(values, axis=0), np.abs(values).max()
    if spread.ndim == 2 and spread.shape[0] == spread.shape[1]:
        spread = np.triu(spread, 1)
    among = np.argwhere(spread > 1e-3 * size)
    return tuple(map(int, among[rng.integers(len(among))])) if len(among) else None


def _nonzero(parts: Parts, f: Any, rng: np.random.Generator) -> tuple[int, ...] | None:
    """Return an entry that is not zero."""
    values = np.abs(_values(parts, f)).max(axis=0)
    among = np.argwhere(values > 1e-3 * values.max()) if values.any() else []
    return tuple(map(int, among[rng.integers(len(among))])) if len(among) else None


def _scaled(name: str, factor: float) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        return _like(f, lambda *x: factor * _read(f, *x))

    return plant


def _both(factor: float) -> Any:
    def change(found: Any, index: tuple[int, ...]) -> None:
        found[index] *= factor
        if index[0] != index[1]:
            found[index[::-1]] *= factor

    return change


def _once(factor: float) -> Any:
    def change(found: Any, index: tuple[int, ...]) -> None:
        found[index] *= factor

    return change


def _shifted(name: str, by: float) -> Any:
    """Return a planter of a function that reads one coordinate with an offset."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f, n = parts[name], parts["n"]
        own = _values(parts, f)
        order = rng.permutation(n)
        base = np.random.default_rng(1).uniform(-1, 1, (6, 2, n))
        for i in order:
            offset = by * np.eye(n)[i]
            moved = np.array([_read(f, x[0] + offset, *x[1 : _arity(f)]) for x in base])
            if np.abs(moved - own).max() > 1e-2 * np.abs(own).max():
                return _like(f, lambda q, *v, offset=offset: _read(f, np.asarray(q) + offset, *v))
        return None

    return plant


def _degrees(name: str) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        return _like(f, lambda q, *v: _read(f, np.radians(np.asarray(q)), *v))

    return plant


def _plus(name: str, extra: Callable[[Parts, Any, Any], Any]) -> Any:
    """Return a planter that adds `extra(parts, q, v)`."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        return _like(f, lambda q, *v: _read(f, q, *v) + extra(parts, q, v[0] if v else None))

    return plant


def _single(name: str) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        return _like(f, lambda *x: np.float32(_read(f, *(np.float32(y) for y in x))).astype(float))

    return plant


def _swapped_rows(name: str) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        values = _values(parts, f)
        if values.shape[1] < 2 or np.allclose(values[:, 0], values[:, 1]):
            return None
        return _like(f, lambda *x: _read(f, *x)[[1, 0, *range(2, values.shape[1])]])

    return plant


def _term(change: Callable[[float, Any, int, int], float], cross: bool) -> Any:
    """Return a planter that changes one coefficient of a row of B, found by polarization.

    `change(coefficient, v, i, j)` returns what is added to the row.
    """

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f, n = parts["bias"], parts["n"]

        def coefficients(q: Any) -> Any:
            basis = np.eye(n)
            square = np.array([_read(f, q, e) for e in basis])
            found = np.zeros((n, n, n))
            for i in range(n):
                found[i, i] = square[i]
                for j in range(i):
                    both = _read(f, q, basis[i] + basis[j])
                    found[j, i] = both - square[i] - square[j]
            return found

        at = np.array([coefficients(q) for q in np.random.default_rng(1).uniform(-1, 1, (3, n))])
        sizes = np.abs(at).max(axis=0)
        fits = [
            (i, j, row)
            for i, j, row in np.argwhere(sizes > 1e-3 * sizes.max())
            if (i != j) == cross
        ]
        if not fits:
            return None
        i, j, row = fits[rng.integers(len(fits))]

        def wrong(q: Any, v: Any) -> Any:
            found = _read(f, q, v)
            basis = np.eye(n)
            one, two = _read(f, q, basis[i]), _read(f, q, basis[j])
            size = one if i == j else _read(f, q, basis[i] + basis[j]) - one - two
            found[row] += change(size[row], v, int(i), int(j))
            return found

        return wrong

    return plant


def _accelerated(**terms: Callable[[Parts], Any]) -> Any:
    """Return a planter of the acceleration that follows from wrong terms."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        own = parts["all"]
        if any(own.get(name) is None for name in terms):
            return None
        return acceleration(own, **{name: make(own) for name, make in terms.items()})

    return plant


def _stale(name: str, every: int) -> Any:
    """Return a planter of a function of which every so-and-so-manyth answer is the last one's."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f, calls, last = parts[name], [0], [None]

        def wrong(*x: Any) -> Any:
            calls[0] += 1
            if calls[0] % every or last[0] is None:
                last[0] = _read(f, *x)
            return np.array(last[0])

        return _like(f, wrong)

    return plant


def _cached(name: str, digits: int) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f, kept = parts[name], {}

        def wrong(*x: Any) -> Any:
            key = tuple(np.round(np.concatenate(x), digits))
            if key not in kept:
                kept[key] = _read(f, *x)
            return np.array(kept[key])

        return _like(f, wrong)

    return plant


def _writes(every: int) -> Any:
    """Return a planter of a mass matrix that changes its argument now and then."""

    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f, calls = parts["M"], [0]

        def wrong(q: Any) -> Any:
            calls[0] += 1
            if calls[0] % every == 0:
                q[0] -= 2 * np.pi
            return _read(f, q)

        return wrong

    return plant


def _where(name: str, condition: Callable[[Any], Any], factor: float) -> Any:
    def plant(parts: Parts, rng: np.random.Generator) -> Any:
        f = parts[name]
        return _like(
            f, lambda q, *v: _read(f, q, *v) * (factor if condition(np.asarray(q)) else 1.0)
        )

    return plant


def _workless(parts: Parts, q: Any, v: Any) -> Any:
    """Return a force that is quadratic in v and does no work."""
    n = parts["n"]
    turned = np.zeros(n)
    turned[0], turned[1] = v[1], -v[0]
    return turned * v[0]


def _armature(parts: Parts, q: Any, v: Any) -> Any:
    return 0.02 * np.eye(parts["n"])


def _sized(parts: Parts, name: str) -> float:
    return float(np.abs(_values(parts, parts[name])).max()) or 1.0


def _negative(own: Parts, name: str, factor: float = -1.0) -> Any:
    f = own[name]
    return _like(f, lambda *x: factor * _read(f, *x))


def _transposed(parts: Parts, rng: np.random.Generator) -> Any:
    f = parts["C"]
    return lambda q, v: _read(f, q, v).T


def _lower_empty(parts: Parts, rng: np.random.Generator) -> Any:
    f = parts["M"]
    return lambda q: np.triu(_read(f, q))


def _velocity_sign(parts: Parts, rng: np.random.Generator) -> Any:
    f, n = parts["T"], parts["n"]
    mirror = np.ones(n)
    mirror[0] = -1.0
    return lambda q, v: f(q, mirror * v)


def _without_part(parts: Parts, rng: np.random.Generator) -> Any:
    f, size = parts["T"], _sized(parts, "T")
    return lambda q, v: f(q, v) - size / 8 * v[0] ** 2


def _other_speed(parts: Parts, rng: np.random.Generator) -> Any:
    f = parts["R"]
    return lambda q, v: f(q, np.roll(v, 1))


MATRIX = ("T", "bias", "C", "qdd")
BIAS = ("M", "T", "C")
GRAVITY = ("U", "qdd M", "qdd T")
MOTION = ("M", "T")

KINDS: tuple[Kind, ...] = (
    # Mass matrix
    Kind("M: sign of a pair", "M", _entry(_both(-1.0), "M", _varying), MATRIX),
    Kind("M: a pair twice as large", "M", _entry(_both(2.0), "M", _varying), MATRIX),
    Kind("M: a pair is missing", "M", _entry(_both(0.0), "M", _varying), MATRIX),
    Kind("M: one of a pair wrong", "M", _entry(_once(0.5), "M", _varying), ("",)),
    Kind("M: lower triangle empty", "M", _lower_empty, ("",)),
    Kind("M: armature", "M", _plus("M", _armature), ("T", "qdd")),
    Kind("M: angle with an offset", "M", _shifted("M", 0.3), MATRIX),
    Kind("M: cosine for sine", "M", _shifted("M", np.pi / 2), MATRIX),
    Kind("M: degrees", "M", _degrees("M"), MATRIX),
    Kind("M: 1 % too large", "M", _scaled("M", 1.01), ("T", "bias", "C", "qdd gravity", "qdd U")),
    Kind("M: negative", "M", _scaled("M", -1.0), ("",)),
    # Bias
    Kind("bias: half", "bias", _scaled("bias", 0.5), BIAS),
    Kind("bias: sign", "bias", _scaled("bias", -1.0), BIAS),
    Kind("bias: a row is missing", "bias", _entry(_once(0.0), "bias", _nonzero), BIAS),
    Kind("bias: sign of a row", "bias", _entry(_once(-1.0), "bias", _nonzero), BIAS),
    Kind(
        "bias: sign of a square",
        "bias",
        _term(lambda c, v, i, j: -2 * c * v[i] ** 2, cross=False),
        BIAS,
    ),
    Kind(
        "bias: half a product",
        "bias",
        _term(lambda c, v, i, j: -c * v[i] * v[j] / 2, cross=True),
        BIAS,
    ),
    Kind(
        "bias: square for a product",
        "bias",
        _term(lambda c, v, i, j: c * (v[i] ** 2 - v[i] * v[j]), cross=True),
        BIAS,
    ),
    Kind(
        "bias: gravity in it",
        "bias",
        _plus("bias", lambda p, q, v: _read(p["gravity"], q)),
        ("",),
    ),
    Kind("bias: damping in it", "bias", _plus("bias", lambda p, q, v: 0.1 * np.asarray(v)), ("",)),
    Kind("bias: a constant", "bias", _plus("bias", lambda p, q, v: 0.1), ("",)),
    Kind("bias: cubic", "bias", _plus("bias", lambda p, q, v: 0.1 * np.asarray(v) ** 3), ("",)),
    Kind("bias: angle with an offset", "bias", _shifted("bias", 0.3), BIAS),
    Kind("bias: does no work", "bias", _plus("bias", _workless), BIAS),
    Kind("bias: float32", "bias", _single("bias"), ("",)),
    Kind("bias: two rows exchanged", "bias", _swapped_rows("bias"), BIAS),
    # Gravity
    Kind("gravity: sign", "gravity", _scaled("gravity", -1.0), GRAVITY),
    Kind("gravity: 9.8 for 9.81", "gravity", _scaled("gravity", 9.8 / 9.81), GRAVITY),
    Kind("gravity: sign of a row", "gravity", _entry(_once(-1.0), "gravity", _nonzero), GRAVITY),
    Kind("gravity: a row is missing", "gravity", _entry(_once(0.0), "gravity", _nonzero), GRAVITY),
    Kind("gravity: cosine for sine", "gravity", _shifted("gravity", np.pi / 2), GRAVITY),
    Kind("gravity: degrees", "gravity", _degrees("gravity"), GRAVITY),
    Kind("gravity: float32", "gravity", _single("gravity"), ("",)),
    # Coriolis matrix
    Kind("C: transposed", "C", _transposed, ("M", "bias", "T")),
    Kind("C: sign of an entry", "C", _entry(_once(-1.0), "C", _nonzero), ("M", "bias", "T")),
    Kind("C: half", "C", _scaled("C", 0.5), ("M", "bias", "T")),
    # Acceleration
    Kind("qdd: sign of the bias", "qdd", _accelerated(bias=lambda p: _negative(p, "bias")), MOTION),
    Kind(
        "qdd: without bias", "qdd", _accelerated(bias=lambda p: _negative(p, "bias", 0.0)), MOTION
    ),
    Kind(
        "qdd: bias that does no work too much",
        "qdd",
        _accelerated(bias=lambda p: lambda q, v: _read(p["bias"], q, v) + _workless(p, q, v)),
        ("M",),
    ),
    Kind("qdd: without gravity", "qdd", _accelerated(gravity=lambda p: None), MOTION),
    Kind(
        "qdd: damping feeds", "qdd", _accelerated(damping=lambda p: _negative(p, "damping")), MOTION
    ),
    Kind("qdd: without damping", "qdd", _accelerated(damping=lambda p: None), MOTION),
    Kind(
        "qdd: force with a wrong sign", "qdd", _accelerated(Q=lambda p: _negative(p, "Q")), MOTION
    ),
    Kind("qdd: a row 10 % too large", "qdd", _entry(_once(1.1), "qdd", _nonzero), MOTION),
    Kind("qdd: two rows exchanged", "qdd", _swapped_rows("qdd"), MOTION),
    Kind("qdd: float32", "qdd", _single("qdd"), ("",)),
    Kind(
        "qdd: breaks the constraint",
        "qdd",
        _accelerated(gamma=lambda p: lambda q, v: 0.0 * _read(p["gamma"], q, v)),
        ("a",),
    ),
    Kind("qdd: without constraint forces", "qdd", _accelerated(a=lambda p: None), ("a",)),
    # Energies and dissipation
    Kind("T: twice as large", "T", _scaled("T", 2.0), ("M", "bias")),
    Kind("T: sign of a velocity", "T", _velocity_sign, ("M", "bias")),
    Kind("T: a part is missing", "T", _without_part, ("M",)),
    Kind("T: angle with an offset", "T", _shifted("T", 0.3), ("M", "bias")),
    Kind("U: sign", "U", _scaled("U", -1.0), ("gravity", "qdd M", "qdd T")),
    Kind("U: 9.8 for 9.81", "U", _scaled("U", 9.8 / 9.81), ("gravity", "qdd M", "qdd T")),
    Kind("U: angle with an offset", "U", _shifted("U", 0.3), ("gravity", "qdd M", "qdd T")),
    Kind("R: sign", "R", _scaled("R", -1.0), ("",)),
    Kind("R: twice as large", "R", _scaled("R", 2.0), ("qdd M", "qdd T")),
    Kind("R: another speed", "R", _other_speed, ("qdd M", "qdd T")),
    Kind("Q: sign", "Q", _scaled("Q", -1.0), ("qdd M", "qdd T")),
    # Constraints
    Kind("a: sign of an entry", "a", _entry(_once(-1.0), "a", _nonzero), ("c", "gamma", "qdd")),
    Kind("a: cosine for sine", "a", _shifted("a", np.pi / 2), ("c", "gamma", "qdd")),
    Kind("c: half a row", "c", _entry(_once(0.5), "c", _nonzero), ("a",)),
    Kind("gamma: sign", "gamma", _scaled("gamma", -1.0), ("a",)),
    Kind("gamma: half", "gamma", _scaled("gamma", 0.5), ("a",)),
    Kind("gamma: zero", "gamma", _scaled("gamma", 0.0), ("a",)),
    # Rare calls
    Kind("rare: bias stale, every 7th call", "bias", _stale("bias", 7), ("",), rare=True),
    Kind("rare: bias stale, every 50th call", "bias", _stale("bias", 50), ("",), rare=True),
    Kind("rare: gravity stale, every 7th call", "gravity", _stale("gravity", 7), ("",), rare=True),
    Kind("rare: M stale, every 50th call", "M", _stale("M", 50), ("",), rare=True),
    Kind("rare: M kept by rounded q", "M", _cached("M", 6), ("",), rare=True),
    Kind("rare: M kept by q to 4 digits", "M", _cached("M", 4), ("",), rare=True),
    Kind("rare: gravity kept by rounded q", "gravity", _cached("gravity", 3), ("",), rare=True),
    Kind("rare: bias kept by q and v to 8 digits", "bias", _cached("bias", 8), ("",), rare=True),
    Kind("rare: M writes into q, every 97th call", "M", _writes(97), ("",), rare=True),
    Kind(
        "rare: half the bias where q[0] > 0.8",
        "bias",
        _where("bias", lambda q: q[0] > 0.8, 0.5),
        BIAS,
        rare=True,
    ),
    Kind(
        "rare: no number where q[0] > 0.9",
        "gravity",
        _where("gravity", lambda q: q[0] > 0.9, np.nan),
        ("",),
        rare=True,
    ),
)


# ---- Trials --------------------------------------------------------------------------------------


class Fault(NamedTuple):
    """A kind in a model of which a set of functions is given."""

    kind: int
    model: str
    set: str


def names_given(model: str, set_: str) -> set[str]:
    """Return the names of a set that a model has."""
    return set(SETS[set_].split()) & {*models()[model], "qdd"}


def can_be_told(kind: Kind, names: set[str]) -> bool:
    """Return whether some set of functions that suffices is given, by the table."""
    return any(set(one.split()) <= names - {kind.wrong} for one in kind.told_by)


def faults() -> list[Fault]:
    """Return every kind in every model and set where the wrong function is given."""
    return [
        Fault(k, model, set_)
        for k, kind in enumerate(KINDS)
        for model in models()
        for set_ in SETS
        if kind.wrong in names_given(model, set_)
    ]


class Outcome(NamedTuple):
    """The result of one fault.

    Attributes:
        fault: which.
        told: whether it can be detected, by the table.
        caught: whether a Finding failed.
        named: whether the first that failed names the wrong function.
        alone: whether it names no other function.
        hinted: whether a Finding says which further function would detect it.
        first: the first failure, "" without one.
    """

    fault: Fault
    told: bool
    caught: bool
    named: bool
    alone: bool
    hinted: bool
    first: str


def visible(
    right: Any, wrong: Any, functions: EquationsOfMotion, seed: int, constant: bool = False
) -> bool:
    """Return whether a row changes by more than `VISIBLE` of itself in a state that is drawn.

    An acceleration in a state beside it that keeps the constraints: elsewhere no claim says what it
    is, and constraint forces may make up for a force that is wrong.

    Args:
        right, wrong: the functions.
        functions: of which `wrong` is one.
        seed: of the states.
        constant: whether a change by a constant is none, as of a potential energy.
    """
    first = None
    for state in sample_states(functions, 20, seed):
        at: Any = FunctionState(FunctionCaller(functions), state.q, state.v)
        if functions.qdd is not None and wrong is functions.qdd:
            at = at.consistent() or at
        arguments = (at.q, at.v)[: _arity(right)]
        old = np.atleast_1d(_read(right, *(x.copy() for x in arguments)))
        new = np.atleast_1d(_read(wrong, *(x.copy() for x in arguments)))
        rows = old.reshape(len(old), -1), new.reshape(len(new), -1)
        apart = rows[1] - rows[0]
        first = apart if constant and first is None else first
        apart = apart if first is None else apart - first
        change, size = np.abs(apart).max(axis=1), np.abs(rows[0]).max(axis=1)
        if (~(change <= VISIBLE * size)).any():
            return True
    return False


def tried(fault: Fault, seed: int = 0) -> Outcome | None:
    """Return what comes of a fault; None where it cannot be planted or changes nothing."""
    kind, names = KINDS[fault.kind], names_given(fault.model, fault.set)
    parts = of_set(models()[fault.model], names)
    rng = np.random.default_rng([seed, fault.kind, list(models()).index(fault.model)])
    try:
        wrong = kind.plant(parts, rng)
    except KeyError:
        return None
    if wrong is None:
        return None
    n = parts["n"]
    given_ = {name: parts[name] for name in names & set(parts)}
    functions = equations_from(n, given_ | {kind.wrong: wrong, "name": fault.model})
    calls_differ = kind.id.startswith("rare:") and "q[0]" not in kind.id
    try:
        shows = calls_differ or visible(
            given_[kind.wrong], wrong, functions, seed, constant=kind.wrong == "U"
        )
    except KeyError:  # it reads a function that the set has not
        return None
    if not shows:
        return None
    if "stale" in kind.id or "kept" in kind.id:
        values = _values(parts, given_[kind.wrong])
        if (values == values[0]).all():  # an answer of another state is the same
            return None
    findings = check(functions, seed=seed)
    failed = [x for x in findings if x.verdict == "failed"]
    open_ = [x.detail for x in findings if x.verdict in ("skipped", "inconclusive")]
    return Outcome(
        fault,
        can_be_told(kind, names),
        bool(failed),
        bool(failed) and names_term(failed[0], kind.wrong),
        bool(failed) and failed[0].cause == kind.wrong,
        any("would" in detail for detail in open_),
        str(failed[0]) if failed else "",
    )


def names_term(finding: Finding, name: str) -> bool:
    """Return whether a failure blames a function, alone or with others that cannot be told apart.

    By its cause, or else by its subject or by the term it blames.
    """
    if finding.cause:
        return name in finding.cause.split(" or ")
    subjects = finding.subject.split(" ~ ")
    return name in subjects or INPUTS[name].what in finding.detail.split(",")[0]


def outcomes(chosen: list[Fault], seed: int, jobs: int) -> Iterator[Outcome | None]:
    """Yield the outcome of each fault, in order."""
    seeds = [seed] * len(chosen)
    if jobs == 1:
        yield from map(tried, chosen, seeds)
        return
    with ProcessPoolExecutor(jobs, initializer=ignore_interrupts) as pool:
        yield from pool.map(tried, chosen, seeds, chunksize=4)


def table(found: list[Outcome]) -> ResultTable:
    """Return, for each kind, how many were planted, could be detected, were caught and named."""
    rows = []
    for k, kind in enumerate(KINDS):
        own = [one for one in found if one.fault.kind == k]
        told = [one for one in own if one.told]
        hidden = [one for one in own if not one.told]
        if own:
            rows.append(
                [
                    kind.id,
                    " or ".join(one.replace(" ", " and ") for one in kind.told_by if one) or "-",
                    str(len(told)),
                    str(sum(one.caught for one in told)),
                    str(sum(one.named for one in told if one.caught)),
                    str(len(hidden)),
                    str(sum(one.hinted or one.caught for one in hidden)),
                ]
            )
    sums = [str(sum(int(row[k]) for row in rows)) for k in range(2, 7)]
    columns = ["fault", "detected by", "detectable", "caught", "named", "hidden", "hinted"]
    return ResultTable("wrong-functions", "Planted faults", columns, [*rows, ["all", "", *sums]])


def shares(found: list[Outcome]) -> dict[str, tuple[float, float]]:
    """Return name -> (share reached, share asked for)."""
    told = [one for one in found if one.told]
    rare = [one for one in told if KINDS[one.fault.kind].rare]
    usual = [one for one in told if not KINDS[one.fault.kind].rare]
    hidden = [one for one in found if not one.told]
    caught = [one for one in told if one.caught]
    of = lambda good: float(np.mean(good)) if good else 1.0  # noqa: E731
    return {
        "caught": (of([one.caught for one in usual]), CAUGHT),
        "rare calls caught": (of([one.caught for one in rare]), CAUGHT_RARE),
        "named by the first failure": (of([one.named for one in caught]), NAMED),
        "hidden, and said so": (of([one.hinted or one.caught for one in hidden]), 1.0),
    }


def main() -> int:
    """Plant all faults, print the table and the misses, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", default="", help="only kinds that begin so")
    parser.add_argument("--every", type=int, default=1, help="only every n-th fault")
    parser.add_argument("--markdown", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    chosen = [one for one in faults() if KINDS[one.kind].id.startswith(options.kind)]
    seen: set[int] = set()
    part = []
    for k, fault in enumerate(chosen):
        if k % options.every == 0 or fault.kind not in seen:  # every kind is tried
            part.append(fault)
            seen.add(fault.kind)
    found: list[Outcome] = []
    with Progress(len(part)) as progress:
        for one in progress.of(outcomes(part, options.seed, options.jobs)):
            if one is None:
                continue
            found.append(one)
            what = f"{KINDS[one.fault.kind].id}, {one.fault.model}, {one.fault.set}"
            if one.told and not one.caught:
                print(f"MISSED {what}", flush=True)
            elif one.told and not one.named:
                print(f"not named: {what}: {one.first}", flush=True)
            elif not one.told and not one.caught and not one.hinted:
                print(f"NO WORD {what}", flush=True)
    sheet = table(found)
    print_tables([sheet])
    if options.markdown is not None:
        options.markdown.write_text(sheet.markdown(), encoding="utf-8")
    reached = shares(found)
    for name, (share, asked) in reached.items():
        print(f"{name}: {share:.1%} (asked {asked:.0%})")
    caught = [one for one in found if one.told and one.caught]
    alone = sum(one.alone for one in caught)
    print(f"named alone, by conclusion: {alone / max(len(caught), 1):.1%}")
    print(f"{len(found)} faults of {len({one.fault.kind for one in found})} kinds")
    missed = any(share < asked for share, asked in reached.values())
    return 130 if progress.interrupted else int(missed)


if __name__ == "__main__":
    raise SystemExit(main())
