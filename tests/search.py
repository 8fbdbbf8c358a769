"""Search for a right scene that is judged wrong, or a wrong number that does not say so.

    python -m tests.search [--accuracy 10000] [--checks 5000] [--seed 0] [--links 1..5]

Half of the states are drawn at random from the hostile strategies, half come by climbing: states
whose error comes closest to what is allowed are changed a little, or in part a lot, again and
again. Two heights are climbed: true error / stated bound of each formulation, by balls, and
observed / allowed of each claim of `eomcheck.check`. A find is a height above 1; it is printed as
code as soon as it is met. The exit code is 1 if there was one.
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import eomcheck
from eomcheck import strategies
from eomcheck.claims.finding import DECIDED
from eomcheck.claims.repeat import python_of
from eomcheck.console import progress
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.certified import true_error
from eomcheck.evaluation.dynamics import speeds_of
from eomcheck.evaluation.tolerance import UNDERFLOW, largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.draws import draw
from eomcheck.lab.studies.stability.measure import methods_of
from eomcheck.mechanics.records import State
from eomcheck.numbers.contract import Array
from eomcheck.scenes import Snake

Case = tuple[Snake, State]
Heights = dict[str, float]
"""Height of a case by what is climbed, such as a formulation or a claim."""

BEST = 12
"""Cases kept for each thing that is climbed."""
ACROSS = math.pi / 2


def heights_of_errors(case: Case) -> Heights:
    """Return true error / bound of each formulation that answers."""
    scene, (q, v, t) = case
    found: Heights = {}
    for key, pivoted in methods_of(FORMULATIONS):
        try:
            answer = eomcheck.acceleration(scene, key, q, v, t, pivoted=pivoted)
            truth = eomcheck.enclose(scene, key, q, t=t, digits=20, v=v, pivoted=pivoted)
        except EomcheckError:
            continue
        error = largest(true_error(answer.vdot, truth))
        if error > 0 and math.isfinite(answer.error_bound):
            height = error / max(answer.error_bound, UNDERFLOW)
            found[f"{key}, pivoted" if pivoted else key] = height
    return found


def heights_of_checks(case: Case) -> Heights:
    """Return the largest observed / allowed of each claim."""
    scene, state = case
    found: Heights = {}
    for one in eomcheck.check(scene, *state, engines=[]):
        if one.verdict in DECIDED and one.claim != "refusals":
            found[one.claim] = max(found.get(one.claim, 0.0), one.ratio)
        elif one.verdict == "failed":
            found[one.claim] = math.inf
    return found


# ---- Climbing ------------------------------------------------------------------------------------


def changed(case: Case, other: Case, rng: np.random.Generator) -> Case:
    """Return a case like `case`, a few of its numbers changed or taken from `other`."""
    scene, state = case
    fields = {name: getattr(scene, name) for name in FIELDS}
    q, u = state.q, speeds_of(scene, state.q, state.v)
    for _ in range(rng.integers(1, 4)):
        name = rng.choice([*FIELDS, "q", "q", "v"])
        if name == "q":
            q = _changed_entries(q, rng, other[1].q if other[1].q.size == q.size else None)
        elif name == "v":
            u = _changed_entries(u, rng, None)
        elif fields[name] is not None:
            theirs = getattr(other[0], name)
            same = theirs is not None and theirs.size == fields[name].size
            new = _changed_entries(fields[name], rng, theirs if same else None)
            fields[name] = new if name == "wheel_angle" else np.abs(new)
    made = Snake(**fields)
    return made, State(q, eomcheck.velocity(made, q, u), 0.0)


FIELDS = ("mass", "length", "inertia", "stiffness", "damping", "wheel_angle")


def _changed_entries(x: Array, rng: np.random.Generator, other: Array | None) -> Array:
    x = np.array(x, dtype=np.float64)
    if x.size == 0:
        return x
    i, j = rng.integers(x.size, size=2)
    size = 10.0 ** rng.uniform(-16, 0)
    match rng.integers(7):
        case 0:
            x[i] *= 10.0 ** rng.normal(0, 2)
        case 1:
            x[i] *= 1 + rng.normal() * size
        case 2:
            x[i] = x[j] + rng.choice([0.0, 1.0]) * rng.normal() * size
        case 3:
            x[i] = rng.choice([0.0, 1.0, ACROSS, 0.5])
        case 4:
            x[i] += rng.normal() * size
        case 5:
            x = x.copy() if other is None else np.where(rng.random(x.size) < 0.5, x, other)
        case _:
            x *= 10.0 ** rng.normal(0, 2)
    return x


@dataclass
class Search:
    """What was found so far.

    Attributes:
        heights: what is climbed, such as `heights_of_errors`.
        worst: by what is climbed, the highest cases, highest first.
        states: number looked at: drawn, and climbed to.
        finds: cases with a height above 1, with what they are about.
    """

    heights: Callable[[Case], Heights]
    worst: dict[str, list[tuple[float, int, Case]]] = field(default_factory=dict)
    states: dict[str, int] = field(default_factory=lambda: {"drawn": 0, "climbed": 0})
    finds: list[tuple[str, float, Case]] = field(default_factory=list)

    def look(self, case: Case, how: str) -> None:
        """Look at one case."""
        self.states[how] += 1
        number = sum(self.states.values())
        with np.errstate(all="ignore"):
            found = self.heights(case)
        for key, height in found.items():
            best = self.worst.setdefault(key, [])
            best.append((height, number, case))
            best.sort(key=lambda one: -one[0])
            del best[BEST:]
            if height > 1.0 and not any(key == known for known, _, _ in self.finds):
                self.finds.append((key, height, case))
                print(f"# {key}: {height:.3g}\n{python_of(*case)}", flush=True)

    def climb(self, rng: np.random.Generator) -> Case:
        """Return a case near one of the highest."""
        kept = [self.worst[key] for key in sorted(self.worst)]
        best, others = (kept[rng.integers(len(kept))] for _ in range(2))
        here = best[min(int(rng.exponential(len(best) / 3)), len(best) - 1)]
        return changed(here[2], others[rng.integers(len(others))][2], rng)


def search(
    heights: Callable[[Case], Heights], count: int, links: tuple[int, int], seed: int
) -> Search:
    """Look at `count` states, every other of them by climbing."""
    found, rng = Search(heights), np.random.default_rng(seed)
    drawn = _drawn(links, seed)
    with progress(heights.__name__.replace("_", " "), count) as advance:
        while sum(found.states.values()) < count:
            climbing = bool(found.worst) and found.states["climbed"] < found.states["drawn"]
            try:
                if climbing:
                    found.look(found.climb(rng), "climbed")
                else:
                    found.look(next(drawn), "drawn")
            except EomcheckError:
                continue  # no such scene, or no such velocity
            advance()
    return found


def _drawn(links: tuple[int, int], seed: int) -> Iterator[Case]:
    snakes, states = strategies.hostile_snakes(*links), strategies.hostile_states
    hostile: Any = strategies.scene_states(snakes, states)
    for number in itertools.count():
        yield from draw(hostile, 100, seed * 1_000_003 + number)


def main() -> int:
    """Search, print the highest of each, and return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--accuracy", type=int, default=10_000)
    parser.add_argument("--checks", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--links", default="1..5")
    options = parser.parse_args()
    low, high = map(int, options.links.split(".."))
    finds = 0
    for heights, count in (
        (heights_of_errors, options.accuracy),
        (heights_of_checks, options.checks),
    ):
        start = time.perf_counter()
        found = search(heights, count, (low, high), options.seed)
        took = time.perf_counter() - start
        of = f"seed {options.seed}, links {options.links}, {took:.0f} s"
        print(f"{heights.__name__}: {found.states}, {of}", flush=True)
        for key, best in sorted(found.worst.items()):
            height, number, _ = best[0]
            print(f"    {key}: {height:.3g} (state {number})")
        finds += len(found.finds)
    return 1 if finds else 0


if __name__ == "__main__":
    raise SystemExit(main())
