"""User-supplied scenes: origin of errors, shapes of results, support of exact numbers.

The shapes of the arrays that a scene's functions return are checked before any claim: arrays of
wrong shape would end in an error deep inside a formulation, or be broadcast. An error is attributed
to the user-supplied function that raised it, by its traceback: scene functions are traced, compiled
and cached under their own names, and no wrapper that could name them is there at each call. A scene
function has to run in float64; exact numbers it need not support.
"""

from __future__ import annotations

import inspect
import random
import traceback
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from numbers import Number, Real
from pathlib import Path
from typing import Any

import numpy as np

import eomcheck
from eomcheck.calls import is_ours
from eomcheck.claims.registry import GenericPoint
from eomcheck.errors import CallError, InputError, RefusedError, described_error, message_of, raised
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import (
    FUNCTIONS,
    Scene,
    checked_scene,
    once_per_structure,
)
from eomcheck.numbers.finite_field import DomainError, FiniteField, random_prime
from eomcheck.numbers.generic import FLOAT64, map_record

# ---- Origin of errors ----------------------------------------------------------------------------

HERE = Path(eomcheck.__file__).parent


def scene_function_that_raised(scene: Scene, error: BaseException) -> str:
    """Return the user-supplied scene function that raised an error, with its line; "" if none."""
    files = _source_files(type(scene))
    through = [x for x in traceback.extract_tb(error.__traceback__) if x.filename in files]
    if not through:
        kinds = [f"{kind.__name__}." for kind in type(scene).__mro__]
        own = isinstance(error, CallError) and error.name.startswith(tuple(kinds))
        return str(error) if own else ""
    return f"{type(scene).__name__}.{through[-1].name} {raised(error, through[-1])}"


def _source_files(kind: type[Scene]) -> set[str]:
    """Return the files that define functions of a scene class, files of this package excluded."""
    functions = [getattr(kind, name, None) for name in FUNCTIONS]
    functions += [x for base in kind.__mro__ for x in vars(base).values()]
    codes = (getattr(inspect.unwrap(x), "__code__", None) for x in functions if callable(x))
    files = {code.co_filename for code in codes if code is not None}
    return {file for file in files if not Path(file).is_relative_to(HERE)}


# ---- Shapes --------------------------------------------------------------------------------------

Shape = tuple[int, ...]
Returned = tuple[str, str, Any, Shape]
"""(function, symbol, returned value, expected shape) of one result of a scene function."""

ARRAYS: Any = (np.ndarray, Number)
"""Types that scene functions may return."""

NEEDED = frozenset({"V", "ω", "M", "T", "u", "r", "Φ"})
"""Symbols that every scene has to return."""

OF_CONSTRAINTS = frozenset({("terms", "a"), ("constraint", "c")})
"""Functions and their symbols that every scene with constraints has to return.

`constraints` may leave out a: if `terms` are written by hand it is not used.
"""


@once_per_structure
def check_shapes(scene: Scene) -> bool | None:
    """Check the shapes that each function of `scene` returns, and its tree, once per structure.

    None stands for an absent optional quantity.

    Returns:
        True; None if a user-supplied function raises, which is reported at the state at which it
        happens, and the next scene of this structure is checked again.

    Raises:
        InputError: an array has not the shape of the contract (`eomcheck.mechanics.scene`), or the
            tree of bodies is malformed.
    """
    try:
        scene.tree()  # a malformed one is no fault of an engine that reads it
        compare_shapes(scene, _random_quantities(scene))
    except InputError:
        raise
    except Exception as error:
        if scene_function_that_raised(scene, error):
            return None
        raise
    return True


def compare_shapes(scene: Scene, at: Quantities) -> None:
    """Compare the shapes that each function of `scene` returns at one point with the contract.

    Raises:
        InputError: an array has another shape, or the result of a user-supplied function leads to
            an error inside this package.
        Exception: raised by a function of the scene.
    """
    try:
        _compare_shapes(scene, at)
    except InputError:
        raise
    except Exception as error:
        if is_ours(type(scene)) or scene_function_that_raised(scene, error):
            raise
        why = f"{described_error(error)}, of what its functions return"
        raise InputError(f"{type(scene).__name__}: {why}") from error


def _compare_shapes(scene: Scene, at: Quantities) -> None:
    """Compare the shapes of all results of the scene functions with the expected ones."""
    needed = OF_CONSTRAINTS if scene.r else frozenset()
    with np.errstate(all="ignore"):
        if scene.natural_speeds:
            with suppress(RefusedError):
                map_record(partial(_check_shared, scene), at.kinematics)
        for function, name, returned, shape in function_results(scene, at):
            whose = f"{type(scene).__name__}.{function}: {name}"
            if returned is None and name not in NEEDED and (function, name) not in needed:
                continue
            if not isinstance(returned, ARRAYS):
                kind = "None" if returned is None else f"a {type(returned).__name__}"
                raise InputError(f"{whose} is {kind}, expected an array of shape {shape}")
            array: np.ndarray = np.asarray(returned)
            if array.shape != shape:
                raise InputError(f"{whose} has shape {array.shape}, expected {shape}")
            if not (array.dtype.kind in "fiub" or all(isinstance(x, Real) for x in array.flat)):
                raise InputError(f"{whose} is an array of {array.dtype}, expected real numbers")


def _check_shared(scene: Scene, part: Any) -> None:
    """Raise InputError if a part of `kinematics` has a type that cannot be traversed."""
    if not isinstance(part, ARRAYS):
        raise InputError(
            f"{type(scene).__name__}.kinematics: a {type(part).__name__}, expected an array, a "
            "number, or a NamedTuple of these"
        )


