"""Claims evaluated on a batch of states at once, to screen states for suspicious ones.

Every number of the evaluation is an array over states (batch axis L, in machine code one SIMD lane
each). The sides of a claim are written once and evaluated on a batch as they are, and then on its
perturbed samples, by which the allowed difference is measured as in `Case`. Screening gives no
verdict: suspicious states, and claims that cannot be evaluated on a batch, have to be checked again
by `eomcheck.check_state`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.case import FloatContext
from eomcheck.claims.finding import (
    FAILED_CODE,
    INCONCLUSIVE_CODE,
    PASSED_CODE,
    SKIPPED_CODE,
    verdict_codes,
)
from eomcheck.claims.registry import CLAIMS, Claim, Comparison
from eomcheck.errors import RefusedError, described_error
from eomcheck.evaluation.evaluation import SPEEDS, Acceleration, BatchEvaluation
from eomcheck.evaluation.tolerance import allowed_error, larger, largest
from eomcheck.formulations import Formulation
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.batch_arrays import BatchArray, as_float64, batch_size
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import recording_solves

NOT_BATCHABLE = (TypeError, ValueError, AttributeError, IndexError, np.linalg.LinAlgError)
"""Exceptions of a claim that uses numbers in ways that a batch does not support."""


class NotBatchableError(TypeError):
    """A claim needs a quantity whose structure differs from state to state."""


class BatchResult(NamedTuple):
    """The result of a claim on a batch, about one subject.

    Attributes:
        claim: id of the claim.
        subject: the compared formulations or term.
        observed: errors (L,).
        allowed: bounds on the rounding errors (L,).
        verdict: `PASSED_CODE`, `FAILED_CODE` or `INCONCLUSIVE_CODE` (L,), or `ABSENT` if there is
            nothing to compare.
    """

    claim: str
    subject: str
    observed: Array
    allowed: Array
    verdict: Array

    @property
    def ratio(self) -> Array:
        """The ratio observed / allowed (L,) where the claim is decided, 0 elsewhere."""
        with np.errstate(all="ignore"):
            ratio = self.observed / self.allowed
        ratio = np.where(self.allowed > 0, ratio, np.where(self.observed > 0, np.inf, 0.0))
        ratio = np.where(np.isnan(ratio), np.inf, ratio)
        return np.where(np.isin(self.verdict, (PASSED_CODE, FAILED_CODE)), ratio, 0.0)


ABSENT = SKIPPED_CODE


@dataclass
class BatchedCase(FloatContext):
    """A batch of states of scenes of one structure, with the formulations to check; see `Case`.

    Attributes:
        at: the evaluation of all states.
        formulations: the formulations taking part.
        has_speeds: whether generalized speeds exist: in all lanes, or in none.
        not_batched: claims that cannot be evaluated on this batch -> reason.
    """

    at: BatchEvaluation
    formulations: tuple[Formulation, ...]
    has_speeds: bool
    not_batched: dict[str, str] = field(default_factory=dict)
    _solutions_used: bool = field(default=False, repr=False)

    @property
    def partitions(self) -> Iterator[tuple[str, Any]]:
        """The paper's partition alone: pivoted ones differ from lane to lane."""
        yield "em", self.at.partition

    @property
    def solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        """Formulations with their accelerations; NaN in lanes that are refused."""
        self._solutions_used = True
        return self._solutions

    @cached_property
    def _solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        able = (f for f in self.formulations if self.has_speeds or not f.in_speeds)
        return tuple((f, self.at.acceleration(f)) for f in able)

    def refused(self, key: str) -> Array:
        """Return the flags (L,) of lanes that a formulation refuses."""
        if (key, False) in self.at.refused:
            return self.at.refused[key, False]
        return np.ones(self.at.states, bool)

    @property
    def added_row(self) -> Any:
        """A redundant row, which a batch does not have.

        Raises:
            NotBatchableError: always.
        """
        raise NotBatchableError("which rows a further one depends on differs from state to state")

    # ---- Evaluation ------------------------------------------------------------------------------

    def evaluate(self, claims: Sequence[str]) -> list[BatchResult]:
        """Return the results of claims; those that cannot be evaluated go to `not_batched`."""
        results: list[BatchResult] = []
        with np.errstate(all="ignore"):
            for claim in claims:
                try:
                    results += list(self._evaluate(CLAIMS[claim]))
                except NOT_BATCHABLE as error:
                    explained = isinstance(error, NotBatchableError)
                    self.not_batched[claim] = str(error) if explained else described_error(error)
        return results

    def _evaluate(self, claim: Claim) -> Iterator[BatchResult]:
        if claim.id == "invariance":
            return self._invariance()
        assert claim.sides is not None
        return self._compare_sides(claim, claim.sides)

    def _compare_sides(self, claim: Claim, sides: Callable) -> Iterator[BatchResult]:
        measured = self.measuring(sides)
        self._solutions_used = False
        with recording_solves() as recorder:
            compared = list(sides(self.at, self))
        of_results = self._solutions_used
        refused = self.at.refused.get(SPEEDS, np.zeros(self.at.states, bool))
        refused = refused | recorder.refused_states(self.at.states)
        for one in compared:
            if not isinstance(one, Comparison):
                continue
            sensitivity = _of_lanes(one.sensitivity, self.at.states)
            size = 0.0 if one.size is None else _of_lanes(one.size, self.at.states)
            if sensitivity is None or np.isnan(sensitivity).any():
                own = _of_lanes(measured(one), self.at.states) + size
                sensitivity = (
                    own
                    if sensitivity is None
                    else np.where(np.isnan(sensitivity), own, sensitivity)
                )
            scale: Any = sensitivity if one.may_vanish else None if one.size is None else size
            absent = refused | self._refused_in(one.subject) if of_results else refused
            yield self.compare(claim, one, sensitivity, scale, absent)

    def _refused_in(self, subject: str) -> Array:
        """Return the flags (L,) of lanes refused by a formulation that the subject names."""
        named = {part for side in subject.split(" ~ ") for part in side.replace(",", " ").split()}
        absent = np.zeros(self.at.states, bool)
        for f, _ in self.solutions if named & {f.key for f in self.formulations} else ():
            if f.key in named:
                absent |= self.refused(f.key)
        return absent

    def compare(
        self,
        claim: Claim,
        sides: Comparison,
        sensitivity: Array,
        scale: Array | None,
        absent: Array,
    ) -> BatchResult:
        """Return the result of actual = expected; see `Case.compare`."""
        lanes = self.at.states
        actual, expected = as_float64(sides.actual), as_float64(sides.expected)
        observed = _of_lanes(largest(actual - expected), lanes)
        size = _of_lanes(largest(expected), lanes)
        scale = np.broadcast_to(size if scale is None else scale, (lanes,))
        allowed = allowed_error(1.0) * np.broadcast_to(sensitivity, (lanes,))
        verdict = verdict_codes(observed, allowed, scale)
        verdict = np.where(np.isfinite(size), verdict, INCONCLUSIVE_CODE)
        # Sides that depend on a refused result are NaN. Sides without lanes are flags of results,
        # and mean nothing where these are refused.
        present = np.isfinite(observed) & bool(batch_size((sides.actual, sides.expected)))
        verdict = np.where(absent & ~present, ABSENT, verdict)
        return BatchResult(claim.id, sides.subject, observed, allowed, verdict)

    def _invariance(self) -> Iterator[BatchResult]:
        at, claim = self.at, CLAIMS["invariance"]
        by_name: dict[str, list[Any]] = {}
        own = [at.state_of(i) for i in range(at.states)]
        for scene, state in zip(at.scenes, own, strict=True):
            for symmetry in scene.symmetries(state.q, state.v):
                by_name.setdefault(symmetry.name, []).append(symmetry)
        for name, each in by_name.items():
            if len(each) < at.states:
                continue
            states = [State(s.q, s.v, x.t) for s, x in zip(each, own, strict=True)]
            there = BatchEvaluation([s.scene for s in each], states)
            there.conditions = False
            image = BatchArray(np.stack([s.image for s in each]))
            size = largest(np.abs(image).sum(axis=1))
            turn = 1.0 + largest(there.q - at.q) / larger(largest(at.q), 1.0)
            for f, x in self.solutions:
                actual = there.acceleration(f).vdot
                sides = Comparison(f"{name}: {f.key}", actual, image @ x.vdot, ())
                absent = self.refused(f.key) | there.refused[f.key, False]
                of_vdot = self.part_sensitivity(f, "vdot", coordinates=True)
                sensitivity = (2 * size * turn * of_vdot).data
                yield self.compare(claim, sides, sensitivity, None, absent)


