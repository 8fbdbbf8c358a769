"""CasADi where the clock is in velocities: M, momentum and velocities depend on t itself.

A bob hangs from a cart that runs free along x, on a cord that is hauled in and let out again,
ℓ = ℓ_0 + ℓ_1 sin κt, and carries a rotor. All is written by hand here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

import eomcheck
from eomcheck.engines.casadi import CasadiEngine
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.tolerance import allowed_error
from eomcheck.mechanics.parameters import Parametric, parameter
from eomcheck.mechanics.records import Jacobians


class Cord(NamedTuple):
    angles: Any
    length: Any
    rate: Any
    second: Any


def prepare(arithmetic, parameters, q, t):
    phase = np.zeros(1, q.dtype)
    phase[0] = parameters.frequency[0] * t
    clock, haul, frequency = arithmetic.angles(phase), parameters.haul, parameters.frequency
    length = parameters.length + haul * clock.sin
    rate, second = haul * frequency * clock.cos, -haul * frequency * frequency * clock.sin
    return Cord(arithmetic.angles(q[1:]), length, rate, second)


def jacobians(parameters, cord, q, v):
    length, rate, second = cord.length[0], cord.rate[0], cord.second[0]
    cos, sin, omega = cord.angles.cos[0], cord.angles.sin[0], v[1]
    linear = [[[1, length * cos], [0, length * sin]]]
    # Along the cord and across it, then along x and y.
    out, ahead = second - length * omega * omega, 2 * rate * omega
    rest = [[out * sin + ahead * cos, ahead * sin - out * cos]]
    kind = v.dtype
    still = np.zeros((1, 1), kind)
    return Jacobians(
        np.array(linear, kind), np.array([[[0, 1]]], kind), np.array(rest, kind), still
    )


def velocities(parameters, cord, q, v):
    length, rate = cord.length[0], cord.rate[0]
    cos, sin = cord.angles.cos[0], cord.angles.sin[0]
    swing = length * v[1]
    V = [[v[0] + swing * cos + rate * sin, swing * sin - rate * cos]]
    return np.array(V, v.dtype), v[1:].reshape(1, 1)


class HauledBob(Parametric, functions=globals()):
    """The bob."""

    mass: Any = parameter("m", "kg", "> 0", (0.5, 5.0), (1,), default=(2.0,))
    inertia: Any = parameter("I", "kg m²", ">= 0", (0.1, 1.0), (1,), default=(0.3,))
    length: Any = parameter("ℓ_0", "m", "> 0", (1.0, 3.0), default=1.5)
    haul: Any = parameter("ℓ_1", "m", sample_range=(-0.5, 0.5), default=0.4)
    frequency: Any = parameter("κ", "rad/s", sample_range=(0.5, 5.0), default=1.7)

    key = "hauled-bob"
    named_coordinates = "x", "θ"
    conserves_energy = False
    depends_on_time = True
    angle_coordinates = slice(1, None)

    def initial_state(self):
        return np.array([0.1, 0.4]), np.array([0.3, -0.8])


BOB = HauledBob()
Q, V = np.array([0.1, 0.7]), np.array([0.4, -1.3])
times = pytest.mark.parametrize("t", [0.0, 0.6, 2.5])


@times
def test_mass_matrix_and_bias_are_those_by_hand(t):
    m, rotor, phase = 2.0, 0.3, 1.7 * t
    ell, rate = 1.5 + 0.4 * np.sin(phase), 0.4 * 1.7 * np.cos(phase)
    second = -0.4 * 1.7**2 * np.sin(phase)
    cos, sin, omega = np.cos(Q[1]), np.sin(Q[1]), V[1]
    M = [[m, m * ell * cos], [m * ell * cos, m * ell**2 + rotor]]
    # d/dt ∂T/∂v - ∂T/∂q at v̇ = 0, T = m/2 (ẋ² + ℓ²θ̇² + ℓ̇² + 2 ẋ (ℓ θ̇ cos θ + ℓ̇ sin θ)) + I θ̇²/2
    B = [
        m * (2 * rate * omega * cos - ell * omega**2 * sin + second * sin),
        2 * m * ell * rate * omega,
    ]
    casadi, at = CasadiEngine(BOB), Evaluation(BOB, Q, V, t)
    for found in (casadi.mass_matrix(Q, t), at.terms.M):
        assert np.abs(found - M).max() <= allowed_error(np.abs(M).max())
    for found in (casadi.bias(Q, V, t), at.terms.B):
        assert np.abs(found - B).max() <= allowed_error(10.0)


def test_the_mass_matrix_and_the_momentum_do_change_with_time():
    casadi = CasadiEngine(BOB)
    assert np.abs(casadi.mass_matrix(Q, 0.0) - casadi.mass_matrix(Q, 0.6)).max() > 0.1
    still = HauledBob(haul=0.0)
    at_once = CasadiEngine(still).bias(Q, V, 0.0)
    assert np.abs(casadi.bias(Q, V, 0.0) - at_once).max() > 0.1, "∂p/∂t is part of B"
    assert np.abs(casadi._evaluate("V_t", Q, V, 0.6)).max() > 0.1


@times
def test_all_claims_hold_but_that_of_an_energy_that_is_all_quadratic(t):
    found = eomcheck.check_state(BOB, Q, V, t, engines=["casadi"])
    compared = {"mass-matrix", "bias", "kane-n-matrix", "engine-acceleration"}
    assert compared <= {finding.claim for finding in found if "casadi" in finding.evidence}
    failed = {finding.claim for finding in found if finding.verdict == "failed"}
    # T has a part that does not depend on v, and one that is linear in it.
    assert failed == {"kinetic-energy", "engine-kinetic-energy"}, [
        str(f) for f in found if f.verdict == "failed"
    ]


def test_casadi_without_the_part_of_b_that_comes_of_time_disagrees(monkeypatch):
    right = CasadiEngine.bias

    def frozen(self, q, v, t=0.0):
        step = 1e-6
        momentum = [self.mass_matrix(q, t + x) @ v for x in (-step, step)]
        return right(self, q, v, t) - (momentum[1] - momentum[0]) / (2 * step)

    monkeypatch.setattr(CasadiEngine, "bias", frozen)
    found = eomcheck.check_state(BOB, Q, V, 0.6, engines=["casadi"], claims=["bias"])
    assert [finding.verdict for finding in found] == ["failed"]


def test_casadi_at_another_time_disagrees(monkeypatch):
    right = CasadiEngine._evaluate
    monkeypatch.setattr(
        CasadiEngine, "_evaluate", lambda self, name, q, v, t: right(self, name, q, v, 0.0)
    )
    found = eomcheck.check_state(BOB, Q, V, 0.6, engines=["casadi"])
    failed = {finding.claim for finding in found if finding.verdict == "failed"}
    assert {"mass-matrix", "bias", "kane-n-matrix", "engine-acceleration"} <= failed
