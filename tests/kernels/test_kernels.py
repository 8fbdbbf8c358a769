"""Machine code: it says what the public path says, in any number of lanes, and never raises."""

from __future__ import annotations

import ctypes
import math
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import flint
import numpy as np
import pytest
from tests.machine_code import MachineCode, in_machine_code
from tests.samples import ordinary

from eomcheck import acceleration, velocity
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.scene_quantities import net_force
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.kernels import llvm, sincos
from eomcheck.kernels.kernel import HEADER, Kernel, layout_of
from eomcheck.kernels.program import (
    FEW_ANGLES,
    NotRegularError,
    Program,
    extrapolate_program,
    program_of,
)
from eomcheck.mechanics.records import velocity_from_speeds as velocity_of_speeds
from eomcheck.mechanics.scene import Scene
from eomcheck.motion import right_hand_side
from eomcheck.motion.observables import solves_of
from eomcheck.motion.right_hand_side import (
    MANY_LINKS,
    SHORTER,
    RightHandSide,
    exact_jacobian,
    kernel_of,
    parameter_arrays,
    state_of,
    trace_rates,
)
from eomcheck.numbers import tape as tapes
from eomcheck.numbers.banded_solve import WIDTH, solve_banded
from eomcheck.numbers.generic import Array, NotRationalError
from eomcheck.numbers.linear import EPS, solve
from eomcheck.numbers.tape import Tape
from eomcheck.scenes import SCENES, Sleigh, Snake

every_formulation = pytest.mark.parametrize("key", FORMULATIONS)
PARTITIONED = [f.key for f in FORMULATIONS.values() if f.partitioned]
WIDTHS = (2, 4, 8)


def uneven(links: int, springs: bool) -> Snake:
    random = np.random.default_rng(links)

    def between(low: float, high: float, size: int) -> np.ndarray:
        return random.uniform(low, high, size)

    return Snake(
        between(0.5, 2.0, links),
        between(0.5, 2.0, links),
        between(0.1, 0.5, links),
        between(1.0, 50.0, links - 1) if springs else None,
        between(-0.5, 0.5, links),
        between(-0.7, 0.7, links),
    )


SNAKES = [
    uneven(1, springs=False),
    uneven(2, springs=True),
    uneven(2, springs=False),
    uneven(7, springs=True),
    uneven(7, springs=False),
    Snake.paper(),
]
snakes = pytest.mark.parametrize(
    "snake", SNAKES, ids=lambda s: f"{s.links}-{'free' if s.stiffness is None else 'springs'}"
)


def state(snake: Snake) -> tuple[Array, Array]:
    q, _ = snake.initial_state()
    return q, velocity(snake, q, [1.5, -0.5])


def state_vector(at: Evaluation, key: str) -> Array:
    """Return what a formulation integrates."""
    formulation = FORMULATIONS[key]
    speeds = at.speeds_read(formulation)
    if formulation.state == "q, v2":
        speeds = speeds[at.partition.independent]
    integrals = np.zeros(at.scene.r if formulation.state == "q, v, μ" else 0)
    return np.concatenate((at.q, speeds, integrals))


def rate(snake: Snake, key: str, q: Array, v: Array) -> tuple[Array, Array]:
    """Return (q̇, rate of the speeds) by machine code, speeds being v, v2, u or x."""
    y = state_vector(Evaluation(snake, q, v), key)
    rates = RightHandSide(snake, FORMULATIONS[key])(0.0, y)
    integrals = snake.r if FORMULATIONS[key].state == "q, v, μ" else 0
    return rates[: snake.n], rates[snake.n : rates.size - integrals]


# ---- What the public path says -------------------------------------------------------------------


@pytest.mark.sampled(8)
@pytest.mark.parametrize("key", FORMULATIONS)
@snakes
def test_machine_code_gives_the_acceleration_of_the_public_path(snake, key):
    q, v = state(snake)
    expected = acceleration(snake, key, q, v)
    qdot, found = rate(snake, key, q, v)
    at, vdot = Evaluation(snake, q, v), expected.vdot
    if FORMULATIONS[key].in_speeds:
        found = at.speeds.W @ found + at.speeds.rest
    elif FORMULATIONS[key].uses == "chain":
        found = snake.chain_acceleration(at.parameters, at.prepared, at.x, found)
    elif FORMULATIONS[key].state == "q, v2":
        vdot = vdot[at.partition.independent]
    assert np.abs(found - vdot).max() <= 2 * expected.error_bound
    assert expected.error_bound < 1e-6
    assert np.abs(qdot - v).max() <= allowed_error(sensitivity_of(at, lambda e: e.velocity))


