"""Parts of machine code by themselves: loops, memory, rows, calls and traces, by hand."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pytest
from tests.machine_code import MachineCode
from tests.numbers.test_noise import replay

from eomcheck.kernels import kernel, llvm, perturbed_solves, perturbed_trace
from eomcheck.kernels.batched_solves import lapack_of_each
from eomcheck.kernels.kernel import HEADER, Layout, aligned, layout_of, loop_results, reads_of
from eomcheck.kernels.llvm import CACHE_LINE, LANES, IRBuilder, JitModule, aligned_zeros
from eomcheck.kernels.perturbed_trace import FEWEST_COMPILED, TraceRunner
from eomcheck.kernels.program import NotRegularError, Program, extrapolate_program
from eomcheck.numbers.batch_arrays import BatchArray, NoiseBatch
from eomcheck.numbers.linear import matrix_product, solve
from eomcheck.numbers.noise import NORMAL, Noise

# ---- Loops ---------------------------------------------------------------------------------------


def along(x: Any) -> Any:
    """Each entry of what came before, at distances up to four, the furthest that loops go."""
    found = [x[i] * (i + 2) for i in range(4)]
    for i in range(4, len(x)):
        found.append(x[i] * found[i - 1] + found[i - 3] - found[i - 4] * x[i - 2])
    return np.array(found)


def backwards(x: Any) -> Any:
    """Sums from the end, each doubled, and read from the beginning."""
    found: list[Any] = [None] * len(x)
    found[-1] = x[-1]
    for i in range(len(x) - 2, -1, -1):
        found[i] = x[i] + found[i + 1] * x[i]
    return np.array([found[i] * x[len(x) - 1 - i] for i in range(len(x))])


def strided(x: Any) -> Any:
    """Every other entry, and the last ones of what a loop made."""
    squares = [x[i] * x[i] for i in range(0, len(x), 2)]
    cubes = [squares[i] * x[2 * i] for i in range(len(squares))]
    return np.array([*cubes, squares[-1] + squares[-2], squares[-5] - squares[0], squares[3]])


def ragged(x: Any) -> Any:
    """Two chains of which one begins later, and a sum of both."""
    one, other = [x[0]], [x[5]]
    for i in range(1, len(x)):
        one.append(one[-1] / 2 + x[i])
    for i in range(6, len(x) - 1):
        other.append(other[-1] * one[i] - x[i + 1])
    total = one[0]
    for i in range(len(other)):
        total = total + other[i] * one[i + 3]
    return np.array([total, other[-1], one[-1]])


def shared(x: Any) -> Any:
    """The same number read in every turn, of an input and of what was made before."""
    scale = x[0] + x[1]
    return np.array([x[i] * scale + x[2] for i in range(3, len(x))])


@pytest.mark.parametrize("function", [along, backwards, strided, ragged, shared])
@pytest.mark.parametrize("size", [25, 40])
def test_loops_have_the_bits_of_python_however_far_they_look_back(function: Any, size: int):
    x = np.random.default_rng(size).uniform(0.5, 1.5, size)
    rolled = MachineCode(function, x, short=0)
    assert any(item[0] == "loop" for item in rolled.program.items)
    expected = np.array(function(x.tolist()), float)
    assert rolled(x).tolist() == expected.tolist()
    wide = MachineCode(function, x, short=0, width=2)
    lanes = wide(np.stack([x, 2 - x], axis=1))
    assert lanes[:, 0].tolist() == expected.tolist()
    assert lanes[:, 1].tolist() == np.array(function((2 - x).tolist()), float).tolist()


def test_programs_are_continued_leaf_by_leaf_or_refused_in_these_words():
    def program(count: int) -> Program:
        return Program((("put", ("constant", 1.0), "out", 3 * count, 1),), (("a", count),))

    found = extrapolate_program(program, 11, 2, 3)
    assert found == program(11) and isinstance(found, Program)
    assert extrapolate_program(program, 2, 2, 3) == program(2)

    def refused(programs: Any, size: int = 11) -> str:
        with pytest.raises(NotRegularError) as error:
            extrapolate_program(programs, size, 2, 3)
        return str(error.value)

    assert refused(program, 12) == "12 is not 2 plus a multiple of 3"
    uneven = lambda n: Program((("constant", n * n),), ())  # noqa: E731
    assert refused(uneven) == "programs of 2, 5, ... differ irregularly"
    longer = lambda n: Program((("constant",) * n,), ())  # noqa: E731
    assert refused(longer) == "programs of different sizes have different shapes"
    other = lambda n: Program((("constant", 1.0 * n),), ())  # noqa: E731
    assert refused(other) == "2.0 in one program is 5.0 in the other"
    flag = lambda n: Program((("constant", n > 2),), ())  # noqa: E731
    assert refused(flag) == "False in one program is True in the other"


# ---- Memory --------------------------------------------------------------------------------------


@pytest.mark.parametrize("ahead", [0, 1, 4, 7, 8])
def test_memory_begins_a_line_of_cache_behind_what_is_ahead(ahead: int):
    for count in (1, 5, 40):
        found = aligned_zeros(count, ahead)
        assert found.shape == (count,) and not found.any()
        assert (found.ctypes.data + 8 * ahead) % (8 * CACHE_LINE) == 0


def test_arrays_of_a_block_begin_lines_of_cache_and_only_what_is_read_behind_loops_is_kept():
    assert [aligned(x) for x in (0, 1, 8, 9)] == [0, 8, 8, 16]
    first = (
        "loop",
        10,
        (("op", "add", ("entry", "p", 0, 1), ("current", 0)), ("op", "neg", ("current", 0), None)),
    )
    second = (
        "loop",
        9,
        (
            (
                "op",
                "mul",
                ("from loop", 0, 1, 0, 1),
                ("previous", 0, (("value", 0), ("constant", 1.0))),
            ),
        ),
    )
    items = (
        ("op", "sqrt", ("entry", "q", 2, 0), None),
        first,
        second,
        ("put", ("from loop", 0, 0, 5, 0), "out", 0, 0),
        ("put", ("from loop", 1, 0, 8, 0), "out", 1, 0),
        ("put", ("from loop", 1, 0, 6, 0), "out", 2, 0),
    )
    program = Program(items, (("x0", 3), ("r0", 9)))
    written, last = loop_results(program)
    # Of 10 turns the sixth is further back than four, the ninth and seventh of 9 are not.
    assert written == {(0, 1), (0, 0)}
    assert last == {(1, 0): 2}
    assert [x for x in reads_of(items) if x[0] == "value"] == [("value", 0)]
    assert ("constant", 1.0) in [*reads_of(items)] and ("entry", "q", 2, 0) in [*reads_of(items)]
    found = layout_of(program, {"p": 11, "q": 3})
    assert dict(found.offsets) == {"p": 0, "q": 11, "x0": 16, "r0": 24, "l0.0": 40, "l0.1": 56}
    assert (found.size, found.workspace) == (72, 0)
    assert (found.float64_count(1), found.float64_count(4)) == (HEADER + 72, HEADER + 4 * 72)
    assert Layout({}, 8, 5).float64_count(2) == HEADER + 16 + 5
    groups = [
        ("group", 0, kind, "A", shape, inline, -1, ())
        for kind, shape, inline in (("solve", (3, 2), False), ("product", (2, 3, 4), False))
    ]
    assert layout_of(Program(tuple(groups), ()), {}).workspace == 2 * 3 + 3 * 4 + 2 * 4
    assert layout_of(Program((groups[0],), ()), {}).workspace == 6
    inline = (*groups[0][:5], True, -1, ())
    assert layout_of(Program((inline,), ()), {}).workspace == 0


# ---- Rows and calls ------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, 2, 3, 9])
@pytest.mark.parametrize("many", [1, 2, 3, 9])
def test_rows_are_substituted_by_factors_and_by_their_sizes(size: int, many: int):
    random = np.random.default_rng((size, many))
    stride = size + LANES
    factors, x = np.full((size, stride), 7.0), np.full((size, many + LANES), 7.0)
    factors[:, :size] = random.uniform(1, 2, (size, size)) * random.choice([-1, 1], (size, size))
    right = random.uniform(1, 2, (size, many))
    lower = np.tril(factors[:, :size], -1) + np.eye(size)
    upper = np.triu(factors[:, :size])
    # What is below the diagonal of U, and above that of L, is nobody's.
    made = JitModule(perturbed_solves.texts())
    kinds = *[ctypes.c_int64] * 2, ctypes.c_void_p, ctypes.c_int64, ctypes.c_void_p
    before = factors.copy()
    for name, expected in (
        ("forward", np.linalg.solve(lower, right)),
        ("backward", np.linalg.solve(upper, right)),
        ("sizes", np.abs(lower) @ np.abs(upper) @ right),
    ):
        x[:, :many] = right
        function: Any = ctypes.CFUNCTYPE(None, *kinds)(made.address(name))
        function(size, many, factors.ctypes.data, stride, x.ctypes.data)
        np.testing.assert_allclose(x[:, :many], expected, rtol=1e-11)
        assert np.array_equal(factors, before)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_lapack_is_called_for_each_lane_with_what_is_its_own_and_what_is_for_all(count: int):
    random = np.random.default_rng(count)
    A, b = random.uniform(-1, 1, (count, 3, 3)), random.uniform(-1, 1, (count, 2, 3))
    factors, x = A.transpose(0, 2, 1).copy(), b.copy()  # LAPACK reads columns
    pivots, failed = np.zeros((count, 3), np.int32), np.full((count, 1), 9, np.int32)
    lapack_of_each("dgetrf", 3, 3, factors, 3, pivots, failed)
    assert not failed.any()
    lapack_of_each("dgetrs", "N", 3, 2, factors, 3, pivots, x, 3, failed)
    for lane in range(count):
        expected = np.linalg.solve(A[lane], b[lane].T).T
        np.testing.assert_allclose(x[lane], expected, rtol=1e-12)


def test_a_kernel_is_called_row_by_row_and_so_often_as_is_said():

    code = IRBuilder()
    code.store(code.add(code.load("%y"), code.mul("%t", code.load("%last"))), "%out")
    text = code.function("define void @one(ptr %out, double %t, ptr %y, ptr %last)")
    made = JitModule([text])
    t, y = np.array([[2.0], [3.0], [5.0]]), np.array([[[1.0], [9.0]], [[2.0], [9.0]], [[4.0], [9]]])
    out, last = np.full((3, 2, 1), -1.0), np.array([10.0])
    kernel.call_along_rows(made.address("one"), last, t, y, out)
    assert out[:, :, 0].tolist() == [[21, -1], [32, -1], [54, -1]]
    empty = np.zeros((0, 2, 1))
    kernel.call_along_rows(made.address("one"), last, np.zeros((0, 1)), empty, empty)
    grow = IRBuilder()
    grow.store(grow.add(grow.load("%a"), grow.load("%b")), "%a")
    text = grow.function("define void @more(ptr %a, double %t, ptr %b, ptr %c, ptr %d)")
    more = JitModule([text])
    total, step = np.array([1.0]), np.array([0.5])
    kernel.timing_loop(more.address("more"), total.ctypes.data, step.ctypes.data)(6)
    assert total.tolist() == [4.0]


# ---- Traces --------------------------------------------------------------------------------------


class Told(NoiseBatch):
    """Noise whose changes are 1, 2, 3, ... times a step, as they are asked for."""

    def __init__(self, step: float = 0.125):
        super().__init__([Noise(0)])
        self.by, self.taken = step, 0

    def draws(self, count: int) -> np.ndarray:
        first, self.taken = self.taken, self.taken + count
        return self.by * np.arange(first + 1.0, self.taken + 1)[None]


def test_each_operation_is_moved_by_its_own_change_but_those_that_round_nothing():
    def function(x: Any, y: Any) -> Any:
        a = x[0] + y[0]
        b = x[0] - y[0]
        c = a * b
        return np.array([a, b, c, c / y[0], -c, 0 + x[0], 1 * x[0], x[0] - 0, 2 / y[0], 3 - x[0]])

    x, y, h = np.array([4.0]), np.array([2.0]), 0.0625
    a, b = 6 * (1 + h), 2 * (1 + 2 * h)
    c = a * b * (1 + 3 * h)
    expected = [a, b, c, c / 2 * (1 + 4 * h), -c, 4, 4, 4, 1 + 6 * h, -1 + h * 8]
    found = replay(Told(h), function, x, y)
    np.testing.assert_allclose(found, expected, rtol=1e-15)
    assert replay(Told(), lambda x: 0 * x, x).tolist() == [0.0]
    # What has underflowed moves by the smallest normal number.
    tiny = replay(Told(), lambda x: x * x, np.array([1e-200]))
    assert tiny.tolist() == [0.125 * NORMAL]
    assert np.isnan(replay(Told(), lambda x, y: x / y, x, 0 * y)).all()


def test_matrices_are_multiplied_and_solved_between_stretches_of_a_trace():
    def function(A: Any, b: Any) -> Any:
        doubled = A + A
        x = solve(doubled, b * 2, "A")
        more = matrix_product(doubled, np.stack([x, x + x], axis=1))
        return more - b[0], x[0] * x[1]

    A, b = np.array([[4.0, 1.0], [1.0, 3.0]]), np.array([1.0, 2.0])
    x = np.linalg.solve(A, b)
    still = Noise(0, step=0.0)
    found, other = replay(still, function, A, b)
    np.testing.assert_allclose(found, 2 * A @ np.stack([x, 2 * x], axis=1) - 1, rtol=1e-14)
    assert other == pytest.approx(x[0] * x[1], rel=1e-14)


def test_several_noises_are_side_by_side_in_one_run_and_their_arrays_in_front():
    def function(x: Any) -> Any:
        return np.array([x[0] * x[1] + x[2], x[2] / x[0]])

    x = np.array([[1.5, 2.5, -3.0], [0.5, 1.0, 2.0]])
    noises = [Noise(1), Noise(2)]
    found = TraceRunner().run(NoiseBatch(noises), function, BatchArray(x)).data
    for i, noise in enumerate((Noise(1), Noise(2))):
        assert found[i].tolist() == replay(noise, function, x[i]).tolist()


def test_traces_are_kept_by_function_shapes_and_constants_and_the_oldest_are_forgotten(monkeypatch):
    made: list[Any] = []

    class Counted(perturbed_trace._Trace):
        def __init__(self, function: Any, arguments: Any):
            made.append(function.__name__)
            super().__init__(function, arguments)

    def one(x: Any, flag: Any = None) -> Any:
        return x * x

    def two(x: Any) -> Any:
        return x + x

    def branch(x: Any) -> Any:
        return x if x[0] > 0 else -x

    monkeypatch.setattr(perturbed_trace, "_Trace", Counted)
    moves, still = TraceRunner(), Noise(0, step=0.0)
    for x, flag in ((np.ones(3), 1), (2 * np.ones(3), 1), (np.ones(4), 1), (np.ones(3), 2)):
        assert replay(still, one, x, flag, runner=moves).tolist() == (x * x).tolist()
    assert made == ["one"] * 3
    for _ in range(2):
        with pytest.raises(TypeError, match=r"branch does more than rational operations$"):
            replay(still, branch, np.ones(3), runner=moves)
    assert made == ["one"] * 3 + ["branch"], "that there is none is kept as well"
    # 3 that are read, and 3 results: 6 places, of which two functions fill 12.
    made.clear()
    moves = TraceRunner()
    monkeypatch.setattr(perturbed_trace, "LARGEST_TOTAL", 12)
    for function in (one, two, one, two):
        replay(still, function, np.ones(3), runner=moves)
    assert made == ["one", "two"]
    monkeypatch.setattr(perturbed_trace, "LARGEST_TOTAL", 11)
    moves = TraceRunner()
    for function in (one, two, two, one):
        replay(still, function, np.ones(3), runner=moves)
    assert made[2:] == ["one", "two", "one"]
    monkeypatch.setattr(perturbed_trace, "LARGEST_TOTAL", 1)
    moves = TraceRunner()
    for _ in range(2):
        replay(still, one, np.ones(3), runner=moves)
    assert made[5:] == ["one"], "the newest is kept however long it is"


def test_what_has_few_operations_or_is_not_finite_is_done_by_python(monkeypatch):
    runs: list[int] = []

    class Counted(perturbed_trace._Trace):
        def run(self, noise: Any, doubles: Any) -> Any:
            runs.append(len(self.operations))
            assert noise is None
            return super().run(noise, doubles)

    monkeypatch.setattr(perturbed_trace, "_Trace", Counted)
    for size in (FEWEST_COMPILED - 1, FEWEST_COMPILED):
        x = np.arange(1.0, size + 1)
        assert TraceRunner().run_exact(lambda x: x * x, x).tolist() == (x * x).tolist()
    assert runs == [FEWEST_COMPILED]
    x = np.zeros(FEWEST_COMPILED)
    x[1:] = 1.0
    with np.errstate(divide="ignore"):
        found = TraceRunner().run_exact(lambda x: (1 / x, (x, None)), x)
    assert found[0].tolist() == [np.inf, *[1.0] * (FEWEST_COMPILED - 1)] and found[1][1] is None
    assert TraceRunner().run_exact(lambda x: x if x[0] > 0 else -x, -np.ones(2)).tolist() == [1, 1]


def test_the_key_of_a_trace_names_shapes_and_constants_and_arrays_are_handed_on_in_order():
    a, b, names = np.ones((2, 3)), np.arange(2.0), np.array([1, 2])
    inputs: list[Any] = [names]
    key = tuple, (2, 3), (tuple, (2,), None, ((2,), names.tobytes())), "word"
    assert perturbed_trace.trace_key((a, (b, None, names), "word"), inputs) == key
    assert [x is y for x, y in zip(inputs, (names, a, b), strict=True)] == [True] * 3
    assert perturbed_trace.trace_key(3.5, []) == 3.5
    batch, inputs = BatchArray(np.ones((4, 2))), []
    assert perturbed_trace.trace_key(batch, inputs) == (2,) and inputs == [batch] * 1
    literals = np.array([1, 0], object)
    assert perturbed_trace.trace_key(literals, inputs) == (2,)
    assert inputs[1].tolist() == [1.0, 0.0]


def test_this_machine_tells_what_it_can_do():
    name, features, fused = llvm.cpu_features()
    assert name and "-prefer-256-bit" in features.split(",")
    assert isinstance(fused, bool) and llvm.has_fma() is fused
