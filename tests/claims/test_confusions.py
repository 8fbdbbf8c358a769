"""Every confusion is recognized on arrays of each shape, in float64 and in a finite field."""

import random
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest

from eomcheck.claims import confusions
from eomcheck.claims.confusions import (
    NO_CONTEXT,
    SCALINGS,
    TRANSFORMATIONS,
    ConfusionContext,
    agreement_within,
    diagnose,
    equal,
    locate,
    recognize,
    term_multiple,
)
from eomcheck.numbers.finite_field import FiniteField, random_prime

# ---- Numbers -------------------------------------------------------------------------------------


class Doubles:
    """Random float64 arrays, compared to 1e-12."""

    def __init__(self, seed: int):
        self.random = np.random.default_rng(seed)

    def array(self, *shape: int) -> np.ndarray:
        return self.random.normal(size=shape)

    def recognize(self, actual: Any, expected: Any, context: ConfusionContext) -> str:
        return recognize(actual, expected, 1e-12, context)


class Field:
    """Random arrays of a finite field, compared by equality."""

    def __init__(self, seed: int):
        source = random.Random(seed)
        self.field = FiniteField(random_prime(source), source)

    def array(self, *shape: int) -> np.ndarray:
        return np.reshape(self.field.vector(int(np.prod(shape))), shape)

    def recognize(self, actual: Any, expected: Any, context: ConfusionContext) -> str:
        return recognize(actual, expected, context=context, agree=equal)


NUMBERS: list[Callable[[int], Any]] = [Doubles, Field]


def rotation(numbers: Any) -> np.ndarray:
    """Return a random rotation (3, 3), rational in its four numbers."""
    w, x, y, z = numbers.array(4)
    norm = w * w + x * x + y * y + z * z
    return (
        np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ]
        )
        / norm
    )


def context_of(numbers: Any, rows: Any, *shape: int) -> ConfusionContext:
    """Return a context of random arrays."""
    return ConfusionContext(
        rows=rows,
        R=rotation(numbers),
        arms={"the centre of mass": numbers.array(3), "the world's origin": numbers.array(3)},
        omega=numbers.array(3),
        velocity=numbers.array(3),
        terms={"gravity": numbers.array(*shape), "Ṡ v": numbers.array(*shape)},
        alternatives={"of the link before": numbers.array(*shape)},
    )


SHAPES: dict[str, list[tuple[int, ...]]] = {
    "": [(5,), (5, 5), (2, 5), (4, 20), (3, 3)],
    "point": [(3,)],
    "vector": [(3,), (3, 4)],
    "motion": [(6,), (6, 4)],
    "acceleration": [(6,)],
    "force": [(6,), (6, 4)],
}
EVERY = [(rows, shape) for rows, shapes in SHAPES.items() for shape in shapes]

# ---- Every transformation ------------------------------------------------------------------------

LINEAR, ANGULAR = slice(0, 3), slice(3, 6)
LOCAL = "along the frame's own axes, expected along the world's"
ORDER = "angular part first, expected linear first"
SPATIAL = "spatial acceleration, expected classical"
COM, WORLD = "the centre of mass", "the world's origin"


class Case(NamedTuple):
    """A confusion, the arrays it is of, and the text that names it."""

    text: str
    change: Callable[[Any, ConfusionContext], Any]
    of: list[tuple[str, tuple[int, ...]]] = EVERY
    exact: bool = True


def rows_of(*kinds: str) -> list[tuple[str, tuple[int, ...]]]:
    return [(rows, shape) for rows, shape in EVERY if rows in kinds]


def changed(x: Any, part: slice, value: Any) -> Any:
    y = x.copy()
    y[part] = value
    return y


def swapped(x: Any, _: Any = None) -> Any:
    return np.concatenate((x[3:], x[:3]))


def cross(x: Any, y: Any) -> Any:
    """Return x × y by components."""
    rows = [x[i - 2] * y[i - 1] - x[i - 1] * y[i - 2] for i in range(3)]
    return np.array(rows)


