"""Campaign of rounds until the time is up, stored in a file and resumed from there.

`CampaignPlan` is the contract of a campaign's task, whether it checks states, functions or motions;
it turns a `Round` into a `RoundResult`. A `Population` holds the cases with the highest scores
(observed / allowed) of each claim and formulation, the starts of hill climbing in the next rounds.

Rounds come in generations, one round a structural variant. A round climbs from the population of
its variant in earlier generations, so that the number and order of workers make no difference. Only
the end of a campaign depends on the time.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from eomcheck.claims import Finding
from eomcheck.claims.finding import Entries, merged
from eomcheck.deprecated import current
from eomcheck.draws.fuzz_cases import FuzzCase, StructuralVariant
from eomcheck.errors import InputError
from eomcheck.lab.fuzzing.failures import (
    FailureRecord,
    cause_of,
    diagnosis_of,
    fuzz_case,
    parameters_of,
)
from eomcheck.lab.fuzzing.screening import Key
from eomcheck.lab.store.parallel_map import parallel_map
from eomcheck.lab.store.record_file import Record, Records
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.safe_output import counted

# ---- Tasks and rounds ----------------------------------------------------------------------------

CASES_PER_KEY = 6
"""Cases in the population of each claim and formulation, as starts of hill climbing."""


class CampaignPlan(Protocol):
    """The settings and the task that all rounds of a campaign share."""

    @property
    def noun(self) -> str:
        """Unit that reports count: "state" or "motion"."""
        ...

    @property
    def kind(self) -> Any:
        """The scene class, or the functions."""
        ...

    @property
    def seed(self) -> int:
        """Seed of all draws."""
        ...

    @property
    def max_states(self) -> int:
        """Largest number of states that a round checks."""
        ...

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the results of rounds, as plain data."""
        ...

    def run(self, round_: Round) -> RoundResult:
        """Return the result of a round, the same in any process."""
        ...

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
        ...


class ScoredCase(NamedTuple):
    """A start of hill climbing and its score, observed / allowed."""

    score: float
    case: FuzzCase


Population = dict[Key, list[ScoredCase]]
"""(claim, formulation) -> the cases with the highest scores, the highest first."""


class Round(NamedTuple):
    """A round to run: its number, which with the seed determines all draws, and the starts."""

    number: int
    variant: StructuralVariant
    population: Population

    @property
    def structure(self) -> str:
        """Name of the round in messages."""
        return f"round {self.number}: {self.variant.name}"


@dataclass
class RoundResult:
    """The result of a round.

    Attributes:
        number: number of the round.
        variant: its structural variant.
        population: starts of the next hill climbing.
        counts: number of states by family, and by kind of check; of verdicts in SIMD lanes.
        failed: findings that failed, by `eomcheck.check_state`.
        not_batched: claim that could not be evaluated in batches -> reason.
        undecided: claim and subject of functions that were not decided at a state -> reason.
        entries: claim and subject of functions -> resolved and hidden entries.
        seconds: elapsed time, s.
        cpu_seconds: CPU time, s; less where the core was shared with other programs.
    """

    number: int
    variant: StructuralVariant
    population: Population
    counts: Counter[str] = field(default_factory=Counter)
    failed: list[Finding] = field(default_factory=list)
    not_batched: dict[str, str] = field(default_factory=dict)
    undecided: dict[str, str] = field(default_factory=dict)
    entries: dict[str, list[Entries]] = field(default_factory=dict)
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def states(self) -> int:
        """Number of states checked."""
        return self.counts["states"]


@contextmanager
def record_time(result: RoundResult) -> Iterator[RoundResult]:
    """Record the elapsed and CPU time of the block in a result."""
    start, cpu = time.perf_counter(), time.process_time()
    yield result
    result.seconds = time.perf_counter() - start
    result.cpu_seconds = time.process_time() - cpu


def generator(plan: CampaignPlan, round_: Round) -> np.random.Generator:
    """Return the random generator of a round."""
    return np.random.default_rng([abs(plan.seed), int(plan.seed < 0), round_.number])


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


