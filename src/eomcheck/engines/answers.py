"""What an engine answers, in the scene's coordinates."""

from __future__ import annotations

import numpy as np

from eomcheck.engines.base import Engine, EngineAcceleration, VelocityMap
from eomcheck.evaluation.tolerance import largest
from eomcheck.numbers.contract import Array


class Answers:
    """An engine asked at states (q, v, t) of its scene, whatever coordinates it has itself.

    With w = S v and ẇ = S v̇ + Ṡ v in its own coordinates x: M = Sᵀ M_x S, B = Sᵀ (B_x + M_x Ṡ v),
    Q = Sᵀ Q_x, a = a_x S and gamma = gamma_x + a_x Ṡ v.

    Args:
        engine: the engine.
    """

    def __init__(self, engine: Engine):
        self.engine = engine
        self._maps = engine.offers("velocity_map")

    def velocity_map(self, q: Array, v: Array) -> VelocityMap:
        """Return (x, S, Ṡ v); q itself, the identity and zeros where the engine has none."""
        return VelocityMap(*self.engine.velocity_map(q, v))

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n)."""
        if not self._maps:
            return self.engine.mass_matrix(q, t)
        x, S, _ = self.velocity_map(q, np.zeros_like(q))
        return S.T @ self.engine.mass_matrix(x, t) @ S

    def mass_matrix_size(self, q: Array, t: float = 0.0) -> float:
        """Return the largest entry of |S|ᵀ |M_x| |S|, 0 where the engine has no own coordinates.

        Relative angles carry all bodies behind, which cancels in M.
        """
        if not self._maps:
            return 0.0
        x, S, _ = self.velocity_map(q, np.zeros_like(q))
        return largest(np.abs(S).T @ np.abs(self.engine.mass_matrix(x, t)) @ np.abs(S))

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,)."""
        if not self._maps:
            return self.engine.bias(q, v, t)
        x, S, rest = self.velocity_map(q, v)
        B = self.engine.bias(x, S @ v, t)
        return S.T @ (B + self.engine.mass_matrix(x, t) @ rest if rest.any() else B)

    def bias_size(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return the size of the terms that the engine sums to B."""
        x, S, _ = self.velocity_map(q, v)
        return self.engine.bias_size(x, S @ v, t)

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (n,)."""
        x, S, _ = self.velocity_map(q, v)
        return S.T @ self.engine.forces(x, S @ v, t)

    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return a (r, n)."""
        x, S, _ = self.velocity_map(q, v)
        return self.engine.constraint_jacobian(x, S @ v, t) @ S

    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return gamma (r,)."""
        if not self._maps:
            return self.engine.constraint_drift(q, v, t)
        x, S, rest = self.velocity_map(q, v)
        w = S @ v
        drift = self.engine.constraint_drift(x, w, t)
        return drift + self.engine.constraint_jacobian(x, w, t) @ rest

    def kane_inertia_remainder(
        self, q: Array, v: Array, t: float = 0.0
    ) -> tuple[Array, float, float]:
        """Return (N_Kane q̇ + G_Kane (p,), size, condition); generalized speeds are the scene's."""
        x, S, _ = self.velocity_map(q, v)
        return self.engine.kane_inertia_remainder(x, S @ v, t)

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ (n,) and λ (r,) or None; Q, a and gamma are the scene's."""
        if not self._maps:
            return EngineAcceleration(*self.engine.acceleration(q, v, Q, a, gamma, t))
        x, S, rest = self.velocity_map(q, v)
        back = np.linalg.pinv(S)
        if a is not None and gamma is not None:
            a = a @ back
            gamma = gamma - a @ rest
        wdot, multipliers = self.engine.acceleration(x, S @ v, back.T @ Q, a, gamma, t)
        return EngineAcceleration(back @ (wdot - rest), multipliers)
