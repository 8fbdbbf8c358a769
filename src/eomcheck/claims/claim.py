"""What a claim is, and the `Case` on which claims are looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from eomcheck.claims.finding import Finding, diagnose, judge, worst_entry
from eomcheck.engines import Engine
from eomcheck.errors import RefusedError
from eomcheck.evaluation.doubles import Acceleration, Evaluation
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import Formulation
from eomcheck.mechanics.records import State
from eomcheck.numbers.contract import Array


@dataclass(frozen=True)
class Claim:
    """One statement that the suite checks.

    Attributes:
        id: short name, used everywhere.
        statement: what is claimed, in symbols of the paper.
        equations: where the paper says so.
        term: what is to blame first when the claim fails.
        check: function of a `Case` that yields one Finding per subject; None for a claim about a
            whole run.
    """

    id: str
    statement: str
    equations: str
    term: str
    check: Callable[[Case], Iterator[Finding]] | None = field(repr=False)


CLAIMS: dict[str, Claim] = {}
"""Id -> claim, single terms before whole accelerations: the first that fails is the closest."""


def claim(id: str, statement: str, equations: str, term: str) -> Callable:
    """Register the decorated check under `id`; it is called with the `Case`, bound to the claim."""

    def register(check: Callable[[Case], Iterator[Finding]]) -> Callable:
        CLAIMS[id] = Claim(id, statement, equations, term, check)
        return check

    return register


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
        return tuple(f for f in self.formulations if self.result(f) is not None)

    @cached_property
    def has_speeds(self) -> bool:
        """Whether generalized speeds exist here."""
        try:
            return self.at.speeds is not None
        except RefusedError:
            return False

    def result(self, formulation: Formulation) -> Acceleration | None:
        """Return the acceleration, or None where it is refused."""
        try:
            return self.at.acceleration(formulation)
        except RefusedError:
            return None

    def vdot_spread(self, formulation: Formulation, coordinates: bool = False) -> float:
        """Return κ · scale of v̇ by `formulation`."""
        return self._spread(formulation, "vdot", coordinates)

    def multiplier_spread(self, formulation: Formulation, coordinates: bool = False) -> float:
        """Return κ · scale of λ by `formulation`."""
        return self._spread(formulation, "multipliers", coordinates)

    def _spread(self, formulation: Formulation, part: str, coordinates: bool) -> float:
        key = (formulation.key, part, coordinates)
        if key not in self._spreads:
            self._spreads[key] = self.at.acceleration_spread(
                formulation, part, coordinates=coordinates
            )
        return self._spreads[key]

    @cached_property
    def _spreads(self) -> dict[tuple[str, str, bool], float]:
        return {}

    def rows(self, length: int) -> tuple[str, ...]:
        """Return names for an axis over coordinates or constraints; others are numbered."""
        scene = self.at.scene
        named = {scene.r: scene.constraint_names, scene.n: scene.coordinate_names}
        return named.get(length, numbered("", length))

    @property
    def speed_names(self) -> tuple[str, ...]:
        """Names for an axis over the generalized speeds."""
        return numbered("u_", self.at.scene.p)

    def compare(
        self,
        subject: str,
        found: Array,
        expected: Array,
        spread: float,
        *,
        scale: float | None = None,
        evidence: str = "",
        names: tuple[tuple[str, ...], ...] | None = None,
    ) -> Finding:
        """Return the Finding of found = expected.

        Args:
            subject: what is compared.
            found: ours.
            expected: what it should be, same shape.
            spread: κ · scale of both computations together.
            scale: size of what is compared, by default the largest entry of `expected`.
            evidence: level and what it rests on, by default property-tested.
            names: names along each axis, by default those of coordinates and constraints.
        """
        assert self.claim is not None
        found, expected = np.asarray(found), np.asarray(expected)
        observed = largest(found - expected)
        scale = largest(expected) if scale is None else scale
        allowed, verdict = judge(observed, spread, scale)
        if not np.isfinite(expected).all():
            verdict = "inconclusive"  # nothing to compare with
        detail = ""
        if verdict == "failed":
            names = names or tuple(self.rows(length) for length in found.shape)
            where = worst_entry(found - expected, names) if found.ndim else "value"
            what = diagnose(found, expected, allowed) if found.ndim else ""
            detail = f"{self.claim.term}, {where}" + (f": {what}" if what else "")
        return Finding(
            self.claim.id,
            subject,
            self.at.scene,
            self.state,
            observed,
            allowed,
            verdict,
            evidence or "property-tested",
            detail,
        )

    def vanishes(
        self,
        subject: str,
        left: Callable[[Evaluation], Array],
        size: float,
        names: tuple[tuple[str, ...], ...] | None = None,
    ) -> Finding:
        """Return the Finding of left = 0, where `size` is that of the terms that cancel."""
        found, spread = left(self.at), self.at.spread(left) + size
        return self.compare(subject, found, np.zeros(found.shape), spread, scale=size, names=names)


def look(case: Case, one: Claim) -> list[Finding]:
    """Return the Findings of one claim on `case`."""
    case.claim = one
    with np.errstate(all="ignore"):
        return [] if one.check is None else list(one.check(case))


def numbered(prefix: str, count: int) -> tuple[str, ...]:
    """Return (prefix)1, (prefix)2, ..."""
    return tuple(f"{prefix}{i + 1}" for i in range(count))


def pairs(items: tuple) -> Iterator[tuple]:
    """Yield every unordered pair."""
    for i, first in enumerate(items):
        for second in items[i + 1 :]:
            yield first, second


__all__ = ["CLAIMS", "Case", "Claim", "claim", "look", "numbered", "pairs"]
