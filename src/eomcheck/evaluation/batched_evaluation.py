"""A batch of evaluations: scenes of one structure and their formulations at many states, in lanes.

Each lane (an entry of the batch axis, the last one) has the results of `Evaluation` at its state.
If a formulation refuses the state of a lane, its result is NaN there and `refused` is true. All
scenes have generalized speeds at their states, or none has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from typing import Any

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import SPEEDS, TRACES, Acceleration, Evaluation, Key
from eomcheck.evaluation.perturbed import PerturbedEvaluation, amplification
from eomcheck.evaluation.scene_quantities import quantity
from eomcheck.evaluation.tolerance import INCONCLUSIVE, allowed_error, largest, well_conditioned
from eomcheck.evaluation.violations import SLIP, allowed_violation
from eomcheck.formulations import Formulation
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.mechanics.records import State
from eomcheck.mechanics.scene import Scene
from eomcheck.numbers.generic import FLOAT64, Array, map_record
from eomcheck.numbers.lanes import LANE_ARITHMETIC, LaneArray, LaneNoise, as_float64, lanes_in
from eomcheck.numbers.linear import SolveRecorder, recording_solves
from eomcheck.numbers.noise import SAMPLES, STEP, STRETCH, NoisyArithmetic


def stacked(records: Sequence[Any]) -> Any:
    """Return one record of lanes, stacked from records of arrays."""
    return map_record(
        lambda *parts: LaneArray(np.stack([np.asarray(x, np.float64) for x in parts], axis=-1)),
        *records,
    )


def _states_in_lanes(each: Sequence[Any]) -> Any:
    return LaneArray(np.array(each).T.copy())


class LaneEvaluation(Evaluation):
    """The quantities of scenes of one structure at states (q, v, t), each on first use.

    Args:
        scenes: one for each state.
        states: the states (q, v, t).

    Attributes:
        lanes: number of states L.
        scenes: all of them; `scene` is the first, used for everything that they have in common.
        refused: by formulation, the lanes that it refuses, bool (L,).
        conditions: whether it refuses by condition numbers, or only results that overflow.
    """

    conditions = True

    def __init__(self, scenes: Sequence[Scene], states: Sequence[State]):
        q, v = (_states_in_lanes([state[i] for state in states]) for i in (0, 1))
        t: Any = 0.0
        if scenes[0].depends_on_time:
            t = LaneArray(np.array([s.t for s in states]))
        self._begin_lanes(scenes, q, t)
        self.v = v

    def _begin_lanes(self, scenes: Sequence[Scene], q: LaneArray, t: Any) -> None:
        self._begin(scenes[0], q, t)  # type: ignore[arg-type]
        self.arithmetic, self.scenes, self.lanes = LANE_ARITHMETIC, scenes, len(scenes)
        self.refused: dict[Key, Array] = {}

    @quantity
    def parameters(self) -> Any:
        """The scenes' parameters, in lanes."""
        return self.finished(stacked([scene.parameters(FLOAT64) for scene in self.scenes]))

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function on lanes.

        Raises:
            TypeError: it does more than rational operations.
        """
        return TRACES.run_in_lanes(None, function, *map_record(self._packed, arguments))

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record the matrices that are solved inside the block."""
        return recording_solves(conditions=self.conditions)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function on lanes: see `call`."""
        return self.call(function, *arguments)

    def _packed(self, x: Any) -> Any:
        return as_float64(x) if isinstance(x, np.ndarray) and lanes_in(x) else x

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Store the matrices solved for generalized speeds by a partition; see `Evaluation`."""
        super().speeds_solved(watch)
        self.refused[SPEEDS] = np.any(watch.refused, axis=0)

    def refuse_speeds(self) -> None:
        """Do nothing: either all lanes have speeds, or speeds are not used."""

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Accept every result: `_solve` refuses lanes that are not finite one by one."""

    def _solve(self, formulation: Formulation, pivoted: bool) -> Acceleration:
        key = formulation.key, pivoted
        self.refused[key] = np.zeros(self.lanes, bool)
        with self.computing(formulation.key), self.recording_solves(key) as recorder:
            solution = self.solution(formulation, self.partition)
        vdot, multipliers = map_record(as_float64, tuple(solution))
        for x in (vdot, multipliers):
            if x is not None:
                self.refused[key] |= ~np.isfinite(x.data).reshape(-1, self.lanes).all(axis=0)
        for refused in recorder.refused:
            self.refused[key] |= refused
        if formulation.in_speeds and SPEEDS in self.refused:
            self.refused[key] |= self.refused[SPEEDS]
        self.solves[key] = {solve.name: solve for solve in recorder.solves}
        rcond = recorder.rcond
        if formulation.state == "q, u":
            rcond = self.speeds_rcond | rcond
        for x in (vdot, multipliers):
            if x is not None:
                x.data[..., self.refused[key]] = np.nan
        return Acceleration(vdot, multipliers, rcond, float("inf"))

    def alone(self, lane: int) -> Evaluation:
        """Return the evaluation at the state of one lane."""
        return Evaluation(self.scenes[lane], *self.state_of(lane))

    def state_of(self, lane: int) -> State:
        """Return (q, v, t) of one lane."""
        t = self.t.data[lane] if isinstance(self.t, LaneArray) else self.t
        q, v = self.q.data[:, lane], self.v.data[:, lane]  # type: ignore[attr-defined]
        return State(q, v, float(t))

    def perturbed(self, coordinates: bool = False) -> tuple[PerturbedLaneEvaluation, ...]:
        """Return the perturbed samples, see `perturbed_samples`."""
        return self.cached(_samples_everywhere if coordinates else _samples)


class PerturbedLaneEvaluation(PerturbedEvaluation, LaneEvaluation):
    """A perturbed sample of an evaluation in lanes: every number is perturbed.

    Args:
        original: the evaluation.
        noise: source of the perturbations, the same in all lanes.
        coordinates: whether the coordinates are perturbed too.
    """

    def __init__(self, original: LaneEvaluation, noise: LaneNoise, coordinates: bool):
        with noise.stream("state"):
            q = noise.perturb(original.q) if coordinates else original.q
            v = original.v + _velocity_perturbation(original, noise)
        self._begin_lanes(original.scenes, q, original.t)  # type: ignore[arg-type]
        self.v, self._original, self.noise = v, original, noise

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each of its operations perturbed."""
        return TRACES.run_in_lanes(self.noise, function, *map_record(self._packed, arguments))

    @quantity
    def parameters(self) -> Any:
        """The scenes' parameters, perturbed."""
        return self.finished(self._original.parameters)

    def prepare(self) -> tuple[Any, Sequence[Any]]:
        """Return the precomputed values, every operation perturbed, and their angles and roots."""
        with suppress(TypeError):
            arguments = self.parameters, self.q, self.time
            prepared, angles_and_roots = self.call(
                traceable_prepare(self.scene.prepare), *arguments
            )
            return map_record(self.noise.as_perturbed, prepared), angles_and_roots
        return super().prepare()

    @property
    def prepare_arithmetic(self) -> Any:
        """The arithmetic of an untraceable `prepare`: cosines, sines, roots are perturbed."""
        lanes: Any = LANE_ARITHMETIC
        return NoisyArithmetic(lanes, self.noise)


