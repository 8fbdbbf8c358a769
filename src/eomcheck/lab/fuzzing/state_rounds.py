"""Rounds of states: drawn and hill-climbed, screened in batches, suspects and a sample judged.

A round of `StatePlan` is about one structure. One of `RandomStatePlan`, for random scene classes,
draws
several, with a batch for each, and climbs within one structure: first among the states of the same
round, and once a round among those of the structure with the highest score in earlier ones.
User-supplied engines are also asked at ordinary cases near those where their score was highest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.batched_claims import batchable_claims
from eomcheck.claims.pairwise_design import with_wide
from eomcheck.engines import ENGINES, Engine, is_under_test
from eomcheck.errors import EomcheckError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import (
    CASES_PER_KEY,
    Population,
    Round,
    RoundResult,
    generator,
    record_time,
    update_population,
)
from eomcheck.lab.fuzzing.cases import (
    FAMILIES,
    ORDINARY,
    Changed,
    FuzzCase,
    draw_cases,
    draw_cases_with,
    draw_structure_kind,
    mutated,
    varied,
)
from eomcheck.lab.fuzzing.failures import FailureRecord, alike, failure_record, shrink
from eomcheck.lab.fuzzing.screening import TRUTH, CheckFrequency, Key, ScreeningResult, screen
from eomcheck.lab.fuzzing.triage import check_case
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.strategies.state_strategies import state_ranges

# ---- User-supplied engines: ordinary cases only --------------------------------------------------

OVERSAMPLED = 2
"""Cases that are changed for one that is asked: closing may lead out of the ranges."""

FAR = 10.0
"""Coordinates at most, m or rad, of scenes that say nothing of theirs."""


def engines_under_test(engines: Iterable[str | type[Engine]]) -> tuple[type[Engine], ...]:
    """Return those engines that are somebody's own."""
    kinds = (ENGINES.get(one) if isinstance(one, str) else one for one in engines)
    return tuple(kind for kind in kinds if kind is not None and is_under_test(kind))


def engine_scores(findings: Sequence[Finding]) -> dict[tuple[str, str], float]:
    """Return the largest observed / allowed of engines on trial, by claim and key of the engine."""
    found: dict[tuple[str, str], float] = {}
    for one in findings:
        if one.verdict == "passed" and one.engine is not None and is_under_test(one.engine):
            key = one.claim, one.engine.key
            found[key] = max(found.get(key, 0.0), one.ratio)
    return found


def is_ordinary(case: FuzzCase) -> bool:
    """Return whether a case is within what ordinary ones are drawn from.

    Next to a singular state, and far away, an engine may lose digits in its own way.
    """
    scene, (q, v, t) = case
    for name, one in _ranges(scene).items():
        x = getattr(scene, name)
        if x is not None and not ((one.low <= np.asarray(x)) & (np.asarray(x) <= one.high)).all():
            return False
    (low, high), fastest = _limits(scene)
    near = bool(((low <= q) & (q <= high)).all())
    times = state_ranges(scene).time
    return near and float(np.linalg.norm(v)) <= fastest and times.low <= t <= times.high


def clamped_to_ranges(changed: Changed) -> Changed:
    """Return an ordinary case in place of one that left the ranges: at their ends."""
    scene, q, v = changed
    values = {}
    for name, one in _ranges(scene).items():
        x = getattr(scene, name)
        values[name] = None if x is None else np.clip(x, one.low, one.high)
    (low, high), fastest = _limits(scene)
    speed = float(np.linalg.norm(v))
    slower = v if speed <= fastest / 2 else v * (fastest / 2 / speed)
    return type(scene)(**values), np.clip(q, low, high), slower


def _ranges(scene: Scene) -> dict[str, Range]:
    return type(scene).ranges(getattr(scene, "links", None) if scene.has_links else None)


def _limits(scene: Scene) -> tuple[tuple[Array, Array], float]:
    """Return the smallest and largest coordinates (n,) of ordinary states, and |v| at most."""
    found = state_ranges(scene)
    bounds = np.array([(one.low, one.high) for one in found.coordinates])
    if scene.coordinate_ranges() is None:
        bounds = np.array([[-FAR, FAR]] * scene.n)  # angles are turned further than drawn
    return (bounds[:, 0], bounds[:, 1]), found.components.high * float(np.sqrt(scene.n))


