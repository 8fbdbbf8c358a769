"""User-supplied scenes: the function that raised an error, shapes, and exact numbers.

Shapes that the contract asks of a scene's functions are checked before any claim is: numbers of
wrong shape would end in an error deep inside a formulation, or be broadcast. An error is attributed
to the scene's own function that raised it. A scene function is tried in float64 and on exact
numbers, which it need not support.
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
from eomcheck.mechanics.scene import FUNCTIONS, Scene, checked_scene
from eomcheck.numbers.finite_field import DomainError, FiniteField, random_prime
from eomcheck.numbers.generic import FLOAT64, map_record

# ---- Origin of errors ----------------------------------------------------------------------------

HERE = Path(eomcheck.__file__).parent


def scene_function_that_raised(scene: Scene, error: BaseException) -> str:
    """Return which function of the scene's own raised what, and where; "" where none did."""
    files = _files(type(scene))
    through = [x for x in traceback.extract_tb(error.__traceback__) if x.filename in files]
    if not through:
        kinds = [f"{kind.__name__}." for kind in type(scene).__mro__]
        own = isinstance(error, CallError) and error.name.startswith(tuple(kinds))
        return str(error) if own else ""
    return f"{type(scene).__name__}.{through[-1].name} {raised(error, through[-1])}"


def _files(kind: type[Scene]) -> set[str]:
    """Return the files in which functions of a kind of scene are written, but for those of ours."""
    functions = [getattr(kind, name, None) for name in FUNCTIONS]
    functions += [x for of in kind.__mro__ for x in vars(of).values()]
    codes = (getattr(inspect.unwrap(x), "__code__", None) for x in functions if callable(x))
    files = {code.co_filename for code in codes if code is not None}
    return {file for file in files if not Path(file).is_relative_to(HERE)}


# ---- Shapes --------------------------------------------------------------------------------------

Shape = tuple[int, ...]
Returned = tuple[str, str, Any, Shape]
"""Name of the function, of what it returns, that itself, and the shape it should have."""

ARRAYS: Any = (np.ndarray, Number)
"""Types of arrays and numbers that functions may return."""

NEEDED = frozenset({"V", "ω", "M", "T", "u", "r", "Φ"})
"""Symbols that every scene gives."""

OF_CONSTRAINTS = frozenset({("terms", "a"), ("constraint", "c")})
"""Functions and their symbols that every scene with constraints gives.

`constraints` may leave out a: where `terms` are written by hand nothing asks for it.
"""

_shapes_checked: set[tuple[type[Scene], str]] = set()


def check_shapes(scene: Scene) -> None:
    """Check what each function of `scene` returns, once for each structure.

    None stands for what a scene has not, where it may be left out.

    Raises:
        InputError: an array has not the shape of the contract (`eomcheck.mechanics.scene`).
    """
    which = type(scene), scene.structure
    if which in _shapes_checked:
        return
    try:
        compare_shapes(scene, _somewhere(scene))
    except InputError:
        raise
    except Exception as error:
        if scene_function_that_raised(scene, error):
            return  # which is told of the state where it happens
        raise
    _shapes_checked.add(which)


def compare_shapes(scene: Scene, at: Quantities) -> None:
    """Shapes of what each function of `scene` returns at one point, compared with the contract's.

    Raises:
        InputError: an array has another shape, or what a function of somebody's own returns ends in
            an error of ours.
        Exception: what a function of the scene raised.
    """
    try:
        _compare_shapes(scene, at)
    except InputError:
        raise
    except Exception as error:
        if is_ours(type(scene)) or scene_function_that_raised(scene, error):
            raise
        said = f"{described_error(error)}, of what its functions return"
        raise InputError(f"{type(scene).__name__}: {said}") from error


def _compare_shapes(scene: Scene, at: Quantities) -> None:
    needed = OF_CONSTRAINTS if scene.r else frozenset()
    with np.errstate(all="ignore"):
        if scene.natural_speeds:
            with suppress(RefusedError):
                map_record(partial(_check_shared, scene), at.kinematics)
        for function, name, found, shape in function_results(scene, at):
            whose = f"{type(scene).__name__}.{function}: {name}"
            if found is None and name not in NEEDED and (function, name) not in needed:
                continue
            if not isinstance(found, ARRAYS):
                kind = "None" if found is None else f"a {type(found).__name__}"
                raise InputError(f"{whose} is {kind}, expected an array of shape {shape}")
            array: np.ndarray = np.asarray(found)
            if array.shape != shape:
                raise InputError(f"{whose} has shape {array.shape}, expected {shape}")
            if not (array.dtype.kind in "fiub" or all(isinstance(x, Real) for x in array.flat)):
                raise InputError(f"{whose} is an array of {array.dtype}, expected real numbers")


def _check_shared(scene: Scene, part: Any) -> None:
    """Raise InputError if a part of what speeds and bodies share cannot be looked into."""
    if not isinstance(part, ARRAYS):
        raise InputError(
            f"{type(scene).__name__}.kinematics: a {type(part).__name__}, expected an array, a "
            "number, or a NamedTuple of these"
        )


