"""Bounds, accuracies and refusals of hand-made numbers: each figure worked out beforehand."""

from __future__ import annotations

import math
import re
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import flint
import numpy as np
import pytest
from tests.samples import ordinary

from eomcheck.errors import InconsistentVelocityError, RefusedError
from eomcheck.evaluation import certified, constraint_rank, dynamics
from eomcheck.evaluation import certified as enclosure
from eomcheck.evaluation import perturbed as sensitivity
from eomcheck.evaluation.certified import Enclosure
from eomcheck.evaluation.evaluation import SPEEDS, Acceleration, BatchEvaluation, Evaluation
from eomcheck.evaluation.scene_quantities import Solution
from eomcheck.evaluation.tolerance import C, allowed_error, can_overflow
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.records import State, Terms
from eomcheck.numbers.ball import precision
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.numbers.generic import EPS
from eomcheck.numbers.linear import SolveRecord, SolveRecorder
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH
from eomcheck.scenes import Sleigh, TurntableBall

SLEIGH = Sleigh(mass=1.3, inertia=0.21, offset=0.37, rate=2.1)


def test_the_constant_is_the_one_that_is_documented():
    text = (Path(__file__).parents[2] / "docs/explanation/tolerance.md").read_text(encoding="utf-8")
    assert re.findall(r"\$C = (\d+)\$", text)[0] == f"{C:g}"
    assert allowed_error(3.0) == 96.0 * EPS


@pytest.mark.parametrize(
    ("inputs", "huge"),
    [
        ([[1.0], [2.0, -3.0]], False),
        ([[1.0], [0.0, -1e101], [2.0]], True),
        ([[1e101], [1.0]], True),
        ([[1.0], [np.nan]], True),
        ([[0.99e100], [-0.99e100]], False),
    ],
)
def test_any_input_that_is_huge_can_overflow(inputs: list, huge: bool):
    assert can_overflow(*(np.array(x) for x in inputs)) is huge


# ---- Accuracy ------------------------------------------------------------------------------------


def certify(monkeypatch, vdot: list, true: list, kappa_scale: float) -> certified.Accuracy:
    found, at = Acceleration(np.array(vdot), None, {"M": 0.25, "a_1": 0.5}, np.inf), object()
    monkeypatch.setattr(certified, "solution_of", lambda *given: found)
    with precision(200):
        truth = Enclosure(np.array(true, object), None, np.array([flint.arb(1)]), 200, 30.0)
    return certified.accuracy_at(FORMULATIONS["au"], truth, at, sensitivity=kappa_scale)  # type: ignore[arg-type]


def test_an_accuracy_is_that_of_each_entry_and_relative_to_the_largest(monkeypatch):
    tiny = flint.arb(0, 1e-30)
    true = [flint.arb(2), flint.arb(-8), tiny, flint.arb(0.5)]
    found = certify(monkeypatch, [2.0 + 2.0**-40, -8.0, 2.0**-60, 0.5 - 2.0**-50], true, 16.0)
    assert found.condition == {"M": 4.0, "a_1": 2.0}
    assert found.error[:2] == pytest.approx([2.0**-40, 0.0], rel=1e-12, abs=0.0)
    assert found.error[2:] == pytest.approx([2.0**-60, 2.0**-50], rel=1e-9, abs=0.0)
    assert found.ulps == pytest.approx([2.0**11, 0.0, np.inf, 2.0**3])
    assert found.relative == pytest.approx(2.0**-43, rel=1e-12, abs=0.0)
    assert found.digits == pytest.approx(43 * math.log10(2.0))
    assert found.relative_bound == pytest.approx(32.0 * EPS * 16.0 / 8.0, abs=0.0)
    assert found.kappa == 2.0
    assert found.ratio == pytest.approx(2.0**-40 / (EPS * 16.0))
    assert not found.silently_wrong


