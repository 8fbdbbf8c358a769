"""The cost of one right-hand side: every formulation, over the number of links.

All in one run and one process: the compiled right-hand sides, called in a compiled loop; the sines
and cosines of the link angles alone; and Pinocchio's `computeAllTerms` and `forwardDynamics` on the
same chain, called from Python as its users do. Medians of warm runs; compile time apart.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from statistics import median, quantiles

import numba
import numpy as np

from eomcheck.arithmetic.float64 import angles, compiled
from eomcheck.console import progress
from eomcheck.engines.base import required
from eomcheck.engines.pinocchio import PinocchioEngine
from eomcheck.errors import InputError
from eomcheck.evaluate import Evaluation
from eomcheck.formulations import Formulation, formulations_for
from eomcheck.motion.right_hand_side import right_hand_side
from eomcheck.scenes import Snake
from eomcheck.states import velocity

LINKS = (7, 20, 100, 1000, 10000)
DENSE_LIMIT = 200
"""Largest N for what costs O(N³), unless a formulation is named."""
BATCH_SECONDS = 0.02
"""A timed batch repeats the call until it takes about this long."""

TRIGONOMETRY = "sin, cos"
PINOCCHIO = PinocchioEngine.key


@dataclass(frozen=True)
class Timing:
    """Seconds of one call: `what` at N = `links`.

    `seconds` is the median over batches, `quartiles` the lower and the upper one. `compile_seconds`
    is what the first call took more, in this process, with what the disk cache held.
    """

    what: str
    links: int
    seconds: float
    quartiles: tuple[float, float]
    compile_seconds: float


def bench_snake(links: int) -> tuple[Snake, np.ndarray, np.ndarray]:
    """Return a gently curved snake with springs in motion, whose W does not grow: (scene, q, u)."""
    one = np.ones(links)
    scene = Snake(one, one, one / 12, 10.0 * one[1:], 0.2 * np.cos(np.arange(links)))
    theta = 0.3 * np.sin(0.7 * np.arange(links))
    return scene, np.concatenate(([0.0, 0.0], theta)), np.array([1.0, 0.3])


Job = tuple[str, int, Callable[[int], object]]
"""What is timed, at how many links, and a function call(k) that does it k times."""


def time_calls(
    jobs: Iterable[Job], repeats: int, advance: Callable[[], None] = lambda: None
) -> list[Timing]:
    """Time jobs in turn, one batch of each, so often: a slow second is one of all of them.

    Args:
        jobs: what is timed; each is compiled when its turn to be made comes.
        repeats: batches of each, of which the median counts.
        advance: called after each job is compiled, and after each batch.
    """
    ready = []
    for what, links, call in jobs:
        first, count = _seconds(call, 1), 1
        for _ in range(3):  # one call is mostly the way into compiled code
            count = max(1, round(BATCH_SECONDS * count / max(_seconds(call, count), 1e-7)))
        ready.append((what, links, call, count, first))
        advance()
    batches: list[list[float]] = [[] for _ in ready]
    for _ in range(repeats):
        for (_, _, call, count, _), seconds in zip(ready, batches, strict=True):
            seconds.append(_seconds(call, count) / count)
            advance()
    return [
        _timing(what, links, seconds, first)
        for (what, links, _, _, first), seconds in zip(ready, batches, strict=True)
    ]


def _seconds(call: Callable[[int], object], count: int) -> float:
    start = time.perf_counter()
    call(count)
    return time.perf_counter() - start


def _timing(what: str, links: int, seconds: list[float], first: float) -> Timing:
    low, _, high = quantiles(seconds, n=4) if len(seconds) > 1 else [seconds[0]] * 3
    middle = median(seconds)
    return Timing(what, links, middle, (low, high), max(first - middle, 0.0))


@numba.njit
def _repeat(rate, parameters, q, speeds, t, partition, count):
    total = 0.0
    for _ in range(count):
        total += rate(parameters, q, speeds, t, partition)[1][0]
    return total


@numba.njit
def _repeat_angles(trigonometry, theta, count):
    total = 0.0
    for _ in range(count):
        prepared = trigonometry(theta)
        total += prepared.cos[0] + prepared.sin[-1]
    return total


def _formulation_call(formulation: Formulation, links: int) -> Callable[[int], object]:
    scene, q, u = bench_snake(links)
    at = Evaluation(scene, q, np.zeros(scene.n))
    at.u = u
    # Not `velocity`, which looks at the full constraint Jacobian.
    at.v = at.velocity
    return rate_call(at, formulation)


def rate_call(at: Evaluation, formulation: Formulation) -> Callable[[int], object]:
    """Return what calls the compiled right-hand side at a state so many times."""
    rate = right_hand_side(at.scene, formulation)
    arguments = (at.parameters, at.q, at.speeds_read(formulation), at.t, at.partition)
    return lambda count: _repeat(rate, *arguments, count)


def _trigonometry_call(links: int) -> Callable[[int], object]:
    theta = bench_snake(links)[1][2:]
    return lambda count: _repeat_angles(compiled(angles), theta, count)


def _pinocchio_call(links: int) -> Callable[[int], object]:
    pin = required(PINOCCHIO)
    scene, q, u = bench_snake(links)
    at = Evaluation(scene, q, velocity(scene, q, u))
    engine = PinocchioEngine(scene)
    T = engine.coordinates
    back = np.linalg.inv(T)
    Q = np.zeros(scene.n) if at.terms.Q is None else at.terms.Q
    x, xd, force = T @ at.q, T @ at.v, back.T @ Q
    jacobian, drift = at.terms.a @ back, at.terms.gamma
    model, data = engine.model, engine.data

    def call(count: int) -> None:
        for _ in range(count):
            pin.computeAllTerms(model, data, x, xd)
            pin.forwardDynamics(model, data, force, jacobian, drift)

    return call


def measure_all(
    links: Iterable[int] | None = None, keys: Iterable[str] | None = None, repeats: int = 15
) -> list[Timing]:
    """Time everything and return the Records.

    Args:
        links: numbers of links, by default `LINKS`.
        keys: formulations, all by default; those named are timed beyond `DENSE_LIMIT` too.
        repeats: timed batches per median.

    Raises:
        InputError: a number of links or of repeats below 1.
        UnknownNameError: no such formulation.
    """
    formulations = formulations_for(Snake, keys)
    chosen = LINKS if links is None else tuple(links)
    for name, values in (("links", chosen), ("repeats", (repeats,))):
        for value in values:
            if value < 1:
                raise InputError(f"{name} = {value}, expected at least 1")

    jobs: list[tuple[str, int, Callable[[int], Callable[[int], object]]]] = []
    for n in chosen:
        jobs.append((TRIGONOMETRY, n, _trigonometry_call))
        jobs += [
            (f.key, n, partial(_formulation_call, f))
            for f in formulations
            if f.linear or keys is not None or n <= DENSE_LIMIT
        ]
        if n <= DENSE_LIMIT:
            jobs.append((PINOCCHIO, n, _pinocchio_call))
    with progress("compiling and timing", (1 + repeats) * len(jobs)) as advance:
        made = ((what, n, prepare(n)) for what, n, prepare in jobs)
        return time_calls(made, repeats, advance)
