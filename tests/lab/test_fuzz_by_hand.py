"""Parts of fuzzing against whole outputs and numbers that are written down."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eomcheck.descriptions.random_mechanisms import RANDOM
from eomcheck.draws import fuzz_cases as velocities
from eomcheck.draws.fuzz_cases import consistent
from eomcheck.errors import EomcheckError, InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.lab.fuzzing import failures as parameters
from eomcheck.lab.fuzzing import motion_comparison, motion_rounds
from eomcheck.lab.fuzzing.failures import (
    fuzz_case,
    parameters_of,
    plain_random,
    random_of,
    sampled_parameters,
)
from eomcheck.lab.fuzzing.motion_comparison import (
    ALONE,
    END_STATES,
    ENERGY,
    MOTION_CLAIMS,
    MotionFinding,
    perturbed_starts,
)
from eomcheck.lab.fuzzing.motion_rounds import MOST_TRIES, shrink_motion
from eomcheck.mechanics.records import State
from eomcheck.numbers.batch_arrays import BatchArray
from eomcheck.scenes import Sleigh, Snake
from eomcheck.testing import EquationsOfMotion
from eomcheck.testing.equations_of_files import equations_named

SLEIGH = Sleigh(mass=1.3, inertia=0.2137, offset=-0.37)
AT = State(np.array([0.1, -2.0, 0.75]), np.array([0.5, 0.25, -1.0]), 0.0)
OWN = EquationsOfMotion(2, M=lambda q: np.eye(1), qdot=lambda q, u: [u[0], 0.0], speeds=1)


# ---- Findings about motions ----------------------------------------------------------------------

MOVED = """\
from eomcheck.formulations import applicable
import eomcheck
from eomcheck.scenes import Sleigh

scene = {}
options = dict(q0=[[0.1, -2.0, 0.75]], v0=[[0.5, 0.25, -1.0]])
options |= dict(rtol=1e-10, atol=1e-10)
one = eomcheck.simulate_many(scene, 'em', 2.5, **options)
for key in applicable(scene):
    other = eomcheck.simulate_many(scene, key, 2.5, **options)
    apart = abs(one.q[0] - other.q[0]).max(axis=1)
    gained = abs(other.energy[0] - other.energy[0, 0]).max()
    print(key, other.status[0], "apart", apart[-1], "energy", gained, other.reason[0])
