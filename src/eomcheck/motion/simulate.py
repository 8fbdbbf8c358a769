"""Simulation of one motion: `simulate` integrates it by one formulation and one integrator.

A `Motion` is a formulation of a scene in machine code, ready to be integrated from a state; no
Python is called during the integration. A `Trajectory` is the computed motion with its error
estimates.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eomcheck.console import polled_progress
from eomcheck.errors import InputError, RefusedError
from eomcheck.evaluation.constraint_rank import check_rank_kept
from eomcheck.evaluation.dynamics import velocity
from eomcheck.evaluation.evaluation import Evaluation
from eomcheck.evaluation.perturbed import acceleration_sensitivity, check_consistent
from eomcheck.evaluation.tolerance import allowed_error, largest
from eomcheck.formulations import Formulation, formulation_for
from eomcheck.kernels.kernel import Kernel
from eomcheck.mechanics.scene import Scene, checked_scene, finite_array
from eomcheck.motion.integrators import MOST_STEPS, Steps, integrate, integrator_of
from eomcheck.motion.observables import (
    crossing_refusal,
    observer_of,
    singular_crossings,
    solves_partition,
)
from eomcheck.motion.right_hand_side import (
    ACCELERATION,
    RightHandSide,
    block_of,
    choice_for,
    kernel_of,
    number_of_speeds,
    parameter_arrays,
    set_speeds,
    state_of,
)
from eomcheck.motion.stabilization import (
    check_stabilization,
    integrate_in_pieces,
    is_number,
    project_speeds,
)
from eomcheck.numbers.generic import Array

# ---- Compiled motions ----------------------------------------------------------------------------

LARGEST_CHUNK = 2**20
"""Number of float64 in one chunk of states whose observables are computed at once."""

OBSERVED = "v", "energy", "constraint"
"""Outputs of `trace_observables` that a trajectory stores."""


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
        RefusedError: the generalized speeds do not exist, or it is not clear which constraints are
            independent. Those of the start are used all along the motion.
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
        self.partition = at.partition_for(formulation, pivoted=False)
        self.choice = choice_for(at, formulation)
        if formulation.state == "q, u" and u0 is not None:
            at.u = u0
        self.y0 = state_of(at, formulation)
        self.speeds = number_of_speeds(scene, formulation)
        self.rates = RightHandSide(scene, formulation, baumgarte, self.choice)
        self.solves_partition = solves_partition(scene, formulation)

    def solve(self, t_end: float, projection: float | None = None, **options) -> Steps:
        """Return the `Steps` of an integration of this motion; counts are reset.

        Args:
            t_end: end, s.
            projection: interval at which the velocity is projected onto the constraints, s.
            options: options of `integrate`.
        """
        self.rates.reset()
        label = f"integrating by {self.formulation.key}"
        with polled_progress(label, t_end, lambda: self.rates.time):
            return self._solve(t_end, projection, **options)

    def every_step(
        self, t_end: float, projection: float | None = None, *, output_times=None, **options
    ) -> Steps | None:
        """Return all integrator steps of `solve` on its way to `output_times`.

        None if those are its output, or if its formulation has no singular configuration to cross:
        a crossing lies between two steps, while the path between distant output times is curved.
        """
        if output_times is None or not self.solves_partition:
            return None
        return self.solve(t_end, projection, **options)

    def _solve(self, t_end: float, projection: float | None, **options) -> Steps:
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

        return integrate_in_pieces(
            piece, self.project, self.y0, t_end, projection, first, times, most
        )

    def project(self, t: float, y: Array) -> Array:
        """Return the state vector y with its speeds projected onto the constraints.

        Raises:
            RefusedError: a matrix is singular to working precision.
        """
        n, end = self.scene.n, self.scene.n + self.speeds
        here = self.scene, self.formulation, self.partition
        speeds = project_speeds(*here, t, y[:n], y[n:end])
        return np.concatenate((y[:n], speeds, y[end:]))

    def split(self, y: Array, t: float = 0.0) -> tuple[Array, Array]:
        """Return (q (n,), v (n,)) of a state vector at time t, s; NaN where it is not finite."""
        n = self.scene.n
        if not np.isfinite(y).all():
            return np.full(n, np.nan), np.full(n, np.nan)
        at = Evaluation(self.scene, y[:n], np.zeros(n), t)
        del at.v
        set_speeds(at, self.formulation, y[n : n + self.speeds])
        return at.q, at.v

    def observables(self, t: Array, y: Array) -> dict[str, Array]:
        """Return v, energy, constraint, multipliers, each (k, ·), of states y (k, size), by name.

        Constraint and multipliers only if they exist. States are processed in chunks, so that
        little memory is needed besides the result.
        """
        observer = observer_of(self.scene, self.formulation)
        solver = kernel_of(self.scene, self.formulation, also=ACCELERATION, choice=self.choice)
        return self._outputs(observer, OBSERVED, t, y) | self._outputs(
            solver, ("multipliers",), t, y
        )

    def _outputs(
        self, kernel: Kernel, wanted: Sequence[str], t: Array, y: Array
    ) -> dict[str, Array]:
        """Return the wanted outputs of a kernel, as far as it has them, at all states."""
        names = [name for name in wanted if name in kernel.outputs]
        outputs = {name: np.empty((len(t), kernel.outputs[name])) for name in names}
        block, size, first = block_of(kernel, self.scene), max(1, LARGEST_CHUNK // kernel.size), 0
        label = f"looking at the states of {self.formulation.key}"
        with polled_progress(label, len(t), lambda: first):
            for first in range(0, len(t) if names else 0, size):
                chunk = slice(first, first + size)
                rows = kernel.rows(block, t[chunk, None], y[chunk, :, None])
                for name in names:
                    outputs[name][chunk] = rows[name][:, :, 0]
        return outputs

    def singular_crossing(self, t: Array, y: Array) -> tuple[float, float] | None:
        """Return the times, s, between which states y (k, size) crossed a singularity, or None."""
        if not self.solves_partition or len(t) == 0:
            return None
        parameters = {name: np.ravel(x) for name, x in parameter_arrays(self.scene).items()}
        inputs = self.scene, self.formulation, parameters
        # Includes the initial state, which need not be an output.
        t, y = np.concatenate(([0.0], t)), np.vstack((self.y0, y))
        (crossing,) = singular_crossings(*inputs, t[:, None], y[:, :, None])
        return None if crossing is None else (float(t[crossing[0]]), float(t[crossing[1]]))

    def evaluation(self, y: Array, t: float) -> Evaluation | None:
        """Return the evaluation at a state vector; None if it overflows float64."""
        q, v = self.split(y, t)
        if not np.isfinite((q, v)).all():
            return None
        at = Evaluation(self.scene, q, v, t)
        at.independent_partition = self.partition
        if self.formulation.state == "q, u":
            at.u = y[self.scene.n : self.scene.n + self.speeds]
        return at


# ---- Trajectories --------------------------------------------------------------------------------

MOST_CHECKED_STATES = 200
"""Largest number of states of a trajectory at which the solved matrices are checked."""


@dataclass(frozen=True)
class Trajectory:
    """A computed trajectory of one formulation and one integrator, with its error estimates.

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
        reason: reason why it was not reached.
        seconds: time of the integration alone, s.
        refusal: the formulation's error at the state where it failed, if it refuses that state.
        rcond: smallest reciprocal condition number of each solved matrix, by name, at the checked
            states: `MOST_CHECKED_STATES` of them at most, first and last included.
        rate_error: bound on the relative rounding error of v̇, the largest at the first, the last
            and the worst conditioned of these states; infinite where none can be measured.
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


