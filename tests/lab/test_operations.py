"""The study of operations: exact counts, exact polynomials, and the orders of Table I read off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flint import fmpq_poly

from eomcheck.errors import InputError, UnknownNameError
from eomcheck.formulations import FORMULATIONS, Formulation
from eomcheck.lab.studies.operations import (
    KINDS,
    STUDY,
    cells,
    counted_in,
    fit,
    fit_order,
    fit_polynomial,
    order_text,
    polynomial_text,
    solved_systems,
    springs_in,
    table_i_text,
)
from eomcheck.lab.studies.operations import measure as counting_module
from eomcheck.lab.studies.operations.measure import (
    Operations,
    compare_springs,
    count,
    lu_operations,
)
from eomcheck.motion import right_hand_side
from eomcheck.motion import right_hand_side as state
from eomcheck.motion import right_hand_side as trace
from eomcheck.numbers.counting import Counted, Counting, System
from eomcheck.scenes import Snake

SIZES = range(2, 13)

formulations = pytest.mark.parametrize("formulation", FORMULATIONS.values(), ids=lambda f: f.key)


@pytest.fixture(scope="module")
def records() -> list[Operations]:
    return counted_in(STUDY.run(links=f"{SIZES[0]}..{SIZES[-1]}"))


# ---- What is counted -----------------------------------------------------------------------------


@formulations
@pytest.mark.parametrize("links", [2, 7])
def test_the_very_functions_that_machine_code_is_made_of_have_these_counts(
    formulation: Formulation, links: int, monkeypatch
):
    class CountingTape(Counting):
        """Counts what a tape would write down."""

        def inputs(self, name, shape):
            return self.numbers(np.zeros(shape))

        def number(self, x):
            return SimpleNamespace(index=0)

    counting, scene = CountingTape(), Snake.coil(links)
    monkeypatch.setattr(trace, "Tape", lambda: counting)
    # The v of Em's v2 belongs to the state, and is not counted with the right-hand side.
    v = counting.vector(scene.n)
    monkeypatch.setattr(state, "velocity_of_independent", lambda *_: v)
    monkeypatch.setattr(Snake, "constraints", staticmethod(lambda *_: (None, None)))
    right_hand_side.trace_rates(scene, formulation)
    tally, counted = counting.tally, count(scene, formulation)
    assert (tally.additions, tally.multiplications, tally.divisions) == (
        counted.additions,
        counted.multiplications,
        counted.divisions,
    )
    assert tally.trigonometric_pairs == counted.trigonometric_pairs == links
    assert tuple(tally.systems) == counted.solves


@pytest.mark.sampled(4)
@formulations
@pytest.mark.parametrize("links", range(1, 13))
def test_operations_on_two_zeros_of_new_arrays_are_missed_by_em_at_one_link_and_nowhere_else(
    formulation: Formulation, links: int, monkeypatch
):
    expected = count(Snake.coil(links), formulation)
    counting = Counting()

    def zeros(shape, dtype=float):
        array = plain(shape)
        return counting.numbers(array) if np.dtype(dtype).kind == "O" else array.astype(dtype)

    plain = np.zeros
    monkeypatch.setattr(counting_module, "Counting", lambda: counting)
    monkeypatch.setattr(np, "zeros", zeros)
    monkeypatch.setattr(np, "zeros_like", lambda x: zeros(x.shape, x.dtype))
    found = count(Snake.coil(links), formulation)
    missed = 3 if (formulation.key, links) == ("em", 1) else 0
    assert found == replace(expected, multiplications=expected.multiplications + missed)


@pytest.mark.parametrize(("order", "columns"), [(1, 1), (2, 3), (3, 1), (7, 4)])
def test_the_operations_of_lu_are_those_of_an_elimination_that_is_counted(order: int, columns: int):
    counting = Counting()
    A, b = counting.numbers(np.zeros((order, order))), counting.numbers(np.zeros((order, columns)))
    for k in range(order):
        for i in range(k + 1, order):
            A[i, k] = A[i, k] / A[k, k]
            A[i, k + 1 :] = A[i, k + 1 :] - A[i, k] * A[k, k + 1 :]
            b[i] = b[i] - A[i, k] * b[k]
    for i in range(order - 1, -1, -1):
        for k in range(i + 1, order):
            b[i] = b[i] - A[i, k] * b[k]
        b[i] = b[i] / A[i, i]
    tally = counting.tally
    assert lu_operations(System("A", order, columns)) == (
        tally.additions + tally.multiplications + tally.divisions
    )


@pytest.mark.parametrize("order", [2, 6, 10, 26])
def test_the_operations_of_a_banded_lu_are_those_of_an_elimination_that_is_counted(order: int):
    """With rows exchanged all the time, so that the band of U is as wide as it can be."""
    counting = Counting()
    one = counting.vector(1)[0]
    for i in range(order):
        for _ in range(max(i - 3, 0), min(i + 4, order)):
            one - one * one
    for k in range(order):
        for _ in range(k + 1, min(k + 4, order)):
            factor = one / one
            for _ in range(k + 1, min(k + 7, order)):
                one - factor * one
    for _ in range(2):
        for k in range(order):
            for _ in range(k + 1, min(k + 4, order)):
                one - one * one
            for _ in range(k + 1, min(k + 7, order)):
                one - one * one
            one / one
    for _ in range(order):
        one + one
    tally = counting.tally
    assert lu_operations(System("A", order, 1, 3)) == (
        tally.additions + tally.multiplications + tally.divisions
    )


def test_records_hold_every_formulation_at_every_number_of_links(records):
    assert [(x.links, x.formulation) for x in records] == [
        (links, key) for links in SIZES for key in FORMULATIONS
    ]
    assert all((x.n, x.r, x.s) == (x.links + 2, x.links, 2 * x.links) for x in records)


def test_what_cannot_be_counted_is_refused():
    with pytest.raises(UnknownNameError, match="unknown formulation 'xx'"):
        list(cells(links="2", formulation=["xx"]))
    for nothing in ("0", "3..2"):
        with pytest.raises(InputError, match=f"links = '{nothing}'"):
            list(cells(links=nothing))


# ---- Polynomials ---------------------------------------------------------------------------------


def test_every_fitted_polynomial_gives_back_every_count(records):
    polynomials = {f.formulation: f.polynomials for f in fit(records)}
    assert set(polynomials) == set(FORMULATIONS)
    for record in records:
        for kind, of in KINDS.items():
            assert polynomials[record.formulation][kind](record.links) == of(record), kind


@pytest.mark.night
def test_the_polynomials_of_a_few_small_snakes_hold_for_a_large_one(records):
    large = {record.formulation: record for record in counted_in(STUDY.run(links="100"))}
    for f in fit(records):
        for kind, of in KINDS.items():
            assert f.polynomials[kind](100) == of(large[f.formulation]), (f.formulation, kind)


def test_kanes_counts_are_those_of_its_parts_by_hand(records):
    """Additions, multiplications, divisions of each part; N is the number of links.

    kinematics         24 (N-1) + 4   49 (N-1) + 11    3 (N-1)
    spring torques     N-1            N-1              0
    springs on u       4 (N-1)        2 (N-1)          0
    momenta            0              4 N              0
    M_Kane             6 N            6 N              0
    N q̇ + G            4 N            4 N              0
    F - (N q̇ + G)      2              0                0
    """
    N = fmpq_poly([0, 1])
    (kane,) = (f.polynomials for f in fit(records) if f.formulation == "kane")
    additions = 24 * (N - 1) + 4 + (N - 1) + 4 * (N - 1) + 6 * N + 4 * N + 2
    multiplications = 49 * (N - 1) + 11 + (N - 1) + 2 * (N - 1) + 4 * N + 6 * N + 4 * N
    assert kane["additions"] == additions
    assert kane["multiplications"] == multiplications
    assert kane["divisions"] == 3 * (N - 1)
    assert kane["sin and cos"] == N
    assert kane["solves, by LU"] == 9


def test_bandeds_counts_are_those_of_its_parts_by_hand(records):
    """Additions, multiplications, divisions of each part; N is the number of links.

    wheel directions   2 N            4 N              0
    joints             9 (N-1)        26 (N-1)         0
    spring torques     2 (N-1) - 1    N-1              0
    q̇ of x             4              10               0
    """
    N = fmpq_poly([0, 1])
    (banded,) = (f.polynomials for f in fit(records) if f.formulation == "banded")
    assert banded["additions"] == 2 * N + 9 * (N - 1) + 2 * (N - 1) - 1 + 4
    assert banded["multiplications"] == 4 * N + 26 * (N - 1) + (N - 1) + 10
    assert banded["divisions"] == 0
    assert banded["sin and cos"] == N


def test_only_kanes_and_bandeds_cost_is_linear_in_the_number_of_links(records):
    degree = {f.formulation: f.polynomials["outside of solves"].degree() for f in fit(records)}
    assert degree.pop("kane") == degree.pop("banded") == 1
    assert degree.pop("gw") == 3
    assert set(degree.values()) == {2}
    solves = {f.formulation: f.polynomials["solves, by LU"].degree() for f in fit(records)}
    assert solves.pop("kane") == solves.pop("ml") == 0
    assert solves.pop("banded") == 1
    assert set(solves.values()) == {3}


def points(function, sizes=SIZES):
    return [(N, function(N)) for N in sizes]


@pytest.mark.parametrize("degree", range(5))
def test_the_polynomial_found_is_the_one_that_made_the_counts(degree: int):
    made = fmpq_poly([-3, 1, 7, 0, 2][: degree + 1]) / 2
    assert fit_polynomial((N, made(N)) for N in SIZES) == made


@pytest.mark.parametrize(
    "function", [lambda N: 2**N, lambda N: N**5, lambda N: N**2 + (N == 7), lambda N: N % 2]
)
def test_counts_that_no_polynomial_of_degree_4_gives_are_not_fitted(function):
    assert fit_polynomial(points(function)) is None


def test_no_polynomial_is_claimed_without_a_point_to_spare():
    for degree in range(5):
        few = points(lambda N: N**degree, range(1, degree + 2))  # noqa: B023
        assert fit_polynomial(few) != fmpq_poly([0] * degree + [1])
    assert fit_polynomial([(3, 1)]) is None
    assert fit_polynomial([]) is None


def test_two_counts_for_one_number_of_links_are_not_fitted():
    assert fit_polynomial([(2, 1), (2, 2), (3, 1), (4, 1)]) is None


def wasteful_solution(*bodies):
    """Look at every pair of bodies, as a careless implementation of Kane's method does."""
    mass = bodies[4]
    for x in mass:
        for y in mass:
            x * y
    return FORMULATIONS["kane"].solution(*bodies)