# ---- The campaign --------------------------------------------------------------------------------

STUDY, POPULATION, FIND = "fuzz", "fuzz-population", "fuzz-find"
"""Names of the studies under which Records are stored."""

MOST_SHRUNK = 3
"""Largest number of failures of one claim, subject and diagnosis that are shrunk."""


@dataclass
class Campaign:
    """A fuzzing campaign: the states checked and the failures found so far.

    Attributes:
        plan: the settings and the task that all rounds share.
        name: name by which the scene class or the functions are looked up again.
        variants: the structural variants.
        records: file in which rounds are stored, and from which the campaign is resumed.
        counts: number of states by family and kind of check, and of verdicts.
        by_variant: number of states of each structural variant.
        worst: (claim, formulation) -> the case with the highest score.
        failure_records: cause -> the shrunk failure.
        failure_counts: (claim, subject and diagnosis) -> number of findings that failed.
        not_batched: claim that could not be evaluated in batches -> reason.
        undecided: claim and subject of functions that were not decided at a state -> reason.
        entries: claim and subject of functions -> resolved and hidden entries.
        seconds: time spent in rounds, summed over processes, s.
        cpu_seconds: CPU time spent in rounds, s.
        rounds: number of rounds done.
        resumed: number of states checked in earlier runs of the campaign.
    """

    plan: CampaignPlan
    name: str
    variants: Sequence[StructuralVariant]
    records: Records | None = None
    counts: Counter[str] = field(default_factory=Counter)
    by_variant: Counter[str] = field(default_factory=Counter)
    worst: dict[Key, ScoredCase] = field(default_factory=dict)
    failure_records: dict[tuple[str, ...], FailureRecord] = field(default_factory=dict)
    failure_counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    not_batched: dict[str, str] = field(default_factory=dict)
    undecided: dict[str, str] = field(default_factory=dict)
    entries: dict[str, list[Entries]] = field(default_factory=dict)
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    rounds: int = 0
    resumed: int = 0
    _populations: dict[StructuralVariant, Population] = field(default_factory=dict)
    _done: set[int] = field(default_factory=set)

    def __post_init__(self):
        if self.records is not None:
            self._resume(self.records)

    @property
    def states(self) -> int:
        """Number of states checked."""
        return self.counts["states"]

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
            seconds: time limit, s; the round in hand is finished.
            executor: address of the workers, see `eomcheck.lab.store.executors.executor`; None for
                this process.
            on_round: called after each round.

        Raises:
            InputError: in a whole generation of rounds no state could be drawn.
        """
        start = time.perf_counter()

        def late() -> bool:
            return seconds is not None and time.perf_counter() - start >= seconds

        def over() -> bool:
            return late() or (states is not None and self.states >= states)

        while not over():
            # With a number of states to reach, no worker starts a round that is not needed.
            left = None if states is None else -(-(states - self.states) // self.plan.max_states)
            for result in self._results(self._generation()[:left], executor, over):
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
        self._done.add(result.number)
        self._populations[result.variant] = result.population
        self._add(result.variant.name, result.counts, result.seconds, result.cpu_seconds)
        self._raise(result.population)
        self.not_batched |= result.not_batched
        self.undecided = result.undecided | self.undecided
        self._join(result.entries)
        new = [find for one in result.failed if (find := self._found(one, late)) is not None]
        if self.records is not None:
            self._keep(self.records, result, new)

    def _add(self, stratum: str, counts: Counter[str], seconds: float, cpu: float) -> None:
        self.rounds += 1
        self.counts.update(counts)
        self.by_variant[stratum] += counts["states"]
        self.seconds += seconds
        self.cpu_seconds += cpu

    def _raise(self, population: Population) -> None:
        for key, best in population.items():
            if key not in self.worst or best[0].score > self.worst[key].score:
                self.worst[key] = best[0]

    def _join(self, entries: Mapping[str, Sequence[Entries]]) -> None:
        for about, each in entries.items():
            self.entries[about] = merged([*self.entries.get(about, ()), *each])

    def _found(self, failed: Finding, late: Callable[[], bool]) -> FailureRecord | None:
        """Return the record of a failure, shrunk; None if one of this cause is known.

        When the time is up it is recorded unshrunk: in a wrong scene everything fails.
        """
        key = _kind_of(failed)
        self.failure_counts[key] += 1
        if self.failure_counts[key] > MOST_SHRUNK:
            return None
        find = self.plan.record_failure(failed, self.name)
        if find.key not in self.failure_records and not late():
            find = self.plan.record_failure(failed, self.name, [*self.failure_records.values()])
        if find.key in self.failure_records:
            return None
        self.failure_records[find.key] = find
        return find

    # ---- In a file -------------------------------------------------------------------------------

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the campaign except for its end."""
        strata = [one.name for one in self.variants]
        return {"scene": self.name, "strata": strata} | self.plan.settings

    def _keep(self, records: Records, result: RoundResult, new: Sequence[FailureRecord]) -> None:
        settings = self.settings
        for find in new:
            key = settings | {"cause": list(find.key)}
            records.add(Record(FIND, key, "failed", series={"find": [vars(find)]}))
        best = [
            [*key, one.score, parameters_of(one.case[0]), *_plain(one.case[1])]
            for key, kept in result.population.items()
            for one in kept
        ]
        cell = settings | {"stratum": result.variant.name}
        records.add(Record(POPULATION, cell, series={"best": best}))
        scores = {f"{claim} {f}".strip(): x[0].score for (claim, f), x in result.population.items()}
        cell = cell | {"round": result.number}
        failures = Counter(map(_kind_of, result.failed))
        record = Record(
            STUDY,
            cell,
            seconds=result.seconds,
            cpu_seconds=result.cpu_seconds,
            counts=dict(result.counts),
            errors=scores,
            series={
                "failures": [[*key, count] for key, count in failures.items()],
                "lost": [[*one] for one in result.not_batched.items()],
                "open": [[*one] for one in result.undecided.items()],
                "entries": [
                    [about, one.names, one.resolved.hex(), one.hidden.hex()]
                    for about, each in result.entries.items()
                    for one in each
                ],
            },
        )
        records.add(record)

    def _resume(self, records: Records) -> None:
        settings = self.settings
        by_name = {one.name: one for one in self.variants}
        for record in records.all(STUDY, **settings):
            self._done.add(record.settings["round"])
            counts = Counter({current(name): n for name, n in record.counts.items()})
            times = record.seconds or 0.0, record.cpu_seconds or 0.0
            self._add(record.settings["stratum"], counts, *times)
            for claim, cause, count in record.series.get("failures", ()):
                self.failure_counts[claim, cause] += count
            self.not_batched |= dict(record.series.get("lost", ()))
            self.undecided = dict(record.series.get("open", ())) | self.undecided
            for about, names, *flags in record.series.get("entries", ()):
                resolved, hidden = map(bytes.fromhex, flags)
                self._join({about: [Entries(tuple(map(tuple, names)), resolved, hidden)]})
        for record in records.all(POPULATION, **settings):
            population: Population = {}
            for claim, f, score, parameters, q, v, t in record.series["best"]:
                case = fuzz_case(self.plan.kind, parameters, q, v, t)
                population.setdefault((claim, f), []).append(ScoredCase(score, case))
            self._populations[by_name[record.settings["stratum"]]] = population
            self._raise(population)
        for record in records.all(FIND, **settings):
            find = FailureRecord(**record.series["find"][0])
            self.failure_records[find.key] = find
        self.resumed = self.states


def _kind_of(failed: Finding) -> tuple[str, str]:
    """Return claim and cause of a failure, by which failures are counted: none masks another."""
    words, diagnosis = " ".join(cause_of(failed)), diagnosis_of(failed)
    return failed.claim, f"{words}: {diagnosis}" if diagnosis else words


def _plain(state: State) -> tuple[list[float], list[float], float]:
    return state.q.tolist(), state.v.tolist(), float(state.t)
