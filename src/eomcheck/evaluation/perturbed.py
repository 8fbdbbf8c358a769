"""Perturbed samples of an evaluation, and the sensitivity to rounding that they measure.

A perturbed sample computes the same quantities, but each number that is read and the result of each
operation is perturbed by a random share of a small step (Monte Carlo arithmetic). All samples of an
evaluation are computed as one batch, whose first axis is the sample: one by one, Python would take
most of the time.

The sensitivity κ · scale of a quantity is its change per step by which all numbers are perturbed:
the factor from a relative rounding error to a change of the quantity
(`eomcheck.evaluation.tolerance`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from functools import cached_property
from typing import Any

import numpy as np

from eomcheck.errors import RefusedError
from eomcheck.evaluation.evaluation import TRACES, Acceleration, Evaluation, Key
from eomcheck.evaluation.scene_quantities import Solution, quantity
from eomcheck.evaluation.tolerance import (
    INCONCLUSIVE,
    UNDERFLOW,
    allowed_error,
    largest,
    largest_of_each,
    well_conditioned,
)
from eomcheck.evaluation.violations import velocity_perturbation
from eomcheck.formulations import Formulation, Partition
from eomcheck.kernels.perturbed_trace import traceable_prepare
from eomcheck.mechanics.records import Terms
from eomcheck.numbers.generic import FLOAT64, Arithmetic, Array, map_record
from eomcheck.numbers.linear import SolveRecorder, for_each_noise, recording_solves
from eomcheck.numbers.noise import (
    SAMPLES,
    STEP,
    STRETCH,
    Noise,
    NoiseBatch,
    NoisyArithmetic,
    PerturbedArray,
)

# ---- Perturbed samples ---------------------------------------------------------------------------


def _call_perturbed(noise: Noise, function: Callable, *arguments: Any) -> Any:
    """Call a generic function with each of its operations perturbed.

    Raises:
        TypeError: it does more than rational operations.
    """
    with np.errstate(all="ignore"):
        return TRACES.run(noise, function, *arguments)


class PerturbedEvaluation(Evaluation):
    """An evaluation with perturbed numbers: base class for a state and for lanes of states.

    Attributes:
        noise: source of the perturbations.
    """

    is_perturbed = True
    noise: Noise
    _original: Evaluation

    def computing(self, name: str) -> AbstractContextManager:
        """Return the context in which the noise draws from the start of the stream `name`."""
        return self.noise.stream(name)

    def finished(self, record: Any) -> Any:
        """Return `record`, perturbed."""
        return self.noise.perturb_record(record)

    def run(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each operation perturbed: see `call`."""
        return self.call(function, *arguments)

    def recording_solves(self, key: Key | None = None) -> AbstractContextManager[SolveRecorder]:
        """Record and perturb the matrices that are solved, with the pivots of the original."""
        return recording_solves(self.noise, self._original.solves.get(key) if key else None)

    def speeds_solved(self, watch: SolveRecorder) -> None:
        """Store the matrices solved for generalized speeds, without condition numbers."""
        super().speeds_solved(watch)
        self.speeds_rcond = {}

    @quantity
    def terms(self) -> Terms:
        """The terms M, Q, B, a, gamma, b, with perturbed body Jacobians if derived from these."""
        scene = self.scene
        if "terms" not in scene.derived_functions:
            return super().terms
        # If inertia forces cancel in B, only this shows their rounding errors.
        arguments = self.parameters, self.prepared, self.q, self.v
        jacobians = self.finished(self.call(scene.jacobians, *arguments))
        return self.finished(self.call(scene.assemble, *arguments, jacobians))


class _SampleOrBatch(PerturbedEvaluation):
    """Base class of a perturbed sample and of the batch of them."""

    @quantity
    def pivoted_partition(self) -> Partition:
        """The pivoted partition of the original."""
        return self._original.pivoted_partition

    @quantity
    def independent_partition(self) -> Partition:
        """The partition of the original into independent and redundant constraints."""
        return self._original.independent_partition

    def check_finite(
        self, vdot: Array, multipliers: Array | None, formulation: Formulation
    ) -> None:
        """Accept every result: one that is not finite makes the sensitivity infinite."""