@pytest.mark.parametrize(
    ("off", "bound", "silent"),
    [(2e-6, 1e-6, True), (2e-6, 3e-6, False), (0.5e-6, 1e-9, False), (2e-6, np.inf, False)],
)
def test_a_result_is_silent_where_its_error_is_above_a_millionth_and_its_bound(
    monkeypatch, off: float, bound: float, silent: bool
):
    true = [flint.arb(-4), flint.arb(1)]
    found = certify(monkeypatch, [-4.0, 1.0 + 4.0 * off], true, 4.0 * bound / allowed_error(1.0))
    assert found.silently_wrong is silent


def test_what_vanishes_is_right_where_it_is_0_and_wrong_by_all_elsewhere(monkeypatch):
    zeros = [flint.arb(0), flint.arb(0)]
    right = certify(monkeypatch, [0.0, 0.0], zeros, 0.0)
    assert (right.relative, right.relative_bound, right.kappa) == (0.0, 0.0, np.inf)
    assert right.ulps.tolist() == [0.0, 0.0] and np.isnan(right.ratio)
    wrong = certify(monkeypatch, [0.0, 1e-300], zeros, 1e-280)
    assert (wrong.relative, wrong.relative_bound, wrong.digits) == (np.inf, np.inf, 0.0)
    assert wrong.ulps.tolist() == [0.0, np.inf]


# ---- Enclosures ----------------------------------------------------------------------------------


def arb(middle: float, radius: float = 0.0) -> flint.arb:
    return flint.arb(middle, radius)


@pytest.mark.parametrize(
    ("vdot", "v", "digits"),
    [
        ([arb(2.0), arb(0.0)], [arb(1.0)], math.inf),
        ([arb(2.0, 2e-10), arb(1e-5, 1e-25), arb(0.0)], [arb(1.0)], 10.0),
        ([arb(-2.0, 2e-30), arb(1e-5, 1e-17)], [arb(1.0)], 12.0),
        # What may be 0 has the digits of a share 2^-400 of the largest entry, or of |v|².
        ([arb(1e3), arb(0.0, 1e-130)], [arb(1.0)], 133 - 400 * math.log10(2.0)),
        ([arb(1e3), arb(0.0, 1e-130)], [arb(2.0), arb(-1e5)], 140 - 400 * math.log10(2.0)),
        ([arb(0.0, 1e-130)], [arb(0.0)], -math.inf),
        ([arb(1.0, 1e-20), arb(math.nan)], [arb(1.0)], -math.inf),
        ([arb(1.0, 1e-20)], [arb(1.0), arb(math.inf)], -math.inf),
    ],
)
def test_the_digits_that_are_certain_are_those_of_the_worst_entry(vdot, v, digits: float):
    with precision(200):
        assert enclosure._certain_digits(np.array(vdot), np.array(v)) == pytest.approx(
            digits, abs=1e-6
        )


@pytest.mark.parametrize(
    ("known", "enough", "tried"),
    [
        ({}, 164, [164]),
        ({}, 165, [164, 328]),
        ({656: 656, 164: 164}, 657, [328, 1312]),
        ({}, 5248, [164, 328, 656, 1312, 2624, 5248]),
    ],
)
@pytest.mark.parametrize("refuses", [False, True])
def test_bits_are_doubled_until_the_digits_are_certain(monkeypatch, known, enough, tried, refuses):
    made: list[int] = []

    def in_balls(scene, q, start, t, bits) -> int:
        assert (q, start, t) == (1, 2, 0.5)
        made.append(bits)
        return bits

    def with_bits(at, formulation, bits, partition) -> Any:
        assert at == bits
        if bits < enough and refuses:
            raise RefusedError("M", 0.0, 0.0, f"{bits} bits")
        return SimpleNamespace(digits=30.0 if bits >= enough else 29.0, bits=bits)

    monkeypatch.setattr(enclosure, "_ball_quantities", in_balls)
    monkeypatch.setattr(enclosure, "_enclosure_of", with_bits)
    given: Any = SLEIGH, FORMULATIONS["au"], 1, 2, 0.5, 30, None
    enclosed: Any = enclosure.enclosure_at
    before, known = set(known), dict(known)
    found = enclosed(*given, known)
    assert found.bits == next(164 * 2**k for k in range(9) if 164 * 2**k >= enough)
    assert made == tried
    assert set(known) == before | set(tried)
    with pytest.raises(RefusedError, match="5248 bits" + ("" if refuses else " 29 digits")):
        enough = 10_000
        enclosed(*given)


