"""A `Case`: one state in doubles, and the judge of claims there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np

from eomcheck.claims import trial
from eomcheck.claims.at_doubles import AtDoubles
from eomcheck.claims.blame import raised_in
from eomcheck.claims.entries import Entries, entries_of
from eomcheck.claims.finding import Finding, diagnose, judge, worst_entry
from eomcheck.claims.own import broken_on_doubles
from eomcheck.claims.registry import CLAIMS, Claim, Names, Sides, names_of_term, term_of
from eomcheck.engines import Answers, Engine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.dynamics import solution_of
from eomcheck.evaluation.evaluation import Acceleration, Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    entry_sensitivity_of,
    sensitivity_of,
    speeds_told,
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
class Case(AtDoubles):
    """One state of a scene, with the formulations and engines to look at.

    Attributes:
        at: the evaluation at the state.
        formulations: the formulations taking part.
        engines: engines made for this very scene.
        claim: the claim being looked at.
        broken: engines that could not be made, and why.
        asked_again: how often engines on trial are asked again for each answer.
    """

    at: Evaluation
    formulations: tuple[Formulation, ...]
    engines: tuple[Engine, ...]
    claim: Claim | None = None
    broken: dict[type[Engine], str] = field(default_factory=dict)
    asked_again: int = OFTEN

    @property
    def state(self) -> State:
        """(q, v, t)."""
        return State(self.at.q, self.at.v, self.at.t)

    @cached_property
    def broken_terms(self) -> Finding | None:
        """The Finding where the scene's terms cannot even be computed here, else None."""
        try:
            self.at.terms  # noqa: B018
        except Exception as error:
            return replace(self, claim=CLAIMS["finite-terms"]).unable(error)
        return None

    @property
    def taking_part(self) -> tuple[Engine | type[Engine], ...]:
        """The engines to ask for what the claim is about, and classes that could not be made.

        Engines on trial are asked for everything: what they do not offer is to be told.
        """
        assert self.claim is not None
        asks = self.claim.asks
        return tuple(
            one
            for one in (*self.engines, *self.broken)
            if one.offers(asks) or trial.is_on_trial(trial.kind_of(one))
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
    def speeds_told(self) -> bool:
        """Whether generalized speeds by a partition are more than rounding."""
        self.at.speeds  # noqa: B018  (what was solved for them is needed)
        return speeds_told(self.at)

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

    def sensitivity(self, quantity: Callable[[Evaluation], Any], together: bool = False) -> float:
        """Return κ · scale of a quantity; 0 of a copy, of which sides count and nothing else.

        `together` tells that copies have it side by side, see `sensitivity_of`.
        """
        copied = self.at.copied
        return 0.0 if copied else sensitivity_of(self.at, quantity, together=together)

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

    def look(self, claim: Claim) -> list[Finding]:
        """Return the Findings of one claim."""
        self.claim = claim
        found: list[Finding] = []
        with np.errstate(all="ignore"):
            try:
                found.extend(self._looked_at(claim))
            except Exception as error:
                found.append(self.unable(error))
        return found

    def _looked_at(self, claim: Claim) -> Iterator[Finding]:
        if claim.check is not None:
            return claim.check(self)
        if claim.against:
            return self._against_engines(claim.against, claim.asks)
        return iter(()) if claim.sides is None else self._judged(claim.sides)

    def unable(self, error: Exception) -> Finding:
        """Return the Finding on what a function of the scene raised, or returned in another shape.

        It fails where the function does not run on doubles; other numbers it need not know.

        Raises:
            Exception: the error itself, where no function of the scene's own caused it.
        """
        said = raised_in(self.at.scene, error)
        broken = broken_on_doubles(self.at.scene, self.state)
        if not (said or broken):
            raise error
        if broken:
            outcome = float("inf"), 0.0, "failed", "property-tested", broken
        else:
            outcome = 0.0, 0.0, "not looked at", "property-tested", f"not rational: {said}"
        return self.finding("functions", *outcome)

    def _judged(self, sides: Callable) -> Iterator[Finding]:
        """Yield the Findings of both sides being the same but for rounding."""

        @cache
        def perturbed(e: Evaluation) -> dict[str, Sides]:
            found: dict[str, Sides] = {}
            # What sides solve for themselves is perturbed like what formulations solve.
            with (
                e.computing("sides"),
                e.watched(),
                suppress(RefusedError, np.linalg.LinAlgError),
            ):
                for one in sides(e, Case(e, self.formulations, ())):
                    found[one.subject] = one
            return found

        def measured(here: Sides, side: str) -> float:
            def quantity(e: Evaluation) -> Array:
                one = here if e is self.at else perturbed(e).get(here.subject)
                if not isinstance(one, Sides):
                    raise np.linalg.LinAlgError(f"{here.subject} does not exist nearby")
                return np.asarray(getattr(one, side), np.float64)

            return sensitivity_of(self.at, quantity)

        for one in sides(self.at, self):
            if isinstance(one, Sides):
                sensitivity = one.sensitivity
                if sensitivity is None:
                    sensitivity = (
                        measured(one, "found") + measured(one, "expected") + (one.size or 0.0)
                    )
                scale: Any = sensitivity if one.may_vanish else one.size
                here: tuple[Any, ...] = one.subject, one.found, one.expected, sensitivity
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
        for engine in self.taking_part:
            theirs = trial.answer(self, engine, *state, expected=lambda: expected)
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
            scale = sensitivity + trial.size_of(self, engine, method)
            here = self, engine, engine.key, ours, theirs, scale
            again = partial(_asked_again, method, state)
            names = names_of_term(self.at.scene, term)
            # No sum over bodies has larger terms in the entry of two coordinates.
            roots = np.sqrt(np.abs(np.diagonal(np.atleast_2d(np.asarray(ours)))))
            sizes = np.outer(roots, roots) if term == "M" else None
            own = partial(entry_sensitivity_of, self.at, quantity)
            yield trial.compared(*here, again, names=names, scale=scale, sizes=sizes, own=own)

    def compare(
        self,
        subject: str,
        found: Any,
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
            found: ours.
            expected: what it should be, same shape.
            sensitivity: κ · scale of both computations together.
            names: names along each axis.
            scale: size of what is compared, by default the largest entry of `expected`.
            sizes: of the terms of which each entry is a sum, where they are known.
            own: gives κ · scale of each entry of `expected`, for an engine on trial.
            entrywise: whether entries have sizes of their own, see `eomcheck.claims.entries`.
            evidence: level and what it rests on.
            engine: the engine that is compared with, if any.
        """
        assert self.claim is not None
        found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
        observed = largest(found - expected)
        scale = largest(expected) if scale is None else scale
        allowed, verdict = judge(observed, sensitivity, scale)
        if not np.isfinite(expected).all():
            verdict = "inconclusive"  # nothing to compare with
        detail = ""
        if verdict == "failed":
            where = worst_entry(found - expected, names)
            what = diagnose(found, expected, allowed) if found.ndim else ""
            if engine is not None and trial.is_on_trial(engine):
                what = trial.said_on_trial(engine, found, expected, allowed)
            detail = f"{self.claim.term}, {where}" + (f": {what}" if what else "")
        outcome = subject, observed, allowed, verdict, evidence, detail
        made = self.finding(*outcome, engine=engine)
        entrywise = entrywise and (sizes is not None or bool(np.any(expected)))
        if verdict == "failed" and names:
            # What is wrong is resolved; of what else is hidden the failure says nothing.
            wrong = ~(np.abs(found - expected) <= allowed)
            return replace(made, entries=entries_of(names, wrong, np.zeros_like(wrong)))
        if not names or not entrywise:
            return made  # what vanishes has no size of its own
        zero: Any = False
        if engine is not None and trial.is_on_trial(engine):
            # Of the scene itself, what should be 0 is so but for the rounding of its own terms.
            zero = np.abs(expected) <= (0.0 if own is None else allowed_error(1.0) * own())
        entries = _resolved(found, expected, allowed, names, sizes, zero)
        hidden = entries.count_hidden if verdict == "passed" else 0
        what = f"{hidden} of {found.size} entries not resolved"
        return replace(made, entries=entries, detail=what if hidden else detail)

    def finding(self, subject: str, *outcome: Any, engine: type[Engine] | None = None) -> Finding:
        """Return a Finding about this state; `outcome` from `observed` on.

        Of an engine it is told only where that is on trial, not where it is a reference.
        """
        assert self.claim is not None
        found = Finding(self.claim.id, subject, self.at.scene, self.state, *outcome)
        tried = engine is not None and trial.is_on_trial(engine)
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
