"""First derivation, what pulls: gravity along the columns of the bodies, springs and dampers."""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.mechanics.described.absent import dot, times, vector
from eomcheck.mechanics.described.motion import centers, columns
from eomcheck.mechanics.described.pose import factor, placed
from eomcheck.mechanics.described.topology import Plan


def forces_of(plan: Plan) -> Any:
    """Return the function `forces` of a scene."""
    sprung = any(slot.spring is not None for slot in plan.slots)

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
                stretch = prepared.x[k] - parameters.relaxed[slot.spring]
                Q[i] -= times(grows, parameters.stiffness[slot.spring] * stretch)
            if slot.damper is not None and damping is not None:
                rate = times(grows, v[i])
                Q[i] -= times(grows, damping[slot.damper] * rate)
        return Q

    return forces


def weigh(plan: Plan, parameters: Any, prepared: Any, Q: Any) -> None:
    """Add what gravity does to Q (n,)."""
    frames, g = placed(plan, parameters, prepared), vector(parameters.gravity)
    for b, (_, at) in enumerate(centers(plan, parameters, frames)):
        for i, moved in columns(plan, frames, plan.carriers[b], at).items():
            work = dot(g, moved)
            if work is not None:
                Q[i] += parameters.mass[b] * work
