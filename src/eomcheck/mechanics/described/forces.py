"""First derivation, what pulls: gravity, springs and dampers at joints."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.mechanics.described.absent import (
    NOTHING,
    added,
    cross,
    dot,
    scaled,
    times,
    vector,
)
from eomcheck.mechanics.described.motion import centers
from eomcheck.mechanics.described.pose import factor, placed
from eomcheck.mechanics.described.springs import pull
from eomcheck.mechanics.described.topology import Plan


def forces_of(plan: Plan) -> Any:
    """Return the function `forces` of a scene."""
    sprung = bool(plan.topology.springs) or any(
        slot.spring is not None or slot.torque is not None for slot in plan.slots
    )

    def forces(parameters, prepared, q, v):
        damping = getattr(parameters, "damping", None)
        if parameters.gravity is None and damping is None and not sprung:
            return None
        Q = np.zeros(plan.n, v.dtype)
        if parameters.gravity is not None:
            weigh(plan, parameters, prepared, Q)
        for k, slot in enumerate(plan.slots):
            i, grows = slot.coordinate, factor(slot, parameters)
            if slot.spring is not None:
                # Along its axis; where that is negative it is -1 times the joint's coordinate.
                rest = times(slot.sense, parameters.relaxed[slot.spring])
                stretch = prepared.x[k] - rest
                Q[i] -= times(grows, parameters.stiffness[slot.spring] * stretch)
            if slot.damper is not None and damping is not None:
                rate = times(grows, v[i])
                Q[i] -= times(grows, damping[slot.damper] * rate)
            if slot.torque is not None:
                Q[i] += times(grows, times(slot.sense, parameters.torque[slot.torque]))
        pull(plan, parameters, prepared, q, v, Q)
        return Q

    return forces


def weigh(plan: Plan, parameters: Any, prepared: Any, Q: Any) -> None:
    """Add what gravity does to Q (n,), its forces and moments passed on from tips to ground."""
    frames, g = placed(plan, parameters, prepared), vector(parameters.gravity)
    force, moment = [NOTHING] * len(frames), [NOTHING] * len(frames)
    for b, (arm, _) in enumerate(centers(plan, parameters, frames)):
        k = plan.carriers[b]
        force[k] = scaled(parameters.mass[b], g)
        moment[k] = cross(arm, force[k])
    for k in reversed(range(len(frames))):
        slot, frame = plan.slots[k], frames[k]
        work = dot(frame.axis, force[k] if slot.slides else moment[k])
        if work is not None:
            Q[slot.coordinate] += work
        if slot.parent >= 0:
            passed = NOTHING if slot.absolute else moment[k]
            passed = added(passed, cross(frame.arm, force[k]))
            moment[slot.parent] = added(moment[slot.parent], passed)
            force[slot.parent] = added(force[slot.parent], force[k])