# ---- Velocities ----------------------------------------------------------------------------------


def test_how_large_a_violation_may_be_is_what_all_moved_coordinates_make_of_it(monkeypatch):
    a, b = np.array([[1.0, -2.0], [0.0, 3.0]]), np.array([0.5, -5.0])
    at: Any = SimpleNamespace(
        unit_roundoff=2.0**-53, q=np.ones(2), v=np.array([2.0, -1.0]), t=0.7, scene=None
    )
    at.terms = Terms(None, None, None, a, None, b)
    seen = []

    def moved(scene, q, v, t) -> Any:
        seen.append((v is at.v, t))
        k = len(seen)
        da, db = STEP * np.array([[k % 3, 0], [0, -k]]), STEP * np.array([0.0, k])
        return SimpleNamespace(terms=Terms(None, None, None, a + da, None, b + db))

    monkeypatch.setattr(sensitivity, "Evaluation", moved)
    size = np.array([4.5, 8.0])  # |a| |v| + |b|
    change = np.array([2.0 * 2, SAMPLES + SAMPLES])
    expected = allowed_error(1.0) * (size + change)
    assert sensitivity.allowed_violation(at) == pytest.approx(expected, rel=1e-6, abs=0.0)
    assert seen == [(True, 0.7)] * SAMPLES
    at.terms = at.terms._replace(b=-a @ at.v)
    at.terms.b[1] += 2.0 * EPS
    expected = allowed_error(1.0) * np.array([8, 6])
    assert sensitivity.allowed_violation(at) == pytest.approx(expected, abs=0.0)
    assert len(seen) == SAMPLES


@pytest.mark.parametrize("off", [0.0, 1e-9])
def test_a_velocity_is_held_against_the_constraints_of_its_time(off: float):
    scene = TurntableBall(swing=1.0, frequency=3.0)
    _, (q, _, _) = ordinary(TurntableBall)
    at = Evaluation(scene, q, np.zeros(5), 0.7)
    v = -np.linalg.lstsq(at.terms.a, at.terms.b, rcond=None)[0]
    v += off * at.terms.a[1]
    if off == 0.0:
        sensitivity.check_consistent(Evaluation(scene, q, v, 0.7))
        return
    with pytest.raises(InconsistentVelocityError):
        sensitivity.check_consistent(Evaluation(scene, q, v, 0.7))


@pytest.mark.parametrize(("share", "fine"), [(5e-7, True), (2e-6, False), (-2e-6, False)])
def test_no_velocity_is_returned_that_is_far_from_that_of_the_speeds(monkeypatch, share, fine):
    monkeypatch.setattr(dynamics, "consistent_velocity", lambda at, v: v * (1.0 + share))
    q, u = np.array([0.1, 0.2, 0.6]), np.array([-0.8, 2.1])
    if fine:
        assert np.isfinite(dynamics.velocity(SLEIGH, q, u)).all()
        return
    with pytest.raises(RefusedError, match="no velocity in doubles near W u"):
        dynamics.velocity(SLEIGH, q, u)


@pytest.mark.parametrize(
    ("vdot", "multipliers", "fine"),
    [
        ([1.0, 2.0], None, True),
        ([1.0, 2.0], [3.0], True),
        ([1.0, np.inf], None, False),
        ([1.0, 2.0], [3.0, -np.inf], False),
        ([np.nan, 2.0], [3.0], False),
    ],
)
def test_a_result_is_refused_where_anything_in_it_overflows(vdot, multipliers, fine: bool):
    at = Evaluation(SLEIGH, np.zeros(3), np.zeros(3))
    found = np.array(vdot), None if multipliers is None else np.array(multipliers)
    with nullcontext() if fine else pytest.raises(RefusedError, match="v̇ by au overflows"):
        at.check_finite(*found, FORMULATIONS["au"])


