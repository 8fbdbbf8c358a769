"""CasADi: everything by automatic differentiation of energies and constraints.

Nothing of the scene's M, a or recursions enters: `energies`, `dissipation`, `constraint`,
`velocities` and `speeds_of` are evaluated on CasADi symbols, and M, B, Q, a, gamma follow by
differentiation (Eqs. (4), (25)-(28)). The symbolic model depends on the kind and size of the scene
only; its parameters are inputs, so that one model serves all snakes of N links.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from eomcheck.arithmetic.float64 import FLOAT64
from eomcheck.engines.base import DerivingEngine, EngineAcceleration, required
from eomcheck.model import Angles, Array, Scene


class CasadiEngine(DerivingEngine):
    """A scene as CasADi derives it from its energies and constraints."""

    key = "casadi"
    solves_like = "au"

    def __init__(self, scene: Scene):
        super().__init__(scene)
        parameters = scene.parameters(FLOAT64)
        self._parameters = _flatten(parameters)
        key = (type(scene), scene.n, tuple(value is None for value in parameters))
        if key not in _MODELS:
            _MODELS[key] = _symbolic_model(scene)
        self._model = _MODELS[key]

    @classmethod
    def version(cls) -> str:
        """Return name and version of the library."""
        return f"casadi {required('casadi').__version__}"

    @classmethod
    def represents(cls, scene: Scene) -> bool:
        """Return True: every scene has energies and constraints."""
        return True

    def _evaluate(self, name: str, q: Array, v: Array, *more: Array) -> Array:
        result = np.asarray(self._model[name](q, v, self._parameters, *more))
        return result[:, 0] if result.shape[1] == 1 and name != "constraint_jacobian" else result

    def mass_matrix(self, q: Array) -> Array:
        """Return M (n, n) = ∂²T/∂v²."""
        return self._evaluate("mass_matrix", q, np.zeros_like(q))

    def bias(self, q: Array, v: Array) -> Array:
        """Return B (n,) = d/dt (∂T/∂v) - ∂T/∂q at v̇ = 0."""
        return self._evaluate("bias", q, v)

    def forces(self, q: Array, v: Array) -> Array:
        """Return Q (n,) = -∂U/∂q - ∂R/∂v, zeros without potential and dissipation."""
        return self._evaluate("forces", q, v)

    def constraint_jacobian(self, q: Array, v: Array) -> Array:
        """Return a (r, n) = ∂c/∂v."""
        return self._evaluate("constraint_jacobian", q, v)

    def constraint_drift(self, q: Array, v: Array) -> Array:
        """Return gamma (r,) = (∂c/∂q) v."""
        return self._evaluate("constraint_drift", q, v)

    def kane_inertia_remainder(self, q: Array, v: Array) -> tuple[Array, float, float]:
        """Return (N_Kane q̇ (p,), size, condition), N_Kane (p, n) formed in full by Eq. (23).

        The velocities V_k(q, v(q, u)) are differentiated in q at constant u. v(q, u) is not known
        here in closed form; it is the solution of c(q, v) = 0 and speeds_of(q, v) = u, and the
        rule for implicit functions gives its derivatives. `size` is that of the terms summed, and
        `condition` that of the matrix inverted.
        """
        n = q.size
        V_v, V_q, inertia = (self._evaluate(x, q, v) for x in ("V_v", "V_q", "inertia"))
        fixed_v, fixed_q = self._evaluate("fixed_v", q, v), self._evaluate("fixed_q", q, v)
        r = fixed_v.shape[0] - (n - self.scene.r)
        inverse = np.linalg.inv(fixed_v)
        v_u = inverse[:, r:]
        v_q = -inverse @ fixed_q
        partial = V_v @ v_u
        N_Kane = partial.T @ (inertia[:, None] * (V_q + V_v @ v_q))
        terms = np.abs(V_q) + np.abs(V_v) @ np.abs(inverse) @ np.abs(fixed_q)
        size = np.abs(partial).T @ (inertia * (terms @ np.abs(v)))
        return N_Kane @ v, float(size.max()), float(np.linalg.cond(fixed_v))

    def acceleration(
        self, q: Array, v: Array, Q: Array, a: Array | None, gamma: Array | None
    ) -> EngineAcceleration:
        """Return v̇ and λ from the KKT system of CasADi's own M, B, Q, a and gamma."""
        M, F = self.mass_matrix(q), self.forces(q, v) - self.bias(q, v)
        if self.scene.r == 0:
            return EngineAcceleration(np.linalg.solve(M, F), None)
        jacobian, drift = self.constraint_jacobian(q, v), self.constraint_drift(q, v)
        r = drift.size
        kkt = np.block([[M, jacobian.T], [jacobian, np.zeros((r, r))]])
        x = np.linalg.solve(kkt, np.concatenate((F, -drift)))
        return EngineAcceleration(x[: q.size], -x[q.size :])