def local(x: Any, c: ConfusionContext) -> Any:
    return np.concatenate((c.R.T @ x[:3], c.R.T @ x[3:])) if len(x) == 6 else c.R.T @ x


def at_arm(x: Any, c: ConfusionContext, name: str) -> Any:
    return changed(x, LINEAR, x[:3] + cross(x[3:], c.arms[name]))


def spatial(x: Any, c: ConfusionContext) -> Any:
    return changed(x, LINEAR, x[:3] - cross(c.omega, c.velocity))


SIX = rows_of("motion", "acceleration", "force")
TWO = [(rows, shape) for rows, shape in EVERY if len(shape) == 2]
SQUARE = [("", (5, 5)), ("", (3, 3))]
CASES = [
    Case("wrong sign", lambda x, c: -x),
    Case("missing", lambda x, c: 0 * x),
    Case("twice the expected value", lambda x, c: 2 * x),
    Case("half the expected value", lambda x, c: x / 2),
    Case("4 times the expected value", lambda x, c: 4 * x),
    Case("a quarter of the expected value", lambda x, c: x / 4),
    Case("in degrees", lambda x, c: np.degrees(x), exact=False),
    Case("per degree", lambda x, c: np.radians(x), exact=False),
    Case("transposed", lambda x, c: x.T, TWO),
    Case("the upper triangle alone", lambda x, c: np.triu(x), SQUARE),
    Case("the lower triangle alone", lambda x, c: np.tril(x), SQUARE),
    Case("without gravity", lambda x, c: x - c.terms["gravity"]),
    Case("without Ṡ v", lambda x, c: x - c.terms["Ṡ v"]),
    Case("gravity twice", lambda x, c: x + c.terms["gravity"]),
    Case("Ṡ v with the wrong sign", lambda x, c: x - 2 * c.terms["Ṡ v"]),
    Case("gravity alone", lambda x, c: c.terms["gravity"].copy()),
    Case("of the link before", lambda x, c: c.alternatives["of the link before"].copy()),
    Case("joints in another order", lambda x, c: x[[1, 2, 4, 3, 0]], [("", (5,))]),
    Case(
        "joints in another order",
        lambda x, c: x[np.ix_(order := [3, 0, 2, 4, 1], order)],
        [("", (5, 5))],
    ),
    Case("joints in another order", lambda x, c: x[:, ::-1], [*TWO[1:3], *TWO[4:]]),
    Case(ORDER, swapped, SIX),
    Case(LOCAL, local, [*SIX, *rows_of("vector", "point")]),
    Case(f"linear part {LOCAL}", lambda x, c: changed(x, LINEAR, c.R.T @ x[:3]), SIX),
    Case(f"angular part {LOCAL}", lambda x, c: changed(x, ANGULAR, c.R.T @ x[3:]), SIX),
    Case(
        "turned from the frame's axes to the world's twice",
        lambda x, c: c.R @ x,
        rows_of("vector", "point"),
    ),
    Case(
        f"angular part about {COM}, expected about the frame",
        lambda x, c: changed(x, ANGULAR, x[3:] + cross(x[:3], c.arms[COM])),
        rows_of("force"),
    ),
    Case(
        f"linear part at {WORLD}, expected at the frame",
        lambda x, c: at_arm(x, c, WORLD),
        rows_of("motion"),
    ),
    Case(f"at {COM}, expected at the frame", lambda x, c: x + c.arms[COM], rows_of("point")),
    Case(SPATIAL, spatial, rows_of("acceleration")),
    Case(
        "ω × v added once too often",
        lambda x, c: changed(x, LINEAR, x[:3] + cross(c.omega, c.velocity)),
        rows_of("acceleration"),
    ),
    Case(
        f"linear part at {COM}, expected at the frame",
        lambda x, c: changed(
            at_arm(x, c, COM),
            LINEAR,
            at_arm(x, c, COM)[:3] + cross(c.omega, cross(c.omega, c.arms[COM])),
        ),
        rows_of("acceleration"),
    ),
    # Several at once, as libraries have them.
    Case(f"{SPATIAL}; {LOCAL}", lambda x, c: local(spatial(x, c), c), rows_of("acceleration")),
    Case(
        f"{SPATIAL}; linear part at {WORLD}, expected at the frame; {ORDER}",
        lambda x, c: swapped(at_arm(spatial(x, c), c, WORLD)),
        rows_of("acceleration"),
    ),
    Case(f"{LOCAL}; {ORDER}", lambda x, c: swapped(local(x, c)), SIX),
]