def _batch_property(name: str) -> Any:
    """Return the property of a sample that is its part of the batch's property `name`."""

    def part(sample: PerturbedSample) -> Any:
        return sample.batch.part(sample.index, getattr(sample.batch, name))

    return cached_property(part)


class PerturbedSample(_SampleOrBatch):
    """A perturbed sample of an evaluation: every number is perturbed.

    Args:
        original: the evaluation.
        noise: source of the perturbations.
        coordinates: whether the coordinates are perturbed too.

    Attributes:
        batch: the batch of all samples.
        index: index of this sample in the batch.
    """

    batch: PerturbedBatch
    index: int

    def __init__(self, original: Evaluation, noise: Noise, coordinates: bool):
        with noise.stream("state"):
            q = noise.perturb(original.q) if coordinates else original.q
            v = original.v + velocity_perturbation(original, noise)
        super().__init__(original.scene, q, v, original.t)
        self._original, self.noise = original, noise

    parameters = _batch_property("parameters")
    terms = _batch_property("terms")
    F = _batch_property("F")
    u = _batch_property("u")
    kinematics = _batch_property("kinematics")
    speeds = _batch_property("speeds")
    bodies = _batch_property("bodies")
    x = _batch_property("x")
    chain = _batch_property("chain")

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each of its operations perturbed.

        If it does more than rational operations, only its arguments and results are perturbed.
        """
        with suppress(TypeError):
            return _call_perturbed(self.noise, function, *arguments)
        return super().call(function, *arguments)

    def prepare(self) -> tuple[Any, Sequence[Any]]:
        """Return the precomputed values, and the angles and roots they are made of."""
        traced = self.batch.traced_preparation
        return super().prepare() if traced is None else self.batch.part(self.index, traced)

    @property
    def prepare_arithmetic(self) -> Arithmetic:
        """The arithmetic of an untraceable `prepare`: cosines, sines, roots are perturbed."""
        return NoisyArithmetic(FLOAT64, self.noise)

    def acceleration(self, formulation: Formulation, pivoted: bool = False) -> Acceleration:
        """Return the result of `formulation`; see `Evaluation`. Only speeds are refused."""
        key = formulation.key, pivoted
        result = self._solutions.get(key)
        if not isinstance(result, Acceleration):
            result = self._own_part(self.batch.acceleration(formulation, pivoted))
            self._solutions[key] = result
            self.solves[key] = {
                name: solve._replace(
                    sign=solve.sign[self.index], log_determinant=solve.log_determinant[self.index]
                )
                for name, solve in self.batch.solves[key].items()
            }
        return result

    def acceleration_in(self, formulation: Formulation, T: Array) -> Acceleration:
        """Return the result of a formulation in other coordinates, see `Evaluation`."""
        return self._own_part(self.batch.acceleration_in(formulation, T))

    def _own_part(self, of_all: Acceleration) -> Acceleration:
        vdot, multipliers = self.batch.part(self.index, (of_all.vdot, of_all.multipliers))
        return Acceleration(vdot, multipliers, of_all.rcond, float("inf"))


class PerturbedBatch(_SampleOrBatch):
    """A batch of perturbed samples of one evaluation; axis 0 of every array is the sample.

    Each sample is perturbed as it would be alone.

    Args:
        original: the evaluation.
        copies: its perturbed samples.
    """

    def __init__(self, original: Evaluation, copies: Sequence[PerturbedSample]):
        self._begin(original.scene, np.stack([copy.q for copy in copies]), original.t)
        self._original, self._samples = original, copies
        self.noise = self._noises = NoiseBatch([copy.noise for copy in copies])
        self._read: dict[Key, Solution] = {}

    def solution_without_noise(self, formulation: Formulation, pivoted: bool) -> Solution:
        """Return the result of `formulation` for the samples' inputs, without perturbing it."""
        partition, key = self.partition_for(formulation, pivoted), (formulation.key, pivoted)
        if key not in self._read:
            with self._noises.disabled(), self.recording_solves(key), np.errstate(all="ignore"):
                self._read[key] = self.solution(formulation, partition)
        return self._read[key]

    def part(self, place: int, record: Any) -> Any:
        """Return the part of a batched record that belongs to the sample at index `place`."""
        return _sample_part(record, place, self._samples[place].noise)

    def call(self, function: Callable, *arguments) -> Any:
        """Call a generic function with each of its operations perturbed.

        If it does more than rational operations, only its arguments and results are perturbed.
        """
        with suppress(TypeError):
            return _call_perturbed(self.noise, function, *arguments)
        with np.errstate(all="ignore"):
            alone = for_each_noise(
                self._noises, lambda i, noise: function(*_sample_part(arguments, i, noise))
            )
            return self._stacked(alone)

    def _stacked(self, records: Sequence[Any]) -> Any:
        """Return the records of all samples as one; parts that are not float64 are equal."""
        first = records[0]
        if isinstance(first, tuple):
            parts = [self._stacked(each) for each in zip(*records, strict=True)]
            return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
        if isinstance(first, float) or (
            isinstance(first, np.ndarray) and first.dtype == np.float64
        ):
            stack = np.stack([np.asarray(x) for x in records])
            return self.noise.as_perturbed(stack) if isinstance(first, PerturbedArray) else stack
        return first

    # ---- Inputs ----------------------------------------------------------------------------------

    @quantity
    def parameters(self) -> Any:
        """The scene's parameters, perturbed."""
        batch, exact = self.noise.shape, self._original.parameters
        return self.finished(map_record(lambda x: np.broadcast_to(x, batch + np.shape(x)), exact))

    @cached_property
    def traced_preparation(self) -> tuple[Any, Sequence[Any]] | None:
        """The precomputed values with every operation perturbed, and their angles and roots.

        None if the scene's `prepare` cannot be traced.
        """
        with suppress(TypeError), self.computing("prepared"):
            arguments = self.parameters, self.q, self.time
            prepared, angles_and_roots = _call_perturbed(
                self.noise, traceable_prepare(self.scene.prepare), *arguments
            )
            return map_record(self.noise.as_perturbed, prepared), angles_and_roots
        return None

    @property
    def time(self) -> Array:
        """The time (k, 1), as an argument of generic functions on float64 arrays."""
        return np.full((*self.noise.shape, 1), self.t)

    @quantity
    def prepared(self) -> Any:
        """The precomputed values; computed sample by sample if they cannot be traced."""
        if self.traced_preparation is not None:
            prepared, self._angles_and_roots = self.traced_preparation
            return prepared
        prepared = self._stacked([sample.prepared for sample in self._samples])
        self._angles_and_roots = self._stacked(
            [tuple(sample._angles_and_roots) for sample in self._samples]
        )
        return prepared

    @quantity
    def v(self) -> Array:
        """Velocities (k, n) of the samples."""
        return np.stack([sample.v for sample in self._samples])

    @quantity
    def u(self) -> Array:
        """Generalized speeds (k, p): those set in the samples, or computed from v."""
        if all("u" in vars(sample) for sample in self._samples):
            return np.stack([sample.u for sample in self._samples])
        return super().u

    # ---- Results ---------------------------------------------------------------------------------

    def refuse_speeds(self) -> None:
        """Raise RefusedError if the scene has no generalized speeds in one of the samples."""
        for q in self.q:
            self.scene.refuse_speeds(q)

    @quantity
    def partition(self) -> Partition:
        """The partition of the original."""
        return self._original.partition

    def _solve_in(self, formulation: Formulation, T: Array) -> Acceleration:
        with self.computing("quantity"):
            return super()._solve_in(formulation, T)

    def rate_of_velocity(self, udot: Array) -> Array:
        """Return v̇ (k, n) from u̇ (k, p)."""
        W, rest, _ = self.speeds
        return udot if W is None else self.mapped(W, udot) + rest

    def mapped(self, matrix: Array, x: Array) -> Array:
        """Return the product `matrix` x of all samples (k, ...)."""
        return (matrix @ x[..., None])[..., 0]


