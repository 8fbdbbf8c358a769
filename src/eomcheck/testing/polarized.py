"""Polarization of the bias: each coefficient of v_i v_j by itself, where a claim failed.

B is quadratic in v, so that its values at v = e_i and e_i + e_j give all coefficients at one q.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from eomcheck.claims.finding import EVERY_ROW, Finding, told_apart
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.contract import Array
from eomcheck.testing.answers import BrokenError
from eomcheck.testing.derived import bias_along, bias_of_energy, bias_of_inertia
from eomcheck.testing.measured import Measured, exact
from eomcheck.testing.of_terms import rows
from eomcheck.testing.point import Point

LISTED = 3
"""Number of terms that are listed."""

OfV = Callable[[Array], Measured | None]


class Term(NamedTuple):
    """A coefficient of v_i v_j in one row.

    Attributes:
        row: index of the row.
        i, j: indices of the velocities, i ≤ j.
        got: the coefficient.
        expected: what it should be.
        allowed: difference that the errors of both explain.
    """

    row: int
    i: int
    j: int
    got: float
    expected: float
    allowed: float

    @property
    def name(self) -> str:
        """Name of the product."""
        return f"v[{self.i}]²" if self.i == self.j else f"v[{self.i}] v[{self.j}]"

    @property
    def is_wrong(self) -> bool:
        """Whether it differs by more than the errors explain."""
        return abs(self.got - self.expected) > self.allowed


def wrong_terms(failed: Finding, at: Point) -> str:
    """Return the terms that are wrong where a claim about the bias failed, "" for any other.

    Args:
        failed: a failure.
        at: the point at which it failed.
    """
    pair = _sides(failed.claim, at)
    if pair is None or EVERY_ROW in failed.detail:
        return ""
    try:
        with np.errstate(all="ignore"):
            terms = [*_terms(*pair, at.width_v)]
    except (BrokenError, np.linalg.LinAlgError):
        return ""
    wrong = sorted(filter(lambda x: x.is_wrong, terms), key=lambda x: -abs(x.got - x.expected))
    texts = list(dict.fromkeys(_text(one, wrong, rows(at)) for one in wrong))
    more = f"; {len(texts) - LISTED} more terms" if len(texts) > LISTED else ""
    return "; ".join(texts[:LISTED]) + more


def _sides(claim: str, at: Point) -> tuple[OfV, OfV] | None:
    """Both sides of a claim as functions of v; None where they are not quadratic in v."""
    if at.functions.qdot is not None:
        return None
    given: OfV = lambda v: at.moved(v).B()  # noqa: E731
    match claim:
        case "bias-of-mass-matrix":
            return given, lambda v: bias_along(at, v)
        case "bias-of-energy":
            return given, lambda v: bias_of_energy(at.moved(v))
        case "coriolis-bias":
            expected = given if at.has("bias") else (lambda v: bias_of_inertia(at.moved(v)))
            return lambda v: at.moved(v).of("C") @ exact(v), expected
    return None


def coefficients(of: OfV, widths: Array) -> dict[tuple[int, int], Measured]:
    """Return (i, j) -> coefficient of v_i v_j in each row (p,), i ≤ j; {} if there is no value.

    Args:
        of: function of v that is quadratic in it.
        widths: velocities at which it is measured, one each (p,).
    """
    axes, found = np.diag(widths), {}
    for i, axis in enumerate(axes):
        value = of(axis)
        if value is None:
            return {}
        found[i, i] = value
        for j in range(i):
            both = of(axis + axes[j])
            assert both is not None
            found[j, i] = both - found[i, i] - found[j, j]
    return {(i, j): (1.0 / (widths[i] * widths[j])) * x for (i, j), x in found.items()}


def _terms(found: OfV, expected: OfV, widths: Array) -> Iterator[Term]:
    """Yield all terms of both."""
    left, right = coefficients(found, widths), coefficients(expected, widths)
    for (i, j), got in left.items():
        if (i, j) in right:
            other = right[i, j]
            errors = C * (got.error + other.error)
            numbers = zip(got.value, other.value, errors, strict=True)
            for row, (x, y, allowed) in enumerate(numbers):
                yield Term(row, i, j, float(x), float(y), float(allowed))


def _text(one: Term, wrong: list[Term], names: tuple[str, ...]) -> str:
    """Fault of a term in words, with the term that it stands in the place of."""
    got, expected, near = one.got, one.expected, one.allowed
    beside = [x for x in wrong if x.row == one.row and x is not one]
    for x, y in ((one, other) for other in beside):
        lost, extra = (x, y) if abs(x.got) <= x.allowed else (y, x)
        moved = abs(extra.got - extra.expected - lost.expected) <= lost.allowed + extra.allowed
        if abs(lost.got) <= lost.allowed < abs(lost.expected) and moved:
            what = f"missing, {extra.name} in its place"
            return f"row {names[lost.row]}, {lost.name}: {what}: {lost.expected:.6g}"
    numbers = "got {}, expected {}".format(*told_apart(got, expected))
    if abs(expected) <= near:
        return f"row {names[one.row]}, {one.name}: should vanish: got {got:.6g}"
    known = {-1.0: "wrong sign", 0.0: "missing", 0.5: "half", 2.0: "twice as large"}
    for factor, what in known.items():
        if abs(got - factor * expected) <= near:
            numbers = f"expected {expected:.6g}" if factor == 0.0 else numbers
            return f"row {names[one.row]}, {one.name}: {what}: {numbers}"
    return f"row {names[one.row]}, {one.name}: {numbers}"
