"""The tests of a suite by the claims that they name, read from its sources."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

from eomcheck.claims import CLAIMS
from eomcheck.errors import InputError
from eomcheck.lab.report.judged import LEVELS

PROVED = LEVELS[0]


def named_tests(suite: Path) -> dict[str, tuple[str, ...]]:
    """Return the tests of each claim: those that name it, or have it for a parameter.

    Those that prove are under "proved".

    Raises:
        InputError: there is no such folder, or no test in it.
    """
    files = sorted(suite.glob("test_*.py"))
    if not files:
        raise InputError(f"{str(suite)!r} holds no validation suite")
    found: dict[str, tuple[str, ...]] = {}
    for file in files:
        for test in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(test, ast.FunctionDef) and test.name.startswith("test_"):
                chosen = {x for one in test.decorator_list for x in _constants(one)}
                for key in sorted(_claims_in(test)):
                    name = f"{test.name}[{key}]" if key in chosen else test.name
                    found[key] = (*found.get(key, ()), f"{suite.name}/{file.name}::{name}")
    return found


def _constants(tree: ast.AST) -> set[Any]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}


def _claims_in(test: ast.FunctionDef) -> set[str]:
    calls = {
        node.func.attr
        for node in ast.walk(test)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    }
    return (CLAIMS.keys() & _constants(test)) | ({PROVED} if "prove" in calls else set())