def _of_lanes(x: Any, lanes: int) -> Any:
    """Return one number per lane (L,), None for None."""
    if x is None:
        return None
    return np.broadcast_to(x.data if batch_size(x) else np.asarray(x, np.float64), (lanes,))


def batchable_claims(claims: Sequence[str]) -> tuple[str, ...]:
    """Return the claims that can be evaluated on a batch: those with sides and without engines."""

    def batchable(claim: Claim) -> bool:
        return claim.batchable and claim.sides is not None and not claim.against

    return tuple(id for id in claims if id == "invariance" or batchable(CLAIMS[id]))


def batched_cases(
    cases: Sequence[tuple[Scene, State]], formulations: Sequence[Formulation]
) -> Iterator[tuple[Array, BatchedCase]]:
    """Group cases into batches of one structure, with generalized speeds in all states or in none.

    Yields the indices of a batch in `cases` (L,), and the batch.
    """
    groups: dict[Any, list[int]] = {}
    for i, (scene, state) in enumerate(cases):
        try:
            scene.refuse_speeds(state.q)
            has_speeds = True
        except RefusedError:
            has_speeds = False
        groups.setdefault((type(scene), scene.structure, has_speeds), []).append(i)
    for (_, _, has_speeds), indices in groups.items():
        at = BatchEvaluation([cases[i][0] for i in indices], [cases[i][1] for i in indices])
        able = tuple(f for f in formulations if f.applies_to(at.scene))
        yield np.array(indices), BatchedCase(at, able, has_speeds)
