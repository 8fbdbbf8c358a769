"""Rounds of motions: drawn, simulated by all formulations, judged, failures shrunk.

Motions of a round start at t = 0, at states drawn or hill-climbed, and are of one structural
variant. A failure is shrunk to a shorter motion with rounder numbers; at fault is a formulation
that most others contradict.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from eomcheck.claims import Finding
from eomcheck.claims.run import is_same_failure
from eomcheck.draws.fuzz_cases import (
    ORDINARY,
    SPECIAL,
    FuzzCase,
    StructuralVariant,
    consistent,
    draw_cases,
    draw_cases_with,
    draw_structure_kind,
)
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.lab.fuzzing.campaign import CampaignPlan, DrawnCases, Population, RoundResult
from eomcheck.lab.fuzzing.failures import (
    FailureRecord,
    simplify,
    simplify_numbers,
)
from eomcheck.lab.fuzzing.motion_comparison import (
    ALONE,
    COARSE,
    END_STATES,
    MOTION_CLAIMS,
    TIMES,
    MotionFinding,
    failures_of_motion,
    judge_motions,
    simulate_batch,
)
from eomcheck.lab.fuzzing.screening import SILENT, UNKNOWN, Diagnosis
from eomcheck.lab.fuzzing.state_rounds import hill_climbed
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene

# ---- Starts --------------------------------------------------------------------------------------


def draw_starts(
    kind: type[Scene],
    stratum: StructuralVariant,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return up to `count` cases of a variant at t = 0, and the family of each."""
    if not stratum.levels:
        cases, case_families = draw_cases(kind, stratum, families, count, random)
    else:
        scene = draw_structure_kind(kind, stratum, random)()
        cases, case_families = draw_cases_with(lambda _: scene, families, count, random)
    starts, indices = at_start(cases)
    return starts, [case_families[i] for i in indices]


def at_start(cases: Sequence[FuzzCase]) -> tuple[list[FuzzCase], list[int]]:
    """Return the cases at t = 0, closed and consistent there, and their input indices.

    Cases that cannot be closed at t = 0 are left out.
    """
    if not cases or not cases[0][0].depends_on_time:
        starts = [(scene, State(state.q, state.v, 0.0)) for scene, state in cases]
        return starts, [*range(len(cases))]
    scenes, states, velocities, closed = [], [], [], []
    for i, (scene, state) in enumerate(cases):
        with suppress(EomcheckError):
            q = assembled_position(scene, state.q, 0.0)
            scenes.append(scene)
            states.append(State(q, np.zeros(scene.n), 0.0))
            velocities.append(state.v)
            closed.append(i)
    starts, indices = consistent(scenes, states, lambda _: np.array(velocities))
    return starts, [closed[i] for i in indices]


# ---- Shrinking and faults ------------------------------------------------------------------------

MOST_TRIES = 60
"""Largest number of motions checked while numbers of a failure are rounded."""

AMONG = 4
"""Number of formulations compared while a failure is shrunk, the one at fault among them."""


SHORTER: tuple[Callable[[float], float], ...] = (
    lambda t: t / 2,
    lambda t: t / 2,
    lambda t: float(f"{t:.1e}"),
    lambda t: float(f"{t:.0e}"),
)
"""Simplifications of the duration of a motion, tried in this order."""


def shrink_motion(finding: MotionFinding, keys: Sequence[str]) -> MotionFinding:
    """Return a failure of the same claim by the same formulation: shorter, and rounder."""
    others = [key for key in keys if key != finding.subject]
    few = [finding.subject, *others[: AMONG - 1]]

    def failures(candidate: MotionFinding, among: Sequence[str] = few) -> list[MotionFinding]:
        assert candidate.state is not None
        return failures_of_motion((candidate.scene, candidate.state), among, candidate.t_end)

    def ended(shorter: Callable[[float], float], of: MotionFinding) -> list[MotionFinding]:
        return [replace(of, t_end=shorter(of.t_end))]

    finding = simplify(finding, [partial(ended, one) for one in SHORTER], failures)
    small = simplify_numbers(finding, failures, MOST_TRIES)
    # A failure among a few formulations must be one among all.
    return next((x for x in failures(small, keys) if is_same_failure(x, small)), finding)


