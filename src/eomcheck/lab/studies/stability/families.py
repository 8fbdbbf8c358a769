"""Families of increasingly severe states: of the snake, of every other scene, of single scenes.

A `Family` is data: a severity with its values, and a function from a severity to a state. Every
scene but the snake goes through mass, speed, turns and violated constraints. Single scenes also
have their singular configurations (a disk or ball lying flat, rods in one line, a stretched
linkage), stiff springs and long chains: each limit is approached step by step, and reached if
float64 can represent it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from eomcheck import scenes
from eomcheck.evaluation.certified import enclose
from eomcheck.evaluation.dynamics import assembled_position, velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.lab.studies.stability.two_wheels import TwoWheels
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import midpoints
from eomcheck.numbers.generic import Array
from eomcheck.scenes import SCENES, Snake, bicycle


class Posed(NamedTuple):
    """State of a family, with either u or v."""

    scene: Scene
    q: Array
    """Coordinates (n,)."""
    u: Array | None
    """Generalized speeds (p,); all formulations then share one certified value."""
    v: Array | None = None
    """Velocities (n,), possibly inconsistent; each formulation then has its own certified value."""


Pose = Callable[[str, float], Posed]
"""Function (variant, severity) -> the state."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Family of states whose severity is one number.

    Attributes:
        key: short name, used everywhere.
        name: subject, for headings.
        severity: the number that grows severe, with its symbol and unit, for an axis.
        values: severities, from mild to severe; all but 0 are drawn on a logarithmic axis.
        pose: (variant, severity) -> the state.
        quick: severities of a quick run, a subset of `values`; by default the first, the ninth,
            which is eight decades on, and the last.
        variants: names of the variants in which each severity is measured.
        scene: scene class of its states.
        about: key of the scene class that it is shown under, by default that of `scene`.
    """

    key: str
    name: str
    severity: str
    values: tuple[float, ...]
    pose: Pose
    quick: tuple[float, ...] = ()
    variants: tuple[str, ...] = ("moving",)
    scene: type[Scene] = Snake
    about: str = ""

    def __post_init__(self):
        object.__setattr__(self, "about", self.about or self.scene.key)
        object.__setattr__(self, "quick", self.quick or (*self.values[:9:8], self.values[-1]))

    @property
    def title(self) -> str:
        """The name, after the scene if that is not the snake."""
        return self.name if self.about == Snake.key else f"{self.about}: {self.name.lower()}"


REGISTERED: list[Family] = []


def family(key: str, name: str, severity: str, **facts: Any) -> Callable[[Pose], Pose]:
    """Register the decorated pose as that of a `Family`."""

    def register(pose: Pose) -> Pose:
        REGISTERED.append(Family(key=key, name=name, severity=severity, pose=pose, **facts))
        return pose

    return register


def decades(first: int, last: int, step: int = 1) -> tuple[float, ...]:
    """Return 10^first, ..., 10^last, falling where last < first."""
    sign = 1 if last >= first else -1
    return tuple(float(f"1e{k}") for k in range(first, last + sign, sign * step))


TO_ZERO = (*decades(0, -16), 0.0)


def violating(scene: Scene, q: Array, u: Array, violation: float) -> Posed:
    """Return the state of (q, u) with every constraint violated by a share of the largest speed.

    Formulations then solve different problems: those in Lagrange's terms take v as it is, those in
    generalized speeds only its u. Each is compared with its own exact solution.
    """
    v = velocity(scene, q, u)
    a = Evaluation(scene, q, v).terms.a
    away = np.linalg.lstsq(a, np.ones(scene.r), rcond=None)[0]
    return Posed(scene, q, None, v + violation * np.abs(v).max() * away)


# ---- Snakes --------------------------------------------------------------------------------------

MOVING = np.array([1.0, 0.5])
"""u = (s_1, ω_1), m/s and rad/s."""


def _rods(alpha, theta, **others: Any) -> Snake:
    """Return a snake of rods of 1 m and 1 kg with joints of 10 N m/rad, except for `others`."""
    one = np.ones(len(theta))
    usual = {"mass": one, "length": one, "inertia": one / 12, "stiffness": 10.0 * one[1:]}
    return Snake(**usual | others, wheel_angle=alpha, pose=theta)


def bent(links: int, **others: Any) -> Snake:
    """Return a snake of rods, each turned by 0.4 rad against the one before, wheels by 0.1 rad."""
    k = np.arange(links)
    return _rods(0.1 * k, 0.4 * k, **others)


def _posed(scene: Scene, u=MOVING) -> Posed:
    return Posed(scene, scene.initial_state()[0], u)


# ---- Springs from none to rigid: they enter the forces only --------------------------------------


@family(
    "stiffness",
    "Stiff joints",
    "joint stiffness k / (N m/rad)",
    values=(0.0, *decades(0, 12)),
    quick=(0.0, 1.0, 1e4, 1e8, 1e12),
    variants=("at rest", "moving", "nearly relaxed"),
)
def _stiff_joints(variant: str, stiffness: float) -> Posed:
    links = 7
    scene = replace(Snake.coil(links), stiffness=np.full(links - 1, stiffness))
    q, _ = scene.initial_state()
    if variant == "nearly relaxed":
        # Neighbours differ by 1e-6 rad, these differences by 1e-9: torques nearly cancel.
        k = np.arange(links)
        q[2:] = 0.3 + 1e-6 * k + 0.5e-9 * k**2
    return Posed(scene, q, np.zeros(2) if variant == "at rest" else MOVING)


# ---- A wheel that comes to stand across its link, at each position in the chain ------------------

WHEELS = 5
ACROSS = 6.123233995736766e-17
"""Distance of π/2 from its nearest float64."""
NEXT = ACROSS + 2.0**-52
"""Distance of π/2 from the float64 before that."""


@family(
    "wheel-angle",
    "Wheel across its link",
    "distance of a wheel angle from ±π/2 / rad",
    values=(*decades(-1, -15), NEXT, ACROSS),
    quick=(1e-1, 1e-5, 1e-10, 1e-15, ACROSS),
    variants=tuple(f"{sign}π/2, wheel {k}" for k in range(1, WHEELS + 1) for sign in "+-"),
)
def _across(variant: str, distance: float) -> Posed:
    sign, wheel = variant[0], int(variant[-1])
    alpha = 0.1 * np.arange(1, WHEELS + 1)
    alpha[wheel - 1] = (1.0 if sign == "+" else -1.0) * (math.pi / 2 - distance)
    # These speeds turn the link of this wheel at 1 rad/s, and hardly move the others.
    return _posed(_rods(alpha, 0.4 * np.arange(WHEELS)), MOVING * max(distance, ACROSS))


# ---- All θ equal and α = 0: approached by bending it less and less, and exact --------------------


@family(
    "straight",
    "Straight snake",
    "bend between neighbours / rad",
    values=(*decades(-1, -16), 0.0),
    quick=(1e-1, 1e-4, 1e-8, 1e-12, 0.0),
    variants=("2 links, turned", "3 links", "7 links", "7 links, turned", "20 links"),
)
def _straight(variant: str, bend: float) -> Posed:
    links = int(variant.split()[0])
    heading = 0.3 if "turned" in variant else 0.0
    return _posed(_rods(np.zeros(links), heading + bend * np.arange(links)))


# ---- Links of very different masses and of very different lengths --------------------------------

UNEQUAL = 6
PATTERNS: dict[str, Callable] = {
    "head": lambda k: k == 0,
    "tail": lambda k: k == UNEQUAL - 1,
    "alternating": lambda k: k % 2 == 0,
}


def _unequal(quantity: str, variant: str, ratio: float) -> Posed:
    chosen = PATTERNS[variant.split()[-1]](np.arange(UNEQUAL))
    sizes = {"mass": np.ones(UNEQUAL), "length": np.ones(UNEQUAL)}
    sizes[quantity] = np.where(chosen, ratio, 1.0)
    return _posed(bent(UNEQUAL, **sizes, inertia=sizes["mass"] * sizes["length"] ** 2 / 12))


for _what, _word in (("mass", "heavy"), ("length", "long")):
    family(
        f"{_what}-ratio",
        f"{_what.capitalize()} ratio",
        f"largest {_what} over smallest",
        values=decades(0, 16),
        quick=decades(0, 16, 4),
        variants=(f"{_word} head", f"{_word} tail", "alternating"),
    )(partial(_unequal, _what))


# ---- Longer and longer chains: the motion from head to tail can outgrow all others ---------------


def _random(links: int, turn: float) -> Snake:
    random = np.random.default_rng(links)
    alpha = random.uniform(-0.3, 0.3, links)
    theta = np.cumsum(random.uniform(-turn, turn, links))
    return _rods(alpha, theta, stiffness=np.full(links - 1, 5000.0))


CHAINS: dict[str, Callable[[int], Snake]] = {
    "coil": Snake.coil,
    "pattern": Snake.pattern,
    "random, bent a little": lambda links: _random(links, 0.2),
    "random, bent": lambda links: _random(links, 1.0),
}
NUMBERS = [*(2, 3, 5, 7, 10, 15, 20, 30, 40, 50, 70, 89, 100), 150, 200, 250, 300, 500, 700, 1000]


@family(
    "links",
    "Long chain",
    "number of links N",
    values=tuple(map(float, NUMBERS)),
    quick=(2.0, 7.0, 20.0, 50.0),
    variants=tuple(CHAINS),
)
def _long(variant: str, links: float) -> Posed:
    scene = CHAINS[variant](int(links))
    if variant == "pattern":
        return _posed(scene, np.zeros(2))  # velocities of 500 links and more overflow float64
    q, _ = scene.initial_state()
    fastest = np.abs(midpoints(enclose(scene, "kane", q, MOVING, digits=1).v)).max()
    return Posed(scene, q, MOVING / fastest)


# ---- Speeds at the ends of the range of float64, and angles of many turns ------------------------

FAST = "Fast and slow", "speed over 1 m/s and 1 rad/s, or its inverse"
TURNED = "Many turns", "turns of each angle"
SPEEDS, TURNS = decades(0, 170, 10), decades(0, 15)


@family(
    "speed",
    *FAST,
    values=SPEEDS,
    quick=(1.0, 1e50, 1e100, 1e150, 1e170),
    variants=("fast", "fast, springs", "slow", "slow, springs"),
)
def _fast_snake(variant: str, factor: float) -> Posed:
    scene = bent(5) if "springs" in variant else bent(5, stiffness=None)
    return _posed(scene, (factor if variant.startswith("fast") else 1.0 / factor) * MOVING)


@family(
    "turns",
    *TURNED,
    values=TURNS,
    quick=(1.0, 1e4, 1e8, 1e12),
    variants=("all alike", "each more than the last"),
)
def _turned_snake(variant: str, turns: float) -> Posed:
    scene = bent(5)
    q, _ = scene.initial_state()
    q[2:] += 2 * math.pi * turns * (1.0 if variant == "all alike" else np.arange(1, 6))
    return Posed(scene, q, MOVING)


# ---- Constraints that are nearly dependent, and violated a little --------------------------------


@family(
    "dependent",
    "Dependent constraints",
    "angle between two wheels of one link / rad",
    values=TO_ZERO,
    quick=(1.0, 1e-4, 1e-8, 1e-12, 1e-16, 0.0),
    variants=("at rest", "moving"),
    scene=TwoWheels,
    about=Snake.key,
)
def _two_wheels(variant: str, angle: float) -> Posed:
    # Wheel 1 lies along its link, so that the angle of the second wheel is one float64, not a sum.
    return _posed(TwoWheels(bent(5), angle), np.zeros(1) if variant == "at rest" else np.ones(1))


SLIDING = {
    "coil": Snake.coil(7),
    "pattern": Snake.pattern(20),
    "free": _rods([0.1, 0.2, 0.3], [0.0, 0.4, 1.0], stiffness=None),
}


@family(
    "violated",
    "Violated constraints",
    "sliding of every wheel over the largest speed",
    values=decades(-16, 0),
    quick=decades(-16, 0, 4),
    variants=tuple(SLIDING),
)
def _sliding(variant: str, violation: float) -> Posed:
    scene = SLIDING[variant]
    return violating(scene, scene.initial_state()[0], MOVING, violation)


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


def _register_families_of(kind: type[Scene]) -> None:
    @family(
        f"{kind.key}-mass",
        "Mass",
        "first mass over its default, or its inverse",
        values=decades(0, 16),
        variants=("heavier", "lighter"),
        scene=kind,
    )
    def mass_ratio(variant: str, ratio: float) -> Posed:
        scene: Any = kind.example()
        name = next(name for name in ("mass", "arm") if hasattr(scene, name))
        mass = np.array(getattr(scene, name))
        mass.flat[0] *= ratio if variant == "heavier" else 1.0 / ratio
        scene = replace(scene, **{name: mass})
        return Posed(scene, *ordinary(scene))

    @family(
        f"{kind.key}-speed",
        *FAST,
        values=SPEEDS,
        quick=(1.0, 1e100, 1e170),
        variants=("fast", "slow"),
        scene=kind,
    )
    def fast(variant: str, factor: float) -> Posed:
        scene = kind.example()
        q, u = ordinary(scene)
        return Posed(scene, q, u * (factor if variant == "fast" else 1.0 / factor))

    alike = {"variants": ("all alike",), "scene": kind}

    @family(f"{kind.key}-turns", *TURNED, values=TURNS, quick=(1.0, 1e8), **alike)
    def turned(variant: str, turns: float) -> Posed:
        scene = kind.example()
        q, u = ordinary(scene)
        q[kind.angle_coordinates] += 2 * np.pi * turns
        return Posed(scene, q, u)

    if kind.example().r:
        rate = "rate of every constraint over the largest speed"

        @family(
            f"{kind.key}-violated", "Violated constraints", rate, values=decades(-16, 0), **alike
        )
        def violated(variant: str, violation: float) -> Posed:
            scene = kind.example()
            return violating(scene, *ordinary(scene), violation)


for _kind in SCENES.values():
    if _kind is not Snake:
        _register_families_of(_kind)

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


for _kind in (scenes.RollingDisk, scenes.TurntableBall):
    family(
        f"{_kind.key}-flat",
        "Lean",
        "distance of the lean from ±π/2 / rad",
        values=decades(-1, -16),
        quick=(1e-1, 1e-8, 1e-16),
        variants=("+π/2", "-π/2"),
        scene=_kind,
    )(partial(_flat, _kind))


def _stiff(kind: type[Scene], variant: str, stiffness: float) -> Posed:
    scene: Any = kind.example()
    scene = replace(scene, stiffness=stiffness)
    return Posed(scene, *ordinary(scene))


for _kind in (scenes.Andrews, scenes.FlyballGovernor):
    family(
        f"{_kind.key}-stiffness",
        "Stiffness",
        "stiffness of the springs / (N/m)",
        values=(0.0, *decades(0, 16)),
        quick=(0.0, 1e8, 1e16),
        scene=_kind,
    )(partial(_stiff, _kind))


@family(
    "chain-pendulum-links",
    "Long chain",
    "number of links N",
    values=(1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0),
    quick=(1.0, 5.0, 20.0),
    scene=scenes.ChainPendulum,
)
def _pendulum(variant: str, links: float) -> Posed:
    (scene, *_) = scenes.ChainPendulum.structures(int(links))
    return Posed(scene, *ordinary(scene))


@family(
    "sleigh-offset",
    "Offset",
    "distance of the edge from the centre of mass / m",
    values=TO_ZERO,
    scene=scenes.Sleigh,
)
def _knife_edge(variant: str, offset: float) -> Posed:
    scene = scenes.Sleigh(offset=offset)
    return Posed(scene, *ordinary(scene))


@family(
    "four-bar-chain-in-line",
    "All in line",
    "angle between rods and couplers / rad",
    values=TO_ZERO,
    scene=scenes.FourBarChain,
)
def _in_line(variant: str, angle: float) -> Posed:
    scene = replace(scenes.FourBarChain.rods(3), angle=angle)
    return _posed(scene, np.ones(scene.p))


@family(
    "bricard-stretched",
    "Stretched",
    "distance of the first angle from -π/6 / rad",
    values=decades(0, -15),
    scene=scenes.Bricard,
)
def _stretched(variant: str, distance: float) -> Posed:
    scene = scenes.Bricard()
    q, _ = scene.closed_state(-math.pi / 6 + distance, 0.0)
    return Posed(scene, q, np.ones(1))


@family(
    "bicycle-lying",
    "Lying",
    "angle between frame and ground / rad",
    values=TO_ZERO,
    scene=scenes.Bicycle,
)
def _lying(variant: str, lean: float) -> Posed:
    scene = scenes.Bicycle()
    q, _ = scene.initial_state()
    # The bicycle tilts about the line on the ground between the wheels.
    q[bicycle.LEAN], q[bicycle.HEIGHT] = lean, scene.radius[0] * math.sin(lean)
    return Posed(scene, q, 1.0 / np.arange(1, scene.p + 1))


# ---- All families --------------------------------------------------------------------------------

_ORDER = [Snake.key, *SCENES]
FAMILIES = {one.key: one for one in sorted(REGISTERED, key=lambda one: _ORDER.index(one.about))}
"""Key -> family: those of the snake, then scene by scene."""
