"""Run time of a whole motion, of the paper's robot for 1 s, in machine code and through Python.

Both integrators are DOP853 with the very same right-hand side in machine code: CyRK calls it from
C, SciPy from Python.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from eomcheck.console import progress
from eomcheck.formulations import FORMULATIONS, formulations_for
from eomcheck.lab.option_parsing import One
from eomcheck.lab.show.table import ResultTable, seconds_text, table_of
from eomcheck.lab.store.record_file import Record, Settings, record_of_rows, rows_in
from eomcheck.lab.study import Formulations, Study, document_of, failed, run_time
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


SECONDS = "seconds", "seconds_in_python"
COLUMNS = (
    ("formulation", lambda one: one.formulation),
    ("CyRK", lambda one: seconds_text(one.seconds)),
    ("right-hand sides", lambda one: f"{one.right_hand_sides:,}"),
    ("each", lambda one: seconds_text(one.seconds / one.right_hand_sides)),
    ("SciPy", lambda one: seconds_text(one.seconds_in_python)),
    ("ratio", lambda one: f"{one.seconds_in_python / one.seconds:.3g}"),
)


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
                best = {name: min(getattr(old, name), getattr(new, name)) for name in SECONDS}
                times[new.formulation] = replace(new, **best)
                advance()
    return record_of_rows(STUDY.key, settings, times.values())


def _measure(motion: Motion) -> MotionTime:
    from scipy.integrate import solve_ivp

    options: dict[str, Any] = {"rtol": TOLERANCE, "atol": TOLERANCE}
    by_cyrk = run_time(lambda: motion.solve(END, **options), runs=RUNS)
    calls, start = motion.rates.calls, ((0.0, END), motion.y0)
    python = run_time(
        lambda: solve_ivp(motion.rates, *start, method="DOP853", **options), runs=IN_PYTHON
    )
    return MotionTime(motion.formulation.key, by_cyrk.seconds, calls, python.seconds)


def tables(records: Sequence[Record]) -> Iterator[ResultTable]:
    """Yield the run time of a motion by CyRK and by SciPy, and their ratio."""
    rows = rows_in(records, MotionTime)
    failed = [one.formulation for one in rows if not math.isfinite(one.seconds)]
    names = dict.fromkeys(one.settings.get("scene", PAPER) for one in records)
    of = ", ".join("the paper's robot" if name == PAPER else name for name in names)
    note = (
        f"Best time of {END:g} s of {of} by DOP853, rtol = atol = {TOLERANCE:.0e}, "
        "with the same right-hand side in machine code."
        + (f" Do not reach the end: {', '.join(failed)}." if failed else "")
    )
    finished = (one for one in rows if math.isfinite(one.seconds))
    yield table_of("motion", "Time of a motion", finished, COLUMNS, note=note)


STUDY = Study(
    key="motion",
    cells=cells,
    worker=lambda stored: time_motion,
    tables=tables,
    label="",
    alarm=failed,
    document=document_of("motions", MotionTime),
    small=True,
)
