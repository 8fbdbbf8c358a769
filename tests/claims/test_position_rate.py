"""The claim about closed positions, on a scene whose closed positions move with time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import eomcheck
from eomcheck.mechanics.records import Jacobians
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import generic


class Parameters(NamedTuple):
    mass: np.ndarray
    inertia: np.ndarray


@generic
def prepare(arithmetic, parameters, q, t):
    phase = np.zeros(1, q.dtype)
    phase[0] += t
    return arithmetic.angles(phase)


@generic
def jacobians(parameters, clock, q, v):
    linear, rest = np.zeros((1, 2, 2), v.dtype), np.zeros((1, 2), v.dtype)
    linear[0, 0, 0] += 1
    linear[0, 1, 1] += 1
    return Jacobians(linear, np.zeros((1, 0, 2), v.dtype), rest, np.zeros((1, 0), v.dtype), None)


@generic
def constraints(parameters, clock, q):
    a, b = np.zeros((1, 2), q.dtype), np.zeros(1, q.dtype)
    a[0, 0] += 1
    b[0] -= clock.cos[0]
    return a, b


@generic
def drift(parameters, clock, q, v):
    gamma = np.zeros(1, v.dtype)
    gamma[0] += clock.sin[0]
    return gamma


@generic
def velocities(parameters, clock, q, v):
    return v.reshape(1, 2), v[:0].reshape(1, 0)


@generic
def constraint(parameters, clock, q, v):
    c = np.zeros(1, v.dtype)
    c[0] += v[0] - clock.cos[0]
    return c


@generic
def height(parameters, clock, q):
    gap = np.zeros(1, q.dtype)
    gap[0] += q[0] - clock.sin[0]
    return gap


@generic
def resting(parameters, clock, q):
    gap = np.zeros(1, q.dtype)
    gap[0] += q[0]
    return gap


class OnLift(Scene):
    """A point on a floor that goes up and down as sin t."""

    key, conserves_energy, angle_coordinates = "on-lift", False, slice(0, 0)
    why_not_conserved = "the lift"
    depends_on_time = True
    coordinate_names, constraint_names = ("y", "x"), ("floor",)
    prepare, jacobians = staticmethod(prepare), staticmethod(jacobians)
    constraints, drift = staticmethod(constraints), staticmethod(drift)
    velocities, constraint = staticmethod(velocities), staticmethod(constraint)
    position_residual = staticmethod(height)

    def initial_state(self):
        return np.zeros(2), np.array([1.0, 0.5])

    def parameters(self, arithmetic):
        return Parameters(*map(arithmetic.numbers, (np.array([2.0]), np.zeros((1, 0, 0)))))


class OnWrongLift(OnLift):
    """The floor moves, the positions that it allows do not."""

    key = "on-wrong-lift"
    position_residual = staticmethod(resting)


def looked_at(scene):
    t = 0.7
    return eomcheck.check_state(
        scene, [np.sin(t), 0.3], [np.cos(t), -1.2], t, engines=[], claims=["position-rate"]
    )


def test_the_rate_in_time_is_compared_with_b():
    findings = looked_at(OnLift())
    assert [(f.subject, f.verdict) for f in findings] == [
        ("∂Φ/∂q", "passed"),
        ("∂Φ/∂t", "passed"),
    ]
    assert findings[1].allowed > 0


def test_positions_that_stay_where_the_constraint_moves_are_found_out():
    _, finding = looked_at(OnWrongLift())
    assert finding.verdict == "failed"
    assert "row floor: missing" in finding.detail


def test_the_same_is_proved_and_disproved():
    def verdicts(kind):
        findings = eomcheck.prove(kind(), points=1, seed=0)
        return [f.verdict for f in findings if f.claim == "position-rate"]

    assert verdicts(OnLift) == ["passed"]
    assert verdicts(OnWrongLift) == ["failed"]