def _samples(at: Any) -> tuple[PerturbedLaneEvaluation, ...]:
    return _new_samples(at, coordinates=False)


def _samples_everywhere(at: Any) -> tuple[PerturbedLaneEvaluation, ...]:
    return _new_samples(at, coordinates=True)


def _new_samples(at: LaneEvaluation, coordinates: bool) -> tuple[PerturbedLaneEvaluation, ...]:
    noises = (*(LaneNoise(seed) for seed in range(SAMPLES)), LaneNoise(0, STRETCH * STEP))
    return tuple(PerturbedLaneEvaluation(at, noise, coordinates) for noise in noises)


def _velocity_perturbation(at: LaneEvaluation, noise: LaneNoise) -> LaneArray:
    change = noise.perturb(at.v) - at.v
    if at.terms.a is None:
        return change
    allowed = at.cached(_allowed_violation)
    residual = allowed.data / allowed_error(1.0) * SLIP * noise.changes((at.scene.r,))[:, None]
    Q, R = at.cached(_constraint_factors)
    with np.errstate(all="ignore"):
        usable: Any = np.isfinite(R).all(axis=(1, 2)) & np.diagonal(R, axis1=1, axis2=2).all(axis=1)
        R = np.where(usable[:, None, None], R, np.eye(R.shape[-1]))
        slip = (Q @ solve_transposed_triangle(R, residual.T)[..., None])[..., 0]
        usable &= np.isfinite(slip).all(axis=1)
    return change + LaneArray(np.where(usable[:, None], slip, 0.0).T)