def _somewhere(scene: Scene) -> Quantities:
    random = np.random.default_rng(0)
    at = Quantities(scene, FLOAT64, random.uniform(0.1, 1.0, checked_scene(scene).n))
    at.v, at.u = random.uniform(0.1, 1.0, scene.n), random.uniform(0.1, 1.0, scene.p)
    return at


def function_results(scene: Scene, at: Quantities) -> Iterator[Returned]:
    """Yield what the functions return at a point, those first that others are made of."""
    n, r, p = scene.n, scene.r, scene.p
    place = at.parameters, at.prepared, at.q
    here = *place, at.v

    V, omega = scene.velocities(*here)
    bodies, d, e = np.size(at.parameters.mass), np.shape(V)[-1], np.shape(omega)[-1]
    yield "velocities", "V", V, (bodies, d)
    yield "velocities", "ω", omega, (bodies, e)
    if hasattr(scene, "jacobians"):
        shapes = (bodies, d, n), (bodies, e, n), (bodies, d), (bodies, e), (bodies, e)
        yield from _fields("jacobians", scene.jacobians(*here), shapes)
        yield "drift", "gamma", scene.drift(*here), (r,)
        yield "forces", "Q", scene.forces(*here), (n,)
        yield "potential", "U", scene.potential(*place), ()
    if hasattr(scene, "constraints"):  # a scene that never moves may do without
        a, b = scene.constraints(*place)
        yield "constraints", "a", a, (r, n)
        yield "constraints", "b", b, (r,)
    yield from _fields("terms", at.terms, ((n, n), (n,), (n,), (r, n), (r,), (r,)))
    yield "constraint", "c", scene.constraint(*here), (r,)
    T, U = scene.energies(*here)
    yield "energies", "T", T, ()
    yield "energies", "U", U, ()
    if scene.dissipation is not None:
        yield "dissipation", "R", scene.dissipation(*here), ()
    if scene.positions is not None:
        yield "positions", "r", scene.positions(*place), (bodies, d)
    if scene.position_residual is not None:
        rows = len(range(r)[scene.holonomic])
        yield "position_residual", "Φ", scene.position_residual(*place), (rows,)
    yield "speeds_of", "u", scene.speeds_of(*here), (p,)
    try:
        yield from _fields("speeds", at.speeds, ((n, p), (n,), (n,)))
        # Components that vanish may be left out here.
        d, e = (np.shape(velocity)[1] for velocity in at.bodies[:2])
        shapes = (bodies, d, p), (bodies, e, p), (bodies, d), (bodies, e)
        shapes = *shapes, (bodies,), (bodies, e, e), (bodies, e), (p,)
        yield from _fields("bodies", at.bodies, shapes)
    except RefusedError:
        return  # no generalized speeds here


def _fields(function: str, record: Any, shapes: tuple[Shape, ...]) -> Iterator[Returned]:
    names = getattr(record, "_fields", ()) if isinstance(record, tuple) else ()
    if len(names) != len(shapes):
        said = f"a NamedTuple of {len(shapes)}"
        raise InputError(f"{function}: a {type(record).__name__}, expected {said}")
    for name, found, shape in zip(names, record, shapes, strict=True):
        yield function, name, found, shape


# ---- Float64 and exact numbers -------------------------------------------------------------------

_why_not_rational: dict[tuple[type[Scene], str], str] = {}


def failing_function(scene: Scene, state: State) -> str:
    """Which function of the scene raises on doubles or returns another shape there; or ""."""
    try:
        compare_shapes(scene, Evaluation(scene, *state))
    except Exception as error:
        misshapen = message_of(error) if isinstance(error, InputError) else ""
        return scene_function_that_raised(scene, error) or misshapen
    return ""


def why_not_rational(scene: Scene) -> str:
    """Return why a function of the scene does not run on exact numbers, "" where all do.

    It is asked once for each structure. Where one does not, digits could be lost on the way through
    balls as well, in a float of its own, and what is enclosed would not be true.
    """
    which = type(scene), scene.structure
    if which not in _why_not_rational:
        source = random.Random(0)
        try:
            _run_all(GenericPoint(scene, FiniteField(random_prime(source), source)))
            _why_not_rational[which] = ""
        except (TypeError, DomainError) as error:
            _why_not_rational[which] = f"not rational: {message_of(error)}"
        except (RefusedError, ZeroDivisionError):
            _why_not_rational[which] = ""  # defined nowhere near, which `prove` is to tell
        except Exception as error:
            if not (said := scene_function_that_raised(scene, error)):
                raise
            _why_not_rational[which] = f"not rational: {said}"
    return _why_not_rational[which]


def _run_all(at: Quantities) -> None:
    with np.errstate(all="ignore"):
        for _ in function_results(at.scene, at):
            pass
