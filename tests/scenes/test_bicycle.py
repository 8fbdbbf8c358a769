"""The bicycle against the published accelerations, the linear benchmark, and its own energy."""

from __future__ import annotations

import numpy as np
import pytest

from eomcheck import acceleration, simulate, velocity
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.dynamics import assembled_position
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import FORMULATIONS, applicable
from eomcheck.scenes import Bicycle

SCENE = Bicycle()
SCENE_KIND = Bicycle
every_formulation = pytest.mark.parametrize("key", applicable(Bicycle))
PUBLISHED = {
    "x": (0.0, -2.8069345714545, -0.5041626315047),
    "y": (0.0, -0.1480982396001, -0.3449706619454),
    "z": (0.2440472102925, 0.1058778746261, -1.4604528332980),
    "θ": (0.0, 0.7830033527065, 0.8353281706379),
    "φ": (3.1257073014894, -0.0119185528069, 0.1205543897884),
    "β_f": (0.0, 8.0133620584155, 2.4548072904550),
    "ψ": (0.9501292851472, 0.6068425835418, -7.8555281128244),
    "ψ_f": (0.2311385135743, 0.4859824687093, -4.6198904039403),
    "β_r": (0.0, 8.9129896614890, 1.8472554144217),
}
"""Basu-Mandal et al. 2007, Table 1: coordinates, velocities and accelerations of one state."""

Q, V, ACCELERATION = np.array([PUBLISHED[name] for name in SCENE.coordinate_names]).T


def residual(q) -> np.ndarray:
    """Return how high above the ground the wheels are (2,), m."""
    at = Evaluation(SCENE, q, np.zeros(9))
    return at.call(SCENE.position_residual, at.parameters, at.prepared, at.q)


def test_the_published_state_rolls_on_the_ground_without_slipping():
    assert np.abs(residual(Q)).max() < 1e-13
    at = Evaluation(SCENE, Q, V)
    assert np.abs(at.terms.a @ V).max() < 1e-12


@every_formulation
def test_every_formulation_gives_the_nine_published_accelerations(key: str):
    found = acceleration(SCENE, key, Q, V, consistent=False)
    assert np.abs(found.vdot - ACCELERATION).max() < 2e-12


# ---- The linear benchmark ------------------------------------------------------------------------

MASS = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
DAMPING = np.array([[0.0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])
WEIGHT = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
TURNING = np.array([[0.0, 76.59734589573222], [0.0, 2.65431523794604]])
"""Meijaard et al. 2007, Eqs. (5.3)-(5.4): M q̈ + v C_1 q̇ + (g K_0 + v² K_2) q = 0 in lean and
steer."""

EIGENVALUES = {
    4.0: (-12.15861426576447, -1.42944427361326, 0.41325331521125 + 3.07910818603206j),
    5.0: (-14.07838969279822, -0.32286642900409, -0.77534188219585 + 4.46486771378823j),
}
"""Forward speed, m/s -> castering, capsize and weave: the same, Table 2; stable from 4.29 m/s."""


def slopes(key: str, speed: float) -> np.ndarray:
    """Return ∂(ψ̈, ψ̈_f)/∂(ψ, ψ_f, ψ̇, ψ̇_f) (2, 4) of the upright bicycle.

    Central differences with two steps, extrapolated.
    """

    def at(change: np.ndarray) -> np.ndarray:
        q, _ = SCENE.initial_state()
        q[[6, 7]] += change[:2]
        q = assembled_position(SCENE, q)
        v = velocity(SCENE, q, [change[2], change[3], speed / SCENE.radius[0]])
        # What `acceleration` gives, without the bound of its error.
        return Evaluation(SCENE, q, v).acceleration(FORMULATIONS[key]).vdot[[6, 7]]

    def differences(step: float) -> np.ndarray:
        ahead = [(at(step * axis) - at(-step * axis)) / (2.0 * step) for axis in np.eye(4)]
        return np.column_stack(ahead)

    return (4.0 * differences(1e-3) - differences(2e-3)) / 3.0


@pytest.mark.sampled(10)
@every_formulation
@pytest.mark.parametrize("speed", EIGENVALUES)
def test_every_formulation_leans_and_steers_as_the_linear_benchmark_says(key: str, speed: float):
    found = slopes(key, speed)
    stiffness = 9.81 * WEIGHT + speed**2 * TURNING
    expected = -np.linalg.solve(MASS, np.hstack((stiffness, speed * DAMPING)))
    assert np.abs(found - expected).max() < 1e-8 * np.abs(expected).max()
    motion = np.vstack((np.hstack((np.zeros((2, 2)), np.eye(2))), found))
    roots = np.linalg.eigvals(motion)
    for published in EIGENVALUES[speed]:
        assert np.abs(roots - published).min() < 1e-7


# ---- Motion --------------------------------------------------------------------------------------


@pytest.mark.sampled(6)
def test_every_formulation_rolls_on_and_keeps_energy_and_wheels_on_the_ground(mover: str):
    motion = simulate(SCENE, mover, 2.0, rtol=1e-11, atol=1e-11)
    assert motion.status == "finished", motion.reason
    # At 4.6 m/s it recovers from the push and goes off in another direction.
    assert np.ptp(motion.q[:, 6]) > 0.05
    assert abs(motion.v[-1, 6]) < 0.25
    assert np.ptp(motion.energy) < 1e-8 * abs(motion.energy[0])
    assert np.abs([residual(q) for q in motion.q]).max() < 1e-8


def test_a_bicycle_that_is_not_pushed_rolls_straight_ahead():
    scene = Bicycle(lean_rate=0.0)
    found = acceleration(scene, "au", *scene.initial_state()).vdot
    assert np.abs(found).max() < 1e-11


# ---- What is refused -----------------------------------------------------------------------------


def test_a_bicycle_that_lies_flat_has_no_generalized_speeds():
    q = SCENE.initial_state()[0]
    q[6] = 0.0
    with pytest.raises(RefusedError, match="Euler's angles are singular"):
        velocity(SCENE, q, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"wheelbase": 0.0}, "wheelbase = 0.0, expected a positive number"),
        ({"radius": (0.3, -0.3)}, r"radius\[1\] = -0.3, expected a positive number"),
        ({"mass": (1.0, 2.0, 3.0)}, r"mass has shape \(3,\), expected \(4,\)"),
        ({"tilt": 1.6}, "tilt = 1.6, expected less than π/2 to either side"),
        ({"wheels": np.zeros((2, 2))}, r"wheels\[0\] = 0.0, expected a positive number"),
        ({"frames": ((1, 1, 1, 2), (1, 1, 1, 0))}, r"frames\[0\] = .* product of inertia below"),
        ({"gravity": -9.81}, "gravity = -9.81, expected a number that is not negative"),
    ],
)
def test_parameters_that_no_bicycle_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        Bicycle(**change)
