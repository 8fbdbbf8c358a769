"""Random points of finite fields, and what every identity comes to at them."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from eomcheck.claims.entries import entry_name
from eomcheck.claims.finding import looks_like
from eomcheck.claims.point import Point
from eomcheck.claims.registry import CLAIMS, Claim, NoRateError, Sides, Skipped
from eomcheck.claims.speeds import embedding
from eomcheck.errors import RefusedError
from eomcheck.formulations import Formulation, Partition
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.finite_field import FiniteField, random_prime
from eomcheck.numbers.generic import Array

Key = tuple[str, str]
"""Claim and subject."""

REDRAWS = 3
"""What refuses so many random points in a row refuses all points."""


NO_RATE = "`prepare` uses more than angles, roots and the clock, and its rate is not known"


def look_at(at: Point, *claims: Claim) -> Iterator[tuple[Key, Sides | Skipped]]:
    """Yield the sides of identities at a point, by default of all in the order of `CLAIMS`."""
    for claim in claims or CLAIMS.values():
        if claim.sides is None or not claim.provable:
            continue
        try:
            for sides in claim.sides(at, at):
                yield (claim.id, sides.subject), sides
        except NoRateError:
            yield (claim.id, claim.rate_of), Skipped(claim.rate_of, NO_RATE)


@dataclass
class Outcome:
    """How one identity came out.

    Attributes:
        primes: of the points at which it was looked at.
        differs: number of points at which its sides differ.
        detail: the term, the row and what is wrong with it, at the first of them.
        skipped: why it was not looked at, at points where it was not.
    """

    primes: list[int] = field(default_factory=list)
    differs: int = 0
    detail: str = ""
    skipped: str = ""


class Draws:
    """Random points of one structure.

    Attributes:
        count: points drawn, those not used included.
        outcomes: what every identity came to.
        refused: the formulations that refuse every point, and the matrix that is singular.
        partition: a choice of dependent coordinates drawn at random, beside the paper's.
    """

    def __init__(self, scene: Scene, formulations: tuple[Formulation, ...], source: random.Random):
        self.scene, self.formulations, self._source = scene, formulations, source
        self.count = 0
        self.outcomes: dict[Key, Outcome] = {}
        self.refused: dict[str, str] = {}
        self.partition: Partition | None = None

    def look(self) -> None:
        """Look at one more point.

        Raises:
            RefusedError, ZeroDivisionError: the generalized speeds do not exist at any point.
            TypeError: a function of the scene or of a formulation does more than rational
                operations.
        """
        at, prime = self._point()
        for key, sides in look_at(at):
            outcome = self.outcomes.setdefault(key, Outcome())
            if isinstance(sides, Skipped):
                outcome.skipped = sides.reason
                continue
            outcome.primes.append(prime)
            if not _same(*_both(sides)):
                outcome.differs += 1
                outcome.detail = outcome.detail or self._detail(at, key, sides)

    def _point(self) -> tuple[Point, int]:
        """Draw until no formulation refuses, but for those that refuse every point."""
        always = {f.key for f in self.formulations}
        for attempt in range(REDRAWS):
            last = attempt == REDRAWS - 1
            self.count += 1
            prime = random_prime(self._source)
            field = FiniteField(prime, self._source)
            at = Point(self.scene, field, self.formulations, self.partition)
            try:
                if self.partition is None:
                    self.partition = at.other_partition = self._drawn_partition(at)
                refusals = {f.key: at.refusal(f) for f in self.formulations}
            except (RefusedError, ZeroDivisionError):
                if last:
                    raise
                continue
            refused = {key: refusal.what for key, refusal in refusals.items() if refusal}
            always &= refused.keys()
            if last:
                self.refused |= {key: what for key, what in refused.items() if key in always}
            if last or refused.keys() <= self.refused.keys():
                return at, prime
        raise AssertionError("the last attempt returns or raises")

    def _drawn_partition(self, at: Point) -> Partition | None:
        n, r = self.scene.n, self.scene.r
        for _ in range(n if r > 0 else 0):
            order = np.array(self._source.sample(range(n), n), dtype=int)
            # Of one row more than there are, any may be the one that follows from the others.
            redundant = np.array([self._source.randrange(r + 1)])
            kept = np.setdiff1d(np.arange(r + 1), redundant)
            drawn = Partition(np.sort(order[:r]), np.sort(order[r:]), kept, redundant)
            try:
                embedding(at, drawn)
            except RefusedError:
                continue
            return drawn
        return None

    def _detail(self, at: Point, key: Key, sides: Sides) -> str:
        if sides.names == (at.direction_names,):
            at.look_along_axes()
            along_axes = dict(look_at(at, CLAIMS[key[0]]))[key]
            sides = along_axes if isinstance(along_axes, Sides) else sides
        return f"{CLAIMS[key[0]].term}, {describe(sides)}"


def _both(sides: Sides) -> tuple[Array, Array]:
    return np.asarray(sides.found, object), np.asarray(sides.expected, object)


def _same(x: Array, y: Array) -> bool:
    return np.shape(x) == np.shape(y) and bool(np.all(x == y))


def describe(sides: Sides) -> str:
    """Return where two sides differ first, and what the left one looks like beside the right."""
    found, expected = _both(sides)
    if found.shape != expected.shape:
        return f"shape {found.shape}, expected {expected.shape}"
    where = tuple(int(i) for i in np.argwhere(found != expected)[0])
    place, what = entry_name(where, sides.names), looks_like(found, expected, where, _same)
    return f"{place}: {what}" if what else place