"""


def test_the_code_of_a_motion_moves_its_scene_by_its_formulation_and_by_all_others():
    found = MotionFinding(*(END_STATES, "em", SLEIGH, AT, 1.0, 0.5, "failed", "made up"), t_end=2.5)
    assert found.as_python() == MOVED.format(repr(SLEIGH))
    assert (found.crossed, found.ended, found.reached) == (None, "finished", False)


def test_three_things_are_claimed_of_motions():
    assert (END_STATES, ENERGY, ALONE) == ("end-states", "motion-energy", "motion-alone")
    assert MOTION_CLAIMS == {
        "end-states": "all formulations move a scene alike",
        "motion-energy": "T + U stays what it was, where nothing takes or brings energy",
        "motion-alone": "a motion alone, by another integrator, is what it is beside others",
    }


@pytest.mark.parametrize("stays", [True, False])
def test_a_motion_is_rounded_at_its_shorter_time_and_kept_as_it_was_if_all_together_pass(
    stays, monkeypatch
):
    def of(scene: Any, t_end: float) -> MotionFinding:
        return MotionFinding(END_STATES, "em", scene, AT, 1.0, 0.5, "failed", "x", t_end=t_end)

    other, asked, tries = Sleigh.example(), [], []

    def failures(case: Any, keys: Any, t_end: float) -> list[MotionFinding]:
        asked.append((case[0], len(keys), t_end))
        if t_end < 1.0 or (len(keys) == 6 and not stays):
            return []
        return [of(case[0], t_end)]

    def rounded(finding: Any, look: Any, most: int) -> Any:
        tries.append((finding.t_end, most))
        (found,) = look(of(other, finding.t_end))
        return found

    monkeypatch.setattr(motion_rounds, "failures_of_motion", failures)
    monkeypatch.setattr(motion_rounds, "simplify_numbers", rounded)
    small = shrink_motion(of(SLEIGH, 2.25), ("au", "em", "gw", "kane", "ml", "uk"))
    assert tries == [(1.0, MOST_TRIES)] and MOST_TRIES == 60
    assert [t for _, _, t in asked] == [1.125, 0.5625, 1.1, 1.0, 1.0, 1.0]
    assert [(one, count) for one, count, _ in asked[-2:]] == [(other, 4), (other, 6)]
    assert (small.scene, small.t_end) == (other if stays else SLEIGH, 1.0)


# ---- What makes a scene again --------------------------------------------------------------------


def test_a_random_scene_is_kept_as_its_description_and_what_was_changed_of_it():
    kind: Any = RANDOM["random-mechanisms"]
    scene = next(kind.structures(3))
    usual = plain_random(scene)
    assert list(usual) == ["description"]
    assert usual["description"][3] == list(scene.source.description.gravity)
    mass = (2.0 * scene.mass).tolist()
    changed = scene.changed(mass=2.0 * scene.mass, gravity=None)
    kept = plain_random(changed)
    assert kept == usual | {"mass": mass, "gravity": None}
    again = random_of(kind, kept)
    assert again.mass.tolist() == mass and again.gravity is None
    assert kept == usual | {"mass": mass, "gravity": None}, "what it is made of is left as it is"
    assert parameters_of(changed) == kept


@pytest.mark.parametrize(
    ("plain", "why"),
    [
        ({}, "'description'"),
        ({"description": [[], []]}, "not enough values to unpack (expected 6, got 2)"),
        ({"description": 7}, "cannot unpack non-iterable int object"),
    ],
)
def test_what_is_no_description_is_refused_in_a_sentence(plain, why):
    with pytest.raises(InputError) as error:
        random_of(RANDOM["random-trees"], plain)
    assert str(error.value) == f"no description of a random scene: {why}"


def test_numbers_of_a_scene_are_those_of_its_ranges_and_none_where_it_has_none():
    assert sampled_parameters(SLEIGH) == parameters_of(SLEIGH)
    assert sampled_parameters(SLEIGH) == {"mass": 1.3, "inertia": 0.2137, "offset": -0.37}
    usual = Snake.coil(3)
    values = {name: getattr(usual, name) for name in Snake.declared}
    snake = Snake(**values | {"damping": None})
    found = sampled_parameters(snake)
    assert set(found) == set(Snake.ranges(3)) and found["damping"] is None
    assert found["mass"] == snake.mass.tolist() and len(found["mass"]) == 3
    assert sampled_parameters(OWN) == parameters_of(OWN) == {}


def test_a_case_has_the_time_and_the_numbers_that_were_kept_in_their_places():
    scene, state = fuzz_case(
        Sleigh, sampled_parameters(SLEIGH), [1.0, 2.0, 3.0], [4.0, 5.0, 6.0], 7.5
    )
    assert repr(scene) == repr(SLEIGH)
    assert [x.tolist() for x in state[:2]] == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert state.t == 7.5
    functions, state = fuzz_case(OWN, {}, [1.0, 2.0], [3.0], 2.5)
    assert functions is OWN
    assert (state.q.tolist(), state.v.tolist(), state.t) == ([1.0, 2.0], [3.0], 2.5)


@pytest.mark.parametrize(
    ("kind", "numbers", "q", "v", "message"),
    [
        (OWN, {}, [1.0], [3.0], "q has shape (1,), expected (2,)"),
        (OWN, {}, [1.0, 2.0], [3.0, 4.0], "v has shape (2,), expected (1,)"),
        (Sleigh, {"mass": 1.0, "colour": 3}, [0.0] * 3, [0.0] * 3, "sleigh of mass, colour: "),
        (Sleigh, {"mass": 1.0}, [0.0] * 2, [0.0] * 3, "q has shape (2,), expected (3,)"),
    ],
)
def test_a_case_that_cannot_be_is_bad_input(kind, numbers, q, v, message):
    with pytest.raises(InputError) as error:
        fuzz_case(kind, numbers, q, v, 0.0)
    assert str(error.value).startswith(message)


def test_only_functions_are_functions_by_name_and_a_file_of_a_robot_is_not_run(monkeypatch):
    names: list[str] = []
    found = {"x.py:own": OWN, "x.py:Sleigh": Sleigh}
    lookup = "eomcheck.testing.equations_of_files.object_named"
    monkeypatch.setattr(lookup, lambda name, required=False: names.append(name) or found[name])
    monkeypatch.setattr("eomcheck.testing.equations_of_files.module_named", lambda home: sys)
    equations_named.cache_clear()
    named = parameters.functions_named
    assert named("x.py:own") is OWN
    assert named("x.py:Sleigh") is None and named("arm.urdf") is None
    assert names == ["x.py:own", "x.py:own", "x.py:Sleigh"]
    equations_named.cache_clear()


# ---- Starts a little apart -----------------------------------------------------------------------


def test_a_start_that_cannot_be_closed_nearby_is_left_out_and_the_others_keep_their_places(
    monkeypatch,
):
    def closed(scene: Any, q: Any, t: float) -> Any:
        assert t == 0.0
        if q[0] > 6.5 and q[0] < 7.5:
            raise EomcheckError("open")
        return q + 100.0

    def consistent(scenes: Any, states: Any, wished: Any) -> Any:
        v = wished(None)
        cases = [(s, State(x.q, y, x.t)) for s, x, y in zip(scenes, states, v, strict=True)]
        return cases[1:], [*range(1, len(cases))]

    monkeypatch.setattr(motion_comparison, "assembled_position", closed)
    monkeypatch.setattr(motion_comparison, "consistent", consistent)
    cases = [
        (SLEIGH, State(np.array([x, -2.0, 0.0]), np.array([0.0, -x, 3.0]), 9.0))
        for x in (5.0, 6.0, 7.0, 8.0)
    ]
    found, places = perturbed_starts(cases)
    assert places == [1, 3]
    away = []
    for place, (_, state) in zip(places, found, strict=True):
        q, v, _ = cases[place][1]
        away.append([(state.q - 100.0 - q) / (1.0 + abs(q)), (state.v - v) / (1.0 + abs(v))])
        assert state.t == 0.0
    away = np.array(away)
    assert np.allclose(away[0], away[1], rtol=1e-5)
    assert not np.allclose(away[0, 0], away[0, 1])
    assert ((abs(away) > 0.49e-8) & (abs(away) < 1.01e-8)).all()


# ---- Velocities that keep the constraints --------------------------------------------------------


def test_most_velocities_are_corrected_side_by_side_and_few_one_by_one(monkeypatch):
    mended: list[float] = []

    def one_by_one(scene: Any, state: State, v: Any) -> bool:
        mended.append(v[0])
        v[:] = 7.0
        return len(mended) < 3

    monkeypatch.setattr(velocities, "_mended", one_by_one)
    scenes = [SLEIGH, Sleigh.example(), SLEIGH, SLEIGH, SLEIGH]
    states = [State(np.array([0.3, 0.1, x]), np.zeros(3), 2.0) for x in (0.2, 0.7, 1.1, 1.3, 2.0)]
    wished = np.array([[1.0, 2.0, 3.0], [-5.0, 0.5, 1e3], [np.inf, 1.0, 1.0], [0.0] * 3, [1.0] * 3])
    found, places = consistent(scenes, states, lambda at: wished)
    # What is wished for without bounds begins at rest.
    assert places == [0, 1, 2, 3, 4] and mended == [0.0]
    assert found[2][1].v.tolist() == [7.0] * 3
    for place in (0, 1, 3, 4):
        scene, (q, v, t) = found[place]
        assert scene is scenes[place] and q is states[place].q and t == 2.0
        # The row of a sleigh is a unit vector: what is along it is taken away.
        row = Evaluation(scene, q, v, t).terms.a[0]
        expected = wished[place] - row * (row @ wished[place]) / (row @ row)
        assert v == pytest.approx(expected, rel=1e-12, abs=1e-14)
    monkeypatch.setattr(velocities, "_is_consistent", lambda at, v: np.zeros(at.states, bool))
    found, places = consistent(scenes, states, lambda at: wished)
    assert places == [0] and found[0][1].v.tolist() == [7.0] * 3 and len(mended) == 6
    states[0] = State(np.array([np.nan, 0.1, 0.2]), np.zeros(3), 2.0)
    assert consistent(scenes, states, lambda at: wished) == ([], []) and len(mended) == 10


def test_a_velocity_is_corrected_in_place_and_what_cannot_be_is_left_as_it_was(monkeypatch):
    asked: list[Any] = []

    def corrected(at: Any, v: Any) -> Any:
        asked.append((at.q.tolist(), at.v.tolist(), at.t))
        return v + 1.0

    def check(at: Any) -> None:
        asked.append((at.q.tolist(), at.v.tolist(), at.t))
        if at.v[0] > 8.0:
            raise EomcheckError("no")

    monkeypatch.setattr(velocities, "consistent_velocity", corrected)
    monkeypatch.setattr(velocities, "check_consistent", check)
    monkeypatch.setattr(
        velocities, "Evaluation", lambda scene, q, v, t: SimpleNamespace(q=q, v=v, t=t)
    )
    state = State(np.array([1.0, 2.0, 3.0]), np.zeros(3), 4.5)
    for v, good in (([5.0, 6.0, 7.0], True), ([8.0, 6.0, 7.0], False)):
        changed = np.array(v)
        asked.clear()
        assert velocities._mended(SLEIGH, state, changed) == good
        after = [x + 1.0 for x in v]
        assert changed.tolist() == (after if good else v)
        assert asked == [([1.0, 2.0, 3.0], x, 4.5) for x in (v, after)]
    for error in (RefusedError("a", 0.0, 1.0, "why"), np.linalg.LinAlgError("why")):
        monkeypatch.setattr(velocities, "consistent_velocity", raising(error))
        assert not velocities._mended(SLEIGH, state, np.zeros(3))


def raising(error: Exception) -> Any:
    """Return a function that raises this."""

    def function(*_: Any) -> Any:
        raise error

    return function


def lanes_of(a: Any, b: Any = None) -> Any:
    """Return what stands for an evaluation in lanes, of a (L, r, n) and b (L, r)."""
    terms = SimpleNamespace(a=BatchArray(np.array(a)), b=None if b is None else BatchArray(b))
    return SimpleNamespace(terms=terms)


@pytest.mark.parametrize(("driven", "size"), [(False, 4.0), (True, 8.0)])
def test_a_velocity_keeps_the_constraints_within_a_quarter_of_what_rounding_allows(driven, size):
    off = np.array([0.0, 0.9, -0.9, 1.1, -1.1]) * allowed_error(1.0) * size / 4
    # 2 v_1 + v_2 = 0 or 2, and a row that any velocity keeps.
    a = np.array([[2.0, 1.0], [0.0, 0.0]]) + np.zeros((5, 1, 1))
    v = np.array([[2.0] * 5 if driven else [1.0] * 5, -2.0 + off]).T
    of = lanes_of(a, np.array([[-2.0, 0.0]] * 5) if driven else None)
    assert velocities._is_consistent(of, BatchArray(v)).tolist() == [True] * 3 + [False] * 2
    residual = velocities._residual(of, BatchArray(v)).data
    assert residual == pytest.approx(np.array([off, 0 * off]).T, abs=1e-15)


def test_terms_found_state_by_state_are_no_numbers_where_functions_raise(monkeypatch):
    def evaluation(scene: Any, *state: Any) -> Any:
        if state[2] == 2.0:
            raise ZeroDivisionError
        a = np.full((1, 2), state[2])
        return SimpleNamespace(terms=SimpleNamespace(a=a, b=None if scene else 10 * a[0]))

    monkeypatch.setattr(velocities, "Evaluation", evaluation)
    states = [State(np.zeros(2), np.zeros(2), t) for t in (2.0, 3.0, 4.0)]
    found = velocities._stacked_terms([None] * 3, states)  # type: ignore[list-item]
    nan = float("nan")
    rows = np.array([[nan, 3.0, 4.0]] * 2)
    assert np.array_equal(found.a.data[:, 0], rows.T, equal_nan=True)
    assert np.array_equal(found.b.data, 10 * rows.T, equal_nan=True)
    found = velocities._stacked_terms([1] * 3, states)  # type: ignore[list-item]
    assert found.b is None
    none = velocities._stacked_terms([1], states[:1])  # type: ignore[list-item]
    assert none.a is None and none.b is None