_MODELS: dict[tuple, dict[str, Any]] = {}
"""Models made so far, by kind of scene, size, and which parameters are absent."""


def _flatten(parameters) -> Array:
    present = [np.ravel(value) for value in parameters if value is not None]
    return np.concatenate(present) if present else np.zeros(0)


def _symbolic_model(scene: Scene) -> dict[str, Any]:
    """Return CasADi functions of (q, v, parameters), by name."""
    ca = required("casadi")
    like: Any = scene.parameters(FLOAT64)
    q, v = ca.SX.sym("q", scene.n), ca.SX.sym("v", scene.n)
    flat = ca.SX.sym("parameters", _flatten(like).size)

    symbols = iter(_scalars(flat))
    fields = (
        None
        if value is None
        else np.array([next(symbols) for _ in range(value.size)], object).reshape(value.shape)
        for value in like
    )
    parameters = type(like)(*fields)
    angle = _scalars(q)[scene.angle_coordinates]
    angles = Angles(angle, _map(ca.cos, angle), _map(ca.sin, angle))
    state = (parameters, angles, _scalars(q), _scalars(v))

    T, U = scene.energies(*state)
    U = ca.SX(0) if U is None else U
    R = None if scene.dissipation is None else scene.dissipation(*state)
    R = ca.SX(0) if R is None else R
    V, omega = scene.velocities(*state)
    V_all = ca.vertcat(*V.ravel(), *omega.ravel())
    c = ca.SX(0, 1) if scene.r == 0 else ca.vertcat(*scene.constraint(*state))
    fixed = ca.vertcat(c, *scene.speeds_of(*state))
    momentum = ca.gradient(T, v)
    outputs = {
        "mass_matrix": ca.jacobian(momentum, v),
        "bias": ca.jtimes(momentum, q, v) - ca.gradient(T, q),
        "forces": -ca.gradient(U, q) - ca.gradient(R, v),
        "constraint_jacobian": ca.jacobian(c, v),
        "constraint_drift": ca.jtimes(c, q, v),
        "V_v": ca.jacobian(V_all, v),
        "V_q": ca.jacobian(V_all, q),
        "inertia": ca.vertcat(
            *np.repeat(parameters.mass, V.shape[1]), *np.repeat(parameters.inertia, omega.shape[1])
        ),
        "fixed_v": ca.jacobian(fixed, v),
        "fixed_q": ca.jacobian(fixed, q),
    }
    return {name: ca.Function(name, [q, v, flat], [ca.densify(x)]) for name, x in outputs.items()}


def _scalars(x) -> np.ndarray:
    """Return the entries of a CasADi column as an object array, so that generic code can index."""
    scalars = np.empty(x.shape[0], object)
    for i in range(x.shape[0]):
        scalars[i] = x[i]
    return scalars


def _map(function, x: np.ndarray) -> np.ndarray:
    mapped = np.empty(x.size, object)
    for i in range(x.size):
        mapped[i] = function(x[i])
    return mapped
