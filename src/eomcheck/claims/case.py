"""A `Case`: one state in float64, in which claims are evaluated and compared with engines.

Both sides of a claim pass if they differ by no more than perturbation analysis explains. An engine
is either built-in, a reference for the scene: "found" then is the scene's value. Or it is under
test, written by a user: "found" then is the engine's answer, "expected" the reference, and it is
asked again and again, since all of its answers are to be right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from eomcheck.claims.finding import (
    Entries,
    Finding,
    diagnose,
    entries_of,
    format_distinct,
    judge,
    resembles,
    worst_entry,
    worst_of,
)
from eomcheck.claims.registry import (
    CLAIMS,
    Claim,
    Comparison,
    FloatContext,
    Names,
    names_of_term,
    term_of,
)
from eomcheck.claims.user_scenes import failing_function, scene_function_that_raised
from eomcheck.engines import (
    Answers,
    Engine,
    EngineFault,
    engine_class_of,
    is_under_test,
    make_engine,
    version_of,
)
from eomcheck.engines.answers import drift_size, inertia_size, mass_size, overflows, weight_size
from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import solution_of
from eomcheck.evaluation.evaluation import Acceleration, Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    entry_sensitivity_of,
    sensitivity_of,
    speeds_resolved,
)
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, largest
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import Array
from eomcheck.numbers.linear import column_scale

OFTEN, ONCE = 90, 1
"""How often an engine on trial is asked again for each answer: at the first state that is looked
at and the first that is drawn, and elsewhere. Counts and what fills up over calls show there."""


@dataclass
class Case(FloatContext):
    """One state of a scene, with the formulations and engines to look at.

    Attributes:
        at: the evaluation at the state.
        formulations: the formulations taking part.
        engines: engines made for this very scene.
        claim: the claim being looked at.
        unavailable: engines that could not be made, and why.
        repeats: how often engines on trial are asked again for each answer.
    """

    at: Evaluation
    formulations: tuple[Formulation, ...]
    engines: tuple[Engine, ...]
    claim: Claim | None = None
    unavailable: dict[type[Engine], str] = field(default_factory=dict)
    repeats: int = OFTEN

    @property
    def state(self) -> State:
        """(q, v, t)."""
        return State(self.at.q, self.at.v, self.at.t)

    @cached_property
    def terms_failure(self) -> Finding | None:
        """The Finding where the scene's terms cannot even be computed here, else None."""
        try:
            self.at.terms  # noqa: B018
        except Exception as error:
            return replace(self, claim=CLAIMS["finite-terms"]).error_finding(error)
        return None

    @property
    def claim_engines(self) -> tuple[Engine | type[Engine], ...]:
        """The engines to ask for what the claim is about, and classes that could not be made.

        Engines on trial are asked for everything: what they do not offer is to be told.
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
        """Whether every term is a finite number; only then can the other claims be looked at."""
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
        """Return the acceleration, or None where it is refused."""
        if formulation.key not in self._results:
            self._results[formulation.key] = None
            with suppress(RefusedError):
                self._results[formulation.key] = solution_of(self.at, formulation)
        return self._results[formulation.key]

    @cached_property
    def _results(self) -> dict[str, Acceleration | None]:
        return {}

    # ---- How doubles are looked at, see `Look` ---------------------------------------------------

    @cached_property
    def has_speeds(self) -> bool:
        """Whether generalized speeds exist here."""
        with suppress(RefusedError):
            return self.at.speeds is not None
        return False

    @cached_property
    def speeds_resolved(self) -> bool:
        """Whether generalized speeds by a partition are more than rounding."""
        self.at.speeds  # noqa: B018  (what was solved for them is needed)
        return speeds_resolved(self.at)

    @property
    def directions(self) -> Array:
        """The coordinates in turn (n, n)."""
        return np.eye(self.at.scene.n)

    @property
    def partitions(self) -> Iterator[tuple[str, Partition]]:
        """The paper's partition and the pivoted one."""
        yield "em", self.at.partition
        yield "em, pivoted", self.at.pivoted_partition

    @property
    def added_row(self) -> tuple[Array, Partition]:
        """The independent constraints, rows of one size, in turn added and taken off.

        The last of them is left to follow from the others.
        """
        a, partition = self.at.terms.a, self.at.independent_partition
        kept = np.arange(len(a)) if partition.kept is None else partition.kept
        weights = np.zeros(len(a))
        weights[kept] = column_scale(a.T)[kept] * (-1.0) ** np.arange(len(kept))
        others = () if partition.redundant is None else partition.redundant
        rows = np.append(kept[:-1], len(a)), np.append(others, kept[-1:]).astype(int)
        return weights, partition._replace(kept=rows[0], redundant=rows[1])

    @property
    def solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        """What the formulations say that do not refuse."""
        results = ((f, self.result(f)) for f in self.formulations)
        return tuple((f, x) for f, x in results if x is not None)

    def sensitivity(self, quantity: Callable[[Evaluation], Any], batched: bool = False) -> float:
        """Return κ · scale of a quantity; 0 of a copy, of which sides count and nothing else.

        `merged_body` tells that copies have it side by side, see `sensitivity_of`.
        """
        copied = self.at.is_perturbed
        return 0.0 if copied else sensitivity_of(self.at, quantity, batched=batched)

    def part_sensitivity(
        self, formulation: Formulation, part: str, *, coordinates: bool = False
    ) -> float:
        """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`."""
        key = (formulation.key, part, coordinates)
        if key not in self._sensitivities:
            found = acceleration_sensitivity(self.at, formulation, part, coordinates=coordinates)
            self._sensitivities[key] = found
        return self._sensitivities[key]

    @cached_property
    def _sensitivities(self) -> dict[tuple[str, str, bool], float]:
        return {}

    # ---- Judging ---------------------------------------------------------------------------------

    def evaluate(self, claim: Claim) -> list[Finding]:
        """Return the Findings of one claim."""
        self.claim = claim
        found: list[Finding] = []
        with np.errstate(all="ignore"):
            try:
                found.extend(self._evaluate(claim))
            except Exception as error:
                found.append(self.error_finding(error))
        return found

    def _evaluate(self, claim: Claim) -> Iterator[Finding]:
        if claim.check is not None:
            return claim.check(self)
        if claim.against:
            return self._against_engines(claim.against, claim.asks)
        return iter(()) if claim.sides is None else self._compare_sides(claim.sides)

    def error_finding(self, error: Exception) -> Finding:
        """Return the Finding on what a function of the scene raised, or returned in another shape.

        It fails where the function does not run on doubles; other numbers it need not know.

        Raises:
            Exception: the error itself, where no function of the scene's own caused it.
        """
        said = scene_function_that_raised(self.at.scene, error)
        broken = failing_function(self.at.scene, self.state)
        if not (said or broken):
            raise error
        if broken:
            outcome = float("inf"), 0.0, "failed", "property-tested", broken
        else:
            outcome = 0.0, 0.0, "skipped", "property-tested", f"not rational: {said}"
        return self.finding("functions", *outcome)

    def _compare_sides(self, sides: Callable) -> Iterator[Finding]:
        """Yield the Findings of both sides being the same but for rounding."""

        @cache
        def perturbed(e: Evaluation) -> dict[str, Comparison]:
            found: dict[str, Comparison] = {}
            # What sides solve for themselves is perturbed like what formulations solve.
            with (
                e.computing("sides"),
                e.recording_solves(),
                suppress(RefusedError, np.linalg.LinAlgError),
            ):
                for one in sides(e, Case(e, self.formulations, ())):
                    found[one.subject] = one
            return found

        def measured(here: Comparison, side: str) -> float:
            def quantity(e: Evaluation) -> Array:
                one = here if e is self.at else perturbed(e).get(here.subject)
                if not isinstance(one, Comparison):
                    raise np.linalg.LinAlgError(f"{here.subject} does not exist nearby")
                return np.asarray(getattr(one, side), np.float64)

            return sensitivity_of(self.at, quantity)

        for one in sides(self.at, self):
            if isinstance(one, Comparison):
                sensitivity = one.sensitivity
                if sensitivity is None:
                    sensitivity = (
                        measured(one, "actual") + measured(one, "expected") + (one.size or 0.0)
                    )
                scale: Any = sensitivity if one.may_vanish else one.size
                here: tuple[Any, ...] = one.subject, one.actual, one.expected, sensitivity
                told = one.size is None or one.sizes is not None
                how = {"scale": scale, "sizes": one.sizes, "entrywise": told}
                yield self.compare(*here, names=one.names, **how)

    def _against_engines(self, term: str, method: str) -> Iterator[Finding]:
        """Yield the Findings of a term being what each engine says."""

        def quantity(e: Evaluation) -> Any:
            found = term_of(e, term)
            return np.zeros(np.shape(theirs)) if found is None else found

        known, sensitivity = term_of(self.at, term), None
        absent = known is None
        expected = 0.0 if absent else known
        state = (self.at.q, self.at.v, self.at.t)
        for engine in self.claim_engines:
            theirs = ask_engine(self, engine, *state, expected=lambda: expected)
            if isinstance(theirs, Finding) or isinstance(engine, type):
                if not absent or theirs.verdict == "failed":
                    yield theirs
                continue
            if absent and not np.any(theirs):
                continue  # nobody has this term
            ours = quantity(self.at)
            if sensitivity is None:
                sensitivity = sensitivity_of(self.at, quantity, coordinates=True)
            # A term of size 0 (B at rest) is compared all the same: it should vanish.
            scale = sensitivity + cancelling_size(self, engine, method)
            here = self, engine, engine.key, ours, theirs, scale
            again = partial(_asked_again, method, state)
            names = names_of_term(self.at.scene, term)
            # No sum over bodies has larger terms in the entry of two coordinates.
            roots = np.sqrt(np.abs(np.diagonal(np.atleast_2d(np.asarray(ours)))))
            sizes = np.outer(roots, roots) if term == "M" else None
            own = partial(entry_sensitivity_of, self.at, quantity)
            yield compare_with_engine(*here, again, names=names, scale=scale, sizes=sizes, own=own)

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
    ) -> Finding:
        """Return the Finding of found = expected.

        Args:
            subject: what is compared.
            actual: ours.
            expected: what it should be, same shape.
            sensitivity: κ · scale of both computations together.
            names: names along each axis.
            scale: size of what is compared, by default the largest entry of `expected`.
            sizes: of the terms of which each entry is a sum, where they are known.
            own: gives κ · scale of each entry of `expected`, for an engine on trial.
            entrywise: whether entries have sizes of their own, see `eomcheck.claims.finding`.
            evidence: level and what it rests on.
            engine: the engine that is compared with, if any.
        """
        assert self.claim is not None
        actual, expected = np.asarray(actual, np.float64), np.asarray(expected, np.float64)
        observed = largest(actual - expected)
        scale = largest(expected) if scale is None else scale
        allowed, verdict = judge(observed, sensitivity, scale)
        if not np.isfinite(expected).all():
            verdict = "inconclusive"  # nothing to compare with
        detail = ""
        if verdict == "failed":
            where = worst_entry(actual - expected, names)
            what = diagnose(actual, expected, allowed) if actual.ndim else ""
            if engine is not None and is_under_test(engine):
                what = describe_engine_error(engine, actual, expected, allowed)
            detail = f"{self.claim.term}, {where}" + (f": {what}" if what else "")
        outcome = subject, observed, allowed, verdict, evidence, detail
        made = self.finding(*outcome, engine=engine)
        entrywise = entrywise and (sizes is not None or bool(np.any(expected)))
        if verdict == "failed" and names:
            # What is wrong is resolved; of what else is hidden the failure says nothing.
            wrong = ~(np.abs(actual - expected) <= allowed)
            return replace(made, entries=entries_of(names, wrong, np.zeros_like(wrong)))
        if not names or not entrywise:
            return made  # what vanishes has no size of its own
        zero: Any = False
        if engine is not None and is_under_test(engine):
            # Of the scene itself, what should be 0 is so but for the rounding of its own terms.
            zero = np.abs(expected) <= (0.0 if own is None else allowed_error(1.0) * own())
        entries = _resolved(actual, expected, allowed, names, sizes, zero)
        hidden = entries.count_hidden if verdict == "passed" else 0
        what = f"{hidden} of {actual.size} entries not resolved"
        return replace(made, entries=entries, detail=what if hidden else detail)

    def finding(self, subject: str, *outcome: Any, engine: type[Engine] | None = None) -> Finding:
        """Return a Finding about this state; `outcome_of` from `observed` on.

        Of an engine it is told only where that is on trial, not where it is a reference.
        """
        assert self.claim is not None
        found = Finding(self.claim.id, subject, self.at.scene, self.state, *outcome)
        tried = engine is not None and is_under_test(engine)
        return replace(found, engine=engine) if tried else found


