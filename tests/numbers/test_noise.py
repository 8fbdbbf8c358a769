"""Measured condition numbers: noise of a known size, and what it measures where that is known."""

from __future__ import annotations

from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eomcheck import acceleration, check_state, velocity
from eomcheck.claims import case
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import (
    acceleration_sensitivity,
    perturbed_samples,
    sensitivity_of,
)
from eomcheck.evaluation.tolerance import INCONCLUSIVE, C, allowed_error, largest, largest_of_each
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels.perturbed_trace import FEWEST_COMPILED, TraceRunner
from eomcheck.numbers.banded_solve import BANDED_SOLVERS
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch
from eomcheck.numbers.dual import duals, rate
from eomcheck.numbers.generic import Angles, as_objects, map_record
from eomcheck.numbers.linear import EPS, PRODUCTS, SOLVERS, recording_solves, solve
from eomcheck.numbers.noise import NORMAL, SAMPLES, STEP, Noise, PerturbedArray
from eomcheck.scenes import SCENES, Snake

seeds = pytest.mark.parametrize("seed", range(5))
ROUNDING = 8 * EPS
"""Of 1 + change and the product, far below the step."""


def replay(noise: Noise, function, *arguments, runner: TraceRunner | None = None):
    """Return what a function gives for one sample, perturbed by `noise`."""

    def of_one(x):
        return BatchArray(x[None]) if isinstance(x, np.ndarray) and x.dtype == np.float64 else x

    batch = noise if isinstance(noise, NoiseBatch) else NoiseBatch([noise])
    found = (runner or TraceRunner()).run(batch, function, *map_record(of_one, arguments))
    return map_record(lambda x: x.data[0], found)


# ---- The noise -----------------------------------------------------------------------------------


def relative_steps(x, moved) -> np.ndarray:
    return np.abs(moved - x) / np.abs(x) / STEP


@seeds
def test_every_entry_moves_by_half_to_a_whole_step_of_its_own_size(seed):
    x = np.random.default_rng(seed).uniform(-1, 1, (7, 9)) * 10.0 ** np.arange(-4, 5)
    steps = relative_steps(x, Noise(seed).perturb(x))
    assert (steps >= 0.5 - ROUNDING / STEP).all()
    assert (steps <= 1.0 + ROUNDING / STEP).all()


@seeds
def test_noise_goes_both_ways(seed):
    changes = Noise(seed).changes((200,))
    assert (changes > 0).any()
    assert (changes < 0).any()


def test_the_step_of_the_noise_can_be_chosen():
    changes = np.abs(Noise(0, step=0.25).changes((100,)))
    assert (changes >= 0.125).all()
    assert (changes <= 0.25).all()


@seeds
def test_the_same_seed_makes_the_same_noise_and_another_seed_another(seed):
    x = np.ones(20)
    assert np.array_equal(Noise(seed).perturb(x), Noise(seed).perturb(x))
    assert not np.array_equal(Noise(seed).perturb(x), Noise(seed + 1).perturb(x))


def test_noise_that_is_drawn_twice_is_not_the_same():
    noise = Noise(0)
    assert not np.array_equal(noise.perturb(np.ones(20)), noise.perturb(np.ones(20)))


def test_a_change_is_a_function_of_seed_stream_and_number():
    """Not of what was drawn before, for another stream or inside of this one."""
    noise, fresh = Noise(3), Noise(3)
    with fresh.stream("A"):
        expected = fresh.changes((3000,))
    noise.changes((5,))
    with noise.stream("A"):
        begun = noise.changes((7,))
        with noise.stream("B"):
            other = noise.changes((3000,))
        rest = [noise.changes((1,)) for _ in range(13)]
        found = np.concatenate((begun, *rest, noise.changes((2980,))))
    assert np.array_equal(found, expected)
    assert not (other == expected).any()
    assert np.unique(expected).size == 3000