def _sample_part(record: Any, place: int, noise: Noise) -> Any:
    """Return the part of a batched record for the sample at index `place`, with its `noise`."""

    def of_sample(x: Any) -> Any:
        if not (isinstance(x, np.ndarray) and x.dtype == np.float64):
            return x
        part = x[(place, ...)]
        if isinstance(part, PerturbedArray):
            part.noise = noise
        return part

    return map_record(of_sample, record)


def _samples(at: Evaluation) -> tuple[PerturbedSample, ...]:
    return _new_samples(at, coordinates=False)


def _samples_everywhere(at: Evaluation) -> tuple[PerturbedSample, ...]:
    return _new_samples(at, coordinates=True)


def _new_samples(at: Evaluation, coordinates: bool) -> tuple[PerturbedSample, ...]:
    noises = (*(Noise(seed) for seed in range(SAMPLES)), Noise(0, STRETCH * STEP))
    samples = tuple(PerturbedSample(at, noise, coordinates) for noise in noises)
    batch = PerturbedBatch(at, samples)
    for index, sample in enumerate(samples):
        sample.batch, sample.index = batch, index
    return samples


def perturbed_samples(at: Evaluation, coordinates: bool = False) -> tuple[Any, ...]:
    """Return perturbed samples of `at`: every number is perturbed, on request also the coordinates.

    Returns:
        `SAMPLES` samples with the step `STEP`, and then one with the noise of the first and
        `STRETCH` times the step.

    The built-in formulations read one and the same q, so that its rounding is not their error; an
    external engine computes its own angles from q and rounds them again.
    """
    if at.lanes:
        return at.perturbed(coordinates)  # type: ignore[attr-defined]
    return at.cached(_samples_everywhere if coordinates else _samples)


