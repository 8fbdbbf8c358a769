"""Reference solutions: the same motion computed twice, by derivations that share no equation.

`taylor_reference` integrates (q, u) with the scene's kinematics, speeds and bodies and Kane's
formulation, by Taylor series in quad precision (heyoka). `extended_reference` integrates (q, v)
with Lagrange's terms and the augmented formulation, by extrapolation in numbers of 160 bits
(python-flint). Their difference is the uncertainty of either.

`Extrapolation` is the method of Gragg, Bulirsch and Stoer: ẏ = f(y) to any number of digits, in any
scalar type. The explicit midpoint rule from t to t + H, in n_j = 2, 4, 6, ... substeps, has an
error that is a series in (H/n_j)²; k such results are extrapolated to H = 0 and give order 2k. Step
and order are chosen as in ODEX (Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I,
Sec. II.9): the order of least work per unit of time, tried one order early and one late. For 25
digits it runs at orders near 30, with some 200 evaluations of f to a step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import pairwise
from math import ceil, inf, isfinite
from time import perf_counter
from typing import Any

import flint
import numpy as np

from eomcheck.deprecated import getattr_of
from eomcheck.errors import EomcheckError, InconsistentVelocityError, InputError, RefusedError
from eomcheck.evaluation.scene_quantities import Quantities
from eomcheck.evaluation.tolerance import largest
from eomcheck.formulations import FORMULATIONS
from eomcheck.mechanics.scene import Scene, finite_array
from eomcheck.motion.reference_solution import DIGITS, ReferenceRun, decimals
from eomcheck.numbers.ball import Balls, ball, precision
from eomcheck.numbers.generic import Array
from eomcheck.numbers.symbolic import BITS, HeyokaArithmetic

# ---- Extrapolation -------------------------------------------------------------------------------

MOST = 24
"""Largest number of extrapolated midpoint results: order 48."""

LEAST, FIRST = 3, 8
"""Least planned number of midpoint results of a step, and that of the first step."""

SAFETY, SHRINK, GROW = 0.9, 0.02, 4.0
"""Safety factor of the step size, and the limits of its change in one step."""

TINY = 1e-99
"""Replacement of an error of 0; its inverse replaces an infinite one."""

SMALLEST = 1e-12
"""Smallest step as a share of the whole time; below it the integration fails."""


class GaveUpError(EomcheckError, ArithmeticError):
    """The step became too small: the solution is not smooth, or f is not finite."""


def unchanged(y: Array) -> Array:
    """Return y unchanged."""
    return y


@dataclass
class IntegrationCounts:
    """Work counts of an integration."""

    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    orders: set[int] = field(default_factory=set)
    """Orders of the accepted steps."""
    longest: float = 0.0
    """The longest step, s."""


@dataclass(frozen=True)
class Extrapolation:
    """An integrator of ẏ = f(y), y an array of any scalar type with +, * and /.

    Args:
        f: y (n,) -> ẏ (n,).
        tolerance: error allowed in each step and entry, times 1 + |y|; must be above the rounding
            of the numbers, by a factor of a hundred at least.
        number: converts a step, a `Fraction`, to a factor of this scalar type; by default to float.
        clean: applied to y after each step, to remove accumulating parts such as radii of balls.
    """

    f: Callable[[Array], Array]
    tolerance: float
    number: Callable[[Fraction], Any] = float
    clean: Callable[[Array], Array] = unchanged
    effort: IntegrationCounts = field(default_factory=IntegrationCounts)

    def midpoints(self, y: Array, slope: Array, step: Fraction, substeps: int) -> Array:
        """Return y after `step` by the explicit midpoint rule; `slope` is f(y)."""
        h = self.number(step / substeps)
        before, now = y, y + slope * h
        for _ in range(substeps - 1):
            before, now = now, before + self.f(now) * (2 * h)
        self.effort.evaluations += substeps - 1
        return now

    def columns(self, y: Array, step: Fraction) -> Iterator[tuple[Array, float]]:
        """Yield (y after `step` of order 2k, its error over the tolerance) for k = 1, 2, ...

        The error is that of order 2k - 2: the better result is returned. There is none at k = 1.
        """
        slope = self.f(y)
        self.effort.evaluations += 1
        row: list[Array] = []
        for k in range(1, MOST + 1):
            entry, new = self.midpoints(y, slope, step, 2 * k), []
            for j, other in enumerate(row):
                # Aitken-Neville in (H/n)²: n_k² / n_{k-j-1}² - 1, in integers.
                low, high = (k - j - 1) ** 2, k * k
                new.append(entry)
                entry = entry + (entry - other) * low / (high - low)
            new.append(entry)
            yield entry, self.error(y, entry, new[-2]) if row else inf
            row = new

    def error(self, y: Array, better: Array, worse: Array) -> float:
        """Return the largest difference over the tolerance, inf if it is not a number."""
        apart = np.abs(np.array([float(x) for x in better - worse]))
        size = np.array([max(abs(float(a)), abs(float(b))) for a, b in zip(y, better, strict=True)])
        error = float((apart / (1.0 + size)).max()) / self.tolerance
        return error if isfinite(error) else inf

    def run(
        self,
        y: Array,
        times: Sequence[float],
        first: float | None = None,
        watch: Callable[[Fraction, Array], None] = lambda t, y: None,
    ) -> list[Array]:
        """Return y at each of `times`, which rise from the time of the initial `y`.

        Steps end at these times, there is no interpolation.

        Args:
            y: initial state (n,).
            times: float64 numbers, taken exactly.
            first: the first step to try; by default 1/1000 of the whole time.
            watch: called with t and y after every step.

        Raises:
            InputError: the times do not rise.
            GaveUpError: the step became too small.
        """
        exact = [Fraction(t) for t in times]
        if not exact or any(b <= a for a, b in pairwise(exact)):
            raise InputError(f"times = {list(times)!r}, expected times that rise")
        whole = float(exact[-1] - exact[0])
        step, target = whole / 1000 if first is None else first, FIRST
        t, states = exact[0], [y]
        for end in exact[1:]:
            while t < end:
                # Equal steps up to `end`, so that none is very short.
                parts = ceil(float(end - t) / step * (1 - 1e-9))
                equal = Fraction(float(end - t) / parts) if parts > 1 else end - t
                after, step, target = self.attempt(y, equal, target)
                if after is not None:
                    t, y = t + equal, after
                    watch(t, y)
                elif step < SMALLEST * whole:
                    raise GaveUpError(f"a step of {step:.2g} s is needed at t = {float(t)!r} s")
            states.append(y)
        return states

    def attempt(self, y: Array, step: Fraction, target: int) -> tuple[Array | None, float, int]:
        """Return (y after `step`, or None if the error is too large; next step; next target).

        Args:
            y: initial state (n,).
            step: the step.
            target: the number of midpoint results by which the error should be small enough.
        """
        steps: list[float] = []
        before = 1.0 / TINY
        for k, (after, error) in enumerate(self.columns(y, step), 1):
            error = min(max(error, TINY), 1.0 / TINY)
            steps.append(float(step) * SAFETY * error ** (-1.0 / (2 * k - 1)))
            if k >= target - 1:
                if error <= 1.0:
                    self.effort.steps += 1
                    self.effort.orders.add(2 * k)
                    self.effort.longest = max(self.effort.longest, float(step))
                    allowed, target = next_step_and_target(steps)
                    return self.clean(after), min(allowed, GROW * float(step)), target
                # Each column reduces the error at least as much as the previous one did.
                if k > target or not error * (error / before) ** (target + 1 - k) <= 1.0:
                    break
            before = error
        self.effort.rejected += 1
        best = min(range(2, len(steps) + 1), key=lambda k: evaluations_for(k) / steps[k - 1])
        if best < len(steps):
            target = max(best, LEAST)
        return None, min(max(steps[best - 1], SHRINK * float(step)), float(step) / 2), target


def evaluations_for(k: int) -> int:
    """Return the number of evaluations of f for k midpoint results."""
    return 1 + k * k


def next_step_and_target(steps: list[float]) -> tuple[float, int]:
    """Return (next step, next target) from the allowed steps of each order, 2 to 2k."""
    k = len(steps)
    work, before = evaluations_for(k) / steps[-1], evaluations_for(k - 1) / steps[-2]
    if work < 0.9 * before and k < MOST - 1:
        return steps[-1] * evaluations_for(k + 1) / evaluations_for(k), k + 1
    if before < 0.8 * work and k > LEAST:
        return steps[-2], k - 1
    return steps[-1], k


# ---- References ----------------------------------------------------------------------------------

EXTENDED_BITS, TOLERANCE = 160, 1e-28
"""Precision of the second integration, bits, and its error tolerance in each step."""

FIRST_SHARE = 2.0**-14
"""First Taylor step as a share of the whole time at most, see `taylor_reference`."""

CONSISTENT = 1e-40
"""Largest |c| / (1 + |v|) of a consistent initial velocity, c the scene's own `constraint`."""