def test_noises_side_by_side_are_each_what_it_is_alone():
    sources = [(0, STEP), (3, STEP), (0, 8 * STEP)]
    noises, each = NoiseBatch([Noise(*one) for one in sources]), [Noise(*one) for one in sources]
    x = np.arange(1.0, 4000.0)
    for name, size in (("a", 7), ("b", 3000), ("a", 3999)):
        with noises.stream(name):
            parts = [noises.perturb(BatchArray(np.tile(x[:k], (3, 1)))).data for k in (size, 5)]
            with noises.split() as apart:
                parts.append(np.stack([one.perturb(x[:4]) for one in apart]))
            parts.append(noises.perturb(BatchArray(np.tile(x[:6], (3, 1)))).data)
        for i, alone in enumerate(each):
            with alone.stream(name):
                for found in parts:
                    assert np.array_equal(found[i], alone.perturb(x[: found.shape[1]]))


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-310, NORMAL])
def test_below_the_smallest_normal_number_entries_move_as_those_at_it(size):
    moved = Noise(0).perturb(np.full(50, size)) - size
    assert np.abs(moved).min() > 0.4 * STEP * NORMAL
    assert np.abs(moved).max() < 1.1 * STEP * NORMAL


def test_of_angles_only_cosines_and_sines_move():
    x = np.array([0.3, -2.0])
    moved = Noise(0).perturb_record(Angles(x, np.cos(x), np.sin(x)))
    assert np.array_equal(moved.value, x)
    for part, exact in ((moved.cos, np.cos(x)), (moved.sin, np.sin(x))):
        assert (relative_steps(exact, part) > 0.4).all()


OPERATIONS = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
    "quotient": lambda x, y: x / y,
    "sum with a literal": lambda x, y: 1 + x,
    "product with a literal": lambda x, y: 3 * x,
    "half": lambda x, y: x / 2,
    "inverse": lambda x, y: 1 / x,
}


@pytest.mark.parametrize("operation", OPERATIONS.values(), ids=OPERATIONS)
def test_every_operation_of_a_generic_function_moves_its_result(operation):
    x, y = np.full(100, 3.0), np.full(100, 0.7)

    def function(x, y):
        return np.array([operation(a, b) for a, b in zip(x, y, strict=True)], object)

    steps = relative_steps(operation(x, y), replay(Noise(0), function, x, y))
    assert (steps >= 0.5 - ROUNDING / STEP).all()
    assert (steps <= 1.0 + ROUNDING / STEP).all()
    assert np.unique(steps).size > 10


def test_terms_that_cancel_identically_leave_the_rounding_of_each():
    """Moving x alone would not show it: x y - y x is 0 for every x and y."""
    x, y = np.full(100, 3.0), np.full(100, 0.7)
    left = replay(Noise(0), lambda x, y: x * y - y * x, x, y)
    assert 0.1 * STEP < np.abs(left).max() / 2.1 < 2 * STEP


@pytest.mark.parametrize(
    "operation",
    [lambda x: 0 + x, lambda x: x - 0, lambda x: 1 * x, lambda x: x * 1, lambda x: x + 0 * x],
)
def test_what_rounds_nothing_moves_nothing(operation):
    x = np.array([3.0])
    assert np.array_equal(replay(Noise(0), operation, x), x)


def test_a_function_that_is_not_rational_is_not_run_on_moved_numbers():
    with pytest.raises(TypeError):
        replay(Noise(0), np.sin, np.ones(3))


@seeds
def test_a_product_of_matrices_moves_by_the_size_of_its_terms(seed):
    random = np.random.default_rng(seed)
    A, B = random.uniform(-1, 1, (4, 50)), random.uniform(-1, 1, (50, 3))
    noise = Noise(seed)
    steps = np.abs(np.asarray(noise.as_perturbed(A) @ B) - A @ B) / (np.abs(A) @ np.abs(B)) / STEP
    assert (steps >= 0.5 - 1e-2).all()
    assert (steps <= 1.0 + 1e-2).all()
    assert not np.array_equal(noise.as_perturbed(A) @ B, noise.as_perturbed(A) @ B)