def test_a_quadratic_mistake_in_kanes_method_is_not_called_linear():
    wasteful = replace(FORMULATIONS["kane"], solution=wasteful_solution)
    fitted = [
        fit([count(Snake.coil(links), formulation) for links in SIZES])[0].polynomials
        for formulation in (FORMULATIONS["kane"], wasteful)
    ]
    for kind, right in fitted[0].items():
        more = fmpq_poly([0, 0, 1] if kind in ("multiplications", "outside of solves") else [0])
        assert fitted[1][kind] == right + more


@pytest.mark.parametrize(
    ("polynomial", "text"),
    [
        (fmpq_poly([-57, 116]), "116 N - 57"),
        (fmpq_poly([1, -1, 0, 1]), "N³ - N + 1"),
        (fmpq_poly([0, -7, 9]) / 2, "9/2 N² - 7/2 N"),
        (fmpq_poly([0, -1]), "-N"),
        (fmpq_poly([]), "0"),
        (fmpq_poly([-1]), "-1"),
        (None, "no fit"),
    ],
)
def test_polynomials_are_printed_as_one_writes_them(polynomial, text):
    assert polynomial_text(polynomial) == text


# ---- Systems, beside Table I ---------------------------------------------------------------------


@formulations
def test_the_last_system_has_the_order_of_table_i_at_every_number_of_links(
    formulation: Formulation, records
):
    for record in records:
        if record.formulation == formulation.key:
            assert record.solves[-1].order == formulation.unknowns(record.n, record.r, record.s)
    *_, last = (s for s in solved_systems(records) if s.formulation == formulation.key)
    assert last.final
    assert last.differing == ()
    if formulation.in_paper:
        assert last.order == formulation.order
        assert order_text(last) == formulation.order_text
        assert table_i_text(last) == f"{formulation.order_text}: the same at every N"
    else:
        assert table_i_text(last) == f"not there; {formulation.order_text} at every N"


