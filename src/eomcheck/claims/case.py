"""A `Case`: one state in float64, in which claims are evaluated and compared with engines.

A claim passes if its sides differ by no more than the rounding error that perturbation analysis
bounds. An engine is either built-in, a reference for the scene: `actual` is then the scene's value.
Or it is under test, supplied by a user: `actual` is then the engine's answer, `expected` the
reference, and its method is called repeatedly, since each of its answers has to be right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any, ClassVar

import numpy as np

from eomcheck.calls import is_ours
from eomcheck.claims.confusions import NO_CONTEXT, SINGLE_PRECISION, ConfusionContext, locate
from eomcheck.claims.finding import Entries, Finding, entries_of, format_distinct, judge
from eomcheck.claims.own_coordinates import map_fault
from eomcheck.claims.registry import (
    CLAIMS,
    Claim,
    Comparison,
    Names,
    names_of_term,
    term_of,
)
from eomcheck.claims.user_scenes import (
    failing_function,
    scene_function_that_raised,
    undefined_result,
)
from eomcheck.engines import (
    Answers,
    Engine,
    EngineFault,
    engine_class_of,
    is_under_test,
    make_engine,
    version_of,
)
from eomcheck.engines.answers import (
    drift_size,
    inertia_size,
    mass_size,
    overflows,
    own_input_sizes,
    turning_size,
    weight_size,
)
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Acceleration, Evaluation, RoundedEvaluation
from eomcheck.evaluation.perturbed import (
    PerturbedEvaluation,
    acceleration_sensitivity,
    entry_sensitivity_of,
    measured_sensitivity,
    perturbed_samples,
    sensitivity_of,
    solution_of,
    speeds_resolved,
)
from eomcheck.evaluation.tolerance import INCONCLUSIVE, UNIT_ROUNDOFF, allowed_error, largest
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.records import State
from eomcheck.numbers.batch_arrays import batch_size
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import column_scale

OFTEN, ONCE = 90, 1
"""Number of repeated calls of an engine under test for each answer: at the first state checked and
the first drawn, and at other states. Repeated calls reveal engines that count or accumulate."""


def _rounded_evaluations(at: Evaluation) -> dict[Any, RoundedEvaluation]:
    """Return the evaluations at a state that were rounded, by unit roundoff and sizes."""
    return {}


class FloatContext:
    """The part of an evaluation context that one state in float64 and a batch of states share.

    Attributes:
        at: the evaluation, of a state, of a batch of states, or of the perturbed samples of either.
        formulations: the formulations taking part.
    """

    at: Any
    formulations: tuple[Formulation, ...]
    exact: ClassVar[bool] = False
    others: ClassVar[tuple] = ()

    @property
    def free(self) -> Any:
        """The states themselves: their velocities are independent inputs."""
        return self.at

    @property
    def directions(self) -> Array:
        """The coordinates in turn (n, n); of literals, if they are to multiply a batch."""
        return np.eye(self.at.scene.n, dtype=object if batch_size(self.at.q) else np.float64)

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.at.scene.coordinate_names

    @cached_property
    def speeds_resolved(self) -> Any:
        """Whether generalized speeds by a partition exceed their rounding error."""
        self.at.speeds  # noqa: B018  (the linear solves recorded for them are needed)
        return speeds_resolved(self.at)

    def sensitivity(self, quantity: Callable[[Any], Any]) -> Any:
        """Return κ · scale of a quantity; 0 for perturbed samples, whose sides alone matter."""
        return 0.0 if self.at.is_perturbed else sensitivity_of(self.at, quantity)

    def part_sensitivity(
        self, formulation: Formulation, part: str, *, coordinates: bool = False
    ) -> Any:
        """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`."""
        key = (formulation.key, part, coordinates)
        if key not in self.at.sensitivities:
            self.at.sensitivities[key] = acceleration_sensitivity(
                self.at, formulation, part, coordinates=coordinates
            )
        return self.at.sensitivities[key]

    def vdot_sensitivity(self, formulation: Formulation) -> Any:
        """Return κ · scale of v̇ by `formulation`."""
        return self.part_sensitivity(formulation, "vdot")

    def multiplier_sensitivity(self, formulation: Formulation) -> Any:
        """Return κ · scale of λ by `formulation`."""
        return self.part_sensitivity(formulation, "multipliers")

    def measuring(self, sides: Callable) -> Callable[[Comparison], Any]:
        """Return the function that measures κ · scale of both sides of a comparison.

        `sides` are evaluated once on all perturbed samples, when they are first needed.
        """

        @cache
        def perturbed() -> dict[str, Comparison]:
            samples, comparisons = perturbed_samples(self.at), {}
            # Linear solves within sides are perturbed like those of formulations.
            with (
                samples.computing("sides"),
                samples.recording_solves(),
                suppress(RefusedError, np.linalg.LinAlgError),
            ):
                for one in sides(samples, replace(self, at=samples)):  # type: ignore[type-var]
                    comparisons[one.subject] = one
            return comparisons

        def measured(exact: Comparison) -> Any:
            nearby = perturbed().get(exact.subject)
            if not isinstance(nearby, Comparison):
                return np.inf
            return measured_sensitivity(
                self.at, exact.actual, nearby.actual
            ) + measured_sensitivity(self.at, exact.expected, nearby.expected)

        return measured


@dataclass
class Case(FloatContext):
    """One state of a scene, with the formulations and engines to check.

    Attributes:
        at: the evaluation at the state.
        formulations: the formulations taking part.
        engines: engines constructed for this very scene.
        claim: the claim being checked.
        unavailable: engines that could not be constructed -> error message.
        repeats: number of repeated calls of engines under test for each answer.
        unrounded: the state before it was rounded to the numbers of an engine, None if it was not.
    """

    at: Evaluation
    formulations: tuple[Formulation, ...]
    engines: tuple[Engine, ...]
    claim: Claim | None = None
    unavailable: dict[type[Engine], str] = field(default_factory=dict)
    repeats: int = OFTEN
    unrounded: State | None = None

    def rounded_for(self, engine: Engine | type[Engine]) -> Case:
        """Return the case at the state that an engine computes: itself where it is float64.

        Inputs are rounded to the engine's numbers (`eomcheck.engines.engine`, rule 8). Findings
        name the state before, whose velocities are consistent.
        """
        kind = engine_class_of(engine)
        if kind.unit_roundoff <= self.at.unit_roundoff:
            return self  # of float64, or rounded already
        # What rounding of its own coordinates adds is that of one engine.
        key: Any = kind if kind.offers("velocity_map") else kind.unit_roundoff
        if key not in self._rounded:
            at = self._rounded_evaluation(engine, kind.unit_roundoff)
            self._rounded[key] = replace(self, at=at, unrounded=self.state)
        case = self._rounded[key]
        case.claim = self.claim
        return case

    @cached_property
    def _rounded(self) -> dict[Any, Case]:
        return {}

    def _rounded_evaluation(
        self, engine: Engine | type[Engine], unit_roundoff: float
    ) -> RoundedEvaluation:
        """Return the evaluation at the rounded state, the same one for engines of equal sizes."""
        at, sizes = RoundedEvaluation(self.at.scene, self.state, unit_roundoff), None
        if isinstance(engine, Engine):
            with suppress(*UNABLE):
                sizes = own_input_sizes(engine, at.q, at.v)
        at.input_sizes = sizes
        key = unit_roundoff, *(x.tobytes() for x in sizes or ())
        return self.at.cached(_rounded_evaluations).setdefault(key, at)

    @property
    def state(self) -> State:
        """The state (q, v, t)."""
        return State(self.at.q, self.at.v, self.at.t)

    @cached_property
    def terms_failure(self) -> Finding | None:
        """The Finding that the scene's terms cannot be computed at this state, or None."""
        try:
            self.at.terms  # noqa: B018
        except Exception as error:
            return replace(self, claim=CLAIMS["finite-terms"]).error_finding(error)
        return None

    @property
    def claim_engines(self) -> tuple[Engine | type[Engine], ...]:
        """The engines that offer the method of the claim, or could not be constructed.

        Engines under test are always included, so that a missing method is reported.
        """
        assert self.claim is not None
        asks = self.claim.asks
        return tuple(
            one
            for one in (*self.engines, *self.unavailable)
            if one.offers(asks) or is_under_test(engine_class_of(one))
        )

    @cached_property
    def finite(self) -> bool:
        """Whether every term is a finite number; only then other claims can be checked."""
        return all(np.isfinite(term).all() for term in self.at.terms if term is not None)

    @cached_property
    def refused(self) -> tuple[str, ...]:
        """The formulations that refuse this state."""
        return tuple(f.key for f in self.formulations if f not in self.solved)

    @cached_property
    def solved(self) -> tuple[Formulation, ...]:
        """The formulations that do not refuse this state."""
        return tuple(f for f, _ in self.solutions)

    def result(self, formulation: Formulation) -> Acceleration | None:
        """Return the acceleration by a formulation, or None if it is refused."""
        if formulation.key not in self._results:
            self._results[formulation.key] = None
            with suppress(RefusedError):
                perturbed = self.at.is_perturbed
                self._results[formulation.key] = (
                    self.at.acceleration(formulation)
                    if perturbed
                    else solution_of(self.at, formulation)
                )
        return self._results[formulation.key]

    @cached_property
    def _results(self) -> dict[str, Acceleration | None]:
        return {}

    # ---- Evaluation context in float64, see `EvaluationContext` ----------------------------------

    @cached_property
    def has_speeds(self) -> bool:
        """Whether generalized speeds exist at this state."""
        with suppress(RefusedError):
            return self.at.speeds is not None
        return False

    @property
    def partitions(self) -> Iterator[tuple[str, Partition]]:
        """Names and partitions: the paper's and the pivoted one."""
        yield "em", self.at.partition
        yield "em, pivoted", self.at.pivoted_partition

    @property
    def added_row(self) -> tuple[Array, Partition]:
        """Weights of a redundant row, and its partition.

        The row is the alternating sum of the independent constraints, scaled to one size. The last
        of these is left out as the one that follows from the others.
        """
        at = self.at.original if isinstance(self.at, PerturbedEvaluation) else self.at
        a, partition = at.terms.a, at.independent_partition
        kept = np.arange(len(a)) if partition.kept is None else partition.kept
        weights = np.zeros(len(a))
        weights[kept] = column_scale(a.T)[kept] * (-1.0) ** np.arange(len(kept))
        others = () if partition.redundant is None else partition.redundant
        rows = np.append(kept[:-1], len(a)), np.append(others, kept[-1:]).astype(int)
        return weights, partition._replace(kept=rows[0], redundant=rows[1])

    @property
    def solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        """Formulations that do not refuse, each with its acceleration."""
        results = ((f, self.result(f)) for f in self.formulations)
        return tuple((f, x) for f, x in results if x is not None)

    # ---- Findings --------------------------------------------------------------------------------

    def evaluate(self, claim: Claim) -> list[Finding]:
        """Return the Findings of one claim."""
        self.claim = claim
        findings: list[Finding] = []
        with np.errstate(all="ignore"):
            try:
                findings.extend(self._evaluate(claim))
            except Exception as error:
                findings.append(self.error_finding(error))
        return findings

    def _evaluate(self, claim: Claim) -> Iterator[Finding]:
        if claim.check is not None:
            return claim.check(self)
        if claim.against:
            return self._against_engines(claim.against, claim.asks)
        return iter(()) if claim.sides is None else self._compare_sides(claim.sides)

    def error_finding(self, error: Exception) -> Finding:
        """Return the Finding on a scene function that raised or returned an array of wrong shape.

        It is a failure if the function does not run on float64; it need not support other numbers.

        Raises:
            Exception: the error itself, if no user-supplied scene function caused it.
        """
        origin = scene_function_that_raised(self.at.scene, error)
        broken = failing_function(self.at.scene, self.state)
        if not (origin or broken):
            raise error
        if broken:
            outcome = float("inf"), 0.0, "failed", "property-tested", broken
        else:
            outcome = 0.0, 0.0, "skipped", "property-tested", f"not rational: {origin}"
        return self.finding("functions", *outcome)

    def _compare_sides(self, sides: Callable) -> Iterator[Finding]:
        """Yield the Findings of the sides of a claim being equal up to rounding."""

        measured = self.measuring(sides)
        for one in sides(self.at, self):
            if isinstance(one, Comparison):
                sensitivity = one.sensitivity
                if sensitivity is None:
                    sensitivity = measured(one) + (one.size or 0.0)
                scale: Any = sensitivity if one.may_vanish else one.size
                arguments: tuple[Any, ...] = one.subject, one.actual, one.expected, sensitivity
                entrywise = one.size is None or one.sizes is not None
                how = {"scale": scale, "sizes": one.sizes, "entrywise": entrywise}
                how["context"] = one.context
                yield self.compare(*arguments, names=one.names, **how)

    def _against_engines(self, term: str, method: str) -> Iterator[Finding]:
        """Yield the Findings of a term being equal to the result of each engine."""
        for engine in self.claim_engines:
            yield from self.rounded_for(engine)._against_engine(engine, term, method)

    def _against_engine(
        self, engine: Engine | type[Engine], term: str, method: str
    ) -> Iterator[Finding]:
        """Yield the Findings of a term being equal to the result of an engine."""

        def quantity(e: Evaluation) -> Any:
            array = term_of(e, term)
            return np.zeros(np.shape(theirs)) if array is None else array

        known = term_of(self.at, term)
        absent = known is None
        expected = 0.0 if absent else known
        state = (self.at.q, self.at.v, self.at.t)
        theirs = ask_engine(self, engine, *state, expected=lambda: expected)
        if isinstance(theirs, Finding) or isinstance(engine, type):
            if not absent or theirs.verdict == "failed":
                yield theirs
            return
        if absent and not np.any(theirs):
            return  # neither the scene nor the engine has this term
        ours = quantity(self.at)
        key = term, "term", True
        if key not in self.at.sensitivities:
            self.at.sensitivities[key] = sensitivity_of(self.at, quantity, coordinates=True)
        # A term of size 0 (B at rest) is compared too: it should vanish.
        scale = self.at.sensitivities[key] + cancelling_size(self, engine, method)
        scale += turning_size(self.at) if method == "bias" else 0.0
        compared = self, engine, engine.key, ours, theirs, scale
        again = partial(_asked_again, method, state)
        names = names_of_term(self.at.scene, term)
        # No sum over bodies has larger terms in the entry of two coordinates.
        roots = np.sqrt(np.abs(np.diagonal(np.atleast_2d(np.asarray(ours)))))
        sizes = np.outer(roots, roots) if term == "M" else None
        own = partial(entry_sensitivity_of, self.at, quantity)
        yield compare_with_engine(*compared, again, names=names, scale=scale, sizes=sizes, own=own)

    def compare(
        self,
        subject: str,
        actual: Any,
        expected: Any,
        sensitivity: float,
        *,
        names: Names,
        scale: Any = None,
        sizes: Any = None,
        own: Callable[[], Array] | None = None,
        entrywise: bool = True,
        evidence: str = "property-tested",
        engine: type[Engine] | None = None,
        context: Callable[[], ConfusionContext] | None = None,
    ) -> Finding:
        """Return the Finding of actual = expected.

        Args:
            subject: name of the compared quantity.
            actual: the quantity under test.
            expected: its expected value, same shape.
            sensitivity: κ · scale, the sum over both computations.
            names: names along each axis.
            scale: size of the quantity, by default the largest entry of `expected`.
            sizes: sizes of the summed terms of each entry, if known.
            own: returns κ · scale of each entry of `expected`, for an engine under test.
            entrywise: whether entries have sizes of their own, see `eomcheck.claims.finding`.
            evidence: level of evidence and its basis.
            engine: the engine that is compared with, if any.
            context: returns further arrays by which confusions are recognized.
        """
        assert self.claim is not None
        actual, expected = np.asarray(actual, np.float64), np.asarray(expected, np.float64)
        observed = largest(actual - expected)
        scale = largest(expected) if scale is None else scale
        unit_roundoff = self.at.unit_roundoff
        allowed, verdict = judge(observed, sensitivity, scale, unit_roundoff)
        if not np.isfinite(expected).all():
            verdict = "inconclusive"  # nothing to compare with
        detail = ""
        if verdict == "failed":
            known = NO_CONTEXT if context is None else context()
            difference = locate(actual, expected, names, allowed, known)
            what = difference.text if actual.ndim else ""
            if engine is not None and is_under_test(engine):
                what = describe_engine_error(engine, actual, expected, allowed, known)
            detail = f"{self.claim.term}, {difference.where}" + (f": {what}" if what else "")
        outcome = subject, observed, allowed, verdict, evidence, detail
        finding = self.finding(*outcome, engine=engine)
        entrywise = entrywise and (sizes is not None or bool(np.any(expected)))
        if verdict == "failed" and names:
            # Wrong entries are resolved; whether others are hidden is left open by a failure.
            wrong = ~(np.abs(actual - expected) <= allowed)
            return replace(finding, entries=entries_of(names, wrong, np.zeros_like(wrong)))
        if not names or not entrywise:
            return finding  # a vanishing array has no size of its own
        entries = _resolved(actual, expected, allowed, names, sizes, False)
        under_test = engine is not None and is_under_test(engine)
        # Beside a reference, entries are hidden until they are proved, if the claim can be.
        known_by_scene = under_test or (own is not None and not self.claim.proved)
        if known_by_scene and entries.count_hidden:
            # Entries of the scene that should be 0 are so up to the rounding of their own terms.
            ours = expected if under_test else actual
            unit = allowed_error(1.0, unit_roundoff)
            zero = np.abs(ours) <= (0.0 if own is None else unit * own())
            entries = _resolved(actual, expected, allowed, names, sizes, zero)
        hidden = entries.count_hidden if verdict == "passed" else 0
        what = f"{hidden} of {actual.size} entries not resolved"
        return replace(finding, entries=entries, detail=what if hidden else detail)

    def finding(self, subject: str, *outcome: Any, engine: type[Engine] | None = None) -> Finding:
        """Return a Finding about this state.

        Args:
            subject: name of the compared quantity.
            outcome: further fields of `Finding`, from `observed` on.
            engine: the engine compared with; the Finding names it only if it is under test, not
                if it is a reference.
        """
        assert self.claim is not None
        state = self.state if self.unrounded is None else self.unrounded
        finding = Finding(self.claim.id, subject, self.at.scene, state, *outcome)
        under_test = engine is not None and is_under_test(engine)
        return replace(finding, engine=engine) if under_test else finding


def _asked_again(method: str, state: tuple[Array, Array, float], answers: Answers) -> Any:
    return answers.ask(method, *state)


def _resolved(
    actual: Array, expected: Array, allowed: float, names: Names, sizes: Any, zero: Any
) -> Entries:
    """Return the flags of resolved and hidden entries of two sides.

    Args:
        actual: the quantity under test.
        expected: its expected value, same shape.
        allowed: the error that is allowed in every entry.
        names: names along each axis.
        sizes: sizes of the summed terms of each entry, None if unknown.
        zero: flags of entries that should be 0, and are so up to rounding: they have passed.
    """
    own = np.maximum(np.abs(actual), np.abs(expected))
    size = own if sizes is None else np.maximum(own, sizes)
    there = (size > 0.0) & ~np.asarray(zero)
    # An entry that agrees relative to its own size is resolved, whatever the largest one allows.
    agree = (own > 0.0) & (np.abs(actual - expected) <= INCONCLUSIVE * own)
    known = agree | (allowed <= INCONCLUSIVE * size)
    return entries_of(names, there & known, there & ~known)


# ---- Answers of engines --------------------------------------------------------------------------

UNABLE = (np.linalg.LinAlgError, EngineFault)

BETWEEN = 0.25
"""Share of the repeated calls that follow a call at another state."""


def cancelling_size(case: Case, engine: Engine, method: str) -> float:
    """Return the size of the terms that an engine may sum to an answer in which they cancel."""
    if method == "bias":
        own = 0.0 if is_under_test(engine_class_of(engine)) else engine.bias_size(*case.state)
        return inertia_size(case.at) + own
    if method == "forces":
        return case.at.cached(weight_size)
    if method == "constraint_drift":
        return drift_size(case.at)
    if method != "mass_matrix" or not engine.offers("velocity_map"):
        return 0.0
    try:
        S = Answers(engine).velocity_map(case.at.q, np.zeros_like(case.at.v)).S
        return mass_size(case.at, S)
    except UNABLE:
        return 0.0


def ask_engine(
    case: Case,
    engine: Engine | type[Engine],
    *arguments: Any,
    expected: Callable[[], Any],
    part: Callable[[Any], Any] = lambda answer: answer,
    excused: Callable[[], bool] = lambda: False,
    asks: str = "",
    most_repeats: int = OFTEN,
) -> Any:
    """Return the engine's answer to the method of the claim, or the Finding that there is none.

    An engine under test is called repeatedly; its answer furthest from the scene's is returned.
    With no repeats it is called once, as a built-in one.

    Args:
        case: the state, and the claim being checked.
        engine: the engine, or its class if it could not be constructed.
        arguments: arguments of its method.
        expected: returns the expected value of `part`; None if it is unknown at this state.
        part: returns the compared quantity of an answer; None if the answer lacks it.
        excused: returns whether no answer could be judged at this state.
        asks: name of the method of `Answers`, by default that of the claim.
        most_repeats: largest number of repeated calls, where the case has more.
    """
    assert case.claim is not None
    method, kind = asks or case.claim.asks, engine_class_of(engine)
    if not kind.offers(case.claim.asks):
        return skipped_finding(case, kind, f"it does not offer {case.claim.asks}")
    if isinstance(engine, type) and not is_under_test(engine):
        return skipped_finding(case, engine, f"not rational: {case.unavailable[engine]}")
    try:
        if isinstance(engine, type):
            raise EngineFault(case.unavailable[engine])
        answers = Answers(engine)
        if is_under_test(kind) and case.repeats:
            answers.provoke_stale_answers(method, *arguments)
            repeated = _answered(answers, method, arguments, min(case.repeats, most_repeats))
            known = expected()
            return _worst(repeated, part, part(repeated[0]) if known is None else known)
        return answers.ask(method, *arguments)
    except EngineFault as fault:
        if isinstance(fault.__cause__, np.linalg.LinAlgError) and not is_under_test(kind):
            return skipped_finding(case, kind, fault.what)
        undecidable = overflows(case.at) or excused()
        verdict = "inconclusive" if undecidable else "failed"
        why = f"{kind.__name__}: {fault.what}"
        if not is_under_test(kind) and (origin := undefined_result(case.at.scene, case.at)):
            why = f"{why}; {origin}"
        outcome = np.inf, 0.0, verdict, evidence_of(kind), why
        return case.finding(kind.key, *outcome, engine=kind)


def _answered(answers: Answers, method: str, arguments: tuple, times: int) -> list[Any]:
    """Return the answers of an engine to repeated calls, all of which have to be right.

    Calls at other states come in between at irregular intervals, so that errors of any period
    are found.

    Raises:
        EngineFault: a call gives no valid answer.
    """
    repeated = [answers.ask(method, *arguments)]
    random = np.random.default_rng(0)
    for k in range(times):
        if k == 0 or random.random() < BETWEEN:
            answers.ask_elsewhere(method, arguments, 1 + k % 7)
        repeated.append(answers.ask(method, *arguments))
    return repeated


def _worst(repeated: Sequence[Any], part: Callable[[Any], Any], expected: Any) -> Any:
    """Return the answer whose part is furthest from the expected value: the first if all agree."""
    worst, by = repeated[0], -1.0
    for answer in repeated:
        quantity = part(answer)
        if quantity is None or expected is None:
            continue  # another answer may have it
        apart = largest(np.asarray(quantity) - np.asarray(expected))
        if apart > by:
            worst, by = answer, apart
    return worst


def skipped_finding(case: Case, kind: type[Engine], why: str) -> Finding:
    """Return the skipped Finding of an engine that lacks a quantity or cannot be compared."""
    outcome = 0.0, 0.0, "skipped", evidence_of(kind), why
    return case.finding(kind.key, *outcome, engine=kind)


def evidence_of(kind: type[Engine]) -> str:
    """Return the evidence of a comparison with an engine: the level, and its name and version.

    If it does not compute in float64, with its unit roundoff: then less is shown.
    """
    u = kind.unit_roundoff
    precision = "" if u <= UNIT_ROUNDOFF else f", unit roundoff 2**{round(math.log2(u))}"
    return f"compared: {version_of(kind)}{precision}"


def compare_with_engine(
    case: Case,
    engine: Engine,
    subject: str,
    ours: Any,
    theirs: Any,
    sensitivity: float,
    again: Callable[[Answers], Any],
    *,
    names: Sequence[tuple[str, ...]],
    scale: float | None = None,
    sizes: Any = None,
    own: Callable[[], Any] | None = None,
    context: Callable[[], ConfusionContext] | None = None,
) -> Finding:
    """Return the Finding of an engine's answer being equal to the scene's.

    Args:
        case: the state, and the claim being checked.
        engine: the engine.
        subject: name of the compared quantity.
        ours: the scene's value.
        theirs: the engine's value, same shape.
        sensitivity: κ · scale, the sum over both computations.
        again: repeats the call on other `Answers`.
        names: names along each axis.
        scale: size of the quantity, by default the largest entry of the expected value.
        sizes: sizes of the summed terms of each entry, if known.
        own: returns κ · scale of each entry of the scene's value.
        context: returns further arrays by which confusions are recognized.
    """
    kind, under_test = type(engine), is_under_test(type(engine))
    actual, expected = (theirs, ours) if under_test else (ours, theirs)
    compared = subject, actual, expected, sensitivity
    how: dict[str, Any] = {"names": tuple(names), "scale": scale, "sizes": sizes}
    how |= {"evidence": evidence_of(kind), "own": own, "context": context}
    finding = case.compare(*compared, **how, engine=kind)
    if finding.verdict == "failed" and under_test:
        try:
            fresh = again(Answers(make_engine(kind, case.at.scene)))
        except Exception:
            return finding
        if largest(np.asarray(fresh) - np.asarray(ours)) <= finding.allowed:
            return finding.because("a new engine answers right: it keeps what it was asked before")
        with suppress(*UNABLE):
            if is_blamed(kind) and (text := map_fault(engine, case.at)):
                return finding.because(text)
    return finding


def is_blamed(kind: type[Engine]) -> bool:
    """Return whether confusions of an engine are named: not of a library that reads files itself.

    Such a library is compared with eomcheck's own reader, and neither side is blamed; a user's own
    engine is.
    """
    return is_under_test(kind) and not (kind.reads_file and is_ours(kind))


def describe_engine_error(
    kind: type[Engine],
    actual: Array,
    expected: Array,
    allowed: float,
    context: ConfusionContext = NO_CONTEXT,
) -> str:
    """Describe the worst entry of an engine under test: both numbers, and the confusion.

    For a library that reads a robot's file itself neither side is blamed: both numbers, each with
    its source, and the confusion only of a user's own engine.

    Args:
        kind: the engine.
        actual: its answer.
        expected: the expected answer, same shape.
        allowed: bound on the rounding error.
        context: further arrays of the claim.
    """
    context = context._replace(single_precision=True)
    difference = locate(actual, expected, (), allowed, context)
    what = difference.what
    x, y = format_distinct(difference.actual, difference.expected, 9)
    numbers = f"found {x}, expected {y}"
    if kind.reads_file:
        what = what if what == SINGLE_PRECISION or is_blamed(kind) else ""
        numbers = f"{x} by the library, {y} by eomcheck"
    return f"{numbers}: {what}" if what else numbers
