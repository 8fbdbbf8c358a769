"""Functions that a function calls, by the names in its code.

A function that computes its result by another one repeats the mistakes of that one, and is no
independent witness for it. The names that the code of a function loads are resolved in its globals,
its closure, the object it is bound to and the modules and objects among these; so are those of the
functions that are found, as far as they are Python. Nothing is called.
"""

from __future__ import annotations

import dis
from collections.abc import Iterator, Mapping
from functools import partial
from inspect import getattr_static
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

DEEPEST = 8
"""Largest number of wrappers of a function, and of calls below each other, that are followed."""

ARITHMETIC = "BINARY_", "UNARY_", "COMPARE_", "FOR_ITER", "POP_JUMP"
"""Beginnings of the names of instructions that a mere wrapper does not have."""


def called_functions(functions: Mapping[str, Any]) -> dict[str, frozenset[str]]:
    """Return the names of the other functions that each function calls, itself or through others.

    Args:
        functions: name -> function, a mapping of such, or anything else, which calls nothing.
    """
    each = {
        name: [*one.values()] if isinstance(one, Mapping) else [one]
        for name, one in functions.items()
    }
    owners: dict[int, set[str]] = {}
    for name, ones in each.items():
        for function in ones:
            owners.setdefault(_identity(_core(function)), set()).add(name)
    calls = {}
    for name, ones in each.items():
        reached = (_identity(one) for function in ones for one in _reached(_core(function)))
        calls[name] = frozenset().union(*(owners.get(x, ()) for x in reached)) - {name}
    return calls


def is_wrapper_of(function: Any, other: Any) -> bool:
    """Return whether a function is another one, or calls nothing else."""
    return _identity(_core(function)) == _identity(_core(other))


def _identity(function: Any) -> int:
    """Return a number that is the same for a function and for a method bound to it."""
    return id(getattr(function, "__func__", function))


def _core(function: Any) -> Any:
    """Return the function without decorators, partial arguments and wrappers of a single call."""
    for _ in range(DEEPEST):
        if isinstance(function, partial):
            called = function.func
        elif isinstance(function, FunctionType | MethodType):
            called = getattr(function, "__wrapped__", None) or _single_call(function)
        else:
            called = getattr(function, "__wrapped__", None)
        if not isinstance(called, FunctionType | MethodType | partial):
            break
        function = called
    return function


def _single_call(function: Any) -> Any:
    """Return the Python function that a mere wrapper calls, such as a lambda that adds arguments.

    None if the function does more than that, or has functions of its own within it.
    """
    if any(isinstance(x, CodeType) for x in function.__code__.co_consts):
        return None
    instructions = [x.opname for x in dis.get_instructions(function.__code__)]
    calls = sum(x.startswith("CALL") for x in instructions)
    if calls != 1 or any(x.startswith(ARITHMETIC) for x in instructions):
        return None
    found = [*_named(function)]
    return found[0] if len(found) == 1 else None


def _reached(function: Any, depth: int = 0, seen: set[int] | None = None) -> Iterator[Any]:
    """Yield the Python functions that a function calls, and those that they call."""
    seen = set() if seen is None else seen
    if depth == DEEPEST or not isinstance(getattr(function, "__code__", None), CodeType):
        return
    for one in _named(function):
        core = _core(one)
        if _identity(core) not in seen:
            seen.add(_identity(core))
            yield core
            yield from _reached(core, depth + 1, seen)


def _named(function: Any) -> Iterator[Any]:
    """Yield the Python functions that the names in the code of a function stand for."""
    code = function.__code__
    plain = getattr(function, "__func__", function)
    cells = zip(code.co_freevars, plain.__closure__ or (), strict=False)
    known = dict(plain.__globals__)
    for name, cell in cells:
        try:
            known[name] = cell.cell_contents
        except ValueError:  # not assigned yet
            continue
    names = [*_names(code)]
    objects = [known[x] for x in names if x in known]
    owners = [x for x in objects if not callable(x) or isinstance(x, type)]
    owners += [function.__self__] if isinstance(function, MethodType) else []
    attributes = (_attribute(owner, x) for owner in owners for x in names)
    seen: set[int] = set()
    for one in (*objects, *attributes):
        is_python = isinstance(one, FunctionType | MethodType | partial)
        if is_python and _identity(one) not in seen:
            seen.add(_identity(one))
            yield one


def _attribute(owner: Any, name: str) -> Any:
    """Return an attribute of a module, a class or an object, None without one.

    Methods are bound; no property is read.
    """
    found = getattr_static(owner, name, None)
    if isinstance(found, staticmethod):
        return found.__func__
    is_object = not isinstance(owner, type | ModuleType)
    return MethodType(found, owner) if is_object and isinstance(found, FunctionType) else found


def _names(code: CodeType) -> Iterator[str]:
    """Yield the names that a code object loads, with those of functions defined in it."""
    yield from code.co_names
    yield from code.co_freevars
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
