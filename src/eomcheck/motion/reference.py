"""Reference solutions: the same motion computed twice, by derivations that share no equation.

`taylor_reference` integrates (q, u) with the scene's kinematics, speeds and bodies and Kane's
formulation, by Taylor series in quad precision (heyoka). `extended_reference` integrates (q, v)
with Lagrange's terms and the augmented formulation, by extrapolation in numbers of 160 bits
(python-flint). What they differ by is the uncertainty of either.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from time import perf_counter
from typing import Any

import flint
import numpy as np

from eomcheck.errors import InconsistentVelocityError, InputError, RefusedError
from eomcheck.evaluation.point import Quantities
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.motion.extrapolation import Extrapolation, GaveUpError
from eomcheck.motion.run import DIGITS, Run, decimals
from eomcheck.numbers.ball import Balls, ball, precision
from eomcheck.numbers.contract import Array
from eomcheck.numbers.taylor import BITS, Expressions

EXTENDED_BITS, TOLERANCE = 160, 1e-28
"""Precision of the second integration, and the error that it allows in each step."""

FIRST_SHARE = 2.0**-14
"""The first Taylor step is at most this share of the whole time, see `taylor_reference`."""

CONSISTENT = 1e-40
"""Largest |c| / (1 + |v|) of a velocity to start with, c the scene's own `constraint`."""


def _checked(scene: Scene, q0, times) -> tuple[Array, list[float]]:
    """Return q0 (n,) and the times as doubles."""
    q0, _ = scene.check_state(q0, np.zeros(scene.n))
    times = finite_array("times", times, np.shape(times)).tolist()
    if not isinstance(times, list) or len(times) < 2 or any(b <= a for a, b in pairwise(times)):
        raise InputError(f"times = {times!r}, expected at least two times that rise")
    return q0, times


def _drift(energies: Sequence[Any]) -> float:
    """Return the largest |E - E_0| over |E_0|, or over 1 J where E_0 is 0; ∞ if not finite."""
    scale = abs(float(energies[0])) or 1.0
    worst = largest([float(energy - energies[0]) for energy in energies])
    return worst / scale if math.isfinite(worst) else worst


# ---- The first: Kane's formulation, Taylor series in quad precision ------------------------------


def taylor_reference(
    scene: Scene,
    q0,
    u0,
    times: Sequence[float],
    *,
    longest_step: float | None = None,
) -> Run:
    """Return the motion of `scene` from (q0, u0) by Taylor series in quad precision.

    heyoka takes its steps from the last two Taylor coefficients. At rest, where the motion is the
    same forwards and backwards, every second coefficient of each variable vanishes, and with more
    symmetry more do: the first step can be far too long. So it is a tiny one here, off the state
    of rest, the next ones are at most twice the one before, and the energy is looked at after
    every step.

    Args:
        scene: the scene.
        q0: coordinates at times[0] (n,).
        u0: generalized speeds at times[0] (p,).
        times: output times, s, rising; the first is that of (q0, u0).
        longest_step: a limit to the steps, s: for a second run that ought to agree.

    Raises:
        EngineError: heyoka is not installed.
        InputError: wrong shapes, values that are not finite, times that do not rise.
        RefusedError: the scene has no generalized speeds, or the motion ends before times[-1].
    """
    q0, times = _checked(scene, q0, times)
    u0 = finite_array("u0", u0, (scene.p,))
    scene.refuse_speeds(q0)
    began = perf_counter()
    numbers = Expressions()
    integrator, outputs = _taylor_system(scene, numbers, np.concatenate((q0, u0)), times[0])
    built = perf_counter()
    states, every, steps = _taylor_steps(numbers, integrator, times, longest_step)
    values, energies = (
        outputs(np.ascontiguousarray(np.array(x, dtype=numbers.quad).T)) for x in (states, every)
    )
    energies = energies[scene.n :]
    return Run(
        times,
        _quad_decimals(np.array([state[: scene.n] for state in states])),
        _quad_decimals(values[: scene.n].T),
        _quad_decimals(values[scene.n]) if len(energies) else None,
        _drift(energies[0]) if len(energies) else None,
        {
            "method": "Taylor series of (q, u), Kane's formulation",
            "library": f"heyoka {numbers.heyoka.__version__}",
            "number": numbers.quad.__name__,
            "bits": BITS,
            "tolerance": float(integrator.tol),
            "order": int(integrator.order),
            "steps": len(steps),
            "longest_step": max(steps),
            "evaluations": None,
            "seconds": round(perf_counter() - began, 2),
            "seconds_to_compile": round(built - began, 2),
        },
    )


