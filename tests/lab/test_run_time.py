"""Run times: best run and quartiles, the core they are held on, the CPU time beside."""

from __future__ import annotations

import os
import time

import pytest

from eomcheck.lab import study as module
from eomcheck.lab.study import held_on_a_core, run_time

linux = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no affinity here")


def test_the_best_of_all_runs_counts_and_quartiles_are_no_less():
    done: list[int] = []
    found = run_time(lambda: done.append(sum(range(2000))))
    assert len(done) == found.runs == module.RUNS
    low, high = found.quartiles
    assert 0 < found.seconds <= low <= high


def test_the_cpu_time_is_that_of_the_best_run(monkeypatch):
    runs = [(1.0, 0.2), (0.5, 0.45), (0.8, 0.1)]
    wall, cpu = ([x for run in runs for x in (0.0, run[clock])] for clock in (0, 1))
    monkeypatch.setattr(module.time, "perf_counter", lambda: wall.pop(0))
    monkeypatch.setattr(module.time, "thread_time", lambda: cpu.pop(0))
    found = run_time(lambda: None, runs=3)
    assert (found.seconds, found.cpu_seconds) == (0.5, 0.45)


def test_long_work_runs_less_often():
    assert run_time(lambda: None, long=0.0).runs == module.FEWEST
    assert run_time(lambda: None, runs=5, fewest=2, long=0.0).runs == 2
    assert run_time(lambda: None, runs=5).runs == 5


def test_time_without_the_core_is_no_cpu_time():
    # To sleep and to be put off the core by another program are the same to the clocks.
    found = run_time(lambda: time.sleep(0.005))
    assert found.seconds >= 0.005
    assert found.cpu_seconds < 0.5 * found.seconds


@linux
def test_runs_are_held_on_one_core_and_free_afterwards():
    allowed = os.sched_getaffinity(0)
    seen: set[frozenset[int]] = set()
    found = run_time(lambda: seen.add(frozenset(os.sched_getaffinity(0))))
    assert seen == {frozenset({found.core})}
    assert found.core in allowed
    assert os.sched_getaffinity(0) == allowed


@linux
def test_work_that_fails_leaves_no_thread_held():
    allowed = os.sched_getaffinity(0)
    with pytest.raises(ZeroDivisionError), held_on_a_core():
        raise ZeroDivisionError
    assert os.sched_getaffinity(0) == allowed


def test_a_system_that_cannot_hold_a_thread_is_no_obstacle(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delattr(os, "sched_setaffinity", raising=False)
    monkeypatch.delattr(os, "getloadavg", raising=False)
    found = run_time(lambda: None)
    assert (found.core, found.load) == (None, None)
    assert found.runs == module.RUNS
