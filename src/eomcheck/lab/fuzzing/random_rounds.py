"""Rounds about random kinds of scenes: some structures each, and lanes for every one of them.

What is climbed from is of one structure: first among the states of the same round; and once a round
among those of the structure that came highest in earlier ones.
"""

from __future__ import annotations

import numpy as np

from eomcheck.errors import EomcheckError
from eomcheck.lab.fuzzing.draws import drawn_of
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.rounds import Plan, climbed, for_engines, look_at
from eomcheck.lab.fuzzing.structures import structure_drawn, varied
from eomcheck.lab.fuzzing.work import KEPT, Population, Result, Round, generator, timed

STRUCTURES = 4
"""Structures of a round."""

LANES = 128
"""States side by side: as many as pay for what one structure costs before its first state."""


class RandomPlan(Plan):
    """What all rounds of a campaign about a random kind have in common; see `Plan`.

    Its batch is the number of states of one structure that are drawn, and that are climbed to.
    """

    @property
    def most(self) -> int:
        """States that a round looks at, at most."""
        return (2 * STRUCTURES + 1) * self.batch

    def run(self, given: Round) -> Result:
        """Return what a round comes to."""
        random = generator(self, given)
        result = Result(given.number, given.stratum, {})
        best = {key: list(one) for key, one in given.population.items()}
        with timed(result), np.errstate(all="ignore"):
            for _ in range(STRUCTURES):
                _look_at_one(self, result, random)
                _merge(best, result.population)
            if self.climbing and given.population:
                result.population = _of_the_highest(given.population, random)
                _climb(self, result, random)
                _merge(best, result.population)
        result.population = best
        return result


def _look_at_one(plan: Plan, result: Result, random: np.random.Generator) -> None:
    result.population = {}
    try:
        one = structure_drawn(plan.kind, result.stratum, random)
        scene = one()
    except EomcheckError:
        result.counts["structures that do not fit together"] += 1
        return
    result.counts["structures"] += 1
    cases, families = drawn_of(
        lambda family: varied(scene, family, random), plan.families, plan.batch, random
    )
    result.counts.update(families)
    look_at(plan, result, *for_engines(plan, cases, families, random))
    if plan.climbing and result.population:
        _climb(plan, result, random)


def _climb(plan: Plan, result: Result, random: np.random.Generator) -> None:
    higher: list[Case] = climbed(result.population, plan.batch, random)
    result.counts["climbed"] += len(higher)
    look_at(plan, result, higher, set())


def _of_the_highest(population: Population, random: np.random.Generator) -> Population:
    """Return those of a population that are of one structure: that of the highest of some claim."""
    keys = sorted(population)
    highest = population[keys[random.integers(len(keys))]][0]
    kind = type(highest.case[0])
    of = {key: [x for x in best if type(x.case[0]) is kind] for key, best in population.items()}
    return {key: best for key, best in of.items() if best}


def _merge(best: Population, more: Population) -> None:
    for key, found in more.items():
        known = best.setdefault(key, [])
        known += [one for one in found if all(one is not x for x in known)]
        known.sort(key=lambda one: -one.height)
        del known[KEPT:]
