"""The chain of four-bar linkages against the compound pendulum that it moves as."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

import eomcheck
from eomcheck import acceleration, simulate
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.scenes import FourBarChain

BENCHMARK = FourBarChain.rods(2)
UNEVEN = FourBarChain(
    mass=[1.0, 2.0, 0.5, 3.0, 1.5],
    inertia=[0.1, 0.0, 0.3, 0.2, 0.4],
    length=0.8,
    span=1.3,
    rate=-2.0,
)
SCENE_KIND = FourBarChain
every_formulation = pytest.mark.parametrize("key", applicable(FourBarChain))
AT_VELOCITY_LEVEL = [key for key, f in applicable(FourBarChain).items() if f.level == "velocity"]


def compound(scene: FourBarChain) -> tuple[float, float]:
    """Return (moment of inertia, kg m²; first moment of mass, kg m) of it as one pendulum.

    Rods turn about their feet and couplers only travel, with the tips of the rods.
    """
    is_rod = np.array([name.startswith("θ") for name in scene.coordinate_names])
    rods, couplers = scene.mass[is_rod].sum(), scene.mass[~is_rod].sum()
    about_feet = scene.inertia[is_rod].sum() + (rods / 4 + couplers) * scene.length**2
    return float(about_feet), float((rods / 2 + couplers) * scene.length)


def crank(scene: FourBarChain, times: np.ndarray) -> np.ndarray:
    """Return θ_0 of a chain that starts upright, fast enough to turn over.

    With γ from hanging straight down, γ̈ = -k sin γ. At the bottom γ̇² = rate² + 4k = 4k/m, and
    sin(γ/2) = sn(sqrt(k/m) t | m), counted from there.
    """
    inertia, moment = compound(scene)
    k = scene.gravity * moment / inertia
    fastest = scene.rate**2 + 4.0 * k
    m = 4.0 * k / fastest
    half = ellipj(np.sqrt(fastest) * times / 2.0 - ellipk(m), m)[3]
    return np.pi / 2 - (np.pi + 2.0 * half)


def gaps(scene: FourBarChain, q: np.ndarray) -> np.ndarray:
    """Return by how much the windows do not close (r,), m."""
    residual, at = scene.position_residual, Evaluation(scene, q, np.zeros(scene.n))
    assert residual is not None
    return at.call(residual, at.parameters, at.prepared, at.q)


@pytest.mark.parametrize(("scene", "end"), [(BENCHMARK, 0.6), (UNEVEN, 0.4)])
@pytest.mark.sampled(3)
def test_every_formulation_follows_the_compound_pendulum_down_to_the_singular_pose(
    mover: str, scene: FourBarChain, end: float
):
    times = np.linspace(0.0, end, 7)
    motion = simulate(scene, mover, end, rtol=1e-12, atol=1e-12, output_times=times)
    assert motion.status == "finished", motion.reason
    expected = crank(scene, times)
    assert 0.2 < expected[-1] < 1.0
    is_rod = np.array([name.startswith("θ") for name in scene.coordinate_names])
    assert np.abs(motion.q[:, is_rod] - expected[:, None]).max() < 1e-9
    assert np.abs(motion.q[:, ~is_rod]).max() < 1e-9
    assert max(np.abs(gaps(scene, q)).max() for q in motion.q) < 1e-9
    assert np.ptp(motion.energy) < 1e-8


@pytest.mark.parametrize("key", AT_VELOCITY_LEVEL)
def test_formulations_at_velocity_level_are_right_up_to_the_first_singular_pose(key: str):
    motion = simulate(BENCHMARK, key, 0.9, rtol=1e-11, atol=1e-11)
    assert motion.status == "failed"
    assert "a_1" in motion.reason
    assert 0.6 < motion.times[-1] < 0.7144
    assert np.abs(motion.q[:, -1] - crank(BENCHMARK, motion.times)).max() < 1e-8


@every_formulation
def test_every_formulation_refuses_the_singular_pose_itself(key: str):
    flat = replace(BENCHMARK, angle=0.0)
    with pytest.raises(RefusedError):
        acceleration(flat, key, *flat.initial_state())


@every_formulation
def test_the_benchmark_at_rest_upside_up_has_the_acceleration_of_the_pendulum(key: str):
    scene = replace(UNEVEN, angle=1.1, rate=0.0)
    inertia, moment = compound(scene)
    found = acceleration(scene, key, *scene.initial_state()).vdot
    is_rod = np.array([name.startswith("θ") for name in scene.coordinate_names])
    expected = np.where(is_rod, -9.81 * moment / inertia * np.cos(1.1), 0.0)
    assert np.abs(found - expected).max() < 1e-12


def test_a_repeated_row_is_refused_by_every_formulation_but_one_with_reason():
    others = {f.key for f in applicable(FourBarChain).values() if not f.redundant}
    twice = replace(UNEVEN, repeated=1.0, angle=1.0)
    findings = eomcheck.check_state(twice, *twice.initial_state())
    refused = {f.subject for f in findings if f.claim == "refusals"}
    assert refused == others
    assert [str(f) for f in findings if f.verdict == "failed"] == []
    for key in others:
        with pytest.raises(RefusedError) as caught:
            acceleration(twice, key, *twice.initial_state())
        assert caught.value.rcond <= caught.value.threshold


def test_a_repeated_row_is_one_row_more_and_the_last_one_again():
    twice = replace(UNEVEN, repeated=2.0)
    assert (twice.r, twice.p) == (UNEVEN.r + 1, UNEVEN.p - 1)
    once, more = (Evaluation(scene, *scene.initial_state()).terms for scene in (UNEVEN, twice))
    assert (more.a[:-1] == once.a).all()
    assert (more.a[-1] == 2.0 * once.a[-1]).all()
    assert (more.gamma[-1] == 2.0 * once.gamma[-1]).all()


def test_windows_are_closed_from_nearby():
    q = np.array([1.2, 1.3, 0.1, -0.1, 1.4])
    closed = assembled_position(UNEVEN, q)
    assert np.abs(gaps(UNEVEN, q)).max() > 1e-2
    assert np.abs(gaps(UNEVEN, closed)).max() < 1e-14
    assert np.abs(closed - q).max() < 0.3


def test_the_partition_takes_the_crank_for_independent():
    assert BENCHMARK.coordinate_names[-1] == "θ_0"
    at = Evaluation(BENCHMARK, *BENCHMARK.initial_state())
    assert list(at.partition.independent) == [BENCHMARK.n - 1]
    assert not BENCHMARK.natural_speeds
    assert FORMULATIONS["banded"].applies_to(FourBarChain) is False


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": [1.0, 1.0]}, "N >= 1 windows have 2N\\+1 links"),
        ({"inertia": [1.0]}, r"inertia has shape \(1,\)"),
        ({"length": 0.0}, "length = 0.0, expected a positive number"),
        ({"span": -1.0}, "span = -1.0, expected a positive number"),
        ({"gravity": np.nan}, "gravity = nan, expected a finite number"),
    ],
)
def test_parameters_that_no_chain_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        FourBarChain(**{"mass": np.ones(3), "inertia": np.ones(3)} | change)


def test_there_is_at_least_one_window():
    with pytest.raises(InputError, match="windows = 0"):
        FourBarChain.rods(0)
