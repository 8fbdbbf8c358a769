"""The flyball governor against a reduced derivation that shares nothing with the scene."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

from eomcheck import acceleration, simulate
from eomcheck.errors import InputError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import applicable
from eomcheck.scenes import FlyballGovernor

SCENE = FlyballGovernor()
SCENE_KIND = FlyballGovernor
every_formulation = pytest.mark.parametrize("key", applicable(FlyballGovernor))
END = 0.5
"""s: the slider rises by 0.24 m, with 5 cm/s left."""


@cache
def reduced() -> Callable:
    """Return (s̈, θ̈) of the benchmark as a function of (s, θ, ṡ, θ̇), both arms alike.

    Kinetic energies are integrated over boxes of 3000 kg/m³ in Cartesian coordinates. ψ is
    ignorable: with the angular momentum p about the shaft, p²/(2 J(θ)) joins the potential.
    """
    s, angle = sympy.symbols("s theta")
    rates = up, swing = sympy.symbols("ds dtheta")
    x, y, z = sympy.symbols("x y z")
    density, ball, wide = 3000, 5, sympy.Rational(1, 100)
    hinge, top, rest, gravity = map(sympy.Rational, ("1/20", "1", "1/2", "981/100"))
    stiffness, damping, start, spin = 800000, 40000, sympy.pi / 6, 2 * sympy.pi

    def over_box(density_of, length, width, low=0):
        across = (-width / 2, width / 2)
        inner = sympy.integrate(sympy.expand(density_of), (x, low, low + length))
        return sympy.integrate(inner, (y, *across), (z, *across))

    # A point of an arm: from the axis, and up.
    out = hinge + x * sympy.cos(angle) + z * sympy.sin(angle)
    height = top - x * sympy.sin(angle) + z * sympy.cos(angle)
    end = {x: 1, y: 0, z: 0}
    within = (out.diff(angle) ** 2 + height.diff(angle) ** 2) * swing**2 / 2
    arms = 2 * (over_box(density * within, 1, wide) + ball * within.subs(end))
    # ψ̇ y d(out)/dt, the rest of the square, is odd in y.
    around = out**2 + y**2
    J = 2 * (over_box(density * around, 1, wide) + ball * around.subs(end))
    J += over_box(density * (z**2 + y**2), 1, wide)
    side = sympy.Rational(1, 10)
    J += over_box(density * (z**2 + y**2), side, side)
    slider = density * side**3
    weight = slider * gravity * s
    weight += 2 * gravity * (over_box(density * height, 1, wide) + ball * height.subs(end))
    length = sympy.sqrt(
        (out - hinge).subs({x: rest, z: 0}) ** 2 + (height.subs({x: rest, z: 0}) - s) ** 2
    )
    growth = length.diff(s) * up + length.diff(angle) * swing
    momentum = J.subs(angle, start) * spin
    T = arms + slider * up**2 / 2
    V = weight + 2 * stiffness * (length - rest) ** 2 / 2 + momentum**2 / (2 * J)
    R = 2 * damping * growth**2 / 2
    M = sympy.Matrix([[T.diff(a, b) for a in rates] for b in rates])
    bias = sympy.Matrix(
        [
            sum(T.diff(rate, q) * qd for q, qd in zip((s, angle), rates, strict=True))
            - T.diff(coordinate)
            + V.diff(coordinate)
            + R.diff(rate)
            for coordinate, rate in zip((s, angle), rates, strict=True)
        ]
    )
    M, bias = (sympy.lambdify((s, angle, up, swing), part, cse=True) for part in (M, bias))
    return lambda *state: -np.linalg.solve(M(*state), np.ravel(bias(*state)))


def test_accelerations_are_those_of_the_reduced_derivation():
    random = np.random.default_rng(0)
    momentum = Evaluation(SCENE, *SCENE.initial_state()).terms.M[1, 1] * SCENE.rate
    for _ in range(5):
        s, angle = random.uniform(0.3, 0.6), random.uniform(0.0, 1.0)
        up, swing = random.uniform(-1.0, 1.0, 2)
        q = np.array([s, random.uniform(-3.0, 3.0), angle, angle])
        turn = momentum / Evaluation(SCENE, q, np.zeros(4)).terms.M[1, 1]
        found = acceleration(SCENE, "kane", q, [up, turn, swing, swing]).vdot
        expected = reduced()(s, angle, up, swing)
        size = np.abs(expected).max()
        assert np.abs(found[[0, 2]] - expected).max() < 1e-11 * size
        assert abs(found[2] - found[3]) < 1e-11 * size


@cache
def reduced_motion(method: str) -> np.ndarray:
    """Return (s, θ, ṡ, θ̇) of the benchmark at `END`."""
    found = solve_ivp(
        lambda _, y: np.concatenate((y[2:], reduced()(*y))),
        (0.0, END),
        [0.5, np.pi / 6, 0.0, 0.0],
        method=method,
        rtol=1e-10,
        atol=1e-12,
    )
    return found.y[:, -1]


@pytest.mark.night
def test_the_reduced_motion_does_not_depend_on_the_integrator():
    assert np.abs(reduced_motion("Radau") - reduced_motion("DOP853")).max() < 1e-8


@pytest.mark.sampled(5)
@pytest.mark.parametrize("integrator", ["Radau", "DOP853"])
def test_every_formulation_follows_the_reduced_motion_implicit_or_explicit(
    mover: str, integrator: str
):
    motion = simulate(SCENE, mover, END, rtol=1e-9, atol=1e-11, integrator=integrator)
    assert motion.status == "finished", motion.reason
    s, angle, up, swing = reduced_motion("DOP853")
    q, v = motion.q[-1], motion.v[-1]
    assert np.abs(q[[0, 2, 3]] - (s, angle, angle)).max() < 1e-7
    assert np.abs(v[[0, 2, 3]] - (up, swing, swing)).max() < 1e-6


def test_the_shaft_keeps_its_angular_momentum_while_dampers_take_energy():
    motion = simulate(SCENE, "gw", END, rtol=1e-9, atol=1e-11)
    momenta = [
        Evaluation(SCENE, q, v).terms.M[1] @ v for q, v in zip(motion.q, motion.v, strict=True)
    ]
    assert np.ptp(momenta) < 1e-8 * momenta[0]
    assert (np.diff(motion.energy) < 1e-7).all()
    assert motion.energy[-1] < motion.energy[0] - 1e-3


def test_a_governor_without_dampers_keeps_its_energy():
    scene = FlyballGovernor(damping=None)
    assert scene.conserves_energy
    motion = simulate(scene, "gw", 0.1, rtol=1e-11, atol=1e-11)
    assert np.ptp(motion.energy) < 1e-7
    assert not SCENE.conserves_energy


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"slider": 0.0}, "slider = 0.0, expected a positive number"),
        ({"damping": -1.0}, "damping = -1.0, expected a number that is not negative"),
        ({"hinge": -0.1}, "hinge = -0.1, expected a positive number"),
        ({"height": np.inf}, "height = inf, expected a finite number"),
        ({"stiffness": [1.0, 2.0]}, r"stiffness has shape \(2,\)"),
    ],
)
def test_parameters_that_no_governor_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        FlyballGovernor(**change)
