"""`solve` on doubles, on fractions and in machine code: right, or an honest refusal."""

from __future__ import annotations

import inspect
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.machine_code import MachineCode, in_machine_code

from eomcheck.errors import RefusedError
from eomcheck.evaluation.certified import accuracy
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.kernels.kernel import HEADER
from eomcheck.kernels.program import INLINE
from eomcheck.lab.studies.stability.families import FAMILIES
from eomcheck.numbers import linear
from eomcheck.numbers.linear import column_scale, eliminate, recording_solves, singular_below, solve
from eomcheck.numbers.noise import STEP

SIZES = [1, 2, 3, INLINE, INLINE + 1, 20]
sizes = pytest.mark.parametrize("size", SIZES)
columns = pytest.mark.parametrize("columns", [None, 1, 3])


def system(size: int, columns: int | None = None, seed: int = 0):
    random = np.random.default_rng((size, columns or 0, seed))
    shape = (size,) if columns is None else (size, columns)
    return random.uniform(-1, 1, (size, size)), random.uniform(-1, 1, shape)


def assert_solves(A, x, b):
    """Assert a small backward error, row by row: what elimination with pivoting promises."""
    size = np.abs(A).sum(axis=1).max() * np.abs(x).max() + np.abs(b).max()
    assert x.shape == b.shape
    assert np.abs(A @ x - b).max() <= allowed_error(len(A) * size)


# ---- Doubles -------------------------------------------------------------------------------------


@sizes
@columns
def test_solve_on_doubles_solves_and_agrees_with_numpy(size, columns):
    A, b = system(size, columns)
    x = solve(A, b, "A")
    assert_solves(A, x, b)
    difference = np.abs(x - np.linalg.solve(A, b)).max()
    assert difference <= allowed_error(np.linalg.cond(A) * np.abs(x).max())


@pytest.mark.parametrize("dtype", [np.float64, object])
@pytest.mark.parametrize("shape", [(0,), (0, 3), (0, 0)])
def test_a_system_without_equations_has_the_empty_solution(dtype, shape):
    x = solve(np.zeros((0, 0), dtype), np.zeros(shape, dtype), "A")
    assert x.shape == shape
    assert x.dtype == dtype


@sizes
def test_a_system_without_right_hand_sides_has_no_solutions(size):
    A, _ = system(size)
    assert solve(A, np.zeros((size, 0)), "A").shape == (size, 0)


@sizes
def test_solve_changes_neither_the_matrix_nor_the_right_hand_side(size):
    A, b = system(size)
    before = A.copy(), b.copy()
    solve(A, b, "A")
    solve(np.asfortranarray(A), b, "A")
    assert np.array_equal(A, before[0])
    assert np.array_equal(b, before[1])


@sizes
@columns
def test_the_layout_in_memory_does_not_matter(size, columns):
    A, b = system(size, columns)
    x = solve(A, b, "A")
    for view in (np.asfortranarray(A), np.repeat(A, 2, axis=1)[:, ::2], A.T.copy().T):
        assert np.array_equal(solve(view, np.asfortranarray(b), "A"), x)


@sizes
def test_the_determinant_is_recorded_with_its_sign(size):
    for seed in range(4):
        A, b = system(size, seed=seed)
        with recording_solves() as watch:
            solve(A, b, "A")
        sign, log = np.linalg.slogdet(A)
        assert watch.solves[0].sign == sign
        assert watch.solves[0].log_determinant == pytest.approx(log / np.log(2))
        assert watch.solves[0].refinements == 0


SINGULAR = {
    "zero": np.zeros((3, 3)),
    "zero column": np.array([[1.0, 0.0], [2.0, 0.0]]),
    "zero row": np.array([[1.0, 3.0], [0.0, 0.0]]),
    "equal rows": np.array([[1.0, 2.0, 0.5], [1.0, 2.0, 0.5], [3.0, 1.0, 1.0]]),
    "dependent to rounding": np.array([[0.1, 0.3], [0.7, 2.1 * (1 + 2e-16)]]),
    "of order 1": np.zeros((1, 1)),
    "not finite": np.array([[1.0, np.nan], [0.0, 1.0]]),
    "infinite": np.array([[1.0, np.inf], [0.0, 1.0]]),
}
singular_matrices = pytest.mark.parametrize("A", SINGULAR.values(), ids=SINGULAR.keys())


