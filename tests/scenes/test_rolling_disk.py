"""The rolling disk against its steady circles, its stability, and SymPy's KanesMethod."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import sympy
from sympy.physics import mechanics

import eomcheck
from eomcheck import acceleration, simulate, speeds_of, velocity
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.formulations import applicable
from eomcheck.mechanics.sketch import Body
from eomcheck.scenes import RollingDisk

SCENE_KIND = RollingDisk
every_formulation = pytest.mark.parametrize("key", applicable(RollingDisk))
PLACE = np.array([0.3, -0.2, 0.7])
"""x, y, ψ: nothing depends on them."""


def rate_of_speeds(disk: RollingDisk, lean: float, u, key: str = "kane") -> np.ndarray:
    """Return u̇ (3,) by a formulation: from v̇ = W u̇ + rest."""
    q = np.array([*PLACE, lean, 0.4])
    v = velocity(disk, q, u)
    _, rest, _ = Evaluation(disk, q, v).speeds
    return speeds_of(disk, q, acceleration(disk, key, q, v).vdot - rest)


# ---- An independent derivation -------------------------------------------------------------------


@cache
def kanes_method() -> Callable:
    """Return u̇ as SymPy derives it: a function of (lean, u, mass, radius, axial, across, g)."""
    turn, lean, spin, *u = mechanics.dynamicsymbols("psi theta phi u1:4")
    mass, radius, axial, across, gravity = sympy.symbols("m R axial across g")
    rates = [coordinate.diff() for coordinate in (turn, lean, spin)]
    ground = mechanics.ReferenceFrame("ground")
    heading = ground.orientnew("heading", "Axis", [turn, ground.z])
    leaning = heading.orientnew("leaning", "Axis", [lean, heading.x])
    disk = leaning.orientnew("disk", "Axis", [spin, leaning.y])
    true_rotation = disk.ang_vel_in(ground)
    rotation = sum((u[i] * axis for i, axis in enumerate(leaning)), mechanics.Vector(0))
    disk.set_ang_vel(ground, rotation)
    contact = mechanics.Point("contact")
    contact.set_vel(ground, mechanics.Vector(0))
    center = contact.locatenew("center", radius * leaning.z)
    center.v2pt_theory(contact, ground, disk)
    inertia = mechanics.inertia(leaning, across, axial, across)
    body = mechanics.RigidBody("disk", center, disk, mass, (inertia, center))
    kinematics = [(true_rotation - rotation).dot(axis) for axis in leaning]
    method = mechanics.KanesMethod(ground, [turn, lean, spin], u, kinematics)
    method.kanes_equations([body], [(center, -mass * gravity * ground.z)])
    right = method.mass_matrix.LUsolve(method.forcing).subs(method.kindiffdict())
    assert not right.has(*rates)
    return sympy.lambdify((lean, u, mass, radius, axial, across, gravity), right)


@every_formulation
def test_every_formulation_agrees_with_kanes_method_of_sympy(key: str):
    random = np.random.default_rng(0)
    for _ in range(5):
        disk = RollingDisk(*random.uniform(0.5, 3.0, 5))
        lean, u = random.uniform(-1.2, 1.2), random.uniform(-4.0, 4.0, 3)
        parameters = disk.mass, disk.radius, disk.axial, disk.across, disk.gravity
        expected = np.ravel(kanes_method()(lean, u, *map(float, parameters)))
        found = rate_of_speeds(disk, lean, u, key)
        assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()


# ---- Steady circles ------------------------------------------------------------------------------


def test_a_thin_disk_rolls_steadily_where_its_textbook_condition_holds():
    """(6 ω_2 ω_3 - ω_3² tan θ) R + 4 g sin θ = 0, the balance of moments about the heading."""
    disk = RollingDisk(lean=0.3, roll=-8.0, radius=0.4)
    turn = disk.steady_turn() * np.cos(0.3)
    moments = (6.0 * disk.roll * turn - turn**2 * np.tan(0.3)) * 0.4
    assert abs(moments + 4.0 * 9.81 * np.sin(0.3)) < 1e-12


@every_formulation
@pytest.mark.parametrize(("lean", "roll"), [(0.3, -8.0), (-0.5, -6.0), (0.9, 12.0), (0.0, 5.0)])
def test_in_steady_rolling_the_speeds_stay_as_they_are(key: str, lean: float, roll: float):
    disk = RollingDisk(lean=lean, roll=roll)
    u = np.array([0.0, roll, disk.steady_turn() * np.cos(lean)])
    assert np.abs(rate_of_speeds(disk, lean, u, key)).max() < 1e-12
    assert np.abs(rate_of_speeds(disk, lean, u + np.array([0.0, 0.0, 0.1]), key)).max() > 1e-2


@pytest.mark.parametrize("roll", [-8.0, 8.0])
@pytest.mark.parametrize("lean", [-0.5, 0.3])
def test_of_two_steady_turns_a_disk_starts_with_the_slower_one(lean: float, roll: float):
    disk = RollingDisk(mass=2.0, lean=lean, roll=roll)
    product = disk.mass * disk.gravity * disk.radius / (disk.across * np.cos(lean))  # of both
    _, v = disk.initial_state()
    assert v[2] == disk.steady_turn()
    assert 0 < v[2] ** 2 < product
    assert np.sign(v[2]) == -np.sign(lean * roll)


@pytest.mark.sampled(3)
def test_every_formulation_keeps_the_disk_on_its_circle(mover: str):
    disk = RollingDisk(lean=0.3, roll=-8.0)
    _, v0 = disk.initial_state()
    turn = v0[2]
    times = np.linspace(0.0, 2.0 * np.pi / abs(turn), 9)
    motion = simulate(disk, mover, times[-1], rtol=1e-12, atol=1e-12, output_times=times)
    assert motion.status == "finished", motion.reason
    # The centre of the circle is to the left of the heading at V / ψ̇.
    center = np.array([0.0, v0[0] / turn])
    angle = turn * times
    around = np.column_stack((np.sin(angle), -np.cos(angle))) * v0[0] / turn
    assert np.abs(motion.q[:, :2] - center - around).max() < 1e-8
    assert np.abs(motion.q[:, 2] - angle).max() < 1e-8
    assert np.abs(motion.q[:, 3] - 0.3).max() < 1e-8
    assert np.abs(motion.q[:, 4] - v0[4] * times).max() < 1e-8


# ---- Stability and energy ------------------------------------------------------------------------


def growth(disk: RollingDisk, roll: float) -> float:
    """Return k in θ̈ = k θ of an upright disk that rolls ahead, by central differences.

    A small lean also turns it: u̇_3 = c θ̇ makes u_3 = c θ.
    """
    step = 1e-4

    def slope(i: int, j: int) -> float:
        """Return the derivative of u̇_i in u_j; in θ for j = 3."""
        states = []
        for sign in (1.0, -1.0):
            change = np.zeros(4)
            change[j] = sign * step
            states.append(
                rate_of_speeds(disk, change[3], np.array([0.0, roll, 0.0]) + change[:3])[i]
            )
        return (states[0] - states[1]) / (2.0 * step)

    return slope(0, 3) + slope(0, 2) * slope(2, 0)


def test_a_rolling_disk_stays_upright_above_the_known_speed_and_not_below():
    """A thin disk is stable where ω² > g / (3 R)."""
    disk = RollingDisk(radius=0.5)
    critical = np.sqrt(9.81 / (3.0 * 0.5))
    assert growth(disk, 1.01 * critical) < 0.0 < growth(disk, 0.99 * critical)
    assert abs(growth(disk, critical)) < 1e-5


def test_a_hoop_stays_upright_above_the_known_speed_and_not_below():
    """A thin hoop is stable where ω² > g / (4 R)."""
    hoop = RollingDisk(mass=2.0, radius=0.5, axial=2.0 * 0.25, across=0.25)
    critical = np.sqrt(9.81 / (4.0 * 0.5))
    assert growth(hoop, 1.01 * critical) < 0.0 < growth(hoop, 0.99 * critical)


def test_every_formulation_conserves_the_energy_of_a_disk_that_wobbles(mover: str):
    disk = RollingDisk()
    q0 = np.array([*PLACE, 0.6, 0.0])
    u0 = np.array([0.5, -6.0, 1.5])
    options = {"q0": q0, "v0": velocity(disk, q0, u0)}
    motion = simulate(disk, mover, 2.0, rtol=1e-12, atol=1e-12, **options)
    assert motion.status == "finished", motion.reason
    assert np.ptp(motion.q[:, 3]) > 0.1
    assert np.ptp(motion.energy) < 1e-9 * motion.energy[0]
    assert motion.constraint_residual is not None
    assert motion.constraint_residual.max() < 1e-8


def test_the_gyroscopic_part_is_there_and_matters():
    disk = RollingDisk()
    q, v = disk.initial_state()
    at = Evaluation(disk, q, v)
    assert np.abs(at.bodies.gyroscopic).max() > 0.1
    without = at.bodies._replace(gyroscopic=None)
    at.bodies = without
    kane = at.acceleration(eomcheck.FORMULATIONS["kane"]).vdot
    assert np.abs(kane - acceleration(disk, "au", q, v).vdot).max() > 0.1


# ---- How it is drawn -----------------------------------------------------------------------------


def test_the_mark_on_the_rim_rests_where_it_touches_the_ground():
    disk = RollingDisk()
    q = np.array([*PLACE, 0.6, np.pi])
    v, h = velocity(disk, q, [0.5, -6.0, 1.5]), 1e-6

    def mark(at: np.ndarray) -> np.ndarray:
        (body,) = [part for part in disk.sketch(at).parts if isinstance(part, Body)]
        return np.asarray(body.points[-1])

    assert abs(mark(q)[2]) < 1e-14
    assert np.abs(mark(q + h * v) - mark(q - h * v)).max() / (2 * h) < 1e-7


# ---- What is refused -----------------------------------------------------------------------------


def test_a_disk_that_lies_flat_has_no_generalized_speeds():
    q = np.array([0.0, 0.0, 0.0, np.pi / 2, 0.0])
    with pytest.raises(RefusedError, match="Euler's angles are singular"):
        velocity(RollingDisk(), q, [0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": 0.0}, "mass = 0.0, expected a positive number"),
        ({"radius": -1.0}, "radius = -1.0, expected a positive number"),
        ({"axial": 0.0}, "axial = 0.0, expected a positive number"),
        ({"across": np.inf}, "across = inf, expected a finite number"),
        ({"gravity": -9.81}, "gravity = -9.81, expected a number that is not negative"),
        ({"lean": 1.6}, "lean = 1.6, expected less than π/2 to either side"),
    ],
)
def test_parameters_that_no_disk_has_are_refused_by_name(change, says):
    with pytest.raises(InputError, match=says):
        RollingDisk(**change)
