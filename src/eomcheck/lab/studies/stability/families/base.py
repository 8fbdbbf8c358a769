"""What a family of states of growing severity is, as data, and states that violate constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.scenes import Snake


class Posed(NamedTuple):
    """A state of a family. Either u or v is given."""

    scene: Scene
    q: Array
    """Coordinates (n,)."""
    u: Array | None
    """Generalized speeds (p,): the truth is one and the same for all formulations."""
    v: Array | None = None
    """Velocities (n,), perhaps inconsistent: each formulation has an exact answer of its own."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """States that grow more severe, by one number.

    Attributes:
        key: short name, used everywhere.
        name: what it is about, for headings.
        severity: the number that grows severe, with its symbol and unit, for an axis.
        values: from mild to severe; all but 0 are drawn on a logarithmic axis.
        quick: those of `values` that a quick run takes.
        variants: names of the ways in which each severity is looked at.
        pose: (variant, severity) -> the state.
        scene: kind of its scenes.
        about: key of the kind of scene that it says something of, by default that of its scenes.
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

    Formulations then answer different questions: those in Lagrange's terms take v as it is, those
    in generalized speeds its u and nothing else. Each is compared with its own exact answer.
    """
    v = velocity(scene, q, u)
    a = Evaluation(scene, q, v).terms.a
    away = np.linalg.lstsq(a, np.ones(scene.r), rcond=None)[0]
    return Posed(scene, q, None, v + violation * np.abs(v).max() * away)