@snakes
def test_scene_functions_give_in_machine_code_what_they_give_in_python(snake):
    q, v = state(snake)
    at = Evaluation(snake, q, v)
    here = (at.parameters, at.prepared)
    kinematics = snake.kinematics(*here, at.q, at.u)
    for name, arguments in {
        "terms": (*here, at.q, at.v),
        "kinematics": (*here, at.q, at.u),
        "speeds": (*here, kinematics),
        "bodies": (*here, kinematics),
        "velocities": (*here, at.q, at.v),
        "energies": (*here, at.q, at.v),
    }.items():
        function = getattr(snake, name)
        fields = zip(function(*arguments), in_machine_code(function, *arguments), strict=True)
        for i, (expected, found) in enumerate(fields):
            assert (expected is None) == (found is None), (name, i)
            if expected is not None:
                rounding = snake.n * max(1.0, np.abs(expected).max(initial=0.0))
                spread = allowed_error(rounding * np.linalg.norm(at.speeds.W, 1))
                assert np.shape(found) == np.shape(expected), (name, i)
                assert np.abs(found - expected).max(initial=0.0) <= spread, (name, i)


@pytest.mark.sampled(2)
@every_formulation
def test_a_kernel_is_made_once_for_all_snakes_of_one_structure(key):
    formulation, scene = FORMULATIONS[key], SNAKES[3]
    other = replace(scene, mass=2 * scene.mass, stiffness=3 * scene.stiffness, pose=None)
    made = kernel_of(scene, formulation)
    assert kernel_of(other, formulation) is made
    for different in (SNAKES[1], SNAKES[4]):  # in links; in terms
        assert kernel_of(different, formulation) is not made
    assert kernel_of(scene, formulation, width=2) is not made


def test_of_many_kernels_those_that_were_used_last_are_kept(monkeypatch):
    monkeypatch.setattr(right_hand_side, "_kernels", {})
    monkeypatch.setattr(right_hand_side, "CACHED_KERNELS", 2)
    scene, (first, second, third) = Sleigh(), (FORMULATIONS[key] for key in ("kane", "ml", "au"))
    made = kernel_of(scene, first)
    lost = kernel_of(scene, second)
    assert kernel_of(scene, first) is made
    kernel_of(scene, third)
    assert len(right_hand_side._kernels) == 2
    assert kernel_of(scene, first) is made
    assert kernel_of(scene, second) is not lost


@pytest.mark.parametrize("links", [2, 3, 7])
@pytest.mark.parametrize("key", PARTITIONED)
def test_at_a_singular_pose_machine_code_gives_nan_and_does_not_raise(key, links):
    one = np.ones(links)
    snake = Snake(one, one, one, one[1:], 0 * one)
    q = np.array([0.0, 0.0, *[0.3] * links])
    v = velocity(snake, q, [1.0, 0.0])
    with pytest.raises(RefusedError):
        acceleration(snake, key, q, v)
    qdot, vdot = rate(snake, key, q, v)
    # With v2 alone in the state, v itself is what a singular matrix tells.
    assert np.array_equal(qdot, v) or (FORMULATIONS[key].state == "q, v2" and np.isnan(qdot).any())
    assert np.isnan(vdot).any()


@every_formulation
def test_machine_code_does_not_raise_on_nan(key):
    snake = SNAKES[1]
    q, v = state(snake)
    y = state_vector(Evaluation(snake, q, v), key)
    y[2] = np.nan
    speeds = RightHandSide(snake, FORMULATIONS[key])(0.0, y)[snake.n :]
    assert np.isnan(speeds).all()


