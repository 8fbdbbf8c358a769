"""Rounds of random motions: drawn and climbed to, moved by all formulations, and judged."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims import Finding
from eomcheck.errors import EomcheckError
from eomcheck.lab.fuzzing.families import ORDINARY, SPECIAL, Case
from eomcheck.lab.fuzzing.finds import Find, find_of
from eomcheck.lab.fuzzing.motion_finding import CLAIMS_OF_MOTIONS, END_STATES, MotionFinding
from eomcheck.lab.fuzzing.motion_finds import fault_of_motion, shrunk_motion
from eomcheck.lab.fuzzing.motion_starts import at_start, started
from eomcheck.lab.fuzzing.motions import judged_motions
from eomcheck.lab.fuzzing.moved import COARSE, TIMES, moved
from eomcheck.lab.fuzzing.rounds import climbed
from eomcheck.lab.fuzzing.strata import Stratum
from eomcheck.lab.fuzzing.work import Result, Round, generator, raise_population, timed
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array

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
    def most(self) -> int:
        """Motions that a round looks at, at most."""
        return 2 * self.batch

    @property
    def settings(self) -> dict[str, Any]:
        """What decides what rounds come to, plain."""
        return {
            "seed": self.seed,
            "claims": list(CLAIMS_OF_MOTIONS),
            "formulations": list(self.formulations),
            "families": list(self.families),
            "climbing": self.climbing,
            "batch": self.batch,
        }

    def run(self, given: Round) -> Result:
        """Return what a round comes to."""
        random = generator(self, given)
        population = {key: list(best) for key, best in given.population.items()}
        result = Result(given.number, given.stratum, population)
        with timed(result), np.errstate(all="ignore"):
            cases, families = started(self.kind, given.stratum, self.families, self.batch, random)
            result.counts.update(families)
            self._look(result, cases, random)
            # Random scenes of one stratum are of several structures, which do not go together.
            if self.climbing and population and isinstance(given.stratum, Stratum):
                higher, _ = at_start(climbed(population, self.batch, random))
                result.counts["climbed"] += len(higher)
                self._look(result, higher, random)
        return result

    def _look(self, result: Result, cases: list[Case], random: np.random.Generator) -> None:
        t_end = float(np.exp(random.uniform(np.log(SHORTEST), np.log(LONGEST))))
        if not cases:
            return
        t_end = min(t_end, informative(cases, self.formulations))
        one = int(random.integers(len(cases))), str(random.choice(self.formulations))
        found = judged_motions(cases, self.formulations, t_end, [one])
        result.counts["states"] += len(cases)
        heights: dict[tuple[str, str], Array] = {}
        for i, findings in enumerate(found):
            for one in findings:
                result.counts[one.verdict] += 1
                if one.claim == END_STATES:
                    result.counts.update(told(one))
                if one.verdict == "passed":
                    of = heights.setdefault((one.claim, one.subject), np.zeros(len(cases)))
                    of[i] = one.ratio
            result.failed += [one for one in findings if one.verdict == "failed"]
        raise_population(result.population, heights, cases)

    def find(self, failed: Finding, name: str, known: Sequence[Find] | None = None) -> Find:
        """Return a failure ready to be kept, made small unless `known` is None."""
        assert isinstance(failed, MotionFinding)
        small = failed
        with suppress(EomcheckError, np.linalg.LinAlgError):
            if known is not None:
                small = shrunk_motion(failed, self.formulations)
        return find_of(small, name, fault_of_motion(small, self.formulations))


def told(finding: MotionFinding) -> dict[str, int]:
    """Return what is counted of a motion by one formulation, beside its verdict."""
    counts = {f"motions {finding.ended}": 1}
    if finding.crossed is not None:
        counts[f"{CROSSED if finding.reached else STOPPED}{finding.subject}"] = 1
    return counts


CROSSED, STOPPED = "crossed: ", "not crossed: "
"""What counts of formulations begin with, of poses in which a_1 is singular."""


def informative(cases: Sequence[Case], keys: Sequence[str]) -> float:
    """Return the time, s, that half of some motions come to in `PILOT_STEPS`."""
    times = np.linspace(0.0, LONGEST, TIMES)
    for key in keys:
        found = moved(cases, key, LONGEST, COARSE, PILOT_STEPS)
        if found is None:
            continue
        counts = np.isfinite(found.y).all(axis=2).sum(axis=1)
        begun = counts[found.status != "refused"]
        if begun.size:
            return max(float(times[int(np.median(begun)) - 1]), LONGEST / TIMES / 4)
    return LONGEST
