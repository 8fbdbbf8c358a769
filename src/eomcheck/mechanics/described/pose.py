"""First derivation, where everything is: frames along the axes of the ground, from slot to slot."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from eomcheck.mechanics.described.absent import (
    AXES,
    NOTHING,
    Vector,
    added,
    levelled,
    plus,
    scaled,
    subtracted,
    times,
    vector,
)
from eomcheck.mechanics.described.topology import Plan, Slot
from eomcheck.numbers.generic import generic


class Prepared(NamedTuple):
    """What is not rational in q and t, and the coordinates of the joints."""

    x: Any
    """Coordinate of each slot (n_j,), m or rad."""
    angles: Any
    """Those of the hinges, or None without any."""
    driven: Any
    """Position, rate and acceleration of what a clock drives (3, drives), or None."""
    lengths: Any = None
    """Lengths of the springs between points, or None without any, m."""
    sines: Any = None
    """Of the angles between axes of disks and normals of planes, or None without any."""


class Frame(NamedTuple):
    """A frame that a slot moves, seen from the ground."""

    axes: tuple[Vector, Vector, Vector]
    origin: Vector
    arm: Vector
    """From the origin of the frame before."""
    axis: Vector
    """Direction in which, or about which, its coordinate moves it."""


GROUND = Frame(AXES, NOTHING, NOTHING, NOTHING)


def factor(slot: Slot, parameters: Any) -> Any:
    """Return ∂x/∂q of a slot: a number, or 1 or -1."""
    if slot.follows is None:
        return slot.sense
    return times(slot.sense, parameters.ratio[slot.follows])


def prepare_of(plan: Plan) -> Any:
    """Return the function of a scene that prepares the `Prepared` at q (n,) and the time t."""

    def prepare(arithmetic, parameters, q, t):
        x = np.zeros(len(plan.slots), q.dtype)
        for k, slot in enumerate(plan.slots):
            own = q[slot.coordinate]
            if slot.follows is not None:
                own = parameters.ratio[slot.follows] * own + parameters.shift[slot.follows]
            x[k] = times(slot.sense, own)
        angles = arithmetic.angles(x[list(plan.hinges)]) if plan.hinges else None
        return Prepared(x, angles, driven(parameters, q, t))

    return prepare


def driven(parameters: Any, q: Any, t: Any) -> Any:
    """Return position, rate and acceleration (3, drives) of p + r t + a t²/2, or None."""
    drives = getattr(parameters, "drives", None)
    if drives is None:
        return None
    found = np.zeros((3, len(drives)), q.dtype)
    for i, (p, r, a) in enumerate(drives):
        found[0, i], found[1, i], found[2, i] = p + t * (r + t * a / 2), r + t * a, a
    return found


@generic
def placed(plan, parameters, prepared):
    """Return the `Frame` of each slot."""
    frames = []
    for k, slot in enumerate(plan.slots):
        before = frames[slot.parent] if slot.parent >= 0 else GROUND
        frames.append(placed_on(before, plan, k, parameters, prepared))
    return frames


def placed_on(before: Frame, plan: Plan, k: int, parameters: Any, prepared: Prepared) -> Frame:
    """Return the frame of slot k, which sits on the frame `before`."""
    slot, axes, arm = plan.slots[k], before.axes, NOTHING
    if slot.offset is not None:
        arm = levelled(axes, vector(parameters.offset[slot.offset]))
    if slot.absolute:
        axes = AXES
    if slot.turn is not None:
        R = parameters.rotation[slot.turn]
        first, second, third = (levelled(axes, vector(R[:, i])) for i in range(3))
        axes = first, second, third
    axis = scaled(factor(slot, parameters), axes[slot.axis])
    if slot.slides:
        arm = added(arm, scaled(prepared.x[k], axes[slot.axis]))
    elif not slot.symmetric:
        at = plan.hinge[k]
        axes = hinged(axes, slot.axis, prepared.angles.cos[at], prepared.angles.sin[at])
    return Frame(axes, added(before.origin, arm), arm, axis)


@generic
def hinged(axes, axis, cos, sin):
    """Return axes turned about their `axis`-th."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found = [axes[axis]] * 3
    found[i] = added(scaled(cos, axes[i]), scaled(sin, axes[j]))
    found[j] = subtracted(scaled(cos, axes[j]), scaled(sin, axes[i]))
    return tuple(found)


def point_of(frames: list[Frame], k: int, a: Vector) -> tuple[Vector, Vector]:
    """Return a point a of frame k, -1 for the ground, as arm from its origin and as place."""
    frame = frames[k] if k >= 0 else GROUND
    arm = levelled(frame.axes, a)
    return arm, added(frame.origin, arm)


def height(parameters: Any, at: Vector) -> Any:
    """Return -g · place, m²/s²; absent where nothing weighs."""
    found = None
    for g, x in zip(parameters.gravity, at, strict=False):
        found = plus(found, None if x is None else -(g * x))
    return found
