"""Perturbed samples of an evaluation, and the sensitivity to rounding that they measure.

A perturbed sample computes the same quantities, but each number that is read and the result of each
operation is perturbed by a random share of a small step (Monte Carlo arithmetic). All samples of an
evaluation, of one state or of a batch of states, are computed at once, as one batch: one by one,
Python would take most of the time.

The sensitivity κ · scale of a quantity is its change per step by which all numbers are perturbed:
the factor from a relative rounding error to a change of the quantity
(`eomcheck.evaluation.tolerance`).

Perturbed velocities violate the constraints by as much as rounding allows. The violation of
velocities v is |a v + b|, row by row. Rounding explains C ε (|a| |v| + |b|), more if the
coordinates' own rounding changes a and b by more. Velocities that violate them by more are
rejected, and so are accelerations that violate redundant constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any

import numpy as np
from scipy.linalg import qr, solve_triangular

from eomcheck.errors import InconsistentVelocityError, RefusedError
from eomcheck.evaluation.evaluation import (
    TRACES,
    Acceleration,
    BatchEvaluation,
    Evaluation,
    Key,
    lanes_of_each,
    values_of_each,
)
from eomcheck.evaluation.scene_quantities import Solution, cached_quantity, number_of_values
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    NOTICEABLE,
    UNDERFLOW,
    allowed_error,
    largest,
    largest_of_each,
    well_conditioned,
)
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.batch_arrays import (
    BatchArray,
    NoiseBatch,
    as_float64,
    batch_data,
)
from eomcheck.numbers.generic import FLOAT64, Array, RecordingArithmetic, map_record
from eomcheck.numbers.linear import SolveRecorder, for_each_noise, recording_solves
from eomcheck.numbers.noise import (
    SAMPLES,
    STEP,
    STRETCH,
    Noise,
    NoisePosition,
    NoisyArithmetic,
    PerturbedArray,
)

# ---- Perturbed samples ---------------------------------------------------------------------------

NOISES = *(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP)
"""Noises of the perturbed samples: the last is the first with a larger step."""


class PerturbedEvaluation(Evaluation):
    """The perturbed samples of an evaluation, as one batch: every number is perturbed.

    Each sample is perturbed as it would be alone. Nothing is refused but speeds: a result that is
    not finite makes the sensitivity infinite.

    Args:
        original: the evaluation, of one state or of a batch of L states.
        coordinates: whether the coordinates are perturbed too.

    Attributes:
        original: the evaluation.
        noise: source of the perturbations.
        count: number of elements of the batch; element i is the sample i // L of state i % L.
    """

    is_perturbed = True

    def __init__(self, original: Evaluation, coordinates: bool):
        self.original, self.states = original, original.states
        self.unit_roundoff = original.unit_roundoff
        self.noise = NoiseBatch(NOISES, original.states or 1)
        self.count = self.noise.count
        with self.computing("state"):
            q, v = self.noise.repeated((original.q, original.v))
            if coordinates:
                q = BatchArray(self.noise.perturbed(q.data, _input_size(original, 0, q.data)))
            v = BatchArray(v.data + _velocity_perturbations(original, v.data, self.noise))
        t: Any = original.t
        t = self.noise.repeated(t) if isinstance(t, BatchArray) else t
        self._begin_batch(original.scene, q, v, t)
        if original.tau is not None:
            with self.computing("tau"):
                self.tau = self.finished(self.noise.repeated(original.tau))
        self._without_noise: dict[Key, Solution] = {}

    @contextmanager
    def computing(self, name: str) -> Iterator[None]:
        """Draw noise from the start of the stream `name` inside the block; see `Noise.stream`."""
        before, self.noise.position = self.noise.position, NoisePosition(name)
        try:
            yield
        finally:
            self.noise.position = before

    def finished(self, record: Any) -> Any:
        """Return `record`, perturbed."""
        return self.noise.perturb_record(record)

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each of its operations perturbed.

        If it does more than rational operations, only its arguments and results are perturbed.

        Raises:
            TypeError: it does more than rational operations, and there are several states.
        """
        with np.errstate(all="ignore"):
            try:
                return TRACES.run(self.noise, function, *arguments)
            except TypeError:
                if self.states:
                    raise
            return self._stacked(
                for_each_noise(self.noise, lambda i, noise: function(*_part(arguments, i, noise)))
            )

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each operation perturbed: see `call`."""
        return self.call(function, *arguments)

    def _in_lanes(self, key: Key, function: Callable, shared: tuple, varied: tuple) -> Any:
        """Return the results for k values of all samples, each perturbed as it would be alone."""
        count = number_of_values(varied)
        noise, samples = self.noise.of_states(count), self.count

        with recording_solves(noise, self.original.solves.get(key)), np.errstate(all="ignore"):
            arguments = lanes_of_each(shared, varied, samples, count)
            result = TRACES.run(noise, function, *arguments[0], *arguments[1])
        return values_of_each(result, samples, count)

    def _stacked(self, records: Sequence[Any]) -> Any:
        """Return the records of all samples as one; parts that are not float64 are equal."""
        first = records[0]
        if isinstance(first, tuple):
            parts = [self._stacked(each) for each in zip(*records, strict=True)]
            return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
        if isinstance(first, float) or (
            isinstance(first, np.ndarray) and first.dtype == np.float64
        ):
            noise = self.noise if isinstance(first, PerturbedArray) else None
            return BatchArray(np.stack([np.asarray(x) for x in records]), noise)
        return first

    # ---- Inputs ----------------------------------------------------------------------------------

    def constants(self, record: Any) -> Any:
        """Return `record`, perturbed in every sample by itself."""
        return self.finished(self.noise.repeated(record))

    def rounded_sum(self, T: Array, q: Array, shift: Array) -> Any:
        """Return coordinates T q + shift, perturbed where they are sums, or products."""
        data = batch_data(q, self.count)
        exact = np.count_nonzero(T, axis=1) + (shift != 0.0) <= 1
        exact &= (np.isin(T, (0.0, 1.0, -1.0))).all(axis=1)
        size = np.where(exact, 0.0, np.abs(data) @ np.abs(T).T + np.abs(shift))
        x = data @ T.T + shift
        return BatchArray(np.where(exact, x, self.noise.perturbed(x, size)))

    @cached_quantity
    def parameters(self) -> Any:
        """The scene's parameters, perturbed."""
        return self.finished(self.noise.repeated(self.original.parameters))

    def prepare(self) -> tuple[Any, Sequence[Any]]:
        """Return the precomputed values, every operation perturbed, and their angles and roots.

        If `prepare` cannot be traced, only its cosines, sines and roots are perturbed.
        """
        try:
            arguments = self.parameters, self.q, self.time
            prepared, angles_and_roots = TRACES.run(
                self.noise, traceable_prepare(self.scene.prepare), *arguments
            )
            return map_record(self.noise.as_perturbed, prepared), angles_and_roots
        except TypeError:
            if self.states:
                raise
        return self._stacked(for_each_noise(self.noise, self._prepare_one))

    def _prepare_one(self, i: int, noise: Noise) -> tuple[Any, tuple]:
        recorder = RecordingArithmetic(NoisyArithmetic(FLOAT64, noise))
        parameters, q = _part((self.parameters, self.q), i, noise)
        return self.scene.prepare(recorder, parameters, q, self.t), tuple(recorder.recorded)

    @cached_quantity
    def terms(self) -> Terms:
        """The terms M, Q, B, a, gamma, b, with perturbed body Jacobians if derived from these."""
        scene = self.scene
        if "terms" not in scene.derived_functions:
            return super().terms
        # If inertia forces cancel in B, only this shows their rounding errors.
        arguments = self.parameters, self.prepared, self.q, self.v
        jacobians = self.finished(self.call(scene.jacobians, *arguments))
        return self.finished(self.call(scene.assemble, *arguments, jacobians))

    # ---- Choices of the original -----------------------------------------------------------------

    @cached_quantity
    def partition(self) -> Partition:
        """The partition of the original."""
        return self.original.partition

    @cached_quantity
    def pivoted_partition(self) -> Partition:
        """The pivoted partition of the original."""
        return self.original.pivoted_partition

    @cached_quantity
    def independent_partition(self) -> Partition:
        """The partition of the original into independent and redundant constraints."""
        return self.original.independent_partition

    def partition_for(self, formulation: Formulation, pivoted: bool) -> Partition:
        """Return the partition that the original uses."""
        return self.original.partition_for(formulation, pivoted)

    # ---- Results ---------------------------------------------------------------------------------

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record and perturb the matrices that are solved, with the pivots of the original."""
        return recording_solves(self.noise, self.original.solves.get(key) if key else None)

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Store the matrices solved for generalized speeds, without condition numbers."""
        super().speeds_solved(watch)
        self.speeds_rcond = {}

    def refuse_speeds(self) -> None:
        """Raise RefusedError if the scene has no generalized speeds in one of the samples."""
        for q in () if self.states else batch_data(self.q, self.count):
            self.scene.refuse_speeds(q)

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Accept every result: one that is not finite makes the sensitivity infinite."""

    def _solve_in(self, formulation: Formulation, T: Array) -> Any:
        with self.computing("quantity"):
            return super()._solve_in(formulation, T)

    def solution_without_noise(self, formulation: Formulation, pivoted: bool) -> Solution:
        """Return the result of `formulation` for the samples' inputs, without perturbing it."""
        partition, key = self.partition_for(formulation, pivoted), (formulation.key, pivoted)
        if key not in self._without_noise:
            with self.noise.disabled(), self.recording_solves(key), np.errstate(all="ignore"):
                self._without_noise[key] = self.solution(formulation, partition)
        return self._without_noise[key]