# ---- Closed positions ----------------------------------------------------------------------------


def newton(residual, q: list, kept: Any = None) -> tuple[np.ndarray, float, bool]:
    """Return what `closing.newton` does with four constraints of which 1 and 2 are holonomic."""
    a = np.array([[7.0, 7.0], [1.0, 0.0], [0.0, 2.0], [7.0, -7.0]])
    scene = SimpleNamespace(
        r=4, holonomic=slice(1, 3), position_residual=lambda parameters, prepared, q: residual(q)
    )
    at: Any = SimpleNamespace(scene=scene, parameters=None, prepared=None)
    at.run = lambda function, *given: function(*given)
    at.elsewhere = lambda q: SimpleNamespace(
        **{**vars(at), "q": q, "terms": Terms(None, None, None, a, None, None)}
    )
    return constraint_rank.newton(at, np.array(q), kept)


def test_a_search_ends_with_the_constraints_that_are_kept():
    def residual(q):
        return np.array([q[0] - 3.0, 2.0 * (q[1] + 5.0)])

    for kept, expected in ((None, [3.0, -5.0]), ([0, 1], [3.0, 9.0]), ([2, 3], [9.0, -5.0])):
        q, step, closed = newton(residual, [9.0, 9.0], kept)
        assert (q.tolist(), step, closed) == (expected, 0.0, True)


@pytest.mark.parametrize(
    ("noise", "q", "closed"),
    [(1e-9, 1e6, True), (1e-7, 1e6, False), (1e-9, 1.0, False), (1e-15, 0.0, True)],
)
def test_a_search_has_ended_where_steps_are_rounding_of_the_coordinates(noise, q, closed):
    found, step, shrank = newton(lambda q: np.array([noise, 0.0]), [q, 0.0])
    assert shrank is closed
    assert step == pytest.approx(noise)
    assert (abs(found[0] - q) > 40 * noise) is not closed


# ---- How far rounding goes -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "changes", "solved", "found"),
    [
        (3.0, [1.0, 5.0, 2.0, 0.0, 9.0], False, 3.0 + 5.0 / STEP),
        (3.0, [1.0, 5.0, 2.0, 0.0, np.inf], False, np.inf),
        (3.0, [1.0, 5.0, 2.0, 0.0, 3.9], True, np.inf),
        (3.0, [1.0, 5.0, 2.0, 0.0, 4.1], True, 3.0 + 5.0 / STEP),
        (3.0, [1.0, 5.0, 2.0, 0.0, 3.9], False, 3.0 + 5.0 / STEP),
        (2.0**13, [1.9, 0.0, 0.0, 0.0, 0.0], True, 2.0**13 + 1.9 / STEP),
        (2.0**13, [2.1, 0.0, 0.0, 0.0, 0.0], True, np.inf),
        (3.0, [0.0, 5.0, 2.0, 0.0, 0.0], True, 3.0 + 5.0 / STEP),
        (0.0, [1e-280, 0.0, 0.0, 0.0, 0.0], True, 1e-280 / STEP),
        (0.0, [0.0, np.inf, 0.0, 0.0, 0.0], False, np.inf),
    ],
)
def test_what_rounding_amplifies_is_the_size_and_the_largest_change(size, changes, solved, found):
    assert len(changes) == SAMPLES + 1 and STRETCH == 8.0
    assert float(sensitivity.amplification(size, np.array(changes), solved)) == found
    both = np.stack((np.zeros(5), changes), axis=1)
    several = sensitivity.amplification(np.array([1.0, size]), both, solved)
    assert several.tolist() == [1.0, found]


