"""Run times: the same work again and again, warm; the best run counts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from statistics import quantiles
from typing import Any


def timed(
    work: Callable[[], object],
    runs: int,
    *,
    fewest: int,
    long: float,
    clock: Callable[[], float] = time.perf_counter,
) -> list[float]:
    """Return the seconds of each of several runs of `work`.

    Args:
        work: what is timed; its first run is one of those that count.
        runs: number of runs.
        fewest: so many are enough if each takes longer than
        long: s.
        clock: what tells the time, s.
    """
    seconds: list[float] = []
    while len(seconds) < runs and not (len(seconds) >= fewest and min(seconds) > long):
        start = clock()
        work()
        seconds.append(clock() - start)
    return seconds


def run_times(seconds: list[float]) -> dict[str, Any]:
    """Return what a Record says of these runs: the best, the quartiles, their number."""
    low, high = seconds[0], seconds[0]
    if len(seconds) > 1:
        low, _, high = quantiles(seconds, n=4, method="inclusive")
    return {"seconds": min(seconds), "quartiles": (low, high), "runs": len(seconds)}


def slope(points: Iterable[tuple[float, float]]) -> float:
    """Return the least-squares slope of log(y) over log(x)."""
    logs = [(math.log(x), math.log(y)) for x, y in points]
    mean_x = sum(x for x, _ in logs) / len(logs)
    mean_y = sum(y for _, y in logs) / len(logs)
    return sum((x - mean_x) * (y - mean_y) for x, y in logs) / sum(
        (x - mean_x) ** 2 for x, _ in logs
    )
