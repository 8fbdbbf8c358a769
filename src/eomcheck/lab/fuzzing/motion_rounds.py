"""Rounds of motions: drawn, simulated by all formulations, judged, failures shrunk.

Motions of a round start at t = 0, at states drawn or hill-climbed, and are of one structure. A
failure is made shorter and rounder; the fault is that of a formulation which most others
contradict.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import Finding
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.lab.fuzzing.campaign import (
    Round,
    RoundResult,
    generator,
    record_time,
    update_population,
)
from eomcheck.lab.fuzzing.cases import (
    ORDINARY,
    SPECIAL,
    FuzzCase,
    StructuralVariant,
    TopologyVariant,
    consistent,
    draw_cases,
    draw_cases_with,
    draw_structure_kind,
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
    stratum: StructuralVariant | TopologyVariant,
    families: Sequence[str],
    count: int,
    random: np.random.Generator,
) -> tuple[list[FuzzCase], list[str]]:
    """Return up to `count` cases of a structure at t = 0, and the family of each."""
    if isinstance(stratum, StructuralVariant):
        cases, of = draw_cases(kind, stratum, families, count, random)
    else:
        scene = draw_structure_kind(kind, stratum, random)()
        cases, of = draw_cases_with(lambda _: scene, families, count, random)
    begun, places = at_start(cases)
    return begun, [of[place] for place in places]


def at_start(cases: Sequence[FuzzCase]) -> tuple[list[FuzzCase], list[int]]:
    """Cases at t = 0, closed and consistent there, and which they are of those given.

    Those that cannot be are left out.
    """
    if not cases or not cases[0][0].depends_on_time:
        begun = [(scene, State(state.q, state.v, 0.0)) for scene, state in cases]
        return begun, [*range(len(cases))]
    scenes, states, wished, closed = [], [], [], []
    for i, (scene, state) in enumerate(cases):
        with suppress(EomcheckError):
            q = assembled_position(scene, state.q, 0.0)
            scenes.append(scene)
            states.append(State(q, np.zeros(scene.n), 0.0))
            wished.append(state.v)
            closed.append(i)
    begun, places = consistent(scenes, states, lambda _: np.array(wished))
    return begun, [closed[place] for place in places]


# ---- Shrinking and faults ------------------------------------------------------------------------

MOST_TRIES = 60
"""Motions looked at while numbers of a find are made round."""

AMONG = 4
"""Formulations that are asked while a find is made small, the one to blame among them."""


def shrink_motion(finding: MotionFinding, keys: Sequence[str]) -> MotionFinding:
    """Return a failure of the same claim by the same formulation: shorter, and rounder."""
    scene, state = finding.scene, finding.state
    assert state is not None
    able = [key for key in keys if key != finding.subject]
    among = [finding.subject, *able[: AMONG - 1]]

    def failed(case: FuzzCase, t_end: float) -> list[MotionFinding]:
        found = failures_of_motion(case, among, t_end)
        same = finding.claim, finding.subject
        return [one for one in found if (one.claim, one.subject) == same]

    for shorter in (lambda t: t / 2, lambda t: t / 2, _digits(2), _digits(1)):
        if found := failed((scene, state), shorter(finding.t_end)):
            finding = found[0]
    small = simplify_numbers(finding, lambda case: failed(case, finding.t_end), MOST_TRIES)
    # What fails among a few has to fail among all.
    assert small.state is not None
    all_of = failures_of_motion((small.scene, small.state), keys, small.t_end)
    same = [x for x in all_of if (x.claim, x.subject) == (small.claim, small.subject)]
    return same[0] if same else finding


def _digits(count: int) -> Callable[[float], float]:
    return lambda t: float(f"{t:.{count - 1}e}")


def diagnose_motion_failure(finding: MotionFinding, keys: Sequence[str]) -> Diagnosis:
    """Return whose fault a failure is: that of a formulation which most others contradict."""
    assert finding.state is not None
    alone = [(0, key) for key in keys] if finding.claim == ALONE else []
    (found,) = judge_motions([(finding.scene, finding.state)], keys, finding.t_end, alone)
    others = [x for x in found if x.claim == finding.claim and x.subject != finding.subject]
    right = [x for x in others if x.verdict == "passed"]
    best = max((x.observed for x in right), default=0.0)
    said = f"{len(right)} of {len(others)} others agree to {best:.2g}"
    return Diagnosis(SILENT if len(right) > len(others) / 2 and len(right) > 1 else UNKNOWN, said)


# ---- Rounds --------------------------------------------------------------------------------------

MOTIONS = 16
"""Motions side by side."""

SHORTEST, LONGEST = 0.2, 5.0
"""Motions take so long, s, all magnitudes alike, unless they are fast."""

PILOT_STEPS = 150
"""Half of the motions of a round reach its end in so many steps. Slow scenes turn about once in it,
fast ones some ten times; what goes on for longer has lost its digits, or shows nothing new."""


class MotionPlan(NamedTuple):
    """What all rounds of a campaign about motions have in common; see `Work`.

    Attributes:
        kind: the kind of scene.
        seed: of all draws.
        formulations: keys of the formulations.
        families: what starts are drawn from.
        climbing: whether every other batch is climbed to.
        batch: motions side by side.
    """

    kind: type[Scene]
    seed: int
    formulations: tuple[str, ...]
    families: tuple[str, ...] = (ORDINARY, SPECIAL)
    climbing: bool = True
    batch: int = MOTIONS

    @property
    def noun(self) -> str:
        """What reports count."""
        return "motion"

    @property
    def max_states(self) -> int:
        """Motions that a round looks at, at most."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """What decides what rounds come to, plain."""
        return {
            "seed": self.seed,
            "claims": list(MOTION_CLAIMS),
            "formulations": list(self.formulations),
            "families": list(self.families),
            "climbing": self.climbing,
            "batch": self.batch,
        }

    def run(self, round_: Round) -> RoundResult:
        """Return what a round comes to."""
        random = generator(self, round_)
        population = {key: list(best) for key, best in round_.population.items()}
        result = RoundResult(round_.number, round_.variant, population)
        with record_time(result), np.errstate(all="ignore"):
            cases, families = draw_starts(
                self.kind, round_.variant, self.families, self.batch, random
            )
            result.counts.update(families)
            self._look(result, cases, random)
            # Random scenes of one stratum are of several structures, which do not go together.
            if self.climbing and population and isinstance(round_.variant, StructuralVariant):
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
        found = judge_motions(cases, self.formulations, t_end, [one])
        result.counts["states"] += len(cases)
        heights: dict[tuple[str, str], Array] = {}
        for i, findings in enumerate(found):
            for one in findings:
                result.counts[one.verdict] += 1
                if one.claim == END_STATES:
                    result.counts.update(motion_counts(one))
                if one.verdict == "passed":
                    of = heights.setdefault((one.claim, one.subject), np.zeros(len(cases)))
                    of[i] = one.ratio
            result.failed += [one for one in findings if one.verdict == "failed"]
        update_population(result.population, heights, cases)

    def record_failure(
        self, failed: Finding, name: str, known: Sequence[FailureRecord] | None = None
    ) -> FailureRecord:
        """Return a failure ready to be kept, made small unless `known` is None."""
        assert isinstance(failed, MotionFinding)
        small = failed
        with suppress(EomcheckError, np.linalg.LinAlgError):
            if known is not None:
                small = shrink_motion(failed, self.formulations)
        return failure_record(small, name, diagnose_motion_failure(small, self.formulations))


def motion_counts(finding: MotionFinding) -> dict[str, int]:
    """Return what is counted of a motion by one formulation, beside its verdict."""
    counts = {f"motions {finding.ended}": 1}
    if finding.crossed is not None:
        counts[f"{CROSSED if finding.reached else STOPPED}{finding.subject}"] = 1
    return counts


CROSSED, STOPPED = "crossed: ", "not crossed: "
"""What counts of formulations begin with, of poses in which a_1 is singular."""


def informative(cases: Sequence[FuzzCase], keys: Sequence[str]) -> float:
    """Return the time, s, that half of some motions come to in `PILOT_STEPS`."""
    times = np.linspace(0.0, LONGEST, TIMES)
    for key in keys:
        found = simulate_batch(cases, key, LONGEST, COARSE, PILOT_STEPS)
        if found is None:
            continue
        counts = np.isfinite(found.y).all(axis=2).sum(axis=1)
        begun = counts[found.status != "refused"]
        if begun.size:
            return max(float(times[int(np.median(begun)) - 1]), LONGEST / TIMES / 4)
    return LONGEST
