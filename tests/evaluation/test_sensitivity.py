"""Perturbed copies: every number and every operation of them is moved, independently."""

from __future__ import annotations

from contextlib import suppress
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space
from tests.numbers.test_noise import replay

from eomcheck import velocity
from eomcheck.errors import RefusedError
from eomcheck.evaluation import perturbed as perturbed_module
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    perturbed_samples,
    sensitivity_of,
)
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import FLOAT64, map_record
from eomcheck.numbers.linear import recording_solves, solve
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH, Noise, NoisyArithmetic
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import SCENES, Snake

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
SNAKE = Snake([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [4.0], [0.125, -0.5])
Q = np.array([0.4, -0.2, 0.3, 1.1])


@pytest.fixture
def at() -> Evaluation:
    return Evaluation(SNAKE, Q, velocity(SNAKE, Q, [1.5, -0.75]))


def moved_by(at: Evaluation) -> np.ndarray:
    """Return the changes of masses and lengths (copies, _), in steps of their own size."""
    samples = perturbed_samples(at)
    moved = np.concatenate((samples.parameters.mass, samples.parameters.length)).data
    still = np.concatenate((at.parameters.mass, at.parameters.length))
    return (moved - still) / np.abs(still) / STEP


# ---- What is moved -------------------------------------------------------------------------------


def test_every_number_that_is_read_is_moved(at: Evaluation):
    samples = perturbed_samples(at)
    assert (np.abs(moved_by(at)) > 0.4).all()
    allowed, still = null_space(at.terms.a), at.terms.M
    for v, moved in zip(samples.v.data, samples.terms.M.data, strict=True):
        assert np.abs(allowed.T @ (v - at.v)).max() > 0.2 * STEP  # a slip is across
        assert (moved[still != 0] != still[still != 0]).all()


def test_what_is_returned_is_moved_as_what_is_read(at: Evaluation):
    record = map_record(lambda x: BatchArray(np.stack([x] * (SAMPLES + 1))), at.parameters)
    assert (perturbed_samples(at).finished(record).mass.data != at.parameters.mass).all()


def test_copies_are_moved_independently(at: Evaluation):
    for first, second in combinations(moved_by(at)[:SAMPLES], 2):
        assert (np.abs(first - second) > 1e-3).any()


def test_the_last_copy_is_the_first_stretched(at: Evaluation):
    moved = perturbed_samples(at).parameters.mass.data - at.parameters.mass
    assert moved[-1] == pytest.approx(STRETCH * moved[0], rel=0.05, abs=0.0)


def test_cosines_sines_and_roots_are_moved():
    arithmetic, x = NoisyArithmetic(FLOAT64, Noise(0)), np.array([0.3, 2.0])
    angles = arithmetic.angles(x)
    for moved, exact in (
        (angles.cos, np.cos(x)),
        (angles.sin, np.sin(x)),
        (arithmetic.root(x), np.sqrt(x)),
    ):
        steps = np.abs(np.asarray(moved) - exact) / np.abs(exact) / STEP
        assert ((steps > 0.4) & (steps < 1.1)).all()


def test_terms_that_cancel_show_what_rounding_does_to_them(at: Evaluation):
    x, y = np.full(20, 3.0), np.full(20, 0.7)
    for left in perturbed_samples(at).call(lambda x, y: x * y - y * x, *of_all(x, y)).data[:-1]:
        assert STEP / 10 < np.abs(left).max() / 2.1 < 2 * STEP


def test_jacobians_that_terms_are_made_of_are_moved():
    (kind,) = scene_classes_named(f"{GUIDES / 'trailer.py'}:Trailer")  # it writes no terms
    scene = kind.example()
    q, v = scene.initial_state()
    at = Evaluation(scene, q + 0.3, v)
    together, given = perturbed_samples(at), []
    calling = together.call

    def recording(function, *arguments):
        if function == scene.assemble:
            given.append(arguments[-1])
        return calling(function, *arguments)

    # Of numbers that are read as they are, so that what moves is moved in between.
    here = at.parameters, at.prepared, at.q, at.v
    still = map_record(lambda x: BatchArray(np.stack([x] * (SAMPLES + 1))), here)
    together.parameters, together.prepared, together.q, together.v = still
    together.call = recording  # type: ignore[method-assign]
    assert together.terms is not None
    ((linear, *_),) = given
    exact, *_ = at.call(scene.jacobians, *here)
    seen = np.abs(exact) > 0.1
    for of_copy in linear.data:
        assert (of_copy != exact)[seen].all()


def one_alone(at: Evaluation, noise: Noise, monkeypatch) -> perturbed_module.PerturbedEvaluation:
    """Return the perturbed evaluation of one sample by itself."""
    with monkeypatch.context() as patch:
        patch.setattr(perturbed_module, "NOISES", [noise])
        return perturbed_module.PerturbedEvaluation(at, coordinates=False)


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_a_copy_among_others_has_the_bits_that_it_has_alone(kind, monkeypatch):
    """Copies share what Python does for them, and no number."""
    scene = kind.example()
    q, v = scene.initial_state()
    at = Evaluation(scene, q + 0.1, v + 0.2)
    samples = perturbed_samples(at)
    noises = *(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP)
    alone = [one_alone(at, noise, monkeypatch) for noise in noises]
    for i, one in enumerate(alone):
        assert same(part(one.terms, 0), part(samples.terms, i))
    for formulation in FORMULATIONS.values():
        if not formulation.applies_to(scene):
            continue
        with suppress(RefusedError):
            at.acceleration(formulation)  # whose pivots the copies are given
        for i, one in enumerate(alone):
            try:
                found, expected = one.acceleration(formulation), samples.acceleration(formulation)
            except RefusedError:
                continue
            for name in ("vdot", "multipliers"):
                mine, other = getattr(found, name), getattr(expected, name)
                assert same(part((mine,), 0), part((other,), i)), (formulation.key, name)


def part(record: tuple, i: int) -> tuple:
    """Return what a record holds of sample i."""
    return map_record(lambda x: x.data[i], record)


def of_all(*arrays: np.ndarray) -> list[BatchArray]:
    """Return arrays of all samples, equal in each."""
    return [BatchArray(np.stack([x] * (SAMPLES + 1))) for x in arrays]


def test_what_copies_run_is_moved_side_by_side(at: Evaluation):
    """Of a sum from which a number is taken again its rounding is left."""
    x = np.arange(1.0, 200.0)
    found = perturbed_samples(at).run(lambda x: (x + 1) - x, *of_all(x)).data
    assert (found != 1.0).all()
    assert np.abs(found - 1.0).max() < 1e4 * STEP
    assert len(np.unique(found[:, 0])) == SAMPLES + 1


def test_what_is_not_listed_is_done_copy_by_copy(at: Evaluation):
    """A literal 1.5 is none of a generic function: whole arrays and matrices are moved then."""

    def function(A, b):
        return solve(1.5 * A, b, "A") + 1.5

    A, b = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1.0, 2.0])
    together = perturbed_samples(at)
    with together.computing("it"), together.recording_solves() as watch:
        found = together.call(function, *of_all(A, b)).data
    (one,) = watch.solves
    assert len(np.unique(found[:, 0])) == SAMPLES + 1
    noises = *(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP)
    for i, noise in enumerate(noises):
        with noise.stream("it"), recording_solves(noise) as alone:
            assert np.array_equal(function(A, b), found[i])
        assert alone.solves[0].log_determinant == one.log_determinant[i]
        assert alone.solves[0].sign == one.sign[i] == -1


