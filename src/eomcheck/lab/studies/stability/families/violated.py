"""Velocities that slide the wheels sideways a little, looked at with `consistent=False`.

The formulations then answer different questions: those in Lagrange's terms take v as it is, those
in generalized speeds its u and nothing else. Each is compared with its own exact answer to these
very doubles.
"""

from __future__ import annotations

import numpy as np

from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import velocity
from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import Snake

SCENES = {
    "coil": Snake.coil(7),
    "pattern": Snake.pattern(20),
    "free": Snake(np.ones(3), np.ones(3), np.ones(3) / 12, None, [0.1, 0.2, 0.3], [0.0, 0.4, 1.0]),
}


def violating(scene: Scene, q, u, violation: float) -> Posed:
    """Return the state of (q, u) with every constraint violated by a share of the largest speed."""
    v = velocity(scene, q, u)
    a = Evaluation(scene, q, v).terms.a
    away = np.linalg.lstsq(a, np.ones(scene.r), rcond=None)[0]
    return Posed(scene, q, None, v + violation * np.abs(v).max() * away)


def _pose(variant: str, violation: float) -> Posed:
    scene = SCENES[variant]
    return violating(scene, scene.initial_state()[0], [1.0, 0.5], violation)


VIOLATED = Family(
    key="violated",
    name="Violated constraints",
    severity="sliding of every wheel over the largest speed",
    values=decades(-16, 0),
    quick=decades(-16, 0, 4),
    variants=tuple(SCENES),
    pose=_pose,
)
