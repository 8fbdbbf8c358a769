"""Python code that reproduces a finding, run as it is printed.

Of a scene the code imports its class and makes it again with its arguments. Of functions it imports
them from where they are defined, or leaves a comment where they can be imported from nowhere.
"""

from __future__ import annotations

import inspect
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from eomcheck.engines import Engine, engine_of
from eomcheck.errors import one_line
from eomcheck.mechanics.parameters import Parametric
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

# ---- Scenes and engines --------------------------------------------------------------------------

INSTALLED = tuple(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))
"""Folders from which any Python imports."""


def reproducer_code(
    scene: Scene | SubjectUnderTest, state: State | None, engines: Iterable[type[Engine]] = ()
) -> str:
    """Return Python code that prints what fails in a state, or for all states where it is None.

    Args:
        scene: the scene; a subject that is none says itself what shows it again.
        state: (q, v, t), or None.
        engines: engines on trial there, which are then the only ones to look at.
    """
    if not isinstance(scene, Scene):
        return scene.as_python(state)
    engines = tuple(engines)
    text = reproducer_header(scene, engines)
    if state is None:
        text += "for finding in eomcheck.prove(scene):\n"
    else:
        chosen = ", ".join(kind.__name__ for kind in engines)
        more = f", engines=[{chosen}]" if engines else ""
        text += (
            f"q = {state.q.tolist()}\n"
            f"v = {state.v.tolist()}\n"
            "for finding in eomcheck.check_state("
            f"scene, q, v, t={state.t!r}, consistent=False{more}):\n"
        )
    return text + '    if finding.verdict == "failed":\n        print(finding)\n'


def reproducer_header(scene: Scene, engines: Iterable[type[Engine]] = ()) -> str:
    """Return Python code that makes a scene, and the classes of engines known."""
    places = [_import_lines(type(scene)), *(_import_lines(kind) for kind in engines)]
    lines = [line for place in places for line in place.splitlines()]
    head = "\n".join(dict.fromkeys(["import eomcheck", *lines]))
    return f"{head}\n\nscene = {scene_code(scene)}\n"


# ---- Classes -------------------------------------------------------------------------------------


def _import_lines(kind: type) -> str:
    """Return the lines that make a class known, or a comment where there is none."""
    if imported := getattr(getattr(kind, "source", None), "imports", ""):
        return imported
    name, module = kind.__name__, kind.__module__
    if module.startswith("eomcheck."):
        home = "eomcheck.scenes" if issubclass(kind, Scene) and _in_scenes(kind) else module
        return f"from {home} import {name}"
    file = getattr(sys.modules.get(module), "__file__", None)
    if kind.__qualname__ != name or (file is None and module == "__main__"):
        return f"# {kind.__qualname__} is defined nowhere that can be imported: define it here"
    if file is None or _is_installed(file):
        return f"from {module} import {name}"
    path = Path(file).resolve()
    if "." not in module:
        return (
            f"from eomcheck.class_lookup import in_file\n{name} = in_file({str(path)!r}, {name!r})"
        )
    # Files of one package import each other by their names.
    depth = module.count(".") + (path.name == "__init__.py")
    root = str(path.parents[depth])
    return f"import sys\nsys.path.insert(0, {root!r})\nfrom {module} import {name}"


def _in_scenes(kind: type) -> bool:
    return getattr(sys.modules.get("eomcheck.scenes"), kind.__name__, None) is kind


def _is_installed(file: str) -> bool:
    return any(Path(file).is_relative_to(folder) for folder in INSTALLED)


# ---- Scenes --------------------------------------------------------------------------------------


def scene_code(scene: Scene) -> str:
    """Return Python that makes a scene again: its arguments as far as it keeps them by name."""
    kind = type(scene)
    if isinstance(scene, Parametric):
        return repr(scene)
    if is_dataclass(scene):
        kept = {one.name: getattr(scene, one.name) for one in fields(scene) if one.init}
        return _call(kind, kept)
    if kind.__repr__ is not object.__repr__:
        return repr(scene)
    try:
        if _same(vars(kind()), vars(scene)):
            return f"{kind.__name__}()"
    except Exception:  # it has no defaults
        pass
    names = [name for name in inspect.signature(kind).parameters if hasattr(scene, name)]
    return _call(kind, {name: getattr(scene, name) for name in names})


def _call(kind: type, arguments: dict[str, Any]) -> str:
    said = ", ".join(f"{name}={_literal(value)}" for name, value in arguments.items())
    return f"{kind.__name__}({said})"


def _literal(value: Any) -> str:
    plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    return repr(plain)