def _random_quantities(scene: Scene) -> Quantities:
    """Return the quantities of a scene in float64 at a fixed random state."""
    random = np.random.default_rng(0)
    at = Quantities(scene, FLOAT64, random.uniform(0.1, 1.0, checked_scene(scene).n))
    at.v, at.u = random.uniform(0.1, 1.0, scene.n), random.uniform(0.1, 1.0, scene.p)
    return at


def function_results(scene: Scene, at: Quantities) -> Iterator[Returned]:
    """Yield the results of the scene functions at a point, inputs of others first."""
    n, r, p = scene.n, scene.r, scene.p
    position = at.parameters, at.prepared, at.q
    arguments = *position, at.v

    V, omega = scene.velocities(*arguments)
    bodies, d, e = np.size(at.parameters.mass), np.shape(V)[-1], np.shape(omega)[-1]
    yield "velocities", "V", V, (bodies, d)
    yield "velocities", "ω", omega, (bodies, e)
    if hasattr(scene, "jacobians"):
        shapes = (bodies, d, n), (bodies, e, n), (bodies, d), (bodies, e), (bodies, e)
        yield from _record_fields("jacobians", scene.jacobians(*arguments), shapes)
        yield "drift", "gamma", scene.drift(*arguments), (r,)
        yield "forces", "Q", scene.forces(*arguments), (n,)
        yield "potential", "U", scene.potential(*position), ()
    if hasattr(scene, "constraints"):  # a scene that never moves may do without
        a, b = scene.constraints(*position)
        yield "constraints", "a", a, (r, n)
        yield "constraints", "b", b, (r,)
    yield from _record_fields("terms", at.terms, ((n, n), (n,), (n,), (r, n), (r,), (r,)))
    yield "constraint", "c", scene.constraint(*arguments), (r,)
    T, U = scene.energies(*arguments)
    yield "energies", "T", T, ()
    yield "energies", "U", U, ()
    if scene.dissipation is not None:
        yield "dissipation", "R", scene.dissipation(*arguments), ()
    if scene.positions is not None:
        yield "positions", "r", scene.positions(*position), (bodies, d)
    if scene.position_residual is not None:
        rows = len(range(r)[scene.holonomic])
        yield "position_residual", "Φ", scene.position_residual(*position), (rows,)
    yield "speeds_of", "u", scene.speeds_of(*arguments), (p,)
    try:
        yield from _record_fields("speeds", at.speeds, ((n, p), (n,), (n,)))
        # Vanishing components of velocities may be left out in `bodies`.
        d, e = (np.shape(velocity)[1] for velocity in at.bodies[:2])
        shapes = (bodies, d, p), (bodies, e, p), (bodies, d), (bodies, e)
        shapes = *shapes, (bodies,), (bodies, e, e), (bodies, e), (p,)
        yield from _record_fields("bodies", at.bodies, shapes)
    except RefusedError:
        return  # there are no generalized speeds at this point


def _record_fields(function: str, record: Any, shapes: tuple[Shape, ...]) -> Iterator[Returned]:
    """Yield the fields of a NamedTuple with their shapes; raise InputError for another type."""
    names = getattr(record, "_fields", ()) if isinstance(record, tuple) else ()
    if len(names) != len(shapes):
        wanted = f"a NamedTuple of {len(shapes)}"
        raise InputError(f"{function}: a {type(record).__name__}, expected {wanted}")
    for name, value, shape in zip(names, record, shapes, strict=True):
        yield function, name, value, shape


# ---- Float64 and exact numbers -------------------------------------------------------------------


def failing_function(scene: Scene, state: State) -> str:
    """Return the scene function that raises or returns a wrong shape in float64; "" if none."""
    try:
        compare_shapes(scene, Evaluation(scene, *state))
    except Exception as error:
        misshapen = message_of(error) if isinstance(error, InputError) else ""
        return scene_function_that_raised(scene, error) or misshapen
    return ""


def undefined_result(scene: Scene, at: Quantities) -> str:
    """Return which function of a user-supplied scene returns NaN: "Trailer.constraint: c is nan".

    Returns "" if none does, or if the scene is built in.
    """
    if is_ours(type(scene)):
        return ""
    for function, name, returned, _ in function_results(scene, at):
        if returned is not None and np.isnan(np.asarray(returned, np.float64)).any():
            return f"{type(scene).__name__}.{function}: {name} is nan"
    return ""


@once_per_structure
def why_not_rational(scene: Scene) -> str:
    """Return the reason that a scene function does not run on exact numbers, "" if all do.

    The result is cached for each structure. Such a function could lose digits in ball arithmetic
    too, by converting to float, and an enclosure would not contain the exact value.
    """
    source = random.Random(0)
    try:
        _run_all(GenericPoint(scene, FiniteField(random_prime(source), source)))
    except (TypeError, DomainError) as error:
        return f"not rational: {message_of(error)}"
    except (RefusedError, ZeroDivisionError):
        return ""  # undefined at this point: `prove` reports it
    except Exception as error:
        if not (origin := scene_function_that_raised(scene, error)):
            raise
        return f"not rational: {origin}"
    return ""


def _run_all(at: Quantities) -> None:
    """Call every function of the scene, floating-point warnings off."""
    with np.errstate(all="ignore"):
        for _ in function_results(at.scene, at):
            pass
