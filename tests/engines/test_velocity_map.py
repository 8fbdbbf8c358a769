"""Engines whose velocity is not q̇: what they say in their own coordinates is mapped."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.engines.planar import planar

import eomcheck
from eomcheck.claims import CLAIMS
from eomcheck.engines import ENGINES, Answers, Engine
from eomcheck.evaluation.doubles import Evaluation
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
    found = eomcheck.check(scene, q, v, engines=[Tall], claims=["mass-matrix", "bias"])
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
