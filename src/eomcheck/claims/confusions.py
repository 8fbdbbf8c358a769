"""Confusions: one list of transformations that turn an expected array into a wrong one, as bugs do.

Each of `TRANSFORMATIONS` yields candidates: what an array would be with another sign, transposed,
in degrees, about another point, and so on. `recognize` returns the first candidate that a whole
array agrees with; `locate` else looks for rows, columns or the worst entry with a wrong factor.
No parameter is fitted, so that agreement to rounding is no chance: rotations, arms and terms are
supplied by the claim in a `ConfusionContext`, and candidates that rounding does not distinguish
from the expected array are no diagnosis. All works in float64 within a bound, and in exact numbers
with equality; values that are not finite agree with nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np

from eomcheck.claims.finding import LISTED, Names, entry_name, format_distinct, worst_of
from eomcheck.evaluation.tolerance import largest
from eomcheck.numbers.generic import EPS, Array
from eomcheck.safe_output import listed

RowKind = Literal["", "point", "vector", "motion", "acceleration", "force"]


class ConfusionContext(NamedTuple):
    """Arrays that a claim knows beside the two it compares; those not given are not tried.

    The expected array is in our conventions: along the axes of the world, linear rows first,
    accelerations classical.

    Attributes:
        rows: kind of axis 0: "point" and "vector" have three rows; "motion" (velocities),
            "acceleration" and "force" (also momenta) six, linear ones first; "" is any other.
        R: axes of the frame along those of the world, as columns (3, 3).
        frame: its name in texts.
        point: name of the reference point of the expected array.
        arms: name of another reference point -> vector from the expected one to it (3,), m, along
            the axes of the world.
        omega: angular velocity of the frame (3,), rad/s.
        velocity: velocity of the reference point (3,), m/s.
        terms: name of a summand of the expected array, such as "gravity" -> its value, same shape.
        alternatives: text -> array in another convention, same shape.
        joint_axes: axes of the array that run over joints; by default all of a square one, else the
            last one, other than of `rows`.
        single_precision: whether errors as small as the rounding of float32 are recognized.
    """

    rows: RowKind = ""
    R: Array | None = None
    frame: str = "the frame"
    point: str = "the frame"
    arms: Mapping[str, Array] = {}
    omega: Array | None = None
    velocity: Array | None = None
    terms: Mapping[str, Array] = {}
    alternatives: Mapping[str, Array] = {}
    joint_axes: tuple[int, ...] | None = None
    single_precision: bool = False

    @property
    def is_spatial(self) -> bool:
        """Whether there are three linear and three angular rows."""
        return self.rows in ("motion", "acceleration", "force")


NO_CONTEXT = ConfusionContext()

# ---- Agreement -----------------------------------------------------------------------------------

Agreement = Callable[[Any, Any], Any]
"""Function of two arrays -> flags of the entries that agree."""

SLACK = 1e3
"""Relative error, in units of ε, of entries that agree though `allowed` is smaller."""

SINGLE_PRECISION = "as large as the rounding of single precision"

LEAST_FLOAT32 = 2.0**-32
"""Smallest error attributed to single precision, relative to the largest entry."""

FLOAT32 = 2.0**-19
"""Largest error attributed to single precision, relative to the largest entry.

