"""Exact derivatives of real functions by a complex step: nothing is subtracted."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.evaluate import Evaluation
from eomcheck.model import Angles, Array
from eomcheck.tolerance import largest

TINY = 1e-30
"""The step, in rad or m: its square vanishes beside 1, so there is no truncation, and it leaves
room above underflow."""


def step(e: Evaluation) -> float:
    """Return the step of time, s, of at most 1e-30, in which nothing moves further than that."""
    return TINY / max(largest(e.v), 1.0)


def moving(e: Evaluation, qdot: Array | None, vdot: Array | None) -> tuple[Any, Array, Array]:
    """Return (prepared, q, v), complex, while q changes at `qdot` and v at `vdot`; None is 0."""
    value, cos, sin = e.prepared
    v = e.v + 0j if vdot is None else e.v + 1j * step(e) * vdot
    if qdot is None:
        return e.prepared, e.q + 0j, v
    move = 1j * step(e) * qdot
    turn = move[e.scene.angle_coordinates]
    turned = Angles(value + turn, cos - turn * sin, sin + turn * cos)
    return turned, e.q + move, v


def rate(e: Evaluation, x: Any) -> Array:
    """Return the derivative in x, which came of what `moving` returned."""
    return np.imag(x) / step(e)
