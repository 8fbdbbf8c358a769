"""Polarization of the bias: each coefficient of v_i v_j by itself, where a claim failed.

B is a quadratic form in v, so that its values at v = e_i and e_i + e_j give all coefficients at one
q; those that differ from the expected ones are the wrong terms, by name.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from eomcheck.claims.finding import EVERY_ROW, Finding, format_distinct
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import Array
from eomcheck.testing.claims_motions import is_nonzero
from eomcheck.testing.claims_terms import row_names
from eomcheck.testing.equations_of_motion import BrokenError
from eomcheck.testing.function_state import (
    FunctionState,
    bias_along,
    bias_of_energy,
    bias_of_inertia,
)
from eomcheck.testing.uncertain import UncertainArray, exact

LISTED = 3
"""Largest number of terms that are listed."""

CONSTANT = "the difference does not depend on v"
SCALES = 0.0, 1.0, -1.0, 2.0
"""Multiples of v at which the dependence of a quantity on v is measured."""


OfV = Callable[[Array], UncertainArray | None]


class Term(NamedTuple):
    """Coefficient of v_i v_j in one row.

    Attributes:
        row: index of the row.
        i, j: indices of the velocities, i ≤ j.
        got: the coefficient.
        expected: expected value of the coefficient.
        allowed: largest difference that the errors of both explain.
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


def wrong_terms(failed: Finding, at: FunctionState) -> str:
    """Return the wrong terms where a claim about the bias failed, as text; "" for any other claim.

    Args:
        failed: a failure.
        at: state at which it failed.
    """
    pair = _sides(failed.claim, at)
    if pair is None or EVERY_ROW in failed.detail:
        return ""
    try:
        with np.errstate(all="ignore"):
            v = np.where(at.v < 0.0, -1.0, 1.0) * at.width_v  # not small, unlike v near rest
            off, expected = (_degrees(of, v) for of in (_difference(*pair), pair[1]))
            if off.constant and not (off.odd or off.even):
                return CONSTANT
            if off.constant or off.odd or expected.constant or expected.odd:
                pair = _quadratic_part(pair[0]), _quadratic_part(pair[1])
            terms = [*_terms(*pair, at.width_v)]
    except (BrokenError, np.linalg.LinAlgError):
        return ""
    wrong = sorted(filter(lambda x: x.is_wrong, terms), key=lambda x: -abs(x.got - x.expected))
    texts = list(dict.fromkeys(_text(one, wrong, row_names(at)) for one in wrong))
    more = f"; {len(texts) - LISTED} more terms" if len(texts) > LISTED else ""
    return "; ".join(texts[:LISTED]) + more


def _sides(claim: str, at: FunctionState) -> tuple[OfV, OfV] | None:
    """Return both sides of a claim as functions of v; None where they are not quadratic in v."""
    if at.functions.qdot is not None:
        return None
    given: OfV = lambda v: at.with_velocity(v).B()  # noqa: E731
    match claim:
        case "bias-of-mass-matrix":
            return given, lambda v: bias_along(at, v)
        case "bias-of-energy":
            return given, lambda v: bias_of_energy(at.with_velocity(v))
        case "coriolis-bias":
            expected = given if at.has("bias") else (lambda v: bias_of_inertia(at.with_velocity(v)))
            return lambda v: at.with_velocity(v).quantity("C") @ exact(v), expected
    return None


class VelocityDependence(NamedTuple):
    """Parities in v of a quantity: whether it has constant, odd, and even nonconstant terms."""

    constant: bool
    odd: bool
    even: bool

    @property
    def text(self) -> str:
        """Dependence of the residual of motion on v, "" where it is of several kinds."""
        kinds = {
            (True, False, False): "constant in v: a force",
            (False, True, False): "odd in v: damping",
            (False, False, True): "even in v, 0 at rest: bias",
        }
        return kinds.get((self.constant, self.odd, self.even), "")


