"""Where motions start, how they are cut to pieces, and how much of them is kept."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS
from eomcheck.motion import observables, simulate
from eomcheck.motion.batch import starts_of, state_vectors
from eomcheck.motion.integrators import Steps
from eomcheck.motion.reference import Extrapolation
from eomcheck.motion.reference_solution import drift_of
from eomcheck.motion.simulate import check_options, checked_times, initial_values
from eomcheck.motion.stabilization import check_stabilization, integrate_in_pieces
from eomcheck.scenes import SCENES, ChainPendulum, Sleigh, Snake

SLEIGH = Sleigh(mass=1.3, inertia=0.21, offset=0.37, rate=2.1)

# ---- Starts --------------------------------------------------------------------------------------


def test_a_scene_that_moves_by_itself_is_at_rest_in_a_pose_that_is_given():
    scene: Any = SCENES["bicycle"]()
    q, v = scene.initial_state()
    assert v.any()
    assert [x.tolist() for x in initial_values(scene, None, None, None)[:2]] == [
        q.tolist(),
        v.tolist(),
    ]
    assert initial_values(scene, q, None, None)[1].tolist() == np.zeros(9).tolist()
    assert initial_values(scene, q, v, None)[1].tolist() == v.tolist()
    own, still = (
        starts_of(scene, None, None, None, {"speed": [scene.speed]})[0],
        starts_of(scene, [q], None, None, {})[0],
    )
    assert own.speeds.tolist() == v.tolist() and not still.speeds.any()


@pytest.mark.parametrize("key", ["au", "kane"])
def test_a_start_by_velocities_is_refused_where_no_speeds_exist_to_those_that_need_them(key: str):
    scene = Snake(np.ones(3), np.ones(3), np.ones(3), None, [0.0, np.pi / 2, 0.0])
    starts = starts_of(scene, [[0.0, 0.0, 0.1, 0.5, 1.0]], [np.zeros(5)], None, {})
    y, (why,) = state_vectors(starts, False, FORMULATIONS[key], 1)
    assert np.isfinite(y).all() == (key == "au")
    assert ("wheel_angle[1]" in why) is (key != "au")


@pytest.mark.parametrize("across", [1e-7, 1e-8])
def test_speeds_whose_velocity_loses_its_digits_are_refused_as_alone(across: float):
    scene = Snake(np.ones(3), np.ones(3), np.ones(3), None, [0.0, np.pi / 2 - across, 0.0])
    q = np.array([0.0, 0.0, 0.1, 0.5, 1.0])
    at = Evaluation(scene, q, np.zeros(5))
    W = at.speeds.W
    largest = W[np.unravel_index(np.argmax(np.abs(W)), W.shape)[0]]
    u = np.array([largest[1], -largest[0]]) / np.abs(largest).max()  # all but cancels
    starts = starts_of(scene, [q], None, [u], {})
    y, (why,) = state_vectors(starts, True, FORMULATIONS["kane"], 1)
    if across == 1e-7:
        assert np.isfinite(y).all() and why == ""
        return
    with pytest.raises(RefusedError, match="v cancels") as alone:
        velocity(scene, q, u)
    assert np.isnan(y).all() and why == str(alone.value)


@pytest.mark.parametrize("name", ["baumgarte", "projection"])
def test_what_has_no_constraint_is_not_kept_on_any(name: str):
    scene = ChainPendulum.example()
    how = {"baumgarte": None, "projection": None} | {name: 1.0}
    with pytest.raises(InputError, match=rf"{name} = 1.0 does not apply: .* has no constraint"):
        check_stabilization(scene, FORMULATIONS["au"], **how)


@pytest.mark.parametrize(
    "times", [[0.0, 0.5, 0.5], [-1e-9, 0.5], [0.5, np.nextafter(1.0, 2.0)], [[0.1, 0.2]], 0.5, []]
)
def test_output_times_rise_from_0_to_the_end_and_none_comes_twice(times: Any):
    with pytest.raises(InputError, match="output_times"):
        checked_times(times, 1.0)
    assert checked_times([0.0, 0.5, 1.0], 1.0).tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("name", ["t_end", "rtol", "atol", "max_step"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, True, "1", None])
def test_all_options_are_positive_and_only_the_longest_step_may_be_endless(name: str, value: Any):
    if name == "max_step" and value == np.inf:
        check_options(0, max_step=value)
        return
    with pytest.raises(InputError, match=f"{name} = "):
        check_options(0, **{name: value})


# ---- Pieces --------------------------------------------------------------------------------------


def pieces(t_end: float, times: list[float] | None, most: int) -> tuple[list[Any], Steps]:
    """Return what is asked of each piece of 0.4 s, of two steps, three in the first; y is t."""
    asked: list[Any] = []

    def piece(start, end, y, first_step, output_times, max_steps) -> Steps:
        wanted = None if output_times is None else output_times.tolist()
        asked.append((start, end, y.tolist(), first_step, wanted, max_steps))
        t = np.linspace(start, end, 3 if start else 4) if wanted is None else np.array(wanted)
        return Steps(t, np.stack((t, 0.0 * t), axis=1), 2 if start else 3, True, "")

    def project(t: float, y: np.ndarray) -> np.ndarray:
        return np.array([y[0], t + 10.0])

    wanted = None if times is None else np.array(times)
    return asked, integrate_in_pieces(piece, project, np.zeros(2), t_end, 0.4, 0.125, wanted, most)


def test_each_piece_goes_on_from_what_was_projected_at_the_end_of_the_one_before():
    asked, found = pieces(1.0, None, 9)
    assert [one[:3] for one in asked] == [
        (0.0, 0.4, [0.0, 0.0]),
        (0.4, 0.8, [0.4, 10.4]),
        (0.8, 1.0, [0.8, 10.8]),
    ]
    # 0.9 mean steps of the piece before, or of what is left.
    assert [one[3] for one in asked] == pytest.approx([0.125, 0.9 * 0.4 / 3, 0.9 * 0.2])
    assert [one[5] for one in asked] == [9, 6, 4]
    assert found.t == pytest.approx([0.0, 0.4 / 3, 0.8 / 3, 0.4, 0.6, 0.8, 0.9, 1.0])
    assert found.y[:, 0].tolist() == found.t.tolist()
    assert found.y[:, 1] == pytest.approx([0, 0, 0, 10.4, 0, 10.8, 0, 11.0])
    assert (found.steps, found.success, found.message) == (7, True, "")


def test_pieces_give_what_is_asked_for_and_each_time_once():
    asked, found = pieces(1.0, [0.0, 0.4, 0.5, 0.9], 0)
    assert [one[4] for one in asked] == [[0.0, 0.4], [0.5, 0.8], [0.9, 1.0]]
    assert [one[5] for one in asked] == [0, 0, 0]
    assert found.t.tolist() == [0.0, 0.4, 0.5, 0.9]
    assert found.y[:, 1].tolist() == [0.0, 10.4, 0.0, 0.0]


@pytest.mark.parametrize(
    ("t_end", "most", "count", "success"),
    [
        (1.0, 7, 3, True),
        (1.0, 5, 2, False),
        (1.0, 3, 1, False),
        (0.8, 5, 2, True),
        (0.1, 0, 1, True),
    ],
)
def test_pieces_are_as_many_as_fit_and_as_steps_are_enough_for(t_end, most, count, success):
    asked, found = pieces(t_end, None, most)
    assert (len(asked), found.success) == (count, success)
    assert found.message == ("" if success else f"{most} steps were not enough")
    assert asked[-1][1] == (t_end if success else 0.4 * count)


# ---- What is kept --------------------------------------------------------------------------------

COUNT = 1000


def course(
    multipliers: np.ndarray, refused: set[int], crossed: Any = None
) -> simulate._ObservedMotion:
    """Return the course of a motion of which state i is i, and v, energy and constraint 0."""
    zero = np.zeros((COUNT, 1))
    seen = {"v": zero, "energy": zero, "constraint": zero, "multipliers": multipliers}

    def evaluation(y: np.ndarray, t: float) -> Any:
        def acceleration(formulation) -> Any:
            if int(y[0]) in refused:
                raise RefusedError("M", 0.0, 1.0, f"state {y[0]:g}")
            return SimpleNamespace(rcond={"M": 1.0 / (1.0 + y[0])}, vdot=np.ones(1))

        return SimpleNamespace(acceleration=acceleration)

    motion: Any = SimpleNamespace(
        formulation=FORMULATIONS["au"],
        observables=lambda t, y: seen,
        singular_crossing=lambda t, y: crossed,
        evaluation=evaluation,
        choice=None,
    )
    t = np.arange(COUNT) / 10.0
    steps = Steps(t, np.arange(COUNT)[:, None].astype(float), COUNT, True, "")
    return simulate._ObservedMotion(motion, steps, steps)


def test_a_motion_is_kept_up_to_the_first_state_that_is_refused():
    both = np.zeros((COUNT, 2))
    looked = set(np.linspace(0, COUNT - 1, simulate.MOST_CHECKED_STATES).astype(int).tolist())
    whole = course(both, set())
    assert (whole.valid_count, whole.whole, whole.refused) == (COUNT, True, None)
    assert whole.rcond == {"M": 1.0 / COUNT}
    odd = next(i for i in range(500, 510) if i not in looked)
    assert course(both, {odd}).whole  # which nobody looks at
    unknown = both.copy()
    unknown[odd, 1] = unknown[odd + 400, 0] = np.nan
    found = course(unknown, {odd, odd + 400, max(looked)})
    assert (found.valid_count, found.whole) == (odd, False)
    assert found.refused is not None
    assert found.refused[0] == f"the state at t = {odd / 10:.9g} s is refused: state {odd}"
    rows = found.rows("multipliers")
    assert rows is not None and rows.shape == (odd, 2) and np.isfinite(rows).all()


def test_of_a_pose_that_is_crossed_and_a_state_refused_the_earlier_ends_a_motion():
    both = np.zeros((COUNT, 2))
    for refused, kept, says in ((999, 301, "between t = 30 s and 30.1 s"), (0, 0, "state 0")):
        found = course(both, {refused}, (30.0, 30.1))
        assert found.refused is not None
        assert found.valid_count == kept and says in found.refused[0]


# ---- Poses that are crossed ----------------------------------------------------------------------


def test_the_pose_that_is_told_is_the_first_and_where_it_was(monkeypatch):
    a_1 = np.array([1.0, 2.0, -1.0, -2.0, 1.0]).reshape(5, 1, 1)
    kernel = SimpleNamespace(
        block=lambda given: None, rows=lambda block, t, y: {"a_1": a_1[t[:, 0].astype(int)]}
    )
    monkeypatch.setattr(observables, "traced_kernel", lambda *how: kernel)
    t, y = np.arange(5.0)[:, None], np.zeros((5, 1, 1))
    for entries in (1, 2, 3, 100):
        monkeypatch.setattr(observables, "ENTRIES", entries)
        assert observables.singular_crossings(SLEIGH, FORMULATIONS["em"], {}, t, y) == [(1, 2)]
    assert "between t = 0.5 s and 0.75 s the matrix a_1" in str(
        observables.crossing_refusal(0.5, 0.75)
    )


# ---- Errors --------------------------------------------------------------------------------------


def test_a_law_of_growth_is_that_of_the_whole_time_though_the_last_error_is_0():
    times = np.linspace(0.0, 4.0, 21)
    errors = 3e-9 * times**2
    errors[-4:] = 0.0
    found = drift_of(times, errors)
    assert found is not None
    assert (found.rate, found.exponent) == pytest.approx((3e-9 * 4.0, 2.0))


@pytest.mark.parametrize(
    ("y", "better", "worse", "error"),
    [
        ([0.0, 9.0, 0.0], [0.0, 9.0, 0.0], [0.5, 9.0, 0.0], 0.5 / 0.25),
        ([0.0, 9.0, 0.0], [0.0, 9.0, 0.0], [0.0, 4.0, 0.25], 5.0 / 10.0 / 0.25),
        ([0.0, -9.0, 0.0], [0.0, 1.0, 0.0], [0.0, 6.0, 0.0], 5.0 / 10.0 / 0.25),
        ([0.0, 1.0, 0.0], [0.0, -9.0, 0.0], [0.0, -4.0, 0.0], 5.0 / 10.0 / 0.25),
        ([0.0, 1.0, 0.0], [0.0, 1.0, np.nan], [0.0, 1.0, 0.0], np.inf),
    ],
)
def test_an_error_is_the_largest_over_what_each_entry_allows(y, better, worse, error):
    method = Extrapolation(lambda y: y, 0.25)
    assert method.error(*(np.array(x) for x in (y, better, worse))) == pytest.approx(error)


def test_effort_tells_the_longest_step_and_the_orders_of_those_taken():
    seen, method = [Fraction(0)], Extrapolation(lambda y: y * y, 1e-12)
    method.run(np.array([1.0]), [0.0, 0.99], watch=lambda t, y: seen.append(t))
    steps = np.diff([float(t) for t in seen])
    assert method.effort.longest == pytest.approx(steps.max())
    assert steps.max() > 2 * steps[-1]
    few = Extrapolation(lambda y: np.ones_like(y), 1e-12)
    _, after, _ = few.attempt(np.array([0.0]), Fraction(1, 2), 5)
    assert few.effort.orders == {8} and after > 0.5
