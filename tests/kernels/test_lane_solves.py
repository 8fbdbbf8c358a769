"""Solves in lanes: refused, recorded and refined in every lane as the matrix is alone."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from tests.numbers.test_banded import factors_above_the_matrix, inside

import eomcheck.kernels.perturbed_solves  # noqa: F401  (registers the solver of moved matrices)
from eomcheck.errors import RefusedError
from eomcheck.kernels.batched_solves import solve_banded_batch
from eomcheck.numbers.banded_solve import LEAST_STEPS, TERMS, WIDTH, solve_banded, to_dense
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch, as_object_array
from eomcheck.numbers.generic import EPS
from eomcheck.numbers.linear import SolveRecord, recording_solves, singular_below, solve
from eomcheck.numbers.noise import STEP, Noise

SIZE = 4


def alone(function, A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, SolveRecord, bool]:
    """Return the solution (NaN where refused), what is recorded, and whether it is refused."""
    found = np.full(b.shape, np.nan)
    with recording_solves() as watch, suppress(RefusedError):
        found = function(A, b, "A")
    return found, watch.solves[0], bool(np.isnan(found).all())


def together(function, A: list, b: list, **how) -> tuple[np.ndarray, SolveRecord, Any]:
    """Return the solutions, what is recorded, and which are refused, None of moved ones."""
    lanes = [BatchArray(np.stack(x)) for x in (A, b)]
    with recording_solves(**how) as watch:
        found = function(*lanes, "A")
    (recorded,) = watch.solves
    return found.data, recorded, watch.refused[0] if watch.refused else None


def matrices() -> list[np.ndarray]:
    """Return matrices well and badly scaled, nearly singular on either side, singular, infinite."""
    random = np.random.default_rng(5)
    A = random.uniform(-1.0, 1.0, (7, SIZE, SIZE))
    A[0] += 3.0 * np.eye(SIZE)[[1, 2, 0, 3]]  # rows are exchanged
    A[1] *= 10.0 ** random.uniform(-6, 6, (SIZE, 1)) * 10.0 ** random.uniform(-6, 6, SIZE)
    for i, apart in ((2, 60), (3, 25)):  # rcond of 5 and 2.4 eps
        A[i, 3] = A[i, :3].sum(axis=0)
        A[i, 3, 0] += apart * EPS
    A[4, 2] = A[4, 1]
    A[5, 1, 2] = np.inf
    return list(A)


@pytest.mark.parametrize("columns", [(), (3,)])
def test_each_lane_is_solved_recorded_and_refused_as_alone(columns: tuple):
    A = matrices()
    b = list(np.random.default_rng(6).uniform(-1.0, 1.0, (len(A), SIZE, *columns)))
    found, told, refused = together(solve, A, b)
    assert (told.name, told.size, told.refinements) == ("A", SIZE, 0)
    assert refused.tolist() == [False, False, False, True, True, True, False]
    for i in range(len(A)):
        x, one, is_refused = alone(solve, A[i], b[i])
        assert refused[i] == is_refused
        assert found[i] == pytest.approx(x, rel=1e-12, nan_ok=True)
        assert told.rcond[i] == pytest.approx(one.rcond, rel=1e-6, abs=1e-30)
        assert told.rcond[i] > singular_below(SIZE) or is_refused
        if np.isfinite(A[i]).all() and one.rcond > 0:
            assert told.sign[i] == one.sign
            assert told.log_determinant[i] == pytest.approx(one.log_determinant)
            assert told.pivots is not None and one.pivots is not None
            assert told.pivots[i].tolist() == one.pivots.tolist()


def test_lanes_of_which_no_condition_is_wanted_are_solved_whatever_it_is():
    A = matrices()
    found, told, refused = together(solve, A, [np.ones(SIZE)] * len(A), conditions=False)
    assert not refused.any() and (told.rcond == 1.0).all()
    assert np.isfinite(found[[0, 1, 2, 3, 6]]).all()


def test_moved_lanes_are_near_those_that_are_not():
    A = matrices()
    b = [np.ones(SIZE)] * len(A)
    exact, told, _ = together(solve, A, b)
    for like in (None, {"A": told}):
        found, moved, refused = together(
            solve, A, b, noise=NoiseBatch([Noise(3)], states=7), references=like
        )
        assert refused is None and np.isnan(found[5]).all()
        change = np.abs(found - exact).max(axis=1) / np.abs(exact).max(axis=1)
        for i in (0, 1):
            assert STEP / 4 < change[i] < 10 * STEP / told.rcond[i]
            assert moved.sign[i] == told.sign[i]
            assert 0 < abs(moved.log_determinant[i] - told.log_determinant[i]) < 1e-9


def test_a_matrix_made_of_entries_of_lanes_is_moved_as_one_of_whole_arrays():
    A, b = matrices()[:2], [np.ones(SIZE)] * 2
    whole = together(solve, A, b, noise=NoiseBatch([Noise(3)], states=2))[0]
    entries = as_object_array(BatchArray(np.stack(A)))
    with recording_solves(NoiseBatch([Noise(3)], states=2)):
        found = solve(entries, as_object_array(BatchArray(np.stack(b))), "A")
    assert np.array_equal(found.data, whole) and (whole != together(solve, A, b)[0]).all()


def bands() -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return bands: common, far apart, that refinement does not solve, singular, not finite."""
    stalled, right = factors_above_the_matrix()
    size = len(right)
    random = np.random.default_rng(7)
    A = np.where(inside(size), random.uniform(-1.0, 1.0, (7, size, WIDTH)), 0.0)
    b = random.uniform(-1.0, 1.0, (7, size))
    random = np.random.default_rng(20)  # of 400 the one that needs more than one step
    A[1] = np.where(inside(size), random.uniform(-1.0, 1.0, A[1].shape), 0.0)
    A[1] *= 10.0 ** random.uniform(-10, 10, A[1].shape)
    b[1] = random.uniform(-1.0, 1.0, size)
    A[2], b[2] = stalled, right
    A[3, 5] = 0.0
    A[4, 5, 2] = np.nan
    b[5] = 0.0
    A[6] *= 1e-9 ** np.arange(size)[:, None]
    return list(A), list(b)


