"""Lanes: each computes what it computes alone, exactly or perturbed."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck.numbers.batch_arrays import (
    BATCH_ARITHMETIC,
    BatchArray,
    NoiseBatch,
    as_float64,
    as_object_array,
    batch_data,
    batch_size,
    choose,
    everywhere,
)
from eomcheck.numbers.generic import EPS, Angles
from eomcheck.numbers.linear import least_squares, null_space, singular_values
from eomcheck.numbers.noise import STEP, Noise

RANDOM = np.random.default_rng(0)
X, Y = RANDOM.uniform(1.0, 2.0, (5, 3, 2)), RANDOM.uniform(3.0, 5.0, (5, 3, 2))
"""Two matrices (3, 2) in five lanes."""
SQUARE = RANDOM.uniform(-1.0, 1.0, (5, 3, 3)) + 4.0 * np.eye(3)


def lane(x, i: int) -> np.ndarray:
    """Return what lane i holds."""
    return x.data[i]


def noise_of_all() -> NoiseBatch:
    """Return one noise of five states."""
    return NoiseBatch([Noise(3)], states=5)


OPERATIONS = {
    "sum": lambda x, y: x + y,
    "sum with a number": lambda x, y: 2.5 + x,
    "difference": lambda x, y: x - y,
    "difference from a number": lambda x, y: 2.5 - x,
    "product": lambda x, y: x * y,
    "product with an array": lambda x, y: np.arange(1.0, 7.0).reshape(3, 2) * x,
    "quotient": lambda x, y: x / y,
    "quotient of a number": lambda x, y: 2.5 / x,
    "quotient by an array": lambda x, y: x / np.arange(1.0, 7.0).reshape(3, 2),
    "product of matrices": lambda x, y: x.T @ y,
    "product with a vector": lambda x, y: x @ y[0],
    "product of vectors": lambda x, y: x[1] @ y[0],
    "product from the left": lambda x, y: np.ones((4, 3)) @ x,
}


@pytest.mark.parametrize("operation", OPERATIONS)
def test_each_lane_is_computed_as_it_is_alone(operation: str):
    function = OPERATIONS[operation]
    found = function(BatchArray(X.copy()), BatchArray(Y.copy()))
    for i in range(5):
        alone = function(X[i], Y[i])
        assert np.allclose(lane(found, i), alone, rtol=1e-15, atol=0.0)


@pytest.mark.parametrize("operation", OPERATIONS)
def test_the_result_of_each_operation_on_arrays_is_perturbed_alike_in_all_lanes(operation: str):
    function, noise = OPERATIONS[operation], noise_of_all()
    x, y = noise.as_perturbed(BatchArray(X.copy())), noise.as_perturbed(BatchArray(Y.copy()))
    exact = function(BatchArray(X.copy()), BatchArray(Y.copy())).data
    change = (function(x, y).data - exact) / exact
    assert (np.abs(change) >= 0.49 * STEP).all() and (np.abs(change) <= 1.01 * STEP).all()
    assert np.ptp(change, axis=0).max() <= 4 * EPS


@pytest.mark.parametrize("operation", ["sum", "difference", "product", "quotient"])
def test_one_perturbed_side_is_enough_for_a_result_to_be_perturbed(operation: str):
    function, noise = OPERATIONS[operation], noise_of_all()
    x, y = BatchArray(X.copy()), BatchArray(Y.copy())
    exact = function(x, y).data
    for found in (function(x, noise.as_perturbed(y)), function(noise.as_perturbed(x), y)):
        assert (found.data != exact).all() and found.noise is noise


def test_angles_in_lanes_have_their_cosines_and_sines_and_both_are_perturbed():
    exact = BATCH_ARITHMETIC.angles(BatchArray(X[:, :, 0].copy()))
    assert np.array_equal(exact.value.data, X[:, :, 0])
    assert np.array_equal(exact.cos.data, np.cos(X[:, :, 0]))
    assert np.array_equal(exact.sin.data, np.sin(X[:, :, 0]))
    found = noise_of_all().perturb_record(exact)
    assert isinstance(found, Angles) and np.array_equal(found.value.data, X[:, :, 0])
    for part, of in ((found.cos, exact.cos), (found.sin, exact.sin)):
        change = np.abs(part.data / of.data - 1.0)
        assert (change >= 0.49 * STEP).all() and (change <= 1.01 * STEP).all()
    assert np.array_equal(BATCH_ARITHMETIC.root(BatchArray(X.copy())).data, np.sqrt(X))


def test_a_record_in_lanes_is_perturbed_in_each_of_its_parts_and_what_is_absent_stays():
    x, (y, none) = noise_of_all().perturb_record(
        (BatchArray(X.copy()), (BatchArray(Y.copy()), None))
    )
    assert (x.data != X).all() and (y.data != Y).all() and none is None
    assert x.noise is y.noise is not None


def test_a_condition_in_lanes_holds_everywhere_only_where_all_entries_hold_it():
    x = BatchArray(np.array([[1.0, 1.0], [1.0, 3.0], [3.0, 3.0]]))
    assert everywhere(x <= 2.0).data.tolist() == [True, False, False]
    assert everywhere(x > 2.0).data.tolist() == [False, False, True]
    assert everywhere(np.array([True, True])) is True
    assert everywhere(np.array([True, False])) is False


def test_a_choice_in_lanes_is_made_lane_by_lane():
    x, y = BatchArray(np.array([1.0, 2.0, 3.0])), BatchArray(np.array([-1.0, -2.0, -3.0]))
    assert choose(x <= 2.0, x, y).data.tolist() == [1.0, 2.0, -3.0]
    assert choose(x <= 2.0, 7.0, y).data.tolist() == [7.0, 7.0, -3.0]
    assert choose(True, 1.0, 2.0) == 1.0 and choose(False, 1.0, 2.0) == 2.0


def test_sums_and_largest_entries_are_those_along_the_axis_that_the_source_knows():
    x = BatchArray(X.copy())
    for axis in (None, 0, 1, -1):
        for i in range(5):
            assert np.allclose(lane(x.sum(axis), i), X[i].sum(axis), rtol=1e-15)
            assert np.array_equal(lane(x.max(axis), i), X[i].max(axis))
    both = np.concatenate((x, BatchArray(Y.copy())), axis=-1)
    assert np.array_equal(both.data, np.concatenate((X, Y), axis=-1))
    assert np.array_equal(np.concatenate((x, np.ones((1, 2)))).data[:, 3], np.ones((5, 2)))
    assert x.reshape(-1, 3).shape == (2, 3) and x.reshape((6,)).shape == (6,)
    assert (len(x), x.size, x.count, x.ndim, x.T.shape) == (3, 6, 5, 2, (2, 3))


def test_lanes_and_their_entries_hold_the_same_numbers():
    x = BatchArray(X.copy())
    single = as_object_array(x)
    assert single.shape == (3, 2) and np.array_equal(single[2, 1].data, X[:, 2, 1])
    assert np.array_equal(as_float64(single).data, X)
    assert batch_size(single) == batch_size([1.0, (2.0, x)]) == 5 and batch_size(np.ones(2)) == 0
    assert np.array_equal(batch_data([1.0, x[0, 0]], 5), np.stack((np.ones(5), X[:, 0, 0]), axis=1))


@pytest.mark.parametrize("write", ["entry", "row", "all"])
def test_a_matrix_that_is_written_to_is_decomposed_anew(write: str):
    places = {"entry": (0, 1), "row": 1, "all": (slice(None), slice(None))}
    a = BatchArray(SQUARE[:, :2].copy())
    turned = a.T
    before = singular_values(a).data, least_squares(a, np.ones(2)).data
    least_squares(turned, np.ones(3))
    a[places[write]] = 7.0
    for i in range(5):
        plain = lane(a, i)
        assert np.allclose(lane(singular_values(a), i), np.linalg.svd(plain)[1])
        expected = np.linalg.lstsq(plain, np.ones(2), rcond=None)[0]
        if write != "all":  # of rank 1 the sides do not belong together
            assert np.allclose(lane(least_squares(a, np.ones(2)), i), expected)
            back = np.linalg.lstsq(plain.T, np.ones(3), rcond=None)[0]
            assert np.allclose(lane(least_squares(turned, np.ones(3)), i), back)
            basis = lane(null_space(a), i)
            assert np.abs(plain @ basis).max() < 1e-14 * np.abs(plain).max()
    assert not np.allclose(before[0], singular_values(a).data)


def test_a_turned_matrix_is_decomposed_as_such_whichever_is_first():
    a = BatchArray(X.copy())
    found = least_squares(a.T, np.ones(2))
    for i in range(5):
        expected = np.linalg.lstsq(X[i].T, np.ones(2), rcond=None)[0]
        assert np.allclose(lane(found, i), expected)


def test_singular_values_of_rounding_count_as_zero():
    row = RANDOM.uniform(1.0, 2.0, (5, 3))
    a = np.stack((row, 3.0 * row), axis=1)
    a[:, 1, 0] = np.nextafter(a[:, 1, 0], np.inf)
    assert (np.linalg.svd(a, compute_uv=False)[:, 1] > 0).all()
    b = np.array([1.0, 2.0])
    solutions = least_squares(BatchArray(a), b)
    for i in range(5):
        expected = row[i] / (row[i] @ row[i]) * (b @ [1.0, 3.0]) / 10.0
        assert np.allclose(lane(solutions, i), expected, rtol=1e-12)


@pytest.mark.parametrize(("a", "b"), [(np.inf, 1.0), (1.0, np.inf), (1.0, np.nan)])
def test_of_what_overflowed_there_are_no_least_squares(a: float, b: float, capfd):
    found = least_squares(np.full((2, 3), a), np.array([b, 1.0]))
    assert found.shape == (3,) and np.isnan(found).all()
    assert capfd.readouterr() == ("", "")
