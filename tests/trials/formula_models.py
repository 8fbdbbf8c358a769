"""Right models by formula: CasADi, tables, friction and stops, wide ranges, float32."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from tests.testing.own import given
from tests.trials.library_models import Model

from eomcheck.testing import EquationsOfMotion
from eomcheck.testing.equations_of_motion import equations_from

Energies = Callable[[Any, Any, Callable[[float, float], float]], tuple[Any, ...]]
"""(q, v, draw) -> T, U and R where there is damping; `draw(low, high)` draws a parameter."""


# ---- CasADi --------------------------------------------------------------------------------------


def by_casadi(n: int, energies: Energies, seed: int = 0, **options: Any) -> EquationsOfMotion:
    """Return Lagrange's equations of energies, derived by CasADi."""
    rng = np.random.default_rng(seed)
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    T, U, R = (*energies(q, v, lambda low, high: float(rng.uniform(low, high))), 0.0)[:3]
    momentum = ca.gradient(T, v)
    M = ca.jacobian(momentum, v)
    bias = ca.jtimes(momentum, q, v) - ca.gradient(T, q)
    gravity, damping = ca.gradient(U, q), ca.gradient(ca.SX(R), v)
    C = ca.SX(n, n)
    for i in range(n):
        for j in range(n):
            rate = [(ca.jacobian(M[i, j], q[k]), ca.jacobian(M[i, k], q[j])) for k in range(n)]
            back = [ca.jacobian(M[j, k], q[i]) for k in range(n)]
            C[i, j] = sum((a + b - c) * v[k] for k, ((a, b), c) in enumerate(zip(rate, back))) / 2  # noqa: B905
    qdd = ca.solve(M, -bias - gravity - damping)
    vector = {"bias": bias, "qdd": qdd}
    found: dict[str, Any] = {
        "M": _called("M", [q], M),
        "C": _called("C", [q, v], C),
        "gravity": _called("gravity", [q], gravity, flat=True),
        **{name: _called(name, [q, v], x, flat=True) for name, x in vector.items()},
        "T": _called("T", [q, v], T, number=True),
        "U": _called("U", [q], ca.SX(U), number=True),
    }
    if ca.SX(R).n_dep() or not ca.SX(R).is_constant():
        found["R"] = _called("R", [q, v], ca.SX(R), number=True)
    return equations_from(n, found | {"name": energies.__name__.strip("_")} | options)


def _called(name: str, inputs: Any, x: Any, flat: bool = False, number: bool = False) -> Any:
    """Return a function of arrays that evaluates an expression."""
    f = ca.Function(name, inputs, [ca.densify(x)])
    if number:
        read = lambda *given: float(f(*given))  # noqa: E731
    elif flat:
        read = lambda *given: f(*given).full()[:, 0]  # noqa: E731
    else:
        read = lambda *given: f(*given).full()  # noqa: E731
    # As many arguments as are read, so that nobody takes it for one that reads more.
    return (lambda q: read(q)) if len(inputs) == 1 else (lambda q, v: read(q, v))


def _links(q: Any, v: Any, draw: Any, speed: Any = 0.0, damping: float = 0.0) -> tuple[Any, ...]:
    """Return energies of rods that hang on each other, absolute angles, from a pivot that moves."""
    x, y, T, U, R = speed, 0.0, 0.0, 0.0, 0.0
    height = 0.0
    for i in range(q.shape[0]):
        m, length = draw(0.2, 3.0), draw(0.2, 1.5)
        dx, dy = ca.cos(q[i]) * v[i], ca.sin(q[i]) * v[i]
        vx, vy = x + length / 2 * dx, y + length / 2 * dy
        T += m * (vx**2 + vy**2) / 2 + m * length**2 / 24 * v[i] ** 2
        U += 9.81 * m * (height - length / 2 * ca.cos(q[i]))
        relative = v[i] - (v[i - 1] if i else 0.0)
        R += damping * relative**2 / 2
        x, y, height = x + length * dx, y + length * dy, height - length * ca.cos(q[i])
    return T, U, R