def _asked_again(method: str, state: tuple[Array, Array, float], answers: Answers) -> Any:
    return answers.ask(method, *state)


def _resolved(
    found: Array, expected: Array, allowed: float, names: Names, sizes: Any, zero: Any
) -> Entries:
    """Return which entries of two sides are resolved.

    Args:
        found: ours.
        expected: what it should be, same shape.
        allowed: the error that is allowed in every entry.
        names: names along each axis.
        sizes: of the terms of which each entry is a sum, None where they are not known.
        zero: which entries should be 0, and are so but for rounding: they have passed.
    """
    own = np.maximum(np.abs(found), np.abs(expected))
    size = own if sizes is None else np.maximum(own, sizes)
    there = (size > 0.0) & ~np.asarray(zero)
    # What agrees in digits of its own is resolved, whatever the largest entry allows.
    agree = (own > 0.0) & (np.abs(found - expected) <= INCONCLUSIVE * own)
    known = agree | (allowed <= INCONCLUSIVE * size)
    return entries_of(names, there & known, there & ~known)


# ---- Answers of engines --------------------------------------------------------------------------

UNABLE = (np.linalg.LinAlgError, EngineFault)

BETWEEN = 0.25
"""Share of the answers asked again before which the engine is asked at another state."""

FLOAT32 = 2.0**-19
"""A relative error below this, and above that of doubles, is one of single precision."""


