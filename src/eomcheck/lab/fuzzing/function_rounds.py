"""Rounds of user-supplied functions: states drawn and hill-climbed, one after the other.

The functions are black boxes, called once a state and derivative, so that nothing is batched; every
state is judged as `eomcheck.testing.check_functions` judges it. All states are within the ranges of
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
from eomcheck.lab.fuzzing.campaign import (
    Population,
    Round,
    RoundResult,
    generator,
    record_time,
    update_population,
)
from eomcheck.lab.fuzzing.cases import (
    MOST_CHANGES,
    ORDINARY,
    SPECIAL,
    FuzzCase,
    changed_entries,
    special_number,
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
    """Return states near the highest: of a claim at random one of its states, changed a little."""
    keys, found = sorted(population), []
    for _ in range(count):
        best, others = (population[keys[random.integers(len(keys))]] for _ in range(2))
        place = min(int(random.exponential(len(best) / 3)), len(best) - 1)
        here, there = (
            np.concatenate(one.case[1][:2])
            for one in (best[place], others[random.integers(len(others))])
        )
        low, high = limits(functions)
        for _ in range(int(random.integers(1, MOST_CHANGES + 1))):
            new = changed_entries(here, there, random)
            # What leaves a range goes to its end, or stays.
            left = ((new < low) | (new > high)) & (random.random(len(new)) < 0.5)
            here = np.where(left, here, np.clip(new, low, high))
        found.append(_within(functions, here))
    return found


def _within(functions: EquationsOfMotion, x: Array) -> State:
    x = np.clip(x, *limits(functions))
    return State(x[: functions.n], x[functions.n :])


# ---- Rounds --------------------------------------------------------------------------------------

STATES = 16
"""States drawn in a round, and as many climbed to."""


SKIPPED = "skipped: "
"""Begins names of counts of states at which a claim says nothing of a subject."""

HOW = {"passed": DECIDED, "failed": DECIDED, "inconclusive": OPEN, "skipped": SKIPPED}
"""Verdict -> beginning of the name of its count by claim and subject."""


class FunctionsPlan(NamedTuple):
    """What all rounds of a campaign about functions have in common; see `Work`.

    Attributes:
        name: where they are found: path/to/file.py:NAME.
        seed: of all draws.
        claims: ids, keys of `FUNCTION_CLAIMS`.
        families: what is drawn from.
        climbing: whether every other batch is climbed to.
        batch: states drawn in a round.
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
        found = functions_named(self.name)
        assert found is not None
        return found

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
            "families": list(self.families),
            "climbing": self.climbing,
            "batch": self.batch,
        }

    def run(self, round_: Round) -> RoundResult:
        """Return what a round comes to."""
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
        """Caveats of the campaign, a line each, in the words of `check_functions`.

        Args:
            counts: of the campaign.
            open_: claims and subjects that were not decided at a state, and why.
            entries: of claims and subjects, which entries were resolved and hidden.
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
        heights: dict[tuple[str, str], Array] = {}
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
                    of = heights.setdefault((one.claim, one.subject), np.zeros(len(states)))
                    of[i] = max(of[i], one.ratio)
        cases: list[Any] = [(functions, state) for state in states]
        update_population(result.population, heights, cases)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return a failure ready to be kept, with rounder numbers unless `known` is None."""
        functions, same = self.kind, (failed.claim, failed.subject)
        bounds = limits(functions)

        def look(case: FuzzCase) -> list[Finding]:
            x = np.concatenate(case[1][:2])
            if not ((bounds[0] <= x) & (x <= bounds[1])).all():
                return []
            found = check_functions_at(functions, case[1], [failed.claim])
            return [x for x in found if x.verdict == "failed" and (x.claim, x.subject) == same]

        small = failed if known is None else simplify_numbers(failed, look)
        return failure_record(small, name, Diagnosis(FUNCTIONS, failed.evidence))
