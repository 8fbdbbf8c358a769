"""Comparing errors and times of formulations: how many times larger, how often, where."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from itertools import product
from math import inf
from statistics import median
from typing import NamedTuple

from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.studies.paper.claims.claim import CLEAR, KANE, NOTHING, Evidence
from eomcheck.lab.studies.paper.measure import Found, Solver


class Ratio(NamedTuple):
    """How many times larger one value is than another, and where."""

    times: float
    where: str
    solver: Solver

    def __str__(self):
        return f"{self.times:.3g} ({self.where}, {self.solver})"


def at_level(found: Found, level: str) -> list[str]:
    """Return the formulations of a level."""
    return [key for key in found.formulations if FORMULATIONS[key].level == level]


def others(found: Found) -> list[str]:
    """Return all formulations but Kane's."""
    return [key for key in found.formulations if key != KANE]


def points_of(found: Found) -> list[tuple[int, Solver]]:
    """Return every number of links with every solver."""
    return list(product(found.links, found.solvers))


def ratios_of(
    found: Found,
    quantity: str,
    large: Iterable[str],
    small: Iterable[str],
    points: Iterable[tuple[int, Solver]] | None = None,
) -> list[Ratio]:
    """Return how many times larger the errors or times of `large` are than those of `small`."""
    ratios = []
    chosen, pairs = points_of(found) if points is None else points, product(large, small)
    for (links, solver), (one, other) in product(chosen, pairs):
        x, y = (found.value(quantity, links, key, solver) for key in (one, other))
        if x is not None and y is not None:
            times = x / y if y > 0 else (1.0 if x == 0 else inf)
            ratios.append(Ratio(times, f"{one} to {other}, N = {links}", solver))
    return ratios


def clearly_larger(what: str, ratios: list[Ratio]) -> Evidence:
    """Count the ratios above `CLEAR`; those below its inverse are worth saying too."""
    if not ratios:
        return Evidence(0, 0, NOTHING)
    above = Counter(ratio.solver for ratio in ratios if ratio.times > CLEAR)
    below = sum(ratio.times < 1 / CLEAR for ratio in ratios)
    solvers = dict.fromkeys(ratio.solver for ratio in ratios)
    each = ", ".join(f"{above[solver]} by {solver}" for solver in solvers)
    return Evidence(
        above.total(),
        len(ratios),
        f"{what}: more than {CLEAR:g} in {above.total()} of {len(ratios)} comparisons ({each}), "
        f"less than {1 / CLEAR:g} in {below}; median {median(r.times for r in ratios):.3g}, from "
        f"{min(ratios)} to {max(ratios)}.",
    )


def share(good: Iterable[bool]) -> tuple[int, int]:
    """Return how many are good, and of how many."""
    flags = list(good)
    return sum(flags), len(flags)
