"""Screening of many states at once, and triage of the suspects among them.

A batch runs in SIMD lanes, one state a lane. At states near their error bound, and at a sample of
the others, the true acceleration is enclosed in ball arithmetic, and all formulations are judged by
it. Functions that are not rational cannot run in lanes; their states are checked one by one.

Suspects are judged by `eomcheck.check_state` alone, and the part at fault is diagnosed: a
formulation whose error exceeds its own bound (a silent error), the check (a false alarm), an
engine, the scene, or a refusal that should not be. Errors are measured against certified values in
ball arithmetic; identities are tested in a finite field (polynomial identity testing), where
nothing is rounded.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from eomcheck.calls import is_ours
from eomcheck.claims import CLAIMS, Finding
from eomcheck.claims.batched_claims import BatchedCase, batchable_claims, batched_cases
from eomcheck.claims.finding import DECIDED as DECIDING
from eomcheck.claims.finding import FAILED_CODE, SKIPPED_CODE, VERDICTS
from eomcheck.claims.proof import prove
from eomcheck.claims.run import check_state
from eomcheck.claims.user_scenes import failing_function
from eomcheck.draws.fuzz_cases import FuzzCase
from eomcheck.engines import Engine, is_under_test
from eomcheck.errors import EomcheckError, InputError
from eomcheck.evaluation.certified import (
    REFERENCE_DIGITS,
    REFERENCE_WITHOUT_SPEEDS,
    Enclosure,
    enclose,
    true_acceleration,
    true_error,
)
from eomcheck.evaluation.dynamics import acceleration
from eomcheck.evaluation.evaluation import BatchEvaluation
from eomcheck.evaluation.tolerance import NOTICEABLE, UNDERFLOW, allowed_error, largest
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.ball import midpoints_or_zero
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import Array

# ---- Time limit ----------------------------------------------------------------------------------

_deadline: ContextVar[float | None] = ContextVar("deadline", default=None)


@contextmanager
def deadline(moment: float | None) -> Iterator[None]:
    """Have `time_is_up` return True inside the block from a moment on, by `time.time`; None: never.

    What is in hand then is finished, a state or a batch, and nothing more is begun.
    """
    before = _deadline.set(moment)
    try:
        yield
    finally:
        _deadline.reset(before)


def time_is_up() -> bool:
    """Return whether the deadline has passed."""
    moment = _deadline.get()
    return moment is not None and time.time() >= moment


# ---- Triage --------------------------------------------------------------------------------------

SILENT, ALARM, ENGINE, SCENE, REFUSAL, UNKNOWN = (
    "silent error",
    "false alarm",
    "engine",
    "scene",
    "refusal",
    "not told",
)
"""Parts at fault: a formulation, whose error exceeds its bound; the check, which allows too little
(a false positive); an engine; the scene; a refusal that should not be; or not known."""


class Diagnosis(NamedTuple):
    """The part at fault of a failure, with the evidence."""

    at_fault: str
    evidence: str


def failed_findings(
    case: FuzzCase,
    claims: Iterable[str],
    formulations: Sequence[str],
    engines: Sequence[str | type[Engine]] = (),
) -> list[Finding]:
    """Return the findings of `eomcheck.check_state` at one state that failed."""
    findings = check_case(case, claims, formulations, engines)
    return [one for one in findings if one.verdict == "failed"]


def check_case(
    case: FuzzCase,
    claims: Iterable[str],
    formulations: Sequence[str],
    engines: Sequence[str | type[Engine]] = (),
) -> list[Finding]:
    """Return the findings of `eomcheck.check_state` at one state."""
    scene, (q, v, t) = case
    applicable = [key for key in formulations if FORMULATIONS[key].applies_to(scene)]
    options = {"formulations": applicable, "engines": list(engines), "claims": sorted(set(claims))}
    return check_state(scene, q, v, t, consistent=False, **options)


def diagnose_failure(finding: Finding) -> Diagnosis:
    """Return the part at fault of a failure.

    The true acceleration is enclosed in ball arithmetic for every formulation of the finding's
    subject; identities are tested in a finite field, where nothing is rounded.
    """
    claim = CLAIMS[finding.claim]
    if finding.claim == "refusals":
        return Diagnosis(REFUSAL, finding.detail)
    scene, state = finding.scene, finding.state
    assert isinstance(scene, Scene) and state is not None
    if not is_ours(type(scene)) and (broken := failing_function(scene, state)):
        return Diagnosis(SCENE, broken)
    silent, errors = [], []
    for key in formulations_about(finding) or tuple(FORMULATIONS):
        with suppress(EomcheckError, TypeError):
            answer = acceleration(scene, key, *state, consistent=False)
            truth = enclose(scene, key, state.q, t=state.t, digits=REFERENCE_DIGITS, v=state.v)
            error = largest(true_error(answer.vdot, truth))
            size = largest(truth.doubles())
            bound = max(answer.error_bound, UNDERFLOW)
            summary = f"{key}: true error {error:.2g} of {size:.2g}, bound {answer.error_bound:.2g}"
            errors.append(summary)
            if error > bound:
                silent.append(f"{summary}{', noticeable' if error > NOTICEABLE * size else ''}")
    if silent:
        return Diagnosis(SILENT, f"enclosed: {'; '.join(silent)}")
    under_test = finding.engine is not None and is_under_test(finding.engine)
    wrong = frozenset() if under_test else unproved(scene)
    if wrong is None:
        return Diagnosis(UNKNOWN, "the scene's functions are not rational: nothing is proved")
    if claim.asks and not wrong:
        why = "; ".join(errors[:2]) or "no formulation answers"
        return Diagnosis(
            ENGINE, f"{'the engine on trial' if under_test else 'an engine'}; enclosed: {why}"
        )
    if wrong:
        return Diagnosis(SCENE, f"not proved either: {', '.join(sorted(wrong))}")
    return Diagnosis(ALARM, f"identities proved; enclosed: {'; '.join(errors) or 'no formulation'}")


def formulations_about(finding: Finding) -> tuple[str, ...]:
    """Return the keys of formulations in the subject of a finding."""
    return keys_in_subject(finding.subject, FORMULATIONS)


def keys_in_subject(subject: str, keys: Container[str]) -> tuple[str, ...]:
    """Return the keys among `keys` that a subject names, in its order."""
    words = subject.replace("~", " ").replace(",", " ").replace(":", " ").split()
    return tuple(word for word in words if word in keys)


def unproved(scene: Scene) -> frozenset[str] | None:
    """Return the claims disproved for the structure of `scene`; None if none can be proved."""
    return _unproved(_Same(scene, (type(scene), scene.structure)))


class _Same(NamedTuple):
    scene: Scene
    which: tuple

    def __hash__(self) -> int:
        return hash(self.which)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.which == other.which


@lru_cache(64)
def _unproved(same: _Same) -> frozenset[str] | None:
    try:
        findings = prove(same.scene, points=1, seed=0)
    except InputError:
        return None
    if not any(one.proof is not None for one in findings):
        return None
    return frozenset(one.claim for one in findings if one.verdict == "failed")


# ---- Screening -----------------------------------------------------------------------------------

ALONE = 32
"""States of a batch where they are checked one by one."""

Key = tuple[str, str]
"""(claim, formulation in its subject); the formulation is "" if there is none."""

OPEN, DECIDED = "inconclusive: ", "decided: "
"""Prefixes of counts of subjects that a claim does not decide, and of those that it does."""

TRUTH = "true error"
"""Key in place of a claim: error against an enclosure / allowed error."""

ENCLOSED_ABOVE = 0.3
"""Score, observed / allowed, above which a state is always enclosed."""


class CheckFrequency(NamedTuple):
    """Sampling rates of expensive checks: one state in so many, 0 for never."""

    enclosures: int = 4
    """Enclosure of the true acceleration, by which all formulations are judged."""
    balls: int = 20
    """Evaluation of all formulations in ball arithmetic."""
    engines: int = 10
    """Claims about engines."""
    checks: int = 200
    """All claims but those about engines, by `eomcheck.check_state`."""
    scalar_only: int = 20
    """Claims that cannot be evaluated in batches."""


@dataclass
class ScreeningResult:
    """The result of screening a batch of cases.

    Attributes:
        count: number of cases L.
        scores: (claim, formulation) -> observed / allowed (L,).
        suspects: index of a case to check in full -> its claims.
        verdicts: verdict -> number of subjects.
        by_claim: (`OPEN` or `DECIDED`, claim) -> number of subjects.
        not_batched: claim that could not be evaluated in lanes -> reason.
        enclosed: number of states at which the true acceleration was enclosed.
        non_finite: indices of cases whose terms are not all finite, which are not screened.
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
        """Return the scores (L,) of a claim and formulation, 0 until they are set."""
        return self.scores.setdefault(key, np.zeros(self.count))

    @property
    def max_scores(self) -> Array:
        """The largest score of each case (L,)."""
        return np.max([np.zeros(self.count), *self.scores.values()], axis=0)

    def settle(self, i: int, scores: dict[str, float]) -> None:
        """Replace the scores above 1 of a suspect by those of `check_state`, 0 where it has none.

        Args:
            i: index of the suspect.
            scores: claim -> observed / allowed.
        """
        for (claim, _), values in self.scores.items():
            judged_claim = "true-error" if claim == TRUTH else claim
            if judged_claim in self.suspects[i] and values[i] > 1.0:
                values[i] = scores.get(judged_claim, 0.0)


