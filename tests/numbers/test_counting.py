"""Numbers that count: what counts, what is free, and what a few functions cost by hand."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.evaluation.scene_quantities import net_force, velocity_from_speeds
from eomcheck.formulations import kane
from eomcheck.numbers.banded_solve import HALF, WIDTH, solve_banded
from eomcheck.numbers.counting import Counted, Counting, System, Tally
from eomcheck.numbers.linear import solve
from eomcheck.scenes import SCENES, Snake, snake


def counts(counting: Counting) -> tuple[int, int, int]:
    tally = counting.tally
    return tally.additions, tally.multiplications, tally.divisions


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (lambda x, y: x + y, (1, 0, 0)),
        (lambda x, y: x - y, (1, 0, 0)),
        (lambda x, y: x * y, (0, 1, 0)),
        (lambda x, y: x / y, (0, 0, 1)),
        (lambda x, y: x * x + y * y - x * y, (2, 3, 0)),
        (lambda x, y: (x + y) * (x - y) / x, (2, 1, 1)),
    ],
)
def test_every_operation_of_an_expression_counts_once(expression, expected):
    counting = Counting()
    x, y = counting.vector(2)
    expression(x, y)
    assert counts(counting) == expected


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (lambda x: -x, (0, 0, 0)),
        (lambda x: x / 2, (0, 1, 0)),
        (lambda x: x / 4, (0, 1, 0)),
        (lambda x: x / 3, (0, 0, 1)),
        (lambda x: 1 / x, (0, 0, 1)),
        (lambda x: 2 / x, (0, 0, 1)),
        (lambda x: 2 * x, (0, 1, 0)),
        (lambda x: 0 * x, (0, 1, 0)),
        (lambda x: x * 1, (0, 1, 0)),
        (lambda x: 0 + x, (1, 0, 0)),
        (lambda x: x - 0, (1, 0, 0)),
        (lambda x: 0 - x, (1, 0, 0)),
    ],
)
def test_signs_are_free_scalings_are_multiplications_and_literals_count(expression, expected):
    counting = Counting()
    (x,) = counting.vector(1)
    expression(x)
    assert counts(counting) == expected


@pytest.mark.parametrize("terms", [1, 2, 5])
def test_a_product_of_matrices_takes_one_addition_less_than_multiplications_per_entry(terms: int):
    counting = Counting()
    A, B = counting.numbers(np.zeros((3, terms))), counting.numbers(np.zeros((terms, 4)))
    for left, right in ((A, B), (B.T, A.T), (A, B[:, 0]), (A[0], B[:, 0])):
        entries = np.size(left @ right)
        assert counts(counting) == (entries * (terms - 1), entries * terms, 0)
        counting.tally.clear()


def test_zeros_and_ones_in_a_matrix_count_as_doubles_would():
    counting = Counting()
    x = counting.vector(3)
    np.eye(3, dtype=int).astype(object) @ x
    assert counts(counting) == (6, 9, 0)


def test_a_number_and_an_array_take_one_operation_per_entry_in_either_order():
    counting = Counting()
    array, (x,) = counting.vector(4), counting.vector(1)
    for operation, expected in (
        (lambda: x + array, (4, 0, 0)),
        (lambda: array - x, (4, 0, 0)),
        (lambda: x * array, (0, 4, 0)),
        (lambda: array * x, (0, 4, 0)),
        (lambda: x / array, (0, 0, 4)),
        (lambda: array / x, (0, 0, 4)),
        (lambda: array / 2, (0, 4, 0)),
    ):
        assert operation().shape == (4,)
        assert counts(counting) == expected
        counting.tally.clear()


@pytest.mark.parametrize("other", [0.5, np.float64(0.5), Counted(Tally()), None, "x"])
def test_what_is_neither_a_literal_nor_of_the_same_tally_is_refused(other):
    (x,) = Counting().vector(1)
    for operation in (
        lambda: x + other,
        lambda: x - other,
        lambda: x * other,
        lambda: x / other,
        lambda: other / x,
    ):
        with pytest.raises(TypeError):
            operation()


def test_each_angle_is_one_pair_of_cosine_and_sine():
    counting = Counting()
    angles = counting.angles(np.zeros(5))
    assert counting.tally.trigonometric_pairs == 5
    assert all(isinstance(x, Counted) for x in np.ravel(angles))
    counting.angles(angles.value[:2])
    assert counting.tally == Tally(trigonometric_pairs=7)


def test_square_roots_are_counted_by_themselves():
    counting = Counting()
    counting.root(counting.vector(3))
    assert counting.tally == Tally(roots=3)


def test_a_tally_starts_again_from_nothing():
    counting = Counting()
    x = counting.vector(2)
    counting.root(counting.angles(x).cos / x + x * x)
    solve(np.outer(x, x), x, "A")
    counting.tally.clear()
    assert counting.tally == Tally()


def test_a_band_is_listed_with_the_entries_on_each_side_of_its_diagonal():
    counting = Counting()
    bands, b = counting.numbers(np.zeros((9, WIDTH))), counting.vector(9)
    solve_banded(bands, b, "B")
    assert counting.tally.systems == [System("B", 9, 1, HALF)]


def test_a_solve_is_listed_with_its_order_and_its_right_hand_sides_and_costs_nothing_else():
    counting = Counting()
    A, B = counting.numbers(np.zeros((3, 3))), counting.numbers(np.zeros((3, 4)))
    A[0, 0] = B[0, 0] = 0  # a literal among them
    x = solve(A, B, "A")
    assert x.shape == (3, 4)
    assert solve(A, B[:, 0], "B").shape == (3,)
    systems = [System("A", 3, 4), System("B", 3, 1)]
    assert counting.tally == Tally(systems=systems)
    x[0, 0] + x[2, 3]
    assert counting.tally == Tally(additions=1, systems=systems)


def test_a_cleared_tally_starts_from_nothing():
    counting = Counting()
    (x,) = counting.vector(1)
    solve(
        counting.numbers(np.zeros((1, 1))), (x + x * x / x) * counting.angles(np.zeros(1)).cos, ""
    )
    assert counting.tally != Tally()
    counting.tally.clear()
    assert counting.tally == Tally()


# ---- Functions of the package, counted by hand ---------------------------------------------------

LINKS = pytest.mark.parametrize("links", [1, 2, 3, 7, 20])


@LINKS
def test_forces_take_one_multiplication_and_three_additions_per_joint(links: int):
    counting = Counting()
    theta, omega = counting.vector(links), counting.vector(links)
    snake.joint_forces(counting.vector(links - 1), None, theta, omega)
    # A sum that begins with 0 is not counted: the first and the last link carry one torque only.
    assert counts(counting) == (3 * (links - 1), links - 1, 0)


@LINKS
def test_the_recursion_of_kinematics_takes_75_operations_per_joint(links: int):
    """By hand, per joint, from the lines of `kinematics`: additions, multiplications, divisions.

    cosines and sines of three angles   6  12  0
    half, lever, offset                 0   3  0
    ww_s, ww_w, ss_s, ss_w              2   4  2
    omega_u and s_u, two columns each   4   8  0
    omega, s                            2   4  0
    spin, turning                       0   3  0
    along_axle                          3   5  0
    rate                                2   2  1
    s_rest                              5   8  0
    """
    counting = Counting()
    scene = Snake.coil(links)
    parameters, angles = scene.parameters(counting), counting.angles(np.zeros(links))
    counting.tally.clear()
    scene.kinematics(parameters, angles, counting.vector(scene.n), counting.vector(2))
    joints = links - 1
    # And half the length of the first link, and the velocity of its tip.
    assert counts(counting) == (24 * joints + 4, 49 * joints + 11, 3 * joints)


@pytest.mark.parametrize(("d", "e", "p"), [(1, 1, 2), (3, 3, 4)])
@pytest.mark.parametrize("bodies", [1, 5])
def test_kanes_sums_cost_a_column_and_the_lower_triangle(bodies: int, d: int, e: int, p: int):
    """Per mass or moment of inertia: p momenta, and each with the remainder and the partials."""
    counting = Counting()
    kane.inertia_sums(
        counting.numbers(np.zeros((bodies, d, p))),
        counting.numbers(np.zeros((bodies, e, p))),
        counting.numbers(np.zeros((bodies, d))),
        counting.numbers(np.zeros((bodies, e))),
        counting.vector(bodies),
        counting.numbers(np.zeros((bodies, e, e))),
        None,
    )
    each, products = bodies * (d + e * e), p + p * (p + 1) // 2
    assert counts(counting) == (each * products, each * (p + products), 0)


# ---- What is absent costs nothing ----------------------------------------------------------------


def test_an_absent_gyroscopic_part_saves_exactly_its_projection():
    found = {}
    for present in (True, False):
        counting = Counting()
        vectors, matrices = np.zeros((5, 3)), np.zeros((5, 3, 4))
        kane.inertia_sums(
            counting.numbers(matrices),
            counting.numbers(matrices),
            counting.numbers(vectors),
            counting.numbers(vectors),
            counting.vector(5),
            counting.numbers(np.zeros((5, 3, 3))),
            counting.numbers(vectors) if present else None,
        )
        found[present] = np.array(counts(counting))
    assert (found[True] - found[False] == (5 * 3 * 4, 5 * 3 * 4, 0)).all()


def test_absent_forces_bias_and_offset_cost_nothing():
    counting = Counting()
    x, W = counting.vector(4), counting.numbers(np.zeros((4, 2)))
    for operation, expected in (
        (lambda: net_force(None, x, x), (4, 0, 0)),
        (lambda: net_force(None, x, None), (0, 0, 0)),
        (lambda: net_force(None, None, x), (0, 0, 0)),
        (lambda: kane.right_hand_side(x, x), (4, 0, 0)),
        (lambda: kane.right_hand_side(None, x), (0, 0, 0)),
        (lambda: velocity_from_speeds(x[:2], W, None), (4, 8, 0)),
        (lambda: velocity_from_speeds(x[:2], W, x), (8, 8, 0)),
    ):
        operation()
        assert counts(counting) == expected
        counting.tally.clear()


def test_each_root_is_counted_and_by_itself():
    counting = Counting()
    roots = counting.root(counting.vector(3))
    assert roots.shape == (3,)
    assert counting.tally == Tally(roots=3)
    counting.root(counting.vector(2))
    assert counting.tally == Tally(roots=5)


@pytest.mark.parametrize(
    ("key", "roots"),
    # A spring of Andrews' and one on each side of the governor; the wheels of a bicycle.
    [("andrews", 1), ("flyball-governor", 2), ("bicycle", 1), ("rolling-disk", 0), ("snake", 0)],
)
def test_scenes_take_as_many_roots_as_they_have_distances(key: str, roots: int):
    counting, scene = Counting(), SCENES[key].example()
    q = counting.vector(scene.n)
    scene.prepare(counting, scene.parameters(counting), q, counting.vector(1)[0])
    assert counting.tally.roots == roots