def _part(record: Any, i: int, noise: Noise) -> Any:
    """Return the part of a batched record for sample i of one state, perturbed by its noise."""

    def of_sample(x: Any) -> Any:
        x = as_float64(x) if isinstance(x, np.ndarray) and x.dtype == object else x
        if not isinstance(x, BatchArray):
            return x
        part = x.data[(i, ...)]
        return part if x.noise is None else noise.as_perturbed(part)

    return map_record(of_sample, record)


def _perturbed(at: Evaluation) -> PerturbedEvaluation:
    return PerturbedEvaluation(at, coordinates=False)


def _perturbed_everywhere(at: Evaluation) -> PerturbedEvaluation:
    return PerturbedEvaluation(at, coordinates=True)


def perturbed_samples(at: Evaluation, coordinates: bool = False) -> PerturbedEvaluation:
    """Return the perturbed samples of `at`, with every number but the coordinates perturbed.

    They are `SAMPLES` samples with the step `STEP`, and then one with the noise of the first and
    `STRETCH` times the step.

    Args:
        at: the evaluation.
        coordinates: whether the coordinates are perturbed too. The built-in formulations read one
            and the same q, so that its rounding is not their error; an external engine computes its
            own angles from q and rounds them again.
    """
    return at.cached(_perturbed_everywhere if coordinates else _perturbed)