@pytest.mark.parametrize("make", NUMBERS)
@pytest.mark.parametrize(
    ("case", "rows", "shape"),
    [
        pytest.param(case, rows, shape, id=f"{k}: {case.text} of {rows}{shape}")
        for k, case in enumerate(CASES)
        for rows, shape in case.of
    ],
)
def test_each_confusion_is_named(make: Any, case: Case, rows: str, shape: tuple[int, ...]):
    if make is Field and not case.exact:
        return
    numbers = make(len(case.text) + sum(shape))
    expected, context = numbers.array(*shape), context_of(numbers, rows, *shape)
    actual = case.change(expected, context)
    assert numbers.recognize(actual, expected, context) == case.text
    # With what the claim does not know, the same is not recognized, or as what is known.
    known = ConfusionContext(rows=rows)
    scaled = case.text in SCALINGS
    assert not scaled or numbers.recognize(actual, expected, known) == case.text


def test_single_precision_is_recognized_where_asked_for():
    expected = np.random.default_rng(0).normal(size=(4, 4))
    actual = expected.astype(np.float32).astype(np.float64)
    context = ConfusionContext(single_precision=True)
    text = "as large as the rounding of single precision"
    assert recognize(actual, expected, 1e-14, context) == text
    assert recognize(actual, expected, 1e-14) == ""
    assert recognize(expected * (1 + 1e-5), expected, 1e-14, context) == ""
    for size in (1.0, 1e9, 1e-9):
        x, y, allowed = size * actual, size * expected, size * 1e-14
        assert recognize(x, y, allowed, context) == text
        assert recognize(y * (1 + 1e-11), y, allowed, context) != text
    assert recognize(expected.T, expected, 1e-14, context) == "transposed"


def test_every_transformation_has_a_case():
    keys = {one.key for one in TRANSFORMATIONS}
    assert len(keys) == len(TRANSFORMATIONS) == 9


def test_a_block_of_columns_is_transposed():
    blocks = np.random.default_rng(3).normal(size=(2, 4, 4))
    expected = np.concatenate(blocks, axis=1)
    second = np.concatenate((blocks[0], blocks[1].T), axis=1)
    assert recognize(second, expected, 1e-14) == "columns 5 to 8 transposed"
    each = np.concatenate([x.T for x in blocks], axis=1)
    assert recognize(each, expected, 1e-14) == "each block of 4 columns transposed"


def test_a_rotation_matrix_is_transposed():
    R = rotation(Doubles(3))
    assert recognize(R.T, R, 1e-12) == "transposed"


def test_of_a_body_that_turns_about_the_origin_an_acceleration_is_spatial():
    """It is that of the point at the origin as well, which is confused less often."""
    omega, p, still = np.array([0.3, -1.2, 0.7]), np.array([1.0, 0.4, -0.6]), np.zeros(3)
    context = ConfusionContext(
        rows="acceleration", arms={WORLD: -p}, omega=omega, velocity=np.cross(omega, p)
    )
    bias = np.concatenate((np.cross(omega, np.cross(omega, p)), still))
    assert recognize(np.zeros(6) + 0.1 * bias, bias, 1e-14, context) == ""
    turned = bias + np.concatenate((np.array([0.2, 0.5, -0.1]), still))
    actual = turned - np.concatenate((np.cross(omega, context.velocity), still))
    assert recognize(actual, turned, 1e-14, context) == SPATIAL


