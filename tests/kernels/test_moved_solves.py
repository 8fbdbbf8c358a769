"""Moved solves in machine code: what they solve, by which pivots, and what moves them how far."""

from __future__ import annotations

import numpy as np
import pytest

import eomcheck.kernels.perturbed_solves  # noqa: F401  (what it solves is registered there)
from eomcheck.errors import RefusedError
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch
from eomcheck.numbers.linear import SolveRecord, recording_solves, solve
from eomcheck.numbers.noise import STEP, Noise

SIZES = [1, 2, 3, 8, 9, 20, 70]
"""Below, at and above a whole number of vectors."""

sizes = pytest.mark.parametrize("size", SIZES)
columns = pytest.mark.parametrize("columns", [None, 0, 1, 3, 9])


def system(size: int, columns: int | None = None, seed: int = 0):
    random = np.random.default_rng((size, columns or 0, seed))
    A = random.uniform(-1, 1, (size, size)) * 10.0 ** random.uniform(-3, 3, (size, 1))
    return A, random.uniform(-1, 1, (size,) if columns is None else (size, columns))


CYCLE = np.array([[1.0, 2.0, 5.0], [2.0, 9.0, 1.0], [8.0, 1.0, 2.0]])
"""Its rows are exchanged where it is eliminated."""


def as_it_is(A, b) -> dict[str, SolveRecord]:
    """Return how a matrix is solved that is not moved."""
    with recording_solves() as watch:
        solve(A, b, "A")
    return {"A": watch.solves[0]}


def moved(noise: Noise, A, b, like=None) -> tuple[np.ndarray, list[SolveRecord]]:
    batched = isinstance(noise, NoiseBatch)
    A, b = (BatchArray(x) if batched else x for x in (A, b))
    with recording_solves(noise, like) as watch, noise.stream("it"):
        x = solve(A, b, "A")
    return x.data if batched else np.asarray(x), watch.solves


def copies(*arrays) -> list[np.ndarray]:
    return [np.stack(3 * [x]) for x in arrays]


def noises() -> NoiseBatch:
    return NoiseBatch([Noise(0), Noise(1), Noise(0, 8 * STEP)])


@sizes
@columns
def test_a_moved_solution_is_near_the_solution(size, columns):
    A, b = system(size, columns)
    like = as_it_is(A, b)
    expected = np.linalg.solve(A, b)
    limit = 100 * size * STEP * np.linalg.cond(A / np.abs(A).max(axis=1, keepdims=True))
    for given in (None, like):
        x, (found,) = moved(Noise(0), A, b, given)
        assert x.shape == b.shape
        assert np.abs(x - expected).max(initial=0.0) <= limit * np.abs(expected).max(initial=0.0)
        assert found.sign == like["A"].sign
        assert found.log_determinant == pytest.approx(like["A"].log_determinant, abs=1e-8)
        if b.size:
            assert (x != expected).any()


@sizes
@columns
def test_copies_side_by_side_have_the_bits_that_each_has_alone(size, columns):
    A, b = system(size, columns)
    like = as_it_is(A, b)
    x, (found,) = moved(noises(), *copies(A, b), like)
    for i, noise in enumerate((Noise(0), Noise(1), Noise(0, 8 * STEP))):
        alone, (own,) = moved(noise, A, b, like)
        assert np.array_equal(x[i], alone)
        assert found.sign[i] == own.sign
        assert found.log_determinant[i] == own.log_determinant


@pytest.mark.parametrize("size", SIZES[1:])
def test_a_moved_matrix_takes_the_pivots_that_it_is_given(size):
    """By the first entry of its last two rows nothing would be left of the solution."""
    A = np.eye(size)
    A[-2:, -2:] = [[1e-30, 1.0], [1.0, 1.0]]
    b = A @ np.ones(size)
    like = as_it_is(np.eye(size), b)
    assert (like["A"].pivots == np.arange(size)).all()
    chosen, _ = moved(Noise(0), A, b)
    given, _ = moved(Noise(0), A, b, like)
    assert np.abs(chosen - 1).max() < 100 * STEP
    assert np.abs(given - 1).max() > 0.1


def test_rows_are_exchanged_as_told_one_after_the_other():
    """A third row that comes first is exchanged once more, for the second."""
    A, like = CYCLE, as_it_is(CYCLE, np.ones(3))
    assert like["A"].pivots.tolist() == [2, 1, 2]
    other = as_it_is(A[[1, 2, 0]], np.ones(3))
    for given, rows in ((like, [0, 1, 2]), (other, [1, 2, 0])):
        x, (found,) = moved(Noise(0), A[rows], np.ones(3), given)
        assert np.abs(x - np.linalg.solve(A[rows], np.ones(3))).max() < 100 * STEP
        assert found.sign == given["A"].sign == np.sign(np.linalg.det(A[rows]))


def test_a_matrix_that_is_not_like_the_one_of_its_name_chooses_its_own_pivots():
    A, b = system(9)
    x, _ = moved(Noise(0), A, b)
    smaller, unknown = as_it_is(A[:3, :3], b[:3])["A"], as_it_is(A, b)["A"]._replace(pivots=None)
    for other in (smaller, unknown):
        assert np.array_equal(moved(Noise(0), A, b, {"A": other})[0], x)


