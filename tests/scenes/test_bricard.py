"""Bricard's mechanism against the geometry of a threefold symmetric ring, and against its rank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eomcheck import acceleration, simulate, speeds_of, velocity
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import applicable
from eomcheck.scenes import Bricard

SCENE = Bricard()
OVERCONSTRAINED = Bricard(redundant=1.0)
SCENE_KIND = Bricard
every_formulation = pytest.mark.parametrize("key", applicable(Bricard))
ANGLES = (-0.4, 0.0, 0.5, 1.5, 2.5)
"""θ_1, rad."""


def residual(q) -> np.ndarray:
    """Return how far the ring is from closed, by all five equations (5,)."""
    at = Evaluation(OVERCONSTRAINED, q, np.zeros(5))
    return at.call(at.scene.position_residual, at.parameters, at.prepared, at.q)


# ---- One degree of freedom -----------------------------------------------------------------------


def rotation(axis: int, angle) -> np.ndarray:
    """Return the rotation matrix about a coordinate axis, of a real or a complex angle."""
    R = np.eye(3, dtype=np.result_type(angle, float))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i], R[i, j] = np.sin(angle), -np.sin(angle)
    return R


def ring(angle) -> tuple[np.ndarray, np.ndarray]:
    """Return (corners P_1 .. P_6 (6, 3), hinge of the last rod (3,)) of the symmetric ring.

    Written from the edges of a cube and the condition that closes it, without the scene.
    """
    other = -np.arcsin(np.sin(angle) / (1 + np.sin(angle)))
    edges = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]])
    R, corners = np.eye(3), [np.zeros(3)]
    for k, axis in enumerate((1, 2, 0, 1, 2)):
        R = R @ rotation(axis, (angle, other)[k % 2])
        corners.append(corners[-1] + R @ edges[k])
    return np.array(corners), R[:, 0]


STEP = 1e-30j


def reduced_inertia(angle: float) -> float:
    """Return m(θ_1) with T = m θ̇_1²/2, kg m²: slender rods of 1 kg and 1 m, one complex step."""
    rates = ring(angle + STEP)[0].imag / STEP.imag
    along, centers = np.diff(rates, axis=0), (rates[1:] + rates[:-1]) / 2
    return float((centers**2).sum() + (along**2).sum() / 12.0)


def height(angle):
    """Return U/g = Σ m y, kg m."""
    y = ring(angle)[0][:, 1]
    return (y[1:] + y[:-1]).sum() / 2


@pytest.mark.parametrize("angle", ANGLES)
def test_the_ring_is_closed_and_its_hinges_are_where_geometry_says(angle: float):
    corners, hinge = ring(angle)
    assert np.abs(corners[-1] - [0.0, 0.0, 1.0]).max() < 1e-15
    assert np.abs(hinge - [1.0, 0.0, 0.0]).max() < 1e-15
    q, v = SCENE.closed_state(angle, 0.7)
    assert np.abs(residual(q)).max() < 1e-15
    at = Evaluation(OVERCONSTRAINED, q, v)
    assert np.abs(at.terms.a @ v).max() < 1e-15
    hinges = np.array([at for at, _ in SCENE.frames(q).values()])
    assert np.abs(hinges - corners[:-1]).max() < 1e-15
    middles = (corners[1:] + corners[:-1]) / 2
    weighed = SCENE.energies(at.parameters, at.prepared, q, v)[1]
    assert abs(weighed - 9.81 * middles[:, 1].sum()) < 1e-13


@every_formulation
@pytest.mark.parametrize("angle", ANGLES)
def test_every_formulation_starts_as_a_mechanism_of_one_degree_of_freedom(key: str, angle: float):
    q, v = SCENE.closed_state(angle, 0.0)
    slope = height(angle + STEP).imag / STEP.imag
    expected = -9.81 * slope / reduced_inertia(angle)
    found = acceleration(SCENE, key, q, v).vdot
    assert abs(found[4] - expected) < 1e-13 * max(1.0, abs(expected))
    assert np.abs(found[[1, 3]] - found[4]).max() < 1e-12


@pytest.mark.sampled(9)
def test_every_formulation_swings_as_the_energy_of_one_degree_of_freedom_says(mover: str):
    times = np.linspace(0.0, 3.0, 16)
    motion = simulate(SCENE, mover, 3.0, rtol=1e-12, atol=1e-12, output_times=times)
    assert motion.status == "finished", motion.reason
    for q, v in zip(motion.q, motion.v, strict=True):
        expected_q, expected_v = SCENE.closed_state(q[4], v[4])
        assert np.abs(q - expected_q).max() < 1e-9
        assert np.abs(v - expected_v).max() < 1e-9
        kinetic = reduced_inertia(q[4]) * v[4] ** 2 / 2.0
        assert abs(kinetic + 9.81 * (height(q[4]) - height(0.0))) < 1e-9
    # From one edge of the cube to another it turns by π, and comes to rest there for a moment.
    assert motion.q[:, 4].max() > 3.1


# ---- Overconstrained -----------------------------------------------------------------------------


def singular_values(q) -> np.ndarray:
    return np.linalg.svd(Evaluation(OVERCONSTRAINED, q, np.zeros(5)).terms.a)[1]


@pytest.mark.parametrize("angle", ANGLES)
def test_five_rows_have_rank_four_where_the_ring_is_closed_and_five_elsewhere(angle: float):
    q, _ = SCENE.closed_state(angle, 0.0)
    values = singular_values(q)
    assert values[4] < 1e-15 < 0.1 < values[3]
    assert singular_values(q + 0.1 * np.eye(5)[0])[4] > 1e-3


@pytest.mark.parametrize("key", [f.key for f in applicable(Bricard).values() if not f.redundant])
def test_every_formulation_but_one_refuses_the_redundant_row(key: str):
    q, v = OVERCONSTRAINED.closed_state(0.5, 0.0)
    with pytest.raises(RefusedError, match="singular to working precision"):
        acceleration(OVERCONSTRAINED, key, q, v)


@pytest.mark.parametrize("angle", ANGLES)
def test_all_five_rows_move_the_ring_as_four_of_them_do(angle: float):
    """Their forces are those of least squares, to which each hinge contributes."""
    q, v = SCENE.closed_state(angle, 0.7)
    found, expected = acceleration(OVERCONSTRAINED, "uk", q, v), acceleration(SCENE, "au", q, v)
    assert np.abs(found.vdot - expected.vdot).max() <= found.error_bound + expected.error_bound
    five, four = (Evaluation(scene, q, v).terms.a for scene in (OVERCONSTRAINED, SCENE))
    least = np.linalg.lstsq(five.T, four.T @ expected.multipliers, rcond=1e-9)[0]
    assert np.abs(found.multipliers - least).max() < 1e-11 * max(1.0, np.abs(least).max())
    assert np.linalg.norm(found.multipliers) < np.linalg.norm(expected.multipliers)


def test_the_row_left_out_is_implied_where_a_closed_position_is_found():
    random = np.random.default_rng(0)
    for _ in range(20):
        q = assembled_position(SCENE, random.uniform(-0.2, 0.4, 5))
        assert np.abs(residual(q)).max() < 1e-15
        v = velocity(SCENE, q, [1.0])
        assert np.abs(Evaluation(OVERCONSTRAINED, q, v).terms.a @ v).max() < 1e-14
        assert np.abs(speeds_of(SCENE, q, v) - 1.0).max() < 1e-15


# ---- What is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": [1.0] * 4}, r"mass has shape \(4,\), expected \(5,\)"),
        ({"across": [0.0] * 5}, r"across\[0\] = 0.0, expected a positive number"),
        ({"length": 0.0}, "length = 0.0, expected a positive number"),
        ({"gravity": -9.81}, "gravity = -9.81, expected a number that is not negative"),
        ({"angle": -0.6}, "angle = -0.6, expected a sine above -1/2"),
    ],
)
def test_parameters_that_no_ring_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        replace(SCENE, **change)
