"""Numbers that carry a derivative: exact over fractions, over a field, and over themselves."""

from __future__ import annotations

import operator
from fractions import Fraction

import flint
import numpy as np
import pytest
from tests.exact import RandomFractions

from eomcheck.numbers.dual import Dual, dual_angles, dual_root, duals, rate
from eomcheck.numbers.generic import EPS
from eomcheck.numbers.linear import solve

SEVEN = 7
KINDS = {
    "fraction": lambda x: Fraction(x),
    "field": lambda x: flint.nmod(x, 2**61 - 1),
    "dual": lambda x: Dual(Fraction(x), Fraction(5)),
}
kinds = pytest.mark.parametrize("kind", KINDS)


def value(x):
    """Return x without any derivative."""
    return value(x.x) if isinstance(x, Dual) else x


def test_duals_differentiate_products_and_quotients():
    x = Dual(Fraction(3), Fraction(1))
    assert rate((1 - x) * x / (x + 2)) == Fraction(-19, 25)


@kinds
@pytest.mark.parametrize(
    ("function", "derivative"),
    [
        (lambda x: x + 2, lambda x: 1 + 0 * x),
        (lambda x: 2 + x, lambda x: 1 + 0 * x),
        (lambda x: x - 2, lambda x: 1 + 0 * x),
        (lambda x: 2 - x, lambda x: -1 + 0 * x),
        (lambda x: -x, lambda x: -1 + 0 * x),
        (lambda x: x - x * x, lambda x: 1 - 2 * x),
        (lambda x: 3 * x * x, lambda x: 6 * x),
        (lambda x: x * 3, lambda x: 3 + 0 * x),
        (lambda x: x / 4, lambda x: (1 + 0 * x) / 4),
        (lambda x: 1 / x, lambda x: -1 / (x * x)),
        (lambda x: x / (1 + x), lambda x: 1 / ((1 + x) * (1 + x))),
    ],
)
def test_every_operation_has_its_derivative_in_every_kind_of_number(kind, function, derivative):
    at, one = KINDS[kind](SEVEN), KINDS[kind](1) if kind != "dual" else Fraction(1)
    found = function(Dual(at, one))
    assert value(found.x - function(at)) == 0
    assert value(found.rate - derivative(at)) == 0


def test_a_dual_of_a_dual_carries_the_mixed_second_derivative():
    inner = Dual(Fraction(3), Fraction(1))
    x = Dual(inner, Fraction(1))
    assert rate(rate(x * x * x)) == 18
    assert rate(rate(1 / x)) == Fraction(2, 27)


def test_a_quotient_of_literals_stays_exact():
    assert (Dual(6, 3) / 3).x == 2
    third = Dual(1, 1) / 3
    assert (third.x, third.rate) == (Fraction(1, 3), Fraction(1, 3))
    assert type((Dual(6, 3) / 3).x) is int


def test_what_does_not_move_has_the_rate_zero():
    assert rate(Fraction(3)) == 0
    assert rate(np.array([Dual(2, 1), Fraction(5)], object)).tolist() == [1, 0]


def test_arrays_keep_their_shape():
    x = np.arange(6).reshape(2, 3).astype(object)
    moving = duals(x, 2 * x)
    assert moving.shape == rate(moving).shape == (2, 3)
    assert (rate(moving) == 2 * x).all()
    assert rate(moving @ moving.T).shape == (2, 2)
    assert (rate(moving @ moving.T) == 4 * x @ x.T).all()


def test_arrays_of_different_shapes_are_no_duals():
    with pytest.raises(ValueError, match="shorter"):
        duals(np.zeros(3, object), np.zeros(2, object))


def test_angles_turn_along_the_circle():
    random = RandomFractions(0)
    rates = random.vector(4)
    angles = dual_angles(random.angles(random.vector(4)), rates)
    assert (rate(angles.value) == rates).all()
    assert (rate(angles.cos * angles.cos + angles.sin * angles.sin) == 0).all()
    turned = [value(c) * s.rate - value(s) * c.rate for c, s in zip(*angles[1:], strict=True)]
    assert turned == rates.tolist()


def test_roots_change_by_half_of_what_they_are_of_over_themselves():
    (root,) = dual_root(np.array([Fraction(3)], object), np.array([Fraction(5)], object))
    assert (root.x, root.rate) == (3, Fraction(5, 6))


def test_a_solution_moves_with_its_matrix_and_its_right_hand_side():
    """x = b / A, of order 1: x′ = (b′ - A′ x) / A."""
    A = duals(np.array([[Fraction(2)]], object), np.array([[Fraction(3)]], object))
    b = duals(np.array([Fraction(8)], object), np.array([Fraction(7)], object))
    (x,) = solve(A, b, "A")
    assert (x.x, x.rate) == (4, Fraction(7 - 3 * 4, 2))


@pytest.mark.parametrize(
    ("function", "derivative"),
    [
        (np.sin, np.cos),
        (np.cos, lambda x: -np.sin(x)),
        (np.tan, lambda x: 1 / np.cos(x) ** 2),
        (np.sqrt, lambda x: 0.5 / np.sqrt(x)),
        (np.exp, np.exp),
    ],
)
def test_functions_of_numpy_have_the_derivative_of_the_function_times_that_of_its_argument(
    function, derivative
):
    at, slope = 0.7, 3.0
    (found,) = function(np.array([Dual(at, slope)], object))
    assert abs(found.x - function(at)) <= 4 * EPS
    assert abs(found.rate - slope * derivative(at)) <= 4 * EPS * abs(found.rate)


def test_powers_have_the_derivative_of_a_product():
    found = Dual(Fraction(3), Fraction(2)) ** 3
    assert (found.x, found.rate) == (27, 2 * 3 * 9)


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul, operator.truediv])
@pytest.mark.parametrize("array", [np.array([2.0, 4.0]), duals(np.array([2.0, 4.0]), np.ones(2))])
def test_a_dual_number_and_an_array_are_combined_entry_by_entry(operation, array):
    number = Dual(3.0, 5.0)
    for first, second in ((number, array), (array, number)):
        found = operation(first, second)
        assert found.shape == (2,)
        pairs = zip(
            *np.broadcast_arrays(np.array(first, object), np.array(second, object)), strict=True
        )
        expected = [operation(*(x if isinstance(x, Dual) else Dual(x) for x in p)) for p in pairs]
        assert [value(x) for x in found] == [value(x) for x in expected]
        assert rate(found).tolist() == [x.rate for x in expected]