def test_each_band_is_refined_recorded_and_refused_as_alone():
    A, b = bands()
    found, told, refused = together(solve_banded_batch, A, b)
    assert refused.tolist() == [False, False, True, True, True, False, False]
    assert told.rcond[2] > singular_below(TERMS)
    steps = told.refinements.tolist()
    assert steps[0] == LEAST_STEPS < steps[1]
    for i in range(len(A)):
        x, one, is_refused = alone(solve_banded, A[i], b[i])
        assert refused[i] == is_refused
        assert np.array_equal(found[i], x, equal_nan=True)
        assert told.rcond[i] == pytest.approx(one.rcond, rel=1e-6)
        if one.rcond > 0:
            assert steps[i] == one.refinements
            assert told.sign[i] == one.sign
            assert told.log_determinant[i] == pytest.approx(one.log_determinant)


def test_moved_bands_have_no_solution_where_refinement_stalls():
    A, b = bands()
    exact, told, _ = together(solve_banded_batch, A, b)
    found, moved, refused = together(
        solve_banded_batch, A, b, noise=NoiseBatch([Noise(3)], states=7)
    )
    assert refused is None
    # A row of zeros is moved by subnormal numbers, of which scaling makes no row of size 1.
    assert np.isnan(found).all(axis=1).tolist() == [i in (2, 3, 4) for i in range(7)]
    for i in range(7):
        with recording_solves(Noise(3)):
            alone_moved = np.asarray(solve_banded(A[i], b[i], "A"))
        assert np.array_equal(found[i], alone_moved, equal_nan=True)
    change = np.abs(found[0] - exact[0]).max() / np.abs(exact[0]).max()
    assert STEP / 4 < change < 10 * STEP / told.rcond[0]
    assert (moved.sign[:2] == told.sign[:2]).all()


class Told(NoiseBatch):
    """Noise of two states of which only one change, the `place`-th that is taken, is not 0."""

    def __init__(self, place: int, size: float = 1e-6):
        super().__init__([Noise(0)], states=2)
        self.place, self.size = place, size

    def draws(self, count: int) -> np.ndarray:
        found = np.zeros((1, count))
        if 0 <= self.place < count:
            found[0, self.place] = self.size
        self.place -= count
        return found


def moved_by(function, A: list, b: list, place: int) -> np.ndarray:
    """Return how far solutions are moved by one change, per its size, lanes in front."""
    still, moved = (together(function, A, b, noise=Told(x))[0] for x in (-1, place))
    return (moved - still) / 1e-6


