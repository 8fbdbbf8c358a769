"""Families of increasingly severe states: their type, those of every scene, those of single scenes.

A `Family` is data: a severity with its values, and a function from a severity to a state. Every
scene but the snake goes through mass, speed, turns and violated constraints; the snake has families
of its own (`snake_families`), of which these are the outlines. Single scenes also have their
singular configurations (a disk or ball lying flat, rods in one line, a stretched linkage), stiff
springs and long chains: each limit is approached step by step, and reached if float64 can represent
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from eomcheck import scenes
from eomcheck.evaluation.dynamics import assembled_position, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.scenes import Snake, bicycle


class Posed(NamedTuple):
    """State of a family, with either u or v."""

    scene: Scene
    q: Array
    """Coordinates (n,)."""
    u: Array | None
    """Generalized speeds (p,); all formulations then share one certified value."""
    v: Array | None = None
    """Velocities (n,), possibly inconsistent; each formulation then has its own certified value."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Family of states whose severity is one number.

    Attributes:
        key: short name, used everywhere.
        name: subject, for headings.
        severity: the number that grows severe, with its symbol and unit, for an axis.
        values: severities, from mild to severe; all but 0 are drawn on a logarithmic axis.
        quick: severities of a quick run, a subset of `values`.
        variants: names of the variants in which each severity is measured.
        pose: (variant, severity) -> the state.
        scene: scene class of its states.
        about: key of the scene class that it is shown under, by default that of `scene`.
    """

    key: str
    name: str
    severity: str
    values: tuple[float, ...]
    quick: tuple[float, ...]
    variants: tuple[str, ...] = ("moving",)
    pose: Callable[[str, float], Posed]
    scene: type[Scene] = Snake
    about: str = ""

    def __post_init__(self):
        object.__setattr__(self, "about", self.about or self.scene.key)

    @property
    def title(self) -> str:
        """The name, after the scene if that is not the snake."""
        return self.name if self.about == Snake.key else f"{self.about}: {self.name.lower()}"


def decades(first: int, last: int, step: int = 1) -> tuple[float, ...]:
    """Return 10^first, ..., 10^last, falling where last < first."""
    sign = 1 if last >= first else -1
    return tuple(float(f"1e{k}") for k in range(first, last + sign, sign * step))


def violating(scene: Scene, q: Array, u: Array, violation: float) -> Posed:
    """Return the state of (q, u) with every constraint violated by a share of the largest speed.

    Formulations then solve different problems: those in Lagrange's terms take v as it is, those in
    generalized speeds only its u. Each is compared with its own exact solution.
    """
    v = velocity(scene, q, u)
    a = Evaluation(scene, q, v).terms.a
    away = np.linalg.lstsq(a, np.ones(scene.r), rcond=None)[0]
    return Posed(scene, q, None, v + violation * np.abs(v).max() * away)


# ---- Families of every scene but the snake -------------------------------------------------------

SEED = 1
ANYWHERE = (-1.0, 1.0)
"""Sampling range of coordinates without one of their own, m or rad."""


def ordinary(scene: Scene) -> tuple[Array, Array]:
    """Return (q (n,), u (p,)) of an ordinary state: loops closed, every generalized speed
    nonzero.
    """
    random = np.random.default_rng(SEED)
    ranges = scene.coordinate_ranges()
    bounds = [ANYWHERE] * scene.n if ranges is None else [(one.low, one.high) for one in ranges]
    drawn = np.array([random.uniform(low, high) for low, high in bounds])
    return assembled_position(scene, drawn), 1.0 / np.arange(1, scene.p + 1)


def _mass(kind: type[Scene], variant: str, ratio: float) -> Posed:
    scene: Any = kind.example()
    name = next(name for name in ("mass", "arm") if hasattr(scene, name))
    factor = ratio if variant == "heavier" else 1.0 / ratio
    mass = np.array(getattr(scene, name))
    mass.flat[0] *= factor
    scene = replace(scene, **{name: mass})
    return Posed(scene, *ordinary(scene))


def _speed(kind: type[Scene], variant: str, factor: float) -> Posed:
    scene = kind.example()
    q, u = ordinary(scene)
    return Posed(scene, q, u * (factor if variant == "fast" else 1.0 / factor))


def _turns(kind: type[Scene], variant: str, turns: float) -> Posed:
    scene = kind.example()
    q, u = ordinary(scene)
    q[kind.angle_coordinates] += 2 * np.pi * turns
    return Posed(scene, q, u)


def _violated(kind: type[Scene], variant: str, violation: float) -> Posed:
    scene = kind.example()
    return violating(scene, *ordinary(scene), violation)


def families_of_kind(kind: type[Scene]) -> Iterator[Family]:
    """Yield the families of a scene class."""
    yield Family(
        key=f"{kind.key}-mass",
        name="Mass",
        severity="first mass over its default, or its inverse",
        values=decades(0, 16),
        quick=decades(0, 16, 8),
        variants=("heavier", "lighter"),
        pose=partial(_mass, kind),
        scene=kind,
    )
    yield Family(
        key=f"{kind.key}-speed",
        name="Fast and slow",
        severity="speed over 1 m/s and 1 rad/s, or its inverse",
        values=decades(0, 170, 10),
        quick=(1.0, 1e100, 1e170),
        variants=("fast", "slow"),
        pose=partial(_speed, kind),
        scene=kind,
    )
    yield Family(
        key=f"{kind.key}-turns",
        name="Many turns",
        severity="turns of each angle",
        values=decades(0, 15),
        quick=(1.0, 1e8),
        variants=("all alike",),
        pose=partial(_turns, kind),
        scene=kind,
    )
    if kind.example().r:
        yield Family(
            key=f"{kind.key}-violated",
            name="Violated constraints",
            severity="rate of every constraint over the largest speed",
            values=decades(-16, 0),
            quick=decades(-16, 0, 8),
            variants=("all alike",),
            pose=partial(_violated, kind),
            scene=kind,
        )


# ---- Families of single scenes -------------------------------------------------------------------

LEAN = 3
"""Index of the Euler angle of disk and ball that is singular at a right angle: the other two
coincide.
"""


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
    # The bicycle tilts about the line on the ground between the wheels.
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