def trajectory_of(
    motion: Motion,
    steps: Steps,
    integrator: str,
    rtol: float,
    atol: float,
    seconds: float,
    every: Steps | None,
) -> Trajectory:
    """Return the trajectory of the last `solve` of `motion`, whose steps are `found`.

    Crossings of singular configurations are searched in `every` step, see `Motion.every_step`.
    """
    scene, formulation = motion.scene, motion.formulation
    observed = _ObservedMotion(motion, steps, steps if every is None else every)
    reason, refusal = observed.refused or ("", None)
    if not (reason or (steps.success and observed.whole)):
        reason, refusal = _reason(motion, steps)
    n, residual, energy = scene.n, observed.rows("constraint"), observed.rows("energy")
    assert energy is not None
    return Trajectory(
        scene,
        formulation.key,
        integrator,
        rtol,
        atol,
        steps.t[: observed.valid_count],
        steps.y[: observed.valid_count, :n],
        observed.observables["v"][: observed.valid_count],
        observed.rows("multipliers"),
        energy[:, 0],
        None if residual is None else np.abs(residual, out=residual),
        motion.rates.calls,
        steps.steps,
        "failed" if reason else "finished",
        reason,
        seconds,
        refusal,
        observed.rcond,
        observed.rate_error(),
    )