def test_each_entry_is_as_sensitive_as_the_copy_that_moves_it_most(monkeypatch):
    here = np.array([[1.0, -2.0], [0.0, 4.0]])
    moves = [[1, 0, 0, 2], [-3, 0, 1, 0], [0, -5, 0, 0], [2, 4, 0, 0], [99, 99, 99, 99]]
    moved = BatchArray(here + STEP * np.reshape(moves, (5, 2, 2)))
    samples = SimpleNamespace(x=moved, computing=lambda name: nullcontext())
    asked = []

    def perturbed(at, coordinates) -> Any:
        asked.append(coordinates)
        return samples

    monkeypatch.setattr(sensitivity, "perturbed_samples", perturbed)
    at: Any = SimpleNamespace(x=here, states=0)
    found = sensitivity.entry_sensitivity_of(at, lambda e: e.x)  # type: ignore[attr-defined]
    assert found.tolist() == [[4.0, 7.0], [1.0, 6.0]] and asked == [True]

    def refusing(e) -> Any:
        if e is samples:
            raise RefusedError("M", 0.0, 1.0, "M is singular")
        return e.x

    assert sensitivity.entry_sensitivity_of(at, refusing).tolist() == [[1.0, 2.0], [0.0, 4.0]]


@pytest.mark.parametrize(
    ("rcond", "spread", "told"),
    [
        ({}, np.inf, True),
        ({"a_1": 0.5}, 1.0, True),
        ({"a_1": 0.5}, np.inf, False),
        ({"a_1": 0.5, "other": 1e-13}, 1.0, False),
    ],
)
def test_speeds_are_told_where_their_matrices_are_and_w_is_more_than_rounding(
    monkeypatch, rcond, spread, told
):
    def of(at, quantity, *, solved) -> Any:
        assert solved
        return BatchArray(np.array([1.0, spread, 1.0])) if at.states else spread

    monkeypatch.setattr(sensitivity, "sensitivity_of", of)
    at: Any = SimpleNamespace(unit_roundoff=2.0**-53, speeds_rcond=rcond, states=0)
    assert sensitivity.speeds_resolved(at) is told
    several = {name: np.array([0.5, 0.5, x]) for name, x in rcond.items()}
    at = SimpleNamespace(unit_roundoff=2.0**-53, speeds_rcond=several, states=3)
    bad = [False, not rcond or np.isfinite(spread), not rcond or min(rcond.values()) > 1e-3]
    expected = [True, bad[1], bad[2]]
    assert sensitivity.speeds_resolved(at).data.tolist() == expected


DETERMINANT = "sign", "log_determinant"


def solve(sign: Any, log: Any) -> Any:
    return SimpleNamespace(sign=np.array(sign), log_determinant=np.array(log))


