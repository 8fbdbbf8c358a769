"""Claims at many states at once: a batch, which screens states and does not judge.

A claim that yields both of its sides is evaluated in SIMD lanes, one state a lane, as it is
written; the difference that its sides are allowed is measured as `Case` measures it. A state that
looks bad is to be checked again by `eomcheck.check_state`, and so are claims that cannot be
evaluated in lanes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np

from eomcheck.claims.finding import FAILED_CODE, INCONCLUSIVE_CODE, PASSED_CODE, verdict_codes
from eomcheck.claims.registry import CLAIMS, Claim, Comparison, FloatContext
from eomcheck.errors import RefusedError, described_error
from eomcheck.evaluation.batched_evaluation import (
    LaneEvaluation,
    acceleration_sensitivity_in_lanes,
    largest_in,
    sensitivity_in_lanes,
    speeds_resolved_in_lanes,
)
from eomcheck.evaluation.evaluation import SPEEDS, Acceleration
from eomcheck.evaluation.tolerance import allowed_error, larger, largest
from eomcheck.formulations import Formulation
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.lanes import LaneArray, as_float64, lanes_in
from eomcheck.numbers.linear import recording_solves
from eomcheck.numbers.noise import SAMPLES

NOT_BATCHABLE = (TypeError, ValueError, AttributeError, IndexError, np.linalg.LinAlgError)
"""What a claim raises that asks of numbers what lanes cannot say."""


class NotBatchableError(TypeError):
    """A claim asks for what each state has in its own way."""


class BatchResult(NamedTuple):
    """What a claim came to in lanes, about one subject.

    Attributes:
        claim: its id.
        subject: what it is about.
        observed: errors (L,).
        allowed: what rounding explains (L,).
        verdict: `PASSED_CODE`, `FAILED_CODE` or `INCONCLUSIVE_CODE` (L,), or `ABSENT` where there
            is nothing.
    """

    claim: str
    subject: str
    observed: Array
    allowed: Array
    verdict: Array

    @property
    def ratio(self) -> Array:
        """Observed / allowed (L,) where it is decided, 0 elsewhere."""
        with np.errstate(all="ignore"):
            found = self.observed / self.allowed
        found = np.where(self.allowed > 0, found, np.where(self.observed > 0, np.inf, 0.0))
        found = np.where(np.isnan(found), np.inf, found)
        return np.where(np.isin(self.verdict, (PASSED_CODE, FAILED_CODE)), found, 0.0)


ABSENT = 0


@dataclass
class BatchedCase(FloatContext):
    """States of scenes of one structure, with the formulations to look at; see `Case` and `Look`.

    Attributes:
        at: the evaluation in lanes.
        formulations: those that take part.
        has_speeds: whether generalized speeds exist: in all lanes, or in none.
        not_batched: claims that cannot be told in lanes here, and why.
    """

    at: LaneEvaluation
    formulations: tuple[Formulation, ...]
    has_speeds: bool
    not_batched: dict[str, str] = field(default_factory=dict)
    _solutions_used: bool = field(default=False, repr=False)

    @cached_property
    def speeds_resolved(self) -> LaneArray:
        """Where generalized speeds by a partition are more than rounding."""
        return LaneArray(speeds_resolved_in_lanes(self.at))

    @property
    def directions(self) -> Array:
        """The coordinates in turn (n, n), of literals."""
        return np.eye(self.at.scene.n, dtype=object)

    @property
    def partitions(self) -> Iterator[tuple[str, Any]]:
        """The paper's partition: pivoted ones differ from lane to lane."""
        yield "em", self.at.partition

    @property
    def solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        """What the formulations say; NaN in lanes that are refused."""
        self._solutions_used = True
        return self._solutions

    @cached_property
    def _solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        able = (f for f in self.formulations if self.has_speeds or not f.in_speeds)
        return tuple((f, self.at.acceleration(f)) for f in able)

    def refused(self, key: str) -> Array:
        """Return where a formulation refuses (L,)."""
        if (key, False) in self.at.refused:
            return self.at.refused[key, False]
        return np.ones(self.at.lanes, bool)

    def sensitivity(self, quantity: Callable[[Any], Any], batched: bool = False) -> LaneArray:
        """Return κ · scale of a quantity; 0 of a copy, of which sides count and nothing else.

        In lanes each copy is asked for itself, whether or not they have it `merged_body`.
        """
        copied, at = self.at.is_perturbed, self.at
        return LaneArray(np.zeros(at.lanes) if copied else sensitivity_in_lanes(at, quantity))

    def part_sensitivity(self, formulation: Formulation, part: str) -> LaneArray:
        """Return κ · scale of a part of the result of `formulation`."""
        key = (formulation.key, part, False)
        if key not in self._sensitivities:
            found = acceleration_sensitivity_in_lanes(self.at, formulation, part)
            self._sensitivities[key] = found
        return LaneArray(self._sensitivities[key])

    @cached_property
    def _sensitivities(self) -> dict[tuple[str, str, bool], Array]:
        return {}

    @property
    def added_row(self) -> Any:
        """None.

        Raises:
            NotInLanesError: always.
        """
        raise NotBatchableError("which rows a further one depends on differs from state to state")

    # ---- Looking ---------------------------------------------------------------------------------

    def evaluate(self, claims: Sequence[str]) -> list[BatchResult]:
        """Return what claims come to; those that lanes cannot tell are added to `not_batched`."""
        found: list[BatchResult] = []
        with np.errstate(all="ignore"):
            for one in claims:
                try:
                    found += list(self._evaluate(CLAIMS[one]))
                except NOT_BATCHABLE as error:
                    said = isinstance(error, NotBatchableError)
                    self.not_batched[one] = str(error) if said else described_error(error)
        return found

    def _evaluate(self, claim: Claim) -> Iterator[BatchResult]:
        if claim.id == "invariance":
            return self._invariance()
        assert claim.sides is not None
        return self._compare_sides(claim, claim.sides)

    def _compare_sides(self, claim: Claim, sides: Callable) -> Iterator[BatchResult]:
        @cache
        def perturbed(e: Any) -> dict[str, Comparison]:
            found: dict[str, Comparison] = {}
            here = BatchedCase(e, self.formulations, self.has_speeds)
            with e.computing("sides"), e.recording_solves(), suppress(RefusedError):
                for one in sides(e, here):
                    found[one.subject] = one
            return found

        def measured(here: Comparison, side: str) -> Array:
            def quantity(e: Any) -> Any:
                one = here if e is self.at else perturbed(e).get(here.subject)
                if not isinstance(one, Comparison):
                    raise np.linalg.LinAlgError(f"{here.subject} does not exist nearby")
                return getattr(one, side)

            return sensitivity_in_lanes(self.at, quantity)

        self._solutions_used = False
        with recording_solves() as watch:
            here = list(sides(self.at, self))
        of_results = self._solutions_used
        refused = self.at.refused.get(SPEEDS, np.zeros(self.at.lanes, bool))
        refused = np.any([refused, *watch.refused], axis=0)
        for one in here:
            if not isinstance(one, Comparison):
                continue
            given = _of_lanes(one.sensitivity, self.at.lanes)
            size = 0.0 if one.size is None else _of_lanes(one.size, self.at.lanes)
            if given is None or np.isnan(given).any():
                sensitivity = measured(one, "actual") + measured(one, "expected") + size
                given = (
                    sensitivity if given is None else np.where(np.isnan(given), sensitivity, given)
                )
            scale: Any = given if one.may_vanish else None if one.size is None else size
            absent = refused | self._refused_in(one.subject) if of_results else refused
            yield self.compare(claim, one, given, scale, absent)

    def _refused_in(self, subject: str) -> Array:
        """Return where a subject is about a formulation that refuses (L,)."""
        named = {part for side in subject.split(" ~ ") for part in side.replace(",", " ").split()}
        absent = np.zeros(self.at.lanes, bool)
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
        """Return what found = expected comes to; see `Case.compare`."""
        lanes = self.at.lanes
        found, expected = as_float64(sides.actual), as_float64(sides.expected)
        observed = largest_in(found - expected, lanes)
        size = largest_in(expected, lanes)
        scale = size if scale is None else np.broadcast_to(scale, (lanes,))
        allowed = allowed_error(1.0) * np.broadcast_to(sensitivity, (lanes,))
        verdict = verdict_codes(observed, allowed, scale)
        verdict = np.where(np.isfinite(size), verdict, INCONCLUSIVE_CODE)
        # What depends on a result that is refused is NaN; what needs none is told of results alone.
        told = np.isfinite(observed) & bool(lanes_in((sides.actual, sides.expected)))
        verdict = np.where(absent & ~told, ABSENT, verdict)
        return BatchResult(claim.id, sides.subject, observed, allowed, verdict)

    def _invariance(self) -> Iterator[BatchResult]:
        at, claim = self.at, CLAIMS["invariance"]
        moved: dict[str, list[Any]] = {}
        q, v = at.q.data.T, at.v.data.T  # type: ignore[attr-defined]
        for lane, scene in enumerate(at.scenes):
            for symmetry in scene.symmetries(q[lane], v[lane]):
                moved.setdefault(symmetry.name, []).append(symmetry)
        for name, each in moved.items():
            if len(each) < at.lanes:
                continue
            t = at.t.data if isinstance(at.t, LaneArray) else np.full(at.lanes, at.t)
            states = [State(s.q, s.v, float(x)) for s, x in zip(each, t, strict=True)]
            there = LaneEvaluation([s.scene for s in each], states)
            there.conditions = False
            image = LaneArray(np.stack([s.image for s in each], axis=-1))
            size = largest(np.abs(image).sum(axis=1))
            turn = 1.0 + largest(there.q - at.q) / larger(largest(at.q), 1.0)
            for f, x in self.solutions:
                found = there.acceleration(f).vdot
                sides = Comparison(f"{name}: {f.key}", found, image @ x.vdot, ())
                absent = self.refused(f.key) | there.refused[f.key, False]
                # More noise only allows more: what passes by the first passes by all.
                for samples in (1, SAMPLES):
                    of_vdot = self._moved_sensitivity(f, samples)
                    sensitivity = (2 * size * turn * of_vdot).data
                    outcome = self.compare(claim, sides, sensitivity, None, absent)
                    if np.isin(outcome.verdict, (PASSED_CODE, ABSENT)).all():
                        break
                yield outcome

    def _moved_sensitivity(self, formulation: Formulation, samples: int) -> LaneArray:
        """Return κ · scale of v̇, coordinates perturbed too, by so many samples of noise."""
        key = (formulation.key, f"vdot by {samples}", True)
        if key not in self._sensitivities:
            self._sensitivities[key] = acceleration_sensitivity_in_lanes(
                self.at, formulation, coordinates=True, samples=samples
            )
        return LaneArray(self._sensitivities[key])


