"""Engines that are wrong in some calls, or for arguments that they take for others: each fails."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.engines.planar import planar

import eomcheck
from eomcheck.claims import run
from eomcheck.claims.case import OFTEN, ONCE
from eomcheck.claims.run import RunSelection, ValidationRun
from eomcheck.claims.speeds_and_chains import kane_system
from eomcheck.engines import Answers, Engine
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.mechanics.records import State
from eomcheck.scenes import ChainPendulum

SCENE = ChainPendulum([1.0, 2.0], [1.0, 0.5], [0.1, 0.2])
Q, V = np.array([0.4, -0.7]), np.array([1.5, -0.8])


def counting(method: str, wrong: Callable[[int], bool], answer: Callable[[Any], Any]):
    """Return an engine whose answer is changed in calls of which `wrong` says so."""

    class Counting(planar()):
        calls = 0

    def changed(self, *arguments):
        self.calls += 1
        right = getattr(planar(), method)(self, *arguments)
        return answer(right) if wrong(self.calls) else right

    setattr(Counting, method, changed)
    return Counting


def failed(engine: type[Engine], claim: str) -> list[str]:
    found = eomcheck.check_state(SCENE, Q, V, engines=[engine], claims=[claim])
    return [one.detail for one in found if one.verdict == "failed"]


PERIODS = [2, 5, 7, 37]


@pytest.mark.parametrize("period", PERIODS)
def test_an_answer_that_is_wrong_in_every_nth_call_fails(period: int):
    engine = counting("mass_matrix", lambda n: n % period == 0, lambda M: 1.001 * M)
    (detail,) = failed(engine, "mass-matrix")
    assert "mass matrix, entry" in detail


@pytest.mark.parametrize(
    ("method", "claim", "first"),
    [
        ("mass_matrix", "mass-matrix", 5),
        ("bias", "bias", 5),
        ("acceleration", "engine-acceleration", 5),
    ],
)
def test_one_wrong_answer_fails_whichever_it_is_of_all_that_are_judged(method, claim, first):
    def changed(right: Any) -> Any:
        return right._replace(vdot=1.01 * right.vdot) if method == "acceleration" else 1.01 * right

    # Between them it is asked elsewhere, an acceleration with other forces too.
    for call in (first, first + (3 if method == "acceleration" else 2)):
        engine = counting(method, lambda n, call=call: n == call, changed)
        assert failed(engine, claim), call
    # No other state is judged: what is asked there may be anything.
    assert not failed(counting(method, lambda n: n < first, changed), claim)


@pytest.mark.parametrize(("method", "claim"), [("mass_matrix", "mass-matrix"), ("bias", "bias")])
def test_one_wrong_answer_of_an_engine_that_answers_with_its_own_array_fails(method, claim):
    class Buffered(Engine):
        version = classmethod(lambda cls: "ours 1.0")
        represents = classmethod(lambda cls, scene: isinstance(scene, ChainPendulum))

        def __init__(self, scene):
            super().__init__(scene)
            self.calls, self.own = 0, {"mass_matrix": np.zeros((2, 2)), "bias": np.zeros(2)}

        def answer(self, name, right):
            self.calls += name == method
            wrong = name == method and self.calls == 5
            self.own[name][:] = 1.01 * right if wrong else right
            return self.own[name]

        def mass_matrix(self, q, t=0.0):
            return self.answer("mass_matrix", Evaluation(self.scene, q, 0 * q).terms.M)

        def bias(self, q, v, t=0.0):
            return self.answer("bias", Evaluation(self.scene, q, v).terms.B)

    assert failed(Buffered, claim)


def test_a_wrong_answer_in_the_first_call_at_each_state_fails_in_all_of_them():
    class Cold(planar()):
        last = None

        def bias(self, q, v, t=0.0):
            here = q.tobytes(), v.tobytes()
            self.last, new = here, here != self.last
            return super().bias(q, v, t) * (1.5 if new else 1.0)

    found = eomcheck.validate(SCENE, examples=4, engines=[Cold], claims=["bias"])
    moving = [one.verdict for one in found if one.state.v.any()]
    assert moving
    assert set(moving) == {"failed"}


def test_a_wrong_remainder_of_kanes_equations_fails_whichever_answer_it_is():
    class Remainder(Engine):
        calls, wrong = 0, 0
        version = classmethod(lambda cls: "ours 1.0")
        represents = classmethod(lambda cls, scene: isinstance(scene, ChainPendulum))

        def mass_matrix(self, q, t=0.0):
            return Evaluation(self.scene, q, 0 * q).terms.M

        def bias(self, q, v, t=0.0):
            return Evaluation(self.scene, q, v).terms.B

        def kane_inertia_remainder(self, q, v, t=0.0):
            self.calls += 1
            found = kane_system(Evaluation(self.scene, q, v))[1]
            return (1.01 if self.calls == self.wrong else 1.0) * found, 0.0, 1.0

    assert not failed(Remainder, "kane-n-matrix")
    for call in (6, 8):
        Remainder.wrong = call
        assert failed(Remainder, "kane-n-matrix"), call


def test_an_answer_that_is_wrong_after_a_hundred_calls_fails():
    engine = counting("bias", lambda n: n > 100, lambda B: 1.001 * B)
    (detail,) = failed(engine, "bias")
    assert "a new engine answers right: it keeps what it was asked before" in detail


def test_one_wrong_answer_fails_though_later_ones_differ_by_rounding():
    random = np.random.default_rng(0)

    def answer(B: Any) -> Any:
        return 1.5 * B if next(count) == 30 else B * (1.0 + 2.0**-52 * random.integers(0, 2))

    count = iter(range(10**6))
    (detail,) = failed(counting("bias", lambda n: True, answer), "bias")
    assert "bias, row" in detail


def test_an_engine_that_is_wrong_now_and_then_while_it_moves_fails_at_the_first_such_state():
    class Now(planar()):
        calls = 0

        def bias(self, q, v, t=0.0):
            self.calls += bool(v.any())
            return super().bias(q, v, t) * (1.0 + 0.1 * (self.calls % 37 == 0))

    first = ValidationRun()
    selection = RunSelection.of(engines=[Now], claims=["bias"], scenes=[SCENE])
    for v, verdict in ((0 * V, "passed"), (V, "failed")):
        (found,) = first.check_state(SCENE, State(Q, v), selection)
        assert found.verdict == verdict


def test_an_answer_that_is_none_now_and_then_fails():
    (detail,) = failed(counting("bias", lambda n: n % 37 == 0, lambda B: B[:-1]), "bias")
    assert "bias returned an array of shape (1,)" in detail


def test_accelerations_that_are_wrong_now_and_then_fail():
    engine = counting("acceleration", lambda n: n % 37 == 0, lambda x: (1.01 * x[0], x[1]))
    (detail,) = failed(engine, "engine-acceleration")
    assert "acceleration, row" in detail


def test_a_right_engine_passes_however_often_it_is_asked():
    for claim in ("mass-matrix", "bias", "engine-acceleration"):
        assert failed(counting("mass_matrix", lambda n: False, lambda M: M), claim) == []


def test_engines_are_asked_often_at_the_first_states_and_twice_at_others():
    asked = []

    class Asked(planar()):
        def mass_matrix(self, q, t=0.0):
            asked.append(self.scene)
            return super().mass_matrix(q, t)

    example = ChainPendulum.example()
    eomcheck.validate(example, examples=4, engines=[Asked], claims=["mass-matrix"])
    # Four calls elsewhere, the first answer, and those again with others in between.
    many, few = 4 + 1 + OFTEN, 4 + 1 + 2 * ONCE
    assert 2 * (many + OFTEN // 8) + 3 * few <= len(asked) < 2 * (many + OFTEN // 2) + 3 * few
    assert (OFTEN, ONCE, run.repeats_at(0), run.repeats_at(1)) == (90, 1, 90, 1)


# ---- Caches --------------------------------------------------------------------------------------


def rounded(method: str, digits: int) -> type[Engine]:
    """Return an engine that answers for rounded arguments what it first answered for them."""

    class Rounded(planar()):
        def __init__(self, scene):
            super().__init__(scene)
            self.known = {}

    def remembered(self, *arguments):
        key = tuple(np.round(np.hstack(arguments), digits).tolist())
        return self.known.setdefault(key, getattr(planar(), method)(self, *arguments))

    setattr(Rounded, method, remembered)
    return Rounded


@pytest.mark.parametrize("digits", [1, 6])
@pytest.mark.parametrize(("method", "claim"), [("mass_matrix", "mass-matrix"), ("bias", "bias")])
def test_an_answer_that_is_kept_for_rounded_coordinates_fails(method, claim, digits):
    (detail,) = failed(rounded(method, digits), claim)
    assert "a new engine answers right: it keeps what it was asked before" in detail


def test_an_answer_kept_for_the_very_same_coordinates_passes():
    assert failed(rounded("mass_matrix", 17), "mass-matrix") == []


def test_accelerations_kept_for_other_velocities_fail():
    def kept(self, *arguments):
        if not hasattr(self, "kept"):
            self.kept = planar().acceleration(self, *arguments)
        return self.kept

    def kept_by_position(self, q, v, *others):
        answers = self.__dict__.setdefault("answers", {})
        # Also by forces: only another velocity shows that it is not asked for.
        key = q.tobytes(), str(others)
        if key not in answers:
            answers[key] = planar().acceleration(self, q, v, *others)
        return answers[key]

    for method in kept, kept_by_position:
        engine = type("Kept", (planar(),), {"acceleration": method})
        (detail,) = failed(engine, "engine-acceleration")
        assert "a new engine answers right" in detail, method


def test_before_each_answer_an_engine_is_asked_elsewhere_and_in_the_eighth_digit():
    asked = []

    class Asked(planar()):
        def bias(self, q, v, t=0.0):
            asked.append(np.hstack((q, v)))
            return super().bias(q, v, t)

    kind: Any = Asked
    Answers(kind(SCENE)).provoke_stale_answers("bias", 30 * Q, V, 0.0)
    # The map of coordinates takes the first angle off the second.
    apart = [np.linalg.solve(np.kron(np.eye(2), [[1, 0], [-1, 1]]), one) for one in asked]
    far, _, near, speed = (one - np.hstack((30 * Q, V)) for one in apart)
    # One to one side, and half of that to the other, so that no difference stays as it is.
    shares, sizes = np.array([1.0, -0.5]), np.maximum(1.0, np.abs(30 * Q))
    assert far[:2] == pytest.approx(0.25 * shares * sizes)
    assert near[:2] == pytest.approx(2.0**-26 * shares * sizes, rel=1e-6)
    assert near[2:] == pytest.approx(2.0**-26 * shares * np.maximum(1.0, np.abs(V)), rel=1e-6)
    assert speed[:2] == pytest.approx([0.0, 0.0])
    assert np.abs(speed[2:]).min() > 0.1


# ---- Far and fast --------------------------------------------------------------------------------


def where(method: str, far: Callable[..., bool]) -> type[Engine]:
    """Return an engine that is a thousandth off where `far` says so of its arguments."""

    class Where(planar()):
        pass

    def changed(self, *arguments):
        right = getattr(planar(), method)(self, *arguments)
        return right * (1.001 if far(*arguments[:2]) else 1.0)

    setattr(Where, method, changed)
    return Where


FAR = {
    "|q| > 2 pi": ("mass_matrix", lambda q, t=0.0: np.abs(q).max() > 2 * np.pi),
    "|v| > 100": ("bias", lambda q, v: np.abs(v).max() > 100.0),
    "|v| < 1e-4": ("bias", lambda q, v: np.abs(v).max() < 1e-4),
}


@pytest.mark.parametrize("name", FAR)
def test_an_engine_that_is_wrong_far_away_or_at_other_speeds_fails(name: str):
    method, far = FAR[name]
    claim = method.replace("_", "-")
    found = eomcheck.validate(SCENE, examples=8, engines=[where(method, far)], claims=[claim])
    (last, *_) = [one for one in found if one.verdict == "failed"]
    assert "found" in last.detail
    assert claim == last.claim
