"""Motions to know well, of which there are reference solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from eomcheck.errors import named
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.scenes import (
    Andrews,
    Bicycle,
    Bricard,
    ChainPendulum,
    FlyballGovernor,
    FourBarChain,
    RollingDisk,
    Sleigh,
    Snake,
    TurntableBall,
)


@dataclass(frozen=True)
class Case:
    """A motion to know well: `parts` equal intervals from 0 to `end`, from `initial_state().q`.

    It can be pickled, so `scene` is no lambda.
    """

    description: str
    scene: Callable[[], Scene]
    u0: tuple[float, ...] = (0.0, 0.0)
    end: float = 1.0
    """s."""
    parts: int = 20
    minutes: float = 1.0
    """What it takes about, on one core."""

    @property
    def times(self) -> Array:
        """Output times (parts + 1,), s."""
        return np.arange(self.parts + 1) * self.end / self.parts


CASES: dict[str, Case] = {
    "paper-rest": Case("the paper's seven-link robot, released at rest", Snake.paper, minutes=4.0),
    "paper-rolling": Case(
        "the paper's seven-link robot, started with u = (1 m/s, 0.5 rad/s)",
        Snake.paper,
        (1.0, 0.5),
        minutes=4.0,
    ),
    "coil-2": Case(
        "two links coiled by 308°, released at rest", partial(Snake.coil, 2), minutes=2.0
    ),
    # A second of it would take the second integration half an hour.
    "coil-20": Case(
        "twenty links coiled by 308°, released at rest, 0.25 s only: more would take long",
        partial(Snake.coil, 20),
        end=0.25,
        parts=5,
        minutes=10.0,
    ),
    "free-3": Case(
        "three links without springs, started with u = (1 m/s, 0.5 rad/s), 10 s",
        partial(replace, Snake.coil(3), stiffness=None),
        (1.0, 0.5),
        end=10.0,
    ),
    "pendulum-3": Case(
        "three rods swung, 2 s", partial(ChainPendulum.rods, 3), (1.0, 0.5, -0.5), end=2.0
    ),
    "sleigh": Case("Chaplygin's sleigh, pushed and turning, 5 s", Sleigh, (1.0, 2.0), end=5.0),
    "disk": Case("a tilted disk that wobbles and rolls", RollingDisk, (0.3, 1.0, 4.0)),
    "turntable": Case(
        "a ball on a turntable whose spin swings, 2 s",
        partial(TurntableBall, swing=1.0, frequency=3.0),
        (1.0, 0.5, 2.0),
        end=2.0,
    ),
    "four-bar-2": Case(
        "two windows of the four-bar chain, 1 s",
        partial(replace, FourBarChain.rods(2), angle=1.0),
        (1.0,),
    ),
    "andrews": Case(
        "Andrews' squeezing mechanism, released at rest, 0.03 s", Andrews, (0.0,), end=0.03
    ),
    "governor": Case(
        "the flyball governor, its springs and dampers as published, 0.1 s",
        FlyballGovernor,
        (0.0, 6.0, 0.0, 0.0),
        end=0.1,
    ),
    "bricard": Case("Bricard's mechanism, released along a cube's edges, 1 s", Bricard, (0.0,)),
    "bicycle": Case(
        "the benchmark bicycle at 4.6 m/s, pushed to lean, 1 s", Bicycle, (0.5, 0.0, 4.6 / 0.3)
    ),
}
"""Name -> case."""


def case_of(name: str) -> Case:
    """Return the case called `name`.

    Raises:
        UnknownNameError: there is none.
    """
    return named("reference", name, CASES)
