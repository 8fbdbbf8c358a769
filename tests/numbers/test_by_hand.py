"""Noise, factors and decompositions in several copies and lanes: each what it is alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import RefusedError
from eomcheck.evaluation import dynamics
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch
from eomcheck.numbers.linear import (
    SolveRecord,
    for_each_noise,
    least_squares,
    record,
    recording_solves,
    row_scale,
)
from eomcheck.numbers.noise import NORMAL, STEP, Noise

# ---- Noise ---------------------------------------------------------------------------------------


def test_after_noises_apart_all_go_on_behind_the_one_that_took_most():
    noises, alone = NoiseBatch([Noise(0), Noise(5), Noise(7)]), [Noise(0), Noise(5), Noise(7)]
    with noises.stream("x"):
        noises.changes((3, 4))
        with noises.split() as each:
            taken = [one.changes((count,)) for one, count in zip(each, (2, 6, 1), strict=True)]
        after = noises.changes((3, 3))
    for i, one in enumerate(alone):
        with one.stream("x"):
            expected = one.changes((13,))
        assert (taken[i] == expected[4 : 4 + len(taken[i])]).all()
        assert (after[i] == expected[10:]).all()


def test_noises_that_were_still_move_as_before():
    noises, others = (NoiseBatch([Noise(0), Noise(5)]) for _ in range(2))
    with noises.stream("x"), others.stream("x"):
        assert (noises.changes((2, 3)) == others.changes((2, 3))).all()
        with noises.disabled():
            assert not noises.enabled
            assert not noises.changes((2, 5)).any()
        assert noises.enabled
        assert (noises.changes((2, 2)) == others.changes((2, 2))).all()


def test_a_difference_that_vanishes_moves_as_the_smallest_normal_number():
    x = Noise(3).as_perturbed(np.array([1.0, -2.0]))
    for nothing in (x - np.array([1.0, -2.0]), x * 0.0):
        size = np.abs(nothing.view(np.ndarray)) / NORMAL
        assert (size >= 0.49 * STEP).all() and (size <= 1.01 * STEP).all()


def test_what_is_solved_one_by_one_is_recorded_with_the_determinant_of_each():
    def solved(i: int, noise: Noise) -> int:
        record(SolveRecord("A", 2, 0.5, (-1.0) ** i, 10.0 * i), np.eye(2))
        return noise.seed

    noises = NoiseBatch([Noise(4), Noise(2), Noise(9)])
    with recording_solves(noises) as watch:
        assert for_each_noise(noises, solved) == [4, 2, 9]
    (found,) = watch.solves
    assert (found.name, found.size) == ("A", 2)
    assert found.sign.tolist() == [1.0, -1.0, 1.0]
    assert found.log_determinant.tolist() == [0.0, 10.0, 20.0]


# ---- Lanes ---------------------------------------------------------------------------------------

RANDOM = np.random.default_rng(2)
WIDE, TALL = RANDOM.uniform(1.0, 2.0, (5, 2, 4)), RANDOM.uniform(1.0, 2.0, (5, 4, 2))


def test_a_product_of_matrices_in_lanes_moves_by_the_size_of_its_terms():
    x = np.array([[[1e6, 1e6]], [[1.0, 1.0]]])  # (1, 2) in two lanes
    y = np.array([[[1.0], [-1.0]], [[1.0], [1.0]]])
    noise = NoiseBatch([Noise(1)], states=2)
    for moved in (
        (noise.as_perturbed(BatchArray(x)), BatchArray(y)),
        (BatchArray(x), noise.as_perturbed(BatchArray(y))),
    ):
        found = np.matmul(*moved)
        change = np.abs(found.data[:, 0, 0] - [0.0, 2.0]) / [2e6, 2.0]
        assert (change >= 0.49 * STEP).all() and (change <= 1.01 * STEP).all()
        assert found.noise is noise


@pytest.mark.parametrize("a", [WIDE, TALL])
@pytest.mark.parametrize("columns", [(), (3,)])
def test_least_squares_in_lanes_are_those_of_each_lane(a: np.ndarray, columns: tuple):
    a = a * 1e12 ** np.arange(-2, 3)[:, None, None]  # lanes of very different size
    b = RANDOM.uniform(-1.0, 1.0, (5, a.shape[1], *columns))
    found = least_squares(BatchArray(a), BatchArray(b))
    assert found.shape == (a.shape[2], *columns)
    for i in range(5):
        expected = np.linalg.lstsq(a[i], b[i], rcond=None)[0]
        assert found.data[i] == pytest.approx(expected, rel=1e-10, abs=0.0)


def test_rows_in_lanes_are_scaled_as_those_of_each_lane():
    a = RANDOM.uniform(1.0, 2.0, (4, 2, 3)) * np.array([1.0, 8.0])[:, None]
    a[:, 0, 2] *= 64.0
    found = row_scale(BatchArray(a))
    for i in range(4):
        assert found.data[i].tolist() == np.asarray(row_scale(a[i])).tolist()
        sizes = np.abs(a[i]).max(axis=1) * found.data[i]
        assert (sizes >= 0.5).all() and (sizes <= 1.0).all()


# ---- Velocities ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("worst", "asked", "best"),
    [
        ([0.25], 1, 0),
        ([0.26, 0.1], 2, 1),
        ([9.0, 0.9, 0.2], 3, 2),
        ([9.0, 3.0, 7.0, 8.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0], 11, 1),
        ([9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 9.0, 9.0, 2.0, 9.0], 11, 9),
    ],
)
def test_the_best_velocity_is_returned_and_the_first_that_is_good_enough(
    monkeypatch, worst: list[float], asked: int, best: int
):
    seen: list[np.ndarray] = []

    def excess(at: Any, v: np.ndarray) -> Any:
        seen.append(v)
        return np.array([1.0, -2.0]) / len(seen), worst[len(seen) - 1]

    monkeypatch.setattr(dynamics, "_excess", excess)
    a = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -3.0]])
    at: Any = SimpleNamespace(terms=SimpleNamespace(a=a))
    start = np.array([1.0, 1e-3, 5.0])
    found = dynamics.consistent_velocity(at, start)
    assert seen[0] is start
    assert len(seen) == asked
    assert (found == seen[best]).all()


@pytest.mark.parametrize(("r", "fine"), [(2, True), (3, True), (4, False)])
def test_more_constraints_than_coordinates_cannot_be_split(r: int, fine: bool):
    at: Any = object.__new__(Quantities)
    at.scene = SimpleNamespace(n=3, r=r)
    if fine:
        at.refuse_partition()
        return
    with pytest.raises(RefusedError, match="4 constraints on 3 coordinates"):
        at.refuse_partition()