# ---- Violations of constraints -------------------------------------------------------------------

SLIP = 4.0
"""Violation of each constraint by perturbed velocities, in steps: perturbations may be as small as
half a step and cancel between rows, while the v of a state may violate all rows by the allowed
amount and with the worst signs."""


def violation(at: Evaluation, v: Any) -> tuple[Any, Any]:
    """Return the signed residual a v + b and its allowed rounding error, each (r,), m/s.

    `at` has constraints.
    """
    a, b = at.terms.a, at.terms.b
    with np.errstate(all="ignore"):
        residual = a @ v if b is None else a @ v + b
        size = np.abs(a) @ np.abs(v) + (0.0 if b is None else np.abs(b))
        return residual, allowed_error(1.0, at.unit_roundoff) * size


def allowed_violation(at: Evaluation) -> Any:
    """Return the |a v + b| (r,) that rounding alone explains, m/s; `at` has constraints.

    It is C ε (|a| |v| + |b|), and if that does not explain the residual, the largest change of a
    and b by rounding of the coordinates is added: the only entry of a row may be cos(π/2), whose
    size is rounding error.
    """
    residual, allowed = violation(at, at.v)
    if isinstance(at, BatchEvaluation):
        for i in np.flatnonzero((np.abs(residual.data) > allowed.data).any(axis=1)).tolist():
            allowed.data[i] = allowed_violation(at.alone(i))
        return allowed
    if (np.abs(residual) <= allowed).all():
        return allowed
    (_, _, _, a, _, b), changes = at.terms, [np.zeros_like(allowed)]
    for seed in range(SAMPLES):
        q = Noise(seed).perturb(at.q)
        near = Evaluation(at.scene, q, at.v, at.t).terms
        change = np.abs(near.a - a) @ np.abs(at.v)
        changes.append(change if b is None else change + np.abs(near.b - b))
    return allowed + allowed_error(1.0, at.unit_roundoff) * np.max(changes, axis=0) / STEP