def test_a_banded_system_is_listed_with_its_band(records):
    (system,) = (s for s in solved_systems(records) if s.formulation == "banded")
    assert (system.smallest.name, system.smallest.order, system.smallest.half) == ("KKT", 6, 3)
    assert order_text(system) == "5r - n"  # s = 2r for a snake


def test_systems_before_the_last_are_found_with_their_orders_and_right_hand_sides(records):
    found = {
        (s.formulation, s.smallest.name): (order_text(s), polynomial_text(s.columns))
        for s in solved_systems(records)
        if not s.final
    }
    assert found == {
        ("el", "a'T"): ("r", "N + 3"),  # n + 1
        ("gw", "M"): ("n", "N + 1"),  # r + 1
        ("gw", "a M^-1 aT"): ("r", "1"),
        ("em", "a_1"): ("r", "3"),  # n - r + 1
    }


def test_an_order_that_is_not_that_of_table_i_is_reported(records):
    *rows, last = (record for record in records if record.formulation == "au")
    wrong = replace(last, solves=(System("M_Au", last.n + last.r + 1, 1),))
    (system,) = solved_systems([*rows, wrong])
    assert system.order is None
    assert system.differing == (12,)
    assert table_i_text(system) == "n + r: differs at N = 12"


def test_orders_are_only_given_where_whole_numbers_fit_all_points():
    assert fit_order([(N + 2, N, 3 * N + 4) for N in SIZES]) == (2, 1)
    assert fit_order([(N + 2, N, 0) for N in SIZES]) == (0, 0)
    assert fit_order([(N + 2, N, N + 1) for N in SIZES]) is None
    assert fit_order([(N + 2, N, N + (N == 9)) for N in SIZES]) is None
    assert fit_order([(N + 2, N, N) for N in (2, 3)]) is None
    assert fit_order([(2 * N, N, N) for N in SIZES]) is None, "n and r tell nothing apart"