def test_of_lanes_each_is_unsure_by_any_matrix_and_any_copy(monkeypatch):
    key = "el", False
    lots = 8.0 * STEP / C / EPS / 1e3  # eight times what would be too much
    ones, zero = [1.0] * 6, [0.0] * 6
    here = {"M": solve(ones, zero), "a'T": solve(ones, zero)}
    jump, nan = [0, 0, lots, 0, 0, 0], [0, 0, 0, np.nan, 0, 0]
    moves = [
        {"M": solve([1, -1, 1, 1, 1, 1], zero), "a'T": solve(ones, zero)},
        {"M": solve(ones, zero), "a'T": solve(ones, jump)},
        {"M": solve(ones, nan), "a'T": solve(ones, [0, 0, 0, 0, 0.01 * lots, 0])},
        {"M": solve(ones, zero), "a'T": solve(ones, zero)},
        {"M": solve([-1.0] * 6, zero), "a'T": solve(ones, zero)},  # stretched: does not count
    ]
    solves = {
        name: solve(*(np.ravel([getattr(one[name], of) for one in moves]) for of in DETERMINANT))
        for name in here
    }
    rcond = {"M": np.array(ones), "a'T": np.array([1.0, 1, 1, 1, 1, 1e-13])}
    vdot = BatchArray(np.zeros((6, 1)))
    samples = SimpleNamespace(
        solves={key: solves},
        solution_without_noise=lambda *given: SimpleNamespace(
            vdot=BatchArray(np.zeros((30, 1)) + STEP * (np.arange(30) == 8)[:, None])
        ),
    )
    at: Any = SimpleNamespace(
        unit_roundoff=2.0**-53,
        states=6,
        solves={key: here},
        acceleration=lambda *given: SimpleNamespace(rcond=rcond, vdot=vdot),
    )
    monkeypatch.setattr(sensitivity, "perturbed_samples", lambda *given: samples)
    monkeypatch.setattr(
        sensitivity, "sensitivity_of", lambda *given, **how: BatchArray(np.arange(6.0))
    )
    found = sensitivity.acceleration_sensitivity(at, FORMULATIONS["el"])
    assert found.data.tolist() == [0.0, np.inf, np.inf, np.inf, 4.0, np.inf]
    # By inputs alone the second sample moves state 2 by 7 steps.
    solves["a'T"].log_determinant[:] = 0.0
    samples.solution_without_noise = lambda *given: SimpleNamespace(
        vdot=BatchArray(np.zeros((30, 1)) + 7 * STEP * (np.arange(30) == 8)[:, None])
    )
    found = sensitivity.acceleration_sensitivity(at, FORMULATIONS["el"])
    assert found.data.tolist() == [0.0, np.inf, 7.0, np.inf, 4.0, np.inf]


def test_a_lane_is_refused_by_any_of_its_matrices_its_speeds_or_what_overflows(monkeypatch):
    at: Any = object.__new__(BatchEvaluation)
    at.states, at.scene, at.solves = 6, SLEIGH, {}
    at.refused = {SPEEDS: np.arange(6) == 4}
    at.speeds_rcond = {"a_1": np.full(6, 0.25)}
    watch = SolveRecorder()
    watch.refused = [np.arange(6) == 1, np.arange(6) == 2]
    watch.solves = [SolveRecord("M_Kane", 2, np.full(6, 0.5), 1.0, 0.0)]
    vdot = np.ones((6, 3))
    vdot[3, 2] = np.inf
    monkeypatch.setattr(at, "recording_solves", lambda key: nullcontext(watch), raising=False)
    monkeypatch.setattr(
        at, "solution", lambda *given: Solution(BatchArray(vdot.copy()), None), raising=False
    )
    found = at._solve(FORMULATIONS["kane"], False)
    refused = [False, True, True, True, True, False]
    assert at.refused["kane", False].tolist() == refused
    assert np.isnan(found.vdot.data).all(axis=1).tolist() == refused
    assert np.isfinite(found.vdot.data).all(axis=1).tolist() == [not x for x in refused]
    assert {name: x[0] for name, x in found.rcond.items()} == {"a_1": 0.25, "M_Kane": 0.5}
    at.refused = {SPEEDS: np.arange(6) == 4}
    at._solve(FORMULATIONS["au"], False)
    assert not at.refused["au", False][4]


# ---- Redundant constraints -----------------------------------------------------------------------

NAMES = ("front", "rear", "left", "right")
FOUND = constraint_rank.RowRank(
    np.array([0, 2]), np.array([1, 3]), np.array([1, 0.25, 1, 0.5]), np.array([0, 0.3, 0, 0.6])
)