# ---- Sensitivities -------------------------------------------------------------------------------

NOISY = 2.0**-12
"""Relative change of a solution under `STEP` above which its growth with the step is checked."""


def sensitivity_of(
    at: Evaluation,
    quantity: Callable[[Evaluation], Any],
    coordinates: bool = False,
    solved: bool = False,
    batched: bool = False,
) -> float:
    """Return the sensitivity κ · scale of a quantity to rounding.

    It is the size of the quantity plus its largest change under perturbation divided by the step.
    It is infinite if a perturbed sample cannot be computed. For a quantity that is `solved`, the
    result of a solve, it is also infinite if the change does not grow with the step: no digit of
    the result is left then.

    Args:
        at: the evaluation.
        quantity: function of `at`, and of its samples, that returns the quantity.
        coordinates: whether the coordinates are perturbed too.
        solved: whether the quantity is the result of a solve.
        batched: whether `quantity` also takes the batch of samples, with a leading batch axis.
    """
    exact = np.asarray(quantity(at))
    size = largest(exact)
    with np.errstate(all="ignore"):
        try:
            samples = perturbed_samples(at, coordinates)
            if batched:
                of_all = np.asarray(_evaluated(samples[0].batch, quantity))
                changes = largest_of_each(of_all - exact)
            else:
                changes = [
                    largest(np.asarray(_evaluated(sample, quantity)) - exact) for sample in samples
                ]
        except (RefusedError, np.linalg.LinAlgError):
            return float("inf")
    return float(amplification(size, np.array(changes), solved))