def _input_size(at: Evaluation, part: int, x: Array) -> Array:
    """Return the sizes of q (`part` 0) or v (1) to which their rounding is relative."""
    own = np.abs(x)
    return own if at.input_sizes is None else np.maximum(own, at.input_sizes[part])


CONSISTENT_HINT = " (consistent=False lets it pass)"


def check_consistent(at: Evaluation, hint: str = "") -> None:
    """Check |a v + b| against the allowed rounding error, row by row; see `allowed_violation`.

    Args:
        at: the evaluation.
        hint: end of the error message.

    Raises:
        InconsistentVelocityError: names the worst row, its residual and the allowed one.
    """
    if at.terms.a is None:
        return
    residual, allowed = violation(at, at.v)[0], at.cached(allowed_violation)
    with np.errstate(invalid="ignore"):
        excess = np.abs(residual) - allowed
    if (excess > 0).any():
        row = int(np.argmax(excess))
        raise InconsistentVelocityError(
            f"v violates the constraint of {at.scene.constraint_names[row]}: |a v + b| = "
            f"{abs(residual[row]):.3g} m/s, allowed {allowed[row]:.3g}{hint}"
        )


def _velocity_perturbations(at: Evaluation, v: Array, noise: NoiseBatch) -> Array:
    """Return perturbations of v (B, n): of its entries, and within the allowed violation."""
    change = noise.perturbed(v, _input_size(at, 1, v)) - v
    if at.terms.a is None:
        return change
    states = at.states or 1
    unit = allowed_error(1.0, at.unit_roundoff)
    allowed = batch_data(at.cached(allowed_violation), states) / unit * SLIP
    residuals = np.tile(allowed, (len(v) // states, 1))
    residuals = residuals * noise.changes(residuals.shape)
    factors = at.cached(_constraint_factors)
    for i, residual in enumerate(residuals):
        slip = _slip(*factors[i % states], residual)
        if np.isfinite(slip).all():
            change[i] += slip
    return change


def _slip(Q: Array, R: Array, rows: Array, residual: Array) -> Array:
    """Return the smallest velocity (n,) with a residual (r,) of the constraints; NaN if none."""
    with np.errstate(all="ignore"):
        try:
            return Q @ solve_triangular(R, residual[rows], trans=1, check_finite=False)
        except (np.linalg.LinAlgError, ValueError):  # dependent constraints
            return np.full(len(Q), np.nan)


def _constraint_factors(at: Evaluation) -> list[tuple[Array, Array, Array]]:
    """Return Q (n, k), R (k, k) with aᵀ = Q R for independent constraints, and their indices (k,).

    They are a list, one for each state. The constraints are all r if none is clearly redundant.
    """
    factors: Any = partial(qr, mode="economic", check_finite=False)
    results = []
    for i, a in enumerate(batch_data(at.terms.a, at.states or 1)):
        Q, R = factors(a.T)
        rows = np.arange(len(a))
        least = np.abs(np.diagonal(R)).min(initial=np.inf)
        if least <= NOTICEABLE * largest(R) or len(a) > len(R):
            with suppress(RefusedError):
                alone = at.alone(i) if isinstance(at, BatchEvaluation) else at
                kept = alone.independent_partition.kept
                rows = rows if kept is None else kept
                Q, R = factors(a[rows].T)
        results.append((Q, R, rows))
    return results


# ---- Sensitivities -------------------------------------------------------------------------------

NOISY = 2.0**-12
"""Relative change of a solution under `STEP` above which its growth with the step is checked."""


def sensitivity_of(
    at: Evaluation,
    quantity: Callable[[Any], Any],
    coordinates: bool = False,
    solved: bool = False,
) -> Any:
    """Return the sensitivity κ · scale of a quantity to rounding; of a batch, of each state.

    It is the size of the quantity plus its largest change under perturbation divided by the step.
    It is infinite if a perturbed sample cannot be computed. For a quantity that is `solved`, the
    result of a solve, it is also infinite if the change does not grow with the step: no digit of
    the result is left then.

    Args:
        at: the evaluation.
        quantity: function of `at`, and of its perturbed samples, that returns the quantity.
        coordinates: whether the coordinates are perturbed too.
        solved: whether the quantity is the result of a solve.
    """
    exact = quantity(at)
    with np.errstate(all="ignore"):
        try:
            samples = perturbed_samples(at, coordinates)
            with samples.computing("quantity"):
                perturbed = quantity(samples)
        except (RefusedError, np.linalg.LinAlgError):
            return _of_states(np.inf, at)
        return measured_sensitivity(at, exact, perturbed, solved)


def measured_sensitivity(at: Evaluation, exact: Any, perturbed: Any, solved: bool = False) -> Any:
    """Return κ · scale of a quantity; see `sensitivity_of`.

    Args:
        at: the evaluation.
        exact: the quantity at `at`.
        perturbed: the quantity of its perturbed samples.
        solved: see `sensitivity_of`.
    """
    exact = batch_data(exact, at.states or 1)
    changes = largest_of_each(_changes(exact, perturbed)).reshape(len(NOISES), -1)
    return _of_states(amplification(largest_of_each(exact), changes, solved), at)


def _changes(exact: Array, perturbed: Any) -> Array:
    """Return the changes (B, ...) of a quantity (L, ...) in its perturbed samples."""
    count = len(NOISES) * len(exact)
    changes = batch_data(perturbed, count).reshape(len(NOISES), *exact.shape) - exact
    return changes.reshape(count, *exact.shape[1:])


def _of_states(x: Any, at: Evaluation) -> Any:
    """Return one number, or one for each state (L,), as the number of `at`."""
    x = np.broadcast_to(x, (at.states or 1,))
    return BatchArray(x) if at.states else x[0].item()


def entry_sensitivity_of(at: Evaluation, quantity: Callable[[Any], Any]) -> Array:
    """Return the sensitivity to rounding of each entry of a quantity, same shape.

    The coordinates are perturbed too. It is the size of the entry if a sample cannot be computed.
    """
    exact = np.asarray(quantity(at))
    with np.errstate(all="ignore"):
        try:
            samples = perturbed_samples(at, True)
            with samples.computing("quantity"):
                return measured_entry_sensitivity(at, exact, quantity(samples))
        except (RefusedError, np.linalg.LinAlgError):
            return np.abs(exact)


def measured_entry_sensitivity(at: Evaluation, exact: Any, perturbed: Any) -> Any:
    """Return κ · scale of each entry of a quantity, of its shape; see `measured_sensitivity`."""
    exact = batch_data(exact, at.states or 1)
    changes = np.abs(_changes(exact, perturbed)).reshape(len(NOISES), *exact.shape)
    sensitivity = np.abs(exact) + changes[:SAMPLES].max(axis=0) / STEP
    return BatchArray(sensitivity) if at.states else sensitivity[0]


def amplification(size: Array, changes: Array, solved: bool) -> Array:
    """Return the sensitivity (...,) of quantities from their sizes and their changes.

    Args:
        size: sizes (...,) of the quantities.
        changes: largest changes (k, ...) under noise, the last under noise that is stretched.
        solved: see `sensitivity_of`.
    """
    changes, stretched = changes[:-1], changes[-1]
    with np.errstate(all="ignore"):
        amplified = size + changes.max(axis=0) / STEP
        lost = np.isinf(stretched)
        if solved:
            # A quantity that underflows changes by the spacing of float64, whatever the noise.
            seen = changes[0] > np.maximum(NOISY * size, UNDERFLOW)
            lost = lost | (seen & (stretched < STRETCH / 2 * changes[0]))
    return np.where(lost, np.inf, amplified)


def acceleration_sensitivity(
    at: Evaluation,
    formulation: Formulation,
    part: str = "vdot",
    *,
    coordinates: bool = False,
    pivoted: bool = False,
) -> Any:
    """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`.

    It is infinite if C κ ε exceeds `INCONCLUSIVE` for a matrix that was solved, either by its
    condition number or because its determinant depends so strongly on the inputs: perturbation may
    then lose the same digits as rounding, and measures nothing. Of a batch it is that of each
    state.

    Raises:
        RefusedError: as `Evaluation.acceleration`.
    """
    rcond = at.acceleration(formulation, pivoted).rcond
    resolved = np.asarray(well_conditioned(rcond, at.unit_roundoff) if rcond else True)
    if not resolved.any():
        return _of_states(np.inf, at)
    sensitivity = sensitivity_of(
        at, lambda e: getattr(e.acceleration(formulation, pivoted), part), coordinates, solved=True
    )
    sensitivity = batch_data(sensitivity, at.states or 1)
    if np.isinf(sensitivity).all():
        return _of_states(np.inf, at)
    samples = perturbed_samples(at, coordinates)
    resolved = resolved & _matrices_resolved(at, samples, (formulation.key, pivoted))
    if not resolved.any():
        return _of_states(np.inf, at)
    own = _input_sensitivity(at, samples, formulation, part, pivoted)
    return _of_states(np.where(resolved, np.maximum(sensitivity, own), np.inf), at)


def _input_sensitivity(
    at: Evaluation, samples: PerturbedEvaluation, formulation: Formulation, part: str, pivoted: bool
) -> Array:
    """Return κ · scale (L,) of a part of the result if only its inputs are perturbed.

    In all samples by chance, these perturbations and those inside the formulation may cancel; a
    search by hill climbing for small error bounds comes to the states where they do.
    """
    exact = batch_data(getattr(at.acceleration(formulation, pivoted), part), at.states or 1)
    with np.errstate(all="ignore"):
        perturbed = getattr(samples.solution_without_noise(formulation, pivoted), part)
        changes = largest_of_each(_changes(exact, perturbed)).reshape(len(NOISES), -1)
        return largest_of_each(exact) + changes[:SAMPLES].max(axis=0) / STEP


def speeds_resolved(at: Evaluation) -> Any:
    """Return whether W of generalized speeds by a partition exceeds its rounding error.

    If a_1 is singular but for rounding, ẇ′ computed in two ways is two different numbers, and
    perturbed samples, although perturbed by more than rounding, are nearer to each other.
    """
    rcond = at.speeds_rcond
    if not rcond:
        return _of_states(True, at)
    of_W = batch_data(sensitivity_of(at, lambda e: e.speeds.W, solved=True), at.states or 1)
    return _of_states(well_conditioned(rcond, at.unit_roundoff) & np.isfinite(of_W), at)


def _matrices_resolved(at: Evaluation, samples: PerturbedEvaluation, key: Key) -> Array:
    """Return whether the matrices solved exceed the rounding errors of their inputs, bool (L,).

    They do not if a determinant changes its sign, or jumps because other pivots were taken. The
    solutions alone do not show it: with a right-hand side of zeros they are equal in all samples.
    """
    exact, resolved = at.solves[key], np.ones(at.states or 1, bool)
    for name, solve in samples.solves[key].items():
        signs, logs = (
            x.reshape(len(NOISES), -1)[:SAMPLES] for x in (solve.sign, solve.log_determinant)
        )
        with np.errstate(all="ignore"):
            changes = np.abs(logs - exact[name].log_determinant) * np.log(2.0)
            allowed = allowed_error(changes / STEP, at.unit_roundoff)
            sound = (signs == exact[name].sign) & (allowed <= INCONCLUSIVE)
        resolved &= sound.all(axis=0)
    return resolved


# ---- Results that satisfy redundant constraints --------------------------------------------------

CONTRADICTION = "gamma"
"""Name of a contradiction between constraints in refusals."""


def solution_of(at: Evaluation, formulation: Formulation, pivoted: bool = False) -> Acceleration:
    """Return the result of a formulation, checked not to violate redundant constraints.

    Raises:
        RefusedError: as `Evaluation.acceleration`, or constraints contradict each other.
    """
    result = at.acceleration(formulation, pivoted)
    if formulation.redundant and at.independent_partition.redundant is not None:
        check_no_contradiction(at, formulation, result)
    return result


def check_no_contradiction(at: Evaluation, formulation: Formulation, found: Acceleration) -> None:
    """Check that the acceleration satisfies the redundant constraints as well.

    Args:
        at: the evaluation.
        formulation: one that handles redundant constraints.
        found: its result.

    Raises:
        RefusedError: it does not; names the row that is violated most.
    """

    def residual(e: Any) -> Array:
        return e.terms.a @ e.acceleration(formulation).vdot + e.terms.gamma

    left, (_, _, _, a, gamma, _) = np.abs(residual(at)), at.terms
    size = float((np.abs(a) @ np.abs(found.vdot) + np.abs(gamma)).max())
    allowed = allowed_error(sensitivity_of(at, residual, solved=True) + size)
    worst = int(np.argmax(left))
    if left[worst] > allowed:
        raise RefusedError(
            CONTRADICTION,
            allowed / float(left[worst]),
            1.0,
            f"the constraint of {at.scene.constraint_names[worst]} contradicts the others: "
            f"|a v̇ + gamma| = {left[worst]:.3g} m/s² for every v̇, allowed {allowed:.3g}",
        )