def around(
    monkeypatch, closed: list[bool], there: list[constraint_rank.RowRank]
) -> tuple[Any, list]:
    """Return a pose of which the neighbours, either way, may be closed and have these ranks."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [3.0, 0.0, -6.0], [0.0, 0.0, 0.0]])
    scene = SimpleNamespace(n=3, angle_coordinates=slice(1, 2), constraint_names=NAMES)
    at: Any = SimpleNamespace(scene=scene, q=np.array([-4.0, 9.0, 2.0]))
    at.terms = Terms(None, None, None, a, None, None)
    at.elsewhere = lambda q: q
    asked: list = []

    def search(at, q, kept) -> Any:
        asked.append((q - at.q, kept.tolist()))
        return len(asked) - 1, 0.0, closed[len(asked) - 1]

    monkeypatch.setattr(constraint_rank, "newton", search)
    monkeypatch.setattr(constraint_rank, "rank_of", lambda place: there[place])
    return at, asked


GROWN = constraint_rank.RowRank(
    np.array([0, 1, 2]), np.array([3]), FOUND.distance, FOUND.uncertainty
)
OTHERS = constraint_rank.RowRank(
    np.array([1, 2]), np.array([0, 3]), FOUND.distance, FOUND.uncertainty
)


@pytest.mark.parametrize(
    ("closed", "there", "tried", "fine"),
    [
        ([True], [FOUND], 1, True),
        ([True], [OTHERS], 1, True),
        ([True, True], [GROWN, FOUND], 1, False),
        ([False, True], [GROWN, FOUND], 2, True),
        ([False, True], [FOUND, GROWN], 2, False),
        ([False, False], [FOUND, FOUND], 2, False),
    ],
)
def test_redundant_rows_are_so_in_a_position_nearby_to_one_side(
    monkeypatch, closed, there, tried, fine
):
    at, asked = around(monkeypatch, closed, there)
    if fine:
        constraint_rank.check_redundant(at, FOUND)
    else:
        with pytest.raises(RefusedError, match="the constraints of rear, right depend") as refused:
            constraint_rank.check_redundant(at, FOUND)
        assert (refused.value.rcond, refused.value.threshold) == (0.25, 0.3)
    assert len(asked) == tried
    for (away, kept), side in zip(asked, (1.0, -1.0), strict=False):
        # Along what all constraints allow, by a share of the largest coordinate that is no angle.
        assert kept == [0, 2]
        assert away == pytest.approx(side * asked[0][0])
        assert np.abs(away) == pytest.approx(
            [4.0 * constraint_rank.NEARBY, 0.0, 2.0 * constraint_rank.NEARBY]
        )


def test_rows_of_what_cannot_move_are_redundant(monkeypatch):
    at, asked = around(monkeypatch, [], [])
    at.terms = at.terms._replace(a=np.eye(4)[:, :3])
    constraint_rank.check_redundant(at, FOUND._replace(kept=np.array([0, 1, 2])))
    assert not asked


@pytest.mark.parametrize(
    ("closed", "kept", "says"),
    [
        (True, [0, 2], ""),
        (True, [0, 1], ""),
        (True, [0, 1, 2], "the rank of a is 3 here and was 2 where the motion began"),
        (True, [2], "the rank of a is 1 here and was 2 where the motion began"),
        (False, [0, 2], "no position next to it satisfies the constraints that were kept"),
    ],
)
def test_along_a_motion_the_rank_is_watched_next_to_it(monkeypatch, closed, kept, says):
    at, asked = around(monkeypatch, [closed], [FOUND._replace(kept=np.array(kept))])
    partition: Any = SimpleNamespace(kept=np.array([0, 2]))
    with pytest.raises(RefusedError, match=says) if says else nullcontext():
        constraint_rank.check_rank_kept(at, partition)
    assert [kept for _, kept in asked] == [[0, 2]] and not asked[0][0].any()


@pytest.mark.parametrize(
    ("off", "spread", "fine"),
    [(60, 0.0, True), (70, 0.0, False), (70, 10.0, True), (380, 10.0, True), (390, 10.0, False)],
)
@pytest.mark.parametrize("sign", [1, -1])
def test_a_contradiction_is_more_than_rounding_of_what_is_added(
    monkeypatch, off: float, spread: float, fine: bool, sign: int
):
    def of(at, residual, *, solved) -> float:
        assert solved and residual(at).tolist() == [0.0, 0.0, sign * off * EPS]
        return spread

    monkeypatch.setattr(sensitivity, "sensitivity_of", of)
    a, gamma = np.array([[0.5, 0.0], [0.0, 0.25], [1.0, 0.0]]), np.array([-0.5, 0.0, -1.0])
    gamma[2] += sign * off * EPS
    found = Acceleration(np.array([1.0, 0.0]), None, {}, np.inf)
    at: Any = SimpleNamespace(scene=SimpleNamespace(constraint_names=NAMES))
    at.terms = Terms(None, None, None, a, gamma, None)
    at.acceleration = lambda formulation: found
    given = at, FORMULATIONS["uk"], found
    if fine:
        sensitivity.check_no_contradiction(*given)
        return
    with pytest.raises(RefusedError, match="the constraint of left contradicts") as refused:
        sensitivity.check_no_contradiction(*given)
    assert refused.value.rcond == pytest.approx(32.0 * (spread + 2.0) / off)


def test_a_refusal_says_which_constraints_are_redundant_or_that_it_is_not_clear():
    refusal = RefusedError("M", 1e-20, 1e-15, "M is singular", np.eye(2))
    unclear = RefusedError("rank of a", 0.1, 0.2, "the rank of a is not clear")

    class Pose(SimpleNamespace):
        @property
        def independent_partition(self) -> Any:
            if self.redundant is unclear:
                raise unclear
            return SimpleNamespace(redundant=self.redundant)

    def said(a: Any, which: Any, of: RefusedError = refusal) -> RefusedError:
        at: Any = Pose(terms=SimpleNamespace(a=a), redundant=which)
        at.scene = SimpleNamespace(constraint_names=NAMES)
        return dynamics.with_redundancy_hint(at, of)

    assert said(None, unclear) is refusal and said(1, None) is refusal
    assert said(1, [0], unclear) is unclear
    rows = np.array([[1.0, 0.0], [-2.0, 0.0], [0.0, 1.0], [1.0, -0.5]])
    both = said(rows, [1, 3])
    assert "M is singular; redundant, for the other constraints imply it: rear, right" in str(both)
    left = NAMES[0], NAMES[2]
    sums = f"rear = -2 {left[0]}; right = {left[0]} - 0.5 {left[1]}"
    assert f"(rows of a: {sums}; uk solves it as it is" in str(both)
    assert str(said(1, unclear)) == "M is singular; the rank of a is not clear"
    for one in (both, said(1, unclear)):
        assert (one.what, one.rcond, one.threshold) == ("M", 1e-20, 1e-15)
        assert one.matrix is refusal.matrix


# ---- Time ----------------------------------------------------------------------------------------


def test_truth_and_doubles_are_of_the_state_and_time_that_are_given():
    scene = TurntableBall(swing=1.0, frequency=3.0)
    _, (q, _, _) = ordinary(TurntableBall)
    u = [0.1, -0.3, 0.7]
    truth, at = certified.true_acceleration(scene, q, u, 0.7)
    assert (at.u.tolist(), at.t) == (u, 0.7)
    assert at.v.tolist() == [float(x.mid()) for x in truth.v]
    ways: tuple[Any, ...] = {"u": u}, {"v": at.v}
    for how in ways:
        for key in ("au", "kane"):
            assert certified.accuracy(scene, key, q, t=0.7, **how).digits > 12


def test_lanes_allow_the_violation_that_each_allows_alone():
    scene = TurntableBall(swing=1.0, frequency=3.0)
    _, (q, _, _) = ordinary(TurntableBall)
    states = []
    for t, off in ((0.7, 0.0), (0.2, 1e-9), (0.4, 0.0)):
        at = Evaluation(scene, q, np.zeros(5), t)
        right = np.array([0.0, off]) - at.terms.b  # off in the second row alone
        v = np.linalg.lstsq(at.terms.a, right, rcond=None)[0]
        states.append(State(q, v, t))
    at = BatchEvaluation([scene] * 3, states)
    found = sensitivity.allowed_violation(at).data
    for lane, state in enumerate(states):
        expected = sensitivity.allowed_violation(Evaluation(scene, *state))
        assert found[lane] == pytest.approx(expected, rel=1e-12, abs=0.0)
