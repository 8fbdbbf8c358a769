"""What all campaigns have in common: work that comes in rounds, and what is climbed from."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from eomcheck.claims import Finding
from eomcheck.claims.finding import Entries
from eomcheck.lab.fuzzing.families import Case
from eomcheck.lab.fuzzing.finds import Find
from eomcheck.lab.fuzzing.screening import Key
from eomcheck.lab.fuzzing.strata import Stratum
from eomcheck.numbers.generic import Array

KEPT = 6
"""Cases kept of each claim and formulation, to climb from."""


class Work(Protocol):
    """What all rounds of a campaign have in common, whatever they look at."""

    @property
    def noun(self) -> str:
        """What is looked at, as reports count it: "state"."""
        ...

    @property
    def kind(self) -> Any:
        """The kind of scene."""
        ...

    @property
    def seed(self) -> int:
        """Seed of all draws."""
        ...

    @property
    def most(self) -> int:
        """States that a round looks at, at most."""
        ...

    @property
    def settings(self) -> dict[str, Any]:
        """What decides what rounds come to, plain."""
        ...

    def run(self, given: Round) -> Result:
        """Return what a round comes to, the same wherever it is run."""
        ...

    def find(self, failed: Finding, name: str, known: Sequence[Find] | None = None) -> Find:
        """Return a failure ready to be kept.

        Args:
            failed: the failure.
            name: of what is looked at.
            known: finds, at which it is looked for before it is made small; as it is with None.
        """
        ...


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
        open: claims and subjects of functions that were not decided at a state, and why.
        entries: of claims and subjects of functions, which entries were resolved and hidden.
        seconds: how long it took.
        cpu_seconds: CPU time of it, less where it had to share its core.
    """

    number: int
    stratum: Stratum
    population: Population
    counts: Counter[str] = field(default_factory=Counter)
    failed: list[Finding] = field(default_factory=list)
    lost: dict[str, str] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)
    entries: dict[str, list[Entries]] = field(default_factory=dict)
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def states(self) -> int:
        """Number of states looked at."""
        return self.counts["states"]


@contextmanager
def timed(result: Result) -> Iterator[Result]:
    """Note how long a round takes."""
    start, cpu = time.perf_counter(), time.process_time()
    yield result
    result.seconds = time.perf_counter() - start
    result.cpu_seconds = time.process_time() - cpu


def generator(plan: Work, given: Round) -> np.random.Generator:
    """Return what a round draws from."""
    return np.random.default_rng([abs(plan.seed), int(plan.seed < 0), given.number])


def raise_population(
    population: Population, heights_of: dict[Key, Array], cases: Sequence[Any]
) -> None:
    """Take the highest cases into a population, by their heights (L,); of a key `KEPT` are left."""
    for key, heights in heights_of.items():
        best = population.setdefault(key, [])
        for i in np.argsort(-heights, kind="stable")[:KEPT]:
            if heights[i] > 0:
                best.append(Candidate(float(heights[i]), cases[i]))
        best.sort(key=lambda one: -one.height)
        del best[KEPT:]
        if not best:
            del population[key]
