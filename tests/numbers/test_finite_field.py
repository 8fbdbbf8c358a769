"""The arithmetic modulo a random prime: its primes, its elements, its solver."""

from __future__ import annotations

import math
import random

import flint
import numpy as np
import pytest

from eomcheck.claims.registry import GenericPoint
from eomcheck.errors import RefusedError
from eomcheck.numbers.dual import ReplayArithmetic, duals, rate, value
from eomcheck.numbers.finite_field import PRIME_COUNT, PRIMES, FiniteField, random_prime
from eomcheck.numbers.generic import RecordingArithmetic
from eomcheck.numbers.linear import solve
from eomcheck.scenes import Snake

LOW, HIGH = PRIMES


def field(seed: int = 0) -> FiniteField:
    source = random.Random(seed)
    return FiniteField(random_prime(source), source)


def of_field(x: np.ndarray, prime: int) -> bool:
    return all(isinstance(y, flint.nmod) and y.modulus() == prime for y in x.ravel())


# ---- Primes --------------------------------------------------------------------------------------


def test_primes_are_prime_of_62_bits_and_differ_from_draw_to_draw():
    source = random.Random(0)
    primes = [random_prime(source) for _ in range(50)]
    assert len(set(primes)) == 50
    assert all(flint.fmpz(p).is_prime() and p.bit_length() == 62 for p in primes)