def diagnose_motion_failure(finding: MotionFinding, keys: Sequence[str]) -> Diagnosis:
    """Return the part at fault: a formulation that most others contradict, or unknown."""
    assert finding.state is not None
    alone = [(0, key) for key in keys] if finding.claim == ALONE else []
    (findings,) = judge_motions([(finding.scene, finding.state)], keys, finding.t_end, alone)
    others = [x for x in findings if x.claim == finding.claim and x.subject != finding.subject]
    right = [x for x in others if x.verdict == "passed"]
    best = max((x.observed for x in right), default=0.0)
    summary = f"{len(right)} of {len(others)} others agree to {best:.2g}"
    return Diagnosis(
        SILENT if len(right) > len(others) / 2 and len(right) > 1 else UNKNOWN, summary
    )


# ---- Rounds --------------------------------------------------------------------------------------

MOTIONS = 16
"""Motions of a batch."""

SHORTEST, LONGEST = 0.2, 5.0
"""Range of durations, s, drawn log-uniformly; fast motions are shorter."""

PILOT_STEPS = 150
"""Steps in which half of the motions of a round reach its end. Slow scenes turn about once in it,
fast ones some ten times; longer motions have lost their digits, or show nothing new."""


@dataclass(frozen=True)
class MotionPlan(CampaignPlan):
    """The plan of a campaign that compares motions; see `CampaignPlan`.

    Attributes:
        formulations: keys of the formulations.
    """

    noun = "motion"

    kind: type[Scene]
    seed: int
    formulations: tuple[str, ...]
    families: tuple[str, ...] = (ORDINARY, SPECIAL)
    climbing: bool = True
    batch: int = MOTIONS
    claims: tuple[str, ...] = tuple(MOTION_CLAIMS)

    def draw(self, result: RoundResult, random: np.random.Generator) -> DrawnCases:
        """Return starts of motions of the round's variant, and the family of each."""
        return draw_starts(self.kind, result.variant, self.families, self.batch, random)

    def mutate(self, population: Population, random: np.random.Generator) -> list[FuzzCase]:
        """Return mutations of the starts of a population, at t = 0."""
        return at_start(hill_climbed(population, self.batch, random))[0]

    def climb(self, result: RoundResult, random: np.random.Generator) -> None:
        """Check a batch of mutated starts, unless the round has random scenes.

        Those of one variant have several structures, which cannot be batched.
        """
        if not result.variant.levels:
            super().climb(result, random)

    def check(self, result: RoundResult, drawn: DrawnCases, random: np.random.Generator) -> None:
        """Compare the motions of all formulations, and one of them with the same one alone."""
        t_end = float(np.exp(random.uniform(np.log(SHORTEST), np.log(LONGEST))))
        cases, _ = drawn
        if not cases or result.over():
            return
        t_end = min(t_end, informative(cases, self.formulations))
        alone = int(random.integers(len(cases))), str(random.choice(self.formulations))
        by_motion = judge_motions(cases, self.formulations, t_end, [alone])
        result.add_cases(cases, by_motion)
        for finding in chain.from_iterable(by_motion):
            if finding.claim == END_STATES:
                result.counts.update(motion_counts(finding))

    def shrunk(self, failed: Finding, known: Sequence[FailureRecord]) -> Finding:
        """Return the failure of a shorter motion with rounder numbers."""
        assert isinstance(failed, MotionFinding)
        return shrink_motion(failed, self.formulations)

    def diagnosis(self, failed: Finding) -> Diagnosis:
        """Return the part at fault: a formulation that most others contradict, or unknown."""
        assert isinstance(failed, MotionFinding)
        return diagnose_motion_failure(failed, self.formulations)


def motion_counts(finding: MotionFinding) -> dict[str, int]:
    """Return the counts of a motion by one formulation, beside its verdict."""
    counts = {f"motions {finding.ended}": 1}
    if finding.crossed is not None:
        counts[f"{CROSSED if finding.reached else STOPPED}{finding.subject}"] = 1
    return counts


CROSSED, STOPPED = "crossed: ", "not crossed: "
"""Prefixes of counts, by formulation, of motions across a pose where a_1 is singular."""


def informative(cases: Sequence[FuzzCase], keys: Sequence[str]) -> float:
    """Return the time, s, that half of some motions reach in `PILOT_STEPS` steps."""
    times = np.linspace(0.0, LONGEST, TIMES)
    for key in keys:
        batch = simulate_batch(cases, key, LONGEST, COARSE, PILOT_STEPS)
        if batch is None:
            continue
        counts = np.isfinite(batch.y).all(axis=2).sum(axis=1)
        started = counts[batch.status != "refused"]
        if started.size:
            return max(float(times[int(np.median(started)) - 1]), LONGEST / TIMES / 4)
    return LONGEST
