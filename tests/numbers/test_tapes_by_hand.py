"""What stands on a tape, operation by operation, and what expressions of CasADi and heyoka are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eomcheck.numbers import generic as marks
from eomcheck.numbers import tape as tapes
from eomcheck.numbers.banded_solve import solve_banded
from eomcheck.numbers.generic import NotRationalError, generic, product_of
from eomcheck.numbers.linear import matrix_product, solve
from eomcheck.numbers.symbolic import CasadiArithmetic, HeyokaArithmetic
from eomcheck.numbers.tape import OperationGroup, Tape, live_entries


def listing(tape: Tape) -> list[str]:
    """Return the entries of a tape, each a line."""
    return [" ".join(str(x) for x in one if x is not None) for one in tape.operations]


def test_a_tape_lists_what_was_done_in_its_order():
    tape = Tape()
    x, y = tape.inputs("q", (2,))
    result = (x * y - 3.0) / y + x.sqrt() - (-x) ** 3
    assert listing(tape) == [
        "input q 0", "input q 1", "* 0 1", "constant 3.0", "- 2 3", "/ 4 1", "sqrt 0", "+ 5 6",
        "neg 0", "* 0 0", "neg 9", "* 9 0", "neg 11", "+ 7 11",
    ]  # fmt: skip
    assert result.index == 13


MORE = {
    "(-x) + y": (lambda x, y: (-x) + y, lambda x, y: y - x),
    "x (-y)": (lambda x, y: x * (-y), lambda x, y: -(x * y)),
    "(-x) (-y)": (lambda x, y: (-x) * (-y), lambda x, y: x * y),
    "(-x) / y": (lambda x, y: (-x) / y, lambda x, y: -(x / y)),
    "(-x) / (-y)": (lambda x, y: (-x) / (-y), lambda x, y: x / y),
    "x / -0.5": (lambda x, y: x / -0.5, lambda x, y: -2 * x),
    "x (-1)": (lambda x, y: x * -1.0, lambda x, y: -x),
    "0 - x": (lambda x, y: 0.0 - x, lambda x, y: -x),
    "5 - 3": (lambda x, y: (0 * x + 5) - 3, lambda x, y: 0 * x + 2),
    "3 - 5": (lambda x, y: 3 - (0 * x + 5), lambda x, y: 0 * x - 2),
    "8 / 2": (lambda x, y: 8 / (0 * x + 2), lambda x, y: 0 * x + 4),
    "-(3)": (lambda x, y: -(0 * x + 3), lambda x, y: 0 * x - 3),
    "+x": (lambda x, y: +x, lambda x, y: x),
    "-0.0": (lambda x, y: -(0 * x), lambda x, y: 0 * x),
}


@pytest.mark.parametrize("name", MORE)
def test_signs_move_outwards_and_constants_are_folded(name):
    tape = Tape()
    x, y = tape.inputs("q", (2,))
    one, other = (function(x, y) for function in MORE[name])
    assert one.index == other.index


@pytest.mark.parametrize(
    ("divisor", "op"),
    [(2.0**999, tapes.MUL), (2.0**1000, tapes.DIV), (-(2.0**-999), tapes.MUL),
     (2.0**-1000, tapes.DIV), (3.0, tapes.DIV), (0.75, tapes.DIV)],
)  # fmt: skip
def test_only_powers_of_two_whose_inverse_is_safe_become_factors(divisor, op):
    tape = Tape()
    (x,) = tape.inputs("q", (1,))
    operation = tape.operations[(x / divisor).index]
    assert operation.op is op and operation.x == x.index
    assert tape.value(operation.y) == (1 / divisor if op is tapes.MUL else divisor)


def test_differences_and_quotients_are_not_turned_around():
    tape = Tape()
    x, y = tape.inputs("q", (2,))
    assert (x - y).index != (y - x).index and (x / y).index != (y / x).index
    with pytest.raises(TypeError):
        x + "1"
    with pytest.raises(TypeError):
        [] * x
    assert [one.index for one in x * np.array([1.0, 0.0])] == [x.index, (0 * x).index]


def places(array: Any) -> list[int]:
    return [x.index for x in np.ravel(array)]


def test_groups_name_what_they_read_row_by_row():
    tape = Tape()
    A, b = tape.inputs("A", (2, 2)), tape.inputs("b", (2, 3))
    solve(A, b, "M")
    solve(A, b[:, 0], "M")
    solve(A, b[:, 0], "N")
    bands = tape.inputs("bands", (2, 7))
    x = solve_banded(bands, b[:, 1], "band")
    angles = tape.angles(np.array([tape.constant(0.5), b[0, 0]]))
    read = (*places(A),)
    first, second = (*places(b[:, 0]),), (*places(b[:, 1]),)
    assert tape.groups == [
        OperationGroup("factors", "M", (2,), read),
        OperationGroup("solve", "M", (2, 3), (*places(b),), 0),
        OperationGroup("solve", "M", (2, 1), first, 0),
        OperationGroup("factors", "N", (2,), read),
        OperationGroup("solve", "N", (2, 1), first, 3),
        OperationGroup("band", "band", (2,), (*places(bands), *second)),
        OperationGroup("angles", "", (2,), (tape.constant(0.5).index, b[0, 0].index)),
    ]
    assert [tape.operations[y.index][1:] for y in x] == [(5, 0), (5, 1)]
    parts = [tape.operations[y.index][1:] for y in (*angles.cos, *angles.sin)]
    assert parts == [(6, 0), (6, 1), (6, 2), (6, 3)]
    assert places(angles.value) == [tape.constant(0.5).index, b[0, 0].index]
    known = tape.angles(np.array([0.5, 0.25]))
    values = [tape.value(y.index) for y in (*known.value, *known.cos, *known.sin)]
    assert values == [0.5, 0.25, np.cos(0.5), np.cos(0.25), np.sin(0.5), np.sin(0.25)]
    assert len(tape.groups) == 7


def test_a_product_of_more_than_4096_multiplications_is_one_group():
    tape = Tape()
    A, B = tape.inputs("A", (16, 16)), tape.inputs("B", (16, 17))
    assert matrix_product(A, B[:, :16]).shape == (16, 16)
    assert not tape.groups
    large = matrix_product(A, B)
    assert tape.groups == [OperationGroup("product", "", (16, 16, 17), (*places(A), *places(B)))]
    assert large.shape == (16, 17)
    assert tape.operations[large[1, 0].index] == (tapes.PART, 0, 17)


def test_what_results_are_made_of_is_alive_and_nothing_else():
    tape = Tape()
    A, b = tape.inputs("A", (2, 2)), tape.inputs("b", (2,))
    unused = A[0, 0] * b[0] + 5.0
    x = solve(A, b, "A")
    tape.angles(b)
    result = -(x[1] * A[1, 0])
    entries, groups = live_entries(tape, [result.index])
    assert groups == {0, 1}
    made = [x[1].index, (x[1] * A[1, 0]).index, result.index]
    assert entries == sorted([*places(A), *places(b), *made])
    assert live_entries(tape, [unused.index])[1] == set()
    twice = 2 * b[1]
    assert live_entries(tape, [twice.index])[0] == [
        b[1].index,
        tape.constant(2.0).index,
        twice.index,
    ]


def test_a_power_is_a_product_of_whole_many():
    assert product_of(3, 1) == 3 and product_of(3, 4) == 81
    for power in (0, -1, True, 2.0, 0.5):
        with pytest.raises(NotRationalError, match=rf"the power {power!r}, expected a whole"):
            product_of(3, power)  # type: ignore[arg-type]


def test_a_marked_function_is_returned_as_it_is_and_listed():
    def function():
        pass

    known = len(marks.GENERIC)
    try:
        assert generic(function) is function and marks.GENERIC[known:] == [function]
    finally:
        del marks.GENERIC[known:]


# ---- Expressions ---------------------------------------------------------------------------------


def test_expressions_of_casadi_have_these_values():
    casadi = pytest.importorskip("casadi")
    symbols = CasadiArithmetic()
    column, x = symbols.variables("x", 3)
    assert column.shape == (3, 1) and x.shape == (3,)
    angles = symbols.angles(x[:2])
    assert all(y is z for y, z in zip(angles.value, x, strict=False))
    known = symbols.angles(np.array([0.5]))
    numbers = symbols.numbers(np.array([[0.1, 2.0]]))
    assert numbers.shape == (1, 2)
    zero = numbers[0, 0] * 0
    # A first pivot that vanishes: rows are exchanged.
    solved = solve(np.array([[zero, x[0]], [x[1], x[2]]]), np.array([x[2], x[1]]), "A")
    results = [*x, *angles.cos, *angles.sin, *symbols.root(x), known.cos[0], known.sin[0],
               *numbers[0], *solved]  # fmt: skip
    found = np.array(casadi.Function("f", [column], [casadi.vertcat(*results)])([0.3, 0.7, 4.0]))
    cos, sin, root = np.cos([0.3, 0.7]), np.sin([0.3, 0.7]), np.sqrt([0.3, 0.7, 4.0])
    y = 4.0 / 0.3
    expected = [0.3, 0.7, 4.0, *cos, *sin, *root, np.cos(0.5), np.sin(0.5), 0.1, 2.0]
    np.testing.assert_allclose(found.ravel(), [*expected, (0.7 - 4.0 * y) / 0.7, y], rtol=1e-14)


def test_expressions_of_heyoka_have_these_values():
    heyoka = pytest.importorskip("heyoka")
    numbers = HeyokaArithmetic()
    x = numbers.variables("x", 2)
    assert [str(one) for one in x] == ["x_0", "x_1"]
    angles = numbers.angles(x)
    assert all(one is other for one, other in zip(angles.value, x, strict=True))
    assert [str(one) for one in angles.cos] == ["cos(x_0)", "cos(x_1)"]
    assert [str(one) for one in angles.sin] == ["sin(x_0)", "sin(x_1)"]
    assert [str(one) for one in numbers.root(x)] == [str(heyoka.sqrt(one)) for one in x]
    known = numbers.angles(np.array([0.5]))
    roots = numbers.root(np.array([9, 4], object))
    constants = [known.value[0], known.cos[0], known.sin[0], *roots, numbers.expression(7)]
    found = [float(str(one)) for one in constants]
    assert found == [0.5, np.cos(0.5), np.sin(0.5), 3.0, 2.0, 7.0]
    # A first pivot that vanishes: rows are exchanged.
    A = numbers.numbers(np.array([[0.0, 2.0], [4.0, 3.0]]))
    solved = solve(A, numbers.numbers(np.array([6.0, 5.0])), "A")
    assert [float(str(one)) for one in solved] == [-1.0, 3.0]
    assert numbers.options["fp_type"] is numbers.quad
    assert numbers.constants(np.zeros((2, 3))).shape == (2, 3)
    third = numbers.constant("0." + "3" * 40)
    assert abs(float(third - numbers.constant(1) / numbers.constant(3))) < 1e-34