class _ObservedMotion:
    """Observables of the states of a motion, up to the first state that fails.

    They are computed in machine code. At `MOST_CHECKED_STATES` of the states, and where a
    multiplier is not a number, the evaluation of the public functions checks the solved matrices.
    """

    def __init__(self, motion: Motion, steps: Steps, every: Steps):
        self.formulation = motion.formulation
        self.observables = motion.observables(steps.t, steps.y)
        whole = np.asarray(np.isfinite(steps.y).all(axis=1))
        for name in ("v", "energy", "constraint"):
            if name in self.observables:
                whole &= np.isfinite(self.observables[name]).all(axis=1)
        count = len(whole)
        self.valid_count = count if whole.all() else int(np.argmin(whole))
        self.rcond: dict[str, float] = {}
        self.refused: tuple[str, RefusedError] | None = None
        self._checked: dict[str, Evaluation] = {}
        self._worst = math.inf
        between = motion.singular_crossing(every.t, every.y)
        if between is not None:
            refusal = crossing_refusal(*between)
            self.refused = str(refusal), refusal
            self.valid_count = min(
                self.valid_count, int(np.searchsorted(steps.t, between[0], "right"))
            )
        indices = set(
            np.linspace(0, count - 1, min(count, MOST_CHECKED_STATES)).astype(int).tolist()
        )
        if "multipliers" in self.observables:
            without = np.isnan(self.observables["multipliers"]).any(axis=1)
            indices |= set(np.flatnonzero(without)[:MOST_CHECKED_STATES].tolist())
        checked_indices = sorted(index for index in indices if index < self.valid_count)
        index = 0
        with polled_progress(f"checking matrices of {self.formulation.key}", count, lambda: index):
            for index in checked_indices:
                t = float(steps.t[index])
                try:
                    self._check_state(motion, t, steps.y[index])
                except RefusedError as refusal:
                    self.refused = f"the state at t = {t:.9g} s is refused: {refusal}", refusal
                    self.valid_count = index
                    break
        self.whole = self.valid_count == count

    def _check_state(self, motion: Motion, t: float, y: Array) -> None:
        at = motion.evaluation(y, t)
        if at is None:
            raise RefusedError("v", math.nan, 0.0, "v overflows: doubles cannot hold it")
        if motion.choice is not None:
            check_rank_kept(at, motion.partition)
        rcond_by_name = at.acceleration(self.formulation).rcond
        for name, rcond in rcond_by_name.items():
            self.rcond[name] = min(rcond, self.rcond.get(name, 1.0))
        # Only those that are evaluated again: their caches grow with the matrices.
        self._checked.setdefault("first", at)
        self._checked["last"] = at
        if min(rcond_by_name.values(), default=math.inf) < self._worst:
            self._worst = min(rcond_by_name.values())
            self._checked["worst"] = at

    def rows(self, name: str) -> Array | None:
        """Return an observable at the retained states (k, ·), or None."""
        return self.observables[name][: self.valid_count] if name in self.observables else None

    def rate_error(self) -> float:
        """Return the largest relative error bound of v̇ at the first, last and worst state."""
        worst = 0.0
        for at in set(self._checked.values()):
            size = largest(at.acceleration(self.formulation).vdot)
            bound = allowed_error(acceleration_sensitivity(at, self.formulation))
            # `max` would take NaN, ∞ / ∞, for small.
            if not math.isfinite(bound + size):
                return math.inf
            worst = max(worst, bound / size if size > 0 else 0.0)
        return worst if self._checked else math.inf


