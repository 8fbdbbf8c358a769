"""Time of a whole motion: the paper's robot for 1 s, compiled throughout and through Python.

Both integrators are DOP853 with the very same compiled right-hand side: CyRK calls it from C, SciPy
from Python.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eomcheck.console import progress
from eomcheck.formulations import FORMULATIONS, formulation_of
from eomcheck.motion.callback import CALLS
from eomcheck.motion.simulate import Motion
from eomcheck.scenes import Snake
from eomcheck.studies.run_time import run_time

END = 1.0
"""s."""
TOLERANCE = 1e-12
"""rtol = atol."""
ROUNDS = 6
"""Every formulation is timed in each: a slow minute of the machine is one of all of them."""
RUNS, IN_PYTHON = 5, 2
"""Runs in a round, by CyRK and through SciPy."""


@dataclass(frozen=True)
class MotionTime:
    """What one motion takes.

    Attributes:
        formulation: key.
        seconds: best run by CyRK.
        right_hand_sides: evaluated in it.
        seconds_in_python: best run by SciPy.
    """

    formulation: str
    seconds: float
    right_hand_sides: int
    seconds_in_python: float


def measure_motions(keys: Iterable[str] | None = None) -> list[MotionTime]:
    """Time the paper's robot, released at rest, by every formulation, by default all.

    Raises:
        UnknownNameError: no such formulation.
    """
    scene = Snake.paper()
    keys = list(dict.fromkeys(keys or FORMULATIONS))
    motions = [Motion(scene, formulation_of(key), *scene.initial_state()) for key in keys]
    compiled, python = ([float("inf")] * len(motions) for _ in range(2))
    calls = [0] * len(motions)
    with progress("timing", ROUNDS * len(motions)) as advance:
        for _ in range(ROUNDS):
            for i, motion in enumerate(motions):
                best = run_time(
                    lambda m=motion: m.solve(END, rtol=TOLERANCE, atol=TOLERANCE), runs=RUNS
                )
                calls[i] = int(motion.table.counts[CALLS])
                compiled[i] = min(compiled[i], best.seconds)
                best = run_time(lambda m=motion: _by_scipy(m), runs=IN_PYTHON)
                python[i] = min(python[i], best.seconds)
                advance()
    return [MotionTime(*found) for found in zip(keys, compiled, calls, python, strict=True)]


def _by_scipy(motion: Motion) -> None:
    from scipy.integrate import solve_ivp

    options = {"method": "DOP853", "rtol": TOLERANCE, "atol": TOLERANCE}
    solve_ivp(motion.function, (0.0, END), motion.y0, **options)
