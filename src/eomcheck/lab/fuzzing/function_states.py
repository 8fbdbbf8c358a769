"""States of somebody's functions: drawn within their ranges, and climbed to."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from eomcheck.lab.fuzzing.families import SPECIAL
from eomcheck.lab.fuzzing.mutation import MOST_CHANGES, changed_entries
from eomcheck.lab.fuzzing.scenes import special_number
from eomcheck.lab.fuzzing.work import Population
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.testing.equations_of_motion import Functions


@lru_cache(8)
def limits(functions: Functions) -> tuple[Array, Array]:
    """Return the smallest and the largest coordinates and velocities (n + p,)."""
    middle, half = functions.half_ranges()
    return middle - half, middle + half


def drawn_state(functions: Functions, family: str, random: np.random.Generator) -> State:
    """Return a state within the ranges: anywhere, or at or next to special numbers."""
    low, high = limits(functions)
    x, n = random.uniform(low, high), functions.n
    if family == SPECIAL:
        q = np.array([special_number(random, x[:n]) for _ in range(n)])
        x[:n] = np.where(random.random(n) < 0.75, q, x[:n])
        if random.random() < 0.25:
            x[n:] = np.where(random.random(len(x) - n) < 0.5, 0.0, x[n:])
    return _within(functions, x)


def climbed_states(
    functions: Functions, population: Population, count: int, random: np.random.Generator
) -> list[State]:
    """Return states near the highest: of a claim at random one of its states, changed a little."""
    keys, found = sorted(population), []
    for _ in range(count):
        best, others = (population[keys[random.integers(len(keys))]] for _ in range(2))
        place = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        here, there = (
            np.concatenate(one.case[1][:2])
            for one in (best[place], others[random.integers(len(others))])
        )
        low, high = limits(functions)
        for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
            new = changed_entries(here, there, random)
            # What leaves a range goes to its end, or stays.
            left = ((new < low) | (new > high)) & (random.random(len(new)) < 0.5)
            here = np.where(left, here, np.clip(new, low, high))
        found.append(_within(functions, here))
    return found


def _within(functions: Functions, x: Array) -> State:
    x = np.clip(x, *limits(functions))
    return State(x[: functions.n], x[functions.n :])
