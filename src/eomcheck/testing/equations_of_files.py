"""Equations of motion in a user's Python file: functions by name, `EquationsOfMotion`, or SymPy's.

A file is read as a namespace: functions that have the names of `EquationsOfMotion` are its inputs,
`n`, `ranges` and other options are read beside them. Without `n` the number of coordinates is the
one with which the shapes of all results agree. A SymPy model takes its numbers from the dict
`numbers` of the file; otherwise they are drawn.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from types import FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from eomcheck.calls import call
from eomcheck.class_lookup import class_named, home_of_code, module_named, object_named
from eomcheck.console import activity
from eomcheck.engines import Engine
from eomcheck.errors import CallError, InputError, described_error, nearest_name, safe_repr
from eomcheck.mechanics.scene import Scene
from eomcheck.safe_output import counted, listed
from eomcheck.scene_lookup import SCENE, scene_named
from eomcheck.testing.called_functions import called_functions, is_wrapper_of
from eomcheck.testing.converters import (
    drawn_parameters,
    equations_held_by,
    is_sympy_model,
    sort_and_call,
)
from eomcheck.testing.equations_of_motion import (
    INPUTS,
    BrokenError,
    EquationsOfMotion,
    FunctionCaller,
    argument_names,
    equations_from,
)

NUMBERS = "numbers"
"""Name of the dict, symbol -> number, of a file with a SymPy model."""

FILE_OPTIONS = ("ranges", "bias_has_gravity", "speeds", "holonomic", "coriolis_skew")
"""Arguments of `EquationsOfMotion` that are no functions and are read from a file."""

OPTIONS_OF_MODELS = "ranges", "holonomic"
"""Arguments among them that are read beside a SymPy model."""

MOST_TRIED = 100
"""Largest number of coordinates that is tried."""

SIZED = ("M", "C", "gravity", "bias", "qdd", "Q", "tau_q", "inverse_mass_matrix")
"""Functions whose shape shows the number of coordinates."""


class FileEquations(NamedTuple):
    """Equations of motion of a file.

    Attributes:
        equations: the equations.
        notes: sentences on how they were read: drawn numbers, the n that was found, objects that
            have the name of a function and are none.
    """

    equations: EquationsOfMotion
    notes: tuple[str, ...]


def read_equations(
    name: str,
    n: int | None = None,
    parameters: Mapping[Any, float] | None = None,
    seed: int = 0,
) -> FileEquations:
    """Return the equations of motion of a Python file.

    Args:
        name: "FILE.py", "FILE.py:NAME" or "package.module:NAME". NAME may be `EquationsOfMotion`, a
            SymPy `KanesMethod` or `LagrangesMethod`, or a dict, class or object that holds
            functions; without NAME it is the only such object of the file, or else its functions.
        n: number of coordinates of functions; by default the `n` beside them, or found.
        parameters: symbol -> number, for a SymPy model; by default the dict `numbers` of the file.
        seed: seed of the numbers of a SymPy model, where the file gives none.

    Raises:
        InputError: no such file or object, or it holds no equations of motion; n cannot be found.
    """
    home, of = (name, "") if name.endswith(".py") else home_of_code(name) or ("", "")
    if not home:
        raise InputError(f"file = {name!r}, expected FILE.py or FILE.py:NAME{_scene_hint(name)}")
    with activity(f"running {home}"):
        module = module_named(home)
    holder = object_named(name, required=True) if of else _only_model(module, home)
    if isinstance(holder, EquationsOfMotion) or is_sympy_model(holder):
        return _read_model(holder, module, n, parameters, seed)
    if isinstance(holder, Scene | Engine) or (
        isinstance(holder, type) and issubclass(holder, Scene | Engine)
    ):
        raise InputError(f"file = {name!r}, {sort_and_call(holder)}")
    if isinstance(holder, type):
        holder = _instance(holder, name)
    title = of or home.rpartition("/")[2].removesuffix(".py")
    return _read_functions(holder, name, title, n)


def reference_named(name: str, n: int, seed: int = 0) -> Scene | EquationsOfMotion:
    """Return the reference that equations are compared with: of a file, or a scene of any name.

    Args:
        name: as for `read_equations`; or a scene, see `eomcheck.scene_lookup.scene_named`.
        n: number of coordinates of functions, where their file has no `n`.
        seed: see `read_equations`.

    Raises:
        InputError: see `read_equations` and `scene_named`.
        UnknownNameError: no scene has this name.
    """
    if not name.endswith(".py") and home_of_code(name) is None:
        return scene_named(name)
    held = None if name.endswith(".py") else object_named(name, required=True)
    if isinstance(held, Scene):
        return held
    if isinstance(held, type) and issubclass(held, Scene):
        return class_named(SCENE, name).example()
    return read_equations(name, n, seed=seed).equations


@lru_cache(16)
def equations_named(name: str) -> FileEquations | None:
    """Return the equations of motion of a name, see `read_equations`; None if it holds none.

    Args:
        name: "FILE.py", "FILE.py:NAME" or "package.module:NAME". A NAME that is a scene, is missing
            or has none of the functions that are checked holds no equations; any other name
            neither, such as that of a scene or a robot.

    Raises:
        InputError: see `read_equations`.
    """
    if not name.endswith(".py"):
        held = object_named(name)
        names = held if isinstance(held, Mapping) else _Attributes(held)
        scene = isinstance(held, type) and issubclass(held, Scene | Engine)
        model = isinstance(held, EquationsOfMotion) or is_sympy_model(held)
        if isinstance(held, Scene | Engine) or scene:
            return None
        if not model and not any(key in names and _is_function(names[key]) for key in INPUTS):
            return None
    return read_equations(name)


def _scene_hint(name: str) -> str:
    """Return the command that checks a scene of this name."""
    return f"; a scene is checked by `eomcheck validate --scene {name}`"


def _only_model(module: ModuleType, home: str) -> Any:
    """Return the only `EquationsOfMotion` or SymPy model of a module, or else the module itself."""
    models = {
        name: value
        for name, value in vars(module).items()
        if isinstance(value, EquationsOfMotion) or is_sympy_model(value)
    }
    if len({id(value) for value in models.values()}) > 1:
        raise InputError(f"{home!r} has several: expected one of {', '.join(models)} after a colon")
    return next(iter(models.values()), module)


def _read_model(
    held: Any,
    module: ModuleType,
    n: int | None,
    parameters: Mapping[Any, float] | None,
    seed: int,
) -> FileEquations:
    """Return the equations of `EquationsOfMotion` or of a SymPy model, with its numbers."""
    if isinstance(held, EquationsOfMotion):
        if n is not None and n != held.n:
            raise InputError(f"n = {n}, but the equations have n = {held.n}")
        return FileEquations(held, ())
    if n is not None:
        raise InputError(f"n = {n}: a SymPy model has its own number of coordinates")
    notes: tuple[str, ...] = ()
    if parameters is None:
        parameters = vars(module).get(NUMBERS)
    if parameters is None:
        parameters = drawn_parameters(held, seed)
        values = ", ".join(f"{symbol} = {value:.4g}" for symbol, value in parameters.items())
        notes = (f"drawn with seed {seed}, as the file has no dict `{NUMBERS}`: {values}",)
    equations = equations_held_by(held, parameters)
    assert equations is not None
    options = {key: vars(module)[key] for key in OPTIONS_OF_MODELS if key in vars(module)}
    equations = replace(equations, **options)
    return FileEquations(equations, notes if parameters else ())


def _instance(kind: type, name: str) -> Any:
    """Return an instance of a user's class, made without arguments."""
    try:
        return call(f"{name}()", kind)
    except CallError as error:
        raise InputError(f"{name}() {error.what}") from error
    except Exception as error:
        raise InputError(f"{name}() raised {described_error(error)}") from error


