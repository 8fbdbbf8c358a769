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
IN_PYTHON = 5
"""Runs through SciPy."""


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
    formulations = [formulation_of(key) for key in dict.fromkeys(keys or FORMULATIONS)]
    scene = Snake.paper()
    records = []
    with progress("timing", len(formulations)) as advance:
        for formulation in formulations:
            motion = Motion(scene, formulation, *scene.initial_state())
            compiled = run_time(
                lambda motion=motion: motion.solve(END, rtol=TOLERANCE, atol=TOLERANCE)
            )
            calls = int(motion.table.counts[CALLS])
            python = run_time(lambda motion=motion: _by_scipy(motion), runs=IN_PYTHON)
            records.append(MotionTime(formulation.key, compiled.seconds, calls, python.seconds))
            advance()
    return records


def _by_scipy(motion: Motion) -> None:
    from scipy.integrate import solve_ivp

    options = {"method": "DOP853", "rtol": TOLERANCE, "atol": TOLERANCE}
    solve_ivp(motion.function, (0.0, END), motion.y0, **options)