# ---- What is absent costs nothing ----------------------------------------------------------------


@pytest.mark.parametrize("links", [2, 3, 7])
def test_springs_cost_what_their_terms_cost_and_absent_ones_nothing(links: int):
    rows = springs_in(STUDY.run(links=str(links)))
    assert [row.formulation for row in rows] == list(FORMULATIONS)
    for row in rows:
        assert row.difference == tuple(row.alone)
        joints = links - 1
        # T = k (θ - θ'), then T into two rows of Q and Q - B ...
        expected = {"kane": (5 * joints + 2, 3 * joints), "banded": (2 * joints - 1, joints)}
        # ... or T (∂ω'/∂u - ∂ω/∂u) and F - left, or T - T' on each body between two joints.
        in_terms = (3 * joints + links + 2, joints)
        assert row.difference == (*expected.get(row.formulation, in_terms), 0)


@pytest.mark.parametrize("key", FORMULATIONS)
def test_dampers_cost_as_much_as_springs_and_absent_ones_nothing(key: str):
    coil, one = Snake.coil(5), np.ones(4)
    dampers = replace(coil, stiffness=None, damping=one)
    alone = count(coil, FORMULATIONS[key])
    assert count(dampers, FORMULATIONS[key]) == alone
    both = count(replace(coil, damping=one), FORMULATIONS[key])
    # d (ω - ω') is added to each torque, of which there is one per joint.
    assert both.additions - alone.additions == 2 * 4
    assert both.multiplications - alone.multiplications == 4


def test_a_snake_without_joints_has_no_springs_to_compare():
    assert springs_in(STUDY.run(links="1")) == []


def test_zeros_in_the_place_of_absent_springs_do_not_go_unnoticed(monkeypatch):
    def padded(parameters, angles, q, v):
        found = right(parameters, angles, q, v)
        return found._replace(Q=np.zeros(v.size, v.dtype)) if found.Q is None else found

    right = Snake.terms
    monkeypatch.setattr(Snake, "terms", staticmethod(padded))
    for formulation in FORMULATIONS.values():
        row = compare_springs(Snake.coil(5), formulation)
        noticed = row.difference != row.alone
        assert noticed == (formulation.uses in ("terms", "speeds"))


def test_a_count_is_the_same_whatever_the_numbers_are():
    for formulation in FORMULATIONS.values():
        here = count(Snake.coil(4), formulation)
        assert here == count(Snake.pattern(4), formulation)
        assert here == count(
            Snake([1e9] * 4, [1.0] * 4, [0.0] * 4, [0.0] * 3, [0.0] * 4), formulation
        )


def test_every_number_of_a_right_hand_side_is_a_counted_one_or_a_literal():
    counting, scene = Counting(), Snake.coil(3)
    at = counting_module.Quantities(scene, counting, counting.vector(scene.n))
    at.u = counting.vector(scene.p)
    for record in (
        at.parameters,
        at.prepared,
        at.terms,
        at.kinematics,
        at.speeds,
        at.bodies,
        at.chain,
    ):
        for field in record:
            if field is not None:
                assert {type(x) for x in field.flat} <= {Counted, int}