@every_formulation
def test_calls_and_those_that_are_not_finite_are_counted_with_the_time_of_the_first(key):
    snake = SNAKES[1]
    y = state_vector(Evaluation(snake, *state(snake)), key)
    bad = np.where(np.arange(y.size) == 2, np.inf, y)
    rates = RightHandSide(snake, FORMULATIONS[key])
    assert np.isnan(rates.failure_time)
    for t, x in ((0.5, y), (0.75, bad), (1.0, y), (1.25, bad)):
        rates(t, x)
    assert (rates.calls, rates.failed, rates.failure_time) == (4, 2, 0.75)
    rates.reset()
    assert (rates.calls, rates.failed) == (0, 0)
    assert np.isnan(rates.failure_time)


# ---- Absent terms --------------------------------------------------------------------------------


def call_net_force(M, Q, B):
    return net_force(M, Q, B)


def call_velocity(u, W, offset):
    return velocity_of_speeds(u, W, offset)


def in_every_way(function, caller):
    ways = {
        "python": function,
        "machine code": lambda *x: in_machine_code(function, *x),
        "called in machine code": lambda *x: in_machine_code(caller, *x),
    }
    return pytest.mark.parametrize("function", ways.values(), ids=ways.keys())


@in_every_way(net_force, call_net_force)
def test_the_net_force_leaves_out_what_is_absent(function):
    M, Q, B = np.eye(2), np.array([1.0, 2.0]), np.array([0.5, -1.0])
    assert function(M, Q, B).tolist() == [0.5, 3.0]
    assert function(M, None, B).tolist() == [-0.5, 1.0]
    assert function(M, Q, None).tolist() == [1.0, 2.0]
    assert function(M, None, None).tolist() == [0.0, 0.0]


@in_every_way(velocity_of_speeds, call_velocity)
def test_the_velocity_leaves_out_what_is_absent(function):
    W, u = np.array([[1.0], [2.0]]), np.array([3.0])
    assert function(u, None, None).tolist() == [3.0]
    assert function(u, W, None).tolist() == [3.0, 6.0]
    assert function(u, W, np.array([1.0, -1.0])).tolist() == [4.0, 5.0]


@every_formulation
def test_an_absent_term_leaves_no_operation_on_the_tape(key):
    scene = SNAKES[3]
    free = replace(scene, stiffness=None)
    with_springs, without = (trace_rates(x, FORMULATIONS[key]) for x in (scene, free))
    names = {op.x for op in with_springs.tape.operations if op.op is tapes.INPUT}
    assert names - {op.x for op in without.tape.operations if op.op is tapes.INPUT} == {"stiffness"}
    assert operations(without.tape) < operations(with_springs.tape)


# ---- Tapes ---------------------------------------------------------------------------------------


def operations(tape: Tape) -> int:
    """Return how many operations stand on a tape."""
    return sum(op.op not in (tapes.CONSTANT, tapes.INPUT, tapes.PART) for op in tape.operations)


SAME = {
    "x + 0": lambda x, y: (x + 0, x),
    "0 + x": lambda x, y: (0 + x, x),
    "x - 0": lambda x, y: (x - 0.0, x),
    "0 - x": lambda x, y: (0 - x, -x),
    "1 x": lambda x, y: (1 * x, x),
    "x 1": lambda x, y: (x * 1.0, x),
    "-1 x": lambda x, y: (-1 * x, -x),
    "x / 1": lambda x, y: (x / 1, x),
    "x / 4": lambda x, y: (x / 4, 0.25 * x),
    "0 x": lambda x, y: (0 * x, x * 0),
    "0 / x": lambda x, y: (0 / x, 0.0 * y),
    "-(-x)": lambda x, y: (0 - (-x), x),
    "x + y": lambda x, y: (x + y, y + x),
    "x y": lambda x, y: (x * y, y * x),
    "x + (-y)": lambda x, y: (x + (-y), x - y),
    "x - (-y)": lambda x, y: (x - (-y), x + y),
    "(-x) y": lambda x, y: ((-x) * y, -(x * y)),
    "x / (-y)": lambda x, y: (x / (-y), -(x / y)),
    "x^2": lambda x, y: (x**2, x * x),
    "2 + 3": lambda x, y: ((0 * x + 2) + 3, 0 * y + 5.0),
    "cos 0": lambda x, y: ((0 * x).cos(), 0 * x + 1),
}