def _of_lanes(x: Any, lanes: int) -> Any:
    """Return a number a lane (L,), None for None."""
    if x is None:
        return None
    return np.broadcast_to(x.data if lanes_in(x) else np.asarray(x, np.float64), (lanes,))


def batchable_claims(claims: Sequence[str]) -> tuple[str, ...]:
    """Return those of `claims` that may be looked at in lanes: by sides, without an engine."""
    return tuple(
        one
        for one in claims
        if one == "invariance" or (CLAIMS[one].sides is not None and not CLAIMS[one].against)
    )


def batched_cases(
    cases: Sequence[tuple[Scene, State]], formulations: Sequence[Formulation]
) -> Iterator[tuple[Array, BatchedCase]]:
    """Yield the places of cases that go side by side, and these.

    They have one structure, and generalized speeds in all of them or in none.
    """
    groups: dict[Any, list[int]] = {}
    for i, (scene, state) in enumerate(cases):
        try:
            scene.refuse_speeds(state.q)
            has_speeds = True
        except RefusedError:
            has_speeds = False
        groups.setdefault((type(scene), scene.structure, has_speeds), []).append(i)
    for (_, _, has_speeds), places in groups.items():
        at = LaneEvaluation([cases[i][0] for i in places], [cases[i][1] for i in places])
        able = tuple(f for f in formulations if f.applies_to(at.scene))
        yield np.array(places), BatchedCase(at, able, has_speeds)