def _taylor_system(scene: Scene, numbers: Expressions, start: Array, t0: float) -> tuple[Any, Any]:
    """Return (integrator of (q, u), compiled function (q, u) -> v and, where kept, energy)."""
    q, u = numbers.variables("q", scene.n), numbers.variables("u", scene.p)
    clock = numbers.variables("t", 1 if scene.depends_on_time else 0)
    at = Quantities(scene, numbers, q, *clock)
    at.u = u
    udot, _ = at.rates(FORMULATIONS["kane"])
    rates = [numbers.expression(x) for x in (*at.v, *udot)]
    outputs = list(rates[: scene.n])
    if scene.conserves_energy:
        T, U = scene.energies(at.parameters, at.prepared, q, at.v)
        outputs.append(T if U is None else T + U)
    # Time is one more unknown, whose rate is 1.
    state, rates = [*q, *u, *clock], [*rates, *(numbers.expression(1) for _ in clock)]
    integrator = numbers.heyoka.taylor_adaptive(
        list(zip(state, rates, strict=True)),
        numbers.constants(np.append(start, [t0] * clock.size)),
        time=numbers.constant(t0),
        compact_mode=True,
        **numbers.options,
    )
    compiled = numbers.heyoka.cfunc(outputs, vars=state, compact_mode=True, **numbers.options)
    return integrator, compiled


def _taylor_steps(
    numbers: Expressions, integrator: Any, times: list[float], longest_step: float | None
) -> tuple[list[Array], list[Array], list[float]]:
    """Return the states at `times`, those after every step, and the steps, s."""
    outcomes = numbers.heyoka.taylor_outcome
    states, every = [integrator.state.copy()], [integrator.state.copy()]
    steps: list[float] = []
    limit = (times[-1] - times[0]) * FIRST_SHARE
    while len(states) < len(times):
        outcome, step = integrator.step(max_delta_t=numbers.constant(limit), write_tc=True)
        if outcome not in (outcomes.success, outcomes.time_limit):
            reached = float(integrator.time)
            raise RefusedError(
                "u̇", 0.0, 0.0, f"the motion cannot be followed beyond t = {reached!r} s: {outcome}"
            )
        steps.append(float(step))
        every.append(integrator.state.copy())
        limit = min(2.0 * steps[-1], np.inf if longest_step is None else longest_step)
        while len(states) < len(times) and numbers.constant(times[len(states)]) <= integrator.time:
            states.append(integrator.update_d_output(numbers.constant(times[len(states)])).copy())
    return states, every, steps


def _quad_decimals(x: Array) -> Array:
    return decimals(np.array([str(y) for y in x.ravel()], object).reshape(x.shape))


# ---- The second: Lagrange's terms, extrapolation in 160 bits -------------------------------------


def consistent_velocity(scene: Scene, q0, u0, t0: float = 0.0) -> Array:
    """Velocity W u0 + offset (n,) in `flint.arb` numbers of `EXTENDED_BITS` without radius.

    Args:
        scene: the scene.
        q0: coordinates (n,).
        u0: generalized speeds (p,).
        t0: time, s: of a scene that depends on it.

    Raises:
        InputError: wrong shapes, or values that are not finite.
        RefusedError: the scene has no generalized speeds.
    """
    q0, _ = scene.check_state(q0, np.zeros(scene.n))
    u0, start = finite_array("u0", u0, (scene.p,)), finite_array("t0", t0, ())
    scene.refuse_speeds(q0)
    balls = Balls()
    with precision(EXTENDED_BITS):
        at = Quantities(scene, balls, balls.numbers(q0), balls.numbers(start).item())
        at.u = balls.numbers(u0)
        return _stripped(at.v)