def velocity_dependence(values: Sequence[UncertainArray]) -> VelocityDependence:
    """Return the parities in v of a quantity from its values at `SCALES` times v."""
    rest, ahead, behind, _ = values
    odd, even = ahead - behind, ahead + behind - 2.0 * rest
    return VelocityDependence(*(bool(is_nonzero(x).any()) for x in (rest, odd, even)))


def _degrees(of: OfV, v: Array) -> VelocityDependence:
    """Return the parities of a function of v; even, as of a bias, where it has no value."""
    values = [x for x in (of(scale * v) for scale in SCALES) if x is not None]
    return (
        velocity_dependence(values)
        if len(values) == len(SCALES)
        else VelocityDependence(False, False, True)
    )


def _difference(x: OfV, y: OfV) -> OfV:
    """Return the function x - y, None where one of them has no value."""

    def difference(v: Array) -> UncertainArray | None:
        left, right = x(v), y(v)
        return None if left is None or right is None else left - right

    return difference


def _quadratic_part(of: OfV) -> OfV:
    """Return the part of a function that is even in v, without the constant."""

    def part(v: Array) -> UncertainArray | None:
        ahead, back, rest = of(v), of(-v), of(0.0 * v)
        if ahead is None or back is None or rest is None:
            return None
        return 0.5 * (ahead + back) - rest

    return part


def coefficients(of: OfV, widths: Array) -> dict[tuple[int, int], UncertainArray]:
    """Return the coefficients of a quadratic form in v.

    Args:
        of: function of v that is quadratic in it.
        widths: size of each velocity at which it is evaluated (p,).

    Returns:
        (i, j) -> coefficient of v_i v_j in each row (p,), i ≤ j; {} if there is no value.
    """
    axes, products = np.diag(widths), {}
    for i, axis in enumerate(axes):
        value = of(axis)
        if value is None:
            return {}
        products[i, i] = value
        for j in range(i):
            both = of(axis + axes[j])
            assert both is not None
            products[j, i] = both - products[i, i] - products[j, j]
    return {(i, j): (1.0 / (widths[i] * widths[j])) * x for (i, j), x in products.items()}


def _terms(actual: OfV, expected: OfV, widths: Array) -> Iterator[Term]:
    """Yield the terms that both functions have."""
    left, right = coefficients(actual, widths), coefficients(expected, widths)
    for (i, j), got in left.items():
        if (i, j) in right:
            other = right[i, j]
            errors = C * (got.error + other.error)
            numbers = zip(got.value, other.value, errors, strict=True)
            for row, (x, y, allowed) in enumerate(numbers):
                yield Term(row, i, j, float(x), float(y), float(allowed))


def _text(one: Term, wrong: list[Term], names: tuple[str, ...]) -> str:
    """Return a description of a wrong term, with the term that stands in its place, if any."""
    got, expected, near = one.got, one.expected, one.allowed
    beside = [x for x in wrong if x.row == one.row and x is not one]
    for x, y in ((one, other) for other in beside):
        lost, extra = (x, y) if abs(x.got) <= x.allowed else (y, x)
        moved = abs(extra.got - extra.expected - lost.expected) <= lost.allowed + extra.allowed
        if abs(lost.got) <= lost.allowed < abs(lost.expected) and moved:
            what = f"missing, {extra.name} in its place"
            return f"row {names[lost.row]}, {lost.name}: {what}: {lost.expected:.6g}"
    numbers = "got {}, expected {}".format(*format_distinct(got, expected))
    if abs(expected) <= near:
        return f"row {names[one.row]}, {one.name}: should vanish: got {got:.6g}"
    known = {-1.0: "wrong sign", 0.0: "missing", 0.5: "half", 2.0: "twice as large"}
    for factor, what in known.items():
        if abs(got - factor * expected) <= near:
            numbers = f"expected {expected:.6g}" if factor == 0.0 else numbers
            return f"row {names[one.row]}, {one.name}: {what}: {numbers}"
    return f"row {names[one.row]}, {one.name}: {numbers}"