# ---- Functions of a namespace --------------------------------------------------------------------


def _read_functions(holder: Any, name: str, title: str, n: int | None) -> FileEquations:
    """Return the equations of the functions that a module, dict or object holds."""
    names = holder if isinstance(holder, Mapping) else _Attributes(holder)
    functions, other = {}, []
    for key in INPUTS:
        if key not in names:
            continue
        value = names[key]
        if imported := _imported_as(key, value):
            other.append(f"{key}, which is {imported}")
        elif _is_function(value):
            functions[key] = value
        else:
            other.append(f"{key} = {safe_repr(value)}")
    if not functions:
        raise InputError(_no_function(holder, name, other))
    options = {key: names[key] for key in FILE_OPTIONS if key in names}
    notes = []
    if n is None and "n" in names and isinstance(names["n"], int | np.integer):
        n = int(names["n"])
    if n is None:
        n, source = found_coordinates(functions)
        notes.append(f"n = {n} coordinates, as {source} shows")
    if unread := _unread(holder, functions):
        other.append(listed(unread, 5))
    if other:
        notes.append(f"not read: {', '.join(other)}")
    read = {key: value for key, value in options.items() if value is not None}
    return FileEquations(equations_from(n, {**functions, **read, "name": title}), tuple(notes))


class _Attributes:
    """Attributes of an object by name, as a dict would hold them."""

    def __init__(self, holder: Any):
        self._holder = holder

    def __contains__(self, name: str) -> bool:
        return hasattr(self._holder, name)

    def __getitem__(self, name: str) -> Any:
        return getattr(self._holder, name)


