"""CasADi: all terms by automatic differentiation of energies and constraints.

It is independent of the scene's M, a and recursions: `energies`, `dissipation`, `constraint`,
`velocities` and `speeds_of` are evaluated on CasADi symbols, and M, B, Q, a, gamma follow by
differentiation (Eqs. (4), (25)-(28)). The symbolic model depends only on the class and size of the
scene; its parameters are inputs, so that one model serves all snakes of N links.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg import get_lapack_funcs

from eomcheck.engines.engine import Engine, EngineAcceleration
from eomcheck.errors import required
from eomcheck.evaluation.tolerance import largest
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import Array
from eomcheck.numbers.symbolic import CasadiArithmetic

(_gesvx,) = get_lapack_funcs(("gesvx",), dtype=np.float64)


class CasadiEngine(Engine):
    """Scene with all terms derived by CasADi from its energies and constraints."""

    key = "casadi"
    solves_like = "au"

    def __init__(self, scene: Scene):
        super().__init__(scene)
        parameters = scene.float64_parameters
        self._parameters = _flatten(parameters)
        key = (type(scene), scene.n, scene.r, tuple(map(_shape, parameters)))
        if key not in _MODELS:
            with warnings.catch_warnings():
                # User-supplied scenes may call NumPy's functions, of which CasADi warns.
                warnings.simplefilter("ignore", FutureWarning)
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

    def _evaluate(self, name: str, q: Array, v: Array, t: float, *others: Array) -> Array:
        result = np.asarray(self._model[name](q, v, t, self._parameters, *others))
        return result[:, 0] if name in VECTORS else result

    def mass_matrix(self, q: Array, t: float = 0.0) -> Array:
        """Return M (n, n) = ∂²T/∂v²."""
        return self._evaluate("mass_matrix", q, np.zeros_like(q), t)

    def bias(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return B (n,) = d/dt (∂T/∂v) - ∂T/∂q at v̇ = 0."""
        return self._evaluate("bias", q, v, t)

    def bias_size(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return |v| |M| |v|, N m, the size of ∂T/∂q.

        Where T is computed from velocities in axes that turn with a body, ∂T/∂q sums products of
        these velocities and momenta, which cancel.
        """
        return float(np.abs(v) @ np.abs(self.mass_matrix(q, t)) @ np.abs(v))

    def forces(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return Q (n,) = -∂U/∂q - ∂R/∂v, zeros without potential and dissipation."""
        return self._evaluate("forces", q, v, t)

    def constraint_jacobian(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return a (r, n) = ∂c/∂v."""
        return self._evaluate("constraint_jacobian", q, v, t)

    def constraint_drift(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return gamma (r,) = (∂c/∂q) v + ∂c/∂t."""
        return self._evaluate("constraint_drift", q, v, t)

    def kane_inertia_remainder(
        self, q: Array, v: Array, t: float = 0.0
    ) -> tuple[Array, float, float]:
        """Return (N_Kane q̇ + G_Kane (p,), size, condition), computed in full by Eq. (23).

        The velocities V_k(q, v(q, u, t)) are differentiated in q and t at constant u. v(q, u, t)
        has no closed form here; it is the solution of c(q, v, t) = 0 and speeds_of(q, v) = u, and
        the implicit function theorem gives its derivatives. In space ω × I ω is added. `size` is
        the size of the summed terms, and `condition` the condition number of the inverted matrix.
        """
        V_v, V_q, V_t, inertia = (
            self._evaluate(x, q, v, t) for x in ("V_v", "V_q", "V_t", "inertia")
        )
        fixed_v, fixed_q, fixed_t = (
            self._evaluate(x, q, v, t) for x in ("fixed_v", "fixed_q", "fixed_t")
        )
        inverse = np.linalg.inv(fixed_v)
        v_u = inverse[:, self.scene.r :]
        v_q, v_t = -inverse @ fixed_q, -inverse @ fixed_t
        partial = V_v @ v_u
        N_Kane = partial.T @ (inertia @ (V_q + V_v @ v_q))
        G_Kane = partial.T @ (inertia @ (V_t + V_v @ v_t))
        forward, backward = self._evaluate("gyroscopic", q, v, t).T
        terms = (np.abs(V_q) + np.abs(V_v) @ np.abs(inverse) @ np.abs(fixed_q)) @ np.abs(v)
        terms = terms + np.abs(V_t) + np.abs(V_v) @ np.abs(inverse) @ np.abs(fixed_t)
        size = np.abs(partial).T @ (np.abs(inertia) @ terms + np.abs(forward) + np.abs(backward))
        remainder = N_Kane @ v + G_Kane + partial.T @ (forward - backward)
        return remainder, largest(size), float(np.linalg.cond(fixed_v))

    def acceleration(
        self,
        q: Array,
        v: Array,
        Q: Array,
        a: Array | None,
        gamma: Array | None,
        t: float = 0.0,
    ) -> EngineAcceleration:
        """Return v̇ and λ from the KKT system of CasADi's own M, B, Q, a and gamma."""
        F = self.forces(q, v, t) - self.bias(q, v, t)
        if self.scene.r == 0:
            return EngineAcceleration(_solved(self.mass_matrix(q, t), F), None)
        return EngineAcceleration(*self._constrained(q, v, F, -self.constraint_drift(q, v, t), t))

    def _constrained(
        self, q: Array, v: Array, force: Array, drift: Array, t: float
    ) -> tuple[Array, Array]:
        """Return x and y of M x = force + aᵀ y, a x = drift, by CasADi's own M and a.

        Args:
            q: coordinates (n,).
            v: velocities (n,).
            force: right sides (n,) or (n, k).
            drift: right sides (r,) or (r, k).
            t: time, s.
        """
        a, r = self.constraint_jacobian(q, v, t), self.scene.r
        kkt = np.block([[self.mass_matrix(q, t), a.T], [a, np.zeros((r, r))]])
        x, y = np.split(_solved(kkt, np.concatenate((force, drift))), [q.size])
        return x, -y

    # ---- Conformance quantities ------------------------------------------------------------------

    def inverse_dynamics(self, q: Array, v: Array, vdot: Array, t: float = 0.0) -> Array:
        """Return τ (n,) = d/dt (∂T/∂v) - ∂T/∂q + ∂U/∂q, of U the weight alone."""
        self._check_weight()
        return self._evaluate("inverse_dynamics", q, v, t, vdot)

    def forward_dynamics(self, q: Array, v: Array, tau: Array, t: float = 0.0) -> Array:
        """Return v̇ (n,) of M v̇ = τ - B - ∂U/∂q, by CasADi's own terms."""
        net = tau - self.inverse_dynamics(q, v, np.zeros_like(q), t)
        return _solved(self.mass_matrix(q, t), net)

    def gravity(self, q: Array, t: float = 0.0) -> Array:
        """Return ∂U/∂q (n,), of U the weight alone."""
        self._check_weight()
        return self._evaluate("gravity", q, np.zeros_like(q), t)

    def _check_weight(self) -> None:
        """Check that the weight of the scene is known: by a parameter, or there is none.

        Raises:
            np.linalg.LinAlgError: gravity is a number in the scene's functions.
        """
        tree, gravity = self.scene.tree(), getattr(self.scene.float64_parameters, "gravity", None)
        if gravity is None and tree is not None and np.any(tree.gravity):
            raise np.linalg.LinAlgError("the weight of a scene without the parameter gravity")

    coriolis_skew = True

    def coriolis_matrix(self, q: Array, v: Array, t: float = 0.0) -> Array:
        """Return C (n, n) = ½ ∂B/∂v, of Christoffel symbols: B is quadratic in v."""
        return self._evaluate("coriolis_matrix", q, v, t)

    def kinetic_energy(self, q: Array, v: Array, t: float = 0.0) -> float:
        """Return T of the scene's `energies`."""
        return float(self._evaluate("kinetic_energy", q, v, t).item())

    def potential_energy(self, q: Array, t: float = 0.0) -> float:
        """Return U of the weight: the part of `energies` that is linear in gravity, g ∂U/∂g."""
        self._check_weight()
        return float(self._evaluate("potential_energy", q, np.zeros_like(q), t).item())

    def _residual_derivatives(
        self, q: Array, v: Array, t: float, vdot: Array, multipliers: Array
    ) -> tuple[Array, Array]:
        """Return derivatives of M v̇ + B + ∂U/∂q - aᵀλ (n, 2n) and of a v̇ + gamma (r, 2n).

        By q, then by v, at constant v̇ and λ, by forward automatic differentiation.
        """
        residual, n = self._model["residual"], q.size
        sizes = [residual.nnz_in(i) for i in range(residual.n_in())]
        if "rates" not in self._model:  # CasADi itself keeps no function that nobody has
            constant = list(range(len(sizes) + 1))
            rates_along = residual.forward(1)
            self._model["rates"] = rates_along.map("rates", "serial", 2 * n, constant, [])
        state = q, v, t, self._parameters, vdot, multipliers
        seeds = np.split(np.eye(sum(sizes), 2 * n), np.cumsum(sizes)[:-1])
        rates = np.asarray(self._model["rates"](*state, residual(*state), *seeds))
        return rates[:n], rates[n:]

    def inverse_dynamics_derivatives(
        self, q: Array, v: Array, vdot: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂τ/∂q and ∂τ/∂v by automatic differentiation of `inverse_dynamics`."""
        self._check_weight()
        torques, _ = self._residual_derivatives(q, v, t, vdot, np.zeros(self.scene.r))
        return torques[:, : q.size], torques[:, q.size :]

    def forward_dynamics_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return ∂v̇/∂q, ∂v̇/∂v and ∂v̇/∂τ, solutions of M ∂v̇ = ∂τ at constant v̇, and M⁻¹."""
        vdot = self.forward_dynamics(q, v, tau, t)
        torques = np.hstack(self.inverse_dynamics_derivatives(q, v, vdot, t))
        right = np.hstack((-torques, np.eye(q.size)))
        by_q, by_v, by_tau = np.hsplit(_solved(self.mass_matrix(q, t), right), 3)
        return by_q, by_v, by_tau

    def constraint_force_derivatives(
        self, q: Array, v: Array, tau: Array, t: float = 0.0
    ) -> tuple[Array, Array]:
        """Return ∂λ/∂q and ∂λ/∂v of the KKT system, its residual differentiated automatically."""
        net = tau - self.inverse_dynamics(q, v, np.zeros_like(q), t)
        vdot, multipliers = self._constrained(q, v, net, -self.constraint_drift(q, v, t), t)
        force, drift = self._residual_derivatives(q, v, t, vdot, multipliers)
        _, rates = self._constrained(q, v, -force, -drift, t)
        return rates[:, : q.size], rates[:, q.size :]


def _solved(A: Array, b: Array) -> Array:
    """Return the solution of A x = b by LAPACK, with equilibration and iterative refinement.

    b is a vector, or a matrix of right sides.

    Without these, multipliers of constraints that are nearly dependent would leave the others with
    rounding errors of their own size. Not by `eomcheck.numbers.linear`, which formulations use: the
    model shares no code with the formulations under test.

    Raises:
        np.linalg.LinAlgError: A is singular, scaled, to working precision.
    """
    *_, x, rcond, _, _, info = _gesvx(A, b)
    if info > 0:
        raise np.linalg.LinAlgError(f"singular to working precision: rcond is {rcond:.2g}")
    return x[:, 0] if b.ndim == 1 else x


_MODELS: dict[tuple, dict[str, Any]] = {}
"""Cache of models by scene class, size, and shapes of the parameters that are present."""


def _shape(value: Any) -> tuple[int, ...] | None:
    return None if value is None else np.shape(value)


def _flatten(parameters) -> Array:
    present = [np.ravel(value) for value in parameters if value is not None]
    return np.concatenate(present) if present else np.zeros(0)


VECTORS = (
    *("bias", "forces", "constraint_drift", "V_t", "fixed_t"),
    *("inverse_dynamics", "gravity"),
)
"""Outputs that are vectors; the others are matrices, also where they have one column."""


def _symbolic_model(scene: Scene) -> dict[str, Any]:
    """Return name -> CasADi function of (q, v, t, parameters).

    Inverse dynamics is also one of v̇; the residual of equations and constraints, of v̇ and λ.
    """
    ca = required("casadi")
    like: Any = scene.float64_parameters
    q, v, t = ca.SX.sym("q", scene.n), ca.SX.sym("v", scene.n), ca.SX.sym("t")
    flat = ca.SX.sym("parameters", _flatten(like).size)

    symbols = iter(_scalars(flat))
    fields = (
        None
        if value is None
        else np.array([next(symbols) for _ in range(value.size)], object).reshape(value.shape)
        for value in like
    )
    parameters = type(like)(*fields)
    prepared = scene.prepare(CasadiArithmetic(), parameters, _scalars(q), t)
    state = (parameters, prepared, _scalars(q), _scalars(v))

    T, U = scene.energies(*state)
    U = ca.SX(0) if U is None else U
    R = None if scene.dissipation is None else scene.dissipation(*state)
    R = ca.SX(0) if R is None else R
    V, omega = scene.velocities(*state)
    inertia = parameters.inertia.reshape(len(V), omega.shape[1], omega.shape[1])
    V_all = ca.vertcat(*V.ravel(), *omega.ravel())
    c = ca.SX(0, 1) if scene.r == 0 else ca.vertcat(*scene.constraint(*state))
    fixed = ca.vertcat(c, *scene.speeds_of(*state))
    momentum = ca.gradient(T, v)
    bias = ca.jtimes(momentum, q, v) + ca.jacobian(momentum, t) - ca.gradient(T, q)
    vdot, weight = ca.SX.sym("vdot", scene.n), _weight(ca, U, parameters)
    gravity = ca.gradient(weight, q)
    torques = ca.jtimes(momentum, v, vdot) + bias + gravity
    a, drift = ca.jacobian(c, v), ca.jtimes(c, q, v) + ca.jacobian(c, t)
    multipliers = ca.SX.sym("multipliers", scene.r)
    outputs = {
        "mass_matrix": ca.jacobian(momentum, v),
        "bias": bias,
        "forces": -ca.gradient(U, q) - ca.gradient(R, v),
        "constraint_jacobian": a,
        "constraint_drift": drift,
        "V_v": ca.jacobian(V_all, v),
        "V_q": ca.jacobian(V_all, q),
        "V_t": ca.jacobian(V_all, t),
        "inertia": ca.diagcat(*np.repeat(parameters.mass, V.shape[1]), *map(_matrix(ca), inertia)),
        "gyroscopic": ca.vertcat(ca.SX(V.size, 2), *map(_gyroscopic(ca), inertia, omega)),
        "fixed_v": ca.jacobian(fixed, v),
        "fixed_q": ca.jacobian(fixed, q),
        "fixed_t": ca.jacobian(fixed, t),
        "inverse_dynamics": torques,
        "residual": ca.vertcat(torques - a.T @ multipliers, a @ vdot + drift),
        "gravity": gravity,
        "coriolis_matrix": ca.jacobian(bias, v) / 2,
        "kinetic_energy": T,
        "potential_energy": weight,
    }
    inputs = {name: [q, v, t, flat] for name in outputs}
    inputs["inverse_dynamics"] = [q, v, t, flat, vdot]
    inputs["residual"] = [q, v, t, flat, vdot, multipliers]
    return {name: ca.Function(name, inputs[name], [ca.densify(x)]) for name, x in outputs.items()}


def _weight(ca: Any, U: Any, parameters: Any) -> Any:
    """Return the part of a potential energy U that is linear in gravity; 0 without gravity."""
    gravity = getattr(parameters, "gravity", None)
    if gravity is None:
        return ca.SX(0)
    g = ca.vertcat(*np.ravel(gravity))
    return ca.jtimes(U, g, g)


def _matrix(ca: Any) -> Callable:
    """Return the function that converts an array of symbols to a CasADi matrix."""
    return lambda entries: ca.reshape(ca.vertcat(*entries.T.ravel()), *entries.shape)


def _gyroscopic(ca: Any) -> Callable:
    """Return the function (I, ω) -> products (e, 2) in ω × I ω: to add, and to subtract."""
    matrix = _matrix(ca)

    def products(inertia, omega):
        if omega.size < 3:
            return ca.SX(omega.size, 2)
        omega = ca.vertcat(*omega)
        momentum = matrix(inertia) @ omega
        after, last = [1, 2, 0], [2, 0, 1]
        forward, backward = omega[after] * momentum[last], omega[last] * momentum[after]
        return ca.horzcat(forward, backward)

    return products


def _scalars(x) -> np.ndarray:
    """Return the entries of a CasADi column as an object array, which generic code can index."""
    scalars = np.empty(x.shape[0], object)
    for i in range(x.shape[0]):
        scalars[i] = x[i]
    return scalars