@singular_matrices
@columns
def test_a_singular_matrix_is_refused_with_name_rcond_and_threshold(A, columns):
    b = np.ones(len(A) if columns is None else (len(A), columns))
    with pytest.raises(RefusedError) as caught:
        solve(A, b, "M_Name")
    refusal = caught.value
    assert refusal.what == "M_Name"
    assert refusal.threshold == singular_below(len(A))
    assert not refusal.rcond > refusal.threshold
    assert refusal.matrix.shape == A.shape
    for part in ("M_Name", f"{refusal.threshold:.2g}", f"{len(A)} x {len(A)}"):
        assert part in str(refusal)


def test_a_refusal_is_recorded_like_any_other_solve():
    with recording_solves() as watch, pytest.raises(RefusedError):
        solve(np.zeros((2, 2)), np.ones(2), "A")
    assert watch.rcond == {"A": 0.0}


def test_the_threshold_grows_with_the_order_of_the_matrix():
    assert [singular_below(size) for size in (1, 2, 10)] == [
        size * np.finfo(float).eps for size in (1, 2, 10)
    ]


@pytest.mark.parametrize("exponent", range(-15, -2))
def test_a_matrix_is_refused_exactly_where_its_rcond_is_not_above_the_threshold(exponent):
    A = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0 ** (3 * exponent - 2)]])
    true = 1 / np.linalg.cond(A, 1)
    if 3 * exponent - 2 < -52:
        true = 0.0
    if true > singular_below(2):
        assert_solves(A, solve(A, np.array([1.0, 2.0]), "A"), np.array([1.0, 2.0]))
    else:
        with pytest.raises(RefusedError):
            solve(A, np.array([1.0, 2.0]), "A")


# ---- The condition number ------------------------------------------------------------------------


def rcond_of(A) -> float:
    with recording_solves() as watch:
        solve(A, np.ones(len(A)), "A")
    return watch.rcond["A"]


def test_every_solve_inside_a_watch_is_recorded_by_name_and_order():
    with recording_solves() as watch:
        for size in (2, 3):
            solve(*system(size), f"A_{size}")
    assert [(s.name, s.size) for s in watch.solves] == [("A_2", 2), ("A_3", 3)]
    assert set(watch.rcond) == {"A_2", "A_3"}


def test_solves_outside_a_watch_or_in_an_inner_one_are_not_recorded():
    with recording_solves() as outer:
        with recording_solves() as inner:
            solve(*system(2), "inner")
        solve(*system(2), "outer")
    solve(*system(2), "outside")
    assert set(inner.rcond) == {"inner"}
    assert set(outer.rcond) == {"outer"}


def test_diagonal_matrices_are_perfectly_conditioned_whatever_their_units():
    assert rcond_of(np.diag([1.0, 2.0, 0.25])) == 1.0
    assert rcond_of(np.diag([2.0**-300, 1.0, 2.0**300])) == 1.0


@sizes
def test_the_rcond_is_the_best_of_all_units_up_to_the_growth_of_elimination(size):
    A, _ = system(size)
    inverse = np.abs(np.linalg.inv(A))
    radius = np.abs(np.linalg.eigvals(inverse @ np.abs(A))).max()
    # |L||U| is at least |A| and, with partial pivoting, seldom much more.
    assert 1 / radius / (3 * size) <= rcond_of(A) <= (1 + allowed_error(radius)) / radius


@given(
    st.integers(1, 8).flatmap(
        lambda size: st.tuples(
            st.just(size),
            st.integers(0, 9),
            st.lists(st.integers(-60, 60), min_size=2 * size, max_size=2 * size),
        )
    )
)
def test_units_change_the_rcond_by_no_more_than_another_choice_of_pivots_does(case):
    size, seed, exponents = case
    A, _ = system(size, seed=seed)
    units = np.ldexp(1.0, exponents)
    # Rows are scaled at once; columns decide with them which pivots are taken.
    other = rcond_of(A * units[:size, None])
    assert other == rcond_of(A)
    assert rcond_of(A * units[size:]) <= (1 + allowed_error(1 / other)) * _best_rcond(A)


