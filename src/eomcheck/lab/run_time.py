"""Run time of some work: the best of many warm runs, held on one core, beside its CPU time.

Timed work is done in this process, one cell at a time. Two at a time, each on its own core, share
caches and memory, and are more easily disturbed by other programs on the machine.
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

from eomcheck.formulations import formulation_of
from eomcheck.lab.store.provenance import machine
from eomcheck.lab.store.record_file import Record
from eomcheck.mechanics.scene import Scene
from eomcheck.motion.simulate import Motion

RUNS = 20
FEWEST = 3
CONTENTION_RATIO = 1.05
"""A run whose CPU time is less than its run time by more than this factor was disturbed."""
LONG = 2.0
"""Work that takes longer than this, in s, runs `FEWEST` times only."""


@dataclass(frozen=True)
class RunTime:
    """What timing some work has come to.

    Attributes:
        seconds: the best run.
        cpu_seconds: CPU time of this thread in that run; less than `seconds` where others had
            the core.
        quartiles: lower and upper quartile of the runs, s.
        runs: their number.
        core: on which they were held, None where the system cannot.
        load: programs that wanted to run in the minute before, ourselves included; None where the
            system does not count them.
    """

    seconds: float
    cpu_seconds: float
    quartiles: tuple[float, float]
    runs: int
    core: int | None
    load: float | None

    def recorded(self) -> dict[str, Any]:
        """Return what a Record says of it."""
        of_record = asdict(self)
        here = {name: of_record.pop(name) for name in ("core", "load")}
        return of_record | {"machine": machine() | here}


def run_time(
    work: Callable[[], object], runs: int = RUNS, fewest: int = FEWEST, long: float = LONG
) -> RunTime:
    """Return the time that `work` takes.

    Args:
        work: what is timed; it must be warm, its first run counts too.
        runs: how often it runs.
        fewest: so often is enough if it takes longer than
        long: s.
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
    """Hold this thread on the core it is on, and provide its number; None where that cannot be."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed, core = os.sched_getaffinity(0), ctypes.CDLL(None).sched_getcpu()
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, allowed)


def prepare_motion(scene: Scene, key: str, *start: Any) -> tuple[Motion, float]:
    """Return the motion from a start, by default the scene's own, and the time to make it, s."""
    start, begin = start or scene.initial_state(), time.perf_counter()
    motion = Motion(scene, formulation_of(key), *start)
    return motion, time.perf_counter() - begin


def was_contended(record: Record) -> bool:
    """Return whether another program had the core for a part of the best run."""
    if record.seconds is None or record.cpu_seconds is None:
        return False
    return record.seconds > CONTENTION_RATIO * record.cpu_seconds


def slope(points: Iterable[tuple[float, float]]) -> float:
    """Return the least-squares slope of log(y) over log(x): the power with which a time grows."""
    x, y = np.log(list(points)).T
    return float(np.polyfit(x, y, 1)[0])