def screen(
    cases: Sequence[FuzzCase],
    formulations: Sequence[Formulation],
    claims: Sequence[str],
    enclosed_every: int,
    first: int = 0,
) -> ScreeningResult:
    """Return the screening result of cases of any structures.

    Args:
        cases: scenes and states.
        formulations: those that take part.
        claims: ids, of which the batchable ones are evaluated.
        enclosed_every: one state in so many is enclosed whatever its scores, 0 for none.
        first: number of the first case, from which `enclosed_every` counts.
    """
    result, ids = ScreeningResult(len(cases)), batchable_claims(claims)
    for indices, case in batched_cases(cases, formulations):
        try:
            terms = case.at.terms
        except TypeError:  # functions that cannot run in lanes
            _screen_one_by_one(result, indices, [cases[i] for i in indices], case.formulations, ids)
            continue
        finite = np.ones(case.at.states, bool)
        for term in terms:
            if term is not None:
                finite &= np.isfinite(term.flattened()).all(axis=1)
        if not finite.all():
            result.non_finite += [int(i) for i in indices[~finite]]
            indices = indices[finite]
            if not indices.size:
                continue
            ((_, case),) = batched_cases([cases[i] for i in indices], formulations)
        _screen_batch(result, indices, case, ids)
        _enclose(result, indices, case, enclosed_every, first)
    return result


