"""What the convention leaves open is told by the functions themselves: T, clocks, factories."""

from __future__ import annotations

import numpy as np
import pytest
from tests.testing.own import given, guide

from eomcheck.scenes import ChainPendulum
from eomcheck.testing import check_functions, from_engine, from_scene
from eomcheck.testing.handed_over import HANDED_OVER

CART = guide("cart")
m, turn = 2.0, 1.5


def verdicts(found):
    return {x.claim: x.verdict for x in found}


def on_a_turntable(share: float = 1.0):
    """A mass on a turntable, in coordinates that turn with it; Coriolis' force times `share`."""

    def T(q, v):
        return m / 2 * ((v[0] - turn * q[1]) ** 2 + (v[1] + turn * q[0]) ** 2)

    def bias(q, v):
        coriolis = 2 * m * turn * np.array([-v[1], v[0]])
        return share * coriolis - m * turn**2 * q

    return {"M": lambda q: m * np.eye(2), "T": T, "bias": bias}


def test_a_kinetic_energy_with_linear_terms_excuses_a_bias_that_is_not_quadratic():
    found = check_functions(2, **on_a_turntable(), states=4)
    assert not [str(x) for x in found if x.verdict == "failed"]
    said = verdicts(found)
    for claim in ("bias-at-rest", "bias-quadratic", "bias-even", "bias-of-mass-matrix"):
        assert said[claim] == "skipped"
    assert said["bias-of-energy"] == said["kinetic-energy"] == "passed"


def test_a_bias_that_is_not_that_of_its_kinetic_energy_fails_all_the_same():
    found = check_functions(2, **on_a_turntable(0.5), states=4)
    assert [x.claim for x in found if x.verdict == "failed"] == ["bias-of-energy"]


def test_without_a_kinetic_energy_nothing_is_excused():
    given_ = on_a_turntable() | {"T": None}
    said = verdicts(check_functions(2, **given_, states=4))
    assert said["bias-at-rest"] == "failed"


def driven(rate: float, reads_q: bool = False):
    """Two carts whose distance a clock drives, a v + b = 0."""

    def at_time(t):
        return np.array([np.sin(3 * t + 0.2)])

    def b(q, t):
        return np.array([q[0] * np.cos(t + 0.5)])

    def gamma(q, v):
        if reads_q:
            return np.array([rate * (v[0] * np.cos(0.5) - q[0] * np.sin(0.5))])
        return np.array([rate * 3 * np.cos(0.2)])

    return {"a": lambda q: np.array([[1.0, -1.0]]), "b": b if reads_q else at_time, "gamma": gamma}


@pytest.mark.parametrize("reads_q", [False, True])
def test_what_a_clock_drives_is_in_the_drift(reads_q: bool):
    assert verdicts(check_functions(2, **driven(1.0, reads_q)))["constraint-drift"] == "passed"
    assert verdicts(check_functions(2, **driven(0.9, reads_q)))["constraint-drift"] == "failed"


def test_loops_that_are_closed_are_kept_closed_where_accelerations_are_looked_at():
    """A pendulum in the coordinates of its end: off the circle its acceleration is undefined."""

    def a(q):
        return 2 * q[None, :]

    def gamma(q, v):
        return np.array([2 * v @ v])

    def qdd(q, v, weight=9.81):
        off = abs(q @ q - 1.0) > 1e-5 or abs(q @ v) > 1e-5
        force = np.array([0.0, -weight])
        return force * np.nan if off else force - q * (q @ force + v @ v)

    model = {
        "M": lambda q: np.eye(2),
        "bias": lambda q, v: np.zeros(2),
        "gravity": lambda q: np.array([0.0, 9.81]),
        "U": lambda q: 9.81 * q[1],
        "T": lambda q, v: v @ v / 2,
        "a": a,
        "c": lambda q: np.array([q @ q - 1.0]),
        "gamma": gamma,
        "qdd": qdd,
    }
    motion = ["constraint-acceleration", "motion", "power-balance"]
    found = check_functions(2, **model, claims=motion, states=6)
    assert verdicts(found) == dict.fromkeys(motion, "passed")
    weak = {"qdd": lambda q, v: qdd(q, v, 9.0)}
    failed = check_functions(2, **(model | weak), claims=motion, states=6)
    assert verdicts(failed) | {"constraint-acceleration": "passed"} == {
        "constraint-acceleration": "passed",
        "motion": "failed",
        "power-balance": "failed",
    }


@pytest.mark.night
def test_gravity_may_be_in_the_bias_if_that_is_said():
    def both(q, v):
        return CART.bias(q, v) + CART.gravity(q)

    own = given("cart") | {"bias": both, "gravity": None, "bias_has_gravity": True}
    found = check_functions(**own, states=3)
    assert {x.claim for x in found if x.verdict != "passed"} == {"reference"}
    wrong = own | {"bias": lambda q, v: CART.bias(q, v) + 1.01 * CART.gravity(q)}
    failed = [x for x in check_functions(**wrong, states=3) if x.verdict == "failed"]
    assert (failed[0].claim, failed[0].subject) == ("bias-at-rest", "bias at rest ~ ∂U/∂q")


def test_a_fresh_instance_that_answers_otherwise_is_found():
    class Model:
        built = 0

        def __init__(self):
            Model.built += 1
            self.mass = 1.0 if Model.built == 1 else 1.1

        def M(self, q):
            return self.mass * np.eye(2)

    found = check_functions(2, M=Model().M, factory=Model, states=2)
    (failed,) = [x for x in found if x.verdict == "failed"]
    assert (failed.claim, failed.subject) == ("fresh-answer", "M")


def test_a_reference_that_breaks_is_no_failure_of_the_functions():
    scene = ChainPendulum.example()
    own = from_scene(scene)

    def breaks(q):
        raise RuntimeError("out of order")

    reference = from_scene(scene).__class__(own.n, M=breaks, bias=own.bias)
    found = check_functions(own.n, M=own.M, bias=own.bias, against=reference, states=2)
    told = [x for x in found if x.claim == "reference"]
    assert [x.verdict for x in told] == ["skipped", "passed", "skipped"]
    assert "the reference breaks: M: RuntimeError: out of order" in told[0].detail


@pytest.mark.parametrize(("slow", "offset"), [(1e-2, 0.0), (1e-3, 0.0), (1.0, 1e5), (1.0, 1e9)])
@pytest.mark.sampled(2)
def test_terms_that_cancel_are_not_taken_for_single_precision(slow: float, offset: float):
    """A bias that is left of gravity, and a potential energy above a far level, are doubles."""

    def bias(q, v):
        return (CART.bias(q, v) + 100 * CART.gravity(q)) - 100 * CART.gravity(q)

    own = given("cart") | {"bias": bias, "U": lambda q: offset + CART.U(q)}
    ranges = [(-1, 1)] * 3 + [(-slow, slow)] * 3
    found = check_functions(**own, ranges=ranges, states=4)
    assert not [str(x) for x in found if x.verdict == "failed"]


def test_an_engine_as_functions_offers_what_it_overrides():
    from eomcheck.engines import ENGINES

    scene = ChainPendulum.example()
    derivatives = "tau_q", "tau_v", "qdd_q", "qdd_v", "qdd_tau"
    whole = {*HANDED_OVER, "parameters", "mass"}
    assert {*from_engine(ENGINES["pinocchio"](scene)).given} == {"M", "bias"} | whole
    own = from_engine(ENGINES["casadi"](scene)).given
    assert own == ("M", "bias", "qdd", "Q", "inverse_dynamics", *derivatives)