def same(found: tuple, expected: tuple) -> bool:
    return all(
        x is y is None or np.array_equal(x, y, equal_nan=True)
        for x, y in zip(found, expected, strict=True)
    )


def change_of_entries(v: np.ndarray, seed: int) -> np.ndarray:
    """Return by how much the copy of this seed changes v, entry by entry."""
    noise = Noise(seed)
    with noise.stream("state"):
        return noise.perturb(v) - v


def test_the_velocity_is_moved_by_as_much_as_is_let_pass():
    """Turning about its wheel a link has v = 0 there, which has no rounding; a v + b has."""
    snake = Snake([1.0], [1.0], [0.1], None, [0.0])
    at = Evaluation(snake, np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, 0.0]))
    row = at.terms.a[0]
    # A speed along the constraint's row is what is let pass, as much as rounding allows of |a||v|.
    at = Evaluation(snake, at.q, velocity(snake, at.q, [1.0, 0.5]))
    size = np.abs(row) @ np.abs(at.v)
    slips = (perturbed_samples(at).v.data - at.v) @ row / (STEP * size)
    by_entries = np.array([row @ change_of_entries(at.v, seed) for seed in range(SAMPLES)])
    by_entries /= STEP * size
    assert np.abs(slips[:-1] - by_entries).max() > 0.4


