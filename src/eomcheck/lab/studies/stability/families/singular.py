"""Where single scenes come to their limits: what rolls lies flat, rods in one line, stiff springs.

Each is approached step by step, and reached.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eomcheck import scenes
from eomcheck.lab.studies.stability.families.base import Family, Posed, decades
from eomcheck.lab.studies.stability.families.every import ordinary
from eomcheck.mechanics.scene import Scene
from eomcheck.scenes import bicycle

LEAN = 3
"""The Euler angle of disk and ball at whose right angle the others are one."""


def _flat(kind: type[Scene], variant: str, distance: float) -> Posed:
    scene = kind.example()
    q, u = ordinary(scene)
    q[LEAN] = (1.0 if variant == "+π/2" else -1.0) * (math.pi / 2 - distance)
    return Posed(scene, q, u)


def _flat_family(kind: type[Scene]) -> Family:
    return Family(
        key=f"{kind.key}-flat",
        name="Lean",
        severity="distance of the lean from ±π/2 / rad",
        values=decades(-1, -16),
        quick=(1e-1, 1e-8, 1e-16),
        variants=("+π/2", "-π/2"),
        pose=partial(_flat, kind),
        scene=kind,
    )


def _in_line(variant: str, angle: float) -> Posed:
    scene = replace(scenes.FourBarChain.rods(3), angle=angle)
    q, _ = scene.initial_state()
    return Posed(scene, q, np.ones(scene.p))


def _knife_edge(variant: str, offset: float) -> Posed:
    scene = scenes.Sleigh(offset=offset)
    return Posed(scene, *ordinary(scene))


def _pendulum(variant: str, links: float) -> Posed:
    (scene, *_) = scenes.ChainPendulum.structures(int(links))
    return Posed(scene, *ordinary(scene))


def _stretched(variant: str, distance: float) -> Posed:
    scene = scenes.Bricard()
    q, _ = scene.closed(-math.pi / 6 + distance, 0.0)
    return Posed(scene, q, np.ones(1))


def _lying(variant: str, lean: float) -> Posed:
    scene = scenes.Bicycle()
    q, _ = scene.initial_state()
    # It tilts about the line on the ground between the wheels.
    q[bicycle.LEAN], q[bicycle.HEIGHT] = lean, scene.radius[0] * math.sin(lean)
    return Posed(scene, q, 1.0 / np.arange(1, scene.p + 1))


def _stiff(kind: type[Scene], variant: str, stiffness: float) -> Posed:
    scene: Any = kind.example()
    scene = replace(scene, stiffness=stiffness)
    return Posed(scene, *ordinary(scene))


def _stiff_family(kind: type[Scene]) -> Family:
    return Family(
        key=f"{kind.key}-stiffness",
        name="Stiffness",
        severity="stiffness of the springs / (N/m)",
        values=(0.0, *decades(0, 16)),
        quick=(0.0, 1e8, 1e16),
        pose=partial(_stiff, kind),
        scene=kind,
    )


OF_SINGLE_SCENES = (
    Family(
        key="chain-pendulum-links",
        name="Long chain",
        severity="number of links N",
        values=(1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0),
        quick=(1.0, 5.0, 20.0),
        pose=_pendulum,
        scene=scenes.ChainPendulum,
    ),
    Family(
        key="sleigh-offset",
        name="Offset",
        severity="distance of the edge from the centre of mass / m",
        values=(*decades(0, -16), 0.0),
        quick=(1.0, 1e-8, 0.0),
        pose=_knife_edge,
        scene=scenes.Sleigh,
    ),
    _flat_family(scenes.RollingDisk),
    _flat_family(scenes.TurntableBall),
    Family(
        key="four-bar-chain-in-line",
        name="All in line",
        severity="angle between rods and couplers / rad",
        values=(*decades(0, -16), 0.0),
        quick=(1.0, 1e-8, 0.0),
        pose=_in_line,
        scene=scenes.FourBarChain,
    ),
    _stiff_family(scenes.Andrews),
    _stiff_family(scenes.FlyballGovernor),
    Family(
        key="bricard-stretched",
        name="Stretched",
        severity="distance of the first angle from -π/6 / rad",
        values=decades(0, -15),
        quick=(1.0, 1e-8, 1e-15),
        pose=_stretched,
        scene=scenes.Bricard,
    ),
    Family(
        key="bicycle-lying",
        name="Lying",
        severity="angle between frame and ground / rad",
        values=(*decades(0, -16), 0.0),
        quick=(1.0, 1e-8, 0.0),
        pose=_lying,
        scene=scenes.Bicycle,
    ),
)