# ---- Rounds of one structure ---------------------------------------------------------------------

BATCH = 512
"""States side by side."""

STEPS = 4
"""Steps of a climb in a round, each from what the one before has reached: what was found high is
climbed on from at once, and not when its structure comes again."""

AMONG = 3
"""Claims and formulations, drawn at random, of which the highest is climbed from."""

MOST_TRIED = 3
"""Finds at which a failure of something else is looked for, before it is made small itself."""

MOST_JUDGED = 24
"""Suspects of a batch that are judged, the highest first, and so many of a climb: of one cause
there may be many."""

PIVOTED = {"null-space-embedding"}
"""Claims that look at pivoted partitions too, which differ from lane to lane."""

BALLS = {"enclosures"}
"""Claims that look at all formulations in balls."""

ENCLOSED = {"true-error"}
"""Claims that lanes look at by enclosures."""


class StatePlan(NamedTuple):
    """What all rounds of a campaign about states have in common; see `Work`.

    Attributes:
        kind: the kind of scene.
        seed: of all draws.
        claims: ids of the claims that take part.
        formulations: keys of the formulations.
        engines: keys or classes of the engines.
        families: what is drawn from.
        climbing: whether every other batch is climbed to.
        check_frequency: how often what takes long is looked at.
        batch: states side by side.
        wide: whether every other ordinary case is in a state that has joints turned by whole turns,
            or moves fast or slowly, see `eomcheck.claims.pairwise_design`: for engines that were
            named.
    """

    kind: type[Scene]
    seed: int
    claims: tuple[str, ...]
    formulations: tuple[str, ...]
    engines: tuple[str | type[Engine], ...] = ()
    families: tuple[str, ...] = FAMILIES
    climbing: bool = True
    check_frequency: CheckFrequency = CheckFrequency()
    batch: int = BATCH
    wide: bool = False

    @property
    def noun(self) -> str:
        """What reports count."""
        return "state"

    @property
    def max_states(self) -> int:
        """States that a round looks at, at most."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """What decides what rounds come to, plain."""
        return {
            "seed": self.seed,
            "claims": list(self.claims),
            "formulations": list(self.formulations),
            "engines": [str(one) for one in self.engines],
            "families": list(self.families),
            "climbing": self.climbing,
            "ration": list(self.check_frequency),
            "batch": self.batch,
            **({"wide": True} if self.wide else {}),
        }

    def run(self, round_: Round) -> RoundResult:
        """Return what a round comes to."""
        return run_round(self, round_)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return a failure ready to be kept, see `Work`: a known find is small already."""
        small = failed
        with suppress(EomcheckError, np.linalg.LinAlgError):
            if known is not None:
                small = self._small(failed, known[:MOST_TRIED])
        return failure_record(small, name)

    def _small(self, failed: Finding, known: Sequence[FailureRecord]) -> Finding:
        for find in known:
            for one in alike(failed, find.case, self.formulations):
                return one
        return shrink(failed, self.formulations, self.seed)


def run_round(plan: StatePlan, round_: Round) -> RoundResult:
    """Return what a round comes to: the same for the same plan and round, wherever it is run."""
    random = generator(plan, round_)
    population = {key: list(best) for key, best in round_.population.items()}
    result = RoundResult(round_.number, round_.variant, population)
    with record_time(result), np.errstate(all="ignore"):
        cases, families = draw_cases(plan.kind, round_.variant, plan.families, plan.batch, random)
        result.counts.update(families)
        screen_and_judge(plan, result, *for_engines(plan, cases, families, random))
        if plan.climbing and population:
            _climb(plan, result, random)
    return result


def for_engines(
    plan: StatePlan, cases: list[FuzzCase], families: Sequence[str], random: np.random.Generator
) -> tuple[list[FuzzCase], set[int]]:
    """Return cases, some ordinary ones in wide states, and at which of them engines are asked.

    Args:
        plan: of the campaign.
        cases: as they were drawn.
        families: of each.
        random: source of the draws.
    """
    ordinary = [i for i, family in enumerate(families) if family == ORDINARY]
    if plan.wide:
        seed = int(random.integers(2**32))
        for i, case in zip(ordinary, with_wide((cases[i] for i in ordinary), seed), strict=True):
            cases[i] = case
    return cases, set(ordinary)