def cancelling_size(case: Case, engine: Engine, method: str) -> float:
    """Return the size of the terms that an engine may sum to an answer, where it cancels."""
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
    part: Callable[[Any], Any] = lambda said: said,
    excused: Callable[[], bool] = lambda: False,
) -> Any:
    """Return what the engine says of what the claim asks; else the Finding that it says nothing.

    An engine on trial is asked again and again: returned is the answer furthest from the scene's.

    Args:
        case: the state, and the claim that is looked at.
        engine: the engine, or its class if it could not be made.
        arguments: what its method is handed.
        expected: gives what is expected of `part`; None if nothing is known here.
        part: gives the quantity of an answer that is compared; None if the answer lacks it.
        excused: whether nothing could be judged here, whatever the answer.
    """
    assert case.claim is not None
    method, kind = case.claim.asks, engine_class_of(engine)
    if not kind.offers(method):
        return skipped_finding(case, kind, f"it does not offer {method}")
    if isinstance(engine, type) and not is_under_test(engine):
        return skipped_finding(case, engine, f"not rational: {case.unavailable[engine]}")
    try:
        if isinstance(engine, type):
            raise EngineFault(case.unavailable[engine])
        answers = Answers(engine)
        if is_under_test(kind):
            answers.provoke_stale_answers(method, *arguments)
            found = _answered(answers, method, arguments, case.repeats)
            known = expected()
            return _worst(found, part, part(found[0]) if known is None else known)
        return answers.ask(method, *arguments)
    except EngineFault as fault:
        if isinstance(fault.__cause__, np.linalg.LinAlgError) and not is_under_test(kind):
            return skipped_finding(case, kind, fault.what)
        open_here = overflows(case.at) or excused()
        verdict = "inconclusive" if open_here else "failed"
        outcome = np.inf, 0.0, verdict, evidence_of(kind), f"{kind.__name__}: {fault.what}"
        return case.finding(kind.key, *outcome, engine=kind)