def solve_transposed_triangle(R: Array, x: Array) -> Array:
    """Return y (L, k) of Rᵀ y = x, for upper triangles R (L, k, k).

    It is not solved with pivots: one that is 0, from entries far apart in size, would raise an
    error for all lanes.
    """
    y = np.zeros_like(x)
    for i in range(x.shape[1]):
        y[:, i] = (x[:, i] - (R[:, :i, i] * y[:, :i]).sum(axis=1)) / R[:, i, i]
    return y


def _allowed_violation(at: Any) -> LaneArray:
    """Return `allowed_violation` (r, L), for the few lanes that need more state by state."""
    a, b, v = at.terms.a, at.terms.b, at.v
    residual = a @ v if b is None else a @ v + b
    allowed = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
    allowed = allowed_error(1.0) * allowed
    for lane in np.flatnonzero((np.abs(residual.data) > allowed.data).any(axis=0)):
        allowed.data[:, lane] = allowed_violation(at.alone(lane))
    return allowed


def _constraint_factors(at: Any) -> tuple[Array, Array]:
    """Return Q (L, n, r) and R (L, r, r) with aᵀ = Q R."""
    Q, R = np.linalg.qr(np.moveaxis(at.terms.a.data, -1, 0).swapaxes(-1, -2))
    return Q, R


# ---- Sensitivities -------------------------------------------------------------------------------


def sensitivity_in_lanes(
    at: LaneEvaluation,
    quantity: Callable[[Any], Any],
    coordinates: bool = False,
    solved: bool = False,
    samples: int = SAMPLES,
) -> Array:
    """Return κ · scale (L,) of a quantity; see `eomcheck.evaluation.sensitivity_of`.

    With `samples` below `SAMPLES` it is the same or smaller.
    """
    exact = as_float64(quantity(at))
    with np.errstate(all="ignore"):
        try:
            changes = []
            perturbed = at.perturbed(coordinates)
            for sample in (*perturbed[:samples], perturbed[-1]):
                with sample.computing("quantity"):
                    changes.append(largest_in(as_float64(quantity(sample)) - exact, at.lanes))
        except (RefusedError, np.linalg.LinAlgError):
            return np.full(at.lanes, np.inf)
        return amplification(largest_in(exact, at.lanes), np.array(changes), solved)


def speeds_resolved_in_lanes(at: LaneEvaluation) -> Array:
    """Return whether W exceeds its rounding error, bool (L,), see `speeds_resolved`."""
    at.speeds  # noqa: B018  (the matrices solved for them are needed)
    rcond = at.speeds_rcond
    if not rcond:
        return np.ones(at.lanes, bool)
    of_W = sensitivity_in_lanes(at, lambda e: e.speeds.W, solved=True)
    return well_conditioned(rcond) & np.isfinite(of_W)


def largest_in(x: Any, lanes: int) -> Array:
    """Return the largest magnitude (L,) in each lane; x may be an array that is the same in all."""
    return np.broadcast_to(np.asarray(getattr(largest(x), "data", largest(x))), (lanes,))


def acceleration_sensitivity_in_lanes(
    at: LaneEvaluation,
    formulation: Formulation,
    part: str = "vdot",
    *,
    coordinates: bool = False,
    samples: int = SAMPLES,
) -> Array:
    """Return κ · scale (L,) of a part of the result, a lower bound of `acceleration_sensitivity`.

    Perturbations of the inputs only are left out: screening in lanes evaluates the states again
    whose errors are near to the allowed ones. With `samples` below `SAMPLES` it is the same or
    smaller still.
    """
    rcond = at.acceleration(formulation).rcond
    sensitivity = sensitivity_in_lanes(
        at,
        lambda e: getattr(e.acceleration(formulation), part),
        coordinates,
        solved=True,
        samples=samples,
    )
    with np.errstate(all="ignore"):
        unsure = np.zeros(at.lanes, bool)
        if rcond:
            unsure = ~well_conditioned(rcond)
        exact = at.solves[formulation.key, False]
        for sample in at.perturbed(coordinates)[:samples]:
            sample.acceleration(formulation)
            for name, solve in sample.solves[formulation.key, False].items():
                change = np.abs(solve.log_determinant - exact[name].log_determinant) * np.log(2.0)
                unsure |= solve.sign != exact[name].sign
                unsure |= ~(allowed_error(1.0) * (change / STEP) <= INCONCLUSIVE)
    return np.where(unsure, np.inf, sensitivity)