An engine that declares float32 is allowed at least as much."""


def agreement_within(allowed: Any) -> Agreement:
    """Return the agreement of float64 arrays to an allowed error, a number or one per entry."""

    def agree(x: Array, y: Array) -> Any:
        with np.errstate(all="ignore"):
            error, size = np.abs(x - y), np.maximum(np.abs(x), np.abs(y))
            return np.isfinite(error) & (error <= np.maximum(allowed, SLACK * EPS * size))

    return agree


def equal(x: Any, y: Any) -> Any:
    """Return the flags of equal entries of two exact arrays."""
    return np.asarray(np.asarray(x) == np.asarray(y), bool)


def agree_everywhere(x: Any, y: Any, agree: Agreement) -> bool:
    """Return whether two arrays agree in their shapes and in every entry."""
    return np.shape(x) == np.shape(y) and bool(np.all(agree(x, y)))


class Candidate(NamedTuple):
    """An array that a known confusion makes of the expected one.

    Attributes:
        text: name of the confusion.
        array: the array, times `denominator`.
        denominator: number by which it is to be divided, 1 in float64: exact numbers may have no
            quotients.
        within: error attributed to the confusion itself, relative to the largest entry.
    """

    text: str
    array: Any
    denominator: int = 1
    within: float = 0.0


def matching(
    actual: Array, expected: Array, candidates: Iterable[Candidate], agree: Agreement
) -> Iterator[Candidate]:
    """Yield the candidates with which an array agrees, other than those like the expected array."""
    for candidate in candidates:
        if candidate.within:
            error = largest(actual - candidate.array)
            if np.isfinite(error) and error <= candidate.within * largest(expected):
                yield candidate
            continue
        scaled = (actual, expected)
        if candidate.denominator != 1:
            scaled = candidate.denominator * actual, candidate.denominator * expected
        if agree_everywhere(scaled[0], candidate.array, agree) and not agree_everywhere(
            scaled[1], candidate.array, agree
        ):
            yield candidate


# ---- Transformations -----------------------------------------------------------------------------

OPPOSITE, MISSING = "wrong sign", "missing"

SCALINGS: dict[str, tuple[int, int]] = {
    OPPOSITE: (-1, 1),
    MISSING: (0, 1),
    "twice the expected value": (2, 1),
    "half the expected value": (1, 2),
    "4 times the expected value": (4, 1),
    "a quarter of the expected value": (1, 4),
}
"""Confusion of scale -> rational factor, as numerator and denominator."""

UNITS: dict[str, float] = {
    "in degrees": 180.0 / np.pi,
    "per degree": np.pi / 180.0,
    "1000 times the expected value, as with mm for m or g for kg": 1e3,
    "a 1000th of the expected value, as with m for mm or kg for g": 1e-3,
    "10⁶ times the expected value, as with mm² for m²": 1e6,
}
"""Confusion of units -> factor; there is no π in exact numbers."""

TERM_MULTIPLES: dict[float, str] = {-1: "without {}", 1: "{} twice", -2: "{} with the wrong sign"}
"""Multiple of a term by which a sum is too large -> text about the term."""

MOST_JOINTS = 100
"""Largest number of joints whose order is searched for."""

MOST_STEPS = 2000
"""Largest number of joints that are tried in the search for an order of rows and columns."""

Candidates = Callable[[Array, Array, ConfusionContext, Agreement], Iterator[Candidate]]


def is_exact(x: Array) -> bool:
    """Return whether an array has exact numbers, which have no roundings, sizes or π."""
    return np.asarray(x).dtype == object


def _single_precision(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    if not context.single_precision or is_exact(expected) or actual.shape != expected.shape:
        return
    if largest(actual - expected) >= LEAST_FLOAT32 * largest(expected):
        yield Candidate(SINGLE_PRECISION, expected, within=FLOAT32)


def _scaled(expected: Any) -> Iterator[Candidate]:
    for text, (numerator, denominator) in SCALINGS.items():
        if is_exact(expected):
            yield Candidate(text, numerator * expected, denominator)
        else:
            yield Candidate(text, numerator / denominator * expected)


def _in_units(expected: Any) -> Iterator[Candidate]:
    if not is_exact(expected):
        for text, factor in UNITS.items():
            yield Candidate(text, factor * expected)


def _transposed(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    if expected.ndim != 2:
        return
    yield Candidate("transposed", expected.T)
    rows, columns = expected.shape
    if columns <= rows or columns % rows:
        return
    blocks = range(0, columns, rows)  # such as ∂τ/∂q beside ∂τ/∂v
    parts = [expected[:, start : start + rows] for start in blocks]
    for k, start in enumerate(blocks):
        one_turned = [part.T if k == i else part for i, part in enumerate(parts)]
        text = f"columns {start + 1} to {start + rows} transposed"
        yield Candidate(text, np.concatenate(one_turned, axis=1))
    text = f"each block of {rows} columns transposed"
    yield Candidate(text, np.concatenate([part.T for part in parts], axis=1))


def _one_triangle(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    if expected.ndim == 2 and expected.shape[0] == expected.shape[1]:
        yield Candidate("the upper triangle alone", np.triu(expected))
        yield Candidate("the lower triangle alone", np.tril(expected))


def _terms(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    for name, term in context.terms.items():
        for multiple, text in TERM_MULTIPLES.items():
            yield Candidate(text.format(name), expected + multiple * term)
        yield Candidate(f"{name} alone", np.array(term))


def _alternatives(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    for text, array in context.alternatives.items():
        yield Candidate(text, array)


Change = tuple[str, Callable[[Array], Array]]
"""Change of a convention: its text, and the function that makes it."""

UNCHANGED: Change = "", lambda x: x


def _cross(x: Any, y: Any) -> Array:
    """Return x × y of a vector (3,) and rows (3, ...), in any numbers."""
    return np.cross(x, y, axisa=0, axisb=0, axisc=0)


def _with_parts(x: Array, linear: Any = None, angular: Any = None) -> Array:
    """Return six rows of which the linear or the angular ones are replaced."""
    parts = x[:3] if linear is None else linear, x[3:] if angular is None else angular
    return np.concatenate(parts)


def _conventions(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    """Yield changes of acceleration, reference point, axes and order, the fewest at once first."""
    rows = {"": 0, "point": 3, "vector": 3}.get(context.rows, 6)
    if not rows or expected.ndim == 0 or len(expected) != rows:
        return
    changes = (
        (*origin, axes, order)
        for origin, axes, order in product(_origins(context), _axes(context), _orders(context))
    )
    for several in sorted(changes, key=lambda each: sum(bool(text) for text, _ in each)):
        array = expected
        for _, change in several:
            array = change(array)
        yield Candidate("; ".join(text for text, _ in several if text), array)


def _origins(context: ConfusionContext) -> Iterator[tuple[Change, Change]]:
    """Yield changes of accelerations, each with every change of the reference point."""
    texts = {"force": "angular part about {}, expected about {}", "point": "at {}, expected at {}"}
    text = texts.get(context.rows, "linear part at {}, expected at {}")
    arms = {} if context.rows == "vector" else context.arms
    accelerations = [*_accelerations(context)]
    # Spatial ones first: where a body turns about the origin they are those of its point there.
    yield from ((acceleration, UNCHANGED) for acceleration, _ in accelerations)
    for acceleration, is_spatial in accelerations:
        for name, arm in arms.items():
            moved = partial(_moved, context, arm, is_spatial)
            yield acceleration, (text.format(name, context.point), moved)


def _accelerations(context: ConfusionContext) -> Iterator[tuple[Change, bool]]:
    """Yield changes of accelerations, and whether they are spatial thereafter."""
    omega, velocity = context.omega, context.velocity
    yield UNCHANGED, False
    if context.rows == "acceleration" and omega is not None and velocity is not None:
        turning = _cross(omega, velocity)
        spatial = "spatial acceleration, expected classical"
        yield (spatial, lambda x: _with_parts(x, linear=x[:3] - turning)), True
        more = "ω × v added once too often"
        yield (more, lambda x: _with_parts(x, linear=x[:3] + turning)), False


def _moved(context: ConfusionContext, arm: Any, is_spatial: bool, x: Array) -> Array:
    """Return rows about a reference point at the end of an arm."""
    if context.rows == "point":
        return x + arm
    if context.rows == "force":
        return _with_parts(x, angular=x[3:] - _cross(arm, x[:3]))
    linear = x[:3] - _cross(arm, x[3:])
    if context.rows == "acceleration" and not is_spatial and context.omega is not None:
        linear = linear + _cross(context.omega, _cross(context.omega, arm))
    return _with_parts(x, linear=linear)


def _axes(context: ConfusionContext) -> list[Change]:
    R = context.R
    if R is None:
        return [UNCHANGED]
    own = f"along {context.frame}'s own axes, expected along the world's"
    twice = f"turned from {context.frame}'s axes to the world's twice"
    if not context.is_spatial:
        return [UNCHANGED, (own, lambda x: R.T @ x), (twice, lambda x: R @ x)]

    def turned(S: Array, linear: bool = True, angular: bool = True) -> Callable[[Array], Array]:
        return lambda x: _with_parts(
            x, S @ x[:3] if linear else None, S @ x[3:] if angular else None
        )

    return [
        UNCHANGED,
        (own, turned(R.T)),
        (f"linear part {own}", turned(R.T, angular=False)),
        (f"angular part {own}", turned(R.T, linear=False)),
        (twice, turned(R)),
    ]


def _orders(context: ConfusionContext) -> list[Change]:
    if not context.is_spatial:
        return [UNCHANGED]
    return [
        UNCHANGED,
        ("angular part first, expected linear first", lambda x: np.concatenate((x[3:], x[:3]))),
    ]


def _joints_in_another_order(
    actual: Array, expected: Array, context: ConfusionContext, agree: Agreement
) -> Iterator[Candidate]:
    if actual.shape != expected.shape or expected.ndim not in (1, 2):
        return
    axes = _joint_axes(expected, context)
    counts = {expected.shape[axis] for axis in axes}
    if len(counts) != 1 or not 2 <= (n := counts.pop()) <= MOST_JOINTS:
        return
    if len(axes) == 1:
        along = axes[0]
        slices = np.moveaxis(actual, along, 0), np.moveaxis(expected, along, 0)
        order = _order_of_slices(slices[0], slices[1], agree)
    else:
        order = _order_of_rows_and_columns(actual, expected, agree)
    if order is None:
        return
    displaced = [k for k in range(n) if order[k] != k]
    permuted = expected
    for axis in axes:
        permuted = np.take(permuted, order, axis)
    # One number in the place of another, beside zeros, is not an order.
    values = [np.take(expected, k, axes[0]) for k in displaced]
    if sum(not agree_everywhere(x, 0 * x, agree) for x in values) > 1:
        yield Candidate("joints in another order", permuted)


def _joint_axes(expected: Array, context: ConfusionContext) -> tuple[int, ...]:
    if context.joint_axes is not None:
        return context.joint_axes
    if context.rows:
        return (1,) if expected.ndim == 2 else ()
    square = expected.ndim == 2 and expected.shape[0] == expected.shape[1]
    return (0, 1) if square else (expected.ndim - 1,)


def _order_of_slices(actual: Array, expected: Array, agree: Agreement) -> list[int] | None:
    """Return the index in `expected` of each slice of `actual` along axis 0, None if none."""
    order: list[int] = []
    for k, x in enumerate(actual):
        free = [j for j in (k, *range(len(expected))) if j not in order]
        like = next((j for j in free if np.all(agree(x, expected[j]))), None)
        if like is None:
            return None
        order.append(like)
    return order


def _order_of_rows_and_columns(
    actual: Array, expected: Array, agree: Agreement
) -> list[int] | None:
    """Return the order of joints in a matrix of them, by a search with backtracking."""
    n, order, steps = len(expected), [], 0
    untried = [_preferred(0, n)]
    while untried:
        k = len(order)
        j = next((j for j in untried[-1] if j not in order), None)
        steps += 1
        if j is None or steps > MOST_STEPS:
            if not order or steps > MOST_STEPS:
                return None
            untried.pop()
            order.pop()
            continue
        chosen = [*order, j]
        rows = agree(actual[k, : k + 1], expected[j, chosen])
        if np.all(rows) and np.all(agree(actual[: k + 1, k], expected[chosen, j])):
            order.append(j)
            if len(order) == n:
                return order
            untried.append(_preferred(k + 1, n))
    return None


def _preferred(k: int, n: int) -> Iterator[int]:
    """Yield the joints 0, ..., n - 1, the k-th one first."""
    return iter([k, *(j for j in range(n) if j != k)])


class Transformation(NamedTuple):
    """A kind of confusion.

    Attributes:
        key: its name in a word or two.
        candidates: function of (actual, expected, context, agreement) that yields what it makes of
            the expected array.
    """

    key: str
    candidates: Candidates


TRANSFORMATIONS: tuple[Transformation, ...] = (
    Transformation("single precision", _single_precision),
    Transformation("factor", lambda actual, expected, *_: _scaled(expected)),
    Transformation("transposed", _transposed),
    Transformation("units", lambda actual, expected, *_: _in_units(expected)),
    Transformation("triangle", _one_triangle),
    Transformation("term", _terms),
    Transformation("alternative", _alternatives),
    Transformation("convention", _conventions),
    Transformation("order of joints", _joints_in_another_order),
)
"""All confusions that are recognized, the simpler ones first: of two that agree the first is named.

