"""`simulate`: a trajectory by one formulation and one integrator, in machine code end to end."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from eomcheck.errors import InputError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import check_consistent, velocity
from eomcheck.formulations import formulation_for
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.motion.integrators import MOST_STEPS, integrator_of
from eomcheck.motion.motion import Motion
from eomcheck.motion.stabilization import check_stabilization
from eomcheck.motion.trajectory import Trajectory, trajectory
from eomcheck.numbers.contract import Array


def simulate(
    scene: Scene,
    key: str,
    t_end: float,
    *,
    rtol: float = 1e-9,
    atol: float = 1e-9,
    integrator: str = "DOP853",
    output_times=None,
    q0=None,
    v0=None,
    u0=None,
    max_step: float = math.inf,
    first_step: float | None = None,
    max_steps: int = MOST_STEPS,
    baumgarte: float | None = None,
    projection: float | None = None,
) -> Trajectory:
    """Integrate the motion of `scene` from t = 0 to `t_end`.

    Each formulation integrates its own state (Eqs. (6), (8), (14), (19)): IM and Au (q, v, μ), El
    and GW (q, v), Em (q, v₂), ML and Kane (q, u), and banded (q, x) with the quasi-velocities. No
    Python is called in between.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        t_end: end, s.
        rtol: relative tolerance of a step.
        atol: absolute tolerance of a step, SI units.
        integrator: a key of `eomcheck.INTEGRATORS`.
        output_times: times (k,) in [0, t_end] at which the motion is wanted, rising; by default
            every step.
        q0: initial coordinates (n,), by default the scene's own state.
        v0: initial velocities (n,), or
        u0: initial generalized speeds (p,); by default the scene's own velocities, at rest if q0
            is given.
        max_step: largest step, s.
        first_step: first step, s, by default the integrator's choice.
        max_steps: give up after so many steps; 0 for no limit.
        baumgarte: rate of Baumgarte's feedback of the constraint error, 1/s.
        projection: interval, s, at which the velocity is projected onto the constraints, orthogonal
            in the norm of the mass matrix. Both are for formulations whose constraints enter at
            acceleration level, and off by default; see `eomcheck.motion.stabilization`.

    Returns:
        The trajectory. An integration that cannot go on, that came to a state which the
        formulation refuses, or went over a pose in which its partition is singular, is a result
        with `status` "failed" and a reason, up to where it came. Such a pose is noticed where it
        was crossed once between two steps; with `output_times` all steps are made once more.

    Raises:
        InputError: values that are not valid, velocities that violate the constraints, a
            formulation that does not apply to the scene, a stabilization that does not apply to the
            formulation.
        UnknownNameError: no such formulation or integrator.
        RefusedError: the generalized speeds do not exist, or no doubles hold the velocities.
    """
    formulation = formulation_for(checked_scene(scene), key)
    check_stabilization(scene, formulation, baumgarte, projection)
    integrator = integrator_of(integrator).key
    check_options(max_steps, t_end=t_end, rtol=rtol, atol=atol, max_step=max_step)
    if first_step is not None and not (_number(first_step) and 0 < first_step <= t_end):
        raise InputError(f"first_step = {first_step!r}, expected a number in (0, t_end]")
    times = None if output_times is None else checked_times(output_times, t_end)
    motion = Motion(scene, formulation, *initial(scene, q0, v0, u0), baumgarte)
    options = {
        "integrator": integrator,
        "rtol": rtol,
        "atol": atol,
        "max_step": max_step,
        "first_step": 0.0 if first_step is None else first_step,
        "max_steps": max_steps,
        "output_times": times,
    }
    every = motion.every_step(t_end, projection, **options)
    start = time.perf_counter()
    found = motion.solve(t_end, projection, **options)
    seconds = time.perf_counter() - start
    seen = trajectory(motion, found, integrator, rtol, atol, seconds, every)
    return replace(seen, baumgarte=baumgarte, projection=projection)


def _number(value) -> bool:
    return isinstance(value, int | float | np.floating) and not isinstance(value, bool)


def check_options(max_steps: int, **positive: float) -> None:
    """Raise InputError unless these are positive, of which only `max_step` may be infinite."""
    for name, value in positive.items():
        if not _number(value) or not value > 0 or (name != "max_step" and math.isinf(value)):
            raise InputError(f"{name} = {value!r}, expected a positive number")
    if isinstance(max_steps, bool) or not isinstance(max_steps, int) or max_steps < 0:
        raise InputError(f"max_steps = {max_steps!r}, expected a whole number, 0 for no limit")


def checked_times(output_times, t_end: float) -> Array:
    """Return the times (k,), s, if they rise within [0, t_end]."""
    try:
        shape = np.shape(output_times)
    except ValueError:  # lists of different lengths
        shape = ()
    times = finite_array("output_times", output_times, shape)
    rising = times.ndim == 1 and times.size > 0 and bool((np.diff(times) > 0).all())
    if not rising or times[0] < 0 or times[-1] > t_end:
        raise InputError(f"output_times must rise within [0, {t_end}], got {times}")
    return times


def initial(scene: Scene, q0, v0, u0) -> tuple[Array, Array, Array | None]:
    """Return (q0, v0, u0 or None) that a motion starts from; see `simulate`."""
    if v0 is not None and u0 is not None:
        raise InputError("v0 and u0 are both given, expected at most one of them")
    q, v = scene.initial_state()
    if q0 is not None:
        q, v = q0, np.zeros(scene.n)
    if u0 is not None:
        u0 = finite_array("u0", u0, (scene.p,))
        v = velocity(scene, q, u0)
    at = Evaluation(scene, q, v if v0 is None else v0)
    check_consistent(at)
    return at.q, at.v, u0
