"""Python code that reproduces a finding, run as it is printed.

For a scene, an engine or a motion the code imports the classes and constructs the scene with the
same arguments. For functions it imports each from the module or file of its definition, or leaves a
comment if there is none.
"""

from __future__ import annotations

import inspect
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from textwrap import indent
from typing import Any, Protocol

import numpy as np

from eomcheck.calls import NO_ANSWER, patience
from eomcheck.engines import Engine, engine_of
from eomcheck.errors import one_line
from eomcheck.mechanics.parameters import Parametric
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

# ---- Scenes and engines --------------------------------------------------------------------------

INSTALLED = tuple(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))
"""Folders of the standard library and of installed packages."""

LOOP = "for finding in "
"""Beginning of the loop over the findings of a check."""

PRINT_FAILED = '    if finding.verdict == "failed":\n        print(finding)\n'
"""Body of the loop over the findings of a check."""


def reproducer_code(
    scene: Scene | SubjectUnderTest, state: State | None, engines: Iterable[type[Engine]] = ()
) -> str:
    """Return Python code that prints the failures in a state, or for all states if it is None.

    Args:
        scene: the scene; a `SubjectUnderTest` returns its own code.
        state: (q, v, t), or None.
        engines: engines under test; the code then checks no others.
    """
    if not isinstance(scene, Scene):
        return scene.as_python(state)
    engines = tuple(engines)
    text = reproducer_header(scene, engines)
    if state is None:
        text += f"{LOOP}eomcheck.prove(scene):\n"
    else:
        chosen = ", ".join(kind.__name__ for kind in engines)
        more = f", engines=[{chosen}]" if engines else ""
        text += (
            f"q = {state.q.tolist()}\n"
            f"v = {state.v.tolist()}\n"
            f"{LOOP}eomcheck.check_state("
            f"scene, q, v, t={state.t!r}, consistent=False{more}):\n"
        )
    return text + PRINT_FAILED


def reproducer_of(
    detail: str,
    scene: Scene | SubjectUnderTest,
    state: State | None,
    engines: Iterable[type[Engine]] = (),
) -> str:
    """Return Python code that prints the failures in a state; that of a hang has a time limit.

    Args:
        detail: detail of the failure.
        scene, state, engines: see `reproducer_code`.
    """
    code = reproducer_code(scene, state, engines)
    if NO_ANSWER not in detail:
        return code
    head, loop = code.split(LOOP, 1)
    imported = "" if head.startswith("import eomcheck\n") else "import eomcheck\n"
    limited = indent(LOOP + loop, "    ")
    return f"{imported}{head}with eomcheck.time_limit({patience():g}):\n{limited}"


def motion_reproducer(scene: Scene, state: State, t_end: float, key: str, tolerance: float) -> str:
    """Return Python code that prints how far motions by all formulations are from one by `key`.

    Args:
        scene: the scene.
        state: the start, at t = 0.
        t_end: end, s.
        key: the formulation that others contradict.
        tolerance: rtol and atol.
    """
    return (
        f"from eomcheck.formulations import applicable\n{reproducer_header(scene)}"
        f"options = dict(q0=[{state.q.tolist()}], v0=[{state.v.tolist()}])\n"
        f"options |= dict(rtol={tolerance}, atol={tolerance})\n"
        f"one = eomcheck.simulate_many(scene, {key!r}, {t_end!r}, **options)\n"
        "for key in applicable(scene):\n"
        f"    other = eomcheck.simulate_many(scene, key, {t_end!r}, **options)\n"
        "    apart = abs(one.q[0] - other.q[0]).max(axis=1)\n"
        "    gained = abs(other.energy[0] - other.energy[0, 0]).max()\n"
        '    print(key, other.status[0], "apart", apart[-1], "energy", gained, other.reason[0])\n'
    )


def reproducer_header(scene: Scene, engines: Iterable[type[Engine]] = ()) -> str:
    """Return Python code that constructs a scene, and imports the classes of engines."""
    imports = [_import_lines(type(scene)), *(_import_lines(kind) for kind in engines)]
    lines = [line for text in imports for line in text.splitlines()]
    head = "\n".join(dict.fromkeys(["import eomcheck", *lines]))
    return f"{head}\n\nscene = {scene_code(scene)}\n"


# ---- Classes -------------------------------------------------------------------------------------


def _import_lines(kind: type) -> str:
    """Return the lines that import a class, or a comment if it cannot be imported."""
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
    # Modules of one package import each other by their full names.
    depth = module.count(".") + (path.name == "__init__.py")
    root = str(path.parents[depth])
    return f"import sys\nsys.path.insert(0, {root!r})\nfrom {module} import {name}"