@pytest.mark.parametrize("name", SAME)
def test_what_changes_nothing_is_left_out_and_what_is_equal_is_one(name):
    tape = Tape()
    x, y = tape.inputs("a", (2,))
    one, other = SAME[name](x, y)
    assert one.index == other.index


def test_equal_solves_and_equal_angles_are_one_group():
    tape = Tape()
    x = tape.inputs("a", (2,))
    A = np.array([[x[0], x[1]], [x[1], 2 * x[0]]])
    first, again = solve(A, x, "A"), solve(A.copy(), x.copy(), "A")
    assert [y.index for y in first] == [y.index for y in again]
    assert len(tape.groups) == 2  # the factors of A, and what they solve
    solve(A, 2 * x, "A")
    assert len(tape.groups) == 3
    assert tape.angles(x).sin[1].index == tape.angles(x).sin[1].index
    assert len(tape.groups) == 4


def test_constants_are_computed_at_once_and_round_as_doubles_do():
    tape = Tape()
    third = tape.constant(1.0) / 3
    assert tape.value((third + 0.1).index) == 1 / 3 + 0.1
    assert tape.value(third.sqrt().index) == math.sqrt(1 / 3)
    assert tape.value((tape.constant(1.0) / tape.constant(0.0)).index) == math.inf
    assert operations(tape) == 0


def test_a_number_on_a_tape_is_no_double_and_cannot_be_compared():
    x = Tape().inputs("a", (1,))[0]
    for branch in (
        lambda: x > 0,
        lambda: x == 0,
        lambda: bool(x),
        lambda: abs(x),
        lambda: float(x),
    ):
        with pytest.raises(NotRationalError):
            branch()


class Branching(SCENES["sleigh"]):
    """A sleigh whose functions ask on which side of the y axis it is."""

    key = "branching"

    @staticmethod
    def terms(parameters, prepared, q, v):
        terms = SCENES["sleigh"].terms(parameters, prepared, q, v)
        return terms if q[0] > 0 else terms._replace(M=2 * terms.M)


def test_a_scene_whose_function_branches_on_a_value_is_refused():
    scene, (q, v, _) = ordinary(SCENES["sleigh"])
    branching = Branching(*(getattr(scene, name) for name in type(scene).ranges(None)))
    assert np.isfinite(acceleration(branching, "au", q, v).vdot).all()
    with pytest.raises(NotRationalError):
        kernel_of(branching, FORMULATIONS["au"])


# ---- Programs ------------------------------------------------------------------------------------


def loops(program: Program) -> int:
    return sum(item[0] == "loop" for item in program.items)


@pytest.mark.night
@pytest.mark.sampled(8)
@pytest.mark.parametrize("links", [MANY_LINKS + i for i in range(1, SHORTER[1] + 1)])
@pytest.mark.parametrize("key", [f.key for f in FORMULATIONS.values() if f.linear])
def test_the_program_of_a_long_chain_continues_those_of_short_ones(key, links):
    formulation = FORMULATIONS[key]
    for place in range(len(list(Snake.structures(2)))):

        def program(count: int, place: int = place) -> Program:
            scene = list(Snake.structures(count))[place]
            traced = trace_rates(scene, formulation)
            return program_of(traced.tape, traced.outputs, short=0)

        first, step = SHORTER
        first += (links - first) % step
        found = extrapolate_program(program, links, first, step)
        assert loops(found) > 0
        assert found == program(links)


def test_programs_that_follow_no_pattern_are_not_continued():
    def squares(count: int) -> Program:
        return Program((("put", ("constant", 1.0), "out", count * count, 0),), ())

    def steady(count: int) -> Program:
        return Program((("put", ("constant", 1.0), "out", 3 * count, 0),), ())

    def growing(count: int) -> Program:
        return Program((("put", ("constant", 1.0), "out", 0, 0),) * count, ())

    assert extrapolate_program(steady, 9, 1, 2) == steady(9)
    for programs, size in ((squares, 9), (growing, 9), (steady, 10)):
        with pytest.raises(NotRegularError):
            extrapolate_program(programs, size, 1, 2)


