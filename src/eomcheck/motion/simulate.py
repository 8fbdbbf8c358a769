"""`simulate`: a trajectory by one formulation and one integrator, in machine code end to end."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.doubles import Evaluation
from eomcheck.evaluation.dynamics import check_consistent, velocity
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import Formulation, formulation_for
from eomcheck.formulations.em import velocity_of_independent
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.motion.integrators import MOST_STEPS, Steps, integrate, integrator_of
from eomcheck.motion.observe import observer_of
from eomcheck.motion.right_hand_side import (
    ACCELERATION,
    RightHandSide,
    block_of,
    kernel_of,
    number_of_speeds,
    state_of,
)
from eomcheck.motion.stabilization import check_stabilization, in_pieces, projected
from eomcheck.numbers.contract import Array


@dataclass(frozen=True)
class Trajectory:
    """A motion, as one formulation and one integrator found it.

    Attributes:
        scene: the scene.
        key: the formulation.
        integrator: the integrator.
        rtol: relative tolerance.
        atol: absolute tolerance.
        times: (k,), s.
        q: coordinates (k, n).
        v: velocities (k, n).
        multipliers: λ (k, r), or None where the formulation has none.
        energy: T + U (k,), J.
        constraint_residual: |a v + b| (k, r), m/s, or None without constraints.
        right_hand_sides: right-hand sides evaluated.
        steps: steps taken.
        status: "finished", or "failed" if the end was not reached.
        reason: why not.
        seconds: time of the integration alone, s.
        refusal: what the formulation says to the state where it failed, if it refuses it.
        rcond: smallest reciprocal condition number of each matrix solved, by name, at the states
            looked at: `LOOKED_AT` of them at most, first and last included.
        rate_error: bound on the relative error of v̇ that rounding alone makes, the largest of the
            first, the last and the worst conditioned of these states; infinite where none can be
            measured.
        baumgarte: rate of Baumgarte's feedback, 1/s, or None without.
        projection: interval at which the velocity was projected, s, or None.
    """

    scene: Scene
    key: str
    integrator: str
    rtol: float
    atol: float
    times: Array
    q: Array
    v: Array
    multipliers: Array | None
    energy: Array
    constraint_residual: Array | None
    right_hand_sides: int
    steps: int
    status: str
    reason: str
    seconds: float
    refusal: RefusedError | None = None
    rcond: dict[str, float] = field(default_factory=dict)
    rate_error: float = math.inf
    baumgarte: float | None = None
    projection: float | None = None


LOOKED_AT = 200
"""Most states of a trajectory at which the matrices solved are looked at."""


class Motion:
    """A formulation of a scene in machine code, with the state vector that it integrates.

    Args:
        scene: the scene.
        formulation: the formulation.
        q0: initial coordinates (n,).
        v0: initial velocities (n,), consistent with the constraints.
        u0: initial generalized speeds (p,), by default those of v0.
        baumgarte: rate of Baumgarte's feedback, 1/s, or None.

    Raises:
        InputError: `baumgarte` is not positive or does not apply.
        RefusedError: the generalized speeds do not exist.
    """

    def __init__(
        self,
        scene: Scene,
        formulation: Formulation,
        q0: Array,
        v0: Array,
        u0: Array | None = None,
        baumgarte: float | None = None,
    ):
        check_stabilization(scene, formulation, baumgarte, None)
        self.scene, self.formulation, self.baumgarte = scene, formulation, baumgarte
        at = Evaluation(scene, q0, v0)
        if formulation.state == "q, u":
            scene.refuse_speeds(at.q)
        self.partition = at.partition
        if formulation.state == "q, u" and u0 is not None:
            at.u = u0
        self.y0 = state_of(at, formulation)
        self.speeds = number_of_speeds(scene, formulation)
        self.rates = RightHandSide(scene, formulation, baumgarte)

    def solve(self, t_end: float, projection: float | None = None, **options) -> Steps:
        """Return `integrate`'s result for this motion; counts are set anew.

        Args:
            t_end: end, s.
            projection: interval at which the velocity is projected onto the constraints, s.
            options: of `integrate`.
        """
        self.rates.reset()
        call = self.rates.address, self.rates.arguments
        if projection is None:
            return integrate(*call, self.y0, t_end, **options)
        first, times = options.pop("first_step", 0.0), options.pop("output_times", None)
        most = options.pop("max_steps", 0)

        def piece(start, end, y, first_step, output_times, max_steps) -> Steps:
            return integrate(
                *call,
                y,
                end,
                t_start=start,
                first_step=first_step,
                output_times=output_times,
                max_steps=max_steps,
                **options,
            )

        return in_pieces(piece, self.project, self.y0, t_end, projection, first, times, most)

    def project(self, t: float, y: Array) -> Array:
        """Return the state vector y with its speeds projected onto the constraints.

        Raises:
            RefusedError: a matrix is singular to working precision.
        """
        n, end = self.scene.n, self.scene.n + self.speeds
        here = self.scene, self.formulation, self.partition
        speeds = projected(*here, t, y[:n], y[n:end])
        return np.concatenate((y[:n], speeds, y[end:]))

    def split(self, y: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (q (n,), v (n,)) of a state vector at time t, s; NaN where it is not finite."""
        n = self.scene.n
        if not np.isfinite(y).all():
            return np.full(n, np.nan), np.full(n, np.nan)
        q, speeds = y[:n], y[n : n + self.speeds]
        if self.formulation.state == "q, u":
            at = Evaluation(self.scene, q, np.zeros(n), t)
            at.u = speeds
            return q, at.velocity
        if self.formulation.state == "q, x":
            at = Evaluation(self.scene, q, np.zeros(n), t)
            return q, at.call(self.scene.chain_velocity, at.parameters, at.prepared, q, speeds)
        if self.formulation.state == "q, v2":
            at = Evaluation(self.scene, q, np.zeros(n), t)
            a, b = at.terms.a, at.terms.b
            return q, at.call(velocity_of_independent, a, b, speeds, self.partition)
        return q, speeds

    def seen(self, t: Array, y: Array) -> dict[str, Array]:
        """Return v, u, energy, constraint and multipliers, each (k, ·), of states y (k, size)."""
        observer = observer_of(self.scene, self.formulation)
        solving = kernel_of(self.scene, self.formulation, also=ACCELERATION)
        kernels = (observer, solving) if "multipliers" in solving.outputs else (observer,)
        found: dict[str, Array] = {}
        for kernel in kernels:
            block = block_of(kernel, self.scene)
            rows = kernel.rows(block, t[:, None], y[:, :, None])
            found |= {name: x[:, :, 0] for name, x in rows.items()}
        return found

    def evaluation(self, y: Array, t: float) -> Evaluation | None:
        """Return the evaluation at a state vector; None where doubles cannot hold it."""
        q, v = self.split(y, t)
        if not np.isfinite((q, v)).all():
            return None
        at = Evaluation(self.scene, q, v, t)
        if self.formulation.state == "q, u":
            at.u = y[self.scene.n : self.scene.n + self.speeds]
        return at


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
        The trajectory. An integration that cannot go on, or that came to a state which the
        formulation refuses, is a result with `status` "failed" and a reason, up to where it came.

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
    start = time.perf_counter()
    found = motion.solve(
        t_end,
        projection,
        integrator=integrator,
        rtol=rtol,
        atol=atol,
        output_times=times,
        max_step=max_step,
        first_step=0.0 if first_step is None else first_step,
        max_steps=max_steps,
    )
    seconds = time.perf_counter() - start
    seen = trajectory(motion, found, integrator, rtol, atol, seconds)
    return replace(seen, baumgarte=baumgarte, projection=projection)