# ---- Nothing is recognized -----------------------------------------------------------------------


@pytest.mark.parametrize("make", NUMBERS)
def test_random_errors_are_not_recognized(make: Any, sized):
    numbers = make(7)
    for k in range(sized(1000, 200)):
        rows, shape = EVERY[k % len(EVERY)]
        expected, context = numbers.array(*shape), context_of(numbers, rows, *shape)
        actual = numbers.array(*shape)
        if k % 3 == 1:  # one entry, the first row or the last
            actual = changed(expected, (0,) * len(shape), actual[(0,) * len(shape)])
        elif k % 3 == 2:
            actual = changed(expected, -1, actual[-1])
        assert numbers.recognize(actual, expected, context) == ""
        how = {"context": context} | ({"agree": equal} if make is Field else {"allowed": 1e-12})
        first = (0,) * len(shape) if make is Field else None
        assert locate(actual, expected, (), worst=first, **how).what == ""


@pytest.mark.parametrize("make", NUMBERS)
def test_a_candidate_like_the_expected_array_is_no_diagnosis(make: Any):
    """Zero arms, terms and turns, symmetric matrices, arrays that vanish."""
    numbers = make(5)
    one, none = numbers.array(3) * 0 + 1, numbers.array(3) * 0
    for rows, shape in EVERY:
        x = numbers.array(*shape)
        context = ConfusionContext(
            rows=rows,
            R=np.diag(one),
            arms={"here": none},
            omega=none,
            velocity=numbers.array(3),
            terms={"gravity": 0 * x},
            alternatives={"the same": x},
        )
        assert numbers.recognize(x + numbers.array(*shape), x, context) == ""
        assert numbers.recognize(x, 0 * x, context._replace(terms={}, alternatives={})) == ""
    symmetric = numbers.array(4, 4)
    symmetric = symmetric + symmetric.T
    assert numbers.recognize(symmetric + 1, symmetric, NO_CONTEXT) == ""
    assert numbers.recognize(symmetric, symmetric, NO_CONTEXT) == ""


def test_what_rounding_hides_is_no_diagnosis():
    expected = np.array([1.0, -2.0, 0.5])
    assert recognize(-expected, expected, 1e-3) == "wrong sign"
    assert recognize(-expected, expected, 5.0) == ""
    assert recognize(0.5 * expected, expected, 0.9) == "half the expected value"
    assert recognize(0.5 * expected, expected, 1.1) == "missing"  # simpler, and as near
    assert recognize(expected + 1e-3, expected, 1e9) == ""


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_no_diagnosis(value: float):
    numbers = Doubles(9)
    for rows, shape in EVERY:
        context = context_of(numbers, rows, *shape)._replace(single_precision=True)
        expected = numbers.array(*shape)
        names = tuple(tuple(map(str, range(n))) for n in shape)
        for where in ((0,) * len(shape), slice(None)):
            actual = changed(expected, where, value)
            for sides in ((actual, expected), (expected, actual), (actual, actual)):
                assert recognize(*sides, 1e-12, context) == ""
                difference = locate(*sides, names, 1e-12, context)
                assert difference.what == ""
                assert "expected" in difference.text
    assert recognize(np.zeros(0), np.zeros(0)) == ""
    assert recognize(np.ones(2), np.ones(3)) == ""


# ---- Of two that agree, the simpler one ----------------------------------------------------------


def test_the_simpler_of_two_confusions_is_named():
    skew = np.array([[0.0, 2.0], [-2.0, 0.0]])
    assert recognize(skew.T, skew) == "wrong sign"
    half_turn = ConfusionContext("vector", R=np.diag([-1.0, -1.0, 1.0]))
    x = np.array([1.0, 2.0, 0.0])
    assert recognize(-x, x, 0.0, half_turn) == "wrong sign"
    assert recognize(half_turn.R @ [1, 2, 3.0], np.array([1, 2, 3.0]), 0.0, half_turn) == LOCAL
    two = np.array([[1.0, 5.0], [7.0, 3.0]])
    assert recognize(two.T, two) == "transposed"
    assert recognize(two[::-1, ::-1], two) == "joints in another order"
    gravity = {"gravity": np.array([0.0, 4.0])}
    assert recognize(0 * x[:2], gravity["gravity"], 0.0, ConfusionContext(terms=gravity)) == (
        "missing"
    )


