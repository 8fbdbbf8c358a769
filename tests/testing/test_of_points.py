"""What is measured of black boxes at a point, and how their answers are read, in plain numbers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.testing.own import guide

from eomcheck.claims.finding import Finding, Verdict
from eomcheck.claims.registry import BlindSpot
from eomcheck.errors import InputError
from eomcheck.evaluation.tolerance import C
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import SCENES
from eomcheck.testing import EquationsOfMotion, check_functions, from_scene
from eomcheck.testing.claims_answers import NOISE
from eomcheck.testing.claims_derivatives import propagated
from eomcheck.testing.equations_of_motion import BrokenError, FunctionCaller
from eomcheck.testing.function_state import (
    FunctionState,
    clock_rate,
    differences,
    inertia,
    supplied_or_derived_bias,
    supplied_or_derived_drift,
    why_no_bias,
)
from eomcheck.testing.suite import (
    EquationsTarget,
    read_expected_failures,
    result_or_failure,
    without_unresolved,
)
from eomcheck.testing.uncertain import (
    SHORT_STEPS,
    STEPS,
    UncertainArray,
    contract,
    entry_sizes,
    exact,
    jumps,
    jumps_on,
    partial,
    sign_patterns,
    zero,
)

CART = guide("cart")


def at(q: Any = (0.3, 0.7), v: Any = (0.5, -0.8), **own: Any) -> FunctionState:
    """Return the point of functions of as many coordinates."""
    q, v = np.array(q, float), np.array(v, float)
    return FunctionState(FunctionCaller(EquationsOfMotion(len(q), **own)), q, v)


# ---- Measured numbers ----------------------------------------------------------------------------


def test_sums_and_products_carry_errors_and_sizes():
    x = UncertainArray(np.array([2.0, -3.0]), np.array([0.1, 0.2]), np.array([5.0, 4.0]))
    y = UncertainArray(np.array([1.0, 7.0]), np.array([0.01, 0.03]), np.array([1.5, 8.0]))

    def parts(one: UncertainArray) -> list[Any]:
        return [one.value.tolist(), *(pytest.approx(z.tolist()) for z in (one.error, one.size))]

    assert parts(x - y) == [[1.0, -10.0], [0.11, 0.23], [6.5, 12.0]]
    assert parts(-2.0 * x) == [[-4.0, 6.0], [0.2, 0.4], [10.0, 8.0]]
    assert parts(-x) == [[-2.0, 3.0], [0.1, 0.2], [5.0, 4.0]]
    assert parts(x[1]) == [-3.0, 0.2, 4.0]
    dot = x @ y
    assert float(dot.value) == -19.0
    assert float(dot.size) == 5.0 * 1.5 + 4.0 * 8.0
    assert float(dot.error) == pytest.approx(0.1 * 1.5 + 0.2 * 8.0 + 5.0 * 0.01 + 4.0 * 0.03)
    assert float((exact([3.0]) @ exact([0.5])).error) == 1.5 * EPS
    assert float((exact([3.0]) + exact([0.5])).error[0]) == 3.5 * EPS
    table = UncertainArray(np.arange(6.0).reshape(2, 3), np.ones((2, 3)), np.full((2, 3), 2.0))
    assert (table.T.shape, (x @ table).shape, (table @ table.T).shape) == ((3, 2), (3,), (2, 2))
    assert (x @ table).value.tolist() == [-9.0, -10.0, -11.0]
    assert zero(x).error.tolist() == [5.0 * EPS, 4.0 * EPS]
    assert contract("i,j->ij", x, y).value.tolist() == [[2.0, 14.0], [-3.0, -21.0]]


# ---- Noise and jumps -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "jumps_there"),
    [
        ([0, 1, 2, 3, 4, 5], False),
        ([0, 1, 2, 22, 23, 24], False),  # 20 times the median
        ([0, 1, 2, 52, 53, 54], True),
        ([0, -1, -2, -52, -53, -54], True),
        ([7, 7, 7, 7, 7, 7], False),
        ([1, 1, 1, 1 + 600 * EPS, 1, 1], False),  # rounding
        ([1, 1, 1, 1 + 3000 * EPS, 1, 1], True),
        ([0, 10, 20, 30, 40, 500], True),
    ],
)
def test_a_jump_is_thirty_times_the_median_change(values: list[float], jumps_there: bool):
    both = np.column_stack((np.zeros(6), np.array(values, float)))
    assert jumps_on(both).tolist() == [False, jumps_there]


@pytest.mark.parametrize("count", range(1, 9))
def test_any_two_entries_have_opposite_signs_in_some_row(count: int):
    signs = sign_patterns(count)
    assert {*np.unique(signs)} <= {-1.0, 1.0}
    for i in range(count):
        for k in range(i):
            assert (signs[:, i] != signs[:, k]).any()


def test_sizes_of_a_square_matrix_are_those_of_its_diagonal_at_least():
    found = entry_sizes(np.array([[4.0, 0.0, -9.0], [1.0, -9.0, 2.0], [0.0, 0.0, 0.25]]))
    assert found.tolist() == [[4.0, 6.0, 9.0], [6.0, 9.0, 2.0], [1.0, 1.5, 0.25]]
    assert entry_sizes(np.array([[4.0, 0.0], [-9.0, 1.0], [0.0, -2.0]])).tolist() == [
        [4.0, 0.0],
        [9.0, 1.0],
        [0.0, 2.0],
    ]
    assert entry_sizes(np.array([-4.0, 0.0])).tolist() == [4.0, 0.0]


@pytest.mark.parametrize(("away", "there"), [(0.9e-3, True), (-0.4e-3, True), (3e-3, False)])
@pytest.mark.parametrize("width", [1.0, 50.0])
def test_a_jump_is_one_within_a_thousandth_of_the_half_width(away: float, there: bool, width):
    def f(x: Any) -> Any:
        return np.array([np.sin(x[0] / width) + (x[0] > width * (0.3 + 0.45 * away))])

    assert jumps(f, np.array([0.3 * width]), np.array([width])) == there


@pytest.mark.parametrize(
    ("share", "verdict"),
    [
        (2.0**-36, "passed"),
        (2.0**-28, "inconclusive"),
        (2.0**-15, "inconclusive"),
        (1e-2, "passed"),
    ],
)
def test_noise_is_called_single_precision_between_two_bounds(share: float, verdict: str):
    def U(q):
        return np.sin(q[0]) + share * np.sin(1e11 * q[0])

    for seed in range(3):
        (found,) = check_functions(
            1, U=U, states=[([0.4], [0.1])], claims=["double-precision"], seed=seed
        )
        assert (found.verdict, found.allowed) == (verdict, NOISE)


def test_noise_of_accelerations_is_no_fault_of_theirs():
    def rough(q, v):
        return np.sin(q) + 2.0**-28 * np.sin(1e11 * q)

    options = {"states": [([0.4], [0.1])], "claims": ["double-precision"]}
    assert [x.verdict for x in check_functions(1, qdd=rough, **options)] == ["passed"]
    assert [x.verdict for x in check_functions(1, bias=rough, **options)] == ["inconclusive"]


# ---- Derivatives ---------------------------------------------------------------------------------


def test_a_derivative_asks_half_of_the_half_width_and_no_further():
    asked: list[Any] = []

    def f(x: Any) -> Any:
        asked.append(x - [0.4, -0.7])
        return np.array([x[0] ** 2, x[1]])

    partial(f, np.array([0.4, -0.7]), 1, 3.0)
    away = np.array(asked)
    assert not away[:, 0].any()
    assert away[:, 1].max() == pytest.approx(1.5) and away[:, 1].min() == pytest.approx(-1.5)
    least = np.abs(away[:, 1][away[:, 1] != 0.0]).min()
    assert 3.0 * 2.0**-36 < least < 3.0 * 2.0**-32


def test_a_derivative_has_the_noise_of_its_function_and_its_size():
    def f(x: Any) -> Any:
        return np.array([3.0 * x[0], 0.0 * x[0], 1e3 + 0.0 * x[0]])

    noise = np.array([1e-9, 1e-9, 0.0])
    found = partial(f, np.array([0.4]), 0, 2.0, noise, np.array([10.0, 6.0, 1e3]))
    assert found.value.tolist() == [3.0, 0.0, 0.0]
    # Noise over the longest step that shorter ones confirm, twice.
    assert (found.error[:2] > 1e-9).all() and (found.error[:2] < 2e-8).all()
    assert found.size.tolist() == [5.0, 3.0, 500.0]


@pytest.mark.parametrize("slopes", [(1.0, 2.0), (-3.0, 0.0), (0.0, 0.5)])
def test_a_kink_is_off_by_the_difference_of_its_slopes(slopes: tuple[float, float]):
    below, above = slopes
    found = partial(lambda x: np.where(x < 0.0, below * x, above * x), np.zeros(1), 0, 1.0)
    assert found.error[0] == pytest.approx(abs(above - below), rel=0.05)


def test_second_differences_are_those_of_the_coefficients():
    A = np.array([[3.0, 0.7, -0.4], [0.7, 2.0, 0.3], [-0.4, 0.3, 5.0]])

    def f(q: Any, v: Any) -> Any:
        return v @ A @ v / 2.0 + q @ v + 11.0

    widths = np.array([1.0, 2.0, 0.5])
    found, size = differences(f, np.array([0.1, -0.2, 0.3]), widths)
    np.testing.assert_allclose(found, A * np.outer(widths, widths), rtol=1e-13)
    assert (size >= 44.0).all() and (size <= 4.0 * 20.0).all()


def test_sizes_of_second_differences_are_those_of_the_largest_term_of_either_sign():
    def f(q: Any, v: Any) -> Any:
        return 3.0 * v[0] - 5.0 * v[1] - 2.0 * v[1] ** 2 + v[0] * v[1] - 0.5

    _, size = differences(f, np.zeros(2), np.array([1.0, 2.0]))
    # Ahead (2.5, -18.5), behind (-3.5, 1.5), both -13.5.
    np.testing.assert_allclose(size, 4.0 * np.array([[3.5, 18.5], [18.5, 18.5]]), rtol=1e-15)


# ---- Points --------------------------------------------------------------------------------------


def test_each_term_is_had_in_its_own_way():
    """Gravity given, in the bias, or of U; forces of what there is, each with its sign."""
    U = {"U": lambda q: 2.0 * q[0] ** 2 + 3.0 * q[1]}
    slope = [1.2, 3.0]
    given = {"gravity": lambda q: np.array([4.0 * q[0], 3.0])}
    inside = {
        "bias": lambda q, v: np.array([4.0 * q[0] + v[0] ** 2, 3.0]),
        "bias_has_gravity": True,
    }
    for own in (U, given, inside):
        np.testing.assert_allclose(at(**own).gravity().value, slope, rtol=1e-12)
    np.testing.assert_allclose(at(**inside).B().value, [0.25, 0.0], atol=1e-12)
    assert [at(**own).has("gravity") for own in (U, given, inside)] == [False, True, True]
    more = {"Q": lambda q, v: np.array([10.0, 20.0]), "R": lambda q, v: v[0] ** 2 + 5.0 * v[1]}
    here = at(**U, **more)
    np.testing.assert_allclose(here.forces().value, [10 - 1.2 - 1.0, 20 - 3.0 - 5.0], rtol=1e-11)
    assert {name: x.value.round(9).tolist() for name, x in here.parts().items()} == {
        "Q": [10.0, 20.0],
        "gravity": [-1.2, -3.0],
        "damping": [-1.0, -5.0],
    }


@pytest.mark.parametrize(
    ("T", "natural", "even"),
    [
        (lambda q, v: v @ v, True, True),
        (lambda q, v: v @ v + 1e-3 * q[0], False, True),
        (lambda q, v: v @ v + 1e-3 * v[1], False, False),
        (lambda q, v: v @ v + 1e-17, True, True),
    ],
)
def test_a_kinetic_energy_is_natural_or_even(T: Callable, natural: bool, even: bool):
    here = at(T=T)
    assert (here.natural(), here.even()) == (natural, even)


def test_a_consistent_point_keeps_constraints_of_q_and_of_v_that_a_clock_drives():
    own = {
        "a": lambda q: np.array([[2.0 * q[0], 2.0 * q[1]]]),
        "c": lambda q: np.array([q @ q - 1.0]),
        "b": lambda t: np.array([0.7]),
    }
    there = at((0.5, 0.9), (0.4, 2.0), **own).consistent()
    assert there is not None
    assert abs(there.q @ there.q - 1.0) < 4 * EPS
    assert abs(2.0 * there.q @ there.v + 0.7) < 4 * EPS
    # ... the nearest one: only along the rows of a.
    np.testing.assert_allclose(there.q, np.array([0.5, 0.9]) / np.hypot(0.5, 0.9), rtol=1e-9)
    across = np.array([-there.q[1], there.q[0]])
    assert across @ there.v == pytest.approx(across @ [0.4, 2.0])


@pytest.mark.parametrize(
    ("a", "free"),
    [
        ([[1.0, 0.0, 0.0]], 2),
        ([[1.0, 2.0, 0.0], [2.0, 4.0, 0.0]], 2),  # a row twice
        ([[1.0, 2.0, 0.0], [2.0, 4.0, 1e-3]], 1),
        ([[0.0, 0.0, 0.0]], 3),
        ([[1.0, 2.0, 0.0], [0.1, 0.2, 0.3], [1.0, 0.0, 0.0]], 0),
    ],
)
def test_directions_that_constraints_leave_are_counted_by_rank(a: Any, free: int):
    here = at((0.1, 0.2, 0.3), (0.4, 0.5, 0.6), a=lambda q: np.array(a))
    found = here.free()
    assert found.shape == (3, free)
    np.testing.assert_allclose(np.array(a) @ found, 0.0, atol=1e-15)
    np.testing.assert_allclose(found.T @ found, np.eye(free), atol=1e-14)


def test_speeds_are_turned_into_rates_and_forces_back():
    """q̇ = S u with S (3, 2): gravity along u is Sᵀ ∂U/∂q."""
    S = np.array([[1.0, 2.0], [0.0, -1.0], [3.0, 0.5]])
    functions = EquationsOfMotion(
        3,
        qdot=lambda q, u: S @ u,
        speeds=2,
        U=lambda q: q @ [1.0, -2.0, 0.3],
        a=lambda q: np.array([[q[0] * q[2], 0.0]]),
    )
    here = FunctionState(
        FunctionCaller(functions), np.array([0.3, 0.7, 0.4]), np.array([0.5, -0.8])
    )
    np.testing.assert_allclose(here.S().value, S)
    np.testing.assert_allclose(here.rates().value, S @ here.v)
    np.testing.assert_allclose(here.gravity().value, S.T @ [1.0, -2.0, 0.3], rtol=1e-12)
    rates = S @ here.v
    rate = (rates[0] * 0.4 + 0.3 * rates[2]) * 0.5
    np.testing.assert_allclose(supplied_or_derived_drift(here).value, [rate], rtol=1e-11)
    np.testing.assert_allclose(here.rate_of(here.raw("U")).value, rates @ [1.0, -2.0, 0.3])


def test_a_function_is_measured_once_at_a_state():
    calls = []
    made = EquationsOfMotion(2, M=lambda q: calls.append(1) or np.diag(2.0 + np.sin(q)))
    here = FunctionState(FunctionCaller(made), np.array([0.3, 0.2]), np.zeros(2))
    here.quantity("M")
    before = len(calls)
    first = here.by_q(here.raw("M"))
    steps = len(calls) - before
    assert here.by_q(here.raw("M")) is first and len(calls) == before + steps
    assert steps == 2 * 2 * (STEPS + SHORT_STEPS)  # no line of noise is among them
    there = here.with_velocity(np.ones(2))
    assert there.by_q(there.raw("M")) is not first


def test_the_rate_of_what_a_clock_drives_is_that_at_its_start():
    here = at(b=lambda t: np.array([np.sin(3.0 * t), np.exp(-2.0 * t)]))
    found = clock_rate(here)
    assert (np.abs(found.value - [3.0, -2.0]) <= C * found.error).all()
    assert found.error.max() < 1e-11
    moving = at(b=lambda q, t: np.array([q[0] * q[1] * (1.0 + 2.0 * t)]))
    np.testing.assert_allclose(
        clock_rate(moving).value, [2.0 * 0.21 + 0.5 * 0.7 - 0.8 * 0.3], rtol=1e-10
    )


def test_a_clock_is_asked_within_an_eighth_of_a_second():
    asked: list[float] = []
    clock_rate(at(b=lambda t: asked.append(t) or np.array([t])))
    assert (max(asked), min(asked)) == (0.125, -0.125)


def test_a_bias_follows_from_what_is_closest():
    q, v = np.array([0.3, 0.7, -0.4]), np.array([0.5, -0.8, 0.9])
    right = CART.bias(q, v)
    given = {"M": CART.M, "T": CART.T}
    for own in (given, {"M": CART.M}, {"T": CART.T}):
        found = supplied_or_derived_bias(at(q, v, **own))
        assert found is not None
        np.testing.assert_allclose(found.value, right, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(inertia(at(q, v, **own)).value, CART.M(q), atol=1e-12)
    C_ = {"C": lambda q, v: np.outer(CART.bias(q, v), v) / (v @ v)}
    found = supplied_or_derived_bias(
        at(q, v, **given, **C_, bias=lambda q, v: 2.0 * CART.bias(q, v))
    )
    assert found is not None and found.value.tolist() == (2.0 * right).tolist()
    unknown = at(q, v, M=CART.M, holonomic=False)
    assert supplied_or_derived_bias(unknown) is None
    assert why_no_bias(unknown).startswith("constraints may be built into M")
    speeds = EquationsOfMotion(
        3, T=lambda q, u: u @ u, qdot=lambda q, u: u[[0, 1, 0]], speeds=2, holonomic=True
    )
    fewer = FunctionState(FunctionCaller(speeds), q, v[:2])
    assert supplied_or_derived_bias(fewer) is None
    assert why_no_bias(fewer).startswith("M or T determines B only for as many speeds")


def test_the_bias_of_a_mass_matrix_in_speeds_is_lagranges():
    """A mass at (x, y) with u = (ẋ, ẏ) scaled by what depends on x: M = S², and B = S Ṡ u."""
    m = 2.0
    functions = EquationsOfMotion(
        2,
        M=lambda q: m * np.diag([(1.0 + q[0] ** 2) ** 2, 1.0]),
        qdot=lambda q, u: np.array([(1.0 + q[0] ** 2) * u[0], u[1]]),
        holonomic=True,
    )
    here = FunctionState(FunctionCaller(functions), np.array([0.5, 0.2]), np.array([0.7, -0.4]))
    found = supplied_or_derived_bias(here)
    assert found is not None
    S = 1.25
    expected = m * S * (2.0 * 0.5 * S * 0.7) * 0.7
    np.testing.assert_allclose(found.value, [expected, 0.0], rtol=1e-9, atol=1e-10)


# ---- Answers -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "answer", "shape"),
    [
        ("gravity", [[1.0], [2.0]], (2,)),
        ("U", [[3.0]], ()),
        ("U", [3.0], ()),
        ("a", [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], (3, 2)),
        ("gamma", [[1.0], [2.0], [3.0]], (3,)),
        ("gravity", [[1.0, 2.0]], None),
        ("M", [[1.0, 2.0]], None),
        ("U", [1.0, 2.0], None),
        ("gamma", [1.0, 2.0], None),
        ("a", [1.0, 2.0], None),
    ],
)
def test_columns_and_numbers_in_arrays_are_read_and_nothing_else(
    name: str, answer: Any, shape: Any
):
    own = {"a": lambda q: np.zeros((3, 2)), "gamma": lambda q, v: np.zeros(3), "U": lambda q: 0.0}
    own[name] = lambda q, *v: np.array(answer)
    answers = FunctionCaller(EquationsOfMotion(2, **own))
    q = v = np.array([0.1, 0.2])
    if name == "gamma":
        answers("a", q, v)
    if shape is not None:
        found = answers(name, q, v)
        assert found.shape == shape
        assert found.ravel().tolist() == np.ravel(answer).tolist()
        return
    with pytest.raises(BrokenError, match="answers an array of shape"):
        answers(name, q, v)


@pytest.mark.parametrize(
    ("type_", "told"),
    [(np.float16, "float16"), (np.float32, "float32"), (np.float64, ""), (np.int32, "")],
)
def test_types_of_less_than_doubles_are_kept_by_name(type_: Any, told: str):
    answers = FunctionCaller(
        EquationsOfMotion(1, M=lambda q: np.ones((1, 1), type_), U=lambda q: 1.0)
    )
    answers("M", np.ones(1), np.ones(1))
    answers("U", np.ones(1), np.ones(1))
    assert answers.single_precision == ({"M": told} if told else {})


def test_the_first_entry_that_is_not_finite_is_named():
    answers = FunctionCaller(
        EquationsOfMotion(2, M=lambda q: np.array([[1.0, 2.0], [np.inf, np.nan]]))
    )
    with pytest.raises(BrokenError, match=r"M\[1, 0\] = inf, expected a finite number"):
        answers("M", np.ones(2), np.ones(2))


# ---- Arguments -----------------------------------------------------------------------------------


def test_ranges_have_a_middle_and_a_half_width_each():
    own = {"M": lambda q: np.eye(2), "qdot": lambda q, u: q, "speeds": 1}
    for ranges, middle, half in [
        (None, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        ((2.0, 5.0), [3.5, 3.5, 3.5], [1.5, 1.5, 1.5]),
        ([(2, 3), (5, 9)], [2.5, 7.0, 0.0], [0.5, 2.0, 1.0]),
        ([(2, 3), (5, 9), (-4, -2)], [2.5, 7.0, -3.0], [0.5, 2.0, 1.0]),
    ]:
        found = EquationsOfMotion(2, **own, ranges=ranges).half_ranges()
        assert [x.tolist() for x in found] == [middle, half]
    for wrong in ([(0, 1)], [(0, 1)] * 4, [0, 1, 2]):
        with pytest.raises(InputError, match="or 2 such pairs for the coordinates, or 3 with"):
            EquationsOfMotion(2, **own, ranges=wrong)


def test_rows_are_named_by_speeds_where_these_are_not_rates():
    rates = EquationsOfMotion(2, M=len)
    assert (rates.p, rates.velocity_names, rates.of_lagrange) == (2, ("q[0]", "q[1]"), True)
    speeds = EquationsOfMotion(2, M=len, qdot=len, speeds=3)
    assert (speeds.p, speeds.velocity_names) == (3, ("u[0]", "u[1]", "u[2]"))
    assert (speeds.coordinate_names, speeds.of_lagrange) == (("q[0]", "q[1]"), False)
    assert EquationsOfMotion(2, M=len, qdot=len, holonomic=True).of_lagrange
    assert not EquationsOfMotion(2, M=len, holonomic=False).of_lagrange


@pytest.mark.parametrize(
    ("given", "told_by", "text"),
    [
        ("", ("T", "qdd & M|T", "against"), "T, qdd with M or T or against"),
        ("qdd", ("qdd & M|T", "against"), "M or T or against"),
        ("qdd M", ("qdd & M|T", "against"), ""),
        ("", ("against",), "against"),
        ("U", ("bias|C", "T"), "bias|C or T"),
        ("C", ("bias|C", "T"), ""),
    ],
)
def test_what_would_tell_is_what_is_missing(given: str, told_by: tuple[str, ...], text: str):
    own = dict.fromkeys((given or "R").split(), len)
    here = FunctionState(FunctionCaller(EquationsOfMotion(1, **own)), np.zeros(1), np.zeros(1))
    assert (
        BlindSpot("bias", "x", told_by).revealing_inputs(here).replace("bias or C", "bias|C")
        == text
    )


# ---- Results -------------------------------------------------------------------------------------


def finding(verdict: Verdict, detail: str = "", claim: str = "bias-even") -> Finding:
    return Finding(claim, "bias", EquationsOfMotion(1, M=len), None, 0.0, 1.0, verdict, "", detail)


@pytest.mark.parametrize(
    ("verdicts", "came"),
    [
        ("passed inconclusive", "passed"),
        ("inconclusive passed", "passed"),
        ("skipped inconclusive", "inconclusive"),
        ("skipped skipped", "skipped"),
        ("skipped passed", "passed"),
    ],
)
def test_a_claim_came_to_the_first_of_its_verdicts(verdicts: str, came: str):
    found = result_or_failure([finding(x, f"{k}") for k, x in enumerate(verdicts.split())])
    assert not isinstance(found, Finding)
    assert found.verdict == came
    if came == "skipped":
        assert found.text == "bias: 0"


def test_the_first_failure_of_a_claim_is_shown():
    each = [finding(x, y) for x, y in (("passed", "a"), ("failed", "b"), ("failed", "c"))]
    found = result_or_failure(each)
    assert isinstance(found, Finding) and found.detail == "b"


def test_what_is_hidden_takes_a_pass_away_and_nothing_else():
    results = {x: result_or_failure([finding(x, claim=x)]) for x in ("passed", "inconclusive")}
    results |= {"other": result_or_failure([finding("passed")])}
    listed = [finding("inconclusive", "not resolved in this state: row", x) for x in results]
    found = without_unresolved(results, listed[:2])  # type: ignore[arg-type]
    assert [x.verdict for x in found.values()] == ["inconclusive", "inconclusive", "passed"]
    assert "not resolved in this state: row" in found["passed"].text
    assert found["inconclusive"] is results["inconclusive"]


def test_why_a_claim_does_not_apply_names_what_is_missing_and_what_is_too_much():
    trial = EquationsTarget(EquationsOfMotion(1, R=len, b=len, qdd=len, name="own"))
    assert trial.absent("motion") == "motion does not apply to own, without M or T"
    assert trial.absent("bias-power") == "bias-power does not apply to own, without M or T and bias"
    assert trial.absent("dissipation-positive") == (
        "dissipation-positive does not apply to own, with b"
    )
    assert trial.absent("acceleration-even").endswith(" to own, with R and b")
    assert trial.absent("power-balance").endswith(" to own, without T or M, with b")


def test_a_file_of_expected_failures_is_read_line_by_line(tmp_path):
    path = tmp_path / "known.txt"
    path.write_text("# head\n\n  bias-x   the sign,  twice  \n   # note\nmass-y\tlater\n")
    assert read_expected_failures(path) == {"bias-x": "the sign,  twice", "mass-y": "later"}
    path.write_text("# head\n\nbias-x one\nbias-y\n")
    with pytest.raises(InputError, match="line 4: 'bias-y' has no reason"):
        read_expected_failures(path)
    path.write_text("bias-x one\n\n# note\nbias-x two\n")
    with pytest.raises(InputError, match="line 4: 'bias-x' is there twice"):
        read_expected_failures(path)


# ---- Scenes as functions -------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["chain-pendulum", "snake", "sleigh", "rolling-disk"])
def test_a_scene_as_functions_satisfies_its_equations(key: str):
    """M q̈ + B + g + ∂R/∂v = Q + aᵀλ in the directions that constraints leave."""
    scene = SCENES[key].example()
    own = from_scene(scene)
    v = 0.5 - 0.3 * np.arange(scene.n)
    here = FunctionState(FunctionCaller(own), scene.initial_state()[0], v).consistent()
    assert here is not None
    B = supplied_or_derived_bias(here)
    assert B is not None
    left = inertia(here) @ here.quantity("qdd") + B - here.forces()
    found = exact(here.free().T) @ left
    assert (np.abs(found.value) <= C * found.error).all()
    assert own.name == scene.name


def test_errors_of_an_argument_are_in_the_result():
    A, ones = np.array([[2.0, -1.0], [0.0, 3.0]]), np.ones(2)
    x = UncertainArray(np.array([1.0, 2.0]), np.array([1e-3, 0.0]), ones)
    y = propagated(lambda z: UncertainArray(A @ z, np.array([1e-6, 1e-6]), ones), x)
    np.testing.assert_allclose(y.error, [2e-3 + 1e-6, 1e-6])
    assert np.array_equal(y.value, [0.0, 6.0])