def trajectory(
    motion: Motion, found: Steps, integrator: str, rtol: float, atol: float, seconds: float
) -> Trajectory:
    """Return what the last `solve` of `motion`, which found these steps, says of the scene."""
    scene, formulation = motion.scene, motion.formulation
    course = _Course(motion, found)
    reason, refusal = course.refused or ("", None)
    if not (reason or (found.success and course.whole)):
        reason, refusal = _reason(motion, found)
    n, residual, energy = scene.n, course.rows("constraint"), course.rows("energy")
    assert energy is not None
    return Trajectory(
        scene,
        formulation.key,
        integrator,
        rtol,
        atol,
        found.t[: course.kept],
        found.y[: course.kept, :n],
        course.seen["v"][: course.kept],
        course.rows("multipliers"),
        energy[:, 0],
        None if residual is None else np.abs(residual),
        motion.rates.calls,
        found.steps,
        "failed" if reason else "finished",
        reason,
        seconds,
        refusal,
        course.rcond,
        course.rate_error(),
    )


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


class _Course:
    """What follows from the states of a motion, up to the first that fails.

    Seen in machine code. At `LOOKED_AT` of the states, and where a multiplier is no number, the
    public path looks at the matrices that are solved.
    """

    def __init__(self, motion: Motion, found: Steps):
        self.formulation = motion.formulation
        self.seen = motion.seen(found.t, found.y)
        whole = np.asarray(np.isfinite(found.y).all(axis=1))
        for name in ("v", "energy", "constraint"):
            if name in self.seen:
                whole &= np.isfinite(self.seen[name]).all(axis=1)
        count = len(whole)
        self.kept = count if whole.all() else int(np.argmin(whole))
        self.rcond: dict[str, float] = {}
        self.refused: tuple[str, RefusedError] | None = None
        self._looked: dict[int, Evaluation] = {}
        self._worst = (math.inf, 0)
        places = set(np.linspace(0, count - 1, min(count, LOOKED_AT)).astype(int).tolist())
        if "multipliers" in self.seen:
            places |= set(np.flatnonzero(np.isnan(self.seen["multipliers"]).any(axis=1)).tolist())
        for place in sorted(place for place in places if place < self.kept):
            try:
                self._look(motion, place, float(found.t[place]), found.y[place])
            except RefusedError as refusal:
                self.refused = (
                    f"the state at t = {found.t[place]:.9g} s is refused: {refusal}",
                    refusal,
                )
                self.kept = place
                break
        self.whole = self.kept == count

    def _look(self, motion: Motion, place: int, t: float, y: Array) -> None:
        at = motion.evaluation(y, t)
        if at is None:
            raise RefusedError("v", math.nan, 0.0, "v overflows: doubles cannot hold it")
        for name, rcond in at.acceleration(self.formulation).rcond.items():
            self.rcond[name] = min(rcond, self.rcond.get(name, 1.0))
            self._worst = min(self._worst, (rcond, place))
        self._looked[place] = at

    def rows(self, name: str) -> Array | None:
        """Return what was seen at the states kept (k, ·), or None."""
        return self.seen[name][: self.kept] if name in self.seen else None

    def rate_error(self) -> float:
        """Return the largest relative error bound of v̇ at the first, last and worst state."""
        worst = 0.0
        for place in {0, self._worst[1], max(self._looked)} if self._looked else ():
            at = self._looked[place]
            size = largest(at.acceleration(self.formulation).vdot)
            bound = allowed_error(at.acceleration_spread(self.formulation))
            worst = max(worst, bound / size if size > 0 else 0.0)
        return worst


def _reason(motion: Motion, found: Steps) -> tuple[str, RefusedError | None]:
    """Say why an integration did not reach its end."""
    if motion.rates.failed == 0:
        return found.message or "the energy overflows", None
    when = motion.rates.failure_time
    y = found.y[-1] if len(found.y) and np.isfinite(found.y[-1]).all() else motion.y0
    why, refusal = "it overflows, or a matrix is singular there", None
    try:
        q, v = motion.split(y, when)
        # A velocity that the independent ones do not determine is what a_1 refuses as well.
        at = Evaluation(motion.scene, q, np.nan_to_num(v), when)
        at.acceleration(motion.formulation)
    except RefusedError as error:
        why, refusal = str(error), error
    return f"the right-hand side is not finite at t = {when:.9g} s: {why}", refusal