def entry_sensitivity_of(at: Evaluation, quantity: Callable[[Evaluation], Any]) -> Array:
    """Return the sensitivity to rounding of each entry of a quantity, same shape.

    The coordinates are perturbed too. It is the size of the entry if a sample cannot be computed.
    """
    exact = np.asarray(quantity(at))
    with np.errstate(all="ignore"):
        try:
            samples = perturbed_samples(at, True)[:SAMPLES]
            changes = [
                np.abs(np.asarray(_evaluated(sample, quantity)) - exact) for sample in samples
            ]
        except (RefusedError, np.linalg.LinAlgError):
            return np.abs(exact)
        return np.abs(exact) + np.max(changes, axis=0) / STEP


def amplification(size: Any, changes: Any, solved: bool) -> Any:
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


def _evaluated(sample: PerturbedEvaluation, quantity: Callable[[Evaluation], Any]) -> Any:
    with sample.computing("quantity"):
        return quantity(sample)


def acceleration_sensitivity(
    at: Evaluation,
    formulation: Formulation,
    part: str = "vdot",
    *,
    coordinates: bool = False,
    pivoted: bool = False,
) -> float:
    """Return κ · scale of a part ("vdot", "multipliers") of the result of `formulation`.

    It is infinite if C κ ε exceeds `INCONCLUSIVE` for a matrix that was solved, either by its
    condition number or because its determinant depends so strongly on the inputs: perturbation may
    then lose the same digits as rounding, and measures nothing.

    Raises:
        RefusedError: as `Evaluation.acceleration`.
    """
    rcond = at.acceleration(formulation, pivoted).rcond
    if rcond and not well_conditioned(rcond):
        return float("inf")
    sensitivity = sensitivity_of(
        at,
        lambda e: getattr(e.acceleration(formulation, pivoted), part),
        coordinates,
        solved=True,
        batched=True,
    )
    if np.isinf(sensitivity) or not _matrices_resolved(at, formulation, coordinates, pivoted):
        return float("inf")
    return max(sensitivity, _input_sensitivity(at, formulation, part, coordinates, pivoted))


def _input_sensitivity(
    at: Evaluation, formulation: Formulation, part: str, coordinates: bool, pivoted: bool
) -> float:
    """Return κ · scale of a part of the result if only the inputs of `formulation` are perturbed.

    In all samples by chance, these perturbations and those inside the formulation may cancel; a
    search by hill climbing for small error bounds comes to the states where they do.
    """
    exact = getattr(at.acceleration(formulation, pivoted), part)
    batch = perturbed_samples(at, coordinates)[0].batch
    perturbed = getattr(batch.solution_without_noise(formulation, pivoted), part)
    with np.errstate(all="ignore"):
        return largest(exact) + largest(np.asarray(perturbed)[:SAMPLES] - exact) / STEP


def speeds_resolved(at: Evaluation) -> bool:
    """Return whether W of generalized speeds by a partition exceeds its rounding error.

    If a_1 is singular but for rounding, ẇ′ computed in two ways is two different numbers, and
    perturbed samples, although perturbed by more than rounding, are nearer to each other.
    """
    rcond = at.speeds_rcond
    return not rcond or bool(
        well_conditioned(rcond)
        and np.isfinite(sensitivity_of(at, lambda e: e.speeds.W, solved=True))
    )


def _matrices_resolved(
    at: Evaluation, formulation: Formulation, coordinates: bool, pivoted: bool
) -> bool:
    """Return whether the matrices solved exceed the rounding errors of their inputs.

    They do not if a determinant changes its sign, or jumps because other pivots were taken. The
    solutions alone do not show it: with a right-hand side of zeros they are equal in all samples.
    """
    key = (formulation.key, pivoted)
    exact = at.solves[key]
    for name, solve in perturbed_samples(at, coordinates)[0].batch.solves[key].items():
        signs, logs = solve.sign[:SAMPLES], solve.log_determinant[:SAMPLES]
        changes = np.abs(logs - exact[name].log_determinant) * np.log(2.0)
        resolved = (signs == exact[name].sign) & (allowed_error(changes / STEP) <= INCONCLUSIVE)
        if not resolved.all():
            return False
    return True