def _screen_batch(
    result: ScreeningResult, indices: Array, case: BatchedCase, ids: Sequence[str]
) -> None:
    keys = {f.key for f in case.formulations}
    for one in case.evaluate(ids):
        for number, name in enumerate(VERDICTS[:SKIPPED_CODE]):
            count = int(np.count_nonzero(one.verdict == number))
            result.verdicts[name] += count
            result.by_claim[DECIDED if name in DECIDING else OPEN, one.claim] += count
        ratio = np.where(one.allowed > UNDERFLOW, one.ratio, 0.0)  # no climbing by underflow
        for key in keys_in_subject(one.subject, keys) or ("",):
            scores = result.score((one.claim, key))
            scores[indices] = np.maximum(scores[indices], ratio)
        for i in indices[one.verdict == FAILED_CODE]:
            result.suspects.setdefault(int(i), set()).add(one.claim)
    result.not_batched |= case.not_batched


def _screen_one_by_one(
    result: ScreeningResult,
    indices: Array,
    cases: Sequence[FuzzCase],
    formulations: Sequence[Formulation],
    ids: Sequence[str],
) -> None:
    """Check cases one by one by `eomcheck.check_state`, for functions that are not rational."""
    keys = {f.key for f in formulations}
    for index, case in zip(indices.tolist(), cases, strict=True):
        failed = [one for one in check_case(case, ["finite-terms"], []) if one.verdict == "failed"]
        if failed:
            result.non_finite.append(index)
            continue
        for one in check_case(case, ids, sorted(keys)):
            result.verdicts[one.verdict] += 1
            if one.verdict != "skipped":
                how = DECIDED if one.verdict in DECIDING else OPEN
                result.by_claim[how, one.claim] += 1
            if one.verdict == "failed":
                result.suspects.setdefault(index, set()).add(one.claim)
            if one.verdict in DECIDING:
                for key in keys_in_subject(one.subject, keys) or ("",):
                    scores = result.score((one.claim, key))
                    scores[index] = max(scores[index], one.ratio)


