"""Equations that SymPy derived of pendulums, against those that are written by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("sympy")

import sympy as sm
from tests.testing.test_sympy import g, m, pendulum, r, swung

import eomcheck
from eomcheck.errors import InputError
from eomcheck.testing import from_kane, from_lagrange

MASS, ROD, G = 1.3, 0.4, 9.81
NUMBERS: dict[Any, float] = {m: MASS, r: ROD, g: G}


def test_lagranges_equations_of_a_pendulum_on_a_cart_are_those_by_hand():
    own: Any = from_lagrange(pendulum(False, 0.7), NUMBERS, name="cart", ranges=(-0.5, 1.0))
    assert (own.n, own.p, own.name, own.ranges) == (2, 2, "cart", (-0.5, 1.0))
    assert own.given == ("M", "bias", "qdd", "T", "U", "Q")
    assert own.derived and own.bias_has_gravity and own.of_lagrange
    q, v = np.array([0.3, 0.8]), np.array([0.5, -1.5])
    sin, cos = np.sin(0.8), np.cos(0.8)
    M = MASS * np.array([[3.0, ROD * cos], [ROD * cos, ROD**2]])
    bias = MASS * ROD * np.array([-sin * 1.5**2, G * sin])
    assert own.M(q) == pytest.approx(M) and own.bias(q, v) == pytest.approx(bias)
    assert own.Q(q, v) == pytest.approx(np.array([-0.35, 0.0]))
    assert own.qdd(q, v) == pytest.approx(np.linalg.solve(M, own.Q(q, v) - bias))
    assert own.T(q, v) == pytest.approx(v @ M @ v / 2)
    assert own.U(q) == pytest.approx(-MASS * G * ROD * cos)


def test_lagranges_equations_with_a_rod_have_its_constraint_and_its_drift():
    own: Any = from_lagrange(pendulum(True), NUMBERS)
    assert own.name == "lagrange"
    assert own.given == ("M", "bias", "qdd", "T", "U", "Q", "a", "c", "gamma")
    q, v = np.array([0.3, 0.5, -0.25]), np.array([0.5, -1.5, 2.0])
    a = 2.0 * np.array([[-0.2, 0.2, -0.25]])
    gamma = np.array([2.0 * 2.0**2 + 2.0 * 2.0**2])
    assert own.a(q) == pytest.approx(a)
    assert own.c(q, v) == pytest.approx(a @ v)
    assert own.gamma(q, v) == pytest.approx(gamma)
    M, gravity = MASS * np.diag([2.0, 1.0, 1.0]), np.array([0.0, 0.0, MASS * G])
    assert own.M(q) == pytest.approx(M) and own.bias(q, v) == pytest.approx(gravity)
    whole = np.block([[M, -a.T], [a, np.zeros((1, 1))]])
    answer = np.linalg.solve(whole, np.concatenate((-gravity, -gamma)))
    assert own.qdd(q, v) == pytest.approx(answer[:3])


def test_kanes_equations_of_a_pendulum_whose_rate_is_a_multiple_of_its_speed_are_those_by_hand():
    k = 0.7
    scale = sm.Symbol("k")
    own: Any = from_kane(swung(scale), NUMBERS | {scale: k}, name="swung", holonomic=True)
    assert (own.n, own.p, own.name, own.derived) == (1, 1, "swung", True)
    assert own.given == ("M", "bias", "qdd", "T", "Q", "qdot")
    q, u = np.array([0.8]), np.array([1.5])
    M, force = MASS * (ROD * k) ** 2, -MASS * G * ROD * k * np.sin(0.8)
    assert own.M(q) == pytest.approx(np.array([[M]]))
    assert own.bias(q, u) == pytest.approx(np.zeros(1))
    assert own.Q(q, u) == pytest.approx(np.array([force]))
    assert own.qdd(q, u) == pytest.approx(np.array([force / M]))
    assert own.T(q, u) == pytest.approx(M * 1.5**2 / 2)
    assert own.qdot(q, u) == pytest.approx(k * u)


def test_a_second_symbol_of_other_assumptions_is_told_as_such():
    from sympy import Symbol
    from sympy.physics import mechanics

    q, m, other = mechanics.dynamicsymbols("q"), Symbol("m"), Symbol("m", positive=True)
    lagrangian = m * q.diff() ** 2 / 2 - m * q**2
    method = mechanics.LagrangesMethod(lagrangian, [q])
    method.form_lagranges_equations()
    with pytest.raises(InputError, match="other assumptions"):
        eomcheck.check(method, parameters={m: 1.0, other: 2.0})
