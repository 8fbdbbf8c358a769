"""One round: states of one structure, drawn and climbed to, screened, and some judged."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.lanes import liftable
from eomcheck.engines import Engine
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.draws import FAMILIES, ORDINARY, Case, Stratum, drawn
from eomcheck.lab.fuzzing.judging import checked
from eomcheck.lab.fuzzing.mutation import mutated
from eomcheck.lab.fuzzing.screening import TRUTH, Key, Ration, Screened, screened
from eomcheck.mechanics.scene import Scene

KEPT = 6
"""Cases kept of each claim and formulation, to climb from."""

BATCH = 512
"""States side by side."""

STEPS = 4
"""Steps of a climb in a round, each from what the one before has reached: what was found high is
climbed on from at once, and not when its structure comes again."""

AMONG = 3
"""Claims and formulations, drawn at random, of which the highest is climbed from."""

MOST_JUDGED = 24
"""Suspects of a batch that are judged, the highest first, and so many of a climb: of one cause
there may be many."""

PIVOTED = {"null-space-embedding"}
"""Claims that look at pivoted partitions too, which differ from lane to lane."""

BALLS = {"enclosures"}
"""Claims that look at all formulations in balls."""

ENCLOSED = {"true-error"}
"""Claims that lanes look at by enclosures."""


class Plan(NamedTuple):
    """What all rounds of a campaign have in common.

    Attributes:
        kind: the kind of scene.
        seed: of all draws.
        claims: ids of the claims that take part.
        formulations: keys of the formulations.
        engines: keys or classes of the engines.
        families: what is drawn from.
        climbing: whether every other batch is climbed to.
        ration: how often what takes long is looked at.
        batch: states side by side.
    """

    kind: type[Scene]
    seed: int
    claims: tuple[str, ...]
    formulations: tuple[str, ...]
    engines: tuple[str | type[Engine], ...] = ()
    families: tuple[str, ...] = FAMILIES
    climbing: bool = True
    ration: Ration = Ration()
    batch: int = BATCH


class Candidate(NamedTuple):
    """A case to climb from, and how high it is."""

    height: float
    case: Case


Population = dict[Key, list[Candidate]]
"""By claim and formulation, the highest cases, highest first."""


class Round(NamedTuple):
    """What is to be done: a number, which with the seed decides all draws, and where to start."""

    number: int
    stratum: Stratum
    population: Population

    @property
    def structure(self) -> str:
        """What messages call it."""
        return f"round {self.number}: {self.stratum.name}"


@dataclass
class Result:
    """What a round came to.

    Attributes:
        number: of the round.
        stratum: its structure.
        population: where to climb from next.
        counts: states by family, and by how they were looked at; verdicts in lanes.
        failed: findings that failed, by `eomcheck.check`.
        lost: claims that lanes could not look at, and why.
        seconds: how long it took.
        cpu_seconds: CPU time of it, less where it had to share its core.
    """

    number: int
    stratum: Stratum
    population: Population
    counts: Counter[str] = field(default_factory=Counter)
    failed: list[Finding] = field(default_factory=list)
    lost: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def states(self) -> int:
        """Number of states looked at."""
        return self.counts["states"]


def run_round(plan: Plan, given: Round) -> Result:
    """Return what a round comes to: the same for the same plan and round, wherever it is run."""
    start, cpu = time.perf_counter(), time.process_time()
    random = np.random.default_rng([abs(plan.seed), int(plan.seed < 0), given.number])
    population = {key: list(best) for key, best in given.population.items()}
    result = Result(given.number, given.stratum, population)
    with np.errstate(all="ignore"):
        cases, families = drawn(plan.kind, given.stratum, plan.families, plan.batch, random)
        result.counts.update(families)
        ordinary = {i for i, family in enumerate(families) if family == ORDINARY}
        _look(plan, result, cases, ordinary, MOST_JUDGED)
        steps = min(STEPS, plan.batch) if plan.climbing else 0
        for _ in range(steps if population else 0):
            climbed = _climbed(population, plan.batch // steps, random)
            result.counts["climbed"] += len(climbed)
            _look(plan, result, climbed, set(), -(-MOST_JUDGED // steps))
    result.seconds = time.perf_counter() - start
    result.cpu_seconds = time.process_time() - cpu
    return result


def _climbed(population: Population, count: int, random: np.random.Generator) -> list[Case]:
    """Return cases near the highest: a claim and formulation, higher ones more often, and a case.

    What others are good at is taken over from any of them.
    """
    keys = sorted(population)
    pairs = []
    for _ in range(count):
        drawn = [keys[i] for i in random.integers(len(keys), size=AMONG)]
        best = population[max(drawn, key=lambda key: population[key][0].height)]
        others = population[drawn[0]]
        place = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        pairs.append((best[place].case, others[random.integers(len(others))].case))
    return mutated(pairs, random)[0]


def _look(plan: Plan, result: Result, cases: Sequence[Case], ordinary: set[int], most: int) -> None:
    """Screen cases, judge what is suspect and what the ration says, and keep the highest.

    Of suspects so many are judged at `most`. Engines are asked at `ordinary` ones only: what they
    lose near singular states is not known.
    """
    if not cases:
        return
    first = result.number * 2 * plan.batch + result.states
    formulations = tuple(FORMULATIONS[key] for key in plan.formulations)
    found = screened(cases, formulations, plan.claims, plan.ration.enclosures, first)
    result.counts["states"] += len(cases)
    result.counts["enclosed"] += found.enclosed
    result.counts["not finite"] += len(found.unseen)
    result.counts.update({f"{name} in lanes": x for name, x in found.verdicts.items()})
    result.lost |= found.lost
    worst = found.worst
    suspects = sorted(found.suspects, key=lambda i: (-worst[i], i))
    result.counts["suspect"] += len(suspects)
    for i in suspects[:most]:
        claims = found.suspects[i] & set(plan.claims)
        _judge(plan, result, found, cases[i], i, claims, "suspects judged")
    for i in suspects[most:]:
        _settle(found, i, {})  # nobody knows how high it is
    _ration(plan, result, found, cases, first, ordinary)
    _keep(result.population, found, cases)


def _ration(
    plan: Plan,
    result: Result,
    found: Screened,
    cases: Sequence[Case],
    first: int,
    ordinary: set[int],
) -> None:
    ration, lifted = plan.ration, set(liftable(plan.claims))
    engines = {one for one in plan.claims if CLAIMS[one].asks}
    others = set(plan.claims) - lifted - engines - BALLS - ENCLOSED
    lost = others | set(found.lost) | (PIVOTED & set(plan.claims))
    kinds = (
        ("balls", ration.balls, BALLS & set(plan.claims)),
        ("engines", ration.engines if plan.engines else 0, engines),
        ("unlifted", ration.unlifted, lost),
        ("full checks", ration.checks, set(plan.claims) - engines),
    )
    unseen = set(found.unseen)
    for name, every, claims in kinds:
        for i in range(len(cases)) if every and claims else ():
            asked = name != "engines" or i in ordinary
            if (first + i) % every == 0 and i not in unseen and asked:
                _judge(plan, result, found, cases[i], i, claims, name)
    for number, i in enumerate(found.unseen):
        if ration.unlifted and number % ration.unlifted == 0:
            _judge(plan, result, found, cases[i], i, {"finite-terms"}, "not finite, judged")


def _judge(
    plan: Plan, result: Result, found: Screened, case: Case, i: int, claims: set[str], how: str
) -> None:
    engines = plan.engines if any(CLAIMS[one].asks for one in claims) else ()
    result.counts[how] += 1
    judged = checked(case, claims, plan.formulations, engines)
    result.failed += [one for one in judged if one.verdict == "failed"]
    if how == "suspects judged":
        heights: dict[str, float] = dict.fromkeys(claims, 0.0)
        for one in judged:
            if one.verdict in ("passed", "failed"):
                heights[one.claim] = max(heights[one.claim], one.ratio)
        _settle(found, i, heights)


def _settle(found: Screened, i: int, heights: dict[str, float]) -> None:
    """Replace what lanes said of a suspect by what it was judged to be."""
    for (claim, _), all_heights in found.heights.items():
        said = "true-error" if claim == TRUTH else claim
        if said in found.suspects[i] and all_heights[i] > 1.0:
            all_heights[i] = heights.get(said, 0.0)


def _keep(population: Population, found: Screened, cases: Sequence[Case]) -> None:
    for key, heights in found.heights.items():
        best = population.setdefault(key, [])
        for i in np.argsort(-heights, kind="stable")[:KEPT]:
            if heights[i] > 0:
                best.append(Candidate(float(heights[i]), cases[i]))
        best.sort(key=lambda one: -one.height)
        del best[KEPT:]
        if not best:
            del population[key]
