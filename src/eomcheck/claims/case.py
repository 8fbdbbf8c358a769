"""A `Case`: one state in doubles, and the judge of claims there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np

from eomcheck.claims.finding import Finding, diagnose, judge, worst_entry
from eomcheck.claims.registry import Against, Claim, Names, Sides, names_of_term
from eomcheck.engines import Answers, Engine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Acceleration, Evaluation
from eomcheck.evaluation.sensitivity import acceleration_sensitivity, sensitivity_of
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS, Formulation, Partition
from eomcheck.mechanics.records import State
from eomcheck.numbers.contract import Array


@dataclass
class Case:
    """One state of a scene, with the formulations and engines to look at.

    Attributes:
        at: the evaluation at the state.
        formulations: the formulations taking part.
        engines: engines made for this very scene.
        claim: the claim being looked at.
    """

    at: Evaluation
    formulations: tuple[Formulation, ...]
    engines: tuple[Engine, ...]
    claim: Claim | None = None

    @property
    def state(self) -> State:
        """(q, v, t)."""
        return State(self.at.q, self.at.v, self.at.t)

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
        with suppress(RefusedError):
            return self.at.acceleration(formulation)

    # ---- How doubles are looked at, see `Look` ---------------------------------------------------

    exact: ClassVar[bool] = False
    others: ClassVar[tuple] = ()

    @cached_property
    def has_speeds(self) -> bool:
        """Whether generalized speeds exist here."""
        with suppress(RefusedError):
            return self.at.speeds is not None
        return False

    @property
    def free(self) -> Evaluation:
        """The state itself: its velocity was given."""
        return self.at

    @property
    def directions(self) -> Array:
        """The coordinates in turn (n, n)."""
        return np.eye(self.at.scene.n)

    @property
    def direction_names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return self.at.scene.coordinate_names

    @property
    def partitions(self) -> Iterator[tuple[str, Partition]]:
        """The paper's partition and the pivoted one."""
        yield "em", self.at.partition
        yield "em, pivoted", self.at.partition_for(FORMULATIONS["em"], pivoted=True)

    @property
    def solutions(self) -> tuple[tuple[Formulation, Acceleration], ...]:
        """What the formulations say that do not refuse."""
        results = ((f, self.result(f)) for f in self.formulations)
        return tuple((f, x) for f, x in results if x is not None)

    def sensitivity(self, quantity: Callable[[Evaluation], Any]) -> float:
        """Return κ · scale of a quantity."""
        return sensitivity_of(self.at, quantity)

    def vdot_sensitivity(self, formulation: Formulation) -> float:
        """Return κ · scale of v̇ by `formulation`."""
        return self.part_sensitivity(formulation, "vdot")

    def multiplier_sensitivity(self, formulation: Formulation) -> float:
        """Return κ · scale of λ by `formulation`."""
        return self.part_sensitivity(formulation, "multipliers")

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
        with np.errstate(all="ignore"):
            if claim.check is not None:
                return list(claim.check(self))
            if claim.against is not None:
                return list(self._against_engines(claim.against))
            return [] if claim.sides is None else list(self._judged(claim.sides))

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
                scale = sensitivity if one.may_vanish else one.size
                here = one.subject, one.found, one.expected, sensitivity
                yield self.compare(*here, scale=scale, names=one.names)

    def _against_engines(self, term: Against) -> Iterator[Finding]:
        """Yield the Findings of a term being what each engine says."""
        found, sensitivity = term.ours(self.at), None
        for engine in () if found is None else self.engines:
            if not engine.offers(term.method):
                continue
            if sensitivity is None:
                sensitivity = sensitivity_of(self.at, term.ours, coordinates=True)
            expected, size = term.theirs(Answers(engine), self.state)
            # A term of size 0 (B at rest) is compared all the same: it should vanish.
            scale, evidence = sensitivity + size, f"compared: {engine.version()}"
            names = names_of_term(self.at.scene, term.term)
            here = engine.key, found, expected, scale
            yield self.compare(*here, names=names, scale=scale, evidence=evidence)

    def compare(
        self,
        subject: str,
        found: Any,
        expected: Any,
        sensitivity: float,
        *,
        names: Names,
        scale: float | None = None,
        evidence: str = "property-tested",
    ) -> Finding:
        """Return the Finding of found = expected.

        Args:
            subject: what is compared.
            found: ours.
            expected: what it should be, same shape.
            sensitivity: κ · scale of both computations together.
            names: names along each axis.
            scale: size of what is compared, by default the largest entry of `expected`.
            evidence: level and what it rests on.
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
            detail = f"{self.claim.term}, {where}" + (f": {what}" if what else "")
        return self.finding(subject, observed, allowed, verdict, evidence, detail)

    def finding(self, subject: str, *outcome: Any) -> Finding:
        """Return a Finding about this state; `outcome` from `observed` on."""
        assert self.claim is not None
        return Finding(self.claim.id, subject, self.at.scene, self.state, *outcome)