def extended_reference(
    scene: Scene,
    q0,
    v0,
    times: Sequence[float],
    *,
    tolerance: float = TOLERANCE,
    watch: Callable[[float], None] = lambda t: None,
) -> Run:
    """Return the motion of `scene` from (q0, v0) by extrapolation in numbers of 160 bits.

    Balls serve as floating-point numbers here: their radii are taken off after each acceleration
    and each step, lest they grow until nothing is known. So the result is not enclosed; what it is
    worth shows in the comparison with `taylor_reference`.

    Args:
        scene: the scene.
        q0: coordinates at times[0] (n,), doubles.
        v0: velocities at times[0] (n,): doubles or `flint.arb` numbers, see `consistent_velocity`.
        times: output times, s, rising; the first is that of (q0, v0).
        tolerance: error allowed in each step, times 1 + |y| in each entry y of (q, v).
        watch: called with the time reached after every step.

    Raises:
        InputError: wrong shapes, values that are not finite, times that do not rise.
        InconsistentVelocityError: v0 violates the constraints.
        RefusedError: the augmented matrix is singular, or the motion ends before times[-1].
    """
    q0, times = _checked(scene, q0, times)
    v0 = np.array(v0)
    if v0.dtype != object:
        v0 = finite_array("v0", v0, (scene.n,))
    balls, au = Balls(), FORMULATIONS["au"]
    began = perf_counter()
    with precision(EXTENDED_BITS):
        parameters = scene.parameters(balls)

        # Time is one more unknown, whose rate is 1.
        clock = [times[0]] if scene.depends_on_time else []
        last = 2 * scene.n

        def at(y: Array) -> Quantities:
            point = Quantities(scene, balls, y[: scene.n], *y[last:])
            point.parameters, point.v = parameters, y[scene.n : last]
            return point

        def rate(y: Array) -> Array:
            vdot = _stripped(at(y).solution(au).vdot)
            return np.concatenate((y[scene.n : last], vdot, balls.numbers(np.ones(len(clock)))))

        def energy(y: Array) -> Any:
            here = at(y)
            T, U = scene.energies(parameters, here.prepared, here.q, here.v)
            return ball(T if U is None else T + U).mid()

        v0 = v0 if v0.dtype == object else balls.numbers(v0)
        start = np.concatenate((balls.numbers(q0), v0, balls.numbers(np.array(clock))))
        violation = _violation(scene, at(start))
        if not violation <= CONSISTENT:
            raise InconsistentVelocityError(
                f"v0 violates the constraints by {violation:.2g} of its size, allowed is "
                f"{CONSISTENT:.0g}: form it by `consistent_velocity`"
            )
        energies = [energy(start)] if scene.conserves_energy else []

        def look(t: Fraction, y: Array) -> None:
            if scene.conserves_energy:
                energies.append(energy(y))
            watch(float(t))

        integrator = Extrapolation(rate, tolerance, _arb, _stripped)
        try:
            states = np.array(integrator.run(start, times, watch=look))
        except GaveUpError as error:
            raise RefusedError("v̇", 0.0, 0.0, f"the motion cannot be followed: {error}") from None
        effort = integrator.effort
        return Run(
            times,
            _arb_decimals(states[:, : scene.n]),
            _arb_decimals(states[:, scene.n : last]),
            _arb_decimals(np.array([energy(y) for y in states])) if energies else None,
            _drift(energies) if energies else None,
            {
                "method": "extrapolation of (q, v), augmented formulation of Lagrange's terms",
                "library": f"python-flint {flint.__version__}",
                "number": "arb",
                "bits": EXTENDED_BITS,
                "tolerance": tolerance,
                "order": f"{min(effort.orders)}..{max(effort.orders)}",
                "steps": effort.steps,
                "longest_step": effort.longest,
                "evaluations": effort.evaluations,
                "seconds": round(perf_counter() - began, 2),
            },
        )


def _violation(scene: Scene, at: Quantities) -> float:
    """Return the largest |c| / (1 + |v|) over the constraints; ∞ if not finite."""
    c = scene.constraint(at.parameters, at.prepared, at.q, at.v)
    if c is None:
        return 0.0
    size = 1.0 + max(abs(float(x.mid())) for x in at.v)
    worst = largest([float(ball(x).mid()) for x in c])
    return worst / size if math.isfinite(worst) else worst


def _arb(x: Fraction) -> flint.arb:
    return flint.arb(x.numerator) / x.denominator


def _stripped(x: Array) -> Array:
    """Return the midpoints of the balls x (k,), as balls without radius."""
    return np.array([ball(y).mid() for y in x], object)


def _arb_decimals(x: Array) -> Array:
    digits = [ball(y).str(DIGITS + 4, radius=False) for y in x.ravel()]
    return decimals(np.array(digits, object).reshape(x.shape))
