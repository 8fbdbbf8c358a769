"""Rounds of user-supplied functions: states drawn and hill-climbed, one after the other.

The functions are black boxes, called once per state and derivative, so that nothing is batched;
every state is judged as by `eomcheck.testing.check_functions`. All states are within the ranges of
the functions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import Finding
from eomcheck.claims.finding import Entries, merged, never_resolved, unresolved_detail
from eomcheck.draws.fuzz_cases import (
    MOST_CHANGES,
    ORDINARY,
    SPECIAL,
    FuzzCase,
    changed_entries,
    special_number,
)
from eomcheck.lab.fuzzing.campaign import (
    Population,
    Round,
    RoundResult,
    generator,
    record_time,
    update_population,
)
from eomcheck.lab.fuzzing.failures import (
    FUNCTIONS,
    FailureRecord,
    failure_record,
    functions_named,
    simplify_numbers,
)
from eomcheck.lab.fuzzing.screening import DECIDED, OPEN
from eomcheck.lab.fuzzing.triage import Diagnosis
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import caveats, check_functions_at

# ---- States --------------------------------------------------------------------------------------


@lru_cache(8)
def limits(functions: EquationsOfMotion) -> tuple[Array, Array]:
    """Return the smallest and the largest coordinates and velocities (n + p,)."""
    middle, half = functions.half_ranges()
    return middle - half, middle + half


def drawn_state(functions: EquationsOfMotion, family: str, random: np.random.Generator) -> State:
    """Return a state within the ranges: anywhere, or at or next to special numbers."""
    low, high = limits(functions)
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
    """Return mutations of the states of a population, each of a key drawn at random."""
    keys, states = sorted(population), []
    for _ in range(count):
        best, others = (population[keys[random.integers(len(keys))]] for _ in range(2))
        index = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        state, donor = (
            np.concatenate(one.case[1][:2])
            for one in (best[index], others[random.integers(len(others))])
        )
        low, high = limits(functions)
        for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
            new = changed_entries(state, donor, random)
            # An entry that leaves its range is clamped to it, or keeps its value.
            left = ((new < low) | (new > high)) & (random.random(len(new)) < 0.5)
            state = np.where(left, state, np.clip(new, low, high))
        states.append(_within(functions, state))
    return states


def _within(functions: EquationsOfMotion, x: Array) -> State:
    x = np.clip(x, *limits(functions))
    return State(x[: functions.n], x[functions.n :])


# ---- Rounds --------------------------------------------------------------------------------------

STATES = 16
"""Random states of a round; as many again are found by hill climbing."""


SKIPPED = "skipped: "
"""Prefix of counts of states at which a claim about a subject is skipped."""

HOW = {"passed": DECIDED, "failed": DECIDED, "inconclusive": OPEN, "skipped": SKIPPED}
"""Verdict -> prefix of its count by claim and subject."""


class FunctionsPlan(NamedTuple):
    """The plan of a campaign that checks user-supplied functions; see `CampaignPlan`.

    Attributes:
        name: location of the functions: path/to/file.py:NAME.
        seed: seed of all draws.
        claims: ids, keys of `FUNCTION_CLAIMS`.
        families: distributions of the states.
        climbing: whether every other batch is found by hill climbing.
        batch: number of states drawn in a round.
    """

    name: str
    seed: int
    claims: tuple[str, ...]
    families: tuple[str, ...] = (ORDINARY, SPECIAL)
    climbing: bool = True
    batch: int = STATES

    @property
    def kind(self) -> EquationsOfMotion:
        """The functions."""
        functions = functions_named(self.name)
        assert functions is not None
        return functions

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
            "families": list(self.families),
            "climbing": self.climbing,
            "batch": self.batch,
        }

    def run(self, round_: Round) -> RoundResult:
        """Return the result of a round."""
        random, functions = generator(self, round_), self.kind
        population = {key: list(best) for key, best in round_.population.items()}
        families = [self.families[i % len(self.families)] for i in range(self.batch)]
        with record_time(RoundResult(round_.number, round_.variant, population)) as result:
            result.counts.update(families)
            self._look(result, [drawn_state(functions, family, random) for family in families])
            if self.climbing and population:
                higher = hill_climbed_states(functions, population, self.batch, random)
                result.counts["climbed"] += len(higher)
                self._look(result, higher)
        return result

    def caveats(
        self,
        counts: Counter[str],
        open_: Mapping[str, str],
        entries: Mapping[str, Sequence[Entries]],
    ) -> list[str]:
        """Return the caveats of the campaign, a line each, worded as by `check_functions`.

        Args:
            counts: counts of the campaign.
            open_: claim and subject that were not decided at a state -> reason.
            entries: claim and subject -> resolved and hidden entries.
        """
        states = counts["states"]
        lines = [
            f"{about} {why}"
            for about, why in open_.items()
            if counts[SKIPPED + about] == states
            or (counts[OPEN + about] and not counts[DECIDED + about])
        ]
        for about, each in entries.items():
            # A subject that no state decides has its line already.
            if counts[DECIDED + about] and (left := never_resolved(each)):
                compared = counts[DECIDED + about] + counts[OPEN + about]
                lines.append(f"{about} {unresolved_detail(left, compared)}")
        return [*lines, *map(str, caveats(self.kind, self.claims))]

    def _look(self, result: RoundResult, states: Sequence[State]) -> None:
        functions = self.kind
        scores: dict[tuple[str, str], Array] = {}
        result.counts["states"] += len(states)
        for i, state in enumerate(states):
            for one in check_functions_at(functions, state, self.claims):
                result.counts[one.verdict] += 1
                about = f"{one.claim} [{one.subject}]"
                result.counts[f"{HOW[one.verdict]}{about}"] += 1
                if one.entries is not None:
                    result.entries[about] = merged([*result.entries.get(about, ()), one.entries])
                if one.verdict == "inconclusive":
                    result.undecided.setdefault(about, f"inconclusive in all states: {one.detail}")
                elif one.verdict == "skipped":
                    result.undecided.setdefault(about, f"skipped in every state: {one.detail}")
                if one.verdict == "failed":
                    result.failed.append(one)
                elif one.verdict == "passed":
                    subject_scores = scores.setdefault(
                        (one.claim, one.subject), np.zeros(len(states))
                    )
                    subject_scores[i] = max(subject_scores[i], one.ratio)
        cases: list[Any] = [(functions, state) for state in states]
        update_population(result.population, scores, cases)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return the record of a failure, with rounder numbers unless `known` is None."""
        functions, same = self.kind, (failed.claim, failed.subject)
        bounds = limits(functions)

        def check(case: FuzzCase) -> list[Finding]:
            x = np.concatenate(case[1][:2])
            if not ((bounds[0] <= x) & (x <= bounds[1])).all():
                return []
            findings = check_functions_at(functions, case[1], [failed.claim])
            return [x for x in findings if x.verdict == "failed" and (x.claim, x.subject) == same]

        small = failed if known is None else simplify_numbers(failed, check)
        return failure_record(small, name, Diagnosis(FUNCTIONS, failed.evidence))
