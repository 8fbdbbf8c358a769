"""Bounds on degrees and coefficients: right on known quantities, safe on any."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.fractions_of_polynomials import (
    Pair,
    log_sum_of_coefficients,
    solve_pairs,
    total_degree,
    variables,
)

from eomcheck.errors import RefusedError
from eomcheck.numbers.finite_field import ONE, Bound, DegreeArithmetic, Denominator, log_sum
from eomcheck.numbers.linear import solve


def symbols(count: int) -> list[Bound]:
    return list(DegreeArithmetic().vector(count))


def facts(x: Bound) -> tuple[int, float, int, dict]:
    return x.degree, 2**x.height, x.twos, dict(x.denominator.factors)


# ---- Polynomials ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "degree", "coefficients", "twos"),
    [
        (lambda x, y: x, 1, 1, 0),
        (lambda x, y: x + y, 1, 2, 0),
        (lambda x, y: x - y, 1, 2, 0),
        (lambda x, y: -x, 1, 1, 0),
        (lambda x, y: x * y, 2, 1, 0),
        (lambda x, y: (x + y) * (x + y), 2, 4, 0),
        (lambda x, y: x * x * x + y, 3, 2, 0),
        (lambda x, y: 3 * x, 1, 3, 0),
        (lambda x, y: x * -3, 1, 3, 0),
        (lambda x, y: x + 5, 1, 6, 0),
        (lambda x, y: 5 - x, 1, 6, 0),
        (lambda x, y: x - 5, 1, 6, 0),
        (lambda x, y: x / 4, 1, 1, 2),
        (lambda x, y: x / 4 + y, 1, 5, 2),
        (lambda x, y: x / 2 + y / 2, 1, 2, 1),
        (lambda x, y: (x / 2) * (y / 4), 2, 1, 3),
    ],
)
def test_polynomials_have_their_degree_and_their_sum_of_coefficients(
    formula, degree, coefficients, twos
):
    found = formula(*symbols(2))
    assert (found.degree, found.twos, found.denominator) == (degree, twos, ONE)
    assert math.isclose(2**found.height, coefficients)


def test_literal_zeros_and_ones_leave_everything_as_it_is():
    (x,) = symbols(1)
    assert x + 0 is 0 + x is x * 1 is 1 * x is x
    assert type(x * 0) is type(0 / x) is int
    assert x * 0 == 0 * x == 0 / x == 0


@pytest.mark.parametrize("divisor", [0, 3, -2, 6])
def test_a_literal_that_is_no_power_of_two_divides_nothing(divisor):
    with pytest.raises(TypeError, match=f"division by the literal {divisor}"):
        symbols(1)[0] / divisor


@pytest.mark.parametrize(
    "operation",
    [
        lambda x: x + 0.5,
        lambda x: 0.5 - x,
        lambda x: 0.5 * x,
        lambda x: x / 0.5,
        lambda x: x**0,
        lambda x: x**0.5,
        lambda x: x == x + 0 * x + 1,
        lambda x: bool(x),
        lambda x: abs(x),
        lambda x: x < x,
    ],
)
def test_what_is_not_rational_or_no_integer_raises_a_type_error(operation):
    with pytest.raises(TypeError):
        operation(symbols(1)[0])


# ---- Quotients -----------------------------------------------------------------------------------


def test_a_divisor_is_multiplied_into_what_has_another_denominator():
    x, y, z = symbols(3)
    found = x / (y + z) + x
    # x + x (y + z) over y + z
    (divisor,) = found.denominator.factors
    assert (found.degree, divisor.degree) == (2, 1)
    assert math.isclose(2**found.height, 3)
    assert math.isclose(2**divisor.height, 2)


def test_a_shared_divisor_is_recognised_by_the_object():
    x, y, z = symbols(3)
    found = x / y + z / y
    assert facts(found) == (1, 2.0, 0, {y: 1})
    assert facts(found * (x / y)) == (2, 2.0, 0, {y: 2})
    assert facts(x / y / y + z / y) == (2, 2.0, 0, {y: 2})
    assert found.denominator is (z / y).denominator


def test_distinct_divisors_with_equal_bounds_are_not_confused():
    x, y, z = symbols(3)
    assert facts(x / y + x / z) == (2, 2.0, 0, {y: 1, z: 1})
    first, second = y + z, y + z
    assert facts(x / first + x / second)[0] == 2
    assert facts(x / first + x / first)[0] == 1
    assert facts(x / first - x / -first)[0] == 2


def test_a_quotient_by_a_quotient_divides_by_its_numerator():
    x, y, z = symbols(3)
    below = y / 4 / z
    found = x / below
    # x · 4 z / y: the divisor stands for the numerator of `below`, which is y.
    assert facts(found) == (2, 4.0, 0, {below: 1})
    assert facts(1 / below) == (1, 4.0, 0, {below: 1})
    assert facts(3 / y) == (0, 3.0, 0, {y: 1})


def test_denominators_of_equal_factors_are_one_object():
    x, y = symbols(2)
    product = Denominator.of({x: 1}).times(Denominator.of({y: 2}))
    assert product is Denominator.of({y: 2, x: 1})
    assert product.common(Denominator.of({x: 3})) is Denominator.of({x: 3, y: 2})
    assert ONE.times(product) is product.times(ONE) is product.common(ONE) is product
    assert (product.degree, product.height) == (3, 0.0)


def test_sums_of_very_different_sizes_neither_overflow_nor_vanish():
    assert log_sum([5000.0, 5000.0]) == 5001.0
    assert log_sum([5000.0, -5000.0]) == 5000.0
    huge = Bound(1, 1e6)
    assert (huge + Bound(1, 0.0)).height == (Bound(1, 0.0) + huge).height == 1e6


# ---- Variables -----------------------------------------------------------------------------------


def test_every_number_is_a_variable_of_its_own():
    x = DegreeArithmetic().numbers(np.ones((2, 3)))
    assert x.shape == (2, 3)
    assert len({id(y) for y in x.ravel()}) == 6
    assert all((y.degree, y.height) == (1, 0.0) for y in x.ravel())


def test_angles_keep_a_value_that_is_a_variable_and_have_cosines_and_sines_of_their_own():
    degrees = DegreeArithmetic()
    q = degrees.vector(2)
    kept, drawn = degrees.angles(q), degrees.angles(np.zeros(2))
    assert kept.value is q
    assert len({id(x) for x in (*kept.value, *kept.cos, *kept.sin, *drawn.value)}) == 8


# ---- Systems -------------------------------------------------------------------------------------


def bound_facts(x: Bound) -> tuple[int, float]:
    return x.degree, round(2**x.height, 6)


def test_a_diagonal_system_divides_by_the_product_of_its_diagonal():
    a, b, x, y = symbols(4)
    found = solve(np.array([[a, 0], [0, b]], object), np.array([x * x, y], object), "A")
    (divisor,) = found[0].denominator.factors
    assert bound_facts(divisor) == (2, 1.0)
    # x² b and y a: the bound does not know which row meets which unknown.
    assert [bound_facts(z) for z in found] == [(3, 2.0)] * 2
    assert found[1].denominator is found[0].denominator


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_a_full_system_of_variables_is_bounded_by_the_product_of_its_row_sums(size):
    """The true determinant has the degree `size` and size! terms, its bound size^size."""
    A = DegreeArithmetic().numbers(np.zeros((size, size)))
    b = DegreeArithmetic().vector(size)
    found = solve(A, b, "A")
    (divisor,) = found[0].denominator.factors
    assert bound_facts(divisor) == (size, float(size**size))
    assert bound_facts(found[0]) == (size, float(size**size))


def test_several_right_hand_sides_share_the_determinant_and_zeros_stay_literal():
    A, b = DegreeArithmetic().numbers(np.zeros((2, 2))), DegreeArithmetic().vector(2)
    columns = np.array([[b[0], 0, 1], [b[1], 0, 0]], object)
    found = solve(A, columns, "A")
    assert found[:, 1].tolist() == [0, 0]
    assert found[0, 0].denominator is found[1, 2].denominator
    assert found[0, 2].degree == 1
    assert solve(A, np.zeros(2, object), "A").tolist() == [0, 0]


def test_a_denominator_that_a_row_shares_with_its_right_hand_side_cancels():
    a, d, x, _ = symbols(4)
    found = solve(np.array([[a / d]], object), np.array([x / d], object), "A")[0]
    (divisor,) = found.denominator.factors
    assert bound_facts(found) == (1, 1.0)
    assert bound_facts(divisor) == (1, 1.0)
    assert d not in found.denominator.factors


def test_a_row_of_literal_zeros_is_refused_by_the_name_of_the_matrix():
    (x,) = symbols(1)
    with pytest.raises(RefusedError, match="a row of the matrix M_X is zero"):
        solve(np.array([[x, 1], [0, 0]], object), np.array([x, x], object), "M_X")


def test_two_solves_of_one_matrix_are_not_taken_for_one_divisor():
    """Safe, if wasteful: nothing is remembered of a matrix."""
    A, b = DegreeArithmetic().numbers(np.zeros((2, 2))), DegreeArithmetic().vector(2)
    first, second = solve(A, b, "A")[0], solve(A, b, "A")[0]
    assert (first + second).degree == 4
    assert (first + first).degree == 2


SYSTEMS = {
    "variables": lambda x, y, z: ([[x, y], [z, x + 1]], [y, z]),
    "literals": lambda x, y, z: ([[0, 1, x], [1, 0, 0], [y, z, 0]], [1, 0, x * z]),
    "denominators": lambda x, y, z: ([[x / y, z / 4], [1 / z, x / (y + z)]], [z / y, x]),
    "one denominator": lambda x, y, z: ([[x / y, z / y], [z / y, x / y]], [x / y, 1 / y]),
    "powers": lambda x, y, z: ([[x / y / y, z / y], [z, x]], [x / y / y / y, z / 8]),
    "halves": lambda x, y, z: ([[x / 2, y / 4], [z / 8, x + y]], [x / 16, z]),
    "nothing right": lambda x, y, z: ([[x, y], [y, z]], [0, 0]),
    "hidden zeros": lambda x, y, z: ([[x - x, y], [z, x]], [x - x, z * y - y * z]),
    "four": lambda x, y, z: (
        [[x, 1, 0, y], [0, z, x, 1], [1, 0, y, z], [z, x, 1, 0]],
        [x, y / 2, 0, 1],
    ),
}


@pytest.mark.parametrize("key", SYSTEMS)
def test_cramers_bounds_hold_for_the_true_numerators_and_determinants(key):
    x, y, z = variables()
    A, b = SYSTEMS[key](x, y, z)
    for entry in solve_pairs(A, b, x.known):
        if isinstance(entry, Pair):
            entry.check()


def test_cramers_bounds_are_close_to_a_true_determinant():
    x, y, z = variables()
    A, b = SYSTEMS["literals"](x, y, z)
    found = [entry for entry in solve_pairs(A, b, x.known) if isinstance(entry, Pair)]
    (divisor,) = found[0].bound.denominator.factors
    true = x.known.polynomials[divisor]
    assert (total_degree(true), divisor.degree) == (2, 2)
    assert log_sum_of_coefficients(true) == 0.0
    assert divisor.height == 2.0


# ---- Safe on any computation ---------------------------------------------------------------------

LARGEST_DEGREE, MOST_TERMS = 30, 3000
"""What grows beyond this is left out of the further computation, to keep examples fast."""

literals = st.sampled_from([-3, -2, -1, 0, 1, 2, 5])
places = st.integers(0, 10**6)
operands = st.one_of(places.map(lambda i: ("of", i)), literals.map(lambda i: ("literal", i)))
steps = st.one_of(
    st.tuples(st.sampled_from(["+", "-", "*", "/"]), places, operands),
    st.tuples(st.sampled_from(["r+", "r-", "r*", "r/"]), places, literals),
    st.tuples(st.just("-x"), places, st.none()),
    st.tuples(st.just("/2^k"), places, st.integers(1, 4)),
    # Few divisors, often: powers of them, and sums over different powers.
    st.tuples(st.just("/"), places, st.integers(0, 2).map(lambda i: ("of", i))),
    st.tuples(st.just("+"), st.integers(3, 8), st.integers(3, 8).map(lambda i: ("of", i))),
    st.tuples(
        st.just("solve"),
        st.integers(1, 3),
        st.lists(st.one_of(operands, st.just(("literal", 0))), min_size=12, max_size=12),
    ),
)
OPERATIONS = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "r+": lambda x, y: y + x,
    "r-": lambda x, y: y - x,
    "r*": lambda x, y: y * x,
    "r/": lambda x, y: y / x,
    "-x": lambda x, _: -x,
    "/2^k": lambda x, k: x / 2**k,
}


def results(step, made: list[Pair]) -> list:
    """Return what one step of a computation makes out of what was made before."""

    def operand(chosen):
        kind, value = chosen
        return made[value % len(made)] if kind == "of" else value

    operation, first, second = step
    if operation == "solve":
        entries = [operand(chosen) for chosen in second]
        A = [entries[first * i : first * (i + 1)] for i in range(first)]
        if not any(isinstance(x, Pair) for x in entries[: first * first]):
            return []  # literals alone are solved in fractions
        return solve_pairs(A, entries[first * first : first * first + first], made[0].known)
    right = operand(second) if isinstance(second, tuple) else second
    if operation == "/" and isinstance(right, int):
        right = 2  # other literals are refused, or are `/2^k`
    return [OPERATIONS[operation](made[first % len(made)], right)]


@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(steps, min_size=1, max_size=20))
@pytest.mark.night
def test_no_bound_of_a_random_computation_is_too_small(computation):
    """Of every intermediate result, with divisors shared and distinct, nested and cancelled."""
    made = variables()
    for step in computation:
        try:
            new = results(step, made)
        except (ZeroDivisionError, RefusedError):
            continue
        for x in new:
            if isinstance(x, Pair):
                x.check()
                terms = len(x.exact.p.coeffs()) + len(x.exact.q.coeffs())
                if x.bound.degree <= LARGEST_DEGREE and terms <= MOST_TERMS:
                    made.append(x)


def test_a_bound_that_is_too_small_is_noticed():
    """The check itself: a degree or a height that is one too small, a divisor forgotten."""
    x, y, z = variables()
    right = (x + y) * z / (y + z) + x / 2
    right.check()
    b = right.bound
    for wrong in (
        Bound(b.degree - 1, b.height, b.twos, b.denominator),
        Bound(b.degree, b.height - 1.2, b.twos, b.denominator),
        Bound(b.degree, b.height, 0, b.denominator),
        Bound(b.degree, b.height, b.twos),
    ):
        with pytest.raises(AssertionError):
            Pair(right.exact, wrong, right.known).check()