def test_fewer_changes_of_convention_are_preferred():
    """A motion along the axis of the frame is the same along both axes."""
    c, s = np.cos(0.7), np.sin(0.7)
    context = ConfusionContext("motion", R=np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))
    x = np.array([0.0, 0.0, 2.0, 0.0, 0.0, 3.0])
    assert recognize(swapped(x), x, 1e-12, context) == ORDER


def test_one_number_in_the_place_of_another_is_no_order():
    assert recognize(np.array([3.0, 0.0]), np.array([0.0, 3.0])) == ""
    assert recognize(np.array([3.0, 1.0]), np.array([1.0, 3.0])) == "joints in another order"


def test_an_order_of_joints_is_found_among_equal_ones():
    """Equal diagonals leave several orders to try."""
    M = np.eye(5) * 4.0
    M[0, 1] = M[1, 0] = 1.0
    M[2, 3] = M[3, 2] = 2.0
    order = [4, 3, 2, 0, 1]
    assert recognize(M[np.ix_(order, order)], M) == "joints in another order"
    blocks = np.kron(np.eye(20), np.ones((2, 2)))
    other = blocks.copy()
    other[-1, -2] = 0.5  # no order: the search ends
    assert recognize(other, blocks) == ""


def test_the_axes_of_joints_are_those_of_the_claim():
    x = np.random.default_rng(1).normal(size=(3, 8))
    rows = ConfusionContext(joint_axes=(0,))
    assert recognize(x[::-1], x, 0.0, rows) == "joints in another order"
    assert recognize(x[::-1], x) == ""
    assert recognize(x[:, ::-1], x) == "joints in another order"
    assert recognize(x[0, ::-1], x[0], 0.0, ConfusionContext(joint_axes=())) == ""


# ---- Places --------------------------------------------------------------------------------------

SIX_ROWS = ("v_x", "v_y", "v_z", "ω_x", "ω_y", "ω_z")
JOINTS = ("θ_1", "θ_2", "θ_3")
J = np.random.default_rng(2).normal(size=(6, 3))


@pytest.mark.parametrize("make", NUMBERS)
@pytest.mark.parametrize(
    ("part", "where", "factor", "what"),
    [
        ((5,), "row ω_z", -1, "wrong sign"),
        (ANGULAR, "rows ω_x, ω_y, ω_z", 0, "missing"),
        (ANGULAR, "rows ω_x, ω_y, ω_z", 2, "twice the expected value"),
        ((slice(None), 1), "column θ_2", -1, "wrong sign"),
        ((slice(None), slice(1, 3)), "columns θ_2, θ_3", 4, "4 times the expected value"),
        ((4, 2), "entry (ω_y, θ_3)", -1, "wrong sign"),
    ],
)
def test_rows_and_columns_with_one_factor_are_named(make, part, where, factor, what):
    numbers = make(1)
    expected = numbers.array(6, 3)
    actual = changed(expected, part, factor * expected[part])
    how = {"agree": equal} if make is Field else {}
    worst = tuple(int(i) for i in np.argwhere(actual != expected)[0])
    difference = locate(actual, expected, (SIX_ROWS, JOINTS), worst=worst, **how)
    assert difference[:2] == (where, what)


def test_the_only_entry_of_a_row_is_named_as_an_entry():
    expected = np.zeros((6, 3))
    expected[1] = 1.0, 2.0, 3.0
    expected[5, 2] = 0.5
    actual = changed(expected, (5,), -expected[5])
    assert locate(actual, expected, (SIX_ROWS, JOINTS)).where == "entry (ω_z, θ_3)"
    assert locate(changed(actual, (5, 0), 1e-9), expected, (SIX_ROWS, JOINTS)).where == (
        "entry (ω_z, θ_3)"
    )