def test_primes_come_from_the_whole_range():
    source = random.Random(1)
    primes = [random_prime(source) for _ in range(400)]
    quarters = [4 * (p - LOW) // (HIGH - LOW) for p in primes]
    # 100 in each quarter, with a standard deviation of 9.
    assert all(60 < quarters.count(quarter) < 140 for quarter in range(4))


def test_the_number_of_primes_is_bounded_from_below_by_the_stated_inequality():
    below_high = HIGH / math.log(HIGH)
    below_low = 1.25506 * LOW / math.log(LOW)
    assert below_high - below_low > PRIME_COUNT > 0.9 * (below_high - below_low)


def test_primes_are_as_dense_as_their_number_says():
    """Among odd candidates; the true number is near 5.4e16."""
    source, count = random.Random(2), 20_000
    candidates = (source.randrange(LOW + 1, HIGH, 2) for _ in range(count))
    found = sum(flint.fmpz(x).is_prime() for x in candidates) / count * (HIGH - LOW) / 2
    assert PRIME_COUNT < found < 2 * PRIME_COUNT


# ---- Elements ------------------------------------------------------------------------------------


def test_every_number_is_replaced_by_an_element_of_its_own():
    one = field()
    x = one.numbers(np.ones((3, 4)))
    assert x.shape == (3, 4)
    assert of_field(x, one.prime)
    assert len({int(y) for y in x.ravel()}) == 12
    assert one.vector(0).shape == (0,)


def test_elements_come_from_the_whole_field():
    one = field()
    quarters = [4 * int(x) // one.prime for x in one.vector(400)]
    # 100 in each quarter, with a standard deviation of 9.
    assert all(60 < quarters.count(quarter) < 140 for quarter in range(4))


def test_a_root_is_an_element_of_its_own():
    one = field()
    x = one.vector(5)
    roots = one.root(x)
    assert of_field(roots, one.prime)
    assert (roots != x).all() and (roots * roots != x).all()


def test_a_literal_is_that_element():
    one = field()
    assert one.literal(3) == flint.nmod(3, one.prime)
    assert one.literal(-1) + 1 == 0


def test_the_same_source_gives_the_same_elements():
    assert (field(3).vector(5) == field(3).vector(5)).all()
    assert (field(3).vector(5) != field(4).vector(5)).all()


def test_angles_lie_on_the_circle():
    one = field()
    angles = one.angles(np.zeros(40))
    assert all(of_field(x, one.prime) for x in angles)
    assert (angles.cos * angles.cos + angles.sin * angles.sin == 1).all()
    assert len({int(x) for x in angles.cos}) == 40


def test_a_parameter_of_the_circle_at_which_its_denominator_vanishes_is_drawn_again():
    """Modulo 5, t = 2 and t = 3 have 1 + t² = 0."""
    angles = FiniteField(5, random.Random(0)).angles(np.zeros(100))
    points = {(int(c), int(s)) for c, s in zip(angles.cos, angles.sin, strict=True)}
    assert points == {(1, 0), (0, 1), (0, 4)}


def test_the_value_of_an_angle_is_kept_where_it_is_of_the_field_and_drawn_where_it_is_not():
    one = field()
    q = one.vector(3)
    assert (one.angles(q).value == q).all()
    assert (one.angles(q).cos != one.angles(q).cos).all()
    drawn = one.angles(np.zeros(3)).value
    assert of_field(drawn, one.prime)
    assert (drawn != 0).all()


def test_a_float_among_elements_raises_a_type_error():
    x = field().vector(2)
    for operation in (lambda: 0.5 * x, lambda: x + 0.0, lambda: x / 2.0, lambda: np.sin(x)):
        with pytest.raises(TypeError):
            operation()


# ---- Solving -------------------------------------------------------------------------------------


@pytest.mark.parametrize("columns", [(), (1,), (3,), (0,)])
@pytest.mark.parametrize("size", [1, 2, 6])
def test_a_system_is_solved_exactly(size: int, columns: tuple[int, ...]):
    one = field(size)
    A, b = one.numbers(np.zeros((size, size))), one.numbers(np.zeros((size, *columns)))
    x = solve(A, b, "A")
    assert x.shape == b.shape
    assert of_field(x, one.prime)
    assert (A @ x == b).all()


def test_literals_among_the_entries_are_elements_too():
    one = field()
    x = one.vector(3)
    A = np.array([[0, 1, x[0]], [1, 0, 0], [0, x[1], 1]], object)
    for b in (np.array([1, 0, x[2]], object), np.array([0, 1, 0], object)):
        assert (A @ solve(A, b, "A") == b).all()
    identity = np.array([[0, 1], [-1, 0]], object)
    assert (solve(identity, x[:2], "A") == [-x[1], x[0]]).all()


def test_a_system_without_unknowns_has_an_empty_solution():
    empty = np.zeros((0, 0), object)
    assert solve(empty, np.zeros(0, object), "A").shape == (0,)


def test_a_singular_matrix_is_refused_by_its_name():
    one = field()
    row = one.vector(3)
    A = np.array([row, 2 * row, one.vector(3)])
    with pytest.raises(RefusedError, match=f"3 x 3 matrix M_X is singular modulo {one.prime}") as e:
        solve(A, one.vector(3), "M_X")
    assert (e.value.what, e.value.rcond) == ("M_X", 0.0)


def test_the_arguments_of_solve_are_left_as_they_were():
    one = field()
    A, b = one.numbers(np.zeros((3, 3))), one.vector(3)
    A_before, b_before = A.copy(), b.copy()
    solve(A, b, "A")
    assert (A_before == A).all()
    assert (b_before == b).all()


# ---- A scene -------------------------------------------------------------------------------------


def test_a_scene_at_a_point_is_made_of_elements_and_keeps_what_is_absent():
    one = field()
    at = GenericPoint(next(iter(Snake.structures(1))), one)
    assert at.terms.Q is at.terms.b is at.bodies.force is None
    assert of_field(at.q, one.prime)
    assert (at.prepared.value == at.q[2:]).all()
    assert (at.scene.speeds_of(at.parameters, at.prepared, at.q, at.v) == at.u).all()


# ---- Inverses and roots --------------------------------------------------------------------------


def test_an_inverse_times_its_number_is_one_and_zero_has_none():
    one = field()
    for x in one.vector(50):
        assert x * (1 / x) == one.literal(1)
        assert (7 / x) * x == one.literal(7)
        assert x / 2 + x / 2 == x
    for numerator in (one.literal(1), one.literal(0)):
        with pytest.raises(ZeroDivisionError):
            numerator / one.literal(0)


def test_a_literal_is_reduced_by_the_prime():
    one = field()
    assert one.literal(one.prime + 3) == one.literal(3) != one.literal(2)
    assert one.literal(-1) + 1 == 0


def test_roots_are_elements_that_nothing_ties_to_what_they_are_of():
    one = field()
    x = one.vector(40)
    roots = one.root(x)
    assert of_field(roots, one.prime)
    assert len({int(y) for y in roots}) == 40
    assert not any(y * y == z for y, z in zip(roots, x, strict=True))


def test_a_root_keeps_its_value_while_it_changes_and_its_square_changes_as_what_it_is_of():
    one = field()
    recorder = RecordingArithmetic(one)
    x, rates = one.vector(5), one.vector(5)
    roots = recorder.root(x)
    moving = ReplayArithmetic(recorder.recorded).root(duals(x, rates))
    assert ([value(y) for y in moving] == roots).all()
    assert (rate(moving * moving) == rates).all()