def _best_rcond(A) -> float:
    return 1 / np.abs(np.linalg.eigvals(np.abs(np.linalg.inv(A)) @ np.abs(A))).max()


@pytest.mark.parametrize("unit", [2.0**-60, 2.0**-30, 2.0**30, 2.0**60])
def test_a_saddle_point_is_as_well_conditioned_in_grams_as_in_kilograms(unit):
    """As M_Au is: the unit of mass is in one block only, and in the unknowns of the other."""
    random = np.random.default_rng(0)
    M, a = np.diag(random.uniform(1, 2, 4)), random.uniform(-1, 1, (2, 4))
    one, other = (rcond_of(np.block([[M * m, a.T], [a, np.zeros((2, 2))]])) for m in (1.0, unit))
    assert one / 10 < other < one * 10


@given(
    st.integers(1, 12).flatmap(
        lambda size: st.tuples(
            st.just(size),
            st.integers(0, 9),
            st.lists(st.integers(-300, 300), min_size=size, max_size=size),
        )
    )
)
def test_scaling_rows_by_powers_of_two_changes_neither_rcond_nor_any_bit_of_the_result(case):
    size, seed, exponents = case
    A, b = system(size, seed=seed)
    units = np.ldexp(1.0, exponents)
    with recording_solves() as watch:
        x = solve(A, b, "A")
        scaled = solve(A * units[:, None], b * units, "scaled")
    assert np.array_equal(scaled, x)
    assert watch.rcond["scaled"] == watch.rcond["A"]


def test_links_of_very_different_masses_leave_m_au_its_digits():
    """Found by the stability atlas: with columns scaled before rows, all were lost."""
    for exponent in range(17):
        posed = FAMILIES["mass-ratio"].pose("alternating", 10.0**exponent)
        assert accuracy(posed.scene, "au", posed.q, posed.u).relative < 1e-12


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=6))
def test_scaling_brings_the_largest_entry_of_each_column_near_1(row):
    scale = column_scale(np.array([row]))
    assert (np.frexp(scale)[0] == 0.5).all()
    for entry, factor in zip(row, scale, strict=True):
        tiny = abs(entry) < 2.0**-1000
        assert tiny or 0.499 < abs(entry) * factor < 1


@pytest.mark.sampled(4)
@pytest.mark.parametrize("exponent", range(-40, 41))
def test_an_entry_that_is_a_power_of_two_is_scaled_alike_when_it_is_moved(exponent):
    """Found by hostile states: other scales are other pivots, with errors of another size."""
    entry = 2.0**exponent
    row = entry * np.array([1 - STEP, 1.0, 1 + STEP, 1.4])
    assert len(set(column_scale(row[np.newaxis]))) == 1


# ---- Fractions -----------------------------------------------------------------------------------


def fractions(rows) -> np.ndarray:
    return np.array([[Fraction(x) for x in row] for row in rows], object)


@pytest.mark.parametrize("size", [1, 2, 3, 6])
@columns
def test_elimination_of_fractions_is_exact(size, columns):
    random = np.random.default_rng(size)
    shape = (size,) if columns is None else (size, columns)
    A = fractions(random.integers(-9, 9, (size, size)).tolist()) + np.eye(size, dtype=int) * 20
    x = np.vectorize(Fraction, otypes=[object])(random.integers(-9, 9, shape))
    assert ((solve(A, A @ x, "A") - x) == 0).all()
    assert solve(A, A @ x, "A").shape == shape


def test_elimination_of_fractions_swaps_rows_where_a_pivot_is_zero():
    A = fractions([[0, 2, 1], [0, 0, 3], [5, 1, 1]])
    x = np.array([Fraction(1, 3), Fraction(-2), Fraction(5, 7)], object)
    assert solve(A, A @ x, "A").tolist() == x.tolist()


def test_elimination_changes_neither_the_matrix_nor_the_right_hand_side():
    A, b = fractions([[0, 2], [3, 1]]), np.array([Fraction(1), Fraction(2)], object)
    solve(A, b, "A")
    assert A.tolist() == [[0, 2], [3, 1]]
    assert b.tolist() == [1, 2]


