"""Symmetries of a scene on a plane without directions: rotation, translation, mirror image.

The first two coordinates are a position (x, y) on the plane, m.
"""

from __future__ import annotations

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.mechanics.records import Symmetry
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.pivots import EPS

TURN = 0.75
"""Angle of the rotation, rad."""
SHIFT = 3.0, -2.0
"""Components of the translation, m."""


def rotation(scene: Scene, q: Array, v: Array, headings: slice) -> Symmetry:
    """Return the rotation of the scene about the origin; the angles `headings` turn with it."""
    image = np.eye(scene.n)
    image[:2, :2] = [[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]]
    turned = image @ q
    turned[headings] += TURN
    return Symmetry("rotation", scene, turned, image @ v, image)


def translation(scene: Scene, q: Array, v: Array) -> Symmetry:
    """Return the translation of the scene by `SHIFT`."""
    moved = q.copy()
    moved[:2] += SHIFT
    return Symmetry("translation", scene, moved, v, np.eye(scene.n))


def mirror(scene: Scene, q: Array, v: Array, unflipped: tuple[int, ...]) -> Symmetry:
    """Return the mirror image in the x axis: `scene` is mirrored, all coordinates but `unflipped`
    change their sign.
    """
    signs = -np.ones(scene.n)
    signs[list(unflipped)] = 1.0
    return Symmetry("mirror", scene, signs * q, signs * v, np.diag(signs))


def full_turns(scene: Scene, q: Array, v: Array) -> Symmetry:
    """Return a rotation by 2π of every coordinate, which changes nothing."""
    return Symmetry("full turns", scene, q + 2.0 * np.pi, v, np.eye(scene.n))


def refuse_flat(lean: float) -> None:
    """Refuse |cos θ| <= 4 eps, where Euler's angles (heading, lean θ, spin) are singular.

    Raises:
        RefusedError: names the lean, rad.
    """
    cosine = abs(float(np.cos(lean)))
    if cosine <= 4 * EPS:
        detail = f"θ = {float(lean)!r}: Euler's angles are singular, the axis of spin is upright"
        raise RefusedError("cos θ", cosine, 4 * EPS, detail)
