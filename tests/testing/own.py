"""Somebody's own equations: the files of the guide, and what can be wrong with them."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from eomcheck.testing.equations_of_motion import INPUTS

GUIDES = Path(__file__).parents[2] / "docs" / "guides"


@cache
def guide(name: str) -> ModuleType:
    """Return the file of the guide as a module."""
    spec = importlib.util.spec_from_file_location(name, GUIDES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def given(name: str) -> dict[str, Any]:
    """Return the functions of a file of the guide, by name."""
    module = guide(name)
    found = {key: getattr(module, key) for key in INPUTS if callable(getattr(module, key, None))}
    return found | {"n": {"cart": 3, "drive": 7}[name]}


def coriolis(q, v):
    """C of the cart, made of Christoffel's symbols."""
    own = guide("cart")
    both = own.m1 + own.m2
    across = own.m2 * own.l1 * own.l2 * np.sin(q[1] - q[2])
    return np.array(
        [
            [0, -both * own.l1 * np.sin(q[1]) * v[1], -own.m2 * own.l2 * np.sin(q[2]) * v[2]],
            [0, 0, across * v[2]],
            [0, -across * v[1], 0],
        ]
    )
