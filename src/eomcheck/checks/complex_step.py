"""Exact derivatives of real functions by a complex step: nothing is subtracted."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.evaluate import Evaluation
from eomcheck.model import Angles, Array

TINY = 1e-150
"""The step: its square vanishes beside 1, so there is no truncation."""


def moving(e: Evaluation, qdot: Array | None, vdot: Array | None) -> tuple[Any, Array, Array]:
    """Return (prepared, q, v), complex, while q changes at `qdot` and v at `vdot`; None is 0."""
    value, cos, sin = e.prepared
    v = e.v + 0j if vdot is None else e.v + 1j * TINY * vdot
    if qdot is None:
        return e.prepared, e.q + 0j, v
    step = 1j * TINY * qdot[e.scene.angle_coordinates]
    turned = Angles(value + step, cos - step * sin, sin + step * cos)
    return turned, e.q + 1j * TINY * qdot, v


def rate(x: Any) -> Array:
    """Return the derivative in x."""
    return np.imag(x) / TINY