def runs_in_lanes(kind: type[Scene]) -> bool:
    """Return whether a class's functions are rational, and so can be evaluated in SIMD lanes."""
    scene = kind.example()
    with suppress(Exception):  # user-supplied functions; `check` reports which
        BatchEvaluation([scene], [State(*scene.initial_state(), 0.0)]).terms  # noqa: B018
        return True
    return False


def _enclose(
    result: ScreeningResult, indices: Array, case: BatchedCase, every: int, first: int
) -> None:
    """Enclose the true acceleration near error bounds and at a sample; judge formulations by it."""
    if every == 0:
        return
    worst = result.max_scores
    chosen = (worst[indices] > ENCLOSED_ABOVE) | ((first + indices) % every == 0)
    truths = {}
    for lane in np.flatnonzero(chosen).tolist():
        with suppress(EomcheckError, TypeError):
            truths[lane] = _truth(case, lane)
    if not truths:
        return
    result.enclosed += len(truths)
    lanes = list(truths)
    enclosed = BatchedCase(_at_truth(case, truths), case.formulations, case.has_speeds)
    for f, x in enclosed.solutions:
        vdot: Any = x.vdot
        allowed = allowed_error(1.0) * enclosed.vdot_sensitivity(f).data
        judged = np.isfinite(allowed) & ~enclosed.refused(f.key)
        for i in np.flatnonzero(judged).tolist():
            error = largest(true_error(vdot.data[i], truths[lanes[i]]))
            scores = result.score((TRUTH, f.key))
            index = int(indices[lanes[i]])
            scores[index] = score = error / max(float(allowed[i]), UNDERFLOW)
            if score > 1.0:
                result.suspects.setdefault(index, set()).add("true-error")


def _truth(case: BatchedCase, lane: int) -> Enclosure:
    """Return the enclosed acceleration in one lane: at its generalized speeds, if there are any.

    Raises:
        EomcheckError: it cannot be enclosed.
        TypeError: functions that cannot run in ball arithmetic.
    """
    at = case.at.alone(lane)
    if case.has_speeds:
        u: Any = case.at.u
        return true_acceleration(at.scene, at.q, u.data[lane], at.t)[0]
    return enclose(
        at.scene, REFERENCE_WITHOUT_SPEEDS, at.q, t=at.t, digits=REFERENCE_DIGITS, v=at.v
    )


def _at_truth(case: BatchedCase, truths: dict[int, Enclosure]) -> BatchEvaluation:
    """Return the lanes with a true acceleration, at its velocities, see `true_acceleration`."""
    lanes = list(truths)
    states = []
    for lane, truth in truths.items():
        q, v, t = case.at.state_of(lane)
        states.append(State(q, midpoints_or_zero(truth.v) if case.has_speeds else v, t))
    at = BatchEvaluation([case.at.scenes[lane] for lane in lanes], states)
    if case.has_speeds:
        u: Any = case.at.u
        at.u = BatchArray(u.data[lanes].copy())  # type: ignore[assignment]
    return at