@pytest.mark.parametrize(
    "operation",
    [np.add, np.subtract, np.multiply, np.true_divide, np.power, np.hypot],
)
@seeds
def test_the_result_of_each_operation_on_whole_arrays_is_perturbed(operation, seed):
    x, y = np.full(100, 3.0), np.full(100, 0.7)
    noise = Noise(seed)
    steps = relative_steps(operation(x, y), operation(noise.as_perturbed(x), y))
    assert (steps >= 0.5 - ROUNDING / STEP).all() and np.unique(steps).size > 10
    steps = relative_steps(operation(x, y), operation(x, noise.as_perturbed(y)))
    assert (steps >= 0.5 - ROUNDING / STEP).all() and np.unique(steps).size > 10


def test_slices_of_moved_arrays_and_what_is_made_of_them_are_moved_too():
    A = Noise(0).as_perturbed(np.eye(3))
    for part in (A[1:], A.T, A[:, 0], A + 1.0, 1.0 - A, A @ np.ones(3), np.ones(3) @ A):
        assert isinstance(part, PerturbedArray)
        assert part.noise is A.noise
    A += np.ones((3, 3))
    assert isinstance(A, PerturbedArray)
    assert np.array_equal(-A, -np.asarray(A)), "a change of sign is exact"


@pytest.mark.parametrize("shape", [(0,), (0, 0), (0, 3)])
def test_noise_leaves_empty_arrays_empty(shape):
    assert Noise(0).perturb(np.zeros(shape)).shape == shape


@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_without_noise_every_operation_is_what_it_is_in_python(kind):
    scene = kind.example()
    at = Evaluation(scene, *scene.initial_state())
    arguments = at.parameters, at.prepared, at.q, at.v
    found = replay(Noise(0, step=0.0), scene.terms, *arguments)
    for exact, part in zip(scene.terms(*arguments), found, strict=True):
        assert (exact is None) == (part is None)
        # Sums that a product of matrices adds up may be added in another order.
        assert exact is None or np.allclose(part, exact, rtol=1e-12, atol=1e-12 * largest(exact))


def test_what_was_listed_serves_other_numbers_and_other_noise():
    def function(x, y):
        return (x * y - y) / x + 2, y, np.zeros(2, x.dtype)

    x, y = np.random.default_rng(0).uniform(1, 2, (2, 30))
    moves = TraceRunner()
    replay(Noise(0), function, x, y, runner=moves)
    for again, fresh in zip(
        replay(Noise(1), function, y, x, runner=moves),
        replay(Noise(1), function, y, x),
        strict=True,
    ):
        assert np.array_equal(again, fresh)
    assert replay(Noise(0), function, x[:3], y[:3], runner=moves)[0].shape == (3,), "another list"


def test_a_function_that_is_not_rational_is_not_taken_for_one_the_second_time():
    moves = TraceRunner()
    for _ in range(2):
        with pytest.raises(TypeError):
            replay(Noise(0), np.sin, np.ones(3), runner=moves)


def test_a_moved_quotient_by_zero_is_no_number():
    assert np.isnan(replay(Noise(0), lambda x, y: x / y, np.ones(2), np.zeros(2))).all()


def test_what_is_listed_and_not_moved_has_the_bits_that_python_gives():
    def function(x, y, rates):
        return rate((duals(x, rates) * y - y) / (2 + y)), x / y - 1

    x, y, rates = np.random.default_rng(0).uniform(1, 2, (3, 30))
    for mine, exact in zip(
        TraceRunner().run_exact(function, x, y, rates),
        function(*as_objects((x, y, rates))),
        strict=True,
    ):
        assert np.array_equal(mine, exact.astype(float))