def _in_scenes(kind: type) -> bool:
    return getattr(sys.modules.get("eomcheck.scenes"), kind.__name__, None) is kind


def _is_installed(file: str) -> bool:
    return any(Path(file).is_relative_to(folder) for folder in INSTALLED)


# ---- Scenes --------------------------------------------------------------------------------------


def scene_code(scene: Scene) -> str:
    """Return a Python expression that constructs a scene, from arguments stored as attributes."""
    kind = type(scene)
    if isinstance(scene, Parametric):
        return repr(scene)
    if is_dataclass(scene):
        stored = {field.name: getattr(scene, field.name) for field in fields(scene) if field.init}
        return _call(kind, stored)
    if kind.__repr__ is not object.__repr__:
        return repr(scene)
    try:
        if _same(vars(kind()), vars(scene)):
            return f"{kind.__name__}()"
    except Exception:  # the constructor has no defaults
        pass
    names = [name for name in inspect.signature(kind).parameters if hasattr(scene, name)]
    return _call(kind, {name: getattr(scene, name) for name in names})


def _call(kind: type, arguments: dict[str, Any]) -> str:
    written = ", ".join(f"{name}={_literal(value)}" for name, value in arguments.items())
    return f"{kind.__name__}({written})"


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
    """A subject of findings other than a scene, such as user-supplied functions."""

    @property
    def name(self) -> str:
        """Its name in reports."""
        ...

    @property
    def structure(self) -> str:
        """Its structural variant: a text without its numbers."""
        ...

    def as_python(self, state: State | None) -> str:
        """Return Python code that prints the failures in a state, or in all states if None."""
        ...


# ---- Functions -----------------------------------------------------------------------------------


def functions_reproducer(
    functions: Any, inputs: Mapping[str, Any], fields: Iterable[Any], state: State | None
) -> str:
    """Return Python code that prints the failures of functions against the same reference.

    Args:
        functions: an `EquationsOfMotion`.
        inputs: keyed by the names of its fields that are functions.
        fields: its dataclass fields.
        state: the failing state, or None for the states drawn by default.
    """
    head, arguments, paths = ["from eomcheck.testing import check_functions"], [], {}

    def expression(name: str, function: Any) -> str:
        """Return the expression of a function; what it takes goes into `head` and `paths`."""
        where = import_location(function)
        if where is None:
            head.append(f"# to be put in: {name} = {function_label(function)}")
            return name
        if isinstance(where[0], Path):
            holder = paths.setdefault(where[0], f"file{len(paths) + 1}" if paths else "file")
            return f"{holder}[{where[1]!r}]"
        head.append(f"from {where[0]} import {where[1]}")
        return where[1]

    for one in fields:
        value = getattr(functions, one.name)
        if one.name == "n" or value is None or value is one.default:
            continue
        if one.name == "against":
            code, written = reference_code(value)
            head.extend(code.splitlines())
            arguments.append(f"against={written}")
            continue
        if isinstance(value, Mapping) and one.name in inputs:  # a function for each frame
            items = [
                f"{frame!r}: {expression(f'{one.name}_{i}', function)}"
                for i, (frame, function) in enumerate(value.items())
            ]
            arguments.append(f"{one.name}={{{', '.join(items)}}}")
        elif callable(value):
            arguments.append(f"{one.name}={expression(one.name, value)}")
        else:
            numbers = isinstance(value, np.ndarray | np.generic)
            arguments.append(f"{one.name}={_literal(value) if numbers else repr(value)}")
    if paths:
        folders = dict.fromkeys(str(path.parent) for path in paths)
        head.insert(0, "import runpy\nimport sys\n")
        head.append(f"sys.path += {[*folders]!r}")  # for imports of files beside it
    head.extend(f"{name} = runpy.run_path({str(path)!r})" for path, name in paths.items())
    if state is not None:
        arguments.append(f"states=[({state.q.tolist()}, {state.v.tolist()})]")
    listed = "".join(f"    {argument},\n" for argument in arguments)
    call = f"{LOOP}check_functions(\n    {functions.n},\n{listed}):\n"
    return "\n".join(head) + f"\n\n{call}{PRINT_FAILED}"


def reference_code(against: Any) -> tuple[str, str]:
    """Return (preceding code, expression) of the reference that functions are compared with.

    A scene, or an engine of a scene, is constructed again; any other reference has to be filled in.
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
    """Return (module or file, name) from which a function can be imported, None if it cannot.

    A top-level module is given by its path: it may be importable from its own folder only.
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
    """Return the name of a function with the file and line of its definition."""
    code = getattr(function, "__code__", None)
    name = getattr(function, "__qualname__", None) or repr(function)
    return f"{name}, {code.co_filename}:{code.co_firstlineno}" if code is not None else name
