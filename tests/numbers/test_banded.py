"""`solve_banded` in every kind of number, and the formulation that it was written for."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import flint
import numpy as np
import pytest
from scipy.linalg import solve_banded as lapack_without_refinement
from tests.exact import ExactFloats, RandomFractions
from tests.machine_code import MachineCode, in_machine_code

from eomcheck import acceleration, enclose, simulate, velocity
from eomcheck.claims.registry import GenericPoint
from eomcheck.errors import RefusedError
from eomcheck.evaluation import perturbed
from eomcheck.evaluation.certified import true_error
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.formulations.banded import system as system_of_chain
from eomcheck.kernels.batched_solves import solve_banded_batch
from eomcheck.motion.right_hand_side import RightHandSide
from eomcheck.numbers import ball, finite_field
from eomcheck.numbers.banded_solve import (
    DIAGONAL,
    HALF,
    LEAST_STEPS,
    MOST_STEPS,
    REFINED,
    SMALLEST_SHARE,
    TERMS,
    WIDTH,
    BandFactors,
    solve_banded,
    to_dense,
)
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch
from eomcheck.numbers.counting import Counting, System
from eomcheck.numbers.finite_field import DegreeArithmetic
from eomcheck.numbers.generic import Array, map_entries
from eomcheck.numbers.linear import EPS, eliminate, recording_solves, singular_below
from eomcheck.numbers.noise import SAMPLES, STEP, Noise
from eomcheck.scenes import Snake

SIZES = [1, 2, 3, 4, 7, 8, 9, 30, 31]
sizes = pytest.mark.parametrize("size", SIZES)
BANDED, AU = FORMULATIONS["banded"], FORMULATIONS["au"]


def inside(size: int) -> Array:
    """Return which places of bands (size, 7) belong to the matrix."""
    columns = np.arange(size)[:, None] + np.arange(-HALF, HALF + 1)
    return (columns >= 0) & (columns < size)


def system(size: int, seed: int = 0) -> tuple[Array, Array]:
    random = np.random.default_rng((size, seed))
    bands = random.uniform(-1, 1, (size, WIDTH))
    return np.where(inside(size), bands, 0.0), random.uniform(-1, 1, size)


def solve_it(bands, b):
    return solve_banded(bands, b, "A")


def machine_solve(bands: Array, b: Array) -> Array:
    return in_machine_code(solve_it, bands, b)


def row_errors(bands: Array, b: Array, x: Array) -> Array:
    """Return the residual of each row over the magnitudes in it."""
    A = to_dense(bands)
    size = np.abs(A) @ np.abs(x) + np.abs(b)
    return np.abs(b - A @ x) / np.where(size > 0, size, 1.0)


# ---- Doubles -------------------------------------------------------------------------------------


@sizes
def test_the_bands_are_the_diagonals_of_the_full_matrix(size):
    bands, _ = system(size)
    A = to_dense(bands)
    for d in range(-HALF, HALF + 1):
        assert np.diagonal(A, d).tolist() == bands[inside(size)[:, HALF + d], HALF + d].tolist()
    assert np.count_nonzero(A) == inside(size).sum()


@sizes
@pytest.mark.parametrize("solve", [solve_it, machine_solve])
def test_banded_doubles_are_solved_as_full_ones(size, solve):
    bands, b = system(size)
    A = to_dense(bands)
    x = solve(bands, b)
    assert row_errors(bands, b, x).max() <= WIDTH * EPS
    allowed = allowed_error(np.linalg.cond(A) * np.abs(x).max())
    assert np.abs(x - np.linalg.solve(A, b)).max() <= allowed


@pytest.mark.parametrize("solve", [solve_it, machine_solve])
def test_every_row_has_a_small_residual_whatever_the_size_of_the_rows(solve):
    plain, refined = 0.0, 0.0
    for seed in range(20):
        bands, b = system(40, seed)
        scale = 10.0 ** np.random.default_rng(seed).uniform(-8, 8, 40)
        bands, b = bands * scale[:, None], b * scale
        by_diagonal = np.array([np.roll(bands[:, WIDTH - 1 - d], HALF - d) for d in range(WIDTH)])
        without = lapack_without_refinement((HALF, HALF), by_diagonal, b)
        plain = max(plain, row_errors(bands, b, without).max())
        refined = max(refined, row_errors(bands, b, solve(bands, b)).max())
    assert refined <= WIDTH * EPS
    assert plain > 100 * refined, "refinement would not be needed"


@sizes
def test_a_banded_matrix_is_recorded_by_its_name_order_and_condition(size):
    bands, b = system(size)
    with recording_solves() as watch:
        solve_banded(bands, b, "A")
    (solved,) = watch.solves
    assert (solved.name, solved.size) == ("A", size)
    assert 0 < solved.rcond <= 1


@pytest.mark.parametrize("size", SIZES[1:])
def test_a_singular_banded_matrix_is_refused_and_machine_code_gives_nan(size):
    bands, b = system(size)
    bands[1:2] = 0.0
    with pytest.raises(RefusedError, match=f"the {size} x {size} matrix A is singular") as caught:
        solve_banded(bands, b, "A")
    refusal = caught.value
    assert (refusal.what, refusal.rcond, refusal.threshold) == ("A", 0.0, singular_below(TERMS))
    assert refusal.matrix is not None
    assert refusal.matrix.shape == bands.shape
    assert np.isnan(machine_solve(bands, b)).all()


def test_dependent_rows_are_refused_at_the_threshold_of_a_band_not_of_a_full_matrix():
    size = 200
    bands, b = np.zeros((size, WIDTH)), np.ones(size)
    bands[:, HALF] = 1.0
    for small, refused in ((2 * singular_below(TERMS), False), (singular_below(TERMS) / 4, True)):
        # rows 0 and 1: [1, 1] and [1, 1 + small]; the condition is about 4 / small
        bands[0, HALF : HALF + 2] = bands[1, HALF - 1 : HALF + 1] = 1.0
        bands[1, HALF] = 1.0 + 4 * small
        if refused:
            with pytest.raises(RefusedError):
                solve_banded(bands, b, "A")
        else:
            assert np.isfinite(solve_banded(bands, b, "A")).all()
    assert singular_below(TERMS) < singular_below(size)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_banded_matrix_that_is_not_finite_is_refused_and_machine_code_does_not_raise(bad):
    bands, b = system(8)
    bands[3, HALF] = bad
    with pytest.raises(RefusedError):
        solve_banded(bands, b, "A")
    assert not np.isfinite(machine_solve(bands, b)).all()


def test_noise_moves_a_banded_solution_by_about_its_condition_and_its_determinant():
    bands, b = system(30)
    x = solve_banded(bands, b, "A")
    with recording_solves() as still:
        solve_banded(bands, b, "A")
    with recording_solves(Noise(0)) as watch:
        moved = solve_banded(bands, b, "A")
    sums = np.abs(np.linalg.inv(to_dense(bands))) @ np.abs(to_dense(bands)) @ np.abs(x)
    change = np.abs(moved - x).max()
    assert STEP * np.abs(x).max() / 10 < change < 10 * STEP * sums.max()
    change = abs(watch.solves[0].log_determinant - still.solves[0].log_determinant)
    assert 0 < change < len(b) * WIDTH * STEP / still.solves[0].rcond


@sizes
def test_the_determinant_of_a_banded_matrix_is_that_of_the_full_one(size):
    bands, b = system(size)
    with recording_solves() as watch:
        solve_banded(bands * 1000.0, b, "A")
    sign, log = np.linalg.slogdet(to_dense(bands))
    assert watch.solves[0].sign == sign
    assert watch.solves[0].log_determinant == pytest.approx(
        log / np.log(2) + size * np.log2(1000.0)
    )


@sizes
@pytest.mark.parametrize("decades", [0, 8])
def test_the_rcond_of_a_band_is_estimated_in_the_best_units(size, decades):
    bands, b = system(size)
    A = to_dense(bands)
    radius = np.abs(np.linalg.eigvals(np.abs(np.linalg.inv(A)) @ np.abs(A))).max()
    unit = np.ldexp(1.0, np.random.default_rng(size).integers(-3 * decades, 3 * decades + 1, size))
    columns = np.clip(np.arange(size)[:, None] + np.arange(-HALF, HALF + 1), 0, size - 1)
    with recording_solves() as watch:
        solve_banded(bands * unit[columns] * unit[::-1, None], b, "A")
    assert 1 / 10 < radius * watch.solves[0].rcond < 2


@sizes
def test_arguments_of_a_banded_solve_are_not_changed(size):
    bands, b = system(size)
    before = bands.copy(), b.copy()
    for solve in (solve_it, machine_solve):
        solve(bands, b)
        assert np.array_equal(bands, before[0])
        assert np.array_equal(b, before[1])


@sizes
def test_powers_of_two_as_units_of_rows_change_no_bit_of_a_band_solve(size):
    bands, b = system(size)
    units = np.ldexp(1.0, np.random.default_rng(size).integers(-400, 401, size))
    for solve in (solve_it, machine_solve):
        assert np.array_equal(solve(bands * units[:, None], b * units), solve(bands, b))


@pytest.mark.sampled(3)
@sizes
@pytest.mark.parametrize("width", [2, 4, 8])
def test_each_lane_of_a_band_solve_has_the_bits_of_a_single_one(size, width):
    systems = [system(size, seed) for seed in range(width)]
    systems[-1][0][:] = 0.0  # a singular one leaves the others alone
    bands, b = (np.stack(x, axis=-1) for x in zip(*systems, strict=True))
    found = MachineCode(solve_it, *systems[0], width=width)(bands, b)
    for lane, one in enumerate(systems):
        alone = machine_solve(*one)
        assert np.array_equal(found[..., lane], alone, equal_nan=True)
        assert np.isnan(alone).all() == (lane == width - 1)


# ---- Refinement ----------------------------------------------------------------------------------

OFF_BY_A_FIFTH = (
    Snake(
        [2.2621271916494643e-11, 1.4674207309477437e-12, 1.0, 1.0],
        [1e4, 913018097110003.2, 1e-5, 3.100668935197515e-08],
        [1.0, 0.0, 1.0, 1.0],
        [1.0] * 3,
        [-np.pi / 2, -np.pi / 2, -np.pi / 2, np.pi / 2],
    ),
    [0.0, 0.0, 0.0, -7.58754883337424e-07, -7.587548833247023e-07, -7.587548833367639e-07],
    [0.0] * 6,
)
"""Refined once and not looked at, 18.7 % off, with an error bound of 3.7e-10."""

OFF_BY_A_MILLIONTH = (
    Snake(
        [7.78, 1.0, 1.0],
        [5.74e-07, 1e-05, 4e-07],
        [2090.0, 1e6, 10.0],
        [1.0] * 2,
        [1.2935, 1.5707963267928966, 0.0],
    ),
    [1.0, 1.0, 1.15, -1.3506, -2.5],
    [
        *(2.423126642642796e-13, -1.4516677223826823e-13),
        *(5.669033285566992e-07, -5.222710886323102e-07, 1.079600381106597e-05),
    ],
)
"""Likewise 2.65e-6 off, with an error bound of 2.6e-12."""


@pytest.mark.parametrize("case", [OFF_BY_A_FIFTH, OFF_BY_A_MILLIONTH])
def test_where_factors_are_far_above_the_matrix_the_error_is_bounded_or_refused(case):
    scene, q, v = case
    try:
        found = acceleration(scene, "banded", q, v, consistent=False)
    except RefusedError as refusal:
        assert refusal.what == "KKT"
        assert refusal.rcond <= refusal.threshold
        return
    truth = enclose(scene, "banded", q, v=v, digits=20)
    assert largest(true_error(found.vdot, truth)) <= found.error_bound
    assert found.error_bound < 1e-10 * largest(truth.doubles())


def test_the_bound_is_above_the_error_whatever_the_noise_is(monkeypatch):
    """Half of these bounds were below the error."""
    scene, q, v = OFF_BY_A_MILLIONTH
    banded = FORMULATIONS["banded"]
    found = Evaluation(scene, q, v).acceleration(banded).vdot
    error = largest(true_error(found, enclose(scene, "banded", q, v=v, digits=20)))
    bounds = set()
    for first in range(0, 100 * SAMPLES, SAMPLES):
        with monkeypatch.context() as patch:
            seeded = [Noise(first + noise.seed, noise.step) for noise in perturbed.NOISES]
            patch.setattr(perturbed, "NOISES", seeded)
            at = Evaluation(scene, q, v)
            bounds.add(allowed_error(acceleration_sensitivity(at, banded)))
    assert len(bounds) > 90, "noise matters"
    assert min(bounds) >= error > 0


def factors_above_the_matrix() -> tuple[Array, Array]:
    """Return a matrix whose factors are singular in doubles, and a right-hand side."""
    scene, q, v = OFF_BY_A_FIFTH
    at = Evaluation(scene, q, v)
    return system_of_chain(*at.chain)


def test_a_matrix_that_refinement_does_not_solve_is_refused_with_its_backward_error():
    bands, b = factors_above_the_matrix()
    with recording_solves() as watch, pytest.raises(RefusedError) as caught:
        solve_banded(bands, b, "A")
    (solved,) = watch.solves
    refusal = caught.value
    assert solved.rcond > singular_below(TERMS), "refused as singular, and not by its error"
    assert LEAST_STEPS <= solved.refinements <= MOST_STEPS
    assert (refusal.what, refusal.threshold) == ("A", singular_below(TERMS))
    assert refusal.rcond <= refusal.threshold
    assert refusal.matrix is not None
    for part in ("14 x 14 matrix A", "backward error", f"allowed is up to {REFINED:.2g}"):
        assert part in str(refusal)


def test_moved_or_in_machine_code_a_matrix_that_refinement_does_not_solve_has_no_solution():
    bands, b = factors_above_the_matrix()
    assert np.isnan(machine_solve(bands, b)).all()
    for seed in range(4):
        with recording_solves(Noise(seed)):
            assert np.isnan(solve_banded(bands, b, "A")).all()


def test_in_lanes_a_matrix_that_refinement_does_not_solve_has_no_solution_and_others_have():
    bad, good = factors_above_the_matrix(), system(14)
    stacked = (np.stack(x) for x in zip(good, bad, good, strict=True))
    bands, b = map(BatchArray, stacked)
    with recording_solves() as watch:
        x = solve_banded_batch(bands, b, "A").data
    assert np.array_equal(np.isnan(x).all(axis=1), [False, True, False])
    assert np.abs(x[0] - solve_banded(*good, "A")).max() <= allowed_error(np.abs(x[0]).max())
    assert np.array_equal(x[0], x[2])
    (solved,), (refused,) = watch.solves, watch.refused
    assert refused.tolist() == [False, True, False]
    assert (solved.rcond > singular_below(TERMS)).all(), "refused as singular, not by its error"
    noise = NoiseBatch([Noise(0)], states=3)
    with recording_solves(noise):
        moved = solve_banded_batch(noise.as_perturbed(bands), noise.as_perturbed(b), "A").data
    assert np.array_equal(np.isnan(moved).all(axis=1), [False, True, False])


@sizes
def test_a_common_matrix_is_refined_as_little_as_there_is(size):
    bands, b = system(size)
    with recording_solves() as watch:
        solve_banded(bands, b, "A")
    assert watch.solves[0].refinements == LEAST_STEPS


def test_refinement_goes_on_until_the_backward_error_is_that_of_rounding():
    steps = []
    for seed in range(200):
        bands, b = system(40, seed)
        bands *= 10.0 ** np.random.default_rng(seed).uniform(-10, 10, bands.shape)
        with recording_solves() as watch:
            x = solve_banded(bands, b, "A")
        A, unit = to_dense(bands), np.abs(bands).max(axis=1)
        for found in (x, machine_solve(bands, b)):
            sizes = (np.abs(A) @ np.abs(found) + np.abs(b)) / unit
            # Units by powers of two are other ones by a factor of 2 at most.
            allowed = REFINED * np.maximum(sizes, 2 * SMALLEST_SHARE * sizes.max())
            assert (np.abs(b - A @ found) / unit <= allowed).all()
        steps.append(watch.solves[0].refinements)
    assert max(steps) > LEAST_STEPS


@pytest.mark.parametrize(
    ("left", "steps"), [(0.4, MOST_STEPS), (0.6, LEAST_STEPS), (1.4, LEAST_STEPS)]
)
def test_refinement_ends_with_the_first_step_that_does_not_halve_the_backward_error(left, steps):
    size = 5
    bands = np.where(np.arange(7) == 3, 1.0, np.zeros((size, 7)))
    factored = BandFactors(bands)
    factored.lu[DIAGONAL] /= 1.0 - left  # a step leaves this share of the residual
    _, error, taken = factored.solve(np.ones(size))
    assert (taken, error > REFINED) == (steps, True)


@pytest.mark.parametrize("links", [2, 3, 5, 12])
@pytest.mark.sampled(2)
def test_rows_of_zeros_that_are_only_found_by_rounding_are_no_reason_to_refuse(links):
    """As joint forces across links without moments of inertia, whose wheels do not steer."""
    random = np.random.default_rng(links)
    for _ in range(20):
        mass, length = random.uniform(0.1, 10.0, (2, links))
        snake = Snake(mass, length, np.zeros(links), None, np.zeros(links))
        q = np.r_[0.0, 0.0, np.cumsum(random.uniform(0.1, 0.5, links))]
        v = velocity(snake, q, [1.0, 0.5])
        found, truth = acceleration(snake, "banded", q, v), enclose(snake, "banded", q, v=v)
        size = largest(truth.doubles())
        assert largest(true_error(found.vdot, truth)) <= min(found.error_bound, 1e-14 * size)
        at = Evaluation(snake, q, v)
        xdot, _ = in_machine_code(BANDED.solution, *at.chain)
        vdot = snake.chain_acceleration(at.parameters, at.prepared, at.x, xdot)
        assert largest(true_error(vdot, truth)) <= 1e-14 * size


@pytest.mark.parametrize("large", [1e300, 1e308])
def test_a_solution_that_overflows_is_not_refused_for_its_backward_error(large):
    bands, b = system(8)
    for solve in (solve_it, machine_solve):
        assert not np.isfinite(solve(bands * 1e-10, b * large)).all()
    with recording_solves() as watch:
        solve_banded_batch(BatchArray(bands[None] * 1e-10), BatchArray(b[None] * large), "A")
    assert watch.refused[0].tolist() == [False]


# ---- Exact numbers -------------------------------------------------------------------------------


def exact_system(size: int) -> tuple[Array, Array]:
    """Return small whole numbers, zeros among them, as fractions; elsewhere literal zeros."""
    random = np.random.default_rng(size)
    bands = np.zeros((size, WIDTH), object)
    for place in np.argwhere(inside(size)):
        bands[tuple(place)] = Fraction(int(random.integers(-3, 4)))
    bands[:, HALF] += 1 + 3 * (bands[:, HALF] == 0)
    return bands, np.array([Fraction(int(x)) for x in random.integers(-3, 4, size)], object)


def test_a_zero_at_the_pivot_is_passed_over():
    bands = np.zeros((2, WIDTH), object)
    bands[0, HALF + 1] = bands[1, HALF - 1] = Fraction(2)
    assert solve_banded(bands, np.array([Fraction(1), Fraction(3)]), "A").tolist() == [
        Fraction(3, 2),
        Fraction(1, 2),
    ]


@sizes
def test_banded_fractions_are_solved_exactly_as_full_ones(size):
    bands, b = exact_system(size)
    x = solve_banded(bands, b, "A")
    assert x.tolist() == eliminate(to_dense(bands), b, "A").tolist()
    assert (to_dense(bands) @ x == b).all()


@sizes
def test_banded_elements_of_a_field_are_solved_as_full_ones(size):
    prime = 2**61 - 1
    bands, b = (
        map_entries(lambda y: y if isinstance(y, int) else flint.nmod(y.numerator, prime), x)
        for x in exact_system(size)
    )
    x = solve_banded(bands, b, "A")
    assert x.tolist() == finite_field._solve(to_dense(bands), b, "A").tolist()


@sizes
def test_banded_balls_enclose_the_exact_solution(size):
    bands, b = exact_system(size)
    exact = solve_banded(bands, b, "A")
    balls = (
        map_entries(lambda y: y if isinstance(y, int) else flint.arb(y.numerator), x)
        for x in (bands, b)
    )
    with ball.precision(100):
        x = solve_banded(*balls, "A")
    with ball.precision(400):
        for found, truth in zip(x, exact, strict=True):
            assert found.overlaps(flint.arb(flint.fmpq(truth.numerator, truth.denominator)))
            assert found.rad() < 1e-15


def test_balls_that_may_be_singular_are_refused():
    bands, b = np.zeros((2, WIDTH), object), np.array([flint.arb(1)] * 2)
    bands[0, HALF], bands[1, HALF] = flint.arb(1), flint.arb(0, 1e-30)
    with pytest.raises(RefusedError, match="matrix A"):
        solve_banded(bands, b, "A")


def test_singular_banded_fractions_are_refused_by_name():
    bands, b = exact_system(7)
    bands[3] = 0 * bands[3]
    with pytest.raises(RefusedError, match="the 7 x 7 matrix A is singular"):
        solve_banded(bands, b, "A")


def test_banded_bounds_are_those_of_the_full_matrix():
    degrees = DegreeArithmetic()
    bands = np.where(inside(8), degrees.numbers(np.zeros((8, WIDTH))), 0)
    b = degrees.vector(8)
    banded, dense = (
        solve_banded(bands, b, "A"),
        finite_field._solve_by_cramer(to_dense(bands), b, "A"),
    )
    assert [x.degree for x in banded] == [x.degree for x in dense]
    assert [x.height for x in banded] == [x.height for x in dense]


def test_a_banded_system_is_counted_with_its_band_and_not_eliminated():
    counting = Counting()
    solve_banded(counting.numbers(np.zeros((9, WIDTH))), counting.vector(9), "A")
    tally = counting.tally
    assert tally.systems == [System("A", 9, 1, HALF)]
    assert tally.additions == tally.multiplications == tally.divisions == 0


# ---- The formulation -----------------------------------------------------------------------------


@pytest.mark.parametrize("links", [1, 2, 3, 6])
def test_for_any_velocity_banded_has_the_acceleration_and_the_multipliers_of_au(links):
    """Not only where the constraints hold: so drift does to both the same."""
    for scene in Snake.structures(links):
        free = GenericPoint(scene, RandomFractions(links)).free
        found, expected = free.solution(BANDED), free.solution(AU)
        assert (found.vdot == expected.vdot).all()
        assert (found.multipliers == expected.multipliers).all()


ACROSS = [np.pi / 2, -np.pi / 2]


@pytest.mark.parametrize("alpha", ACROSS)
@pytest.mark.parametrize("wheel", range(5))
def test_a_wheel_across_its_link_is_solved_as_by_au(wheel, alpha):
    snake = replace(Snake.coil(5), wheel_angle=np.where(np.arange(5) == wheel, alpha, 0.2))
    q, _ = snake.initial_state()
    at = Evaluation(snake, q, np.zeros(7))
    v = consistent_velocity(at, np.array([1.0, -2.0, 0.5, 0.7, -0.3, 0.9, 0.4]))
    found, expected = (acceleration(snake, key, q, v) for key in ("banded", "au"))
    assert np.abs(found.vdot - expected.vdot).max() <= found.error_bound + expected.error_bound
    assert found.error_bound < 1e-9 * np.abs(found.vdot).max()
    at = Evaluation(snake, q, v)
    spread = acceleration_sensitivity(at, BANDED, "multipliers") + acceleration_sensitivity(
        at, AU, "multipliers"
    )
    assert np.abs(found.multipliers - expected.multipliers).max() <= allowed_error(spread)


@pytest.mark.parametrize("alpha", ACROSS)
def test_wheels_across_their_links_are_solved_exactly(alpha):
    """cos α = 0 to the last digit, which no double is."""

    class Across(RandomFractions):
        def angles(self, x):
            made = super().angles(x)
            if np.array_equal(x, snake.wheel_angle):
                made = made._replace(cos=0 * made.cos, sin=0 * made.sin + int(np.sign(alpha)))
            return made

    snake = replace(Snake.coil(4), wheel_angle=[alpha] * 4)
    free = GenericPoint(snake, Across(1)).free
    found, expected = free.solution(BANDED), free.solution(AU)
    assert (found.vdot == expected.vdot).all()
    assert (found.multipliers == expected.multipliers).all()


@pytest.mark.parametrize("second", [np.pi / 2, -np.pi / 2, np.pi / 2 + 1e-14])
@pytest.mark.parametrize("turn", [0.0, np.pi])
@pytest.mark.parametrize("heading", [0.0, 0.3])
def test_where_two_wheels_hold_the_same_motion_the_error_bound_tells(second, turn, heading):
    one = np.ones(2)
    snake = Snake(one, one, one, one[1:], [np.pi / 2, second])
    q = np.array([0.0, 0.0, heading, heading + turn])
    at = Evaluation(snake, q, np.zeros(4))
    v = consistent_velocity(at, np.array([1.0, 2.0, 3.0, -1.5]))
    found = acceleration(snake, "banded", q, v, consistent=False)
    with ball.precision(400):
        balls = ball.Balls()
        exact = Quantities(snake, balls, balls.numbers(q))
        exact.v = balls.numbers(v)
        truth = ball.midpoints(exact.solution(BANDED).vdot)
        assert np.allclose(ball.midpoints(exact.solution(AU).vdot), truth, rtol=1e-15, atol=0.0)
    assert np.abs(found.vdot - truth).max() <= found.error_bound
    try:
        found = acceleration(snake, "au", q, v, consistent=False)
        assert np.abs(found.vdot - truth).max() <= found.error_bound
    except RefusedError as refusal:
        assert refusal.what == "M_Au"


def test_a_massless_body_is_no_exception_unless_its_motion_is_free():
    snake = replace(Snake.coil(6), inertia=np.zeros(6))
    q, _ = snake.initial_state()
    v = velocity(snake, q, [1.0, 0.5])
    found, expected = (acceleration(snake, key, q, v) for key in ("banded", "au"))
    assert np.abs(found.vdot - expected.vdot).max() <= found.error_bound + expected.error_bound
    with pytest.raises(RefusedError, match="KKT"):
        acceleration(Snake([1.0], [1.0], [0.0], None, [0.3]), "banded", np.zeros(3), np.zeros(3))


# ---- What it delivers ----------------------------------------------------------------------------


@pytest.mark.night
def test_it_moves_a_snake_whose_head_speeds_do_not_tell_the_tail():
    """At N = 60 M_Kane is singular in doubles; energy and wheels keep to the tolerance."""
    scene = Snake.pattern(60)
    found = simulate(scene, "banded", 0.02, rtol=1e-11, atol=1e-11)
    by_kane = simulate(scene, "kane", 0.02, rtol=1e-11, atol=1e-11, max_steps=20 * found.steps)
    assert by_kane.status == "failed"
    finer = simulate(scene, "banded", 0.02, rtol=1e-13, atol=1e-13)
    assert found.status == finer.status == "finished"
    assert np.abs(found.q[-1] - finer.q[-1]).max() < 1e-9
    assert found.constraint_residual is not None
    assert found.constraint_residual.max() < 1e-10
    assert np.abs(found.energy - found.energy[0]).max() < 1e-10 * found.energy[0]


@pytest.mark.parametrize("links", [1, 2, 7])
def test_a_right_hand_side_in_machine_code_has_no_other_errors_than_the_public_path(links):
    exact = ExactFloats()
    scene = Snake.coil(links)
    q, _ = scene.initial_state()
    at = Evaluation(scene, q, velocity(scene, q, [1.0, 0.5]))
    here = scene.parameters(exact), scene.prepare(exact, None, q, 0), exact.numbers(q)
    truth, _ = BANDED.solution(*scene.chain(*here, exact.numbers(at.x)))
    xdot = RightHandSide(scene, BANDED)(0.0, np.concatenate((at.q, at.x)))[scene.n :]
    error = np.abs(exact.numbers(xdot) - truth).max()
    assert error <= acceleration(scene, "banded", q, at.v).error_bound
