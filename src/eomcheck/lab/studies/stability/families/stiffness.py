"""Springs from none to rigid: they enter the forces only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.scenes import Snake

LINKS = 7


def _pose(variant: str, stiffness: float) -> Posed:
    scene = replace(Snake.coil(LINKS), stiffness=np.full(LINKS - 1, stiffness))
    q, _ = scene.initial_state()
    if variant == "nearly relaxed":
        # Neighbours differ by 1e-6 rad, these differences by 1e-9: torques nearly cancel.
        links = np.arange(LINKS)
        q[2:] = 0.3 + 1e-6 * links + 0.5e-9 * links**2
    return Posed(scene, q, np.zeros(2) if variant == "at rest" else np.array([1.0, 0.5]))


STIFFNESS = Family(
    key="stiffness",
    name="Stiff joints",
    severity="joint stiffness k / (N m/rad)",
    values=(0.0, *decades(0, 12)),
    quick=(0.0, 1.0, 1e4, 1e8, 1e12),
    variants=("at rest", "moving", "nearly relaxed"),
    pose=_pose,
)
