"""What is looked at of a motion costs memory and time like the motion itself, and says how far."""

from __future__ import annotations

import io
import time
import tracemalloc
import weakref

import numpy as np
import pytest

from eomcheck import console
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion import simulate as looks
from eomcheck.motion import simulate as module
from eomcheck.motion.simulate import Motion, simulate
from eomcheck.scenes import Snake

PAPER = Snake.paper()


def states(key: str, count: int) -> tuple[Motion, np.ndarray, np.ndarray]:
    q, v = PAPER.initial_state()
    m = Motion(PAPER, FORMULATIONS[key], q, v)
    y = m.y0 + 0.1 * np.random.default_rng(1).standard_normal((count, m.y0.size))
    return m, np.linspace(0.0, 1.0, count), y


@pytest.mark.parametrize("key", ["kane", "au"])
def test_states_are_seen_alike_a_few_at_a_time(key: str, monkeypatch):
    m, t, y = states(key, 23)
    whole = m.observables(t, y)
    assert set(whole) == {"v", "energy", "constraint"} | ({"multipliers"} if key == "au" else set())
    monkeypatch.setattr(module, "LARGEST_CHUNK", 150)  # five states, or fewer
    parts = m.observables(t, y)
    assert all(np.array_equal(parts[name], x) for name, x in whole.items())
    assert all(len(x) == 0 for x in m.observables(t[:0], y[:0]).values())


@pytest.mark.parametrize("key", ["kane", "au"])
def test_seeing_states_takes_the_memory_of_what_is_seen(key: str, monkeypatch):
    m, t, y = states(key, 20_000)
    monkeypatch.setattr(module, "LARGEST_CHUNK", 2**12)
    m.observables(t[:2], y[:2])
    tracemalloc.start()
    found = m.observables(t, y)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1.1 * sum(x.nbytes for x in found.values())


def test_evaluations_of_states_looked_at_are_not_all_kept(monkeypatch):
    alive: list[int] = []
    known: list[weakref.ref] = []
    evaluation = Motion.evaluation

    def watched(self, y, t) -> Evaluation | None:
        found = evaluation(self, y, t)
        assert found is not None
        known.append(weakref.ref(found))
        alive.append(sum(one() is not None for one in known))
        return found

    monkeypatch.setattr(Motion, "evaluation", watched)
    simulate(PAPER, "kane", 0.5, max_step=1e-3)
    assert len(alive) == looks.MOST_CHECKED_STATES
    assert max(alive) < 20  # first, last, worst, and what the interpreter has not collected yet


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("within", [False, True])
def test_what_takes_long_says_how_far_it_has_come_unless_something_else_does(within, monkeypatch):
    shown = Terminal()
    monkeypatch.setattr("sys.stderr", shown)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(console, "PATIENCE", 0.01)
    reached = iter(range(1, 1000))
    outer = console.progress("outer" if within else "", 2)
    with outer, console.polled_progress("inner", 1000, lambda: next(reached)):
        time.sleep(0.5)
    assert ("inner" in shown.getvalue()) is not within
    assert ("outer" in shown.getvalue()) is within
    assert next(reached) > 1
    monkeypatch.setattr(console, "PATIENCE", 1.0)
    before = len(shown.getvalue())
    with console.polled_progress("inner", 1000, lambda: next(reached)):
        pass
    assert len(shown.getvalue()) == before


def test_a_motion_that_takes_long_says_how_far_it_has_come(monkeypatch):
    m, *_ = states("kane", 1)
    seen = []

    def watched(label: str, total: float, reached):
        seen.append((label, total, reached))
        return console.progress("", 1)

    monkeypatch.setattr(module, "polled_progress", watched)
    m.solve(0.25)
    ((label, total, reached),) = seen
    assert (label, total) == ("integrating by kane", 0.25)
    assert 0.0 < reached() <= 0.25