def test_copies_take_the_partition_of_the_original(at: Evaluation):
    assert perturbed_samples(at).pivoted_partition is at.pivoted_partition


# ---- What is made of it --------------------------------------------------------------------------


def test_the_copy_that_moves_most_counts(at: Evaluation):
    moved = BatchArray(STEP * np.arange(1.0, SAMPLES + 2))

    def quantity(e: Evaluation):
        return 0.0 if e is at else moved

    assert sensitivity_of(at, quantity) == SAMPLES


@pytest.mark.parametrize("solved", [True, False])
def test_a_solution_that_does_not_move_further_by_more_noise_has_nothing_left(
    at: Evaluation, solved: bool
):
    lost = sensitivity_of(at, lambda e: 1.0 if e is at else 2.0, solved=solved)
    assert np.isinf(lost) == solved

    further = BatchArray(1.0 + 2.0**-10 * np.array([*[1.0] * SAMPLES, STRETCH]))

    def grows(e: Evaluation):
        return 1.0 if e is at else further

    assert np.isfinite(sensitivity_of(at, grows, solved=solved))


def test_a_result_that_is_lost_has_a_bound_of_its_own_size(at: Evaluation):
    lost = sensitivity_of(at, lambda e: 1.0 if e is at else 2.0)
    assert 0.1 < allowed_error(lost) < 10.0


@pytest.mark.parametrize("name", ["a'T", "M_El"])
def test_the_worst_matrix_decides(at: Evaluation, name: str):
    el = FORMULATIONS["el"]
    assert np.isfinite(acceleration_sensitivity(at, el))
    rcond = at.acceleration(el).rcond
    assert name in rcond and len(rcond) > 1
    rcond[name] = 1e-14
    assert np.isinf(acceleration_sensitivity(at, el))


def test_a_cancellation_is_hardly_ever_missed():
    """Two equal numbers are moved alike in one of two copies, in one of 2^SAMPLES in all."""
    one = np.ones(80)
    snake = Snake(one, one, one, None, 0 * one)
    at = Evaluation(snake, np.zeros(82), np.zeros(82))
    found = [
        sensitivity_of(at, lambda e, i=i: e.parameters.mass[i] - e.parameters.mass[i + 1])
        for i in range(0, 80, 2)
    ]
    assert np.mean(np.array(found) < 0.5) < 0.25


# ---- Noise ---------------------------------------------------------------------------------------


def test_equal_contributions_do_not_cancel():
    noise = Noise(0)
    apart = noise.perturb(np.ones(200)) - noise.perturb(np.ones(200))
    assert np.count_nonzero(apart) > 190


def test_sums_and_differences_of_whole_arrays_move():
    x, y = np.full(50, 3.0), np.full(50, 0.7)
    moved = Noise(0).as_perturbed(x.copy())
    changed = Noise(1).as_perturbed(x.copy())
    changed += y
    for found, exact in ((moved + y, x + y), (moved - y, x - y), (changed, x + y)):
        steps = np.abs(np.asarray(found) - exact) / exact / STEP
        assert ((steps > 0.4) & (steps < 1.1)).all()


# ---- Solves and signs ----------------------------------------------------------------------------


def test_a_change_of_sign_is_exact():
    x = np.full(20, 3.0)
    assert np.array_equal(replay(Noise(0), lambda x: -x, x), -x)


def test_a_matrix_is_moved_as_well_as_its_right_hand_side():
    """By its determinant, of which little is left: it tells of what the matrix was made of."""
    A, b = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-10]]), np.zeros(2)
    found = []
    for noise in (None, Noise(0), Noise(1)):
        with recording_solves(noise) as watch:
            solve(A, b, "A")
        found.append(watch.solves[0].log_determinant)
    assert max(abs(x - y) for x, y in combinations(found, 2)) > 2.0**8 * STEP


def test_each_right_hand_side_is_moved_by_the_backward_error_of_its_own():
    """Two equal ones have, but for that, equal solutions up to their own rounding."""
    A = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-20]])
    b = A @ np.array([1.0, 2.0])
    noise = Noise(0)
    with recording_solves(noise):
        found = np.asarray(solve(A, np.stack((b, b), axis=1), "A"))
    by_entries = 2.0**20 * 4 * STEP
    assert np.abs(found[:, 0] - found[:, 1]).max() > by_entries
