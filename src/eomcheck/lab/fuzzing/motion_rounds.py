"""Rounds of motions: drawn, simulated by all formulations, judged, failures shrunk.

Motions of a round start at t = 0, at states drawn or hill-climbed, and are of one structural
variant. A failure is shrunk to a shorter motion with rounder numbers; at fault is a formulation
that most others contradict.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import Finding
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
from eomcheck.lab.fuzzing.campaign import (
    Round,
    RoundResult,
    generator,
    record_time,
    update_population,
)
from eomcheck.lab.fuzzing.failures import FailureRecord, failure_record, simplify_numbers
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
from eomcheck.lab.fuzzing.state_rounds import hill_climbed
from eomcheck.lab.fuzzing.triage import SILENT, UNKNOWN, Diagnosis
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

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


def shrink_motion(finding: MotionFinding, keys: Sequence[str]) -> MotionFinding:
    """Return a failure of the same claim by the same formulation: shorter, and rounder."""
    scene, state = finding.scene, finding.state
    assert state is not None
    others = [key for key in keys if key != finding.subject]
    among = [finding.subject, *others[: AMONG - 1]]

    def failed(case: FuzzCase, t_end: float) -> list[MotionFinding]:
        failures = failures_of_motion(case, among, t_end)
        same = finding.claim, finding.subject
        return [one for one in failures if (one.claim, one.subject) == same]

    for shorter in (lambda t: t / 2, lambda t: t / 2, _digits(2), _digits(1)):
        if failures := failed((scene, state), shorter(finding.t_end)):
            finding = failures[0]
    small = simplify_numbers(finding, lambda case: failed(case, finding.t_end), MOST_TRIES)
    # A failure among a few formulations must be one among all.
    assert small.state is not None
    all_of = failures_of_motion((small.scene, small.state), keys, small.t_end)
    same = [x for x in all_of if (x.claim, x.subject) == (small.claim, small.subject)]
    return same[0] if same else finding


def _digits(count: int) -> Callable[[float], float]:
    return lambda t: float(f"{t:.{count - 1}e}")


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


class MotionPlan(NamedTuple):
    """The plan of a campaign that compares motions; see `CampaignPlan`.

    Attributes:
        kind: the scene class.
        seed: seed of all draws.
        formulations: keys of the formulations.
        families: distributions of the starts.
        climbing: whether every other batch is found by hill climbing.
        batch: number of motions in a batch.
    """

    kind: type[Scene]
    seed: int
    formulations: tuple[str, ...]
    families: tuple[str, ...] = (ORDINARY, SPECIAL)
    climbing: bool = True
    batch: int = MOTIONS

    @property
    def noun(self) -> str:
        """Unit that reports count."""
        return "motion"

    @property
    def max_states(self) -> int:
        """Largest number of motions that a round checks."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """The settings that determine the results of rounds, as plain data."""
        return {
            "seed": self.seed,
            "claims": list(MOTION_CLAIMS),
            "formulations": list(self.formulations),
            "families": list(self.families),
            "climbing": self.climbing,
            "batch": self.batch,
        }

    def run(self, round_: Round) -> RoundResult:
        """Return the result of a round."""
        random = generator(self, round_)
        population = {key: list(best) for key, best in round_.population.items()}
        result = RoundResult(round_.number, round_.variant, population)
        with record_time(result), np.errstate(all="ignore"):
            cases, families = draw_starts(
                self.kind, round_.variant, self.families, self.batch, random
            )
            result.counts.update(families)
            self._look(result, cases, random)
            # Random scenes of one variant have several structures, which cannot be batched.
            if self.climbing and population and not round_.variant.levels:
                higher, _ = at_start(hill_climbed(population, self.batch, random))
                result.counts["climbed"] += len(higher)
                self._look(result, higher, random)
        return result

    def _look(
        self, result: RoundResult, cases: list[FuzzCase], random: np.random.Generator
    ) -> None:
        t_end = float(np.exp(random.uniform(np.log(SHORTEST), np.log(LONGEST))))
        if not cases:
            return
        t_end = min(t_end, informative(cases, self.formulations))
        one = int(random.integers(len(cases))), str(random.choice(self.formulations))
        findings_by_motion = judge_motions(cases, self.formulations, t_end, [one])
        result.counts["states"] += len(cases)
        scores: dict[tuple[str, str], Array] = {}
        for i, findings in enumerate(findings_by_motion):
            for one in findings:
                result.counts[one.verdict] += 1
                if one.claim == END_STATES:
                    result.counts.update(motion_counts(one))
                if one.verdict == "passed":
                    key_scores = scores.setdefault((one.claim, one.subject), np.zeros(len(cases)))
                    key_scores[i] = one.ratio
            result.failed += [one for one in findings if one.verdict == "failed"]
        update_population(result.population, scores, cases)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return the record of a failure, shrunk unless `known` is None."""
        assert isinstance(failed, MotionFinding)
        small = failed
        with suppress(EomcheckError, np.linalg.LinAlgError):
            if known is not None:
                small = shrink_motion(failed, self.formulations)
        return failure_record(small, name, diagnose_motion_failure(small, self.formulations))


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
