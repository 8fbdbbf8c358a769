"""Checks for your own equations and your own test suite, of what is not written as a scene."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eomcheck.strategies import settings
    from eomcheck.testing.reference import from_engine, from_scene
    from eomcheck.testing.registry import FUNCTION_CLAIMS
    from eomcheck.testing.run import check, check_functions
    from eomcheck.testing.subject import Functions
    from eomcheck.testing.suite import parametrize_with_claims
    from eomcheck.testing.sympy import from_kane, from_lagrange

_HOME = {
    "FUNCTION_CLAIMS": "testing.run",
    "Functions": "testing.subject",
    "check": "testing.run",
    "check_functions": "testing.run",
    "from_engine": "testing.reference",
    "from_kane": "testing.sympy",
    "from_lagrange": "testing.sympy",
    "from_scene": "testing.reference",
    "parametrize_with_claims": "testing.suite",
    "settings": "strategies",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"eomcheck.{_HOME[name]}"), name)
    raise AttributeError(f"module 'eomcheck.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(_HOME)


__all__ = [
    "FUNCTION_CLAIMS",
    "Functions",
    "check",
    "check_functions",
    "from_engine",
    "from_kane",
    "from_lagrange",
    "from_scene",
    "parametrize_with_claims",
    "settings",
]
