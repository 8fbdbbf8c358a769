"""Engines that compute with fewer digits than float64: judged by these, at rounded states."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from tests.trials import float32_engines
from tests.trials.float32_engines import Copy32, HalfAngles32

import eomcheck
from eomcheck.claims import case as cases
from eomcheck.claims.finding import judge
from eomcheck.engines import (
    Answers,
    EngineAcceleration,
    VelocityMap,
    answers,
    engine_of,
    make_engine,
)
from eomcheck.errors import InputError
from eomcheck.evaluation import tolerance
from eomcheck.evaluation.dynamics import consistent_velocity
from eomcheck.evaluation.evaluation import Evaluation, RoundedEvaluation
from eomcheck.evaluation.perturbed import sensitivity_of
from eomcheck.evaluation.tolerance import C, allowed_error, rounded, well_conditioned
from eomcheck.mechanics.records import State
from eomcheck.numbers.generic import EPS
from eomcheck.scenes import ChainPendulum, Snake
from eomcheck.testing import check_functions

U = 2.0**-24
PENDULUM = ChainPendulum.rods(2)
SNAKE = Snake.example()
Q, V = np.array([0.1, 1.3]), np.array([0.7, -1.1])


class Copy64(Copy32):
    """The same engine, which does not declare that it computes in float32."""

    unit_roundoff = 2.0**-53


def finding(engine: Any, claim: str, scene: Any = PENDULUM, state: Any = (Q, V)) -> Any:
    """Return the one Finding of a claim about an engine at a state."""
    (only,) = eomcheck.check_state(scene, *state, engines=[engine], claims=[claim])
    return only


def changed(change: Any, method: str = "bias", base: Any = Copy32, **members: Any) -> Any:
    """Return an engine one of whose answers is changed."""

    def answer(self, *arguments):
        return change(getattr(base, method)(self, *arguments))

    return type("Changed", (base,), {method: answer, **members})


# ---- Rounding ------------------------------------------------------------------------------------


def test_numbers_are_rounded_as_float32_rounds_them():
    x = np.random.default_rng(0).normal(size=1000) * 10.0 ** np.arange(-30, 30).repeat(17)[:1000]
    assert np.array_equal(rounded(x, U), x.astype(np.float32).astype(np.float64))
    ties = 1.0 + U * np.array([1.0, 3.0, -0.5, -1.5])
    assert np.array_equal(rounded(ties, U), ties.astype(np.float32).astype(np.float64))


@pytest.mark.parametrize(
    ("x", "u", "expected"),
    [
        (257.0, 2.0**-8, 256.0),
        (259.0, 2.0**-8, 260.0),
        (-0.0, U, 0.0),
        (1e300, U, float(np.ldexp(np.float64(np.float32(1e300 / 2.0**900)), 900))),
        (0.1, 2.0**-53, 0.1),
    ],
)
def test_a_number_is_rounded_to_any_number_of_digits(x: float, u: float, expected: float):
    assert rounded(x, u) == expected == rounded(rounded(x, u), u)


def test_a_rounded_state_is_computed_in_float64():
    at = RoundedEvaluation(PENDULUM, State(Q, V, 0.1), U)
    assert np.array_equal(at.q, np.float32(Q)) and np.array_equal(at.v, np.float32(V))
    assert at.t == float(np.float32(0.1)) and type(at.t) is float
    exact = Evaluation(PENDULUM, at.q, at.v, at.t)
    assert np.array_equal(at.terms.M, exact.terms.M)
    assert (at.unit_roundoff, exact.unit_roundoff) == (U, EPS / 2)


# ---- The error that is allowed -------------------------------------------------------------------


def test_the_allowed_error_is_that_of_the_engine_s_numbers_and_of_ours():
    assert allowed_error(3.0) == C * EPS * 3.0 == allowed_error(3.0, EPS / 2)
    assert allowed_error(3.0, U) == C * 3.0 * (U + EPS / 2)
    rcond = {"M": 2.0 * C * U / tolerance.INCONCLUSIVE, "a": 1.0}
    assert well_conditioned(rcond) and well_conditioned(rcond, U)
    assert not well_conditioned(rcond, 4.0 * U)


@pytest.mark.parametrize(
    ("observed", "scale", "u", "verdict"),
    [
        (1e-6, 1.0, U, "passed"),
        (1e-6, 1.0, EPS / 2, "failed"),
        (1e-5, 1.0, U, "failed"),
        (1e-31, 0.0, U, "inconclusive"),  # it has underflowed
        (1e-31, 0.0, EPS / 2, "failed"),
        (1e-6, 1.0, 2.0**-14, "inconclusive"),
    ],
)
def test_a_verdict_is_that_of_the_numbers(observed: float, scale: float, u: float, verdict: str):
    assert judge(observed, scale, scale, u)[1] == verdict


def test_an_engine_in_float32_passes_where_it_declares_it():
    for claim in ("mass-matrix", "bias", "generalized-forces", "engine-acceleration"):
        right, wrong = finding(Copy32, claim), finding(Copy64, claim)
        assert (right.verdict, wrong.verdict) == ("passed", "failed")
        assert wrong.detail.endswith("as large as the rounding of single precision")
        assert right.evidence == f"compared: copy32 {np.__version__}, unit roundoff 2**-24"
        assert wrong.evidence == f"compared: copy64 {np.__version__}"
        assert 0.0 < right.observed <= right.allowed < 1e9 * wrong.allowed


def test_the_allowed_error_is_the_sensitivity_at_the_rounded_state():
    at = RoundedEvaluation(PENDULUM, State(Q, V, 0.0), U)
    own = sensitivity_of(at, lambda e: e.terms.M, coordinates=True)
    assert finding(Copy32, "mass-matrix").allowed == C * (U + EPS / 2) * own


def test_a_finding_names_the_state_before_it_was_rounded():
    """Rounded velocities violate the constraints: code that checks them would be rejected."""
    q, v = SNAKE.initial_state()
    q = q + 0.1
    v = consistent_velocity(Evaluation(SNAKE, q, v), v + 0.1)
    results = eomcheck.check_state(SNAKE, q, v, 0.3, engines=[Copy32], claims=["bias"])
    (state,) = [x.state for x in results]
    assert state is not None
    assert np.array_equal(state.q, q) and np.array_equal(state.v, v) and state.t == 0.3


def test_a_wrong_engine_is_found_and_its_fault_is_named():
    wrong = finding(changed(np.negative), "bias")
    assert wrong.verdict == "failed" and wrong.detail.endswith(": wrong sign")
    small = finding(changed(lambda x: x * np.float32(1.0 + 1e-4)), "bias")
    assert small.verdict == "failed" and "single precision" not in small.detail


def test_where_few_digits_say_nothing_the_verdict_is_inconclusive():
    coarse = changed(lambda x: x, unit_roundoff=2.0**-8)
    assert finding(coarse, "bias").verdict == "inconclusive"


def test_what_underflows_in_float32_is_no_fault():
    slow = finding(Copy32, "bias", state=(Q, 1e-25 * V))
    assert slow.verdict in ("passed", "inconclusive") and not slow.observed > 1e-40


@pytest.mark.parametrize(("u", "verdict"), [(U, "inconclusive"), (2.0**-53, "failed")])
def test_what_overflows_in_float32_is_no_fault(u: float, verdict: str):
    fast = changed(lambda x: np.full_like(x, np.inf), unit_roundoff=u)
    assert finding(fast, "bias", state=(Q, 1e20 * V)).verdict == verdict


def test_a_term_that_vanishes_is_compared():
    at_rest = finding(Copy32, "bias", state=(Q, 0.0 * V))
    assert (at_rest.verdict, at_rest.observed) == ("passed", 0.0)
    moved = changed(lambda x: x + np.float32(1e-3))
    assert finding(moved, "bias", state=(Q, 0.0 * V)).verdict == "failed"


QUANTITIES32 = (
    "engine-inverse-dynamics",
    "engine-forward-dynamics",
    "engine-inverse-mass-matrix",
    "engine-kinetic-energy",
    "engine-frame-placement",
)


@pytest.mark.parametrize("claim", QUANTITIES32)
def test_other_quantities_are_judged_in_float32_too(claim: str):
    rng = np.random.default_rng(1)
    verdicts = []
    for _ in range(5):
        q, v = rng.uniform(-3, 3, 2), rng.uniform(-3, 3, 2)
        results = eomcheck.check_state(PENDULUM, q, v, engines=[Copy32], claims=[claim])
        verdicts += [(x.verdict, x.evidence.endswith("unit roundoff 2**-24")) for x in results]
    assert ("passed", True) in verdicts and not {x for x, _ in verdicts} - {
        "passed",
        "inconclusive",
    }
    method = claim.removeprefix("engine-").replace("-", "_")

    kind = changed(lambda result: result * np.float32(1.01), method)
    results = eomcheck.check_state(PENDULUM, Q, V, engines=[kind], claims=[claim])
    assert "failed" in {x.verdict for x in results}


# ---- What an engine is handed --------------------------------------------------------------------


def test_everything_that_an_engine_is_handed_is_rounded(monkeypatch):
    handed: list[Any] = []

    class Asked(Copy32):
        def velocity_map(self, q, v):
            return VelocityMap(q / 3.0, np.eye(2) / 3.0, np.zeros(2))

        def bias(self, q, v, t=0.0):
            handed.extend((q, v, t))
            return np.zeros(2)

        def acceleration(self, q, v, Q, a, gamma, t=0.0):
            handed.extend((q, v, Q, t))
            assert a is None and gamma is None
            return EngineAcceleration(np.zeros(2))

    asked = Answers(make_engine(Asked, PENDULUM))
    asked.bias(Q, V, 0.1)
    asked.acceleration(Q, V, V / 7.0, None, None, 0.1)
    assert len(handed) == 7
    expected = [Q / 3.0, V / 3.0, 0.1, Q / 3.0, V / 3.0, 3.0 * V / 7.0, 0.1]
    for x, y in zip(handed, expected, strict=True):
        assert np.array_equal(x, np.float32(x))
        assert np.allclose(x, y, rtol=2 * U, atol=0.0)
    assert type(handed[2]) is float


def test_an_engine_of_float64_is_handed_what_there_is():
    class Asked(Copy64):
        def bias(self, q, v, t=0.0):
            assert np.array_equal(q, Q) and np.array_equal(v, V) and t == 0.1
            return np.zeros(2)

    Answers(make_engine(Asked, PENDULUM)).bias(Q, V, 0.1)


class Shifted32(Copy32):
    """The same engine, whose own coordinates are far from 0: x = q + 8000."""

    def velocity_map(self, q, v):
        return VelocityMap(q + 8000.0, np.eye(2), np.zeros(2))

    def position(self, q):
        return super().position(q - 8000.0)


def test_rounding_of_an_engine_s_own_coordinates_counts(monkeypatch):
    own, plain = finding(Shifted32, "mass-matrix"), finding(Copy32, "mass-matrix")
    assert own.verdict in ("passed", "inconclusive")
    assert plain.allowed < own.observed < own.allowed
    monkeypatch.setattr(cases, "own_input_sizes", lambda *_: None)
    assert finding(Shifted32, "mass-matrix").verdict == "failed"


class Mixed32(Copy32):
    """The same engine with velocities w of which one is lost in the other: w = (v₁ + v₂, v₁ - v₂).

    Its coordinates are those of the scene.
    """

    S = np.array([[1.0, 1.0], [1.0, -1.0]])

    def velocity_map(self, q, v):
        return VelocityMap(q, self.S, np.zeros(2))

    def terms(self, q, v, t):
        return super().terms(q, np.linalg.solve(self.S, v), t)

    def bias(self, q, v, t=0.0):
        return np.linalg.solve(np.float32(self.S.T), super().bias(q, v, t))


def test_rounding_of_an_engine_s_own_velocity_counts(monkeypatch):
    state = Q, np.array([1.0, 1e-6])
    assert finding(Mixed32, "bias", state=state).verdict != "failed"
    sizes = answers.own_input_sizes(make_engine(Mixed32, PENDULUM), *state)
    assert sizes is not None
    assert sizes[0] == pytest.approx(Q, rel=1e-4) and sizes[1] == pytest.approx(
        [1.0, 1.0], rel=1e-5
    )


def test_an_engine_with_the_scene_s_coordinates_adds_no_rounding():
    assert answers.own_input_sizes(make_engine(Copy32, PENDULUM), Q, V) is None


@pytest.mark.parametrize("angle", [0.0, 1e-4, 1.0, -3.1])
def test_a_quaternion_s_rounding_is_relative_to_1(angle: float):
    engine = make_engine(HalfAngles32, PENDULUM)
    sizes = answers.own_input_sizes(engine, np.array([angle, 0.5]), V)
    assert sizes is not None
    c, s = abs(np.cos(angle / 2)), abs(np.sin(angle / 2))
    # X⁺ of a unit vector is twice its normal; both entries have the other's size.
    assert sizes[0][0] == pytest.approx(4.0 * c * s, rel=1e-2, abs=1e-2)
    assert sizes[1] == pytest.approx(np.abs(V))


def test_a_jump_of_an_engine_s_coordinates_is_no_derivative():
    class Jumping(Copy32):
        def velocity_map(self, q, v):
            sign = -1.0 if q[0] > Q[0] + 1e-4 else 1.0
            return VelocityMap(np.array([sign * (q[0] + 2.0), q[1]]), np.eye(2), np.zeros(2))

    sizes = answers.own_input_sizes(make_engine(Jumping, PENDULUM), Q, V)
    assert sizes is not None and sizes[0] == pytest.approx([2.1, 1.3], rel=1e-4)


def test_a_velocity_map_that_raises_fails_the_answer_alone():
    class Broken(Copy32):
        def velocity_map(self, q, v):
            raise ValueError("none")

    broken = finding(Broken, "bias")
    assert broken.verdict == "failed" and "velocity_map raised ValueError: none" in broken.detail


# ---- Repeated calls ------------------------------------------------------------------------------


def test_an_answer_kept_for_rounded_inputs_is_found():
    class Keeping(Copy32):
        def mass_matrix(self, q, t=0.0):
            kept = vars(self).setdefault("kept", {})
            key = tuple(np.floor(np.asarray(q) * 64.0))
            return kept.setdefault(key, super().mass_matrix(q, t))

    q = np.array([0.5 + 2.0**-7, 1.5 + 2.0**-7])  # amid the numbers that have one key
    kept = finding(Keeping, "mass-matrix", state=(q, V))
    assert kept.verdict == "failed" and kept.detail.endswith("it keeps what it was asked before")


def test_states_nearby_are_as_far_as_half_of_the_digits():
    assert answers._near(2.0**-53) == 2.0**-26
    assert answers._near(U) == 2.0**-11.5


# ---- The declaration -----------------------------------------------------------------------------


@pytest.mark.parametrize("u", [2.0**-53, U, 2.0**-8, np.float32(2.0**-11), Fraction(1, 1024)])
def test_a_unit_roundoff_is_a_power_of_two(u: Any):
    kind = changed(lambda x: x, unit_roundoff=u)
    assert engine_of(kind) is kind


@pytest.mark.parametrize(
    "u", [1e-7, 3 * U, 2.0**-54, 2.0**-7, 0.0, -U, np.nan, np.inf, True, "2**-24", None, 1]
)
def test_any_other_unit_roundoff_is_refused(u: Any):
    with pytest.raises(InputError) as raised:
        engine_of(changed(lambda x: x, unit_roundoff=u))
    assert str(raised.value) == (
        f"engine Changed: unit_roundoff = {u!r}, expected a power of two from 2**-53, of float64, "
        "to 2**-8: half the spacing of its numbers at 1, 2**-24 for float32"
    )


def test_functions_are_not_compared_with_an_engine_of_fewer_digits():
    with pytest.raises(InputError, match=r"engine copy32: unit_roundoff = 5.96\S+, expected"):
        check_functions(
            2, M=lambda q: Evaluation(PENDULUM, q, V).terms.M, against=(Copy32, PENDULUM)
        )


def test_engines_of_both_precisions_are_judged_side_by_side():
    both = eomcheck.check_state(PENDULUM, Q, V, engines=[Copy32, Copy64], claims=["mass-matrix"])
    assert [x.verdict for x in both] == ["passed", "failed"]
    assert both[0].allowed > 1e8 * both[1].allowed


def test_rounding_of_an_engine_s_own_coordinates_is_that_of_no_other():
    engines = Copy32, Shifted32
    both = eomcheck.check_state(PENDULUM, Q, V, engines=engines, claims=["mass-matrix"])
    alone = [finding(kind, "mass-matrix") for kind in engines]
    assert [x.allowed for x in both] == [x.allowed for x in alone]
    assert alone[1].allowed > 1e3 * alone[0].allowed


# ---- Many states ---------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["snake", "chain-pendulum", "four-bar-chain", "random-mechanisms"])
@pytest.mark.sampled(2)
def test_no_right_engine_in_float32_is_called_wrong(key: str):
    results = float32_engines.judged(key, 2, 1)
    assert results and not [alarm for one in results for alarm in one.alarms]
    passed = [found for one in results for found in one.found.values()]
    assert passed and any(found[1] for found in passed)


@pytest.mark.night
def test_the_trial_prints_its_numbers(monkeypatch, capsys, tmp_path):
    """All of its states are judged at night, by its command."""
    few = ["--states", "6", "--jobs", "1", "--scene", "sleigh", "--markdown", str(tmp_path / "x")]
    monkeypatch.setattr("sys.argv", ["float32_engines", *few])
    assert float32_engines.main() == 0
    printed = capsys.readouterr().out
    assert "states: copy32 6, " in printed and "0 false alarms, largest error " in printed
    first, *_ = (x for x in (tmp_path / "x").read_text().splitlines() if "copy32" in x)
    assert first.startswith(r"| copy32 | mass\_matrix | 6 | 0 | 0 |")
