"""Run time of work and of motions: the best of many warm runs, pinned to one core, and CPU time.

Timed work is done in this process, one cell at a time. Two at a time, each on its own core, share
caches and memory, and their times are noisier.
"""

from __future__ import annotations

import ctypes
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from statistics import quantiles
from typing import Any

import numpy as np

from eomcheck.errors import InputError
from eomcheck.formulations import formulation_of
from eomcheck.lab.store.record_file import Record, Settings, machine
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.simulate import Motion, Trajectory, trajectory_of
from eomcheck.numbers.generic import Array

RUNS = 20
FEWEST = 3
CONTENTION_RATIO = 1.05
"""Ratio of run time to CPU time above which a run was contended by other programs."""
LONG = 2.0
"""Run time, s, above which work runs `FEWEST` times only."""


@dataclass(frozen=True)
class RunTime:
    """The timings of some work.

    Attributes:
        seconds: time of the best run, s.
        cpu_seconds: CPU time of this thread in that run, s; less than `seconds` where other
            programs had the core.
        quartiles: lower and upper quartile of the runs, s.
        runs: number of runs.
        core: core to which they were pinned, None where the system cannot.
        load: load average of the minute before, this process included; None where the system has
            none.
    """

    seconds: float
    cpu_seconds: float
    quartiles: tuple[float, float]
    runs: int
    core: int | None
    load: float | None

    def recorded(self) -> dict[str, Any]:
        """Return the timings as fields of a Record."""
        fields = asdict(self)
        context = {name: fields.pop(name) for name in ("core", "load")}
        return fields | {"machine": machine() | context}


def run_time(
    work: Callable[[], object], runs: int = RUNS, fewest: int = FEWEST, long: float = LONG
) -> RunTime:
    """Return the run time of `work`.

    Args:
        work: function to time; it must be warm, since its first run counts too.
        runs: number of runs.
        fewest: number of runs if the work takes longer than `long`.
        long: run time above which `fewest` runs are enough, s.
    """
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    taken: list[tuple[float, float]] = []
    with held_on_a_core() as core:
        while len(taken) < (fewest if taken and min(taken)[0] > long else runs):
            start, cpu = time.perf_counter(), time.thread_time()
            work()
            taken.append((time.perf_counter() - start, time.thread_time() - cpu))
    low, _, high = quantiles([seconds for seconds, _ in taken], n=4, method="inclusive")
    return RunTime(*min(taken), (low, high), len(taken), core, load)


@contextmanager
def held_on_a_core() -> Iterator[int | None]:
    """Pin this thread to its current core, and provide the number; None where impossible."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed, core = os.sched_getaffinity(0), ctypes.CDLL(None).sched_getcpu()
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


def was_contended(record: Record) -> bool:
    """Return whether another program had the core for a part of the best run."""
    if record.seconds is None or record.cpu_seconds is None:
        return False
    return record.seconds > CONTENTION_RATIO * record.cpu_seconds


def slope(points: Iterable[tuple[float, float]]) -> float:
    """Return the least-squares slope of log(y) over log(x): the power with which a time grows."""
    x, y = np.log(list(points)).T
    return float(np.polyfit(x, y, 1)[0])


# ---- Motions -------------------------------------------------------------------------------------

Judged = tuple[dict[str, float], dict[str, Any]]
"""Errors and series of a trajectory, by name."""


def prepare_motion(scene: Scene, key: str, *start: Any) -> tuple[Motion, float]:
    """Return the `Motion` from a start, by default the scene's, and its construction time, s."""
    start, begin = start or scene.initial_state(), time.perf_counter()
    motion = Motion(scene, formulation_of(key), *start)
    return motion, time.perf_counter() - begin


def check_tolerances(tolerances: Iterable[float]) -> None:
    """Raise InputError unless every tolerance is between 0 and 1."""
    for one in tolerances:
        if not 0 < one < 1:
            raise InputError(f"tolerance = {one!r}, expected a number between 0 and 1")


def solver_options(settings: Settings, times: Array) -> dict[str, Any]:
    """Return the options of `Motion.solve` in a cell: integrator, tolerances, output times."""
    tolerance, options = settings["tolerance"], {"integrator": settings["integrator"]}
    return options | {"rtol": tolerance, "atol": tolerance, "output_times": times}


def motion_record(
    study: str,
    settings: Settings,
    prepared: tuple[Motion, float],
    times: Array,
    judge: Callable[[Trajectory], Judged],
    counts: dict[str, int] | None = None,
    **timing: Any,
) -> Record:
    """Return the Record of a motion: integrated and judged, then timed if it reaches its end.

    Args:
        study: key of the study.
        settings: those of the cell, with an integrator and a tolerance.
        prepared: the motion and its construction time, see `prepare_motion`.
        times: output times (k,), s; the last one is the end.
        judge: trajectory -> its errors and series.
        counts: counts beside those of right-hand sides and steps.
        timing: options of `run_time`.
    """
    motion, compile_seconds = prepared
    end, options = float(times[-1]), solver_options(settings, times)
    every, steps = motion.every_step(end, **options), motion.solve(end, **options)
    integrator, tolerance = settings["integrator"], settings["tolerance"]
    found = trajectory_of(motion, steps, integrator, tolerance, tolerance, 0.0, every)
    counts = {"right-hand sides": found.right_hand_sides, "steps": found.steps} | (counts or {})
    if found.status != "finished":
        return Record(study, settings, "failed", found.reason, counts=counts)
    taken = run_time(lambda: motion.solve(end, **options), **timing)
    errors, series = judge(found)
    return Record(
        study,
        settings,
        **taken.recorded(),
        compile_seconds=compile_seconds,
        counts=counts,
        errors=errors,
        series=series,
    )