@pytest.mark.parametrize(
    "rows", [[[0]], [[1, 2], [2, 4]], [[0, 1], [0, 3]], [[1, 1, 0], [0, 1, 1], [1, 2, 1]]]
)
def test_a_singular_matrix_of_fractions_is_refused_by_its_name(rows):
    A = fractions(rows)
    with pytest.raises(RefusedError, match="M_Name is singular") as caught:
        solve(A, A[:, 0], "M_Name")
    assert (caught.value.what, caught.value.rcond, caught.value.threshold) == ("M_Name", 0.0, 0.0)


def test_elimination_stays_exact_where_whole_numbers_stand_among_the_fractions():
    """Generic functions write literal zeros and ones into their matrices."""
    A = np.array([[2, 1, 0], [1, 3, 0], [0, Fraction(1, 3), 1]], object)
    x = solve(A, np.array([1, 2, Fraction(1, 7)], object), "A")
    assert all(isinstance(y, Fraction | int) for y in x)
    assert x.tolist() == [Fraction(1, 5), Fraction(3, 5), Fraction(1, 7) - Fraction(1, 5)]


def test_a_system_of_literals_alone_has_literals_for_its_solution_where_they_exist():
    A = np.array([[0, 2], [-1, 1]], object)
    x = solve(A, np.array([[4, 1], [0, 0]], object), "A")
    assert x.tolist() == [[2, Fraction(1, 2)], [2, Fraction(1, 2)]]
    assert [type(y) for y in x[:, 0]] == [int, int]


class Residue:
    """An integer modulo 7, for which somebody registers a solver."""


def test_a_kind_of_number_that_brings_its_own_solver_gets_it(monkeypatch):
    calls = []
    monkeypatch.setitem(linear.SOLVERS, Residue, lambda A, b, name: calls.append(name) or b)
    A = np.array([[Residue()]], object)
    b = np.array([Residue()], object)
    assert solve(A, b, "A") is b
    assert calls == ["A"]


def test_a_solver_of_its_own_is_found_although_the_first_entry_is_a_literal(monkeypatch):
    """As in M_IM, whose first entry is the literal 1."""
    monkeypatch.setitem(linear.SOLVERS, Residue, lambda A, b, name: b)
    A = np.array([[1, 0], [0, Residue()]], object)
    b = np.array([Residue(), Residue()], object)
    assert solve(A, b, "A") is b


def test_fractions_need_no_solver_of_their_own():
    assert Fraction not in linear.SOLVERS
    A, b = fractions([[2]]), np.array([Fraction(1)], object)
    assert solve(A, b, "A").tolist() == eliminate(A, b, "A").tolist() == [Fraction(1, 2)]


# ---- Machine code --------------------------------------------------------------------------------

machine_sizes = pytest.mark.parametrize("size", [*range(1, INLINE + 3), 20, 40])
"""In registers, and in memory."""


MANY = 200
"""Operations beyond which loops are looked for, earlier than usual: large ones are made sooner."""


def solved(A, b):
    return solve(A, b, "A")


def machine_solve(A, b):
    return in_machine_code(solved, A, b, short=MANY)


@machine_sizes
@columns
@pytest.mark.sampled(3)
def test_machine_code_solves(size, columns):
    A, b = system(size, columns)
    x = machine_solve(A, b)
    assert_solves(A, x, b)
    difference = np.abs(x - solve(A, b, "A")).max()
    assert difference <= 2 * allowed_error(np.linalg.cond(A) * np.abs(x).max())


