"""Screening of many states at once: all claims in batches, suspects picked for a full check.

A batch runs in SIMD lanes. Where a state is near its bound, and at a sample of the others, the true
acceleration is enclosed and judges all formulations. Functions that are not rational do not run in
lanes; their states are checked one by one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.batched_claims import BatchedCase, batchable_claims, batched_cases
from eomcheck.claims.finding import DECIDED as VERDICTS
from eomcheck.claims.finding import FAILED_CODE, INCONCLUSIVE_CODE, PASSED_CODE
from eomcheck.errors import EomcheckError
from eomcheck.evaluation.batched_evaluation import LaneEvaluation
from eomcheck.evaluation.certified import (
    REFERENCE_DIGITS,
    REFERENCE_WITHOUT_SPEEDS,
    Enclosure,
    enclose,
    true_error,
    true_state,
)
from eomcheck.evaluation.tolerance import UNDERFLOW, allowed_error, largest
from eomcheck.formulations import Formulation
from eomcheck.lab.fuzzing.cases import FuzzCase
from eomcheck.lab.fuzzing.triage import check_case, keys_in_subject
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import midpoints_or_zero
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray

ALONE = 32
"""States of a batch where they are looked at one by one."""

Key = tuple[str, str]
"""A claim, and the formulation that it is about there, "" if it is about none."""

OPEN, DECIDED = "inconclusive: ", "decided: "
"""Begin names of counts of subjects that a claim decides, and of others."""

TRUTH = "true error"
"""In the place of a claim: error against an enclosure, over what is allowed."""

ENCLOSED_ABOVE = 0.3
"""Observed / allowed above which a state is always enclosed."""


class CheckFrequency(NamedTuple):
    """How often what takes long is looked at: at one state in so many, 0 for never."""

    enclosures: int = 4
    """One true acceleration, which judges all formulations."""
    balls: int = 20
    """All formulations in balls."""
    engines: int = 10
    checks: int = 200
    """All claims by `eomcheck.check_state`, but engines."""
    scalar_only: int = 20
    """What lanes cannot look at."""


@dataclass
class ScreeningResult:
    """What lanes say of cases.

    Attributes:
        count: number of cases L.
        scores: by claim and formulation, observed / allowed (L,).
        suspects: which cases are to be looked at again, and by which claims.
        verdicts: number of subjects by verdict.
        by_claim: number of subjects `OPEN` or `DECIDED`, by claim.
        not_batched: claims that could not be looked at in lanes, and why.
        enclosed: number of states at which the truth was enclosed.
        non_finite: cases whose terms are not all finite: lanes say nothing of them.
    """

    count: int
    scores: dict[Key, Array] = field(default_factory=dict)
    suspects: dict[int, set[str]] = field(default_factory=dict)
    verdicts: Counter[str] = field(default_factory=Counter)
    by_claim: Counter[tuple[str, str]] = field(default_factory=Counter)
    not_batched: dict[str, str] = field(default_factory=dict)
    enclosed: int = 0
    non_finite: list[int] = field(default_factory=list)

    def score(self, key: Key) -> Array:
        """Return the heights (L,) by a claim and formulation, 0 until they are told."""
        return self.scores.setdefault(key, np.zeros(self.count))

    @property
    def max_scores(self) -> Array:
        """The largest height of each case (L,)."""
        return np.max([np.zeros(self.count), *self.scores.values()], axis=0)


def screen(
    cases: Sequence[FuzzCase],
    formulations: Sequence[Formulation],
    claims: Sequence[str],
    enclosed_every: int,
    first: int = 0,
) -> ScreeningResult:
    """Return what lanes say of cases of any structures.

    Args:
        cases: scenes and states.
        formulations: those that take part.
        claims: ids, of which those that can be are looked at.
        enclosed_every: one state in so many is enclosed whatever the lanes say, 0 for none.
        first: number of the first case, of which `enclosed_every` counts.
    """
    found, ids = ScreeningResult(len(cases)), batchable_claims(claims)
    for places, case in batched_cases(cases, formulations):
        try:
            terms = case.at.terms
        except TypeError:  # functions that no lanes can run
            _look_alone(found, places, [cases[i] for i in places], case.formulations, ids)
            continue
        finite = np.ones(case.at.lanes, bool)
        for term in terms:
            if term is not None:
                finite &= np.isfinite(term.data).reshape(-1, case.at.lanes).all(axis=0)
        if not finite.all():
            found.non_finite += [int(i) for i in places[~finite]]
            places = places[finite]
            if not places.size:
                continue
            ((_, case),) = batched_cases([cases[i] for i in places], formulations)
        _look(found, places, case, ids)
        _enclose(found, places, case, enclosed_every, first)
    return found


def _look(found: ScreeningResult, places: Array, case: BatchedCase, ids: Sequence[str]) -> None:
    keys = {f.key for f in case.formulations}
    for one in case.evaluate(ids):
        for number, name in (
            (PASSED_CODE, "passed"),
            (FAILED_CODE, "failed"),
            (INCONCLUSIVE_CODE, "inconclusive"),
        ):
            count = int(np.count_nonzero(one.verdict == number))
            found.verdicts[name] += count
            found.by_claim[OPEN if name == "inconclusive" else DECIDED, one.claim] += count
        ratio = np.where(one.allowed > UNDERFLOW, one.ratio, 0.0)  # what underflows shows no way
        for key in keys_in_subject(one.subject, keys) or ("",):
            heights = found.score((one.claim, key))
            heights[places] = np.maximum(heights[places], ratio)
        for i in places[one.verdict == FAILED_CODE]:
            found.suspects.setdefault(int(i), set()).add(one.claim)
    found.not_batched |= case.not_batched


def _look_alone(
    found: ScreeningResult,
    places: Array,
    cases: Sequence[FuzzCase],
    formulations: Sequence[Formulation],
    ids: Sequence[str],
) -> None:
    """Look at cases one by one, as `eomcheck.check_state` does: lanes take rational functions
    only.
    """
    keys = {f.key for f in formulations}
    for place, case in zip(places.tolist(), cases, strict=True):
        told = [one for one in check_case(case, ["finite-terms"], []) if one.verdict == "failed"]
        if told:
            found.non_finite.append(place)
            continue
        for one in check_case(case, ids, sorted(keys)):
            found.verdicts[one.verdict] += 1
            if one.verdict != "skipped":
                how = DECIDED if one.verdict in VERDICTS else OPEN
                found.by_claim[how, one.claim] += 1
            if one.verdict == "failed":
                found.suspects.setdefault(place, set()).add(one.claim)
            if one.verdict in ("passed", "failed"):
                for key in keys_in_subject(one.subject, keys) or ("",):
                    heights = found.score((one.claim, key))
                    heights[place] = max(heights[place], one.ratio)


def runs_in_lanes(kind: type[Scene]) -> bool:
    """Return whether a kind's functions are rational, and so can be looked at side by side."""
    scene = kind.example()
    with suppress(Exception):  # somebody's functions; `check` tells which
        LaneEvaluation([scene], [State(*scene.initial_state(), 0.0)]).terms  # noqa: B018
        return True
    return False