@pytest.mark.parametrize(("size", "calls"), [(FEWEST_COMPILED - 1, 3), (FEWEST_COMPILED, 1)])
def test_few_operations_are_done_by_python_and_many_by_their_list(size, calls):
    seen, moves = [], TraceRunner()

    def function(x):
        seen.append(x)
        return x * 3

    for _ in range(2):
        assert np.array_equal(moves.run_exact(function, np.ones(size)), np.full(size, 3.0))
    assert len(seen) == calls, "it is run once to be listed"


def test_lists_are_forgotten_by_the_places_that_all_of_them_have():
    moves, still = TraceRunner(), Noise(0, step=0.0)
    functions = [lambda x, i=i: x * i + x for i in range(2, 7)]
    for function in functions:
        replay(still, function, np.ones(3), runner=moves)
    each = [one.size for one in moves._known.values() if one]
    assert moves._size == sum(each)
    with patch("eomcheck.kernels.perturbed_trace.LARGEST_TOTAL", sum(each)):
        replay(still, functions[0], np.ones(4), runner=moves)
    assert moves._size == sum(one.size for one in moves._known.values() if one) <= sum(each)
    assert [key[0] for key in moves._known] == [*functions[2:], functions[0]]


def test_what_is_not_finite_unmoved_is_what_python_finds():
    with np.errstate(divide="ignore"):
        found = TraceRunner().run_exact(
            lambda x, y: x / y, np.ones(2 * FEWEST_COMPILED), np.zeros(2 * FEWEST_COMPILED)
        )
    assert np.isposinf(found).all()


def test_what_cannot_be_listed_is_run_unmoved_by_python():
    assert np.array_equal(TraceRunner().run_exact(np.sin, np.ones(3)), np.sin(np.ones(3)))


@pytest.mark.parametrize("branch", [lambda x: x if x[0] == 0 else -x, lambda x: x if x[0] else -x])
def test_a_function_that_branches_is_not_listed(branch):
    """Of numbers without a value one side of it would be taken for all states."""
    with pytest.raises(TypeError):
        replay(Noise(0), branch, np.ones(3))


def test_what_is_handed_in_does_not_move():
    x = np.ones(4)
    Noise(0).perturb(x)
    replay(Noise(0), lambda x: x * x, x)
    assert (x == 1).all()


def test_a_watch_with_noise_moves_the_matrices_that_are_solved():
    A, b = np.diag([1.0, 2.0, 4.0]), np.ones(3)
    exact = solve(A, b, "A")
    with recording_solves(Noise(0)):
        moved = solve(A, b, "A")
    assert 0 < np.abs(moved - exact).max() <= 3 * 2 * STEP
    assert np.array_equal(solve(A, b, "A"), exact)


def test_a_watch_with_noise_refuses_nothing():
    with recording_solves(Noise(0)):
        x = solve(np.zeros((2, 2)), np.ones(2), "A")
    assert x.shape == (2,)


def test_a_singular_matrix_among_several_has_no_solution():
    A, b = np.stack([np.eye(2), np.zeros((2, 2)), 2 * np.eye(2)]), np.ones((3, 2))
    for right in (b, b[..., None]):
        with recording_solves(NoiseBatch([Noise(seed, 0.0) for seed in range(3)])):
            x = solve(BatchArray(A), BatchArray(right), "A").data
        assert x.shape == right.shape
        assert np.isnan(x[1]).all()
        assert np.allclose(x[[0, 2]].reshape(2, 2), [[1, 1], [0.5, 0.5]])


# ---- What it measures ----------------------------------------------------------------------------

SNAKE = Snake([1.0, 2.0], [1.0, 0.5], [0.1, 0.2], [4.0], [0.125, -0.5])
Q = np.array([0.4, -0.2, 0.3, 1.1])


@pytest.fixture
def at() -> Evaluation:
    return Evaluation(SNAKE, Q, velocity(SNAKE, Q, [1.5, -0.75]))


def test_the_spread_of_a_number_read_is_between_its_size_and_twice_that(at):
    spread = sensitivity_of(at, lambda e: e.parameters.mass)
    assert spread * (1 + ROUNDING / STEP) >= 1.5 * 2.0
    assert spread <= 2 * 2.0 * (1 + ROUNDING / STEP)