def compiled(
    scene: Scene, key: str, short: int | None = None, width: int = 1
) -> tuple[Kernel, Callable[[Array, Array], Array]]:
    """Return a kernel of rates made anew, and the function of it (t, y)."""
    traced = trace_rates(scene, FORMULATIONS[key])
    how = {} if short is None else {"short": short}
    program = program_of(traced.tape, traced.outputs, **how)
    given = {name: x.ravel() for name, x in parameter_arrays(scene).items()}
    sizes = {name: x.size for name, x in given.items()}
    kernel = Kernel(program, sizes, {"rates": len(traced.outputs["rates"])}, width)
    block = kernel.block(given)
    return kernel, lambda t, y: kernel(block, t, y)["rates"]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("width", [1, 4])
@every_formulation
def test_code_with_loops_has_the_bits_of_straight_code(key, width):
    scene = uneven(30 if FORMULATIONS[key].linear else 10, springs=True)
    y = state_vector(Evaluation(scene, *state(scene)), key)
    y = y if width == 1 else y[:, None] * np.linspace(1.0, 1.2, width)
    t = np.zeros(width)
    traced = trace_rates(scene, FORMULATIONS[key])
    assert loops(program_of(traced.tape, traced.outputs, short=0)) > 0
    _, rolled = compiled(scene, key, 0, width)
    _, straight = compiled(scene, key, 10**9, width)
    assert rolled(t, y).tobytes() == straight(t, y).tobytes()


@pytest.mark.parametrize("key", [f.key for f in FORMULATIONS.values() if f.linear])
def test_what_goes_along_a_chain_is_read_and_written_once(key):
    scene = uneven(30, springs=True)
    traced = trace_rates(scene, FORMULATIONS[key])
    program = program_of(traced.tape, traced.outputs, short=0)
    long = [len(item[2]) for item in program.items if item[0] == "loop"]
    assert sorted(long)[-2] < 8 < 64 <= max(long)
    kept = [name for name in layout_of(program, {}).offsets if name.startswith("l")]
    assert len(kept) <= 5  # what is summed up after all else was


# ---- Bands ---------------------------------------------------------------------------------------


def hostile_band(size: int) -> tuple[Array, Array]:
    """Return rows of a band of every size, some so small that they are scaled as far as can be."""
    random = np.random.default_rng(size)
    bands, b = random.uniform(-1, 1, (size, WIDTH)), random.uniform(-1, 1, size)
    units = 10.0 ** random.uniform(-20, 20, size)
    units[:: size // 12] = 1e-310
    return bands * units[:, None], b * units


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [*range(65, 73), 120])
def test_a_band_of_any_length_in_memory_is_solved_to_the_rounding_of_each_row(size):
    bands, b = hostile_band(size)
    x = MachineCode(lambda A, b: solve_banded(A, b, "A"), bands, b)(bands, b)
    columns = np.arange(size)[:, None] + np.arange(-3, 4)
    bands[(columns < 0) | (columns >= size)] = 0.0
    terms = bands * x[np.clip(columns, 0, size - 1)]
    rounding = 10 * EPS * (np.abs(terms).sum(axis=1) + np.abs(b))
    assert (np.abs(b - terms.sum(axis=1)) <= rounding + 1e-322).all()  # or lost to underflow


# ---- Lanes ---------------------------------------------------------------------------------------


def bits(x: Array) -> bytes:
    """Return the bits of x, where all NaN are one."""
    return np.where(np.isnan(x), np.nan, x).tobytes()


def assert_lanes_are_single_runs(scene: Scene, key: str, at: Evaluation, width: int) -> None:
    """Assert the same bits for different states, times and parameters side by side."""
    formulation = FORMULATIONS[key]
    single, wide = (kernel_of(scene, formulation, width=w) for w in (1, width))
    grow = 1.0 + 0.01 * np.arange(width)
    y = state_vector(at, key)[:, None] * grow
    y[:, -1] = np.nan if width > 2 else y[:, -1]  # what one lane cannot do the others do
    t = at.t + 0.1 * np.arange(width)
    given = {name: x.ravel()[:, None] * grow for name, x in parameter_arrays(scene).items()}
    found = wide(wide.block(given), t, y)["rates"]
    for lane in range(width):
        block = single.block({name: x[:, lane] for name, x in given.items()})
        alone = single(block, t[lane], y[:, lane])["rates"]
        assert bits(alone) == bits(found[:, lane]), lane
        assert np.isfinite(alone).all() == (width == 2 or lane < width - 1)