def _answered(answers: Answers, method: str, arguments: tuple, times: int) -> list[Any]:
    """Answers of an engine that is asked again and again, all of which are to be right.

    Calls at other states come in between, at irregular intervals, so that no period of calls
    passes by.

    Raises:
        EngineFault: one of them is no answer.
    """
    found = [answers.ask(method, *arguments)]
    random = np.random.default_rng(0)
    for k in range(times):
        if k == 0 or random.random() < BETWEEN:
            answers.ask_elsewhere(method, arguments, 1 + k % 7)
        found.append(answers.ask(method, *arguments))
    return found


def _worst(found: Sequence[Any], part: Callable[[Any], Any], expected: Any) -> Any:
    """Answer whose part is furthest from what is expected: the first one if all are alike."""
    worst, by = found[0], -1.0
    for one in found:
        quantity = part(one)
        if quantity is None or expected is None:
            continue  # what one answer lacks another may have
        apart = largest(np.asarray(quantity) - np.asarray(expected))
        if apart > by:
            worst, by = one, apart
    return worst


def skipped_finding(case: Case, kind: type[Engine], why: str) -> Finding:
    """Return the Finding of what an engine does not tell, or of what cannot be compared."""
    outcome = 0.0, 0.0, "skipped", evidence_of(kind), why
    return case.finding(kind.key, *outcome, engine=kind)


