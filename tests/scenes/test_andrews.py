"""Andrews' squeezing mechanism against the equations and the reference of the test set."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.samples import random_state

from eomcheck import acceleration, simulate
from eomcheck.errors import InputError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.scenes import Andrews

SCENE = Andrews()
SCENE_KIND = Andrews
every_formulation = pytest.mark.parametrize("key", applicable(Andrews))
CRANK_LAST = [1, 2, 3, 4, 5, 6, 0]
PUBLISHED = [6, 0, 1, 2, 3, 4, 5]
"""The published coordinates β, θ, γ, φ, δ, Ω, ε in our order, and ours in the published one."""

END = 0.03
POSITION = np.array(
    [
        0.1581077119629904e2,
        -0.1575637105984298e2,
        0.4082224013073101e-1,
        -0.5347301163226948,
        0.5244099658805304,
        0.5347301163226948,
        0.1048080741042263e1,
    ]
)[CRANK_LAST]
VELOCITY = np.array(
    [
        0.1139920302151208e4,
        -0.1424379294994111e4,
        0.1103291221937134e2,
        0.1929337464421385e2,
        0.5735699284790808,
        -0.1929337464421385e2,
        0.3231791658026955,
    ]
)[CRANK_LAST]
ACCELERATION = np.array(
    [
        -0.2463176316945196e5,
        0.5185037701610329e5,
        0.3241025686413781e6,
        0.5667493645176213e6,
        0.1674362929479361e5,
        -0.5667493645176222e6,
        0.9826520791458422e4,
    ]
)[CRANK_LAST]
MULTIPLIERS = -np.array(
    [
        0.1991753333731910e3,
        -0.2975531228015052e2,
        0.2306654119098399e2,
        0.3145271365475927e2,
        0.2264249232082739e2,
        0.1161740700019673e2,
    ]
)
"""At t = 0.03 s: Test Set for IVP Solvers, problem "Andrews' squeezing mechanism", PSIDE on a
Cray C90 with tolerances 1e-14. The test set has M q̈ = f - Gᵀλ."""


def published(q, v):
    """Return (M (7, 7), f (7,), G (6, 7), -Ġ v (6,)) as the test set writes them, in its order.

    The last, which the test set has no use for, is G differentiated along v by hand.
    """
    beta, theta, gamma, phi, delta, omega, epsilon = q
    turn, swing, rock, left, right, other, last = v
    m1, m2, m3, m4, m5, m6, m7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
    i1, i2, i3, i4 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7
    i5, i6, i7 = 1.169e-5, 5.667e-7, 1.912e-5
    xb, yb, xc, yc = -0.03635, 0.03273, 0.014, 0.072
    d, da, e, ea, rr, ra, ss = 0.028, 0.0115, 0.02, 0.01421, 0.007, 0.00092, 0.035
    sa, sb, sc, sd, ta, tb = 0.01874, 0.01043, 0.018, 0.02, 0.02308, 0.00916
    u, ua, ub, zf, zt, fa = 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    M = np.zeros((7, 7))
    M[0, 0] = m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * np.cos(theta) + da**2) + i1 + i2
    M[1, 0] = M[0, 1] = m2 * (da**2 - da * rr * np.cos(theta)) + i2
    M[1, 1] = m2 * da**2 + i2
    M[2, 2] = m3 * (sa**2 + sb**2) + i3
    M[3, 3] = m4 * (e - ea) ** 2 + i4
    M[4, 3] = M[3, 4] = m4 * ((e - ea) ** 2 + zt * (e - ea) * np.sin(phi)) + i4
    M[4, 4] = (
        m4 * (zt**2 + 2 * zt * (e - ea) * np.sin(phi) + (e - ea) ** 2)
        + m5 * (ta**2 + tb**2)
        + (i4 + i5)
    )
    M[5, 5] = m6 * (zf - fa) ** 2 + i6
    M[6, 5] = M[5, 6] = m6 * ((zf - fa) ** 2 - u * (zf - fa) * np.sin(omega)) + i6
    M[6, 6] = (
        m6 * ((zf - fa) ** 2 - 2 * u * (zf - fa) * np.sin(omega) + u**2)
        + m7 * (ua**2 + ub**2)
        + (i6 + i7)
    )
    cos, sin = np.cos(gamma), np.sin(gamma)
    x, y = sd * cos + sc * sin + xb - xc, sd * sin - sc * cos + yb - yc
    length = np.hypot(x, y)
    force = -4530.0 * (length - 0.07785) / length
    f = np.array(
        [
            0.033 - m2 * da * rr * swing * (swing + 2 * turn) * np.sin(theta),
            m2 * da * rr * turn**2 * np.sin(theta),
            force * (x * (sc * cos - sd * sin) + y * (sd * cos + sc * sin)),
            m4 * zt * (e - ea) * right**2 * np.cos(phi),
            -m4 * zt * (e - ea) * left * (left + 2 * right) * np.cos(phi),
            -m6 * u * (zf - fa) * last**2 * np.cos(omega),
            m6 * u * (zf - fa) * other * (other + 2 * last) * np.cos(omega),
        ]
    )
    # Along x and y: crank, coupler, and what leads to the same point from B and from A.
    crank = rr * np.array([np.cos(beta), np.sin(beta)])
    coupler = d * np.array([np.cos(beta + theta), np.sin(beta + theta)])
    rocker = ss * np.array([sin, -cos])
    arm, short = (
        zt * np.array([np.cos(delta), np.sin(delta)]),
        e * np.array([np.sin(phi + delta), -np.cos(phi + delta)]),
    )
    link, tall = (
        zf * np.array([np.cos(omega + epsilon), np.sin(omega + epsilon)]),
        u * np.array([np.sin(epsilon), -np.cos(epsilon)]),
    )
    across = np.array([[0.0, -1.0], [1.0, 0.0]])
    G = np.zeros((3, 2, 7))
    G[:, :, 0] = across @ (crank - coupler)
    G[:, :, 1] = -across @ coupler
    G[0, :, 2] = -across @ rocker
    G[1, :, 3], G[1, :, 4] = -across @ short, -across @ (short + arm)
    G[2, :, 5], G[2, :, 6] = -across @ link, -across @ (link + tall)
    inward = crank * turn**2 - coupler * (turn + swing) ** 2
    ends = np.array(
        [
            rocker * rock**2,
            short * (left + right) ** 2 + arm * right**2,
            link * (other + last) ** 2 + tall * last**2,
        ]
    )
    return M, f, G.reshape(6, 7), (inward - ends).ravel()


def published_rates(_, y) -> np.ndarray:
    """Return (q̇, q̈) (14,) of the published equations, without the scene."""
    M, f, G, right = published(y[:7], y[7:])
    matrix = np.block([[M, G.T], [G, np.zeros((6, 6))]])
    return np.concatenate((y[7:], np.linalg.solve(matrix, np.concatenate((f, right)))[:7]))


@cache
def independent_end() -> tuple[np.ndarray, np.ndarray]:
    """Return (q, v) at t = 0.03 s by the published equations and SciPy."""
    start = np.zeros(14)
    start[:7] = SCENE.initial_state()[0][PUBLISHED]
    found = solve_ivp(published_rates, (0.0, END), start, "DOP853", rtol=1e-13, atol=1e-14)
    return found.y[:7, -1][CRANK_LAST], found.y[7:, -1][CRANK_LAST]


def test_terms_are_those_of_the_test_set():
    random = np.random.default_rng(0)
    for _ in range(5):
        q, v, _ = random_state(SCENE, random)
        terms = Evaluation(SCENE, q, v).terms
        M, f, G, right = published(q[PUBLISHED], v[PUBLISHED])
        assert np.abs(terms.M - M[np.ix_(CRANK_LAST, CRANK_LAST)]).max() <= 1e-14 * np.abs(M).max()
        assert np.abs(terms.Q - terms.B - f[CRANK_LAST]).max() <= 1e-13 * np.abs(f).max()
        assert np.abs(terms.a - G[:, CRANK_LAST]).max() < 1e-16
        assert np.abs(terms.gamma + right).max() <= 1e-14 * np.abs(right).max()


def residual(q) -> np.ndarray:
    """Return how far the loops are from closed (6,), m."""
    at = Evaluation(SCENE, q, np.zeros(7))
    return at.call(SCENE.position_residual, at.parameters, at.prepared, at.q)


def test_the_published_poses_close_all_loops():
    assert np.abs(residual(SCENE.initial_state()[0])).max() < 1e-16
    assert np.abs(residual(POSITION)).max() < 1e-15


def test_the_crank_determines_all_other_angles_well_along_a_whole_turn():
    q, rest = SCENE.initial_state()
    for _ in range(72):
        q[-1] += np.radians(5.0)
        q = assembled_position(SCENE, q)
        assert np.linalg.cond(Evaluation(SCENE, q, rest).terms.a[:, :6]) < 6.0


@every_formulation
def test_every_formulation_starts_with_the_published_accelerations(key: str):
    found = acceleration(SCENE, key, *SCENE.initial_state())
    expected = np.array([-10666.8329399655854, 0.0, 0.0, 0.0, 0.0, 0.0, 14222.4439199541139])
    assert np.abs(found.vdot - expected).max() < 1e-8
    if FORMULATIONS[key].multipliers:
        published_forces = np.array([98.5668703962410897, -6.12268834425566266, 0, 0, 0, 0])
        assert np.abs(found.multipliers + published_forces).max() < 1e-10


@pytest.mark.sampled(8)
def test_every_formulation_ends_where_the_reference_of_the_test_set_ends(mover: str):
    motion = simulate(SCENE, mover, END, rtol=1e-13, atol=1e-13)
    assert motion.status == "finished", motion.reason
    q, v = motion.q[-1], motion.v[-1]
    expected_q, expected_v = independent_end()
    assert np.abs(q - expected_q).max() < 1e-9
    assert np.abs(v - expected_v).max() < 1e-7
    # The published digits go no further than this.
    assert np.abs(q - POSITION).max() < 2e-9
    assert np.abs(v - VELOCITY).max() < 1e-6
    assert np.ptp(motion.energy) < 1e-11
    assert np.abs(residual(q)).max() < 1e-13


def energy(q, v) -> float:
    """Return T + U, J."""
    at = Evaluation(SCENE, q, v)
    return sum(at.call(SCENE.energies, at.parameters, at.prepared, at.q, at.v))


def test_it_is_the_published_end_that_has_lost_energy():
    start = energy(*SCENE.initial_state())
    assert abs(energy(*independent_end()) - start) < 1e-12
    assert -2.3e-10 < energy(POSITION, VELOCITY) - start < -2.1e-10


def test_accelerations_and_multipliers_at_the_published_end_are_nearly_the_published_ones():
    found = acceleration(SCENE, "gw", POSITION, VELOCITY, consistent=False)
    assert np.abs(found.vdot / ACCELERATION - 1).max() < 2e-6
    assert np.abs(found.multipliers / MULTIPLIERS - 1).max() < 2e-6


def test_the_mechanism_stands_still_without_torque_and_spring():
    scene = replace(SCENE, torque=0.0, stiffness=0.0)
    assert not acceleration(scene, "kane", *scene.initial_state()).vdot.any()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": [1.0] * 6}, r"mass has shape \(6,\), expected \(7,\)"),
        ({"mass": [1.0] * 6 + [0.0]}, r"mass\[6\] = 0.0, expected a positive number"),
        ({"inertia": [-1.0] * 7}, r"inertia\[0\] = -1.0, expected a number that is not negative"),
        ({"tip": np.zeros((6, 2))}, r"tip has shape \(6, 2\)"),
        ({"stiffness": -1.0}, "stiffness = -1.0, expected a number that is not negative"),
        ({"torque": np.nan}, "torque = nan, expected a finite number"),
    ],
)
def test_parameters_that_no_mechanism_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        Andrews(**change)