@pytest.mark.sampled(16)
@pytest.mark.parametrize("links", range(1, 13))
@every_formulation
def test_lanes_of_a_snake_have_the_bits_of_single_runs(key, links):
    scene = uneven(links, springs=links > 1)
    width = WIDTHS[(links + list(FORMULATIONS).index(key)) % len(WIDTHS)]
    assert_lanes_are_single_runs(scene, key, Evaluation(scene, *state(scene)), width)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("kind", SCENES.values(), ids=SCENES)
def test_lanes_of_every_scene_have_the_bits_of_single_runs(kind):
    scene, (q, v, t) = ordinary(kind)
    for place, key in enumerate(applicable(kind)):
        at = Evaluation(scene, q, v, t)
        assert_lanes_are_single_runs(scene, key, at, WIDTHS[place % len(WIDTHS)])


# ---- Memory --------------------------------------------------------------------------------------

GUARD = -123.456


class Guarded:
    """Doubles with guards before and behind them, which a kernel must leave alone."""

    def __init__(self, x: Array, margin: int = 64):
        self.whole = np.full(x.size + 2 * margin, GUARD)
        self.inside = self.whole[margin : margin + x.size]
        self.inside[:] = x.ravel()
        self.guards = self.whole[:margin], self.whole[margin + x.size :]

    @property
    def address(self) -> int:
        return self.inside.ctypes.data

    def assert_guarded(self) -> None:
        for guard in self.guards:
            assert (guard == GUARD).all()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("width", [1, 4])
@pytest.mark.parametrize("links", [1, 3, 12])
@every_formulation
def test_a_call_writes_its_outputs_and_its_room_and_nothing_else(key, links, width):
    scene = uneven(links, springs=links > 1)
    kernel = kernel_of(scene, FORMULATIONS[key], width=width)
    given = {name: x.ravel() for name, x in parameter_arrays(scene).items()}
    y = state_vector(Evaluation(scene, *state(scene)), key)
    y, t = np.repeat(y, width), np.zeros(width)
    out, at, when = Guarded(np.full(kernel.size * width, GUARD)), Guarded(y), Guarded(t)
    block = Guarded(kernel.block(given))
    before = block.inside.copy()
    where = np.array([block.address], np.uintp)
    kinds = ctypes.c_void_p, ctypes.c_double if width == 1 else ctypes.c_void_p
    function: Any = ctypes.CFUNCTYPE(None, *kinds, ctypes.c_void_p, ctypes.c_void_p)(kernel.address)
    if width == 1:
        function(out.address, 0.0, at.address, where.ctypes.data)
    else:
        function(out.address, when.address, at.address, block.address)
    for memory in (out, at, when, block):
        memory.assert_guarded()
    assert (out.inside != GUARD).all()
    assert np.isfinite(out.inside).all()
    assert np.array_equal(at.inside, y)
    assert np.array_equal(when.inside, t)
    parameters = slice(HEADER, HEADER + width * sum(kernel.parameters.values()))
    assert np.array_equal(block.inside[parameters], before[parameters])


# ---- Angles --------------------------------------------------------------------------------------


def cosines_and_sines(tape_angles):
    made = Tape.angles(tape_angles[0].tape, tape_angles)
    return made.cos, made.sin


def machine_angles(x: Array, width: int = 1) -> tuple[Array, Array]:
    """Return (cos x, sin x) by machine code of `width` lanes, x (k,) or (k, lanes)."""
    return MachineCode(cosines_and_sines, x[:, 0] if width > 1 else x, width=width)(x)


def ulps(found: Array, x: Array, function: str) -> float:
    """Return the largest error in units of the last place of the true values, by balls."""
    worst = 0.0
    flint.ctx.prec, before = 300, flint.ctx.prec
    try:
        for y, angle in zip(found, x, strict=True):
            truth = getattr(flint.arb(float(angle)), function)()
            error = abs(flint.arb(float(y)) - truth) / math.ulp(float(truth))
            worst = max(worst, float(error))
    finally:
        flint.ctx.prec = before
    return worst