def test_the_spread_of_a_constant_is_its_size(at):
    assert sensitivity_of(at, lambda e: np.array([3.0, -5.0])) == 5.0


def test_the_spread_of_a_product_adds_the_steps_of_its_factors(at):
    spread = sensitivity_of(at, lambda e: e.parameters.mass[0] ** 3)
    assert spread * (1 + 10 * STEP) >= 1 + 3 * 0.5
    assert spread <= (1 + 3) * (1 + 10 * STEP)


@pytest.mark.parametrize("exponent", range(1, 30, 4))
def test_the_spread_of_a_difference_is_that_of_its_terms_however_little_is_left(at, exponent):
    def cancellation(e: Evaluation):
        first, second = e.parameters.mass
        return first - second * (0.5 - 2.0**-exponent)

    left = 2.0 * 2.0**-exponent
    assert cancellation(at) == left
    # Each of two terms of size 1 moves by half a step to a whole one.
    spread = sensitivity_of(at, cancellation)
    assert spread <= left + 2 * (1 + ROUNDING / STEP)
    assert spread >= 1e-3


SEVERAL = {
    "F": lambda e: e.F,
    "u": lambda e: e.u,
    "W u": lambda e: e.velocity,
    "M v": lambda e: e.terms.M @ e.v,
    "bodies": lambda e: e.bodies.partial_velocity,
    "gw": lambda e: e.acceleration(FORMULATIONS["gw"]).vdot,
    "kane": lambda e: e.acceleration(FORMULATIONS["kane"]).vdot,
    "x": lambda e: e.x,
}


def test_the_spread_does_not_depend_on_what_was_asked_before(at):
    def spreads(names) -> dict[str, float]:
        here = Evaluation(at.scene, at.q, at.v)
        return {name: sensitivity_of(here, SEVERAL[name]) for name in names}

    alone = {name: spreads([name])[name] for name in SEVERAL}
    assert spreads(SEVERAL) == spreads(reversed(SEVERAL)) == alone


@pytest.mark.night
@pytest.mark.sampled(12)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_a_check_and_an_acceleration_state_one_bound_for_one_state(kind, monkeypatch):
    scene, seen = kind.example(), []

    def recorded(at, formulation, *arguments, **options):
        found = acceleration_sensitivity(at, formulation, *arguments, **options)
        if (arguments or ("vdot",)) == ("vdot",) and not any(options.values()):
            seen.append((at, formulation, found))
        return found

    monkeypatch.setattr(case, "acceleration_sensitivity", recorded)
    q, v = scene.initial_state()
    v = velocity(scene, q, np.random.default_rng(0).uniform(0.5, 1, scene.p)) if scene.p else v
    check_state(scene, q, v)
    judged = {f.key for at, f, found in seen if np.array_equal(at.v, v)}
    assert judged == {f.key for f in FORMULATIONS.values() if solves(scene, f.key, q, v)}
    for at, formulation, found in seen:
        bound = acceleration(at.scene, formulation.key, at.q, at.v, at.t).error_bound
        assert allowed_error(found) == bound


def solves(scene, key, q, v) -> bool:
    try:
        return acceleration(scene, key, q, v) is not None
    except (RefusedError, InputError):
        return False


class Tallied:
    """A number of no value that counts the operations it takes part in, those that round."""

    def __init__(self, tally: list[int]):
        self.tally = tally

    def counted(self, other=None):
        self.tally[0] += 1
        return self

    def added(self, other):
        return self if type(other) is int and other == 0 else self.counted()

    __add__ = __radd__ = __sub__ = added
    __neg__ = __truediv__ = __rtruediv__ = counted

    def __rsub__(self, other):
        return -self + other

    def __mul__(self, other):
        if type(other) is int and other in (0, 1):
            return self if other else 0
        return self.counted()

    __rmul__ = __mul__