def test_angles_in_degrees_are_named_by_their_rows():
    actual = changed(J, ANGULAR, np.degrees(J[3:]))
    difference = locate(actual, J, (SIX_ROWS, JOINTS), 1e-12)
    assert difference[:2] == ("rows ω_x, ω_y, ω_z", "in degrees")


def test_of_a_vector_with_known_rows_all_wrong_ones_are_named():
    x = J[:, 0]
    actual = changed(x, ANGULAR, -x[3:])
    context = ConfusionContext("motion")
    assert locate(actual, x, (SIX_ROWS,), 1e-12, context)[:2] == (
        "rows ω_x, ω_y, ω_z",
        "wrong sign",
    )
    assert locate(actual, x, (SIX_ROWS,), 1e-12).where.startswith("row ω_")
    many = np.arange(1.0, 25.0).reshape(12, 2)
    wrong = changed(many, slice(0, 10), -many[:10])
    where = locate(wrong, many, (tuple("abcdefghijkl"), ("x", "y"))).where
    assert where == "rows a, b, c, d, e, f, g, h and 2 more"


def test_what_has_no_one_factor_is_both_numbers_of_the_worst_entry():
    actual = changed(J, (5,), J[5] * [-1.0, 2.0, 3.0])
    difference = locate(actual, J, (SIX_ROWS, JOINTS), 1e-12, worst=(5, 2))
    assert difference.where == "entry (ω_z, θ_3)"
    assert difference.text == f"{3 * J[5, 2]:.6g}, expected {J[5, 2]:.6g}"
    assert diagnose(actual, J, 1e-12, (5, 2)) == difference.text
    assert locate(actual, J, (SIX_ROWS, JOINTS), 1e-12, worst=(5, 0)).what == "wrong sign"


def test_of_a_number_the_entry_is_the_value():
    assert locate(2.0, 1.0, ())[:2] == ("value", "twice the expected value")
    assert locate(2.0, 0.0, ())[:2] == ("value", "should vanish")


def test_the_whole_array_comes_before_its_entries():
    context = ConfusionContext("motion")
    difference = locate(swapped(J), J, (SIX_ROWS, JOINTS), 1e-12, context)
    assert difference.what == ORDER
    assert difference.where.startswith("entry (")


# ---- Terms ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("multiple", "expected"), [(-1, -1), (1, 1), (-2, -2), (2, None)])
def test_the_multiple_of_a_term_by_which_a_sum_is_off(multiple: int, expected: int | None):
    term = np.array([1.0, -3.0, 0.0])
    assert term_multiple(multiple * term, term, 1e-12) == expected
    assert term_multiple(multiple * term + 1e-3, term, 1e-12) is None
    assert term_multiple(multiple * term, 0.0 * term, 1e-12) is None


def test_the_error_of_a_term_counts_as_often_as_the_term():
    term = np.array([1.0, -3.0])
    assert term_multiple(-2.0 * term + 1.9e-3, term, 0.0, 1e-3) == -2
    assert term_multiple(-2.0 * term + 2.1e-3, term, 0.0, 1e-3) is None
    assert term_multiple(-1.0 * term + 1.1e-3, term, 0.0, 1e-3) is None


def test_entries_agree_within_the_larger_of_what_is_allowed_and_their_digits():
    agree = agreement_within(1e-3)
    assert agree(np.array([1.0, 1.0, np.inf]), np.array([1.0009, 1.0011, np.inf])).tolist() == [
        True,
        False,
        False,
    ]
    exactly = agreement_within(0.0)
    digits = confusions.SLACK * np.finfo(float).eps
    assert exactly(1.0, 1.0 + 0.9 * digits)
    assert not exactly(1.0, 1.0 + 1.1 * digits)
