"""Chaplygin's sleigh against its closed-form motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from eomcheck import acceleration, simulate, speeds_of, velocity
from eomcheck.errors import InputError
from eomcheck.formulations import FORMULATIONS
from eomcheck.scenes import Sleigh

SCENE_KIND = Sleigh
SLEIGH = Sleigh(mass=2.0, inertia=0.3, offset=0.4, rate=3.0)
TIMES = np.linspace(0.0, 6.0, 13)


def closed_form(scene: Sleigh, t: float) -> tuple[float, float, float]:
    """Return (s, ω, θ) of a sleigh that turns on the spot at t = 0 with `scene.rate`.

    With J = I + m ℓ² energy is conserved, m s² + J ω² = J Ω², and ṡ = ℓ ω². So s = Ω κ tanh τ,
    ω = Ω / cosh τ with κ = sqrt(J/m) and τ = ℓ Ω t / κ, and θ is κ/ℓ times the Gudermannian of τ.
    """
    kappa = np.sqrt(scene.inertia / scene.mass + scene.offset**2)
    tau = scene.offset * scene.rate * t / kappa
    angle = kappa / scene.offset * 2.0 * np.arctan(np.tanh(tau / 2))
    return scene.rate * kappa * np.tanh(tau), scene.rate / np.cosh(tau), angle


def test_every_formulation_follows_the_closed_form(mover: str):
    if FORMULATIONS[mover].partitioned:
        # The paper's partition takes x for dependent, which ends where the sleigh points along x.
        scene, q0 = SLEIGH, np.array([0.0, 0.0, 1.0])
        times = TIMES[TIMES < 1.0]
    else:
        scene, q0, times = SLEIGH, np.zeros(3), TIMES
    v0 = np.array([0.0, 0.0, scene.rate])
    motion = simulate(
        scene, mover, times[-1], rtol=1e-12, atol=1e-12, output_times=times, q0=q0, v0=v0
    )
    assert motion.status == "finished", motion.reason
    for q, v, t in zip(motion.q, motion.v, times, strict=True):
        s, omega, angle = closed_form(scene, t)
        assert np.abs(speeds_of(scene, q, v) - (s, omega)).max() < 1e-10
        assert abs(q[2] - q0[2] - angle) < 1e-10


def test_the_edge_is_where_the_closed_form_takes_it():
    motion = simulate(SLEIGH, "kane", TIMES[-1], rtol=1e-13, atol=1e-13, output_times=TIMES)
    for q, t in zip(motion.q, TIMES, strict=True):
        for i, function in enumerate((np.cos, np.sin)):

            def rate(time: float, function=function) -> float:
                s, _, angle = closed_form(SLEIGH, time)
                return s * function(angle)

            assert abs(q[i] - quad(rate, 0.0, t, epsabs=1e-13, epsrel=1e-13, limit=200)[0]) < 1e-10


def test_the_sleigh_ends_up_gliding_ahead_of_its_edge_half_a_turn_and_more_away():
    scene = Sleigh(mass=2.0, inertia=0.3, offset=-0.4, rate=3.0)
    motion = simulate(scene, "kane", 20.0, rtol=1e-12, atol=1e-12)
    kappa = np.sqrt(0.3 / 2.0 + 0.16)
    s, omega = speeds_of(scene, motion.q[-1], motion.v[-1])
    # The centre of mass lies behind the edge: it turns around and leads.
    assert abs(s + 3.0 * kappa) < 1e-9
    assert abs(omega) < 1e-9
    assert abs(motion.q[-1, 2] - np.pi / 2 * kappa / 0.4) < 1e-9


def test_an_edge_under_the_centre_of_mass_draws_circles():
    scene = Sleigh(offset=0.0)
    v = velocity(scene, [0.0, 0.0, 0.3], [2.0, 0.5])
    vdot = acceleration(scene, "kane", [0.0, 0.0, 0.3], v).vdot
    assert np.abs(vdot - [-np.sin(0.3), np.cos(0.3), 0.0]).max() < 1e-15


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": 0.0}, "mass = 0.0, expected a positive number"),
        ({"inertia": -1.0}, "inertia = -1.0, expected a number that is not negative"),
        ({"offset": np.nan}, "offset = nan, expected a finite number"),
        ({"rate": [1.0]}, r"rate has shape \(1,\)"),
    ],
)
def test_parameters_that_no_sleigh_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        Sleigh(**change)