def _enclose(
    found: ScreeningResult, places: Array, case: BatchedCase, every: int, first: int
) -> None:
    """Enclose the truth of what is near its bounds, and of some others, and judge all by it."""
    if every == 0:
        return
    worst = found.max_scores
    chosen = (worst[places] > ENCLOSED_ABOVE) | ((first + places) % every == 0)
    truths = {}
    for lane in np.flatnonzero(chosen).tolist():
        with suppress(EomcheckError, TypeError):
            truths[lane] = _truth(case, lane)
    if not truths:
        return
    found.enclosed += len(truths)
    lanes = list(truths)
    there = BatchedCase(_at_truth(case, truths), case.formulations, case.has_speeds)
    for f, x in there.solutions:
        vdot: Any = x.vdot
        allowed = allowed_error(1.0) * there.vdot_sensitivity(f).data
        told = np.isfinite(allowed) & ~there.refused(f.key)
        for i in np.flatnonzero(told).tolist():
            error = largest(true_error(vdot.data[:, i], truths[lanes[i]]))
            heights = found.score((TRUTH, f.key))
            place = int(places[lanes[i]])
            heights[place] = height = error / max(float(allowed[i]), UNDERFLOW)
            if height > 1.0:
                found.suspects.setdefault(place, set()).add("true-error")


def _truth(case: BatchedCase, lane: int) -> Enclosure:
    """Return the true acceleration in one lane: of its generalized speeds, if there are any.

    Raises:
        EomcheckError: there is none.
        TypeError: functions that balls cannot run.
    """
    at = case.at.alone(lane)
    if case.has_speeds:
        u: Any = case.at.u
        return true_state(at.scene, at.q, u.data[:, lane], at.t)[0]
    return enclose(
        at.scene, REFERENCE_WITHOUT_SPEEDS, at.q, t=at.t, digits=REFERENCE_DIGITS, v=at.v
    )


def _at_truth(case: BatchedCase, truths: dict[int, Enclosure]) -> LaneEvaluation:
    """Return the lanes of which the truth is known, at its velocities, see `true_state`."""
    lanes = list(truths)
    states = []
    for lane, truth in truths.items():
        q, v, t = case.at.state_of(lane)
        states.append(State(q, midpoints_or_zero(truth.v) if case.has_speeds else v, t))
    there = LaneEvaluation([case.at.scenes[lane] for lane in lanes], states)
    if case.has_speeds:
        u: Any = case.at.u
        there.u = LaneArray(u.data[:, lanes].copy())  # type: ignore[assignment]
    return there