def _is_function(value: Any) -> bool:
    """Return whether a value is a function, or a dict of functions of frames; no class is."""
    if isinstance(value, Mapping):
        return bool(value) and all(map(_is_function, value.values()))
    return callable(value) and not isinstance(value, type)


def _imported_as(name: str, value: Any) -> str:
    """Return where a function comes from that was imported under another name; "" otherwise.

    A short name such as `b` may stand for anything, `from model import bias as b`.
    """
    home, own = getattr(value, "__module__", None), getattr(value, "__name__", name)
    if own != name and getattr(sys.modules.get(home or ""), own, None) is value:
        return f"{home}.{own}"
    return ""


def _unread(holder: Any, functions: Mapping[str, Any]) -> list[str]:
    """Return the names of a holder's own functions that no function that is read calls.

    A function under another name, such as a `mass_matrix`, is not checked.
    """
    if isinstance(holder, Mapping):
        members = dict(holder)
    else:
        owner = holder if isinstance(holder, ModuleType) else type(holder)
        members = {name: getattr(holder, name) for name in vars(owner) if not name.startswith("_")}
    read = [x for x in functions.values() if not isinstance(x, Mapping)]
    homes = {getattr(x, "__module__", None) for x in read}
    own = {
        name: x
        for name, x in members.items()
        if isinstance(x, FunctionType | MethodType) and not str(name).startswith("_")
        if name not in INPUTS and name not in FILE_OPTIONS and x.__module__ in homes
    }
    calls = called_functions({**own, **functions})
    called = frozenset().union(*(calls[name] for name in functions))
    called |= {name for name, x in own.items() if any(is_wrapper_of(y, x) for y in read)}
    return [name for name in own if name not in called]


def _no_function(holder: Any, name: str, other: list[str]) -> str:
    """Return the sentence that a namespace has no function that is checked."""
    public = [
        key
        for key, value in (holder if isinstance(holder, Mapping) else vars(holder)).items()
        if not key.startswith("_") and _is_function(value)
    ]
    more = f"; it has {', '.join(other)}" if other else ""
    descriptions = {symbol.what.replace(" ", "_"): key for key, symbol in INPUTS.items()}
    renamed = {}
    for own in public:
        if nearest := nearest_name(own, descriptions):
            renamed.setdefault(descriptions[nearest], own)
    if renamed:
        likely = [f"{key} = {renamed[key]}" for key in INPUTS if key in renamed]
        more += f"; these would be read: {', '.join(likely)}"
    shown = ", ".join(
        f"{key}({', '.join(argument_names(INPUTS[key].reads))})" for key in list(INPUTS)[:5]
    )
    return f"{name!r} has none of the functions that are checked, such as {shown}{more}"


def found_coordinates(functions: Mapping[str, Any]) -> tuple[int, str]:
    """Return the number of coordinates with which the results have their shapes.

    Each function is called with 1, 2, ... coordinates until one number fits all of them.

    Args:
        functions: name -> function.

    Returns:
        The number, and the name of the function that decides.

    Raises:
        InputError: no number up to `MOST_TRIED` fits, or several do.
        CallError: a function gave no answer.
    """
    if "qdot" in functions:
        raise InputError("n is not given, expected `n = ...`: with qdot no shape shows it")
    sized = [name for name in SIZED if name in functions]
    if not sized:
        names = ", ".join(functions)
        raise InputError(f"n is not given, expected `n = ...`: no shape of {names} shows it")
    error = ""
    for name in sized:
        fitting = []
        for n in range(1, MOST_TRIED + 1):
            why = _misfit(name, functions[name], n)
            error = error or (why if n == MOST_TRIED else "")
            if not why:
                fitting.append(n)
            if len(fitting) > 1:
                break
        if len(fitting) == 1:
            return fitting[0], name
        if fitting:
            error = f"{name} has a result for {fitting[0]} and for {fitting[1]} coordinates"
    raise InputError(f"n cannot be found, expected `n = ...`: {error}")


def _misfit(name: str, function: Any, n: int) -> str:
    """Return why a function has no result of its shape for n coordinates; "" if it has."""
    caller, at = FunctionCaller(EquationsOfMotion(n, **{name: function})), np.full(n, 0.25)
    try:
        with np.errstate(all="ignore"):
            caller(name, at, at)
    except BrokenError as broken:
        call_error, when = broken.__cause__, f"called with {counted(n, 'coordinate')}"
        if isinstance(call_error, CallError) and not call_error.by_exception:
            raise CallError(call_error.name, f"{call_error.what}, {when} to find n") from broken
        return f"{name}, {when}: {broken.why}"
    return ""
