"""How points of a sketch are seen, and lines on the page."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics import sketch as s


class Stroke(NamedTuple):
    """A line on the page, in m as seen."""

    points: np.ndarray
    color: str
    width: float
    style: Any = "-"
    fill: str = ""
    head: bool = False
    """Whether it ends in an arrow's head."""


class View:
    """How points of a sketch are seen: in the plane as they are, in space without perspective."""

    def __init__(self, sketch: s.Sketch):
        up = np.eye(3)[sketch.up]
        east, north = (np.eye(3)[(sketch.up + k) % 3] for k in (1, 2))
        ahead = np.cos(sketch.azimuth) * east + np.sin(sketch.azimuth) * north
        towards = np.cos(sketch.elevation) * ahead + np.sin(sketch.elevation) * up
        right = np.cross(up, ahead)
        self.axes = np.array([right, np.cross(towards, right)])

    def __call__(self, points: Any) -> np.ndarray:
        """Return points (k, d), or one (d,), as seen (k, 2)."""
        array = np.atleast_2d(np.asarray(points, dtype=float))
        return array if array.shape[1] == 2 else array @ self.axes.T