def _checked(scene: Scene, q0, times) -> tuple[Array, list[float]]:
    """Return q0 (n,) and the times as float64."""
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
) -> ReferenceRun:
    """Return the motion of `scene` from (q0, u0) by Taylor series in quad precision.

    heyoka computes its steps from the last two Taylor coefficients. At rest, where the motion is
    symmetric in time, every second coefficient of each variable vanishes, and with more symmetry
    more do: the first step can be far too long. So the first step is tiny, away from the state of
    rest, every further one is at most twice the previous one, and the energy is checked after
    every step.

    Args:
        scene: the scene.
        q0: coordinates at times[0] (n,).
        u0: generalized speeds at times[0] (p,).
        times: output times, s, rising; the first is that of (q0, u0).
        longest_step: upper limit of the steps, s, for a second run as a check.

    Returns:
        The integration with all its digits.

    Raises:
        EngineError: heyoka is not installed.
        InputError: wrong shapes, values that are not finite, times that do not rise.
        RefusedError: the scene has no generalized speeds, or the motion ends before times[-1].
    """
    q0, times = _checked(scene, q0, times)
    u0 = finite_array("u0", u0, (scene.p,))
    scene.refuse_speeds(q0)
    began = perf_counter()
    numbers = HeyokaArithmetic()
    integrator, outputs = _taylor_system(scene, numbers, np.concatenate((q0, u0)), times[0])
    built = perf_counter()
    states, every, steps = _taylor_steps(numbers, integrator, times, longest_step)
    values, energies = (
        outputs(np.ascontiguousarray(np.array(x, dtype=numbers.quad).T)) for x in (states, every)
    )
    energies = energies[scene.n :]
    return ReferenceRun(
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


def _taylor_system(
    scene: Scene, numbers: HeyokaArithmetic, start: Array, t0: float
) -> tuple[Any, Any]:
    """Return (integrator of (q, u), compiled function (q, u) -> v and, if conserved, energy)."""
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
    # Time is one more unknown, with the rate 1.
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
    numbers: HeyokaArithmetic, integrator: Any, times: list[float], longest_step: float | None
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


def extended_velocity(scene: Scene, q0, u0, t0: float = 0.0) -> Array:
    """Return the velocity W u0 + offset (n,) in `flint.arb` numbers without radius.

    Their precision is `EXTENDED_BITS`.

    Args:
        scene: the scene.
        q0: coordinates (n,).
        u0: generalized speeds (p,).
        t0: time, s, for a scene that depends on it.

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
) -> ReferenceRun:
    """Return the motion of `scene` from (q0, v0) by extrapolation in numbers of 160 bits.

    Balls of ball arithmetic serve as floating-point numbers here: their radii are removed after
    each acceleration and each step, because they would grow without limit. So the result is not a
    certified enclosure; its accuracy follows from the comparison with `taylor_reference`.

    Args:
        scene: the scene.
        q0: coordinates at times[0] (n,), float64.
        v0: velocities at times[0] (n,): float64 or `flint.arb` numbers, see `extended_velocity`.
        times: output times, s, rising; the first is that of (q0, v0).
        tolerance: error allowed in each step, times 1 + |y| in each entry y of (q, v).
        watch: called with the time reached after every step.

    Returns:
        The integration with all its digits.

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

        # Time is one more unknown, with the rate 1.
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
                f"{CONSISTENT:.0g}: form it by `extended_velocity`"
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
        return ReferenceRun(
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


__getattr__ = getattr_of(__name__)