def hard_angles() -> Iterator[float]:
    """Yield angles of every size up to the reach, and those next to multiples of π/2."""
    random = np.random.default_rng(0)
    yield from random.uniform(-1, 1, 500) * 10.0 ** random.uniform(-300, 0, 500)
    yield from random.uniform(-10, 10, 1000)
    yield from random.uniform(-1, 1, 1000) * sincos.REACH
    for k in (*range(1, 200), *random.integers(200, int(sincos.REACH / 1.6), 800).tolist()):
        near = k * math.pi / 2
        yield near
        yield math.nextafter(near, 0.0)
        yield -math.nextafter(near, math.inf)
    yield from (0.0, -0.0, 5e-324, -2.2e-308, sincos.REACH, -sincos.REACH)


@pytest.mark.parametrize("width", [1, 4])
def test_cosines_and_sines_are_within_an_ulp_of_the_true_ones(width):
    x = np.array(list(hard_angles()))
    x = x[: len(x) // width * width]
    found = machine_angles(x.reshape(-1, width) if width > 1 else x, width)
    for function, values in zip(("cos", "sin"), found, strict=True):
        assert ulps(values.ravel(), x, function) < 1.0


@pytest.mark.sampled(3)
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, FEW_ANGLES, FEW_ANGLES + 1, 30, 33])
def test_an_angle_has_the_same_bits_however_many_others_there_are(count):
    x = np.random.default_rng(count).uniform(-20, 20, count)
    found = machine_angles(x)
    for i, angle in enumerate(x):
        alone = machine_angles(np.array([angle]))
        assert [y[i] for y in found] == [y[0] for y in alone]
    lanes = np.array([x, x + 1.0]).T
    cos, sin = machine_angles(lanes, 2)
    assert np.array_equal(cos[:, 0], found[0])
    assert np.array_equal(sin[:, 0], found[1])


@pytest.mark.parametrize("width", [1, 4])
def test_large_angles_are_those_of_the_c_library_and_those_not_finite_are_nan(width):
    x = np.array([1.1e5, -1e8, 1e22, 1e300])
    x = np.repeat(x[:, None], width, axis=1).squeeze()
    cos, sin = machine_angles(x, width)
    assert cos.ravel().tolist() == [math.cos(t) for t in x.ravel()]
    assert sin.ravel().tolist() == [math.sin(t) for t in x.ravel()]
    bad = np.array([np.nan, np.inf, -np.inf, 0.5, 1e6])
    bad = np.repeat(bad[:, None], width, axis=1).squeeze()
    for values, here in zip(machine_angles(bad, width), (math.cos, math.sin), strict=True):
        assert np.isnan(values[:3]).all()
        assert np.abs(values[3] - here(0.5)).max() < 1e-15
        assert (values[4] == here(1e6)).all()


# ---- Machines ------------------------------------------------------------------------------------

X86 = platform.machine().lower() in ("x86_64", "amd64")
MACHINES = {
    "x86-64-v3": ("x86-64-v3", "", True),
    "haswell, vectors of 4 doubles": ("haswell", "+prefer-256-bit", True),
    "x86-64-v2, without FMA": ("x86-64-v2", "", False),
    "x86-64, without FMA": ("x86-64", "", False),
}


@pytest.mark.sampled(9)
@pytest.mark.skipif(not X86, reason="machines of this kind are x86-64")
@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("name", MACHINES)
def test_code_for_another_machine_works_and_with_fma_has_the_bits_of_this_one(
    name, width, monkeypatch
):
    fused = MACHINES[name][2]
    scene = uneven(3, springs=True)
    at = Evaluation(scene, *state(scene))
    found: list[list[Array]] = []
    if fused and not llvm.has_fma():
        pytest.skip("this machine cannot multiply and add at once")
    for other in (None, MACHINES[name]):
        if other is not None:
            monkeypatch.setattr(llvm, "cpu_features", lambda other=other: other)
        found.append([])
        for key in ("au", "el", "kane", "banded"):
            y = np.repeat(state_vector(at, key)[:, None], width, axis=1).squeeze()
            found[-1].append(compiled(scene, key, width=width)[1](np.zeros(width), y))
    for here, there in zip(*found, strict=True):
        if fused:
            assert here.tobytes() == there.tobytes()
        else:
            assert np.abs(here - there).max() <= 1e-11 * np.abs(here).max()