def tallied_solve(A, b, name):
    # A, b, the backward error of each right-hand side, and the solution.
    tally = next(x.tally for x in (*A.flat, *b.flat) if isinstance(x, Tallied))
    tally[0] += A.size + 3 * b.size
    out = np.empty(b.shape, object)
    out.fill(Tallied(tally))
    return out


def tallied_product(A, B):
    tally = next(x.tally for x in (*A.flat, *B.flat) if isinstance(x, Tallied))
    out = np.empty((A.shape[0], B.shape[1]), object)
    out.fill(Tallied(tally))
    tally[0] += out.size
    return out


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", FORMULATIONS)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_every_operation_of_every_formulation_is_moved(kind, key, monkeypatch):
    """As many changes are taken as operations are done, whole matrices entry by entry."""
    for table, count in (
        (SOLVERS, tallied_solve),
        (BANDED_SOLVERS, tallied_solve),
        (PRODUCTS, tallied_product),
    ):
        monkeypatch.setitem(table, Tallied, count)
    scene, formulation = kind.example(), FORMULATIONS[key]
    if not formulation.applies_to(scene):
        return
    q, v = scene.initial_state()
    q = q + 0.1  # away from a singular partition
    at, tally, counted = Evaluation(scene, q, v), [0], []

    def tallied(function, *arguments):
        def number(x):
            if not isinstance(x, np.ndarray) or x.dtype != np.float64:
                return x
            out = np.empty(x.shape, object)
            out.fill(Tallied(tally))
            return out

        if function is formulation.solution:
            function(*map_record(number, arguments))
            counted.append(tally[0])
        return Evaluation.call(at, function, *arguments)

    monkeypatch.setattr(at, "call", tallied)
    at.solution(formulation)
    together = perturbed_samples(Evaluation(scene, q, v))
    taken, inside = [], together.call

    def taking(function, *arguments):
        before = together.noise.position.taken
        result = inside(function, *arguments)
        if function is formulation.solution:
            taken.append(together.noise.position.taken - before)
        return result

    monkeypatch.setattr(together, "call", taking)
    together.acceleration(formulation)
    assert counted == taken
    assert taken[0] > 0


def test_the_spread_is_the_same_every_time(at):
    again = Evaluation(at.scene, at.q, at.v)
    for formulation in FORMULATIONS.values():
        assert acceleration_sensitivity(at, formulation) == acceleration_sensitivity(
            again, formulation
        )


def test_coordinates_move_only_on_request(at):
    assert sensitivity_of(at, lambda e: e.q) == largest(Q)
    assert sensitivity_of(at, lambda e: e.q, coordinates=True) >= 1.5 * largest(Q) * (
        1 - ROUNDING / STEP
    )
    for everywhere in (False, True):
        assert perturbed_samples(at, everywhere).count == SAMPLES + 1, "one is stretched"


def test_a_quantity_that_a_moved_evaluation_refuses_has_an_infinite_spread(at):
    def refuses(e: Evaluation):
        if e is not at:
            raise RefusedError("A", 0.0, 0.0, "no")
        return np.ones(1)

    assert sensitivity_of(at, refuses) == float("inf")


@pytest.mark.parametrize("exponent", range(2, 24, 3))
def test_the_spread_of_a_solution_grows_with_the_condition_number(at, exponent):
    """Two unknowns, two rows that are almost parallel: κ = 4 · 2^exponent, about."""
    A = np.array([[1.0, 1.0], [1.0, 1.0 + 2.0**-exponent]])
    kappa = np.linalg.cond(A, np.inf)

    def solution(e: Evaluation):
        with e.recording_solves():
            return solve(A, np.array([1.0, 2.0]), "A")

    x = solution(at)
    spread = sensitivity_of(at, solution)
    # |δx| / |x| <= κ h / (1 - κ h) from the entries of the matrix, as much again or twice from
    # elimination, and h from the right-hand side and from the solution.
    assert spread <= largest(x) * (3 + 3 * kappa / (1 - 4 * kappa * STEP))
    # Each δA moves det A, which is all that is left of two products, by h/2 or more as a rule.
    assert spread >= largest(x) * kappa * 1e-2