"""

# ---- Diagnoses -----------------------------------------------------------------------------------


def recognize(
    actual: Array,
    expected: Array,
    allowed: Any = 0.0,
    context: ConfusionContext = NO_CONTEXT,
    *,
    agree: Agreement | None = None,
) -> str:
    """Return the first confusion that explains every entry of a wrong array, "" if none does.

    Args:
        actual: the array under test.
        expected: its expected value.
        allowed: bound on the rounding error, a number or one per entry.
        context: further arrays of the claim.
        agree: flags of entries that agree, by default those within the bound.
    """
    agree = agreement_within(allowed) if agree is None else agree
    actual, expected = np.asarray(actual), np.asarray(expected)
    with np.errstate(all="ignore"):
        for transformation in TRANSFORMATIONS:
            candidates = transformation.candidates(actual, expected, context, agree)
            for candidate in matching(actual, expected, candidates, agree):
                return candidate.text
    return ""


def scaling(actual: Any, expected: Any, agree: Agreement) -> str:
    """Return the wrong factor or unit of all entries, "" if there is none."""
    actual, expected = np.asarray(actual), np.asarray(expected)
    with np.errstate(all="ignore"):
        candidates = [*_scaled(expected), *_in_units(expected)]
        return next((x.text for x in matching(actual, expected, candidates, agree)), "")


def term_multiple(error: Array, term: Array, allowed: Any, term_error: Any = 0.0) -> float | None:
    """Return the multiple of a term that explains an error, a key of `TERM_MULTIPLES`, or None.

    Args:
        error: actual - expected.
        term: a summand of the expected array, same shape.
        allowed: allowed error of the difference.
        term_error: allowed error of the term.
    """
    for multiple in TERM_MULTIPLES:
        agree = agreement_within(allowed + abs(multiple) * term_error)
        candidate = Candidate("", multiple * term)
        if any(matching(error, 0.0 * term, [candidate], agree)):
            return multiple
    return None


class Difference(NamedTuple):
    """The place of a difference and the confusion that explains it.

    Attributes:
        where: the worst entry, or the rows or columns that are explained: "row ω_z".
        what: the confusion, "" if none is recognized.
        actual, expected: the numbers of the worst entry.
    """

    where: str
    what: str
    actual: Any
    expected: Any

    @property
    def text(self) -> str:
        """The confusion, or else both numbers in float64."""
        return self.what or "{}, expected {}".format(*format_distinct(self.actual, self.expected))


def locate(
    actual: Array,
    expected: Array,
    names: Names,
    allowed: float = 0.0,
    context: ConfusionContext = NO_CONTEXT,
    *,
    worst: tuple[int, ...] | None = None,
    agree: Agreement | None = None,
) -> Difference:
    """Return the place of a difference and its confusion: of all, of rows, or of one entry.

    Args:
        actual: the array under test.
        expected: its expected value, same shape.
        names: names along each axis, () if there are none.
        allowed: bound on the rounding error.
        context: further arrays of the claim.
        worst: index of the entry, by default that of the largest error.
        agree: flags of entries that agree, by default those within the bound.
    """
    actual, expected = np.asarray(actual), np.asarray(expected)
    agree = agreement_within(allowed) if agree is None else agree
    if worst is None:
        with np.errstate(all="ignore"):
            worst = worst_of(actual - expected)
    where = entry_name(worst, names) if len(names) == len(worst) else ""
    what = recognize(actual, expected, context=context, agree=agree)
    if not what:
        for axis in range(actual.ndim if actual.ndim == 2 or context.rows else 0):
            if rows := _scaled_slices(actual, expected, axis, worst, agree):
                which, what = rows
                named = [names[axis][k] for k in which] if names else []
                where = _listed("row" if axis == 0 else "column", named)
                break
    if not what:
        what = _of_one_entry(actual[worst], expected[worst], agree)
    return Difference(where, what, actual[worst], expected[worst])


def _of_one_entry(x: Any, y: Any, agree: Agreement) -> str:
    if what := scaling(x, y, agree):
        return what
    with np.errstate(all="ignore"):
        zero = 0 * y
    return "should vanish" if np.all(agree(y, zero)) and not np.all(agree(x, zero)) else ""


def _scaled_slices(
    actual: Array, expected: Array, axis: int, worst: tuple[int, ...], agree: Agreement
) -> tuple[Sequence[int], str] | None:
    """Return the wrong slices along an axis, and the factor that all of them have; None if not."""
    actual, expected = np.moveaxis(actual, axis, 0), np.moveaxis(expected, axis, 0)
    wrong = ~np.asarray(agree(actual, expected), bool)
    if not wrong[worst[axis]].any():
        return None
    count = wrong if wrong.ndim == 1 else wrong.sum(axis=1)
    slices = [int(k) for k in np.flatnonzero(count)]
    if (wrong.ndim == 2 and min(count[slices], default=0) < 2) or len(slices) == len(wrong):
        return None  # single entries have names of their own
    what = scaling(actual[slices], expected[slices], agree)
    return (slices, what) if what else None


def _listed(kind: str, names: list[str]) -> str:
    return f"{kind}{'s' if len(names) > 1 else ''} {listed(names, LISTED)}"


def diagnose(
    actual: Array,
    expected: Array,
    allowed: float,
    worst: tuple[int, ...] | None = None,
    context: ConfusionContext = NO_CONTEXT,
) -> str:
    """Describe the confusion in an array, "transposed" or "wrong sign", or give both numbers.

    Args:
        actual: the array under test.
        expected: its expected value, same shape.
        allowed: bound on the rounding error.
        worst: index of the entry whose numbers are given, by default that of the largest error.
        context: further arrays of the claim.
    """
    return locate(actual, expected, (), allowed, context, worst=worst).text
