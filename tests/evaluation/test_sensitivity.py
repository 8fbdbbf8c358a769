"""Perturbed copies: every number and every operation of them is moved, independently."""

from __future__ import annotations

from contextlib import suppress
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space

from eomcheck import velocity
from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    PerturbedBatch,
    acceleration_sensitivity,
    perturbed_samples,
    sensitivity_of,
)
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels.perturbed_trace import TraceRunner
from eomcheck.numbers.generic import map_record
from eomcheck.numbers.linear import recording_solves, solve
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH, Noise
from eomcheck.scene_lookup import scene_classes_named
from eomcheck.scenes import SCENES, Snake

GUIDES = Path(__file__).parents[2] / "docs" / "guides"
SNAKE = Snake([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [4.0], [0.125, -0.5])
Q = np.array([0.4, -0.2, 0.3, 1.1])


@pytest.fixture
def at() -> Evaluation:
    return Evaluation(SNAKE, Q, velocity(SNAKE, Q, [1.5, -0.75]))


def moved_by(copy: Evaluation, at: Evaluation) -> np.ndarray:
    """Return the changes of masses and lengths, in steps of their own size."""
    moved, still = (np.concatenate((x.parameters.mass, x.parameters.length)) for x in (copy, at))
    return (moved - still) / np.abs(still) / STEP


# ---- What is moved -------------------------------------------------------------------------------


def test_every_number_that_is_read_is_moved(at: Evaluation):
    for copy in perturbed_samples(at):
        assert (np.abs(moved_by(copy, at)) > 0.4).all()
        allowed = null_space(at.terms.a)
        assert np.abs(allowed.T @ (copy.v - at.v)).max() > 0.2 * STEP  # a slip is across
        moved, still = copy.terms.M, at.terms.M
        assert (np.asarray(moved)[still != 0] != still[still != 0]).all()


def test_what_is_returned_is_moved_as_what_is_read(at: Evaluation):
    record = at.parameters
    assert (np.asarray(perturbed_samples(at)[0].finished(record).mass) != record.mass).all()


def test_copies_are_moved_independently(at: Evaluation):
    changes = [moved_by(copy, at) for copy in perturbed_samples(at)[:SAMPLES]]
    for first, second in combinations(changes, 2):
        assert (np.abs(first - second) > 1e-3).any()


def test_the_last_copy_is_the_first_stretched(at: Evaluation):
    *copies, stretched = perturbed_samples(at)
    mass = at.parameters.mass
    by, further = (np.asarray(x.parameters.mass) - mass for x in (copies[0], stretched))
    assert further == pytest.approx(STRETCH * by, rel=0.05, abs=0.0)


def test_cosines_sines_and_roots_are_moved(at: Evaluation):
    arithmetic, x = perturbed_samples(at)[0].prepare_arithmetic, np.array([0.3, 2.0])
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
    left = perturbed_samples(at)[0].call(lambda x, y: x * y - y * x, x, y)
    assert STEP / 10 < np.abs(left).max() / 2.1 < 2 * STEP


def test_jacobians_that_terms_are_made_of_are_moved():
    (kind,) = scene_classes_named(f"{GUIDES / 'trailer.py'}:Trailer")  # it writes no terms
    scene = kind.example()
    q, v = scene.initial_state()
    at = Evaluation(scene, q + 0.3, v)
    copies, given = perturbed_samples(at), []
    together = copies[0].batch
    calling = together.call

    def recording(function, *arguments):
        if function == scene.assemble:
            given.append(arguments[-1])
        return calling(function, *arguments)

    # Of numbers that are read as they are, so that what moves is moved in between.
    here = at.parameters, at.prepared, at.q, at.v
    still = map_record(lambda x: np.stack([x] * len(copies)), here)
    together.parameters, together.prepared, together.q, together.v = still
    together.call = recording  # type: ignore[method-assign]
    assert copies[0].terms is not None
    ((linear, *_),) = given
    exact, *_ = at.call(scene.jacobians, *here)
    seen = np.abs(exact) > 0.1
    for of_copy in np.asarray(linear):
        assert (of_copy != exact)[seen].all()


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_a_copy_among_others_has_the_bits_that_it_has_alone(kind):
    """Copies share what Python does for them, and no number."""
    scene = kind.example()
    q, v = scene.initial_state()
    at = Evaluation(scene, q + 0.1, v + 0.2)
    copies = perturbed_samples(at)
    for formulation in FORMULATIONS.values():
        if not formulation.applies_to(scene):
            continue
        with suppress(RefusedError):
            at.acceleration(formulation)  # whose pivots the copies are given
        for copy in copies:
            alone = PerturbedBatch(at, [copy])
            assert same(alone.part(0, alone.terms), copy.terms)
            try:
                found, expected = alone.acceleration(formulation), copy.acceleration(formulation)
            except RefusedError:
                continue
            for part in ("vdot", "multipliers"):
                mine = alone.part(0, getattr(found, part))
                assert same((mine,), (getattr(expected, part),)), (formulation.key, part)


def test_what_copies_run_is_moved_alone_and_side_by_side(at: Evaluation):
    """Of a sum from which a number is taken again its rounding is left."""

    def function(x):
        return (x + 1) - x

    copies, x = perturbed_samples(at), np.arange(1.0, 200.0)
    for copy in copies:
        found = copy.run(function, x)
        assert (found != 1.0).all()
        assert np.abs(found - 1.0).max() < 1e4 * STEP
    together = copies[0].batch.run(function, np.stack([x] * len(copies)))
    assert (together != 1.0).all()
    assert len(np.unique(together[:, 0])) == len(copies)


def test_what_is_not_listed_is_done_copy_by_copy(at: Evaluation):
    """A literal 1.5 is none of a generic function: whole arrays and matrices are moved then."""

    def function(A, b):
        return solve(1.5 * A, b, "A") + 1.5

    copies = perturbed_samples(at)
    A, b = np.array([[1.0, 2.0], [3.0, 4.0]]), np.array([1.0, 2.0])
    together = copies[0].batch
    with together.computing("it"), together.recording_solves() as watch:
        found = together.call(function, np.stack([A] * len(copies)), np.stack([b] * len(copies)))
    (one,) = watch.solves
    assert len(np.unique(found[:, 0])) == len(copies)
    for i, copy in enumerate(copies):
        with copy.computing("it"), copy.recording_solves() as alone:
            assert np.array_equal(copy.call(function, A, b), found[i])
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
    slips = np.array([row @ (copy.v - at.v) for copy in perturbed_samples(at)]) / (STEP * size)
    by_entries = np.array([row @ change_of_entries(at.v, seed) for seed in range(SAMPLES)])
    by_entries /= STEP * size
    assert np.abs(slips[:-1] - by_entries).max() > 0.4


def test_copies_take_the_partition_of_the_original(at: Evaluation):
    assert all(copy.pivoted_partition is at.pivoted_partition for copy in perturbed_samples(at))


# ---- What is made of it --------------------------------------------------------------------------


def test_the_copy_that_moves_most_counts(at: Evaluation):
    copies = perturbed_samples(at)

    def quantity(e: Evaluation):
        return 0.0 if e is at else STEP * (1 + [copy is e for copy in copies].index(True))

    assert sensitivity_of(at, quantity) == SAMPLES


@pytest.mark.parametrize("solved", [True, False])
def test_a_solution_that_does_not_move_further_by_more_noise_has_nothing_left(
    at: Evaluation, solved: bool
):
    *_, stretched = perturbed_samples(at)
    lost = sensitivity_of(at, lambda e: 1.0 if e is at else 2.0, solved=solved)
    assert np.isinf(lost) == solved

    def grows(e: Evaluation):
        return 1.0 if e is at else 1.0 + 2.0**-10 * (STRETCH if e is stretched else 1.0)

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
    assert np.array_equal(TraceRunner().run(Noise(0), lambda x: -x, x), -x)


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