def test_zeros_that_were_moved_are_no_part_of_a_moved_matrix():
    """By pivots that are such zeros nothing can be eliminated; a small entry is one."""
    like = as_it_is(np.eye(2), np.ones(2))
    for entry, is_singular in ((0.0, True), (1e-100, False)):
        A = np.array([[entry, 1.0], [1.0, 0.0]])
        x, (found,) = moved(Noise(0), A, np.ones(2), like)
        assert np.isnan(x).all() == is_singular
        assert (found.sign == 0) == is_singular


def test_a_singular_copy_has_no_solution_and_the_others_have():
    A, b = copies(np.eye(3), np.ones(3))
    A[1] = A[1, ::-1]
    x, (found,) = moved(noises(), A, b, as_it_is(A[0], b[0]))
    assert np.isnan(x[1]).all()
    assert np.isfinite(x[[0, 2]]).all()
    assert (np.abs(found.sign) == 1).tolist() == [True, False, True]


def test_rows_of_very_different_size_cost_no_digits():
    A, b = system(9)
    x, _ = moved(Noise(0), A, b)
    units = 10.0 ** np.arange(-9, 9, 2)
    for scaled in ((A * units[:, None], b * units), (A * units, b)):
        other, _ = moved(Noise(0), *scaled)
        other = other * (units if scaled[1] is b else 1.0)
        assert np.abs(other - x).max() <= 1e5 * STEP * np.abs(x).max()


@columns
def test_what_is_not_moved_has_the_solution_of_doubles(columns):
    A, b = system(5, columns)
    noise = noises()
    with noise.disabled(), recording_solves(noise, as_it_is(A, b)) as watch:
        found = solve(*map(BatchArray, copies(A, b)), "A").data
    assert np.abs(found - np.linalg.solve(A, b)).max(initial=0.0) < 1e-12
    assert not watch.solves


def test_what_elimination_rounds_moves_each_solution_by_the_sizes_of_factors(monkeypatch):
    """|L||U||x| of the copy, or of the matrix as it is where that has more."""
    A, b = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-8]]), np.array([1.0, 1.0])
    changes = np.zeros(2 * 2 + 3 * 2)
    changes[6:8] = 1e-4, 0.0
    monkeypatch.setattr(Noise, "changes", lambda self, shape: changes.reshape(shape).copy())
    like = as_it_is(A, b)
    x, _ = moved(Noise(0), A, b, like)
    assert x - [1.0, 0.0] == pytest.approx(np.linalg.solve(A, [1e-4, 0.0]), rel=1e-6)
    lu = like["A"].rounding.sizes.lu.copy()
    lu[0, 0] *= 1000.0
    sizes = like["A"].rounding.sizes
    monkeypatch.setattr(sizes, "lu", lu)
    larger, _ = moved(Noise(0), A, b, like)
    assert larger - [1.0, 0.0] == pytest.approx(1000.0 * (x - [1.0, 0.0]), rel=1e-6)


def test_each_change_is_taken_once_for_the_matrix_its_sides_what_rounds_and_the_solution(
    monkeypatch,
):
    A, b = CYCLE, np.array([[1.0, -2.0], [0.5, 3.0], [2.0, 1.0]])
    seen = []
    for i in range(3 * 3 + 3 * 3 * 2):
        changes = np.zeros(3 * 3 + 3 * 3 * 2)
        changes[i] = 1e-6
        monkeypatch.setattr(Noise, "changes", lambda self, shape, x=changes: x.reshape(shape))
        seen.append(moved(Noise(0), A, b)[0])
    x = np.linalg.solve(A, b)
    for i, j in np.ndindex(3, 3):
        of_entry = -np.linalg.solve(A, np.outer(np.eye(3)[i], abs(A[i, j]) * x[j])) * 1e-6
        assert seen[3 * i + j] - x == pytest.approx(of_entry, rel=1e-4, abs=1e-12)
    for k, (i, j) in enumerate(np.ndindex(3, 2)):
        of_side = np.linalg.solve(A, np.outer(np.eye(3)[i], np.eye(2)[j] * abs(b[i, j]))) * 1e-6
        assert seen[9 + k] - x == pytest.approx(of_side, rel=1e-4, abs=1e-12)
        rounded = seen[15 + k] - x
        assert np.abs(rounded[:, 1 - j]).max() < 1e-12 < np.abs(rounded[:, j]).max()
        of_row = A @ rounded[:, j]
        assert np.abs(np.delete(of_row, i)).max() < 1e-4 * abs(of_row[i])
        of_solution = np.zeros((3, 2))
        of_solution[i, j] = 1e-6 * abs(x[i, j])
        assert seen[21 + k] - x == pytest.approx(of_solution, abs=1e-12)


def test_a_matrix_that_is_not_square_is_refused():
    with pytest.raises(RefusedError, match="not square"):
        moved(Noise(0), np.ones((2, 3)), np.ones(2))