def _reason(motion: Motion, steps: Steps) -> tuple[str, RefusedError | None]:
    """Return the reason why an integration did not reach its end, and the refusal, if any."""
    if motion.rates.failed == 0:
        return "the energy overflows" if steps.success else steps.message, None
    when = motion.rates.failure_time
    y = steps.y[-1] if len(steps.y) and np.isfinite(steps.y[-1]).all() else motion.y0
    why, refusal = "it overflows, or a matrix is singular there", None
    try:
        q, v = motion.split(y, when)
        # a_1 also refuses a velocity that the independent ones do not determine.
        at = Evaluation(motion.scene, q, np.nan_to_num(v), when)
        at.independent_partition = motion.partition
        at.acceleration(motion.formulation)
    except RefusedError as error:
        why, refusal = str(error), error
    return f"the right-hand side is not finite at t = {when:.9g} s: {why}", refusal


# ---- simulate ------------------------------------------------------------------------------------


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
    Python is called during the integration.

    Args:
        scene: the scene.
        key: the formulation, a key of `eomcheck.FORMULATIONS`.
        t_end: end, s.
        rtol: relative tolerance of a step.
        atol: absolute tolerance of a step, SI units.
        integrator: a key of `eomcheck.INTEGRATORS`.
        output_times: times (k,) in [0, t_end] of the output, rising; by default every step.
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
        The trajectory. If an integration fails, reaches a state that the formulation refuses, or
        crosses a singular configuration of its partition, the trajectory ends at the last valid
        state, with `status` "failed" and a reason. A crossing is detected if it happens once
        between two steps; with `output_times` all steps are computed a second time.

    Raises:
        InputError: values that are not valid, velocities that violate the constraints, a
            formulation that does not apply to the scene, a stabilization that does not apply to the
            formulation.
        UnknownNameError: no such formulation or integrator.
        RefusedError: the generalized speeds do not exist, or the velocities overflow float64.
    """
    formulation = formulation_for(checked_scene(scene), key)
    check_stabilization(scene, formulation, baumgarte, projection)
    integrator = integrator_of(integrator).key
    check_options(max_steps, t_end=t_end, rtol=rtol, atol=atol, max_step=max_step)
    if first_step is not None and not (is_number(first_step) and 0 < first_step <= t_end):
        raise InputError(f"first_step = {first_step!r}, expected a number in (0, t_end]")
    times = None if output_times is None else checked_times(output_times, t_end)
    motion = Motion(scene, formulation, *initial_values(scene, q0, v0, u0), baumgarte)
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
    steps = motion.solve(t_end, projection, **options)
    seconds = time.perf_counter() - start
    trajectory = trajectory_of(motion, steps, integrator, rtol, atol, seconds, every)
    return replace(trajectory, baumgarte=baumgarte, projection=projection)


def check_options(max_steps: int, **positive: float) -> None:
    """Check that these options are positive, of which only `max_step` may be infinite.

    Raises:
        InputError: one is not.
    """
    for name, value in positive.items():
        if not is_number(value) or not value > 0 or (name != "max_step" and math.isinf(value)):
            raise InputError(f"{name} = {value!r}, expected a positive number")
    if isinstance(max_steps, bool) or not isinstance(max_steps, int) or max_steps < 0:
        raise InputError(f"max_steps = {max_steps!r}, expected a whole number, 0 for no limit")


def checked_times(output_times, t_end: float) -> Array:
    """Return the times (k,), s, after checking that they rise within [0, t_end].

    Raises:
        InputError: they do not.
    """
    try:
        shape = np.shape(output_times)
    except ValueError:  # nested lists of different lengths
        shape = ()
    times = finite_array("output_times", output_times, shape)
    rising = times.ndim == 1 and times.size > 0 and bool((np.diff(times) > 0).all())
    if not rising or times[0] < 0 or times[-1] > t_end:
        raise InputError(f"output_times must rise within [0, {t_end}], got {times}")
    return times


def initial_values(scene: Scene, q0, v0, u0) -> tuple[Array, Array, Array | None]:
    """Return the initial values (q0, v0, u0 or None) of a motion; see `simulate`."""
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