# ---- Processes -----------------------------------------------------------------------------------

MOVED = """
import eomcheck
from eomcheck.scenes import Snake
found = eomcheck.simulate(Snake.paper(), "kane", 0.01)
assert found.status == "finished", found.reason
"""
LOOKED_AT = """
from eomcheck.scenes import Sleigh
findings = eomcheck.validate(Sleigh.example(), examples=1)
assert "failed" not in {f.verdict for f in findings}
"""
LOADED = "import sys; print({'numba', 'llvmlite'} & set(sys.modules))"


def run(code: str, **how: Any) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, **how)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("code", "loaded"),
    [("import eomcheck", "set()"), (MOVED, "{'llvmlite'}"), (MOVED + LOOKED_AT, "{'llvmlite'}")],
    ids=["import", "simulate", "validate"],
)
@pytest.mark.sampled(3)
def test_nothing_imports_numba(code, loaded):
    assert run(f"{code}\n{LOADED}") == loaded


def nobody() -> dict[str, Any]:
    """Return how to run a process as somebody who owns nothing; as oneself where one may not."""
    how = {"user": 65534, "group": 65534, "extra_groups": []}
    if os.name == "nt" or os.geteuid() != 0:
        return {}
    try:
        run("import eomcheck", **how)
    except (AssertionError, OSError):
        return {}  # the package is out of sight of others
    return how


@pytest.mark.night
def test_a_motion_needs_no_place_to_write(tmp_path):
    away = {"HOME": "/nonexistent", "TMPDIR": "/nonexistent", "PYTHONDONTWRITEBYTECODE": "1"}
    gone = {"XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "TEMP", "TMP"}
    environment = {name: x for name, x in os.environ.items() if name not in gone} | away
    tmp_path.chmod(0o555)
    for how in (nobody(), {}):
        run(MOVED, env=environment, cwd="/" if how else tmp_path, **how)
    assert not list(tmp_path.iterdir())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", FORMULATIONS)
def test_every_matrix_solved_in_machine_code_tells_its_condition_sign_and_refinements(key):
    scene, formulation = Snake.paper(), FORMULATIONS[key]
    at = Evaluation(scene, *scene.initial_state())
    public = at.acceleration(formulation).rcond
    found = solves_of(scene, formulation, 0.0, state_of(at, formulation))
    assert {one.name for one in found} == set(public)
    for one in found:
        assert one.rcond == pytest.approx(public[one.name], rel=1e-9)
        assert abs(one.sign) == 1.0
        assert np.isfinite(one.log_determinant)
        assert (one.refinements >= 1) == (key == "banded")


def test_a_singular_matrix_in_machine_code_has_no_condition():
    one = np.ones(3)
    straight = Snake(one, one, one / 12, None, 0 * one)
    at = Evaluation(straight, np.array([0.0, 0.0, 0.3, 0.3, 0.3]), np.zeros(5))
    y = np.concatenate((at.q, np.zeros(5)))
    (first, *_) = solves_of(straight, FORMULATIONS["el"], 0.0, y)
    assert first.name == "a'T"
    assert first.rcond < 1e-15


@pytest.mark.parametrize("size", [1, 2, 3, 10])
def test_an_infinite_pivot_gives_no_finite_solution(size):
    def solved(A, b):
        return solve(A, b, "A")

    for place in range(size):
        A = np.eye(size)
        A[place, place] = np.inf
        assert np.isnan(MachineCode(solved, A, np.ones(size))(A, np.ones(size))).any()


def test_a_state_of_another_size_is_refused():
    scene = Snake.coil(3)
    rates = RightHandSide(scene, FORMULATIONS["kane"])
    for function in (rates, exact_jacobian(scene, FORMULATIONS["kane"])):
        with pytest.raises(InputError, match=r"y has shape \(3,\), expected \(7,\)"):
            function(0.0, np.zeros(3))
