"""Engines whose velocity is not q̇: what they say in their own coordinates is mapped."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.engines.planar import planar

import eomcheck
from eomcheck.claims import CLAIMS
from eomcheck.engines import ENGINES, Answers, Engine
from eomcheck.evaluation.conformance import QUANTITIES, ConformancePoint
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.scenes import SCENES, Sleigh, Snake

ASKING = [one.id for one in CLAIMS.values() if one.asks]


def mapped(n: int) -> type[Engine]:
    """Return an engine with velocities w = S(q) v that are no rates of any coordinates.

    It is made of CasADi's answers, in the scene's coordinates: M_x = S⁻ᵀ M S⁻¹ and so on.
    """

    class Mapped(Engine):
        solves_like = "au"
        version = classmethod(lambda cls: "mapped 1")
        represents = classmethod(lambda cls, scene: True)

        def __init__(self, scene):
            super().__init__(scene)
            self.inner: Any = ENGINES["casadi"](scene)

        def S(self, q):
            return np.eye(n) + 0.3 * np.outer(np.ones(n), np.sin(q)) / n

        def velocity_map(self, q, v):
            # A configuration with more entries than there are coordinates.
            x = np.array([*q, 1.0])
            rest = 0.3 * np.ones(n) * (np.cos(q) * v * v).sum() / n
            return x, self.S(q), rest

        def state(self, x, w):
            q = x[:-1]
            S = self.S(q)
            v = np.linalg.solve(S, w)
            return q, v, S, self.velocity_map(q, v)[2]

        def mass_matrix(self, x, t=0.0):
            back = np.linalg.inv(self.S(x[:-1]))
            return back.T @ self.inner.mass_matrix(x[:-1], t) @ back

        def bias(self, x, w, t=0.0):
            q, v, S, rest = self.state(x, w)
            M = self.mass_matrix(x, t)
            return np.linalg.solve(S.T, self.inner.bias(q, v, t)) - M @ rest

        def forces(self, x, w, t=0.0):
            q, v, S, _ = self.state(x, w)
            return np.linalg.solve(S.T, self.inner.forces(q, v, t))

        def constraint_jacobian(self, x, w, t=0.0):
            q, v, S, _ = self.state(x, w)
            return self.inner.constraint_jacobian(q, v, t) @ np.linalg.inv(S)

        def constraint_drift(self, x, w, t=0.0):
            q, v, _, rest = self.state(x, w)
            drift = self.inner.constraint_drift(q, v, t)
            return drift - self.constraint_jacobian(x, w, t) @ rest

        def acceleration(self, x, w, Q, a, gamma, t=0.0):
            M, F = self.mass_matrix(x, t), Q - self.bias(x, w, t)
            if a is None:
                return np.linalg.solve(M, F), None
            kkt = np.block([[M, -a.T], [a, np.zeros((len(a), len(a)))]])
            both = np.linalg.solve(kkt, np.concatenate([F, -gamma]))
            return both[: len(w)], both[len(w) :]

    return Mapped


@pytest.mark.parametrize("key", ["sleigh", "snake", "chain-pendulum", "rolling-disk", "bricard"])
@pytest.mark.sampled(2)
def test_an_engine_in_its_own_coordinates_says_the_same(key):
    scene = SCENES[key].example()
    found = eomcheck.validate(scene, examples=5, engines=[mapped(scene.n)], claims=ASKING)
    assert [str(f) for f in found if f.verdict == "failed"] == []
    passed = {f.claim for f in found if f.verdict == "passed"}
    assert {"mass-matrix", "bias", "engine-acceleration"} <= passed
    if scene.r:
        assert {"constraint-jacobian", "constraint-drift", "engine-multipliers"} <= passed


def test_more_velocities_than_coordinates_are_mapped_back():
    """A body's ẋ, ẏ, θ̇, and one of them once more."""

    class Tall(planar()):
        def velocity_map(self, q, v):
            return q, np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]), np.zeros(4)

        def mass_matrix(self, q, t=0.0):
            M = np.zeros((4, 4))
            M[:3, :3] = super().mass_matrix(q, t)
            M[2, 2] /= 2
            M[3, 3] = M[2, 2]
            return M

        def bias(self, q, v, t=0.0):
            return np.array([*super().bias(q, v[:3], t), 0.0])

        def acceleration(self, q, v, Q, a, gamma, t=0.0):
            vdot, multipliers = super().acceleration(q, v[:3], Q, a, gamma, t)
            return vdot, multipliers

    scene = Sleigh()
    q = np.array([3.0, -5.0, 0.4])
    v = eomcheck.velocity(scene, q, [1.0, 2.0])
    found = eomcheck.check_state(scene, q, v, engines=[Tall], claims=["mass-matrix", "bias"])
    assert [f.verdict for f in found] == ["passed", "passed"]


def test_the_engine_itself_is_asked_in_its_own_coordinates():
    scene = Snake.coil(3)
    q, v = scene.initial_state()
    engine = ENGINES["pinocchio"](scene)
    x, S, rest = Answers(engine).velocity_map(q, v)
    assert not np.array_equal(S, np.eye(scene.n))
    assert not rest.any()
    at = Evaluation(scene, q, v)
    assert np.allclose(S.T @ engine.mass_matrix(x) @ S, at.terms.M)
    assert np.allclose(S.T @ engine.bias(x, S @ v), at.terms.B)


