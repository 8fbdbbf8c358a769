"""What a picture of a mechanism shows: links from joint to joint, axes, centres of mass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eomcheck.mechanics.described.absent import vector
from eomcheck.mechanics.described.closures import rows_of
from eomcheck.mechanics.described.pose import placed, point_of
from eomcheck.mechanics.described.start import numbers_of
from eomcheck.mechanics.sketch import (
    Arrow,
    Body,
    Center,
    Constraint,
    Joint,
    Part,
    Sketch,
    Trail,
    fixed_axes,
)
from eomcheck.numbers.generic import FLOAT64, Array

if TYPE_CHECKING:
    from eomcheck.mechanics.described.mechanism import Mechanism

NEAR = 1e-9
"""Points are one that are nearer than this share of the whole."""


def _place(a: Any, d: int) -> Array:
    return np.array([0.0 if x is None else float(x) for x in a[:d]])


def sketched(scene: Mechanism, q: Array, t: float = 0.0) -> Sketch:
    """Return the mechanism in the pose q (n,)."""
    plan, given = scene.plan, numbers_of(scene)
    prepared = scene.prepare(FLOAT64, given, np.asarray(q, np.float64), t)
    frames, d = placed(plan, given, prepared), plan.d
    at = [_place(frame.origin, d) for frame in frames]
    centers = {
        k: _place(point_of(frames, k, vector(given.center[b]))[1], d)
        for b, k in enumerate(plan.carriers)
    }
    everything = np.array([np.zeros(d), *at, *centers.values()])
    size = float(np.ptp(everything, axis=0).max()) or 1.0
    parts: list[Part] = [*fixed_axes(0.15 * size, d)]
    for k, slot in enumerate(plan.slots):
        # From joint to joint, which is a line of the body before, or of the ground.
        start = at[slot.parent] if slot.parent >= 0 else np.zeros(d)
        if slot.parent >= 0 and np.abs(at[k] - start).max() > NEAR * size:
            parts.append(Body((start, at[k])))
        axis, name = _place(frames[k].axis, d), slot.name.replace("_", " ")
        if slot.slides:
            along = 0.12 * size * axis / (np.linalg.norm(axis) or 1.0)
            parts.append(Arrow(name, at[k], along, frame=False))
        else:
            parts.append(Joint(at[k], slot.parent < 0, name, None if d == 2 else axis))
        if k in centers:
            parts.append(Center(centers[k]))
            if all(other.parent != k for other in plan.slots):
                parts += [Body((at[k], centers[k])), Trail(centers[k])]
    row = 0
    for closure in plan.topology.closures:
        rows = tuple(range(row, row := row + rows_of(closure, plan.topology.planar)))
        if closure.points:
            k, i = closure.points[0]
            held = point_of(frames, k, vector(given.points[i]))[1]
            parts.append(Constraint(closure.name, _place(held, d), rows))
            if k >= 0:
                parts.append(Body((at[k], _place(held, d))))
    if given.gravity is not None and np.any(given.gravity):
        along = 0.2 * size * given.gravity / np.linalg.norm(given.gravity)
        parts.append(Arrow("g", np.zeros(d) - 0.2 * size * np.eye(d)[0], along, frame=False))
    return Sketch(tuple(parts), up=2 if d == 3 else 1)
