"""Campaign of rounds until the time is up, stored in a file and resumed from there.

A `CampaignPlan` draws, checks, mutates and shrinks cases, be they states, functions' states or
motions; its `run` turns a `Round` into a `RoundResult`. A `Population` holds the cases with the
highest scores (observed / allowed) of each claim and formulation, the starts of hill climbing in
the next rounds.

Rounds come in generations, one round a structural variant. A round climbs from the population of
its variant in earlier generations, so that the number and order of workers make no difference. Only
the end of a campaign depends on the time.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple, cast

import numpy as np

from eomcheck.claims import Finding
from eomcheck.claims.finding import Entries, merged
from eomcheck.claims.run import cause_of, diagnosis_of
from eomcheck.console import activity
from eomcheck.deprecated import current
from eomcheck.draws.fuzz_cases import FuzzCase, StructuralVariant
from eomcheck.errors import EomcheckError, InputError
from eomcheck.lab.fuzzing.failures import (
    FailureRecord,
    failure_record,
    fuzz_case,
    parameters_of,
)
from eomcheck.lab.fuzzing.screening import (
    Diagnosis,
    Key,
    deadline,
    diagnose_failure,
    time_is_up,
)
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted

# ---- Rounds --------------------------------------------------------------------------------------

CASES_PER_KEY = 6
"""Cases in the population of each claim and formulation, as starts of hill climbing."""


DrawnCases = tuple[list[FuzzCase], list[str]]
"""Cases, and the family of each; those found by climbing have none."""


class ScoredCase(NamedTuple):
    """A start of hill climbing and its score, observed / allowed."""

    score: float
    case: FuzzCase


Population = dict[Key, list[ScoredCase]]
"""(claim, formulation) -> the cases with the highest scores, the highest first."""


class Round(NamedTuple):
    """A round to run: its number, which with the seed determines all draws, and the starts.

    From `until` on, s by `time.time`, no further state of it is checked.
    """

    number: int
    variant: StructuralVariant
    population: Population
    until: float | None = None

    @property
    def structure(self) -> str:
        """Name of the round in messages."""
        return f"round {self.number}: {self.variant.name}"


@dataclass(kw_only=True)
class CheckTotals:
    """Sums over rounds, or of one round.

    Attributes:
        counts: number of states by family and kind of check, and of verdicts.
        not_batched: claim that could not be evaluated in batches -> reason.
        undecided: claim and subject of functions that were not decided at a state -> reason.
        entries: claim and subject of functions -> resolved and hidden entries.
        failure_counts: (claim, subject and diagnosis) -> number of findings that failed.
        seconds: elapsed time, summed over processes, s.
        cpu_seconds: CPU time, s; less where the core was shared with other programs.
    """

    counts: Counter[str] = field(default_factory=Counter)
    not_batched: dict[str, str] = field(default_factory=dict)
    undecided: dict[str, str] = field(default_factory=dict)
    entries: dict[str, list[Entries]] = field(default_factory=dict)
    failure_counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def states(self) -> int:
        """Number of states checked."""
        return self.counts["states"]

    def add(self, other: CheckTotals) -> None:
        """Add the sums of others; of two reasons the first is kept."""
        self.counts.update(other.counts)
        self.failure_counts.update(other.failure_counts)
        self.not_batched |= other.not_batched
        self.undecided = other.undecided | self.undecided
        for about, each in other.entries.items():
            self.entries[about] = merged([*self.entries.get(about, ()), *each])
        self.seconds += other.seconds
        self.cpu_seconds += other.cpu_seconds


@dataclass
class RoundResult(CheckTotals):
    """The result of a round.

    Attributes:
        number: number of the round.
        variant: its structural variant.
        population: starts of the next hill climbing.
        failed: findings that failed, by `eomcheck.check_state`.
        cut: whether the time was up before all its states were checked.
    """

    number: int
    variant: StructuralVariant
    population: Population
    failed: list[Finding] = field(default_factory=list)
    cut: bool = False

    def over(self) -> bool:
        """Return whether the time is up after the first states; the round then is cut."""
        self.cut = self.cut or (bool(self.states) and time_is_up())
        return self.cut

    def add_cases(
        self, cases: Sequence[Any], findings_by_case: Iterable[Iterable[Finding]]
    ) -> None:
        """Add cases with their findings; the highest scores of passes enter the population."""
        scores: dict[Key, Array] = {}
        self.counts["states"] += len(cases)
        for i, findings in enumerate(findings_by_case):
            for finding in findings:
                self.counts[finding.verdict] += 1
                if finding.verdict == "failed":
                    self.failed.append(finding)
                elif finding.verdict == "passed":
                    key = finding.claim, finding.subject
                    key_scores = scores.setdefault(key, np.zeros(len(cases)))
                    key_scores[i] = max(key_scores[i], finding.ratio)
        update_population(self.population, scores, cases)

    def record(self, settings: dict[str, Any]) -> Record:
        """Return the Record of the round in a campaign of these settings."""
        scores = {f"{claim} {f}".strip(): x[0].score for (claim, f), x in self.population.items()}
        failures = Counter(map(_kind_of, self.failed))
        entries = [
            [about, one.names, one.resolved.hex(), one.hidden.hex()]
            for about, each in self.entries.items()
            for one in each
        ]
        series = {
            "failures": [[*key, count] for key, count in failures.items()],
            "not batched": [[*one] for one in self.not_batched.items()],
            "undecided": [[*one] for one in self.undecided.items()],
            "entries": entries,
        }
        times: Any = {"seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        cell = settings | {"variant": self.variant.name, "round": self.number}
        return Record(STUDY, cell, **times, counts=dict(self.counts), errors=scores, series=series)

    @classmethod
    def read(cls, record: Record, variant: StructuralVariant) -> RoundResult:
        """Return the result in a Record, without its failures and its population."""
        series = {"failures": (), "not batched": (), "undecided": (), "entries": ()} | record.series
        result = cls(record.settings["round"], variant, {})
        result.counts = Counter({current(name): n for name, n in record.counts.items()})
        result.failure_counts = Counter({(claim, x): n for claim, x, n in series["failures"]})
        result.not_batched = dict(series["not batched"])
        result.undecided = dict(series["undecided"])
        for about, names, *flags in series["entries"]:
            resolved, hidden = map(bytes.fromhex, flags)
            entries = Entries(tuple(map(tuple, names)), resolved, hidden)
            result.entries.setdefault(about, []).append(entries)
        result.seconds, result.cpu_seconds = record.seconds or 0.0, record.cpu_seconds or 0.0
        return result


def update_population(
    population: Population, scores: dict[Key, Array], cases: Sequence[Any]
) -> None:
    """Add the cases with the highest scores (L,) to a population, `CASES_PER_KEY` a key at most."""
    for key, key_scores in scores.items():
        best = population.setdefault(key, [])
        for i in np.argsort(-key_scores, kind="stable")[:CASES_PER_KEY]:
            if key_scores[i] > 0:
                best.append(ScoredCase(float(key_scores[i]), cases[i]))
        best.sort(key=lambda one: -one.score)
        del best[CASES_PER_KEY:]
        if not best:
            del population[key]


def parents(
    best: list[ScoredCase], others: list[ScoredCase], random: np.random.Generator
) -> tuple[FuzzCase, FuzzCase]:
    """Return a case to mutate, often one of the highest of `best`, and a donor of numbers."""
    index = min(int(random.exponential(len(best) / 3)), len(best) - 1)
    return best[index].case, others[random.integers(len(others))].case


# ---- Plans ---------------------------------------------------------------------------------------

NAMED = "kind", "name"
"""Fields of plans that the name of the campaign stands for."""


class CampaignPlan(ABC):
    """The settings and the task that all rounds of a campaign share: what is drawn and checked.

    Subclasses are frozen dataclasses with these attributes, and perhaps more.

    Attributes:
        kind: the scene class, or the functions.
        seed: seed of all draws.
        claims: ids of the claims that take part.
        families: distributions of the cases, see `FAMILIES`.
        climbing: whether every other batch is found by hill climbing.
        batch: number of cases in a batch.
    """

    noun = "state"
    """Unit that reports count: "state" or "motion"."""

    kind: Any
    seed: int
    claims: tuple[str, ...]
    families: tuple[str, ...]
    climbing: bool
    batch: int

    @property
    def max_states(self) -> int:
        """Largest number of states that a round checks."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the results of rounds, as plain data."""
        names = [one.name for one in fields(cast(Any, self))]
        return {name: _plain(getattr(self, name)) for name in names if name not in NAMED}

    def run(self, round_: Round) -> RoundResult:
        """Return the result of a round, the same in any process."""
        population = {key: list(best) for key, best in round_.population.items()}
        result = RoundResult(round_.number, round_.variant, population)
        random = np.random.default_rng([abs(self.seed), int(self.seed < 0), round_.number])
        start, cpu = time.perf_counter(), time.process_time()
        with np.errstate(all="ignore"), deadline(round_.until), activity(round_.structure):
            self.search(result, random)
        result.seconds = time.perf_counter() - start
        result.cpu_seconds = time.process_time() - cpu
        return result

    def search(self, result: RoundResult, random: np.random.Generator) -> None:
        """Draw and check cases, then climb from those with the highest scores."""
        drawn = self.draw(result, random)
        result.counts.update(drawn[1])
        self.check(result, drawn, random)
        if self.climbing and result.population and not result.over():
            self.climb(result, random)

    def climb(self, result: RoundResult, random: np.random.Generator) -> None:
        """Check a batch of mutations of the cases with the highest scores."""
        higher = self.mutate(result.population, random)
        result.counts["climbed"] += len(higher)
        self.check(result, (higher, []), random)

    @abstractmethod
    def draw(self, result: RoundResult, random: np.random.Generator) -> DrawnCases:
        """Return up to `batch` cases of the round's variant, and the family of each."""

    @abstractmethod
    def mutate(self, population: Population, random: np.random.Generator) -> list[FuzzCase]:
        """Return up to `batch` mutations of the cases of a population."""

    @abstractmethod
    def check(self, result: RoundResult, drawn: DrawnCases, random: np.random.Generator) -> None:
        """Check cases, drawn or found by climbing, and add the findings to the result."""

    @abstractmethod
    def shrunk(self, failed: Finding, known: Sequence[FailureRecord]) -> Finding:
        """Return a failure of the same cause, simplified, or that of a known case."""

    def diagnosis(self, failed: Finding) -> Diagnosis:
        """Return the part at fault of a failure."""
        return diagnose_failure(failed)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return the record of a failed finding.

        Args:
            failed: the failure.
            name: name of the scene class or the functions.
            known: failures recorded before: if the claim fails for the same cause at one of them,
                that one is taken in place of shrinking. None: `failed` is recorded unshrunk.
        """
        small = failed
        with suppress(EomcheckError, np.linalg.LinAlgError):
            if known is not None:
                small = self.shrunk(failed, known)
        return failure_record(small, name, self.diagnosis(small))


def _plain(value: Any) -> Any:
    """Return a setting as plain data: engines, which may be classes, by name."""
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return value if isinstance(value, bool | int | str) else str(value)


# ---- The campaign --------------------------------------------------------------------------------

STUDY, POPULATION, FAILURE = "fuzz", "fuzz-population", "fuzz-find"
"""Names of the studies under which Records are stored."""

MOST_SHRUNK = 3
"""Largest number of failures of one claim, subject and diagnosis that are shrunk."""


@dataclass
class Campaign(CheckTotals):
    """A fuzzing campaign: the states checked and the failures found so far.

    Attributes:
        plan: the settings and the task that all rounds share.
        name: name by which the scene class or the functions are looked up again.
        variants: the structural variants.
        records: file in which rounds are stored, and from which the campaign is resumed.
        by_variant: number of states of each structural variant.
        worst: (claim, formulation) -> the case with the highest score.
        failure_records: cause -> the shrunk failure.
        rounds: number of rounds done.
        resumed: number of states checked in earlier runs of the campaign.
    """

    plan: CampaignPlan
    name: str
    variants: Sequence[StructuralVariant]
    records: Records | None = None
    by_variant: Counter[str] = field(default_factory=Counter)
    worst: dict[Key, ScoredCase] = field(default_factory=dict)
    failure_records: dict[tuple[str, ...], FailureRecord] = field(default_factory=dict)
    rounds: int = 0
    resumed: int = 0
    _populations: dict[StructuralVariant, Population] = field(default_factory=dict)
    _done: set[int] = field(default_factory=set)

    def __post_init__(self):
        if self.records is not None:
            self._resume(self.records)

    def run(
        self,
        states: int | None = None,
        seconds: float | None = None,
        executor: str | None = None,
        on_round: Callable[[Campaign], None] = lambda campaign: None,
    ) -> None:
        """Run rounds until the number of states is reached, or the time is up.

        Args:
            states: smallest number of states to check, those of earlier runs included.
            seconds: time limit, s; the state or batch in hand is finished. A round that is cut by
                it counts in the tables, and is done again if the campaign is resumed.
            executor: address of the workers, see `eomcheck.lab.store.parallel_map.executor`; None
                for this process.
            on_round: called after each round.

        Raises:
            InputError: in a whole generation of rounds no state could be drawn.
        """
        until = None if seconds is None else time.time() + seconds

        def late() -> bool:
            return until is not None and time.time() >= until

        def over() -> bool:
            return late() or (states is not None and self.states >= states)

        while not over():
            # With a number of states to reach, no worker starts a round that is not needed.
            left = None if states is None else -(-(states - self.states) // self.plan.max_states)
            rounds = [one._replace(until=until) for one in self._generation()[:left]]
            for result in self._results(rounds, executor, over):
                with deadline(until):
                    self._take(result, late)
                on_round(self)
                if over():
                    break
            # The next variants may yield states.
            if not self.states and (self.rounds >= len(self.variants) or over()):
                raise InputError(
                    f"scene = {self.name}: no state could be drawn in "
                    f"{counted(self.rounds, 'round')}: no "
                    "position near those drawn is closed, or no velocity there keeps the "
                    "constraints; the constraints and their Jacobian may not belong together, or "
                    "not be numbers: see eomcheck validate"
                )

    def _results(
        self, rounds: list[Round], executor: str | None, over: Callable[[], bool]
    ) -> Iterator[RoundResult]:
        work = self.plan.run
        if executor is None:
            yield from (work(one) for one in rounds if not over())
            return
        for _, result in parallel_map(executor, work, rounds):
            yield result

    def _generation(self) -> list[Round]:
        """Return the remaining rounds of the first generation that is not complete."""
        count, generation = len(self.variants), 0
        while all(generation * count + i in self._done for i in range(count)):
            generation += 1
        order = np.random.default_rng([abs(self.plan.seed), generation]).permutation(count)
        numbers = [(generation * count + i, self.variants[j]) for i, j in enumerate(order)]
        return [
            Round(number, stratum, self._populations.get(stratum, {}))
            for number, stratum in numbers
            if number not in self._done
        ]

    # ---- Results of rounds -----------------------------------------------------------------------

    def _take(self, result: RoundResult, late: Callable[[], bool]) -> None:
        self._add_round(result)
        self._set_population(result.variant, result.population)
        with activity("simplifying failures"):
            new = [x for one in result.failed if (x := self._new_failure(one, late)) is not None]
        if self.records is None:
            return
        for failure in new:
            key = self.settings | {"cause": list(failure.key)}
            self.records.add(Record(FAILURE, key, "failed", series={"failure": [vars(failure)]}))
        if result.cut:
            return  # done again where the campaign goes on
        best = [
            [*key, score, parameters_of(scene), q.tolist(), v.tolist(), float(t)]
            for key, cases in result.population.items()
            for score, (scene, (q, v, t)) in cases
        ]
        cell = self.settings | {"variant": result.variant.name}
        self.records.add(Record(POPULATION, cell, series={"best": best}))
        self.records.add(result.record(self.settings))

    def _add_round(self, result: RoundResult) -> None:
        self.add(result)
        if not result.cut:
            self._done.add(result.number)
        self.rounds += 1
        self.by_variant[result.variant.name] += result.states

    def _set_population(self, variant: StructuralVariant, population: Population) -> None:
        self._populations[variant] = population
        for key, best in population.items():
            if key not in self.worst or best[0].score > self.worst[key].score:
                self.worst[key] = best[0]

    def _new_failure(self, failed: Finding, late: Callable[[], bool]) -> FailureRecord | None:
        """Return the record of a failure, shrunk; None if one of this cause is known.

        When the time is up it is recorded unshrunk: in a wrong scene everything fails.
        """
        key = _kind_of(failed)
        self.failure_counts[key] += 1
        if self.failure_counts[key] > MOST_SHRUNK:
            return None
        failure = self.plan.record_failure(failed, self.name)
        if failure.key not in self.failure_records and not late():
            failure = self.plan.record_failure(failed, self.name, [*self.failure_records.values()])
        if failure.key in self.failure_records:
            return None
        self.failure_records[failure.key] = failure
        return failure

    # ---- In a file -------------------------------------------------------------------------------

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the campaign except for its end."""
        names = [one.name for one in self.variants]
        return {"scene": self.name, "variants": names} | self.plan.settings

    def _resume(self, records: Records) -> None:
        settings, by_name = self.settings, {one.name: one for one in self.variants}
        for record in records.all(STUDY, **settings):
            self._add_round(RoundResult.read(record, by_name[record.settings["variant"]]))
        for record in records.all(POPULATION, **settings):
            population: Population = {}
            for claim, f, score, parameters, q, v, t in record.series["best"]:
                case = fuzz_case(self.plan.kind, parameters, q, v, t)
                population.setdefault((claim, f), []).append(ScoredCase(score, case))
            self._set_population(by_name[record.settings["variant"]], population)
        for record in records.all(FAILURE, **settings):
            failure = FailureRecord(**record.series["failure"][0])
            self.failure_records[failure.key] = failure
        self.resumed = self.states


def _kind_of(failed: Finding) -> tuple[str, str]:
    """Return claim and cause of a failure, by which failures are counted: none masks another."""
    words, diagnosis = " ".join(cause_of(failed)), diagnosis_of(failed)
    return failed.claim, f"{words}: {diagnosis}" if diagnosis else words
