"""Rounds of states: drawn and hill-climbed, screened in batches, suspects and a sample judged.

A round of `StatePlan` is about one structural variant. One of `RandomStatePlan`, for random scene
classes, draws several topologies, with a batch for each. Hill climbing stays within one structure:
first among the states of the same round, and once a round among those of the structure with the
highest score in earlier rounds. User-supplied engines are also asked at ordinary cases near those
where their score was highest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.batched_claims import batchable_claims
from eomcheck.claims.finding import DECIDED
from eomcheck.draws.fuzz_cases import (
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
from eomcheck.draws.pairwise_design import with_wide
from eomcheck.draws.states import state_ranges
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
from eomcheck.lab.fuzzing.failures import FailureRecord, alike, failure_record, shrink
from eomcheck.lab.fuzzing.screening import TRUTH, CheckFrequency, Key, ScreeningResult, screen
from eomcheck.lab.fuzzing.triage import check_case
from eomcheck.mechanics.records import Range
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

# ---- User-supplied engines: ordinary cases only --------------------------------------------------

OVERSAMPLED = 2
"""Mutated cases per case asked: closing the loops may lead out of the ranges."""

FAR = 10.0
"""Largest coordinate, m or rad, of scenes that declare no ranges of coordinates."""


def engines_under_test(engines: Iterable[str | type[Engine]]) -> tuple[type[Engine], ...]:
    """Return the user-supplied engines, which are under test."""
    kinds = (ENGINES.get(one) if isinstance(one, str) else one for one in engines)
    return tuple(kind for kind in kinds if kind is not None and is_under_test(kind))


def engine_scores(findings: Sequence[Finding]) -> dict[tuple[str, str], float]:
    """Return (claim, key of an engine under test) -> its largest observed / allowed."""
    scores: dict[tuple[str, str], float] = {}
    for one in findings:
        if one.verdict == "passed" and one.engine is not None and is_under_test(one.engine):
            key = one.claim, one.engine.key
            scores[key] = max(scores.get(key, 0.0), one.ratio)
    return scores


def is_ordinary(case: FuzzCase) -> bool:
    """Return whether a case is within the ranges of ordinary ones.

    Next to a singular configuration, and far away, an engine may lose digits in its own way.
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
    """Return a mutated case clamped to the ranges of ordinary ones."""
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
    """Return the smallest and largest coordinates (n,) of ordinary states, and the largest |v|."""
    ranges = state_ranges(scene)
    bounds = np.array([(one.low, one.high) for one in ranges.coordinates])
    if scene.coordinate_ranges() is None:
        bounds = np.array([[-FAR, FAR]] * scene.n)  # angles are turned further than drawn
    return (bounds[:, 0], bounds[:, 1]), ranges.components.high * float(np.sqrt(scene.n))


# ---- Rounds of one structure ---------------------------------------------------------------------

BATCH = 512
"""States of a batch."""

STEPS = 4
"""Steps of hill climbing in a round; each starts from the scores of the one before, rather than in
the next round of the same variant."""

AMONG = 3
"""Number of (claim, formulation) keys drawn, of which the one with the highest score is climbed."""

MOST_TRIED = 3
"""Largest number of recorded failures at which a new one is tried before it is shrunk itself."""

MOST_JUDGED = 24
"""Largest number of suspects judged per batch, and per climb, those of the highest scores first:
many may have one cause."""

PIVOTED = {"null-space-embedding"}
"""Claims that also evaluate pivoted partitions, which differ from lane to lane."""

BALLS = {"enclosures"}
"""Claims that evaluate all formulations in ball arithmetic."""

ENCLOSED = {"true-error"}
"""Claims that screening evaluates by enclosures."""


