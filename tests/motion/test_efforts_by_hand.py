"""Steps, orders, pieces and reasons of motions: each told from numbers made by hand."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from tests.samples import ordinary

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.kernels import dop853
from eomcheck.motion import batch
from eomcheck.motion.observables import as_integrated, observer_of
from eomcheck.motion.reference import Extrapolation, GaveUpError, next_step_and_target
from eomcheck.motion.right_hand_side import block_of, state_of
from eomcheck.scenes import ChainPendulum, Sleigh, TurntableBall

SLEIGH = Sleigh.example()

# ---- Orders --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("steps", "step", "target"),
    [
        # k results take 1 + k² evaluations, the orders that are compared k - 1, k and k + 1.
        ([9.0, 1.0, 2.3], 2.3 * 17 / 10, 4),
        ([9.0, 1.0, 2.2], 2.2, 3),
        ([9.0, 1.0, 1.0], 1.0, 3),  # never less than 3
        ([9.0, 9.0, 1.0, 1.9], 1.9 * 26 / 17, 5),
        ([9.0, 9.0, 1.0, 1.85], 1.85, 4),
        ([9.0, 9.0, 1.0, 1.4], 1.4, 4),
        ([9.0, 9.0, 1.0, 1.3], 1.0, 3),
        ([2.0**k for k in range(22)], 2.0**21 * 530 / 485, 23),
        ([2.0**k for k in range(23)], 2.0**22, 23),  # never more than 24, with one to spare
        ([2.0**-k for k in range(24)], 2.0**-22, 23),
    ],
)
def test_the_order_of_least_work_comes_next(steps: list[float], step: float, target: int):
    assert next_step_and_target(steps) == (pytest.approx(step), target)


class Told(Extrapolation):
    """An extrapolation whose errors are told."""

    errors: list[float]
    asked = 0

    def columns(self, y: Any, step: Fraction) -> Iterator[tuple[Any, float]]:
        for k, error in enumerate(self.errors, 1):
            object.__setattr__(self, "asked", k)
            yield np.array([10.0 * k]), error


INF = np.inf


@pytest.mark.parametrize(
    ("errors", "asked", "taken"),
    [
        ([INF, 1e3, 10.0, 0.5, 0.0], 4, True),  # one early
        ([INF, 1e3, 0.5, 1.5, 0.5, 0.0], 4, False),  # not two
        ([INF, 1e3, 10.0, 2.0, 0.5, 0.0], 5, True),
        ([INF, 1e3, 10.0, 2.0, 1.3, 0.9, 0.0], 6, True),  # one late
        ([INF, 1e3, 10.0, 5.0, 0.0], 4, False),  # 5 (5/10)² is too much
        ([INF, 1e3, 10.0, 4.0, 3.9, 0.0], 5, False),  # 3.9 (3.9/4) is too much
        ([INF, 1e3, 10.0, 2.0, 1.2, 1.1, 0.0], 6, False),
        ([INF, 1e3, 10.0, INF, 0.0], 4, False),
        ([INF, 1e3, 1.0, 1.0, 0.0], 4, True),
        ([INF, 0.0, 0.0, 0.0], 4, True),
        ([INF, INF, INF, INF, 0.0], 4, False),
    ],
)
def test_a_step_is_taken_one_order_early_or_late_or_given_up(errors, asked: int, taken: bool):
    method = Told(lambda y: y, 1e-9)
    object.__setattr__(method, "errors", errors)
    after, step, target = method.attempt(np.zeros(1), Fraction(1, 4), 5)
    assert method.asked == asked
    sizes = [min(max(error, 1e-99), 1e99) for error in errors[:asked]]
    steps = [0.25 * 0.9 * x ** (-1 / (2 * k - 1)) for k, x in enumerate(sizes, 1)]
    assert (method.effort.steps, method.effort.rejected) == (int(taken), int(not taken))
    if taken:
        assert after is not None and after[0] == 10.0 * asked
        assert (method.effort.orders, method.effort.longest) == ({2 * asked}, 0.25)
        best, order = next_step_and_target(steps)
        assert (step, target) == (pytest.approx(min(best, 1.0)), order)
        return
    work = [(1 + k * k) / steps[k - 1] for k in range(2, asked + 1)]
    best = 2 + int(np.argmin(work))
    assert after is None
    assert step == pytest.approx(min(max(steps[best - 1], 0.02 * 0.25), 0.125))
    assert target == (5 if best == asked else max(best, 3))


def test_steps_are_cut_equally_up_to_the_next_time():
    asked: list[tuple[float, int]] = []
    answers = iter([(0.3, 5), (0.3, 4), (9.0, 7), (0.01, 6), (9.0, 6), (9.0, 5)])

    class Cut(Extrapolation):
        def attempt(self, y: Any, step: Fraction, target: int) -> Any:
            asked.append((float(step), target))
            return (None if len(asked) == 2 else y + 1.0), *next(answers)

    seen: list[float] = []
    found = Cut(lambda y: y, 1e-9).run(
        *(np.zeros(1), [2.0, 3.0, 3.5]), watch=lambda t, y: seen.append(float(t))
    )
    first = 1.0 / 667  # parts of 1 s that are at most 1.5 s / 1000
    quarter = (1.0 - first) / 4
    expected = [
        *((first, 8), (quarter, 5), (quarter, 4), (1.0 - first - quarter, 7)),
        *((0.01, 6), (0.49, 6)),
    ]
    assert [x for x, _ in asked] == pytest.approx([x for x, _ in expected])
    assert [k for _, k in asked] == [k for _, k in expected]
    assert seen == pytest.approx([2 + first, 2 + first + quarter, 3.0, 3.01, 3.5])
    assert [float(y[0]) for y in found] == [0.0, 3.0, 5.0]


@pytest.mark.parametrize(("step", "ends"), [(1.1e-12, False), (0.9e-12, True)])
def test_a_step_below_a_millionth_of_a_millionth_of_all_time_gives_up(step: float, ends: bool):
    answers = iter([4.0 * step, 4.0 * step, 9.0, 9.0])

    class Failing(Extrapolation):
        def attempt(self, y: Any, h: Fraction, target: int) -> Any:
            return (None if h > 1 else y), next(answers), target

    method = Failing(lambda y: y, 1e-9)
    if ends:
        with pytest.raises(GaveUpError, match=r"at t = 1\.0 s"):
            method.run(np.zeros(1), [1.0, 5.0], first=2.0)
        return
    with pytest.raises(StopIteration):
        method.run(np.zeros(1), [1.0, 5.0], first=2.0)


# ---- Many motions --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["t_end", "rtol", "atol"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_many_motions_are_refused_what_one_is(name: str, value: float):
    how: dict[str, Any] = {"t_end": 0.1, "u0": np.ones((2, 2)), name: value}
    with pytest.raises(InputError, match=f"{name} = "):
        batch.simulate_many(SLEIGH, "kane", **how)


@pytest.mark.parametrize(
    ("count", "lanes", "spread", "sizes"),
    [
        (5, 1, True, [1] * 5),
        (70, 1, True, [2] * 35),
        (70, 2, True, [2] * 35),
        (70, 1, False, [8] * 8 + [6]),
        (70, 2, False, [16] * 4 + [6]),
    ],
)
def test_work_is_cut_to_pieces_of_whole_groups_of_lanes(
    monkeypatch, count: int, lanes: int, spread: bool, sizes: list[int]
):
    made: list[tuple[int, bool]] = []

    class Executor:
        here = False

        def submit(self, work: Any, piece: Any) -> Future:
            future: Future = Future()
            self.here = True
            future.set_result(work(piece))
            self.here = False
            return future

    executor = Executor()

    def integrated(options: Any, starts: Any) -> dict[str, Any]:
        made.append((len(starts), executor.here))
        assert options[2:] == (0.5, 1e-5, 1e-7, options.times, 77, lanes)
        assert options.times.tolist() == [0.25, 0.5]
        number = np.array([start.speeds[0] for start in starts])
        names = "q", "v", "u", "energy", "right_hand_sides", "steps", "status", "reason"
        return {"seconds": np.array([2.0]), **dict.fromkeys(names, number)}

    monkeypatch.setattr(batch, "_integrated", integrated)
    u0 = np.stack((np.arange(count) + 0.5, np.ones(count)), axis=1)
    options: dict[str, Any] = {"rtol": 1e-5, "atol": 1e-7, "max_steps": 77, "lanes": lanes}
    if spread:
        options["executor"] = executor
    found = batch.simulate_many(SLEIGH, "kane", 0.5, u0=u0, output_times=[0.25, 0.5], **options)
    assert made == [(size, spread) for size in sizes]
    assert found.steps.tolist() == u0[:, 0].tolist()
    assert (found.seconds, found.rtol, found.atol) == (2.0 * len(sizes), 1e-5, 1e-7)
    assert (found.key, len(found)) == ("kane", count)
    assert found.constraint_residual is None


def test_motions_side_by_side_keep_the_same_constraints():
    first, second = ((0,), (1, 2), (0,), None), ((1,), (0, 2), None, (0,))
    choices: Any = [first, second, None, first, first, first, second]
    motions = np.array([0, 1, 3, 4, 6])
    found = [
        (group.tolist(), choice) for group, choice in batch._groups_by_choice(motions, choices, 2)
    ]
    assert found == [([0, 3], first), ([4, 4], first), ([1, 6], second)]


@pytest.mark.parametrize("refusal", [None, "M is singular"])
@pytest.mark.parametrize(
    ("status", "says"),
    [
        (dop853.TOO_MANY, "12 steps do not reach the end, only t = 0.375 s"),
        (dop853.TOO_SMALL, "no step is small enough, or the right-hand side is not finite, at"),
        (0, "the right-hand side is not finite at"),
    ],
)
def test_a_motion_says_why_it_ended(monkeypatch, status, says: str, refusal: str | None):
    asked: list[Any] = []

    class At:
        def __init__(self, scene: Any, q: Any, v: Any, t: float):
            asked.append((q, v.tolist(), t))

        def acceleration(self, formulation: Any) -> None:
            if refusal is not None:
                raise RefusedError("M", 0.0, 0.0, refusal)

    monkeypatch.setattr(batch, "Evaluation", At)
    record = np.zeros(dop853.FIELDS)
    record[dop853.STATUS], record[dop853.T] = status, 0.375
    q, v = np.array([1.0, 2.0]), np.array([3.0, np.nan])
    given: Any = SLEIGH, FORMULATIONS["kane"], q, v, record, 12
    found = batch._reason(*given)
    if status == dop853.TOO_MANY:
        assert found == says and not asked
        return
    why = refusal or "it overflows, or a matrix is singular there"
    assert found == f"{says} t = 0.375 s: {why}"
    assert asked == [(q, [3.0, 0.0], 0.375)]


def test_a_motion_that_crossed_a_pose_says_so_whatever_ended_it(monkeypatch):
    monkeypatch.setattr(batch, "solves_partition", lambda *given: True)
    monkeypatch.setattr(
        batch, "singular_crossings", lambda scene, f, parameters, t, y: [None, (1, 2)]
    )
    found = batch.simulate_many(
        *(SLEIGH, "kane", 5.0), u0=np.ones((2, 2)), lanes=2, max_steps=3, output_times=[0.0, 0.5]
    )
    assert "3 steps do not reach the end" in found.reason[0]
    assert "between t = 0 s and 0.5 s the matrix a_1" in found.reason[1]
    assert found.status.tolist() == ["failed", "failed"]
    assert np.isfinite(found.q[:, 0]).all() and np.isnan(found.q[1, 1]).all()


def test_one_of_many_motions_is_kept_up_to_where_it_came():
    q = np.arange(24.0).reshape(2, 4, 3)
    q[1, 2:] = np.nan
    energy, residual = np.arange(8.0).reshape(2, 4), np.arange(8.0).reshape(2, 4, 1) / 4
    whole = batch.Trajectories(
        **{"scenes": (SLEIGH, Sleigh.example()), "key": "em", "rtol": 1e-5, "atol": 1e-7},
        **{"t": np.array([0.0, 0.5, 1.0, 2.0]), "q": q, "v": -q, "u": 2 * q[:, :, :2]},
        **{"energy": energy, "constraint_residual": residual},
        **{"right_hand_sides": np.array([30, 20]), "steps": np.array([3, 2])},
        **{"status": np.array(["finished", "refused"]), "reason": np.array(["", "why"])},
        seconds=6.0,
    )
    one, other = whole
    assert (one.times.tolist(), other.times.tolist()) == ([0, 0.5, 1, 2], [0, 0.5])
    assert other.q.tolist() == q[1, :2].tolist() and other.v.tolist() == (-q[1, :2]).tolist()
    assert other.energy.tolist() == [4.0, 5.0]
    assert other.constraint_residual is not None
    assert other.constraint_residual.tolist() == [[1.0], [1.25]]
    assert (one.status, other.status, one.reason, other.reason) == ("finished", "failed", "", "why")
    assert (other.steps, other.right_hand_sides, other.seconds) == (2, 20, 3.0)
    assert (other.key, other.integrator, other.rtol, other.atol) == ("em", "DOP853", 1e-5, 1e-7)
    assert other.scene is whole.scenes[1] and other.multipliers is None


# ---- What is seen --------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["au", "em", "kane", "im"])
@pytest.mark.parametrize("kind", [TurntableBall, ChainPendulum, Sleigh])
def test_what_is_seen_of_a_state_is_that_of_an_evaluation(key: str, kind: Any):
    scene, (q, v, t) = ordinary(kind)
    formulation, at = FORMULATIONS[key], Evaluation(scene, q, v, t)
    kernel = observer_of(scene, formulation)
    found = kernel(block_of(kernel, scene), np.array([t]), state_of(at, formulation))
    close: dict[str, Any] = {"rel": 1e-9, "abs": 1e-9}
    T, U = scene.energies(at.parameters, at.prepared, at.q, at.v)
    assert found["energy"] == pytest.approx([T + (0.0 if U is None else U)], **close)
    assert found["v"] == pytest.approx(at.v, **close)
    assert found["u"] == pytest.approx(at.u, **close)
    assert ("constraint" in found) is (scene.r > 0)
    if scene.r > 0:
        assert found["constraint"] == pytest.approx(np.zeros(scene.r), abs=1e-9)
        moved = state_of(at, FORMULATIONS["au"])
        kernel = observer_of(scene, FORMULATIONS["au"])
        moved[scene.n] += 0.25
        terms = at.terms
        off = terms.a @ moved[scene.n : 2 * scene.n] + (0.0 if terms.b is None else terms.b)
        found = kernel(block_of(kernel, scene), np.array([t]), moved)
        assert np.abs(found["constraint"]) == pytest.approx(np.abs(off), **close)
        assert np.abs(off).max() > 1e-3


def test_velocities_that_follow_from_a_state_are_those_looked_at():
    q, v = np.array([0.1, 0.2, 0.6]), np.array([0.5, 0.25, -1.5])  # which violates a constraint
    at = Evaluation(SLEIGH, q, v, 0.75)
    for key in ("au", "im"):
        assert as_integrated(at, FORMULATIONS[key])[0] is at
    for key in ("em", "kane"):
        there, y = as_integrated(at, FORMULATIONS[key])
        assert (y == state_of(at, FORMULATIONS[key])).all()
        assert (there.q == q).all() and there.t == 0.75
        assert np.abs(there.v - v).max() > 1e-3
        assert there.terms.a @ there.v == pytest.approx([0.0], abs=1e-14)
    far = Evaluation(SLEIGH, q, np.array([0.5, 1.7e308, 0.0]), 0.75)
    assert np.isfinite(as_integrated(far, FORMULATIONS["em"])[0].v).all()