def _climb(plan: StatePlan, result: RoundResult, random: np.random.Generator) -> None:
    """Look near the highest, in lanes step by step, then at engines on trial."""
    population = result.population
    tried = {kind.key for kind in engines_under_test(plan.engines)}
    steps = min(STEPS, plan.batch)
    for _ in range(steps):
        of_lanes = {key: best for key, best in population.items() if key[1] not in tried}
        higher = hill_climbed(of_lanes or population, plan.batch // steps, random)
        result.counts["climbed"] += len(higher)
        screen_and_judge(plan, result, higher, set(), -(-MOST_JUDGED // steps))
    of_engines = {key: best for key, best in population.items() if key[1] in tried}
    if of_engines:
        _climb_on_trial(plan, result, of_engines, random)


def hill_climbed(
    population: Population,
    count: int,
    random: np.random.Generator,
    clamp: Callable[[Changed], Changed] = lambda one: one,
) -> list[FuzzCase]:
    """Return cases near the highest: a claim and formulation, higher ones more often, and a case.

    What others are good at is taken over from any of them.
    """
    keys = sorted(population)
    pairs = []
    for _ in range(count):
        drawn = [keys[i] for i in random.integers(len(keys), size=AMONG)]
        best = population[max(drawn, key=lambda key: population[key][0].score)]
        others = population[drawn[0]]
        place = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        pairs.append((best[place].case, others[random.integers(len(others))].case))
    return mutated(pairs, random, clamp)[0]


def _climb_on_trial(
    plan: StatePlan, result: RoundResult, population: Population, random: np.random.Generator
) -> None:
    """Ask engines on trial near their highest cases, as often as they were asked in this round."""
    count = max(1, result.counts["engines"])
    near = hill_climbed(population, OVERSAMPLED * count, random, clamped_to_ranges)
    cases = [case for case in near if is_ordinary(case)][:count]
    heights: dict[Key, Array] = {}
    claims = [one for one in plan.claims if CLAIMS[one].asks]
    result.counts["engines, climbed"] += len(cases)
    for i, case in enumerate(cases):
        judged = check_case(case, claims, plan.formulations, engines_under_test(plan.engines))
        result.failed += [one for one in judged if one.verdict == "failed"]
        for key, height in engine_scores(judged).items():
            heights.setdefault(key, np.zeros(len(cases)))[i] = height
    update_population(result.population, heights, cases)


def screen_and_judge(
    plan: StatePlan,
    result: RoundResult,
    cases: Sequence[FuzzCase],
    ordinary: set[int],
    most: int | None = None,
) -> None:
    """Screen cases, judge what is suspect and what the ration says, and keep the highest.

    Of suspects `most` are judged, by default `MOST_JUDGED`. Engines are asked at `ordinary` ones
    only: what they lose near singular states is not known.
    """
    if not cases:
        return
    first = result.number * 2 * plan.batch + result.states
    formulations = tuple(FORMULATIONS[key] for key in plan.formulations)
    found = screen(cases, formulations, plan.claims, plan.check_frequency.enclosures, first)
    result.counts["states"] += len(cases)
    result.counts["enclosed"] += found.enclosed
    result.counts["not finite"] += len(found.non_finite)
    result.counts.update({f"{name} in lanes": x for name, x in found.verdicts.items()})
    result.counts.update({f"{how}{claim}": x for (how, claim), x in found.by_claim.items()})
    result.not_batched |= found.not_batched
    worst = found.max_scores
    suspects = sorted(found.suspects, key=lambda i: (-worst[i], i))
    result.counts["suspect"] += len(suspects)
    most = MOST_JUDGED if most is None else most
    for i in suspects[:most]:
        claims = found.suspects[i] & set(plan.claims)
        _judge(plan, result, found, cases[i], i, claims, "suspects judged")
    for i in suspects[most:]:
        _settle(found, i, {})  # nobody knows how high it is
    _judge_sample(plan, result, found, cases, first, ordinary)
    update_population(result.population, found.scores, cases)


def _judge_sample(
    plan: StatePlan,
    result: RoundResult,
    found: ScreeningResult,
    cases: Sequence[FuzzCase],
    first: int,
    ordinary: set[int],
) -> None:
    ration, lifted = plan.check_frequency, set(batchable_claims(plan.claims))
    engines = {one for one in plan.claims if CLAIMS[one].asks}
    others = set(plan.claims) - lifted - engines - BALLS - ENCLOSED
    lost = others | set(found.not_batched) | (PIVOTED & set(plan.claims))
    kinds = (
        ("balls", ration.balls, BALLS & set(plan.claims)),
        ("engines", ration.engines if plan.engines else 0, engines),
        ("unlifted", ration.scalar_only, lost),
        ("full checks", ration.checks, set(plan.claims) - engines),
    )
    unseen = set(found.non_finite)
    for name, every, claims in kinds:
        for i in range(len(cases)) if every and claims else ():
            asked = name != "engines" or i in ordinary
            if (first + i) % every == 0 and i not in unseen and asked:
                _judge(plan, result, found, cases[i], i, claims, name)
    for number, i in enumerate(found.non_finite):
        if ration.scalar_only and number % ration.scalar_only == 0:
            _judge(plan, result, found, cases[i], i, {"finite-terms"}, "not finite, judged")


def _judge(
    plan: StatePlan,
    result: RoundResult,
    found: ScreeningResult,
    case: FuzzCase,
    i: int,
    claims: set[str],
    how: str,
) -> None:
    engines = plan.engines if any(CLAIMS[one].asks for one in claims) else ()
    result.counts[how] += 1
    judged = check_case(case, claims, plan.formulations, engines)
    result.failed += [one for one in judged if one.verdict == "failed"]
    for key, height in engine_scores(judged).items():
        found.score(key)[i] = height
    if how == "suspects judged":
        heights: dict[str, float] = dict.fromkeys(claims, 0.0)
        for one in judged:
            if one.verdict in ("passed", "failed"):
                heights[one.claim] = max(heights[one.claim], one.ratio)
        _settle(found, i, heights)


def _settle(found: ScreeningResult, i: int, heights: dict[str, float]) -> None:
    """Replace what lanes said of a suspect by what it was judged to be."""
    for (claim, _), all_heights in found.scores.items():
        said = "true-error" if claim == TRUTH else claim
        if said in found.suspects[i] and all_heights[i] > 1.0:
            all_heights[i] = heights.get(said, 0.0)


# ---- Rounds of random scene classes --------------------------------------------------------------

STRUCTURES = 4
"""Structures of a round."""

LANES = 128
"""States side by side: as many as pay for what one structure costs before its first state."""


class RandomStatePlan(StatePlan):
    """What all rounds of a campaign about a random kind have in common; see `StatePlan`.

    Its batch is the number of states of one structure that are drawn, and that are climbed to.
    """

    @property
    def max_states(self) -> int:
        """States that a round looks at, at most."""
        return (2 * STRUCTURES + 1) * self.batch

    def run(self, round_: Round) -> RoundResult:
        """Return what a round comes to."""
        random = generator(self, round_)
        result = RoundResult(round_.number, round_.variant, {})
        best = {key: list(one) for key, one in round_.population.items()}
        with record_time(result), np.errstate(all="ignore"):
            for _ in range(STRUCTURES):
                _look_at_one(self, result, random)
                _merge(best, result.population)
            if self.climbing and round_.population:
                result.population = _population_of_best_structure(round_.population, random)
                _climb_in_structure(self, result, random)
                _merge(best, result.population)
        result.population = best
        return result


def _look_at_one(plan: StatePlan, result: RoundResult, random: np.random.Generator) -> None:
    result.population = {}
    try:
        one = draw_structure_kind(plan.kind, result.variant, random)
        scene = one()
    except EomcheckError:
        result.counts["structures that do not fit together"] += 1
        return
    result.counts["structures"] += 1
    cases, families = draw_cases_with(
        lambda family: varied(scene, family, random), plan.families, plan.batch, random
    )
    result.counts.update(families)
    screen_and_judge(plan, result, *for_engines(plan, cases, families, random))
    if plan.climbing and result.population:
        _climb_in_structure(plan, result, random)


def _climb_in_structure(plan: StatePlan, result: RoundResult, random: np.random.Generator) -> None:
    higher: list[FuzzCase] = hill_climbed(result.population, plan.batch, random)
    result.counts["climbed"] += len(higher)
    screen_and_judge(plan, result, higher, set())


def _population_of_best_structure(
    population: Population, random: np.random.Generator
) -> Population:
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
        known.sort(key=lambda one: -one.score)
        del known[CASES_PER_KEY:]