def _pendulum_chain(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    return _links(q, v, draw)[:2]


def _damped_chain(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    return _links(q, v, draw, damping=draw(0.05, 0.5))


def _chain_on_cart(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    T, U, R = _links(q[1:], v[1:], draw, speed=v[0], damping=0.1)
    return T + draw(0.5, 3.0) * v[0] ** 2 / 2, U + 20.0 * q[0] ** 2 / 2, R + 0.3 * v[0] ** 2 / 2


def _furuta(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    m, arm, length, J = draw(0.1, 0.5), draw(0.2, 0.5), draw(0.2, 0.6), draw(0.01, 0.1)
    along = arm * v[0] + length * ca.cos(q[1]) * v[1]
    T = m * (along**2 + (length * ca.sin(q[1])) ** 2 * (v[0] ** 2 + v[1] ** 2)) / 2
    return T + J * v[0] ** 2 / 2, m * 9.81 * length * ca.cos(q[1]), 0.01 * (v[0] ** 2 + v[1] ** 2)


def _ball_on_beam(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    m, J = draw(0.05, 0.5), draw(0.01, 0.2)
    T = 7 * m * v[0] ** 2 / 10 + (J + m * q[0] ** 2) * v[1] ** 2 / 2
    return T, m * 9.81 * q[0] * ca.sin(q[1])


def _pendulum_on_spring(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    m, rest, k = draw(0.2, 2.0), 2.0, draw(10.0, 1e3)
    length = rest + q[0]
    T = m * (v[0] ** 2 + (length * v[1]) ** 2) / 2
    return T, k * q[0] ** 2 / 2 - m * 9.81 * length * ca.cos(q[1]), 0.1 * v[0] ** 2


def _crane(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    """Return energies of a load on a cable of variable length, below a trolley in the plane."""
    trolley, load = draw(1.0, 20.0), draw(1.0, 20.0)
    length = 3.0 + q[2]
    vx = v[0] + v[2] * ca.sin(q[1]) + length * ca.cos(q[1]) * v[1]
    vy = -v[2] * ca.cos(q[1]) + length * ca.sin(q[1]) * v[1]
    T = trolley * v[0] ** 2 / 2 + load * (vx**2 + vy**2) / 2
    return T, -load * 9.81 * length * ca.cos(q[1]), 0.5 * v[0] ** 2


def _gyroscope(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    """Return energies of a heavy top, Euler angles 3-1-3 away from their singular pose."""
    lean = 1.4 + q[1] / 2
    A, C, weight = draw(0.1, 1.0), draw(0.1, 1.0), draw(0.5, 5.0)
    spin = v[2] + v[0] * ca.cos(lean)
    T = A * ((v[1] / 2) ** 2 + (v[0] * ca.sin(lean)) ** 2) / 2 + C * spin**2 / 2
    return T, weight * ca.cos(lean)


def _two_link_arm(q: Any, v: Any, draw: Any) -> tuple[Any, ...]:
    m, J, k = draw(1.0, 20.0), draw(0.1, 2.0), draw(1.0, 100.0)
    c = ca.cos(q[1])
    both = v[0] + v[1]
    T = (J + 2 * m) * v[0] ** 2 / 2 + m * both**2 / 4 + m * v[0] * both * c / 2
    return T, m * 9.81 * (ca.sin(q[0]) + ca.sin(q[0] + q[1]) / 2) + k * q[1] ** 4 / 4


MECHANISMS: list[tuple[int, Energies]] = [
    (1, _pendulum_chain),
    (2, _pendulum_chain),
    (3, _pendulum_chain),
    (5, _pendulum_chain),
    (1, _damped_chain),
    (2, _damped_chain),
    (4, _damped_chain),
    (2, _chain_on_cart),
    (3, _chain_on_cart),
    (4, _chain_on_cart),
    (2, _furuta),
    (2, _ball_on_beam),
    (2, _pendulum_on_spring),
    (3, _crane),
    (3, _gyroscope),
    (2, _two_link_arm),
]


# ---- Tables --------------------------------------------------------------------------------------


def _table(kind: str, knots: int, seed: int) -> EquationsOfMotion:
    """Return a mass whose force is a table of measured values; U is its exact integral."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-1.2, 1.2, knots)
    y = 3.0 * np.sin(2.0 * x + seed) + x + 1e-3 * rng.normal(size=knots)
    m = 1.3 + seed
    if kind == "linear":
        below = np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])
        slope = np.diff(y) / np.diff(x)

        def force(s: float) -> float:
            return float(np.interp(s, x, y))

        def energy(s: float) -> float:
            k = int(np.clip(np.searchsorted(x, s) - 1, 0, knots - 2))
            h = s - x[k]
            return float(below[k] + h * (y[k] + slope[k] * h / 2))
    else:
        curve = (CubicSpline if kind == "spline" else PchipInterpolator)(x, y)
        integral = curve.antiderivative()

        def force(s: float) -> float:
            return float(curve(s))

        def energy(s: float) -> float:
            return float(integral(s))

    return EquationsOfMotion(
        1,
        M=lambda q: [[m]],
        gravity=lambda q: [force(q[0])],
        qdd=lambda q, v: [-force(q[0]) / m],
        T=lambda q, v: m * v[0] ** 2 / 2,
        U=lambda q: energy(q[0]),
        name=f"{kind}, {knots} knots",
    )


# ---- Friction, stops, clamps ---------------------------------------------------------------------


def _sign(v: Any) -> Any:
    return np.sign(v)


FRICTIONS: dict[str, Callable[[Any, Any], Any]] = {
    "viscous": lambda q, v: -0.4 * v,
    "quadratic drag": lambda q, v: -0.3 * v * np.abs(v),
    "Coulomb": lambda q, v: -0.2 * _sign(v),
    "Coulomb, smoothed": lambda q, v: -0.2 * np.tanh(50.0 * v),
    "Stribeck": lambda q, v: -(0.1 + 0.2 * np.exp(-((v / 0.1) ** 2))) * _sign(v),
    "torque that is clamped": lambda q, v: np.clip(-5.0 * q - v, -1.0, 1.0),
    "backlash": lambda q, v: -40.0 * (np.maximum(q - 0.1, 0.0) + np.minimum(q + 0.1, 0.0)),
    "one-sided stop": lambda q, v: -500.0 * np.maximum(q - 0.6, 0.0),
    "stop with damping": lambda q, v: -1.0 * (q > 0.6) * (500.0 * (q - 0.6) + 3.0 * v),
    "dead zone": lambda q, v: -4.0 * np.sign(v) * np.maximum(np.abs(v) - 0.3, 0.0),
}


def _with_friction(name: str, seed: int) -> EquationsOfMotion:
    force, own = FRICTIONS[name], given("cart")
    M, bias, gravity = own["M"], own["bias"], own["gravity"]

    def Q(q: Any, v: Any) -> Any:
        return force(np.asarray(q) + 0.1 * seed, np.asarray(v))

    def qdd(q: Any, v: Any) -> Any:
        return np.linalg.solve(M(q), Q(q, v) - bias(q, v) - gravity(q))

    kept = {key: own[key] for key in ("M", "bias", "gravity", "T", "U")}
    return equations_from(3, kept | {"Q": Q, "qdd": qdd, "name": name})


def _potential_with_stop(stiffness: float) -> EquationsOfMotion:
    """Return a mass between springs that only push, each with its exact potential."""

    def over(q: Any) -> Any:
        return max(q[0] - 0.5, 0.0), max(-0.4 - q[0], 0.0)

    def gravity(q: Any) -> Any:
        above, below = over(q)
        return [stiffness * (above - below)]

    return EquationsOfMotion(
        1,
        M=lambda q: [[2.0]],
        gravity=gravity,
        U=lambda q: stiffness * sum(x**2 for x in over(q)) / 2,
        T=lambda q, v: v[0] ** 2,
        qdd=lambda q, v: [-gravity(q)[0] / 2.0],
        name=f"stops of {stiffness:g} N/m",
    )


# ---- Wide ranges ---------------------------------------------------------------------------------


def _wide(n: int, energies: Energies, ranges: Any, seed: int) -> EquationsOfMotion:
    return by_casadi(n, energies, seed, ranges=ranges)


def _vibration(frequency: float) -> EquationsOfMotion:
    """Return two masses of which one stands in a field with a very short wave length."""
    amplitude = 1.0 / frequency

    def gravity(q: Any) -> Any:
        return [np.sin(frequency * q[0]), 3.0 * q[1]]

    return EquationsOfMotion(
        2,
        M=lambda q: np.diag([1.0, 2.0]),
        bias=lambda q, v: np.zeros(2),
        gravity=gravity,
        U=lambda q: -amplitude * np.cos(frequency * q[0]) + 1.5 * q[1] ** 2,
        T=lambda q, v: v[0] ** 2 / 2 + v[1] ** 2,
        qdd=lambda q, v: -np.array(gravity(q)) / [1.0, 2.0],
        name=f"vibration of {frequency:g} rad/m",
    )


def _tree_far_out(seed: int, far: float) -> EquationsOfMotion:
    from tests.testing.trees import random_tree

    own = random_tree(seed)
    return equations_from(own.pop("n"), own | {"ranges": (-far, far)})


# ---- float32 -------------------------------------------------------------------------------------


def _single(n: int, energies: Energies, seed: int) -> EquationsOfMotion:
    """Return functions whose inputs and results are rounded to float32."""
    exact = by_casadi(n, energies, seed)

    def rounded(f: Any) -> Any:
        def answer(*x: Any) -> Any:
            return np.float32(f(*(np.float32(y).astype(float) for y in x)))

        one, two = (lambda q: answer(q)), (lambda q, v: answer(q, v))
        return one if f.__code__.co_argcount == 1 else two

    given_ = {name: rounded(exact.function(name)) for name in exact.given}
    return equations_from(n, given_ | {"name": f"{exact.name} in float32"})


# ---- All -----------------------------------------------------------------------------------------


def formula_models() -> Iterator[Model]:
    """Yield all right models that are written down here."""
    for n, energies in MECHANISMS:
        name = f"{energies.__name__.strip('_')} {n}"
        for seed in range(3):
            make = partial(by_casadi, n, energies, seed)
            yield Model("CasADi, Lagrange", f"{name} {seed}", make)
    for kind in ("linear", "pchip", "spline"):
        for knots in (11, 101, 501, 1001, 2001):
            for seed in range(2):
                make = partial(_table, kind, knots, seed)
                yield Model("tables", f"{kind} {knots} {seed}", make)
    for name in FRICTIONS:
        for seed in range(2):
            yield Model("friction and stops", f"{name} {seed}", partial(_with_friction, name, seed))
    for stiffness in (1.0, 1e3, 1e6):
        make = partial(_potential_with_stop, stiffness)
        yield Model("friction and stops", f"potential {stiffness:g}", make)
    for far in (10.0, 100.0, 1e3, 1e4, 1e5, 1e6):
        for n, energies in ((2, _pendulum_chain), (2, _furuta), (3, _chain_on_cart)):
            make = partial(_wide, n, energies, (-far, far), 1)
            yield Model("wide ranges", f"{energies.__name__.strip('_')} ±{far:g}", make)
    fast = [(-1.0, 1.0)] * 2 + [(-1e4, 1e4)] * 2
    yield Model("wide ranges", "fast chain", partial(_wide, 2, _pendulum_chain, fast, 2))
    mixed = [(-100.0, 100.0), (-1.0, 1.0), (-50.0, 50.0), (-1.0, 1.0)]
    yield Model("wide ranges", "wheel and arm", partial(_wide, 2, _two_link_arm, mixed, 2))
    for frequency in (1e2, 1e4, 1e6, 1e8):
        yield Model("wide ranges", f"vibration {frequency:g}", partial(_vibration, frequency))
    for seed in range(4):
        for far in (100.0, 1e3):
            make = partial(_tree_far_out, seed, far)
            yield Model("wide ranges", f"tree {seed} ±{far:g}", make)
    for n, energies in ((1, _pendulum_chain), (2, _furuta), (3, _crane), (2, _two_link_arm)):
        for seed in range(3):
            name = f"{energies.__name__.strip('_')} {seed}"
            yield Model("float32", name, partial(_single, n, energies, seed), single=True)