def evidence_of(kind: type[Engine]) -> str:
    """Return the level of evidence of a comparison, and what it rests on."""
    return f"compared: {version_of(kind)}"


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
) -> Finding:
    """Return the Finding of an answer being the scene's own.

    Args:
        case: the state, and the claim that is looked at.
        engine: the engine.
        subject: what is compared.
        ours: the scene's.
        theirs: the engine's, same shape.
        sensitivity: κ · scale of both computations together.
        again: asks the same once more.
        names: names along each axis.
        scale: size of what is compared, by default the largest entry of what is expected.
        sizes: of the terms of which each entry is a sum, where they are known.
        own: gives κ · scale of each entry of the scene's.
    """
    kind, tried = type(engine), is_under_test(type(engine))
    found, expected = (theirs, ours) if tried else (ours, theirs)
    here = subject, found, expected, sensitivity
    how: dict[str, Any] = {"names": tuple(names), "scale": scale, "sizes": sizes}
    how |= {"evidence": evidence_of(kind), "own": own}
    finding = case.compare(*here, **how, engine=kind)
    if finding.verdict == "failed" and tried:
        try:
            fresh = again(Answers(make_engine(kind, case.at.scene)))
        except Exception:
            return finding
        if largest(np.asarray(fresh) - np.asarray(ours)) <= finding.allowed:
            return finding.because("a new engine answers right: it keeps what it was asked before")
    return finding


def describe_engine_error(kind: type[Engine], found: Array, expected: Array, allowed: float) -> str:
    """Return what is wrong with the worst entry of an engine on trial: both numbers, and a name.

    Of a library that reads a robot's file itself, nobody is blamed: both numbers, and whose.

    Args:
        kind: the engine.
        found: what it says.
        expected: what it should say, same shape.
        allowed: the error that rounding explains.
    """
    worst = worst_of(found - expected)
    what = resembles(found, expected, allowed, worst)
    x, y = format_distinct(found[worst], expected[worst], 9)
    numbers = f"found {x}, expected {y}"
    if kind.reads_file:
        what = ""
        numbers = f"{x} by the library, {y} by eomcheck"
    if largest(found - expected) <= FLOAT32 * largest(expected):
        what = "as large as the rounding of single precision"
    return f"{numbers}: {what}" if what else numbers
