"""The state in which a mechanism starts: its pose, closed, as slow as its constraints allow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.numbers.generic import FLOAT64, Array
from eomcheck.numbers.linear import least_squares

if TYPE_CHECKING:
    from eomcheck.mechanics.described.mechanism import Mechanism

STEPS = 30
"""Of Newton's method, which takes ten or does not arrive."""


def numbers_of(scene: Mechanism) -> Any:
    """Return the parameters of a scene as the equations read them, in doubles."""
    return scene.parameters(FLOAT64)


def started(scene: Mechanism) -> tuple[Array, Array]:
    """Return the pose (n,) closed by Newton's method, and the least v (n,) with a v + b = 0.

    A pose that does not close nearby is returned as it is.
    """
    pose = np.array(scene.made.pose, np.float64)
    if not scene.r:
        return pose, np.zeros(scene.n)
    given, q = numbers_of(scene), pose
    for _ in range(STEPS):
        a, _, residual = _held(scene, given, q)
        if residual is None:
            break
        step = least_squares(a[scene.holonomic], residual)
        q = q - step
        if not np.isfinite(q).all() or np.abs(q - pose).max() > 10.0:
            q = pose
            break
        if np.abs(step).max() <= 4 * np.finfo(np.float64).eps * max(1.0, np.abs(q).max()):
            break
    a, b, _ = _held(scene, given, q)
    return q, np.zeros(scene.n) if b is None else least_squares(a, -b)


def _held(scene: Mechanism, given: Any, q: Array) -> tuple[Array, Array | None, Array | None]:
    """Return a, b and how far positions are from closed, None where none is held."""
    prepared = scene.prepare(FLOAT64, given, q, 0.0)
    a, b = scene.constraints(given, prepared, q)
    held = scene.position_residual
    return a, b, None if held is None else held(given, prepared, q)