def _same(x: Any, y: Any) -> bool:
    """Return whether two values are equal, arrays in them entry by entry."""
    if type(x) is not type(y):
        return False
    if isinstance(x, dict):
        return x.keys() == y.keys() and all(_same(x[key], y[key]) for key in x)
    if isinstance(x, list | tuple):
        return len(x) == len(y) and all(map(_same, x, y))
    if isinstance(x, np.ndarray):
        return np.array_equal(x, y)
    return bool(x == y)


class SubjectUnderTest(Protocol):
    """What is on trial where it is no scene."""

    @property
    def name(self) -> str:
        """What reports call it."""
        ...

    @property
    def structure(self) -> str:
        """What it is, apart from numbers."""
        ...

    def as_python(self, state: State | None) -> str:
        """Return Python code that shows what fails in a state, or in all where it is None."""
        ...


# ---- Functions -----------------------------------------------------------------------------------


def functions_reproducer(
    functions: Any, inputs: Mapping[str, Any], fields: Iterable[Any], state: State | None
) -> str:
    """Return Python code that prints what fails, compared with the same reference.

    Args:
        functions: a `Functions`.
        inputs: names of what are functions.
        fields: the fields of a `Functions`.
        state: where, or None for the states that are drawn by default.
    """
    head, arguments, paths = ["from eomcheck.testing import check_functions"], [], {}
    for one in fields:
        value = getattr(functions, one.name)
        if one.name == "n" or value is None or value is one.default:
            continue
        if one.name == "against":
            code, written = reference_code(value)
            head.extend(code.splitlines())
            arguments.append(f"against={written}")
            continue
        if one.name not in inputs and not callable(value):
            arguments.append(f"{one.name}={value!r}")
            continue
        where = import_location(value)
        if where is None:
            arguments.append(f"{one.name}={one.name}")
            head.append(f"# to be put in: {one.name} = {function_label(value)}")
        elif isinstance(where[0], Path):
            holder = paths.setdefault(where[0], f"file{len(paths) + 1}" if paths else "file")
            arguments.append(f"{one.name}={holder}[{where[1]!r}]")
        else:
            head.append(f"from {where[0]} import {where[1]}")
            arguments.append(f"{one.name}={where[1]}")
    if paths:
        folders = dict.fromkeys(str(path.parent) for path in paths)
        head.insert(0, "import runpy\nimport sys\n")
        head.append(f"sys.path += {[*folders]!r}")  # a file may import what is beside it
    head.extend(f"{name} = runpy.run_path({str(path)!r})" for path, name in paths.items())
    if state is not None:
        arguments.append(f"states=[({state.q.tolist()}, {state.v.tolist()})]")
    listed = "".join(f"    {argument},\n" for argument in arguments)
    call = f"for finding in check_functions(\n    {functions.n},\n{listed}):\n"
    return (
        "\n".join(head)
        + "\n\n"
        + call
        + '    if finding.verdict == "failed":\n        print(finding)\n'
    )


def reference_code(against: Any) -> tuple[str, str]:
    """Return (code that comes before, expression) of what functions are compared with.

    A scene, and an engine of a scene, are made again; anything else is left to be put in.
    """
    match against:
        case Scene():
            return reproducer_header(against), "scene"
        case Engine(scene=Scene() as scene):
            kind = type(against)
        case (engine, Scene() as scene):
            kind = engine_of(engine)
        case _:
            return f"# to be put in: against = {one_line(repr(against))}", "against"
    return reproducer_header(scene, [kind]), f"({kind.__name__}, scene)"


def import_location(function: Any) -> tuple[str | Path, str] | None:
    """Return (module or file, name) where a function is found again, or None where it is not.

    A module of one file is taken by its path: it may be importable from its own folder only.
    """
    name = getattr(function, "__qualname__", "")
    module = sys.modules.get(getattr(function, "__module__", None) or "")
    if not name.isidentifier():
        return None
    if module is not None and "." in module.__name__:
        return (module.__name__, name) if getattr(module, name, None) is function else None
    code = getattr(function, "__code__", None)
    known = function.__globals__.get(name) is function if code is not None else False
    path = Path(code.co_filename) if code is not None else None
    return (path.resolve(), name) if known and path is not None and path.is_file() else None


def function_label(function: Any) -> str:
    """Return what a function is called, and where it is written."""
    code = getattr(function, "__code__", None)
    name = getattr(function, "__qualname__", None) or repr(function)
    return f"{name}, {code.co_filename}:{code.co_firstlineno}" if code is not None else name
