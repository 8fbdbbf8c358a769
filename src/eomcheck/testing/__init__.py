"""Checks of user-supplied equations of motion, and pytest tests of engines, scenes and equations.

Equations are given as functions (`EquationsOfMotion`); they need not be written as a scene.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from eomcheck import deprecated

if TYPE_CHECKING:
    from eomcheck.claims.registry import FUNCTION_CLAIMS
    from eomcheck.strategies import settings
    from eomcheck.testing.converters import from_engine, from_kane, from_lagrange, from_scene
    from eomcheck.testing.equations_of_motion import EquationsOfMotion
    from eomcheck.testing.function_checks import check, check_functions
    from eomcheck.testing.suite import parametrize_with_claims


_HOME = {
    "FUNCTION_CLAIMS": "testing.function_checks",
    "EquationsOfMotion": "testing.equations_of_motion",
    "check": "testing.function_checks",
    "check_functions": "testing.function_checks",
    "from_engine": "testing.converters",
    "from_kane": "testing.converters",
    "from_lagrange": "testing.converters",
    "from_scene": "testing.converters",
    "parametrize_with_claims": "testing.suite",
    "settings": "strategies",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"eomcheck.{_HOME[name]}"), name)
    return deprecated.renamed("eomcheck.testing", name)


def __dir__() -> list[str]:
    return sorted(_HOME)


__all__ = [
    "FUNCTION_CLAIMS",
    "EquationsOfMotion",
    "check",
    "check_functions",
    "from_engine",
    "from_kane",
    "from_lagrange",
    "from_scene",
    "parametrize_with_claims",
    "settings",
]
