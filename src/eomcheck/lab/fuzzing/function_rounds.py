"""Rounds of user-supplied functions: states drawn and hill-climbed, one after the other.

The functions are black boxes, called once per state and derivative, so that nothing is batched;
every state is judged as by `eomcheck.testing.check_functions`. All states are within the ranges of
the functions. A campaign is a series of rounds of a `FunctionsPlan`, each of one batch of states; a
family is a way to draw them; a population is the states of highest score, by the key (claim,
subject), of which hill climbing makes mutations.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import Any

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
from eomcheck.lab.fuzzing.campaign import CampaignPlan, DrawnCases, Population, RoundResult, parents
from eomcheck.lab.fuzzing.failures import (
    FUNCTIONS,
    FailureRecord,
    functions_named,
    simplify_numbers,
)
from eomcheck.lab.fuzzing.screening import DECIDED as DECIDED_COUNTS
from eomcheck.lab.fuzzing.screening import OPEN as OPEN_COUNTS
from eomcheck.lab.fuzzing.screening import Diagnosis
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.testing.equations_of_motion import EquationsOfMotion
from eomcheck.testing.function_checks import caveats, check_functions_at

# ---- States --------------------------------------------------------------------------------------


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


# ---- Rounds --------------------------------------------------------------------------------------

BATCH = 16
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
    batch: int = BATCH

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
        by_state = [check_functions_at(self.kind, state, self.claims) for _, state in drawn[0]]
        result.add_cases(drawn[0], by_state)
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