class StatePlan(NamedTuple):
    """The plan of a campaign that checks states; see `CampaignPlan`.

    Attributes:
        kind: the scene class.
        seed: seed of all draws.
        claims: ids of the claims that take part.
        formulations: keys of the formulations.
        engines: keys or classes of the engines.
        families: distributions of the cases, see `FAMILIES`.
        climbing: whether every other batch is found by hill climbing.
        check_frequency: sampling rates of expensive checks.
        batch: number of states in a batch.
        wide: whether every other ordinary case is in a state that has joints turned by whole turns,
            or moves fast or slowly, see `eomcheck.draws.pairwise_design`: for engines that were
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
        """Unit that reports count."""
        return "state"

    @property
    def max_states(self) -> int:
        """Largest number of states that a round checks."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the results of rounds, as plain data."""
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
        """Return the result of a round."""
        return run_round(self, round_)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return the record of a failure, see `CampaignPlan`; known failures are small already."""
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
    """Return the result of a round: the same for the same plan and round, in any process."""
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
    """Return cases, some ordinary ones in wide states, and the indices of those for engines.

    Args:
        plan: plan of the campaign.
        cases: the cases drawn.
        families: family of each.
        random: source of the draws.

    Returns:
        The cases, and the indices of the ordinary ones, at which engines are asked.
    """
    ordinary = [i for i, family in enumerate(families) if family == ORDINARY]
    if plan.wide:
        seed = int(random.integers(2**32))
        for i, case in zip(ordinary, with_wide((cases[i] for i in ordinary), seed), strict=True):
            cases[i] = case
    return cases, set(ordinary)


def _climb(plan: StatePlan, result: RoundResult, random: np.random.Generator) -> None:
    """Climb from the highest scores, in batches step by step, then for engines under test."""
    population = result.population
    under_test = {kind.key for kind in engines_under_test(plan.engines)}
    steps = min(STEPS, plan.batch)
    for _ in range(steps):
        of_lanes = {key: best for key, best in population.items() if key[1] not in under_test}
        higher = hill_climbed(of_lanes or population, plan.batch // steps, random)
        result.counts["climbed"] += len(higher)
        screen_and_judge(plan, result, higher, set(), -(-MOST_JUDGED // steps))
    of_engines = {key: best for key, best in population.items() if key[1] in under_test}
    if of_engines:
        _climb_on_trial(plan, result, of_engines, random)


def hill_climbed(
    population: Population,
    count: int,
    random: np.random.Generator,
    clamp: Callable[[Changed], Changed] = lambda one: one,
) -> list[FuzzCase]:
    """Return mutations of the cases of a population: higher keys and cases are drawn more often.

    The numbers taken over come from any case of a key drawn without regard to its score.

    Args:
        population: starts.
        count: number of mutations, of which those that cannot be assembled are left out.
        random: source of the draws.
        clamp: see `mutated`.
    """
    keys = sorted(population)
    pairs = []
    for _ in range(count):
        drawn = [keys[i] for i in random.integers(len(keys), size=AMONG)]
        best = population[max(drawn, key=lambda key: population[key][0].score)]
        others = population[drawn[0]]
        index = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        pairs.append((best[index].case, others[random.integers(len(others))].case))
    return mutated(pairs, random, clamp)[0]


def _climb_on_trial(
    plan: StatePlan, result: RoundResult, population: Population, random: np.random.Generator
) -> None:
    """Ask engines under test near their highest cases, as often as they were in this round."""
    count = max(1, result.counts["engines"])
    near = hill_climbed(population, OVERSAMPLED * count, random, clamped_to_ranges)
    cases = [case for case in near if is_ordinary(case)][:count]
    scores: dict[Key, Array] = {}
    claims = [one for one in plan.claims if CLAIMS[one].asks]
    result.counts["engines, climbed"] += len(cases)
    for i, case in enumerate(cases):
        judged = check_case(case, claims, plan.formulations, engines_under_test(plan.engines))
        result.failed += [one for one in judged if one.verdict == "failed"]
        for key, score in engine_scores(judged).items():
            scores.setdefault(key, np.zeros(len(cases)))[i] = score
    update_population(result.population, scores, cases)


def screen_and_judge(
    plan: StatePlan,
    result: RoundResult,
    cases: Sequence[FuzzCase],
    ordinary: set[int],
    most: int | None = None,
) -> None:
    """Screen cases, judge suspects and a sample of the others, and update the population.

    At most `most` suspects are judged, by default `MOST_JUDGED`. Engines are asked at `ordinary`
    ones only: how many digits they lose near singular configurations is not known.
    """
    if not cases:
        return
    first = result.number * 2 * plan.batch + result.states
    formulations = tuple(FORMULATIONS[key] for key in plan.formulations)
    screening = screen(cases, formulations, plan.claims, plan.check_frequency.enclosures, first)
    result.counts["states"] += len(cases)
    result.counts["enclosed"] += screening.enclosed
    result.counts["not finite"] += len(screening.non_finite)
    result.counts.update({f"{name} in lanes": x for name, x in screening.verdicts.items()})
    result.counts.update({f"{how}{claim}": x for (how, claim), x in screening.by_claim.items()})
    result.not_batched |= screening.not_batched
    worst = screening.max_scores
    suspects = sorted(screening.suspects, key=lambda i: (-worst[i], i))
    result.counts["suspect"] += len(suspects)
    most = MOST_JUDGED if most is None else most
    for i in suspects[:most]:
        claims = screening.suspects[i] & set(plan.claims)
        _judge(plan, result, screening, cases[i], i, claims, "suspects judged")
    for i in suspects[most:]:
        _settle(screening, i, {})  # not judged: its score is not known
    _judge_sample(plan, result, screening, cases, first, ordinary)
    update_population(result.population, screening.scores, cases)


def _judge_sample(
    plan: StatePlan,
    result: RoundResult,
    screening: ScreeningResult,
    cases: Sequence[FuzzCase],
    first: int,
    ordinary: set[int],
) -> None:
    frequency, batchable = plan.check_frequency, set(batchable_claims(plan.claims))
    engines = {one for one in plan.claims if CLAIMS[one].asks}
    others = set(plan.claims) - batchable - engines - BALLS - ENCLOSED
    unbatched = others | set(screening.not_batched) | (PIVOTED & set(plan.claims))
    kinds = (
        ("balls", frequency.balls, BALLS & set(plan.claims)),
        ("engines", frequency.engines if plan.engines else 0, engines),
        ("unlifted", frequency.scalar_only, unbatched),
        ("full checks", frequency.checks, set(plan.claims) - engines),
    )
    non_finite = set(screening.non_finite)
    for name, every, claims in kinds:
        for i in range(len(cases)) if every and claims else ():
            wanted = name != "engines" or i in ordinary
            if (first + i) % every == 0 and i not in non_finite and wanted:
                _judge(plan, result, screening, cases[i], i, claims, name)
    for number, i in enumerate(screening.non_finite):
        if frequency.scalar_only and number % frequency.scalar_only == 0:
            _judge(plan, result, screening, cases[i], i, {"finite-terms"}, "not finite, judged")


def _judge(
    plan: StatePlan,
    result: RoundResult,
    screening: ScreeningResult,
    case: FuzzCase,
    i: int,
    claims: set[str],
    how: str,
) -> None:
    engines = plan.engines if any(CLAIMS[one].asks for one in claims) else ()
    result.counts[how] += 1
    judged = check_case(case, claims, plan.formulations, engines)
    result.failed += [one for one in judged if one.verdict == "failed"]
    for key, score in engine_scores(judged).items():
        screening.score(key)[i] = score
    if how == "suspects judged":
        scores: dict[str, float] = dict.fromkeys(claims, 0.0)
        for one in judged:
            if one.verdict in DECIDED:
                scores[one.claim] = max(scores[one.claim], one.ratio)
        _settle(screening, i, scores)


def _settle(screening: ScreeningResult, i: int, scores: dict[str, float]) -> None:
    """Replace the scores above 1 that screening gave a suspect by those of `check_state`."""
    for (claim, _), values in screening.scores.items():
        judged_claim = "true-error" if claim == TRUTH else claim
        if judged_claim in screening.suspects[i] and values[i] > 1.0:
            values[i] = scores.get(judged_claim, 0.0)


# ---- Rounds of random scene classes --------------------------------------------------------------

STRUCTURES = 4
"""Structures drawn in a round."""

LANES = 128
"""States of a batch: enough to outweigh the cost of a structure before its first state."""


class RandomStatePlan(StatePlan):
    """The plan of a campaign about a random scene class; see `StatePlan`.

    Its batch is the number of states of one structure that are drawn, and of those from climbing.
    """

    @property
    def max_states(self) -> int:
        """Largest number of states that a round checks."""
        return (2 * STRUCTURES + 1) * self.batch

    def run(self, round_: Round) -> RoundResult:
        """Return the result of a round."""
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
    """Return the part of a population with the structure of the highest case of a random key."""
    keys = sorted(population)
    highest = population[keys[random.integers(len(keys))]][0]
    kind = type(highest.case[0])
    of = {key: [x for x in best if type(x.case[0]) is kind] for key, best in population.items()}
    return {key: best for key, best in of.items() if best}


def _merge(best: Population, more: Population) -> None:
    for key, cases in more.items():
        known = best.setdefault(key, [])
        known += [one for one in cases if all(one is not x for x in known)]
        known.sort(key=lambda one: -one.score)
        del known[CASES_PER_KEY:]
