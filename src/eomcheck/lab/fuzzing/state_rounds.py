"""Rounds of states, of scenes and of user-supplied functions: drawn, hill-climbed and judged.

A round of `StatePlan` is about one structural variant: its states are screened in batches, suspects
and a sample of the others judged. One of `RandomStatePlan`, for random scene classes, draws several
topologies, with a batch for each. Hill climbing stays within one structure: first among the states
of the same round, and once a round among those of the structure with the highest score in earlier
rounds. User-supplied engines are also asked at ordinary cases near those where their score was
highest.

The functions are black boxes, called once per state and derivative, so that nothing is batched;
every state is judged as by `eomcheck.testing.check_functions`. All states are within the ranges of
the functions. A campaign is a series of rounds of a `FunctionsPlan`, each of one batch of states; a
family is a way to draw them; a population is the states of highest score, by the key (claim,
subject), of which hill climbing makes mutations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from itertools import chain
from typing import Any

import numpy as np

from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.batched_claims import batchable_claims
from eomcheck.claims.finding import DECIDED, Entries, merged, never_resolved, unresolved_detail
from eomcheck.console import activity
from eomcheck.draws import state_ranges
from eomcheck.draws.fuzz_cases import (
    FAMILIES,
    MOST_CHANGES,
    ORDINARY,
    SPECIAL,
    Changed,
    FuzzCase,
    changed_entries,
    draw_cases,
    draw_cases_with,
    draw_structure_kind,
    mutated,
    special_number,
    varied,
)
from eomcheck.draws.pairwise_design import with_wide
from eomcheck.engines import ENGINES, Engine, is_under_test
from eomcheck.errors import EomcheckError
from eomcheck.formulations import FORMULATIONS
from eomcheck.lab.fuzzing.campaign import (
    CASES_PER_KEY,
    CampaignPlan,
    DrawnCases,
    Population,
    RoundResult,
    parents,
    update_population,
)
from eomcheck.lab.fuzzing.failures import (
    FUNCTIONS,
    FailureRecord,
    alike,
    functions_named,
    shrink,
    simplify_numbers,
)
from eomcheck.lab.fuzzing.screening import DECIDED as DECIDED_COUNTS
from eomcheck.lab.fuzzing.screening import OPEN as OPEN_COUNTS
from eomcheck.lab.fuzzing.screening import (
    CheckFrequency,
    Diagnosis,
    Key,
    ScreeningResult,
    check_case,
    screen,
    time_is_up,
)
from eomcheck.mechanics.records import Range, State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import caveats, check_functions_at

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


@dataclass(frozen=True)
class StatePlan(CampaignPlan):
    """The plan of a campaign that checks states of one structure a round; see `CampaignPlan`.

    Attributes:
        formulations: keys of the formulations.
        engines: keys or classes of the engines.
        check_frequency: sampling rates of expensive checks.
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
    check_frequency: CheckFrequency = field(default_factory=CheckFrequency)
    batch: int = BATCH
    wide: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the results of rounds; earlier Records have no `wide`."""
        settings = super().settings
        return settings if self.wide else {k: x for k, x in settings.items() if k != "wide"}

    def draw(self, result: RoundResult, random: np.random.Generator) -> DrawnCases:
        """Return cases of the round's variant, and the family of each."""
        with activity(f"drawing {counted(self.batch, 'state')}"):
            drawn = draw_cases(self.kind, result.variant, self.families, self.batch, random)
        return self.widened(drawn, random)

    def widened(self, drawn: DrawnCases, random: np.random.Generator) -> DrawnCases:
        """Return drawn cases, every other ordinary one in a wide state if asked."""
        cases, families = drawn
        if self.wide:
            seed = int(random.integers(2**32))
            ordinary = [i for i, family in enumerate(families) if family == ORDINARY]
            wide = with_wide((cases[i] for i in ordinary), seed)
            for i, case in zip(ordinary, wide, strict=True):
                cases[i] = case
        return cases, families

    def mutate(self, population: Population, random: np.random.Generator) -> list[FuzzCase]:
        """Return mutations of the cases of a population."""
        return hill_climbed(population, self.batch, random)

    def check(self, result: RoundResult, drawn: DrawnCases, random: np.random.Generator) -> None:
        """Screen cases and judge some; engines are asked at ordinary ones that were drawn."""
        ordinary = {i for i, family in enumerate(drawn[1]) if family == ORDINARY}
        screen_and_judge(self, result, drawn[0], ordinary)

    def climb(self, result: RoundResult, random: np.random.Generator) -> None:
        """Climb from the highest scores, in batches step by step, then for engines under test."""
        population = result.population
        under_test = {kind.key for kind in engines_under_test(self.engines)}
        steps = min(STEPS, self.batch)
        for _ in range(steps):
            if result.over():
                return
            in_lanes = {key: best for key, best in population.items() if key[1] not in under_test}
            higher = hill_climbed(in_lanes or population, self.batch // steps, random)
            result.counts["climbed"] += len(higher)
            screen_and_judge(self, result, higher, set(), -(-MOST_JUDGED // steps))
        by_engine = {key: best for key, best in population.items() if key[1] in under_test}
        if by_engine:
            climb_for_engines(self, result, by_engine, random)

    def shrunk(self, failed: Finding, known: Sequence[FailureRecord]) -> Finding:
        """Return the failure of a known case, which is small already, or `failed` simplified."""
        for failure in known[:MOST_TRIED]:
            for finding in alike(failed, failure.case, self.formulations):
                return finding
        return shrink(failed, self.formulations, self.seed)


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
        pairs.append(parents(best, population[drawn[0]], random))
    return mutated(pairs, random, clamp)[0]


def climb_for_engines(
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
        if result.over():
            break
        judged = check_case(case, claims, plan.formulations, engines_under_test(plan.engines))
        result.failed += [one for one in judged if one.verdict == "failed"]
        for key, score in engine_scores(judged).items():
            scores.setdefault(key, np.zeros(len(cases)))[i] = score
    update_population(result.population, scores, cases)


# ---- Screening and judging -----------------------------------------------------------------------


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
    with activity(f"screening {counted(len(cases), 'state')}"):
        screening = screen(cases, formulations, plan.claims, plan.check_frequency.enclosures, first)
    result.counts["states"] += len(cases)
    result.counts["enclosed"] += screening.enclosed
    result.counts["not finite"] += len(screening.non_finite)
    result.counts.update({f"{name} in lanes": x for name, x in screening.verdicts.items()})
    result.counts.update({f"{how}{claim}": x for (how, claim), x in screening.by_claim.items()})
    result.not_batched |= screening.not_batched
    result.counts["suspect"] += len(screening.suspects)

    def judge(i: int, claims: set[str], how: str) -> list[Finding]:
        engines = plan.engines if any(CLAIMS[one].asks for one in claims) else ()
        result.counts[how] += 1
        judged = check_case(cases[i], claims, plan.formulations, engines)
        result.failed += [one for one in judged if one.verdict == "failed"]
        for key, score in engine_scores(judged).items():
            screening.score(key)[i] = score
        return judged

    worst = screening.max_scores
    suspects = sorted(screening.suspects, key=lambda i: (-worst[i], i))
    most = MOST_JUDGED if most is None else most
    for rank, i in enumerate(suspects):
        scores: dict[str, float] = {}  # of a suspect that is not judged its score is not known
        if rank < most and not result.over():
            claims = screening.suspects[i] & set(plan.claims)
            for one in judge(i, claims, "suspects judged"):
                if one.verdict in DECIDED:
                    scores[one.claim] = max(scores.get(one.claim, 0.0), one.ratio)
        screening.settle(i, scores)
    for how, i, claims in sampled(plan, screening, first, ordinary):
        if result.over():
            break
        judge(i, claims, how)
    update_population(result.population, screening.scores, cases)


def sampled(
    plan: StatePlan, screening: ScreeningResult, first: int, ordinary: set[int]
) -> Iterator[tuple[str, int, set[str]]]:
    """Yield (name of the check, index of a case, claims) of the sample that is judged in full."""
    frequency, claims = plan.check_frequency, set(plan.claims)
    engines = {one for one in plan.claims if CLAIMS[one].asks}
    others = claims - set(batchable_claims(plan.claims)) - engines - BALLS - ENCLOSED
    unbatched = others | set(screening.not_batched) | (PIVOTED & claims)
    finite = set(range(screening.count)).difference(screening.non_finite)
    for how, every, among, checked in (
        ("balls", frequency.balls, finite, BALLS & claims),
        ("engines", frequency.engines if plan.engines else 0, finite & ordinary, engines),
        ("unlifted", frequency.scalar_only, finite, unbatched),
        ("full checks", frequency.checks, finite, claims - engines),
    ):
        if every and checked:
            yield from ((how, i, checked) for i in sorted(among) if (first + i) % every == 0)
    if frequency.scalar_only:
        for i in screening.non_finite[:: frequency.scalar_only]:
            yield "not finite, judged", i, {"finite-terms"}


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

    def search(self, result: RoundResult, random: np.random.Generator) -> None:
        """Search several structures, then climb in the best one of earlier rounds."""
        earlier, best = result.population, Population()
        _merge(best, earlier)
        for _ in range(STRUCTURES):
            if result.over():
                break
            result.population = {}
            super().search(result, random)
            _merge(best, result.population)
        if self.climbing and earlier and not result.over():
            result.population = _population_of_best_structure(earlier, random)
            self.climb(result, random)
            _merge(best, result.population)
        result.population = best

    def draw(self, result: RoundResult, random: np.random.Generator) -> DrawnCases:
        """Return cases of one random structure, and the family of each; none if it has no scene."""
        try:
            scene = draw_structure_kind(self.kind, result.variant, random)()
        except EomcheckError:
            result.counts["structures that do not fit together"] += 1
            return [], []
        result.counts["structures"] += 1
        make = partial(varied, scene, random=random)
        return self.widened(draw_cases_with(make, self.families, self.batch, random), random)

    def climb(self, result: RoundResult, random: np.random.Generator) -> None:
        """Check a batch of mutations, all in one step."""
        CampaignPlan.climb(self, result, random)


def _population_of_best_structure(
    population: Population, random: np.random.Generator
) -> Population:
    """Return the part of a population with the structure of the highest case of a random key."""
    keys = sorted(population)
    highest = population[keys[random.integers(len(keys))]][0]
    kind = type(highest.case[0])
    same = {key: [x for x in best if type(x.case[0]) is kind] for key, best in population.items()}
    return {key: best for key, best in same.items() if best}


def _merge(best: Population, more: Population) -> None:
    for key, cases in more.items():
        known = best.setdefault(key, [])
        known += [one for one in cases if all(one is not x for x in known)]
        known.sort(key=lambda one: -one.score)
        del known[CASES_PER_KEY:]


# ---- States of functions -------------------------------------------------------------------------


@lru_cache(8)
def state_bounds(functions: EquationsOfMotion) -> tuple[Array, Array]:
    """Return the smallest and the largest coordinates and velocities, each (n + p,)."""
    middle, half = functions.half_ranges()
    return middle - half, middle + half


def drawn_state(functions: EquationsOfMotion, family: str, random: np.random.Generator) -> State:
    """Return a state within the ranges: anywhere, or at or next to special numbers."""
    low, high = state_bounds(functions)
    x, n = random.uniform(low, high), functions.n
    if family == SPECIAL:
        q = np.array([special_number(random, x[:n]) for _ in range(n)])
        x[:n] = np.where(random.random(n) < 0.75, q, x[:n])
        if random.random() < 0.25:
            x[n:] = np.where(random.random(len(x) - n) < 0.5, 0.0, x[n:])
    return _within(functions, x)


def hill_climbed_states(
    functions: EquationsOfMotion, population: Population, count: int, random: np.random.Generator
) -> list[State]:
    """Return `count` mutations of states of a population; the key of each is drawn at random.

    Entries of a second state, the donor, replace some of its numbers.
    """
    keys, states = sorted(population), []
    low, high = state_bounds(functions)
    for _ in range(count):
        scored, donors = (population[keys[random.integers(len(keys))]] for _ in range(2))
        pair = parents(scored, donors, random)
        x, donor = (np.concatenate(state[:2]) for _, state in pair)
        for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
            new = changed_entries(x, donor, random)
            # An entry that leaves its range is clamped to it, or keeps its value.
            unchanged = ((new < low) | (new > high)) & (random.random(len(new)) < 0.5)
            x = np.where(unchanged, x, np.clip(new, low, high))
        states.append(_within(functions, x))
    return states


def _within(functions: EquationsOfMotion, x: Array) -> State:
    """Return the state of coordinates and velocities x, clamped to the ranges."""
    x = np.clip(x, *state_bounds(functions))
    return State(x[: functions.n], x[functions.n :])


# ---- Rounds of functions -------------------------------------------------------------------------

FUNCTION_BATCH = 16
"""Random states of a round; as many again are found by hill climbing."""

SKIPPED = "skipped: "
"""Prefix of counts of states at which a claim about a subject is skipped."""

PREFIX = {
    "passed": DECIDED_COUNTS,
    "failed": DECIDED_COUNTS,
    "inconclusive": OPEN_COUNTS,
    "skipped": SKIPPED,
}
"""Verdict -> prefix of its count by claim and subject."""

UNDECIDED = {"inconclusive": "inconclusive in all states", "skipped": "skipped in every state"}
"""Verdict that decides nothing -> its description."""


@dataclass(frozen=True)
class FunctionsPlan(CampaignPlan):
    """The plan of a campaign that checks user-supplied functions; see `CampaignPlan`.

    Attributes:
        name: location of the functions: path/to/file.py:NAME.
    """

    name: str
    seed: int
    claims: tuple[str, ...]
    families: tuple[str, ...] = (ORDINARY, SPECIAL)
    climbing: bool = True
    batch: int = FUNCTION_BATCH

    @property
    def kind(self) -> EquationsOfMotion:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The functions."""
        functions = functions_named(self.name)
        assert functions is not None
        return functions

    def draw(self, result: RoundResult, random: np.random.Generator) -> DrawnCases:
        """Return random states of the functions, and the family of each; families take turns."""
        families = [self.families[i % len(self.families)] for i in range(self.batch)]
        return self._cases(drawn_state(self.kind, family, random) for family in families), families

    def mutate(self, population: Population, random: np.random.Generator) -> list[FuzzCase]:
        """Return mutations of the states of a population."""
        return self._cases(hill_climbed_states(self.kind, population, self.batch, random))

    def _cases(self, states: Iterable[State]) -> list[FuzzCase]:
        functions: Any = self.kind
        return [(functions, state) for state in states]

    def check(self, result: RoundResult, drawn: DrawnCases, random: np.random.Generator) -> None:
        """Check states one by one, and count the decided states of each claim and subject."""
        by_state: list[Sequence[Finding]] = []
        for _, state in drawn[0]:
            if (by_state or result.states) and time_is_up():
                result.cut = True
                break
            by_state.append(check_functions_at(self.kind, state, self.claims))
        result.add_cases(drawn[0][: len(by_state)], by_state)
        for finding in chain.from_iterable(by_state):
            claim = f"{finding.claim} [{finding.subject}]"
            result.counts[f"{PREFIX[finding.verdict]}{claim}"] += 1
            if finding.entries is not None:
                result.entries[claim] = merged([*result.entries.get(claim, ()), finding.entries])
            if finding.verdict in UNDECIDED:
                reason = f"{UNDECIDED[finding.verdict]}: {finding.detail}"
                result.undecided.setdefault(claim, reason)

    def shrunk(self, failed: Finding, known: Sequence[FailureRecord]) -> Finding:
        """Return the failure with rounder numbers, within the ranges of the functions."""
        low, high = state_bounds(self.kind)

        def failures(candidate: Finding) -> list[Finding]:
            assert candidate.state is not None
            x = np.concatenate(candidate.state[:2])
            if not ((low <= x) & (x <= high)).all():
                return []
            return check_functions_at(self.kind, candidate.state, [failed.claim])

        return simplify_numbers(failed, failures)

    def diagnosis(self, failed: Finding) -> Diagnosis:
        """Return the functions as the part at fault."""
        return Diagnosis(FUNCTIONS, failed.evidence)

    def caveats(
        self,
        counts: Counter[str],
        undecided: Mapping[str, str],
        entries: Mapping[str, Sequence[Entries]],
    ) -> list[str]:
        """Return the caveats of the campaign, a line each, worded as by `check_functions`.

        Args:
            counts: counts of the campaign.
            undecided: claim and subject that were not decided at a state -> reason.
            entries: claim and subject -> resolved and hidden entries.
        """
        states = counts["states"]
        lines = [
            f"{claim} {reason}"
            for claim, reason in undecided.items()
            if counts[SKIPPED + claim] == states
            or (counts[OPEN_COUNTS + claim] and not counts[DECIDED_COUNTS + claim])
        ]
        for claim, entries_of_states in entries.items():
            # A subject that no state decides has its line already.
            if counts[DECIDED_COUNTS + claim] and (hidden := never_resolved(entries_of_states)):
                compared = counts[DECIDED_COUNTS + claim] + counts[OPEN_COUNTS + claim]
                lines.append(f"{claim} {unresolved_detail(hidden, compared)}")
        return [*lines, *map(str, caveats(self.kind, self.claims))]