def near_parallel(exponent: int) -> tuple[Snake, np.ndarray, np.ndarray]:
    snake = Snake([1.0, 2.0], [1.0, 2.0], [0.1, 0.2], [3.0], [0.25, 0.0])
    q = np.array([0.0, 0.0, 0.5, 0.75 + 10.0**-exponent])
    return snake, q, velocity(snake, q, [1.0, 0.5])


def error_bound(key: str, exponent: int) -> float:
    snake, q, v = near_parallel(exponent)
    return acceleration(snake, key, q, v).error_bound


def test_the_error_bound_of_elimination_grows_as_the_wheels_of_two_links_become_parallel():
    bounds = [error_bound("el", exponent) for exponent in (1, 3, 5, 7)]
    assert all(10 * first < second for first, second in pairwise(bounds))
    assert max(error_bound("au", exponent) for exponent in (1, 3, 5, 7)) < bounds[1]


@pytest.mark.parametrize("which", range(SAMPLES))
@pytest.mark.parametrize(
    ("name", "there"), [("log_determinant", 7.0), ("log_determinant", np.nan), ("sign", 0.0)]
)
def test_a_determinant_that_jumps_in_a_moved_evaluation_makes_the_spread_infinite(
    at, name, there, which
):
    au = FORMULATIONS["au"]
    assert acceleration_sensitivity(at, au) < np.inf
    getattr(perturbed_samples(at).solves[au.key, False]["M_Au"], name)[which] = there
    assert acceleration_sensitivity(at, au) == np.inf


@pytest.mark.parametrize("which", range(SAMPLES + 1))
def test_a_moved_evaluation_without_an_answer_makes_the_spread_infinite(at, which):
    moved = BatchArray(np.where(np.arange(SAMPLES + 1) == which, np.nan, 1.0))
    assert sensitivity_of(at, lambda e: 1.0 if e is at else moved) == np.inf


def test_a_result_without_a_certain_digit_has_an_infinite_error_bound():
    for exponent in range(8, 16):
        snake, q, v = near_parallel(exponent)
        try:
            result = acceleration(snake, "el", q, v)
        except RefusedError:
            continue
        if allowed_error(1 / min(result.rcond.values())) > INCONCLUSIVE:
            assert result.error_bound == float("inf")
            return
    pytest.fail("no such state")


# ---- The tolerance -------------------------------------------------------------------------------


def test_what_is_allowed_is_proportional_to_the_spread():
    assert allowed_error(1.0) == C * EPS
    assert allowed_error(0.0) == 0.0
    assert allowed_error(float("inf")) == float("inf")


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False)))
def test_largest_is_the_largest_magnitude(x):
    expected = max((abs(y) for y in x), default=0.0)
    for y in (x, np.array(x), np.array(x, object), np.array(x).reshape(-1, 1)):
        assert largest(y) == expected
    assert largest_of_each(np.array([x, x[::-1]])).tolist() == [expected, expected]


def test_largest_of_each_is_that_of_each():
    x = np.arange(12.0).reshape(3, 2, 2) - 5
    assert largest_of_each(x).tolist() == [5.0, 2.0, 6.0]
    assert largest_of_each(np.zeros((3, 0))).tolist() == [0.0, 0.0, 0.0]
    assert largest_of_each(np.array([1.0, -2.0])).tolist() == [1.0, 2.0]


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
def test_largest_is_infinite_where_anything_is_not_finite(bad):
    assert largest([1.0, bad, 2.0]) == largest(np.array([1.0, bad, 2.0])) == float("inf")
    assert largest_of_each(np.array([[1.0, bad], [-3.0, 2.0]])).tolist() == [float("inf"), 3.0]
