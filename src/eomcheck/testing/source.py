"""Python code that checks functions again: where they can be imported from."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from eomcheck.claims.repeat import beginning_of
from eomcheck.engines import Engine, engine_of
from eomcheck.errors import one_line
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene


def python_of_functions(
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
            code, written = of_reference(value)
            head.extend(code.splitlines())
            arguments.append(f"against={written}")
            continue
        if one.name not in inputs and not callable(value):
            arguments.append(f"{one.name}={value!r}")
            continue
        where = place(value)
        if where is None:
            arguments.append(f"{one.name}={one.name}")
            head.append(f"# to be put in: {one.name} = {described(value)}")
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


def of_reference(against: Any) -> tuple[str, str]:
    """Return (code that comes before, expression) of what functions are compared with.

    A scene, and an engine of a scene, are made again; anything else is left to be put in.
    """
    match against:
        case Scene():
            return beginning_of(against), "scene"
        case Engine(scene=Scene() as scene):
            kind = type(against)
        case (engine, Scene() as scene):
            kind = engine_of(engine)
        case _:
            return f"# to be put in: against = {one_line(repr(against))}", "against"
    return beginning_of(scene, [kind]), f"({kind.__name__}, scene)"


def place(function: Any) -> tuple[str | Path, str] | None:
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


def described(function: Any) -> str:
    """Return what a function is called, and where it is written."""
    code = getattr(function, "__code__", None)
    name = getattr(function, "__qualname__", None) or repr(function)
    return f"{name}, {code.co_filename}:{code.co_firstlineno}" if code is not None else name
