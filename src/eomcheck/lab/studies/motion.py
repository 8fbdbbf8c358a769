"""Run time of a whole motion, of the paper's robot for 1 s, in machine code and through Python.

Both integrators are DOP853 with the very same right-hand side in machine code: CyRK calls it from
C, SciPy from Python.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from eomcheck.console import progress
from eomcheck.formulations import FORMULATIONS, formulations_for
from eomcheck.lab.option_parsing import One
from eomcheck.lab.run_time import run_time
from eomcheck.lab.show.document_text import seconds_text
from eomcheck.lab.show.table import ResultTable
from eomcheck.lab.store.record_file import Record, Settings, record_of_rows, rows_in
from eomcheck.lab.study import Formulations, Study, document_of, failed
from eomcheck.motion.simulate import Motion
from eomcheck.scene_lookup import scene_named

PAPER = "paper"
END = 1.0
"""End of the motion, s."""
TOLERANCE = 1e-12
"""rtol = atol."""
ROUNDS = 6
"""Number of rounds; every formulation is timed in each, so that a slow minute of the machine
affects all of them.
"""
RUNS, IN_PYTHON = 5, 2
"""Numbers of runs in a round, by CyRK and through SciPy."""


@dataclass(frozen=True)
class MotionTime:
    """Run time of one motion.

    Attributes:
        formulation: key.
        seconds: best run by CyRK, s; NaN if it does not reach the end.
        right_hand_sides: number of evaluations in it.
        seconds_in_python: best run by SciPy, s.
    """

    formulation: str
    seconds: float
    right_hand_sides: int
    seconds_in_python: float


def cells(*, scene: One = PAPER, formulation: Formulations = None) -> Iterator[Settings]:
    """Yield one cell: all formulations are timed in turn.

    Raises:
        InputError: a formulation does not apply to the scene.
        UnknownNameError: no such scene or formulation.
    """
    keys = [one.key for one in formulations_for(scene_named(scene), formulation)]
    how = {"formulations": keys, "end": END, "tolerance": TOLERANCE}
    yield how if scene == PAPER else how | {"scene": scene}


def time_motion(settings: Settings) -> Record:
    """Time the motion of a scene from its initial state by some formulations."""
    keys, scene = settings["formulations"], scene_named(settings.get("scene", PAPER))
    times: dict[str, MotionTime] = {}
    motions = []
    with progress("making code and timing it in {step}", (1 + ROUNDS) * len(keys)) as advance:
        for key in keys:
            motion = Motion(scene, FORMULATIONS[key], *scene.initial_state())
            if motion.solve(END, rtol=TOLERANCE, atol=TOLERANCE).success:
                motions.append(motion)
            else:
                times[key] = MotionTime(key, math.nan, motion.rates.calls, math.nan)
            advance()
        for _ in range(ROUNDS):
            for motion in motions:
                new = _measure(motion)
                old = times.get(new.formulation, new)
                times[new.formulation] = MotionTime(
                    new.formulation,
                    min(old.seconds, new.seconds),
                    new.right_hand_sides,
                    min(old.seconds_in_python, new.seconds_in_python),
                )
                advance()
    return record_of_rows(STUDY.key, settings, times.values())


def _measure(motion: Motion) -> MotionTime:
    by_cyrk = run_time(lambda: motion.solve(END, rtol=TOLERANCE, atol=TOLERANCE), runs=RUNS)
    calls = motion.rates.calls
    python = run_time(lambda: _by_scipy(motion), runs=IN_PYTHON)
    return MotionTime(motion.formulation.key, by_cyrk.seconds, calls, python.seconds)


def _by_scipy(motion: Motion) -> None:
    from scipy.integrate import solve_ivp

    options = {"method": "DOP853", "rtol": TOLERANCE, "atol": TOLERANCE}
    solve_ivp(motion.rates, (0.0, END), motion.y0, **options)


def tables(found: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the run time of a motion by CyRK and by SciPy, and their ratio."""
    known = rows_in(found, MotionTime)
    rows = [
        (
            one.formulation,
            seconds_text(one.seconds),
            f"{one.right_hand_sides:,}",
            seconds_text(one.seconds / one.right_hand_sides),
            seconds_text(one.seconds_in_python),
            f"{one.seconds_in_python / one.seconds:.3g}",
        )
        for one in known
        if math.isfinite(one.seconds)
    ]
    failed = [one.formulation for one in known if not math.isfinite(one.seconds)]
    columns = ("formulation", "CyRK", "right-hand sides", "each", "SciPy", "ratio")
    names = dict.fromkeys(one.settings.get("scene", PAPER) for one in found)
    of = ", ".join("the paper's robot" if name == PAPER else name for name in names)
    note = (
        f"Best time of {END:g} s of {of} by DOP853, rtol = atol = {TOLERANCE:.0e}, "
        "with the same right-hand side in machine code."
        + (f" Do not reach the end: {', '.join(failed)}." if failed else "")
    )
    yield ResultTable("motion", "Time of a motion", columns, rows, note=note)


STUDY = Study(
    key="motion",
    cells=cells,
    worker=lambda known: time_motion,
    tables=tables,
    label="",
    alarm=failed,
    document=document_of("motions", MotionTime),
    small=True,
)