def test_each_change_of_lanes_is_taken_once_for_matrices_sides_what_rounds_and_solutions():
    random = np.random.default_rng(3)
    A = list(random.uniform(1.0, 2.0, (2, 3, 3)) + 3.0 * np.eye(3)[[2, 0, 1]])
    b = list(random.uniform(1.0, 2.0, (2, 3, 2)))
    near = {"rtol": 1e-4, "atol": 1e-9}
    x, inverse = np.linalg.solve(A, b), np.linalg.inv(A)
    for place, (i, j) in enumerate(np.ndindex(3, 3)):
        for lane, found in enumerate(moved_by(solve, A, b, place)):
            of_entry = -np.outer(inverse[lane][:, i], abs(A[lane][i, j]) * x[lane][j])
            np.testing.assert_allclose(found, of_entry, **near)
    for place, (i, j) in enumerate(np.ndindex(3, 2)):
        of_side, rounded, of_solution = (moved_by(solve, A, b, 9 + 6 * k + place) for k in range(3))
        for lane in range(2):
            expected = np.zeros((3, 2))
            expected[:, j] = inverse[lane][:, i] * abs(b[lane][i, j])
            np.testing.assert_allclose(of_side[lane], expected, **near)
            # |L||U||x| of a row is at least |A||x| of it, and no more than a few times that.
            row = A[lane] @ rounded[lane]
            sizes = abs(A[lane]) @ abs(x[lane])
            assert np.abs(np.delete(row, i, axis=0)).max() < 1e-4
            assert np.abs(row[i, 1 - j]) < 1e-4
            assert 0.999 * sizes[i, j] < row[i, j] < 9 * sizes[i, j]
            expected = np.zeros((3, 2))
            expected[i, j] = abs(x[lane][i, j])
            np.testing.assert_allclose(of_solution[lane], expected, **near)


def test_lanes_are_moved_by_the_rounding_of_the_matrix_as_it_is_where_that_has_more():
    A, b = [np.array([[1.0, 1.0], [1.0, 1.0 + 1e-8]])] * 2, [np.array([1.0, 1.0])] * 2
    _, told, _ = together(solve, A, b)
    for factor in (0.1, 1.0, 100.0):
        lu = told.rounding.sizes.lu * factor
        larger = told.rounding._replace(sizes=type(told.rounding.sizes)(lu, told.pivots))
        like = {"A": told._replace(rounding=larger)}
        still = together(solve, A, b, noise=Told(-1, 1e-9), references=like)[0]
        moved = together(solve, A, b, noise=Told(6, 1e-9), references=like)[0]
        row = A[0] @ (moved[0] - still[0]) / 1e-9
        # |L||U||x| = 1 for x = (1, 0), each factor by itself; |L| keeps its ones.
        assert row[0] == pytest.approx(max(factor, 1.0), rel=1e-2)


def test_each_change_of_bands_is_taken_once_for_bands_sides_residuals_and_solutions():
    size = 6
    random = np.random.default_rng(4)
    bands = [np.where(inside(size), random.uniform(1.0, 2.0, (size, WIDTH)), 0.0) for _ in range(2)]
    for one in bands:
        one[:, WIDTH // 2] += 9.0
    b = list(random.uniform(1.0, 2.0, (2, size)))
    A = [to_dense(one) for one in bands]
    x, inverse = np.linalg.solve(A, np.array(b)[..., None])[..., 0], np.linalg.inv(A)
    near = {"rtol": 1e-4, "atol": 1e-8}
    for place, (i, k) in enumerate(np.ndindex(size, WIDTH)):
        j = i + k - WIDTH // 2
        for lane, found in enumerate(moved_by(solve_banded_batch, bands, b, place)):
            of_entry = (
                -inverse[lane][:, i] * bands[lane][i, k] * x[lane][j] if 0 <= j < size else 0 * x[0]
            )
            np.testing.assert_allclose(found, of_entry, **near)
    for i in range(size):
        of_side, residual, of_solution = (
            moved_by(solve_banded_batch, bands, b, size * WIDTH + size * k + i) for k in range(3)
        )
        for lane in range(2):
            sizes = abs(A[lane]) @ abs(x[lane]) + abs(b[lane])
            np.testing.assert_allclose(of_side[lane], inverse[lane][:, i] * b[lane][i], **near)
            np.testing.assert_allclose(residual[lane], inverse[lane][:, i] * sizes[i], **near)
            np.testing.assert_allclose(of_solution[lane], np.eye(size)[i] * abs(x[lane]), **near)