class Told(Engine):
    """Three velocities of two coordinates; every answer is another function of x, w and t."""

    solves_like = "au"
    version = classmethod(lambda cls: "told 1")
    represents = classmethod(lambda cls, scene: True)
    S = np.array([[1.0, 2.0], [0.0, 3.0], [4.0, -1.0]])

    def velocity_map(self, q, v):
        return np.array([*q, q[0] * q[1], 1.0]), self.S, v[0] * np.array([0.5, -1.0, 2.0])

    def mass_matrix(self, x, t=0.0):
        return t * np.diag([1.0, 2.0, 3.0]) + np.outer(x[:3], x[:3])

    def bias(self, x, w, t=0.0):
        return t * w + x[:3]

    def forces(self, x, w, t=0.0):
        return t * w[::-1] - x[1:]

    def constraint_jacobian(self, x, w, t=0.0):
        return (w + t * x[:3])[None]

    def constraint_drift(self, x, w, t=0.0):
        return np.array([t * w @ x[:3]])

    def kane_inertia_remainder(self, x, w, t=0.0):
        return np.array([w @ x[1:] + t]), 2 * t, 3 * x[2]

    def acceleration(self, x, w, Q, a, gamma, t=0.0):
        return t * w + x[:3] + 2 * Q + 3 * a[0], gamma + t


def test_every_answer_is_that_of_its_own_state_and_time_in_the_scenes_coordinates():
    q, v, t = np.array([0.7, -1.3]), np.array([1.1, 0.4]), 2.5
    engine = Told(SimpleNamespace(n=2, r=1, p=1))  # type: ignore[arg-type]
    asked, S, back = Answers(engine), Told.S, np.linalg.pinv(Told.S)
    x, w, rest = np.array([0.7, -1.3, -0.91, 1.0]), S @ v, 1.1 * np.array([0.5, -1.0, 2.0])
    M, a = t * np.diag([1.0, 2.0, 3.0]) + np.outer(x[:3], x[:3]), w + t * x[:3]
    Q, row, gamma = np.array([0.3, -0.8]), np.array([[1.5, -0.6]]), np.array([0.9])
    wdot = t * w + x[:3] + 2 * back.T @ Q + 3 * (row @ back)[0]
    expected = {
        "mass_matrix": S.T @ M @ S,
        "bias": S.T @ (t * w + x[:3] + M @ rest),
        "forces": S.T @ (t * w[::-1] - x[1:]),
        "constraint_jacobian": [a @ S],
        "constraint_drift": [t * w @ x[:3] + a @ rest],
    }
    for method, numbers in expected.items():
        np.testing.assert_allclose(asked.ask(method, q, v, t), numbers, rtol=1e-13)
    remainder, *sizes = asked.ask("kane_inertia_remainder", q, v, t)
    assert remainder == pytest.approx([w @ x[1:] + t])
    assert sizes == pytest.approx([2 * t, 3 * x[2]])
    vdot, multipliers = asked.ask("acceleration", q, v, Q, row, gamma, t)
    np.testing.assert_allclose(vdot, back @ (wdot - rest), rtol=1e-13)
    np.testing.assert_allclose(multipliers, gamma - row @ back @ rest + t, rtol=1e-13)
    (x_told, *_), M_told, B_told = asked.own_terms(q, v, t)
    for found, of in ((x_told, x), (M_told, M), (B_told, t * w + x[:3])):
        np.testing.assert_allclose(found, of, rtol=1e-13)


def test_the_size_of_casadis_bias_is_that_of_its_terms_and_not_of_their_sum():
    scene = Snake.coil(3)
    q, v = scene.initial_state()[0], np.array([1.0, -2.0, 0.5, -0.25, 3.0])
    M = Evaluation(scene, q, v).terms.M
    size = sum(abs(v[i] * M[i, j] * v[j]) for i in range(5) for j in range(5))
    assert ENGINES["casadi"](scene).bias_size(q, v) == pytest.approx(size, rel=1e-12)
    assert size > 1.05 * abs(v @ M @ v)


class Scaled(mapped(3)):
    """The sleigh in other units and another order of its coordinates: x = S q."""

    UNITS = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 0.5], [-1.0, 0.0, 0.0]])

    def velocity_map(self, q, v):
        return self.UNITS @ q, self.UNITS, np.zeros(3)

    def velocity_map_derivatives(self, q, v):
        return np.zeros((3, 3)), np.zeros((3, 3))

    def constraint_force_derivatives(self, x, w, tau, t=0.0):
        back = np.linalg.inv(self.UNITS)
        q, v, tau = back @ x, back @ w, self.UNITS.T @ tau
        point = ConformancePoint(Evaluation(self.scene, q, v, t), tau=tau)
        return tuple(part @ back for part in np.split(point.constraint_force_derivatives, 2, 1))


def test_both_derivatives_of_multipliers_are_mapped():
    scene, (q, v, tau) = Sleigh(), np.array([[0.3, -0.2, 0.9], [0.5, 0.7, -1.1], [2.0, -1.0, 0.4]])
    one = QUANTITIES["constraint_force_derivatives"]
    expected = ConformancePoint(Evaluation(scene, q, v), tau=tau).constraint_force_derivatives
    actual = Answers(Scaled(scene)).quantity(one, q, v, tau, "")
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-12)
    assert np.abs(expected).max(axis=0)[3:].min() > 0.1