@pytest.mark.sampled(4)
@machine_sizes
@columns
@pytest.mark.parametrize("kind", ["zero", "equal rows", "zero column"])
def test_machine_code_answers_a_singular_matrix_with_nan_and_does_not_raise(size, columns, kind):
    A, b = system(size, columns)
    match kind:
        case "zero":
            A[:] = 0
        case "equal rows" if size > 1:
            A[0] = A[-1] = np.round(4 * A[-1])
            A[0, 0] = A[-1, 0] = 4.0
            A[1:-1, 0] = 0.0
        case _:
            A[:, size // 2] = 0
    assert np.isnan(machine_solve(A, b)).all()


@machine_sizes
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_machine_code_answers_a_matrix_that_is_not_finite_with_nan(size, bad):
    A, b = system(size)
    found = machine_solve(np.full_like(A, bad), b)
    assert np.isnan(found).all() or (size == 1 and (found == 0).all())  # 1 / inf
    A[size // 2, size // 2] = np.nan
    assert np.isnan(machine_solve(A, b)).any()


@machine_sizes
@columns
@pytest.mark.sampled(3)
def test_machine_code_changes_neither_the_matrix_nor_the_right_hand_side(size, columns):
    A, b = system(size, columns)
    code = MachineCode(solved, A, b, short=MANY)
    block = code.block(A, b)
    before, first = block.copy(), code.run(block)
    places = code.kernel.layout.offsets
    for name, x in (("a0", A), ("a1", b)):
        where = slice(HEADER + places[name], HEADER + places[name] + x.size)
        assert np.array_equal(before[where], x.ravel())
        assert np.array_equal(block[where], x.ravel())
    assert np.array_equal(code.run(block), first)


@machine_sizes
def test_machine_code_swaps_rows_where_a_pivot_is_zero(size):
    A = np.roll(np.diag(np.arange(1.0, size + 1)), 1, axis=0)
    x = np.arange(1.0, size + 1)
    assert np.array_equal(machine_solve(A, A @ x), x)


@machine_sizes
@columns
def test_powers_of_two_as_units_of_rows_change_no_bit_in_machine_code(size, columns):
    A, b = system(size, columns)
    x = machine_solve(A, b)
    for seed in range(5):
        units = np.ldexp(1.0, np.random.default_rng(seed).integers(-400, 401, size))
        scaled = (b.T * units).T
        assert np.array_equal(machine_solve(units[:, None] * A, scaled), x)


@machine_sizes
def test_pivots_are_chosen_by_the_rows_as_scaled_in_machine_code_too(size):
    """[1e-20, 1] and [1, 1], the first of them times 1e30: unscaled, it would be the pivot."""
    A, b = np.eye(size), np.arange(1.0, size + 1)
    if size > 1:
        A[:2, :2] = [[1e10, 1e30], [1.0, 1.0]]
    expected = solve(A, b, "A")
    found = machine_solve(A, b)
    assert np.abs(found - expected).max() <= 1e-15 * np.abs(expected).max()


@machine_sizes
@columns
def test_hostile_units_of_rows_and_unknowns_leave_machine_code_as_exact_as_python(size, columns):
    for seed in range(5):
        A, b = system(size, columns, seed)
        random = np.random.default_rng((size, seed))
        rows, unknowns = 10.0 ** random.uniform(-100, 100, (2, size))
        x = machine_solve(rows[:, None] * A, (b.T * rows).T)
        assert_solves(A, x, b)
        A = A * 10.0 ** random.uniform(-4, 4, size)
        x, expected = machine_solve(A, b), solve(A, b, "A")
        assert_solves(A, x, b)
        assert np.abs(A @ (x - expected)).max() <= 2 * allowed_error(
            size * (np.abs(A) @ np.abs(expected)).max()
        )
        large = machine_solve(rows[:, None] * A / unknowns, (b.T * rows).T)
        assert np.isfinite(large).all()


@pytest.mark.sampled(9)
@pytest.mark.parametrize("width", [2, 4])
@machine_sizes
@columns
def test_each_lane_of_a_solve_has_the_bits_of_a_single_one(size, columns, width):
    systems = [system(size, columns, seed) for seed in range(width)]
    systems[-1][0][:] = 0.0  # a singular one leaves the others alone
    A, b = (np.stack(x, axis=-1) for x in zip(*systems, strict=True))
    found = MachineCode(solved, *systems[0], width=width, short=MANY)(A, b)
    for lane, (A, b) in enumerate(systems):
        alone = machine_solve(A, b)
        assert np.array_equal(found[..., lane], alone, equal_nan=True)
        assert np.isnan(alone).all() == (lane == width - 1)


def test_both_solves_have_the_same_signature():
    assert list(inspect.signature(solve).parameters) == ["A", "b", "name"]
